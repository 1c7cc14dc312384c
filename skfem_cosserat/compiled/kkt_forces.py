"""Springs and loads in kernels with multipliers."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..types import Floats
from .couplings import SIDE, SLOT, couple_force, gradients, right_side
from .jit import part
from .loads import load_force, moment_change, moment_on
from .numbers import FORCE, SHARE, S
from .small import row

__all__ = ["couple", "load"]


# -- compiled force elements with multipliers: the tangent by coordinates --------------------------


@part
def couple(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Force elements: 0 and 2 see :mod:`.couplings`; 1: ``force df/dy_1``; 3: at the start."""
    G, rows = np.empty((4, 2 * SIDE, 3)), 2 * SIDE
    if flag != 1:
        couple_force(s, w, numbers, flag, G)
        return 0.0
    A, places, forms, state, share = w.A, s.coupling, s.coupling_forms, w.coupled, numbers[SHARE]
    force = numbers[FORCE]
    for c in range(len(places)):
        for k in range(2):
            gradients(forms, places, c, k, w.mid, G, k)
            gradients(forms, places, c, k, w.y1, G, 2 + k)
        for b in range(rows):
            right = right_side(state, c, 0, share, G, b), right_side(state, c, 1, share, G, b)
            for a in range(rows):
                slot = places[c, SLOT + 2 * (a // SIDE) + b // SIDE]
                if slot < 0:
                    continue
                f = state[c, S] * forms[c, 0, a, b] + state[c, S + 1] * forms[c, 1, a, b]
                for i in range(3):
                    r = 3 * (a % SIDE) + i
                    for j in range(3):
                        product = G[0, a, i] * right[0][j] + G[1, a, i] * right[1][j]
                        A[slot, r, 3 * (b % SIDE) + j] += force * product
                    A[slot, r, 3 * (b % SIDE) + i] += force * share * f
    return 0.0


# -- compiled loads that follow the motion, with multipliers: the tangent by coordinates -----------


@part
def load(s: Any, m: Any, w: Any, numbers: Floats, flag: int) -> float:
    """Loads at ``w.mid``; flag 1: their tangent ``-share force df/dy``."""
    if flag == 0:
        load_force(s, w)
        return 0.0
    A, pairs, followers = w.A, s.follower, w.followers
    factor = -numbers[SHARE] * numbers[FORCE]
    for k in range(len(pairs)):
        for i in range(4):
            for j in range(4):
                for c in range(3):
                    A[pairs[k, 2], 3 * i + c, 3 * j + c] += factor * followers[k, i, j]
    V = np.zeros((3, 3))
    for k in range(len(s.moment_vertex)):
        own, f, E = moment_on(s, w, k)
        for j in range(3):
            for c in range(3):
                V[j, c] = 1.0
                change = row(V, 0), row(V, 1), row(V, 2)
                V[j, c] = 0.0
                for i in range(3):
                    g = moment_change(own, f, E, change, i)
                    for r in range(3):
                        A[m.diag[s.moment_vertex[k]], 3 + 3 * i + r, 3 + 3 * j + c] += factor * g[r]
    return 0.0
