"""R6: Andrews' squeezing mechanism, seven bodies in the plane, data of Schiehlen's handbook.

Inputs: all of the entry's ``params`` under their names (SI units): masses ``m1`` to ``m7``, moments
of inertia ``I1`` to ``I7``, lengths, places of the supports A, B and C, the spring's ``c0`` and
``l0``, the torque ``mom``; and ``q0``, the angles (beta, Theta, gamma, Phi, delta, Omega, epsilon)
at the start, from rest. Where lengths are overridden and ``q0`` is not, it keeps beta and closes
the loops anew, next to the entry's position.

Field over ``t``: ``q``, the seven angles (rad), counted on over turns; ``q0``;
``literature_t0p03``, the last of them, where 0.03 s is among the instants. A case is the entry's
name, one of its keys, or an instant (s).
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from scipy.optimize import fsolve

import skfem_cosserat as sc
from collection import common, inputs, motion

ENTRIES = ("R6_andrews",)
QUICK = ("0.005",)
ANGLES = ("beta", "Theta", "gamma", "Phi", "delta", "Omega", "epsilon")
Z = np.array([0.0, 0.0, 1.0])
#: mismatch of a loop (m) that counts as closed
CLOSED = 1e-9


def defaults() -> dict[str, Any]:
    """Inputs of the entry."""
    values = common.entry(ENTRIES[0])["values"]
    return {**values["params"], "q0": values["q0"]}


def along(angle: float) -> Any:
    """Unit vector at this angle."""
    return np.array([np.cos(angle), np.sin(angle), 0.0])


def across(angle: float) -> Any:
    """A quarter of a turn behind it."""
    return np.array([np.sin(angle), -np.cos(angle), 0.0])


def gaps(q: Any, d: Mapping[str, float]) -> Any:
    """By how much the three loops through E, over B, H and G, are open (6,), in m."""
    beta, theta, gamma, phi, delta, omega, epsilon = q
    E = d["rr"] * along(beta) - d["d"] * along(beta + theta)
    over_b = np.array([d["xb"], d["yb"], 0]) + d["ss"] * across(gamma)
    A = np.array([d["xa"], d["ya"], 0])
    over_h = A + d["zt"] * along(delta) + d["e"] * across(phi + delta)
    over_g = A + d["u"] * across(epsilon) + d["zf"] * along(omega + epsilon)
    return np.concatenate([(E - x)[:2] for x in (over_b, over_h, over_g)])


def start(d: Mapping[str, Any], given: Mapping[str, Any]) -> Any:
    """Angles (7,) that close the loops.

    Raises
    ------
    InputError
        If those given do not, or none are found.
    """
    q0 = inputs.vector("q0", d["q0"], 7)
    if "q0" not in given and abs(gaps(q0, d)).max() > 1e-12:
        found = fsolve(lambda x: gaps([q0[0], *x], d), q0[1:], xtol=1e-14, full_output=True)
        q0 = np.array([q0[0], *found[0]])
    gap = abs(gaps(q0, d)).max()
    if not gap < CLOSED:
        raise sc.InputError("data", f"q0 = {q0.tolist()} leaves loops open by {gap:.3g} m")
    return q0


def bodies(d: Mapping[str, float], q0: Any) -> tuple[dict[int, Any], dict[str, Any]]:
    """Angle of d1, reference point and centre of mass from there of each body; the hinges."""
    beta, theta, gamma, phi, delta, omega, epsilon = q0
    x = {"O": np.zeros(3)}
    x |= {name: np.array([d["x" + name.lower()], d["y" + name.lower()], 0.0]) for name in "ABC"}
    x["F"] = d["rr"] * along(beta)
    x["E"] = x["F"] - d["d"] * along(beta + theta)
    x["H"], x["G"] = x["A"] + d["zt"] * along(delta), x["A"] + d["u"] * across(epsilon)
    x["D"] = x["B"] + d["sc"] * across(gamma) + d["sd"] * along(gamma)
    t4, t6 = phi + delta, omega + epsilon
    table = {
        1: (beta, x["O"], d["ra"] * along(beta)),
        2: (beta + theta, x["F"], -d["da"] * along(beta + theta)),
        3: (gamma, x["B"], d["sa"] * across(gamma) + d["sb"] * along(gamma)),
        4: (t4, x["H"], (d["e"] - d["ea"]) * across(t4)),
        5: (delta, x["A"], d["ta"] * along(delta) + d["tb"] * across(delta)),
        6: (t6, x["G"], (d["zf"] - d["fa"]) * along(t6)),
        7: (epsilon, x["A"], d["ua"] * across(epsilon) + d["ub"] * along(epsilon)),
    }
    return table, x


def scene(data: Mapping[str, Any] | None = None, motor: str = "actuator") -> sc.System:
    """Seven bodies, ten hinges of which four are redundant loops in the plane, a spring, a motor.

    Parameters
    ----------
    motor : {"actuator", "moment", "none"}
        Torque on the first hinge, or as a load on the first body.
    """
    d = common.overridden(defaults(), data)
    d |= {name: inputs.number(name, x) for name, x in d.items() if name != "q0"}
    table, x = bodies(d, start(d, data or {}))
    model, b = sc.Model(), {}
    for k, (angle, place, arm) in table.items():
        triad = np.array([along(angle), -across(angle), Z])
        euler = (d[f"I{k}"] / 2, d[f"I{k}"] / 2, 0)
        where = {"position": place, "triad": triad, "center": triad @ arm}
        b[k] = model.add(f"K{k}", sc.RigidBody(d[f"m{k}"], euler=euler, **where))
    grounds = {name: sc.ground(x[name]) for name in "OAB"}
    hinges = [("O", 1, "O"), (1, 2, "F"), (2, 3, "E"), ("B", 3, "B"), (2, 4, "E"), (4, 5, "H")]
    hinges += [("A", 5, "A"), (2, 6, "E"), (6, 7, "G"), ("A", 7, "A")]
    for i, j, name in hinges:
        side = grounds[i] if isinstance(i, str) else b[i].at(x[name])
        hinge = model.add(f"{i}-{j}", sc.JointRevolute(side, b[j].at(x[name]), Z))
        if i == "O" and motor == "actuator":
            model.add("motor", sc.JointActuator(hinge, d["mom"]))
    if motor == "moment":
        model.add("motor", sc.LoadMoment(b[1].at(x["O"]), (0, 0, d["mom"])))
    spring = sc.SpringDamper(b[3].at(x["D"]), sc.ground(x["C"]), d["c0"], length=d["l0"])
    model.add("spring", spring)
    return model.freeze()


def read(track: motion.Track) -> dict[str, Any]:
    """The seven angles."""
    a = [np.zeros(0)]
    for k in range(1, 8):
        d1 = track.frames(f"K{k}")[:, 1]
        a.append(motion.angles(d1[:, 0], d1[:, 1]))
    out = [a[1], a[2] - a[1], a[3], a[4] - a[5], a[5], a[6] - a[7], a[7]]
    return {"q": np.column_stack(out)[track.ids]}


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
    """Squeeze; see :mod:`.common` and the top of this file."""
    method = inputs.method(order, elements, step, integrator, treatment, times)
    values = common.entry(ENTRIES[0])["values"]
    _, instant = inputs.chosen(case, ENTRIES, values)
    system = scene(data)
    result = motion.answer(
        motion.Problem(system, read, coarsest=2e-4), method, values["t"], instant
    )
    d = common.overridden(defaults(), data)
    result["q0"] = start(d, data or {}).tolist()
    instants = np.atleast_1d(result["t"])
    last = np.flatnonzero(abs(instants - 0.03) < 1e-12)
    if len(last):
        result["literature_t0p03"] = np.atleast_2d(result["q"])[last[0]].tolist()
    return result


def rows(quick: bool = True) -> list[dict[str, Any]]:
    """Its part of the table."""
    result = main(times=[float(t) for t in QUICK] if quick else None)
    return motion.table("R06", ENTRIES[0], result, ["q"], digits=12)
