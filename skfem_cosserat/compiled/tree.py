"""Compiled nodal reparametrisation and null space of a tree of joints, one edge after the other.

The twist of a child is ``X t_parent + S nu``, nu its joint's own coordinates: so a chain of any
length costs as much as its joints, where the columns of one matrix T would grow with the depth. See
:mod:`skfem_cosserat.model.tree` for what the coordinates are, and :mod:`.layout` for the arrays.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..types import Floats, IndexArray
from .jit import jit
from .small import (
    clear,
    compose,
    copy,
    cross,
    dot,
    put_cross,
    quaternion,
    rotation,
)

__all__ = [
    "AXIS",
    "ROTATION",
    "SLIDE",
    "SPHERE",
    "add",
    "axis",
    "begin",
    "configuration",
    "maps",
    "maps_right",
    "material",
    "nodal_curvature",
    "rates",
    "reduce_force",
    "reset",
    "spot",
    "twist_force",
]

#: kinds of coordinates: absolute rotation, hinge, point on a sphere, slide
ROTATION, AXIS, SPHERE, SLIDE = 1, 2, 3, 4


@jit
def rotated(R: Floats, r: int, y0: Floats, y1: Floats) -> None:
    """Directors of the frame at row r: R d."""
    for i in range(1, 4):
        for c in range(3):
            y1[r + i, c] = R[c, 0] * y0[r + i, 0] + R[c, 1] * y0[r + i, 1] + R[c, 2] * y0[r + i, 2]


@jit
def spot(y: Floats, row: int, offset: Floats, out: Floats) -> None:
    """Position of a material point."""
    for c in range(3):
        out[c] = y[row, c]
        if offset[0] != 0 or offset[1] != 0 or offset[2] != 0:
            out[c] += (
                offset[0] * y[row + 1, c] + offset[1] * y[row + 2, c] + offset[2] * y[row + 3, c]
            )


@jit
def material(y: Floats, row: int, a: Floats, out: Floats) -> None:
    """Vector with components a in the frame at row."""
    for c in range(3):
        out[c] = a[0] * y[row + 1, c] + a[1] * y[row + 2, c] + a[2] * y[row + 3, c]


@jit
def begin(t: Any, w: Any, again: bool) -> None:
    """Start of a step: axes, arms and slides; the increments of the last step or none."""
    y0 = w.y0
    left, right, a, b = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for j in range(len(t.kind)):
        if t.kind[j] == AXIS:
            material(y0, t.guide_row[j], t.axis[j], t.axis0[j])
        elif t.kind[j] == SLIDE:
            material(y0, t.guide_row[j], t.axis[j], left)
            material(y0, t.guide_row[j], t.right[j], right)
            cross(left, right, t.axis0[j])
    for e in range(len(t.child)):
        spot(y0, t.parent_row[e], t.parent_offset[e], a)
        spot(y0, t.child_row[e], t.child_offset[e], b)
        for c in range(3):
            t.arm0[e, c] = b[c] - a[c]
    reset(t)
    copy(w.last, w.total)
    if again:
        add(t, w.last)
    else:
        clear(w.total)


@jit
def reset(t: Any) -> None:
    """Zero increments; driven coordinates at their end."""
    for v in range(len(t.shift)):
        for c in range(3):
            t.shift[v, c] = 0.0
            t.turn[v, 1 + c] = 0.0
        t.turn[v, 0] = 1.0
    for e in range(len(t.swing)):
        for c in range(3):
            t.swing[e, 1 + c] = 0.0
        t.swing[e, 0] = 1.0
    for j in range(len(t.value)):
        t.value[j] = t.driven[j]


@jit
def add(t: Any, x: Floats) -> None:
    """Compose with increments x (nv, 6) of the vertices' own coordinates."""
    q, theta = np.empty(4), np.empty(3)
    for k in range(len(t.free)):
        v = t.free[k]
        for c in range(3):
            t.shift[v, c] += x[v, c]
        if t.framed[v]:
            quaternion(x[v, 3:], q)
            compose(q, t.turn[v], t.turn[v])
    for e in range(len(t.child)):
        v = t.child[e]
        kind = 0
        for c in range(3):
            theta[c] = 0.0
        for j in range(t.first[e], t.first[e + 1]):
            o = t.own[j]
            if o < 0:
                continue
            if t.kind[j] == AXIS or t.kind[j] == SLIDE:
                t.value[j] += x[v, o]
                continue
            kind = t.kind[j]
            for c in range(3):
                theta[c] += x[v, o] * t.axis[j, c]
            if kind == SPHERE and j + 1 < t.first[e + 1] and t.kind[j + 1] == ROTATION:
                # a point on a sphere whose body turns as well: one after the other
                quaternion(theta, q)
                compose(q, t.swing[e], t.swing[e])
                for c in range(3):
                    theta[c] = 0.0
        if kind == ROTATION:
            quaternion(theta, q)
            compose(q, t.turn[v], t.turn[v])
        elif kind == SPHERE:
            quaternion(theta, q)
            compose(q, t.swing[e], t.swing[e])


@jit
def configuration(t: Any, w: Any) -> None:
    """All rows of y_1."""
    y0, y1, ground1 = w.y0, w.y1, w.ground1
    rows = len(y0) - len(ground1)
    for r in range(len(ground1)):
        for c in range(3):
            y1[rows + r, c] = ground1[r, c]
    for k in range(len(t.free)):
        v = t.free[k]
        r = t.row[v]
        for c in range(3):
            y1[r, c] = y0[r, c] + t.shift[v, c]
        if t.framed[v]:
            rotation(t.turn[v], t.R[v])
            rotated(t.R[v], r, y0, y1)
    if len(t.child) == 0:
        return
    nv = len(t.row)
    for g in range(len(ground1) // 4):
        r = rows + 4 * g
        for a in range(3):
            for b in range(3):
                s = y1[r + 1, a] * y0[r + 1, b]
                t.R[nv + g, a, b] = s + y1[r + 2, a] * y0[r + 2, b] + y1[r + 3, a] * y0[r + 3, b]
    H, T, q = np.empty((3, 3)), np.empty((3, 3)), np.empty(4)
    arm = np.empty(3)
    for e in range(len(t.child)):
        v = t.child[e]
        if t.framed[v]:
            turn_child(t, e, H, T, q, arm)
            rotated(t.R[v], t.child_row[e], y0, y1)
        place_child(t, e, H, arm, y1)


@jit
def turn_child(t: Any, e: int, H: Floats, T: Floats, q: Floats, theta: Floats) -> None:
    """Rotation of a child since the start of the step; the others are scratch."""
    R = t.R[t.child[e]]
    if not t.relative[e]:
        rotation(t.turn[t.child[e]], R)
        return
    copy(t.R[t.parent_frame[e]], R)
    for j in range(t.first[e], t.first[e + 1]):
        if t.kind[j] == AXIS:
            for c in range(3):
                theta[c] = t.value[j] * t.axis0[j, c]
            quaternion(theta, q)
            rotation(q, H)
            for a in range(3):
                for b in range(3):
                    T[a, b] = R[a, 0] * H[0, b] + R[a, 1] * H[1, b] + R[a, 2] * H[2, b]
            copy(T, R)


@jit
def place_child(t: Any, e: int, H: Floats, arm: Floats, y1: Floats) -> None:
    """Position of a child whose directors and whose parent are in place; H, arm are scratch."""
    r = t.child_row[e]
    p = t.parent_row[e]
    spot(y1, p, t.parent_offset[e], arm)
    for c in range(3):
        y1[r, c] = 0.0
        H[0, c] = arm[c]
    spot(y1, r, t.child_offset[e], arm)
    for c in range(3):
        y1[r, c] = H[0, c] - arm[c]
    if t.sphere[e]:
        rotation(t.swing[e], H)
        for c in range(3):
            y1[r, c] += dot(H[c], t.arm0[e])
    if t.open[e]:
        for c in range(3):
            arm[c] = t.arm0[e, c]
        for j in range(t.first[e], t.first[e + 1]):
            if t.kind[j] == SLIDE:
                for c in range(3):
                    arm[c] += t.value[j] * t.axis0[j, c]
        G = t.R[t.guide_frame[e]]
        for c in range(3):
            y1[r, c] += dot(G[c], arm)


@jit
def maps(t: Any, y: Floats, S: Floats, X: Floats) -> None:
    """S (ne, 6, 6) and X (ne, 6, 6): a child's twist is X t_parent + S nu."""
    a, b, u, w = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for e in range(len(t.child)):
        clear(S[e])
        for j in range(t.first[e], t.first[e + 1]):
            o = t.own[j]
            if o < 0:
                continue
            if t.kind[j] == SLIDE:
                material(y, t.guide_row[j], t.axis[j], a)
                material(y, t.guide_row[j], t.right[j], b)
                cross(a, b, u)
                for c in range(3):
                    S[e, c, o] = u[c]
                continue
            axis(t, j, y, w)
            spot(y, t.target_row[j], t.target_offset[j], a)
            spot(y, t.centre_row[j], t.centre_offset[j], b)
            for c in range(3):
                a[c] -= b[c]
            cross(w, a, u)
            for c in range(3):
                S[e, c, o] = u[c]
                if t.kind[j] != SPHERE and t.framed[t.child[e]]:
                    S[e, 3 + c, o] = w[c]
        if t.parent[e] >= 0:
            parent_map(t, e, y, X[e], a)


@jit
def parent_map(t: Any, e: int, y: Floats, X: Floats, r: Floats) -> None:
    """How a child moves with its parent: ``v - r^ omega``, and omega if it is passed on."""
    clear(X)
    for c in range(3):
        X[c, c] = 1.0
    if not t.framed[t.parent[e]]:
        return
    spot(y, t.fulcrum_row[e], t.fulcrum_offset[e], r)
    for c in range(3):
        r[c] -= y[t.parent_row[e], c]
    put_cross(X, 0, 3, -1.0, r)
    if t.relative[e]:
        for c in range(3):
            X[3 + c, 3 + c] = 1.0


@jit
def maps_right(t: Any, w: Any) -> None:
    """The maps where the unknowns move."""
    maps(t, w.y1, w.S_right, w.X_right)


@jit
def axis(t: Any, j: int, y: Floats, out: Floats) -> None:
    """Axis of a coordinate at y."""
    if t.kind[j] == AXIS:
        material(y, t.guide_row[j], t.axis[j], out)
    else:
        for c in range(3):
            out[c] = t.axis[j, c]


@jit
def twist_force(t: Any, y: Floats, R: Floats, F: Floats) -> None:
    """P_int(y)^T R (nv, 6)."""
    for v in range(len(t.row)):
        r = t.row[v]
        for c in range(3):
            F[v, c] = R[r, c]
            F[v, 3 + c] = 0.0
        if t.framed[v]:
            for i in range(1, 4):
                d = y[r + i]
                f = R[r + i]
                F[v, 3] += d[1] * f[2] - d[2] * f[1]
                F[v, 4] += d[2] * f[0] - d[0] * f[2]
                F[v, 5] += d[0] * f[1] - d[1] * f[0]


@jit
def reduce_force(t: Any, S: Floats, X: Floats, F: Floats, b: Floats) -> None:
    """T^T F by vertices: F becomes what the subtrees add up to, b (nv, 6) the residual."""
    copy(F, b)
    for e in range(len(t.child) - 1, -1, -1):
        v = t.child[e]
        for o in range(6):
            s = 0.0
            for c in range(6):
                s += S[e, c, o] * F[v, c]
            b[v, o] = s
        p = t.parent[e]
        if p >= 0:
            for o in range(6):
                s = 0.0
                for c in range(6):
                    s += X[e, c, o] * F[v, c]
                F[p, o] += s
                b[p, o] = F[p, o]


@jit
def rates(t: Any, y: Floats, twist: Floats, change: Floats) -> None:
    """P_int(y) t, rows of y."""
    for v in range(len(t.row)):
        r = t.row[v]
        for c in range(3):
            change[r, c] = twist[v, c]
        if t.framed[v]:
            w = twist[v, 3:]
            for i in range(1, 4):
                change[r + i, 0] = w[1] * y[r + i, 2] - w[2] * y[r + i, 1]
                change[r + i, 1] = w[2] * y[r + i, 0] - w[0] * y[r + i, 2]
                change[r + i, 2] = w[0] * y[r + i, 1] - w[1] * y[r + i, 0]


@jit
def nodal_curvature(
    t: Any, y1: Floats, R: Floats, weight: float, A: Floats, diag: IndexArray
) -> None:
    """Add ``weight d(P_int^T R)`` to the diagonal blocks."""
    for v in range(len(t.row)):
        if not t.framed[v]:
            continue
        r = t.row[v]
        K = A[diag[v]]
        trace = 0.0
        for i in range(1, 4):
            trace += dot(y1[r + i], R[r + i])
        for a in range(3):
            for b in range(3):
                K[3 + a, 3 + b] += weight * (
                    y1[r + 1, a] * R[r + 1, b]
                    + y1[r + 2, a] * R[r + 2, b]
                    + y1[r + 3, a] * R[r + 3, b]
                )
            K[3 + a, 3 + a] -= weight * trace
