"""Nodes of explicit schemes, rigid bodies that drift, and their largest stable step."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_matrix, identity, kron

from ..constraints.base import pair_numbers
from ..errors import IncompatibleError
from ..frames import is_beam
from ..kernels import (
    BeamElements,
    beam_moduli,
    beam_strain,
    bilinear,
    cross,
    director_force,
    exp_quaternion,
    null_space_blocks,
    rotation_matrix,
)
from ..model import System
from ..model.groups import BeamGroup
from ..types import Array, Floats, IndexArray, largest

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


# -- largest stable step, by the frequencies of elements and springs -------------------------------

#: growth of the rotation between neighbouring nodes (rad), change of the places that force elements
#: act on (of directors, and by the extent of the scene), after which limits are looked at again:
#: they fall by some 2 % meanwhile
GROWN = 0.02
#: who minds what has no limit
LIMIT = "step limit of explicit schemes"
#: what vibrates, and which of the strains tell of it
KINDS = ("shear", "axial", "bending", "torsion")
SAME_KIND = np.eye(4)[[0, 0, 1, 2, 2, 3]]


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
    >>> from skfem_cosserat import (
    ...     Beam, Explicit, Material, MeshCurve, Model, SectionCircle
    ... )
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
        coupled = bool(system.couplings.count) or system.drag is not None
        self._nodes = checked_nodes(LIMIT, system).bodies if coupled else None
        self._places = np.unique(system.couplings.pairs)
        origins = np.isin(self._places, system.vertex_rows)
        self._scale = np.where(origins, system.length, 1.0)[:, None]
        self._seen = y = system.extend(system.q0, 0.0)
        self._turned = [_turns(group, y) for group in system.beam_groups]
        #: (lambda, gamma) of elements (2, ne) of each group, then (sigma, gamma) of nodes (2, nv)
        self.rates = self._looked_at(y)

    def _looked_at(self, y: Floats) -> list[Floats]:
        return [*(_rates(group, y) for group in self.system.beam_groups), self._attached(y)]

    def _attached(self, y: Floats) -> Floats:
        system = self.system
        if self._nodes is None:
            return np.zeros((2, len(system.origin_rows)))
        P, M = self._nodes.by_twists(np.concatenate([y, np.zeros((1, 3))]))
        half = np.linalg.solve(np.linalg.cholesky(M), P.transpose(0, 2, 1))
        H = self._nodes.by_coordinates(half, system.n)
        places = pair_numbers(system.couplings.pairs, 3 * np.arange(system.rows))
        stiffness, damping = (
            csr_matrix((blocks(y, taut=True).ravel(), places), (system.n, system.n))
            for blocks in (system.couplings.stiffness, system.couplings.damping)
        )
        if system.drag is not None:
            damping = damping + kron(system.drag, identity(3))
        return np.array([_circles(H @ each @ H.T) for each in (stiffness, damping)])

    @property
    def decay(self) -> float:
        """Highest rate of decay, that of elements and of what is attached (1/s)."""
        *elements, attached = (float(rates[1].max()) for rates in self.rates)
        return attached + max(elements, default=0.0)

    def lowered(self, y: Array) -> bool:
        """Look again where elements are bent or places have moved; whether a limit has fallen."""
        turned = [_turns(group, y) for group in self.system.beam_groups]
        moved = abs(y[self._places] - self._seen[self._places]) / self._scale
        grown = [float((b - a).max()) for a, b in zip(self._turned, turned, strict=True)]
        if not max(*grown, float(moved.max(initial=0.0)), 0.0) > GROWN:
            return False
        self._seen, new = y.copy(), self._looked_at(y)
        self._turned = [np.maximum(*both) for both in zip(self._turned, turned, strict=True)]
        fallen = any((b > a).any() for a, b in zip(self.rates, new, strict=True))
        self.rates = [np.maximum(*both) for both in zip(self.rates, new, strict=True)]
        return fallen

    @property
    def smallest(self) -> StepLimit:
        """The lowest limit, and what vibrates there."""
        groups, (*elements, attached) = self.system.beam_groups, self.rates
        pairs = zip(groups, elements, strict=True)
        every = [*(rates + attached[:, g.vertices].max(2) for g, rates in pairs), attached]
        with np.errstate(divide="ignore"):
            seconds = [np.minimum(2 / np.sqrt(square), 2 / gamma) for square, gamma in every]
        number = int(np.argmin([each.min() for each in seconds]))
        e = int(seconds[number].argmin())
        (square, gamma), least = every[number][:, e], float(seconds[number][e])
        if np.isinf(least):
            return StepLimit(least)
        kind = "damping" if gamma > np.sqrt(square) else "springs"
        if number == len(groups):
            return StepLimit(least, self.system.owner[e].label, kind)
        if kind != "damping" and elements[number][0, e] >= 0.5 * square:
            kind = self._kind(groups[number], e)
        return StepLimit(least, _named(self.system, groups[number], e), kind)

    def _kind(self, group: BeamGroup, e: int) -> str:
        elements, eps, B, root = _by_twist(group, self._seen)
        weighted = elements.weighted_stiffness
        x = np.linalg.eigh(_reduced(weighted, B, root)[e])[1][:, -1]
        eps = (B[e] @ np.linalg.solve(root[e].T, x)).reshape(eps[e].shape)
        shares = (eps * (weighted[e] @ eps[..., None])[..., 0]).sum(0)
        kind = KINDS[int((shares @ SAME_KIND).argmax())]
        turning = float((x.reshape(-1, 2, 3)[:, 1] ** 2).sum())  # x has length one
        return "shear with rotary inertia" if kind == "shear" and turning > 0.5 else kind


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
    return 2 * np.arcsin(np.sqrt(np.minimum(square / 8, 1.0)))


def _by_twist(group: BeamGroup, y: Array) -> tuple[BeamElements, Floats, Floats, Floats]:
    """Elements, strains (ne, ng, 6), these by twists (ne, 6 ng, k), L with ``M = L L^T``.

    Twists are velocities and angular velocities of the nodes, k = 6 nn.
    """
    q, elements = y[group.rows].reshape(len(group.rows), -1), group.elements
    eps, B = beam_strain(elements, q)
    P = null_space_blocks(q.reshape(len(q), -1, 4, 3)[:, :, 1:])
    M = P.transpose(0, 2, 1) @ group.mass @ P
    return elements, eps, B @ P, np.asarray(np.linalg.cholesky(M), dtype=float)


def _reduced(weighted: Floats, B: Floats, root: Floats) -> Floats:
    """``L^-1 (int B^T D B ds) L^-T`` (ne, k, k)."""
    half = np.linalg.solve(root, bilinear(weighted, B, B))
    return np.asarray(np.linalg.solve(root, half.transpose(0, 2, 1)), dtype=float)


def _rates(group: BeamGroup, y: Array) -> Floats:
    """Squares of the highest frequencies and rates of decay (2, ne) of elements."""
    elements, eps, B, root = _by_twist(group, y)
    out, moduli = np.zeros((2, len(eps))), beam_moduli(elements, eps)
    for rates, weighted in zip(out, (moduli, elements.weighted_viscosity), strict=True):
        if weighted is not None:
            rates[:] = np.linalg.eigvalsh(_reduced(weighted, B, root))[:, -1].clip(0)
    return out


def _named(system: System, group: BeamGroup, e: int) -> str:
    """Element and beam of an element of a group."""
    beams = {item.label: group.slices.get(id(item), slice(0, 0)) for item in system.structures}
    label, ids = next(each for each in beams.items() if each[1].start <= e < each[1].stop)
    return f"element {e - ids.start} of {label}"


def check_lumped(name: str, system: System) -> None:
    """Raise IncompatibleError if the mass matrix of a beam couples nodes; `name`: who minds."""
    for item in system.structures:
        if is_beam(item) and not item.lumped:
            reason = "its mass matrix couples nodes: Beam(..., lumped=True) does not"
            raise IncompatibleError(f"{name} with {item.label}", reason)
