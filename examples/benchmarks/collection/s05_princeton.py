"""S5: the Princeton beam: a flat cantilever, tip force at an angle from its chord.

Flap, chord and twist couple. ``tip_swappedGA`` (axial, flap, chord) belongs to the same beam with
its two shear stiffnesses exchanged.

``case``: "P=4.448,theta=30" and so on; default: "P=13.345,theta=45". ``data``: L, EA, GA_flap,
GA_chord, GJ, EI_chordwise, EI_flapwise, P, theta (degrees). Gives tip_flap, tip_chord, tip_axial,
rotvec, twist_atan2_R32_R33, twist_atan2_R32_R22, tip_swappedGA; axes: axial, flap, chord.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

sys.path.extend(str(Path(__file__).resolve().parents[k]) for k in (1, 2))

import static_scenes

from collection import common, statics

ENTRIES = ("S5_princeton",)
ENTRY = common.entry(ENTRIES[0])
CASES = tuple(ENTRY["values"])
FIELDS = tuple(name for name in ENTRY["values"][CASES[0]] if name != "resid")
QUICK = ("P=4.448,theta=30", "P=13.345,theta=45", "P=13.345,theta=90")
DATA = {**static_scenes.PRINCETON, "P": 13.345, "theta": 45.0}
ELEMENTS = {1: 200, 2: 100, 3: 32, 4: 12}


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
    """One load at one angle. See :mod:`.common` for the arguments."""
    d = statics.inputs(DATA, statics.parts(statics.chosen(case, CASES, "P=13.345,theta=45")), data)
    constants = {name: d[name] for name in static_scenes.PRINCETON}

    def compute(asked: statics.Asked) -> dict[str, Any]:
        scenes = [
            static_scenes.princeton(
                asked.elements, order, d["P"], d["theta"], exchanged=exchanged, constants=constants
            )
            for exchanged in (False, True)
        ]
        path, swapped = (asked.path(scene) for scene in scenes)
        axial, flap, chord = scenes[0].displacement(path).tolist()
        R = scenes[0].rotation(path)
        return {
            "tip_flap": flap,
            "tip_chord": chord,
            "tip_axial": axial,
            "rotvec": Rotation.from_matrix(R).as_rotvec().tolist(),
            "twist_atan2_R32_R33": float(np.arctan2(R[2, 1], R[2, 2])),
            "twist_atan2_R32_R22": float(np.arctan2(R[2, 1], R[1, 1])),
            "tip_swappedGA": scenes[1].displacement(swapped).tolist(),
        }

    return statics.answer(
        compute, FIELDS, ELEMENTS, order, elements, step, integrator, treatment, times
    )


def rows(quick: bool = True) -> list[dict[str, Any]]:
    """All loads and angles; digits of what vanishes are counted from the length of the beam."""
    references = {key: {f: v[f] for f in FIELDS} for key, v in ENTRY["values"].items()}
    digits, length = ENTRY["trusted_digits"], DATA["L"]
    return statics.table("S05", main, references, digits, QUICK if quick else None, least=length)
