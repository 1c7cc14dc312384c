"""Conditions of events: numbers that pass through zero when something happens."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable

import numpy as np

from ..errors import InputError
from ..joint import Joint
from ..model import System
from ..model.change import joint_of
from ..types import numbers
from .sensors import Sensor
from .view import View

__all__ = [
    "Condition",
    "ConditionCoordinate",
    "ConditionEnergy",
    "ConditionFunction",
    "ConditionReaction",
    "ConditionSensor",
    "ConditionTime",
]


class Condition(ABC):
    """A number that passes through zero.

    Attributes
    ----------
    period : float or None
        What it may jump by, such as angles by a full turn; None: it does not jump.
    monotonic : bool
        It passes through zero once at most.
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

    def __init__(self, function: Callable[[float, View], float]) -> None:
        if not callable(function):
            raise InputError("condition", f"{function!r}, expected a Condition or a function")
        self.function = function

    def value(self, view: View) -> float:
        """See the base class."""
        out = numbers("condition", f"value at t = {view.time!r}", self.function(view.time, view))
        if out.shape != ():
            raise InputError("condition", f"has shape {out.shape}, expected a number")
        return float(out)


class ConditionTime(Condition):
    """A time is reached, ``t - time``.

    Parameters
    ----------
    time : float
        (s)
    """

    monotonic = True

    def __init__(self, time: float) -> None:
        self.time = _level(time)

    def value(self, view: View) -> float:
        """See the base class."""
        return view.time - self.time


class ConditionCoordinate(Condition):
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
    ) -> None:
        self.joint, self.level = joint, _level(level)
        self.coordinate, self.rate = coordinate, rate

    def check(self, system: System) -> None:
        """See the base class."""
        coordinate = joint_of(system, self.joint).coordinate(self.coordinate)
        if coordinate.kind not in ("angle", "displacement"):
            what = f"{coordinate.name}, expected an angle or a displacement"
            raise InputError(joint_of(system, self.joint).label, f"an event on its {what}")
        if coordinate.kind == "angle" and not self.rate:
            self.period = 2 * np.pi

    def value(self, view: View) -> float:
        """See the base class."""
        if self.rate:
            return view.rate(self.joint, self.coordinate) - self.level
        away = view.coordinate(self.joint, self.coordinate) - self.level
        return away if self.period is None else float((away + np.pi) % (2 * np.pi) - np.pi)


class ConditionSensor(Condition):
    """What a sensor sees reaches a level.

    Parameters
    ----------
    sensor : Sensor
        Position, velocity, strain, section force or quantity.
    level : float
    component : int, optional
        Of a vector; default: its length.
    """

    def __init__(self, sensor: Sensor, level: float, component: int | None = None) -> None:
        if not isinstance(sensor, Sensor):
            raise InputError("condition", f"sensor = {sensor!r}, expected a sensor")
        self.sensor, self.level, self.component = sensor, _level(level), component

    def check(self, system: System) -> None:
        """See the base class."""
        known = {id(each) for each in (*system.structures, *system.joints)}
        for each in self.sensor.items():
            if id(each) not in known:
                raise InputError("condition", f"the {each.label} of its sensor is not here")

    def value(self, view: View) -> float:
        """See the base class."""
        seen = np.asarray(view.sensor(self.sensor))
        if self.component is None:
            return float(seen if seen.ndim == 0 else np.linalg.norm(seen)) - self.level
        return float(seen.ravel()[self.component]) - self.level


class ConditionReaction(Condition):
    """The force (N) or moment (N m) of a joint reaches a level.

    Parameters
    ----------
    joint : Joint or str
        Or its name.
    level : float
        Of its magnitude.
    moment : bool
        The moment instead of the force.
    """

    def __init__(self, joint: Joint | str, level: float, moment: bool = False) -> None:
        self.joint, self.level, self.moment = joint, _level(level), moment

    def check(self, system: System) -> None:
        """See the base class."""
        joint_of(system, self.joint)

    def value(self, view: View) -> float:
        """See the base class."""
        return float(np.linalg.norm(view.reaction(self.joint)[int(self.moment)])) - self.level


class ConditionEnergy(Condition):
    """Kinetic and stored energy (J) together, or the kinetic one alone, reach a level.

    Parameters
    ----------
    level : float
    kinetic : bool
        The kinetic energy alone.
    """

    def __init__(self, level: float, kinetic: bool = False) -> None:
        self.level, self.kinetic = _level(level), kinetic

    def value(self, view: View) -> float:
        """See the base class."""
        return (view.kinetic_energy() if self.kinetic else view.energy()) - self.level


def _level(value: float) -> float:
    level = numbers("condition", "level", value)
    if level.shape != () or not np.isfinite(level):
        raise InputError("condition", f"level = {value!r}, expected a finite number")
    return float(level)
