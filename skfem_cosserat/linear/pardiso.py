"""Pardiso of the Intel MKL: the analysis once for a pattern, numbers as often as they change.

pypardiso finds the library; its own calls repeat the analysis with each matrix, so the library is
called here. Threads: as many as the environment (``MKL_NUM_THREADS``) lets it take.
"""

from __future__ import annotations

import ctypes
import weakref
from typing import Any

import numpy as np

from ..errors import CosseratError
from ..pattern import FrozenPattern
from ..types import Array, Floats
from .base import Factors, SingularMatrixError, Solver
from .ordering import balanced

__all__ = ["SolverPardiso"]

ANALYSE, FACTOR, SOLVE, RELEASE = 11, 22, 33, -1
#: kinds of matrices: symmetric pattern, none
SYMMETRIC_PATTERN, GENERAL = 1, 11
ZERO_PIVOT, NO_MEMORY = -4, -2


class SolverPardiso(Solver):
    """Pardiso of the Intel MKL; needs pypardiso (extra ``solvers``).

    Examples
    --------
    >>> SolverPardiso()
    SolverPardiso()
    """

    name = "pardiso"

    def bind(self, pattern: FrozenPattern) -> Factors:
        """See the base class."""
        try:
            from pypardiso import PyPardisoSolver

            library = PyPardisoSolver().libmkl
        except (ImportError, OSError) as error:
            raise ImportError(
                "SolverPardiso() needs pypardiso: pip install 'skfem-cosserat[solvers]'"
            ) from error
        return _Pardiso(pattern, library)


class _Handle:
    """Memory of the library, which has to be given back."""

    def __init__(self, library: Any, n: int, kind: int) -> None:
        self._call = library["pardiso"]  # a function object of our own
        self._call.argtypes = [ctypes.c_void_p] * 16
        self._call.restype = None
        self.n, self.kind = n, kind
        self.memory = np.zeros(64, dtype=np.int64)
        self.settings = np.zeros(64, dtype=np.int32)

    def __call__(self, phase: int, arrays: list[Array], count: int = 1) -> int:
        """Run a phase for entries, first entries, rows, right-hand sides, solutions."""

        def number(value: int) -> Any:
            return ctypes.byref(ctypes.c_int32(value))

        a, ia, ja, b, x = [array.ctypes.data for array in arrays]
        error = ctypes.c_int32(0)
        settings, memory = self.settings.ctypes.data, self.memory.ctypes.data
        head = [memory, number(1), number(1), number(self.kind), number(phase), number(self.n)]
        tail = [number(count), settings, number(0), b, x, ctypes.byref(error)]
        self._call(*head, a, ia, ja, None, *tail)
        return error.value

    def release(self) -> None:
        """Give the memory back."""
        self(RELEASE, [np.zeros(1)] * 5)


class _Pardiso(Factors):
    name = SolverPardiso.name
    pivoting = False

    def __init__(self, pattern: FrozenPattern, library: Any) -> None:
        self._starts = pattern.indptr.astype(np.int32)
        self._rows = pattern.indices.astype(np.int32)
        self._none = np.zeros(pattern.shape[0])
        self._symmetric = balanced(pattern)
        kind = SYMMETRIC_PATTERN if self._symmetric else GENERAL
        self._handle = _Handle(library, pattern.shape[0], kind)
        settings = self._handle.settings
        settings[0] = 1  # no defaults
        settings[1] = 2  # nested dissection
        settings[9] = 13  # pivots below 1e-13 of the matrix are moved there
        if not self._symmetric:  # large entries onto the diagonal: multipliers have none
            settings[10] = settings[12] = 1
        settings[11] = 2  # columns are given where it expects rows
        settings[34] = 1  # indices from 0
        self._analysed = False
        weakref.finalize(self, self._handle.release).atexit = False

    def factor(self, data: Floats) -> None:
        self._data = np.ascontiguousarray(data, dtype=float)
        matched = self._symmetric or not self._analysed
        if self._moved():
            self._analysed = self._symmetric
            if matched or self._moved():  # else rows were matched to the entries of another matrix
                raise SingularMatrixError("the iteration matrix is singular")

    def _moved(self) -> int:
        """Number of pivots so small that they were moved."""
        if not self._analysed:
            self._run(ANALYSE, self._none, self._none)
            self._analysed = True
        self._run(FACTOR, self._none, self._none)
        return int(self._handle.settings[13])

    def solve(self, rhs: Floats) -> Floats:
        b = np.array(rhs, dtype=float, order="F")
        x = np.zeros_like(b)
        self._run(SOLVE, b, x)
        return x

    def _run(self, phase: int, b: Floats, x: Floats) -> None:
        count = 1 if b.ndim == 1 else b.shape[1]
        error = self._handle(phase, [self._data, self._starts, self._rows, b, x], count)
        if error == ZERO_PIVOT:
            raise SingularMatrixError("the iteration matrix is singular")
        if error == NO_MEMORY:
            raise MemoryError("Pardiso has not enough memory")
        if error:
            raise CosseratError(f"Pardiso failed in phase {phase} with error {error}")
