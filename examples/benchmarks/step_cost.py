"""Cost of a step against the size of the scene, for chains and trees of joints.

*chain*: a beam on a hinge, swinging in space. *tree*: beams of 20 elements, the end of one the
hinge of the next, each with a ball on its end. Median time of a step and of an iteration over
`repeats` runs, each after two steps to compile and warm up, without recording anything; compiled
kernels where there are some, and the plain ones beside them. One thread. Writes ``step_cost.csv``
with versions and machine, and the speed of a matrix product in the same run as a yardstick.

Run ``python examples/benchmarks/step_cost.py --help`` for the choices.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: small matrices

import argparse
import csv
import json
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import paper_record

import skfem_cosserat as sc
from skfem_cosserat.integrators import Stepper
from skfem_cosserat.integrators.fast import refusal

INTEGRATORS = {"energy-momentum": sc.EnergyMomentum, "variational": sc.Variational}
TREATMENTS = {"null-space": sc.NullSpace, "multipliers": sc.Multipliers}
STEP = 1e-3
#: largest exponent with which the cost of a step may grow with the elements, compiled
EXPONENT = 1.05
#: scenes below which the work of single elements is not what a step costs
LARGE = 200
COLUMNS = (
    *("scene", "elements", "order", "integrator", "treatment", "kernels", "solver"),
    *("ms_per_step", "ms_per_iteration", "iterations_per_step", "unknowns", "steps"),
)


def rubber() -> sc.Section:
    """A round rod, 1 cm thick."""
    return sc.SectionCircle(radius=5e-3, material=sc.Material(E=5e6, nu=0.5, rho=1100))


def chain(elements: int, order: int) -> sc.System:
    """A rod on a hinge, drawn out of its plane."""
    model = sc.Model()
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), elements, name="rod")
    rod = model.add("rod", sc.Beam(mesh, rubber(), order=order, director=(0, 1, 0)))
    pin = sc.JointRevolute(sc.ground((0, 0, 0)), rod.node("rod.start"), axis=(0, 0, 1))
    model.add("hinge", pin)
    model.add("gravity", sc.LoadGravity((0, -9.81, 0.5)))
    return model.freeze()


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


SCENES: dict[str, Callable[[int, int], sc.System]] = {"chain": chain, "tree": tree}


def measured(
    system: sc.System, integrator: Any, treatment: Any, kernels: str, repeats: int, budget: float
) -> dict[str, Any]:
    """Medians over the repeats; as many steps in each as fit into the budget (s)."""
    times, counts, steps = [], [], 0
    for _ in range(repeats):
        stepper = Stepper(system, integrator, treatment, STEP, kernels=kernels)
        state = sc.initial_state(system)
        begun = time.perf_counter()
        for _ in range(2):
            begun = time.perf_counter()
            state = stepper.advance(state).state
        last = time.perf_counter() - begun
        steps = int(np.clip(budget / repeats / last, 3, 500))
        iterations = 0
        begun = time.perf_counter()
        for _ in range(steps):
            report = stepper.advance(state)
            state, iterations = report.state, iterations + report.iterations
        times.append((time.perf_counter() - begun) / steps)
        counts.append(iterations / steps)
    return {
        "kernels": stepper.choice.name,
        "solver": stepper.method,
        "ms_per_step": 1e3 * median(times),
        "ms_per_iteration": 1e3 * median(t / c for t, c in zip(times, counts, strict=True)),
        "iterations_per_step": median(counts),
        "unknowns": stepper.bound.unknowns,
        "steps": steps,
    }


def yardstick() -> float:
    """Speed of a matrix product of this run (GF/s)."""
    a = np.random.default_rng(0).standard_normal((600, 600))
    times = []
    for _ in range(7):
        begun = time.perf_counter()
        a @ a
        times.append(time.perf_counter() - begun)
    return 2 * 600**3 / median(times) / 1e9


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
        ``rows``, ``exponents`` of each series of scenes with 200 elements or more, ``dgemm_gflops``
        and where it was measured.
    """
    sizes = tuple(elements or ((20, 200) if quick else (20, 200, 2000, 20000)))
    rows: list[dict[str, Any]] = []
    for scene in scenes:
        for order in orders:
            for size in sizes:
                system = SCENES[scene](size, order)
                for name, make in INTEGRATORS.items():
                    for treatment, constraints in TREATMENTS.items():
                        pair = make(), constraints()
                        kinds = ["numpy"] if size <= 2000 else []
                        if refusal(system, *pair) is None:
                            kinds.insert(0, "numba")
                        for kernels in kinds:
                            found = measured(system, *pair, kernels, repeats, 0.3 if quick else 3.0)
                            fixed = (scene, size, order, name, treatment)
                            rows.append({**dict(zip(COLUMNS, fixed, strict=False)), **found})
    result = {
        "rows": rows,
        "exponents": exponents(rows),
        "dgemm_gflops": yardstick(),
        "provenance": paper_record.main(),
    }
    if out is not None:
        write(result, Path(out))
    return result


def write(result: dict[str, Any], folder: Path) -> None:
    """The table, with what it was measured on."""
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / "step_cost.csv").open("w", newline="", encoding="utf-8") as file:
        for name, value in result["provenance"].items():
            file.write(f"# {name}: {json.dumps(value)}\n")
        file.write(f"# dgemm: {result['dgemm_gflops']:.1f} GF/s\n")
        table = csv.DictWriter(file, COLUMNS)
        table.writeheader()
        table.writerows(result["rows"])


def missed(result: dict[str, Any]) -> list[str]:
    """What does not come up to the figures."""
    return [
        f"{name}: the cost of a step grows with exponent {value:.3f}, above {EXPONENT}"
        for name, value in result["exponents"].items()
        if "numba" in name and value > EXPONENT
    ]


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
    lines.append(f"dgemm {result['dgemm_gflops']:.1f} GF/s")
    return "\n".join(lines)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="up to 200 elements")
    parser.add_argument("--json", help="file for the rows")
    parser.add_argument("--check", action="store_true", help="exit with 1 where a figure is missed")
    parser.add_argument("--out", help="folder for step_cost.csv")
    arguments = parser.parse_args()
    answer = main(arguments.quick, out=arguments.out)
    print(report(answer))
    if arguments.json:
        Path(arguments.json).write_text(json.dumps(answer["rows"]), encoding="utf-8")
    wrong = missed(answer)
    print("\n".join(wrong))
    if arguments.check and wrong:
        sys.exit(1)
