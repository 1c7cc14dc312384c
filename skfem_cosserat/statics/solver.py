"""One point of a path: balance x treatment x Newton, at a load factor or with it as an unknown."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..constraints import Treatment
from ..integrators.choice import Choice
from ..linear import LinearSolver, Solver, checked_solver
from ..model import System
from ..model.balance import balance
from ..model.bending import bent_elements
from ..newton import NewtonReport, NewtonSettings, newton
from ..types import Floats, IndexArray
from .fast import CompiledBalance, CompiledProblem
from .point import Functional, Neutral, Point, Solution
from .problem import PlainProblem, Problem
from .schedule import Schedule
from .stability import Look, counted, inspect

__all__ = ["Equilibrium"]


class Equilibrium:
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
        self.bound = treatment.bind(system, 1.0)  # forces act where the balance is taken
        if checked_solver(solver) is not None:
            self.bound.solver = LinearSolver(self.bound.solver.pattern, solver)
        self.iterations = self.attempts = 0
        self.neutral = Neutral()
        self._accepted: object | None = None
        self._problem: Problem | None = None
        self._fast: CompiledBalance | None = None
        if choice is not None and choice.name == "numba":
            self._fast = CompiledBalance(system, settings, choice.plan, solver)

    @property
    def factorisations(self) -> int:
        """So far."""
        compiled = 0 if self._fast is None else self._fast.factorisations
        return self.bound.solver.factorisations + compiled

    @property
    def method(self) -> str:
        """How linear systems are solved."""
        return self.bound.solver.method if self._fast is None else self._fast.method

    def begin(self, point: Point, relief: Floats | None = None) -> None:
        """Take the constraint forces at a point that was not solved here."""
        self.bound.begin(point.y, self.system.ground(point.t), 1.0)
        self.bound.guess(False)
        R = balance(self.system, point.y, self.schedule.at(point.t), turns=point.turns).R
        self.bound.adopt(R if relief is None else R - relief)
        self._accepted = self.bound.save()

    def unbalanced(self, point: Point) -> float:
        """Residual, relative to its terms, at a point that was begun with."""
        at = balance(self.system, point.y, self.schedule.at(point.t), turns=point.turns)
        y = self.bound.configuration()
        return self.bound.relative(self.bound.residual(at.R, y), at.size)

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
        if report.converged and (astray := bound.astray(problem.y)) is not None:
            report.converged, report.reason = False, f"it has turned over: {astray}"
        if not report.converged:
            if bound.trouble is not None:
                report.reason = f"{report.reason}: {bound.trouble}"
            if np.isfinite(problem.y).all():
                bent = bent_elements(self.system, problem.y)
                report.reason += "" if bent is None else f"; {bent}"
            return None, report
        force = np.array(bound.constraint_impulse(problem.R)).reshape(-1)
        y = np.array(problem.y)
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
        if self._accepted is not None:
            bound.restore(self._accepted)
        bound.begin(start.y, self.system.ground(start.t), 1.0)
        bound.stay()
        problem = PlainProblem(
            bound, self.schedule, self.settings, start, target, replace(self.neutral), relief
        )
        if target.predictor is not None:
            problem.predict(target.predictor)
        return problem

    def rate_at(self, point: Point) -> Floats:
        """Derivative (rows, 3) of the coordinates by the load factor at a point begun with."""
        target = Functional(None, 1.0, 0.0)
        problem = PlainProblem(self.bound, self.schedule, self.settings, point, target)
        problem.residual()
        return problem.rate()

    def rate(self) -> Floats:
        """Derivative (rows, 3) of the coordinates by the load factor at the point solved last."""
        assert self._problem is not None
        return self._problem.rate()

    def inspect(self, point: Point) -> Look:
        """Stability of the point solved last; compiled kernels count pivots."""
        amplitudes = self.schedule.at(point.t)
        problem = self._problem
        if isinstance(problem, CompiledProblem) and np.array_equal(problem.y, point.y):
            return counted(self.system, point, amplitudes, problem.pivots())
        return inspect(self.system, point, amplitudes)

    def _turns(self, start: Point, y: Floats) -> IndexArray | None:
        couplings = self.system.couplings
        if not couplings.count:
            return None
        none = np.zeros(len(couplings.times) + 1)
        return couplings.turns(couplings.starting(start.y, start.turns, none, 1.0), y)

    def accept(self) -> None:
        """The point solved last is where the next one starts."""
        if isinstance(self._problem, PlainProblem):
            self.neutral = self._problem.neutral  # as they are there
        self.bound.finish()
        self._accepted = self.bound.save()
