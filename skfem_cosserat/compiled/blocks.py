"""Compiled block elimination on the graph of vertices: linear in the length of chains and trees.

All blocks are 6x6: vertices with fewer unknowns are filled up with ones on the diagonal. Where a
vertex hangs on a joint, its rows and columns are those of its twist until its turn comes: then they
are turned into its joint's own coordinates, and what its parent carries along goes to the parent
(the articulated-body recursion, inside a factorisation). In lattices the last vertices, from
``m.rest[0]`` on, are not eliminated: their blocks and right-hand sides only get into their joints'
coordinates, and a sparse solver takes them, called back at ``m.rest[1]``. Parts take
``(s, m, w, numbers, flag)`` as those of :mod:`.tree`.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..types import Floats, IndexArray
from .jit import call_back, inlined, part
from .lanes import WIDTH, add_product, put_product, put_rows, rows
from .small import Rotation, block, chosen, combine, directors, frames, times, turned

__all__ = ["factor", "sweep"]


@inlined
def factor_block(A: Floats, k: int, pivots: IndexArray, v: int) -> bool:
    """LU of block k in place, rows exchanged, diagonal inverted; False if a pivot vanishes."""
    regular = True
    for n in range(6):
        p = n
        big = abs(A[k, n, n])
        for i in range(n + 1, 6):
            if abs(A[k, i, n]) > big:
                big = abs(A[k, i, n])
                p = i
        pivots[v, n] = p
        if not big > 0.0:
            regular = False
        if p != n:
            for c in range(6):
                A[k, n, c], A[k, p, c] = A[k, p, c], A[k, n, c]
        inverse = 1.0 / A[k, n, n]
        A[k, n, n] = inverse
        for i in range(n + 1, 6):
            f = A[k, i, n] * inverse
            A[k, i, n] = f
            for c in range(n + 1, 6):
                A[k, i, c] -= f * A[k, n, c]
    return regular


@inlined
def solve_block(A: Floats, k: int, pivots: IndexArray, v: int, B: Floats, u: int) -> None:
    """``B_u <- A_k^-1 B_u`` for a factorised block k."""
    for n in range(6):
        p = pivots[v, n]
        if p != n:
            for c in range(6):
                B[u, n, c], B[u, p, c] = B[u, p, c], B[u, n, c]
    for i in range(1, 6):
        for n in range(i):
            f = A[k, i, n]
            for c in range(6):
                B[u, i, c] -= f * B[u, n, c]
    for i in range(5, -1, -1):
        for n in range(i + 1, 6):
            f = A[k, i, n]
            for c in range(6):
                B[u, i, c] -= f * B[u, n, c]
        f = A[k, i, i]
        for c in range(6):
            B[u, i, c] *= f


@inlined
def premultiply(A: Floats, k: int, B: Floats, u: int, W: Floats) -> None:
    """``B_u <- A_k B_u``; W is scratch."""
    for i in range(6):
        put_product(B, u, A, 6 * k + i, 1.0, W, i)
    for i in range(6):
        for c in range(6):
            B[u, i, c] = W[0, i, c]


@inlined
def transpose(A: Floats, k: int) -> None:
    """``A_k <- A_k^T``."""
    for i in range(6):
        for c in range(i):
            A[k, i, c], A[k, c, i] = A[k, c, i], A[k, i, c]


@inlined
def subtract(A: Floats, k: int, left: int, right: int) -> None:
    """``A_k -= A_left A_right``, row by row."""
    for i in range(6):
        add_product(A, right, A, 6 * left + i, -1.0, A, 6 * k + i)


@inlined
def passed_on(
    A: Floats, k: int, X: Floats, e: int, count: int, left: bool, to: int, W: Floats
) -> None:
    """``A_to += A_k X_e``, or from the left ``A_to += X_e^T A_k``; into A_k itself if `to` is -1.

    X_e has `count` columns that are not zero. W is scratch.
    """
    rows, columns = (count, 6) if left else (6, count)
    for r in range(rows):
        for c in range(columns):
            s = 0.0
            if left:
                for t in range(6):
                    s += X[e, t, r] * A[k, t, c]
            else:
                for t in range(6):
                    s += A[k, r, t] * X[e, t, c]
            if to >= 0:
                A[to, r, c] += s
            else:
                W[0, r, c] = s
    if to < 0:
        for r in range(6):
            for c in range(6):
                A[k, r, c] = W[0, r, c] if r < rows and c < columns else 0.0


@inlined
def to_own_coordinates(m: Any, w: Any, t: int) -> None:
    """Rows and columns of pivot t, a child: from its twist to its joint's coordinates.

    What its parent carries along goes to the parent's: all columns first, then all rows.
    """
    A, W = w.A, w.scratch
    v = m.order[t]
    e = m.edge[v]
    first = m.ptr[t]
    n = m.ptr[t + 1] - first
    u0 = m.update_ptr[t]
    p = m.parent_at[t]
    for side in range(2):
        left = side == 1
        S, X = w.S_right, w.X_right
        if left:
            S, X = w.S_left, w.X_left
        for j in range(n + 1):  # the last one is the pivot itself
            own, parents = m.diag[v], -1
            if j < n:
                own = m.right[first + j] if left else m.down[first + j]
                if p >= 0:
                    parents = m.update[u0 + (p * n + j if left else j * n + p)]
            elif p >= 0:
                parents = m.down[first + p] if left else m.right[first + p]
            if parents >= 0:
                passed_on(A, own, X, e, 6, left, parents, W)
            passed_on(A, own, S, e, m.size[v], left, -1, W)
    C_child, C_parent, S, X = w.C_child, w.C_parent, w.S_right, w.X_right
    for r in range(m.size[v]):
        for c in range(6):
            own, parents = 0.0, C_parent[e, r, c]
            for i in range(6):
                own += C_child[e, r, i] * S[e, i, c]
                parents += C_child[e, r, i] * X[e, i, c]
            A[m.diag[v], r, c] += own
            if p >= 0:
                A[m.right[first + p], r, c] += parents
    for i in range(m.size[v], 6):
        A[m.diag[v], i, i] = 1.0


@part
def factor(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Factorise: 0 if a pivot vanishes, else 1."""
    A, pivots, edge, diag, ptr = w.A, m.pivots, m.edge, m.diag, m.ptr
    order, right, down, start, update = m.order, m.right, m.down, m.update_ptr, m.update
    S, X, y1, frames, inverse = w.S_left, w.X_left, w.y1, w.frames, w.inverse
    scratch = w.scratch
    for r in range(frames.shape[0]):
        for c in range(3):
            frames[r, c] = y1[r, c]
    S_kept, X_kept = w.S_kept, w.X_kept
    for e in range(S.shape[0]):
        for r in range(6):
            for c in range(6):
                S_kept[e, r, c] = S[e, r, c]
                X_kept[e, r, c] = X[e, r, c]
    regular = 1.0
    blocks, solver = m.rest[0], m.rest[1]
    for t in range(len(order)):
        v = order[t]
        if edge[v] >= 0:
            to_own_coordinates(m, w, t)
        if t >= blocks:
            continue
        if not factor_block(A, diag[v], pivots, v):
            regular = 0.0
        for r in range(6):  # sweeps are products: triangular solutions take twice as long
            for c in range(6):
                inverse[v, r, c] = 1.0 if r == c else 0.0
        solve_block(A, diag[v], pivots, v, inverse, v)
        a0 = ptr[t]
        n = ptr[t + 1] - a0
        for j in range(n):
            premultiply(inverse, v, A, right[a0 + j], scratch)
        for i in range(n):
            for j in range(n):
                subtract(A, update[start[t] + i * n + j], down[a0 + i], right[a0 + j])
        # sweeps take what a pivot passes on from its right-hand side at once, and columns
        transpose(inverse, v)
        for j in range(n):
            transpose(A, down[a0 + j])
            premultiply(inverse, v, A, down[a0 + j], scratch)
            transpose(A, right[a0 + j])
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


@part
def sweep(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Solve for minus the residual: own coordinates x (nv, 6), and as twists of the vertices.

    Flag 1: with factors kept from before. Each vertex takes its part of them along, turned with its
    frame: so they are out of date by strains only, not by rotations.
    """
    A, x, twist, extra = w.A, w.x, w.twist, w.extra
    order, edge, ptr, neighbour = m.order, m.edge, m.ptr, m.neighbour
    right, down, parent, inverse = m.right, m.down, m.parent, w.inverse
    S_left, X_left, S, X = w.S_kept, w.X_kept, w.S_right, w.X_right
    blocks, solver = m.rest[0], m.rest[1]
    begin_sweep(s, w, flag)
    for t in range(len(order)):
        v = order[t]
        e = edge[v]
        p = parent[v]
        if e >= 0:
            for i in range(6):
                # of a child: what eliminations before it have left
                own, passed = 0.0, 0.0
                for c in range(6):
                    own += S_left[e, c, i] * extra[v, c]
                    passed += X_left[e, c, i] * extra[v, c]
                x[v, i] += own
                if p >= 0 and edge[p] < 0:
                    x[p, i] += passed
                elif p >= 0:
                    extra[p, i] += passed
        if t >= blocks:
            continue
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
            put_product(inverse, v, x, v, 1.0, x, v)
            for j in range(ptr[t], ptr[t + 1]):
                add_product(A, right[j], twist, neighbour[j], -1.0, x, v)
        e = edge[v]
        p = parent[v]
        for r in range(6):
            if e < 0:
                twist[v, r] = x[v, r]
                continue
            own = 0.0
            for c in range(6):
                own += S[e, r, c] * x[v, c]
                if p >= 0:
                    own += X[e, r, c] * twist[p, c]
            twist[v, r] = own
    if flag == 1:
        turn_back(s, m, w)
    return 0.0
