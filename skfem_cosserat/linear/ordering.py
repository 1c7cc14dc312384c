"""Orderings that fill in little, found once for a pattern on a graph of few vertices.

Unknowns whose columns have the same entries (the six of a node) are one vertex of the graph: the
ordering costs a fortieth, and the unknowns of a node stay together in the factors.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.sparse import csc_matrix
from scipy.sparse.linalg import splu

from ..pattern import FrozenPattern
from ..types import IndexArray

__all__ = [
    "Permuted",
    "balanced",
    "merged",
    "minimum_degree",
    "nested_dissection",
    "unknowns_in_order",
]

#: pivots on the diagonal are taken down to this part of the largest entry of their column
THRESHOLD = 0.01


def balanced(pattern: FrozenPattern) -> bool:
    """Whether the pattern is its own transpose with all of the diagonal in it."""
    n = pattern.shape[0]
    cols = np.repeat(np.arange(n), np.diff(pattern.indptr))
    if np.count_nonzero(pattern.indices == cols) < n:
        return False
    ones = pattern.assembled(np.ones(pattern.nnz))
    mirror = csc_matrix(ones.T)
    mirror.sort_indices()
    same = np.array_equal(mirror.indptr, pattern.indptr)
    return same and np.array_equal(mirror.indices, pattern.indices)


def merged(pattern: FrozenPattern) -> tuple[IndexArray, csc_matrix]:
    """Groups of unknowns with the same neighbours, and the graph of the groups.

    Returns
    -------
    group : (n,) int array
        Group of each unknown, numbered by their first ones.
    graph : sparse matrix
        Symmetric pattern of the groups, with a diagonal.
    """
    n = pattern.shape[0]
    ones = pattern.assembled(np.ones(pattern.nnz))
    both = csc_matrix(ones + ones.T)
    # a set of rows is known by a sum of random numbers: two different ones agree once in 2^64
    marks = np.random.default_rng(0).integers(0, 2**63, n, dtype=np.uint64)
    sums = np.concatenate([[np.uint64(0)], np.cumsum(marks[both.indices], dtype=np.uint64)])
    _, first, group = np.unique(
        sums[both.indptr[1:]] - sums[both.indptr[:-1]], return_index=True, return_inverse=True
    )
    rank = np.empty(len(first), dtype=np.int64)
    rank[np.argsort(first)] = np.arange(len(first))
    group = rank[group.reshape(-1)]
    count = len(first)
    cols = np.repeat(np.arange(n), np.diff(both.indptr))
    keys = np.unique(group[cols] * count + group[both.indices])
    j, i = np.divmod(keys, max(count, 1))
    links = csc_matrix((np.full(len(keys), -1.0), (i, j)), shape=(count, count))
    return group, links


def minimum_degree(graph: csc_matrix) -> IndexArray:
    """Groups in the order of SuperLU's multiple minimum degree."""
    values = graph.copy()
    values.setdiag(1.0 + np.diff(graph.indptr))  # no pivot is exchanged
    lu = splu(
        csc_matrix(values),
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )
    return np.argsort(lu.perm_c)


def nested_dissection(graph: csc_matrix) -> IndexArray:
    """Groups in the order of METIS.

    Raises
    ------
    ImportError
        If pymetis is not installed.
    """
    try:
        import pymetis
    except ImportError as error:
        raise ImportError(
            "SolverMetis() needs pymetis: pip install 'skfem-cosserat[solvers]'"
        ) from error
    links = graph.copy()
    links.setdiag(0)
    links.eliminate_zeros()
    if links.nnz == 0:
        return np.arange(graph.shape[0])
    neighbours = np.split(links.indices, links.indptr[1:-1])
    order, _ = pymetis.nested_dissection(adjacency=[near.tolist() for near in neighbours])
    return np.array(order, dtype=np.int64)


def unknowns_in_order(
    pattern: FrozenPattern, rule: Callable[[csc_matrix], IndexArray]
) -> IndexArray:
    """Unknowns (n,), group by group in the order that a rule gives the groups."""
    group, graph = merged(pattern)
    position = np.empty(graph.shape[0], dtype=np.int64)
    position[rule(graph)] = np.arange(graph.shape[0])
    return np.argsort(position[group], kind="stable")


class Permuted:
    """A pattern whose rows and columns are brought into another order, once.

    Attributes
    ----------
    order : (n,) int array
        Unknowns in the new order.
    pattern : FrozenPattern
        In the new order.
    take : (nnz,) int array
        Entries of the new pattern are ``data[take]``.
    """

    def __init__(self, pattern: FrozenPattern, order: IndexArray) -> None:
        n = pattern.shape[0]
        position = np.empty(n, dtype=np.int64)
        position[order] = np.arange(n)
        cols = np.repeat(position, np.diff(pattern.indptr))
        self.order = order
        self.pattern = FrozenPattern(position[pattern.indices], cols, pattern.shape)
        self.take: IndexArray = np.empty(pattern.nnz, dtype=np.int64)
        self.take[self.pattern.slot] = np.arange(pattern.nnz)
