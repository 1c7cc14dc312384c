"""Obstacles: rigid surfaces fixed in space that bodies and beams touch."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Self, TypeAlias

import numpy as np

from .body import MassPoint, RigidBody
from .coupling import Coupling
from .errors import InputError, failed
from .force import Force
from .frames import Item, Place, StructuralItem, ground, is_beam, no_place, vector
from .frozen import Frozen, Replacements
from .law import LawStored
from .relative import (
    ORIGIN,
    Product,
    RelativeCoordinate,
    direction,
    displacement,
    distance,
    normals,
    point,
)
from .types import Array, ArrayLike, Floats, not_negative, positive, switch

#: x (n, 3) to distances (n,) outside of a surface (m)
GapFunction: TypeAlias = Callable[[Array], Array]


class Surface(Frozen, ABC):
    """Base of the surfaces of obstacles: a length less a radius is the gap, or minus the gap."""

    point: Floats
    radius = 0.0
    #: -1 if what touches it is inside
    side = 1.0

    def gap(self, x: Array) -> Array:
        """Distances (n,) outside of points x (n, 3) in m; they may be complex."""
        return self.side * (self._length(x - self.point) - self.radius)

    @abstractmethod
    def _length(self, r: Array) -> Array:
        """Lengths (n,) of vectors (n, 3) from the point."""

    @abstractmethod
    def coordinate(self, place: Place) -> RelativeCoordinate:
        """The same length of a place, as a coordinate of force elements."""


def _unit(label: str, name: str, value: ArrayLike) -> Floats:
    """Unit vector (3,) along another one."""
    out = vector(label, name, value)
    if not out.any():
        raise InputError(label, f"{name} = {out.tolist()}, expected a vector that is not zero")
    return out / np.linalg.norm(out)


class Plane(Surface):
    """A plane that is an :class:`Obstacle`: what touches it is on the side of its normal.

    Parameters
    ----------
    point : (3,) array
        In the plane (m).
    normal : (3,) array
        Out of the obstacle, of any length.

    Raises
    ------
    InputError
        If the normal has no length, or a number is not finite.

    Examples
    --------
    >>> Plane((0, 0, 1), normal=(0, 0, 2)).gap(np.array([[5.0, 0, 4.0]])).tolist()
    [3.0]
    """

    def __init__(self, point: ArrayLike, normal: ArrayLike) -> None:
        self.point = vector("plane", "point", point)
        self.normal = _unit("plane", "normal", normal)

    def _length(self, r: Array) -> Array:
        return r @ self.normal

    def coordinate(self, place: Place) -> RelativeCoordinate:
        """The height of a place."""
        forms = displacement("gap", ground(self.point), place, self.normal).forms
        return RelativeCoordinate("gap", "height", forms)


class _Round(Surface):
    def __init__(self, radius: float, inside: bool) -> None:
        label = type(self).__name__.lower()
        self.radius = positive(label, "radius", radius, " (m)")
        self.inside = switch(label, inside, "inside")
        self.side = -1.0 if inside else 1.0


class Sphere(_Round):
    """A ball that is an :class:`Obstacle`, or a hollow sphere around what touches it.

    Parameters
    ----------
    centre : (3,) array
        (m)
    radius : float
        (m)
    inside : bool
        What touches it is inside.

    Raises
    ------
    InputError
        If the radius is not positive, or a number is not finite.

    Examples
    --------
    >>> Sphere((0, 0, 1), 2.0).gap(np.array([[0, 0, 4.0]])).tolist()
    [1.0]
    """

    def __init__(self, centre: ArrayLike, radius: float, inside: bool = False) -> None:
        super().__init__(radius, inside)
        self.centre = self.point = vector("sphere", "centre", centre)

    def _length(self, r: Array) -> Array:
        return np.asarray(np.sqrt((r * r).sum(-1)))

    def coordinate(self, place: Place) -> RelativeCoordinate:
        """The distance of a place from the centre."""
        return distance("gap", ground(self.point), place)


class Cylinder(_Round):
    """A bar without ends that is an :class:`Obstacle`, or a tube around what touches it.

    Parameters
    ----------
    point : (3,) array
        On the axis (m).
    axis : (3,) array
        Its direction, of any length.
    radius : float
        (m)
    inside : bool
        What touches it is inside.

    Raises
    ------
    InputError
        If the axis has no length, the radius is not positive, or a number is not finite.

    Examples
    --------
    >>> tube = Cylinder((0, 0, 0), axis=(1, 0, 0), radius=0.5, inside=True)
    >>> tube.gap(np.array([[7.0, 0.25, 0]])).tolist()
    [0.25]
    """

    def __init__(
        self, point: ArrayLike, axis: ArrayLike, radius: float, inside: bool = False
    ) -> None:
        super().__init__(radius, inside)
        self.point = vector("cylinder", "point", point)
        self.axis = _unit("cylinder", "axis", axis)

    def _length(self, r: Array) -> Array:
        across = r @ normals(self.axis).T
        return np.asarray(np.sqrt((across * across).sum(-1)))

    def coordinate(self, place: Place) -> RelativeCoordinate:
        """The distance of a place from the axis."""
        r = point(place) - point(ground(self.point))
        first, second = (direction(ORIGIN, m) for m in normals(self.axis))
        return RelativeCoordinate("gap", "radius", ((Product(first, r),), (Product(second, r),)))


#: a place, its share of stiffness and damping, and a radius about it (m)
_Point = tuple[Place, float, float]


class _Touch(Coupling):
    """A place that touches a surface."""

    kind = "obstacle"
    slack = True

    def __init__(self, surface: Surface, at: _Point, stiffness: float, damping: float) -> None:
        self.a, (self.b, share, radius) = ground(surface.point), at
        self.coordinates, self.sign = (surface.coordinate(self.b),), -surface.side
        self._set_law(stiffness * share, damping * share, surface.radius + surface.side * radius)


class Obstacle(Item):
    """A rigid surface, fixed in space, that bodies and beams touch and do not pass.

    Points push back with the potential ``V = k d^2/2`` while they are deeper than d = 0 in the
    obstacle, so they are in it by d = N/k where they press with N: a ball of m kg lies ``m g/k``
    deep. Take k large enough for that to be little; steps must be short against
    ``pi sqrt(m/k)``, the time of an impact. With :class:`EnergyMomentum` impacts keep the energy
    exactly, all others have an error in each of them. Sliding friction of Coulomb is regularised:
    ``-mu N v/sqrt(v^2 + v_eps^2)`` for a velocity v along the surface. So nothing sticks: what is
    pushed with less than ``mu N`` creeps with less than about v_eps; at rest, in statics and modes,
    there is no friction.

    Points touch, not lines and faces: of a beam these are its nodes, which must be closer to each
    other than thin obstacles are wide. All forces act at the points: what has a radius is not
    turned by friction, balls do not roll. Not there: beams that touch beams or bodies that touch
    bodies, friction in joints, a coefficient of restitution (there is `damping`), adhesion.

    In histories point k is ``coupling/NAME/k``, its coordinate the height over the plane, or the
    distance from the centre or the axis. The energy is in ``coupling_energy``. Friction is
    ``load/NAME/friction``, its work in ``work_loads``. Of an own function all forces are
    ``load/NAME``.

    Parameters
    ----------
    surface : Plane, Sphere, Cylinder or callable
        Where it is; or ``gap(x)``, the distances (n,) outside of points x (n, 3) in m, negative
        inside. It must be made of what can be differentiated: see :class:`Force`.
    against : Place, MassPoint, RigidBody, Beam, or a list of them
        What touches it: a ball by its centre, with its radius; other bodies by the corners of the
        surface they are drawn with; beams by all nodes.
    stiffness : float
        k (N/m), positive; of beams per length (N/m^2).
    damping : float
        c (N s/m; of beams per length), not negative: ``c`` times the velocity into the obstacle is
        added to ``k d`` while that is positive; it never pulls.
    friction : float
        Coefficient mu, not negative.
    slip_speed : float, optional
        v_eps (m/s), positive, which friction needs.
    radius : float
        Of what touches, about its points (m).

    Raises
    ------
    InputError
        If it is no surface, `against` has no points, a number is not finite, negative or zero where
        that is not allowed, or there is no room inside; if a function gives no numbers (n,).

    Examples
    --------
    A ball that falls on the floor, and is back where it was:

    >>> import skfem_cosserat as sc
    >>> model = sc.Model()
    >>> ball = model.add("ball", sc.RigidBody.sphere(0.5, radius=0.1, position=(0, 0, 0.6)))
    >>> gravity = model.add("gravity", sc.LoadGravity((0, 0, -10.0)))
    >>> floor = model.add("floor", Obstacle(Plane((0, 0, 0), (0, 0, 1)), ball, stiffness=1e5))
    >>> history = sc.simulate(model, sc.EnergyMomentum(), sc.NullSpace(), 1e-3, until=0.65)
    >>> z = history.position(ball.at((0, 0, 0.6)))[:, 2]
    >>> round(float(z.min()), 2), round(float(z[-100:].max()), 3)
    (0.09, 0.6)
    """

    kind = "obstacle"

    def __init__(
        self,
        surface: Surface | GapFunction,
        against: StructuralItem | Place | Sequence[StructuralItem | Place],
        stiffness: float,
        damping: float = 0.0,
        friction: float = 0.0,
        slip_speed: float | None = None,
        radius: float = 0.0,
    ) -> None:
        if isinstance(surface, type) or not (isinstance(surface, Surface) or callable(surface)):
            text = f"surface = {surface!r}, expected a Plane, Sphere or Cylinder, or a function"
            raise InputError(self.label, text)
        self.surface = surface
        self.against = tuple(against) if isinstance(against, list | tuple) else against
        self.stiffness = positive(self.label, "stiffness", stiffness, " (N/m; of beams N/m^2)")
        self.damping = not_negative(self.label, "damping", damping)
        self.friction = not_negative(self.label, "friction", friction)
        self.slip_speed = slip_speed
        if friction or slip_speed is not None:
            self.slip_speed = positive(self.label, "slip_speed", slip_speed, " (m/s)")
        self.radius = not_negative(self.label, "radius", radius)
        items = self.against if isinstance(self.against, tuple) else (self.against,)
        points = [each for item in items for each in self._points_of(item)]
        if not points:
            raise InputError(self.label, "against has no points, expected one or more")
        places = [place for place, _, _ in points]
        self._shares, self._radii = (np.array([at[k] for at in points]) for k in (1, 2))
        self._gap: GapFunction = getattr(surface, "gap", surface)
        size = getattr(surface, "radius", 0.0) or 1.0
        #: the gap with its derivatives, of complex numbers, too
        self._stored = LawStored(self._gaps, None, None, np.eye(3), size=size)
        self._touches: list[_Touch] = []
        self._forces: dict[str, Force] = {}
        if isinstance(surface, Surface):
            numbers = self.stiffness, self.damping
            self._touches = [_Touch(surface, at, *numbers) for at in points]
        else:
            x = np.array([place.position for place in places])
            self._stored.energy(x), self._stored.stress(x)  # errors are told before a run
            self._forces[""] = Force(
                places, energy=self._energy, derivative=self._gradient, each=True
            )
        if friction or (damping and self._forces):
            self._forces["/friction"] = Force(places, self._law, each=True)

    def _points_of(self, item: object) -> list[_Point]:
        if isinstance(item, Place) and item.item is not None:
            return [(item, 1.0, self.radius)]
        if isinstance(item, MassPoint):
            return [(item.place(), 1.0, self.radius)]
        if isinstance(item, RigidBody) and item.ball:
            return [(item.local((0, 0, 0)), 1.0, self.radius + item.ball)]
        if isinstance(item, RigidBody) and item.surface is not None:
            return [(item.local(X), 1.0, self.radius) for X in item.surface[0]]
        if not is_beam(item):
            raise InputError(self.label, f"acts on {no_place(item)}")
        lengths = np.zeros(item.basis.n_nodes)
        np.add.at(lengths, item.basis.connectivity, item.basis.elemental_load())
        return [(item.node(k), length, self.radius) for k, length in enumerate(lengths.tolist())]

    # -- the laws of all points together -----------------------------------------------------------

    def _gaps(self, x: Array) -> Array:
        """The gap (...) of points (..., 3)."""
        rows = x.reshape(-1, 3)
        try:
            found = np.asarray(self._gap(rows))
        except Exception as error:
            raise failed(self.label, "its gap", error) from error
        if found.shape != (len(rows),) or found.dtype.kind != x.dtype.kind:
            given = f"gap gives an array {found.shape} of {found.dtype}"
            text = f"{given} for {rows.shape} of {x.dtype}, expected ({len(rows)},) such numbers"
            raise InputError(self.label, text)
        return found.reshape(x.shape[:-1])

    def _pressed(self, x: Array) -> tuple[Array, Array]:
        """Depths (n,) of places (n, 3) in the obstacle, and their shares of the stiffness."""
        times = len(x) // len(self._shares)
        depth = np.repeat(self._radii, times) - self._stored.energy(x)
        return np.where(depth.real > 0, depth, 0.0), np.repeat(self._shares, times)

    def _energy(self, x: Array) -> Array:
        depth, share = self._pressed(x)
        return 0.5 * self.stiffness * share * depth**2

    def _gradient(self, x: Array) -> Array:
        depth, share = self._pressed(x)
        return -(self.stiffness * share * depth)[:, None] * self._stored.stress(x)

    def _law(self, x: Array, v: Array, t: float) -> Array:
        """Friction (n, 3), and what a damper adds to an own function."""
        (depth, share), normal = self._pressed(x), self._stored.stress(x)
        pressing, speed = self.stiffness * share * depth, (v * normal).sum(-1)
        slip = v - speed[:, None] * normal
        rough = np.sqrt((slip * slip).sum(-1) + (self.slip_speed or 1.0) ** 2)
        force = -(self.friction * pressing / rough)[:, None] * slip
        if not self._touches:
            push = np.where(depth.real > 0, -self.damping * share * speed, 0.0)
            push = np.where(push.real < -pressing.real, -pressing, push)
            force = force + push[:, None] * normal
        return force

    # -- protocol ----------------------------------------------------------------------------------

    def with_replacements(self, replacements: Replacements) -> Self:
        """The same obstacle for what replaces the items, on all of their points."""
        numbers = self.stiffness, self.damping, self.friction, self.slip_speed, self.radius
        return type(self)(self.surface, replacements.of(self.against), *numbers)

    def pieces(self) -> list[Coupling]:
        """Force elements that it is made of, named after it."""
        for k, touch in enumerate(self._touches):
            vars(touch)["name"] = f"{self.name}/{k}"
        out: list[Coupling] = list(self._touches)
        for end, force in self._forces.items():
            vars(force)["name"] = f"{self.name}{end}"
            out += force.pieces()
        return out

    def references(self) -> Sequence[Item]:
        """The items of its points."""
        return list({id(item): item for p in self.pieces() for item in p.references()}.values())
