"""Loads and supports along a path, its points, and how these are recorded."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..coupling import Coupling
from ..errors import InputError
from ..history import History, HistoryWriter
from ..load import Load
from ..model import System
from ..model.balance import Amplitudes, Spin
from ..newton import NewtonReport
from ..run.describe import describe
from ..run.record import take_along
from ..time_function import (
    Amplitude,
    Constant,
    TimeFunction,
    time_function,
)
from ..types import Array, FilePath, Floats, IndexArray, finite, names_known
from ..warn import Notices

# -- points of a path, what fixes them, and what comes with them -----------------------------------


def weights(system: System) -> Floats:
    """Weights (rows, 1) that make the square of a motion free of units, a mean over all nodes.

    ``1/length^2`` for positions and 1/2 for directors: a turn by a small angle counts as the angle.
    """
    out = np.full((system.rows, 1), 0.5)
    out[system.origin_rows] = 1 / system.length**2
    return out / len(system.origin_rows)


@dataclass(eq=False, repr=False)
class Point:
    """An equilibrium on a path.

    Attributes
    ----------
    y : (total, 3) array
        All rows.
    t : float
        Load factor.
    turns : (k,) int array or None
        Full turns of the angles of springs, as in a state.
    """

    y: Floats
    t: float
    turns: IndexArray | None = None

    def __repr__(self) -> str:
        """Without the arrays."""
        return f"Point(t={self.t!r}, rows={len(self.y)})"


@dataclass(frozen=True, eq=False)
class Functional:
    """Condition for a point of a path: ``gradient . (y - y_0) + by_factor (t - t_0) = value``.

    By default the load factor of the start.

    Attributes
    ----------
    gradient : (rows, 3) array or None
        None: zero.
    by_factor, value : float
    predictor : (rows, 3) array or None
        Change of the coordinates to start from, where the tangent at the start gives none.
    """

    gradient: Floats | None = None
    by_factor: float = 1.0
    value: float = 0.0
    predictor: Floats | None = None

    def __call__(self, point: Point, y: Array, t: float) -> float:
        """Residual of the condition at (y, t), for a step that starts at `point`."""
        out = self.by_factor * (t - point.t) - self.value
        if self.gradient is not None:
            change = np.real(y[: len(self.gradient)]) - point.y[: len(self.gradient)]
            out += float((self.gradient * change).sum())
        return out

    def share(self, start: Point, end: Point) -> float:
        """Share of `value` that is covered from the start to the point `end`."""
        return 1.0 + self(start, end.y, end.t) / self.value


@dataclass(eq=False)
class Neutral:
    """Motions of an equilibrium that nothing holds and nothing drives, to rounding.

    As of a round column that has buckled: its plane of bending is free.

    Attributes
    ----------
    motions : list of (rows, 3) arrays
        Of unit size in the metric of :func:`weights`, and normal to each other.
    limit : float
        Eigenvalue of the stiffness in that metric up to which a motion counts as neutral.
    """

    motions: list[Array] = field(default_factory=list)
    limit: float = 0.0


@dataclass(eq=False)
class Solution:
    """Solved point of a path, with its constraint force, report and prediction.

    Attributes
    ----------
    point : Point
    constraint_force : (n,) array
    report : NewtonReport
    predicted : (rows, 3) array
        Change of the coordinates that the tangent at the start predicts.
    """

    point: Point
    constraint_force: Floats
    report: NewtonReport
    predicted: Floats


# -- which share of each load acts where on a path -------------------------------------------------

#: change of the load factor, relative to it, for difference quotients of any function
SMALL = 1e-6

_Channel = tuple[TimeFunction, TimeFunction | None, str]


def _value(function: TimeFunction, t: float, owner: str) -> float:
    """At load factor t; an error of a function names whose it is."""
    try:
        return function.value(t)
    except InputError as error:
        raise InputError(owner, str(error)) from error


class Schedule:
    """Amplitudes of all loads, actuators and of a spin as functions of the load factor.

    What is constant in time is multiplied by the load factor; what depends on time takes the load
    factor for it, as prescribed motion does. Factors given by name take the place of the load
    factor: a number holds a load, a :class:`Table` or a function of the load factor moves it.

    Parameters
    ----------
    system : System
    factors : mapping of str to float, TimeFunction or callable
        By the names of loads and actuators; ``"spin"`` for the spin.
    spin : Spin, optional
        Angular velocity at load factor 1; it grows in proportion.
    time : float, optional
        What depends on time is held as it is at this instant (s); default: it takes the load factor
        for the time.

    Raises
    ------
    InputError
        For names that are not in the system, or factors that are no functions.

    Attributes
    ----------
    moving : bool
        Whether prescribed motion goes on along the path.
    """

    def __init__(
        self,
        system: System,
        factors: Mapping[str, Amplitude] | None = None,
        spin: Spin | None = None,
        time: float | None = None,
    ) -> None:
        if spin is not None and not isinstance(spin, Spin):
            raise InputError("argument spin", f"{spin!r}, expected a Spin")
        if factors is not None and not isinstance(factors, Mapping):
            raise InputError("argument factors", f"{factors!r}, expected a mapping of names")
        if spin is not None and system.plane is not None:
            system.plane.check_spin(spin.velocity)
        self.system, self.spin = system, spin
        self.time = None if time is None else finite("argument time", "its value", time)
        self.moving = bool(system.moving) and time is None
        given = dict(factors or {})
        loading, couplings = system.loading, system.couplings
        owners = [*loading.owners, *couplings.owners]
        known = {str(owner.name) for owner in owners} | ({"spin"} if spin is not None else set())
        for name, factor in given.items():
            if name not in known:
                text = f"unknown name {name!r}; {names_known(name, sorted(known))}"
                raise InputError("argument factors", text)
            if factor is None or isinstance(factor, bool):
                raise InputError(
                    "argument factors", f"{name!r}: {factor!r}, expected a number or function"
                )
        self._given = {k: time_function(f"argument factors, {k!r}", v) for k, v in given.items()}
        self._loads = self._factors(loading.owners, loading.times)
        self._actuators = self._factors(couplings.owners, couplings.times)
        #: the load factor that was asked for last, and what is there: each iteration asks again
        self._known: tuple[float, Amplitudes] | None = None

    def _factors(
        self, owners: Sequence[Coupling | Load], times: Sequence[TimeFunction]
    ) -> list[_Channel]:
        """(own time, factor, name) of each channel; None: the load factor itself."""
        out = []
        for owner, time in zip(owners, times, strict=True):
            default = None if isinstance(time, Constant) else Constant(1.0)
            out.append((time, self._given.get(str(owner.name), default), owner.label))
        return out

    def instant(self, t: float) -> float:
        """Time (s) at which functions of time are taken at load factor t."""
        return t if self.time is None else self.time

    def ground(self, t: float) -> Floats:
        """Rows of the ground at load factor t."""
        return self.system.ground(self.instant(t))

    @property
    def grows(self) -> bool:
        """True if a load, actuator or spin changes with the load factor while time is held."""
        factors = [factor for _, factor, _ in (*self._loads, *self._actuators)]
        if self.spin is not None:
            factors.append(self._given.get("spin"))
        return any(not isinstance(factor, Constant) for factor in factors)

    @property
    def growing(self) -> list[str]:
        """Names of the loads and actuators that the load factor multiplies, and of a spin."""
        own = self.system.loading, self.system.couplings
        names = [
            str(owner.name)
            for each in own
            for owner, time in zip(each.owners, each.times, strict=True)
            if isinstance(time, Constant)
        ]
        names += ["spin"] if self.spin is not None else []
        return [name for name in dict.fromkeys(names) if name not in self._given]

    @property
    def difference(self) -> float:
        """Change of the load factor, relative to it, for difference quotients to both sides.

        They are exact over any, where all grow in proportion to it, or to its square as by a spin.
        """
        functions = [self._given.get("spin"), *(factor for _, factor, _ in self._loads)]
        if self.time is None:
            functions += [time for time, _, _ in self._loads]
        steady = all(each is None or isinstance(each, Constant) for each in functions)
        return 1.0 if steady and not (self.moving or self._actuators) else SMALL

    def holding(self, factors: Mapping[str, float]) -> Schedule:
        """A copy of the schedule with these factors, too."""
        return Schedule(self.system, {**self._given, **factors}, self.spin, self.time)

    def at(self, t: float) -> Amplitudes:
        """Amplitudes at load factor t."""
        if self._known is None or self._known[0] != t:
            self._known = t, self._at(t)
        return self._known[1]

    def _at(self, t: float) -> Amplitudes:
        now = self.instant(t)

        def numbers(channels: list[_Channel]) -> list[float]:
            return [
                _value(time, now, owner) * (t if factor is None else _value(factor, t, owner))
                for time, factor, owner in channels
            ]

        spin = self.spin
        if spin is not None:
            factor = self._given.get("spin")
            share = t if factor is None else _value(factor, t, "spin")
            spin = Spin(share * spin.velocity, spin.point)
        loads = self.system.loading.checked(np.array(numbers(self._loads)), t)
        return Amplitudes(loads, np.array([*numbers(self._actuators), 0.0]), spin, now)


def load_force(system: System, y: Floats, amplitudes: Amplitudes) -> Floats:
    """Forces (rows, 3) of loads, and of functions of the motion, at a configuration y."""
    loading = system.loading
    force = loading.dead_force(amplitudes.loads)
    if not loading.dead_only:
        force = force + loading.force(y[: system.rows], amplitudes.loads)
        force = force + system.couplings.pushed(y, amplitudes.actuators, amplitudes.time)
    return force


# -- A path as a history: points with their load factor, stability and constraint forces -----------

#: number of a point in the series "critical"
CODES = {"regular": 0, "limit": 1, "bifurcation": 2}


class PathRecorder:
    """Writes the points of a path."""

    def __init__(
        self,
        system: System,
        schedule: Schedule,
        meta: dict[str, Any],
        path: FilePath | None,
        notices: Notices,
    ) -> None:
        if path is not None and not isinstance(path, str | os.PathLike):
            raise InputError("argument path", f"{path!r}, expected the name of a file")
        self.system, self.schedule = system, schedule
        described, static = describe(system)
        described |= {"integrator": "static", "step": 0.0, "time": schedule.time, **meta}
        #: of each factor whose it is, and whether it is a function of time
        described["loads"] = {
            name: [
                [str(owner.name), not isinstance(time, Constant)]
                for owner, time in zip(channels.owners, channels.times, strict=True)
            ]
            for name, channels in (("loads", system.loading), ("actuators", system.couplings))
        }
        self.writer = HistoryWriter(described, static, path)
        self.notices = notices
        self.count = 0
        self.closed: History | None = None
        self._work = 0.0
        self._before: tuple[Floats, Floats] | None = None

    def __enter__(self) -> PathRecorder:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: object
    ) -> None:
        """An error of the user's own code takes the path so far along as ``error.history``."""
        if error is not None and self.count:
            take_along(error, self._so_far, [self.system])

    def _so_far(self) -> History:
        if self.closed is not None:
            return self.closed
        return self.writer.history() if self.writer.closed else self.close("failed")

    def take(
        self,
        point: Point,
        parameter: float,
        force: Floats,
        iterations: int,
        attempts: int,
        residual: float,
        unstable: int = -1,
        kind: str = "regular",
    ) -> None:
        """Record a point."""
        system = self.system
        q = point.y[: system.rows].reshape(-1)
        amplitudes, zero = self.schedule.at(point.t), np.zeros(system.n)
        loads = load_force(system, point.y, amplitudes).reshape(-1)
        if self._before is not None:  # work by the trapezoidal rule between the points
            q0, before = self._before
            self._work += float((before + loads) @ (q - q0)) / 2
        self._before, spin = (q, loads), amplitudes.spin
        turning = np.zeros((2, 3)) if spin is None else np.array([spin.velocity, spin.point])
        row = {
            "t": float(parameter),
            "step": self.count,
            "q": q,
            "p": zero,
            "carried": zero,
            "fresh": 1.0,
            "constraint_force": np.asarray(force, dtype=float),
            "load_factor": float(point.t),
            "unstable": unstable,
            "critical": CODES[kind],
            "newton_iterations": iterations,
            "attempts": attempts,
            "residual": residual,
            "work_loads": self._work,
            "amplitudes/loads": amplitudes.loads,
            "amplitudes/actuators": amplitudes.actuators,
            "amplitudes/spin": turning,
        }
        if system.couplings.angles:
            none = np.zeros(len(system.couplings.angles), dtype=np.int64)
            row["turns"] = none if point.turns is None else point.turns
        self.writer.append(row)
        self.count += 1

    def close(self, status: str, **extra: Any) -> History:
        """Close the file and give the history."""
        self.writer.close(status, **extra, warnings=self.notices.kept())
        self.closed = self.writer.history()
        return self.closed
