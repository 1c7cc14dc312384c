"""S3: the 45-degree bend: a clamped arc of a circle, a dead tip force out of its plane.

Square section, 1 x 1. Three variants: with shear stiffness G, with 5/6 of it, and Kirchhoff's
inextensible rod, a beam of ``TheoryInextensible``, extrapolated from three meshes. With order 3 and
64 elements the tip of the others is right to 5e-11, a tenth of what the reference's 11 digits leave
open.

``case``: "GA=5e6,GJ=8.3333e5(J=1/6);P=600" and so on, the keys of the entry's ``cases``; default:
this one. ``data``: R, E, G, J, kappa (of shear), arc_deg, P; EA, GA (None: none of its compliance),
EI, GJ. Gives tip, disp, quat (of the tip's section), root_moment (on the rod), strain_energy.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

sys.path.extend(str(Path(__file__).resolve().parents[k]) for k in (1, 2))

import static_scenes

import skfem_cosserat as sc
from collection import common, statics

ENTRIES = ("S3_bend45",)
FIELDS = ("tip", "disp", "quat", "root_moment", "strain_energy")
ENTRY = common.entry(ENTRIES[0])
CASES = tuple(ENTRY["values"]["cases"])
QUICK = (CASES[1], CASES[2], CASES[7])
#: the variants by the names that cases begin with
SECTIONS: dict[str, dict[str, Any]] = {
    "GA=5e6,GJ=8.3333e5(J=1/6)": {},
    "GA=5/6*5e6,GJ=8.3333e5": {"kappa": 5 / 6},
    "Kirchhoff inextensible": {"EA": None, "GA": None},
}
DATA = {
    "R": 100.0,
    "E": 1e7,
    "G": 5e6,
    "J": 1 / 6,
    "kappa": 1.0,
    "arc_deg": 45.0,
    "P": 600.0,
    "EA": lambda d: d["E"],
    "GA": lambda d: d["kappa"] * d["G"],
    "EI": lambda d: d["E"] / 12,
    "GJ": lambda d: d["G"] * d["J"],
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
    """One load; default: 600 on the first section. See :mod:`.common` for the arguments."""
    section, P = statics.chosen(case, CASES, CASES[2]).split(";P=")
    d = statics.inputs(DATA, SECTIONS[section] | {"P": float(P)}, data, optional=("EA", "GA"))

    def compute(asked: statics.Asked) -> dict[str, Any]:
        def tip(
            EA: float,
            GA: float,
            theory: sc.Theory = static_scenes.FULL,
            count: int = asked.elements,
        ) -> dict[str, Any]:
            section = static_scenes.flat_section(d["EI"], EA, GA, d["EI"], d["GJ"])
            scene = static_scenes.arc(
                count,
                order,
                section,
                {"force": (0.0, 0.0, d["P"])},
                radius=d["R"],
                degrees=d["arc_deg"],
                theory=theory,
            )
            path = asked.path(scene, derive=True)
            return {
                "tip": scene.position(path).tolist(),
                "disp": scene.displacement(path).tolist(),
                "quat": scene.quaternion(path).tolist(),
                "root_moment": (-path["joint/clamp/moment"][-1]).tolist(),
                "strain_energy": float(path["strain_energy"][-1]),
            }

        scale = d["EI"] / d["R"] ** 2
        if d["GA"] is None:
            return statics.held(asked, d, scale, tip)
        return statics.limit(d, scale, tip)

    counts = statics.HELD if d["GA"] is None else ELEMENTS
    return statics.answer(
        compute, FIELDS, counts, order, elements, step, integrator, treatment, times
    )


def references() -> dict[str, dict[str, Any]]:
    """Numbers by case, strain energies among them."""
    values = ENTRY["values"]
    out = {key: {f: v[f] for f in FIELDS if f in v} for key, v in values["cases"].items()}
    for P, energy in values["strain_energy_GA5e6_J1/6"].items():
        out[f"{next(iter(SECTIONS))};P={P}"]["strain_energy"] = energy
    return out


def rows(quick: bool = True) -> list[dict[str, Any]]:
    """All cases."""
    digits = ENTRY["trusted_digits"]
    return statics.table("S03", main, references(), digits, QUICK if quick else None)
