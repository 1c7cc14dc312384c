"""A point of a path by compiled kernels: the same iterates, in a few compiled calls each."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from functools import cached_property
from typing import Any

import numpy as np
from scipy.sparse.linalg import splu

from ..compiled.kept import Source, entry
from ..compiled.numbers import CALLED_BACK
from ..compiled.plan import Plan
from ..compiled.structures import EQUILIBRIUM, structure
from ..compiled.tables.couplings import DAMPING
from ..constraints import Treatment
from ..integrators.called_back import CalledAtRest
from ..integrators.compiled_scene import CompiledScene
from ..integrators.compiled_step import Coupled, stepped
from ..integrators.scheme import Scheme
from ..linear import SingularMatrixError, Solver
from ..model import System
from ..model.balance import Amplitudes
from ..model.reparametrisation import Reparametrisation
from ..newton import NewtonSettings
from ..types import Array, Floats, IndexArray
from .critical_points import Pivots
from .problem import Problem
from .schedule import Functional, Point, Schedule

#: a balance at rest as a step without masses, all of it taken at its end
REST = Scheme(0.0, 0.0, 1.0, weight=1.0, rate=0.0, at=1.0)


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
        own = stepped(system, treatment), REST, 1.0, settings, plan, solver
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
        self._taken: Amplitudes | None = None
        if system.couplings.functions or spin:
            self._called = CalledAtRest(system, spin, self.plan, self._a)
            self._all[0][CALLED_BACK] = self._called.address
        self.exact = self._called is None and not system.couplings.times

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

        closure, rows = self.system.tied.closure, self.system.tied.closure.rows
        if len(rows):
            nodal, kin = self._nodal, self._nodal.kin
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

    @cached_property
    def _nodal(self) -> Reparametrisation:
        return Reparametrisation(self.system.tied.kinematics)

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
        """Take these factors of loads and actuators from now on; each iteration asks again."""
        if amplitudes is self._taken:
            return
        self._taken = amplitudes
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
        self._taken = None
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


class CompiledProblem(Problem):
    """See :class:`skfem_cosserat.statics.problem.Problem`, as for all below.

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
