"""Five scenes as plain numbers, for this package and for its peers: see peers/README.md.

*rod*: a rubber rod on a hinge swings down, drawn out of its plane by gravity, half a second.
*spaghetti*: D3, the free rod that is thrown and spun by a force and a moment on its end, which grow
and fall within 5 s (Simo & Vu-Quoc's "flying spaghetti" in space).
*swing*: the three-bar swing of the paper, in axes of its own: the plane of motion is that of the
first two; half a second, the pulse ends at 0.25 s.
*four-bar*: a closed loop of a rigid crank and a rigid rocker, which a strip of polyamide couples; a
moment spins up the crank within 0.2 s.
*blade*: the blade of a 15 MW wind turbine, 117 m, clamped: a gust of 2 s bends its tip by metres,
while its axial waves pass an element within milliseconds. The IEA 15 MW reference turbine (Gaertner
et al., NREL/TP-5000-75698, 2020; file IEA-15-240-RWT_BeamDyn_blade.dat, Apache License 2.0): its
section constants in the middles of eight equal stretches, interpolated between its stations, about
the elastic centre (EI = K_ii - K_i3^2 / EA), rounded to five digits; coupling terms, offsets,
twist and prebend are left out.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))

import measuring

BLADE = [  # GA_1, GA_2, EA, EI_1, EI_2, GJ; mass; moments of inertia about d1, d2, d3
    [3.6304e9, 4.874e9, 3.1479e10, 9.1876e10, 8.0329e10, 4.6277e10, 1998.5, 6194.4, 4865.5],
    [5.7869e8, 1.3009e9, 2.1004e10, 3.8578e10, 2.3358e10, 4.0952e9, 764.26, 2129.4, 595.75],
    [2.154e8, 3.412e8, 2.1471e10, 2.6675e10, 1.2683e10, 5.8559e8, 477.51, 1127.1, 191.29],
    [1.4388e8, 3.1125e8, 2.099e10, 1.757e10, 7.0461e9, 3.0544e8, 412.16, 692.68, 97.768],
    [9.3406e7, 2.9475e8, 1.8579e10, 1.0524e10, 3.3637e9, 1.5808e8, 339.7, 398.84, 44.902],
    [5.8435e7, 3.6584e8, 1.4509e10, 3.2218e9, 1.4824e9, 7.7437e7, 233.02, 132.98, 19.387],
    [3.4201e7, 3.4133e8, 6.613e9, 9.7888e8, 4.0221e8, 3.4412e7, 118.09, 42.543, 5.7648],
    [1.1821e7, 1.0128e8, 1.5712e9, 2.6376e8, 5.438e7, 8.4583e6, 39.514, 12.036, 0.98327],
]


def _scene(until: float, sample: float, beam: dict[str, Any], **more: Any) -> dict[str, Any]:
    """With what the others have, empty; the end of the beam is watched."""
    empty: dict[str, Any] = {"bodies": [], "joints": [], "points": [], "loads": []}
    base = {"beams": [beam], **empty, "gravity": [0.0, 0.0, 0.0]}
    watch = ["beams", 0, len(beam["nodes"]) - 1]
    return {**base, "watch": watch, "until": until, "sample": sample, **more}


def _beam(start: Any, end: Any, elements: int, director: Any, numbers: Any) -> dict[str, Any]:
    """A straight beam; numbers: stiffness, mass, moments of inertia about d1, d2 and perhaps d3."""
    if elements % len(numbers):
        raise ValueError(f"{elements} elements are no multiple of {len(numbers)} sections")
    nodes = np.linspace(np.array(start, dtype=float), end, elements + 1)
    table = np.broadcast_to(np.array(numbers, dtype=float), (len(numbers), len(numbers[0])))
    table = np.repeat(table, elements // len(table), axis=0) if len(table) > 1 else table
    J = table[:, 7:] if table.shape[1] > 9 else np.c_[table[:, 7:], table[:, 7:].sum(axis=1)]
    constants = {"stiffness": table[:, :6], "mass": table[:, 6], "inertia": J}
    plain = {name: each.tolist() for name, each in constants.items()}
    return {"nodes": nodes.tolist(), "director": [float(x) for x in director], **plain}


def _joint(kind: str, a: Any, b: Any, position: Any, axis: Any = (0.0, 0.0, 1.0)) -> dict[str, Any]:
    where = {"position": [float(x) for x in position], "axis": list(axis)}
    return {"kind": kind, "a": a, "b": b, **where}


def _bar(low: Any, high: Any, mass: float, centre: float, along: float, across: float) -> Any:
    """A rigid body along a line, its centre at a part of it; moments of inertia."""
    low, high = np.array(low, dtype=float), np.array(high, dtype=float)
    t = (high - low) / np.linalg.norm(high - low)
    inertia = across * (np.eye(3) - np.outer(t, t)) + along * np.outer(t, t)
    place = low + centre * (high - low)
    return {"mass": mass, "position": place.tolist(), "inertia": inertia.tolist()}


def rod(elements: int, until: float = 0.5, sample: float = 0.0125) -> dict[str, Any]:
    """The rubber rod on a hinge."""
    section = measuring.rubber()
    own = [*section.stiffness.diagonal(), section.mass, *section.inertia[::-1]]
    beam = _beam((0, 0, 0), (measuring.LENGTH, 0, 0), elements, (0, 1, 0), [own])
    joints = [_joint("revolute", None, ["beams", 0, 0], (0, 0, 0))]
    return _scene(until, sample, beam, joints=joints, gravity=list(measuring.GRAVITY))


def spaghetti(elements: int) -> dict[str, Any]:
    """The free rod in space."""
    own = [1e4, 1e4, 1e4, 500, 500, 500, 1, 10, 10, 10]
    beam = _beam((6, 0, 0), (0, 8, 0), elements, (0, 0, 1), [own])
    pulse = {"times": [0.0, 2.5, 5.0], "factors": [0.0, 200.0, 0.0]}
    load = {"on": ["beams", 0, 0], "force": [0.1, 0.0, 0.0], "moment": [0.0, 0.5, 1.0], **pulse}
    return _scene(5.0, 0.1, beam, loads=[load])


def swing(elements: int) -> dict[str, Any]:
    """The three-bar swing as published."""
    span, height, middle = 0.72, 0.36, ["beams", 0, elements // 2]
    own = [175480.7692, 175480.7692, 547500, 114.0625, 10.2656, 13.7401, 7500, 0.1406, 1.5625]
    beam = _beam((0, 0, 0), (span, 0, 0), elements, (0, 1, 0), [own])
    ends = (((0, 0, 0), (0, height, 0)), ((span, 0, 0), (span + height, height, 0)))
    bodies, joints = [], []
    for k, (low, high) in enumerate(ends):  # square pyramids
        squared = float(np.sum(np.subtract(high, low) ** 2))
        across = 0.01 * (0.02**2 / 20 + 3 * squared / 80)
        bodies.append(_bar(low, high, 0.01, 1 / 4, 0.01 * 0.02**2 / 10, across))
        joints.append(_joint("revolute", ["bodies", k], ["beams", 0, k * elements], low))
        joints.append(_joint("spherical", None, ["bodies", k], high))
    pulse = {"times": [0.0, 0.125, 0.25], "factors": [0.0, 1e4, 0.0]}
    load = {"on": middle, "force": [1.0, 0.0, 0.0], "moment": [0.0, 0.0, 0.0], **pulse}
    parts = {"bodies": bodies, "joints": joints, "points": [{"mass": 5.0, "on": middle}]}
    return _scene(0.5, 0.025, beam, **parts, loads=[load], watch=middle)


def four_bar(elements: int) -> dict[str, Any]:
    """Crank, coupler and rocker; the middle of the coupler is watched."""
    A, B, C, D = (0, 0, 0), (0, 0.3, 0), (1.0, 0.8, 0), (1.0, 0, 0)
    wide, thick, E, nu, rho = 0.02, 0.006, 2e9, 0.4, 1100.0  # polyamide
    area, flat, upright = wide * thick, wide * thick**3 / 12, thick * wide**3 / 12
    shear = E / 2 / (1 + nu) * 5 / 6 * area
    torsion = E / 2 / (1 + nu) * wide * thick**3 / 3 * (1 - 0.63 * thick / wide)
    own = [shear, shear, E * area, E * upright, E * flat, torsion, rho * area]
    beam = _beam(
        B,
        C,
        elements,
        np.cross((0, 0, 1), np.subtract(C, B)) / np.hypot(1, 0.5),
        [[*own, rho * upright, rho * flat]],
    )
    lengths = (0.3, 0.8)
    bodies = [
        _bar(low, high, length, 0.5, 1e-4, length**3 / 12)
        for (low, high), length in zip(((A, B), (D, C)), lengths, strict=True)
    ]
    joints = [
        _joint("revolute", None, ["bodies", 0], A),
        _joint("revolute", ["bodies", 0], ["beams", 0, 0], B),
        _joint("revolute", ["bodies", 1], ["beams", 0, elements], C),
        _joint("revolute", None, ["bodies", 1], D),
    ]
    pulse = {"times": [0.0, 0.1, 0.2], "factors": [0.0, 2.0, 0.0]}
    load = {"on": ["bodies", 0], "force": [0.0] * 3, "moment": [0.0, 0.0, 1.0], **pulse}
    watch = ["beams", 0, elements // 2]
    parts = {"bodies": bodies, "joints": joints, "loads": [load], "watch": watch}
    return _scene(1.0, 0.05, beam, **parts)


def blade(elements: int) -> dict[str, Any]:
    """The blade, a multiple of eight elements."""
    beam = _beam((0, 0, 0), (0, 0, 117.0), elements, (1, 0, 0), BLADE)
    pulse = {"times": [0.0, 1.0, 2.0], "factors": [0.0, 1e5, 0.0]}
    tip = ["beams", 0, elements]
    load = {"on": tip, "force": [1.0, 0.5, 0.0], "moment": [0.0, 0.0, 0.0], **pulse}
    joints = [_joint("fixed", None, ["beams", 0, 0], (0, 0, 0))]
    return _scene(4.0, 0.1, beam, joints=joints, loads=[load])


#: by name
SCENES: dict[str, Callable[[int], dict[str, Any]]] = {
    "rod": rod,
    "spaghetti": spaghetti,
    "swing": swing,
    "four-bar": four_bar,
    "blade": blade,
}
