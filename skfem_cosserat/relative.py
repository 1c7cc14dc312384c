"""Relative motion of two places: expressions at most quadratic in q, and coordinates made of them.

Everything a joint, a drive, a spring or a bushing needs of two places is a sum of products
``(sum c_a y_a) . (sum c_b y_b)`` of coordinate vectors. Such an invariant ``pi`` is objective, its
gradient is linear in q and the gradient at a midpoint its exact discrete derivative. A relative
coordinate ``xi`` is a function of one to four invariants.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .arguments import checked
from .frames import Place, ground, vector
from .frozen import Attached, Replacements
from .kernels import cross
from .types import Floats, finite

#: the ground at rest: its directors are the axes of space
ORIGIN = ground((0.0, 0.0, 0.0))


@dataclass(frozen=True, eq=False, repr=False)
class Expression(Attached):
    """A vector that is linear in the coordinates: sums and multiples of points and directions.

    For forces and joints of your own, made of :func:`point` and :func:`direction` by ``+``, ``-``,
    ``*`` and ``/`` with numbers.

    Attributes
    ----------
    terms : tuple of (Place, int, float)
        Place, row and factor: row 0 is phi of the place's vertex, 1 to 3 its directors.

    Raises
    ------
    InputError
        If anything else is added or subtracted, or a factor is no finite number.

    Examples
    --------
    A force on the difference of two points, a vector from one to the other:

    >>> import skfem_cosserat as sc
    >>> model = sc.Model()
    >>> sun = model.add("sun", sc.MassPoint(8.0))
    >>> moon = model.add("moon", sc.MassPoint(1.0, position=(2, 0, 0), velocity=(0, 1.5, 0)))
    >>> r = sc.point(moon.place()) - sc.point(sun.place())
    >>> pull = model.add("pull", sc.Force(r, energy=lambda r: -8 / np.sqrt((r * r).sum())))
    >>> history = sc.simulate(model, sc.EnergyMomentum(), sc.NullSpace(), 0.01, until=1.0)
    >>> bool(abs(history["energy"] - history["energy"][0]).max() < 1e-9)
    True
    """

    terms: tuple[tuple[Place, int, float], ...]
    #: arrays of numpy leave products to it
    __array_ufunc__ = None

    @checked
    def __add__(self, other: Expression) -> Expression:
        return Expression(self.terms + other.terms)

    @checked
    def __sub__(self, other: Expression) -> Expression:
        return self + -other

    def __neg__(self) -> Expression:
        return -1.0 * self

    def __mul__(self, factor: float) -> Expression:
        by = finite("expression", "factor", factor)
        return Expression(tuple((place, row, by * c) for place, row, c in self.terms))

    __rmul__ = __mul__

    @checked
    def __truediv__(self, divisor: float) -> Expression:
        return self * (1 / divisor)

    def with_replacements(self, replacements: Replacements) -> Expression:
        """Copy for other places: the same vector, by another frame fixed to the first one."""
        places = {id(place): place for place, _, _ in self.terms}
        others = {key: replacements.of(place) for key, place in places.items()}
        if all(place.same_frame(others[key]) for key, place in places.items()):
            return Expression(tuple((others[id(p)], row, c) for p, row, c in self.terms))
        terms = []
        for key, place in places.items():
            c = np.zeros(4)
            for p, row, x in self.terms:
                c[row] += x if p is place else 0.0
            terms += [
                (others[key], row, float(x))
                for row, x in enumerate(place.seen_from(others[key], c))
                if abs(x) > 1e-15
            ]
        return Expression(tuple(terms))


@checked
def point(place: Place) -> Expression:
    """``x = phi + X_i d_i`` of a place, for :class:`Expression`."""
    terms = [(place, 0, 1.0)]
    terms += [(place, i + 1, float(X)) for i, X in enumerate(place.offset) if X != 0]
    return Expression(tuple(terms))


@checked
def direction(place: Place, axis: Floats) -> Expression:
    """Direction that is fixed to a place and is `axis` in the reference configuration.

    For joints and forces of your own: `axis` is given by its components along the axes of space,
    whatever the triad of the place is. The direction turns with the triad afterwards.

    Parameters
    ----------
    place : Place
        Whose triad it turns with.
    axis : (3,) array
        Components in space, in the reference configuration. For the i-th director of the place
        that is ``place.triad[i - 1]``, not a unit vector such as (0, 0, 1).

    Returns
    -------
    Expression
        Of the directors of the place: ``n = n_i d_i``, for :class:`Product` and :class:`Zero`.

    Raises
    ------
    InputError
        If the place has no triad, or the axis is no vector.

    Examples
    --------
    A beam along the x axis has its third director there:

    >>> import skfem_cosserat as sc
    >>> mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 2, name="rod")
    >>> section = sc.Section([1e4, 1e4, 1e4, 5, 5, 5], mass=1.0, inertia=(1.0, 1.0))
    >>> end = sc.Beam(mesh, section, director=(0, 1, 0)).node("rod.end")
    >>> [(i, n) for _, i, n in direction(end, (1, 0, 0)).terms]
    [(3, 1.0)]
    >>> direction(end, end.triad[2]).terms == direction(end, (1, 0, 0)).terms
    True
    """
    return _of_directors(place, place.material(vector("direction", "axis", axis)).tolist())


def axes(place: Place) -> list[Expression]:
    """Three directions that are the axes of space in the reference configuration."""
    return [_of_directors(place, each) for each in place.material(np.eye(3)).T.tolist()]


def _of_directors(place: Place, components: list[float]) -> Expression:
    return Expression(tuple((place, i + 1, c) for i, c in enumerate(components) if abs(c) > 1e-15))


def normals(axis: Floats) -> Floats:
    """Two unit vectors m_1, m_2 (2, 3) normal to `axis` and to each other, ``m_1 x m_2 = n``."""
    first = cross(axis, np.eye(3)[np.argmin(abs(axis))])
    first /= np.linalg.norm(first)
    return np.array([first, cross(axis, first)])


@dataclass(frozen=True, eq=False, repr=False)
class Amplitude(Attached):
    """A number that is prescribed in time: a component of a ground place's position."""

    place: Place
    component: int


@dataclass(frozen=True, eq=False, repr=False)
class Zero(Attached):
    """Three rows: ``expression = 0``."""

    expression: Expression
    size = 3


@dataclass(frozen=True, eq=False, repr=False)
class Product(Attached):
    """``factor * amplitude * (left . right)``; `amplitude` is 1 unless prescribed in time."""

    left: Expression
    right: Expression
    factor: float = 1.0
    amplitude: Amplitude | None = None
    size = 1


#: A sum of products; as a constraint row: the sum keeps its reference value.
Form = tuple[Product, ...]


@dataclass(frozen=True, eq=False, repr=False)
class RelativeCoordinate(Attached):
    """A relative coordinate of two places as a function of quadratic invariants.

    Attributes
    ----------
    name : str
        Such as "angle" or "displacement".
    kind : {"angle", "displacement", "distance", "radius", "rotation", "position", "height"}
        ``atan2(pi_2, pi_1)``; ``pi_1`` less its reference value; ``sqrt(pi_1)``; ``|pi|``; the
        rotation vector of which ``pi_1..3`` is the sine times the axis and ``pi_4`` the cosine; the
        last two ``pi_1``.
    forms : tuple of sums of products
        The invariants.
    """

    name: str
    kind: str
    forms: tuple[Form, ...]

    def __repr__(self) -> str:
        return f"<{self.kind} {self.name!r}>"

    @property
    def size(self) -> int:
        """Number of components: 3 for a rotation vector, else 1."""
        return 3 if self.kind == "rotation" else 1


def angle(
    name: str, a: Place, b: Place, axis: Floats, side: str = "a", across: Floats | None = None
) -> RelativeCoordinate:
    """Angle from side a to side b about an axis, zero in the reference.

    The axis n is material in `side`. `across` is a direction normal to n that side b (a if `side`
    is "b") keeps normal to it: the other axis of a universal joint. By default both sides have n in
    common and any two directions m_1, m_2 normal to it give the angle. Cosine and sine are then
    means over both, ``(m_1^A . m_1^B + m_2^A . m_2^B)/2`` and
    ``(m_2^A . m_1^B - m_1^A . m_2^B)/2``: these are the same for all m_1, m_2, also at midpoints,
    where triads are not orthonormal. One direction alone would make the motion of variational
    schemes depend on which one is picked.
    """
    first = normals(axis)[0] if across is None else across
    second = cross(axis, first)
    if side == "b":
        a, b, second = b, a, -second
    turned = direction(b, first)
    if across is not None:
        cosine = Product(direction(a, first), turned)
        sine = Product(direction(a, second), turned)
        return RelativeCoordinate(name, "angle", ((cosine,), (sine,)))
    other = direction(b, second)
    cosines = (
        Product(direction(a, first), turned, 0.5),
        Product(direction(a, second), other, 0.5),
    )
    sines = (
        Product(direction(a, second), turned, 0.5),
        Product(direction(a, first), other, -0.5),
    )
    return RelativeCoordinate(name, "angle", (cosines, sines))


def displacement(name: str, a: Place, b: Place, axis: Floats) -> RelativeCoordinate:
    """``n^A . (x_b - x_a)`` less its reference value."""
    form = (Product(direction(a, axis), point(b) - point(a)),)
    return RelativeCoordinate(name, "displacement", (form,))


def position(name: str, of: Place | Expression) -> tuple[RelativeCoordinate, ...]:
    """Components in space of a point, or of another vector that is linear in q."""
    vector = point(of) if isinstance(of, Place) else of
    forms = (((Product(axis, vector),),) for axis in axes(ORIGIN))
    return tuple(
        RelativeCoordinate(f"{name}_{k}", "position", form)
        for k, form in zip("xyz", forms, strict=True)
    )


def distance(name: str, a: Place, b: Place) -> RelativeCoordinate:
    """``|x_b - x_a|``."""
    r = point(b) - point(a)
    return RelativeCoordinate(name, "distance", ((Product(r, r),),))


def rotation(name: str, a: Place, b: Place) -> RelativeCoordinate:
    """Rotation vector from side a to side b, components along the reference axes of space.

    With ``D_ij = e_i^A . e_j^B`` (both triads parallel to space in the reference) the invariants
    are ``sin(theta) n_k = eps_kij D_ji / 2`` and ``cos(theta) = (tr D - 1)/2``; the constant is
    left out of the form.
    """
    A = axes(a)
    B = axes(b)
    sines = tuple(
        (
            Product(A[(k + 2) % 3], B[(k + 1) % 3], 0.5),
            Product(A[(k + 1) % 3], B[(k + 2) % 3], -0.5),
        )
        for k in range(3)
    )
    cosine = tuple(Product(A[k], B[k], 0.5) for k in range(3))
    return RelativeCoordinate(name, "rotation", (*sines, cosine))
