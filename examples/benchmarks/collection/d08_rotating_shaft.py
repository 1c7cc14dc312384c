"""D8: a shaft with an eccentric disk is spun up through its critical speed (Bauchau et al. 2016).

The left end is held and turned, the right one slides and turns in its bearing; gravity sets in on
the straight shaft at rest. The reference's energy is that of the shaft, without the disk's.
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

ENTRIES = ("D8_rotating_shaft",)
QUICK = ("0.05", "0.1")
INPUTS = {
    **{"L": 6.0, "EA": 3.134e8, "GA": 6.05e7, "GJ": 2.727e5, "EI": 3.545e5, "A_rho": 11.64},
    **{"J_rho": (2.634e-2, 1.317e-2), "g": 9.81},
    "disk": {"mass": 70.573, "J": (2.0325, 1.0163, 1.0163), "offset": 0.05},
    **{"omega": 60.0, "A1": 0.8, "A2": 1.2, "T1": 0.5, "T2": 1.0, "T3": 1.25},
}


def angle(t: float, data: dict[str, Any]) -> float:
    """The left end's: speed ``omega A1`` from T1 to T2, ``omega A2`` from T3 on."""
    low, high = data["omega"] * data["A1"], data["omega"] * data["A2"]
    T1, T2, T3 = data["T1"], data["T2"], data["T3"]

    def ramp(t: float, T: float) -> float:
        """Integral of (1 - cos(pi t/T))/2, and of 1 beyond T."""
        if t >= T:
            return t - T / 2
        return (t - T / np.pi * np.sin(np.pi * t / T)) / 2

    return float(low * ramp(t, T1) + (high - low) * ramp(max(t - T2, 0.0), T3 - T2))


def scene(data: dict[str, Any], elements: int, order: int) -> runs.Scene:
    """The disk sits on the shaft's middle, its centre ``offset`` along e3."""
    bare, _ = _model(data, elements, order)
    model, mid = _model(data, elements, order)
    disk = data["disk"]
    J1, J2, J3 = disk["J"]
    centre = (0.0, disk["offset"], 0.0)  # in (d1, d2, d3) = (e2, e3, e1)
    model.add("disk", sc.RigidBody(disk["mass"], (J2, J3, J1), center=centre, on=mid))
    kinks = (data["T1"], data["T2"], data["T3"])
    return runs.Scene(model.freeze(), {"mid": mid}, kinks, part=bare.freeze())


def _model(data: dict[str, Any], elements: int, order: int) -> tuple[sc.Model, sc.Place]:
    """Without the disk, and its place."""
    if not 0 < data["T1"] <= data["T2"] < data["T3"]:
        raise sc.InputError("data", "expected 0 < T1 <= T2 < T3")
    L = data["L"]
    mesh = members.halves((0, 0, 0), (L, 0, 0), elements, order)
    model = sc.Model()
    shaft = model.add("shaft", members.beam(mesh, data, order, e2=(0, 1, 0)))
    turning = sc.Motion(rotation=lambda t: (angle(t, data), 0.0, 0.0))
    model.add("drive", sc.JointFixed(sc.ground((0, 0, 0), turning), shaft.node("rod.start")))
    bearing = sc.JointCylindrical(sc.ground((L, 0, 0)), shaft.node("rod.end"), axis=(1, 0, 0))
    model.add("bearing", bearing)
    model.add("gravity", sc.LoadGravity((0, 0, -data["g"])))
    return model, shaft.node((L / 2, 0, 0))


PROBLEM = dynamics.Problem(
    ENTRIES[0],
    INPUTS,
    scene,
    elements=(64, 24, 12, 8),
    step=1 / 4000,
    levels=4,
    tolerance=1e-8,
    signed=("g", "A1", "A2", "omega", "offset"),
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
    """See :mod:`.common`; of each instant ``pos`` and ``quat`` (mid) and ``energy``."""
    return PROBLEM.answer(case, data, order, elements, step, integrator, treatment, times)


def rows(quick: bool = True) -> list[dict[str, Any]]:
    """All instants; quick: the first ones, on a coarser mesh with larger steps."""
    if quick:
        times = [float(t) for t in QUICK]
        return PROBLEM.rows("D08", times, elements=6, ladder=(1 / 2000, 2))
    return PROBLEM.rows("D08")
