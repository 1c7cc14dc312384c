"""Relative coordinates of joints, and coordinates, forces and energy of force elements."""

from __future__ import annotations

import numpy as np

from ..joint import Joint
from ..model import System, takes_scene
from ..model.force_elements import Invariants, kind_of
from ..types import ArrayLike, Floats, IndexArray
from .stacked import all_rows, of_states, rates


class Reading:
    """Evaluation of a coordinate of a joint from all rows of states.

    Raises
    ------
    InputError
        If there is no such coordinate.
    """

    def __init__(self, system: System, joint: Joint, name: str | None):
        self.coordinate = joint.coordinate(name)
        self.kind = kind_of((self.coordinate,))
        self._invariants = Invariants([self.coordinate.forms], system.row_of)
        self._start: Floats | float = 0.0
        if self.coordinate.kind == "displacement":
            self._start = self.values(system.extend(system.q0, 0.0))

    def values(self, y: Floats) -> Floats:
        """Its components (N, size) for rows (N, total, 3)."""
        return self.kind.value(self._invariants.values(y))[..., 0, :] - self._start

    def rates(self, y: Floats, ydot: Floats) -> Floats:
        """Their rates (N, size)."""
        slope = self.kind.slope(self._invariants.values(y))
        return (slope @ self._invariants.rates(y, ydot)[..., None])[..., 0, :, 0]

    def gradient(self, y: Floats) -> Floats:
        """Derivatives (total, 3) of one component by all rows y (total, 3)."""
        slope = self.kind.slope(self._invariants.values(y))[0, 0]
        out = np.zeros_like(y)
        by_row = np.tensordot(slope, self._invariants.gradients(y)[0], 1)
        np.add.at(out, self._invariants.rows[0], by_row)
        return out


def reading_of(system: System, joint: Joint, name: str | None) -> Reading:
    """The reading of a coordinate; its name is needed where a joint has several."""
    key = id(joint), name  # the reading keeps the joint
    if key not in system.readings:
        system.readings[key] = Reading(system, joint, name)
    return system.readings[key]


def _coordinates(
    system: System,
    joint: Joint,
    y: Floats,
    ydot: Floats,
    times: Floats,
    turns: ArrayLike | None,
) -> list[Floats]:
    """Relative coordinates of a joint, each with its rate after it, (N,) or (N, 3).

    Driven angles are those prescribed, and those with a force element have its full turns; all
    others start from their principal value and are followed from state to state by the mean of
    their rates, which must be right to half a turn.
    """
    out = []
    for coordinate in joint.coordinates():
        reading = reading_of(system, joint, coordinate.name)
        xi, rate, kind = reading.values(y), reading.rates(y, ydot), reading.kind
        if kind.period:
            followed = _turns(system, joint, coordinate.name, turns)
            if followed is not None:
                xi = xi + kind.period * followed
            else:
                near = _expected(system, joint, coordinate.name, xi[:, 0], rate[:, 0], times)
                xi = xi + kind.period * ((near[:, None] - xi) / kind.period).round()
        out += [each[:, 0] if coordinate.size == 1 else each for each in (xi, rate)]
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
    moved += turn * ((steady - moved) / turn).round()
    return xi[0] + np.concatenate([[0.0], moved.cumsum()])


def _turns(system: System, joint: Joint, name: str, turns: ArrayLike | None) -> IndexArray | None:
    """Full turns (N, 1) of a joint's angle, if a force element follows it."""
    if turns is None:
        return None
    for k, item in enumerate(system.couplings.angles):
        if item and (item.a, item.b) == (joint.a, joint.b) and item.coordinates[0].name == name:
            return np.atleast_2d(np.asarray(turns))[:, k : k + 1]
    return None


@takes_scene
@of_states
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
    if not system.couplings.count:
        return np.zeros(len(np.asarray(q)))
    number = None if turns is None else np.asarray(turns)
    return system.couplings.energy(all_rows(system, q, t), number)


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
    y = all_rows(system, q, t)
    ydot = rates(system, v, t)
    out = [
        each for joint in system.joints for each in _coordinates(system, joint, y, ydot, t, turns)
    ]
    number = None if turns is None else np.asarray(turns)
    for item, xi, force in system.couplings.forces(y, ydot, number, t):
        if item.points:
            continue
        out += [each[:, 0] if item.size == 1 else each for each in (xi, force)]
    return dict(zip(relative_names(system), out, strict=True))
