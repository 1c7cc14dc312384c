"""Rigid bodies and mass points: one-node structures with a constant mass matrix (64)."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Self

import numpy as np

from .errors import InputError
from .frames import REPLACED, Place, StructuralItem, Vertices, check_triad, no_place, vector
from .frozen import Replacements
from .types import ArrayLike, Floats, numbers, positive, shaped, symmetric


class _Lump(StructuralItem):
    """Shared by bodies and mass points: mass, placement, or attachment to another item."""

    def __init__(
        self,
        mass: float,
        on: Place | None,
        position: ArrayLike | None,
        velocity: ArrayLike | None,
        **others: ArrayLike | None,
    ):
        self.mass = positive(self.label, "mass", mass)
        if on is not None and not isinstance(on, Place):
            raise InputError(self.label, f"on is {no_place(on)}")
        if on is not None and (on.item is None or on.triad is None):
            raise InputError(self.label, f"cannot be attached to {on.label}: needs a triad")
        if on is not None:
            for name, value in {"position": position, "velocity": velocity, **others}.items():
                if value is not None:
                    raise InputError(
                        self.label,
                        f"{name} = {value!r} together with on = {on.label}: it moves with it",
                    )
            position = on.position
        self.position = vector(
            self.label, "position", np.zeros(3) if position is None else position
        )
        self.velocity = vector(
            self.label, "velocity", np.zeros(3) if velocity is None else velocity
        )
        self.on = on

    @property
    def _carrier(self) -> Floats | None:
        """Triad of the place that it is attached to."""
        return None if self.on is None else self.on.triad

    def references(self) -> list[StructuralItem]:
        """Item that it is attached to, if any."""
        return [] if self.on is None or self.on.item is None else [self.on.item]

    def _parts(self) -> Iterator[tuple[str, Any]]:
        moved = ("velocity", "angular_velocity") if self.on is not None else ()  # by the place
        yield from (part for part in super()._parts() if part[0] not in moved)

    def scalar_mass(self) -> Floats:
        """Mass matrix of (phi, d1, d2, d3) without the factor I_3: (4, 4) or (1, 1)."""
        raise NotImplementedError


class MassPoint(_Lump):
    """Mass point: 3 coordinates, or a lump on a beam node or body without own coordinates.

    Parameters
    ----------
    mass : float
        (kg)
    position, velocity : (3,) array, optional
        Initial position (m) and velocity (m/s), zero by default.
    on : Place, optional
        Attach rigidly to this place: its mass is added there, and it has no position or velocity
        of its own.

    Raises
    ------
    InputError
        For a mass that is not positive and finite, wrong shapes, or a place without a triad.

    Examples
    --------
    >>> MassPoint(5.0, position=(0, 1, 0)).place().position.tolist()
    [0.0, 1.0, 0.0]
    """

    kind = "mass point"
    where = "point.place()"

    def __init__(
        self,
        mass: float,
        position: ArrayLike | None = None,
        velocity: ArrayLike | None = None,
        on: Place | None = None,
    ):
        super().__init__(mass, on, position, velocity)

    def vertices(self) -> Vertices | None:
        """One point, unless attached."""
        if self.on is not None:
            return None
        return Vertices(self.position[None], None, self.velocity[None], np.zeros((1, 3)))

    def place(self) -> Place:
        """The point itself (where it is attached, if it is), for joints and loads.

        Examples
        --------
        >>> cube = RigidBody.box(1.0, (1, 1, 1))
        >>> MassPoint(0.1, on=cube.at((0.5, 0, 0))).place().label
        'rigid body at [0.5, 0.0, 0.0]'
        """
        if self.on is not None:
            return self.on
        return Place(self, 0, self.position, np.zeros(3), None)

    def scalar_mass(self) -> Floats:
        """Mass matrix without the factor I_3: of phi, or of the frame that it is attached to."""
        if self.on is None:
            return np.array([[self.mass]])
        X = np.concatenate([[1.0], self.on.offset])
        return self.mass * np.outer(X, X)


class RigidBody(_Lump):
    """Rigid body as one-node structure: 12 coordinates ``(phi, d1, d2, d3)``.

    Parameters
    ----------
    mass : float
        (kg)
    inertia : (3,) or (3, 3) array, optional
        Moments of inertia ``J`` about the *centre of mass* in the body frame (kg m^2): principal
        values, or the full tensor. Its Euler tensor ``E = (tr J/2) I - J`` must be positive
        semidefinite, else no mass distribution has it.
    euler : (3,) array, optional
        Instead of `inertia`: ``E_i = int rho X_i^2 dV`` about the centre of mass, (64). Zeros are
        allowed where joints determine the triad (a thin rod).
    position : (3,) array, optional
        Reference point phi (m); default: the origin.
    triad : (3, 3) array, optional
        Rows d1, d2, d3 (default: identity; attached, the triad of its place).
    center : (3,) array
        Centre of mass in the body frame, relative to the reference point (m).
    velocity, angular_velocity : (3,) array, optional
        Of the reference point (m/s); in space (rad/s). Zero by default.
    surface : (points, faces), optional
        Material coordinates (nv, 3) and triangles (nf, 3), for pictures only.
    on : Place, optional
        Attach rigidly to this place: the inertia is added there (in the triad of that node), no
        coordinates are added, and position, triad and velocities are those of the place.

    Raises
    ------
    InputError
        Naming the value: an impossible inertia, a triad that is not right-handed orthonormal, a
        placement together with `on`, wrong shapes, numbers that are not finite.

    Examples
    --------
    >>> body = RigidBody.box(2.0, (1.0, 2.0, 3.0))
    >>> body.euler.diagonal().round(4).tolist()
    [0.1667, 0.6667, 1.5]
    """

    kind = "rigid body"
    _remedy = REPLACED
    #: radius (m) of a sphere about the reference point, else zero
    ball = 0.0

    def __init__(
        self,
        mass: float,
        inertia: ArrayLike | None = None,
        *,
        euler: ArrayLike | None = None,
        position: ArrayLike | None = None,
        triad: ArrayLike | None = None,
        center: ArrayLike = (0.0, 0.0, 0.0),
        velocity: ArrayLike | None = None,
        angular_velocity: ArrayLike | None = None,
        surface: tuple[ArrayLike, ArrayLike] | None = None,
        on: Place | None = None,
    ):
        super().__init__(
            mass, on, position, velocity, triad=triad, angular_velocity=angular_velocity
        )
        own = self._carrier if triad is None else check_triad(self.label, triad)
        self.triad = np.eye(3) if own is None else own
        self.center = vector(self.label, "center", center)
        self.angular_velocity = vector(
            self.label,
            "angular_velocity",
            np.zeros(3) if angular_velocity is None else angular_velocity,
        )
        self.euler = self._euler_tensor(inertia, euler)
        self.surface = None if surface is None else self._checked_surface(*surface)

    def _parts(self) -> Iterator[tuple[str, Any]]:
        yield from (part for part in super()._parts() if part[0] != "surface")

    def _euler_tensor(self, inertia: ArrayLike | None, euler: ArrayLike | None) -> Floats:
        if (inertia is None) == (euler is None):
            raise InputError(self.label, "give either inertia or euler, not both and not neither")
        name = "inertia" if euler is None else "euler"
        value = shaped(self.label, name, inertia if euler is None else euler, (3,), (3, 3))
        if value.ndim == 1:
            value = np.diag(value)
        value = symmetric(self.label, name, value)
        E = value if euler is not None else value.trace() / 2 * np.eye(3) - value
        lowest = float(np.linalg.eigvalsh(E)[0])
        if lowest < -1e-12 * abs(value).max():
            raise InputError(
                self.label,
                f"{name} = {np.diag(value).tolist()} is impossible: no mass distribution has it "
                f"(its Euler tensor has the eigenvalue {lowest:.3g}; each principal moment must"
                " not exceed the sum of the other two, and none may be negative)",
            )
        return E

    def _checked_surface(self, points: ArrayLike, faces: ArrayLike) -> tuple[Floats, Any]:
        x = numbers(self.label, "surface points", points)
        triangles = np.array(faces)
        if x.ndim != 2 or x.shape[1] != 3 or not np.isfinite(x).all():
            raise InputError(
                self.label, f"surface points of shape {x.shape}, expected finite numbers (nv, 3)"
            )
        if triangles.ndim != 2 or triangles.shape[1] != 3 or triangles.dtype.kind not in "iu":
            raise InputError(
                self.label, f"surface faces of shape {triangles.shape}, expected integers (nf, 3)"
            )
        wrong = triangles[(triangles < 0) | (triangles >= len(x))]
        if len(wrong):
            raise InputError(self.label, f"surface faces name point {wrong[0]} of {len(x)}")
        return x, triangles

    # -- shapes ------------------------------------------------------------------------------

    @classmethod
    def box(cls, mass: float, edges: ArrayLike, **options: Any) -> RigidBody:
        """Solid box of uniform density, reference point at its centre.

        Parameters
        ----------
        mass : float
            (kg)
        edges : (3,) array
            Lengths along d1, d2, d3 (m).
        **options
            As for :class:`RigidBody`: position, triad, velocity, angular_velocity, on.

        Raises
        ------
        InputError
            If mass or lengths are not positive and finite.

        Examples
        --------
        >>> RigidBody.box(12.0, (1, 2, 3)).euler.diagonal().tolist()
        [1.0, 4.0, 9.0]
        """
        a = vector("rigid body (box)", "edges", edges)
        _lengths("box", **{f"edges[{k}]": length for k, length in enumerate(a.tolist())})
        corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * a / 2
        return cls(mass, euler=mass * a**2 / 12, surface=(corners, _BOX), **options)

    @classmethod
    def cylinder(cls, mass: float, radius: float, length: float, **options: Any) -> RigidBody:
        """Solid cylinder along d3 of uniform density, reference point at its centre.

        Parameters
        ----------
        mass : float
            (kg)
        radius, length : float
            (m)
        **options
            As for :meth:`box`, and so are the errors.

        Examples
        --------
        >>> RigidBody.cylinder(12.0, radius=1.0, length=2.0).euler.diagonal().tolist()
        [3.0, 3.0, 4.0]
        """
        r, l = _lengths("cylinder", radius=radius, length=length)  # noqa: E741
        E = mass * np.array([r**2 / 4, r**2 / 4, l**2 / 12])
        return cls(mass, euler=E, surface=_prism(r, l, 24), **options)

    @classmethod
    def sphere(cls, mass: float, radius: float, **options: Any) -> RigidBody:
        """Solid sphere of uniform density, reference point at its centre.

        Parameters
        ----------
        mass : float
            (kg)
        radius : float
            (m)
        **options
            As for :meth:`box`, and so are the errors.

        Examples
        --------
        >>> RigidBody.sphere(5.0, radius=2.0).euler.diagonal().tolist()
        [4.0, 4.0, 4.0]
        """
        (r,) = _lengths("sphere", radius=radius)
        out = cls(mass, euler=np.full(3, mass * r**2 / 5), surface=ball_surface(r), **options)
        vars(out)["ball"] = r
        return out

    @classmethod
    def pyramid(cls, mass: float, edge: float, height: float, **options: Any) -> RigidBody:
        """Solid square pyramid, apex towards +d3, reference point at its centre of mass.

        Parameters
        ----------
        mass : float
            (kg)
        edge : float
            Of the base, whose edges are parallel to d1 and d2 (m).
        height : float
            (m); the centre of mass is a quarter of it above the base.
        **options
            As for :meth:`box`, and so are the errors.

        Examples
        --------
        >>> points, faces = RigidBody.pyramid(1.0, edge=1.0, height=2.0).surface
        >>> points[-1].tolist()   # the apex
        [0.0, 0.0, 1.5]
        """
        a, h = _lengths("pyramid", edge=edge, height=height)
        E = mass * np.array([a**2 / 20, a**2 / 20, 3 * h**2 / 80])
        base = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * a / 2
        points = np.vstack([np.c_[base, np.full(4, -h / 4)], [0, 0, 3 * h / 4]])
        faces = np.array([[0, 2, 1], [0, 3, 2], [0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]])
        return cls(mass, euler=E, surface=(points, faces), **options)

    @classmethod
    def rod(cls, mass: float, length: float, **options: Any) -> RigidBody:
        """Thin rod along d3: no inertia about its own axis, which joints must hold.

        Parameters
        ----------
        mass : float
            (kg)
        length : float
            (m); the reference point is at its middle.
        **options
            As for :meth:`box`, and so are the errors.

        Examples
        --------
        >>> RigidBody.rod(12.0, length=2.0).euler.diagonal().tolist()
        [0.0, 0.0, 4.0]
        """
        (l,) = _lengths("rod", length=length)  # noqa: E741
        E = np.array([0.0, 0.0, mass * l**2 / 12])
        return cls(mass, euler=E, surface=_prism(l / 50, l, 8), **options)

    # -- protocol ----------------------------------------------------------------------------

    def vertices(self) -> Vertices | None:
        """One frame, unless attached."""
        if self.on is not None:
            return None
        return Vertices(
            self.position[None],
            self.triad[None],
            self.velocity[None],
            self.angular_velocity[None],
        )

    def at(self, position: ArrayLike) -> Place:
        """The material point that is at a given position in the reference configuration.

        Parameters
        ----------
        position : (3,) array
            In space (m); it need not lie inside of the body.

        Returns
        -------
        Place
            For joints, loads and what is attached.

        Raises
        ------
        InputError
            If `position` is not three finite numbers.

        Examples
        --------
        >>> body = RigidBody.box(1.0, (1, 1, 1), position=(2, 0, 0))
        >>> body.at((2.5, 0, 0)).offset.tolist()
        [0.5, 0.0, 0.0]
        """
        x = vector(self.label, "position", position)
        if self.on is not None:
            assert self.on.triad is not None  # checked at construction
            offset = self.on.offset + self.on.triad @ (x - self.on.position)
            return Place(self.on.item, self.on.vertex, x, offset, self.on.triad)
        return Place(self, 0, x, self.triad @ (x - self.position), self.triad)

    def local(self, X: ArrayLike) -> Place:
        """The material point with given coordinates in the body frame, (54).

        Parameters
        ----------
        X : (3,) array
            Components along d1, d2, d3 from the reference point (m).

        Returns
        -------
        Place
            For joints, loads and what is attached.

        Raises
        ------
        InputError
            If `X` is not three finite numbers.

        Examples
        --------
        >>> body = RigidBody.box(1.0, (1, 1, 1), position=(2, 0, 0))
        >>> body.local((0.5, 0, 0)).position.tolist()
        [2.5, 0.0, 0.0]
        """
        return self.at(self.position + vector(self.label, "X", X) @ self.triad)

    def counterpart(self, place: Place) -> Place:
        """Place on this body at the same position, also for a node of a beam that it replaces."""
        return self.at(place.position)

    def with_replacements(self, replacements: Replacements) -> Self:
        """Copy for other items; attached, with its numbers in the triad of its new place."""
        other = super().with_replacements(replacements)
        turn = None if self.on is None or other.on is None else self.on.turn_to(other.on)
        if turn is not None:
            other.center = turn @ self.center
            other.euler = turn @ self.euler @ turn.T
        if other._carrier is not None:
            other.triad = other._carrier
        return other

    def scalar_mass(self) -> Floats:
        """Mass matrix without the factor I_3 (4, 4); attached, about the reference point there."""
        center = self.center if self.on is None else self.on.offset + self.center
        out = np.empty((4, 4))
        out[0, 0] = self.mass
        out[0, 1:] = out[1:, 0] = self.mass * center
        out[1:, 1:] = self.euler + self.mass * np.outer(center, center)
        return out


def _lengths(shape: str, **values: float) -> list[float]:
    return [positive(f"rigid body ({shape})", name, value) for name, value in values.items()]


_BOX = np.array(
    [
        [0, 1, 3],
        [0, 3, 2],
        [4, 6, 7],
        [4, 7, 5],
        [0, 4, 5],
        [0, 5, 1],
        [2, 3, 7],
        [2, 7, 6],
        [0, 2, 6],
        [0, 6, 4],
        [1, 5, 7],
        [1, 7, 3],
    ]
)


def _revolved(radii: Floats, heights: Floats, end: float, sides: int) -> tuple[Floats, Any]:
    """Points (nv, 3) and triangles (nf, 3) of rings about d3 from the top, closed at +-`end`."""
    turn = 2 * np.pi * np.arange(sides) / sides
    i = np.arange(sides)
    ring = np.column_stack([np.cos(turn), np.sin(turn)])
    rings = [np.c_[r * ring, np.full(sides, z)] for r, z in zip(radii, heights, strict=True)]
    points = np.vstack([*rings, [[0, 0, end], [0, 0, -end]]])
    j = (i + 1) % sides
    last = sides * (len(rings) - 1)
    top = np.full(sides, len(points) - 2)
    faces = [(top, i, j), (np.full(sides, len(points) - 1), j + last, i + last)]
    for k in range(0, last, sides):
        faces += [(i + k, i + k + sides, j + k + sides), (i + k, j + k + sides, j + k)]
    return points, np.vstack([np.column_stack(face) for face in faces])


def _prism(r: float, length: float, sides: int) -> tuple[Floats, Any]:
    half = length / 2
    return _revolved(np.array([r, r]), np.array([half, -half]), half, sides)


def ball_surface(r: float, rings: int = 8, sides: int = 16) -> tuple[Floats, Any]:
    """Points (nv, 3) and triangles (nf, 3) of a ball of radius r (m), for pictures."""
    angle = np.pi * np.arange(1, rings) / rings
    return _revolved(r * np.sin(angle), r * np.cos(angle), r, sides)
