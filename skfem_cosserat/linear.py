"""Solvers of linear systems, sparse, banded and dense, by other packages."""

from __future__ import annotations

import weakref
from abc import ABC, abstractmethod
from contextlib import suppress
from importlib.util import find_spec
from typing import Any

import numpy as np
from scipy.linalg import get_lapack_funcs
from scipy.sparse import csc_matrix, csr_matrix, identity
from scipy.sparse.csgraph import reverse_cuthill_mckee
from scipy.sparse.linalg import splu

from .errors import CosseratError, InputError, PerformanceWarning
from .frozen import Frozen
from .pattern import FrozenPattern
from .types import SAME, Array, Floats, IndexArray, largest, switch
from .warn import logger, warn

# -- what a back end is: a choice (:class:`Solver`), and its factors of one pattern ----------------


class SingularMatrixError(CosseratError):
    """The iteration matrix is singular to working precision."""


class Solver(Frozen, ABC):
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

    An own solver derives from :class:`Solver`; its ``bind(pattern)`` gives an object of a class
    that derives from this one. A pattern has the attributes ``shape``, ``indptr`` and ``indices``
    of a CSC matrix, and ``nnz``.

    Attributes
    ----------
    name : str
        As that of the solver.
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


def mirrored(pattern: FrozenPattern) -> csc_matrix:
    """The pattern with all entries mirrored at the diagonal; numbers in it are positive."""
    entries = pattern.assembled(np.ones(pattern.nnz))
    return csc_matrix(entries + entries.T)


def balanced(pattern: FrozenPattern) -> bool:
    """True if the pattern is its own transpose with all of the diagonal in it."""
    both = mirrored(pattern)
    return both.nnz == pattern.nnz and bool(both.diagonal().all())


# -- LAPACK: small systems as full matrices, narrow ones as bands ----------------------------------


class SolverDense(Solver):
    """LU of the full matrix with partial pivoting.

    Examples
    --------
    >>> SolverDense()
    SolverDense()
    """

    name = "dense"

    def bind(self, pattern: FrozenPattern) -> Factors:
        """Factors by dense LU for matrices of this pattern."""
        return _Dense(pattern)


class _Dense(Factors):
    name = SolverDense.name

    def __init__(self, pattern: FrozenPattern):
        self._n = pattern.shape[0]
        self._where = pattern.indices.astype(np.int64) + self._n * pattern.columns
        self._getrf, self._getrs = get_lapack_funcs(("getrf", "getrs"), dtype=np.float64)

    def factor(self, data: Floats) -> None:
        flat = np.zeros(self._n * self._n)
        flat[self._where] = data
        matrix = flat.reshape((self._n, self._n), order="F")
        self._lu, self._pivots, info = self._getrf(matrix, overwrite_a=True)
        if info != 0:
            raise SingularMatrixError("the iteration matrix is singular")

    def solve(self, rhs: Floats) -> Floats:
        return self._getrs(self._lu, self._pivots, rhs)[0]


class Band:
    """A pattern in reverse Cuthill-McKee order.

    Parameters
    ----------
    pattern : FrozenPattern
        Square.

    Attributes
    ----------
    order : (n,) int array
        Unknowns in the order of the rows.
    position : (n,) int array
        Row of each unknown.
    lower, upper : int
        Bandwidths.
    """

    def __init__(self, pattern: FrozenPattern):
        n = pattern.shape[0]
        self.order: IndexArray = reverse_cuthill_mckee(mirrored(pattern), symmetric_mode=True)
        self.position: IndexArray = np.empty(n, np.int64)
        self.position[self.order] = np.arange(n)
        i, j = self.ends(pattern)
        i -= j
        self.lower = int(i.max(initial=0))
        self.upper = -int(i.min(initial=0))

    def ends(self, pattern: FrozenPattern) -> tuple[Array, Array]:
        """Rows and columns (nnz,) of the pattern's entries in this order."""
        position = self.position.astype(pattern.indices.dtype)
        return position[pattern.indices], position.repeat(np.diff(pattern.indptr))


class SolverBanded(Solver):
    """Banded LU with partial pivoting after a reverse Cuthill-McKee ordering.

    Examples
    --------
    >>> SolverBanded()
    SolverBanded()
    """

    name = "banded"

    def bind(self, pattern: FrozenPattern, band: Band | None = None) -> Factors:
        """Factors in a band for matrices of this pattern; `band` if it is known already."""
        return _Banded(pattern, Band(pattern) if band is None else band)


class _Banded(Factors):
    name = SolverBanded.name

    def __init__(self, pattern: FrozenPattern, band: Band):
        self._n = pattern.shape[0]
        self._band = band
        rows = pattern.indices
        cols = pattern.columns
        self._entries = (rows, cols)
        self._diagonal = np.flatnonzero(rows == cols)
        #: places of the entries in column-major band storage, with room for exchanged rows
        i, j = (each.astype(np.int64) for each in band.ends(pattern))
        self._rows = 2 * band.lower + band.upper + 1
        self._where = (band.lower + band.upper + i - j) + self._rows * j
        #: of rows and columns, in the order of the band; of the entries
        self._scale, self._scales = np.zeros(0), np.zeros(0)
        self._gbtrf, self._gbtrs = get_lapack_funcs(("gbtrf", "gbtrs"), dtype=np.float64)

    def factor(self, data: Floats) -> None:
        b = self._band
        if not len(self._scale):
            self._scale_by(data)
        flat = np.zeros(self._rows * self._n)
        flat[self._where] = data * self._scales
        band = flat.reshape((self._rows, self._n), order="F")
        self._lu, self._pivots, info = self._gbtrf(band, b.lower, b.upper, overwrite_ab=True)
        if info != 0:
            raise SingularMatrixError("the iteration matrix is singular")

    def solve(self, rhs: Floats) -> Floats:
        b = self._band
        scale = self._scale if rhs.ndim == 1 else self._scale[:, None]
        ordered = rhs.take(b.order, 0)
        ordered *= scale
        found = self._gbtrs(self._lu, b.lower, b.upper, ordered, self._pivots, overwrite_b=True)[0]
        found *= scale
        return found.take(b.position, 0)

    def _scale_by(self, data: Floats) -> None:
        """Powers of two that bring the diagonal of the first matrix to about one, on both sides.

        Shifts and rotations differ by orders of magnitude: without, half of the columns have their
        pivot elsewhere, and rows that are exchanged fill the band.
        """
        size = np.ones(self._n)
        size[self._entries[0][self._diagonal]] = abs(data[self._diagonal])
        size[~(np.isfinite(size) & (size > 0))] = 1.0
        scale = np.exp2((-0.5 * np.log2(size)).round())
        self._scales = scale[self._entries[0]] * scale[self._entries[1]]
        self._scale = scale[self._band.order]


# -- sparse ones: SuperLU of scipy, Pardiso of the Intel MKL ---------------------------------------


class SolverSuperLU(Solver):
    """SuperLU, which comes with scipy.

    Parameters
    ----------
    symmetric : bool, optional
        True: pivots stay on the diagonal where they are not small, in a minimum degree ordering:
        several times faster for lattices. False: partial pivoting, columns ordered by COLAMD. By
        default the first where the pattern is symmetric and has a full diagonal. (Matrices with
        multipliers have none: there the first fills in, up to ninety times slower.)

    Examples
    --------
    >>> SolverSuperLU(symmetric=False)
    SolverSuperLU(symmetric=False)
    """

    name = "superlu"

    def __init__(self, symmetric: bool | None = None):
        self.symmetric = None if symmetric is None else switch("argument symmetric", symmetric)

    def __repr__(self) -> str:
        given = "" if self.symmetric is None else f"symmetric={self.symmetric}"
        return f"SolverSuperLU({given})"

    def bind(self, pattern: FrozenPattern) -> Factors:
        """Factors by SuperLU for matrices of this pattern."""
        return _SuperLU(pattern, balanced(pattern) if self.symmetric is None else self.symmetric)


class _SuperLU(Factors):
    def __init__(self, pattern: FrozenPattern, symmetric: bool):
        self._pattern = pattern
        self.pivoting = not symmetric
        self.name = "superlu-symmetric" if symmetric else "superlu"
        self._options = {}
        if symmetric:  # pivots on the diagonal down to a hundredth of their column's largest entry
            self._options = {"permc_spec": "MMD_AT_PLUS_A", "diag_pivot_thresh": 0.01}
            self._options["options"] = {"SymmetricMode": True}

    def factor(self, data: Floats) -> None:
        try:
            self._lu = splu(self._pattern.assembled(data), **self._options)
        except RuntimeError as error:  # SuperLU: exactly singular
            raise SingularMatrixError("the iteration matrix is singular") from error

    def solve(self, rhs: Floats) -> Floats:
        return self._lu.solve(rhs)


class SolverPardiso(Solver):
    """Pardiso of the Intel MKL; needs pypardiso (extra ``solvers``).

    It takes as many threads as the environment (``MKL_NUM_THREADS``) lets it take.

    Examples
    --------
    >>> SolverPardiso()
    SolverPardiso()
    """

    name = "pardiso"

    def bind(self, pattern: FrozenPattern) -> Factors:
        """Factors by PARDISO for matrices of this pattern; ImportError without pypardiso."""
        try:
            from pypardiso import PyPardisoSolver

            # a matrix with a symmetric pattern, or any
            library = PyPardisoSolver(mtype=1 if balanced(pattern) else 11)
        except (ImportError, OSError) as error:
            raise ImportError(
                "SolverPardiso() needs pypardiso: pip install 'skfem-cosserat[solvers]'"
            ) from error
        return _Pardiso(pattern, library)


class _Pardiso(Factors):
    name = SolverPardiso.name
    pivoting = False

    def __init__(self, pattern: FrozenPattern, library: Any):
        self._pattern = pattern
        self._library = library
        weakref.finalize(self, library.free_memory, everything=True).atexit = False

    def factor(self, data: Floats) -> None:
        from pypardiso.pardiso_wrapper import PyPardisoError

        self._matrix = self._pattern.assembled(data)
        try:
            self._library.factorize(self._matrix)
        except PyPardisoError as error:
            if error.value == -2:
                raise MemoryError("Pardiso has not enough memory") from error
            raise SingularMatrixError(f"the iteration matrix is singular ({error})") from error
        if self._library.get_iparm(14):  # so many pivots were so small that they were moved
            raise SingularMatrixError("the iteration matrix is singular")

    def solve(self, rhs: Floats) -> Floats:
        return self._library.solve(self._matrix, rhs)


# -- eigenvalues of one sign, counted by pivots ----------------------------------------------------

#: unknowns up to which eigenvalues are computed dense
EIGENVALUES = 300
#: eigenvalue, relative to the largest entry of K, below which a motion counts as neutral: of a
#: section bent in one of its equivalent directions it was below 0.6 units of rounding (measured)
NEUTRAL = 1e-15


class Factorised:
    """A symmetric matrix factorised without exchange of rows, so that pivots can be counted.

    Raises RuntimeError if a pivot vanishes.

    Attributes
    ----------
    negative : int
        Negative eigenvalues, by Sylvester's law of inertia; -1 if rows were exchanged.
    smallest : float
        Smallest pivot.
    solve : callable
        Solution for a right-hand side.
    """

    def __init__(self, A: csr_matrix):
        options = {"SymmetricMode": True}
        lu = splu(A.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)
        pivots = lu.U.diagonal()
        straight = bool((lu.perm_r == lu.perm_c).all())
        self.negative = int((pivots < 0).sum()) if straight else -1
        self.smallest = float(abs(pivots).min())
        self.solve = lu.solve


def negative_pivots(K: csr_matrix) -> tuple[int, float]:
    """Negative and smallest pivots of an elimination without exchange of rows.

    Of what is not symmetric the number is odd where the determinant is negative.
    """
    if K.shape[0] == 0:
        return 0, np.inf
    none = NEUTRAL * largest(K.data) or 1.0
    # a large one that is exactly singular: motions without stiffness get one that counts as none
    for shift in (0.0, none) if K.shape[0] > EIGENVALUES else (0.0,):
        with suppress(RuntimeError):  # a pivot vanishes
            factors = Factorised(K + shift * identity(K.shape[0]))
            if factors.negative >= 0:
                return factors.negative, 0.0 if shift else factors.smallest
    values = np.linalg.eigvals(K.toarray())  # complex ones come in pairs
    return int((values.real < 0).sum()), float(abs(values).min())


# -- the one place where a linear solver is chosen, checked and replaced where it fails ------------

FULL = 0.3  # share of entries from which a dense factorisation is fastest
BAND = 110  # lower plus upper bandwidth up to which a banded one is faster than a sparse one
OPTIONAL = 2000  # unknowns from which the solver of another package pays


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
    n : int, optional
        The last of the pattern's unknowns, if the others only help: their equations have no right
        hand sides, and nobody asks for them.

    Attributes
    ----------
    n : int
        Unknowns that are asked for.
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

    def __init__(self, pattern: FrozenPattern, solver: Solver | None = None, n: int | None = None):
        self.pattern = pattern
        self.n = pattern.shape[0] if n is None else n
        self._helping = pattern.shape[0] - self.n
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
        n = self.pattern.shape[0]
        if pattern.nnz >= FULL * n**2:
            return SolverDense().bind(pattern)
        band = Band(pattern)
        if band.lower + band.upper <= BAND:
            return SolverBanded().bind(pattern, band)
        if n >= OPTIONAL and find_spec("pypardiso") is not None:
            try:
                return SolverPardiso().bind(pattern)
            except ImportError as error:  # its libraries are missing
                warn("linear solver", f"SolverPardiso() is not used: {error}", PerformanceWarning)
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
        if self._helping:
            rhs = np.concatenate([np.zeros((self._helping, *rhs.shape[1:])), rhs])
        out = self._checked(rhs)
        if out is None:
            self._take_over()
            out = self.factors.solve(rhs)
        if not np.logical_and.reduce(np.isfinite(out), axis=None):
            raise SingularMatrixError("the iteration matrix is singular")
        return out[self._helping :]

    def full(self, data: Floats) -> Floats:
        """The matrix (n, n) of the unknowns that are asked for, in full."""
        matrix = self.pattern.assembled(data).toarray()
        k = self._helping
        if not k:
            return matrix
        return matrix[k:, k:] - matrix[k:, :k] @ np.linalg.solve(matrix[:k, :k], matrix[:k, k:])

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
        rows = np.asarray(size.sum(1)).reshape(-1, *(1,) * (rhs.ndim - 1))

        def error(x: Floats, r: Floats) -> float:
            """Largest residual of a row against its terms, at least 1e-13 of what they may be."""
            most = rows * abs(x).max(0) + abs(rhs)
            terms = np.maximum(size @ abs(x) + abs(rhs), 1e-13 * most)
            return float((abs(r) / np.where(terms > 0, terms, 1.0)).max())

        with np.errstate(all="ignore"):
            r = rhs - matrix @ x
            if error(x, r) <= SAME:
                return x
            x = x + factors.solve(r)
            return x if error(x, rhs - matrix @ x) <= SAME else None
