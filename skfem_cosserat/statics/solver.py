"""Solves point after point of a path: balance x treatment x Newton."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from ..constraints import Treatment
from ..integrators.choice import Choice, built
from ..linear import Solver, checked_solver
from ..model import System
from ..model.limits import over_rotated, undefined
from ..newton import NewtonReport, NewtonSettings, newton
from ..types import Floats, IndexArray
from .compiled import CompiledEquations
from .critical_points import Stability, inspect
from .problem import PlainEquations, Problem
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
        self.bound = treatment.bind(system, 1.0, large=True)  # forces act where the balance is
        asked = checked_solver(solver)
        if asked is not None:
            self.bound.solve_with(asked)
        self.plain = PlainEquations(self.bound, schedule)
        self.iterations = self.attempts = 0
        self.neutral = Neutral()
        self._problem: Problem
        #: kernels, and why
        chosen = Choice("numpy", "asked for") if choice is None else choice
        own = schedule, treatment, settings, chosen.plan, asked, chosen.source
        self.choice, self._compiled = built(chosen, partial(CompiledEquations, *own))

    @property
    def factorisations(self) -> int:
        """So far."""
        compiled = 0 if self._compiled is None else self._compiled.factorisations
        return self.bound.factorisations + compiled

    @property
    def method(self) -> str:
        """Name of the method that solves linear systems."""
        return self.bound.solver.method if self._compiled is None else self._compiled.method

    @property
    def ended(self) -> tuple[Floats, float]:
        """All rows and the load factor where the last iteration ended."""
        return self._problem.equations.solution(), self._problem.t

    def missing(self, point: Point) -> Floats | None:
        """Forces (rows, 3) that keep a point from being an equilibrium; None: it is one."""
        equations = self._started(point, Functional(), plain=True).equations
        return None if equations.evaluate(point.t) <= BALANCED else equations.R

    def solve(
        self,
        start: Point,
        target: Functional,
        relief: Floats | float = 0.0,
    ) -> tuple[Solution | None, NewtonReport]:
        """The point that fulfils `target`, from the equilibrium `start`; None: not found.

        Parameters
        ----------
        relief : (rows, 3) array, optional
            Forces left out of the balance.
        """
        bound = self.bound
        special = target.predictor is not None or self.neutral.motions or np.any(relief)
        problem = self._started(start, target, relief, bool(special))
        if target.predictor is not None:
            # a load factor that is given is reached at once: the stiffness may be singular here
            problem.residual()
            given = -problem._missing / target.by_factor if target.gradient is None else 0.0
            increment = np.append(self.plain.nearest(target.predictor), given)
            problem.sizes(increment)
            problem.apply(increment)
        report = newton(problem, self.settings)
        self.iterations += report.iterations
        self.attempts += 1
        y = problem.equations.y
        if report.converged and (wrong_branch := bound.wrong_branch(y)) is not None:
            report.converged, report.reason = (
                False,
                f"it is on another branch: {wrong_branch}",
            )
        if not report.converged:
            if bound.trouble is not None:
                report.reason = f"{report.reason}: {bound.trouble}"
            if np.isfinite(y).all():
                found = undefined(self.system, y) or over_rotated(self.system, y)
                report.reason += "" if found is None else f"; {found}"
            return None, report
        force = np.array(problem.equations.constraint_force()).reshape(-1)
        y = problem.equations.solution()
        point = Point(y, problem.t, self._turns(start, y))
        assert problem.predicted is not None  # there is always one iteration
        return Solution(point, force, report, problem.predicted), report

    def _started(
        self, start: Point, target: Functional, relief: Floats | float = 0.0, plain: bool = False
    ) -> Problem:
        """The problem of a point, at its start."""
        equations: PlainEquations | CompiledEquations
        if self._compiled is None or plain:
            self.plain.relief, self.plain.neutral = relief, replace(self.neutral)
            equations = self.plain
        else:
            equations = self._compiled
        equations.begin(start)
        self._problem = Problem(equations, self.schedule, self.settings, start, target)
        return self._problem

    def look(self, point: Point) -> Floats:
        """Go to an equilibrium; gives its constraint force (n,)."""
        problem = self._started(point, Functional())
        problem.residual()
        return np.array(problem.equations.constraint_force()).reshape(-1)

    def rate_at(self, point: Point) -> Floats:
        """Derivative (rows, 3) of the coordinates by the load factor at an equilibrium."""
        return self._started(point, Functional(), plain=True).rate()

    def rate(self) -> Floats:
        """Derivative (rows, 3) of the coordinates by the load factor at the point solved last."""
        return self._problem.rate()

    def inspect(self, point: Point) -> Stability:
        """Stability of an equilibrium; of the point solved last from the stiffness at hand."""
        problem, pivots = self._problem, None
        if problem.t == point.t and np.array_equal(problem.equations.y, point.y):
            pivots = problem.equations.pivots()
        return inspect(self.system, point, self.schedule.at(point.t), pivots=pivots)

    def _turns(self, start: Point, y: Floats) -> IndexArray | None:
        couplings = self.system.couplings
        if not couplings.count:
            return None
        none = np.zeros(len(couplings.times) + 1)
        return couplings.turns(couplings.starting(start.y, start.turns, none, 1.0, 0.0), y)

    def accept(self) -> None:
        """Motions to leave alone are those of the point solved last."""
        if self._problem.equations is self.plain:
            self.neutral = self.plain.neutral
