"""Compiled tangent of beam elements in reduced coordinates, :data:`WIDTH` elements at a time.

All that is made on the way lies in one array of SIMD vectors, ``a``; matrices are rows of three,
and H, L, T... are where they start. Terms of Gauss points are made first and then summed up block
by block: sums stay in registers. Parts take ``(g, w, numbers, flag)``, see :mod:`.elements`.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..types import Floats
from .elements import Point, at_point
from .jit import inlined, part
from .numbers import FORCE, MASS, SHARE, START, WEIGHT
from .simd import WIDTH, add_rows, gather, load, pack, rows, store
from .small import (
    Places,
    Rotation,
    Vector,
    block,
    chosen,
    combine,
    counted,
    cross,
    dot,
    minus,
    plus,
    times,
)
from .stresses import take, triple

__all__ = ["beam_tangent"]

#: where matrices start: the block (6, 6), of an element its stiffness (6, 6), of a point slopes of
#: strains by velocities (3, 3), their stresses (6, 3), strains by one angular velocity (6, 3); then
#: stresses (6) of all points and what :func:`further` tells
STIFFNESS, SLOPES, STRESSED, STRAINS, STRESSES = 36, 72, 90, 108, 126
Further = tuple[int, int, int, int, int, int]


@inlined
def three(a: Floats, k: int) -> Vector:
    """Vectors k and the two behind them."""
    return load(a, k), load(a, k + 1), load(a, k + 2)


@inlined
def keep(a: Floats, k: int, v: Vector) -> None:
    """Store what :func:`three` loads."""
    store(a, k, v[0])
    store(a, k + 1, v[1])
    store(a, k + 2, v[2])


@inlined
def further(points: int, nodes: int) -> Further:
    """Where H, L, T, P, Q start: of each point H (3, 3), of each of its nodes the others.

    L, T (6, 3): strains on the left, stresses on the right by its angular velocity; P, Q (3, 3):
    those between it and a velocity on the left, on the right. The last one: how many vectors.
    """
    H = STRESSES + 6 * points
    L = H + 9 * points
    each = points * nodes
    return H, L, L + 18 * each, L + 36 * each, L + 45 * each, L + 54 * each


@inlined
def triad(X: Floats, u: int) -> Rotation:
    """Directors of node u."""
    k = 12 * u
    return three(X, k + 3), three(X, k + 6), three(X, k + 9)


@inlined
def turned_strain(N: float, dN: float, X: Floats, u: int, G: Point, a: Floats, k: int) -> None:
    """Strains by the angular velocity of node u: (6, 3), from k on. X: where P_int is taken.

    By its velocity they are ``dN d_i`` for Gamma_i and zero for K.
    """
    phi, d, e = G
    x, y, z = triad(X, u)
    slope = times(N, phi)
    keep(a, k, cross(x, slope))
    keep(a, k + 3, cross(y, slope))
    keep(a, k + 6, cross(z, slope))
    hN, hd = 0.5 * N, 0.5 * dN
    # what directors are crossed with
    f = minus(times(hd, d[0]), times(hN, e[0]))
    g = minus(times(hd, d[1]), times(hN, e[1]))
    h = minus(times(hd, d[2]), times(hN, e[2]))
    keep(a, k + 9, minus(cross(y, h), cross(z, g)))
    keep(a, k + 12, minus(cross(z, f), cross(x, h)))
    keep(a, k + 15, minus(cross(x, g), cross(y, f)))


@inlined
def stiff(D: Floats, own: Places, diagonal: bool, factor: float, a: Floats) -> None:
    """Stiffness of the sections, or its diagonal, times a factor."""
    step = 7 if diagonal else 1
    for i in range(0, 36, step):
        store(a, STIFFNESS + i, factor * gather(D, own, 36, i))


@inlined
def times_stiffness(a: Floats, diagonal: bool, weight: float, count: int, T: int) -> None:
    """T (6, 3), weight times stiffness times the strains; only so many rows of these are not zero.

    Sums come before stores, as everywhere: only so they stay in registers.
    """
    if diagonal:
        for i in range(count):
            s = times(weight * load(a, STIFFNESS + 7 * i), three(a, STRAINS + 3 * i))
            keep(a, T + 3 * i, s)
        return
    for i in range(6):
        s = times(load(a, STIFFNESS + 6 * i), three(a, STRAINS))
        for j in range(1, count):
            s = plus(s, times(load(a, STIFFNESS + 6 * i + j), three(a, STRAINS + 3 * j)))
        keep(a, T + 3 * i, times(weight, s))


@inlined
def product(a: Floats, r: int, L: int, T: int, count: int) -> Vector:
    """Row r of ``L^T T``, both in a, with so many rows."""
    s = times(load(a, L + r), three(a, T))
    for i in range(1, count):
        s = plus(s, times(load(a, L + 3 * i + r), three(a, T + 3 * i)))
    return s


@inlined
def start_block(
    masses: Floats, es: Places, factor: float, u: int, v: int, table: Floats, X: Any, a: Floats
) -> None:
    """``P_L^T (C (x) I_3) P_R`` of nodes u, v: the block to start with. C: masses and stresses.

    Numbers of points and nodes come from the table, (2, points, nodes): shapes and slopes.
    """
    _, points, nodes = table.shape
    size, first = 16 * nodes * nodes, 16 * (u * nodes + v)
    c0, c1 = rows(masses, es, size, first), rows(masses, es, size, first + 4)
    c2, c3 = rows(masses, es, size, first + 8), rows(masses, es, size, first + 12)
    o = pack((0.0, 0.0, 0.0, 0.0))
    row = times(factor, (c0[1], c0[2], c0[3]))
    column = times(factor, (c1[0], c2[0], c3[0]))
    skew = o, o, o
    for p in range(points):
        here, there = table[0, p, u] * table[1, p, v], table[1, p, u] * table[0, p, v]
        n = three(a, STRESSES + 6 * p)
        row = plus(row, times(there, n))
        column = plus(column, times(here, n))
        skew = plus(skew, times(there - here, three(a, STRESSES + 6 * p + 3)))
    E, F = triad(X[0], u), triad(X[1], v)
    s, t = combine(row, F), combine(column, E)
    # sum C_ij ((E_i . F_j) I - F_j E_i^T): (omega x E_i) . (theta x F_j)
    c = times(factor, (c1[1], c1[2], c1[3]))
    x = combine((c[0], c[1] + skew[2], c[2] - skew[1]), F)
    c = times(factor, (c2[1], c2[2], c2[3]))
    y = combine((c[0] - skew[2], c[1], c[2] + skew[0]), F)
    c = times(factor, (c3[1], c3[2], c3[3]))
    z = combine((c[0] + skew[1], c[1] - skew[0], c[2]), F)
    trace, one = dot(x, E[0]) + dot(y, E[1]) + dot(z, E[2]), factor * c0[0]
    keep(a, 0, (one, o, o))
    keep(a, 3, (o, s[2], o - s[1]))
    keep(a, 6, (o, one, o))
    keep(a, 9, (o - s[2], o, s[0]))
    keep(a, 12, (o, o, one))
    keep(a, 15, (s[1], o - s[0], o))
    keep(a, 18, (o, o - t[2], t[1]))
    keep(a, 21, minus((trace, o, o), combine((x[0], y[0], z[0]), E)))
    keep(a, 24, (t[2], o, o - t[0]))
    keep(a, 27, minus((o, trace, o), combine((x[1], y[1], z[1]), E)))
    keep(a, 30, (o - t[1], t[0], o))
    keep(a, 33, minus((o, o, trace), combine((x[2], y[2], z[2]), E)))


@inlined
def point_terms(
    p: int,
    G: Any,
    X: Any,
    table: Floats,
    weight: float,
    inverse: float,
    diagonal: bool,
    a: Floats,
) -> None:
    """H, L, T, P and Q of Gauss point p."""
    _, points, nodes = table.shape
    H, L, T, P, Q, _ = further(points, nodes)
    left, right = G[0][1], G[1][1]
    for i in range(3):
        keep(a, SLOPES + 3 * i, times(inverse, left[i]))
        keep(a, STRAINS + 3 * i, times(inverse, right[i]))
    times_stiffness(a, diagonal, weight, 3, STRESSED)
    count = 3 if diagonal else 6
    for r in range(3):
        keep(a, H + 9 * p + 3 * r, product(a, r, SLOPES, STRESSED, 3))
    for u in range(nodes):
        k = p * nodes + u
        N, dN = table[0, p, u], table[1, p, u] * inverse
        turned_strain(N, dN, X[0], u, G[0], a, L + 18 * k)
        turned_strain(N, dN, X[1], u, G[1], a, STRAINS)
        times_stiffness(a, diagonal, weight, 6, T + 18 * k)
        for r in range(3):
            keep(a, Q + 9 * k + 3 * r, product(a, r, L + 18 * k, STRESSED, count))
            keep(a, P + 9 * k + 3 * r, product(a, r, SLOPES, T + 18 * k, 3))


@inlined
def add_points(u: int, v: int, table: Floats, a: Floats) -> None:
    """Add the terms of all Gauss points to the block of nodes u, v."""
    _, points, nodes = table.shape
    H, L, T, P, Q, _ = further(points, nodes)
    for r in range(3):
        upper, right = three(a, 6 * r), three(a, 6 * r + 3)
        left, lower = three(a, 6 * r + 18), three(a, 6 * r + 21)
        for p in range(points):
            i, j = p * nodes + u, p * nodes + v
            d, e = table[1, p, u], table[1, p, v]
            upper = plus(upper, times(d * e, three(a, H + 9 * p + 3 * r)))
            right = plus(right, times(d, three(a, P + 9 * j + 3 * r)))
            left = plus(left, times(e, three(a, Q + 9 * i + 3 * r)))
            lower = plus(lower, product(a, r, L + 18 * i, T + 18 * j, 6))
        keep(a, 6 * r, upper)
        keep(a, 6 * r + 3, right)
        keep(a, 6 * r + 18, left)
        keep(a, 6 * r + 21, lower)


@inlined
def tabulated(shapes: Any, slopes: Any, table: Floats) -> None:
    """Shape functions and slopes (2, points, nodes)."""
    for p in range(len(shapes)):
        for u in range(table.shape[2]):
            table[0, p, u] = shapes[p][u]
            table[1, p, u] = slopes[p][u]


@part
def beam_tangent(g: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Add the blocks of all elements, in reduced coordinates, to their slots.

    ``P(y_L)^T (mass M + share force (int B(q_mid)^T D B(y_S) ds + int S . C/l ds)) P(y_1)``: y_L is
    where constraint forces act, y_S where the stresses come from; S are those, or with flag 1
    predicted ones.
    """
    y0, y1, mid, S, A = w.y0, w.y1, w.mid, g.S, w.A
    if flag == 1:
        S = g.predicted
    mass, half = numbers[MASS], numbers[SHARE] * numbers[FORCE]
    early, ends = numbers[WEIGHT] == 0.0, numbers[START] != 0.0
    lengths, shapes, slopes, weights = g.lengths, g.N, g.dN, g.weights
    masses, stiffness, slot, section = g.mass, g.stiffness, g.slot, g.section
    base, turned, rotations, diagonal = g.base, g.turned, g.rotations, g.diagonal
    ne, nodes = base.shape
    points = len(shapes)
    table = np.empty((2, points, nodes))
    tabulated(shapes, slopes, table)
    XB, XR = np.empty(12 * nodes * WIDTH), np.empty(12 * nodes * WIDTH)
    XL = XB
    if early:
        XL = np.empty(12 * nodes * WIDTH)
    X = XL, XR
    a = np.empty(further(points, nodes)[5] * WIDTH)
    for e in range(0, ne, WIDTH):
        es = block(e, ne)
        length = gather(lengths, es, 1, 0)
        inverse = 1.0 / length
        once = counted(e, ne)
        take(base, turned, rotations, es, mid, XB)
        take(base, turned, rotations, es, y1, XR)
        if early:
            take(base, turned, rotations, es, y0, XL)
        stiff(stiffness, chosen(section, es), diagonal, half * once * length, a)
        for p in range(points):
            GB = at_point(shapes[p], slopes[p], inverse, XB)
            GS = at_point(shapes[p], slopes[p], inverse, XR) if ends else GB
            n, m = triple(S, es, 6 * points, 6 * p), triple(S, es, 6 * points, 6 * p + 3)
            f = half * weights[p] * once
            keep(a, STRESSES + 6 * p, times(f, n))
            keep(a, STRESSES + 6 * p + 3, times(0.5 * f, m))
            point_terms(p, (GB, GS), X, table, weights[p], inverse, diagonal, a)
        for u in range(nodes):
            for v in range(nodes):
                start_block(masses, es, mass * once, u, v, table, X, a)
                add_points(u, v, table, a)
                own = slot[es[0], u, v], slot[es[1], u, v], slot[es[2], u, v], slot[es[3], u, v]
                for k in range(0, 36, 4):
                    four = load(a, k), load(a, k + 1), load(a, k + 2), load(a, k + 3)
                    add_rows(A, own, 36, k, four)
    return 0.0
