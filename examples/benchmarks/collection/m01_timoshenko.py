"""M1: bending vibrations of Timoshenko beams on all supports.

Inputs: length ``L`` (m), width ``b`` and height ``h`` (m; it bends in the plane of h), ``E`` (Pa),
``nu``, ``rho`` (kg/m^3), shear factor ``kappa``, ``ends``: two of C (clamped), S (simply
supported), F (free); ``modes``: how many frequencies are wanted (default: five, with both ends free
or both clamped four, as the reference has them). A case "h=0.1,CF" gives height and ends; any
height and ends will do.

Fields: ``omega`` (rad/s), ``f_Hz``, ``omega_norm``, that is omega times
``sqrt(rho A L^4/(E I))``: the first frequencies of bending, of both spectra of Timoshenko's beam,
without rigid motions.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import skfem_cosserat as sc
from collection import common, inputs, vibration

ENTRIES = ("M1_timoshenko",)
QUICK = ("h=0.1,CF", "h=0.1,SS", "h=0.01,CF", "h=0.01,FF", "h=0.01,CC")
DATA = {"L": 1.0, "b": 1.0, "h": 0.1, "E": 210e9, "nu": 0.3, "rho": 7850.0, "kappa": "5/6"}
DATA |= {"ends": "CF", "modes": None}


def given(case: str | None, data: Mapping[str, Any] | None) -> dict[str, Any]:
    """Inputs of a case, numbers but the ends; ``modes`` as asked for, or as many as usual.

    Raises
    ------
    InputError
        For an unknown case or input, and for ends that are none.
    """
    defaults = dict(DATA)
    if case not in (None, *ENTRIES):
        found = re.fullmatch(r"h=([^,]+),([A-Z]{2})", str(case))
        if not found:
            known = list(common.entry(ENTRIES[0])["values"])
            raise sc.InputError("argument case", f"{case!r}, expected one like {known}")
        defaults |= {"h": found[1], "ends": found[2]}
    d = common.overridden(defaults, data)
    numbers = {
        n: inputs.number(n, x, beyond=-1.0 if n == "nu" else 0.0)
        for n, x in d.items()
        if n not in ("ends", "modes")
    }
    if not re.fullmatch("[CSF]{2}", str(d["ends"])):
        raise sc.InputError("data", f"ends = {d['ends']!r}, expected two of C, S and F")
    usual = 4 if d["ends"] in ("FF", "CC") else 5
    modes = usual if d["modes"] is None else inputs.count("modes", d["modes"])
    return {**numbers, "ends": d["ends"], "modes": modes}


def scene(elements: int, order: int, d: Mapping[str, Any]) -> sc.System:
    """The beam on its supports."""
    shape = [d[name] for name in ("b", "h", "E", "nu", "rho", "kappa")]
    section = vibration.section(*shape)
    model, item = vibration.beam(d["L"], elements, order, section)
    vibration.supported(model, item, d["ends"], d["L"])
    return model.freeze()


def main(
    case: str | None = None,
    data: Mapping[str, Any] | None = None,
    order: int = 3,
    elements: int | None = None,
    step: float | None = None,
    integrator: str = "energy-momentum",
    treatment: str = "null-space",
    times: Sequence[float] | None = None,
) -> dict[str, Any]:
    """Frequencies; see :mod:`.common` and the top of this file."""
    method = inputs.method(order, elements, step, integrator, treatment, times)
    d, number = given(case, data), vibration.elements_for(method)
    with common.timed() as cost:
        system = scene(number, order, d)
        omega = vibration.bending(system, d["modes"])
        cost.unknowns = system.unknowns
    unit = np.sqrt(d["E"] * d["h"] ** 2 / 12 / d["rho"]) / d["L"] ** 2
    fields = {"omega": omega, "f_Hz": omega / (2 * np.pi), "omega_norm": omega / unit}
    lists = {name: x.tolist() for name, x in fields.items()}
    return vibration.answered(lists, cost, method, number)


def rows(quick: bool = True) -> list[dict[str, Any]]:
    """Its part of the table."""
    return vibration.table("M01", ENTRIES[0], QUICK, main)
