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
from .jit import call, inlined, part
from .numbers import (
    END,
    ENDS,
    ENERGY_BY_LAW,
    FORCE,
    MASS,
    MODULI_BY_LAW,
    REACH,
    SHARE,
    START,
    STRESSES_BY_LAW,
    VISCOUS_WORK,
    WEIGHT,
)
from .simd import WIDTH, add_rows, gather, load, local, pack, rows, scatter, store
from .small import (
    Places,
    Rotation,
    Vector,
    add_skew,
    block,
    chosen,
    combine,
    counted,
    cross,
    dot,
    minus,
    plus,
    row,
    times,
)

#: slope of the centre line, directors and their slopes
Point = tuple[Vector, Rotation, Rotation]


@inlined
def three(a: Floats, k: int) -> Vector:
    """Vectors k and the two behind them."""
    return load(a, k), load(a, k + 1), load(a, k + 2)


@inlined
def node(X: Floats, a: int, i: int) -> Vector:
    """``X_ai`` of :data:`WIDTH` elements."""
    return three(X, 12 * a + 3 * i)


@inlined
def field(N: Any, X: Floats, i: int) -> Vector:
    """``sum N_a X_ai``."""
    s = (0.0, 0.0, 0.0)
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
def triad_at(y: Floats, r: int) -> Rotation:
    """Directors of the frame whose origin is row r; of a point any rows."""
    last = y.shape[0] - 1
    return row(y, min(r + 1, last)), row(y, min(r + 2, last)), row(y, min(r + 3, last))


@inlined
def scalar_block(
    C: Floats, n: int, factor: float, yL: Floats, a: int, yR: Floats, b: int, A: Floats, k: int
) -> None:
    """``A_k += factor P_L^T (C_n (x) I_3) P_R``, P of the vertices whose first rows are a and b."""
    E, F = triad_at(yL, a), triad_at(yR, b)
    c = factor * C[n, 0, 0]
    s = times(factor, combine((C[n, 0, 1], C[n, 0, 2], C[n, 0, 3]), F))
    t = times(factor, combine((C[n, 1, 0], C[n, 2, 0], C[n, 3, 0]), E))
    x = times(factor, combine((C[n, 1, 1], C[n, 1, 2], C[n, 1, 3]), F))
    y = times(factor, combine((C[n, 2, 1], C[n, 2, 2], C[n, 2, 3]), F))
    z = times(factor, combine((C[n, 3, 1], C[n, 3, 2], C[n, 3, 3]), F))
    # sum C_ij ((E_i . F_j) I - F_j E_i^T): (omega x E_i) . (theta x F_j)
    trace = dot(x, E[0]) + dot(y, E[1]) + dot(z, E[2])
    add_skew(A, k, 0, 3, times(-1.0, s))
    add_skew(A, k, 3, 0, t)
    for r in range(3):
        u = combine((x[r], y[r], z[r]), E)
        A[k, r, r] += c
        A[k, 3 + r, 3] -= u[0]
        A[k, 3 + r, 4] -= u[1]
        A[k, 3 + r, 5] -= u[2]
        A[k, 3 + r, 3 + r] += trace


# --------------------------------------------------------------------------------------------------
# Compiled stresses and internal force of beam elements, :data:`WIDTH` elements at a time.
#
# X, F (12 nn WIDTH) are nodes of these elements and forces on them, the same entry of all of them
# side by side. The last elements of a mesh are taken more than once, and give their force once.
# Parts take ``(g, w, numbers, flag)`` as those of :mod:`.elements`.


@inlined
def origins(base: IndexArray, es: Places, a: int) -> Places:
    """First rows of their nodes a."""
    return base[es[0], a], base[es[1], a], base[es[2], a], base[es[3], a]


@inlined
def take_elements(
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
def six(a: Floats, es: Places, size: int, first: int) -> tuple[Vector, Vector]:
    """Six entries of each: forces and moments, or strains that belong to them."""
    return triple(a, es, size, first), triple(a, es, size, first + 3)


@inlined
def strain_of(eps: tuple[Vector, Vector], i: int) -> float:
    """One of the six strains."""
    return eps[0][i] if i < 3 else eps[1][i - 3]


@inlined
def stress(D: Floats, section: Places, i: int, diagonal: bool, eps: tuple[Vector, Vector]) -> float:
    """``(D eps)_i``, D that of the sections."""
    if diagonal:
        return gather(D, section, 36, 7 * i) * strain_of(eps, i)
    return along(six(D, section, 36, 6 * i), eps)


@inlined
def along(D: tuple[Vector, Vector], eps: tuple[Vector, Vector]) -> float:
    """Product of six numbers with six others."""
    return dot(D[0], eps[0]) + dot(D[1], eps[1])


@inlined
def stress_change(
    D: Floats, es: Places, section: Places, p: int, i: int, diagonal: bool, eps: Any
) -> float:
    """``(D eps)_i`` for a change of the strains at Gauss point p."""
    if D.ndim == 4:  # that of a law
        return along(six(D, es, 36 * D.shape[1], 36 * p + 6 * i), eps)
    return stress(D, section, i, diagonal, eps)


@inlined
def ask_law(D: Floats, g: Any, numbers: Floats, what: int) -> None:
    """Have what laws give made of the strains evaluated last; nothing where there are none."""
    if D.ndim == 4:
        call(g.law[0], g.points, numbers, what)


@inlined
def measured(D: Floats, section: Places, i: int, diagonal: bool, eps: Any) -> float:
    """Stress by the strains, or the strain itself for a law."""
    if D.ndim == 4:
        return strain_of(eps, i)
    return stress(D, section, i, diagonal, eps)


@inlined
def measure(g: Any, y: Floats, out: Floats, X: Floats) -> float:
    """Stresses at y, or strains for laws; X is for the nodes. Gives the energy of the stresses."""
    lengths, N, dN, reference, stiffness = g.lengths, g.N, g.dN, g.reference, g.stiffness
    base, turned, rotations, weights = g.base, g.turned, g.rotations, g.weights
    section, diagonal, total = g.section, g.diagonal, pack((0.0, 0.0, 0.0, 0.0))
    ne, ng = len(base), len(N)
    for e in range(0, ne, WIDTH):
        es = block(e, ne)
        take_elements(base, turned, rotations, es, y, X)
        length, own = gather(lengths, es, 1, 0), chosen(section, es)
        inverse, once = 1.0 / length, 0.5 * counted(e, ne) * length
        for p in range(ng):
            eps = strained(reference, es, ng, p, at_point(N[p], dN[p], inverse, X))
            for i in range(6):
                found = measured(stiffness, own, i, diagonal, eps)
                scatter(out, es, 6 * ng, 6 * p + i, found)
                total = total + weights[p] * once * strain_of(eps, i) * found
    store(X, 0, total)
    return X[0] + X[1] + X[2] + X[3]


@inlined
def put_strains(D: Floats, g: Any, y: Floats, X: Floats) -> None:
    """Strains at y for laws, which :func:`ask_law` takes; X is for the nodes."""
    if D.ndim == 4:
        measure(g, y, g.strains, X)


@inlined
def strained(reference: Floats, es: Places, ng: int, p: int, G: Point) -> tuple[Vector, Vector]:
    """Strains at G less those of the reference configuration."""
    eps, eps0 = strains(G), six(reference, es, 6 * ng, 6 * p)
    return minus(eps[0], eps0[0]), minus(eps[1], eps0[1])


@part
def beam_start(g: Any, w: Any, numbers: Floats, flag: int) -> float:
    """S0: stresses at the start of the step; of laws strains, and energies."""
    base = g.base
    measure(g, w.earlier, g.S0, local(12 * base.shape[1] * WIDTH))
    ask_law(g.stiffness, g, numbers, ENERGY_BY_LAW)
    return 0.0


@part
def beam_energy(g: Any, w: Any, numbers: Floats, flag: int) -> float:
    """``w.found[0] += int eps . D eps/2 ds`` where the step starts."""
    w.found[0] += measure(g, w.y0, g.S0, local(12 * g.base.shape[1] * WIDTH))
    return 0.0


@inlined
def put_stresses(
    D: Floats,
    S: Floats,
    S0: Floats,
    es: Places,
    own: Places,
    k: int,
    share: tuple[float, float],
    diagonal: bool,
    eps: Any,
) -> None:
    """S of a step, from column k on, by the strains at its end; laws have made theirs."""
    if D.ndim == 4:
        return
    size = 6 * S.shape[1]
    for i in range(6):
        now = share[1] * stress(D, own, i, diagonal, eps)
        if share[0] != 0.0:
            now = now + share[0] * gather(S0, es, size, k + i)
        scatter(S, es, size, k + i, now)


@part
def beam_force(g: Any, w: Any, numbers: Floats, flag: int) -> float:
    """S at y1 and ``internal += int B(q_mid)^T S ds``; flag 1: with the predicted S instead.

    Of beams that are all viscosity, what they take along the way.
    """
    lengths, N, dN, reference, stiffness = g.lengths, g.N, g.dN, g.reference, g.stiffness
    weights = g.weights
    y1, mid, f, S, S0 = w.later, w.mid, w.internal, g.S, g.S0
    if flag == 1:
        S, f = g.predicted, w.R_mixed
    start, end, ends = numbers[START], numbers[END], numbers[ENDS] != 0.0
    viscous, lost = flag == 0 and start + end == 0.0, pack((0.0, 0.0, 0.0, 0.0))
    base, turned, rotations = g.base, g.turned, g.rotations
    section, diagonal = g.section, g.diagonal
    ne, nn = base.shape
    ng = len(N)
    size = 12 * nn * WIDTH
    X, Y, F = local(size), local(size), local(size)
    if flag == 0:
        put_strains(stiffness, g, y1 if ends else mid, X)
        ask_law(stiffness, g, numbers, STRESSES_BY_LAW)
    for e in range(0, ne, WIDTH):
        es = block(e, ne)
        own = chosen(section, es)
        length = gather(lengths, es, 1, 0)
        inverse = 1.0 / length
        once = counted(e, ne)
        take_elements(base, turned, rotations, es, mid, X)
        if flag == 0 and ends:
            take_elements(base, turned, rotations, es, y1, Y)
        for k in range(size):
            F[k] = 0.0
        for p in range(ng):
            G = at_point(N[p], dN[p], inverse, X)
            if flag == 0:
                H = at_point(N[p], dN[p], inverse, Y) if ends else G
                eps = strained(reference, es, ng, p, H)
                put_stresses(stiffness, S, S0, es, own, 6 * p, (start, end), diagonal, eps)
            weight = weights[p] * once * length
            n, m = six(S, es, 6 * ng, 6 * p)
            point_force(N[p], dN[p], inverse, G, times(weight, n), times(0.5 * weight, m), F)
        if viscous:
            for k in range(size // WIDTH):
                lost = lost + load(F, k) * (load(Y, k) - load(X, k))
        give(base, turned, rotations, es, F, f)
    if viscous:
        store(F, 0, 2.0 * lost)
        numbers[VISCOUS_WORK] = F[0] + F[1] + F[2] + F[3]
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


@inlined
def pace(numbers: Floats) -> float:
    """Derivative of `later` by y_1, if dampers act by the way to it."""
    return 1.0 if numbers[REACH] == 0.0 else 2.0


@part
def beam_predicted(g: Any, w: Any, numbers: Floats, flag: int) -> float:
    """``S + share D B(y) change``, y being where the stresses come from."""
    lengths, N, dN, stiffness = g.lengths, g.N, g.dN, g.stiffness
    y, change, S, out = w.mid, w.change, g.S, g.predicted
    share = numbers[SHARE]
    if numbers[ENDS] != 0.0:
        y, share = w.later, numbers[END] * pace(numbers)
    base, turned, rotations = g.base, g.turned, g.rotations
    section, diagonal = g.section, g.diagonal
    ne, nn = base.shape
    ng = len(N)
    ask_law(stiffness, g, numbers, MODULI_BY_LAW)
    X, V = local(12 * nn * WIDTH), local(12 * nn * WIDTH)
    for e in range(0, ne, WIDTH):
        es = block(e, ne)
        own = chosen(section, es)
        inverse = 1.0 / gather(lengths, es, 1, 0)
        take_elements(base, turned, rotations, es, y, X)
        take_elements(base, turned, rotations, es, change, V)
        for p in range(ng):
            G = at_point(N[p], dN[p], inverse, X)
            H = at_point(N[p], dN[p], inverse, V)
            eps = strain_changes(G, H)
            for i in range(6):
                more = share * stress_change(stiffness, es, own, p, i, diagonal, eps)
                scatter(out, es, 6 * ng, 6 * p + i, gather(S, es, 6 * ng, 6 * p + i) + more)
    return 0.0


# --------------------------------------------------------------------------------------------------
# Compiled tangent of beam elements in reduced coordinates, :data:`WIDTH` elements at a time.
#
# All that is made on the way lies in one array of SIMD vectors, ``a``; matrices are rows of three,
# and H, L, T... are where they start. Terms of Gauss points are made first and then summed up block
# by block: sums stay in registers. Parts take ``(g, w, numbers, flag)``, see :mod:`.elements`.

#: where matrices start: the block (6, 6), of an element its stiffness (6, 6), of a point slopes of
#: strains by velocities (3, 3), their stresses (6, 3), strains by one angular velocity (6, 3); then
#: stresses (6) of all points and what :func:`further` tells
STIFFNESS = 36
SLOPES, STRESSED, STRAINS, STRESSES = range(72, 144, 18)
Further = tuple[int, int, int, int, int, int]


@inlined
def keep(a: Floats, k: int, v: Vector) -> None:
    """Store what :func:`three` loads."""
    store(a, k, v[0])
    store(a, k + 1, v[1])
    store(a, k + 2, v[2])


@inlined
def further(points: int, nodes: int) -> Further:
    """Starts of H, L, T, P, Q: each point has one H (3, 3), each of its nodes the other four.

    L, T (6, 3): strains on the left, stresses on the right by its angular velocity; P, Q (3, 3):
    those between it and a velocity on the left, on the right. The last entry is the number of SIMD
    vectors in all.
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
    """All strains by it: (6, 3), from k on.

    By the node's velocity they are ``dN d_i`` for Gamma_i and zero for K.
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
    """Stiffness of the sections, or its diagonal, times a factor; none of that of a law."""
    if D.ndim == 4:
        return
    step = 7 if diagonal else 1
    for i in range(0, 36, step):
        store(a, STIFFNESS + i, factor * gather(D, own, 36, i))


@inlined
def stiff_by_law(D: Floats, es: Places, points: int, p: int, factor: float, a: Floats) -> None:
    """Stiffness of a law at Gauss point p, times a factor; that of sections is constant."""
    if D.ndim == 4:
        for i in range(36):
            store(a, STIFFNESS + i, factor * gather(D, es, 36 * points, 36 * p + i))


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
def diagonal(a: float, o: float) -> Rotation:
    """A times the unit matrix; o is zero."""
    return (a, o, o), (o, a, o), (o, o, a)


@inlined
def crossing(v: Vector, o: float) -> Rotation:
    """``v^``, rows of the matrix of the product ``v x``."""
    return (o, o - v[2], v[1]), (v[2], o, o - v[0]), (o - v[1], v[0], o)


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
    straight, S, T = diagonal(one, o), crossing(s, o), crossing(t, o)
    turns = diagonal(trace, o)
    for r in range(3):
        keep(a, 6 * r, straight[r])
        keep(a, 6 * r + 3, times(-1.0, S[r]))
        keep(a, 6 * r + 18, T[r])
        keep(a, 6 * r + 21, minus(turns[r], combine((x[r], y[r], z[r]), E)))


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

    ``P(y_L)^T (mass M + force (c int B(q_mid)^T D B(y_S) ds + share int S . C/l ds)) P(y_1)``: y_L
    is where constraint forces act, y_S where the stresses come from, c their derivative by the
    strains there (D) times that of y_S by y_1; S are those, or with flag 1 predicted ones.
    """
    y0, y1, mid, S, A = w.y0, w.y1, w.mid, g.S, w.A
    if flag == 1:
        S = g.predicted
    mass, half = numbers[MASS], numbers[SHARE] * numbers[FORCE]
    early, ends = numbers[WEIGHT] == 0.0, numbers[ENDS] != 0.0
    material = numbers[END] * numbers[FORCE] * pace(numbers) if ends else half
    apart, forces = ends and numbers[REACH] != 0.0, numbers[FORCE] != 0.0
    lengths, shapes, slopes, weights = g.lengths, g.N, g.dN, g.weights
    masses, stiffness, slot, section = g.mass, g.stiffness, g.slot, g.section
    base, turned, rotations, diagonal = g.base, g.turned, g.rotations, g.diagonal
    ne, nodes = base.shape
    points = len(shapes)
    if forces:  # for velocities masses are all
        ask_law(stiffness, g, numbers, MODULI_BY_LAW)
    table = local((2, points, nodes))
    tabulated(shapes, slopes, table)
    XB, XR = local(12 * nodes * WIDTH), local(12 * nodes * WIDTH)
    XL, XS = XB, XR
    if early:
        XL = local(12 * nodes * WIDTH)
    if apart:
        XS = local(12 * nodes * WIDTH)
    X = XL, XR
    a = local(further(points, nodes)[5] * WIDTH)
    for e in range(0, ne, WIDTH):
        es = block(e, ne)
        length = gather(lengths, es, 1, 0)
        inverse = 1.0 / length
        once = counted(e, ne)
        take_elements(base, turned, rotations, es, mid, XB)
        take_elements(base, turned, rotations, es, y1, XR)
        if early:
            take_elements(base, turned, rotations, es, y0, XL)
        if apart:
            take_elements(base, turned, rotations, es, w.later, XS)
        stiff(stiffness, chosen(section, es), diagonal, material * once * length, a)
        for p in range(points):
            GB = at_point(shapes[p], slopes[p], inverse, XB)
            GS = at_point(shapes[p], slopes[p], inverse, XS) if ends else GB
            n, m = six(S, es, 6 * points, 6 * p)
            f = half * weights[p] * once
            n, m = times(f, n), times(0.5 * f, m)
            keep(a, STRESSES + 6 * p, n)
            keep(a, STRESSES + 6 * p + 3, m)
            if forces:
                stiff_by_law(stiffness, es, points, p, material * once * length, a)
                point_terms(p, (GB, GS), X, table, weights[p], inverse, diagonal, a)
        for u in range(nodes):
            for v in range(nodes):
                start_block(masses, es, mass * once, u, v, table, X, a)
                if forces:
                    add_points(u, v, table, a)
                own = slot[es[0], u, v], slot[es[1], u, v], slot[es[2], u, v], slot[es[3], u, v]
                for k in range(0, 36, 4):
                    four = load(a, k), load(a, k + 1), load(a, k + 2), load(a, k + 3)
                    add_rows(A, own, 36, k, four)
    return 0.0
