"""D6: a four-bar linkage whose third hinge is out of line by five degrees (Bauchau et al. 2016).

Rigid bars could not move; these bend and twist. Layout, as far as it is not printed with the data:
hinges at A (0, 0, 0), B (0, 0.12, 0), C (0.24, 0.12, 0), D (0.24, 0, 0), axes along e3, that of C
turned by ``tilt`` about e1; the crank AB turns about -e3 at constant speed from the start, where
the linkage moves as a parallelogram does, as far as the hinges let it. (Of the tilts about e1 and
e2, either way, only this one gives what others computed.) Their stored run is called good for two
digits: compare, no pass or fail.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import skfem_cosserat as sc
from collection import dynamics, members, runs

__all__ = ["ENTRIES", "PROBLEM", "QUICK", "main", "rows", "scene"]

ENTRIES = ("D6_fourbar",)
QUICK = ("1.0000",)
STRONG = {
    **{"EA": 5.2992e7, "GA": 1.68803e7, "GJ": 733.488, "EI": 1130.5, "A_rho": 1.9968},
    "J_rho": (8.51968e-5, 4.25984e-5),
}
INPUTS = {
    "bar 1": {"L": 0.12, **STRONG},
    "bar 2": {"L": 0.24, **STRONG},
    "bar 3": {
        **{"L": 0.12, "EA": 1.3248e7, "GA": 4.22008e6, "GJ": 45.843, "EI": 70.656},
        **{"A_rho": 0.4992, "J_rho": (5.3248e-6, 2.6624e-6)},
    },
    **{"Omega": 0.6, "tilt": np.radians(5.0)},
}


def scene(data: dict[str, Any], elements: int, order: int) -> runs.Scene:
    """`elements` in every bar."""
    bars, Omega, tilt = [data[f"bar {k}"] for k in (1, 2, 3)], data["Omega"], data["tilt"]
    A, B = np.zeros(3), np.array([0.0, bars[0]["L"], 0.0])
    C = B + (bars[1]["L"], 0, 0)
    D = C - (0, bars[2]["L"], 0)
    turn = np.array([0, 0, -Omega])
    starts = {  # velocities of a parallelogram
        "bar 1": {"velocity": lambda x: np.cross(turn, x - A), "angular_velocity": turn},
        "bar 2": {"velocity": np.cross(turn, B - A)},
        "bar 3": {"velocity": lambda x: np.cross(turn, x - D), "angular_velocity": turn},
    }
    model, beams = sc.Model(), []
    for (name, start), ends, bar in zip(
        starts.items(), ((A, B), (B, C), (C, D)), bars, strict=True
    ):
        mesh = sc.MeshCurve.init_line(*ends, elements, name="bar")
        member = members.beam(mesh, bar, order, e2=(0, 0, 1), **start)
        beams.append(model.add(name, member))
    turning = sc.Motion(rotation=lambda t: (0.0, 0.0, -Omega * t))
    model.add("A", sc.JointFixed(sc.ground(A, turning), beams[0].node("bar.start")))
    ends = [*(b.node(which) for b in beams for which in ("bar.start", "bar.end")), sc.ground(D)]
    along, tilted = (0, 0, 1), (0, -np.sin(tilt), np.cos(tilt))
    for name, k, axis in (("B", 1, along), ("C", 3, tilted), ("D", 5, along)):
        model.add(name, sc.JointRevolute(ends[k], ends[k + 1], axis=axis))
    system = model.freeze()
    start = sc.initial_state(system, v=sc.project(system, system.q0, system.v0))
    places = {"node C (bar 2 end)": ends[3], "node C (bar 3 end)": ends[4]}
    frames = {  # e1 along the bar, e3 out of the plane
        "node C (bar 2 end)": np.eye(3),
        "node C (bar 3 end)": np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]),
    }
    return runs.Scene(system, places, start=start, frames=frames)


PROBLEM = dynamics.Problem(
    ENTRIES[0],
    INPUTS,
    scene,
    elements=(16, 8, 4, 4),
    step=1 / 250,
    levels=2,
    tolerance=1e-4,
    signed=("Omega", "tilt"),
)


def main(
    case: str | float | None = None,
    data: dict[str, Any] | None = None,
    order: int = 3,
    elements: int | None = None,
    step: float | None = None,
    integrator: str = "energy-momentum",
    treatment: str = "null-space",
    times: list[float] | None = None,
) -> dict[str, Any]:
    """See :mod:`.common`; a case is a place: position and quaternion by instants."""
    return PROBLEM.tracks(case, data, order, elements, step, integrator, treatment, times)


def rows(quick: bool = True) -> list[dict[str, Any]]:
    """All instants; quick: the first ones, on a coarser mesh with larger steps."""
    if quick:
        times = [float(t) for t in QUICK]
        return PROBLEM.rows("D06", times, elements=2, ladder=(1 / 100, 2))
    return PROBLEM.rows("D06")
