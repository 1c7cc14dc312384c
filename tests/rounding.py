"""Limits at the level of rounding, from the run itself and not from what one processor gave.

Two ways to compute the same steps differ by rounding in each of them, which the equations of the
scene carry on. How far, the run tells when it is started from numbers changed by one unit in the
last place: once more for each step it may be that far off.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

import skfem_cosserat as sc

EPS = float(np.finfo(float).eps)
#: between what is found and what is allowed: other processors round otherwise
ROOM = 30.0
NAMES = ("q", "p", "carried", "constraint_force")


def nudged(state: sc.State, seed: int = 0) -> sc.State:
    """A start with each number changed by about one unit in the last place, up or down."""
    rng = np.random.default_rng(seed)

    def next_to(x: np.ndarray) -> np.ndarray:
        return x * (1.0 + EPS * rng.choice([-1.0, 1.0], x.shape))  # what is zero stays zero

    return replace(state, q=next_to(state.q), p=next_to(state.p))


def limits(run: sc.History, beside: sc.History, names: Sequence[str] = NAMES) -> dict[str, float]:
    """How far another way to compute a run may be off it, by name of the series.

    Parameters
    ----------
    run : History
    beside : History
        The same, started from :func:`nudged` numbers.
    names : sequence of str
        Of series.
    """
    steps = len(run) - 1
    found = {}
    for name in names:
        a, b = run[name], beside[name]
        known = np.isfinite(a)
        departure = abs(a - b)[known].max(initial=0.0)
        size = abs(a[known]).max(initial=0.0)
        if name.startswith("work"):  # forces times differences of positions
            way = abs(run["q"] - run["q"][0]).max()
            size *= abs(run["q"]).max() / way if way > 0 else 1.0
        found[name] = ROOM * steps * max(departure, EPS * size)
    return found


def momentum_limits(system: sc.System, history: sc.History) -> tuple[float, float]:
    """How far the momenta of a free scene may wander by rounding: linear, angular."""
    terms = _terms(system, history)
    unit = ROOM * (len(history) - 1) * EPS
    linear = terms.sum(axis=1).max()
    angular = (abs(history["q"]) * terms).sum(axis=1).max()
    return unit * float(linear), unit * float(angular)


def energy_limit(system: sc.System, history: sc.History) -> float:
    """How far a conserved energy (J) may wander by rounding."""
    power = (abs(history["v"]) * _terms(system, history)).sum(axis=1)
    stored = abs(history["energy"]) + abs(history["external"])
    return ROOM * (len(history) - 1) * EPS * float((power + stored).max())


def _terms(system: sc.System, history: sc.History) -> np.ndarray:
    """Sizes (states, n) of what momenta are differences of: M q / h, and h times forces."""
    h = float(np.diff(history.times).min())
    force = abs(np.nan_to_num(history["constraint_force"]))
    mass = abs(system.mass)
    inertia = np.stack([(mass @ abs(q).reshape(-1, 3)).ravel() for q in history["q"]])
    return abs(history["p"]) + h * force + inertia / h
