"""Constraint rows that hold strains of beams, see :mod:`skfem_cosserat.theory`.

At each Gauss point strains (:data:`skfem_cosserat.strain.FORMS`) keep their values in the
reference: quadratic rows as those of joints. With the weight w of the point and the length l of the
element a multiplier is ``w l`` times a stress resultant, as the balance holds ``int B^T S ds``.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from ..frames import is_beam
from ..joint import Joint
from ..strain import FORMS
from ..types import NO_INDICES, Floats, IndexArray
from .groups import Structure
from .quadratic import ConstraintBuilder
from .tree import RigidElement, Tree

if TYPE_CHECKING:
    from ..beam import Beam

Terms = list[tuple[int, float]]


@dataclass(frozen=True, eq=False)
class TheoryRows:
    """Rows of a beam that hold strains: those of an element, point by point, side by side.

    Attributes
    ----------
    beam : Beam
    rows : slice
    held : tuple of int
        Numbers of the strains.
    shape : (int, int, int)
        Elements, Gauss points, strains: of the rows' numbers.
    first : int
        First vertex of the beam.
    """

    beam: Beam
    rows: slice
    held: tuple[int, ...]
    shape: tuple[int, int, int]
    first: int

    @property
    def numbers(self) -> IndexArray:
        """Rows (elements, points, strains)."""
        return np.arange(self.rows.start, self.rows.stop).reshape(self.shape)

    def vertices(self, element: int) -> list[int]:
        """Vertices of an element, in order."""
        return [int(self.first + node) for node in self.beam.basis.connectivity[element]]

    @property
    def can_bend(self) -> bool:
        """True if no bending strain is held.

        Then bending alone holds rotations that the Gauss points do not see.
        """
        return not {3, 4} & set(self.held)

    @property
    def bijective(self) -> bool:
        """True if strains at the Gauss points, and one node, give all nodes of an element."""
        interpolation = self.beam.basis.interpolation
        return interpolation.points == interpolation.order

    def stress(self, multipliers: Floats) -> Floats:
        """Resultants (..., ne, ng, 6) of what is held, from multipliers (..., m); zeros else."""
        found = multipliers[..., self.rows].reshape(*multipliers.shape[:-1], *self.shape)
        out = np.zeros((*found.shape[:-1], 6))
        out[..., list(self.held)] = found / self.beam.elements.measure
        return out


def theory_of(theories: Sequence[TheoryRows], beam: Beam) -> TheoryRows | None:
    """Rows of a beam; None if all of its strains are free."""
    return next((each for each in theories if each.beam is beam), None)


def add_theory_rows(
    build: ConstraintBuilder,
    structures: Sequence[Structure],
    first: Mapping[int, tuple[int, int]],
) -> list[TheoryRows]:
    """Rows of all beams that hold strains; `first` vertex and row of y by ``id(item)``."""
    out = []
    for beam in structures:
        if not is_beam(beam) or not beam.theory.held:
            continue
        vertex, row = first[id(beam)]
        start = build.size
        for left, right, factor in _products(beam, row):
            if factor is None:
                build.end_row()
            else:
                build.add(left, right, factor)
        shape = len(beam.elements.lengths), len(beam.elements.points), len(beam.theory.held)
        out.append(TheoryRows(beam, slice(start, build.size), beam.theory.held, shape, vertex))
    return out


def _products(beam: Beam, row: int) -> Iterator[tuple[Terms, Terms, float | None]]:
    """Left and right sums of each product, and its factor; None: the row is complete."""
    basis = beam.basis
    N = basis.shape(basis.points)
    slope = basis.dshape(basis.points)
    for e, nodes in enumerate(basis.connectivity):
        origins = (row + 4 * nodes).tolist()
        for g in range(len(basis.points)):
            fields, slopes = (
                [_field(beam, e, origins, values, i) for i in range(4)]
                for values in (N[:, g], slope[:, g] / basis.lengths[e])
            )
            for strain in beam.theory.held:
                for a, b, factor in FORMS[strain]:
                    yield fields[a], slopes[b], factor
                yield [], [], None


def _field(beam: Beam, e: int, origins: Sequence[int], values: Floats, i: int) -> Terms:
    """Place (0) or director d_i of the section, interpolated with values of shape functions."""
    if i == 0:
        return list(zip(origins, values.tolist(), strict=True))
    return [
        (origin + 1 + j, float(value * factor))
        for origin, value, turned in zip(origins, values, beam.rotations[e, :, i - 1], strict=True)
        for j, factor in enumerate(turned)
        if factor
    ]


def rigid_elements(theories: Sequence[TheoryRows]) -> list[RigidElement]:
    """Elements that hold all strains, and with them their nodes."""
    return [
        RigidElement(each.beam, e, tuple(each.vertices(e)), tuple(nodes.tolist()))
        for each in theories
        if len(each.held) == 6 and each.bijective
        for e, nodes in enumerate(each.beam.basis.connectivity)
    ]


#: a beam that holds strains, and the number of one of its elements
HeldElement = tuple[TheoryRows, int]


class Spanning:
    """Forest of the joints of a tree and, as far as they close no loop, elements that hold strains.

    An element closes a loop if joints, or elements before it, connect two of its nodes. Rows of the
    others are independent of each other in any configuration: strains at the Gauss points follow
    from the motion of one node against the next.

    Parameters
    ----------
    tree : Tree
    theories : sequence of TheoryRows

    Attributes
    ----------
    joining, closing : list of (TheoryRows, int)
        Elements that are not in the tree.
    """

    def __init__(self, tree: Tree, theories: Sequence[TheoryRows]):
        self._ground = len(tree.is_frame)
        self.joining: list[HeldElement] = []
        self.closing: list[HeldElement] = []
        links: dict[int, list[tuple[int, Joint | RigidElement | HeldElement]]] = {}
        part = list(range(self._ground + 1))

        def part_of(vertex: int) -> int:
            while part[vertex] != vertex:
                part[vertex] = vertex = part[part[vertex]]
            return vertex

        def link(a: int, b: int, by: Joint | RigidElement | HeldElement) -> None:
            a, b = (min(vertex, self._ground) for vertex in (a, b))
            part[part_of(a)] = part_of(b)
            links.setdefault(a, []).append((b, by))
            links.setdefault(b, []).append((a, by))

        for edge in tree.edges:
            link(edge.parent, edge.child, edge.joint)
        done = {(id(element.item), element.number) for element in tree.elements}
        for each in theories:
            for e in range(each.shape[0]):
                if (id(each.beam), e) in done:
                    continue
                first, *others = each.vertices(e)
                parts = {part_of(vertex) for vertex in (first, *others)}
                joins = each.bijective and len(parts) == 1 + len(others)
                (self.joining if joins else self.closing).append((each, e))
                for other in others if joins else ():
                    link(first, other, (each, e))
        self._above = {}
        seen = set()
        for root in (self._ground, *links):
            waiting = [] if root in seen else [root]
            seen.add(root)
            for vertex in waiting:
                for other, by in links.get(vertex, ()):
                    if other not in seen:
                        self._above[other] = vertex, by
                        seen.add(other)
                        waiting.append(other)

    def around(self, vertices: Sequence[int]) -> set[Joint | RigidElement | HeldElement]:
        """Joints and elements on the way from one vertex to the next."""
        ways = [set(self._way_up(vertex)) for vertex in vertices]
        return set().union(*(a ^ b for a, b in pairwise(ways)))

    def _way_up(self, vertex: int) -> Iterator[Joint | RigidElement | HeldElement]:
        while vertex in self._above:
            vertex, by = self._above[vertex]
            yield by


def rows_of(elements: Iterable[HeldElement]) -> IndexArray:
    """Constraint rows of elements."""
    rows = [each.numbers[e].ravel() for each, e in elements]
    return np.concatenate([NO_INDICES, *rows])
