"""Joints: what they hold, what they leave free, and their rows."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from .errors import InputError
from .frames import Item, Motion, Place, StructuralItem, check_sides, unit_vector
from .frozen import Frozen
from .relative import (
    ORIGIN,
    Amplitude,
    Expression,
    Form,
    Product,
    RelativeCoordinate,
    Zero,
    angle,
    axes,
    direction,
    displacement,
    normals,
    point,
    rotation,
)
from .time_function import FunctionOfTime
from .types import TOLERANCE, ArrayLike, Floats, positive

# -- what a joint is: constraint rows, the motion it leaves free, its relative coordinates ---------
#
# Every joint is written twice, once for each treatment of the constraints: as constraint rows
# (multipliers) and as the relative motions it leaves free (null space). Rows are quadratic, so that
# the midpoint Jacobian is their exact discrete derivative.


@dataclass(frozen=True, eq=False, repr=False)
class Turn(Frozen):
    """Rotation about an axis fixed in one side ("a" or "b"), given in space in the reference."""

    name: str
    axis: Floats
    side: str = "a"


@dataclass(frozen=True, eq=False, repr=False)
class Slide(Frozen):
    """Translation along ``left x right``, both fixed in side a, given in space in the reference.

    As a cross product of directors, not as a director: only so it stays admissible at midpoints.
    """

    name: str
    left: Floats
    right: Floats


@dataclass(frozen=True, eq=False, repr=False)
class Freedom(Frozen):
    """Relative motions that a joint leaves free between its sides, for the null space.

    Attributes
    ----------
    turns : tuple of Turn, or None
        Rotations from side a to side b in this order; None: any rotation.
    slides : tuple of Slide
        Translations of ``x_b - x_a``.
    sphere : bool
        The point of one side moves on a sphere about that of the other (distance joint).
    """

    turns: tuple[Turn, ...] | None
    slides: tuple[Slide, ...] = ()
    sphere: bool = False

    def within(self, normal: Floats) -> Freedom:
        """Freedom that is left where everything moves only in the plane with this unit normal.

        Turns about the normal, and the slides in the plane; two slides that leave it both are one
        along the line in which their plane meets it.
        """
        turns = self.turns
        if turns is not None:
            turns = tuple(turn for turn in turns if abs(turn.axis @ normal) > 0.5)
        out = np.array([np.cross(s.left, s.right) @ normal for s in self.slides])
        slides = tuple(s for s, rise in zip(self.slides, out, strict=True) if abs(rise) < TOLERANCE)
        if len(self.slides) == 2 and not slides:  # both have the same left vector
            first, second = self.slides
            right = (out[1] * first.right - out[0] * second.right) / np.linalg.norm(out)
            slides = (Slide(first.name, first.left, right),)
        return Freedom(turns, slides, self.sphere)


class Joint(Item):
    """Connection of two places; see the subclasses.

    An own joint derives from it and writes :meth:`rows`, its constraint equations, and
    :meth:`freedom`, the relative motions that it leaves free; :meth:`gap` if it does not hold
    ``x_b - x_a`` as a whole.

    Parameters
    ----------
    a, b : Place
        ``beam.node("tip")``, ``body.at(x)``, ``point.place()``, ``ground(x)``; at least one side
        belongs to an item.
    """

    kind = "joint"
    type = "general"
    #: which sides must have a triad
    framed_sides: tuple[str, ...] = ("a", "b")

    def __init__(self, a: Place, b: Place):
        check_sides(self.label, a, b, self.framed_sides, "a spherical or a distance joint")
        self.a = a
        self.b = b

    @property
    def label(self) -> str:
        """Name in messages: its type and kind, and its name in the model."""
        text = f"{self.type} {self.kind}"
        return text if self.name is None else f"{text} {self.name!r}"

    def references(self) -> list[StructuralItem]:
        """The items of both sides."""
        return [place.item for place in (self.a, self.b) if place.item is not None]

    def gap(self, r: Floats) -> Floats:
        """Part of ``x_b - x_a`` that must vanish in the reference configuration."""
        return r

    def check(self, t: float, length: float) -> None:
        """Raise InputError if it does not close in the reference configuration at time `t`.

        `length` (m) is the extent of the scene, against which a gap is measured.
        """
        x_a = self.a.at(t)
        x_b = self.b.at(t)
        rest = self.gap(x_b - x_a)
        gap = float(np.linalg.norm(rest))
        # coordinates far from the origin are known to their own rounding only
        if gap > TOLERANCE * length + 1e-15 * (abs(x_a).max() + abs(x_b).max()):
            raise InputError(
                self.label,
                f"does not close in the reference configuration at t = {t:g} s: {self.a.label} and"
                f" {self.b.label} are {gap:.6g} m apart, x_b - x_a = {rest.tolist()}"
                + ("" if rest is None or np.allclose(rest, x_b - x_a) else " where it is held"),
            )
        for side, place in (("a", self.a), ("b", self.b)):
            if side in self.framed_sides and place.motion is not None:
                turn = float(abs(place.motion.frame(place, t)[1:] - np.eye(3)).max())
                if turn > TOLERANCE:
                    raise InputError(
                        self.label,
                        f"prescribed rotation is not zero at t = {t:g} s (by {turn:.6g}),"
                        " which contradicts the initial state",
                    )

    def rows(self) -> list[Zero | Product]:
        """Its constraints."""
        raise NotImplementedError

    def branch_cosines(self) -> list[Product]:
        """Cosines that are 1 in all that its freedom allows, and -1 half a turn off it.

        Rows of products of directors also hold there, or in a weld after a third of a turn.
        """
        turns = self.freedom().turns
        if turns is None or len(turns) > 1 or self.a.triad is None or self.b.triad is None:
            return []
        return [self._same(axis) for axis in ([turn.axis for turn in turns] or np.eye(3))]

    def freedom(self) -> Freedom:
        """Its free relative motions."""
        raise NotImplementedError

    def coordinates(self) -> tuple[RelativeCoordinate, ...]:
        """Its relative coordinates, zero in the reference configuration, from side a to side b.

        Angles (rad), displacements (m) or a rotation vector (rad); what springs, dampers and
        drives act on and what the history records as ``joint/NAME/COORDINATE``.
        """
        free = self.freedom()
        if free.sphere:  # a spring on a rod would mean its length, which is fixed
            return ()
        sliding = [
            displacement(s.name, self.a, self.b, np.cross(s.left, s.right)) for s in free.slides
        ]
        if free.turns is None:
            framed = self.a.triad is not None and self.b.triad is not None
            return (*sliding, rotation("rotation", self.a, self.b)) if framed else tuple(sliding)
        return (*sliding, *[angle(t.name, self.a, self.b, t.axis, t.side) for t in free.turns])

    def coordinate(self, name: str | None = None) -> RelativeCoordinate:
        """One of :meth:`coordinates`; without a name the only one.

        Raises
        ------
        InputError
            If there is none of this name, or several and no name is given.

        Examples
        --------
        >>> from skfem_cosserat import JointCylindrical, RigidBody, ground
        >>> body = RigidBody.box(1.0, (1, 1, 1))
        >>> joint = JointCylindrical(ground((0, 0, 0)), body.at((0, 0, 0)), axis=(1, 0, 0))
        >>> [c.name for c in joint.coordinates()], joint.coordinate("angle").kind
        (['displacement', 'angle'], 'angle')
        """
        if name is not None and not isinstance(name, str):
            raise InputError(self.label, f"coordinate = {name!r}, expected the name of one")
        known = {c.name: c for c in self.coordinates()}
        if name is None and len(known) == 1:
            return next(iter(known.values()))
        if name is None or name not in known:
            what = "which of its coordinates? it has" if name is None else f"no {name!r}; it has"
            raise InputError(self.label, f"{what} {sorted(known) or 'none'}")
        return known[name]

    @property
    def size(self) -> int:
        """Number of constraint rows."""
        return sum(row.size for row in self.rows())

    def _coincide(self) -> Zero:
        return Zero(point(self.b) - point(self.a))

    def _normal(self, axis: Floats) -> list[Product]:
        """``n^A . m_k^B = 0``: both sides keep the axis in common."""
        n = direction(self.a, axis)
        return [Product(n, direction(self.b, m)) for m in normals(axis)]

    def _same(self, axis: Floats) -> Product:
        """``n^A . n^B``."""
        return Product(direction(self.a, axis), direction(self.b, axis))

    def _on_line(self, axis: Floats) -> list[Product]:
        """``m_k^A . (x_b - x_a) = 0``."""
        r = point(self.b) - point(self.a)
        return [Product(direction(self.a, m), r) for m in normals(axis)]


class AxialJoint(Joint):
    """Joint with one axis n, fixed in side a and a unit vector in space in the reference."""

    def __init__(self, a: Place, b: Place, axis: ArrayLike):
        super().__init__(a, b)
        self.axis = unit_vector(self.label, "axis", axis)


# -- joints whose points move against each other: slides, planes, lines, rods ----------------------


class _OnLine(AxialJoint):
    """x_b on the line through x_a along the axis."""

    def gap(self, r: Floats) -> Floats:
        """Distance from the line."""
        return r - (r @ self.axis) * self.axis


class JointCylindrical(_OnLine):
    """Rotation about and translation along one axis: 4 constraints.

    ``m_k^A . (x_b - x_a) = 0`` and ``n^A . m_k^B = 0``, k = 1, 2. Relative coordinates:
    "displacement" (m) along n and "angle" (rad) about it.

    Parameters
    ----------
    a, b : Place
        Both on the axis in the reference configuration.
    axis : (3,) array
        Unit vector of the axis n, in space in the reference configuration.

    Examples
    --------
    >>> from skfem_cosserat import RigidBody, ground
    >>> body = RigidBody.box(1.0, (1, 1, 1))
    >>> JointCylindrical(ground((0, 0, 0)), body.at((0, 0, 0)), axis=(1, 0, 0)).size
    4
    """

    type = "cylindrical"

    def rows(self) -> list[Zero | Product]:
        """x_b on the line through x_a, and the axis in common."""
        return [*self._on_line(self.axis), *self._normal(self.axis)]

    def freedom(self) -> Freedom:
        """Rotation about n, translation along it."""
        return Freedom((Turn("angle", self.axis),), (_along(self.axis),))


class JointPrismatic(_OnLine):
    """Translation along one axis without rotation: 5 constraints.

    Those of the cylindrical joint and ``m_1^A . m_2^B = 0``. Relative coordinate:
    "displacement" (m) along n.

    Parameters
    ----------
    a, b : Place
        Both on the axis in the reference configuration.
    axis : (3,) array
        Unit vector of the axis n, in space in the reference configuration.

    Examples
    --------
    >>> from skfem_cosserat import RigidBody, ground
    >>> body = RigidBody.box(1.0, (1, 1, 1))
    >>> JointPrismatic(ground((0, 0, 0)), body.at((0, 0, 0)), axis=(1, 0, 0)).size
    5
    """

    type = "prismatic"

    def rows(self) -> list[Zero | Product]:
        """Cylindrical, and no rotation about the axis."""
        first, second = normals(self.axis)
        locked = Product(direction(self.a, first), direction(self.b, second))
        return [*self._on_line(self.axis), *self._normal(self.axis), locked]

    def freedom(self) -> Freedom:
        """Translation along n."""
        return Freedom((), (_along(self.axis),))


class JointPlanar(Joint):
    """x_b moves in a plane of side a, both keep its normal in common: 3 constraints.

    ``n^A . (x_b - x_a) = 0`` and ``n^A . m_k^B = 0``, k = 1, 2. Relative coordinates: "angle" (rad)
    about n, and with `x` also "x" and "y" (m) in the plane.

    Parameters
    ----------
    a, b : Place
        Both in the plane in the reference configuration.
    normal : (3,) array
        Unit vector n, in space in the reference configuration.
    x : (3,) array, optional
        Unit vector of the coordinate x in the plane; y is ``n x x``. Without it the joint is the
        same, but has no coordinates x and y: nothing says along which directions.

    Examples
    --------
    >>> from skfem_cosserat import RigidBody, ground
    >>> places = ground((0, 0, 0)), RigidBody.box(1.0, (1, 1, 1)).at((0.5, 0, 0))
    >>> JointPlanar(*places, normal=(0, 0, 1)).size
    3
    >>> [c.name for c in JointPlanar(*places, normal=(0, 0, 1), x=(1, 0, 0)).coordinates()]
    ['x', 'y', 'angle']
    """

    type = "planar"

    def __init__(self, a: Place, b: Place, normal: ArrayLike, x: ArrayLike | None = None):
        super().__init__(a, b)
        self.normal = unit_vector(self.label, "normal", normal)
        #: whether x was given: else it is any direction in the plane, which must not show
        self.directed = x is not None
        if x is None:
            self.x = normals(self.normal)[0]
            return
        self.x = unit_vector(self.label, "x", x)
        slope = float(self.x @ self.normal)
        if abs(slope) > TOLERANCE:
            raise InputError(
                self.label,
                f"x = {self.x.tolist()} is not normal to the normal {self.normal.tolist()}:"
                f" x . n = {slope:.6g}",
            )

    def gap(self, r: Floats) -> Floats:
        """Distance from the plane."""
        return (r @ self.normal) * self.normal

    def rows(self) -> list[Zero | Product]:
        """x_b in the plane, and the normal in common."""
        r = point(self.b) - point(self.a)
        return [Product(direction(self.a, self.normal), r), *self._normal(self.normal)]

    def freedom(self) -> Freedom:
        """Rotation about n, translations ``n x m_k``."""
        y = np.cross(self.normal, self.x)
        slides = (Slide("x", self.normal, -y), Slide("y", self.normal, self.x))
        return Freedom((Turn("angle", self.normal),), slides)

    def coordinates(self) -> tuple[RelativeCoordinate, ...]:
        """Displacements x, y and the angle; the angle only if the joint has no direction `x`."""
        found = super().coordinates()
        return found if self.directed else tuple(c for c in found if c.kind == "angle")

    def coordinate(self, name: str | None = None) -> RelativeCoordinate:
        """One of :meth:`coordinates`; an error for x and y if the joint has no direction `x`."""
        if name in ("x", "y") and not self.directed:
            raise InputError(
                self.label,
                f"no coordinate {name!r}: nothing says along which directions of its plane, give"
                " the joint one: JointPlanar(a, b, normal, x=...)",
            )
        return super().coordinate(name)


class JointPointOnLine(_OnLine):
    """The point of side b moves on a line of side a, free to rotate: 2 constraints.

    ``m_k^A . (x_b - x_a) = 0``, k = 1, 2. Side b may be a mass point (a bead on a wire).
    Relative coordinates: "displacement" (m) along the line and, between frames, the rotation
    vector "rotation" (rad).

    Parameters
    ----------
    a, b : Place
        x_b on the line in the reference configuration.
    axis : (3,) array
        Unit vector along the line through x_a, in space in the reference configuration.

    Examples
    --------
    >>> from skfem_cosserat import MassPoint, ground
    >>> bead = MassPoint(1.0, position=(0.5, 0, 0))
    >>> JointPointOnLine(ground((0, 0, 0)), bead.place(), axis=(1, 0, 0)).size
    2
    """

    type = "point-on-line"
    framed_sides = ("a",)

    def rows(self) -> list[Zero | Product]:
        """x_b on the line."""
        return list(self._on_line(self.axis))

    def freedom(self) -> Freedom:
        """Any rotation, translation along the line."""
        return Freedom(None, (_along(self.axis),))


class JointDistance(Joint):
    """Massless rod between two points: 1 constraint, ``(|x_b - x_a|^2 - L^2)/2 = 0``.

    Parameters
    ----------
    a, b : Place
    length : float, optional
        Must be the distance in the reference configuration (m), which is the default.

    Examples
    --------
    >>> from skfem_cosserat import MassPoint, ground
    >>> JointDistance(ground((0, 0, 0)), MassPoint(1.0, (0, 0, -1)).place(), length=1.0).size
    1
    """

    type = "distance"
    framed_sides = ()

    def __init__(self, a: Place, b: Place, length: float | None = None):
        super().__init__(a, b)
        span = float(np.linalg.norm(b.position - a.position))
        self.length = positive(self.label, "length", span if length is None else length)

    def gap(self, r: Floats) -> Floats:
        """None: :meth:`check` compares lengths."""
        return np.zeros(3)

    def check(self, t: float, length: float) -> None:
        """Raise InputError if the distance between the points is not the joint's length."""
        super().check(t, length)
        distance = float(np.linalg.norm(self.b.at(t) - self.a.at(t)))
        if abs(distance - self.length) > TOLERANCE * self.length:
            raise InputError(
                self.label,
                f"does not close in the reference configuration: length = {self.length:.9g} m but"
                f" the points are {distance:.9g} m apart, off by {distance - self.length:.6g} m",
            )

    def rows(self) -> list[Zero | Product]:
        """Half the square of the distance."""
        r = point(self.b) - point(self.a)
        return [Product(r, r, 0.5)]

    def freedom(self) -> Freedom:
        """Any rotation, and a point on a sphere."""
        return Freedom(None, sphere=True)


def _along(axis: Floats) -> Slide:
    return Slide("displacement", *normals(axis))


# -- joints whose points coincide: spherical, revolute, universal, fixed ---------------------------


class JointSpherical(Joint):
    """Both points coincide: 3 constraints, ``x_b - x_a = 0``. Also holds mass points.

    Its relative coordinate "rotation" is the rotation vector (rad), below a turn of pi.

    Examples
    --------
    >>> from skfem_cosserat import MassPoint, ground
    >>> JointSpherical(ground((0, 0, 0)), MassPoint(1.0).place()).size
    3
    """

    type = "spherical"
    framed_sides = ()

    def rows(self) -> list[Zero | Product]:
        """``x_b - x_a = 0``."""
        return [self._coincide()]

    def freedom(self) -> Freedom:
        """Any rotation."""
        return Freedom(None)


class JointRevolute(AxialJoint):
    """Hinge: 5 constraints, ``x_b - x_a = 0`` and ``n^A . m_k^B = 0``, k = 1, 2.

    Relative coordinate: "angle" (rad), from a to b about n.

    Parameters
    ----------
    a, b : Place
    axis : (3,) array
        Unit vector of the axis n, in space in the reference configuration.

    Examples
    --------
    >>> from skfem_cosserat import RigidBody, ground
    >>> body = RigidBody.box(1.0, (1, 1, 1))
    >>> JointRevolute(ground((0, 0, 0)), body.at((0, 0, 0)), axis=(1, 0, 0)).size
    5
    """

    type = "revolute"

    def rows(self) -> list[Zero | Product]:
        """Spherical, and n^A normal to two directions of B."""
        return [self._coincide(), *self._normal(self.axis)]

    def freedom(self) -> Freedom:
        """Rotation about n."""
        return Freedom((Turn("angle", self.axis),))


class JointUniversal(Joint):
    """Cardan joint: 4 constraints, ``x_b - x_a = 0`` and ``a^A . b^B = 0``.

    Relative coordinates: "angle_a" (rad) about the axis fixed in side a, then "angle_b" about
    the one fixed in side b.

    Parameters
    ----------
    a, b : Place
    axis_a, axis_b : (3,) array
        Unit vectors of the axes fixed in side a and in side b, normal to each other, in space in
        the reference configuration.

    Examples
    --------
    >>> from skfem_cosserat import RigidBody, ground
    >>> body = RigidBody.box(1.0, (1, 1, 1))
    >>> place = body.at((0, 0, 0))
    >>> JointUniversal(ground((0, 0, 0)), place, axis_a=(1, 0, 0), axis_b=(0, 1, 0)).size
    4
    """

    type = "universal"

    def __init__(self, a: Place, b: Place, axis_a: ArrayLike, axis_b: ArrayLike):
        super().__init__(a, b)
        self.axis_a = unit_vector(self.label, "axis_a", axis_a)
        self.axis_b = unit_vector(self.label, "axis_b", axis_b)
        cosine = float(self.axis_a @ self.axis_b)
        if abs(cosine) > TOLERANCE:
            between = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
            raise InputError(
                self.label,
                f"axis_a = {self.axis_a.tolist()} and axis_b = {self.axis_b.tolist()} are"
                f" {between:.6g} degrees apart, expected 90",
            )

    def rows(self) -> list[Zero | Product]:
        """Spherical, and both axes normal to each other."""
        normal = Product(direction(self.a, self.axis_a), direction(self.b, self.axis_b))
        return [self._coincide(), normal]

    def freedom(self) -> Freedom:
        """Rotations about both axes."""
        return Freedom((Turn("angle_a", self.axis_a), Turn("angle_b", self.axis_b, "b")))

    def coordinates(self) -> tuple[RelativeCoordinate, ...]:
        """Angles of each axis seen from the side that carries the other one."""
        first = angle("angle_a", self.a, self.b, self.axis_a, across=self.axis_b)
        return first, angle("angle_b", self.a, self.b, self.axis_b, "b", across=self.axis_a)


class JointFixed(Joint):
    """Rigid connection (weld): 6 constraints.

    Examples
    --------
    >>> from skfem_cosserat import RigidBody, ground
    >>> JointFixed(ground((0, 0, 0)), RigidBody.box(1.0, (1, 1, 1)).at((0, 0, 0))).size
    6
    """

    type = "fixed"

    def rows(self) -> list[Zero | Product]:
        """Spherical, and three products of one triad seen from both sides."""
        a = axes(self.a)
        b = axes(self.b)
        return [self._coincide(), *[Product(a[i], b[(i + 1) % 3]) for i in range(3)]]

    def freedom(self) -> Freedom:
        """Nothing."""
        return Freedom(())


# -- A joint that was locked during a motion: rigid where its sides are then -----------------------


class JointLocked(JointFixed):
    """Joint whose relative coordinates are frozen; it keeps the name of the joint it replaces.

    Parameters
    ----------
    joint : Joint
        As it was before.
    a, b : Place
        Its sides, described as they were when it was locked: both at the point of side b.
    """

    type = "locked"

    def __init__(self, joint: Joint, a: Place, b: Place):
        self.name = joint.name
        super().__init__(a, b)
        self.joint = joint

    def coordinates(self) -> tuple[RelativeCoordinate, ...]:
        """Coordinates of the joint that was locked, which do not change any more."""
        return self.joint.coordinates()


# --------------------------------------------------------------------------------------------------
# Drives: joint coordinates prescribed in time.


_AT_REST = np.eye(4, 3, -1)


@dataclass(frozen=True, eq=False)
class _Prescribed(Motion):
    """A number in time as the position ``(cos, sin, number)`` of a ground frame."""

    number: Callable[[float], float] = float

    def frame(self, place: Place, t: float) -> Floats:
        """Rows (4, 3) of the frame: its position at time ``t``, and a constant triad."""
        value = self.number(t)
        out = _AT_REST.copy()
        out[0] = math.cos(value), math.sin(value), value
        return out


class JointDrive(Item):
    """Prescribes an angle or a displacement of a joint: 1 constraint more, whatever it takes.

    The constraint is ``sin(theta - theta(t)) = 0`` or ``s - s(t) = 0``; with the null space the
    coordinate is eliminated (unless the joint closes a loop). So a motion that jumps by full turns,
    as an angle modulo ``2 pi`` does, moves nothing; the joint's angle in the history counts turns
    as the motion does. A jump by anything else is an error when a run gets there. Torque or force
    of the drive are ``joint/NAME/moment`` and ``joint/NAME/force`` of the history, NAME being the
    drive's (they are no part of the joint's own), its work is ``work_drives``.

    Parameters
    ----------
    joint : Joint
        Of the same model.
    motion : callable
        ``t -> float``, as ``RampSmooth(...)`` and ``Table(...)`` are, too: angle (rad) or
        displacement (m) from side a to side b, relative to the reference configuration, hence zero
        at the start.
    coordinate : str, optional
        Which of the joint's coordinates, such as "angle" or "displacement"; may be left out if it
        has only one.

    Raises
    ------
    InputError
        If the joint has no such coordinate, `motion` cannot be called, gives no finite number or
        is not zero at t = 0.

    Examples
    --------
    A motor that reaches a speed of 3 rad/s within a second:

    >>> from skfem_cosserat import JointRevolute, Model, RigidBody, ground
    >>> model = Model()
    >>> crank = model.add("crank", RigidBody.box(1.0, (1, 0.1, 0.1)))
    >>> place = crank.local((-0.5, 0, 0))
    >>> pin = model.add("pin", JointRevolute(ground(place.position), place, axis=(0, 0, 1)))
    >>> motor = model.add("motor", JointDrive(pin, lambda t: 1.5 * t**2 if t < 1 else 3 * t - 1.5))
    >>> model.freeze().counts()
    {'n': 12, 'm': 12, 'rank': 12, 'unknowns': 0}
    """

    kind = "drive"
    type = "drive"
    size = 1

    def __init__(
        self,
        joint: Joint,
        motion: Callable[[float], float],
        coordinate: str | None = None,
    ):
        if not isinstance(joint, Joint):
            raise InputError(self.label, f"joint is {joint!r}, expected a joint")
        if not callable(motion):
            raise InputError(self.label, f"motion = {motion!r}, expected a function of time, f(t)")
        self.joint = joint
        self.coordinate = joint.coordinate(coordinate)
        if self.coordinate.kind not in ("angle", "displacement"):
            raise InputError(
                self.label,
                f"cannot prescribe the {self.coordinate.name} of a {joint.type} joint: only angles"
                " and displacements, or the Motion of a ground place",
            )
        if not isinstance(motion, FunctionOfTime):
            motion = FunctionOfTime(motion)
        self._number = motion
        #: the ground frame that carries the number
        self.place = Place(
            None, -1, np.zeros(3), np.zeros(3), np.eye(3), _Prescribed(number=self.value)
        )
        self.a = joint.a
        self.b = joint.b

    def _parts(self) -> Iterator[tuple[str, Any]]:
        yield from (("joint", self.joint), ("motion", self._number))
        yield "coordinate", self.coordinate.name

    @property
    def motion(self) -> Callable[[float], float]:
        """The function of time that it was given."""
        return self._number.function

    def value(self, t: float) -> float:
        """Prescribed angle (rad) or displacement (m) at time `t` (s)."""
        try:
            return self._number.value(t)
        except InputError as error:
            raise InputError(self.label, str(error)) from error

    def references(self) -> list[StructuralItem]:
        """The items of its joint."""
        return self.joint.references()

    def check(self, t: float, length: float) -> None:
        """Raise InputError if it contradicts the reference configuration at time `t`."""
        value = self.value(t)
        unit, size = ("rad", 1.0) if self.coordinate.kind == "angle" else ("m", length)
        if abs(value) > TOLERANCE * size:
            raise InputError(
                self.label,
                f"prescribes {self.coordinate.name} = {value:.6g} {unit} at t = {t:g} s, but it is"
                f" 0 in the reference configuration of the {self.joint.label}",
            )

    def rows(self) -> list[Form]:
        """``cos(theta(t)) sin(theta) - sin(theta(t)) cos(theta) = 0`` or ``s - s(t) = 0``."""
        forms = self.coordinate.forms
        if self.coordinate.kind == "displacement":
            number = Expression(((self.place, 0, 1.0),))
            return [(*forms[0], Product(number, Expression(((ORIGIN, 3, 1.0),)), -1.0))]
        cosine, sine = forms
        return [(*self._times(sine, 0), *self._times(cosine, 1, -1.0))]

    def branch_cosines(self) -> list[Form]:
        """``cos(theta - theta(t))``, which is -1 where the row holds half a turn off."""
        if self.coordinate.kind == "displacement":
            return []
        cosine, sine = self.coordinate.forms
        return [(*self._times(cosine, 0), *self._times(sine, 1))]

    def _times(self, form: Form, component: int, sign: float = 1.0) -> Form:
        """The form times the cosine (0) or the sine (1) of the prescribed angle."""
        amplitude = Amplitude(self.place, component)
        return tuple(replace(p, factor=sign * p.factor, amplitude=amplitude) for p in form)
