"""M2: rotating cantilever, Euler-Bernoulli and inextensible, seen from the rotor.

Inputs, without units: ``eta``, the speed times ``sqrt(rhoA L^4/EI)``, and ``hub``, the radius of
the hub over L; or with units ``Omega`` (rad/s), ``EI``, ``rhoA``, ``L``, from which eta follows
unless it is given. A case "hub=0,eta=2" gives both, and any other numbers will do.

Fields: ``flap`` (across the plane of rotation) and ``lag`` (in it), the first four frequencies
times ``sqrt(rhoA L^4/EI)``.

The blade is a beam of ``TheoryInextensible`` without torsion and without rotary inertia. Such a
blade is straight at every speed: no equilibrium has to be found. With elements of order p and
length h, frequencies are off by a series in h^(2p), h^(2p + 2) ...: those of all elements, of half
and of a quarter as many are extrapolated, and ``estimated_error`` is what the last of the three
changes. A ``slenderness`` L/h among the data asks for a square beam with shear, extension and
rotary inertia instead, which is taken as it is.
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
ELEMENTS = {1: 200, 2: 100, 3: 60, 4: 32}
MODES = 4
#: elements times their order, with which a blade has these modes
LEAST = 5
#: share of a shift in flap or lag; torsion that the rotation couples to flap is below
SIDEWAYS = 2e-3


def given(case: str | None, data: Mapping[str, Any] | None) -> dict[str, Any]:
    """Inputs of a case: hub, eta and slenderness (None: inextensible).

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
    if slender is not None:
        slender = inputs.number("slenderness", slender, beyond=0.0)
    return {"hub": numbers["hub"], "eta": numbers["eta"], "slenderness": slender}


def scene(elements: int, order: int, hub: float, slenderness: float | None = None) -> sc.System:
    """A blade of length 1, EI = 1, mass 1; if not inextensible, square, nu = 0.3, kappa = 5/6."""
    theory: sc.Theory = sc.TheoryReissner()
    if slenderness is None:
        theory = sc.TheoryInextensible(torsion=False)
        section = sc.Section.from_constants(
            EA=1.0, GA=1.0, EI=(1.0, 1.0), GJ=1.0, mass=1.0, inertia=(0.0, 0.0)
        )
    else:
        h = 1 / slenderness
        section = vibration.section(h, h, 12 / h**4, 0.3, 1 / h**2, 5 / 6)
    model, item = vibration.beam(1.0, elements, order, section, root=hub, theory=theory)
    model.add("root", sc.JointFixed(sc.ground((hub, 0, 0)), item.node("a")))
    return model.freeze()


def inextensible(system: sc.System, eta: float) -> Any:
    """Flap and lag (2, MODES) of the blade that is straight at any speed."""
    spin = sc.Spin((0, 0, eta)) if eta else None
    return _sorted(sc.modes(system, system.q0, 2 * MODES + 2, spin=spin), eta)


def frequencies(system: sc.System, eta: float, treatment: Any, cost: common.Cost) -> Any:
    """Flap and lag (2, MODES) about the blade that the speed has stretched."""
    spin = sc.Spin((0, 0, eta))
    if not eta:
        return _sorted(sc.modes(system, count=3 * MODES + 8), eta)
    path = sc.static(system, treatment, control=sc.LoadControl(steps=1), spin=spin, watch=False)
    cost.add(path)
    return _sorted(sc.modes(system, path, 3 * MODES + 8, spin=spin), eta)


def _sorted(found: sc.Modes, eta: float) -> Any:
    """Flap and lag (2, MODES) among these modes."""
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
    fields: dict[str, Any] = {}
    with common.timed() as cost:
        system = scene(number, order, d["hub"], d["slenderness"])
        cost.unknowns = system.unknowns
        if d["slenderness"] is not None:
            values = frequencies(system, d["eta"], method.treatment, cost)
        else:
            counts = common.levels(number, order, LEAST)
            found = [inextensible(system, d["eta"])]
            found += [inextensible(scene(n, order, d["hub"]), d["eta"]) for n in counts[1:]]
            values = common.refined(found, counts, order)
            if len(found) > 1:
                change = values - common.refined(found[:-1], counts[:-1], order)
                fields["estimated_error"] = float(abs(change).max())
    flap, lag = values.tolist()
    return vibration.answered({"flap": flap, "lag": lag, **fields}, cost, method, number)


def rows(quick: bool = True) -> list[dict[str, Any]]:
    """Its part of the table."""
    cases = QUICK if quick else common.entry(ENTRIES[0])["values"]
    return vibration.table("M02", ENTRIES[0], cases, main)
