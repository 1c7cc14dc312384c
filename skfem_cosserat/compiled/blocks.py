"""Compiled block elimination on the graph of vertices: linear in the length of chains and trees.

All blocks are 6x6: vertices with fewer unknowns are filled up with ones on the diagonal. Where a
vertex hangs on a joint, its rows and columns are those of its twist until its turn comes: then they
are turned into its joint's own coordinates, and what its parent carries along goes to the parent
(the articulated-body recursion, inside a factorisation).
"""

from __future__ import annotations

from typing import Any

from ..types import Floats, IndexArray
from .jit import jit
from .small import copy, increase

__all__ = ["back", "factor"]

#: maps of all edges: S and X where P^T is taken, where the unknowns move, and their derivatives
Maps = tuple[Floats, Floats, Floats, Floats, Floats, Floats]


@jit
def factor_block(D: Floats, pivots: IndexArray) -> bool:
    """LU of a block in place, rows exchanged, diagonal inverted; False if a pivot vanishes."""
    ok = True
    for k in range(6):
        p = k
        big = abs(D[k, k])
        for i in range(k + 1, 6):
            if abs(D[i, k]) > big:
                big = abs(D[i, k])
                p = i
        pivots[k] = p
        if not big > 0.0:
            ok = False
        if p != k:
            for c in range(6):
                D[k, c], D[p, c] = D[p, c], D[k, c]
        inv = 1.0 / D[k, k]
        D[k, k] = inv
        for i in range(k + 1, 6):
            f = D[i, k] * inv
            D[i, k] = f
            for c in range(k + 1, 6):
                D[i, c] -= f * D[k, c]
    return ok


@jit
def solve_block(D: Floats, pivots: IndexArray, U: Floats) -> None:
    """``U <- D^-1 U`` for a factorised D."""
    for k in range(6):
        p = pivots[k]
        if p != k:
            for c in range(6):
                U[k, c], U[p, c] = U[p, c], U[k, c]
    for i in range(1, 6):
        for k in range(i):
            f = D[i, k]
            for c in range(6):
                U[i, c] -= f * U[k, c]
    for i in range(5, -1, -1):
        for k in range(i + 1, 6):
            f = D[i, k]
            for c in range(6):
                U[i, c] -= f * U[k, c]
        inv = D[i, i]
        for c in range(6):
            U[i, c] *= inv


@jit
def solve_vector(D: Floats, pivots: IndexArray, b: Floats) -> None:
    """``b <- D^-1 b`` for a factorised D."""
    for k in range(6):
        p = pivots[k]
        if p != k:
            b[k], b[p] = b[p], b[k]
    for i in range(1, 6):
        for k in range(i):
            b[i] -= D[i, k] * b[k]
    for i in range(5, -1, -1):
        for k in range(i + 1, 6):
            b[i] -= D[i, k] * b[k]
        b[i] *= D[i, i]


@jit
def subtract(K: Floats, L: Floats, W: Floats) -> None:
    """``K -= L W``."""
    for i in range(6):
        for c in range(6):
            K[i, c] -= (
                L[i, 0] * W[0, c]
                + L[i, 1] * W[1, c]
                + L[i, 2] * W[2, c]
                + L[i, 3] * W[3, c]
                + L[i, 4] * W[4, c]
                + L[i, 5] * W[5, c]
            )


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
    """Right-hand side of a pivot from what eliminations before it have left."""
    e = m.edge[v]
    if e < 0:
        for i in range(6):
            b[v, i] += extra[v, i]
        return
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
def factor(m: Any, maps: Maps, A: Floats, b: Floats, extra: Floats, scratch: Floats) -> bool:
    """Eliminate all vertices; b (nv, 6) becomes ``D^-1 b``. False if a pivot vanishes.

    `extra` (nv, 6) must be zero; scratch (3, 6, 6).
    """
    regular = True
    for t in range(len(m.order)):
        v = m.order[t]
        D = A[m.diag[v]]
        pivots = m.pivots[v]
        if m.edge[v] >= 0:
            to_own_coordinates(m, t, maps, A, scratch)
        collect(m, v, maps, b, extra)
        if not factor_block(D, pivots):
            regular = False
        x = b[v]
        solve_vector(D, pivots, x)
        a0 = m.ptr[t]
        n = m.ptr[t + 1] - a0
        u0 = m.update_ptr[t]
        for j in range(n):
            solve_block(D, pivots, A[m.right[a0 + j]])
        for i in range(n):
            L = A[m.down[a0 + i]]
            y = extra[m.neighbour[a0 + i]]
            for r in range(6):
                s = L[r, 0] * x[0] + L[r, 1] * x[1] + L[r, 2] * x[2]
                y[r] -= s + L[r, 3] * x[3] + L[r, 4] * x[4] + L[r, 5] * x[5]
            for j in range(n):
                subtract(A[m.update[u0 + i * n + j]], L, A[m.right[a0 + j]])
    return regular


@jit
def back(m: Any, maps: Maps, A: Floats, b: Floats, twist: Floats) -> None:
    """Second half: b becomes the solution in own coordinates, twist (nv, 6) that of vertices."""
    for t in range(len(m.order) - 1, -1, -1):
        v = m.order[t]
        for j in range(m.ptr[t], m.ptr[t + 1]):
            W = A[m.right[j]]
            x = twist[m.neighbour[j]]
            for r in range(6):
                s = W[r, 0] * x[0] + W[r, 1] * x[1] + W[r, 2] * x[2]
                b[v, r] -= s + W[r, 3] * x[3] + W[r, 4] * x[4] + W[r, 5] * x[5]
        e = m.edge[v]
        p = m.parent[v]
        for r in range(6):
            if e < 0:
                twist[v, r] = b[v, r]
                continue
            s = 0.0
            for c in range(6):
                s += maps[2][e, r, c] * b[v, c]
                if p >= 0:
                    s += maps[3][e, r, c] * twist[p, c]
            twist[v, r] = s
