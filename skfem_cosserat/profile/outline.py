"""Boundary of a mesh as closed polygons."""

from __future__ import annotations

import numpy as np
from skfem import Mesh, MeshTri2
from skfem.mesh import MeshQuad2

from ..types import Floats

__all__ = ["boundary_loops", "signed_area"]


def signed_area(polygon: Floats) -> float:
    """Area of a closed polygon (k, 2), positive if counter-clockwise.

    Examples
    --------
    >>> signed_area(np.array([[0, 0], [1, 0], [0, 1.0]]))
    0.5
    """
    x, y = (polygon - polygon[0]).T
    return float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum() / 2)


def _without_straight(polygon: Floats) -> Floats:
    """Without points on the straight line between their neighbours."""
    before, after = polygon - np.roll(polygon, 1, axis=0), np.roll(polygon, -1, axis=0) - polygon
    cross = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    keep = abs(cross) > 1e-9 * np.linalg.norm(before, axis=1) * np.linalg.norm(after, axis=1)
    return polygon[keep]


def boundary_loops(mesh: Mesh) -> list[Floats]:
    """Closed polygons (k, 2) of the boundary: the outer one first, then the holes.

    Curved edges are drawn by three points. The outer one goes counter-clockwise, holes clockwise.

    Examples
    --------
    >>> import skfem
    >>> boundary_loops(skfem.MeshTri().refined(2))[0].shape
    (4, 2)
    """
    facets = mesh.boundary_facets()
    curved = isinstance(mesh, MeshTri2 | MeshQuad2)
    middle = mesh.doflocs[:, mesh.dofs.facet_dofs[0, facets]] if curved else None
    at: dict[int, list[tuple[int, int]]] = {}
    for k, (a, b) in enumerate(mesh.facets[:, facets].T.tolist()):
        at.setdefault(a, []).append((k, b))
        at.setdefault(b, []).append((k, a))
    left, loops = set(range(len(facets))), []
    while left:
        k = min(left)
        start = node = int(mesh.facets[0, facets[k]])
        points = []
        while True:
            k, following = next((k, b) for k, b in at[node] if k in left)
            left.remove(k)
            points.append(mesh.p[:, node])
            if middle is not None:
                points.append(middle[:, k])
            node = following
            if node == start:
                break
        loops.append(_without_straight(np.array(points)))
    loops.sort(key=lambda loop: -abs(signed_area(loop)))
    return [
        loop if (signed_area(loop) > 0) == (k == 0) else loop[::-1] for k, loop in enumerate(loops)
    ]
