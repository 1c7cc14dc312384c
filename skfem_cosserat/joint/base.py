"""What a joint is: constraint rows, the motion it leaves free, its relative coordinates.

Every joint is written twice, once for each treatment of the constraints: as constraint rows
(multipliers) and as the relative motions it leaves free (null space). Rows are quadratic, so that
the midpoint Jacobian is their exact discrete derivative.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from ..frames import TOLERANCE, Item, Place, StructuralItem, unit_vector
from ..relative import (
    Product,
    RelativeCoordinate,
    Zero,
    angle,
    direction,
    displacement,
    normals,
    point,
    rotation,
)
from ..types import ArrayLike, Floats

__all__ = ["AxialJoint", "Freedom", "Joint", "Slide", "Turn"]


@dataclass(frozen=True, eq=False)
class Turn:
    """Rotation about an axis fixed in one side ("a" or "b"), given in space in the reference."""

    name: str
    axis: Floats
    side: str = "a"


@dataclass(frozen=True, eq=False)
class Slide:
    """Translation along ``left x right``, both fixed in side a, given in space in the reference.

    As a cross product of directors, not as a director: only so it stays admissible at midpoints.
    """

    name: str
    left: Floats
    right: Floats


@dataclass(frozen=True, eq=False)
class Freedom:
    """What a joint leaves free between its sides, for the null space.

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
        """What is left where everything moves in the plane with this unit normal only.

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

    def __init__(self, a: Place, b: Place) -> None:
        for side, place in (("a", a), ("b", b)):
            if not isinstance(place, Place):
                raise InputError(
                    self.label,
                    f"side {side} is {place!r}, expected a place such as beam.node('tip'),"
                    " body.at(x) or ground(x)",
                )
            if side in self.framed_sides and place.triad is None:
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

    def gap(self, r: Floats) -> Floats:
        """Part of ``x_b - x_a`` that must vanish in the reference configuration."""
        return r

    def check(self, t: float, length: float) -> None:
        """Raise InputError if it does not close in the reference configuration at time `t`.

        `length` (m) is the extent of the scene, against which a gap is measured.
        """
        frames = [None if p.motion is None else p.motion.frame(p, t) for p in (self.a, self.b)]
        x_a, x_b = (
            p.position if f is None else f[0] for p, f in zip((self.a, self.b), frames, strict=True)
        )
        rest = self.gap(x_b - x_a)
        gap = float(np.linalg.norm(rest))
        # coordinates far from the origin are known to their own rounding only
        rounding = 1e-15 * float(abs(x_a).max() + abs(x_b).max())
        if gap > TOLERANCE * length + rounding:
            raise InputError(
                self.label,
                f"does not close in the reference configuration at t = {t:g} s: {self.a.label} and"
                f" {self.b.label} are {gap:.6g} m apart, x_b - x_a = {rest.tolist()}"
                + ("" if rest is None or np.allclose(rest, x_b - x_a) else " where it is held"),
            )
        for side, frame in zip(("a", "b"), frames, strict=True):
            if side in self.framed_sides and frame is not None:
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

    def sheets(self) -> list[Product]:
        """Cosines that are 1 where its rows hold, and -1 where they do so half a turn off."""
        return []

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
        turning = [angle(t.name, self.a, self.b, t.axis, t.side) for t in free.turns]
        return (*sliding, *turning)

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

    def __init__(self, a: Place, b: Place, axis: ArrayLike) -> None:
        super().__init__(a, b)
        self.axis = unit_vector(self.label, "axis", axis)
