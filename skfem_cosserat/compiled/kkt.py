"""Elimination of all unknowns with multipliers, vertex by vertex."""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from ..types import Floats, IndexArray
from .blocks import carry
from .constraints import PAIRS, border
from .couplings import SIDE, SLOT, couple_force, gradients, right_side
from .elements import Point, add_geometric, at_point, take
from .jit import inlined, part
from .loads import load_force, moment_change, moment_on
from .numbers import END, ENDS, FORCE, MASS, SHARE, WEIGHT, S
from .small import directors, row

__all__ = [
    "GRAIN",
    "PIVOT",
    "WIDE",
    "beam_tangent",
    "couple",
    "factor",
    "load",
    "subtract_rows",
    "sweep",
]

# -- sums of rows, four numbers at a time: what dense blocks of any size are eliminated with -------

#: numbers that are taken at a time
GRAIN = 4


@intrinsic
def subtract_rows(
    typing: Any,
    C: Any,
    c: Any,
    A: Any,
    a: Any,
    da: Any,
    B: Any,
    b: Any,
    db: Any,
    count: Any,
    width: Any,
) -> Any:
    """``C[c + k] -= sum_n A[a + n da] B[b + n db + k]``, n < count, k < width, a multiple of 4.

    Places count from the start of contiguous arrays of any shape. LLVM's own vectorising looks at
    loops of a length known only when they run, and leaves short ones to single numbers: this is
    three to four times faster for 12 to 36 columns.
    """
    whole, double = ir.IntType(64), ir.DoubleType()

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        C, A, B = (
            context.make_array(signature.args[k])(context, builder, values[k]).data
            for k in (0, 2, 5)
        )
        c, a, da, b, db, count, width = (values[k] for k in (1, 3, 4, 6, 7, 8, 9))

        def columns(first: Any, stop: Any, lanes: int) -> None:
            vector = ir.VectorType(double, lanes)

            def at(data: Any, place: Any) -> Any:
                return builder.bitcast(builder.gep(data, [place]), ir.PointerType(vector))

            step = ir.Constant(whole, lanes)
            with cgutils.for_range_slice(builder, first, stop, step, whole) as (k, _):
                target = at(C, builder.add(c, k))
                total = cgutils.alloca_once(builder, vector)
                builder.store(builder.load(target, align=8), total)
                with cgutils.for_range(builder, count) as loop:
                    place = builder.add(a, builder.mul(loop.index, da))
                    factor = builder.load(builder.gep(A, [place]))
                    factor = builder.fsub(ir.Constant(double, -0.0), factor)
                    spread = ir.Constant(vector, ir.Undefined)
                    for lane in range(lanes):
                        place = ir.Constant(ir.IntType(32), lane)
                        spread = builder.insert_element(spread, factor, place)
                    row = at(B, builder.add(builder.add(b, k), builder.mul(loop.index, db)))
                    product = builder.fmul(spread, builder.load(row, align=8), flags=("contract",))
                    added = builder.fadd(builder.load(total), product, flags=("contract",))
                    builder.store(added, total)
                builder.store(builder.load(total), target, align=8)

        even = builder.and_(width, ir.Constant(whole, -2 * GRAIN))
        columns(ir.Constant(whole, 0), even, 2 * GRAIN)
        columns(even, width, GRAIN)
        return context.get_dummy_value()

    n = types.intp
    return types.void(C, n, A, n, n, B, n, n, n, n), generate


# -- compiled elimination of coordinates and multipliers, and the tangent that it takes ------------
#
# The matrix is ``[[K, c G(y_c)^T], [r G(y_1), 0]]``, of n + m rows. It falls into vertices: the
# coordinates of a vertex (12 of a frame, 3 of a point), the multipliers of its internal constraints
# and those of the joint to its parent. Rows of a joint belong to the child: they have full rank in
# its motion, so that its pivot block, of up to 24 rows, is regular, and children come before their
# parents. Pivots are chosen inside these blocks. What goes on to neighbours are their coordinates
# alone, so the cost grows with the length of a chain. Parts take ``(s, m, w, numbers, flag)`` as
# those of :mod:`.constraints`, and ``(g, w, numbers, flag)`` as those of :mod:`.elements`.

#: rows that a pivot block has at most, coordinates of a frame: multiples of GRAIN
PIVOT, WIDE = 24, 12


@inlined
def strain_rows(Na: float, dNa: float, G: Point, a: int, first: int, B: Floats) -> None:
    """Strains by the coordinates of node a, in six rows of B from `first` on; the rest stays 0."""
    phi, d, e = G
    c0 = WIDE * a
    hN, hd = 0.5 * Na, 0.5 * dNa
    for i in range(3):
        j = (i + 1) % 3
        k = (i + 2) % 3
        for c in range(3):
            B[first + i, c0 + c] = dNa * d[i][c]
            B[first + i, c0 + 3 + 3 * i + c] = Na * phi[c]
            B[first + 3 + i, c0 + 3 + 3 * j + c] = hd * d[k][c] - hN * e[k][c]
            B[first + 3 + i, c0 + 3 + 3 * k + c] = hN * e[j][c] - hd * d[j][c]


@inlined
def to_nodes(rotations: Floats, e: int, B: Floats, V: Floats) -> None:
    """Columns of section directors to those of the nodes, ``B (Q (x) I_3)``."""
    for k in range(B.shape[0]):
        for a in range(rotations.shape[1]):
            for c in range(3):
                for j in range(3):
                    t = 0.0
                    for i in range(3):
                        t += B[k, WIDE * a + 3 + 3 * i + c] * rotations[e, a, i, j]
                    V[j] = t
                for j in range(3):
                    B[k, WIDE * a + 3 + 3 * j + c] = V[j]


@inlined
def scalars_to_nodes(rotations: Floats, e: int, C: Floats, V: Floats) -> None:
    """The same for coefficients: ``Q_a^T C_ab Q_b`` of the directors."""
    for a in range(C.shape[0]):
        for b in range(C.shape[1]):
            for r in range(4):
                for j in range(3):
                    V[j] = 0.0
                    for i in range(3):
                        V[j] += C[a, b, r, 1 + i] * rotations[e, b, i, j]
                for j in range(3):
                    C[a, b, r, 1 + j] = V[j]
            for r in range(4):
                for j in range(3):
                    V[j] = 0.0
                    for i in range(3):
                        V[j] += C[a, b, 1 + i, r] * rotations[e, a, i, j]
                for j in range(3):
                    C[a, b, 1 + j, r] = V[j]


@part
def beam_tangent(g: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Add the blocks of all elements to their slots, not projected.

    ``mass M + force (c int B(q_mid)^T D B(y_S) ds + share int S . C/l ds)``, see
    :func:`.elements.beam_tangent`.
    """
    yB, yS, S, A = w.mid, w.mid, g.S, w.A
    mass, half = numbers[MASS], numbers[SHARE] * numbers[FORCE]
    material = half
    if numbers[ENDS] != 0.0:
        yS, material = w.y1, numbers[END] * numbers[FORCE]
    if flag == 1:
        S = g.predicted
    lengths, shapes, slopes, weights = g.lengths, g.N, g.dN, g.weights
    masses, slot, stiffness, section = g.mass, g.slot, g.stiffness, g.section
    diagonal = g.diagonal
    base, turned, rotations = g.base, g.turned, g.rotations
    ne, nn = base.shape
    wide, count = WIDE * nn, 6 * len(shapes)
    XB, XS, V = np.empty((nn, 4, 3)), np.empty((nn, 4, 3)), np.empty(3)
    C, L, B = np.empty((nn, nn, 4, 4)), np.zeros((count, wide)), np.zeros((count, wide))
    T = np.zeros((count, wide))
    for e in range(ne):
        inverse = 1.0 / lengths[e]
        take(base, turned, rotations, e, yB, XB)
        take(base, turned, rotations, e, yS, XS)
        for a in range(nn):
            for b in range(nn):
                for r in range(4):
                    for c in range(4):
                        C[a, b, r, c] = mass * masses[e, a, b, r, c]
        if turned:
            for k in range(count):
                for c in range(wide):
                    L[k, c] = 0.0
                    B[k, c] = 0.0
        for p in range(len(shapes)):
            N, dN = shapes[p], slopes[p]
            GB = at_point(N, dN, inverse, XB)
            GS = at_point(N, dN, inverse, XS)
            add_geometric(N, dN, half * weights[p], S, e, p, C)
            factor = material * weights[p] * lengths[e]
            for a in range(nn):
                strain_rows(factor * N[a], factor * dN[a] * inverse, GB, a, 6 * p, L)
                strain_rows(N[a], dN[a] * inverse, GS, a, 6 * p, B)
        if turned:
            to_nodes(rotations, e, L, V)
            to_nodes(rotations, e, B, V)
            scalars_to_nodes(rotations, e, C, V)
        for k in range(count):
            i = k % 6
            if diagonal:
                for c in range(wide):
                    T[k, c] = -stiffness[section[e], i, i] * B[k, c]
            else:
                for c in range(wide):
                    T[k, c] = 0.0
                place = 36 * section[e] + 6 * i
                subtract_rows(T, k * wide, stiffness, place, 1, B, (k - i) * wide, wide, 6, wide)
        for a in range(nn):
            for b in range(nn):
                k = slot[e, a, b]
                for r in range(WIDE):
                    place = (k * WIDE + r) * WIDE
                    left = WIDE * a + r
                    subtract_rows(A, place, L, left, wide, T, WIDE * b, wide, count, WIDE)
                for i in range(4):
                    for j in range(4):
                        f = C[a, b, i, j]
                        for c in range(3):
                            A[k, 3 * i + c, 3 * j + c] += f
    return 0.0


@inlined
def fill_triad(left: Floats, right: Floats, r: int, column: float, row: float, W: Floats) -> None:
    """Rows and columns of a triad's constraints, behind its coordinates."""
    for q in range(6):
        for side in range(2):
            i, j = PAIRS[q][side], PAIRS[q][1 - side]
            for c in range(3):
                W[WIDE + q, 3 + 3 * i + c] = row * right[r + 1 + j, c]
                W[3 + 3 * i + c, WIDE + q] = column * left[r + 1 + j, c]


@inlined
def fill(s: Any, m: Any, w: Any, left: Floats, t: int, W: Floats, width: int) -> int:
    """Panel W: the pivot block, and behind it its rows by the coordinates of neighbours.

    D of these: columns of the neighbours' rows. Gives the size of the pivot block.
    """
    A, v, first, D = w.A, m.order[t], m.ptr[t], m.D
    near, n = m.ptr[t + 1] - first, m.coordinates[m.order[t]]
    G_left, G_right, column, row = s.G_left, s.G_right, m.scale[0], m.scale[1]
    start = m.multiplier_ptr[v]
    size = n + m.multiplier_ptr[v + 1] - start
    k = m.diag[v]
    for i in range(size):
        for c in range(width):
            W[i, c] = 0.0
    for i in range(n):
        for c in range(n):
            W[i, c] = A[k, i, c]
    joint = n
    if s.framed[v]:
        fill_triad(left, w.y1, s.row[v], column, row, W)
        joint = n + 6
    for i in range(joint, size):
        one = m.multipliers[start + i - n] - m.internal
        for c in range(n):
            W[i, c] = row * G_right[one, c]
            W[c, i] = column * G_left[one, c]
    for j in range(near):
        c0 = width - WIDE * (near - j)
        for i in range(n):
            for c in range(WIDE):
                W[i, c0 + c] = A[m.right[first + j], i, c]
                D[first + j, i, c] = A[m.down[first + j], c, i]
        if j == m.parent_at[t]:  # internal constraints know no parent: D is 0
            for i in range(joint, size):
                one = m.multipliers[start + i - n] - 2 * m.internal + len(s.multiplier)
                for c in range(WIDE):
                    W[i, c0 + c] = row * G_right[one, c]
                    D[first + j, i, c] = column * G_left[one, c]
    return size


@inlined
def pivot(W: Floats, T: Floats, v: int, n: int, size: int, left: int, width: int) -> int:
    """Row with the largest entry in column n, exchanged with row n; -1 if there is none."""
    p = n
    big = abs(W[n, n])
    for i in range(n + 1, size):
        if abs(W[i, n]) > big:
            big = abs(W[i, n])
            p = i
    if not big > 0.0:
        return -1
    if p != n:
        for c in range(left, width):
            W[n, c], W[p, c] = W[p, c], W[n, c]
        for c in range(n):
            T[v, c, n], T[v, c, p] = T[v, c, p], T[v, c, n]
    return p


@inlined
def eliminate(
    W: Floats, T: Floats, inverse: Floats, pivots: IndexArray, v: int, size: int, width: int
) -> bool:
    """LU of the first `size` columns of a panel, in groups of GRAIN; False if a pivot vanishes.

    T_v is the transposed L, whose diagonal is kept inverted. U, of unit diagonal, stays in W.
    """
    stride = W.shape[1]
    for left in range(0, size, GRAIN):
        end = min(left + GRAIN, size)
        for n in range(left, end):
            p = pivot(W, T, v, n, size, left, width)
            if p < 0:
                return False
            pivots[v, n] = p
            d = 1.0 / W[n, n]
            inverse[v, n] = d
            for c in range(GRAIN):
                W[n, left + c] *= d
            place = (v * PIVOT + n) * PIVOT
            for i in range(n + 1, size):
                T[v, n, i] = W[i, n]
                row, own = i * stride + left, n * stride + left
                subtract_rows(W, row, T, place + i, 0, W, own, 0, 1, GRAIN)
        rest = left + GRAIN
        place, own = (v * PIVOT + left) * PIVOT, left * stride + rest
        for i in range(left, end):
            row, count = i * stride + rest, i - left
            subtract_rows(W, row, T, place + i, PIVOT, W, own, stride, count, width - rest)
            for c in range(rest, width, GRAIN):
                for k in range(GRAIN):
                    W[i, c + k] *= inverse[v, i]
        for i in range(end, size):
            row = i * stride + rest
            subtract_rows(W, row, T, place + i, PIVOT, W, own, stride, GRAIN, width - rest)
    return True


@part
def factor(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Complete the matrix and factorise it: 0 if a pivot vanishes, else 1."""
    border(s, m, w, numbers)
    A, T, X, D, W = w.A, m.T, m.X, m.D, m.panel
    order, ptr, coordinates, parent_at = m.order, m.ptr, m.coordinates, m.parent_at
    start, update, inverse, pivots = m.update_ptr, m.update, m.inverse, m.pivots
    stride = W.shape[1]
    y1, frames, left = w.y1, w.frames, w.y0
    if numbers[WEIGHT] != 0.0:
        left = w.mid
    for r in range(frames.shape[0]):
        for c in range(3):
            frames[r, c] = y1[r, c]
    for t in range(len(order)):
        v = order[t]
        first = ptr[t]
        near = ptr[t + 1] - first
        size = coordinates[v] + m.multiplier_ptr[v + 1] - m.multiplier_ptr[v]
        right = (size + GRAIN - 1) // GRAIN * GRAIN
        width = right + WIDE * near
        fill(s, m, w, left, t, W, width)
        if not eliminate(W, T, inverse, pivots, v, size, width):
            return 0.0
        for i in range(size - 2, -1, -1):
            row, below = i * stride + right, (i + 1) * stride + right
            count = size - 1 - i
            own = i * stride + i + 1
            subtract_rows(W, row, W, own, 1, W, below, stride, count, width - right)
        for n in range(size):
            for i in range(n):
                T[v, n, i] = W[i, n]
        for j in range(near):
            for i in range(size):
                for c in range(WIDE):
                    X[first + j, c, i] = W[i, right + WIDE * j + c]
        for i in range(near):
            # only the parent is in rows of the joint
            count = size if i == parent_at[t] else coordinates[v]
            own = (first + i) * PIVOT * WIDE
            for j in range(near):
                place = update[start[t] + i * near + j] * WIDE * WIDE
                there = right + WIDE * j
                for r in range(WIDE):
                    target = place + WIDE * r
                    subtract_rows(A, target, D, own + r, WIDE, W, there, stride, count, WIDE)
    return 1.0


@inlined
def turn(s: Any, m: Any, w: Any, x: Floats, back: bool) -> None:
    """Vectors of each frame to where it was when factors were made, or back."""
    y1, frames, first, triple = w.y1, w.frames, s.row, m.triple
    for v in range(x.shape[0]):
        if not s.framed[v]:
            continue
        now, then = directors(y1, first[v]), directors(frames, first[v])
        if back:
            now, then = then, now
        for i in range(4):
            carry(now, then, 1.0, x, v, 3 * i, x)
        if triple[v] >= 0:
            carry(now, then, 1.0, x, v, triple[v], x)


@inlined
def solve_pivot(m: Any, x: Floats, z: Floats, v: int, size: int) -> None:
    """``x_v <- A_v^-1 x_v`` for a factorised pivot block; z is scratch.

    Groups of columns go beyond the triangle: only into what has been used already.
    """
    T, pivots, inverse = m.T, m.pivots, m.inverse
    for n in range(size):
        p = pivots[v, n]
        if p != n:
            x[v, n], x[v, p] = x[v, p], x[v, n]
    full = (size + GRAIN - 1) // GRAIN * GRAIN
    for n in range(size):
        z[n] = x[v, n] * inverse[v, n]
        left = (n + 1) // GRAIN * GRAIN
        place = (v * PIVOT + n) * PIVOT + left
        subtract_rows(x, v * PIVOT + left, z, n, 0, T, place, 0, 1, full - left)
    for n in range(size - 1, -1, -1):
        x[v, n] = z[n]
        place = (v * PIVOT + n) * PIVOT
        subtract_rows(z, 0, z, n, 0, T, place, 0, 1, (n + GRAIN - 1) // GRAIN * GRAIN)


@part
def sweep(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Solve for minus the residual: increments of coordinates and impulses.

    Flag 1: with factors kept from before. Each vertex takes its part of them along, turned with its
    frame: so they are out of date by strains and by what turns in joints only.
    """
    x, z, X, D, R, impulse, g = m.x, m.scratch, m.X, m.D, w.R, s.impulse, s.g
    order, ptr, neighbour, coordinates = m.order, m.ptr, m.neighbour, m.coordinates
    first, multipliers, start, parent_at = s.row, m.multipliers, m.multiplier_ptr, m.parent_at
    for v in range(len(order)):
        n = coordinates[v]
        for i in range(PIVOT):
            x[v, i] = 0.0
        for i in range(n // 3):
            r = first[v] + i
            for c in range(3):
                x[v, 3 * i + c] = -R[r, c] - impulse[r, c]
        for i in range(start[v], start[v + 1]):
            x[v, n + i - start[v]] = -m.scale[1] * g[multipliers[i]]
    if flag == 1:
        turn(s, m, w, x, False)
    for t in range(len(order)):
        v = order[t]
        n = coordinates[v]
        size = n + start[v + 1] - start[v]
        solve_pivot(m, x, z, v, size)
        for j in range(ptr[t], ptr[t + 1]):
            count = size if j - ptr[t] == parent_at[t] else n
            place = j * PIVOT * WIDE
            subtract_rows(x, neighbour[j] * PIVOT, x, v * PIVOT, 1, D, place, WIDE, count, WIDE)
    for t in range(len(order) - 1, -1, -1):
        v = order[t]
        size = coordinates[v] + start[v + 1] - start[v]
        full = (size + GRAIN - 1) // GRAIN * GRAIN
        for j in range(ptr[t], ptr[t + 1]):
            place = j * PIVOT * WIDE
            subtract_rows(x, v * PIVOT, x, neighbour[j] * PIVOT, 1, X, place, PIVOT, WIDE, full)
    if flag == 1:
        turn(s, m, w, x, True)
    change, added = w.change, s.added
    for v in range(len(order)):
        n = coordinates[v]
        for i in range(n // 3):
            for c in range(3):
                change[first[v] + i, c] = x[v, 3 * i + c]
        for i in range(start[v], start[v + 1]):
            added[multipliers[i]] = m.scale[0] * x[v, n + i - start[v]]
    return 0.0


# --------------------------------------------------------------------------------------------------
# Springs and loads in kernels with multipliers.

# -- compiled force elements with multipliers: the tangent by coordinates --------------------------


@part
def couple(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Force elements: 0 and 2 see :mod:`.couplings`; 1: ``force df/dy_1``; 3: at the start."""
    G, rows = np.empty((4, 2 * SIDE, 3)), 2 * SIDE
    if flag != 1:
        couple_force(s, w, numbers, flag, G)
        return 0.0
    A, places, forms, state, share = w.A, s.coupling, s.coupling_forms, w.coupled, numbers[SHARE]
    force = numbers[FORCE]
    for c in range(len(places)):
        for k in range(2):
            gradients(forms, places, c, k, w.mid, G, k)
            gradients(forms, places, c, k, w.y1, G, 2 + k)
        for b in range(rows):
            right = right_side(state, c, 0, share, G, b), right_side(state, c, 1, share, G, b)
            for a in range(rows):
                slot = places[c, SLOT + 2 * (a // SIDE) + b // SIDE]
                if slot < 0:
                    continue
                f = state[c, S] * forms[c, 0, a, b] + state[c, S + 1] * forms[c, 1, a, b]
                for i in range(3):
                    r = 3 * (a % SIDE) + i
                    for j in range(3):
                        product = G[0, a, i] * right[0][j] + G[1, a, i] * right[1][j]
                        A[slot, r, 3 * (b % SIDE) + j] += force * product
                    A[slot, r, 3 * (b % SIDE) + i] += force * share * f
    return 0.0


# -- compiled loads that follow the motion, with multipliers: the tangent by coordinates -----------


@part
def load(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Loads at ``w.mid``; flag 1: their tangent ``-share force df/dy``."""
    if flag == 0:
        load_force(s, w)
        return 0.0
    A, pairs, followers = w.A, s.follower, w.followers
    factor = -numbers[SHARE] * numbers[FORCE]
    for k in range(len(pairs)):
        for i in range(4):
            for j in range(4):
                for c in range(3):
                    A[pairs[k, 2], 3 * i + c, 3 * j + c] += factor * followers[k, i, j]
    V = np.zeros((3, 3))
    for k in range(len(s.moment_vertex)):
        own, f, E = moment_on(s, w, k)
        for j in range(3):
            for c in range(3):
                V[j, c] = 1.0
                change = row(V, 0), row(V, 1), row(V, 2)
                V[j, c] = 0.0
                for i in range(3):
                    g = moment_change(own, f, E, change, i)
                    for r in range(3):
                        A[m.diag[s.moment_vertex[k]], 3 + 3 * i + r, 3 + 3 * j + c] += factor * g[r]
    return 0.0
