"""Springs, dampers, cables, bushings and actuators in kernels, and loads that follow the motion.

As in :mod:`skfem_cosserat.model.force_elements`: the force of an element on its rows of y is
``sum_k s_k A_k y`` at the midpoint, with its invariants ``pi_k = y . A_k y / 2`` of at most two
vertices, four rows each. Its coordinates are displacements, then one that may be of another kind;
see :mod:`skfem_cosserat.model.coordinates`.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..model.coordinates import NEAR, NEAR_ONE, QUADRATURE, TURN_POWERS
from ..types import Floats, IndexArray
from .elements import pace, scalar_block
from .jit import call_back, inlined, part, shared
from .numbers import (
    AMPLITUDE,
    END,
    ENDS,
    FORCE,
    FORCES_OF_LAWS,
    GROUND,
    LOST,
    NUMERICAL,
    PI0,
    PUSHED,
    REACH,
    SHARE,
    SLOPES_OF_LAWS,
    START,
    STEP,
    TRAVEL,
    TURNED,
    TURNS,
    XI0,
    S,
)
from .simd import clear, copy, local
from .small import (
    Rotation,
    Vector,
    combine,
    cross,
    directors,
    dot,
    increase,
    minus,
    plus,
    pulled,
    row,
    times,
    unit,
)
from .tables import (
    ANGLE,
    DAMPING,
    DISTANCE,
    FIRST,
    FORCES,
    FOUND,
    KIND,
    LAST,
    LEADING,
    MOST_PI,
    MOST_XI,
    NEUTRAL,
    OWN,
    RADIUS,
    ROTATION,
    ROW,
    ROWS,
    SIDE,
    SIGN,
    SLACK,
    SLOTS,
    STIFFNESS,
)

# -- coordinates xi of invariants pi ---------------------------------------------------------------

#: rows of invariants P: at the midpoint, at the end and at the start of a step
AT_MID, AT_END, BEGIN = range(3)
#: below, x/sin(x) is a series
SMALL = 0.1


@inlined
def numbers_of_kind(kind: int) -> tuple[int, int]:
    """Components and invariants of a coordinate."""
    if kind == ROTATION:
        return 3, 4
    return 1, 2 if kind in (RADIUS, ANGLE) else 1


@inlined
def over_sine(x: float) -> tuple[float, float]:
    """``x/sin(x)`` and its derivative."""
    if abs(x) < SMALL:
        u = x * x
        f = 1 / 6 + u * (7 / 360 + u * (31 / 15120 + u * (127 / 604800 + u * 73 / 3421440)))
        g = 7 / 90 + u * (31 / 2520 + u * (127 / 75600 + u * 73 / 342144))
        return 1 + u * f, x * (1 / 3 + u * g)
    sine = np.sin(x)
    return x / sine, (sine - x * np.cos(x)) / (sine * sine)


@shared
def turn_factors(c: float) -> Vector:
    """``phi = theta/sin(theta)`` of the cosine c, phi' and phi''."""
    u = 1 - c
    if abs(u) < NEAR_ONE:
        phi, first, second = 0.0, 0.0, 0.0
        for n in range(len(TURN_POWERS) - 1, -1, -1):
            phi = phi * u + TURN_POWERS[n, 0]
            first = first * u + TURN_POWERS[n, 1]
            second = second * u + TURN_POWERS[n, 2]
        return phi, first, second
    square = 1 - c * c
    sine = np.sqrt(square)  # NaN below -1, so that Newton's method steps back
    phi = np.arctan2(sine, c) / sine
    first = (c * phi - 1) / square
    return phi, first, (phi + 3 * c * first) / square


@shared
def turn_quotient(c0: float, c1: float) -> tuple[float, float]:
    """``(phi_1 - phi_0)/(c_1 - c_0)`` and its derivative by ``c_1``."""
    step = c1 - c0
    if abs(step) < 0.05 * (1 + min(c0, c1)):
        mean, rate = 0.0, 0.0
        for n in range(len(QUADRATURE)):
            share, weight = QUADRATURE[n, 0], QUADRATURE[n, 1]
            inside = turn_factors(c0 + share * step)
            mean += weight * inside[1]
            rate += weight * share * inside[2]
        return mean, rate
    one = turn_factors(c1)
    quotient = (one[0] - turn_factors(c0)[0]) / step
    return quotient, (one[1] - quotient) / step


@shared
def value(kind: int, d: int, pi: Floats, p: int, xi: Floats, x: int) -> None:
    """``xi_x`` of ``pi_p``: an angle's principal value."""
    for i in range(d):
        xi[x, i] = pi[p, i]
    a = pi[p, d]
    if kind == DISTANCE:
        xi[x, d] = np.sqrt(a + NEAR)
    elif kind == RADIUS:
        xi[x, d] = np.sqrt(a * a + pi[p, d + 1] ** 2 + NEAR)
    elif kind == ANGLE:
        xi[x, d] = np.arctan2(pi[p, d + 1], a)
    elif kind == ROTATION:
        phi = turn_factors(pi[p, d + 3] - 0.5)[0]
        for i in range(3):
            xi[x, d + i] = phi * pi[p, d + i]
    else:
        xi[x, d] = a


@inlined
def continued(kind: int, d: int, pi: Floats, p: int, before: float, xi: Floats, x: int) -> None:
    """``xi_x``, an angle by less than half a turn from the value `before`."""
    value(kind, d, pi, p, xi, x)
    if kind == ANGLE:
        xi[x, d] -= 2.0 * np.pi * np.floor((xi[x, d] - before) / (2.0 * np.pi) + 0.5)


@inlined
def shifts(kind: int, d: int, J: Floats, j: int) -> None:
    """``J_j``, of displacements only."""
    m, k = numbers_of_kind(kind)
    for i in range(d + m):
        for n in range(d + k):
            J[j, i, n] = 1.0 if i == n else 0.0


@inlined
def bordered(d: int, diagonal: float, column: Vector, J: Floats, j: int) -> None:
    """``J_j`` of a rotation vector: ``[diagonal I, column]``."""
    for i in range(3):
        J[j, d + i, d + i] = diagonal
        J[j, d + i, d + 3] = column[i]


@shared
def slope(kind: int, d: int, pi: Floats, p: int, J: Floats, j: int) -> None:
    """``J_j = dxi/dpi`` at ``pi_p``."""
    shifts(kind, d, J, j)
    a = pi[p, d]
    if kind == DISTANCE:
        J[j, d, d] = 0.5 / np.sqrt(a + NEAR)
    elif kind == RADIUS:
        b = pi[p, d + 1]
        r = np.sqrt(a * a + b * b + NEAR)
        J[j, d, d], J[j, d, d + 1] = a / r, b / r
    elif kind == ANGLE:
        b = pi[p, d + 1]
        J[j, d, d], J[j, d, d + 1] = -b / (a * a + b * b), a / (a * a + b * b)
    elif kind == ROTATION:
        phi = turn_factors(pi[p, d + 3] - 0.5)
        column = phi[1] * a, phi[1] * pi[p, d + 1], phi[1] * pi[p, d + 2]
        bordered(d, phi[0], column, J, j)


@shared
def curvature(kind: int, d: int, pi: Floats, p: int, X: Floats) -> None:
    """``X = d^2 xi/dpi^2`` of the last coordinate at ``pi_p``."""
    clear(X)
    a = pi[p, d]
    if kind == DISTANCE:
        X[0, 0, 0] = -0.25 / (a + NEAR) ** 1.5
    elif kind == RADIUS:
        b = pi[p, d + 1]
        cube = (a * a + b * b + NEAR) ** 1.5
        X[0, 0, 0], X[0, 1, 1] = b * b / cube, a * a / cube
        X[0, 0, 1] = X[0, 1, 0] = -a * b / cube
    elif kind == ANGLE:
        b = pi[p, d + 1]
        fourth = (a * a + b * b) ** 2
        X[0, 0, 0], X[0, 1, 1] = 2 * a * b / fourth, -2 * a * b / fourth
        X[0, 0, 1] = X[0, 1, 0] = (b * b - a * a) / fourth
    elif kind == ROTATION:
        phi = turn_factors(pi[p, d + 3] - 0.5)
        for i in range(3):
            X[i, i, 3] = X[i, 3, i] = phi[1]
            X[i, 3, 3] = phi[2] * pi[p, d + i]


@shared
def discrete(kind: int, d: int, P: Floats, xi0: float, xi1: float, J: Floats) -> None:
    """``J_0 = Psi``; xi0, xi1 of a distance or an angle."""
    shifts(kind, d, J, 0)
    if kind == DISTANCE:
        J[0, d, d] = 1.0 / (xi0 + xi1)
    elif kind == RADIUS:
        for n in range(d, d + 2):
            J[0, d, n] = (P[BEGIN, n] + P[AT_END, n]) / (xi0 + xi1)
    elif kind == ANGLE:
        mean = 0.5 * (xi0 + xi1)
        factor = over_sine(0.5 * (xi1 - xi0))[0]
        J[0, d, d], J[0, d, d + 1] = -factor * np.sin(mean), factor * np.cos(mean)
    elif kind == ROTATION:
        c0, c1 = P[BEGIN, d + 3] - 0.5, P[AT_END, d + 3] - 0.5
        f = 0.5 * turn_quotient(c0, c1)[0]
        diagonal = 0.5 * (turn_factors(c0)[0] + turn_factors(c1)[0])
        x, y = f * (P[BEGIN, d] + P[AT_END, d]), f * (P[BEGIN, d + 1] + P[AT_END, d + 1])
        bordered(d, diagonal, (x, y, f * (P[BEGIN, d + 2] + P[AT_END, d + 2])), J, 0)


@shared
def discrete_slope(kind: int, d: int, P: Floats, xi0: float, xi1: float, X: Floats) -> None:
    """``X = dPsi/dpi_1`` of the last coordinate."""
    clear(X)
    a = P[AT_END, d]
    if kind == DISTANCE:
        X[0, 0, 0] = -0.5 / (xi1 * (xi0 + xi1) ** 2)
    elif kind == RADIUS:
        for i in range(2):
            for n in range(2):
                both = (P[BEGIN, d + i] + P[AT_END, d + i]) / (xi0 + xi1)
                one = 1.0 if i == n else 0.0
                X[0, i, n] = (one - both * P[AT_END, d + n] / xi1) / (xi0 + xi1)
    elif kind == ANGLE:
        b = P[AT_END, d + 1]
        mean = 0.5 * (xi0 + xi1)
        factor, rate = over_sine(0.5 * (xi1 - xi0))
        s, c = np.sin(mean), np.cos(mean)
        one, two = 0.5 * (-rate * s - factor * c), 0.5 * (rate * c - factor * s)
        X[0, 0, 0], X[0, 1, 0] = -b * one / (a * a + b * b), -b * two / (a * a + b * b)
        X[0, 0, 1], X[0, 1, 1] = a * one / (a * a + b * b), a * two / (a * a + b * b)
    elif kind == ROTATION:
        c0, c1 = P[BEGIN, d + 3] - 0.5, P[AT_END, d + 3] - 0.5
        quotient, rate = turn_quotient(c0, c1)
        first = turn_factors(c1)[1]
        for i in range(3):
            X[i, i, 3], X[i, 3, i] = 0.5 * first, 0.5 * quotient
            X[i, 3, 3] = 0.5 * rate * (P[BEGIN, d + i] + P[AT_END, d + i])


# -- laws ------------------------------------------------------------------------------------------

#: factors of K and C in the derivatives of a law's force by the stretch at the midpoint, by its
#: rate, and by the stretch at the end
BY_E, BY_RATE, BY_END, DAMPED_END = range(4)
#: rows of vectors (m,): coordinates at the end and at the midpoint, their change or rate, forces
XI1, XI, CHANGE, SIGMA = range(4)
Factors = tuple[float, float, float, float]


@inlined
def slack_law(k: float, e: float, e0: float, e1: float, ends: bool) -> Vector:
    """Force of the spring, with its derivatives by e and by the end."""
    if not ends:
        return k * max(e, 0.0), 1.0 if e > 0.0 else 0.0, 0.0
    up0, up1 = max(e0, 0.0), max(e1, 0.0)
    if e0 > 0.0 and e1 > 0.0:
        return 0.5 * k * (up0 + up1), 0.0, 0.5
    if e0 > 0.0 or e1 > 0.0:
        quotient = 0.5 * (up1 * up1 - up0 * up0) / (e1 - e0)
        return k * quotient, 0.0, (up1 - quotient) / (e1 - e0)
    return 0.0, 0.0, 0.0


@shared
def linear(
    laws: Floats, state: Floats, c: int, m: int, V: Floats, ends: bool, decay: float
) -> Factors:
    """Forces of springs and dampers into V, dissipated energy into the state.

    Gives factors of the derivatives.
    """
    h = state[c, STEP]
    lost, numerical = 0.0, 0.0
    for i in range(m):
        force, damping, more = 0.0, 0.0, 0.0
        for n in range(m):
            k, change = laws[c, STIFFNESS, i, n], V[CHANGE, n]
            xi = 0.5 * (state[c, XI0 + n] + V[XI1, n]) if ends else V[XI, n]
            force += k * (xi - laws[c, NEUTRAL, 0, n])
            damping += laws[c, DAMPING, i, n] * change
            more += 0.5 * decay * k * change
        lost += damping * V[CHANGE, i] / h
        numerical += more * V[CHANGE, i]
        V[SIGMA, i] = force + damping / h + more - state[c, AMPLITUDE + i]
    if h > 0.0:  # a step back gives what was lost
        lost = max(lost, 0.0)
    state[c, LOST], state[c, NUMERICAL] = lost + numerical, numerical
    if ends:
        return 0.0, 0.0, 0.5 * (1 + decay), 1 / h
    return 1.0, 1.0, 0.0, 0.0


@shared
def slack_at_end(laws: Floats, state: Floats, c: int, V: Floats) -> Factors:
    """Forces of a cable by the velocity at the end of a step, in V."""
    found = linear(laws, state, c, 1, V, False, 0.0)
    slack, sign = -state[c, AMPLITUDE], laws[c, NEUTRAL, SIGN, 0]
    if sign * (V[XI, 0] - laws[c, NEUTRAL, 0, 0]) > 0.0 and sign * (V[SIGMA, 0] - slack) > 0.0:
        return found
    V[SIGMA, 0] = slack
    return 0.0, 0.0, 0.0, 0.0


@shared
def slack(laws: Floats, state: Floats, c: int, V: Floats, ends: bool, decay: float) -> Factors:
    """Forces of a cable into V, dissipated energy into the state; factors of the derivatives."""
    K, C, h = laws[c, STIFFNESS, 0, 0], laws[c, DAMPING, 0, 0], state[c, STEP]
    neutral, sign = laws[c, NEUTRAL, 0, 0], laws[c, NEUTRAL, SIGN, 0]
    e0, e1 = sign * (state[c, XI0] - neutral), sign * (V[XI1, 0] - neutral)
    spring, by_e, by_end = slack_law(K, sign * (V[XI, 0] - neutral), e0, e1, ends)
    own = 0.5 * h * decay * K
    sigma = spring + (C + own) * (max(e1, 0.0) - max(e0, 0.0)) / h
    pulls, taut = sigma > 0.0, 1.0 if e1 > 0.0 else 0.0
    if not pulls:
        sigma, by_e, by_end, taut = 0.0, 0.0, 0.0, 0.0
    change = sign * V[CHANGE, 0]
    V[SIGMA, 0] = sign * sigma - state[c, AMPLITUDE]
    lost = (sigma - spring) * change
    state[c, LOST] = lost
    state[c, NUMERICAL] = lost * own / (C + own) if C + own > 0.0 else 0.0
    return by_e, 0.0, by_end + 0.5 * decay * taut, taut / h


@inlined
def called(laws: Floats, state: Floats, c: int, m: int, V: Floats, ends: bool) -> Factors:
    """Forces that a law of Python has left in the table, into V; what they follow from into it."""
    work = 0.0
    for i in range(m):
        for r in range(SIGMA):
            laws[c, NEUTRAL, FOUND + r, i] = V[r, i]
        V[SIGMA, i] = laws[c, NEUTRAL, FORCES, i]
        work -= V[SIGMA, i] * V[CHANGE, i]
    state[c, PUSHED] = laws[c, NEUTRAL, SIGN, 1] * work
    if ends:
        return 0.0, 0.0, 1.0, 0.0
    return 1.0, 1.0, 0.0, 0.0


@shared
def respond(
    s: Any, state: Floats, c: int, numbers: Floats, P: Floats, V: Floats, J: Floats
) -> Factors:
    """Forces s and what they do, in ``state_c``; P: invariants.

    ``J_0`` is what makes s of sigma.
    """
    places, laws = s.coupling, s.coupling_law
    kind, d = places[c, KIND], places[c, LEADING]
    m, k = numbers_of_kind(kind)
    m, k = d + m, d + k
    last = state[c, XI0 + d]
    ends, decay = numbers[ENDS] != 0.0, 0.0
    for n in range(k):
        P[BEGIN, n] = state[c, PI0 + n]
    continued(kind, d, P, AT_END, last, V, XI1)
    if ends:
        decay = numbers[END] - numbers[START]
        discrete(kind, d, P, last, V[XI1, d], J)
        for i in range(m):
            V[CHANGE, i] = V[XI1, i] - state[c, XI0 + i]
    else:
        continued(kind, d, P, AT_MID, last, V, XI)
        slope(kind, d, P, AT_MID, J, 0)
        for i in range(m):
            V[CHANGE, i] = 0.0
            for n in range(k):
                V[CHANGE, i] += J[0, i, n] * (P[AT_END, n] - P[BEGIN, n])
    found = (0.0, 0.0, 0.0, 0.0)
    late = numbers[REACH] != 0.0
    if places[c, SLACK] == OWN:
        found = called(laws, state, c, m, V, ends)
    elif places[c, SLACK] == 0:
        found = linear(laws, state, c, m, V, ends, decay)
    elif late:
        found = slack_at_end(laws, state, c, V)
    else:
        found = slack(laws, state, c, V, ends, decay)
    end, x = AT_END, XI1
    if late:
        end, x = AT_MID, XI
    for n in range(k):
        state[c, S + n] = 0.0
        for i in range(m):
            state[c, S + n] += J[0, i, n] * V[SIGMA, i]
    for i in range(m):
        state[c, TRAVEL + i] = V[CHANGE, i]
    state[c, TURNED] = 0.0
    if kind == ANGLE:
        whole = V[x, d] - np.arctan2(P[end, d + 1], P[end, d])
        state[c, TURNED] = whole / (2.0 * np.pi)
    elif kind == ROTATION:
        for i in range(d, d + 3):
            state[c, TURNED] = max(state[c, TURNED], abs(V[x, i] - state[c, XI0 + i]))
    return found


@shared
def slopes(
    s: Any,
    state: Floats,
    c: int,
    found: Factors,
    ends: bool,
    P: Floats,
    V: Floats,
    J: Floats,
    X: Floats,
    H: Floats,
) -> None:
    """``H``: derivatives of s by the invariants at the midpoint and at the end.

    After :func:`respond`; ``J_1``, ``J_2`` and X are scratch.
    """
    laws, h = s.coupling_law, state[c, STEP]
    kind, d = s.coupling[c, KIND], s.coupling[c, LEADING]
    own, last = numbers_of_kind(kind)
    m, k = d + own, d + last
    at = AT_MID
    if ends:
        at = AT_END
        discrete_slope(kind, d, P, state[c, XI0 + d], V[XI1, d], X)
    else:
        curvature(kind, d, P, AT_MID, X)
    slope(kind, d, P, AT_END, J, 1)
    clear(H)
    # J_2: derivatives of the force by invariants at the midpoint, then at the end
    for where in range(2):
        for i in range(m):
            for n in range(k):
                J[2, i, n] = 0.0
        for i in range(m):
            for o in range(m):
                K, C = laws[c, STIFFNESS, i, o], laws[c, DAMPING, i, o]
                if where == AT_MID:
                    K, C = found[BY_E] * K, found[BY_RATE] * C
                    for n in range(k):
                        J[2, i, n] += K * J[0, o, n]
                    if o >= d:
                        for n in range(last):
                            rate = 0.0
                            for a in range(last):
                                rate += X[o - d, n, a] * (P[AT_END, d + a] - P[BEGIN, d + a])
                            J[2, i, d + n] += C * rate / h
                else:
                    by_end = found[BY_END] * K + found[DAMPED_END] * C
                    by_mid = found[BY_RATE] * C / h
                    for n in range(k):
                        J[2, i, n] += by_end * J[1, o, n] + by_mid * J[0, o, n]
        for a in range(k):
            for n in range(k):
                for i in range(m):
                    H[where, a, n] += J[0, i, a] * J[2, i, n]
        if where == at:
            for i in range(own):
                for a in range(last):
                    for n in range(last):
                        H[where, d + a, d + n] += V[SIGMA, d + i] * X[i, a, n]


# -- forces and tangents ---------------------------------------------------------------------------


@shared
def gradients(s: Any, c: int, y: Floats, G: Floats, j: int, P: Floats, p: int) -> None:
    """``G_j+k = A_k y`` (8, 3), and ``P_p = pi``."""
    places, entries, factors = s.coupling, s.coupling_entry, s.coupling_factor
    count = places[c, LEADING] + numbers_of_kind(places[c, KIND])[1]
    for k in range(j, j + count):
        for a in range(ROWS):
            for i in range(3):
                G[k, a, i] = 0.0
    for e in range(places[c, FIRST], places[c, LAST]):
        k, a, r, f = j + entries[e, 0], entries[e, 1], places[c, ROW + entries[e, 2]], factors[e]
        for i in range(3):
            G[k, a, i] += f * y[r, i]
    for k in range(count):
        pi = 0.0
        for a in range(ROWS):
            r = places[c, ROW + a]
            for i in range(3):
                pi += G[j + k, a, i] * y[r, i]
        P[p, k] = 0.5 * pi


@shared
def ask_laws(
    s: Any, w: Any, numbers: Floats, stage: int, G: Floats, P: Floats, V: Floats, J: Floats
) -> None:
    """Let Python find the forces of its laws, for all at once, or their slopes."""
    places = s.coupling
    if s.called[0] == 0:
        return
    for c in range(len(places)):
        if places[c, SLACK] == OWN:
            gradients(s, c, w.later, G, 0, P, AT_END)
            gradients(s, c, w.mid, G, 0, P, AT_MID)
            respond(s, w.coupled, c, numbers, P, V, J)
    call_back(s.called[0], stage)


@inlined
def force_on(state: Floats, c: int, count: int, G: Floats, a: int) -> Vector:
    """Force on row a, of the gradients of the invariants."""
    f = (0.0, 0.0, 0.0)
    for k in range(count):
        f = plus(f, times(state[c, S + k], (G[k, a, 0], G[k, a, 1], G[k, a, 2])))
    return f


@shared
def couple_force(
    s: Any, w: Any, numbers: Floats, flag: int, G: Floats, P: Floats, V: Floats, J: Floats
) -> None:
    """Flag 0: evaluate, and add to the internal force; 2: add to that of predicted stresses.

    3: at the start of the step. G (7, 8, 3), P (3, 7), V (4, 6) and J (1, 6, 7) are scratch.
    """
    y0, y1, places, state = w.y0, w.y1, s.coupling, w.coupled
    out = w.internal
    if flag == 2:
        out = w.R_mixed
    rows = out.shape[0]
    if flag == 0:
        ask_laws(s, w, numbers, FORCES_OF_LAWS, G, P, V, J)
    for c in range(len(places)):
        kind, d = places[c, KIND], places[c, LEADING]
        m, count = numbers_of_kind(kind)
        m, count = d + m, d + count
        if flag == 3:
            gradients(s, c, y0, G, 0, P, BEGIN)
            value(kind, d, P, BEGIN, V, XI)
            for i in range(m):
                state[c, XI0 + i] = V[XI, i]
            state[c, XI0 + d] += 2.0 * np.pi * state[c, TURNS]
            if numbers[REACH] != 0.0:
                gradients(s, c, w.earlier, G, 0, P, BEGIN)
            for n in range(count):
                state[c, PI0 + n] = P[BEGIN, n]
            continue
        if flag == 0:
            gradients(s, c, w.later, G, 0, P, AT_END)
        gradients(s, c, w.mid, G, 0, P, AT_MID)
        if flag == 0:
            respond(s, state, c, numbers, P, V, J)
            state[c, GROUND] = 0.0
        for a in range(ROWS):
            f = force_on(state, c, count, G, a)
            r = places[c, ROW + a]
            if r < rows:
                increase(out, r, f)
            elif flag == 0:
                state[c, GROUND] += dot(f, minus(row(y1, r), row(y0, r)))


@shared
def put_twist(places: IndexArray, c: int, y: Floats, G: Floats, k: int, F: Floats, j: int) -> None:
    """``F_j`` (12,): ``P_int(y)^T G_k`` of both sides."""
    for side in range(2):
        torque = (0.0, 0.0, 0.0)
        for i in range(1, SIDE):
            a = SIDE * side + i
            f = G[k, a, 0], G[k, a, 1], G[k, a, 2]
            torque = plus(torque, cross(row(y, places[c, ROW + a]), f))
        for i in range(3):
            F[j, 6 * side + i] = G[k, SIDE * side, i]
            F[j, 6 * side + 3 + i] = torque[i]


@part
def couple(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Force elements: 0, 2, 3 see :func:`couple_force`; 1: ``force P(y_L)^T df/dy_1 P(y_1)``."""
    G, J = local((2 * MOST_PI, ROWS, 3)), local((3, MOST_XI, MOST_PI))
    P, V = local((3, MOST_PI)), local((4, MOST_XI))
    if flag != 1:
        couple_force(s, w, numbers, flag, G, P, V, J)
        return 0.0
    A, places, entries, factors, state = (
        w.A,
        s.coupling,
        s.coupling_entry,
        s.coupling_factor,
        w.coupled,
    )
    force, share, yL = numbers[FORCE], numbers[SHARE], pulled(w.y0, w.mid, numbers)
    # H: derivatives of s by the invariants at the midpoint and at the end; sums of s_k A_k by sides
    X, H, by_sides = local((3, 4, 4)), local((2, MOST_PI, MOST_PI)), local((4, SIDE, SIDE))
    left, right, turned = local((MOST_PI, 12)), local((2 * MOST_PI, 12)), local(12)
    ask_laws(s, w, numbers, SLOPES_OF_LAWS, G, P, V, J)
    for c in range(len(places)):
        gradients(s, c, w.mid, G, 0, P, AT_MID)
        gradients(s, c, w.later, G, MOST_PI, P, AT_END)
        found = respond(s, state, c, numbers, P, V, J)
        slopes(s, state, c, found, numbers[ENDS] != 0.0, P, V, J, X, H)
        clear(by_sides)
        for e in range(places[c, FIRST], places[c, LAST]):
            a, b = entries[e, 1], entries[e, 2]
            k = 2 * (a // SIDE) + b // SIDE
            by_sides[k, a % SIDE, b % SIDE] += state[c, S + entries[e, 0]] * factors[e]
        count = places[c, LEADING] + numbers_of_kind(places[c, KIND])[1]
        for k in range(count):
            put_twist(places, c, yL, G, k, left, k)
            put_twist(places, c, w.y1, G, k, right, k)
            put_twist(places, c, w.y1, G, MOST_PI + k, right, MOST_PI + k)
        for k in range(count):
            for j in range(12):
                turned[j] = 0.0
            for n in range(count):
                here, end = force * (H[0, k, n] * share), force * (H[1, k, n] * pace(numbers))
                for j in range(12):
                    turned[j] += here * right[n, j] + end * right[MOST_PI + n, j]
            for one in range(2):
                for two in range(2):
                    slot = places[c, SLOTS + 2 * one + two]
                    if slot < 0:
                        continue
                    for i in range(6):
                        f = left[k, 6 * one + i]
                        for j in range(6):
                            A[slot, i, j] += f * turned[6 * two + j]
        for one in range(2):
            for two in range(2):
                slot = places[c, SLOTS + 2 * one + two]
                if slot < 0:
                    continue
                a, b = places[c, ROW + SIDE * one], places[c, ROW + SIDE * two]
                scalar_block(by_sides, 2 * one + two, force * share, yL, a, w.y1, b, A, slot)
    return 0.0


# -- loads that follow the motion: moments, forces fixed in bodies and sections --------------------
#
# Forces fixed in a body are components times its directors, so linear in y: ``f_a = C_ab y_b`` with
# scalars C (4, 4) for a pair of frames. A moment m acts on directors as ``m x d^i / 2``, d^i the
# reciprocal ones: at midpoints triads are not orthonormal. Both are taken at ``w.mid``.


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
