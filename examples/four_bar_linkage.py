"""A motor drives a four-bar linkage: a closed loop of rigid bodies, with a spring on its rocker.

A drive prescribes the crank's angle, so that the linkage has no freedom left. The four hinges are
spatial ones: three of their constraints are redundant in a plane loop, and the package finds that
out by itself. The angle of the rocker has to agree with plane geometry (two circles that
intersect), and the work of the motor with the energy of the linkage.

Run ``python examples/four_bar_linkage.py``; look at the moment of the motor in the picture.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

import skfem_cosserat as sc

PICTURE = Path(__file__).with_name("pictures") / "four_bar_linkage.png"
#: the hinges in the reference (m): ground, crank to coupler, coupler to rocker, ground
POINTS = np.array([[0, 0, 0], [0, 0.3, 0], [1.0, 0.8, 0], [1.0, 0, 0]])


def crank_angle(t: float) -> float:
    """Angle (rad) that the motor prescribes: from rest up to 6 rad/s."""
    return 6 * t**2 / (1 + t)


def rocker_by_geometry(crank: np.ndarray) -> np.ndarray:
    """Angle (rad) of the rocker from its reference: its end is where two circles intersect."""
    a, b, c, d = POINTS[:, :2]
    angle = np.arctan2(*(b - a)[::-1]) + crank
    end = a + np.linalg.norm(b - a) * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    coupler, rocker = np.linalg.norm(c - b), np.linalg.norm(c - d)
    across = d - end
    reach = np.linalg.norm(across, axis=-1, keepdims=True)
    along = (coupler**2 - rocker**2 + reach**2) / (2 * reach)
    side = np.sqrt(coupler**2 - along**2)
    normal = np.stack([-across[..., 1], across[..., 0]], axis=-1) / reach
    arm = end + along * across / reach + side * normal - d
    return np.unwrap(np.arctan2(arm[..., 1], arm[..., 0])) - np.arctan2(*(c - d)[::-1])


def main(step: float = 5e-3, until: float = 2.0, out: str | Path | None = None) -> dict[str, Any]:
    """Run up: angles (rad), largest errors of the closure (rad) and of the energy (J), moments."""
    model = sc.Model()
    ends = [sc.ground(POINTS[0])]
    for name, a, b in zip(("crank", "coupler", "rocker"), POINTS, POINTS[1:], strict=False):
        size = (0.05, 0.05, float(np.linalg.norm(b - a)))
        bar = sc.RigidBody.box(1.0, size, position=(a + b) / 2, triad=sc.triad(b - a))
        model.add(name, bar)
        ends += [bar.at(a), bar.at(b)]
    ends.append(sc.ground(POINTS[3]))
    axis = (0, 0, 1)
    pins = [sc.JointRevolute(a, b, axis) for a, b in zip(ends[::2], ends[1::2], strict=True)]
    for k, pin in enumerate(pins):
        model.add(f"pin {k}", pin)
    model.add("motor", sc.JointDrive(pins[0], crank_angle))
    model.add("spring", sc.JointSpringDamper(pins[3], stiffness=2.0, damping=0.1))

    system = model.freeze()
    history = sc.simulate(system, sc.EnergyMomentum(), sc.NullSpace(), step, until)
    # pin 3 turns from the rocker to the ground: the rocker turns by minus that angle
    crank, rocker = history["joint/pin 0/angle"], -history["joint/pin 3/angle"]
    moment = history["joint/motor/moment"][:, 2]
    if out is not None:
        draw(history, rocker, moment, out)
    return {
        "unknowns": system.unknowns,
        "crank": crank,
        "rocker": rocker,
        "closure": float(abs(rocker - rocker_by_geometry(crank)).max()),
        "balance": float(abs(history["energy_balance"]).max()),
        "moment": moment,
        "history": history,
    }


def draw(history: sc.History, rocker: np.ndarray, moment: np.ndarray, path: str | Path) -> None:
    """Angles and the moment of the motor."""
    figure, (upper, lower) = sc.figures.panels(8, 5, 2, 1, sharex=True)
    upper.plot(history.times, history["joint/pin 0/angle"], label="crank")
    upper.plot(history.times, rocker, label="rocker")
    upper.set(ylabel="angle in rad")
    sc.figures.legend(upper)
    lower.plot(history.times, moment)
    lower.set(xlabel="time in s", ylabel="moment of the motor in N m")
    sc.figures.write_figure(figure, path)


if __name__ == "__main__":
    result = main(out=PICTURE)
    print(f"unknowns of a step: {result['unknowns']} (the motor prescribes the motion)")
    print(f"rocker swings from {result['rocker'].min():.3f} to {result['rocker'].max():.3f} rad")
    print(f"difference from plane geometry: {result['closure']:.1e} rad")
    print(f"largest moment of the motor: {abs(result['moment']).max():.1f} N m")
    print(f"error of the energy balance: {result['balance']:.1e} J\npicture: {PICTURE}")
