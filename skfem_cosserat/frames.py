"""Places of items and of the ground, frames, and prescribed motions."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Self, TypeGuard

import numpy as np

from .arguments import checked
from .errors import InputError, failed
from .frozen import Attached, Frozen, Replacements
from .kernels import cross, exp_quaternion, rotation_matrix
from .types import TOLERANCE, ArrayLike, Floats, finite, numbers, shaped, switch

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

    from .beam import Beam

# -- places: the material points on which joints and loads act, on items or on the ground ----------
#
# A beam node and a rigid body are the same thing, a *one-node structure*: a placement ``phi`` and
# an orthonormal triad ``d1, d2, d3`` (equation (55)); a material point is ``x = phi + X_i d_i``
# (54).

#: what to do instead of changing a beam or body
REPLACED = "make another one: model.with_items({name: ...}) is the model with it"


def vector(item: str, name: str, value: ArrayLike) -> Floats:
    """Three finite numbers, or an error naming item and argument."""
    return shaped(item, name, value, (3,))


def unit_vector(item: str, name: str, value: ArrayLike) -> Floats:
    """A vector of length 1, or an error naming its length."""
    array = vector(item, name, value)
    length = float(np.linalg.norm(array))
    if abs(length - 1) > 1e-8:
        raise InputError(
            item, f"{name} = {array.tolist()} has length {length:.9g}, expected a unit vector"
        )
    return array / length


@checked
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
    hint = np.eye(3)[abs(third).argmin()] if d1 is None else vector("triad", "d1", d1)
    first = hint - (hint @ third) * third
    length = float(np.linalg.norm(first))
    if length <= 1e-6 * np.linalg.norm(hint):
        raise InputError("triad", f"hint d1 = {hint.tolist()} is parallel to d3 = {third.tolist()}")
    first /= length
    return np.array([first, cross(third, first), third])


def check_triad(item: str, value: ArrayLike) -> Floats:
    """A (3, 3) right-handed orthonormal triad, rows d1, d2, d3."""
    array = shaped(item, "triad", value, (3, 3))
    error = float(abs(array @ array.T - np.eye(3)).max())
    if not error < TOLERANCE or np.linalg.det(array) < 0:
        raise InputError(
            item, f"triad {array.tolist()} is not right-handed orthonormal (error {error:.3g})"
        )
    return array


@dataclass(frozen=True, eq=False, repr=False)
class Motion(Frozen):
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
        super().__post_init__()

    def frame(self, place: Place, t: float) -> Floats:
        """Rows ``(x, d1, d2, d3)`` (4, 3) of a ground place at time ``t``."""
        item = f"prescribed motion of the {place.label}"
        out = np.empty((4, 3))
        out[0] = place.position
        if self.displacement is not None:
            out[0] += self._value(item, "displacement", self.displacement, t)
        out[1:] = np.eye(3)
        if self.rotation is not None:
            theta = self._value(item, "rotation", self.rotation, t)
            out[1:] = rotation_matrix(exp_quaternion(theta)).T
        return out

    @staticmethod
    def _value(item: str, name: str, function: Callable[[float], ArrayLike], t: float) -> Floats:
        try:
            out = function(t)
        except Exception as error:
            raise failed(item, f"{name}(t)", error, t) from error
        return vector(item, f"{name}({t!r})", out)


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
    """Base of all that a model is made of; an item gets its name when it is added to a model."""

    kind = "item"
    name: str | None = None
    _remedy = "make another one, and a model with it"

    @property
    def label(self) -> str:
        """Name in messages: its kind, and its name in the model."""
        return self.kind if self.name is None else f"{self.kind} {self.name!r}"

    @property
    def _called(self) -> str:
        return self.label

    def _brief(self) -> str:
        return self.label

    def __repr__(self) -> str:
        own = "" if self.name is None else f" {self.name!r}"
        shown = self._shown()
        return f"<{type(self).__name__}{own}{shown and ': '}{shown}>"

    def references(self) -> Sequence[Item]:
        """Items it is attached to or acts on: they must be in the same model."""
        return []

    def with_replacements(self, replacements: Replacements) -> Self:
        """Copy that refers to the replacements; it is in no model yet."""
        other = super().with_replacements(replacements)
        other.name = None
        return other


class StructuralItem(Item):
    """An item with coordinates, or with inertia lumped on the place of another one."""

    #: how its places are got
    where = "body.at(x)"

    def counterpart(self, place: Place) -> Place:
        """Place of this item for the same material point, where this item replaces that of `place`.

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
    """Base of items modelled by elements along a line: beams.

    Known here, so that who asks for beams needs not import them, nor meshes and elements.
    """

    _remedy = REPLACED
    where = "beam.node('tip')"


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

    def with_replacements(self, replacements: Replacements) -> Place:
        """Place of the item that replaces its own; places of the ground stay the same."""
        return self if self.item is None else replacements.of(self.item).counterpart(self)

    def at(self, t: float) -> Floats:
        """Position (3,) at time `t` (s) with everything but prescribed motion at rest."""
        return self.position if self.motion is None else self.motion.frame(self, t)[0]

    @property
    def origin(self) -> Floats:
        """Reference position of its vertex, phi (m)."""
        return self.position if self.triad is None else self.position - self.offset @ self.triad

    def same_frame(self, other: Place) -> bool:
        """True if phi and the triads of both are the same in the reference."""
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
        """Name in messages: its item and its position."""
        where = "ground" if self.item is None else self.item.label
        return f"{where}{self.note} at {self.position.round(9).tolist()}"

    @property
    def _called(self) -> str:
        return f"place {self.label}"

    def __repr__(self) -> str:
        return f"<Place: {self.label}>"

    def _brief(self) -> str:
        return self.label

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


def no_place(value: object) -> str:
    """Text of an error for a value that should be a place: what it is, and how to get one."""
    if isinstance(value, StructuralItem):
        return f"the {value.label}, expected a place on it: {value.where}"
    return (
        f"{value!r}, expected a place such as beam.node('tip'), body.at(x), point.place() or"
        " ground(x)"
    )


def check_sides(
    item: str, a: Place, b: Place, framed: Collection[str] = (), instead: str = ""
) -> None:
    """Raise InputError unless an item can connect two places.

    Those of the sides `framed` need a triad; `instead` says what to take for mass points.
    """
    for side, place in (("a", a), ("b", b)):
        if not isinstance(place, Place):
            raise InputError(item, f"side {side} is {no_place(place)}")
        if side in framed and place.triad is None:
            text = f"side {side} is {place.label}: a mass point has no directions, use {instead}"
            raise InputError(item, text)
    if a.item is None and b.item is None:
        raise InputError(item, "both sides are ground")
    if a.item is b.item and a.vertex == b.vertex:
        text = f"both sides are {a.label}"
        if is_beam(a.item):
            text += ": it needs two nodes there, as from mesh.joined(other, weld=False)"
        raise InputError(item, text)


def with_frame(place: Place) -> Place:
    """The place, if it is one and has a frame; or an error."""
    if not isinstance(place, Place):
        raise InputError("argument place", f"is of type {type(place).__name__}, expected a Place")
    if place.triad is None:
        raise InputError(place.label, "a mass point has no directors: it does not rotate")
    return place


@checked
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


# -- kinds of items, told apart without importing what a scene does not have -----------------------


def check_beam(item: str, beam: object) -> None:
    """Raise InputError unless it is a beam."""
    if not is_beam(beam):
        what = beam.label if isinstance(beam, Item) else type(beam).__name__
        raise InputError(item, f"acts on {what}, expected a beam")


def is_beam(item: object) -> TypeGuard[Beam]:
    """True if an item is a beam; scenes without one import neither beams nor meshes.

    Examples
    --------
    >>> from skfem_cosserat import MassPoint
    >>> is_beam(MassPoint(1.0))
    False
    """
    return isinstance(item, LineItem)


# --------------------------------------------------------------------------------------------------
# Ready motions of the ground: turning about an axis, and shaking by a record of accelerations.


class MotionTurn(Motion):
    """The ground turns about an axis: a hub, a rotating frame.

    All places with the same motion move as one rigid frame, whatever their position.

    Parameters
    ----------
    axis : (3,) array
        Unit vector.
    angle : callable
        ``t -> float`` (rad), zero at the start; a :class:`RampSmooth` for instance.
    centre : (3,) array
        A point of the axis (m).

    Raises
    ------
    InputError
        If the axis is no unit vector, or `angle` cannot be called or (when it is needed) gives no
        finite number.

    Examples
    --------
    >>> from skfem_cosserat import ground
    >>> spin = MotionTurn(axis=(0, 0, 1), angle=lambda t: np.pi * t)
    >>> spin.frame(ground((2.0, 0, 0.5), spin), 0.5)[0].round(12).tolist()
    [0.0, 2.0, 0.5]
    """

    axis: Floats
    angle: Callable[[float], float]
    centre: Floats

    def __init__(
        self,
        axis: ArrayLike,
        angle: Callable[[float], float],
        centre: ArrayLike = (0.0, 0.0, 0.0),
    ):
        super().__init__()
        item = "turning motion"
        if not callable(angle):
            raise InputError(item, f"angle = {angle!r}, expected a function of time")
        self.__dict__.update(
            axis=unit_vector(item, "axis", axis), angle=angle, centre=vector(item, "centre", centre)
        )

    def frame(self, place: Place, t: float) -> Floats:
        """Rows ``(x, d1, d2, d3)`` (4, 3) of a ground place turned by the angle at time ``t``."""
        item = f"turning motion of the {place.label}"
        value = finite(item, "angle", self.angle(t), f"a finite number at t = {t!r}")
        R = rotation_matrix(exp_quaternion(value * self.axis))
        out = np.empty((4, 3))
        out[0] = self.centre + R @ (place.position - self.centre)
        out[1:] = R.T
        return out


class MotionShake(Motion):
    """The ground moves by a record of accelerations, as an earthquake's, from rest.

    The accelerations are linear between the instants of the record and integrated twice exactly;
    before the record the ground is at rest, after it it goes on with its last velocity. Give every
    place that is fixed to the ground the same motion: supports that stay behind are pulled apart
    (where nothing between them can give, that is an error).

    Parameters
    ----------
    times : (k,) array
        Increasing instants (s).
    accelerations : (k, 3) array
        In space (m/s^2).
    baseline : bool
        Take off the straight line (constant and linear in time) of the accelerations that leaves
        the ground at rest where it was at the end: records of instruments drift.

    Raises
    ------
    InputError
        If shapes differ, instants do not increase, or something is not finite.

    Examples
    --------
    >>> from skfem_cosserat import ground
    >>> t = np.linspace(0, 1, 101)
    >>> shake = MotionShake(t, np.outer(np.cos(2 * np.pi * t), (1.0, 0, 0)))
    >>> x = shake.frame(ground((0, 0, 0), shake), 0.5)[0, 0]
    >>> round(float(x), 4), round(2 / (2 * np.pi) ** 2, 4)   # with the record's kinks, without
    (0.0506, 0.0507)
    """

    times: Floats
    accelerations: Floats
    _path: BSpline

    def __init__(self, times: ArrayLike, accelerations: ArrayLike, baseline: bool = False):
        super().__init__()
        item = "shaking motion"
        t = numbers(item, "times", times)
        a = numbers(item, "accelerations", accelerations)
        if t.ndim != 1 or len(t) < 2 or a.shape != (len(t), 3):
            raise InputError(
                item,
                f"times {t.shape} and accelerations {a.shape}, expected (k,) and (k, 3), k >= 2",
            )
        if not (np.isfinite(t).all() and np.isfinite(a).all()):
            raise InputError(item, "times or accelerations are not finite")
        if (np.diff(t) <= 0).any():
            bad = (np.diff(t) <= 0).argmax()
            raise InputError(item, f"times do not increase: {t[bad]} is followed by {t[bad + 1]}")
        if switch(item, baseline, "baseline"):
            path = _integrated(t, a)
            a = a - _drift(t, path(t[-1]), path(t[-1], 1))
        self.__dict__.update(times=t, accelerations=a, _path=_integrated(t, a))

    def frame(self, place: Place, t: float) -> Floats:
        """Rows ``(x, d1, d2, d3)`` (4, 3) of a ground place that shakes, at time ``t``."""
        out = np.vstack([place.position, np.eye(3)])
        if t > self.times[0]:
            last = min(t, self.times[-1])
            out[0] += self._path(last) + (t - last) * self._path(last, 1)
        return out


def _integrated(t: Floats, a: Floats) -> BSpline:
    """Displacement (3,), from rest, of accelerations (k, 3) that are linear in between."""
    from scipy.interpolate import make_interp_spline

    return make_interp_spline(t, a, k=1).antiderivative(2)


def _drift(t: Floats, x: Floats, v: Floats) -> Floats:
    """The straight line of accelerations (k, 3) that ends at x with velocity v."""
    T = t[-1] - t[0]
    s = (t - t[0])[:, None]
    # c + d s: velocity c T + d T^2/2, displacement c T^2/2 + d T^3/6
    c = 6 * x / T**2 - 2 * v / T
    return c + (6 * v / T**2 - 12 * x / T**3) * s
