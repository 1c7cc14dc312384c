"""Largest stable step of the explicit schemes, by the frequencies of elements and springs."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_matrix, identity, kron

from ..errors import IncompatibleError
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
        H, pairs = self._nodes.by_coordinates(half, system.n), system.couplings.pairs
        stiffness, damping = (
            _sparse(pairs, blocks(y, taut=True), system.n)
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


def _sparse(pairs: IndexArray, blocks: Floats, size: int) -> csr_matrix:
    """Matrix of 3x3 blocks at pairs (k, 2) of rows of y."""
    xyz = np.arange(3)
    i, j = np.broadcast_arrays(3 * pairs[:, :1, None] + xyz[:, None], 3 * pairs[:, 1:, None] + xyz)
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
