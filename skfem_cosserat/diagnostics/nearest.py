"""The configuration on the constraints that is nearest to a given one."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_matrix, identity, kron
from scipy.sparse.linalg import splu

from ..constraints.rowspace import RowSpace
from ..kernels import exp_quaternion, rotation_matrix
from ..linear import SingularMatrixError
from ..model import System
from ..model.bending import bent_elements
from ..types import Floats
from .tangent import material_stiffness, null_space_matrix

__all__ = ["nearest_configuration"]

#: Newton iterations, at most
ITERATIONS = 30
#: violation, relative to the size of coordinates in the rows, that counts as none
HELD = 1e-14
#: rotation in an iteration (rad), at most
TURN = 0.5
#: elastic energy against kinetic energy in the distance, in units of the scene's lowest motions
STIFF = 1e3


def nearest_configuration(system: System, y: Floats) -> Floats | None:
    """Rows y (total, 3) moved on the constraints; None if these cannot be fulfilled near them.

    Nearest by what is kept: as little change as possible of the strains that beams have, and of
    places, weighted with the mass, where that leaves a choice. The centre of mass of a scene in
    free flight stays where it is.

    Newton's method for ``g(y) = 0``: of all increments with ``G dy = -g`` the one of least
    ``dy . (M + tau^2 K) dy``, K the stiffness of the material.

    Parameters
    ----------
    y : (total, 3) array
        With orthonormal triads.

    Examples
    --------
    The bob of a pendulum that has drifted off its circle:

    >>> from skfem_cosserat import JointDistance, MassPoint, Model, ground
    >>> model = Model()
    >>> bob = model.add("bob", MassPoint(2.0, position=(0, 0, -1)))
    >>> rod = model.add("rod", JointDistance(ground((0, 0, 0)), bob.place()))
    >>> system = model.freeze()
    >>> y = system.extend(system.q0, 0.0)
    >>> y[0] = 0.66, 0, -0.88   # 1.1 away
    >>> found = nearest_configuration(system, y)
    >>> (found[0] + 0.0).round(9).tolist()
    [0.6, 0.0, -0.8]
    """
    constraints, best, start = system.constraints, np.inf, y
    for _ in range(ITERATIONS):
        g = constraints.values(y)
        # where terms cancel or vanish, coordinates are still known to rounding only
        size = constraints.magnitudes(y, np.full_like(y, abs(y).max(initial=0.0)))
        violation = float((abs(g) / (size + 1e-300)).max(initial=0.0))
        if violation <= HELD or (violation >= 0.5 * best and best < 1e3 * HELD):
            return None if _folded(system, y, start) else y
        best = min(best, violation)
        try:
            change = _increment(system, y, g)
        except SingularMatrixError:
            return None
        if not np.isfinite(change).all():
            return None
        y = _moved(system, y, change)
    return None


def _folded(system: System, y: Floats, start: Floats) -> bool:
    """Whether constraints hold only in a way that no motion leads to: turned over, elements bent.

    Rotations of nodes that Gauss points do not see can make elements longer than they are.
    """
    if system.turned_over(y) is not None:
        return True
    return bent_elements(system, y) is not None and bent_elements(system, start) is None


def _increment(system: System, y: Floats, g: Floats) -> Floats:
    """The least one (rows, 3) that takes the violation g (m,) away to first order."""
    change = RowSpace(system, y).least_norm(-g)
    P = null_space_matrix(system, y).tocsc()
    if P.shape[1]:
        W = _metric(system, y)
        try:
            change = change - P @ splu((P.T @ W @ P).tocsc()).solve(P.T @ (W @ change))
        except RuntimeError as error:  # SuperLU: exactly singular
            raise SingularMatrixError("P^T M P is singular: a motion has no inertia") from error
    return np.asarray(change).reshape(-1, 3)


def _metric(system: System, y: Floats) -> csr_matrix:
    """``M + tau^2 K``: a motion of the scene's extent strains it by far more than it moves it."""
    M, K = csr_matrix(kron(system.mass, identity(3))), material_stiffness(system, y)
    size = float(K.diagonal().sum())
    if not size > 0:
        return M
    shifted = float(system.mass.diagonal()[system.origin_rows].sum()) * system.length**2
    count = len(system.origin_rows)
    return csr_matrix(M + (STIFF * shifted * count**2 / size) * K)


def _moved(system: System, y: Floats, change: Floats) -> Floats:
    """With positions shifted and triads turned, by an increment of limited size."""
    kin = system.kinematics
    rates = np.zeros_like(y)
    rates[: system.rows] = change
    directors = kin.directors(y)
    spin = 0.5 * np.cross(directors, kin.directors(rates)).sum(axis=1)
    share = min(1.0, TURN / max(float(abs(spin).max(initial=0.0)), 1e-300))
    out = y + share * rates
    # rows are directors, which inverse rotations turn from the right
    out[kin.director_rows] = directors @ rotation_matrix(exp_quaternion(-share * spin))
    return out
