"""Beams of which some have a stored energy: stresses and their derivative come from elsewhere.

Strains and forces are those of :mod:`.elements`, :data:`WIDTH` elements at a time; between them all
strains are handed at once to :mod:`.laws`, or to Python
(:class:`skfem_cosserat.integrators.called_back.CalledLaws`).
Parts take ``(g, w, numbers, flag)``; ``g.S0`` are the strains at the start of a step.
"""

from __future__ import annotations

from typing import Any

from ..types import Floats
from .elements import (
    ask_for_moduli,
    ask_law,
    at_point,
    give,
    point_force,
    strain_changes,
    strained,
    take_elements,
    triple,
)
from .jit import inlined, part
from .numbers import END, ENDS, ENERGY_BY_LAW, SHARE, STRESSES_BY_LAW
from .simd import WIDTH, gather, local, scatter
from .small import block, counted, dot, times

__all__ = ["beam_force", "beam_predicted", "beam_start"]


@inlined
def measure(g: Any, y: Floats, out: Floats, X: Floats) -> None:
    """Strains at y; X is for the nodes."""
    lengths, N, dN, reference = g.lengths, g.N, g.dN, g.reference
    base, turned, rotations = g.base, g.turned, g.rotations
    ne, ng = len(base), len(N)
    for e in range(0, ne, WIDTH):
        es = block(e, ne)
        take_elements(base, turned, rotations, es, y, X)
        inverse = 1.0 / gather(lengths, es, 1, 0)
        for p in range(ng):
            eps = strained(reference, es, ng, p, at_point(N[p], dN[p], inverse, X))
            for i in range(3):
                scatter(out, es, 6 * ng, 6 * p + i, eps[0][i])
                scatter(out, es, 6 * ng, 6 * p + 3 + i, eps[1][i])


@part
def beam_start(g: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Strains at the start of the step, and stored energies."""
    base = g.base
    measure(g, w.y0, g.S0, local(12 * base.shape[1] * WIDTH))
    ask_law(g, numbers, ENERGY_BY_LAW)
    return 0.0


@part
def beam_force(g: Any, w: Any, numbers: Floats, flag: int) -> float:
    """S at y1 and ``internal += int B(q_mid)^T S ds``; flag 1: with the predicted S instead.

    Flag 2 is for viscosity.
    """
    if flag == 2:
        return 0.0
    mid, S, f = w.mid, g.S, w.internal
    lengths, N, dN, weights = g.lengths, g.N, g.dN, g.weights
    base, turned, rotations = g.base, g.turned, g.rotations
    ne, nn = base.shape
    ng = len(N)
    size = 12 * nn * WIDTH
    X, F = local(size), local(size)
    if flag == 1:
        S, f = g.predicted, w.R_mixed
    else:
        y = mid
        if numbers[ENDS] != 0.0:
            y = w.y1
        measure(g, y, g.strains, X)
        ask_law(g, numbers, STRESSES_BY_LAW)
    for e in range(0, ne, WIDTH):
        es = block(e, ne)
        length = gather(lengths, es, 1, 0)
        inverse = 1.0 / length
        take_elements(base, turned, rotations, es, mid, X)
        for k in range(size):
            F[k] = 0.0
        for p in range(ng):
            G = at_point(N[p], dN[p], inverse, X)
            weight = weights[p] * counted(e, ne) * length
            n, m = triple(S, es, 6 * ng, 6 * p), triple(S, es, 6 * ng, 6 * p + 3)
            point_force(N[p], dN[p], inverse, G, times(weight, n), times(0.5 * weight, m), F)
        give(base, turned, rotations, es, F, f)
    return 0.0


@part
def beam_predicted(g: Any, w: Any, numbers: Floats, flag: int) -> float:
    """``S + share D B(y) change``, y being where the stresses come from."""
    lengths, N, dN, moduli = g.lengths, g.N, g.dN, g.stiffness
    y, change, S, out = w.mid, w.change, g.S, g.predicted
    share = numbers[SHARE]
    if numbers[ENDS] != 0.0:
        y, share = w.y1, numbers[END]
    base, turned, rotations = g.base, g.turned, g.rotations
    ne, nn = base.shape
    ng = len(N)
    ask_for_moduli(moduli, g, numbers)
    X, V = local(12 * nn * WIDTH), local(12 * nn * WIDTH)
    for e in range(0, ne, WIDTH):
        es = block(e, ne)
        inverse = 1.0 / gather(lengths, es, 1, 0)
        take_elements(base, turned, rotations, es, y, X)
        take_elements(base, turned, rotations, es, change, V)
        for p in range(ng):
            G = at_point(N[p], dN[p], inverse, X)
            eps = strain_changes(G, at_point(N[p], dN[p], inverse, V))
            for i in range(6):
                k = 36 * p + 6 * i
                here = triple(moduli, es, 36 * ng, k), triple(moduli, es, 36 * ng, k + 3)
                more = share * (dot(here[0], eps[0]) + dot(here[1], eps[1]))
                scatter(out, es, 6 * ng, 6 * p + i, gather(S, es, 6 * ng, 6 * p + i) + more)
    return 0.0
