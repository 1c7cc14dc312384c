"""Where loads and prescribed motions of a run jump: constraint forces beside it mix both sides."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..history import History
from ..model import System
from ..types import Floats

#: instants at which functions are looked at, and the largest changes that are looked into
LOOKS, MANY = 400, 20
#: of a change: the part that stays in a smaller interval if it is a jump
STAYS = 0.6
#: part of a function's range, and of its size, that is no jump
SMALL, NOISE = 1e-2, 1e-5
#: of the size of what moves, in differences of it
ROUNDING = 1e-14
#: steps that differences of first and of second order in time take
SHORT = 1e-3, 2e-2


def jumps(system: System, history: History) -> Floats:
    """Times (s) at which a load, or velocity or acceleration of prescribed motion, jumps in a run.

    The largest changes between instants of the run are halved down to a small part of a step: a
    jump stays as it is. What comes and goes between two of 400 instants is found if it is declared,
    see :class:`skfem_cosserat.FunctionOfTime`.

    Examples
    --------
    >>> import skfem_cosserat as sc
    >>> model = sc.Model()
    >>> ball = model.add("ball", sc.MassPoint(1.0))
    >>> push = lambda t: 1.0 if t < 0.25 else 0.0
    >>> load = model.add("push", sc.LoadForce(ball.place(), (1.0, 0, 0), push))
    >>> run = sc.simulate(model, sc.EnergyMomentum(), sc.NullSpace(), 0.1, until=1.0)
    >>> jumps(model.freeze(), run).round(4).tolist()
    [0.25]
    """
    h, t = _step(history), history.times
    if len(t) < 2:
        return np.zeros(0)
    times = np.linspace(t[0], t[-1], min(LOOKS, 1 + max(1, int((t[-1] - t[0]) / h))))
    found: list[float] = []
    if not system.loading.constant:
        known = [getattr(time, "kinks", ()) for time in system.loading.times]
        kinks = np.concatenate([np.zeros(0), *known])
        kinks = kinks[(kinks > t[0]) & (kinks < t[-1])]
        beside = np.concatenate([kinks - SHORT[0] * h, kinks + SHORT[0] * h])
        found += _found(system.loading.values, np.union1d(times, beside), SHORT[0] * h)
    if system.moving:
        for order, short in enumerate(SHORT, 1):

            def rate(s: float, order: int = order, d: float = short * h) -> Floats:
                rows = [system.ground(s - k * d).ravel() for k in range(order + 1)]
                return np.asarray(np.diff(rows[::-1], order, axis=0)[0] / d**order)

            rounding = ROUNDING * abs(system.ground(t[-1])).max() / (short * h) ** order
            found += _found(rate, times[times > t[0] + 3 * short * h], 10 * short * h, rounding)
    return np.unique(found)


def at_jumps(system: System, history: History) -> Floats:
    """One for each recorded state within a step of a jump, zero for all others (N,)."""
    apart = abs(history.times[:, None] - jumps(system, history))
    return (apart <= _step(history) * (1 + 1e-9)).any(axis=1).astype(float)


def _step(history: History) -> float:
    """Longest step (s)."""
    if "step_size" in history and np.isfinite(history["step_size"]).any():
        return float(np.nanmax(history["step_size"]))
    return float(history.meta["step"])


def _found(
    function: Callable[[float], Floats], times: Floats, width: float, rounding: float = 0.0
) -> list[float]:
    """Times, to a width (s), at which a component of a function (k,) jumps."""
    values = np.array([function(t) for t in times.tolist()])
    changes = abs(np.diff(values, axis=0))
    least = np.maximum(SMALL * np.ptp(values, axis=0), NOISE * abs(values).max(axis=0))
    least = np.maximum(least, rounding)
    share = np.divide(changes, least, out=np.zeros_like(changes), where=least > 0)
    out = []
    for k in np.argsort(-share.max(axis=1))[:MANY]:
        c = int(share[k].argmax())
        if not share[k, c] > 1:
            break
        (a, b), (u, w), whole = times[k : k + 2].tolist(), values[k : k + 2, c], changes[k, c]
        while b - a > width and abs(w - u) > STAYS * whole:
            middle = (a + b) / 2
            x = function(middle)[c]
            left = abs(x - u) >= abs(w - x)
            (a, b), (u, w) = ((a, middle), (u, x)) if left else ((middle, b), (x, w))
        if abs(w - u) > STAYS * whole:
            out.append((a + b) / 2)
    return out
