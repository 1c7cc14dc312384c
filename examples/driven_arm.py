"""Two flexible arms are turned by the same angle: the hasty one swings on, the other stands still.

A smooth ramp turns the hinge of each arm by ``sc.JointDrive``. How much vibration it leaves depends
on its duration T alone. In one vibration of the frequency w the amplitude that remains is in
proportion to ``15 j2(z)/z^2`` with ``z = w T/2`` and the spherical Bessel function j2. The tuned
arm takes the T of the first zero, 1.83 periods of the first vibration: it arrives at rest.

Run ``python examples/driven_arm.py``; look at the ends of both arms in the film.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

import skfem_cosserat as sc

PICTURE = Path(__file__).with_name("pictures") / "driven_arm.gif"
LENGTH, WEIGHT = 1.2, 0.2  # m, kg
TUNED, HASTY = 11.527, 8.8  # w T: the first one is twice the first zero of j2


def arms(durations: dict[str, float], angle: float) -> sc.Model:
    """Aluminium strips on edge, each with a ball at its end, on hinges that turn in so many s."""
    strip = sc.SectionRectangle(0.04, 0.003, sc.Material(E=70e9, nu=0.3, rho=2700))
    model = sc.Model()
    for k, (name, T) in enumerate(durations.items()):
        start, end = (0, 0, 0.3 * k), (LENGTH, 0, 0.3 * k)
        mesh = sc.MeshCurve.init_line(start, end, 4, name="arm")
        arm = model.add(name, sc.Beam(mesh, strip, order=3, director=(0, 0, 1)))
        model.add(f"{name} ball", sc.RigidBody.sphere(WEIGHT, radius=0.03, on=arm.node("arm.end")))
        hinge = sc.JointRevolute(sc.ground(start), arm.node("arm.start"), axis=(0, 0, 1))
        model.add(f"{name} hinge", hinge)
        model.add(f"{name} motor", sc.JointDrive(hinge, sc.RampSmooth(0.0, T, last=angle)))
    return model


def main(
    angle: float = 1.0, step: float = 1e-2, until: float = 4.0, out: str | Path | None = None
) -> dict[str, Any]:
    """Frequency `omega` (rad/s) of an arm whose hinge stands still; durations (s) of the turns by
    `angle` (rad), and by the names of the arms the amplitude (m) of what vibrates at the end.
    """
    omega = sc.modes(arms({"still": 1.0}, 0.0), count=1, t=0.0).omega[0]
    durations = {"hasty": HASTY / omega, "tuned": TUNED / omega}
    model = arms(durations, angle)
    history = sc.simulate(model, sc.EnergyMomentum(), sc.NullSpace(), step, until)
    across = np.array([-np.sin(angle), np.cos(angle), 0])
    result = {"omega": omega, "durations": durations}
    for name, T in durations.items():
        side = history.position(model[name].node("arm.end")) @ across
        result[name] = float(np.ptp(side[history.times > T]) / 2)
    if out is not None:
        history.animate(out, fps=12, window=(480, 270))
    return result


if __name__ == "__main__":
    result = main(out=PICTURE)
    for name, T in result["durations"].items():
        print(f"{name} arm: turned in {T:.2f} s, swings on by {1e3 * result[name]:.1f} mm")
    print(f"picture: {PICTURE}")
