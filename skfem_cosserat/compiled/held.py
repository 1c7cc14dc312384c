"""Strains that beams hold: what they gape by, forces of their multipliers, and their blocks.

Constraint rows as those of :mod:`.rows`, each one strain of one Gauss point, but made as stresses
are: :data:`WIDTH` elements at a time. Elements of a group may hold different strains: what one of
them does not hold goes to a place behind the arrays, see :func:`.structures.roomy`. Parts take
``(g, w, numbers, flag)`` as those of :mod:`.elements`.
"""

from __future__ import annotations

from typing import Any

from ..types import Floats
from .elements import (
    Point,
    at_point,
    give,
    line_force,
    point_force,
    strained,
    take_elements,
    three,
    turned_line,
    turned_strain,
)
from .jit import inlined, part
from .numbers import MASS, WEIGHT
from .simd import WIDTH, gather, local, pack, put_rows, scatter, store
from .small import Places, block, counted, times

__all__ = ["beam_hold", "beam_hold_matrix"]


@inlined
def of_elements(table: Any, es: Places, p: int, h: int) -> Places:
    """Places of the h-th strain held at Gauss point p of these elements."""
    return table[es[0], p, h], table[es[1], p, h], table[es[2], p, h], table[es[3], p, h]


@inlined
def of_nodes(table: Any, es: Places, p: int, h: int, u: int) -> Places:
    """The same of its blocks with nodes u."""
    return (
        table[es[0], p, h, u],
        table[es[1], p, h, u],
        table[es[2], p, h, u],
        table[es[3], p, h, u],
    )


@inlined
def acting(g: Any, w: Any, mass: float, es: Places, p: int, h: int, gap: float) -> float:
    """Keep what a strain gapes by, and the impulse that acts: see :func:`.rows.push`."""
    at, on = of_elements(g.held, es, p, h), of_elements(g.held_on, es, p, h)
    gap = gap * gather(g.row_on, on, 1, 0)
    mu = gather(w.total, at, 1, 0) + mass * gather(g.row_weight, on, 1, 0) * gap
    scatter(w.b, at, 1, 0, gap)
    return mu


@part
def beam_hold(g: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Gaps of held strains at y_1, and the forces by their multipliers, added to ``w.closing``."""
    held, holds, stress = g.held, g.holds, g.held_stress
    if len(held) == 0:
        return 0.0
    lengths, N, dN, reference = g.lengths, g.N, g.dN, g.reference
    base, turned, rotations = g.base, g.turned, g.rotations
    y, y1, closing, mass, weight = w.y0, w.y1, w.closing, numbers[MASS], numbers[WEIGHT]
    if weight != 0.0:
        y = w.mid
    ne, nn = base.shape
    ng = len(N)
    size, line = 12 * nn * WIDTH, holds[len(holds) - 1] < 3
    X, Y, F, a = local(size), local(size), local(size), local(6 * WIDTH)
    for k in range(6 * WIDTH):
        a[k] = 0.0
    for e in range(0, ne, WIDTH):
        es = block(e, ne)
        inverse, once = 1.0 / gather(lengths, es, 1, 0), counted(e, ne)
        take_elements(base, turned, rotations, es, y, X)
        take_elements(base, turned, rotations, es, y1, Y)
        for k in range(size):
            F[k] = 0.0
        for p in range(ng):
            G = at_point(N[p], dN[p], inverse, X)
            Gamma, K = strained(reference, es, ng, p, at_point(N[p], dN[p], inverse, Y))
            if line:  # nothing of how directors change along it is needed
                for h in range(len(holds)):
                    mu = acting(g, w, mass, es, p, h, Gamma[holds[h]])
                    scatter(stress, es, 6 * ng, 6 * p + holds[h], weight * inverse * mu)
                    store(a, holds[h], once * mu)
                line_force(N[p], dN[p], inverse, G, three(a, 0), F)
                continue
            for h in range(len(holds)):
                i = holds[h]
                mu = acting(g, w, mass, es, p, h, Gamma[i] if i < 3 else K[i - 3])
                scatter(stress, es, 6 * ng, 6 * p + i, weight * inverse * mu)
                store(a, i, once * mu)
            point_force(N[p], dN[p], inverse, G, three(a, 0), times(0.5, three(a, 3)), F)
        give(base, turned, rotations, es, F, closing)
    return 0.0


@inlined
def strain_by_node(
    N: float, dN: float, inverse: float, X: Floats, u: int, G: Point, i: int, a: Floats
) -> Any:
    """Strain i by the twist of node u, as six; ``a`` has strains by its angular velocity."""
    omega = three(a, 3 * i)
    none = pack((0.0, 0.0, 0.0, 0.0))
    v = none, none, none
    if i < 3:
        v = times(dN * inverse, G[1][i])
    return v[0], v[1], v[2], omega[0], omega[1], omega[2]


@part
def beam_hold_matrix(g: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Blocks of held strains with the vertices: ``G(y_1)``, and ``G(y)^T`` where forces act."""
    held, holds, down, up = g.held, g.holds, g.held_down, g.held_up
    if len(held) == 0:
        return 0.0
    lengths, N, dN, A = g.lengths, g.N, g.dN, w.A
    base, turned, rotations = g.base, g.turned, g.rotations
    y, y1 = w.y0, w.y1
    if numbers[WEIGHT] != 0.0:
        y = w.mid
    ne, nn = base.shape
    ng, count, line = len(N), len(holds), holds[len(holds) - 1] < 3
    X, Y = local(12 * nn * WIDTH), local(12 * nn * WIDTH)
    L, R = local(18 * WIDTH), local(18 * WIDTH)
    for e in range(0, ne, WIDTH):
        es = block(e, ne)
        inverse = 1.0 / gather(lengths, es, 1, 0)
        take_elements(base, turned, rotations, es, y, X)
        take_elements(base, turned, rotations, es, y1, Y)
        for p in range(ng):
            G, H = at_point(N[p], dN[p], inverse, X), at_point(N[p], dN[p], inverse, Y)
            for u in range(nn):
                if line:
                    turned_line(N[p][u], X, u, G[0], L, 0)
                    turned_line(N[p][u], Y, u, H[0], R, 0)
                else:
                    turned_strain(N[p][u], dN[p][u] * inverse, X, u, G, L, 0)
                    turned_strain(N[p][u], dN[p][u] * inverse, Y, u, H, R, 0)
                for h in range(count):
                    i = holds[h]
                    f = gather(g.row_on, of_elements(g.held_on, es, p, h), 1, 0)
                    to = of_nodes(down, es, p, h, u)
                    r = strain_by_node(N[p][u], dN[p][u], inverse, Y, u, H, i, R)
                    r = f * r[0], f * r[1], f * r[2], f * r[3], f * r[4], f * r[5]
                    put_rows(A, to, 1, 0, (r[0], r[1], r[2], r[3]))
                    put_rows(A, to, 1, 2, (r[2], r[3], r[4], r[5]))
                    to = of_nodes(up, es, p, h, u)
                    r = strain_by_node(N[p][u], dN[p][u], inverse, X, u, G, i, L)
                    for c in range(6):
                        scatter(A, to, 1, 6 * c, f * r[c])
    return 0.0
