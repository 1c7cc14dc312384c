"""Runs: the loop over steps, and the functions that users call."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from .. import checks
from ..constraints import Treatment
from ..diagnostics import (
    Projection,
    alternation,
    doubtful_steps,
    multipliers,
    resolution,
)
from ..diagnostics.resolution import MOST_OFF
from ..diagnostics.stacked import all_rows
from ..errors import AccuracyWarning, CosseratError, Diverged, InputError
from ..history import EventRecord, History
from ..integrators import Integrator, State, Stepper, StepReport
from ..integrators.report import BlockReport
from ..linear import SingularMatrixError, Solver
from ..model import System, takes_scene
from ..model.limits import (
    FAR_TURN,
    fastest_turn,
    first_over_rotated,
    over_rotated_beam,
    overstretched_beam,
)
from ..model.plane import functions_off_plane
from ..newton import NewtonSettings
from ..types import MOST, FilePath, real, spread, whole
from ..warn import Notices, logger, warn
from .conditions import ActionOutcome
from .describe import checked_asked, finish, run_formulas
from .events import Event, EventMonitor, Found, checked_events
from .progress import Interrupt, Progress
from .recorder import Numbered, Recorder, Wanted, energy, timed
from .sensors import Sensor, View
from .start import consistent_start, initial_state
from .step_size import ControlledSteps, FixedSteps, StepControl, StepperFactory, SteppingPlan

# -- the loop of a run: steps, events and what they change, until the end --------------------------

Callback = Callable[[StepReport], object]


@dataclass
class RunLoop:
    """A run and its parts.

    Attributes
    ----------
    factory : StepperFactory
    plan : SteppingPlan
    recorder : Recorder
    callbacks : sequence of callable
    show : callable
        Gets the time after each step.
    interrupt : Interrupt
    watch : EventMonitor or None
        None: there are no events.
    """

    factory: StepperFactory
    plan: SteppingPlan
    recorder: Recorder
    callbacks: Sequence[Callback]
    show: Callable[[float], object]
    interrupt: Interrupt
    watch: EventMonitor | None = None

    def go(self, state: State) -> tuple[str, Diverged | None]:
        """Go on from a state to the end; the status, and why a step could not be solved."""
        self.state, status = state, "completed"
        try:
            while status == "completed" and (reports := self.plan.advance(self.state)):
                for report in reports:
                    found = None if self.watch is None else self._look(self.watch, report)
                    if found is None:
                        status = self._take(report)
                    else:
                        if found.before is not None:
                            self._take(found.before)
                        status = self._take(found.report)
                        self.plan.stepper.rewind(report, found.steps)
                        status = "stopped" if self._act(found) else status
                    if found is not None or status != "completed":
                        break
        except KeyboardInterrupt:  # raised by a callback, or a second Ctrl-C
            return "interrupted", None
        except Diverged as error:
            return "diverged", error
        return status, None

    def _look(self, watch: EventMonitor, report: StepReport) -> Found | None:
        """Look for events; if that fails, steps before in the same block are done all the same."""
        try:
            return watch.look(report)
        except BaseException:
            if watch.passed and isinstance(report, BlockReport):
                self._take(report.first(watch.passed))
            raise

    def numbers(self, h: float | None) -> StepNumbers:
        """Numbers of its steps, to be found at its end: the metadata of its history take them.

        Events shorten steps: those of the size h (s) that was asked for count, if one was.
        """
        recorder, plan = self.recorder, self.plan
        recorder.h = h or plan.h
        out = StepNumbers(recorder.segments[-1].system, self.factory.integrator, recorder.h)
        recorder.more = plan.summary() | {"steps": out.numbers}
        return out

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
            try:
                seen = found.view if self.state is start else View(system, self.state)
                outcome = event.action.outcome(seen)
            except InputError as error:
                text = f"at t = {start.time:.9g} s: {error}"
                raise type(error)(event.label, text) from error
            system, state, loss = self._outcome(system, outcome)
            row = self.recorder.row_of_event()
            record = EventRecord(
                *(start.time, event.name, value, row, start.index, loss, repr(event.action))
            )
            self.recorder.events.append(record)
            logger.info("%s", record)
            self.state, losses, stop = state, losses + loss, stop or outcome.stop
        stepper = self.plan.stepper
        if self.state is not start:
            if system is not before:
                stepper = self.factory(system, self.plan.h)
            self.recorder.switch(system, stepper, self.state, self.plan.h, losses)
        else:
            self.recorder.note()
        if not stop:
            self.watch.go_on(system, self.state, found)
        self.plan.begin(stepper, self.state)
        return stop

    def _outcome(self, system: System, outcome: ActionOutcome) -> tuple[System, State, float]:
        """System and state to go on with, and the energy (J) that this takes."""
        state = self.state
        if outcome.system is None and outcome.state is None:
            return system, state, 0.0
        new = system if outcome.system is None else outcome.system
        own = Projection(system)(state.q, state.p, state.time)[1]
        integrator = self.factory.integrator
        before = energy(system, integrator, state)
        if outcome.state is None:
            p = Projection(new)(state.q, own, state.time)[1]
            after = State(state.time, state.index, state.q, p, turns=state.turns)
        else:
            given = replace(outcome.state, fresh=True, load_factor=None)
            after = replace(given, time=state.time, index=state.index)
        return new, after, before - energy(new, integrator, after)


# -- the loop in time: a generator of steps, and a simulation with a history on top of it ----------

#: steps, those with the most iterations, that are looked at for other solutions
HARDEST = 20
#: error of fifty steps, or rotation in one (rad), above which it is this many, or one of so many
ROUGH, MORE, EACH = 0.02, 50, 40
#: parts of a step, and of a run, by which it may end before its time
REST, ROUNDING = 1e-6, 1e-8


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
        state = initial_state(system) if start is None else consistent_start(system, start)
    state = stepper.own(state)
    origin, first = state.time, state.index
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
        negative: gained) and their ``scale``, the largest of them at any time. More than 1 % lost
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
        first = _first_step(system, integrator, step, until, start)
        intended = _intended(first, until, start)
        eventful = events is not None
        varying = eventful or isinstance(step, StepControl)
        chosen = integrator, treatment, settings, kernels, intended, solver, show.say
        factory = StepperFactory(*chosen)
        stepper = factory(system, first)
        factory = replace(factory, kernels=stepper.choice.name)  # others take the same
        h = None if isinstance(step, StepControl) else stepper.h
        state, count = _extent(system, start, h, until, every, eventful)
        state = stepper.own(state, varying)
        _check_run(callbacks, path, state)
        found = checked_events(events, integrator, system)
        watch = EventMonitor(found, factory, system, state, first) if found else None
        looked = bool(callbacks or callable(progress))
        extent = state, until, count, every, at, eventful, looked, bool(sensors)
        plan, wanted = _planned(step, factory, stepper, *extent)
        expected = wanted.rows if isinstance(wanted, Numbered) else None
        about = path, sensors, varying, notices, expected
        recorder = Recorder(system, stepper, state, wanted, *about)
        with recorder, Interrupt() as interrupt:
            run = RunLoop(
                factory, plan, recorder, callbacks, lambda t: show(t, until), interrupt, watch
            )
            equal = h is not None
            recorder.look_back = lambda found: _warn_of_motion(
                run.numbers(h), found, equal, eventful, None
            )
            with show:
                status, failure = run.go(state)
            why = run.numbers(h)
            if failure is None and status == "completed":
                _warn_of_rest(state, run.state, None if eventful else h, until)
            if failure is not None:
                notices.tell(failure)  # from here on no warning takes its place
            try:
                _warn_of_motion(why, recorder.complete(), equal, eventful, failure)
            finally:  # a warning may be an error: the file is whole all the same
                history = recorder.close(status, failure, why.alternation)
            if failure is not None:
                notices.tell(failure)  # now with the balance of energy
                failure.history = history
            interrupt.at_once()  # nothing is lost any more
            finish(history, [segment.system for segment in recorder.segments], derive, path)
        logger.info("%s: %d states up to t = %.6g s", status, len(history), history.times[-1])
        if failure is not None:
            notices.tell(failure)
            raise failure
        return history


def _warn_of_motion(
    why: StepNumbers, recorded: History, equal: bool, eventful: bool, failure: Diverged | None
) -> None:
    """Warn of what the states of a run show, `equal`: one step apart; a failure has its own text.

    Explicit integrators have steps within steps.
    """
    if equal and why.integrator.solves:
        why.warn(recorded)
    with np.errstate(all="ignore" if failure is not None else None):  # it may have blown up
        strained = _strained_elements(why.system, recorded)
    why.numbers["elements"] = float(bool(strained))
    if failure is not None:
        failure.hint = why.alternation(recorded)
        why.turn_at_end(recorded)
        return
    for (item, text), time in strained:
        warn(item, text, AccuracyWarning, time)
    _warn_of_functions(why.system, recorded)
    single = why.integrator.single.scheme(why.h)
    at_end = single is not None and single.at_end
    checks.apply(checks.Run(why.system, recorded, at_end, eventful))


def _intended(step: float, until: float, start: State | None) -> int | None:
    """Number of steps, as far as the arguments make sense: they are checked after that."""
    try:
        count = (until - (0.0 if start is None else start.time)) / step
    except (AttributeError, OverflowError, TypeError, ValueError, ZeroDivisionError):
        return None
    return int(count) if isinstance(count, float) and 0 <= count < 1e15 else None


def _first_step(
    system: System,
    integrator: Integrator,
    step: float | StepControl,
    until: float,
    start: State | None,
) -> float:
    """The step asked for, or that which a controller begins with."""
    if not isinstance(step, StepControl):
        return step
    if isinstance(integrator, Integrator):
        step.check(integrator)
    state, _ = _extent(system, start, None, until, 1)
    return step.sizes(until - state.time)[0]


def _planned(
    step: float | StepControl,
    factory: StepperFactory,
    stepper: Stepper,
    state: State,
    until: float,
    count: int,
    every: int,
    at: Sequence[float] | None,
    eventful: bool,
    looked: bool,
    seen: bool,
) -> tuple[SteppingPlan, Wanted]:
    """How a run goes on in time, and which of its states are recorded.

    Steps are taken in one go, unless something looks at each (`looked`). Sensors see every state
    (`seen`), many at a time.
    """
    if isinstance(step, StepControl):
        wanted = timed(state, until, every, at, exact=True)
        return ControlledSteps(step, factory, stepper, state, until, at or ()), wanted
    if eventful:
        wanted = timed(state, until, every, at, exact=False)
        return FixedSteps(stepper, state, count, until, alone=looked), wanted
    numbered = Numbered(state, stepper.h, count, every, at, seen)
    return FixedSteps(stepper, state, count, None, None if looked else numbered.ahead), numbered


def _warn_of_rest(start: State, end: State, step: float | None, until: float) -> None:
    """Say that a run whose time is no multiple of its step ended before the time asked for."""
    rest = until - end.time
    if step is None or rest <= REST * step + ROUNDING * (until - start.time):
        return
    count = end.index - start.index + 1
    warn(
        "argument until",
        f"the run ends at t = {end.time:.9g} s, {rest:.3g} s before until = {until:.9g} s, which"
        f" is no multiple of the step of {step:.9g} s: give until = {end.time:.9g}, or"
        f" step = {(until - start.time) / count:.9g}, which makes {count} steps",
        AccuracyWarning,
    )


def _strained_elements(system: System, history: History) -> list[tuple[tuple[str, str], float]]:
    """What elements are bent too far, or drawn too much: item and text, and since when (s).

    What is drawn too much folds up: of the end nothing may be seen any more.
    """
    found: list[tuple[tuple[str, str], float]] = []
    if not system.beam_groups:
        return found
    states = history["q"].reshape(len(history), -1, 3)
    first = first_over_rotated(system, states)
    if first is not None and (bent := over_rotated_beam(system, states[first])):
        found.append((bent, float(history.times[first])))
    looks = spread(len(states))
    if any(2 in theory.held for theory in system.theory_rows):
        points = all_rows(system, history["q"][looks], history.instants[looks])
        lams = multipliers(system, points, history["constraint_force"][looks])
        tension = [lam if np.isfinite(lam).all() else None for lam in lams]
    else:
        tension = [None] * len(looks)
    for k, lam in zip(looks, tension, strict=True):
        if drawn := overstretched_beam(system, states[k], lam):
            return [*found, (drawn, float(history.times[k]))]
    return found


class StepNumbers:
    """What the steps of a run do to its motion, as ``history.meta["steps"]`` tells; and warnings.

    Parameters
    ----------
    system : System
    integrator : Integrator
    h : float
        Step (s).

    Attributes
    ----------
    numbers : dict
        What is known of ``off`` and ``turn``, the error and the rotation in a step (in the longest
        part of a composed one) of :class:`skfem_cosserat.diagnostics.Resolution`, or in a step that
        failed; ``doubtful``, whether a step may have several solutions; ``elements``, whether
        some are bent or drawn too far in a recorded state; ``h_omega_c``, see
        :class:`skfem_cosserat.diagnostics.Alternation`.
    """

    def __init__(self, system: System, integrator: Integrator, h: float) -> None:
        self.system, self.integrator, self.h = system, integrator, h
        self.longest = max(map(abs, integrator.shares), default=1.0)
        self.numbers: dict[str, float] = {}

    def warn(self, history: History) -> None:
        """Say that steps are too long: the motion may be bounded, balanced in energy, and wrong.

        Of composed steps the parts count.
        """
        found = resolution(self.system, history)
        rough = found is None or found.error > ROUGH or found.turn > ROUGH
        most = max(MORE, len(history) // EACH) if rough else HARDEST
        doubtful = doubtful_steps(self.system, history, most)
        if found is not None:
            self.numbers |= {"off": found.error, "turn": found.turn * self.longest}
        if found is not None or doubtful.any():  # else none was looked at
            self.numbers["doubtful"] = float(doubtful.any())
        if doubtful.any():
            warn(
                "argument step",
                f"a step of {self.h:.3g} s may have several solutions: the one that was found took"
                " many iterations, and the steps around it do not lead there"
                ' (history["doubtful_step"] marks all of them); take smaller steps, and compare',
                AccuracyWarning,
                float(history.times[doubtful.argmax()]),
            )
        if found is None:
            return
        turn = self.numbers["turn"]
        if found.error > MOST_OFF:
            warn(
                "argument step",
                f"steps of {self.h:.3g} s do not resolve the motion: they put the"
                f" {found.item} off by some {100 * min(found.error, 1.0):.0f} % of the range of its"
                f" motion, as a period of what moves it has {found.period:.2g} steps; take smaller"
                " ones, and compare",
                AccuracyWarning,
                found.time,
            )
        elif turn > FAR_TURN:
            what = "part of a step" if self.integrator.shares else "step"
            warn(
                "argument step",
                f"the {found.turning} turns by {turn:.2g} rad in each {what}: above {FAR_TURN:g}"
                " rad the motion stays bounded, but is not accurate; take smaller steps, and"
                " compare",
                AccuracyWarning,
                found.time,
            )

    def turn_at_end(self, history: History) -> None:
        """Count how far a frame turns in the step that failed, by its velocity at the start."""
        try:
            v = Projection(self.system)(history["q"][-1], history["carried"][-1], history.times[-1])
        except (CosseratError, ArithmeticError, ValueError):
            return
        turn = fastest_turn(self.system, v[0])[1] * self.longest * self.h
        if self.numbers.get("turn", 0.0) < turn < np.pi:  # more is of a run that has blown up
            self.numbers["turn"] = turn

    def alternation(self, history: History) -> str:
        """Why a variational run fails, or gains energy, if it is by alternating rotations."""
        if self.integrator.frequency_limit is None:
            return ""
        try:
            found = alternation(self.system, history, self.longest * self.h)
        except SingularMatrixError:  # not found: nothing is claimed
            return ""
        if found is None:
            return ""
        self.numbers["h_omega_c"] = found.ratio
        return (
            f"compression drives node rotations of {found.item} that alternate from step to step:"
            f" at t = {found.time:.6g} s the step times their frequency is {found.ratio:.3g}, and"
            " they grow above 2"
        )


def _warn_of_functions(system: System, history: History) -> None:
    """Say which function of the motion pushed out of the plane of the scene at recorded states."""
    if system.plane is None or not system.couplings.functions:
        return
    k = spread(len(history))
    if found := functions_off_plane(system, history.times[k], history["q"][k]):
        label, text, time = found
        warn(label, text, AccuracyWarning, time)


def _check_run(callbacks: Sequence[Callback], path: FilePath | None, state: State) -> None:
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


def _extent(
    system: System,
    start: State | None,
    step: float | None,
    until: float,
    every: int,
    exact: bool = False,
) -> tuple[State, int]:
    """Where a run starts, and the number of its steps; zero if a tolerance decides on them.

    With `exact` they are shortened to end at `until`.
    """
    item = "argument until"
    until = real(item, "until", until, "a finite number of seconds")
    whole("argument every", every, 1)
    state = initial_state(system) if start is None else consistent_start(system, start)
    left = until - state.time
    if not 0 < left < np.inf:
        raise InputError(
            item,
            f"{until!r} s, expected a time later than the start, which is at {state.time!r} s",
        )
    if step is None:
        return state, 0
    steps = left / step
    if steps > MOST:
        text = f"{step!r} s gives {steps:.3g} steps until {until!r} s, expected at most {MOST:.0e}"
        raise InputError("argument step", text)
    count = int(np.ceil(steps - 1e-9) if exact else np.floor(steps * (1 + 1e-12) + 1e-9))
    if count == 0:
        raise InputError(
            "argument step",
            f"{step!r} s is longer than the run, {left:.6g} s from {state.time!r} s to {until!r} s:"
            " take a shorter step, or a later end",
        )
    return state, count
