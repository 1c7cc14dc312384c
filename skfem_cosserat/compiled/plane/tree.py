"""Compiled nodal reparametrisation and null space of a tree of joints in a plane.

As :mod:`skfem_cosserat.compiled.tree`, but all rotations are about one axis: angles add up.
"""

from __future__ import annotations

from typing import Any

from ...types import Floats, IndexArray
from ..jit import inlined, part
from ..numbers import WEIGHT
from ..tables.plane import (
    ARM,
    CARRIED,
    CENTRE,
    CENTRE_SPOT,
    CHILD,
    CHILD_SPOT,
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
    SIGN,
    SLIDE0,
    TARGET,
    TARGET_SPOT,
)
from ..tables.plane import SLIDE as DIRECTION
from ..tables.tree import AXIS, ROTATION, SLIDE, SPHERE
from ..tree import prescribe
from .complex_numbers import (
    Complex,
    arrow,
    complex_at,
    inner,
    left,
    minus,
    outer,
    plus,
    point,
    product,
    put_complex,
    scaled,
    spot,
    turn_by,
)

__all__ = [
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
