"""A point of a path as Newton's method sees it, and the equations of an equilibrium in numpy.

The last unknown is the change of the load factor. The tangent's geometric part is taken with the
stresses that the last increment predicts to first order, see
:func:`skfem_cosserat.model.balance.predicted`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse.linalg import LinearOperator, cg

from ..constraints.base import BoundTreatment
from ..linear import SingularMatrixError
from ..model.balance import balance, balance_tangent, predicted
from ..newton import NewtonSettings
from ..types import Array, Floats
from .schedule import Functional, Neutral, Point, Schedule, weights

if TYPE_CHECKING:
    from .compiled import CompiledEquations

#: why a step fails whose displacement the loads do not change
UNMOVED = "the load factor does not change what is prescribed"
#: rate of what is prescribed, relative to its terms, below which it does not change
STANDS = 1e-10


class Problem:
    """A point of a path: equations, and what fixes the place on it.

    Parameters
    ----------
    equations : PlainEquations or CompiledEquations
        At the start.
    schedule : Schedule
    settings : NewtonSettings
    start : Point
    target : Functional

    Attributes
    ----------
    t : float
        Load factor.
    predicted : (rows, 3) array or None
        Change of the coordinates by the first increment.
    """

    def __init__(
        self,
        equations: PlainEquations | CompiledEquations,
        schedule: Schedule,
        settings: NewtonSettings,
        start: Point,
        target: Functional,
    ) -> None:
        self.equations, self.schedule, self.settings = equations, schedule, settings
        self.start, self.target = start, target
        self.t = start.t
        self.predicted: Array | None = None
        #: derivatives of residual and coordinates by t; None: a given load factor is reached
        self._rates: tuple[Array, Array] | None = None
        self._missing = 0.0
        self._mixed = False

    def residual(self) -> float:
        """Evaluate, see :class:`skfem_cosserat.newton.NewtonProblem`."""
        target, t = self.target, self.t
        self._rates = None
        # what is missing from a load factor that is given and reached is rounding
        if (
            target.gradient is not None
            or t != t - target(self.start, self.start.y, t) / target.by_factor
        ):
            self._rates = self.derivative()
        size = self.equations.evaluate(t)
        self._missing = target(self.start, self.equations.y, t)
        return size

    def derivative(self) -> tuple[Array, Array]:
        """Derivatives of the residual and of the coordinates by t at fixed unknowns."""
        equations, t = self.equations, self.t
        step = self.schedule.difference * (max(abs(t), abs(self.start.t)) or 1.0)
        first = t - step if t >= step or not self.schedule.moving else t
        found = []
        for end in (first, t + step):
            equations.evaluate(end)
            found.append((equations.residual.copy(), equations.y[: equations.system.rows].copy()))
        (r0, y0), (r1, y1) = found
        return (r1 - r0) / (t + step - first), (y1 - y0) / (t + step - first)

    def direction(self) -> Floats:
        """Newton increment; the target is a row below the matrix."""
        gradient, equations = self.target.gradient, self.equations
        if self._rates is None:
            return np.append(equations.solve([equations.residual]), 0.0)
        r_t, by_t = self._rates
        both = equations.solve([equations.residual, r_t])
        along, slope, terms = self._missing, self.target.by_factor, 0.0
        if gradient is not None:
            along += float((gradient * equations.displacement(both[:, 0])).sum())
            rates = gradient * (equations.displacement(both[:, 1]) + by_t)
            slope, terms = slope + float(rates.sum()), float(abs(rates).sum())
        if abs(slope) <= STANDS * terms:
            raise SingularMatrixError(UNMOVED)
        dt = -along / slope
        return np.append(both[:, 0] + dt * both[:, 1], dt)

    def sizes(self, increment: Floats) -> tuple[float, float]:
        """Sizes of an increment; that of the load factor is relative to itself."""
        size, turn = self.equations.sizes(increment[:-1])
        dt = abs(float(increment[-1]))
        if dt:
            size = max(size, dt / max(abs(self.start.t), abs(self.t), abs(self.t + increment[-1])))
        self._mixed = size > self.settings.mixed
        return size, turn

    def apply(self, increment: Floats) -> None:
        """Move configuration and load factor by an increment whose size was asked for last."""
        dt = float(increment[-1])
        change = np.array(self.equations.displacement(increment[:-1]))
        if self._rates is not None:
            change += dt * self._rates[1]
        if self.predicted is None:
            self.predicted = change
        self.equations.move(increment[:-1], change if self._mixed else None)
        self.t += dt

    def rate(self) -> Floats:
        """Derivative (rows, 3) of the coordinates by the load factor, at a solution."""
        r_t, by_t = self.derivative()
        self.equations.evaluate(self.t)
        slope = self.equations.solve([r_t], mixed=False)[:, 0]
        return np.asarray(self.equations.displacement(slope) + by_t, dtype=float)


class PlainEquations:
    """The equations of an equilibrium in numpy, for either treatment.

    Increments are those of the unknowns, in any linear form; :class:`CompiledEquations` are called
    likewise.

    Parameters
    ----------
    bound : BoundTreatment
    schedule : Schedule

    Attributes
    ----------
    system : System
    residual : array
        Of the evaluation, in any form; the next one may overwrite it.
    neutral : Neutral
        Motions to leave alone.
    relief : (rows, 3) array or float
        Forces left out of the balance.
    """

    def __init__(self, bound: BoundTreatment, schedule: Schedule) -> None:
        self.bound, self.schedule, self.system = bound, schedule, bound.system
        self.neutral = Neutral()
        self.relief: Floats | float = 0.0
        self._stresses: list[Array] | None = None

    @property
    def y(self) -> Array:
        """All rows (total, 3) of the configuration evaluated last."""
        return self.at.y

    @property
    def R(self) -> Array:
        """Balance (rows, 3) there, without constraint forces, less the relief."""
        return self.at.R

    def solution(self) -> Floats:
        """A copy of y, from which other steps may start."""
        return np.array(self.y)

    def constraint_force(self) -> Array:
        """Forces (rows, 3) that balance R, as the treatment has them."""
        return self.bound.impulse(self.at.R)

    def pivots(self) -> None:
        """Pivots of the stiffness there: they are not known."""

    def begin(self, start: Point) -> None:
        """Go to an equilibrium, and find its constraint forces."""
        bound, self._start, self._stresses = self.bound, start, None
        bound.begin(start.y, self.schedule.ground(start.t), 1.0)
        bound.guess(False)
        self.evaluate(start.t)
        bound.adopt(self.at.R)

    def evaluate(self, t: float) -> float:
        """Residual with the increments so far at load factor t; its size against its terms."""
        bound, start = self.bound, self._start
        if self.schedule.moving:
            bound.ground1 = self.schedule.ground(t)
        y, self._amplitudes = bound.configure(), self.schedule.at(t)
        self.at = balance(self.system, y, self._amplitudes, start.y, start.turns)
        self.at.R = self.at.R - self.relief
        self.residual = bound.reduce(self.at.R, y)
        return bound.relative(self.residual, self.at.size)

    def _assemble(self, mixed: bool) -> Floats:
        """Entries of the iteration matrix, with the predicted stresses if there are some."""
        system, bound, at = self.system, self.bound, self.at
        stresses = self._stresses if mixed else None
        blocks = balance_tangent(system, at, self._amplitudes, stresses)
        R = at.R
        if stresses is not None:
            change = [a - b for a, b in zip(stresses, at.stresses, strict=True)]
            R = R + system.internal_force(at.Bs, change)
        bound.reduce(R, at.y)
        return bound.matrix(blocks, R, at.y)

    def solve(self, columns: Sequence[Array], mixed: bool = True) -> Floats:
        """Increments (size, columns): minus solutions for residuals.

        `mixed`: with the stresses predicted by the last increment that asked for it. Motions that
        nothing holds are left out:
        there the matrix is singular to rounding, and a solution would wander along. The motion at
        this configuration comes from the last one by a step of inverse iteration.
        """
        bound, neutral, count = self.bound, self.neutral, len(columns)
        W = weights(self.system)
        columns = [np.array(column) for column in columns]
        data = self._assemble(mixed)  # sets the scaling
        both = [bound.scale_rows(c) for c in columns]
        both += [bound.scale_rows(bound.pull(W * z)) for z in neutral.motions]
        X: Floats = -bound.solver.solve(data, np.column_stack(both))
        if not neutral.motions:
            return X
        moved = np.column_stack([(np.sqrt(W) * self.displacement(x)).ravel() for x in X.T])
        Q, sizes, mix = np.linalg.svd(moved[:, count:], full_matrices=False)
        still = 1 / sizes <= neutral.limit  # their eigenvalues
        if still.any():
            Q, U = Q[:, still], (X[:, count:] @ mix.T / sizes)[:, still]
            neutral.motions = [(q.reshape(-1, 3) / np.sqrt(W)) for q in Q.T]
            X[:, :count] -= U @ (Q.T @ moved[:, :count])
        return X[:, :count]

    def displacement(self, increment: Floats) -> Array:
        """Change (rows, 3) of the coordinates by an increment, to first order."""
        return self.bound.displacement(increment, self.at.y)

    def sizes(self, increment: Floats) -> tuple[float, float]:
        """Size of an increment, and of its largest rotation."""
        return self.bound.sizes(increment, self.at.y)

    def move(self, increment: Floats, change: Array | None) -> None:
        """Move by an increment; with a change (rows, 3) predict the stresses that it leads to."""
        self._stresses = None if change is None else predicted(self.system, self.at, change)
        self.bound.move(increment)

    def nearest(self, change: Floats) -> Floats:
        """Increment that comes nearest to a change (rows, 3) of the coordinates."""
        self._assemble(False)  # sets the scaling of the unknowns
        bound, metric = self.bound, weights(self.system)
        size = bound.solver.n

        def project(u: Floats) -> Floats:
            return bound.pull(metric * self.displacement(u))

        operator = LinearOperator((size, size), matvec=project, dtype=float)
        return np.asarray(
            cg(operator, bound.pull(metric * change), rtol=1e-10, maxiter=10 * size)[0]
        )
