"""Compiled derivatives of a tree's maps, for schemes that take them at midpoints."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..types import Floats, IndexArray
from .jit import jit
from .small import clear, cross, put_cross, put_cross_cross
from .tree import AXIS, SLIDE, SPHERE, axis, material, spot

__all__ = ["edge_curvature"]


@jit
def edge_curvature(t: Any, m: Any, w: Any, weight: float, mixed: bool) -> None:
    """Derivative of the tree's maps at the midpoint for fixed forces of subtrees, times `weight`.

    Moments on parents go to the blocks (parent, parent) and (parent, child), rows of own
    coordinates to C_child (by the child's twist) and C_parent (by the parent's).
    """
    yL, y1, A, C = w.mid, w.y1, w.A, (w.C_child, w.C_parent)
    F = w.F_mixed if mixed else w.F
    arm = np.empty((6, 3))
    for e in range(len(t.child)):
        v = t.child[e]
        p = t.parent[e]
        clear(C[0][e])
        clear(C[1][e])
        if p >= 0 and t.framed[p]:
            moment_curvature(t, e, y1, F[v], weight, A, m.diag, m.to_parent, arm[0])
        for j in range(t.first[e], t.first[e + 1]):
            if t.own[j] < 0:
                continue
            if t.kind[j] == SLIDE:
                slide_curvature(t, e, j, yL, y1, F[v], weight, C, arm)
            else:
                turn_curvature(t, e, j, yL, y1, F[v], weight, C, arm)


@jit
def moment_curvature(
    t: Any,
    e: int,
    y1: Floats,
    force: Floats,
    weight: float,
    A: Floats,
    diag: IndexArray,
    to_parent: IndexArray,
    a: Floats,
) -> None:
    """Of the moment ``(x_fulcrum - phi_p) x f`` on a parent; a (3,) is scratch."""
    v = t.child[e]
    p = t.parent[e]
    f = force[:3]
    own = A[diag[p]]
    spot(y1, t.fulcrum_row[e], t.fulcrum_offset[e], a)
    if t.fulcrum_vertex[e] == p:
        for c in range(3):
            a[c] -= y1[t.parent_row[e], c]
        put_cross_cross(own, 3, 3, weight, f, a)
        return
    other = A[to_parent[e]]
    for c in range(3):
        a[c] -= y1[t.child_row[e], c]
    put_cross(other, 3, 0, -weight, f)
    put_cross(own, 3, 0, weight, f)
    if t.framed[v]:
        put_cross_cross(other, 3, 3, weight, f, a)


@jit
def slide_curvature(
    t: Any,
    e: int,
    j: int,
    yL: Floats,
    y1: Floats,
    force: Floats,
    weight: float,
    C: tuple[Floats, Floats],
    arm: Floats,
) -> None:
    """Of ``(left x right) . f``; arm (6, 3) is scratch."""
    guide = t.guide_vertex[j]
    if guide < 0:
        return
    f = force[:3]
    a, b, w, u, m, g = arm[0], arm[1], arm[2], arm[3], arm[4], arm[5]
    K = C[0][e] if guide == t.child[e] else C[1][e]
    row = t.guide_row[j]
    material(yL, row, t.axis[j], a)
    material(yL, row, t.right[j], b)
    cross(b, f, u)
    material(y1, row, t.axis[j], w)
    cross(w, u, m)
    cross(f, a, u)
    material(y1, row, t.right[j], w)
    cross(w, u, g)
    for c in range(3):
        K[t.own[j], 3 + c] += weight * (m[c] + g[c])


@jit
def turn_curvature(
    t: Any,
    e: int,
    j: int,
    yL: Floats,
    y1: Floats,
    force: Floats,
    weight: float,
    C: tuple[Floats, Floats],
    arm: Floats,
) -> None:
    """Of ``a . ((x_target - x_centre) x f + m)``; arm (6, 3) is scratch."""
    v = t.child[e]
    o = t.own[j]
    f = force[:3]
    a, b, w, u, m, g = arm[0], arm[1], arm[2], arm[3], arm[4], arm[5]
    axis(t, j, yL, w)
    spot(yL, t.target_row[j], t.target_offset[j], a)
    spot(yL, t.centre_row[j], t.centre_offset[j], b)
    for c in range(3):
        a[c] -= b[c]
    cross(a, f, m)
    if t.kind[j] != SPHERE and t.framed[v]:
        for c in range(3):
            m[c] += force[3 + c]
    guide = t.guide_vertex[j]
    if t.kind[j] == AXIS and guide >= 0:
        K = C[0][e] if guide == v else C[1][e]
        axis(t, j, y1, u)
        cross(u, m, g)
        for c in range(3):
            K[o, 3 + c] += weight * g[c]
    cross(f, w, g)  # (arm' x f) . w = arm' . (f x w)
    spot_curvature(
        t.target_vertex[j], t.target_row[j], t.target_offset[j], e, t, y1, weight, C, o, arm
    )
    spot_curvature(
        t.centre_vertex[j], t.centre_row[j], t.centre_offset[j], e, t, y1, -weight, C, o, arm
    )


@jit
def spot_curvature(
    vertex: int,
    row: int,
    offset: Floats,
    e: int,
    t: Any,
    y1: Floats,
    weight: float,
    C: tuple[Floats, Floats],
    o: int,
    arm: Floats,
) -> None:
    """A spot's velocity times the last of `arm`, in the row of a coordinate."""
    if vertex < 0:
        return
    b, u, g = arm[1], arm[3], arm[5]
    K = C[0][e] if vertex == t.child[e] else C[1][e]
    for c in range(3):
        K[o, c] += weight * g[c]
    if offset[0] != 0 or offset[1] != 0 or offset[2] != 0:
        spot(y1, row, offset, b)
        for c in range(3):
            b[c] -= y1[row, c]
        cross(b, g, u)
        for c in range(3):
            K[o, 3 + c] += weight * u[c]
