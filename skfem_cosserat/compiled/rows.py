"""Compiled parts of constraint rows with multipliers: of closed loops, or of all joints.

Rows are quadratic forms of the rows of y, as lists of terms that never change: those of a joint or
of a beam element stand together in a block, which the elimination takes like a vertex, see
:func:`.plan.row_blocks`. Its unknowns are the impulses mu of the rows: they act on the vertices
like loads, and Newton's method solves ``[A G_L^T; G_R 0] [dx; dmu] = -[b; g]``. Where only rows
hold what has no inertia (a thin rod about its axis), A alone is singular: there ``mu + W g`` acts,
g being what the rows gape by, which changes no solution and adds ``G_L^T W G_R`` to A. Rows that
depend on others where a step starts are switched off. Parts take ``(s, m, w, numbers, flag)`` as
those of :mod:`.tree`.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..types import Floats
from .jit import inlined, part
from .numbers import MASS, WEIGHT
from .simd import add_times
from .small import Vector, add_skew, cross, dot, pulled, row, times, unit
from .tables import (
    BLOCK,
    COMPONENT,
    DRIVE,
    LEFT,
    LEFT_BACK,
    LEFT_PLACE,
    LEFT_SLOT,
    LEFT_VERTEX,
    PLACE,
    RIGHT,
    RIGHT_BACK,
    RIGHT_PLACE,
    RIGHT_SLOT,
    RIGHT_VERTEX,
    SLOT,
    SLOT_BACK,
    TERM,
    TERM_BACK,
    TERM_COMPONENT,
    TERM_PLACE,
    TERM_SLOT,
    TERM_VERTEX,
)

#: a cosine, less 1, below which a joint is fulfilled only after half a turn
TURNED_OVER = -1.0


@inlined
def pull(f: Floats, a: int, factor: float, v: Vector) -> None:
    """``f_a += factor v`` for a row that is unknown."""
    if a < f.shape[0]:
        for c in range(3):
            f[a, c] += factor * v[c]


@inlined
def factor_of(table: Any, factors: Floats, t: int, y: Floats) -> float:
    """Factor of a product, which may be prescribed in time by a row of the ground."""
    c = factors[t]
    if table[t, DRIVE] >= 0:
        c *= y[table[t, DRIVE], table[t, COMPONENT]]
    return c


@inlined
def add_forces(s: Any, y: Floats, mu: Floats, f: Floats) -> None:
    """``f += G(y)^T mu``, mu by blocks and places."""
    table, factors, linear = s.row_products, s.row_factors, s.row_linear
    for t in range(table.shape[0]):
        a, b = table[t, LEFT], table[t, RIGHT]
        c = mu[table[t, BLOCK], table[t, PLACE]]
        if c != 0.0:
            c *= factor_of(table, factors, t, y)
            pull(f, a, c, row(y, b))
            pull(f, b, c, row(y, a))
    for t in range(linear.shape[0]):
        if linear[t, TERM] < f.shape[0]:
            c = s.row_linear_factors[t] * mu[linear[t, BLOCK], linear[t, PLACE]]
            f[linear[t, TERM], linear[t, TERM_COMPONENT]] += c


@inlined
def start_gaps(s: Any, m: Any, b: Floats, first: int) -> None:
    """Minus what rows are to be, in blocks from `first` on."""
    constant = s.row_constant
    for k in range(constant.shape[0]):
        for c in range(m.size[first + k]):
            b[first + k, c] = -constant[k, c]


@inlined
def push(s: Any, m: Any, w: Any, numbers: Floats, first: int) -> float:
    """Impulses of blocks from `first` on, ``mu + W g``, into ``w.extra``; the largest relative gap.

    Of the gaps in ``w.b`` those of rows that are not chosen are switched off; ``w.found`` has the
    largest of these, which depend on others.
    """
    on, size, weight, b, mu, acting = s.row_on, s.row_size, s.row_weight, w.b, w.total, w.extra
    mass, largest, found, sum_of_all = numbers[MASS], 0.0, w.found, 0.0
    found[2] = 0.0
    for k in range(on.shape[0]):
        for c in range(m.size[first + k]):
            if on[k, c] == 0.0:
                found[2] = max(found[2], abs(b[first + k, c]) / size[k, c])
            b[first + k, c] *= on[k, c]
            acting[first + k, c] = mu[first + k, c] + mass * weight[k, c] * b[first + k, c]
            gap = abs(b[first + k, c]) / size[k, c]
            sum_of_all += gap
            largest = max(largest, gap)
    return largest if sum_of_all < np.inf else sum_of_all  # NaN as well


@part
def row_force(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Forces by mu, added to ``w.closing``, and what rows gape by: gives the largest, relative."""
    b, y1 = w.b, w.y1
    start_gaps(s, m, b, len(s.row))
    table, linear = s.row_products, s.row_linear
    for t in range(table.shape[0]):
        product = dot(row(y1, table[t, LEFT]), row(y1, table[t, RIGHT]))
        product *= factor_of(table, s.row_factors, t, y1)
        b[table[t, BLOCK], table[t, PLACE]] += product
    for t in range(linear.shape[0]):
        value = y1[linear[t, TERM], linear[t, TERM_COMPONENT]]
        b[linear[t, BLOCK], linear[t, PLACE]] += s.row_linear_factors[t] * value
    gap = push(s, m, w, numbers, len(s.row))
    add_forces(s, pulled(w.y0, w.mid, numbers), w.extra, w.closing)
    return gap


@inlined
def add_line(A: Floats, k: int, place: int, i: int, d: Vector, v: Vector, column: bool) -> None:
    """Row or column ``v . dy`` of a vertex by its twist; y is its i-th row (i > 0: d)."""
    c0 = 0
    if i > 0:
        c0 = 3
        v = cross(d, v)
    for c in range(3):
        if column:
            A[k, c0 + c, place] += v[c]
        else:
            A[k, place, c0 + c] += v[c]


@inlined
def add_curvature(A: Floats, k: int, i: int, j: int, c: float, a: Vector, b: Vector) -> None:
    """``c dy_i . dy_j`` by twists of two vertices, whose rows are a and b there."""
    if i == 0 and j == 0:
        for r in range(3):
            A[k, r, r] += c
    elif i == 0:
        add_skew(A, k, 0, 3, times(-c, b))
    elif j == 0:
        add_skew(A, k, 3, 0, times(c, a))
    else:  # a^ (-b^) = (a . b) I - b a^T
        ab = c * dot(a, b)
        for r in range(3):
            for q in range(3):
                A[k, 3 + r, 3 + q] -= c * b[r] * a[q]
            A[k, 3 + r, 3 + r] += ab


@inlined
def add_weighted(s: Any, w: Any, factor: float) -> None:
    """Add ``G_L^T W G_R`` to the blocks of vertices, from what stands in those with the rows.

    W are the weights of rows times a factor.
    """
    table, weight, A, scratch = s.row_weighted, s.row_weight, w.A, w.scratch
    for t in range(table.shape[0]):
        k, left, right, to = table[t, 0], table[t, 1], table[t, 2], table[t, 3]
        for r in range(weight.shape[1]):
            f = factor * weight[k, r]
            for c in range(weight.shape[1]):
                scratch[0, r, c] = f * A[right, r, c]
        add_times(A, left, scratch, 0, A, to)


@part
def row_matrix(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Add ``G(y_c)^T``, ``G(y_1)`` and, of midpoints, ``weight mu C`` to the blocks."""
    table, factors, linear, A = s.row_products, s.row_factors, s.row_linear, w.A
    y1, acting, on, count = w.y1, w.extra, s.row_on, len(s.row)
    weight, yL = numbers[WEIGHT], pulled(w.y0, w.mid, numbers)
    for t in range(table.shape[0]):
        k, place = table[t, BLOCK], table[t, PLACE]
        if on[k - count, place] == 0.0:
            continue
        left, right = row(yL, table[t, LEFT]), row(yL, table[t, RIGHT])
        left1, right1 = row(y1, table[t, LEFT]), row(y1, table[t, RIGHT])
        c, c1 = factor_of(table, factors, t, yL), factor_of(table, factors, t, y1)
        i, j = table[t, LEFT_PLACE], table[t, RIGHT_PLACE]
        if table[t, LEFT_VERTEX] >= 0:
            add_line(A, table[t, LEFT_SLOT], place, i, left1, times(c1, right1), False)
            add_line(A, table[t, LEFT_BACK], place, i, left, times(c, right), True)
        if table[t, RIGHT_VERTEX] >= 0:
            add_line(A, table[t, RIGHT_SLOT], place, j, right1, times(c1, left1), False)
            add_line(A, table[t, RIGHT_BACK], place, j, right, times(c, left), True)
        if weight != 0.0 and table[t, SLOT] >= 0:
            c *= weight * acting[k, place]
            add_curvature(A, table[t, SLOT], i, j, c, left, right1)
            add_curvature(A, table[t, SLOT_BACK], j, i, c, right, left1)
    for t in range(linear.shape[0]):
        k, place = linear[t, BLOCK], linear[t, PLACE]
        if linear[t, TERM_VERTEX] < 0 or on[k - count, place] == 0.0:
            continue
        f, n = s.row_linear_factors[t], linear[t, TERM_COMPONENT]
        a, i = linear[t, TERM], linear[t, TERM_PLACE]
        add_line(A, linear[t, TERM_SLOT], place, i, row(y1, a), unit(n, f), False)
        add_line(A, linear[t, TERM_BACK], place, i, row(yL, a), unit(n, f), True)
    for k in range(on.shape[0]):  # no row is there, or it is switched off
        for c in range(on.shape[1]):
            A[m.diag[count + k], c, c] = 1.0 - on[k, c]
    add_weighted(s, w, numbers[MASS])
    return 0.0


@part
def row_branch(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """1 if a joint is fulfilled only after half a turn, else 0."""
    table, found, y = s.cosines, s.cosine, w.y1
    for k in range(len(found)):
        found[k] = -s.cosine_constant[k]
    for t in range(table.shape[0]):
        c = factor_of(table, s.cosine_factors, t, y)
        found[table[t, BLOCK]] += c * dot(row(y, table[t, LEFT]), row(y, table[t, RIGHT]))
    for k in range(len(found)):
        if found[k] < TURNED_OVER:
            return 1.0
    return 0.0
