"""Joints whose points coincide: spherical, revolute, universal, fixed."""

from __future__ import annotations

import numpy as np

from ..errors import InputError
from ..frames import TOLERANCE, Place, unit_vector
from ..relative import Product, RelativeCoordinate, Zero, angle, direction
from ..types import ArrayLike
from .base import AxialJoint, Freedom, Joint, Turn

__all__ = ["JointFixed", "JointRevolute", "JointSpherical", "JointUniversal"]


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

    def sheets(self) -> list[Product]:
        """See the base class."""
        return [self._same(self.axis)]

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

    def __init__(self, a: Place, b: Place, axis_a: ArrayLike, axis_b: ArrayLike) -> None:
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
        axes = Product(direction(self.a, self.axis_a), direction(self.b, self.axis_b))
        return [self._coincide(), axes]

    def freedom(self) -> Freedom:
        """Rotations about both axes."""
        return Freedom((Turn("angle_a", self.axis_a), Turn("angle_b", self.axis_b, "b")))

    def coordinates(self) -> tuple[RelativeCoordinate, ...]:
        """Angles of each axis seen from the side that carries the other one."""
        first = angle("angle_a", self.a, self.b, self.axis_a, across=self.axis_b)
        second = angle("angle_b", self.a, self.b, self.axis_b, "b", across=self.axis_a)
        return first, second


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
        a = [direction(self.a, e) for e in np.eye(3)]
        b = [direction(self.b, e) for e in np.eye(3)]
        products = [Product(a[i], b[(i + 1) % 3]) for i in range(3)]
        return [self._coincide(), *products]

    def sheets(self) -> list[Product]:
        """See the base class."""
        return [self._same(e) for e in np.eye(3)]

    def freedom(self) -> Freedom:
        """Nothing."""
        return Freedom(())
