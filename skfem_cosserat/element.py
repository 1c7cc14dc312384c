"""Nodal Lagrange elements, mostly on Gauss-Lobatto points, and the director element of them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.polynomial import Legendre
from skfem.element import ElementH1, ElementVector
from skfem.refdom import RefLine

from .errors import InputError
from .frozen import Frozen, lock_arrays
from .types import Array, ArrayLike, Floats, is_whole

#: the highest polynomial order of elements
HIGHEST = 8


def lobatto_nodes(order: int) -> Floats:
    """Gauss-Lobatto points of an element in increasing order.

    Parameters
    ----------
    order : int
        Polynomial order, 1 to 8.

    Returns
    -------
    (order + 1,)
        Reference coordinates in [0, 1].

    Raises
    ------
    InputError
        For any other order.

    Examples
    --------
    >>> lobatto_nodes(2).tolist()
    [0.0, 0.5, 1.0]
    """
    if not is_whole(order) or not 1 <= order <= HIGHEST:
        raise InputError("argument order", f"got {order!r}, expected a whole number from 1 to 8")
    slope = Legendre.basis(int(order)).deriv()
    inner = np.sort(slope.roots().real) if order > 1 else np.zeros(0)
    for _ in range(3):  # roots of companion matrices are not exact to the last digit
        inner = inner - slope(inner) / slope.deriv()(inner)
    inner = 0.5 * (inner - inner[::-1])
    return np.array([0.0, *(0.5 + 0.5 * inner), 1.0])


def gauss_rule(points: int) -> tuple[Floats, Floats]:
    """Gauss-Legendre rule on [0, 1].

    Parameters
    ----------
    points : int
        Number of points, exact for polynomials of degree ``2*points - 1``.

    Returns
    -------
    points, weights : (points,)

    Examples
    --------
    >>> x, w = gauss_rule(1)
    >>> x.tolist(), w.tolist()
    ([0.5], [1.0])
    """
    x, w = np.polynomial.legendre.leggauss(points)
    return 0.5 * (x + 1.0), 0.5 * w


@dataclass(frozen=True, eq=False)
class Tabulated:
    """Shape functions at the points of a quadrature rule on [0, 1]; arrays cannot be written to.

    Attributes
    ----------
    points, weights : (nq,)
        The rule.
    values, slopes : (p + 1, nq)
        Shape functions there, and their derivatives by the reference coordinate.
    """

    points: Floats
    weights: Floats
    values: Floats
    slopes: Floats

    def __post_init__(self) -> None:
        lock_arrays(self)


#: See :attr:`Interpolation.turn_limit`.
_TURN_LIMITS = (45.0, 87.4669, 103.9892, 141.1347, 165.001, 187.6487, 208.5281, 229.9277)


@dataclass(frozen=True, repr=False)
class Interpolation(Frozen):
    """Nodes and Gauss points of a beam element.

    Base of :class:`InterpolationLobatto`, which every beam has by default, and of
    :class:`InterpolationEquidistant`. Two of the same class and numbers are equal.

    Parameters
    ----------
    order : int
        Polynomial order p, 1 to 8.
    points : int, optional
        Gauss points of the strains; by default p: fewer leave mechanisms, more (full
        quadrature) lock.

    Raises
    ------
    InputError
        If the order is not possible or there are fewer Gauss points than it.
    """

    order: int
    points: int = 0

    def __post_init__(self) -> None:
        lobatto_nodes(self.order)
        points = self.points or self.order
        if not is_whole(points) or points < self.order:
            raise InputError(
                "argument points",
                f"{self.points!r} Gauss points at order {self.order}, expected {self.order} or"
                " more: fewer leave mechanisms",
            )
        object.__setattr__(self, "order", int(self.order))
        object.__setattr__(self, "points", int(points))
        super().__post_init__()

    @property
    def nodes(self) -> Floats:
        """Reference coordinates (p + 1,) of the nodes in [0, 1]."""
        raise NotImplementedError

    @property
    def turn_limit(self) -> float:
        """Angle (rad) between its ends up to which a straight element can be bent on its own.

        Further on its equilibrium under end moments is unstable: of a linear element the moment,
        EI sin(2 t)/(2 l), is largest at 45 degrees; of a quadratic one both halves cease to bend
        alike at 87; a cubic one has its largest moment at 104; of a quartic one the inner nodes
        are no longer held at 141, of orders 5 to 8 at 165, 188, 209 and 230. These are the angles
        with Lobatto nodes and p points (straight,
        without shear and extension); full quadrature changes them by less than 6 %, equidistant
        nodes by up to 17 %.
        """
        return float(np.radians(_TURN_LIMITS[self.order - 1]))

    # what all beams of one interpolation have in common, computed when it is first asked for

    @cached_property
    def reduced(self) -> Tabulated:
        """At the Gauss points of the strains."""
        return self.tabulated(*gauss_rule(self.points))

    @cached_property
    def full(self) -> Tabulated:
        """At so many Gauss points that products of shape functions are integrated exactly."""
        return self.tabulated(*gauss_rule(self.order + 1))

    @cached_property
    def dense(self) -> Tabulated:
        """At equidistant places, by which an element is compared with the line that it follows."""
        places = np.linspace(0.0, 1.0, 8 * self.order + 1)
        return self.tabulated(places, np.full(len(places), 1.0 / len(places)))

    def tabulated(self, points: Floats, weights: Floats) -> Tabulated:
        """At the points (nq,) of a quadrature rule."""
        return Tabulated(
            points, weights, shape_functions(self, points), shape_derivatives(self, points)
        )


class InterpolationLobatto(Interpolation):
    """Nodes at the Gauss-Lobatto points: the default, with tip values of order 2 p.

    Examples
    --------
    The default of ``Beam(mesh, section, order=2)``, and full quadrature, which locks:

    >>> InterpolationLobatto(2)
    InterpolationLobatto(order=2, points=2)
    >>> InterpolationLobatto(2, points=3).nodes.tolist()
    [0.0, 0.5, 1.0]
    """

    @property
    def nodes(self) -> Floats:
        """Gauss-Lobatto points, see :func:`lobatto_nodes`."""
        return lobatto_nodes(self.order)


class InterpolationEquidistant(Interpolation):
    """Equidistant nodes, for comparison: tip values are of order 4 for p = 3 and 6 for p = 4.

    Examples
    --------
    >>> InterpolationEquidistant(4).nodes.tolist()
    [0.0, 0.25, 0.5, 0.75, 1.0]
    """

    @property
    def nodes(self) -> Floats:
        """Reference coordinates (p + 1,) of the nodes in [0, 1]."""
        return np.arange(self.order + 1) / self.order


def interpolation(order: int | Interpolation) -> Interpolation:
    """The interpolation meant by an order: itself, or Gauss-Lobatto nodes and p points.

    Examples
    --------
    >>> interpolation(3)
    InterpolationLobatto(order=3, points=3)
    """
    if isinstance(order, Interpolation):
        return order
    lobatto_nodes(order)
    return _LOBATTO[int(order)]


#: of each order one, which all beams have
_LOBATTO = {order: InterpolationLobatto(order) for order in range(1, HIGHEST + 1)}


def shape_functions(order: int | Interpolation, xi: ArrayLike) -> Array:
    """Values of all shape functions.

    Parameters
    ----------
    order : int or Interpolation
        Polynomial order, 1 to 8, on Gauss-Lobatto nodes, or what gives the nodes.
    xi : (...)
        Reference coordinates, real or complex.

    Returns
    -------
    (order + 1, ...)
        In the order of the nodes along the element.

    Examples
    --------
    >>> shape_functions(1, 0.25).tolist()
    [0.75, 0.25]
    """
    return lagrange(interpolation(order).nodes, xi)


def lagrange(nodes: Floats, xi: ArrayLike) -> Array:
    """Lagrange polynomials (p + 1, ...) of given nodes (p + 1,) at xi (...)."""
    x = np.asarray(xi)
    rows = []
    for a, own in enumerate(nodes):
        others = np.delete(nodes, a)
        scale = np.prod(own - others)
        rows.append(np.prod([np.ones_like(x), *(x - other for other in others)], 0) / scale)
    return np.array(rows)


def shape_derivatives(order: int | Interpolation, xi: ArrayLike) -> Array:
    """Derivatives with respect to xi of all shape functions.

    Parameters
    ----------
    order : int or Interpolation
        Polynomial order, 1 to 8, on Gauss-Lobatto nodes, or what gives the nodes.
    xi : (...)
        Reference coordinates, real or complex.

    Returns
    -------
    (order + 1, ...)
        In the order of the nodes along the element; divide by the element length for d/ds.

    Examples
    --------
    >>> shape_derivatives(1, 0.25).tolist()
    [-1.0, 1.0]
    """
    nodes = interpolation(order).nodes
    x = np.asarray(xi)
    rows = []
    for a, own in enumerate(nodes):
        others = np.delete(nodes, a)
        scale = np.prod(own - others)
        total = np.zeros(x.shape, np.result_type(x, float))
        for k in range(len(others)):
            factors = [x - other for other in np.delete(others, k)]
            total = total + np.prod([np.ones_like(total), *factors], 0)
        rows.append(total / scale)
    return np.array(rows)


class ElementLineLobatto(ElementH1):
    """Lagrange element of order 1 to 8 with nodes at the Gauss-Lobatto points.

    Works on any line mesh. As scikit-fem wants it, degrees of freedom come in the order
    start, end, interior.

    Parameters
    ----------
    order : int or Interpolation
        Polynomial order, 1 to 8, or an interpolation with nodes elsewhere.

    Examples
    --------
    >>> import skfem
    >>> basis = skfem.Basis(skfem.MeshLine().refined(2), ElementLineLobatto(3))
    >>> int(basis.N)
    13
    """

    refdom = RefLine
    nodal_dofs = 1

    def __init__(self, order: int | Interpolation = 1):
        self.interpolation = interpolation(order)
        self.order = self.interpolation.order
        self.interior_dofs = self.order - 1
        self.maxdeg = self.order
        self.dofnames = ["u"] * self.order
        #: Position along the element of each of scikit-fem's local functions.
        self.places = np.array([0, self.order, *range(1, self.order)])
        self.doflocs = self.interpolation.nodes[self.places][:, None]

    def lbasis(self, X: Array, i: int) -> tuple[Array, Array]:
        """Value (...) and derivative (1, ...) of local function ``i`` at X (1, ...)."""
        if not 0 <= i <= self.order:
            self._index_error()
        a = self.places[i]
        nodes = self.interpolation
        return shape_functions(nodes, X[0])[a], shape_derivatives(nodes, X[0])[a][None]


class _ElementVectors(ElementVector):
    """Base of elements with some vectors of three components a node."""

    _vectors: tuple[str, ...]

    def __init__(self, order: int | Interpolation = 1):
        names = [f"{v}_{i}" for v in self._vectors for i in (1, 2, 3)]
        super().__init__(ElementLineLobatto(order), len(names))
        self.dofnames = names * self.elem.order


class ElementDirector(_ElementVectors):
    """Twelve components a node, ``q = (phi, d1, d2, d3)``, on Gauss-Lobatto points.

    ``basis.get_dofs("tip").all(["phi_1", "d3_2"])`` finds single components by name.

    Parameters
    ----------
    order : int or Interpolation
        Polynomial order, 1 to 8, or an interpolation with nodes elsewhere.

    Examples
    --------
    >>> ElementDirector(1).dofnames[2:5]
    ['phi_3', 'd1_1', 'd1_2']
    """

    _vectors = "phi", "d1", "d2", "d3"


class ElementMotion(_ElementVectors):
    """Six components a node, displacements u and small rotations theta, on the same points.

    ``basis.get_dofs("tip").all(["u_1", "theta_2"])`` finds single components by name.

    Parameters
    ----------
    order : int or Interpolation
        Polynomial order, 1 to 8, or an interpolation with nodes elsewhere.

    Examples
    --------
    >>> ElementMotion(1).dofnames[2:5]
    ['u_3', 'theta_1', 'theta_2']
    """

    _vectors = "u", "theta"
