"""A ring of scissors unfolds: spring hinges drive it from a bundle to a wide ring.

The ring has twelve pairs of angulated bars (Hoberman's linkage), which cross at a pivot and are
hinged to the neighbours at their ends. Its 24 bars are elastic beams: rigid ones would have many
redundant constraints. With arms of the length a, at the angle psi from the tangent, the outer
hinges are at the radius ``a cos(psi)/tan(pi/12) + a sin(psi)``, and each stays on its ray.

Run ``python examples/deployable_ring.py``; look at how round the ring stays while it grows.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

import skfem_cosserat as sc

PICTURE = Path(__file__).with_name("pictures") / "deployable_ring.gif"
PAIRS, ARM, FOLDED, OPEN = 12, 0.5, np.radians(70), np.radians(20)  # -, m, rad
HALF = np.pi / PAIRS  # half the angle between rays


def radii(psi: float) -> tuple[float, float, float]:
    """Of the inner hinges, pivots and outer hinges (m), for arms at the angle psi (rad)."""
    middle, side = ARM * np.cos(psi) / np.tan(HALF), ARM * np.sin(psi)
    return middle - side, ARM * np.cos(psi) / np.sin(HALF), middle + side


def ring(psi: float) -> sc.Model:
    """All bars at the angle psi, with damped springs at their pivots that want to open them."""
    bar = sc.SectionRectangle(0.03, 0.06, sc.Material(E=70e9, nu=0.3, rho=2700))
    inner, middle, outer = radii(psi)
    model = sc.Model()
    layers = {"up": (inner, outer, 0.016), "down": (outer, inner, -0.016)}
    for k in range(PAIRS):
        turns = HALF * (2 * k + np.arange(3))
        rays = np.stack([np.cos(turns), np.sin(turns), 0 * turns], axis=1)
        for name, (first, last, z) in layers.items():
            points = rays * np.array([[first], [middle], [last]]) + (0, 0, z)
            mesh = sc.MeshCurve.init_polyline(points, 1, name="bar", nodes={"pivot": 0.5})
            model.add(f"{name} {k}", sc.Beam(mesh, bar, order=2, director=(0, 0, 1)))

    def side(bar: str, end: str) -> sc.Place:
        """A point of a bar, moved to the plane between both layers."""
        z = 0.016 if bar.startswith("up") else -0.016
        return model[bar].node(end, offset=(-z, 0, 0))

    for k in range(PAIRS):
        up, down, after = f"up {k}", f"down {k}", (k + 1) % PAIRS
        hinges = {
            f"pivot {k}": (side(up, "pivot"), side(down, "pivot")),
            f"outer {k}": (side(up, "bar.end"), side(f"down {after}", "bar.start")),
            f"inner {k}": (side(down, "bar.end"), side(f"up {after}", "bar.start")),
        }
        for name, (a, b) in hinges.items():
            model.add(name, sc.JointRevolute(a, b, axis=(0, 0, 1)))
        spring = sc.JointSpringDamper(model[f"pivot {k}"], 24.0, 18.0, neutral=2 * (OPEN - psi))
        model.add(f"spring {k}", spring)
    return model


def main(step: float = 2e-2, until: float = 3.0, out: str | Path | None = None) -> dict[str, Any]:
    """Radii (m) by time of an outer hinge, and by `radii` for the angle of a pivot; how far the
    hinge leaves its ray and the centre its place (m); work, and energy that the dampers take (J).
    """
    model = ring(FOLDED)
    history = sc.simulate(model, sc.EnergyMomentum(), sc.NullSpace(), step, until)
    x = history.position(model["up 3"].node("bar.end"))
    ray = 2 * HALF * 4
    psi = FOLDED + history["joint/pivot 0/angle"] / 2
    if out is not None:
        history.animate(out, fps=15, camera="xy", window=(480, 270))
    return {
        "radius": np.hypot(x[:, 0], x[:, 1]),
        "theory": np.array([radii(each)[2] for each in psi]),
        "off_ray": float(abs(x @ (-np.sin(ray), np.cos(ray), 0)).max()),
        "momentum": float(abs(history["linear_momentum"]).max()),
        "released": float(history["energy"][0] - history["energy"][-1]),
        "dissipated": float(history["dissipated"][-1]),
    }


if __name__ == "__main__":
    result = main(out=PICTURE)
    first, *_, last = result["radius"]
    print(
        f"radius {first:.3f} m at first, {last:.3f} m at last, by theory {result['theory'][-1]:.3f}"
    )
    print(f"the dampers take {result['dissipated']:.2f} J of {result['released']:.2f} J")
    print(f"picture: {PICTURE}")
