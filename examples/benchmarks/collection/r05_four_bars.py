"""R5: a row of N four-bar windows, through singular positions (A02 of the IFToMM library).

Inputs: number ``N`` of windows, length ``l`` (m) and mass ``m`` (kg) of each thin rod, gravity
``g`` (m/s^2, downwards along y), at the start the speed ``vx`` of B0 (m/s, clockwise) and the angle
``phi`` of the columns from the vertical (rad, clockwise). Three of the rows of each loop of spatial
hinges are redundant; wherever all rods lie on one line another motion would be possible, and the
parallelograms go on.

Fields over ``t``: ``phi_omega``, that is the columns' angle, counted on over turns, and its rate;
``B0``, the end of the first column in the plane. A case is the entry's name, one of its keys, or
an instant (s).
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

ENTRIES = ("R5_A02_fourbar_N2",)
QUICK = ("1",)
DATA = {"N": 2, "l": 1.0, "m": 1.0, "g": 9.81, "vx": 1.0, "phi": 0.0}
Z = (0, 0, 1)


def scene(data: Mapping[str, Any] | None = None) -> sc.System:
    """Columns A0B0, A1B1 ... on hinges, beams B0B1, B1B2 ... between their ends."""
    d = common.overridden(DATA, data)
    windows = inputs.count("N", d["N"])
    length, mass = (inputs.number(name, d[name], beyond=0.0) for name in ("l", "m"))
    speed, angle, g = (inputs.number(name, d[name]) for name in ("vx", "phi", "g"))
    up = np.array([np.sin(angle), np.cos(angle), 0.0])
    spin = np.array([0.0, 0.0, -speed / length])
    feet = [np.array([k * length, 0.0, 0.0]) for k in range(windows + 1)]
    model = sc.Model()

    def rod(name: str, start: Any, along: Any, velocity: Any, omega: Any) -> sc.RigidBody:
        place = {"position": start + length / 2 * along, "triad": sc.triad(along, Z)}
        body = sc.RigidBody.rod(mass, length, **place, velocity=velocity, angular_velocity=omega)
        return model.add(name, body)

    turning = np.cross(spin, length / 2 * up), spin
    columns = [rod(f"column {k}", foot, up, *turning) for k, foot in enumerate(feet)]
    for k, foot in enumerate(feet):
        model.add(f"A{k}", sc.JointRevolute(sc.ground(foot), columns[k].at(foot), Z))
    for k, foot in enumerate(feet[:-1]):
        start = foot + length * up
        beam = rod(f"beam {k}", start, np.eye(3)[0], 2 * turning[0], (0, 0, 0))
        for i in (0, 1):
            corner = feet[k + i] + length * up
            hinge = sc.JointRevolute(columns[k + i].at(corner), beam.at(corner), Z)
            model.add(f"B{k + i} {k}", hinge)
    if g:
        model.add("gravity", sc.LoadGravity((0, -g, 0)))
    return model.freeze()


def read(track: motion.Track) -> dict[str, Any]:
    """Of the first column, which starts within half a turn from the vertical."""
    frames, rates = track.frames("column 0"), track.rates("column 0")
    axis, ids = frames[:, 3], track.ids
    there, moving = axis[ids], rates[:, 3]
    rate = moving[:, 0] * there[:, 1] - there[:, 0] * moving[:, 1]
    foot = track.system.joints[0].a.position
    return {
        "phi_omega": np.c_[motion.angles(axis[:, 1], axis[:, 0])[ids], rate],
        "B0": foot[:2] + 2 * (frames[ids, 0] - foot)[:, :2],
    }


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
    """Turn over; see :mod:`.common` and the top of this file."""
    method = inputs.method(order, elements, step, integrator, treatment, times)
    values = common.entry(ENTRIES[0])["values"]
    _, instant = inputs.chosen(case, ENTRIES, values)
    system, d = scene(data), common.overridden(DATA, data)
    length, *rest = (inputs.number(name, d[name]) for name in ("l", "g", "vx"))
    problem = motion.Problem(system, read, motion.coarsest(length, *rest) / 1.6)
    return motion.answer(problem, method, values["t"], instant)


def rows(quick: bool = True) -> list[dict[str, Any]]:
    """Its part of the table."""
    result = main(times=[float(t) for t in QUICK] if quick else None)
    return motion.table("R05", ENTRIES[0], result, ["phi_omega", "B0"])
