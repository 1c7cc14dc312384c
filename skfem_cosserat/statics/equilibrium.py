"""One point of a path: balance x treatment x Newton, at a load factor or with it as an unknown."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.sparse.linalg import LinearOperator, cg

from ..constraints import Treatment
from ..linear import LinearSolver, SingularMatrixError, Solver, checked_solver
from ..model import System
from ..model.balance import Balance, balance, balance_tangent, predicted
from ..model.bending import bent_elements
from ..newton import NewtonReport, NewtonSettings, newton
from ..types import Array, Floats, IndexArray
from .schedule import Schedule

__all__ = ["Equilibrium", "Functional", "Neutral", "Point", "Solution", "weights"]

#: why a step fails whose displacement the loads do not change
UNMOVED = "the load factor does not change what is prescribed"
#: rate of what is prescribed, relative to its terms, below which it does not change
STANDS = 1e-10
#: change of the load factor for its difference quotients
SMALL = 1e-6


def weights(system: System) -> Floats:
    """Weights (rows, 1) that make the square of a motion free of units, a mean over all nodes.

    ``1/length^2`` for positions and 1/2 for directors: a turn by a small angle counts as the angle.
    """
    out = np.full((system.rows, 1), 0.5)
    out[system.origin_rows] = 1 / system.length**2
    return np.asarray(out / len(system.origin_rows))


@dataclass(eq=False, repr=False)
class Point:
    """An equilibrium on a path.

    Attributes
    ----------
    y : (total, 3) array
        All rows.
    t : float
        Load factor.
    turns : (k,) int array or None
        Full turns of the angles of springs, as in a state.
    """

    y: Floats
    t: float
    turns: IndexArray | None = None

    def __repr__(self) -> str:
        """Without the arrays."""
        return f"Point(t={self.t!r}, rows={len(self.y)})"


@dataclass(frozen=True, eq=False)
class Functional:
    """What fixes the place on a path: ``gradient . (y - y_0) + by_factor (t - t_0) = value``.

    Attributes
    ----------
    gradient : (rows, 3) array or None
        None: zero.
    by_factor, value : float
    predictor : (rows, 3) array or None
        Change of the coordinates to start from, where the tangent at the start gives none.
    """

    gradient: Floats | None
    by_factor: float
    value: float
    predictor: Floats | None = None

    def __call__(self, point: Point, y: Array, t: float) -> float:
        """What is missing at (y, t) from a step that starts at `point`."""
        out = self.by_factor * (t - point.t) - self.value
        if self.gradient is not None:
            change = np.real(y[: len(self.gradient)]) - point.y[: len(self.gradient)]
            out += float((self.gradient * change).sum())
        return out

    def share(self, start: Point, end: Point) -> float:
        """What part of `value` a point between is from the start."""
        return 1.0 + self(start, end.y, end.t) / self.value


@dataclass(eq=False)
class Neutral:
    """Motions of an equilibrium that nothing holds and nothing drives, to rounding.

    As of a round column that has buckled: its plane of bending is free.

    Attributes
    ----------
    motions : list of (rows, 3) arrays
        Of unit size in the metric of :func:`weights`, and normal to each other.
    limit : float
        Eigenvalue of the stiffness in that metric up to which a motion counts as neutral.
    """

    motions: list[Array] = field(default_factory=list)
    limit: float = 0.0


@dataclass(eq=False)
class Solution:
    """What a solved point gives beside it.

    Attributes
    ----------
    point : Point
    constraint_force : (n,) array
    report : NewtonReport
    predicted : (rows, 3) array
        Change of the coordinates that the tangent at the start predicts.
    """

    point: Point
    constraint_force: Floats
    report: NewtonReport
    predicted: Floats


class _Problem:
    """A point as the Newton loop sees it; the last unknown is the change of the load factor.

    The tangent's geometric part is taken with the stresses that the last increment predicts to
    first order, see :func:`predicted`.
    """

    def __init__(
        self, solver: Equilibrium, start: Point, target: Functional, relief: Floats | None
    ) -> None:
        self.solver, self.start, self.target, self.relief = solver, start, target, relief
        self.system, self.bound = solver.system, solver.bound
        self.t = start.t
        self._stresses: list[Array] | None = None
        self._by_t: Array | None = None
        self.predicted: Array | None = None

    def _balance(self, y: Array, t: float) -> Balance:
        amplitudes = self.solver.schedule.at(t)
        out = balance(self.system, y, amplitudes, self.start.y, self.start.turns)
        if self.relief is not None:
            out.R = out.R - self.relief
        return out

    def residual(self) -> float:
        y = self.bound.configuration()
        self.at = self._balance(y, self.t)
        self._r = self.bound.residual(self.at.R, y)
        self._missing = self.target(self.start, y, self.t)
        return self.bound.relative(self._r, self.at.size)

    def _factor_derivative(self) -> tuple[Array, Array | None]:
        """Derivatives of the residual and of y by the load factor at fixed unknowns."""
        t, bound, moving = self.t, self.bound, bool(self.system.moving)
        step = SMALL * (max(abs(t), abs(self.start.t)) or 1.0)
        ends = (t - step, t + step) if t >= step or not moving else (t, t + step)
        saved = bound.save()
        residuals, ys = [], []
        for end in ends:
            y = self.at.y
            if moving:
                bound.restore(saved)
                bound.move_ground(self.system.ground(end))
                y = bound.configuration()
            ys.append(y)
            residuals.append(bound.residual(self._balance(y, end).R, y).copy())
        if moving:
            bound.restore(saved)
            bound.move_ground(self.system.ground(t))
            bound.configuration()
        width = ends[1] - ends[0]
        by_t = (ys[1] - ys[0])[: self.system.rows] / width if moving else None
        return (residuals[1] - residuals[0]) / width, by_t

    def predict(self, change: Floats) -> None:
        """Move by a change of the coordinates, as near to it as the constraints allow."""
        self.residual()
        self._assemble()  # sets the scaling of the unknowns
        bound = self.bound
        metric = weights(self.system)
        size = bound.solver.n

        def project(u: Floats) -> Floats:
            return bound.pull(metric * bound.push(u, self.at.y))

        operator = LinearOperator((size, size), matvec=project, dtype=float)
        unknowns, _ = cg(operator, bound.pull(metric * change), rtol=1e-10, maxiter=10 * size)
        self.apply(np.append(unknowns, 0.0))

    def rate(self) -> Floats:
        """Derivative (rows, 3) of the coordinates by the load factor, at a solution."""
        r_t, by_t = self._factor_derivative()
        self._stresses = None
        data = self._assemble()
        slope = -self.bound.solver.solve(data, self.bound.scale_rows(r_t))
        change = self.bound.push(slope, self.at.y)
        return np.asarray(change if by_t is None else change + by_t, dtype=float)

    def _assemble(self) -> Floats:
        """Entries of the iteration matrix, with the predicted stresses if there are some."""
        system, bound, at = self.system, self.bound, self.at
        blocks = balance_tangent(system, at, self.solver.schedule.at(self.t), self._stresses)
        R = at.R
        if self._stresses is not None:
            change = [a - b for a, b in zip(self._stresses, at.stresses, strict=True)]
            R = R + system.internal_force(at.Bs, change)
        bound.residual(R, at.y)
        return bound.data(blocks, R, at.y)

    def direction(self) -> Floats:
        free = self.target.gradient is not None or self._missing != 0
        r_t, self._by_t = self._factor_derivative() if free else (None, None)
        bound, data = self.bound, self._assemble()
        columns = [self._r] if r_t is None else [self._r, r_t]
        both = self._solved(data, columns)
        if r_t is None:
            return np.append(-both[:, 0], 0.0)
        along, slope, terms = float(self._missing), self.target.by_factor, 0.0
        if self.target.gradient is not None:
            gradient = bound.pull(self.target.gradient)
            along -= float(gradient @ both[:, 0])
            slope -= float(gradient @ both[:, 1])
            terms = float(abs(gradient) @ abs(both[:, 1]))
            if self._by_t is not None:
                slope += float((self.target.gradient * self._by_t).sum())
        if abs(slope) <= STANDS * terms:
            raise SingularMatrixError(UNMOVED)
        dt = -along / slope
        return np.append(-both[:, 0] - dt * both[:, 1], dt)

    def _solved(self, data: Floats, columns: list[Floats]) -> Floats:
        """Solutions for residuals, without motions that nothing holds.

        There the matrix is singular to rounding, and a solution would wander along. The motion at
        this configuration comes from the last one by a step of inverse iteration.
        """
        bound, neutral, W = self.bound, self.solver.neutral, weights(self.system)
        both = [bound.scale_rows(c) for c in columns]
        both += [bound.scale_rows(bound.pull(W * z)) for z in neutral.motions]
        X = bound.solver.solve(data, np.column_stack(both))
        count = len(columns)
        if not neutral.motions:
            return X
        Z = X[:, count:]
        moved = np.column_stack([(np.sqrt(W) * bound.push(z, self.at.y)).ravel() for z in Z.T])
        Q, sizes, mix = np.linalg.svd(moved, full_matrices=False)
        still = 1 / sizes <= neutral.limit  # their eigenvalues
        if not still.any():
            return X[:, :count]
        Q, U = Q[:, still], (Z @ mix.T / sizes)[:, still]
        neutral.motions = [(q.reshape(-1, 3) / np.sqrt(W)) for q in Q.T]
        for k in range(count):
            change = (np.sqrt(W) * bound.push(X[:, k], self.at.y)).ravel()
            X[:, k] -= U @ (Q.T @ change)
        return X[:, :count]

    def sizes(self, increment: Floats) -> tuple[float, float]:
        size, turn = self.bound.sizes(increment[:-1])
        dt = abs(float(increment[-1]))
        if dt:
            size = max(size, dt / max(abs(self.start.t), abs(self.t), abs(self.t + increment[-1])))
        return size, turn

    def apply(self, increment: Floats) -> None:
        dt = float(increment[-1])
        change = self.bound.push(increment[:-1], self.at.y)
        if self._by_t is not None:
            change = change + dt * self._by_t
        if self.predicted is None:
            self.predicted = change
        large = self.sizes(increment)[0] > self.solver.settings.mixed
        self._stresses = predicted(self.system, self.at, change) if large else None
        self.bound.apply(increment[:-1])
        if dt:
            self.t += dt
            if self.system.moving:
                self.bound.move_ground(self.system.ground(self.t))

    def save(self) -> object:
        return self.bound.save(), self.t, self._stresses

    def restore(self, saved: Any) -> None:
        self.bound.restore(saved[0])
        self.t, self._stresses = saved[1:]
        if self.system.moving:
            self.bound.move_ground(self.system.ground(self.t))


class Equilibrium:
    """Solves point after point of a path.

    Parameters
    ----------
    system : System
    treatment : Treatment
    schedule : Schedule
    settings : NewtonSettings
    solver : Solver, optional

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
        solver: Solver | None = None,
    ) -> None:
        self.system, self.schedule, self.settings = system, schedule, settings
        self.bound = treatment.bind(system, 1.0)  # forces act where the balance is taken
        if checked_solver(solver) is not None:
            self.bound.solver = LinearSolver(self.bound.solver.pattern, solver)
        self.iterations = self.attempts = 0
        self.neutral = Neutral()
        self._accepted: object | None = None
        self._problem: _Problem | None = None

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
    ) -> tuple[Solution | None, NewtonReport]:
        """The point that fulfils `target`, from the equilibrium `start`; None: not found.

        Parameters
        ----------
        relief : (rows, 3) array, optional
            Forces left out of the balance.
        settings : NewtonSettings, optional
            Instead of those of the path.
        """
        bound = self.bound
        if self._accepted is not None:
            bound.restore(self._accepted)
        bound.begin(start.y, self.system.ground(start.t), 1.0)
        bound.stay()
        problem = self._problem = _Problem(self, start, target, relief)
        if target.predictor is not None:
            problem.predict(target.predictor)
        report = newton(problem, self.settings if settings is None else settings)
        self.iterations += report.iterations
        self.attempts += 1
        if report.converged and (astray := bound.astray(problem.at.y)) is not None:
            report.converged, report.reason = False, f"it has turned over: {astray}"
        if not report.converged:
            if bound.trouble is not None:
                report.reason = f"{report.reason}: {bound.trouble}"
            if np.isfinite(problem.at.y).all():
                bent = bent_elements(self.system, problem.at.y)
                report.reason += "" if bent is None else f"; {bent}"
            return None, report
        force = np.array(bound.constraint_impulse(problem.at.R)).reshape(-1)
        y = np.array(problem.at.y)
        point = Point(y, problem.t, self._turns(start, y))
        assert problem.predicted is not None  # there is always one iteration
        return Solution(point, force, report, problem.predicted), report

    def rate_at(self, point: Point) -> Floats:
        """Derivative (rows, 3) of the coordinates by the load factor at a point begun with."""
        problem = _Problem(self, point, Functional(None, 1.0, 0.0), None)
        problem.residual()
        return problem.rate()

    def rate(self) -> Floats:
        """Derivative (rows, 3) of the coordinates by the load factor at the point solved last."""
        assert self._problem is not None
        return self._problem.rate()

    def _turns(self, start: Point, y: Floats) -> IndexArray | None:
        couplings = self.system.couplings
        if not couplings.count:
            return None
        none = np.zeros(len(couplings.times) + 1)
        return couplings.turns(couplings.starting(start.y, start.turns, none, 1.0), y)

    def accept(self) -> None:
        """The point solved last is where the next one starts."""
        self.bound.finish()
        self._accepted = self.bound.save()
