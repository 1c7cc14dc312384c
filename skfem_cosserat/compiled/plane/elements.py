"""Beams in a plane: forces, and blocks of the matrix."""

from __future__ import annotations

from typing import Any

from ...types import Floats, IndexArray
from ..elements import give, origins, triple
from ..jit import inlined, part
from ..numbers import END, ENDS, FORCE, MASS, SHARE, START, WEIGHT
from ..simd import WIDTH, add_rows, gather, load, local, rows, scatter, store
from ..small import Places, Rotation, Vector, block, chosen, counted, dot, minus, times
from ..small import plus as plus3
from .complex_numbers import Complex, crossed, inner, left, outer, plus, product, scaled

__all__ = [
    "Field",
    "at_point",
    "beam_finish",
    "beam_force",
    "beam_predicted",
    "beam_start",
    "beam_tangent",
    "take",
]

# -- compiled stresses and internal force of beam elements in a plane, :data:`WIDTH` at a time -----
#
# X, F (4 nn WIDTH) are nodes of these elements and forces on them. Stresses are by gamma and kappa:
# ``n = sum k_i n_i``, a vector in the frame of the section, and the moment m about the normal.
# Parts take ``(g, w, numbers, flag)``.

#: slope of the centre line, unit vector of the section and its slope
Field = tuple[Complex, Complex, Complex]


@inlined
def two(a: Floats, k: int) -> Complex:
    """Vectors k and the next one."""
    return load(a, k), load(a, k + 1)


@inlined
def turning(rotations: Floats, es: Places, nn: int, a: int) -> Complex:
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
def summed(N: Any, X: Floats, i: int) -> Complex:
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
    X = local(4 * nn * WIDTH)
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
    start, end, ends = numbers[START], numbers[END], numbers[ENDS] != 0.0
    base, turned, rotations, section = g.base, g.turned, g.rotations, g.section
    ne, nn = base.shape
    ng = len(N)
    X, Y, F = local(4 * nn * WIDTH), local(4 * nn * WIDTH), local(4 * nn * WIDTH)
    for e in range(0, ne, WIDTH):
        es = block(e, ne)
        own = chosen(section, es)
        length = gather(lengths, es, 1, 0)
        inverse = 1.0 / length
        once = counted(e, ne)
        take(base, turned, rotations, es, mid, X)
        if flag == 0 and ends:
            take(base, turned, rotations, es, y1, Y)
        for k in range(4 * nn):
            store(F, k, 0.0 * once)
        for p in range(ng):
            G = at_point(N[p], dN[p], inverse, X)
            if flag == 0:
                H = at_point(N[p], dN[p], inverse, Y) if ends else G
                eps = minus(strains(H), triple(reference, es, 3 * ng, 3 * p))
                now = times(end, stresses(stiffness, own, eps))
                if ends:
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
    if numbers[ENDS] != 0.0:
        y, share = w.y1, numbers[END]
    base, turned, rotations, section = g.base, g.turned, g.rotations, g.section
    ne, nn = base.shape
    ng = len(N)
    X, V = local(4 * nn * WIDTH), local(4 * nn * WIDTH)
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
    """Add ``int B(q_mid)^T S ds`` by rows of y in space, once a step: of each director its own."""
    lengths, N, dN, weights, S, mid = g.lengths, g.N, g.dN, g.weights, g.S, w.mid
    base, turned, rotations, section, axes = g.base, g.turned, g.rotations, g.section, g.axes
    director, resultants, frames, triads, out = g.director, g.resultants, g.frames, g.triads, g.out
    ne, nn = base.shape
    ng = len(N)
    X, F = local(4 * nn * WIDTH), local(12 * nn * WIDTH)
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
def add_vector(F: Floats, k: int, axes: Floats, f: Complex) -> None:
    """Add a vector of the plane, by its components in space, to vectors k and the two behind."""
    for c in range(3):
        store(F, k + c, load(F, k + c) + axes[0, c] * f[0] + axes[1, c] * f[1])


# -- compiled tangent of beam elements in a plane, in reduced coordinates --------------------------
#
# :data:`WIDTH` elements at a time; parts take ``(g, w, numbers, flag)``.


@inlined
def by_turn(N: float, dN: float, G: Field, e: Complex) -> Vector:
    """Strains by the angular velocity of a node whose section has the unit vector e."""
    z = crossed(e, G[0])
    return N * z[1], (0.0 - N) * z[0], dN * inner(G[1], e) - N * inner(e, G[2])


@inlined
def stiff(D: Rotation, v: Vector) -> Vector:
    """``D v``."""
    return dot(D[0], v), dot(D[1], v), dot(D[2], v)


@inlined
def add(a: Floats, k: int, value: float) -> None:
    """Add to vectors k."""
    store(a, k, load(a, k) + value)


@inlined
def add_coefficients(
    a: Floats, k: int, xx: float, xe: Complex, ex: Complex, ee: Complex, L: Complex, R: Complex
) -> None:
    """As :func:`.complex_numbers.add_scaled`, of vectors from k on."""
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

    See :func:`skfem_cosserat.compiled.elements.beam_tangent`.
    """
    y0, y1, mid, S, A = w.y0, w.y1, w.mid, g.S, w.A
    if flag == 1:
        S = g.predicted
    mass, half = numbers[MASS], numbers[SHARE] * numbers[FORCE]
    early, ends = numbers[WEIGHT] == 0.0, numbers[ENDS] != 0.0
    material = numbers[END] * numbers[FORCE] if ends else half
    lengths, N, dN, weights, masses = g.lengths, g.N, g.dN, g.weights, g.mass
    stiffness, slot, section = g.stiffness, g.slot, g.section
    base, turned, rotations, held = g.base, g.turned, g.rotations, g.held_stress
    ne, nn = base.shape
    ng = len(N)
    XB, XR = local(4 * nn * WIDTH), local(4 * nn * WIDTH)
    XL = local(4 * nn * WIDTH) if early else XB
    a = local(12 * nn * nn * WIDTH)
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
            f, k = half * weights[p] * once, material * weights[p] * once * length
            E = times(k, D[0]), times(k, D[1]), times(k, D[2])
            s = times(f, triple(S, es, 3 * ng, 3 * p))
            if len(held):
                s = plus3(s, times(once, triple(held, es, 3 * ng, 3 * p)))
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
