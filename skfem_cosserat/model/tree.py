"""Spanning tree of the constraint graph, and which coordinate moves what.

Vertices are frames and mass points, joints are edges, the ground is one root. Beam elements are
force elements and no edges. Every vertex in the tree moves with the joint coordinates on its path
to the root; written with *absolute* rotations across spherical joints and relative ones across
the others, the velocity of vertex c by coordinate k is

``omega_c = a_k`` (if the rotation is passed on to c), ``v_c = a_k x (target_ck - centre_k)``

where a_k is an axis, centre_k a point on it, and target_ck the origin of c or the first joint on
the path that does not pass the rotation on. All three are linear in q, so the null space matrix
is evaluated for all pairs (c, k) at once, at nodes and midpoints alike.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

import numpy as np

from ..joint import Joint
from ..types import Floats

__all__ = ["Coordinate", "Edge", "Spot", "Tree", "build_tree"]


@dataclass(frozen=True)
class Spot:
    """A material point by number: vertex and material coordinates."""

    vertex: int
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Edge:
    """A joint in the tree, from parent to child."""

    joint: Joint
    child: int
    parent: int
    child_spot: Spot
    parent_spot: Spot
    sign: float  # +1: the child is side B (rotation counts from A to B)
    guide: int  # vertex of side A, which carries the axis


@dataclass
class Coordinate:
    """One unknown of the null space.

    ``kind``: "translation" or "rotation" of a free vertex or absolute across a joint (constant
    axis), "axis" (material in `guide`), "sphere" (axis fixed during a step).
    """

    kind: str
    vertex: int
    number: int
    axis: Floats
    guide: int = -1
    centre: Spot | None = None


@dataclass
class Pair:
    """Coordinate `number` moves `vertex`."""

    vertex: int
    number: int
    target: Spot | None  # None: a translation
    rotates: bool


@dataclass
class Tree:
    """Result of :func:`build_tree`."""

    coordinates: list[Coordinate] = field(default_factory=list)
    edges: list[Edge] = field(default_factory=list)  # parents before children
    free: list[int] = field(default_factory=list)  # vertices without a parent
    depth: dict[int, int] = field(default_factory=dict)
    pairs: list[Pair] = field(default_factory=list)  # of the vertices with a parent
    loops: list[Joint] = field(default_factory=list)  # joints that close a loop
    own: dict[int, list[int]] = field(default_factory=dict)


def build_tree(
    is_frame: list[bool], ends: list[tuple[Joint, Spot, Spot]], material: dict[int, Floats]
) -> Tree:
    """Breadth-first spanning tree and its coordinates.

    Parameters
    ----------
    is_frame : list of bool
        Of the structural vertices; higher numbers in `ends` are ground frames.
    ends : list of (joint, spot of side a, spot of side b)
    material : dict
        ``id(joint) -> (3,)`` axis of a revolute joint in the triad of its side A.
    """
    nv = len(is_frame)
    tree = Tree()
    edges = _span(nv, ends, tree)
    by_child = {edge.child: edge for edge in edges}
    children = {edge.parent for edge in edges}
    for v in range(nv):  # numbering in vertex order keeps neighbours close
        _own_coordinates(tree, v, is_frame[v], by_child.get(v), material)
    moving: dict[int, list[Pair]] = {}
    for v in tree.free:
        if v in children:
            moving[v] = [
                Pair(v, k, None if tree.coordinates[k].kind == "translation" else Spot(v), True)
                for k in tree.own[v]
            ]
    for edge in edges:
        moving[edge.child] = _passed_on(tree, edge, moving.get(edge.parent, []), is_frame)
        tree.pairs += moving[edge.child]
    tree.edges = edges
    return tree


def _span(nv: int, ends: list[tuple[Joint, Spot, Spot]], tree: Tree) -> list[Edge]:
    around: dict[int, list[int]] = {}
    for j, (_, a, b) in enumerate(ends):
        for spot in (a, b):
            around.setdefault(min(spot.vertex, nv), []).append(j)
    seen = {nv}
    used: set[int] = set()
    edges: list[Edge] = []
    for root in [nv, *range(nv)]:
        if root != nv:
            if root in seen:
                continue
            seen.add(root)
            tree.free.append(root)
            tree.depth[root] = 0
        queue = deque([root])
        while queue:
            v = queue.popleft()
            for j in around.get(v, []):
                joint, a, b = ends[j]
                parent, child = (a, b) if min(a.vertex, nv) == v else (b, a)
                if j in used or child.vertex in seen or child.vertex >= nv:
                    continue
                used.add(j)
                seen.add(child.vertex)
                tree.depth[child.vertex] = tree.depth.get(parent.vertex, 0) + 1
                sign = 1.0 if child is b else -1.0
                edges.append(
                    Edge(joint, child.vertex, parent.vertex, child, parent, sign, a.vertex)
                )
                queue.append(child.vertex)
    tree.loops = [joint for j, (joint, _, _) in enumerate(ends) if j not in used]
    return edges


def _own_coordinates(
    tree: Tree, v: int, frame: bool, edge: Edge | None, material: dict[int, Floats]
) -> None:
    def add(kind: str, axis: Floats, guide: int = -1, centre: Spot | None = None) -> None:
        k = len(tree.coordinates)
        tree.coordinates.append(Coordinate(kind, v, k, axis, guide, centre))
        tree.own.setdefault(v, []).append(k)

    tree.own[v] = []
    if edge is None:
        for axis in np.eye(3):
            add("translation", axis)
        if frame:
            for axis in np.eye(3):
                add("rotation", axis, centre=Spot(v))
        return
    freedom = edge.joint.freedom()
    if freedom.sphere:
        for _ in range(2):
            add("sphere", np.zeros(3), centre=edge.parent_spot)
    if not frame or freedom.rotation == "locked":
        return
    if freedom.rotation == "free":
        for axis in np.eye(3):
            add("rotation", axis, centre=edge.child_spot)
    else:
        axis = edge.sign * material[id(edge.joint)]
        add("axis", axis, guide=edge.guide, centre=edge.child_spot)


def _passed_on(tree: Tree, edge: Edge, parent: list[Pair], is_frame: list[bool]) -> list[Pair]:
    freedom = edge.joint.freedom()
    absolute = freedom.rotation == "free"
    c = edge.child
    pairs: list[Pair] = []
    for pair in parent:
        if pair.target is None:
            pairs.append(Pair(c, pair.number, None, False))
        elif not pair.rotates or not is_frame[edge.parent]:
            pairs.append(Pair(c, pair.number, pair.target, False))
        elif absolute or not is_frame[c]:
            pairs.append(Pair(c, pair.number, edge.parent_spot, False))
        else:
            pairs.append(Pair(c, pair.number, Spot(c), True))
    for k in tree.own[c]:
        sphere = tree.coordinates[k].kind == "sphere"
        pairs.append(Pair(c, k, edge.child_spot if sphere else Spot(c), not sphere))
    return pairs
