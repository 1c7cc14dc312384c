"""Products ``T^T A T`` with matrices of a fixed pattern: from coordinates to unknowns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from ..pattern import FrozenPattern, sum_at
from ..types import Floats, IndexArray

__all__ = ["Congruence"]

#: products of single entries above which parts that are full enough are multiplied as full matrices
MANY = 40_000
_UNIT = np.ones(1)


@dataclass(eq=False)
class _Full:
    """Rows and columns of T that hang together, as full matrices.

    Attributes
    ----------
    rows, cols : int
        How many.
    sources, places : int arrays
        Entries of A, and where they go in (rows, rows).
    entries, where : int arrays
        Entries of T, and where they go in (rows, cols).
    """

    rows: int
    cols: int
    sources: IndexArray
    places: IndexArray
    entries: IndexArray
    where: IndexArray

    def product(self, A: Floats, left: Floats, right: Floats) -> Floats:
        """``T_left^T A T_right`` (cols, cols), flat."""
        both = self.rows, self.cols
        inner = sum_at(self.places, A[self.sources], self.rows**2).reshape(self.rows, -1)
        T_left, T_right = (
            sum_at(self.where, values[self.entries], self.rows * self.cols).reshape(both)
            for values in (left, right)
        )
        return np.asarray(T_left.T @ (inner @ T_right)).ravel()


class Congruence:
    """``T_left^T A T_right + C T_right`` through a frozen pattern.

    A is given by contributions at pairs of twists, T by its entries, C by entries at (unknown,
    twist). Twists of free vertices are unknowns themselves, so most contributions pass straight
    through. Where rows of T have many entries, such as those along a beam without extension, full
    matrices take the place of products of single entries.
    """

    def __init__(
        self,
        pairs: tuple[IndexArray, IndexArray],
        extra: tuple[IndexArray, IndexArray],
        T: tuple[IndexArray, IndexArray, IndexArray],
        shape: tuple[int, int],
    ) -> None:
        T_rows, T_cols, ones = T
        order = np.argsort(T_rows, kind="stable")
        start = np.searchsorted(T_rows[order], np.arange(shape[0] + 1))
        count = np.diff(start)
        identity = np.zeros(shape[0], dtype=bool)
        one = np.flatnonzero(count == 1)
        identity[one] = np.isin(order[start[one]], ones)
        I, J = pairs  # noqa: E741
        plain = identity[I] & identity[J]
        passed = np.flatnonzero(plain)
        rest = np.flatnonzero(~plain & (count[I] > 0) & (count[J] > 0))
        self._full: list[_Full] = []
        columns: list[IndexArray] = []
        if (count[I[rest]] * count[J[rest]]).sum() > MANY:
            self._full, columns = _full_parts(I[rest], J[rest], rest, T_rows, T_cols, shape)
            rest = rest[:0]
        self._source, self._left, self._right = _expand(I[rest], J[rest], rest, start, order)
        k, J2 = extra
        self._extra, _, self._extra_right = _expand(None, J2, np.arange(len(J2)), start, order)
        # products of both kinds as one: entries of A, then of C; of T left, T right, then one
        self._products = np.concatenate([self._source, len(I) + self._extra])
        ones = np.full(len(self._extra), 2 * len(T_rows))
        rights = len(T_rows) + np.concatenate([self._right, self._extra_right])
        self._factors = np.stack([np.concatenate([self._left, ones]), rights])
        col = T_cols[order[start[:-1][identity]]] if identity.any() else np.zeros(0, dtype=int)
        number = np.full(shape[0], -1)
        number[identity] = col
        rows = [number[I[passed]], T_cols[self._left], k[self._extra]]
        cols = [number[J[passed]], T_cols[self._right], T_cols[self._extra_right]]
        rows += [np.repeat(each, len(each)) for each in columns]
        cols += [np.tile(each, len(each)) for each in columns]
        self.pattern = FrozenPattern(
            np.concatenate(rows).astype(np.int64),
            np.concatenate(cols).astype(np.int64),
            (shape[1], shape[1]),
        )
        slot, nnz = self.pattern.slot, self.pattern.nnz
        # contributions that pass, then products: one sum of both
        given = len(I) + len(J2)
        products = given + np.arange(len(slot) - len(passed))
        sources = np.concatenate([passed, products])
        self._places = np.full(given + len(products), nnz)  # the last one: what is not used
        self._places[sources] = slot

    def data(self, A: Sequence[Floats], C: Floats, left: Floats, right: Floats) -> Floats:
        """Entries of the product in :attr:`pattern`; A in one piece or more."""
        every = np.concatenate([*A, C])
        values = [every]
        if len(self._products):
            factors = np.concatenate([left, right, _UNIT]).take(self._factors)
            values.append(every.take(self._products) * factors[0] * factors[1])
        values += [full.product(every, left, right) for full in self._full]
        if len(values) > 1:
            every = np.concatenate(values)
        return sum_at(self._places, every, self.pattern.nnz + 1)[:-1]


def _expand(
    I: IndexArray | None,  # noqa: E741
    J: IndexArray,
    source: IndexArray,
    start: IndexArray,
    order: IndexArray,
) -> tuple[IndexArray, IndexArray, IndexArray]:
    """All pairs of T entries in rows I and J of each contribution."""
    count = np.diff(start)
    nI = np.ones(len(J), dtype=np.int64) if I is None else count[I]
    nJ = count[J]
    total = nI * nJ
    which = np.repeat(np.arange(len(J)), total)
    local = np.arange(int(total.sum())) - np.repeat(np.cumsum(total) - total, total)
    a, b = np.divmod(local, nJ[which]) if len(which) else (local, local)
    right = order[start[J[which]] + b] if len(which) else np.zeros(0, dtype=np.int64)
    if I is None:
        return source[which], which, right
    left = order[start[I[which]] + a] if len(which) else np.zeros(0, dtype=np.int64)
    return source[which], left, right


def _full_parts(
    I: IndexArray,  # noqa: E741
    J: IndexArray,
    source: IndexArray,
    T_rows: IndexArray,
    T_cols: IndexArray,
    shape: tuple[int, int],
) -> tuple[list[_Full], list[IndexArray]]:
    """Rows that contributions couple, with their columns, in parts; columns of each part."""
    rows, cols = shape
    used = np.zeros(rows, dtype=bool)
    used[I] = used[J] = True
    mine = np.flatnonzero(used[T_rows])
    ends = np.concatenate([np.stack([I, J]), np.stack([T_rows[mine], rows + T_cols[mine]])], axis=1)
    graph = coo_matrix((np.ones(ends.shape[1]), ends), shape=(rows + cols, rows + cols))
    label = connected_components(graph, directed=False)[1]
    found, columns = [], []
    local = np.zeros(rows + cols, dtype=np.int64)
    for name in np.unique(label[I]):
        r = np.flatnonzero((label[:rows] == name) & used)
        c = np.flatnonzero(label[rows:] == name)
        local[r], local[rows + c] = np.arange(len(r)), np.arange(len(c))
        which = np.flatnonzero(label[I] == name)
        entries = mine[label[T_rows[mine]] == name]
        places = local[I[which]] * len(r) + local[J[which]]
        where = local[T_rows[entries]] * len(c) + local[rows + T_cols[entries]]
        found.append(_Full(len(r), len(c), source[which], places, entries, where))
        columns.append(c)
    return found, columns
