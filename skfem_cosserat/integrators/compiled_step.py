"""Steps by compiled kernels, with multipliers or without."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from itertools import pairwise
from time import monotonic
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from ..compiled.kept import Source, entry
from ..compiled.numbers import (
    ACTUATORS,
    ALL_FACTORED,
    AMPLITUDE,
    AMPLITUDE0,
    ASKED,
    BY_GROUND,
    BY_SCHEME,
    CALLED_BACK,
    CLEARANCE,
    COUPLED,
    DAMPED,
    DAMPED0,
    DISSIPATED,
    DONE,
    DRIVEN,
    END,
    ENDS,
    FACTORED,
    GROUND0,
    GUESS,
    ITERATIONS,
    KEPT,
    KNOWN,
    MASS,
    NUMBERS,
    RECORD,
    RESIDUAL,
    SHORT,
    SHORT_WAY,
    START,
    STATES,
    STEP,
    TAKEN,
    TRAVEL,
    TRAVELLED,
    TURNED,
    TURNS,
    UNMOVED,
    VARYING,
    VISCOUS_END,
    VISCOUS_START,
    WINDS,
    WORK,
)
from ..compiled.plan import Plan
from ..compiled.structures import STEPS, structure
from ..constraints import Multipliers, Treatment
from ..constraints.base import BoundTreatment, half_turn, largest
from ..coupling import Coupling
from ..errors import InputError
from ..linear import Solver
from ..model import System
from ..model.balance import amplitudes_at, external_force
from ..model.force_elements import Couplings, warn_of_jump
from ..model.plane import Plane
from ..newton import NewtonSettings
from ..time_function import averages_ahead
from ..types import Floats, IndexArray
from .base import Integrator
from .called_back import CalledBack
from .compiled_scene import (
    CompiledScene,
    NearestVelocity,
)
from .scheme import Scheme, State, StepWork, carried_rates

# -- force elements in compiled steps: what goes in and comes out, one row for each ----------------


class Coupled:
    """Force elements of a scene in compiled steps.

    Parameters
    ----------
    system : System
    couplings : Couplings
        Those of its force elements that have kernels.
    columns : (count, COUPLED) array
        What they have in a step, in place; see :mod:`skfem_cosserat.compiled.numbers`.
    scheme : Scheme
    h : float
        Step size (s).
    """

    def __init__(
        self, system: System, couplings: Couplings, columns: Floats, scheme: Scheme, h: float
    ) -> None:
        self._couplings, self._columns = couplings, columns
        self.resize(scheme, h)
        number = {id(item): k for k, item in enumerate(system.couplings.items)}
        turning = COUPLED * np.array([number[id(i)] for i in couplings.angles], dtype=np.int64)
        #: where full turns are: at the start of a step and at its end
        self._turns, self._turned = TURNS + turning, TURNED + turning
        self._angles = [number[id(i)] for i in couplings.angles]
        columns[self._angles, WINDS] = 1.0
        self._vectors = [(number[id(i)], i) for i in couplings.items if _turns_freely(i)]
        #: channels of actuators
        self.channels = len(couplings.times)
        # of each time of an actuator, in their order
        driven = [number[id(item)] for item in couplings.owners]
        self._driven = (
            np.array(driven, dtype=np.int64),
            np.array([driven[:k].count(c) for k, c in enumerate(driven)], dtype=np.int64),
        )

    def resize(self, scheme: Scheme, h: float) -> None:
        """Take steps of another size (s)."""
        self._h, self._late = h, scheme.at_end and scheme.rate > 0  # not at rest
        # at its end the velocity is that along a way of its own
        self._columns[:, STEP] = 2 / scheme.rate if self._late else h

    @property
    def alike(self) -> bool:
        """Whether steps differ in nothing but the state and known forces of actuators."""
        return not (self._vectors or (self._late and self._couplings.count))

    def turns_of(self, log: Floats) -> IndexArray:
        """Full turns (k, angles) of all angles, of k steps that were solved in one go."""
        return np.rint(log[:, self._angles]).astype(np.int64)

    def forces_at(self, time: float) -> Floats:
        """Forces (channels,) of actuators in a step that starts at a time (s)."""
        return self._couplings.averages(time, time + self._h)[:-1] if self.channels else NONE

    def ahead(self, times: Sequence[float]) -> Floats | None:
        """The same of steps from these times (s) on (k, channels); None: not known yet."""
        return averages_ahead(self._couplings.times, times, self._h)

    def driven(self, forces: Floats) -> Floats:
        """Forces (k, channels) of actuators, by force elements (k, count, DRIVEN)."""
        out = np.zeros((len(forces), len(self._columns), DRIVEN))
        out[:, *self._driven] = forces
        return out

    def begin(self, state: State, loaded: bool = False) -> None:
        """Forces of actuators, unless they are there, and full turns at the start of a step."""
        if self.channels and not loaded:
            start, end = state.time, state.time + self._h
            if self._late:
                self.drive(self._couplings.values(end)[:-1])
                self._of_actuators(AMPLITUDE0)[self._driven] = self._couplings.values(start)[:-1]
            else:
                self.drive(self.forces_at(start))
        self.turn(state.turns)

    def _of_actuators(self, first: int) -> Floats:
        """Columns (count, DRIVEN) from one on, in place: what force elements have by channels."""
        return self._columns[:, first : first + DRIVEN]

    def drive(self, forces: Floats) -> None:
        """Take these of the actuators' channels."""
        self._of_actuators(AMPLITUDE)[self._driven] = forces

    def turn(self, turns: IndexArray | None) -> None:
        """Take these full turns at the start of a step, as in a state."""
        if len(self._turns):
            self._couplings.check_turns(turns)
            self._columns.put(self._turns, 0 if turns is None else turns)

    def turns(self, time: float) -> IndexArray | None:
        """Full turns of all angles at the end of the step, at a time; None if there are none.

        Warns of a rotation vector that passed a turn of pi, where it jumps.
        """
        for k, item in self._vectors:
            if self._columns[k, TURNED] > np.pi:
                warn_of_jump(item, time)
        if not len(self._turned):
            return None
        return np.rint(self._columns.take(self._turned)).astype(np.int64)

    def work(self, loads: float, lost: float, record: Floats) -> StepWork:
        """Work of the step, with that of the loads and what is lost elsewhere (J)."""
        if not self._couplings.count:
            return StepWork(loads, dissipated=lost)
        found = DISSIPATED, BY_SCHEME, BY_GROUND, ACTUATORS
        taken, numerical, ground, actuators = record.take(found).tolist()
        if self._late:  # by the trapezoidal rule
            sums = self._columns.sum(0)
            damped = self._of_actuators(DAMPED) + self._of_actuators(DAMPED0)
            taken = float((0.5 * damped * self._of_actuators(TRAVEL)).sum())
            ground = 0.5 * (ground + float(sums[GROUND0]))
            forces = self._of_actuators(AMPLITUDE) + self._of_actuators(AMPLITUDE0)
            actuators = float((0.5 * forces * self._of_actuators(TRAVEL)).sum())
        return StepWork(loads, actuators, lost + taken, ground, numerical)


def _turns_freely(item: Coupling) -> bool:
    """Whether one of its coordinates is a rotation vector."""
    return any(coordinate.kind == "rotation" for coordinate in item.coordinates)


# -- viscosity of beams in compiled steps: elements beside the elastic ones ------------------------


class Viscous:
    """Stresses ``eta (eps_1 - eps_0)/h`` as those of elements of the stiffness ``2 eta/h``.

    These take the difference of both ends of a way, not a mean of them, and have no mass; they act
    in the middle of it. Where forces act at the end of a step, it is the middle of a way with the
    velocity there.

    Parameters
    ----------
    bound : list of dict
        Arrays of these elements, which are groups of their own among those of the scene.
    """

    def __init__(self, bound: list[dict[str, Any]]) -> None:
        self._bound, self._way = bound, 1.0

    def resize(self, way: float, numbers: Floats) -> None:
        """Take ways of this length (s): the step size, or of a way of its own."""
        self._way = way
        for fields in self._bound:
            fields["numbers"][:] = numbers
            fields["numbers"][[MASS, START, END, ENDS]] = 0.0, -0.5, 0.5, 1.0
            fields["stiffness"][:] = (2 / way) * fields["viscosity"]

    @property
    def numbers(self) -> Floats:
        """Of all groups (k, numbers), in place."""
        return self._bound[0]["all_numbers"]

    def dissipated(self, h: float, late: bool) -> float:
        """Lost in the step evaluated last (J), of size h (s); `late`: by the forces at its ends."""
        end = sum(self.numbers[:, VISCOUS_END].tolist())
        if late:
            return float(0.5 * (sum(self.numbers[:, VISCOUS_START].tolist()) + end))
        return float(self.lost(end, h))

    def lost(self, found: Any, h: float) -> Any:
        """The same by what kernels have found in one step or in several, see `VISCOUS_END`."""
        return h * np.maximum(0.0, found / self._way)


# -- steps: the same iteration as that of the stepper, in a few compiled calls ---------------------


#: most steps in one go, and most unknowns moved in all of them together: for less than a second,
#: as Ctrl-C waits for them; fewer where every state is kept
STRIDE, MOVED = 256, 10**6
#: states of a block that are kept at least, beside one that may be taken back: starts and ends of
#: three steps, from which the last constraint force follows where no step comes after it
LAST = 4
#: what depends on time in loads: dead ones, moments, and those that are fixed in bodies
LOADS = "dead", "moments", "followers"
#: forces of no actuators
NONE = np.zeros(0)
#: for how long (s) functions of time are asked ahead
AHEAD = 0.2
#: what steps change beside arrays, see :meth:`CompiledStep.rewind`
MARKED = "factorisations", "_travelled", "_travel", "_farthest", "_factors", "_loaded"


class BlockOfSteps(NamedTuple):
    """Steps that were solved in one go, one after the other; the next ones overwrite its arrays.

    Of `kept` steps, the last ones, there are states and impulses.

    Attributes
    ----------
    stuck : bool
        Whether the step after them was tried, and not solved.
    q, p, rates : (kept, n), (kept, n), (kept, k, n) arrays
        States at their ends; k = 0 where no rates are carried.
    impulse : (kept, rows, 3) array
        ``h G^T lambda``.
    turns : (kept, angles) array
        Full turns of the angles of force elements.
    ground : (kept, g, 3) array
        Rows of the ground.
    iterations, residual : (steps,) arrays
        Newton iterations, scaled residual.
    loads, actuators, dissipated, by_ground, numerical : (steps,) arrays
        Works (J), as in :class:`.scheme.StepWork`.
    """

    stuck: bool
    q: Floats
    p: Floats
    rates: Floats
    impulse: Floats
    turns: IndexArray
    ground: Floats
    iterations: IndexArray
    residual: Floats
    loads: Floats
    actuators: Floats
    dissipated: Floats
    by_ground: Floats
    numerical: Floats

    @property
    def works(self) -> tuple[Floats, ...]:
        """Those of :class:`.scheme.StepWork`, in their order."""
        return self.loads, self.actuators, self.dissipated, self.by_ground, self.numerical

    @property
    def steps(self) -> int:
        """How many."""
        return len(self.iterations)


class CompiledStep(CompiledScene):
    """Steps of one system, integrator and step size, compiled.

    Parameters
    ----------
    integrator : Integrator
    h : float
        Step size (s).
    system, settings, plan, solver, source
        As for :class:`CompiledScene`.
    plane : Plane, optional
        In which the scene stays: rounding that leads out of it is taken away after each step.
    """

    def __init__(
        self,
        system: System,
        integrator: Integrator,
        h: float,
        settings: NewtonSettings,
        plan: Plan | None = None,
        solver: Solver | None = None,
        source: Source = Source.COMPILER,
        plane: Plane | None = None,
    ) -> None:
        scheme = integrator.scheme(h)
        assert isinstance(scheme, Scheme)
        own = system, scheme, scheme.weight, settings, plan, solver
        super().__init__(*own, source=source)
        self.integrator, self.h = integrator, h
        self._normal = None if plane is None else plane.normal
        #: whether the unknowns are others than the treatment's
        self._others = plane is not None or system is not system.tied
        self._record = np.zeros(len(RECORD))
        self._failed: tuple[float, Exception] | None = None  # a load that steps have not come to
        #: what there was before the last block of steps that may be taken back, and where it began
        self._marked: tuple[dict[str, Any], list[Floats], State] | None = None
        self._nearest: NearestVelocity | None = None
        if scheme.moved and system.m and NearestVelocity.serves(system.tied):
            self._nearest = NearestVelocity(system.tied, settings, source)
        viscous = [fields for fields in self._beams if "viscosity" in fields]
        self._viscous = Viscous(viscous) if viscous else None
        self._carry(scheme)
        self._called_back: CalledBack | None = None
        self._couple(scheme, h)
        self._resist(h)
        self._decaying = self._of_decay() if scheme.decay else []
        self._rows = np.zeros(0, dtype=np.int64)
        #: whether there are closed loops, whose independent rows are chosen on the way
        self.looped = len(system.closure.rows) > 0
        self._choose(self._rows)
        self._record[CLEARANCE] = 0.0 if self.looped else np.inf
        # how far coordinates went since rows of closed loops were chosen, and in the last step
        self._travelled = self._travel = self._farthest = np.inf
        #: whether nothing changes from step to step but the state, where loads do not
        self._alike = not (
            (system.moving and scheme.at_end)
            or not self._coupled.alike
            or self._called_back is not None
            or system.drag is not None
            or (self._viscous is not None and scheme.at_end)
            or self._rest is not None
            or (self._moves and self._nearest is None)
            or (scheme.at_end and not system.loading.dead_only)
            or scheme.decay
            or (integrator.loses and 0 < scheme.weight < 1)  # forces at states take more than means
        )
        self._solve = self._entry()

    def _carry(self, scheme: Scheme) -> None:
        """What is carried on from step to step, with the numbers of the scheme for it."""
        from ..compiled import bind

        self._moves = bool(scheme.moved) and self.system.m > 0
        counts = len(scheme.table), len(scheme.before), len(scheme.moved) * self._moves
        n = max(1, self.system.n)
        self._kept = max(LAST + 1, min(STRIDE // 2, MOVED // (10 * n)))
        self._most = max(LAST + 1, min(STRIDE, MOVED // n))
        nearest = None if self._nearest is None else self._nearest.bound
        own = counts, nearest, self._normal, (self._kept, self._most), self._evaluated
        viscous = None if self._viscous is None else self._viscous.numbers
        self._carried, arrays = bind.bound_carried(self.system, self._arrays, *own, viscous)
        self._o = SimpleNamespace(**arrays)
        self._set_rates(scheme)

    def _set_rates(self, scheme: Scheme) -> None:
        """Numbers of the scheme that its rates take, and the size of terms of momenta."""
        o = self._o
        if self._normal is not None:
            system, h = self.system, abs(self.h)
            o.limit[:] = largest(abs(system.inertia) @ abs(system.q0.reshape(-1, 3))) / h
        o.table[:] = np.reshape(scheme.table, o.table.shape)
        o.before[:] = scheme.before
        if scheme.relative:
            self._a.flow.scheme[:] = scheme.decay, 2 / scheme.mass
        self._of_drift = np.array(scheme.rates)
        if self.late:
            o.of_drift[:] = scheme.rates if scheme.rates else 0.0
        o.moved_force[:] = scheme.moved_force
        if len(o.moved):
            o.moved[:] = scheme.moved

    def _couple(self, scheme: Scheme, h: float) -> None:
        """Force elements; loads that are functions are called back."""
        system, functions = self.system, self.system.couplings.functions
        inside = system.couplings_of(system.couplings.items) if functions else system.couplings
        self._coupled = Coupled(system, inside, self._a.coupled, scheme, h)
        if not functions:
            return
        own = system.couplings_of([], functions)
        self._called_back = CalledBack(system, own, self.plan, self._a)
        self._all[0][CALLED_BACK] = self._called_back.address

    def _resist(self, h: float) -> None:
        """Drag and viscous sections in steps of this size."""
        # a velocity is 2 (y_mid - y_0)/h, or as long at the end of a step as another way takes: a
        # force that follows, and a dead one
        way = 2 / self.scheme.rate if self.scheme.at_end else h
        self._drag_factor, self._loaded = -2 / way, False
        if self._viscous is not None:
            self._viscous.resize(way, self._all[-1])

    def _entry(self) -> Callable[[], float]:
        """The compiled loop for these structures."""
        given = dict(zip(STEPS, (*self._all, self._record, self._carried), strict=True))
        return entry("step", "solve", structure("steps", given), self._source)

    def resized(self, h: float) -> CompiledStep:
        """The same for steps of another size; factors of matrices are not kept."""
        scheme = self.integrator.scheme(h)
        assert isinstance(scheme, Scheme)
        for name, number in self._numbers_of(scheme).items():
            self._all[-1][NUMBERS.index(name)] = number
        self._a.last *= h / self.h  # to begin with: impulses of rows, too
        known = min(self._record[KNOWN], 1.0)
        self._record[[KNOWN, GUESS, KEPT]] = known, known, 0.0
        self.h, self.scheme, self._factors, self._marked = h, scheme, None, None
        self._set_rates(scheme)
        self._coupled.resize(scheme, h)
        self._resist(h)
        return self

    def close(self, rows: IndexArray) -> None:
        """Take these constraint rows, independent at the start of the step, to close the loops."""
        rows, self._travelled = np.sort(rows), 0.0
        if not np.array_equal(rows, self._rows):
            self._rows = rows
            self._choose(rows)
            self._record[KEPT] = 0.0
            off, count = self._tree["row_on"] == 0, len(self.system.origin_rows)
            for known in (self._a.last, self._a.before):  # no step begins with their impulses
                known[count:, : off.shape[1]][off] = 0.0

    def _choose(self, rows: IndexArray) -> None:
        from ..compiled.bind_rows import choose_rows

        choose_rows(self.system, self._tree, rows)

    def due(self, state: State, bound: BoundTreatment) -> bool:
        """Whether the treatment has to choose rows that close the loops: it knows what is singular.

        From another state than the last; or after a motion of length `clearance`, if those that
        there are have come too close to each other, too.
        """
        if not np.isfinite(self._travelled):
            return True
        # as bytes: this is asked in each step, and comparing arrays takes longer
        if state.q.tobytes() != self._a.y1[: self.system.rows].tobytes():
            return True
        if self._travelled >= bound.clearance:
            if not bound.clear(self._a.y1, self._farthest):
                return True
            self._travelled = self._farthest  # a step may jump over a singular position
        self._record[CLEARANCE] = bound.clearance  # the look may have changed it
        return self._travelled >= bound.clearance

    @property
    def last(self) -> Any:
        """What the treatment keeps of the last step, see there; None before the first.

        Nothing where the unknowns are others: with multipliers, or of a plane in space.
        """
        if self._others:
            return None
        return self._a.last.ravel()[self._numbering] if self._record[KNOWN] else None

    def resume(self, last: Any) -> None:
        """See the treatment: the next step is guessed from what is known of another one."""
        last = None if self._others else last
        self._record[KNOWN] = self._record[GUESS] = float(last is not None)
        if last is not None:
            self._a.last.ravel()[self._numbering] = np.real(last)

    def _begin(self, state: State, end: float, loaded: bool = False) -> None:
        """Loads, unless they are there, prescribed motion and all that is fixed during a step."""
        system, t, scheme = self.system, state.time, self.scheme
        self._time = t
        if not (loaded or (self._loaded and system.loading.constant)):
            self.load(self._factors_at(t))
            self._loaded = True
        self._coupled.begin(state, loaded)
        moving = bool(system.moving)
        self._place(state.q, self._ground_at(t, end) if moving and not loaded else None)
        self.rates0 = self.integrator.start(system.tied, state, self.h) if scheme.table else None
        if system.drag is not None:
            known = self._drag_factor * state.q
            if scheme.at_end and self.rates0 is not None and scheme.rates:
                known += self._of_drift @ self.rates0.reshape(len(self._of_drift), -1)
            self._a.dead[:] = self._dead - system.drag @ known.reshape(-1, 3)
        if self.late and moving:
            rows, a = system.rows, self._a
            a.rate0[rows:], there = system.ground_rate(t), system.ground_rate(t + self.h)
            a.drift[rows:] = there - scheme.rate * (a.ground1 - a.y0[rows:])
        self._a.p0[:] = state.p.reshape(-1, 3)
        if self.rates0 is not None:
            self._o.rates[:] = self.rates0.reshape(-1, 3)
        if self._nearest is not None and self._nearest.follows:
            self._nearest.begin(state.q)
        if self._called_back is not None:
            self._called_back.begin(state, self.h, scheme, self.rates0)

    def _ground_at(self, time: float, end: float) -> tuple[Floats, Floats]:
        """Rows of the ground at both ends (s) of a step, exactly: it may jump there."""
        return self.system.ground(time), self.system.ground(end)

    def _factors_at(self, time: float) -> Floats:
        """Factors of all loads' channels in a step that starts at a time (s)."""
        if self._failed is not None and self._failed[0] == time:
            error, self._failed = self._failed[1], None
            raise error
        loading, end = self.system.loading, time + self.h
        return loading.values(end) if self.scheme.at_end else loading.averages(time, end)

    def _load_all(self, times: Sequence[float], patience: float) -> int:
        """Loads, motors and ground of steps between these times (s); of how many they are known.

        What a function of the user raises is kept for the step that meets it. A slow one is not
        asked for longer than `patience` (s), as nothing is solved meanwhile.
        """
        o, begun, loading, moving = self._o, monotonic(), self.system.loading, self.system.moving
        factors: Any = None if moving else loading.ahead(times[:-1], self.h)
        forces: Any = self._coupled.ahead(times[:-1])
        ground = []
        if factors is None or forces is None:
            factors, forces = [], []
            for time, end in pairwise(times):
                try:
                    own = self._factors_at(time), self._coupled.forces_at(time)
                    ground += [self._ground_at(time, end)] if moving else []
                except Exception as error:
                    if not factors:
                        raise
                    self._failed = time, error
                    break
                factors.append(own[0])
                forces.append(own[1])
                if monotonic() - begun > patience:
                    break
        factors, forces = np.array(factors), np.array(forces)
        if moving:
            o.all_ground[: len(ground)] = ground
            o.y0[self.system.rows :], o.ground1[:] = ground[0]
        if forces.size:
            o.all_driven[: len(forces)] = self._coupled.driven(forces)
            self._coupled.drive(forces[0])
        found = loading.dead_force(factors), *(self._following(factors) if self._evaluated else ())
        for name, each in zip(LOADS, found, strict=False):
            o.__dict__[f"all_{name}"][: len(factors)] = each
            o.__dict__[name][:] = each[0]
        self._factors = None  # those of another step may have been there
        return len(factors)

    def solve(self, state: State, end: float) -> tuple[int, float] | None:
        """Solve the step from `state` to a time (s): iterations, residual; None: not converged."""
        self._record[STATES], self._marked = 1, None
        if not self._solved(state, 1, end):
            return None
        return int(self._record[ITERATIONS]), self.residual

    def takes_blocks(self, time: float) -> bool:
        """Whether steps from this time (s) on differ in nothing but state and known functions."""
        return self._alike and not (self.scheme.at_end and self._varies(time))

    def _varies(self, time: float) -> bool:
        """Whether loads, forces of actuators or the ground may change after this time (s)."""
        loading = self.system.loading
        constant = loading.constant or time >= loading.constant_after
        return not (constant and self.system.couplings.constant and not self.system.moving)

    def most(self, time: float, every: bool) -> int:
        """Most steps in one go from this time (s) on."""
        return self._kept if every or self._varies(time) else self._most

    def advance_block(
        self,
        state: State,
        times: Floats,
        every: bool,
        mark: bool = False,
        patience: float | None = None,
    ) -> BlockOfSteps:
        """Solve steps that end at these times (s) in one go; keep `every` state, or the last.

        Every state is kept where the ground moves, as it does work by the force of each step.
        Fewer, where something has to be looked at, or loads are not known in time (`patience`, s).
        `mark`: some of them may be taken back by :meth:`rewind`.
        """
        self._marked = None
        if mark:
            own = {name: getattr(self, name) for name in MARKED}
            self._marked = own, [array.copy() for array in self._lasting], state
        every = every or bool(self.system.moving)
        self._record[STATES] = self._kept if every else LAST + 1
        steps, varies = len(times), self._varies(state.time)
        if varies:
            ends = [state.time, *times.tolist()]
            steps = self._load_all(ends, AHEAD if patience is None else patience)
        self._record[VARYING] = varies
        solved = self._solved(state, steps, float(times[0]), varies)
        self._record[VARYING] = 0.0
        if solved and self.unmoved:  # the general way moves velocities
            solved = self._take_back(False)
        done, o, n, rows = int(self._record[DONE]), self._o, self.system.n, self.system.rows
        logged = o.log_numbers[:done].T.copy()
        iterations, residual, loads, taken, lost, numerical, viscous, actuators, ground = logged
        if self._viscous is not None:
            lost = self._viscous.lost(viscous, self.h) + lost
        kept: Any = slice(done) if every else np.arange(max(0, done - LAST), done) % (LAST + 1)
        count = done if every else len(kept)
        return BlockOfSteps(
            not solved,
            o.log_q[kept, :rows].reshape(count, n),
            o.log_p[kept, :rows].reshape(count, n),
            o.log_rates[kept].reshape(count, len(o.table), n),
            o.log_impulse[kept, :rows],
            self._coupled.turns_of(o.log_turns[kept]),
            self._grounds(count),
            *(iterations.astype(np.int64), residual),
            *(loads, actuators, lost + taken, ground, numerical + taken),
        )

    def _grounds(self, count: int) -> Floats:
        """Rows of the ground (count, g, 3) at the ends of steps that were solved in one go."""
        if self.system.moving:
            return self._o.all_ground[:count, 1].copy()
        return np.broadcast_to(self._o.ground1, (count, *self._o.ground1.shape))

    @cached_property
    def _lasting(self) -> list[Floats]:
        """Arrays in which steps leave something to the next ones, and others; no tables."""
        found = {}
        tables = [self._arrays, self._tree, *self._beams, vars(self._o)]
        for fields in tables:
            for name, array in fields.items():
                if isinstance(array, dict):  # of laws
                    tables.append(array)
                elif isinstance(array, np.ndarray) and array.flags.writeable and array.size:
                    numbers = array.dtype.kind in "fc" or name == "known"
                    if numbers and not name.startswith(("log_", "all_")):
                        found[id(array)] = array
        return [*found.values(), self._record]

    def rewind(self, state: State, times: Floats) -> None:
        """Take back the last block of steps, which began at a state, and solve the first ones anew.

        They end at these times (s). All is then as if only these had been solved, to the last bit.
        The block has to be a marked one, of which every state is kept.
        """
        if self._marked is None or self._marked[2].q.tobytes() != state.q.tobytes():
            text = "its steps were not taken with mark=True, or others have been solved since"
            raise InputError("argument report", text)
        own, arrays, _ = self._marked
        vars(self).update(own)
        for array, before in zip(self._lasting, arrays, strict=True):
            array[...] = before
        self.advance_block(state, times, True, patience=np.inf)  # all of them, as before

    @property
    def handed_on(self) -> dict[str, Floats]:
        """What a state carries on beside q and p."""
        return carried_rates(self._o.after, len(self._o.table))

    @property
    def unmoved(self) -> bool:
        """Whether velocities are left to be moved onto the hidden constraints."""
        return bool(self._record[UNMOVED])

    def _solved(self, state: State, steps: int, end: float, loaded: bool = False) -> bool:
        """Solve up to so many steps; whether the last one tried was solved.

        `end`: of the first one (s); `loaded`: their loads are there.
        """
        self._begin(state, end, loaded)
        record, a = self._record, self._a
        record[ASKED], record[TRAVELLED] = steps, self._travelled
        known = self.looped and record[KNOWN] > 0.0
        solved = self._solve() != 0.0
        self.factorisations += int(record[ALL_FACTORED])
        self.complain()
        if self._called_back is not None:
            self._called_back.complain()
        if self.looped:
            self._farthest, self._travel, _ = a.found.tolist()
            self._travelled = float(record[TRAVELLED])
        if solved and (self.looped or record[FACTORED] > SHORT) and self._flipped():
            return self._take_back(known or (self.looped and record[DONE] > 1))
        if not solved:
            self._travelled = np.inf
        return solved

    def _take_back(self, known: bool) -> bool:
        """Leave the last step to the general way: not solved. `known`: what the one before left."""
        self.resume(self._a.before.ravel()[self._numbering] if known else None)
        self._record[KEPT] = 0.0
        self._record[DONE] -= 1
        self._travelled = np.inf
        return False

    def _flipped(self) -> bool:
        """Whether a frame has turned by half a turn, where the midpoint tells nothing of it."""
        if self.looped and self._travel < SHORT_WAY:
            return False
        middle = 0.0 < self.scheme.weight < 1.0
        turned = (self.looped or middle) and half_turn(self.system, self._a.y0, self._a.y1)
        return bool(turned)

    @property
    def residual(self) -> float:
        """Scaled residual of the last step."""
        return float(self._record[RESIDUAL])

    @property
    def missed(self) -> float:
        """What rows of closed loops that depend on others gape by, against their terms."""
        return float(self._a.found[2])

    @property
    def y1(self) -> Floats:
        """All rows (total, 3) at the end of the step."""
        return self._a.y1.copy()

    @property
    def impulse(self) -> Floats:
        """``h G^T lambda`` (rows, 3) of the step."""
        last = (int(self._record[DONE]) - 1) % int(self._record[STATES])
        return self._o.log_impulse[last, : self.system.rows].copy()

    def carried(self) -> Floats:
        """Momentum (rows, 3) carried on."""
        return self._a.carried.copy()

    def work(self) -> StepWork:
        """Work of the loads along the step."""
        late = self.scheme.at_end
        lost = 0.0 if self._viscous is None else self._viscous.dissipated(self.h, late)
        loads, drag = float(self._record[WORK]), self.system.drag
        loading = self.system.loading
        if drag is not None:  # it is among the loads of the kernels
            rows, after = self.system.rows, self.scheme.found_with * self.system.rows
            dq = self._a.y1[:rows] - self._a.y0[:rows]
            v = self._o.after[after : after + rows] if late else dq / self.h
            own = float(((drag @ v) * dq).sum())
            loads += own
            if late:
                assert self.rates0 is not None
                lost += 0.5 * (own + float(((drag @ self.rates0[0]) * dq).sum()))
            else:  # a step back, as composed ones have, gives what was lost
                lost += self.h * max(0.0, own / self.h)
        if late and not (loading.constant and loading.dead_only):
            # by the trapezoidal rule
            loads = 0.5 * (loads + self._work_at_start())
        taken = float(self._record[TAKEN])
        work = self._coupled.work(loads, lost, self._record)
        if taken:
            lost, numerical = work.dissipated + taken, work.numerical + taken
            work = work._replace(dissipated=lost, numerical=numerical)
        if self.scheme.decay:
            own = self._decay_work()
            lost, numerical = work.dissipated + own, work.numerical + own
            work = work._replace(dissipated=lost, numerical=numerical)
        if self._called_back is None:
            return work
        return StepWork(*(a + b for a, b in zip(work, self._called_back.work(), strict=True)))

    def _decay_work(self) -> float:
        """What the scheme takes by its stresses (J), chi/2 D times the change of strains."""
        lost, chi = 0.0, self.scheme.decay
        for fields, weights, flexible in self._decaying:
            if flexible is None:  # strains at the start are there, no stresses
                change = fields["strains"] - fields["S0"]
                lost += float(((change[..., None, :] @ weights)[..., 0, :] * change).sum())
                continue
            # the stresses of a step are (1 + chi)/2 of the way from its start to its end
            change = fields["S"] - fields["S0"]
            softened = change * flexible if flexible.ndim == 2 else change @ flexible
            lost += 4 / (1 + chi) ** 2 * float(np.vdot(change * weights, softened))
        return 0.5 * chi * lost

    def _of_decay(self) -> list[tuple[dict[str, Any], Floats, Floats | None]]:
        """Of each group of beams its arrays, weights and flexibility, for :meth:`_decay_work`."""
        out: list[tuple[dict[str, Any], Floats, Floats | None]] = []
        for group, fields in zip(self.system.beam_groups, self._beams, strict=False):
            elements = group.elements
            if elements.stored:
                out.append((fields, elements.weighted_stiffness, None))
                continue
            flexible = np.linalg.pinv(fields["stiffness"], 1e-12, True)
            if len(flexible) == 1 and fields["diagonal"]:  # of all elements
                flexible = flexible.diagonal(axis1=1, axis2=2)
            else:
                flexible = flexible[fields["section"]]
            out.append((fields, elements.measure, flexible))
        return out

    def _work_at_start(self) -> float:
        """Work (J) along the step of the loads at its start."""
        system, a, rows = self.system, self._a, self.system.rows
        force = external_force(system, a.y0, amplitudes_at(system, self._time))
        return float((force * (a.y1[:rows] - a.y0[:rows])).sum())

    def turns(self) -> IndexArray | None:
        """Full turns of angles at the end of the step, as in a state."""
        return self._coupled.turns(self._time + self.h)


# -- which scene compiled steps take ---------------------------------------------------------------


def compiled_step(
    system: System,
    integrator: Integrator,
    treatment: Treatment,
    h: float,
    settings: NewtonSettings,
    plan: Plan | None = None,
    solver: Solver | None = None,
    *,
    source: Source = Source.COMPILER,
) -> CompiledStep:
    """Steps with one of the treatments; a scene in a plane is stepped in space."""
    scene = stepped(system, treatment)
    return CompiledStep(scene, integrator, h, settings, plan, solver, source, system.plane)


def stepped(system: System, treatment: Treatment) -> System:
    """The scene whose coordinates compiled steps have: in space.

    With multipliers no joint is in its tree, else all joints are, but no beam that holds strains.
    """
    scene = system.spatial
    return scene.untied if isinstance(treatment, Multipliers) else scene.jointed
