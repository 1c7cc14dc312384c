"""Line meshes of space curves for scikit-fem: networks, branches and closed loops."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from skfem import Mesh, MeshLine1
from skfem.mapping import Mapping as SkfemMapping

from ..arguments import checked
from ..errors import MeshError, writing
from ..frozen import Frozen
from ..types import (
    Array,
    ArrayLike,
    FilePath,
    Floats,
    IndexArray,
    VectorLike,
    check_kind,
    is_whole,
    positive,
    switch,
)
from . import topology
from .curves import Curve, CurveArc, CurveHelix, CurveLine, CurveMoved, CurveSpline, vector
from .topology import (
    beam_nodes,
    chain_arrays,
    check_arrays,
    check_geometry,
    element_count,
)

if TYPE_CHECKING:
    from .files import LineData

# -- the arc-length mapping scikit-fem evaluates bases with ----------------------------------------


@checked
class MappingCurve(SkfemMapping):
    """Maps [0, 1] onto each element of a space curve, proportionally to arc length.

    Points have three rows (x, y, z) and reference points one. The Jacobian is ds/dxi, the length
    of the element, so that ``u.grad[0]`` in a form is the derivative with respect to arc
    length. Facet normals are the unit tangents (3 rows) that point out of the element.

    Parameters
    ----------
    mesh : MeshCurve
        The mesh; its lengths, curves and vertices are used.

    Examples
    --------
    >>> from skfem_cosserat.mesh import MeshCurve
    >>> mesh = MeshCurve.init_line((0, 0, 0), (0, 0, 4), elements=2)
    >>> mesh.mapping().F(np.array([[0.5]]))[:, 1, 0].tolist()
    [0.0, 0.0, 3.0]
    """

    def __init__(self, mesh: MeshCurve):
        self.mesh = mesh

    def _select(self, X: Array, tind: Array | None) -> tuple[Array, Array]:
        """Element numbers (n,) and reference coordinates (n, nq)."""
        elements = np.arange(self.mesh.nelements) if tind is None else np.asarray(tind)
        return elements, np.broadcast_to(X[0], (len(elements), X.shape[-1]))

    def _on_curves(self, elements: Array, xi: Array, tangent: bool) -> Floats:
        """Points or unit tangents (3, n, nq) of elements at reference coordinates (n, nq)."""
        mesh = self.mesh
        out = np.empty((3, *xi.shape))
        for c, rows in _by_curve(mesh.curve_ids[elements]):
            e = elements[rows]
            x = xi[rows]
            a = mesh.p[:, mesh.t[0, e], None]
            b = mesh.p[:, mesh.t[1, e], None]
            if c < 0:
                chord = (b - a) / mesh.lengths[e][:, None]
                out[:, rows] = chord + 0.0 * x if tangent else (1.0 - x) * a + x * b
                continue
            s0, s1 = mesh.spans[:, e, None]
            s = (1.0 - x) * s0 + x * s1
            if tangent:
                out[:, rows] = mesh.curves[c].tangent(s) * np.sign(s1 - s0)
            else:
                out[:, rows] = mesh.curves[c].point(s)
        return out

    def F(self, X: Array, tind: Array | None = None) -> Floats:
        """Points (3, ne, nq) at reference points (1, nq) or (1, ne, nq)."""
        return self._on_curves(*self._select(X, tind), tangent=False)

    def tangent(self, X: Array, tind: Array | None = None) -> Floats:
        """Unit tangents (3, ne, nq) of the curves in the elements' direction."""
        return self._on_curves(*self._select(X, tind), tangent=True)

    def invF(self, x: Array, tind: Array | None = None) -> Floats:
        """Reference coordinates (1, ne, nq) of the nearest points of the given elements.

        Exact at the ends; clipped to [0, 1].
        """
        x = np.asarray(x, float)
        mesh = self.mesh
        elements = np.arange(mesh.nelements) if tind is None else np.asarray(tind)
        length = mesh.lengths[elements][:, None]
        grid = np.linspace(0.0, 1.0, 9)
        near = self.F(grid[None, :], elements)
        xi = grid[np.linalg.norm(x[..., None] - near[:, :, None, :], axis=0).argmin(-1)]
        for _ in range(50):
            ahead = x - self.F(xi[None], elements)
            step = (ahead * self.tangent(xi[None], elements)).sum(0) / length
            new = np.clip(xi + step, 0.0, 1.0)
            done = abs(new - xi).max(initial=0.0) <= 1e-15
            xi = new
            if done:
                break
        for end in (0, 1):
            xi = np.where((x == mesh.p[:, mesh.t[end, elements], None]).all(0), float(end), xi)
        return xi[None]

    def detDF(self, X: Array, tind: Array | None = None) -> Floats:
        """Arc length for one unit of the reference coordinate (ne, nq), in m."""
        elements, xi = self._select(X, tind)
        return np.broadcast_to(self.mesh.lengths[elements][:, None], xi.shape)

    def DF(self, X: Array, tind: Array | None = None) -> Floats:
        """Arc length for one unit of the reference coordinate: a 1 x 1 Jacobian (1, 1, ne, nq)."""
        return self.detDF(X, tind)[None, None]

    def invDF(self, X: Array, tind: Array | None = None) -> Floats:
        """Its inverse (1, 1, ne, nq), in 1/m."""
        return 1.0 / self.DF(X, tind)

    def G(self, X: Array, find: Array | None = None) -> Floats:
        """Positions (3, nf, 1) of facets: in one dimension these are the vertices."""
        return self.mesh.p[:, self._vertices(find), None]

    def detDG(self, X: Array, find: Array | None = None) -> Floats:
        """Ones (nf, 1): an integral over a vertex is the value there."""
        return np.ones((len(self._vertices(find)), 1))

    def _vertices(self, find: Array | None) -> Array:
        """Vertex numbers of facets."""
        facets = self.mesh.facets[0]
        return facets if find is None else facets[np.asarray(find)]

    def normals(self, X: Array, tind: Array, find: Array, t2f: Array) -> Floats:
        """Unit tangents (3, nf, 1) at facets, pointing out of the elements ``tind``."""
        sign = np.where(t2f[1, tind] == find, 1.0, -1.0)
        xi = np.where(sign > 0, 1.0, 0.0)[:, None]
        return self._on_curves(np.asarray(tind), xi, tangent=True) * sign[:, None]


def _by_curve(ids: IndexArray) -> Iterator[tuple[int, IndexArray]]:
    """Each curve with the places (n,) in which it stands."""
    order = ids.argsort(kind="stable")
    cuts = np.flatnonzero(np.diff(ids[order])) + 1
    yield from ((int(ids[rows[0]]), rows) for rows in np.split(order, cuts) if len(rows))


# -- new arrays for changed meshes: joined, refined, restricted ------------------------------------


def halved_arrays(mesh: MeshCurve, marked: IndexArray) -> dict[str, Any]:
    """Fields of a mesh whose marked elements are halved; children take their parent's place."""
    ne = mesh.nelements
    nv = mesh.p.shape[1]
    halves = np.ones(ne, np.int64)
    halves[marked] = 2
    parent = np.arange(ne).repeat(halves)
    first = halves.cumsum() - halves
    t = mesh.t[:, parent].copy()
    spans = mesh.spans[:, parent].copy()
    left = first[marked]
    right = first[marked] + 1
    t[1, left] = t[0, right] = nv + np.arange(len(marked))
    spans[1, left] = spans[0, right] = mesh.spans[:, marked].mean(0)
    points = mesh.p
    if len(marked):
        points = np.concatenate([mesh.p, mesh.mapping().F(np.array([[0.5]]), marked)[:, :, 0]], 1)
    beams = None
    if mesh._subdomains is not None:
        beams = {k: np.flatnonzero(np.isin(parent, v)) for k, v in mesh.beams.items()}
    return {
        "doflocs": points,
        "t": t,
        "curve_ids": mesh.curve_ids[parent],
        "spans": spans,
        "_subdomains": beams,
    }


def moved_arrays(mesh: MeshCurve, rotation: Any, shift: Any, scale: float = 1.0) -> dict[str, Any]:
    """Fields of a mesh moved by ``x -> scale * rotation @ x + shift``."""
    turn = np.eye(3) if rotation is None else np.asarray(rotation, float)
    if turn.shape != (3, 3) or not np.allclose(turn @ turn.T, np.eye(3), rtol=0, atol=1e-12):
        raise MeshError("argument rotation", f"{turn.tolist()} is no orthogonal matrix")
    by = vector(shift, "argument shift")
    return {
        "doflocs": scale * turn @ mesh.p + by[:, None],
        "curves": [CurveMoved(curve, turn, by, scale) for curve in mesh.curves],
        "spans": scale * mesh.spans,
    }


def restricted_arrays(mesh: MeshCurve, elements: Array) -> tuple[dict[str, Any], IndexArray]:
    """Fields of a mesh with some elements only, and the old numbers of its vertices."""
    vertices = np.unique(mesh.t[:, elements])
    number = np.full(mesh.p.shape[1], -1)
    number[vertices] = np.arange(len(vertices))
    place = np.full(mesh.nelements, -1)
    place[elements] = np.arange(len(elements))
    nodes = {k: number[v][number[v] >= 0] for k, v in mesh.nodes.items()}
    beams = {k: place[v][place[v] >= 0] for k, v in mesh.beams.items()}
    arrays = {
        "doflocs": mesh.p[:, vertices],
        "t": number[mesh.t[:, elements]],
        "curve_ids": mesh.curve_ids[elements],
        "spans": mesh.spans[:, elements],
        "_boundaries": {k: v for k, v in nodes.items() if v.size},
        "_subdomains": {k: v for k, v in beams.items() if v.size},
    }
    return arrays, vertices


def joined_arrays(meshes: Sequence[MeshCurve], tol: float | None, weld: bool) -> dict[str, Any]:
    """Fields of the mesh of several meshes."""
    points = np.concatenate([m.p for m in meshes], 1)
    limit = 1e-9 * float(np.linalg.norm(np.ptp(points, axis=1))) if tol is None else float(tol)
    if not (np.isfinite(limit) and limit >= 0.0):
        raise MeshError("argument tol", f"got {tol}, expected a distance in m")
    kept = []
    numbers = []
    near = _near(points, limit) if weld else {}
    meeting = np.sort(np.array(list(near), np.int64))
    final = np.full(points.shape[1], -1)  # numbers of vertices that are kept
    start = total = 0
    for mesh in meshes:
        stop = start + mesh.p.shape[1]
        number = np.full(stop - start, -1)
        for v in meeting[slice(*np.searchsorted(meeting, (start, stop)))].tolist():
            found = sorted(int(final[u]) for u in near[v] if u < start and final[u] >= 0)
            if len(found) > 1:
                raise MeshError(
                    f"node at {points[:, v].tolist()}",
                    f"lies within tol = {limit:.3g} m of several nodes {found}: join with a"
                    " smaller tol or weld=False",
                )
            if found:
                number[v - start] = found[0]
        _check_welds(mesh, number, limit)
        new = number < 0
        final[start:stop][new] = number[new] = total + np.arange(new.sum())
        total = total + int(new.sum())
        start = stop
        kept.append(mesh.p[:, new])
        numbers.append(number)
    shifts = np.cumsum([0] + [len(m.curves) for m in meshes])
    first = np.cumsum([0] + [m.nelements for m in meshes])
    ids = [
        np.where(m.curve_ids < 0, -1, m.curve_ids + s) for m, s in zip(meshes, shifts, strict=False)
    ]
    return {
        "doflocs": np.concatenate(kept, 1),
        "t": np.concatenate([n[m.t] for m, n in zip(meshes, numbers, strict=True)], 1),
        "curves": [curve for m in meshes for curve in m.curves],
        "curve_ids": np.concatenate(ids),
        "spans": np.concatenate([m.spans for m in meshes], 1),
        "_subdomains": _united([m.beams for m in meshes], lambda k, v: v + first[k]),
        "_boundaries": _united([m.nodes for m in meshes], lambda k, v: numbers[k][v]),
    }


def _united(parts: Sequence[dict[str, IndexArray]], renumber: Any) -> dict[str, Any]:
    """All names of all meshes; what has one name in several meshes becomes one."""
    out: dict[str, list[IndexArray]] = {}
    for k, names in enumerate(parts):
        for name, index in names.items():
            out.setdefault(name, []).append(renumber(k, index))
    return {name: np.unique(np.concatenate(members)) for name, members in out.items()}


def _near(points: Floats, tol: float) -> dict[int, list[int]]:
    """Points (3, n) that lie within a distance of others before them, with the others."""
    from scipy.spatial import cKDTree  # slow to import, seldom needed

    near: dict[int, list[int]] = {}
    for i, j in cKDTree(points.T).query_pairs(tol, output_type="ndarray").tolist():
        near.setdefault(max(i, j), []).append(min(i, j))
    return near


def _check_welds(mesh: MeshCurve, number: IndexArray, tol: float) -> None:
    """Vertices of a mesh stay apart when they become those of the given numbers; -1: their own."""
    pairs = number[mesh.t]
    collapsed = (pairs[0] == pairs[1]) & (pairs[0] >= 0)
    if collapsed.any():
        a, b = mesh.p[:, mesh.t[:, np.argmax(collapsed)]].T.tolist()
        raise MeshError("argument tol", f"{tol:.3g} m would collapse the element from {a} to {b}")
    hit, times = np.unique(number[number >= 0], return_counts=True)
    if (times > 1).any():
        vertices = np.flatnonzero(number == hit[(times > 1).argmax()]).tolist()
        raise MeshError(
            f"node at {mesh.p[:, vertices[0]].tolist()}",
            f"nodes {vertices} of one mesh would all be merged into one: join with a smaller tol"
            " or weld=False",
        )


# -- line meshes of space curves for scikit-fem: networks, branches and closed loops ---------------


@dataclass(eq=False)
class MeshCurve(Frozen, MeshLine1):
    """Lines in space with true arc lengths; beams and nodes carry names.

    A :class:`skfem.MeshLine1` with three coordinates. ``skfem.Basis(mesh, element)`` works as
    on any other mesh, integrals are taken over arc length, ``u.grad[0]`` is d/ds, and named beams
    and nodes are scikit-fem's subdomains and boundaries. Any number of elements may meet at a
    vertex. Build meshes by the ``init_*`` factories, :meth:`joined` and :meth:`load`.

    Parameters
    ----------
    doflocs : (3, nv)
        Vertices (m).
    t : (2, ne)
        Start and end vertex of each element; tangents point from start to end.
    curves : sequence of Curve
        Curves that elements lie on.
    curve_ids : (ne,), optional
        Curve of each element, -1 (default) for the straight chord.
    spans : (2, ne), optional
        Arc lengths on its curve at which an element starts and ends (m); needed with curves.
    feature_angle : float
        Chords of one beam that meet at less than this angle (rad) approximate a smooth curve and
        share the mean tangent there; at a larger angle they form a corner.

    Raises
    ------
    MeshError
        For a mesh without elements, wrong shapes, coordinates that are not finite, elements of
        zero length, duplicated elements or vertices that belong to no element.

    Examples
    --------
    >>> import skfem
    >>> mesh = MeshCurve.init_arc((0, 0, 0), (1, 0, 0), (0, 1, 0), 2.0, 1.5, elements=4)
    >>> basis = skfem.Basis(mesh, skfem.ElementLineP1())
    >>> round(float(skfem.Functional(lambda w: 1.0 + 0.0 * w.x[0]).assemble(basis)), 12)
    3.0
    """

    doflocs: Any = field(default_factory=lambda: np.array([[0.0, 1.0], [0.0, 0.0], [0.0, 0.0]]))
    t: Any = field(default_factory=lambda: np.array([[0], [1]]))
    _boundaries: Any = None
    _subdomains: Any = None
    curves: Sequence[Curve] = ()
    curve_ids: Any = None
    spans: Any = None
    feature_angle: float = np.pi / 6

    def __post_init__(self) -> None:
        """Check the arrays, then everything that needs geometry."""
        self.doflocs, self.t = check_arrays(self.doflocs, self.t)
        MeshLine1.__post_init__(self)
        ne = self.t.shape[1]
        self.curves = tuple(self.curves)
        ids = np.full(ne, -1) if self.curve_ids is None else np.asarray(self.curve_ids, int)
        spans = np.zeros((2, ne)) if self.spans is None else np.array(self.spans, float)
        for item, array, shape in (("curve_ids", ids, (ne,)), ("spans", spans, (2, ne))):
            if array.shape != shape:
                raise MeshError(f"argument {item}", f"has shape {array.shape}, expected {shape}")
        topology.check_numbers("argument curve_ids", ids, -1, len(self.curves))
        chord = ids < 0
        ends = self.doflocs[:, self.t[:, chord]]
        spans[0, chord] = 0.0
        spans[1, chord] = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=0)
        self.curve_ids = ids
        self.spans = spans
        check_geometry(self)
        self._boundaries = locked(self._boundaries)
        self._subdomains = locked(self._subdomains)
        super().__post_init__()

    def __repr__(self) -> str:
        names = f", beams {', '.join(map(repr, self.beams))}" if self.beams else ""
        return (
            f"{type(self).__name__}({self.nelements} elements, {self.p.shape[1]} vertices{names})"
        )

    def summary(self) -> dict[str, Any]:
        """Size, beams and named nodes."""
        size = {"length in m": self.lengths.sum(), "elements": self.nelements}
        names = {"beams": ", ".join(self.beams), "nodes": ", ".join(self.nodes)}
        return {**size, "vertices": self.p.shape[1], **names}

    # ------------------------------------------------------------------ factories
    @classmethod
    def _from_chain(
        cls,
        arrays: dict[str, Any],
        name: str,
        nodes: Mapping[str, float] | None,
        closed: bool = False,
    ) -> Self:
        """Mesh of one beam."""
        named = beam_nodes(name, arrays["spans"], closed, nodes)
        return cls(_boundaries=named, _subdomains={name: np.arange(arrays["t"].shape[1])}, **arrays)

    @classmethod
    def init_curve(
        cls,
        curve: Curve,
        elements: int,
        name: str = "beam",
        nodes: Mapping[str, float] | None = None,
        closed: bool = False,
    ) -> Self:
        """One beam along any curve, in elements of equal length.

        Parameters
        ----------
        curve : Curve
            The curve, e.g. :class:`CurveSpline`.
        elements : int
            Number of elements.
        name : str
            Name of the beam. Its ends are nodes ``"<name>.start"`` and ``"<name>.end"``.
        nodes : dict of str to float, optional
            Further named nodes by relative arc length in [0, 1]; each must meet a vertex.
        closed : bool
            If the curve returns to its start (then there is no ``"<name>.end"``).

        Examples
        --------
        >>> mesh = MeshCurve.init_curve(CurveLine((0, 0, 0), (1, 0, 0)), 4, nodes={"mid": 0.5})
        >>> mesh.node("mid"), mesh.node("beam.end")
        (2, 4)
        """
        count = element_count(elements, f"beam '{name}'")
        closed = switch(f"beam '{name}'", closed, "closed")
        arcs = np.linspace(0.0, curve.length, count + 1)
        return cls._from_chain(chain_arrays([curve], [arcs], closed), name, nodes, closed)

    @classmethod
    def init_line(
        cls,
        start: VectorLike,
        end: VectorLike,
        elements: int,
        name: str = "beam",
        nodes: Mapping[str, float] | None = None,
    ) -> Self:
        """One straight beam; see :meth:`init_curve` and :class:`CurveLine`."""
        return cls.init_curve(CurveLine(start, end), elements, name, nodes)

    @classmethod
    def init_arc(
        cls,
        start: VectorLike,
        tangent: VectorLike,
        normal: VectorLike,
        radius: float,
        angle: float,
        elements: int,
        name: str = "beam",
        nodes: Mapping[str, float] | None = None,
    ) -> Self:
        """One beam on a circular arc, closed at an angle of 2 pi; see :class:`CurveArc`."""
        arc = CurveArc(start, tangent, normal, radius, angle)
        closed = bool(np.isclose(angle, 2 * np.pi, rtol=1e-14, atol=0.0))
        return cls.init_curve(arc, elements, name, nodes, closed)

    @classmethod
    def init_helix(
        cls,
        start: VectorLike,
        centre: VectorLike,
        axis: VectorLike,
        pitch: float,
        turns: float,
        elements: int,
        name: str = "beam",
        nodes: Mapping[str, float] | None = None,
    ) -> Self:
        """One beam on a helix; see :class:`CurveHelix`."""
        return cls.init_curve(CurveHelix(start, centre, axis, pitch, turns), elements, name, nodes)

    @classmethod
    def init_polyline(
        cls,
        corners: Sequence[VectorLike] | Floats,
        elements_per_leg: int | Sequence[int],
        name: str = "beam",
        nodes: Mapping[str, float] | None = None,
        closed: bool = False,
    ) -> Self:
        """One beam of straight legs that stay corners however small their angle is.

        Parameters
        ----------
        corners : (n, 3)
            Ends and corners in order (m).
        elements_per_leg : int or sequence of int
            Number of elements on every leg, or on each.
        name, nodes
            As in :meth:`init_curve`; relative arc lengths refer to the whole beam.
        closed : bool
            If a last leg leads back to the first corner.
        """
        closed = switch(f"beam '{name}'", closed, "closed")
        points = np.asarray(corners, float)
        if points.ndim != 2 or points.shape[1] != 3 or len(points) < 2 + closed:
            raise MeshError(
                f"beam '{name}'", f"corners have shape {points.shape}, expected (2 or more, 3)"
            )
        path = np.vstack([points, points[:1]]) if closed else points
        legs = [CurveLine(a, b) for a, b in pairwise(path)]
        per_leg: Any = elements_per_leg
        counts = list(per_leg) if np.ndim(per_leg) else [per_leg] * len(legs)
        if len(counts) != len(legs):
            raise MeshError(
                f"beam '{name}'", f"{len(counts)} numbers of elements for {len(legs)} legs"
            )
        arcs = [
            np.linspace(0.0, leg.length, element_count(count, f"beam '{name}'") + 1)
            for leg, count in zip(legs, counts, strict=True)
        ]
        return cls._from_chain(chain_arrays(legs, arcs, closed), name, nodes, closed)

    @classmethod
    def init_points(
        cls,
        points: Sequence[VectorLike] | Floats,
        name: str = "beam",
        nodes: Mapping[str, float] | None = None,
        closed: bool = False,
    ) -> Self:
        """One beam on the smooth spline through its vertices; see :class:`CurveSpline`.

        Parameters
        ----------
        points : (n, 3)
            The vertices in order (m); elements lie between neighbours.
        name, nodes, closed
            As in :meth:`init_curve`.
        """
        curve = CurveSpline(points, closed)
        arrays = chain_arrays([curve], [curve.knots], closed)
        arrays["doflocs"] = np.array(points, float).T
        return cls._from_chain(arrays, name, nodes, closed)

    @classmethod
    def load(cls, filename: FilePath, out: Any = None, **kwargs: Any) -> Self:
        """Mesh from a file; see :func:`skfem_cosserat.mesh.read_mesh`."""
        from . import files  # few scenes need it

        with files.read_errors(filename):
            mesh = cls._of_lines(files.read_lines(filename))
        topology.warn_of_crossings(mesh, np.arange(mesh.nelements))
        return mesh

    @classmethod
    def _of_lines(cls, lines: LineData) -> Self:
        """Mesh of straight lines, each beam in one direction."""
        return cls(lines.points, lines.t, lines.nodes, lines.beams).directed()

    @classmethod
    def from_meshio(cls, mesh: Any) -> Self:
        """Mesh of the lines of a ``meshio.Mesh``, with names as :func:`read_mesh` has them.

        Raises
        ------
        MeshError
            If it has no lines, or lines of more than two nodes.

        Examples
        --------
        >>> import meshio
        >>> lines = meshio.Mesh([[0.0, 0], [1, 0], [2, 0]], [("line", [[0, 1], [1, 2]])])
        >>> MeshCurve.from_meshio(lines).lengths.tolist()
        [1.0, 1.0]
        """
        from . import files

        try:
            return cls._of_lines(files.lines_of(mesh))
        except (AttributeError, ValueError) as error:
            raise MeshError("argument mesh", str(error)) from error

    @classmethod
    def from_mesh(cls, mesh: Mesh, edges: str | ArrayLike | None = None) -> Self:
        """Mesh of the lines of a mesh of scikit-fem, or of the edges of its elements.

        Coordinates that it lacks are zero. Of a line mesh subdomains are beams and boundaries are
        nodes; of a mesh of the plane boundaries are beams. Lines are straight.

        Parameters
        ----------
        mesh : skfem.Mesh
            In one, two or three dimensions.
        edges : str or (k,) int array, optional
            A boundary of a mesh of the plane by name, or numbers of its ``facets``, in space of
            its ``edges``; default: all.

        Raises
        ------
        MeshError
            If there is no such boundary or edge.

        Examples
        --------
        >>> import skfem
        >>> square = skfem.MeshQuad().with_boundaries({"left": lambda x: x[0] == 0})
        >>> MeshCurve.from_mesh(square, "left").p.T.tolist()
        [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
        >>> MeshCurve.from_mesh(skfem.MeshTet()).nelements
        18
        """
        from . import files

        return cls._of_lines(files.lines_of_skfem(mesh, edges))

    def save(
        self,
        filename: FilePath,
        point_data: Any = None,
        cell_data: Any = None,
        **kwargs: Any,
    ) -> None:
        """Write a file; see :func:`skfem_cosserat.mesh.write_mesh`."""
        from . import files

        lines = files.LineData(self.p, self.t, self.beams, self.nodes)
        files.write_lines(filename, lines, point_data, cell_data, **kwargs)

    def plot(
        self,
        path: FilePath | None = None,
        *,
        names: bool = True,
        camera: str | Sequence[Sequence[float]] = "iso",
        window: tuple[int, int] = (1600, 900),
    ) -> Any:
        """Picture of its lines, each named beam in a colour, its vertices and its named nodes.

        Parameters
        ----------
        path : path-like, optional
            Image file (``.png``). Default: shown in the notebook, or in a window.
        names, camera, window
            As for :meth:`skfem_cosserat.History.picture`.

        Returns
        -------
        Path
            The image file; without one what a notebook shows.

        Raises
        ------
        InputError, ImportError, CosseratError
            As :meth:`skfem_cosserat.History.picture`.

        Examples
        --------
        >>> mesh.plot("mesh.png")  # doctest: +SKIP
        """
        from ..picture import Look, picture_of_mesh

        return picture_of_mesh(self, path, Look(camera, names=names, window=window))

    # ------------------------------------------------------------------ geometry
    def _mapping(self) -> MappingCurve:
        """The arc-length mapping; scikit-fem asks for it here."""
        if "_cached_mapping" not in self.__dict__:
            self._cached_mapping = MappingCurve(self)
        return self._cached_mapping

    @property
    def lengths(self) -> Floats:
        """Arc lengths of the elements (ne,), in m."""
        return abs(self.spans[1] - self.spans[0])

    @property
    def size(self) -> float:
        """Diagonal of the box around all vertices (m)."""
        return float(np.linalg.norm(np.ptp(self.p, axis=1)))

    def param(self) -> float:
        """Length of the longest element (m)."""
        return float(self.lengths.max())

    def params(self) -> Floats:
        """Arc lengths of the elements (ne,), in m."""
        return self.lengths

    @property
    def chains(self) -> list[topology.Chain]:
        """Elements of each beam in order; a beam with branches has several chains."""
        return self.chain_order.chains()

    @cached_property
    def chain_order(self) -> topology.ChainOrder:
        """All :attr:`chains` as arrays."""
        return topology.find_chains(self.t, self.owners, list(self.beams))

    @property
    def arc_starts(self) -> Floats:
        """Arc length (ne,) from the start of the beam to the start of each element (m)."""
        return topology.arc_starts(self.chain_order, self.lengths)

    # ------------------------------------------------------------------ names
    @property
    def beams(self) -> dict[str, IndexArray]:
        """Named beams and their elements (scikit-fem's subdomains)."""
        return dict(self._subdomains or {})

    @property
    def nodes(self) -> dict[str, IndexArray]:
        """Named nodes and their vertices (scikit-fem's boundaries)."""
        return dict(self._boundaries or {})

    @property
    def owners(self) -> IndexArray:
        """Number (ne,) in ``list(mesh.beams)`` of the first beam an element is in, or -1."""
        owner = np.full(self.nelements, -1)
        for k, elements in reversed(list(enumerate(self.beams.values()))):
            owner[elements] = k
        return owner

    def unnamed_elements(self) -> IndexArray:
        """Elements that belong to no named beam."""
        return np.flatnonzero(self.owners < 0)

    def node(self, which: str | int | VectorLike) -> int:
        """Vertex number of a node given by name, number or position (3,).

        Raises
        ------
        MeshError
            If there is no such node; the message lists the names or the nearest vertex.
        """
        return topology.find_node(self, self.p.T, which)

    def elements_of(self, beam: str) -> IndexArray:
        """Elements of a named beam; MeshError lists the names there are."""
        return topology.find_beam(self._subdomains or {}, beam)

    def elements_at(self, which: str | int | VectorLike) -> IndexArray:
        """All elements that meet at a node (``f2t`` knows only two)."""
        return np.flatnonzero((self.t == self.node(which)).any(0))

    def with_nodes(self, nodes: Mapping[str, int | VectorLike]) -> Self:
        """Copy with further named nodes, by vertex number or position (3,).

        Examples
        --------
        >>> mesh = MeshCurve.init_line((0, 0, 0), (1, 0, 0), 2).with_nodes({"hook": (0.5, 0, 0)})
        >>> mesh.node("hook")
        1
        """
        known = self.nodes
        for name, which in nodes.items():
            if name in known:
                raise MeshError(f"node '{name}'", "the name is taken; names are unique")
            if isinstance(which, str):
                raise MeshError(f"node '{name}'", f"got {which!r}, expected a number or position")
            known[name] = np.array([self.node(which)])
        return replace(self, _boundaries=known)

    def with_beams(self, beams: Mapping[str, Any]) -> Self:
        """Copy with further named beams, by element numbers."""
        known = self.beams
        for name, elements in beams.items():
            if name in known:
                raise MeshError(f"beam '{name}'", "the name is taken; names are unique")
            known[name] = np.atleast_1d(np.asarray(elements))
        return replace(self, _subdomains=known)

    # ------------------------------------------------------------------ changes
    def joined(self, *others: MeshCurve, tol: float | None = None, weld: bool = True) -> Self:
        """One mesh of several; coinciding vertices of different meshes become one.

        A name of several meshes is that of all their elements, or nodes: pieces of a beam that
        follow each other become one beam, whose ends are NAME.start and NAME.end.

        Lines that cross where they have no common vertex stay apart: a :class:`ModelWarning` says
        where, unless nothing is merged at all.

        Parameters
        ----------
        *others : MeshCurve
            Meshes to add.
        tol : float, optional
            Distance up to which vertices coincide (m); 1e-9 of the overall size by default.
        weld : bool
            If False, nothing is merged (beams that meet in a joint keep a node each).

        Raises
        ------
        MeshError
            If ``tol`` would collapse an element.

        Examples
        --------
        >>> flange = MeshCurve.init_line((0, 0, 0), (2, 0, 0), 2, "flange")
        >>> web = MeshCurve.init_line((1, 0, 0), (1, 1, 0), 2, "web")
        >>> tee = flange.joined(web)
        >>> tee.p.shape[1], tee.elements_at("web.start").tolist()
        (5, [0, 1, 2])
        """
        weld = switch("argument weld", weld)
        meshes: list[MeshCurve] = [self, *others]
        mesh = replace(self, **joined_arrays(meshes, tol, weld))
        names = Counter(name for each in meshes for name in each.beams)
        if several := [name for name, count in names.items() if count > 1]:
            mesh = mesh.directed()
            nodes = mesh.nodes
            for name in several:
                first, last = mesh.t[:, mesh.beams[name]]
                for where, other, end in ((first, last, "start"), (last, first, "end")):
                    nodes.pop(f"{name}.{end}", None)
                    if len(found := np.setdiff1d(where, other)):
                        nodes[f"{name}.{end}"] = found
            mesh = replace(mesh, _boundaries=nodes)
        if weld:
            part = [np.full(each.nelements, k) for k, each in enumerate(meshes)]
            topology.warn_of_crossings(mesh, np.concatenate(part))
        return mesh

    def __add__(self, other: MeshCurve) -> Self:
        """Join two meshes, as ``self.joined(other)``."""
        return NotImplemented if not isinstance(other, MeshCurve) else self.joined(other)

    def directed(self) -> Self:
        """Copy in which the elements of each beam run head to tail; itself, if they do."""
        flip = topology.directed_flips(self.t, self.owners)
        if not flip.any():
            return self
        return replace(
            self,
            t=np.where(flip, self.t[::-1], self.t),
            spans=np.where(flip, self.spans[::-1], self.spans),
        )

    def refined(self, times_or_ix: Any = 1) -> Self:
        """Copy with halved elements; new vertices lie on the curves, names are kept.

        Parameters
        ----------
        times_or_ix : int or array or str
            Number of uniform refinements, or the elements to halve: numbers, a mask (ne,) or
            the name of a beam.
        """
        if is_whole(times_or_ix):
            mesh = self
            for _ in range(topology.number_of_times(times_or_ix, self.nelements)):
                mesh = mesh._adaptive(np.arange(mesh.nelements))
            return mesh
        if isinstance(times_or_ix, str):
            return self._adaptive(self.elements_of(times_or_ix))
        return self._adaptive(topology.element_numbers(times_or_ix, self.nelements))

    def at(self, s: ArrayLike, beam: str | None = None) -> MeshCurve:
        """Copy with vertices at arc lengths, as where a section has a kink.

        Parameters
        ----------
        s : float or (k,) array
            Arc lengths (m) from the start of the beam.
        beam : str, optional
            Its name; default: the whole mesh, which has to be a single line.

        Returns
        -------
        MeshCurve
            With as many elements as before, or as many as it takes, of equal lengths in between.

        Raises
        ------
        MeshError
            If the beam is unknown, branches or has gaps, or a place is beyond its ends.

        Examples
        --------
        >>> MeshCurve.init_line((0, 0, 0), (1, 0, 0), 4).at([0.3]).p[0].round(9).tolist()
        [0.0, 0.3, 0.533333333, 0.766666667, 1.0]
        """
        from .divide import divided

        elements, places = topology.places_along(self, s, beam)
        return divided(self, self.nelements, [*zip(elements, places, strict=True)])

    def _adaptive(self, marked: Array) -> Self:
        """Halve marked elements; the halves follow each other in their parent's place."""
        return replace(self, **halved_arrays(self, np.unique(marked)))

    def restrict(
        self,
        elements: Any,
        return_mapping: bool = False,
        skip_boundaries: bool = False,
        skip_subdomains: bool = False,
    ) -> Any:
        """Copy with some of the elements; see :meth:`skfem.Mesh.restrict`."""
        chosen = topology.element_numbers(self.normalize_elements(elements), self.nelements)
        arrays, vertices = restricted_arrays(self, chosen)
        if skip_boundaries:
            arrays["_boundaries"] = None
        if skip_subdomains:
            arrays["_subdomains"] = None
        mesh = replace(self, **arrays)
        return (mesh, vertices) if return_mapping else mesh

    def moved(self, rotation: ArrayLike | None = None, shift: VectorLike = (0.0, 0.0, 0.0)) -> Self:
        """Copy moved by ``x -> rotation @ x + shift``; rotation (3, 3) may be a reflection."""
        return replace(self, **moved_arrays(self, rotation, shift))

    def translated(self, diffs: VectorLike) -> Self:
        """Copy moved by a vector (3,)."""
        return self.moved(shift=diffs)

    def scaled(self, factors: float) -> Self:
        """Copy with all lengths times a positive number."""
        factor = positive("argument factors", "its value", factors)
        return replace(self, **moved_arrays(self, None, np.zeros(3), factor))

    def mirrored(self, normal: VectorLike, point: VectorLike | None = None) -> Self:
        """Copy reflected at the plane with a normal (3,) through a point (3,)."""
        n = np.asarray(normal, float)
        n = n / np.linalg.norm(n)
        base = np.zeros(3) if point is None else np.asarray(point, float)
        return self.moved(np.eye(3) - 2.0 * np.outer(n, n), 2.0 * (n @ base) * n)

    # ------------------------------------------------------------------ scikit-fem's hooks
    def elements_satisfying(self, test: Callable[[Array], Array]) -> Array:
        """Elements whose middle points (3, ne) on the curves satisfy a test."""
        return np.nonzero(test(self._mapping().F(np.array([[0.5]]))[:, :, 0]))[0].astype(np.int32)

    def element_finder(self, mapping: Any = None) -> Any:
        """Function that finds the elements at points ``(x, y, z)``, each (n,)."""
        return topology.element_finder(self)

    def is_valid(self, raise_: bool = False) -> bool:
        """True: what can be wrong was refused at construction."""
        return True

    @classmethod
    def init_refdom(cls) -> MeshLine1:
        """The reference element as a one-dimensional mesh."""
        return MeshLine1(MeshLine1.elem.refdom.p, MeshLine1.elem.refdom.t, validate=False)


def locked(sets: Any) -> Any:
    """Named sets of numbers, in arrays of their own that cannot be written to."""
    if sets is None:
        return None
    own = {name: np.array(numbers, np.int64) for name, numbers in sets.items()}
    for numbers in own.values():
        numbers.flags.writeable = False
    return own


# -- reading and writing meshes of lines: gmsh, VTU and what else meshio reads ---------------------


@checked
def read_mesh(path: FilePath) -> MeshCurve:
    """Mesh from the straight lines of a file.

    Elements are chords; where those of one beam meet at a small angle they share a mean tangent
    (``feature_angle`` of :class:`MeshCurve`). Lines of a beam that point against each other are
    turned; lines in no group belong to no beam (``mesh.unnamed_elements()``); points that belong
    to no line are dropped.

    Parameters
    ----------
    path : path
        gmsh ``.msh`` 4.1 or 2.2: physical lines are beams, physical points are named nodes. VTU:
        cell data ``beam:NAME`` and point data ``node:NAME``, 1 for members and 0 for others. Decks
        of Abaqus and CalculiX (``.inp``): elements with two nodes, ``*ELSET`` are beams, ``*NSET``
        are nodes. Decks of Nastran (``.bdf``, ``.nas``, ``.fem``): CBAR, CBEAM, CROD, CTUBE,
        CONROD. What else a deck says (sections, orientations, materials, other elements, steps) is
        not read: a :class:`ModelWarning` names it. Other formats as far as meshio reads them: sets
        of cells are beams, sets of points are nodes. Cells that are no lines are left out.

    Raises
    ------
    MeshError
        If the file cannot be read or is damaged, has no lines, has lines or polylines of more than
        two nodes, or names a point that belongs to no cell. A deck is refused for each keyword or
        card that is not known to leave nodes and elements as they are (``*NGEN``, a second
        ``*PART``, a GRID in another system of coordinates, offsets of ends). It names the file.

    Examples
    --------
    >>> import tempfile, os
    >>> path = os.path.join(tempfile.mkdtemp(), "line.msh")
    >>> write_mesh(path, MeshCurve.init_line((0, 0, 0), (1, 0, 0), 3, name="boom"))
    >>> list(read_mesh(path).beams)
    ['boom']
    """
    return MeshCurve.load(path)


@checked
def write_mesh(path: FilePath, mesh: MeshCurve, file_format: str | None = None) -> None:
    """Write vertices, elements and names without loss.

    Curves are not written: a file knows straight lines only. Coordinates keep all their digits.

    Parameters
    ----------
    path : path
        Ends in ``.msh``, ``.vtu`` or ``.vtk``.
    mesh : MeshCurve
        The mesh.
    file_format : str, optional
        ``"gmsh"`` (ASCII 4.1, default for ``.msh``), ``"gmsh22"`` (ASCII 2.2), ``"vtu"`` or
        ``"vtk"``.

    Raises
    ------
    MeshError
        If the format is unknown or cannot hold a name.
    InputError
        If the file cannot be written.
    StorageError
        If the disk is full.

    Examples
    --------
    >>> import tempfile, os
    >>> mesh = MeshCurve.init_line((0, 0, 0), (1, 0, 0), 3, name="boom")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_mesh(os.path.join(folder, "boom.msh"), mesh)
    ...     os.listdir(folder)
    ['boom.msh']
    """
    check_kind("argument mesh", mesh, MeshCurve)
    with writing(path):
        mesh.save(path, file_format=file_format)
