"""Compiled calls of an iteration to a balance at rest; the loop is Python's.

Statics take the same parts as a step: without masses, at the end of the step, with the loads of
each iteration. Here are the few calls that its Newton loop, with the load factor as an unknown,
makes of them; and the part that makes up for the masses, :func:`hold`.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..types import Floats
from . import numbers as n
from .blocks import triangles_exchanging
from .jit import inlined, part
from .rows import add_weighted
from .simd import clear, local
from .step import ask, ask_beams, evaluate, given, matrix, start

#: stiffness of what is held against the largest number in the matrix
HELD = 10.0


@inlined
def largest_entry(A: Floats) -> float:
    """Largest magnitude."""
    out = 0.0
    for k in range(A.shape[0]):
        for r in range(6):
            for c in range(6):
                out = max(out, abs(A[k, r, c]))
    return out


@inlined
def hold_plane(s: Any, m: Any, A: Floats, stiffness: float) -> None:
    """Hold all vertices against motions out of the plane: they are not among its unknowns."""
    normal, diag, framed = s.hold, m.diag, s.framed
    confined = normal[0] != 0.0 or normal[1] != 0.0 or normal[2] != 0.0
    for v in range(len(framed) if confined else 0):
        for i in range(3):
            for j in range(3):
                along = stiffness * normal[i] * normal[j]
                A[diag[v], i, j] += along
                if framed[v]:
                    A[diag[v], 3 + i, 3 + j] -= along
            if framed[v]:
                A[diag[v], 3 + i, 3 + i] += stiffness


@part
def hold(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Stiffness against motions that are none of a scene's, so that all pivots are regular.

    Without masses a tree is a mechanism where only constraint rows hold it, and what stays in a
    plane may fall over. Neither changes the increments, but for the multipliers: :func:`solve` puts
    that right. Nothing in a plane couples with motions out of it.
    """
    size = largest_entry(w.A)
    if len(w.C_child):
        size = max(size, largest_entry(w.C_child), largest_entry(w.C_parent))
    stiffness = HELD * size if size > 0.0 else 1.0
    s.held_by[0] = stiffness
    hold_plane(s, m, w.A, stiffness)
    add_weighted(s, w, stiffness)  # what constraint rows hold
    return 0.0


@part
def begin(o: Any, flag: int) -> float:
    """Go to where the step starts."""
    start(given(o), 0)
    return 0.0


@part
def move(o: Any, flag: int) -> float:
    """Add the increment x, which is zero then, and evaluate: size of the residual b."""
    size = evaluate(given(o), True)
    clear(o.work.x)
    return size


@part
def solve(o: Any, flag: int) -> float:
    """Minus solutions for one residual (nv, 6) or both, flag 0 and 1; 0: the matrix is singular.

    ``o.increments`` (2, 2, nv, 6) are those of own coordinates, then as twists; rows behind the
    vertices are those of multipliers. From flag 2 on the matrix is that of the stresses predicted
    last.
    """
    s, w, residuals, increments = o.tree, o.work, o.residuals, o.increments
    regular = matrix(given(o), flag // 2)
    b, x, twist, count = w.b, w.x, w.twist, len(s.framed)
    for k in range(1 + flag % 2):
        for v in range(b.shape[0]):
            for c in range(6):
                b[v, c] = residuals[k, v, c]
        ask(given(o), n.SWEEP, 0)
        for v in range(b.shape[0]):
            for c in range(6):
                # the rows' own stiffness has taken its share
                held = s.held_by[0] * b[v, c] if v >= count else 0.0
                increments[k, 0, v, c] = x[v, c] - held
                increments[k, 1, v, c] = twist[v, c]
                x[v, c] = 0.0
    return 1.0 if regular else 0.0


@inlined
def velocity(o: Any) -> bool:
    """Compute the velocity of :func:`nearest`; False: the matrix is singular."""
    start(given(o), 0)
    evaluate(given(o), False)
    if not matrix(given(o), 0):
        return False
    b = o.work.b  # what rows gape by there is no velocity's fault
    for k in range(len(o.tree.framed), b.shape[0]):
        for c in range(6):
            b[k, c] = 0.0
    ask(given(o), n.SWEEP, 0)
    ask(given(o), n.PREDICT_CHANGES, 0)
    return True


@part
def nearest(o: Any, flag: int) -> float:
    """``w.change``: the velocity on the constraints nearest to the momentum p_0, at y_0.

    It is ``P nu`` with ``P^T M P nu = P^T p_0``; 0: the matrix is singular. All that it takes is in
    the structure o: compiled steps of any scene call it by its address.
    """
    return 1.0 if velocity(o) else 0.0


@part
def along(o: Any, flag: int) -> float:
    """``o.v`` (k, rows, 3): as of :func:`nearest`, for the first `flag` states ``o.q``, ``o.p``.

    And ``o.energies`` (k, 2), kinetic and stored; 0: singular at one of them. The kinetic energy is
    ``v . p/2``, as ``p - M v`` is along ``G^T``.
    """
    w, v = o.work, o.v
    y0, p0, change, found = w.y0, w.p0, w.change, w.found
    rows = p0.shape[0]
    for k in range(flag):
        for r in range(rows):
            for c in range(3):
                y0[r, c], p0[r, c] = o.q[k, r, c], o.p[k, r, c]
        if not velocity(o):
            return 0.0
        kinetic = 0.0
        for r in range(rows):
            for c in range(3):
                v[k, r, c] = change[r, c]
                kinetic += change[r, c] * p0[r, c]
        found[0] = 0.0
        ask_beams(given(o), n.BEAM_ENERGY, 0)
        o.energies[k, 0], o.energies[k, 1] = 0.5 * kinetic, found[0]
    return 1.0


@part
def change(o: Any, flag: int) -> float:
    """``w.change`` (rows, 3) of the coordinates by twists."""
    ask(given(o), n.PREDICT_CHANGES, 0)
    return 0.0


@part
def predict(o: Any, flag: int) -> float:
    """Stresses that ``w.change`` predicts."""
    ask_beams(given(o), n.BEAM_PREDICTED, 0)
    return 0.0


@part
def pivots(o: Any, flag: int) -> float:
    """Pivots of the stiffness at y_1, written to ``o.pivots`` (7,), as below; 0: singular.

    Pivots of an elimination without exchange of rows inside each block that is left after those
    before it, taken as symmetric: how many are negative, which is the number of negative
    eigenvalues (Sylvester's law of inertia), but for one by each constraint row with a multiplier;
    the smallest and the largest of vertices. How far the blocks are from symmetric, and the sign of
    the determinant. The smallest and the largest of constraint rows.
    """
    s, m, w, out = o.tree, o.plan, o.work, o.pivots
    regular = matrix(given(o), 0)
    A, S, W = w.A, local((6, 6)), w.scratch
    clear(out)
    out[1], out[4], out[5] = np.inf, 1.0, np.inf
    count = len(s.framed)
    for v in range(len(m.diag)):
        k = m.diag[v]
        out[4] *= triangles_exchanging(A, k, W, w.lower, w.upper, v)
        for i in range(6):
            for c in range(6):
                S[i, c] = A[k, i, c]
        for i in range(6):
            for r in range(i if v < count else 0):
                out[3] = max(out[3], abs(S[r, i] - S[i, r]))
        for i in range(m.size[v]):
            pivot = S[i, i]
            if v < count:
                out[0] += pivot < 0.0
                out[1] = min(out[1], abs(pivot))
                out[2] = max(out[2], abs(pivot))
            elif s.row_on[v - count, i] != 0.0:
                out[0] -= pivot > 0.0
                out[4] = -out[4]
                out[5] = min(out[5], abs(pivot))
                out[6] = max(out[6], abs(pivot))
            for r in range(i + 1, 6):
                factor = 0.5 * (S[r, i] + S[i, r]) / pivot
                for c in range(i + 1, 6):
                    S[r, c] -= factor * 0.5 * (S[c, i] + S[i, c])
    return 1.0 if regular else 0.0
