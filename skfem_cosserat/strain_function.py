"""Functions of the strains of one point that numba has compiled, as such of stacks of strains.

Numba is not imported here: who has none has compiled no function.
"""

from __future__ import annotations

import sys
from functools import cached_property
from typing import Any

import numpy as np

from .law import StrainFunction
from .types import Array


class CompiledFunction:
    """A compiled function of strains (6,) as one of strains (..., 6), and for compiled kernels.

    Parameters
    ----------
    function : numba dispatcher
        Strains (6,), real or complex, to a number or an array of this shape.
    shape : tuple of int
    """

    def __init__(self, function: Any, shape: tuple[int, ...]) -> None:
        self.function, self.shape = function, shape

    def __call__(self, eps: Array) -> Array:
        """Values (..., *shape) at strains (..., 6).

        Raises
        ------
        TypeError
            If numba cannot compile the function for such numbers.
        ValueError
            If it gives arrays of another shape.
        """
        from numba.core.errors import NumbaError

        given = np.array(eps, dtype=complex if np.iscomplexobj(eps) else float, order="C")
        rows = given.reshape(-1, 6)
        out = np.empty((len(rows), int(np.prod(self.shape))), dtype=given.dtype)
        try:
            found = np.shape(self.function(rows[0].copy())) if len(rows) else self.shape
            if found != self.shape:
                text = f"compiled by numba, it gives {found} for the strains (6,) of one point"
                raise ValueError(f"{text}, expected {self.shape}")
            self._each(rows, out, len(rows))
        except (NumbaError, NotImplementedError) as error:
            text = f"numba cannot compile it for {given.dtype} strains (6,) of one point"
            why = [line.strip() for line in str(error).splitlines() if line.strip()]
            raise TypeError(f"{text}: {' '.join(why[:2])}") from error
        return out.reshape((*given.shape[:-1], *self.shape))

    def address(self, kind: type) -> int:
        """Address of ``f(strains (k, 6), values (k, size), k)`` for kernels, of real or complex."""
        from numba import types

        number = types.complex128 if kind is complex else types.float64
        rows = types.Array(number, 2, "C")
        self._each.compile((rows, rows, types.int64))
        made = self._each.overloads[rows, rows, types.int64]
        return int(made.library.get_pointer_to_function(made.fndesc.llvm_func_name))

    @cached_property
    def _each(self) -> Any:
        """The function of a stack of points, values in rows."""
        from numba import njit

        function, order = self.function, len(self.shape)

        def each(eps: Any, out: Any, count: int) -> float:
            for k in range(count):
                value = function(eps[k])
                if order == 0:
                    out[k, 0] = value
                elif order == 1:
                    for i in range(6):
                        out[k, i] = value[i]
                else:
                    for i in range(6):
                        for j in range(6):
                            out[k, 6 * i + j] = value[i, j]
            return 0.0

        return njit(each, error_model="numpy")

    def __reduce__(self) -> Any:
        """Without what is compiled here."""
        return CompiledFunction, (self.function, self.shape)


def of_points(function: StrainFunction, shape: tuple[int, ...]) -> StrainFunction:
    """A user's function as one of stacks: as it is, unless numba has compiled it."""
    numba = sys.modules.get("numba")
    if numba is None or not isinstance(function, numba.core.registry.CPUDispatcher):
        return function
    return CompiledFunction(function, shape)
