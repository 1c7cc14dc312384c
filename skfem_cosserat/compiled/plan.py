"""The plan of an elimination in blocks, and which loads follow the motion."""

from __future__ import annotations

import heapq
from collections.abc import Collection, Iterable, Mapping, Sequence
from itertools import chain
from typing import NamedTuple

import numpy as np

from ..frozen import lock_arrays
from ..joint import JointDrive
from ..model import System
from ..model.loading import Followers
from ..model.system import Coordinates
from ..types import ArrayLike, IndexArray

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

    Attributes
    ----------
    order : (count,) int array
    blocks : int
        How many of them, the first ones, are eliminated in blocks.
    rest : (count - blocks,) int array
        The others, those that hang on joints first.
    ends : (slots, 2) int array
        Row and column vertex of each block, those that fill in included; :meth:`slots` finds them.
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
    ) -> None:
        links = np.asarray(pairs, dtype=np.int64).reshape(-1, 2)
        above = np.asarray(parent, dtype=np.int64)
        self.rows = rows
        waits = {count - len(rows) + k: block.waits for k, block in enumerate(rows)}

        def thinned() -> _Graph:
            out = _Graph(count, links.tolist(), above.tolist(), held, waits)
            out.eliminate(THIN)
            return out

        graph = thinned()
        left = count - len(graph.order)
        if left and not thin:
            whole = thinned()
            if whole.eliminate(count, FILLED * left):
                graph = whole
        self.blocks = len(graph.order)
        graph.turn(grounded)
        self.order: IndexArray = np.array(graph.order, dtype=np.int64)
        self.rest: IndexArray = self.order[self.blocks :]
        self.ptr, self.neighbour = _sorted_lists(graph.later)
        self._stride = count
        near = [graph.around[v] for v in graph.order[self.blocks :]]
        self.ends = self._number(*_sorted_lists([*graph.later[: self.blocks], *near]), links)
        pivot = np.repeat(self.order, np.diff(self.ptr))
        self.right = self.slots(pivot, self.neighbour)
        self.down = self.slots(self.neighbour, pivot)
        self.diag = self.slots(np.arange(count), np.arange(count))
        is_parent = self.neighbour == above[pivot]
        self.parent_at: IndexArray = np.full(count, -1)
        t = np.repeat(np.arange(count), np.diff(self.ptr))[is_parent]
        self.parent_at[t] = np.flatnonzero(is_parent) - self.ptr[t]
        self._find_updates()
        lock_arrays(self)

    def _number(self, ptr: IndexArray, near: IndexArray, links: IndexArray) -> IndexArray:
        """Number the blocks in the order of their elimination, then those never looked at."""
        count, total = self._stride, len(self.order) + 2 * len(near)
        pivot = np.repeat(self.order, np.diff(ptr))
        on_diagonal = np.zeros(total, dtype=bool)
        on_diagonal[np.arange(count) + 2 * ptr[:-1]] = True
        codes = np.empty(total, dtype=np.int64)
        codes[on_diagonal] = (count + 1) * self.order
        codes[~on_diagonal] = np.stack([pivot, near, near, pivot], -1).reshape(-1, 2) @ [count, 1]
        codes = np.concatenate(
            [codes, np.stack([links, links[:, ::-1]], 1).reshape(-1, 2) @ [count, 1]]
        )
        # every block by one number, in order: to find many at once
        self._codes, first = np.unique(codes, return_index=True)
        by_number = np.argsort(first)
        self._order = np.empty_like(first)
        self._order[by_number] = np.arange(len(first))
        return np.stack(np.divmod(self._codes[by_number], count), -1)

    def _find_updates(self) -> None:
        """Slots of pairs of neighbours, from pivots of equally many of them at once."""
        degree = np.diff(self.ptr)
        behind = np.arange(len(degree)) >= self.blocks
        asked = np.where(behind & (self.parent_at < 0), 0, degree)
        self.work = int((degree[: self.blocks] ** 2).sum())
        self.update_ptr: IndexArray = np.concatenate([[0], np.cumsum(asked**2)])
        self.update: IndexArray = np.empty(self.update_ptr[-1], dtype=np.int64)
        for d in np.unique(asked[asked > 0]):
            pivots = np.flatnonzero(asked == d)
            k = np.arange(d)
            near = self.neighbour[self.ptr[pivots, None] + k]
            # what is turned into a joint's coordinates adds to the parent alone
            own = (self.parent_at[pivots, None] == k) | ~behind[pivots, None]
            row = np.where(own[:, :, None] | own[:, None], near[:, :, None], -1)
            found = self.slots(row, near[:, None])
            to = self.update_ptr[pivots, None] + np.arange(d * d)
            self.update[to] = found.reshape(len(pivots), -1)

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


def row_blocks(coordinates: Coordinates) -> list[RowBlock]:
    """Rows that the tree's coordinates leave, in blocks of at most six.

    Forces along these rows are eliminated like the coordinates of a vertex. A block that comes
    behind the vertices it waits for has a regular pivot: without masses behind them it is minus a
    positive definite one.
    """
    system = coordinates.system
    left = set(coordinates.left_rows.tolist())
    count = len(system.origin_rows)
    nodes = [(each.first + each.beam.basis.connectivity).tolist() for each in system.theory_rows]
    parent = {e.child: min(e.parent, count) for e in coordinates.joint_edges}
    _hang(chain.from_iterable(nodes), parent, count)
    depth = _depths(parent)
    found: dict[int, tuple[list[int], set[int]]] = {}
    for jr in system.joint_rows:
        joint = jr.joint.joint if isinstance(jr.joint, JointDrive) else jr.joint
        numbers, vertices = found.setdefault(id(joint), ([], set()))
        numbers += range(jr.rows.start, jr.rows.stop)
        vertices |= {jr.a.vertex, jr.b.vertex} if joint is jr.joint else set()
    each = [*found.values()]
    for theory, of_elements in zip(system.theory_rows, nodes, strict=True):
        each += [
            (numbers.ravel().tolist(), set(vertices))
            for numbers, vertices in zip(theory.numbers, of_elements, strict=True)
        ]
    out = []
    for numbers, vertices in each:
        kept = [k for k in numbers if k in left]
        for first in range(0, len(kept), 6):
            ends = tuple(sorted(vertices)), _between(vertices, parent, depth, count)
            out.append(RowBlock(tuple(kept[first : first + 6]), *ends))
    return out


def _hang(elements: Iterable[Sequence[int]], parent: dict[int, int], count: int) -> None:
    """Join trees by elements that hold strains: the top of one hangs on the other's vertex.

    Two elements that hold all strains would take the same vertex's unknowns otherwise, and the
    second one's pivot would vanish.
    """
    above = dict(parent)

    def top(v: int) -> int:
        way = []
        while v in above:
            way.append(v)
            v = above[v]
        above.update(dict.fromkeys(way, v))
        return v

    for first, *others in elements:
        for v in others:
            ends = [(top(v), first), (top(first), v)]
            below, on = ends[ends[0][0] == count]  # the ground hangs on nothing
            if ends[0][0] != ends[1][0]:
                parent[below] = above[below] = on


def _depths(parent: Mapping[int, int]) -> dict[int, int]:
    """Depth of each vertex: the number of parents above it, up to the root."""
    depth: dict[int, int] = {}
    for v in parent:
        way = []
        while v in parent and v not in depth:
            way.append(v)
            v = parent[v]
        below = depth.get(v, 0)
        depth |= {u: below + k for k, u in enumerate(reversed(way), 1)}
    return depth


def _between(
    vertices: Collection[int], parent: Mapping[int, int], depth: Mapping[int, int], count: int
) -> tuple[int, ...]:
    """Vertices on the way from one to the other, without the one at which all ways meet."""
    ends = {min(v, count) for v in vertices}
    found = set()
    while len(ends) > 1:
        deepest = max(ends, key=lambda v: (depth.get(v, 0), -v))  # the ground comes last
        found.add(deepest)
        ends.remove(deepest)
        if deepest in parent:
            ends.add(parent[deepest])
    return tuple(sorted(found - {count}))


def plan_of(coordinates: Coordinates, thin: bool = False) -> Plan:
    """Elimination of a system, its rows with multipliers included; see :class:`Plan`."""
    system = coordinates.system
    count = len(system.origin_rows)
    rows = row_blocks(coordinates)
    pairs = [np.zeros((0, 2), dtype=np.int64)]
    for group in system.beam_groups:
        a, b = np.triu_indices(group.vertices.shape[1], 1)
        pairs.append(np.stack([group.vertices[:, a], group.vertices[:, b]], -1).reshape(-1, 2))
    pairs.append(places_of(system)[0][system.couplings.pairs])
    of_rows = []
    for k, block in enumerate(rows, count):
        own = [v for v in block.vertices if v < count]
        of_rows += [(a, b) for i, a in enumerate(own) for b in (*own[i + 1 :], k)]
    pairs.append(np.array(of_rows, dtype=np.int64).reshape(-1, 2))
    parent = np.full(count + len(rows), -1)
    grounded = []
    for e in coordinates.tree.edges:
        if e.parent < count:
            parent[e.child] = e.parent
        else:
            grounded.append(e.child)
    grounded.sort()
    held = tuple(v for v in grounded if not len(coordinates.tree.own[v]))
    graph = len(parent), np.concatenate(pairs), parent, tuple(grounded), held
    return Plan(*graph, thin, tuple(rows))


def places_of(system: System) -> tuple[IndexArray, IndexArray]:
    """Vertex of each row of y, those of the ground included, and the row's place in it."""
    first = system.vertex_rows
    order = np.argsort(first)
    vertex = np.repeat(order, np.diff(first[order], append=system.total))
    return vertex, np.arange(system.total) - first[vertex]


def _sorted_lists(sets: Sequence[Collection[int]]) -> tuple[IndexArray, IndexArray]:
    """Members of sets, each in order, one set after the other; where those of each begin."""
    sizes = np.fromiter(map(len, sets), dtype=np.int64, count=len(sets))
    ptr = np.concatenate([[0], np.cumsum(sizes)])
    members = np.fromiter(chain.from_iterable(sets), dtype=np.int64, count=ptr[-1])
    owner = np.repeat(np.arange(len(sets)), sizes)
    return ptr, members[np.lexsort((members, owner))]


class _Graph:
    """Vertices that are not eliminated yet, and the order of those that are."""

    def __init__(
        self,
        count: int,
        pairs: Iterable[Sequence[int]],
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
        for a, b in chain(pairs, ((v, p) for v, p in enumerate(parent) if p >= 0)):
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

    def eliminate(self, largest: int, most: float = np.inf) -> bool:
        """Eliminate by degree, up to a largest one.

        False, and perhaps not to its end, if all of them take more than `most` products.
        """
        around, waiting, done, count = self.around, self._waiting, self._done, len(self.around)
        # degree and vertex as one number; a degree that has grown is found out when it is its turn
        heap = [len(around[v]) * count + v for v in range(count) if not (done[v] or waiting[v])]
        heapq.heapify(heap)
        known = [len(near) for near in around]  # degree in the heap
        work = 0
        while heap:
            degree, v = divmod(heapq.heappop(heap), count)
            if done[v] or degree != known[v]:
                continue
            near = around[v]
            if degree != len(near):
                known[v] = len(near)
                heapq.heappush(heap, known[v] * count + v)
                continue
            if degree > largest:
                break
            work += degree**2
            if work > most:
                return False
            done[v] = True
            self.order.append(v)
            self.later.append(near)
            for w in near:
                other = around[w]
                other |= near
                other.discard(v)
                other.discard(w)
                if len(other) < known[w] and not waiting[w]:
                    known[w] = len(other)
                    heapq.heappush(heap, known[w] * count + w)
            for p in self._released(v):
                known[p] = len(around[p])
                heapq.heappush(heap, known[p] * count + p)
        return True

    def _released(self, v: int) -> list[int]:
        """Count v as eliminated, and give the vertices that wait for no other one any more."""
        p = self.parent[v]
        waiting = [*self._behind.get(v, ()), *((p,) if p >= 0 else ())]
        for w in waiting:
            self._waiting[w] -= 1
        return [w for w in waiting if not self._waiting[w]]

    def turn(self, grounded: Collection[int]) -> None:
        """Put the others in order, those that hang on joints first, children before parents.

        What a parent carries along goes to it when the blocks of a child are turned into its
        joint's coordinates: its neighbours become neighbours of the parent.
        """
        around, parent = self.around, self.parent
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
            ready += [w for w in self._released(v) if w in hung]
        rest = [v for v in left if v not in hung]
        self.order += rest
        self.later += [set() for _ in rest]


# -- forces that are linear in the configuration, pair by pair of vertices, for compiled kernels ---


def following(system: System) -> Followers:
    """Forces fixed in bodies and sections, and behind them drag per velocity, in channel -1."""
    loads = system.loading.followers
    if system.drag is None:
        return loads
    entries, (vertex, place) = system.drag.tocoo(), places_of(system)
    rows = np.stack([entries.row, entries.col], -1)
    vertices, number = np.unique(vertex[rows], axis=0, return_inverse=True)
    values = np.zeros((len(vertices), 4, 4))
    np.add.at(values, (number.reshape(-1), *place[rows].T), entries.data)
    return Followers(
        np.concatenate([loads.vertices, vertices]),
        np.concatenate([loads.channels, np.full(len(vertices), -1)]),
        np.concatenate([loads.values, values]),
    )
