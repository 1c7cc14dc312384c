"""Bases of scikit-fem for beams, and forms assembled with them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from skfem import CellBasis, Functional
from skfem.assembly.form.form import Form

from .arguments import checked
from .element import (
    ElementDirector,
    ElementLineLobatto,
    ElementMotion,
    Interpolation,
    gauss_rule,
    interpolation,
    shape_derivatives,
    shape_functions,
)
from .errors import InputError, MeshError
from .frozen import lock_arrays
from .mesh import MeshCurve
from .mesh.topology import find_node
from .mesh.triads import Directors, Twist, section_triads
from .types import SAME, Array, ArrayLike, Floats, IndexArray, VectorLike

# -- the director basis: a scikit-fem basis whose nodes carry a point and three directors ----------


class _BuiltByScikitFem:
    """An attribute of the class of bases, which one of its own hides once it is built."""

    def __get__(self, basis: DirectorBasis | None, owner: type | None = None) -> Any:
        if basis is None:
            return self
        basis._build()
        return vars(basis)["basis"]


@checked
class DirectorBasis(CellBasis):
    """Point and three directors at each node, all twelve interpolated alike over arc length.

    A :class:`skfem.CellBasis` of :class:`ElementDirector`, which is tabulated when a form of
    scikit-fem first asks for it. Degree of freedom ``12*node + c``
    is component c of ``q = (phi, d1, d2, d3)``. Vertices of the mesh are the first nodes, under
    their own numbers; interior nodes of elements follow.

    Parameters
    ----------
    mesh : MeshCurve
        The mesh.
    order : int or Interpolation
        Polynomial order, 1 to 8, or an interpolation with other nodes or Gauss points.
    quadrature : tuple of (1, nq) and (nq,), optional
        Points and weights on [0, 1]. By default those of the interpolation, ``order`` Gauss
        points: reduced integration, which neither locks nor leaves mechanisms.

    Attributes
    ----------
    order : int
        Polynomial order p.
    interpolation : Interpolation
        Places of the nodes in an element, and its number of Gauss points.
    n_nodes : int
        Number of nodes N.
    nodes : (N, 3)
        Reference positions (m).
    connectivity : (ne, p + 1)
        Nodes of each element along it: start, interior, end.
    lengths : (ne,)
        Arc lengths of the elements (m).
    arc_lengths : (ne, p + 1)
        Arc length of an element's nodes from the start of their beam (m).
    points, weights : (nq,)
        Quadrature rule on [0, 1].

    Raises
    ------
    MeshError
        If the mesh is not a MeshCurve.
    InputError
        If the order or the quadrature is not possible.

    Examples
    --------
    >>> mesh = MeshCurve.init_line((0, 0, 0), (0, 0, 1), elements=2)
    >>> basis = DirectorBasis(mesh, order=2)
    >>> basis.n_nodes, basis.connectivity.tolist()
    (5, [[0, 3, 1], [1, 4, 2]])
    """

    def __init__(
        self,
        mesh: MeshCurve,
        order: int | Interpolation = 1,
        quadrature: tuple[Any, Any] | None = None,
    ):
        if not isinstance(mesh, MeshCurve):
            raise MeshError("argument mesh", f"got {type(mesh).__name__}, expected a MeshCurve")
        self.mesh = mesh
        self._quadrature = quadrature
        self.interpolation = kind = interpolation(order)
        self.order = p = kind.order
        #: shape functions at the points of the quadrature rule
        self.tabulated = kind.tabulated(*_checked_rule(quadrature)) if quadrature else kind.reduced
        self.points = self.tabulated.points
        self.weights = self.tabulated.weights
        ne = mesh.t.shape[1]
        nv = mesh.p.shape[1]
        self.n_nodes = nv + ne * (p - 1)
        self.connectivity = np.empty((ne, p + 1), np.int64)
        self.connectivity[:, 0], self.connectivity[:, -1] = mesh.t
        self.connectivity[:, 1:-1] = np.arange(nv, self.n_nodes).reshape(ne, p - 1)
        self.lengths = mesh.lengths
        self.nodes = np.empty((self.n_nodes, 3))
        if p > 1:
            self.nodes[self.connectivity] = np.moveaxis(mesh.mapping().F(kind.nodes[None]), 0, -1)
        self.nodes[:nv] = mesh.p.T
        lock_arrays(self)
        self._built = False

    # what scikit-fem tabulates for its forms is larger and dearer than all else: most beams never
    # need it

    basis: Any = _BuiltByScikitFem()
    #: whether it is built; None: the constructor is not through
    _built: bool | None = None

    def __getattr__(self, name: str) -> Any:
        if self._built is not False:
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
        self._build()
        return getattr(self, name)

    def _build(self) -> None:
        """All attributes of a :class:`skfem.CellBasis`."""
        self._built = True
        rule = self.points[None], self.weights
        element = ElementDirector(self.interpolation)
        super().__init__(self.mesh, element, quadrature=rule, disable_doflocs=True)
        self.doflocs = self.nodes.T.repeat(12, 1)
        lock_arrays(self)

    @property
    def N(self) -> int:
        """Number of degrees of freedom."""
        return 12 * self.n_nodes

    def __reduce__(self) -> tuple[Any, ...]:
        # tabulated shape functions are ten times as large as what they follow from
        return DirectorBasis, (self.mesh, self.interpolation, self._quadrature)

    @property
    def element_dof_rows(self) -> IndexArray:
        """Degrees of freedom (ne, 12*(p + 1)) of the elements, node after node along them."""
        rows = 12 * self.connectivity[:, :, None] + np.arange(12)
        return rows.reshape(len(rows), -1)

    @property
    def arc_lengths(self) -> Floats:
        """Arc length (ne, p + 1) of nodes from the start of their beam (m)."""
        return self.mesh.arc_starts[:, None] + (self.lengths[:, None] * self.interpolation.nodes)

    def shape(self, xi: ArrayLike) -> Array:
        """Shape functions (p + 1, ...) at reference coordinates xi (...)."""
        return shape_functions(self.interpolation, xi)

    def dshape(self, xi: ArrayLike) -> Array:
        """Their derivatives (p + 1, ...) with respect to xi; divide by the length for d/ds."""
        return shape_derivatives(self.interpolation, xi)

    def node(self, which: str | int | VectorLike) -> int:
        """Node number of a node given by name, number or position (3,).

        Raises
        ------
        MeshError
            If there is no such node; the message lists what is known.
        """
        return find_node(self.mesh, self.nodes, which)

    # ------------------------------------------------------------------ scikit-fem
    def scalar(
        self, intorder: int | None = None, quadrature: tuple[Any, Any] | None = None
    ) -> CellBasis:
        """Scalar basis on the same mesh and nodes: one number a node instead of twelve.

        Parameters
        ----------
        intorder : int, optional
            Degree up to which integration is exact; by default 2 p + 1.
        quadrature : tuple, optional
            Points (1, nq) and weights (nq,) instead.

        Examples
        --------
        >>> basis = DirectorBasis(MeshCurve.init_line((0, 0, 0), (1, 0, 0), 4), order=2)
        >>> int(basis.scalar().N) == basis.n_nodes
        True
        """
        if quadrature is None:
            quadrature = self._rule(self.order + 1 if intorder is None else int(intorder) // 2 + 1)
        element = ElementLineLobatto(self.interpolation)
        return CellBasis(self.mesh, element, mapping=self.mapping, quadrature=quadrature)

    def linear(self) -> CellBasis:
        """Basis of small motions on the same mesh and nodes: u and theta, six numbers a node.

        The unknowns of :meth:`Beam.linear` and :meth:`Beam.reduce`: displacements (m) and
        rotation vectors in space. It integrates products of shape functions exactly.

        Examples
        --------
        >>> basis = DirectorBasis(MeshCurve.init_line((0, 0, 0), (1, 0, 0), 4, name="rod"))
        >>> basis.linear().get_dofs("rod.end").all(["u_2", "theta_3"]).tolist()
        [25, 29]
        """
        element = ElementMotion(self.interpolation)
        rule = self._rule(self.order + 1)
        return CellBasis(self.mesh, element, mapping=self.mapping, quadrature=rule)

    @staticmethod
    def _rule(count: int) -> tuple[Floats, Floats]:
        """Gauss points (1, nq) and weights (nq,)."""
        x, w = gauss_rule(count)
        return x[None], w

    def with_element(self, elem: Any) -> CellBasis:
        """Basis with another element on the same mesh and quadrature."""
        return CellBasis(self.mesh, elem, mapping=self.mapping, quadrature=self.quadrature)

    def with_elements(self, elements: Any | None = None) -> CellBasis:
        """Basis on some of the elements."""
        return CellBasis(
            self.mesh,
            self.elem,
            mapping=self.mapping,
            quadrature=self.quadrature,
            elements=elements,
        )

    def split_bases(self) -> list[Any]:
        """Scalar bases of the twelve components."""
        return [self.scalar(quadrature=self.quadrature)] * 12

    # ------------------------------------------------------------------ integrals
    def elemental_mass(
        self,
        coefficient: float | Floats | Callable[[Floats], Floats] | None = None,
    ) -> Floats:
        """Integrals of products of shape functions over each element.

        Parameters
        ----------
        coefficient : float, (ne,) or callable, optional
            Factor under the integral: one, one an element, or a function of positions
            (3, ne, nq) that returns (ne, nq).

        Returns
        -------
        (ne, p + 1, p + 1)
            ``int c N_a N_b ds`` (m), nodes in the order of ``connectivity``; exact where the
            coefficient is constant in an element.
        """
        N = self.interpolation.full.values
        weight = 1.0 if coefficient is None else self._coefficient(coefficient)
        out = (weight * N[:, None, None] * N[None, :, None] * self._measure(slice(None))).sum(-1)
        return out.transpose(2, 0, 1).copy()

    def elemental_load(self, elements: IndexArray | slice = slice(None)) -> Floats:
        """Integrals ``int N_a ds`` (ne, p + 1) in m, nodes in the order of ``connectivity``.

        Of the given elements (all by default).
        """
        return (self.interpolation.full.values[:, None] * self._measure(elements)).sum(-1).T.copy()

    def _measure(self, elements: IndexArray | slice) -> Floats:
        """Weights (ne, nq) of full integration, in m."""
        return self.lengths[elements, None] * self.interpolation.full.weights

    def _coefficient(self, coefficient: Any) -> Floats:
        """Coefficient (ne, nq) at the points of full integration."""
        points = self.interpolation.full.points
        shape = len(self.lengths), len(points)
        value = coefficient
        if callable(coefficient):
            value = coefficient(self.mesh.mapping().F(points[None]))
        array = np.asarray(value, float)
        if array.shape == shape[:1] and not callable(coefficient):
            array = array[:, None]
        if array.shape not in {(), (shape[0], 1), shape}:
            raise InputError(
                "argument coefficient", f"has shape {array.shape}, expected () or ({shape[0]},)"
            )
        return np.array(np.broadcast_to(array, shape))

    def evaluate(self, field: ArrayLike, elements: ArrayLike, xi: ArrayLike) -> Array:
        """Values of a nodal field inside elements.

        Parameters
        ----------
        field : (N, k) or (12*N,)
            Nodal values; a vector of degrees of freedom is taken as (N, 12).
        elements : (n,)
            Element numbers.
        xi : (n,)
            Reference coordinates in [0, 1].

        Returns
        -------
        (n, k)

        Examples
        --------
        >>> basis = DirectorBasis(MeshCurve.init_line((0, 0, 0), (1, 0, 0), 2), order=3)
        >>> basis.evaluate(basis.nodes, [1], [0.5]).round(12).tolist()
        [[0.75, 0.0, 0.0]]
        """
        values = np.asarray(field)
        if values.shape == (self.N,):
            values = values.reshape(-1, 12)
        if values.ndim != 2 or len(values) != self.n_nodes:
            raise InputError(
                "argument field", f"has shape {values.shape}, expected ({self.n_nodes}, k)"
            )
        e = np.atleast_1d(np.asarray(elements))
        shape = self.shape(np.broadcast_to(np.asarray(xi), e.shape))
        return np.einsum("ae,eak->ek", shape, values[self.connectivity[e]])

    # ------------------------------------------------------------------ triads
    def triads(self, directors: Directors = None, twist: Twist = None) -> Floats:
        """Orthonormal section triads at the nodes of each element in the reference.

        ``d3`` is the unit tangent. Where beams meet at an angle, the elements at a node have
        different triads; inside a smooth beam they are the same.

        Parameters
        ----------
        directors : (3,) or dict of str to (3,), optional
            Unit vector, for all beams or by name, that d1 follows (made normal to the tangent).
            Where none is given d1 is transported without rotation about the tangent, from
            the coordinate axis farthest from the beam's first tangent (x before y before z).
        twist : float, callable or dict of str to these, optional
            Additional rotation about d3: a rate (rad/m) or the angle (rad) as a function of the
            arc length from the beam's start (m).

        Returns
        -------
        (ne, p + 1, 3, 3)
            ``[e, a, i]`` is d_(i+1) at node ``connectivity[e, a]``.

        Raises
        ------
        InputError
            If a hint is not a finite unit vector or a twist is not finite.
        MeshError
            If a hint is parallel to the tangent or a beam's name is unknown.

        Examples
        --------
        >>> basis = DirectorBasis(MeshCurve.init_line((0, 0, 0), (0, 0, 1), 2))
        >>> basis.triads(directors=(0, 1, 0))[0, 0].tolist()
        [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
        """
        places = self.nodes[self.connectivity]
        return section_triads(self.mesh, self.interpolation.nodes, places, directors, twist)

    def nodal_triads(self, triads: Floats) -> Floats:
        """Triad (N, 3, 3) of each node: that of the first element there.

        Parameters
        ----------
        triads : (ne, p + 1, 3, 3)
            From :meth:`triads`.
        """
        nodes, first = np.unique(self.connectivity.ravel(), return_index=True)
        out = np.empty((self.n_nodes, 3, 3))
        out[nodes] = triads.reshape(-1, 3, 3)[first]
        return out

    def relative_rotations(self, triads: Floats) -> Floats:
        """Constant rotations from the triads of nodes to those of the elements' sections.

        Parameters
        ----------
        triads : (ne, p + 1, 3, 3)
            From :meth:`triads`.

        Returns
        -------
        (ne, p + 1, 3, 3)
            Lambda with ``section d_i = sum_j Lambda[i, j] * nodal d_j``; exactly the identity
            where the two agree to 1e-12.
        """
        out = np.einsum("eaik,eajk->eaij", triads, self.nodal_triads(triads)[self.connectivity])
        out[abs(out - np.eye(3)).max((-2, -1)) < SAME] = np.eye(3)
        return out


def _checked_rule(quadrature: tuple[Any, Any]) -> tuple[Floats, Floats]:
    """Points and weights (nq,) of a rule given as scikit-fem wants it."""
    points = np.atleast_2d(np.asarray(quadrature[0], float))
    weights = np.asarray(quadrature[1], float)
    if points.shape[0] != 1 or weights.shape != points.shape[1:]:
        raise InputError(
            "argument quadrature",
            f"points {points.shape} and weights {weights.shape}, expected (1, nq) and (nq,)",
        )
    if not (np.isfinite(points).all() and abs(weights.sum() - 1.0) < 1e-12):
        raise InputError("argument quadrature", f"weights add up to {weights.sum()}, expected 1")
    return points[0], weights


# -- forms of ready-made element arrays, error norms -----------------------------------------------


class ElementForm(Form):
    """A form whose element arrays come ready-made from a function.

    ``assemble``, ``elemental`` and ``skfem.asm`` work as for scikit-fem's own forms, and the
    ``COOData`` of both kinds add up. Parameters are passed on as they are: a vector of degrees of
    freedom is *not* interpolated. With a :class:`DirectorBasis`, local number ``12*a + c`` is
    component c of node ``connectivity[e, a]``; with any other basis local numbers are scikit-fem's.

    Use :class:`ElementMatrix` or :class:`ElementLoad`.

    Parameters
    ----------
    form : callable
        ``function(basis, **params)`` that returns the element arrays, shape (ne,) here, (ne, k)
        for a load, (ne, k, k) for a matrix.

    Raises
    ------
    InputError
        When assembled, if the function returns arrays of another shape.

    Examples
    --------
    The form itself sums numbers of the elements:

    >>> from skfem_cosserat.mesh import MeshCurve
    >>> basis = DirectorBasis(MeshCurve.init_line((0, 0, 0), (1, 0, 0), 2))
    >>> length = ElementForm(lambda basis: basis.lengths)
    >>> float(length.assemble(basis))
    1.0
    """

    #: Number of local indices of the arrays.
    rank = 0

    def __call__(self, *args: Any) -> Any:
        """Use as a decorator."""
        return type(self)(args[0]) if self.form is None else super().__call__(*args)

    def _assemble(
        self, basis: Any, *, idx: Any = None, **params: Any
    ) -> tuple[Array, Array, tuple[int, ...], tuple[int, ...]]:
        """Indices, data, shape and local shape for ``COOData``."""
        form = self.form
        name = getattr(form, "__name__", "form")
        own = isinstance(basis, DirectorBasis)
        dofs = basis.element_dof_rows if own else np.asarray(basis.element_dofs, np.int64).T
        ne, k = dofs.shape
        local = np.asarray(form(basis, **params))
        shape = (ne,) + (k,) * self.rank
        if local.shape != shape:
            raise InputError(f"form '{name}'", f"returned shape {local.shape}, expected {shape}")
        # degrees of freedom (ne, 1.., k, ..1) along each of the local axes
        axes = (dofs.reshape(ne, *each) for each in np.where(np.eye(self.rank), k, 1))
        indices = np.array(
            [np.moveaxis(np.broadcast_to(axis, shape), 0, -1).ravel() for axis in axes]
        )
        data = np.moveaxis(local, 0, -1).ravel()
        return indices, data, (int(basis.N),) * self.rank, (k,) * self.rank


class ElementMatrix(ElementForm):
    """Matrix from element matrices.

    Parameters
    ----------
    form : callable
        ``function(basis, **params)`` -> (ne, k, k), rows first.

    Raises
    ------
    InputError
        When assembled, if the function returns arrays of another shape.

    Examples
    --------
    >>> from skfem_cosserat.mesh import MeshCurve
    >>> basis = DirectorBasis(MeshCurve.init_line((0, 0, 0), (1, 0, 0), 2))
    >>> @ElementMatrix
    ... def springs(basis, stiffness):
    ...     return np.broadcast_to(stiffness * np.eye(24), (2, 24, 24))
    >>> matrix = springs.assemble(basis, stiffness=3.0)
    >>> matrix.shape, float(matrix[12, 12])
    ((36, 36), 6.0)
    """

    rank = 2


class ElementLoad(ElementForm):
    """Vector from element vectors.

    Parameters
    ----------
    form : callable
        ``function(basis, **params)`` -> (ne, k).

    Raises
    ------
    InputError
        When assembled, if the function returns arrays of another shape.

    Examples
    --------
    >>> from skfem_cosserat.mesh import MeshCurve
    >>> basis = DirectorBasis(MeshCurve.init_line((0, 0, 0), (1, 0, 0), 2))
    >>> load = ElementLoad(lambda basis: np.ones((2, 24)))
    >>> load.assemble(basis)[10:14].tolist()
    [1.0, 1.0, 2.0, 2.0]
    """

    rank = 1


def error_norms(
    basis: DirectorBasis,
    field: ArrayLike,
    exact: Callable[[Any], ArrayLike],
    derivative: Callable[[Any], ArrayLike] | None = None,
    by: str = "position",
    intorder: int | None = None,
) -> tuple[float, float | None]:
    """L2 norm and H1 seminorm of the error of a nodal field.

    Parameters
    ----------
    basis : DirectorBasis
        The basis.
    field : (N, k), (N,) or (12*N,)
        Nodal values.
    exact : callable
        Exact values (k, ...) as a function of positions (3, ...) or arc lengths (...).
    derivative : callable, optional
        Exact derivatives with respect to arc length, of the same form.
    by : {"position", "arc"}
        What the functions depend on; arc length runs from the start of the beam (m).
    intorder : int, optional
        Degree of exact integration; by default 2 p + 6.

    Returns
    -------
    l2 : float
        ``sqrt(int |field - exact|^2 ds)``.
    h1 : float or None
        The same for the derivatives; None without ``derivative``.

    Examples
    --------
    >>> from skfem_cosserat.mesh import MeshCurve
    >>> basis = DirectorBasis(MeshCurve.init_line((0, 0, 0), (1, 0, 0), 4), order=2)
    >>> l2, h1 = error_norms(basis, basis.nodes, lambda x: x)
    >>> l2 < 1e-15, h1
    (True, None)
    """
    if by not in {"position", "arc"}:
        raise InputError("argument by", f"got {by!r}, expected 'position' or 'arc'")
    if not (callable(exact) and callable(exact if derivative is None else derivative)):
        raise InputError("exact, derivative", f"{exact!r}, {derivative!r}, expected functions")
    values = np.asarray(field, float)
    if values.shape == (basis.N,):
        values = values.reshape(-1, 12)
    values = values.reshape(len(values), -1)
    if len(values) != basis.n_nodes:
        raise InputError("argument field", f"{len(values)} rows for {basis.n_nodes} nodes")
    scalar = basis.scalar(intorder=2 * basis.order + 6 if intorder is None else intorder)
    where = np.asarray(scalar.global_coordinates())
    if by == "arc":
        where = basis.mesh.arc_starts[:, None] + basis.lengths[:, None] * scalar.X[0]
    local = values[basis.connectivity]
    l2 = _norm(scalar, np.einsum("aq,eak->keq", basis.shape(scalar.X[0]), local), exact(where))
    if derivative is None:
        return l2, None
    slope = np.einsum("aq,eak,e->keq", basis.dshape(scalar.X[0]), local, 1.0 / basis.lengths)
    return l2, _norm(scalar, slope, derivative(where))


def _norm(scalar: CellBasis, found: Floats, exact: ArrayLike) -> float:
    """L2 norm of the difference of values (k, ne, nq) at quadrature points."""
    wanted = np.asarray(exact, float)
    wanted = wanted[None] if wanted.ndim == 2 else wanted
    if wanted.shape != found.shape:
        raise InputError("argument exact", f"returned shape {wanted.shape}, expected {found.shape}")
    square = ((found - wanted) ** 2).sum(0)
    return float(np.sqrt(Functional(lambda w: w.square).assemble(scalar, square=square)))
