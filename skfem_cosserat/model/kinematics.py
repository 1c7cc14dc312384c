"""Null space matrix and nodal reparametrisation of a scene, from its spanning tree.

``qdot = P(q) nu``, ``P = P_int(q) T(q)`` (theory: Betsch & Leyendecker, IJNME 67 (2006) 499), and
``q_{n+1} = F_d(u, q_n)`` (61), where rotations are kept as unit quaternions during a step and
Newton increments are composed with them: the derivative of q_{n+1} by an increment is
``P(q_{n+1})``, without the tangent of the exponential map.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_matrix

from ..kernels import cross, director_force, exp_quaternion, quaternion_product, rotation_matrix
from ..types import Array, Floats, IndexArray
from .quadratic import sum_at
from .tree import Edge, Spot, Tree

__all__ = ["Chart", "Kinematics"]


@dataclass(eq=False)
class Located:
    """Points and axes of the tree at a configuration.

    Attributes
    ----------
    y : (total, 3) array
    x : (spots, 3) array
    axis, arm : (pairs, 3) array
        a_k, and target - centre, of each pair (vertex, coordinate).
    """

    y: Array
    x: Array
    axis: Array
    arm: Array


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
        self.frames = np.flatnonzero(is_frame)
        self.points = np.flatnonzero(~is_frame)
        self.frame_rows = row[self.frames]
        self.director_rows = self.frame_rows[:, None] + np.arange(1, 4)
        self.frame_twist = self.twist_of[self.frames][:, None] + np.arange(6)
        self.point_twist = self.twist_of[self.points][:, None] + np.arange(3)
        self._frame_row = np.where(is_frame, row[:nv], -1)
        self._spots: dict[Spot, int] = {}
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
        K = len(cs)
        constant = np.array([c.kind != "axis" for c in cs], dtype=bool)
        self.axis = np.array([c.axis for c in cs]).reshape(K, 3) * constant[:, None]
        self.guided = [c for c in cs if c.kind == "axis"]
        turning = [p for p in tree.pairs if p.target is not None]
        shifting = [p for p in tree.pairs if p.target is None]
        self.pair_vertex = np.array([p.vertex for p in turning], dtype=np.int64)
        self.pair_number = np.array([p.number for p in turning], dtype=np.int64)
        self.pair_target = np.array([self._spot(p.target) for p in turning], dtype=np.int64)  # type: ignore[arg-type]
        self.pair_centre = np.array(
            [self._spot(cs[p.number].centre) for p in turning],  # type: ignore[arg-type]
            dtype=np.int64,
        )
        frame = self._frame_row[self.pair_vertex] >= 0 if turning else np.zeros(0, dtype=bool)
        rotates = np.array([p.rotates for p in turning], dtype=bool) & frame
        self.pair_rotates = np.flatnonzero(rotates)
        self.spots = list(self._spots)
        # spots, then material axes: one product gives all points and axes of a configuration
        self._combine = self._combination(
            [self.spot_terms(s) for s in self.spots]
            + [
                [(int(self.row[c.guide]) + i + 1, float(c.axis[i])) for i in range(3)]
                for c in self.guided
            ]
        )
        self.hinges = np.array([c.number for c in self.guided], dtype=np.int64)
        # pattern of T: identity of free vertices, constant shifts, turning pairs
        rows, cols, ones = [], [], []
        for v in tree.free:
            own = tree.own[v]
            rows += [int(self.twist_of[v]) + i for i in range(len(own))]
            cols += own
            ones += [1.0] * len(own)
        for p in shifting:
            rows += [int(self.twist_of[p.vertex]) + i for i in range(3)]
            cols += [p.number] * 3
            ones += cs[p.number].axis.tolist()
        base = self.twist_of[self.pair_vertex][:, None] + np.arange(3)
        number = np.repeat(self.pair_number[:, None], 3, axis=1)
        self.T_rows = np.concatenate(
            [np.array(rows, dtype=np.int64), base.ravel(), (base[rotates] + 3).ravel()]
        )
        self.T_cols = np.concatenate(
            [np.array(cols, dtype=np.int64), number.ravel(), number[rotates].ravel()]
        )
        self._T_constant = np.array(ones)
        self.n_fixed = len(ones)
        order = np.lexsort((self.T_cols, self.T_rows))
        self._order = order
        indptr = np.searchsorted(self.T_rows[order], np.arange(self.n_twist + 1))
        self._T_structure = (self.T_cols[order].astype(np.int32), indptr.astype(np.int32))

    def _prepare_curvature(self) -> None:
        """Which pairs have an axis or a point that moves with a vertex, and its twist."""
        nv = len(self.twist_of)
        guide = np.array([c.guide for c in self.tree.coordinates], dtype=np.int64)
        which = guide[self.pair_number]
        self._guided = np.flatnonzero((which >= 0) & (which < nv))
        self._guide_twist = self.twist_of[which[self._guided]] + 3
        self._spot_vertex = np.array([s.vertex for s in self.spots], dtype=np.int64)
        self._spot_base = self.row[self._spot_vertex]
        self._spot_turns = np.array([any(s.offset) for s in self.spots], dtype=bool)
        self._pair_twist = self.twist_of[self.pair_vertex][:, None] + np.arange(3)
        self._spot_cache = []
        for spots, sign in ((self.pair_target, 1.0), (self.pair_centre, -1.0)):
            twists = self._spot_twists(spots)
            self._spot_cache.append((sign, twists, spots[twists[0]][twists[2]]))

    def _combination(self, terms: list[list[tuple[int, float]]]) -> csr_matrix:
        i = [k for k, row in enumerate(terms) for _ in row]
        j = [a for row in terms for a, _ in row]
        c = [x for row in terms for _, x in row]
        return csr_matrix((c, (i, j)), shape=(len(terms), self.total))

    # -- evaluation ----------------------------------------------------------------------------

    def points_and_axes(self, y: Array, fixed: Floats) -> tuple[Array, Array]:
        """Spots (k, 3) and axes a_k (K, 3) at y; `fixed` holds axes that do not depend on it."""
        both = self._combine @ y
        count = len(self.spots)
        if not len(self.hinges):
            return both, fixed
        axes = fixed.astype(both.dtype)
        axes[self.hinges] = both[count:]
        return both[:count], axes

    def locate(self, y: Array, fixed: Floats) -> Located:
        """What all functions of the tree need at configuration y."""
        if not len(self.pair_number):
            return Located(y, y[:0], y[:0], y[:0])
        x, axes = self.points_and_axes(y, fixed)
        return Located(y, x, axes[self.pair_number], x[self.pair_target] - x[self.pair_centre])

    def T_values(self, at: Located) -> Array:
        """Entries of T at ``(T_rows, T_cols)``."""
        if not len(self.pair_number):
            return self._T_constant
        axis = at.axis
        shift = cross(axis, at.arm)
        return np.concatenate([self._T_constant, shift.ravel(), axis[self.pair_rotates].ravel()])

    def reduce(self, values: Array, twist_force: Array) -> Array:
        """``T^T t`` (unknowns,) from T's entries."""
        return sum_at(self.T_cols, values * twist_force[self.T_rows], self.unknowns)

    def expand(self, values: Array, rates: Array) -> Array:
        """``T nu`` (n_twist,) from T's entries."""
        return sum_at(self.T_rows, values * rates[self.T_cols], self.n_twist)

    def T_matrix(self, values: Array) -> csr_matrix:
        """T (n_twist, unknowns) from its entries."""
        indices, indptr = self._T_structure
        shape = (self.n_twist, self.unknowns)
        return csr_matrix((values[self._order], indices, indptr), shape=shape)

    def directors(self, y: Array) -> Array:
        """Directors (nf, 3, 3) of the frames, rows d1, d2, d3."""
        return y[self.director_rows]

    def twist_force(self, y: Array, force: Array) -> Array:
        """``P_int(y)^T f``: force and moment of each vertex, (n_twist,) from (nv, 3)."""
        out = np.empty(self.n_twist, dtype=np.result_type(y, force))
        out[self.frame_twist[:, :3]] = force[self.frame_rows]
        out[self.frame_twist[:, 3:]] = director_force(self.directors(y), force[self.director_rows])
        if len(self.points):
            out[self.point_twist] = force[self.row[self.points]]
        return out

    def rates(self, y: Array, twist: Array) -> Array:
        """``P_int(y) t``: rates of the rows of y that are unknowns."""
        out = np.zeros((int(self.row[: len(self.twist_of)].max(initial=-1)) + 4, 3), twist.dtype)
        omega = twist[self.frame_twist[:, 3:]]
        out[self.frame_rows] = twist[self.frame_twist[:, :3]]
        out[self.director_rows] = cross(omega[:, None, :], self.directors(y))
        if len(self.points):
            out[self.row[self.points]] = twist[self.point_twist]
        return out

    # -- derivative of T^T f by the configuration, for schemes that evaluate T at midpoints ------

    def curvature_pattern(self) -> tuple[IndexArray, IndexArray]:
        """Rows (unknowns) and columns (twists) of :meth:`curvature_values`."""
        guided = self._guided
        rows = [np.repeat(self.pair_number[guided], 3)]
        cols = [(self._guide_twist[:, None] + np.arange(3)).ravel()]
        for spots in (self.pair_target, self.pair_centre):
            on, twist, turns = self._spot_twists(spots)
            rows += [np.repeat(self.pair_number[on], 3), np.repeat(self.pair_number[on][turns], 3)]
            cols += [
                (twist[:, None] + np.arange(3)).ravel(),
                (twist[turns][:, None] + 3 + np.arange(3)).ravel(),
            ]
        return np.concatenate(rows), np.concatenate(cols)

    def curvature_values(self, at: Located, at1: Located, twist_force: Array) -> Array:
        """``d(T^T t)`` for fixed t, evaluated at y, as rows on the twists that move y1.

        The factor of y1 in y (1/2 at the midpoint) is left to the caller.
        """
        force = twist_force[self._pair_twist]
        moment = cross(at.arm, force)
        moment[self.pair_rotates] += twist_force[self._pair_twist[self.pair_rotates] + 3]
        guided = self._guided
        parts = [cross(at1.axis[guided], moment[guided])]
        g = cross(force, at.axis)
        for sign, (on, _, turns), where in self._spot_cache:
            signed = sign * g[on]
            arm = at1.x[where] - at1.y[self._spot_base[where]]
            parts += [signed, cross(arm, signed[turns])]
        return np.concatenate(parts).ravel()

    def _spot_twists(self, spots: IndexArray) -> tuple[IndexArray, IndexArray, IndexArray]:
        """Pairs whose spot is on a vertex, its twist, and which of them feel its rotation."""
        vertex = self._spot_vertex[spots]
        on = np.flatnonzero(vertex < len(self.twist_of))
        return on, self.twist_of[vertex[on]], np.flatnonzero(self._spot_turns[spots[on]])


@dataclass
class _Level:
    """Tree vertices of one depth, as arrays."""

    child: IndexArray
    parent: IndexArray
    parent_rows: IndexArray  # (c, 4)
    parent_factor: Floats
    offset: Floats  # (c, 3) of the child
    sphere: IndexArray  # which of the children move on a sphere
    sphere_number: IndexArray
    locked: IndexArray
    hinged: IndexArray
    hinge_number: IndexArray
    framed: IndexArray


class Chart:
    """Nodal reparametrisation ``q_{n+1} = F_d(u, q_n)``, composed increment by increment."""

    def __init__(self, kinematics: Kinematics) -> None:
        self.kin = kinematics
        tree = kinematics.tree
        nv = len(kinematics.twist_of)
        self._grounds = np.arange(nv, len(kinematics.row))

        def pick(kind: str, size: int) -> tuple[IndexArray, IndexArray]:
            cs = [c for c in tree.coordinates if c.kind == kind]
            numbers = np.array([c.number for c in cs], dtype=np.int64).reshape(-1, size)
            vertices = np.array([c.vertex for c in cs], dtype=np.int64).reshape(-1, size)[:, 0]
            return numbers, vertices

        self.shift_numbers, self._shift_vertices = pick("translation", 3)
        self.turn_numbers, self._turn_vertices = pick("rotation", 3)
        self.sphere_numbers, spheres = pick("sphere", 2)
        self.hinge_numbers = np.array([c.number for c in kinematics.guided], dtype=np.int64)
        free = np.array(tree.free, dtype=np.int64)
        self._free_frames = free[np.isin(free, kinematics.frames)]
        edges = {e.child: e for e in tree.edges}
        self._sphere_edges = [edges[int(v)] for v in spheres]
        self._levels = self._make_levels(edges)
        self.rotating = np.concatenate(
            [self.turn_numbers.ravel(), self.hinge_numbers, self.sphere_numbers.ravel()]
        )

    def _make_levels(self, edges: dict[int, Edge]) -> list[_Level]:
        kin = self.kin
        levels: dict[int, list[Edge]] = {}
        for e in self.kin.tree.edges:
            levels.setdefault(kin.tree.depth[e.child], []).append(e)
        hinge_of = {c.vertex: i for i, c in enumerate(kin.guided)}
        sphere_of = {e.child: i for i, e in enumerate(self._sphere_edges)}
        out = []
        for depth in sorted(levels):
            es = levels[depth]
            terms = [kin.spot_terms(e.parent_spot) for e in es]
            rows = np.array([[t[0] for t in ts] + [ts[0][0]] * (4 - len(ts)) for ts in terms])
            factor = np.array([[t[1] for t in ts] + [0.0] * (4 - len(ts)) for ts in terms])
            frame = set(kin.frames.tolist())

            def where(test: list[bool]) -> IndexArray:
                return np.flatnonzero(np.array(test, dtype=bool))

            locked = [e.child in frame and e.joint.freedom().rotation == "locked" for e in es]
            hinged = where([e.child in hinge_of for e in es])
            sphere = where([e.child in sphere_of for e in es])
            out.append(
                _Level(
                    child=np.array([e.child for e in es]),
                    parent=np.array([e.parent for e in es]),
                    parent_rows=rows,
                    parent_factor=factor[:, :, None],
                    offset=np.array([e.child_spot.offset for e in es])[:, None, :],
                    sphere=sphere,
                    sphere_number=np.array([sphere_of[es[i].child] for i in sphere], dtype=int),
                    locked=where(locked),
                    hinged=hinged,
                    hinge_number=np.array([hinge_of[es[i].child] for i in hinged], dtype=int),
                    framed=where([e.child in frame for e in es]),
                )
            )
        return out

    # -- a step ----------------------------------------------------------------------------------

    def begin(self, y0: Array, ground1: Array) -> None:
        """Start a step from y0 (all rows); the ground's rows at its end are `ground1`."""
        kin = self.kin
        self.y0 = y0
        self._ground1 = ground1
        self.fixed = kin.axis
        if self._sphere_edges:
            self.fixed = kin.axis.copy()
            self._arm = np.array([self._sphere_arm(e, y0) for e in self._sphere_edges])
            for numbers, arm in zip(self.sphere_numbers, self._arm, strict=True):
                self.fixed[numbers] = _plane(arm)
        self._hinge_axis = kin.points_and_axes(y0, self.fixed)[1][self.hinge_numbers]
        self.reset()

    def _sphere_arm(self, edge: Edge, y: Array) -> Array:
        def position(spot: Spot) -> Array:
            return sum(c * y[a] for a, c in self.kin.spot_terms(spot))

        return position(edge.child_spot) - position(edge.parent_spot)

    def reset(self) -> None:
        """Back to the start of the step: zero increments."""
        self._shift: Array = np.zeros((len(self.shift_numbers), 3))
        self._turn: Array = _identity(len(self.turn_numbers))
        self._swing: Array = _identity(len(self.sphere_numbers))
        self._hinge: Array = np.zeros(len(self.hinge_numbers))

    def add(self, increment: Array) -> None:
        """Compose with an increment (unknowns,) at the present configuration."""
        self._shift = self._shift + increment[self.shift_numbers]
        step = exp_quaternion(increment[self.turn_numbers])
        self._turn = quaternion_product(step, self._turn)
        if len(self._hinge):
            self._hinge = self._hinge + increment[self.hinge_numbers]
        if len(self._swing):
            numbers = self.sphere_numbers
            theta = (increment[numbers][:, :, None] * self.fixed[numbers]).sum(1)
            self._swing = quaternion_product(exp_quaternion(theta), self._swing)

    def save(self) -> tuple[Array, ...]:
        """The increments of the step so far."""
        return self._shift, self._turn, self._swing, self._hinge

    def restore(self, saved: tuple[Array, ...]) -> None:
        """Back to saved increments."""
        self._shift, self._turn, self._swing, self._hinge = saved

    def configuration(self) -> Array:
        """``y_{n+1}`` (all rows)."""
        kin, y0 = self.kin, self.y0
        y = y0.astype(np.result_type(y0, self._shift, self._turn, self._hinge, self._swing))
        n_ground = len(self._ground1)
        y[len(y) - n_ground :] = self._ground1
        y[kin.row[self._shift_vertices]] += self._shift
        R = np.empty((len(kin.row), 3, 3), dtype=y.dtype)
        R[self._turn_vertices] = rotation_matrix(self._turn)
        free = self._free_frames
        rows = kin.row[free][:, None] + _DIRECTORS
        y[rows] = y0[rows] @ R[free].transpose(0, 2, 1)
        if self._levels:
            rows = kin.row[self._grounds][:, None] + _DIRECTORS
            R[self._grounds] = y[rows].transpose(0, 2, 1) @ y0[rows]
            hinge = rotation_matrix(exp_quaternion(self._hinge[:, None] * self._hinge_axis))
            arms = None
            if len(self._swing):
                arms = (rotation_matrix(self._swing) @ self._arm[:, :, None])[:, :, 0]
            for level in self._levels:
                self._advance(level, y, R, hinge, arms)
        return y

    def _advance(self, level: _Level, y: Array, R: Array, hinge: Array, arms: Array | None) -> None:
        row = self.kin.row
        if len(level.hinged):
            child, parent = level.child[level.hinged], level.parent[level.hinged]
            R[child] = R[parent] @ hinge[level.hinge_number]
        if len(level.locked):
            R[level.child[level.locked]] = R[level.parent[level.locked]]
        x = (level.parent_factor * y[level.parent_rows]).sum(1)
        if arms is not None and len(level.sphere):
            x[level.sphere] += arms[level.sphere_number]
        if len(level.framed):
            framed = level.child[level.framed]
            rows = row[framed][:, None] + _DIRECTORS
            directors = self.y0[rows] @ R[framed].transpose(0, 2, 1)
            y[rows] = directors
            x[level.framed] -= (level.offset[level.framed] @ directors)[:, 0]
        y[row[level.child]] = x


_DIRECTORS = np.arange(1, 4)


def _identity(count: int) -> Floats:
    out = np.zeros((count, 4))
    out[:, 0] = 1
    return out


def _plane(arm: Array) -> Floats:
    """Two unit vectors (2, 3) normal to `arm` and to each other."""
    unit = np.real(arm) / np.linalg.norm(np.real(arm))
    first = np.cross(unit, np.eye(3)[np.argmin(abs(unit))])
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(unit, first)])
