"""Readings of states: by functions of a view, and by sensors at every step."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from functools import cached_property
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from .. import diagnostics
from ..arguments import checked
from ..diagnostics import multipliers, reactions
from ..diagnostics.error import SectionPlaces
from ..diagnostics.joint_motion import Reading, reading_of
from ..diagnostics.stacked import all_rows, at_place, rates
from ..errors import InputError, failed
from ..frames import Item, Place, is_beam, with_frame
from ..frozen import Attached, Replacements
from ..history import HistoryWriter
from ..integrators import State
from ..integrators.compiled_step import Motion
from ..joint import Joint
from ..model import Model, System, system_of
from ..model.scene import joint_of
from ..model.system import FROM
from ..types import ArrayLike, Floats, IndexArray, check_kind, numbers

if TYPE_CHECKING:
    from ..beam import Beam

#: what kernels find of states by their configurations and momenta; None where they cannot
Motions = Callable[[Floats, Floats], Motion | None]

# -- states of a run and what is read from them: by conditions of events, and by sensors -----------


class Window:
    """Some states of one system, and what follows from them, found when it is asked for.

    The method ``values`` of a sensor is given it; see :class:`Sensor`.

    Attributes
    ----------
    system : System
    t : (k,) array
        Time (s) of each state.
    q : (k, n) array
        Configuration of each state.
    p : (k, n) array
        Momentum of each state.
    turns : (k, angles) int array or None
        Full turns of the angles of force elements, of each state.
    force : (k, n) array or None
        Constraint force of each state; only for sensors of a run, and None elsewhere.
    """

    def __init__(
        self,
        system: System,
        t: Floats,
        q: Floats,
        p: Floats,
        turns: IndexArray | None = None,
        motions: Motions | None = None,
        force: Floats | None = None,
    ):
        self.system, self.t, self.turns, self.force = system, t, turns, force
        self.q = q.view()
        self.p = p.view()
        for states in (self.q, self.p):  # an own sensor may try to write there
            states.flags.writeable = False
        self._motions = motions

    @classmethod
    def at(cls, system: System, state: State, motions: Motions | None = None) -> Window:
        """A single state."""
        turns = None if state.turns is None else state.turns[None]
        return cls(system, np.array([state.time]), state.q[None], state.p[None], turns, motions)

    @cached_property
    def y(self) -> Floats:
        """All rows (k, total, 3)."""
        return all_rows(self.system, self.q, self.t)

    @cached_property
    def _motion(self) -> Motion:
        found = None if self._motions is None else self._motions(self.q, self.p)
        if found is not None:
            return found
        v = diagnostics.Projection(self.system).velocities(self.q, self.p, self.t)
        return Motion(v, diagnostics.kinetic_energy_of_velocity(self.system, v), None)

    @property
    def v(self) -> Floats:
        """Velocities (k, n) on the hidden constraints."""
        return self._motion.v

    @cached_property
    def ydot(self) -> Floats:
        """Rates of all rows (k, total, 3)."""
        return rates(self.system, self.v, self.t)

    def position(self, place: Place) -> Floats:
        """Positions of a place (k, 3) in m."""
        return self._spot(place, self.y)

    def velocity(self, place: Place) -> Floats:
        """Velocities of a place (k, 3) in m/s."""
        return self._spot(place, self.ydot)

    def _spot(self, place: Place, rows: Floats) -> Floats:
        check_kind("argument place", place, Place, FROM)
        return at_place(self.system, rows, place)

    def rotation(self, place: Place) -> Floats:
        """Directors of the frame that carries a place, in the rows of (k, 3, 3)."""
        row = self.system.row_of(with_frame(place))
        return self.y[:, row + 1 : row + 4].copy()

    def coordinate(self, joint: Joint | str, name: str | None = None) -> Floats:
        """Angle (rad, the principal value) or displacement (m) of a joint (k,)."""
        return self._reading(joint, name).values(self.y)[:, 0]

    def rate(self, joint: Joint | str, name: str | None = None) -> Floats:
        """Rate of :meth:`coordinate` (k,)."""
        return self._reading(joint, name).rates(self.y, self.ydot)[:, 0]

    def _reading(self, joint: Joint | str, name: str | None) -> Reading:
        joint = joint if isinstance(joint, Joint) else joint_of(self.system, joint)
        found = reading_of(self.system, joint, name).coordinate
        if found.size != 1:
            raise InputError(joint.label, f"its {found.name} has {found.size} components")
        return reading_of(self.system, joint, name)

    def kinetic_energy(self) -> Floats:
        """Kinetic energy of the velocities v (k,) in J."""
        return self._motion.kinetic

    def stored_energy(self) -> Floats:
        """Energy stored in beams and force elements (k,) in J."""
        stored = None if self._motions is None else self._motion.stored
        if stored is None or self.system.loading.strained:
            stored = diagnostics.strain_energy(self.system, self.q, self.t)
        if self.system.couplings.count:
            given = self.system, self.q, self.t, self.turns
            stored = stored + diagnostics.coupling_energy(*given)
        return stored

    def energy(self) -> Floats:
        """Kinetic energy, and that stored in beams and force elements (k,) in J."""
        return self.kinetic_energy() + self.stored_energy()

    def reaction(self, joint: Joint | str) -> tuple[Floats, Floats]:
        """Force and moment (k, 3) of a joint on its side b (N, N m)."""
        joint = joint if isinstance(joint, Joint) else joint_of(self.system, joint)
        return reactions(self.system, self.y, self._multipliers)[joint.name or ""]

    @cached_property
    def _multipliers(self) -> Floats:
        if self.force is not None:
            return multipliers(self.system, self.y, self.force)
        return diagnostics.accelerations(self.system, self.q, self.v, self.t, self.turns)[1]

    def sensor(self, sensor: Sensor) -> Floats:
        """Values (k, ...) of a sensor, each at a state alone."""
        if sensor.forces or sensor.derivative > 1:
            text = "needs several states, which events and views do not have"
            raise InputError("sensor", f"{type(sensor).__name__} {text}")
        if not sensor.derivative:
            return sensor.values(self.system, self)
        # rates by central differences along the motion
        t, q, v = self.t, self.q, self.v
        speed = abs(v).max(1, initial=0.0)
        s = np.divide(1e-5 * self.system.length, speed, out=np.full(len(t), 1e-5), where=speed > 0)
        ends = np.concatenate([t + np.where(t > s, -s, 0.0), t + np.where(t > s, s, 2 * s)])
        moved = np.tile(q, (2, 1)) + (ends - np.tile(t, 2))[:, None] * np.tile(v, (2, 1))
        turns = None if self.turns is None else np.tile(self.turns, (2, 1))
        both = Window(self.system, ends, moved, np.full_like(moved, np.nan), turns)
        values = np.asarray(sensor.values(self.system, both))
        if np.isnan(values).any():
            text = "is differentiated beside a state, where positions and rotations are known alone"
            raise InputError(type(sensor).__name__, text)
        before, after = np.split(values, 2)
        over = ends[len(t) :] - ends[: len(t)]
        return (after - before) / over.reshape(-1, *[1] * (after.ndim - 1))


@checked
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

    def __init__(self, system: Model | System, state: State):
        system = system_of(system)
        check_kind("argument state", state, State, ", see initial_state")
        if np.shape(state.q) != (system.n,):
            given = f"q has shape {np.shape(state.q)}, expected ({system.n},)"
            raise InputError("argument state", given)
        self.system, self.state, self.time, self.q = system, state, state.time, state.q
        self._states = Window.at(system, state)

    def __repr__(self) -> str:
        return f"<View: t = {self.time:g} s, step {self.state.index}, n = {self.system.n}>"

    @property
    def y(self) -> Floats:
        """All rows (total, 3)."""
        return self._states.y[0]

    @property
    def v(self) -> Floats:
        """Velocity (n,) on the hidden constraints."""
        return self._states.v[0]

    def position(self, place: Place) -> Floats:
        """Position of a place (3,) in m."""
        return self._states.position(place)[0]

    def rotation(self, place: Place) -> Floats:
        """Directors d1, d2, d3 of the frame that carries a place, in the rows of (3, 3)."""
        return self._states.rotation(place)[0]

    def velocity(self, place: Place) -> Floats:
        """Velocity of a place (3,) in m/s."""
        return self._states.velocity(place)[0]

    def coordinate(self, joint: Joint | str, name: str | None = None) -> float:
        """Angle (rad, the principal value) or displacement (m) of a joint.

        Raises
        ------
        InputError
            If there is no such joint or coordinate, or it has several components.
        """
        return float(self._states.coordinate(joint, name)[0])

    def rate(self, joint: Joint | str, name: str | None = None) -> float:
        """Rate of :meth:`coordinate` (rad/s, m/s)."""
        return float(self._states.rate(joint, name)[0])

    def reaction(self, joint: Joint | str) -> tuple[Floats, Floats]:
        """Force and moment (N, N m) of a joint on its side b.

        By the equations of motion at this state. Where steps do not resolve a vibration, it is in
        these forces as it is in the state; the history of a run and its sensors have the forces
        of the steps around each state.
        """
        force, moment = self._states.reaction(joint)
        return force[0], moment[0]

    def kinetic_energy(self) -> float:
        """Kinetic energy of the velocity v (J)."""
        return float(self._states.kinetic_energy()[0])

    def energy(self) -> float:
        """Kinetic energy, and that stored in beams and force elements (J)."""
        return float(self._states.energy()[0])

    def strain_of(self, beam: Beam, s: float) -> Floats:
        """Strains (6,) ``(Gamma, K)`` of a beam at an arc length (m) of the reference."""
        return self.sensor(SensorStrain(beam, s))

    def sensor(self, sensor: Sensor) -> Floats:
        """Value of a sensor here.

        Raises
        ------
        InputError
            For accelerations and reactions: see :meth:`reaction`.
        """
        check_kind("argument sensor", sensor, Sensor)
        return self._states.sensor(sensor)[0]


# -- sensors: what is recorded at every step while whole states are recorded now and then ----------


class Sensor(Attached, ABC):
    """Base of the sensors, and of one's own.

    An own sensor gives the methods :meth:`items` and :meth:`values`, and the attributes below where
    they differ.

    Attributes
    ----------
    unit : str
        Of the values, for charts and tables.
    derivative : int
        How often the record is differentiated in time, by differences of second order.
    forces : bool
        True if it needs constraint forces, ``window.force``. Where an event changes the scene it
        has two values of one time, of the end of the steps before and the start of those after.

    Examples
    --------
    The distance of two mass points at every step, while few states are recorded:

    >>> import skfem_cosserat as sc
    >>> class SensorDistance(sc.Sensor):
    ...     unit = "m"
    ...
    ...     def __init__(self, a, b):
    ...         self.a, self.b = a, b
    ...
    ...     def items(self):
    ...         return [self.a, self.b]
    ...
    ...     def values(self, system, window):
    ...         a, b = (window.position(each.place()) for each in self.items())
    ...         return np.linalg.norm(b - a, axis=1)
    >>> model = sc.Model()
    >>> a = model.add("a", sc.MassPoint(1.0))
    >>> b = model.add("b", sc.MassPoint(1.0, position=(1.0, 0, 0), velocity=(2.0, 0, 0)))
    >>> sensors = {"gap": SensorDistance(a, b)}
    >>> scheme = sc.EnergyMomentum(), sc.NullSpace()
    >>> history = sc.simulate(model, *scheme, 0.1, 0.3, every=3, sensors=sensors)
    >>> history.sensors["gap"].values.round(9).tolist()
    [1.0, 1.2, 1.4, 1.6]
    """

    unit = ""
    derivative = 0
    forces = False

    @property
    def _of_the_user(self) -> bool:
        """True if functions of users say what it sees."""
        return type(self).values.__module__ != __name__

    @abstractmethod
    def items(self) -> list[Item]:
        """Items that have to be in the model."""

    @abstractmethod
    def values(self, system: System, window: Window) -> Floats:
        """Values (k, ...) at the window's states."""


class _AlongBeam(Sensor):
    """Base of sensors of a point on a beam's axis."""

    s: float | None = None
    part: str | None = None
    #: the point, made when it is first asked for
    _places: SectionPlaces | None = None

    def _set_point(self, beam: Beam, s: float | None, part: str | None) -> None:
        """Take an arc length that is on the beam."""
        if s is None:
            raise InputError("sensor", f"s is missing: the arc length on the {beam.label}")
        length = numbers("sensor", "s", s)
        if length.shape != ():
            raise InputError("sensor", f"s has shape {length.shape}, expected a number")
        beam.along(length[None], part)
        self.s = float(length)
        self.part = part

    def _section(self, beam: Beam) -> SectionPlaces:
        """The point on a beam, which may be another one in a copy."""
        if self._places is None or self._places.beam is not beam:
            self._places = SectionPlaces(beam, *beam.along(np.array([self.s]), self.part))
        return self._places


class SensorPosition(_AlongBeam):
    """Position (m) of a place, or of a point of a beam's axis, at every step.

    Parameters
    ----------
    where : Place or Beam
    s : float, optional
        On a beam: arc length in the reference from the start of the part (m).
    part : str, optional
        On a beam: name of a part of the mesh; default: the whole beam.
    frame : Place, optional
        Seen from the frame of this place (of a beam node, a body, or the ground in motion): its
        components in the moving triad, from the moving place. Default: in space.

    Raises
    ------
    InputError
        If `where` is neither, or `s` is missing or beyond the ends.

    Examples
    --------
    Where the end of a rod that is thrown is at every step, while three states are recorded:

    >>> from skfem_cosserat import EnergyMomentum, LoadGravity, Model, NullSpace, RigidBody
    >>> from skfem_cosserat import simulate
    >>> model = Model()
    >>> rod = model.add("rod", RigidBody.box(1.0, (0.1, 0.1, 2.0), velocity=(1.0, 0, 0)))
    >>> fall = model.add("fall", LoadGravity((0, 0, -10.0)))
    >>> sensors = {"end": SensorPosition(rod.local((0, 0, 1.0)))}
    >>> history = simulate(
    ...     model.freeze(), EnergyMomentum(), NullSpace(), 0.01, 0.2, every=10, sensors=sensors
    ... )
    >>> len(history), history.sensors["end"].values[::10, 2].round(9).tolist()
    (3, [1.0, 0.95, 0.8])
    """

    unit = "m"

    def __init__(
        self,
        where: Place | Beam,
        s: float | None = None,
        part: str | None = None,
        frame: Place | None = None,
    ):
        if is_beam(where):
            self._set_point(where, s, part)
        elif not isinstance(where, Place):
            raise InputError("sensor", f"where = {where!r}, expected a Place or a Beam")
        elif s is not None or part is not None:
            raise InputError("sensor", f"s = {s!r} is for beams, not for the {where.label}")
        if frame is not None and (not isinstance(frame, Place) or frame.triad is None):
            raise InputError("sensor", f"frame = {frame!r}, expected the place of a frame")
        self.where = where
        self.frame = frame

    def with_replacements(self, replacements: Replacements) -> Self:
        """Copy for other items; a body that stands for a beam has the point where it was."""
        other = super().with_replacements(replacements)
        if is_beam(self.where) and not is_beam(other.where):
            elements, xi = self.where.along(np.array([self.s]), self.part)
            x = self.where.mesh.mapping().F(xi[None], elements)[:, 0, 0]
            body: Any = other.where
            other.where, other.s, other.part = body.at(x), None, None
        frames = self.frame, other.frame
        if frames[0] and frames[1] and frames[0].turn_to(frames[1]) is not None:
            raise InputError("sensor", f"the triad of the {frames[0].label} is another one now")
        return other

    def items(self) -> list[Item]:
        """Beam or item of the place, and that of the frame."""
        places = [each for each in (self.where, self.frame) if isinstance(each, Place)]
        beam = [self.where] if is_beam(self.where) else []
        return [*beam, *(place.item for place in places if place.item is not None)]

    def values(self, system: System, window: Window) -> Floats:
        """Positions (k, 3)."""
        if isinstance(self.where, Place):
            x = window.position(self.where)
        else:
            x = self._section(self.where).values(system, window.q).position[:, 0]
        if self.frame is None:
            return x
        return np.einsum("kic,kc->ki", window.rotation(self.frame), x - window.position(self.frame))


class SensorVelocity(SensorPosition):
    """Velocity (m/s) of a place or point of a beam, by differences of its positions.

    Central differences, one-sided at the ends, of second order in the step as the integrators;
    for the arguments see :class:`SensorPosition`.
    """

    derivative = 1


class SensorAcceleration(SensorPosition):
    """Acceleration (m/s^2) of a place or point of a beam, by second differences of its positions.

    Of second order in the step where it resolves the motion; for the arguments see
    :class:`SensorPosition`.
    """

    derivative = 2


class SensorStrain(_AlongBeam):
    """Strains ``(Gamma, K)`` (-, 1/m) at a point of a beam.

    Parameters
    ----------
    beam : Beam
    s : float
        Arc length in the reference from the start of the part (m).
    part : str, optional
        Name of a part of the mesh; default: the whole beam.

    Raises
    ------
    InputError
        If it is no beam, or `s` is beyond the ends.

    Notes
    -----
    Those of the interpolated frames (:func:`diagnostics.evaluate`): of order p + 1 at the Gauss
    points of the element, p elsewhere.
    """

    unit = "-, 1/m"

    def __init__(self, beam: Beam, s: float, part: str | None = None):
        if not is_beam(beam):
            raise InputError("sensor", f"beam = {beam!r}, expected a Beam")
        self._set_point(beam, s, part)
        self.beam = beam

    def with_replacements(self, replacements: Replacements) -> Self:
        """Copy for other items; there must still be a beam."""
        other = super().with_replacements(replacements)
        if not is_beam(other.beam):
            raise InputError("sensor", f"the {self.beam.label} is a rigid body: it has no strains")
        return other

    def items(self) -> list[Item]:
        """The beam."""
        return [self.beam]

    def values(self, system: System, window: Window) -> Floats:
        """Strains (k, 6)."""
        return self._section(self.beam).values(system, window.q).strain[:, 0]


class SensorForce(SensorStrain):
    """Section forces ``(N, M)`` (N, N m) at a point of a beam, in the section's triad.

    On the face with outward normal +d3; without the viscous part of damped sections. For the
    arguments see :class:`SensorStrain`.

    Notes
    -----
    By the balance of a part of the element, with the accelerations that the equations of motion
    give at the state. ``diagnostics.forces_along`` gives the same after a run, and says how they
    converge. Each state costs the solution of a linear system.
    """

    unit = "N, N m"

    def values(self, system: System, window: Window) -> Floats:
        """Values (k, ...) at the window's states."""
        q, v, t = window.q, window.v, window.t
        at = diagnostics.accelerations(system, q, v, t, window.turns)
        return self._section(self.beam).resultants(system, q, t, None, v, *at)[:, 0]


class SensorReaction(Sensor):
    """Force and moment (N, N m) that a joint exerts on its side b, about its point there.

    Parameters
    ----------
    joint : Joint

    Notes
    -----
    ``(N, 6)``, in space, at all states, as ``joint/NAME/force`` and ``joint/NAME/moment`` of a
    history. Where an event changes the scene there are two of one time.
    """

    unit = "N, N m"
    forces = True

    def __init__(self, joint: Joint):
        if not isinstance(joint, Joint):
            raise InputError("sensor", f"joint = {joint!r}, expected a joint")
        self.joint = joint

    def items(self) -> list[Item]:
        """The items it needs."""
        return [self.joint]

    def values(self, system: System, window: Window) -> Floats:
        """Values (k, ...) at the window's states."""
        return np.concatenate(window.reaction(self.joint), 1)


class SensorQuantity(Sensor):
    """Anything that follows from configurations.

    Parameters
    ----------
    function : callable
        ``function(system, q, t) -> (k, ...)`` array for configurations q (k, n) at times t (k,).
    unit : str

    Raises
    ------
    InputError
        If it cannot be called, or gives no finite numbers of this shape: of the first state before
        the run, later on during it (what the last states give wrong is a warning).
    """

    def __init__(self, function: Callable[[System, Floats, Floats], ArrayLike], unit: str = ""):
        if not callable(function):
            raise InputError("sensor", f"function = {function!r} is not callable")
        self.function = function
        self.unit = unit

    @property
    def _of_the_user(self) -> bool:
        """True: its function is."""
        return True

    def items(self) -> list[Item]:
        """The items it needs."""
        return []

    def values(self, system: System, window: Window) -> Floats:
        """Values (k, ...) at the window's states."""
        own = window.q.copy(), window.t.copy()  # it may write there
        out = numbers("sensor", "values", self.function(system, *own))
        if out.shape[:1] != window.t.shape or not np.isfinite(out).all():
            raise InputError(
                "sensor",
                f"its function gave shape {out.shape} with finite = {bool(np.isfinite(out).all())},"
                f" expected finite ({len(window.t)}, ...)",
            )
        return out


class SensorBank:
    """All sensors of a run: writes what they see, window by window.

    Parameters
    ----------
    sensors : mapping of str to Sensor
    writer : HistoryWriter

    Raises
    ------
    InputError
        If a name is empty or has a slash, something is no sensor, or its item is not in the system.
    """

    def __init__(self, sensors: Mapping[str, Sensor], writer: HistoryWriter):
        self.sensors = sensors
        self.writer = writer
        self._shapes: dict[str, Floats] = {}
        self._last = np.nan

    def look(self, system: System, rows: Mapping[str, Any]) -> None:
        """Look at states of a run, whose rows are complete; a sensor may raise."""
        if not self.sensors:
            return
        t = rows["t"]
        states = (rows["q"], rows["carried"], rows.get("turns"))
        window = Window(system, t, *states, force=rows["constraint_force"])
        # a state after an event is where that before it is
        apart = np.diff(t, prepend=self._last) != 0
        self._last = t[-1]
        arrays = {}
        for name, sensor in self.sensors.items():
            some = slice(None) if sensor.forces else apart
            arrays[f"{name}/t"] = t[some]
            arrays[f"{name}/x"] = self._values(name, sensor, window)[some]
        self.writer.sense(arrays)

    def _values(self, name: str, sensor: Sensor, window: Window) -> Floats:
        """Values of a sensor; NaN where its joint has been released."""
        here = {each.name for each in window.system.joints}
        gone = [
            each for each in sensor.items() if isinstance(each, Joint) and each.name not in here
        ]
        if not gone:
            values = seen(name, sensor, window)
            before = self._shapes.setdefault(name, values)
            if values.shape[1:] != before.shape[1:]:
                text = f"gives values {values.shape[1:]}, and {before.shape[1:]} before"
                raise InputError(f"sensor {name!r}", f"{text}, up to t = {window.t[-1]:.9g} s")
            return values
        known = self._shapes.get(name)
        return np.full((len(window.t), *((6,) if known is None else known.shape[1:])), np.nan)


def seen(name: str, sensor: Sensor, window: Window) -> Floats:
    """Values of a sensor in a window: real numbers, for each of its instants."""
    item = f"sensor {name!r}"
    times = window.t
    try:
        values = numbers(item, "values", sensor.values(window.system, window))
    except InputError:
        raise
    except Exception as error:
        raise failed(item, f"for times up to t = {times[-1]:.9g} s it", error) from error
    if values.shape[:1] != times.shape:
        raise InputError(item, f"gives an array {values.shape} for {len(times)} instants")
    return values


def check_items(sensor: Sensor, system: System, item: str, text: str) -> None:
    """Raise InputError if the sensor looks at something that the system does not have."""
    known = {id(each) for each in (*system.structures, *system.joints)}
    for each in sensor.items():
        if each is not None and id(each) not in known:  # None: the item of a place on the ground
            raise InputError(item, f"the {each.label} {text}")


def checked_sensors(
    sensors: Mapping[str, Sensor] | None, system: System, start: State
) -> dict[str, Sensor]:
    """Sensors by name, of items of this system, which can see the state that a run starts from."""
    item = "argument sensors"
    if sensors is None:
        return {}
    if not isinstance(sensors, Mapping):
        raise InputError(item, f"{sensors!r}, expected a dict of names and sensors")
    for name, sensor in sensors.items():
        if not isinstance(name, str) or not name or "/" in name:
            raise InputError(item, f"{name!r}, expected a name without slashes")
        if not isinstance(sensor, Sensor):
            raise InputError(item, f"{name!r} is {sensor!r}, expected a sensor")
        check_items(sensor, system, item, f"of {name!r} is not in this system")
    window = Window.at(system, start)
    for name, sensor in sensors.items():
        if not sensor.forces:
            seen(name, sensor, window)
    return dict(sensors)
