"""S13: strains do not see rotations, and an equilibrium does not know how it was reached.

The 45-degree bend of S3. There is no entry: the targets are zero, to 1e-12.

``case``: "objectivity" or "path"; default: both. ``data``: P, turns, axis (of the rotations,
default: a random one of a fixed seed). Gives

- strain_change: of a bend under follower loads while its clamp turns, found anew after each turn,
- strain_change_superposed: of a deformed state turned as a whole, a seventh of a turn after the
  other,
- left_position, left_strain: after loading and unloading (relative to R; strain),
- ways_apart: ends of three ways to the same two forces, one first, the other first, both at once
  (relative to R).
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np

sys.path.extend(str(Path(__file__).resolve().parents[k]) for k in (1, 2))

import static_scenes

import skfem_cosserat as sc
from collection import statics
from skfem_cosserat import diagnostics
from skfem_cosserat.kernels import exp_quaternion, rotation_matrix

ENTRIES = ()
FIELDS = (
    *("strain_change", "strain_change_superposed"),
    *("left_position", "left_strain", "ways_apart"),
)
CASES = ("objectivity", "path")
QUICK = CASES
R = 100.0
DATA = {
    "P": 600.0,
    "turns": 10,
    "axis": tuple(np.random.default_rng(13).standard_normal(3).tolist()),
}
ELEMENTS = {1: 32, 2: 16, 3: 8, 4: 6}


def turning_bend(
    elements: int = 4, order: int = 3, P: float = 600.0, axis: Any = DATA["axis"]
) -> static_scenes.Scene:
    """The bend under follower loads up to load factor 1; then its clamp turns, ten turns a unit."""
    E1, E2 = np.eye(3)[:2]
    turn = 20 * np.pi * np.asarray(axis, dtype=float) / np.linalg.norm(axis)
    mesh = sc.MeshCurve.init_arc((0, 0, 0), E1, E2, R, np.pi / 4, elements, name="rod")
    model = sc.Model()
    rod = model.add("rod", sc.Beam(mesh, _section(), order=order))
    start, end = rod.node("rod.start"), rod.node("rod.end")
    turning = sc.Motion(rotation=lambda t: max(0.0, t - 1.0) * turn)
    model.add("clamp", sc.JointFixed(sc.ground(start.position, turning), start))
    ramp = sc.Table([0, 1], [0, 1])
    model.add("force", sc.LoadForce(end, (0, 0, P), ramp, follower=True))
    model.add("moment", sc.LoadMoment(end, (3e3, -2e3, 1e4), ramp, follower=True))
    return static_scenes.Scene(model.freeze(), rod, end)


def two_forces(elements: int = 8, order: int = 3, P: float = 600.0) -> static_scenes.Scene:
    """The bend under two dead forces at its tip, "up" and "in"."""
    forces = {"up": (0.0, 0.0, P), "in": (-P / 2, P / 3, 0.0)}
    return static_scenes.arc(elements, order, _section(), forces)


def _section() -> sc.Section:
    return static_scenes.flat_section(1e7 / 12, 1e7, 5e6, 1e7 / 12, 5e6 / 6)


def superposed(scene: static_scenes.Scene, q: Any, turns: int, axis: Any) -> float:
    """Largest change of a strain when a state is turned, a seventh of a turn after the other."""
    before = diagnostics.section_strains(scene.system, scene.beam, q)
    unit = np.asarray(axis, dtype=float)[None] / np.linalg.norm(axis)
    turn = rotation_matrix(exp_quaternion(2 * np.pi / 7 * unit))[0]
    y, worst = q.reshape(-1, 3), 0.0
    for _ in range(7 * turns):
        y = y @ turn.T
        change = diagnostics.section_strains(scene.system, scene.beam, y.ravel()) - before
        worst = max(worst, float(abs(change).max()))
    return worst


def main(
    case: Any = None,
    data: dict[str, Any] | None = None,
    order: int = 3,
    elements: int | None = None,
    step: float | None = None,
    integrator: str = "energy-momentum",
    treatment: str = "null-space",
    times: Any = None,
) -> dict[str, Any]:
    """One of both, or both. See :mod:`.common` for the arguments."""
    key = statics.chosen(case, CASES, "")
    d = statics.inputs(DATA, data)
    if not isinstance(d["turns"], int) or np.shape(d["axis"]) != (3,) or not np.any(d["axis"]):
        wanted = "expected a whole number of turns and an axis of three components, not all zero"
        raise sc.InputError("data", f"turns = {d['turns']!r}, axis = {d['axis']!r}, {wanted}")

    def compute(asked: statics.Asked) -> dict[str, Any]:
        found = {}
        if key != "path":
            found |= _objectivity(asked, d)
        if key != "objectivity":
            found |= _path(asked, d["P"])
        return found

    return statics.answer(
        compute, FIELDS, ELEMENTS, order, elements, step, integrator, treatment, times
    )


def _objectivity(asked: statics.Asked, d: dict[str, Any]) -> dict[str, float]:
    scene = turning_bend(asked.elements, asked.order, d["P"], d["axis"])
    control = sc.LoadControl(at=[1.0, *(1 + np.arange(1, d["turns"] + 1) / 10)])
    strain = asked.path(scene, control, derive=True)["beam/rod/strain"]
    dead = static_scenes.bend(asked.elements, asked.order, d["P"])
    bent = asked.path(dead)["q"][-1]
    return {
        "strain_change": float(abs(strain[2:] - strain[1]).max()),
        "strain_change_superposed": superposed(dead, bent, d["turns"], d["axis"]),
    }


def _path(asked: statics.Asked, P: float) -> dict[str, float]:
    scene = static_scenes.bend(asked.elements, asked.order, P)
    start = sc.equilibrium(scene.system, asked.path(scene))
    back = asked.path(scene, sc.LoadControl(until=0.0), start=start, derive=True)
    both = two_forces(asked.elements, asked.order, P)
    first, last = sc.Table([0, 0.5], [0, 1]), sc.Table([0.5, 1], [0, 1])
    ways = [{}, {"up": first, "in": last}, {"up": last, "in": first}]
    ends = [asked.path(both, factors=way)["q"][-1] for way in ways]
    return {
        "left_position": float(abs(back["q"][-1] - scene.system.q0).max()) / R,
        "left_strain": float(abs(back["beam/rod/strain"][-1]).max()),
        "ways_apart": max(float(abs(q - ends[0]).max()) for q in ends) / R,
    }


def rows(quick: bool = True) -> list[dict[str, Any]]:
    """Both, against zero."""
    zeros = {"objectivity": dict.fromkeys(FIELDS[:2], 0.0), "path": dict.fromkeys(FIELDS[2:], 0.0)}
    return statics.table("S13", main, zeros, 12, QUICK if quick else None, least=1.0)
