"""Compiled elements whose lines follow from their directors: edges of the tree, as joints are.

Of a linear element that holds its shear strains ``phi' = D^-1 Gamma``, rows of D the directors in
its middle: so the child's position is that of the parent and an arm that depends on the rotations
of both, and its twist ``X t_parent + S nu`` as that of any joint's child. A chain of any length
costs as much as its elements, where the columns of one matrix T would grow with the depth. See
:mod:`skfem_cosserat.model.kinematics` for the theory. Parts take ``(s, m, w, numbers, flag)`` as
those of :mod:`.tree`.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..types import Floats
from .elements import scalar_block
from .jit import inlined, part
from .numbers import WEIGHT
from .small import (
    Rotation,
    Vector,
    combine,
    cross,
    directors,
    dot,
    increase,
    minus,
    plus,
    put,
    row,
    times,
)

__all__ = ["span_arm", "span_curvature", "span_maps", "span_stretch"]


@inlined
def section(s: Any, k: int, side: int, D: Rotation) -> Rotation:
    """Directors of the section at a node, from those of the node."""
    if not s.span_turned[k]:
        return D
    Q = s.span_rotation
    return (
        combine((Q[k, side, 0, 0], Q[k, side, 0, 1], Q[k, side, 0, 2]), D),
        combine((Q[k, side, 1, 0], Q[k, side, 1, 1], Q[k, side, 1, 2]), D),
        combine((Q[k, side, 2, 0], Q[k, side, 2, 1], Q[k, side, 2, 2]), D),
    )


@inlined
def sections(s: Any, e: int, y: Floats) -> tuple[Rotation, Rotation]:
    """Directors of the section at the parent and at the child."""
    k = s.span[e]
    a = section(s, k, 0, directors(y, s.parent_row[e]))
    return a, section(s, k, 1, directors(y, s.child_row[e]))


@inlined
def middle(a: Rotation, b: Rotation) -> Rotation:
    """Interpolated to the Gauss point of a linear element."""
    return (
        times(0.5, plus(a[0], b[0])),
        times(0.5, plus(a[1], b[1])),
        times(0.5, plus(a[2], b[2])),
    )


@inlined
def inverse(D: Rotation) -> Rotation:
    """Columns of ``D^-1``, rows of D the directors."""
    u = cross(D[1], D[2])
    f = 1.0 / dot(D[0], u)
    return times(f, u), times(f, cross(D[2], D[0])), times(f, cross(D[0], D[1]))


@inlined
def slope(s: Any, e: int, y: Floats) -> Vector:
    """``phi'``."""
    f = 1.0 / s.span_length[s.span[e]]
    return times(f, minus(row(y, s.child_row[e]), row(y, s.parent_row[e])))


@inlined
def span_stretch(s: Any, e: int, y: Floats) -> float:
    """Axial strain."""
    a, b = sections(s, e, y)
    return dot(middle(a, b)[2], slope(s, e, y)) - s.span_strain[s.span[e], 2]


@inlined
def span_arm(s: Any, e: int, y: Floats, stretched: float) -> Vector:
    """From parent to child, whose directors are in place, with this axial strain."""
    k = s.span[e]
    a, b = sections(s, e, y)
    strain = plus(row(s.span_strain, k), (0.0, 0.0, stretched))
    return times(s.span_length[k], combine(strain, inverse(middle(a, b))))


@inlined
def by_turns(length: float, C: Rotation, d: Rotation, phi: Vector) -> Rotation:
    """Rows of what an angular velocity of a node with directors d is multiplied with in the arm's.

    C are the columns of ``D^-1``.
    """
    t = cross(d[0], phi), cross(d[1], phi), cross(d[2], phi)
    f = -0.5 * length
    return (
        times(f, combine((C[0][0], C[1][0], C[2][0]), t)),
        times(f, combine((C[0][1], C[1][1], C[2][1]), t)),
        times(f, combine((C[0][2], C[1][2], C[2][2]), t)),
    )


@inlined
def span_maps(s: Any, e: int, y: Floats, S: Floats, X: Floats, kinds: Any, stretches: int) -> None:
    """S and X of a child, in place of zeros but for the identity of X's velocities."""
    length, own, first = s.span_length[s.span[e]], s.own, s.first
    a, b = sections(s, e, y)
    C, phi = inverse(middle(a, b)), slope(s, e, y)
    E = by_turns(length, C, a, phi)
    for c in range(3):
        X[e, 0, 3 + c] = E[0][c]
        X[e, 1, 3 + c] = E[1][c]
        X[e, 2, 3 + c] = E[2][c]
    E = by_turns(length, C, b, phi)
    for j in range(first[e], first[e + 1]):
        o = own[j]
        v, turn = times(length, C[2]), (0.0, 0.0, 0.0)
        if kinds[j] != stretches:
            turn = row(s.axis, j)
            v = dot(E[0], turn), dot(E[1], turn), dot(E[2], turn)
        for r in range(3):
            S[e, r, o] = v[r]
            S[e, 3 + r, o] = turn[r]


@part
def span_curvature(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Derivative of the maps at the midpoint for fixed forces: as geometric stiffness.

    ``P^T G^T mu = 0`` for any mu, wherever P is. With those mu that carry what acts beyond an
    element no force is left there that the derivative of its map would be multiplied with. Takes
    ``w.F`` (flag 1: with the predicted stresses), leaves the balance without them in ``w.R_mixed``.
    """
    F, R, weight = w.F, w.R_mixed, numbers[WEIGHT]
    if flag == 1:
        F = w.F_mixed
    else:
        for r in range(R.shape[0]):
            put(R, r, row(w.R, r))
    V, C = np.empty((3, 3)), np.zeros((2, 2, 4, 4))
    L, T = np.empty((2, 4, 3)), np.empty((2, 4, 3))
    mid, y1, A, slot, spans, child = w.mid, w.y1, w.A, s.span_slot, s.span, s.child
    for e in range(len(child)):
        k = spans[e]
        if k < 0:
            continue
        length = s.span_length[k]
        a, b = sections(s, e, mid)
        D, phi = middle(a, b), slope(s, e, mid)
        n = times(length, row(F, child[e]))
        columns = inverse(D)
        mu = dot(columns[0], n), dot(columns[1], n), dot(columns[2], n)
        # the forces G^T mu taken off, those on directors turned back to the nodes'
        line = times(1.0 / length, combine(mu, D))
        increase(R, s.parent_row[e], line)
        increase(R, s.child_row[e], times(-1.0, line))
        take_off(s, k, 0, mu, phi, R, s.parent_row[e])
        take_off(s, k, 1, mu, phi, R, s.child_row[e])
        for i in range(3):
            f = -0.5 * weight * mu[i] / length
            for c in range(2):
                for d in range(2):
                    C[c, d, 0, 1 + i] = f if c == 1 else -f
                    C[c, d, 1 + i, 0] = f if d == 1 else -f
        fill(L, 0, row(mid, s.parent_row[e]), a)
        fill(L, 1, row(mid, s.child_row[e]), b)
        a, b = sections(s, e, y1)
        fill(T, 0, row(y1, s.parent_row[e]), a)
        fill(T, 1, row(y1, s.child_row[e]), b)
        for c in range(2):
            for d in range(2):
                scalar_block(C, c, d, L, T, A, slot[k, c, d], V)
    return 0.0


@inlined
def fill(X: Floats, a: int, x: Vector, D: Rotation) -> None:
    """Position and directors of a node."""
    put3(X, a, 0, x)
    put3(X, a, 1, D[0])
    put3(X, a, 2, D[1])
    put3(X, a, 3, D[2])


@inlined
def put3(X: Floats, a: int, i: int, v: Vector) -> None:
    """``X_ai = v``."""
    X[a, i, 0] = v[0]
    X[a, i, 1] = v[1]
    X[a, i, 2] = v[2]


@inlined
def take_off(s: Any, k: int, side: int, mu: Vector, phi: Vector, R: Floats, r: int) -> None:
    """Forces of mu on the directors of a node, whose first row is r, off R."""
    Q = s.span_rotation
    for j in range(3):
        f = 0.0
        for i in range(3):
            f += mu[i] * Q[k, side, i, j]
        increase(R, r + 1 + j, times(-0.5 * f, phi))
