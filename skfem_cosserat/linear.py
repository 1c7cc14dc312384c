"""Solvers of linear systems, sparse, banded and dense, by other packages."""

from __future__ import annotations

import ctypes
import weakref
from abc import ABC, abstractmethod
from collections.abc import Callable
from importlib.util import find_spec
from typing import Any

import numpy as np
from scipy.linalg import get_lapack_funcs
from scipy.sparse import csc_matrix
from scipy.sparse.csgraph import reverse_cuthill_mckee
from scipy.sparse.linalg import spilu, splu

from .errors import CosseratError, InputError, PerformanceWarning
from .frozen import Frozen
from .pattern import FrozenPattern
from .types import Array, Floats, IndexArray, switch
from .warn import logger, warn

# -- what a back end is: a choice (:class:`Solver`), and its factors of one pattern ----------------


class SingularMatrixError(CosseratError):
    """The iteration matrix is singular to working precision."""


class Solver(Frozen):
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


# -- orderings that fill in little, found once for a pattern on a graph of few vertices ------------
#
# Unknowns whose columns have the same entries (the six of a node) are one vertex of the graph: the
# ordering costs a fortieth, and the unknowns of a node stay together in the factors.

#: pivots on the diagonal are taken down to this part of the largest entry of their column
THRESHOLD = 0.01


def mirrored(pattern: FrozenPattern) -> tuple[csc_matrix, Array]:
    """Pattern with all entries mirrored at the diagonal, and a mark (n,) of what each column has.

    The mark is a sum of random numbers of the rows: two different sets agree once in 2^64.
    """
    marks = np.random.default_rng(0).integers(0, 2**63, pattern.shape[0], dtype=np.uint64)
    both = pattern.assembled(np.ones(pattern.nnz, dtype=np.uint64))
    columns = both.T @ marks
    if (both @ marks != columns).any():
        both = csc_matrix(both + both.T)
        both.data[:] = 1
        columns = both.T @ marks
    return both, columns


def balanced(pattern: FrozenPattern) -> bool:
    """Whether the pattern is its own transpose with all of the diagonal in it."""
    both, _ = mirrored(pattern)
    return both.nnz == pattern.nnz and bool(both.diagonal().all())


def merged(pattern: FrozenPattern) -> tuple[IndexArray, csc_matrix]:
    """Groups of unknowns with the same neighbours, and the graph of the groups.

    Returns
    -------
    group : (n,) int array
        Group of each unknown, numbered by their first ones.
    graph : sparse matrix
        Symmetric pattern of the groups.
    """
    both, columns = mirrored(pattern)
    _, first, group = np.unique(columns, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    graph = both[:, first[order]][first[order]].astype(float)
    graph.data[:] = -1.0
    return rank[group.reshape(-1)], graph


def minimum_degree(graph: csc_matrix) -> IndexArray:
    """Groups in the order of SuperLU's multiple minimum degree.

    It goes with a factorisation only: the incomplete one that drops all it can costs the least.
    """
    values = graph.copy()
    values.setdiag(1.0 + np.diff(graph.indptr))  # no pivot is exchanged
    lu = spilu(
        csc_matrix(values),
        drop_tol=1.0,
        fill_factor=1.0,
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )
    return np.argsort(lu.perm_c)


def nested_dissection(graph: csc_matrix) -> IndexArray:
    """Groups in the order of METIS.

    Raises
    ------
    ImportError
        If pymetis is not installed.
    """
    try:
        import pymetis
    except ImportError as error:
        raise ImportError(
            "SolverMetis() needs pymetis: pip install 'skfem-cosserat[solvers]'"
        ) from error
    links = graph.copy()
    links.setdiag(0)
    links.eliminate_zeros()
    if links.nnz == 0:
        return np.arange(graph.shape[0])
    neighbours = np.split(links.indices, links.indptr[1:-1])
    order, _ = pymetis.nested_dissection(adjacency=[near.tolist() for near in neighbours])
    return np.array(order, dtype=np.int64)


def unknowns_in_order(
    pattern: FrozenPattern, rule: Callable[[csc_matrix], IndexArray]
) -> IndexArray:
    """Unknowns (n,), group by group in the order that a rule gives the groups."""
    group, graph = merged(pattern)
    position = np.empty(graph.shape[0], dtype=np.int64)
    position[rule(graph)] = np.arange(graph.shape[0])
    return np.argsort(position[group], kind="stable")


class Permuted:
    """A pattern whose rows and columns are brought into another order, once.

    Attributes
    ----------
    order : (n,) int array
        Unknowns in the new order.
    """

    def __init__(self, pattern: FrozenPattern, order: IndexArray) -> None:
        position = np.empty(len(order), dtype=pattern.indices.dtype)
        position[order] = np.arange(len(order))
        entries = np.arange(pattern.nnz), position[pattern.indices], pattern.indptr
        self.order = order
        self._entries = csc_matrix(entries, shape=pattern.shape)[:, order]
        self._entries.sort_indices()

    def matrix(self, data: Floats) -> csc_matrix:
        """The matrix of these entries (nnz,) of the pattern, in the new order."""
        new = self._entries
        out = csc_matrix((data[new.data], new.indices, new.indptr), shape=new.shape)
        out.has_canonical_format = True
        return out


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
        """See the base class."""
        return _Dense(pattern)


class _Dense(Factors):
    name = SolverDense.name

    def __init__(self, pattern: FrozenPattern) -> None:
        self._n = pattern.shape[0]
        cols = np.repeat(np.arange(self._n), np.diff(pattern.indptr))
        self._where = pattern.indices.astype(np.int64) + self._n * cols
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

    def __init__(self, pattern: FrozenPattern) -> None:
        n = pattern.shape[0]
        self.order: IndexArray = reverse_cuthill_mckee(mirrored(pattern)[0], symmetric_mode=True)
        self.position: IndexArray = np.empty(n, dtype=np.int64)
        self.position[self.order] = np.arange(n)
        i, j = self.ends(pattern)
        i -= j
        self.lower, self.upper = int(i.max(initial=0)), -int(i.min(initial=0))

    def ends(self, pattern: FrozenPattern) -> tuple[Array, Array]:
        """Rows and columns (nnz,) of the pattern's entries in this order."""
        position = self.position.astype(pattern.indices.dtype)
        return position[pattern.indices], np.repeat(position, np.diff(pattern.indptr))


class SolverBanded(Solver):
    """Banded LU with partial pivoting after a reverse Cuthill-McKee ordering.

    Examples
    --------
    >>> SolverBanded()
    SolverBanded()
    """

    name = "banded"

    def bind(self, pattern: FrozenPattern, band: Band | None = None) -> Factors:
        """See the base class; `band` if it is known already."""
        return _Banded(pattern, Band(pattern) if band is None else band)


class _Banded(Factors):
    name = SolverBanded.name

    def __init__(self, pattern: FrozenPattern, band: Band) -> None:
        self._n, self._band = pattern.shape[0], band
        rows, cols = pattern.indices, np.repeat(np.arange(self._n), np.diff(pattern.indptr))
        self._entries, self._diagonal = (rows, cols), np.flatnonzero(rows == cols)
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
        ordered = rhs.take(b.order, axis=0)
        ordered *= scale
        found = self._gbtrs(self._lu, b.lower, b.upper, ordered, self._pivots, overwrite_b=True)[0]
        found *= scale
        return found.take(b.position, axis=0)

    def _scale_by(self, data: Floats) -> None:
        """Powers of two that bring the diagonal of the first matrix to about one, on both sides.

        Shifts and rotations differ by orders of magnitude: without, half of the columns have their
        pivot elsewhere, and rows that are exchanged fill the band.
        """
        size = np.ones(self._n)
        size[self._entries[0][self._diagonal]] = abs(data[self._diagonal])
        size[~(np.isfinite(size) & (size > 0))] = 1.0
        scale = np.exp2(np.round(-0.5 * np.log2(size)))
        self._scales = scale[self._entries[0]] * scale[self._entries[1]]
        self._scale = scale[self._band.order]


# -- superLU of scipy, in three settings -----------------------------------------------------------


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
        self.symmetric = None if symmetric is None else switch("argument symmetric", symmetric)

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
        self._lu = _factorised(
            self._permuted.matrix(data),
            permc_spec="NATURAL",
            diag_pivot_thresh=THRESHOLD,
            options={"SymmetricMode": True},
        )

    def solve(self, rhs: Floats) -> Floats:
        out = np.empty_like(rhs)
        out[self._permuted.order] = self._lu.solve(rhs[self._permuted.order])
        return out


# -- pardiso of the Intel MKL: the analysis once for a pattern, numbers as often as they change ----
#
# pypardiso finds the library; its own calls repeat the analysis with each matrix, so the library is
# called here. Threads: as many as the environment (``MKL_NUM_THREADS``) lets it take.

#: its numbers of what it can do
ANALYSE, FACTOR, SOLVE = 11, 22, 33


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
        self(-1, [np.zeros(1)] * 5)


class _Pardiso(Factors):
    name = SolverPardiso.name
    pivoting = False

    def __init__(self, pattern: FrozenPattern, library: Any) -> None:
        self._starts = pattern.indptr.astype(np.int32)
        self._rows = pattern.indices.astype(np.int32)
        self._none = np.zeros(pattern.shape[0])
        self._symmetric = balanced(pattern)
        kind = 1 if self._symmetric else 11  # a symmetric pattern, or none
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
        if error == -4:  # zero pivot
            raise SingularMatrixError("the iteration matrix is singular")
        if error == -2:
            raise MemoryError("Pardiso has not enough memory")
        if error:
            raise CosseratError(f"Pardiso failed in phase {phase} with error {error}")


# -- the one place where a linear solver is chosen, checked and replaced where it fails ------------

EIGENVALUES = 300  # unknowns up to which eigenvalues are computed dense
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

    def __init__(
        self, pattern: FrozenPattern, solver: Solver | None = None, n: int | None = None
    ) -> None:
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
        pattern, n = self.pattern, self.pattern.shape[0]
        if n <= DENSE or (n <= MOST and pattern.nnz > FULL * n**2):
            return SolverDense().bind(pattern)
        band = Band(pattern)
        if band.lower + band.upper <= BAND:
            return SolverBanded().bind(pattern, band)
        others = [
            ("pypardiso", SolverPardiso()),
            ("pymetis", SolverMetis()),
        ]
        for package, solver in others if n >= OPTIONAL else []:
            if find_spec(package) is None or (package == "pymetis" and not balanced(pattern)):
                continue
            try:
                return solver.bind(pattern)
            except ImportError as error:  # its libraries are missing
                text = f"{solver!r} is not used: {error}"
                warn("linear solver", text, PerformanceWarning)
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
        matrix, k = self.pattern.assembled(data).toarray(), self._helping
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
