"""Which states are recorded, and when a row of the history is complete."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..diagnostics import Projection
from ..errors import CosseratError, Diverged, InputError
from ..history import EventRecord, History, HistoryWriter
from ..integrators import State, Stepper, StepReport
from ..log import logger
from ..model import System
from ..types import Floats, IndexArray, numbers
from .describe import describe, fingerprint
from .sensors import Sensor, SensorBank, checked_sensors
from .works import Works

__all__ = ["Numbered", "Recorder", "Segment", "Wanted", "take_along", "timed"]

#: whether a state is to be recorded, by the state and the size of the step that led to it
Wanted = Callable[[State, float], bool]


class Segment(NamedTuple):
    """Rows of a history from `row` on that belong to a system."""

    row: int
    system: System


#: what the step after the last one may raise: it is beyond the run the user asked for
_NO_STEP = (ArithmeticError, LookupError, RuntimeError, TypeError, ValueError)


def take_along(error: BaseException, history: History) -> None:
    """Give an error of the user's own code the history so far, as ``error.history``."""
    error.history = history  # type: ignore[attr-defined]
    error.add_note(f"the history up to t = {history.times[-1]:.6g} is in .history")


class Recorder:
    """Decides what is recorded and writes it."""

    def __init__(
        self,
        system: System,
        stepper: Stepper,
        state: State,
        wanted: Wanted,
        path: str | os.PathLike[str] | None,
        sensors: Mapping[str, Sensor] | None = None,
        varying: bool = False,
    ) -> None:
        self.system, self.stepper = system, stepper
        self.wanted, self.open = wanted, False
        #: steps may differ in size: it is recorded
        self.varying = varying
        self.segments, self.events = [Segment(0, system)], list[EventRecord]()
        self.more: dict[str, Any] = {}
        self._angles = [item.name for item in system.couplings.angles]
        meta, static = describe(system)
        meta |= {
            "integrator": stepper.integrator.name,
            "treatment": stepper.treatment.name,
            "step": stepper.h,
            "solver": stepper.method,
            "unknowns": stepper.bound.unknowns,
            "kernels": stepper.choice.name,
            "kernels_why": stepper.choice.why,
        }
        bank = checked_sensors(sensors, system, state)
        if bank:
            meta["sensors"] = {
                name: {"unit": sensor.unit, "derivative": sensor.derivative}
                for name, sensor in bank.items()
            }
        self.works = Works(system, stepper.integrator, state, stepper.h)
        self.writer = HistoryWriter(meta, static, path)
        self.iterations = 0
        self.last: dict[str, Any] | None = None
        self.closed: History | None = None
        self.bank = SensorBank(bank, system, stepper, self.writer)
        self.bank.begin(state)
        self._before = state
        self._rows = 0
        weight = stepper.integrator.constraint_weight
        #: whether a step's constraint force acts at its end, between both
        self._at_end, self._between = weight == 1, 0 < weight < 1
        first = stepper.integrator.start_force(system, state, stepper.h)
        self._append(self._row(state, 0, 1, 0.0, first))

    def __enter__(self) -> Recorder:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: object
    ) -> None:
        """An error of the user's own code takes the history so far along as ``error.history``."""
        if error is not None:
            take_along(error, self.close("failed", None) if self.closed is None else self.closed)

    def _row(
        self,
        state: State,
        iterations: int,
        attempts: int,
        residual: float,
        force: Floats | None = None,
    ) -> dict[str, Any]:
        nan = np.full(self.system.n, np.nan)
        known = state.fresh or self.stepper.integrator.carries_node_momentum
        row: dict[str, Any] = {
            "t": state.time,
            "step": state.index,
            "q": state.q,
            "p": state.p if known else nan,
            "carried": state.p,
            "fresh": float(state.fresh),
            "constraint_force": nan if force is None else force,
            "newton_iterations": iterations,
            "attempts": attempts,
            "residual": residual,
            **self.works.row(),
        }
        if self._angles:
            none = np.zeros(len(self._angles), dtype=np.int64)
            row["turns"] = none if state.turns is None else state.turns
        if self.varying:
            row["step_size"] = np.nan if state.maker is None else state.maker[1]
        if count := self.stepper.integrator.remembered:
            none = np.full((count, self.system.n), np.nan)
            row["memory"] = none if state.memory is None else state.memory
        if self._between:
            row["constraint_point"] = np.full(3 * self.system.total, np.nan)
        return row

    def _append(self, row: dict[str, Any]) -> None:
        self.writer.append(row)
        self.open, self._rows = True, self._rows + 1

    def _amend(self, report: StepReport) -> None:
        self.works.finish(report)
        if self._at_end:
            self.open = False  # nothing is missing
        if self.open:
            fields: dict[str, Any] = {
                "p": report.momentum,
                "constraint_force": report.constraint_force,
                "work_drives": self.works.drives,
            }
            if self._between:
                fields["constraint_point"] = report.constraint_point.ravel()
            self.writer.amend(**fields)
            self.open = False

    def take(self, report: StepReport) -> None:
        """A step is done: complete the row of its start, record its end if wanted."""
        self._amend(report)
        self.works.add(report)
        self.bank.take(self._before, report)
        self.iterations += report.all_iterations
        state = self._before = report.state
        force = report.constraint_force if self._at_end else None
        row = self._row(state, report.iterations, report.attempts, report.residual, force)
        if self.wanted(state, report.step):
            self._append(row)
            self.last = None
        else:
            self.last = row

    def row_of_event(self) -> int:
        """Number of the row of the present state, which is recorded."""
        if self.last is not None:
            self._append(self.last)
            self.last = None
        return self._rows - 1

    def switch(
        self, end: State, system: System, stepper: Stepper, state: State, loss: float
    ) -> None:
        """Go on with another state, and perhaps another system, at the same instant."""
        self.look_ahead(end, end.time + self.stepper.h)
        if system is not self.system:
            self.segments.append(Segment(self._rows, system))
        self.system, self.stepper = system, stepper
        self.works.go_on(stepper.integrator, system, state, stepper.h, loss)
        self.bank.go_on(system)
        self._before = state
        first = stepper.integrator.start_force(system, state, stepper.h)
        self._append(self._row(state, 0, 1, 0.0, first))

    def look_ahead(self, state: State, time: float) -> None:
        """Momentum and constraint force of the last state belong to the step after it."""
        if self.last is not None:
            self._append(self.last)
            self.last = None
        if self._at_end:
            self.open = False
            return
        try:
            self._amend(self.stepper.advance(state, time))
        except Diverged as error:
            logger.info("no step after t = %.6g s, momentum projected: %s", state.time, error)
        except _NO_STEP as error:  # loads and motions that are not known beyond the run
            logger.warning(
                "the step after t = %.6g s, which completes the last momentum, failed (%r):"
                " the momentum is projected, the last multipliers are NaN",
                *(state.time, error),
            )

    def close(self, status: str, failure: Diverged | None) -> History:
        """Close the file and give the history."""
        try:
            self.bank.flush()
        except (CosseratError, *_NO_STEP) as error:  # a user's function: the history is kept
            logger.warning("the last values of the sensors are missing: %s", error)
        if self.last is not None:
            self._append(self.last)
        if self.open:
            row = self.writer.history().last()
            if not np.isfinite(row["p"]).all():
                try:
                    p = Projection(self.system)(row["q"], row["carried"], float(row["t"]))[1]
                    self.writer.amend(p=p)
                except CosseratError as error:  # a singular configuration: p stays NaN
                    logger.warning("the last momentum could not be projected: %s", error)
        extra: dict[str, Any] = {
            "factorisations": self.stepper.factorisations,
            "newton_iterations": self.iterations,
        }
        if failure is not None:
            extra["failure"] = str(failure)
        if self.varying:
            extra["events"] = [event._asdict() for event in self.events]
        if len(self.segments) > 1:
            extra["segments"] = [
                {
                    "row": segment.row,
                    "fingerprint": fingerprint(segment.system),
                    "joints": [joint.label for joint in segment.system.joints],
                }
                for segment in self.segments
            ]
        extra |= self.more
        self.writer.close(status, **extra)
        self.closed = self.writer.history()
        return self.closed


class Numbered:
    """States of a run with equal steps: every k-th, or those nearest to given times.

    Parameters
    ----------
    state : State
        Where it starts.
    h : float
        Step size (s).
    count : int
        Steps.
    every, at
        See :func:`simulate`.
    """

    def __init__(
        self, state: State, h: float, count: int, every: int, at: Sequence[float] | None
    ) -> None:
        self._first, self._count, self._every = state.index, count, int(every)
        #: numbers asked for, in order; None: every k-th
        self._at = None if at is None else _numbers(state, h, count, every, at)

    def __call__(self, state: State, h: float) -> bool:
        """Whether a state is to be recorded."""
        k = state.index - self._first
        if self._at is None:
            return k % self._every == 0 or k == self._count
        place = int(np.searchsorted(self._at, k))
        return place < len(self._at) and int(self._at[place]) == k

    def ahead(self, state: State) -> int:
        """Steps to the next state that is recorded, or the last one; one from such a state.

        The step that follows a recorded state completes its row.
        """
        k = state.index - self._first
        if k == 0 or self(state, 0.0):
            return 1
        if self._at is None:
            return min(self._every - k % self._every, self._count - k)
        left = self._at[np.searchsorted(self._at, k) :]
        return int(left[0] if len(left) else self._count) - k


def timed(
    state: State, until: float, every: int, at: Sequence[float] | None, exact: bool
) -> Wanted:
    """The same where steps may differ; `exact`: steps end at the given times."""
    first = state.index
    if at is None:
        return lambda state, h: (state.index - first) % every == 0
    times = np.sort(_times(at, state.time, until, every))

    def wanted(state: State, h: float) -> bool:
        half = 1e-9 * h if exact else 0.5 * h
        return bool(((times > state.time - half) & (times <= state.time + half)).any())

    return wanted


def _times(at: Sequence[float], start: float, until: float, every: int) -> Floats:
    """Times asked for, within a run."""
    times = _asked(at, every)
    _check_inside(times, (times < start) | (times > until))
    return times


def _numbers(state: State, h: float, count: int, every: int, at: Sequence[float]) -> IndexArray:
    """Numbers of the steps nearest to times, in order."""
    times = _asked(at, every)
    k = np.rint((times - state.time) / h).astype(np.int64)
    _check_inside(times, (k < 0) | (k > count))
    return np.unique(k)


def _asked(at: Sequence[float], every: int) -> Floats:
    if every != 1:
        raise InputError("arguments every, at", f"{every} and {at}, expected only one of them")
    times = numbers("argument at", "at", at)
    if times.ndim != 1 or not np.isfinite(times).all():
        raise InputError("argument at", f"{at!r}, expected a list of times")
    return times


def _check_inside(times: Floats, outside: NDArray[np.bool_]) -> None:
    if outside.any():
        bad = float(times[outside][0])
        raise InputError("argument at", f"time {bad!r} s is outside of the run")
