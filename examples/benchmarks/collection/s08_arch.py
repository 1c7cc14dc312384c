"""S8: a deep arch, clamped at one end and hinged at the other, that snaps under its crown load.

The reference is inextensible and without shear: a beam of ``TheoryInextensible``, extrapolated from
three meshes. Its line closes a loop, so all unknowns move all others and matrices are full. The
path is searched for its first limit point on the coarsest mesh alone; on each mesh the load is
stationary there.

``case``: any key of the entry's ``values`` (there is one case). ``data``: R, EI, angle_deg, EA, GA
(None, the default: none of its compliance). Gives Pcr, Pcr_R2_EI, crown_disp (x, y), crown_rot, and
R, EI, EA, GA, angle_deg.
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

ENTRIES = ("S8_arch_inextensible",)
FIELDS = ("Pcr", "Pcr_R2_EI", "crown_disp", "crown_rot")
ENTRY = common.entry(ENTRIES[0])
CASES = tuple(ENTRY["values"])
QUICK: tuple[str, ...] = ()
DATA = {"R": 100.0, "EI": 1e6, "angle_deg": 215.0, "EA": None, "GA": None}
ELEMENTS = {1: 300, 2: 200, 3: 128, 4: 48}
#: the same of a beam whose theory holds strains; its meshes have these shares of them, and at least
#: so many nodes: with less their errors are no series yet
HELD = {1: 96, 2: 64, 3: 48, 4: 32}
SHARES, LEAST = (0.75, 0.5), 48
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
    """The first limit point. See :mod:`.common` for the arguments."""
    statics.chosen(case, CASES, "Pcr")
    d = statics.inputs(DATA, data, optional=("EA", "GA"))
    scale = d["EI"] / d["R"] ** 2

    def compute(asked: statics.Asked) -> dict[str, Any]:
        def arch(EA: float, GA: float, theory: sc.Theory, count: int) -> static_scenes.Scene:
            section = static_scenes.plane_section(d["EI"], EA, GA)
            size = {"radius": d["R"], "degrees": d["angle_deg"]}
            return static_scenes.arch(count, order, **size, section=section, theory=theory)

        def searched(scene: static_scenes.Scene) -> tuple[sc.History, list[int]]:
            for share in (1.15, 1.5, 2.0):
                control = sc.DisplacementControl(scene.point, DOWN, share * d["R"])
                path = asked.search(scene, control)
                limits = [p["state"] for p in path.meta["critical"] if p["kind"] == "limit"]
                if limits:
                    break
            return path, limits

        def crown(point: statics.LimitPoint) -> dict[str, Any]:
            # the section turns from 0: the crown's tangent lies along x
            place = point.displacement[:2].tolist()
            return {"Pcr": point.load, "crown_disp": place, "crown_rot": point.angle}

        def elastic(EA: float, GA: float) -> dict[str, Any]:
            scene = arch(EA, GA, static_scenes.FULL, asked.even)
            path, _ = searched(scene)
            return crown(statics.limit_points(asked, scene, path, 1, DOWN)[0])

        down: list[float] = []  # displacements of the limit point on one mesh after the other

        def held(EA: float, GA: float, theory: sc.Theory, count: int) -> dict[str, Any]:
            scene = arch(EA, GA, theory, count)
            if not down:
                path, limits = searched(scene)
                down.extend(-scene.displacement(path, k)[1] for k in limits[:1])
            point = statics.highest(asked, scene, DOWN, down[-1] if down else math.nan)
            down.append(-point.displacement[1])
            return crown(point)

        if d["GA"] is None:
            coarser = [2 * round(share * asked.even / 2) for share in SHARES]
            counts = [asked.even, *(n for n in coarser if n * order >= LEAST)]
            found = statics.held(asked, d, scale, held, counts)
        else:
            found = statics.limit(d, scale, elastic, first=4e4, ratio=2.0)
        return {**d, **found, "Pcr_R2_EI": found["Pcr"] / scale}

    counts = HELD if d["GA"] is None else ELEMENTS
    return statics.answer(
        compute, FIELDS, counts, order, elements, step, integrator, treatment, times
    )


def rows(quick: bool = True) -> list[dict[str, Any]]:
    """The entry."""
    references = {"Pcr": {name: ENTRY["values"][name] for name in FIELDS}}
    digits = ENTRY["trusted_digits"]
    return statics.table("S08", main, references, digits, QUICK if quick else None)
