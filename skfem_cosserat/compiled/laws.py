"""Stresses of beams with a stored energy, and their derivatives: formulas of :mod:`..law`.

The functions of a law that users had compiled are called through their addresses, point by point;
of other laws Python is called back for all points at once. So these kernels are compiled once, for
all laws and orders: they take a structure of :mod:`.bind` and the numbers of a
step.
"""

from __future__ import annotations

from typing import Any

from ..law import EPS, GAUSS, SMALL, STEP
from ..types import Array, Floats
from .jit import call, call_back, inlined, part, shared
from .numbers import (
    COMPLEX_ENERGY,
    COMPLEX_GRADIENT,
    END,
    ENDS,
    ENERGY,
    ENERGY_BY_LAW,
    GRADIENT,
    HESSIAN,
    MODULI_BY_LAW,
    START,
    STRESSES_BY_LAW,
)
from .simd import local, local_complex

#: places on both sides that differences of fourth order need
SIDES = 4
PLACE, SHARE = GAUSS


# -- functions that are compiled, of one point: x (8, 6) has strains, f (8, 6) stresses ------------


@inlined
def fill(o: Any, k: int, x: Floats, r: int, q: int, share: float) -> None:
    """``x_r = (1 - share) start_q + share strains_q``, without strains that are held."""
    free, start, strains = o.free, o.start, o.strains
    for i in range(6):
        x[r, i] = free[k, i] * ((1.0 - share) * start[q, i] + share * strains[q, i])


@inlined
def energy(o: Any, k: int, x: Floats, out: Floats) -> float:
    """Stored energy of the first strains."""
    call(o.functions[k, ENERGY], x, out, 1)
    return out[0, 0]


@inlined
def stepped(o: Any, k: int, x: Floats, z: Array) -> None:
    """``z_0..5 = x_0`` with a complex step of each strain."""
    for i in range(6):
        for j in range(6):
            z[i, j] = complex(x[0, j], o.steps[k, 0, i] if i == j else 0.0)


@inlined
def stress(o: Any, k: int, x: Floats, f: Floats, z: Array, slope: Array) -> None:
    """Stress f_0 of the strains x_0."""
    functions, free, steps = o.functions, o.free, o.steps
    if functions[k, GRADIENT] != 0:
        call(functions[k, GRADIENT], x, f, 1)
    else:
        stepped(o, k, x, z)
        call(functions[k, COMPLEX_ENERGY], z, slope, 6)
        for i in range(6):
            f[0, i] = slope[i, 0].imag / steps[k, 0, i]
    for i in range(6):
        f[0, i] *= free[k, i]


@inlined
def beside(o: Any, k: int, q: int, x: Floats, f: Floats, z: Array, slope: Array) -> None:
    """Stress in the middle of an increment, and derivatives along it beside, added up."""
    functions, free, steps, along = o.functions, o.free, o.steps, 0.0
    start, strains = o.start, o.strains
    fill(o, k, x, 0, q, 0.5)
    fill(o, k, x, 1, q, 0.5 - PLACE)
    fill(o, k, x, 2, q, 0.5 + PLACE)
    if functions[k, GRADIENT] != 0:
        call(functions[k, GRADIENT], x, f, 3)
        for i in range(6):
            along += free[k, i] * (f[1, i] + f[2, i]) * (strains[q, i] - start[q, i])
    else:
        stepped(o, k, x, z)
        for r in range(6, 8):
            for j in range(6):
                step = STEP * free[k, j] * (strains[q, j] - start[q, j])
                z[r, j] = complex(x[r - 5, j], step)
        call(functions[k, COMPLEX_ENERGY], z, slope, 8)
        for i in range(6):
            f[0, i] = slope[i, 0].imag / steps[k, 0, i]
        along = (slope[6, 0].imag + slope[7, 0].imag) / STEP
    o.along[q] = along
    for i in range(6):
        o.middle[q, i] = free[k, i] * f[0, i]


@shared
def tangent(o: Any, k: int, x: Floats, f: Floats, z: Array, slope: Array, out: Floats) -> None:
    """Derivative of the stresses (1, 36) at the strains x_0."""
    functions, free, steps = o.functions, o.free, o.steps
    if functions[k, HESSIAN] != 0:
        call(functions[k, HESSIAN], x, out, 1)
    elif functions[k, GRADIENT] == 0:
        for i in range(6):
            for j in range(i, 6):
                for r in range(SIDES):
                    for c in range(6):
                        move = (1 + r // 2) * (1 - 2 * (r % 2)) * steps[k, 1, i] if c == i else 0.0
                        z[r, c] = complex(x[0, c] + move, steps[k, 0, j] if c == j else 0.0)
                call(functions[k, COMPLEX_ENERGY], z, slope, SIDES)
                near, far = (slope[0, 0] - slope[1, 0]).imag, (slope[2, 0] - slope[3, 0]).imag
                second = (8.0 * near - far) / (12.0 * steps[k, 1, i] * steps[k, 0, j])
                out[0, 6 * i + j] = out[0, 6 * j + i] = second
    else:
        if functions[k, COMPLEX_GRADIENT] != 0:
            stepped(o, k, x, z)
            call(functions[k, COMPLEX_GRADIENT], z, slope, 6)
            for i in range(6):
                for j in range(6):
                    out[0, 6 * i + j] = slope[i, j].imag / steps[k, 0, i]
        else:
            for i in range(6):
                for r in range(1, 1 + SIDES):  # x + h, x - h, x + 2 h, x - 2 h
                    for c in range(6):
                        x[r, c] = x[0, c]
                    x[r, i] += (1 + (r - 1) // 2) * (2 * (r % 2) - 1) * steps[k, 1, i]
                call(functions[k, GRADIENT], x[1:], f, SIDES)
                for j in range(6):
                    near, far = f[0, j] - f[1, j], f[2, j] - f[3, j]
                    out[0, 6 * i + j] = (8.0 * near - far) / (12.0 * steps[k, 1, i])
        for i in range(6):
            for j in range(i):
                mean = 0.5 * (out[0, 6 * i + j] + out[0, 6 * j + i])
                out[0, 6 * i + j] = out[0, 6 * j + i] = mean
    for i in range(6):
        for j in range(6):
            out[0, 6 * i + j] *= free[k, i] * free[k, j]


@shared
def ask(
    o: Any, ends: bool, flag: int, x: Floats, f: Floats, z: Array, slope: Array, out: Floats
) -> None:
    """Call the functions of compiled laws for energies, stresses or moduli of all points."""
    for q in range(len(o.law)):
        k = o.law[q]
        if k < 0 or o.functions[k, ENERGY] == 0:
            continue
        if flag == ENERGY_BY_LAW:
            fill(o, k, x, 0, q, 0.0)
            o.before[q] = energy(o, k, x, out)
            continue
        fill(o, k, x, 0, q, 1.0)
        if flag == STRESSES_BY_LAW:
            if ends:
                o.after[q] = energy(o, k, x, out)
                beside(o, k, q, x, f, z, slope)
            else:
                stress(o, k, x, f, z, slope)
                for i in range(6):
                    o.middle[q, i] = f[0, i]
        else:
            if ends:
                stress(o, k, x, f, z, slope)
                for i in range(6):
                    o.last[q, i] = f[0, i]
                fill(o, k, x, 0, q, 0.5)
            tangent(o, k, x, f, z, slope, out)
            for i in range(36):
                o.moduli[q, i] = out[0, i]


# -- stresses of all points ------------------------------------------------------------------------


@inlined
def correction(o: Any, k: int, q: int, d: Floats) -> tuple[float, float]:
    """Factor of ``D d`` in the discrete derivative, and ``d . D d``: d_0 is d, d_1 is ``D d``."""
    metric, before, after, middle = o.metric, o.before[q], o.after[q], o.middle
    work, size, square = 0.0, 0.0, 0.0
    for i in range(6):
        d[0, i] = o.strains[q, i] - o.start[q, i]
        d[1, i] = 0.0
    for j in range(6):
        for i in range(6):
            d[1, i] += d[0, j] * metric[k, j, i]
    for i in range(6):
        work += middle[q, i] * d[0, i]
        size += abs(middle[q, i] * d[0, i])
        square += d[1, i] * d[0, i]
    gap, smooth = (after - before) - work, SHARE * (o.along[q] - 2.0 * work)
    size += abs(before) + abs(after)
    if abs(gap - smooth) <= 4.0 * EPS * size + 2.0 * o.noise[k]:
        gap = smooth
    return gap / square if square != 0.0 else 0.0, square


@inlined
def put_stress(o: Any, q: int, ends: bool, decay: float, d: Floats) -> None:
    """Stress of a point; d is for increments."""
    k, S, stiffness, start, strains = o.law[q], o.stresses, o.stiffness, o.start, o.strains
    factor = 0.0
    if k >= 0 and ends:
        factor, _ = correction(o, k, q, d)
    for i in range(6):
        S[q, i] = 0.0
        if k >= 0:
            S[q, i] = o.middle[q, i] + (factor * d[1, i] if ends else 0.0)
        for j in range(6):
            strain = 0.5 * decay * (strains[q, j] - start[q, j])
            if k < 0:
                strain += 0.5 * (start[q, j] + strains[q, j]) if ends else strains[q, j]
            S[q, i] += strain * stiffness[q, j, i]


@inlined
def put_moduli(o: Any, q: int, decay: float, d: Floats) -> None:
    """Twice the derivative of discrete stresses of a law, from the tangent in the middle."""
    k, D = o.law[q], o.moduli
    factor, square = correction(o, k, q, d)
    small = not square > SMALL * SMALL * (abs(o.before[q]) + abs(o.after[q]))
    for j in range(6):
        d[2, j] = o.last[q, j] - o.middle[q, j] - 2.0 * factor * d[1, j]
        for i in range(6):
            d[2, j] -= 0.5 * D[q, 6 * j + i] * d[0, i]
    for i in range(6):
        for j in range(6):
            more = 0.0 if small else factor * o.metric[k, i, j] + d[1, i] * d[2, j] / square
            D[q, 6 * i + j] += 2.0 * more + decay * o.stiffness[q, i, j]
            D[q, 6 * i + j] /= 1.0 + decay


@part
def law_points(o: Any, numbers: Floats, flag: int) -> float:
    """Stored energies at the start of a step, stresses, or their derivative."""
    if flag == MODULI_BY_LAW and o.known[0] != 0:
        return 0.0
    o.known[0] = flag == MODULI_BY_LAW
    ends = numbers[ENDS] != 0.0
    decay = numbers[END] - numbers[START] if ends else 0.0
    x, f, out, d = local((8, 6)), local((8, 6)), local((1, 36)), local((3, 6))
    z, slope = local_complex((8, 6)), local_complex((8, 6))
    ask(o, ends, flag, x, f, z, slope, out)
    if o.called[0] != 0:
        call_back(o.called[0], flag)
    for q in range(len(o.law)):
        if flag == STRESSES_BY_LAW:
            put_stress(o, q, ends, decay, d)
        elif flag == MODULI_BY_LAW and ends and o.law[q] >= 0:
            put_moduli(o, q, decay, d)
    return 0.0
