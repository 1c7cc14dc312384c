"""S8: a deep arch, clamped at one end and hinged at the other, that snaps under its crown load.

The reference is inextensible and without shear: the limit points of three stiff rods are
extrapolated to no compliance. (A beam of ``TheoryInextensible`` has the same limit point, at a much
higher cost: its matrices are full and its line closes a loop, and 48 elements of order 4 are
needed for the digits of the reference.)

``case``: any key of the entry's ``values`` (there is one case). ``data``: R, EI, angle_deg, EA, GA
(None, the default: none of its compliance). Gives Pcr, Pcr_R2_EI, crown_disp (x, y), crown_rot, and
R, EI, EA, GA, angle_deg.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

sys.path.extend(str(Path(__file__).resolve().parents[k]) for k in (1, 2))

import static_scenes

import skfem_cosserat as sc
from collection import common, statics

ENTRIES = ("S8_arch_inextensible",)
FIELDS = ("Pcr", "Pcr_R2_EI", "crown_disp", "crown_rot")
ENTRY = common.entry(ENTRIES[0])
CASES = tuple(ENTRY["values"])
QUICK: tuple[str, ...] = ()
DATA = {"R": 100.0, "EI": 1e6, "angle_deg": 215.0, "EA": None, "GA": None}
ELEMENTS = {1: 300, 2: 200, 3: 128, 4: 48}


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
    """The first limit point. See :mod:`.common` for the arguments."""
    statics.chosen(case, CASES, "Pcr")
    d = statics.inputs(DATA, data, optional=("EA", "GA"))
    scale = d["EI"] / d["R"] ** 2

    def compute(asked: statics.Asked) -> dict[str, Any]:
        def crown(EA: float, GA: float) -> dict[str, Any]:
            scene = static_scenes.arch(
                asked.even,
                order,
                radius=d["R"],
                degrees=d["angle_deg"],
                section=static_scenes.plane_section(d["EI"], EA, GA),
            )
            for share in (1.15, 1.5, 2.0):
                control = sc.DisplacementControl(scene.point, (0, -1, 0), share * d["R"])
                path = asked.search(scene, control)
                found = [p for p in path.meta["critical"] if p["kind"] == "limit"]
                if found:
                    break
            (point,) = statics.limit_points(asked, scene, path, 1, (0, -1, 0))
            return {
                "Pcr": point.load,
                "crown_disp": point.displacement[:2].tolist(),
                "crown_rot": point.angle - scene.angle(path, 0),
            }

        found = statics.limit(d, scale, crown, first=4e4, ratio=2.0)
        return {**d, **found, "Pcr_R2_EI": found["Pcr"] / scale}

    return statics.answer(
        compute, FIELDS, ELEMENTS, order, elements, step, integrator, treatment, times
    )


def rows(quick: bool = True) -> list[dict[str, Any]]:
    """The entry."""
    references = {"Pcr": {name: ENTRY["values"][name] for name in FIELDS}}
    digits = ENTRY["trusted_digits"]
    return statics.table("S08", main, references, digits, QUICK if quick else None)
