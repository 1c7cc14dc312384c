"""S10: Euler's columns with shear and extension: P (1 - P/EA + P/GA) = c EI/L^2 in closed form.

The path is followed until it bifurcates.

``case``: "h=1/20 square,pinned-pinned" (default) or "h=1/20 square,clamped-free". ``data``: L, h
(of the square section), E, nu, kappa; EI, EA, GA. Gives EI, EA, GA, Pcr and Pcr_over_PE (of Euler's
load).
"""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import Any

sys.path.extend(str(Path(__file__).resolve().parents[k]) for k in (1, 2))

import static_scenes

from collection import common, statics

ENTRIES = ("S10_buckling",)
FIELDS = ("Pcr", "Pcr_over_PE")
ENTRY = common.entry(ENTRIES[0])
CASES = tuple(ENTRY["values"])
QUICK = CASES
DATA = {
    "L": 1.0,
    "h": 1 / 20,
    "E": 2.1e11,
    "nu": 0.3,
    "kappa": 5 / 6,
    "EI": lambda d: d["E"] * d["h"] ** 4 / 12,
    "EA": lambda d: d["E"] * d["h"] ** 2,
    "GA": lambda d: d["kappa"] * d["EA"] / (2 * (1 + d["nu"])),
}
ELEMENTS = {1: 200, 2: 128, 3: 64, 4: 24}


def closed_form(d: dict[str, float], pinned: bool) -> float:
    """The critical load."""
    euler = math.pi**2 * d["EI"] / d["L"] ** 2 * (1.0 if pinned else 0.25)
    slope = 1 / d["GA"] - 1 / d["EA"]
    return 2 * euler / (1 + math.sqrt(1 + 4 * slope * euler))


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
    """One column. See :mod:`.common` for the arguments."""
    pinned = statics.chosen(case, CASES, CASES[0]).endswith("pinned")
    d = statics.inputs(DATA, data)
    shown = {name: d[name] for name in ("EI", "EA", "GA")}

    def compute(asked: statics.Asked) -> dict[str, Any]:
        column = static_scenes.column(asked.elements, order, pinned=pinned, length=d["L"], **shown)
        load = statics.bifurcation(asked, column)
        euler = math.pi**2 * d["EI"] / d["L"] ** 2 * (1.0 if pinned else 0.25)
        return {**shown, "Pcr": load, "Pcr_over_PE": load / euler}

    return statics.answer(
        compute, FIELDS, ELEMENTS, order, elements, step, integrator, treatment, times
    )


def rows(quick: bool = True) -> list[dict[str, Any]]:
    """Both supports."""
    references = {key: {f: v[f] for f in FIELDS} for key, v in ENTRY["values"].items()}
    digits = ENTRY["trusted_digits"]
    return statics.table("S10", main, references, digits, QUICK if quick else None)
