"""Line meshes of space curves for scikit-fem: networks, branches and closed loops."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from os import PathLike
from typing import Any, Self

import numpy as np
from skfem import MeshLine1

from ..errors import MeshError
from ..types import Array, Floats, IndexArray, VectorLike
from . import formats, join, lookup, topology
from .build import CurveChain, beam_nodes, curve_chain, element_count
from .checks import check_arrays, check_geometry
from .curves import Curve, CurveArc, CurveHelix, CurveLine, CurveSpline
from .mapping import MappingCurve

__all__ = ["MeshCurve"]


@dataclass(repr=False, eq=False)
class MeshCurve(MeshLine1):
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
        super().__post_init__()
        ne = self.t.shape[1]
        self.curves = tuple(self.curves)
        ids = np.full(ne, -1) if self.curve_ids is None else np.asarray(self.curve_ids, dtype=int)
        spans = np.zeros((2, ne)) if self.spans is None else np.array(self.spans, dtype=float)
        for item, array, shape in (("curve_ids", ids, (ne,)), ("spans", spans, (2, ne))):
            if array.shape != shape:
                raise MeshError(f"argument {item}", f"has shape {array.shape}, expected {shape}")
        if ids.min() < -1 or ids.max() >= len(self.curves):
            bad = ids.min() if ids.min() < -1 else ids.max()
            raise MeshError("argument curve_ids", f"names curve {bad} of {len(self.curves)} curves")
        chord = ids < 0
        ends = self.doflocs[:, self.t[:, chord]]
        spans[0, chord] = 0.0
        spans[1, chord] = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=0)
        self.curve_ids, self.spans = ids, spans
        check_geometry(self)

    # ------------------------------------------------------------------ factories
    @classmethod
    def _from_chain(
        cls,
        chain: CurveChain,
        curves: Sequence[Curve],
        name: str,
        nodes: Mapping[str, float] | None,
        closed: bool = False,
    ) -> Self:
        """Mesh of one beam."""
        return cls(
            doflocs=chain.points,
            t=chain.t,
            _boundaries=beam_nodes(name, chain.spans, closed, nodes),
            _subdomains={name: np.arange(chain.t.shape[1])},
            curves=curves,
            curve_ids=chain.curve_ids,
            spans=chain.spans,
        )

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
        chain = curve_chain([curve], [np.linspace(0.0, curve.length, count + 1)], closed)
        return cls._from_chain(chain, [curve], name, nodes, closed)

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
        helix = CurveHelix(start, centre, axis, pitch, turns)
        return cls.init_curve(helix, elements, name, nodes)

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
        points = np.asarray(corners, dtype=float)
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
        return cls._from_chain(curve_chain(legs, arcs, closed), legs, name, nodes, closed)

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
        chain = curve_chain([curve], [curve.knots], closed)
        chain = replace(chain, points=np.array(points, dtype=float).T)
        return cls._from_chain(chain, [curve], name, nodes, closed)

    @classmethod
    def load(cls, filename: str | PathLike[str], out: Any = None, **kwargs: Any) -> Self:
        """Mesh from a file; see :func:`skfem_cosserat.mesh.read_mesh`."""
        lines = formats.read_lines(filename)
        mesh = cls(
            doflocs=lines.points,
            t=lines.t,
            _boundaries=lines.nodes,
            _subdomains=lines.beams,
        )
        return mesh.directed()

    def save(
        self,
        filename: str | PathLike[str],
        point_data: Any = None,
        cell_data: Any = None,
        **kwargs: Any,
    ) -> None:
        """Write a file; see :func:`skfem_cosserat.mesh.write_mesh`."""
        lines = formats.LineData(self.p, self.t, self.beams, self.nodes)
        formats.write_lines(filename, lines, point_data, cell_data, **kwargs)

    # ------------------------------------------------------------------ geometry
    def _mapping(self) -> MappingCurve:
        """The arc-length mapping; scikit-fem asks for it here."""
        if "_cached_mapping" not in self.__dict__:
            self._cached_mapping = MappingCurve(self)
        return self._cached_mapping

    @property
    def lengths(self) -> Floats:
        """Arc lengths of the elements (ne,), in m."""
        return np.abs(self.spans[1] - self.spans[0])

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
        if "_chains" not in self.__dict__:
            self._chains = topology.find_chains(self.t, self.owners, list(self.beams))
        return self._chains

    @property
    def arc_starts(self) -> Floats:
        """Arc length (ne,) from the start of the beam to the start of each element (m)."""
        return topology.arc_starts(self.chains, self.lengths)

    # ------------------------------------------------------------------ names
    @property
    def beams(self) -> dict[str, IndexArray]:
        """Named beams and their elements (scikit-fem's subdomains)."""
        return {k: np.asarray(v, dtype=np.int64) for k, v in (self._subdomains or {}).items()}

    @property
    def nodes(self) -> dict[str, IndexArray]:
        """Named nodes and their vertices (scikit-fem's boundaries)."""
        return {k: np.asarray(v, dtype=np.int64) for k, v in (self._boundaries or {}).items()}

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
        return lookup.find_node(self.p.T, self.nodes, which, self.size)

    def elements_of(self, beam: str) -> IndexArray:
        """Elements of a named beam; MeshError lists the names there are."""
        return lookup.find_beam(self.beams, beam)

    def elements_at(self, which: str | int | VectorLike) -> IndexArray:
        """All elements that meet at a node (``f2t`` knows only two)."""
        return np.flatnonzero((self.t == self.node(which)).any(axis=0))

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
            If two meshes use the same beam or node name, or ``tol`` would collapse an element.

        Examples
        --------
        >>> flange = MeshCurve.init_line((0, 0, 0), (2, 0, 0), 2, "flange")
        >>> web = MeshCurve.init_line((1, 0, 0), (1, 1, 0), 2, "web")
        >>> tee = flange.joined(web)
        >>> tee.p.shape[1], tee.elements_at("web.start").tolist()
        (5, [0, 1, 2])
        """
        return replace(self, **join.joined_arrays([self, *others], tol, weld))

    def __add__(self, other: MeshCurve) -> Self:
        """The same as ``self.joined(other)``."""
        if not isinstance(other, MeshCurve):
            return NotImplemented
        return self.joined(other)

    def directed(self) -> Self:
        """Copy in which the elements of each beam run head to tail."""
        flip = topology.directed_flips(self.t, self.owners)
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
        if isinstance(times_or_ix, (int, np.integer)) and not isinstance(times_or_ix, bool):
            mesh = self
            for _ in range(lookup.number_of_times(times_or_ix)):
                mesh = mesh._adaptive(np.arange(mesh.nelements))
            return mesh
        if isinstance(times_or_ix, str):
            return self._adaptive(self.elements_of(times_or_ix))
        return self._adaptive(lookup.element_numbers(times_or_ix, self.nelements))

    def _adaptive(self, marked: Array) -> Self:
        """Halve marked elements; the halves follow each other in their parent's place."""
        return replace(self, **join.halved_arrays(self, np.unique(marked)))

    def restrict(
        self,
        elements: Any,
        return_mapping: bool = False,
        skip_boundaries: bool = False,
        skip_subdomains: bool = False,
    ) -> Any:
        """Copy with some of the elements; see :meth:`skfem.Mesh.restrict`."""
        arrays, vertices = join.restricted_arrays(self, self.normalize_elements(elements))
        if skip_boundaries:
            arrays["_boundaries"] = None
        if skip_subdomains:
            arrays["_subdomains"] = None
        mesh = replace(self, **arrays)
        return (mesh, vertices) if return_mapping else mesh

    def moved(self, rotation: Any = None, shift: VectorLike = (0.0, 0.0, 0.0)) -> Self:
        """Copy moved by ``x -> rotation @ x + shift``; rotation (3, 3) may be a reflection."""
        return replace(self, **join.moved_arrays(self, rotation, shift))

    def translated(self, diffs: VectorLike) -> Self:
        """Copy moved by a vector (3,)."""
        return self.moved(shift=diffs)

    def mirrored(self, normal: VectorLike, point: VectorLike | None = None) -> Self:
        """Copy reflected at the plane with a normal (3,) through a point (3,)."""
        n = np.asarray(normal, dtype=float)
        n = n / np.linalg.norm(n)
        base = np.zeros(3) if point is None else np.asarray(point, dtype=float)
        return self.moved(np.eye(3) - 2.0 * np.outer(n, n), 2.0 * (n @ base) * n)

    # ------------------------------------------------------------------ scikit-fem's hooks
    def elements_satisfying(self, test: Any) -> Array:
        """Elements whose middle points (3, ne) on the curves satisfy a test."""
        return np.nonzero(test(self._mapping().F(np.array([[0.5]]))[:, :, 0]))[0].astype(np.int32)

    def element_finder(self, mapping: Any = None) -> Any:
        """Function that finds the elements at points ``(x, y, z)``, each (n,)."""
        return lookup.element_finder(self)

    def is_valid(self, raise_: bool = False) -> bool:
        """True: what can be wrong was refused at construction."""
        return True

    @classmethod
    def init_refdom(cls) -> MeshLine1:
        """The reference element as a one-dimensional mesh."""
        return MeshLine1(MeshLine1.elem.refdom.p, MeshLine1.elem.refdom.t, validate=False)
