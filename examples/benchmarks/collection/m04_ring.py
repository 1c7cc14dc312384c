"""M4: vibrations of a free circular ring in its plane and out of it.

Inputs: radius ``R`` (m), side ``h`` of the square section (m), ``E`` (Pa), ``nu``, ``rho``
(kg/m^3), ``kappa``, torsion constant ``J`` (m^4; default 0.1405770 h^4) and wavenumber ``n``. The
case "n=2" gives n, and any other will do.

Fields: ``inplane_omega`` and ``outplane_omega`` (rad/s), of each the three branches with n waves
around the ring: mostly bending, stretching or torsion, shear. All modes of the ring are computed
and sorted by their waves, for between the branches of one n are those of many others.
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

ENTRIES = ("M4_ring",)
QUICK = ("n=0", "n=2")
DATA = {"R": 1.0, "h": 0.1, "E": 210e9, "nu": 0.3, "kappa": "5/6", "J": None, "rho": 7850.0, "n": 2}
#: where all modes are computed in a second or two, and for the long table
ELEMENTS = {1: 144, 2: 72, 3: 48, 4: 32}
LONG = 96
BRANCHES = 3


def given(case: str | None, data: Mapping[str, Any] | None) -> dict[str, Any]:
    """Inputs of a case as numbers.

    Raises
    ------
    InputError
        For an unknown case or input.
    """
    defaults = dict(DATA)
    if case not in (None, *ENTRIES):
        found = re.fullmatch(r"n=(\d+)", str(case))
        if not found:
            known = list(common.entry(ENTRIES[0])["values"])
            raise sc.InputError("argument case", f"{case!r}, expected one like {known}")
        defaults["n"] = int(found[1])
    d = common.overridden(defaults, data)
    if d["J"] is None:
        d["J"] = 0.1405770 * inputs.number("h", d["h"], beyond=0.0) ** 4
    n = d.pop("n")
    if isinstance(n, bool) or not isinstance(n, int | np.integer) or n < 0:
        raise sc.InputError("data", f"n = {n!r}, expected an integer from 0 on")
    beyond = {"nu": -1.0}
    return {"n": int(n)} | {
        name: inputs.number(name, x, beyond=beyond.get(name, 0.0)) for name, x in d.items()
    }


def scene(elements: int, order: int, d: Mapping[str, Any]) -> sc.System:
    """The ring in the plane xy, held nowhere."""
    area, second, G = d["h"] ** 2, d["h"] ** 4 / 12, d["E"] / (2 * (1 + d["nu"]))
    section = sc.Section.from_constants(
        EA=d["E"] * area,
        GA=d["kappa"] * G * area,
        EI=(d["E"] * second, d["E"] * second),
        GJ=G * d["J"],
        mass=d["rho"] * area,
        inertia=(d["rho"] * second, d["rho"] * second),
    )
    R = d["R"]
    arc = sc.MeshCurve.init_arc((R, 0, 0), (0, R, 0), (-R, 0, 0), R, 2 * np.pi, elements)
    model = sc.Model()
    model.add("ring", sc.Beam(arc, section, director=(0, 0, 1), order=order))
    return model.freeze()


def shares(found: sc.Modes, n: int, radius: float) -> Any:
    """Share of n waves in the motion of each mode (count, 2), in the plane and out of it.

    Of shifts and turns of the sections in cylindrical components, fitted by cos and sin n phi.
    """
    system = found.system
    rows = system.origin_rows
    x = system.q0.reshape(-1, 3)[rows]
    radial = x / radius
    axial = np.broadcast_to([0.0, 0.0, 1.0], x.shape)
    frame = np.stack([radial, np.cross(axial, radial), axial], axis=1)
    shapes = found.shapes.reshape(len(found), -1, 3)
    d = system.q0.reshape(-1, 3)
    turn = sum(0.5 * np.cross(d[rows + k], shapes[:, rows + k]) for k in (1, 2, 3))
    shift, turn = (np.einsum("rij,crj->cri", frame, v) for v in (shapes[:, rows], turn))
    phi = np.arctan2(x[:, 1], x[:, 0])
    basis, _ = np.linalg.qr(np.column_stack([np.cos(n * phi), np.sin(n * phi)][: 2 if n else 1]))
    planes = [np.concatenate([shift[:, :, :2], radius * turn[:, :, 2:]], axis=2)]
    planes.append(np.concatenate([shift[:, :, 2:], radius * turn[:, :, :2]], axis=2))
    total = sum((p**2).sum((1, 2)) for p in planes)
    waves = [(np.einsum("rb,cri->cbi", basis, p) ** 2).sum((1, 2)) for p in planes]
    return np.column_stack(waves) / total[:, None]


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
    number = max(ELEMENTS[order], 6 * d["n"]) if method.elements is None else method.elements
    with common.timed() as cost:
        system = scene(number, order, d)
        cost.unknowns = system.unknowns
        found = sc.modes(system, count=system.unknowns)
        share = shares(found, d["n"], d["R"])[found.rigid :]
    copies = 2 if d["n"] else 1
    fields = {}
    for name, own in zip(("inplane_omega", "outplane_omega"), share.T, strict=True):
        omega = found.omega[found.rigid :][own > 0.5]
        still = [0.0] * copies if d["n"] < 2 else []
        omega = np.array([*still, *omega])[: BRANCHES * copies]
        if len(omega) < BRANCHES * copies:
            raise sc.InputError("elements", f"{number} are too few for {d['n']} waves")
        fields[name] = omega.reshape(BRANCHES, copies).mean(1).tolist()
    return vibration.answered(fields, cost, method, number)


def rows(quick: bool = True) -> list[dict[str, Any]]:
    """Its part of the table."""
    cases, elements = (QUICK, None) if quick else (common.entry(ENTRIES[0])["values"], LONG)
    return vibration.table("M04", ENTRIES[0], cases, lambda case: main(case, elements=elements))
