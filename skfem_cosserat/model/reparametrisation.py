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

from ..kernels import cross, exp_quaternion, quaternion_product, rotation_matrix
from ..types import Array, Floats, IndexArray
from .kinematics import Kinematics, combination
from .tree import Coordinate, Edge, Spot


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

    def __init__(self, kin: Kinematics, coordinates: Sequence[Coordinate]):
        self.where = np.array(
            [i for i, c in enumerate(coordinates) if c.drive is not None], np.int64
        )
        drives = [c.drive for c in coordinates if c.drive is not None]
        self.rows = kin.row[np.array(drives, np.int64)]
        self.free = np.array([i for i, c in enumerate(coordinates) if c.drive is None], np.int64)
        self.numbers = np.array([coordinates[i].number for i in self.free], np.int64)

    def ends(self, y0: Array, ground1: Array, total: int) -> tuple[Floats, Floats]:
        """Rows (cos, sin, value) of the drives at both ends of a step."""
        return np.real(y0[self.rows]), ground1[self.rows - (total - len(ground1))]

    def moved(self, values: Array, increment: Array) -> Array:
        """`values` with the increments of the coordinates that are not driven."""
        out = values.astype(np.result_type(values, increment))
        out[self.free] += increment[self.numbers]
        return out


class Reparametrisation:
    """F_d of one step, composed increment by increment; see the module."""

    def __init__(self, kinematics: Kinematics):
        self.kin = kinematics
        tree = kinematics.tree
        self._grounds = np.arange(len(kinematics.twist_of), len(kinematics.row))

        def pick(kind: str, size: int) -> tuple[IndexArray, IndexArray]:
            numbers = kinematics.numbers[kind].reshape(-1, size)
            return numbers, kinematics.vertex[numbers[:, 0]]

        self._directions = tree.directions
        self._axes = tree.axes
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
        self.rotating = np.concatenate(
            [self.turn_numbers.ravel(), self._hinges.numbers, self.sphere_numbers.ravel()]
        )
        self._prepare_turns()
        # increments that a step starts with, not to be written to
        self._still_shift = np.zeros((len(self.shift_numbers), 3))
        self._still_turns = np.eye(1, 4).repeat(len(self._theta), 0)

    def _prepare_turns(self) -> None:
        """Rotation vectors of free frames, arms on spheres and hinges: numbers and factors."""
        # a driven hinge has a factor of zero
        hinges = np.zeros(len(self.kin.guided), np.int64)
        hinges[self._hinges.free] = self._hinges.numbers
        self._hinge_free = np.zeros((len(hinges), 1))
        self._hinge_free[self._hinges.free] = 1.0
        single = np.concatenate([self.sphere_numbers[:, 0], hinges])
        numbers = np.broadcast_to(self.turn_numbers, (len(self.turn_numbers), 3))
        self._theta = np.concatenate([numbers, single[:, None].repeat(3, 1)])
        along = self._axes if self._flat else np.ones((1, 3))
        self._along = -np.broadcast_to(along, (len(self.turn_numbers), 3))
        #: first sphere, first hinge
        self._sphere_first = len(self.turn_numbers)
        self._hinge_first = self._sphere_first + len(self.sphere_numbers)

    def _prepare_rotations(self) -> None:
        """Relative rotation of each child: of one or two hinges, or none."""
        kin = self.kin
        tree = self.kin.tree
        ends = [(e.child, e.parent, tree.depth[e.child]) for e in tree.edges]
        child, parent, depth = np.array(ends, np.int64).reshape(-1, 3).T
        turned = np.array([e.freedom.turns is not None for e in tree.edges], bool)
        turned &= np.isin(child, kin.frames)
        self._relative = [tree.edges[k] for k in np.flatnonzero(turned)]
        number = {c.number: i for i, c in enumerate(kin.guided)}
        self._layers = _layers([tree.turns.get(e.child, []) for e in self._relative], number)
        self._ground_rows = kin.row[self._grounds][:, None] + np.arange(1, 4)
        self._prepare_order()
        relative = turned.cumsum() - 1
        order = depth.argsort(kind="stable")
        self._levels = []
        for at in np.split(order, np.flatnonzero(np.diff(depth[order])) + 1):
            own = at[turned[at]]
            rows = kin.row[child[at]], kin.row[parent[at]]
            self._levels.append(_Level(*rows, at, child[own], parent[own], relative[own]))
        self._turning = [level for level in self._levels if len(level.child)]

    def _prepare_order(self) -> None:
        """Set the places that rotations and rows of y are taken from; of children, placeholders."""
        kin = self.kin
        a = len(self.turn_numbers) + len(self.sphere_numbers)
        b = a + len(kin.guided)
        #: by vertex: of turns, swings, hinges, then the ground's, then one
        self._of_vertex = np.full(len(kin.row), b + len(self._grounds))
        self._of_vertex[self._turn_vertices] = np.arange(len(self._turn_vertices))
        self._of_vertex[self._grounds] = b + np.arange(len(self._grounds))
        self._of_relative = np.full(len(self._relative), b + len(self._grounds))
        if self._layers:
            which, number = self._layers[0]
            self._of_relative[which] = a + number
        #: by row: of shifted rows, directors, ground
        self._of_row = np.zeros(kin.total, np.int64)
        rows = [self._shift_rows, kin.director_rows.ravel()]
        rows.append(np.arange(len(kin.row_twist), kin.total))
        rows_of = np.concatenate(rows)
        self._of_row[rows_of] = np.arange(len(rows_of))

    def _prepare_positions(self) -> None:
        """``phi_child - phi_parent`` of each edge from directors, arms on spheres, slides."""
        kin = self.kin
        tree = self.kin.tree
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
        self._sphere_at = np.array([place[e.child] for e in self._sphere_edges], np.int64)
        self._open_at = np.array([place[e.child] for e in self._open_edges], np.int64)
        self._guide = np.array([e.guide for e in self._open_edges], np.int64)
        number = {c.number: i for i, c in enumerate(kin.sliding)}
        self._slides = _layers([tree.slides[e.child] for e in self._open_edges], number)

    # -- a step ----------------------------------------------------------------------------------

    def begin(self, y0: Array, ground1: Array) -> None:
        """Start a step from y0 (all rows); the ground's rows at its end are `ground1`."""
        kin = self.kin
        self.y0 = y0
        self._triads0 = kin.directors(y0)
        self._shifted0 = y0.take(self._shift_rows, 0)
        self.fixed = kin.fixed_axes(y0)
        self._arm = self._arms_of(self._sphere_edges, y0)
        self._open_arm = self._arms_of(self._open_edges, y0)
        self._hinge_axis, left, right = kin.material_axes(y0)
        swings = self.fixed.take(self.sphere_numbers[:, 0], 0)
        self._factors = np.concatenate([self._along, -swings, -self._hinge_free * self._hinge_axis])
        self._track_axis = cross(left, right)
        self._set_ground(ground1)
        self.reset()

    def _set_ground(self, ground1: Array) -> None:
        """The ground's rows at the end of the step, and what drives move by then."""
        self._ground1 = ground1
        a, b = self._hinges.ends(self.y0, ground1, self.kin.total)
        angle = np.arctan2(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0], (a[:, :2] * b[:, :2]).sum(1))
        self._driven_turns = exp_quaternion(-angle[:, None] * self._hinge_axis[self._hinges.where])
        a, b = self._tracks.ends(self.y0, ground1, self.kin.total)
        self._driven_track = b[:, 2] - a[:, 2]
        now = ground1.take(self._ground_rows - (self.kin.total - len(ground1)), 0)
        turns = self.y0.take(self._ground_rows, 0).transpose(0, 2, 1) @ now
        self._still = np.concatenate([turns, np.eye(3)[None]])

    def _arms_of(self, edges: Sequence[Edge], y: Array) -> Array:
        """From the parent's spot to the child's (edges, 3)."""

        def position(spot: Spot) -> Array:
            return sum(c * y[a] for a, c in self.kin.spot_terms(spot))

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

    def move_ground(self, ground1: Array) -> None:
        """Change the ground's rows at the end of the step; free increments stay as they are."""
        self._set_ground(ground1)
        self._drive_hinges()
        self._track = self._track.copy()
        self._track[self._tracks.where] = self._driven_track

    def _drive_hinges(self) -> None:
        """Turn driven hinges to their end."""
        turns = self._turns.astype(np.result_type(self._turns, self._driven_turns))
        turns[self._hinge_first + self._hinges.where] = self._driven_turns
        self._turns = turns

    def add(self, increment: Array) -> None:
        """Compose with an increment (K,) of the tree's coordinates at the present configuration."""
        if not len(increment):  # all joints are driven
            return
        shift = increment.take(self.shift_numbers)
        self._shift = self._shift + (shift @ self._directions if self._flat else shift)
        theta = increment.take(self._theta) * self._factors
        for second in self.sphere_numbers.T[1:]:
            other = increment[second][:, None] * self.fixed[second]
            theta[self._sphere_first : self._hinge_first] -= other
        self._turns = quaternion_product(self._turns, exp_quaternion(theta))
        self._track = self._tracks.moved(self._track, increment)

    def save(self) -> tuple[Array, ...]:
        """The increments of the step so far."""
        return self._shift, self._turns, self._track

    def restore(self, saved: tuple[Array, ...]) -> None:
        """Back to saved increments."""
        self._shift, self._turns, self._track = saved

    def configuration(self) -> Array:
        """``y_{n+1}`` (all rows)."""
        kin = self.kin
        rotations = rotation_matrix(self._turns)
        all_of_them = np.concatenate([rotations, self._still])
        R = all_of_them.take(self._of_vertex, 0)
        # exp(alpha a_n) exp(beta b_n) of each child with a relative rotation, its inverse
        relative = all_of_them.take(self._of_relative, 0)
        for which, number in self._layers[1:]:
            relative[which] = all_of_them[self._hinge_first + number] @ relative[which]
        for level in self._turning:
            R[level.child] = relative.take(level.relative, 0) @ R.take(level.parent, 0)
        directors = (self._triads0 @ R.take(kin.frames, 0)).reshape(-1, 3)
        parts = [self._shifted0 + self._shift, directors, self._ground1]
        y = np.concatenate(parts).take(self._of_row, 0)
        arms = self._arms(y, R, rotations[self._sphere_first : self._hinge_first])
        for level in self._levels:
            y[level.child_row] = y.take(level.parent_row, 0) + arms.take(level.edge, 0)
        return y

    def _arms(self, y: Array, R: Array, swings: Array) -> Array:
        """``phi_child - phi_parent`` of each edge."""
        out = (self._arm_factors @ y.take(self._arm_rows, 0))[:, 0]
        out[self._sphere_at] += (self._arm[:, None] @ swings)[:, 0]
        arm = self._open_arm.astype(y.dtype)
        slide = self._track[:, None] * self._track_axis
        for which, number in self._slides:
            arm[which] += slide[number]
        out[self._open_at] += (arm[:, None] @ R[self._guide])[:, 0]
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
            out.append((np.array(which, np.int64), np.array(ids, np.int64)))
    return out
