"""Compiled stresses and internal force of beam elements in a plane, :data:`WIDTH` at a time.

X, F (4 nn WIDTH) are nodes of these elements and forces on them. Stresses are by gamma and kappa:
``n = sum k_i n_i``, a vector in the frame of the section, and the moment m about the normal. Parts
take ``(g, w, numbers, flag)``.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ...types import Floats, IndexArray
from ..jit import inlined, part
from ..lanes import WIDTH, add_rows, gather, load, rows, scatter, store
from ..numbers import END, SHARE, START
from ..small import Places, Vector, block, chosen, counted, dot, minus, times
from ..stresses import give, origins, triple
from .pairs import Pair, crossed, left, outer, plus, product, scaled

__all__ = ["Field", "at_point", "beam_finish", "beam_force", "beam_predicted", "beam_start", "take"]

#: slope of the centre line, unit vector of the section and its slope
Field = tuple[Pair, Pair, Pair]


@inlined
def two(a: Floats, k: int) -> Pair:
    """Lanes k and the next one."""
    return load(a, k), load(a, k + 1)


@inlined
def turning(rotations: Floats, es: Places, nn: int, a: int) -> Pair:
    """From the unit vectors of nodes a to those of their sections."""
    return gather(rotations, es, 2 * nn, 2 * a), gather(rotations, es, 2 * nn, 2 * a + 1)


@inlined
def take(
    base: IndexArray, turned: bool, rotations: Floats, es: Places, y: Floats, X: Floats
) -> None:
    """Nodes of these elements."""
    nn = base.shape[1]
    for a in range(nn):
        found = rows(y, origins(base, es, a), 4, 0)
        e = found[2], found[3]
        if turned:
            e = product(turning(rotations, es, nn, a), e)
        store(X, 4 * a, found[0])
        store(X, 4 * a + 1, found[1])
        store(X, 4 * a + 2, e[0])
        store(X, 4 * a + 3, e[1])


@inlined
def summed(N: Any, X: Floats, i: int) -> Pair:
    """``sum N_a X_a``, of origins (i = 0) or unit vectors (2)."""
    s = scaled(N[0], two(X, i))
    for a in range(1, len(N)):
        s = plus(s, scaled(N[a], two(X, 4 * a + i)))
    return s


@inlined
def at_point(N: Any, dN: Any, inverse: float, X: Floats) -> Field:
    """Interpolate to a Gauss point."""
    return (
        scaled(inverse, summed(dN, X, 0)),
        summed(N, X, 2),
        scaled(inverse, summed(dN, X, 2)),
    )


@inlined
def strains(G: Field) -> Vector:
    """Gamma and kappa."""
    gamma = crossed(G[1], G[0])
    return gamma[0], gamma[1], outer(G[1], G[2])


@inlined
def strain_changes(G: Field, V: Field) -> Vector:
    """Their first change, V as G for a change of the nodes."""
    gamma = plus(crossed(G[1], V[0]), crossed(V[1], G[0]))
    return gamma[0], gamma[1], outer(V[1], G[2]) + outer(G[1], V[2])


@inlined
def stresses(D: Floats, section: Places, eps: Vector) -> Vector:
    """``D eps``, D that of the sections."""
    return (
        dot(triple(D, section, 9, 0), eps),
        dot(triple(D, section, 9, 3), eps),
        dot(triple(D, section, 9, 6), eps),
    )


@inlined
def put_triple(a: Floats, es: Places, size: int, first: int, v: Vector) -> None:
    """Store three entries of each."""
    scatter(a, es, size, first, v[0])
    scatter(a, es, size, first + 1, v[1])
    scatter(a, es, size, first + 2, v[2])


@part
def beam_start(g: Any, w: Any, numbers: Floats, flag: int) -> float:
    """S0: stresses at the start of the step."""
    lengths, N, dN, reference, stiffness = g.lengths, g.N, g.dN, g.reference, g.stiffness
    y, S0, base, turned, rotations = w.y0, g.S0, g.base, g.turned, g.rotations
    section = g.section
    ne, nn = base.shape
    ng = len(N)
    X = np.empty(4 * nn * WIDTH)
    for e in range(0, ne, WIDTH):
        es = block(e, ne)
        take(base, turned, rotations, es, y, X)
        inverse = 1.0 / gather(lengths, es, 1, 0)
        own = chosen(section, es)
        for p in range(ng):
            eps = strains(at_point(N[p], dN[p], inverse, X))
            eps = minus(eps, triple(reference, es, 3 * ng, 3 * p))
            put_triple(S0, es, 3 * ng, 3 * p, stresses(stiffness, own, eps))
    return 0.0


@part
def beam_force(g: Any, w: Any, numbers: Floats, flag: int) -> float:
    """S at y1 and ``internal += int B(q_mid)^T S ds``; flag 1: with the predicted S instead."""
    lengths, N, dN, reference, stiffness = g.lengths, g.N, g.dN, g.reference, g.stiffness
    y1, mid, f, S0, S, weights = w.y1, w.mid, w.internal, g.S0, g.S, g.weights
    if flag == 1:
        S, f = g.predicted, w.R_mixed
    start, end = numbers[START], numbers[END]
    base, turned, rotations, section = g.base, g.turned, g.rotations, g.section
    ne, nn = base.shape
    ng = len(N)
    X, Y, F = np.empty(4 * nn * WIDTH), np.empty(4 * nn * WIDTH), np.empty(4 * nn * WIDTH)
    for e in range(0, ne, WIDTH):
        es = block(e, ne)
        own = chosen(section, es)
        length = gather(lengths, es, 1, 0)
        inverse = 1.0 / length
        once = counted(e, ne)
        take(base, turned, rotations, es, mid, X)
        if flag == 0 and start != 0.0:
            take(base, turned, rotations, es, y1, Y)
        for k in range(4 * nn):
            store(F, k, 0.0 * once)
        for p in range(ng):
            G = at_point(N[p], dN[p], inverse, X)
            if flag == 0:
                H = at_point(N[p], dN[p], inverse, Y) if start != 0.0 else G
                eps = minus(strains(H), triple(reference, es, 3 * ng, 3 * p))
                now = times(end, stresses(stiffness, own, eps))
                if start != 0.0:
                    before = triple(S0, es, 3 * ng, 3 * p)
                    now = (
                        now[0] + start * before[0],
                        now[1] + start * before[1],
                        now[2] + start * before[2],
                    )
                put_triple(S, es, 3 * ng, 3 * p, now)
            on = times(weights[p] * once * length, triple(S, es, 3 * ng, 3 * p))
            point_force(N[p], dN[p], inverse, G, on, F)
        for a in range(nn):
            e_force = two(F, 4 * a + 2)
            if turned:  # by unit vectors of sections: those of the nodes
                e_force = crossed(turning(rotations, es, nn, a), e_force)
            four = load(F, 4 * a), load(F, 4 * a + 1), e_force[0], e_force[1]
            add_rows(f, origins(base, es, a), 4, 0, four)
    return 0.0


@inlined
def point_force(N: Any, dN: Any, inverse: float, G: Field, S: Vector, F: Floats) -> None:
    """Forces on the nodes of stresses times the weight that act at a Gauss point."""
    phi, e, slope = G
    n, turned = (S[0], S[1]), scaled(S[2], left(e))
    line = scaled(inverse, product(n, e))
    here = plus(crossed(n, phi), scaled(-1.0 * S[2], left(slope)))
    there = scaled(inverse, turned)
    for a in range(len(N)):
        k = 4 * a
        store(F, k, load(F, k) + dN[a] * line[0])
        store(F, k + 1, load(F, k + 1) + dN[a] * line[1])
        store(F, k + 2, load(F, k + 2) + N[a] * here[0] + dN[a] * there[0])
        store(F, k + 3, load(F, k + 3) + N[a] * here[1] + dN[a] * there[1])


@part
def beam_predicted(g: Any, w: Any, numbers: Floats, flag: int) -> float:
    """``S + share D B(y) change``, y being where the stresses come from."""
    lengths, N, dN, stiffness = g.lengths, g.N, g.dN, g.stiffness
    y, change, S, out, share = w.mid, w.change, g.S, g.predicted, numbers[SHARE]
    if numbers[START] != 0.0:
        y = w.y1
    base, turned, rotations, section = g.base, g.turned, g.rotations, g.section
    ne, nn = base.shape
    ng = len(N)
    X, V = np.empty(4 * nn * WIDTH), np.empty(4 * nn * WIDTH)
    for e in range(0, ne, WIDTH):
        es = block(e, ne)
        own = chosen(section, es)
        inverse = 1.0 / gather(lengths, es, 1, 0)
        take(base, turned, rotations, es, y, X)
        take(base, turned, rotations, es, change, V)
        for p in range(ng):
            G = at_point(N[p], dN[p], inverse, X)
            eps = strain_changes(G, at_point(N[p], dN[p], inverse, V))
            more = stresses(stiffness, own, eps)
            now = triple(S, es, 3 * ng, 3 * p)
            now = now[0] + share * more[0], now[1] + share * more[1], now[2] + share * more[2]
            put_triple(out, es, 3 * ng, 3 * p, now)
    return 0.0


@part
def beam_finish(g: Any, w: Any, numbers: Floats, flag: int) -> float:
    """``int B(q_mid)^T S ds`` by rows of y in space, once a step: of each director its own."""
    lengths, N, dN, weights, S, mid = g.lengths, g.N, g.dN, g.weights, g.S, w.mid
    base, turned, rotations, section, axes = g.base, g.turned, g.rotations, g.section, g.axes
    director, resultants, frames, triads, out = g.director, g.resultants, g.frames, g.triads, g.out
    ne, nn = base.shape
    ng = len(N)
    X, F = np.empty(4 * nn * WIDTH), np.empty(12 * nn * WIDTH)
    for r in range(len(out)):
        for c in range(3):
            out[r, c] = 0.0
    for e in range(0, ne, WIDTH):
        es = block(e, ne)
        own = chosen(section, es)
        length = gather(lengths, es, 1, 0)
        inverse = 1.0 / length
        take(base, turned, rotations, es, mid, X)
        for k in range(12 * nn):
            store(F, k, 0.0 * length)
        for p in range(ng):
            phi, d, slope = at_point(N[p], dN[p], inverse, X)
            on = times(weights[p] * counted(e, ne) * length, triple(S, es, 3 * ng, 3 * p))
            line = scaled(inverse, product((on[0], on[1]), d))
            for a in range(nn):
                add_vector(F, 12 * a, axes, scaled(dN[p][a], line))
            for i in range(3):
                j, h = (i + 1) % 3, (i + 2) % 3
                n = dot(triple(resultants, own, 18, 3 * i), on)
                # half of m_h k_j - m_j k_h
                m_j = 0.5 * dot(triple(resultants, own, 18, 9 + 3 * j), on)
                m_h = 0.5 * dot(triple(resultants, own, 18, 9 + 3 * h), on)
                bending = (
                    m_h * gather(director, own, 6, 2 * j) - m_j * gather(director, own, 6, 2 * h),
                    m_h * gather(director, own, 6, 2 * j + 1)
                    - m_j * gather(director, own, 6, 2 * h + 1),
                )
                here = plus(scaled(n, phi), scaled(-1.0, product(bending, slope)))
                there = scaled(inverse, product(bending, d))
                for a in range(nn):
                    f = plus(scaled(N[p][a], here), scaled(dN[p][a], there))
                    add_vector(F, 12 * a + 3 + 3 * i, axes, f)
        give(frames, turned, triads, es, F, out)
    return 0.0


@inlined
def add_vector(F: Floats, k: int, axes: Floats, f: Pair) -> None:
    """Add a vector of the plane, by its components in space, to lanes k and the two behind."""
    for c in range(3):
        store(F, k + c, load(F, k + c) + axes[0, c] * f[0] + axes[1, c] * f[1])
