"""From constraint rows with multipliers to the arrays of the compiled kernels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..model import System
from ..model.groups import BeamGroup
from ..types import Floats, IndexArray
from .plan import Plan, RowBlock
from .structures import integers, roomy
from .tables import rows

__all__ = ["bound_held", "bound_rows", "choose_rows", "first_held"]


def bound_rows(system: System, plan: Plan) -> dict[str, Any]:
    """Constraint rows with multipliers, as lists of terms; see :mod:`.rows`."""
    count = len(system.origin_rows)
    size = np.where(system.is_frame, 4, 1)
    every = np.repeat(system.origin_rows - np.cumsum(size) + size, size) + np.arange(size.sum())
    vertex, component = np.full(system.total, -1), np.zeros(system.total, dtype=np.int64)
    vertex[every] = np.repeat(np.arange(count), size)
    component[every] = every - np.repeat(system.origin_rows, size)
    numbers, block, place = _numbered(system, plan.rows)
    terms, cosines = system.constraints.terms(), system.branch_cosines.terms()
    own = np.flatnonzero((block[terms.row] >= 0) & (terms.row < first_held(system)))
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
        **_of_blocks(system, plan, numbers, terms.constant),
        "row_pairs": pairs,
        "cosines": turned,
        "cosine_factors": np.array(cosines.factor, dtype=float),
        "cosine_constant": np.array(cosines.constant, dtype=float),
        "cosine": np.zeros(len(cosines.constant)),
    }


def first_held(system: System) -> int:
    """The first constraint row that is a strain: these come last, and beams evaluate them."""
    return min((each.rows.start for each in system.theory_rows), default=system.m)


def bound_held(
    system: System, group: BeamGroup, plan: Plan, rows: dict[str, Any] | None = None
) -> dict[str, Any]:
    """Strains that elements of a group hold by rows with multipliers, see :mod:`.held`.

    `rows`: arrays of the rows, of :func:`bound_rows`; None: it holds none.
    """
    own = [] if rows is None else system.theory_rows
    theories = [each for each in own if id(each.beam) in group.slices]
    none = np.zeros((0, 6))
    blocks, count = plan.rows, len(system.origin_rows)
    if rows is not None:
        _, block, place = _numbered(system, blocks)
        theories = [each for each in theories if (block[each.numbers] >= 0).any()]
    shape = (0, 1, 0)
    holds = sorted({i for each in theories for i in each.held})
    if theories:
        shape = *group.elements.reference.shape[:2], len(holds)
    nodes = group.vertices.shape[1]
    # the stride of b and of a row of a block in A; the one behind each array is for what is not
    held, on = np.full(shape, 6 * len(plan.diag)), np.full(shape, 6 * len(blocks))
    last = 36 * len(plan.ends)
    down, up = np.full((*shape, nodes), last), np.full((*shape, nodes), last)
    for each in theories:
        e, p, strain = np.nonzero(block[each.numbers] >= 0)
        number = each.numbers[e, p, strain]
        k, c = block[number], place[number]
        e = e + group.slices[id(each.beam)].start
        to = e, p, np.array([holds.index(i) for i in each.held])[strain]
        held[to], on[to] = 6 * k + c, 6 * (k - count) + c
        ends, k, c = group.vertices[e], k[:, None], c[:, None]
        down[to] = 6 * (6 * plan.slots(k, ends) + c)
        up[to] = 36 * plan.slots(ends, k) + c
    return {
        "holds": integers(holds),
        "held": held,
        "held_on": on,
        "held_down": down,
        "held_up": up,
        "row_on": none if rows is None else rows["row_on"],
        "row_weight": none if rows is None else rows["row_weight"],
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


def _of_blocks(system: System, plan: Plan, numbers: IndexArray, constant: Floats) -> dict[str, Any]:
    """What each row is to be, and the size of its terms; whose frame a block turns with."""
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
        "row_on": roomy((~none & ~np.isin(numbers, system.closure.rows)).astype(float)),
        "row_weight": roomy(weight),
        "row_kept": roomy(numbers >= first_held(system)),
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


def choose_rows(system: System, fields: dict[str, Any], chosen: IndexArray) -> None:
    """Take these rows (r,) of closed loops, and none of the others.

    Those that are a vector in space turn with the frame of a vertex while factors are kept: then
    all of them have to be there.
    """
    numbers, on = fields["row_numbers"], fields["row_on"]
    there = np.ones(system.m + 1, dtype=bool)
    there[system.closure.rows] = there[-1] = False
    there[chosen] = True
    on[:] = there[numbers]
    vectors = _of_vectors(system)
    for k, own in enumerate(numbers.tolist()):
        places = [i for i, number in enumerate(own) if number in vectors]
        whole = len(places) > 1 and fields["row_owner"][k] >= 0 and on[k, places].all()
        fields["row_triple"][k] = places[0] if whole else -1
