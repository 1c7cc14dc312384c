"""What the benchmarks of this folder share: scene, clock, yardstick, tables, command line.

Import it before numpy: it keeps the linear algebra to one thread, and processes may write bytecode
also where the environment forbids it, as those without measure Python's compiler. Times are CPU
times of the process (:func:`time.process_time`): with one thread they are what a clock on the wall
shows on an idle machine, and other programs disturb them less.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: small matrices
os.environ["PYTHONDONTWRITEBYTECODE"] = ""  # of processes that are measured

import argparse
import csv
import json
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))

import record

import skfem_cosserat as sc
from skfem_cosserat.integrators import Stepper
from skfem_cosserat.newton import NewtonSettings

__all__ = ["EXPLICIT", "FAMILIES", "INTEGRATORS", "METHODS", "TREATMENTS", "Run"]
__all__ += ["advance", "chain", "command", "family_of", "full_newton"]
__all__ += ["collected", "environment", "rubber", "table", "tip", "write"]

#: those with compiled kernels of their own
INTEGRATORS = {"energy-momentum": sc.EnergyMomentum, "variational": sc.Variational}


def _composed(part: Callable[[], Any], order: int) -> Any:
    return sc.Composition(part(), order)


#: all of them, by family: one colour each in the charts. (Generalized-alpha with a spectral radius
#: of one is Newmark's rule, which constraints make unstable: the package refuses it.)
FAMILIES: dict[str, dict[str, Callable[[], Any]]] = {
    "energy-momentum": {
        "energy-momentum": sc.EnergyMomentum,
        "energy-momentum stabilized": partial(sc.EnergyMomentum, stabilized=True),
    },
    "variational": {
        "variational": sc.Variational,
        "variational stabilized": partial(sc.Variational, stabilized=True),
    },
    "composition": {
        "variational of order 4": partial(_composed, sc.Variational, 4),
        "variational of order 6": partial(_composed, sc.Variational, 6),
        "energy-momentum of order 4": partial(_composed, sc.EnergyMomentum, 4),
    },
    "generalized-alpha": {
        "generalized-alpha 0": partial(sc.GeneralizedAlpha, 0.0, stabilized=False),
        "generalized-alpha 0.8": partial(sc.GeneralizedAlpha, 0.8, stabilized=False),
        "generalized-alpha 0.95": partial(sc.GeneralizedAlpha, 0.95, stabilized=False),
        "generalized-alpha 0.8 stabilized": partial(sc.GeneralizedAlpha, 0.8),
    },
    "energy-decaying": {
        "energy-decaying 0.05": partial(sc.EnergyDecaying, chi=0.05),
        "energy-decaying 5/s": partial(sc.EnergyDecaying, rate=5.0),
    },
    "explicit": {"explicit": sc.Explicit},
}
METHODS = {name: make for family in FAMILIES.values() for name, make in family.items()}
#: those that damp most what is not resolved
MOST_DISSIPATIVE = ("generalized-alpha 0", "energy-decaying 0.05")
#: those that need nodal masses and multipliers
EXPLICIT = tuple(FAMILIES["explicit"])


def family_of(name: str) -> str:
    """The family of one of METHODS; of another integrator its own name."""
    return next((family for family, names in FAMILIES.items() if name in names), name)


TREATMENTS = {"null-space": sc.NullSpace, "multipliers": sc.Multipliers}
GRAVITY = (0.0, -9.81, 0.5)
LENGTH, RADIUS = 1.0, 5e-3


def rubber() -> sc.Section:
    """A round rod, 1 cm thick."""
    return sc.SectionCircle(radius=RADIUS, material=sc.Material(E=5e6, nu=0.5, rho=1100))


def chain(elements: int, order: int) -> sc.System:
    """A rod on a hinge, drawn out of its plane."""
    model = sc.Model()
    mesh = sc.MeshCurve.init_line((0, 0, 0), (LENGTH, 0, 0), elements, name="rod")
    rod = model.add("rod", sc.Beam(mesh, rubber(), order=order, director=(0, 1, 0)))
    pin = sc.JointRevolute(sc.ground((0, 0, 0)), rod.node("rod.start"), axis=(0, 0, 1))
    model.add("hinge", pin)
    model.add("gravity", sc.LoadGravity(GRAVITY))
    return model.freeze()


def tip(system: sc.System, state: Any) -> np.ndarray:
    """Where the free end of the rod of :func:`chain` is (m)."""
    rod: Any = system.structures[0]
    return sc.View(system, state).position(rod.node("rod.end"))


def full_newton() -> NewtonSettings:
    """Settings with which every iteration has a matrix and a factorisation of its own."""
    return NewtonSettings(reuse=0)


class Run(NamedTuple):
    """A stretch of steps: CPU time, Newton iterations, factorisations, and where it ended."""

    seconds: float
    iterations: int
    factorisations: int
    state: Any


def advance(stepper: Stepper, state: Any, steps: int) -> Run:
    """Solve as many steps from `state` on, without recording anything; in one go where that is one.

    So does :func:`skfem_cosserat.simulate` between recorded states.
    """
    iterations, done, before = 0, 0, stepper.factorisations
    begun = time.process_time()
    while done < steps:
        block = stepper.advance_block(state, steps - done)
        state, done = block.state, done + len(block)
        iterations += int(block.iterations.sum())
    seconds = time.process_time() - begun
    return Run(seconds, iterations, stepper.factorisations - before, state)


def yardstick() -> float:
    """Speed of a matrix product of this run (GF/s)."""
    a = np.random.default_rng(0).standard_normal((600, 600))
    times = []
    for _ in range(7):
        begun = time.process_time()
        a @ a
        times.append(time.process_time() - begun)
    return 2 * 600**3 / median(times) / 1e9


def environment() -> dict[str, Any]:
    """Where the numbers of this run come from, and how fast it is there.

    Which kernels ran is in the rows.
    """
    found = record.main()
    if find_spec("numba") is not None:
        found["versions"] |= {name: version(name) for name in ("numba", "llvmlite")}
    return {"dgemm_gflops": yardstick(), "provenance": found}


def write(path: Path, result: dict[str, Any], columns: Sequence[str]) -> None:
    """The rows as CSV, below lines with ``#`` that say where they were measured."""
    path.parent.mkdir(parents=True, exist_ok=True)
    notes = {**result["provenance"], **result.get("notes", {})}
    with path.open("w", newline="", encoding="utf-8") as file:
        for name, value in notes.items():
            file.write(f"# {name}: {json.dumps(value)}\n")
        file.write(f"# dgemm: {result['dgemm_gflops']:.1f} GF/s\n")
        lines = csv.DictWriter(file, columns, extrasaction="ignore", lineterminator="\n")
        lines.writeheader()
        lines.writerows(result["rows"])


def collected(
    rows: Iterable[dict[str, Any]], path: Path | None, columns: Sequence[str], **more: Any
) -> dict[str, Any]:
    """The rows as they are measured, with where that is: written anew after each.

    An error in a late case loses none of the earlier ones.

    Parameters
    ----------
    rows : iterable of dict
        Each is measured when it is asked for.
    path : path, optional
        File for the table.
    columns : sequence of str
    more
        Further entries of the result.
    """
    result = {"rows": [], **more, **environment()}
    for row in rows:
        result["rows"].append(row)
        if path is not None:
            write(path, result, columns)
    return result


def table(rows: Iterable[dict[str, Any]], columns: Sequence[str]) -> str:
    """The rows as text."""
    cells = [list(columns), *([_text(row.get(name)) for name in columns] for row in rows)]
    widths = [max(len(line[k]) for line in cells) for k in range(len(columns))]
    return "\n".join(
        "  ".join(cell.rjust(width) for cell, width in zip(line, widths, strict=True)).rstrip()
        for line in cells
    )


def _text(value: Any) -> str:
    if value is None:
        return "-"
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _plain(value: Any) -> Any:
    """As JSON has it: there is no NaN."""
    return None if isinstance(value, float) and not np.isfinite(value) else value


def command(
    doc: str | None,
    main: Callable[..., dict[str, Any]],
    report: Callable[[dict[str, Any]], str],
    missed: Callable[[dict[str, Any]], list[str]],
    arguments: Sequence[str] | None = None,
    options: Sequence[str] = (),
) -> int:
    """Run a benchmark from the command line.

    Parameters
    ----------
    doc : str
        Its first line describes the command.
    main, report, missed : callable
        Measure; the result as text; the figures it misses, as text.
    arguments : sequence of str, optional
        Default: those of the process.
    options : sequence of str
        Names of further arguments of `main` that take a folder.

    Returns
    -------
    int
        Exit status: 1 with ``--check`` where a figure is missed.
    """
    parser = argparse.ArgumentParser(description=(doc or "").splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="small scenes, short runs")
    parser.add_argument("--json", help="file for the rows, a list")
    parser.add_argument("--check", action="store_true", help="exit with 1 where a figure is missed")
    parser.add_argument("--out", help="folder for the table, and the chart where there is one")
    for name in options:
        parser.add_argument(f"--{name}", help=f"folder for {name}")
    chosen = parser.parse_args(arguments)
    more = {name: getattr(chosen, name) for name in options}
    result = main(chosen.quick, out=chosen.out, **more)
    print(report(result))
    print(f"dgemm {result['dgemm_gflops']:.1f} GF/s")
    if chosen.json:
        rows = [{k: _plain(value) for k, value in row.items()} for row in result["rows"]]
        Path(chosen.json).write_text(json.dumps(rows, allow_nan=False), encoding="utf-8")
    wrong = missed(result)
    print("\n".join(wrong) if wrong else "no figure is missed")
    return 1 if chosen.check and wrong else 0
