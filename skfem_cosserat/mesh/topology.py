"""Chains: the order of elements along beams, found from connectivity alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..errors import MeshError
from ..types import Array, Floats, IndexArray

__all__ = ["Chain", "arc_starts", "directed_flips", "duplicates", "find_chains"]


@dataclass(frozen=True, eq=False)
class Chain:
    """Elements of one beam in order, each starting where the one before ends.

    Attributes
    ----------
    elements : (m,)
        Element numbers from the chain's start to its end.
    closed : bool
        If the last element ends where the first one starts.
    owner : int
        Number of the beam, -1 for elements in no beam.
    """

    elements: IndexArray
    closed: bool
    owner: int


def _neighbours(t: Array, elements: IndexArray) -> dict[int, list[int]]:
    """Elements of one group at each of its vertices."""
    at: dict[int, list[int]] = {}
    for e in elements.tolist():
        for v in t[:, e].tolist():
            at.setdefault(v, []).append(e)
    return at


def _other(at: dict[int, list[int]], vertex: int, element: int) -> int | None:
    """The one other element of the group at a vertex; None at ends and branches."""
    around = at[vertex]
    if len(around) != 2:
        return None
    return around[0] if around[1] == element else around[1]


def find_chains(t: Array, owner: IndexArray, names: Sequence[str]) -> list[Chain]:
    """Chains of all beams; a chain ends where its beam ends or branches.

    Parameters
    ----------
    t : (2, ne)
        Vertices of the elements.
    owner : (ne,)
        Beam number of each element, -1 for none.
    names : sequence of str
        Names of the beams, for messages.

    Raises
    ------
    MeshError
        If two elements of a beam point against each other where nothing else joins them.
    """
    chains: list[Chain] = []
    for group in np.unique(owner).tolist():
        elements = np.flatnonzero(owner == group)
        at = _neighbours(t, elements)
        successor: dict[int, int] = {}
        for e in elements.tolist():
            for end in (0, 1):
                vertex = int(t[end, e])
                other = _other(at, vertex, e)
                if other is not None and t[end, other] == vertex:
                    item = f"beam '{names[group]}'" if group >= 0 else "elements in no beam"
                    raise MeshError(
                        item,
                        f"elements {e} and {other} point against each other at node {vertex}:"
                        " use mesh.directed() to turn one",
                    )
                if end == 1 and other is not None:
                    successor[e] = other
        chains += _walk(elements, successor, group)
    return chains


def _walk(elements: IndexArray, successor: dict[int, int], owner: int) -> list[Chain]:
    """Chains of one group: open ones from their first elements, then the closed ones."""
    chains: list[Chain] = []
    used: set[int] = set()
    followed = set(successor.values())
    firsts = [e for e in elements.tolist() if e not in followed]
    for first in [*firsts, *elements.tolist()]:
        if first in used:
            continue
        path = [first]
        used.add(first)
        while (after := successor.get(path[-1])) is not None and after not in used:
            path.append(after)
            used.add(after)
        closed = successor.get(path[-1]) == first
        chains.append(Chain(np.array(path, dtype=np.int64), closed, owner))
    return chains


def directed_flips(t: Array, owner: IndexArray) -> Array:
    """Mask (ne,) of the elements to turn so that every chain runs head to tail.

    The lowest-numbered element of each chain keeps its direction.
    """
    flip = np.zeros(t.shape[1], dtype=bool)
    seen = np.zeros(t.shape[1], dtype=bool)
    for group in np.unique(owner).tolist():
        elements = np.flatnonzero(owner == group)
        at = _neighbours(t, elements)
        for first in elements.tolist():
            if seen[first]:
                continue
            seen[first] = True
            for end in (1, 0):  # forwards from the head, backwards from the tail
                e, vertex = first, int(t[end, first])
                while (other := _other(at, vertex, e)) is not None and not seen[other]:
                    seen[other] = True
                    flip[other] = t[end, other] == vertex
                    far = t[1, other] if t[0, other] == vertex else t[0, other]
                    e, vertex = other, int(far)
    return flip


def arc_starts(chains: Sequence[Chain], lengths: Floats) -> Floats:
    """Arc length (ne,) from the start of its chain to the start of each element (m)."""
    starts = np.zeros(len(lengths))
    for chain in chains:
        ends = np.cumsum(lengths[chain.elements])
        starts[chain.elements[1:]] = ends[:-1]
    return starts


def duplicates(t: Array, middle: Floats, tol: float) -> tuple[int, int] | None:
    """First pair of elements with the same nodes and the same middle point, if any."""
    pairs = np.sort(t, axis=0)
    order = np.lexsort(pairs[::-1])
    same = (np.diff(pairs[:, order], axis=1) == 0).all(axis=0)
    for k in np.flatnonzero(same).tolist():
        e = int(order[k])
        for f in order[k + 1 :].tolist():
            if (pairs[:, e] != pairs[:, f]).any():
                break
            if np.linalg.norm(middle[:, e] - middle[:, f]) <= tol:
                return min(e, f), max(e, f)
    return None
