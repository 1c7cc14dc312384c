"""Compiled coordinates and laws of force elements, as in :mod:`skfem_cosserat.model.coordinates`.

A coordinate xi is a function of two invariants, of which displacements and distances use one. For
all of them the discrete derivative Psi depends on the end of a step through xi_1 only.
"""

from __future__ import annotations

import numpy as np

from ..types import Floats
from .jit import inlined
from .numbers import AMPLITUDE, AT_END, AT_MID, LOST, PI0, STEP, TRAVEL, TURNED, XI0, S

__all__ = ["ANGLE", "DISPLACEMENT", "DISTANCE", "continued", "respond", "value"]

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
