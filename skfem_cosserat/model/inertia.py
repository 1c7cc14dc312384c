"""The constant mass matrix of a scene."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.sparse import coo_matrix, csr_matrix

from ..beam import Beam
from ..body import MassPoint, RigidBody
from ..types import Floats, IndexArray

__all__ = ["Lump", "assemble_mass"]

#: Of a body or mass point: vertex, scalar mass (4, 4) or (1, 1), whether that is a frame's.
Lump = tuple[int, Floats, bool]


def assemble_mass(
    structures: Sequence[Beam | RigidBody | MassPoint],
    first: Mapping[int, tuple[int, int]],
    size: int,
) -> tuple[csr_matrix, list[Lump]]:
    """Mass matrix (64), (114) without the factor I_3, and the lumps on single vertices.

    Parameters
    ----------
    structures : sequence of items
    first : dict
        ``id(item) -> (first vertex, first row of y)``.
    size : int
        Rows of y.
    """
    i, j, c = [], [], []

    def add(rows: IndexArray, blocks: Floats) -> None:
        ne, r = rows.shape
        i.append(np.broadcast_to(rows[:, :, None], (ne, r, r)).ravel())
        j.append(np.broadcast_to(rows[:, None, :], (ne, r, r)).ravel())
        c.append(blocks.ravel())

    lumps: list[Lump] = []
    for item in structures:
        if isinstance(item, Beam):
            row = first[id(item)][1]
            nodes = item.basis.connectivity
            rows = row + 4 * nodes[:, :, None] + np.arange(4)
            add(rows.reshape(len(nodes), -1), item.scalar_mass())
            continue
        host, node = (item, 0) if item.on is None else (item.on.item, item.on.vertex)
        vertex, row = first[id(host)]
        block = item.scalar_mass()
        framed = len(block) == 4
        lumps.append((vertex + node, block, framed))
        step = 4 if framed or isinstance(host, Beam | RigidBody) else 1
        add(row + step * node + np.arange(len(block))[None], block[None])
    ij = (np.concatenate(i), np.concatenate(j))
    mass = coo_matrix((np.concatenate(c), ij), shape=(size, size)).tocsr()
    mass.eliminate_zeros()
    return mass, lumps
