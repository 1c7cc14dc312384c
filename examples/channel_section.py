"""A cantilever of channel section twists when the force acts at its centroid.

``sc.ProfileChannel`` computes the section's stiffness from its shape: area, bending, torsion and
shear, and the shear centre, which lies outside of the channel behind its web. A force through the
shear centre only bends the beam. A force F through the centroid, at a distance e from there, twists
it as well, at the end by ``F e L/(G J)`` (Saint-Venant's torsion: warping is free).

Run ``python examples/channel_section.py``; look at where the angle of twist is zero.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

import skfem_cosserat as sc

PICTURE = Path(__file__).with_name("pictures") / "channel_section.png"
STEEL = sc.Material(E=210e9, nu=0.3, rho=7850)


def cantilever(
    section: sc.Section, length: float, force: float, where: Sequence[float], elements: int
) -> tuple[float, float]:
    """Deflection (m) and angle of twist (rad) of the end; the force acts along d2 at `where`."""
    mesh = sc.MeshCurve.init_line((0, 0, 0), (0, 0, length), elements, name="beam")
    model = sc.Model()
    beam = model.add("beam", sc.Beam(mesh, section, order=3, director=(1, 0, 0)))
    model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), beam.node("beam.start")))
    end = beam.node("beam.end")
    model.add("force", sc.LoadForce(beam.node("beam.end", (*where, 0.0)), (0, force, 0)))
    path = sc.static(model)
    d1 = path.rotation(end)[-1, 0]
    return float(path.position(end)[-1, 1]), float(np.arctan2(d1[1], d1[0]))


def main(
    force: float = 20.0, length: float = 2.0, elements: int = 4, out: str | Path | None = None
) -> dict[str, Any]:
    """Load the end at the shear centre, at the centroid and between: angles of twist (rad)."""
    profile = sc.ProfileChannel(height=0.1, width=0.05, flange=5e-3, web=4e-3, material=STEEL)
    constants = profile.constants()
    centre, centroid = constants.shear_centre, constants.centroid
    section = profile.section(origin=centroid)  # the beam's line passes through the centroid
    shares = np.array([-0.5, 0.0, 0.5, 1.0, 1.5])  # 0: centroid, 1: shear centre
    arms = shares[:, None] * (centre - centroid)
    found = np.array([cantilever(section, length, force, arm, elements) for arm in arms])
    GJ = 1 / np.linalg.inv(section.stiffness)[5, 5]
    result = {
        "shear_centre": centre,
        "centroid": centroid,
        "GJ": float(GJ),
        "arms": arms[:, 0],
        "deflection": found[:, 0],
        "twist": found[:, 1],
        "theory": force * length / GJ * (arms - arms[3])[:, 0],
    }
    if out is not None:
        draw(profile, result, out)
    return result


def draw(profile: sc.Profile, result: dict[str, Any], path: str | Path) -> None:
    """The section with its two centres, and the twist against the place of the force."""
    figure, (left, right) = sc.figures.panels(8.5, 3.6, 1, 2)
    outline = 1e3 * profile.outline
    left.fill(*outline.T, color="0.85", ec="0.3")
    for name, mark in (("centroid", "o"), ("shear_centre", "x")):
        left.plot(*1e3 * result[name], mark)
        left.annotate(name.replace("_", " "), 1e3 * result[name] + (0, 3), ha="center")
    left.set(xlabel="along d1 in mm", ylabel="along d2 in mm", aspect="equal", xlim=(-42, 55))
    right.plot(1e3 * result["arms"], np.degrees(result["theory"]), "k:", label="F e L/(G J)")
    right.plot(1e3 * result["arms"], np.degrees(result["twist"]), "o", label="computed")
    right.set(xlabel="place of the force along d1 in mm", ylabel="twist in degrees")
    sc.figures.legend(right)
    sc.figures.write_figure(figure, path)


if __name__ == "__main__":
    result = main(out=PICTURE)
    arm = 1e3 * (result["shear_centre"] - result["centroid"])[0]
    print(f"the shear centre is {-arm:.1f} mm from the centroid, G J = {result['GJ']:.1f} N m^2")
    for name, k in (("centroid", 1), ("shear centre", 3)):
        twist, theory = (np.degrees(result[key][k]) for key in ("twist", "theory"))
        print(f"force at the {name}: twist {twist:.4f} degrees, theory {theory:.4f}")
    print(f"picture: {PICTURE}")
