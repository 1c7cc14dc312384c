"""The one place where a linear solver is chosen, checked and replaced where it fails."""

from __future__ import annotations

from importlib.util import find_spec

import numpy as np

from ..errors import InputError
from ..log import logger
from ..pattern import FrozenPattern
from ..types import Floats
from .base import Factors, SingularMatrixError, Solver
from .direct import Band, SolverBanded, SolverDense
from .ordering import balanced
from .pardiso import SolverPardiso
from .superlu import SolverMetis, SolverSuperLU

__all__ = ["LinearSolver", "checked_solver"]

DENSE = 40  # unknowns below which a dense factorisation is fastest
FULL = 0.3  # share of entries from which it always is, up to this number of unknowns
MOST = 3000
BAND = 110  # lower plus upper bandwidth up to which a banded one is faster than a sparse one
OPTIONAL = 2000  # unknowns from which solvers of other packages pay
#: backward error of a solution above which it is corrected once, and above which it is refused
GOOD, ENOUGH = 1e-13, 1e-12


def checked_solver(solver: object) -> Solver | None:
    """The argument `solver` of whatever solves.

    Raises
    ------
    InputError
        If it is no :class:`Solver`.
    """
    if solver is not None and not isinstance(solver, Solver):
        raise InputError("argument solver", f"{solver!r}, expected a Solver, as SolverSuperLU()")
    return solver


class LinearSolver:
    """Solves systems whose pattern never changes; the method is chosen once.

    Small systems are solved dense, narrow ones banded, all others by the fastest sparse solver that
    is installed. Solutions of solvers that do not exchange rows freely are checked; where one is
    not good, SuperLU with partial pivoting takes over.

    Parameters
    ----------
    pattern : FrozenPattern
        Square.
    solver : Solver, optional
        Take this one.

    Attributes
    ----------
    factorisations : int
        How many so far.
    data : (nnz,) array
        Entries of the matrix factorised last.
    factors : Factors
        Its factors.

    Examples
    --------
    >>> pattern = FrozenPattern([0, 0, 1, 1], [0, 1, 0, 1], (2, 2))
    >>> solver = LinearSolver(pattern)
    >>> solver.solve(pattern.data([2.0, 1.0, 1.0, 3.0]), np.array([3.0, 4.0])).round(12).tolist()
    [1.0, 1.0]
    >>> solver.solve_again(np.array([2.0, 1.0])).round(12).tolist(), solver.method
    ([1.0, 0.0], 'dense')
    """

    def __init__(self, pattern: FrozenPattern, solver: Solver | None = None) -> None:
        self.pattern = pattern
        self.n = pattern.shape[0]
        self.factorisations = 0
        self._wanted = checked_solver(solver)
        self._bound: Factors | None = None
        self._sound: Factors | None = None

    @property
    def _factors(self) -> Factors:
        """Bound when first needed: steps by compiled kernels never do."""
        if self._bound is None:
            self._bound = (
                self._chosen() if self._wanted is None else self._wanted.bind(self.pattern)
            )
        return self._bound

    def _chosen(self) -> Factors:
        pattern = self.pattern
        if self.n <= DENSE or (self.n <= MOST and pattern.nnz > FULL * self.n**2):
            return SolverDense().bind(pattern)
        band = Band(pattern)
        if band.lower + band.upper <= BAND:
            return SolverBanded().bind(pattern, band)
        others: list[tuple[str, Solver]] = [("pypardiso", SolverPardiso())]
        if balanced(pattern):
            others.append(("pymetis", SolverMetis()))
        for package, solver in others if self.n >= OPTIONAL else []:
            if find_spec(package) is None:
                continue
            try:
                return solver.bind(pattern)
            except ImportError as error:  # its libraries are missing
                logger.warning("%r is not used: %s", solver, error)
        return SolverSuperLU().bind(pattern)

    @property
    def method(self) -> str:
        """Name of the solver at work."""
        return self._factors.name

    def solve(self, data: Floats, rhs: Floats) -> Floats:
        """Solution (n,) or (n, k) for the pattern's data (nnz,) and as many right-hand sides.

        Raises
        ------
        SingularMatrixError
            If a pivot vanishes or the solution is not finite.
        """
        self.factor(data)
        return self.solve_again(rhs)

    def factor(self, data: Floats) -> None:
        """Factorise the matrix of the pattern's data (nnz,).

        Raises
        ------
        SingularMatrixError
            If a pivot vanishes.
        """
        self.data = data
        if self.n:
            self._factor(self._factors)

    def solve_again(self, rhs: Floats) -> Floats:
        """Solution for other right-hand sides, of the matrix factorised last."""
        if self.n == 0:  # all motion is prescribed
            return np.zeros_like(rhs)
        out = self._checked(rhs)
        if out is None:
            self._take_over()
            out = self.factors.solve(rhs)
        if not np.logical_and.reduce(np.isfinite(out), axis=None):
            raise SingularMatrixError("the iteration matrix is singular")
        return out

    def _factor(self, factors: Factors) -> None:
        self.factorisations += 1
        self.factors = factors
        try:
            factors.factor(self.data)
        except SingularMatrixError:
            if factors.pivoting:
                raise
            self._take_over()

    def _take_over(self) -> None:
        """Partial pivoting: for this matrix, and if that helps for those that follow."""
        before = self.factors.name
        if self._sound is None:
            self._sound = SolverSuperLU(symmetric=False).bind(self.pattern)
        self._factor(self._sound)
        logger.info("%s needs pivots elsewhere: partial pivoting from now on", before)
        self._bound = self._sound

    def _checked(self, rhs: Floats) -> Floats | None:
        """Solution, corrected once if need be; None if it is not good then."""
        factors = self.factors
        x = factors.solve(rhs)
        if factors.pivoting:
            return x
        matrix = self.pattern.assembled(self.data)
        size = abs(matrix)
        rows = np.asarray(size.sum(axis=1)).reshape(-1, *(1,) * (rhs.ndim - 1))

        def error(x: Floats, r: Floats) -> float:
            """Largest residual of a row against its terms, at least 1e-13 of what they may be."""
            most = rows * abs(x).max(axis=0) + abs(rhs)
            terms = np.maximum(size @ abs(x) + abs(rhs), 1e-13 * most)
            return float((abs(r) / np.where(terms > 0, terms, 1.0)).max())

        with np.errstate(all="ignore"):
            r = rhs - matrix @ x
            if error(x, r) <= GOOD:
                return x
            x = x + factors.solve(r)
            return x if error(x, rhs - matrix @ x) <= ENOUGH else None
