"""S6: Lee's frame: two hinged legs, a dead load next to the corner; it snaps through.

Followed by arc length through both limit points.

``case``: "0" (the first limit point, default) or "1". ``data``: L (of a leg), at (distance of the
load from the corner), E, A, I; EA, GA (default: EA/2.6), EI. Gives the load P and the displacements
u, v of the place it acts on; under "0" and "1" those of both limit points.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

sys.path.extend(str(Path(__file__).resolve().parents[k]) for k in (1, 2))

import static_scenes

import skfem_cosserat as sc
from collection import common, statics

ENTRIES = ("S6_lee_frame",)
FIELDS = ("P", "u", "v")
ENTRY = common.entry(ENTRIES[0])
CASES = ("0", "1")
QUICK = ("0",)
DATA = {
    "L": 120.0,
    "at": 24.0,
    "E": 7.2e6,
    "A": 6.0,
    "I": 2.0,
    "EA": lambda d: d["E"] * d["A"],
    "GA": lambda d: d["EA"] / 2.6,
    "EI": lambda d: d["E"] * d["I"],
}
#: of both legs together
ELEMENTS = {1: 300, 2: 160, 3: 80, 4: 40}


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
    """One limit point. See :mod:`.common` for the arguments."""
    key = statics.chosen(case, CASES, "0")
    d = statics.inputs(DATA, data)
    if d["at"] >= d["L"]:
        raise sc.InputError("data", f"at = {d['at']!r}, expected less than L = {d['L']!r}")

    def compute(asked: statics.Asked) -> dict[str, Any]:
        scene = static_scenes.lee_frame(
            asked.elements,
            order,
            leg=d["L"],
            at=d["at"],
            section=static_scenes.plane_section(d["EI"], d["EA"], d["GA"]),
        )
        load = d["EI"] / d["L"] ** 2
        for highest in (20, 100):
            path = asked.search(scene, sc.ArcLength(100, until=highest * load, first=2 * load))
            if len(path.meta["critical"]) > 1:
                break
        found = statics.limit_points(asked, scene, path, 2, (1, 0, 0))
        both = {}
        for name, point in zip(CASES, found, strict=True):
            u, v, _ = point.displacement.tolist()
            both[name] = {"P": point.load, "u": u, "v": v}
        return {**both[key], **both}

    return statics.answer(
        compute, FIELDS, ELEMENTS, order, elements, step, integrator, treatment, times
    )


def rows(quick: bool = True) -> list[dict[str, Any]]:
    """Both limit points."""
    references = {k: {f: v[f] for f in FIELDS} for k, v in zip(CASES, ENTRY["values"], strict=True)}
    digits = ENTRY["trusted_digits"]
    return statics.table("S06", main, references, digits, QUICK if quick else None)
