"""Groups of equal blocks: all beam elements of one order, single frames, mass points.

The tangent of a step is a list of block arrays, one for each group. Treatments know the groups'
connectivity and nothing else of the items; items never see a treatment.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..beam import Beam
from ..kernels import BeamElements, beam_force, beam_strain, beam_stress, beam_tangent
from ..types import Array, Floats, IndexArray

__all__ = ["BeamGroup", "Group"]


@dataclass(eq=False)
class Group:
    """Blocks of one size.

    Attributes
    ----------
    vertices : (ne, nn) int array
        Vertices of each block; all frames (12 coordinates each) or all points (3).
    rows : (ne, r) int array
        Rows of y of each block, in the block's order.
    mass : (ne, 3 r, 3 r) array
        Constant mass.
    framed : bool
        Frames or points.
    """

    vertices: IndexArray
    rows: IndexArray
    mass: Floats
    framed: bool = True

    @property
    def dofs(self) -> IndexArray:
        """Numbers in q of each block, (ne, 3 r)."""
        return (3 * self.rows[:, :, None] + np.arange(3)).reshape(len(self.rows), -1)


def mass_blocks(scalar: Floats) -> Floats:
    """(ne, r, r) without -> (ne, 3r, 3r) with the factor I_3."""
    ne, r = scalar.shape[:2]
    return np.einsum("eij,cd->eicjd", scalar, np.eye(3)).reshape(ne, 3 * r, 3 * r)


class BeamGroup(Group):
    """All beam elements of one order, of all beams: one call of each kernel."""

    def __init__(self, beams: list[tuple[Beam, int, int]]) -> None:
        """`beams`: (beam, its first vertex, its first row of y)."""
        first = beams[0][0].elements
        connectivity = [(beam.basis.connectivity, v, r) for beam, v, r in beams]
        vertices = np.concatenate([c + v for c, v, _ in connectivity])
        rows = np.concatenate(
            [(r + 4 * c[:, :, None] + np.arange(4)).reshape(len(c), -1) for c, _, r in connectivity]
        )
        super().__init__(
            vertices, rows, np.concatenate([mass_blocks(b.scalar_mass()) for b, _, _ in beams])
        )
        stop = np.cumsum([len(c) for c, _, _ in connectivity])
        #: which elements are whose
        self.slices = {
            id(beam): slice(int(b - len(c)), int(b))
            for (beam, _, _), (c, _, _), b in zip(beams, connectivity, stop, strict=True)
        }
        es = [beam.elements for beam, _, _ in beams]
        turned = any(e.rotations is not None for e in es)
        self.elements = BeamElements(
            np.concatenate([e.lengths for e in es]),
            first.points,
            first.weights,
            first.table,
            np.concatenate([e.stiffness for e in es]),
            np.concatenate([e.reference for e in es]),
            np.concatenate([beam.rotations for beam, _, _ in beams]) if turned else None,
        )

    def strain(self, y: Array) -> tuple[Array, Array]:
        """Strains (ne, ng, 6) and B (ne, 6 ng, 12 nn) at configuration y (nv, 3)."""
        return beam_strain(self.elements, y[self.rows].reshape(len(self.rows), -1))

    def stress(self, eps: Array) -> Array:
        """Stress resultants (ne, ng, 6)."""
        return beam_stress(self.elements, eps)

    def force(self, B: Array, stress: Array) -> Array:
        """Nodal forces of each element (ne, 12 nn)."""
        return beam_force(self.elements, B, stress)

    def tangent(
        self, left: Array, right: Array, stress: Array, material: float, geometric: float
    ) -> Array:
        """See :func:`skfem_cosserat.kernels.beam_tangent`."""
        return beam_tangent(self.elements, left, right, stress, material, geometric)
