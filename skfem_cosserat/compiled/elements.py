"""Compiled kernels of beam elements: stresses, internal force, tangent in reduced coordinates.

Strains are ``Gamma_i = d_i . phi'`` and ``K_i = (d_k . d_j' - d_j . d_k')/2``, (i, j, k) cyclic, as
in :mod:`skfem_cosserat.strain`. X (nn, 4, 3) are the nodes of an element, directors those of the
section; G (7, 3) is ``phi', d1, d2, d3, d1', d2', d3'`` at a Gauss point.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..types import Floats
from .jit import jit
from .small import clear, copy, dot

__all__ = ["beam_force", "beam_predicted", "beam_stress", "beam_tangent", "scalar_block"]


@jit
def take(g: Any, e: int, y: Floats, X: Floats, Z: Floats) -> None:
    """Nodes of an element; Z (3, 3) is scratch."""
    for a in range(X.shape[0]):
        r = g.base[e, a]
        for i in range(4):
            for c in range(3):
                X[a, i, c] = y[r + i, c]
    if g.turned:
        for a in range(X.shape[0]):
            Q = g.rotations[e, a]
            for i in range(3):
                for c in range(3):
                    Z[i, c] = Q[i, 0] * X[a, 1, c] + Q[i, 1] * X[a, 2, c] + Q[i, 2] * X[a, 3, c]
            copy(Z, X[a, 1:])


@jit
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


@jit
def strains(G: Floats, eps: Floats) -> None:
    """The six strains."""
    for i in range(3):
        j = (i + 1) % 3
        k = (i + 2) % 3
        eps[i] = dot(G[1 + i], G[0])
        eps[3 + i] = 0.5 * (dot(G[1 + k], G[4 + j]) - dot(G[1 + j], G[4 + k]))


@jit
def strain_changes(G: Floats, V: Floats, eps: Floats) -> None:
    """Their first change, V (7, 3) as G for a change of the nodes."""
    for i in range(3):
        j = (i + 1) % 3
        k = (i + 2) % 3
        eps[i] = dot(G[1 + i], V[0]) + dot(V[1 + i], G[0])
        first = dot(G[1 + k], V[4 + j]) + dot(V[1 + k], G[4 + j])
        second = dot(G[1 + j], V[4 + k]) + dot(V[1 + j], G[4 + k])
        eps[3 + i] = 0.5 * (first - second)


@jit
def add_stress(D: Floats, eps: Floats, factor: float, out: Floats) -> None:
    """``out += factor D eps``."""
    for i in range(6):
        s = 0.0
        for j in range(6):
            s += D[i, j] * eps[j]
        out[i] += factor * s


@jit
def beam_stress(g: Any, y: Floats, share: float, factor: float, S0: Floats, S: Floats) -> None:
    """``S = share S0 + factor D eps(y)`` at all Gauss points."""
    ne, nn = g.base.shape
    X, Z, G, eps = np.empty((nn, 4, 3)), np.empty((3, 3)), np.empty((7, 3)), np.empty(6)
    for e in range(ne):
        take(g, e, y, X, Z)
        inverse = 1.0 / g.lengths[e]
        for p in range(len(g.weights)):
            at_point(g.N[p], g.dN[p], inverse, X, G)
            strains(G, eps)
            for i in range(6):
                eps[i] -= g.reference[e, p, i]
                S[e, p, i] = share * S0[e, p, i] if share != 0.0 else 0.0
            add_stress(g.stiffness[e], eps, factor, S[e, p])


@jit
def beam_predicted(
    g: Any, y: Floats, change: Floats, factor: float, S: Floats, out: Floats
) -> None:
    """``out = S + factor D B(y) change``."""
    ne, nn = g.base.shape
    X, V, Z = np.empty((nn, 4, 3)), np.empty((nn, 4, 3)), np.empty((3, 3))
    G, H, eps = np.empty((7, 3)), np.empty((7, 3)), np.empty(6)
    for e in range(ne):
        take(g, e, y, X, Z)
        take(g, e, change, V, Z)
        inverse = 1.0 / g.lengths[e]
        for p in range(len(g.weights)):
            at_point(g.N[p], g.dN[p], inverse, X, G)
            at_point(g.N[p], g.dN[p], inverse, V, H)
            strain_changes(G, H, eps)
            for i in range(6):
                out[e, p, i] = S[e, p, i]
            add_stress(g.stiffness[e], eps, factor, out[e, p])


@jit
def beam_force(g: Any, y: Floats, S: Floats, f: Floats) -> None:
    """``f += int B(y)^T S ds``, rows of y."""
    ne, nn = g.base.shape
    X, Z, G, F = np.empty((nn, 4, 3)), np.empty((3, 3)), np.empty((7, 3)), np.empty((nn, 4, 3))
    for e in range(ne):
        take(g, e, y, X, Z)
        inverse = 1.0 / g.lengths[e]
        for a in range(nn):
            clear(F[a])
        for p in range(len(g.weights)):
            at_point(g.N[p], g.dN[p], inverse, X, G)
            add_point_force(g.N[p], g.dN[p], g.weights[p] * g.lengths[e], inverse, G, S[e, p], F)
        for a in range(nn):
            if g.turned:  # chain rule: a nodal director is Q^T times those of the section
                Q = g.rotations[e, a]
                for i in range(3):
                    for c in range(3):
                        Z[i, c] = Q[0, i] * F[a, 1, c] + Q[1, i] * F[a, 2, c] + Q[2, i] * F[a, 3, c]
                copy(Z, F[a, 1:])
            r = g.base[e, a]
            for i in range(4):
                for c in range(3):
                    f[r + i, c] += F[a, i, c]


@jit
def add_point_force(
    N: Any, dN: Any, weight: float, inverse: float, G: Floats, s: Floats, F: Floats
) -> None:
    """Forces on the nodes of what acts at a Gauss point."""
    for c in range(3):
        n = weight * inverse * (s[0] * G[1, c] + s[1] * G[2, c] + s[2] * G[3, c])
        for a in range(len(N)):
            F[a, 0, c] += dN[a] * n
    for i in range(3):
        j = (i + 1) % 3
        k = (i + 2) % 3
        # d_i is in K_j = (d_i . d_k' - d_k . d_i')/2 and in K_k = (d_j . d_i' - d_i . d_j')/2
        normal = weight * s[i]
        mj = 0.5 * weight * s[3 + j]
        mk = 0.5 * weight * s[3 + k]
        for c in range(3):
            on_director = normal * G[0, c] + mj * G[4 + k, c] - mk * G[4 + j, c]
            on_slope = inverse * (mk * G[1 + j, c] - mj * G[1 + k, c])
            for a in range(len(N)):
                F[a, 1 + i, c] += N[a] * on_director + dN[a] * on_slope


@jit
def reduced_strain(Na: float, dNa: float, E: Floats, G: Floats, B: Floats) -> None:
    """``B P_int`` of a node (6, 6): strains by its velocity and angular velocity.

    E (4, 3) is the node where P_int is taken; those of K by the velocity are zero, and not set.
    """
    p = G[0]
    for i in range(3):
        d = G[1 + i]
        e = E[1 + i]
        for c in range(3):
            B[i, c] = dNa * d[c]
        B[i, 3] = Na * (e[1] * p[2] - e[2] * p[1])
        B[i, 4] = Na * (e[2] * p[0] - e[0] * p[2])
        B[i, 5] = Na * (e[0] * p[1] - e[1] * p[0])
    hN = 0.5 * Na
    hd = 0.5 * dNa
    for i in range(3):
        j = (i + 1) % 3
        k = (i + 2) % 3
        ej = E[1 + j]
        ek = E[1 + k]
        for c in range(3):
            a = (c + 1) % 3
            b = (c + 2) % 3
            B[3 + i, 3 + c] = (
                ej[a] * (hd * G[1 + k, b] - hN * G[4 + k, b])
                - ej[b] * (hd * G[1 + k, a] - hN * G[4 + k, a])
                - ek[a] * (hd * G[1 + j, b] - hN * G[4 + j, b])
                + ek[b] * (hd * G[1 + j, a] - hN * G[4 + j, a])
            )


@jit
def scalar_block(C: Floats, L: Floats, R: Floats, K: Floats, V: Floats) -> None:
    """``K += P_L^T (C (x) I_3) P_R`` for a node with scalar coefficients C (4, 4).

    L, R (4, 3): where the null space matrices are taken; V (3, 3) is scratch.
    """
    a0 = C[0, 1] * R[1, 0] + C[0, 2] * R[2, 0] + C[0, 3] * R[3, 0]
    a1 = C[0, 1] * R[1, 1] + C[0, 2] * R[2, 1] + C[0, 3] * R[3, 1]
    a2 = C[0, 1] * R[1, 2] + C[0, 2] * R[2, 2] + C[0, 3] * R[3, 2]
    b0 = C[1, 0] * L[1, 0] + C[2, 0] * L[2, 0] + C[3, 0] * L[3, 0]
    b1 = C[1, 0] * L[1, 1] + C[2, 0] * L[2, 1] + C[3, 0] * L[3, 1]
    b2 = C[1, 0] * L[1, 2] + C[2, 0] * L[2, 2] + C[3, 0] * L[3, 2]
    K[0, 0] += C[0, 0]
    K[1, 1] += C[0, 0]
    K[2, 2] += C[0, 0]
    K[0, 4] += a2
    K[0, 5] -= a1
    K[1, 3] -= a2
    K[1, 5] += a0
    K[2, 3] += a1
    K[2, 4] -= a0
    K[3, 1] -= b2
    K[3, 2] += b1
    K[4, 0] += b2
    K[4, 2] -= b0
    K[5, 0] -= b1
    K[5, 1] += b0
    # sum C_ij ((E_i . F_j) I - F_j E_i^T): (omega x E_i) . (theta x F_j)
    for i in range(3):
        for c in range(3):
            V[i, c] = C[1 + i, 1] * R[1, c] + C[1 + i, 2] * R[2, c] + C[1 + i, 3] * R[3, c]
    trace = dot(V[0], L[1]) + dot(V[1], L[2]) + dot(V[2], L[3])
    for r in range(3):
        for c in range(3):
            K[3 + r, 3 + c] -= V[0, r] * L[1, c] + V[1, r] * L[2, c] + V[2, r] * L[3, c]
        K[3 + r, 3 + r] += trace


@jit
def add_geometric(N: Any, dN: Any, weight: float, s: Floats, C: Floats) -> None:
    """Scalar coefficients C (nn, nn, 4, 4) of the strains' second derivatives times stresses s."""
    for a in range(len(N)):
        for b in range(len(N)):
            u = weight * dN[a] * N[b]
            v = weight * N[a] * dN[b]
            wedge = 0.5 * (u - v)
            for i in range(3):
                j = (i + 1) % 3
                k = (i + 2) % 3
                C[a, b, 0, 1 + i] += u * s[i]
                C[a, b, 1 + i, 0] += v * s[i]
                C[a, b, 1 + j, 1 + k] += wedge * s[3 + i]
                C[a, b, 1 + k, 1 + j] -= wedge * s[3 + i]


@jit
def stress_matrix(D: Floats, factor: float, B: Floats, T: Floats) -> None:
    """``T = factor D B`` for a B of :func:`reduced_strain`."""
    for i in range(6):
        for c in range(3):
            T[i, c] = factor * (D[i, 0] * B[0, c] + D[i, 1] * B[1, c] + D[i, 2] * B[2, c])
            T[i, 3 + c] = factor * (
                D[i, 0] * B[0, 3 + c]
                + D[i, 1] * B[1, 3 + c]
                + D[i, 2] * B[2, 3 + c]
                + D[i, 3] * B[3, 3 + c]
                + D[i, 4] * B[4, 3 + c]
                + D[i, 5] * B[5, 3 + c]
            )


@jit
def add_material(L: Floats, T: Floats, K: Floats) -> None:
    """``K += L^T T`` for an L of :func:`reduced_strain`."""
    for r in range(3):
        for c in range(6):
            K[r, c] += L[0, r] * T[0, c] + L[1, r] * T[1, c] + L[2, r] * T[2, c]
    for r in range(3, 6):
        for c in range(6):
            K[r, c] += (
                L[0, r] * T[0, c]
                + L[1, r] * T[1, c]
                + L[2, r] * T[2, c]
                + L[3, r] * T[3, c]
                + L[4, r] * T[4, c]
                + L[5, r] * T[5, c]
            )


@jit
def beam_tangent(
    g: Any,
    at: tuple[Floats, Floats, Floats, Floats],
    S: Floats,
    factors: tuple[float, float, float],
    A: Floats,
) -> None:
    """Add the blocks of all elements, in reduced coordinates, to their slots of A.

    ``P(y_L)^T (mass M + material int B(y_B)^T D B(y_S) ds + geometric int S . C/l ds) P(y_R)``,
    with `at` = (y_B, y_S, y_L, y_R) and `factors` = (mass, material, geometric).
    """
    ne, nn = g.base.shape
    yB, yS, yL, yR = at
    mass, material, geometric = factors
    XB, XS, Z = np.empty((nn, 4, 3)), np.empty((nn, 4, 3)), np.empty((3, 3))
    XL, XR, C = np.empty((nn, 4, 3)), np.empty((nn, 4, 3)), np.empty((nn, nn, 4, 4))
    GB, GS, L = np.empty((7, 3)), np.empty((7, 3)), np.empty((nn, 6, 6))
    B, T = np.empty((6, 6)), np.empty((6, 6))
    for e in range(ne):
        inverse = 1.0 / g.lengths[e]
        take(g, e, yB, XB, Z)
        take(g, e, yS, XS, Z)
        take(g, e, yL, XL, Z)
        take(g, e, yR, XR, Z)
        for a in range(nn):
            for b in range(nn):
                for r in range(4):
                    for c in range(4):
                        C[a, b, r, c] = mass * g.mass[e, a, b, r, c]
        for p in range(len(g.weights)):
            N = g.N[p]
            dN = g.dN[p]
            at_point(N, dN, inverse, XB, GB)
            at_point(N, dN, inverse, XS, GS)
            add_geometric(N, dN, geometric * g.weights[p], S[e, p], C)
            for a in range(nn):
                reduced_strain(N[a], dN[a] * inverse, XL[a], GB, L[a])
            for b in range(nn):
                reduced_strain(N[b], dN[b] * inverse, XR[b], GS, B)
                stress_matrix(g.stiffness[e], material * g.weights[p] * g.lengths[e], B, T)
                for a in range(nn):
                    add_material(L[a], T, A[g.slot[e, a, b]])
        for a in range(nn):
            for b in range(nn):
                scalar_block(C[a, b], XL[a], XR[b], A[g.slot[e, a, b]], Z)
