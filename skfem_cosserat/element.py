"""Nodal Lagrange elements on Gauss-Lobatto points, and the director element made of them."""

from __future__ import annotations

from typing import Any

import numpy as np
from skfem.element import ElementH1, ElementVector
from skfem.refdom import RefLine

from .errors import InputError
from .types import Array, ArrayLike, Floats

__all__ = [
    "ElementDirector",
    "ElementLineLobatto",
    "lobatto_nodes",
    "shape_derivatives",
    "shape_functions",
]

_NODES = {
    1: (0.0, 1.0),
    2: (0.0, 0.5, 1.0),
    3: (0.0, 0.5 - np.sqrt(0.05), 0.5 + np.sqrt(0.05), 1.0),
    4: (0.0, 0.5 - np.sqrt(3.0 / 28.0), 0.5, 0.5 + np.sqrt(3.0 / 28.0), 1.0),
}


def lobatto_nodes(order: int) -> Floats:
    """Gauss-Lobatto points of an element in increasing order.

    Parameters
    ----------
    order : int
        Polynomial order, 1 to 4.

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
    if isinstance(order, bool) or not isinstance(order, int | np.integer) or order not in _NODES:
        raise InputError("argument order", f"got {order!r}, expected 1, 2, 3 or 4")
    return np.array(_NODES[order])


def shape_functions(order: int, xi: ArrayLike) -> Array:
    """Values of all shape functions.

    Parameters
    ----------
    order : int
        Polynomial order, 1 to 4.
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
    nodes = lobatto_nodes(order)
    x = np.asarray(xi)
    rows = []
    for a, own in enumerate(nodes):
        others = np.delete(nodes, a)
        scale = np.prod(own - others)
        rows.append(np.prod([x - other for other in others], axis=0) / scale)
    return np.array(rows)


def shape_derivatives(order: int, xi: ArrayLike) -> Array:
    """Derivatives with respect to xi of all shape functions.

    Parameters
    ----------
    order : int
        Polynomial order, 1 to 4.
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
    nodes = lobatto_nodes(order)
    x = np.asarray(xi)
    rows = []
    for a, own in enumerate(nodes):
        others = np.delete(nodes, a)
        scale = np.prod(own - others)
        total = np.zeros(x.shape, dtype=np.result_type(x, float))
        for k in range(order):
            factors = [x - other for other in np.delete(others, k)]
            total = total + np.prod([np.ones_like(total), *factors], axis=0)
        rows.append(total / scale)
    return np.array(rows)


class ElementLineLobatto(ElementH1):
    """Lagrange element of order 1 to 4 with nodes at the Gauss-Lobatto points.

    Works on any line mesh. As scikit-fem wants it, degrees of freedom come in the order
    start, end, interior.

    Parameters
    ----------
    order : int
        Polynomial order, 1 to 4.

    Examples
    --------
    >>> import skfem
    >>> basis = skfem.Basis(skfem.MeshLine().refined(2), ElementLineLobatto(3))
    >>> int(basis.N)
    13
    """

    refdom = RefLine
    nodal_dofs = 1

    def __init__(self, order: int = 1) -> None:
        nodes = lobatto_nodes(order)
        self.order = int(order)
        self.interior_dofs = self.order - 1
        self.maxdeg = self.order
        self.dofnames = ["u"] * self.order
        #: Position along the element of each of scikit-fem's local functions.
        self.places = np.array([0, self.order, *range(1, self.order)])
        self.doflocs = nodes[self.places][:, None]

    def lbasis(self, X: Array, i: int) -> tuple[Array, Array]:
        """Value (...) and derivative (1, ...) of local function ``i`` at X (1, ...)."""
        if not 0 <= i <= self.order:
            self._index_error()
        a = self.places[i]
        return shape_functions(self.order, X[0])[a], shape_derivatives(self.order, X[0])[a][None]


class ElementDirector(ElementVector):
    """Twelve components a node, ``q = (phi, d1, d2, d3)``, on Gauss-Lobatto points.

    ``basis.get_dofs("tip").all(["phi_1", "d3_2"])`` finds single components by name.

    Parameters
    ----------
    order : int
        Polynomial order, 1 to 4.

    Examples
    --------
    >>> ElementDirector(1).dofnames[2:5]
    ['phi_3', 'd1_1', 'd1_2']
    """

    def __init__(self, order: int = 1) -> None:
        super().__init__(ElementLineLobatto(order), 12)
        names: list[Any] = [f"{v}_{i}" for v in ("phi", "d1", "d2", "d3") for i in (1, 2, 3)]
        self.dofnames = names * self.elem.order
