"""S1: a cantilever rolled up by an end moment of 2 pi lam EI/L, to lam full circles.

Closed form, whatever the axial and shear stiffness: the moment is the same everywhere, nothing else
acts. All elements bend alike, and the error depends on the angle of one only; the default number of
elements grows with lam, so that with order 3 it is 1e-12 of the length (16 digits are trusted:
there rounding would be; n has 1e-9 of it, with EA = 1e4).

``case``: number of circles, "1", "2" or any other number. ``data``: L, EI,
lam, EA, GA (default: of slenderness 100). Gives the tip's place x, y, its section's angle theta
with full turns counted, and the largest section force n.
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

ENTRIES = ("S1_rollup",)
FIELDS = ("x", "y", "theta", "n")
CASES = ("1", "2")
QUICK = ("1",)
DATA = {
    "L": 10.0,
    "EI": 100.0,
    "lam": 1.0,
    "EA": lambda d: 1e4 * d["EI"] / d["L"] ** 2,
    "GA": lambda d: d["EA"] / 2,
}
#: for a circle
ELEMENTS = {1: 400, 2: 300, 3: 192, 4: 64}


def closed_form(L: float, lam: float) -> dict[str, float]:
    """Tip, angle and section force."""
    f = 2 * math.pi * lam
    if f == 0:
        return {"x": L, "y": 0.0, "theta": 0.0, "n": 0.0}
    return {"x": L * math.sin(f) / f, "y": L * (1 - math.cos(f)) / f, "theta": f, "n": 0.0}


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
    """One roll-up; default: one circle. See :mod:`.common` for the arguments."""
    d = statics.inputs(DATA, {} if case is None else {"lam": statics.numbered(case)}, data)

    def compute(asked: statics.Asked) -> dict[str, Any]:
        section = static_scenes.flat_section(d["EI"], d["EA"], d["GA"])
        scene = static_scenes.roll_up(
            asked.elements, order, d["lam"], length=d["L"], EI=d["EI"], section=section
        )
        path = asked.path(scene, derive=True)
        x, y, _ = scene.position(path).tolist()
        force = np.linalg.norm(path["beam/rod/resultant"][-1][..., :3], axis=-1)
        return {"x": x, "y": y, "theta": scene.angle(path), "n": float(force.max())}

    turns = max(1, math.ceil(abs(d["lam"])))
    counts = {p: n * turns for p, n in ELEMENTS.items()}
    return statics.answer(
        compute, FIELDS, counts, order, elements, step, integrator, treatment, times
    )


def rows(quick: bool = True) -> list[dict[str, Any]]:
    """Both circles against the closed form."""
    references = {case: closed_form(DATA["L"], float(case)) for case in CASES}
    return statics.table("S01", main, references, 16, QUICK if quick else None, least=1.0)
