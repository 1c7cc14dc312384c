"""Nodes as free rigid bodies: momenta, their exact drift, and joints by projection.

A node has a momentum P and an angular momentum L in space about its point phi. Between two kicks
both are constant but for the way of phi, unless joints hold the node: nodes that joints connect
form a *cluster*, which drifts as one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from ..kernels import cross
from ..model import System
from ..types import Array, Floats, IndexArray

__all__ = ["CLOSED", "ITERATIONS", "Cluster", "Nodes", "Unclosed"]

#: gap of a constraint, relative to its terms, that is not improved upon any more
CLOSED = 2e-15
ITERATIONS = 30


class Unclosed(Exception):
    """The joints of a cluster could not be closed at the end of a drift; with the gap left."""

    def __init__(self, gap: float) -> None:
        self.gap = gap
        super().__init__(f"gap {gap:.3g}")


def _turned(axis: Array, a: Array, b: Array, angle: Array) -> tuple[Array, Array]:
    """Two axes of a triad after a turn from `a` to `b` (the third one, `axis`, stays)."""
    c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
    return c * a + s * b, c * b - s * a


def _turned_in_space(w: Array, vectors: Array) -> Array:
    """Vectors (N, k, 3) turned by rotation vectors w (N, 3)."""
    angle = np.sqrt((w * w).sum(-1))
    half = 0.5 * angle
    sinc = np.sinc(angle / np.pi)[:, None, None]
    factor = 0.5 * (np.sinc(half / np.pi) ** 2)[:, None, None]
    first = cross(np.broadcast_to(w[:, None], vectors.shape), vectors)
    second = cross(np.broadcast_to(w[:, None], vectors.shape), first)
    return vectors + sinc * first + factor * second


@dataclass(eq=False)
class Cluster:
    """Nodes that joints connect, and the rows of these joints.

    Products ``factor y_a . y_b`` add up to ``constant`` in each row; linear terms have three rows.

    Attributes
    ----------
    vertices : (k,) int array
    rows : (m,) int array
        Constraint rows of the system.
    product, a, b : (p,) int arrays
        Row in the cluster, and the rows of y.
    factor : (p,) array
    linear, c : (l,) int arrays
        First of three rows in the cluster, row of y.
    linear_factor : (l,) array
    constant, size : (m,) arrays
        What the products add up to, and the sizes of the terms.
    """

    vertices: IndexArray
    rows: IndexArray
    product: IndexArray
    a: IndexArray
    b: IndexArray
    factor: Floats
    linear: IndexArray
    c: IndexArray
    linear_factor: Floats
    constant: Floats
    size: Floats

    def values(self, y: Array) -> Array:
        """Gaps (m,)."""
        m = len(self.rows)
        out = 1.0 * np.bincount(self.product, self.factor * (y[self.a] * y[self.b]).sum(1), m)
        out -= self.constant
        for k in range(3):
            out += np.bincount(self.linear + k, self.linear_factor * y[self.c, k], m)
        return out


def _cluster(system: System, vertices: IndexArray, rows: IndexArray, lengths: Floats) -> Cluster:
    """The terms of some constraint rows; `lengths` (total,): how large rows of y are."""
    t = system.constraints.terms()
    number = np.full(system.m, -1)
    number[rows] = np.arange(len(rows))
    p, li = number[t.row] >= 0, number[t.linear_row] >= 0
    each = abs(t.factor[p]) * lengths[t.left[p]] * lengths[t.right[p]]
    sizes = np.zeros(len(rows))
    np.add.at(sizes, number[t.row[p]], each)
    for k in range(3):
        linear = abs(t.linear_factor[li]) * lengths[t.linear[li]]
        np.add.at(sizes, number[t.linear_row[li]] + k, linear)
    return Cluster(
        vertices,
        rows,
        number[t.row[p]],
        t.left[p],
        t.right[p],
        t.factor[p],
        number[t.linear_row[li]],
        t.linear[li],
        t.linear_factor[li],
        t.constant[rows],
        sizes,
    )


class Nodes:
    """All vertices of a system with lumped masses as rigid bodies.

    Attributes
    ----------
    row : (nv,) int array
        First row of y.
    framed : (nv,) bool array
    matrix : (nv, 4, 4) array
        Scalar mass of (phi, d1, d2, d3).
    mass : (nv,) array
    centre : (nv, 3) array
        Centre of mass in the node's triad (m).
    axes : (nv, 3, 3) array
        Principal axes in the triad as rows; moments of the first two are the closest ones.
    inverse : (nv, 3) array
        Reciprocal principal moments of inertia; zero for points.
    clusters : list of Cluster
        With joints.
    cluster_of : (nv,) int array
        -1: none.
    """

    def __init__(self, system: System) -> None:
        self.row = system.origin_rows
        self.framed = system.is_frame
        count = len(self.row)
        self.matrix = np.zeros((count, 4, 4))
        dense = system.mass.tocoo()
        owner = np.repeat(np.arange(count), np.where(self.framed, 4, 1))
        component = np.arange(system.rows) - self.row[owner]
        own = owner[dense.row] == owner[dense.col]
        assert own.all()  # checked before: beams are lumped
        self.matrix[owner[dense.row], component[dense.row], component[dense.col]] = dense.data
        self.mass: Floats = self.matrix[:, 0, 0].copy()
        self.centre: Floats = self.matrix[:, 0, 1:] / self.mass[:, None]
        self.euler: Floats = self.matrix[:, 1:, 1:] - self.mass[:, None, None] * (
            self.centre[:, :, None] * self.centre[:, None, :]
        )
        inertia = np.trace(self.euler, axis1=1, axis2=2)[:, None, None] * np.eye(3) - self.euler
        moments, axes = np.linalg.eigh(inertia)
        #: smallest principal moment, relative to the largest one; one for points
        self.slimness: Floats = np.where(
            self.framed, moments[:, 0] / np.where(self.framed, moments[:, 2], 1.0), 1.0
        )
        with np.errstate(divide="ignore"):
            inverse = np.where(self.framed[:, None], 1 / moments, 0.0)
        # the first two differ least: an even cycle keeps the triad right-handed
        late = inverse[:, 0] - inverse[:, 1] > inverse[:, 1] - inverse[:, 2]
        order = np.where(late[:, None], (1, 2, 0), (0, 1, 2))
        self.inverse: Floats = np.take_along_axis(inverse, order, 1)
        principal = np.take_along_axis(axes.transpose(0, 2, 1), order[:, :, None], 1)
        principal[:, 2] *= np.sign(np.linalg.det(principal))[:, None]
        self.axes: Floats = principal
        self._cluster(system, owner, component)

    def _cluster(self, system: System, owner: IndexArray, component: IndexArray) -> None:
        count = len(self.row)
        self.cluster_of: IndexArray = np.full(count, -1)
        self.slot: tuple[IndexArray, IndexArray] = (owner, component)
        ends = [(jr.a.vertex, jr.b.vertex) for jr in system.joint_rows]
        pairs = np.array(
            [(a if a < count else b, b if b < count else a) for a, b in ends], dtype=np.int64
        ).reshape(-1, 2)
        graph = coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), (count, count))
        labels = connected_components(graph, directed=False)[1]
        self.clusters: list[Cluster] = []
        self.local: IndexArray = np.full(system.total, -1)
        lengths = np.ones(system.total)
        lengths[system.vertex_rows] = system.length
        for label in np.unique(labels[pairs[:, 0]]):
            own = [
                jr
                for jr, (a, _) in zip(system.joint_rows, pairs, strict=True)
                if labels[a] == label
            ]
            vertices = np.unique(pairs[labels[pairs[:, 0]] == label])
            self.cluster_of[vertices] = len(self.clusters)
            for k, v in enumerate(vertices):
                self.local[self.row[v] : self.row[v] + (4 if self.framed[v] else 1)] = k
            rows = np.concatenate([np.arange(jr.rows.start, jr.rows.stop) for jr in own])
            self.clusters.append(_cluster(system, vertices, rows, lengths))

    # -- states --------------------------------------------------------------------------------

    def momenta(self, y: Floats, p: Floats) -> tuple[Floats, Floats]:
        """P and L (nv, 3) of director momenta p (rows, 3): all of them that moves rigid nodes."""
        P, L = p[self.row].copy(), np.zeros((len(self.row), 3))
        f = np.flatnonzero(self.framed)
        rows = self.row[f][:, None] + np.arange(1, 4)
        L[f] = cross(y[rows], p[rows]).sum(1)
        return P, L

    def twists(self, y: Array, P: Array, L: Array, v: IndexArray) -> tuple[Array, Array]:
        """Velocities of phi and angular velocities (..., k, 3) of nodes v (k,)."""
        D = self.triads(y, v)
        c = self._offsets(D, v)
        A = self.axes[v] @ D
        own = ((L - cross(np.broadcast_to(c, P.shape), P))[..., None, :] * A).sum(-1)
        omega = ((own * self.inverse[v])[..., :, None] * A).sum(-2)
        return P / self.mass[v][:, None] - cross(omega, np.broadcast_to(c, P.shape)), omega

    def director_momenta(self, y: Floats, P: Floats, L: Floats) -> Floats:
        """The momenta ``M qdot`` (rows, 3) of the rigid motion of all nodes."""
        every = np.arange(len(self.row))
        velocity, omega = self.twists(y, P, L, every)
        rates = np.concatenate(
            [velocity[:, None], cross(np.repeat(omega[:, None], 3, 1), self.triads(y, every))], 1
        )
        p = np.einsum("vij,vjk->vik", self.matrix, rates)
        out = np.empty((len(self.slot[0]), 3))
        out[:] = p[self.slot]
        return out

    def triads(self, y: Array, v: IndexArray) -> Array:
        """(k, 3, 3); zero for points."""
        rows = np.minimum(self.row[v][:, None] + np.arange(1, 4), len(y) - 1)
        return np.where(self.framed[v][:, None, None], y[rows], 0.0)

    def _offsets(self, D: Array, v: IndexArray) -> Array:
        return (self.centre[v][:, :, None] * D).sum(1)

    # -- motion --------------------------------------------------------------------------------

    def drift(self, y: Floats, P: Floats, L: Floats, v: IndexArray, dt: Floats) -> None:
        """Move nodes v (k,) as free rigid bodies for times dt (k,), in place.

        Exact where two principal moments are equal; else the turn about one axis that this leaves
        out is put half before and half after (of second order, symplectic and symmetric). L about
        the centre of mass stays as it is, to rounding.
        """
        D = self.triads(y, v)
        c = self._offsets(D, v)
        centre = y[self.row[v]] + c
        spin = L[v] - cross(c, P[v])
        inverse = self.inverse[v]
        A = self.axes[v] @ D
        rest = 0.5 * dt * (inverse[:, 1] - inverse[:, 0])
        A = self._about_second(A, spin, rest)
        angle = dt * (inverse[:, 2] - inverse[:, 0]) * (A[:, 2] * spin).sum(1)
        A0, A1 = _turned(A[:, 2], A[:, 0], A[:, 1], angle)
        A = _turned_in_space((dt * inverse[:, 0])[:, None] * spin, np.stack([A0, A1, A[:, 2]], 1))
        A = self._about_second(A, spin, rest)
        D = self.axes[v].transpose(0, 2, 1) @ A
        c = self._offsets(D, v)
        y[self.row[v]] = centre + (dt / self.mass[v])[:, None] * P[v] - c
        f = self.framed[v]
        y[self.row[v[f]][:, None] + np.arange(1, 4)] = D[f]
        L[v] = spin + cross(c, P[v])

    def _about_second(self, A: Array, spin: Array, rest: Array) -> Array:
        angle = rest * (A[:, 1] * spin).sum(1)
        A2, A0 = _turned(A[:, 1], A[:, 2], A[:, 0], angle)
        return np.stack([A0, A[:, 1], A2], 1)

    def tidy(self, y: Floats) -> None:
        """Take rounding out of all triads, in place: ``D - (D D^T - 1) D/2``."""
        f = self.row[self.framed][:, None] + np.arange(1, 4)
        D = y[f]
        y[f] = D - 0.5 * ((D @ D.transpose(0, 2, 1) - np.eye(3)) @ D)

    # -- joints --------------------------------------------------------------------------------

    def gradients(self, y: Floats, cluster: Cluster) -> tuple[Floats, Floats]:
        """Of the gaps by positions and by turns of the nodes: (m, k, 3) each."""
        grad = np.zeros((len(cluster.rows), len(cluster.vertices), 4, 3))
        component = self.slot[1]
        free = len(component)
        for row, at, value in (
            (cluster.product, cluster.a, cluster.factor[:, None] * y[cluster.b]),
            (cluster.product, cluster.b, cluster.factor[:, None] * y[cluster.a]),
        ):
            i = np.flatnonzero(at < free)
            np.add.at(grad, (row[i], self.local[at[i]], component[at[i]]), value[i])
        i = np.flatnonzero(cluster.c < free)
        for k in range(3):
            where = cluster.linear[i] + k, self.local[cluster.c[i]], component[cluster.c[i]]
            np.add.at(grad[..., k], where, cluster.linear_factor[i])
        D = self.triads(y, cluster.vertices)
        turns = cross(np.broadcast_to(D, (len(grad), *D.shape)), grad[:, :, 1:]).sum(2)
        return grad[:, :, 0], turns

    def compliance(self, y: Floats, cluster: Cluster, G: Floats, T: Floats) -> Floats:
        """Rates of the gaps by impulses on them (m, m)."""
        velocity, omega = self.twists(y, G, T, cluster.vertices)
        m = len(G)
        out = G.reshape(m, -1) @ velocity.reshape(m, -1).T
        return np.asarray(out + T.reshape(m, -1) @ omega.reshape(m, -1).T)

    def drift_joined(self, y: Floats, P: Floats, L: Floats, cluster: Cluster, dt: float) -> int:
        """Move a cluster for a time dt so that its joints are closed at the end, in place.

        Impulses along the gradients at the start; gives the iterations.
        """
        v = cluster.vertices
        rows = np.concatenate(
            [np.arange(self.row[k], self.row[k] + (4 if self.framed[k] else 1)) for k in v]
        )
        G, T = self.gradients(y, cluster)
        S = self.compliance(y, cluster, G, T)
        begin = y[rows].copy(), P[v].copy(), L[v].copy()
        impulse = np.zeros(len(cluster.rows))
        times, last = np.full(len(v), dt), np.inf
        for k in range(1, ITERATIONS + 1):
            y[rows] = begin[0]
            P[v] = begin[1] + np.tensordot(impulse, G, 1)
            L[v] = begin[2] + np.tensordot(impulse, T, 1)
            self.drift(y, P, L, v, times)
            gaps = cluster.values(y)
            gap = float(abs(gaps / cluster.size).max())
            if gap <= CLOSED or (gap < 1e-12 and gap > 0.5 * last):
                return k
            last = gap
            impulse -= np.linalg.solve(S, gaps) / dt
        raise Unclosed(last)

    def project(self, y: Floats, P: Floats, L: Floats) -> None:
        """Take the part of all momenta that would open joints, in place."""
        for cluster in self.clusters:
            v = cluster.vertices
            G, T = self.gradients(y, cluster)
            velocity, omega = self.twists(y, P[v], L[v], v)
            rates = np.tensordot(G, velocity, 2) + np.tensordot(T, omega, 2)
            impulse = np.linalg.solve(self.compliance(y, cluster, G, T), rates)
            P[v] -= np.tensordot(impulse, G, 1)
            L[v] -= np.tensordot(impulse, T, 1)
