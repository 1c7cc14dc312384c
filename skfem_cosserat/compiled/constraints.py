"""Compiled parts of a step with multipliers: coordinates, constraints and their derivatives.

Constraints are quadratic forms: first the six of each triad, then those of joints as products
``c y_a . y_b`` and linear terms of rows of y, with lists of indices that never change. So these
parts know no joints. Unknowns are the coordinates and the impulses ``h lambda``. Parts take
``(s, m, w, numbers, flag)``: s the constraints, m the elimination, w the work (:mod:`.structures`).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..types import Floats, IndexArray
from .jit import inlined, part
from .nodes import capped, carried_on, step_balance
from .numbers import MASS, WEIGHT
from .small import Vector, combine, cross, directors, dot, minus, plus, put, row, turned

__all__ = [
    "PAIRS",
    "balance",
    "begin",
    "better",
    "border",
    "cap",
    "clear",
    "finish",
    "move",
    "nodal_mass_matrix",
    "size",
]

#: directors whose product is the k-th constraint of a triad
PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
#: places in ``w.found``, behind those of the null space
TERM = 2


@part
def begin(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Where to start: flag 0 from s.start, 1 as in the last step again, 2 from the last two."""
    y0, y1, change, last, before, start = w.y0, w.y1, w.change, s.last, s.before, s.start
    for r in range(change.shape[0]):
        for c in range(3):
            d = start[r, c]
            if flag == 1:
                d = last[r, c]
            elif flag == 2:
                d = 2.0 * last[r, c] - before[r, c]
            y1[r, c] = y0[r, c] + d
            change[r, c] = 0.0
    multiplier, added, last_one, one_before = s.multiplier, s.added, s.last_one, s.one_before
    for k in range(len(multiplier)):
        value = 0.0
        if flag == 1:
            value = last_one[k]
        elif flag == 2:
            value = 2.0 * last_one[k] - one_before[k]
        multiplier[k] = value
        added[k] = 0.0
    if flag == 0:
        return 0.0
    framed, first = s.framed, s.row
    for v in range(len(first)):
        if framed[v]:
            r = first[v]
            D = directors(y0, r)
            for i in range(3):
                put(y1, r + 1 + i, combine(turning(y0, last, before, r, i, flag == 2), D))
    return 0.0


@inlined
def turning(
    y0: Floats, last: Floats, before: Floats, r: int, i: int, twice: bool
) -> tuple[float, float, float]:
    """Row i of the rotation that a triad has made, by its own components; of one to come."""
    D = directors(y0, r)
    E = directors(last, r)
    E = minus(D[0], E[0]), minus(D[1], E[1]), minus(D[2], E[2])
    a = turned(E, row(y0, r + 1 + i))
    if not twice:
        return a
    C = directors(before, r)
    C = minus(E[0], C[0]), minus(E[1], C[1]), minus(E[2], C[2])
    # A = D E^T made last, B = E C^T before it: on with A B^T A
    b = dot(a, turned(C, E[0])), dot(a, turned(C, E[1])), dot(a, turned(C, E[2]))
    return combine(b, (turned(E, D[0]), turned(E, D[1]), turned(E, D[2])))


@part
def move(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Add the increments of coordinates and impulses; rows of the ground."""
    y1, ground1, change, multiplier, added = w.y1, w.ground1, w.change, s.multiplier, s.added
    rows = change.shape[0]
    for r in range(rows):
        for c in range(3):
            y1[r, c] += change[r, c]
    for r in range(len(ground1)):
        put(y1, rows + r, row(ground1, r))
    for k in range(len(multiplier)):
        multiplier[k] += added[k]
    return 0.0


@inlined
def factor_of(s: Any, t: int, y: Floats) -> float:
    """Factor of a product, which may be prescribed in time by a row of the ground."""
    c = s.factor[t]
    if s.drive_row[t] >= 0:
        c *= y[s.drive_row[t], s.drive_component[t]]
    return c


@inlined
def constraint_values(s: Any, y: Floats, first: int, last: int, g: Floats) -> None:
    """Sums of products, in g, of those from `first` on; linear terms with the first ones."""
    rows, left, right = s.product_row, s.left, s.right
    for t in range(first, last):
        g[rows[t]] += factor_of(s, t, y) * dot(row(y, left[t]), row(y, right[t]))
    if first > 0:
        return
    for t in range(len(s.linear_row)):
        k = s.linear_row[t]
        a = s.linear[t]
        for c in range(3):
            g[k + c] += s.linear_factor[t] * y[a, c]


@inlined
def triple(a: Floats, k: int) -> Vector:
    """Three numbers from the k-th on."""
    return a[k], a[k + 1], a[k + 2]


@inlined
def pull(f: Floats, a: int, factor: float, v: Vector) -> None:
    """``f_a += factor v``, of rows that are unknown."""
    if a < f.shape[0]:
        for c in range(3):
            f[a, c] += factor * v[c]


@inlined
def triads(s: Any, y: Floats, y1: Floats) -> None:
    """Impulses of the constraints of all triads at y, and their values at y_1."""
    framed, first, multiplier, impulse, g = s.framed, s.row, s.multiplier, s.impulse, s.g
    k = 0
    for v in range(len(first)):
        if not framed[v]:
            continue
        r = first[v]
        D, E = directors(y, r), directors(y1, r)
        for q in range(3):
            g[k + q] = 0.5 * dot(E[q], E[q]) - s.constant[k + q]
            g[k + 3 + q] = dot(E[PAIRS[3 + q][0]], E[PAIRS[3 + q][1]]) - s.constant[k + 3 + q]
        a, b = triple(multiplier, k), triple(multiplier, k + 3)
        put(impulse, r + 1, combine((a[0], b[0], b[1]), D))
        put(impulse, r + 2, combine((b[0], a[1], b[2]), D))
        put(impulse, r + 3, combine((b[1], b[2], a[2]), D))
        k += 6


@part
def balance(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """R, the impulse ``G(y_c)^T h lambda`` and g(y_1); flag 2: gives the largest term of R."""
    largest = step_balance(s, w, numbers, flag == 2)
    w.found[TERM] = largest
    y, y1, impulse, multiplier, g = w.y0, w.y1, s.impulse, s.multiplier, s.g
    if numbers[WEIGHT] != 0.0:
        y = w.mid
    for r in range(impulse.shape[0]):
        for c in range(3):
            impulse[r, c] = 0.0
    triads(s, y, y1)
    rows, left, right = s.product_row, s.left, s.right
    for t in range(s.products):
        f = multiplier[rows[t]] * factor_of(s, t, y)
        pull(impulse, left[t], f, row(y, right[t]))
        pull(impulse, right[t], f, row(y, left[t]))
    for t in range(len(s.linear_row)):
        k = s.linear_row[t]
        pull(impulse, s.linear[t], s.linear_factor[t], triple(multiplier, k))
    for k in range(m.internal, len(multiplier)):
        g[k] = -s.constant[k]
    constraint_values(s, y1, 0, s.products, g)
    return largest


@part
def size(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Largest entry of the balance, or of constraints against their own terms; NaN stays."""
    R, impulse, g, magnitude = w.R, s.impulse, s.g, s.magnitude
    scale = w.found[TERM] if w.found[TERM] > 0.0 else 1.0
    out = 0.0
    for r in range(impulse.shape[0]):
        for c in range(3):
            a = abs(R[r, c] + impulse[r, c])
            if not a <= out:
                out = a
    for k in range(len(magnitude)):
        a = scale * abs(g[k]) / magnitude[k]
        if not a <= out:
            out = a
    return out


@part
def cap(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Size of the increment; one with large rotations is scaled down. See :mod:`.nodes`."""
    change, added, found, director = w.change, s.added, w.found, s.director
    shift, turn = 0.0, 0.0
    for r in range(change.shape[0]):
        for c in range(3):
            a = abs(change[r, c])
            if director[r]:
                if not a <= turn:
                    turn = a
            elif not a <= shift:
                shift = a
    out, factor = capped(shift, turn, numbers, found)
    if factor != 1.0:
        for r in range(change.shape[0]):
            for c in range(3):
                change[r, c] *= factor
        for k in range(len(added)):
            added[k] *= factor
    return out


@part
def clear(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """All blocks zero."""
    A = w.A
    n = A.shape[1]
    for k in range(A.shape[0]):
        for i in range(n):
            for c in range(n):
                A[k, i, c] = 0.0
    return 0.0


@inlined
def jacobian(s: Any, y: Floats, G: Floats) -> None:
    """Rows of joints by the coordinates of their own vertex, then those by its parent's."""
    for k in range(G.shape[0]):
        for c in range(G.shape[1]):
            G[k, c] = 0.0
    for t in range(s.products):
        f = factor_of(s, t, y)
        for side in range(2):
            a, b = s.left[t], s.right[t]
            if side == 1:
                a, b = b, a
            k = s.product_place[t, side]
            if k >= 0:
                for c in range(3):
                    G[k, s.product_column[t, side] + c] += f * y[b, c]
    for t in range(len(s.linear_row)):
        k = s.linear_place[t]
        if k >= 0:
            for c in range(3):
                G[k + c, s.linear_column[t] + c] += s.linear_factor[t]


@inlined
def add_curvature(s: Any, diag: IndexArray, y: Floats, weight: float, A: Floats) -> None:
    """``A += weight sum_k h lambda_k H_k(y)``."""
    k = 0
    for v in range(len(s.row)):
        if not s.framed[v]:
            continue
        for q in range(6):
            i, j = 3 + 3 * PAIRS[q][0], 3 + 3 * PAIRS[q][1]
            f = weight * s.multiplier[k + q]
            for c in range(3):
                A[diag[v], i + c, j + c] += f
                if q > 2:
                    A[diag[v], j + c, i + c] += f
        k += 6
    for t in range(s.products):
        if s.curved[t, 0] < 0:
            continue
        f = weight * s.multiplier[s.product_row[t]] * factor_of(s, t, y)
        i, j = s.product_column[t, 0], s.product_column[t, 1]
        for c in range(3):
            A[s.curved[t, 0], i + c, j + c] += f
            A[s.curved[t, 1], j + c, i + c] += f


@part
def nodal_mass_matrix(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Add masses of single frames and of mass points."""
    A, diag, mass = w.A, m.diag, numbers[MASS]
    for k in range(len(s.frame_vertex)):
        v = diag[s.frame_vertex[k]]
        for a in range(4):
            for b in range(4):
                for c in range(3):
                    A[v, 3 * a + c, 3 * b + c] += mass * s.frame_masses[k, a, b]
    for k in range(len(s.point_vertex)):
        for c in range(3):
            A[diag[s.point_vertex[k]], c, c] += mass * s.point_masses[k]
    return 0.0


@inlined
def border(s: Any, m: Any, w: Any, numbers: Floats) -> None:
    """What constraints add to the matrix: its scaling, rows of joints on both sides, curvature."""
    A, diag, weight = w.A, m.diag, numbers[WEIGHT]
    scale = m.scale
    scale[0], scale[1] = s.step, 1.0
    if s.scaled:
        scale[0] = largest_entry(A, diag)
        scale[1] = scale[0]
    y, G = w.y1, s.G_right
    for _ in range(2):  # one place only: it is compiled into each
        jacobian(s, y, G)
        y, G = w.mid, s.G_left
        if weight == 0.0:
            y = w.y0
    if weight != 0.0:
        add_curvature(s, diag, w.mid, weight, A)


@inlined
def largest_entry(A: Floats, diag: IndexArray) -> float:
    """Of the diagonals of the dynamic block."""
    out = 0.0
    for v in range(len(diag)):
        for i in range(A.shape[1]):
            out = max(out, abs(A[diag[v], i, i]))
    return out if out > 0.0 else 1.0


@inlined
def wrong_branch(s: Any, y: Floats) -> bool:
    """Whether the constraints are fulfilled only after a reflection or half a turn."""
    g, m = s.g, len(s.multiplier)
    for k in range(m, len(g)):
        g[k] = -s.constant[k]
    constraint_values(s, y, s.products, len(s.product_row), g)
    for k in range(m, len(g)):
        if g[k] < -1.0:  # a cosine, less 1
            return True
    for v in range(len(s.row)):
        if s.framed[v]:
            D = directors(y, s.row[v])
            if dot(cross(D[0], D[1]), D[2]) < 0.0:
                return True
    return False


@part
def finish(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Momentum carried on; gives the work of the loads, NaN on another branch."""
    if wrong_branch(s, w.y1):
        return np.nan
    return carried_on(w, numbers)


@part
def better(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Keep the step; 2 if going on from the last two had been the better start than the last.

    Flag: how many were known before.
    """
    y0, y1, last, before, framed, first = w.y0, w.y1, s.last, s.before, s.framed, s.row
    once, twice = 0.0, 0.0
    if flag > 1:
        for v in range(len(first)):
            r = first[v]
            u = minus(minus(row(y1, r), row(y0, r)), row(last, r))
            once += dot(u, u)
            u = plus(u, minus(row(before, r), row(last, r)))
            twice += dot(u, u)
            if framed[v]:
                D = directors(y0, r)
                for i in range(3):
                    d = row(y1, r + 1 + i)
                    u = minus(d, combine(turning(y0, last, before, r, i, False), D))
                    once += dot(u, u)
                    u = minus(d, combine(turning(y0, last, before, r, i, True), D))
                    twice += dot(u, u)
    for r in range(last.shape[0]):
        d = row(last, r)
        put(before, r, d)
        put(last, r, minus(row(y1, r), row(y0, r)))
    for k in range(len(s.multiplier)):
        s.one_before[k] = s.last_one[k]
        s.last_one[k] = s.multiplier[k]
    return 2.0 if flag > 1 and twice < once else 1.0
