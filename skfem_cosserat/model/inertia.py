"""The constant mass matrix of a scene, and the factors of damping in proportion to it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from scipy.sparse import coo_matrix, csr_matrix

from ..body import MassPoint, RigidBody
from ..damping import RayleighDamping
from ..errors import InputError
from ..kinds import is_beam
from ..types import Floats, IndexArray

if TYPE_CHECKING:
    from ..beam import Beam

__all__ = ["Lump", "Structure", "assemble_mass", "damping_factors", "lumped"]

Structure: TypeAlias = "Beam | RigidBody | MassPoint"

#: Of a body or mass point: vertex, scalar mass (4, 4) or (1, 1), whether that is a frame's.
Lump = tuple[int, Floats, bool]


def assemble_mass(
    structures: Sequence[Structure],
    first: Mapping[int, tuple[int, int]],
    size: int,
    factors: Mapping[int, float] | None = None,
) -> tuple[csr_matrix, list[Lump]]:
    """Mass matrix (64), (114) without the factor I_3, and the lumps on single vertices.

    Parameters
    ----------
    structures : sequence of items
    first : dict
        ``id(item) -> (first vertex, first row of y)``.
    size : int
        Rows of y.
    factors : dict, optional
        ``id(item) -> alpha``, of which the mass is multiplied (zero if not there): drag matrix.
    """
    i, j, c = [], [], []

    def add(rows: IndexArray, blocks: Floats) -> None:
        ne, r = rows.shape
        i.append(np.broadcast_to(rows[:, :, None], (ne, r, r)).ravel())
        j.append(np.broadcast_to(rows[:, None, :], (ne, r, r)).ravel())
        c.append(blocks.ravel())

    lumps: list[Lump] = []
    for item in structures:
        mass_of_item = item.scalar_mass()
        if factors is not None:
            mass_of_item = factors.get(id(item), 0.0) * mass_of_item
        if is_beam(item):
            row = first[id(item)][1]
            nodes = item.basis.connectivity
            rows = row + 4 * nodes[:, :, None] + np.arange(4)
            add(rows.reshape(len(nodes), -1), mass_of_item)
            continue
        place = lumped(item).on
        host, node = (item, 0) if place is None else (place.item, place.vertex)
        vertex, row = first[id(host)]
        framed = len(mass_of_item) == 4
        lumps.append((vertex + node, mass_of_item, framed))
        step = 4 if framed or is_beam(host) or isinstance(host, RigidBody) else 1
        add(row + step * node + np.arange(len(mass_of_item))[None], mass_of_item[None])
    ij = (np.concatenate(i), np.concatenate(j))
    mass = coo_matrix((np.concatenate(c), ij), shape=(size, size)).tocsr()
    mass.eliminate_zeros()
    return mass, lumps


def lumped(item: Structure) -> RigidBody | MassPoint:
    """An item that is no beam."""
    assert isinstance(item, RigidBody | MassPoint)
    return item


def damping_factors(
    structures: Sequence[Structure], dampings: Sequence[RayleighDamping]
) -> tuple[dict[int, float], dict[int, float]]:
    """Sums of alpha and of beta by ``id(item)``, of items that have any.

    Raises
    ------
    InputError
        If a damping of stiffness alone meets no beam.
    """
    alpha: dict[int, float] = {}
    beta: dict[int, float] = {}
    for damping in dampings:
        items = structures if damping.items is None else damping.items
        beams = [item for item in items if is_beam(item)]
        if not beams and not damping.mass:
            raise InputError(damping.label, "damps the stiffness of beams, and there are none")
        for item in items if damping.mass else ():
            alpha[id(item)] = alpha.get(id(item), 0.0) + damping.mass
        for item in beams if damping.stiffness else ():
            beta[id(item)] = beta.get(id(item), 0.0) + damping.stiffness
    return alpha, beta
