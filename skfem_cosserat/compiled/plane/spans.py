"""Compiled elements in a plane whose lines follow from their unit vectors: edges of the tree.

Of a linear element that holds its shear strains ``phi' = gamma / conj(e)``, e in its middle; see
:mod:`skfem_cosserat.compiled.spans`.
"""

from __future__ import annotations

from typing import Any

from ...types import Floats
from ..jit import inlined, part
from ..numbers import WEIGHT
from .pairs import (
    Pair,
    add_scaled,
    arrow,
    crossed,
    inner,
    left,
    minus,
    over,
    pair,
    plus,
    point,
    product,
    scaled,
)

__all__ = ["span_arm", "span_curvature", "span_maps", "span_stretch"]


@inlined
def section(s: Any, k: int, side: int, e: Pair) -> Pair:
    """Unit vector of the section at a node, from that of the node."""
    return product((s.span_rotation[k, side, 0], s.span_rotation[k, side, 1]), e)


@inlined
def sections(s: Any, e: int, y: Floats) -> tuple[Pair, Pair]:
    """Those at the parent and at the child."""
    k = s.span[e]
    a, b = arrow(y, s.parent_at[e]), arrow(y, s.child[e])
    return section(s, k, 0, a), section(s, k, 1, b)


@inlined
def between(s: Any, e: int, y: Floats) -> Pair:
    """From parent to child."""
    return minus(point(y, s.child[e]), point(y, s.parent_at[e]))


@inlined
def conjugate(a: Pair) -> Pair:
    """``conj(a)``."""
    return a[0], -a[1]


@inlined
def span_stretch(s: Any, e: int, y: Floats) -> float:
    """Axial strain."""
    k = s.span[e]
    a, b = sections(s, e, y)
    line = scaled(0.5 / s.span_reach[k], between(s, e, y))
    return inner(plus(a, b), line) - s.span_strain[k, 0]


@inlined
def span_arm(s: Any, e: int, y: Floats, stretched: float) -> Pair:
    """From parent to child, whose unit vectors are in place, with this axial strain."""
    k = s.span[e]
    a, b = sections(s, e, y)
    strain = s.span_strain[k, 0] + stretched, s.span_strain[k, 1]
    return over(scaled(2.0 * s.span_reach[k], strain), conjugate(plus(a, b)))


@inlined
def by_turn(arm: Pair, a: Pair, both: Pair) -> Pair:
    """Velocity of the child by the angular velocity of a node with the unit vector a."""
    return left(over(product(arm, conjugate(a)), conjugate(both)))


@inlined
def span_maps(s: Any, e: int, y: Floats, S: Floats, X: Floats, kinds: Any, stretches: int) -> None:
    """S and X of a child, in place of zeros but for the identity of X's velocities."""
    own, first = s.own, s.first
    a, b = sections(s, e, y)
    both, arm = plus(a, b), between(s, e, y)
    u = by_turn(arm, a, both)
    X[e, 2] = u[0]
    X[e, 6] = u[1]
    for j in range(first[e], first[e + 1]):
        o = own[j]
        if kinds[j] == stretches:
            u, turning = over((2.0 * s.span_reach[s.span[e]], 0.0), conjugate(both)), 0.0
        else:
            u, turning = by_turn(arm, b, both), 1.0
        S[e, o] = u[0]
        S[e, 4 + o] = u[1]
        S[e, 8 + o] = turning


@part
def span_curvature(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Derivative of the maps at the midpoint for fixed forces: as geometric stiffness.

    See :func:`skfem_cosserat.compiled.spans.span_curvature`. Takes ``w.F`` (flag 1: with the
    predicted stresses), leaves the balance without these forces in ``w.R_mixed``.
    """
    F, R, weight = w.F, w.R_mixed, numbers[WEIGHT]
    if flag == 1:
        F = w.F_mixed
    else:
        for v in range(len(R)):
            for c in range(4):
                R[v, c] = w.R[v, c]
    mid, y1, A, slot, spans, child = w.mid, w.y1, w.A, s.span_slot, s.span, s.child
    for e in range(len(child)):
        k = spans[e]
        if k < 0:
            continue
        v, p = child[e], s.parent_at[e]
        a, b = sections(s, e, mid)
        reach, arm = s.span_reach[k], between(s, e, mid)
        f = point(F, v)
        mu = over(scaled(2.0 * reach, f), plus(a, b))
        take_off(R, p, 0, scaled(-1.0, f))
        take_off(R, v, 0, f)
        on_both = scaled(0.5 / reach, product(arm, conjugate(mu)))
        take_off(R, p, 2, crossed((s.span_rotation[k, 0, 0], s.span_rotation[k, 0, 1]), on_both))
        take_off(R, v, 2, crossed((s.span_rotation[k, 1, 0], s.span_rotation[k, 1, 1]), on_both))
        n = scaled(-0.5 * weight / reach, mu)
        c, d = sections(s, e, y1)
        none = (0.0, 0.0)
        for i in range(2):
            L = a if i == 0 else b
            for j in range(2):
                T = c if j == 0 else d
                xe = n if i == 1 else scaled(-1.0, n)
                ex = n if j == 1 else scaled(-1.0, n)
                add_scaled(0.0, xe, conjugate(ex), none, L, T, A, slot[k, i, j])
    return 0.0


@inlined
def take_off(R: Floats, v: int, c: int, f: Pair) -> None:
    """``R_v -= f``, from column c on."""
    R[v, c] -= f[0]
    R[v, c + 1] -= f[1]
