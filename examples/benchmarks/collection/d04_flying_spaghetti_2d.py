"""D4: as D3 in a plane and five times as flexible, the loads on at once and off at once.

Waves with kinks run to and fro for ever and limit the order, whatever the elements: positions at
t = 2 gain 3.2 and 2.4 powers of two from 8 to 16 to 32 cubic elements, where smooth loads would
give six (steps of 1/1280 s). It shows robustness, not orders.
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

ENTRIES = ("D4_flying_spaghetti_2D_EI100",)
QUICK = ("1", "2")
INPUTS = {
    **{"L": 10.0, "EA": 1e4, "GA": 1e4, "EI": 100.0, "A_rho": 1.0, "J_rho": 10.0},
    **{"force": (8.0, 0.0, 0.0), "moment": (0.0, 0.0, -80.0), "t_end": 2.5},
}
DERIVED = {
    "GJ": lambda d: d["EI"],  # does not matter in a plane
    "start": lambda d: (0.6 * d["L"], 0.0, 0.0),
    "end": lambda d: (0.0, 0.8 * d["L"], 0.0),
}


def scene(data: dict[str, Any], elements: int, order: int) -> runs.Scene:
    """Force (also in the plane, or its part along e1) and moment (or its part about e3) last until
    ``t_end``.
    """
    mesh = members.halves(data["start"], data["end"], elements, order)
    middle = (np.array(data["start"]) + data["end"]) / 2
    model = sc.Model()
    rod = model.add("rod", members.beam(mesh, data, order, e2=(0, 0, 1)))
    loaded = rod.node("rod.start")
    on = sc.FunctionOfTime(lambda t: float(t < data["t_end"]), kinks=(data["t_end"],))
    moment = data["moment"] if np.ndim(data["moment"]) else (0.0, 0.0, data["moment"])
    force = np.atleast_1d(np.asarray(data["force"], dtype=float))
    force = np.pad(force, (0, max(0, 3 - len(force))))
    model.add("force", sc.LoadForce(loaded, force, on))
    model.add("moment", sc.LoadMoment(loaded, moment, on))
    places = {"loaded": loaded, "free": rod.node("rod.end"), "mid": rod.node(middle)}
    return runs.Scene(model.freeze(), places, kinks=(data["t_end"],))


PROBLEM = dynamics.Problem(
    ENTRIES[0],
    INPUTS,
    scene,
    elements=(128, 64, 40, 32),
    step=1 / 80,
    levels=2,
    tolerance=1e-5,
    derived=DERIVED,
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
        return PROBLEM.rows("D04", times, elements=16, ladder=(1 / 40, 2))
    return PROBLEM.rows("D04")
