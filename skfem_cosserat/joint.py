"""Joints between two places, as constraints at most quadratic in q and as relative coordinates.

Every joint is written twice, once for each treatment of the constraints: as constraint rows
(multipliers) and as the relative motions it leaves free (null space). Rows are quadratic, so that
the midpoint Jacobian is their exact discrete derivative.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .errors import InputError
from .frames import TOLERANCE, Item, Place, StructuralItem, unit_vector
from .types import ArrayLike, Floats, positive

__all__ = [
    "Freedom",
    "Joint",
    "JointDistance",
    "JointFixed",
    "JointRevolute",
    "JointSpherical",
    "Product",
    "Zero",
]


@dataclass(frozen=True, eq=False)
class Expression:
    """Linear combination of coordinate vectors: terms ``(place, row, factor)``.

    ``row`` 0 is phi of the place's vertex, 1 to 3 its directors.
    """

    terms: tuple[tuple[Place, int, float], ...]

    def __sub__(self, other: Expression) -> Expression:
        return Expression(self.terms + tuple((p, r, -c) for p, r, c in other.terms))


def point(place: Place) -> Expression:
    """``x = phi + X_i d_i`` of a place."""
    terms = [(place, 0, 1.0)]
    terms += [(place, i + 1, float(X)) for i, X in enumerate(place.offset) if X != 0]
    return Expression(tuple(terms))


def direction(place: Place, axis: Floats) -> Expression:
    """``n = n_i d_i``, the direction that is `axis` in space in the reference configuration."""
    components = place.material(axis)
    return Expression(
        tuple((place, i + 1, float(c)) for i, c in enumerate(components) if abs(c) > 1e-15)
    )


@dataclass(frozen=True, eq=False)
class Zero:
    """Three rows: ``expression = 0``."""

    expression: Expression
    size = 3


@dataclass(frozen=True, eq=False)
class Product:
    """One row: ``factor * (left . right) - its reference value = 0``."""

    left: Expression
    right: Expression
    factor: float = 1.0
    size = 1


@dataclass(frozen=True, eq=False)
class Freedom:
    """What a joint leaves free between its sides, for the null space.

    Attributes
    ----------
    rotation : {"free", "locked", "axis"}
        Any rotation; none; about `axis`.
    axis : (3,) array or None
        Fixed in side A, given in space in the reference.
    sphere : bool
        The point of one side moves on a sphere about that of the other (distance joint).
    """

    rotation: str
    axis: Floats | None = None
    sphere: bool = False


class Joint(Item):
    """Connection of two places; see the subclasses.

    Parameters
    ----------
    a, b : Place
        ``beam.node("tip")``, ``body.at(x)``, ``point.place()``, ``ground(x)``; at least one side
        belongs to an item.
    """

    kind = "joint"
    type = "general"
    needs_triads = True
    closed = True  # both points coincide

    def __init__(self, a: Place, b: Place) -> None:
        for side, place in (("a", a), ("b", b)):
            if not isinstance(place, Place):
                raise InputError(
                    self.label,
                    f"side {side} is {place!r}, expected a place such as beam.node('tip'),"
                    " body.at(x) or ground(x)",
                )
            if self.needs_triads and place.triad is None:
                raise InputError(
                    self.label,
                    f"side {side} is {place.label}: a mass point has no directions,"
                    " use a spherical or a distance joint",
                )
        if a.item is None and b.item is None:
            raise InputError(self.label, "both sides are ground")
        if a.item is b.item and a.vertex == b.vertex:
            raise InputError(self.label, f"both sides are {a.label}")
        self.a = a
        self.b = b

    @property
    def label(self) -> str:
        """How errors call it."""
        text = f"{self.type} {self.kind}"
        return text if self.name is None else f"{text} {self.name!r}"

    def references(self) -> list[StructuralItem]:
        """The items of both sides."""
        return [place.item for place in (self.a, self.b) if place.item is not None]

    def check(self, t: float, length: float) -> None:
        """Raise InputError if it does not close in the reference configuration at time `t`.

        `length` (m) is the extent of the scene, against which a gap is measured.
        """
        frames = [None if p.motion is None else p.motion.frame(p, t) for p in (self.a, self.b)]
        x_a, x_b = (
            p.position if f is None else f[0] for p, f in zip((self.a, self.b), frames, strict=True)
        )
        gap = float(np.linalg.norm(x_b - x_a))
        # coordinates far from the origin are known to their own rounding only
        rounding = 1e-15 * float(abs(x_a).max() + abs(x_b).max())
        if self.closed and gap > TOLERANCE * length + rounding:
            raise InputError(
                self.label,
                f"does not close in the reference configuration at t = {t:g} s: {self.a.label} and"
                f" {self.b.label} are {gap:.6g} m apart, x_b - x_a = {(x_b - x_a).tolist()}",
            )
        for frame in frames:
            if self.needs_triads and frame is not None:
                turn = float(abs(frame[1:] - np.eye(3)).max())
                if turn > TOLERANCE:
                    raise InputError(
                        self.label,
                        f"prescribed rotation is not zero at t = {t:g} s (by {turn:.6g}),"
                        " which contradicts the initial state",
                    )

    def rows(self) -> list[Zero | Product]:
        """Its constraints."""
        raise NotImplementedError

    def freedom(self) -> Freedom:
        """Its free relative motions."""
        raise NotImplementedError

    @property
    def size(self) -> int:
        """Number of constraint rows."""
        return sum(row.size for row in self.rows())


class JointSpherical(Joint):
    """Both points coincide: 3 constraints, ``x_b - x_a = 0``. Also holds mass points.

    Examples
    --------
    >>> from skfem_cosserat import MassPoint, ground
    >>> JointSpherical(ground((0, 0, 0)), MassPoint(1.0).place()).size
    3
    """

    type = "spherical"
    needs_triads = False

    def rows(self) -> list[Zero | Product]:
        """``x_b - x_a = 0``."""
        return [Zero(point(self.b) - point(self.a))]

    def freedom(self) -> Freedom:
        """Any rotation."""
        return Freedom("free")


class JointRevolute(Joint):
    """Hinge: 5 constraints, ``x_b - x_a = 0`` and ``n^A . m_k^B = 0``, k = 1, 2.

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

    def __init__(self, a: Place, b: Place, axis: ArrayLike) -> None:
        super().__init__(a, b)
        self.axis = unit_vector(self.label, "axis", axis)

    def rows(self) -> list[Zero | Product]:
        """Spherical, and n^A normal to two directions of B."""
        n = direction(self.a, self.axis)
        normals = _normals(self.axis)
        return [
            Zero(point(self.b) - point(self.a)),
            *(Product(n, direction(self.b, m)) for m in normals),
        ]

    def freedom(self) -> Freedom:
        """Rotation about n."""
        return Freedom("axis", self.axis)


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
        return [Zero(point(self.b) - point(self.a)), *products]

    def freedom(self) -> Freedom:
        """Nothing."""
        return Freedom("locked")


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
    needs_triads = False
    closed = False

    def __init__(self, a: Place, b: Place, length: float | None = None) -> None:
        super().__init__(a, b)
        distance = float(np.linalg.norm(b.position - a.position))
        self.length = positive(self.label, "length", distance if length is None else length)

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
        return Freedom("free", sphere=True)


def _normals(axis: Floats) -> Floats:
    """Two unit vectors (2, 3) normal to `axis` and to each other."""
    first = np.cross(axis, np.eye(3)[np.argmin(abs(axis))])
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(axis, first)])
