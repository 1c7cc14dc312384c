"""The loop in time: a generator of steps, and a simulation with a history on top of it."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np

from ..constraints import Treatment
from ..diagnostics import constraint_points, highest_frequency
from ..diagnostics.forces import drawn_too_far
from ..errors import CosseratError, InputError
from ..history import History
from ..integrators import Integrator, State, Stepper, StepReport
from ..linear import Solver
from ..log import logger
from ..model import System
from ..model.bending import bent_elements
from ..newton import NewtonSettings
from ..types import positive
from .control import ControlledPace, StepControl
from .describe import derive_segments, derive_series
from .events import Event, Watch, checked_events
from .interrupt import Interrupt
from .pace import FixedPace, Maker, Pace
from .progress import Progress
from .recorder import Numbered, Recorder, Wanted, timed
from .run import Callback, Run
from .sensors import Sensor
from .start import consistent_start, initial_state

__all__ = ["simulate", "steps"]

#: recorded states, evenly spread, at which the tension of elements is looked at
LOOKS = 20


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
    system : System
    integrator : Integrator
        ``Variational()``, ``EnergyMomentum()``, ``EnergyDecaying()``, ``GeneralizedAlpha()``, a
        ``Composition`` of one of the first two, ``Explicit()`` or ``Asynchronous()``.
    treatment : Treatment
        ``NullSpace()`` or ``Multipliers()``; the explicit schemes take the latter.
    step : float
        Step size (s).
    start : State, optional
        Default: :func:`initial_state`. One that another integrator or step led to starts anew from
        its q and p, as with :func:`restart`. One that was put together (without a ``maker``) has to
        fulfil the constraints, and its momentum the hidden ones.
    settings : NewtonSettings, optional
        When Newton's method stops.
    kernels : {"auto", "numpy", "numba"}
        See :func:`simulate`; "auto" takes a thousand steps for granted.
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
    >>> from skfem_cosserat import Model, MassPoint, NullSpace, Variational
    >>> model = Model()
    >>> ball = model.add("ball", MassPoint(2.0, velocity=(1.0, 0, 0)))
    >>> for report in steps(model.freeze(), Variational(), NullSpace(), 0.1):
    ...     if report.state.time > 0.45:
    ...         break
    >>> round(float(report.state.q[0]), 12)
    0.5
    """
    stepper = Stepper(system, integrator, treatment, step, settings, kernels, solver=solver)
    state = initial_state(system) if start is None else stepper.own(consistent_start(system, start))
    origin, first = state.time, state.index
    while True:
        # t_n = t_0 + n h: no rounding adds up over many steps
        report = stepper.advance(state, origin + (state.index + 1 - first) * stepper.h)
        yield report
        state = report.state


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
    path: str | os.PathLike[str] | None = None,
    derive: bool = True,
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
        End time (s); the last step ends at or before it (to rounding).
    every : int
        Record every k-th step (the first and the last state always). What lies between compiled
        kernels take in one go, where loads are constant and there are no force elements, damping
        and prescribed motion: the same steps for less, unless callbacks, sensors or a function for
        `progress` look at each.
    at : sequence of float, optional
        Record the states nearest to these times instead, beside the first and the last.
    callbacks : sequence of callable
        Called with each :class:`StepReport`; one that returns True ends the run.
    progress : bool or callable
        True: one line on stderr, kept up to date; a callable gets (time, until) after each step.
    kernels : {"auto", "numpy", "numba"}
        Plain numpy kernels, or those compiled by numba (extra ``fast``), six to 35 times
        faster after some 10 s of compilation, which is kept on disk. "auto" takes them if numba
        is installed, the estimated time with numpy is above 25 s and there are some: not for
        springs on rotation vectors, bushings, beams of several orders, closed loops in prescribed
        motion or with multipliers, scenes confined to a plane with multipliers, loads that follow
        the motion, force elements, damping or prescribed motion. ``history.meta["kernels"]`` and
        ``["kernels_why"]`` say what was taken, and why. They keep factors of matrices over
        iterations and steps as long as these contract well, see :class:`NewtonSettings`.
    solver : Solver, optional
        Of linear systems: ``SolverDense()``, ``SolverBanded()``, ``SolverSuperLU()``,
        ``SolverMetis()`` or ``SolverPardiso()``. By default small and narrow ones are solved by
        the first two, others by the fastest that is installed (extra ``solvers``). Compiled
        kernels eliminate chains and trees in blocks, and leave the rest to it.
        ``history.meta["solver"]`` says what was taken.
    sensors : mapping of str to Sensor, optional
        Recorded at every step, whatever `every` and `at` say: ``history.sensors[name]`` has
        ``times``, ``values`` and ``spectrum()``.
    events : list of Event, optional
        What is to happen on conditions, located in time: ``history.events``. Their states are
        recorded, whatever `every` and `at` say; steps are equal from one to the next, of the size
        asked for or less, and end exactly at `until`. Where joints, loads or states
        change, the row after that of the event has the same time; ``history.segments`` are the
        rows of one system, series of joints that are not there are NaN.
    path : path, optional
        Stream the history to this file, block by block. An older file is replaced, but not by a
        run that goes on from a history.
    derive : bool
        Add energies, velocities, section forces and reactions at the end (:func:`derive_series`).

    Returns
    -------
    History
        ``history.meta["status"]`` says whether it ran to the end, was interrupted (Ctrl-C) or
        stopped by a callback.

    Raises
    ------
    Diverged
        With ``error.history``, the history up to the failed step. (An error of a callback or a
        function of time carries it too.)
    InputError
        For bad arguments, before the first step.

    Examples
    --------
    >>> from skfem_cosserat import EnergyMomentum, MassPoint, Model, NullSpace
    >>> model = Model()
    >>> ball = model.add("ball", MassPoint(2.0, velocity=(1.0, 0, 0)))
    >>> history = simulate(model.freeze(), EnergyMomentum(), NullSpace(), step=0.1, until=0.5)
    >>> history["q"][-1].round(12).tolist(), float(history["energy"][-1].round(12))
    ([0.5, 0.0, 0.0], 1.0)
    """
    show = Progress(progress, "t = {:.6g} s of {:.6g} s".format)
    first = _first_step(system, integrator, step, until, start)
    intended = _intended(first, until, start)
    eventful = events is not None
    varying = eventful or isinstance(step, StepControl)
    maker = Maker(integrator, treatment, settings, kernels, intended, solver, show.say, varying)
    stepper = maker(system, first)
    maker.kernels = stepper.choice.name
    state, count = _plan(system, start, stepper.h, until, every)
    state = stepper.own(state)
    _check_run(callbacks, path, state)
    found = checked_events(events, integrator, system, state)
    looked = bool(callbacks or sensors or callable(progress))
    pace, wanted = _paced(step, maker, stepper, state, until, count, every, at, eventful, looked)
    recorder = Recorder(system, stepper, state, wanted, path, sensors, varying)
    _warn_if_unresolved(stepper)
    with recorder, Interrupt() as interrupt:
        watch = Watch(found, maker, system, state) if found else None
        run = Run(maker, pace, recorder, callbacks, lambda t: show(t, until), interrupt, watch)
        with show:
            status, failure = run.go(state)
        recorder.more = pace.summary()
        history = recorder.close(status, failure)
        if failure is not None:
            failure.history = history
        else:
            _warn_of_elements(system, history)
        if derive:
            interrupt.asked = True  # nothing is lost any more: end at once
            _derive(recorder, history, path)
    logger.info("%s: %d states up to t = %.6g s", status, len(history), history.times[-1])
    if failure is not None:
        raise failure
    return history


def _intended(step: float, until: float, start: State | None) -> int | None:
    """Number of steps, as far as the arguments make sense: they are checked after that."""
    try:
        count = (until - (0.0 if start is None else start.time)) / step
    except (TypeError, ValueError, ZeroDivisionError, AttributeError):
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
    state, _ = _plan(system, start, 1.0, until, 1)
    if not until > state.time:
        raise InputError("argument until", f"{until!r} s, expected later than {state.time!r} s")
    return step.sizes(until - state.time)[0]


def _paced(
    step: float | StepControl,
    maker: Maker,
    stepper: Stepper,
    state: State,
    until: float,
    count: int,
    every: int,
    at: Sequence[float] | None,
    eventful: bool,
    looked: bool,
) -> tuple[Pace, Wanted]:
    """How a run goes on in time, and which of its states are recorded.

    Steps in between are taken in one go, unless something looks at each (`looked`).
    """
    if isinstance(step, StepControl):
        wanted = timed(state, until, every, at, exact=True)
        return ControlledPace(step, maker, stepper, state, until, at or ()), wanted
    if eventful:
        wanted = timed(state, until, every, at, exact=False)
        return FixedPace(stepper, state, count, until), wanted
    numbered = Numbered(state, stepper.h, count, every, at)
    return FixedPace(stepper, state, count, None, None if looked else numbered.ahead), numbered


def _warn_of_elements(system: System, history: History) -> None:
    """Say what elements are bent too far at the end, or were drawn too much on the way.

    What is drawn too much folds up: of the end nothing may be seen any more.
    """
    if not system.beam_groups:
        return
    states = history["q"].reshape(len(history), -1, 3)
    if bent := bent_elements(system, states[-1]):
        logger.warning("t = %.6g s: %s", history.times[-1], bent)
    points = constraint_points(system, history) if system.rung_rows else states
    for k in np.unique(np.linspace(0, len(states) - 1, LOOKS).round().astype(int)):
        force = history["constraint_force"][k]
        if drawn := drawn_too_far(system, points[k], force):
            logger.warning("t = %.6g s: %s", history.times[k], drawn)
            break


def _warn_if_unresolved(stepper: Stepper) -> None:
    """Say once that the step leaves frequencies unresolved which the integrator needs."""
    limit, system = stepper.integrator.frequency_limit, stepper.system
    if limit is None or not system.beam_groups:
        return
    try:
        omega = highest_frequency(system)
    except (CosseratError, ArithmeticError, ValueError) as error:  # never stops a run
        logger.debug("the highest frequency could not be estimated: %s", error)
        return
    if stepper.h * omega > limit:
        logger.warning(
            "the step %.3g s times the highest frequency of the beams, %.3g rad/s, is %.3g: above"
            " %.3g the %s integrator is likely to fail; try steps below %.2g s, or another one",
            *(stepper.h, omega, stepper.h * omega, limit, stepper.integrator.name, limit / omega),
        )


def _derive(recorder: Recorder, history: History, path: str | os.PathLike[str] | None) -> None:
    """Add the derived series; a history that ended badly is kept whatever they give."""
    try:
        with np.errstate(all="ignore"):
            if len(recorder.segments) > 1:
                derive_segments([segment.system for segment in recorder.segments], history)
            else:
                derive_series(recorder.system, history)
    except CosseratError as error:
        logger.warning("energies and reactions could not be derived: %s", error)
    except KeyboardInterrupt:
        logger.warning("interrupted: energies and reactions are missing, see derive_series")
    if path is not None:
        history.save(path)


def _check_run(
    callbacks: Sequence[Callback], path: str | os.PathLike[str] | None, state: State
) -> None:
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


def _plan(
    system: System, start: State | None, step: float, until: float, every: int
) -> tuple[State, int]:
    until = positive("argument until", "until", until, " of seconds")
    if isinstance(every, bool) or not isinstance(every, int | np.integer) or every < 1:
        raise InputError("argument every", f"{every!r}, expected a positive integer")
    state = initial_state(system) if start is None else consistent_start(system, start)
    count = int(np.floor((until - state.time) / step * (1 + 1e-12) + 1e-9))
    if count < 0:
        raise InputError("argument until", f"{until!r} s is before the start at {state.time!r} s")
    return state, count
