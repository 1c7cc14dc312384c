"""Compiled calls of an iteration to a balance at rest; the loop is Python's.

Statics take the same parts as a step: without masses, at the end of the step, with the loads of
each iteration. Here are the few calls that its Newton loop, with the load factor as an unknown,
makes of them.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..types import Floats, IndexArray
from . import numbers as n
from .blocks import invert_exchanging
from .jit import call, call_beams, jit
from .nodes import twist_force
from .step import evaluate, matrix, start

__all__ = ["begin", "move", "nearest", "pivots", "pull", "push", "solve"]


@jit
def begin(p: IndexArray, s: Any, m: Any, w: Any, g: Any, numbers: Floats) -> None:
    """Go to where the step starts."""
    start(p, s, m, w, g, numbers, 0)


@jit
def move(p: IndexArray, s: Any, m: Any, w: Any, g: Any, numbers: Floats) -> float:
    """Add the increment x, which is zero then, and evaluate: size of the residual b."""
    size = evaluate(p, s, m, w, g, numbers, 1)
    x = w.x
    for v in range(x.shape[0]):
        for c in range(6):
            x[v, c] = 0.0
    return size


@jit
def pull(p: IndexArray, s: Any, m: Any, w: Any, g: Any, numbers: Floats, out: Floats) -> None:
    """Out (nv, 6): reduced force of the loads ``w.dead`` and ``w.moments`` at y_1."""
    call(p[n.LOAD], s, m, w, numbers, 0)
    twist_force(s, w.mid, w.external, w.F_mixed, w.x)
    if p[n.JOINT_REDUCE]:
        call(p[n.JOINT_REDUCE], s, m, w, numbers, 1)
    x = w.x
    for v in range(x.shape[0]):
        for c in range(6):
            out[v, c] = x[v, c]
            x[v, c] = 0.0


@jit
def solve(
    p: IndexArray,
    s: Any,
    m: Any,
    w: Any,
    g: Any,
    numbers: Floats,
    mixed: int,
    residuals: Floats,
    increments: Floats,
) -> bool:
    """Minus solutions for residuals (k, nv, 6); False: the matrix is singular.

    increments (k, 2, nv, 6) are those of own coordinates, then as twists. With `mixed` the matrix
    is that of the stresses predicted last.
    """
    regular = matrix(p, s, m, w, g, numbers, mixed)
    b, x, twist = w.b, w.x, w.twist
    for k in range(residuals.shape[0]):
        for v in range(b.shape[0]):
            for c in range(6):
                b[v, c] = residuals[k, v, c]
        call(p[n.SWEEP], s, m, w, numbers, 0)
        for v in range(b.shape[0]):
            for c in range(6):
                increments[k, 0, v, c] = x[v, c]
                increments[k, 1, v, c] = twist[v, c]
                x[v, c] = 0.0
    return regular


@jit
def nearest(p: IndexArray, s: Any, m: Any, w: Any, g: Any, numbers: Floats) -> bool:
    """``w.change``: the velocity on the constraints nearest to the momentum p_0, at y_0.

    It is ``P nu`` with ``P^T M P nu = P^T p_0``; False: the matrix is singular.
    """
    start(p, s, m, w, g, numbers, 0)
    evaluate(p, s, m, w, g, numbers, 0)
    if not matrix(p, s, m, w, g, numbers, 0):
        return False
    call(p[n.SWEEP], s, m, w, numbers, 0)
    call(p[n.PREDICT_CHANGES], s, m, w, numbers, 0)
    return True


@jit
def push(p: IndexArray, s: Any, m: Any, w: Any, g: Any, numbers: Floats, what: int) -> None:
    """0: ``w.change`` (rows, 3) of the coordinates by twists; 1: stresses that it predicts."""
    if what == 0:
        call(p[n.PREDICT_CHANGES], s, m, w, numbers, 0)
    elif p[n.BEAM_PREDICTED]:
        call_beams(p[n.BEAM_PREDICTED], g, w, numbers, 0)


@jit
def pivots(p: IndexArray, s: Any, m: Any, w: Any, g: Any, numbers: Floats, out: Floats) -> bool:
    """Of the stiffness at y_1: out (5,), as below; False: singular.

    Pivots of an elimination without exchange of rows inside each block that is left after those
    before it, taken as symmetric: how many are negative, which is the number of negative
    eigenvalues (Sylvester's law of inertia), the smallest and the largest. How far the blocks are
    from symmetric, and the sign of the determinant.
    """
    regular = matrix(p, s, m, w, g, numbers, 0)
    A, S, W, inverse = w.A, np.empty((6, 6)), w.scratch, w.inverse
    out[0], out[1], out[2], out[3], out[4] = 0.0, np.inf, 0.0, 0.0, 1.0
    for v in range(len(m.diag)):
        k = m.diag[v]
        out[4] *= invert_exchanging(A, k, W, inverse, v)
        for i in range(6):
            for c in range(6):
                S[i, c] = A[k, i, c]
        for i in range(6):
            for r in range(i):
                out[3] = max(out[3], abs(S[r, i] - S[i, r]))
        for i in range(m.size[v]):
            pivot = S[i, i]
            out[0] += pivot < 0.0
            out[1] = min(out[1], abs(pivot))
            out[2] = max(out[2], abs(pivot))
            for r in range(i + 1, 6):
                factor = 0.5 * (S[r, i] + S[i, r]) / pivot
                for c in range(i + 1, 6):
                    S[r, c] -= factor * 0.5 * (S[c, i] + S[i, c])
    return regular
