"""Runs: the loop over steps, and the functions that users call."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..analysis.describe import checked_asked, finish, run_formulas
from ..analysis.progress import Interrupt, Progress
from ..analysis.start import consistent_start, initial_state
from ..checks.motion import energies
from ..constraints import Treatment
from ..diagnostics import Projection
from ..diagnostics.energy import strain_excess
from ..errors import Diverged, InputError
from ..history import EventRecord, History
from ..integrators import Block, Integrator, State, Stepper, StepReport
from ..linear import Solver
from ..model import System, takes_scene
from ..newton import NewtonSettings
from ..types import MOST, Array, FilePath, positive, real, whole
from ..warn import Notices, logger
from .conditions import ActionOutcome
from .events import Event, EventMonitor, Found, checked_events
from .plan import ControlledSteps, FixedSteps, Plan, StepControl, StepperFactory
from .record import Record, wanted_states
from .sensors import Sensor, View

# -- the loop of a run: steps, events and what they change, until the end --------------------------

Callback = Callable[[StepReport], object]


@dataclass
class RunLoop:
    """Run and its parts.

    Attributes
    ----------
    factory : StepperFactory
    plan : Plan
    record : Record
    callbacks : sequence of callable
    show : callable
        Gets the time after each block of steps.
    interrupt : Interrupt
    watch : EventMonitor or None
        None: there are no events.
    """

    factory: StepperFactory
    plan: Plan
    record: Record
    callbacks: Sequence[Callback]
    show: Callable[[float], object]
    interrupt: Interrupt
    watch: EventMonitor | None = None

    def go(self, state: State) -> tuple[str, Diverged | None]:
        """Go on from a state to the end; the status, and why a step could not be solved."""
        self.state = state
        status = "completed"
        try:
            while status == "completed" and (block := self.plan.advance(self.state)) is not None:
                found = None if self.watch is None else self._look(self.watch, block)
                if found is None:
                    status = self._take(block)
                    continue
                if found.steps is not None:
                    self._take(found.steps)
                status = self._take(found.last)
                status = "stopped" if self._act(found) else status
        except KeyboardInterrupt:  # raised by a callback, or a second Ctrl-C
            return "interrupted", None
        except Diverged as error:
            return "diverged", error
        return status, None

    def _look(self, watch: EventMonitor, block: Block) -> Found | None:
        """Look for events; if that fails, steps before in the same block are done all the same."""
        watch.passed = 0
        try:
            return watch.look(block)
        except BaseException:
            if watch.passed:
                self._take(block.part(0, watch.passed))
            raise

    def _take(self, block: Block) -> str:
        """Record solved steps, and call what looks at them; the status of the run."""
        self.record.add(block)
        self.state = block.state
        self.show(self.state.time)
        # all are called
        answers = [callback(report) for report in block for callback in self.callbacks]
        if self.interrupt.asked:
            return "interrupted"
        asked = any(isinstance(answer, bool | np.bool_) and answer for answer in answers)
        return "stopped" if asked else "completed"

    def _act(self, found: Found) -> bool:
        """Carry out what events do; true if the run ends with them."""
        assert self.watch is not None
        start, system, stop = self.state, self.watch.system, False
        before = system
        losses = 0.0
        for event, value in found.events:
            try:
                seen = found.view if self.state is start else View(system, self.state)
                outcome = event.action.outcome(seen)
            except InputError as error:
                raise type(error)(event.label, f"at t = {start.time:.9g} s: {error}") from error
            system, state, loss = self._outcome(system, outcome)
            row = self.record.row_of_event()
            record = EventRecord(
                *(start.time, event.name, value, row, start.index, loss, repr(event.action))
            )
            self.record.events.append(record)
            logger.info("%s", record)
            self.state, losses, stop = state, losses + loss, stop or outcome.stop
        stepper = self.plan.stepper
        if self.state is not start:
            if system is not before:
                stepper = self.factory(system, self.plan.h)
            self.record.switch(stepper, self.state, self.plan.h, losses)
        else:
            self.record.note()
        if not stop:
            self.watch.go_on(stepper, self.state, found)
        self.plan.begin(stepper, self.state)
        return stop

    def _outcome(self, system: System, outcome: ActionOutcome) -> tuple[System, State, float]:
        """System and state to go on with, and the energy (J) that this takes."""
        state = self.state
        if outcome.system is None and outcome.state is None:
            return system, state, 0.0
        new = system if outcome.system is None else outcome.system
        own = Projection(system)(state.q, state.p, state.time)[1]
        integrator = self.plan.stepper.integrator
        before = _energy(system, integrator, state)
        turns: Array | None = state.turns
        if turns is not None:
            turns = new.couplings.named(system.couplings.turning, turns)
        if outcome.state is None:
            p = Projection(new)(state.q, own, state.time)[1]
            after = State(state.time, state.index, state.q, p, turns=turns)
        else:
            given = replace(outcome.state, fresh=True, load_factor=None)
            after = replace(given, time=state.time, index=state.index)
        return new, after, before - _energy(new, integrator, after)


def _energy(system: System, integrator: Integrator, state: State) -> float:
    """Kinetic and stored energy (J) of a state, of all strains: loads work on these."""
    turns = None if state.turns is None else state.turns[None]
    own = state.q[None], state.p[None], np.array([state.time]), turns
    found = energies(system, integrator.carries_node_momentum, *own)
    return float((found - strain_excess(system, own[0], state.time))[0])


# -- the loop in time: a generator of steps, and a simulation with a history on top of it ----------


@takes_scene
def steps(
    system: System,
    integrator: Integrator,
    treatment: Treatment,
    step: float,
    start: State | None = None,
    settings: NewtonSettings | None = None,
    kernels: str = "auto",
    solver: Solver | None = None,
) -> Iterator[StepReport]:
    """Solve step after step, for a loop of your own; stops only when you do.

    Parameters
    ----------
    system : Model or System
    integrator : Integrator
        Such as ``Variational()``, ``EnergyMomentum()``, a ``Composition`` of one of them,
        ``GeneralizedAlpha()`` or ``Explicit()``; the README has a table of all.
    treatment : Treatment
        ``NullSpace()`` or ``Multipliers()``; the explicit schemes take the latter.
    step : float
        Step size (s).
    start : State, optional
        Default: :func:`initial_state`. One that another integrator or step led to starts anew from
        its q and p, as with :func:`restart`. One that was put together (without a ``made_by``) has
        to fulfil the constraints, and its momentum the hidden ones.
    settings : NewtonSettings, optional
        When Newton's method stops.
    kernels : {"auto", "numpy", "numba"}
        See :func:`simulate`; "auto" compiles none.
    solver : Solver, optional
        See :func:`simulate`.

    Yields
    ------
    StepReport
        With the new state, and momentum and constraint force of the step that led to it.

    Raises
    ------
    Diverged
        When a step cannot be solved; the states yielded before remain valid.

    Examples
    --------
    >>> from skfem_cosserat import MassPoint, Model, NullSpace, Variational, View
    >>> model = Model()
    >>> ball = model.add("ball", MassPoint(2.0, velocity=(1.0, 0, 0)))
    >>> for report in steps(model, Variational(), NullSpace(), 0.1):
    ...     if report.state.time > 0.45:
    ...         break
    >>> View(model, report.state).position(ball.place()).round(12).tolist()
    [0.5, 0.0, 0.0]
    """
    stepper = Stepper(system, integrator, treatment, step, settings, kernels, solver=solver)
    with stepper.notices:
        state = _first(system, start)
    state = stepper.own(state)
    origin = state.time
    first = state.index
    while True:
        # t_n = t_0 + n h: no rounding adds up over many steps
        report = stepper.advance(state, origin + (state.index + 1 - first) * stepper.h)
        yield report
        state = report.state


@takes_scene
def simulate(
    system: System,
    integrator: Integrator,
    treatment: Treatment,
    step: float | StepControl,
    until: float,
    *,
    start: State | None = None,
    every: int = 1,
    at: Sequence[float] | None = None,
    callbacks: Sequence[Callback] = (),
    progress: bool | Callable[[float, float], object] = False,
    path: FilePath | None = None,
    derive: bool | Sequence[str] | None = None,
    settings: NewtonSettings | None = None,
    kernels: str = "auto",
    solver: Solver | None = None,
    sensors: Mapping[str, Sensor] | None = None,
    events: Sequence[Event] | None = None,
) -> History:
    """Integrate a scene and return its history.

    Parameters
    ----------
    system, integrator, treatment, start, settings
        See :func:`steps`.
    step : float or StepControl
        Step size (s); or steps that follow from a tolerance, which end exactly at `until` and at
        the times `at`: ``history.meta["step_control"]`` says how many there were and how many were
        rejected, the series ``step_size`` how long they were.
    until : float
        End time (s), by a step at least later than the start. The last step ends at or before it: a
        time that is not a multiple of the step is an :class:`AccuracyWarning`, which says where the
        run ended.
    every : int
        Record every k-th step (the first and the last state always).
    at : sequence of float, optional
        Record the states nearest to these times instead, beside the first and the last.
    callbacks : sequence of callable
        Called with each :class:`StepReport`; one that returns True ends the run.
    progress : bool or callable
        True: one line on stderr, kept up to date; a callable gets (time, until) after each step.
    kernels : {"auto", "numpy", "numba"}
        Plain numpy kernels, or those compiled by numba (extra ``fast``): the same results to
        rounding, steps 30 to 110 times faster after some 10 s of compilation, once. "auto" takes
        them where they are on disk, and compiles them for a run of 10 000 steps. There are none for
        explicit schemes, integrators with a balance of their own, treatments of one's own and the
        full system of multipliers.
        ``history.meta["kernels"]`` and ``["kernels_why"]`` say what was taken, and why; page 12
        of the guide says more.
    solver : Solver, optional
        Of linear systems: ``SolverDense()``, ``SolverBanded()``, ``SolverSuperLU()`` or
        ``SolverPardiso()``; by default the fastest for the scene that is
        installed (extra ``solvers``). ``history.meta["solver"]`` says what was taken.
    sensors : mapping of str to Sensor, optional
        Recorded at every step, whatever `every` and `at` say: ``history.sensors[name]`` has
        ``times``, ``values`` and ``spectrum()``.
    events : list of Event, optional
        What is to happen on conditions, located in time: ``history.events``. Their states are
        recorded, whatever `every` and `at` say; steps are equal from one to the next, of the size
        asked for or less, and end exactly at `until`. Where joints, loads or states change, the
        row after that of the event has the same time; ``history.segments`` are the rows of one
        system, series of joints that are not there are NaN.
    path : path, optional
        Stream the history to this file, block by block. An older file is replaced, but not by a
        run that goes on from a history.
    derive : bool or list of str, optional
        Series that are derived when the run ends: those named, as ``["energy"]``, or all (True). By
        default each is derived when it is first asked for: ``history["energy"]``. False: none can
        be asked for. See :func:`skfem_cosserat.run.derive_series` for all there are.

    Returns
    -------
    History
        All series belong to ``history.times``. Of schemes whose constraint forces act at midpoints
        (energy-momentum, energy-decaying) ``history["constraint_force"]``, and what follows from
        it, is the mean of both steps around a state, which is of second order; those of the steps
        themselves, which callbacks get, alternate by an error of first order. The first and the
        last state have values that are extrapolated from two steps, on their side of an event.
        No step beyond `until` is solved.
        ``history.meta["status"]`` says whether it ran to the end, was interrupted (Ctrl-C) or
        stopped by a callback; ``history.meta["warnings"]`` what is doubtful about it, as the
        warnings that it gives (:class:`CosseratWarning`), each once;
        ``history.meta["energy_balance"]`` what energies and works there were (J): ``start, end,
        loads, actuators, drives, dissipated`` (by dampers and events), ``lost`` (by the scheme;
        negative: gained) and their ``scale``, the largest of them at any time. More than 3 % lost
        or gained, at the end or at one of a hundred recorded states, is an
        :class:`AccuracyWarning`; of schemes that are meant to lose, 10 % lost.

    Raises
    ------
    Diverged
        With ``error.history``, the history up to the failed step. (An error of a callback or a
        function of time carries it too, and a warning that was made an error.)
    InputError
        For bad arguments, before the first step.

    Examples
    --------
    >>> from skfem_cosserat import EnergyMomentum, MassPoint, Model, NullSpace
    >>> model = Model()
    >>> ball = model.add("ball", MassPoint(2.0, velocity=(1.0, 0, 0)))
    >>> history = simulate(model, EnergyMomentum(), NullSpace(), step=0.1, until=0.5)
    >>> history.position(ball.place())[-1].round(12).tolist()
    [0.5, 0.0, 0.0]
    >>> float(history["energy"][-1].round(12))
    1.0
    """
    derive = checked_asked(derive, system, run_formulas)
    with Notices(system.warnings) as notices:
        show = Progress(progress, "t = {:.6g} s of {:.6g} s".format)
        state = _first(system, start)
        left = _checked_run(state, until, every, callbacks, path)
        controlled = isinstance(step, StepControl)
        eventful = events is not None or system.couplings.due(None) < np.inf
        h = step.sizes(integrator, left)[0] if isinstance(step, StepControl) else step
        h = positive("argument step", "step", h, " of seconds")

        if left > MOST * h and not controlled:
            text = f"{h!r} s gives {left / h:.3g} steps until {until!r} s"
            raise InputError("argument step", f"{text}, expected at most {MOST:.0e}")
        steps = int(min(left / h, MOST))
        methods = (integrator, treatment)

        def factory(system: System, h: float) -> Stepper:
            return Stepper(system, *methods, h, settings, kernels, steps, solver, show.say)

        stepper = factory(system, h)
        kernels = stepper.choice.name  # others take the same
        state = stepper.own(state, eventful or controlled)
        found = checked_events(events, integrator, system)
        watch = EventMonitor(found, factory, stepper, state) if found else None
        plan: Plan
        if isinstance(step, StepControl):
            plan = ControlledSteps(step, factory, stepper, state, until, at or ())
        else:
            looked = bool(callbacks or callable(progress))
            plan = FixedSteps(stepper, state, until, eventful, looked)
        wanted = wanted_states(state, until, every, at, h, exact=controlled)
        record = Record(stepper, state, wanted, path, sensors, eventful or controlled, notices)
        with record, Interrupt() as interrupt:
            run = RunLoop(
                factory, plan, record, callbacks, lambda t: show(t, until), interrupt, watch
            )
            record.more = lambda: plan.summary() | {"until": float(until), "eventful": eventful}
            with show:
                status, failure = run.go(state)
            if failure is not None:
                notices.tell(failure)  # from here on no warning takes its place
            history = record.close(status, failure)
            if failure is not None:
                notices.tell(failure)  # now with what the checks have found
                failure.history = history
            interrupt.at_once()  # nothing is lost any more
            finish(history, [segment.system for segment in record.segments], derive, path)
        logger.info("%s: %d states up to t = %.6g s", status, len(history), history.times[-1])
        if failure is not None:
            notices.tell(failure)
            raise failure
        return history


def _first(system: System, start: State | None) -> State:
    """State that steps begin with."""
    return initial_state(system) if start is None else consistent_start(system, start)


def _checked_run(
    state: State, until: float, every: int, callbacks: Sequence[Callback], path: FilePath | None
) -> float:
    """Duration (s) of a run whose arguments make sense."""
    whole("argument every", every, 1)
    left = real("argument until", "until", until, "a finite number of seconds") - state.time
    if not 0 < left < np.inf:
        text = f"expected a time later than the start, which is at {state.time!r} s"
        raise InputError("argument until", f"{until!r} s, {text}")
    if not isinstance(callbacks, Sequence):
        raise InputError("argument callbacks", f"{callbacks!r}, expected a list of functions")
    for callback in callbacks:
        if not callable(callback):
            raise InputError("argument callbacks", f"{callback!r} is not callable")
    if path is not None and state.index > 0 and os.path.exists(path):
        raise InputError(
            "argument path",
            f"{os.fspath(path)!r} exists and the run goes on from step {state.index}: name"
            " another file, or the states before would be lost",
        )
    return left
