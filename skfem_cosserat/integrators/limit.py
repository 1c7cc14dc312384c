"""Largest stable step of explicit schemes, element by element."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..beam import Beam
from ..errors import InputError
from ..kernels import bilinear, null_space_blocks
from ..model import System
from ..model.groups import BeamGroup
from ..types import Array, Floats

__all__ = ["StepLimit", "element_limits", "step_limit"]

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


def element_limits(system: System) -> list[Floats]:
    """Largest stable step (ne,) in s of every element of each beam group, about the reference.

    ``2/omega`` of the highest frequency of an element on its own share of the lumped mass: no
    frequency of any mesh of such elements is above the highest of these, whatever is attached to
    it or holds it. Stresses are left out; they change the highest frequencies little.
    """
    y = system.extend(system.q0, 0.0)
    return [2 / np.sqrt(np.linalg.eigvalsh(_pencil(g, y)[0])[:, -1]) for g in system.beam_groups]


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
    for beam in (item for item in system.structures if isinstance(item, Beam)):
        ids = group.slices.get(id(beam), slice(0, 0))
        if ids.start <= e < ids.stop:
            return f"element {e - ids.start} of {beam.label}"
    raise InputError("element", f"{e} is of no beam")


def _pencil(group: BeamGroup, y: Array) -> tuple[Floats, Floats, Floats]:
    """``L^-1 K L^-T`` (ne, k, k), strains by twists (ne, 6 ng, k), and L with ``M = L L^T``.

    In velocities and angular velocities of the nodes, k = 6 nn.
    """
    eps, B = group.strain(y)
    ne, nn = group.vertices.shape
    frames = y[group.rows].reshape(ne * nn, 4, 3)
    P = null_space_blocks(frames[:, 1:]).reshape(ne, nn, 12, 6)
    by_twist = np.einsum("esac,each->esah", B.reshape(ne, -1, nn, 12), P)
    by_twist = by_twist.reshape(ne, -1, 6 * nn)
    K = bilinear(group.moduli(eps), by_twist, by_twist)
    mass = group.mass.reshape(ne, nn, 12, nn, 12)
    M = np.einsum("each,eacbd,ebdk->eahbk", P, mass, P).reshape(ne, 6 * nn, 6 * nn)
    root: Floats = np.asarray(np.linalg.cholesky(M), dtype=float)
    half = np.linalg.solve(root, K)
    A: Floats = np.asarray(np.linalg.solve(root, half.transpose(0, 2, 1)), dtype=float)
    return A, by_twist, root
