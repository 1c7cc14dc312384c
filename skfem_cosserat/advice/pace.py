"""What a run costs where nothing else slows the machine: iterations times what one takes."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from ..integrators import StepReport

__all__ = ["Pace", "Watch"]


class Watch:
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
class Pace:
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

    def add(self, watch: Watch) -> None:
        """One more run."""
        self.first_s = min(self.first_s, watch.first_s)
        if watch.later:  # a single step tells nothing of others
            each = (watch.spent_s - watch.first_s) / watch.later
            self.iteration_s = min(self.iteration_s, each)

    def cost(self, later: int) -> float:
        """Processor time (s) of a run with so many iterations after the first step."""
        return self.first_s + (self.iteration_s * later if later else 0.0)
