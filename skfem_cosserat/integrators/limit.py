"""Largest stable step of explicit schemes, element by element, and how it falls in a run."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..errors import IncompatibleError, InputError
from ..kernels import bilinear, null_space_blocks
from ..kinds import is_beam
from ..model import System
from ..model.groups import BeamGroup
from ..types import Array, Floats, IndexArray, check_kind

__all__ = ["FROZEN", "LimitWatch", "StepLimit", "check_lumped", "element_limits", "step_limit"]

#: growth of the rotation between two neighbouring nodes (rad) after which limits are looked at
#: again: they fall by some 2 % meanwhile
_GROWN = 0.02
#: where a system comes from
FROZEN = ", as model.freeze() makes it"
_KINDS = ("shear", "shear", "axial", "bending", "bending", "torsion")


class StepLimit(NamedTuple):
    """Step up to which an explicit scheme is stable, and what sets it.

    Attributes
    ----------
    seconds : float
        Infinite without beams.
    where : str
        Beam and element.
    kind : str
        What vibrates there: "axial", "shear", "bending" or "torsion", "with rotary inertia" if
        most of the kinetic energy is that of turning nodes.

    Examples
    --------
    >>> from skfem_cosserat import Beam, Material, MeshCurve, Model, SectionCircle
    >>> mesh = MeshCurve.init_line((0, 0, 0), (1, 0, 0), 10)
    >>> section = SectionCircle(0.2, Material(210e9, 0.3, 7850.0))
    >>> model = Model()
    >>> bar = model.add("bar", Beam(mesh, section, director=(0, 1, 0), lumped=True))
    >>> seconds = step_limit(model.freeze()).seconds  # length by speed of axial waves
    >>> bool(abs(seconds / (0.1 / (210e9 / 7850) ** 0.5) - 1) < 1e-12)
    True
    """

    seconds: float
    where: str = "no beam"
    kind: str = "none"

    def __str__(self) -> str:
        return f"{self.seconds:.3g} s ({self.where}: {self.kind})"


def check_lumped(name: str, system: System) -> None:
    """Raise IncompatibleError if the mass matrix of a beam couples nodes; `name`: who minds."""
    check_kind("argument system", system, System, FROZEN)
    for item in system.structures:
        if is_beam(item) and not item.lumped:
            reason = "its mass matrix couples nodes: Beam(..., lumped=True) does not"
            raise IncompatibleError(f"{name} with {item.label}", reason)


def element_limits(system: System) -> list[Floats]:
    """Largest stable step (ne,) in s of every element of each beam group, about the reference.

    ``2/omega`` of the highest frequency of an element on its own share of the lumped mass: no
    frequency of any mesh of such elements is above the highest of these, whatever is attached to
    it or holds it. Stresses are left out; they change the highest frequencies little.

    Raises
    ------
    InputError
        If it is no system.
    IncompatibleError
        If the mass of a beam is not lumped.
    """
    check_lumped("step limit of explicit schemes", system)
    y = system.extend(system.q0, 0.0)
    return [_limits(group, y) for group in system.beam_groups]


def _limits(group: BeamGroup, y: Array, ids: IndexArray | None = None) -> Floats:
    return np.asarray(2 / np.sqrt(np.linalg.eigvalsh(_pencil(group, y, ids)[0])[:, -1]))


class LimitWatch:
    """Limits of the elements of a run: about the reference first, lower where elements fold.

    Where neighbouring nodes turn against each other, an element may vibrate faster than in the
    reference: one of a flat strip that is shorter than wide by 1.4 times when twisted by 0.5 rad,
    one that is folded by 1.2 rad by a fifth. A step just below its limit is above it then.

    Attributes
    ----------
    limits : list of (ne,) arrays
        Smallest so far (s), for each beam group.
    """

    def __init__(self, system: System) -> None:
        self.system = system
        self.limits = element_limits(system)
        y = system.extend(system.q0, 0.0)
        self._seen = [_turns(g, y) for g in system.beam_groups]

    def lowered(self, y: Array) -> bool:
        """Look at the elements that have bent farther; whether a limit has fallen."""
        fallen = False
        for k, group in enumerate(self.system.beam_groups):
            turned = _turns(group, y)
            ids = np.flatnonzero(turned > self._seen[k] + _GROWN)
            if len(ids):
                self._seen[k][ids] = turned[ids]
                before = self.limits[k][ids]
                self.limits[k][ids] = np.minimum(before, _limits(group, y, ids))
                fallen |= bool((self.limits[k][ids] < before).any())
        return fallen

    @property
    def smallest(self) -> str:
        """The lowest limit, in words."""
        k = int(np.argmin([each.min() for each in self.limits]))
        e = int(self.limits[k].argmin())
        return f"{self.limits[k][e]:.3g} s of {_named(self.system, self.system.beam_groups[k], e)}"


def _turns(group: BeamGroup, y: Array) -> Floats:
    """Largest rotation (ne,) between neighbouring nodes of each element (rad)."""
    D = y[group.rows].reshape(*group.vertices.shape, 4, 3)[:, :, 1:]
    square = ((D[:, 1:] - D[:, :-1]) ** 2).sum((2, 3)).max(1)  # 8 sin^2 of half the angle
    return np.asarray(2 * np.arcsin(np.sqrt(np.minimum(square / 8, 1.0))))


def step_limit(system: System) -> StepLimit:
    """The smallest of :func:`element_limits`, its element, and what vibrates there."""
    limits = element_limits(system)
    if not limits:
        return StepLimit(np.inf)
    number = int(np.argmin([each.min() for each in limits]))
    group, e = system.beam_groups[number], int(limits[number].argmin())
    A, B, root = _pencil(group, system.extend(system.q0, 0.0))
    x = np.linalg.eigh(A[e])[1][:, -1]
    twist = np.linalg.solve(root[e].T, x)
    eps = (B[e] @ twist).reshape(-1, 6)
    shares = (eps * (group.elements.weighted_stiffness[e] @ eps[:, :, None])[:, :, 0]).sum(0)
    kinds = dict.fromkeys(_KINDS, 0.0)
    for kind, share in zip(_KINDS, shares, strict=True):
        kinds[kind] += float(share)
    kind = max(kinds, key=lambda name: kinds[name])
    turning = float((x.reshape(-1, 2, 3)[:, 1] ** 2).sum())  # x has length one
    if kind == "shear" and turning > 0.5:
        kind = "shear with rotary inertia"
    return StepLimit(float(limits[number][e]), _named(system, group, e), kind)


def _named(system: System, group: BeamGroup, e: int) -> str:
    for beam in (item for item in system.structures if is_beam(item)):
        ids = group.slices.get(id(beam), slice(0, 0))
        if ids.start <= e < ids.stop:
            return f"element {e - ids.start} of {beam.label}"
    raise InputError("element", f"{e} is of no beam")


def _pencil(
    group: BeamGroup, y: Array, ids: IndexArray | None = None
) -> tuple[Floats, Floats, Floats]:
    """``L^-1 K L^-T`` (ne, k, k), strains by twists (ne, 6 ng, k), and L with ``M = L L^T``.

    In velocities and angular velocities of the nodes, k = 6 nn; of elements `ids` or all.
    """
    ids = np.arange(len(group.vertices)) if ids is None else ids
    eps, B = group.strain(y)
    B, D = B[ids], group.moduli(eps)[ids]
    ne, nn = len(ids), group.vertices.shape[1]
    frames = y[group.rows[ids]].reshape(ne * nn, 4, 3)
    P = null_space_blocks(frames[:, 1:]).reshape(ne, nn, 12, 6)
    by_twist = np.einsum("esac,each->esah", B.reshape(ne, -1, nn, 12), P)
    by_twist = by_twist.reshape(ne, -1, 6 * nn)
    K = bilinear(D, by_twist, by_twist)
    mass = group.mass[ids].reshape(ne, nn, 12, nn, 12)
    M = np.einsum("each,eacbd,ebdk->eahbk", P, mass, P).reshape(ne, 6 * nn, 6 * nn)
    root: Floats = np.asarray(np.linalg.cholesky(M), dtype=float)
    half = np.linalg.solve(root, K)
    A: Floats = np.asarray(np.linalg.solve(root, half.transpose(0, 2, 1)), dtype=float)
    return A, by_twist, root
