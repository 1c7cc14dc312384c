"""D7: a thin beam buckles sideways (Bauchau et al. 2016, problem 3).

A crank lifts the beam's tip by a link, in the beam's stiff plane but for an eccentricity ``d``.
After 0.1 s every small error grows.
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

ENTRIES = ("D7_lateral_buckling",)
QUICK = ("0.02", "0.04")
INPUTS = {
    **{"d": 1e-4, "L": 1.0, "EA": 7.3e7, "GA_2": 5.025e6, "GA_3": 2.34e7, "GJ": 877.2},
    **{"EI_2": 60830.0, "EI_3": 608.3, "A_rho": 2.68},
    **{"J_rho": (2.25533e-3, 2.233e-3, 2.233e-5), "amplitude": np.pi / 2, "T": 0.4},
    "link": {
        **{"L": 0.25, "EA": 3.302e7, "GA": 1.081e7, "GJ": 914.5, "EI": 1189.0},
        **{"A_rho": 1.212, "J_rho": (8.73e-5, 4.365e-5)},
    },
    "crank": {
        **{"L": 0.05, "EA": 1.321e8, "GA": 4.322e7, "GJ": 14630.0, "EI": 19020.0},
        **{"A_rho": 4.85, "J_rho": (1.3966e-3, 6.983e-4)},
    },
}


def angle(t: float, data: dict[str, Any]) -> float:
    """The crank's about -e2."""
    return float(data["amplitude"] * (1 - np.cos(np.pi * t / data["T"])))


def scene(data: dict[str, Any], elements: int, order: int) -> runs.Scene:
    """`elements` in the beam; link and crank are stiff and short, one each will do."""
    d, L, down, back = data["d"], data["L"], data["link"]["L"], data["crank"]["L"]
    top, bottom, axle = (L, d, 0.0), (L, d, -down), (L - back, d, -down)
    model = sc.Model()

    def member(name: str, mesh: sc.MeshCurve, constants: dict[str, Any]) -> sc.Beam:
        return model.add(name, members.beam(mesh, constants, order, e2=(0, 1, 0)))

    strip = {**data, "GA": (data["GA_2"], data["GA_3"]), "EI": (data["EI_2"], data["EI_3"])}
    beam = member("beam", members.halves((0, 0, 0), (L, 0, 0), elements, order), strip)
    link = member("link", sc.MeshCurve.init_line(top, bottom, 1, name="rod"), data["link"])
    crank = member("crank", sc.MeshCurve.init_line(bottom, axle, 1, name="rod"), data["crank"])
    model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), beam.node("rod.start")))
    eccentric = beam.node("rod.end", offset=(d, 0, 0))  # d1 is e2
    model.add("ball", sc.JointSpherical(eccentric, link.node("rod.start")))
    pin = sc.JointRevolute(link.node("rod.end"), crank.node("rod.start"), axis=(0, 1, 0))
    model.add("pin", pin)
    turning = sc.Motion(rotation=lambda t: (0.0, -angle(t, data), 0.0))
    model.add("axle", sc.JointFixed(sc.ground(axle, turning), crank.node("rod.end")))
    places = {
        **{"mid": beam.node((L / 2, 0, 0)), "tip": beam.node("rod.end")},
        "B": crank.node("rod.start"),
    }
    return runs.Scene(model.freeze(), places)


PROBLEM = dynamics.Problem(
    ENTRIES[0],
    INPUTS,
    scene,
    elements=(64, 24, 12, 8),
    step=1 / 16000,
    levels=4,
    tolerance=1e-9,
    signed=("d", "amplitude"),
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
    """See :mod:`.common`; ``pos``, ``quat`` (mid, tip, B: the crank at its pin), ``energy``."""
    return PROBLEM.answer(case, data, order, elements, step, integrator, treatment, times)


def rows(quick: bool = True) -> list[dict[str, Any]]:
    """All instants; quick: the first ones, on a coarser mesh with larger steps."""
    if quick:
        times = [float(t) for t in QUICK]
        return PROBLEM.rows("D07", times, elements=6, ladder=(1 / 4000, 2))
    return PROBLEM.rows("D07")
