"""Elimination for many states at once: `StackedSolver` of ../constraints/stacked.py, compiled.

The states are the last dimension of all arrays. Each number comes from the same operations in the
same order as there, so both give the same bits.
"""

from __future__ import annotations

import numpy as np
from numba import types
from numba.core.errors import NumbaError

from ..types import Floats, IndexArray
from .jit import jit, ready
from .warm import NotKept, Source

__all__ = ["factors", "have", "solve"]


def have(source: Source) -> None:
    """Get both functions ready.

    Raises
    ------
    NotKept
        If they are in none of the places that they may come from, or numba does not compile them.
    """
    states, places = types.float64[:, ::1], types.int64[::1]
    try:
        ready(factors, (states, places, places), source)
        ready(solve, (states, places, places, states), source)
    except NumbaError as error:
        raise NotKept(__name__) from error


@jit
def factors(X: Floats, start: IndexArray, to: IndexArray) -> None:
    """Put D and L (slots, N) in the place of the entries of matrices.

    Rows ``start[k]`` to ``start[k + 1]`` are column k below its diagonal, which is row k. `to`
    lists the rows from which products of two numbers of a column are subtracted.
    """
    size, count, done = len(start) - 1, X.shape[1], 0
    column = np.empty((np.diff(start).max(), count))
    for k in range(size):
        first, rows = start[k], start[k + 1] - start[k]
        for a in range(rows):
            for n in range(count):
                column[a, n] = X[first + a, n] / X[k, n]
        for a in range(rows):
            for b in range(a + 1):
                for n in range(count):
                    X[to[done], n] -= column[a, n] * X[first + b, n]
                done += 1
        for a in range(rows):
            for n in range(count):
                X[first + a, n] = column[a, n]


@jit
def solve(X: Floats, start: IndexArray, below: IndexArray, x: Floats) -> None:
    """Put solutions (size, N) in the place of right-hand sides; `below`: of L, row by row of X."""
    size, count = x.shape
    total = np.empty(count)
    for k in range(size):
        for a in range(start[k], start[k + 1]):
            for n in range(count):
                x[below[a - size], n] -= X[a, n] * x[k, n]
    for k in range(size):
        for n in range(count):
            x[k, n] /= X[k, n]
    for k in range(size - 1, -1, -1):
        for n in range(count):
            total[n] = 0.0
        for a in range(start[k], start[k + 1]):
            for n in range(count):
                total[n] += X[a, n] * x[below[a - size], n]
        for n in range(count):
            x[k, n] -= total[n]
