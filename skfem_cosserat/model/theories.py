"""Constraint rows that hold strains of beams, see :mod:`skfem_cosserat.theory`.

At each Gauss point strains (:data:`skfem_cosserat.strain.FORMS`) keep their values in the
reference: quadratic rows as those of joints. With the weight w of the point and the length l of the
element a multiplier is ``w l`` times a stress resultant, as the balance holds ``int B^T S ds``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..frames import is_beam
from ..strain import FORMS
from ..types import Floats, IndexArray
from .groups import Structure
from .quadratic import ConstraintBuilder
from .tree import ConstrainedElement

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

    @property
    def turning(self) -> NDArray[np.bool_]:
        """Which of the strains are bending or torsion."""
        return np.array(self.held) >= 3

    @property
    def can_bend(self) -> bool:
        """Whether rotations that the Gauss points do not see are held by bending alone."""
        return not {3, 4} & set(self.held)

    @property
    def eliminable(self) -> bool:
        """Whether the rows of forces give the line of an element from its directors."""
        interpolation = self.beam.basis.interpolation
        return {0, 1} <= set(self.held) and interpolation.points == interpolation.order

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
        rows = slice(start, build.size)
        out.append(TheoryRows(beam, rows, beam.theory.held, shape, vertex))
    return out


def _products(beam: Beam, row: int) -> Iterator[tuple[Terms, Terms, float | None]]:
    """Left and right sums of each product, and its factor; None: the row is complete."""
    basis = beam.basis
    N, slope = basis.shape(basis.points), basis.dshape(basis.points)
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


def constrained_elements(theories: Sequence[TheoryRows]) -> list[ConstrainedElement]:
    """Elements whose line follows from their directors."""
    return [
        ConstrainedElement(
            each.beam,
            e,
            tuple(int(each.first + a) for a in nodes),
            tuple(nodes.tolist()),
            _stretches(each),
            len(each.held) == 6,
        )
        for each in theories
        if each.eliminable
        for e, nodes in enumerate(each.beam.basis.connectivity)
    ]


def _stretches(each: TheoryRows) -> int:
    return 0 if 2 in each.held else each.shape[1]


def rows_beside_tree(
    theories: Sequence[TheoryRows], used: Sequence[ConstrainedElement]
) -> IndexArray:
    """Rows that the tree does not fulfil by itself: torsion, elements that close loops."""
    done = {(id(element.item), element.number) for element in used}
    out = [np.zeros(0, dtype=np.int64)]
    for each in theories:
        numbers = each.numbers
        kept = np.array([(id(each.beam), e) not in done for e in range(each.shape[0])])
        own = np.zeros(each.shape[2], dtype=bool) if len(each.held) == 6 else each.turning
        left = kept[:, None, None] | own
        out.append(numbers[np.broadcast_to(left, each.shape)])
    return np.sort(np.concatenate(out))
