"""S2: a cantilever bent by a dead transverse tip force alpha EI/L^2.

Two entries. Inextensible and without shear (elliptic integrals, 17 digits): tips of rods of four
stiffnesses, extrapolated to no compliance; this leaves 1e-12 or less, where rounding begins. With
shear and extension (shooting, 11 digits): as it is. The root moment is force times x.

``case``: "1", "2", "5", "10" (alpha; inextensible) or "h=0.1,alpha=5" and so on. ``data``: L, EI,
alpha, h (thickness, default None: inextensible; EA = 12 EI/h^2), EA, GA (None: none of its
compliance), P (the force itself). Gives the tip's x, y, its angle theta, root_moment, EA, GA.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

sys.path.extend(str(Path(__file__).resolve().parents[k]) for k in (1, 2))

import static_scenes

from collection import common, statics

ENTRIES = ("S2_elastica_inextensible", "S2_elastica_reissner")
FIELDS = ("x", "y", "theta", "root_moment")
VALUES = {name: common.entry(name)["values"] for name in ENTRIES}
CASES = tuple(key for values in VALUES.values() for key in values)
QUICK = ("10", "h=0.1,alpha=10")
DATA = {
    "L": 1.0,
    "EI": 1.0,
    "alpha": 1.0,
    "h": None,
    "EA": lambda d: None if d["h"] is None else 12 * d["EI"] / d["h"] ** 2,
    "GA": lambda d: None if d["EA"] is None else 5 / 6 * d["EA"] / 2.6,
    "P": lambda d: d["alpha"] * d["EI"] / d["L"] ** 2,
}
ELEMENTS = {1: 200, 2: 128, 3: 64, 4: 24}


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
    """One load; default: alpha = 1, inextensible. See :mod:`.common` for the arguments."""
    name = statics.chosen(case, CASES, "1")
    d = statics.inputs(DATA, statics.parts(name if "=" in name else f"alpha={name}"), data)

    def compute(asked: statics.Asked) -> dict[str, Any]:
        def tip(EA: float, GA: float) -> dict[str, Any]:
            scene = static_scenes.elastica(
                asked.elements, order, d["P"], EA=EA, GA=GA, length=d["L"], EI=d["EI"]
            )
            path = asked.path(scene, derive=True)
            x, y, _ = scene.position(path).tolist()
            root = -path["joint/clamp/moment"][-1, 2]
            return {"x": x, "y": y, "theta": scene.angle(path), "root_moment": abs(float(root))}

        found = statics.limit(d, d["EI"] / d["L"] ** 2, tip, first=1e3, levels=4)
        return {**found, "EA": d["EA"], "GA": d["GA"]}

    return statics.answer(
        compute, FIELDS, ELEMENTS, order, elements, step, integrator, treatment, times
    )


def rows(quick: bool = True) -> list[dict[str, Any]]:
    """All cases of both entries."""
    out = []
    for name, values in VALUES.items():
        references = {case: {f: v[f] for f in FIELDS if f in v} for case, v in values.items()}
        digits = common.entry(name)["trusted_digits"]
        out += statics.table("S02", main, references, digits, QUICK if quick else None)
    return out
