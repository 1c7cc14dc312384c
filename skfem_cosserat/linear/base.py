"""What a back end is: a choice (:class:`Solver`), and its factors of one pattern."""

from __future__ import annotations

from abc import ABC, abstractmethod

from ..errors import CosseratError
from ..pattern import FrozenPattern
from ..types import Floats

__all__ = ["Factors", "SingularMatrixError", "Solver"]


class SingularMatrixError(CosseratError):
    """The iteration matrix is singular to working precision."""


class Solver(ABC):
    """A choice; :meth:`bind` does what depends on the pattern alone.

    Attributes
    ----------
    name : str
        As in ``history.meta["solver"]``.
    """

    name: str

    def __repr__(self) -> str:
        return f"{type(self).__name__}()"

    @abstractmethod
    def bind(self, pattern: FrozenPattern) -> Factors:
        """Orderings and index arrays for matrices of this pattern.

        Raises
        ------
        ImportError
            If it needs a package that is not installed; names the extra.
        """


class Factors(ABC):
    """Factors of the last matrix of a pattern, kept for further right-hand sides.

    Attributes
    ----------
    name : str
    pivoting : bool
        Whether pivots are chosen freely among the rows. If not, solutions have to be checked.
    """

    name: str
    pivoting: bool = True

    @abstractmethod
    def factor(self, data: Floats) -> None:
        """Factorise the matrix of these entries (nnz,).

        Raises
        ------
        SingularMatrixError
            If a pivot vanishes.
        """

    @abstractmethod
    def solve(self, rhs: Floats) -> Floats:
        """Solution, fresh, of the shape of `rhs` (n,) or (n, k)."""
