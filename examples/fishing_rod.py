"""A tapered fishing rod casts: its butt swings slowly, its thin end gets fast.

The rod is one beam, whose diameter falls from 16 mm to 4 mm (``sc.SectionTaper``). The line is a
cable, which only pulls. The run starts from the equilibrium in which the lure bends the rod;
linear theory gives the droop of its tip if the lure is light.

Run ``python examples/fishing_rod.py``; look at how the rod bends before the line is thrown.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

import skfem_cosserat as sc

PICTURE = Path(__file__).with_name("pictures") / "fishing_rod.gif"
LENGTH, BUTT, TIP, LINE, GRAVITY = 2.4, 8e-3, 2e-3, 1.0, 9.81  # m, m/s^2
BAMBOO = sc.Material(E=15e9, nu=0.3, rho=700)


def angle(t: float) -> float:
    """Of the hand (rad): back until 0.8 s, then forward."""
    return sc.RampSmooth(0.0, 0.8, last=0.6).value(t) - sc.RampSmooth(0.8, 1.3, last=1.1).value(t)


def rig(lure: float, rising: float) -> sc.Model:
    """The rod points up at the angle `rising` (rad) from the horizontal, along x."""
    taper = sc.SectionTaper(sc.SectionCircle(BUTT, BAMBOO), sc.SectionCircle(TIP, BAMBOO))
    end = LENGTH * np.array([np.cos(rising), 0, np.sin(rising)])
    mesh = sc.MeshCurve.init_line((0, 0, 0), end, 8, name="rod")
    model = sc.Model()
    rod = model.add("rod", sc.Beam(mesh, taper.damped(2e-3), order=3, director=(0, 1, 0)))
    hand = sc.JointRevolute(sc.ground((0, 0, 0)), rod.node("rod.start"), axis=(0, -1, 0))
    model.add("hand", hand)
    model.add("swing", sc.JointDrive(hand, angle))
    load = model.add("lure", sc.MassPoint(lure, position=end - (0, 0, LINE)))
    tip = rod.node("rod.end")
    line = sc.Cable(tip, load.place(), stiffness=500.0, damping=0.05, length=0.99 * LINE)
    model.add("line", line)
    model.add("weight", sc.LoadGravity((0, 0, -GRAVITY)))
    return model


def main(
    lure: float = 0.1,
    rising: float = 0.9,
    step: float = 5e-3,
    until: float = 1.5,
    out: str | Path | None = None,
) -> dict[str, Any]:
    """Droop (m) of the tip at rest, its largest speed (m/s), balance of the energy."""
    model = rig(lure, rising)
    path = sc.static(model, time=0.0, factors={"weight": 1.0})
    run = model, sc.EnergyMomentum(), sc.NullSpace(), step, until
    history = sc.simulate(*run, start=sc.equilibrium(model, path), every=5)
    tip = model["rod"].node("rod.end")
    speed = np.linalg.norm(history.velocity(tip), axis=1)
    if out is not None:
        history.animate(out, fps=15, speed=0.5, camera="xz", window=(480, 270))
    return {
        "droop": float(tip.position[2] - path.position(tip)[-1, 2]),
        "speed": float(speed.max()),
        "balance": float(abs(history["energy_balance"]).max() / history["kinetic"].max()),
    }


if __name__ == "__main__":
    result = main(out=PICTURE)
    print(f"the lure bends the rod down by {result['droop']:.3f} m")
    print(f"largest speed of the tip {result['speed']:.1f} m/s\npicture: {PICTURE}")
