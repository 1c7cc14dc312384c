"""Cost of a Newton iteration on lattices against factorisations of the same matrices.

A cube of n x n x n joints, one rubber rod between neighbours, rigidly connected, clamped at one
face, bends by its weight: energy-momentum, null space, h = 1e-3 s. First the package's own choice,
then each sparse solver that is installed, forced: SuperLU of scipy, and Pardiso (pypardiso). Rounds
go through all of them, so that ratios come from the same minute; medians of CPU times. One thread.
Writes ``lattice.csv`` with versions and machine, and the speed of a matrix product.

*ms_per_iteration* is a whole step by its Newton iterations, each with a matrix of its own.
*ms_factorisation* is the numeric factorisation of the matrix that elimination in blocks leaves, by
this solver; *ms_fastest* that of the fastest one; *ms_uncondensed* that of the whole matrix, by
scipy's SuperLU in symmetric mode and minimum degree order, its fastest setting.

Run ``python examples/benchmarks/lattice.py --help`` for the choices.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Sequence
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from statistics import median
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent))
os.environ.setdefault("MKL_NUM_THREADS", "1")

import measuring  # before numpy: one thread
import numpy as np
from measuring import rubber

import skfem_cosserat as sc
from skfem_cosserat.linear import Factors, LinearSolver, Solver

STEP = 1e-3
#: by name, with the package that each needs
SOLVERS: dict[str, tuple[Solver | None, str]] = {
    "own choice": (None, "scipy"),
    "superlu": (sc.SolverSuperLU(), "scipy"),
    "pardiso": (sc.SolverPardiso(), "pypardiso"),
}
#: whose versions go with the numbers
PACKAGES = ("numba", "pypardiso")
#: joints a side and elements a strut
QUICK, FULL = ((6, 1), (5, 4)), ((16, 1), (10, 10))
#: largest ratio of an iteration, by the package's own choice: for struts with one element to the
#: fastest factorisation, with several to scipy's of the uncondensed matrix; of the full lattices
FIGURES = {"ratio_fastest": 1.5, "ratio_uncondensed": 0.6}
COLUMNS = (
    *("joints", "elements_per_strut", "unknowns", "unknowns_left", "kernels", "asked", "solver"),
    *("ms_per_step", "iterations_per_step", "ms_per_iteration", "ms_factorisation"),
    *("ms_fastest", "ms_uncondensed", "ratio_fastest", "ratio_uncondensed", "rounds"),
)


def mesh(count: int, elements: int, size: float = 0.1) -> sc.MeshCurve:
    """Struts along the edges of count - 1 cubes a side; the first count^3 vertices are joints."""
    number = np.arange(count**3).reshape(count, count, count)
    joints = size * np.argwhere(number >= 0)
    pairs = [(number[:-1], number[1:]), (number[:, :-1], number[:, 1:])]
    pairs.append((number[:, :, :-1], number[:, :, 1:]))
    a, b = (np.concatenate([pair[k].ravel() for pair in pairs]) for k in (0, 1))
    s = (np.arange(1, elements) / elements)[:, None]
    inner = joints[a][:, None] * (1 - s) + joints[b][:, None] * s
    between = count**3 + np.arange(inner[..., 0].size).reshape(len(a), elements - 1)
    along = np.column_stack([a, between, b])
    t = np.stack([along[:, :-1].ravel(), along[:, 1:].ravel()])
    return sc.MeshCurve(np.vstack([joints, inner.reshape(-1, 3)]).T, t)


def scene(count: int, elements: int, order: int = 1) -> sc.System:
    """The lattice, clamped at one face."""
    lattice = mesh(count, elements)
    model = sc.Model()
    beam = model.add("lattice", sc.Beam(lattice, rubber(), order=order, director=(0.36, 0.48, 0.8)))
    for k in np.flatnonzero(lattice.p[0, : count**3] == 0):
        clamp = sc.JointFixed(sc.ground(lattice.p[:, k]), beam.node(int(k)))
        model.add(f"clamp {k}", clamp)
    model.add("gravity", sc.LoadGravity((0, -9.81, 0.5)))
    return model.freeze()


class Run:
    """Steps with one solver, and factorisations of the matrix it had last."""

    def __init__(self, system: sc.System, solver: Solver | None, kernels: str) -> None:
        pair = sc.EnergyMomentum(), sc.NullSpace()
        full = measuring.full_newton()  # a factorisation in each iteration
        self.stepper = sc.Stepper(system, *pair, STEP, full, kernels, solver=solver)
        self.state = self.stepper.advance(sc.initial_state(system)).state  # compiles
        self.linear: LinearSolver | None = self.stepper.linear
        self.iterations: list[int] = []
        self.steps: list[float] = []
        self.factorisations: list[float] = []

    def measure(self) -> None:
        """One step, one factorisation."""
        run = measuring.advance(self.stepper, self.state, 1)
        self.state = run.state
        self.steps.append(1e3 * run.seconds)
        self.iterations.append(run.iterations)
        if self.linear is not None:  # else elimination in blocks is all
            self.factorisations.append(factorised(self.linear.factors, self.linear.data))


def factorised(factors: Factors, data: Any) -> float:
    """Time of a numeric factorisation (ms)."""
    begun = time.process_time()
    factors.factor(data)
    return 1e3 * (time.process_time() - begun)


def measured(count: int, elements: int, rounds: int) -> list[dict[str, Any]]:
    """One row for each solver that is installed."""
    system = scene(count, elements)
    kernels = "numpy" if find_spec("numba") is None else "numba"
    here = {name: own for name, (own, package) in SOLVERS.items() if find_spec(package) is not None}
    runs = {name: Run(system, own, kernels) for name, own in here.items()}
    factors, data = uncondensed_matrix(system)
    uncondensed = []
    for _ in range(rounds):
        for run in runs.values():
            run.measure()
        uncondensed.append(factorised(factors, data))
    fastest = min(median(run.factorisations) for run in runs.values() if run.linear is not None)
    rows = []
    for name, run in runs.items():
        left = 0 if run.linear is None else run.linear.n
        alone = median(run.factorisations) if run.factorisations else float("nan")
        each = median(t / k for t, k in zip(run.steps, run.iterations, strict=True))
        values = (
            *(count, elements, system.unknowns, left, kernels, name, run.stepper.method),
            *(median(run.steps), median(run.iterations), each, alone),
            *(fastest, median(uncondensed), each / fastest, each / median(uncondensed), rounds),
        )
        rows.append(dict(zip(COLUMNS, values, strict=True)))
    return rows


def uncondensed_matrix(system: sc.System) -> tuple[Factors, Any]:
    """SuperLU for the whole matrix of the plain kernels, and its entries."""
    linear = Run(system, sc.SolverSuperLU(), "numpy").linear
    assert linear is not None
    return linear.factors, linear.data


def main(
    quick: bool = True,
    lattices: Sequence[tuple[int, int]] | None = None,
    rounds: int = 5,
    out: str | Path | None = None,
) -> dict[str, Any]:
    """Measure.

    Parameters
    ----------
    quick : bool
        Small lattices (6 x 6 x 6 joints; 5 x 5 x 5 and 4 elements a strut), otherwise
        16 x 16 x 16, and 10 x 10 x 10 with 10 elements a strut.
    lattices : sequence of (int, int), optional
        Joints a side and elements a strut, instead.
    rounds : int
        Of which medians are taken.
    out : path, optional
        Folder for lattice.csv.

    Returns
    -------
    dict
        ``rows``, ``figures`` (ratio of the package's own choice on each lattice),
        ``dgemm_gflops`` and where it was measured.
    """
    chosen = lattices or (QUICK if quick else FULL)
    rows = (row for count, elements in chosen for row in measured(count, elements, rounds))
    notes = {"packages": {p: version(p) for p in PACKAGES if find_spec(p) is not None}}
    path = None if out is None else Path(out) / "lattice.csv"
    result = measuring.collected(rows, path, COLUMNS, notes=notes)
    return {**result, "figures": figures(result["rows"])}


def figures(rows: Sequence[dict[str, Any]]) -> dict[str, dict[str, float]]:
    """By lattice: the ratio that its kind of struts is about, of the package's own choice."""
    out: dict[str, dict[str, float]] = {}
    for row in (r for r in rows if r["asked"] == "own choice"):
        kind = "ratio_fastest" if row["elements_per_strut"] == 1 else "ratio_uncondensed"
        out[title(row["joints"], row["elements_per_strut"])] = {kind: row[kind]}
    return out


def title(count: int, elements: int) -> str:
    """Name of a lattice."""
    return f"{count} x {count} x {count} joints, {elements} elements a strut"


def missed(result: dict[str, Any]) -> list[str]:
    """What does not come up to the figures, which are about the full lattices."""
    return [
        f"{name}: an iteration takes {value:.2f} ({kind}), above {FIGURES[kind]}"
        for name in (title(*each) for each in FULL)
        for kind, value in result["figures"].get(name, {}).items()
        if not value <= FIGURES[kind]
    ]


def report(result: dict[str, Any]) -> str:
    """The table as text."""
    lines = [
        f"{'joints':>6s} {'el.':>3s} {'solver':25s} {'unknowns':>9s} {'left':>6s} {'ms/iter.':>9s}"
        f" {'factor.':>8s} {'fastest':>8s} {'uncond.':>8s} {'ratios':>12s}"
    ]
    for r in result["rows"]:
        lines.append(
            f"{r['joints']:6d} {r['elements_per_strut']:3d} {r['solver']:25s} {r['unknowns']:9d}"
            f" {r['unknowns_left']:6d} {r['ms_per_iteration']:9.2f} {r['ms_factorisation']:8.2f}"
            f" {r['ms_fastest']:8.2f} {r['ms_uncondensed']:8.2f} {r['ratio_fastest']:6.2f}"
            f" {r['ratio_uncondensed']:5.2f}"
        )
    wanted = [title(*each) for each in FULL]
    for name, ratios in result["figures"].items():
        note = "" if name in wanted else " (no figure is about this lattice)"
        lines += [f"{name}: {kind} {value:.3f}{note}" for kind, value in ratios.items()]
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(measuring.command(__doc__, main, report, missed))
