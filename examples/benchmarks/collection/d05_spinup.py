"""D5: a beam is spun up about its root until it turns steadily (Kane; Simo & Vu-Quoc 1986).

Turning steadily, it is stretched by ``L (tan(k L)/(k L) - 1)``, ``k = Omega sqrt(A_rho/EA)``.
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

ENTRIES = ("D5_spinup",)
QUICK = ("2.5",)
INPUTS = {
    **{"L": 10.0, "EA": 2.8e7, "GA": 1e7, "EI": 1.4e4, "A_rho": 1.2, "J_rho": 6e-4},
    **{"Omega": 6.0, "T": 15.0},
}
DERIVED = {"GJ": lambda d: d["EI"]}  # does not matter in a plane


def angle(t: float, data: dict[str, Any]) -> float:
    """The root's: its rate rises to ``Omega`` within ``T`` as smoothly as 1 - cos."""
    Omega, T = data["Omega"], data["T"]
    if t >= T:
        return float(Omega * (t - T / 2))
    turn = 2 * np.pi / T
    return float(Omega / T * (t**2 / 2 + (np.cos(turn * t) - 1) / turn**2))


def scene(data: dict[str, Any], elements: int, order: int) -> runs.Scene:
    """The root is built into ground that turns."""
    mesh = sc.MeshCurve.init_line((0, 0, 0), (data["L"], 0, 0), elements, name="beam")
    model = sc.Model()
    blade = model.add("blade", members.beam(mesh, data, order, e2=(0, 1, 0)))
    root, tip = blade.node("beam.start"), blade.node("beam.end")
    turning = sc.Motion(rotation=lambda t: (0.0, 0.0, angle(t, data)))
    model.add("shaft", sc.JointFixed(sc.ground((0, 0, 0), turning), root))
    return runs.Scene(model.freeze(), {"root": root, "tip": tip}, kinks=(data["T"],))


def read(now: dynamics.Instant, data: dict[str, Any]) -> dict[str, Any]:
    """Also the tip's displacement and rotation as the root sees them."""
    psi = angle(now.t, data)
    x, y, _ = now.pos["tip"]
    w, _, _, z = now.quat["tip"]
    back = 2 * np.arctan2(z, w) - psi
    seen = {
        "psi": psi,
        "u_rel": [
            float(np.cos(psi) * x + np.sin(psi) * y - data["L"]),
            float(np.cos(psi) * y - np.sin(psi) * x),
        ],
        "theta_rel": float(np.arctan2(np.sin(back), np.cos(back))),
    }
    return {**dynamics.all_of(now, data), **seen}


PROBLEM = dynamics.Problem(
    ENTRIES[0],
    INPUTS,
    scene,
    elements=(128, 32, 12, 8),
    step=1 / 40,
    levels=5,
    tolerance=1e-8,
    derived=DERIVED,
    read=read,
    signed=("Omega",),
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
    """See :mod:`.common`; also the tip as the root sees it: ``psi``, ``u_rel``, ``theta_rel``."""
    return PROBLEM.answer(case, data, order, elements, step, integrator, treatment, times)


def rows(quick: bool = True) -> list[dict[str, Any]]:
    """All instants; quick: the first ones, on a coarser mesh with larger steps."""
    if quick:
        times = [float(t) for t in QUICK]
        return PROBLEM.rows("D05", times, elements=6, ladder=(1 / 20, 3))
    return PROBLEM.rows("D05")
