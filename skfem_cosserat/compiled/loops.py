"""Compiled parts of closed loops: a border of a few rows around the elimination of the tree.

The joints that close loops are quadratic forms of the rows of y, as lists of terms that never
change. Their impulses mu act on the tree like loads, and each step of Newton's method solves
``[A G_L^T; G_R 0] [dx; dmu] = -[b; g]`` with the factors of A and one more sweep for each row.
Parts take ``(s, m, w, numbers, flag)`` as those of :mod:`.tree`.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..types import Floats
from .elements import scalar_block
from .jit import inlined, part
from .numbers import WEIGHT
from .small import cross, dot, put, row

__all__ = ["loop_correct", "loop_curvature", "loop_force", "loop_keep", "loop_row", "loop_schur"]
__all__ += ["add_impulses", "correct", "keep_motion", "put_aside"]

#: columns of the table of products ``c y_left . y_right``: row of the border (-1: of none, it
#: depends on others where the step starts), rows of y, their vertices (-1: ground) and places in
#: them, blocks of both pairs of vertices. Linear terms: row of the border, row of y, component,
#: vertex
ROW, LEFT, RIGHT, LEFT_VERTEX, LEFT_PLACE, RIGHT_VERTEX, RIGHT_PLACE, SLOT, SLOT_BACK = range(9)
#: pivot, relative to the largest entry, below which a position counts as singular
SINGULAR = 1e-9


@inlined
def pull(f: Floats, a: int, factor: float, v: tuple[float, float, float]) -> None:
    """``f_a += factor v`` for a row that is unknown."""
    if a < f.shape[0]:
        for c in range(3):
            f[a, c] += factor * v[c]


@inlined
def add_forces(s: Any, y: Floats, mu: Floats, f: Floats) -> None:
    """``f += G(y)^T mu``."""
    table, factors, linear = s.loop_products, s.loop_factors, s.loop_linear
    for t in range(table.shape[0]):
        a, b, k = table[t, LEFT], table[t, RIGHT], table[t, ROW]
        c = mu[k] * factors[t] if k >= 0 else 0.0
        if c != 0.0:
            pull(f, a, c, row(y, b))
            pull(f, b, c, row(y, a))
    for t in range(linear.shape[0]):
        if linear[t, 0] >= 0 and linear[t, 1] < f.shape[0]:
            f[linear[t, 1], linear[t, 2]] += s.loop_linear_factors[t] * mu[linear[t, 0]]


@inlined
def twist_forces(s: Any, y: Floats, f: Floats, F: Floats, b: Floats) -> None:
    """Add ``P_int(y)^T f`` of the vertices on loops to F, and to b."""
    vertices, first, framed = s.loop_vertices, s.row, s.framed
    for k in range(len(vertices)):
        v = vertices[k]
        r = first[v]
        for c in range(3):
            F[v, c] += f[r, c]
            b[v, c] += f[r, c]
        if framed[v]:
            for i in range(1, 4):
                moment = cross(row(y, r + i), row(f, r + i))
                for c in range(3):
                    F[v, 3 + c] += moment[c]
                    b[v, 3 + c] += moment[c]


@inlined
def clear_rows(s: Any, f: Floats) -> None:
    """Zero the rows of the vertices on loops."""
    vertices, first, framed = s.loop_vertices, s.row, s.framed
    for k in range(len(vertices)):
        r = first[vertices[k]]
        for i in range(4 if framed[vertices[k]] else 1):
            put(f, r + i, (0.0, 0.0, 0.0))


@inlined
def add_impulses(s: Any, w: Any) -> None:
    """Add the increment of mu; what rows gape by begins with their constants."""
    mu, change, gap = w.mu, w.mu_change, w.gap
    for k in range(len(mu)):
        mu[k] += change[k]
        change[k] = 0.0
        gap[k] = -s.loop_constant[k]


@part
def loop_force(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Add the increment of mu, its forces on R and on vertices, and what the loops gape by."""
    mu, closing, gap, y1, R = w.mu, w.closing, w.gap, w.y1, w.R
    y = w.y0
    if numbers[WEIGHT] != 0.0:
        y = w.mid
    add_impulses(s, w)
    clear_rows(s, closing)
    add_forces(s, y, mu, closing)
    for k in range(len(s.loop_vertices)):
        v = s.loop_vertices[k]
        r = s.row[v]
        for i in range(4 if s.framed[v] else 1):
            for c in range(3):
                R[r + i, c] += closing[r + i, c]
    twist_forces(s, y, closing, w.F, w.b)
    table, linear = s.loop_products, s.loop_linear
    for t in range(table.shape[0]):
        if table[t, ROW] < 0:
            continue
        product = dot(row(y1, table[t, LEFT]), row(y1, table[t, RIGHT]))
        gap[table[t, ROW]] += s.loop_factors[t] * product
    for t in range(linear.shape[0]):
        if linear[t, 0] < 0:
            continue
        gap[linear[t, 0]] += s.loop_linear_factors[t] * y1[linear[t, 1], linear[t, 2]]
    return 0.0


@part
def loop_curvature(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Add ``weight mu C`` of all products, in reduced coordinates, to the blocks of the tree."""
    V, C = np.empty((3, 3)), np.zeros((1, 1, 4, 4))
    L, R = np.zeros((1, 4, 3)), np.zeros((1, 4, 3))
    table, factors, mid, y1, A, first = s.loop_products, s.loop_factors, w.mid, w.y1, w.A, s.row
    weight = numbers[WEIGHT]
    for t in range(table.shape[0]):
        if table[t, SLOT] < 0 or table[t, ROW] < 0:
            continue
        for side in range(2):
            i, j, k = table[t, LEFT_PLACE], table[t, RIGHT_PLACE], table[t, SLOT]
            u, v = table[t, LEFT_VERTEX], table[t, RIGHT_VERTEX]
            if side == 1:
                i, j, k = j, i, table[t, SLOT_BACK]
                u, v = v, u
            for a in range(4):
                for c in range(3):
                    L[0, a, c] = mid[first[u] + a, c] if a == 0 or s.framed[u] else 0.0
                    R[0, a, c] = y1[first[v] + a, c] if a == 0 or s.framed[v] else 0.0
            C[0, 0, i, j] = weight * w.mu[table[t, ROW]] * factors[t]
            scalar_block(C, 0, 0, L, R, A, k, V)
            C[0, 0, i, j] = 0.0
    return 0.0


@inlined
def put_aside(w: Any, flag: int) -> None:
    """The residual, in place of which row `flag` alone comes: its impulse is one."""
    b, F, kept, unit = w.b, w.F, w.b_kept, w.mu_change
    for v in range(b.shape[0]):
        for c in range(b.shape[1]):
            if flag == 0:
                kept[v, c] = b[v, c]
            b[v, c] = 0.0
            F[v, c] = 0.0
    for k in range(len(unit)):
        unit[k] = 1.0 if k == flag else 0.0


@part
def loop_row(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Force of row `flag` alone on the vertices, instead of the residual; which is kept."""
    unit, force = w.mu_change, w.change
    put_aside(w, flag)
    y = w.y0
    if numbers[WEIGHT] != 0.0:
        y = w.mid
    clear_rows(s, force)
    add_forces(s, y, unit, force)
    twist_forces(s, y, force, w.F, w.b)
    unit[flag] = 0.0
    return 0.0


@inlined
def rates_of(s: Any, y1: Floats, twist: Floats, out: Floats) -> None:
    """``G(y_1) P_int(y_1) twist``."""
    for k in range(len(out)):
        out[k] = 0.0
    table, linear, first = s.loop_products, s.loop_linear, s.row
    for t in range(table.shape[0]):
        for side in range(2):
            a, b, v = table[t, LEFT], table[t, RIGHT], table[t, LEFT_VERTEX]
            if side == 1:
                a, b, v = b, a, table[t, RIGHT_VERTEX]
            if v < 0 or table[t, ROW] < 0:
                continue
            rate = twist[v, 0], twist[v, 1], twist[v, 2]
            if a > first[v]:
                rate = cross((twist[v, 3], twist[v, 4], twist[v, 5]), row(y1, a))
            out[table[t, ROW]] += s.loop_factors[t] * dot(rate, row(y1, b))
    for t in range(linear.shape[0]):
        a, v = linear[t, 1], linear[t, 3]
        if v < 0 or linear[t, 0] < 0:
            continue
        rate = twist[v, 0], twist[v, 1], twist[v, 2]
        if a > first[v]:
            rate = cross((twist[v, 3], twist[v, 4], twist[v, 5]), row(y1, a))
        out[linear[t, 0]] += s.loop_linear_factors[t] * rate[linear[t, 2]]


@inlined
def keep_motion(w: Any, flag: int) -> None:
    """Keep row `flag`, the motion by it and what it does to all rows: that is in ``w.gap_rate``."""
    x, twist, border, turning, rates = w.x, w.twist, w.border, w.border_twist, w.gap_rate
    b, row_kept = w.b, w.border_row
    for v in range(x.shape[0]):
        for c in range(x.shape[1]):
            border[flag, v, c] = -x[v, c]
            turning[flag, v, c] = -twist[v, c]
            row_kept[flag, v, c] = b[v, c]
    for k in range(len(rates)):
        w.schur[k, flag] = -rates[k]


@part
def loop_keep(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Keep the motion by row `flag`, and what it does to all rows: a column of the small matrix."""
    rates_of(s, w.y1, w.twist, w.gap_rate)
    keep_motion(w, flag)
    return 0.0


@inlined
def solved(A: Floats, count: int, b: Floats, S: Floats) -> bool:
    """``b <- A^-1 b`` by elimination with pivoting in the scratch S; False if it is singular."""
    largest = 0.0
    for i in range(count):
        for j in range(count):
            S[i, j] = A[i, j]
            largest = max(largest, abs(A[i, j]))
    for k in range(count):
        p = k
        for i in range(k + 1, count):
            if abs(S[i, k]) > abs(S[p, k]):
                p = i
        if not abs(S[p, k]) > SINGULAR * largest:
            return False
        for j in range(count):
            S[k, j], S[p, j] = S[p, j], S[k, j]
        b[k], b[p] = b[p], b[k]
        for i in range(k + 1, count):
            f = S[i, k] / S[k, k]
            for j in range(k + 1, count):
                S[i, j] -= f * S[k, j]
            b[i] -= f * b[k]
    for k in range(count - 1, -1, -1):
        for j in range(k + 1, count):
            b[k] -= S[k, j] * b[j]
        b[k] /= S[k, k]
    return True


@part
def loop_schur(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """The residual back in its place; 0 in a singular position."""
    b, kept, rates = w.b, w.b_kept, w.gap_rate
    for v in range(b.shape[0]):
        for c in range(b.shape[1]):
            b[v, c] = kept[v, c]
    return 1.0 if solved(w.schur, len(rates), rates, w.schur_scratch) else 0.0


@inlined
def correct(w: Any) -> None:
    """From the increment of the tree, whose rates are in ``w.mu_change``, to that of all."""
    x, twist, border, turning, change = w.x, w.twist, w.border, w.border_twist, w.mu_change
    for k in range(len(change)):
        change[k] += w.gap[k]
    if not solved(w.schur, len(change), change, w.schur_scratch):
        x[0, 0] = np.nan  # no increment
    for k in range(len(change)):
        f = change[k]
        for v in range(x.shape[0]):
            for c in range(x.shape[1]):
                x[v, c] -= f * border[k, v, c]
                twist[v, c] -= f * turning[k, v, c]


@part
def loop_correct(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """From the increment of the tree to that of the closed loops, and of mu."""
    rates_of(s, w.y1, w.twist, w.mu_change)
    correct(w)
    return 0.0
