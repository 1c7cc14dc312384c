"""D3: a free rod in space is thrown and spun by a force and a moment at one end, and let go.

The moment is about axes fixed in space. A plane section has the sum of the other two moments of
inertia about its normal, this one 10 about all three axes: :class:`.members.SolidBeam`. After
t = 5 the energy is 908.7347, the linear momentum 50 e1, the centre of mass at 3 + 5 (t - 2.5).
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

ENTRIES = ("D3_flying_spaghetti_3D",)
QUICK = ("1", "2")
INPUTS = {
    **{"L": 10.0, "EA": 1e4, "GA": 1e4, "EI": 500.0, "GJ": 500.0, "A_rho": 1.0},
    **{"J_rho": (10.0, 10.0, 10.0), "peak": 200.0, "t_peak": 2.5, "t_end": 5.0},
    **{"force": (0.1, 0.0, 0.0), "moment": (0.0, 0.5, 1.0), "pulse": "triangle"},
}
DERIVED = {
    "start": lambda d: (0.6 * d["L"], 0.0, 0.0),
    "end": lambda d: (0.0, 0.8 * d["L"], 0.0),
}


def scene(data: dict[str, Any], elements: int, order: int, lumped: bool = False) -> runs.Scene:
    """``force`` and ``moment`` are factors of the pulse at the end that is loaded.

    `lumped`: masses at the nodes, as explicit schemes need them.
    """
    mesh = members.halves(data["start"], data["end"], elements, order)
    middle = (np.array(data["start"]) + data["end"]) / 2
    model = sc.Model()
    rod = model.add("rod", members.beam(mesh, data, order, e2=(0, 0, 1), lumped=lumped))
    loaded = rod.node("rod.start")
    pulse, kinks = members.pulse(data)
    model.add("force", sc.LoadForce(loaded, data["force"], pulse))
    model.add("moment", sc.LoadMoment(loaded, data["moment"], pulse))
    places = {"loaded": loaded, "free": rod.node("rod.end"), "mid": rod.node(middle)}
    return runs.Scene(model.freeze(), places, kinks)


PROBLEM = dynamics.Problem(
    ENTRIES[0],
    INPUTS,
    scene,
    elements=(128, 64, 32, 24),
    step=1 / 160,
    levels=3,
    tolerance=5e-7,
    derived=DERIVED,
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
    """See :mod:`.common`; ``pos`` and ``quat`` (loaded, free, mid) and ``energy``."""
    return PROBLEM.answer(case, data, order, elements, step, integrator, treatment, times)


def rows(quick: bool = True) -> list[dict[str, Any]]:
    """All instants; quick: the first ones, on a coarser mesh with larger steps."""
    if quick:
        times = [float(t) for t in QUICK]
        return PROBLEM.rows("D03", times, elements=12, ladder=(1 / 40, 3))
    return PROBLEM.rows("D03")
