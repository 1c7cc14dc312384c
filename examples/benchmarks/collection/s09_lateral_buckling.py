"""S9, S9b, S9c: a strip and right-angle frames bent in their stiff plane buckle out of it.

Four entries: the strip with all that it does before it buckles (S9_ltb_strip) and Prandtl's closed
form without it (S9_Prandtl); a clamped right-angle frame (S9b), loads along +e1 or -e1 at its free
end; a hinged one under end moments (S9c, closed form). The closed forms know no deflections before
buckling: linear buckling of rods whose other stiffnesses are large, extrapolated.

The references of the strip and of S9b are themselves off by 2.2e-7 and 5e-9: the shooting solutions
that they come from, repeated with steps of 1/60 of the length, give 3.31327752061047 and
1.0875178408408, with which these agree to 1e-9.

``case``: an entry's name, "Pcr" (the strip, default), "c" (Prandtl), "load +e1", "load -e1" (S9b)
or "Mcr" (S9c). ``data``: L, b, t, E, nu, kappa; EI_stiff, EI_weak, GJ, EA, GA; in Prandtl's entry
EI_min and in S9c EI2 for EI_weak. Gives Pcr and Prandtl; c and Pcr; Pcr (and the same by the load's
name; by the entry's own name Pcr is the dict that the entry has); Mcr.
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

PRANDTL, STRIP, ANGLE, HINGED = ENTRIES = (
    "S9_Prandtl",
    "S9_ltb_strip",
    "S9b_right_angle_cantilever_frame",
    "S9c_hinged_right_angle_frame",
)
#: keys of the entries' values, and the entries' own names
CASES = {
    **{name: name for name in ENTRIES},
    "Pcr": STRIP,
    "Prandtl": STRIP,
    "c": PRANDTL,
    "load +e1": ANGLE,
    "load -e1": ANGLE,
    "Mcr": HINGED,
}
QUICK = ("Pcr", "load +e1", "Mcr")
FIELDS = {
    PRANDTL: ("c", "Pcr"),
    STRIP: ("Pcr", "Prandtl"),
    ANGLE: ("Pcr", "load +e1"),
    HINGED: ("Mcr",),
}
DATA = {
    "L": 240.0,
    "b": 30.0,
    "t": 0.6,
    "E": 71240.0,
    "nu": 0.31,
    "kappa": 5 / 6,
    "EI_stiff": lambda d: d["E"] * d["t"] * d["b"] ** 3 / 12,
    "EI_weak": lambda d: d["E"] * d["b"] * d["t"] ** 3 / 12,
    "GJ": lambda d: d["E"] / (2 * (1 + d["nu"])) * d["b"] * d["t"] ** 3 / 3,
    "EA": lambda d: d["E"] * d["b"] * d["t"],
    "GA": lambda d: d["kappa"] * d["EA"] / (2 * (1 + d["nu"])),
}
#: the entries' own names of EI_weak
WEAK = {PRANDTL: "EI_min", HINGED: "EI2"}
#: of a leg
ELEMENTS = {1: 100, 2: 50, 3: 32, 4: 16}


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
    """One critical load. See :mod:`.common` for the arguments."""
    key = statics.chosen(case, tuple(CASES), "Pcr")
    name = CASES[key]
    weak = WEAK.get(name, "EI_weak")
    defaults = {weak if k == "EI_weak" else k: v for k, v in DATA.items()}
    d = statics.inputs(defaults, data)
    constants = {
        "EI": d["EI_stiff"],
        "across": d[weak],
        "GJ": d["GJ"],
        "EA": d["EA"],
        "GA": d["GA"],
    }
    size = {"length": d["L"], "constants": constants}

    def compute(asked: statics.Asked) -> dict[str, Any]:
        if name == ANGLE:
            load = -1.0 if key == "load -e1" else 1.0
            scene = static_scenes.right_angle(asked.elements, order, load=load, **size)
            found = statics.bifurcation(asked, scene)
            way = f"load {'+' if load > 0 else '-'}e1"
            return {"Pcr": {way: found} if key == ANGLE else found, way: found}
        if name == HINGED:
            return {"Mcr": _undeflected(asked, static_scenes.hinged_frame, size)}
        prandtl = _undeflected(asked, static_scenes.strip, size)
        if name == PRANDTL:
            return {"c": prandtl * d["L"] ** 2 / math.sqrt(d[weak] * d["GJ"]), "Pcr": prandtl}
        scene = static_scenes.strip(asked.elements, order, **size)
        shown = {n: d[n] for n in ("EI_stiff", "EI_weak", "GJ", "EA", "GA")}
        return {**shown, "Pcr": statics.bifurcation(asked, scene), "Prandtl": prandtl}

    fields = FIELDS[name]
    return statics.answer(
        compute, fields, ELEMENTS, order, elements, step, integrator, treatment, times
    )


def _undeflected(asked: statics.Asked, build: Any, size: dict[str, Any]) -> float:
    """Linear buckling load, all but the weak bending and the torsion without compliance."""
    found = []
    for k in range(3):
        scene = build(asked.elements, asked.order, stiffening=100.0 * 4**k, **size)
        asked.note(scene)
        found.append(sc.buckling(scene.system, 1).factors[0])
    return float(statics.extrapolated(found, 4.0))


def references() -> dict[str, dict[str, Any]]:
    """Numbers by case."""
    values = {name: common.entry(name)["values"] for name in ENTRIES}
    return {
        "c": {"c": values[PRANDTL]["c"]},
        "Pcr": {name: values[STRIP][name] for name in FIELDS[STRIP]},
        "load +e1": {"Pcr": values[ANGLE]["Pcr"]["load +e1"]},
        "Mcr": {"Mcr": values[HINGED]["Mcr"]},
    }


def rows(quick: bool = True) -> list[dict[str, Any]]:
    """All four entries."""
    digits = common.entry(STRIP)["trusted_digits"]
    return statics.table("S09", main, references(), digits, QUICK if quick else None)
