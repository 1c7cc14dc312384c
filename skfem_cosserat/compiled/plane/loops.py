"""Compiled parts of closed loops in a plane: a border of a few rows around the elimination.

As :mod:`skfem_cosserat.compiled.loops`; products of rows of y are ``Re(conj(a) k b)``, a and b
origins or unit vectors of vertices.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ...types import Floats
from ..jit import inlined, part
from ..loops import add_impulses, correct, keep_motion, put_aside
from ..numbers import WEIGHT
from .complex_numbers import (
    Complex,
    add_scaled,
    arrow,
    complex_at,
    crossed,
    inner,
    left,
    outer,
    point,
    product,
    put_complex,
    scaled,
)

__all__ = ["loop_correct", "loop_curvature", "loop_force", "loop_keep", "loop_row"]

#: columns of the table of products: row of the border (-1: of none), vertices (those of the ground
#: last) and whether unit vectors are meant (1) or origins (0), blocks of both pairs of vertices;
#: linear terms: row of the border, vertex, origin or unit vector
ROW, LEFT, LEFT_PLACE, RIGHT, RIGHT_PLACE, SLOT, SLOT_BACK = range(7)


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


@inlined
def add_forces(s: Any, y: Floats, mu: Floats, f: Floats) -> None:
    """``f += G(y)^T mu``."""
    table, factors, linear, directions = s.products, s.factors, s.linear, s.directions
    for t in range(len(table)):
        a, i, b, j = table[t, LEFT], table[t, LEFT_PLACE], table[t, RIGHT], table[t, RIGHT_PLACE]
        if table[t, ROW] >= 0:
            c, k = mu[table[t, ROW]], complex_at(factors, t, 0)
            pull(f, a, i, c, product(k, half(y, b, j)))
            pull(f, b, j, c, crossed(k, half(y, a, i)))
    for t in range(len(linear)):
        if linear[t, 0] >= 0:
            pull(f, linear[t, 1], linear[t, 2], mu[linear[t, 0]], complex_at(directions, t, 0))


@inlined
def twist_forces(s: Any, y: Floats, f: Floats, F: Floats, b: Floats) -> None:
    """Add ``P_int(y)^T f`` of the vertices on loops to F, and to b."""
    vertices = s.loop_vertices
    for k in range(len(vertices)):
        v = vertices[k]
        moment = outer(arrow(y, v), arrow(f, v))
        for c in range(2):
            F[v, c] += f[v, c]
            b[v, c] += f[v, c]
        F[v, 2] += moment
        b[v, 2] += moment


@inlined
def clear_vertices(s: Any, f: Floats) -> None:
    """Zero what there is of the vertices on loops."""
    vertices = s.loop_vertices
    for k in range(len(vertices)):
        for c in range(4):
            f[vertices[k], c] = 0.0


@part
def loop_force(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Add the increment of mu, its forces on R and on vertices, and what the loops gape by."""
    mu, closing, gap, y1, R, y = w.mu, w.closing, w.gap, w.y1, w.R, w.y0
    if numbers[WEIGHT] != 0.0:
        y = w.mid
    add_impulses(s, w)
    clear_vertices(s, closing)
    add_forces(s, y, mu, closing)
    for k in range(len(s.loop_vertices)):
        v = s.loop_vertices[k]
        for c in range(4):
            R[v, c] += closing[v, c]
    twist_forces(s, y, closing, w.F, w.b)
    table, linear, factors, directions = s.products, s.linear, s.factors, s.directions
    for t in range(len(table)):
        if table[t, ROW] >= 0:
            a = half(y1, table[t, LEFT], table[t, LEFT_PLACE])
            b = half(y1, table[t, RIGHT], table[t, RIGHT_PLACE])
            gap[table[t, ROW]] += inner(a, product(complex_at(factors, t, 0), b))
    for t in range(len(linear)):
        if linear[t, 0] >= 0:
            z = half(y1, linear[t, 1], linear[t, 2])
            gap[linear[t, 0]] += inner(complex_at(directions, t, 0), z)
    return 0.0


@part
def loop_curvature(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Add ``weight mu C`` of all products, in reduced coordinates, to the blocks of the tree."""
    table, factors, mid, y1, A = s.products, s.factors, w.mid, w.y1, w.A
    weight = numbers[WEIGHT]
    C = np.zeros((4, 2))
    for t in range(len(table)):
        if table[t, SLOT] < 0 or table[t, ROW] < 0:
            continue
        c = scaled(weight * w.mu[table[t, ROW]], complex_at(factors, t, 0))
        for side in range(2):
            i, j, k = table[t, LEFT_PLACE], table[t, RIGHT_PLACE], table[t, SLOT]
            u, v = table[t, LEFT], table[t, RIGHT]
            if side == 1:
                i, j, k = j, i, table[t, SLOT_BACK]
                u, v = v, u
                c = c[0], -c[1]
            put_complex(C, 2 * i + j, 0, c)
            L, T = arrow(mid, u), arrow(y1, v)
            # a product of two origins has a real factor
            add_scaled(
                C[0, 0], complex_at(C, 1, 0), complex_at(C, 2, 0), complex_at(C, 3, 0), L, T, A, k
            )
            put_complex(C, 2 * i + j, 0, (0.0, 0.0))
    return 0.0


@part
def loop_row(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Force of row `flag` alone on the vertices, instead of the residual; which is kept."""
    unit, force, y = w.mu_change, w.change, w.y0
    if numbers[WEIGHT] != 0.0:
        y = w.mid
    put_aside(w, flag)
    clear_vertices(s, force)
    add_forces(s, y, unit, force)
    twist_forces(s, y, force, w.F, w.b)
    unit[flag] = 0.0
    return 0.0


@inlined
def rate_of(y1: Floats, twist: Floats, v: int, place: int) -> Complex:
    """Velocity of an origin or unit vector."""
    if place == 0:
        return point(twist, v)
    return scaled(twist[v, 2], left(arrow(y1, v)))


@inlined
def rates_of(s: Any, y1: Floats, twist: Floats, out: Floats) -> None:
    """``G(y_1) P_int(y_1) twist``."""
    for k in range(len(out)):
        out[k] = 0.0
    table, factors, linear, directions = s.products, s.factors, s.linear, s.directions
    for t in range(len(table)):
        r = table[t, ROW]
        if r < 0:
            continue
        a, i, b, j = table[t, LEFT], table[t, LEFT_PLACE], table[t, RIGHT], table[t, RIGHT_PLACE]
        factor = complex_at(factors, t, 0)
        if a < len(twist):
            out[r] += inner(rate_of(y1, twist, a, i), product(factor, half(y1, b, j)))
        if b < len(twist):
            out[r] += inner(half(y1, a, i), product(factor, rate_of(y1, twist, b, j)))
    for t in range(len(linear)):
        r, v = linear[t, 0], linear[t, 1]
        if r >= 0 and v < len(twist):
            out[r] += inner(complex_at(directions, t, 0), rate_of(y1, twist, v, linear[t, 2]))


@part
def loop_keep(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Keep the motion by row `flag`, and what it does to all rows: a column of the small matrix."""
    rates_of(s, w.y1, w.twist, w.gap_rate)
    keep_motion(w, flag)
    return 0.0


@part
def loop_correct(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """From the increment of the tree to that of the closed loops, and of mu."""
    rates_of(s, w.y1, w.twist, w.mu_change)
    correct(w)
    return 0.0
