"""Interpolation in beam elements, and terms of their tangents, for compiled kernels.

Strains are those of :mod:`skfem_cosserat.strain`, written out for speed. X (nn, 4, 3) are the nodes
of an element, directors those of the section; ``G = (phi', d, d')`` at a Gauss point. Parts take
``(g, w, numbers, flag)``, see :mod:`.structures` and :data:`.numbers.NUMBERS`.

Arrays go with indices, not as ``a[i]``, and fields of structures are taken once: every new view
counts references, atomically, which would take longer than the arithmetic.
"""

from __future__ import annotations

from typing import Any

from ..types import Floats, IndexArray
from .jit import inlined
from .simd import load
from .small import Rotation, Vector, combine, dot, plus, put, times

__all__ = ["Point", "add_geometric", "at_point", "scalar_block", "take"]

#: slope of the centre line, directors and their slopes
Point = tuple[Vector, Rotation, Rotation]
ZERO = (0.0, 0.0, 0.0)


@inlined
def take(base: IndexArray, turned: bool, rotations: Floats, e: int, y: Floats, X: Floats) -> None:
    """Nodes of an element."""
    for a in range(X.shape[0]):
        r = base[e, a]
        for i in range(4):
            for c in range(3):
                X[a, i, c] = y[r + i, c]
        if turned:
            for c in range(3):
                d = X[a, 1, c], X[a, 2, c], X[a, 3, c]
                for i in range(3):
                    Q = rotations[e, a, i, 0], rotations[e, a, i, 1], rotations[e, a, i, 2]
                    X[a, 1 + i, c] = dot(Q, d)


@inlined
def node(X: Floats, a: int, i: int) -> Vector:
    """``X_ai``; of flat X those of :data:`WIDTH` elements."""
    if X.ndim == 1:
        k = 12 * a + 3 * i
        return load(X, k), load(X, k + 1), load(X, k + 2)
    return X[a, i, 0], X[a, i, 1], X[a, i, 2]


@inlined
def field(N: Any, X: Floats, i: int) -> Vector:
    """``sum N_a X_ai``."""
    s = ZERO
    for a in range(len(N)):
        s = plus(s, times(N[a], node(X, a, i)))
    return s


@inlined
def at_point(N: Any, dN: Any, inverse: float, X: Floats) -> Point:
    """Interpolate to a Gauss point."""
    return (
        times(inverse, field(dN, X, 0)),
        (field(N, X, 1), field(N, X, 2), field(N, X, 3)),
        (
            times(inverse, field(dN, X, 1)),
            times(inverse, field(dN, X, 2)),
            times(inverse, field(dN, X, 3)),
        ),
    )


@inlined
def scalar_block(
    C: Floats, a: int, b: int, L: Floats, R: Floats, A: Floats, k: int, V: Floats
) -> None:
    """``A_k += P_L^T (C_ab (x) I_3) P_R`` for nodes with scalar coefficients C_ab (4, 4).

    L_a, R_b (4, 3): where the null space matrices are taken; V (3, 3) is scratch.
    """
    c = C[a, b, 0, 0]
    s, t = ZERO, ZERO
    for i in range(3):
        s = plus(s, times(C[a, b, 0, 1 + i], node(R, b, 1 + i)))
        t = plus(t, times(C[a, b, 1 + i, 0], node(L, a, 1 + i)))
        A[k, i, i] += c
    A[k, 0, 4] += s[2]
    A[k, 0, 5] -= s[1]
    A[k, 1, 3] -= s[2]
    A[k, 1, 5] += s[0]
    A[k, 2, 3] += s[1]
    A[k, 2, 4] -= s[0]
    A[k, 3, 1] -= t[2]
    A[k, 3, 2] += t[1]
    A[k, 4, 0] += t[2]
    A[k, 4, 2] -= t[0]
    A[k, 5, 0] -= t[1]
    A[k, 5, 1] += t[0]
    # sum C_ij ((E_i . F_j) I - F_j E_i^T): (omega x E_i) . (theta x F_j)
    trace = 0.0
    for i in range(3):
        u = C[a, b, 1 + i, 1], C[a, b, 1 + i, 2], C[a, b, 1 + i, 3]
        v = combine(u, (node(R, b, 1), node(R, b, 2), node(R, b, 3)))
        put(V, i, v)
        trace += dot(v, node(L, a, 1 + i))
    for r in range(3):
        s = combine((V[0, r], V[1, r], V[2, r]), (node(L, a, 1), node(L, a, 2), node(L, a, 3)))
        A[k, 3 + r, 3] -= s[0]
        A[k, 3 + r, 4] -= s[1]
        A[k, 3 + r, 5] -= s[2]
        A[k, 3 + r, 3 + r] += trace


@inlined
def add_geometric(N: Any, dN: Any, weight: float, S: Floats, e: int, p: int, C: Floats) -> None:
    """Scalar coefficients C (nn, nn, 4, 4) of the strains' second derivatives times stresses."""
    for i in range(3):
        j = 1 + (i + 1) % 3
        k = 1 + (i + 2) % 3
        n = weight * S[e, p, i]
        m = 0.5 * weight * S[e, p, 3 + i]
        for a in range(len(N)):
            for b in range(len(N)):
                u = dN[a] * N[b]
                v = N[a] * dN[b]
                C[a, b, 0, 1 + i] += u * n
                C[a, b, 1 + i, 0] += v * n
                C[a, b, j, k] += (u - v) * m
                C[a, b, k, j] -= (u - v) * m
