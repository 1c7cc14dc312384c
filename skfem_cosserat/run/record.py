"""Record of a run: rows of its states, with the works since its start, and what sensors see."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from .. import checks
from ..analysis.describe import describe, recorded_turns, run_formulas, take_along
from ..constraints.saddle import nearest_momentum
from ..diagnostics import Projection
from ..diagnostics.energy import load_factors, strain_excess
from ..errors import (
    CosseratError,
    Diverged,
    HistoryError,
    IncompleteWarning,
    InputError,
    ModelWarning,
    StorageError,
)
from ..history import EventRecord, History, HistoryWriter
from ..history.writer import joined
from ..integrators import Block, Integrator, State, StepOrigin, Stepper, StepReport
from ..integrators.block import OF_USERS, force_at, forces_between
from ..model import System, takes_scene
from ..model.fingerprint import fingerprint, other_model
from ..model.limits import broken_constraint
from ..time_function import Constant
from ..types import FilePath, Floats, IndexArray, Meta, check_kind, numbers, positive
from ..warn import Notices, logger, warn
from .plan import StepControl
from .sensors import Sensor, SensorBank, checked_sensors

# -- work done since the start of a run ------------------------------------------------------------


class Works:
    """Sums of the works of all steps (J).

    Prescribed motion and drives work through the constraint forces: ``-(G^T lambda) . dq``. Where
    these act at the nodes, a step takes half of the force at its start and half of that at its
    end, one of which belongs to the step after it (or before it, where they act at its end).

    Attributes
    ----------
    sums : (4,) array
        Of loads and of actuators, what is dissipated, and the scheme's part of that.
    drives : float
        Of drives, as far as it is known.
    """

    def __init__(self) -> None:
        self.sums = np.zeros(4)
        self.drives = 0.0

    def begin(self, stepper: Stepper, state: State, loss: float = 0.0) -> None:
        """Start, or go on with another state or system at the expense of an energy."""
        weight = stepper.integrator.single.constraint_weight
        #: share of a step's own force, of that of the step after it and of that before it
        self._shares = (1.0, 0.0, 0.0) if weight == 0.5 else (0.5, (1 - weight) / 2, weight / 2)
        self._driven = bool(stepper.system.moving)
        self._q = state.q
        #: size, force and change of the last step, whose work the next force ends
        self._h = 0.0 if state.fresh or state.made_by is None else state.made_by.step
        self._change = np.zeros_like(state.q)
        self._force = self._change
        if self._driven and self._shares[2]:
            force = stepper.start_force(state)
            self._force = self._change if force is None else force
        self.sums[2] += loss

    def add(self, block: Block) -> tuple[Floats, Floats]:
        """Add the works of some steps.

        Returns
        -------
        (k, 4) array
            Sums after each of them.
        (k,) array
            Work of drives up to the start of each of them, which is known with it.
        """
        works = block.works[:, [0, 1, 2, 4]]
        works[:, 0] += _of_strains(block)
        # one after the other, whatever the length of blocks
        sums = np.cumsum([self.sums, *works], 0)[1:]
        self.sums = sums[-1]
        starts = np.full(len(block), self.drives)
        if self._driven:
            starts = self._drive(block.single)[:: len(block.single) // len(block)]
        return sums, starts

    def _drive(self, steps: Block) -> Floats:
        """Work of drives (k,) up to the start of each of some single steps."""
        own, after, before = self._shares
        changes = np.diff(steps.q, axis=0, prepend=self._q[None])
        sizes = np.append(self._h, steps.sizes)
        if steps.by_motion:
            forces = np.array([step.constraint_force for step in steps])
        elif after:  # an impulse at a node is over half of the step before it, too
            forces = 2 * steps.impulse / (sizes[1:] + sizes[:-1])[:, None]
        else:
            forces = steps.impulse / steps.sizes[:, None]
        earlier = np.concatenate([self._force[None], forces[:-1]])
        known = (
            steps.works[:, 3] - own * _along(forces, changes) - before * _along(earlier, changes)
        )
        ended = after * _along(forces, np.concatenate([self._change[None], changes[:-1]]))
        # one after the other, whatever the length of blocks
        sums = np.cumsum([self.drives, *np.column_stack([-ended, known]).ravel()])[1:]
        self.drives = float(sums[-1])
        self._h, self._force, self._change, self._q = (
            sizes[-1],
            forces[-1],
            changes[-1],
            steps.q[-1],
        )
        return sums[::2]

    def finish(self, force: Floats | None = None) -> None:
        """End the work of the last step by the force of its end; by default its own force."""
        if self._driven:
            force = self._force if force is None else force
            self.drives -= self._shares[1] * float(_along(force, self._change))
            self._change = np.zeros_like(self._change)


def _of_strains(block: Block) -> Floats | float:
    """Work (k,) that loads by strains do beside that of the forces which steps have for them (J).

    The stresses of a step that is no discrete derivative do not belong to the mean of the strains
    at its ends; what a strain without stress takes is by those that it meets.
    """
    system = block.system
    scheme = block.integrator.scheme(1.0)
    if not system.loading.strained or scheme is None or scheme.ends:
        return 0.0
    steps = block.single
    q = np.concatenate([block.start.q[None], steps.q])
    t = np.concatenate([[block.start.time], steps.times])
    change = np.diff(load_factors(system, t, None, len(t)), axis=0)

    first, last, middle = (
        strain_excess(system, each, amplitudes=change)
        for each in (q[:-1], q[1:], 0.5 * (q[1:] + q[:-1]))
    )
    missed = (middle - 0.5 * (first + last)) * (-2.0 if scheme.at_end else 1.0)
    return missed.reshape(len(block), -1).sum(1)


def _along(force: Floats, change: Floats) -> Floats:
    """Work of forces; the sum does not depend, as of BLAS, on where in memory they begin."""
    return (force * change).sum(-1)


# -- which states are recorded, and when a row of the history is complete --------------------------

#: whether states are to be recorded, by their indices, their times and the sizes of the steps that
#: led to them
Wanted = Callable[[IndexArray, Floats, Floats], Any]


#: rows that are written, and that sensors look at, together
TOGETHER = 50


class Segment(NamedTuple):
    """Rows of a history from `row` on that belong to a system."""

    row: int
    system: System


class Record:
    """States of a run, one after the other, and their rows in its history.

    A row is written when it is complete, with the step after it: that tells the constraint force
    and the momentum at the state, and the work of drives up to it.
    """

    def __init__(
        self,
        stepper: Stepper,
        state: State,
        wanted: Wanted,
        path: FilePath | None,
        sensors: Mapping[str, Sensor] | None,
        varying: bool,
        notices: Notices,
    ):
        self.system, self.stepper, self.notices = stepper.system, stepper, notices
        self.wanted = wanted
        #: size of the steps now (s)
        self.h = stepper.h
        #: steps may differ in size: it is recorded
        self.varying = varying
        self.segments = [Segment(0, self.system)]
        self.events = list[EventRecord]()
        #: metadata of the history beside what is recorded
        self.more: Callable[[], Meta] = dict
        meta, static = describe(self.system)
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
        checked = checked_sensors(sensors, self.system, state)
        if checked:
            meta["sensors"] = {
                name: {"unit": sensor.unit, "derivative": sensor.derivative}
                for name, sensor in checked.items()
            }
        self.writer = HistoryWriter(meta, static, path)
        self.bank = SensorBank(checked, self.writer)
        self.works = Works()
        self.iterations = 0
        self._complete: History | None = None
        self._status = "failed"
        self._finished: Mapping[str, Any] = {}
        self.closed: History | None = None
        #: rows so far, with those that wait
        self._rows = 0
        self._excess = strain_excess(self.system, state.q[None], state.time)
        #: what the turns of all rows are named after
        self._first = self.system.couplings
        self._begin(state)

    def _begin(self, state: State, loss: float = 0.0) -> None:
        """Start with a state that no step led to, which is recorded."""
        system = self.system
        integrator = self.stepper.integrator
        self.works.begin(self.stepper, state, loss)
        self._start = state
        self._at_end = integrator.constraint_weight == 1
        #: the first and the last three steps since then
        self._early: list[StepReport] = []
        self._late: list[StepReport] = []
        none = np.full((integrator.remembered, system.n), np.nan)
        size = np.nan if state.made_by is None else state.made_by.step
        self._end = state
        #: rows of states that wait for the force of the start, and the present state
        self._waiting: list[dict[str, Any]] = []
        self._state = self._row(
            np.array([state.time]),
            np.array([state.index]),
            state.q[None],
            state.p[None],
            (system.couplings.untouched if state.turns is None else state.turns)[None],
            (none if state.rates is None else state.rates)[None],
            np.array([size]),
            np.array([[0, 1]]),
            np.zeros(1),
            self.works.sums[None],
        )
        self._state["fresh"][0] = float(state.fresh)
        self._state["wanted"][0] = True

    def _row(
        self,
        times: Floats,
        index: IndexArray,
        q: Floats,
        p: Floats,
        turns: IndexArray,
        rates: Floats,
        sizes: Floats,
        counts: IndexArray,
        residual: Floats,
        sums: Floats,
    ) -> dict[str, Any]:
        """Rows of some states, as far as they are known without the step after each."""
        rows = {
            "t": times,
            "step": index,
            "q": q,
            "p": p,
            "carried": p,
            "fresh": np.zeros(len(times)),
            "constraint_force": np.full(q.shape, np.nan),
            "newton_iterations": counts[:, 0],
            "attempts": counts[:, 1],
            "residual": residual,
            "work_loads": sums[:, 0] + strain_excess(self.system, q, times) - self._excess,
            "work_actuators": sums[:, 1],
            "work_drives": np.full(len(times), np.nan),
            "dissipated": sums[:, 2],
            "dissipated_by_scheme": sums[:, 3],
            "wanted": np.broadcast_to(self.wanted(index, times, sizes), len(times)).copy(),
        }
        if self._first.turning:
            rows["turns"] = self._first.named(self.system.couplings.turning, turns)
        if self.varying:
            rows["step_size"] = sizes
        if self.stepper.integrator.remembered:
            rows["rates"] = rates
        return rows

    def add(self, block: Block) -> None:
        """Add solved steps: rows are complete up to the start of the last one."""
        sums, drives = self.works.add(block)
        ends = self._row(
            block.times,
            block.start.index + 1 + np.arange(len(block)),
            block.q,
            block.p,
            block.turns,
            block.rates,
            block.sizes,
            np.column_stack([block.iterations, block.attempts]),
            block.residual,
            sums,
        )
        done = {
            name: np.concatenate([values, ends[name][:-1]]) for name, values in self._state.items()
        }
        self._state = {name: values[-1:] for name, values in ends.items()}
        done["work_drives"] = drives
        # that of a start is found when its rows are written
        done["constraint_force"] = forces_between(self._late[-1] if self._late else None, block)
        if not self.stepper.integrator.carries_node_momentum:
            if block.by_motion:
                done["p"] = np.array([step.momentum for step in block])
            else:
                whole = done["fresh"][:, None] > 0  # a given momentum is that of the node
                done["p"] = np.where(whole, done["carried"], done["carried"] - 0.5 * block.impulse)
        last = [block[k] for k in range(max(0, len(block) - 3), len(block))]
        if len(self._early) < 3:
            self._early += [block[k] for k in range(min(3 - len(self._early), len(block)))]
        self._late = [*self._late, *last][-3:]
        self.iterations += int(block.iterations.sum())
        self._end = block.state
        self._rows += int(done["wanted"].sum())
        self._waiting.append(done)
        if sum(len(each["t"]) for each in self._waiting) >= TOGETHER:
            self._write()

    def _write(self) -> None:
        """Write rows that wait; the force of the start is known by now."""
        rows = joined(self._waiting)
        self._waiting = []
        if rows["step"][0] == self._start.index:
            rows["constraint_force"][0] = self._start_force()
        wanted = rows["wanted"]
        try:
            if wanted.any():
                kept = {name: values[wanted] for name, values in rows.items() if name != "wanted"}
                self.writer.extend(kept)
        finally:  # of a full disk: nothing is lost
            self.bank.look(self.system, rows)

    def _start_force(self) -> Floats:
        """Constraint force of the state that the steps started from."""
        own = self.stepper.start_force(self._start, self.h)
        if own is not None:
            return own
        return force_at(self._start, self.stepper.integrator.single, self.system, self._early)

    def _finish(self) -> None:
        """Complete the row of the present state, which no step follows, and write all."""
        row = self._state
        state = self._end
        if row is self._finished:  # and could not be written
            return
        self._finished = row
        if self._late:
            force = force_at(state, self.stepper.integrator.single, self.system, self._late)
        else:
            force = self._start_force()
        row["constraint_force"][0] = force
        if not self._at_end:
            self.works.finish(force if np.isfinite(force).all() else None)
        row["work_drives"][0] = self.works.drives
        row["wanted"][0] = True
        if not (state.fresh or self.stepper.integrator.carries_node_momentum):
            try:
                row["p"] = Projection(self.system)(state.q, state.p, state.time)[1][None]
            except CosseratError as error:  # a singular configuration
                row["p"] = np.full_like(row["p"], np.nan)
                text = f"its momentum could not be projected: {error}"
                warn("last state", text, IncompleteWarning, state.time)
        self._rows += 1
        self._waiting.append(row)
        self._write()

    def __enter__(self) -> Record:
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
                return self.close(self._status, None)
            except StorageError:
                raise
            except Exception as other:  # noqa: BLE001, of a user's own class: what is there is kept
                logger.info("the last state is not completed: %s", other)
                if not self.writer.closed:
                    self.writer.close("failed")
        return self.writer.history()

    def row_of_event(self) -> int:
        """Number of the row of the present state, which is recorded."""
        self._state["wanted"][0] = True
        return self._rows

    def switch(self, stepper: Stepper, state: State, h: float, loss: float) -> None:
        """Go on with another state, and perhaps another system, by steps of a size (s)."""
        self._finish()
        if stepper.system is not self.system:
            self.segments.append(Segment(self._rows, stepper.system))
        self.note()
        self.system, self.stepper, self.h = stepper.system, stepper, h
        self._begin(state, loss)

    def note(self) -> None:
        """Write events and warnings so far into the file at once."""
        self.writer.note(**self._happened(), warnings=self.notices.kept())

    def _happened(self) -> Meta:
        """Events so far, and the systems that rows belong to, as meta data."""
        meta = {}
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
        if self._complete is None:
            try:
                self._finish()
            except StorageError:
                raise
            except (CosseratError, *OF_USERS) as error:  # a user's function: the history is kept
                warn("sensors", f"their last values are missing: {error}", IncompleteWarning)
            self._complete = self.writer.history()
        return self._complete

    def close(self, status: str, failure: Diverged | None) -> History:
        """Close the file and give the history, with warnings of all that is doubtful about it."""
        self._status = status  # a full disk may be met from here on
        history = self.complete()
        extra = {
            "factorisations": self.stepper.factorisations,
            "newton_iterations": self.iterations,
            **self._happened(),
            **self.more(),
        }
        history.meta |= {**extra, "status": status}
        systems = [segment.system for segment in self.segments]
        history.derive_by(systems, run_formulas)  # for the checks
        run = checks.Run(systems, history)
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


# -- which states are wanted -----------------------------------------------------------------------


def wanted_states(
    state: State,
    until: float,
    every: int,
    at: Sequence[float] | None,
    h: float,
    exact: bool,
) -> Wanted:
    """States that a run from a state has recorded: every k-th, or those nearest to given times.

    Steps have about the size h (s); with `exact` they end at the given times.
    """
    if at is None:
        return lambda index, time, sizes: (index - state.index) % every == 0
    if every != 1:
        raise InputError("arguments every, at", f"{every} and {at}, expected only one of them")
    times = np.sort(numbers("argument at", "at", at))
    if times.ndim != 1 or not np.isfinite(times).all():
        raise InputError("argument at", f"{at!r}, expected a list of times")
    share = 1e-9 if exact else 0.5
    outside = times[(times < state.time - share * h) | (times > until + share * h)]
    if len(outside):
        raise InputError("argument at", f"time {float(outside[0])!r} s is outside of the run")

    def wanted(index: IndexArray, time: Floats, sizes: Floats) -> Any:
        # of times in the middle of two states none is lost by rounding
        first, last = (
            np.searchsorted(times, time + k * sizes, "right") for k in (-share * (1 + 1e-9), share)
        )
        return last > first

    return wanted


# -- the last state of a record, to go on from -----------------------------------------------------


@takes_scene
def restart(
    system: System, history: History, integrator: Integrator, step: float | StepControl
) -> State:
    """State to go on from the last one of a history.

    With the integrator and step of the history the run continues as if it had not stopped; with
    another step or integrator it starts from (q, p) of the discrete Legendre transform, projected
    on the hidden constraints. Loads may differ from those of the history: they are no part of the
    state.

    Parameters
    ----------
    system : Model or System
        Of the same model; where events have changed it, that of the last state, which
        :func:`after_events` gives.
    history : History
        Of a run, also one that diverged or was killed; ``history.truncated(k + 1)`` goes on from
        its state k.
    integrator : Integrator
        Of the run that goes on.
    step : float or StepControl
        Its step size (s), or control.

    Returns
    -------
    State
        For the argument ``start`` of :func:`simulate` and :func:`steps`.

    Raises
    ------
    HistoryError
        If the history belongs to another model or has no state.

    Examples
    --------
    >>> from skfem_cosserat import MassPoint, Model, NullSpace, Variational, simulate
    >>> model = Model()
    >>> ball = model.add("ball", MassPoint(2.0, velocity=(1.0, 0, 0)))
    >>> system, scheme = model.freeze(), Variational()
    >>> first = simulate(system, scheme, NullSpace(), 0.1, until=0.5)
    >>> start = restart(system, first, scheme, 0.05)   # goes on with half the step
    >>> simulate(system, scheme, NullSpace(), 0.05, until=1.0, start=start).times[[0, -1]].tolist()
    [0.5, 1.0]
    """
    check_kind("argument integrator", integrator, Integrator)
    if not isinstance(step, StepControl):
        step = positive("argument step", "step", step, " of seconds, or a StepControl")
    if len(history) == 0:
        raise HistoryError("history", "has no state to go on from")
    last = max(k for k, (first, _) in enumerate(history.segments) if first < len(history))
    difference = other_model(system, history.segment(last).meta.get("fingerprint", {}))
    if difference:
        raise HistoryError("history", f"belongs to another model: {difference}")
    row = history.last()
    # the end of a path of static(): loads and motions go on from its load factor
    t = float(history.instants[-1])
    index = int(row["step"])
    y = system.extend(np.array(row["q"]), t)
    wrong = broken_constraint(system, y, 1e-6)
    if wrong:
        raise HistoryError("history", f"belongs to another model: its last state {wrong}")
    on_path = history.meta["integrator"] == "static" and history.meta.get("time") is None
    times = *system.loading.times, *system.couplings.times
    varies = bool(system.moving) or any(not isinstance(time, Constant) for time in times)
    if on_path and varies:
        text = (
            f"the path ends at t = {t:g} s by its load factor, loads or supports depend on time:"
            " equilibrium(model, path, time=...) starts when you say"
        )
        warn("argument history", text, ModelWarning, t)
    q = np.array(row["q"])
    same = history.meta["integrator"] == integrator.name
    size = float(row["step_size"]) if "step_size" in row else float(history.meta["step"])
    if not isinstance(step, StepControl):
        same = same and np.isclose(history.meta["step"], step, rtol=1e-12, atol=0)
    turns = recorded_turns(system, history)
    if same:
        carried = {"rates": np.array(row["rates"])} if "rates" in row else {}
        if any(np.isnan(each).any() for each in carried.values()):
            carried = {}
        origin = None if np.isnan(size) else StepOrigin(integrator.name, size)
        p = np.array(row["carried"])
        return State(t, index, q, p, bool(row["fresh"]), turns, carried, origin)
    p = np.array(row["p"])
    if not np.isfinite(p).all():
        p = np.array(row["carried"])
    factor = float(row["load_factor"]) if "load_factor" in row else None
    return State(t, index, q, nearest_momentum(system, y, p, t), turns=turns, load_factor=factor)
