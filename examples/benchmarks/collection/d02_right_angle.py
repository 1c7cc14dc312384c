"""D2: a right-angle cantilever is pushed out of its plane and let go (Simo & Vu-Quoc 1988).

Two legs, along e1 and then e2, clamped at the origin; a dead force along e3 acts on the elbow, a
triangle in time (``pulse="bump"``: smooth, for orders in space). Once it has ended the energy is
constant, 114.8803456.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import skfem_cosserat as sc
from collection import dynamics, members, runs

__all__ = ["ENTRIES", "PROBLEM", "QUICK", "main", "rows", "scene"]

ENTRIES = ("D2_right_angle_cantilever",)
QUICK = ("1", "2")
INPUTS = {
    **{"L": 10.0, "EA": 1e6, "GA": 1e6, "EI": 1e3, "GJ": 1e3, "A_rho": 1.0},
    **{"J_rho": (20.0, 10.0, 10.0), "peak": 50.0, "t_peak": 1.0, "t_end": 2.0},
    "pulse": "triangle",
}


def scene(data: dict[str, Any], elements: int, order: int) -> runs.Scene:
    """`elements` in each leg."""
    L = data["L"]
    corners = [(0, 0, 0), (L, 0, 0), (L, L, 0)]
    mesh = sc.MeshCurve.init_polyline(corners, elements, name="frame", nodes={"elbow": 0.5})
    model = sc.Model()
    frame = model.add("frame", members.beam(mesh, data, order, e2=(0, 0, 1)))
    elbow, tip = frame.node("elbow"), frame.node("frame.end")
    model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), frame.node("frame.start")))
    pulse, kinks = members.pulse(data)
    model.add("force", sc.LoadForce(elbow, (0, 0, 1), pulse))
    places = {"elbow": elbow, "tip": tip}
    return runs.Scene(model.freeze(), places, kinks)


PROBLEM = dynamics.Problem(
    ENTRIES[0],
    INPUTS,
    scene,
    elements=(64, 32, 16, 12),
    step=1 / 160,
    levels=3,
    tolerance=1e-8,
    signed=("peak",),
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
    """See :mod:`.common`; of each instant ``pos`` and ``quat`` (elbow, tip) and ``energy``."""
    return PROBLEM.answer(case, data, order, elements, step, integrator, treatment, times)


def rows(quick: bool = True) -> list[dict[str, Any]]:
    """All instants; quick: the first ones, on a coarser mesh with larger steps."""
    if quick:
        times = [float(t) for t in QUICK]
        return PROBLEM.rows("D02", times, elements=5, ladder=(1 / 40, 3))
    return PROBLEM.rows("D02")
