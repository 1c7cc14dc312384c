"""Sensors: what is recorded at every step while whole states are recorded now and then."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple, Self

import numpy as np

from ..diagnostics import SectionValues, evaluate, multipliers, reactions
from ..diagnostics.stacks import all_rows
from ..errors import InputError
from ..frames import Item, Place
from ..history import HistoryWriter
from ..integrators import State, Stepper, StepReport
from ..joint import Joint
from ..kinds import is_beam
from ..model import System
from ..twin import Attached, Twins
from ..types import ArrayLike, Floats, numbers

if TYPE_CHECKING:
    from ..beam import Beam

__all__ = [
    "Sensor",
    "SensorAcceleration",
    "SensorBank",
    "SensorForce",
    "SensorPosition",
    "SensorQuantity",
    "SensorReaction",
    "SensorStrain",
    "SensorVelocity",
    "checked_sensors",
    "window_of",
]

#: states that are looked at together
BLOCK = 128


class Window(NamedTuple):
    """Some states after each other, and the steps that led from one to the next.

    Attributes
    ----------
    t : (k,) array
    q : (k, n) array
    step_t : (j,) array
        Instants at which the constraint forces of steps act.
    points : (j, total, 3) array
        Where they act; only for sensors that ask for it.
    force : (j, n) array
    """

    t: Floats
    q: Floats
    step_t: Floats
    points: Floats
    force: Floats


class Sensor(Attached, ABC):
    """Base of the sensors.

    Attributes
    ----------
    unit : str
    derivative : int
        How often the record is differentiated in time, by differences of second order.
    forces : bool
        Whether it needs the constraint forces of steps.
    """

    unit = ""
    derivative = 0
    forces = False

    @abstractmethod
    def items(self) -> list[Item]:
        """Those that have to be in the model."""

    @abstractmethod
    def values(self, system: System, window: Window) -> Floats:
        """Values (k, ...) at the window's states; with `forces`, (j, ...) of its steps."""


class SensorPosition(Sensor):
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
    Where the end of a falling rod is at every step, while three states are recorded:

    >>> from skfem_cosserat import EnergyMomentum, LoadGravity, Model, NullSpace, RigidBody
    >>> from skfem_cosserat import simulate
    >>> model = Model()
    >>> rod = model.add("rod", RigidBody.box(1.0, (0.1, 0.1, 2.0)))
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
    ) -> None:
        self._point = _Point(where, s, part)
        if frame is not None and (not isinstance(frame, Place) or frame.triad is None):
            raise InputError("sensor", f"frame = {frame!r}, expected the place of a frame")
        self.frame = frame

    def twin(self, twins: Twins) -> Self:
        """See the base class."""
        other = super().twin(twins)
        if (
            self.frame is not None
            and other.frame is not None
            and self.frame.turn_to(other.frame) is not None
        ):
            raise InputError("sensor", f"the triad of the {self.frame.label} is another one now")
        return other

    def items(self) -> list[Item]:
        """See the base class."""
        frame = [] if self.frame is None or self.frame.item is None else [self.frame.item]
        return [*self._point.items(), *frame]

    def values(self, system: System, window: Window) -> Floats:
        """See the base class."""
        x = self._point.positions(system, window)
        if self.frame is None:
            return x
        rows = all_rows(system, window.q, window.t)
        first = system.row_of(self.frame)
        origin = _place_positions(system, self.frame, rows)
        return np.einsum("kic,kc->ki", rows[:, first + 1 : first + 4], x - origin)


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


class SensorStrain(Sensor):
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

    def __init__(self, beam: Beam, s: float, part: str | None = None) -> None:
        self._point = _Point(beam, s, part)
        self.beam = beam

    def twin(self, twins: Twins) -> Self:
        """See the base class; there must still be a beam."""
        other = super().twin(twins)
        if not is_beam(other.beam):
            raise InputError("sensor", f"the {self.beam.label} is a rigid body: it has no strains")
        return other

    def items(self) -> list[Item]:
        """See the base class."""
        return self._point.items()

    def values(self, system: System, window: Window) -> Floats:
        """See the base class."""
        return self._point.section(system, window).strain[:, 0]


class SensorForce(SensorStrain):
    """Section forces ``(N, M)`` (N, N m) at a point of a beam, in the section's triad.

    On the face with outward normal +d3; the elastic part, as in ``diagnostics.evaluate``. For the
    arguments see :class:`SensorStrain`. Of a beam whose rung holds strains they are taken where
    constraint forces act, as those of :class:`SensorReaction`.
    """

    unit = "N, N m"

    def __init__(self, beam: Beam, s: float, part: str | None = None) -> None:
        super().__init__(beam, s, part)
        self.forces = bool(self.beam.rung.held)

    def values(self, system: System, window: Window) -> Floats:
        """See the base class."""
        if self.forces:
            lam = multipliers(system, window.points, window.force)
            q = window.points[:, : system.rows].reshape(-1, system.n)
            return self._point.section(system, window, q, lam).resultant[:, 0]
        return self._point.section(system, window).resultant[:, 0]


class SensorReaction(Sensor):
    """Force and moment (N, N m) that a joint exerts on its side b, about its point there.

    Parameters
    ----------
    joint : Joint

    Notes
    -----
    ``(N, 6)``, in space. At the nodes t_n with the variational integrator, at the midpoints of
    steps with energy-momentum: ``record.times`` says which.
    """

    unit = "N, N m"
    forces = True

    def __init__(self, joint: Joint) -> None:
        if not isinstance(joint, Joint):
            raise InputError("sensor", f"joint = {joint!r}, expected a joint")
        self.joint = joint

    def items(self) -> list[Item]:
        """See the base class."""
        return [self.joint]

    def values(self, system: System, window: Window) -> Floats:
        """See the base class."""
        lam = multipliers(system, window.points, window.force)
        force, moment = reactions(system, window.points, lam)[self.joint.name or ""]
        return np.concatenate([force, moment], axis=1)


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

    def __init__(
        self, function: Callable[[System, Floats, Floats], ArrayLike], unit: str = ""
    ) -> None:
        if not callable(function):
            raise InputError("sensor", f"function = {function!r} is not callable")
        self.function, self.unit = function, unit

    def items(self) -> list[Item]:
        """See the base class."""
        return []

    def values(self, system: System, window: Window) -> Floats:
        """See the base class."""
        out = numbers("sensor", "values", self.function(system, window.q, window.t))
        if out.shape[:1] != window.t.shape or not np.isfinite(out).all():
            raise InputError(
                "sensor",
                f"its function gave shape {out.shape} with finite = {bool(np.isfinite(out).all())},"
                f" expected finite ({len(window.t)}, ...)",
            )
        return out


class _Point(Attached):
    """A place, or a point of a beam's axis."""

    def __init__(self, where: Place | Beam, s: float | None, part: str | None) -> None:
        self.beam: Beam | None = None
        self.place: Place | None = None
        if is_beam(where):
            if s is None:
                raise InputError("sensor", f"s is missing: the arc length on the {where.label}")
            length = numbers("sensor", "s", s)
            if length.shape != ():
                raise InputError("sensor", f"s has shape {length.shape}, expected a number")
            self.beam, self._s, self._part = where, length[None], part
            self._elements, self._xi = where.along(self._s, part)
        elif isinstance(where, Place):
            if s is not None or part is not None:
                raise InputError("sensor", f"s = {s!r} is for beams, not for the {where.label}")
            self.place = where
        else:
            raise InputError("sensor", f"where = {where!r}, expected a Place or a Beam")

    def twin(self, twins: Twins) -> Self:
        other = super().twin(twins)
        if self.beam is not None:
            item = twins.of(self.beam)
            if is_beam(item):
                other._elements, other._xi = item.along(self._s, self._part)
            else:  # a body that stands for it
                x = self.beam.mesh.mapping().F(self._xi[None], self._elements)[:, 0, 0]
                other.beam, other.place = None, item.at(x)
        return other

    def items(self) -> list[Item]:
        if self.beam is not None:
            return [self.beam]
        assert self.place is not None
        return [] if self.place.item is None else [self.place.item]

    def positions(self, system: System, window: Window) -> Floats:
        if self.beam is not None:
            return self.section(system, window).position[:, 0]
        assert self.place is not None
        return _place_positions(system, self.place, all_rows(system, window.q, window.t))

    def section(
        self,
        system: System,
        window: Window,
        q: Floats | None = None,
        lam: Floats | None = None,
    ) -> SectionValues:
        assert self.beam is not None
        q = window.q if q is None else q
        return evaluate(system, self.beam, q, self._elements, self._xi, multipliers=lam)


def _place_positions(system: System, place: Place, rows: Floats) -> Floats:
    """Where a place is (k, 3), for all rows (k, total, 3)."""
    terms = system.kinematics.spot_terms(system.spot(place))
    return np.asarray(sum(c * rows[:, a] for a, c in terms))


class SensorBank:
    """All sensors of a run: collects states and writes what the sensors see, window by window.

    Parameters
    ----------
    sensors : mapping of str to Sensor
    system : System
    stepper : Stepper
    writer : HistoryWriter

    Raises
    ------
    InputError
        If a name is empty or has a slash, something is no sensor, or its item is not in the system.
    """

    def __init__(
        self, sensors: Mapping[str, Sensor], system: System, stepper: Stepper, writer: HistoryWriter
    ) -> None:
        self.sensors, self.system, self.writer = sensors, system, writer
        self._weight = stepper.integrator.constraint_weight
        self._forces = any(sensor.forces for sensor in sensors.values())
        self._states: list[State] = []
        self._shapes: dict[str, Floats] = {}
        self._steps: list[tuple[float, Floats, Floats]] = []

    def go_on(self, system: System) -> None:
        """The scene has changed; what its sensors saw before is written."""
        if system is not self.system:
            self.flush()
            self.system = system

    def begin(self, state: State) -> None:
        """The state a run starts from."""
        if self.sensors:
            self._states.append(state)

    def take(self, start: State, report: StepReport) -> None:
        """A step is done."""
        if not self.sensors:
            return
        self._states.append(report.state)
        if self._forces:
            point = start.time + self._weight * report.step
            self._steps.append((point, report.constraint_point, report.constraint_force))
        if len(self._states) >= BLOCK:
            self.flush()

    def flush(self) -> None:
        """Write what has been collected."""
        if not self._states and not self._steps:
            return
        window = window_of(self.system, self._states, self._steps)
        arrays = {}
        for name, sensor in self.sensors.items():
            arrays[f"{name}/t"] = window.step_t if sensor.forces else window.t
            arrays[f"{name}/x"] = self._values(name, sensor, window)
        self._states.clear()
        self._steps.clear()
        self.writer.sense(arrays)

    def _values(self, name: str, sensor: Sensor, window: Window) -> Floats:
        """What a sensor sees; NaN where its joint has been released."""
        here = {each.name for each in self.system.joints}
        gone = [
            each for each in sensor.items() if isinstance(each, Joint) and each.name not in here
        ]
        if not gone:
            values = self._shapes[name] = sensor.values(self.system, window)
            return values
        count = len(window.step_t if sensor.forces else window.t)
        known = self._shapes.get(name)
        return np.full((count, *((6,) if known is None else known.shape[1:])), np.nan)


def window_of(
    system: System, states: Sequence[State], steps: Sequence[tuple[float, Floats, Floats]]
) -> Window:
    """What has been collected: states, and of steps instants, points and forces."""
    return Window(
        np.array([state.time for state in states]),
        np.array([state.q for state in states]).reshape(-1, system.n),
        np.array([t for t, _, _ in steps]),
        np.array([y for _, y, _ in steps]).reshape(-1, system.total, 3),
        np.array([f for _, _, f in steps]).reshape(-1, system.n),
    )


def checked_sensors(
    sensors: Mapping[str, Sensor] | None, system: System, start: State
) -> dict[str, Sensor]:
    """Sensors by name, of items of this system, which can see the state that a run starts from."""
    item = "argument sensors"
    if sensors is None:
        return {}
    if not isinstance(sensors, Mapping):
        raise InputError(item, f"{sensors!r}, expected a dict of names and sensors")
    known = {id(each) for each in (*system.structures, *system.joints)}
    for name, sensor in sensors.items():
        if not isinstance(name, str) or not name or "/" in name:
            raise InputError(item, f"{name!r}, expected a name without slashes")
        if not isinstance(sensor, Sensor):
            raise InputError(item, f"{name!r} is {sensor!r}, expected a sensor")
        for each in sensor.items():
            if id(each) not in known:
                raise InputError(item, f"the {each.label} of {name!r} is not in this system")
    window = window_of(system, [start], [])
    for sensor in sensors.values():
        if not sensor.forces:
            sensor.values(system, window)
    return dict(sensors)
