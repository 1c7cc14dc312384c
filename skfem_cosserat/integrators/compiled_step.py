"""Arrays of one system for compiled kernels, and its steps by them, with multipliers or without."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from ..compiled import bind, kept
from ..compiled.kept import Source, address, entry
from ..compiled.numbers import (
    ALL_FACTORED,
    AMPLITUDE,
    ASKED,
    CALLED_BACK,
    CLEARANCE,
    COUPLED,
    DONE,
    END,
    ENDS,
    ENERGY,
    FACTORED,
    GUESS,
    KEPT,
    KNOWN,
    MASS,
    NEXT_LOADS,
    NUMBERS,
    RECORD,
    SHORT,
    SHORT_WAY,
    START,
    STEP,
    TRAVELLED,
    TURNED,
    TURNS,
    UNMOVED,
    VARYING,
    WINDS,
)
from ..compiled.plan import Plan, following, plan_of
from ..compiled.structures import PROJECTION, STEPS, structure
from ..constraints import Multipliers, Treatment
from ..constraints.base import BoundTreatment, half_turn
from ..linear import LinearSolver, SingularMatrixError, Solver
from ..model import System
from ..model.force_elements import Couplings, warn_of_jump
from ..model.parts import separate_parts
from ..model.quadratic import TOGETHER
from ..model.system import Coordinates
from ..newton import NewtonSettings
from ..pattern import FrozenPattern
from ..types import Floats, IndexArray, largest
from .base import Integrator
from .block import Block
from .called_back import Called, CalledBack, CalledForces, CalledLaws
from .scheme import Scheme, State, StepOrigin, StepWork
from .step_balance import decay_work


def is_viscous(system: System) -> bool:
    """True if a section of a scene has Kelvin-Voigt damping."""
    return any(group.viscous for group in system.beam_groups)


# -- what an elimination in blocks leaves of a system, by a sparse solver --------------------------


class Rest(Called):
    """Vertices that were not eliminated: their blocks as a sparse matrix of a frozen pattern.

    Compiled code calls with 0 to factorise, 1 to solve.

    Parameters
    ----------
    plan : Plan
        With vertices left.
    size : (nv,) int array
        Unknowns of each vertex: the first rows and columns of its blocks.
    A : (slots, 6, 6) array
        Blocks, in place: those of the rest after the elimination of all others.
    x : (nv, 6) array
        Right-hand sides, in place, which the solution replaces.
    solver : Solver, optional
        Take this one; default: the fastest that is installed.

    Attributes
    ----------
    solver : LinearSolver
    """

    def __init__(
        self, plan: Plan, size: IndexArray, A: Floats, x: Floats, solver: Solver | None = None
    ) -> None:
        left = np.zeros(len(size), bool)
        left[plan.rest] = True
        each = np.where(left, size, 0)
        slots = np.flatnonzero(each[plan.ends].all(axis=1))
        ends, k, first = plan.ends[slots], np.arange(6), np.cumsum(each) - each
        inside = (k[:, None] < each[ends[:, :1, None]]) & (k < each[ends[:, 1:, None]])
        places = (36 * slots[:, None, None] + 6 * k[:, None] + k)[inside]
        rows, columns = (first[ends[:, n], None, None] for n in range(2))
        entries = np.broadcast_arrays(rows + k[:, None], columns + k)
        shape = (int(each.sum()), int(each.sum()))
        pattern = FrozenPattern(entries[0][inside], entries[1][inside], shape)
        self._take = np.empty(pattern.nnz, np.int64)  # every entry is in one place only
        self._take[pattern.slot] = places
        self._numbers = (6 * np.arange(len(size))[:, None] + k)[k < each[:, None]]
        self._A = A.reshape(-1)
        self._x = x.reshape(-1)
        self.solver = LinearSolver(pattern, solver)
        super().__init__(self._answer)

    def _answer(self, again: int) -> bool:
        try:
            if again:
                self.solve()
            else:
                self.factor()
        except SingularMatrixError:
            return False
        return True

    def factor(self) -> None:
        """Factorise the blocks as they are.

        Raises
        ------
        SingularMatrixError
            If a pivot vanishes.
        """
        self.solver.factor(self._A.take(self._take))

    def solve(self) -> None:
        """Solve for the right-hand sides, with the factors that are there.

        Raises
        ------
        SingularMatrixError
            If the solution is not finite.
        """
        self._x[self._numbers] = self.solver.solve_again(self._x[self._numbers])


# -- arrays and parts of a system ------------------------------------------------------------------

#: addresses of the parts; what is constant, the elimination, what changes, and beams
Bound = tuple[IndexArray, Any, Any, Any, Any]


class CompiledScene:
    """Arrays and parts of one system for compiled kernels.

    :func:`.choice.refusal` says for what there are none.

    Parameters
    ----------
    coordinates : Coordinates
    scheme : Scheme
    weight : float
        Constraint forces act at ``(1 - w) y_0 + w y_1``.
    settings : NewtonSettings
    plan : Plan, optional
        Of the elimination, if it is there already.
    solver : Solver, optional
        Of what elimination in blocks leaves.
    static : bool
        For a balance at rest, with loads that are evaluated in each iteration.
    source : Source
        Where kernels may come from.

    Raises
    ------
    NotKept
        If a kernel is in none of these places.

    Attributes
    ----------
    factorisations : int
        So far.
    """

    _arrays: dict[str, Any]

    def __init__(
        self,
        coordinates: Coordinates,
        scheme: Scheme,
        weight: float,
        settings: NewtonSettings,
        plan: Plan | None = None,
        solver: Solver | None = None,
        static: bool = False,
        source: Source = Source.COMPILER,
    ) -> None:
        self.coordinates = coordinates
        self.system = coordinates.system
        self.settings, self.scheme, system = settings, scheme, self.system
        self._source = source
        self.plan = plan_of(coordinates, solver is not None) if plan is None else plan
        self.factorisations = 0
        self._drag_factor = 0.0
        self._factors = None
        self._solver = solver
        self._rest: Rest | None = None
        self._beams: list[dict[str, Any]] = []
        damped = is_viscous(system) or system.couplings.count > 0
        #: whether dampers act by the velocity at the end of a step
        self.late = scheme.at_end and damped and not static
        # how many iterations new factors cost, as measured; by sparse solvers they are kept longer
        worth = np.inf if len(self.plan.rest) else 5.0
        own = {"weight": weight, "length": system.length, "worth": worth, "viscous_work": 0.0}
        numbers = vars(settings) | self._numbers_of(scheme) | own
        self._all = (
            *self._bind(weight, scheme.ends, static),
            np.array([numbers[name] for name in NUMBERS], float),
        )
        self._a = a = SimpleNamespace(**self._arrays)
        self._laws = self._called_laws()
        #: whether Python functions of users are called
        self.calls_laws = bool(self._laws)
        self._evaluated = static or not system.dead_only or system.drag is not None
        self._moments = system.loading.moments
        self._followers = following(system)
        a.y0[system.rows :] = a.ground1[:] = system.ground(0.0)

    def _numbers_of(self, scheme: Scheme) -> dict[str, float]:
        """Numbers of a scheme by name, see :mod:`skfem_cosserat.compiled.numbers`.

        What a scheme with rates takes off the balance stands in place of the momentum.
        """
        decay = scheme.decay
        low, high = (0.5 * (1 - decay), 0.5 * (1 + decay)) if scheme.ends else (0.0, 1.0)
        return {
            "mass": scheme.mass,
            "momentum": 1.0 if scheme.before else scheme.momentum,
            "force": scheme.force,
            "share": scheme.at,
            "start": low,
            "end": high,
            "ends": float(scheme.ends),
            "reach": 1 / scheme.rate if self.late else 0.0,
            **dict(zip(("carry_mass", "carry_momentum", "carry_force"), scheme.carry, strict=True)),
        }

    def _called_laws(self) -> list[CalledLaws]:
        """Callbacks for stored energies that are not compiled for the kernels."""
        found = []
        for group, fields in zip(self.system.beam_groups, self._beams, strict=False):
            points = fields.get("law_points")
            if points is None:
                continue
            laws = np.flatnonzero(points["functions"][:, ENERGY] == 0).tolist()
            if laws:
                found.append(CalledLaws(group.elements, points, laws, self.scheme.ends))
        return found

    def complain(self) -> None:
        """Raise what could not be raised when compiled code called Python."""
        if self._rest is not None:
            self._rest.complain()
        for law in self._laws:
            law.complain()

    def _bind(self, weight: float, ends: bool, static: bool) -> Bound:
        """Addresses of the parts and structures for the kernels; arrays by name."""
        system = self.system
        viscous = not static and is_viscous(self.system)
        parts = self._parts(weight, ends or is_viscous(system), static)
        with kept.BINDING:
            s, self._tree = bind.bound_tree(self.coordinates, self.plan, "hold" in parts, static)
            m, planned = bind.bound_plan(self.coordinates, self.plan)
            separate = separate_parts(system) if self.scheme.relative else None
            w, self._arrays = bind.bound_work(self.coordinates, self.plan, self.late, separate)
            g, self._beams = bind.bound_groups(system, self.plan, viscous, self._source)
            own = parts, (s, m, w, g), self._source
            with bind.compiling(self.coordinates, self._arrays, *own):
                table = bind.addresses(*own)
        if len(self.plan.rest):
            A = self._arrays["A"]
            x = self._arrays["x"]
            self._rest = Rest(self.plan, planned["size"], A, x, self._solver)
            planned["rest"][1] = self._rest.address
        self._number()
        return table, s, m, w, g

    def _parts(self, weight: float, ends: bool, static: bool) -> list[str]:
        """Names of the parts that are called."""
        return bind.parts_of(self.coordinates, weight, ends, static, self.scheme.relative)

    def _number(self) -> None:
        """Set the places of the tree's coordinates among those of the vertices."""
        own = self.coordinates.tree.own
        kin = self.coordinates.kinematics
        vertex = kin.vertex[: kin.unknowns]
        first = np.array([numbers.start for numbers in own])
        self._numbering = 6 * vertex + np.arange(len(vertex)) - first[vertex]

    @property
    def linear(self) -> LinearSolver | None:
        """Sparse solver for vertices that elimination in blocks leaves; None: it leaves none."""
        return None if self._rest is None else self._rest.solver

    @property
    def method(self) -> str:
        """Name of the method that solves linear systems."""
        return "blocks" if self._rest is None else f"blocks, {self._rest.solver.method}"

    def _place(self, q: Floats, ground: tuple[Floats, Floats] | None) -> None:
        """Set the start of a step: q (n,), and the ground's rows at both ends if they move."""
        system = self.system
        a = self._a
        a.y0[: system.rows] = q.reshape(-1, 3)
        if ground is not None:
            a.y0[system.rows :], a.ground1[:] = ground

    def load(self, amplitudes: Floats) -> None:
        """Take these factors of the loads' channels."""
        a = self._a
        factors = amplitudes.tolist()
        if factors == self._factors:  # a pulse that is over, most of the time
            return
        self._factors = factors
        self._dead = self.system.loading.dead_force(amplitudes)
        if self._evaluated:
            moments, followers, drag = self._moments, self._followers, self._drag_factor
            a.dead[:] = self._dead
            a.moments[:] = amplitudes[moments.channels, None] * moments.values
            each = np.append(amplitudes, drag)[followers.channels]
            a.followers[:] = each[:, None, None] * followers.values
        else:
            a.external[:] = self._dead


#: parts of a balance that a projection of velocities does without: forces, and what turns with them
NO_FORCES = {
    *("node_matrix", "joint_curvature"),
    *("beam_force", "beam_predicted", "load", "couple"),
}


class NearestVelocity(CompiledScene):
    """Velocities on the hidden constraints nearest to a momentum, in the kinetic energy.

    For scenes without closed loops and prescribed motion, also those in a plane.

    Parameters
    ----------
    system, settings, source
        As for :class:`CompiledScene`.
    """

    def __init__(
        self, system: System, settings: NewtonSettings, source: Source = Source.COMPILER
    ) -> None:
        scheme = Scheme(1.0, 1.0, 0.0, weight=1.0, rate=0.0, at=1.0)
        own_coordinates = system.joint_coordinates
        super().__init__(own_coordinates, scheme, 1.0, settings, static=True, source=source)
        self._projection = structure("projection", dict(zip(PROJECTION, self._all, strict=True)))
        own_kinds = self._projection.kind, int
        function = address("static", "nearest", own_kinds, source)
        #: for :func:`skfem_cosserat.compiled.bind.bound_carried`
        self.bound = function, self._projection.address, self._a.y0, self._a.p0, self._a.change

    @staticmethod
    def serves(system: System) -> bool:
        """True if a scene has neither closed loops nor prescribed motion."""
        return not (system.joint_coordinates.closure.rank or system.moving)

    def _parts(self, weight: float, ends: bool, static: bool) -> list[str]:
        """Names of the parts that are called, without those for forces."""
        return [name for name in super()._parts(weight, ends, static) if name not in NO_FORCES]

    def _called_laws(self) -> list[CalledLaws]:
        """No callbacks: a projection of velocities has no stresses."""
        return []


class Motion(NamedTuple):
    """Velocities and energies of one state, or of k of them, by :class:`CompiledMotion`.

    Attributes
    ----------
    v : (n,) or (k, n) array
        Velocities.
    kinetic : float or (k,) array
        Their kinetic energy (J).
    stored : float or (k,) array, or None
        Energy stored in beams (J); None: not known, as a section has a stored energy of its own.
    """

    v: Floats
    kinetic: Floats
    stored: Floats | None


class CompiledMotion(NearestVelocity):
    """Velocities of states, as of the base class, and their energies.

    Parameters
    ----------
    system, settings, source
        As for :class:`NearestVelocity`.
    """

    def __init__(
        self, system: System, settings: NewtonSettings, source: Source = Source.COMPILER
    ) -> None:
        super().__init__(system, settings, source)
        states = np.zeros((0, self.system.rows, 3))
        self._looked = dict.fromkeys(("q", "p", "v"), states) | {"energies": np.zeros((0, 2))}
        self._make_room(1 + TOGETHER // self.system.n)

    def _make_room(self, count: int) -> None:
        """For as many states that are looked at together."""
        self._looked = {
            name: np.zeros((count, *array.shape[1:])) for name, array in self._looked.items()
        }
        given = dict(zip(PROJECTION, self._all, strict=True)) | self._looked
        self._call = entry("static", "along", structure("looks", given), self._source)

    def __call__(self, q: Floats, p: Floats) -> Motion | None:
        """At configurations q for momenta p, (n,) or (k, n) each; None: singular at one of them."""
        count = q.size // self.system.n
        if count > len(self._looked["q"]):
            self._make_room(count)
        for name, given in (("q", q), ("p", p)):
            self._looked[name][:count] = given.reshape(count, -1, 3)
        if not self._call(count):
            return None
        v = self._looked["v"][:count].reshape(q.shape)
        energies = self._looked["energies"][:count]
        kinetic, stored = energies.T.reshape(2, *q.shape[:-1]).copy()
        return Motion(v.copy(), kinetic, None if self._lawful else stored)

    @property
    def _lawful(self) -> bool:
        """True if a section has a stored energy of its own, which need not be compiled."""
        return any(group.elements.stored for group in self.system.beam_groups)

    def _parts(self, weight: float, ends: bool, static: bool) -> list[str]:
        """Names of the parts that are called, with the energy of beams if kernels know it."""
        plain = bool(self.system.beam_groups) and not self._lawful
        return [*super()._parts(weight, ends, static), *(["beam_energy"] if plain else [])]


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
        self._couplings = couplings
        self._columns = columns
        self.resize(scheme, h)
        number = {id(item): k for k, item in enumerate(system.couplings.items)}
        self._angles = np.array([number[id(i)] for i in couplings.angles], np.int64)
        columns[self._angles, WINDS] = 1.0
        self._vectors = [
            (number[id(item)], item)
            for item in couplings.items
            if any(coordinate.kind == "rotation" for coordinate in item.coordinates)
        ]
        #: channels of actuators
        self.channels = len(couplings.times)
        # of each time of an actuator, in their order
        driven = [number[id(item)] for item in couplings.owners]
        places = [AMPLITUDE + driven[:k].count(c) for k, c in enumerate(driven)]
        self._driven = COUPLED * np.array(driven, np.int64) + np.array(places, np.int64)

    def resize(self, scheme: Scheme, h: float) -> None:
        """Take steps of another size (s)."""
        self._h, self._late = h, scheme.at_end and scheme.rate > 0  # not at rest
        # at its end the velocity is that along a way of its own
        self._columns[:, STEP] = 2 / scheme.rate if self._late else h

    @property
    def alike(self) -> bool:
        """True if steps differ in nothing but the state and known forces of actuators."""
        return not (self._vectors or (self._late and self._couplings.count))

    def turns_of(self, log: Floats) -> IndexArray:
        """Full turns (k, angles) of all angles, of k steps that were solved in one go."""
        return np.rint(log.take(self._angles, 1)).astype(np.int64)

    def begin(self, time: float) -> None:
        """Forces of actuators in a step that starts at a time (s)."""
        if self.channels:
            end = time + self._h
            couplings = self._couplings
            forces = couplings.values(end) if self._late else couplings.averages(time, end)
            self.drive(forces[:-1])

    def drive(self, forces: Floats) -> None:
        """Take these of the actuators' channels."""
        self._columns.put(self._driven, forces)

    def turn(self, turns: IndexArray | None) -> None:
        """Take these full turns at the start of a step, as in a state."""
        count = len(self._angles)
        if count:
            own = None if turns is None else np.asarray(turns)[:count]  # then those of own laws
            self._couplings.check_turns(own)
            self._columns[self._angles, TURNS] = 0 if own is None else own

    def look(self, time: float) -> None:
        """Warn of a rotation vector that passed a turn of pi, where it jumps."""
        for k, item in self._vectors:
            if self._columns[k, TURNED] > np.pi:
                warn_of_jump(item, time)


# -- steps: the same iteration as that of the stepper, in a few compiled calls ---------------------


#: most steps in one go: for less than a second, as Ctrl-C waits for them
STRIDE = 128


class CompiledStep(CompiledScene):
    """Steps of one system, integrator and step size, compiled.

    Parameters
    ----------
    integrator : Integrator
    h : float
        Step size (s).
    coordinates, settings, plan, solver, source
        As for :class:`CompiledScene`. Of a scene in a plane, rounding that leads out of it is taken
        away after each step.
    """

    def __init__(
        self,
        coordinates: Coordinates,
        integrator: Integrator,
        h: float,
        settings: NewtonSettings,
        plan: Plan | None = None,
        solver: Solver | None = None,
        source: Source = Source.COMPILER,
    ) -> None:
        scheme = integrator.scheme(h)
        system = coordinates.system
        assert isinstance(scheme, Scheme)
        own = coordinates, scheme, scheme.weight, settings, plan, solver
        super().__init__(*own, source=source)
        self.integrator = integrator
        self.h = h
        self._normal = None if system.plane is None else system.plane.normal
        #: whether the unknowns are others than the treatment's
        others = coordinates is not system.joint_coordinates or len(system.held_rows) > 0
        self._others = system.plane is not None or others
        self._record = np.zeros(len(RECORD))
        self._failed: tuple[float, Exception] | None = None  # a function, in a step to come
        self._nearest = None
        if scheme.moved and system.m and NearestVelocity.serves(system):
            self._nearest = NearestVelocity(system, settings, source)
        self._viscous = [fields for fields in self._beams if "viscosity" in fields]
        self._moves = bool(scheme.moved) and system.m > 0
        counts = len(scheme.table), len(scheme.before), len(scheme.moved) * self._moves
        #: most steps in one go
        self.most = max(1, min(STRIDE, TOGETHER // max(1, system.n)))
        nearest = None if self._nearest is None else self._nearest.bound
        viscous = self._viscous[0]["all_numbers"] if self._viscous else None
        self._carried, arrays = bind.bound_carried(
            coordinates, self._arrays, counts, nearest, self._normal, self.most, viscous
        )
        self._o = SimpleNamespace(**arrays)
        self._set_rates(scheme)
        self._couple(scheme, h)
        self._resist(h)
        self._rows = np.zeros(0, np.int64)
        #: whether there are closed loops, whose independent rows are chosen on the way
        self.looped = len(coordinates.closure.rows) > 0
        bind.choose_rows(coordinates, self._tree, self._rows)
        self._record[CLEARANCE] = 0.0 if self.looped else np.inf
        # how far coordinates went since rows of closed loops were chosen, and in the last step
        self._travelled = self._travel = self._farthest = np.inf
        #: whether nothing changes from step to step but the state, where loads do not
        self._alike = not (
            (system.moving and scheme.at_end)
            or not self._coupled.alike
            or self._called_back is not None
            or system.drag is not None
            or (self._viscous and scheme.at_end)
            or self._rest is not None
            or (self._moves and self._nearest is None)
            or (scheme.at_end and not system.dead_only)
            or scheme.decay
            or (integrator.loses and 0 < scheme.weight < 1)  # forces at states take more than means
        )
        self._solve = self._entry()

    def _set_rates(self, scheme: Scheme) -> None:
        """Numbers of the scheme that its rates take, and the size of terms of momenta."""
        o = self._o
        if self._normal is not None:
            system = self.system
            h = abs(self.h)
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
        """Force elements; those of own laws are called back."""
        system = self.system
        inside = self.system.couplings
        if inside.own:
            inside = system.couplings_of(inside.items)
        self._coupled: Coupled = Coupled(system, inside, self._a.coupled, scheme, h)
        self._next = Called(self._go_on)
        self._all[0][NEXT_LOADS] = self._next.address
        self._called_forces = CalledForces(
            system, self._tree, self._a.coupled, scheme, len(inside.angles)
        )
        self._called_back: CalledBack | None = None
        if system.couplings.without_kernels:
            self._called_back = CalledBack(system, self.plan, self._a)
            self._all[0][CALLED_BACK] = self._called_back.address

    def _go_on(self, k: int) -> bool:
        """Start the k-th step after the first one that is solved in one go; False: not there."""
        self._load_at(*self._times[k : k + 2])
        return self._called_forces.go_on(self._times[k])

    def _resist(self, h: float) -> None:
        """Drag and viscous sections in steps of this size."""
        # a velocity is 2 (y_mid - y_0)/h, or as long at the end of a step as another way takes: a
        # force that follows, and a dead one
        way = 2 / self.scheme.rate if self.scheme.at_end else h
        self._drag_factor = -2 / way
        self._loaded = False
        self._o.size[:] = h
        # stresses eta (eps_1 - eps_0)/h as those of elements of the stiffness 2 eta/h, which take
        # the difference of both ends of a way, not a mean of them, and have no mass
        for fields in self._viscous:
            fields["numbers"][:] = self._all[-1]
            fields["numbers"][[MASS, START, END, ENDS]] = 0.0, -0.5, 0.5, 1.0
            fields["stiffness"][:] = (2 / way) * fields["viscosity"]

    def _entry(self) -> Callable[[], float]:
        """The compiled loop for these structures."""
        given = dict(zip(STEPS, (*self._all, self._record, self._carried), strict=True))
        return entry("step", "solve", structure("steps", given), self._source)

    def resized(self, h: float) -> CompiledStep:
        """Take steps of another size (s) from now on; factors of matrices are not kept."""
        scheme = self.integrator.scheme(h)
        assert isinstance(scheme, Scheme)
        for name, number in self._numbers_of(scheme).items():
            self._all[-1][NUMBERS.index(name)] = number
        self._a.last *= h / self.h  # to begin with: impulses of rows, too
        known = min(self._record[KNOWN], 1.0)
        self._record[[KNOWN, GUESS, KEPT]] = known, known, 0.0
        self.h, self.scheme, self._factors = h, scheme, None
        self._set_rates(scheme)
        self._coupled.resize(scheme, h)
        self._resist(h)
        return self

    def close(self, rows: IndexArray) -> None:
        """Take these constraint rows, independent at the start of the step, to close the loops."""
        rows = np.sort(rows)
        self._travelled = 0.0
        if not np.array_equal(rows, self._rows):
            self._rows = rows
            bind.choose_rows(self.coordinates, self._tree, rows)
            self._record[KEPT] = 0.0
            off = self._tree["row_on"] == 0
            count = len(self.system.origin_rows)
            for known in (self._a.last, self._a.before):  # no step begins with their impulses
                known[count:, : off.shape[1]][off] = 0.0

    def due(self, state: State, bound: BoundTreatment) -> bool:
        """True if the treatment, which knows what is singular, has to choose rows for the loops.

        It has to from another state than the last; or after a motion of length `clearance`, if the
        chosen rows have come too close to each other, too.
        """
        if not np.isfinite(self._travelled):
            return True
        # as bytes: this is asked in each step, and comparing arrays takes longer
        if state.q.tobytes() != self._a.y1[: self.system.rows].tobytes():
            return True
        if self._travelled >= bound.clearance:
            if not bound.clear(self._a.y1):
                return True
            self._travelled = self._farthest  # a step may jump over a singular position
        self._record[CLEARANCE] = bound.clearance  # the look may have changed it
        return self._travelled >= bound.clearance

    @property
    def last(self) -> Any:
        """Increments of the last step, as the treatment keeps them; None before the first step.

        None, too, where the unknowns are others: with multipliers, or of a plane in space.
        """
        if self._others:
            return None
        return self._a.last.ravel()[self._numbering] if self._record[KNOWN] else None

    def resume(self, last: Any) -> None:
        """Take the last increments of another step for the first guess; None: none are known."""
        last = None if self._others else last
        self._record[KNOWN] = self._record[GUESS] = float(last is not None)
        if last is not None:
            self._a.last.ravel()[self._numbering] = np.real(last)

    def _begin(self, state: State, end: float) -> None:
        """Loads, prescribed motion and all that is fixed during a step."""
        system, t, scheme = self.system, state.time, self.scheme
        self._place(state.q, None)
        self._coupled.turn(state.turns)
        self._grounds: list[Floats] = []
        self._load_at(t, end)
        moving = bool(system.moving)
        self.rates0 = self.integrator.start(system, state, self.h) if scheme.table else None
        if system.drag is not None:
            known = self._drag_factor * state.q
            if scheme.at_end and self.rates0 is not None and scheme.rates:
                known += self._of_drift @ self.rates0.reshape(len(self._of_drift), -1)
            self._a.dead[:] = self._dead - system.drag @ known.reshape(-1, 3)
        if self.late and moving:
            rows = system.rows
            a = self._a
            way = scheme.rate * (a.ground1 - a.y0[rows:])
            a.drift[rows:] = system.ground_rate(t + self.h) - way
        self._a.p0[:] = state.p.reshape(-1, 3)
        if self.rates0 is not None:
            self._o.rates[:] = self.rates0.reshape(-1, 3)
        self._called_forces.begin(state.turns, t, self.h)
        if self._called_back is not None:
            self._called_back.begin(state, self.h, scheme, self.rates0)

    def _load_at(self, time: float, end: float) -> None:
        """Loads, actuators and the ground in a step between two times (s)."""
        loading, rows, a = self.system.loading, self.system.rows, self._a
        if self._failed is not None and self._failed[0] == time:
            error = self._failed[1]
            self._failed = None
            raise error
        if not (self._loaded and loading.constant):
            after = time + self.h
            at_end = self.scheme.at_end
            self.load(loading.values(after) if at_end else loading.averages(time, after))
            self._loaded = True
        self._coupled.begin(time)
        if self.system.moving:  # exactly: it may jump there
            a.y0[rows:] = self.system.ground(time)
            a.ground1[:] = self.system.ground(end)
            self._grounds.append(a.ground1.copy())

    def takes_blocks(self, time: float) -> bool:
        """True if steps from this time (s) on can be solved in one go, several at a time."""
        changing = self.scheme.at_end and self._varies(time)
        # laws of users may fail at states that do not come
        return self._alike and not (changing or self.calls_laws)

    def _varies(self, time: float) -> bool:
        """True if loads, forces of actuators or the ground may change after this time (s)."""
        loading = self.system.loading
        constant = loading.constant or time >= loading.constant_after
        return not (constant and self.system.couplings.constant and not self.system.moving)

    def advance(self, state: State, times: Floats, origin: StepOrigin) -> Block | None:
        """Steps that end at these times (s), solved in one go; None if the first is not solved.

        Fewer, where something has to be looked at; one, where no more are taken.
        """
        record = self._record
        self._times = [state.time, *times.tolist()]
        varies = self._varies(state.time)
        record[VARYING] = varies or bool(self.system.couplings.called)
        solved = self._solved(state, len(times))
        done = int(record[DONE])
        n = self.system.n
        if not done:
            return None
        a = self._a
        o = self._o
        logged = o.log_numbers[:done]
        moving = bool(self._grounds)
        block = Block(
            self.system,
            self.integrator,
            state,
            origin,
            times[:done],
            np.full(done, self.h),
            o.log_q[:done].reshape(done, n).copy(),
            o.log_p[:done].reshape(done, n).copy(),
            o.log_rates[:done].reshape(done, len(o.table), n).copy(),
            self._turns(done),
            np.array(self._grounds[:done]) if moving else a.ground1[None].repeat(done, 0),
            o.log_impulse[:done].reshape(done, n).copy(),
            logged[:, 0].astype(np.int64),
            np.ones(done, np.int64),
            logged[:, 1].copy(),
            logged[:, 2:].copy(),
            stuck=not solved,
        )
        plain = self._alike and not (varies and self.scheme.at_end)
        if not plain or record[UNMOVED]:
            self._complete(block, state, plain)
        return block

    def _turns(self, done: int) -> IndexArray:
        """Full turns and memories (k, numbers) of k steps; with laws called back of one."""
        found = [self._coupled.turns_of(self._o.log_turns[:done])]
        if self._called_forces.couplings.angles:
            found.append(self._called_forces.turns(done))
        own = None if self._called_back is None else self._called_back.turns()
        return np.hstack(found if own is None else [*found, own[None]])

    def _complete(self, block: Block, state: State, plain: bool) -> None:
        """Add what kernels leave of the last step: works, unless `plain`, and velocities."""
        rows, a, moved = self.system.rows, self._a, bool(self._record[UNMOVED])
        self._coupled.look(float(block.times[-1]))
        y1 = a.y1.copy()
        dq = (a.y1 - a.y0)[:rows]
        work = StepWork(*block.works[-1].tolist())
        if not plain:
            work = self._work(state, work, dq)
        if moved:
            p = block.p[-1].reshape(rows, 3)
            rates = block.rates[-1].reshape(-1, rows, 3)
            rates0 = self._o.rates.reshape(rates.shape).copy()
            balance = self.integrator.balance(self.system, self.h)
            instant = self._times[len(block) - 1] + self.h  # as plain numpy has it
            done = balance.handed_on(y1, dq, p, rates0, rates, work, instant)
            assert done.rates is not None
            block.p[-1] = done.momentum.ravel()
            block.rates[-1] = done.rates.reshape(len(rates), -1)
            if done.impulse is not None:
                block.impulse[-1] += done.impulse.ravel()
            work = done.work
        block.works[-1] = work

    def _solved(self, state: State, steps: int) -> bool:
        """Solve up to so many steps; whether the last one tried was solved."""
        self._begin(state, self._times[1])
        record = self._record
        a = self._a
        record[ASKED] = steps
        record[TRAVELLED] = self._travelled
        known = self.looped and record[KNOWN] > 0.0
        solved = self._solve() != 0.0
        self.factorisations += int(record[ALL_FACTORED])
        self.complain()
        if isinstance(self._next.error, Exception):  # kept for the step itself
            self._failed = (self._times[int(record[DONE])], self._next.error)
            solved = True
            self._next.error = None
        if isinstance(self._called_forces.error, Exception):
            self._called_forces.error = None  # the step itself will tell it
        for called in (self._next, self._called_forces, self._called_back):
            if called is not None:
                called.complain()
        if self.looped:
            self._farthest, self._travel, _ = a.found.tolist()
            self._travelled = float(record[TRAVELLED])
        if solved and (self.looped or record[FACTORED] > SHORT) and self._flipped():
            # the last step is left to the general way: not solved
            known = known or (self.looped and record[DONE] > 1)  # what the one before left
            self.resume(a.before.ravel()[self._numbering] if known else None)
            record[KEPT] = 0.0
            record[DONE] -= 1
            solved = False
        if not solved:
            self._travelled = np.inf
        return solved

    def _flipped(self) -> bool:
        """True if a frame has turned by half a turn, with loops or with forces at the midpoint."""
        if self.looped and self._travel < SHORT_WAY:
            return False
        middle = 0.0 < self.scheme.weight < 1.0
        return bool((self.looped or middle) and half_turn(self.system, self._a.y0, self._a.y1))

    @property
    def missed(self) -> float:
        """Largest gap of the dependent rows of closed loops, relative to their terms."""
        return float(self._a.found[2])

    @property
    def y1(self) -> Floats:
        """All rows (total, 3) at the end of the step."""
        return self._a.y1.copy()

    def _work(self, state: State, known: StepWork, dq: Floats) -> StepWork:
        """Work of a step that no block has, beside what kernels know of it."""
        system = self.system
        scheme = self.scheme
        if scheme.at_end:
            loading = system.loading
            same = loading.constant or state.time >= loading.constant_after
            if same and system.dead_only and not (self.late or system.drag is not None):
                return known
            # by the trapezoidal rule
            balance = self.integrator.balance(system, self.h)
            step = balance.begin(state, end=self._times[1])
            return balance.work(step, balance.evaluate(step, self.y1))
        loads, actuators, lost, ground, numerical = known
        if system.drag is not None:  # it is among the loads of the kernels
            own = float(((system.drag @ dq) * dq).sum()) / self.h
            # a step back, as composed ones have, gives what was lost
            loads = loads + own
            lost = lost + self.h * max(0.0, own / self.h)
        if scheme.decay:
            ends = self._a.y0, self._a.y1
            strains = [[eps for eps, _ in system.strain(y)] for y in ends]
            own = decay_work(system, scheme.decay, *strains)
            lost = lost + own
            numerical = numerical + own
        if self._called_back is not None:
            done = self._called_back.work()
            loads = loads + done.loads
            ground = ground + done.ground
        return StepWork(loads, actuators, lost, ground, numerical)


# -- which scene compiled steps take ---------------------------------------------------------------


def kernel_coordinates(system: System, treatment: Treatment) -> Coordinates:
    """Coordinates that kernels have: with multipliers of vertices, else along all joints."""
    if isinstance(treatment, Multipliers):
        return system.vertex_coordinates
    return system.joint_coordinates
