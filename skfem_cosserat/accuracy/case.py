"""A case: a scene at a mesh, an order and a step, and its run."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ..beam import Beam
from ..constraints import Multipliers, NullSpace
from ..diagnostics import momentum
from ..diagnostics.inputs import steps_that_see
from ..errors import CosseratError, InputError, failed
from ..frames import Place
from ..frozen import Replacements
from ..integrators import EnergyMomentum, Integrator, State
from ..mesh import divided
from ..model import Model, Planar, System
from ..run import carry_state, initial_state, simulate
from ..run.events import checked_events
from ..run.sensors import checked_sensors
from ..statics import Control, static
from ..theory import Theory
from ..types import check_kind, real
from .asked import Asked, Run, attached

#: highest order of elements
HIGHEST = 4


class Case(NamedTuple):
    """A scene at a mesh, an order and a step.

    Attributes
    ----------
    parts : int
        Elements in the place of each element of the poorest mesh.
    order : int
    steps : int
        Zero for equilibria.
    """

    parts: int
    order: int
    steps: int

    @property
    def work(self) -> int:
        """Steps times nodes, to compare it with that of others."""
        return max(self.steps, 1) * self.parts * self.order

    @property
    def shorter(self) -> Case:
        """With half of the step."""
        return self._replace(steps=2 * self.steps)

    @property
    def longer(self) -> Case:
        """With twice the step."""
        return self._replace(steps=self.steps // 2)

    @property
    def coarser(self) -> Case:
        """With half as many elements."""
        return self._replace(parts=self.parts // 2)

    @property
    def finer(self) -> Case:
        """With twice as many elements."""
        return self._replace(parts=2 * self.parts)

    @property
    def richer(self) -> Case:
        """The next order, after the highest one twice as many elements."""
        if self.order < HIGHEST:
            return self._replace(order=self.order + 1)
        return self.finer


# -- the scene on any mesh -------------------------------------------------------------------------


class Scene:
    """A model, what is asked of it, and how it is run.

    Parameters
    ----------
    model : Model
    asked : Asked
    until : float or None
    start : State, callable or None
    integrator : Integrator, Control or None

    Raises
    ------
    InputError
        As from :meth:`Model.freeze`; for an end before the start, an integrator of equilibria, and
        sensors of items that are not in the model.
    """

    def __init__(
        self,
        model: Model,
        asked: Asked,
        until: float | None,
        start: State | Callable[[System], State] | None,
        integrator: Integrator | Control | None,
    ) -> None:
        self.model, self.asked, self.start = model, asked, start
        self.system = model.freeze()
        self.moves = until is not None
        kind = Integrator if self.moves else Control
        if integrator is not None and not isinstance(integrator, kind):
            wanted = "an integrator such as EnergyMomentum(), or until=None for equilibria"
            wanted = wanted if self.moves else "a control such as LoadControl()"
            raise InputError("argument integrator", f"{integrator!r}, expected {wanted}")
        self.integrator = integrator if isinstance(integrator, Integrator) else EnergyMomentum()
        marches = type(self.integrator).march is not Integrator.march  # its joints need multipliers
        self.treatment = Multipliers() if marches else NullSpace()
        self.control = integrator if isinstance(integrator, Control) else None
        try:
            first = self.begin(self.system)
        except Exception as error:
            if callable(start) and not isinstance(error, CosseratError):
                raise failed("argument start", "it", error) from error
            raise
        events = asked.events(None)
        try:
            checked_sensors(asked.sensors(), self.system, first)
            checked_events(events, self.integrator, self.system)
        except InputError as error:
            raise InputError("argument quantities", str(error)) from error
        if events and not self.moves:
            raise InputError("argument quantities", f"{events[0].label} needs a motion: until=")
        self.begun, self.span = first.time, 0.0
        if until is not None:
            end = real("argument until", "until", until, "a time (s)")
            if not first.time < end < np.inf:
                text = f"{until!r}, expected a time after the start at {first.time:.9g} s"
                raise InputError("argument until", text)
            self.span = end - first.time
        self.beams = {name: each for name in model if isinstance(each := model[name], Beam)}
        places = attached([*(model[name] for name in model), *asked.wanted.values()])
        self.keep = {name: _kept(beam, places) for name, beam in self.beams.items()}
        self.pieces = {
            name: divided(beam.mesh, 1, self.keep[name]).nelements
            for name, beam in self.beams.items()
        }
        self._built: dict[tuple[int, int], tuple[Model, System, Replacements | None]] = {}

    def steps_that_see(self, counts: Sequence[int], end: float | None = None) -> tuple[int, str]:
        """The first number of steps that see loads and motions; "" or the item that none sees.

        Up to the end of the motion, or up to a time (s).
        """
        scheme = self.integrator.single.scheme(1.0)
        at_ends = scheme is not None and scheme.at_end
        end = self.begun + self.span if end is None else end
        return steps_that_see(self.system, self.begun, end, at_ends, counts)

    @property
    def order(self) -> int:
        """Order of errors by the step."""
        return self.integrator.order

    def begin(self, system: System, nudge: float = 0.0) -> State:
        """The state that a run starts from; with a nudge (m) velocities that move it so far."""
        if self.start is None:
            state = initial_state(system)
        elif isinstance(self.start, State):
            state = carry_state(self.system, system, self.start)
        else:
            state = self.start(system)
            check_kind("argument start: what it gave", state, State)
        if not nudge:
            return state
        nu = np.cos(1.0 + np.arange(system.unknowns) ** 1.5)  # without a pattern, always the same
        v = np.asarray(system.null_space(state.q, state.time) @ nu)
        v *= nudge / self.span / max(abs(v).max(), 1e-300)
        p = state.p + momentum(system, v)
        return State(state.time, state.index, state.q, p, state.fresh, state.turns, state.carried)

    def items(self, case: Case, theories: Mapping[str, Theory] | None = None) -> dict[str, Beam]:
        """The beams at a mesh and an order, some of them with other theories."""
        theories = theories or {}
        found = {}
        for name, beam in self.beams.items():
            mesh = divided(beam.mesh, case.parts * self.pieces[name], self.keep[name])
            found[name] = beam.on_mesh(mesh, case.order, theories.get(name))
        return found

    def built(self, case: Case) -> tuple[Model, System, Replacements | None]:
        """The scene at a mesh and an order."""
        key = case.parts, case.order
        if key not in self._built:
            self._built[key] = self.frozen(self.items(case))
        return self._built[key]

    def frozen(
        self, beams: Mapping[str, Beam], planar: Planar | None = None
    ) -> tuple[Model, System, Replacements | None]:
        """The scene with other beams, perhaps in its plane."""
        model, copies = self.model.rebuilt(beams) if beams else (self.model, None)
        return model, model.freeze(planar), copies

    def run(
        self,
        case: Case,
        nudge: float = 0.0,
        built: tuple[Model, System, Replacements | None] | None = None,
    ) -> Run:
        """A run, and what is asked of it."""
        begun = time.process_time()
        model, system, copies = self.built(case) if built is None else built
        if self.moves:
            state = self.begin(system, nudge)
            # functions look at recorded states: more of them
            rows = 1024 if self.asked.needs_states else 128
            history = simulate(
                system,
                self.integrator,
                self.treatment,
                self.span / case.steps,
                state.time + self.span,
                start=state,
                every=max(1, case.steps // rows),
                sensors=self.asked.sensors(copies),
                events=self.asked.events(copies) or None,
            )
        else:
            start = None if self.start is None else self.begin(system)
            control = self.control if copies is None else copies.of(self.control)
            history = static(system, self.treatment, control, start=start)
        return self.read(Run(model, system, history, in_time=self.moves), copies, begun)

    def read(self, run: Run, copies: Replacements | None, begun: float) -> Run:
        """The run with what is asked of it, and its cost since it was begun (processor time, s)."""
        run.values = self.asked.read(run, copies)
        run.cost_s = time.process_time() - begun
        return run


def _kept(beam: Beam, places: list[Place]) -> list[tuple[int, float]]:
    """Elements and reference coordinates of the nodes of a beam that places are at."""
    nodes = beam.basis.interpolation.nodes
    found = []
    for vertex in sorted({place.vertex for place in places if place.item is beam}):
        e, k = (int(x[0]) for x in np.nonzero(beam.basis.connectivity == vertex))
        found.append((e, float(nodes[k])))
    return found
