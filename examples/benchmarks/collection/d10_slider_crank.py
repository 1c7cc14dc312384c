"""D10: a flexible slider-crank; the crank is turned ever faster for 5 s and stopped dead.

Crank along e1 from the origin, rod beyond it, the rod's end slides along e1 without mass. The
stored run of others is good for two digits: compare, no pass or fail.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np

import skfem_cosserat as sc

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from collection import dynamics, members, runs

__all__ = ["ENTRIES", "PROBLEM", "QUICK", "main", "rows", "scene"]

ENTRIES = ("D10_slider_crank",)
QUICK = ("1.0000",)
INPUTS = {
    **{"crank": 10.0, "rod": 20.0, "EA": 1.12e10, "GA": 1.493e10, "EI": 1.493e8},
    **{"A_rho": 432.0, "J_rho": 5.7591, "rate": 6 * np.pi / 50, "T": 5.0},
}
DERIVED = {"GJ": lambda d: d["EI"]}  # does not matter in a plane


def angle(t: float, data: dict[str, Any]) -> float:
    """The crank's: angular acceleration ``rate`` (rad/s^2) up to ``T``, then held."""
    return float(data["rate"] * min(t, data["T"]) ** 2 / 2)


def scene(data: dict[str, Any], elements: int, order: int) -> runs.Scene:
    """`elements` in each of both."""
    crank_end, rod_end = (data["crank"], 0, 0), (data["crank"] + data["rod"], 0, 0)
    model = sc.Model()
    crank, rod = (
        model.add(
            name,
            members.beam(members.halves(a, b, elements, order), data, order, e2=(0, 1, 0)),
        )
        for name, a, b in (("crank", (0, 0, 0), crank_end), ("rod", crank_end, rod_end))
    )
    turning = sc.Motion(rotation=lambda t: (0.0, 0.0, angle(t, data)))
    model.add("motor", sc.JointFixed(sc.ground((0, 0, 0), turning), crank.node("rod.start")))
    pin = sc.JointRevolute(crank.node("rod.end"), rod.node("rod.start"), axis=(0, 0, 1))
    model.add("pin", pin)
    slider = sc.JointPointOnLine(sc.ground((0, 0, 0)), rod.node("rod.end"), axis=(1, 0, 0))
    model.add("slider", slider)
    places = {
        "M crank middle": crank.node((data["crank"] / 2, 0, 0)),
        "N rod middle": rod.node((data["crank"] + data["rod"] / 2, 0, 0)),
    }
    return runs.Scene(model.freeze(), places, kinks=(data["T"],))


PROBLEM = dynamics.Problem(
    ENTRIES[0],
    INPUTS,
    scene,
    elements=(16, 8, 4, 4),
    step=1 / 200,
    levels=3,
    tolerance=1e-4,
    derived=DERIVED,
    signed=("rate",),
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
        return PROBLEM.rows("D10", times, elements=2, ladder=(1 / 100, 2))
    return PROBLEM.rows("D10")
