"""M2: rotating cantilever, Euler-Bernoulli and inextensible, seen from the rotor.

Inputs, without units: ``eta``, the speed times ``sqrt(rhoA L^4/EI)``, and ``hub``, the radius of
the hub over L; or with units ``Omega`` (rad/s), ``EI``, ``rhoA``, ``L``, from which eta follows
unless it is given. A case "hub=0,eta=2" gives both, and any other numbers will do.

Fields: ``flap`` (across the plane of rotation) and ``lag`` (in it), the first four frequencies
times ``sqrt(rhoA L^4/EI)``.

The package's beams shear and stretch. A square beam of the ``slenderness`` s = L/h differs from
the reference by a series in 1/s^2 (strains of shear and stretch, rotary inertia), and the values
at s = 50, 100, 200 and 400 are extrapolated to 1/s = 0; a ``slenderness`` among the data is taken
as it is.
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

ENTRIES = ("M2_rotating_EB",)
QUICK = ("hub=0,eta=2", "hub=1,eta=5")
DATA = {"hub": 0.0, "eta": 0.0, "Omega": 0.0, "EI": 1.0, "rhoA": 1.0, "L": 1.0, "slenderness": None}
LADDER = (50.0, 100.0, 200.0, 400.0)
#: from order 3 on enough for 2e-9, which rounding at the slenderness 400 does not let it better
ELEMENTS = {1: 400, 2: 200, 3: 120, 4: 40}
MODES = 4
#: share of a shift in flap or lag; torsion that the rotation couples to flap is below
SIDEWAYS = 2e-3


def given(case: str | None, data: Mapping[str, Any] | None) -> dict[str, Any]:
    """Inputs of a case: hub, eta and slenderness.

    Raises
    ------
    InputError
        For an unknown case or input.
    """
    defaults = dict(DATA)
    if case not in (None, *ENTRIES):
        found = re.fullmatch(r"hub=([^,]+),eta=([^,]+)", str(case))
        if not found:
            known = list(common.entry(ENTRIES[0])["values"])
            raise sc.InputError("argument case", f"{case!r}, expected one like {known}")
        defaults |= {"hub": found[1], "eta": found[2]}
    d = common.overridden(defaults, data)
    least = dict.fromkeys(("EI", "rhoA", "L"), 0.0)
    numbers = {
        n: inputs.number(n, x, beyond=least.get(n, -np.inf))
        for n, x in d.items()
        if n != "slenderness"
    }
    if "Omega" in (data or {}) and "eta" not in (data or {}):
        unit = np.sqrt(numbers["EI"] / numbers["rhoA"]) / numbers["L"] ** 2
        numbers["eta"] = numbers["Omega"] / unit
    slender = d["slenderness"]
    ladder = LADDER if slender is None else (inputs.number("slenderness", slender, beyond=0.0),)
    return {"hub": numbers["hub"], "eta": numbers["eta"], "ladder": ladder}


def scene(elements: int, order: int, hub: float, slenderness: float) -> sc.System:
    """A blade of length 1, EI = 1, mass 1, square, nu = 0.3 and kappa = 5/6."""
    h = 1 / slenderness
    section = vibration.section(h, h, 12 / h**4, 0.3, 1 / h**2, 5 / 6)
    model, item = vibration.beam(1.0, elements, order, section, root=hub)
    model.add("root", sc.JointFixed(sc.ground((hub, 0, 0)), item.node("a")))
    return model.freeze()


def frequencies(system: sc.System, eta: float, treatment: Any, cost: common.Cost) -> Any:
    """Flap and lag (2, MODES) about the blade that the speed has stretched."""
    spin = sc.Spin((0, 0, eta))
    if eta:
        path = sc.static(system, treatment, control=sc.LoadControl(steps=1), spin=spin, watch=False)
        cost.add(path)
        found = sc.modes(system, path, 3 * MODES + 8, spin=spin)
    else:
        found = sc.modes(system, count=3 * MODES + 8)
    share = vibration.moving(found)[:, 1:]
    if not eta:  # every one is double
        both = found.omega[share.sum(1) > SIDEWAYS][: 2 * MODES : 2]
        return np.array([both, both])
    own = share > np.maximum(share[:, ::-1], SIDEWAYS)
    return np.array([found.omega[own[:, k]][:MODES] for k in (1, 0)])


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
    d = given(case, data)
    number = ELEMENTS[order] if method.elements is None else method.elements
    values: list[Any] = []
    with common.timed() as cost:
        for slenderness in d["ladder"]:
            system = scene(number, order, d["hub"], slenderness)
            cost.unknowns = system.unknowns
            values.append(frequencies(system, d["eta"], method.treatment, cost))
    scheme = common.neville(values, [1 / s**2 for s in d["ladder"]])
    flap, lag = scheme[-1][-1].tolist()
    fields: dict[str, Any] = {"flap": flap, "lag": lag}
    if len(values) > 1:
        fields["estimated_error"] = float(abs(scheme[-1][-1] - scheme[-1][-2]).max())
    return vibration.answered(fields, cost, method, number)


def rows(quick: bool = True) -> list[dict[str, Any]]:
    """Its part of the table."""
    cases = QUICK if quick else common.entry(ENTRIES[0])["values"]
    return vibration.table("M02", ENTRIES[0], cases, main)
