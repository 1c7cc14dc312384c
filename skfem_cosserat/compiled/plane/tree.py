"""Compiled nodal reparametrisation and null space of a tree of joints in a plane.

As :mod:`skfem_cosserat.compiled.tree`, but all rotations are about one axis: angles add up.
"""

from __future__ import annotations

from typing import Any

from ...types import Floats
from ..jit import inlined, part
from ..numbers import WEIGHT
from ..tree import AXIS, ROTATION, SLIDE, SPHERE, STRETCH
from .pairs import (
    Pair,
    arrow,
    inner,
    left,
    minus,
    outer,
    pair,
    plus,
    point,
    product,
    put_pair,
    scaled,
    spot,
    turn_by,
)
from .spans import span_arm, span_maps, span_stretch

__all__ = ["joint_add", "joint_begin", "joint_curvature", "joint_maps", "joint_move"]


@part
def joint_begin(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Start of a step: arms and slides; zero increments, driven ones at their end."""
    y0, arm0, value, driven, first, kinds = w.y0, s.arm0, s.value, s.driven, s.first, s.kind
    for j in range(len(value)):
        value[j] = driven[j]
        if kinds[j] == SLIDE:
            put_pair(s.slide0, j, 0, product(pair(s.slide, j), arrow(y0, s.guide[j])))
    for e in range(len(arm0)):
        a = spot(y0, s.parent_at[e], s.parent_offset, e)
        put_pair(arm0, e, 0, minus(spot(y0, s.child[e], s.child_offset, e), a))
        for j in range(first[e], first[e + 1]):
            if kinds[j] == STRETCH:
                value[j] = span_stretch(s, e, y0)
    return 0.0


@part
def joint_add(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Add increments x of the children's own coordinates."""
    x, value, first, own, child = w.x, s.value, s.first, s.own, s.child
    for e in range(len(child)):
        for j in range(first[e], first[e + 1]):
            if own[j] >= 0:
                value[j] += x[child[e], own[j]]
    return 0.0


@part
def joint_move(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Frames of y_1 of all children, behind those of free vertices and the ground."""
    y0, y1, turn, value, sign = w.y0, w.y1, s.turn, s.value, s.sign
    child, framed, first, kinds, relative = s.child, s.framed, s.first, s.kind, s.relative
    for e in range(len(child)):
        v = child[e]
        if framed[v]:
            theta = 0.0
            for j in range(first[e], first[e + 1]):
                if kinds[j] == AXIS or kinds[j] == ROTATION:
                    theta += sign[j] * value[j]
            by = turn_by(theta)
            if relative[e]:
                by = product(by, pair(turn, s.parent_at[e]))
            put_pair(turn, v, 0, by)
            put_pair(y1, v, 2, product(by, arrow(y0, v)))
        put_pair(y1, v, 0, position(s, e, y1))
    return 0.0


@inlined
def position(s: Any, e: int, y1: Floats) -> Pair:
    """Origin of a child whose unit vector and whose parent are in place."""
    kinds, value, first = s.kind, s.value, s.first
    if s.span[e] >= 0:
        stretched = 0.0
        for j in range(first[e], first[e + 1]):
            if kinds[j] == STRETCH:
                stretched += value[j]
        return plus(point(y1, s.parent_at[e]), span_arm(s, e, y1, stretched))
    x = spot(y1, s.parent_at[e], s.parent_offset, e)
    x = minus(x, product(pair(s.child_offset, e), arrow(y1, s.child[e])))
    if s.open[e]:
        arm = pair(s.arm0, e)
        for j in range(first[e], first[e + 1]):
            if kinds[j] == SLIDE:
                arm = plus(arm, scaled(value[j], pair(s.slide0, j)))
        return plus(x, product(arm, pair(s.turn, s.guide_at[e])))
    for j in range(first[e], first[e + 1]):
        if kinds[j] == SPHERE:
            x = plus(x, product(turn_by(value[j]), pair(s.arm0, e)))
    return x


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
    child, parent, framed, first, kinds, own = s.child, s.parent, s.framed, s.first, s.kind, s.own
    for e in range(len(child)):
        for k in range(12):
            S[e, k] = 0.0
            X[e, k] = 0.0
        X[e, 0] = 1.0
        X[e, 5] = 1.0
        if s.span[e] >= 0:
            span_maps(s, e, y, S, X, kinds, STRETCH)
            continue
        for j in range(first[e], first[e + 1]):
            o = own[j]
            if o < 0:
                continue
            if kinds[j] == SLIDE:
                u, turning = product(pair(s.slide, j), arrow(y, s.guide[j])), 0.0
            else:
                arm = minus(
                    spot(y, s.target[j], s.target_offset, j),
                    spot(y, s.centre[j], s.centre_offset, j),
                )
                u, turning = scaled(s.sign[j], left(arm)), s.sign[j]
                if kinds[j] == SPHERE or not framed[child[e]]:
                    turning = 0.0
            S[e, o] = u[0]
            S[e, 4 + o] = u[1]
            S[e, 8 + o] = turning
        p = parent[e]
        if p >= 0 and framed[p]:
            u = left(minus(spot(y, s.fulcrum[e], s.fulcrum_offset, e), point(y, p)))
            X[e, 2] = u[0]
            X[e, 6] = u[1]
            if s.relative[e]:
                X[e, 10] = 1.0


@part
def joint_curvature(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Derivative of the tree's maps at the midpoint for fixed forces, times the weight.

    See :func:`skfem_cosserat.compiled.curvature.joint_curvature`.
    """
    weight, C_child, C_parent, F = numbers[WEIGHT], w.C_child, w.C_parent, w.F
    if flag == 1:
        F = w.F_mixed
    y1, mid, A, diag = w.y1, w.mid, w.A, m.diag
    for e in range(len(s.child)):
        v, p = s.child[e], s.parent[e]
        for k in range(12):
            C_child[e, k] = 0.0
            C_parent[e, k] = 0.0
        if s.span[e] >= 0:  # nothing acts beyond, see span_curvature
            continue
        f = scaled(weight, point(F, v))
        if p >= 0 and s.framed[p]:
            parent_curvature(s, e, y1, f, A, diag[p], m.to_parent[e])
        for j in range(s.first[e], s.first[e + 1]):
            o = s.own[j]
            if o < 0:
                continue
            if s.kind[j] == SLIDE:
                guide = s.guide[j]
                g = outer(f, product(pair(s.slide, j), arrow(y1, guide)))
                if guide == v:
                    C_child[e, 4 * o + 2] += 0.0 - g
                elif guide < len(diag):
                    C_parent[e, 4 * o + 2] += 0.0 - g
                continue
            # of sign (target - centre) x f
            g = scaled(-s.sign[j], left(f))
            add_motion(C_child, C_parent, e, o, v, s.target[j], s.target_offset, j, g, y1, s.framed)
            g = scaled(-1.0, g)
            add_motion(C_child, C_parent, e, o, v, s.centre[j], s.centre_offset, j, g, y1, s.framed)
    return 0.0


@inlined
def add_motion(
    C_child: Floats,
    C_parent: Floats,
    e: int,
    o: int,
    v: int,
    u: int,
    offsets: Floats,
    j: int,
    g: Pair,
    y1: Floats,
    framed: Any,
) -> None:
    """Row o of own coordinates: g times the motion of a point of u, the child v or the parent."""
    if u >= len(framed):
        return
    turning = 0.0
    if framed[u]:
        turning = inner(g, left(product(pair(offsets, j), arrow(y1, u))))
    if u == v:
        C_child[e, 4 * o] += g[0]
        C_child[e, 4 * o + 1] += g[1]
        C_child[e, 4 * o + 2] += turning
    else:
        C_parent[e, 4 * o] += g[0]
        C_parent[e, 4 * o + 1] += g[1]
        C_parent[e, 4 * o + 2] += turning


@inlined
def parent_curvature(
    s: Any, e: int, y1: Floats, f: Pair, A: Floats, own: int, other: int
) -> None:
    """Of the moment ``(x_fulcrum - phi_p) x f`` on a parent."""
    u = s.fulcrum[e]
    arm = product(pair(s.fulcrum_offset, e), arrow(y1, u))
    g = scaled(-1.0, left(f))
    if u == s.parent[e]:
        A[own, 10] += inner(g, left(arm))
        return
    A[other, 8] += g[0]
    A[other, 9] += g[1]
    A[own, 8] -= g[0]
    A[own, 9] -= g[1]
    if s.framed[u]:
        A[other, 10] += inner(g, left(arm))
