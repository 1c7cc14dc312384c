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
from .jit import call_back, inlined, part
from .simd import (
    WIDTH,
    add_crossed,
    add_product,
    add_times,
    copy,
    put_crossed,
    put_product,
    put_rows,
    put_times,
    put_turned,
    rows,
    subtract_crossed,
    transpose,
    triangles,
)
from .small import Rotation, block, chosen, combine, directors, frames, turned


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
            W[0, r, c] = A[k, r, c]
            lower[v, r, c] = 1.0 if r == c else 0.0
            upper[v, r, c] = 1.0 if r == c else 0.0
    sign = 1.0
    for n in range(size):
        p = n
        for i in range(n + 1, size):
            if abs(W[0, i, n]) > abs(W[0, p, n]):
                p = i
        pivot = W[0, p, n]
        if not abs(pivot) > 0.0:
            return 0.0
        if (pivot < 0.0) != (p != n):
            sign = -sign
        for c in range(size):
            W[0, p, c], W[0, n, c] = W[0, n, c], W[0, p, c] / pivot
            lower[v, c, p], lower[v, c, n] = lower[v, c, n], lower[v, c, p] / pivot
        for i in range(n + 1, size):
            f = W[0, i, n]
            for c in range(size):
                W[0, i, c] -= f * W[0, n, c]
                lower[v, c, i] -= f * lower[v, c, n]
    for n in range(size - 1, 0, -1):
        for i in range(n):
            for c in range(n, size):
                upper[v, c, i] -= W[0, i, n] * upper[v, c, n]
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
    S, X, C_child, C_parent = w.S_right, w.X_right, w.C_child, w.C_parent
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
        for r in range(A.shape[1]):
            for c in range(A.shape[1]):
                A[to, r, c] += C_parent[e, r, c]
    for i in range(m.size[v], A.shape[1]):
        A[k, i, i] = 1.0


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
def carry(D: Rotation, E: Rotation, a: Floats, v: int, c: int) -> None:
    """Turn three components, from c on, with a frame: from where it was D to where it is E."""
    u = combine(turned(D, (a[v, c], a[v, c + 1], a[v, c + 2])), E)
    a[v, c] = u[0]
    a[v, c + 1] = u[1]
    a[v, c + 2] = u[2]


@inlined
def turn_own(s: Any, w: Any, y: Floats, z: Floats) -> None:
    """Turn x (nv, 6) with the frames of the vertices, from where they are at y to where at z."""
    x, child, loose, first, triple = w.x, s.child, s.loose, s.row, s.triple
    owner, vectors, count = s.row_owner, s.row_triple, len(loose)
    for k in range(0, count, WIDTH):
        vs = chosen(loose, block(k, count))
        own = chosen(first, vs)
        D, E = frames(y, own)[1], frames(z, own)[1]
        u, v = rows(x, vs, 6, 0), rows(x, vs, 6, 2)
        f = combine(turned(D, (u[0], u[1], u[2])), E)
        m = combine(turned(D, (u[3], v[2], v[3])), E)
        put_rows(x, vs, 6, 0, (f[0], f[1], f[2], m[0]))
        put_rows(x, vs, 6, 2, (f[2], m[0], m[1], m[2]))
    for e in range(len(child)):
        c, r = child[e], first[child[e]]
        if triple[c] >= 0:
            carry(directors(y, r), directors(z, r), x, c, triple[c])
    for k in range(len(vectors)):  # among constraint rows, with a frame that they hold
        if vectors[k] >= 0:
            r = first[owner[k]]
            carry(directors(y, r), directors(z, r), x, len(first) + k, vectors[k])


@part
def sweep(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Solve for minus the residual: own coordinates x (nv, 6), and as twists of the vertices.

    Flag 1: with factors kept from before. Each vertex takes its part of them along, turned with its
    frame: so they are out of date by strains only, not by rotations.
    """
    b, x, extra, twist, now, then, child = w.b, w.x, w.extra, w.twist, w.y1, w.frames, s.child
    for v in range(x.shape[0]):
        for c in range(6):
            x[v, c] = -b[v, c]
    for e in range(len(child)):
        for c in range(6):
            extra[child[e], c] = 0.0
    if flag == 1:
        turn_own(s, w, now, then)
    solve_blocks(m, w)
    if flag == 0:
        return 0.0
    turn_own(s, w, then, now)
    for k in range(len(s.free)):
        for c in range(6):
            twist[s.free[k], c] = x[s.free[k], c]
    for e in range(len(child)):
        v, r = child[e], s.row[child[e]]
        if s.framed[v]:
            carry(directors(then, r), directors(now, r), twist, v, 0)
            carry(directors(then, r), directors(now, r), twist, v, 3)
    return 0.0


@inlined
def twist_of(S: Floats, X: Floats, e: int, x: Floats, v: int, p: int, twist: Floats) -> None:
    """Twist of a child from its own coordinates and, if it is not -1, that of its parent."""
    for r in range(S.shape[1]):
        own = 0.0
        for c in range(S.shape[1]):
            own += S[e, r, c] * x[v, c]
            if p >= 0:
                own += X[e, r, c] * twist[p, c]
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
