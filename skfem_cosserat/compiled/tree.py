"""The tree of joints in kernels: coordinates, twists, reduction, and curvature of the joints."""

from __future__ import annotations

import math
from typing import Any

from ..types import Floats, IndexArray
from .jit import inlined, part
from .numbers import WEIGHT
from .simd import add_product, clear, put_product
from .small import (
    Rotation,
    Vector,
    add_skew,
    column,
    combine,
    compose,
    cross,
    directors,
    dot,
    minus,
    plus,
    pulled,
    put,
    put_matrix,
    quaternion,
    rotation,
    rotation_of,
    row,
    times,
    turned,
)
from .tables import ABSOLUTE, AXIS, SLIDE, SPHERE

# --------------------------------------------------------------------------------------------------
# Compiled nodal reparametrisation and null space of a tree of joints, one edge after the other.
#
# The twist of a child is ``X t_parent + S nu``, nu its joint's own coordinates: so a chain of any
# length costs as much as its joints, where the columns of one matrix T would grow with the depth.
# See :mod:`skfem_cosserat.model.tree` for what the coordinates are, and :mod:`.structures` for the
# arrays. Parts take ``(s, m, w, numbers, flag)``: s the tree, m the plan of the elimination, w the
# work.


@inlined
def spot(y: Floats, r: int, offset: Vector) -> Vector:
    """Position of a material point."""
    x = row(y, r)
    if offset[0] != 0 or offset[1] != 0 or offset[2] != 0:
        x = plus(x, combine(offset, directors(y, r)))
    return x


@inlined
def axis(s: Any, j: int, y: Floats) -> Vector:
    """Axis of a coordinate at y."""
    a = row(s.axis, j)
    if s.kind[j] == AXIS:
        a = combine(a, directors(y, s.guide_row[j]))
    return a


@inlined
def slide(s: Any, j: int, y: Floats) -> tuple[Vector, Vector]:
    """Both vectors whose product is the direction of a slide, at y."""
    d = directors(y, s.guide_row[j])
    return combine(row(s.axis, j), d), combine(row(s.right, j), d)


@inlined
def prescribe(drives: IndexArray, y0: Floats, ground1: Floats, value: Floats) -> None:
    """Values of driven coordinates, with the ground at the end of the step.

    Of each `drives` has its number, whether it is a displacement, and the rows of y_0 and of the
    ground at the end that carry its number in time as ``(cos, sin, number)``.
    """
    for k in range(len(drives)):
        a, b = row(y0, drives[k, 2]), row(ground1, drives[k, 3])
        if drives[k, 1]:
            value[drives[k, 0]] = b[2] - a[2]
        else:
            sine, cosine = a[0] * b[1] - a[1] * b[0], a[0] * b[0] + a[1] * b[1]
            value[drives[k, 0]] = math.atan2(sine, cosine)


@inlined
def across(axis: Floats, j: int, a: Vector) -> None:
    """Two axes normal to a and to each other, as :func:`skfem_cosserat.relative.normals` does."""
    a = times(1.0 / math.sqrt(dot(a, a)), a)
    x, y, z = abs(a[0]), abs(a[1]), abs(a[2])
    if x <= y and x <= z:
        first = 0.0, a[2], -a[1]
    elif y <= z:
        first = -a[2], 0.0, a[0]
    else:
        first = a[1], -a[0], 0.0
    first = times(1.0 / math.sqrt(dot(first, first)), first)
    put(axis, j, first)
    put(axis, j + 1, cross(a, first))


@part
def joint_begin(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Start of a step: axes, arms and slides; zero increments."""
    y0, axis0, arm0, swing, value = w.y0, s.axis0, s.arm0, s.swing, s.value
    for j in range(len(value)):
        value[j] = 0.0
        if s.kind[j] == AXIS:
            put(axis0, j, axis(s, j, y0))
        elif s.kind[j] == SLIDE:
            left, right = slide(s, j, y0)
            put(axis0, j, cross(left, right))
    for e in range(len(swing)):
        swing[e, 0] = 1.0
        for c in range(3):
            swing[e, 1 + c] = 0.0
        a = spot(y0, s.parent_row[e], row(s.parent_offset, e))
        put(arm0, e, minus(spot(y0, s.child_row[e], row(s.child_offset, e)), a))
        apart = True
        for j in range(s.first[e], s.first[e + 1]):
            if s.kind[j] == SPHERE and apart:  # the first one of two
                across(s.axis, j, row(arm0, e))
                apart = False
    return 0.0


@part
def joint_add(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Compose with increments x (nv, 6) of the children's own coordinates."""
    x, value, turn, swing = w.x, s.value, s.turn, s.swing
    first, kinds, own, child = s.first, s.kind, s.own, s.child
    for e in range(len(child)):
        v = child[e]
        kind = 0
        theta = (0.0, 0.0, 0.0)
        for j in range(first[e], first[e + 1]):
            o = own[j]
            if o < 0:
                continue
            if kinds[j] == AXIS or kinds[j] == SLIDE:
                value[j] += x[v, o]
                continue
            if kind == SPHERE and kinds[j] == ABSOLUTE:
                # a point on a sphere whose body turns as well: one after the other
                compose(theta, swing, e)
                theta = (0.0, 0.0, 0.0)
            kind = kinds[j]
            theta = plus(theta, times(x[v, o], row(s.axis, j)))
        if kind == ABSOLUTE:
            compose(theta, turn, v)
        elif kind == SPHERE:
            compose(theta, swing, e)
    return 0.0


@inlined
def columns(R: Floats, v: int) -> Rotation:
    """Columns of the rotation ``R_v``."""
    return (
        (R[v, 0, 0], R[v, 1, 0], R[v, 2, 0]),
        (R[v, 0, 1], R[v, 1, 1], R[v, 2, 1]),
        (R[v, 0, 2], R[v, 1, 2], R[v, 2, 2]),
    )


@part
def joint_move(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Rows of y_1 of all children, behind those of free vertices and the ground."""
    y0, y1, rotations, turn = w.y0, w.y1, s.R, s.turn
    child, framed, first, kinds, value = s.child, s.framed, s.first, s.kind, s.value
    nv = len(s.row)
    rows = w.p0.shape[0]
    prescribe(s.drives, y0, w.ground1, value)
    for g in range((y1.shape[0] - rows) // 4):
        r = rows + 4 * g
        for a in range(3):
            for b in range(3):
                t = y1[r + 1, a] * y0[r + 1, b] + y1[r + 2, a] * y0[r + 2, b]
                rotations[nv + g, a, b] = t + y1[r + 3, a] * y0[r + 3, b]
    for e in range(len(child)):
        v = child[e]
        r = s.child_row[e]
        if framed[v]:
            if s.relative[e]:
                C = columns(rotations, s.parent_frame[e])
                for j in range(first[e], first[e + 1]):
                    if kinds[j] == AXIS:
                        q = quaternion(times(value[j], row(s.axis0, j)))
                        H = rotation(q[0], q[1], q[2], q[3])
                        # columns of R H: those of H, turned by R
                        C = (
                            combine(column(H, 0), C),
                            combine(column(H, 1), C),
                            combine(column(H, 2), C),
                        )
                put_matrix(rotations, v, (column(C, 0), column(C, 1), column(C, 2)))
            else:
                put_matrix(rotations, v, rotation_of(turn, v))
            C = columns(rotations, v)
            for i in range(1, 4):
                put(y1, r + i, combine(row(y0, r + i), C))
        place_child(s, e, y1)
    return 0.0


@inlined
def place_child(s: Any, e: int, y1: Floats) -> None:
    """Position of a child whose directors and whose parent are in place."""
    r = s.child_row[e]
    x = spot(y1, s.parent_row[e], row(s.parent_offset, e))
    put(y1, r, (0.0, 0.0, 0.0))
    x = minus(x, spot(y1, r, row(s.child_offset, e)))
    if s.sphere[e]:
        x = plus(x, turned(rotation_of(s.swing, e), row(s.arm0, e)))
    if s.open[e]:
        arm = row(s.arm0, e)
        for j in range(s.first[e], s.first[e + 1]):
            if s.kind[j] == SLIDE:
                arm = plus(arm, times(s.value[j], row(s.axis0, j)))
        x = plus(x, combine(arm, columns(s.R, s.guide_frame[e])))
    put(y1, r, x)


@part
def joint_maps(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """S and X (ne, 6, 6) of all edges: flag 0 where P^T is taken, 1 where the unknowns move.

    A child's twist is X t_parent + S nu.
    """
    y, S, X = pulled(w.y0, w.mid, numbers), w.S_left, w.X_left
    if flag == 1:
        y, S, X = w.y1, w.S_right, w.X_right
    child, parent, framed, first, kinds, own = s.child, s.parent, s.framed, s.first, s.kind, s.own
    clear(S)
    clear(X)
    for e in range(len(child)):
        for r in range(3):
            X[e, r, r] = 1.0
        for j in range(first[e], first[e + 1]):
            o = own[j]
            if o < 0:
                continue
            if kinds[j] == SLIDE:
                left, right = slide(s, j, y)
                u = cross(left, right)
                a = (0.0, 0.0, 0.0)
            else:
                a = axis(s, j, y)
                arm = minus(
                    spot(y, s.target_row[j], row(s.target_offset, j)),
                    spot(y, s.centre_row[j], row(s.centre_offset, j)),
                )
                u = cross(a, arm)
                if kinds[j] == SPHERE or not framed[child[e]]:
                    a = (0.0, 0.0, 0.0)
            for c in range(3):
                S[e, c, o] = u[c]
                S[e, 3 + c, o] = a[c]
        p = parent[e]
        if p >= 0 and framed[p]:
            # a child moves with its parent as v - r^ omega, and omega if it is passed on
            f = spot(y, s.fulcrum_row[e], row(s.fulcrum_offset, e))
            add_skew(X, e, 0, 3, minus(row(y, s.parent_row[e]), f))
            if s.relative[e]:
                for c in range(3):
                    X[e, 3 + c, 3 + c] = 1.0
    return 0.0


@part
def joint_reduce(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """T^T F by vertices: F becomes what the subtrees add up to, b (nv, 6) the residual.

    Flag 1: of forces with the predicted stresses.
    """
    S, X, child, parent, F, b = w.S_left, w.X_left, s.child, s.parent, w.F, w.b
    if flag == 1:
        F, b = w.F_mixed, w.x
    for e in range(len(child) - 1, -1, -1):
        v = child[e]
        p = parent[e]
        put_product(S, e, F, v, 1.0, b, v)
        if p >= 0:
            add_product(X, e, F, v, 1.0, F, p)
            for o in range(b.shape[1]):
                b[p, o] = F[p, o]
    return 0.0


# -- compiled derivatives of a tree's maps, for schemes that take them at midpoints ----------------


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
    clear(C_child)
    clear(C_parent)
    for e in range(len(s.child)):
        v = s.child[e]
        p = s.parent[e]
        f = times(weight, row(F, v))
        moment = times(weight, (F[v, 3], F[v, 4], F[v, 5]))
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
    """Derivative of the moment ``(x_fulcrum - phi_p) x f`` on a parent, added to the matrix A."""
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
    """Derivative of ``(left x right) . f`` by the twist of the child or the parent."""
    guide = s.guide_vertex[j]
    if guide < 0:
        return
    left, right = slide(s, j, yL)
    left1, right1 = slide(s, j, y1)
    g = plus(cross(left1, cross(right, f)), cross(right1, cross(f, left)))
    add_row(C_child if guide == s.child[e] else C_parent, e, s.own[j], 3, g)


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
    """Derivative of ``a . ((x_target - x_centre) x f + m)`` by twists of child and parent."""
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
        add_row(C_child if guide == v else C_parent, e, o, 3, g)
    g = cross(f, a)  # (arm' x f) . a = arm' . (f x a)
    for k in range(2):
        vertex, r, offset = s.target_vertex[j], s.target_row[j], target
        if k == 1:
            vertex, r, offset = s.centre_vertex[j], s.centre_row[j], centre
            g = times(-1.0, g)
        if vertex < 0:
            continue
        moved = combine(offset, directors(y1, r)) if s.framed[vertex] else (0.0, 0.0, 0.0)
        C = C_child if vertex == v else C_parent
        add_row(C, e, o, 0, g)
        add_row(C, e, o, 3, cross(moved, g))
