"""Compiled block elimination on the graph of vertices: linear in the length of chains and trees.

All blocks are 6x6: vertices with fewer unknowns are filled up with ones on the
diagonal. Pivots act by their triangular factors: of thin elements their inverses have few right
digits. Blocks of constraint rows with multipliers count as vertices, too. Where a vertex hangs on
a joint, its rows and columns are those of its twist until its turn comes: then they are turned into
its joint's own coordinates, and what its parent carries along goes to the parent (the
articulated-body recursion, inside a factorisation). In lattices the last vertices, from
``m.rest[0]`` on, are not eliminated: their blocks and right-hand sides only get into their joints'
coordinates, and a sparse solver takes them, called back at ``m.rest[1]``. Parts take
``(s, m, w, numbers, flag)`` as those of :mod:`.tree`.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..types import Floats
from .block_algebra import (
    add_block,
    add_crossed,
    add_times,
    entry,
    put_crossed,
    put_entry,
    put_times,
    put_turned,
    subtract_crossed,
    transpose,
    triangles,
)
from .jit import call_back, inlined, part
from .simd import WIDTH, add_product, copy, put_product, put_rows, rows
from .small import Rotation, block, chosen, combine, directors, frames, times, turned


@inlined
def triangles_exchanging(
    A: Floats, k: int, W: Floats, lower: Floats, upper: Floats, v: int
) -> float:
    """``A_k^-T = lower_v upper_v`` as of :func:`.triangles`, with exchange of rows; W is scratch.

    Gives the sign of the determinant, 0 if a pivot vanishes. It is rarely called: loops over
    `size`, which no compiler knows, stay short.
    """
    size = A.shape[1]
    for r in range(size):
        for c in range(size):
            put_entry(W, 0, r, c, entry(A, k, r, c))
            put_entry(lower, v, r, c, 1.0 if r == c else 0.0)
            put_entry(upper, v, r, c, 1.0 if r == c else 0.0)
    sign = 1.0
    for n in range(size):
        p = n
        for i in range(n + 1, size):
            if abs(entry(W, 0, i, n)) > abs(entry(W, 0, p, n)):
                p = i
        pivot = entry(W, 0, p, n)
        if not abs(pivot) > 0.0:
            return 0.0
        if (pivot < 0.0) != (p != n):
            sign = -sign
        for c in range(size):
            own, new = entry(W, 0, n, c), entry(W, 0, p, c) / pivot
            put_entry(W, 0, p, c, own)
            put_entry(W, 0, n, c, new)
            own, new = entry(lower, v, c, n), entry(lower, v, c, p) / pivot
            put_entry(lower, v, c, p, own)
            put_entry(lower, v, c, n, new)
        for i in range(n + 1, size):
            f = entry(W, 0, i, n)
            for c in range(size):
                put_entry(W, 0, i, c, entry(W, 0, i, c) - f * entry(W, 0, n, c))
                put_entry(lower, v, c, i, entry(lower, v, c, i) - f * entry(lower, v, c, n))
    for n in range(size - 1, 0, -1):
        for i in range(n):
            for c in range(n, size):
                left = entry(upper, v, c, i) - entry(W, 0, i, n) * entry(upper, v, c, n)
                put_entry(upper, v, c, i, left)
    return sign


@inlined
def to_own_coordinates(m: Any, w: Any, t: int) -> None:
    """Rows and columns of pivot t, a child: from its twist to its joint's coordinates.

    What its parent carries along goes to the parent's: all columns first, then all rows. Columns of
    S behind the joint's coordinates are zero, as are rows of C.
    """
    A = w.A
    v = m.order[t]
    e, k = m.edge[v], m.diag[v]
    first = m.ptr[t]
    n = m.ptr[t + 1] - first
    u0 = m.update_ptr[t]
    p = m.parent_at[t]
    S, X, C_child = w.S_right, w.X_right, w.C_child
    for j in range(n + 1):  # the last one is the pivot itself
        own = m.down[first + j] if j < n else k
        if p >= 0:
            to = m.update[u0 + j * n + p] if j < n else m.right[first + p]
            if to >= 0:
                add_times(A, own, X, e, A, to)
        put_times(A, own, S, e, A, own)
    for j in range(n + 1):
        own = m.right[first + j] if j < n else k
        if p >= 0:
            to = m.update[u0 + p * n + j] if j < n else m.down[first + p]
            if to >= 0:
                add_crossed(w.X_left, e, A, own, A, to)
        put_crossed(w.S_left, e, A, own, A, own)
    add_times(C_child, e, S, e, A, k)
    if p >= 0:
        to = m.right[first + p]
        add_times(C_child, e, X, e, A, to)
        add_block(w.C_parent, e, A, to)
    for i in range(m.size[v], A.shape[1]):
        put_entry(A, k, i, i, 1.0)


@part
def factor(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Factorise: 0 if a pivot vanishes, else 1. Blocks of the diagonal stay as they are then."""
    A, edge, diag, ptr = w.A, m.edge, m.diag, m.ptr
    order, right, down, start, update = m.order, m.right, m.down, m.update_ptr, m.update
    lower, upper = w.lower, w.upper
    copy(w.y1, w.frames)
    copy(w.S_left, w.S_kept)
    copy(w.X_left, w.X_kept)
    regular = 1.0
    blocks, solver = m.rest[0], m.rest[1]
    for t in range(len(order)):
        v = order[t]
        if edge[v] >= 0:
            to_own_coordinates(m, w, t)
        if t >= blocks:
            continue
        if not triangles(A, diag[v], lower, upper, v):
            regular *= abs(triangles_exchanging(A, diag[v], w.scratch, lower, upper, v))
        # transposed, as sweeps take them: what a pivot passes on from its right-hand side goes at
        # once, by columns
        a0, end = ptr[t], ptr[t + 1]
        u = start[t]
        for j in range(a0, end):
            put_crossed(lower, v, A, right[j], A, right[j])
        for i in range(a0, end):
            put_turned(upper, v, A, down[i], A, down[i])
            for j in range(a0, end):
                subtract_crossed(A, down[i], A, right[j], A, update[u])
                u += 1
        for j in range(a0, end):
            transpose(A, right[j])
    if solver != 0 and call_back(solver, 0) == 0.0:
        regular = 0.0
    return regular


@inlined
def carry(D: Rotation, E: Rotation, sign: float, a: Floats, v: int, c: int, out: Floats) -> None:
    """Turn three components, from c on, with a frame: from where it was D to where it is E."""
    u = combine(turned(D, (a[v, c], a[v, c + 1], a[v, c + 2])), E)
    out[v, c] = sign * u[0]
    out[v, c + 1] = sign * u[1]
    out[v, c + 2] = sign * u[2]


@inlined
def turn_all(s: Any, y: Floats, z: Floats, sign: float, a: Floats, out: Floats) -> None:
    """``out = sign R a`` (nv, 6) of free frames, R from where they are at y to where at z."""
    loose, first = s.loose, s.row
    count = len(loose)
    for k in range(0, count, WIDTH):
        vs = chosen(loose, block(k, count))
        own = chosen(first, vs)
        D, E = frames(y, own)[1], frames(z, own)[1]
        u, v = rows(a, vs, 6, 0), rows(a, vs, 6, 2)
        f = combine(turned(D, (u[0], u[1], u[2])), E)
        m = combine(turned(D, (u[3], v[2], v[3])), E)
        f, m = times(sign, f), times(sign, m)
        put_rows(out, vs, 6, 0, (f[0], f[1], f[2], m[0]))
        put_rows(out, vs, 6, 2, (f[2], m[0], m[1], m[2]))


@inlined
def turn_back(s: Any, m: Any, w: Any) -> None:
    """Increments from the frames of kept factors to where these are now."""
    x, twist, y1, then_y, first, triple = w.x, w.twist, w.y1, w.frames, s.row, s.triple
    child = s.child
    turn_all(s, then_y, y1, 1.0, x, x)
    for k in range(len(s.free)):
        v = s.free[k]
        for c in range(6):
            twist[v, c] = x[v, c]
    for e in range(len(child)):
        v = child[e]
        if not s.framed[v]:
            continue
        now, then = directors(y1, first[v]), directors(then_y, first[v])
        carry(then, now, 1.0, twist, v, 0, twist)
        carry(then, now, 1.0, twist, v, 3, twist)
        if triple[v] >= 0:
            carry(then, now, 1.0, x, v, triple[v], x)
    turn_rows(s, w, then_y, y1, 1.0, x)


@inlined
def turn_rows(s: Any, w: Any, y: Floats, z: Floats, sign: float, a: Floats) -> None:
    """Turn vectors among constraint rows, with a frame that they hold: ``x = sign R a``."""
    owner, triple, first, x = s.row_owner, s.row_triple, s.row, w.x
    for k in range(len(triple)):
        if triple[k] >= 0:
            r = first[owner[k]]
            carry(directors(y, r), directors(z, r), sign, a, len(first) + k, triple[k], x)


@inlined
def begin_sweep(s: Any, w: Any, flag: int) -> None:
    """X = -b; flag 1: turned with the frames to where they were."""
    b, x, extra, y1, then_y, first, triple = w.b, w.x, w.extra, w.y1, w.frames, s.row, s.triple
    child, free, framed = s.child, s.free, s.framed
    for k in range(len(free)):
        v = free[k]
        if flag == 0 or not framed[v]:
            for c in range(6):
                x[v, c] = -b[v, c]
    if flag == 1:
        turn_all(s, y1, then_y, -1.0, b, x)
    for e in range(len(child)):
        v = child[e]
        for c in range(6):
            x[v, c] = -b[v, c]
            extra[v, c] = 0.0
        if flag == 1 and triple[v] >= 0:
            now, then = directors(y1, first[v]), directors(then_y, first[v])
            carry(now, then, -1.0, b, v, triple[v], x)
    for v in range(len(first), x.shape[0]):
        for c in range(6):
            x[v, c] = -b[v, c]
    if flag == 1:
        turn_rows(s, w, y1, then_y, -1.0, b)


@part
def sweep(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Solve for minus the residual: own coordinates x (nv, 6), and as twists of the vertices.

    Flag 1: with factors kept from before. Each vertex takes its part of them along, turned with its
    frame: so they are out of date by strains only, not by rotations.
    """
    begin_sweep(s, w, flag)
    solve_blocks(m, w)
    if flag == 1:
        turn_back(s, m, w)
    return 0.0


@inlined
def twist_of(S: Floats, X: Floats, e: int, x: Floats, v: int, p: int, twist: Floats) -> None:
    """Twist of a child from its own coordinates and, if it is not -1, that of its parent."""
    for r in range(S.shape[1]):
        own = 0.0
        for c in range(S.shape[1]):
            own += entry(S, e, r, c) * x[v, c]
            if p >= 0:
                own += entry(X, e, r, c) * twist[p, c]
        twist[v, r] = own


@inlined
def solve_blocks(m: Any, w: Any) -> None:
    """From the right-hand side in x to own coordinates x, and twists of the vertices."""
    A, x, twist, extra = w.A, w.x, w.twist, w.extra
    order, edge, ptr, neighbour = m.order, m.edge, m.ptr, m.neighbour
    right, down, parent, lower, upper = m.right, m.down, m.parent, w.lower, w.upper
    S_left, X_left, S, X = w.S_kept, w.X_kept, w.S_right, w.X_right
    blocks, solver = m.rest[0], m.rest[1]
    for t in range(len(order)):
        v = order[t]
        e = edge[v]
        p = parent[v]
        if e >= 0:
            # of a child: what eliminations before it have left
            add_product(S_left, e, extra, v, 1.0, x, v)
            if p >= 0 and edge[p] < 0:
                add_product(X_left, e, extra, v, 1.0, x, p)
            elif p >= 0:
                add_product(X_left, e, extra, v, 1.0, extra, p)
        if t >= blocks:
            continue
        put_product(lower, v, x, v, 1.0, x, v)
        for j in range(ptr[t], ptr[t + 1]):
            u = neighbour[j]
            if edge[u] < 0:
                add_product(A, down[j], x, v, -1.0, x, u)
            else:
                add_product(A, down[j], x, v, -1.0, extra, u)
    if solver != 0 and call_back(solver, 1) == 0.0:
        x[order[blocks], 0] = np.nan  # no increment
    for t in range(len(order) - 1, -1, -1):
        v = order[t]
        if t < blocks:
            for j in range(ptr[t], ptr[t + 1]):
                add_product(A, right[j], twist, neighbour[j], -1.0, x, v)
            put_product(upper, v, x, v, 1.0, x, v)
        e = edge[v]
        if e < 0:
            for r in range(x.shape[1]):
                twist[v, r] = x[v, r]
        else:
            twist_of(S, X, e, x, v, parent[v], twist)
