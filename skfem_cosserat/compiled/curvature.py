"""Compiled derivatives of a tree's maps, for schemes that take them at midpoints."""

from __future__ import annotations

from typing import Any

from ..types import Floats
from .jit import inlined, part
from .numbers import WEIGHT
from .small import Vector, add_skew, combine, cross, directors, dot, minus, plus, row, times
from .tree import AXIS, SLIDE, axis, slide, spot

__all__ = ["joint_curvature"]


@part
def joint_curvature(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Derivative of the tree's maps at the midpoint for fixed forces of subtrees, times the weight.

    Moments on parents go to the blocks (parent, parent) and (parent, child), rows of own
    coordinates to C_child (by the child's twist) and C_parent (by the parent's). Flag 1: forces
    with the predicted stresses.
    """
    weight = numbers[WEIGHT]
    A, C_child, C_parent = w.A, w.C_child, w.C_parent
    F = w.F_mixed if flag == 1 else w.F
    for e in range(len(s.child)):
        v = s.child[e]
        p = s.parent[e]
        f = times(weight, row(F, v))
        moment = times(weight, (F[v, 3], F[v, 4], F[v, 5]))
        for r in range(6):
            for c in range(6):
                C_child[e, r, c] = 0.0
                C_parent[e, r, c] = 0.0
        if s.span[e] >= 0:  # nothing acts beyond, see span_curvature
            continue
        if p >= 0 and s.framed[p]:
            moment_curvature(s, e, w.y1, f, A, m.diag[p], m.to_parent[e])
        for j in range(s.first[e], s.first[e + 1]):
            if s.own[j] < 0:
                continue
            if s.kind[j] == SLIDE:
                slide_curvature(s, e, j, w.mid, w.y1, f, C_child, C_parent)
            else:
                turn_curvature(s, e, j, w.mid, w.y1, f, moment, C_child, C_parent)
    return 0.0


@inlined
def add_crossed(A: Floats, k: int, f: Vector, a: Vector) -> None:
    """``A_k += f^ a^ = a f^T - (f . a) I``, the moments by rotations."""
    fa = dot(f, a)
    for r in range(3):
        for c in range(3):
            A[k, 3 + r, 3 + c] += a[r] * f[c]
        A[k, 3 + r, 3 + r] -= fa


@inlined
def moment_curvature(
    s: Any, e: int, y1: Floats, f: Vector, A: Floats, own: int, other: int
) -> None:
    """Of the moment ``(x_fulcrum - phi_p) x f`` on a parent."""
    v = s.child[e]
    x = spot(y1, s.fulcrum_row[e], row(s.fulcrum_offset, e))
    if s.fulcrum_vertex[e] == s.parent[e]:
        add_crossed(A, own, f, minus(x, row(y1, s.parent_row[e])))
        return
    add_skew(A, other, 3, 0, times(-1.0, f))
    add_skew(A, own, 3, 0, f)
    if s.framed[v]:
        add_crossed(A, other, f, minus(x, row(y1, s.child_row[e])))


@inlined
def add_row(C: Floats, e: int, o: int, c0: int, g: Vector) -> None:
    """``C_eo += g``, from column c0 on."""
    for c in range(3):
        C[e, o, c0 + c] += g[c]


@inlined
def slide_curvature(
    s: Any, e: int, j: int, yL: Floats, y1: Floats, f: Vector, C_child: Floats, C_parent: Floats
) -> None:
    """Of ``(left x right) . f``."""
    guide = s.guide_vertex[j]
    if guide < 0:
        return
    left, right = slide(s, j, yL)
    left1, right1 = slide(s, j, y1)
    g = plus(cross(left1, cross(right, f)), cross(right1, cross(f, left)))
    if guide == s.child[e]:
        add_row(C_child, e, s.own[j], 3, g)
    else:
        add_row(C_parent, e, s.own[j], 3, g)


@inlined
def turn_curvature(
    s: Any,
    e: int,
    j: int,
    yL: Floats,
    y1: Floats,
    f: Vector,
    moment: Vector,
    C_child: Floats,
    C_parent: Floats,
) -> None:
    """Of ``a . ((x_target - x_centre) x f + m)``."""
    v = s.child[e]
    o = s.own[j]
    target, centre = row(s.target_offset, j), row(s.centre_offset, j)
    a = axis(s, j, yL)
    guide = s.guide_vertex[j]
    if s.kind[j] == AXIS and guide >= 0:
        arm = minus(spot(yL, s.target_row[j], target), spot(yL, s.centre_row[j], centre))
        m = cross(arm, f)
        if s.framed[v]:
            m = plus(m, moment)
        g = cross(axis(s, j, y1), m)
        if guide == v:
            add_row(C_child, e, o, 3, g)
        else:
            add_row(C_parent, e, o, 3, g)
    g = cross(f, a)  # (arm' x f) . a = arm' . (f x a)
    for k in range(2):
        vertex, r, offset = s.target_vertex[j], s.target_row[j], target
        if k == 1:
            vertex, r, offset = s.centre_vertex[j], s.centre_row[j], centre
            g = times(-1.0, g)
        if vertex < 0:
            continue
        moved = combine(offset, directors(y1, r)) if s.framed[vertex] else (0.0, 0.0, 0.0)
        turning = cross(moved, g)
        if vertex == v:
            add_row(C_child, e, o, 0, g)
            add_row(C_child, e, o, 3, turning)
        else:
            add_row(C_parent, e, o, 0, g)
            add_row(C_parent, e, o, 3, turning)
