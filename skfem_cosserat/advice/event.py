"""A scene from its start to the end of an event: any proposal is run through all of it."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Hashable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np

from ..adaptive import carry_state
from ..beam import Beam
from ..constraints import NullSpace, Treatment
from ..diagnostics import momentum
from ..errors import CosseratError, Diverged, InputError
from ..frames import Place
from ..history import History
from ..integrators import EnergyMomentum, Integrator, State
from ..log import logger
from ..mesh import divided
from ..model import Model, System, planarity
from ..model.plane import Planar
from ..simulate import derive_series, initial_state, simulate
from ..simulate.sensors import checked_sensors
from ..twin import Twins
from ..types import Floats, positive
from .duration import duration
from .pace import Pace, Watch
from .proposal import Proposal
from .quantities import Quantities, Reading
from .rungs import BeamFull, BeamModel

__all__ = ["Budget", "Event", "Start", "Trial"]

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
    pace : Pace or None
        Of this and all other runs of its scene with its method; None: it did not reach the end.
    later : int
        Newton iterations after the first step.
    unknowns : int
        Solved for in each iteration.
    iterations : float
        Newton iterations a step.
    warnings : list of str
        What was logged.
    """

    proposal: Proposal
    status: str = "ok"
    reason: str = ""
    readings: dict[str, Reading] = field(default_factory=dict, repr=False)
    spent_s: float = np.nan
    pace: Pace | None = None
    later: int = 0
    unknowns: int = 0
    iterations: float = np.nan
    warnings: list[str] = field(default_factory=list, repr=False)

    @property
    def ok(self) -> bool:
        """Whether it reached the end of the event."""
        return self.status == "ok"

    @property
    def cost_s(self) -> float:
        """Processor time of such a run (s): what it took, or less where others were faster."""
        return self.spent_s if self.pace is None else self.pace.cost(self.later)


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


class Event:
    """A model, what is asked of it, and all that has been run.

    Parameters
    ----------
    model : Model
    quantities : Quantities
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
        quantities: Quantities,
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
        self._paces: dict[Hashable, Pace] = {}
        self._kept: dict[Hashable, tuple[System, dict[str, Any]]] = {}

    def _plane(self) -> Planar | None:
        """The plane of the scene and its start, if it stays in one."""
        planar = planarity(self.system).planar
        if planar is None:
            return None
        try:
            system = self.model.freeze(planar=planar)
            step = 1e-6 * self.until
            state = self.begin(system)
            until = state.time + step
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
        return State(state.time, state.index, state.q, p, state.fresh, state.turns, state.memory)

    def proposal(
        self,
        elements: Mapping[str, int],
        order: int,
        steps: int,
        rung: Mapping[str, BeamModel] | None = None,
        integrator: Integrator | None = None,
        treatment: Treatment | None = None,
    ) -> Proposal:
        """A proposal for this event; without more: full beams, energy-momentum, null space."""
        rungs = {name: BeamFull() for name in self.beams} | dict(rung or {})
        return Proposal(
            rungs,
            order,
            dict(elements),
            integrator or EnergyMomentum(),
            treatment or NullSpace(),
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
        """What a trial that is run once more takes (s); its pace is that of the faster one."""
        other = self._run(trial.proposal, PATIENCE * trial.cost_s, None)
        return other.spent_s if other.ok else trial.cost_s

    def _run(self, proposal: Proposal, limit: float, seed: int | None) -> Trial:
        trial = Trial(proposal)
        try:
            with _quiet(trial.warnings):
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
                trial.pace = self._paces.setdefault(kind, Pace())
                trial.pace.add(watch)
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
            model, twins = proposal.rebuilt(self.model)
            sensors = {k: twins.of(s) for k, s in self.quantities.sensors.items()}
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
    ) -> tuple[History, Watch]:
        watch = Watch(limit)
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


class _Places(Twins):
    """Notes all places that are come across."""

    def __init__(self) -> None:
        super().__init__({})
        self.found: list[Place] = []

    def of(self, value: Any) -> Any:
        if isinstance(value, Place) and value.item is not None:
            self.found.append(value)
        return super().of(value)


def _attached(model: Model, quantities: Quantities) -> dict[str, list[tuple[int, float]]]:
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


@contextmanager
def _quiet(kept: list[str]) -> Iterator[None]:
    """Keeps what is logged to itself: dozens of trials would fill a screen."""

    def catch(record: logging.LogRecord) -> bool:
        if record.levelno >= logging.WARNING:
            kept.append(record.getMessage())
        return False

    logger.addFilter(catch)
    try:
        yield
    finally:
        logger.removeFilter(catch)


def check_start(start: Start) -> None:
    """Refuse what is no start.

    Raises
    ------
    InputError
        If it is neither a state nor a function.
    """
    if start is not None and not isinstance(start, State) and not callable(start):
        raise InputError("argument start", f"{start!r}, expected a State or a function of a system")
