"""The same pendulum with simpler and simpler models: what each leaves out, and what it saves.

A steel rod with a ball swings in a plane. ``theory=`` of a beam leaves out strains: Kirchhoff's rod
has no shear, the inextensible one no stretching either, the rigid one does not bend. With
``freeze(planar=sc.Planar())`` nothing leaves the plane, and half of the unknowns are enough. As
little strains here, all models agree on where the ball is, within the differences printed.

A model with fewer unknowns is not cheaper by itself: strains that are left out are constraints, so
compare the times. ``sc.answer(model, quantities, tolerance, until).simpler()`` makes such a
comparison for you, after it has found mesh and step.

Run ``python examples/no_more_than_needed.py``; look at the columns of unknowns and differences.
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np

import skfem_cosserat as sc

PICTURE = Path(__file__).with_name("pictures") / "no_more_than_needed.png"
STEEL = sc.Material(E=210e9, nu=0.3, rho=7850)
THEORIES = {
    "all strains": sc.TheoryReissner(),
    "no shear": sc.TheoryKirchhoff(),
    "no shear, no stretching": sc.TheoryInextensible(),
    "rigid": sc.TheoryRigid(),
}


def pendulum(theory: sc.Theory, elements: int, radius: float) -> sc.Model:
    """A round rod of 1 m on a hinge with a ball of 0.5 kg; it starts along x."""
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), elements, name="rod")
    section = sc.SectionCircle(radius, STEEL)
    model = sc.Model()
    rod = sc.Beam(mesh, section, director=(0, 0, 1), theory=theory)
    model.add("rod", rod)
    hinge = sc.JointRevolute(sc.ground((0, 0, 0)), rod.node("rod.start"), axis=(0, 0, 1))
    model.add("hinge", hinge)
    model.add("ball", sc.RigidBody.sphere(0.5, radius=0.03, on=rod.node("rod.end")))
    model.add("gravity", sc.LoadGravity((0, -9.81, 0)))
    return model


def main(
    elements: int = 6,
    radius: float = 5e-3,
    step: float = 5e-3,
    until: float = 0.5,
    out: str | Path | None = None,
) -> dict[str, Any]:
    """Swing with each theory in space and in the plane: a row (dict) of each model."""
    rows = []
    for name, theory in THEORIES.items():
        for planar in (None, sc.Planar()):
            model = pendulum(theory, elements, radius)
            system = model.freeze(planar=planar)
            start = time.process_time()
            run = system, sc.EnergyMomentum(), sc.NullSpace(), step, until
            history = sc.simulate(*run, kernels="numpy")
            ball = history.position(model["rod"].node("rod.end"))
            rows.append(
                {
                    "theory": name,
                    "planar": planar is not None,
                    "unknowns": system.unknowns,
                    "ball": ball,
                    "seconds": time.process_time() - start,
                }
            )
    for row in rows:
        row["difference"] = float(np.linalg.norm(row["ball"] - rows[0]["ball"], axis=1).max())
    if out is not None:
        draw(rows, step, out)
    return {"rows": rows}


def draw(rows: list[dict[str, Any]], step: float, path: str | Path) -> None:
    """Differences from the full model in space over time."""
    figure, (axes,) = sc.figures.panels(8.5, 4)
    for row in rows[2::2]:
        difference = np.linalg.norm(row["ball"] - rows[0]["ball"], axis=1)
        times = step * np.arange(len(difference))
        axes.semilogy(times[1:], 1e3 * difference[1:], label=row["theory"])
    axes.set(xlabel="time in s", ylabel="ball: difference from all strains in mm")
    sc.figures.legend(axes)
    sc.figures.write_figure(figure, path)


if __name__ == "__main__":
    print("model                             unknowns   difference in mm   CPU time in s")
    for row in main(out=PICTURE)["rows"]:
        name = row["theory"] + (", in its plane" if row["planar"] else "")
        print(f"{name:36s} {row['unknowns']:5d} {1e3 * row['difference']:18.1e}", end="")
        print(f" {row['seconds']:15.2f}")
    print(f"picture: {PICTURE}")
