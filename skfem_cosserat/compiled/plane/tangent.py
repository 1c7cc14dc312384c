"""Compiled tangent of beam elements in a plane, in reduced coordinates.

:data:`WIDTH` elements at a time; parts take ``(g, w, numbers, flag)``.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ...types import Floats
from ..jit import inlined, part
from ..lanes import WIDTH, add_rows, gather, load, rows, store
from ..numbers import FORCE, MASS, SHARE, START, WEIGHT
from ..small import Places, Rotation, Vector, block, chosen, counted, dot, times
from ..stresses import triple
from .beams import Field, at_point, take, two
from .pairs import Pair, crossed, inner, left, product, scaled

__all__ = ["beam_tangent"]


@inlined
def by_turn(N: float, dN: float, G: Field, e: Pair) -> Vector:
    """Strains by the angular velocity of a node whose section has the unit vector e."""
    z = crossed(e, G[0])
    return N * z[1], (0.0 - N) * z[0], dN * inner(G[1], e) - N * inner(e, G[2])


@inlined
def stiff(D: Rotation, v: Vector) -> Vector:
    """``D v``."""
    return dot(D[0], v), dot(D[1], v), dot(D[2], v)


@inlined
def add(a: Floats, k: int, value: float) -> None:
    """Add to lanes k."""
    store(a, k, load(a, k) + value)


@inlined
def add_coefficients(
    a: Floats, k: int, xx: float, xe: Pair, ex: Pair, ee: Pair, L: Pair, R: Pair
) -> None:
    """As :func:`.pairs.add_scaled`, of lanes from k on."""
    column, row = product(xe, left(R)), crossed(ex, left(L))
    add(a, k, xx)
    add(a, k + 2, column[0])
    add(a, k + 5, xx)
    add(a, k + 6, column[1])
    add(a, k + 8, row[0])
    add(a, k + 9, row[1])
    add(a, k + 10, inner(L, product(ee, R)))


@inlined
def add_material(
    a: Floats, k: int, d: float, e: float, G: Field, H: Field, D: Rotation, L: Vector, R: Vector
) -> None:
    """``B_u^T D B_v``: slopes d, e of the nodes, L, R strains by their angular velocities."""
    p, q = G[1], H[1]
    # strains by velocities of v
    x, y = stiff(D, (e * q[0], 0.0 - e * q[1], 0.0 * e)), stiff(D, (e * q[1], e * q[0], 0.0 * e))
    z = stiff(D, R)
    add(a, k, d * (p[0] * x[0] - p[1] * x[1]))
    add(a, k + 1, d * (p[0] * y[0] - p[1] * y[1]))
    add(a, k + 2, d * (p[0] * z[0] - p[1] * z[1]))
    add(a, k + 4, d * (p[1] * x[0] + p[0] * x[1]))
    add(a, k + 5, d * (p[1] * y[0] + p[0] * y[1]))
    add(a, k + 6, d * (p[1] * z[0] + p[0] * z[1]))
    add(a, k + 8, dot(L, x))
    add(a, k + 9, dot(L, y))
    add(a, k + 10, dot(L, z))


@inlined
def start_blocks(masses: Floats, es: Places, nn: int, factor: float, X: Any, a: Floats) -> None:
    """Masses; the blocks of all pairs of nodes begin with them."""
    size = 8 * nn * nn
    for u in range(nn):
        L = two(X[0], 4 * u + 2)
        for v in range(nn):
            first = 8 * (u * nn + v)
            c, d = rows(masses, es, size, first), rows(masses, es, size, first + 4)
            k = 12 * (u * nn + v)
            for i in range(12):
                store(a, k + i, 0.0 * factor)
            xe, ex = scaled(factor, (c[2], c[3])), scaled(factor, (d[0], d[1]))
            ee, R = scaled(factor, (d[2], d[3])), two(X[1], 4 * v + 2)
            add_coefficients(a, k, factor * c[0], xe, ex, ee, L, R)


@part
def beam_tangent(g: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Add the blocks of all elements, in reduced coordinates, to their slots.

    See :func:`skfem_cosserat.compiled.tangent.beam_tangent`.
    """
    y0, y1, mid, S, A = w.y0, w.y1, w.mid, g.S, w.A
    if flag == 1:
        S = g.predicted
    mass, half = numbers[MASS], numbers[SHARE] * numbers[FORCE]
    early, ends = numbers[WEIGHT] == 0.0, numbers[START] != 0.0
    lengths, N, dN, weights, masses = g.lengths, g.N, g.dN, g.weights, g.mass
    stiffness, slot, section = g.stiffness, g.slot, g.section
    base, turned, rotations = g.base, g.turned, g.rotations
    ne, nn = base.shape
    ng = len(N)
    XB, XR = np.empty(4 * nn * WIDTH), np.empty(4 * nn * WIDTH)
    XL = np.empty(4 * nn * WIDTH) if early else XB
    a = np.empty(12 * nn * nn * WIDTH)
    for e in range(0, ne, WIDTH):
        es = block(e, ne)
        length, once = gather(lengths, es, 1, 0), counted(e, ne)
        inverse = 1.0 / length
        take(base, turned, rotations, es, mid, XB)
        take(base, turned, rotations, es, y1, XR)
        if early:
            take(base, turned, rotations, es, y0, XL)
        start_blocks(masses, es, nn, mass * once, (XL, XR), a)
        own = chosen(section, es)
        D = triple(stiffness, own, 9, 0), triple(stiffness, own, 9, 3), triple(stiffness, own, 9, 6)
        for p in range(ng):
            G = at_point(N[p], dN[p], inverse, XB)
            H = at_point(N[p], dN[p], inverse, XR) if ends else G
            f = half * weights[p] * once
            E = times(f * length, D[0]), times(f * length, D[1]), times(f * length, D[2])
            s = times(f, triple(S, es, 3 * ng, 3 * p))
            add_points(N[p], dN[p], inverse, G, H, E, s, XL, XR, a)
        for u in range(nn):
            for v in range(nn):
                k = 12 * (u * nn + v)
                places = slot[es[0], u, v], slot[es[1], u, v], slot[es[2], u, v], slot[es[3], u, v]
                for i in range(0, 12, 4):
                    four = (
                        load(a, k + i),
                        load(a, k + i + 1),
                        load(a, k + i + 2),
                        load(a, k + i + 3),
                    )
                    add_rows(A, places, 12, i, four)
    return 0.0


@inlined
def add_points(
    N: Any,
    dN: Any,
    inverse: float,
    G: Field,
    H: Field,
    D: Rotation,
    s: Vector,
    XL: Floats,
    XR: Floats,
    a: Floats,
) -> None:
    """Add the terms of a Gauss point, D and stresses s times the weight, to all blocks."""
    nn = len(N)
    n, conjugate = (s[0], s[1]), (s[0], 0.0 - s[1])
    for u in range(nn):
        L = two(XL, 4 * u + 2)
        by_left = by_turn(N[u], dN[u] * inverse, G, L)
        for v in range(nn):
            R, k = two(XR, 4 * v + 2), 12 * (u * nn + v)
            by_right = by_turn(N[v], dN[v] * inverse, H, R)
            add_material(a, k, dN[u] * inverse, dN[v] * inverse, G, H, D, by_left, by_right)
            m = (dN[u] * N[v] - N[u] * dN[v]) * s[2]
            xe, ex = scaled(dN[u] * N[v], n), scaled(N[u] * dN[v], conjugate)
            add_coefficients(a, k, 0.0 * m, xe, ex, (0.0 * m, m), L, R)
