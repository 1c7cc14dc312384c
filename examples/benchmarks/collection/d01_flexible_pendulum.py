"""D1: a rubber rod, held out level on a hinge, is let go and swings down.

Gravity is there at once (``rise``: within how many seconds it rises smoothly, for orders in space)
and sends waves along the rod; velocities at its tip are therefore good to four digits at most.
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

ENTRIES = ("D1_flexible_pendulum",)
QUICK = ("0.1", "0.2")
INPUTS = {"E": 5e6, "nu": 0.5, "rho": 1100.0, "r": 5e-3, "L": 1.0, "g": 9.81, "rise": 0.0}
DERIVED = {
    "G": lambda d: d["E"] / (2 * (1 + d["nu"])),
    "A": lambda d: np.pi * d["r"] ** 2,
    "I": lambda d: np.pi * d["r"] ** 4 / 4,
    "EA": lambda d: d["E"] * d["A"],
    "GA": lambda d: d["G"] * d["A"],  # no shear factor
    "EI": lambda d: d["E"] * d["I"],
    "GJ": lambda d: 2 * d["G"] * d["I"],
    "A_rho": lambda d: d["rho"] * d["A"],
    "J_rho": lambda d: (2 * d["rho"] * d["I"], d["rho"] * d["I"]),
}


def scene(data: dict[str, Any], elements: int, order: int) -> runs.Scene:
    """The hinge turns about e3."""
    mesh = sc.MeshCurve.init_line((0, 0, 0), (data["L"], 0, 0), elements, name="rod")
    model = sc.Model()
    rod = model.add("rod", members.beam(mesh, data, order, e2=(0, 1, 0)))
    hinge = sc.JointRevolute(sc.ground((0, 0, 0)), rod.node("rod.start"), axis=(0, 0, 1))
    model.add("hinge", hinge)
    amplitude = members.rise(data["rise"]) if data["rise"] > 0 else None
    model.add("gravity", sc.LoadGravity((0, -data["g"], 0), amplitude))
    return runs.Scene(model.freeze(), {"tip": rod.node("rod.end")}, kinks=(data["rise"],))


def read(now: dynamics.Instant, data: dict[str, Any]) -> dict[str, Any]:
    """Position and velocity of the tip in its plane."""
    return {"tip": now.pos["tip"][:2], "vel": now.vel["tip"][:2]}


PROBLEM = dynamics.Problem(
    ENTRIES[0],
    INPUTS,
    scene,
    elements=(128, 64, 48, 32),
    step=1 / 3200,
    levels=3,
    tolerance=1e-7,
    derived=DERIVED,
    read=read,
    signed=("nu", "g", "rise"),
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
    """See :mod:`.common`; of each instant ``tip`` (x, y) and its velocity ``vel``."""
    return PROBLEM.answer(case, data, order, elements, step, integrator, treatment, times)


def rows(quick: bool = True) -> list[dict[str, Any]]:
    """All instants; quick: the first ones, on a coarser mesh with larger steps."""
    if quick:
        times = [float(t) for t in QUICK]
        return PROBLEM.rows("D01", times, elements=16, ladder=(1 / 800, 2))
    return PROBLEM.rows("D01")
