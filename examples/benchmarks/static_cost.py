"""Cost of a Newton iteration to an equilibrium, with plain and compiled kernels.

A clamped rod of linear elements is bent to a quarter circle by an end moment, and by an end force
across it, in steps of the load factor. ``ms_per_iteration`` is what solving the points takes,
``ms_per_iteration_all`` a whole :func:`skfem_cosserat.static` with the scene bound, every point
recorded and its stability looked at. CPU time, median over `repeats` runs after one to compile and
warm up. The figure for 100 elements is two fifths of what xara takes, 0.75 ms where a product of
matrices runs at 60 GF/s, scaled by the speed of one in the same run.

Run ``python examples/benchmarks/static_cost.py --help`` for the choices.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Sequence
from itertools import product
from pathlib import Path
from statistics import median
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent))

import measuring
import numpy as np

import skfem_cosserat as sc
from skfem_cosserat.integrators.choice import choose
from skfem_cosserat.statics.control import Functional, Point
from skfem_cosserat.statics.path import STATIC
from skfem_cosserat.statics.problem import PathSolver, Schedule

#: xara's iteration with 100 elements (ms), at that speed of a matrix product (GF/s), and the share
#: of it that is wanted
PEER, PEER_SPEED, SHARE = 0.75, 60.0, 0.4
STEPS = 8
LENGTH, EI, EA = 10.0, 100.0, 1e4
COLUMNS = (
    *("scene", "elements", "order", "kernels", "solver", "ms_per_iteration"),
    *("ms_per_iteration_all", "iterations", "points", "unknowns"),
)


def moment(model: sc.Model, end: Any) -> None:
    """Bends the rod to a quarter circle."""
    model.add("moment", sc.LoadMoment(end, (0, 0, 0.5 * np.pi * EI / LENGTH)))


def force(model: sc.Model, end: Any) -> None:
    """Bends the rod about as far, and out of its plane."""
    model.add("force", sc.LoadForce(end, (0, 5.0 * EI / LENGTH**2, EI / LENGTH**2)))


LOADS: dict[str, Callable[[sc.Model, Any], None]] = {"moment": moment, "force": force}


def cantilever(elements: int, order: int, load: str) -> sc.System:
    """A clamped rod with a load at its end."""
    section = sc.Section.from_constants(
        EA=EA, GA=EA, EI=(EI, EI), GJ=EI, mass=1.0, inertia=(1.0, 1.0)
    )
    model = sc.Model()
    mesh = sc.MeshCurve.init_line((0, 0, 0), (LENGTH, 0, 0), elements, name="rod")
    rod = model.add("rod", sc.Beam(mesh, section, order=order))
    model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), rod.node("rod.start")))
    LOADS[load](model, rod.node("rod.end"))
    return model.freeze()


def points(system: sc.System, kernels: str) -> tuple[float, int, PathSolver]:
    """Time and iterations to solve the points of a path, nothing else."""
    choice = choose(kernels, system.joint_coordinates, None, 0.0)
    solver = PathSolver(system, sc.NullSpace(), Schedule(system), STATIC, choice)
    point = Point(system.extend(system.q0, 0.0), 0.0)
    begun = time.process_time()
    for _ in range(STEPS):
        solution, report = solver.solve(point, Functional(None, 1.0, 1.0 / STEPS))
        if solution is None:
            raise RuntimeError(report.reason)
        point = solution.point
    return time.process_time() - begun, solver.iterations, solver


def measured(system: sc.System, kernels: str, repeats: int) -> dict[str, Any]:
    """Medians over the repeats."""
    control = sc.LoadControl(steps=STEPS)
    alone, whole = [], []
    for k in range(repeats + 1):
        seconds, iterations, solver = points(system, kernels)
        begun = time.process_time()
        path = sc.static(system, control=control, kernels=kernels, derive=False)
        if k:  # the first one compiles
            alone.append(seconds / iterations)
            whole.append((time.process_time() - begun) / sum(path["newton_iterations"]))
    return {
        "kernels": kernels,
        "solver": solver.method,
        "ms_per_iteration": 1e3 * median(alone),
        "ms_per_iteration_all": 1e3 * median(whole),
        "iterations": iterations,
        "points": STEPS,
        "unknowns": system.unknowns,
    }


def main(
    quick: bool = True,
    out: str | Path | None = None,
    *,
    loads: Sequence[str] = tuple(LOADS),
    elements: Sequence[int] | None = None,
    repeats: int | None = None,
) -> dict[str, Any]:
    """Measure.

    Parameters
    ----------
    quick : bool
        10 and 100 elements, otherwise 1000 as well; fewer repeats.
    out : path, optional
        Folder for static_cost.csv.
    loads, elements : sequences, optional
        Only these.
    repeats : int, optional
        Runs of which the median is taken.

    Returns
    -------
    dict
        ``rows``, ``dgemm_gflops`` and where it was measured.
    """
    sizes = elements or ((10, 100) if quick else (10, 100, 1000))
    runs = repeats or (5 if quick else 15)
    path = None if out is None else Path(out) / "static_cost.csv"
    return measuring.collected(series(loads, sizes, runs), path, COLUMNS)


def series(loads: Sequence[str], sizes: Sequence[int], repeats: int) -> Iterator[dict[str, Any]]:
    """A row for each load, size and kind of kernels."""
    for load, size in product(loads, sizes):
        system = cantilever(size, 1, load)
        for kernels in ("numpy", "numba"):
            fixed = {"scene": load, "elements": size, "order": 1}
            yield {**fixed, **measured(system, kernels, repeats)}


def figure(result: dict[str, Any]) -> float:
    """Most that an iteration with 100 elements may take here (ms)."""
    return SHARE * PEER * PEER_SPEED / float(result["dgemm_gflops"])


def missed(result: dict[str, Any]) -> list[str]:
    """What does not come up to the figure."""
    most = figure(result)
    return [
        f"{r['scene']}: {r['ms_per_iteration']:.3f} ms an iteration with 100 elements, above"
        f" {most:.3f}"
        for r in result["rows"]
        if r["elements"] == 100 and r["kernels"] == "numba" and r["ms_per_iteration"] > most
    ]


def report(result: dict[str, Any]) -> str:
    """The table as text."""
    table = measuring.table(result["rows"], COLUMNS)
    return f"{table}\nfigure for 100 elements, compiled: {figure(result):.3f} ms an iteration"


if __name__ == "__main__":
    sys.exit(measuring.command(__doc__, main, report, missed))
