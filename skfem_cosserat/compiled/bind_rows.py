"""From constraint rows with multipliers to the arrays of the compiled kernels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..model import System
from ..model.system import Coordinates
from ..types import Floats, IndexArray
from .plan import Plan, RowBlock, places_of
from .structures import integers
from .tables import rows


def bound_rows(coordinates: Coordinates, plan: Plan) -> dict[str, Any]:
    """Constraint rows with multipliers, as lists of terms; see :mod:`.rows`."""
    system = coordinates.system
    count = len(system.origin_rows)
    vertex, component = places_of(system)
    vertex = np.where(vertex < count, vertex, -1)
    numbers, block, place = _numbered(system, plan.rows)
    terms, cosines = system.constraints.terms(), system.branch_cosines.terms()
    own = np.flatnonzero(block[terms.row] >= 0)
    k, a, b = terms.row[own], terms.left[own], terms.right[own]
    e, u, v = block[k], vertex[a], vertex[b]
    products = [e, place[k], a, b, u, component[a], v, component[b]]
    products += [plan.slots(*ends) for ends in ((u, v), (v, u), (e, u), (u, e), (e, v), (v, e))]
    products += [terms.drive_row[own], terms.drive_component[own]]
    each = (terms.linear_row[:, None] + np.arange(3)).ravel()
    n, linear = np.tile(np.arange(3), len(terms.linear_row)), np.repeat(terms.linear, 3)
    of_vectors = np.flatnonzero(block[each] >= 0)
    k, a, n = each[of_vectors], linear[of_vectors], n[of_vectors]
    e, v = block[k], vertex[a]
    vectors = [e, place[k], a, n, v, component[a], plan.slots(e, v), plan.slots(v, e)]
    inner = [[v for v in each.vertices if v < count] for each in plan.rows]
    u, e, v = (
        np.array(
            [(u, k, v) for k, own in enumerate(inner, count) for u in own for v in own],
            dtype=np.int64,
        )
        .reshape(-1, 3)
        .T
    )
    pairs = np.stack([plan.slots(u, e), plan.slots(e, v), plan.slots(u, v)], axis=-1)
    turned = np.zeros((len(cosines.row), 16), dtype=np.int64)
    turned[:, [rows.BLOCK, rows.LEFT, rows.RIGHT]] = np.column_stack(cosines[:3])
    turned[:, [rows.DRIVE, rows.COMPONENT]] = np.column_stack(cosines[4:6])
    return {
        "row_products": np.stack(products, axis=-1),
        "row_factors": terms.factor[own],
        "row_linear": np.stack(vectors, axis=-1),
        "row_linear_factors": np.repeat(terms.linear_factor, 3)[of_vectors],
        **_of_blocks(coordinates, plan, numbers, terms.constant),
        "row_pairs": pairs,
        "cosines": turned,
        "cosine_factors": np.array(cosines.factor, dtype=float),
        "cosine_constant": np.array(cosines.constant, dtype=float),
        "cosine": np.zeros(len(cosines.constant)),
    }


def _numbered(
    system: System, blocks: Sequence[RowBlock]
) -> tuple[IndexArray, IndexArray, IndexArray]:
    """Constraint rows of blocks (k, 6), -1 for none; of each row block and place, or -1.

    Blocks are numbered behind the vertices.
    """
    numbers = np.full((len(blocks), 6), -1)
    for own, each in zip(numbers, blocks, strict=True):
        own[: len(each.rows)] = each.rows
    block, place = np.full((2, system.m), -1)
    k, n = np.nonzero(numbers >= 0)
    block[numbers[k, n]], place[numbers[k, n]] = len(system.origin_rows) + k, n
    return numbers, block, place


def _of_blocks(
    coordinates: Coordinates, plan: Plan, numbers: IndexArray, constant: Floats
) -> dict[str, Any]:
    """Constants, sizes and weights of constraint rows by block; the frame a block turns with."""
    system = coordinates.system
    magnitude = system.constraints.magnitudes(system.extend(system.q0, system.since))
    none, size = numbers < 0, np.where(magnitude > 0, magnitude, 1.0)
    first = [[v for v in (*b.waits, *b.vertices) if v in b.vertices] for b in plan.rows]
    count = len(system.origin_rows)
    framed = [[v for v in own if v < count and system.is_frame[v]] for own in first]
    weight, weighted = _weights(system, numbers, plan.rows), []
    for k in np.flatnonzero(weight.any(1)).tolist():
        own = [v for v in plan.rows[k].vertices if v < count]
        weighted += [(k, u, v) for u in own for v in own]
    of, u, v = np.array(weighted, dtype=np.int64).reshape(-1, 3).T
    slots = of, plan.slots(u, count + of), plan.slots(count + of, v), plan.slots(u, v)
    return {
        "row_constant": np.where(none, 0.0, constant[numbers]) if numbers.size else 0.0 * numbers,
        "row_size": np.where(none, 1.0, size[numbers]) if numbers.size else 0.0 * numbers,
        "row_on": (~none & ~np.isin(numbers, coordinates.closure.rows)).astype(float),
        "row_weight": weight,
        "row_weighted": np.stack(slots, axis=-1),
        "row_triple": np.full(len(plan.rows), -1),
        "row_owner": integers([own[0] if own else -1 for own in framed]),
        "row_numbers": numbers,
    }


#: rotary inertia of a frame, by its largest, below which rows have to hold it for its block to be
#: regular
THIN = 1e-6


def _weights(system: System, numbers: IndexArray, blocks: Sequence[RowBlock]) -> Floats:
    """Weights of rows (k, 6) of blocks that hold a frame which lacks rotary inertia, else zero.

    Any positive ones do. Of vectors the frame's mass (kg), of others its inertia (kg m^2).
    """
    weight = np.zeros(numbers.shape)
    if (group := system.frame_group) is None:
        return weight
    scalar = group.scalar_mass
    first, mass = scalar[:, 1:, 0], scalar[:, 0, 0]
    some = np.where(mass > 0, mass, 1.0)  # forces act on nodes of beams without masses, too
    euler = scalar[:, 1:, 1:] - first[:, :, None] * first[:, None] / some[:, None, None]
    values = np.linalg.eigvalsh(euler)
    least, inertia = values[:, 0] + values[:, 1], values.sum(1)
    thin = {int(group.vertices[k, 0]): k for k in np.flatnonzero(least < THIN * inertia)}
    vectors = _of_vectors(system) if thin else set()
    for own, row, block in zip(weight, numbers.tolist(), blocks, strict=True):
        for k in (thin[v] for v in block.vertices if v in thin):
            sizes = [0.0 if n < 0 else mass[k] if n in vectors else inertia[k] for n in row]
            own[:] = np.maximum(own, sizes)
    return weight


def _of_vectors(system: System) -> set[int]:
    """Constraint rows that are components of vectors in space."""
    return {int(k) + i for k in system.constraints.terms().linear_row for i in range(3)}


def choose_rows(coordinates: Coordinates, fields: dict[str, Any], chosen: IndexArray) -> None:
    """Take these rows (r,) of closed loops, and none of the others.

    Those that are a vector in space turn with the frame of a vertex while factors are kept: then
    all of them have to be there.
    """
    system = coordinates.system
    numbers, on = fields["row_numbers"], fields["row_on"]
    there = np.ones(system.m + 1, dtype=bool)
    there[coordinates.closure.rows] = there[-1] = False
    there[chosen] = True
    on[:] = there[numbers]
    vectors = _of_vectors(system)
    for k, own in enumerate(numbers.tolist()):
        places = [i for i, number in enumerate(own) if number in vectors]
        whole = len(places) > 1 and fields["row_owner"][k] >= 0 and on[k, places].all()
        fields["row_triple"][k] = places[0] if whole else -1
