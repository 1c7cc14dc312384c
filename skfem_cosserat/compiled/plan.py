"""The plan of an elimination in blocks, and which loads follow the motion."""

from __future__ import annotations

import heapq
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_matrix

from ..frozen import lock_arrays
from ..joint import JointDrive
from ..model import System
from ..model.loading import Followers
from ..model.plane_rows import acting_rows
from ..pattern import shared
from ..types import ArrayLike, Floats, IndexArray

__all__ = ["Plan", "RowBlock", "following", "plan_of", "row_blocks"]


# -- the order in which vertices are eliminated, and where their blocks are: once for a system -----

#: neighbours up to which a vertex is eliminated in blocks in any case: struts and what dangles
THIN = 2
#: products of blocks for each of the others above which a sparse solver is faster (measured on
#: lattices: as fast at 7 x 7 x 7 joints)
FILLED = 400


class Plan:
    """Minimum degree ordering of a graph of vertices, children before their parents.

    It hangs on integers alone: scenes of the same structure share it.

    Where that fills in (large lattices), only vertices with up to two neighbours are eliminated in
    blocks: insides of struts, trees. The blocks of the others are left to a sparse solver.

    Parameters
    ----------
    count : int
        Vertices.
    pairs : (k, 2) int array
        Vertices that share a block.
    parent : (count,) int array
        Parent of each vertex in the tree of joints, -1 for none.
    grounded : tuple of int
        Vertices that hang on a joint to the ground.
    held : tuple of int
        Those of them without unknowns: nothing is coupled with them.
    thin : bool
        Eliminate vertices with up to two neighbours only, even where all would not fill in.
    rows : tuple of RowBlock
        The last vertices are these, each after those that it waits for.
    limits : (int, int)
        `THIN` and `FILLED`.

    Attributes
    ----------
    order : (count,) int array
    blocks : int
        How many of them, the first ones, are eliminated in blocks.
    rest : (count - blocks,) int array
        The others, those that hang on joints first.
    slot : dict
        (row vertex, column vertex) -> number of the block, those that fill in included.
    ptr, neighbour : int arrays
        Neighbours of the k-th pivot that are eliminated after it. Of one that is left to the sparse
        solver: all that are left too, if it hangs on a joint, as its blocks are turned into the
        joint's coordinates; else none.
    right, down : int arrays
        Slots of (pivot, neighbour) and (neighbour, pivot).
    update_ptr, update : int arrays
        Slots of all pairs of its neighbours; -1 where nothing is added.
    work : int
        Products of blocks that a factorisation takes.
    rows : tuple of RowBlock
        What the last vertices are, if not of the scene: constraint rows with multipliers.

    Examples
    --------
    A chain takes as many as it has links:

    >>> plan = Plan(5, [(0, 1), (1, 2), (2, 3), (3, 4)], [-1] * 5)
    >>> plan.order.tolist(), plan.work, plan.blocks
    ([0, 1, 2, 3, 4], 4, 5)
    """

    def __init__(
        self,
        count: int,
        pairs: ArrayLike,
        parent: ArrayLike,
        grounded: tuple[int, ...] = (),
        held: tuple[int, ...] = (),
        thin: bool = False,
        rows: tuple[RowBlock, ...] = (),
        limits: tuple[int, int] = (THIN, FILLED),
    ) -> None:
        links: list[tuple[int, int]] = [(a, b) for a, b in np.asarray(pairs).tolist()]
        above: list[int] = np.asarray(parent).tolist()
        self.rows = rows
        waits = {count - len(rows) + k: block.waits for k, block in enumerate(rows)}
        degree, filled = limits
        graph = _Graph(count, links, above, held, waits)
        graph.eliminate(degree)
        left = count - len(graph.order)
        if not thin and not graph.eliminate(count, filled * left):
            graph = _Graph(count, links, above, held, waits)
            graph.eliminate(degree)
        self.blocks = len(graph.order)
        updates: list[list[tuple[int, int] | None]] = [
            [(a, b) for a in ws for b in ws] for ws in graph.sorted_later()
        ]
        self.work = sum(map(len, updates))
        updates += graph.turn(grounded)
        order, later = graph.order, graph.sorted_later()
        self.order: IndexArray = _ints(order)
        self.rest: IndexArray = self.order[self.blocks :]
        self.slot = slot = _slots(order, later, self.blocks, graph.around, links)
        self.ptr = _starts(later)
        self.update_ptr = _starts(updates)
        both = list(zip(order, later, strict=True))
        self.neighbour = _ints(w for _, ws in both for w in ws)
        self.right = _ints(slot[v, w] for v, ws in both for w in ws)
        self.down = _ints(slot[w, v] for v, ws in both for w in ws)
        self.update = _ints(-1 if ab is None else slot[ab] for each in updates for ab in each)
        self.diag = _ints(slot[v, v] for v in range(count))
        self.parent_at = _ints(ws.index(above[v]) if above[v] >= 0 else -1 for v, ws in both)
        # every block by one number, in order: to find many at once
        self._stride = count
        ends = np.array(list(slot), dtype=np.int64).reshape(-1, 2)
        codes = ends[:, 0] * count + ends[:, 1]
        self._order = np.argsort(codes)
        self._codes = codes[self._order]
        lock_arrays(self)

    def slots(self, u: ArrayLike, v: ArrayLike) -> IndexArray:
        """Numbers of the blocks (u, v), of any shape; -1 where u or v is negative.

        Raises
        ------
        KeyError
            If there is no such block.
        """
        u, v = np.asarray(u, dtype=np.int64), np.asarray(v, dtype=np.int64)
        asked, codes = (u >= 0) & (v >= 0), u * self._stride + v
        if not codes.size:
            return codes
        places = np.minimum(np.searchsorted(self._codes, codes), len(self._codes) - 1)
        if (asked & (self._codes[places] != codes)).any():
            raise KeyError("no such block")
        return np.where(asked, self._order[places], -1)


class RowBlock(NamedTuple):
    """Constraint rows with multipliers, up to a block full: of a joint, or of an element.

    Attributes
    ----------
    rows : tuple of int
        Their numbers; three that are a vector in space stand together.
    vertices : tuple of int
        Vertices that they hold together; those of the ground have the highest numbers.
    waits : tuple of int
        Those whose elimination leaves the rows independent: on the way along the tree of all joints
        from one to the other, without where the ways meet.
    """

    rows: tuple[int, ...]
    vertices: tuple[int, ...]
    waits: tuple[int, ...]


def row_blocks(system: System, width: int = 6) -> list[RowBlock]:
    """Rows that the tree's coordinates leave, in blocks of at most `width`.

    Forces along these rows are eliminated like the coordinates of a vertex. A block that comes
    behind the vertices it waits for has a regular pivot: without masses behind them it is minus a
    positive definite one.
    """
    left = set(system.left_rows.tolist())
    if system.plane is not None:
        left &= set(acting_rows(system).tolist())
    count = len(system.origin_rows)
    parent = {e.child: min(e.parent, count) for e in system.spanning.edges}
    depth = system.spanning.depth
    found: dict[int, tuple[list[int], set[int]]] = {}
    for jr in system.joint_rows:
        joint = jr.joint.joint if isinstance(jr.joint, JointDrive) else jr.joint
        numbers, vertices = found.setdefault(id(joint), ([], set()))
        numbers += range(jr.rows.start, jr.rows.stop)
        vertices |= {jr.a.vertex, jr.b.vertex} if joint is jr.joint else set()
    each = [*found.values()]
    for theory in system.theory_rows:
        nodes = theory.first + theory.beam.basis.connectivity
        each += [
            (numbers.ravel().tolist(), set(vertices))
            for numbers, vertices in zip(theory.numbers, nodes.tolist(), strict=True)
        ]
    out = []
    for numbers, vertices in each:
        kept = [k for k in numbers if k in left]
        for first in range(0, len(kept), width):
            ends = tuple(sorted(vertices)), _between(vertices, parent, depth, count)
            out.append(RowBlock(tuple(kept[first : first + width]), *ends))
    return out


def _between(
    vertices: Collection[int], parent: Mapping[int, int], depth: Mapping[int, int], count: int
) -> tuple[int, ...]:
    """Vertices on the way from one to the other, without the one at which all ways meet."""
    ends: set[int] = {min(v, count) for v in vertices}
    found: set[int] = set()
    while len(ends) > 1:
        deepest = max(ends, key=lambda v: depth.get(v, -1))
        found.add(deepest)
        ends.remove(deepest)
        if deepest in parent:
            ends.add(parent[deepest])
    return tuple(sorted(found - {count}))


def plan_of(system: System, thin: bool = False) -> Plan:
    """Elimination of a system, its rows with multipliers included; see :class:`Plan`."""
    count = len(system.origin_rows)
    rows = row_blocks(system, 6 if system.plane is None else 3)
    pairs = [np.zeros((0, 2), dtype=np.int64)]
    for group in system.beam_groups:
        a, b = np.triu_indices(group.vertices.shape[1], 1)
        pairs.append(np.stack([group.vertices[:, a], group.vertices[:, b]], -1).reshape(-1, 2))
    pairs.append(_coupled(system))
    of_rows = []
    for k, block in enumerate(rows, count):
        own = [v for v in block.vertices if v < count]
        of_rows += [(a, b) for i, a in enumerate(own) for b in (*own[i + 1 :], k)]
    pairs.append(np.array(of_rows, dtype=np.int64).reshape(-1, 2))
    parent = np.full(count + len(rows), -1)
    grounded = []
    for e in system.tree.edges:
        if e.parent < count:
            parent[e.child] = e.parent
        else:
            grounded.append(e.child)
    grounded.sort()
    held = tuple(v for v in grounded if not len(system.tree.own[v]))
    graph = len(parent), np.concatenate(pairs), parent, tuple(grounded), held
    return shared(Plan, *graph, thin, tuple(rows), (THIN, FILLED))


def _coupled(system: System) -> IndexArray:
    """Vertices that force elements couple (k, 2)."""
    first = np.array(system.origin_rows)
    order = np.argsort(first)
    vertex = order[np.searchsorted(first[order], system.couplings.pairs, side="right") - 1]
    both = np.sort(vertex[vertex[:, 0] != vertex[:, 1]], axis=1)
    return np.unique(both, axis=0) if len(both) else both


def _ints(numbers: Iterable[int]) -> IndexArray:
    return np.array(list(numbers), dtype=np.int64)


def _starts(lists: Sequence[Sequence[object]]) -> IndexArray:
    return np.concatenate([[0], np.cumsum([len(each) for each in lists])]).astype(np.int64)


def _slots(
    order: list[int],
    later: list[list[int]],
    blocks: int,
    around: list[set[int]],
    pairs: Iterable[tuple[int, int]],
) -> dict[tuple[int, int], int]:
    """Numbers of blocks, in the order of their elimination; then those that are never looked at."""
    slot: dict[tuple[int, int], int] = {}
    for k, (v, ws) in enumerate(zip(order, later, strict=True)):
        slot[v, v] = len(slot)
        for w in ws if k < blocks else sorted(around[v]):
            slot.setdefault((v, w), len(slot))
            slot.setdefault((w, v), len(slot))
    for a, b in pairs:
        slot.setdefault((a, b), len(slot))
        slot.setdefault((b, a), len(slot))
    return slot


class _Graph:
    """Vertices that are not eliminated yet, and the order of those that are."""

    def __init__(
        self,
        count: int,
        pairs: Iterable[tuple[int, int]],
        parent: Sequence[int],
        held: Collection[int],
        waits: Mapping[int, Collection[int]],
    ) -> None:
        self.parent, self.held = parent, set(held)
        self.around: list[set[int]] = [set() for _ in range(count)]
        self.order: list[int] = []
        self.later: list[set[int]] = []
        self._waiting = [0] * count  # children, and others, that come first
        self._behind: dict[int, list[int]] = {}  # what waits for a vertex, besides its parent
        links = [*pairs, *((v, p) for v, p in enumerate(parent) if p >= 0)]
        for a, b in links:
            if a != b and not ({a, b} & self.held and parent[a] != b and parent[b] != a):
                self.around[a].add(b)
                self.around[b].add(a)
        for p in parent:
            if p >= 0:
                self._waiting[p] += 1
        for v, others in waits.items():
            self._waiting[v] += len(others)
            for u in others:
                self._behind.setdefault(u, []).append(v)
        self._done = [False] * count

    def eliminate(self, largest: int, most: int | None = None) -> bool:
        """Eliminate by degree, up to a largest one; False if it takes more than `most` products."""
        around, waiting = self.around, self._waiting
        ready = (v for v, done in enumerate(self._done) if not (done or waiting[v]))
        heap = [(len(around[v]), v) for v in ready]
        heapq.heapify(heap)
        work = 0
        while heap:
            degree, v = heapq.heappop(heap)
            if self._done[v]:
                continue
            if degree != len(around[v]):  # it has changed since
                heapq.heappush(heap, (len(around[v]), v))
                continue
            if degree > largest:
                break
            work += degree**2
            if most is not None and work > most:
                return False
            self._done[v] = True
            self.order.append(v)
            self.later.append(around[v])
            for w in around[v]:
                around[w] |= around[v]
                around[w] -= {v, w}
                if not waiting[w]:
                    heapq.heappush(heap, (len(around[w]), w))
            for p in self._released(v):
                heapq.heappush(heap, (len(around[p]), p))
        return True

    def _released(self, v: int) -> list[int]:
        """What has waited for a vertex that is dealt with, and for no other any more."""
        p = self.parent[v]
        waiting = [*self._behind.get(v, ()), *((p,) if p >= 0 else ())]
        for w in waiting:
            self._waiting[w] -= 1
        return [w for w in waiting if not self._waiting[w]]

    def turn(self, grounded: Collection[int]) -> list[list[tuple[int, int] | None]]:
        """Put the others in order, those that hang on joints first, children before parents.

        Returns
        -------
        For each the pairs of its neighbours that change when its blocks are turned into its
        joint's coordinates: what its parent carries along goes to the parent.
        """
        around, parent = self.around, self.parent
        updates: list[list[tuple[int, int] | None]] = []
        left = [v for v, done in enumerate(self._done) if not done]
        ground = set(grounded)
        hung = {v for v in left if parent[v] >= 0 or v in ground}
        ready = [v for v in left if v in hung and not self._waiting[v]]
        while ready:
            v = ready.pop()
            p = parent[v]
            self.order.append(v)
            if p >= 0:
                for w in around[v] - {p}:
                    around[w].add(p)
                    around[p].add(w)
            self.later.append(set(around[v]))
            near = sorted(around[v]) if p >= 0 else []
            updates.append([(a, b) if p in (a, b) else None for a in near for b in near])
            ready += [w for w in self._released(v) if w in hung]
        for v in left:
            if v not in hung:
                self.order.append(v)
                self.later.append(set())
                updates.append([])
        return updates

    def sorted_later(self) -> list[list[int]]:
        """Neighbours of each pivot still to come, always in the same order."""
        return [sorted(ws) for ws in self.later]


# -- forces that are linear in the configuration, pair by pair of vertices, for compiled kernels ---


def following(system: System) -> Followers:
    """Forces fixed in bodies and sections, and behind them drag per velocity, in channel -1."""
    loads = system.loading.followers
    if system.drag is None:
        return loads
    vertices, values = _pairs(system.drag, system.origin_rows)
    return Followers(
        np.concatenate([loads.vertices, vertices]),
        np.concatenate([loads.channels, np.full(len(vertices), -1)]),
        np.concatenate([loads.values, values]),
    )


def _pairs(matrix: csr_matrix, first: IndexArray) -> tuple[IndexArray, Floats]:
    """Pairs of vertices (k, 2) and their entries (k, 4, 4) of a matrix by rows of y."""
    entries = matrix.tocoo()
    rows = np.stack([entries.row, entries.col], -1)
    order = np.argsort(first)
    vertex = order[np.searchsorted(first[order], rows, side="right") - 1]
    pairs, number = np.unique(vertex, axis=0, return_inverse=True)
    values = np.zeros((len(pairs), 4, 4))
    component = rows - first[vertex]
    np.add.at(values, (number.reshape(-1), component[:, 0], component[:, 1]), entries.data)
    return pairs, values
