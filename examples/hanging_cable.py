"""A rope of springs that cannot push hangs between two hooks, and swings out in the wind.

The rope is a chain of mass points with an ``sc.Cable`` from each to the next: a spring with tension
only. Before anything pulls, such a chain has no stiffness, so that a path of equilibria cannot
start without loads. Two things help: the reference is drawn as a parabola a little longer than the
rope, so that every cable is taut there, and ``factors={"weight": 1.0}`` holds the weight in full
from the start. Only the wind then grows with the load factor.

The rope hangs in a catenary. The wind, here a force that is spread like the weight, turns the plane
of the catenary about the line through the hooks.

Run ``python examples/hanging_cable.py``; look at how little the pieces differ from the catenary.
"""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import brentq

import skfem_cosserat as sc

PICTURE = Path(__file__).with_name("pictures") / "hanging_cable.png"
SPAN, LENGTH, EA = 1.0, 1.3, 1e6  # m, m, N
MASS, GRAVITY = 0.5, 9.81  # kg, m/s^2


def catenary() -> tuple[float, float]:
    """Sag (m), and horizontal part of the tension (N), of a rope that does not stretch."""
    u = brentq(lambda u: np.sinh(u) / u - LENGTH / SPAN, 1e-3, 10)
    a = SPAN / (2 * u)
    return float(a * (np.cosh(u) - 1)), float(a * MASS * GRAVITY / LENGTH)


def parabola(pieces: int, length: float) -> np.ndarray:
    """Points (pieces + 1, 3) at equal distances along a hanging parabola of this length."""
    x = np.linspace(0, SPAN, 2001)

    def curve(sag: float) -> tuple[np.ndarray, np.ndarray]:
        z = -4 * sag * x / SPAN * (1 - x / SPAN)
        return z, np.append(0, np.cumsum(np.hypot(np.diff(x), np.diff(z))))

    z, along = curve(brentq(lambda sag: curve(sag)[1][-1] - length, 0, LENGTH))
    where = np.linspace(0, along[-1], pieces + 1)
    across = np.interp(where, along, x)
    return np.stack([across, 0 * across, np.interp(where, along, z)], axis=1)


def main(pieces: int = 20, wind: float = 5.0, out: str | Path | None = None) -> dict[str, Any]:
    """Sag (m), horizontal tension (N) and angle (rad) in still air and in the wind (N/kg)."""
    points = parabola(pieces, 1.005 * LENGTH)
    model = sc.Model()
    places = [sc.ground(points[0])]
    for k, x in enumerate(points[1:-1]):
        point = model.add(f"point {k}", sc.MassPoint(MASS / pieces, position=x))
        places.append(point.place())
    places.append(sc.ground(points[-1]))
    piece = LENGTH / pieces
    for k, (a, b) in enumerate(pairwise(places)):
        model.add(f"cable {k}", sc.Cable(a, b, stiffness=EA / piece, length=piece))
    model.add("weight", sc.LoadGravity((0, 0, -GRAVITY)))
    model.add("wind", sc.LoadGravity((0, wind, 0)))
    control = sc.LoadControl(steps=10)
    path = sc.static(model, control=control, factors={"weight": 1.0}, watch=False)

    line = np.stack([path.position(place) for place in places], axis=1)
    middle = line[:, pieces // 2]
    first = line[:, 1] - line[:, 0]
    tension = path["coupling/cable 0/force"].ravel()
    sag, horizontal = catenary()
    result = {
        "wind": wind * path["load_factor"],
        "sag": np.hypot(middle[:, 1], middle[:, 2]),
        "angle": np.arctan2(middle[:, 1], -middle[:, 2]),
        "horizontal": tension * first[:, 0] / np.linalg.norm(first, axis=1),
        "catenary_sag": sag,
        "catenary_horizontal": horizontal,
        "line": line,
    }
    if out is not None:
        draw(result, out)
    return result


def draw(result: dict[str, Any], path: str | Path) -> None:
    """The rope from the side, with the catenary, and along the line through the hooks."""
    figure, (left, right) = sc.figures.panels(9, 3.4, 1, 2)
    a = result["catenary_horizontal"] * LENGTH / (MASS * GRAVITY)
    x = np.linspace(0, SPAN, 100)
    z = a * np.cosh((x - SPAN / 2) / a)
    left.plot(x, z - z[0], "k", lw=1, label="catenary")
    left.plot(*result["line"][0, :, ::2].T, "o", ms=5, label="rope")
    left.set(xlabel="x in m", ylabel="z in m", aspect="equal")
    sc.figures.legend(left)
    for k in (0, len(result["wind"]) // 2, -1):
        right.plot(*result["line"][k, :, 1:].T, ".-", label=f"{result['wind'][k]:g} N/kg")
    right.set(xlabel="y in m", ylabel="z in m", xlim=(-0.1, 0.5), ylim=(-0.4, 0.03), aspect="equal")
    sc.figures.legend(right, "wind")
    sc.figures.write_figure(figure, path)


if __name__ == "__main__":
    result = main(out=PICTURE)
    print(f"sag {result['sag'][0]:.5f} m, of the catenary {result['catenary_sag']:.5f} m")
    tensions = result["horizontal"][0], result["catenary_horizontal"]
    print("horizontal tension {:.4f} N, of the catenary {:.4f} N".format(*tensions))
    print(f"in the wind the rope hangs at {np.degrees(result['angle'][-1]):.3f} degrees")
    print(f"picture: {PICTURE}")
