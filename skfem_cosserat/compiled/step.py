"""Compiled parts of a step; Newton's loop over them stays in Python.

In parts, since a compiled function that calls another is optimised with it once more: composed, it
would take twice as long to compile.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..types import Floats
from . import tree
from .elements import (
    END,
    FORCE,
    LENGTH,
    MASS,
    MIXED,
    MOMENTUM,
    NUMBERS,
    ROTATION,
    START,
    WEIGHT,
    beam_force,
    beam_predicted,
    beam_stress,
    scalar_block,
)
from .jit import jit
from .small import clear

__all__ = [
    "NUMBERS",
    "add_nodes",
    "clear_blocks",
    "increment",
    "residual",
]


@jit
def mass_times(s: Any, y1: Floats, y0: Floats, factor: float, out: Floats) -> None:
    """``factor M (y1 - y0)``."""
    first, columns, entries = s.mass_indptr, s.mass_indices, s.mass_data
    for r in range(out.shape[0]):
        u, v, w = 0.0, 0.0, 0.0
        for k in range(first[r], first[r + 1]):
            j = columns[k]
            m = entries[k]
            u += m * (y1[j, 0] - y0[j, 0])
            v += m * (y1[j, 1] - y0[j, 1])
            w += m * (y1[j, 2] - y0[j, 2])
        out[r, 0] = factor * u
        out[r, 1] = factor * v
        out[r, 2] = factor * w


@jit
def balance(w: Any, numbers: Floats) -> float:
    """R of the step from its terms; the largest of them."""
    momentum, force = numbers[MOMENTUM], numbers[FORCE]
    R, inertia, p0, internal, external = w.R, w.momentum, w.p0, w.internal, w.external
    largest = 0.0
    for r in range(R.shape[0]):
        for c in range(3):
            a = inertia[r, c]
            b = p0[r, c]
            f = force * internal[r, c]
            x = force * external[r, c]
            R[r, c] = a - momentum * b + f - x
            if numbers[START] == 0.0:  # one term, as in the variational scheme's evaluation
                f, x = f - x, 0.0
            largest = max(largest, abs(a), abs(b), abs(f), abs(x))
    return largest


@jit
def residual(s: Any, g: Any, w: Any, numbers: Floats) -> float:
    """Evaluate at the configuration y1: the size of the residual against its terms."""
    y0, y1, mid = w.y0, w.y1, w.mid
    for r in range(y1.shape[0]):
        for c in range(3):
            mid[r, c] = 0.5 * (y0[r, c] + y1[r, c])
    mass_times(s, y1, y0, numbers[MASS], w.momentum)
    stressed = y1 if numbers[START] != 0.0 else mid
    beam_stress(g, stressed, numbers[START], numbers[END], g.S0, g.S)
    clear(w.internal)
    beam_force(g, mid, g.S, w.internal)
    largest = balance(w, numbers)
    left = y0
    if numbers[WEIGHT] != 0.0:
        left = mid
        tree.maps(s, mid, w.S_left, w.X_left)
    tree.twist_force(s, left, w.R, w.F)
    tree.reduce_force(s, w.S_left, w.X_left, w.F, w.b)
    size = 0.0
    reduced = w.b
    for v in range(reduced.shape[0]):
        for c in range(6):
            a = abs(reduced[v, c])
            if not a <= size:  # NaN as well
                size = a
    return size / largest if largest > 0.0 else size


@jit
def mixed_balance(s: Any, g: Any, w: Any, numbers: Floats, left: Floats) -> None:
    """R and the forces of subtrees with the predicted stresses, for the curvature terms."""
    R = w.R_mixed
    clear(R)
    beam_force(g, w.mid, g.predicted, R)
    for r in range(R.shape[0]):
        for c in range(3):
            R[r, c] = w.R[r, c] + numbers[FORCE] * (R[r, c] - w.internal[r, c])
    if numbers[WEIGHT] != 0.0:
        tree.twist_force(s, left, R, w.F_mixed)
        tree.reduce_force(s, w.S_left, w.X_left, w.F_mixed, w.x)


@jit
def lumped_masses(s: Any, m: Any, w: Any, mass: float, left: Floats) -> None:
    """Blocks of single frames and of mass points."""
    V, C = np.empty((3, 3)), np.empty((1, 1, 4, 4))
    L, R = np.empty((1, 4, 3)), np.empty((1, 4, 3))
    A, y1, diag, row, lumps = w.A, w.y1, m.diag, s.row, s.lumps
    for k in range(len(s.lump_vertex)):
        v = s.lump_vertex[k]
        for a in range(4):
            for b in range(4):
                C[0, 0, a, b] = mass * lumps[k, a, b]
            for c in range(3):
                L[0, a, c] = left[row[v] + a, c]
                R[0, a, c] = y1[row[v] + a, c]
        scalar_block(C, 0, 0, L, R, A, diag[v], V)
    framed = s.framed
    for v in range(len(row)):
        if not framed[v]:
            for c in range(3, 6):
                A[diag[v], c, c] = 1.0
    for k in range(len(s.point_vertex)):
        v = s.point_vertex[k]
        for c in range(3):
            A[diag[v], c, c] += mass * s.point_masses[k]


@jit
def clear_blocks(w: Any) -> None:
    """All blocks zero."""
    A = w.A
    for k in range(A.shape[0]):
        for i in range(6):
            for c in range(6):
                A[k, i, c] = 0.0


@jit
def add_nodes(s: Any, g: Any, m: Any, w: Any, numbers: Floats, mixed: bool) -> None:
    """Blocks of single nodes; with predicted stresses also the forces that edges need."""
    weight = numbers[WEIGHT]
    left = w.mid if weight != 0.0 else w.y0
    lumped_masses(s, m, w, numbers[MASS], left)
    if mixed:
        mixed_balance(s, g, w, numbers, left)
    if weight != 0.0:
        tree.nodal_curvature(s, w.y1, w.R_mixed if mixed else w.R, weight, w.A, m.diag)


@jit
def sizes(s: Any, x: Floats, length: float) -> tuple[float, float]:
    """Size of an increment, and of its largest rotation."""
    shift = 0.0
    turn = 0.0
    turning = s.turning
    for v in range(x.shape[0]):
        for c in range(6):
            a = abs(x[v, c])
            if turning[v, c]:
                if not a <= turn:
                    turn = a
            elif not a <= shift:
                shift = a
    return max(shift / length, turn), turn


@jit
def increment(s: Any, g: Any, w: Any, numbers: Floats) -> tuple[float, float, bool]:
    """Cap the increment found, keep count of it, predict the stresses that it leads to.

    Returns
    -------
    size, turn : float
        Of the increment before it was capped.
    mixed : bool
        Whether the next matrix is to be taken with the predicted stresses, which are then ready.
    """
    x, twist, total = w.x, w.twist, w.total
    size, turn = sizes(s, x, numbers[LENGTH])
    cap = numbers[ROTATION] / turn if turn > numbers[ROTATION] else 1.0
    for v in range(x.shape[0]):
        for c in range(6):
            x[v, c] *= cap
            twist[v, c] *= cap
            total[v, c] += x[v, c]
    mixed = cap * size > numbers[MIXED] and g.base.shape[0] > 0
    if mixed:
        stressed = w.y1 if numbers[START] != 0.0 else w.mid
        tree.rates(s, w.y1, w.twist, w.change)
        beam_predicted(g, stressed, w.change, 0.5, g.S, g.predicted)
    return size, turn, mixed
