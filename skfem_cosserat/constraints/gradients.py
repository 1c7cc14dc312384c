"""Velocities on the hidden constraints by conjugate gradients, for lattices and other networks.

What elimination along chains and trees leaves of a network is filled in: its factors take more time
and memory than all steps of a run. Its mass matrix couples neighbours only, and is far from
singular: some twenty products with it give all digits.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_matrix, identity, kron

from ..compiled.plan import plan_of
from ..model import System
from ..model.loops import null_space_matrix
from ..pattern import once_for_each
from ..types import Floats
from .base import RowSpace

#: vertices left by elimination along chains and trees above which these velocities are taken
LEFT = 100
#: iterations at most: a network needs a quarter of it
MOST = 200
#: residual, relative to the momentum, where iterations end, and above which there is no solution
DONE, WRONG = 1e-15, 1e-11


@once_for_each
def is_network(system: System) -> bool:
    """Whether elimination leaves many vertices of a scene, and few coordinates move each of them.

    Long chains of joints need as many iterations as they have joints.
    """
    own = system.tied
    kin = own.kinematics
    if len(system.origin_rows) <= LEFT or kin.deep or kin.elements is not None:
        return False
    return len(plan_of(own).rest) > LEFT


@once_for_each
def _mass(system: System) -> csr_matrix:
    """With the factor I_3."""
    return csr_matrix(kron(system.mass, identity(3)))


def velocity_of_network(system: System, y: Floats, p: Floats, rate: Floats) -> Floats | None:
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
        None: too many iterations were needed.
    """
    mass = _mass(system)
    P = null_space_matrix(system.tied, y)
    across = P.T.tocsr()
    v = RowSpace(system, y).least_norm(rate) if rate.any() else np.zeros(system.n)
    inertia = np.asarray(P.multiply(mass @ P).sum(axis=0)).ravel()
    left = across @ (p - mass @ v)
    size = abs(left).max(initial=0.0)
    for _ in range(2):  # rounding of the first time is taken away by the second one
        change = _descent(mass, P, across, inertia, left)
        if change is None:
            return None
        v += P @ change
        left = across @ (p - mass @ v)
    return v if abs(left).max(initial=0.0) <= WRONG * size else None


def _descent(
    mass: csr_matrix, P: csr_matrix, across: csr_matrix, inertia: Floats, rhs: Floats
) -> Floats | None:
    """``(P^T M P)^-1 rhs`` by conjugate gradients, each coordinate scaled by its own inertia."""
    x, r = np.zeros_like(rhs), rhs.copy()
    z = r / inertia
    direction, first = z.copy(), float(r @ z)
    now = first
    for _ in range(MOST):
        if now <= DONE**2 * first:
            return x
        image = across @ (mass @ (P @ direction))
        length = now / float(direction @ image)
        x += length * direction
        r -= length * image
        z = r / inertia
        now, before = float(r @ z), now
        direction = z + (now / before) * direction
    return None
