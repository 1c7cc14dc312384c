"""Sparse patterns that are built once, and what scenes of one structure share, or one has."""

from __future__ import annotations

import hashlib
import threading
from collections.abc import Callable
from functools import wraps
from typing import Any, TypeVar
from weakref import WeakKeyDictionary

import numpy as np
from scipy.sparse import csc_matrix, csr_matrix

from .errors import InputError
from .types import Array, ArrayLike, IndexArray

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

    def __init__(self, rows: ArrayLike, cols: ArrayLike, shape: tuple[int, int]) -> None:
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
        slot = np.empty(len(key), dtype=np.int64)
        slot[order] = np.cumsum(new) - 1
        counts = np.bincount(j[first], minlength=shape[1])
        self._keep(slot, i[first], np.concatenate([[0], np.cumsum(counts)]), int(shape[0]))

    def _keep(self, slot: IndexArray, indices: Array, indptr: IndexArray, rows: int) -> None:
        self.shape, self.nnz = (rows, len(indptr) - 1), len(indices)
        small = max(self.nnz, *self.shape) < np.iinfo(np.int32).max
        kind = np.int32 if small else np.int64
        self.slot = slot
        self.indices = indices.astype(kind, copy=False)
        self.indptr = indptr.astype(kind)
        for array in (self.slot, self.indices, self.indptr):
            array.setflags(write=False)

    def expanded(self, size: IndexArray) -> FrozenPattern:
        """The pattern with ``size`` (n,) rows and columns for each of n, and full blocks.

        In place of a contribution are those of its block, row by row.

        Examples
        --------
        >>> pattern = FrozenPattern([1, 0], [1, 1], (2, 2)).expanded(np.array([2, 1]))
        >>> pattern.matrix([1.0, 2.0, 3.0]).toarray().tolist()
        [[0.0, 0.0, 2.0], [0.0, 0.0, 3.0], [0.0, 0.0, 1.0]]
        """
        cols = np.repeat(np.arange(len(size)), np.diff(self.indptr))
        first, above = (np.append(0, np.cumsum(n)) for n in (size, size[self.indices]))
        height = np.diff(above[self.indptr])
        indptr = np.append(0, np.cumsum(np.repeat(height, size)))
        top = indptr[first[cols]] + above[:-1] - above[self.indptr[cols]]
        row, col, top = self.indices[self.slot], cols[self.slot], top[self.slot]
        k = np.arange(size.max(initial=0))
        inside = (k[:, None] < size[row, None, None]) & (k < size[col, None, None])
        slot = ((top[:, None] + k)[:, :, None] + height[col, None, None] * k)[inside]
        rows = np.broadcast_to((first[row, None] + k)[:, :, None], inside.shape)
        indices = np.empty(indptr[-1], dtype=self.indices.dtype)
        indices[slot] = rows[inside]
        out = object.__new__(FrozenPattern)
        out._keep(slot, indices, indptr, int(first[-1]))
        return out

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
        out = csc_matrix((data, self.indices, self.indptr), shape=self.shape, copy=False)
        out.has_sorted_indices = True
        out.has_canonical_format = True
        return out


def sum_at(index: IndexArray, values: Array, size: int) -> Array:
    """Sums of `values` by `index` (size,), real or complex."""
    if values.dtype.kind == "c":
        real = np.bincount(index, values.real, size)
        return real + 1j * np.bincount(index, values.imag, size)
    return np.bincount(index, values, size)


def product_form(matrix: csr_matrix) -> csr_matrix | Array:
    """The matrix in the form in which products with it cost least: in full if it is small."""
    return matrix.toarray() if np.prod(matrix.shape) <= FULL_ROWS**2 else matrix


def _indices(name: str, values: ArrayLike, limit: int) -> IndexArray:
    """Flat indices below a limit."""
    array = np.asarray(values).reshape(-1)
    if array.size == 0:
        return np.zeros(0, dtype=np.int64)
    if not np.issubdtype(array.dtype, np.integer):
        raise InputError(f"argument {name}", f"has type {array.dtype}, expected integers")
    if array.min() < 0 or array.max() >= limit:
        bad = array.min() if array.min() < 0 else array.max()
        raise InputError(f"argument {name}", f"index {bad} is not in 0 .. {limit - 1}")
    return array.astype(np.int64)


# -- what follows from the structure of a scene alone, made once for all scenes that have it ------
#
# Which vertices, rows and unknowns are coupled is said by integers. What is made of nothing else,
# such as patterns and orders of elimination, is the same for every scene with the same integers,
# whatever its lengths, stiffnesses and positions are. A digest of all of these integers is the key:
# scenes that differ anywhere share nothing by mistake.

MadeT = TypeVar("MadeT")


class Shared:
    """Results of functions of integers, or of bytes; those that were used last are kept.

    Parameters
    ----------
    most : int
        Memory (bytes) of all together; one alone may take half of it.

    Examples
    --------
    >>> shared = Shared(10**6)
    >>> rows, cols = np.array([0, 1, 1]), np.array([0, 1, 1])
    >>> pattern = shared(FrozenPattern, rows, cols, (2, 2))
    >>> shared(FrozenPattern, rows.copy(), cols.copy(), (2, 2)) is pattern
    True
    >>> shared(FrozenPattern, rows, cols, (2, 3)) is pattern
    False
    """

    def __init__(self, most: int = 64_000_000) -> None:
        self._most = most
        self._kept: dict[tuple[Any, bytes], tuple[Any, int]] = {}
        self._size = 0
        self._lock = threading.Lock()

    def __call__(self, make: Callable[..., MadeT], *integers: Any) -> MadeT:
        """What `make` makes of these numbers, bytes and arrays of integers, in tuples or not.

        It is not to be changed, as others have it, too.
        """
        key = make, _digest(integers)
        with self._lock:
            found = self._kept.pop(key, None)
            if found is not None:
                self._kept[key] = found  # the last one now
                return found[0]
        made = make(*integers)
        size = _memory(made)
        with self._lock:
            if size <= self._most // 2 and key not in self._kept:
                self._kept[key] = made, size
                self._size += size
            while self._size > self._most:
                self._size -= self._kept.pop(next(iter(self._kept)))[1]
        return made

    def clear(self) -> None:
        """Keep nothing of what there is."""
        with self._lock:
            self._kept.clear()
            self._size = 0


#: of this process
shared = Shared()


KeyT = TypeVar("KeyT")
ValueT = TypeVar("ValueT")


def once_for_each(function: Callable[[KeyT], ValueT]) -> Callable[[KeyT], ValueT]:
    """Keep what a function of one object finds for each that somebody still has.

    Nothing that it finds may refer to that object.

    Examples
    --------
    >>> class Scene:
    ...     calls = 0
    >>> @once_for_each
    ... def called(scene: Scene) -> int:
    ...     scene.calls += 1
    ...     return scene.calls
    >>> scene = Scene()
    >>> called(scene), called(scene), called(Scene())
    (1, 1, 1)
    """
    known: WeakKeyDictionary[KeyT, ValueT] = WeakKeyDictionary()

    @wraps(function)
    def found(key: KeyT) -> ValueT:
        if key not in known:
            known[key] = function(key)
        return known[key]

    return found


def _digest(values: Any) -> bytes:
    """Of integers, alone, in arrays, bytes or tuples; their types and shapes included."""
    digest = hashlib.blake2b(digest_size=32)

    def take(value: Any) -> None:
        if isinstance(value, np.ndarray) and value.dtype.kind in "iub":
            digest.update(f"{value.dtype.str}{value.shape}".encode())
            digest.update(np.ascontiguousarray(value).data)
        elif isinstance(value, bytes):
            digest.update(f"bytes{len(value)}".encode())
            digest.update(value)
        elif isinstance(value, tuple) and not all(map(_is_whole, value)):
            digest.update(f"({len(value)}".encode())
            for each in value:
                take(each)
        elif isinstance(value, tuple) or _is_whole(value):
            digest.update(f"{value!r},".encode())
        else:
            raise TypeError(f"{type(value).__name__} is no integer, nor made of integers")

    take(values)
    return digest.digest()


def _is_whole(value: Any) -> bool:
    return isinstance(value, int)


def _memory(value: Any) -> int:
    """What an object takes, roughly (bytes): its arrays, and what lists have by their length."""
    if isinstance(value, np.ndarray):
        return value.nbytes
    if isinstance(value, dict):
        return 200 * len(value) + sum(map(_memory, value.values()))
    if isinstance(value, list | tuple):
        return 64 + sum(map(_memory, value))
    return 64 + (sum(map(_memory, vars(value).values())) if hasattr(value, "__dict__") else 0)
