"""A scene at a mesh, an order and a step: what is asked of it, its runs, how far two are apart."""

from __future__ import annotations

import inspect
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from types import FunctionType
from typing import Any, NamedTuple

import numpy as np

from ..arguments import checked
from ..beam import Beam
from ..constraints import Multipliers, NullSpace
from ..diagnostics import forces_along, momentum
from ..diagnostics.inputs import jumps, steps_that_see
from ..errors import CosseratError, InputError, failed
from ..frames import Place
from ..frozen import Attached, Replacements
from ..history import History
from ..integrators import EnergyMomentum, Integrator, State
from ..mesh import divided
from ..model import Model, Planar, System
from ..run import (
    Condition,
    Event,
    Sensor,
    SensorForce,
    SensorReaction,
    carry_state,
    initial_state,
    simulate,
)
from ..run.events import checked_events
from ..run.sensors import Window, checked_sensors, seen
from ..statics import Control, static
from ..theory import Theory
from ..types import Floats, check_kind, names_known, numbers, real, whole
from .reading import Reading


class NotHere(InputError):
    """A function of the user's fails in a run: on a finer mesh it may not."""

    def __init__(self, item: str, message: str):
        super().__init__(item, message)
        self.message = message


# -- what is asked ---------------------------------------------------------------------------------


class Quantity(Attached):
    """Base of what may be asked of a run besides sensors, conditions, series and functions."""

    #: that the run needs
    sensor: Sensor | None = None

    def values(self, name: str, run: Run) -> Reading:
        """Its numbers in a run."""
        raise NotImplementedError


class _Sampled(Quantity):
    """Values of a sensor, over time."""

    sensor: Sensor

    def __init__(self, sensor: Sensor):
        self.sensor = sensor

    def values(self, name: str, run: Run) -> Reading:
        return run.seen(name, self.sensor)


@checked
class Component(_Sampled):
    """One component of what a sensor sees, over time.

    Parameters
    ----------
    sensor : Sensor
    component : int
        Among all its numbers at an instant.

    Examples
    --------
    >>> import skfem_cosserat as sc
    >>> ball = sc.MassPoint(1.0)
    >>> sc.accuracy.Component(sc.SensorPosition(ball.place()), 2).component
    2
    """

    def __init__(self, sensor: Sensor, component: int):
        super().__init__(sensor)
        self.component = whole("Component", component, 0, "component")

    def values(self, name: str, run: Run) -> Reading:
        """The component over time, or at the end of a path."""
        every = super().values(name, run)
        column = _column(name, every, self.component)
        return Reading(column[0] if every.times is None else column, every.times)


@checked
class Maximum(_Sampled):
    """Largest value over time of a component of what a sensor sees, or of its length.

    The parabola through the largest value and its neighbours gives it between steps.

    Parameters
    ----------
    sensor : Sensor
    component : int, optional
        Default: the Euclidean length of all its numbers.

    Examples
    --------
    >>> import skfem_cosserat as sc
    >>> model = sc.Model()
    >>> ball = model.add("ball", sc.MassPoint(1.0, velocity=(0, 0, 3.0)))
    >>> gravity = model.add("gravity", sc.LoadGravity((0, 0, -10.0)))
    >>> height = sc.accuracy.Maximum(sc.SensorPosition(ball.place()), 2)
    >>> found = sc.answer(model, {"height": height}, tolerance=1e-3, until=0.7)
    >>> round(float(found.values["height"]), 3)
    0.45
    """

    def __init__(self, sensor: Sensor, component: int | None = None):
        super().__init__(sensor)
        known = component is not None
        self.component = whole("Maximum", component, 0, "component") if known else None

    def values(self, name: str, run: Run) -> Reading:
        """The largest value of the run."""
        every = super().values(name, run)
        y = _column(name, every, self.component)
        t = every.times
        k = y.argmax()
        if t is None or not 0 < k < len(y) - 1:
            return Reading(np.asarray(y[k]))
        near = slice(k - 1, k + 2)
        a, b, _ = np.polyfit(t[near] - t[k], y[near] - y[k], 2)
        return Reading(np.asarray(y[k] - (b * b / (4 * a) if a < 0 else 0.0)))


def _column(name: str, whole: Reading, component: int | None) -> Floats:
    """A component over time (K,), or the length; (1,) of one value for the whole run."""
    rows = np.asarray(whole.values)
    rows = rows.reshape(1 if whole.times is None else len(rows), -1)
    if component is None:
        return np.linalg.norm(rows, axis=1)
    if component >= rows.shape[1]:
        text = f"component = {component}, of a sensor that sees {rows.shape[1]} numbers"
        raise InputError(f"quantity {name!r}", text)
    return rows[:, component]


class _TimeOf(Quantity):
    """Time (s) at which an event happens first; NaN if it does not."""

    def __init__(self, event: Event):
        self.event = event

    def values(self, name: str, run: Run) -> Reading:
        times = [each.time for each in run.history.events if each.name == self.event.name]
        return Reading(np.asarray(min(times, default=np.nan)))


class _Function(Quantity):
    """A series of the history, or what a function makes of it."""

    def __init__(self, function: Callable[..., Any] | str):
        self.function = function

    def values(self, name: str, run: Run) -> Reading:
        item = f"quantity {name!r}"
        history = run.history
        if isinstance(self.function, str):
            if self.function not in history:
                known = names_known(self.function, history)
                raise InputError(item, f"series {self.function!r} is unknown; {known}")
            found = history[self.function]
        else:
            given = (run.model, history) if _arguments(self.function) == 2 else (history,)
            try:
                found = self.function(*given)
            except InputError as error:
                text = f"{error} (the history is of another mesh: read history.sensors, or take"
                raise InputError(item, f"{text} (model, history))") from error
            except CosseratError:  # such as of modes that a poor mesh does not have
                raise
            except Exception as error:
                raise NotHere(item, f"it failed: {type(error).__name__}: {error}") from error
        values = numbers(item, "value", found)
        if not values.size or np.isinf(values).any():
            raise NotHere(item, f"{found!r}, expected finite numbers")
        over_time = values.ndim > 0 and len(values) == len(history)
        if not run.in_time:
            return Reading(values[-1] if over_time and isinstance(self.function, str) else values)
        return Reading(values, history.times if over_time else None)


def _arguments(function: Callable[..., Any]) -> int:
    """Number of arguments that a function needs."""
    try:
        parameters = inspect.signature(function).parameters.values()
    except (TypeError, ValueError):  # some written in C do not say
        return 1
    positional = inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD
    return sum(each.default is each.empty and each.kind in positional for each in parameters)


# -- a run, and what is read from it ---------------------------------------------------------------


@dataclass
class Run:
    """A run, or a path of equilibria, of a scene on one mesh; or why there is none.

    Attributes
    ----------
    model : Model
    system : System
    history : History
    values : dict of str to Reading
        Of each quantity.
    cost_s : float
        Processor time (s).
    in_time : bool
        Whether values are asked over time: of a path over the load factor, else at its end.
    """

    model: Model
    system: System
    history: History
    values: dict[str, Reading] = field(default_factory=dict)
    cost_s: float = float("nan")
    in_time: bool = True

    @property
    def at_rest(self) -> bool:
        """True for a path of equilibria."""
        return "load_factor" in self.history

    def seen(self, name: str, sensor: Sensor) -> Reading:
        """Values of a sensor over time; of a path at its end, unless its factor stands for time."""
        if not self.at_rest:
            record = self.history.sensors[name]
            finite = np.isfinite(record.values.reshape(len(record.times), -1)).all(1)
            return Reading(record.values[finite], record.times[finite])
        system = self.system
        path = self.history
        if isinstance(sensor, SensorReaction):
            joint = f"joint/{sensor.joint.name}/"
            rows = np.concatenate([path[joint + "force"], path[joint + "moment"]], 1)
        elif isinstance(sensor, SensorForce):
            rows = forces_along(system, path, sensor.beam, np.array([sensor.s]), sensor.part)[:, 0]
        elif sensor.derivative:
            raise InputError(f"quantity {name!r}", f"{type(sensor).__name__} needs a motion")
        else:
            rows = seen(name, sensor, Window(system, path.instants, path["q"], path["p"]))
        return Reading(rows, path["load_factor"]) if self.in_time else Reading(rows[-1])

    @cached_property
    def jumps(self) -> Floats:
        """Instants (s) beside which forces belong to two sides."""
        if self.at_rest:
            return np.zeros(0)
        happened = [event.time for event in self.history.events]
        return np.union1d(jumps(self.system, self.history), happened)

    def distances(self, other: Run) -> dict[str, tuple[Floats, Floats]]:
        """By quantity: instants, and distances there from a run with steps no longer than these.

        Within a step of a jump nothing is compared.
        """
        around = np.concatenate([self.jumps, other.jumps])
        h = 0.0 if self.at_rest else float(self.history.meta["step"]) * (1 + 1e-9)
        spans = np.stack([around - h, around + h], 1)
        for name, own in self.values.items():
            a = own.shape
            b = other.values[name].shape
            if a != b:
                text = f"has shape {a} on one mesh and {b} on another, expected the same on all"
                raise InputError(f"quantity {name!r}", text)
        return {name: own.distances(other.values[name], spans) for name, own in self.values.items()}


class Asked:
    """Quantities with their tolerances, checked.

    Parameters
    ----------
    quantities : mapping of str to quantity
    tolerance : float or mapping of str to float

    Raises
    ------
    InputError
        If there is none, a name is no string or has a slash, something is no quantity, or a
        tolerance is missing or not positive.
    """

    def __init__(self, quantities: Any, tolerance: Any):
        item = "argument quantities"
        if not isinstance(quantities, Mapping) or not quantities:
            raise InputError(item, f"{quantities!r}, expected a dict of names and quantities")
        self.wanted = {}
        for name, given in quantities.items():
            if not isinstance(name, str) or not name or "/" in name:
                raise InputError(item, f"{name!r}, expected a name without slashes")
            self.wanted[name] = _quantity(name, given)
        if isinstance(tolerance, Mapping):
            if set(tolerance) != set(quantities):
                known = sorted(quantities)
                raise InputError(
                    "argument tolerance", f"is for {list(tolerance)}, expected {known}"
                )
            self.tolerance = {name: _positive(name, tolerance[name]) for name in quantities}
        else:
            self.tolerance = dict.fromkeys(quantities, _positive("value", tolerance))

    @property
    def names(self) -> list[str]:
        """In the order given."""
        return list(self.wanted)

    def sensors(self, copies: Replacements | None = None) -> dict[str, Sensor]:
        """Sensors by the names of the quantities, those of a rebuilt scene."""
        copied = self.copied(copies)
        return {name: each.sensor for name, each in copied.items() if each.sensor is not None}

    def copied(self, copies: Replacements | None) -> dict[str, Quantity]:
        """The quantities as they are in a rebuilt scene."""
        return self.wanted if copies is None else {k: copies.of(q) for k, q in self.wanted.items()}

    @property
    def needs_states(self) -> bool:
        """True if functions or series are asked for, which see recorded states alone."""
        return any(isinstance(each, _Function) for each in self.wanted.values())

    def events(self, copies: Replacements | None) -> list[Event]:
        """Events that the run has."""
        return [each.event for each in self.copied(copies).values() if isinstance(each, _TimeOf)]

    def read(self, run: Run, copies: Replacements | None) -> dict[str, Reading]:
        """All of them, in a run."""
        return {name: each.values(name, run) for name, each in self.copied(copies).items()}


def _positive(name: str, value: Any) -> float:
    number = real("argument tolerance", name, value, "a positive number")
    if number <= 0:
        raise InputError("argument tolerance", f"{name} = {value!r}, expected a positive number")
    return number


def _quantity(name: str, given: Any) -> Quantity:
    """The quantity that a user's sensor, condition, event, name or function stands for."""
    if isinstance(given, Quantity):
        return given
    if isinstance(given, Sensor):
        return _Sampled(given)
    if isinstance(given, Condition):
        return _TimeOf(Event(given, name=name))
    if isinstance(given, Event):
        return _TimeOf(given)
    if isinstance(given, str) or (callable(given) and _arguments(given) in (1, 2)):
        return _Function(given)
    text = f"{given!r}, expected a sensor, Component, Maximum, condition, event, the name of a"
    raise InputError(f"quantity {name!r}", f"{text} series, or a function of (history)")


def attached(things: Iterable[Any]) -> list[Place]:
    """All places of items that some things refer to."""
    places = _Places()
    for thing in things:
        places.of(thing)
    return places.found


class _Places(Replacements):
    """Notes all places that are come across, also in functions of users."""

    def __init__(self) -> None:
        super().__init__({})
        self.found: list[Place] = []
        self._functions: set[int] = set()

    def of(self, value: Any) -> Any:
        if isinstance(value, Place) and value.item is not None:
            self.found.append(value)
        if isinstance(value, FunctionType) and id(value) not in self._functions:
            self._functions.add(id(value))
            known = inspect.getclosurevars(value)
            for each in (*known.nonlocals.values(), *known.globals.values()):
                self.of(each)
        return super().of(value)


#: highest order of elements
HIGHEST = 4


class Case(NamedTuple):
    """A scene at a mesh, an order and a step.

    Attributes
    ----------
    parts : int
        Elements in the place of each element of the poorest mesh.
    order : int
    steps : int
        Zero for equilibria.
    """

    parts: int
    order: int
    steps: int

    @property
    def work(self) -> int:
        """Steps times nodes, to compare it with that of others."""
        return max(self.steps, 1) * self.parts * self.order

    @property
    def shorter(self) -> Case:
        """With half of the step."""
        return self._replace(steps=2 * self.steps)

    @property
    def longer(self) -> Case:
        """With twice the step."""
        return self._replace(steps=self.steps // 2)

    @property
    def coarser(self) -> Case:
        """With half as many elements."""
        return self._replace(parts=self.parts // 2)

    @property
    def finer(self) -> Case:
        """With twice as many elements."""
        return self._replace(parts=2 * self.parts)

    @property
    def richer(self) -> Case:
        """The next order, after the highest one twice as many elements."""
        return self._replace(order=self.order + 1) if self.order < HIGHEST else self.finer


# -- the scene on any mesh -------------------------------------------------------------------------


class Scene:
    """A model, what is asked of it, and how it is run.

    Parameters
    ----------
    model : Model
    asked : Asked
    until : float or None
    start : State, callable or None
    integrator : Integrator, Control or None

    Raises
    ------
    InputError
        As from :meth:`Model.freeze`; for an end before the start, an integrator of equilibria, and
        sensors of items that are not in the model.
    """

    def __init__(
        self,
        model: Model,
        asked: Asked,
        until: float | None,
        start: State | Callable[[System], State] | None,
        integrator: Integrator | Control | None,
    ):
        self.model, self.asked, self.start = model, asked, start
        self.system = model.freeze()
        self.moves = until is not None
        kind = Integrator if self.moves else Control
        if integrator is not None and not isinstance(integrator, kind):
            wanted = "an integrator such as EnergyMomentum(), or until=None for equilibria"
            wanted = wanted if self.moves else "a control such as LoadControl()"
            raise InputError("argument integrator", f"{integrator!r}, expected {wanted}")
        self.integrator = integrator if isinstance(integrator, Integrator) else EnergyMomentum()
        marches = type(self.integrator).march is not Integrator.march  # its joints need multipliers
        self.treatment = Multipliers() if marches else NullSpace()
        self.control = integrator if isinstance(integrator, Control) else None
        try:
            first = self.begin(self.system)
        except Exception as error:
            if callable(start) and not isinstance(error, CosseratError):
                raise failed("argument start", "it", error) from error
            raise
        events = asked.events(None)
        try:
            checked_sensors(asked.sensors(), self.system, first)
            checked_events(events, self.integrator, self.system)
        except InputError as error:
            raise InputError("argument quantities", str(error)) from error
        if events and not self.moves:
            raise InputError("argument quantities", f"{events[0].label} needs a motion: until=")
        self.begun = first.time
        self.span = 0.0
        if until is not None:
            end = real("argument until", "until", until, "a time (s)")
            if not first.time < end < np.inf:
                text = f"{until!r}, expected a time after the start at {first.time:.9g} s"
                raise InputError("argument until", text)
            self.span = end - first.time
        self.beams = {name: each for name in model if isinstance(each := model[name], Beam)}
        places = attached([*(model[name] for name in model), *asked.wanted.values()])
        self.keep = {name: _kept(beam, places) for name, beam in self.beams.items()}
        self.pieces = {
            name: divided(beam.mesh, 1, self.keep[name]).nelements
            for name, beam in self.beams.items()
        }
        self._built: dict[tuple[int, int], tuple[Model, System, Replacements | None]] = {}

    def steps_that_see(self, counts: Sequence[int], end: float | None = None) -> tuple[int, str]:
        """The first number of steps that see loads and motions; "" or the item that none sees.

        Up to the end of the motion, or up to a time (s).
        """
        scheme = self.integrator.single.scheme(1.0)
        at_ends = scheme is not None and scheme.at_end
        end = self.begun + self.span if end is None else end
        return steps_that_see(self.system, self.begun, end, at_ends, counts)

    @property
    def order(self) -> int:
        """Order of errors by the step."""
        return self.integrator.order

    def begin(self, system: System, nudge: float = 0.0) -> State:
        """The state that a run starts from; with a nudge (m) velocities that move it so far."""
        if self.start is None:
            state = initial_state(system)
        elif isinstance(self.start, State):
            state = carry_state(self.system, system, self.start)
        else:
            state = self.start(system)
            check_kind("argument start: what it gave", state, State)
        if not nudge:
            return state
        nu = np.cos(1.0 + np.arange(system.unknowns) ** 1.5)  # without a pattern, always the same
        v = system.null_space(state.q, state.time) @ nu
        v *= nudge / self.span / max(abs(v).max(), 1e-300)
        p = state.p + momentum(system, v)
        return State(state.time, state.index, state.q, p, state.fresh, state.turns, state.carried)

    def items(self, case: Case, theories: Mapping[str, Theory] | None = None) -> dict[str, Beam]:
        """The beams at a mesh and an order, some of them with other theories."""
        theories = theories or {}
        found = {}
        for name, beam in self.beams.items():
            mesh = divided(beam.mesh, case.parts * self.pieces[name], self.keep[name])
            found[name] = beam.on_mesh(mesh, case.order, theories.get(name))
        return found

    def built(self, case: Case) -> tuple[Model, System, Replacements | None]:
        """The scene at a mesh and an order."""
        key = case.parts, case.order
        if key not in self._built:
            self._built[key] = self.frozen(self.items(case))
        return self._built[key]

    def frozen(
        self, beams: Mapping[str, Beam], planar: Planar | None = None
    ) -> tuple[Model, System, Replacements | None]:
        """The scene with other beams, perhaps in its plane."""
        model, copies = self.model.rebuilt(beams) if beams else (self.model, None)
        return model, model.freeze(planar), copies

    def run(
        self,
        case: Case,
        nudge: float = 0.0,
        built: tuple[Model, System, Replacements | None] | None = None,
    ) -> Run:
        """A run, and what is asked of it."""
        begun = time.process_time()
        model, system, copies = self.built(case) if built is None else built
        if self.moves:
            state = self.begin(system, nudge)
            # functions look at recorded states: more of them
            history = simulate(
                system,
                self.integrator,
                self.treatment,
                self.span / case.steps,
                state.time + self.span,
                start=state,
                every=max(1, case.steps // (1024 if self.asked.needs_states else 128)),
                sensors=self.asked.sensors(copies),
                events=self.asked.events(copies) or None,
            )
        else:
            start = None if self.start is None else self.begin(system)
            control = self.control if copies is None else copies.of(self.control)
            history = static(system, self.treatment, control, start=start)
        return self.read(Run(model, system, history, in_time=self.moves), copies, begun)

    def read(self, run: Run, copies: Replacements | None, begun: float) -> Run:
        """The run with what is asked of it, and its cost since it was begun (processor time, s)."""
        run.values = self.asked.read(run, copies)
        run.cost_s = time.process_time() - begun
        return run


def _kept(beam: Beam, places: list[Place]) -> list[tuple[int, float]]:
    """Elements and coordinates in them of a beam's nodes with places, and of kinks of sections."""
    nodes = beam.basis.interpolation.nodes
    found = [(e, xi) for *_, e, xi in beam.kinks()]
    for vertex in sorted({place.vertex for place in places if place.item is beam}):
        e, k = (int(x[0]) for x in np.nonzero(beam.basis.connectivity == vertex))
        found.append((e, float(nodes[k])))
    return found
