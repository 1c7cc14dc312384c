"""Compiled stresses and internal force of beam elements, :data:`WIDTH` elements at a time.

X, F (12 nn WIDTH) are nodes of these elements and forces on them, the same entry of all of them
side by side. The last elements of a mesh are taken more than once, and give their force once.
Parts take ``(g, w, numbers, flag)`` as those of :mod:`.elements`.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..types import Floats, IndexArray
from .elements import Point, at_point
from .jit import inlined, part
from .numbers import END, SHARE, START
from .simd import WIDTH, add_rows, gather, load, rows, scatter, store
from .small import Places, Vector, block, chosen, combine, counted, dot, minus, times

__all__ = ["beam_force", "beam_predicted", "beam_start"]


@inlined
def origins(base: IndexArray, es: Places, a: int) -> Places:
    """First rows of their nodes a."""
    return base[es[0], a], base[es[1], a], base[es[2], a], base[es[3], a]


@inlined
def take(
    base: IndexArray, turned: bool, rotations: Floats, es: Places, y: Floats, X: Floats
) -> None:
    """Nodes of these elements."""
    nn = base.shape[1]
    for a in range(nn):
        first = origins(base, es, a)
        k = 12 * a
        for j in range(3):
            found = rows(y, first, 3, 4 * j)
            for i in range(4):
                store(X, k + 4 * j + i, found[i])
        if turned:
            turn(rotations, es, nn, a, X, False)


@inlined
def turn(rotations: Floats, es: Places, nn: int, a: int, X: Floats, back: bool) -> None:
    """Directors of nodes a to those of their sections; back: forces, by the transpose."""
    for c in range(3):
        k = 12 * a + 3 + c
        d = load(X, k), load(X, k + 3), load(X, k + 6)
        for i in range(3):
            row, step = 9 * a + 3 * i, 1
            if back:
                row, step = 9 * a + i, 3
            Q = (
                gather(rotations, es, 9 * nn, row),
                gather(rotations, es, 9 * nn, row + step),
                gather(rotations, es, 9 * nn, row + 2 * step),
            )
            store(X, k + 3 * i, dot(Q, d))


@inlined
def give(
    base: IndexArray, turned: bool, rotations: Floats, es: Places, F: Floats, f: Floats
) -> None:
    """Add forces on section directors to those of the nodes: these are Q^T times them."""
    nn = base.shape[1]
    for a in range(nn):
        if turned:
            turn(rotations, es, nn, a, F, True)
        first = origins(base, es, a)
        for j in range(3):
            k = 12 * a + 4 * j
            four = load(F, k), load(F, k + 1), load(F, k + 2), load(F, k + 3)
            add_rows(f, first, 3, 4 * j, four)


@inlined
def strains(G: Point) -> tuple[Vector, Vector]:
    """Gamma and K."""
    p, d, e = G
    return (
        (dot(d[0], p), dot(d[1], p), dot(d[2], p)),
        (
            0.5 * (dot(d[2], e[1]) - dot(d[1], e[2])),
            0.5 * (dot(d[0], e[2]) - dot(d[2], e[0])),
            0.5 * (dot(d[1], e[0]) - dot(d[0], e[1])),
        ),
    )


@inlined
def strain_changes(G: Point, V: Point) -> tuple[Vector, Vector]:
    """Their first change, V as G for a change of the nodes."""
    p, d, e = G
    q, u, f = V
    return (
        (
            dot(d[0], q) + dot(u[0], p),
            dot(d[1], q) + dot(u[1], p),
            dot(d[2], q) + dot(u[2], p),
        ),
        (
            0.5 * (dot(d[2], f[1]) + dot(u[2], e[1]) - dot(d[1], f[2]) - dot(u[1], e[2])),
            0.5 * (dot(d[0], f[2]) + dot(u[0], e[2]) - dot(d[2], f[0]) - dot(u[2], e[0])),
            0.5 * (dot(d[1], f[0]) + dot(u[1], e[0]) - dot(d[0], f[1]) - dot(u[0], e[1])),
        ),
    )


@inlined
def triple(a: Floats, es: Places, size: int, first: int) -> Vector:
    """Three entries of each."""
    return (
        gather(a, es, size, first),
        gather(a, es, size, first + 1),
        gather(a, es, size, first + 2),
    )


@inlined
def stress(D: Floats, section: Places, i: int, diagonal: bool, eps: tuple[Vector, Vector]) -> float:
    """``(D eps)_i``, D that of the sections."""
    if diagonal:
        return gather(D, section, 36, 7 * i) * (eps[0][i] if i < 3 else eps[1][i - 3])
    here, there = triple(D, section, 36, 6 * i), triple(D, section, 36, 6 * i + 3)
    return dot(here, eps[0]) + dot(there, eps[1])


@inlined
def strained(reference: Floats, es: Places, ng: int, p: int, G: Point) -> tuple[Vector, Vector]:
    """Strains at G less those of the reference configuration."""
    Gamma, K = strains(G)
    return (
        minus(Gamma, triple(reference, es, 6 * ng, 6 * p)),
        minus(K, triple(reference, es, 6 * ng, 6 * p + 3)),
    )


@part
def beam_start(g: Any, w: Any, numbers: Floats, flag: int) -> float:
    """S0: stresses at the start of the step."""
    lengths, N, dN, reference, stiffness = g.lengths, g.N, g.dN, g.reference, g.stiffness
    y, S0 = w.y0, g.S0
    base, turned, rotations = g.base, g.turned, g.rotations
    section, diagonal = g.section, g.diagonal
    ne, nn = base.shape
    ng = len(N)
    X = np.empty(12 * nn * WIDTH)
    for e in range(0, ne, WIDTH):
        es = block(e, ne)
        take(base, turned, rotations, es, y, X)
        inverse = 1.0 / gather(lengths, es, 1, 0)
        own = chosen(section, es)
        for p in range(ng):
            G = at_point(N[p], dN[p], inverse, X)
            eps = strained(reference, es, ng, p, G)
            for i in range(6):
                scatter(S0, es, 6 * ng, 6 * p + i, stress(stiffness, own, i, diagonal, eps))
    return 0.0


@part
def beam_force(g: Any, w: Any, numbers: Floats, flag: int) -> float:
    """S at y1 and ``internal += int B(q_mid)^T S ds``; flag 1: with the predicted S instead."""
    lengths, N, dN, reference, stiffness = g.lengths, g.N, g.dN, g.reference, g.stiffness
    weights = g.weights
    y1, mid, f, S0 = w.y1, w.mid, w.internal, g.S0
    S = g.S
    if flag == 1:
        S, f = g.predicted, w.R_mixed
    start, end = numbers[START], numbers[END]
    base, turned, rotations = g.base, g.turned, g.rotations
    section, diagonal = g.section, g.diagonal
    ne, nn = base.shape
    ng = len(N)
    size = 12 * nn * WIDTH
    X, Y, F = np.empty(size), np.empty(size), np.empty(size)
    for e in range(0, ne, WIDTH):
        es = block(e, ne)
        own = chosen(section, es)
        length = gather(lengths, es, 1, 0)
        inverse = 1.0 / length
        once = counted(e, ne)
        take(base, turned, rotations, es, mid, X)
        if flag == 0 and start != 0.0:
            take(base, turned, rotations, es, y1, Y)
        for k in range(size):
            F[k] = 0.0
        for p in range(ng):
            G = at_point(N[p], dN[p], inverse, X)
            if flag == 0:
                H = at_point(N[p], dN[p], inverse, Y) if start != 0.0 else G
                eps = strained(reference, es, ng, p, H)
                for i in range(6):
                    now = end * stress(stiffness, own, i, diagonal, eps)
                    if start != 0.0:
                        now = now + start * gather(S0, es, 6 * ng, 6 * p + i)
                    scatter(S, es, 6 * ng, 6 * p + i, now)
            weight = weights[p] * once * length
            n, m = triple(S, es, 6 * ng, 6 * p), triple(S, es, 6 * ng, 6 * p + 3)
            point_force(N[p], dN[p], inverse, G, times(weight, n), times(0.5 * weight, m), F)
        give(base, turned, rotations, es, F, f)
    return 0.0


@inlined
def point_force(N: Any, dN: Any, inverse: float, G: Point, n: Vector, m: Vector, F: Floats) -> None:
    """Forces on the nodes of n and twice m, times the weight, that act at a Gauss point."""
    phi, d, e_ = G
    on_slope = times(inverse, combine(n, d))
    for a in range(len(N)):
        for c in range(3):
            k = 12 * a + c
            store(F, k, load(F, k) + dN[a] * on_slope[c])
    for i in range(3):
        j = (i + 1) % 3
        h = (i + 2) % 3
        # d_i is in K_j = (d_i . d_h' - d_h . d_i')/2 and in K_h = (d_j . d_i' - d_i . d_j')/2
        for c in range(3):
            here = n[i] * phi[c] + m[j] * e_[h][c] - m[h] * e_[j][c]
            slope = inverse * (m[h] * d[j][c] - m[j] * d[h][c])
            for a in range(len(N)):
                k = 12 * a + 3 + 3 * i + c
                store(F, k, load(F, k) + N[a] * here + dN[a] * slope)


@part
def beam_predicted(g: Any, w: Any, numbers: Floats, flag: int) -> float:
    """``S + share D B(y) change``, y being where the stresses come from."""
    lengths, N, dN, stiffness = g.lengths, g.N, g.dN, g.stiffness
    y, change, S, out = w.mid, w.change, g.S, g.predicted
    share = numbers[SHARE]
    if numbers[START] != 0.0:
        y = w.y1
    base, turned, rotations = g.base, g.turned, g.rotations
    section, diagonal = g.section, g.diagonal
    ne, nn = base.shape
    ng = len(N)
    X, V = np.empty(12 * nn * WIDTH), np.empty(12 * nn * WIDTH)
    for e in range(0, ne, WIDTH):
        es = block(e, ne)
        own = chosen(section, es)
        inverse = 1.0 / gather(lengths, es, 1, 0)
        take(base, turned, rotations, es, y, X)
        take(base, turned, rotations, es, change, V)
        for p in range(ng):
            G = at_point(N[p], dN[p], inverse, X)
            H = at_point(N[p], dN[p], inverse, V)
            eps = strain_changes(G, H)
            for i in range(6):
                more = share * stress(stiffness, own, i, diagonal, eps)
                scatter(out, es, 6 * ng, 6 * p + i, gather(S, es, 6 * ng, 6 * p + i) + more)
    return 0.0
