"""Work done since the start of a run, for the balance of energy."""

from __future__ import annotations

import numpy as np

from ..integrators import Integrator, State, StepReport
from ..model import System
from ..types import Floats

__all__ = ["Works"]


class Works:
    """Sums of the works of all steps.

    Prescribed motion and drives work through the constraint forces: ``-(G^T lambda) . dq``. Where
    these act at the nodes, a step takes half of the force at its start and half of that at its
    end, one of which belongs to the step after it (or before it, where they act at its end).
    """

    def __init__(self, system: System, integrator: Integrator, state: State, h: float) -> None:
        self._begin(system, integrator, state, h)
        self.loads = self.actuators = self.dissipated = self.drives = 0.0

    def _begin(self, system: System, integrator: Integrator, state: State, h: float) -> None:
        self._driven = bool(system.moving)
        one = integrator.single
        weight = one.constraint_weight
        #: of a step's own force, of that of the step after it and of that before it
        self._own, self._next = (1.0, 0.0) if weight == 0.5 else (0.5, float(weight == 0) / 2)
        self._before = 1 - self._own - self._next
        self._q = state.q
        self._last = one.start_force(system, state, h) if self._driven and self._before else None
        self._waiting: Floats | None = None

    def go_on(
        self, integrator: Integrator, system: System, state: State, h: float, loss: float
    ) -> None:
        """Another state or system follows, at the expense of an energy (J)."""
        self._begin(system, integrator, state, h)
        self.dissipated += loss

    def add(self, report: StepReport) -> None:
        """A step is done; :meth:`finish` has had its report before."""
        before = None
        for stage in report.stages:
            force = self._force(stage, before) if self._driven else None
            if before is not None:
                self._end(force)
            self._add(stage, force)
            before = stage

    def _force(self, report: StepReport, before: StepReport | None) -> Floats:
        """Constraint force of a step; at a node it is over half of the step before it, too."""
        force = report.constraint_force
        if before is None or not self._next:
            return force
        return force * (2 * report.step / (report.step + before.step))

    def _add(self, report: StepReport, force: Floats | None) -> None:
        work, q = report.work, report.state.q
        self.loads += work.loads
        self.actuators += work.actuators
        self.dissipated += work.dissipated
        if force is not None:
            change = q - self._q
            self.drives += work.ground - self._own * float(force @ change)
            if self._last is not None:
                self.drives -= self._before * float(self._last @ change)
                self._last = force
            self._waiting = change if self._next else None
        self._q = q

    def finish(self, report: StepReport) -> None:
        """The step that follows the last one: its constraint force ends that one's work."""
        if self._waiting is not None:
            self._end(report.stages[0].constraint_force)

    def _end(self, force: Floats | None) -> None:
        if self._waiting is not None and force is not None:
            self.drives -= self._next * float(force @ self._waiting)
            self._waiting = None

    def row(self) -> dict[str, float]:
        """Entries of the history; the work of drives is NaN while a part of it is unknown."""
        return {
            "work_loads": self.loads,
            "work_actuators": self.actuators,
            "work_drives": self.drives if self._waiting is None else np.nan,
            "dissipated": self.dissipated,
        }
