"""How far to trust a mesh and a step: refinement studies of a bend and of a swinging rod.

``sc.refine`` calls a function of the mesh, the order or the step again and again, and gives errors,
observed orders, and an extrapolated value with its uncertainty.

- The 45-degree bend in statics, elements of order p = 1 to 4: the tip converges with the order 2p.
- A rubber rod with a ball, let go from the horizontal, with finer and finer steps. Under gravity
  that grows within 0.1 s the order is 2. Gravity that is there at once excites waves that no step
  here resolves: there is no order to observe, and the verdict says so.

Run ``python examples/refinement_study.py``; it writes tables and charts into ``examples/pictures``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import skfem_cosserat as sc

PICTURES = Path(__file__).with_name("pictures")
#: meshes of the bend by order: coarse enough to stay above rounding
MESHES = {1: (16, 32, 64, 128), 2: (8, 16, 32, 64), 3: (4, 8, 12, 16), 4: (6, 8, 12, 16)}
STEPS = (2e-3, 1e-3, 5e-4, 2.5e-4)
TITLES = {"bend": "45° bend", "swing_sudden": "sudden gravity", "swing_growing": "slow gravity"}
UNITS = {"tip": "m", "energy": "J", "ball": "m", "strain energy": "J"}
#: (s): gravity grows as long, the rod falls as long
GROWS, UNTIL = 0.1, 0.2


def bend(elements: int, order: int) -> dict[str, Any]:
    """An eighth of a circle of radius 100, unit square, clamped; 600 out of its plane."""
    arc = (0, 0, 0), (1, 0, 0), (0, 1, 0), 100.0, np.pi / 4
    mesh = sc.MeshCurve.init_arc(*arc, elements, name="rod")
    E, G = 1e7, 5e6
    section = sc.Section.from_constants(
        EA=E, GA=G, EI=(E / 12, E / 12), GJ=G / 6, mass=1.0, inertia=(1.0, 1.0)
    )
    model = sc.Model()
    rod = model.add("rod", sc.Beam(mesh, section, order=order, director=(0, 0, 1)))
    model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), rod.node("rod.start")))
    model.add("force", sc.LoadForce(rod.node("rod.end"), (0, 0, 600.0)))
    path = sc.static(model, control=sc.LoadControl(steps=2), watch=False)
    return {"tip": path.position(rod.node("rod.end"))[-1], "energy": path["strain_energy"][-1]}


def growing(time: float) -> float:
    """From 0 to 1, with two continuous derivatives."""
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
    every = round(0.02 / step)  # record the same instants with all steps
    history = sc.simulate(model, *scheme, step, UNTIL, every=every, kernels="numpy")
    history.add_series("ball", history.position(rod.node("rod.end")))
    return history


def main(
    meshes: Mapping[int, Sequence[int]] = MESHES,
    steps: Sequence[float] = STEPS,
    out: str | Path | None = None,
    folder: str | Path | None = None,
) -> dict[str, sc.Refinement]:
    """Run the studies.

    Parameters
    ----------
    meshes : mapping
        Numbers of elements of the bend by order.
    steps : sequence of float
        Of the swing (s).
    out : path, optional
        Folder for a table and a chart of each study.
    folder : path, optional
        Keeps the result of each level here: a study that was stopped goes on there.

    Returns
    -------
    dict
        The studies "bend", "swing_sudden" and "swing_growing".
    """
    kept = {name: folder and Path(folder) / name for name in ("bend", "sudden", "growing")}
    found = {"bend": sc.refine(bend, elements=meshes, folder=kept["bend"])}
    for name in ("sudden", "growing"):
        found[f"swing_{name}"] = sc.refine(
            partial(swing, sudden=name == "sudden"),
            step=steps,
            quantities={"ball": "ball", "strain energy": "strain_energy"},
            norm=sc.accuracy.MaximumOverTime(),
            folder=kept[name],
        )
    if out is not None:
        for name, study in found.items():
            study.csv(Path(out) / f"refinement_{name}.csv")
            study.chart(Path(out) / f"refinement_{name}.png", UNITS, TITLES[name])
    return found


if __name__ == "__main__":
    for study in main(out=PICTURES).values():
        print(study)
    print(f"tables and charts: {PICTURES}/refinement_*")
