"""Joints whose points move against each other: slides, planes, lines, rods."""

from __future__ import annotations

import numpy as np

from ..errors import InputError
from ..frames import TOLERANCE, Place, unit_vector
from ..relative import Product, Zero, direction, normals, point
from ..types import ArrayLike, Floats, positive
from .base import AxialJoint, Freedom, Joint, Slide, Turn

__all__ = [
    "JointCylindrical",
    "JointDistance",
    "JointPlanar",
    "JointPointOnLine",
    "JointPrismatic",
]


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

    def sheets(self) -> list[Product]:
        """See the base class."""
        return [self._same(self.axis)]

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

    def sheets(self) -> list[Product]:
        """See the base class."""
        return [self._same(self.axis), self._same(normals(self.axis)[0])]

    def freedom(self) -> Freedom:
        """Translation along n."""
        return Freedom((), (_along(self.axis),))


class JointPlanar(Joint):
    """x_b moves in a plane of side a, both keep its normal in common: 3 constraints.

    ``n^A . (x_b - x_a) = 0`` and ``n^A . m_k^B = 0``, k = 1, 2. Relative coordinates: "x" and "y"
    (m) in the plane, "angle" (rad) about n.

    Parameters
    ----------
    a, b : Place
        Both in the plane in the reference configuration.
    normal : (3,) array
        Unit vector n, in space in the reference configuration.
    x : (3,) array, optional
        Unit vector of the coordinate x in the plane; y is ``n x x``. Default: any.

    Examples
    --------
    >>> from skfem_cosserat import RigidBody, ground
    >>> body = RigidBody.box(1.0, (1, 1, 1))
    >>> JointPlanar(ground((0, 0, 0)), body.at((0.5, 0, 0)), normal=(0, 0, 1)).size
    3
    """

    type = "planar"

    def __init__(self, a: Place, b: Place, normal: ArrayLike, x: ArrayLike | None = None) -> None:
        super().__init__(a, b)
        self.normal = unit_vector(self.label, "normal", normal)
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

    def sheets(self) -> list[Product]:
        """See the base class."""
        return [self._same(self.normal)]

    def freedom(self) -> Freedom:
        """Rotation about n, translations ``n x m_k``."""
        y = np.cross(self.normal, self.x)
        slides = (Slide("x", self.normal, -y), Slide("y", self.normal, self.x))
        return Freedom((Turn("angle", self.normal),), slides)


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

    def __init__(self, a: Place, b: Place, length: float | None = None) -> None:
        super().__init__(a, b)
        span = float(np.linalg.norm(b.position - a.position))
        self.length = positive(self.label, "length", span if length is None else length)

    def gap(self, r: Floats) -> Floats:
        """None: :meth:`check` compares lengths."""
        return np.zeros(3)

    def check(self, t: float, length: float) -> None:
        """See the base class."""
        super().check(t, length)
        x_a, x_b = (
            p.position if p.motion is None else p.motion.frame(p, t)[0] for p in (self.a, self.b)
        )
        distance = float(np.linalg.norm(x_b - x_a))
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
