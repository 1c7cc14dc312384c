"""A point of a path as Newton's method sees it: the equations of an equilibrium, in numpy.

The last unknown is the change of the load factor. The tangent's geometric part is taken with the
stresses that the last increment predicts to first order, see
:func:`skfem_cosserat.model.balance.predicted`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np
from scipy.sparse.linalg import LinearOperator, cg

from ..constraints.base import BoundTreatment
from ..linear import SingularMatrixError
from ..model import System
from ..model.balance import Balance, balance, balance_tangent, external_force, predicted
from ..newton import NewtonSettings
from ..types import Array, Floats
from .schedule import Functional, Neutral, Point, Schedule, weights

#: why a step fails whose displacement the loads do not change
UNMOVED = "the load factor does not change what is prescribed"
#: rate of what is prescribed, relative to its terms, below which it does not change
STANDS = 1e-10
#: change of the load factor for its difference quotients
SMALL = 1e-6


class Problem(ABC):
    """What plain and compiled kernels share: how the load factor goes along.

    Increments are those of the unknowns, in any linear form, and of the load factor.

    Attributes
    ----------
    t : float
        Load factor.
    predicted : (rows, 3) array or None
        Change of the coordinates by the first increment.
    """

    def __init__(
        self,
        system: System,
        schedule: Schedule,
        settings: NewtonSettings,
        start: Point,
        target: Functional,
    ) -> None:
        self.system, self.schedule, self.settings = system, schedule, settings
        self.start, self.target = start, target
        self.t = start.t
        self.predicted: Array | None = None
        self._by_t: Array | None = None
        self._missing = 0.0
        #: the increment measured last, and its sizes: the loop asks, and so does :meth:`apply`
        self._sized: tuple[Floats | None, tuple[float, float]] = None, (0.0, 0.0)

    # -- what kernels do ---------------------------------------------------------------------------

    @property
    @abstractmethod
    def y(self) -> Array:
        """All rows (total, 3) of the configuration evaluated last."""

    @property
    @abstractmethod
    def R(self) -> Array:
        """Balance (rows, 3) there, without constraint forces."""

    def solution(self) -> Floats:
        """A copy of them, from which other steps may start."""
        return np.array(self.y)

    def constraint_force(self) -> Array:
        """What balances R (rows, 3)."""
        return -self.R

    @abstractmethod
    def _evaluate(self) -> float:
        """Residual at the present configuration; its size against its terms."""

    @abstractmethod
    def _by_ground(self, ends: tuple[float, float]) -> tuple[list[Array], list[Array]]:
        """Residuals and configurations at these load factors, same increments, then back."""

    @abstractmethod
    def _by_loads(self, ends: tuple[float, float]) -> Array:
        """Difference of the residuals at these load factors where the ground rests."""

    @abstractmethod
    def _solutions(self, by_t: Array | None) -> Array:
        """Increments (size, 1 or 2): minus solutions for the residual and for its derivative."""

    @abstractmethod
    def _along(self, gradient: Floats, increments: Array) -> tuple[Floats, float]:
        """Changes (k,) of what has this gradient (rows, 3); size of the terms of the last one."""

    @abstractmethod
    def _sizes(self, increment: Floats) -> tuple[float, float]:
        """Size of an increment, and of its largest rotation."""

    @abstractmethod
    def _apply(self, increment: Floats, dt: float, predict: bool) -> Array:
        """Move by an increment; gives the change (rows, 3) of the coordinates."""

    @abstractmethod
    def _move_ground(self, t: float) -> None:
        """Where it is at this load factor."""

    @abstractmethod
    def rate(self) -> Floats:
        """Derivative (rows, 3) of the coordinates by the load factor, at a solution."""

    # -- what the Newton loop asks for -------------------------------------------------------------

    def residual(self) -> float:
        """See :class:`skfem_cosserat.newton.NewtonProblem`, as for all below."""
        size = self._evaluate()
        self._missing = self.target(self.start, self.y, self.t)
        return size

    def _factor_derivative(self) -> tuple[Array, Array | None]:
        """Derivatives of the residual and of y by the load factor at fixed unknowns."""
        t, moving = self.t, self.schedule.moving
        step = SMALL * (max(abs(t), abs(self.start.t)) or 1.0)
        ends = (t - step, t + step) if t >= step or not moving else (t, t + step)
        width = ends[1] - ends[0]
        if not moving:
            return self._by_loads(ends) / width, None
        residuals, ys = self._by_ground(ends)
        by_t = (ys[1] - ys[0])[: self.system.rows] / width
        return (residuals[1] - residuals[0]) / width, by_t

    def direction(self) -> Floats:
        """Newton increment; the target is a row below the matrix."""
        gradient = self.target.gradient
        # a load factor that is given is reached at once; what is missing then is rounding
        free = gradient is not None or self.t - self._missing / self.target.by_factor != self.t
        r_t, self._by_t = self._factor_derivative() if free else (None, None)
        both = self._solutions(r_t)
        if r_t is None:
            return np.append(both[:, 0], 0.0)
        along, slope, terms = float(self._missing), self.target.by_factor, 0.0
        if gradient is not None:
            changes, terms = self._along(gradient, both)
            along += float(changes[0])
            slope += float(changes[1])
            if self._by_t is not None:
                slope += float((gradient * self._by_t).sum())
        if abs(slope) <= STANDS * terms:
            raise SingularMatrixError(UNMOVED)
        dt = -along / slope
        return np.append(both[:, 0] + dt * both[:, 1], dt)

    def sizes(self, increment: Floats) -> tuple[float, float]:
        """The load factor's relative to itself."""
        if self._sized[0] is increment:
            return self._sized[1]
        size, turn = self._sizes(increment[:-1])
        dt = abs(float(increment[-1]))
        if dt:
            size = max(size, dt / max(abs(self.start.t), abs(self.t), abs(self.t + increment[-1])))
        self._sized = increment, (size, turn)
        return size, turn

    def apply(self, increment: Floats) -> None:
        """Move configuration and load factor."""
        dt = float(increment[-1])
        change = self._apply(increment[:-1], dt, self.sizes(increment)[0] > self.settings.mixed)
        if self.predicted is None:
            self.predicted = change
        if dt:
            self.t += dt
            if self.schedule.moving:
                self._move_ground(self.t)


class PlainProblem(Problem):
    """With numpy, for either treatment.

    Parameters
    ----------
    bound : BoundTreatment
        At the start of the step.
    schedule, settings, start, target
        See :class:`Problem`.
    neutral : Neutral, optional
        Motions to leave alone.
    relief : (rows, 3) array, optional
        Forces left out of the balance.
    """

    def __init__(
        self,
        bound: BoundTreatment,
        schedule: Schedule,
        settings: NewtonSettings,
        start: Point,
        target: Functional,
        neutral: Neutral | None = None,
        relief: Floats | None = None,
    ) -> None:
        super().__init__(bound.system, schedule, settings, start, target)
        self.bound, self.relief = bound, relief
        self.neutral = Neutral() if neutral is None else neutral
        self._stresses: list[Array] | None = None

    @property
    def y(self) -> Array:
        """See the base class, as for all below."""
        return self.at.y

    @property
    def R(self) -> Array:
        """Less the relief."""
        return self.at.R

    def constraint_force(self) -> Array:
        """As the treatment has it."""
        return self.bound.impulse(self.at.R)

    def _balance(self, y: Array, t: float) -> Balance:
        amplitudes = self.schedule.at(t)
        out = balance(self.system, y, amplitudes, self.start.y, self.start.turns)
        if self.relief is not None:
            out.R = out.R - self.relief
        return out

    def _evaluate(self) -> float:
        y = self.bound.configure()
        self.at = self._balance(y, self.t)
        self._r = self.bound.reduce(self.at.R, y)
        return self.bound.relative(self._r, self.at.size)

    def _by_ground(self, ends: tuple[float, float]) -> tuple[list[Array], list[Array]]:
        bound = self.bound
        sought = bound.sought
        residuals, ys = [], []
        for end in ends:
            bound.sought = sought
            self._move_ground(end)
            ys.append(bound.configure())
            residuals.append(bound.reduce(self._balance(ys[-1], end).R, ys[-1]).copy())
        bound.sought = sought
        self._move_ground(self.t)
        bound.configure()
        return residuals, ys

    def _by_loads(self, ends: tuple[float, float]) -> Array:
        y, bound = self.at.y, self.bound
        if self.system.couplings.count:
            first, last = (bound.reduce(self._balance(y, end).R, y).copy() for end in ends)
            return last - first
        first, last = (external_force(self.system, y, self.schedule.at(end)) for end in ends)
        return bound.pull(first - last)

    def _move_ground(self, t: float) -> None:
        self.bound.ground1 = self.schedule.ground(t)

    def predict(self, change: Floats) -> None:
        """Move by a change of the coordinates, as near to it as the constraints allow.

        A load factor that is given is reached at once: where the step starts the stiffness may be
        singular.
        """
        self.residual()
        self._assemble()  # sets the scaling of the unknowns
        bound = self.bound
        metric = weights(self.system)
        size = bound.solver.n

        def project(u: Floats) -> Floats:
            return bound.pull(metric * bound.displacement(u, self.at.y))

        operator = LinearOperator((size, size), matvec=project, dtype=float)
        unknowns, _ = cg(operator, bound.pull(metric * change), rtol=1e-10, maxiter=10 * size)
        given = self.target.gradient is None
        self.apply(np.append(unknowns, -self._missing / self.target.by_factor if given else 0.0))

    def rate(self) -> Floats:
        """At a solution."""
        r_t, by_t = self._factor_derivative()
        data = self.stiffness()
        slope = -self.bound.solver.solve(data, self.bound.scale_rows(r_t))
        change = self.bound.displacement(slope, self.at.y)
        return np.asarray(change if by_t is None else change + by_t, dtype=float)

    def stiffness(self) -> Floats:
        """Entries of the iteration matrix with the stresses that there are: at a solution."""
        self._stresses = None
        return self._assemble()

    def _assemble(self) -> Floats:
        """Entries of the iteration matrix, with the predicted stresses if there are some."""
        system, bound, at = self.system, self.bound, self.at
        blocks = balance_tangent(system, at, self.schedule.at(self.t), self._stresses)
        R = at.R
        if self._stresses is not None:
            change = [a - b for a, b in zip(self._stresses, at.stresses, strict=True)]
            R = R + system.internal_force(at.Bs, change)
        bound.reduce(R, at.y)
        return bound.matrix(blocks, R, at.y)

    def _solutions(self, by_t: Array | None) -> Array:
        """Without motions that nothing holds.

        There the matrix is singular to rounding, and a solution would wander along. The motion at
        this configuration comes from the last one by a step of inverse iteration.
        """
        bound, neutral = self.bound, self.neutral
        W = weights(self.system) if neutral.motions else np.zeros(0)
        columns = [self._r] if by_t is None else [self._r, by_t]
        count = len(columns)
        data = self._assemble()  # sets the scaling
        both = [bound.scale_rows(c) for c in columns]
        both += [bound.scale_rows(bound.pull(W * z)) for z in neutral.motions]
        X = -bound.solver.solve(data, np.column_stack(both))
        if not neutral.motions:
            return X
        Z = X[:, count:]
        weighted = [np.sqrt(W) * bound.displacement(z, self.at.y) for z in Z.T]
        moved = np.column_stack([each.ravel() for each in weighted])
        Q, sizes, mix = np.linalg.svd(moved, full_matrices=False)
        still = 1 / sizes <= neutral.limit  # their eigenvalues
        if not still.any():
            return X[:, :count]
        Q, U = Q[:, still], (Z @ mix.T / sizes)[:, still]
        neutral.motions = [(q.reshape(-1, 3) / np.sqrt(W)) for q in Q.T]
        for k in range(count):
            change = (np.sqrt(W) * bound.displacement(X[:, k], self.at.y)).ravel()
            X[:, k] -= U @ (Q.T @ change)
        return X[:, :count]

    def _along(self, gradient: Floats, increments: Array) -> tuple[Floats, float]:
        pulled = self.bound.pull(gradient)
        return pulled @ increments, float(abs(pulled) @ abs(increments[:, -1]))

    def _sizes(self, increment: Floats) -> tuple[float, float]:
        return self.bound.sizes(increment, self.at.y)

    def _apply(self, increment: Floats, dt: float, predict: bool) -> Array:
        change = self.bound.displacement(increment, self.at.y)
        if self._by_t is not None:
            change = change + dt * self._by_t
        self._stresses = predicted(self.system, self.at, change) if predict else None
        self.bound.move(increment)
        return change
