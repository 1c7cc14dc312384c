"""Nodal reparametrisation of a scene, from its spanning tree.

``q_{n+1} = F_d(u, q_n)`` (61), where rotations are kept as unit quaternions during a step (their
conjugates: directors are rows, which inverse rotations turn from the right) and Newton increments
are composed with them: the derivative of q_{n+1} by an increment is
``P(q_{n+1})``, without the tangent of the exponential map. Finite relative motions are
``R_b = R_a exp(theta n_n)`` and ``x_b - x_a = R_a (r_n + s e_n)``, with axes n_n and slides e_n at
the start of the step.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csc_matrix

from ..kernels import cross, exp_quaternion, quaternion_product, rotation_matrix
from ..types import Array, Floats, IndexArray
from .kinematics import Kinematics, combination, unit_triangular
from .tree import Coordinate, Edge, Spot

#: levels of a tree above which positions are found by one solution, not level by level
DEEP = 8


@dataclass
class _Level:
    """Tree edges of one depth, as arrays of rows of y, vertices and numbers."""

    child_row: IndexArray
    parent_row: IndexArray
    edge: IndexArray
    child: IndexArray  # those whose rotation is relative to the parent's
    parent: IndexArray
    relative: IndexArray


class _Drives:
    """Increments of coordinates that ground frames prescribe during a step."""

    def __init__(self, kin: Kinematics, coordinates: Sequence[Coordinate]) -> None:
        self.where = np.array(
            [i for i, c in enumerate(coordinates) if c.drive is not None], dtype=np.int64
        )
        drives = [c.drive for c in coordinates if c.drive is not None]
        self.rows = kin.row[np.array(drives, dtype=np.int64)]
        self.free = np.array(
            [i for i, c in enumerate(coordinates) if c.drive is None], dtype=np.int64
        )
        self.numbers = np.array([coordinates[i].number for i in self.free], dtype=np.int64)

    def ends(self, y0: Array, ground1: Array, total: int) -> tuple[Floats, Floats]:
        """Rows (cos, sin, value) of the drives at both ends of a step."""
        return np.real(y0[self.rows]), ground1[self.rows - (total - len(ground1))]

    def moved(self, values: Array, increment: Array) -> Array:
        """`values` with the increments of the coordinates that are not driven."""
        if not len(self.numbers):
            return values
        if not len(self.where):
            return values + increment[self.numbers]
        out = values.astype(np.result_type(values, increment))
        out[self.free] += increment[self.numbers]
        return out


class Reparametrisation:
    """F_d of one step, composed increment by increment; see the module."""

    def __init__(self, kinematics: Kinematics) -> None:
        self.kin = kinematics
        tree = kinematics.tree
        nv = len(kinematics.twist_of)
        self._grounds = np.arange(nv, len(kinematics.row))

        def pick(kind: str, size: int) -> tuple[IndexArray, IndexArray]:
            numbers = kinematics.numbers[kind].reshape(-1, size)
            return numbers, kinematics.vertex[numbers[:, 0]]

        self._directions, self._axes = tree.directions, tree.axes
        self._flat = tree.plane is not None
        self.shift_numbers, self._shift_vertices = pick("translation", len(self._directions))
        self.turn_numbers, self._turn_vertices = pick("rotation", len(self._axes))
        self.sphere_numbers, spheres = pick("sphere", 1 if self._flat else 2)
        self._hinges = _Drives(kinematics, kinematics.guided)
        self._tracks = _Drives(kinematics, kinematics.sliding)
        self._shift_rows = kinematics.row[self._shift_vertices]
        edges = {e.child: e for e in tree.edges}
        self._sphere_edges = [edges[int(v)] for v in spheres]
        self._open_edges = [e for e in tree.edges if tree.slides.get(e.child)]
        self._prepare_rotations()
        self._prepare_positions()
        self._prepare_ground()
        self.rotating = np.concatenate(
            [self.turn_numbers.ravel(), self._hinges.numbers, self.sphere_numbers.ravel()]
        )
        self._prepare_turns()
        # increments that a step starts with, not to be written to
        self._still_shift = np.zeros((len(self.shift_numbers), 3))
        self._still_turns = _identity(len(self._theta))

    def _prepare_turns(self) -> None:
        """Rotation vectors of free frames, arms on spheres and hinges: numbers and factors."""
        # a driven hinge has a factor of zero
        hinges = np.zeros(len(self.kin.guided), dtype=np.int64)
        hinges[self._hinges.free] = self._hinges.numbers
        self._hinge_free = np.zeros((len(hinges), 1))
        self._hinge_free[self._hinges.free] = 1.0
        single = np.concatenate([self.sphere_numbers[:, 0], hinges])
        numbers = np.broadcast_to(self.turn_numbers, (len(self.turn_numbers), 3))
        self._theta = np.concatenate([numbers, np.repeat(single[:, None], 3, axis=1)])
        along = self._axes if self._flat else np.ones((1, 3))
        self._along = -np.broadcast_to(along, (len(self.turn_numbers), 3))
        #: first sphere, first hinge
        self._sphere_first = len(self.turn_numbers)
        self._hinge_first = self._sphere_first + len(self.sphere_numbers)

    def _prepare_rotations(self) -> None:
        """Relative rotation of each child: of one or two hinges, or none."""
        kin, tree = self.kin, self.kin.tree
        frame = set(kin.frames.tolist())
        self._relative = [e for e in tree.edges if e.child in frame and e.freedom.turns is not None]
        number = {c.number: i for i, c in enumerate(kin.guided)}
        self._layers = _layers([tree.turns.get(e.child, []) for e in self._relative], number)
        self._ground_rows = kin.row[self._grounds][:, None] + _DIRECTORS
        place = {e.child: i for i, e in enumerate(tree.edges)}
        turned = {e.child: i for i, e in enumerate(self._relative)}
        self._prepare_order()
        levels: dict[int, list[Edge]] = {}
        for e in tree.edges:
            levels.setdefault(tree.depth[e.child], []).append(e)
        self._levels = []
        for depth in sorted(levels):
            es = levels[depth]
            rs = [e for e in es if e.child in turned]

            def array(numbers: Sequence[int]) -> IndexArray:
                return np.array(numbers, dtype=np.int64)

            self._levels.append(
                _Level(
                    child_row=kin.row[[e.child for e in es]],
                    parent_row=kin.row[[e.parent for e in es]],
                    edge=array([place[e.child] for e in es]),
                    child=array([e.child for e in rs]),
                    parent=array([e.parent for e in rs]),
                    relative=array([turned[e.child] for e in rs]),
                )
            )
        self._turning = [level for level in self._levels if len(level.child)]

    def _prepare_order(self) -> None:
        """Where rotations and rows of y come from, those of children as yet from anywhere."""
        kin, a = self.kin, len(self.turn_numbers) + len(self.sphere_numbers)
        b = a + len(kin.guided)
        #: by vertex: of turns, swings, hinges, then the ground's, then one
        self._of_vertex = np.full(len(kin.row), b + len(self._grounds))
        self._of_vertex[self._turn_vertices] = np.arange(len(self._turn_vertices))
        self._of_vertex[self._grounds] = b + np.arange(len(self._grounds))
        self._of_frame = self._of_vertex[kin.frames]
        self._of_relative = np.full(len(self._relative), b + len(self._grounds))
        if self._layers:
            which, number = self._layers[0]
            self._of_relative[which] = a + number
        #: by row: of shifted rows, directors, ground
        self._of_row = np.zeros(kin.total, dtype=np.int64)
        rows = [self._shift_rows, kin.director_rows.ravel()]
        rows.append(np.arange(len(kin.row_twist), kin.total))
        rows_of = np.concatenate(rows)
        self._of_row[rows_of] = np.arange(len(rows_of))

    def _prepare_positions(self) -> None:
        """``phi_child - phi_parent`` of each edge from directors, arms on spheres, slides."""
        kin, tree = self.kin, self.kin.tree
        edges = tree.edges
        self._arm_rows, self._arm_factors = combination(
            [
                [
                    *kin.spot_terms(e.parent_spot)[1:],
                    *((a, -c) for a, c in kin.spot_terms(e.child_spot)[1:]),
                ]
                for e in edges
            ]
        )
        place = {e.child: i for i, e in enumerate(edges)}
        self._sphere_at = np.array([place[e.child] for e in self._sphere_edges], dtype=np.int64)
        self._open_at = np.array([place[e.child] for e in self._open_edges], dtype=np.int64)
        self._guide = np.array([e.guide for e in self._open_edges], dtype=np.int64)
        number = {c.number: i for i, c in enumerate(kin.sliding)}
        self._slides = _layers([tree.slides[e.child] for e in self._open_edges], number)
        deep = len(self._levels) > DEEP
        self._sums = _PathSums(edges, kin.row) if deep else None
        if kin.elements is not None:
            self._exits = kin.elements.exits(tree)
            self._element_edges = np.array(
                [i for i, e in enumerate(edges) if e.in_element], dtype=np.int64
            )

    def _prepare_ground(self) -> None:
        """Trees whose joints are all on the ground: turns and positions of children, directly.

        While the ground does not turn, a child's rotation is that of its hinge.
        """
        kin, tree = self.kin, self.kin.tree
        last = len(self.turn_numbers) + len(self.sphere_numbers) + len(kin.guided)
        others = self._open_edges or len(self.sphere_numbers) or len(self._layers) > 1
        self._hung = (
            not others
            and kin.elements is None
            and bool(tree.edges)
            and all(e.parent >= len(kin.twist_of) for e in tree.edges)
        )
        self._direct = False
        if not self._hung:
            return
        (level,) = self._levels
        of_vertex = self._of_vertex.copy()
        of_vertex[level.child] = self._of_relative[level.relative]
        # whatever does not turn comes after all that does
        self._of_hung = np.minimum(of_vertex[kin.frames], last)
        self._stiff = bool((self._of_hung == last).any())
        self._hung_rows = level.child_row
        terms = [
            [
                (int(kin.row[e.parent]), 1.0),
                *kin.spot_terms(e.parent_spot)[1:],
                *((a, -c) for a, c in kin.spot_terms(e.child_spot)[1:]),
            ]
            for e in tree.edges
        ]
        self._hung_from, self._hung_factors = combination([terms[k] for k in level.edge])

    # -- a step ----------------------------------------------------------------------------------

    def begin(self, y0: Array, ground1: Array) -> None:
        """Start a step from y0 (all rows); the ground's rows at its end are `ground1`."""
        kin = self.kin
        self.y0 = y0
        self._triads0 = kin.directors(y0)
        self._shifted0 = y0.take(self._shift_rows, axis=0)
        self.fixed = kin.fixed_axes(y0)
        self._arm = self._arms_of(self._sphere_edges, y0)
        self._open_arm = self._arms_of(self._open_edges, y0)
        self._hinge_axis, left, right = kin.material_axes(y0)
        swings = self.fixed.take(self.sphere_numbers[:, 0], axis=0)
        self._factors = np.concatenate([self._along, -swings, -self._hinge_free * self._hinge_axis])
        self._track_axis = cross(left, right) if len(left) else left
        self._stretches0 = np.zeros(0) if kin.elements is None else kin.elements.stretches(y0)
        self._set_ground(ground1)
        self.reset()

    def _set_ground(self, ground1: Array) -> None:
        """The ground's rows at the end of the step, and what drives move by then."""
        self._ground1 = ground1
        self._driven_hinge = self._driven_track = np.zeros(0)
        if len(self._hinges.where):
            a, b = self._hinges.ends(self.y0, ground1, self.kin.total)
            sine = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
            self._driven_hinge = np.arctan2(sine, (a[:, :2] * b[:, :2]).sum(1))
            axis = self._hinge_axis[self._hinges.where]
            self._driven_turns = exp_quaternion(-self._driven_hinge[:, None] * axis)
        if len(self._tracks.where):
            a, b = self._tracks.ends(self.y0, ground1, self.kin.total)
            self._driven_track = b[:, 2] - a[:, 2]
        if self._hung:
            self._direct = bool((self.y0[self.kin.total - len(ground1) :] == ground1).all())
        if self._levels and not self._direct:
            now = ground1.take(self._ground_rows - (self.kin.total - len(ground1)), axis=0)
            turns = self.y0.take(self._ground_rows, axis=0).transpose(0, 2, 1) @ now
            self._still = np.concatenate([turns, _ONE[None]])

    def _arms_of(self, edges: Sequence[Edge], y: Array) -> Array:
        """From the parent's spot to the child's (edges, 3)."""

        def position(spot: Spot) -> Array:
            return sum(c * y[a] for a, c in self.kin.spot_terms(spot))

        if not edges:
            return np.zeros((0, 3))
        arms = [position(edge.child_spot) - position(edge.parent_spot) for edge in edges]
        return np.array(arms).reshape(-1, 3)

    def reset(self) -> None:
        """Back to the start of the step: zero increments, driven ones at its end."""
        self._shift = self._still_shift
        # those of free rotations, of arms on spheres, of hinges
        self._turns = self._still_turns
        self._drive_hinges()
        self._track = np.zeros(len(self._track_axis))
        self._track[self._tracks.where] = self._driven_track
        self._stretches = self._stretches0

    def move_ground(self, ground1: Array) -> None:
        """Change the ground's rows at the end of the step; free increments stay as they are."""
        self._set_ground(ground1)
        self._drive_hinges()
        self._track = self._track.copy()
        self._track[self._tracks.where] = self._driven_track

    def _drive_hinges(self) -> None:
        """Turn driven hinges to their end."""
        if len(self._hinges.where):
            turns = self._turns.astype(np.result_type(self._turns, self._driven_turns))
            turns[self._hinge_first + self._hinges.where] = self._driven_turns
            self._turns = turns

    def add(self, increment: Array) -> None:
        """Compose with an increment (K,) of the tree's coordinates at the present configuration."""
        shift = increment.take(self.shift_numbers)
        self._shift = self._shift + (shift @ self._directions if self._flat else shift)
        if len(self.rotating):
            theta = increment.take(self._theta) * self._factors
            if len(self.sphere_numbers):
                for second in self.sphere_numbers.T[1:]:
                    other = increment[second][:, None] * self.fixed[second]
                    theta[self._sphere_first : self._hinge_first] -= other
            turns = exp_quaternion(theta)
            still = self._turns is self._still_turns
            self._turns = turns if still else quaternion_product(self._turns, turns)
        if len(self._track):
            self._track = self._tracks.moved(self._track, increment)
        if len(self._stretches):
            assert self.kin.elements is not None
            self._stretches = self._stretches + increment[self.kin.elements.numbers]

    def save(self) -> tuple[Array, ...]:
        """The increments of the step so far."""
        return self._shift, self._turns, self._track, self._stretches

    def restore(self, saved: tuple[Array, ...]) -> None:
        """Back to saved increments."""
        self._shift, self._turns, self._track, self._stretches = saved

    def configuration(self) -> Array:
        """``y_{n+1}`` (all rows)."""
        kin = self.kin
        rotations = rotation_matrix(self._turns)
        if self._direct:
            if self._stiff:
                rotations = np.concatenate([rotations, _ONE[None]])
            turns = rotations.take(self._of_hung, axis=0)
        elif self._levels:
            all_of_them = np.concatenate([rotations, self._still])
            R = all_of_them.take(self._of_vertex, axis=0)
            relative = self._relative_rotations(all_of_them)
            for level in self._turning:
                parents = R.take(level.parent, axis=0)
                R[level.child] = relative.take(level.relative, axis=0) @ parents
            turns = R.take(kin.frames, axis=0)
        else:
            turns = rotations.take(self._of_frame, axis=0)
        directors = (self._triads0 @ turns).reshape(-1, 3)
        parts = [self._shifted0 + self._shift, directors, self._ground1]
        y = np.concatenate(parts).take(self._of_row, axis=0)
        if self._direct:
            moved = self._hung_factors @ y.take(self._hung_from, axis=0)
            y[self._hung_rows] = moved[:, 0]
        elif self._levels:
            arms = self._arms(y, R, rotations[self._sphere_first : self._hinge_first])
            if self._sums is not None:
                self._sums.place(y, arms)
                return y
            for level in self._levels:
                y[level.child_row] = y.take(level.parent_row, axis=0) + arms.take(
                    level.edge, axis=0
                )
        return y

    def _relative_rotations(self, rotations: Array) -> Array:
        """``exp(alpha a_n) exp(beta b_n)`` of each child with a relative rotation, its inverse."""
        out = rotations.take(self._of_relative, axis=0)
        for which, number in self._layers[1:]:
            out[which] = rotations[self._hinge_first + number] @ out[which]
        return out

    def _arms(self, y: Array, R: Array, swings: Array) -> Array:
        """``phi_child - phi_parent`` of each edge."""
        out = (self._arm_factors @ y.take(self._arm_rows, axis=0))[:, 0]
        if len(swings):
            out[self._sphere_at] += (self._arm[:, None] @ swings)[:, 0]
        if len(self._open_at):
            arm = self._open_arm.astype(y.dtype)
            slide = self._track[:, None] * self._track_axis
            for which, number in self._slides:
                arm[which] += slide[number]
            out[self._open_at] += (arm[:, None] @ R[self._guide])[:, 0]
        if self.kin.elements is not None:
            out[self._element_edges] = self.kin.elements.arms(y, self._stretches)[self._exits]
        return out


def _layers(
    each: Sequence[Sequence[Coordinate]], number: Mapping[int, int]
) -> list[tuple[IndexArray, IndexArray]]:
    """First and second coordinates of several joints: which joints, and which of all numbers."""
    out = []
    for k in (0, 1):
        which = [i for i, coordinates in enumerate(each) if len(coordinates) > k]
        ids = [number[each[i][k].number] for i in which]
        if which:
            out.append((np.array(which, dtype=np.int64), np.array(ids, dtype=np.int64)))
    return out


class _PathSums:
    """Positions of a deep tree: those of the parents, and what is added from edge to edge."""

    def __init__(self, edges: Sequence[Edge], row: IndexArray) -> None:
        place = {e.child: k for k, e in enumerate(edges)}
        above = np.array([place.get(e.parent, -1) for e in edges], dtype=np.int64)
        self._roots, inner = np.flatnonzero(above < 0), np.flatnonzero(above >= 0)
        self._rows = row[[e.child for e in edges]]
        self._root_rows = row[[edges[k].parent for k in self._roots.tolist()]]
        count = len(edges)
        entries = np.concatenate([np.ones(count), np.full(len(inner), -1.0)])
        i, j = np.concatenate([[np.arange(count)] * 2, [inner, above[inner]]], axis=1)
        self._lu = unit_triangular(csc_matrix((entries, (i, j)), shape=(count, count)))

    def place(self, y: Array, arms: Array) -> None:
        """Positions of the children, in place, from what is added on each edge."""
        arms[self._roots] += y.take(self._root_rows, axis=0)
        x = self._lu.solve(np.ascontiguousarray(arms.real))
        if np.iscomplexobj(arms):
            x = x + 1j * self._lu.solve(np.ascontiguousarray(arms.imag))
        y[self._rows] = x


_DIRECTORS = np.arange(1, 4)


_ONE = np.eye(3)


def _identity(count: int) -> Floats:
    out = np.zeros((count, 4))
    out[:, 0] = 1
    return out
