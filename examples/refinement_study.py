"""How far to trust a mesh and a step: refinement studies of a bend and of a swinging rod.

The 45-degree bend in statics, elements of order 1 to 4: orders 2p at its tip, and the error of each
mesh. Then a rubber rod with a ball, let go from the horizontal, with finer and finer steps: once
under gravity that is there at once, which leaves no order to observe, and once under gravity that
grows within 0.1 s.

Needs matplotlib for the charts. ``--folder`` keeps the result of each level: a study that was
stopped goes on there.
"""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import skfem_cosserat as sc

#: meshes of the bend by order: coarse enough to stay above rounding
MESHES = {1: (16, 32, 64, 128), 2: (8, 16, 32, 64), 3: (4, 8, 12, 16), 4: (6, 8, 12, 16)}
STEPS = (2e-3, 1e-3, 5e-4, 2.5e-4)
#: (s): gravity grows as long, the rod falls as long
GROWS, UNTIL = 0.1, 0.2


def bend(elements: int, order: int) -> sc.History:
    """An eighth of a circle of radius 100, unit square, clamped; 600 out of its plane."""
    mesh = sc.MeshCurve.init_arc(
        (0, 0, 0), (1, 0, 0), (0, 1, 0), 100.0, np.pi / 4, elements, name="rod"
    )
    E, G = 1e7, 5e6
    section = sc.Section.from_constants(
        EA=E, GA=G, EI=(E / 12, E / 12), GJ=G / 6, mass=1.0, inertia=(1.0, 1.0)
    )
    model = sc.Model()
    rod = model.add("rod", sc.Beam(mesh, section, order=order, director=(0, 0, 1)))
    model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), rod.node("rod.start")))
    model.add("force", sc.LoadForce(rod.node("rod.end"), (0, 0, 600.0)))
    path = sc.static(model, control=sc.LoadControl(steps=2), watch=False)
    path.add_series("tip", path.position(rod.node("rod.end")))
    return path


def growing(time: float) -> float:
    """From 0 to 1, smooth twice."""
    x = min(time / GROWS, 1.0)
    return x**3 * (10 - 15 * x + 6 * x**2)


def swing(step: float, sudden: bool) -> sc.History:
    """A rubber rod of 1 m on a hinge, with a ball of 50 g: four elements of order 2."""
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 4, name="rod")
    rubber = sc.SectionCircle(radius=5e-3, material=sc.Material(E=5e6, nu=0.5, rho=1100))
    model = sc.Model()
    rod = model.add("rod", sc.Beam(mesh, rubber, order=2, director=(0, 1, 0)))
    hinge = sc.JointRevolute(sc.ground((0, 0, 0)), rod.node("rod.start"), axis=(0, 0, 1))
    model.add("hinge", hinge)
    model.add("ball", sc.RigidBody.sphere(0.05, radius=0.02, on=rod.node("rod.end")))
    when = 1.0 if sudden else sc.FunctionOfTime(growing, kinks=(GROWS,))
    model.add("gravity", sc.LoadGravity((0, -9.81, 0), when))
    scheme = sc.EnergyMomentum(), sc.NullSpace()
    every = round(0.02 / step)  # the same instants at all steps
    history = sc.simulate(model, *scheme, step, UNTIL, every=every, kernels="numpy")
    history.add_series("ball", history.position(rod.node("rod.end")))
    return history


def last_tip(path: sc.History) -> Any:
    """Where the end of the bend is under the whole load (m)."""
    return path["tip"][-1]


def studies(
    executor: Any = None, folder: str | Path | None = None, progress: bool = False
) -> dict[str, sc.Refinement]:
    """All of them by name; see ``sc.refine`` for the arguments."""

    def kept(name: str) -> dict[str, Any]:
        where = None if folder is None else Path(folder) / name
        return {"executor": executor, "folder": where, "progress": progress}

    statics = {"tip": last_tip, "energy": lambda path: path["strain_energy"][-1]}
    dynamics = {"ball": "ball", "strain energy": "strain_energy"}
    over = sc.study.MaximumOverTime()
    found = {"bend": sc.refine(bend, elements=MESHES, quantities=statics, **kept("bend"))}
    for name, sudden in (("swing_sudden", True), ("swing_growing", False)):
        problem = partial(swing, sudden=sudden)
        found[name] = sc.refine(problem, step=STEPS, quantities=dynamics, norm=over, **kept(name))
    return found


def main(
    out: str | Path | None = None,
    executor: Any = None,
    folder: str | Path | None = None,
    progress: bool = False,
) -> dict[str, Any]:
    """Run the studies.

    Parameters
    ----------
    out : path, optional
        Folder for a table and a chart of each.
    executor, folder, progress
        See ``sc.refine``.

    Returns
    -------
    dict
        By study: ``orders``, ``verdicts``, ``estimate`` (error of the finest level with its
        uncertainty), ``report``.
    """
    result = {}
    for name, study in studies(executor, folder, progress).items():
        result[name] = {
            "orders": {key: each.order for key, each in study.orders.items()},
            "verdicts": study.verdicts,
            "estimate": study.estimate,
            "report": str(study),
        }
        if out is not None:
            Path(out).mkdir(parents=True, exist_ok=True)
            study.csv(Path(out) / f"{name}.csv")
            study.chart(Path(out) / f"{name}.png")
    return result


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", default="refinement", help="folder for tables and charts")
    parser.add_argument("--folder", default=None, help="where results of levels are kept")
    parser.add_argument("--workers", type=int, default=1, help="processes side by side")
    arguments = parser.parse_args()
    if arguments.workers > 1:
        with sc.Processes(arguments.workers) as processes:
            found = main(arguments.out, processes, arguments.folder, progress=True)
    else:
        found = main(arguments.out, None, arguments.folder, progress=True)
    for answer in found.values():
        print(answer["report"])
    print(f"tables and charts: {arguments.out}/*.csv, *.png")
