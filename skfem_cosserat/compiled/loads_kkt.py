"""Compiled loads that follow the motion, with multipliers: the tangent by coordinates."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..types import Floats
from .jit import part
from .loads import load_force, moment_change, moment_on
from .numbers import FORCE, SHARE
from .small import row

__all__ = ["load"]


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
