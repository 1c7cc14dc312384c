"""Obstacles: rigid surfaces fixed in space that bodies and beams touch."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from .body import MassPoint, RigidBody
from .coupling import Composed, Coupling
from .errors import InputError, failed
from .force import Force
from .frames import Place, StructuralItem, ground, is_beam, no_place, unit_vector, vector
from .frozen import Frozen
from .law import LawStored
from .relative import RelativeCoordinate, displacement, distance, normals
from .types import Array, ArrayLike, Floats, not_negative, positive, switch


class Surface(Frozen, ABC):
    """Base of the surfaces of obstacles: where a height, or a distance, is that of a radius.

    Parameters
    ----------
    point : (3,) array
        From which on lengths count (m).
    across : (1, 3) or (3, 3) array
        The normal of a plane, or the projection of vectors whose length is the distance.
    radius : float
        At which the surface is (m); zero of a plane.
    inside : bool
        What touches it is inside.
    """

    #: of a cylinder, or the normal of a plane
    axis: Floats = np.zeros(3)

    def __init__(
        self, point: ArrayLike, across: Floats, radius: float = 0.0, inside: bool = False
    ) -> None:
        label = type(self).__name__.lower()
        self.point, self.across, self.radius = vector(label, "point", point), across, radius
        self.inside = switch(label, inside, "inside")
        #: -1 if a larger length is a smaller gap
        self.side = -1.0 if inside else 1.0

    def __call__(self, x: Array) -> Array:
        """The gap: distances (n,) outside of points x (n, 3) in m; they may be complex."""
        r = (x - self.point) @ self.across.T
        return self.side * ((np.sqrt((r * r).sum(-1)) if self.radius else r[:, 0]) - self.radius)

    def outward(self, x: Array) -> Array:
        """Directions (n, 3) in which the gap of points x (n, 3) grows; they may be complex."""
        r = (x - self.point) @ self.across.T
        length = np.sqrt((r * r).sum(-1, keepdims=True)) if self.radius else r
        return self.side * (r / length) @ self.across

    def foot(self, x: Floats) -> Floats:
        """Point (3,) of a plane, or of an axis or centre, that is nearest to a point (3,)."""
        return x - self.across.T @ (self.across @ (x - self.point))

    def described(self) -> dict[str, Any]:
        """What pictures need of it."""
        numbers = {"point": self.point.tolist(), "axis": self.axis.tolist(), "radius": self.radius}
        return {"kind": type(self).__name__, "inside": self.inside, **numbers}

    @abstractmethod
    def coordinate(self, place: Place) -> RelativeCoordinate:
        """A length of a place that is the radius at the surface."""


class Plane(Surface):
    """A plane that is an :class:`Obstacle`: what touches it is on the side of its normal.

    Parameters
    ----------
    point : (3,) array
        In the plane (m).
    normal : (3,) array
        Unit vector out of the obstacle.

    Raises
    ------
    InputError
        If the normal is no unit vector, or a number is not finite.

    Examples
    --------
    >>> Plane((0, 0, 1), normal=(0, 0, 1))(np.array([[5.0, 0, 4.0]])).tolist()
    [3.0]
    """

    def __init__(self, point: ArrayLike, normal: ArrayLike) -> None:
        self.normal = self.axis = unit_vector("plane", "normal", normal)
        super().__init__(point, self.normal[None])

    def coordinate(self, place: Place) -> RelativeCoordinate:
        """The height of a place."""
        foot = ground(self.foot(place.position))
        forms = displacement("gap", foot, place, self.normal).forms
        return RelativeCoordinate("gap", "height", forms)


class Sphere(Surface):
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
    >>> Sphere((0, 0, 1), 2.0)(np.array([[0, 0, 4.0]])).tolist()
    [1.0]
    """

    def __init__(self, centre: ArrayLike, radius: float, inside: bool = False) -> None:
        self.centre = vector("sphere", "centre", centre)
        super().__init__(centre, np.eye(3), positive("sphere", "radius", radius), inside)

    def coordinate(self, place: Place) -> RelativeCoordinate:
        """The distance of a place from the centre."""
        return distance("gap", ground(self.centre), place)


class Cylinder(Surface):
    """A bar without ends that is an :class:`Obstacle`, or a tube around what touches it.

    Parameters
    ----------
    point : (3,) array
        On the axis (m).
    axis : (3,) array
        Unit vector.
    radius : float
        (m)
    inside : bool
        What touches it is inside.

    Raises
    ------
    InputError
        If the axis is no unit vector, the radius is not positive, or a number is not finite.

    Examples
    --------
    >>> tube = Cylinder((0, 0, 0), axis=(1, 0, 0), radius=0.5, inside=True)
    >>> tube(np.array([[7.0, 0.25, 0]])).tolist()
    [0.25]
    """

    def __init__(
        self, point: ArrayLike, axis: ArrayLike, radius: float, inside: bool = False
    ) -> None:
        self.axis = unit_vector("cylinder", "axis", axis)
        across = np.eye(3) - np.outer(self.axis, self.axis)
        super().__init__(point, across, positive("cylinder", "radius", radius), inside)

    def coordinate(self, place: Place) -> RelativeCoordinate:
        """The distance of a place from the axis."""
        foot = ground(self.foot(place.position))
        lengths = (displacement("gap", foot, place, n).forms[0] for n in normals(self.axis))
        return RelativeCoordinate("gap", "radius", tuple(lengths))


class _Touch(Coupling):
    """A place with a radius that touches a surface."""

    kind = "obstacle"
    slack = True

    def __init__(self, surface: Surface, place: Place, radius: float, k: float, c: float) -> None:
        self.surface = surface
        self.a, self.b = ground(surface.foot(place.position)), place
        self.coordinates, self.sign = (surface.coordinate(place),), -surface.side
        self._set_law(k, c, surface.radius + surface.side * radius)


class Obstacle(Composed):
    """A rigid surface, fixed in space, that bodies and beams touch and do not pass.

    Points push back with the potential ``V = k d^2/2`` while they are deeper than d = 0 in the
    obstacle, so they are in it by d = N/k where they press with N: a ball of m kg lies ``m g/k``
    deep. Take k large enough for that to be little; an impact takes about ``pi sqrt(m/k)``, and
    what is thinner than a step is long is passed. With :class:`EnergyMomentum` impacts keep the
    energy exactly, other schemes make an error in each of them. Coulomb's sliding friction is
    regularised: ``-mu N v/sqrt(v^2 + v_eps^2)``, for a velocity v along the surface and N = k d.
    So nothing sticks: what is pushed with less than ``mu N`` creeps, slower than about v_eps; at
    rest, in statics and modes, there is no friction.

    Points touch, not lines and faces: of a beam these are its nodes, which must be closer to each
    other than thin obstacles are wide. All forces act at the points: what has a radius is not
    turned by friction, balls do not roll. Not there: beams that touch beams, bodies that touch
    bodies, friction in joints, a coefficient of restitution (there is `damping`), adhesion.

    Point k is ``coupling/NAME/k`` in histories, its coordinate the height over the plane, or the
    distance from the centre or the axis; friction is ``load/NAME/friction``. Own functions are
    called back from compiled steps, which takes longer; their forces are ``load/NAME``, and dampers
    belong to ``load/NAME/friction``. When such a contact begins or ends, :class:`EnergyMomentum`
    has a force along the surface that falls with the square of the step. The energy is in
    ``coupling_energy``, the work of friction in ``work_loads``.

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
        c (N s/m; of beams N s/m^2), not negative: ``c`` times the velocity into the obstacle is
        added to ``k d`` in it, and never pulls.
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
        surface: Surface | Callable[[Array], Array],
        against: StructuralItem | Place | Sequence[StructuralItem | Place],
        stiffness: float,
        damping: float = 0.0,
        friction: float = 0.0,
        slip_speed: float | None = None,
        radius: float = 0.0,
    ) -> None:
        self.surface = surface
        self.against = tuple(against) if isinstance(against, Sequence) else (against,)
        self.stiffness = positive(self.label, "stiffness", stiffness, " (N/m; of beams N/m^2)")
        self.damping = not_negative(self.label, "damping", damping)
        self.friction = not_negative(self.label, "friction", friction)
        if friction:
            slip_speed = positive(self.label, "slip_speed", slip_speed, " (m/s)")
        self.slip_speed = slip_speed
        self.radius = not_negative(self.label, "radius", radius)
        points = [each for item in self.against for each in self._points_of(item)]
        if not points:
            raise InputError(self.label, "is against nothing, expected one place or more")
        places, radii, shares = zip(*points, strict=True)
        self._radii = np.array(radii)[:, None] + radius
        if isinstance(surface, Surface) and surface.inside and self._radii.max() >= surface.radius:
            raise InputError(self.label, f"has no room for a radius of {self._radii.max():g} m")
        self._stiffness = np.array(shares)[:, None] * stiffness
        self._made: dict[str, Coupling] = {}
        if isinstance(surface, Surface):
            self._outward: Callable[[Array], Array] = surface.outward
            for k, (place, more, share) in enumerate(points):
                self._made[f"/{k}"] = _Touch(
                    surface, place, radius + more, stiffness * share, damping * share
                )
            damping = 0.0
        else:
            try:
                self._gap_of(np.array([place.position for place in places]) + 0j)
            except Exception as error:
                raise failed(self.label, f"surface = {surface!r}", error) from error
            # derivatives of the gap, of complex numbers, too
            self._outward = LawStored(self._gap_of, None, None, np.eye(3)).stress
            self._made[""] = Force(
                places, energy=self._energy, derivative=self._gradient, each=True
            )
        #: times the stiffness: of dampers that no coupling has (s)
        self._delay = damping / stiffness
        if friction or damping:
            self._made["/friction"] = Force(places, self._law, each=True)

    def _points_of(self, item: object) -> list[tuple[Place, float, float]]:
        """Places, with the radius (m) of a ball and the share of the stiffness of each."""
        if is_beam(item):
            nodes, lengths = item.basis.connectivity, item.basis.elemental_load()
            each = enumerate(np.bincount(nodes.ravel(), lengths.ravel()).tolist())
            return [(item.node(k), 0.0, length) for k, length in each]
        if isinstance(item, RigidBody) and item.surface is not None:
            corners = np.zeros((1, 3)) if item.ball else item.surface[0]
            return [(item.local(X), item.ball, 1.0) for X in corners]
        place = item.place() if isinstance(item, MassPoint) else item
        if not isinstance(place, Place) or place.item is None:
            raise InputError(self.label, f"is against {no_place(item)}")
        return [(place, 0.0, 1.0)]

    # -- laws of all places (n, 3) together: points, then complex steps of each --------------------

    def _gap_of(self, x: Array) -> Array:
        return self.surface(x.reshape(-1, 3)).reshape(x.shape[:-1])

    def _depth(self, x: Array) -> Array:
        """How deep places are in the obstacle (points, steps), zero outside."""
        depth = self._radii - self._gap_of(x).reshape(len(self._radii), -1)
        return depth * (depth.real > 0)

    def _energy(self, x: Array) -> Array:
        return (0.5 * self._stiffness * self._depth(x) ** 2).ravel()

    def _gradient(self, x: Array) -> Array:
        return -(self._stiffness * self._depth(x)).reshape(-1, 1) * self._outward(x)

    def _law(self, x: Array, v: Array, t: float) -> Array:
        """Friction, and dampers that no coupling has."""
        depth, normal = self._depth(x), self._outward(x)
        speed = (v * normal).sum(-1, keepdims=True)
        slip = v - speed * normal
        press = (self._stiffness * depth).reshape(-1, 1)
        push = -speed * (self._delay * self._stiffness * (depth.real > 0)).reshape(-1, 1)
        push = np.where(push.real < -press.real, -press, push)
        rough = np.sqrt((slip * slip).sum(-1, keepdims=True) + (self.slip_speed or 1.0) ** 2)
        return push * normal - self.friction * press / rough * slip
