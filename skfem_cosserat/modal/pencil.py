"""Mass, damping and stiffness of small vibrations about a state of rest."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.sparse import csr_matrix, identity, kron

from ..diagnostics.tangent import blocks_matrix, curvature_matrix
from ..errors import InputError
from ..kernels import skew
from ..model import System
from ..model.balance import balance_tangent
from ..types import Array, Floats
from .state import Equilibrium

__all__ = ["Pencil", "make_pencil"]

EPS = float(np.finfo(float).eps)
#: relative difference between a matrix and its transpose that is more than rounding
SYMMETRIC = 1e-12
#: what counts as rounding, in units of it
NOISE = 100.0
#: the same for energies of beams: what the rounding of K leaves after a Rayleigh-Ritz step
FAINT = 1e-9


@dataclass(eq=False)
class Pencil:
    """``M u'' + C u' + K u = 0``, with ``dq = P u``.

    From Lagrange's equations of ``q = F(u)`` in a frame that turns with Omega: kinetic energy
    ``1/2 |P u' + Omega x q|^2_M``. The terms linear in u' give ``2 P^T M Omega^ P``, in which the
    derivatives of P cancel; those without u' are the potential of the centrifugal force. So about
    a state of rest it does not matter that P moves, but for the constraint forces in K.

    Attributes
    ----------
    at : Equilibrium
    K : (u, u) csr_matrix
        Stiffness; symmetric if `conservative`.
    M : (u, u) csr_matrix
    gyroscopic : (u, u) csr_matrix or None
        Skew.
    damping : (u, u) csr_matrix or None
        Symmetric.
    rest, rest_size : (u, u) csr_matrix
        K without the material stiffness of beams, and the sums of the moduli of its terms.
    conservative : bool
    """

    at: Equilibrium
    K: csr_matrix
    M: csr_matrix
    gyroscopic: csr_matrix | None
    damping: csr_matrix | None
    rest: csr_matrix
    rest_size: csr_matrix
    conservative: bool

    @property
    def simple(self) -> bool:
        """Whether squares of frequencies are eigenvalues of symmetric K and M."""
        return self.conservative and self.gyroscopic is None and self.damping is None

    @property
    def C(self) -> csr_matrix:
        """All terms by velocity."""
        out = csr_matrix(self.K.shape)
        for part in (self.gyroscopic, self.damping):
            if part is not None:
                out = out + part
        return out

    @cached_property
    def _size(self) -> csr_matrix:
        return abs(self.K)

    def force(self, x: Floats) -> Floats:
        """``K x`` (u,) for a vector, with strains differentiated first, see :meth:`energies`."""
        system, tangent = self.at.system, self.at.tangent
        dq = tangent.P @ x
        nodal = np.zeros(system.n)
        beams = zip(system.beam_groups, tangent.balance.Bs, self.at.moduli, strict=True)
        for group, B, D in beams:
            strain = (B @ dq[group.dofs][:, :, None]).reshape(len(B), -1, 6)
            local = group.force(B, group.linear_stress(D, strain))
            np.add.at(nodal, group.dofs, local)
        return np.asarray(tangent.P.T @ nodal + self.rest @ x)

    def energies(self, X: Array) -> tuple[Array, Floats]:
        """``X^H K X`` (k, k), and what rounding can make of its diagonal (k,).

        The strains of beams are differentiated first and squared then: stretching and shear, much
        stiffer than bending, cancel in strains of order one and not in energies. So frequencies
        keep their digits at any slenderness, and rigid motions have no energy at all.
        """
        system, tangent = self.at.system, self.at.tangent
        out = X.conj().T @ (self.rest @ X)
        noise = NOISE * EPS * np.einsum("ik,ik->k", abs(X), self.rest_size @ abs(X))
        metric = np.einsum("ik,ik->k", abs(X), abs(tangent.metric) @ abs(X))
        noise += self.at.error * metric
        noise += FAINT * EPS * np.einsum("ik,ik->k", abs(X), self._size @ abs(X))
        dq = tangent.P @ X
        beams = zip(system.beam_groups, tangent.balance.Bs, self.at.moduli, strict=True)
        for group, B, D in beams:
            local = dq[group.dofs]
            ne, ng = len(B), len(group.elements.points)
            strain = (B @ local).reshape(ne, ng, 6, -1)
            out = out + np.einsum("egik,egil->kl", strain.conj(), D @ strain, optimize=True)
            lost = NOISE * EPS * (abs(B) @ abs(local)).reshape(ne, ng, 6, -1)
            noise += np.einsum("egik,egik->k", lost, abs(D) @ lost, optimize=True)
        return out, noise


def make_pencil(at: Equilibrium) -> Pencil:
    """Matrices about an equilibrium.

    Raises
    ------
    InputError
        If a motion has no inertia.
    """
    system, tangent = at.system, at.tangent
    P, balance = tangent.P, tangent.balance
    still = replace(balance, Bs=[np.zeros_like(B) for B in balance.Bs])
    blocks = balance_tangent(system, still, at.amplitudes)
    curved = curvature_matrix(system, balance.y, tangent.multipliers)
    rest = blocks_matrix(system, blocks) + curved
    rest_size = blocks_matrix(system, [abs(block) for block in blocks]) + abs(curved)
    rest_size = (abs(P).T @ rest_size @ abs(P)).tocsr()
    rest = (P.T @ rest @ P).tocsr()
    K = tangent.K
    size = float(abs(rest).max()) if rest.nnz else 0.0
    conservative = bool(abs(rest - rest.T).max() <= SYMMETRIC * size) if size else True
    if conservative:
        K, rest = (0.5 * (A + A.T) for A in (K, rest))
    mass = kron(system.mass, identity(3))
    M = P.T @ mass @ P
    M = (0.5 * (M + M.T)).tocsr()
    _check_inertia(system, M, tangent.metric)
    gyroscopic = None
    if at.amplitudes.spin is not None:
        turning = kron(system.mass, skew(at.amplitudes.spin.velocity))
        G = P.T @ turning @ P
        gyroscopic = (G - G.T).tocsr()
        if not gyroscopic.count_nonzero():
            gyroscopic = None
    return Pencil(
        at,
        K.tocsr(),
        M,
        gyroscopic,
        _damping(system, balance.y, P, balance.Bs),
        rest.tocsr(),
        rest_size,
        conservative,
    )


def _damping(system: System, y: Floats, P: csr_matrix, Bs: list[Array]) -> csr_matrix | None:
    """Viscous sections, drag, dampers."""
    blocks = system.mass_tangent(0.0)
    for k, (group, B) in enumerate(zip(system.beam_groups, Bs, strict=True)):
        if group.viscous:
            blocks[k] += group.damping(B)
    for block, each in zip(blocks, system.groups, strict=True):
        if each.drag is not None:
            block += each.drag
    if system.couplings.count:
        blocks.append(system.couplings.damping(y))
    if not any(block.any() for block in blocks):
        return None
    C = P.T @ blocks_matrix(system, blocks) @ P
    return (0.5 * (C + C.T)).tocsr()


def _check_inertia(system: System, M: csr_matrix, metric: csr_matrix) -> None:
    inertia = M.diagonal() / metric.diagonal()
    worst = int(np.argmin(inertia))
    if not inertia[worst] > 0:
        if len(system.closure.rows):
            raise InputError("model", f"unknown {worst} of the null space has no inertia")
        coordinate = system.kinematics.tree.coordinates[worst]
        raise InputError(
            system.owner[coordinate.vertex].label,
            f"its motion {coordinate.kind!r} has no inertia: give it mass",
        )
