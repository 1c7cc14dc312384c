"""The equations of an equilibrium by compiled kernels: the same iterates, in a few calls each."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from functools import cached_property

import numpy as np
from scipy.sparse.linalg import splu

from ..compiled.bind_rows import choose_rows
from ..compiled.kept import Source, entry
from ..compiled.numbers import CALLED_BACK
from ..compiled.plan import Plan
from ..compiled.structures import EQUILIBRIUM, structure
from ..compiled.tables.couplings import DAMPING
from ..constraints import Treatment
from ..integrators.called_back import CalledAtRest
from ..integrators.compiled_scene import CompiledScene
from ..integrators.compiled_step import Coupled, kernel_coordinates
from ..integrators.scheme import Scheme
from ..linear import SingularMatrixError, Solver
from ..model.balance import Amplitudes
from ..model.reparametrisation import Reparametrisation
from ..newton import NewtonSettings
from ..types import Array, Floats, IndexArray
from .critical_points import Pivots
from .schedule import Point, Schedule

#: a balance at rest as a step without masses, all of it taken at its end
REST = Scheme(0.0, 0.0, 1.0, weight=1.0, rate=0.0, at=1.0)
#: kernels of :mod:`skfem_cosserat.compiled.static`
KERNELS = ("begin", "move", "solve", "change", "predict", "pivots")


class CompiledEquations(CompiledScene):
    """Compiled kernels for the balance of one system at rest, called as :class:`PlainEquations`.

    A scene that stays in a plane takes those of space, which hold it there. Increments hold the own
    coordinates of vertices and multipliers, then the twists of vertices.

    Parameters
    ----------
    schedule : Schedule
    treatment : Treatment
    settings, plan, solver, source
        See :class:`CompiledScene`.
    """

    def __init__(
        self,
        schedule: Schedule,
        treatment: Treatment,
        settings: NewtonSettings,
        plan: Plan | None = None,
        solver: Solver | None = None,
        source: Source = Source.COMPILER,
    ) -> None:
        self.schedule, self._plane = schedule, schedule.system.plane
        own = kernel_coordinates(schedule.system, treatment), REST, 1.0, settings, plan, solver
        super().__init__(*own, static=True, source=source)
        system, spin = self.system, schedule.spin is not None
        count, each = len(system.origin_rows), len(self._a.x)
        #: of the evaluation (vertices, 6), in own coordinates, then what rows gape by
        self.residual = self._a.b
        self._residuals = np.zeros((2, each, 6))
        self._increments = np.zeros((2, 2, each, 6))
        self._pivots = np.zeros(7)
        arrays = self._residuals, self._increments, self._pivots
        given = structure("equilibrium", dict(zip(EQUILIBRIUM, (*self._all, *arrays), strict=True)))
        self._kernels = {name: entry("static", name, given, source) for name in KERNELS}
        self._turning = np.zeros((each, 6), dtype=bool)
        self._turning[:count] = self._tree["turning"]
        self._units = np.where(self._turning, 1.0, 1 / system.length)
        self._units[count:] = 0.0
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

    def _parts(self, weight: float, ends: bool, static: bool) -> list[str]:
        """Names of the parts that are called, with "hold" for a plane or rows with multipliers."""
        parts = super()._parts(weight, ends, static)
        held = self._plane is not None or len(self.coordinates.left_rows)
        return [*parts, "hold"] if held else parts

    def complain(self) -> None:
        """Raise what could not be raised when compiled code called Python."""
        super().complain()
        if self._called is not None:
            self._called.complain()

    def _call(self, name: str, flag: int = 0) -> float:
        """Call a kernel; raises what its callbacks could not raise."""
        found = self._kernels[name](flag)
        self.complain()
        return found

    @property
    def y(self) -> Floats:
        """All rows (total, 3) evaluated last; overwritten by the next evaluation."""
        return self._a.y1

    @property
    def R(self) -> Floats:
        """Balance (rows, 3) evaluated last; overwritten by the next evaluation."""
        return self._a.R - self._a.closing if len(self._mu) else self._a.R

    def constraint_force(self) -> Floats:
        """Forces (rows, 3) that balance R."""
        return -self.R

    def solution(self) -> Floats:
        """A copy of y; its multipliers are kept, and the next step begins with them."""
        y = self._a.y1.copy()
        if self._plane is not None:  # rounding has led out of it
            normal, rows = self._plane.normal, self.system.rows
            y[:rows] -= ((y - self._a.y0)[:rows] @ normal)[:, None] * normal
        self._known = y, self._mu.copy()
        return y

    def begin(self, start: Point) -> None:
        """Go to an equilibrium, with the multipliers found last or those that balance it best."""
        rows, y = self.system.rows, start.y
        self._place(y[:rows].ravel(), (y[rows:], self.schedule.ground(start.t)))
        self._coupled.turn(start.turns)
        self._mixed, self._taken = False, None
        self._take(start.t)
        self._call("begin")
        if len(self._mu):
            self._close(y)

    def _close(self, y: Floats) -> None:
        """Take independent rows of the closed loops, and the multipliers that are found there."""
        closure, rows = self.coordinates.closure, self.coordinates.closure.rows
        if len(rows):
            nodal, kin = self._nodal, self._nodal.kin
            nodal.begin(self._a.y0.copy(), self._a.ground1.copy())
            T = kin.values_at(y, nodal.fixed)
            rows = np.concatenate([s.rows for s in closure.select(y, T)])
        if not np.array_equal(rows, self._rows):
            choose_rows(self.coordinates, self._tree, rows)
            self._rows = rows
        known, mu = self._known
        if not np.array_equal(known, y):
            mu = self._balancing(y, np.setdiff1d(closure.rows, rows))
        self._a.x[-len(mu) :] = mu * self._tree["row_on"]

    @cached_property
    def _nodal(self) -> Reparametrisation:
        return Reparametrisation(self.system.joint_coordinates.kinematics)

    def _balancing(self, y: Floats, left_out: IndexArray) -> Floats:
        """Multipliers that balance best what acts at y, none of rows that are left out."""
        self._call("move")
        multipliers = np.zeros(self.system.m + 1)  # the last one is of no row
        kept = np.setdiff1d(np.arange(self.system.m), left_out)
        G = self.system.constraints.jacobian(y).tocsr()[kept]
        with suppress(RuntimeError):  # SuperLU: exactly singular
            multipliers[kept] = -splu((G @ G.T).tocsc()).solve(G @ self._a.R.ravel())
        return multipliers[self._tree["row_numbers"]]

    def _take(self, t: float) -> None:
        """Take loads and actuators at a load factor from now on."""
        amplitudes = self.schedule.at(t)
        if amplitudes is self._taken:
            return
        self._taken = amplitudes
        self.load(amplitudes.loads)
        self._coupled.drive(amplitudes.actuators[: self._coupled.channels])
        if self._called is not None:
            self._called.take(amplitudes)

    def evaluate(self, t: float) -> float:
        """Evaluate the balance at load factor t; gives its size relative to its terms."""
        self._take(t)
        if self.schedule.moving:
            self._a.ground1[:] = self.schedule.ground(t)
        return self._call("move")

    def solve(self, columns: Sequence[Array], mixed: bool = True) -> Floats:
        """Increments (size, columns) for residuals; `mixed`: with the predicted stresses."""
        count = len(columns)
        self._residuals[:count] = columns
        regular = self._call("solve", count - 1 + 2 * int(mixed and self._mixed))
        self.factorisations += 1
        out = self._increments[:count].reshape(count, -1).T
        if not (regular and np.isfinite(out).all()):
            raise SingularMatrixError("the iteration matrix is singular")
        return out

    def pivots(self) -> Pivots | None:
        """Pivots of the stiffness; None: not finite, or elimination in blocks is not all."""
        if self._rest is not None:
            return None
        regular, out = self._call("pivots"), self._pivots
        self.factorisations += 1
        if out[6] > 0:  # what the rows hold may be lost as well
            out[1] = min(out[1], out[2] * out[5] / out[6])
        if not (regular and np.isfinite(out[:5]).all()):
            return None
        smallest, largest, skew = map(float, out[1:4])
        return Pivots(int(out[0]), smallest, largest, skew, bool(out[4] < 0))

    def displacement(self, increment: Floats) -> Floats:
        """Change (rows, 3) of the coordinates by an increment; overwritten by the next one."""
        self._a.twist.ravel()[:] = increment[self._units.size :]
        self._call("change")
        return self._a.change

    def sizes(self, increment: Floats) -> tuple[float, float]:
        """Size of an increment (relative to the scene, or rad), and of its largest rotation."""
        size = abs(increment[: self._units.size].reshape(-1, 6)) * self._units
        turn = size[self._turning].max(initial=0.0)
        return float(size.max(initial=0.0)), float(turn)

    def move(self, increment: Floats, change: Floats | None) -> None:
        """Move by an increment, which takes effect with the next evaluation.

        With a change (rows, 3) the stresses that it leads to are predicted.
        """
        self._mixed = change is not None and bool(self.system.beam_groups)
        if change is not None:
            self._a.change[:] = change
            self._call("predict")
        self._a.x.ravel()[:] = increment[: self._units.size]
