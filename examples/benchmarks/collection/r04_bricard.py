"""R4: Bricard's linkage along six edges of a cube (A04 of the IFToMM benchmark library).

Inputs: joints ``P0`` to ``P5`` (m) and their ``axes`` (six vectors, or letters as in "yzxyzx");
``L`` scales the joints' default places; mass ``m`` (kg) of each rod and its ``width`` (m), gravity
``g`` (m/s^2, downwards along y, or a vector). Link P5P0 is fixed; the others start from rest.

Field over ``t``: ``P3``. A case is the entry's name, one of its keys, or an instant (s). From rest
and with one degree of freedom the motion is periodic; where it turns (near 5 and 10 s) an error in
phase shows squared only. :mod:`paper.six_body_linkage` has other linkages of the family.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
sys.path.insert(1, str(Path(__file__).resolve().parents[2]))

import skfem_cosserat as sc
from collection import common, inputs, motion
from paper import six_body_linkage

ENTRIES = ("R4_bricard",)
QUICK = ("0.5",)
CORNERS = np.array([[0, 0, 0], [1, 0, 0], [1, -1, 0], [1, -1, 1], [0, -1, 1], [0, 0, 1]], float)
DATA = {
    **{f"P{k}": x for k, x in enumerate(CORNERS)},
    **{"axes": "yzxyzx", "L": 1.0, "m": 1.0, "width": 0.1, "g": 9.81},
}


def scene(data: Mapping[str, Any] | None = None) -> sc.System:
    """Six rods in a ring; their inertia is that of uniform square ones."""
    d, given = common.overridden(DATA, data), data or {}
    length = inputs.number("L", d["L"], beyond=0.0)
    names = [f"P{k}" for k in range(6)]
    points = [inputs.vector(n, d[n]) * (1.0 if n in given else length) for n in names]
    return six_body_linkage.linkage(
        points,
        axes(d["axes"]),
        inputs.number("m", d["m"], beyond=0.0),
        inputs.number("width", d["width"], beyond=0.0),
        inputs.gravity(d["g"], axis=1),
    )


def axes(value: Any) -> Any:
    """Unit vectors (6, 3) of letters or of vectors."""
    if isinstance(value, str) and set(value) <= set("xyz"):
        value = [np.eye(3)["xyz".index(letter)] for letter in value]
    if isinstance(value, str) or len(value) != 6:
        raise sc.InputError("data", f"axes = {value!r}, expected six of x, y, z or six vectors")
    found = np.array([inputs.vector("axes", axis) for axis in value])
    return found / np.linalg.norm(found, axis=1)[:, None]


def read(track: motion.Track) -> dict[str, Any]:
    """Joint P3, the far end of its link."""
    link: Any = track.system.structures[3]
    length = 2 * np.linalg.norm(link.position - track.system.joints[4].a.position)
    frames = track.frames("link 3")[track.ids]
    return {"P3": frames[:, 0] + length / 2 * frames[:, 3]}


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
    """Fold and unfold; see :mod:`.common` and the top of this file."""
    method = inputs.method(order, elements, step, integrator, treatment, times)
    values = common.entry(ENTRIES[0])["values"]
    _, instant = inputs.chosen(case, ENTRIES, values)
    d, system = common.overridden(DATA, data), scene(data)
    rods = np.diff([system.joints[k + 1].a.position for k in range(6)], axis=0)
    longest = np.linalg.norm(rods, axis=1).max()
    problem = motion.Problem(system, read, motion.coarsest(longest, d["g"]) / 1.6)
    return motion.answer(problem, method, values["t"], instant)


def rows(quick: bool = True) -> list[dict[str, Any]]:
    """Its part of the table."""
    result = main(times=[float(t) for t in QUICK] if quick else None)
    return motion.table("R04", ENTRIES[0], result, ["P3"], digits=8)
