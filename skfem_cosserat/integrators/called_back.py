"""Callbacks from compiled steps to numpy, for what has no kernels of its own.

Compiled code calls a Python function at the stages of an iteration. Forces by own laws add
themselves to the rows of y, and their 3x3 blocks to those of the matrix. Sections give what the
functions of their stored energies do, unless these are compiled.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np

from ..compiled.numbers import (
    AT_BEGIN,
    AT_FORCE,
    AT_MATRIX,
    AT_PREDICTED,
    ENERGY_BY_LAW,
    FORCES_OF_LAWS,
    MODULI_BY_LAW,
    STEP,
    STRESSES_BY_LAW,
    TURNED,
    TURNS,
    WINDS,
    XI0,
)
from ..compiled.plan import Plan, places_of
from ..compiled.tables import DAMPING, FORCES, FOUND, NEUTRAL, SIGN, STIFFNESS
from ..kernels import BeamElements, skew
from ..model import System
from ..model.balance import Amplitudes
from ..model.force_elements import CoupledForce, CoupledStart, Couplings
from ..model.own_law import OwnLaw
from ..types import Array, Floats, IndexArray
from .scheme import Scheme, State, StepWork


def coupled(
    couplings: Couplings, scheme: Scheme, start: CoupledStart, y: Floats, y1: Floats, v: Floats
) -> CoupledForce:
    """Forces of springs and other force elements in a step of a scheme.

    Parameters
    ----------
    y, y1, v : (total, 3) array
        Configuration at which forces act, that at the end, and the velocity there.
    """
    if scheme.ends:
        return couplings.discrete(start, y, y1, scheme.decay)
    if scheme.at_end:
        return couplings.static(start, y1, v, scheme.rate)
    return couplings.midpoint(start, y, y1)


def trapezoidal_work(
    couplings: Couplings,
    starts: tuple[CoupledStart, CoupledStart],
    forces: tuple[CoupledForce, CoupledForce],
    y1: Floats,
    rows: int,
) -> StepWork:
    """Work of force elements in a step by the trapezoidal rule, without what dampers take.

    Parameters
    ----------
    starts, forces : two each
        With the actuators of both ends of the step, and the forces there.
    y1 : (total, 3) array
        Configuration at the end, whose first `rows` are unknowns.
    """
    change = y1 - starts[0].y0
    works = [couplings.work(at, forces[1], y1) for at in starts]
    ground = sum(force.force[rows:] for force in forces)
    return StepWork(
        0.5 * sum(force.work_of_loads(change) for force in forces),
        0.5 * sum(work.actuators for work in works),
        ground=0.5 * float((ground * change[rows:]).sum()),
    )


class Called:
    """A Python function that compiled code calls.

    Parameters
    ----------
    function : callable
        Of an integer, such as the stage of an iteration; what gives False is told as 0, else 1.
    failed : callable, optional
        What is done after an exception, which compiled code does not pass.

    Attributes
    ----------
    address : int
        Of ``double f(int64)``.
    """

    def __init__(
        self, function: Callable[[int], object], failed: Callable[[], None] | None = None
    ) -> None:
        self.error = None

        def called(stage: int) -> float:
            try:
                if self.error is None:
                    return float(function(stage) is not False)
            except BaseException as error:  # noqa: BLE001, it is raised after the step
                self.error = error
            if failed is not None:
                failed()
            return 0.0

        self._call = ctypes.PYFUNCTYPE(ctypes.c_double, ctypes.c_int64)(called)
        self.address = int(ctypes.cast(self._call, ctypes.c_void_p).value or 0)

    def complain(self) -> None:
        """Raise what could not be raised when compiled code called."""
        error, self.error = self.error, None
        if error is not None:
            raise error


class CalledLaws(Called):
    """Functions of stored energies that are not compiled, in compiled steps.

    Kernels make stresses of what they give, and the derivative of these; see
    :mod:`skfem_cosserat.compiled.laws`.

    Parameters
    ----------
    elements : BeamElements
    points : dict
        Arrays of its Gauss points, as :mod:`skfem_cosserat.compiled.bind` makes them.
    laws : sequence of int
        Numbers of the laws.
    ends : bool
        Whether stresses are discrete derivatives.
    """

    def __init__(
        self, elements: BeamElements, points: dict[str, Any], laws: Sequence[int], ends: bool
    ) -> None:
        stages = {
            ENERGY_BY_LAW: self._energy,
            STRESSES_BY_LAW: self._stresses,
            MODULI_BY_LAW: self._moduli,
        }
        super().__init__(lambda stage: stages[stage](), self._fail)
        self.ends = ends
        self._stored = [elements.stored[k] for k in laws]
        ne, ng = len(elements.lengths), len(elements.points)
        #: by elements and points
        self._arrays = SimpleNamespace(
            **{
                name: points[name].reshape(ne, ng, *shape)
                for name, shape in (
                    *dict.fromkeys(("start", "strains", "middle", "last"), (6,)).items(),
                    *dict.fromkeys(("before", "after", "along"), ()).items(),
                    ("moduli", (6, 6)),
                )
            }
        )
        points["called"][0] = self.address

    def _energy(self) -> None:
        a = self._arrays
        for ids, law in self._stored:
            a.before[ids] = law.energy(a.start[ids])

    @np.errstate(all="ignore")  # what is not finite is given up by the solver
    def _stresses(self) -> None:
        a = self._arrays
        for ids, law in self._stored:
            eps = a.strains[ids]
            if not self.ends:
                a.middle[ids] = law.stress(eps)
                continue
            eps0 = a.start[ids]
            a.middle[ids], a.along[ids] = law.beside(0.5 * (eps0 + eps), eps - eps0)
            a.after[ids] = law.energy(eps)

    @np.errstate(all="ignore")
    def _moduli(self) -> None:
        a = self._arrays
        for ids, law in self._stored:
            eps = a.strains[ids]
            if self.ends:
                a.moduli[ids] = law.tangent(0.5 * (a.start[ids] + eps))
                a.last[ids] = law.stress(eps)
            else:
                a.moduli[ids] = law.tangent(eps)

    def _fail(self) -> None:
        """Nothing is found with these."""
        for ids, _ in self._stored:
            self._arrays.middle[ids] = np.nan


def last_turns(own: Couplings, turns: IndexArray | None) -> IndexArray | None:
    """Full turns of the angles of own laws, the last ones of all that a state has."""
    return None if turns is None else np.asarray(turns)[len(turns) - len(own.angles) :]


class RowBlocks:
    """3x3 blocks at pairs of rows of y, added to the matrix of compiled steps.

    Parameters
    ----------
    system : System
    pairs : (k, 2) int array
        Rows (a, b) of y.
    plan : Plan
        Of the elimination: it numbers the blocks.
    arrays : namespace
        Arrays of the compiled steps: y1, A.
    """

    def __init__(
        self,
        system: System,
        pairs: IndexArray,
        plan: Plan,
        arrays: SimpleNamespace,
    ) -> None:
        self._pairs, self._arrays = pairs, arrays
        vertex, local = places_of(system)
        a, b = pairs.T
        slots = plan.slots(vertex[a], vertex[b])
        self._turned = np.flatnonzero(local[a] > 0), np.flatnonzero(local[b] > 0)
        local = np.minimum(local, 1)
        i = 3 * local[a][:, None, None] + np.arange(3)[:, None]
        j = 3 * local[b][:, None, None] + np.arange(3)
        self._entries = (6 * (6 * slots[:, None, None] + i) + j).ravel()

    def add(self, blocks: Floats, left: Floats) -> None:
        """Add derivatives (k, 3, 3) of the forces on rows a by rows b of y_1.

        Velocities of the rows a are those at the configuration `left`.
        """
        arrays = self._arrays
        (a, b), (turned, by) = self._pairs.T, self._turned
        blocks[turned] = skew(left[a[turned]]) @ blocks[turned]
        blocks[by] = blocks[by] @ -skew(arrays.y1[b[by]])
        np.add.at(arrays.A.reshape(-1), self._entries, blocks.ravel())


class CalledAtRest(Called):
    """Forces by own laws, and centrifugal forces, in compiled iterations at rest.

    Parameters
    ----------
    system : System
    spin : bool
        Whether everything is seen from a turning frame.
    plan, arrays
        See :class:`RowBlocks`; of the arrays also external.
    """

    def __init__(self, system: System, spin: bool, plan: Plan, arrays: SimpleNamespace) -> None:
        stages = {AT_FORCE: self._add_force, AT_MATRIX: self._add_blocks}
        super().__init__(lambda stage: stages[stage]() if stage in stages else None)
        self._system, self._arrays, self._spin = system, arrays, spin
        self._functions = system.couplings_of(system.couplings.own)
        self._mass = system.mass.tocoo()
        mass = np.stack([self._mass.row, self._mass.col], -1)[: self._mass.nnz * spin]
        self._blocks = RowBlocks(
            system, np.concatenate([self._functions.pairs, mass]), plan, arrays
        )

    def take(self, amplitudes: Amplitudes, turns: IndexArray | None) -> None:
        """Evaluate with these, and full turns of angles, from now on."""
        self._amplitudes = amplitudes
        y0 = self._arrays.y0.copy()
        self._start = self._functions.starting(
            y0, last_turns(self._functions, turns), np.zeros(1), 1.0, amplitudes.time
        )

    def _add_force(self) -> None:
        a, spin = self._arrays, self._amplitudes.spin
        self._found = self._functions.static(self._start, a.y1.copy())
        a.external[:] -= self._found.force[: self._system.rows]
        if spin is not None:
            a.external[:] += spin.centrifugal(self._system, a.y1)

    def _add_blocks(self) -> None:
        blocks, spin = self._functions.tangent(self._found, 1.0), self._amplitudes.spin
        if self._spin:
            square = np.zeros((3, 3)) if spin is None else spin.square
            blocks = np.concatenate([blocks, self._mass.data[:, None, None] * square])
        self._blocks.add(blocks, self._arrays.y1)


class CalledForces(Called):
    """Own laws of force elements whose coordinates kernels have, in compiled steps.

    Kernels leave coordinates in the table of laws, and take forces or their slopes from it.

    Parameters
    ----------
    system : System
    tree, columns : dict of arrays, and array
        The tables of force elements, and what they have in a step; see :mod:`..compiled.forces`.
    scheme : Scheme
    first : int
        Where their full turns and memories begin among those of a state.

    Attributes
    ----------
    couplings : Couplings
        Those of such laws, which may be none.
    """

    def __init__(
        self, system: System, tree: dict[str, Any], columns: Floats, scheme: Scheme, first: int
    ) -> None:
        super().__init__(self._find, self._fail)
        self._columns, self._scheme, self._laws = columns, scheme, tree["coupling_law"]
        called = system.couplings.called
        if called:
            tree["called"][0] = self.address
        self.couplings = system.couplings_of(called)
        number = {id(item): k for k, item in enumerate([*system.couplings.items, *called])}
        self._groups = [
            (g, np.array([number[id(m)] for m in g.members])) for g in self.couplings.groups
        ]
        for g, rows in self._groups:
            columns[rows, WINDS] = float(len(g.angles))
            self._laws[rows, NEUTRAL, SIGN, 1] = float(g.law.force_of_load)
        self._own = slice(first, first + len(self.couplings.angles))

    def begin(self, turns: Array | None, time: float, h: float) -> None:
        """Start a step of size h (s) from full turns and memories, as in a state."""
        self._h, self.error = h, None
        self._log: list[Array] = []
        self._start(None if turns is None else np.asarray(turns)[self._own], time)

    def go_on(self, time: float) -> bool:
        """Start the next step where the last one has ended; False: a law is due to be sampled."""
        turns = self._ended()
        self._log.append(turns)
        self._start(turns, time)
        return self.couplings.due(turns) > self._time

    def _start(self, turns: Array | None, time: float) -> None:
        self._time = time + (1.0 if self._scheme.at_end else 0.5) * self._h
        kept = self.couplings.kept(turns)
        self._memories = [memory for _, memory in kept]
        for (g, rows), (own, _) in zip(self._groups, kept, strict=True):
            if len(g.angles):
                self._columns[rows, TURNS] = own[:, 0]

    def _find(self, stage: int) -> None:
        t, ends = self._time, self._scheme.ends
        for (g, rows), memory in zip(self._groups, self._memories, strict=True):
            law, (e0, e1, e, change) = self._in_step(g, rows, memory)
            m, way = g.kind.size, self._columns[rows[0], STEP]
            if stage == FORCES_OF_LAWS:
                force = law.discrete(e0, e1, way, t)[0] if ends else law.force(e, change / way, t)
                self._laws[rows, NEUTRAL, FORCES, :m] = force
            elif ends:
                self._laws[rows, STIFFNESS, :m, :m] = law.discrete_slopes(e0, e1, way, t)
            else:
                by_e, by_rate = law.slopes(e, change / way, t)
                self._laws[rows, STIFFNESS, :m, :m] = by_e
                self._laws[rows, DAMPING, :m, :m] = by_rate

    def _in_step(self, g: Any, rows: IndexArray, memory: Floats) -> tuple[OwnLaw, list[Floats]]:
        """The law of a group in this step, and coordinates (c, m).

        These are at the start, at the end and where forces act; the last ones are their change.
        """
        m = g.kind.size
        start = self._columns[rows, XI0 : XI0 + m]
        end, at, change = self._laws[rows, NEUTRAL, FOUND : FOUND + 3, :m].swapaxes(0, 1)
        law = g.within(start, memory, 0.5 * self._h, self._scheme.at_end)
        return law, [*(g.stretch(each) for each in (start, end, at)), change]

    def _fail(self) -> None:
        """No step is found with these."""
        for _, rows in self._groups:
            self._laws[rows, NEUTRAL, FORCES] = np.nan

    def _ended(self) -> Array:
        """Full turns and memories at the end of a step."""
        out = [np.zeros(0)]
        for (g, rows), memory in zip(self._groups, self._memories, strict=True):
            out.append(np.rint(self._columns[rows, TURNED]).repeat(len(g.angles)))
            if memory.size:
                law, (e0, e1, e, _) = self._in_step(g, rows, memory)
                end = e if self._scheme.at_end else e1
                out.append(law.remembered(e0, end, self._time).ravel())
        return np.concatenate(out)

    def turns(self, done: int) -> Array:
        """Full turns and memories (k, numbers) at the ends of k steps."""
        if len(self._log) < done:
            self._log.append(self._ended())
        return np.reshape(self._log[:done], (done, -1))


class CalledBack(Called):
    """Forces by own laws whose coordinates kernels do not have, of a scene in compiled steps.

    Parameters
    ----------
    system : System
    plan : Plan
        Of the elimination: it numbers the blocks.
    arrays : namespace
        Arrays of the compiled steps: y0, y1, mid, internal, R_mixed, A.
    """

    def __init__(self, system: System, plan: Plan, arrays: SimpleNamespace) -> None:
        stages = {
            AT_BEGIN: lambda: None,
            AT_FORCE: self._add_force,
            AT_PREDICTED: self._add_predicted,
            AT_MATRIX: self._add_blocks,
        }
        super().__init__(lambda stage: stages[stage]())
        self._system, self._arrays = system, arrays
        self._couplings = system.couplings_of(system.couplings.without_kernels)
        self._blocks = RowBlocks(system, self._couplings.pairs, plan, arrays)

    def begin(self, state: State, h: float, scheme: Scheme, rates0: Floats | None) -> None:
        """Set the quantities that stay fixed in a step of size h (s) after a state."""
        system, couplings, end = self._system, self._couplings, state.time + h
        self._scheme, self.error, y0 = scheme, None, self._arrays.y0.copy()
        turns = last_turns(couplings, state.turns)
        if not scheme.at_end:
            self._start = couplings.begin(y0, turns, state.time, h)
            return
        own = couplings.values(end), 1.0, end, 0.5 * h, True
        self._start = couplings.starting(y0, turns, *own)
        #: what is known of the velocity at the end
        self._drift = np.zeros_like(y0)
        self._drift[system.rows :] = system.ground_rate(end)
        if scheme.rates:
            assert rates0 is not None
            self._drift[: system.rows] = np.tensordot(np.array(scheme.rates), rates0, 1)

    def _add_force(self) -> None:
        scheme, a, rows = self._scheme, self._arrays, self._system.rows
        y1 = v = a.y1.copy()
        if scheme.at_end:
            v = self._drift.copy()
            v[:rows] += scheme.rate * (y1 - a.y0)[:rows]
        self._found = coupled(self._couplings, scheme, self._start, a.mid.copy(), y1, v)
        a.internal[:] += self._found.force[:rows]

    def _add_predicted(self) -> None:
        self._arrays.R_mixed[:] += self._found.force[: self._system.rows]

    def _add_blocks(self) -> None:
        left = self._arrays.y0 if self._scheme.weight == 0 else self._arrays.mid
        self._blocks.add(self._couplings.tangent(self._found, self._scheme.force), left)

    def turns(self) -> IndexArray | None:
        """Full turns of the angles of own laws at the end of a step."""
        return self._couplings.turns(self._start, self._arrays.y1)

    def work(self) -> StepWork:
        """Work of the step evaluated last, by forces of its middle."""
        done = self._couplings.work(self._start, self._found, self._arrays.y1)
        return StepWork(done.loads, ground=done.ground)
