"""Events: found within a step, and what the run does about them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from math import isfinite
from typing import Any, NamedTuple

import numpy as np

from ..errors import CosseratError, Diverged, IncompatibleError, InputError
from ..frozen import Attached
from ..history import History
from ..integrators import Block, Integrator, State, Stepper
from ..integrators.choice import motion_by_kernels
from ..integrators.compiled_step import CompiledMotion, Motion
from ..model import System, takes_scene
from ..types import Floats, IndexArray, positive, switch
from ..warn import logger
from .conditions import (
    Action,
    ActionFunction,
    ActionNone,
    Condition,
    ConditionFunction,
    OfStates,
)
from .plan import StepperFactory
from .sensors import View, Window

# -- zeros of a number within a step: located, and found where it passes through zero and back -----
#
# A step is tried with other sizes: the number at their ends is that of states of the scheme.

#: what a time is located to, of the step
LOCATED = 1e-10
#: most steps that are tried to find the lowest point of a number within a step, and how close, of
#: the step, two of them are to each other
TRIALS = 16
SAME = 1e-5
#: how far a parabola may be wrong, of its second difference over a step and of the step: as much
#: if the third derivative, times the step, is as large as the second one
WRONG = 0.15
ASIDE = 0.2

#: number at the end of a step of this size (s), and the step
Trial = Callable[[float], tuple[float, Block]]


class Bracket(NamedTuple):
    """A zero between two points of a step.

    Attributes
    ----------
    side : int
        Sign of the number before it.
    a, b : (float, float)
        Time (s) after the start of the step, and number times `side`, before and after it.
    best : Block
        The step to `b`.
    """

    side: int
    a: tuple[float, float]
    b: tuple[float, float]
    best: Block


def located(bracket: Bracket, trial: Trial, width: float) -> Block:
    """The step to the first state known to be past a zero, to a width (s)."""
    from scipy.optimize import brentq  # slow to import, seldom needed

    known = dict([bracket.a, bracket.b])
    passed = {bracket.b[0]: bracket.best}

    def number(size: float) -> float:
        if size not in known:
            known[size], block = trial(size)
            if known[size] <= 0:
                passed[size] = block
        return known[size]

    if bracket.b[1] < 0:
        brentq(number, bracket.a[0], bracket.b[0], xtol=width / 2, rtol=4 * np.finfo(float).eps)
    return passed[min(passed)]


class _Below(Exception):
    """A number is negative inside a step: the time, the number and the step there."""


def dip(trial: Trial, h: float) -> tuple[tuple[float, float], Block] | None:
    """Size and number where one is negative that is positive at both ends, and the step to there.

    None: nowhere, as far as some steps tell that look for its lowest point.
    """
    from scipy.optimize import minimize_scalar  # slow to import, seldom needed

    def number(size: float) -> float:
        found, block = trial(float(size))
        if found < 0:
            raise _Below((float(size), found), block)
        return found

    try:
        minimize_scalar(
            number,
            bounds=(0.0, h),
            method="bounded",
            options={"maxiter": TRIALS, "xatol": SAME * h},
        )
    except _Below as below:
        point, block = below.args
        return point, block
    return None


def comes_near(before: Any, start: Any, end: Any, ratio: float = 1.0) -> Any:
    """True if a parabola through three numbers may come so near to zero in a step that it is tried.

    It is ``start - second t^2`` at its lowest point t, which has to be in the step or beside it, by
    at most :data:`ASIDE` of it; there it must be less than :data:`WRONG` of its ``second``. So it
    has to start below ``((1 + ASIDE)^2 + WRONG) second``, which is less than twice that.

    Parameters
    ----------
    before, start, end : float or array
        Numbers that are positive at both ends of a step, and one of the step before.
    ratio : float
        Of the size of the step before to this one.
    """
    second = (end - start - (start - before) / ratio) / (1 + ratio)
    return start < ((1 + ASIDE) ** 2 + WRONG) * second


# -- events: what happens when a condition is met, and how it is found in time ---------------------

#: how often an event may happen within a step
OFTEN = 20


class Event(Attached):
    """Something that happens when a number passes through zero.

    The number is looked at after each step. Where its sign has changed, the step is repeated with
    shorter ones until the time is known to `tolerance`: the state of an event is one of the scheme,
    as any other. So it is where the number passes through zero and back within a step, if its
    values at the ends of the last two steps (in the first step: and at its middle) tell: where
    the parabola through them comes near zero, shorter steps look for the lowest point. What is
    faster, say a vibration with few steps in its period, may not be seen.

    Parameters
    ----------
    condition : Condition or callable
        ``ConditionCoordinate``, ``ConditionSensor``, ``ConditionReaction``, ``ConditionEnergy``,
        ``ConditionTime``, or a function ``(time, view) -> float``, see :class:`View`.
    action : Action or callable, optional
        ``ActionStop``, ``ActionLoad``, ``ActionLock``, ``ActionUnlock``, ``ActionRelease``, or a
        function ``(time, view)`` that gives the model to go on with. Default: it is recorded.
    direction : {0, 1, -1}
        1: upwards only, -1: downwards only.
    name : str
    once : bool
        It happens at the first time only; False: each time.
    tolerance : float, optional
        Of its time (s); default: 1e-10 of the step.

    Raises
    ------
    InputError
        For other arguments; before the run for items that are not in the system, and values that
        are no finite numbers.

    Examples
    --------
    A ball on a rod is let go at the lowest point:

    >>> from skfem_cosserat import ActionRelease, ConditionSensor, EnergyMomentum, JointDistance
    >>> from skfem_cosserat import LoadGravity, MassPoint, Model, NullSpace, SensorPosition
    >>> from skfem_cosserat import ground, simulate
    >>> model = Model()
    >>> ball = model.add("ball", MassPoint(1.0, position=(-1, 0, 0)))
    >>> rod = model.add("rod", JointDistance(ground((0, 0, 0)), ball.place()))
    >>> gravity = model.add("gravity", LoadGravity((0, 0, -10.0)))
    >>> lowest = ConditionSensor(SensorPosition(ball.place()), level=0.0, component=0)
    >>> run = model.freeze(), EnergyMomentum(), NullSpace(), 0.01, 1.0
    >>> history = simulate(*run, events=[Event(lowest, ActionRelease(rod), name="let go")])
    >>> event = history.events[0]
    >>> event.name, event.action, round(event.time, 3), history.segments == [(0, 60), (60, 103)]
    ('let go', 'ActionRelease(rod)', 0.586, True)
    """

    def __init__(
        self,
        condition: Condition | Callable[[float, View], float],
        action: Action | Callable[[float, View], object] | None = None,
        direction: int = 0,
        name: str = "event",
        once: bool = True,
        tolerance: float | None = None,
    ):
        if not isinstance(name, str) or not name:
            raise InputError("event", f"name = {name!r}, expected a non-empty string")
        self.name = name
        self.once = switch(self.label, once, "once")
        whole = isinstance(direction, (int, np.integer)) and not isinstance(direction, bool)
        if not whole or direction not in (-1, 0, 1):
            raise InputError(self.label, f"direction = {direction!r}, expected -1, 0 or 1")
        if not isinstance(condition, Condition):
            condition = ConditionFunction(condition)
        self.condition: Condition = condition
        self.direction = int(direction)
        if action is None:
            action = ActionNone()
        self.action = action if isinstance(action, Action) else ActionFunction(action)
        self.tolerance = (
            None if tolerance is None else positive(self.label, "tolerance", tolerance, " of s")
        )

    @property
    def label(self) -> str:
        """Name in errors."""
        return f"event {self.name!r}"

    def values(self, states: Window) -> Floats | None:
        """Its condition's numbers at several states; None: each state is to be looked at alone.

        Also where they cannot be had: a run may end before it gets to these states.
        """
        condition = self.condition
        if not isinstance(condition, OfStates) or condition.of_the_user:
            return None
        if type(condition).value is not OfStates.value:  # of a class derived by a user
            return None
        try:
            with np.errstate(all="ignore"):
                return condition.values(states)
        except (CosseratError, ArithmeticError):
            return None

    def value(self, view: View) -> float:
        """Its condition's number, finite.

        Raises
        ------
        InputError
            If it is not.
        """
        try:
            value = self.condition.value(view)
        except InputError as error:
            raise InputError(self.label, str(error)) from error
        if not isfinite(value):
            raise InputError(self.label, f"its condition is {value!r} at t = {view.time:.9g} s")
        return value


def checked_events(
    events: Sequence[Event] | None, integrator: Integrator, system: System
) -> list[Event]:
    """Events that can be found in a run.

    Raises
    ------
    InputError, IncompatibleError
        If something is no event, names repeat, items are not in the system, or the scheme is
        explicit.
    """
    item = "argument events"
    if events is None:
        return []
    if not isinstance(events, Sequence):
        raise InputError(item, f"{events!r}, expected a list of events")
    names = set()
    for event in events:
        if not isinstance(event, Event):
            raise InputError(item, f"{event!r}, expected an Event")
        if event.name in names:
            raise InputError(item, f"two events are called {event.name!r}: give each a name")
        names.add(event.name)
        if integrator.fixed_step is not None and integrator.frequency_limit is None:
            reason = "its steps are bound to the elements' limits and cannot be shortened"
            raise IncompatibleError(f"{event.label} with {integrator!r}", reason)
        for part in (event.condition, event.action):
            try:
                part.check(system)
            except InputError as error:
                raise InputError(event.label, str(error)) from error
    return list(events)


class Found(NamedTuple):
    """Events of one instant.

    Attributes
    ----------
    steps : Block or None
        Steps before the one in which they happen; None: there are none.
    last : Block
        The step that ends where they happen.
    events : list of (Event, float)
        With the values of their conditions.
    view : View
        Of the state there.
    """

    steps: Block | None
    last: Block
    events: list[tuple[Event, float]]
    view: View


class _Trials:
    """Steps of other sizes in place of step k of a block, each of them solved once."""

    def __init__(self, watch: EventMonitor, block: Block, k: int):
        self.watch, self.state, self.step = watch, block.state_after(k - 1), block.part(k, k + 1)
        self.h = float(block.times[k]) - self.state.time
        self._known: dict[float, Block] = {}

    def of(self, event: Event, side: int) -> Trial:
        """The number of an event at their ends, times a sign."""

        def trial(size: float) -> tuple[float, Block]:
            if size not in self._known:
                self._known[size] = self.watch.step(self.state, size, self.step.sizes[0])
            block = self._known[size]
            return side * event.value(self.watch.seen(block.state)), block

        return trial


class _Motions:
    """Velocities and energies by compiled kernels, where steps take some; made when asked for."""

    def __init__(self, stepper: Stepper):
        self._stepper = stepper

    def __reduce__(self) -> Any:
        """None: kernels work in arrays at their addresses, and a copy of a view does without."""
        return type(None), ()

    @cached_property
    def _made(self) -> CompiledMotion | None:
        choice = self._stepper.choice
        numba = choice.name == "numba"
        return motion_by_kernels(self._stepper.system, choice.source) if numba else None

    def __call__(self, q: Floats, p: Floats) -> Motion | None:
        """Motion of one or several states; None if there are no kernels for it."""
        return None if self._made is None else self._made(q, p)


#: numbers below this share of the largest one, of states that are looked at together, are looked at
#: alone: far above what rounding may change
NEAR = 1e-9


class EventMonitor:
    """Looks for events in the steps of a run.

    Numbers of a block's states are found together where all conditions can be (:class:`OfStates`):
    steps in which one comes near to zero, or may, are then looked at one by one, as others are.
    Functions of users are called at state after state, and never at one that is later than an
    event.

    Parameters
    ----------
    events : list of Event
    factory : StepperFactory
        Of the steppers that repeat a step.
    stepper : Stepper
        Of the run.
    state : State
        Start of the run.

    Attributes
    ----------
    passed : int
        Number of steps of the last block in which nothing has happened.
    """

    passed = 0

    def __init__(
        self, events: list[Event], factory: StepperFactory, stepper: Stepper, state: State
    ):
        self.events = list(events)
        self.factory = factory
        self._times: dict[str, list[float]] = {event.name: [] for event in events}
        #: sign of each event's number, of one that is zero that before it
        self._sides = [0] * len(events)
        #: solves steps of other sizes
        self._stepper: Stepper | None = None
        self.go_on(stepper, state)

    def go_on(self, stepper: Stepper, state: State, found: Found | None = None) -> None:
        """Begin at a state, after events that were found there."""
        before = dict(zip([event.name for event in self.events], self._sides, strict=True))
        done = {} if found is None else {event.name: value for event, value in found.events}
        for name in done:
            before[name] *= -1
        self.events = [each for each in self.events if not (each.once and each.name in done)]
        if self._stepper is not None and self._stepper.system is not stepper.system:
            self._stepper = None
        self.system = stepper.system
        self._motions = _Motions(stepper)
        self.view = self.seen(state)
        #: times of the last two states, and the numbers there
        self._last = np.array([state.time])
        self._numbers = np.array([[event.value(self.view) for event in self.events]])
        self._sides = [before.get(event.name, 0) for event in self.events]
        # what is at zero there has passed it
        anew = [
            value != done.get(each.name) for each, value in zip(self.events, self._now, strict=True)
        ]
        self._pass(self._last, self._numbers, np.array(anew, bool))

    @property
    def _now(self) -> list[float]:
        """Numbers at the last state."""
        return self._numbers[-1].tolist()

    def seen(self, state: State) -> View:
        """View of a state of the run."""
        view = View(self.system, state)
        view._states._motions = self._motions
        return view

    def look(self, block: Block) -> Found | None:
        """The first events of some steps; None: there are none."""
        values = self._together(block)
        alone = np.arange(len(block)) if values is None else self._near(values)
        times = np.append(self._last, block.times)
        for k in [*alone.tolist(), len(block)]:
            if values is not None and k:  # nothing has happened in the first k steps
                self._pass(times[k : k + 2], values[k : k + 2])
            if k == len(block):
                return None
            self.passed = k
            found = self._look(block, k)
            if found is not None:
                return found
        return None

    def _together(self, block: Block) -> Floats | None:
        """Numbers (2 + k, events) of the last two states and of a block's; None: not together."""
        if len(self._last) < 2 or len(block) == 1:
            return None
        states = Window(self.system, block.times, block.q, block.p, block.turns, self._motions)
        columns = [event.values(states) for event in self.events]
        known = [column for column in columns if column is not None]
        if len(known) < len(columns) or not known:
            return None
        return np.concatenate([self._numbers, np.array(known).T])

    @staticmethod
    def _near(values: Floats) -> IndexArray:
        """Steps in which a number may come near to zero, which are looked at alone."""
        near = NEAR * abs(values).max(0)
        side = np.sign(values[2:])
        before, start, end = side * values[:-2], side * values[1:-1], side * values[2:]
        apart = (start > near) & (end > near) & ~comes_near(before, start, end)
        return np.flatnonzero(~apart.all(1))

    def _pass(self, times: Floats, numbers: Floats, which: Any = True) -> None:
        """Go on behind states at these times, with the signs of some numbers at the last one."""
        self._last = times[-2:]
        self._numbers = numbers[-2:]
        signs = np.sign(numbers[-1])
        self._sides = np.where(which & (signs != 0), signs, self._sides).astype(int).tolist()

    def _look(self, block: Block, k: int) -> Found | None:
        """The first events of step k; None: there were none."""
        view = self.seen(block.state_after(k))
        values = [event.value(view) for event in self.events]
        trials = _Trials(self, block, k)
        found = [self._bracket(j, trials, value) for j, value in enumerate(values)]
        if not any(found):
            self._pass(np.append(self._last, view.time), np.vstack([self._numbers, values]))
            return None
        where = [
            located(each, trials.of(event, each.side), self._width(event, trials))
            for event, each in zip(self.events, found, strict=True)
            if each
        ]
        last = min(where, key=lambda each: each.state.time)
        view = self.seen(last.state)
        size = last.state.time - trials.state.time
        events = []
        for j, (event, bracket) in enumerate(zip(self.events, found, strict=True)):
            value = event.value(view)
            side = self._sides[j]
            if bracket is not None and size > bracket.a[0]:
                side = bracket.side
            if self._met(j, value, side):
                self._sides[j] = side
                events.append((event, value))
        state = last.state
        step = float(trials.step.sizes[0])
        for event, _ in events:
            times = [t for t in self._times[event.name] if t > state.time - step] + [state.time]
            self._times[event.name] = times
            if len(times) > OFTEN:
                reason = f"{event.label} repeats at once: {OFTEN} times within {step:.3g} s"
                advice = "let it happen once, or let its action change what its condition sees"
                raise Diverged(state.time, state.index, float("nan"), reason, advice)
        return Found(block.part(0, k) if k else None, last, events, view)

    def _met(self, j: int, value: float, before: int) -> bool:
        """True if a number has passed through zero, in the direction asked for."""
        if before in (0, self.events[j].direction):
            return False
        # just before it, as well: a step of rounding size would have no velocity
        if before * value > LOCATED * max(before * (self._now[j] - value), 0.0):
            return False
        return not self._jumps(j, value)

    def _jumps(self, j: int, value: float) -> bool:
        """True if an angle has passed the point half a turn from its level, where it jumps."""
        period = self.events[j].condition.period
        return period is not None and abs(value - self._now[j]) >= period / 2

    def _bracket(self, j: int, trials: _Trials, value: float) -> Bracket | None:
        """Bracket of a zero of a number in the step to this value; None: there is none."""
        event, side, start = self.events[j], self._sides[j], self._now[j]
        a = (0.0, max(start * side, 1e-300))
        b = (trials.h, value * side)
        if self._met(j, value, side):
            return Bracket(side, a, b, trials.step)
        if not b[1] > 0 or event.condition.monotonic or self._jumps(j, value):
            return None
        trial = trials.of(event, side)
        try:
            if len(self._last) > 1:
                before = float(self._numbers[0, j])
                time = float(self._last[0])
                if self._jumps(j, before):
                    return None
                near = comes_near(side * before, a[1], b[1], (trials.state.time - time) / trials.h)
            else:  # the middle stands for the step before
                middle = trial(trials.h / 2)[0]
                near = comes_near(a[1], middle, b[1]) or comes_near(b[1], middle, a[1])
            found = dip(trial, trials.h) if near else None
        except Diverged as error:  # the run itself has got over it
            logger.debug("%s: a part of the step cannot be solved: %s", event.label, error)
            return None
        if found is None:
            return None
        inside, there = found
        if event.direction == side:  # the way back is asked for
            a, b = ((t, -f) for t, f in (inside, b))
            return Bracket(-side, a, b, trials.step)
        return Bracket(side, a, inside, there)

    def _width(self, event: Event, trials: _Trials) -> float:
        """Time (s) to which an event is located."""
        width = LOCATED * trials.h if event.tolerance is None else event.tolerance
        return max(width, 4 * float(np.spacing(abs(trials.step.state.time))))

    def step(self, state: State, size: float, like: float) -> Block:
        """A step of any size (s) from a state; `like`: the size of those of the run."""
        if self._stepper is None:
            self._stepper = self.factory(self.system, like)
        return self._stepper.advance_block(state, 1, state.time + size, size)


@takes_scene
def after_events(
    system: System, history: History, events: Sequence[Event]
) -> tuple[System, list[Event]]:
    """The system at the end of a history, and the events that have still to happen.

    Parameters
    ----------
    system : Model or System
        That the run began with.
    history : History
        Its states; events later than its last one have not happened yet.
    events : list of Event
        Those of the run. What they did to the system is done again, functions are called again.

    Returns
    -------
    (System, list of Event)
        For :func:`restart` and :func:`simulate`.

    Raises
    ------
    InputError
        If an event of the history is not among them.

    Examples
    --------
    A ball that is let go after 0.1 s:

    >>> from skfem_cosserat import ActionRelease, ConditionTime, EnergyMomentum, Event
    >>> from skfem_cosserat import JointSpherical, MassPoint, Model, NullSpace, ground, simulate
    >>> model = Model()
    >>> ball = model.add("ball", MassPoint(1.0))
    >>> hook = model.add("hook", JointSpherical(ground((0, 0, 0)), ball.place()))
    >>> rail = model.add("sledge", MassPoint(1.0, (1.0, 0, 0)))
    >>> events = [Event(ConditionTime(0.1), ActionRelease(hook), name="let go")]
    >>> history = simulate(model, EnergyMomentum(), NullSpace(), 0.05, 0.2, events=events)
    >>> system, to_come = after_events(model, history, events)
    >>> len(system.joints), to_come
    (0, [])
    """
    item = "argument events"
    if not isinstance(events, Sequence) or not all(isinstance(each, Event) for each in events):
        raise InputError(item, f"is of type {type(events).__name__}, expected a list of events")
    named = {event.name: event for event in events}
    done = [record for record in history.events if record.row < len(history)]
    for record in done:
        if record.name not in named:
            known = f"expected those of the run; given: {sorted(named)}"
            raise InputError("argument events", f"{record.name!r} is missing, {known}")
        row = history.row(record.row)
        state = State(record.time, record.step, row["q"], row["carried"])
        changed = named[record.name].action.outcome(View(system, state)).system
        system = system if changed is None else changed
    happened = {record.name for record in done}
    return system, [e for e in events if not (e.once and e.name in happened)]
