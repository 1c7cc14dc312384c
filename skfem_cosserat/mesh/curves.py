"""Space curves parametrised by arc length: the geometry a beam's axis lies on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np

from ..element import gauss_rule
from ..errors import InputError, MeshError
from ..frozen import Frozen
from ..types import SAME, ArrayLike, Floats, VectorLike, finite, numbers, shaped, shown, switch

#: Gauss rule used to measure splines, on [0, 1].
_GAUSS_X, _GAUSS_W = gauss_rule(16)


@runtime_checkable
class Curve(Protocol):
    """Protocol of curves: any object with these three members can carry a beam."""

    @property
    def length(self) -> float:
        """Arc length (m)."""

    def point(self, s: ArrayLike) -> Floats:
        """Points (3, ...) at arc lengths s (...)."""

    def tangent(self, s: ArrayLike) -> Floats:
        """Unit tangents (3, ...) at arc lengths s (...)."""


def vector(value: VectorLike, item: str) -> Floats:
    """Three finite numbers, or a MeshError naming the item."""
    try:
        return shaped(item, "value", value, (3,))
    except InputError as error:
        raise MeshError(item, f"got {shown(value)}, expected three finite numbers") from error


def _unit(value: VectorLike, item: str) -> Floats:
    """Direction of a vector that must not vanish."""
    found = vector(value, item)
    size = float(np.linalg.norm(found))
    if size == 0.0:
        raise MeshError(item, "got the zero vector, expected a direction")
    return found / size


def _normal_to(value: VectorLike, unit: Floats, item: str) -> Floats:
    """Unit vector along the part of a vector that is normal to a unit vector."""
    found = _unit(value, item)
    for _ in range(2):
        part = found - (found @ unit) * unit
        size = float(np.linalg.norm(part))
        if size < 1e-8:
            raise MeshError(item, f"{value} is parallel to {unit.tolist()}, give another direction")
        found = part / size
    return found


def _positive(value: float, item: str) -> float:
    """A finite positive number."""
    return _number(value, item, "a positive number", np.nextafter(0.0, 1.0))


def _number(value: float, item: str, expected: str, least: float = -np.inf) -> float:
    """A finite number; text and truth values are none."""
    try:
        return finite(item, "value", value, expected, least)
    except InputError as error:
        raise MeshError(item, f"got {shown(value)}, expected {expected}") from error


class CurveLine(Frozen):
    """Straight line.

    Parameters
    ----------
    start, end : (3,)
        End points (m).

    Raises
    ------
    MeshError
        If the ends coincide or are not finite.

    Examples
    --------
    >>> line = CurveLine((0, 0, 0), (0, 2, 0))
    >>> line.length, line.point(0.5).tolist()
    (2.0, [0.0, 0.5, 0.0])
    """

    def __init__(self, start: VectorLike, end: VectorLike):
        self.start = vector(start, "line start")
        self.end = vector(end, "line end")
        self.length = float(np.linalg.norm(self.end - self.start))
        if self.length == 0.0:
            raise MeshError("line", f"start and end are the same point {self.start.tolist()}")

    def point(self, s: ArrayLike) -> Floats:
        """Points (3, ...) at arc lengths s (...), in m."""
        w = np.asarray(s, float) / self.length
        return np.multiply.outer(self.start, 1.0 - w) + np.multiply.outer(self.end, w)

    def tangent(self, s: ArrayLike) -> Floats:
        """Unit tangents (3, ...) at arc lengths s (...)."""
        return np.multiply.outer((self.end - self.start) / self.length, np.ones(np.shape(s)))


class _Winding(Frozen):
    """Curve around an axis, of constant radius and rise."""

    radius: float
    start: Floats

    def _wind(self, radial: Floats, around: Floats, axis: Floats, rise: float) -> None:
        """Set the unit vectors from the axis to the first point, around it and along it."""
        self._frame = (radial, around, axis)
        self._rise = rise
        self._reach = float(np.hypot(self.radius, rise))  # for a turn of one rad

    def point(self, s: ArrayLike) -> Floats:
        """Points (3, ...) at arc lengths s (...), in m."""
        turn = np.asarray(s, float) / self._reach
        radial, around, axis = self._frame
        along = np.multiply.outer(around, self.radius * np.sin(turn))
        inward = np.multiply.outer(radial, -2.0 * self.radius * np.sin(0.5 * turn) ** 2)
        start = self.start.reshape((3,) + (1,) * turn.ndim)
        return start + along + inward + np.multiply.outer(axis, self._rise * turn)

    def tangent(self, s: ArrayLike) -> Floats:
        """Unit tangents (3, ...) at arc lengths s (...)."""
        turn = np.asarray(s, float) / self._reach
        radial, around, axis = self._frame
        speed = self.radius / self._reach
        rise = np.full(turn.shape, self._rise / self._reach)
        return (
            np.multiply.outer(around, speed * np.cos(turn))
            + np.multiply.outer(radial, -speed * np.sin(turn))
            + np.multiply.outer(axis, rise)
        )


class CurveArc(_Winding):
    """Circular arc that leaves a point in a given direction.

    Parameters
    ----------
    start : (3,)
        First point (m).
    tangent : (3,)
        Direction in which the arc leaves it (any length).
    normal : (3,)
        Direction from the first point to the centre (any length; made normal to the tangent).
    radius : float
        Radius (m).
    angle : float
        Angle swept (rad), positive; ``2*pi`` is the full circle.

    Raises
    ------
    MeshError
        If a number is not positive or the normal is parallel to the tangent.

    Examples
    --------
    >>> import numpy as np
    >>> arc = CurveArc((0, 0, 0), (1, 0, 0), (0, 1, 0), radius=2.0, angle=np.pi / 2)
    >>> bool(np.isclose(arc.length, np.pi)), arc.point(arc.length).round(12).tolist()
    (True, [2.0, 2.0, 0.0])
    """

    def __init__(
        self,
        start: VectorLike,
        tangent: VectorLike,
        normal: VectorLike,
        radius: float,
        angle: float,
    ):
        self.direction = _unit(tangent, "arc tangent")
        self.start = vector(start, "arc start")
        self.normal = _normal_to(normal, self.direction, "arc normal")
        self.radius = _positive(radius, "arc radius")
        self.angle = _positive(angle, "arc angle")
        self.length = float(radius * angle)
        self._wind(-self.normal, self.direction, np.zeros(3), 0.0)
        if angle > 2 * np.pi * (1 + SAME):
            raise MeshError("arc angle", f"got {angle} rad, expected at most 2 pi")

    @property
    def centre(self) -> Floats:
        """Centre of the circle (3,), in m."""
        return self.start + self.radius * self.normal


class CurveHelix(_Winding):
    """Helix around an axis.

    Parameters
    ----------
    start : (3,)
        First point (m).
    centre : (3,)
        Any point of the axis (m).
    axis : (3,)
        Direction of the axis (any length).
    pitch : float
        Advance along the axis in one turn (m); negative for a left-handed helix.
    turns : float
        Number of turns, positive.

    Raises
    ------
    MeshError
        If the first point lies on the axis or a number is out of range.

    Examples
    --------
    >>> helix = CurveHelix((1, 0, 0), (0, 0, 0), (0, 0, 1), pitch=0.5, turns=2)
    >>> np.allclose(helix.point(helix.length), (1, 0, 1))
    True
    """

    def __init__(
        self,
        start: VectorLike,
        centre: VectorLike,
        axis: VectorLike,
        pitch: float,
        turns: float,
    ):
        self.start = vector(start, "helix start")
        self.axis = _unit(axis, "helix axis")
        self.centre = vector(centre, "helix centre")
        self.pitch = pitch
        self.turns = turns
        arm = self.start - self.centre
        arm = arm - (arm @ self.axis) * self.axis
        self.radius = float(np.linalg.norm(arm))
        if self.radius == 0.0:
            raise MeshError("helix start", f"{self.start.tolist()} lies on the axis")
        rise = abs(_number(pitch, "helix pitch", "a finite number")) / (2 * np.pi)
        turn = 2 * np.pi * _positive(turns, "helix turns")
        radial = arm / self.radius
        hand = -1.0 if pitch < 0 else 1.0  # a left-handed helix still climbs its axis
        self._wind(radial, hand * np.cross(self.axis, radial), self.axis, rise)
        self.length = float(turn * self._reach)


@dataclass(frozen=True, eq=False, repr=False)
class CurveMoved(Frozen):
    """A curve moved as a rigid body and scaled: ``x -> scale * rotation @ x + shift``.

    Parameters
    ----------
    curve : Curve
        The curve to move.
    rotation : (3, 3)
        Orthogonal matrix (a reflection is allowed).
    shift : (3,)
        Translation (m).
    scale : float
        Factor of all lengths.

    Examples
    --------
    >>> moved = CurveMoved(CurveLine((0, 0, 0), (1, 0, 0)), np.eye(3), np.array([0.0, 0.0, 3.0]))
    >>> moved.point(1.0).tolist()
    [1.0, 0.0, 3.0]
    """

    curve: Curve
    rotation: Floats
    shift: Floats
    scale: float = 1.0

    @property
    def length(self) -> float:
        """Arc length (m)."""
        return self.scale * self.curve.length

    def point(self, s: ArrayLike) -> Floats:
        """Points (3, ...) at arc lengths s (...), in m."""
        shift = np.asarray(self.shift).reshape((3,) + (1,) * np.ndim(s))
        own = self.curve.point(np.asarray(s) / self.scale)
        return np.tensordot(self.scale * self.rotation, own, 1) + shift

    def tangent(self, s: ArrayLike) -> Floats:
        """Unit tangents (3, ...) at arc lengths s (...)."""
        return np.tensordot(self.rotation, self.curve.tangent(np.asarray(s) / self.scale), 1)


class CurveSpline(Frozen):
    """Smooth curve through points: a cubic spline measured by its own arc length.

    The spline's parameter is the chord length (not-a-knot ends, periodic if closed). Its arc
    length is integrated by Gauss rules that are refined until it no longer changes.

    Parameters
    ----------
    points : (n, 3)
        Points in order (m), at least 2, for a closed curve at least 3 (the first one is not
        repeated).
    closed : bool
        If the curve returns to its first point.

    Attributes
    ----------
    length : float
        Arc length (m).
    knots : (n,) or (n + 1,)
        Arc lengths at which the given points are met; a closed curve ends with ``length``.

    Raises
    ------
    MeshError
        For fewer points, repeated neighbours or numbers that are not finite.

    Examples
    --------
    >>> spline = CurveSpline([(0, 0, 0), (1, 0, 0), (3, 0, 0)])
    >>> round(spline.length, 12), spline.point(2.0).round(12).tolist()
    (3.0, [2.0, 0.0, 0.0])
    """

    def __init__(self, points: Any, closed: bool = False):
        from scipy.interpolate import CubicSpline  # slow to import, seldom needed

        self.closed = switch("spline", closed, "closed")
        self.points = points = numbers("spline", "points", points)
        if points.ndim != 2 or points.shape[1] != 3 or len(points) < 2 + closed:
            raise MeshError(
                "spline points", f"got shape {points.shape}, expected ({2 + closed} or more, 3)"
            )
        if not np.isfinite(points).all():
            row = np.argmin(np.isfinite(points).all(1))
            raise MeshError("spline points", f"point {row} is {points[row].tolist()}: not finite")
        path = np.vstack([points, points[:1]]) if closed else points
        chords = np.linalg.norm(np.diff(path, axis=0), axis=1)
        if (chords == 0).any():
            row = np.argmax(chords == 0)
            raise MeshError("spline points", f"points {row} and {row + 1} are the same")
        u = np.concatenate([[0.0], np.cumsum(chords)])
        self._spline = CubicSpline(u, path, bc_type="periodic" if closed else "not-a-knot")
        self._rate = self._spline.derivative()
        self._measure(u)

    def _measure(self, u: Floats) -> None:
        """Tabulate the arc length, on intervals halved until it no longer changes."""
        grid = u
        arcs = self._arc(u[:-1], u[1:])
        pieces = 1
        while pieces < 256:
            finer = np.concatenate(
                [np.stack([grid[:-1], 0.5 * (grid[:-1] + grid[1:])], 1).ravel(), u[-1:]]
            )
            halves = self._arc(finer[:-1], finer[1:])
            change = abs(halves.reshape(-1, 2).sum(1) - arcs).max()
            grid, arcs, pieces = finer, halves, 2 * pieces
            if change <= 1e-15 * halves.sum():
                break
        s = np.concatenate([[0.0], arcs.cumsum()])
        self._table = grid, s
        self.knots = s[::pieces].copy()
        self.length = float(s[-1])

    def _arc(self, a: Floats, b: Floats) -> Floats:
        """Arc lengths (...) between parameters a and b (...)."""
        nodes = a[..., None] + (b - a)[..., None] * _GAUSS_X
        return (b - a) * (np.linalg.norm(self._rate(nodes), axis=-1) @ _GAUSS_W)

    def _parameter(self, s: ArrayLike) -> Floats:
        """Spline parameters (...) at arc lengths s (...), by Newton's method."""
        s = np.asarray(s, float)
        grid, arcs = self._table
        k = (np.searchsorted(arcs, s, side="right") - 1).clip(0, len(grid) - 2)
        u = grid[k] + (grid[k + 1] - grid[k]) * (s - arcs[k]) / (arcs[k + 1] - arcs[k])
        for _ in range(20):
            step = (s - arcs[k] - self._arc(grid[k], u)) / np.linalg.norm(self._rate(u), axis=-1)
            u = u + step
            if abs(step).max(initial=0.0) <= 1e-15 * grid[-1]:
                break
        return u

    def point(self, s: ArrayLike) -> Floats:
        """Points (3, ...) at arc lengths s (...), in m."""
        return np.moveaxis(self._spline(self._parameter(s)), -1, 0)

    def tangent(self, s: ArrayLike) -> Floats:
        """Unit tangents (3, ...) at arc lengths s (...)."""
        rate = np.moveaxis(self._rate(self._parameter(s)), -1, 0)
        return rate / np.linalg.norm(rate, axis=0)
