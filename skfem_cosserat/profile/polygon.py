"""Sections from polygons, triangulated."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from scipy.spatial import Delaunay, cKDTree
from skfem import MeshTri1

from ..errors import InputError
from ..frozen import Frozen
from ..types import NO_INDICES, ArrayLike, Floats, IndexArray, numbers
from .profile import AnyMaterial, Profile, signed_area

# -- triangles of good shape between given segments: Ruppert's refinement of Delaunay's mesh -------
#
# Segments in whose diametral circle a point lies are halved; then the circumcentres of the worst
# triangles are added, or the segments halved that they would come too close to (Ruppert, J.
# Algorithms 18 (1995) 548). Near corners sharper than 60 degrees that ends at a smallest length.

#: Circumradius by shortest edge that is good enough: angles above 22 degrees.
SHAPE = 1.35


def _halved(points: Floats, segments: IndexArray, which: IndexArray) -> tuple[Floats, IndexArray]:
    a, b = segments[which].T
    middle = len(points) + np.arange(len(which))
    kept = np.delete(segments, which, axis=0)
    new = np.column_stack([a, middle]), np.column_stack([middle, b])
    return np.vstack([points, (points[a] + points[b]) / 2]), np.vstack([kept, *new])


def _circumcircles(points: Floats, t: IndexArray) -> tuple[Floats, Floats, Floats]:
    """Centres, radii and shortest edges of triangles (k, 3)."""
    a, b, c = points[t[:, 0]], points[t[:, 1]], points[t[:, 2]]
    u = b - a
    v = c - a
    twice = 2 * (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])
    uu = (u**2).sum(1)
    vv = (v**2).sum(1)
    offset = np.column_stack([v[:, 1] * uu - u[:, 1] * vv, u[:, 0] * vv - v[:, 0] * uu])
    offset /= twice[:, None]
    shortest = np.sqrt(np.minimum(np.minimum(uu, vv), ((c - b) ** 2).sum(1)))
    return a + offset, np.linalg.norm(offset, axis=1), shortest


def _missing(t: IndexArray, segments: IndexArray, count: int) -> IndexArray:
    """Segments that are no edges of the triangles."""
    edges = np.sort(t[:, [[0, 1], [1, 2], [0, 2]]].reshape(-1, 2), axis=1) @ (count, 1)
    return np.flatnonzero(~np.isin(np.sort(segments, axis=1) @ (count, 1), edges))


def _encroached(points: Floats, segments: IndexArray, by: Floats) -> IndexArray:
    """Segments with a point of ``by`` inside their diametral circle."""
    if len(by) == 0:
        return NO_INDICES
    ends = points[segments]
    middle = ends.mean(1)
    radius = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) / 2
    near = cKDTree(by).query_ball_point(middle, radius * (1 - 1e-9), return_length=True)
    return np.flatnonzero(near > 0)


def _apart(centres: Floats, radii: Floats) -> IndexArray:
    """Centres that keep a distance from all taken before them: they can be added together."""
    close = cKDTree(centres).query_ball_point(centres, 0.8 * radii)
    taken = np.zeros(len(centres), bool)
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
    floor = 0.2 * lengths.min()

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
        t = t[inside(points[t].mean(1)) >= 0]
        centres, radii, shortest = _circumcircles(points, t)
        bad = np.flatnonzero((radii > SHAPE * shortest) & (shortest > floor))
        bad = bad[(-radii[bad] / shortest[bad]).argsort()]
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


# -- profiles bounded by polygons, with holes and of several materials (needs shapely) -------------


class Region(Frozen):
    """Part of a section of one material.

    Parameters
    ----------
    outline : (k, 2) array
        Corners (m), in either sense; the last one is joined to the first.
    material : Material or MaterialAnisotropic
    holes : sequence of (k, 2) arrays
        Polygons inside the outline that the material leaves out.

    Examples
    --------
    >>> from skfem_cosserat import Material
    >>> Region([(0, 0), (1, 0), (0, 1)], Material(1.0, 0.3, 1.0)).outline.shape
    (3, 2)
    """

    def __init__(self, outline: ArrayLike, material: AnyMaterial, holes: Sequence[ArrayLike] = ()):
        self.outline = _corners("outline", outline)
        self.material = material
        self.holes = tuple(_corners(f"hole {k}", hole) for k, hole in enumerate(holes))


def _corners(name: str, value: ArrayLike) -> Floats:
    """Corners of a simple polygon (k, 2)."""
    item = "polygon"
    out = numbers(item, name, value)
    if out.ndim != 2 or out.shape[1] != 2 or len(out) < 3:
        raise InputError(item, f"{name} has shape {out.shape}, expected (k, 2) with k >= 3")
    if not np.isfinite(out).all():
        raise InputError(item, f"{name} is not finite at corner {_first(~np.isfinite(out))}")
    if np.array_equal(out[0], out[-1]):
        out = out[:-1]  # closed by the user
    extent = np.ptp(out, axis=0).max()
    gaps = np.linalg.norm(out - np.roll(out, -1, axis=0), axis=1)
    if len(out) < 3 or (gaps <= 1e-12 * extent).any():
        k = int(np.argmin(gaps))
        raise InputError(
            item, f"{name}: corner {k} at {out[k].tolist()} is repeated; expected distinct corners"
        )
    shape = _shapely().Polygon(out)  # one that crosses itself may have an area of zero, too
    if max(abs(signed_area(out)), shape.convex_hull.area) <= 1e-12 * extent**2:
        raise InputError(item, f"{name} = {out.tolist()} has no area")
    reason = _shapely().is_valid_reason(shape)
    if reason != "Valid Geometry":
        raise InputError(item, f"{name} crosses or touches itself: {reason}")
    return out


def _first(bad: Any) -> int:
    return int(np.flatnonzero(bad.any(1))[0])


def _shapely() -> Any:
    try:
        import shapely
    except ImportError as error:
        raise InputError(
            "polygon", "shapely is not installed; install skfem-cosserat[polygons]"
        ) from error
    return shapely


def _shapes(regions: Sequence[Region]) -> list[Any]:
    """The regions as polygons of shapely that do not overlap."""
    shapely = _shapely()
    item = "polygon"
    shapes = []
    for k, region in enumerate(regions):
        outline = shapely.Polygon(region.outline)
        holes = [shapely.Polygon(hole) for hole in region.holes]
        for i, hole in enumerate(holes):
            if not outline.contains_properly(hole):
                raise InputError(
                    item, f"region {k}: hole {i} is not inside the outline, or touches it"
                )
            for j in range(i):
                if hole.intersects(holes[j]):
                    raise InputError(item, f"region {k}: holes {j} and {i} overlap or touch")
        shapes.append(shapely.Polygon(region.outline, region.holes))
    total = sum(shape.area for shape in shapes)
    for i in range(len(shapes)):
        for j in range(i):
            common = shapes[i].intersection(shapes[j]).area
            if common > 1e-9 * total:
                raise InputError(
                    item,
                    f"regions {j} and {i} overlap by an area of {common:.3g}; give the outer one"
                    " the inner as a hole",
                )
    return shapes


def _triangulated(shapes: list[Any]) -> MeshTri1:
    """Triangles whose edges follow all boundaries, with a subdomain for each region."""
    shapely = _shapely()
    boundaries = [shape.boundary for shape in shapes]
    lines = boundaries[0]
    if len(shapes) > 1:  # corners on an edge of another region become points of that edge
        extent = np.ptp(np.reshape(shapely.total_bounds(boundaries), (2, 2)), axis=0).max()
        lines = shapely.unary_union(boundaries, grid_size=1e-10 * extent)
    wall = 2 * sum(shape.area for shape in shapes) / lines.length  # its thickness, if it is thin
    pieces = shapely.get_parts(shapely.segmentize(lines, 2 * wall))
    ends = np.concatenate(
        [np.stack([x[:-1], x[1:]], 1) for x in map(shapely.get_coordinates, pieces)]
    )
    points, segments = np.unique(ends.reshape(-1, 2), axis=0, return_inverse=True)

    def owner(x: Floats) -> IndexArray:
        within = [shapely.contains_xy(shape, *x.T) for shape in shapes]
        return np.where(np.any(within, 0), np.argmax(within, 0), -1)

    for shape in shapes:
        shapely.prepare(shape)
    points, t = triangulate(points, segments.reshape(-1, 2), owner)
    owners = owner(points[t].mean(1))
    return MeshTri1(points.T.copy(), t.T.copy()).with_subdomains(
        {f"region {k}": np.flatnonzero(owners == k) for k in range(len(shapes))}
    )


class ProfileComposite(Profile):
    """Regions bounded by polygons, each of its own material, bonded where they touch.

    Needs shapely: ``pip install skfem-cosserat[polygons]``.

    Parameters
    ----------
    regions : sequence of Region
        They may touch along edges and must not overlap; a region inside another one fills a hole.

    Raises
    ------
    InputError
        If a polygon has fewer than three corners, repeats one, crosses itself or has no area; if
        a hole is not inside or overlaps another; if regions overlap or fall apart.

    Examples
    --------
    >>> from skfem_cosserat import Material
    >>> steel, timber = Material(210e9, 0.3, 7850), Material(11e9, 0.3, 500)
    >>> plate = Region([(-0.05, -0.005), (0.05, -0.005), (0.05, 0), (-0.05, 0)], steel)
    >>> joist = Region([(-0.02, 0), (0.02, 0), (0.02, 0.15), (-0.02, 0.15)], timber)
    >>> composite = ProfileComposite([plate, joist]).constants(1e-2)
    >>> round(composite.mass, 3)
    6.925
    """

    item = "polygon"

    def __init__(self, regions: Sequence[Region]):
        if len(regions) == 0:
            raise InputError(self.item, "no regions are given")
        for k, region in enumerate(regions):
            if not isinstance(region, Region):
                raise InputError(self.item, f"region {k} = {region!r}, expected a Region")
        mesh = _triangulated(_shapes(regions))
        super().__init__(mesh, {f"region {k}": region.material for k, region in enumerate(regions)})


class ProfilePolygon(ProfileComposite):
    """Polygon with holes.

    Needs shapely: ``pip install skfem-cosserat[polygons]``.

    Parameters
    ----------
    outline : (k, 2) array
        Corners ``(X_1, X_2)`` (m), in either sense; the last one is joined to the first.
    material : Material or MaterialAnisotropic
    holes : sequence of (k, 2) arrays
        Polygons inside that do not touch each other or the outline.

    Raises
    ------
    InputError
        See :class:`ProfileComposite`.

    Examples
    --------
    >>> from skfem_cosserat import Material
    >>> steel = Material(210e9, 0.3, 7850)
    >>> angle = [(0, 0), (0.1, 0), (0.1, 0.01), (0.01, 0.01), (0.01, 0.08), (0, 0.08)]
    >>> round(ProfilePolygon(angle, steel).constants(1e-2).area, 6)
    0.0017
    """

    def __init__(self, outline: ArrayLike, material: AnyMaterial, holes: Sequence[ArrayLike] = ()):
        super().__init__([Region(outline, material, holes)])
