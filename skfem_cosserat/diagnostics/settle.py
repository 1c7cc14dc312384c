"""Nodes brought to rest while all others are held."""

from __future__ import annotations

import numpy as np
from scipy.sparse.linalg import splu

from ..kinds import is_beam
from ..model import System
from ..model.balance import Amplitudes
from ..types import Floats, IndexArray
from .tangent import ReducedTangent, reduced_tangent

__all__ = ["inner_rows", "settled"]

#: Newton iterations, at most
ITERATIONS = 6
#: residual, relative to the first one, at which they end
ENOUGH = 1e-9


def settled(
    system: System,
    y: Floats,
    amplitudes: Amplitudes,
    rows: IndexArray,
    inertia: Floats | None = None,
) -> tuple[Floats, ReducedTangent]:
    """A configuration in which some nodes of beams are in equilibrium between all others.

    Interpolated nodes are farther off than what they are interpolated from, and stiff motions
    leave large forces there.

    Parameters
    ----------
    y : (total, 3) array
        All rows of the configuration.
    amplitudes : Amplitudes
        Of the loads.
    rows : (k, 4) int array
        Rows of y of the nodes: phi and the directors. Those that joints hold stay where they are.
    inertia : (n,) array, optional
        ``M a``, which keeps the balance with the other forces.

    Returns
    -------
    y : (total, 3) array
        As it was, if the others are too far from where these nodes could be at rest.
    tangent : ReducedTangent
        There.
    """
    tangent = reduced_tangent(system, y, amplitudes)
    first = 0.0
    for _ in range(ITERATIONS if len(rows) else 0):
        P = tangent.P.tocsc()
        outside = np.ones(system.n)
        outside[(3 * rows[..., None] + np.arange(3)).ravel()] = 0.0
        free = np.flatnonzero(abs(P).T @ outside == 0)  # columns of these nodes alone
        if not len(free):
            break
        try:
            change = splu(tangent.K[free][:, free].tocsc()).solve(-_missing(tangent, inertia)[free])
        except RuntimeError:  # SuperLU: exactly singular
            break
        moved = y.copy()
        moved[: system.rows] += (P[:, free] @ change).reshape(-1, 3)
        u, _, vt = np.linalg.svd(moved[rows[:, 1:]])
        moved[rows[:, 1:]] = u @ vt
        after = reduced_tangent(system, moved, amplitudes)
        sizes = [float(abs(_missing(x, inertia)[free]).max()) for x in (tangent, after)]
        first = first or sizes[0]
        if not sizes[1] < sizes[0]:
            break
        y, tangent = moved, after
        if sizes[1] <= ENOUGH * first:
            break
    return y, tangent


def _missing(tangent: ReducedTangent, inertia: Floats | None) -> Floats:
    """Residual along the constraints."""
    if inertia is None:
        return tangent.residual
    return np.asarray(tangent.residual + tangent.P.T @ inertia)


def inner_rows(system: System) -> IndexArray:
    """Rows (k, 4) of y of the nodes inside elements."""
    rows = [np.zeros((0, 4), dtype=np.int64)]
    for beam in (item for item in system.structures if is_beam(item)):
        inner = beam.basis.connectivity[:, 1:-1].ravel()
        rows.append(system.first[id(beam)][1] + 4 * inner[:, None] + np.arange(4))
    return np.concatenate(rows)
