"""Nodes of explicit schemes: rigid bodies that drift freely, or as their joints allow."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields

import numpy as np
from scipy.sparse import csr_matrix

from ..errors import IncompatibleError
from ..kernels import cross, director_force, exp_quaternion, null_space_blocks, rotation_matrix
from ..model import System
from ..types import Floats, IndexArray, largest

#: gap of a constraint, relative to its terms, that is not improved upon any more
CLOSED = 2e-15
#: at most, for joints to close and for velocities that forces depend on
ITERATIONS = 60


class Unclosed(Exception):
    """Joints, or velocities that forces depend on, were not found: says which, and the gap left."""


@dataclass(eq=False)
class Bodies:
    """Nodes as rigid bodies.

    Attributes
    ----------
    number : (k,) int array
        Among all vertices.
    rows : (k, 4) int array
        Of y: phi and the directors.
    matrix : (k, 4, 4) array
        Scalar mass of (phi, d1, d2, d3).
    centre : (k, 3) array
        Centre of mass in the node's triad (m).
    axes : (k, 3, 3) array
        Principal axes in the triad as rows; moments of the first two are the closest ones.
    inverse : (k, 3) array
        Reciprocal principal moments of inertia; zero for points.
    """

    number: IndexArray
    rows: IndexArray
    matrix: Floats
    centre: Floats
    axes: Floats
    inverse: Floats

    def __post_init__(self) -> None:
        first, second, third = self.inverse.T
        self._speeds = np.array([-first, 0.5 * (second - first), third - first])

    def taken(self, ids: IndexArray) -> Bodies:
        """Some of them."""
        return Bodies(*(getattr(self, each.name)[ids] for each in fields(self)))

    def drift(self, y: Floats, m: Floats, dt: float) -> None:
        """Move them as free rigid bodies for a time dt, in place.

        Exact where two principal moments are equal; else the turn about one axis that this leaves
        out is put half before and half after (of second order, symplectic and symmetric). L about
        the centre of mass stays as it is.
        """
        x = y.take(self.rows, axis=0)
        P, spin = m[self.number, 0], m[self.number, 1]
        arm = (self.centre[:, None] @ x[:, 1:])[:, 0]
        spin = spin - cross(arm, P)
        x[:, 0] += arm + (dt / self.matrix[:, 0, :1]) * P
        A = self.axes @ x[:, 1:]
        back = rotation_matrix(exp_quaternion(dt * self._speeds[0][:, None] * spin))
        turn = self._turn_of_axes(A @ spin[:, :, None], dt)
        x[:, 1:] = self.axes.transpose(0, 2, 1) @ (turn @ A) @ back
        arm = (self.centre[:, None] @ x[:, 1:])[:, 0]
        x[:, 0] -= arm
        m[self.number, 1] = spin + cross(arm, P)
        y[self.rows] = x

    def _turn_of_axes(self, spin: Floats, dt: float) -> Floats:
        """Rotations (k, 3, 3) of principal axes in a time dt: about the second, third, second."""
        turn, (_, rest, along) = np.eye(3), dt * self._speeds
        for axis, rates in ((1, rest), (2, along), (1, rest)):
            angles = np.outer(rates * spin[:, axis, 0], np.eye(3)[axis])
            each = rotation_matrix(exp_quaternion(-angles))
            spin, turn = each @ spin, each @ turn
        return turn

    def by_twists(self, y: Floats) -> tuple[Floats, Floats]:
        """Rates (k, 12, 6) of nodes by shifts and turns at y, and inertia (k, 6, 6) of these."""
        P = null_space_blocks(y[self.rows[:, 1:]])
        M = P.transpose(0, 2, 1) @ np.kron(self.matrix, np.eye(3)) @ P
        M[~self.inverse.any(1), 3:, 3:] = np.eye(3)  # points do not turn
        return P, M

    def by_coordinates(self, blocks: Floats, size: int) -> csr_matrix:
        """Blocks (k, 6, 12) as a matrix (6 k, size) by the unknowns."""
        columns = (3 * self.rows[:, :, None] + np.arange(3)).reshape(-1, 1, 12)
        rows, columns = np.broadcast_arrays(np.arange(6 * len(blocks)).reshape(-1, 6, 1), columns)
        free = columns < size  # directors that points do not have
        return csr_matrix((blocks[free], (rows[free], columns[free])), (6 * len(blocks), size))


class Joints:
    """All joints between nodes, which impulses along their gradients close together.

    Attributes
    ----------
    bodies : Bodies
        The k nodes that they hold.
    """

    def __init__(self, system: System, bodies: Bodies) -> None:
        self._constraints, first = system.constraints, system.internal
        ends = np.array([(jr.a.vertex, jr.b.vertex) for jr in system.joint_rows], dtype=np.int64)
        self.bodies = bodies.taken(np.intersect1d(ends, bodies.number))
        place = np.zeros(system.total + 1, dtype=np.int64)
        place[self.bodies.rows] = np.arange(self.bodies.rows.size).reshape(-1, 4)
        lengths = np.zeros((system.total, 3))
        lengths[:, 0] = 1.0
        lengths[system.vertex_rows, 0] = system.length
        self._rows = slice(first, system.m)
        self._size = self._constraints.magnitudes(lengths)[self._rows]
        self._shape = len(self._size), len(self.bodies.number), 12
        self._entries = np.flatnonzero(self._constraints.G_rows >= first)
        number = self._constraints.G_rows[self._entries] - first
        row, component = np.divmod(self._constraints.G_cols[self._entries], 3)
        self._where = number * 12 * self._shape[1] + 3 * place[row] + component

    def gaps(self, y: Floats) -> Floats:
        """Gaps (r,), by the size of their terms."""
        return self._constraints.values(y)[self._rows] / self._size

    def _gradients(self, y: Floats) -> tuple[Floats, Floats, Callable[[Floats], Floats]]:
        """By shifts and turns (r, 6 k), twists by such impulses, and impulses of rates of gaps."""
        P, M = self.bodies.by_twists(y)
        values = self._constraints.jacobian_values(y)[self._entries]
        by_node = np.bincount(self._where, values, int(np.prod(self._shape))).reshape(self._shape)
        by_twist = by_node.transpose(1, 0, 2) @ P
        both = by_twist, by_twist @ np.linalg.inv(M)
        G, twists = (each.transpose(1, 0, 2).reshape(len(by_node), -1) for each in both)
        S = G @ twists.T

        def impulses(rates: Floats) -> Floats:
            try:
                return np.asarray(np.linalg.solve(S, rates))
            except np.linalg.LinAlgError as error:
                raise Unclosed("joints have come to a dead point", np.inf) from error

        return G, twists, impulses

    def drift(self, y: Floats, m: Floats, dt: float) -> int:
        """Move nodes so that the joints are closed at the end, in place; gives iterations.

        With impulses along the gradients at the start.
        """
        rows, v = self.bodies.rows, self.bodies.number
        G, _, impulses = self._gradients(y)
        places, begin, last = y[rows], m[v], np.inf
        impulse = np.zeros(len(self._size))
        for k in range(1, ITERATIONS + 1):
            y[rows] = places
            m[v] = begin + (impulse @ G).reshape(begin.shape)
            self.bodies.drift(y, m, dt)
            gaps = self.gaps(y)
            gap = largest(gaps)
            if gap <= CLOSED or (gap < 1e-12 and gap > 0.5 * last):
                return k
            last = gap
            impulse -= impulses(gaps * self._size) / dt
        raise Unclosed("a joint could not be closed", last)

    def projection(self, y: Floats) -> Callable[[Floats], None]:
        """Function that takes the part of momenta that would open joints, in place."""
        v = self.bodies.number
        G, twists, impulses = self._gradients(y)

        def project(m: Floats) -> None:
            own = m[v]
            m[v] = own - (impulses(twists @ own.ravel()) @ G).reshape(own.shape)

        return project


class Nodes:
    """All nodes of a system with lumped masses.

    Attributes
    ----------
    bodies : Bodies
    joints : Joints or None
    slimness : (nv,) array
        Smallest principal moment, relative to the largest one; one for points.
    """

    def __init__(self, system: System) -> None:
        framed, count = system.is_frame, len(system.origin_rows)
        rows = np.full((count, 4), system.total)
        rows[:, 0] = system.origin_rows
        rows[framed] = system.origin_rows[framed, None] + np.arange(4)
        self._framed, mass = rows[framed], system.mass.tocsr(copy=True)
        mass.resize(system.total + 1, system.total + 1)
        i, j = np.broadcast_arrays(rows[:, :, None], rows[:, None])
        matrix = np.asarray(mass[i.ravel(), j.ravel()]).reshape(i.shape)
        whole, centre = matrix[:, 0, 0], matrix[:, 0, 1:] / matrix[:, :1, 0]
        euler = matrix[:, 1:, 1:] - whole[:, None, None] * centre[:, :, None] * centre[:, None]
        inertia = np.trace(euler, axis1=1, axis2=2)[:, None, None] * np.eye(3) - euler
        moments, axes = np.linalg.eigh(inertia)
        moments[~framed] = 1.0
        self.slimness = moments[:, 0] / moments[:, 2]
        with np.errstate(divide="ignore"):
            inverse = framed[:, None] / moments
        # the first two differ least: an even cycle keeps the triad right-handed
        late = inverse[:, 0] - inverse[:, 1] > inverse[:, 1] - inverse[:, 2]
        order = np.where(late[:, None], (1, 2, 0), (0, 1, 2))
        inverse = np.take_along_axis(inverse, order, 1)
        axes = np.take_along_axis(axes.transpose(0, 2, 1), order[:, :, None], 1)
        axes[:, 2] *= np.sign(np.linalg.det(axes))[:, None]
        every = np.arange(count)
        self.bodies = Bodies(every, rows, matrix, centre, axes, inverse)
        self.joints = Joints(system, self.bodies) if system.joint_rows else None
        held = every[:0] if self.joints is None else self.joints.bodies.number
        self._free = self.bodies.taken(np.setdiff1d(every, held))

    def drift(self, y: Floats, m: Floats, dt: float) -> int:
        """Move all of them for a time dt (s), in place; gives iterations that joints took."""
        self._free.drift(y, m, dt)
        return 0 if self.joints is None else self.joints.drift(y, m, dt)

    def projection(self, y: Floats) -> Callable[[Floats], None]:
        """Function that takes the part of momenta that would open joints, in place."""
        return (lambda m: None) if self.joints is None else self.joints.projection(y)

    def momenta(self, y: Floats, f: Floats) -> Floats:
        """P and L (nv, 2, 3) of director momenta (rows, 3): all of them that moves rigid nodes."""
        every = np.zeros_like(y)
        every[: len(f)] = f
        own, rows = every[self.bodies.rows], self.bodies.rows
        own[:, 1] = director_force(y[rows[:, 1:]], own[:, 1:])
        return own[:, :2]

    def velocities(self, y: Floats) -> Callable[[Floats], Floats]:
        """Function that gives the velocities of all rows of y for momenta."""
        P, M = self.bodies.by_twists(y)

        def rates(m: Floats) -> Floats:
            out = np.zeros_like(y)
            # times the inverse would lose a little in each step, always the same way
            twists = np.linalg.solve(M, m.reshape(-1, 6, 1))
            out[self.bodies.rows] = (P @ twists).reshape(-1, 4, 3)
            return out

        return rates

    def tidy(self, y: Floats) -> None:
        """Take rounding out of all triads, in place: ``D - (D D^T - 1) D/2``."""
        D = y[self._framed[:, 1:]]
        y[self._framed[:, 1:]] = D - 0.5 * ((D @ D.transpose(0, 2, 1) - np.eye(3)) @ D)


def checked_nodes(name: str, system: System) -> Nodes:
    """Nodes of a system, or IncompatibleError if one has no inertia about an axis."""
    nodes = Nodes(system)
    slim = np.flatnonzero(nodes.slimness < 1e-12)
    if len(slim):
        reason = "drifts need inertia about all axes"
        raise IncompatibleError(f"{name} with {system.owner[int(slim[0])].label}", reason)
    return nodes
