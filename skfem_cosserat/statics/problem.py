"""An equilibrium: loads by load factor, the equations in numpy or compiled, Newton's problem.

The last unknown is the change of the load factor. The tangent's geometric part is taken with the
stresses that the last increment predicts to first order, see
:func:`skfem_cosserat.model.balance.predicted`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np
from scipy.sparse.linalg import LinearOperator, cg, splu

from ..compiled import bind
from ..compiled.kept import Source, entry
from ..compiled.numbers import CALLED_BACK
from ..compiled.plan import Plan
from ..compiled.structures import EQUILIBRIUM, structure
from ..compiled.tables import DAMPING
from ..constraints import Treatment
from ..constraints.base import BoundTreatment
from ..coupling import Coupling
from ..diagnostics.stacked import weights
from ..errors import InputError
from ..integrators.called_back import CalledAtRest
from ..integrators.choice import Choice, built
from ..integrators.compiled_step import CompiledScene, Coupled, kernel_coordinates
from ..integrators.scheme import Scheme
from ..linear import SingularMatrixError, Solver, checked_solver
from ..load import Load
from ..model import System
from ..model.balance import Amplitudes, Spin, balance, balance_tangent, predicted
from ..model.limits import over_rotated, undefined
from ..model.reparametrisation import Reparametrisation
from ..newton import NewtonReport, NewtonSettings, newton
from ..time_function import Amplitude, Constant, TimeFunction, time_function
from ..types import SAME, Array, Floats, IndexArray, check_kind, finite, names_known
from .control import Functional, Point, size_of

# -- which share of each load acts where on a path -------------------------------------------------

#: change of the load factor, relative to it, for difference quotients of any function
SMALL = 1e-6

_Channel = tuple[TimeFunction, TimeFunction | None, str]


def _value(function: TimeFunction, t: float, owner: str) -> float:
    """At load factor t; an error of a function names whose it is."""
    try:
        return function.value(t)
    except InputError as error:
        raise InputError(owner, str(error)) from error


class Schedule:
    """Amplitudes of all loads, actuators and of a spin as functions of the load factor.

    What is constant in time is multiplied by the load factor; what depends on time takes the load
    factor for it, as prescribed motion does. Factors given by name take the place of the load
    factor: a number holds a load, a :class:`Table` or a function of the load factor moves it.

    Parameters
    ----------
    system : System
    factors : mapping of str to float, TimeFunction or callable
        By the names of loads and actuators; ``"spin"`` for the spin.
    spin : Spin, optional
        Angular velocity at load factor 1; it grows in proportion.
    time : float, optional
        What depends on time is held as it is at this instant (s); default: it takes the load factor
        for the time.

    Raises
    ------
    InputError
        For names that are not in the system, or factors that are no functions.

    Attributes
    ----------
    moving : bool
        Whether prescribed motion goes on along the path.
    """

    def __init__(
        self,
        system: System,
        factors: Mapping[str, Amplitude] | None = None,
        spin: Spin | None = None,
        time: float | None = None,
    ):
        check_kind("argument factors", {} if factors is None else factors, Mapping)
        if spin is not None:
            check_kind("argument spin", spin, Spin)
            if system.plane is not None:
                system.plane.check_spin(spin.velocity)
        self.system = system
        self.spin = spin
        self.time = None if time is None else finite("argument time", "its value", time)
        self.moving = bool(system.moving) and time is None
        given = dict(factors or {})
        loading = system.loading
        couplings = system.couplings
        owners = [*loading.owners, *couplings.owners]
        known = {str(owner.name) for owner in owners} | ({"spin"} if spin is not None else set())
        for name, factor in given.items():
            if name not in known:
                text = f"unknown name {name!r}; {names_known(name, sorted(known))}"
                raise InputError("argument factors", text)
            if factor is None or isinstance(factor, bool):
                raise InputError(
                    "argument factors", f"{name!r}: {factor!r}, expected a number or function"
                )
        self._given = {k: time_function(f"argument factors, {k!r}", v) for k, v in given.items()}
        self._loads = self._channels(loading.owners, loading.times)
        self._actuators = self._channels(couplings.owners, couplings.times)
        turning = (Constant(1.0), self._given.get("spin"), "spin")
        self._spin = [] if spin is None else [turning]
        #: the load factor that was asked for last, and what is there: each iteration asks again
        self._known: tuple[float, Amplitudes] | None = None

    def _channels(
        self, owners: Sequence[Coupling | Load], times: Sequence[TimeFunction]
    ) -> list[_Channel]:
        """(own time, factor, name) of each channel; None: the load factor itself."""
        out = []
        for owner, time in zip(owners, times, strict=True):
            default = None if isinstance(time, Constant) else Constant(1.0)
            out.append((time, self._given.get(str(owner.name), default), owner.label))
        return out

    def instant(self, t: float) -> float:
        """Time (s) at which functions of time are taken at load factor t."""
        return t if self.time is None else self.time

    def ground(self, t: float) -> Floats:
        """Rows of the ground at load factor t."""
        return self.system.ground(self.instant(t))

    @property
    def grows(self) -> bool:
        """True if a load, actuator or spin changes with the load factor while time is held."""
        channels = *self._loads, *self._actuators, *self._spin
        return any(not isinstance(factor, Constant) for _, factor, _ in channels)

    def at(self, t: float) -> Amplitudes:
        """Amplitudes at load factor t."""
        if self._known is None or self._known[0] != t:
            now = self.instant(t)
            spin = self.spin
            loads, actuators, turning = (
                [
                    _value(time, now, owner) * (t if factor is None else _value(factor, t, owner))
                    for time, factor, owner in channels
                ]
                for channels in (self._loads, self._actuators, self._spin)
            )
            if spin is not None:
                spin = Spin(turning[0] * spin.velocity, spin.point)
            checked = self.system.loading.checked(np.array(loads), t)
            self._known = t, Amplitudes(checked, np.array([*actuators, 0.0]), spin, now)
        return self._known[1]


def load_force(system: System, y: Floats, amplitudes: Amplitudes) -> Floats:
    """Forces (rows, 3) of loads, and of functions of the motion, at a configuration y."""
    loading = system.loading
    force = loading.dead_force(amplitudes.loads)
    if not loading.dead_only:
        force = force + loading.force(y[: system.rows], amplitudes.loads)
    if system.couplings.own:
        force = force + system.couplings.pushed(y, amplitudes.time)
    return force


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
    """Solved point of a path, with its constraint force, report and prediction.

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


#: why a step fails whose displacement the loads do not change
UNMOVED = "the load factor does not change what is prescribed"
#: rate of what is prescribed, relative to its terms, below which it does not change
STANDS = 1e-10


class Problem:
    """A point of a path: equations, and what fixes the place on it.

    Parameters
    ----------
    equations : PlainEquations or CompiledEquations
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
        settings: NewtonSettings,
        start: Point,
        target: Functional,
    ):
        self.equations = equations
        self.settings = settings
        self.start = start
        self.target = target
        self.t = start.t
        equations.begin(start)
        self.predicted: Array | None = None
        #: derivatives of residual and coordinates by t; None: a given load factor is reached
        self._rates: tuple[Array, Array] | None = None
        self._mixed = False

    def residual(self) -> float:
        """Evaluate, see :class:`skfem_cosserat.newton.NewtonProblem`."""
        target = self.target
        t = self.t
        self._rates = None
        # what is missing from a load factor that is given and reached is rounding
        if (
            target.gradient is not None
            or t != t - target(self.start, self.start.y, t) / target.by_factor
        ):
            self._rates = self.derivative()
        return self.equations.evaluate(t)

    def derivative(self) -> tuple[Array, Array]:
        """Derivatives of the residual and of the coordinates by t at fixed unknowns."""
        equations, t, schedule = self.equations, self.t, self.equations.schedule
        step = SMALL * (max(abs(t), abs(self.start.t)) or 1.0)
        first = t - step if t >= step or not schedule.moving else t
        found = []
        for end in (first, t + step):
            equations.evaluate(end)
            found.append((equations.residual.copy(), equations.y[: equations.system.rows].copy()))
        (r0, y0), (r1, y1) = found
        return (r1 - r0) / (t + step - first), (y1 - y0) / (t + step - first)

    def direction(self) -> Floats:
        """Newton increment; the target is a row below the matrix."""
        gradient = self.target.gradient
        equations = self.equations
        if self._rates is None:
            return np.append(equations.solve([equations.residual]), 0.0)
        r_t, by_t = self._rates
        both = equations.solve([equations.residual, r_t])
        along = self.target(self.start, equations.y, self.t)
        slope = self.target.by_factor
        terms = 0.0
        if gradient is not None:
            along += float((gradient * equations.displacement(both[:, 0])).sum())
            rates = gradient * (equations.displacement(both[:, 1]) + by_t)
            slope = slope + float(rates.sum())
            terms = float(abs(rates).sum())
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
        return self.equations.displacement(self.equations.solve([r_t], mixed=False)[:, 0]) + by_t


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
    hold : float
        Stiffness, in the metric of :func:`weights`, of springs that hold all nodes at the start.
    relief : (rows, 3) array or float
        Forces left out of the balance.
    """

    def __init__(self, bound: BoundTreatment, schedule: Schedule):
        self.bound, self.schedule, self.system = bound, schedule, bound.system
        self.neutral = Neutral()
        self.hold = 0.0
        self.relief: Floats | float = 0.0
        self._stresses: list[Array] | None = None

    @property
    def y(self) -> Array:
        """All rows (total, 3) of the configuration evaluated last."""
        return self.at.y

    @property
    def R(self) -> Array:
        """Balance (rows, 3) there, without constraint forces."""
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
        bound = self.bound
        start = self._start
        if self.schedule.moving:
            bound.ground1 = self.schedule.ground(t)
        y = bound.configure()
        self._amplitudes = self.schedule.at(t)
        self.at = balance(self.system, y, self._amplitudes, start.y, start.turns)
        springs = self.hold * weights(self.system) * (y - start.y)[: self.system.rows]
        self.at.R = self.at.R + springs - self.relief
        self.residual = bound.reduce(self.at.R, y)
        return bound.relative(self.residual, self.at.size)

    def _assemble(self, mixed: bool) -> Floats:
        """Entries of the iteration matrix, with the predicted stresses if there are some."""
        system, bound, at = self.system, self.bound, self.at
        stresses = self._stresses if mixed else None
        blocks = balance_tangent(system, at, self._amplitudes, stresses)
        for k, springs in enumerate(self._springs if self.hold else ()):
            blocks[k] = blocks[k] + self.hold * springs
        R = at.R
        if stresses is not None:
            change = [a - b for a, b in zip(stresses, at.stresses, strict=True)]
            R = R + system.internal_force(at.Bs, change)
        bound.reduce(R, at.y)
        return bound.matrix(blocks, R, at.y)

    @cached_property
    def _springs(self) -> list[Array]:
        """Blocks of the groups that add up to :func:`weights` on the diagonal."""
        groups = self.system.groups
        shares = np.zeros((self.system.rows, 1))
        for group in groups:
            np.add.at(shares, group.rows, 1.0)
        each = [np.repeat((weights(self.system) / shares)[g.rows, 0], 3, 1) for g in groups]
        return [diagonal[:, :, None] * np.eye(diagonal.shape[1]) for diagonal in each]

    def solve(self, columns: Sequence[Array], mixed: bool = True) -> Floats:
        """Increments (size, columns): minus solutions for residuals.

        `mixed`: with the stresses predicted by the last increment that asked for it. Motions that
        nothing holds are left out: there the matrix is singular to rounding, and a solution would
        wander along. The motion at this configuration comes from that of the start by a step of
        inverse iteration.
        """
        bound, neutral, count = self.bound, self.neutral, len(columns)
        W = weights(self.system)
        columns = [np.array(column) for column in columns]
        data = self._assemble(mixed)  # sets the scaling
        both = [bound.scale_rows(c) for c in columns]
        both += [bound.scale_rows(bound.pull(W * z)) for z in neutral.motions]
        X = -bound.solver.solve(data, np.column_stack(both))
        if not neutral.motions:
            return X
        moved = np.column_stack([(np.sqrt(W) * self.displacement(x)).ravel() for x in X.T])
        Q, sizes, mix = np.linalg.svd(moved[:, count:], full_matrices=False)
        still = 1 / sizes <= neutral.limit  # their eigenvalues
        if still.any():
            U = X[:, count:] @ mix.T / sizes
            X[:, :count] -= U[:, still] @ (Q[:, still].T @ moved[:, :count])
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
        bound = self.bound
        metric = weights(self.system)
        size = bound.solver.n

        def project(u: Floats) -> Floats:
            return bound.pull(metric * self.displacement(u))

        operator = LinearOperator((size, size), matvec=project, dtype=float)
        return cg(operator, bound.pull(metric * change), rtol=1e-10, maxiter=10 * size)[0]


class Pivots(NamedTuple):
    """Pivots of an elimination of the stiffness along the constraints, without exchange of rows.

    Attributes
    ----------
    negative : int
        How many, of the symmetric part.
    smallest, largest : float
        In magnitude; the largest may be that of an entry.
    skew : float
        Largest difference of entries, or of those of blocks left, and their mirror images.
    odd : bool
        Whether the determinant is negative.
    """

    negative: int
    smallest: float
    largest: float
    skew: float
    odd: bool


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
    ):
        self.schedule = schedule
        self._plane = schedule.system.plane
        own = kernel_coordinates(schedule.system, treatment), REST, 1.0, settings, plan, solver
        super().__init__(*own, static=True, source=source)
        system = self.system
        spin = schedule.spin is not None
        count = len(system.origin_rows)
        each = len(self._a.x)
        #: of the evaluation (vertices, 6), in own coordinates, then what rows gape by
        self.residual = self._a.b
        self._residuals = np.zeros((2, each, 6))
        self._increments = np.zeros((2, 2, each, 6))
        self._pivots = np.zeros(7)
        arrays = self._residuals, self._increments, self._pivots
        given = structure("equilibrium", dict(zip(EQUILIBRIUM, (*self._all, *arrays), strict=True)))
        self._kernels = {name: entry("static", name, given, source) for name in KERNELS}
        self._turning = np.zeros((each, 6), bool)
        self._turning[:count] = self._tree["turning"]
        self._units = np.where(self._turning, 1.0, 1 / system.length)
        self._units[count:] = 0.0
        #: chosen rows of closed loops; multipliers; a point where they are known, with them
        self._rows = np.full(1, -1)
        self._mu = self._a.total[count:]
        self._known = np.zeros(0), self._mu.copy()
        if self._plane is not None:
            self._tree["hold"][:] = self._plane.normal
        self._tree["coupling_law"][:, DAMPING] = 0.0
        self._coupled = Coupled(
            system, system.couplings_of(system.couplings.items), self._a.coupled, REST, 1.0
        )
        self._called: CalledAtRest | None = None
        self._turns: IndexArray | None = None
        self._taken: Amplitudes | None = None
        if system.couplings.own or spin:
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
            normal = self._plane.normal
            rows = self.system.rows
            y[:rows] -= ((y - self._a.y0)[:rows] @ normal)[:, None] * normal
        self._known = y, self._mu.copy()
        return y

    def begin(self, start: Point) -> None:
        """Go to an equilibrium, with the multipliers found last or those that balance it best."""
        rows = self.system.rows
        y = start.y
        self._place(y[:rows].ravel(), (y[rows:], self.schedule.ground(start.t)))
        self._coupled.turn(start.turns)
        self._turns = start.turns
        self._mixed = False
        self._taken = None
        self._take(start.t)
        self._call("begin")
        if len(self._mu):
            self._close(y)

    def _close(self, y: Floats) -> None:
        """Take independent rows of the closed loops, and the multipliers that are found there."""
        closure = self.coordinates.closure
        rows = self.coordinates.closure.rows
        if len(rows):
            nodal = self._nodal
            kin = self._nodal.kin
            nodal.begin(self._a.y0.copy(), self._a.ground1.copy())
            T = kin.values_at(y, nodal.fixed)
            rows = np.concatenate([s.rows for s in closure.select(y, T)])
        if not np.array_equal(rows, self._rows):
            bind.choose_rows(self.coordinates, self._tree, rows)
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
            self._called.take(amplitudes, self._turns)

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
        regular = self._call("pivots")
        out = self._pivots
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
        return float(size.max(initial=0.0)), float(size[self._turning].max(initial=0.0))

    def move(self, increment: Floats, change: Floats | None) -> None:
        """Move by an increment, which takes effect with the next evaluation.

        With a change (rows, 3) the stresses that it leads to are predicted.
        """
        self._mixed = change is not None and bool(self.system.beam_groups)
        if change is not None:
            self._a.change[:] = change
            self._call("predict")
        self._a.x.ravel()[:] = increment[: self._units.size]


# -- point after point -----------------------------------------------------------------------------

#: residual, relative to its terms, below which a configuration counts as an equilibrium
BALANCED = 1e-9
#: smallest share of the missing forces that fades away at once
SLOWEST = 1e-4
#: motion that springs allow at first, relative to the scene, how much softer they get in a round,
#: and how many rounds there are at most
GIVE, SOFTER, ROUNDS = 0.1, 10.0, 50


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
    ):
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
    def ended(self) -> Point:
        """Configuration and load factor where the last iteration ended."""
        return Point(self._problem.equations.solution(), self._problem.t, self._problem.start.turns)

    def balanced(self, point: Point) -> bool:
        """True if a point is an equilibrium."""
        return self._begin(point, Functional(), plain=True).residual() <= BALANCED

    def solve(
        self,
        start: Point,
        target: Functional,
        hold: float = 0.0,
        relief: Floats | float = 0.0,
    ) -> tuple[Solution | None, NewtonReport]:
        """The point that fulfils `target`, from the equilibrium `start`; None: not found.

        Parameters
        ----------
        hold : float, optional
            Stiffness of springs that hold all nodes where they are at the start.
        relief : (rows, 3) array, optional
            Forces left out of the balance.
        """
        special = target.predictor is not None or bool(
            self.neutral.motions or hold or np.any(relief)
        )
        problem = self._begin(start, target, special, hold, relief)
        if target.predictor is not None:
            # a load factor that is given is reached at once: the stiffness may be singular here
            problem.residual()
            given = target.value / target.by_factor if target.gradient is None else 0.0
            increment = np.append(self.plain.nearest(target.predictor), given)
            problem.sizes(increment)
            problem.apply(increment)
        report = newton(problem, self.settings)
        self.iterations += report.iterations
        self.attempts += 1
        y = problem.equations.y
        if report.converged and (wrong_branch := self.bound.wrong_branch(y)) is not None:
            report.converged = False
            report.reason = f"it is on another branch: {wrong_branch}"
        if not report.converged:
            found = None
            if np.isfinite(y).all():
                found = undefined(self.system, y) or over_rotated(self.system, y)
            report.reason += f": {self.bound.trouble}" if self.bound.trouble is not None else ""
            report.reason += f"; {found}" if found is not None else ""
            return None, report
        assert problem.predicted is not None  # there is always one iteration
        force = np.array(problem.equations.constraint_force()).reshape(-1)
        point = self.ended
        couplings = self.system.couplings
        if couplings.count:
            none = np.zeros(len(couplings.times) + 1)
            counted = couplings.starting(start.y, start.turns, none, 1.0, 0.0)
            point.turns = couplings.turns(counted, point.y)
        return Solution(point, force, report, problem.predicted), report

    def settled(self, start: Point) -> tuple[Solution | None, NewtonReport]:
        """The equilibrium near a start that is none: the missing forces fade away."""
        self.balanced(start)
        missing, point, left, step = self.plain.R.copy(), start, 1.0, 1.0
        while True:
            step = min(step, left)
            solution, report = self.solve(point, Functional(), relief=(left - step) * missing)
            if solution is None:
                step /= 2
                if step < SLOWEST:
                    return None, report
                continue
            point, left, step = solution.point, left - step, 2 * step
            if left == 0:
                return solution, report

    def relaxed(self, start: Point, target: Functional) -> tuple[Solution | None, NewtonReport]:
        """An equilibrium near, whether the stiffness is regular there or not; None: not found.

        Springs hold all nodes where they are, and give way round after round: what nothing holds
        and nothing drives stays where it is.
        """
        self._begin(start, target, plain=True)
        self.plain.evaluate(start.t + target.value)
        hold = size_of(self.system, self.plain.R / weights(self.system)) / GIVE
        found, at, aim = None, start, target
        for _ in range(ROUNDS):
            solution, report = self.solve(at, aim, hold)
            if solution is None:
                hold *= SOFTER
                continue
            moved = size_of(self.system, (solution.point.y - at.y)[: self.system.rows])
            found, at, aim, hold = solution, solution.point, Functional(), hold / SOFTER
            if moved <= SAME:  # the springs pull at nothing
                return found, report
        return (found if found is not None and self.balanced(at) else None), report

    def _begin(
        self,
        start: Point,
        target: Functional,
        plain: bool = False,
        hold: float = 0.0,
        relief: Floats | float = 0.0,
    ) -> Problem:
        """The problem of a point, at its start."""
        equations: PlainEquations | CompiledEquations = self.plain
        if self._compiled is not None and not plain:
            equations = self._compiled
        self.plain.hold, self.plain.relief, self.plain.neutral = hold, relief, self.neutral
        self._problem = Problem(equations, self.settings, start, target)
        return self._problem

    def look(self, point: Point) -> Floats:
        """Go to an equilibrium; gives its constraint force (n,)."""
        problem = self._begin(point, Functional())
        problem.residual()
        return np.array(problem.equations.constraint_force()).reshape(-1)

    def rate(self, point: Point | None = None) -> Floats:
        """Derivative (rows, 3) of the coordinates by the load factor; default: where solved last.

        At an equilibrium.
        """
        if point is not None:
            self._begin(point, Functional(), plain=True)
        return self._problem.rate()

    def pivots(self, point: Point) -> Pivots | None:
        """Pivots of the stiffness at the point solved last; None: of another one, or not known."""
        problem = self._problem
        here = problem.t == point.t and np.array_equal(problem.equations.y, point.y)
        return problem.equations.pivots() if here else None
