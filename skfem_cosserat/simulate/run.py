"""The loop of a run: steps, events and what they change, until the end."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from .. import diagnostics
from ..diagnostics import Projection
from ..errors import Diverged
from ..history import EventRecord
from ..integrators import State, StepReport
from ..log import logger
from ..model import System
from .actions import Outcome
from .events import Found, Watch
from .interrupt import Interrupt
from .pace import Maker, Pace
from .recorder import Recorder
from .view import View

__all__ = ["Callback", "Run"]

Callback = Callable[[StepReport], object]


@dataclass
class Run:
    """A run and its parts.

    Attributes
    ----------
    maker : Maker
    pace : Pace
    recorder : Recorder
    callbacks : sequence of callable
    show : callable
        Gets the time after each step.
    interrupt : Interrupt
    watch : Watch or None
        None: there are no events.
    """

    maker: Maker
    pace: Pace
    recorder: Recorder
    callbacks: Sequence[Callback]
    show: Callable[[float], object]
    interrupt: Interrupt
    watch: Watch | None = None

    def go(self, state: State) -> tuple[str, Diverged | None]:
        """Go on from a state to the end; the status, and why a step could not be solved."""
        self.state, status = state, "completed"
        try:
            while status == "completed" and (reports := self.pace.advance(self.state)):
                for report in reports:
                    found = None if self.watch is None else self.watch.look(self.state, report)
                    status = self._take(report if found is None else found.report)
                    if found is not None:
                        status = "stopped" if self._act(found) else status
                    if found is not None or status != "completed":
                        break
            if status != "interrupted":
                end = self.state
                self.recorder.look_ahead(end, end.time + self.pace.stepper.h)
        except KeyboardInterrupt:  # raised by a callback, or a second Ctrl-C
            return "interrupted", None
        except Diverged as error:
            return "diverged", error
        return status, None

    def _take(self, report: StepReport) -> str:
        """A step is done: the status of the run."""
        self.recorder.take(report)
        self.state = report.state
        self.show(self.state.time)
        answers = [callback(report) for callback in self.callbacks]  # all are called
        if self.interrupt.asked:
            return "interrupted"
        asked = any(isinstance(answer, bool | np.bool_) and answer for answer in answers)
        return "stopped" if asked else "completed"

    def _act(self, found: Found) -> bool:
        """What events do; whether the run ends with them."""
        assert self.watch is not None
        start, system, stop = self.state, self.watch.system, False
        before, losses = system, 0.0
        for event, value in found.events:
            outcome = event.action.outcome(View(system, self.state))
            system, state, loss = self._outcome(system, outcome)
            row = self.recorder.row_of_event()
            record = EventRecord(
                *(start.time, event.name, value, row, start.index, loss, repr(event.action))
            )
            self.recorder.events.append(record)
            logger.info("%s", record)
            self.state, losses, stop = state, losses + loss, stop or outcome.stop
        stepper = self.pace.stepper
        if self.state is not start:
            if system is not before:
                stepper = self.maker.changed(system, stepper.h)
            self.recorder.switch(start, system, stepper, self.state, losses)
        if not stop:
            self.watch.go_on(system, self.state, found)
        self.pace.begin(stepper, self.state)
        return stop

    def _outcome(self, system: System, outcome: Outcome) -> tuple[System, State, float]:
        """System and state to go on with, and the energy (J) that this takes."""
        state = self.state
        if outcome.system is None and outcome.state is None:
            return system, state, 0.0
        new = system if outcome.system is None else outcome.system
        own = Projection(system)(state.q, state.p, state.time)[1]
        known = self.maker.integrator.carries_node_momentum or state.fresh
        before = _energy(system, replace(state, p=state.p if known else own))
        if outcome.state is None:
            p = Projection(new)(state.q, own, state.time)[1]
            after = State(state.time, state.index, state.q, p, turns=state.turns)
        else:
            after = replace(outcome.state, time=state.time, index=state.index, fresh=True)
        return new, after, before - _energy(new, after)


def _energy(system: System, state: State) -> float:
    """Kinetic and stored energy (J) at (q, p)."""
    turns = None if state.turns is None else state.turns[None]
    coupled = diagnostics.coupling_energy(system, state.q[None], np.array([state.time]), turns)
    stored = diagnostics.strain_energy(system, state.q)
    return float(diagnostics.kinetic_energy(system, state.p) + stored + coupled[0])
