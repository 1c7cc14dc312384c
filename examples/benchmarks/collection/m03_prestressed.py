"""M3: bending vibrations of a beam under axial force, simply supported.

Inputs: length ``L`` (m), side ``h`` of the square section (m), ``E`` (Pa), ``nu``, ``rho``
(kg/m^3), ``kappa``, axial force ``T`` (N) or ``fac``, that force over ``pi^2 EI/L^2``. The case is
fac as text, and any number above -1 will do (at about -1 the beam buckles).

Fields: ``T`` (N), ``omega_bending`` (rad/s), the first five. The state about which it vibrates is
found by :func:`skfem_cosserat.static`, in one load step.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import skfem_cosserat as sc
from collection import common, inputs, vibration

ENTRIES = ("M3_prestressed_SS",)
QUICK = ("-0.9", "0", "1", "100")
DATA = {"L": 1.0, "h": 0.05, "E": 210e9, "nu": 0.3, "kappa": "5/6", "rho": 7850.0}
DATA |= {"fac": 0.0, "T": None}
MODES = 5


def given(case: str | float | None, data: Mapping[str, Any] | None) -> dict[str, float]:
    """Inputs of a case as numbers.

    Raises
    ------
    InputError
        For an unknown case or input.
    """
    defaults = dict(DATA)
    if case not in (None, *ENTRIES):
        try:
            defaults["fac"] = float(case)
        except (TypeError, ValueError):
            known = list(common.entry(ENTRIES[0])["values"])
            raise sc.InputError("argument case", f"{case!r}, expected one like {known}") from None
    d = common.overridden(defaults, data)
    signed = {"nu": -1.0, "fac": -np.inf}
    out = {n: inputs.number(n, x, beyond=signed.get(n, 0.0)) for n, x in d.items() if n != "T"}
    euler = np.pi**2 * out["E"] * out["h"] ** 4 / 12 / out["L"] ** 2
    out["T"] = out["fac"] * euler if d["T"] is None else inputs.number("T", d["T"])
    if out["T"] <= -out["E"] * out["h"] ** 2:
        raise sc.InputError("data", f"T = {out['T']:g} N presses the beam to nothing")
    return out


def scene(elements: int, order: int, d: Mapping[str, float]) -> sc.System:
    """The beam on its supports, with the force at the end that may slide."""
    h = d["h"]
    section = vibration.section(h, h, d["E"], d["nu"], d["rho"], d["kappa"])
    model, item = vibration.beam(d["L"], elements, order, section)
    vibration.supported(model, item, "SS", d["L"])
    if d["T"]:
        model.add("pull", sc.LoadForce(item.node("b"), (d["T"], 0, 0)))
    return model.freeze()


def main(
    case: str | float | None = None,
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
        cost.unknowns = system.unknowns
        path = None
        if d["T"]:
            path = sc.static(system, method.treatment, control=sc.LoadControl(steps=1), watch=False)
            cost.add(path)
        omega = vibration.bending(system, MODES, path)
    fields = {"T": d["T"], "omega_bending": omega.tolist()}
    return vibration.answered(fields, cost, method, number)


def rows(quick: bool = True) -> list[dict[str, Any]]:
    """Its part of the table."""
    return vibration.table("M03", ENTRIES[0], QUICK, main)
