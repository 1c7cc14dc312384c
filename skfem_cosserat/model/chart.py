"""Nodal reparametrisation of a scene, from its spanning tree.

``q_{n+1} = F_d(u, q_n)`` (61), where rotations are kept as unit quaternions during a step and
Newton increments are composed with them: the derivative of q_{n+1} by an increment is
``P(q_{n+1})``, without the tangent of the exponential map. Finite relative motions are
``R_b = R_a exp(theta n_n)`` and ``x_b - x_a = R_a (r_n + s e_n)``, with axes n_n and slides e_n at
the start of the step.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..kernels import exp_quaternion, quaternion_product, rotation_matrix
from ..types import Array, Floats, IndexArray
from .kinematics import Kinematics
from .tree import Coordinate, Edge, Spot

__all__ = ["Chart"]


@dataclass
class _Level:
    """Tree vertices of one depth, as arrays."""

    child: IndexArray
    parent: IndexArray
    guide: IndexArray
    parent_rows: IndexArray  # (c, 4)
    parent_factor: Floats
    offset: Floats  # (c, 3) of the child
    sphere: IndexArray  # which of the children move on a sphere
    sphere_number: IndexArray
    relative: IndexArray  # which have a rotation that the parent's is passed on to
    turns: list[tuple[IndexArray, IndexArray]]  # first, second: (which children, hinges)
    open: IndexArray  # which have slides, their arms, and (which of them, tracks)
    arm_number: IndexArray
    slides: list[tuple[IndexArray, IndexArray]]
    framed: IndexArray


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

        self.shift_numbers, self._shift_vertices = pick("translation", 3)
        self.turn_numbers, self._turn_vertices = pick("rotation", 3)
        self.sphere_numbers, spheres = pick("sphere", 2)
        self._hinges = _Drives(kinematics, kinematics.guided)
        self._tracks = _Drives(kinematics, kinematics.sliding)
        free = np.array(tree.free, dtype=np.int64)
        self._free_frames = free[np.isin(free, kinematics.frames)]
        edges = {e.child: e for e in tree.edges}
        self._sphere_edges = [edges[int(v)] for v in spheres]
        self._open_edges = [e for e in tree.edges if tree.slides.get(e.child)]
        self._levels = self._make_levels()
        self.rotating = np.concatenate(
            [self.turn_numbers.ravel(), self._hinges.numbers, self.sphere_numbers.ravel()]
        )

    def _make_levels(self) -> list[_Level]:
        kin, tree = self.kin, self.kin.tree
        levels: dict[int, list[Edge]] = {}
        for e in tree.edges:
            levels.setdefault(tree.depth[e.child], []).append(e)
        hinge = {c.number: i for i, c in enumerate(kin.guided)}
        track = {c.number: i for i, c in enumerate(kin.sliding)}
        sphere_of = {e.child: i for i, e in enumerate(self._sphere_edges)}
        arm_of = {e.child: i for i, e in enumerate(self._open_edges)}
        frame = set(kin.frames.tolist())

        def where(test: list[bool]) -> IndexArray:
            return np.flatnonzero(np.array(test, dtype=bool))

        def layers(
            es: list[Edge], of: dict[int, list[Coordinate]], number: dict[int, int]
        ) -> list[tuple[IndexArray, IndexArray]]:
            out = []
            for k in (0, 1):
                which = where([len(of.get(e.child, [])) > k for e in es])
                ids = [number[of[es[i].child][k].number] for i in which]
                if len(which):
                    out.append((which, np.array(ids, dtype=np.int64)))
            return out

        out = []
        for depth in sorted(levels):
            es = levels[depth]
            terms = [kin.spot_terms(e.parent_spot) for e in es]
            rows = np.array([[t[0] for t in ts] + [ts[0][0]] * (4 - len(ts)) for ts in terms])
            factor = np.array([[t[1] for t in ts] + [0.0] * (4 - len(ts)) for ts in terms])
            passed = [e.child in frame and e.joint.freedom().turns is not None for e in es]
            sphere = where([e.child in sphere_of for e in es])
            opened = where([e.child in arm_of for e in es])
            out.append(
                _Level(
                    child=np.array([e.child for e in es]),
                    parent=np.array([e.parent for e in es]),
                    guide=np.array([e.guide for e in es]),
                    parent_rows=rows,
                    parent_factor=factor[:, :, None],
                    offset=np.array([e.child_spot.offset for e in es])[:, None, :],
                    sphere=sphere,
                    sphere_number=np.array([sphere_of[es[i].child] for i in sphere], dtype=int),
                    relative=where(passed),
                    turns=layers(es, tree.turns, hinge),
                    open=opened,
                    arm_number=np.array([arm_of[es[i].child] for i in opened], dtype=int),
                    slides=layers(es, tree.slides, track),
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
        self.fixed = kin.fixed_axes(y0)
        self._arm = np.array([self._arm_of(e, y0) for e in self._sphere_edges]).reshape(-1, 3)
        self._open_arm = np.array([self._arm_of(e, y0) for e in self._open_edges]).reshape(-1, 3)
        _, self._hinge_axis, left, right = kin.combined(y0)
        self._track_axis = np.cross(left, right)
        self._driven_hinge = self._driven_track = np.zeros(0)
        if len(self._hinges.where):
            a, b = self._hinges.ends(y0, ground1, kin.total)
            sine = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
            self._driven_hinge = np.arctan2(sine, (a[:, :2] * b[:, :2]).sum(1))
        if len(self._tracks.where):
            a, b = self._tracks.ends(y0, ground1, kin.total)
            self._driven_track = b[:, 2] - a[:, 2]
        self.reset()

    def _arm_of(self, edge: Edge, y: Array) -> Array:
        def position(spot: Spot) -> Array:
            return sum(c * y[a] for a, c in self.kin.spot_terms(spot))

        return position(edge.child_spot) - position(edge.parent_spot)

    def reset(self) -> None:
        """Back to the start of the step: zero increments, driven ones at its end."""
        self._shift: Array = np.zeros((len(self.shift_numbers), 3))
        self._turn: Array = _identity(len(self.turn_numbers))
        self._swing: Array = _identity(len(self.sphere_numbers))
        self._hinge: Array = np.zeros(len(self._hinge_axis))
        self._hinge[self._hinges.where] = self._driven_hinge
        self._track: Array = np.zeros(len(self._track_axis))
        self._track[self._tracks.where] = self._driven_track

    def add(self, increment: Array) -> None:
        """Compose with an increment (K,) of the tree's coordinates at the present configuration."""
        self._shift = self._shift + increment[self.shift_numbers]
        step = exp_quaternion(increment[self.turn_numbers])
        self._turn = quaternion_product(step, self._turn)
        self._hinge = self._hinges.moved(self._hinge, increment)
        self._track = self._tracks.moved(self._track, increment)
        if len(self._swing):
            numbers = self.sphere_numbers
            theta = (increment[numbers][:, :, None] * self.fixed[numbers]).sum(1)
            self._swing = quaternion_product(exp_quaternion(theta), self._swing)

    def save(self) -> tuple[Array, ...]:
        """The increments of the step so far."""
        return self._shift, self._turn, self._swing, self._hinge, self._track

    def restore(self, saved: tuple[Array, ...]) -> None:
        """Back to saved increments."""
        self._shift, self._turn, self._swing, self._hinge, self._track = saved

    def configuration(self) -> Array:
        """``y_{n+1}`` (all rows)."""
        kin, y0 = self.kin, self.y0
        y = y0.astype(np.result_type(y0, *self.save()))
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
            slide = self._track[:, None] * self._track_axis
            for level in self._levels:
                self._advance(level, y, R, hinge, arms, slide)
        return y

    def _advance(
        self, level: _Level, y: Array, R: Array, hinge: Array, arms: Array | None, slide: Array
    ) -> None:
        row = self.kin.row
        if len(level.relative):
            R[level.child[level.relative]] = R[level.parent[level.relative]]
        for which, number in level.turns:
            child = level.child[which]
            R[child] = R[child] @ hinge[number]
        x = (level.parent_factor * y[level.parent_rows]).sum(1)
        if arms is not None and len(level.sphere):
            x[level.sphere] += arms[level.sphere_number]
        if len(level.open):
            arm = np.zeros_like(x)
            arm[level.open] = self._open_arm[level.arm_number]
            for which, number in level.slides:
                arm[which] += slide[number]
            turned = R[level.guide[level.open]] @ arm[level.open][:, :, None]
            x[level.open] += turned[:, :, 0]
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
