"""LAPACK: small systems as full matrices, narrow ones as bands."""

from __future__ import annotations

import numpy as np
from scipy.linalg import get_lapack_funcs
from scipy.sparse.csgraph import reverse_cuthill_mckee

from ..pattern import FrozenPattern
from ..types import Floats, IndexArray
from .base import Factors, SingularMatrixError, Solver

__all__ = ["Band", "SolverBanded", "SolverDense"]


class SolverDense(Solver):
    """LU of the full matrix with partial pivoting.

    Examples
    --------
    >>> SolverDense()
    SolverDense()
    """

    name = "dense"

    def bind(self, pattern: FrozenPattern) -> Factors:
        """See the base class."""
        return _Dense(pattern)


class _Dense(Factors):
    name = SolverDense.name

    def __init__(self, pattern: FrozenPattern) -> None:
        self._n = pattern.shape[0]
        cols = np.repeat(np.arange(self._n), np.diff(pattern.indptr))
        self._where = pattern.indices.astype(np.int64) + self._n * cols
        self._getrf, self._getrs = get_lapack_funcs(("getrf", "getrs"), dtype=np.float64)

    def factor(self, data: Floats) -> None:
        flat = np.zeros(self._n * self._n)
        flat[self._where] = data
        matrix = flat.reshape((self._n, self._n), order="F")
        self._lu, self._pivots, info = self._getrf(matrix, overwrite_a=True)
        if info != 0:
            raise SingularMatrixError("the iteration matrix is singular")

    def solve(self, rhs: Floats) -> Floats:
        return self._getrs(self._lu, self._pivots, rhs)[0]


class Band:
    """A pattern in reverse Cuthill-McKee order.

    Parameters
    ----------
    pattern : FrozenPattern
        Square.

    Attributes
    ----------
    order : (n,) int array
        Unknowns in the order of the rows.
    position : (n,) int array
        Row of each unknown.
    lower, upper : int
        Bandwidths.
    where : (nnz,) int array
        Places of the entries in column-major band storage, with room for exchanged rows.
    """

    def __init__(self, pattern: FrozenPattern) -> None:
        n = pattern.shape[0]
        ones = pattern.assembled(np.ones(pattern.nnz))
        self.order: IndexArray = reverse_cuthill_mckee((ones + ones.T).tocsr(), symmetric_mode=True)
        self.position: IndexArray = np.empty(n, dtype=np.int64)
        self.position[self.order] = np.arange(n)
        position = self.position
        cols = np.repeat(np.arange(n), np.diff(pattern.indptr))
        i, j = position[pattern.indices], position[cols]
        self.lower, self.upper = int((i - j).max(initial=0)), int((j - i).max(initial=0))
        self.rows = 2 * self.lower + self.upper + 1
        self.where: IndexArray = (self.lower + self.upper + i - j) + self.rows * j


class SolverBanded(Solver):
    """Banded LU with partial pivoting after a reverse Cuthill-McKee ordering.

    Examples
    --------
    >>> SolverBanded()
    SolverBanded()
    """

    name = "banded"

    def bind(self, pattern: FrozenPattern, band: Band | None = None) -> Factors:
        """See the base class; `band` if it is known already."""
        return _Banded(pattern, Band(pattern) if band is None else band)


class _Banded(Factors):
    name = SolverBanded.name

    def __init__(self, pattern: FrozenPattern, band: Band) -> None:
        self._n, self._band = pattern.shape[0], band
        rows, cols = pattern.indices, np.repeat(np.arange(self._n), np.diff(pattern.indptr))
        self._entries, self._diagonal = (rows, cols), np.flatnonzero(rows == cols)
        #: of rows and columns, in the order of the band; of the entries
        self._scale, self._scales = np.zeros(0), np.zeros(0)
        self._gbtrf, self._gbtrs = get_lapack_funcs(("gbtrf", "gbtrs"), dtype=np.float64)

    def factor(self, data: Floats) -> None:
        b = self._band
        if not len(self._scale):
            self._scale_by(data)
        flat = np.zeros(b.rows * self._n)
        flat[b.where] = data * self._scales
        band = flat.reshape((b.rows, self._n), order="F")
        self._lu, self._pivots, info = self._gbtrf(band, b.lower, b.upper, overwrite_ab=True)
        if info != 0:
            raise SingularMatrixError("the iteration matrix is singular")

    def solve(self, rhs: Floats) -> Floats:
        b = self._band
        scale = self._scale if rhs.ndim == 1 else self._scale[:, None]
        ordered = rhs.take(b.order, axis=0)
        ordered *= scale
        found = self._gbtrs(self._lu, b.lower, b.upper, ordered, self._pivots, overwrite_b=True)[0]
        found *= scale
        return found.take(b.position, axis=0)

    def _scale_by(self, data: Floats) -> None:
        """Powers of two that bring the diagonal of the first matrix to about one, on both sides.

        Shifts and rotations differ by orders of magnitude: without, half of the columns have their
        pivot elsewhere, and rows that are exchanged fill the band.
        """
        size = np.ones(self._n)
        size[self._entries[0][self._diagonal]] = abs(data[self._diagonal])
        size[~(np.isfinite(size) & (size > 0))] = 1.0
        scale = np.exp2(np.round(-0.5 * np.log2(size)))
        self._scales = scale[self._entries[0]] * scale[self._entries[1]]
        self._scale = scale[self._band.order]
