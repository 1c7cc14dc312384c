"""S11: a ring, clamped at A, turned at the opposite point B about AB, folds to a third of itself.

After a full turn it is a ring of a third of the radius, three times round, without torque: closed
form. On the way torque and shift are those of shooting solutions.

``case``: the angle phi in degrees, "5" to "360", also as a number; default: "360". ``data``: R, h
(of the section, along the axis of the ring), w (radial), E, nu, kappa, phi; EI_inplane, EI_out, J,
GJ, EA, GA. J is 9.753e-3 for the entry's h and w; for others the series of a rectangle is taken.
Gives Mx (of the drive) and ux_B.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

sys.path.extend(str(Path(__file__).resolve().parents[k]) for k in (1, 2))

import static_scenes

import skfem_cosserat as sc
from collection import common, statics

ENTRIES = ("S11_deployable_ring",)
FIELDS = ("Mx", "ux_B")
ENTRY = common.entry(ENTRIES[0])
CASES = tuple(ENTRY["values"])
QUICK = ("45", "140", "180")


def _torsion_constant(d: dict[str, Any]) -> float:
    """Of the section h x w."""
    if (d["h"], d["w"]) == (1.0, 1 / 3):
        return 9.753e-3
    unit = sc.Material(E=2.0, nu=0.0, rho=1.0)  # G = 1
    return float(sc.SectionRectangle(d["h"], d["w"], unit).stiffness[5, 5])


DATA = {
    "R": 20.0,
    "h": 1.0,
    "w": 1 / 3,
    "E": 2.1e7,
    "nu": 0.3,
    "kappa": 5 / 6,
    "phi": 360.0,
    "EI_inplane": lambda d: d["E"] * d["h"] * d["w"] ** 3 / 12,
    "EI_out": lambda d: d["E"] * d["w"] * d["h"] ** 3 / 12,
    "J": _torsion_constant,
    "GJ": lambda d: d["E"] / (2 * (1 + d["nu"])) * d["J"],
    "EA": lambda d: d["E"] * d["h"] * d["w"],
    "GA": lambda d: d["kappa"] * d["EA"] / (2 * (1 + d["nu"])),
}
ELEMENTS = {1: 400, 2: 300, 3: 240, 4: 96}


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
    """One angle. See :mod:`.common` for the arguments."""
    d = statics.inputs(DATA, {"phi": float(statics.chosen(case, CASES, "360"))}, data)

    def compute(asked: statics.Asked) -> dict[str, Any]:
        names = ("EI_inplane", "EA", "GA", "EI_out", "GJ")
        section = static_scenes.flat_section(*(d[name] for name in names))
        scene = static_scenes.deployable_ring(asked.even, order, radius=d["R"], section=section)
        if d["phi"] == 0:
            asked.note(scene)
            return {"Mx": 0.0, "ux_B": 0.0}
        path = asked.path(scene, sc.LoadControl(until=d["phi"] / 360), derive=True)
        torque = float(path["joint/drive/moment"][-1, 0])
        return {"Mx": torque, "ux_B": float(scene.displacement(path)[0])}

    return statics.answer(
        compute, FIELDS, ELEMENTS, order, elements, step, integrator, treatment, times
    )


def rows(quick: bool = True) -> list[dict[str, Any]]:
    """All angles of the entry; quick: three up to half a turn."""
    cases, digits = QUICK if quick else None, ENTRY["trusted_digits"]
    largest = max(v["Mx"] for v in ENTRY["values"].values())
    least = {"Mx": largest, "ux_B": 1.0}
    return statics.table("S11", main, ENTRY["values"], digits, cases, least=least)
