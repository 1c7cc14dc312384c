"""The order in which vertices are eliminated, and where their blocks are: once for a system."""

from __future__ import annotations

import heapq
from collections.abc import Iterable, Sequence

import numpy as np

from ..model import System
from ..types import IndexArray

__all__ = ["Plan", "plan_of"]

#: products of blocks for each vertex above which an elimination in blocks does not pay: lattices
FILLED = 30


class Plan:
    """Minimum degree ordering of a graph of vertices, children before their parents.

    Parameters
    ----------
    count : int
        Vertices.
    pairs : iterable of (int, int)
        Vertices that share a block.
    parent : sequence of int
        Parent of each vertex in the tree of joints, -1 for none.

    Raises
    ------
    OverflowError
        If it fills in: more than 30 products of blocks for each vertex.

    Attributes
    ----------
    order : (count,) int array
    slot : dict
        (row vertex, column vertex) -> number of the block, those that fill in included.
    ptr, neighbour : int arrays
        Neighbours of the k-th pivot that are eliminated after it.
    right, down : int arrays
        Slots of (pivot, neighbour) and (neighbour, pivot).
    update_ptr, update : int arrays
        Slots of all pairs of its neighbours.
    work : int
        Products of blocks that a factorisation takes.

    Examples
    --------
    A chain takes as many as it has links:

    >>> plan = Plan(5, [(0, 1), (1, 2), (2, 3), (3, 4)], [-1] * 5)
    >>> plan.order.tolist(), plan.work
    ([0, 1, 2, 3, 4], 4)
    """

    def __init__(self, count: int, pairs: Iterable[tuple[int, int]], parent: Sequence[int]) -> None:
        order, later = _ordered(count, pairs, parent)
        self.order: IndexArray = np.array(order, dtype=np.int64)
        slot: dict[tuple[int, int], int] = {}
        for v, around in zip(order, later, strict=True):
            slot[v, v] = len(slot)
            for w in around:
                slot[v, w] = len(slot)
                slot[w, v] = len(slot)
        self.slot = slot
        sizes = np.array([len(around) for around in later], dtype=np.int64)
        self.ptr = np.concatenate([[0], np.cumsum(sizes)])
        self.update_ptr = np.concatenate([[0], np.cumsum(sizes**2)])
        self.work = int((sizes**2).sum())
        each = list(zip(order, later, strict=True))
        self.neighbour = _ints(w for _, ws in each for w in ws)
        self.right = _ints(slot[v, w] for v, ws in each for w in ws)
        self.down = _ints(slot[w, v] for v, ws in each for w in ws)
        self.update = _ints(slot[a, b] for _, ws in each for a in ws for b in ws)
        self.diag = _ints(slot[v, v] for v in range(count))
        self.parent_at = _ints(ws.index(parent[v]) if parent[v] >= 0 else -1 for v, ws in each)


def plan_of(system: System) -> Plan:
    """Elimination of the vertices of a system.

    Raises
    ------
    OverflowError
        See :class:`Plan`.
    """
    count = len(system.origin_rows)
    pairs = [
        (a, b)
        for group in system.beam_groups
        for vertices in group.vertices.tolist()
        for k, a in enumerate(vertices)
        for b in vertices[k + 1 :]
    ]
    parent = [-1] * count
    for e in system.tree.edges:
        parent[e.child] = e.parent if e.parent < count else -1
    return Plan(count, pairs, parent)


def _ints(numbers: Iterable[int]) -> IndexArray:
    return np.array(list(numbers), dtype=np.int64)


def _ordered(
    count: int, pairs: Iterable[tuple[int, int]], parent: Sequence[int]
) -> tuple[list[int], list[list[int]]]:
    """Vertices in order, and the later neighbours of each in that order."""
    around: list[set[int]] = [set() for _ in range(count)]
    waiting = [0] * count
    links = [*pairs, *((v, p) for v, p in enumerate(parent) if p >= 0)]
    for a, b in links:
        if a != b:
            around[a].add(b)
            around[b].add(a)
    for p in parent:
        if p >= 0:
            waiting[p] += 1
    heap = [(len(around[v]), v) for v in range(count) if not waiting[v]]
    heapq.heapify(heap)
    order: list[int] = []
    later: list[set[int]] = []
    done, work = [False] * count, 0
    while heap:
        degree, v = heapq.heappop(heap)
        if done[v]:
            continue
        if degree != len(around[v]):  # it has changed since
            heapq.heappush(heap, (len(around[v]), v))
            continue
        done[v] = True
        work += len(around[v]) ** 2
        if work > FILLED * count + FILLED**2:
            raise OverflowError(f"more than {FILLED} products of blocks for each vertex")
        order.append(v)
        later.append(around[v])
        for w in around[v]:
            around[w] |= around[v]
            around[w] -= {v, w}
            if not waiting[w]:
                heapq.heappush(heap, (len(around[w]), w))
        p = parent[v]
        if p >= 0:
            waiting[p] -= 1
            if not waiting[p]:
                heapq.heappush(heap, (len(around[p]), p))
    position = {v: k for k, v in enumerate(order)}
    return order, [sorted(ws, key=position.__getitem__) for ws in later]
