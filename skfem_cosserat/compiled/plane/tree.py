"""Compiled nodal reparametrisation and null space of a tree of joints in a plane.

As :mod:`skfem_cosserat.compiled.tree`, but all rotations are about one axis: angles add up.
"""

from __future__ import annotations

from typing import Any

from ...types import Floats, IndexArray
from ..jit import inlined, part
from ..numbers import WEIGHT
from ..tree import AXIS, ROTATION, SLIDE, SPHERE, STRETCH, prescribe
from .complex_numbers import (
    ARM,
    CARRIED,
    CENTRE,
    CENTRE_SPOT,
    CHILD,
    CHILD_SPOT,
    ELEMENT,
    ELEMENT_LENGTH,
    FIRST,
    FRAMED,
    FULCRUM,
    FULCRUM_SPOT,
    GUIDE,
    GUIDE_AT,
    KIND,
    LAST,
    OPEN,
    OWN,
    PARENT,
    PARENT_AT,
    PARENT_SPOT,
    RELATIVE,
    SECTION_A,
    SECTION_B,
    SIGN,
    SLIDE0,
    STRAIN,
    TARGET,
    TARGET_SPOT,
    Complex,
    add_scaled,
    arrow,
    complex_at,
    crossed,
    inner,
    left,
    minus,
    outer,
    over,
    plus,
    point,
    product,
    put_complex,
    scaled,
    spot,
    turn_by,
)
from .complex_numbers import SLIDE as DIRECTION

__all__ = [
    "element_arm",
    "element_curvature",
    "element_maps",
    "element_stretch",
    "joint_add",
    "joint_begin",
    "joint_curvature",
    "joint_maps",
    "joint_move",
]


@part
def joint_begin(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Start of a step: arms and slides; zero increments."""
    y0, edges, arms, coordinates, along = w.y0, s.edges, s.arms, s.coordinates, s.along
    value = s.value
    for j in range(len(value)):
        value[j] = 0.0
        if coordinates[j, KIND] == SLIDE:
            u = product(complex_at(along, j, DIRECTION), arrow(y0, coordinates[j, GUIDE]))
            put_complex(along, j, SLIDE0, u)
    for e in range(len(edges)):
        a = spot(y0, edges[e, PARENT_AT], complex_at(arms, e, PARENT_SPOT))
        b = spot(y0, edges[e, CHILD], complex_at(arms, e, CHILD_SPOT))
        put_complex(arms, e, ARM, minus(b, a))
        for j in range(edges[e, FIRST], edges[e, LAST]):
            if coordinates[j, KIND] == STRETCH:
                value[j] = element_stretch(edges, arms, e, y0)
    return 0.0


@part
def joint_add(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Add increments x of the children's own coordinates."""
    x, value, edges, coordinates = w.x, s.value, s.edges, s.coordinates
    for e in range(len(edges)):
        for j in range(edges[e, FIRST], edges[e, LAST]):
            if coordinates[j, OWN] >= 0:
                value[j] += x[edges[e, CHILD], coordinates[j, OWN]]
    return 0.0


@part
def joint_move(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Frames of y_1 of all children, behind those of free vertices and the ground."""
    y0, y1, turn, value, edges, arms = w.y0, w.y1, s.turn, s.value, s.edges, s.arms
    coordinates, along, space = s.coordinates, s.along, s.rows
    prescribe(s.drives, space.y0, space.ground1, value)
    for e in range(len(edges)):
        v = edges[e, CHILD]
        if edges[e, FRAMED]:
            theta = 0.0
            for j in range(edges[e, FIRST], edges[e, LAST]):
                if coordinates[j, KIND] == AXIS or coordinates[j, KIND] == ROTATION:
                    theta += along[j, SIGN] * value[j]
            by = turn_by(theta)
            if edges[e, RELATIVE]:
                by = product(by, complex_at(turn, edges[e, PARENT_AT], 0))
            put_complex(turn, v, 0, by)
            put_complex(y1, v, 2, product(by, arrow(y0, v)))
        if edges[e, ELEMENT] >= 0:
            stretched = 0.0
            for j in range(edges[e, FIRST], edges[e, LAST]):
                if coordinates[j, KIND] == STRETCH:
                    stretched += value[j]
            x = plus(point(y1, edges[e, PARENT_AT]), element_arm(edges, arms, e, y1, stretched))
        else:
            x = spot(y1, edges[e, PARENT_AT], complex_at(arms, e, PARENT_SPOT))
            x = minus(x, product(complex_at(arms, e, CHILD_SPOT), arrow(y1, v)))
            slid = complex_at(arms, e, ARM)
            for j in range(edges[e, FIRST], edges[e, LAST]):
                if coordinates[j, KIND] == SLIDE:
                    slid = plus(slid, scaled(value[j], complex_at(along, j, SLIDE0)))
                elif coordinates[j, KIND] == SPHERE:
                    x = plus(x, product(turn_by(value[j]), complex_at(arms, e, ARM)))
            if edges[e, OPEN]:
                x = plus(x, product(slid, complex_at(turn, edges[e, GUIDE_AT], 0)))
        put_complex(y1, v, 0, x)
    return 0.0


@part
def joint_maps(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """S and X of all edges: flag 0 where P^T is taken, 1 where the unknowns move."""
    if flag == 1:
        maps(s, w.y1, w.S_right, w.X_right)
    elif numbers[WEIGHT] != 0.0:
        maps(s, w.mid, w.S_left, w.X_left)
    else:
        maps(s, w.y0, w.S_left, w.X_left)
    return 0.0


@inlined
def maps(s: Any, y: Floats, S: Floats, X: Floats) -> None:
    """S and X: a child's twist is X t_parent + S nu."""
    edges, arms, coordinates, along = s.edges, s.arms, s.coordinates, s.along
    for e in range(len(edges)):
        for k in range(12):
            S[e, k] = 0.0
            X[e, k] = 0.0
        X[e, 0] = 1.0
        X[e, 5] = 1.0
        if edges[e, ELEMENT] >= 0:
            element_maps(edges, arms, coordinates, e, y, S, X)
            continue
        for j in range(edges[e, FIRST], edges[e, LAST]):
            o, kind = coordinates[j, OWN], coordinates[j, KIND]
            if o < 0:
                continue
            if kind == SLIDE:
                u = product(complex_at(along, j, DIRECTION), arrow(y, coordinates[j, GUIDE]))
                turning = 0.0
            else:
                u = scaled(along[j, SIGN], left(lever(coordinates, along, j, y)))
                turning = along[j, SIGN]
                if kind == SPHERE or not edges[e, FRAMED]:
                    turning = 0.0
            S[e, o] = u[0]
            S[e, 4 + o] = u[1]
            S[e, 8 + o] = turning
        if edges[e, CARRIED]:
            f = spot(y, edges[e, FULCRUM], complex_at(arms, e, FULCRUM_SPOT))
            u = left(minus(f, point(y, edges[e, PARENT])))
            X[e, 2] = u[0]
            X[e, 6] = u[1]
            if edges[e, RELATIVE]:
                X[e, 10] = 1.0


@inlined
def lever(coordinates: IndexArray, along: Floats, j: int, y: Floats) -> Complex:
    """From the point that a coordinate turns about to the one that it moves."""
    return minus(
        spot(y, coordinates[j, TARGET], complex_at(along, j, TARGET_SPOT)),
        spot(y, coordinates[j, CENTRE], complex_at(along, j, CENTRE_SPOT)),
    )


@part
def joint_curvature(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Derivative of the tree's maps at the midpoint for fixed forces, times the weight.

    See :func:`skfem_cosserat.compiled.tree.joint_curvature`.
    """
    weight, C_child, C_parent, F = numbers[WEIGHT], w.C_child, w.C_parent, w.F
    if flag == 1:
        F = w.F_mixed
    y1, A, diag, to_parent, framed = w.y1, w.A, m.diag, m.to_parent, s.framed
    edges, arms, coordinates, along = s.edges, s.arms, s.coordinates, s.along
    for e in range(len(edges)):
        v = edges[e, CHILD]
        for k in range(12):
            C_child[e, k] = 0.0
            C_parent[e, k] = 0.0
        if edges[e, ELEMENT] >= 0:  # nothing acts beyond, see element_curvature
            continue
        f = scaled(weight, point(F, v))
        if edges[e, CARRIED]:
            own = diag[edges[e, PARENT]]
            parent_curvature(edges, arms, framed, e, y1, f, A, own, to_parent[e])
        for j in range(edges[e, FIRST], edges[e, LAST]):
            o = coordinates[j, OWN]
            if o < 0:
                continue
            if coordinates[j, KIND] == SLIDE:
                guide = coordinates[j, GUIDE]
                # of the direction times f
                moment = outer(product(complex_at(along, j, DIRECTION), arrow(y1, guide)), f)
                if guide == v:
                    C_child[e, 4 * o + 2] += moment
                elif guide < len(s.framed):
                    C_parent[e, 4 * o + 2] += moment
                continue
            # of the sign times lever x f
            g = scaled(-along[j, SIGN], left(f))
            for side in range(2):
                u, offset = coordinates[j, TARGET], complex_at(along, j, TARGET_SPOT)
                if side == 1:
                    u, offset = coordinates[j, CENTRE], complex_at(along, j, CENTRE_SPOT)
                    g = scaled(-1.0, g)
                if u >= len(s.framed):
                    continue
                turning = inner(g, left(product(offset, arrow(y1, u)))) if framed[u] else 0.0
                if u == v:
                    add_row(C_child, e, o, g, turning)
                else:
                    add_row(C_parent, e, o, g, turning)
    return 0.0


@inlined
def add_row(C: Floats, e: int, o: int, g: Complex, turning: float) -> None:
    """Add to row o of block e."""
    C[e, 4 * o] += g[0]
    C[e, 4 * o + 1] += g[1]
    C[e, 4 * o + 2] += turning


@inlined
def parent_curvature(
    edges: IndexArray,
    arms: Floats,
    framed: Any,
    e: int,
    y1: Floats,
    f: Complex,
    A: Floats,
    own: int,
    other: int,
) -> None:
    """Of the moment ``(x_fulcrum - phi_p) x f`` on a parent."""
    u = edges[e, FULCRUM]
    arm = product(complex_at(arms, e, FULCRUM_SPOT), arrow(y1, u))
    g = scaled(-1.0, left(f))
    if u == edges[e, PARENT]:
        A[own, 10] += inner(g, left(arm))
        return
    add_row(A, other, 2, g, inner(g, left(arm)) if framed[u] else 0.0)
    add_row(A, own, 2, scaled(-1.0, g), 0.0)


# --------------------------------------------------------------------------------------------------
# Compiled elements in a plane whose lines follow from their unit vectors: edges of the tree.
#
# Of a linear element that holds its shear strains ``phi' = gamma / conj(e)``, e in its middle; see
# :mod:`skfem_cosserat.compiled.tree`.


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
def element_stretch(edges: IndexArray, arms: Floats, e: int, y: Floats) -> float:
    """Axial strain."""
    a, b = sections(edges, arms, e, y)
    line = scaled(0.5 / arms[e, ELEMENT_LENGTH], between(edges, e, y))
    return inner(plus(a, b), line) - arms[e, STRAIN]


@inlined
def element_arm(edges: IndexArray, arms: Floats, e: int, y: Floats, stretched: float) -> Complex:
    """From parent to child, whose unit vectors are in place, with this axial strain."""
    a, b = sections(edges, arms, e, y)
    strain = arms[e, STRAIN] + stretched, arms[e, STRAIN + 1]
    return over(scaled(2.0 * arms[e, ELEMENT_LENGTH], strain), conjugate(plus(a, b)))


@inlined
def element_maps(
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
            u, turning = scaled(2.0 * arms[e, ELEMENT_LENGTH], inverse), 0.0
        else:
            u, turning = crossed(b, turned), 1.0
        S[e, o] = u[0]
        S[e, 4 + o] = u[1]
        S[e, 8 + o] = turning


@part
def element_curvature(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Derivative of the maps at the midpoint for fixed forces: as geometric stiffness.

    See :func:`skfem_cosserat.compiled.tree.element_curvature`. Takes ``w.F`` (flag 1: with the
    predicted stresses), leaves the balance without these forces in ``w.R_mixed``.
    """
    F, R, R0, weight = w.F, w.R_mixed, w.R, numbers[WEIGHT]
    if flag == 1:
        F = w.F_mixed
    else:
        for v in range(len(R)):
            for i in range(4):
                R[v, i] = R0[v, i]
    mid, y1, A, slot, edges, arms = w.mid, w.y1, w.A, s.element_slot, s.edges, s.arms
    none = (0.0, 0.0)
    for e in range(len(edges)):
        k = edges[e, ELEMENT]
        if k < 0:
            continue
        v, p = edges[e, CHILD], edges[e, PARENT_AT]
        a, b = sections(edges, arms, e, mid)
        c, d = sections(edges, arms, e, y1)
        length, f = arms[e, ELEMENT_LENGTH], point(F, v)
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
