"""Velocities on the hidden constraints, and multipliers, of many states at once.

Both follow from symmetric systems whose pattern is that of the scene and whose entries are
polynomials of the rows of y. They are solved for all states together: each elementary operation of
the elimination is one on arrays over the states.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np
from scipy.sparse import coo_matrix, csr_matrix, identity
from scipy.sparse.csgraph import connected_components, maximum_bipartite_matching
from scipy.sparse.linalg import splu

from ..compiled.kept import NotKept, Source, compile_errors, entry, loaded
from ..compiled.structures import STACKED, structure
from ..linear import SingularMatrixError
from ..model import System
from ..model.quadratic import TOGETHER
from ..types import Floats, IndexArray
from .base import RowSpace, dependent_rows
from .gradients import WRONG, is_lattice
from .saddle import hidden_rate, nearest_velocity, saddle_point

#: columns of matrices whose elimination by numpy takes as long as compiling kernels for it
COMPILING = 200_000
#: residual, relative to its terms, above which a solution is improved
ROUGH = 1e-13
#: part that is left of pivots of constraint rows where others are chosen
LEFT = 1e-2
#: (k, i, c, sign) of ``(a x b)_k = sum sign a_i b_c``
_CROSS = [(k, (k + s) % 3, (k - s) % 3, float(s)) for k in range(3) for s in (1, -1)]

# -- symmetric matrices of one pattern -------------------------------------------------------------


class Polynomials:
    """Entries of a matrix as sums of monomials of some variables.

    Attributes
    ----------
    one : int
        Number of the variable that is one: monomials of a lower degree have it.
    """

    def __init__(self, one: int) -> None:
        self.one = one
        self._terms: list[tuple[IndexArray, ...]] = []
        self._factors: list[Floats] = []

    def add(
        self, rows: IndexArray, columns: IndexArray, factors: Floats, *variables: IndexArray
    ) -> None:
        """Add ``factor * product of variables`` to entries, and to those across the diagonal.

        Variables that are -1 are left out.
        """
        of = [np.where(each < 0, self.one, each) for each in variables]
        of += [np.full(len(rows), self.one)] * (4 - len(of))
        self._terms.append((np.maximum(rows, columns), np.minimum(rows, columns), *of))
        self._factors.append(factors)

    def entries(self) -> Entries:
        """All that was added."""
        parts = zip(*self._terms, strict=True)
        rows, columns, *of = (np.concatenate(each).astype(np.int64) for each in parts)
        powers = np.sort(of, axis=0)
        top = int(powers.max(initial=self.one)) + 1
        pairs = [np.unique(powers[k] * top + powers[k + 1], return_inverse=True) for k in (0, 2)]
        width = len(pairs[1][0])
        both, which = np.unique(pairs[0][1] * width + pairs[1][1], return_inverse=True)
        first, second = pairs[0][0][both // width], pairs[1][0][both % width]
        monomials = np.stack([first // top, first % top, second // top, second % top], axis=1)
        size = int(columns.max(initial=0)) + 1
        places, where = np.unique(rows * size + columns, return_inverse=True)
        shape = (len(places), len(monomials))
        sums = coo_matrix((np.concatenate(self._factors), (where, which)), shape=shape).tocsr()
        return Entries(places // size, places % size, sums, monomials, self.one)


@dataclass(eq=False)
class Entries:
    """Entries of the lower triangle, and how they follow from variables."""

    rows: IndexArray
    columns: IndexArray
    sums: csr_matrix
    powers: IndexArray
    one: int

    def __post_init__(self) -> None:
        # products of many variables come first: each factor is that of a slice of them
        powers, none = self.powers, self.powers == self.one
        order = np.argsort(none.sum(axis=1), kind="stable")
        shift = np.argsort(none[order], axis=1, kind="stable")
        self.powers = np.take_along_axis(powers[order], shift, axis=1)
        place = np.argsort(order).astype(self.sums.indices.dtype)
        self.sums = csr_matrix(
            (self.sums.data, place[self.sums.indices], self.sums.indptr), shape=self.sums.shape
        )

    def values(self, variables: Floats) -> Floats:
        """Entries (e, N) for variables (k, N), one of which is one."""
        out = variables[self.powers[:, 0]]
        for factors in self.powers.T[1:]:
            some = int((factors != self.one).sum())
            out[:some] *= variables[factors[:some]]
        return self.sums @ out


class _Kernels:
    """The compiled elimination, which gives the same bits, in a process that has kernels."""

    found = False
    #: columns that numpy has eliminated in the meantime
    columns = 0
    #: after how many columns it is looked for, and where: it is compiled when that would have paid
    tries: tuple[tuple[int, Source], ...] = (0, Source.DISK), (COMPILING, Source.COMPILER)

    @classmethod
    def take(cls, columns: int) -> bool:
        """Whether kernels are to eliminate so many columns; False: numpy is."""
        if not cls.found and cls.tries and loaded():
            cls.columns += columns
            (after, source), *others = cls.tries
            if cls.columns >= after:
                cls.tries = tuple(others)
                try:
                    have_stacked(source)
                except NotKept:
                    return False
                except compile_errors():  # plain numpy goes on
                    return False
                cls.found = True
        return cls.found

    @staticmethod
    def run(
        name: str, X: Floats, start: IndexArray, places: IndexArray, x: Floats, scratch: int
    ) -> None:
        """Call one of them; see :mod:`skfem_cosserat.compiled.stacked`, which names its numbers."""
        arrays = X, start, places, x, np.empty((scratch, X.shape[1]))
        given = structure("stacked", dict(zip(STACKED, arrays, strict=True)))
        entry("stacked", name, given)()


def have_stacked(source: Source) -> None:
    """Get both kernels ready.

    Raises
    ------
    NotKept
        If they are in none of the places that they may come from.
    """
    none, places = np.zeros((0, 0)), np.zeros(0, dtype=np.int64)
    arrays = none, places, places, none, none
    given = structure("stacked", dict(zip(STACKED, arrays, strict=True)))
    for name in ("factors", "solve"):
        entry("stacked", name, given, source)


class StackedSolver:
    """Symmetric matrices of one pattern: ``L D L^T`` in a given order, no pivot chosen.

    Parameters
    ----------
    entries : Entries
    order : (size,) int array
        In which unknowns are eliminated.
    """

    def __init__(self, entries: Entries, order: IndexArray) -> None:
        size = self.size = len(order)
        self.entries, self._order = entries, order
        place = np.empty(size, dtype=np.int64)
        place[order] = np.arange(size)
        i, j = place[entries.rows], place[entries.columns]
        i, j = np.maximum(i, j), np.minimum(i, j)
        below: list[set[int]] = [set() for _ in order]
        for a, b in zip(i.tolist(), j.tolist(), strict=True):
            if a != b:
                below[b].add(a)
        #: of each column the rows below its diagonal, and where they are kept
        self._below = []
        for own in below:
            under = sorted(own)
            self._below.append(np.array(under, dtype=np.int64))
            if under:
                below[under[0]].update(under[1:])
        counts = [len(rows) for rows in self._below]
        self._start = size + np.concatenate([[0], np.cumsum(counts)])
        self.slots = int(self._start[-1])
        keys = np.concatenate([
            np.arange(size) * (size + 1),
            *(rows * size + k for k, rows in enumerate(self._below)),
        ])  # fmt: skip
        sort = np.argsort(keys)

        def slot(a: IndexArray, b: IndexArray) -> IndexArray:
            return sort[np.searchsorted(keys, a * size + b, sorter=sort)]

        self._slot = slot(i, j)
        self._i, self._j = i, j
        pairs = {k: np.tril_indices(k) for k in set(counts)}
        ends = [pairs[k] for k in counts]
        targets = [(rows[a], rows[b]) for rows, (a, b) in zip(self._below, ends, strict=True)]
        every = slot(*(np.concatenate(each) for each in zip(*targets, strict=True)))
        parts = np.split(every, np.cumsum([len(a) for a, _ in ends])[:-1])
        self._updates = [(a, b, to) for (a, b), to in zip(ends, parts, strict=True)]
        self._to, self._rows = every, np.concatenate([*self._below, order[:0]])
        sides = [(i, i != j), (j, np.ones(len(i), bool))]
        self._sides = [
            csr_matrix((np.ones(k.sum()), (to[k], np.flatnonzero(k))), shape=(size, len(i)))
            for to, k in sides
        ]

    def factors(self, values: Floats) -> Floats:
        """D and L (slots, N) of matrices with these entries (e, N)."""
        X = np.zeros((self.slots, values.shape[1]))
        X[self._slot] = values
        if _Kernels.take(self.size):
            most = max(map(len, self._below))
            _Kernels.run("factors", X, self._start, self._to, X[:0], most)
            return X
        for k, (a, b, to) in enumerate(self._updates):
            if len(to):
                own = slice(self._start[k], self._start[k + 1])
                column = X[own] / X[k]
                X[to] -= column[a] * X[own][b]
                X[own] = column
        return X

    def solve(self, X: Floats, rhs: Floats) -> Floats:
        """Solutions (size, N) for factors and right-hand sides (size, N)."""
        x = rhs[self._order]
        if _Kernels.take(self.size):
            _Kernels.run("solve", np.ascontiguousarray(X), self._start, self._rows, x, 1)
        else:
            self._solve(X, x)
        out = np.empty_like(x)
        out[self._order] = x
        return out

    def _solve(self, X: Floats, x: Floats) -> None:
        """Put solutions in the place of right-hand sides, both in the order of elimination."""
        for k, rows in enumerate(self._below):
            if len(rows):
                x[rows] -= X[self._start[k] : self._start[k + 1]] * x[k]
        x /= X[: self.size]
        for k in range(self.size - 1, -1, -1):
            rows = self._below[k]
            if len(rows):
                x[k] -= (X[self._start[k] : self._start[k + 1]] * x[rows]).sum(0)

    def residual(self, values: Floats, x: Floats, rhs: Floats) -> tuple[Floats, Floats]:
        """``rhs - A x`` (size, N), and the sizes of its terms."""
        own = x[self._order]
        lower, upper = values * own[self._j], values * own[self._i]
        product = np.zeros_like(own)
        terms = abs(rhs[self._order])
        for matrix, part in zip(self._sides, (lower, upper), strict=True):
            product += matrix @ part
            terms += matrix @ abs(part)
        left = np.empty_like(own)
        left[self._order] = rhs[self._order] - product
        out = np.empty_like(terms)
        out[self._order] = terms
        return left, out


# -- what a scene's rows are made of ---------------------------------------------------------------


def least_fill(rows: IndexArray, columns: IndexArray, size: int) -> IndexArray:
    """Order of elimination (size,) that leaves a symmetric pattern sparse."""
    ones = -np.ones(len(rows))
    A = coo_matrix((ones, (rows, columns)), shape=(size, size))
    A = (abs(A) + abs(A.T)).astype(bool).astype(float)
    A = ((size + 1) * identity(size) - A).tocsc()
    options = {"SymmetricMode": True}
    lu = splu(A, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)
    return np.argsort(lu.perm_c)


class Contributions(NamedTuple):
    """To the constraint Jacobian: ``G_(row, 3 at + c) = factor * other * drive``, in order of `at`.

    Attributes
    ----------
    row, at, c : (k,) int arrays
        Constraint row, free row of y and component.
    factor : (k,) array
    other, drive : (k,) int arrays
        Variables, numbers in y; -1: there is none.
    """

    row: IndexArray
    at: IndexArray
    c: IndexArray
    factor: Floats
    other: IndexArray
    drive: IndexArray


def contributions(system: System) -> Contributions:
    """All of a scene."""
    t = system.constraints.terms()
    drive = np.where(t.drive_row < 0, -1, 3 * t.drive_row + t.drive_component)
    parts = []
    for c in range(3):
        for at, other in ((t.left, t.right), (t.right, t.left)):
            parts.append((t.row, at, np.full(len(at), c), t.factor, 3 * other + c, drive))
        none = np.full(len(t.linear), -1)
        own = np.full(len(t.linear), c)
        parts.append((t.linear_row + c, t.linear, own, t.linear_factor, none, none))
    every = [np.concatenate(each) for each in zip(*parts, strict=True)]
    order = np.argsort(3 * every[1] + every[2], kind="stable")
    order = order[every[1][order] < system.rows]
    return Contributions(*(each[order] for each in every))


def variables_of(y: Floats) -> Floats:
    """Rows y (N, total, 3) as variables (3 total + 1, N), the last one being one."""
    out = np.empty((3 * y.shape[1] + 1, len(y)))
    out[:-1] = y.reshape(len(y), -1).T
    out[-1] = 1.0
    return out


class Stacked:
    """Symmetric systems of a scene, solved for many states together.

    Rows from `first` on belong to constraints, from number `shift` on. Of those that depend on
    others some are left out, chosen at one state for all at which the others stay independent.
    """

    def __init__(self, system: System, entries: Entries, order: IndexArray, first: int) -> None:
        self.system, self.entries, self.first = system, entries, first
        self.solver = StackedSolver(entries, order)
        self.shift = system.m - (self.solver.size - first)
        self.loops = len(system.closure.rows) > 0
        diagonal = np.flatnonzero(entries.rows == entries.columns)
        self._diagonal = np.full(self.solver.size, -1)
        self._diagonal[entries.rows[diagonal]] = diagonal
        self._rows = np.flatnonzero((entries.rows >= first) & (entries.columns < first))
        position = np.argsort(order)
        self._constrained = position[first:]
        size = max(self.solver.slots, len(entries.powers))
        self.chunk = int(np.clip(2 * TOGETHER // size, 32, 256))

    @cached_property
    def parts(self) -> IndexArray:
        """Number (size,) of the part of the matrix that each row is in, which no entry leaves."""
        ones = np.ones(len(self.entries.rows))
        places, size = (self.entries.rows, self.entries.columns), self.solver.size
        graph = coo_matrix((ones, places), shape=(size, size))
        return connected_components(graph, directed=False)[1]

    def solve(self, y: Floats, rhs: Floats, consistent: bool) -> Iterator[tuple[Any, ...]]:
        """Solutions for states y (N, total, 3) and right-hand sides (size, N), part by part.

        Yields
        ------
        places : (k,) int array
            The states.
        solutions : (size, k) array
            Zero for what is left out; None: those of the state are to be found otherwise.
        left_out : (l,) int array
            Unknowns.
        couple : callable
            Solves with the same factors, and gives the columns of what is left out.
        """
        every = self.entries.values(variables_of(y))
        todo = np.arange(len(y))
        while len(todo):
            whole = len(todo) == len(y)
            values, b = (every, rhs) if whole else (every[:, todo], rhs[:, todo])
            with np.errstate(all="ignore"):  # where it fails others are found otherwise
                X, x, error, out = self._tried(y[todo[0]], values, b, consistent)
            good = error < WRONG
            if good.all():
                yield todo, x, out, X, values
                return
            if good.any():
                yield todo[good], x[:, good], out, X[:, good], values[:, good]
            # with other rows left out more may be solved together
            alone = ~good
            if self.loops:
                alone = np.arange(len(good)) == (-1 if good[0] else 0)
            for k in todo[alone]:
                yield np.array([k]), None, out, X, values
            todo = todo[~(good | alone)]

    def _tried(
        self, first: Floats, values: Floats, rhs: Floats, consistent: bool
    ) -> tuple[Floats, Floats, Floats, IndexArray]:
        """Factors, solutions, errors (N,), and what is left out, as chosen at the first state."""
        out, every, b = np.zeros(0, dtype=np.int64), values, rhs
        if self.loops:
            out = dependent_rows(self.system, first) - self.shift
            out = out[out >= 0] + self.first
        if len(out):
            gone = np.isin(self.entries.rows, out) | np.isin(self.entries.columns, out)
            values, b = np.where(gone[:, None], 0.0, values), rhs.copy()
            values[self._diagonal[out]] = 1.0 if self.first == 0 else -1.0
            b[out] = 0.0
        X = self.solver.factors(values)
        x = self.solver.solve(X, b)
        error = self._error(values, x, b)
        if (rough := error > ROUGH).any():  # each state by itself, whatever is beside it
            x[:, rough] += self.solver.solve(X, self.solver.residual(values, x, b)[0])[:, rough]
            error = self._error(values, x, b)
        if self.loops:
            pivots = abs(X[self._constrained])
            error = np.where((pivots > LEFT * pivots[:, :1]).all(0), error, np.inf)
        if len(out) and consistent:  # what is left out holds, too
            error = np.maximum(error, self._error(every, x, rhs))
        return X, x, error, out

    def _error(self, values: Floats, x: Floats, rhs: Floats) -> Floats:
        """Largest residuals (N,) of momenta and of constraints, against their largest terms."""
        left, terms = self.solver.residual(values, x, rhs)
        scales = terms[: self.first].max(0, initial=0.0), terms[self.first :].max(0, initial=0.0)
        if self.first:  # of rows in which nothing moves rounding is left of what moves elsewhere
            moved = abs(values[self._rows]).max(0, initial=0.0) * abs(x[: self.first]).max(0)
            scales = scales[0], np.maximum(scales[1], moved)
        error = np.zeros(x.shape[1])
        for size, scale in zip((left[: self.first], left[self.first :]), scales, strict=True):
            part = abs(size).max(0, initial=0.0) / np.where(scale > 0, scale, 1.0)
            error = np.maximum(error, part)
        return np.where(np.isfinite(error), error, np.inf)


# -- velocities: (P_int^T M P_int) nu + C^T mu = P_int^T p, C nu = r -------------------------------


class StackedVelocities:
    """Velocities on the hidden constraints nearest to momenta, in the kinetic energy.

    Unknowns are the velocity and angular velocity of each frame, ``v = P_int nu``, so that the
    constraints of triads hold by themselves, and the mass matrix is regular although a director
    has no mass; ``C = G P_int`` are the rows of joints, drives and held strains.
    """

    def __init__(self, system: System) -> None:
        self.system, one = system, 3 * system.total
        count = len(system.origin_rows)
        sizes = np.where(system.is_frame[:count], 6, 3)
        self._starts = np.concatenate([[0], np.cumsum(sizes)])
        self.size = int(self._starts[-1])
        self._vertex = np.repeat(np.arange(count), np.where(sizes == 6, 4, 1))
        motion = self._motions()
        row = 3 * np.arange(system.rows)[:, None, None] + np.arange(3)[:, None]
        row, unknown, variable, factor = (
            each.ravel() for each in np.broadcast_arrays(row, *motion)
        )
        some = factor != 0
        row, unknown, variable, factor = (e[some] for e in (row, unknown, variable, factor))
        nothing = np.zeros(len(row), dtype=np.int64)
        reduced, moved, made = Polynomials(one), Polynomials(one), Polynomials(one)
        reduced.add(unknown, nothing, factor, one + 1 + row, variable)
        moved.add(row, nothing, factor, one + 1 + unknown, variable)
        self._momenta, self._velocities = reduced.entries(), moved.entries()
        touched = self._add_masses(made, *motion)
        of_row = self._add_rows(made, *motion)
        order = self._order(touched, of_row)
        self.stacked = Stacked(system, made.entries(), order, self.size)

    def _motions(self) -> tuple[IndexArray, IndexArray, Floats]:
        """How unknowns move the components of rows of y: (rows, 3, 2) each.

        Unknown, variable (-1: none), factor; zero where there is none.
        """
        system = self.system
        start = self._starts[self._vertex]
        kind = np.arange(system.rows) - system.origin_rows[self._vertex]
        unknown = np.zeros((system.rows, 3, 2), dtype=np.int64)
        variable, factor = unknown - 1, np.zeros(unknown.shape)
        unknown[:, :, 0] = start[:, None] + np.arange(3)
        factor[:, :, 0] = 1.0
        turned = np.flatnonzero(kind)
        for n, (k, i, c, sign) in enumerate(_CROSS):
            unknown[turned, k, n % 2] = start[turned] + 3 + i
            variable[turned, k, n % 2] = 3 * turned + c
            factor[turned, k, n % 2] = sign
        return unknown, variable, factor

    def _add_masses(
        self, made: Polynomials, unknown: IndexArray, variable: IndexArray, factor: Floats
    ) -> IndexArray:
        """Add ``P_int^T M P_int``; the pairs of vertices that masses couple."""
        mass = self.system.mass.tocoo()
        for a in (0, 1):
            for b in (0, 1):
                ij = (mass.row, slice(None), a), (mass.col, slice(None), b)
                row, column = (unknown[k] for k in ij)
                product = mass.data[:, None] * factor[ij[0]] * factor[ij[1]]
                some = (product != 0) & (row >= column)
                made.add(
                    *(row[some], column[some], product[some]),
                    *(variable[k][some] for k in ij),
                )
        return np.stack([self._vertex[mass.row], self._vertex[mass.col]], axis=1)

    def _add_rows(
        self, made: Polynomials, unknown: IndexArray, variable: IndexArray, factor: Floats
    ) -> list[set[int]]:
        """Add ``C``; the vertices that each constraint row touches."""
        system, first = self.system, self.size - self.system.internal
        found = contributions(system)
        outer = found.row >= system.internal
        row, at, c, own, other, drive = (each[outer] for each in found)
        for a in (0, 1):
            product = own * factor[at, c, a]
            some = product != 0
            column, more = unknown[at, c, a][some], variable[at, c, a][some]
            made.add(first + row[some], column, product[some], more, other[some], drive[some])
        each_row = np.arange(self.size, self.size + system.m - system.internal)
        made.add(each_row, each_row, np.zeros(len(each_row)))
        of_row: list[set[int]] = [set() for _ in range(system.m)]
        for r, v in np.unique(np.stack([row, self._vertex[at]], axis=1), axis=0).tolist():
            of_row[r].add(v)
        return of_row

    def _order(self, touched: IndexArray, of_row: list[set[int]]) -> IndexArray:
        """Vertex by vertex, each with rows that hold it to others: these find regular pivots."""
        pairs = [(a, b) for row in of_row for a in row for b in row]
        joined = np.array(pairs, dtype=np.int64).reshape(-1, 2)
        ij = np.unique(np.concatenate([touched, joined]), axis=0)
        starts, internal = self._starts, self.system.internal
        count, free = len(starts) - 1, np.diff(starts)
        sequence = least_fill(ij[:, 0], ij[:, 1], count)
        # rows of one joint hold one vertex, which no other joint holds; others close loops
        groups: list[tuple[frozenset[int], list[int]]] = []
        for r in range(internal, len(of_row)):
            vertices = frozenset(of_row[r])
            most = min(int(free[v]) for v in vertices)
            if not groups or groups[-1][0] != vertices or len(groups[-1][1]) >= most:
                groups.append((vertices, []))
            groups[-1][1].append(self.size - internal + r)
        ends = [(k, v) for k, (vertices, _) in enumerate(groups) for v in vertices]
        k, v = np.array(ends, dtype=np.int64).reshape(-1, 2).T
        graph = csr_matrix((np.ones(len(k)), (k, v)), shape=(len(groups), count))
        match = maximum_bipartite_matching(graph, perm_type="column")
        held: list[list[int]] = [[] for _ in range(count + 1)]
        for (_, rows), own in zip(groups, match.tolist(), strict=True):
            held[own] += rows  # those that hold none come last
        order = [[*range(starts[v], starts[v + 1]), *held[v]] for v in sequence.tolist()]
        return np.array([each for own in (*order, held[-1]) for each in own], dtype=np.int64)

    def __call__(self, y: Floats, p: Floats, rate: Floats) -> Floats:
        """Velocities (N, n) for momenta p (N, n) and rates of the rows (N, m) at y (N, total, 3).

        Raises
        ------
        SingularMatrixError
            Where a motion has no inertia.
        """
        out, variables = np.empty_like(p), variables_of(y)
        b = np.zeros((self.stacked.solver.size, len(p)))
        b[self._momenta.rows] = self._momenta.values(np.concatenate([variables, p.T]))
        b[self.size :] = rate[:, self.system.internal :].T
        for some, x, *_ in self.stacked.solve(y, b, consistent=True):
            if x is None:
                k = int(some[0])
                out[k] = saddle_point(self.system)(y[k], p[k], rate[k])[0]
                continue
            v = np.empty((p.shape[1], len(some)))
            known = np.concatenate([variables[:, some], x[: self.size]])
            v[self._velocities.rows] = self._velocities.values(known)
            out[some] = v.T
        return out


@lru_cache(maxsize=4)
def _velocities(system: System) -> StackedVelocities:
    return StackedVelocities(system)


def nearest_velocities(system: System, y: Floats, p: Floats, t: Sequence[float | None]) -> Floats:
    """Velocities (N, n) on the hidden constraints nearest to p (N, n), in the kinetic energy.

    As :func:`.saddle.nearest_velocity` at each of the states y (N, total, 3), times t (N,).
    """
    if is_lattice(system) or len(p) < 2:  # one alone has not to lay out the elimination
        states = zip(y, p, t, strict=True)
        return np.array([nearest_velocity(system, *each) for each in states]).reshape(p.shape)
    out, solver = np.empty_like(p), _velocities(system)
    for first in range(0, len(p), solver.stacked.chunk):
        some = slice(first, first + solver.stacked.chunk)
        rate = np.zeros((len(p[some]), system.m))
        if system.moving:
            for k, s in enumerate(t[some]):
                rate[k] = hidden_rate(system, y[some][k], s)
        out[some] = solver(y[some], p[some], rate)
    return out


# -- multipliers: G G^T lambda = G f ---------------------------------------------------------------


@lru_cache(maxsize=4)
def _gram(system: System) -> Stacked:
    """``G G^T``."""
    made, found = Polynomials(3 * system.total), contributions(system)
    # all pairs of contributions to one column
    _, starts, counts = np.unique(3 * found.at + found.c, return_index=True, return_counts=True)
    per = np.repeat(counts, counts)
    a = np.repeat(np.arange(len(found.row)), per)
    b = np.arange(len(a)) - np.repeat(np.cumsum(per) - per, per)
    b += np.repeat(np.repeat(starts, counts), per)
    some = found.row[a] >= found.row[b]
    a, b = a[some], b[some]
    factors = found.factor[a] * found.factor[b]
    others = found.other[a], found.other[b], found.drive[a], found.drive[b]
    made.add(found.row[a], found.row[b], factors, *others)
    entries = made.entries()
    return Stacked(system, entries, least_fill(entries.rows, entries.columns, system.m), 0)


@lru_cache(maxsize=4)
def _forces(system: System) -> Entries:
    """``G f``, of rows y followed by forces."""
    one, found = 3 * system.total, contributions(system)
    made, column = Polynomials(one), np.zeros(len(found.row), dtype=np.int64)
    force = one + 1 + 3 * found.at + found.c
    made.add(found.row, column, found.factor, force, found.other, found.drive)
    return made.entries()


def stacked_multipliers(system: System, y: Floats, force: Floats) -> Floats:
    """Lambda (N, m) of least norm with ``G(y)^T lambda = force``, for stacks.

    Parameters
    ----------
    y : (N, total, 3) array
    force : (N, n) array
        NaN rows give NaN.

    Returns
    -------
    (N, m) array
        NaN where the rows depend on each other.
    """
    out = np.full((len(y), system.m), np.nan)
    known = np.flatnonzero(np.isfinite(force).all(axis=1))
    if not system.m or not len(known):
        return out
    if len(known) == 1:  # it has not to lay out the elimination
        with suppress(SingularMatrixError):
            out[known[0]] = RowSpace(system, y[known[0]]).multipliers(force[known[0]])
        return out
    gram, forces = _gram(system), _forces(system)
    for first in range(0, len(known), gram.chunk):
        some = known[first : first + gram.chunk]
        variables = np.concatenate([variables_of(y[some]), force[some].T])
        rhs = np.zeros((system.m, len(some)))
        rhs[forces.rows] = forces.values(variables)
        for part, x, dropped, X, values in gram.solve(y[some], rhs, False):
            k = some[part]
            if x is None:
                with suppress(SingularMatrixError):  # stays NaN
                    out[k[0]] = RowSpace(system, y[k[0]]).multipliers(force[k[0]])
                continue
            out[k] = (_least(gram, x, dropped, X, values) if len(dropped) else x).T
    return out


def _least(gram: Stacked, x: Floats, dropped: IndexArray, X: Floats, values: Floats) -> Floats:
    """Of all multipliers that give the same forces those of least norm.

    Rows of separate loops do not couple: one of each is solved for at the same time.
    """
    entries, part = gram.entries, gram.parts
    order = np.argsort(part[dropped], kind="stable")
    own = part[dropped[order]]
    turn = np.full(gram.solver.size, -1)  # of rows that are left out, among those of their part
    turn[dropped[order]] = np.arange(len(own)) - np.searchsorted(own, own)
    columns = np.zeros((turn.max() + 1, *x.shape))
    for left_out, other in ((entries.rows, entries.columns), (entries.columns, entries.rows)):
        there = np.flatnonzero((turn[left_out] >= 0) & (turn[other] < 0))
        columns[turn[left_out[there]], other[there]] = values[there]
    # G_dropped = C^T G_kept, so the columns of (-C, I) are the null space of G^T
    C = np.array([gram.solver.solve(X, column) for column in columns])
    one = np.arange(len(part))
    sums = csr_matrix((np.ones(len(part)), (part, one)), shape=(part.max() + 1, len(part)))
    inner = np.array([[sums @ (a * b) for b in C] for a in C]).transpose(2, 3, 0, 1)
    force = np.array([sums @ (a * x) for a in C]).transpose(1, 2, 0)
    weight = np.linalg.solve(inner + np.eye(len(C)), force[..., None])[part, :, :, 0]
    out = x - np.einsum("isn,sni->sn", C, weight)
    out[dropped] = weight[dropped, :, turn[dropped]]
    return out
