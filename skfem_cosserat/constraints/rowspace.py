"""The constraint Jacobian at one configuration: least-norm solutions, also with redundant rows."""

from __future__ import annotations

from contextlib import suppress

import numpy as np
from scipy.sparse.linalg import splu

from ..linear import SingularMatrixError
from ..model import System
from ..types import Array, Floats, IndexArray

__all__ = ["RowSpace", "dependent_rows", "massless", "rows_touching", "stacked_multipliers"]

#: contributions to constraint Jacobians of configurations that are taken together
ENTRIES = 100_000


def massless(system: System) -> Array:
    """Which coordinates (n,) have no mass, such as d3 of beams."""
    return np.repeat(system.mass.diagonal() == 0, 3)


def rows_touching(system: System, coordinates: Array) -> Array:
    """Which constraint rows (m,) contain any of the coordinates, a mask (n,).

    Asked at a configuration without any order, where nothing cancels.
    """
    y = np.random.default_rng(1).uniform(0.5, 1.5, (system.total, 3))
    G = abs(system.constraints.jacobian(y)).tocsr()
    largest = np.asarray(G.max(axis=1).todense()).ravel()
    part = np.asarray(G[:, np.flatnonzero(coordinates)].sum(axis=1)).ravel()
    return part > 1e-12 * largest


def dependent_rows(system: System, y: Floats) -> IndexArray:
    """Numbers of the constraint rows that depend on the others at y (total, 3)."""
    if not len(system.closure.rows):
        return np.zeros(0, dtype=np.int64)
    return np.flatnonzero(~system.independent_rows(y))


def stacked_multipliers(system: System, y: Floats, force: Floats) -> Floats:
    """Lambda (N, m) of least norm with ``G(y)^T lambda = force``, for stacks.

    Where no rows are redundant, many configurations at once: one sparse matrix for all.

    Parameters
    ----------
    y : (N, total, 3) array
    force : (N, n) array
        NaN rows give NaN.

    Returns
    -------
    (N, m) array
        NaN where the rows depend on each other.
    """
    out = np.full((len(y), system.m), np.nan)
    if not system.m:
        return out
    known = np.flatnonzero(np.isfinite(force).all(axis=1))
    size = 1 if len(system.closure.rows) else max(1, ENTRIES // len(system.constraints.inside))
    for first in range(0, len(known), size):
        some = known[first : first + size]
        if size == 1 or not _solve_together(system, y[some], force[some], some, out):
            for k in some:
                with suppress(SingularMatrixError):  # stays NaN
                    out[k] = RowSpace(system, y[k]).multipliers(force[k])
    return out


def _solve_together(
    system: System, y: Floats, force: Floats, places: IndexArray, out: Floats
) -> bool:
    """Multipliers of some configurations, to their places; False if one of them is singular."""
    G = system.constraints.jacobians(y)
    try:
        gram = splu((G @ G.T).tocsc())
    except RuntimeError:  # SuperLU: exactly singular
        return False
    out[places] = gram.solve(G @ force.reshape(-1)).reshape(len(y), -1)
    return True


class RowSpace:
    """``G G^T`` of the independent rows of ``G(y)``, factorised once.

    Raises
    ------
    SingularMatrixError
        If those rows depend on each other, in a configuration of lower rank.
    """

    def __init__(self, system: System, y: Floats) -> None:
        self.m = system.m
        G = system.constraints.jacobian(y).tocsr()
        self._dropped = dependent_rows(system, y)
        self._kept = np.setdiff1d(np.arange(system.m), self._dropped)
        self._G = G[self._kept]
        try:
            self._gram = splu((self._G @ self._G.T).tocsc())
        except RuntimeError as error:  # SuperLU: exactly singular
            raise SingularMatrixError("the constraint rows depend on each other") from error
        # G_dropped = C^T G_kept, so the columns of (-C, I) are the null space of G^T
        self._C = self._gram.solve((self._G @ G[self._dropped].T).toarray())

    def multipliers(self, force: Floats) -> Floats:
        """Lambda (m,) of least norm with ``G^T lambda = force`` for a force (n,) in its range."""
        out = np.zeros(self.m)
        out[self._kept] = self._gram.solve(self._G @ force)
        if len(self._dropped):
            C = self._C
            inner = C.T @ C + np.eye(len(self._dropped))
            weight = np.linalg.solve(inner, C.T @ out[self._kept])
            out[self._kept] -= C @ weight
            out[self._dropped] = weight
        return out

    def least_norm(self, rhs: Floats) -> Floats:
        """Vector (n,) of least norm with ``G v = rhs``; redundant rows must agree with the rest."""
        return np.asarray(self._G.T @ self._gram.solve(rhs[self._kept]))
