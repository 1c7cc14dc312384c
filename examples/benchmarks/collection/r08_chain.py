"""R8: a chain of N thin rods, hinged in the plane, falling from rest. There is no R7.

Inputs: number ``N``, length ``l`` (m) and mass ``m`` (kg) of each rod, gravity ``g`` (m/s^2,
downwards along y), angles ``theta0`` of the rods from +x at the start (rad; one number or N; 0 is
horizontal, negative below).

Fields over ``t``: ``state``, the N absolute angles, counted on over turns, then their N rates; the
same under the names of the reference's columns, ``taylor_longdouble`` and ``DOP853_rtol2e-14``;
``tip``, the free end in the plane. A case is an entry's name, that name with any other N
("R8_chain_N3"), a key of the values, or an instant (s); without an entry N is 2.

The motion is chaotic from two rods on: an error of rounding has grown to 1e-4 after 10 s with five
rods. ``estimated_error`` says at which instants the numbers mean something: of two rods to 6 s.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import skfem_cosserat as sc
from collection import common, inputs, motion

COUNTS = (2, 1, 5)
ENTRIES = tuple(f"R8_chain_N{n}" for n in COUNTS)
QUICK = ENTRIES
#: instants of the short table (s)
INSTANTS = {1: (0.5, 1.0), 2: (0.5,), 5: (0.5,)}
DATA = {"N": 2, "l": 1.0, "m": 1.0, "g": 9.81, "theta0": 0.0}
NAMES = ("state", "taylor_longdouble", "DOP853_rtol2e-14")
#: until when an entry is trusted (s), and digits from an instant on
DIGITS = {1: {0.0: 12}, 2: {0.0: 11, 8.0: 8}, 5: {0.0: 12, 4.0: 10, 5.0: 9, 6.0: 8}}
LAST = {5: 6.0}


def scene(data: Mapping[str, Any] | None = None) -> sc.System:
    """Rods from the origin on."""
    d = common.overridden(DATA, data)
    number = inputs.count("N", d["N"])
    length, mass = (inputs.number(name, d[name], beyond=0.0) for name in ("l", "m"))
    theta = d["theta0"] if np.ndim(d["theta0"]) else [d["theta0"]] * number
    model, end, before = sc.Model(), np.zeros(3), None
    for k, angle in enumerate(inputs.vector("theta0", theta, number)):
        along = np.array([np.cos(angle), np.sin(angle), 0.0])
        place = {"position": end + length / 2 * along, "triad": sc.triad(along, (0, 0, 1))}
        rod = model.add(f"rod {k}", sc.RigidBody.rod(mass, length, **place))
        side = sc.ground(end) if before is None else before.at(end)
        model.add(f"hinge {k}", sc.JointRevolute(side, rod.at(end), (0, 0, 1)))
        before, end = rod, end + length * along
    model.add("gravity", sc.LoadGravity((0, -inputs.number("g", d["g"]), 0)))
    return model.freeze()


def read(track: motion.Track) -> dict[str, Any]:
    """Angles, rates and the tip."""
    n, ids = len(track.system.structures), track.ids
    axes = track.q.reshape(-1, n, 12)[:, :, 9:11]
    theta = np.column_stack([motion.angles(*axes[:, k].T) for k in range(n)])[ids]
    d, rates = axes[ids], track.v.reshape(-1, n, 12)[:, :, 9:11]
    rate = d[:, :, 0] * rates[:, :, 1] - d[:, :, 1] * rates[:, :, 0]
    state = np.c_[theta, rate]
    places = track.q.reshape(-1, n, 12)[ids, :, :2]
    joints = [np.zeros((len(ids), 2))]
    for k in range(n):
        joints.append(2 * places[:, k] - joints[-1])
    return {"state": state, "tip": joints[-1]}


def entry_name(number: int) -> str:
    """Of the chain of so many rods."""
    return f"R8_chain_N{number}"


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
    """Fall; see :mod:`.common` and the top of this file."""
    method = inputs.method(order, elements, step, integrator, treatment, times)
    named = re.fullmatch(r"R8_chain_N([1-9]\d*)", case) if isinstance(case, str) else None
    values = common.entry(ENTRIES[0])["values"]
    instant = None if named else inputs.chosen(case, ENTRIES, {**values, "state": 0})[1]
    d = common.overridden({**DATA, **({"N": int(named[1])} if named else {})}, data)
    system = scene(d)
    own = motion.coarsest(inputs.number("l", d["l"]), inputs.number("g", d["g"]))
    problem = motion.Problem(system, read, coarsest=own / (1 + len(system.structures)))
    result = motion.answer(problem, method, values["t"], instant)
    return {**result, **dict.fromkeys(NAMES, result["state"])}


def digits(number: int, t: float) -> float:
    """Digits of an entry that are trusted at an instant."""
    return [n for since, n in DIGITS[number].items() if since <= t][-1]


def rows(quick: bool = True) -> list[dict[str, Any]]:
    """Its part of the table; five rods until 6 s, where digits are stated."""
    out = []
    for number in COUNTS:
        name = entry_name(number)
        known = [t for t in common.entry(name)["values"]["t"] if t <= LAST.get(number, np.inf)]
        result = main(name, times=INSTANTS[number] if quick else known)
        fields = ["taylor_longdouble", "tip"]
        out += motion.table("R8", name, result, fields, lambda t, n=number: digits(n, t))
    return out
