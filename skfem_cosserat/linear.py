"""The one place where a linear solver is chosen."""

from __future__ import annotations

import warnings
from functools import cached_property

import numpy as np
from scipy.linalg import get_lapack_funcs
from scipy.sparse.csgraph import reverse_cuthill_mckee
from scipy.sparse.linalg import MatrixRankWarning, splu

from .assembly import FrozenPattern
from .errors import CosseratError
from .types import Floats, IndexArray

__all__ = ["LinearSolver", "SingularMatrixError"]

DENSE = 40  # unknowns below which a dense factorisation is fastest
BAND = 110  # lower plus upper bandwidth up to which a banded one is faster than a sparse one


class SingularMatrixError(CosseratError):
    """The iteration matrix is singular to working precision."""


class LinearSolver:
    """Solves systems whose pattern never changes; the method is chosen once.

    Parameters
    ----------
    pattern : FrozenPattern
        Square. Small systems are solved dense, narrow ones banded after a reverse Cuthill-McKee
        ordering, all others by SuperLU.

    Attributes
    ----------
    method : {"dense", "banded", "sparse"}
    factorisations : int
        How many so far.
    """

    def __init__(self, pattern: FrozenPattern) -> None:
        self.pattern = pattern
        self.n = pattern.shape[0]
        self.factorisations = 0
        self.method = "dense" if self.n <= DENSE else self._banded_or_sparse()

    def _banded_or_sparse(self) -> str:
        pattern = self.pattern
        ones = pattern.matrix(np.ones(len(pattern.slot)))
        order = reverse_cuthill_mckee((ones + ones.T).tocsr(), symmetric_mode=True)
        position = np.empty(self.n, dtype=np.int64)
        position[order] = np.arange(self.n)
        cols = np.repeat(np.arange(self.n), np.diff(pattern.indptr))
        i, j = position[pattern.indices], position[cols]
        kl, ku = int((i - j).max(initial=0)), int((j - i).max(initial=0))
        if kl + ku > BAND:
            return "sparse"
        self._order, self._kl, self._ku = order, kl, ku
        self._rows = 2 * kl + ku + 1
        self._where = (kl + ku + i - j) + self._rows * j  # column-major band storage
        self._gbsv = get_lapack_funcs("gbsv", dtype=np.float64)
        return "banded"

    def solve(self, data: Floats, rhs: Floats) -> Floats:
        """Solution (n,) or (n, k) for the pattern's data (nnz,) and as many right-hand sides.

        Raises
        ------
        SingularMatrixError
            If a pivot vanishes or the solution is not finite.
        """
        self.factorisations += 1
        if self.method == "banded":
            band = np.zeros(self._rows * self.n)
            band[self._where] = data
            band = band.reshape((self._rows, self.n), order="F")
            _, _, x, info = self._gbsv(
                self._kl, self._ku, band, rhs[self._order], overwrite_ab=True, overwrite_b=True
            )
            if info == 0:
                out = np.empty_like(rhs)
                out[self._order] = x
        elif self.method == "dense":
            out, info = self._dense(data, rhs)
        else:
            out, info = self._sparse(data, rhs)
        if info != 0 or not np.isfinite(out).all():
            raise SingularMatrixError("the iteration matrix is singular")
        return out

    @cached_property
    def _columns(self) -> IndexArray:
        """Column of each stored entry."""
        return np.repeat(np.arange(self.n), np.diff(self.pattern.indptr))

    def _dense(self, data: Floats, rhs: Floats) -> tuple[Floats, int]:
        matrix = np.zeros((self.n, self.n))
        matrix[self.pattern.indices, self._columns] = data
        try:
            return np.asarray(np.linalg.solve(matrix, rhs), dtype=float), 0
        except np.linalg.LinAlgError:
            return rhs, 1

    def _sparse(self, data: Floats, rhs: Floats) -> tuple[Floats, int]:
        with warnings.catch_warnings():
            warnings.simplefilter("error", MatrixRankWarning)
            try:
                return splu(self.pattern.assembled(data)).solve(rhs), 0
            except (RuntimeError, MatrixRankWarning):  # SuperLU: exactly singular
                return rhs, 1
