"""S2: a cantilever bent by a dead transverse tip force alpha EI/L^2.

Two entries. Inextensible and without shear (elliptic integrals, 17 digits): a beam of
``TheoryInextensible``, extrapolated from three meshes. With shear and extension (shooting, 11
digits): one of ``TheoryReissner``. The root moment is force times x.

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

import skfem_cosserat as sc
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
    given = statics.parts(name if "=" in name else f"alpha={name}")
    d = statics.inputs(DATA, given, data, optional=("h", "EA", "GA"))

    def compute(asked: statics.Asked) -> dict[str, Any]:
        def tip(
            EA: float,
            GA: float,
            theory: sc.Theory = static_scenes.FULL,
            count: int = asked.elements,
        ) -> dict[str, Any]:
            size = {"length": d["L"], "EI": d["EI"], "EA": EA, "GA": GA}
            scene = static_scenes.elastica(count, order, d["P"], **size, theory=theory)
            path = asked.path(scene, derive=True)
            x, y, _ = scene.position(path).tolist()
            root = -path["joint/clamp/moment"][-1, 2]
            return {"x": x, "y": y, "theta": scene.angle(path), "root_moment": abs(float(root))}

        scale = d["EI"] / d["L"] ** 2
        if d["GA"] is None:
            found = statics.held(asked, d, scale, tip)
        else:
            found = statics.limit(d, scale, tip, first=1e3, levels=4)
        return {**found, "EA": d["EA"], "GA": d["GA"]}

    counts = statics.HELD if d["GA"] is None else ELEMENTS
    return statics.answer(
        compute, FIELDS, counts, order, elements, step, integrator, treatment, times
    )


def rows(quick: bool = True) -> list[dict[str, Any]]:
    """All cases of both entries."""
    out = []
    for name, values in VALUES.items():
        references = {case: {f: v[f] for f in FIELDS if f in v} for case, v in values.items()}
        digits = common.entry(name)["trusted_digits"]
        out += statics.table("S02", main, references, digits, QUICK if quick else None)
    return out
