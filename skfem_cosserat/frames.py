"""Places: the material points on which joints and loads act, on items or on the ground.

A beam node and a rigid body are the same thing, a *one-node structure*: a placement ``phi`` and
an orthonormal triad ``d1, d2, d3`` (equation (55)); a material point is ``x = phi + X_i d_i`` (54).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np

from .errors import InputError
from .kernels import exp_quaternion, rotation_matrix
from .twin import Attached, Twins
from .types import ArrayLike, Floats, numbers

__all__ = ["Item", "Motion", "Place", "Vertices", "ground", "triad"]

TOLERANCE = 1e-9  # of lengths and cosines in the reference configuration


def vector(item: str, name: str, value: ArrayLike) -> Floats:
    """Three finite numbers, or an error naming item and argument."""
    array = numbers(item, name, value)
    if array.shape != (3,):
        raise InputError(item, f"{name} has shape {array.shape}, expected (3,)")
    if not np.isfinite(array).all():
        raise InputError(item, f"{name} = {array.tolist()} is not finite")
    return array


def unit_vector(item: str, name: str, value: ArrayLike) -> Floats:
    """A vector of length 1, or an error naming its length."""
    array = vector(item, name, value)
    length = float(np.linalg.norm(array))
    if abs(length - 1) > 1e-8:
        raise InputError(
            item, f"{name} = {array.tolist()} has length {length:.9g}, expected a unit vector"
        )
    return array / length


def triad(d3: ArrayLike, d1: ArrayLike | None = None) -> Floats:
    """Right-handed orthonormal triad, rows ``d1, d2, d3``, from the direction of d3.

    Parameters
    ----------
    d3 : (3,) array
        Direction of the third director (any length).
    d1 : (3,) array, optional
        Hint for d1, orthogonalised against d3; by default the axis least parallel to d3.

    Returns
    -------
    (3, 3) array
        Row i is d_{i+1}.

    Raises
    ------
    InputError
        If d3 is zero or d1 parallel to it.

    Examples
    --------
    >>> triad((0, 0, 2.0), (1, 0, 0)).tolist()
    [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    """
    third = vector("triad", "d3", d3)
    length = float(np.linalg.norm(third))
    if length == 0:
        raise InputError("triad", "d3 is the zero vector")
    third /= length
    hint = np.eye(3)[np.argmin(abs(third))] if d1 is None else vector("triad", "d1", d1)
    first = hint - (hint @ third) * third
    length = float(np.linalg.norm(first))
    if length <= 1e-6 * np.linalg.norm(hint):
        raise InputError("triad", f"hint d1 = {hint.tolist()} is parallel to d3 = {third.tolist()}")
    first /= length
    return np.array([first, np.cross(third, first), third])


def check_triad(item: str, value: ArrayLike) -> Floats:
    """A (3, 3) right-handed orthonormal triad, rows d1, d2, d3."""
    array = numbers(item, "triad", value)
    if array.shape != (3, 3):
        raise InputError(item, f"triad has shape {array.shape}, expected (3, 3): rows d1, d2, d3")
    error = float(abs(array @ array.T - np.eye(3)).max())
    if not error < TOLERANCE or np.linalg.det(array) < 0:
        raise InputError(
            item, f"triad {array.tolist()} is not right-handed orthonormal (error {error:.3g})"
        )
    return array


@dataclass(frozen=True, eq=False)
class Motion:
    """Prescribed motion of a ground place in time.

    Parameters
    ----------
    displacement : callable, optional
        ``t -> (3,)`` (m), added to the reference position.
    rotation : callable, optional
        ``t -> (3,)`` rotation vector (rad) about the place's position. Spherical and distance
        joints do not feel it: they take up no direction of the ground.

    Raises
    ------
    InputError
        If one of them cannot be called, or (when it is needed) gives no three finite numbers.

    Examples
    --------
    >>> shake = Motion(displacement=lambda t: (0.01 * np.sin(t), 0.0, 0.0))
    >>> shake.frame(ground((0, 0, 1.0), shake), 0.0)[0].tolist()
    [0.0, 0.0, 1.0]
    """

    displacement: Callable[[float], ArrayLike] | None = None
    rotation: Callable[[float], ArrayLike] | None = None

    def __post_init__(self) -> None:
        for name, value in (("displacement", self.displacement), ("rotation", self.rotation)):
            if value is not None and not callable(value):
                raise InputError(
                    "prescribed motion", f"{name} = {value!r}, expected a function of time"
                )

    def frame(self, place: Place, t: float) -> Floats:
        """Rows ``(x, d1, d2, d3)`` (4, 3) of a ground place at time ``t``."""
        item = f"prescribed motion of the {place.label}"
        out = np.empty((4, 3))
        out[0] = place.position
        if self.displacement is not None:
            out[0] += vector(item, f"displacement({t!r})", self.displacement(t))
        out[1:] = np.eye(3)
        if self.rotation is not None:
            theta = vector(item, f"rotation({t!r})", self.rotation(t))
            out[1:] = rotation_matrix(exp_quaternion(theta)).T
        return out


@dataclass(eq=False)
class Vertices:
    """Reference state of an item's one-node structures or mass points.

    Attributes
    ----------
    positions : (N, 3) array
    triads : (N, 3, 3) array or None
        None for mass points (3 coordinates instead of 12).
    velocities, angular_velocities : (N, 3) array
        Initial velocities of phi (m/s) and spatial angular velocities (rad/s).
    """

    positions: Floats
    triads: Floats | None
    velocities: Floats
    angular_velocities: Floats

    def __len__(self) -> int:
        return len(self.positions)


class Item(Attached):
    """What a model is made of; gets its name when it is added to a model."""

    kind = "item"
    name: str | None = None

    @property
    def label(self) -> str:
        """How errors call it."""
        return self.kind if self.name is None else f"{self.kind} {self.name!r}"

    def references(self) -> Sequence[Item]:
        """Items it is attached to or acts on: they must be in the same model."""
        return []

    def twin(self, twins: Twins) -> Self:
        """See the base class; in no model yet."""
        other = super().twin(twins)
        other.name = None
        return other


class StructuralItem(Item):
    """An item with coordinates, or with inertia lumped on the place of another one."""

    def counterpart(self, place: Place) -> Place:
        """The same material point as a place of this item, which stands for that of `place`.

        Raises
        ------
        InputError
            If it has no such place.
        """
        return replace(place, item=self)

    def vertices(self) -> Vertices | None:
        """Its coordinates in the reference configuration; None if it is lumped on another item."""
        raise NotImplementedError


class LineItem(StructuralItem):
    """What is modelled by elements along a line: a beam.

    Known here, so that who asks for beams needs not import them, nor meshes and elements.
    """


@dataclass(frozen=True, eq=False)
class Place(Attached):
    """A material point of an item, or a point of the ground.

    Made by ``beam.node(name)``, ``body.at(x)``, ``body.local(X)``, ``point.place()`` and
    :func:`ground`.

    Attributes
    ----------
    item : StructuralItem or None
        None for the ground.
    vertex : int
        Which of the item's one-node structures.
    position : (3,) array
        Where it is in the reference configuration (m).
    offset : (3,) array
        Material coordinates ``X_i`` in the vertex' triad (m).
    triad : (3, 3) array or None
        The vertex' reference triad; None for a mass point.
    motion : Motion or None
        Prescribed motion of a ground place.
    note : str
        Added to the item's label in messages, e.g. the name of a node.

    Notes
    -----
    The point is ``x = phi + X_i d_i``, equation (54) of Leyendecker, Marsden & Ortiz (2008).

    Examples
    --------
    >>> from skfem_cosserat import RigidBody
    >>> corner = RigidBody.box(1.0, (1, 1, 1), position=(2, 0, 0)).at((2.5, 0.5, 0.5))
    >>> corner.offset.tolist(), corner.label
    ([0.5, 0.5, 0.5], 'rigid body at [2.5, 0.5, 0.5]')
    """

    item: StructuralItem | None
    vertex: int
    position: Floats
    offset: Floats
    triad: Floats | None
    motion: Motion | None = None
    note: str = field(default="")

    def twin(self, twins: Twins) -> Place:
        """See the base class; places of the ground have no other."""
        return self if self.item is None else twins.of(self.item).counterpart(self)

    @property
    def origin(self) -> Floats:
        """Where phi of its vertex is in the reference (m)."""
        return self.position if self.triad is None else self.position - self.offset @ self.triad

    def same_frame(self, other: Place) -> bool:
        """Whether phi and the triads of both are the same in the reference."""
        gap = abs(self.origin - other.origin).max()
        return self.turn_to(other) is None and gap <= TOLERANCE * abs(self.position).max()

    def seen_from(self, other: Place, factors: Floats) -> Floats:
        """Factors (4,) of phi and directors of `other` that give the same vector.

        As `factors` with those of this place: the same material point, in another frame that is
        fixed to this one.
        """
        if self.triad is None or other.triad is None:
            return factors
        vector = factors[0] * (self.origin - other.origin) + factors[1:] @ self.triad
        return np.append(factors[0], other.triad @ vector)

    def turn_to(self, other: Place) -> Floats | None:
        """Turns components in this place's triad to those in the other's; None: the same."""
        if self.triad is None or other.triad is None:
            return None
        turn = other.triad @ self.triad.T
        return None if abs(turn - np.eye(3)).max() < TOLERANCE else turn

    @property
    def label(self) -> str:
        """How errors call it."""
        where = "ground" if self.item is None else self.item.label
        return f"{where}{self.note} at {np.round(self.position, 9).tolist()}"

    def material(self, direction: Floats) -> Floats:
        """Components (3,) of a spatial reference direction (3,) in the vertex' triad.

        Raises
        ------
        InputError
            For a mass point, which has no triad.

        Examples
        --------
        >>> place = ground((0, 0, 0))
        >>> place.material(np.array([0.0, 0.0, 1.0])).tolist()
        [0.0, 0.0, 1.0]
        """
        if self.triad is None:
            raise InputError(self.label, "a mass point has no directions")
        return self.triad @ direction


def ground(position: ArrayLike, motion: Motion | None = None) -> Place:
    """A point of the ground, at rest or in prescribed motion.

    Parameters
    ----------
    position : (3,) array
        Reference position (m).
    motion : Motion, optional
        Prescribed motion in time.

    Raises
    ------
    InputError
        If the position is not three finite numbers, or `motion` no Motion.

    Examples
    --------
    >>> ground((0, 0, 1.0)).position.tolist()
    [0.0, 0.0, 1.0]
    """
    x = vector("ground", "position", position)
    if motion is not None and not isinstance(motion, Motion):
        raise InputError(f"ground at {x.tolist()}", f"motion = {motion!r}, expected a Motion")
    # the static ground is one frame at the origin; a moving place is a frame of its own
    return Place(None, -1, x, x if motion is None else np.zeros(3), np.eye(3), motion)
