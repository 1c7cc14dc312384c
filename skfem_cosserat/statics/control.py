"""Points of a path and what fixes them: the load factor, a displacement, or the arc length."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..diagnostics.stacked import null_space_matrix, weights
from ..errors import InputError
from ..frames import Place, vector
from ..frozen import Attached
from ..model import System
from ..types import (
    MOST,
    SAME,
    Array,
    Floats,
    IndexArray,
    VectorLike,
    finite,
    largest,
    numbers,
    positive,
    shown,
    whole,
)

#: iterations at which the step is kept; it grows below and shrinks above
WANTED = 6
#: motion in a step (see :func:`size_of`) below which nothing moves
STILL = 1e-9


# -- points of a path, and what fixes them ---------------------------------------------------------


def size_of(system: System, motion: Floats) -> float:
    """Size of a motion (rows, 3) by :func:`weights`: relative to the scene, or rad."""
    return float(np.sqrt((weights(system) * np.square(motion)).sum()))


@dataclass(eq=False)
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


# -- arguments of controls -------------------------------------------------------------------------


def _listed(item: str, at: Sequence[float]) -> Floats:
    """Values of the parameter to hit."""
    values = numbers(item, "at", at)
    if values.ndim != 1 or not len(values) or not np.isfinite(values).all():
        raise InputError(item, f"at = {at!r}, expected a list of numbers")
    return values


def _whole(item: str, name: str, value: int) -> int:
    """Check a positive integer."""
    if whole(item, value, 1, name) > MOST:
        raise InputError(item, f"{name} = {shown(value)}, expected at most {MOST:.0e}")
    return int(value)


def _turned(item: str, turn: float | None) -> float | None:
    """A rotation that limits steps, or none."""
    return None if turn is None else positive(item, "turn", turn, " of rad")


# -- a control at work -----------------------------------------------------------------------------


class Stage(ABC):
    """A control at work: where on the path it is, and what fixes the next point.

    Attributes
    ----------
    parameter : float
        Path parameter of the last point accepted.
    length : float
        Next step of it that is planned.
    shortest : float
        A step below which the path counts as ended.
    stops : list of float
        Values of the parameter that are asked for and still to come.
    """

    parameter: float
    length: float
    shortest: float
    stops: list[float]

    @abstractmethod
    def functional(self, point: Point, length: float) -> Functional:
        """Condition that fixes the next point, a step `length` of the parameter further."""

    def trial(self) -> float:
        """The planned step, shortened to the next point that is asked for."""
        if not self.stops:
            return self.length
        left = self.stops[0] - self.parameter
        if abs(left) <= abs(self.length) * (1 + 1e-9):
            return left
        # two equal steps rather than a long and a tiny one
        return left / 2 if abs(left) < 2 * abs(self.length) else self.length

    def accept(self, before: Point, after: Point, length: float) -> bool:
        """A point is found; says whether it is one that was asked for."""
        self.parameter += length
        if self.stops and abs(self.stops[0] - self.parameter) <= 1e-12 * abs(self.stops[0]):
            self.parameter = self.stops.pop(0)
            return True
        return False

    def adapt(self, iterations: int, length: float) -> None:
        """Plan the next step after one of `length` that took so many iterations."""
        if self.fixed:
            self.length = float(np.sign(length)) * min(2 * abs(length), self.longest)
            return
        factor = min(2.0, max(0.5, (WANTED / max(iterations, 1)) ** 0.5))
        if abs(length) >= abs(self.length) or factor < 1:
            self.length = float(np.sign(length)) * min(abs(length) * factor, self.longest)

    longest: float = np.inf
    #: steps go from one point asked for to the next, however many iterations they take
    fixed: bool = False

    def aim(self, rate: Floats) -> None:
        """Take the derivative (rows, 3) of the coordinates by the load factor at the start."""
        return

    def finished(self, point: Point) -> bool:
        """True if the end of the path is reached."""
        return not self.stops


class Control(Attached, ABC):
    """A choice; :meth:`stage` puts it to work.

    Attributes
    ----------
    parameter : str
        What the times of the path's history are.
    turn : float or None
        Largest rotation (rad) of a node in an automatic step; one that turns more is repeated
        shorter.
    """

    parameter: str
    turn: float | None
    all_points: bool

    @abstractmethod
    def stage(self, system: System, point: Point) -> Stage:
        """Start at a point."""


class _Steered(Control):
    """By a parameter whose end is given."""

    def __init__(
        self,
        until: float | None,
        steps: int | None,
        at: Sequence[float] | None,
        first: float,
        longest: float,
        turn: float | None,
    ):
        item = type(self).__name__
        if steps is not None:
            _whole(item, "steps", steps)
        for name, value in {"until": until, "steps": steps}.items():
            if at is not None and value is not None:
                both = f"{name} = {value!r} and at = {at!r}"
                raise InputError(item, f"{both}, expected one of them")
        self.at = None if at is None else tuple(_listed(item, at).tolist())
        self.until = finite(item, "until", until) if at is None else None
        self.longest = positive(item, "longest", longest)
        self.first = min(positive(item, "first", first), self.longest)
        self.steps = steps
        self.turn = _turned(item, turn)
        self.all_points = steps is None and at is None


class _SteeredStage(Stage):
    """Steps of a parameter: of what has this gradient (rows, 3), or of the load factor."""

    def __init__(self, control: _Steered, start: float, gradient: Floats | None = None):
        self._gradient = gradient
        self.parameter = start
        self.stops = self._ends(control, start)
        way = self.stops[-1] - start
        self.fixed = control.steps is not None
        self.length = way if self.fixed else control.first * way
        self.longest = abs(way) * (1.0 if self.fixed else control.longest)
        self.shortest = 1e-7 * abs(way)

    @staticmethod
    def _ends(control: _Steered, start: float) -> list[float]:
        """Values of the parameter that are hit exactly, of a path from `start`."""
        item, until, count = type(control).__name__, control.until, control.steps or 1
        ends = [*(control.at or ())]
        if until is not None:
            ends = [start + (until - start) * (k / count) for k in range(1, count)] + [until]
        if ends[0] == start:
            ends = ends[1:]  # it is recorded anyway
        change = np.diff([start, *ends])
        if not ends or until == start:
            raise InputError(item, f"{start:g} is where the path starts, expected another end")
        if not ((change > 0).all() or (change < 0).all()):
            raise InputError(item, f"at = {ends} does not lead one way from the start at {start:g}")
        return ends

    def functional(self, point: Point, length: float) -> Functional:
        return Functional(self._gradient, float(self._gradient is None), length)


class LoadControl(_Steered):
    """Steps of the load factor; finds no way past a limit point.

    Parameters
    ----------
    until : float, optional
        Load factor at the end, default: 1.
    steps : int, optional
        As many equal steps, whatever a node turns in one; default: automatic. A step that fails
        is halved all the same.
    at : sequence of float, optional
        Load factors to record instead, in one direction, the last is the end; the steps between
        are automatic. The start is recorded anyway, whether it is the first of them or not.
    first, longest : float
        First and longest automatic step, as a share of the whole; no first step is longer than
        the longest.
    turn : float or None
        Largest rotation of a node in an automatic step (rad): longer steps may land on another
        branch of the path.

    Raises
    ------
    InputError
        If a number is not positive, `at` is given with `until` or `steps`, or the load factors do
        not lead one way.

    Examples
    --------
    >>> LoadControl(steps=6).parameter
    'load factor'
    >>> LoadControl(until=60)
    LoadControl(until=60)
    """

    parameter = "load factor"

    def __init__(
        self,
        until: float | None = None,
        *,
        steps: int | None = None,
        at: Sequence[float] | None = None,
        first: float = 0.1,
        longest: float = 0.25,
        turn: float | None = 1.0,
    ):
        until = 1.0 if until is None and at is None else until
        super().__init__(until, steps, at, first, longest, turn)

    def stage(self, system: System, point: Point) -> Stage:
        """Start at a point, with steps of the load factor."""
        return _SteeredStage(self, point.t)


class DisplacementControl(_Steered):
    """Steps of one displacement; the load factor follows, also down again.

    Parameters
    ----------
    place : Place
        Of a beam node, body or mass point.
    direction : (3,) array
        The displacement is counted along it, from the start of the path; any length but zero.
    until : float
        Displacement at the end (m); not with `at`.
    steps, at, first, longest, turn
        As for :class:`LoadControl`, of displacements.

    Raises
    ------
    InputError
        As for :class:`LoadControl`; if the place is on the ground.

    Examples
    --------
    >>> from skfem_cosserat import MassPoint
    >>> DisplacementControl(MassPoint(1.0).place(), (0, 0, -2.0), until=0.1).direction.tolist()
    [0.0, 0.0, -1.0]
    """

    parameter = "displacement"

    def __init__(
        self,
        place: Place,
        direction: VectorLike,
        until: float | None = None,
        *,
        steps: int | None = None,
        at: Sequence[float] | None = None,
        first: float = 0.1,
        longest: float = 0.25,
        turn: float | None = 1.0,
    ):
        item = type(self).__name__
        if not isinstance(place, Place) or place.item is None:
            raise InputError(item, f"place = {place!r}, expected the place of an item")
        n = vector(item, "direction", direction)
        if not np.linalg.norm(n) > 0:
            raise InputError(item, f"direction = {direction!r} has no length")
        super().__init__(until, steps, at, first, longest, turn)
        self.place = place
        self.direction = n / np.linalg.norm(n)

    def stage(self, system: System, point: Point) -> Stage:
        """Start at a point, with steps of the displacement of the place."""
        item = type(self).__name__
        if id(self.place.item) not in system.first:
            raise InputError(item, f"place: {self.place.label} is not in the model")
        return _SteeredStage(self, 0.0, self._gradient(system))

    def check(self, system: System, point: Point) -> None:
        """Raise InputError if joints, drives and ground, all at rest, hold the displacement."""
        free = null_space_matrix(system, point.y).T @ self._gradient(system).ravel()
        if largest(free) <= SAME:  # joints hold it
            raise InputError(
                type(self).__name__,
                f"joints hold {self.place.label} along {self.direction.tolist()}",
            )

    def _gradient(self, system: System) -> Floats:
        """Derivative (rows, 3) of the displacement by the coordinates."""
        out = np.zeros((system.rows, 3))
        for row, factor in system.kinematics.spot_terms(system.spot(self.place)):
            out[row] += factor * self.direction
        return out


class _ArcStage(Stage):
    """Pseudo arc length: the next point lies in a plane normal to the last secant.

    Steps of a path without a direction are of the load factor until something moves.
    """

    def __init__(self, system: System, control: ArcLength, direction: Floats | None):
        self._system, self._control, self._secant = system, control, direction
        self.parameter, self.stops, self._count = 0.0, [], 0
        self._branches, self._crossed, self._regular = direction is not None, False, False
        self.length = control.length if self._branches else abs(control.first)
        self.longest = control.longest
        self.shortest = 1e-7 * self.length

    def functional(self, point: Point, length: float) -> Functional:
        if self._secant is None:
            return Functional(None, 1.0, np.sign(self._control.first) * length)
        unit = self._secant / size_of(self._system, self._secant)
        # at the start of a branch the tangent leads along the path it leaves
        predictor = length * unit if self._branches and self._count == 0 else None
        return Functional(weights(self._system) * unit, 0.0, length, predictor)

    def aim(self, rate: Floats) -> None:
        # not by a step of the load factor: next to a limit point it may lead to another branch
        size = size_of(self._system, rate)
        if self._secant is None and size > STILL:
            self._secant = np.sign(self._control.first) * rate
            # nor far: the tangent may be that of a path about to turn
            self.length = min(self.length * size, self._control.length, self.longest)
            self.shortest = 1e-7 * self.length

    def accept(self, before: Point, after: Point, length: float) -> bool:
        change = (after.y - before.y)[: self._system.rows]
        moved = size_of(self._system, change)
        self._regular = self._secant is not None and self._count > 0
        if self._secant is not None:
            self._secant = change
        elif moved > STILL:
            self._secant, self.length, self.shortest = change, moved, 1e-7 * moved
        # rigid so far: the load factor
        self.parameter += abs(after.t - before.t) if self._secant is None else moved
        self._count += 1
        until = self._control.until
        if until is not None:
            self._crossed = before.t != until and (before.t - until) * (after.t - until) <= 0
        return True

    def adapt(self, iterations: int, length: float) -> None:
        if self._regular:
            super().adapt(iterations, length)

    def finished(self, point: Point) -> bool:
        return self._crossed or self._count >= self._control.points


class ArcLength(Control):
    """Pseudo arc length: follows a path through limit points, the load factor is an unknown.

    The length of a step is the root mean square over all nodes of displacements, relative to the
    extent of the scene, and rotations (rad); the plane of the next point is normal to the last
    secant (Riks, Int. J. Solids Struct. 15 (1979) 529; Crisfield's cylindrical metric). Where
    nothing moves, the change of the load factor counts instead.

    Parameters
    ----------
    points : int
        Points to find at most.
    until : float, optional
        Load factor at which to stop when the path crosses it. It may be that of the start or lie
        behind it, as a path may turn back; one that does not goes on for all `points`.
    first : float
        Load factor of the first step; negative to set off the other way.
    length : float
        First step on a branch (see :func:`branch`), where there is no load factor to go by; no
        other first step is longer.
    longest : float
        Longest step, as above.
    turn : float or None
        Largest rotation of a node in a step (rad).

    Raises
    ------
    InputError
        If a number is not positive and finite.

    Examples
    --------
    >>> ArcLength(points=40, first=0.05).parameter
    'arc length'
    """

    parameter = "arc length"
    all_points = True

    def __init__(
        self,
        points: int = 100,
        *,
        until: float | None = None,
        first: float = 0.1,
        length: float = 0.01,
        longest: float = 0.2,
        turn: float | None = 0.5,
    ):
        item = "ArcLength"
        self.until = None if until is None else finite(item, "until", until)
        self.turn = _turned(item, turn)
        self.points = _whole(item, "points", points)
        self.first = finite(item, "first", first, "a number that is not zero")
        if self.first == 0:
            raise InputError(item, f"first = {first!r}, expected a number that is not zero")
        self.length = positive(item, "length", length)
        self.longest = positive(item, "longest", longest)

    def stage(self, system: System, point: Point, direction: Floats | None = None) -> Stage:
        """Start at a point; `direction` (rows, 3): of the first step, on a branch."""
        return _ArcStage(system, self, direction)
