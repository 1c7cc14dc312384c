"""SuperLU of scipy, in three settings."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.sparse import csc_matrix
from scipy.sparse.linalg import splu

from ..pattern import FrozenPattern
from ..types import Floats, IndexArray
from .base import Factors, SingularMatrixError, Solver
from .ordering import (
    THRESHOLD,
    Permuted,
    balanced,
    minimum_degree,
    nested_dissection,
    unknowns_in_order,
)

__all__ = ["SolverMetis", "SolverSuperLU"]


class SolverSuperLU(Solver):
    """SuperLU, which comes with scipy.

    Parameters
    ----------
    symmetric : bool, optional
        True: pivots stay on the diagonal where they are not small, in a minimum degree ordering of
        the vertices: several times faster for lattices. False: partial pivoting, columns ordered
        by COLAMD. By default the first where the pattern is symmetric and has a full diagonal.
        (Matrices with multipliers have none: there the first fills in, up to ninety times slower.)

    Examples
    --------
    >>> SolverSuperLU(symmetric=False)
    SolverSuperLU(symmetric=False)
    """

    name = "superlu"

    def __init__(self, symmetric: bool | None = None) -> None:
        self.symmetric = symmetric

    def __repr__(self) -> str:
        given = "" if self.symmetric is None else f"symmetric={self.symmetric}"
        return f"SolverSuperLU({given})"

    def bind(self, pattern: FrozenPattern) -> Factors:
        """See the base class."""
        if balanced(pattern) if self.symmetric is None else self.symmetric:
            return _Ordered("superlu-symmetric", pattern, minimum_degree)
        return _Pivoting(pattern)


class SolverMetis(Solver):
    """SuperLU in the order of METIS (nested dissection), pivots on the diagonal where not small.

    Needs pymetis (extra ``solvers``). For patterns that are symmetric with a full diagonal, such as
    the null space method's.

    Examples
    --------
    >>> SolverMetis()
    SolverMetis()
    """

    name = "superlu-metis"

    def bind(self, pattern: FrozenPattern) -> Factors:
        """See the base class."""
        return _Ordered(self.name, pattern, nested_dissection)


def _factorised(matrix: csc_matrix, **options: Any) -> Any:
    try:
        return splu(matrix, **options)
    except RuntimeError as error:  # SuperLU: exactly singular
        raise SingularMatrixError("the iteration matrix is singular") from error


class _Pivoting(Factors):
    name = "superlu"

    def __init__(self, pattern: FrozenPattern) -> None:
        self._pattern = pattern

    def factor(self, data: Floats) -> None:
        self._lu = _factorised(self._pattern.assembled(data))

    def solve(self, rhs: Floats) -> Floats:
        return self._lu.solve(rhs)


class _Ordered(Factors):
    """Symmetric mode in an order found once."""

    pivoting = False

    def __init__(
        self, name: str, pattern: FrozenPattern, rule: Callable[[csc_matrix], IndexArray]
    ) -> None:
        self.name = name
        self._permuted = Permuted(pattern, unknowns_in_order(pattern, rule))

    def factor(self, data: Floats) -> None:
        new = self._permuted
        self._lu = _factorised(
            new.pattern.assembled(data[new.take]),
            permc_spec="NATURAL",
            diag_pivot_thresh=THRESHOLD,
            options={"SymmetricMode": True},
        )

    def solve(self, rhs: Floats) -> Floats:
        out = np.empty_like(rhs)
        out[self._permuted.order] = self._lu.solve(rhs[self._permuted.order])
        return out
