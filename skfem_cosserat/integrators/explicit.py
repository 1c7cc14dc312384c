"""The explicit variational scheme: elements kick their nodes, which drift as free rigid bodies.

A node has a momentum P and an angular momentum L in space about its point phi, kept together as
``m`` (nodes, 2, 3). Between two kicks both are constant but for the way of phi, unless joints hold
the node. A step of the run has equal *rounds*, at whose ends all elements, loads and force elements
kick by halves.

Rows of y are those of the system and a last one of zeros, which stands for the directors that mass
points do not have.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_matrix, identity, kron

from ..constraints import Multipliers, Treatment
from ..constraints.base import pair_numbers
from ..errors import AccuracyWarning, Diverged, IncompatibleError, InputError
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
from ..model import Model, System, system_of
from ..model.balance import Amplitudes, external_force
from ..model.force_elements import CoupledForce, CoupledStart
from ..model.groups import BeamGroup
from ..pattern import dense_blocks
from ..types import SAME, TOLERANCE, Array, Floats, IndexArray, largest, switch, whole
from ..warn import logger, warn
from .base import Integrator
from .called_back import trapezoidal_work
from .scheme import State, StepWork

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
        x = y.take(self.rows, 0)
        P = m[self.number, 0]
        spin = m[self.number, 1]
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
        turn = np.eye(3)
        _, rest, along = dt * self._speeds
        for axis, rates in ((1, rest), (2, along), (1, rest)):
            angles = np.outer(rates * spin[:, axis, 0], np.eye(3)[axis])
            each = rotation_matrix(exp_quaternion(-angles))
            spin = each @ spin
            turn = each @ turn
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

    def __init__(self, system: System, bodies: Bodies):
        self._constraints = system.constraints
        first = system.internal
        ends = np.array([(jr.a.vertex, jr.b.vertex) for jr in system.joint_rows], np.int64)
        self.bodies = bodies.taken(np.intersect1d(ends, bodies.number))
        place = np.zeros(system.total + 1, np.int64)
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
                return np.linalg.solve(S, rates)
            except np.linalg.LinAlgError as error:
                raise Unclosed("joints have come to a dead point", np.inf) from error

        return G, twists, impulses

    def drift(self, y: Floats, m: Floats, dt: float) -> int:
        """Move nodes so that the joints are closed at the end, in place; gives iterations.

        With impulses along the gradients at the start.
        """
        rows = self.bodies.rows
        v = self.bodies.number
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

    def __init__(self, system: System):
        framed = system.is_frame
        count = len(system.origin_rows)
        rows = np.full((count, 4), system.total)
        rows[:, 0] = system.origin_rows
        rows[framed] = system.origin_rows[framed, None] + np.arange(4)
        self._framed = rows[framed]
        mass = system.mass.tocsr(copy=True)
        mass.resize(system.total + 1, system.total + 1)
        matrix = dense_blocks(mass, rows)
        whole = matrix[:, 0, 0]
        centre = matrix[:, 0, 1:] / matrix[:, :1, 0]
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
        own = every[self.bodies.rows]
        own[:, 1] = director_force(y[self.bodies.rows[:, 1:]], own[:, 1:])
        return own[:, :2]

    def velocities(self, y: Floats) -> Callable[[Floats], Floats]:
        """Function that gives the velocities of all rows of y for momenta."""
        P, M = self.bodies.by_twists(y)

        def rates(m: Floats) -> Floats:
            out = np.zeros_like(y)
            # times the inverse would lose a little in each step, always the same way
            out[self.bodies.rows] = (P @ np.linalg.solve(M, m.reshape(-1, 6, 1))).reshape(-1, 4, 3)
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
        raise IncompatibleError(f"{name} with {system.owner[slim[0]].label}", reason)
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

    def __init__(self, system: System):
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
        if not max(*grown, moved.max(initial=0.0), 0.0) > GROWN:
            return False
        self._seen, new = y.copy(), self._looked_at(y)
        self._turned = [np.maximum(*both) for both in zip(self._turned, turned, strict=True)]
        fallen = any((b > a).any() for a, b in zip(self.rates, new, strict=True))
        self.rates = [np.maximum(*both) for both in zip(self.rates, new, strict=True)]
        return fallen

    @property
    def smallest(self) -> StepLimit:
        """The lowest limit, and what vibrates there."""
        groups = self.system.beam_groups
        *elements, attached = self.rates
        pairs = zip(groups, elements, strict=True)
        every = [*(rates + attached[:, g.vertices].max(2) for g, rates in pairs), attached]
        with np.errstate(divide="ignore"):
            seconds = [np.minimum(2 / np.sqrt(square), 2 / gamma) for square, gamma in every]
        number = np.argmin([each.min() for each in seconds])
        e = seconds[number].argmin()
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
        kind = KINDS[(shares @ SAME_KIND).argmax()]
        turning = float((x.reshape(-1, 2, 3)[:, 1] ** 2).sum())  # x has length one
        return "shear with rotary inertia" if kind == "shear" and turning > 0.5 else kind


def _circles(matrix: csr_matrix) -> Floats:
    """Bounds (k,) with ``x . A x <= sum_k bound_k |x_k|^2`` of symmetric blocks of six rows."""
    blocks = (0.5 * (matrix + matrix.T)).tobsr((6, 6))
    rows = np.arange(matrix.shape[0] // 6).repeat(np.diff(blocks.indptr))
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
    q = y[group.rows].reshape(len(group.rows), -1)
    elements = group.elements
    eps, B = beam_strain(elements, q)
    P = null_space_blocks(q.reshape(len(q), -1, 4, 3)[:, :, 1:])
    M = P.transpose(0, 2, 1) @ group.mass @ P
    return elements, eps, B @ P, np.asarray(np.linalg.cholesky(M), float)


def _reduced(weighted: Floats, B: Floats, root: Floats) -> Floats:
    """``L^-1 (int B^T D B ds) L^-T`` (ne, k, k)."""
    return np.linalg.solve(root, np.linalg.solve(root, bilinear(weighted, B, B)).transpose(0, 2, 1))


def _rates(group: BeamGroup, y: Array) -> Floats:
    """Squares of the highest frequencies and rates of decay (2, ne) of elements."""
    elements, eps, B, root = _by_twist(group, y)
    out = np.zeros((2, len(eps)))
    moduli = beam_moduli(elements, eps)
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


#: steps above a limit that has fallen by as much are not made shorter: the bound is not that sharp
NEAR = 0.01
#: way of a node in a step, by the extent of the scene, above which a run has blown up
FAR = 100.0


# -- what explicit steps cannot do -----------------------------------------------------------------


def _refused(system: System, treatment: Treatment) -> Iterator[tuple[str, str]]:
    """Parts of a scene and of a treatment that explicit schemes cannot do, and why."""
    if not (isinstance(treatment, Multipliers) and treatment.scaled):
        reason = "joints are closed by projection, nothing is eliminated and no matrix scaled"
        yield repr(treatment), f"take Multipliers(): {reason}"
    if system.plane is not None:
        yield repr(system.plane), "explicit steps move all nodes in space: freeze it without"
    for item in system.structures:
        if is_beam(item) and item.theory.held:
            yield f"the {item.theory!r} of {item.label}", "strains are held by implicit steps only"
    for label in [drive.label for drive in system.drives] + ["moving ground"] * bool(system.moving):
        yield label, "motion is not prescribed in explicit steps"
    if len(system.closure.rows):
        names = sorted(system.redundancies()) or ["a closed loop of joints"]
        yield f"closed loops ({names[0]})", "joints have to form a tree"


# -- march -----------------------------------------------------------------------------------------


class Ends(NamedTuple):
    """Forces at an end of a round.

    Attributes
    ----------
    elements : ((rows, 3) array, float)
        Their forces, and the power that they lose (W).
    loads, force : (rows, 3) array
        Loads, and the sum of all forces.
    power : float
        That is lost in elements, dampers and drag (W).
    coupled : CoupledForce or None
        Of force elements.
    """

    elements: tuple[Floats, float]
    loads: Floats
    force: Floats
    power: float
    coupled: CoupledForce | None


class Marching:
    """Marches a system.

    Forces that depend on velocities take that between both halves of a kick, found by fixed-point
    iteration: the first half ends with it, the second one starts from it, so that a kick, and with
    it a round, is symmetric in time. Joints hold this velocity, too.

    Parameters
    ----------
    scheme : Explicit
        Says how many rounds there are.
    system : System
    h : float
        Step of the run (s).
    watch : LimitWatch

    Attributes
    ----------
    method : str
    rounds : int
        Equal parts of a step.
    shortened : bool
        Whether there have been more of them since the start.
    """

    def __init__(self, scheme: Explicit, system: System, h: float, watch: LimitWatch):
        self.system, self.h, self.method = system, h, f"explicit, limit {watch.smallest}"
        self._scheme, self._watch, self.nodes = scheme, watch, Nodes(system)
        self.shortened = False
        couplings = system.couplings
        viscous = any(c.damping.any() for c in couplings.items) or bool(couplings.own)
        self._viscous = viscous or system.damped
        #: q and p of the last state, and forces of elements there
        self._last: tuple[Floats, Floats, tuple[Floats, float]] | None = None
        self.rounds = 0
        self._divide()

    def _divide(self) -> bool:
        """Take as many rounds as the limits ask for; whether there are others than before."""
        rounds = self._scheme.rounds
        if self._scheme.checked:
            rounds = max(rounds, int(np.ceil(self.h / self._watch.smallest.seconds * (1 - NEAR))))
        if rounds == self.rounds:
            return False
        self.rounds = rounds
        # changes shrink by -theta at most where theta is h gamma/2, by theta/(2 + theta) if relaxed
        self._relaxed = 1 / (1 + 0.25 * self.h / rounds * self._watch.decay)
        return True

    def _shorten(self, time: float) -> None:
        """Say that steps are shorter, where limits have fallen."""
        smallest = self._watch.smallest
        attached = smallest.kind in ("springs", "damping")
        what = "springs and dampers have moved" if attached else "elements are bent"
        to = f"{smallest.seconds:.3g} s of {smallest.where}"
        text = f"{what} so far that their limits fall, to {to}: shorter steps"
        if not self.shortened:
            warn(f"integrator {self._scheme.name!r}", text, AccuracyWarning, time)
        logger.debug("t = %.6g s: %s", time, text)
        self.shortened = True

    def advance(self, state: State, time: float) -> tuple[State, int, float, StepWork]:
        """The step after a state, to a time (s): its end, iterations, residual and work."""
        system = self.system
        y = np.concatenate([system.extend(state.q, state.time), np.zeros((1, 3))])
        if self._scheme.checked and self._watch.lowered(y[:-1]) and self._divide():
            self._shorten(state.time)
        m = self.nodes.momenta(y, state.p.reshape(-1, 3))
        try:
            with np.errstate(all="ignore"):  # what has blown up is looked at below
                new, work, iterations = self._rounds(state, y, m, time)
        except Unclosed as error:
            advice = f"try a smaller step than {self.h:g} s"
            what, gap = error.args
            raise Diverged(state.time, state.index + 1, gap, what, advice) from error
        way = largest(y[: system.rows] - state.q.reshape(-1, 3))
        if not (way < FAR * system.length and np.isfinite(m).all()):
            reason = f"the motion has blown up: nodes move by {way:.3g} m in a step"
            raise Diverged(state.time, state.index + 1, np.inf, reason, self.method)
        joints = self.nodes.joints
        return new, iterations, 0.0 if joints is None else largest(joints.gaps(y)), work

    def _rounds(
        self, state: State, y: Floats, m: Floats, time: float
    ) -> tuple[State, StepWork, int]:
        """All rounds of a step, in place."""
        system, h, turns = self.system, self.h / self.rounds, state.turns
        couplings, rows, iterations, works = system.couplings, system.rows, 0, []
        elements = None
        if self._last is not None and self._last[0] is state.q and self._last[1] is state.p:
            elements = self._last[2]
        for k in range(self.rounds):
            t0 = state.time + k * h
            y0 = y[:-1].copy()
            loads = Amplitudes(system.loading.averages(t0, t0 + h), np.zeros(0))
            start = couplings.begin(y0, turns, t0, h) if couplings.count else None
            rates = self._velocities(y)(m)
            own = self._elements(y)(rates) if elements is None else elements
            first = self._ends(y, rates, own, loads, start)
            m += 0.5 * h * self.nodes.momenta(y, first.force)
            drifts = self.nodes.drift(y, m, h)
            last, kicks = self._kick(y, m, h, loads, start)
            elements = last.elements
            iterations = max(iterations, drifts, kicks)
            moved = float(((first.loads + last.loads) * (y[:rows] - y0[:rows])).sum())
            works.append(StepWork(0.5 * moved, dissipated=0.5 * h * (first.power + last.power)))
            if start is not None and first.coupled is not None and last.coupled is not None:
                forces = first.coupled, last.coupled
                works.append(trapezoidal_work(couplings, (start, start), forces, y[:-1], rows))
                turns = couplings.turns(start, y[:-1], t0 + h)
        self.nodes.tidy(y)
        self.nodes.projection(y)(m)
        p = (system.mass @ self.nodes.velocities(y)(m)[:rows]).reshape(-1)
        new = State(time, state.index + 1, y[:rows].flatten(), p, fresh=False, turns=turns)
        assert elements is not None
        self._last = new.q, new.p, elements
        return new, StepWork(*np.sum(works, 0).tolist()), iterations

    def _elements(self, y: Floats) -> Callable[[Floats], tuple[Floats, float]]:
        """Forces (rows, 3) of elements by the rates of all rows, and the power that they lose."""
        system = self.system
        strains = [(group, *group.strain(y)) for group in system.beam_groups]
        elastic = [group.stress(eps) for group, eps, _ in strains]

        def at(rates: Floats) -> tuple[Floats, float]:
            stresses = list(elastic)
            power = 0.0
            for k, (group, _, B) in enumerate(strains):
                if group.viscous:
                    rate = group.strain_rate(B, rates)
                    stresses[k] = elastic[k] + group.viscous_stress(rate)
                    power += group.dissipation(rate)
            return -system.internal_force([B for *_, B in strains], stresses), power

        return at

    def _ends(
        self,
        y: Floats,
        rates: Floats,
        elements: tuple[Floats, float],
        amplitudes: Amplitudes,
        start: CoupledStart | None,
    ) -> Ends:
        """All forces at an end of a round, loads by their means over it."""
        system, (internal, power), coupled = self.system, elements, None
        loads = external_force(system, y[:-1], amplitudes)
        force = internal + loads
        v = rates[: system.rows]
        if start is not None:
            coupled = system.couplings.static(start, y[:-1], rates[:-1])
            force = force - coupled.force[: system.rows]
            power += sum(float(r.forces.dissipated.sum()) for r in coupled.responses)
        if system.drag is not None:
            drag = system.drag @ v
            force = force - drag
            power += max(0.0, float((v * drag).sum()))  # of either sign at rounding level
        return Ends(elements, loads, force, power, coupled)

    def _velocities(self, y: Floats) -> Callable[[Floats], Floats]:
        """Velocities of momenta; zero where nothing asks for them."""
        none = np.zeros_like(y)
        return self.nodes.velocities(y) if self._viscous else lambda _: none

    def _kick(
        self, y: Floats, m: Floats, h: float, loads: Amplitudes, start: CoupledStart | None
    ) -> tuple[Ends, int]:
        """Kick by one half, in place, such that the velocity is that after it."""
        elements = self._elements(y)
        velocities = self._velocities(y)

        def kicked(at: Floats) -> tuple[Ends, Floats]:
            rates = velocities(at)
            ends = self._ends(y, rates, elements(rates), loads, start)
            return ends, m + 0.5 * h * self.nodes.momenta(y, ends.force)

        ends, after = kicked(m)
        if not self._viscous:
            m[:] = after
            return ends, 0
        project = self.nodes.projection(y)
        last = np.inf
        for k in range(1, ITERATIONS + 1):
            project(after)
            ends, new = kicked(after)
            change = new - after
            project(change)
            size = np.maximum(abs(after).max((0, 2), initial=0.0), 1e-300)
            left = float((abs(change).max((0, 2), initial=0.0) / size).max())
            # what does not become less any more is accepted, if it is little
            if left <= SAME or 0.5 * last < left <= TOLERANCE:
                m[:] = after + change
                return ends, k
            after = after + self._relaxed * change
            last = left
        raise Unclosed("the velocity that dampers leave after a kick was not found", last)


# -- scheme ----------------------------------------------------------------------------------------


class Explicit(Integrator):
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
    There are no compiled kernels. Constraint forces are those of the continuous equations at the
    recorded states. Kick and drift: Verlet's method; joints: Leimkuhler & Reich, Simulating
    Hamiltonian dynamics (2004), ch. 7, 8.

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

    def __init__(self, rounds: int = 1, checked: bool = True):
        self.rounds = whole("argument rounds", rounds, 1)
        self.checked = switch("argument checked", checked)

    def __repr__(self) -> str:
        return f"Explicit(rounds={self.rounds}{'' if self.checked else ', checked=False'})"

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

    def march(self, system: System, treatment: Treatment, h: float) -> Marching:
        """Explicit steps of size h (s), after checks of scene, treatment and step size."""
        for what, reason in _refused(system, treatment):
            raise IncompatibleError(f"{self!r} with {what}", reason)
        check_lumped(repr(self), system)
        checked_nodes(repr(self), system)
        watch = LimitWatch(system)
        limit = watch.smallest
        if self.checked and h / self.rounds > limit.seconds:
            raise InputError(
                "argument step",
                f"{h:g} s in {self.rounds} rounds is above the limit of the explicit scheme,"
                f" {limit}: at least rounds={int(np.ceil(h / limit.seconds))}, or a smaller step",
            )
        logger.info("explicit steps of %.3g s, limit %s", h / self.rounds, limit)
        return Marching(self, system, h, watch)
