"""A state of a run as the conditions of events see it."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from .. import diagnostics
from ..constraints.saddle import accelerations, hidden_rate, saddle_point
from ..diagnostics.relative import rates
from ..errors import InputError
from ..frames import Place
from ..integrators import State
from ..joint import Joint
from ..model import System
from ..model.change import joint_of
from ..model.couplings import Invariants, kind_of
from ..types import Floats
from .sensors import Sensor, window_of

if TYPE_CHECKING:
    from ..beam import Beam

__all__ = ["View"]


class View:
    """A state: its configuration, and what follows from it, found when it is asked for.

    Attributes
    ----------
    system : System
        The scene as it is at this state.
    time : float
        (s)
    q, v : (n,) array
        Configuration, and velocity on the hidden constraints.

    Examples
    --------
    >>> from skfem_cosserat import MassPoint, Model, initial_state
    >>> model = Model()
    >>> ball = model.add("ball", MassPoint(2.0, position=(0, 0, 5), velocity=(3.0, 0, 0)))
    >>> system = model.freeze()
    >>> view = View(system, initial_state(system))
    >>> view.position(ball.place()).tolist(), view.velocity(ball.place()).tolist()
    ([0.0, 0.0, 5.0], [3.0, 0.0, 0.0])
    >>> view.kinetic_energy()
    9.0
    """

    def __init__(self, system: System, state: State) -> None:
        self.system, self.state = system, state
        self.time, self.q = state.time, state.q

    @cached_property
    def y(self) -> Floats:
        """All rows (total, 3)."""
        return self.system.extend(self.q, self.time)

    @cached_property
    def v(self) -> Floats:
        """See the class."""
        rate = hidden_rate(self.system, self.y, self.time)
        return saddle_point(self.system)(self.y, self.state.p, rate)[0]

    def position(self, place: Place) -> Floats:
        """Of a place (3,) in m."""
        return self._spot(place, self.y)

    def velocity(self, place: Place) -> Floats:
        """Of a place (3,) in m/s."""
        return self._spot(place, rates(self.system, self.v[None], np.array([self.time]))[0])

    def _spot(self, place: Place, rows: Floats) -> Floats:
        terms = self.system.kinematics.spot_terms(self.system.spot(place))
        return np.asarray(sum(c * rows[a] for a, c in terms))

    def coordinate(self, joint: Joint | str, name: str | None = None) -> float:
        """Angle (rad, the principal value) or displacement (m) of a joint.

        Raises
        ------
        InputError
            If there is no such joint or coordinate, or it has several components.
        """
        found = self._joint(joint)
        coordinate = found.coordinate(name)
        if coordinate.size != 1:
            raise InputError(found.label, f"its {coordinate.name} has {coordinate.size} components")
        kind = kind_of((coordinate,))
        invariants = Invariants([coordinate.forms], self.system.row_of)
        value = float(kind.value(invariants.values(self.y))[0, 0])
        if coordinate.kind == "displacement":
            start = self.system.extend(self.system.q0, 0.0)
            value -= float(kind.value(invariants.values(start))[0, 0])
        return value

    def rate(self, joint: Joint | str, name: str | None = None) -> float:
        """Rate of :meth:`coordinate` (rad/s, m/s)."""
        found = self._joint(joint)
        coordinate = found.coordinate(name)
        pairs = diagnostics.joint_coordinates(self.system, found, self.q, self.v, self.time)
        return float(pairs[coordinate.name][1])

    def reaction(self, joint: Joint | str) -> tuple[Floats, Floats]:
        """Force and moment (N, N m) of a joint on its side b, by the equations of motion here."""
        name = joint_of(self.system, joint).name or ""
        t, turns = self.time, self.state.turns
        lam = accelerations(self.system, self.q, self.v, t, turns)[1]
        force, moment = diagnostics.reactions(self.system, self.y[None], lam[None])[name]
        return force[0], moment[0]

    def kinetic_energy(self) -> float:
        """Of the velocity v (J)."""
        p = diagnostics.momentum(self.system, self.v)
        return float(diagnostics.kinetic_energy(self.system, p))

    def energy(self) -> float:
        """Kinetic energy, and that stored in beams and force elements (J)."""
        turns = None if self.state.turns is None else self.state.turns[None]
        q, t = self.q[None], np.array([self.time])
        stored = diagnostics.strain_energy(self.system, q)[0]
        return self.kinetic_energy() + float(
            stored + diagnostics.coupling_energy(self.system, q, t, turns)[0]
        )

    def strain_of(self, beam: Beam, s: float) -> Floats:
        """Strains (6,) ``(Gamma, K)`` of a beam at an arc length (m) of the reference."""
        return np.asarray(
            diagnostics.evaluate(self.system, beam, self.q, *beam.along([s])).strain[0]
        )

    def sensor(self, sensor: Sensor) -> Floats:
        """What a sensor sees here.

        Raises
        ------
        InputError
            For accelerations and reactions: see :meth:`reaction`.
        """
        if sensor.forces or sensor.derivative > 1:
            raise InputError(
                "sensor", f"{type(sensor).__name__} needs several states, which events do not have"
            )
        if sensor.derivative:
            return _seen_rate(self.system, self.state, self.v, sensor)
        return _seen(self.system, self.state, sensor)

    def _joint(self, joint: Joint | str) -> Joint:
        return joint if isinstance(joint, Joint) else joint_of(self.system, joint)


def _seen(system: System, state: State, sensor: Sensor) -> Floats:
    """What a sensor without forces sees at one state."""
    return np.asarray(sensor.values(system, window_of(system, [state], []))[0])


def _seen_rate(system: System, state: State, v: Floats, sensor: Sensor) -> Floats:
    """Rate of what a sensor sees, for a velocity v (n,): a central difference along the motion."""
    speed = float(abs(v).max(initial=0.0))
    s = 1e-5 * system.length / speed if speed > 0 else 1e-5
    t = state.time + np.array([-s, s]) if state.time > s else state.time + np.array([0.0, 2 * s])
    q = np.array([state.q + (each - state.time) * v for each in t])
    none = window_of(system, [], [])
    before, after = sensor.values(system, none._replace(t=t, q=q))
    return np.asarray((after - before) / (t[1] - t[0]))
