"""Velocities of a step whose relative part is damped, in kernels: a border around the tree.

The theory is that of :mod:`skfem_cosserat.integrators.energy_momentum`. Of each connected part of a
scene three numbers s turn all velocities alike, and what nothing ties to the ground is shifted as
well: the matrix is one that stays within elements and up to six products of a column and a row for
each part, ``A + sum_k U_k V_k^T``. Newton's method solves with the factors of A: parts do not
couple, so one more sweep for each k serves all of them. Parts take ``(s, m, w, numbers, flag)`` as
those of :mod:`.tree`.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..types import Floats
from .blocks import triangles_exchanging
from .jit import inlined, part
from .nodes import twist_force
from .numbers import (
    FLOW_CLOSED,
    FLOW_HALVINGS,
    FLOW_ITERATIONS,
    FLOW_NOISE,
    FLOW_REGULAR,
)
from .simd import clear, copy, local, put_product
from .small import (
    Rotation,
    Vector,
    column,
    combination,
    combine,
    cross,
    dot,
    increase,
    mass_times,
    minus,
    plus,
    pulled,
    put,
    row,
    rows3,
    times,
    turned,
    unit,
)
from .tables import (
    BORDER,
    CHI,
    COFACTORS,
    DRIFT,
    MEAN,
    PLAIN,
    SHIFT,
    SHIFTS,
    SIZES,
    STEP,
    SUMS,
    TURN,
    TURNED,
    A,
    S,
)


@inlined
def largest(v: Vector) -> float:
    """Largest entry."""
    return max(abs(v[0]), abs(v[1]), abs(v[2]))


@inlined
def gap_of(k: Vector, K: Rotation, trace: float, s: Vector) -> Vector:
    """``k + (tr K - K^T) s + (K s) x s``."""
    straight = minus(times(trace, s), combine(s, K))
    return plus(plus(k, straight), cross(turned(K, s), s))


@inlined
def slope_of(K: Rotation, trace: float, s: Vector) -> Rotation:
    """Its rows: ``tr K - K^T - s^ K + (K s)^``."""
    u = turned(K, s)
    return (
        minus(
            plus((trace, -u[2], u[1]), times(s[2], K[1])),
            plus(column(K, 0), times(s[1], K[2])),
        ),
        minus(
            plus((u[2], trace, -u[0]), times(s[0], K[2])),
            plus(column(K, 1), times(s[2], K[0])),
        ),
        minus(
            plus((-u[1], u[0], trace), times(s[1], K[0])),
            plus(column(K, 2), times(s[0], K[1])),
        ),
    )


@inlined
def cofactors(J: Rotation) -> Rotation:
    """Columns of the inverse of a matrix."""
    C = cross(J[1], J[2])
    f = 1.0 / dot(J[0], C)
    return times(f, C), times(f, cross(J[2], J[0])), times(f, cross(J[0], J[1]))


@inlined
def turn_part(f: Any, p: int) -> None:
    """Solve for s of a part; A, and the slope there."""
    sums, out = f.sums, f.turn
    K, k = rows3(sums, SUMS * p), row(sums, SUMS * p + TURN)
    noise = FLOW_NOISE * sums[SUMS * p + SIZES, 1]
    moves = sums[SUMS * p + SIZES, 0] > FLOW_CLOSED / FLOW_NOISE * noise
    size = sums[SUMS * p + SIZES, 0] + noise
    if not size > 0.0:
        size = 1.0
    trace = K[0][0] + K[1][1] + K[2][2]
    regular = trace + FLOW_REGULAR * size + noise
    s = (0.0, 0.0, 0.0)
    value = k
    length = largest(value) / size
    for _ in range(FLOW_ITERATIONS):
        if not (moves and length > FLOW_CLOSED):
            break
        way = times(-1.0, combine(value, cofactors(slope_of(K, regular, s))))
        after = gap_of(k, K, trace, plus(s, way))
        for _ in range(FLOW_HALVINGS):  # not too far
            if largest(after) / size <= max(length, FLOW_CLOSED):
                break
            way = times(0.5, way)
            after = gap_of(k, K, trace, plus(s, way))
        s, value = plus(s, way), after
        length = largest(value) / size
        if largest(way) < 1e-13 * (1.0 + largest(s)):
            break
    put(out, TURNED * p + S, s)
    inverse = cofactors(slope_of(K, regular, s))
    square = 1.0 / ((1.0 + f.scheme[CHI]) * (1.0 + dot(s, s)))
    plain = (
        plus((1.0, -s[2], s[1]), times(s[0], s)),
        plus((s[2], 1.0, -s[0]), times(s[1], s)),
        plus((-s[1], s[0], 1.0), times(s[2], s)),
    )
    for i in range(3):
        put(out, TURNED * p + PLAIN + i, plain[i])
        put(out, TURNED * p + A + i, times(square, plain[i]))
        put(out, TURNED * p + COFACTORS + i, inverse[i] if moves else (0.0, 0.0, 0.0))


@inlined
def sum_common(f: Any, w: Any, p: int, first: int, last: int) -> None:
    """Put b in ``f.rest``, sum up what rows of a part that is free have in common."""
    y0, y1, p0, mdq, rest = w.y0, w.y1, w.p0, f.mdq, f.rest
    chi, inverse = f.scheme[CHI], 1.0 / f.scheme[STEP]
    shift = mean = drift = (0.0, 0.0, 0.0)
    for r in range(first, last):
        moved = times(inverse, row(mdq, r))
        b = plus(times(chi, row(p0, r)), moved)
        put(rest, r, b)
        shift = plus(shift, times(f.mu[r], minus(row(y1, r), row(y0, r))))
        mean, drift = plus(mean, times(f.ones[r], b)), plus(drift, times(f.ones[r], moved))
    free = f.free[p]
    increase(f.sums, SUMS * p + SHIFT, times(free, shift))
    increase(f.sums, SUMS * p + MEAN, times(free, mean))
    increase(f.sums, SUMS * p + DRIFT, times(free, drift))


@inlined
def sum_relative(f: Any, w: Any, p: int, first: int, last: int) -> None:
    """Sum up terms of a part's equations for s over rows first to last; take the mean off b."""
    y0, y1, rest, sums, ones, lift = w.y0, w.y1, f.rest, f.sums, f.ones, f.lift
    mean, shift = row(sums, SUMS * p + MEAN), times(1.0 / f.total[p], row(sums, SUMS * p + SHIFT))
    x = y = z = k = (0.0, 0.0, 0.0)
    size, noise = 0.0, 0.0
    for r in range(first, last):
        b, dq = row(rest, r), minus(row(y1, r), row(y0, r))
        noise += np.sqrt(dot(row(y0, r), row(y0, r)) * dot(b, b))
        b, dq = minus(b, times(lift[r], mean)), minus(dq, times(ones[r], shift))
        put(rest, r, b)
        x, y, z = plus(x, times(dq[0], b)), plus(y, times(dq[1], b)), plus(z, times(dq[2], b))
        k = plus(k, cross(dq, b))
        size += np.sqrt(dot(dq, dq) * dot(b, b))
    increase(sums, SUMS * p, x)
    increase(sums, SUMS * p + 1, y)
    increase(sums, SUMS * p + 2, z)
    increase(sums, SUMS * p + TURN, k)
    sums[SUMS * p + SIZES, 0] += size
    sums[SUMS * p + SIZES, 1] += noise


@part
def flow(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Twice the momentum ``M v_m`` of the mean velocities, in ``w.momentum``."""
    f, sums, out, runs = w.flow, w.flow.sums, w.momentum, w.flow.runs
    combination(1.0, w.y1, -1.0, w.y0, f.rest)
    mass_times(s, 1.0, f.rest, f.mdq)
    clear(sums)
    for n in range(len(runs) - 1):
        sum_common(f, w, f.owner[runs[n]], runs[n], runs[n + 1])
    for n in range(len(runs) - 1):
        sum_relative(f, w, f.owner[runs[n]], runs[n], runs[n + 1])
    for p in range(len(f.free)):
        turn_part(f, p)
    for n in range(len(runs) - 1):
        p = f.owner[runs[n]]
        M, drift = rows3(f.turn, TURNED * p + A), row(sums, SUMS * p + DRIFT)
        for r in range(runs[n], runs[n + 1]):
            v = plus(turned(M, row(f.rest, r)), times(f.lift[r], drift))
            put(out, r, times(2.0, v))
    return 0.0


@inlined
def relative(f: Any, p: int, factor: float) -> Rotation:
    """``factor (A - 1)`` of a part."""
    M = rows3(f.turn, TURNED * p + A)
    return (
        times(factor, (M[0][0] - 1.0, M[0][1], M[0][2])),
        times(factor, (M[1][0], M[1][1] - 1.0, M[1][2])),
        times(factor, (M[2][0], M[2][1], M[2][2] - 1.0)),
    )


@part
def flow_matrix(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Add ``(2/h) P(y_L)^T M (A - 1) P(y_1)`` to the blocks."""
    f, blocks, y1, first = w.flow, w.A, w.y1, s.mass_indptr
    yL = pulled(w.y0, w.mid, numbers)
    for r in range(len(f.owner)):
        d = row(yL, r)
        for n in range(first[r], first[r + 1]):
            j, k = s.mass_indices[n], f.slot[n]
            B = relative(f, f.owner[r], 2.0 / f.scheme[STEP] * s.mass_data[n])
            left, right = 0 if f.local[r] == 0 else 3, 0 if f.local[j] == 0 else 3
            e = row(y1, j)
            for c in range(3):
                u = unit(c, 1.0)
                if right != 0:
                    u = cross(u, e)
                u = turned(B, u)
                if left != 0:
                    u = cross(d, u)
                for i in range(3):
                    blocks[k, left + i, right + c] += u[i]
    return 0.0


@inlined
def shift_rows(f: Any, p: int, k: int, r: int) -> tuple[Vector, Vector]:
    """Column U and row V of a common shift, k of a part that is free."""
    none = (0.0, 0.0, 0.0)
    if f.free[p] == 0.0:
        return none, none
    B = relative(f, p, -2.0 / f.scheme[STEP] * f.lift[r])
    return column(B, k), unit(k, f.mu[r])


@inlined
def turn_rows(f: Any, p: int, i: int, r: int) -> tuple[Vector, Vector]:
    """Rows of a turn."""
    s, plain, columns = (
        row(f.turn, TURNED * p + S),
        rows3(f.turn, TURNED * p + PLAIN),
        rows3(f.turn, TURNED * p + COFACTORS),
    )
    b, chi = row(f.rest, r), f.scheme[CHI]
    t = turned(plain, b)
    square = 1.0 + dot(s, s)
    way = unit(i, 1.0)
    change = plus(plus(cross(way, b), times(b[i], s)), times(dot(s, b), way))
    change = minus(change, times(2.0 * s[i] / square, t))
    lever = row(f.mdq, r)
    if f.free[p] != 0.0:
        lever = minus(lever, times(f.lift[r], row(f.sums, SUMS * p + SHIFT)))
    g = times(-1.0, column(columns, i))
    V = minus(cross(t, g), combine(cross(times(1.0 / f.scheme[STEP], lever), g), plain))
    return times(2.0 / ((1.0 + chi) * square), change), V


@inlined
def put_rows_of(f: Any, k: int, column: Floats, form: Floats) -> None:
    """Column k and its row, of all parts."""
    for r in range(column.shape[0]):
        if k < SHIFTS:
            U, V = shift_rows(f, f.owner[r], k, r)
        else:
            U, V = turn_rows(f, f.owner[r], k - SHIFTS, r)
        put(column, r, U)
        put(form, r, V)


@part
def flow_column(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Column `flag` of all parts on the vertices, in place of the residual; that is kept."""
    f, b, line, other, x = w.flow, w.b, w.flow.column, w.change, w.x
    if flag == f.begin[0]:
        copy(b, f.kept)
        for k in range(flag, BORDER):
            put_rows_of(f, k, line, other)
            twist_force(s, w.y1, other, w.F_mixed, x)
            for v in range(len(s.framed)):
                for c in range(6):
                    f.forms[k, v, c] = x[v, c]
    put_rows_of(f, flag, line, other)
    clear(b)
    twist_force(s, pulled(w.y0, w.mid, numbers), line, w.F, b)
    return 0.0


@inlined
def rates_of(f: Any, count: int, twist: Floats, k: int) -> None:
    """``V . twist`` of all rows of all parts: column k of ``f.schur``."""
    for p in range(f.schur.shape[0]):
        for i in range(BORDER):
            f.schur[p, i, k] = 0.0
    for v in range(count):
        p = f.holder[v]
        for i in range(f.begin[0], BORDER):
            rate = 0.0
            for c in range(6):
                rate += f.forms[i, v, c] * twist[v, c]
            f.schur[p, i, k] += rate


@part
def flow_keep(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Keep the motion by column `flag`, and what it does to all rows; the residual comes back."""
    f, x, twist = w.flow, w.x, w.twist
    for v in range(x.shape[0]):
        for c in range(6):
            x[v, c], twist[v, c] = -x[v, c], -twist[v, c]
            f.motion[flag, v, c], f.twists[flag, v, c] = x[v, c], twist[v, c]
    if flag == BORDER - 1:
        copy(f.kept, w.b)
    rates_of(f, len(s.framed), twist, flag)
    return 0.0


@part
def flow_correct(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """From the increment by the factors to that of the whole matrix."""
    f, x, twist, begin, M, S = w.flow, w.x, w.twist, w.flow.begin[0], w.flow.schur, w.scratch
    lower, upper, v = local((1, BORDER, BORDER)), local((1, BORDER, BORDER)), local((1, BORDER))
    rates_of(f, len(s.framed), twist, BORDER)
    for p in range(M.shape[0]):  # (1 + M) v = r, which stands behind the last column of M
        for i in range(BORDER):
            v[0, i] = M[p, i, BORDER]
            for k in range(BORDER):
                S[1, i, k] = M[p, i, k] + (1.0 if i == k else 0.0)
        if triangles_exchanging(S, 1, S, lower, upper, 0) == 0.0:
            x[0, 0] = np.nan  # no increment
            return 0.0
        put_product(lower, 0, v, 0, 1.0, v, 0)
        put_product(upper, 0, v, 0, 1.0, v, 0)
        for i in range(BORDER):
            M[p, i, BORDER] = v[0, i]
    for u in range(x.shape[0]):
        for k in range(begin, BORDER):
            c = M[f.holder[u], k, BORDER]
            for i in range(6):
                x[u, i] -= c * f.motion[k, u, i]
                twist[u, i] -= c * f.twists[k, u, i]
    return 0.0


@inlined
def flow_velocity(f: Any, o: Any) -> float:
    """Velocities at the end of a step, in place of the first rates; gives what is taken (J)."""
    y0, y1, p0, p1, rates, after = o.y0, o.y1, o.p0, o.carried, o.rates, o.after
    chi, inverse, taken = f.scheme[CHI], 1.0 / f.scheme[STEP], 0.0
    for r in range(len(f.owner)):
        p, v0 = f.owner[r], row(rates, r)
        M = rows3(f.turn, TURNED * p + A)
        mean = times(inverse, minus(row(y1, r), row(y0, r)))
        shift = minus(row(f.sums, SUMS * p + DRIFT), turned(M, row(f.sums, SUMS * p + MEAN)))
        v = turned(M, plus(times(chi, v0), mean))
        v = plus(v, times(f.ones[r] / f.total[p], shift))
        # twice M v_m is p_0 + p_1
        taken += dot(minus(mean, v), minus(row(p1, r), row(p0, r)))
        put(after, r, minus(times(2.0, v), v0))
    return taken
