"""How a run goes on in time: steps of one size, or others that a controller chooses."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..constraints import Treatment
from ..integrators import Integrator, State, Stepper, StepReport
from ..integrators.refused import refusal
from ..linear import Solver
from ..model import System
from ..newton import NewtonSettings

__all__ = ["FixedPace", "Maker", "Pace"]

#: most steps in one go, and most unknowns moved in all of them together: for less than a second,
#: as Ctrl-C waits for them
STRIDE, MOVED = 256, 10**6


@dataclass
class Maker:
    """Makes steppers with the choices of a run, for any system and step size."""

    integrator: Integrator
    treatment: Treatment
    settings: NewtonSettings | None = None
    kernels: str = "auto"
    steps: int | None = None
    solver: Solver | None = None
    announce: Callable[[str], object] | None = None
    #: steps differ in size
    varying: bool = False

    def __call__(self, system: System, h: float) -> Stepper:
        """A stepper."""
        more = self.settings, self.kernels, self.steps, self.solver, self.announce
        stepper = Stepper(system, self.integrator, self.treatment, h, *more)
        stepper.varying = self.varying
        return stepper

    def changed(self, system: System, h: float) -> Stepper:
        """A stepper for a system that has changed: plain kernels if there are no compiled ones."""
        if self.kernels == "numba" and refusal(system, self.integrator, self.treatment):
            self.kernels = "numpy"
        return self(system, h)


class Pace(ABC):
    """Steps of a run, a few at a time.

    Attributes
    ----------
    stepper : Stepper
        Of the steps that go on.
    """

    stepper: Stepper

    @abstractmethod
    def advance(self, state: State) -> list[StepReport]:
        """The steps after a state; none at the end of the run."""

    @abstractmethod
    def begin(self, stepper: Stepper, state: State) -> None:
        """Go on from a state between its steps."""

    def summary(self) -> dict[str, Any]:
        """What the history is to tell of it."""
        return {}


class FixedPace(Pace):
    """Steps of one size, as many as were asked for.

    Parameters
    ----------
    stepper : Stepper
    state : State
        Start of the run.
    count : int
        Number of steps.
    until : float, optional
        Equal steps to this end instead, of the stepper's size or less.
    ahead : callable, optional
        From a state, how many steps may be taken in one go; by default one.
    """

    def __init__(
        self,
        stepper: Stepper,
        state: State,
        count: int,
        until: float | None = None,
        ahead: Callable[[State], int] | None = None,
    ) -> None:
        self.stepper, self._size, self._ahead = stepper, stepper.h, ahead
        self._most = max(1, min(STRIDE, MOVED // max(1, stepper.system.n)))
        self._origin, self._first, self._count = state.time, state.index, count
        self._end = until
        if until is not None:
            self.begin(stepper, state)

    def advance(self, state: State) -> list[StepReport]:
        """See the base class: one step, or what follows in one go."""
        k = state.index + 1 - self._first
        if k > self._count:
            return []
        # t_n = t_0 + n h: no rounding adds up over many steps
        if self._ahead is None or not self.stepper.strides(state):
            return [self.stepper.advance(state, self._origin + k * self.stepper.h)]
        report = self.stepper.stride(state, min(self._ahead(state), self._most))
        end = report.state
        end.time = self._origin + (end.index - self._first) * self.stepper.h
        return [report]

    def begin(self, stepper: Stepper, state: State) -> None:
        """See the base class: equal steps to the same end, of the size asked for or less."""
        assert self._end is not None
        left = self._end - state.time
        self.stepper, self._origin, self._first = stepper, state.time, state.index
        self._count = int(np.ceil(left / self._size - 1e-9)) if left > 1e-9 * self._size else 0
        if self._count:
            stepper.resize(left / self._count)
