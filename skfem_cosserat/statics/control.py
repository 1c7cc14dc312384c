"""Controls of a path: by the load factor, by a displacement, or by its arc length."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from inspect import signature

import numpy as np

from ..diagnostics.stacked import null_space_matrix
from ..errors import InputError
from ..frames import Place, vector
from ..frozen import Attached
from ..model import System
from ..types import MOST, SAME, Floats, VectorLike, finite, largest, numbers, positive, whole
from ..types import shown as cut
from .schedule import Functional, Point, weights

#: iterations at which the step is kept; it grows below and shrinks above
WANTED = 6
#: motion in a step (see :func:`weights`) below which nothing moves
STILL = 1e-9


# -- arguments of controls: checked, and shown -----------------------------------------------------


def _ends(
    item: str, until: float, steps: int | None, at: Sequence[float] | None, start: float
) -> list[float]:
    """Values of the parameter that are hit exactly, of a path from `start`."""
    if at is not None:
        values = _listed(item, at)
        if values[0] == start:
            values = values[1:]  # it is recorded anyway
        if not len(values):
            raise InputError(item, f"at = {list(at)!r} is where the path starts")
        change = np.diff(np.concatenate([[start], values]))
        if not ((change > 0).all() or (change < 0).all()):
            raise InputError(
                item, f"at = {values.tolist()} does not lead one way from the start at {start:g}"
            )
        return [float(v) for v in values]
    if until == start:
        raise InputError(item, f"until = {until!r} is where the path starts")
    count = 1 if steps is None else steps
    return [start + (until - start) * (k / count) for k in range(1, count)] + [until]


def _listed(item: str, at: Sequence[float]) -> Floats:
    """Values of the parameter to hit."""
    values = numbers(item, "at", at)
    plain = np.asarray(at).dtype.kind in "iufO"  # no text that reads as numbers
    if not plain or values.ndim != 1 or not len(values) or not np.isfinite(values).all():
        raise InputError(item, f"at = {at!r}, expected a list of numbers")
    return values


def _turned(item: str, turn: float | None) -> float | None:
    """A rotation that limits steps, or none."""
    return None if turn is None else positive(item, "turn", turn, " of rad")


def _shown(item: object, **values: object) -> str:
    """Arguments of an object as in a call, without those that have their default."""
    parameters = signature(type(item)).parameters
    return ", ".join(f"{k}={v!r}" for k, v in values.items() if v != parameters[k].default)


def _whole(item: str, name: str, value: int) -> None:
    """Check a positive integer."""
    if whole(item, value, 1, name) > MOST:
        raise InputError(item, f"{name} = {cut(value)}, expected at most {MOST:.0e}")


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

    def gained(self, before: Point, after: Point, length: float) -> float:
        """Growth of the parameter in a step to a point."""
        return length

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
        Largest rotation (rad) of a node in a step; a step that turns more is repeated shorter.
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
    ) -> None:
        item = type(self).__name__
        if steps is not None:
            _whole(item, "steps", steps)
        if at is None:
            self.until, self.at = finite(item, "until", until), None
        else:
            for name, value in {"until": until, "steps": steps}.items():
                if value is not None:
                    both = f"{name} = {value!r} and at = {at!r}"
                    raise InputError(item, f"{both}, expected one of them")
            self.at = tuple(_listed(item, at).tolist())
            self.until = self.at[-1]
        self.longest = positive(item, "longest", longest)
        self.first = min(positive(item, "first", first), self.longest)
        turn = _turned(item, turn)
        self.steps, self.turn = steps, turn if steps is None else None
        self.all_points = steps is None and at is None

    def _given(self) -> str:
        ends = {"until": self.until} if self.at is None else {"at": list(self.at)}
        steps = {"turn": self.turn} if self.steps is None else {"steps": self.steps}
        return _shown(self, **ends, **steps, first=self.first, longest=self.longest)


class _SteeredStage(Stage):
    """Steps of a parameter: of what has this gradient (rows, 3), or of the load factor."""

    def __init__(self, control: _Steered, start: float, gradient: Floats | None = None) -> None:
        steps, self._gradient, self.parameter = control.steps, gradient, start
        self.stops = _ends(type(control).__name__, control.until, steps, control.at, start)
        way = self.stops[-1] - start
        self.fixed = steps is not None
        self.length = way if self.fixed else control.first * way
        self.longest = abs(way) * (1.0 if self.fixed else control.longest)
        self.shortest = 1e-7 * abs(way)

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
    LoadControl(until=60.0)
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
    ) -> None:
        until = 1.0 if until is None and at is None else until
        super().__init__(until, steps, at, first, longest, turn)

    def __repr__(self) -> str:
        return f"LoadControl({self._given()})"

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
    ) -> None:
        item = type(self).__name__
        if not isinstance(place, Place) or place.item is None:
            raise InputError(item, f"place = {place!r}, expected the place of an item")
        n = vector(item, "direction", direction)
        if not np.linalg.norm(n) > 0:
            raise InputError(item, f"direction = {direction!r} has no length")
        super().__init__(until, steps, at, first, longest, turn)
        self.place, self.direction = place, n / np.linalg.norm(n)

    def __repr__(self) -> str:
        way = tuple(self.direction.tolist())
        return f"DisplacementControl(<{self.place.label}>, {way}, {self._given()})"

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
    """Pseudo arc length: the next point lies in a plane normal to the last secant."""

    def __init__(
        self, system: System, control: ArcLength, direction: Floats | None, sign: float
    ) -> None:
        self._weights, self._control = weights(system), control
        self._secant, self._sign = direction, sign
        self.parameter, self.stops, self._count = 0.0, [], 0
        self.crossed = False
        self.length, self.longest = control.length, control.longest
        # steps of a path without a direction are of the load factor until something moves
        self._by_load, self._branches = direction is None, direction is not None
        self._regular = False
        if self._by_load:
            self.length = control.first
        self.shortest = 1e-7 * self.length

    def functional(self, point: Point, length: float) -> Functional:
        if self._secant is None:
            return Functional(None, 1.0, self._sign * length)
        unit = self._secant / float(np.sqrt((self._weights * self._secant**2).sum()))
        # at the start of a branch the tangent leads along the path it leaves
        predictor = length * unit if self._branches and self._count == 0 else None
        return Functional(self._weights * unit, 0.0, length, predictor)

    def _motion(self, before: Point, after: Point) -> tuple[Floats, float]:
        change = after.y[: len(self._weights)] - before.y[: len(self._weights)]
        return change, float(np.sqrt((self._weights * change**2).sum()))

    def aim(self, rate: Floats) -> None:
        # not by a step of the load factor: next to a limit point it may lead to another branch
        size = float(np.sqrt((self._weights * rate**2).sum()))
        if self._by_load and size > STILL:
            self._by_load = False
            self._secant = self._sign * rate
            # nor far: the tangent may be that of a path about to turn
            self.length = min(self.length * size, self._control.length, self.longest)
            self.shortest = 1e-7 * self.length

    def gained(self, before: Point, after: Point, length: float) -> float:
        moved = self._motion(before, after)[1]
        # rigid so far: the load factor
        return moved if moved > STILL or not self._by_load else abs(after.t - before.t)

    def accept(self, before: Point, after: Point, length: float) -> bool:
        change, moved = self._motion(before, after)
        self._regular = not self._by_load and self._count > 0
        if moved > STILL or not self._by_load:
            self._secant = change
        moved = self.gained(before, after, length)
        if self._by_load and self._secant is not None:
            self._by_load = False
            self.length, self.shortest = moved, 1e-7 * moved
        self.parameter += moved
        self._count += 1
        until = self._control.until
        if until is not None:
            self.crossed = before.t != until and (before.t - until) * (after.t - until) <= 0
        return True

    def adapt(self, iterations: int, length: float) -> None:
        if self._regular:
            super().adapt(iterations, length)

    def finished(self, point: Point) -> bool:
        return self.crossed or self._count >= self._control.points


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
    ) -> None:
        item = "ArcLength"
        self.until = None if until is None else finite(item, "until", until)
        self.turn = _turned(item, turn)
        _whole(item, "points", points)
        number = finite(item, "first", first, "a number that is not zero")
        if number == 0:
            raise InputError(item, f"first = {first!r}, expected a number that is not zero")
        self.sign, self.first = float(np.sign(number)), abs(number)
        self.length = positive(item, "length", length)
        self.longest = positive(item, "longest", longest)
        self.points = int(points)

    def __repr__(self) -> str:
        given = {"points": self.points, "until": self.until, "first": self.sign * self.first}
        sizes = {"length": self.length, "longest": self.longest, "turn": self.turn}
        return f"ArcLength({_shown(self, **given, **sizes)})"

    def stage(self, system: System, point: Point, direction: Floats | None = None) -> Stage:
        """Start at a point; `direction` (rows, 3): of the first step, on a branch."""
        return _ArcStage(system, self, direction, self.sign)
