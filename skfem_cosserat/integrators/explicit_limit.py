"""Largest stable step of the explicit schemes, by the frequencies of elements and springs."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_matrix, identity, kron

from ..errors import IncompatibleError, InputError
from ..frames import is_beam
from ..kernels import BeamElements, beam_moduli, beam_strain, bilinear, null_space_blocks
from ..model import System
from ..model.groups import BeamGroup
from ..types import Array, Floats, IndexArray
from .explicit_nodes import checked_nodes

#: growth of the rotation between neighbouring nodes (rad), change of the places that force elements
#: act on (of directors, and by the extent of the scene), after which limits are looked at again:
#: they fall by some 2 % meanwhile
GROWN = 0.02
#: who minds what has no limit
LIMIT = "step limit of explicit schemes"
#: what vibrates, by components of strains
KINDS = ("shear", "shear", "axial", "bending", "bending", "torsion")


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
    def _together(self) -> list[Floats]:
        pairs = zip(self.system.beam_groups, self.own, strict=True)
        return [own + self.attached[:, g.vertices].max(2) for g, own in pairs]

    @property
    def decay(self) -> float:
        """Highest rate of decay, that of elements and of what is attached (1/s)."""
        each = [float(own[1].max()) for own in self.own]
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
    return 2 * np.arcsin(np.sqrt(np.minimum(square / 8, 1.0)))


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
