"""Compiled block elimination on the graph of vertices: linear in the length of chains and trees.

All blocks are 6x6: vertices with fewer unknowns are filled up with ones on the diagonal. Where a
vertex hangs on a joint, its rows and columns are those of its twist until its turn comes: then they
are turned into its joint's own coordinates, and what its parent carries along goes to the parent
(the articulated-body recursion, inside a factorisation).
"""

from __future__ import annotations

from typing import Any

from ..types import Floats, IndexArray
from .jit import inlined, jit
from .small import copy, increase

__all__ = ["back", "factor"]

#: maps of all edges: S and X where P^T is taken, where the unknowns move, and their derivatives
Maps = tuple[Floats, Floats, Floats, Floats, Floats, Floats]


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
def solve_block(A: Floats, k: int, pivots: IndexArray, v: int, u: int) -> None:
    """``A_u <- A_k^-1 A_u`` for a factorised block k."""
    for n in range(6):
        p = pivots[v, n]
        if p != n:
            for c in range(6):
                A[u, n, c], A[u, p, c] = A[u, p, c], A[u, n, c]
    for i in range(1, 6):
        for n in range(i):
            f = A[k, i, n]
            for c in range(6):
                A[u, i, c] -= f * A[u, n, c]
    for i in range(5, -1, -1):
        for n in range(i + 1, 6):
            f = A[k, i, n]
            for c in range(6):
                A[u, i, c] -= f * A[u, n, c]
        f = A[k, i, i]
        for c in range(6):
            A[u, i, c] *= f


@inlined
def solve_vector(A: Floats, k: int, pivots: IndexArray, v: int, b: Floats) -> None:
    """``b_v <- A_k^-1 b_v`` for a factorised block k."""
    for n in range(6):
        p = pivots[v, n]
        if p != n:
            b[v, n], b[v, p] = b[v, p], b[v, n]
    for i in range(1, 6):
        for n in range(i):
            b[v, i] -= A[k, i, n] * b[v, n]
    for i in range(5, -1, -1):
        for n in range(i + 1, 6):
            b[v, i] -= A[k, i, n] * b[v, n]
        b[v, i] *= A[k, i, i]


@inlined
def subtract(A: Floats, k: int, left: int, right: int) -> None:
    """``A_k -= A_left A_right``; sums before stores, so that they go into vector registers."""
    for i in range(6):
        s0, s1, s2, s3, s4, s5 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for n in range(6):
            a = A[left, i, n]
            s0 += a * A[right, n, 0]
            s1 += a * A[right, n, 1]
            s2 += a * A[right, n, 2]
            s3 += a * A[right, n, 3]
            s4 += a * A[right, n, 4]
            s5 += a * A[right, n, 5]
        A[k, i, 0] -= s0
        A[k, i, 1] -= s1
        A[k, i, 2] -= s2
        A[k, i, 3] -= s3
        A[k, i, 4] -= s4
        A[k, i, 5] -= s5


@jit
def product(A: Floats, B: Floats, out: Floats) -> None:
    """``out = A B``; for joints: they are few, and unrolled loops take long to compile."""
    n = A.shape[0]
    for i in range(n):
        for c in range(n):
            s = 0.0
            for k in range(n):
                s += A[i, k] * B[k, c]
            out[i, c] = s


@jit
def transposed_product(A: Floats, B: Floats, out: Floats) -> None:
    """``out = A^T B``, likewise."""
    n = A.shape[0]
    for i in range(n):
        for c in range(n):
            s = 0.0
            for k in range(n):
                s += A[k, i] * B[k, c]
            out[i, c] = s


@jit
def to_parent(m: Any, t: int, maps: Maps, A: Floats, T: Floats, U: Floats, V: Floats) -> None:
    """Rows and columns of pivot t, a child, that its parent carries along; T = D S_right.

    On return those between child and parent are in the child's own coordinates; U, V are scratch.
    """
    v = m.order[t]
    e = m.edge[v]
    S_left, X_left, S_right, X_right = maps[0][e], maps[1][e], maps[2][e], maps[3][e]
    a0 = m.ptr[t]
    n = m.ptr[t + 1] - a0
    u0 = m.update_ptr[t]
    p = m.parent_at[t]
    row = A[m.right[a0 + p]]
    column = A[m.down[a0 + p]]
    own = A[m.update[u0 + p * n + p]]
    product(A[m.diag[v]], X_right, U)
    increase(U, row)
    transposed_product(X_left, U, V)
    increase(own, V)
    product(column, X_right, V)
    increase(own, V)
    for j in range(n):
        if j != p:
            transposed_product(X_left, A[m.right[a0 + j]], V)
            increase(A[m.update[u0 + p * n + j]], V)
            product(A[m.down[a0 + j]], X_right, V)
            increase(A[m.update[u0 + j * n + p]], V)
    # row <- S^T (D X + row) + C X + C_p, column <- X^T D S + column S
    transposed_product(S_left, U, row)
    product(maps[4][e], X_right, U)
    increase(row, U)
    increase(row, maps[5][e])
    product(column, S_right, U)
    transposed_product(X_left, T, column)
    increase(column, U)


@jit
def to_own_coordinates(m: Any, t: int, maps: Maps, A: Floats, scratch: Floats) -> None:
    """Rows and columns of pivot t, a child: from its twist to its joint's coordinates."""
    v = m.order[t]
    e = m.edge[v]
    D = A[m.diag[v]]
    T, U, V = scratch[0], scratch[1], scratch[2]
    product(D, maps[2][e], T)
    p = m.parent_at[t]
    if p >= 0:
        to_parent(m, t, maps, A, T, U, V)
    for j in range(m.ptr[t], m.ptr[t + 1]):
        if j != m.ptr[t] + p or p < 0:
            row = A[m.right[j]]
            column = A[m.down[j]]
            transposed_product(maps[0][e], row, V)
            copy(V, row)
            product(column, maps[2][e], V)
            copy(V, column)
    transposed_product(maps[0][e], T, D)
    product(maps[4][e], maps[2][e], V)
    increase(D, V)
    for i in range(m.size[v], 6):
        D[i, i] = 1.0


@jit
def collect(m: Any, v: int, maps: Maps, b: Floats, extra: Floats) -> None:
    """Right-hand side of a child from what eliminations before it have left."""
    e = m.edge[v]
    p = m.parent[v]
    for i in range(6):
        s = 0.0
        r = 0.0
        for c in range(6):
            s += maps[0][e, c, i] * extra[v, c]
            if p >= 0:
                r += maps[1][e, c, i] * extra[v, c]
        b[v, i] += s
        if p >= 0:
            extra[p, i] += r


@jit
def factor(m: Any, w: Any) -> bool:
    """Eliminate all vertices: the first half of solving for minus the residual.

    False if a pivot vanishes.
    """
    maps = (w.S_left, w.X_left, w.S_right, w.X_right, w.C_child, w.C_parent)
    A, b, extra, scratch = w.A, w.x, w.extra, w.scratch
    for v in range(b.shape[0]):
        for c in range(6):
            b[v, c] = -w.b[v, c]
            extra[v, c] = 0.0
    order, edge, diag, ptr, neighbour = m.order, m.edge, m.diag, m.ptr, m.neighbour
    right, down, start, update, pivots = m.right, m.down, m.update_ptr, m.update, m.pivots
    regular = True
    for t in range(len(order)):
        v = order[t]
        D = diag[v]
        if edge[v] >= 0:
            to_own_coordinates(m, t, maps, A, scratch)
            collect(m, v, maps, b, extra)
        else:
            for i in range(6):
                b[v, i] += extra[v, i]
        if not factor_block(A, D, pivots, v):
            regular = False
        solve_vector(A, D, pivots, v, b)
        a0 = ptr[t]
        n = ptr[t + 1] - a0
        for j in range(n):
            solve_block(A, D, pivots, v, right[a0 + j])
        for i in range(n):
            k = down[a0 + i]
            u = neighbour[a0 + i]
            for r in range(6):
                s = 0.0
                for c in range(6):
                    s += A[k, r, c] * b[v, c]
                extra[u, r] -= s
            for j in range(n):
                subtract(A, update[start[t] + i * n + j], k, right[a0 + j])
    return regular


@jit
def back(m: Any, w: Any) -> None:
    """Second half: the increment in own coordinates, x (nv, 6), and as twists of the vertices."""
    A, b, twist = w.A, w.x, w.twist
    order, edge, parent = m.order, m.edge, m.parent
    ptr, neighbour, right = m.ptr, m.neighbour, m.right
    S, X = w.S_right, w.X_right
    for t in range(len(order) - 1, -1, -1):
        v = order[t]
        for j in range(ptr[t], ptr[t + 1]):
            k = right[j]
            u = neighbour[j]
            for r in range(6):
                s = 0.0
                for c in range(6):
                    s += A[k, r, c] * twist[u, c]
                b[v, r] -= s
        e = edge[v]
        p = parent[v]
        for r in range(6):
            if e < 0:
                twist[v, r] = b[v, r]
                continue
            s = 0.0
            for c in range(6):
                s += S[e, r, c] * b[v, c]
                if p >= 0:
                    s += X[e, r, c] * twist[p, c]
            twist[v, r] = s
