"""Sparse patterns that are built once."""

from __future__ import annotations

from copy import copy

import numpy as np
from scipy.sparse import csc_matrix, csr_matrix

from .errors import InputError
from .types import NO_INDICES, Array, ArrayLike, IndexArray

#: rows and columns up to which a full matrix is multiplied faster than a sparse one
FULL_ROWS = 100


class FrozenPattern:
    """Pattern of a sparse matrix, built once from the indices of all contributions.

    Zeros are kept, so the pattern (and a symbolic factorisation that rests on it) does not
    change with the values. Duplicates add up.

    Parameters
    ----------
    rows, cols : (...)
        Indices of the contributions, any shape (the same for both).
    shape : (int, int)
        Shape of the matrix.

    Attributes
    ----------
    slot : (n,)
        Place in ``data`` of each contribution, in the order of the flattened ``rows``.
    indptr, indices
        The compressed-column pattern, shared by all matrices.
    nnz : int
        Number of stored entries.
    shape : (int, int)
        Shape of the matrix.

    Raises
    ------
    InputError
        If the index arrays differ in shape, are no integers or leave the matrix.

    Examples
    --------
    >>> pattern = FrozenPattern([0, 1, 1], [0, 1, 1], (2, 2))
    >>> pattern.matrix([1.0, 2.0, 3.0]).toarray().tolist()
    [[1.0, 0.0], [0.0, 5.0]]
    """

    def __init__(self, rows: ArrayLike, cols: ArrayLike, shape: tuple[int, int]):
        i = _indices("rows", rows, shape[0])
        j = _indices("cols", cols, shape[1])
        if np.shape(rows) != np.shape(cols):
            raise InputError(
                "argument cols", f"has shape {np.shape(cols)}, rows have {np.shape(rows)}"
            )
        order = np.lexsort((i, j))
        key = (j * int(shape[0]) + i)[order]
        new = np.concatenate([[True], key[1:] != key[:-1]])[: len(key)]
        first = order[new]
        slot = np.empty(len(key), np.int64)
        slot[order] = new.cumsum() - 1
        counts = np.bincount(j[first], minlength=shape[1])
        self.shape = (int(shape[0]), int(shape[1]))
        self.nnz = len(first)
        small = max(self.nnz, *self.shape) < np.iinfo(np.int32).max
        kind = np.int32 if small else np.int64
        self.slot = slot
        self.indices = i[first].astype(kind, copy=False)
        self.indptr = np.concatenate([[0], counts.cumsum()]).astype(kind)
        for array in (self.slot, self.indices, self.indptr):
            array.setflags(write=False)
        entries = np.zeros(self.nnz), self.indices, self.indptr
        #: zeros: a copy with other entries costs far less than a new matrix
        self._matrix = csc_matrix(entries, shape=self.shape, copy=False)
        self._matrix.has_canonical_format = True  # then they are sorted, too

    @property
    def columns(self) -> IndexArray:
        """Column (nnz,) of each stored entry."""
        return np.arange(self.shape[1]).repeat(np.diff(self.indptr))

    def data(self, values: ArrayLike) -> Array:
        """Stored entries (nnz,) of contributions in the order of the indices (any shape)."""
        flat = np.asarray(values).reshape(-1)
        if flat.shape != self.slot.shape:
            raise InputError(
                "argument values",
                f"{flat.size} numbers for {self.slot.size} contributions of the pattern",
            )
        return sum_at(self.slot, flat, self.nnz)

    def matrix(self, values: ArrayLike) -> csc_matrix:
        """Matrix of contributions; explicit zeros are kept and the index arrays are shared."""
        return self.assembled(self.data(values))

    def assembled(self, data: Array) -> csc_matrix:
        """Matrix of stored entries (nnz,), e.g. sums of several :meth:`data`."""
        if np.shape(data) != (self.nnz,):
            raise InputError("argument data", f"shape {np.shape(data)}, expected ({self.nnz},)")
        out = copy(self._matrix)
        out.data = data
        return out


def sum_at(index: IndexArray, values: Array, size: int) -> Array:
    """Sums of `values` by `index` (size,), real or complex."""
    if values.dtype.kind == "c":
        return np.bincount(index, values.real, size) + 1j * np.bincount(index, values.imag, size)
    return np.bincount(index, values, size)


def dense_blocks(matrix: csr_matrix, rows: IndexArray) -> Array:
    """Entries (k, r, r) of a matrix between the rows of each of some sets (k, r)."""
    i, j = np.broadcast_arrays(rows[:, :, None], rows[:, None])
    return np.asarray(matrix[i.ravel(), j.ravel()]).reshape(i.shape)


def product_form(matrix: csr_matrix) -> csr_matrix | Array:
    """The matrix in the form in which products with it cost least: in full if it is small."""
    return matrix.toarray() if np.prod(matrix.shape) <= FULL_ROWS**2 else matrix


def _indices(name: str, values: ArrayLike, limit: int) -> IndexArray:
    """Flat indices below a limit."""
    array = np.asarray(values).reshape(-1)
    if array.size == 0:
        return NO_INDICES
    if not np.issubdtype(array.dtype, np.integer):
        raise InputError(f"argument {name}", f"has type {array.dtype}, expected integers")
    if array.min() < 0 or array.max() >= limit:
        bad = array.min() if array.min() < 0 else array.max()
        raise InputError(f"argument {name}", f"index {bad} is not in 0 .. {limit - 1}")
    return array.astype(np.int64)
