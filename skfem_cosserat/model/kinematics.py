"""Null space matrix of a tree of joints.

``qdot = P(q) nu``, ``P = P_int(q) T(q)`` (theory: Betsch & Leyendecker, IJNME 67 (2006) 499).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_matrix

from ..kernels import cross, director_force
from ..pattern import sum_at
from ..relative import normals
from ..types import Array, Floats, IndexArray
from .spans import Spans
from .tree import Coordinate, Pair, Spot, Tree

__all__ = ["Kinematics", "Located"]


@dataclass(eq=False)
class Located:
    """Points and axes of the tree at a configuration.

    Attributes
    ----------
    y : (total, 3) array
    x : (spots, 3) array
    axis, arm : (pairs, 3) array
        a_k, and target - centre, of each turning pair (vertex, coordinate).
    left, right, slide : (slides, 3) array
        left_k, right_k and their cross product, of each sliding pair.
    """

    y: Array
    x: Array
    axis: Array
    arm: Array
    left: Array
    right: Array
    slide: Array


def combination(terms: Sequence[Sequence[tuple[int, float]]]) -> tuple[IndexArray, Floats]:
    """Rows of y (k, r) and factors (k, 1, r) whose sums the terms are, zeros added."""
    size = max((len(t) for t in terms), default=0)
    full = [[*t, *[(0, 0.0)] * (size - len(t))] for t in terms]
    array = np.array(full, dtype=float).reshape(len(terms), size, 2)
    return array[:, :, 0].astype(np.int64), array[:, None, :, 1].copy()


class Kinematics:
    """Arrays of the twist map T(q) and of the reduction to twists.

    Parameters
    ----------
    tree : Tree
    row : (nv + ng,) int array
        First row of y of each vertex, ground frames included.
    is_frame : (nv,) bool array
    total : int
        Rows of y, ground included.
    """

    def __init__(self, tree: Tree, row: IndexArray, is_frame: IndexArray, total: int) -> None:
        nv = len(is_frame)
        self.tree, self.row, self.total = tree, row, total
        size = np.where(is_frame, 6, 3)
        self.twist_of = np.concatenate([[0], np.cumsum(size)])[:-1].astype(np.int64)
        self.n_twist = int(size.sum())
        self.unknowns = len(tree.coordinates)
        #: first twist number that moves each unknown row of y, and which of them are directors
        free = 4 * int(is_frame.sum()) + int((~is_frame).sum())
        self.row_twist = np.zeros(free, dtype=np.int64)
        self.row_is_director = np.zeros(free, dtype=bool)
        self.row_twist[row[:nv]] = self.twist_of
        for k in (1, 2, 3):
            directors = row[:nv][is_frame] + k
            self.row_twist[directors] = self.twist_of[is_frame] + 3
            self.row_is_director[directors] = True
        self.frames = np.flatnonzero(is_frame)
        self.points = np.flatnonzero(~is_frame)
        self.frame_rows = row[self.frames]
        self.director_rows = self.frame_rows[:, None] + np.arange(1, 4)
        #: frames only, one after the other: their rows are views then, without picking
        self._framed = bool(is_frame.all() and (self.frame_rows == 4 * np.arange(nv)).all())
        self.frame_twist = self.twist_of[self.frames][:, None] + np.arange(6)
        self.point_twist = self.twist_of[self.points][:, None] + np.arange(3)
        # forces on frames and points, then moments: which make up a twist force, three by three
        self._force_rows = np.concatenate([self.frame_rows, row[self.points]])
        first = [self.frame_twist[:, 0], self.point_twist[:, 0], self.frame_twist[:, 3]]
        self._by_twist = np.argsort(np.concatenate(first))
        self._frame_row = np.where(is_frame, row[:nv], -1)
        self._spots: dict[Spot, int] = {}
        #: (coordinate numbers, (parent spot, child spot)) of points that move on spheres
        self.spheres = [
            (
                [k for k in tree.own[e.child] if tree.coordinates[k].kind == "sphere"],
                (e.parent_spot, e.child_spot),
            )
            for e in tree.edges
            if e.joint.freedom().sphere and tree.plane is None
        ]
        self._pairs()
        self._prepare_curvature()

    def _spot(self, spot: Spot) -> int:
        return self._spots.setdefault(spot, len(self._spots))

    def spot_terms(self, spot: Spot) -> list[tuple[int, float]]:
        """Rows of y and factors whose sum is the spot's position."""
        base = int(self.row[spot.vertex])
        return [(base, 1.0)] + [(base + i + 1, X) for i, X in enumerate(spot.offset) if X != 0]

    def _pairs(self) -> None:
        tree, cs = self.tree, self.tree.coordinates
        both = [*cs, *tree.driven]
        constant = np.array([c.kind not in ("axis", "slide") for c in both], dtype=bool)
        self.axis = np.array([c.axis for c in both]).reshape(len(both), 3) * constant[:, None]
        self.guided = [c for c in both if c.kind == "axis"]
        self.sliding = [c for c in both if c.kind == "slide"]
        turning = [p for p in tree.pairs if p.target is not None]
        shifting = [p for p in tree.pairs if p.target is None and cs[p.number].kind != "slide"]
        slides = [p for p in tree.pairs if p.target is None and cs[p.number].kind == "slide"]
        self.pair_vertex = np.array([p.vertex for p in turning], dtype=np.int64)
        self.pair_number = np.array([p.number for p in turning], dtype=np.int64)
        self.pair_target = np.array([self._spot(p.target) for p in turning], dtype=np.int64)  # type: ignore[arg-type]
        self.pair_centre = np.array(
            [self._spot(cs[p.number].centre) for p in turning],  # type: ignore[arg-type]
            dtype=np.int64,
        )
        slide_of = {c.number: i for i, c in enumerate(self.sliding)}
        self.slide_number = np.array([p.number for p in slides], dtype=np.int64)
        self._slide_of = np.array([slide_of[p.number] for p in slides], dtype=np.int64)
        frame = self._frame_row[self.pair_vertex] >= 0 if turning else np.zeros(0, dtype=bool)
        rotates = np.array([p.rotates for p in turning], dtype=bool) & frame
        self.pair_rotates = np.flatnonzero(rotates)
        self.spots = list(self._spots)
        # spots, then material axes: one product gives all points and axes of a configuration
        self._combine = combination(
            [self.spot_terms(s) for s in self.spots]
            + [self._axis_terms(c, c.axis) for c in self.guided]
            + [self._axis_terms(c, c.axis) for c in self.sliding]
            + [self._axis_terms(c, c.right) for c in self.sliding if c.right is not None]
        )
        self.hinges = np.array([c.number for c in self.guided], dtype=np.int64)
        self.tracks = np.array([c.number for c in self.sliding], dtype=np.int64)
        hinge_of = {number: i for i, number in enumerate(self.hinges.tolist())}
        numbers = self.pair_number.tolist()
        #: where axes of pairs are: among those that are fixed, then those of hinges
        self._axis_of = np.array(
            [len(both) + hinge_of[k] if k in hinge_of else k for k in numbers], dtype=np.int64
        )
        # few pairs, all on hinges: spots, then axes and arms of pairs, in one product
        self._few = not slides and len(turning) <= len(self.spots) and hinge_of.keys() >= {*numbers}
        centres = [cs[p.number] for p in turning] if self._few else []
        self._combine_few = combination(
            [self.spot_terms(s) for s in self.spots]
            + [self._axis_terms(c, c.axis) for c in centres]
            + [
                [*self.spot_terms(p.target), *((a, -f) for a, f in self.spot_terms(c.centre))]  # type: ignore[arg-type]
                for p, c in zip(turning, centres, strict=False)
            ]
        )
        turned: dict[int, list[tuple[int, int]]] = {}
        for k, p in enumerate(turning):
            if p.rotates:
                turned.setdefault(p.vertex, []).append((p.number, k))
        flexible = any(not span.rigid for span, _ in tree.spans)
        self.spans = Spans(tree, self.row, self.twist_of, turned) if flexible else None
        self._T_pattern(shifting, slides)

    def _T_pattern(self, shifting: Sequence[Pair], slides: Sequence[Pair]) -> None:
        """Identity of free vertices, constant shifts, turning pairs, slides."""
        tree, cs = self.tree, self.tree.coordinates
        rows, cols, ones = [], [], []
        for v in tree.free:
            for k in tree.own[v]:
                first = int(self.twist_of[v]) + (3 if cs[k].kind == "rotation" else 0)
                along = np.flatnonzero(cs[k].axis)
                rows += (first + along).tolist()
                cols += [k] * len(along)
                ones += cs[k].axis[along].tolist()
        for p in shifting:
            rows += [int(self.twist_of[p.vertex]) + i for i in range(3)]
            cols += [p.number] * 3
            ones += cs[p.number].axis.tolist()
        base = self.twist_of[self.pair_vertex][:, None] + np.arange(3)
        number = np.repeat(self.pair_number[:, None], 3, axis=1)
        slide_vertex = np.array([p.vertex for p in slides], dtype=np.int64)
        self._slide_twist = self.twist_of[slide_vertex][:, None] + np.arange(3)
        self.T_rows = np.concatenate(
            [
                np.array(rows, dtype=np.int64),
                base.ravel(),
                (base[self.pair_rotates] + 3).ravel(),
                self._slide_twist.ravel(),
            ]
        )
        self.T_cols = np.concatenate(
            [
                np.array(cols, dtype=np.int64),
                number.ravel(),
                number[self.pair_rotates].ravel(),
                np.repeat(self.slide_number, 3),
            ]
        )
        if self.spans is not None:
            self.T_rows = np.concatenate([self.T_rows, self.spans.T_rows])
            self.T_cols = np.concatenate([self.T_cols, self.spans.T_cols])
        self._T_constant = np.array(ones)
        self.n_fixed = len(ones)
        #: entries that are 1 at any configuration
        self.ones: IndexArray = np.flatnonzero(self._T_constant == 1)
        order = np.lexsort((self.T_cols, self.T_rows))
        self._order = order
        indptr = np.searchsorted(self.T_rows[order], np.arange(self.n_twist + 1))
        self._T_structure = (self.T_cols[order].astype(np.int32), indptr.astype(np.int32))

    def _axis_terms(self, c: Coordinate, axis: Floats) -> list[tuple[int, float]]:
        return [(int(self.row[c.guide]) + i + 1, float(axis[i])) for i in range(3)]

    def _prepare_curvature(self) -> None:
        """Which pairs have an axis or a point that moves with a vertex, and its twist."""
        nv = len(self.twist_of)
        track = np.array([c.guide for c in self.sliding], dtype=np.int64)[self._slide_of]
        self._on_track = np.flatnonzero(track < nv)
        self._track_twist = self.twist_of[track[self._on_track]] + 3
        guide = np.array([c.guide for c in self.tree.coordinates], dtype=np.int64)
        which = guide[self.pair_number]
        self._guided = np.flatnonzero((which >= 0) & (which < nv))
        self._guide_twist = self.twist_of[which[self._guided]] + 3
        self._spot_vertex = np.array([s.vertex for s in self.spots], dtype=np.int64)
        self._spot_base = self.row[self._spot_vertex]
        self._spot_turns = np.array([any(s.offset) for s in self.spots], dtype=bool)
        self._pair_twist = self.twist_of[self.pair_vertex][:, None] + np.arange(3)
        self._rotated_twist = self._pair_twist[self.pair_rotates] + 3
        # targets, then centres, as far as they move with a vertex; which of them feel its rotation
        spots = np.concatenate([self.pair_target, self.pair_centre])
        vertex = self._spot_vertex[spots]
        on = np.flatnonzero(vertex < nv)
        self._spot_twist = self.twist_of[vertex[on]]
        self._spot_pair = on % max(len(self.pair_number), 1)
        self._spot_sign = np.where(on < len(self.pair_number), 1.0, -1.0)[:, None]
        self._turning = np.flatnonzero(self._spot_turns[spots[on]])
        self._turning_spot = spots[on][self._turning]

    # -- evaluation ----------------------------------------------------------------------------

    def combined(self, y: Array) -> tuple[Array, Array, Array, Array]:
        """Spots, axes of hinges, left and right vectors of slides at y."""
        rows, factors = self._combine
        both = (factors @ y.take(rows, axis=0))[:, 0]
        a, b = len(self.spots), len(self.hinges)
        c = a + b + len(self.tracks)
        return both[:a], both[a : a + b], both[a + b : c], both[c:]

    def points_and_axes(self, y: Array, fixed: Floats) -> tuple[Array, Array]:
        """Spots (k, 3) and axes or slides (K + driven, 3); `fixed` holds what y does not change."""
        x, hinges, left, right = self.combined(y)
        if not (len(hinges) or len(left)):
            return x, fixed
        axes = fixed.astype(x.dtype)
        axes[self.hinges] = hinges
        if len(left):
            axes[self.tracks] = cross(left, right)
        return x, axes

    def locate(self, y: Array, fixed: Floats) -> Located:
        """What all functions of the tree need at configuration y."""
        if not len(self.pair_number) and not len(self.slide_number):
            return Located(y, *(y[:0],) * 6)
        if self._few:
            rows, factors = self._combine_few
            every = (factors @ y.take(rows, axis=0))[:, 0]
            a = len(self.spots)
            b = a + len(self.pair_number)
            return Located(y, every[:a], every[a:b], every[b:], *(y[:0],) * 3)
        x, hinges, left, right = self.combined(y)
        axis = np.concatenate([fixed, hinges]).take(self._axis_of, axis=0)
        arm = x.take(self.pair_target, axis=0) - x.take(self.pair_centre, axis=0)
        if not len(self.slide_number):
            return Located(y, x, axis, arm, left, right, left)
        left, right = left[self._slide_of], right[self._slide_of]
        return Located(y, x, axis, arm, left, right, cross(left, right))

    def T_values(self, at: Located) -> Array:
        """Entries of T at ``(T_rows, T_cols)``."""
        if not len(self.T_rows) > self.n_fixed:
            return self._T_constant
        axis = at.axis
        shift = cross(axis, at.arm)
        turn = axis.take(self.pair_rotates, axis=0)
        parts = [self._T_constant, shift.ravel(), turn.ravel()]
        if len(self.slide_number):
            parts.append(at.slide.ravel())
        if self.spans is not None:
            parts.append(self.spans.values(at.y, axis))
        return np.concatenate(parts)

    def reduce(self, values: Array, twist_force: Array) -> Array:
        """``T^T t`` (unknowns,) from T's entries."""
        return sum_at(self.T_cols, values * twist_force.take(self.T_rows), self.unknowns)

    def expand(self, values: Array, rates: Array) -> Array:
        """``T nu`` (n_twist,) from T's entries."""
        return sum_at(self.T_rows, values * rates.take(self.T_cols), self.n_twist)

    def T_matrix(self, values: Array) -> csr_matrix:
        """T (n_twist, unknowns) from its entries."""
        indices, indptr = self._T_structure
        shape = (self.n_twist, self.unknowns)
        return csr_matrix((values[self._order], indices, indptr), shape=shape)

    def directors(self, y: Array) -> Array:
        """Directors (nf, 3, 3) of the frames, rows d1, d2, d3; not to be written to."""
        if self._framed:
            return y[: 4 * len(self.frames)].reshape(-1, 4, 3)[:, 1:]
        return y.take(self.director_rows, axis=0)

    def twist_force(self, y: Array, force: Array) -> Array:
        """``P_int(y)^T f``: force and moment of each vertex, (n_twist,) from (nv, 3)."""
        if self._framed:
            f = force[: 4 * len(self.frames)].reshape(-1, 4, 3)
            moment = director_force(self.directors(y), f[:, 1:])
            return np.concatenate([f[:, 0], moment], axis=1).ravel()
        parts = [
            force.take(self._force_rows, axis=0),
            director_force(self.directors(y), force.take(self.director_rows, axis=0)),
        ]
        return np.concatenate(parts).take(self._by_twist, axis=0).ravel()

    def rates(self, y: Array, twist: Array) -> Array:
        """``P_int(y) t``: rates of the rows of y that are unknowns."""
        out = np.zeros((len(self.row_twist), 3), dtype=np.result_type(y, twist))
        omega = twist[self.frame_twist[:, 3:]]
        out[self.frame_rows] = twist[self.frame_twist[:, :3]]
        out[self.director_rows] = cross(omega[:, None, :], self.directors(y))
        if len(self.points):
            out[self.row[self.points]] = twist[self.point_twist]
        return out

    def fixed_axes(self, y0: Array) -> Floats:
        """Axes (K + driven, 3) that stay as they are during a step from y0."""
        if not self.spheres:
            return self.axis
        fixed = self.axis.copy()
        for numbers, ends in self.spheres:
            a, b = (sum(c * y0[row] for row, c in self.spot_terms(spot)) for spot in ends)
            fixed[numbers] = _plane(b - a)
        return fixed

    # -- derivative of T^T f by the configuration, for schemes that evaluate T at midpoints ------

    def curvature_pattern(self) -> tuple[IndexArray, IndexArray]:
        """Rows (unknowns) and columns (twists) of :meth:`curvature_values`."""
        guided = self._guided
        number, turning = self.pair_number[self._spot_pair], self._turning
        rows = [np.repeat(n, 3) for n in (self.pair_number[guided], number, number[turning])]
        twists = (self._guide_twist, self._spot_twist, self._spot_twist[turning] + 3)
        cols = [(twist[:, None] + np.arange(3)).ravel() for twist in twists]
        rows.append(np.repeat(self.slide_number[self._on_track], 3))
        cols.append((self._track_twist[:, None] + np.arange(3)).ravel())
        return np.concatenate(rows), np.concatenate(cols)

    def curvature_values(self, at: Located, at1: Located, twist_force: Array) -> Array:
        """``d(T^T t)`` for fixed t, evaluated at y, as rows on the twists that move y1.

        The factor of y1 in y (1/2 at the midpoint) is left to the caller.
        """
        force = twist_force.take(self._pair_twist)
        parts = []
        guided = self._guided
        if len(guided):
            moment = cross(at.arm, force)
            moment[self.pair_rotates] += twist_force.take(self._rotated_twist)
            parts.append(cross(at1.axis.take(guided, axis=0), moment.take(guided, axis=0)))
        if len(self._spot_pair):
            signed = self._spot_sign * cross(force, at.axis).take(self._spot_pair, axis=0)
            parts.append(signed)
        if len(self._turning):
            spot = self._turning_spot
            arm = at1.x.take(spot, axis=0) - at1.y.take(self._spot_base[spot], axis=0)
            parts.append(cross(arm, signed.take(self._turning, axis=0)))
        on = self._on_track
        if len(on):
            f = twist_force[self._slide_twist[on]]
            parts.append(
                cross(at1.left[on], cross(at.right[on], f))
                + cross(at1.right[on], cross(f, at.left[on]))
            )
        return np.concatenate(parts).ravel() if parts else force[:0].ravel()


def _plane(arm: Array) -> Floats:
    """Two unit vectors (2, 3) normal to `arm` and to each other."""
    return normals(np.real(arm) / np.linalg.norm(np.real(arm)))
