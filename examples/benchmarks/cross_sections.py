"""Cross-sections from their shape: closed forms, a rolled beam, a composite against its parts.

Saint-Venant's problems are solved on a mesh of the section with scikit-fem; a table puts torsion
constants, shear factors and shear centres beside closed forms. Two bars of different materials
glued together are one beam with a composite section, or two parallel beams joined at every node:
in bending and tension both agree. ``--picture FILE`` draws sections with their centres (needs
matplotlib). All units SI.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np

import skfem_cosserat as sc
from skfem_cosserat.figures import PAGE, PALETTE, legend, panels, write_figure
from skfem_cosserat.profile import (
    ProfileChannel,
    ProfileCircle,
    ProfileI,
    ProfilePolygon,
    ProfileRectangle,
    ProfileRectangles,
    ProfileTube,
)

STEEL = sc.Material(210e9, 0.3, 7850.0)
ALUMINIUM = sc.Material(70e9, 0.3, 2700.0)

#: The glued bar: width along d1, height of steel below and of aluminium above the beam's line.
WIDTH, BELOW, ABOVE, LENGTH = 0.02, 0.01, 0.016, 1.0


def closed_forms(tolerance: float = 1e-4) -> list[dict[str, Any]]:
    """Rows of name, computed and exact value; nu = 0.3."""
    nu = STEEL.nu
    square = ProfileRectangle(0.1, 0.1, STEEL).constants(tolerance)
    plate = ProfileRectangle(0.1, 1.0, STEEL).constants(tolerance)
    circle = ProfileCircle(0.1, STEEL).constants(tolerance)
    tube = ProfileTube(0.1, 0.09, STEEL).constants(tolerance)
    corners = 0.1 * np.array([(0, 0), (1, 0), (0.5, np.sqrt(0.75))])
    triangle = ProfilePolygon(corners, STEEL).constants(tolerance)
    rows = (
        ("square: torsion constant / a^4", square.torsion_constant / 1e-4, 0.140577014955),
        ("plate 1:10: torsion constant / (a^3 b)", plate.torsion_constant / 1e-3, 0.312325),
        ("circle: torsion constant / r^4", circle.torsion_constant / 1e-4, np.pi / 2),
        (
            "circle: shear factor",
            circle.shear_factors[0],
            6 * (1 + nu) ** 2 / (7 + 14 * nu + 8 * nu**2),
        ),
        (
            "tube 0.9: torsion constant / r^4",
            tube.torsion_constant / 1e-4,
            np.pi / 2 * (1 - 0.9**4),
        ),
        ("triangle: torsion constant / a^4", triangle.torsion_constant / 1e-4, np.sqrt(3) / 80),
        ("triangle: shear centre, height / a", triangle.shear_centre[1] / 0.1, np.sqrt(3) / 6),
    )
    return [{"name": name, "computed": float(a), "exact": float(b)} for name, a, b in rows]


def glued_bar() -> ProfileRectangles:
    """Steel below and aluminium above the beam's line, which lies in the glued joint."""
    x = (-WIDTH / 2, WIDTH / 2)
    return ProfileRectangles([(x, (-BELOW, 0.0), STEEL), (x, (0.0, ABOVE), ALUMINIUM)])


def bars(parts: list[tuple[sc.Section, float]], elements: int) -> tuple[sc.Model, sc.Beam, Any]:
    """Cantilevers along e1 at heights along e3, joined at every node: model, first bar, its end.

    d1 is along e2, d2 along e3 and d3 along e1.
    """
    model, beams = sc.Model(), []
    for k, (section, height) in enumerate(parts):
        ends = (0, 0, height), (LENGTH, 0, height)
        mesh = sc.MeshCurve.init_line(*ends, elements, name=f"bar {k}")
        beam = model.add(f"bar {k}", sc.Beam(mesh, section, director=(0, 1, 0), order=2))
        beams.append((beam, height))
    for node in range(2 * elements + 1):
        x = LENGTH * node / (2 * elements)
        places = [beam.node((x, 0, y), (0, -y, 0)) for beam, y in beams]  # all in the joint
        if node == 0:
            for k, place in enumerate(places):
                model.add(f"clamp {k}", sc.JointFixed(sc.ground(place.position), place))
        for k, place in enumerate(places[1:] if node else []):
            model.add(f"glue {node} {k}", sc.JointFixed(places[0], place))
    return model, beams[0][0], beams[0][1]


def tip(parts: list[tuple[sc.Section, float]], load: str, value: float, elements: int = 8) -> Any:
    """Tip of the bars under a moment about d1 or a pull at the elastic centre.

    Returns
    -------
    position : (3,) array
        Of the tip of the line in the joint (m).
    normal : (3,) array
        Its director d3.
    """
    model, beam, height = bars(parts, elements)
    end = beam.node((LENGTH, 0, height))
    if load == "moment":
        model.add("load", sc.LoadMoment(end, (0, value, 0)))
    else:
        place = beam.node((LENGTH, 0, height), (0, moduli()[1] / moduli()[0] - height, 0))
        model.add("load", sc.LoadForce(place, (value, 0, 0)))
    history = sc.static(model, sc.NullSpace())
    _, d2, d3 = history.rotation(end)[-1]
    return history.position(end)[-1] - height * d2, d3


def moduli() -> tuple[float, float, float]:
    """``int E (1, y, y^2) dA`` of the glued bar about the joint."""
    E, h = np.array([STEEL.E, ALUMINIUM.E]), np.array([BELOW, ABOVE])
    y, A = np.array([-BELOW / 2, ABOVE / 2]), WIDTH * h
    return (E * A).sum(), (E * A * y).sum(), (E * A * (h**2 / 12 + y**2)).sum()


def theory(load: str, value: float) -> tuple[np.ndarray, np.ndarray]:
    """Exact tip of the composite bar: an arc under a moment, a stretched line under a pull."""
    EA, ES, EI = moduli()
    if load == "pull":
        return np.array([LENGTH * (1 + value / EA), 0, 0]), np.array([1.0, 0, 0])
    stretch, curvature = np.linalg.solve([[EA, ES], [ES, EI]], [0, value])
    angle = curvature * LENGTH
    normal = np.array([np.cos(angle), 0, -np.sin(angle)])
    return (1 + stretch) / curvature * np.array([np.sin(angle), 0, np.cos(angle) - 1]), normal


def composite(elements: int = 8) -> list[dict[str, Any]]:
    """Tips of the glued bar as one beam and as two parallel beams, against theory."""
    steel, light = ((BELOW, STEEL), (ABOVE, ALUMINIUM))
    parts = {
        "one composite beam": [(glued_bar().section(1e-5), 0.0)],
        "parallel beams": [
            (ProfileRectangle(WIDTH, *steel).section(1e-5), -BELOW / 2),
            (ProfileRectangle(WIDTH, *light).section(1e-5), ABOVE / 2),
        ],
    }
    rows = []
    for load, value in {"moment": 2000.0, "pull": 1e5}.items():
        position, normal = theory(load, value)
        for name, each in parts.items():
            found = tip(each, load, value, elements)
            wrong = abs(np.concatenate([found[0] - position, found[1] - normal])).max()
            rows.append({"load": load, "model": name, "tip": found[0], "error": float(wrong)})
    return rows


def picture(path: Path) -> None:
    """Four sections with their elastic and shear centres."""
    figure, axes = panels(PAGE, 7.0, 2, 2)
    angle = [(0, 0), (0.08, 0), (0.08, 0.01), (0.01, 0.01), (0.01, 0.12), (0, 0.12)]
    profiles = {
        "I": ProfileI(0.2, 0.1, 0.0085, 0.0056, STEEL),
        "channel": ProfileChannel(0.1, 0.05, 0.0085, 0.006, STEEL),
        "angle": ProfilePolygon(angle, STEEL),
        "glued": glued_bar(),
    }
    for ax, (name, profile) in zip(axes, profiles.items(), strict=True):
        profile.plot(ax)
        constants = profile.constants(1e-3)
        ax.plot(*constants.elastic_centre, "k+", markersize=11, label="elastic centre")
        ax.plot(
            *constants.shear_centre, "x", color=PALETTE["red"], markersize=9, label="shear centre"
        )
        ax.set_title(name)
    legend(figure, below=2)
    write_figure(figure, path)


def main(picture_file: Path | None = None, tolerance: float = 1e-4) -> dict[str, Any]:
    """Compute all numbers of this page.

    Returns
    -------
    dict
        ``"closed_forms"`` and ``"composite"`` (rows of tables), ``"rolled"`` (constants of an I).
    """
    if picture_file is not None:
        picture(picture_file)
    return {
        "closed_forms": closed_forms(tolerance),
        "rolled": ProfileI(0.2, 0.1, 0.0085, 0.0056, STEEL).constants(tolerance),
        "composite": composite(),
    }


def report(result: dict[str, Any]) -> None:
    """Print the tables."""
    for row in result["closed_forms"]:
        error = row["computed"] / row["exact"] - 1
        print(f"{row['name']:<40}{row['computed']:.7f}  exact {row['exact']:.7f}  ({error:+.1e})")
    print("\nI 200 x 100 x 5.6 x 8.5, sharp corners:")
    print(result["rolled"])
    print("\nsteel and aluminium glued, tip of the cantilever against theory:")
    for row in result["composite"]:
        tip_at = ", ".join(f"{x:.9f}" for x in row["tip"])
        print(f"{row['load']:<8}{row['model']:<20}({tip_at}) m  error {row['error']:.1e} m")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--picture", type=Path, help="file for a picture of sections")
    report(main(parser.parse_args().picture))
