"""R2: heavy top of Bruels & Cardona, and the steady precession of a symmetric top.

``R2_heavy_top_BC2010`` (default): mass ``m`` (kg), inertia ``J_com`` about the centre of mass
(kg m^2; principal values or a tensor), centre of mass ``X`` from the fixed point in the body (m),
gravity ``g`` (m/s^2, downwards along z, or a vector), start ``q0`` (w, x, y, z, or "identity") and
angular velocity ``Omega0`` in the body (rad/s). Fields over ``t``: ``state``, that is quaternion
and angular velocity in the body, and the place ``com`` of the centre of mass. Cases: the entry's
name, its keys, an instant (s).

``R2_steady_precession``: ``m``, arm ``l`` (m), ``g``, moments of inertia ``A`` and ``C`` about the
fixed point, across and along the axis, ``theta`` from the vertical (rad), ``Omega3`` along the
axis (rad/s). Cases "slow" and "fast": the top starts with that root of
``A cos(theta) w^2 - C Omega3 w + m g l = 0`` and the run measures the mean rate until its last
instant, in the field "slow" or "fast"; over ``t`` it gives ``psi``, the angle turned about the
vertical, and ``theta``. The entry's name stands for both cases; it gives the rates alone.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import skfem_cosserat as sc
from collection import common, inputs, motion

ENTRIES = ("R2_heavy_top_BC2010", "R2_steady_precession")
QUICK = ("0.1", "slow", "fast")
DATA = {
    "m": 15.0,
    "J_com": (0.234375, 0.46875, 0.234375),
    "X": (0.0, 1.0, 0.0),
    "g": 9.81,
    "q0": "identity",
    "Omega0": (0.0, 150.0, -4.61538),
}
STEADY = {"m": 1.0, "l": 0.5, "g": 9.81, "A": 0.4, "C": 0.1, "theta": 0.5, "Omega3": 40.0}
#: of a steady precession at the last instant, where none are given: angle turned (rad)
TURNED = 0.5


def _pinned(top: sc.RigidBody, gravity: Any) -> sc.System:
    model = sc.Model()
    model.add("top", top)
    model.add("pin", sc.JointSpherical(sc.ground((0, 0, 0)), top.at((0, 0, 0))))
    model.add("gravity", sc.LoadGravity(gravity))
    return model.freeze()


def scene(data: Mapping[str, Any] | None = None) -> sc.System:
    """A body held at its reference point."""
    d = common.overridden(DATA, data)
    triad = inputs.triad("q0", d["q0"])
    top = sc.RigidBody(
        inputs.number("m", d["m"], beyond=0.0),
        d["J_com"],
        center=inputs.vector("X", d["X"]),
        triad=triad,
        angular_velocity=inputs.vector("Omega0", d["Omega0"]) @ triad,
    )
    return _pinned(top, inputs.gravity(d["g"], axis=2))


def precession(data: Mapping[str, Any] | None = None) -> dict[str, float]:
    """Both rates (rad/s) of closed form; "fast" is infinite for a horizontal axis.

    Raises
    ------
    InputError
        If the top turns too slowly to precess steadily at this angle.
    """
    d = {name: inputs.number(name, x) for name, x in common.overridden(STEADY, data).items()}
    a, b, c = d["A"] * np.cos(d["theta"]), d["C"] * d["Omega3"], d["m"] * d["g"] * d["l"]
    if b * b < 4 * a * c or b == 0:
        least = np.sqrt(max(4 * a * c, 0.0)) / d["C"]
        raise sc.InputError(
            "data", f"Omega3 = {d['Omega3']:g}, expected above {least:g}: no steady precession"
        )
    half = 0.5 * (b + np.sign(b) * np.sqrt(b * b - 4 * a * c))
    return {"slow": c / half, "fast": half / a if abs(a) > 1e-14 * d["A"] else np.inf}


def steady(rate: float, data: Mapping[str, Any] | None = None) -> sc.System:
    """The symmetric top, leaning towards x, with this rate of precession about z (rad/s)."""
    d = {name: inputs.number(name, x) for name, x in common.overridden(STEADY, data).items()}
    axis = np.array([np.sin(d["theta"]), 0.0, np.cos(d["theta"])])
    omega = np.array([0, 0, rate]) + (d["Omega3"] - rate * axis[2]) * axis
    across = d["A"] - d["m"] * d["l"] ** 2
    top = sc.RigidBody(
        d["m"],
        (across, across, d["C"]),
        position=d["l"] * axis,
        triad=sc.triad(axis, (0, 1, 0)),
        velocity=np.cross(omega, d["l"] * axis),
        angular_velocity=omega,
    )
    return _pinned(top, inputs.gravity(d["g"], axis=2))


def read(track: motion.Track) -> dict[str, Any]:
    """Quaternion and angular velocity; centre of mass."""
    frames, rates = track.frames("top"), track.rates("top")
    there, top = frames[track.ids], track.system.structures[0]
    state = np.c_[motion.quaternions(frames)[track.ids], motion.spin(there, rates)]
    return {"state": state, "com": there[:, 0] + top.center @ there[:, 1:]}


def read_axis(track: motion.Track) -> dict[str, Any]:
    """How far the axis has turned about the vertical, and its angle to it."""
    axis = track.frames("top")[:, 3]
    psi = motion.angles(axis[:, 0], axis[:, 1])
    tilt = np.arctan2(np.hypot(axis[:, 0], axis[:, 1]), axis[:, 2])
    return {"psi": (psi - psi[0])[track.ids], "theta": tilt[track.ids]}


def main(
    case: str | float | None = None,
    data: Mapping[str, Any] | None = None,
    order: int = 3,
    elements: int | None = None,
    step: float | None = None,
    integrator: str = "energy-momentum",
    treatment: str = "null-space",
    times: Sequence[float] | None = None,
) -> dict[str, Any]:
    """Spin; see :mod:`.common` and the top of this file."""
    method = inputs.method(order, elements, step, integrator, treatment, times)
    if case == ENTRIES[1]:
        both = [
            main(name, data, order, elements, step, integrator, treatment, times)
            for name in ("slow", "fast")
        ]
        return _together(both)
    if case in ("slow", "fast"):
        return _precessing(str(case), data, method)
    values = common.entry(ENTRIES[0])["values"]
    _, instant = inputs.chosen(case, ENTRIES, {**values, "slow": 0, "fast": 0})
    system, omega = scene(data), common.overridden(DATA, data)["Omega0"]
    coarsest = min(0.05, 0.25 / max(np.linalg.norm(inputs.vector("Omega0", omega)), 1e-9))
    problem = motion.Problem(system, read, coarsest)
    return motion.answer(problem, method, values["t"], instant)


def _precessing(case: str, data: Mapping[str, Any] | None, method: inputs.Method) -> dict[str, Any]:
    rate = precession(data)[case]
    if not np.isfinite(rate):
        raise sc.InputError("data", "a horizontal axis has no fast precession, expected 'slow'")
    spin = max(abs(inputs.number("Omega3", common.overridden(STEADY, data)["Omega3"])), abs(rate))
    until = TURNED / abs(rate)
    problem = motion.Problem(steady(rate, data), read_axis, coarsest=0.25 / spin)
    result = motion.answer(problem, method, [until / 2, until])
    result[case] = result["psi"][-1] / result["t"][-1]
    return result


def _together(results: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Both rates, what they took together, and the smaller step."""
    total = {name: sum(r[name] for r in results) for name in ("cost_s", "newton_iterations")}
    slow, fast = results
    return {
        "slow": slow["slow"],
        "fast": fast["fast"],
        **total,
        "unknowns": slow["unknowns"],
        "converged": slow["converged"] and fast["converged"],
        "order": None,
        "elements": None,
        "step": min(slow["step"], fast["step"]),
    }


def rows(quick: bool = True) -> list[dict[str, Any]]:
    """Its part of the table."""
    result = main(times=[0.1] if quick else None)
    out = motion.table("R02", ENTRIES[0], result, ["state", "com"])
    for case in ("slow", "fast"):
        reference = {case: common.entry(ENTRIES[1])["values"][case]}
        found = main(case)
        out += common.tabled("R02", found, common.compare(case, found, reference, 1e-12))
    return out
