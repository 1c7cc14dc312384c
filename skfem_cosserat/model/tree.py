"""Spanning tree of the constraint graph, and which coordinate moves what.

Vertices are frames and mass points, joints are edges, the ground is one root. Beam elements are
force elements and no edges. Every vertex in the tree moves with the joint coordinates on its path
to the root; written with *absolute* rotations across joints that leave any rotation free and
relative ones across the others, the velocity of vertex c by coordinate k is

``omega_c = a_k`` (if the rotation is passed on to c), ``v_c = a_k x (target_ck - centre_k)``

where a_k is an axis, centre_k a point on it, and target_ck the origin of c or the first joint on
the path that does not pass the rotation on; a slide gives ``v_c = left_k x right_k``. Axes and
points are linear in q, so the null space matrix is evaluated for all pairs (c, k) at once, at
nodes and midpoints alike.

In a scene that moves in one plane only the tree has the coordinates in that plane alone: two
translations, rotations about its normal, what joints leave free in it.

Rigid elements of beams are edges, too (:class:`RigidElement`): fixed joints from the node that the
tree comes to first to each other one. Rows of other strains that a beam holds are left to
multipliers.

With r = x_b - x_a and the guide on side a: ``omega_b - omega_a`` is the relative rotation and
``rdot - omega_a x r`` the slide, whichever side is the parent. Both sides thus turn about x_b.
"""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..joint import Freedom, Joint
from ..types import Array, Floats, IndexArray
from .plane import Plane

if TYPE_CHECKING:
    from ..beam import Beam


@dataclass(frozen=True)
class Spot:
    """A material point by number: vertex and material coordinates."""

    vertex: int
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class RigidElement:
    """An element of a rigid beam: its nodes are connected by fixed joints."""

    item: Beam
    number: int  # in the beam
    vertices: tuple[int, ...]
    nodes: tuple[int, ...]  # of the beam

    @property
    def label(self) -> str:
        """That of the beam."""
        return self.item.label

    def freedom(self) -> Freedom:
        """Relative motion of two of its nodes: none."""
        return Freedom(())

    def arm(self, v: int, c: int) -> tuple[float, float, float]:
        """Material coordinates of vertex c at vertex v, in the reference."""
        a, b = (self.nodes[self.vertices.index(vertex)] for vertex in (v, c))
        x, y, z = self.item.triads[a] @ (self.item.basis.nodes[b] - self.item.basis.nodes[a])
        return float(x), float(y), float(z)


@dataclass(frozen=True, eq=False)
class End:
    """A joint with its spots, and which of its coordinates are driven by which ground frame."""

    joint: Joint | RigidElement
    a: Spot
    b: Spot
    driven: Mapping[str, int] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Edge:
    """A joint in the tree, from parent to child."""

    end: End
    child: int
    parent: int
    child_spot: Spot
    parent_spot: Spot
    sign: float  # +1: the child is side B (coordinates count from A to B)

    @property
    def joint(self) -> Joint | RigidElement:
        """Its joint, or the element that it is part of."""
        return self.end.joint

    @cached_property
    def freedom(self) -> Freedom:
        """Relative motions that its joint leaves free in space."""
        return self.joint.freedom()

    @property
    def guide(self) -> int:
        """Vertex of side A, which carries axes and slides."""
        return self.end.a.vertex


#: of coordinates
KINDS = "translation", "rotation", "axis", "slide", "sphere"


@dataclass(slots=True)
class Coordinate:
    """One coordinate of the tree: an unknown of the null space, or driven.

    ``kind``: "translation" or "rotation" of a free vertex or absolute across a joint (constant
    axis), "axis" (material in `guide`), "slide" (left x right, material in `guide`), "sphere"
    (axis fixed during a step).
    """

    kind: str
    vertex: int
    number: int
    axis: Floats
    guide: int = -1
    centre: Spot | None = None
    right: Floats | None = None
    drive: int | None = None  # ground frame whose position prescribes it


class Pairs(NamedTuple):
    """Pairs of a vertex and a coordinate that moves it.

    Attributes
    ----------
    vertex, number : (k,) int array
        Coordinate `number` moves `vertex`.
    target : (k,) int array
        Among :attr:`Tree.spots`; -1: a translation.
    rotates : (k,) bool array
    """

    vertex: IndexArray
    number: IndexArray
    target: IndexArray
    rotates: NDArray[np.bool_]

    @classmethod
    def of(cls, each: Sequence[tuple[int, int, int, bool]]) -> Pairs:
        """From one after the other."""
        vertex, number, target, rotates = np.array(each, np.int64).reshape(-1, 4).T
        return cls(vertex, number, target, rotates.astype(bool))

    @classmethod
    def joined(cls, parts: Sequence[Pairs]) -> Pairs:
        """All of them."""
        return cls(*map(np.concatenate, zip(cls.of([]), *parts, strict=True)))

    def some(self, which: Array) -> Pairs:
        """Pairs that are chosen by an index or a mask."""
        chosen = self.vertex[which], self.number[which], self.target[which]
        return Pairs(*chosen, self.rotates[which])


@dataclass
class Tree:
    """Result of :func:`build_tree`."""

    is_frame: list[bool]
    plane: Plane | None = None
    #: of vertices with a parent, by number; those of others are many, and alike: see `coordinate`
    coordinates: dict[int, Coordinate] = field(default_factory=dict)
    driven: list[Coordinate] = field(default_factory=list)  # numbered behind the others
    edges: list[Edge] = field(default_factory=list)  # parents before children
    free: list[int] = field(default_factory=list)  # vertices without a parent
    depth: dict[int, int] = field(default_factory=dict)
    loops: list[Joint] = field(default_factory=list)  # joints that close a loop
    own: list[range] = field(default_factory=list)  # numbers of each vertex's coordinates
    turns: dict[int, list[Coordinate]] = field(default_factory=dict)  # relative, of a child
    slides: dict[int, list[Coordinate]] = field(default_factory=dict)
    elements: list[RigidElement] = field(default_factory=list)
    spots: dict[Spot, int] = field(default_factory=dict)  # numbers of points of pairs

    @cached_property
    def directions(self) -> Floats:
        """Unit vectors (3 or 2, 3) of free translations."""
        return np.eye(3) if self.plane is None else self.plane.axes

    @cached_property
    def axes(self) -> Floats:
        """Unit vectors (3 or 1, 3) about which free rotations are."""
        return np.eye(3) if self.plane is None else self.plane.normal[None]

    @property
    def count(self) -> int:
        """Coordinates, without those that are driven."""
        return self.own[-1].stop

    def coordinate(self, number: int) -> Coordinate:
        """Made when it is asked for, if its vertex has no parent."""
        if number in self.coordinates:
            return self.coordinates[number]
        v = bisect_right(self.own, number, key=lambda own: own.start) - 1
        place = number - self.own[v].start
        shifts = len(self.directions)
        if place < shifts:
            return Coordinate("translation", v, number, self.directions[place])
        return Coordinate("rotation", v, number, self.axes[place - shifts], centre=Spot(v))

    def spot_number(self, spot: Spot | None) -> int:
        """Number of a point in :attr:`spots`, -1 for none."""
        return -1 if spot is None else self.spots.setdefault(spot, len(self.spots))

    @cached_property
    def centres(self) -> IndexArray:
        """Centres (K,) of coordinates of vertices with joints among :attr:`spots`, else -1."""
        out = np.full(self.count, -1)
        for v in {v for edge in self.edges for v in (edge.child, edge.parent)}:
            for k in self.own[v] if v < len(self.own) else ():
                out[k] = self.spot_number(self.coordinate(k).centre)
        return out

    @cached_property
    def pairs(self) -> Pairs:
        """Pairs of vertices with a parent, by all coordinates above them.

        For a chain their number is the square of its length.
        """
        children = {edge.parent for edge in self.edges}
        moving = {}
        for v in self.free:
            if v in children:
                centres = [(k, self.coordinate(k).centre) for k in self.own[v]]
                moving[v] = Pairs.of([(v, k, self.spot_number(at), True) for k, at in centres])
        for edge in self.edges:
            own = Pairs.of(self.own_pairs(edge))
            above = moving.get(edge.parent)
            moving[edge.child] = (
                own if above is None else Pairs.joined([self._passed_on(edge, above), own])
            )
        return Pairs.joined([moving[edge.child] for edge in self.edges])

    def _passed_on(self, edge: Edge, above: Pairs) -> Pairs:
        """A child, by what moves its parent."""
        fulcrum = self.spot_number(self.fulcrum(edge))
        turned = (above.target >= 0) & above.rotates & self.is_frame[edge.parent]
        return Pairs(
            np.full(len(turned), edge.child),
            above.number,
            np.where(turned, fulcrum, above.target),
            turned & self.relative(edge),
        )

    def relative(self, edge: Edge) -> bool:
        """True if a child's rotation is relative to its parent's."""
        return self.freedom(edge).turns is not None and self.is_frame[edge.child]

    def fulcrum(self, edge: Edge) -> Spot:
        """The point that moves as if fixed to the parent and, apart from the slides, the child."""
        if self.relative(edge):
            return Spot(edge.child)
        return edge.end.b if self.freedom(edge).slides else edge.parent_spot

    def own_pairs(self, edge: Edge) -> list[tuple[int, int, int, bool]]:
        """A child, by the coordinates of its joint: rows of :class:`Pairs`."""
        c = edge.child
        pairs = []
        for k in self.own[c]:
            kind = self.coordinate(k).kind
            if kind == "slide":
                pairs.append((c, k, -1, False))
            else:
                sphere = kind == "sphere"
                target = self.spot_number(edge.child_spot if sphere else Spot(c))
                pairs.append((c, k, target, not sphere))
        return pairs

    def freedom(self, edge: Edge) -> Freedom:
        """Relative motions that a joint leaves free, in the plane if there is one."""
        plane = self.plane
        return edge.freedom if plane is None else edge.freedom.within(plane.normal)


def build_tree(
    is_frame: list[bool],
    ends: list[End],
    elements: Sequence[RigidElement] = (),
    plane: Plane | None = None,
) -> Tree:
    """Breadth-first spanning tree and its coordinates.

    Parameters
    ----------
    is_frame : list of bool
        Of the structural vertices; higher numbers in `ends` are ground frames.
    ends : list of End
    elements : sequence of RigidElement
        Those that close loops stay out of the tree.
    plane : Plane, optional
        To which all motion is confined.
    """
    nv = len(is_frame)
    tree = Tree(is_frame, plane)
    edges = _connect(nv, ends, tree, elements)
    by_child = {edge.child: edge for edge in edges}
    count = np.where(is_frame, len(tree.directions) + len(tree.axes), len(tree.directions))
    count[[*by_child]] = 0
    before = count.cumsum().tolist()  # coordinates of vertices without a parent
    adding = _Adding(tree)
    for v in sorted(by_child):  # numbering in vertex order keeps neighbours close
        count[v] = adding.vertex(v, by_child[v], before[v])
    first = (count.cumsum() - count).tolist()
    tree.own = [range(k, k + size) for k, size in zip(first, count.tolist(), strict=True)]
    for k, coordinate in enumerate(tree.driven):
        coordinate.number = tree.count + k
    tree.edges = edges
    return tree


def _connect(
    nv: int,
    ends: list[End],
    tree: Tree,
    elements: Sequence[RigidElement],
) -> list[Edge]:
    rigid = _RigidElements(elements)
    around: dict[int, list[int]] = {}
    for j, end in enumerate(ends):
        for spot in (end.a, end.b):
            around.setdefault(min(spot.vertex, nv), []).append(j)
    linked = around.keys() | rigid.of.keys()
    tree.depth = dict.fromkeys(range(nv), 0)
    seen = set()
    used = set()
    edges = []
    for root in [nv, *(v for v in range(nv) if v in linked)]:
        if root in seen:
            continue
        seen.add(root)
        queue = deque([root])
        while queue:
            v = queue.popleft()
            for j in around.get(v, []):
                end = ends[j]
                a = end.a
                b = end.b
                parent, child = (a, b) if min(a.vertex, nv) == v else (b, a)
                if j in used or child.vertex in seen or child.vertex >= nv:
                    continue
                used.add(j)
                seen.add(child.vertex)
                tree.depth[child.vertex] = tree.depth.get(parent.vertex, 0) + 1
                sign = 1.0 if child is b else -1.0
                edges.append(Edge(end, child.vertex, parent.vertex, child, parent, sign))
                queue.append(child.vertex)
            queue += rigid.children(v, seen, tree, edges)
    below = {edge.child for edge in edges}
    tree.free = [v for v in range(nv) if v not in below]
    tree.loops = [end.joint for j, end in enumerate(ends) if j not in used]  # type: ignore[misc]
    return edges


class _RigidElements:
    """Rigid elements that the tree may go along, each once."""

    def __init__(self, elements: Sequence[RigidElement]):
        self.of: dict[int, list[RigidElement]] = {}  # by vertex
        for element in elements:
            for v in element.vertices:
                self.of.setdefault(v, []).append(element)
        self._done: set[int] = set()

    def children(self, v: int, seen: set[int], tree: Tree, edges: list[Edge]) -> list[int]:
        """Vertices that are new from v on; an element with others that are not closes a loop."""
        out = []
        for element in self.of.get(v, []):
            others = [c for c in element.vertices if c != v]
            if id(element) not in self._done and not seen.intersection(others):
                tree.elements.append(element)
                for c in others:
                    end = End(element, Spot(v, element.arm(v, c)), Spot(c))
                    tree.depth[c] = tree.depth[v] + 1
                    edges.append(Edge(end, c, v, end.b, end.a, 1.0))
                seen.update(others)
                out += others
            self._done.add(id(element))
        return out


class _Adding:
    """Adds the coordinates of vertices with a parent, one vertex after the other."""

    def __init__(self, tree: Tree):
        self.tree, self.v, self._before = tree, -1, 0
        self.axes = list(tree.axes)

    def add(self, kind: str, axis: Floats, drive: int | None = None, **more: object) -> Coordinate:
        tree = self.tree
        number = self._before + len(self.tree.coordinates)
        new = Coordinate(kind, self.v, number, axis, drive=drive, **more)  # type: ignore[arg-type]
        if drive is None:
            tree.coordinates[number] = new
        else:
            tree.driven.append(new)
        return new

    def vertex(self, v: int, edge: Edge, before: int) -> int:
        """Add those of a vertex behind as many of vertices without a parent; how many these are."""
        self.v, self._before, known = v, before, len(self.tree.coordinates)
        if not isinstance(edge.joint, RigidElement):
            self._joint(edge, edge.joint)
        return len(self.tree.coordinates) - known

    def _joint(self, edge: Edge, joint: Joint) -> None:
        freedom, a, b = self.tree.freedom(edge), joint.a, joint.b
        if freedom.sphere:
            # in space the axes are those normal to the arm where a step starts
            for axis in np.zeros((2, 3)) if self.tree.plane is None else self.tree.axes:
                self.add("sphere", axis, centre=edge.parent_spot)
        driven = edge.end.driven
        for slide in freedom.slides:
            left = edge.sign * a.material(slide.left)
            right = a.material(slide.right)
            new = self.add("slide", left, driven.get(slide.name), guide=edge.guide, right=right)
            self.tree.slides.setdefault(self.v, []).append(new)
        if not self.tree.is_frame[self.v]:
            return
        centre = edge.end.b if freedom.slides else edge.child_spot
        if freedom.turns is None:
            for axis in self.axes:
                self.add("rotation", axis, centre=centre)
            return
        # relative rotations are composed from the parent outwards
        for turn in freedom.turns if edge.sign > 0 else reversed(freedom.turns):
            place, guide = (a, edge.guide) if turn.side == "a" else (b, edge.end.b.vertex)
            axis = edge.sign * place.material(turn.axis)
            new = self.add("axis", axis, driven.get(turn.name), guide=guide, centre=centre)
            self.tree.turns.setdefault(self.v, []).append(new)
