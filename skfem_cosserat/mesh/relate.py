"""Where the nodes of one mesh lie in the elements of another one of the same lines."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..errors import MeshError
from ..types import Floats, IndexArray

if TYPE_CHECKING:  # pragma: no cover - for annotations only
    from .mesh import MeshCurve

__all__ = ["places_in"]

#: Largest distance between a place in one mesh and in the other, as a part of the mesh size.
APART = 1e-8
#: Distance (of an element's length) at which a place counts as being at a node.
MEETS = 1e-9


def places_in(mesh: MeshCurve, other: MeshCurve, xi: Floats) -> tuple[IndexArray, Floats]:
    """Elements of a mesh, and reference coordinates in them, of places in another mesh.

    Both meshes divide the same lines, and their elements follow each other in the same order, as
    they do after :meth:`MeshCurve.refined`: elements are found by the length of all before them,
    so that lines may cross, touch or lie upon each other.

    Parameters
    ----------
    mesh, other : MeshCurve
    xi : (n,) array
        Reference coordinates, the same in all elements of `other`.

    Returns
    -------
    elements, xi : (ne, n) arrays
        For each element of `other`. Where two elements of `mesh` meet: the one towards the middle
        of the element of `other`.

    Raises
    ------
    MeshError
        If places of both meshes are apart: they do not divide the same lines.

    Examples
    --------
    >>> from skfem_cosserat.mesh import MeshCurve
    >>> mesh = MeshCurve.init_line((0, 0, 0), (1, 0, 0), 2)
    >>> elements, xi = places_in(mesh, mesh.refined([1]), np.array([0.0, 1.0]))
    >>> elements.tolist(), xi.tolist()
    ([[0, 0], [1, 1], [1, 1]], [[0.0, 1.0], [0.0, 0.5], [0.5, 1.0]])
    """
    ends, starts = (np.append(0.0, np.cumsum(m.lengths)) for m in (mesh, other))
    total, same = ends[-1], abs(ends[-1] - starts[-1]) <= APART * max(ends[-1], starts[-1])
    if not same:
        raise MeshError(
            "mesh", f"its lines are {starts[-1]:.9g} m long, of the mesh before {total:.9g} m"
        )
    s = starts[:-1, None] + other.lengths[:, None] * xi
    middle = starts[:-1, None] + 0.5 * other.lengths[:, None]
    inside = s + 1e-6 * (middle - s)
    e = np.clip(np.searchsorted(ends, inside, side="right") - 1, 0, mesh.nelements - 1)
    x = (s - ends[e]) / mesh.lengths[e]
    for end in (0.0, 1.0):
        x = np.where(abs(x - end) <= MEETS, end, x)
    x = np.clip(x, 0.0, 1.0)
    here = mesh.mapping().F(x.reshape(1, -1, 1), e.ravel())[:, :, 0]
    there = np.asarray(other.mapping().F(xi[None])).reshape(3, -1)
    gaps = np.linalg.norm(here - there, axis=0)
    if gaps.max() > APART * mesh.size:
        k = int(gaps.argmax()) // len(xi)
        raise MeshError(
            f"element {k}",
            f"is {gaps.max():.3g} m away from the line of the mesh before: expected the same lines"
            " in the same order, as after mesh.refined()",
        )
    return e.astype(np.int64), x
