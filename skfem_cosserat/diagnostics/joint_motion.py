"""Relative coordinates of joints, and coordinates, forces and energy of force elements."""

from __future__ import annotations

import numpy as np

from ..joint import Joint
from ..model import System, takes_scene
from ..model.force_elements import Invariants, kind_of
from ..types import ArrayLike, Floats, IndexArray
from .stacked import all_rows, as_stack, as_times

Pairs = dict[str, tuple[Floats, Floats]]


@takes_scene
def joint_coordinates(
    system: System,
    joint: Joint,
    q: ArrayLike,
    v: ArrayLike,
    t: ArrayLike = 0.0,
    turns: ArrayLike | None = None,
) -> Pairs:
    """Relative coordinates of a joint and their rates.

    ``simulate`` adds them to its history as ``joint/NAME/COORDINATE`` and
    ``joint/NAME/COORDINATE_rate``.

    Parameters
    ----------
    joint : Joint
        Of this system.
    q, v : (n,) or (N, n) array
        Configurations and velocities (m/s, 1/s).
    t : float or (N,) array
        Their times (s), for prescribed motion.
    turns : (angles,) or (N, angles) array, optional
        ``history["turns"]`` of angles with a force element. Driven angles are those prescribed;
        all others start from their principal value and are followed from state to state by the
        mean of their rates, which must be right to half a turn.

    Returns
    -------
    dict of str to (values, rates)
        By the names of the coordinates: numbers or (N,), of a rotation vector (3,) or (N, 3) (m,
        rad; m/s, rad/s).

    Raises
    ------
    InputError
        If the shape of `q` or `v` does not fit the system.

    Examples
    --------
    A wheel that turns with 2 rad/s:

    >>> from skfem_cosserat import JointRevolute, Model, RigidBody, ground
    >>> model = Model()
    >>> wheel = model.add("wheel", RigidBody.sphere(1.0, 1.0, angular_velocity=(0, 0, 2.0)))
    >>> axle = JointRevolute(ground((0, 0, 0)), wheel.at((0, 0, 0)), axis=(0, 0, 1))
    >>> axle = model.add("axle", axle)
    >>> system = model.freeze()
    >>> angle, rate = joint_coordinates(system, axle, system.q0, system.v0)["angle"]
    >>> float(angle), float(rate)
    (0.0, 2.0)
    """
    Q, single = as_stack(system, "q", q)
    V, _ = as_stack(system, "v", v, Q)
    times = as_times(t, len(Q))
    y, ydot = all_rows(system, Q, times), rates(system, V, times)
    found = _coordinates(system, joint, y, ydot, times, turns)
    return {name: (a[0], b[0]) for name, (a, b) in found.items()} if single else found


def rates(system: System, v: Floats, t: Floats) -> Floats:
    """Rates of all rows of y (N, total, 3) for velocities v (N, n)."""
    out = np.zeros((len(v), system.total, 3))
    out[:, : system.rows] = v.reshape(len(v), system.rows, 3)
    if system.moving:
        for row, s in zip(out, t, strict=True):
            row[system.rows :] = system.ground_rate(float(s))
    return out


def _coordinates(
    system: System,
    joint: Joint,
    y: Floats,
    ydot: Floats,
    times: Floats,
    turns: ArrayLike | None,
) -> Pairs:
    out = {}
    for coordinate in joint.coordinates():
        kind, invariants = kind_of((coordinate,)), Invariants([coordinate.forms], system.row_of)
        pi = invariants.values(y)
        xi = kind.value(pi)[:, 0]
        if coordinate.kind == "displacement":
            xi = xi - kind.value(invariants.values(system.extend(system.q0, 0.0)))[0]
        rate = (kind.slope(pi) @ invariants.rates(y, ydot)[..., None])[:, 0, :, 0]
        if kind.period:
            followed = _turns(system, joint, coordinate.name, turns)
            if followed is not None:
                xi = xi + kind.period * followed
            else:
                near = _expected(system, joint, coordinate.name, xi[:, 0], rate[:, 0], times)
                xi = xi + kind.period * np.round((near[:, None] - xi) / kind.period)
        single = coordinate.size == 1
        out[coordinate.name] = (xi[:, 0], rate[:, 0]) if single else (xi, rate)
    return out


def _expected(
    system: System, joint: Joint, name: str, xi: Floats, rate: Floats, times: Floats
) -> Floats:
    """About where an angle is (N,), to tell its full turns: as driven, or by its rates."""
    for drive in system.drives:
        if drive.joint is joint and drive.coordinate.name == name:
            return np.array([drive.value(float(t)) for t in times])
    steady = np.diff(times) * (rate[1:] + rate[:-1]) / 2
    steady = np.where(np.isfinite(steady), steady, 0.0)
    turn = 2 * np.pi
    moved = np.diff(xi)
    moved += turn * np.round((steady - moved) / turn)
    return xi[0] + np.concatenate([[0.0], np.cumsum(moved)])


def _turns(system: System, joint: Joint, name: str, turns: ArrayLike | None) -> IndexArray | None:
    """Full turns (N, 1) of a joint's angle, if a force element follows it."""
    if turns is None:
        return None
    for k, item in enumerate(system.couplings.angles):
        if (item.a, item.b) == (joint.a, joint.b) and item.coordinates[0].name == name:
            return np.atleast_2d(np.asarray(turns, dtype=np.int64))[:, k : k + 1]
    return None


@takes_scene
def coupling_energy(
    system: System, q: ArrayLike, t: ArrayLike = 0.0, turns: ArrayLike | None = None
) -> Floats:
    """Energy stored in springs, cables and bushings.

    Parameters
    ----------
    q : (n,) or (N, n) array
        Configurations.
    t : float or (N,) array
        Their times (s), for prescribed motion.
    turns : (angles,) or (N, angles) array, optional
        Full turns of angles, ``history["turns"]``; default: none.

    Returns
    -------
    float or (N,) array
        Stored by all of them (J).

    Raises
    ------
    InputError
        If the shape of `q` or `turns` does not fit the system.

    Examples
    --------
    A spring that is 1 m longer than at rest:

    >>> from skfem_cosserat import MassPoint, Model, SpringDamper, ground
    >>> model = Model()
    >>> bob = model.add("bob", MassPoint(1.0, position=(0, 0, -2)))
    >>> spring = model.add("spring", SpringDamper(ground((0, 0, 0)), bob.place(), stiffness=50.0))
    >>> coupling_energy(model.freeze(), [[0, 0, -2.0], [0, 0, -3.0]]).tolist()
    [0.0, 25.0]
    """
    Q, single = as_stack(system, "q", q)
    if not system.couplings.count:
        out = np.zeros(len(Q))
    else:
        number = None if turns is None else np.asarray(turns, dtype=np.int64)
        out = system.couplings.energy(all_rows(system, Q, as_times(t, len(Q))), number)
    return out[0] if single else out


@takes_scene
def coupling_forces(
    system: System,
    q: ArrayLike,
    v: ArrayLike,
    t: ArrayLike = 0.0,
    turns: ArrayLike | None = None,
) -> Pairs:
    """Coordinates and forces of springs, dampers, cables and bushings.

    ``simulate`` adds them to its history as ``coupling/NAME/coordinate`` and
    ``coupling/NAME/force``.

    Parameters
    ----------
    q, v, t, turns
        As for :func:`joint_coordinates`; angles count from their principal value without `turns`.

    Returns
    -------
    dict of str to (coordinate, force)
        By the names of the elements: the length of a spring or cable (m), the coordinate of a
        joint (m, rad), ``(u, psi)`` of a bushing, and the generalised force of spring and damper
        against it (N, N m): tension is positive. Numbers or (N,); with m components (m,) or (N, m).

    Raises
    ------
    InputError
        If the shape of an array does not fit the system.

    Examples
    --------
    A spring with a damper, 1 m longer than at rest and growing by 0.5 m/s:

    >>> from skfem_cosserat import MassPoint, Model, SpringDamper, ground
    >>> model = Model()
    >>> bob = model.add("bob", MassPoint(1.0, position=(0, 0, -2)))
    >>> item = SpringDamper(ground((0, 0, 0)), bob.place(), stiffness=50.0, damping=2.0)
    >>> item = model.add("spring", item)
    >>> length, force = coupling_forces(model.freeze(), [0, 0, -3.0], [0, 0, -0.5])["spring"]
    >>> float(length), float(force)
    (3.0, 51.0)
    """
    Q, single = as_stack(system, "q", q)
    V, _ = as_stack(system, "v", v, Q)
    times = as_times(t, len(Q))
    found = _forces(system, all_rows(system, Q, times), rates(system, V, times), turns)
    return {name: (a[0], b[0]) for name, (a, b) in found.items()} if single else found


def _forces(system: System, y: Floats, ydot: Floats, turns: ArrayLike | None) -> Pairs:
    number = None if turns is None else np.asarray(turns, dtype=np.int64)
    return {
        item.name or "": (xi[:, 0], force[:, 0]) if item.size == 1 else (xi, force)
        for item, xi, force in system.couplings.forces(y, ydot, number)
    }


def relative_names(system: System) -> list[str]:
    """Names of :func:`relative_series`, in their order."""
    out = []
    for joint in system.joints:
        for coordinate in joint.coordinates():
            name = f"joint/{joint.name}/{coordinate.name}"
            out += [name, f"{name}_rate"]
    for item in system.couplings.passive:
        out += [f"coupling/{item.name}/coordinate", f"coupling/{item.name}/force"]
    return out


def relative_series(
    system: System, q: Floats, v: Floats, t: Floats, turns: ArrayLike | None
) -> dict[str, Floats]:
    """All relative coordinates, and forces of force elements, as a history names them."""
    y, ydot = all_rows(system, q, t), rates(system, v, t)
    out = {}
    for joint in system.joints:
        for name, (value, rate) in _coordinates(system, joint, y, ydot, t, turns).items():
            out[f"joint/{joint.name}/{name}"] = value
            out[f"joint/{joint.name}/{name}_rate"] = rate
    for name, (xi, force) in _forces(system, y, ydot, turns).items():
        out[f"coupling/{name}/coordinate"] = xi
        out[f"coupling/{name}/force"] = force
    return out
