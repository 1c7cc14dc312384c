"""What a step with compiled kernels is made of, part by part, and the floor the machine sets.

The rod of ``versus_peers.py``, linear elements, null space, h = 1e-3 s. Each compiled part is
called over and over in the state in the middle of a step, so that its own arrays are in the cache
as far as they fit; how often a step calls it comes from the iterations and factorisations of the
run. What is left of the step: waiting for memory when one part follows the other, loads, copies of
the state, Python. *floor*: to move the bytes that an iteration with kept factors has to read and
write, every array once, at the speed with which this process copies as many.

Run ``python examples/benchmarks/step_profile.py --help`` for the choices.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent))

import measuring  # before numpy: one thread
import numpy as np
from measuring import INTEGRATORS

import skfem_cosserat as sc
from skfem_cosserat.integrators import Stepper
from skfem_cosserat.integrators.scheme import StepOrigin

STEP = 1e-3
WARM, STEPS = 20, 100
COLUMNS = (
    *("elements", "integrator", "part", "us_per_call", "calls_per_step", "us_per_step", "share"),
)
#: parts that an iteration calls, in their order; those of a matrix only; those of a step
ITERATION = ("move", "joint_add", "joint_move", "beam_force", "balance", "joint_maps")
ITERATION += ("joint_reduce", "sweep", "cap")
MATRIX = ("clear", "beam_tangent", "nodal_mass_matrix", "node_matrix", "factor")
ONCE = ("beam_start", "better", "finish")


def caller(beam: bool) -> Callable[..., None]:
    """Calls a part some times, from compiled code."""
    import numba

    from skfem_cosserat.compiled.jit import call, call_beams

    def tree_part(p: int, s: Any, m: Any, w: Any, numbers: Any, flag: int, count: int) -> None:
        for _ in range(count):
            call(p, s, m, w, numbers, flag)

    def beam_part(p: int, g: Any, w: Any, numbers: Any, flag: int, count: int) -> None:
        for _ in range(count):
            call_beams(p, g, w, numbers, flag)

    made: Callable[..., None] = numba.njit(beam_part if beam else tree_part)
    return made


def factors() -> Callable[..., None]:
    """Calls the factorisation some times, each time of the same matrix A, or only copies that."""
    import numba

    from skfem_cosserat.compiled.jit import call

    def copied(A: Any, p: int, s: Any, m: Any, w: Any, numbers: Any, count: int) -> None:
        given, target = A.ravel(), w.A.ravel()
        for _ in range(count):
            for k in range(len(given)):
                target[k] = given[k]
            if p:
                call(p, s, m, w, numbers, 0)

    made: Callable[..., None] = numba.njit(copied)
    return made


def seconds(call: Callable[[int], object], count: int, repeats: int = 9) -> float:
    """The fastest of some repetitions of `count` calls, for one call."""
    call(1)
    best = np.inf
    for _ in range(repeats):
        begun = time.process_time()
        call(count)
        best = min(best, (time.process_time() - begun) / count)
    return float(best)


def profile(elements: int, integrator: str) -> list[dict[str, Any]]:
    """Rows of one mesh and integrator: its parts, what is left of a step, and the floor."""
    from skfem_cosserat.compiled.numbers import BEAM_PARTS, TREE_PARTS

    system = measuring.chain(elements, 1)
    own = INTEGRATORS[integrator](), sc.NullSpace(), STEP
    stepper = Stepper(system, *own, kernels="numba")
    run = measuring.advance(stepper, sc.initial_state(system), WARM)
    run = measuring.advance(stepper, run.state, STEPS)
    whole = 1e6 * run.seconds / STEPS
    calls = dict.fromkeys(ITERATION, run.iterations / STEPS)
    calls |= dict.fromkeys(MATRIX, run.factorisations / STEPS) | dict.fromkeys(ONCE, 1.0)

    fast = stepper._fast  # the parts are no interface of the package
    assert fast is not None
    times = np.array([run.state.time + STEP])
    fast.advance(run.state, times, StepOrigin(fast.integrator.name, STEP))
    places, s, m, w, g, numbers = fast._all
    tree, beam, factor = caller(beam=False), caller(beam=True), factors()
    for name in ("clear", "beam_tangent", "nodal_mass_matrix", "node_matrix"):
        k = (*TREE_PARTS, *BEAM_PARTS).index(name)
        if places[k] and name in BEAM_PARTS:
            beam(places[k], g, w, numbers, 0, 1)
        elif places[k]:
            tree(places[k], s, m, w, numbers, 0, 1)
    A = fast._a.A.copy()
    count = max(3, 20_000 // elements)
    rows = []
    for k, name in enumerate((*TREE_PARTS, *BEAM_PARTS)):
        if not places[k] or name not in calls:
            continue
        flag = int(name == "sweep")  # with kept factors
        if name in BEAM_PARTS:
            cost = seconds(lambda n, k=k, flag=flag: beam(places[k], g, w, numbers, flag, n), count)
        elif name == "factor":  # it overwrites the matrix
            both, copies = (
                seconds(lambda n, p=p: factor(A, p, s, m, w, numbers, n), count)
                for p in (places[k], 0)
            )
            cost = both - copies
        else:
            cost = seconds(
                lambda n, k=k, flag=flag: tree(places[k], s, m, w, numbers, flag, n), count
            )
        rows.append((name, 1e6 * cost, calls[name]))
    known = sum(cost * often for _, cost, often in rows)
    rows.append(("the rest: memory, loads, Python", whole - known, 1.0))
    rows.append(("floor of the iterations", 1e6 * floor(elements), run.iterations / STEPS))
    rows.append(("whole step", whole, 1.0))
    return [
        {
            "elements": elements,
            "integrator": integrator,
            "part": name,
            "us_per_call": cost,
            "calls_per_step": often,
            "us_per_step": cost * often,
            "share": cost * often / whole,
        }
        for name, cost, often in rows
    ]


def floor(elements: int) -> float:
    """Least time (s) of an iteration with kept factors: to move its bytes."""
    # of a vertex: inverse and the blocks of its neighbours; configurations at start, end and mid;
    # forces, momenta, stresses before and after; increment and right-hand side
    numbers = (elements + 1) * (3 * 36 + 3 * 12 + 5 * 12 + 2 * 6 + 4 * 6)
    source = np.ones(numbers)
    target = np.zeros_like(source)

    def copy(count: int) -> None:
        for _ in range(count):
            np.copyto(target, source)

    return seconds(copy, max(3, 10**7 // numbers)) / 2  # a copy reads and writes


def main(
    quick: bool = True, elements: Sequence[int] | None = None, out: str | Path | None = None
) -> dict[str, Any]:
    """Measure.

    Parameters
    ----------
    quick : bool
        20 and 200 elements, otherwise 2000, too.
    elements : sequence of int, optional
        These instead.
    out : path, optional
        Folder for step_profile.csv.

    Returns
    -------
    dict
        ``rows``, ``dgemm_gflops`` and where it was measured.
    """
    sizes = tuple(elements or ((20, 200) if quick else (20, 200, 2000)))
    rows = (row for n in sizes for name in INTEGRATORS for row in profile(n, name))
    path = None if out is None else Path(out) / "step_profile.csv"
    return measuring.collected(rows, path, COLUMNS)


def missed(result: dict[str, Any]) -> list[str]:
    """Nothing is required of it."""
    return []


def report(result: dict[str, Any]) -> str:
    """The rows as text."""
    return measuring.table(result["rows"], COLUMNS)


if __name__ == "__main__":
    sys.exit(measuring.command(__doc__, main, report, missed))
