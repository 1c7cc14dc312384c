"""Solves point after point of a path: balance x treatment x Newton."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np

from ..constraints import NullSpace, Treatment
from ..constraints.null_space import BoundNullSpace
from ..integrators.choice import Choice, built
from ..linear import Solver, checked_solver
from ..model import System
from ..model.balance import balance, balance_tangent
from ..model.limits import over_rotated, undefined
from ..newton import NewtonReport, NewtonSettings, newton
from ..types import Floats, IndexArray
from .compiled import CompiledBalance, CompiledProblem
from .critical_points import Elimination, Pivots, Stability, counted
from .problem import PlainProblem, Problem
from .schedule import Functional, Neutral, Point, Schedule, Solution

#: residual, relative to its terms, below which a start counts as an equilibrium
BALANCED = 1e-9


class PathSolver:
    """Solves point after point of a path.

    Parameters
    ----------
    system : System
    treatment : Treatment
    schedule : Schedule
    settings : NewtonSettings
    choice : Choice, optional
        Of the kernels; default: plain ones.
    solver : Solver, optional
        Of linear systems, or of what compiled elimination in blocks leaves.

    Attributes
    ----------
    iterations, attempts : int
        Newton iterations and solves so far, failed ones included.
    neutral : Neutral
        Motions to leave alone.
    """

    def __init__(
        self,
        system: System,
        treatment: Treatment,
        schedule: Schedule,
        settings: NewtonSettings,
        choice: Choice | None = None,
        solver: Solver | None = None,
    ) -> None:
        self.system, self.schedule, self.settings = system, schedule, settings
        self._treatment = treatment
        self.bound = treatment.bind(system, 1.0, large=True)  # forces act where the balance is
        self._asked = checked_solver(solver)
        if self._asked is not None:
            self.bound.solve_with(self._asked)
        self.iterations = self.attempts = 0
        self.neutral = Neutral()
        self._accepted: object | None = None
        self._problem: Problem | None = None
        self._fast: CompiledBalance | None
        #: kernels, and why
        self.choice = Choice("numpy", "asked for") if choice is None else choice
        self.choice, self._fast = built(self.choice, self._compile)

    def _compile(self) -> CompiledBalance:
        own = self.system, self._treatment, self.settings, self.choice.plan, self._asked
        made = CompiledBalance(*own, self.choice.source, self.schedule.spin is not None)
        made.prepare()
        return made

    @property
    def factorisations(self) -> int:
        """So far."""
        compiled = 0 if self._fast is None else self._fast.factorisations
        return self.bound.factorisations + compiled

    @property
    def method(self) -> str:
        """How linear systems are solved."""
        return self.bound.solver.method if self._fast is None else self._fast.method

    @property
    def ended(self) -> tuple[Floats, float]:
        """All rows and the load factor where the last iteration ended."""
        assert self._problem is not None
        return self._problem.solution(), self._problem.t

    def begin(self, point: Point, relief: Floats | None = None) -> None:
        """Take the constraint forces at a point that was not solved here.

        Kernels find them where they start; the plain problem adopts them there, too, if there are
        kernels for all others.
        """
        if self._fast is None or relief is not None:
            self._adopt(point, relief)

    def _adopt(self, point: Point, relief: Floats | None = None) -> None:
        """Have the plain problem start at a point."""
        self.bound.begin(point.y, self.schedule.ground(point.t), 1.0)
        self.bound.guess(False)
        R = balance(self.system, point.y, self.schedule.at(point.t), turns=point.turns).R
        self.bound.adopt(R if relief is None else R - relief)
        self._accepted = self.bound.sought

    def missing(self, point: Point) -> Floats | None:
        """Forces (rows, 3) that keep a point from being an equilibrium; None: it is one."""
        at = balance(self.system, point.y, self.schedule.at(point.t), turns=point.turns)
        if isinstance(self.bound, BoundNullSpace) and not at.R.any():
            return None  # its residual is made of nothing else, unlike that of multipliers
        self._adopt(point)
        y = self.bound.configure()
        left = self.bound.relative(self.bound.reduce(at.R, y), at.size)
        return None if left <= BALANCED else at.R

    def solve(
        self,
        start: Point,
        target: Functional,
        relief: Floats | None = None,
        settings: NewtonSettings | None = None,
        plain: bool = False,
    ) -> tuple[Solution | None, NewtonReport]:
        """The point that fulfils `target`, from the equilibrium `start`; None: not found.

        Parameters
        ----------
        relief : (rows, 3) array, optional
            Forces left out of the balance.
        settings : NewtonSettings, optional
            Instead of those of the path.
        plain : bool
            With plain kernels in any case.
        """
        bound = self.bound
        problem = self._problem = self._started(start, target, relief, plain)
        report = newton(problem, self.settings if settings is None else settings)
        self.iterations += report.iterations
        self.attempts += 1
        if report.converged and (wrong_branch := bound.wrong_branch(problem.y)) is not None:
            report.converged, report.reason = (
                False,
                f"it is on another branch: {wrong_branch}",
            )
        if not report.converged:
            if bound.trouble is not None:
                report.reason = f"{report.reason}: {bound.trouble}"
            if np.isfinite(problem.y).all():
                found = undefined(self.system, problem.y) or over_rotated(self.system, problem.y)
                report.reason += "" if found is None else f"; {found}"
            return None, report
        force = np.array(problem.constraint_force()).reshape(-1)
        y = problem.solution()
        point = Point(y, problem.t, self._turns(start, y))
        assert problem.predicted is not None  # there is always one iteration
        return Solution(point, force, report, problem.predicted), report

    def _started(
        self, start: Point, target: Functional, relief: Floats | None, plain: bool
    ) -> Problem:
        """The problem of a point; the plain one where motions are held, or led by a predictor."""
        special = relief is not None or target.predictor is not None or self.neutral.motions
        if self._fast is not None and not (plain or special):
            return CompiledProblem(self._fast, self.schedule, self.settings, start, target)
        bound = self.bound
        if self._fast is not None:
            self._adopt(start, relief)
        elif self._accepted is not None:
            bound.sought = self._accepted
        bound.begin(start.y, self.schedule.ground(start.t), 1.0)
        bound.guess(False)
        problem = PlainProblem(
            bound, self.schedule, self.settings, start, target, replace(self.neutral), relief
        )
        if target.predictor is not None:
            problem.predict(target.predictor)
        return problem

    def look(self, point: Point) -> Floats:
        """Go to an equilibrium that was begun with; gives its constraint force (n,)."""
        problem = self._problem = self._started(point, Functional(), None, False)
        problem.residual()
        return np.array(problem.constraint_force()).reshape(-1)

    def rate_at(self, point: Point) -> Floats:
        """Derivative (rows, 3) of the coordinates by the load factor at a point begun with."""
        problem = self._started(point, Functional(), None, True)
        problem.residual()
        return problem.rate()

    def rate(self) -> Floats:
        """Derivative (rows, 3) of the coordinates by the load factor at the point solved last."""
        assert self._problem is not None
        return self._problem.rate()

    def inspect(self, point: Point) -> Stability:
        """Stability of an equilibrium; of the point solved last from the stiffness at hand."""
        problem, pivots = self._problem, None
        if isinstance(problem, CompiledProblem) and np.array_equal(problem.y, point.y):
            pivots = problem.pivots()
        if pivots is None:
            pivots = self._plain_pivots(point)
        return counted(self.system, point, self.schedule.at(point.t), pivots)

    def _plain_pivots(self, point: Point) -> Pivots | None:
        """Of the stiffness along the constraints, whatever treats them on the path.

        None for deep trees: their matrix has unknowns that only help, and is not symmetric.
        """
        system, problem = self.system, self._problem
        solver = (self.bound if isinstance(self.bound, BoundNullSpace) else self._null_space).solver
        if solver.n < solver.pattern.shape[0]:
            return None
        symmetric = system.loading.dead_only
        if (
            isinstance(problem, PlainProblem)
            and isinstance(self.bound, BoundNullSpace)
            and np.array_equal(problem.y, point.y)
        ):
            return self._elimination.pivots(problem.stiffness(), symmetric)
        bound, y, amplitudes = self._null_space, point.y, self.schedule.at(point.t)
        at = balance(system, y, amplitudes, turns=point.turns)
        bound.begin(y, y[system.rows :], 1.0)
        bound.reduce(at.R, y)
        data = bound.matrix(balance_tangent(system, at, amplitudes), at.R, y)
        return self._elimination.pivots(data, symmetric)

    @cached_property
    def _null_space(self) -> BoundNullSpace:
        """Of the null space method: at an equilibrium its matrix is the stiffness."""
        return NullSpace().bind(self.system, 1.0)

    @cached_property
    def _elimination(self) -> Elimination:
        bound = self.bound if isinstance(self.bound, BoundNullSpace) else self._null_space
        return Elimination(bound.solver.pattern)

    def _turns(self, start: Point, y: Floats) -> IndexArray | None:
        couplings = self.system.couplings
        if not couplings.count:
            return None
        none = np.zeros(len(couplings.times) + 1)
        return couplings.turns(couplings.starting(start.y, start.turns, none, 1.0, 0.0), y)

    def accept(self) -> None:
        """The point solved last is where the next one starts."""
        if isinstance(self._problem, PlainProblem):
            self.neutral = self._problem.neutral  # as they are there
            self.bound.last = self.bound.moved
            self._accepted = self.bound.sought
