"""Compiled loads that follow the motion: moments, forces fixed in bodies and sections.

Forces fixed in a body are components times its directors, so linear in y: ``f_a = C_ab y_b`` with
scalars C (4, 4) for a pair of frames. A moment m acts on directors as ``m x d^i / 2``, d^i the
reciprocal ones: at midpoints triads are not orthonormal. Both are taken at ``w.mid``.
"""

from __future__ import annotations

from typing import Any

from ..types import Floats
from .elements import scalar_block
from .jit import inlined, part
from .numbers import FORCE, SHARE
from .simd import copy
from .small import (
    Rotation,
    Vector,
    combine,
    cross,
    directors,
    dot,
    increase,
    minus,
    pulled,
    row,
    times,
    unit,
)


@inlined
def reciprocal(D: Rotation) -> Rotation:
    """Vectors with ``d^i . d_j = 1`` for i = j, else 0."""
    a, b, c = cross(D[1], D[2]), cross(D[2], D[0]), cross(D[0], D[1])
    factor = 1.0 / dot(D[0], a)
    return times(factor, a), times(factor, b), times(factor, c)


@inlined
def moment_on(s: Any, w: Any, k: int) -> tuple[Vector, Rotation, Rotation]:
    """Components of the k-th moment if it follows, else zero; forces on directors; d^i."""
    D = directors(w.mid, s.row[s.moment_vertex[k]])
    E = reciprocal(D)
    own, moment = (0.0, 0.0, 0.0), row(w.moments, k)
    if s.moment_follows[k]:
        own = moment
        moment = combine(moment, D)
    moment = times(0.5, moment)
    return own, (cross(moment, E[0]), cross(moment, E[1]), cross(moment, E[2])), E


@inlined
def moment_change(own: Vector, f: Rotation, E: Rotation, change: Rotation, i: int) -> Vector:
    """Change of the force on director i by that of all three: ``d(d^i) = -(d^i . d(d_j)) d^j``."""
    by = dot(E[i], change[0]), dot(E[i], change[1]), dot(E[i], change[2])
    return minus(times(0.5, cross(combine(own, change), E[i])), combine(by, f))


@inlined
def load_force(s: Any, w: Any) -> None:
    """All loads: the dead ones, and those that follow the motion."""
    external, mid, pairs, C = w.external, w.mid, s.follower, w.followers
    copy(w.dead, external)
    for k in range(len(pairs)):
        for i in range(4):
            for j in range(4):
                if C[k, i, j] != 0.0:  # points have one row only
                    for c in range(3):
                        external[pairs[k, 0] + i, c] += C[k, i, j] * mid[pairs[k, 1] + j, c]
    for k in range(len(s.moment_vertex)):
        _, f, _ = moment_on(s, w, k)
        for i in range(3):
            increase(external, s.row[s.moment_vertex[k]] + 1 + i, f[i])


@part
def load(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Loads at ``w.mid``; flag 1: their tangent ``-share force P(y_L)^T df/dy P(y_1)``."""
    if flag == 0:
        load_force(s, w)
        return 0.0
    A, pairs, followers = w.A, s.follower, w.followers
    factor = -numbers[SHARE] * numbers[FORCE]
    yL, yR = pulled(w.y0, w.mid, numbers), w.y1
    for k in range(len(pairs)):
        scalar_block(followers, k, factor, yL, pairs[k, 0], yR, pairs[k, 1], A, pairs[k, 2])
    for k in range(len(s.moment_vertex)):
        v = s.moment_vertex[k]
        own, f, E = moment_on(s, w, k)
        D, B = directors(yR, s.row[v]), directors(yL, s.row[v])
        for c in range(3):
            turn = unit(c, 1.0)
            change = cross(turn, D[0]), cross(turn, D[1]), cross(turn, D[2])
            for i in range(3):
                torque = cross(B[i], moment_change(own, f, E, change, i))
                for r in range(3):
                    A[m.diag[v], 3 + r, 3 + c] += factor * torque[r]
    return 0.0
