"""Conditions and actions of events."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..analysis.start import consistent_start
from ..errors import InputError, failed
from ..frozen import Attached
from ..integrators import State
from ..joint import Joint
from ..load import Load
from ..model import Model, System, system_of
from ..model.scene import joint_of, load_of, locked, released, unlocked, with_amplitude
from ..notebook import brief
from ..time_function import (
    Amplitude,
    time_function,
)
from ..types import Floats, finite, numbers, switch
from .sensors import Sensor, View, Window, check_items

# -- conditions of events: numbers that pass through zero when something happens -------------------


class Condition(Attached, ABC):
    """A number that passes through zero.

    To write your own, derive from it and give `value`; :class:`Event` takes a plain function of
    ``(time, view)``, too.

    Attributes
    ----------
    period : float or None
        What it may jump by, such as angles by a full turn; None: it does not jump.
    monotonic : bool
        It passes through zero once at most.

    Examples
    --------
    Two places come nearer than a distance:

    >>> import numpy as np
    >>> import skfem_cosserat as sc
    >>> class ConditionNear(sc.Condition):
    ...     def __init__(self, a, b, distance):
    ...         self.a, self.b, self.distance = a, b, distance
    ...     def value(self, view):
    ...         gap = view.position(self.b) - view.position(self.a)
    ...         return float(np.linalg.norm(gap)) - self.distance
    >>> model = sc.Model()
    >>> ball = model.add("ball", sc.MassPoint(1.0, position=(2, 0, 0), velocity=(-1, 0, 0)))
    >>> near = ConditionNear(sc.ground((0, 0, 0)), ball.place(), 0.5)
    >>> run = model, sc.EnergyMomentum(), sc.NullSpace(), 0.1, 2.0
    >>> history = sc.simulate(*run, events=[sc.Event(near, sc.ActionStop())])
    >>> round(history.events[0].time, 9)
    1.5
    """

    period: float | None = None
    monotonic: bool = False

    @abstractmethod
    def value(self, view: View) -> float:
        """The number at a state."""

    def check(self, system: System) -> None:
        """Raise InputError if it cannot be found in this system."""
        return


class ConditionFunction(Condition):
    """A function of your own.

    Parameters
    ----------
    function : callable
        ``function(time, view) -> float``, continuous; see :class:`View`.
    """

    def __init__(self, function: Callable[[float, View], float]):
        if not callable(function):
            raise InputError("condition", f"{function!r}, expected a Condition or a function")
        self.function = function

    def value(self, view: View) -> float:
        """The number at a state."""
        try:
            found = self.function(view.time, view)
        except Exception as error:
            raise failed("condition", "it", error, view.time) from error
        out = numbers("condition", f"value at t = {view.time!r}", found)
        if out.shape != ():
            text = f"has shape {out.shape} at t = {view.time:.9g} s, expected a number"
            raise InputError("condition", text)
        return float(out)


class OfStates(Condition):
    """A condition whose numbers are found for many states at once."""

    def value(self, view: View) -> float:
        """The number at a state."""
        return float(self.values(view._states)[0])

    @abstractmethod
    def values(self, states: Window) -> Floats:
        """The numbers (k,) at several states."""

    @property
    def of_the_user(self) -> bool:
        """True if functions of users are asked, which are to see no state after an event."""
        return False


class ConditionTime(OfStates):
    """A time is reached, ``t - time``.

    Parameters
    ----------
    time : float
        (s)
    """

    monotonic = True

    def __init__(self, time: float):
        self.time = finite("condition", "level", time)

    def values(self, states: Window) -> Floats:
        """The numbers (k,) at several states."""
        return states.t - self.time


class ConditionCoordinate(OfStates):
    """A joint's angle (rad) or displacement (m) reaches a level.

    Parameters
    ----------
    joint : Joint or str
        Or its name.
    level : float
        Angles count modulo full turns.
    coordinate : str, optional
        Which one, if the joint has several.
    rate : bool
        Its rate instead (rad/s, m/s): zero where it turns back.

    Examples
    --------
    >>> condition = ConditionCoordinate("hinge", level=0.5)
    >>> condition.level
    0.5
    """

    def __init__(
        self, joint: Joint | str, level: float, coordinate: str | None = None, rate: bool = False
    ):
        self.joint = joint
        self.level = finite("condition", "level", level)
        self.coordinate = coordinate
        self.rate = switch("condition", rate, "rate")

    def check(self, system: System) -> None:
        """Raise InputError if it cannot be found in this system."""
        coordinate = joint_of(system, self.joint).coordinate(self.coordinate)
        if coordinate.kind not in ("angle", "displacement"):
            what = f"{coordinate.name}, expected an angle or a displacement"
            raise InputError(joint_of(system, self.joint).label, f"an event on its {what}")
        if coordinate.kind == "angle" and not self.rate:
            vars(self)["period"] = 2 * np.pi  # of a joint that may be given by its name

    def values(self, states: Window) -> Floats:
        """Distances from the level; of angles by the shortest way."""
        if self.rate:
            return states.rate(self.joint, self.coordinate) - self.level
        away = states.coordinate(self.joint, self.coordinate) - self.level
        return away if self.period is None else (away + np.pi) % (2 * np.pi) - np.pi


class ConditionSensor(OfStates):
    """The value of a sensor reaches a level.

    Parameters
    ----------
    sensor : Sensor
        Position, velocity, strain, section force or quantity.
    level : float
    component : int, optional
        Of a vector; default: its length.
    """

    def __init__(self, sensor: Sensor, level: float, component: int | None = None):
        if not isinstance(sensor, Sensor):
            raise InputError("condition", f"sensor = {sensor!r}, expected a sensor")
        self.sensor, self.level, self.component = (
            sensor,
            finite("condition", "level", level),
            component,
        )

    def check(self, system: System) -> None:
        """Raise InputError if it cannot be found in this system."""
        check_items(self.sensor, system, "condition", "of its sensor is not here")

    @property
    def of_the_user(self) -> bool:
        """True if its sensor calls functions of users."""
        return self.sensor._of_the_user

    def values(self, states: Window) -> Floats:
        """The numbers (k,) at several states."""
        seen = states.sensor(self.sensor)
        each = seen.reshape(len(seen), -1)
        if self.component is not None:
            return each[:, self.component] - self.level
        return (seen if seen.ndim == 1 else np.linalg.norm(each, axis=1)) - self.level


class ConditionReaction(Condition):
    """The force (N) or moment (N m) of a joint reaches a level.

    Parameters
    ----------
    joint : Joint or str
        Or its name.
    level : float
        Of its magnitude, or of a component.
    moment : bool
        The moment instead of the force.
    component : {0, 1, 2}, optional
        In space, with its sign; default: the magnitude.
    """

    def __init__(
        self,
        joint: Joint | str,
        level: float,
        moment: bool = False,
        component: int | None = None,
    ):
        self.joint = joint
        self.level = finite("condition", "level", level)
        self.moment = switch("condition", moment, "moment")
        if component is not None and component not in (0, 1, 2):
            raise InputError("condition", f"component = {component!r}, expected 0, 1, 2 or None")
        self.component = component

    def check(self, system: System) -> None:
        """Raise InputError if it cannot be found in this system."""
        joint_of(system, self.joint)

    def value(self, view: View) -> float:
        """The number at a state."""
        found = view.reaction(self.joint)[int(self.moment)]
        c = self.component
        return float(np.linalg.norm(found) if c is None else found[c]) - self.level


class ConditionEnergy(OfStates):
    """Kinetic and stored energy (J) together, or the kinetic one alone, reach a level.

    Parameters
    ----------
    level : float
    kinetic : bool
        The kinetic energy alone.
    """

    def __init__(self, level: float, kinetic: bool = False):
        self.level = finite("condition", "level", level)
        self.kinetic = switch("condition", kinetic, "kinetic")

    def values(self, states: Window) -> Floats:
        """The numbers (k,) at several states."""
        return (states.kinetic_energy() if self.kinetic else states.energy()) - self.level


# -- what events do: stop the run, switch loads, lock, free or release joints, go on otherwise -----


class ActionOutcome(NamedTuple):
    """Changes that an :class:`Action` asks for.

    Attributes
    ----------
    system : System or None
        To go on with; None: as before.
    state : State or None
        To go on from; None: this one, with the nearest velocity that the system allows.
    stop : bool
        Whether the run ends.

    Examples
    --------
    Nothing, as where an event is only recorded:

    >>> ActionOutcome()
    ActionOutcome(system=None, state=None, stop=False)
    """

    system: System | None = None
    state: State | None = None
    stop: bool = False


class Action(Attached, ABC):
    """Something that an event does.

    To write your own, derive from it and give `outcome`; :class:`Event` takes a plain function of
    ``(time, view)``, too, see :class:`ActionFunction`.

    Examples
    --------
    A wall throws a ball back and takes a share of its speed; a slow one stays:

    >>> import skfem_cosserat as sc
    >>> class ActionBounce(sc.Action):
    ...     def __init__(self, share, least):
    ...         self.share, self.least = share, least
    ...     def outcome(self, view):
    ...         if abs(view.v[0]) < self.least:
    ...             return sc.ActionOutcome(stop=True)
    ...         state = sc.initial_state(view.system, q=view.q, v=-self.share * view.v)
    ...         return sc.ActionOutcome(state=state)
    >>> model = sc.Model()
    >>> ball = model.add("ball", sc.MassPoint(1.0, position=(1, 0, 0), velocity=(-2, 0, 0)))
    >>> wall = sc.Event(lambda time, view: view.position(ball.place())[0], ActionBounce(0.5, 0.1))
    >>> run = model, sc.EnergyMomentum(), sc.NullSpace(), 0.1, 1.0
    >>> history = sc.simulate(*run, events=[wall])
    >>> history.velocity(ball.place())[-1].round(9).tolist()
    [1.0, 0.0, 0.0]
    """

    def __repr__(self) -> str:
        given = [value for name, value in vars(self).items() if not name.startswith("_")]
        return f"{type(self).__name__}({', '.join(map(_named, given))})"

    def check(self, system: System) -> None:
        """Raise InputError if it refers to what is not in the system."""
        return

    @abstractmethod
    def outcome(self, view: View) -> ActionOutcome:
        """The outcome at a state: how the run goes on."""


def _named(value: object) -> str:
    name = value.name if isinstance(value, (Joint, Load)) else value
    return name if isinstance(name, str) else brief(name)


class ActionNone(Action):
    """Nothing: the event is recorded, with its state."""

    def outcome(self, view: View) -> ActionOutcome:
        """The outcome at a state."""
        return ActionOutcome()


class ActionStop(Action):
    """The run ends there, with status "stopped"."""

    def outcome(self, view: View) -> ActionOutcome:
        """The outcome at a state."""
        return ActionOutcome(stop=True)


class _JointAction(Action):
    #: gives the scene with the joint changed, at a configuration and a time
    _changed: Callable[..., System]

    def __init__(self, joint: Joint | str):
        if not isinstance(joint, (Joint, str)):
            raise InputError("action", f"joint = {joint!r}, expected a joint or its name")
        self.joint = joint

    def check(self, system: System) -> None:
        """Raise InputError if it cannot be found in this system."""
        joint_of(system, self.joint)

    def outcome(self, view: View) -> ActionOutcome:
        """The outcome at a state."""
        return ActionOutcome(self._changed(view.system, self.joint, view.q, view.time))


class ActionLock(_JointAction):
    """A joint becomes rigid as it stands: its relative coordinates are frozen, its drives end.

    Velocities become the nearest ones, in the kinetic energy, that the locked scene allows: those
    after an inelastic impact between its sides. What that takes is in ``history["dissipated"]``
    and the event's ``loss``.

    Parameters
    ----------
    joint : Joint or str
        Or its name. Both sides need directions and must not be ground in prescribed motion.

    Examples
    --------
    >>> ActionLock("knee")
    ActionLock(knee)
    """

    _changed = staticmethod(locked)


class ActionUnlock(_JointAction):
    """A joint that was locked moves again as before."""

    _changed = staticmethod(unlocked)


class ActionRelease(_JointAction):
    """A joint is taken away, with its drives: what it held flies on.

    Springs and dampers on its coordinates stay.

    Parameters
    ----------
    joint : Joint or str
        Or its name.
    """

    _changed = staticmethod(released)


class ActionLoad(Action):
    """A load gets another amplitude: 0 switches it off, 1 on.

    Parameters
    ----------
    load : Load or str
        Or its name.
    amplitude : float, TimeFunction or callable
        Of a load whose components are functions of time: a number, by which they are multiplied.
    """

    def __init__(self, load: Load | str, amplitude: Amplitude):
        if not isinstance(load, (Load, str)):
            raise InputError("action", f"load = {load!r}, expected a load or its name")
        time_function("action", amplitude)
        self.load = load
        self.amplitude = amplitude

    def check(self, system: System) -> None:
        """Raise InputError if it cannot be found in this system."""
        load_of(system, self.load)

    def outcome(self, view: View) -> ActionOutcome:
        """The outcome at a state."""
        return ActionOutcome(with_amplitude(view.system, self.load, self.amplitude))


class ActionFunction(Action):
    """A function of your own gives what to go on with.

    Parameters
    ----------
    function : callable
        ``function(time, view)`` gives a Model or System with the same coordinates, a State to go
        on from, both as ``(system, state)``, or None: go on as before.
    """

    def __init__(self, function: Callable[[float, View], object]):
        if not callable(function):
            raise InputError("action", f"{function!r}, expected an Action or a function")
        self.function = function

    def outcome(self, view: View) -> ActionOutcome:
        """The outcome at a state."""
        try:
            answer = self.function(view.time, view)
        except Exception as error:
            raise failed("action", "it", error, view.time) from error
        system = None
        state = None
        for each in answer if isinstance(answer, tuple) else (answer,):
            if isinstance(each, (Model, System)):
                system = system_of(each)
            elif isinstance(each, State):
                state = each
            elif each is not None:
                raise InputError("action", f"gave {each!r}, expected a model, system or state")
        if system is not None and (system.n, system.total) != (view.system.n, view.system.total):
            raise InputError(
                "action",
                f"gave a system with n = {system.n} and {system.total} rows, expected"
                f" {view.system.n} and {view.system.total}: stop here, and start a run of its own",
            )
        if state is not None:
            now = replace(state, time=view.time)
            consistent_start(view.system if system is None else system, now, "action: its state")
        return ActionOutcome(system, state)
