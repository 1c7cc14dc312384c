"""Velocities from rates of joint coordinates: initial conditions in reduced form."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..diagnostics import Projection
from ..diagnostics.relative import rates as rates_of_rows
from ..errors import InputError
from ..joint import Joint
from ..model import System
from ..model.couplings import Invariants, kind_of
from ..relative import RelativeCoordinate
from ..types import ArrayLike, Floats, numbers

__all__ = ["with_joint_rates"]


def with_joint_rates(
    system: System, q: Floats, v: Floats, rates: Mapping[str, float], t: float
) -> Floats:
    """Velocity nearest to v (in the kinetic energy) with given rates of joint coordinates.

    It fulfils the hidden constraints: loops and drives included. See
    :func:`~skfem_cosserat.project`.
    """
    if not isinstance(rates, Mapping) or not all(isinstance(name, str) for name in rates):
        raise InputError(
            "initial state", f"rates = {rates!r}, expected a dict of rates by joint names"
        )
    projection = Projection(system)
    nearest = projection(q, (system.mass @ v.reshape(-1, 3)).reshape(-1), t)[0]
    if not rates:
        return nearest
    y = system.extend(q, t)
    found = [_coordinate(system, name) for name in rates]
    slopes = np.array([_slope(system, joint, c, y) for joint, c in found])
    wanted = np.array([_number(name, rate) for name, rate in rates.items()])
    ground = rates_of_rows(system, np.zeros((1, system.n)), np.array([t]))[0]
    given = wanted - slopes[:, : system.rows].reshape(len(found), -1) @ nearest
    given -= (slopes[:, system.rows :] * ground[system.rows :]).sum((1, 2))
    # how the scene answers to a unit impulse on each coordinate
    still = projection(q, np.zeros(system.n), t)[0]
    impulses = slopes[:, : system.rows].reshape(len(found), -1)
    answers = np.array([projection(q, impulse, t)[0] - still for impulse in impulses])
    gram = impulses @ answers.T
    size = np.sqrt(np.maximum(np.diagonal(gram), 0.0))  # zero for what a drive holds
    scale = 1 / np.where(size > 1e-12 * size.max(initial=1e-300), size, 1.0)
    weights = np.linalg.lstsq(scale[:, None] * gram * scale, scale * given, rcond=1e-10)[0]
    miss = given - gram @ (scale * weights)
    worst = int(abs(miss).argmax())
    if abs(miss[worst]) > 1e-8 * max(1.0, float(abs(wanted).max())):
        raise InputError(
            "initial state",
            f"rates: {list(rates)[worst]!r} cannot have the rate {wanted[worst]:.6g} together with"
            f" the joints and the other rates (off by {miss[worst]:.6g})",
        )
    return np.asarray(nearest + (scale * weights) @ answers)


def _coordinate(system: System, key: str) -> tuple[Joint, RelativeCoordinate]:
    """Joint and coordinate of a key "joint" or "joint/coordinate"."""
    named = {joint.name: joint for joint in system.joints}
    name, _, coordinate = key.rpartition("/")
    if key in named:
        return named[key], named[key].coordinate()
    if name in named:
        return named[name], named[name].coordinate(coordinate)
    raise InputError("initial state", f"rates: no joint {key!r}; known: {sorted(map(str, named))}")


def _number(name: str, rate: ArrayLike) -> float:
    value = numbers("initial state", f"rates: {name!r}", rate)
    if value.shape != () or not np.isfinite(value):
        raise InputError("initial state", f"rates: {name!r} = {rate!r}, expected a finite number")
    return float(value)


def _slope(system: System, joint: Joint, coordinate: RelativeCoordinate, y: Floats) -> Floats:
    """``d xi/d y`` (total, 3) of a coordinate with one component."""
    if coordinate.size != 1:
        raise InputError(
            "initial state",
            f"rates: the {coordinate.name} of the {joint.label} has {coordinate.size} components,"
            " only angles and displacements can be given",
        )
    invariants = Invariants([coordinate.forms], system.row_of)
    slope = kind_of((coordinate,)).slope(invariants.values(y))[0, 0]
    out = np.zeros((system.total, 3))
    np.add.at(out, invariants.rows[0], np.tensordot(slope, invariants.gradients(y)[0], 1))
    return out
