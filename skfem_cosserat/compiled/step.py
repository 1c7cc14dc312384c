"""Compiled parts of a step; Newton's loop over them stays in Python.

In parts, since a compiled function that calls another is optimised with it once more: composed, it
would take twice as long to compile.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..types import Floats
from . import tree
from .elements import beam_force, beam_predicted, beam_stress, beam_tangent, scalar_block
from .jit import jit
from .small import clear

__all__ = [
    "NUMBERS",
    "add_elements",
    "add_nodes",
    "clear_blocks",
    "increment",
    "residual",
    "right_hand_side",
]

#: numbers of a step, see :class:`skfem_cosserat.integrators.base.Scheme`
NUMBERS = ("mass", "momentum", "force", "start", "end", "weight", "length", "rotation", "mixed")
MASS, MOMENTUM, FORCE, START, END, WEIGHT, LENGTH, ROTATION, MIXED = range(len(NUMBERS))


@jit
def mass_times(s: Any, y1: Floats, y0: Floats, factor: float, out: Floats) -> None:
    """``factor M (y1 - y0)``."""
    for r in range(out.shape[0]):
        u, v, w = 0.0, 0.0, 0.0
        for k in range(s.mass_indptr[r], s.mass_indptr[r + 1]):
            j = s.mass_indices[k]
            m = s.mass_data[k]
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
    largest = 0.0
    for r in range(w.R.shape[0]):
        for c in range(3):
            a = w.momentum[r, c]
            b = w.p0[r, c]
            f = force * w.internal[r, c]
            x = force * w.external[r, c]
            w.R[r, c] = a - momentum * b + f - x
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
    for v in range(w.b.shape[0]):
        for c in range(6):
            a = abs(w.b[v, c])
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
    V, C = np.empty((3, 3)), np.empty((4, 4))
    for k in range(len(s.lump_vertex)):
        v = s.lump_vertex[k]
        r = s.row[v]
        for a in range(4):
            for b in range(4):
                C[a, b] = mass * s.lumps[k, a, b]
        scalar_block(C, left[r : r + 4], w.y1[r : r + 4], w.A[m.diag[v]], V)
    for v in range(len(s.row)):
        if not s.framed[v]:
            for c in range(3, 6):
                w.A[m.diag[v], c, c] = 1.0
    for k in range(len(s.point_vertex)):
        D = w.A[m.diag[s.point_vertex[k]]]
        for c in range(3):
            D[c, c] += mass * s.point_masses[k]


@jit
def clear_blocks(A: Floats) -> None:
    """All blocks zero."""
    for k in range(A.shape[0]):
        for i in range(6):
            for c in range(6):
                A[k, i, c] = 0.0


@jit
def add_elements(g: Any, w: Any, numbers: Floats, mixed: bool) -> None:
    """Blocks of beam elements, by twists."""
    left = w.mid if numbers[WEIGHT] != 0.0 else w.y0
    stressed = w.y1 if numbers[START] != 0.0 else w.mid
    S = g.predicted if mixed else g.S
    half = 0.5 * numbers[FORCE]
    beam_tangent(g, (w.mid, stressed, left, w.y1), S, (numbers[MASS], half, half), w.A)


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
    for v in range(x.shape[0]):
        for c in range(6):
            a = abs(x[v, c])
            if s.turning[v, c]:
                if not a <= turn:
                    turn = a
            elif not a <= shift:
                shift = a
    return max(shift / length, turn), turn


@jit
def right_hand_side(w: Any) -> None:
    """Minus the residual."""
    for v in range(w.x.shape[0]):
        for c in range(6):
            w.x[v, c] = -w.b[v, c]
            w.extra[v, c] = 0.0


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
    size, turn = sizes(s, w.x, numbers[LENGTH])
    cap = numbers[ROTATION] / turn if turn > numbers[ROTATION] else 1.0
    for v in range(w.x.shape[0]):
        for c in range(6):
            w.x[v, c] *= cap
            w.twist[v, c] *= cap
            w.total[v, c] += w.x[v, c]
    mixed = cap * size > numbers[MIXED] and g.base.shape[0] > 0
    if mixed:
        stressed = w.y1 if numbers[START] != 0.0 else w.mid
        tree.rates(s, w.y1, w.twist, w.change)
        beam_predicted(g, stressed, w.change, 0.5, g.S, g.predicted)
    return size, turn, mixed
