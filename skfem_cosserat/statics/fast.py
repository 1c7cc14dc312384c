"""Points of a path by compiled kernels: the same iterates, in a few compiled calls each."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..compiled.plan import Plan
from ..integrators.base import Scheme
from ..integrators.fast import CompiledScene
from ..linear import SingularMatrixError, Solver
from ..model import System
from ..newton import NewtonSettings
from ..types import Array, Floats
from .point import Functional, Point
from .problem import Problem
from .schedule import Schedule
from .stability import Pivots

__all__ = ["CompiledBalance", "CompiledProblem"]

#: a balance at rest as a step without masses, all of it taken at its end
REST = Scheme(0.0, 0.0, 1.0, False, (0.0, 0.0, 0.0), share=1.0)
#: increments of joints and of free vertices since the start
STATE = ("turn", "value", "swing")


class CompiledBalance(CompiledScene):
    """Compiled kernels for the balance of one system at rest, null space method.

    Parameters
    ----------
    system : System
    settings : NewtonSettings
    plan : Plan, optional
        Of the elimination, if it is there already.
    solver : Solver, optional
        Of what elimination in blocks leaves.

    Attributes
    ----------
    factorisations : int
        So far.
    """

    def __init__(
        self,
        system: System,
        settings: NewtonSettings,
        plan: Plan | None = None,
        solver: Solver | None = None,
    ) -> None:
        from ..compiled import static

        super().__init__(system, REST, 1.0, settings, plan, solver, static=True)
        self._static = static
        count = len(system.origin_rows)
        self._width = 12 * count
        self._residuals = np.zeros((2, count, 6))
        self._increments = np.zeros((2, 2, count, 6))
        turning = np.zeros((2, count, 6), dtype=bool)
        turning[0] = self._tree["turning"]
        self._turning = np.flatnonzero(turning)
        self._shifting = np.flatnonzero(~turning[0])
        self._prescribed = np.flatnonzero(self._tree["own"] < 0)

    @property
    def y(self) -> Floats:
        """All rows (total, 3) of the configuration evaluated last, overwritten by the next."""
        return self._a.y1

    @property
    def R(self) -> Floats:
        """Balance (rows, 3) there, overwritten as well."""
        return self._a.R

    def begin(self, y: Floats, ground: Floats) -> None:
        """Start from a configuration (all rows); the ground is at `ground`."""
        rows = self.system.rows
        self._place(y[:rows].ravel(), (y[rows:], ground))
        self._static.begin(*self._all)

    def move_ground(self, ground: Floats) -> None:
        """The same increments, with the ground elsewhere."""
        self._a.ground1[:] = ground
        if self._drives:
            self._chart.move_ground(ground)
            driven = self._chart.driven(self._coordinates)
            self._tree["driven"][:] = driven
            self._tree["value"][self._prescribed] = driven[self._prescribed]

    def evaluate(self) -> float:
        """Evaluate; size of the residual against its terms."""
        return float(self._static.move(*self._all))

    @property
    def residual(self) -> Floats:
        """Of the evaluation (vertices, 6), in own coordinates; overwritten by the next one."""
        return self._a.b

    def pulled(self, amplitudes: Floats) -> Floats:
        """Reduced force (vertices, 6) of loads with these factors at the configuration."""
        following = self._a.moments, self._a.followers
        kept = [each.copy() for each in following]
        self.load(amplitudes)
        out = np.empty_like(self._a.b)
        self._static.pull(*self._all, out)
        for each, before in zip(following, kept, strict=True):  # the tangent needs them
            each[:] = before
        return out

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
        regular = self._static.solve(*self._all, int(mixed), self._residuals[:count], both)
        self.factorisations += 1
        if self._rest is not None:
            self._rest.complain()
        out = both.reshape(count, self._width).T
        if not (regular and np.isfinite(out).all()):
            raise SingularMatrixError("the iteration matrix is singular")
        return out

    def pivots(self) -> Pivots | None:
        """Of the stiffness there; None where it is singular, or elimination in blocks not all."""
        if self._rest is not None:
            return None
        out = np.zeros(5)
        regular = self._static.pivots(*self._all, out)
        self.factorisations += 1
        if not (regular and np.isfinite(out).all()):
            return None
        smallest, largest, skew = map(float, out[1:4])
        return Pivots(int(out[0]), smallest, largest, skew, bool(out[4] < 0))

    def push(self, increment: Floats) -> Floats:
        """Change (rows, 3) of the coordinates, to first order; overwritten by the next one."""
        self._a.twist[:] = increment[self._width // 2 :].reshape(-1, 6)
        self._static.push(*self._all, 0)
        return self._a.change

    def predict(self) -> None:
        """Stresses that the change pushed last predicts."""
        self._static.push(*self._all, 1)

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
        balance.begin(start.y, self.system.ground(start.t))

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
        self.balance.load(self.schedule.at(t).loads)
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
        self.balance.move_ground(self.system.ground(t))

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

    def pivots(self) -> Pivots | None:
        """See :meth:`CompiledBalance.pivots`; at the configuration evaluated last."""
        return self.balance.pivots()
