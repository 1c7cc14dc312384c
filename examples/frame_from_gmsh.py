"""A frame read from a gmsh file: named lines become beams, named points become nodes.

``meshes/t_junction.msh`` has the physical lines ``flange`` (2 m) and ``web`` (1 m), which meet at
the physical point ``junction``. Each gets its own section; where they meet they are rigidly
connected. Both ends of the flange are clamped, and a force pushes the end of the web sideways.

Run ``python examples/frame_from_gmsh.py``; look at where the curve of the equilibria leaves the
straight line of linear theory.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

import skfem_cosserat as sc

PICTURE = Path(__file__).with_name("pictures") / "frame_from_gmsh.png"
MESH = Path(__file__).resolve().parent.parent / "meshes" / "t_junction.msh"
STEEL = sc.Material(E=210e9, nu=0.3, rho=7850)
SECTIONS = {
    "flange": sc.SectionRectangle(0.012, 0.012, STEEL),
    "web": sc.SectionRectangle(0.008, 0.012, STEEL),
}


def compliance() -> float:
    """Displacement (m/N) of the loaded end by linear theory, with shear and extension."""
    (GA_f, EA_f, EI_f), (GA_w, _, EI_w) = (
        np.diag(SECTIONS[name].stiffness)[[0, 2, 3]] for name in ("flange", "web")
    )
    half = web = 1.0  # m
    share = 12 * EI_f / (GA_f * half**2)
    turning = 2 * (4 + share) / (1 + share) * EI_f / half  # stiffness of the junction's rotation
    bending = web**3 / (3 * EI_w) + web / GA_w
    return float(bending + web**2 / turning + half / (2 * EA_f))


def main(
    force: float = 200.0, order: int = 3, steps: int = 10, out: str | Path | None = None
) -> dict[str, Any]:
    """Equilibria under a growing force (N): displacement of the loaded end (m), turn (rad)."""
    mesh = sc.read_mesh(MESH)
    model = sc.Model()
    # d1 of all sections is normal to the plane of the frame, d2 lies in it
    frame = sc.Beam(mesh, SECTIONS, order=order, director=(0, 0, 1))
    model.add("frame", frame)
    for end in ("flange.start", "flange.end"):
        place = frame.node(end)
        model.add(f"clamp {end}", sc.JointFixed(sc.ground(place.position), place))
    loaded, junction = frame.node("web.end"), frame.node("junction")
    model.add("force", sc.LoadForce(loaded, (force, 0, 0)))
    path = sc.static(model, control=sc.LoadControl(steps=steps))

    moved = path.position(loaded) - loaded.position
    triads = path.rotation(junction)  # a director along the web turns by as much as the junction
    along = triads @ triads[0].T
    result = {
        "beams": list(mesh.beams),
        "force": force * path["load_factor"],
        "displacement": moved[:, 0],
        "linear": force * path["load_factor"] * compliance(),
        "turn": np.arccos(np.clip((np.trace(along, axis1=1, axis2=2) - 1) / 2, -1, 1)),
    }
    if out is not None:
        draw(path, frame, result, out)
    return result


def draw(path: sc.History, frame: sc.Beam, result: dict[str, Any], file: str | Path) -> None:
    """The frame before and after, and force against displacement."""
    figure, (left, right) = sc.figures.panels(9, 3.5, 1, 2)
    for k, style in ((0, "0.7"), (-1, sc.figures.PALETTE["blue"])):
        for part, length in (("flange", 2.0), ("web", 1.0)):
            line = path.position(frame, np.linspace(0, length, 60), part=part)
            left.plot(*line[k, :, :2].T, color=style, lw=2)
    left.set(xlabel="x in m", ylabel="y in m", aspect="equal")
    right.plot(result["displacement"], result["force"], "o-", ms=4, label="equilibria")
    right.plot(result["linear"], result["force"], "k:", label="linear theory")
    right.set(xlabel="displacement of the end in m", ylabel="force in N")
    sc.figures.legend(right)
    sc.figures.write_figure(figure, file)


if __name__ == "__main__":
    result = main(out=PICTURE)
    print("beams in the file:", ", ".join(result["beams"]))
    print(f"at {result['force'][-1]:g} N the end has moved by {result['displacement'][-1]:.4f} m")
    print(f"linear theory: {result['linear'][-1]:.4f} m")
    print(f"the junction has turned by {np.degrees(result['turn'][-1]):.2f} degrees")
    print(f"picture: {PICTURE}")
