"""What the families of vibrating beams share: straight beams on supports, bending sorted out."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

import skfem_cosserat as sc
from collection import common, inputs

__all__ = ["answered", "beam", "bending", "elements_for", "moving", "section", "supported", "table"]

Floats = NDArray[np.float64]

#: elements of a beam by order, where the caller has none: beyond these rounding takes over
ELEMENTS = {1: 400, 2: 400, 3: 400, 4: 128}
#: share of motion across the beam above which a mode is one of bending: it is 1 or 0
ACROSS = 0.5


def elements_for(method: inputs.Method, least: int = 1) -> int:
    """The caller's number of elements, or enough for twelve digits from order 3 on."""
    return max(ELEMENTS[method.order], least) if method.elements is None else method.elements


def section(b: float, h: float, E: float, nu: float, rho: float, kappa: float) -> sc.Section:
    """Rectangle b x h, with its stiffness in the plane of h in both planes.

    Every frequency of bending is double then, and is not mistaken for one across the plane. The
    torsion constant, which none depends on, is that of a square.
    """
    area, second = b * h, b * h**3 / 12
    G = E / (2 * (1 + nu))
    return sc.Section.from_constants(
        EA=E * area,
        GA=kappa * G * area,
        EI=(E * second, E * second),
        GJ=G * 0.1406 * b * h**3,
        mass=rho * area,
        inertia=(rho * second, rho * second),
    )


def beam(
    length: float,
    elements: int,
    order: int,
    section: sc.Section,
    root: float = 0.0,
    theory: sc.Theory | None = None,
) -> Any:
    """Model and beam along e1 from (root, 0, 0), with nodes "a" and "b" at its ends."""
    theory = theory or sc.TheoryReissner()
    ends = (root, 0, 0), (root + length, 0, 0)
    mesh = sc.MeshCurve.init_line(*ends, elements, nodes={"a": 0.0, "b": 1.0})
    model = sc.Model()
    beam = sc.Beam(mesh, section, director=(0, 1, 0), order=order, theory=theory)
    item = model.add("beam", beam)
    return model, item


def supported(model: sc.Model, item: sc.Beam, ends: str, length: float) -> None:
    """Hold both ends: clamped (C), simply supported (S) or free (F).

    Of two ends that are held and not both clamped the far one may slide along. It is not let
    turn about its own axis unless it is free.
    """
    for end, name, x in zip(ends, "ab", ((0, 0, 0), (length, 0, 0)), strict=True):
        node, place = item.node(name), sc.ground(x)
        if end == "C":
            model.add(f"end {name}", sc.JointFixed(place, node))
        elif end == "S" and (name == "a" or ends[0] == "F"):
            model.add(f"end {name}", sc.JointUniversal(place, node, (0, 1, 0), (0, 0, 1)))
        elif end == "S":
            model.add(f"end {name}", sc.JointPointOnLine(place, node, axis=(1, 0, 0)))


def moving(found: sc.Modes) -> Floats:
    """Share (count, 3) of a mode's motion that shifts the centre line along x, y and z.

    The rest turns sections; a turn by one radian counts as a shift by the extent of the scene.
    """
    system = found.system
    squares = abs(found.shapes.reshape(len(found), -1, 3)) ** 2
    shifts = squares[:, system.origin_rows].sum(1)
    turns = squares.sum((1, 2)) - shifts.sum(1)
    total = shifts.sum(1) + system.length**2 * turns
    return shifts / total[:, None]


def bending(system: sc.System, wanted: int, state: Any = None) -> Floats:
    """First frequencies (wanted,) of bending (rad/s), of pairs the mean; rigid motions left out.

    Those of stretching and torsion neither move the centre line sideways nor turn its sections
    about an axis across it. (Simple supports let all sections turn alike, the line at rest: the
    first mode of Timoshenko's second spectrum.)
    """
    count = min(4 * wanted + 12, system.unknowns)
    while True:
        found = (
            sc.modes(system, state, count) if state is not None else sc.modes(system, count=count)
        )
        omega = found.omega[(_across(found) > ACROSS) & (np.arange(len(found)) >= found.rigid)]
        if len(omega) >= 2 * wanted or count == system.unknowns:
            break
        count = min(2 * count, system.unknowns)
    if len(omega) < 2 * wanted:
        raise sc.InputError("elements", f"too few for {wanted} frequencies of bending")
    return omega[: 2 * wanted].reshape(-1, 2).mean(1)


def _across(found: sc.Modes) -> Floats:
    """Share (count,) of a mode's motion that bends a straight beam along e1.

    Its points shift sideways, or its sections turn about an axis across it, which moves their
    third director sideways.
    """
    system = found.system
    squares = abs(found.shapes.reshape(len(found), -1, 3)) ** 2
    shifts = squares[:, system.origin_rows].sum(1)
    turns = squares[:, system.origin_rows + 3].sum(1)[:, 1:].sum(1)
    others = squares.sum((1, 2)) - shifts.sum(1) - 2 * turns
    bent = shifts[:, 1:].sum(1) + system.length**2 * 2 * turns
    return np.asarray(bent / (bent + shifts[:, 0] + system.length**2 * others))


def answered(
    fields: Mapping[str, Any], cost: common.Cost, method: inputs.Method, elements: int
) -> dict[str, Any]:
    """What ``main`` gives."""
    taken = {"order": method.order, "elements": elements, "step": None}
    return {**fields, **cost.fields(), **taken}


def table(
    family: str,
    name: str,
    cases: Iterable[str],
    main: Callable[[str], dict[str, Any]],
) -> list[dict[str, Any]]:
    """Rows for these cases of an entry; of a frequency 13 digits are trusted."""
    out = []
    for case in cases:
        found, reference = main(case), common.entry(name)["values"][case]
        for field, value in reference.items():
            size = float(abs(np.asarray(value, dtype=float)).max())
            rows = common.compare(case, found, {field: value}, 1e-13 * size)
            out += common.tabled(family, found, rows)
    return out
