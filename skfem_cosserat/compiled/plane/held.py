"""Strains that beams in a plane hold by constraint rows; see :mod:`skfem_cosserat.compiled.held`.

Each is a combination of gamma and kappa that is the same at all points of an element.
"""

from __future__ import annotations

from typing import Any

from ...types import Floats
from ..elements import origins, triple
from ..held import acting, of_elements, of_nodes
from ..jit import inlined, part
from ..numbers import MASS, WEIGHT
from ..simd import WIDTH, add_rows, gather, load, local, pack, put_rows, scatter, store
from ..small import Places, Vector, block, counted, dot, minus, plus, times
from .complex_numbers import crossed
from .elements import Field, at_point, by_turn, point_force, put_triple, strains, take, turning, two

__all__ = ["beam_hold", "beam_hold_matrix"]

ZERO = (0.0, 0.0, 0.0)


@inlined
def form(g: Any, es: Places, h: int) -> Vector:
    """Of the h-th strain, by gamma and kappa."""
    return triple(g.held_form, es, 3 * len(g.holds), 3 * h)


@part
def beam_hold(g: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Gaps of held strains at y_1, and the forces by their multipliers, added to ``w.closing``."""
    if len(g.held) == 0:
        return 0.0
    lengths, N, dN, reference, stress = g.lengths, g.N, g.dN, g.reference, g.held_stress
    base, turned, rotations = g.base, g.turned, g.rotations
    y, y1, closing, mass, weight = w.y0, w.y1, w.closing, numbers[MASS], numbers[WEIGHT]
    if weight != 0.0:
        y = w.mid
    ne, nn = base.shape
    ng = len(N)
    X, Y, F = local(4 * nn * WIDTH), local(4 * nn * WIDTH), local(4 * nn * WIDTH)
    for e in range(0, ne, WIDTH):
        es = block(e, ne)
        inverse, once = 1.0 / gather(lengths, es, 1, 0), counted(e, ne)
        take(base, turned, rotations, es, y, X)
        take(base, turned, rotations, es, y1, Y)
        for k in range(4 * nn):
            store(F, k, 0.0 * once)
        for p in range(ng):
            eps = strains(at_point(N[p], dN[p], inverse, Y))
            eps = minus(eps, triple(reference, es, 3 * ng, 3 * p))
            n = times(0.0 * once, ZERO)
            for h in range(len(g.holds)):
                own = form(g, es, h)
                n = plus(n, times(acting(g, w, mass, es, p, h, dot(own, eps)), own))
            put_triple(stress, es, 3 * ng, 3 * p, times(weight * inverse, n))
            G = at_point(N[p], dN[p], inverse, X)
            point_force(N[p], dN[p], inverse, G, times(once, n), F)
        for a in range(nn):
            e_force = two(F, 4 * a + 2)
            if turned:  # by unit vectors of sections: those of the nodes
                e_force = crossed(turning(rotations, es, nn, a), e_force)
            four = load(F, 4 * a), load(F, 4 * a + 1), e_force[0], e_force[1]
            add_rows(closing, origins(base, es, a), 4, 0, four)
    return 0.0


@inlined
def by_node(own: Vector, N: float, dN: float, G: Field, X: Floats, u: int) -> Vector:
    """A strain by the twist of node u."""
    e = G[1]
    return (
        dN * (own[0] * e[0] - own[1] * e[1]),
        dN * (own[0] * e[1] + own[1] * e[0]),
        dot(own, by_turn(N, dN, G, two(X, 4 * u + 2))),
    )


@part
def beam_hold_matrix(g: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Blocks of held strains with the vertices: ``G(y_1)``, and ``G(y)^T`` where forces act."""
    if len(g.held) == 0:
        return 0.0
    lengths, N, dN, A = g.lengths, g.N, g.dN, w.A
    base, turned, rotations = g.base, g.turned, g.rotations
    y, y1, none = w.y0, w.y1, pack((0.0, 0.0, 0.0, 0.0))
    if numbers[WEIGHT] != 0.0:
        y = w.mid
    ne, nn = base.shape
    X, Y = local(4 * nn * WIDTH), local(4 * nn * WIDTH)
    for e in range(0, ne, WIDTH):
        es = block(e, ne)
        inverse = 1.0 / gather(lengths, es, 1, 0)
        take(base, turned, rotations, es, y, X)
        take(base, turned, rotations, es, y1, Y)
        for p in range(len(N)):
            G, H = at_point(N[p], dN[p], inverse, X), at_point(N[p], dN[p], inverse, Y)
            for h in range(len(g.holds)):
                own = times(
                    gather(g.row_on, of_elements(g.held_on, es, p, h), 1, 0), form(g, es, h)
                )
                for u in range(nn):
                    r = by_node(own, N[p][u], dN[p][u] * inverse, H, Y, u)
                    put_rows(A, of_nodes(g.held_down, es, p, h, u), 1, 0, (r[0], r[1], r[2], none))
                    r = by_node(own, N[p][u], dN[p][u] * inverse, G, X, u)
                    to = of_nodes(g.held_up, es, p, h, u)
                    for c in range(3):
                        scatter(A, to, 1, 4 * c, r[c])
    return 0.0
