"""The equations of an equilibrium, in numpy and compiled, and what solves them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.sparse.linalg import LinearOperator, cg, splu

from ..compiled.kept import Source, entry
from ..compiled.numbers import CALLED_BACK
from ..compiled.plan import Plan
from ..compiled.structures import EQUILIBRIUM, structure
from ..compiled.tables.couplings import DAMPING
from ..constraints import NullSpace, Treatment
from ..constraints.base import BoundTreatment
from ..constraints.null_space import BoundNullSpace
from ..integrators.called_back import CalledAtRest
from ..integrators.choice import Choice, built
from ..integrators.compiled_scene import CompiledScene
from ..integrators.compiled_step import Coupled, stepped
from ..integrators.scheme import Scheme
from ..linear import SingularMatrixError, Solver, checked_solver
from ..model import System
from ..model.balance import (
    Amplitudes,
    Balance,
    balance,
    balance_tangent,
    external_force,
    predicted,
)
from ..model.limits import over_rotated, undefined
from ..model.reparametrisation import Reparametrisation
from ..newton import NewtonReport, NewtonSettings, newton
from ..types import Array, Floats, IndexArray
from .critical_points import Elimination, Pivots, Stability, counted
from .schedule import Functional, Neutral, Point, Schedule, Solution, weights

# --------------------------------------------------------------------------------------------------
# A point of a path as the Newton loop sees it; the last unknown is the change of the load factor.
#
# The tangent's geometric part is taken with the stresses that the last increment predicts to first
# order, see :func:`skfem_cosserat.model.balance.predicted`.

#: why a step fails whose displacement the loads do not change
UNMOVED = "the load factor does not change what is prescribed"
#: rate of what is prescribed, relative to its terms, below which it does not change
STANDS = 1e-10
#: change of the load factor for its difference quotients
SMALL = 1e-6
#: residual, relative to its terms, below which a start counts as an equilibrium
BALANCED = 1e-9


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
    def _save(self) -> Any:
        """The increments so far, and the stresses predicted."""

    @abstractmethod
    def _restore(self, saved: Any) -> None:
        """Back to them."""

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

    def save(self) -> object:
        """With the load factor."""
        return self._save(), self.t

    def restore(self, saved: Any) -> None:
        """The ground goes back, too."""
        self._restore(saved[0])
        self.t = saved[1]
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
        """Move by a change of the coordinates, as near to it as the constraints allow."""
        self.residual()
        self._assemble()  # sets the scaling of the unknowns
        bound = self.bound
        metric = weights(self.system)
        size = bound.solver.n

        def project(u: Floats) -> Floats:
            return bound.pull(metric * bound.displacement(u, self.at.y))

        operator = LinearOperator((size, size), matvec=project, dtype=float)
        unknowns, _ = cg(operator, bound.pull(metric * change), rtol=1e-10, maxiter=10 * size)
        self.apply(np.append(unknowns, 0.0))

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

    def _save(self) -> Any:
        return self.bound.sought, self._stresses

    def _restore(self, saved: Any) -> None:
        self.bound.sought = saved[0]
        self._stresses = saved[1]


# -- points of a path by compiled kernels: the same iterates, in a few compiled calls each ---------

#: a balance at rest as a step without masses, all of it taken at its end
REST = Scheme(0.0, 0.0, 1.0, weight=1.0, rate=0.0, at=1.0)
#: increments of joints and of free vertices since the start
STATE = ("turn", "value", "swing")


class CompiledBalance(CompiledScene):
    """Compiled kernels for the balance of one system at rest.

    A scene that stays in a plane takes those of space, which hold it there.

    Parameters
    ----------
    system : System
    treatment : Treatment
    settings, plan, solver, source
        See :class:`CompiledScene`; the plan is that of :func:`.compiled_step.stepped` in space.
    spin : bool
        Whether everything is seen from a turning frame.

    Attributes
    ----------
    exact : bool
        Whether loads alone change with the load factor, all of them in proportion to theirs: their
        derivative takes no difference quotient.
    """

    def __init__(
        self,
        system: System,
        treatment: Treatment,
        settings: NewtonSettings,
        plan: Plan | None = None,
        solver: Solver | None = None,
        source: Source = Source.COMPILER,
        spin: bool = False,
    ) -> None:
        self._plane = system.plane
        own = stepped(system, treatment, space=True), REST, 1.0, settings, plan, solver
        super().__init__(*own, static=True, source=source)
        system = self.system
        count, each = len(system.origin_rows), len(self._a.x)
        self._width = 12 * each
        self._residuals = np.zeros((2, each, 6))
        self._increments = np.zeros((2, 2, each, 6))
        self._pulled, self._pivots = np.zeros((each, 6)), np.zeros(7)
        arrays = self._residuals, self._increments, self._pulled, self._pivots
        given = dict(zip(EQUILIBRIUM, (*self._all, *arrays), strict=True))
        self._given = structure("equilibrium", given)
        self._kernels: dict[str, Callable[..., float]] = {}
        turning = np.zeros((2, each, 6), dtype=bool)
        turning[0, :count] = self._tree["turning"]
        shifting = np.zeros_like(turning)
        shifting[0, :count] = ~turning[0, :count]
        self._turning, self._shifting = np.flatnonzero(turning), np.flatnonzero(shifting)
        #: chosen rows of closed loops; multipliers; a point where they are known, with them
        self._rows = np.full(1, -1)
        self._mu = self._a.total[count:]
        self._known = np.zeros(0), self._mu.copy()
        if self._plane is not None:
            self._tree["hold"][:3] = self._plane.normal
        self._tree["coupling_law"][:, DAMPING] = 0.0
        self._coupled = Coupled(
            system, system.couplings_of(system.couplings.items), self._a.coupled, REST, 1.0
        )
        self._called: CalledAtRest | None = None
        if system.couplings.functions or spin:
            self._called = CalledAtRest(system, spin, self.plan, self._a)
            self._all[0][CALLED_BACK] = self._called.address
        self.exact = self._called is None and not system.couplings.times
        tied = system.tied
        self._closing = tied.closure, tied.kinematics, Reparametrisation(tied.kinematics)

    def _parts(self, weight: float, ends: bool, static: bool) -> list[str]:
        """See the base class."""
        parts = super()._parts(weight, ends, static)
        held = self._plane is not None or len(self.system.left_rows)
        return [*parts, "hold"] if held else parts

    def complain(self) -> None:
        """See the base class."""
        super().complain()
        if self._called is not None:
            self._called.complain()

    def _kernel(self, name: str) -> Callable[..., float]:
        """A kernel of :mod:`skfem_cosserat.compiled.static`."""
        call = self._kernels.get(name)
        if call is None:
            call = self._kernels[name] = entry("static", name, self._given, self._source)
        return call

    def prepare(self) -> None:
        """Have the kernels compiled, or read from the disk."""
        for name in ("begin", "move", "solve", "push", "pull", "pivots"):
            self._kernel(name)

    @property
    def y(self) -> Floats:
        """All rows (total, 3) of the configuration evaluated last, overwritten by the next."""
        return self._a.y1

    @property
    def R(self) -> Floats:
        """Balance (rows, 3) there, overwritten as well."""
        return self._a.R - self._a.closing if len(self._mu) else self._a.R

    def solution(self) -> Floats:
        """Configuration (total, 3) evaluated last, as one to start from."""
        y = self._a.y1.copy()
        if self._plane is not None:  # rounding has led out of it
            normal, rows = self._plane.normal, self.system.rows
            y[:rows] -= ((y - self._a.y0)[:rows] @ normal)[:, None] * normal
        self._known = y, self._mu.copy()
        return y

    def begin(self, y: Floats, ground: Floats, amplitudes: Amplitudes, turns: Any) -> None:
        """Start from a configuration (all rows); the ground is at `ground`."""
        rows = self.system.rows
        self._place(y[:rows].ravel(), (y[rows:], ground))
        self._coupled.turn(turns)
        self.take(amplitudes)
        self._kernel("begin")()
        if len(self._mu):
            self._close(y)
        self.complain()

    def _close(self, y: Floats) -> None:
        """Take independent rows of the closed loops, and the multipliers that are found there."""
        from ..compiled.bind_rows import choose_rows

        closure, kin, nodal = self._closing
        rows = closure.rows
        if len(rows):
            nodal.begin(self._a.y0.copy(), self._a.ground1.copy())
            T = kin.T.values(kin.T.locate(y, nodal.fixed))
            rows = np.concatenate([s.rows for s in closure.select(y, T)])
        if not np.array_equal(rows, self._rows):
            choose_rows(self.system, self._tree, rows)
            self._rows = rows
        known, mu = self._known
        if not np.array_equal(known, y):
            mu = self._balancing(y, np.setdiff1d(closure.rows, rows))
        self._a.x[-len(mu) :] = mu * self._tree["row_on"]

    def _balancing(self, y: Floats, left_out: IndexArray) -> Floats:
        """Multipliers that balance best what acts at y, none of rows that are left out."""
        self._kernel("move")()
        multipliers = np.zeros(self.system.m + 1)  # the last one is of no row
        kept = np.setdiff1d(np.arange(self.system.m), left_out)
        G = self.system.constraints.jacobian(y).tocsr()[kept]
        with suppress(RuntimeError):  # SuperLU: exactly singular
            multipliers[kept] = -splu((G @ G.T).tocsc()).solve(G @ self._a.R.ravel())
        return multipliers[self._tree["row_numbers"]]

    def take(self, amplitudes: Amplitudes) -> None:
        """Take these factors of loads and actuators from now on."""
        self.load(amplitudes.loads)
        self._coupled.drive(amplitudes.actuators[: self._coupled.channels])
        if self._called is not None:
            self._called.take(amplitudes)

    def move_ground(self, ground: Floats) -> None:
        """The same increments, with the ground elsewhere."""
        self._a.ground1[:] = ground

    def evaluate(self) -> float:
        """Evaluate; size of the residual against its terms."""
        size = self._kernel("move")()
        self.complain()
        return size

    @property
    def residual(self) -> Floats:
        """Of the evaluation (vertices, 6), in own coordinates; overwritten by the next one.

        Behind the vertices is what constraint rows with multipliers gape by.
        """
        return self._a.b

    def pulled(self, amplitudes: Floats) -> Floats:
        """Reduced force (vertices, 6) of loads with these factors at the configuration."""
        following = self._a.moments, self._a.followers
        kept = [each.copy() for each in following]
        self.load(amplitudes)
        self._kernel("pull")()
        for each, before in zip(following, kept, strict=True):  # the tangent needs them
            each[:] = before
        return self._pulled.copy()

    def solve(self, columns: list[Floats], mixed: bool) -> Floats:
        """Increments (size, columns): minus solutions for residuals (vertices, 6).

        They hold own coordinates, then twists of vertices. With `mixed` the matrix is that of the
        stresses predicted last.

        Raises
        ------
        SingularMatrixError
        """
        count = len(columns)
        for k, column in enumerate(columns):
            self._residuals[k] = column
        both = self._increments[:count]
        regular = self._kernel("solve")(count - 1 + 2 * int(mixed))
        self.factorisations += 1
        self.complain()
        out = both.reshape(count, self._width).T
        if not (regular and np.isfinite(out).all()):
            raise SingularMatrixError("the iteration matrix is singular")
        return out

    def pivots(self) -> Pivots | None:
        """Of the stiffness there; None where it is singular, or elimination in blocks not all."""
        if self._rest is not None:
            return None
        regular, out = self._kernel("pivots")(), self._pivots
        self.complain()
        self.factorisations += 1
        if out[6] > 0:  # what the rows hold may be lost as well
            out[1] = min(out[1], out[2] * out[5] / out[6])
        if not (regular and np.isfinite(out[:5]).all()):
            return None
        smallest, largest, skew = map(float, out[1:4])
        return Pivots(int(out[0]), smallest, largest, skew, bool(out[4] < 0))

    def push(self, increment: Floats) -> Floats:
        """Change (rows, 3) of the coordinates, to first order; overwritten by the next one."""
        self._a.twist[:] = increment[self._width // 2 :].reshape(-1, 6)
        self._kernel("push")(0)
        return self._a.change

    def predict(self) -> None:
        """Stresses that the change pushed last predicts."""
        self._kernel("push")(1)
        self.complain()

    def apply(self, increment: Floats) -> None:
        """Move by an increment with the next evaluation."""
        self._a.x[:] = increment[: self._width // 2].reshape(-1, 6)

    def sizes(self, increment: Floats) -> tuple[float, float]:
        """Size of an increment, and of its largest rotation."""
        size = abs(increment[: self._width // 2])
        turn = float(size[self._turning].max(initial=0.0))
        return max(float(size[self._shifting].max(initial=0.0)) / self.system.length, turn), turn

    def save(self) -> tuple[Floats, ...]:
        """The increments so far."""
        return tuple(values.copy() for values in self._moved_by())

    def restore(self, saved: tuple[Floats, ...]) -> None:
        """Back to them."""
        for now, values in zip(self._moved_by(), saved, strict=True):
            now[:] = values

    def _moved_by(self) -> tuple[Floats, ...]:
        """What has been moved by so far: in sum, and by what does not add up."""
        return (self._a.total, *(self._tree[name] for name in STATE))


class CompiledProblem(Problem):
    """See :class:`skfem_cosserat.statics.solver.Problem`, as for all below.

    Parameters
    ----------
    balance : CompiledBalance
    schedule, settings, start, target
        See there.
    """

    def __init__(
        self,
        balance: CompiledBalance,
        schedule: Schedule,
        settings: NewtonSettings,
        start: Point,
        target: Functional,
    ) -> None:
        super().__init__(balance.system, schedule, settings, start, target)
        self.balance = balance
        self._mixed = False
        balance.begin(start.y, schedule.ground(start.t), schedule.at(start.t), start.turns)

    @property
    def y(self) -> Array:
        """See the base class."""
        return self.balance.y

    @property
    def R(self) -> Array:
        """See the base class."""
        return self.balance.R

    def _evaluate(self) -> float:
        return self._evaluate_at(self.t)

    def _evaluate_at(self, t: float) -> float:
        self.balance.take(self.schedule.at(t))
        return self.balance.evaluate()

    def _by_ground(self, ends: tuple[float, float]) -> tuple[list[Array], list[Array]]:
        balance = self.balance
        residuals, ys = [], []
        for end in ends:
            self._move_ground(end)
            self._evaluate_at(end)
            residuals.append(balance.residual.copy())
            ys.append(balance.y.copy())
        self._move_ground(self.t)
        self._evaluate_at(self.t)
        return residuals, ys

    def _by_loads(self, ends: tuple[float, float]) -> Array:
        if not self.balance.exact:
            first, last = self._by_ground(ends)[0]
            return last - first
        first, last = (self.schedule.at(end).loads for end in ends)
        return self.balance.pulled(first - last)

    def _solutions(self, by_t: Array | None) -> Array:
        columns = [self.balance.residual]
        return self.balance.solve(columns if by_t is None else [*columns, by_t], self._mixed)

    def _along(self, gradient: Floats, increments: Array) -> tuple[Floats, float]:
        products = [gradient * self.balance.push(u) for u in increments.T]
        return np.array([p.sum() for p in products]), float(abs(products[-1]).sum())

    def _sizes(self, increment: Floats) -> tuple[float, float]:
        return self.balance.sizes(increment)

    def _apply(self, increment: Floats, dt: float, predict: bool) -> Array:
        change = self.balance.push(increment)
        if self._by_t is not None:
            change += dt * self._by_t
        self._mixed = predict and bool(self.system.beam_groups)
        if self._mixed:
            self.balance.predict()
        self.balance.apply(increment)
        return change.copy() if self.predicted is None else change

    def _move_ground(self, t: float) -> None:
        self.balance.move_ground(self.schedule.ground(t))

    def _save(self) -> Any:
        return self.balance.save(), self._mixed

    def _restore(self, saved: Any) -> None:
        self.balance.restore(saved[0])
        self._mixed = saved[1]

    def rate(self) -> Floats:
        """See the base class."""
        r_t, by_t = self._factor_derivative()
        change = self.balance.push(self.balance.solve([r_t], False)[:, 0])
        return np.array(change if by_t is None else change + by_t)

    def solution(self) -> Floats:
        """See the base class."""
        return self.balance.solution()

    def pivots(self) -> Pivots | None:
        """See :meth:`CompiledBalance.pivots`; at the configuration evaluated last."""
        return self.balance.pivots()


# --------------------------------------------------------------------------------------------------
# One point of a path: balance x treatment x Newton, at a load factor or with it as an unknown.


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
        problem = self._problem = self._started(point, Functional(None, 1.0, 0.0), None, False)
        problem.residual()
        return np.array(problem.constraint_force()).reshape(-1)

    def rate_at(self, point: Point) -> Floats:
        """Derivative (rows, 3) of the coordinates by the load factor at a point begun with."""
        if self._fast is not None:
            self._adopt(point)
        target = Functional(None, 1.0, 0.0)
        problem = PlainProblem(self.bound, self.schedule, self.settings, point, target)
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
        solver = (self.bound if isinstance(self.bound, BoundNullSpace) else self._along).solver
        if solver.n < solver.pattern.shape[0]:
            return None
        symmetric = system.loading.dead_only
        if (
            isinstance(problem, PlainProblem)
            and isinstance(self.bound, BoundNullSpace)
            and np.array_equal(problem.y, point.y)
        ):
            return self._elimination.pivots(problem.stiffness(), symmetric)
        bound, y, amplitudes = self._along, point.y, self.schedule.at(point.t)
        at = balance(system, y, amplitudes, turns=point.turns)
        bound.begin(y, y[system.rows :], 1.0)
        bound.reduce(at.R, y)
        data = bound.matrix(balance_tangent(system, at, amplitudes), at.R, y)
        return self._elimination.pivots(data, symmetric)

    @cached_property
    def _along(self) -> BoundNullSpace:
        """Of the null space method: at an equilibrium its matrix is the stiffness."""
        return NullSpace().bind(self.system, 1.0)

    @cached_property
    def _elimination(self) -> Elimination:
        bound = self.bound if isinstance(self.bound, BoundNullSpace) else self._along
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
