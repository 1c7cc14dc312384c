"""Compiled parts of constraint rows with multipliers in a plane: three in a block.

As :mod:`skfem_cosserat.compiled.rows`; products of rows of y are ``Re(conj(a) k b)``, a and b
origins or unit vectors of vertices.
"""

from __future__ import annotations

from typing import Any

from ...types import Floats
from ..jit import inlined, part
from ..numbers import WEIGHT
from ..rows import TURNED_OVER, add_weighted, complete_blocks, push, start_gaps
from .complex_numbers import (
    Complex,
    add_scaled,
    arrow,
    complex_at,
    crossed,
    inner,
    left,
    product,
    scaled,
)

__all__ = ["row_branch", "row_force", "row_matrix"]

#: columns of the table of products: block and place of the constraint row; vertices (those of the
#: ground last) and whether unit vectors are meant (1) or origins (0); slots of both pairs of
#: vertices, and of the block with each of them. Linear terms: block and place, vertex, origin or
#: unit vector, slots of the block with the vertex
BLOCK, PLACE, LEFT, LEFT_PLACE, RIGHT, RIGHT_PLACE = range(6)
SLOT, SLOT_BACK, LEFT_SLOT, LEFT_BACK, RIGHT_SLOT, RIGHT_BACK = range(6, 12)
TERM, TERM_PLACE, TERM_SLOT, TERM_BACK = range(2, 6)


@inlined
def half(y: Floats, v: int, place: int) -> Complex:
    """Origin or unit vector."""
    return y[v, 2 * place], y[v, 2 * place + 1]


@inlined
def pull(f: Floats, v: int, place: int, factor: float, z: Complex) -> None:
    """Add a force, if it is not on the ground."""
    if v < len(f):
        f[v, 2 * place] += factor * z[0]
        f[v, 2 * place + 1] += factor * z[1]


@part
def row_force(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Forces by mu, added to ``w.closing``, and what rows gape by: gives the largest, relative."""
    closing, b, y1, acting, y = w.closing, w.b, w.y1, w.extra, w.y0
    if numbers[WEIGHT] != 0.0:
        y = w.mid
    table, factors, linear, directions = s.products, s.factors, s.linear, s.directions
    start_gaps(s, m, b, len(s.framed))
    for t in range(len(table)):
        u, i, v, j = table[t, LEFT], table[t, LEFT_PLACE], table[t, RIGHT], table[t, RIGHT_PLACE]
        value = inner(half(y1, u, i), product(complex_at(factors, t, 0), half(y1, v, j)))
        b[table[t, BLOCK], table[t, PLACE]] += value
    for t in range(len(linear)):
        v, i, z = linear[t, TERM], linear[t, TERM_PLACE], complex_at(directions, t, 0)
        b[linear[t, BLOCK], linear[t, PLACE]] += inner(z, half(y1, v, i))
    gap = push(s, m, w, numbers, len(s.framed))
    for t in range(len(table)):
        u, i, v, j = table[t, LEFT], table[t, LEFT_PLACE], table[t, RIGHT], table[t, RIGHT_PLACE]
        f, c = complex_at(factors, t, 0), acting[table[t, BLOCK], table[t, PLACE]]
        pull(closing, u, i, c, product(f, half(y, v, j)))
        pull(closing, v, j, c, crossed(f, half(y, u, i)))
    for t in range(len(linear)):
        v, i, z = linear[t, TERM], linear[t, TERM_PLACE], complex_at(directions, t, 0)
        pull(closing, v, i, acting[linear[t, BLOCK], linear[t, PLACE]], z)
    return gap


@inlined
def add_row(A: Floats, k: int, place: int, i: int, e: Complex, z: Complex) -> None:
    """Row ``z . dy`` of a vertex by its twist; y is its origin or, if i is 1, its unit vector e."""
    if i == 0:
        A[k, 4 * place] += z[0]
        A[k, 4 * place + 1] += z[1]
    else:
        A[k, 4 * place + 2] += inner(z, left(e))


@inlined
def add_column(A: Floats, k: int, place: int, i: int, e: Complex, z: Complex) -> None:
    """The same as a column."""
    if i == 0:
        A[k, place] += z[0]
        A[k, 4 + place] += z[1]
    else:
        A[k, 8 + place] += inner(z, left(e))


@inlined
def add_curvature(A: Floats, k: int, i: int, j: int, c: Complex, L: Complex, R: Complex) -> None:
    """``Re(conj(dy_i) c dy_j)`` by twists of two vertices, whose unit vectors are L and R."""
    none = 0.0, 0.0
    xe = c if i == 0 and j == 1 else none
    ex = c if i == 1 and j == 0 else none
    ee = c if i == 1 and j == 1 else none
    # a product of two origins has a real factor
    add_scaled(c[0] if i == 0 and j == 0 else 0.0, xe, ex, ee, L, R, A, k)


@part
def row_matrix(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Add ``G(y_c)^T``, ``G(y_1)`` and, of midpoints, ``weight mu C`` to the blocks."""
    table, factors, linear, A = s.products, s.factors, s.linear, w.A
    y1, acting, on, count, weight = w.y1, w.extra, s.row_on, len(s.framed), numbers[WEIGHT]
    yL = w.y0
    if weight != 0.0:
        yL = w.mid
    for t in range(len(table)):
        b, place = table[t, BLOCK], table[t, PLACE]
        if on[b - count, place] == 0.0:
            continue
        u, i, v, j = table[t, LEFT], table[t, LEFT_PLACE], table[t, RIGHT], table[t, RIGHT_PLACE]
        f = complex_at(factors, t, 0)
        if table[t, LEFT_SLOT] >= 0:
            z = product(f, half(y1, v, j))
            add_row(A, table[t, LEFT_SLOT], place, i, arrow(y1, u), z)
            z = product(f, half(yL, v, j))
            add_column(A, table[t, LEFT_BACK], place, i, arrow(yL, u), z)
        if table[t, RIGHT_SLOT] >= 0:
            z = crossed(f, half(y1, u, i))
            add_row(A, table[t, RIGHT_SLOT], place, j, arrow(y1, v), z)
            z = crossed(f, half(yL, u, i))
            add_column(A, table[t, RIGHT_BACK], place, j, arrow(yL, v), z)
        if weight != 0.0 and table[t, SLOT] >= 0:
            c = scaled(weight * acting[b, place], f)
            add_curvature(A, table[t, SLOT], i, j, c, arrow(yL, u), arrow(y1, v))
            c = c[0], -c[1]
            add_curvature(A, table[t, SLOT_BACK], j, i, c, arrow(yL, v), arrow(y1, u))
    for t in range(len(linear)):
        b, place, v, i = linear[t, BLOCK], linear[t, PLACE], linear[t, TERM], linear[t, TERM_PLACE]
        if linear[t, TERM_SLOT] >= 0 and on[b - count, place] != 0.0:
            z = complex_at(s.directions, t, 0)
            add_row(A, linear[t, TERM_SLOT], place, i, arrow(y1, v), z)
            add_column(A, linear[t, TERM_BACK], place, i, arrow(yL, v), z)
    complete_blocks(s, m, A, count)
    add_weighted(s, w, numbers)
    return 0.0


@part
def row_branch(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """1 if a joint is fulfilled only after half a turn, else 0."""
    table, factors, found, y = s.cosines, s.cosine_factors, s.cosine, w.y1
    for k in range(len(found)):
        found[k] = -s.cosine_constant[k]
    for t in range(len(table)):
        a = half(y, table[t, LEFT], table[t, LEFT_PLACE])
        b = half(y, table[t, RIGHT], table[t, RIGHT_PLACE])
        found[table[t, BLOCK]] += inner(a, product(complex_at(factors, t, 0), b))
    for k in range(len(found)):
        if found[k] < TURNED_OVER:
            return 1.0
    return 0.0
