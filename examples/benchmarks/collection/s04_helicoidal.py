"""S4: a rod rolled up to ten turns by a moment about a fixed axis, drawn sideways by a force.

Moment lam 200 pi e3 (fixed in space: it has no potential) and dead force lam 50 e3 at the tip,
followed from lam = 0. The default number of elements grows with the turns; quick cases end at
one and a half.

``case``: lam, "0.0500" to "1.0000", also as a number; default: "0.0500". ``data``: L, EA, GA, EI,
GJ, lam, M and F (moment and force at lam = 1). Gives tip, u_out (along e3), quat_tip (its sign
followed along the rod).
"""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import Any

sys.path.extend(str(Path(__file__).resolve().parents[k]) for k in (1, 2))

import static_scenes

import skfem_cosserat as sc
from collection import common, statics

ENTRIES = ("S4_helicoidal",)
FIELDS = ("tip", "u_out", "quat_tip")
ENTRY = common.entry(ENTRIES[0])
CASES = tuple(ENTRY["values"])
QUICK = CASES[:3]
DATA = {
    "L": 10.0,
    "EA": 1e4,
    "GA": 1e4,
    "EI": 1e2,
    "GJ": 1e2,
    "lam": 0.05,
    "M": 200 * math.pi,
    "F": 50.0,
}
#: for a turn, and at least
PER_TURN = {1: 200, 2: 128, 3: 80, 4: 24}


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
    """One load factor. See :mod:`.common` for the arguments."""
    d = statics.inputs(DATA, {"lam": float(statics.chosen(case, CASES, CASES[0]))}, data)

    def compute(asked: statics.Asked) -> dict[str, Any]:
        scene = static_scenes.helix_roll_up(
            asked.elements,
            order,
            length=d["L"],
            section=static_scenes.flat_section(
                *(d[name] for name in ("EI", "EA", "GA", "EI", "GJ"))
            ),
            moment=d["lam"] * d["M"],
            force=d["lam"] * d["F"],
        )
        path = asked.path(scene, sc.LoadControl())
        tip = scene.position(path).tolist()
        return {"tip": tip, "u_out": tip[2], "quat_tip": scene.quaternion(path).tolist()}

    turns = abs(d["lam"] * d["M"]) * d["L"] / (2 * math.pi * d["EI"])
    counts = {p: math.ceil(n * max(1.0, turns)) for p, n in PER_TURN.items()}
    return statics.answer(
        compute, FIELDS, counts, order, elements, step, integrator, treatment, times
    )


def rows(quick: bool = True) -> list[dict[str, Any]]:
    """The load factors of the entry, quick ones up to one and a half turns."""
    references = {key: {f: v[f] for f in FIELDS} for key, v in ENTRY["values"].items()}
    digits = ENTRY["trusted_digits"]
    return statics.table("S04", main, references, digits, QUICK if quick else None)
