"""Stiffness of a scene along its constraints: what decides on stability and small vibrations."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix, csr_matrix, diags

from ..constraints.rowspace import RowSpace
from ..model import System
from ..model.balance import Amplitudes, Balance, balance, balance_tangent
from ..model.loops import null_space_matrix
from ..types import Array, Floats

__all__ = [
    "ReducedTangent",
    "balancing_multipliers",
    "blocks_matrix",
    "curvature_matrix",
    "material_stiffness",
    "null_space_matrix",
    "reduced_tangent",
]


@dataclass(eq=False)
class ReducedTangent:
    """Stiffness along the constraints at one configuration.

    Attributes
    ----------
    K : (unknowns, unknowns) csr_matrix
        ``P^T (dR/dy + sum_k lambda_k H_k) P``: at an equilibrium the derivative of ``P^T R`` along
        the constraints, for conservative forces the second derivative of the potential, and then
        symmetric (to rounding).
    P : (n, unknowns) csr_matrix
        Null space matrix, ``G P = 0``.
    multipliers : (m,) array
        Lambda of least norm with ``G^T lambda = -R``.
    balance : Balance
        Forces at the configuration.
    metric : (unknowns, unknowns) csr_matrix
        ``P^T diag(w) P``, w = 1/length^2 for positions and 1/2 for directors: size of a motion
        without units, that of a turn by an angle being the angle.
    """

    K: csr_matrix
    P: csr_matrix
    multipliers: Floats
    balance: Balance
    metric: csr_matrix

    @property
    def residual(self) -> Floats:
        """``P^T R`` (unknowns,): zero at an equilibrium."""
        return np.asarray(self.P.T @ self.balance.R.ravel())


def reduced_tangent(
    system: System, y: Floats, amplitudes: Amplitudes, at: Balance | None = None
) -> ReducedTangent:
    """Tangent stiffness along the constraints, at an equilibrium.

    Parameters
    ----------
    system : System
    y : (total, 3) array
        All rows of the configuration, from :meth:`System.extend`.
    amplitudes : Amplitudes
        Of loads and actuators, with the spin of a turning frame.
    at : Balance, optional
        Forces at y, if they are known already: with the full turns of springs on angles.

    Raises
    ------
    SingularMatrixError
        In a configuration where independent constraint rows become dependent.

    Notes
    -----
    Along the constraints ``d(P^T R) = P^T dR + dP^T R``, and with ``R = -G^T lambda`` the second
    term is ``P^T (sum_k lambda_k H_k) P du``, H_k the second derivative of constraint k. It needs
    no derivative of P, and where rows are redundant any lambda that balances R will do.

    Examples
    --------
    A pendulum of 2 kg and 1 m, hanging: both swings have the stiffness m g l = 20 N m.

    >>> from skfem_cosserat import JointDistance, LoadGravity, MassPoint, Model, ground
    >>> from skfem_cosserat.model.balance import amplitudes_at
    >>> model = Model()
    >>> bob = model.add("bob", MassPoint(2.0, position=(0, 0, -1)))
    >>> rod = model.add("rod", JointDistance(ground((0, 0, 0)), bob.place()))
    >>> weight = model.add("weight", LoadGravity((0, 0, -10.0)))
    >>> system = model.freeze()
    >>> y = system.extend(system.q0, 0.0)
    >>> reduced_tangent(system, y, amplitudes_at(system, 0.0)).K.toarray().round(9).tolist()
    [[20.0, 0.0], [0.0, 20.0]]
    """
    if at is None:
        at = balance(system, y, amplitudes)
    multipliers = balancing_multipliers(system, y, at.R.ravel())
    P = null_space_matrix(system, y)
    A = blocks_matrix(system, balance_tangent(system, at, amplitudes))
    A = A + curvature_matrix(system, y, multipliers)
    weights = np.full((system.rows, 3), 0.5)
    weights[system.origin_rows] = 1 / system.length**2
    metric = (P.T @ diags(weights.ravel()) @ P).tocsr()
    return ReducedTangent((P.T @ A @ P).tocsr(), P, multipliers, at, metric)


def balancing_multipliers(system: System, y: Floats, R: Floats) -> Floats:
    """Lambda (m,) of least norm with ``G^T lambda = -R`` for a balance R (n,).

    Once refined, as the equations are squared ones.
    """
    if not system.m:
        return np.zeros(0)
    rows, G = RowSpace(system, y), system.constraints.jacobian(y)
    out = rows.multipliers(-R)
    return np.asarray(out + rows.multipliers(-R - G.T @ out))


def blocks_matrix(system: System, blocks: list[Array]) -> csr_matrix:
    """Blocks of the system's groups, then of its couplings if any, as a matrix (n, n)."""
    rows, cols, values = [], [], []
    for group, block in zip(system.groups, blocks, strict=False):
        dofs = group.dofs
        rows.append(np.broadcast_to(dofs[:, :, None], block.shape).ravel())
        cols.append(np.broadcast_to(dofs[:, None, :], block.shape).ravel())
        values.append(block.ravel())
    if len(blocks) > len(system.groups):
        xyz, block = np.arange(3), blocks[-1]
        a, b = (3 * system.couplings.pairs[:, k, None, None] for k in (0, 1))
        rows.append(np.broadcast_to(a + xyz[:, None], block.shape).ravel())
        cols.append(np.broadcast_to(b + xyz, block.shape).ravel())
        values.append(block.ravel())
    shape = (system.n, system.n)
    if not values:
        return csr_matrix(shape)
    ij = (np.concatenate(rows), np.concatenate(cols))
    return coo_matrix((np.concatenate(values), ij), shape=shape).tocsr()


def curvature_matrix(system: System, y: Floats, multipliers: Floats) -> csr_matrix:
    """``sum_k lambda_k H_k`` (n, n), H_k the second derivative of constraint k."""
    c = system.constraints
    ij = (c.curvature_rows, c.curvature_cols)
    values = c.curvature_values(multipliers, y)
    return coo_matrix((values, ij), shape=(system.n, system.n)).tocsr()


def material_stiffness(system: System, y: Floats) -> csr_matrix:
    """Stiffness (n, n) of all beams at configuration y, as if there were no stresses."""
    blocks = system.mass_tangent(0.0)
    for k, (group, (eps, B)) in enumerate(zip(system.beam_groups, system.strain(y), strict=True)):
        blocks[k] = group.tangent(B, B, np.zeros_like(eps), 1.0, 0.0, group.moduli(eps))
    return blocks_matrix(system, blocks)
