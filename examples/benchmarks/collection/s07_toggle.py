"""S7: a flat toggle: two clamped members that snap through under a load at their apex.

One half of it, the apex on a slide. Followed by the sinking of the apex.

``case``: "limit_points" or "curve"; default: both. ``data``: EI, EA, GA (default: that of nu = 0.3
and a shear factor of 5/6; None is refused), rise, half_span, w (list: sinking at which the load is
asked for, default: that of the reference). Gives limit_points and curve, lists of (w, P), P in all.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np

sys.path.extend(str(Path(__file__).resolve().parents[k]) for k in (1, 2))

import static_scenes

import skfem_cosserat as sc
from collection import common, statics

ENTRIES = ("S7_toggle_GA=EA/2.6*5/6",)
FIELDS = ("limit_points", "curve")
ENTRY = common.entry(ENTRIES[0])
CASES = FIELDS
QUICK = CASES
DATA = {
    "EI": 9270.0,
    "EA": 1885000.0,
    "GA": lambda d: d["EA"] / 2.6 * 5 / 6,
    "rise": 0.386,
    "half_span": 12.943,
    "w": tuple(w for w, _ in ENTRY["values"]["curve"]),
}
#: of a member
ELEMENTS = {1: 200, 2: 80, 3: 32, 4: 14}
DOWN = (0.0, -1.0, 0.0)


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
    """Limit points, the curve, or both. See :mod:`.common` for the arguments."""
    key = statics.chosen(case, CASES, "")
    d = statics.inputs(DATA, data)

    def compute(asked: statics.Asked) -> dict[str, Any]:
        scene = static_scenes.toggle(
            asked.elements,
            order,
            rise=d["rise"],
            half_span=d["half_span"],
            section=static_scenes.plane_section(d["EI"], d["EA"], d["GA"]),
        )
        found = {}
        if key != "curve":
            found["limit_points"] = _limit_points(asked, scene, 2.1 * d["rise"])
        if key != "limit_points":
            found["curve"] = _curve(asked, scene, np.atleast_1d(d["w"]).astype(float))
        return found

    return statics.answer(
        compute, FIELDS, ELEMENTS, order, elements, step, integrator, treatment, times
    )


def _limit_points(asked: statics.Asked, scene: Any, until: float) -> list[list[float]]:
    path = asked.search(scene, sc.DisplacementControl(scene.point, DOWN, until))
    found = statics.limit_points(asked, scene, path, 2, DOWN)
    return [[-float(point.displacement[1]), point.load] for point in found]


def _curve(asked: statics.Asked, scene: Any, w: Any) -> list[list[float]]:
    """Loads at these displacements, downwards and upwards in turn."""
    loads = dict.fromkeys(w.tolist(), 0.0)
    for sign in (1.0, -1.0):
        way = np.unique(w[sign * w > 0] * sign)
        if len(way):
            direction = tuple(sign * np.array(DOWN))
            path = asked.path(scene, sc.DisplacementControl(scene.point, direction, at=way))
            found = path["load_factor"][statics.regular(path)]
            loads.update(zip((sign * way).tolist(), found.tolist(), strict=True))
    return [[each, loads[each]] for each in w.tolist()]


def rows(quick: bool = True) -> list[dict[str, Any]]:
    """Limit points and curve."""
    references = {name: {name: ENTRY["values"][name]} for name in CASES}
    digits = ENTRY["trusted_digits"]
    return statics.table("S07", main, references, digits, QUICK if quick else None)
