"""Cost of a step against the size of the scene, for chains, trees of joints and lattices.

*chain*: a beam on a hinge, swinging in space. *tree*: beams of 20 elements, the end of one the
hinge of the next, each with a ball on its end. *lattice*: cubes of single elements, clamped at one
face. *swing*: the three-bar swing of the paper, up to 1000 steps of 1e-2 s. Median time of a step
and of an iteration over `repeats` runs, each after two steps to compile and warm up, without
recording anything; compiled kernels where there are some, and the plain ones beside them. One
thread. Writes ``step_cost.csv`` with versions and machine, and the speed of a matrix product in the
same run as a yardstick.

Run ``python examples/benchmarks/step_cost.py --help`` for the choices.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import product
from pathlib import Path
from statistics import median
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
sys.path.insert(0, str(Path(__file__).resolve().parent))

import lattice
import measuring  # before numpy: one thread
import numpy as np
from measuring import INTEGRATORS, TREATMENTS, chain, rubber

import skfem_cosserat as sc
from paper import three_bar_swing
from skfem_cosserat.integrators import Stepper
from skfem_cosserat.integrators.choice import choose_kernels

STEP = 1e-3
#: largest exponent with which the cost of a step may grow with the elements, compiled
EXPONENT = 1.05
#: scenes from this size on are looked at for that
LARGE = 20
COLUMNS = (
    *("scene", "elements", "order", "integrator", "treatment", "kernels", "solver"),
    *("ms_per_step", "ms_per_iteration", "iterations_per_step", "unknowns", "steps"),
)


def tree(elements: int, order: int) -> sc.System:
    """Rods of 20 elements on hinges, one behind the other, each with a ball."""
    model = sc.Model()
    end: Any = sc.ground((0, 0, 0))
    for k in range(max(1, elements // 20)):
        name = f"rod{k}"
        mesh = sc.MeshCurve.init_line((0.2 * k, 0, 0), (0.2 * k + 0.2, 0, 0), 20, name=name)
        rod = model.add(name, sc.Beam(mesh, rubber(), order=order, director=(0, 1, 0)))
        axis = (0, 0, 1) if k % 2 else (0, 1, 0)
        model.add(f"hinge{k}", sc.JointRevolute(end, rod.node(f"{name}.start"), axis=axis))
        end = rod.node(f"{name}.end")
        model.add(f"ball{k}", sc.RigidBody.sphere(0.01, radius=0.01, on=end))
    model.add("gravity", sc.LoadGravity((0, -9.81, 0.5)))
    return model.freeze()


def grid(elements: int, order: int) -> sc.System:
    """A lattice of single-element struts, clamped at one face: the one with about as many."""
    count = 2
    while 3 * count**2 * (count - 1) < 0.7 * elements:
        count += 1
    return lattice.scene(count, 1, order)


def swing(elements: int, order: int) -> sc.System:
    """The three-bar swing of the paper; its mesh has 20 elements."""
    return three_bar_swing.build("published")


SCENES: dict[str, Callable[[int, int], sc.System]] = {
    "chain": chain,
    "tree": tree,
    "lattice": grid,
    "swing": swing,
}
#: scenes whose steps are not those of the others, and how many are made
STEPS = {"swing": (1e-2, 1000), "lattice": (STEP, 40)}  # soft: some struts fold after 0.08 s
#: what a step of the swing may take with the null space at 60 GF/s (ms), and how many times that
#: with multipliers
SWING_MS, SWING_RATIO, SWING_GFLOPS = 0.25, 1.6, 60.0
#: elements of a lattice above which a step takes minutes
LARGEST_LATTICE = 2000


def cases(
    scenes: Sequence[str], orders: Sequence[int], sizes: Sequence[int]
) -> Iterator[tuple[str, int, int]]:
    """Scenes with orders and sizes; the swing and its order are always the same."""
    for scene, order, size in product(scenes, orders, sizes):
        if scene == "swing" and (order, size) != (orders[0], sizes[0]):
            continue
        if scene != "lattice" or size <= LARGEST_LATTICE:
            yield scene, *((1, 20) if scene == "swing" else (order, size))


def measured(
    system: sc.System,
    integrator: Any,
    treatment: Any,
    kernels: str,
    repeats: int,
    budget: float,
    step: float = STEP,
    most: int = 500,
) -> dict[str, Any]:
    """Medians over the repeats; as many steps in each as fit into the budget (s), up to `most`."""
    times, counts, steps = [], [], 0
    for _ in range(repeats):
        stepper = Stepper(system, integrator, treatment, step, kernels=kernels)
        state = sc.initial_state(system)
        for _ in range(2):
            begun = time.perf_counter()
            state = stepper.advance(state).state
        last = time.perf_counter() - begun
        steps = int(np.clip(budget / repeats / last, 3, most))
        run = measuring.advance(stepper, state, steps)
        times.append(run.seconds / steps)
        counts.append(run.iterations / steps)
    return {
        "kernels": stepper.choice.name,
        "solver": stepper.method,
        "ms_per_step": 1e3 * median(times),
        "ms_per_iteration": 1e3 * median(t / c for t, c in zip(times, counts, strict=True)),
        "iterations_per_step": median(counts),
        "unknowns": stepper.bound.unknowns,
        "steps": steps,
    }


def series(
    chosen: Iterable[tuple[str, int, int]], repeats: int, budget: float
) -> Iterator[dict[str, Any]]:
    """A row for each scene, integrator, treatment and kind of kernels."""
    for scene, order, size in chosen:
        system = SCENES[scene](size, order)
        how = repeats, budget, *STEPS.get(scene, (STEP, 500))
        own = sum(len(group.vertices) for group in system.beam_groups)
        for integrator, treatment in product(INTEGRATORS, TREATMENTS):
            pair = INTEGRATORS[integrator](), TREATMENTS[treatment]()
            kinds = ["numpy"] if size <= 2000 else []
            if choose_kernels("auto", system, *pair, 10**9).name == "numba":
                kinds.insert(0, "numba")
            fixed = (scene, own, order, integrator, treatment)
            for kernels in kinds:
                found = measured(system, *pair, kernels, *how)
                yield {**dict(zip(COLUMNS, fixed, strict=False)), **found}


def exponents(rows: Sequence[dict[str, Any]]) -> dict[str, float]:
    """Slopes of log(cost) against log(elements) for each series of large enough scenes."""
    out: dict[str, float] = {}
    keys = ("scene", "order", "integrator", "treatment", "kernels")
    for key in {tuple(r[k] for k in keys) for r in rows}:
        own = [r for r in rows if tuple(r[k] for k in keys) == key and r["elements"] >= LARGE]
        if len(own) > 1:
            x = np.log([r["elements"] for r in own])
            out[" ".join(map(str, key))] = float(
                np.polyfit(x, np.log([r["ms_per_step"] for r in own]), 1)[0]
            )
    return dict(sorted(out.items()))


def main(
    quick: bool = True,
    scenes: Sequence[str] = tuple(SCENES),
    orders: Sequence[int] = (1, 3),
    elements: Sequence[int] | None = None,
    repeats: int = 3,
    out: str | Path | None = None,
) -> dict[str, Any]:
    """Measure.

    Parameters
    ----------
    quick : bool
        Up to 200 elements, otherwise up to 20000 (2000 with plain kernels); less time for each.
    scenes, orders, elements : sequences, optional
        Only these.
    repeats : int
        Runs of which the median is taken.
    out : path, optional
        Folder for step_cost.csv.

    Returns
    -------
    dict
        ``rows``, ``exponents`` of each series of scenes, ``dgemm_gflops`` and where it was
        measured.
    """
    sizes = tuple(elements or ((20, 200) if quick else (20, 200, 2000, 20000)))
    rows = series(cases(scenes, orders, sizes), repeats, 0.3 if quick else 3.0)
    path = None if out is None else Path(out) / "step_cost.csv"
    result = measuring.collected(rows, path, COLUMNS)
    return {**result, "exponents": exponents(result["rows"])}


def missed(result: dict[str, Any]) -> list[str]:
    """What does not come up to the figures."""
    found = [
        f"{name}: the cost of a step grows with exponent {value:.3f}, above {EXPONENT}"
        for name, value in result["exponents"].items()
        if "numba" in name and name.split()[0] in ("chain", "tree") and value > EXPONENT
    ]
    rows = result.get("rows", ())
    if rows and all(r["kernels"] != "numba" for r in rows):
        found.append("compiled kernels, which the figures are about: not measured")
    rows = [r for r in rows if (r["scene"], r["kernels"]) == ("swing", "numba")]
    cost = {(r["integrator"], r["treatment"]): r["ms_per_step"] for r in rows}
    for (integrator, treatment), ms in cost.items():
        most = SWING_MS * SWING_GFLOPS / result["dgemm_gflops"]
        if treatment == "multipliers":
            most = SWING_RATIO * cost[integrator, "null-space"]
        if ms > most:
            found.append(f"swing, {integrator}, {treatment}: {ms:.3f} ms a step, above {most:.3f}")
    return found


def report(result: dict[str, Any]) -> str:
    """The table as text."""
    lines = [
        f"{'scene':8s} {'elements':>8s} {'order':>5s} {'integrator':16s} {'treatment':11s}"
        f" {'kernels':7s} {'ms/step':>10s} {'ms/iter.':>10s} {'iter.':>6s}"
    ]
    for r in result["rows"]:
        lines.append(
            f"{r['scene']:8s} {r['elements']:8d} {r['order']:5d} {r['integrator']:16s}"
            f" {r['treatment']:11s} {r['kernels']:7s} {r['ms_per_step']:10.4f}"
            f" {r['ms_per_iteration']:10.4f} {r['iterations_per_step']:6.2f}"
        )
    lines += [f"exponent {value:6.3f}  {name}" for name, value in result["exponents"].items()]
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(measuring.command(__doc__, main, report, missed))
