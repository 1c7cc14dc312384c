"""Nodes of explicit schemes: free rigid bodies, and clusters of them that joints connect."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from ..errors import IncompatibleError
from ..kernels import cross, director_force, exp_quaternion, rotation_matrix
from ..model import System
from ..model.quadratic import ConstraintBuilder, QuadraticConstraints
from ..types import Array, Floats, IndexArray

#: gap of a constraint, relative to its terms, that is not improved upon any more
CLOSED = 2e-15
#: at most, for joints to close and for velocities that forces depend on
ITERATIONS = 60


class Unclosed(Exception):
    """Joints, or velocities that forces depend on, were not found; with the gap left."""

    def __init__(self, what: str, gap: float) -> None:
        self.what, self.gap = what, gap
        super().__init__(f"{what}: gap {gap:.3g}")


@dataclass(eq=False)
class Bodies:
    """Nodes as rigid bodies.

    Attributes
    ----------
    number : (k,) int array
        Among all vertices.
    rows : (k, 4) int array
        Of y: phi and the directors.
    mass : (k,) array
    centre : (k, 3) array
        Centre of mass in the node's triad (m).
    axes : (k, 3, 3) array
        Principal axes in the triad as rows; moments of the first two are the closest ones.
    inverse : (k, 3) array
        Reciprocal principal moments of inertia; zero for points.
    """

    number: IndexArray
    rows: IndexArray
    mass: Floats
    centre: Floats
    axes: Floats
    inverse: Floats

    def __post_init__(self) -> None:
        self.eccentric = bool(self.centre.any())
        self._back = self.axes.transpose(0, 2, 1).copy()
        first, second, third = self.inverse.T
        self._speeds = np.array([-first, 0.5 * (second - first), third - first])

    def taken(self, ids: IndexArray) -> Bodies:
        """Some of them."""
        return Bodies(*(getattr(self, each.name)[ids] for each in fields(self)))

    def _offsets(self, D: Array) -> Array:
        return (self.centre[:, None] @ D)[:, 0]

    def drift(self, y: Floats, m: Floats, dt: float) -> None:
        """Move them as free rigid bodies for a time dt, in place.

        Exact where two principal moments are equal; else the turn about one axis that this leaves
        out is put half before and half after (of second order, symplectic and symmetric). L about
        the centre of mass stays as it is.
        """
        x = y.take(self.rows, axis=0)
        P, spin = m[self.number, 0], m[self.number, 1]
        if self.eccentric:
            arm = self._offsets(x[:, 1:])
            spin = spin - cross(arm, P)
            x[:, 0] += arm
        x[:, 0] += (dt / self.mass)[:, None] * P
        A = self.axes @ x[:, 1:]
        common, rest, along = dt * self._speeds
        back = rotation_matrix(exp_quaternion(common[:, None] * spin))
        own = self._own_turn(rest, along, (A @ spin[:, :, None])[:, :, 0].T)
        x[:, 1:] = self._back @ (own @ A) @ back
        if self.eccentric:
            arm = self._offsets(x[:, 1:])
            x[:, 0] -= arm
            m[self.number, 1] = spin + cross(arm, P)
        y[self.rows] = x

    @staticmethod
    def _own_turn(rest: Floats, along: Floats, spin: Floats) -> Floats:
        """What turns principal axes (k, 3, 3): about the second one, the third, the second."""
        s0, s1, s2 = spin
        first = rest * s1
        c, s = np.cos(first), np.sin(first)
        s0, s2 = c * s0 - s * s2, c * s2 + s * s0
        middle = along * s2
        last = rest * (np.cos(middle) * s1 - np.sin(middle) * s0)
        angles = 0.5 * np.array([middle, first + last, first - last])
        (c, cs, cd), (s, ss, sd) = np.cos(angles), np.sin(angles)
        quaternion = np.array([c * cs, -s * sd, -c * ss, -s * cd]).T
        return rotation_matrix(quaternion)

    def mobility(self, D: Array) -> Callable[[Array], Array]:
        """What gives velocities and angular velocities (..., k, 2, 3) of momenta alike."""
        A = self.axes @ D
        compliance = A.transpose(0, 2, 1).copy() @ (self.inverse[:, :, None] * A)
        mass = self.mass[:, None]
        arm = self._offsets(D) if self.eccentric else None

        def twists(m: Array) -> Array:
            out, P, spin = np.empty_like(m), m[..., 0, :], m[..., 1, :]
            if arm is not None:
                spin = spin - cross(arm, P)
            out[..., 0, :] = (
                P / mass
            )  # times 1/m would lose a little in each step, always the same way
            out[..., 1, :] = omega = np.einsum("kij,...kj->...ki", compliance, spin)
            if arm is not None:
                out[..., 0, :] -= cross(omega, arm)
            return out

        return twists


@dataclass(eq=False)
class Cluster:
    """Nodes that joints connect, and the constraint rows of these joints.

    `size` (r,) is how large the terms of each row are, `where` where the entries of the Jacobian
    are in an array (r, k, 4, 3).
    """

    bodies: Bodies
    joints: QuadraticConstraints
    size: Floats
    where: IndexArray

    def gaps(self, y: Floats) -> Floats:
        """Gaps (r,), by the size of their terms."""
        return self.joints.values(y) / self.size

    def gradients(self, y: Floats) -> tuple[Floats, Floats]:
        """Of the rows by shifts and turns of the nodes, and twists by such impulses (r, 6 k)."""
        shape = self.joints.size, len(self.bodies.number), 4, 3
        values = self.joints.jacobian_values(y)
        by_row = np.bincount(self.where, values, int(np.prod(shape))).reshape(shape)
        D = y[self.bodies.rows[:, 1:]]
        G = np.stack([by_row[:, :, 0], cross(D, by_row[:, :, 1:]).sum(2)], 2)
        return G.reshape(len(G), -1), self.bodies.mobility(D)(G).reshape(len(G), -1)

    def drift(self, y: Floats, m: Floats, dt: float) -> int:
        """Move them so that the joints are closed at the end, in place; gives iterations.

        With impulses along the gradients at the start.
        """
        rows, v = self.bodies.rows, self.bodies.number
        G, twists = self.gradients(y)
        S = G @ twists.T
        places, begin, last = y[rows], m[v], np.inf
        impulse = np.zeros(len(G))
        for k in range(1, ITERATIONS + 1):
            y[rows] = places
            m[v] = begin + (impulse @ G).reshape(begin.shape)
            self.bodies.drift(y, m, dt)
            gaps = self.joints.values(y)
            gap = float(abs(gaps / self.size).max())
            if gap <= CLOSED or (gap < 1e-12 and gap > 0.5 * last):
                return k
            last = gap
            impulse -= _solved(S, gaps) / dt
        raise Unclosed("a joint could not be closed", last)

    def projection(self, y: Floats) -> Callable[[Floats], None]:
        """What takes the part of momenta that would open joints, in place."""
        v = self.bodies.number
        G, twists = self.gradients(y)
        impulses = _solved(G @ twists.T, twists)

        def project(m: Floats) -> None:
            own = m[v]
            m[v] = own - ((impulses @ own.ravel()) @ G).reshape(own.shape)

        return project


def _solved(S: Floats, rates: Floats) -> Floats:
    """Impulses that change rates of joints."""
    try:
        return np.asarray(np.linalg.solve(S, rates))
    except np.linalg.LinAlgError as error:
        raise Unclosed("joints have come to a dead point", np.inf) from error


class Nodes:
    """All nodes of a system with lumped masses.

    Attributes
    ----------
    bodies : Bodies
    matrix : (nv, 4, 4) array
        Scalar mass of (phi, d1, d2, d3).
    slimness : (nv,) array
        Smallest principal moment, relative to the largest one; one for points.
    clusters : list of Cluster
        With joints.
    cluster_of : (nv,) int array
        -1: none.
    """

    def __init__(self, system: System) -> None:
        self.system = system
        count, framed = len(system.origin_rows), system.is_frame
        self.rows = np.full((count, 4), system.total)
        self.rows[:, 0] = system.origin_rows
        self.rows[framed] = system.origin_rows[framed, None] + np.arange(4)
        self.framed = self.rows[framed]
        place = np.zeros(system.total + 1, dtype=np.int64)
        place[self.rows] = np.arange(4 * count).reshape(-1, 4)
        mass = system.mass.tocoo()
        self.matrix = np.zeros((count, 4, 4))
        owner, component = np.divmod(place[mass.row], 4)
        self.matrix[owner, component, place[mass.col] % 4] = mass.data
        whole, centre = self.matrix[:, 0, 0], self.matrix[:, 0, 1:] / self.matrix[:, :1, 0]
        euler = self.matrix[:, 1:, 1:] - whole[:, None, None] * centre[:, :, None] * centre[:, None]
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
        self.bodies = Bodies(every, self.rows, whole.copy(), centre, axes, inverse)
        self._join(place)

    def _join(self, place: IndexArray) -> None:
        system, count = self.system, len(self.rows)
        self.clusters: list[Cluster] = []
        self.cluster_of = np.full(count, -1)
        ends = np.array([(jr.a.vertex, jr.b.vertex) for jr in system.joint_rows], dtype=np.int64)
        ends = np.where(ends < count, ends, ends[:, ::-1]) if len(ends) else ends.reshape(-1, 2)
        graph = coo_matrix((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), (count, count))
        label = connected_components(graph, directed=False)[1]
        lengths = np.zeros((system.total, 3))
        lengths[:, 0] = 1.0
        lengths[system.vertex_rows, 0] = system.length
        for number in np.unique(label[ends[:, 0]]):
            own = np.flatnonzero(label[ends[:, 0]] == number)
            v = np.unique(ends[own])
            self.cluster_of[v] = len(self.clusters)
            joints = _some_rows(system, [system.joint_rows[k].rows for k in own])
            row, component = np.divmod(joints.G_cols, 3)
            node, part = np.divmod(place[row], 4)
            where = ((joints.G_rows * len(v) + np.searchsorted(v, node)) * 4 + part) * 3
            sizes = joints.magnitudes(lengths)
            self.clusters.append(Cluster(self.bodies.taken(v), joints, sizes, where + component))

    def momenta(self, y: Floats, f: Floats) -> Floats:
        """P and L (nv, 2, 3) of director momenta (rows, 3): all of them that moves rigid nodes."""
        every = np.zeros_like(y)
        every[: len(f)] = f
        own = every[self.rows]
        own[:, 1] = director_force(y[self.rows[:, 1:]], own[:, 1:])
        return own[:, :2]

    def velocities(self, y: Floats) -> Callable[[Floats], Floats]:
        """What gives velocities of all rows of y of momenta."""
        D = y[self.rows[:, 1:]]
        twists = self.bodies.mobility(D)

        def rates(m: Floats) -> Floats:
            out, twist = np.zeros_like(y), twists(m)
            out[self.rows[:, 1:]] = cross(twist[:, 1:], D)
            out[self.rows[:, 0]] = twist[:, 0]
            return out

        return rates

    def tidy(self, y: Floats) -> None:
        """Take rounding out of all triads, in place: ``D - (D D^T - 1) D/2``."""
        D = y[self.framed[:, 1:]]
        y[self.framed[:, 1:]] = D - 0.5 * ((D @ D.transpose(0, 2, 1) - np.eye(3)) @ D)


def _some_rows(system: System, slices: list[slice]) -> QuadraticConstraints:
    """Some of the constraint rows, numbered anew."""
    terms, number, build = system.constraints.terms(), np.full(system.m, -1), ConstraintBuilder()
    rows = np.concatenate([np.arange(each.start, each.stop) for each in slices])
    number[rows] = np.arange(len(rows))
    p, k = number[terms.row] >= 0, number[terms.linear_row] >= 0
    products = number[terms.row], terms.left, terms.right, terms.factor
    linear = number[terms.linear_row], terms.linear, terms.linear_factor
    build.products = list(zip(*(each[p].tolist() for each in products), strict=True))
    build.linear = list(zip(*(each[k].tolist() for each in linear), strict=True))
    build.size = len(rows)
    return QuadraticConstraints(build, system.spanned, system.rows)


def checked_nodes(name: str, system: System) -> Nodes:
    """Nodes of a system, or IncompatibleError if one has no inertia about an axis."""
    nodes = Nodes(system)
    slim = np.flatnonzero(nodes.slimness < 1e-12)
    if len(slim):
        reason = "drifts need inertia about all axes"
        raise IncompatibleError(f"{name} with {system.owner[int(slim[0])].label}", reason)
    return nodes
