"""S14: an arc of 45 degrees, any slenderness: the error of a mesh must not grow with it.

Circular section of radius L/z; the tip force is out of the plane of the arc.

``case``: slenderness z, "100" or "1000", also as a number; default: "100". ``data``: z, L, kappa0
(curvature, default pi/4 over L), EI, nu, kappa_s (of shear), P; EA (default: 4 EI z^2/L^2), GA, GJ.
Gives EA, GA, GJ, EI and tip, quat (of the tip's section), root_moment (on the rod).
"""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import Any

sys.path.extend(str(Path(__file__).resolve().parents[k]) for k in (1, 2))

import static_scenes

from collection import common, statics

ENTRIES = ("S14_slenderness",)
FIELDS = ("tip", "quat", "root_moment")
ENTRY = common.entry(ENTRIES[0])
CASES = tuple(ENTRY["values"])
QUICK = CASES
DATA = {
    "z": 100.0,
    "L": 1.0,
    "kappa0": lambda d: math.pi / 4 / d["L"],
    "EI": 1.0,
    "nu": 0.3,
    "kappa_s": 0.9,
    "P": 5.0,
    "EA": lambda d: 4 * d["EI"] * (d["z"] / d["L"]) ** 2,
    "GA": lambda d: d["kappa_s"] * d["EA"] / (2 * (1 + d["nu"])),
    "GJ": lambda d: d["EI"] / (1 + d["nu"]),
}
ELEMENTS = {1: 200, 2: 128, 3: 64, 4: 20}


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
    """One slenderness. See :mod:`.common` for the arguments."""
    d = statics.inputs(DATA, {"z": float(statics.chosen(case, CASES, "100"))}, data)

    def compute(asked: statics.Asked) -> dict[str, Any]:
        section = static_scenes.flat_section(d["EI"], d["EA"], d["GA"], d["EI"], d["GJ"])
        scene = static_scenes.arc(
            asked.elements,
            order,
            section,
            {"force": (0.0, 0.0, d["P"])},
            radius=1 / d["kappa0"],
            degrees=math.degrees(d["kappa0"] * d["L"]),
        )
        path = asked.path(scene, derive=True)
        return {
            **{name: d[name] for name in ("EA", "GA", "GJ", "EI")},
            "tip": scene.position(path).tolist(),
            "quat": scene.quaternion(path).tolist(),
            "root_moment": (-path["joint/clamp/moment"][-1]).tolist(),
        }

    return statics.answer(
        compute, FIELDS, ELEMENTS, order, elements, step, integrator, treatment, times
    )


def rows(quick: bool = True) -> list[dict[str, Any]]:
    """Both slendernesses."""
    references = {key: {f: v[f] for f in FIELDS} for key, v in ENTRY["values"].items()}
    digits = ENTRY["trusted_digits"]
    return statics.table("S14", main, references, digits, QUICK if quick else None)
