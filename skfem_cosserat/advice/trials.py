"""Trials of proposals: what they cost, how long they may take, what is looked at."""

from __future__ import annotations

import time
from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np

from ..accuracy.reading import Quantity, Reading
from ..adaptive import carry_state
from ..beam import Beam
from ..constraints import NullSpace
from ..diagnostics import highest_frequency, kinetic_energy, momentum, section_strains
from ..errors import CosseratError, Diverged, InputError
from ..frames import Place
from ..frozen import Replacements
from ..history import History
from ..integrators import EnergyMomentum, Integrator, State, StepReport
from ..kernels import beam_stress
from ..load import Load
from ..mesh import divided
from ..model import Model, System, planarity
from ..model.plane import Planar
from ..run import Sensor, derive_series, initial_state, simulate
from ..run.sensors import checked_sensors
from ..time_function import (
    Constant,
    Table,
)
from ..types import Floats, positive
from ..warn import Notices
from .proposals import BeamFull, BeamModel, Proposal

# -- what a pilot run tells of a scene: where its energy is, how fast it moves, where it bends -----

#: how the six strains are called, by energy
PARTS = {"shear": (0, 1), "axial": (2,), "bending": (3, 4), "torsion": (5,)}


@dataclass
class Pilot:
    """Numbers of a pilot run.

    Attributes
    ----------
    energy : dict of str to dict of str to float
        By beam: mean shear, axial, bending and torsion energy (J).
    kinetic : float
        Mean kinetic energy of the scene (J).
    bend : dict of str to float
        By beam: the largest angle it is bent or twisted by in all (rad).
    stretch : dict of str to float
        By beam: the largest shear or axial strain.
    jump : dict of str to float
        By beam: largest jump of curvature between elements, as a part of the largest curvature.
    frequency : float
        The highest natural frequency (rad/s).
    seen : dict of str to float
        By sensor: angular frequency of the largest peak of its spectrum (rad/s).
    constraint_force : float
        Largest force of constraints on a node or body (N).
    """

    energy: dict[str, dict[str, float]] = field(default_factory=dict)
    kinetic: float = 0.0
    bend: dict[str, float] = field(default_factory=dict)
    stretch: dict[str, float] = field(default_factory=dict)
    jump: dict[str, float] = field(default_factory=dict)
    frequency: float = 0.0
    seen: dict[str, float] = field(default_factory=dict)
    constraint_force: float = 0.0

    def share(self, beam: str, part: str) -> float:
        """Part of a beam's strain energy that is shear, axial, bending or torsion."""
        parts = self.energy.get(beam, {})
        return parts.get(part, 0.0) / (sum(parts.values()) or 1.0)

    def lines(self, step: float) -> list[str]:
        """Sentences about the scene, the frequencies against a step (s)."""
        out = [
            f"kinetic energy {self.kinetic:.3g} J on average, constraint forces up to"
            f" {self.constraint_force:.3g} N"
        ]
        for name, parts in self.energy.items():
            total = sum(parts.values()) or 1.0
            shares = ", ".join(f"{part} {100 * e / total:.2g} %" for part, e in parts.items())
            out.append(
                f"{name}: {total:.3g} J of strain energy ({shares}); bent or twisted by"
                f" {self.bend[name]:.2g} rad, strained by {self.stretch[name]:.2g}, curvature jumps"
                f" by {100 * self.jump[name]:.2g} % between elements of the pilot"
            )
        if self.frequency:
            out.append(
                f"highest frequency of the pilot {self.frequency:.3g} rad/s,"
                f" {self.frequency * step:.3g} a step of the proposal"
            )
        for name, omega in self.seen.items():
            out.append(f"{name} moves at {omega:.3g} rad/s most, {omega * step:.3g} a step")
        return out


def look(system: System, history: History) -> Pilot:
    """Numbers of a run (without derived series)."""
    pilot = Pilot()
    q = history["q"]
    pilot.kinetic = float(np.mean(kinetic_energy(system, history["p"])))
    force = history["constraint_force"][1:].reshape(-1, system.rows, 3)[:, system.origin_rows]
    pilot.constraint_force = float(np.linalg.norm(force, axis=2).max(initial=0.0))
    for beam in (item for item in system.structures if isinstance(item, Beam)):
        _look_at_beam(pilot, system, beam, q)
    try:
        pilot.frequency = highest_frequency(system)
    except (CosseratError, ArithmeticError):  # told only, never needed
        pilot.frequency = 0.0
    for name, record in history.sensors.items():
        if len(record.times) >= 8 and record.values.ndim <= 2:
            peaks = record.spectrum().peaks(1)
            if len(peaks):
                pilot.seen[name] = float(2 * np.pi * peaks[0])
    return pilot


def _look_at_beam(pilot: Pilot, system: System, beam: Beam, q: Floats) -> None:
    name, e = str(beam.name), beam.elements
    eps = section_strains(system, beam, q)
    stress = np.array([beam_stress(e, each) for each in eps])
    weights = e.lengths[:, None] * e.weights
    energy = 0.5 * np.einsum("negk,negk,eg->k", eps, stress, weights) / len(q)
    pilot.energy[name] = {part: float(energy[list(k)].sum()) for part, k in PARTS.items()}
    curvature = np.linalg.norm(eps[..., 3:], axis=-1)
    pilot.bend[name] = float(np.einsum("neg,eg->n", curvature, weights).max())
    pilot.stretch[name] = float(abs(eps[..., :3]).max())
    ne = len(e.lengths)
    t = beam.mesh.t
    meet = np.flatnonzero(t[1, : ne - 1] == t[0, 1:ne])
    jump = np.linalg.norm(eps[:, meet + 1, 0, 3:] - eps[:, meet, -1, 3:], axis=-1)
    size = float(curvature.max())
    pilot.jump[name] = float(jump.max(initial=0.0)) / size if size else 0.0


# --------------------------------------------------------------------------------------------------
# How long an event is, where nobody says: as long as loads change and the scene needs to react.


def duration(model: Model, system: System, state: State) -> float:
    """A natural end (s): twice the time of tables, one swing under gravity, one passage.

    Raises
    ------
    InputError
        If nothing in the scene tells a time.

    Examples
    --------
    >>> from skfem_cosserat import JointDistance, LoadGravity, MassPoint, ground, initial_state
    >>> model = Model()
    >>> bob = model.add("bob", MassPoint(1.0, position=(1.0, 0, 0)))
    >>> rod = model.add("rod", JointDistance(ground((0, 0, 0)), bob.place()))
    >>> weight = model.add("weight", LoadGravity((0, 0, -10.0)))
    >>> system = model.freeze()
    >>> round(duration(model, system, initial_state(system)), 3)   # 2 pi sqrt(L/g)
    1.987
    """
    found = []
    for name in model:
        item = model[name]
        if not isinstance(item, Load):
            continue
        for term in item.made_of:
            if isinstance(term.time, Table) and term.time.times[-1] > 0:
                found.append(2 * float(term.time.times[-1]))
            elif isinstance(term.time, Constant):
                size = abs(term.time.number) * float(np.linalg.norm(term.acceleration()))
                if size > 0:
                    found.append(2 * np.pi * float(np.sqrt(system.length / size)))
    energy = state.p.reshape(-1, 3)[system.origin_rows]
    mass = float(system.mass.diagonal()[system.origin_rows].sum())
    speed = float(np.linalg.norm(energy.sum(axis=0))) / mass if mass else 0.0
    if speed > 0:
        found.append(system.length / speed)
    if not found:
        raise InputError("argument until", "is missing, and nothing in the scene tells a time")
    return max(found)


# -- what a run costs where nothing else slows the machine: iterations times what one takes --------


class CostMeter:
    """A callback of :func:`simulate`: measures a run, counts iterations, ends it if it is late.

    Parameters
    ----------
    limit : float
        (s)

    Attributes
    ----------
    first_s, spent_s : float
        Processor time until the first step was done, and until the run was (s).
    steps, iterations, later : int
        Steps, Newton iterations in all of them, and in those after the first: at least one each.
    """

    def __init__(self, limit: float) -> None:
        self.limit = limit
        self.first_s = self.spent_s = np.nan
        self.steps = self.iterations = self.later = 0
        self._begun = time.process_time()

    def __call__(self, report: StepReport) -> bool:
        """Note a step; true if it is too late to go on."""
        self.stop()
        if self.steps:
            self.later += max(report.iterations, 1)
        else:
            self.first_s = self.spent_s
        self.steps += 1
        self.iterations += report.iterations
        return self.spent_s > self.limit

    def stop(self) -> None:
        """Take the time."""
        self.spent_s = time.process_time() - self._begun


@dataclass
class RunningCost:
    """The least that runs of one scene with one method have taken.

    Whatever else a machine does makes runs longer, never shorter, and changes no iterations.

    Attributes
    ----------
    first_s : float
        Processor time until the first step is done (s).
    iteration_s : float
        That of a Newton iteration after it (s).
    """

    first_s: float = np.inf
    iteration_s: float = np.inf

    def add(self, watch: CostMeter) -> None:
        """One more run."""
        self.first_s = min(self.first_s, watch.first_s)
        if watch.later:  # a single step tells nothing of others
            each = (watch.spent_s - watch.first_s) / watch.later
            self.iteration_s = min(self.iteration_s, each)

    def cost(self, later: int) -> float:
        """Processor time (s) of a run with so many iterations after the first step."""
        return self.first_s + (self.iteration_s * later if later else 0.0)


# -- what is asked of a run: readings of quantities, and how far two runs are apart ----------------


class Targets:
    """Named quantities with the error that is allowed in each.

    Parameters
    ----------
    quantities : mapping of str to sensor or function
    tolerance : float or mapping of str to float
        In the units of the quantities.

    Raises
    ------
    InputError
        If there is none, a name is no string, something is no quantity, or a tolerance is missing
        or not positive.
    """

    def __init__(
        self, quantities: Mapping[str, Any], tolerance: float | Mapping[str, float]
    ) -> None:
        item = "argument quantities"
        if not isinstance(quantities, Mapping) or not quantities:
            raise InputError(item, f"{quantities!r}, expected a dict of names and quantities")
        self.sensors: dict[str, Sensor] = {}
        self.wanted: list[Quantity] = []
        for name, quantity in quantities.items():
            if not isinstance(name, str) or not name or "/" in name:
                raise InputError(item, f"{name!r}, expected a name without slashes")
            self.wanted.append(Quantity(name, quantity))
            if isinstance(quantity, Sensor):
                self.sensors[name] = quantity
            else:
                self.wanted[-1].count_arguments()
        self.single = not isinstance(tolerance, Mapping)
        if isinstance(tolerance, Mapping) and set(tolerance) != set(quantities):
            raise InputError(
                "argument tolerance", f"is for {sorted(tolerance)}, expected {sorted(quantities)}"
            )
        self.tolerance = {
            name: positive(
                "argument tolerance",
                name,
                tolerance[name] if isinstance(tolerance, Mapping) else tolerance,
            )
            for name in quantities
        }

    @property
    def names(self) -> list[str]:
        """In the order given."""
        return list(self.tolerance)

    @property
    def of_history(self) -> bool:
        """Whether some want a whole history, with what is derived from it."""
        return any(each.of_history for each in self.wanted)

    def read(self, system: System, history: History) -> dict[str, Reading]:
        """All of them, from the sensors' records and the recorded states of a run."""
        return {each.name: each.over_run(system, history) for each in self.wanted}

    def distances(self, a: Mapping[str, Reading], b: Mapping[str, Reading]) -> dict[str, float]:
        """How far two runs are apart, by quantity (in its unit)."""
        return {name: a[name].distance(b[name]) for name in self.names}

    def distance(self, a: Mapping[str, Reading], b: Mapping[str, Reading]) -> float:
        """The largest distance in units of its tolerance."""
        found = self.distances(a, b)
        return max(found[name] / self.tolerance[name] for name in self.names)

    def given(self, size: float) -> float | dict[str, float]:
        """An error in tolerances as the tolerance was given: a number, or one a quantity."""
        if self.single:
            return size * next(iter(self.tolerance.values()))
        return {name: size * tolerance for name, tolerance in self.tolerance.items()}


# -- A scene from its start to the end of an event: any proposal is run through all of it ----------

#: Where a run starts: a state of the model's own system, or a function of a system.
Start: TypeAlias = State | Callable[[System], State] | None

#: no run takes longer than so many times what it was expected to
PATIENCE = 20.0
#: so many frozen scenes are kept
KEPT = 8


@dataclass
class Trial:
    """A proposal that was run through the event.

    Attributes
    ----------
    proposal : Proposal
    status : {"ok", "diverged", "impossible", "stopped"}
    reason : str
        Why it is not "ok".
    readings : dict of str to Reading
    spent_s : float
        Processor time of the run (s), without what only looks at it.
    running_cost : RunningCost or None
        Of this and all other runs of its scene with its method; None: it did not reach the end.
    later : int
        Newton iterations after the first step.
    unknowns : int
        Solved for in each iteration.
    iterations : float
        Newton iterations a step.
    warnings : list of dict
        As in ``history.meta["warnings"]``.
    """

    proposal: Proposal
    status: str = "ok"
    reason: str = ""
    readings: dict[str, Reading] = field(default_factory=dict, repr=False)
    spent_s: float = np.nan
    running_cost: RunningCost | None = None
    later: int = 0
    unknowns: int = 0
    iterations: float = np.nan
    warnings: list[dict[str, Any]] = field(default_factory=list, repr=False)

    @property
    def ok(self) -> bool:
        """Whether it reached the end of the event."""
        return self.status == "ok"

    @property
    def cost_s(self) -> float:
        """Processor time of such a run (s): what it took, or less where others were faster."""
        return self.spent_s if self.running_cost is None else self.running_cost.cost(self.later)


class Budget:
    """Processor time that may be spent.

    Parameters
    ----------
    seconds : float or None
        None: no limit.
    """

    def __init__(self, seconds: float | None) -> None:
        self.seconds = seconds
        self._begun = time.process_time()

    @property
    def spent(self) -> float:
        """Processor time since the start (s)."""
        return time.process_time() - self._begun

    @property
    def left(self) -> float:
        """What is left (s)."""
        return np.inf if self.seconds is None else max(0.0, self.seconds - self.spent)

    def allows(self, cost: float) -> bool:
        """Whether something of this cost (s) can be tried."""
        return not cost > self.left


class Trials:
    """A model, what is asked of it, and all that has been run.

    Parameters
    ----------
    model : Model
    quantities : Targets
    until : float, optional
        How long it is (s); default: see :func:`duration`.
    start : State or callable, optional
    kernels : str
    base : int
        The smallest number of steps; others are doubled.
    budget : Budget

    Raises
    ------
    InputError
        As from :meth:`Model.freeze`, and for sensors of items that are not in the model.
    """

    def __init__(
        self,
        model: Model,
        quantities: Targets,
        until: float | None,
        start: Start,
        kernels: str,
        base: int,
        budget: Budget,
    ) -> None:
        self.model, self.quantities = model, quantities
        self.start, self.kernels, self.base, self.budget = start, kernels, base, budget
        self.system = model.freeze()
        self.beams = {name: item for name in model if isinstance(item := model[name], Beam)}
        first = self.begin(self.system)
        checked_sensors(quantities.sensors, self.system, first)
        if until is None:
            self.until = duration(model, self.system, first)
        else:
            self.until = positive("argument until", "value", until, " of seconds")
        self.keep = _attached(model, quantities)
        self.pieces = {
            name: divided(beam.mesh, 1, self.keep[name]).nelements
            for name, beam in self.beams.items()
        }
        # compiled kernels take fewer scenes in a plane than in space
        self.planar = None if kernels == "numba" else self._plane()
        self.trials: dict[tuple[Hashable, int | None], Trial] = {}
        self.history: History | None = None
        self._compiled: set[Hashable] = set()
        self._running_costs: dict[Hashable, RunningCost] = {}
        self._kept: dict[Hashable, tuple[System, dict[str, Any]]] = {}

    def _plane(self) -> Planar | None:
        """The plane of the scene and its start, if it stays in one."""
        planar = planarity(self.system).planar
        if planar is None:
            return None
        try:
            system = self.model.freeze(planar=planar)
            state = self.begin(system)
            until = state.time + 1e-6 * self.until
            step = until - state.time  # one step, however it is rounded
            simulate(system, EnergyMomentum(), NullSpace(), step, until, start=state, derive=False)
        except CosseratError:  # it starts out of the plane
            return None
        return planar

    def begin(self, system: System, nudge: tuple[float, int] | None = None) -> State:
        """The state that a run of a system starts from, perhaps a little beside it.

        `nudge` is a part of the scene's extent over the event, and a seed: velocities are changed
        at random by at most as much.
        """
        if self.start is None:
            state = initial_state(system)
        elif isinstance(self.start, State):
            state = carry_state(self.system, system, self.start)
        else:
            state = self.start(system)
        if nudge is None:
            return state
        size, seed = nudge
        nu = np.random.default_rng(seed).standard_normal(system.unknowns)
        v = np.asarray(system.null_space(state.q, state.time) @ nu)
        fastest = np.linalg.norm(v.reshape(-1, 3)[system.origin_rows], axis=1).max(initial=0.0)
        v *= size * system.length / self.until / max(fastest, 1e-300)
        p = state.p + momentum(system, v)
        return State(state.time, state.index, state.q, p, state.fresh, state.turns, state.carried)

    def proposal(
        self,
        elements: Mapping[str, int],
        order: int,
        steps: int,
        theory: Mapping[str, BeamModel] | None = None,
        integrator: Integrator | None = None,
    ) -> Proposal:
        """A proposal for this event; without more: full beams, energy-momentum, null space."""
        theories = {name: BeamFull() for name in self.beams} | dict(theory or {})
        return Proposal(
            theories,
            order,
            dict(elements),
            integrator or EnergyMomentum(),
            NullSpace(),
            steps,
            self.until / steps,
            self.keep,
            self.planar,
        )

    def run(self, proposal: Proposal, limit: float = np.inf, seed: int | None = None) -> Trial:
        """The trial of a proposal, run if it has not been; with a seed: nudged at the start."""
        key = (proposal.key, seed)
        known = self.trials.get(key)
        if known is None or (known.status == "stopped" and limit > 2 * known.cost_s):
            self.trials[key] = self._run(proposal, min(limit, self.budget.left), seed)
        return self.trials[key]

    @property
    def plain(self) -> list[Trial]:
        """All that have been run from the start as it is, not from one beside it."""
        return [trial for (_, seed), trial in self.trials.items() if seed is None]

    def again(self, trial: Trial) -> float:
        """What a trial that is run once more takes (s); the faster run counts for its cost."""
        other = self._run(trial.proposal, PATIENCE * trial.cost_s, None)
        return other.spent_s if other.ok else trial.cost_s

    def _run(self, proposal: Proposal, limit: float, seed: int | None) -> Trial:
        trial = Trial(proposal)
        notices = Notices(quiet=True, alone=True)  # dozens of trials would fill a screen
        trial.warnings = notices.found
        try:
            with notices:
                system, sensors = self.built(proposal)
                trial.unknowns = system.unknowns
                start = self.begin(system, None if seed is None else (NUDGE, seed))
                run = system, start, proposal, sensors, limit
                history, watch = self._simulate(*run)
                if history.meta["kernels"] == "numba" and proposal.kind not in self._compiled:
                    self._compiled.add(proposal.kind)  # takes longer than a run, but once only
                    history, watch = self._simulate(*run)
                trial.spent_s, trial.later = watch.spent_s, watch.later
                trial.iterations = watch.iterations / max(watch.steps, 1)
                if history.status == "interrupted":
                    raise KeyboardInterrupt
                if history.status != "completed":
                    trial.status, trial.reason = "stopped", f"after {trial.spent_s:.3g} s"
                    return trial
                if self.quantities.of_history:
                    derive_series(system, history)
                kind = proposal.scene, proposal.method, history.meta["kernels"]
                trial.running_cost = self._running_costs.setdefault(kind, RunningCost())
                trial.running_cost.add(watch)
                trial.readings = self.quantities.read(system, history)
                self.history = history
        except Diverged as error:
            trial.status, trial.reason = "diverged", f"at {error.time:.4g} s"
        except CosseratError as error:
            trial.status, trial.reason = "impossible", str(error)
        if trial.ok and not all(each.finite for each in trial.readings.values()):
            trial.status, trial.reason = "diverged", "numbers are not finite"
        return trial

    def built(self, proposal: Proposal) -> tuple[System, dict[str, Any]]:
        """The scene of a proposal and its sensors; the last ones are kept, as steps vary most."""
        found = self._kept.pop(proposal.scene, None)
        if found is None:
            model, replacements = proposal.rebuilt(self.model)
            sensors = {k: replacements.of(s) for k, s in self.quantities.sensors.items()}
            found = model.freeze(planar=proposal.planar), sensors
        self._kept[proposal.scene] = found
        if len(self._kept) > KEPT:
            del self._kept[next(iter(self._kept))]
        return found

    def _simulate(
        self,
        system: System,
        start: State,
        proposal: Proposal,
        sensors: Mapping[str, Any],
        limit: float,
    ) -> tuple[History, CostMeter]:
        watch = CostMeter(limit)
        history = simulate(
            system,
            proposal.integrator,
            proposal.treatment,
            proposal.step,
            start.time + self.until * (1 + 1e-9),
            start=start,
            every=max(1, proposal.steps // self.base),
            sensors=sensors,
            derive=False,
            kernels=self.kernels,
            callbacks=[watch],
        )
        watch.stop()
        return history, watch

    def distance(self, a: Trial, b: Trial) -> float:
        """How far two trials are apart, in tolerances; infinite if one failed."""
        if not (a.ok and b.ok):
            return np.inf
        return self.quantities.distance(a.readings, b.readings)


#: by how much of the scene's extent over the event starts are nudged
NUDGE = 1e-6


class _Places(Replacements):
    """Notes all places that are come across."""

    def __init__(self) -> None:
        super().__init__({})
        self.found: list[Place] = []

    def of(self, value: Any) -> Any:
        if isinstance(value, Place) and value.item is not None:
            self.found.append(value)
        return super().of(value)


def _attached(model: Model, quantities: Targets) -> dict[str, list[tuple[int, float]]]:
    """By beam: elements and reference coordinates of nodes that something is attached to."""
    places = _Places()
    for name in model:
        places.of(model[name])
    for sensor in quantities.sensors.values():
        places.of(sensor)
    out: dict[str, list[tuple[int, float]]] = {}
    for name in model:
        beam = model[name]
        if not isinstance(beam, Beam):
            continue
        vertices = {place.vertex for place in places.found if place.item is beam}
        nodes: Floats = beam.basis.interpolation.nodes
        out[name] = []
        for vertex in sorted(vertices):
            e, k = (int(x[0]) for x in np.nonzero(beam.basis.connectivity == vertex))
            out[name].append((e, float(nodes[k])))
    return out


def check_start(start: Start) -> None:
    """Refuse what is no start.

    Raises
    ------
    InputError
        If it is neither a state nor a function.
    """
    if start is not None and not isinstance(start, State) and not callable(start):
        raise InputError("argument start", f"{start!r}, expected a State or a function of a system")
