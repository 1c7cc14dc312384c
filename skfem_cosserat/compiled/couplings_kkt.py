"""Compiled force elements with multipliers: the tangent by coordinates."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..types import Floats
from .couplings import SIDE, SLOT, couple_force, gradients, right_side
from .jit import part
from .numbers import FORCE, SHARE, S

__all__ = ["couple"]


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
