"""R3: free rigid body with three different moments of inertia.

Inputs: inertia ``I`` (kg m^2; principal values or a tensor), angular velocity ``Omega0`` in the
body (rad/s), start ``q0`` (w, x, y, z, or "identity").

Fields over ``t``: ``state``, that is quaternion (w, x, y, z, body to space) and angular velocity
in the body. ``jacobi`` is no computation in time: modulus ``k2``, argument ``omega_arg`` and
``period_Omega`` of the solution in elliptic functions, for principal values in rising or falling
order. A case is the entry's name, one of its keys ("jacobi": these three alone), or an instant (s).
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import ellipk

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import skfem_cosserat as sc
from collection import common, inputs, motion

ENTRIES = ("R3_free_rigid_body_general",)
QUICK = ("1", "2")
DATA = {"I": (1.0, 2.0, 3.0), "Omega0": (1.0, 1.0, 1.0), "q0": "identity"}


def scene(data: Mapping[str, Any] | None = None) -> sc.System:
    """A body on its own; nothing depends on its mass."""
    d = common.overridden(DATA, data)
    triad = inputs.triad("q0", d["q0"])
    omega = inputs.vector("Omega0", d["Omega0"]) @ triad
    model = sc.Model()
    model.add("body", sc.RigidBody(1.0, d["I"], triad=triad, angular_velocity=omega))
    return model.freeze()


def jacobi(data: Mapping[str, Any] | None = None) -> dict[str, float]:
    """Modulus, argument and period; NaN where the inertia is no three different values in order."""
    d = common.overridden(DATA, data)
    J, omega = np.asarray(d["I"], dtype=float), inputs.vector("Omega0", d["Omega0"])
    if J.shape != (3,) or np.prod(np.diff(J)) <= 0:
        return dict.fromkeys(("k2", "omega_arg", "period_Omega"), float("nan"))
    if J[0] > J[2]:
        J, omega = J[::-1], omega[::-1]
    twice, square = J @ omega**2, (J * omega) @ (J * omega)
    if square < twice * J[1]:  # about the axis of the smallest moment
        J = J[::-1]
    high = (J[2] - J[1]) * (square - twice * J[0])
    k2 = (J[1] - J[0]) * (twice * J[2] - square) / high
    argument = np.sqrt(high / J.prod())
    return {"k2": k2, "omega_arg": argument, "period_Omega": 4 * ellipk(k2) / argument}


def read(track: motion.Track) -> dict[str, Any]:
    """Quaternion and angular velocity."""
    frames, rates = track.frames("body"), track.rates("body")
    ids = track.ids
    return {"state": np.c_[motion.quaternions(frames)[ids], motion.spin(frames[ids], rates)]}


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
    """Tumble; see :mod:`.common` and the top of this file."""
    method = inputs.method(order, elements, step, integrator, treatment, times)
    values = common.entry(ENTRIES[0])["values"]
    _, instant = inputs.chosen(case, ENTRIES, values)
    system, closed = scene(data), jacobi(data)
    if case == "jacobi":
        none = common.Cost(unknowns=0).fields()
        return {**closed, **none, "order": None, "elements": None, "step": None}
    omega = np.linalg.norm(common.overridden(DATA, data)["Omega0"])
    problem = motion.Problem(system, read, coarsest=0.1 / omega if omega else 1.0)
    result = motion.answer(problem, method, values["t"], instant)
    return {**result, "jacobi": closed}


def rows(quick: bool = True) -> list[dict[str, Any]]:
    """Its part of the table."""
    result = main(times=[float(t) for t in QUICK] if quick else None)
    return motion.table("R03", ENTRIES[0], result, ["state"])
