"""Nodal reparametrisation of a scene, from its spanning tree.

``q_{n+1} = F_d(u, q_n)`` (61), where rotations are kept as unit quaternions during a step and
Newton increments are composed with them: the derivative of q_{n+1} by an increment is
``P(q_{n+1})``, without the tangent of the exponential map. Finite relative motions are
``R_b = R_a exp(theta n_n)`` and ``x_b - x_a = R_a (r_n + s e_n)``, with axes n_n and slides e_n at
the start of the step.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_matrix

from ..kernels import cross, exp_quaternion, quaternion_product, rotation_matrix
from ..types import Array, Floats, IndexArray
from .kinematics import Kinematics, combination
from .tree import Coordinate, Edge, Spot

__all__ = ["Chart"]


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


class Chart:
    """F_d of one step, composed increment by increment; see the module."""

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
        self.rotating = np.concatenate(
            [self.turn_numbers.ravel(), self._hinges.numbers, self.sphere_numbers.ravel()]
        )

    def _prepare_rotations(self) -> None:
        """Relative rotation of each child: of one or two hinges, or none."""
        kin, tree = self.kin, self.kin.tree
        frame = set(kin.frames.tolist())
        self._relative = [
            e for e in tree.edges if e.child in frame and e.joint.freedom().turns is not None
        ]
        number = {c.number: i for i, c in enumerate(kin.guided)}
        self._layers = _layers([tree.turns.get(e.child, []) for e in self._relative], number)
        self._ground_rows = kin.row[self._grounds][:, None] + _DIRECTORS
        place = {e.child: i for i, e in enumerate(tree.edges)}
        turned = {e.child: i for i, e in enumerate(self._relative)}
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
        if kin.spans is not None:
            self._exits = kin.spans.exits(tree)
            self._span_at = np.array([i for i, e in enumerate(edges) if e.spans], dtype=np.int64)
            self._sums = _path_sums(edges, kin.row)

    # -- a step ----------------------------------------------------------------------------------

    def begin(self, y0: Array, ground1: Array) -> None:
        """Start a step from y0 (all rows); the ground's rows at its end are `ground1`."""
        kin = self.kin
        self.y0 = y0
        self._triads0 = kin.directors(y0)
        self._shifted0 = y0.take(self._shift_rows, axis=0)
        self.fixed = kin.fixed_axes(y0)
        self._arm = np.array([self._arm_of(e, y0) for e in self._sphere_edges]).reshape(-1, 3)
        self._open_arm = np.array([self._arm_of(e, y0) for e in self._open_edges]).reshape(-1, 3)
        _, self._hinge_axis, left, right = kin.combined(y0)
        self._track_axis = cross(left, right)
        self._stretches0 = np.zeros(0) if kin.spans is None else kin.spans.stretches(y0)
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
        if len(self._tracks.where):
            a, b = self._tracks.ends(self.y0, ground1, self.kin.total)
            self._driven_track = b[:, 2] - a[:, 2]
        if self._levels:
            now = ground1[self._ground_rows - (self.kin.total - len(ground1))]
            self._ground_turns = now.transpose(0, 2, 1) @ self.y0[self._ground_rows]

    def _arm_of(self, edge: Edge, y: Array) -> Array:
        def position(spot: Spot) -> Array:
            return sum(c * y[a] for a, c in self.kin.spot_terms(spot))

        return position(edge.child_spot) - position(edge.parent_spot)

    def reset(self) -> None:
        """Back to the start of the step: zero increments, driven ones at its end."""
        self._shift: Array = np.zeros((len(self.shift_numbers), 3))
        # those of free rotations, then those of arms on spheres
        self._turns: Array = _identity(len(self.turn_numbers) + len(self.sphere_numbers))
        self._hinge: Array = np.zeros(len(self._hinge_axis))
        self._hinge[self._hinges.where] = self._driven_hinge
        self._track: Array = np.zeros(len(self._track_axis))
        self._track[self._tracks.where] = self._driven_track
        self._stretches: Array = self._stretches0

    def move_ground(self, ground1: Array) -> None:
        """Change the ground's rows at the end of the step; free increments stay as they are."""
        self._set_ground(ground1)
        self._hinge = self._hinge.copy()
        self._hinge[self._hinges.where] = self._driven_hinge
        self._track = self._track.copy()
        self._track[self._tracks.where] = self._driven_track

    def add(self, increment: Array) -> None:
        """Compose with an increment (K,) of the tree's coordinates at the present configuration."""
        shift = increment.take(self.shift_numbers)
        self._shift = self._shift + (shift @ self._directions if self._flat else shift)
        if len(self._turns):
            theta = increment.take(self.turn_numbers)
            if self._flat:
                theta = theta @ self._axes
            if len(self.sphere_numbers):
                numbers = self.sphere_numbers
                swings = (increment[numbers][:, :, None] * self.fixed[numbers]).sum(1)
                theta = np.concatenate([theta, swings])
            self._turns = quaternion_product(exp_quaternion(theta), self._turns)
        self._hinge = self._hinges.moved(self._hinge, increment)
        self._track = self._tracks.moved(self._track, increment)
        if len(self._stretches):
            assert self.kin.spans is not None
            self._stretches = self._stretches + increment[self.kin.spans.numbers]

    def driven(self, coordinates: Sequence[Coordinate]) -> Floats:
        """Values of `coordinates` at the end of the step as far as drives prescribe them."""
        values = dict(zip(map(id, self.kin.guided), np.real(self._hinge), strict=True))
        values |= dict(zip(map(id, self.kin.sliding), np.real(self._track), strict=True))
        return np.array([values[id(c)] if c.drive is not None else 0.0 for c in coordinates])

    def save(self) -> tuple[Array, ...]:
        """The increments of the step so far."""
        return self._shift, self._turns, self._hinge, self._track, self._stretches

    def restore(self, saved: tuple[Array, ...]) -> None:
        """Back to saved increments."""
        self._shift, self._turns, self._hinge, self._track, self._stretches = saved

    def configuration(self) -> Array:
        """``y_{n+1}`` (all rows)."""
        kin = self.kin
        # every increment is added to the shifts, be there none
        y = self.y0.astype(np.result_type(self.y0, self._shift))
        y[len(y) - len(self._ground1) :] = self._ground1
        y[self._shift_rows] = self._shifted0 + self._shift
        if not len(kin.frames) and not self._levels:
            return y
        turns, swings, hinges = self._rotations()
        R = np.empty((len(kin.row), 3, 3), dtype=y.dtype)
        R[self._turn_vertices] = turns
        if self._levels:
            R[self._grounds] = self._ground_turns
            relative = self._relative_rotations(hinges)
            for level in self._levels:
                if len(level.child):
                    parents = R.take(level.parent, axis=0)
                    R[level.child] = parents @ relative.take(level.relative, axis=0)
        y[kin.director_rows] = self._triads0 @ R.take(kin.frames, axis=0).transpose(0, 2, 1)
        if self._levels:
            arms = self._arms(y, R, swings)
            if kin.spans is not None:  # trees along beams are deep
                rows, roots, sums = self._sums
                y[rows] = y[roots] + sums @ arms
                return y
            for level in self._levels:
                y[level.child_row] = y[level.parent_row] + arms[level.edge]
        return y

    def _rotations(self) -> tuple[Array, Array, Array]:
        """Of free frames, arms on spheres and hinges, in the step so far; one call for all."""
        quaternions = self._turns
        if len(self._hinge):
            hinges = exp_quaternion(self._hinge[:, None] * self._hinge_axis)
            quaternions = np.concatenate([quaternions, hinges])
        R = rotation_matrix(quaternions)
        a, b = len(self.turn_numbers), len(self._turns)
        return R[:a], R[a:b], R[b:]

    def _relative_rotations(self, hinges: Array) -> Array:
        """``exp(alpha a_n) exp(beta b_n)`` of each child with a relative rotation."""
        out = np.empty((len(self._relative), 3, 3), dtype=hinges.dtype)
        out[:] = _ONE
        for k, (which, number) in enumerate(self._layers):
            out[which] = out[which] @ hinges[number] if k else hinges[number]
        return out

    def _arms(self, y: Array, R: Array, swings: Array) -> Array:
        """``phi_child - phi_parent`` of each edge."""
        out = (self._arm_factors * y.take(self._arm_rows, axis=0)).sum(1)
        if len(swings):
            out[self._sphere_at] += (swings @ self._arm[:, :, None])[:, :, 0]
        if len(self._open_at):
            arm = self._open_arm.astype(y.dtype)
            slide = self._track[:, None] * self._track_axis
            for which, number in self._slides:
                arm[which] += slide[number]
            out[self._open_at] += (R[self._guide] @ arm[:, :, None])[:, :, 0]
        if self.kin.spans is not None:
            out[self._span_at] = self.kin.spans.arms(y, self._stretches)[self._exits]
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


def _path_sums(edges: Sequence[Edge], row: IndexArray) -> tuple[IndexArray, IndexArray, csr_matrix]:
    """Rows of y of the children, of the roots above them, and which edges lead there."""
    path: dict[int, tuple[int, list[int]]] = {}
    for k, e in enumerate(edges):
        root, before = path.get(e.parent, (e.parent, []))
        path[e.child] = root, [*before, k]
    roots = np.array([path[e.child][0] for e in edges], dtype=np.int64)
    numbers = [path[e.child][1] for e in edges]
    starts = np.cumsum([0, *map(len, numbers)])
    flat = np.concatenate([np.array(each, dtype=np.int64) for each in numbers])
    sums = csr_matrix((np.ones(len(flat)), flat, starts), shape=(len(edges), len(edges)))
    return row[[e.child for e in edges]], row[roots], sums


_DIRECTORS = np.arange(1, 4)


_ONE = np.eye(3)


def _identity(count: int) -> Floats:
    out = np.zeros((count, 4))
    out[:, 0] = 1
    return out
