"""Compiled tangent of beam elements in reduced coordinates.

Strains are ``Gamma_i = d_i . phi'`` and ``K_i = (d_k . d_j' - d_j . d_k')/2``, (i, j, k) cyclic, as
in :mod:`skfem_cosserat.strain`. X (nn, 4, 3) are the nodes of an element, directors those of the
section; ``G = (phi', d, d')`` at a Gauss point. Parts take ``(g, w, numbers, flag)``, see
:mod:`.layout` and :data:`.numbers.NUMBERS`.

Arrays go with indices, not as ``a[i]``, and fields of structures are taken once: every new view
counts references, atomically, which would take longer than the arithmetic.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..types import Floats, IndexArray
from .jit import inlined, part
from .lanes import load
from .numbers import FORCE, MASS, SHARE, START, WEIGHT
from .small import Rotation, Vector, combine, cross, dot, minus, plus, put, row, times

__all__ = ["Point", "add_geometric", "at_point", "beam_tangent", "scalar_block", "take"]

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
def turned_strain(Na: float, dNa: float, X: Floats, a: int, G: Point, B: Floats, k: int) -> None:
    """Strains by the angular velocity of node a: (6, 3), in B_k. X is where P_int is taken.

    By its velocity they are ``dNa d_i`` for Gamma_i and zero for K.
    """
    phi, d, e = G
    hN = 0.5 * Na
    hd = 0.5 * dNa
    for i in range(3):
        j = (i + 1) % 3
        m = (i + 2) % 3
        put3(B, k, i, times(Na, cross(node(X, a, 1 + i), phi)))
        # what the directors j and m are crossed with
        u = minus(times(hd, d[m]), times(hN, e[m]))
        v = minus(times(hd, d[j]), times(hN, e[j]))
        K = minus(cross(node(X, a, 1 + j), u), cross(node(X, a, 1 + m), v))
        put3(B, k, 3 + i, K)


@inlined
def put3(B: Floats, k: int, i: int, v: Vector) -> None:
    """``B_ki = v``."""
    B[k, i, 0] = v[0]
    B[k, i, 1] = v[1]
    B[k, i, 2] = v[2]


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


@inlined
def times_stiffness(
    D: Floats, diagonal: bool, e: int, factor: float, B: Floats, k: int, rows: int, T: Floats
) -> None:
    """``T = factor D_e B_k`` (6, 3); only as many rows of B_k are not zero.

    Here and below sums come before stores: only so they go into vector registers, as what is stored
    might overlap with what is read.
    """
    for i in range(6):
        s = ZERO
        if diagonal:
            s = times(factor * D[e, i, i], node(B, k, i))
        else:
            for j in range(rows):
                s = plus(s, times(factor * D[e, i, j], node(B, k, j)))
        put(T, i, s)


@inlined
def left_rows(L: Floats, n: int, rows: int, r: int, T: Floats) -> Vector:
    """Row r of ``L_n^T T``."""
    s = ZERO
    for i in range(rows):
        s = plus(s, times(L[n, i, r], row(T, i)))
    return s


@part
def beam_tangent(g: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Add the blocks of all elements, in reduced coordinates, to their slots.

    ``P(y_L)^T (mass M + share force (int B(q_mid)^T D B(y_S) ds + int S . C/l ds)) P(y_1)``: y_L is
    where constraint forces act, y_S where the stresses come from; S are those, or with flag 1
    predicted ones.
    """
    yB, yS, yL, yR = w.mid, w.mid, w.y0, w.y1
    if numbers[START] != 0.0:
        yS = w.y1
    if numbers[WEIGHT] != 0.0:
        yL = w.mid
    S = g.S
    if flag == 1:
        S = g.predicted
    A = w.A
    mass, half = numbers[MASS], numbers[SHARE] * numbers[FORCE]
    lengths, shapes, slopes, weights = g.lengths, g.N, g.dN, g.weights
    masses, stiffness, slot = g.mass, g.stiffness, g.slot
    base, turned, rotations = g.base, g.turned, g.rotations
    section, diagonal = g.section, g.diagonal
    ne, nn = base.shape
    XB, XS, Z = np.empty((nn, 4, 3)), np.empty((nn, 4, 3)), np.empty((3, 3))
    XL, XR, C = np.empty((nn, 4, 3)), np.empty((nn, 4, 3)), np.empty((nn, nn, 4, 4))
    D, L, Q = np.zeros((2, 6, 3)), np.empty((nn, 6, 3)), np.empty((nn, 3, 3))
    B, T, H, P = np.empty((1, 6, 3)), np.empty((6, 3)), np.empty((3, 3)), np.empty((3, 3))
    for e in range(ne):
        inverse = 1.0 / lengths[e]
        take(base, turned, rotations, e, yB, XB)
        take(base, turned, rotations, e, yS, XS)
        take(base, turned, rotations, e, yL, XL)
        take(base, turned, rotations, e, yR, XR)
        for a in range(nn):
            for b in range(nn):
                for r in range(4):
                    for c in range(4):
                        C[a, b, r, c] = mass * masses[e, a, b, r, c]
        for p in range(len(shapes)):
            N = shapes[p]
            dN = slopes[p]
            GB = at_point(N, dN, inverse, XB)
            GS = at_point(N, dN, inverse, XS)
            add_geometric(N, dN, half * weights[p], S, e, p, C)
            factor = half * weights[p] * lengths[e]
            for i in range(3):  # strains by velocities, but for the slope; zero for K
                put3(D, 0, i, GB[1][i])
                put3(D, 1, i, GS[1][i])
            times_stiffness(stiffness, diagonal, section[e], factor, D, 1, 3, T)
            for r in range(3):
                put(H, r, left_rows(D, 0, 3, r, T))
            for a in range(nn):
                turned_strain(N[a], dN[a] * inverse, XL, a, GB, L, a)
                for r in range(3):
                    put3(Q, a, r, left_rows(L, a, 6, r, T))
            for b in range(nn):
                turned_strain(N[b], dN[b] * inverse, XR, b, GS, B, 0)
                times_stiffness(stiffness, diagonal, section[e], factor, B, 0, 6, T)
                for r in range(3):
                    put(P, r, left_rows(D, 0, 3, r, T))
                for a in range(nn):
                    k = slot[e, a, b]
                    left, right = dN[a] * inverse, dN[b] * inverse
                    both = left * right
                    for r in range(3):
                        s = left_rows(L, a, 6, r, T)
                        for c in range(3):
                            A[k, r, c] += both * H[r, c]
                            A[k, r, 3 + c] += left * P[r, c]
                            A[k, 3 + r, c] += right * Q[a, r, c]
                        A[k, 3 + r, 3] += s[0]
                        A[k, 3 + r, 4] += s[1]
                        A[k, 3 + r, 5] += s[2]
        for a in range(nn):
            for b in range(nn):
                scalar_block(C, a, b, XL, XR, A, slot[e, a, b], Z)
    return 0.0
