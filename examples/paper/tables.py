"""Tables 1 and 2 of the paper: unknowns, condition numbers, and what a step costs.

Condition numbers come from the examples' own ``condition_number``. Costs are ratios of processor
time, from short runs of all variants one after the other, repeated; the median of the ratios of a
round is given, with the smallest and largest. Each is measured with three linear solvers, for they
tell different stories: dense factorisation, banded after a reordering (the package's own choice
here), and general sparse.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import skfem_cosserat as sc
from paper import relative_coordinates, six_body_linkage
from paper import three_bar_swing as swing

STEPS = (1e-2, 1e-3, 1e-4)
INTEGRATORS = ("energy-momentum", "variational")
TREATMENTS = ("multipliers", "null-space")
PAIRS = tuple((i, t) for i in INTEGRATORS for t in TREATMENTS)
BASE = ("variational", "null-space")  # its cost is 1
RELATIVE = ("variational", "relative coordinates")
#: what the tables say: unknowns, cost, condition numbers for STEPS
TABLE_1 = {
    ("energy-momentum", "multipliers"): (143, 2.0, (1e5, 1e8, 1e11)),
    ("energy-momentum", "null-space"): (1, 2.0, (1.0, 1.0, 1.0)),
    ("variational", "multipliers"): (143, 1.0, (5e4, 3e7, 3e10)),
    ("variational", "null-space"): (1, 1.0, (1.0, 1.0, 1.0)),
}
TABLE_2 = {
    ("energy-momentum", "multipliers"): (430, 1.5, (2e12, 2e14, 2e17)),
    ("energy-momentum", "null-space"): (122, 1.2, (4e4, 9e4, 2e5)),
    ("variational", "multipliers"): (430, 1.4, (6e11, 5e13, 5e16)),
    ("variational", "null-space"): (122, 1.0, (5e4, 9e4, 2e5)),
}
#: n and independent constraints, of the captions
COUNTS_1, COUNTS_2 = (72, 71), (276, 154)

#: by the names of the tables; SuperLU with the columns ordered by COLAMD, as in the papers' time
SOLVERS = {
    "dense": sc.SolverDense(),
    "own choice": None,
    "sparse": sc.SolverSuperLU(symmetric=False),
}
TIMED_STEPS = 50
ROUNDS = {True: 3, False: 15}  # quick or not

Work = Callable[[], None]


def paired_times(variants: dict[Any, Callable[[], Work]], rounds: int) -> dict[Any, list[float]]:
    """Processor time (s) of each variant in each round, after a round that is not counted.

    Parameters
    ----------
    variants : dict of callable
        Each prepares a run (not timed) and returns it.
    rounds : int
        How often all of them run, one after the other: what else the machine does hits all alike.
    """
    seconds: dict[Any, list[float]] = {key: [] for key in variants}
    for _ in range(rounds + 1):
        for key, prepare in variants.items():
            work = prepare()
            start = time.process_time()
            work()
            seconds[key].append(time.process_time() - start)
    return {key: values[1:] for key, values in seconds.items()}


def _stepping(
    system: sc.System, pair: tuple[str, str], step: float, count: int, solver: str
) -> Callable[[], Work]:
    """Runs of `count` steps from the start, with one linear solver."""

    def prepare() -> Work:
        integrator, treatment = pair
        stepper = sc.Stepper(
            system,
            swing.INTEGRATORS[integrator](),
            swing.TREATMENTS[treatment](),
            step,
            solver=SOLVERS[solver],
        )

        def work() -> None:
            state = sc.initial_state(system)
            for _ in range(count):
                state = stepper.advance(state).state

        return work

    return prepare


def _relative_stepping(step: float, count: int) -> Callable[[], Work]:
    def prepare() -> Work:
        stepper = relative_coordinates.Stepper(step)

        def work() -> None:
            for _ in range(count):
                stepper.advance()

        return work

    return prepare


def costs(
    system: sc.System, step: float, count: int, rounds: int, solver: str, relative: bool = False
) -> dict[tuple[str, str], dict[str, float]]:
    """Cost of a step with each pair, and with relative coordinates on request.

    Returns
    -------
    dict
        By (integrator, treatment): ``ratio`` to variational with the null space (median over the
        rounds), its smallest and largest value ``low`` and ``high``, and ``milliseconds`` a step.
    """
    variants = {pair: _stepping(system, pair, step, count, solver) for pair in PAIRS}
    if relative:
        variants[RELATIVE] = _relative_stepping(step, count)
    seconds = {key: np.array(s) for key, s in paired_times(variants, rounds).items()}
    ratios = {key: s / seconds[BASE] for key, s in seconds.items()}
    return {
        key: {
            "ratio": float(np.median(ratios[key])),
            "low": float(ratios[key].min()),
            "high": float(ratios[key].max()),
            "milliseconds": float(np.median(s) / count * 1e3),
        }
        for key, s in seconds.items()
    }


def own_choice(system: sc.System) -> dict[tuple[str, str], str]:
    """Which linear solver the package takes for each pair."""
    return {
        (i, t): sc.Stepper(
            system, swing.INTEGRATORS[i](), swing.TREATMENTS[t](), 1e-2
        ).bound.solver.method
        for i, t in PAIRS
    }


def condition_numbers(
    example: Any, steps: Sequence[float] = STEPS
) -> dict[tuple[str, str], dict[float, dict[str, float]]]:
    """Medians by pair and step: ``unscaled``, and ``scaled`` with multipliers."""
    return {
        (i, t): {
            h: {
                name: example.condition_number(i, t, h, scaled)
                for name, scaled in (("unscaled", False), ("scaled", True))
                if t == "multipliers" or not scaled
            }
            for h in steps
        }
        for i, t in PAIRS
    }


def slopes(values: Sequence[float]) -> list[float]:
    """Exponents s of the growth with h^s between neighbours of STEPS."""
    return [
        float(np.log(b / a) / np.log(k / h))
        for (h, k), (a, b) in zip(pairwise(STEPS), pairwise(values), strict=True)
    ]


def unscaled(condition: dict[float, dict[str, float]]) -> list[float]:
    """In the order of STEPS."""
    return [condition[h]["unscaled"] for h in STEPS]


def _all_costs(
    system: sc.System, steps: tuple[float, ...], count: int, rounds: int, relative: bool
) -> dict[str, Any]:
    """Costs by solver and step."""
    return {
        solver: {h: costs(system, h, count, rounds, solver, relative) for h in steps}
        for solver in ("dense", "own choice", "sparse")
    }


def relative_accuracy(
    steps: tuple[float, ...] = (1e-2, 5e-3), until: float = 2.0
) -> dict[str, Any]:
    """Error (m) of the comparison's P3 against its reference by step, order, and Richardson's."""
    place = {h: relative_coordinates.main(h, until)["P3"] for h in steps}
    times = [t for t in relative_coordinates.REFERENCE if t <= until]
    exact = np.array([relative_coordinates.REFERENCE[t] for t in times])
    found = {h: place[h][[round(t / h) for t in times]] for h in steps}
    errors = {h: float(abs(found[h] - exact).max()) for h in steps}
    coarse, fine = steps[-2:]
    better = (4 * found[fine] - found[coarse]) / 3
    return {
        "errors": errors,
        "order": float(np.log2(errors[coarse] / errors[fine])),
        "richardson": float(abs(better - exact).max()),
    }


def table_1(quick: bool = True) -> dict[str, Any]:
    """The six-body linkage, and the same one in relative coordinates."""
    system = six_body_linkage.build()
    runs = {pair: six_body_linkage.main(*pair, until=0.05) for pair in PAIRS}
    first = runs[BASE]
    condition = condition_numbers(six_body_linkage)
    other = relative_coordinates.main(until=0.05)
    condition[RELATIVE] = {
        h: {
            "unscaled": relative_coordinates.condition_number(h),
            "scaled": relative_coordinates.condition_number(h, scaled=True),
        }
        for h in STEPS
    }
    return {
        "n": first["n"],
        "rows": first["m_rows"],
        "rank": first["rank"],
        "unknowns": {pair: run["unknowns"] for pair, run in runs.items()}
        | {RELATIVE: other["unknowns"]},
        "condition": condition,
        "slopes": {
            pair: slopes(unscaled(c)) for pair, c in condition.items() if pair[1] != "null-space"
        },
        "cpu": _all_costs(system, (1e-2,), TIMED_STEPS, ROUNDS[quick], relative=True),
        "solvers": own_choice(system),
        "relative accuracy": relative_accuracy(),
    }


def table_2(quick: bool = True) -> dict[str, Any]:
    """The three-bar swing."""
    system = swing.build()
    runs = {pair: swing.main(*pair, until=0.05) for pair in PAIRS}
    first = runs[BASE]
    steps = STEPS[:1] if quick else STEPS
    condition = condition_numbers(swing)
    return {
        "n": first["n"],
        "m": first["m"],
        "unknowns": {pair: run["unknowns"] for pair, run in runs.items()},
        "condition": condition,
        "slopes": {pair: slopes(unscaled(c)) for pair, c in condition.items()},
        "cpu": _all_costs(system, steps, TIMED_STEPS, ROUNDS[quick], relative=False),
        "solvers": own_choice(system),
    }


def main(quick: bool = True) -> dict[str, Any]:
    """Both tables.

    Parameters
    ----------
    quick : bool
        Fewer rounds of timing, and one step size only.
    """
    return {"table 1": table_1(quick), "table 2": table_2(quick)}
