"""Runs on one mesh and on a finer one, states carried between them, and what is looked at."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, TypeAlias

import numpy as np

from ..accuracy.reading import Quantity
from ..beam import Beam
from ..constraints import NullSpace, Treatment
from ..diagnostics import Projection, goal_shares, missing_strains, momentum
from ..diagnostics.error import beam_of, new_rows, spins, transfer
from ..diagnostics.nearest import nearest_configuration, settled
from ..errors import Diverged, HistoryError, InputError
from ..frames import is_beam
from ..history import History
from ..integrators import Integrator, State
from ..linear import SingularMatrixError
from ..model import Model, System, system_of
from ..model.balance import amplitudes_at, balance
from ..run import simulate
from ..run.describe import describe, other_model
from ..run.start import checked_start
from ..statics import Control, LoadControl, Point, equilibrium, static
from ..statics.control import Stage
from ..statics.schedule import Functional, recorded_amplitudes
from ..types import ArrayLike, Floats, VectorLike, check_kind, names_known, numbers, positive
from ..warn import logger

# -- quantities of interest: what a mesh is refined for --------------------------------------------

#: Function of a system and a configuration (n,): a number, or a row of numbers of one unit.
OfConfiguration: TypeAlias = Callable[[System, Floats], ArrayLike]

#: step of difference quotients, relative to the extent of the scene for positions
SMALL = 1e-5


@dataclass(frozen=True)
class NodePosition:
    """Where a named node of a beam is (m).

    Parameters
    ----------
    beam : str
        Name of the beam in the model.
    node : str
        Name of the node in its mesh.
    direction : (3,) array, optional
        Only the component along it; default: all three.

    Raises
    ------
    InputError
        When asked, if the system has no such beam.
    MeshError
        If its mesh has no such node.

    Examples
    --------
    >>> from skfem_cosserat import Model, MeshCurve, Section
    >>> section = Section([1e4, 1e4, 1e4, 500, 500, 500], mass=1.0, inertia=(10.0, 10.0))
    >>> model = Model()
    >>> mesh = MeshCurve.init_line((0, 0, 0), (0, 2, 0), 4, name="rod")
    >>> rod = model.add("boom", Beam(mesh, section))
    >>> system = model.freeze()
    >>> NodePosition("boom", "rod.end")(system, system.q0).tolist()
    [0.0, 2.0, 0.0]
    """

    beam: str
    node: str
    direction: VectorLike | None = None

    def __call__(self, system: System, q: Floats) -> Floats:
        """The position (3,), or one component (1,)."""
        beams = {item.name: item for item in system.structures if isinstance(item, Beam)}
        if self.beam not in beams:
            known = names_known(self.beam, sorted(map(str, beams)))
            raise InputError("quantity", f"unknown beam {self.beam!r}; {known}")
        at = system.offset(beams[self.beam].node(self.node))
        x = np.asarray(q, dtype=float)[at : at + 3]
        return x if self.direction is None else np.array([x @ np.asarray(self.direction)])


def gradient(quantity: OfConfiguration, system: System, q: Floats, along: Floats) -> Floats:
    """Derivative (n,) of the component of a quantity along a vector (k,), by differences.

    Central ones, coordinate by coordinate: their error is of second order, far below the parts of
    a sum of shares that matter.
    """
    out, wanted = np.empty(system.n), Quantity("value", quantity)
    steps = np.full((system.rows, 3), SMALL)
    steps[system.origin_rows] *= system.length
    moved = np.array(q, dtype=float)
    for k, h in enumerate(steps.ravel()):
        ends = []
        for sign in (1.0, -1.0):
            moved[k] = q[k] + sign * h
            ends.append(along @ wanted.at(system, moved))
        moved[k] = q[k]
        out[k] = (ends[0] - ends[1]) / (2 * h)
    return out


# -- states and histories carried over to a system of the same scene on other meshes ---------------

#: meta data that tell of the run and not of the system
_RUN = (
    *("integrator", "treatment", "step", "status", "parameter", "time", "loads"),
    *("kernels", "solver"),
)
#: series that no mesh has a part in, beside those whose names begin with one of _ITEMS
_KEPT = (
    *("t", "step", "load_factor", "unstable", "critical", "turns"),
    *("newton_iterations", "attempts", "residual"),
    *("work_loads", "work_actuators", "work_drives", "dissipated", "work_ground"),
)
_ITEMS = ("joint/", "coupling/", "amplitudes/")


def carry_state(source: Model | System, target: Model | System, state: State) -> State:
    """A state of one system in another one with other meshes, orders or theories of its beams.

    Configuration and velocity go over by :func:`skfem_cosserat.diagnostics.transfer`: nodes that
    are in both systems keep them. New nodes are then brought into balance between those, with the
    loads and accelerations of that instant: left where they were interpolated, stiff motions
    (shear, extension) would get energy of their own.

    Where beams of `target` hold strains (:class:`skfem_cosserat.Theory`) it is the nearest
    configuration without these, the one that changes the other strains least, and the nearest
    velocity in the kinetic energy; the centre of mass and the linear momentum of a scene in free
    flight stay what they are. What `source` holds and `target` does not starts without strain:
    its forces, which were multipliers, have to build up anew, and vibrations with them. Begin such
    runs where these forces are small, or damp them.

    Parameters
    ----------
    source, target : Model or System
        Of the same scene, see :meth:`skfem_cosserat.Beam.refined`; with any theories.
    state : State
        Of `source`.

    Returns
    -------
    State
        Of `target`, for a run or a path that goes on from there. Its momentum is that of the
        velocity on the hidden constraints.

    Raises
    ------
    InputError, MeshError
        If the systems do not belong together, or a beam is bent, drawn or twisted too far for what
        it is to hold: named with both theories.

    Examples
    --------
    >>> from skfem_cosserat import Beam, MeshCurve, Model, Section, initial_state
    >>> section = Section([1e4, 1e4, 1e4, 500, 500, 500], mass=1.0, inertia=(10.0, 10.0))
    >>> beam = Beam(MeshCurve.init_line((0, 0, 0), (0, 2, 0), 4), section, velocity=(3.0, 0, 0))
    >>> systems = []
    >>> for item in (beam.refined([3]), beam):
    ...     model = Model()
    ...     rod = model.add("rod", item)
    ...     systems.append(model.freeze())
    >>> fine, coarse = systems
    >>> state = carry_state(coarse, fine, initial_state(coarse))
    >>> bool(abs(state.p - initial_state(fine).p).max() < 1e-12)
    True
    """
    source = system_of(source, "argument source")
    target = system_of(target, "argument target")
    checked_start(source, state)
    v = Projection(source)(state.q, state.p, state.time)[0]
    q, v = transfer(source, target, state.q, v)
    q, v = _settled(source, target, state.q, q, v, state.time)
    q, v = _held(source, target, q, v, state.time)
    p, factor = momentum(target, v), state.load_factor
    return State(state.time, state.index, q, p, True, state.turns, load_factor=factor)


def carry_history(source: Model | System, target: Model | System, history: History) -> History:
    """A history of one system as one of another system with refined meshes.

    All states go over, so that :func:`skfem_cosserat.restart`, :func:`skfem_cosserat.equilibrium`
    and exports take it for one of `target`: the last one, from which it goes on, as in
    :func:`carry_state`, those before it as they are interpolated. Reactions and
    coordinates of joints, works and times are kept as they were found; what belongs to the old
    mesh (strains, resultants, energies, multipliers of triads) is left out:
    :func:`skfem_cosserat.run.derive_series` gives energies and resultants anew.

    Parameters
    ----------
    source, target : Model or System
    history : History
        Of `source`: of a run or a path.

    Returns
    -------
    History
        Its ``meta["carried"]`` holds the counts of `source`.

    Raises
    ------
    HistoryError
        If the history is none of `source`.
    InputError, MeshError
        If the systems do not belong together.
    """
    source = system_of(source, "argument source")
    target = system_of(target, "argument target")
    check_kind("argument history", history, History)
    difference = other_model(source, history.meta.get("fingerprint", {}))
    if difference:
        raise HistoryError("history", f"belongs to another model: {difference}")
    times = history.instants
    v = Projection(source).velocities(history["q"], history["p"], times)
    q, v = transfer(source, target, history["q"], v)
    if len(history):
        t, last = float(times[-1]), history["q"][-1]
        if "load_factor" in history:  # loads may be those of a path: at rest
            y, rows = target.extend(q[-1], t), new_rows(source, target)
            y, _ = settled(target, y, recorded_amplitudes(history), rows)
            q[-1] = y[: target.rows].ravel()
        else:
            q[-1], v[-1] = _settled(source, target, last, q[-1], v[-1], t)
        q[-1], v[-1] = _held(source, target, q[-1], v[-1], t)
    p = momentum(target, v)
    count = len(history)
    meta, static = describe(target)
    meta |= {name: history.meta[name] for name in _RUN if name in history.meta}
    meta["carried"] = source.counts()
    series = {
        name: values
        for name, values in history.series.items()
        if name in _KEPT or name.startswith(_ITEMS)
    }
    nothing = np.full((count, target.n), np.nan)
    series |= {"q": q, "p": p, "carried": p, "fresh": np.ones(count), "constraint_force": nothing}
    return History(meta, static, series)


def _settled(
    source: System, target: System, before: Floats, q: Floats, v: Floats, t: float
) -> tuple[Floats, Floats]:
    """With new nodes in balance between the others, and turning as they did.

    Their accelerations are interpolated from those that the forces cause in `source` at `before`.
    """
    loads = amplitudes_at(source, t)
    R = balance(source, source.extend(before, t), loads).R.ravel()
    projection = Projection(source)
    a = projection(before, -R, t)[0] - projection(before, np.zeros(source.n), t)[0]
    inertia = momentum(target, transfer(source, target, before, a)[1])
    rows, y = new_rows(source, target), target.extend(q, t)
    rest, _ = settled(target, y, amplitudes_at(target, t), rows, inertia)
    rates = v.reshape(-1, 3).copy()
    spin = spins(y[rows], rates[rows])
    rates[rows[:, 1:]] = np.cross(spin[:, None], rest[rows[:, 1:]])
    return rest[: target.rows].ravel(), rates.ravel()


def _held(source: System, target: System, q: Floats, v: Floats, t: float) -> tuple[Floats, Floats]:
    """Without the strains that beams of the target hold.

    Raises
    ------
    InputError
        Naming a beam with its theories in both systems.
    """
    if not target.theory_rows:
        return q, v
    y = target.extend(q, t)
    found = nearest_configuration(target, y)
    if found is None:
        g = abs(target.constraints.values(y))
        worst = max(target.theory_rows, key=lambda rows: float(g[rows.rows].max()))
        known = {item.name: item.theory for item in source.structures if is_beam(item)}
        raise InputError(
            worst.beam.label,
            f"its state with {known[worst.beam.name]!r} cannot be carried over to"
            f" {worst.beam.theory!r}: no configuration near it is without the strains that this"
            " theory holds",
        )
    q = found[: target.rows].ravel()
    return q, Projection(target)(q, momentum(target, v), t)[0]


# -- what is solved on each mesh: an equilibrium, or a motion in time ------------------------------

#: states of a run, evenly spread, over which indicators are summed
LOOKS = 40


class Run(ABC):
    """A problem, whatever the mesh."""

    @abstractmethod
    def solve(self, system: System, before: tuple[System, History] | None) -> History:
        """The solution; `before` is that on another mesh, which may help."""

    @abstractmethod
    def states(self, history: History) -> Floats:
        """Configurations (T, n) at which the quantity is taken."""

    @abstractmethod
    def looks(self, history: History) -> Floats:
        """Configurations (N, n) over which indicators are summed."""

    def finer(self) -> tuple[Run, int] | None:
        """The same with half of the step that it holds, and its order; None if there is none."""
        return None

    def values(self, quantity: OfConfiguration, system: System, history: History) -> Floats:
        """The quantity (T, k)."""
        wanted = Quantity("value", quantity)
        return np.array([wanted.at(system, q) for q in self.states(history)])

    def shares(
        self,
        quantity: OfConfiguration,
        coarse: System,
        fine: System,
        rough: History,
        good: History,
        error: Floats,
    ) -> tuple[dict[str, Floats], str]:
        """Shares (ne,) of the elements of each beam in an error (T, k), and where from.

        By default in proportion to the energy that the richer elements store in what those of the
        coarse mesh leave out.
        """
        looks = self.looks(good)
        energies = {}
        for beam in (item for item in coarse.structures if isinstance(item, Beam)):
            richer = beam_of(fine, beam.name, beam.label)
            energies[str(beam.name)] = missing_strains(beam, fine, richer, looks)[:, 0]
        total = sum(float(e.sum()) for e in energies.values())
        size = float(np.linalg.norm(error, axis=1).max())
        return {k: size * e / (total or 1.0) for k, e in energies.items()}, "strains"


class _Here(Control):
    """A path of one point: the equilibrium next to a start, at its load factor."""

    parameter = "load_factor"
    turn = None
    all_points = True

    @property
    def expected(self) -> int:
        """See the base class."""
        return 1

    def stage(self, system: System, point: Point) -> Stage:
        """See the base class."""
        return _AtStart(point.t)


class _AtStart(Stage):
    def __init__(self, t: float) -> None:
        self.parameter, self.length, self.shortest, self.stops = t, 0.0, 0.0, []

    def functional(self, point: Point, length: float) -> Functional:
        """See the base class."""
        return Functional(None, 1.0, length)


@dataclass(frozen=True)
class RunStatic(Run):
    """The equilibrium at the end of a path; after the first mesh found from the one before.

    The error is shared among the elements by the adjoint solution,
    :func:`skfem_cosserat.diagnostics.goal_shares`.

    Parameters
    ----------
    control : Control or callable, optional
        Default: loads grow to load factor 1. A callable makes it for a system, as of a displacement
        of one of its places. Only with :class:`LoadControl` an equilibrium can be
        found from that on the mesh before; other paths are followed anew.
    treatment : Treatment, optional
        Default: ``NullSpace()``.
    options : mapping, optional
        Further arguments of :func:`skfem_cosserat.static`.
    """

    control: Control | Callable[[System], Control] = field(default_factory=LoadControl)
    treatment: Treatment = field(default_factory=NullSpace)
    options: Mapping[str, Any] = field(default_factory=lambda: {"watch": False})

    def __post_init__(self) -> None:
        if not isinstance(self.control, Control) and not callable(self.control):
            raise InputError("run", f"control = {self.control!r}, expected e.g. LoadControl()")

    def solve(self, system: System, before: tuple[System, History] | None) -> History:
        """See the base class."""
        options = {"derive": False, **self.options}
        if before is not None and isinstance(self.control, LoadControl):
            known = carry_history(before[0], system, before[1])
            start = equilibrium(system, known, time=float(known.instants[-1]))
            try:
                return static(system, self.treatment, _Here(), start=start, **options)
            except Diverged as error:
                logger.info("no equilibrium from the mesh before, the path anew: %s", error)
        control = self.control if isinstance(self.control, Control) else self.control(system)
        return static(system, self.treatment, control, **options)

    def states(self, history: History) -> Floats:
        """The last one."""
        return np.asarray(history["q"][-1:])

    def looks(self, history: History) -> Floats:
        """The last one."""
        return self.states(history)

    def shares(
        self,
        quantity: OfConfiguration,
        coarse: System,
        fine: System,
        rough: History,
        good: History,
        error: Floats,
    ) -> tuple[dict[str, Floats], str]:
        """See the base class; with their signs, if there is an adjoint solution."""
        size = float(np.linalg.norm(error))
        q = good["q"][-1]
        if size > 0:
            seen, _ = transfer(fine, coarse, q)
            slope = gradient(quantity, coarse, seen, error[0] / size)
            amplitudes = recorded_amplitudes(good)
            try:
                start, time = rough["q"][-1], float(good.instants[-1])
                found = goal_shares(coarse, fine, start, q, slope, amplitudes, time)
                return found, "adjoint"
            except SingularMatrixError as singular:
                logger.info("shares of elements by their strains: %s", singular)
        return super().shares(quantity, coarse, fine, rough, good, error)


@dataclass(frozen=True)
class RunInTime(Run):
    """A motion from rest or from the items' velocities; each mesh has the same steps.

    The error in space is shared among the elements by the energy of the strains they miss, mean
    over the run. That of the step is in all meshes alike: it is looked at once, at the end.

    Parameters
    ----------
    integrator : Integrator
    step, until : float
        (s)
    times : sequence of float, optional
        When the quantity is taken, at ends of steps (s); default: at the end.
    treatment : Treatment, optional
        Default: ``NullSpace()``.
    options : mapping, optional
        Further arguments of :func:`skfem_cosserat.simulate`.

    Raises
    ------
    InputError
        For a step or end that is not positive, or times that are no ends of steps of the run.
    """

    integrator: Integrator
    step: float
    until: float
    times: Sequence[float] | None = None
    treatment: Treatment = field(default_factory=NullSpace)
    options: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        positive("run", "step", self.step, " of seconds")
        positive("run", "until", self.until, " of seconds")
        wanted = self._wanted
        wrong = abs(wanted / self.step - np.rint(wanted / self.step)) > 1e-6
        wrong |= (wanted < 0) | (wanted > self.until * (1 + 1e-9))
        if wanted.ndim != 1 or not wanted.size or wrong.any():
            raise InputError(
                "run",
                f"times = {self.times!r}, expected ends of steps of {self.step!r} s from 0 to"
                f" {self.until!r} s",
            )

    def finer(self) -> tuple[Run, int]:
        """See the base class: at the same times."""
        half = replace(self, step=self.step / 2, times=self._wanted.tolist())
        return half, self.integrator.order

    @property
    def _wanted(self) -> Floats:
        end = self.step * np.floor(self.until / self.step * (1 + 1e-12) + 1e-9)
        return np.array([end]) if self.times is None else numbers("run", "times", self.times)

    def solve(self, system: System, before: tuple[System, History] | None) -> History:
        """See the base class; from the start, in any case."""
        count = int(np.rint(self._wanted.max() / self.step))
        looks = np.unique(np.linspace(0, count, min(count, LOOKS) + 1).round()) * self.step
        at = np.union1d(looks, self.step * np.rint(self._wanted / self.step))
        options = {"derive": False, "at": at.tolist(), **self.options}
        return simulate(system, self.integrator, self.treatment, self.step, self.until, **options)

    def states(self, history: History) -> Floats:
        """Those at the times."""
        rows = np.searchsorted(history.times, self._wanted - 0.5 * self.step)
        return np.asarray(history["q"][rows])

    def looks(self, history: History) -> Floats:
        """All recorded ones."""
        return np.asarray(history["q"])
