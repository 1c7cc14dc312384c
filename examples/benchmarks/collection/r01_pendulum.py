"""R1: spherical pendulum, a mass point on a rod without mass.

Inputs: length ``l`` (m), mass ``m`` (kg), gravity ``g`` (m/s^2, downwards along z, or a vector),
start ``x0`` (m) and velocity ``v0`` (m/s), across the rod. A new `l` alone shortens or lengthens
``x0``; a new ``x0`` alone sets the length.

Fields over ``t``: ``state``, that is x y z and their rates. A case is the entry's name, one of its
keys, or an instant (s).
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

ENTRIES = ("R1_spherical_pendulum",)
QUICK = ("1", "2")
DATA = {"l": 1.0, "m": 1.0, "g": 9.81, "x0": (np.sqrt(3) / 2, 0.0, -0.5), "v0": (0.0, 2.0, 0.0)}


def scene(data: Mapping[str, Any] | None = None) -> sc.System:
    """The bob at the end of its rod."""
    d, given = common.overridden(DATA, data), data or {}
    x0 = inputs.vector("x0", d["x0"])
    length = inputs.number("l", d["l"], beyond=0.0)
    if "x0" in given and "l" not in given:
        length = inputs.number("length of x0", np.linalg.norm(x0), beyond=0.0)
    elif "x0" not in given:
        x0 = length * x0
    v0 = inputs.vector("v0", d["v0"])
    model = sc.Model()
    bob = sc.MassPoint(inputs.number("m", d["m"], beyond=0.0), x0, velocity=v0)
    model.add("bob", bob)
    model.add("rod", sc.JointDistance(sc.ground((0, 0, 0)), bob.place(), length=length))
    model.add("gravity", sc.LoadGravity(inputs.gravity(d["g"], axis=2)))
    return model.freeze()


def read(track: motion.Track) -> dict[str, Any]:
    """Position and velocity."""
    return {"state": np.c_[track.q[track.ids], track.v]}


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
    """Swing; see :mod:`.common` and the top of this file."""
    method = inputs.method(order, elements, step, integrator, treatment, times)
    values = common.entry(ENTRIES[0])["values"]
    _, instant = inputs.chosen(case, ENTRIES, values)
    system = scene(data)
    rod: Any = system.joints[0]
    gravity = common.overridden(DATA, data)["g"]
    speed = np.linalg.norm(system.structures[0].velocity)
    problem = motion.Problem(system, read, motion.coarsest(rod.length, gravity, speed))
    return motion.answer(problem, method, values["t"], instant)


def rows(quick: bool = True) -> list[dict[str, Any]]:
    """Its part of the table."""
    result = main(times=[float(t) for t in QUICK] if quick else None)
    return motion.table("R01", ENTRIES[0], result, ["state"])
