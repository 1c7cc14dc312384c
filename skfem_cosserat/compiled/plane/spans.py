"""Compiled elements in a plane whose lines follow from their unit vectors: edges of the tree.

Of a linear element that holds its shear strains ``phi' = gamma / conj(e)``, e in its middle; see
:mod:`skfem_cosserat.compiled.spans`.
"""

from __future__ import annotations

from typing import Any

from ...types import Floats, IndexArray
from ..jit import inlined, part
from ..numbers import WEIGHT
from ..tree import STRETCH
from .complex_numbers import (
    CHILD,
    FIRST,
    KIND,
    LAST,
    OWN,
    PARENT_AT,
    SECTION_A,
    SECTION_B,
    SPAN,
    SPAN_LENGTH,
    STRAIN,
    Complex,
    add_scaled,
    arrow,
    complex_at,
    crossed,
    inner,
    left,
    minus,
    over,
    plus,
    point,
    product,
    scaled,
)

__all__ = ["span_arm", "span_curvature", "span_maps", "span_stretch"]


@inlined
def sections(edges: IndexArray, arms: Floats, e: int, y: Floats) -> tuple[Complex, Complex]:
    """Unit vectors of the section at the parent and at the child."""
    a, b = arrow(y, edges[e, PARENT_AT]), arrow(y, edges[e, CHILD])
    return product(complex_at(arms, e, SECTION_A), a), product(complex_at(arms, e, SECTION_B), b)


@inlined
def between(edges: IndexArray, e: int, y: Floats) -> Complex:
    """From parent to child."""
    return minus(point(y, edges[e, CHILD]), point(y, edges[e, PARENT_AT]))


@inlined
def conjugate(a: Complex) -> Complex:
    """``conj(a)``."""
    return a[0], -a[1]


@inlined
def span_stretch(edges: IndexArray, arms: Floats, e: int, y: Floats) -> float:
    """Axial strain."""
    a, b = sections(edges, arms, e, y)
    line = scaled(0.5 / arms[e, SPAN_LENGTH], between(edges, e, y))
    return inner(plus(a, b), line) - arms[e, STRAIN]


@inlined
def span_arm(edges: IndexArray, arms: Floats, e: int, y: Floats, stretched: float) -> Complex:
    """From parent to child, whose unit vectors are in place, with this axial strain."""
    a, b = sections(edges, arms, e, y)
    strain = arms[e, STRAIN] + stretched, arms[e, STRAIN + 1]
    return over(scaled(2.0 * arms[e, SPAN_LENGTH], strain), conjugate(plus(a, b)))


@inlined
def span_maps(
    edges: IndexArray,
    arms: Floats,
    coordinates: IndexArray,
    e: int,
    y: Floats,
    S: Floats,
    X: Floats,
) -> None:
    """S and X of a child, in place of zeros but for the identity of X's velocities."""
    a, b = sections(edges, arms, e, y)
    # by the angular velocity of a node with the unit vector a: i arm conj(a) / conj(a + b)
    inverse = over((1.0, 0.0), conjugate(plus(a, b)))
    turned = product(left(between(edges, e, y)), inverse)
    u = crossed(a, turned)
    X[e, 2] = u[0]
    X[e, 6] = u[1]
    for j in range(edges[e, FIRST], edges[e, LAST]):
        o = coordinates[j, OWN]
        if coordinates[j, KIND] == STRETCH:
            u, turning = scaled(2.0 * arms[e, SPAN_LENGTH], inverse), 0.0
        else:
            u, turning = crossed(b, turned), 1.0
        S[e, o] = u[0]
        S[e, 4 + o] = u[1]
        S[e, 8 + o] = turning


@part
def span_curvature(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Derivative of the maps at the midpoint for fixed forces: as geometric stiffness.

    See :func:`skfem_cosserat.compiled.spans.span_curvature`. Takes ``w.F`` (flag 1: with the
    predicted stresses), leaves the balance without these forces in ``w.R_mixed``.
    """
    F, R, R0, weight = w.F, w.R_mixed, w.R, numbers[WEIGHT]
    if flag == 1:
        F = w.F_mixed
    else:
        for v in range(len(R)):
            for i in range(4):
                R[v, i] = R0[v, i]
    mid, y1, A, slot, edges, arms = w.mid, w.y1, w.A, s.span_slot, s.edges, s.arms
    none = (0.0, 0.0)
    for e in range(len(edges)):
        k = edges[e, SPAN]
        if k < 0:
            continue
        v, p = edges[e, CHILD], edges[e, PARENT_AT]
        a, b = sections(edges, arms, e, mid)
        c, d = sections(edges, arms, e, y1)
        length, f = arms[e, SPAN_LENGTH], point(F, v)
        mu = over(scaled(2.0 * length, f), plus(a, b))
        on_both = scaled(0.5 / length, product(between(edges, e, mid), conjugate(mu)))
        take_off(R, p, scaled(-1.0, f), crossed(complex_at(arms, e, SECTION_A), on_both))
        take_off(R, v, f, crossed(complex_at(arms, e, SECTION_B), on_both))
        n = scaled(-0.5 * weight / length, mu)
        other, back = scaled(-1.0, n), conjugate(n)
        back_other = scaled(-1.0, back)
        add_scaled(0.0, other, back_other, none, a, c, A, slot[k, 0, 0])
        add_scaled(0.0, other, back, none, a, d, A, slot[k, 0, 1])
        add_scaled(0.0, n, back_other, none, b, c, A, slot[k, 1, 0])
        add_scaled(0.0, n, back, none, b, d, A, slot[k, 1, 1])
    return 0.0


@inlined
def take_off(R: Floats, v: int, f: Complex, on_arrow: Complex) -> None:
    """Forces on the origin and the unit vector of a frame off R."""
    R[v, 0] -= f[0]
    R[v, 1] -= f[1]
    R[v, 2] -= on_arrow[0]
    R[v, 3] -= on_arrow[1]
