"""Base classes of the treatments of constraints, and independent constraint rows."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from math import cos, isinf
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.linalg import splu

from ..frozen import Frozen
from ..linear import LinearSolver, SingularMatrixError, Solver
from ..model import System
from ..model.closure import Selected
from ..model.groups import Blocks
from ..model.loops import Passages
from ..pattern import FrozenPattern, sum_at
from ..types import NO_INDICES, Array, Floats, IndexArray, largest

# --------------------------------------------------------------------------------------------------
# The constraint Jacobian at one configuration: least-norm solutions, also with redundant rows.


def massless(system: System) -> Array:
    """Mask (n,) of the coordinates that have no mass, such as d3 of beams."""
    return np.repeat(system.mass.diagonal() == 0, 3)


def rows_touching(system: System, coordinates: Array) -> Array:
    """Mask (m,) of the constraint rows that contain any of the coordinates, a mask (n,).

    Evaluated at a random configuration, where no terms cancel.
    """
    y = np.random.default_rng(1).uniform(0.5, 1.5, (system.total, 3))
    G = abs(system.constraints.jacobian(y)).tocsr()
    largest = np.asarray(G.max(1).todense()).ravel()
    return np.asarray(G[:, np.flatnonzero(coordinates)].sum(1)).ravel() > 1e-12 * largest


def dependent_rows(system: System, y: Floats) -> IndexArray:
    """Numbers of the constraint rows that depend on the others at y (total, 3)."""
    if not len(system.closure.rows):
        return NO_INDICES
    return np.flatnonzero(~system.independent_rows(y))


class RowSpace:
    """``G G^T`` of the independent rows of ``G(y)``, factorised once.

    Raises
    ------
    SingularMatrixError
        If those rows depend on each other, in a configuration of lower rank.
    """

    def __init__(self, system: System, y: Floats):
        self.m = system.m
        G = system.constraints.jacobian(y).tocsr()
        self._dropped = dependent_rows(system, y)
        self._kept = np.setdiff1d(np.arange(system.m), self._dropped)
        self._G = G[self._kept]
        try:
            self._gram = splu((self._G @ self._G.T).tocsc())
        except RuntimeError as error:  # SuperLU: exactly singular
            raise SingularMatrixError("the constraint rows depend on each other") from error
        # G_dropped = C^T G_kept, so the columns of (-C, I) are the null space of G^T
        self._C = self._gram.solve((self._G @ G[self._dropped].T).toarray())

    def multipliers(self, force: Floats) -> Floats:
        """Lambda (m,) of least norm with ``G^T lambda = force`` for a force (n,) in its range."""
        out = np.zeros(self.m)
        out[self._kept] = self._gram.solve(self._G @ force)
        if len(self._dropped):
            C = self._C
            weight = np.linalg.solve(C.T @ C + np.eye(len(self._dropped)), C.T @ out[self._kept])
            out[self._kept] -= C @ weight
            out[self._dropped] = weight
        return out

    def least_norm(self, rhs: Floats) -> Floats:
        """Vector (n,) of least norm with ``G v = rhs``; redundant rows must agree with the rest."""
        return self._G.T @ self._gram.solve(rhs[self._kept])


# -- what a treatment of the constraints is to an integrator ---------------------------------------
#
# An integrator writes its discrete balance without constraint forces, ``R(y_1)`` (rows, 3) with the
# dimension of momentum, and says at which configuration ``y_c = (1 - w) y_0 + w y_1`` the
# constraint forces act (``w`` is its `constraint_weight`). A treatment turns this into a square
# system: ``R + h G(y_c)^T lambda = 0, g(y_1) = 0``, or ``P(y_c)^T R = 0`` with ``y_1 = F_d(u,
# y_0)``.

#: smallest pivot of closing rows, relative, above which a position is regular for all purposes
REGULAR = 1e-3
#: share of the smallest pivot of closing rows that motions (rad, or relative to the scene) may use
#: up before rows are chosen again: they are products of two things that turn, so change by twice as
#: much at most, and are more than half as far from singular then
CLEAR = 0.2
#: trace of a rotation of 3.12 rad in a step, which counts as half a turn
SMALLEST = 1 + 2 * cos(3.12)
_ONES = np.ones(9)


class Treatment(Frozen, ABC):
    """A choice; :meth:`bind` makes the arrays for a system.

    An own treatment derives from it. Its :meth:`bind` gives what one of the built-in treatments
    gives for the scene, or a :class:`BoundTreatment` of its own, which has the equations.

    Attributes
    ----------
    name : str
        As in ``history.meta["treatment"]``.
    reference : str
        Where the method comes from.
    """

    name: str
    reference: str

    def __repr__(self) -> str:
        return f"{type(self).__name__}()"

    @abstractmethod
    def bind(self, system: System, weight: float, large: bool = False) -> BoundTreatment:
        """Arrays for `system` and an integrator with this `constraint_weight`.

        `large`: increments may be large, as those along a path of equilibria.
        """


class BoundTreatment(ABC):
    """A treatment at work on one system; holds the configuration sought in a step.

    The abstract methods, and these four attributes, are what an own treatment has to give.

    Attributes
    ----------
    unknowns : int
        How many independent ones there are.
    solver : LinearSolver
        Of its linear systems.
    sought : object
        The configuration sought, each treatment its own: replaced by what moves it, never changed
        in place.
    moved : array
        Increments of the step so far, each treatment its own. A step twice as long is guessed to
        have twice that.
    """

    solver: LinearSolver
    unknowns: int
    sought: Any
    moved: Array
    #: solver that is asked for; None: by size
    asked: Solver | None = None
    #: sizes of the terms of the last rows of the residual, which are no balance but constraints
    gap_terms: Floats = np.zeros(0)
    #: factor of these rows in the matrix
    gap_scale: float = 1.0
    #: which unknowns of the solver are in use in this step; None: all
    active: NDArray[np.bool_] | None = None
    #: whether each configuration is one that motions lead to
    by_motion: bool = False
    #: why the last configuration could not be formed, such as a loop that does not close
    trouble: str | None = None
    #: what the start of the step is worth a warning for, such as a singular position: item, text
    doubts: Sequence[tuple[str, str]] = ()
    #: whether all constraints that count as independent are so, by far, where the step starts
    regular: bool = True
    #: motion (rad, or relative to the scene) within which no singular position can be
    clearance: float = 0.0
    #: constraint rows that close loops in this step, independent of each other
    closing: IndexArray = NO_INDICES
    #: increments of the last step, for one of the size of this one; None: there are none
    last: Array | None = None
    #: rows at the start of the step; the ground's rows at its end, which may change on the way
    y0: Array
    ground1: Array

    _sized: bool = False

    def __init__(self, system: System, weight: float):
        self.system = system
        self.weight = weight
        self._passages = Passages(system)

    @abstractmethod
    def begin(self, y0: Array, ground1: Array, h: float, momentum: Floats | None = None) -> None:
        """Start a step of size h from y0 (all rows), with the ground's rows at its end.

        `momentum` (n,): given if a run starts with this step, or goes on after a break.
        """

    @abstractmethod
    def guess(self, extrapolate: bool) -> None:
        """Go to the start of the iteration: last step's increment again, or none.

        Where increments may be large, and for none, constraint forces stay those found last.
        """

    @abstractmethod
    def configure(self) -> Array:
        """``y_1`` (all rows) sought, with the ground at its end where it is now."""

    @abstractmethod
    def reduce(self, R: Array, y1: Array) -> Array:
        """Residual (unknowns,) for the balance R (rows, 3)."""

    @abstractmethod
    def pull(self, gradient: Array) -> Array:
        """Derivative (unknowns,) by the unknowns of what has this `gradient` (rows, 3) by q_1.

        At the configuration evaluated last, for constraint forces that act there (weight 1).
        """

    @abstractmethod
    def matrix(self, blocks: Sequence[Blocks], R: Array, y1: Array, scaled: bool = True) -> Floats:
        """Entries of the iteration matrix in the solver's pattern; as solved, or unscaled."""

    @abstractmethod
    def displacement(self, increment: Array, y1: Array) -> Array:
        """Change (rows, 3) of the coordinates that an increment makes at y_1, to first order."""

    @abstractmethod
    def move(self, increment: Array) -> None:
        """Move the configuration by an increment (unknowns,)."""

    @abstractmethod
    def impulse(self, R: Array) -> Array:
        """``h G(y_c)^T lambda`` (rows, 3) at the solution."""

    # -- what follows from them; built-in ones know more of the last three ------------------------

    def solve_with(self, solver: Solver) -> None:
        """Take this solver for the linear systems, not the one chosen by their size."""
        self.asked = solver
        if "solver" in vars(self):
            self.solver = LinearSolver(self.solver.pattern, solver, self.solver.n)

    @property
    def factorisations(self) -> int:
        """So far."""
        made = vars(self).get("solver")  # compiled steps leave it unmade
        return 0 if made is None else made.factorisations

    def relative(self, residual: Array, term: float) -> float:
        """Size of a residual against the largest term of the balance; constraints by their own."""
        if self.trouble is not None:
            return float("inf")
        n = len(residual) - len(self.gap_terms)
        size = relative_size(largest(residual[:n]), term)
        if not len(self.gap_terms):
            return size
        return float(np.max([size, largest(residual[n:] / self.gap_terms)]))  # NaN stays

    def scale_rows(self, residual: Array) -> Array:
        """The residual in the scaling of the matrix."""
        if not len(self.gap_terms):
            return residual
        out = residual.copy()
        out[len(residual) - len(self.gap_terms) :] *= self.gap_scale
        return out

    def constraint_point(self, y1: Array) -> Array:
        """``y_c``, all rows."""
        if self.weight == 0:
            return self.y0
        return (1 - self.weight) * self.y0 + self.weight * y1

    def wrong_branch(self, y1: Array) -> str | None:
        """Message about what the step put on a wrong branch of its constraints; None: nothing.

        No motion leads there. With constraint forces at the midpoint: about a frame that has turned
        by half a turn, too.
        """
        if not self.by_motion and (wrong := self.system.wrong_branch(y1)) is not None:
            return wrong
        return half_turn(self.system, self.y0, y1) if 0.0 < self.weight < 1.0 else None

    def sizes(self, increment: Floats, y1: Array) -> tuple[float, float]:
        """Size of an increment at y_1 (relative to the scene, or rad), and of its largest rotation.

        A change of directors stands for a rotation.
        """
        system = self.system
        d = abs(self.displacement(increment, y1))
        shift = d[system.origin_rows].max(initial=0.0) / system.length
        turn = d[system.kinematics.director_rows].max(initial=0.0)
        return float(max(shift, turn)), float(turn)

    def adopt(self, R: Array) -> None:
        """Take the constraint forces that balance R (rows, 3) best as those found last.

        Of a step that has begun. (Only multipliers keep forces.)
        """
        return

    def clear(self, y: Floats) -> bool:
        """True if the rows that close loops are far from dependent at y; sets `clearance` there."""
        system = self.system
        again = system.closure.again(self._taken, y, system.kinematics.values_at(y))
        pivots = np.array([s.pivots.min(initial=1.0) for s in again])
        self.clearance = CLEAR * pivots.min()
        return bool((pivots > self._least / 2).all())  # else others may do better

    def _choose_rows(self, y0: Array, T: Floats, momentum: Floats | None) -> list[Selected]:
        """Independent rows that close the loops in a step from y0, T being the tree's entries."""
        chosen = self.system.closure.select(y0, T)
        if momentum is not None:
            self._passages = Passages(self.system)
        self.doubts = self._passages.look(y0, T, chosen)
        self._taken = chosen
        self._least = np.array([s.pivots.min(initial=1.0) for s in chosen])
        least = float(self._least.min())
        self.regular = least > REGULAR
        self.clearance = CLEAR * least if self.regular else 0.0
        self.closing = np.concatenate([s.rows for s in chosen])
        return chosen

    def _scale_gaps(self, blocks: Sequence[Array]) -> None:
        """Scale constraint rows by the largest entry of the first matrix of a step."""
        if not self._sized:  # a scene without stiffness, on a path, has blocks of zeros
            self.gap_scale = max(float(abs(b).max()) for b in blocks) or 1.0
            self._sized = True


def half_turn(system: System, y0: Array, y1: Array) -> str | None:
    """Message about a frame that has turned by half a turn in a step; None: none has.

    Two of its directors vanish at the midpoint then, and with them all that constraints there ask
    for: forces without bound solve such a step, and its energy may be anything.
    """
    directors = system.kinematics.directors
    wrong = np.flatnonzero((directors(y0) * directors(y1)).reshape(-1, 9) @ _ONES < SMALLEST)
    if not len(wrong):
        return None
    return f"{system.owner[system.kinematics.frames[wrong[0]]].label} by half a turn"


def relative_size(size: float, term: float) -> float:
    """Size of a residual against the largest term; infinite if the terms are."""
    if isinf(term):
        return float("inf")
    return size / term if term > 0 else size


class Congruence:
    """``Z_left^T A Z_right`` of matrices of two patterns, in one of its own.

    Parameters
    ----------
    full, by : FrozenPattern
        Of A, and of Z.

    Attributes
    ----------
    pattern : FrozenPattern
        Of the product, whatever vanishes in it.
    """

    def __init__(self, full: FrozenPattern, by: FrozenPattern):
        self._full = full
        self._by = by
        Z = by.matrix(np.ones(len(by.slot)))
        whole = (Z.T @ full.matrix(np.ones(len(full.slot))) @ Z).tocoo()
        self.pattern = FrozenPattern(whole.row, whole.col, whole.shape)
        self._codes = self.pattern.columns * whole.shape[0] + self.pattern.indices

    def data(self, A: Floats, left: Floats, right: Floats) -> Floats:
        """Entries in :attr:`pattern` from those of A and of Z."""
        product = self._by.matrix(left).T @ self._full.assembled(A) @ self._by.matrix(right)
        found = product.tocoo()  # without sums that vanish
        size = self.pattern.shape[0]
        places = np.searchsorted(self._codes, found.col.astype(np.int64) * size + found.row)
        return sum_at(places, found.data, self.pattern.nnz)


def group_pairs(system: System, dofs: list[IndexArray]) -> tuple[IndexArray, IndexArray]:
    """Row and column numbers of all block entries, groups one after the other."""
    rows = [d.repeat(d.shape[1], 1).ravel() for d in dofs]
    cols = [np.tile(d, (1, d.shape[1])).ravel() for d in dofs]
    return np.concatenate(rows), np.concatenate(cols)


def pair_numbers(pairs: IndexArray, base: IndexArray) -> tuple[IndexArray, IndexArray]:
    """Row and column numbers of 3x3 blocks at `pairs` (k, 2) of rows of y, numbered from `base`."""
    xyz = np.arange(3)
    rows = base[pairs[:, 0]][:, None, None] + xyz[:, None]
    cols = base[pairs[:, 1]][:, None, None] + xyz
    shape = (len(pairs), 3, 3)
    return np.broadcast_to(rows, shape).ravel(), np.broadcast_to(cols, shape).ravel()
