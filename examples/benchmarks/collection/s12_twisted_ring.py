"""S12: a rod bent to a closed ring and twisted buckles out of its plane (Michell, Zajac).

Closed form of the inextensible ring of equal bending stiffnesses: a total twist of 2 pi sqrt(3)
EI/GJ. Computed from the squares of the two lowest frequencies of the twisted ring, which both
vanish there, for rods of three slendernesses, extrapolated.

``case``: any of "total_twist", "tau" (there is one case). ``data``: R, EI, GJ. Gives total_twist
and the twist by length tau at which the ring buckles.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import Any

import numpy as np

sys.path.extend(str(Path(__file__).resolve().parents[k]) for k in (1, 2))

import static_scenes

from collection import statics

ENTRIES = ("S12_twisted_ring",)
FIELDS = ("total_twist", "tau")
CASES = FIELDS
QUICK: tuple[str, ...] = ()
DATA = {"R": 1.0, "EI": 1.0, "GJ": 1.0}
ELEMENTS = {1: 200, 2: 96, 3: 80, 4: 40}


def closed_form(R: float = 1.0, EI: float = 1.0, GJ: float = 1.0) -> dict[str, float]:
    """Total twist, and twist by length."""
    twist = 2 * math.pi * math.sqrt(3) * EI / GJ
    return {"total_twist": twist, "tau": twist / (2 * math.pi * R)}


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
    """The critical twist. See :mod:`.common` for the arguments."""
    statics.chosen(case, CASES, "total_twist")
    d = statics.inputs(DATA, data)
    expected = closed_form(**d)["total_twist"]

    def compute(asked: statics.Asked) -> dict[str, Any]:
        found = []
        for k in range(3):
            scene = static_scenes.twisted_ring(
                asked.elements,
                order,
                GJ=d["GJ"],
                slenderness=40 * 2 ** (k / 2),
                radius=d["R"],
                EI=d["EI"],
            )
            asked.note(scene)
            path, shares = static_scenes.ring_limits(scene, expected, asked.treatment)
            asked.cost.add(path)
            found.append(np.mean(shares))
        twist = expected * float(statics.extrapolated(found, 2.0))
        return {"total_twist": twist, "tau": twist / (2 * math.pi * d["R"])}

    return statics.answer(
        compute, FIELDS, ELEMENTS, order, elements, step, integrator, treatment, times
    )


def rows(quick: bool = True) -> list[dict[str, Any]]:
    """The closed form; takes too long for the quick table."""
    references = {"total_twist": closed_form(**DATA)}
    return statics.table("S12", main, references, 16, QUICK if quick else None)
