"""Compiled kernels of beam elements: stresses, internal force, tangent in reduced coordinates.

Strains are ``Gamma_i = d_i . phi'`` and ``K_i = (d_k . d_j' - d_j . d_k')/2``, (i, j, k) cyclic, as
in :mod:`skfem_cosserat.strain`. X (nn, 4, 3) are the nodes of an element, directors those of the
section; G (7, 3) is ``phi', d1, d2, d3, d1', d2', d3'`` at a Gauss point.

Arrays go with indices, not as ``a[i]``, and fields of structures are taken once: every new view
counts references, atomically, which would take longer than the arithmetic.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..types import Floats, IndexArray
from .jit import inlined, jit

__all__ = [
    "END",
    "FORCE",
    "LENGTH",
    "MASS",
    "MIXED",
    "MOMENTUM",
    "NUMBERS",
    "ROTATION",
    "START",
    "WEIGHT",
    "beam_force",
    "beam_predicted",
    "beam_stress",
    "beam_tangent",
    "scalar_block",
]


#: numbers of a step, see :class:`skfem_cosserat.integrators.base.Scheme`
NUMBERS = ("mass", "momentum", "force", "start", "end", "weight", "length", "rotation", "mixed")
MASS, MOMENTUM, FORCE, START, END, WEIGHT, LENGTH, ROTATION, MIXED = range(len(NUMBERS))


@inlined
def take(
    base: IndexArray, turned: bool, rotations: Floats, e: int, y: Floats, X: Floats, Z: Floats
) -> None:
    """Nodes of an element; Z (3, 3) is scratch."""
    for a in range(X.shape[0]):
        r = base[e, a]
        for i in range(4):
            for c in range(3):
                X[a, i, c] = y[r + i, c]
    if turned:
        for a in range(X.shape[0]):
            for i in range(3):
                for c in range(3):
                    Z[i, c] = (
                        rotations[e, a, i, 0] * X[a, 1, c]
                        + rotations[e, a, i, 1] * X[a, 2, c]
                        + rotations[e, a, i, 2] * X[a, 3, c]
                    )
            for i in range(3):
                for c in range(3):
                    X[a, 1 + i, c] = Z[i, c]


@inlined
def at_point(N: Any, dN: Any, inverse: float, X: Floats, G: Floats) -> None:
    """Interpolate to a Gauss point."""
    for c in range(3):
        s = 0.0
        for a in range(len(N)):
            s += dN[a] * X[a, 0, c]
        G[0, c] = s * inverse
    for i in range(3):
        for c in range(3):
            s = 0.0
            t = 0.0
            for a in range(len(N)):
                s += N[a] * X[a, i + 1, c]
                t += dN[a] * X[a, i + 1, c]
            G[1 + i, c] = s
            G[4 + i, c] = t * inverse


@inlined
def rows_dot(G: Floats, i: int, H: Floats, j: int) -> float:
    """``G_i . H_j``."""
    return G[i, 0] * H[j, 0] + G[i, 1] * H[j, 1] + G[i, 2] * H[j, 2]


@inlined
def strains(G: Floats, eps: Floats) -> None:
    """The six strains."""
    for i in range(3):
        j = (i + 1) % 3
        k = (i + 2) % 3
        eps[i] = rows_dot(G, 1 + i, G, 0)
        eps[3 + i] = 0.5 * (rows_dot(G, 1 + k, G, 4 + j) - rows_dot(G, 1 + j, G, 4 + k))


@inlined
def strain_changes(G: Floats, V: Floats, eps: Floats) -> None:
    """Their first change, V (7, 3) as G for a change of the nodes."""
    for i in range(3):
        j = (i + 1) % 3
        k = (i + 2) % 3
        eps[i] = rows_dot(G, 1 + i, V, 0) + rows_dot(V, 1 + i, G, 0)
        first = rows_dot(G, 1 + k, V, 4 + j) + rows_dot(V, 1 + k, G, 4 + j)
        second = rows_dot(G, 1 + j, V, 4 + k) + rows_dot(V, 1 + j, G, 4 + k)
        eps[3 + i] = 0.5 * (first - second)


@inlined
def add_stress(D: Floats, e: int, eps: Floats, factor: float, S: Floats, p: int) -> None:
    """``S_ep += factor D_e eps``."""
    for i in range(6):
        s = 0.0
        for j in range(6):
            s += D[e, i, j] * eps[j]
        S[e, p, i] += factor * s


@jit
def beam_stress(g: Any, y: Floats, share: float, factor: float, S0: Floats, S: Floats) -> None:
    """``S = share S0 + factor D eps(y)`` at all Gauss points."""
    base, turned, rotations, lengths = g.base, g.turned, g.rotations, g.lengths
    N, dN, reference, stiffness = g.N, g.dN, g.reference, g.stiffness
    ne, nn = base.shape
    X, Z, G, eps = np.empty((nn, 4, 3)), np.empty((3, 3)), np.empty((7, 3)), np.empty(6)
    for e in range(ne):
        take(base, turned, rotations, e, y, X, Z)
        inverse = 1.0 / lengths[e]
        for p in range(len(N)):
            at_point(N[p], dN[p], inverse, X, G)
            strains(G, eps)
            for i in range(6):
                eps[i] -= reference[e, p, i]
                S[e, p, i] = share * S0[e, p, i] if share != 0.0 else 0.0
            add_stress(stiffness, e, eps, factor, S, p)


@jit
def beam_predicted(
    g: Any, y: Floats, change: Floats, factor: float, S: Floats, out: Floats
) -> None:
    """``out = S + factor D B(y) change``."""
    base, turned, rotations, lengths = g.base, g.turned, g.rotations, g.lengths
    N, dN, stiffness = g.N, g.dN, g.stiffness
    ne, nn = base.shape
    X, V, Z = np.empty((nn, 4, 3)), np.empty((nn, 4, 3)), np.empty((3, 3))
    G, H, eps = np.empty((7, 3)), np.empty((7, 3)), np.empty(6)
    for e in range(ne):
        take(base, turned, rotations, e, y, X, Z)
        take(base, turned, rotations, e, change, V, Z)
        inverse = 1.0 / lengths[e]
        for p in range(len(N)):
            at_point(N[p], dN[p], inverse, X, G)
            at_point(N[p], dN[p], inverse, V, H)
            strain_changes(G, H, eps)
            for i in range(6):
                out[e, p, i] = S[e, p, i]
            add_stress(stiffness, e, eps, factor, out, p)


@jit
def beam_force(g: Any, y: Floats, S: Floats, f: Floats) -> None:
    """``f += int B(y)^T S ds``, rows of y."""
    base, turned, rotations, lengths = g.base, g.turned, g.rotations, g.lengths
    N, dN, weights = g.N, g.dN, g.weights
    ne, nn = base.shape
    X, Z, G, F = np.empty((nn, 4, 3)), np.empty((3, 3)), np.empty((7, 3)), np.empty((nn, 4, 3))
    for e in range(ne):
        take(base, turned, rotations, e, y, X, Z)
        inverse = 1.0 / lengths[e]
        for a in range(nn):
            for i in range(4):
                for c in range(3):
                    F[a, i, c] = 0.0
        for p in range(len(N)):
            at_point(N[p], dN[p], inverse, X, G)
            add_point_force(N[p], dN[p], weights[p] * lengths[e], inverse, G, S, e, p, F)
        for a in range(nn):
            if turned:  # chain rule: a nodal director is Q^T times those of the section
                for i in range(3):
                    for c in range(3):
                        Z[i, c] = (
                            rotations[e, a, 0, i] * F[a, 1, c]
                            + rotations[e, a, 1, i] * F[a, 2, c]
                            + rotations[e, a, 2, i] * F[a, 3, c]
                        )
                for i in range(3):
                    for c in range(3):
                        F[a, 1 + i, c] = Z[i, c]
            r = base[e, a]
            for i in range(4):
                for c in range(3):
                    f[r + i, c] += F[a, i, c]


@inlined
def add_point_force(
    N: Any,
    dN: Any,
    weight: float,
    inverse: float,
    G: Floats,
    S: Floats,
    e: int,
    p: int,
    F: Floats,
) -> None:
    """Forces on the nodes of what acts at a Gauss point."""
    for c in range(3):
        s = S[e, p, 0] * G[1, c] + S[e, p, 1] * G[2, c] + S[e, p, 2] * G[3, c]
        for a in range(len(N)):
            F[a, 0, c] += dN[a] * weight * inverse * s
    for i in range(3):
        j = (i + 1) % 3
        k = (i + 2) % 3
        # d_i is in K_j = (d_i . d_k' - d_k . d_i')/2 and in K_k = (d_j . d_i' - d_i . d_j')/2
        normal = weight * S[e, p, i]
        mj = 0.5 * weight * S[e, p, 3 + j]
        mk = 0.5 * weight * S[e, p, 3 + k]
        for c in range(3):
            on_director = normal * G[0, c] + mj * G[4 + k, c] - mk * G[4 + j, c]
            on_slope = inverse * (mk * G[1 + j, c] - mj * G[1 + k, c])
            for a in range(len(N)):
                F[a, 1 + i, c] += N[a] * on_director + dN[a] * on_slope


@inlined
def turned_strain(Na: float, dNa: float, X: Floats, a: int, G: Floats, B: Floats, k: int) -> None:
    """Strains by the angular velocity of node a: (6, 3), in B_k. X is where P_int is taken.

    By its velocity they are ``dNa d_i`` for Gamma_i and zero for K.
    """
    for i in range(3):
        B[k, i, 0] = Na * (X[a, 1 + i, 1] * G[0, 2] - X[a, 1 + i, 2] * G[0, 1])
        B[k, i, 1] = Na * (X[a, 1 + i, 2] * G[0, 0] - X[a, 1 + i, 0] * G[0, 2])
        B[k, i, 2] = Na * (X[a, 1 + i, 0] * G[0, 1] - X[a, 1 + i, 1] * G[0, 0])
    hN = 0.5 * Na
    hd = 0.5 * dNa
    for i in range(3):
        j = 1 + (i + 1) % 3
        m = 1 + (i + 2) % 3
        # what the directors j and m are crossed with
        u0 = hd * G[m, 0] - hN * G[3 + m, 0]
        u1 = hd * G[m, 1] - hN * G[3 + m, 1]
        u2 = hd * G[m, 2] - hN * G[3 + m, 2]
        v0 = hd * G[j, 0] - hN * G[3 + j, 0]
        v1 = hd * G[j, 1] - hN * G[3 + j, 1]
        v2 = hd * G[j, 2] - hN * G[3 + j, 2]
        B[k, 3 + i, 0] = X[a, j, 1] * u2 - X[a, j, 2] * u1 - X[a, m, 1] * v2 + X[a, m, 2] * v1
        B[k, 3 + i, 1] = X[a, j, 2] * u0 - X[a, j, 0] * u2 - X[a, m, 2] * v0 + X[a, m, 0] * v2
        B[k, 3 + i, 2] = X[a, j, 0] * u1 - X[a, j, 1] * u0 - X[a, m, 0] * v1 + X[a, m, 1] * v0


@inlined
def scalar_block(
    C: Floats, a: int, b: int, L: Floats, R: Floats, A: Floats, k: int, V: Floats
) -> None:
    """``A_k += P_L^T (C_ab (x) I_3) P_R`` for nodes with scalar coefficients C_ab (4, 4).

    L_a, R_b (4, 3): where the null space matrices are taken; V (3, 3) is scratch.
    """
    a0 = C[a, b, 0, 1] * R[b, 1, 0] + C[a, b, 0, 2] * R[b, 2, 0] + C[a, b, 0, 3] * R[b, 3, 0]
    a1 = C[a, b, 0, 1] * R[b, 1, 1] + C[a, b, 0, 2] * R[b, 2, 1] + C[a, b, 0, 3] * R[b, 3, 1]
    a2 = C[a, b, 0, 1] * R[b, 1, 2] + C[a, b, 0, 2] * R[b, 2, 2] + C[a, b, 0, 3] * R[b, 3, 2]
    b0 = C[a, b, 1, 0] * L[a, 1, 0] + C[a, b, 2, 0] * L[a, 2, 0] + C[a, b, 3, 0] * L[a, 3, 0]
    b1 = C[a, b, 1, 0] * L[a, 1, 1] + C[a, b, 2, 0] * L[a, 2, 1] + C[a, b, 3, 0] * L[a, 3, 1]
    b2 = C[a, b, 1, 0] * L[a, 1, 2] + C[a, b, 2, 0] * L[a, 2, 2] + C[a, b, 3, 0] * L[a, 3, 2]
    c = C[a, b, 0, 0]
    A[k, 0, 0] += c
    A[k, 1, 1] += c
    A[k, 2, 2] += c
    A[k, 0, 4] += a2
    A[k, 0, 5] -= a1
    A[k, 1, 3] -= a2
    A[k, 1, 5] += a0
    A[k, 2, 3] += a1
    A[k, 2, 4] -= a0
    A[k, 3, 1] -= b2
    A[k, 3, 2] += b1
    A[k, 4, 0] += b2
    A[k, 4, 2] -= b0
    A[k, 5, 0] -= b1
    A[k, 5, 1] += b0
    # sum C_ij ((E_i . F_j) I - F_j E_i^T): (omega x E_i) . (theta x F_j)
    for i in range(3):
        u = C[a, b, 1 + i, 1]
        v = C[a, b, 1 + i, 2]
        w = C[a, b, 1 + i, 3]
        s0 = u * R[b, 1, 0] + v * R[b, 2, 0] + w * R[b, 3, 0]
        s1 = u * R[b, 1, 1] + v * R[b, 2, 1] + w * R[b, 3, 1]
        s2 = u * R[b, 1, 2] + v * R[b, 2, 2] + w * R[b, 3, 2]
        V[i, 0] = s0
        V[i, 1] = s1
        V[i, 2] = s2
    trace = 0.0
    for i in range(3):
        trace += V[i, 0] * L[a, 1 + i, 0] + V[i, 1] * L[a, 1 + i, 1] + V[i, 2] * L[a, 1 + i, 2]
    for r in range(3):
        u = V[0, r]
        v = V[1, r]
        w = V[2, r]
        s0 = u * L[a, 1, 0] + v * L[a, 2, 0] + w * L[a, 3, 0]
        s1 = u * L[a, 1, 1] + v * L[a, 2, 1] + w * L[a, 3, 1]
        s2 = u * L[a, 1, 2] + v * L[a, 2, 2] + w * L[a, 3, 2]
        A[k, 3 + r, 3] -= s0
        A[k, 3 + r, 4] -= s1
        A[k, 3 + r, 5] -= s2
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
def shift_stress(D: Floats, diagonal: bool, e: int, factor: float, G: Floats, T: Floats) -> None:
    """``T = factor D_e (d1, d2, d3; 0)`` (6, 3): stresses by a velocity, but for the slope."""
    for i in range(6):
        for c in range(3):
            if not diagonal:
                s = D[e, i, 0] * G[1, c] + D[e, i, 1] * G[2, c] + D[e, i, 2] * G[3, c]
                T[i, c] = factor * s
            elif i < 3:
                T[i, c] = factor * D[e, i, i] * G[1 + i, c]
            else:
                T[i, c] = 0.0


@inlined
def turn_stress(
    D: Floats, diagonal: bool, e: int, factor: float, B: Floats, k: int, T: Floats
) -> None:
    """``T = factor D_e B_k`` (6, 3).

    Here and below sums come before stores: only so they go into vector registers, as what is stored
    might overlap with what is read.
    """
    for i in range(6):
        if diagonal:
            a = factor * D[e, i, i]
            s0 = a * B[k, i, 0]
            s1 = a * B[k, i, 1]
            s2 = a * B[k, i, 2]
        else:
            s0 = 0.0
            s1 = 0.0
            s2 = 0.0
            for j in range(6):
                a = factor * D[e, i, j]
                s0 += a * B[k, j, 0]
                s1 += a * B[k, j, 1]
                s2 += a * B[k, j, 2]
        T[i, 0] = s0
        T[i, 1] = s1
        T[i, 2] = s2


@inlined
def three_rows(G: Floats, T: Floats, out: Floats) -> None:
    """``out = (d1, d2, d3)^T T[:3]`` (3, 3)."""
    for r in range(3):
        a = G[1, r]
        b = G[2, r]
        c = G[3, r]
        s0 = a * T[0, 0] + b * T[1, 0] + c * T[2, 0]
        s1 = a * T[0, 1] + b * T[1, 1] + c * T[2, 1]
        s2 = a * T[0, 2] + b * T[1, 2] + c * T[2, 2]
        out[r, 0] = s0
        out[r, 1] = s1
        out[r, 2] = s2


@inlined
def six_rows(L: Floats, n: int, T: Floats, Q: Floats) -> None:
    """``Q_n = L_n^T T`` (3, 3)."""
    for r in range(3):
        s0 = 0.0
        s1 = 0.0
        s2 = 0.0
        for i in range(6):
            a = L[n, i, r]
            s0 += a * T[i, 0]
            s1 += a * T[i, 1]
            s2 += a * T[i, 2]
        Q[n, r, 0] = s0
        Q[n, r, 1] = s1
        Q[n, r, 2] = s2


@inlined
def add_pair(
    left: float,
    right: float,
    H: Floats,
    P: Floats,
    Q: Floats,
    L: Floats,
    n: int,
    T: Floats,
    A: Floats,
    k: int,
) -> None:
    """Material block of two nodes: ``H, P, Q`` hold what the slopes left, right scale."""
    both = left * right
    for r in range(3):
        for c in range(3):
            A[k, r, c] += both * H[r, c]
            A[k, r, 3 + c] += left * P[r, c]
            A[k, 3 + r, c] += right * Q[n, r, c]
        s0 = 0.0
        s1 = 0.0
        s2 = 0.0
        for i in range(6):
            a = L[n, i, r]
            s0 += a * T[i, 0]
            s1 += a * T[i, 1]
            s2 += a * T[i, 2]
        A[k, 3 + r, 3] += s0
        A[k, 3 + r, 4] += s1
        A[k, 3 + r, 5] += s2


@jit
def beam_tangent(g: Any, w: Any, numbers: Floats, mixed: bool) -> None:
    """Add the blocks of all elements, in reduced coordinates, to their slots.

    ``P(y_L)^T (mass M + (force/2) (int B(q_mid)^T D B(y_S) ds + int S . C/l ds)) P(y_1)``: y_L is
    where constraint forces act, y_S where the stresses come from; S are those, or predicted ones.
    """
    yB = w.mid
    yS = w.y1 if numbers[START] != 0.0 else w.mid
    yL = w.mid if numbers[WEIGHT] != 0.0 else w.y0
    yR = w.y1
    S = g.predicted if mixed else g.S
    A = w.A
    mass, half = numbers[MASS], 0.5 * numbers[FORCE]
    base, turned, rotations, lengths = g.base, g.turned, g.rotations, g.lengths
    shapes, slopes, weights = g.N, g.dN, g.weights
    masses, stiffness, slot, diagonal = g.mass, g.stiffness, g.slot, g.diagonal
    ne, nn = base.shape
    XB, XS, Z = np.empty((nn, 4, 3)), np.empty((nn, 4, 3)), np.empty((3, 3))
    XL, XR, C = np.empty((nn, 4, 3)), np.empty((nn, 4, 3)), np.empty((nn, nn, 4, 4))
    GB, GS, L, Q = np.empty((7, 3)), np.empty((7, 3)), np.empty((nn, 6, 3)), np.empty((nn, 3, 3))
    B, T, H, P = np.empty((1, 6, 3)), np.empty((6, 3)), np.empty((3, 3)), np.empty((3, 3))
    for e in range(ne):
        inverse = 1.0 / lengths[e]
        take(base, turned, rotations, e, yB, XB, Z)
        take(base, turned, rotations, e, yS, XS, Z)
        take(base, turned, rotations, e, yL, XL, Z)
        take(base, turned, rotations, e, yR, XR, Z)
        for a in range(nn):
            for b in range(nn):
                for r in range(4):
                    for c in range(4):
                        C[a, b, r, c] = mass * masses[e, a, b, r, c]
        for p in range(len(shapes)):
            N = shapes[p]
            dN = slopes[p]
            at_point(N, dN, inverse, XB, GB)
            at_point(N, dN, inverse, XS, GS)
            add_geometric(N, dN, half * weights[p], S, e, p, C)
            factor = half * weights[p] * lengths[e]
            shift_stress(stiffness, diagonal, e, factor, GS, T)
            three_rows(GB, T, H)
            for a in range(nn):
                turned_strain(N[a], dN[a] * inverse, XL, a, GB, L, a)
                six_rows(L, a, T, Q)
            for b in range(nn):
                turned_strain(N[b], dN[b] * inverse, XR, b, GS, B, 0)
                turn_stress(stiffness, diagonal, e, factor, B, 0, T)
                three_rows(GB, T, P)
                for a in range(nn):
                    left, right = dN[a] * inverse, dN[b] * inverse
                    add_pair(left, right, H, P, Q, L, a, T, A, slot[e, a, b])
        for a in range(nn):
            for b in range(nn):
                scalar_block(C, a, b, XL, XR, A, slot[e, a, b], Z)
