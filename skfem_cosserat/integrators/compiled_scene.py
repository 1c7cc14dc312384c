"""One system for compiled kernels: its arrays and parts, and what solves for the rest."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from ..compiled import bind, kept
from ..compiled.kept import Source, address, entry
from ..compiled.numbers import ENERGY, NUMBERS
from ..compiled.plan import Plan, following, plan_of
from ..compiled.structures import PROJECTION, structure
from ..linear import LinearSolver, SingularMatrixError, Solver
from ..model import System
from ..model.parts import separate_parts
from ..model.quadratic import TOGETHER
from ..model.system import Coordinates
from ..newton import NewtonSettings
from ..pattern import FrozenPattern
from ..types import Floats, IndexArray
from .called_back import Called, CalledLaws
from .scheme import Scheme


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
        left = np.zeros(len(size), dtype=bool)
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
        self._take = np.empty(pattern.nnz, dtype=np.int64)  # every entry is in one place only
        self._take[pattern.slot] = places
        self._numbers = (6 * np.arange(len(size))[:, None] + k)[k < each[:, None]]
        self._A, self._x = A.reshape(-1), x.reshape(-1)
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
        self.coordinates, self.system = coordinates, coordinates.system
        self.settings, self.scheme, system = settings, scheme, self.system
        self._source = source
        self.plan = plan_of(coordinates, solver is not None) if plan is None else plan
        self.factorisations = 0
        self._drag_factor = 0.0
        self._factors: list[float] | None = None
        self._solver = solver
        self._rest: Rest | None = None
        self._beams: list[dict[str, Any]] = []
        damped = is_viscous(system) or len(system.couplings.items) > 0
        #: whether dampers act by the velocity at the end of a step
        self.late = scheme.at_end and damped and not static
        # how many iterations new factors cost, as measured; by sparse solvers they are kept longer
        worth = np.inf if len(self.plan.rest) else 5.0
        own = {"weight": weight, "length": system.length, "worth": worth, "viscous_work": 0.0}
        numbers = vars(settings) | self._numbers_of(scheme) | own
        self._all = (
            *self._bind(weight, scheme.ends, static),
            np.array([numbers[name] for name in NUMBERS], dtype=float),
        )
        self._a = a = SimpleNamespace(**self._arrays)
        self._laws = self._called_laws()
        #: whether Python functions of users are called
        self.calls_laws = bool(self._laws)
        self._evaluated = static or not system.loading.dead_only or system.drag is not None
        self._moments, self._followers = system.loading.moments, following(system)
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
        system, viscous = self.system, not static and is_viscous(self.system)
        parts = self._parts(weight, ends or is_viscous(system), static)
        with kept.BINDING:
            s, self._tree = bind.bound_tree(self.coordinates, self.plan)
            m, planned = bind.bound_plan(self.coordinates, self.plan)
            separate = separate_parts(system) if self.scheme.relative else None
            w, self._arrays = bind.bound_work(self.coordinates, self.plan, self.late, separate)
            g, self._beams = bind.bound_groups(system, self.plan, viscous, self._source)
            own = parts, (s, m, w, g), self._source
            with bind.compiling(self.coordinates, self._arrays, *own):
                table = bind.addresses(*own)
        if len(self.plan.rest):
            A, x = self._arrays["A"], self._arrays["x"]
            self._rest = Rest(self.plan, planned["size"], A, x, self._solver)
            planned["rest"][1] = self._rest.address
        self._number()
        return table, s, m, w, g

    def _parts(self, weight: float, ends: bool, static: bool) -> list[str]:
        """Names of the parts that are called."""
        return bind.parts_of(self.coordinates, weight, ends, static, self.scheme.relative)

    def _number(self) -> None:
        """Set the places of the tree's coordinates among those of the vertices."""
        own, kin = self.coordinates.tree.own, self.coordinates.kinematics
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
        system, a = self.system, self._a
        a.y0[: system.rows] = q.reshape(-1, 3)
        if ground is not None:
            a.y0[system.rows :], a.ground1[:] = ground

    def load(self, amplitudes: Floats) -> None:
        """Take these factors of the loads' channels."""
        a, factors = self._a, amplitudes.tolist()
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
        own = dict(zip(PROJECTION, self._all, strict=True))
        self._projection = structure("projection", own)
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
        v, energies = self._looked["v"][:count].reshape(q.shape), self._looked["energies"][:count]
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
