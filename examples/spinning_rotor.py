"""Three blades droop from a hub at rest; as the rotor spins up they stretch and rise.

The blades start in equilibrium under their weight. A motor then brings the hub to its speed. The
centrifugal force pulls the blades straight: at the root of each it is
``mass Omega^2 (R^2 - a^2)/2`` with the mass per length, the radius R and the root at a.

Run ``python examples/spinning_rotor.py``; look at the droop before and after in the film.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

import skfem_cosserat as sc

PICTURE = Path(__file__).with_name("pictures") / "spinning_rotor.gif"
ROOT, RADIUS = 0.3, 4.0  # m
BLADE = sc.SectionRectangle(0.25, 0.016, sc.Material(E=70e9, nu=0.3, rho=2700))
HUB = sc.RigidBody.cylinder(60.0, radius=ROOT, length=0.3)


def turned(t: float, speed: float, last: float) -> float:
    """Angle (rad) of the hub: its speed follows a smooth ramp up to the time `last`."""
    s = min(t / last, 1.0)
    return speed * (last * s**4 * (2.5 - 3 * s + s**2) + t - s * last)


def rotor(speed: float, last: float) -> sc.Model:
    """The hub on a motor, and its blades."""
    model = sc.Model()
    hub = model.add("hub", HUB)
    axle = sc.JointRevolute(sc.ground((0, 0, 0)), hub.local((0, 0, 0)), axis=(0, 0, 1))
    model.add("axle", axle)
    model.add("motor", sc.JointDrive(axle, lambda t: turned(t, speed, last)))
    for k in range(3):
        a = 2 * np.pi * k / 3
        along, across = np.array([(np.cos(a), np.sin(a), 0), (-np.sin(a), np.cos(a), 0)])
        mesh = sc.MeshCurve.init_line(ROOT * along, RADIUS * along, 3, name="blade")
        blade = model.add(f"blade {k}", sc.Beam(mesh, BLADE, order=3, director=across))
        root = blade.node("blade.start")
        model.add(f"root {k}", sc.JointFixed(hub.at(ROOT * along), root))
    model.add("weight", sc.LoadGravity((0, 0, -9.81)))
    return model


def main(
    speed: float = 6.0,
    last: float = 3.0,
    step: float = 1e-2,
    until: float = 4.0,
    out: str | Path | None = None,
) -> dict[str, Any]:
    """Droop (m) of a tip at rest and at `speed` (rad/s), root force (N), angular momentum, work."""
    model = rotor(speed, last)
    start = sc.equilibrium(model, sc.static(model, time=0.0))
    run = model, sc.EnergyMomentum(), sc.NullSpace(), step, until
    history = sc.simulate(*run, start=start)
    tip = history.position(model["blade 0"].node("blade.end"))
    late = history.times > last
    force = history["joint/root 0/force"][late]
    if out is not None:
        history.animate(out, fps=12, window=(480, 270))
    return {
        "droop": (-float(tip[0, 2]), -float(tip[late, 2].mean())),
        "pull": float(np.linalg.norm(force[:, :2], axis=1).mean()),
        "momentum": float(history["angular_momentum"][late, 2].mean()),
        "balance": float(abs(history["energy_balance"]).max() / history["kinetic"].max()),
    }


if __name__ == "__main__":
    result = main(out=PICTURE)
    print("droop of the tips: {:.3f} m at rest, {:.3f} m at speed".format(*result["droop"]))
    print(f"centrifugal force at a root {result['pull']:.0f} N\npicture: {PICTURE}")
