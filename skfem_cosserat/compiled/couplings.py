"""Compiled springs, dampers, cables and actuators on one scalar coordinate each.

As in :mod:`skfem_cosserat.model.couplings`: invariants ``pi_k = y . A_k y / 2`` of at most two
vertices, four rows each; the force on their rows is ``sum_k s_k A_k y_mid``. Coordinates are
displacements, distances and angles. :mod:`.coupling_laws` gives s and its slopes.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..types import Floats, IndexArray
from .coupling_laws import ANGLE, respond, value
from .elements import scalar_block
from .jit import inlined, part
from .numbers import AT_END, AT_MID, FORCE, GROUND, PI0, SHARE, START, TURNS, WEIGHT, XI0, S
from .small import Vector, cross, dot, increase, minus, plus, put, row, times

__all__ = ["KIND", "ROW", "SIDE", "SLACK", "SLOT"]
__all__ += ["couple", "couple_force", "gradients", "right_side"]

#: columns of ``s.coupling``: kind, whether it is slack under pressure, slots of the sides (a, a),
#: (a, b), (b, a), (b, b), -1 where one is ground, and rows of y
KIND, SLACK, SLOT, ROW = 0, 1, 2, 6
#: rows of a side
SIDE = 4
ROWS = 2 * SIDE
ZERO = (0.0, 0.0, 0.0)


@inlined
def gradients(
    forms: Floats, places: IndexArray, c: int, k: int, y: Floats, G: Floats, j: int
) -> float:
    """``G_j = A_k y`` (8, 3); gives pi_k."""
    pi = 0.0
    for a in range(ROWS):
        u = ZERO
        for b in range(ROWS):
            f = forms[c, k, a, b]
            if f != 0.0:
                u = plus(u, times(f, row(y, places[c, ROW + b])))
        for i in range(3):
            G[j, a, i] = u[i]
        pi += 0.5 * dot(u, row(y, places[c, ROW + a]))
    return pi


@inlined
def couple_start(s: Any, w: Any, G: Floats) -> None:
    """Invariants and coordinates at the start of the step; G (1, 8, 3) or more is scratch."""
    y0, places, forms, state = w.y0, s.coupling, s.coupling_forms, w.coupled
    for c in range(len(places)):
        for k in range(2):
            state[c, PI0 + k] = gradients(forms, places, c, k, y0, G, 0)
        xi = value(places[c, KIND], state[c, PI0], state[c, PI0 + 1])
        state[c, XI0] = xi + 2.0 * np.pi * state[c, TURNS]


@inlined
def couple_force(s: Any, w: Any, numbers: Floats, flag: int, G: Floats) -> None:
    """Flag 0: evaluate, and add to the internal force; 2: add to that of predicted stresses.

    3: at the start of the step. G (3, 8, 3) or more is scratch.
    """
    if flag == 3:
        couple_start(s, w, G)
        return
    y0, y1, mid, places, forms, state = w.y0, w.y1, w.mid, s.coupling, s.coupling_forms, w.coupled
    out = w.internal
    if flag == 2:
        out = w.R_mixed
    rows = out.shape[0]
    for c in range(len(places)):
        kind = places[c, KIND]
        a = gradients(forms, places, c, 0, mid, G, 0)
        b = gradients(forms, places, c, 1, mid, G, 1) if kind == ANGLE else 0.0
        if flag == 0:
            a1 = gradients(forms, places, c, 0, y1, G, 2)
            b1 = gradients(forms, places, c, 1, y1, G, 2) if kind == ANGLE else 0.0
            discrete, slack = numbers[START] != 0.0, places[c, SLACK] != 0
            respond(kind, slack, discrete, s.coupling_law, state, c, a, b, a1, b1)
            state[c, GROUND] = 0.0
        for i in range(ROWS):
            f = times(state[c, S], (G[0, i, 0], G[0, i, 1], G[0, i, 2]))
            if kind == ANGLE:
                f = plus(f, times(state[c, S + 1], (G[1, i, 0], G[1, i, 1], G[1, i, 2])))
            r = places[c, ROW + i]
            if r < rows:
                increase(out, r, f)
            elif flag == 0:
                state[c, GROUND] += dot(f, minus(row(y1, r), row(y0, r)))


@inlined
def right_side(state: Floats, c: int, k: int, share: float, G: Floats, a: int) -> Vector:
    """Row a of the derivative of s_k by y_1, G (4, 8, 3) at the midpoint and at y_1."""
    u = ZERO
    for n in range(2):
        here = share * state[c, AT_MID + 2 * k + n]
        end = state[c, AT_END + 2 * k + n]
        u = plus(u, times(here, (G[n, a, 0], G[n, a, 1], G[n, a, 2])))
        u = plus(u, times(end, (G[2 + n, a, 0], G[2 + n, a, 1], G[2 + n, a, 2])))
    return u


@inlined
def put_twist(places: IndexArray, c: int, y: Floats, U: Floats, F: Floats, j: int) -> None:
    """``F_j`` (2, 6): ``P_int(y)^T U`` of both sides, U (8, 3)."""
    for side in range(2):
        torque = ZERO
        for i in range(1, SIDE):
            a = SIDE * side + i
            torque = plus(torque, cross(row(y, places[c, ROW + a]), row(U, a)))
        for i in range(3):
            F[j, side, i] = U[SIDE * side, i]
            F[j, side, 3 + i] = torque[i]


@inlined
def put_node(y: Floats, r: int, X: Floats, i: int) -> None:
    """``X_0i = y_r``."""
    for c in range(3):
        X[0, i, c] = y[r, c]


@part
def couple(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Force elements: 0, 2 and 3 see :func:`couple_force`; 1: ``force P(y_L)^T df/dy_1 P(y_1)``."""
    G = np.empty((4, ROWS, 3))
    if flag != 1:
        couple_force(s, w, numbers, flag, G)
        return 0.0
    A, places, forms, state, share = w.A, s.coupling, s.coupling_forms, w.coupled, numbers[SHARE]
    force, yL = numbers[FORCE], w.y0
    if numbers[WEIGHT] != 0.0:
        yL = w.mid
    U, F = np.empty((ROWS, 3)), np.empty((4, 2, 6))
    C, V = np.empty((1, 1, 4, 4)), np.empty((3, 3))
    L, R = np.empty((1, 4, 3)), np.empty((1, 4, 3))
    for c in range(len(places)):
        for k in range(2):
            gradients(forms, places, c, k, w.mid, G, k)
            gradients(forms, places, c, k, w.y1, G, 2 + k)
        for k in range(2):
            for a in range(ROWS):
                put(U, a, (G[k, a, 0], G[k, a, 1], G[k, a, 2]))
            put_twist(places, c, yL, U, F, k)
            for a in range(ROWS):
                put(U, a, right_side(state, c, k, share, G, a))
            put_twist(places, c, w.y1, U, F, 2 + k)
        for one in range(2):
            for two in range(2):
                slot = places[c, SLOT + 2 * one + two]
                if slot < 0:
                    continue
                for i in range(6):
                    for j in range(6):
                        f = F[0, one, i] * F[2, two, j] + F[1, one, i] * F[3, two, j]
                        A[slot, i, j] += force * f
                for i in range(SIDE):
                    put_node(yL, places[c, ROW + SIDE * one + i], L, i)
                    put_node(w.y1, places[c, ROW + SIDE * two + i], R, i)
                    for j in range(SIDE):
                        a, b = SIDE * one + i, SIDE * two + j
                        f = state[c, S] * forms[c, 0, a, b] + state[c, S + 1] * forms[c, 1, a, b]
                        C[0, 0, i, j] = force * share * f
                scalar_block(C, 0, 0, L, R, A, slot, V)
    return 0.0
