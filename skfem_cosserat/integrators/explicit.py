"""Explicit variational schemes: elements kick their nodes, which drift as free rigid bodies.

A node has a momentum P and an angular momentum L in space about its point phi, kept together as
``m`` (nodes, 2, 3). Between two kicks both are constant but for the way of phi, unless joints hold
the node: nodes that joints connect form a *cluster*, which drifts as one. A step of the run has
equal *rounds*, at whose ends all elements, loads and force elements kick by halves; within a round
every element kicks at equal distances, as often as its *count* says. ``Explicit`` gives all
elements the count one, ``Asynchronous`` to each one what its own limit needs.

Rows of y are those of the system and a last one of zeros, which stands for the directors that mass
points do not have.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_matrix, csr_matrix, identity, kron
from scipy.sparse.csgraph import connected_components

from ..constraints import Multipliers, Treatment
from ..errors import AccuracyWarning, Diverged, IncompatibleError, InputError
from ..frames import is_beam
from ..kernels import (
    BeamElements,
    beam_dissipation,
    beam_force,
    beam_moduli,
    beam_strain,
    beam_strain_rate,
    beam_stress,
    beam_viscous_stress,
    bilinear,
    cross,
    director_force,
    exp_quaternion,
    null_space_blocks,
    rotation_matrix,
)
from ..model import Model, System, system_of
from ..model.force_elements import CoupledForce
from ..model.groups import BeamGroup
from ..model.quadratic import ConstraintBuilder, QuadraticConstraints
from ..types import Array, Floats, IndexArray, numbers, positive, real, switch
from ..warn import logger, warn
from .base import Integrator, March, Marched, State, StepWork

__all__ = ["Asynchronous", "Explicit", "ExplicitScheme", "LimitWatch", "Marching", "StepLimit"]

#: steps above a limit that has fallen by as much are not made shorter: the bound is not that sharp
NEAR = 0.01
#: way of a node in a step, by the extent of the scene, above which a run has blown up
FAR = 100.0
#: gap of a constraint, relative to its terms, that is not improved upon any more
CLOSED = 2e-15
#: change of the momenta, relative to the largest, by velocities that are those after the kick; what
#: does not become less any more is accepted up to the second number
SETTLED = 1e-12, 1e-9
ITERATIONS = 60
#: instants of a round that are planned once; more of them take memory
KEPT = 4096
#: growth of the rotation between neighbouring nodes (rad), change of the places that force elements
#: act on (of directors, and by the extent of the scene), after which limits are looked at again:
#: they fall by some 2 % meanwhile
GROWN = 0.02
#: who minds what has no limit
LIMIT = "step limit of explicit schemes"
#: what vibrates, by components of strains
KINDS = ("shear", "shear", "axial", "bending", "bending", "torsion")


class Unclosed(Exception):
    """Joints, or velocities that forces depend on, were not found; with the gap left."""

    def __init__(self, what: str, gap: float) -> None:
        self.what, self.gap = what, gap
        super().__init__(f"{what}: gap {gap:.3g}")


# -- nodes -----------------------------------------------------------------------------------------


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

    def drift(self, y: Floats, m: Floats, dt: Floats) -> None:
        """Move them as free rigid bodies for times dt (k,), in place.

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
        return np.asarray(rotation_matrix(quaternion))

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
        return np.asarray(self.joints.values(y) / self.size)

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
        S, times = G @ twists.T, np.full(len(v), dt)
        places, begin, last = y[rows], m[v], np.inf
        impulse = np.zeros(len(G))
        for k in range(1, ITERATIONS + 1):
            y[rows] = places
            m[v] = begin + (impulse @ G).reshape(begin.shape)
            self.bodies.drift(y, m, times)
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


# -- limits ----------------------------------------------------------------------------------------


class StepLimit(NamedTuple):
    """Step up to which an explicit scheme is stable, and what sets it.

    Attributes
    ----------
    seconds : float
        Infinite without beams, springs and dampers.
    where : str
        Beam and element, or what a spring or damper acts on.
    kind : str
        What vibrates there: "axial", "shear", "bending" or "torsion", "with rotary inertia" if
        most of the kinetic energy is that of turning nodes; "springs", or "damping".

    Examples
    --------
    >>> from skfem_cosserat import Beam, Material, MeshCurve, Model, SectionCircle
    >>> mesh = MeshCurve.init_line((0, 0, 0), (1, 0, 0), 10)
    >>> section = SectionCircle(0.2, Material(210e9, 0.3, 7850.0))
    >>> model = Model()
    >>> bar = model.add("bar", Beam(mesh, section, director=(0, 1, 0), lumped=True))
    >>> seconds = Explicit.limit(model.freeze()).seconds  # length by speed of axial waves
    >>> bool(abs(seconds / (0.1 / (210e9 / 7850) ** 0.5) - 1) < 1e-12)
    True
    """

    seconds: float
    where: str = "no beam"
    kind: str = "none"

    def __str__(self) -> str:
        return f"{self.seconds:.3g} s ({self.where}: {self.kind})"


class LimitWatch:
    """Limits of a run: about the reference first, lower where elements fold.

    A step is ``min(2/omega, 2/gamma)`` at most. ``omega^2 = lambda + sigma`` is a bound of the
    squares of all frequencies: lambda the highest one of an element on its own share of the lumped
    mass, sigma that of the springs on the whole mass of its nodes (Gershgorin's circles of blocks
    of six rows, each a node). No frequency of any mesh of such elements is above the highest of
    these, whatever is attached to it or holds it. Stresses are left out, they change the highest
    frequencies little; so are the forces of springs, which may count where one is stretched by much
    of its length on a long lever of a body with little inertia. gamma bounds the rates at which
    velocities decay by viscous sections, dampers and drag likewise: iterations then find the
    velocity after half a kick with a third of the error each time at least. (Damping alone would
    leave all steps stable.)

    Where neighbouring nodes turn against each other, an element may vibrate faster than in the
    reference: one of a flat strip that is shorter than wide by 1.4 times when twisted by 0.5 rad,
    one that is folded by 1.2 rad by a fifth. A step just below its limit is above it then.

    Raises
    ------
    IncompatibleError
        If the mass of a beam is not lumped; for springs, dampers or drag on nodes without inertia
        about some axis.
    """

    def __init__(self, system: System) -> None:
        check_lumped(LIMIT, system)
        self.system = system
        self._coupled = bool(system.couplings.count) or system.drag is not None
        self._places = np.unique(system.couplings.pairs)
        origins = np.isin(self._places, system.vertex_rows)
        self._scale = np.where(origins, system.length, 1.0)[:, None]
        self._seen = y = system.extend(system.q0, 0.0)
        self._turned = [_turns(group, y) for group in system.beam_groups]
        #: (lambda, gamma) of elements (2, ne) of each group, (sigma, gamma) of nodes (2, nv)
        self.own = [_own_rates(g, y, np.arange(len(g.vertices))) for g in system.beam_groups]
        self.attached = self._attached(y)

    def _attached(self, y: Floats) -> Floats:
        system, count = self.system, len(self.system.origin_rows)
        if not self._coupled:
            return np.zeros((2, count))
        nodes = checked_nodes(LIMIT, system)
        D = np.concatenate([y, np.zeros((1, 3))])[nodes.rows[:, 1:]]
        P = null_space_blocks(D)
        M = P.transpose(0, 2, 1) @ np.kron(nodes.matrix, np.eye(3)) @ P
        M[~system.is_frame, 3:, 3:] = np.eye(3)  # points do not turn
        half = np.linalg.solve(np.linalg.cholesky(M), P.transpose(0, 2, 1))
        columns = (3 * nodes.rows[:, :, None] + np.arange(3)).reshape(count, 1, 12)
        rows = np.arange(6 * count).reshape(count, 6, 1)
        at = np.broadcast_to(rows, half.shape).ravel(), np.broadcast_to(columns, half.shape).ravel()
        size = 3 * (system.total + 1)
        H = csr_matrix((half.ravel(), at), (6 * count, size))
        damping = _sparse(system.couplings.pairs, system.couplings.damping(y, taut=True), size)
        if system.drag is not None:
            drag = kron(system.drag, identity(3)).tocsr()
            drag.resize(size, size)
            damping = damping + drag
        stiffness = _sparse(system.couplings.pairs, system.couplings.stiffness(y, taut=True), size)
        return np.array([_circles(H @ each @ H.T) for each in (stiffness, damping)])

    @property
    def limits(self) -> list[Floats]:
        """Smallest ones of elements (ne,) so far (s), for each beam group."""
        return [_seconds(each) for each in self._together]

    @property
    def _together(self) -> list[Floats]:
        pairs = zip(self.system.beam_groups, self.own, strict=True)
        return [own + self.attached[:, g.vertices].max(2) for g, own in pairs]

    @property
    def ends(self) -> float:
        """That of springs, dampers and drag alone (s): of what kicks at the ends of rounds."""
        return float(_seconds(self.attached).min())

    def decay(self, counts: list[IndexArray]) -> float:
        """Highest rate of decay, that of elements by how often they kick in a round (1/s)."""
        each = [float((own[1] / n).max()) for own, n in zip(self.own, counts, strict=True)]
        return float(self.attached[1].max()) + max(each, default=0.0)

    def lowered(self, y: Array) -> bool:
        """Look at what has bent or moved farther; whether a limit has fallen."""
        fallen = False
        for k, group in enumerate(self.system.beam_groups):
            turned = _turns(group, y)
            ids = np.flatnonzero(turned > self._turned[k] + GROWN)
            if len(ids):
                self._turned[k][ids] = turned[ids]
                fallen |= _raise(self.own[k], ids, _own_rates(group, y, ids))
        moved = abs(y[self._places] - self._seen[self._places]) / self._scale
        if moved.max(initial=0.0) > GROWN:
            self._seen = y.copy()
            every = np.arange(self.attached.shape[1])
            fallen |= _raise(self.attached, every, self._attached(y))
        return fallen

    @property
    def smallest(self) -> StepLimit:
        """The lowest limit, and what vibrates there."""
        every = [*self._together, self.attached]
        seconds = [_seconds(each) for each in every]
        number = int(np.argmin([each.min() for each in seconds]))
        e = int(seconds[number].argmin())
        (square, gamma), least = every[number][:, e], float(seconds[number][e])
        if np.isinf(least):
            return StepLimit(least)
        kind = "damping" if gamma > np.sqrt(square) else "springs"
        if number == len(self.own):
            return StepLimit(least, self.system.owner[e].label, kind)
        group = self.system.beam_groups[number]
        if kind != "damping" and self.own[number][0, e] >= 0.5 * square:
            kind = self._kind(group, e)
        return StepLimit(least, _named(self.system, group, e), kind)

    def _kind(self, group: BeamGroup, e: int) -> str:
        elements, eps, B, root = _by_twist(group, self._seen, np.array([e]))
        x = np.linalg.eigh(_reduced(elements.weighted_stiffness, B, root)[0])[1][:, -1]
        eps = (B @ np.linalg.solve(root[0].T, x)).reshape(eps.shape)
        shares = (eps * (elements.weighted_stiffness @ eps[..., None])[..., 0]).sum((0, 1))
        kinds = dict.fromkeys(KINDS, 0.0)
        for kind, share in zip(KINDS, shares, strict=True):
            kinds[kind] += float(share)
        kind = max(kinds, key=lambda name: kinds[name])
        turning = float((x.reshape(-1, 2, 3)[:, 1] ** 2).sum())  # x has length one
        return "shear with rotary inertia" if kind == "shear" and turning > 0.5 else kind


def _seconds(rates: Floats) -> Floats:
    """Limits (k,) of squares of frequencies and rates of decay (2, k)."""
    with np.errstate(divide="ignore"):
        return np.minimum(2 / np.sqrt(rates[0]), 2 / rates[1])


def _raise(rates: Floats, ids: IndexArray, new: Floats) -> bool:
    """Keep the larger ones, in place; whether there are any."""
    larger = bool((new > rates[:, ids]).any())
    rates[:, ids] = np.maximum(rates[:, ids], new)
    return larger


def _sparse(pairs: IndexArray, blocks: Floats, size: int) -> csr_matrix:
    """Matrix of 3x3 blocks at pairs (k, 2) of rows of y."""
    i = np.broadcast_to(3 * pairs[:, :1, None] + np.arange(3)[:, None], blocks.shape)
    j = np.broadcast_to(3 * pairs[:, 1:, None] + np.arange(3), blocks.shape)
    return csr_matrix((blocks.ravel(), (i.ravel(), j.ravel())), (size, size))


def _circles(matrix: csr_matrix) -> Floats:
    """Bounds (k,) with ``x . A x <= sum_k bound_k |x_k|^2`` of symmetric blocks of six rows."""
    blocks = (0.5 * (matrix + matrix.T)).tobsr((6, 6))
    rows = np.repeat(np.arange(matrix.shape[0] // 6), np.diff(blocks.indptr))
    radii = np.linalg.norm(blocks.data, 2, (1, 2))
    return np.asarray(1.0 * np.bincount(rows, radii, matrix.shape[0] // 6))


def _turns(group: BeamGroup, y: Array) -> Floats:
    """Largest rotation (ne,) between neighbouring nodes of each element (rad)."""
    D = y[group.rows].reshape(*group.vertices.shape, 4, 3)[:, :, 1:]
    square = ((D[:, 1:] - D[:, :-1]) ** 2).sum((2, 3)).max(1)  # 8 sin^2 of half the angle
    return np.asarray(2 * np.arcsin(np.sqrt(np.minimum(square / 8, 1.0))))


def _by_twist(
    group: BeamGroup, y: Array, ids: IndexArray
) -> tuple[BeamElements, Floats, Floats, Floats]:
    """Some elements, strains (ne, ng, 6), these by twists (ne, 6 ng, k), L with ``M = L L^T``.

    Twists are velocities and angular velocities of the nodes, k = 6 nn.
    """
    q, elements = y[group.rows[ids]].reshape(len(ids), -1), group.elements.taken(ids)
    eps, B = beam_strain(elements, q)
    P = null_space_blocks(q.reshape(len(ids), -1, 4, 3)[:, :, 1:])
    M = P.transpose(0, 2, 1) @ group.mass[ids] @ P
    return elements, eps, B @ P, np.asarray(np.linalg.cholesky(M), dtype=float)


def _reduced(weighted: Floats, B: Floats, root: Floats) -> Floats:
    """``L^-1 (int B^T D B ds) L^-T`` (ne, k, k)."""
    half = np.linalg.solve(root, bilinear(weighted, B, B))
    return np.asarray(np.linalg.solve(root, half.transpose(0, 2, 1)), dtype=float)


def _own_rates(group: BeamGroup, y: Array, ids: IndexArray) -> Floats:
    """Squares of the highest frequencies and rates of decay (2, ne) of some elements."""
    elements, eps, B, root = _by_twist(group, y, ids)
    out = np.zeros((2, len(ids)))
    out[0] = np.linalg.eigvalsh(_reduced(beam_moduli(elements, eps), B, root))[:, -1]
    if elements.weighted_viscosity is not None:
        damping = _reduced(elements.weighted_viscosity, B, root)
        out[1] = np.linalg.eigvalsh(damping)[:, -1].clip(0)
    return out


def _named(system: System, group: BeamGroup, e: int) -> str:
    for beam in (item for item in system.structures if is_beam(item)):
        ids = group.slices.get(id(beam), slice(0, 0))
        if ids.start <= e < ids.stop:
            return f"element {e - ids.start} of {beam.label}"
    raise InputError("element", f"{e} is of no beam")


def check_lumped(name: str, system: System) -> None:
    """Raise IncompatibleError if the mass matrix of a beam couples nodes; `name`: who minds."""
    for item in system.structures:
        if is_beam(item) and not item.lumped:
            reason = "its mass matrix couples nodes: Beam(..., lumped=True) does not"
            raise IncompatibleError(f"{name} with {item.label}", reason)


def check_scene(name: str, system: System, treatment: Treatment) -> None:
    """Raise IncompatibleError if there is something that the explicit schemes cannot do."""
    if not isinstance(treatment, Multipliers):
        reason = "its joints keep multipliers of their own, nothing else is eliminated"
        raise IncompatibleError(f"{name} with {treatment!r}", f"take Multipliers(): {reason}")
    if not treatment.scaled:
        reason = "its joints are closed by projection, there is no matrix to scale"
        raise IncompatibleError(f"{name} with {treatment!r}", f"take Multipliers(): {reason}")

    def refuse(what: str, reason: str) -> None:
        raise IncompatibleError(f"{name} with {what}", reason)

    if system.plane is not None:
        refuse(f"{system.plane!r}", "explicit steps move all nodes in space: freeze it without")
    check_lumped(name, system)
    for item in system.structures:
        if is_beam(item) and item.theory.held:
            refuse(
                f"the {item.theory!r} of {item.label}", "strains are held by implicit steps only"
            )
    for drive in system.drives:
        refuse(drive.label, "motion is not prescribed in explicit steps")
    if system.moving:
        refuse("moving ground", "motion is not prescribed in explicit steps")
    if len(system.closure.rows):
        names = sorted(system.redundancies()) or ["a closed loop of joints"]
        refuse(f"closed loops ({names[0]})", "joints have to form a tree")
    checked_nodes(name, system)


def checked_nodes(name: str, system: System) -> Nodes:
    """Nodes of a system, or IncompatibleError if one has no inertia about an axis."""
    nodes = Nodes(system)
    slim = np.flatnonzero(nodes.slimness < 1e-12)
    if len(slim):
        reason = "drifts need inertia about all axes"
        raise IncompatibleError(f"{name} with {system.owner[int(slim[0])].label}", reason)
    return nodes


# -- kicks -----------------------------------------------------------------------------------------


@dataclass(eq=False)
class Kick:
    """Elements of a group that kick their nodes at one instant.

    Attributes
    ----------
    elements : BeamElements
    rows : (ne, 4 nn) int array
        Of y.
    share : (ne, 1, 1) array
        Half of the time between two of their kicks, by that of a round.
    v, parts : (k,), (k, 4) int arrays
        Their nodes, and rows of these.
    where : (12 ne nn,) int array
        Where forces on the nodes of elements are added up, (k, 4, 3).
    """

    elements: BeamElements
    rows: IndexArray
    share: Floats
    v: IndexArray
    parts: IndexArray
    where: IndexArray

    @classmethod
    def of(cls, group: BeamGroup, ids: IndexArray, counts: IndexArray, nodes: Nodes) -> Kick:
        """Elements `ids` of a group that kick as often as their counts say in a round."""
        v, local = np.unique(group.vertices[ids], return_inverse=True)
        where = 12 * local.reshape(-1, 1) + np.arange(12)
        share = 0.5 / counts[ids][:, None, None]
        own = group.elements.taken(ids), group.rows[ids], share
        return cls(*own, v, nodes.rows[v], where.ravel())

    def local(self, y: Floats) -> Floats:
        """Rows of y, or of velocities, of each element (ne, 12 nn)."""
        return y.take(self.rows, axis=0).reshape(len(self.rows), -1)

    def add(self, out: Floats, y: Floats, B: Floats, stress: Floats, h: float) -> None:
        """Add the impulses of stresses during half of the time between two kicks to momenta."""
        f = beam_force(self.elements, B, (h * self.share) * stress)
        own = np.bincount(self.where, f.ravel(), 12 * len(self.v)).reshape(-1, 4, 3)
        own[:, 1] = director_force(y[self.parts[:, 1:]], own[:, 1:])
        out[self.v] -= own[:, :2]


class Instant(NamedTuple):
    """What happens at one instant of a round.

    Attributes
    ----------
    free, ways : Bodies, (k,) array
        Nodes without joints that come here, and times since they were moved last, by the round.
    clusters : list of (Cluster, float)
        The same of nodes with joints.
    kicks : list of Kick
    last : bool
        Whether it is the end of the round.
    """

    free: Bodies
    ways: Floats
    clusters: list[tuple[Cluster, float]]
    kicks: list[Kick]
    last: bool


def planned(system: System, nodes: Nodes, counts: list[IndexArray]) -> Iterator[Instant]:
    """All instants of a round; at its end all nodes have come and all elements kick."""
    groups, clock = system.beam_groups, np.zeros(len(nodes.rows))
    known: dict[tuple[int, bytes], Kick] = {}
    each = [np.arange(1, n) / n for n in {int(n) for c in counts for n in c}]
    for now in [*np.unique(np.concatenate([np.zeros(0), *each])), 1.0]:
        kicks = []
        for k, (group, count) in enumerate(zip(groups, counts, strict=True)):
            # fractions are rounded alike wherever they are equal
            ids = np.flatnonzero(np.rint(now * count) / count == now)
            if len(ids):
                key = k, ids.tobytes()
                if key not in known:
                    if len(known) > KEPT:
                        known.clear()
                    known[key] = Kick.of(group, ids, count, nodes)
                kicks.append(known[key])
        touched = [kick.v for kick in kicks] if now < 1 else [np.arange(len(clock))]
        v = np.unique(np.concatenate(touched))
        of = nodes.cluster_of[v]
        clusters = [nodes.clusters[number] for number in np.unique(of[of >= 0])]
        free = v[of < 0]
        spans = [(c, float(now - clock[c.bodies.number[0]])) for c in clusters]
        yield Instant(nodes.bodies.taken(free), now - clock[free], spans, kicks, bool(now == 1))
        for moved in (free, *(c.bodies.number for c in clusters)):
            clock[moved] = now


class Outer:
    """Loads, force elements and drag of a round, all but constant numbers in time by their means.

    Parameters
    ----------
    system : System
    y : array
        At the start.
    turns : (k,) int array or None
        Of angles there.
    t0, h : float
        Start and length (s).
    """

    def __init__(
        self, system: System, y: Floats, turns: IndexArray | None, t0: float, h: float
    ) -> None:
        self._system, couplings = system, system.couplings
        self._amplitudes = system.loading.averages(t0, t0 + h)
        self._dead = system.loading.dead_force(self._amplitudes)
        self.start = couplings.begin(y[:-1], turns, t0, h) if couplings.count else None

    def at(self, y: Floats, rates: Floats) -> Ends:
        """Forces at a configuration of all rows, and their rates."""
        system, loading = self._system, self._system.loading
        loads = self._dead
        if not loading.dead_only:
            loads = loads + loading.force(y[: system.rows], self._amplitudes)
        force, power, coupled = loads, 0.0, None
        if self.start is not None:
            coupled = system.couplings.static(self.start, y[:-1], rates[:-1])
            force = force - coupled.force[: system.rows]
            power = sum(float(r.dissipated.sum()) for r in coupled.responses)
        if system.drag is not None:
            v = rates[: system.rows]
            drag = system.drag @ v
            force = force - drag
            power += max(0.0, float((v * drag).sum()))  # of either sign at rounding level
        return Ends(loads, force, power, coupled)


class Ends(NamedTuple):
    """Forces (rows, 3) at an end of a round: loads, all; power that is lost; force elements."""

    loads: Floats
    force: Floats
    power: float
    coupled: CoupledForce | None


class Half(NamedTuple):
    """Half of the kicks of an instant.

    Attributes
    ----------
    impulse : (nv, 2, 3) array
        Of elements.
    lost : float
        In viscous sections (J).
    ends : Ends or None
        At the end of a round.
    whole : (nv, 2, 3) array
        The impulse of everything.
    """

    impulse: Floats
    lost: float
    ends: Ends | None
    whole: Floats


# -- march -----------------------------------------------------------------------------------------


class Marching(March):
    """Marches a system; each element with steps of its own.

    Forces that depend on velocities take that between both halves of a kick, found by fixed-point
    iteration: the first half ends with it, the second one starts from it, so that a kick, and with
    it a round, is symmetric in time. Joints hold this velocity, too.

    Parameters
    ----------
    scheme : ExplicitScheme
        Says how many rounds and steps there are.
    system : System
    h : float
        Step of the run (s).
    watch : LimitWatch
    method : str

    Attributes
    ----------
    rounds : int
        Equal parts of a step.
    evaluations : int
        Of elements so far.
    shortened : bool
        Whether elements have been given shorter steps since the start.
    """

    def __init__(
        self, scheme: ExplicitScheme, system: System, h: float, watch: LimitWatch, method: str
    ) -> None:
        self.system, self.h, self.method = system, h, method
        self._scheme, self._watch, self.nodes = scheme, watch, Nodes(system)
        self.evaluations, self.shortened = 0, False
        couplings = system.couplings
        viscous = system.drag is not None or any(c.damping.any() for c in couplings.items)
        viscous = viscous or bool(couplings.functions)
        self._viscous = viscous or any(g.viscous for g in system.beam_groups)
        self._loaded = bool(system.loading.times or couplings.count) or (system.drag is not None)
        self._last: tuple[State, Half] | None = None
        self._plan(*scheme.plan(system, h, watch))

    def _plan(self, rounds: int, counts: list[IndexArray]) -> None:
        self.rounds, self._counts = rounds, counts
        most = sum({int(n) for each in counts for n in each})
        self._kept = [*self._instants()] if most <= KEPT else None
        pairs = [(g, n) for g, n in zip(self.system.beam_groups, counts, strict=True) if len(n)]
        self._ends = [Kick.of(g, np.arange(len(n)), n, self.nodes) for g, n in pairs]
        # changes shrink by -theta at most where theta is h gamma/2, by theta/(2 + theta) if relaxed
        theta = 0.5 * self.h / rounds * self._watch.decay(counts)
        self._relaxed = 1 / (1 + 0.5 * theta)

    def _instants(self) -> Iterator[Instant]:
        return planned(self.system, self.nodes, self._counts)

    @property
    def counts(self) -> list[IndexArray]:
        """Steps (ne,) of the elements of each beam group in a step of the run."""
        return [self.rounds * each for each in self._counts]

    def _replan(self, time: float) -> None:
        """Shorter steps where limits have fallen."""
        rounds, counts = self._scheme.plan(self.system, self.h, self._watch)
        same = zip(counts, self._counts, strict=True)
        if rounds == self.rounds and all((a == b).all() for a, b in same):
            return
        self._plan(rounds, counts)
        self._last = None
        smallest = self._watch.smallest
        attached = smallest.kind in ("springs", "damping")
        what = "springs and dampers have moved" if attached else "elements are bent"
        to = f"{smallest.seconds:.3g} s of {smallest.where}"
        text = f"{what} so far that their limits fall, to {to}: shorter steps"
        if not self.shortened:
            warn(f"integrator {self._scheme.name!r}", text, AccuracyWarning, time)
        logger.debug("t = %.6g s: %s", time, text)
        self.shortened = True

    def advance(self, state: State, time: float) -> Marched:
        """See the base class."""
        system = self.system
        y = np.concatenate([system.extend(state.q, state.time), np.zeros((1, 3))])
        if self._scheme.checked and self._watch.lowered(y[:-1]):
            self._replan(state.time)
        m = self.nodes.momenta(y, state.p.reshape(-1, 3))
        try:
            with np.errstate(all="ignore"):  # what has blown up is looked at below
                new, work, iterations = self._rounds(state, y, m, time)
        except Unclosed as error:
            advice = f"try a smaller step than {self.h:g} s"
            where = state.time, state.index + 1, error.gap
            raise Diverged(*where, error.what, advice) from error
        way = float(abs(y[: system.rows] - state.q.reshape(-1, 3)).max(initial=0.0))
        if not (way < FAR * system.length and np.isfinite(m).all()):
            reason = f"the motion has blown up: nodes move by {way:.3g} m in a step"
            raise Diverged(state.time, state.index + 1, np.inf, reason, self.method)
        gap = max((float(abs(c.gaps(y)).max()) for c in self.nodes.clusters), default=0.0)
        return Marched(new, iterations, gap, work)

    def _rounds(
        self, state: State, y: Floats, m: Floats, time: float
    ) -> tuple[State, StepWork, int]:
        """All rounds of a step, in place."""
        h, turns, rows = self.h / self.rounds, state.turns, self.system.rows
        half = self._half_at(state)
        loads = actuators = lost = 0.0
        iterations = 0
        for k in range(self.rounds):
            t0, y0 = state.time + k * h, y[:rows].copy()
            outer = Outer(self.system, y, turns, t0, h) if self._loaded else None
            first = half = self._first(half, outer, y, m, h)
            m += half.whole
            lost += first.lost
            for instant in self._instants() if self._kept is None else self._kept:
                drifts = self._drift(instant, y, m, h)
                half, kicks = self._half(instant, y, m, h, outer if instant.last else None)
                lost, iterations = lost + half.lost, max(iterations, drifts, kicks)
                if not instant.last:
                    m += half.whole
                    lost += half.lost
            if outer is not None:
                assert first.ends is not None
                assert half.ends is not None
                both = first.ends.loads + half.ends.loads
                loads += 0.5 * float((both * (y[:rows] - y0)).sum())
                lost += 0.5 * h * (first.ends.power + half.ends.power)
                if outer.start is not None and half.ends.coupled is not None:
                    couplings = self.system.couplings
                    actuators += couplings.work(outer.start, half.ends.coupled, y[:-1]).actuators
                    turns = couplings.turns(outer.start, y[:-1], t0 + h)
                    assert first.ends.coupled is not None
                    change = y[:-1].copy()
                    change[:rows] -= y0
                    change[rows:] = 0.0
                    pushed = first.ends.coupled, half.ends.coupled
                    loads += 0.5 * sum(coupled.work_of_loads(change) for coupled in pushed)
        self.nodes.tidy(y)
        for cluster in self.nodes.clusters:
            cluster.projection(y)(m)
        p = self.system.mass @ self.nodes.velocities(y)(m)[:rows]
        q = y[:rows].flatten()
        new = State(time, state.index + 1, q, p.reshape(-1), fresh=False, turns=turns)
        assert half is not None
        self._last = new, half
        return new, StepWork(loads, actuators, lost), iterations

    def _half_at(self, state: State) -> Half | None:
        """Half of the kicks that the last step found at its end; None if this is another state."""
        if self._last is None:
            return None
        end, half = self._last
        before, now = (0 if each.turns is None else each.turns for each in (end, state))
        same = end.time == state.time and np.array_equal(before, now)
        return half if same and (end.q == state.q).all() and (end.p == state.p).all() else None

    def _first(
        self, last: Half | None, outer: Outer | None, y: Floats, m: Floats, h: float
    ) -> Half:
        """The first half of the kicks of a round; elements kick as in the `last`."""
        if last is None:
            return self._impulses(self._ends, y, m, h, outer)(m)
        if outer is None:
            return last
        ends = outer.at(y, self._velocities(y)(m))
        whole = last.impulse + 0.5 * h * self.nodes.momenta(y, ends.force)
        return Half(last.impulse, last.lost, ends, whole)

    def _impulses(
        self, kicks: list[Kick], y: Floats, m: Floats, h: float, outer: Outer | None
    ) -> Callable[[Floats], Half]:
        """Half of some kicks by the momenta that give the velocity."""
        elastic, strained = np.zeros_like(m), []
        for kick in kicks:
            self.evaluations += len(kick.rows)
            eps, B = beam_strain(kick.elements, kick.local(y))
            kick.add(elastic, y, B, beam_stress(kick.elements, eps), h)
            if kick.elements.viscosity is not None:
                strained.append((kick, B))

        velocities = self._velocities(y)

        def half(at: Floats) -> Half:
            impulse, lost, ends = elastic, 0.0, None
            rates = velocities(at)
            for kick, B in strained:
                rate = beam_strain_rate(B, kick.local(rates))
                impulse = impulse.copy()
                kick.add(impulse, y, B, beam_viscous_stress(kick.elements, rate), h)
                power = beam_dissipation(kick.elements, rate)
                lost += h * float((kick.share[:, 0, 0] * power).sum())
            whole = impulse
            if outer is not None:
                ends = outer.at(y, rates)
                whole = impulse + 0.5 * h * self.nodes.momenta(y, ends.force)
            return Half(impulse, lost, ends, whole)

        return half

    def _velocities(self, y: Floats) -> Callable[[Floats], Floats]:
        """Velocities of momenta; zero where nothing asks for them."""
        none = np.zeros_like(y)
        return self.nodes.velocities(y) if self._viscous else lambda _: none

    def _half(
        self, instant: Instant, y: Floats, m: Floats, h: float, outer: Outer | None
    ) -> tuple[Half, int]:
        """Kick by one half, in place, such that the velocity is that after it."""
        impulses = self._impulses(instant.kicks, y, m, h, outer)
        half = impulses(m)
        if not self._viscous:
            m += half.whole
            return half, 0
        projections = [cluster.projection(y) for cluster, _ in instant.clusters]
        after, last = m + half.whole, np.inf
        for k in range(1, ITERATIONS + 1):
            for project in projections:
                project(after)
            half = impulses(after)
            change = m + half.whole - after
            for project in projections:
                project(change)
            size = np.maximum(abs(after).max((0, 2), initial=0.0), 1e-300)
            left = float((abs(change).max((0, 2), initial=0.0) / size).max())
            if left <= SETTLED[0] or 0.5 * last < left <= SETTLED[1]:
                m[:] = after + change
                return half, k
            after, last = after + self._relaxed * change, left
        raise Unclosed("the velocity that dampers leave after a kick was not found", last)

    @staticmethod
    def _drift(instant: Instant, y: Floats, m: Floats, h: float) -> int:
        """Bring nodes, with all that joints connect to them, to an instant; gives iterations."""
        found = [cluster.drift(y, m, h * way) for cluster, way in instant.clusters]
        if len(instant.ways):
            instant.free.drift(y, m, h * instant.ways)
        return max(found, default=0)


# -- schemes ---------------------------------------------------------------------------------------


class ExplicitScheme(Integrator):
    """What the explicit schemes have in common: no balance, no tangent, p = M v."""

    order = 2
    fixed_step = (
        "symplectic for steps of one size only (with steps that follow the motion its energy"
        " drifts), and bound to the limit of its elements"
    )
    solves = False
    constraint_weight = 0.0
    carries_node_momentum = True
    remembered = 0
    advice = "a step below the limit"
    conserves = "symplectic form, momentum maps; energy oscillates within a bound"
    checked: bool

    @staticmethod
    def limit(system: Model | System) -> StepLimit:
        """Step (s) up to which all elements and springs are stable, and what sets it.

        ``min(2/omega, 2/gamma)`` about the reference. omega is not below any frequency of the
        scene: its square is that of the highest one of an element on its own share of the mass,
        and a bound of the springs on its nodes (Gershgorin's). gamma bounds the rates at which
        viscous sections, dampers and drag take velocities alike. Stresses and forces of springs
        are left out, cables count as taut.

        Raises
        ------
        InputError
            If it is neither a model nor a system.
        IncompatibleError
            If the mass of a beam is not lumped.
        """
        return LimitWatch(system_of(system)).smallest

    @abstractmethod
    def plan(self, system: System, h: float, watch: LimitWatch) -> tuple[int, list[IndexArray]]:
        """Rounds of a step (s), and counts of the elements of each beam group in a round."""


class Explicit(ExplicitScheme):
    """Explicit, symplectic, of second order: for soft or finely meshed beams.

    Beams have their mass at the nodes (``Beam(..., lumped=True)``). A step is half a kick by the
    elastic forces, force elements and loads (their mean over the step), the drift of every node as
    a free rigid body, and half a kick. Nodes and bodies that joints connect drift together, with
    impulses along the constraints at the start such that these hold at the end; velocities are
    projected at the end of the step. Triads stay orthonormal, momentum maps and joints exact, to
    rounding. Viscous forces kick along: with the velocity between two half kicks, of second order.

    The step is limited by the highest frequency of elements and springs, and by damping;
    ``Explicit.limit(system)`` says where and what vibrates there. At each step of the run it is
    looked at again, and there are more rounds if it has fallen, with a warning.

    Parameters
    ----------
    rounds : int
        A step of the run consists of as many equal steps, at whose end nothing is recorded.
    checked : bool
        Refuse steps above the limit, and shorten them where it falls; False: to see what happens
        there.

    Raises
    ------
    InputError
        If `rounds` is not a positive integer; for a step above the limit, before the run.
    IncompatibleError
        Before the run, for what the scheme cannot do: beams with consistent mass or held strains,
        drives, prescribed motion, closed loops of joints, scenes in a plane, treatments other than
        ``Multipliers()``, also unscaled ones, nodes without inertia about some axis, solvers of
        linear systems, of which there are none.

    Notes
    -----
    It is :class:`Asynchronous` with one step for all elements. There are no compiled kernels.
    Constraint forces are those of the continuous equations at the recorded states. Kick and drift:
    Verlet's method; joints: Leimkuhler & Reich, Simulating Hamiltonian dynamics (2004), ch. 7, 8.

    Examples
    --------
    >>> from skfem_cosserat import (
    ...     Beam, LoadGravity, Material, MeshCurve, Model, Multipliers, SectionCircle, simulate
    ... )
    >>> mesh = MeshCurve.init_line((0, 0, 0), (1, 0, 0), 8, name="rod")
    >>> rubber = SectionCircle(0.02, Material(5e6, 0.5, 1100))
    >>> model = Model()
    >>> rod = model.add("rod", Beam(mesh, rubber, lumped=True, angular_velocity=(1.0, 0, 0)))
    >>> system = model.freeze()
    >>> print(Explicit.limit(system))
    0.000535 s (element 0 of beam 'rod': shear with rotary inertia)
    >>> history = simulate(system, Explicit(rounds=50), Multipliers(), step=0.02, until=0.1)
    >>> bool(abs(history["angular_momentum"] - history["angular_momentum"][0]).max() < 1e-15)
    True
    """

    name = "explicit"
    reference = "Verlet, Phys. Rev. 159 (1967) 98; Leimkuhler & Reich (2004)"

    def __init__(self, rounds: int = 1, checked: bool = True) -> None:
        whole = isinstance(rounds, int | np.integer) and not isinstance(rounds, bool)
        if not whole or rounds < 1:
            raise InputError("argument rounds", f"{rounds!r}, expected a positive integer")
        self.rounds, self.checked = int(rounds), switch("argument checked", checked)

    def __repr__(self) -> str:
        return f"Explicit(rounds={self.rounds}{'' if self.checked else ', checked=False'})"

    def plan(self, system: System, h: float, watch: LimitWatch) -> tuple[int, list[IndexArray]]:
        """See the base class."""
        least = np.ceil(h / watch.smallest.seconds * (1 - NEAR)) if self.checked else 1
        ones = [np.ones(len(g.vertices), dtype=np.int64) for g in system.beam_groups]
        return max(self.rounds, int(least)), ones

    def march(self, system: System, treatment: Treatment, h: float) -> Marching:
        """See the base class."""
        check_scene(repr(self), system, treatment)
        watch = LimitWatch(system)
        limit = watch.smallest
        if self.checked and h / self.rounds > limit.seconds:
            least = int(np.ceil(h / limit.seconds))
            raise InputError(
                "argument step",
                f"{h:g} s in {self.rounds} rounds is above the limit of the explicit scheme,"
                f" {limit}: at least rounds={least}, or a smaller step",
            )
        logger.info("explicit steps of %.3g s, limit %s", h / self.rounds, limit)
        return Marching(self, system, h, watch, f"explicit, limit {limit}")


class Asynchronous(ExplicitScheme):
    """The explicit scheme with a step of its own for every element.

    Elements that are due at one instant kick their nodes together; in between, every node drifts as
    a free rigid body from one kick of its elements to the next. Elements take the fewest equal
    parts of the run's step that are below `safety` times their own limit, so that all meet at its
    end, where loads and force elements kick and states are recorded. Momentum maps are exact;
    energy stays within a bound, short of resonances: where the fast vibrations next to a slow
    element meet its rhythm, it feeds them. Steps that change little by little prevent that. The
    limits of elements are looked at again as these bend, and steps are made shorter where they have
    fallen, with a warning: the energy may change a little there.

    Of second order if `safety` gets smaller with the step: all elements then keep their numbers of
    steps. With the same `safety` only the longest steps get shorter, those of the fast elements
    stay, and so does what they leave of the error.

    Parameters
    ----------
    safety : float
        Largest step of an element by its limit, in (0, 1].
    grading : float
        Largest ratio of the steps of two elements that share a node; infinite: any.
    checked : bool
        False: `safety` may be above one, to see what happens there.

    Raises
    ------
    InputError
        If `safety` or `grading` is not in its range.
    IncompatibleError
        As :class:`Explicit`, before the run.

    Notes
    -----
    Loads, springs, dampers and drag kick at the ends of the run's steps only: choose these
    accordingly. Where springs and dampers need shorter ones, a step consists of equal rounds, at
    whose ends they kick.

    Examples
    --------
    A rod of which a quarter is meshed eight times as finely:

    >>> from skfem_cosserat import Beam, Material, MeshCurve, Model, SectionCircle
    >>> mesh = MeshCurve.init_line((0, 0, 0), (0.75, 0, 0), 3, name="coarse")
    >>> mesh = mesh + MeshCurve.init_line((0.75, 0, 0), (1, 0, 0), 8, name="fine")
    >>> section = SectionCircle(0.2, Material(5e6, 0.5, 1100))
    >>> model = Model()
    >>> rod = model.add("rod", Beam(mesh, section, director=(0, 1, 0), lumped=True))
    >>> Asynchronous(safety=1.0).counts(model.freeze(), 3.7e-3)[0].tolist()
    [1, 2, 4, 8, 8, 8, 8, 8, 8, 8, 8]
    """

    name = "asynchronous"
    reference = "Lew, Marsden, Ortiz & West, Arch. Ration. Mech. Anal. 167 (2003) 85"

    def __init__(self, safety: float = 0.9, grading: float = 2.0, checked: bool = True) -> None:
        self.checked = switch("argument checked", checked)
        expected = "a number in (0, 1]" if checked else "a positive finite number"
        self.safety = real("argument safety", "safety", safety, expected)
        if not 0 < self.safety <= (1 if checked else np.finfo(float).max):
            raise InputError("argument safety", f"{safety!r}, expected {expected}")
        expected = "a number of one or more"
        self.grading = real("argument grading", "grading", grading, expected)
        if not self.grading >= 1:
            raise InputError("argument grading", f"{grading!r}, expected {expected}")

    def __repr__(self) -> str:
        more = "" if self.checked else ", checked=False"
        return f"Asynchronous(safety={self.safety:g}, grading={self.grading:g}{more})"

    @staticmethod
    def limits(system: Model | System) -> list[Floats]:
        """Largest stable step (ne,) in s of the elements of each beam group.

        With springs and dampers on their nodes, see :meth:`limit`.

        Raises
        ------
        InputError
            If it is neither a model nor a system.
        IncompatibleError
            If the mass of a beam is not lumped.
        """
        return LimitWatch(system_of(system)).limits

    def counts(
        self, system: Model | System, step: float, limits: list[Floats] | None = None
    ) -> list[IndexArray]:
        """Steps (ne,) of the elements of each beam group in a step (s) of the run.

        Parameters
        ----------
        limits : list of arrays, optional
            Default: :meth:`limits`.

        Raises
        ------
        InputError
            For other arguments.
        IncompatibleError
            If the mass of a beam is not lumped.
        """
        system = system_of(system)
        step = positive("argument step", "step", step, " of seconds")
        chosen = self.limits(system) if limits is None else _checked(system, limits)
        counts = [
            np.maximum(1, np.ceil(step / (self.safety * each) * (1 - 1e-12))).astype(np.int64)
            for each in chosen
        ]
        while True:
            most = np.zeros(len(system.origin_rows), dtype=np.int64)
            for group, own in zip(system.beam_groups, counts, strict=True):
                np.maximum.at(most, group.vertices, own[:, None])
            pairs = zip(system.beam_groups, counts, strict=True)
            graded = [
                np.maximum(own, np.ceil(most[g.vertices].max(1) / self.grading).astype(np.int64))
                for g, own in pairs
            ]
            if all((a == b).all() for a, b in zip(graded, counts, strict=True)):
                return counts
            counts = graded

    def plan(self, system: System, h: float, watch: LimitWatch) -> tuple[int, list[IndexArray]]:
        """See the base class."""
        rounds = max(1, int(np.ceil(h / (self.safety * watch.ends) * (1 - 1e-9))))
        return rounds, self.counts(system, h / rounds, watch.limits)

    def march(self, system: System, treatment: Treatment, h: float) -> Marching:
        """See the base class."""
        check_scene(repr(self), system, treatment)
        watch = LimitWatch(system)
        rounds, counts = self.plan(system, h, watch)
        every = rounds * np.concatenate([*counts, np.ones(1, dtype=np.int64)])
        low, high = int(every[:-1].min(initial=every[-1])), int(every.max())
        limit = watch.smallest
        logger.info("steps of elements: %d to %d a step, smallest limit %s", low, high, limit)
        method = f"explicit, {low} to {high} steps of each element, smallest limit {limit}"
        return Marching(self, system, h, watch, method)


def _checked(system: System, limits: object) -> list[Floats]:
    """Limits of the elements of each beam group, as given."""
    check_lumped("steps of the elements", system)
    sizes = [len(group.vertices) for group in system.beam_groups]
    expected = f"expected positive numbers (s) of {sizes} elements, as limits(system) gives them"
    if not isinstance(limits, Sequence) or len(limits) != len(sizes):
        raise InputError("argument limits", f"{limits!r}, {expected}")
    out = [numbers("argument limits", "limits", each) for each in limits]
    if any(each.shape != (n,) or not (each > 0).all() for each, n in zip(out, sizes, strict=True)):
        raise InputError("argument limits", f"{limits!r}, {expected}")
    return out
