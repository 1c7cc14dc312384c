"""Springs, dampers and actuators in kernels."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..types import Floats, IndexArray
from .elements import scalar_block
from .jit import inlined, part
from .numbers import (
    AMPLITUDE,
    AT_END,
    AT_MID,
    ENDS,
    FORCE,
    GROUND,
    LOST,
    PI0,
    SHARE,
    STEP,
    TRAVEL,
    TURNED,
    TURNS,
    WEIGHT,
    XI0,
    S,
)
from .small import Vector, cross, dot, increase, minus, plus, put, row, times

__all__ = [
    "ANGLE",
    "DISPLACEMENT",
    "DISTANCE",
    "KIND",
    "ROW",
    "SIDE",
    "SLACK",
    "SLOT",
    "continued",
    "couple",
    "couple_force",
    "gradients",
    "respond",
    "right_side",
    "value",
]


# --------------------------------------------------------------------------------------------------
# Compiled coordinates and laws of force elements, as in :mod:`skfem_cosserat.model.coordinates`.
#
# A coordinate xi is a function of two invariants, of which displacements and distances use one. For
# all of them the discrete derivative Psi depends on the end of a step through xi_1 only.

DISPLACEMENT, DISTANCE, ANGLE = range(3)
#: columns of ``s.coupling_law``
STIFFNESS, DAMPING, NEUTRAL = range(3)
#: below, x/sin(x) is a series
SMALL = 0.1
#: force by the coordinate, by its rate, by its end in a step
Force = tuple[float, float, float, float, float]
Two = tuple[float, float]


@inlined
def value(kind: int, a: float, b: float) -> float:
    """``xi``, the principal value of an angle."""
    if kind == DISTANCE:
        return np.sqrt(a)
    if kind == ANGLE:
        return np.arctan2(b, a)
    return a


@inlined
def continued(kind: int, a: float, b: float, before: float) -> float:
    """``xi``, an angle by less than half a turn from the value `before`."""
    xi = value(kind, a, b)
    if kind == ANGLE:
        xi -= 2.0 * np.pi * np.floor((xi - before) / (2.0 * np.pi) + 0.5)
    return xi


@inlined
def slope(kind: int, a: float, b: float) -> Two:
    """``dxi/dpi``."""
    if kind == DISTANCE:
        return 0.5 / np.sqrt(a), 0.0
    if kind == ANGLE:
        square = a * a + b * b
        return -b / square, a / square
    return 1.0, 0.0


@inlined
def curvature(kind: int, a: float, b: float) -> tuple[float, float, float]:
    """``d^2 xi/dpi^2``: (1, 1), (1, 2), (2, 2)."""
    if kind == DISTANCE:
        return -0.25 / (a * np.sqrt(a)), 0.0, 0.0
    if kind == ANGLE:
        fourth = (a * a + b * b) ** 2
        return 2 * a * b / fourth, (b * b - a * a) / fourth, -2 * a * b / fourth
    return 0.0, 0.0, 0.0


@inlined
def over_sine(x: float) -> Two:
    """``x/sin(x)`` and its derivative."""
    if abs(x) < SMALL:
        u = x * x
        f = 1 / 6 + u * (7 / 360 + u * (31 / 15120 + u * (127 / 604800 + u * 73 / 3421440)))
        g = 7 / 90 + u * (31 / 2520 + u * (127 / 75600 + u * 73 / 342144))
        return 1 + u * f, x * (1 / 3 + u * g)
    sine = np.sin(x)
    return x / sine, (sine - x * np.cos(x)) / (sine * sine)


@inlined
def discrete_slope(kind: int, before: float, xi: float) -> tuple[Two, Two]:
    """``Psi`` and its derivative by the end xi of a step."""
    if kind == DISTANCE:
        f = 1.0 / (before + xi)
        return (f, 0.0), (-f * f, 0.0)
    if kind == ANGLE:
        mean = 0.5 * (before + xi)
        factor, rate = over_sine(0.5 * (xi - before))
        s, c = np.sin(mean), np.cos(mean)
        by = 0.5 * (-rate * s - factor * c), 0.5 * (rate * c - factor * s)
        return (-factor * s, factor * c), by
    return (1.0, 0.0), (0.0, 0.0)


@inlined
def discrete_law(slack: bool, k: float, c: float, e0: float, e1: float, h: float) -> Force:
    """Force, its derivatives (by e_1 only), and what is dissipated."""
    change = e1 - e0
    if not slack:
        sigma = 0.5 * k * (e0 + e1) + c * change / h
        return sigma, 0.0, 0.0, 0.5 * k + c / h, c * change * change / h
    up0, up1 = max(e0, 0.0), max(e1, 0.0)
    quotient, by = 0.0, 0.0
    if e0 > 0.0 and e1 > 0.0:
        quotient, by = 0.5 * (up0 + up1), 0.5
    elif e0 > 0.0 or e1 > 0.0:
        quotient = 0.5 * (up1 * up1 - up0 * up0) / change
        by = (up1 - quotient) / change
    spring = k * quotient
    sigma = spring + c * (up1 - up0) / h
    if not sigma > 0.0:
        return 0.0, 0.0, 0.0, 0.0, -spring * change
    by = k * by + (c / h if e1 > 0.0 else 0.0)
    return sigma, 0.0, 0.0, by, (sigma - spring) * change


@inlined
def midpoint_law(
    slack: bool, k: float, c: float, e: float, rate: float, e0: float, e1: float, h: float
) -> Force:
    """Force at the midpoint's e, its derivatives by e, `rate` and e_1, what is dissipated."""
    if not slack:
        return k * e + c * rate, k, c, 0.0, h * c * rate * rate
    spring = k * max(e, 0.0)
    sigma = spring + c * (max(e1, 0.0) - max(e0, 0.0)) / h
    if not sigma > 0.0:
        return 0.0, 0.0, 0.0, 0.0, -h * spring * rate
    by, by_end = k if e > 0.0 else 0.0, c / h if e1 > 0.0 else 0.0
    return sigma, by, 0.0, by_end, h * (sigma - spring) * rate


@inlined
def respond(
    kind: int,
    slack: bool,
    discrete: bool,
    laws: Floats,
    state: Floats,
    i: int,
    a: float,
    b: float,
    a1: float,
    b1: float,
) -> None:
    """Forces s, their slopes, and what they do, in ``state_i``; (a, b) at the midpoint, then y_1.

    `discrete`: that conserve energy; else those of the midpoint configuration.
    """
    k, c, neutral = laws[i, STIFFNESS], laws[i, DAMPING], laws[i, NEUTRAL]
    h, xi0 = state[i, STEP], state[i, XI0]
    xi1 = continued(kind, a1, b1, xi0)
    e0, e1, end = xi0 - neutral, xi1 - neutral, slope(kind, a1, b1)
    if discrete:
        J, q = discrete_slope(kind, xi0, xi1)
        travel = xi1 - xi0
        found = discrete_law(slack, k, c, e0, e1, h)
        sigma = found[0] - state[i, AMPLITUDE]
        for n in range(2):
            for o in range(2):
                state[i, AT_MID + 2 * n + o] = 0.0
                state[i, AT_END + 2 * n + o] = (J[n] * found[3] + sigma * q[n]) * end[o]
    else:
        J, X = slope(kind, a, b), curvature(kind, a, b)
        da, db = a1 - state[i, PI0], b1 - state[i, PI0 + 1]
        travel = J[0] * da + J[1] * db
        e = continued(kind, a, b, xi0) - neutral
        found = midpoint_law(slack, k, c, e, travel / h, e0, e1, h)
        sigma = found[0] - state[i, AMPLITUDE]
        rate = (X[0] * da + X[1] * db) / h, (X[1] * da + X[2] * db) / h
        for n in range(2):
            for o in range(2):
                by = found[1] * J[o] + found[2] * rate[o]
                state[i, AT_MID + 2 * n + o] = J[n] * by + sigma * X[n + o]
                state[i, AT_END + 2 * n + o] = J[n] * (found[2] * J[o] / h + found[3] * end[o])
    state[i, S], state[i, S + 1] = sigma * J[0], sigma * J[1]
    state[i, TRAVEL], state[i, LOST] = travel, found[4]
    state[i, TURNED] = (xi1 - value(kind, a1, b1)) / (2.0 * np.pi)


# -- compiled springs, dampers, cables and actuators on one scalar coordinate each -----------------
#
# As in :mod:`skfem_cosserat.model.force_elements`: invariants ``pi_k = y . A_k y / 2`` of at most
# two vertices, four rows each; the force on their rows is ``sum_k s_k A_k y_mid``. Coordinates are
# displacements, distances and angles. The laws above give s and its slopes.

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
            discrete, slack = numbers[ENDS] != 0.0, places[c, SLACK] != 0
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
