"""Forms of ready-made element arrays, error norms."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from skfem import CellBasis, Functional
from skfem.assembly.form.form import Form

from .basis import DirectorBasis
from .errors import InputError
from .types import Array, ArrayLike, Floats, IndexArray

__all__ = [
    "ElementForm",
    "ElementLoad",
    "ElementMatrix",
    "error_norms",
]


def _local_dofs(basis: Any) -> IndexArray:
    """Degrees of freedom (ne, k) of elements in the order of element arrays."""
    if isinstance(basis, DirectorBasis):
        return basis.element_dof_rows
    return np.asarray(basis.element_dofs, dtype=np.int64).T


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
        if self.form is None:
            return type(self)(args[0])
        return super().__call__(*args)

    def _assemble(
        self, basis: Any, *, idx: Any = None, **params: Any
    ) -> tuple[Array, Array, tuple[int, ...], tuple[int, ...]]:
        """Indices, data, shape and local shape for ``COOData``."""
        form: Callable[..., Any] = self.form
        name = getattr(form, "__name__", "form")
        dofs = _local_dofs(basis)
        ne, k = dofs.shape
        local = np.asarray(form(basis, **params))
        if local.shape != (ne,) + (k,) * self.rank:
            raise InputError(
                f"form '{name}'",
                f"returned shape {local.shape}, expected {(ne,) + (k,) * self.rank}",
            )
        axes = [np.broadcast_to(_axis(dofs, r, self.rank), local.shape) for r in range(self.rank)]
        indices = np.array([np.moveaxis(axis, 0, -1).ravel() for axis in axes])
        data = np.moveaxis(local, 0, -1).ravel()
        return indices, data, (int(basis.N),) * self.rank, (k,) * self.rank


def _axis(dofs: IndexArray, axis: int, rank: int) -> IndexArray:
    """Degrees of freedom (ne, 1.., k, ..1) along one of the local axes."""
    shape = [1] * rank
    shape[axis] = dofs.shape[1]
    return dofs.reshape(len(dofs), *shape)


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
    values = np.asarray(field, dtype=float)
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
    found = np.einsum("aq,eak->keq", basis.shape(scalar.X[0]), local)
    l2 = _norm(scalar, found, exact(where))
    if derivative is None:
        return l2, None
    slope = np.einsum("aq,eak,e->keq", basis.dshape(scalar.X[0]), local, 1.0 / basis.lengths)
    return l2, _norm(scalar, slope, derivative(where))


def _norm(scalar: CellBasis, found: Floats, exact: ArrayLike) -> float:
    """L2 norm of the difference of values (k, ne, nq) at quadrature points."""
    wanted = np.asarray(exact, dtype=float)
    wanted = wanted[None] if wanted.ndim == 2 else wanted
    if wanted.shape != found.shape:
        raise InputError("argument exact", f"returned shape {wanted.shape}, expected {found.shape}")
    square = ((found - wanted) ** 2).sum(axis=0)
    return float(np.sqrt(Functional(lambda w: w.square).assemble(scalar, square=square)))
