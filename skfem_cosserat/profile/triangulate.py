"""Triangles of good shape between given segments: Ruppert's refinement of Delaunay's mesh.

Segments in whose diametral circle a point lies are halved; then the circumcentres of the worst
triangles are added, or the segments halved that they would come too close to (Ruppert, J.
Algorithms 18 (1995) 548). Near corners sharper than 60 degrees that ends at a smallest length.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.spatial import Delaunay, cKDTree

from ..types import Floats, IndexArray

__all__ = ["triangulate"]

#: Circumradius by shortest edge that is good enough: angles above 22 degrees.
SHAPE = 1.35
#: Smallest length by the shortest segment given.
FLOOR = 0.2


def _halved(points: Floats, segments: IndexArray, which: IndexArray) -> tuple[Floats, IndexArray]:
    a, b = segments[which].T
    middle = len(points) + np.arange(len(which))
    kept = np.delete(segments, which, axis=0)
    new = np.column_stack([a, middle]), np.column_stack([middle, b])
    return np.vstack([points, (points[a] + points[b]) / 2]), np.vstack([kept, *new])


def _circumcircles(points: Floats, t: IndexArray) -> tuple[Floats, Floats, Floats]:
    """Centres, radii and shortest edges of triangles (k, 3)."""
    a, b, c = points[t[:, 0]], points[t[:, 1]], points[t[:, 2]]
    u, v = b - a, c - a
    twice = 2 * (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])
    uu, vv = (u**2).sum(axis=1), (v**2).sum(axis=1)
    offset = np.column_stack([v[:, 1] * uu - u[:, 1] * vv, u[:, 0] * vv - v[:, 0] * uu])
    offset /= twice[:, None]
    shortest = np.sqrt(np.minimum(np.minimum(uu, vv), ((c - b) ** 2).sum(axis=1)))
    return a + offset, np.linalg.norm(offset, axis=1), shortest


def _missing(t: IndexArray, segments: IndexArray, count: int) -> IndexArray:
    """Segments that are no edges of the triangles."""
    edges = np.sort(t[:, [[0, 1], [1, 2], [0, 2]]].reshape(-1, 2), axis=1) @ (count, 1)
    return np.flatnonzero(~np.isin(np.sort(segments, axis=1) @ (count, 1), edges))


def _encroached(points: Floats, segments: IndexArray, by: Floats) -> IndexArray:
    """Segments with a point of ``by`` inside their diametral circle."""
    if len(by) == 0:
        return np.zeros(0, dtype=np.int64)
    ends = points[segments]
    middle, radius = ends.mean(axis=1), np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) / 2
    near = cKDTree(by).query_ball_point(middle, radius * (1 - 1e-9), return_length=True)
    return np.flatnonzero(near > 0)


def _apart(centres: Floats, radii: Floats) -> IndexArray:
    """Those that keep a distance from all earlier ones: they can be added together."""
    close = cKDTree(centres).query_ball_point(centres, 0.8 * radii)
    taken = np.zeros(len(centres), dtype=bool)
    for k, others in enumerate(close):
        taken[k] = not taken[others].any()
    return np.flatnonzero(taken)


def triangulate(
    points: Floats, segments: IndexArray, inside: Callable[[Floats], IndexArray]
) -> tuple[Floats, IndexArray]:
    """Points and triangles that hold all segments as (parts of) edges.

    Parameters
    ----------
    points : (n, 2) array
        Distinct.
    segments : (k, 2) array
        Pairs of points; they meet at points only.
    inside : function of an (m, 2) array
        Region of each point, negative outside.

    Returns
    -------
    points : (N, 2) array
        The given ones first.
    triangles : (m, 3) array
        Those inside.

    Examples
    --------
    >>> corners = np.array([[0, 0], [4, 0], [4, 1], [0, 1.0]])
    >>> edges = np.array([[0, 1], [1, 2], [2, 3], [3, 0]])
    >>> points, t = triangulate(corners, edges, lambda x: np.zeros(len(x), dtype=int))
    >>> bool((_circumcircles(points, t)[1] <= SHAPE * _circumcircles(points, t)[2]).all())
    True
    """
    lengths = np.linalg.norm(np.diff(points[segments], axis=1)[:, 0], axis=1)
    floor = FLOOR * lengths.min()

    def long_enough(which: IndexArray) -> IndexArray:
        ends = points[segments[which]]
        return which[np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) > 2 * floor]

    while True:
        t = Delaunay(points).simplices
        split = long_enough(_encroached(points, segments, points))
        split = np.union1d(split, _missing(t, segments, len(points)))
        if len(split):
            points, segments = _halved(points, segments, split)
            continue
        t = t[inside(points[t].mean(axis=1)) >= 0]
        centres, radii, shortest = _circumcircles(points, t)
        bad = np.flatnonzero((radii > SHAPE * shortest) & (shortest > floor))
        bad = bad[np.argsort(-radii[bad] / shortest[bad])]
        bad = bad[_apart(centres[bad], radii[bad])] if len(bad) else bad
        split = long_enough(_encroached(points, segments, centres[bad]))
        if len(bad) == 0:
            return points, t
        if len(split):
            points, segments = _halved(points, segments, split)
            continue
        centres = centres[bad][inside(centres[bad]) >= 0]
        if len(centres) == 0:
            return points, t
        points = np.vstack([points, centres])
