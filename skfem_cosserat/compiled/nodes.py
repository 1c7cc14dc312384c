"""Compiled parts of vertices: configuration, balance, masses, geometric terms of single frames.

Parts take ``(s, m, w, numbers, flag)`` as those of :mod:`.tree`.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..types import Floats
from . import simd
from .elements import scalar_block
from .jit import inlined, part
from .numbers import (
    CARRY_FORCE,
    CARRY_MASS,
    CARRY_MOMENTUM,
    ENDS,
    FORCE,
    LENGTH,
    MASS,
    MIXED,
    MOMENTUM,
    ROTATION,
    SHARE,
    WEIGHT,
)
from .simd import WIDTH, add_rows, put_rows, rows
from .small import (
    block,
    chosen,
    column,
    combination,
    combine,
    composed,
    counted,
    cross,
    dot,
    frames,
    mass_times,
    plus,
    pulled,
    put,
    put_frames,
    put_matrix,
    quaternions,
    rotation,
    rotation_of,
    row,
    times,
    turned,
)


@part
def begin(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Zero increments; x are those to start with: flag 0 none, 1 the last, 2 extrapolated twice."""
    x, total, last, before = w.x, w.total, w.last, w.before
    for v in range(x.shape[0]):
        for c in range(x.shape[1]):
            start = 0.0
            if flag == 1:
                start = last[v, c]
            elif flag == 2:
                start = 2.0 * last[v, c] - before[v, c]
            x[v, c] = start
            total[v, c] = 0.0
    turn = s.turn
    for v in range(turn.shape[0]):
        turn[v, 0] = 1.0
        for c in range(1, 4):
            turn[v, c] = 0.0
    return 0.0


@part
def move(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Add up the increments x (nv, 6); the rows of y_1 of free vertices, and the ground's."""
    y0, y1, ground1, x, total, turn = w.y0, w.y1, w.ground1, w.x, w.total, s.turn
    free, framed, first, followed, rotations = s.free, s.framed, s.row, s.followed, s.R
    loose = s.loose
    behind, count = len(y0) - len(ground1), len(loose)
    for v in range(x.shape[0]):
        for c in range(6):
            total[v, c] += x[v, c]
    for r in range(len(ground1)):
        put(y1, behind + r, row(ground1, r))
    for k in range(0, count, WIDTH):
        vs = chosen(loose, block(k, count))
        own = chosen(first, vs)
        theta, shift, q = rows(x, vs, 6, 2), rows(total, vs, 6, 0), rows(turn, vs, 4, 0)
        q = composed(quaternions((theta[1], theta[2], theta[3])), q)
        R = rotation(q[0], q[1], q[2], q[3])
        put_rows(turn, vs, 4, 0, q)
        at, D = frames(y0, own)
        D = turned(R, D[0]), turned(R, D[1]), turned(R, D[2])
        put_frames(y1, own, plus(at, (shift[0], shift[1], shift[2])), D)
    for k in range(len(free)):
        v = free[k]
        if not framed[v]:
            put(y1, first[v], plus(row(y0, first[v]), row(total, v)))
        elif followed[v]:
            put_matrix(rotations, v, rotation_of(turn, v))
    return 0.0


@inlined
def twist_force(s: Any, y: Floats, R: Floats, F: Floats, b: Floats) -> None:
    """``F = b = P_int(y)^T R`` (nv, 6)."""
    first, framed, triads = s.row, s.framed, s.triads
    count = len(triads)
    for k in range(0, count, WIDTH):
        vs = chosen(triads, block(k, count))
        own = chosen(first, vs)
        D = frames(y, own)[1]
        f, G = frames(R, own)
        u = plus(cross(D[0], G[0]), plus(cross(D[1], G[1]), cross(D[2], G[2])))
        upper, lower = (f[0], f[1], f[2], u[0]), (f[2], u[0], u[1], u[2])
        put_rows(F, vs, 6, 0, upper)
        put_rows(F, vs, 6, 2, lower)
        put_rows(b, vs, 6, 0, upper)
        put_rows(b, vs, 6, 2, lower)
    if count == len(first):
        return
    for v in range(len(first)):
        if not framed[v]:
            for c in range(3):
                F[v, c] = R[first[v], c]
                F[v, 3 + c] = 0.0
                b[v, c] = R[first[v], c]
                b[v, 3 + c] = 0.0


@inlined
def step_balance(s: Any, w: Any, numbers: Floats, sized: bool) -> float:
    """R of the step without constraint forces; if asked, the largest of its terms."""
    R, inertia, p0, internal, external = w.R, w.momentum, w.p0, w.internal, w.external
    if len(w.flow.owner) == 0:  # else it is there, with the extra velocity
        combination(1.0, w.y1, -1.0, w.y0, R)
        mass_times(s, numbers[MASS], R, inertia)
    momentum, force = numbers[MOMENTUM], numbers[FORCE]
    for r in range(R.shape[0]):
        for c in range(3):
            f = force * (internal[r, c] - external[r, c])
            R[r, c] = inertia[r, c] - momentum * p0[r, c] + f
    if not sized:
        return 0.0
    # one term, as in the variational scheme's evaluation
    single, largest = numbers[ENDS] == 0.0 and numbers[SHARE] < 1.0, 0.0
    for r in range(R.shape[0]):
        for c in range(3):
            f, x = force * internal[r, c], force * external[r, c]
            if single:
                f, x = f - x, 0.0
            # only the last of these waits for the entries before
            here = max(abs(inertia[r, c]), abs(p0[r, c]), abs(f), abs(x))
            largest = max(largest, here)
    return largest


@part
def balance(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """R of the step and the forces on vertices; flag 2: gives the largest of its terms.

    Flag 1: R with the predicted stresses, whose internal force stands in its place.
    """
    force = numbers[FORCE]
    R, internal = w.R, w.internal
    left = pulled(w.y0, w.mid, numbers)
    if flag == 1:
        predicted = w.R_mixed
        for r in range(R.shape[0]):
            for c in range(3):
                predicted[r, c] = R[r, c] + force * (predicted[r, c] - internal[r, c])
        twist_force(s, left, predicted, w.F_mixed, w.x)
        return 0.0
    largest = step_balance(s, w, numbers, flag == 2)
    if len(s.row_on):
        combination(1.0, R, 1.0, w.closing, R)
    twist_force(s, left, R, w.F, w.b)
    return largest


@part
def size(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Largest entry of the residual of vertices; NaN if there is one."""
    b, out, sum_of_all = w.b, 0.0, 0.0
    for v in range(len(s.framed)):
        for c in range(b.shape[1]):
            a = abs(b[v, c])
            sum_of_all += a
            out = max(out, a)
    return out if sum_of_all < np.inf else sum_of_all


@part
def clear(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """All blocks zero."""
    simd.clear(w.A)
    return 0.0


@part
def nodal_mass_matrix(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Add masses of single frames and of mass points."""
    A, yL, diag, first = w.A, pulled(w.y0, w.mid, numbers), m.diag, s.row
    framed, mass = s.framed, numbers[MASS]
    for k in range(len(s.frame_vertex)):
        v = s.frame_vertex[k]
        scalar_block(s.frame_masses, k, mass, yL, first[v], w.y1, first[v], A, diag[v])
    for v in range(len(first)):
        if not framed[v]:
            for c in range(3, 6):
                A[diag[v], c, c] = 1.0
    for k in range(len(s.point_vertex)):
        v = s.point_vertex[k]
        for c in range(3):
            A[diag[v], c, c] += mass * s.point_masses[k]
    return 0.0


@part
def node_matrix(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Add ``weight d(P_int^T R)`` of single nodes; flag 1: of the R with predicted stresses."""
    weight = numbers[WEIGHT]
    A, y1, diag, first, triads, R = w.A, w.y1, m.diag, s.row, s.triads, w.R
    if flag == 1:
        R = w.R_mixed
    count = len(triads)
    for k in range(0, count, WIDTH):
        vs = chosen(triads, block(k, count))
        own, slots = chosen(first, vs), chosen(diag, vs)
        f = weight * counted(k, count)
        D, F = frames(y1, own)[1], frames(R, own)[1]
        F = times(f, F[0]), times(f, F[1]), times(f, F[2])
        trace = dot(D[0], F[0]) + dot(D[1], F[1]) + dot(D[2], F[2])
        g = combine(column(D, 0), F)
        none = simd.pack((0.0, 0.0, 0.0, 0.0))  # rows of four begin before the triad's
        add_rows(A, slots, 36, 20, (none, g[0] - trace, g[1], g[2]))
        g = combine(column(D, 1), F)
        add_rows(A, slots, 36, 26, (none, g[0], g[1] - trace, g[2]))
        g = combine(column(D, 2), F)
        add_rows(A, slots, 36, 32, (none, g[0], g[1], g[2] - trace))
    return 0.0


@part
def cap(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Size of the increment; one with large rotations is scaled down.

    ``w.found`` is its rotation, and 1 where the next matrix is to be taken with the predicted
    stresses, else 0.
    """
    x, twist, turning, found = w.x, w.twist, s.turning, w.found
    shift, turn, sum_of_all = 0.0, 0.0, 0.0
    for v in range(len(s.framed)):
        for c in range(x.shape[1]):
            a = abs(x[v, c])
            sum_of_all += a
            if turning[v, c]:
                turn = max(turn, a)
            else:
                shift = max(shift, a)
    out = max(shift / numbers[LENGTH], turn)
    factor = numbers[ROTATION] / turn if turn > numbers[ROTATION] else 1.0
    found[0] = turn
    found[1] = 1.0 if factor * out > numbers[MIXED] else 0.0
    if not sum_of_all < np.inf:  # NaN as well, whatever follows it
        out = sum_of_all
    for v in range(x.shape[0]):
        for c in range(x.shape[1]):
            x[v, c] *= factor
            twist[v, c] *= factor
    return out


@part
def predict_changes(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """``P_int(y_1) twist``, rows of y."""
    y, twist, change, first, framed = w.y1, w.twist, w.change, s.row, s.framed
    for v in range(len(first)):
        r = first[v]
        put(change, r, row(twist, v))
        if framed[v]:
            omega = twist[v, 3], twist[v, 4], twist[v, 5]
            for i in range(1, 4):
                put(change, r + i, cross(omega, row(y, r + i)))
    return 0.0


@part
def finish(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Momentum carried on; gives the work of the loads along the step."""
    y0, y1, p0, carried, inertia = w.y0, w.y1, w.p0, w.carried, w.momentum
    internal, external = w.internal, w.external
    mass, momentum = numbers[CARRY_MASS], numbers[CARRY_MOMENTUM]
    force = numbers[CARRY_FORCE] * numbers[FORCE]
    work = 0.0
    for r in range(carried.shape[0]):
        for c in range(3):
            f = external[r, c]
            carried[r, c] = mass * inertia[r, c] + momentum * p0[r, c]
            carried[r, c] += force * (internal[r, c] - f)
            work += f * (y1[r, c] - y0[r, c])
    return work


@part
def better(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Keep the increments of the step; 2 if going on from the last two had been the better start.

    Flag: how many were known before. ``w.found`` is the largest of them and their sum, of
    displacements relative to the scene.
    """
    total, last, before, turning, found = w.total, w.last, w.before, s.turning, w.found
    once = 0.0
    twice = 0.0
    farthest = 0.0
    path = 0.0
    inverse = 1.0 / numbers[LENGTH]
    for v in range(len(s.framed)):
        for c in range(total.shape[1]):
            change = total[v, c] - last[v, c]
            once += change * change
            change += before[v, c] - last[v, c]
            twice += change * change
            way = abs(total[v, c]) * (1.0 if turning[v, c] else inverse)
            farthest = max(farthest, way)
            path += way
    simd.copy(last, before)
    simd.copy(total, last)
    found[0] = farthest
    found[1] = path
    return 2.0 if flag > 1 and twice < once else 1.0
