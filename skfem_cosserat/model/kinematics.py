"""Kinematics of the nodes by the coordinates of the tree."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_matrix, csr_matrix
from scipy.sparse.linalg import splu

from ..kernels import cross, director_force, skew
from ..pattern import FrozenPattern, sum_at
from ..relative import normals
from ..types import Array, Floats, IndexArray
from .tree import KINDS, Coordinate, Pairs, Spot, Tree

# -- null space matrix of a tree of joints ---------------------------------------------------------
#
# ``qdot = P(q) nu``, ``P = P_int(q) T(q)`` (theory: Betsch & Leyendecker, IJNME 67 (2006) 499).


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
    size = max(map(len, terms), default=0)
    full = [[*t, *[(0, 0.0)] * (size - len(t))] for t in terms]
    array = np.array(full, float).reshape(len(terms), size, 2)
    return array[:, :, 0].astype(np.int64), array[:, None, :, 1].copy()


class Kinematics:
    """Arrays of the reduction to twists and, in :attr:`T`, of the twist map.

    Parameters
    ----------
    tree : Tree
    row : (nv + ng,) int array
        First row of y of each vertex, ground frames included.
    is_frame : (nv,) bool array
    total : int
        Rows of y, ground included.
    """

    def __init__(self, tree: Tree, row: IndexArray, is_frame: IndexArray, total: int):
        nv = len(is_frame)
        self.tree, self.row, self.total = tree, row, total
        size = np.where(is_frame, 6, 3)
        self.twist_of = np.concatenate([[0], size.cumsum()])[:-1].astype(np.int64)
        self.n_twist = int(size.sum())
        self.unknowns = tree.count
        #: first twist number that moves each unknown row of y, and which of them are directors
        free = 4 * int(is_frame.sum()) + int((~is_frame).sum())
        self.row_twist = np.zeros(free, np.int64)
        self.row_is_director = np.zeros(free, bool)
        self.row_twist[row[:nv]] = self.twist_of
        for k in (1, 2, 3):
            directors = row[:nv][is_frame] + k
            self.row_twist[directors] = self.twist_of[is_frame] + 3
            self.row_is_director[directors] = True
        self.frames = np.flatnonzero(is_frame)
        self.points = np.flatnonzero(~is_frame)
        self.frame_rows = row[self.frames]
        self.director_rows = self.frame_rows[:, None] + np.arange(1, 4)
        self.frame_twist = self.twist_of[self.frames][:, None] + np.arange(6)
        self.point_twist = self.twist_of[self.points][:, None] + np.arange(3)
        # forces on frames and points, then moments: which make up a twist force, three by three
        self._force_rows = np.concatenate([self.frame_rows, row[self.points]])
        first = [self.frame_twist[:, 0], self.point_twist[:, 0], self.frame_twist[:, 3]]
        self._by_twist = np.concatenate(first).argsort()
        self.frame_row = np.where(is_frame, row[:nv], -1)
        #: (coordinate numbers, (parent spot, child spot)) of points that move on spheres
        self.spheres = [
            (
                [k for k in tree.own[e.child] if tree.coordinate(k).kind == "sphere"],
                (e.parent_spot, e.child_spot),
            )
            for e in tree.edges
            if e.freedom.sphere and tree.plane is None
        ]
        # as if no vertex had a parent: translations, then rotations; driven ones behind all others
        size = np.array([*map(len, tree.own), len(tree.driven)])
        #: vertex of each coordinate; numbers of those of each kind
        self.vertex = np.arange(nv + 1).repeat(size)
        place = np.arange(len(self.vertex)) - (size.cumsum() - size)[self.vertex]
        axes = np.concatenate([tree.directions, tree.axes])
        self.axis = axes[np.minimum(place, len(axes) - 1)]
        kinds = (place >= len(tree.directions)).astype(np.int8)
        joint = [*tree.coordinates.values(), *tree.driven]
        own = np.array([c.number for c in joint], np.int64)
        self.vertex[own] = [c.vertex for c in joint]
        self.axis[own] = np.array([c.axis for c in joint]).reshape(-1, 3)
        kinds[own] = [KINDS.index(c.kind) for c in joint]
        self.numbers = {kind: np.flatnonzero(kinds == k) for k, kind in enumerate(KINDS)}
        self.hinges, self.tracks = self.numbers["axis"], self.numbers["slide"]
        self.axis[self.hinges] = self.axis[self.tracks] = 0.0
        self.guided = [c for c in joint if c.kind == "axis"]
        self.sliding = [c for c in joint if c.kind == "slide"]
        #: material axes: one product gives all of them at a configuration
        self.axis_terms = [
            *[self._axis_terms(c, c.axis) for c in self.guided],
            *[self._axis_terms(c, c.axis) for c in self.sliding],
            *[self._axis_terms(c, c.right) for c in self.sliding if c.right is not None],
        ]
        self._axes = combination(self.axis_terms)

    @cached_property
    def T(self) -> TwistMap:
        """The twist map, entry by entry: full for a chain, and nothing that kernels ask for."""
        return TwistMap(self, self.tree.pairs)

    @cached_property
    def recursion(self) -> Recursion:
        """The twist map, joint by joint."""
        return Recursion(self)

    def values_at(self, y: Array, fixed: Floats | None = None) -> Array:
        """Entries of :attr:`T` at all rows y; `fixed`: the axes of a reparametrisation."""
        return self.T.values(self.T.locate(y, self.fixed_axes(y) if fixed is None else fixed))

    def scale(self, length: float) -> Floats:
        """Sizes (K,) of coordinates of a scene of this extent: 1 of rotations, else the extent."""
        out = np.ones(len(self.vertex))
        for kind in ("translation", "slide"):
            out[self.numbers[kind]] = length
        return out[: self.unknowns]

    def _axis_terms(self, c: Coordinate, axis: Floats) -> list[tuple[int, float]]:
        return [(int(self.row[c.guide]) + i + 1, float(axis[i])) for i in range(3)]

    def spot_terms(self, spot: Spot) -> list[tuple[int, float]]:
        """Rows of y and factors whose sum is the spot's position."""
        base = int(self.row[spot.vertex])
        return [(base, 1.0)] + [(base + i + 1, X) for i, X in enumerate(spot.offset) if X != 0]

    # -- evaluation ----------------------------------------------------------------------------

    def material_axes(self, y: Array) -> tuple[Array, Array, Array]:
        """Axes of hinges, left and right vectors of slides at y."""
        rows, factors = self._axes
        return self.split((factors @ y.take(rows, 0))[:, 0])

    def split(self, axes: Array) -> tuple[Array, Array, Array]:
        """Split axes into those of hinges, and left and right vectors of slides."""
        b = len(self.hinges)
        c = b + len(self.tracks)
        return axes[:b], axes[b:c], axes[c:]

    def axes(self, y: Array, fixed: Floats) -> Array:
        """Axes or slides (K + driven, 3); `fixed` holds what y does not change."""
        hinges, left, right = self.material_axes(y)
        out = fixed.astype(y.dtype)
        out[self.hinges] = hinges
        out[self.tracks] = cross(left, right)
        return out

    def directors(self, y: Array) -> Array:
        """Directors (nf, 3, 3) of the frames, rows d1, d2, d3."""
        return y.take(self.director_rows, 0)

    def twist_force(self, y: Array, force: Array) -> Array:
        """``P_int(y)^T f``: force and moment of each vertex, (n_twist,) from (nv, 3)."""
        parts = [
            force.take(self._force_rows, 0),
            director_force(self.directors(y), force.take(self.director_rows, 0)),
        ]
        return np.concatenate(parts).take(self._by_twist, 0).ravel()

    def rates(self, y: Array, twist: Array) -> Array:
        """``P_int(y) t``: rates of the rows of y that are unknowns."""
        out = np.zeros((len(self.row_twist), 3), np.result_type(y, twist))
        omega = twist[self.frame_twist[:, 3:]]
        out[self.frame_rows] = twist[self.frame_twist[:, :3]]
        out[self.director_rows] = cross(omega[:, None, :], self.directors(y))
        out[self.row[self.points]] = twist[self.point_twist]
        return out

    def fixed_axes(self, y0: Array) -> Floats:
        """Axes (K + driven, 3) that stay as they are during a step from y0."""
        fixed = self.axis.copy()
        for numbers, ends in self.spheres:
            a, b = (sum(c * y0[row] for row, c in self.spot_terms(spot)) for spot in ends)
            arm = np.real(b - a)
            fixed[numbers] = normals(arm / np.linalg.norm(arm))
        return fixed


class _Moved(NamedTuple):
    """Pairs with an axis or a point that moves with a vertex, and the twists of that vertex.

    Attributes
    ----------
    track, track_twist : int arrays
        Slides whose guides move, and the rotations of these.
    guided, guide_twist : int arrays
        Pairs whose axes move with a guide, and the rotations of these.
    pair_twist, rotated_twist : (pairs, 3) and (rotated pairs, 3) int array
        Translations of the vertices, and rotations of those that are turned.
    spot_twist, spot_pair : int arrays
        Of targets, then centres, that move: their vertices' translations, and the pairs.
    spot_sign : (k, 1) array
        1 for targets, -1 for centres.
    turning, spot, spot_row : int arrays
        Those of them that a rotation moves, their spots, and first rows of the vertices.
    """

    track: IndexArray
    track_twist: IndexArray
    guided: IndexArray
    guide_twist: IndexArray
    pair_twist: IndexArray
    rotated_twist: IndexArray
    spot_twist: IndexArray
    spot_pair: IndexArray
    spot_sign: Floats
    turning: IndexArray
    spot: IndexArray
    spot_row: IndexArray


class TwistMap:
    """Twists of all vertices by the tree's coordinates, ``t = T(y) nu``, entry by entry.

    Parameters
    ----------
    kinematics : Kinematics
    pairs : Pairs
        Which coordinate moves which vertex.
    """

    def __init__(self, kinematics: Kinematics, pairs: Pairs):
        kin = self.kin = kinematics
        self.shape = kin.n_twist, kin.unknowns
        place = np.full(len(kin.vertex), -1)  # among hinges, or slides
        for numbers in (kin.hinges, kin.tracks):
            place[numbers] = np.arange(len(numbers))
        sliding = np.isin(pairs.number, kin.tracks)
        turning = pairs.some(pairs.target >= 0)
        shifting = pairs.some((pairs.target < 0) & ~sliding)
        slides = pairs.some((pairs.target < 0) & sliding)
        self.pair_vertex = turning.vertex
        self.pair_number = turning.number
        self.slide_number = slides.number
        self._slide_of = place[slides.number]
        self.pair_rotates = np.flatnonzero(turning.rotates & (kin.frame_row[turning.vertex] >= 0))
        # targets, then centres: numbers in the order in which they come first
        both = np.concatenate([turning.target, kin.tree.centres[turning.number]])
        known = list(kin.tree.spots)
        first = np.full(len(known), len(both))
        first[both[::-1]] = np.arange(len(both))[::-1]  # what is written last stays
        order = first.argsort(kind="stable")
        self.spots = [known[k] for k in order[: (first < len(both)).sum()]]
        self.pair_target, self.pair_centre = np.split(order.argsort()[both], 2)
        # spots, then material axes: one product gives all points and axes of a configuration
        self._combine = combination([kin.spot_terms(s) for s in self.spots] + kin.axis_terms)
        on_hinge = np.isin(turning.number, kin.hinges)
        #: where axes of pairs are: among those that are fixed, then those of hinges
        self._axis_of = np.where(on_hinge, len(kin.axis) + place[turning.number], turning.number)
        self._number(shifting, slides.vertex)

    def _number(self, shifting: Pairs, slide_vertex: IndexArray) -> None:
        """Identity of free vertices, constant shifts, turning pairs, slides."""
        kin = self.kin
        tree = kin.tree
        own = np.array([k for v in tree.free for k in tree.own[v]], np.int64)
        first = kin.twist_of[kin.vertex[own]] + 3 * np.isin(own, kin.numbers["rotation"])
        which, along = kin.axis[own].nonzero()
        base = kin.twist_of[shifting.vertex][:, None] + np.arange(3)
        free_rows = np.concatenate([first[which] + along, base.ravel()])
        free_cols = np.concatenate([own[which], shifting.number.repeat(3)])
        self._constant = np.concatenate(
            [kin.axis[own][which, along], kin.axis[shifting.number].ravel()]
        )
        base = kin.twist_of[self.pair_vertex][:, None] + np.arange(3)
        number = self.pair_number[:, None].repeat(3, 1)
        self._slide_twist = kin.twist_of[slide_vertex][:, None] + np.arange(3)
        self.rows = np.concatenate(
            [
                free_rows,
                base.ravel(),
                (base[self.pair_rotates] + 3).ravel(),
                self._slide_twist.ravel(),
            ]
        )
        self.cols = np.concatenate(
            [
                free_cols,
                number.ravel(),
                number[self.pair_rotates].ravel(),
                self.slide_number.repeat(3),
            ]
        )
        #: entries that are 1 at any configuration
        self.ones = np.flatnonzero(self._constant == 1)

    @cached_property
    def structure(self) -> tuple[IndexArray, Array, Array]:
        """Order of the entries for :meth:`matrix`, their columns, and where rows begin."""
        order = np.lexsort((self.cols, self.rows))
        indptr = np.searchsorted(self.rows[order], np.arange(self.shape[0] + 1))
        return order, self.cols[order].astype(np.int32), indptr.astype(np.int32)

    @cached_property
    def _moved(self) -> _Moved:
        """Made when first asked for: the full map of a chain has the square of its pairs."""
        kin = self.kin
        number = self.pair_number
        nv = len(kin.twist_of)
        track = np.array([c.guide for c in kin.sliding], np.int64)[self._slide_of]
        on_track = np.flatnonzero(track < nv)
        guides = np.full(kin.unknowns, -1)
        for k, c in kin.tree.coordinates.items():
            guides[k] = c.guide
        guide = guides[number]
        guided = np.flatnonzero((guide >= 0) & (guide < nv))
        pair_twist = kin.twist_of[self.pair_vertex][:, None] + np.arange(3)
        # targets, then centres, as far as they move with a vertex; which of them feel its rotation
        spots = np.concatenate([self.pair_target, self.pair_centre])
        of_spot = np.array([s.vertex for s in self.spots], np.int64)
        on = np.flatnonzero(of_spot[spots] < nv)
        moving = spots[on]
        turning = np.flatnonzero(np.array([any(s.offset) for s in self.spots], bool)[moving])
        return _Moved(
            on_track,
            kin.twist_of[track[on_track]] + 3,
            guided,
            kin.twist_of[guide[guided]] + 3,
            pair_twist,
            pair_twist[self.pair_rotates] + 3,
            kin.twist_of[of_spot[moving]],
            on % max(len(number), 1),
            np.where(on < len(number), 1.0, -1.0)[:, None],
            turning,
            moving[turning],
            kin.row[of_spot[moving[turning]]],
        )

    def locate(self, y: Array, fixed: Floats) -> Located:
        """Points and axes of the tree at configuration y."""
        rows, factors = self._combine
        both = (factors @ y.take(rows, 0))[:, 0]
        x = both[: len(self.spots)]
        hinges, left, right = self.kin.split(both[len(self.spots) :])
        axis = np.concatenate([fixed, hinges]).take(self._axis_of, 0)
        arm = x.take(self.pair_target, 0) - x.take(self.pair_centre, 0)
        left = left[self._slide_of]
        right = right[self._slide_of]
        return Located(y, x, axis, arm, left, right, cross(left, right))

    def values(self, at: Located) -> Array:
        """Entries of T at ``(rows, cols)``."""
        shift = cross(at.axis, at.arm)
        turn = at.axis.take(self.pair_rotates, 0)
        return np.concatenate([self._constant, shift.ravel(), turn.ravel(), at.slide.ravel()])

    def reduce(self, values: Array, twist_force: Array) -> Array:
        """``T^T t`` (unknowns,) from T's entries."""
        return sum_at(self.cols, values * twist_force.take(self.rows), self.shape[1])

    def expand(self, values: Array, rates: Array) -> Array:
        """``T nu`` (n_twist,) from T's entries."""
        return sum_at(self.rows, values * rates.take(self.cols), self.shape[0])

    def matrix(self, values: Array) -> csr_matrix:
        """T (n_twist, unknowns) from its entries."""
        order, indices, indptr = self.structure
        return csr_matrix((values[order], indices, indptr), shape=self.shape)

    # -- derivative of T^T f by the configuration, for schemes that evaluate T at midpoints ------

    def curvature_pattern(self) -> tuple[IndexArray, IndexArray]:
        """Rows (unknowns) and columns (twists) of :meth:`curvature_values`."""
        on = self._moved
        guided = self._moved.guided
        number = self.pair_number[on.spot_pair]
        turning = on.turning
        rows = [n.repeat(3) for n in (self.pair_number[guided], number, number[turning])]
        twists = (on.guide_twist, on.spot_twist, on.spot_twist[turning] + 3)
        cols = [(twist[:, None] + np.arange(3)).ravel() for twist in twists]
        rows.append(self.slide_number[on.track].repeat(3))
        cols.append((on.track_twist[:, None] + np.arange(3)).ravel())
        return np.concatenate(rows), np.concatenate(cols)

    def curvature_values(self, at: Located, at1: Located, twist_force: Array) -> Array:
        """``d(T^T t)`` for fixed t, evaluated at y, as rows on the twists that move y1.

        The factor of y1 in y (1/2 at the midpoint) is left to the caller.
        """
        moved = self._moved
        force = twist_force.take(moved.pair_twist)
        guided = moved.guided
        on = moved.track
        moment = cross(at.arm, force)
        moment[self.pair_rotates] += twist_force.take(moved.rotated_twist)
        turned = cross(at1.axis.take(guided, 0), moment.take(guided, 0))
        signed = moved.spot_sign * cross(force, at.axis).take(moved.spot_pair, 0)
        arm = at1.x.take(moved.spot, 0) - at1.y.take(moved.spot_row, 0)
        f = twist_force[self._slide_twist[on]]
        slid = cross(at1.left[on], cross(at.right[on], f))
        slid += cross(at1.right[on], cross(f, at.left[on]))
        swung = cross(arm, signed.take(moved.turning, 0))
        return np.concatenate([turned, signed, swung, slid]).ravel()


# -- the same map joint by joint -------------------------------------------------------------------
#
# The twist of a child is ``X t_parent + S nu``, nu its joint's own coordinates. With all of them in
# one system, ``(1 - X) t = S nu``, so ``T = (1 - X)^-1 S``: of a chain T is full, X and S are not.


class Recursion:
    """The twist map of a tree, joint by joint.

    Parameters
    ----------
    kinematics : Kinematics

    Attributes
    ----------
    own : TwistMap
        S.
    child, parent : (edges,) int array
        Vertices of the edges, parents before children.
    held : (edges,) bool array
        Whether a child hangs on a vertex, not on the ground.
    roots : int array
        Vertices without a parent from which others hang.
    levels : list of int arrays
        Edges whose children are equally far from the root.
    """

    def __init__(self, kinematics: Kinematics):
        kin = self.kin = kinematics
        tree = kin.tree
        nv = len(kin.twist_of)
        edges = tree.edges
        self.own = TwistMap(kin, Pairs.of([pair for e in edges for pair in tree.own_pairs(e)]))
        self.child = np.array([e.child for e in edges], np.int64)
        self.parent = np.array([e.parent for e in edges], np.int64)
        self.held = self.parent < nv
        self.roots = np.intersect1d(np.array(tree.free, np.int64), self.parent)
        depth = np.array([tree.depth[e.child] for e in edges], np.int64)
        order = depth.argsort(kind="stable")
        self.levels = np.split(order, np.flatnonzero(np.diff(depth[order])) + 1)
        frame = np.array(tree.is_frame)
        self.turns = np.flatnonzero(self.held)[frame[self.parent[self.held]]]
        self.relative = self.turns[[tree.relative(edges[e]) for e in self.turns]]
        fulcrums = [tree.fulcrum(edges[e]) for e in self.turns]
        self.spots = combination([kin.spot_terms(spot) for spot in fulcrums])
        self._parent_rows = kin.row[self.parent[self.turns]]
        at_parent = np.array([s.vertex for s in fulcrums]) == self.parent[self.turns]
        #: which of the edges that turn have theirs on the parent, on the child, on one that turns
        self._fulcrums = np.flatnonzero(at_parent), np.flatnonzero(~at_parent)
        self._on_frames = np.flatnonzero(~at_parent & frame[self.child[self.turns]])
        self._last: tuple[Array | None, Any] = None, None

    # -- the same as those of a twist map, whose entries are those of S, then of X ---------------

    def values(self, at: Located) -> Array:
        """Entries of S, then of X without those that are one."""
        return np.concatenate([self.own.values(at), -skew(self.arms(at.y)).ravel()])

    def reduce(self, values: Array, twist_force: Array) -> Array:
        """``T^T t`` (unknowns,)."""
        return self.own.reduce(self.split(values)[0], self.carry(values, twist_force))

    def expand(self, values: Array, rates: Array) -> Array:
        """``T nu`` (n_twist,)."""
        return self._solved(values, self.own.expand(self.split(values)[0], rates), "N")

    def carry(self, values: Array, twist_force: Array) -> Array:
        """Forces at the joints (n_twist,): each of all that hangs on it."""
        return self._solved(values, twist_force, "T")

    def split(self, values: Array) -> tuple[Array, Array]:
        """Entries of S, and all of ``1 - X`` in the order of :attr:`transport`."""
        count = len(self.own.rows)
        return values[:count], np.concatenate([self._constant, -values[count:]])

    def _solved(self, values: Array, rhs: Array, trans: str) -> Array:
        """``(1 - X)^-1 rhs``, or its transpose: in the order of the tree nothing is filled in."""
        if not self.held.any():  # X is zero
            return rhs
        known, lu = self._last
        if known is not values:
            lu = unit_triangular(self._pattern.matrix(self.split(values)[1]))
            self._last = values, lu
        if np.iscomplexobj(rhs) and not np.iscomplexobj(values):
            real, imaginary = (self._solved(values, part, trans) for part in (rhs.real, rhs.imag))
            return real + 1j * imaginary
        out = np.empty(len(rhs), np.result_type(values, rhs))
        out[self._order] = lu.solve(rhs[self._order].astype(out.dtype), trans)
        return out

    @cached_property
    def transport(self) -> tuple[IndexArray, IndexArray]:
        """Rows and columns of ``1 - X``: ones, what is passed on as it is, arms of rotations."""
        kin, xyz, twist = self.kin, np.arange(3), self.kin.twist_of
        child = twist[self.child[self.held]]
        parent = twist[self.parent[self.held]]
        turned, turning = (twist[v[self.relative]] + 3 for v in (self.child, self.parent))
        ones = np.arange(kin.n_twist)
        moved = twist[self.child[self.turns]][:, None, None] + xyz[:, None]
        by = twist[self.parent[self.turns]][:, None, None] + 3 + xyz
        shape = len(self.turns), 3, 3
        parts = [
            (ones, ones),
            *(
                (a[:, None] + xyz, b[:, None] + xyz)
                for a, b in ((child, parent), (turned, turning))
            ),
            (np.broadcast_to(moved, shape), np.broadcast_to(by, shape)),
        ]
        i, j = (np.concatenate([each[k].ravel() for each in parts]) for k in (0, 1))
        return i, j

    @cached_property
    def _constant(self) -> Floats:
        """Entries of ``1 - X`` that are the same at any configuration, the first ones."""
        passed = 3 * (int(self.held.sum()) + len(self.relative))
        return np.concatenate([np.ones(self.kin.n_twist), -np.ones(passed)])

    @cached_property
    def _vertex(self) -> IndexArray:
        """Vertex of each twist."""
        twist = self.kin.twist_of
        return np.arange(len(twist)).repeat(np.diff(twist, append=self.kin.n_twist))

    @property
    def below(self) -> NDArray[np.bool_]:
        """Mask of the twists of vertices that have a parent."""
        return np.isin(self._vertex, self.child)

    @cached_property
    def _order(self) -> IndexArray:
        """Twists of all vertices, parents before children."""
        tree = self.kin.tree
        count = len(self.kin.twist_of)
        depth = np.array([tree.depth.get(v, 0) for v in range(count)])
        return depth[self._vertex].argsort(kind="stable")

    @cached_property
    def _pattern(self) -> FrozenPattern:
        """Sparsity pattern of ``1 - X``, with twists ordered from parents to children."""
        i, j = self.transport
        position = np.empty_like(self._order)
        size = self.kin.n_twist
        position[self._order] = np.arange(size)
        return FrozenPattern(position[i], position[j], (size, size))

    def arms(self, y: Array) -> Array:
        """From the origins of parents that turn to what moves as if fixed to them (turns, 3)."""
        rows, factors = self.spots
        return (factors @ y.take(rows, 0))[:, 0] - y.take(self._parent_rows, 0)

    # -- derivative of ``T^T f`` for fixed forces at the joints ----------------------------------

    def moment_pattern(self) -> tuple[IndexArray, IndexArray]:
        """Rows (twists) and columns (twists) of :meth:`moment_values`."""
        twist, (on_parent, on_child) = self.kin.twist_of, self._fulcrums
        p, c = (twist[v[self.turns]] for v in (self.parent, self.child))
        framed = self._on_frames
        blocks = [
            (p[on_parent] + 3, p[on_parent] + 3),
            (p[on_child] + 3, c[on_child]),
            (p[on_child] + 3, p[on_child]),
            (p[framed] + 3, c[framed] + 3),
        ]
        rows, cols = (np.concatenate([each[k] for each in blocks]) for k in (0, 1))
        xyz = np.arange(3)
        shape = (len(rows), 3, 3)
        i = np.broadcast_to(rows[:, None, None] + xyz[:, None], shape).ravel()
        return i, np.broadcast_to(cols[:, None, None] + xyz, shape).ravel()

    def moment_values(self, y1: Array, force: Array) -> Array:
        """Derivatives, by the twists that move y1, of the moments of joint forces on parents."""
        on_parent, on_child = self._fulcrums
        child = self.child[self.turns]
        f = skew(force[self.kin.twist_of[child][:, None] + np.arange(3)])
        arm = self.arms(y1)
        framed = self._on_frames
        rows, factors = self.spots
        spot = (factors[framed] @ y1.take(rows[framed], 0))[:, 0]
        own = spot - y1.take(self.kin.row[child[framed]], 0)
        parts = [
            f[on_parent] @ skew(arm[on_parent]),
            -f[on_child],
            f[on_child],
            f[framed] @ skew(own),
        ]
        return np.concatenate(parts).ravel()

    def blocks(self, y: Array, fixed: Floats) -> tuple[Array, Array, NDArray[np.bool_]]:
        """S (vertices, 6, 6), X (edges, 6, 6), and which columns of S there are (vertices, 6)."""
        values = self.own.values(self.own.locate(y, fixed))
        kin, own, tree = self.kin, self.own, self.kin.tree
        place = np.zeros(kin.unknowns, np.int64)
        used = np.zeros((len(tree.is_frame), 6), bool)
        for w, numbers in enumerate(tree.own):
            place[numbers], used[w, : len(numbers)] = np.arange(len(numbers)), True
        v = self._vertex[own.rows]
        S = np.zeros((len(tree.is_frame), 6, 6), values.dtype)
        np.add.at(S, (v, own.rows - kin.twist_of[v], place[own.cols]), values)
        X = np.zeros((len(self.child), 6, 6), values.dtype)
        X[:, :3, :3] = np.eye(3)
        X[self.turns, :3, 3:] = -skew(self.arms(y))
        X[self.relative, 3:, 3:] = np.eye(3)
        return S, X, used


def unit_triangular(matrix: csc_matrix) -> Any:
    """Factors of a lower triangular matrix with ones on its diagonal: nothing is filled in."""
    options = {"SymmetricMode": True}
    return splu(matrix, permc_spec="NATURAL", diag_pivot_thresh=0.0, options=options)
