"""What an elimination in blocks leaves of a system, by a sparse solver."""

from __future__ import annotations

import ctypes

import numpy as np

from ..compiled.plan import Plan
from ..errors import CosseratError
from ..linear import LinearSolver, SingularMatrixError, Solver
from ..pattern import FrozenPattern
from ..types import Floats, IndexArray

__all__ = ["Rest"]

#: what a solver, or a user in a hurry, may raise
NOT_OURS = (ArithmeticError, ImportError, KeyboardInterrupt, MemoryError, RuntimeError, ValueError)


class Rest:
    """Vertices that were not eliminated: their blocks as a sparse matrix of a frozen pattern.

    Parameters
    ----------
    plan : Plan
        With vertices left.
    size : (nv,) int array
        Unknowns of each vertex: the first rows and columns of its blocks.
    A : (slots, 6, 6) array
        Blocks, in place: those of the rest after the elimination of all others.
    x : (nv, 6) array
        Right-hand sides, in place, which the solution replaces.
    solver : Solver, optional
        Take this one; default: the fastest that is installed.

    Attributes
    ----------
    solver : LinearSolver
    """

    def __init__(
        self, plan: Plan, size: IndexArray, A: Floats, x: Floats, solver: Solver | None = None
    ) -> None:
        left = np.zeros(len(size), dtype=bool)
        left[plan.rest] = True
        ends = np.array(list(plan.slot), dtype=np.int64)  # in the order of the slots
        slots = np.flatnonzero(left[ends].all(axis=1))
        ends = ends[slots]
        each = np.where(left, size, 0)
        first = np.cumsum(each) - each
        k = np.arange(6)
        inside = (k[:, None] < each[ends[:, :1, None]]) & (k < each[ends[:, 1:, None]])
        rows = np.broadcast_to(first[ends[:, :1, None]] + k[:, None], inside.shape)[inside]
        cols = np.broadcast_to(first[ends[:, 1:, None]] + k, inside.shape)[inside]
        places = (36 * slots[:, None, None] + 6 * k[:, None] + k)[inside]
        count = int(each.sum())
        pattern = FrozenPattern(rows, cols, (count, count))
        self._take = np.empty(pattern.nnz, dtype=np.int64)  # every entry is in one place only
        self._take[pattern.slot] = places
        self._numbers = (6 * np.arange(len(size))[:, None] + k)[k < each[:, None]]
        self._A, self._x = A.reshape(-1), x.reshape(-1)
        self.solver = LinearSolver(pattern, solver)

        self._call = ctypes.PYFUNCTYPE(ctypes.c_double, ctypes.c_int64)(self._called)
        self._error: BaseException | None = None

    @property
    def address(self) -> int:
        """Of ``double f(int64)``: 0 to factorise, 1 to solve; gives 1, or 0 where that fails."""
        return int(ctypes.cast(self._call, ctypes.c_void_p).value or 0)

    def _called(self, again: int) -> float:
        """From compiled code, which no exception can pass."""
        try:
            if again:
                self.solve()
            else:
                self.factor()
        except SingularMatrixError:
            return 0.0
        except (CosseratError, *NOT_OURS) as error:
            self._error = error
            return 0.0
        return 1.0

    def complain(self) -> None:
        """Raise what could not be raised when the solver was called."""
        error, self._error = self._error, None
        if error is not None:
            raise error

    def factor(self) -> None:
        """Factorise the blocks as they are.

        Raises
        ------
        SingularMatrixError
            If a pivot vanishes.
        """
        self.solver.factor(self._A.take(self._take))

    def solve(self) -> None:
        """Solve for the right-hand sides, with the factors that are there.

        Raises
        ------
        SingularMatrixError
            If the solution is not finite.
        """
        self._x[self._numbers] = self.solver.solve_again(self._x[self._numbers])
