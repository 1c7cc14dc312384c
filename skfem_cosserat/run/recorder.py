"""What a run records of its states, with the works since its start."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from .. import checks
from ..diagnostics import Projection
from ..errors import (
    CosseratError,
    Diverged,
    IncompleteWarning,
    InputError,
    StorageError,
)
from ..history import EventRecord, History, HistoryWriter
from ..integrators import Integrator, State, Stepper, StepReport
from ..integrators.report import (
    OF_USERS,
    BlockReport,
    StateForces,
    forces_of_states,
)
from ..model import System
from ..model.fingerprint import fingerprint
from ..types import FilePath, Floats, IndexArray, numbers
from ..warn import Notices, logger, warn
from .describe import SystemSeries, describe, kind_of
from .sensors import BLOCK, Sensor, SensorBank, checked_sensors

# -- work done since the start of a run -----------------------------------------------------------


class Works:
    """Sums of the works of all steps.

    Prescribed motion and drives work through the constraint forces: ``-(G^T lambda) . dq``. Where
    these act at the nodes, a step takes half of the force at its start and half of that at its
    end, one of which belongs to the step after it (or before it, where they act at its end).
    """

    def __init__(self, system: System, integrator: Integrator, state: State, h: float) -> None:
        self._begin(system, integrator, state, h)
        self.loads = self.actuators = self.dissipated = self.drives = 0.0
        #: what the scheme took of what was dissipated (J)
        self.numerical = 0.0

    def _begin(self, system: System, integrator: Integrator, state: State, h: float) -> None:
        self._driven = bool(system.moving)
        one = integrator.single
        weight = one.constraint_weight
        #: of a step's own force, of that of the step after it and of that before it
        self._own, self._next = (1.0, 0.0) if weight == 0.5 else (0.5, float(weight == 0) / 2)
        self._before = 1 - self._own - self._next
        self._q = state.q
        wanted = self._driven and self._before > 0
        self._last = one.balance(system, h).start_force(state) if wanted else None
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
                self.finish(force)
            self._add(stage, force)
            before = stage

    def add_block(self, report: BlockReport) -> Floats:
        """Steps in one go are done; :meth:`finish` has had the report of the first one before.

        Returns
        -------
        (5, steps) array
            After each of them: work of the loads, of actuators and of drives, what is dissipated,
            and the scheme's part of it.
        """
        begun = self.loads, self.actuators, self.dissipated, self.numerical
        loads, actuators, dissipated, _, numerical = report.block.works.T
        added = np.c_[begun, (loads, actuators, dissipated, numerical)]
        sums: Floats = np.cumsum(added, axis=1)[:, 1:]
        self.loads, self.actuators, self.dissipated, self.numerical = sums[:, -1].tolist()
        drives = self._drives_along(report) if self._driven else [self.drives] * report.steps
        self._q = report.state.q
        return np.insert(sums, 2, drives, axis=0)

    def _drives_along(self, report: BlockReport) -> list[float]:
        """Work of drives after each of several steps, each with what the next one makes of it."""
        block, out = report.block, list[float]()
        changes = np.diff(block.q, axis=0, prepend=self._q[None])
        forces = block.impulse.reshape(changes.shape) / report.step
        forces[0] = report.part(0).constraint_force  # at a start it may be over half a step
        for k, (force, change) in enumerate(zip(forces, changes, strict=True)):
            if k:
                self.finish(force)
                out.append(self.drives)
            self._add_drives(float(block.works[k, 3]), force, change)
        return [*out, self.drives]

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
        self.numerical += work.numerical
        if force is not None:
            self._add_drives(work.ground, force, q - self._q)
        self._q = q

    def _add_drives(self, ground: float, force: Floats, change: Floats) -> None:
        """Work of drives along a change of q, and what the ground does through force elements."""
        self.drives += ground - self._own * _along(force, change)
        if self._last is not None:
            self.drives -= self._before * _along(self._last, change)
            self._last = force
        self._waiting = change if self._next else None

    def finish(self, force: Floats | None) -> None:
        """The constraint force of the step that follows ends the work of the last one."""
        if self._waiting is not None and force is not None:
            self.drives -= self._next * _along(force, self._waiting)
            self._waiting = None

    @property
    def known_drives(self) -> float:
        """Work of drives (J); NaN while a part of it is unknown."""
        return self.drives if self._waiting is None else np.nan


def _along(force: Floats, change: Floats) -> float:
    """Work of a force; the sum does not depend, as of BLAS, on where in memory they begin."""
    return float((force * change).sum())


# -- which states are recorded, and when a row of the history is complete --------------------------

#: recorded states after which what sensors saw is written, so that a killed run keeps it, too
SEEN = 50

#: whether states are to be recorded, by indices and times, one or an array of each, and by the size
#: of the step that led to it
Wanted = Callable[[Any, Any, float], Any]


class Segment(NamedTuple):
    """Rows of a history from `row` on that belong to a system."""

    row: int
    system: System


def take_along(
    error: BaseException, so_far: Callable[[], History], systems: Sequence[System]
) -> None:
    """Give an error of the user's own code, or of a full disk, the history as ``error.history``.

    `so_far` closes what is still open, which may meet a full disk in its turn; series follow from
    the `systems`.
    """
    history: History
    try:
        with Notices(quiet=True):  # the error is said, its history has the warnings
            history = so_far()
    except StorageError as full:
        history = full.history
        if full is not error:
            error.add_note(str(full))
    history.derive_by(SystemSeries(systems, kind_of(history)))
    error.history = history  # type: ignore[attr-defined]
    if not isinstance(error, StorageError):
        error.add_note(f"the history up to t = {history.times[-1]:.6g} is in .history")


class Recorder:
    """Decides what is recorded and writes it."""

    def __init__(
        self,
        system: System,
        stepper: Stepper,
        state: State,
        wanted: Wanted,
        path: FilePath | None,
        sensors: Mapping[str, Sensor] | None,
        varying: bool,
        notices: Notices,
        expected: int | None = None,
    ) -> None:
        self.system, self.stepper, self.notices = system, stepper, notices
        self.wanted = wanted
        #: size of the steps now (s)
        self.h = stepper.h
        #: steps may differ in size: it is recorded
        self.varying = varying
        self.segments, self.events = [Segment(0, system)], list[EventRecord]()
        #: what the metadata of the history are to say beside what is recorded
        self.more: Callable[[], dict[str, Any]] = dict
        self._angles = system.couplings.turning
        meta, static = describe(system)
        meta |= {
            "integrator": stepper.integrator.name,
            "treatment": stepper.treatment.name,
            "step": stepper.h,
            "shares": list(stepper.integrator.shares),
            "scheme": checks.motion.facts(stepper.integrator),
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
        self.writer = HistoryWriter(meta, static, path, expected=expected)
        self.iterations = 0
        self._complete: History | None = None
        self.closed: History | None = None
        self.bank = SensorBank(bank, self.writer)
        self._rows = 0
        #: rows that wait for the force of the state the run started from
        self._held: list[dict[str, Any]] = []
        self._start(state)
        self.bank.begin(state)

    def _start(self, state: State) -> None:
        """Begin with a state that no step led to, which is recorded."""
        integrator = self.stepper.integrator
        #: whether a step's constraint force acts at its end
        self._at_end = integrator.constraint_weight == 1
        self._carries, self._remembered = integrator.carries_node_momentum, integrator.remembered
        self._nan = np.full(self.system.n, np.nan)
        self._before = state
        #: the row of the present state, and whether it is to be recorded: it is written when the
        #: step after it has completed it
        force = self.stepper.start_force(state, self.h)
        self._forces = StateForces(integrator, self.system, state, force)
        self._row = self._row_of(state, 0, 1, 0.0, force)
        self._first = self._row
        self._kept = True
        self.bank.go_on(self._forces)

    def __enter__(self) -> Recorder:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: object
    ) -> None:
        """An error of the user's own code takes the history so far along as ``error.history``."""
        if error is not None:
            take_along(error, self._so_far, [segment.system for segment in self.segments])
        self.more = dict  # it may refer to what has this

    def _so_far(self) -> History:
        if self.closed is not None:
            return self.closed
        if not self.writer.closed:
            try:
                return self.close("failed", None)
            except StorageError:
                raise
            except Exception as other:  # noqa: BLE001, of a user's own class: what is there is kept
                logger.info("the last state is not completed: %s", other)
                if not self.writer.closed:
                    self.writer.close("failed")
        return self.writer.history()

    def _row_of(
        self,
        state: State,
        iterations: int,
        attempts: int,
        residual: float,
        force: Floats | None = None,
    ) -> dict[str, Any]:
        known = state.fresh or self._carries
        works = self.works
        row: dict[str, Any] = {
            "t": state.time,
            "step": state.index,
            "q": state.q,
            "p": state.p if known else self._nan,
            "carried": state.p,
            "fresh": float(state.fresh),
            "constraint_force": self._nan if force is None else force,
            "newton_iterations": iterations,
            "attempts": attempts,
            "residual": residual,
            "work_loads": works.loads,
            "work_actuators": works.actuators,
            "work_drives": works.known_drives,
            "dissipated": works.dissipated,
            "dissipated_by_scheme": works.numerical,
        }
        if self._angles:
            none = np.zeros(len(self._angles), dtype=np.int64)
            row["turns"] = none if state.turns is None else state.turns
        if self.varying:
            row["step_size"] = np.nan if state.made_by is None else state.made_by.step
        if self._remembered:
            none = np.full((self._remembered, self.system.n), np.nan)
            row["rates"] = none if state.rates is None else state.rates
        return row

    def _append_last(self, force: Floats) -> None:
        """Record the present state, and what waits for steps that will not come."""
        row, self._row = self._row, {}
        self._first["constraint_force"] = self._forces.start
        if row:
            self._finish_row(row, force)
        self._record(row, kept=True)

    def _end(self) -> Floats:
        """The force of the present state, which sensors see, too; steps come no more."""
        end = self._forces.end()
        self.bank.note(None if self._at_end else end)
        return end[1]

    def _finish_row(self, row: dict[str, Any], force: Floats) -> None:
        """Force, momentum and work of the last state, as far as a step after it would tell them."""
        if not self._at_end:
            row["constraint_force"] = force
            self.works.finish(force)
            row["work_drives"] = self.works.drives
        if not np.isfinite(row["p"]).all():
            try:
                row["p"] = Projection(self.system)(row["q"], row["carried"], row["t"])[1]
            except CosseratError as error:  # a singular configuration: p stays NaN
                text = f"its momentum could not be projected: {error}"
                warn("last state", text, IncompleteWarning, row["t"])

    def _record(self, row: dict[str, Any], kept: bool) -> None:
        if row and kept:
            self._rows += 1
            self._held.append(row)
        if self._forces.start is None or not self._held:
            return
        rows, self._held = self._held, []
        for each in rows:
            self.writer.append(each)
        if self._rows % SEEN == 0:
            self.bank.flush()

    def _complete_row(self, report: StepReport) -> None:
        """What a step says of the state that it starts from."""
        self.works.finish(report.stages[0].constraint_force)
        row, wanted = self._row, self._kept and not self._at_end
        found = self._forces.take(report, wanted or self.bank.forces)
        self.bank.note(found)
        if found is not None and wanted:
            row["constraint_force"] = found[1]
        if self._forces.start is not None:
            self._first["constraint_force"] = self._forces.start
        if wanted:
            if not self._carries:
                row["p"] = report.momentum
            row["work_drives"] = self.works.drives

    def take(self, report: StepReport) -> None:
        """Steps are done: write rows of their start and in between, and make that of their end."""
        block = report if isinstance(report, BlockReport) else None
        every = block is not None and len(block.block.q) == block.steps
        self._complete_row(report.part(0) if every else report)
        start, between = (self._row, self._kept), None
        if block is not None:
            last = range(max(1, block.steps - 3), block.steps)
            if self.bank.forces:
                for k in range(1, block.steps):
                    self.bank.note(self._forces.take(block.part(k)))
            else:
                self._forces.skip(block.part(k) for k in last)
            sums = self.works.add_block(block)
            between = self._between(block, sums) if every else None
        else:
            self.works.add(report)
        self.bank.take(report)
        self.iterations += report.all_iterations
        state = self._before = report.state
        force = None
        if self._at_end:
            force = report.constraint_force
        self._row = self._row_of(state, report.iterations, report.attempts, report.residual, force)
        self._kept = bool(self.wanted(state.index, state.time, report.step))
        self._record(*start)
        if between is not None:
            self._rows += len(between["t"])
            self.writer.extend(between)
        self.bank.flush(BLOCK)  # at last, as an own sensor may raise

    def _between(self, report: BlockReport, sums: Floats) -> dict[str, Any] | None:
        """Rows of the states between steps that were solved in one go, by arrays; None: no rows.

        `sums`: see :meth:`Works.add_block`.

        The same as of single steps: see :meth:`_row_of` for what is in a row, and
        :meth:`_complete_row` for what the step after a state says of it.
        """
        first = report.part(0).state.index
        index = np.arange(first, first + report.steps - 1)
        k = np.flatnonzero(self.wanted(index, report.times[:-1], report.step))
        if not len(k):
            return None
        block, integrator = report.block, self.stepper.integrator
        # as slices: no copies
        own, after = (slice(0, -1), slice(1, None)) if len(k) == len(index) else (k, k + 1)
        h, impulse = report.step, block.impulse.reshape(report.steps, -1)
        p = block.p[own]
        force = forces_of_states(integrator, h, impulse[own], impulse[after])
        count = len(k)
        rows = {
            "t": report.times[own],
            "step": index[k],
            "q": block.q[own],
            "p": p if self._carries else p - 0.5 * impulse[after],
            "carried": p,
            "fresh": np.zeros(count),
            "constraint_force": force,
            "newton_iterations": block.iterations[own],
            "attempts": np.ones(count, dtype=np.int64),
            "residual": block.residual[own],
            "work_loads": sums[0, own],
            "work_actuators": sums[1, own],
            "work_drives": sums[2, own],
            "dissipated": sums[3, own],
            "dissipated_by_scheme": sums[4, own],
        }
        if self._angles:
            rows["turns"] = block.turns[own]
        if self.varying:
            rows["step_size"] = np.full(count, h)
        if self._remembered:
            rows["rates"] = block.rates[own]
        return rows

    def row_of_event(self) -> int:
        """Number of the row of the present state, which is recorded."""
        self._kept = True
        return self._rows

    def switch(self, system: System, stepper: Stepper, state: State, h: float, loss: float) -> None:
        """Go on with another state, and perhaps another system, by steps of a size (s)."""
        self._append_last(self._end())
        if system is not self.system:
            self.segments.append(Segment(self._rows, system))
        self.note()
        self.system, self.stepper, self.h = system, stepper, h
        self.works.go_on(stepper.integrator, system, state, h, loss)
        self._start(state)

    def note(self) -> None:
        """Write events and warnings so far into the file at once."""
        self.writer.note(**self._happened(), warnings=self.notices.kept())

    def _happened(self) -> dict[str, Any]:
        """Events so far, and the systems that rows belong to, as meta data."""
        meta: dict[str, Any] = {}
        if self.varying:
            meta["events"] = [event._asdict() for event in self.events]
        if len(self.segments) > 1:
            meta["segments"] = [
                {
                    "row": segment.row,
                    "fingerprint": fingerprint(segment.system),
                    "joints": [joint.label for joint in segment.system.joints],
                }
                for segment in self.segments
            ]
        return meta

    def complete(self) -> History:
        """All rows, the last one with all that can be known of it; the file is not closed."""
        if self._complete is not None:
            return self._complete
        force = self._end()
        try:
            self.bank.flush()
        except StorageError:
            raise
        except (CosseratError, *OF_USERS) as error:  # a user's function: the history is kept
            warn("sensors", f"their last values are missing: {error}", IncompleteWarning)
        self._append_last(force)
        self._complete = self.writer.history()
        return self._complete

    def close(self, status: str, failure: Diverged | None) -> History:
        """Close the file and give the history, with warnings of all that is doubtful about it."""
        history = self.complete()
        extra: dict[str, Any] = {
            "factorisations": self.stepper.factorisations,
            "newton_iterations": self.iterations,
            **self._happened(),
            **self.more(),
        }
        history.meta |= {**extra, "status": status}
        run = checks.Run([segment.system for segment in self.segments], history)
        extra |= run.numbers()
        if failure is not None:
            failure.hint = run.hint
            extra["failure"] = str(failure)
        try:
            checks.apply(run)
        finally:  # a warning is an error, if the user wants it so
            self.writer.close(status, **extra, warnings=self.notices.kept())
            history.meta = self.writer.meta
            self.closed = history
        return history


#: of so many steps one state is recorded, where it costs more to keep those in between
SPARSE = 16


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
    seen : bool
        Whether sensors see every state.
    """

    def __init__(
        self,
        state: State,
        h: float,
        count: int,
        every: int,
        at: Sequence[float] | None,
        seen: bool = False,
    ) -> None:
        self._first, self._count, self._every = state.index, count, int(every)
        self._seen = seen
        #: numbers asked for, in order, and one that no run has; None: every k-th
        self._at: IndexArray | None = None
        if at is not None:
            ends = state.time - 0.5 * h, state.time + (count + 0.5) * h
            places = np.rint((_asked(at, every, *ends) - state.time) / h).astype(np.int64)
            self._at = np.append(np.unique(places), np.iinfo(np.int64).max)

    @property
    def rows(self) -> int:
        """How many states are recorded, if all steps are solved; some more at most."""
        return (self._count // self._every if self._at is None else len(self._at)) + 2

    def _next(self, k: Any, later: int = 0) -> Any:
        """The first number that is asked for from the k-th on, or one so many later."""
        if self._at is None:
            return (-(-k // self._every) + later) * self._every
        return self._at[np.minimum(np.searchsorted(self._at, k) + later, len(self._at) - 1)]

    def __call__(self, index: Any, time: Any, h: float) -> Any:
        """Whether states are to be recorded."""
        k = index - self._first
        return (self._next(k) == k) | (self._at is None and k == self._count)

    def ahead(self, state: State) -> tuple[int, bool]:
        """Steps that may be taken in one go, and whether states between them are kept.

        If few are, they end where one is, and the step after it, which completes its row, is taken
        alone; as are the first three, which complete that of the start.
        """
        k = state.index - self._first
        if k >= 3 and (self._seen or self._next(k, SPARSE) - k < SPARSE * SPARSE):
            return self._count - k, True
        if k < 3 or self(state.index, state.time, 0.0):
            return 1, False
        return min(int(self._next(k)), self._count) - k, False


def timed(
    state: State, until: float, every: int, at: Sequence[float] | None, exact: bool
) -> Wanted:
    """The same where steps may differ; `exact`: steps end at the given times."""
    first = state.index
    if at is None:
        return lambda index, time, h: (index - first) % every == 0
    times = np.sort(_asked(at, every, state.time, until))

    def wanted(index: Any, time: Any, h: float) -> Any:
        half = 1e-9 * h if exact else 0.5 * h
        upto = np.searchsorted(times, time + half, "right")
        return upto > np.searchsorted(times, time - half, "right")

    return wanted


def _asked(at: Sequence[float], every: int, start: float, end: float) -> Floats:
    """Times asked for, which are within a run."""
    if every != 1:
        raise InputError("arguments every, at", f"{every} and {at}, expected only one of them")
    times = numbers("argument at", "at", at)
    if times.ndim != 1 or not np.isfinite(times).all():
        raise InputError("argument at", f"{at!r}, expected a list of times")
    outside = times[(times < start) | (times > end)]
    if len(outside):
        raise InputError("argument at", f"time {float(outside[0])!r} s is outside of the run")
    return times
