"""Velocities on the hidden constraints by conjugate gradients, for large lattices.

What elimination along chains and trees leaves of a lattice is filled in: its factors take more time
and memory than all steps of a run. Its mass matrix couples neighbours only. It is far from singular
where each vertex is seen by itself, with the bodies that hang on it by joints: some thirty products
with the matrix give all digits.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_matrix, csc_matrix, csr_matrix, identity, kron
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import LinearOperator, cg, splu

from ..compiled.plan import plan_of
from ..model import System
from ..model.loops import null_space_matrix
from ..pattern import once_for_each
from ..types import Floats
from .base import RowSpace

#: vertices left by elimination along chains and trees above which these velocities are taken
LEFT = 100
#: iterations at most: three times those of a lattice
MOST = 100
#: residual, relative to the momentum, where iterations end: far below rounding, as moments of thin
#: sections are small beside forces; and above which there is no solution
DONE, WRONG = 1e-17, 1e-11


@once_for_each
def is_lattice(system: System) -> bool:
    """Whether elimination leaves many vertices of a scene, and few coordinates move each of them.

    The null space matrix P of long chains of joints is full.
    """
    own = system.tied
    kin = own.kinematics
    if len(system.origin_rows) <= LEFT or kin.deep or kin.elements is not None:
        return False
    return len(plan_of(own).rest) > LEFT


@once_for_each
def _masses(system: System) -> tuple[csr_matrix, csr_matrix]:
    """With the factor I_3: all, and those inside of vertices with the bodies that hang on them."""
    count = len(system.origin_rows)
    joints = [(e.child, e.parent) for e in system.tied.tree.edges if e.parent < count]
    i, j = np.array(joints, dtype=np.int64).reshape(-1, 2).T
    graph = coo_matrix((np.ones(len(i)), (i, j)), shape=(count, count))
    part = connected_components(graph, directed=False)[1]
    size = np.diff(system.origin_rows, append=system.rows)
    part, mass = np.repeat(part, size), system.mass.tocoo()
    own = part[mass.row] == part[mass.col]
    inside = csr_matrix((mass.data[own], (mass.row[own], mass.col[own])), shape=mass.shape)
    whole, near = (csr_matrix(kron(each, identity(3))) for each in (mass, inside))
    return whole, near


def velocity_of_lattice(system: System, y: Floats, p: Floats, rate: Floats) -> Floats | None:
    """As :func:`.saddle.nearest_velocity`: ``v = P nu + v_0``, ``P^T M P nu = P^T (p - M v_0)``.

    Parameters
    ----------
    y : (total, 3) array
    p : (n,) array
        Momentum.
    rate : (m,) array
        Of the constraint rows, ``G v = G v_0 = rate``.

    Returns
    -------
    (n,) array or None
        None: too many iterations were needed, or a momentum is not finite.
    """
    if not np.isfinite(p).all():
        return None
    mass, inside = _masses(system)
    P = null_space_matrix(system.tied, y)
    across = P.T.tocsr()
    v = RowSpace(system, y).least_norm(rate) if rate.any() else np.zeros(system.n)
    try:
        near = splu(csc_matrix(across @ inside @ P), options={"SymmetricMode": True}).solve
    except RuntimeError:  # SuperLU: exactly singular
        return None
    first = across @ (p - mass @ v)
    shape = P.shape[1], P.shape[1]
    reduced = LinearOperator(shape, matvec=lambda nu: across @ (mass @ (P @ nu)), dtype=float)
    preconditioner = LinearOperator(shape, matvec=near, dtype=float)
    nu, left = cg(reduced, first, rtol=DONE, atol=0.0, maxiter=MOST, M=preconditioner)
    if left:
        return None
    v += P @ nu
    rest = across @ (p - mass @ v)
    return v if abs(rest).max(initial=0.0) <= WRONG * abs(first).max(initial=0.0) else None
