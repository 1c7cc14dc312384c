"""Elimination for many states at once: `StackedSolver` of ../constraints/stacked.py, compiled.

The states are the last dimension of all arrays. Each number comes from the same operations in the
same order as there, so both give the same bits. Parts take a structure ``(X, start, places, x,
scratch)`` and a flag.
"""

from __future__ import annotations

from typing import Any

from .jit import part

__all__ = ["factors", "solve"]


@part
def factors(o: Any, flag: int) -> float:
    """Put D and L (slots, N) in the place of the entries of matrices X.

    Rows ``start[k]`` to ``start[k + 1]`` are column k below its diagonal, which is row k. `places`
    lists the rows from which products of two numbers of a column are subtracted; scratch has the
    largest number of rows.
    """
    X, start, to, column = o.X, o.start, o.places, o.scratch
    size, count, done = len(start) - 1, X.shape[1], 0
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
    return 0.0


@part
def solve(o: Any, flag: int) -> float:
    """Put solutions (size, N) in the place of right-hand sides x; `places`: of L, row by row of X.

    Scratch has one row.
    """
    X, start, below, x, total = o.X, o.start, o.places, o.x, o.scratch
    size, count = x.shape
    for k in range(size):
        for a in range(start[k], start[k + 1]):
            for n in range(count):
                x[below[a - size], n] -= X[a, n] * x[k, n]
    for k in range(size):
        for n in range(count):
            x[k, n] /= X[k, n]
    for k in range(size - 1, -1, -1):
        for n in range(count):
            total[0, n] = 0.0
        for a in range(start[k], start[k + 1]):
            for n in range(count):
                total[0, n] += X[a, n] * x[below[a - size], n]
        for n in range(count):
            x[k, n] -= total[0, n]
    return 0.0
