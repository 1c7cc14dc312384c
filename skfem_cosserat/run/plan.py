"""Plans of a run: steps of one size, and steps whose size follows from a tolerance."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ..errors import Diverged, IncompatibleError, InputError
from ..frozen import Frozen
from ..integrators import Block, Integrator, State, Stepper
from ..model import System
from ..types import Floats, check_kind, positive
from ..warn import logger

# -- how a run goes on in time: steps of one size, or others that a controller chooses -------------


#: makes the stepper of a run for a system and a step size (s)
StepperFactory = Callable[[System, float], Stepper]


class Plan(ABC):
    """Steps of a run, a block at a time.

    Attributes
    ----------
    stepper : Stepper
        Of the steps that go on.
    h : float
        Size (s) of the last step or the next.
    """

    stepper: Stepper
    h: float

    @abstractmethod
    def advance(self, state: State) -> Block | None:
        """Steps after a state; None at the end of the run."""

    @abstractmethod
    def begin(self, stepper: Stepper, state: State) -> None:
        """Go on from a state between its steps."""

    def summary(self) -> dict[str, Any]:
        """Metadata for the history."""
        return {}


class FixedSteps(Plan):
    """Steps of one size.

    Parameters
    ----------
    stepper : Stepper
    state : State
        Start of the run.
    until : float
        Its end (s); the last step ends there or before.
    eventful : bool
        Steps end exactly there, of the stepper's size or less, with events between them, or
        instants at which laws are sampled: as many
        in one go as there have been since the last event, so that few are solved in vain.
    alone : bool
        True if each step is taken alone.
    """

    def __init__(
        self, stepper: Stepper, state: State, until: float, eventful: bool, alone: bool
    ) -> None:
        self._eventful, self._alone, self._end = eventful, alone, until
        self.h = self._size = stepper.h
        item, given, left = "argument step", f"{stepper.h!r} s", until - state.time
        self.begin(stepper, state)
        if not self._count:
            span = f"{left:.6g} s from {state.time!r} s to {until!r} s"
            text = f"is longer than the run, {span}: take a shorter step, or a later end"
            raise InputError(item, f"{given} {text}")

    def advance(self, state: State) -> Block | None:
        """Steps as far as they are taken in one go."""
        sampled = self.stepper.sampled(state)
        if sampled is not state:
            self.begin(self.stepper, sampled)
            state = sampled
        done = state.index - self._first
        left = self._count - done
        if left <= 0:
            return None
        most = 1 if self._alone else max(1, min(done, left)) if self._eventful else left
        return self.stepper.advance_block(
            state, most, self._time, self.h if self._eventful else None
        )

    def _time(self, index: Any) -> Any:
        """Times of states with these indices: t_n = t_0 + n h, no rounding adds up over steps."""
        return self._origin + (index - self._first) * self.h

    def begin(self, stepper: Stepper, state: State) -> None:
        """Equal steps to the same end, of the size asked for or, with events, less.

        Before it they end where a law is to be sampled.
        """
        due = stepper.system.couplings.due(state.turns)
        left = (due if state.time < due < self._end else self._end) - state.time
        steps = left / self._size
        self.stepper, self._origin, self._first = stepper, state.time, state.index
        if not self._eventful:
            self._count = int(steps * (1 + 1e-12) + 1e-9)
            return
        self._count = max(0, int(np.ceil(steps - 1e-9)))
        if self._count:
            h = left / self._count
            # schemes of fixed steps take no others
            self.h = self._size if abs(h - self._size) <= 1e-9 * h else h


# -- what a pair of steps is wrong by, in positions and in velocities ------------------------------

#: errors below this (of the scene's extent, rad) are the solver's
ROUNDING = 1e-12
#: pairs of steps whose errors bound that of velocities
RECENT = 50


def size(system: System, change: Floats) -> float:
    """Largest change of a configuration (n,): positions by the scene's extent, directors."""
    rows = np.linalg.norm(change.reshape(-1, 3), axis=1)
    rows[system.origin_rows] /= system.length
    return float(rows.max(initial=0.0))


class Estimate:
    """Local errors of pairs of steps.

    Positions of one step of size H and of two of half the size differ by the error of the pair
    times ``2^p - 1``: ``e = H^(p+1) c(t)`` for order p. Twice in each swing c passes through zero,
    where the error is in the velocities. That one, ``H^(p+1) dc/dt``, follows from c of the pair
    before; it counts by the time in which the motion changes, the root of ``int |v|^2 dt`` by
    ``int |a|^2 dt`` so far, but not for more than errors of positions did lately: c of vibrations
    that are not resolved has no rate.

    Parameters
    ----------
    order : int
    """

    def __init__(self, order: int) -> None:
        self.order = order
        self._speeds = self._bends = 0.0
        self._recent: deque[float] = deque(maxlen=RECENT)
        self._before: tuple[float, Floats] | None = None
        self._now: tuple[float, Floats] | None = None

    def begin(self) -> None:
        """Begin anew: the next pair is no continuation of the last one."""
        self._before = None

    def error(
        self, system: System, time: float, pair: float, whole: Floats, halves: tuple[Floats, ...]
    ) -> float:
        """Error of a pair of steps of size `pair` together.

        Parameters
        ----------
        time : float
            At its start.
        whole : (n,) array
            Its end by one step.
        halves : three (n,) arrays
            Start, middle and end.
        """
        scale = pair ** (self.order + 1)
        c = (whole - halves[2]) / ((2**self.order - 1) * scale)
        rate = size(system, c)
        middle = time + pair / 2
        if rate * scale < ROUNDING:
            c = np.zeros_like(c)
            rate = 0.0
        self._now = (middle, c)
        self._rate = rate
        v = size(system, halves[2] - halves[0]) / pair
        a = 4 * size(system, halves[2] - 2 * halves[1] + halves[0]) / pair**2
        self._motion = v**2 * pair, a**2 * pair
        if self._before is None or not self._recent:
            return rate * scale
        speeds = self._speeds + self._motion[0]
        bends = self._bends + self._motion[1]
        change = np.sqrt(speeds / bends) if bends > 0 else 0.0
        slope = size(system, c - self._before[1]) / (middle - self._before[0])
        return scale * max(rate, min(change * slope, max(self._recent)))

    def accept(self) -> None:
        """The pair whose error was asked for last goes on."""
        self._before = self._now
        self._recent.append(self._rate)
        self._speeds += self._motion[0]
        self._bends += self._motion[1]


# -- step control: what a step may be wrong by, and the sizes that follow from it ------------------

#: share of the step that the estimate asks for, and bounds of its change
SAFETY, LEAST, LARGEST = 0.9, 0.2, 2.0
#: steps are not changed for less than this: kept factors of matrices belong to a step size
WORTHWHILE = 1.15
#: exponents of the present and the last error (Gustafsson's proportional-integral control)
PRESENT = 0.7
BEFORE = 0.3


class StepControl(Frozen):
    """Steps as long as a tolerance allows; for the argument `step` of :func:`simulate`.

    Steps come in pairs. Each pair is compared with one step of twice the size: of order p, it is
    wrong by ``1/(2^p - 1)`` of their difference; where that changes, velocities are wrong. The
    error, of positions by the extent of the scene and of directors as it is, the largest of all
    nodes, may be ``tolerance`` times the pair's share of the run. Local errors of the whole run
    thus add up to the tolerance at most; what becomes of them in the motion is not known: the true
    error is of the tolerance's size in regular motion, and proportional to it. The pair goes on,
    so what the scheme conserves is conserved.

    Parameters
    ----------
    tolerance : float
        Of the whole run: relative to the extent of the scene, and in rad.
    first : float, optional
        First step (s); default: a thousandth of the run.
    smallest, largest : float, optional
        Bounds of steps (s), but for those that end at a time asked for; default: 1e-9 of the run,
        and a twentieth of it.
    span : float, optional
        Time (s) over which errors add up to the tolerance; default: the run's.

    Raises
    ------
    InputError
        If a number is not positive, or `smallest`, `first` and `largest` are not in this order.

    Notes
    -----
    For schemes whose steps may vary, such as energy-momentum and generalized-alpha. Symplectic ones
    are refused; :func:`skfem_cosserat.answer` finds the fixed step for a tolerance.
    A step that cannot be solved counts as one that is too large. Proportional-integral control:
    Gustafsson, ACM Trans. Math. Softw. 17 (1991) 533; error per unit step: Hairer, Norsett &
    Wanner, Solving Ordinary Differential Equations I, II.4.

    Examples
    --------
    >>> from skfem_cosserat import EnergyMomentum, JointDistance, LoadGravity, MassPoint, Model
    >>> from skfem_cosserat import NullSpace, ground, simulate
    >>> model = Model()
    >>> bob = model.add("bob", MassPoint(1.0, position=(1, 0, 0)))
    >>> rod = model.add("rod", JointDistance(ground((0, 0, 0)), bob.place()))
    >>> gravity = model.add("gravity", LoadGravity((0, 0, -10.0)))
    >>> run = model.freeze(), EnergyMomentum(), NullSpace()
    >>> history = simulate(*run, step=StepControl(tolerance=1e-3), until=1.0)
    >>> control = history.meta["step_control"]
    >>> float(history.times[-1]), control["smallest"] < control["largest"] / 5
    (1.0, True)
    """

    def __init__(
        self,
        tolerance: float,
        first: float | None = None,
        smallest: float | None = None,
        largest: float | None = None,
        *,
        span: float | None = None,
    ) -> None:
        item = "step control"
        self.tolerance = positive(item, "tolerance", tolerance)
        given = {"first": first, "smallest": smallest, "largest": largest, "span": span}
        sizes = {
            name: None if value is None else positive(item, name, value, " of seconds")
            for name, value in given.items()
        }
        self.first = sizes["first"]
        self.smallest = sizes["smallest"]
        self.largest = sizes["largest"]
        self.span = sizes["span"]
        order = [x for x in (self.smallest, self.first, self.largest) if x is not None]
        if order != sorted(order):
            raise InputError(
                item,
                f"smallest = {self.smallest}, first = {self.first}, largest = {self.largest},"
                " expected them in ascending order",
            )

    def __repr__(self) -> str:
        return f"StepControl(tolerance={self.tolerance:g})"

    def sizes(self, integrator: Integrator, duration: float) -> tuple[float, float, float]:
        """First, smallest and largest step (s) of a run.

        Raises
        ------
        IncompatibleError
            If the steps of the scheme must not vary.
        """
        check_kind("argument integrator", integrator, Integrator)
        if integrator.fixed_step is not None:
            raise IncompatibleError(
                f"{integrator!r} with {self!r}",
                f"the scheme is {integrator.fixed_step}; give a step, which sc.answer finds for"
                " a tolerance, or take EnergyMomentum()",
            )
        largest = duration / 20 if self.largest is None else self.largest
        smallest = 1e-9 * duration if self.smallest is None else self.smallest
        first = duration / 1000 if self.first is None else self.first
        return max(smallest, min(first, largest)), smallest, largest


class ControlledSteps(Plan):
    """Pairs of steps under control.

    Parameters
    ----------
    control : StepControl
    factory : StepperFactory
    stepper : Stepper
        Of the pairs.
    state : State
        Start of the run.
    until : float
    at : sequence of float
        Times that are to be met exactly.
    """

    def __init__(
        self,
        control: StepControl,
        factory: StepperFactory,
        stepper: Stepper,
        state: State,
        until: float,
        at: Sequence[float] = (),
    ) -> None:
        duration = until - state.time
        self.control = control
        self.factory = factory
        self.span = duration if control.span is None else control.span
        self._wanted, self.smallest, self.largest = control.sizes(stepper.integrator, duration)
        self.h = stepper.h
        self._targets = sorted(
            {*(min(float(t), until) for t in at if t > state.time), float(until)}
        )
        self._order = stepper.integrator.order
        self._estimate = Estimate(self._order)
        self._counts = dict.fromkeys(("accepted", "rejected", "unsolved", "iterations"), 0)
        self._used: list[float] = []
        self._before = 1.0
        self.begin(stepper, state)

    def begin(self, stepper: Stepper, state: State) -> None:
        """Pairs of steps of this stepper, of the size there was."""
        self.stepper = stepper
        self._coarse = self.factory(stepper.system, 2 * self.h)
        self._held = False
        self._estimate.begin()

    def advance(self, state: State) -> Block | None:
        """A pair of steps."""
        sampled = self.stepper.sampled(state)
        if sampled is not state:
            self._estimate.begin()
            state = sampled
        while self._targets and self._targets[0] - state.time <= 1e-12 * self.span:
            self._targets.pop(0)
        if not self._targets:
            return None
        due = self.stepper.system.couplings.due(state.turns)
        while True:
            pair, end = self._pair(state.time, due)
            try:
                block, error = self._try(state, pair, end)
            except Diverged as failure:
                self._counts["unsolved"] += 1
                if pair <= 2 * self.smallest:
                    raise
                logger.info("%s: a smaller one is tried", failure)
                self._wanted = max(pair / 8, self.smallest)
                self._held = True
                continue
            ratio = error / (self.control.tolerance * pair / self.span)
            if ratio <= 1:
                self._accept(pair, ratio)
                return block
            self._counts["rejected"] += 1
            if pair <= 2 * self.smallest:
                raise Diverged(
                    state.time,
                    state.index + 1,
                    ratio,
                    f"its error is {ratio:.3g} times what the tolerance of"
                    f" {self.control.tolerance:g} allows for the smallest step",
                    f"allow a smaller one than {self.smallest:g} s, or take a larger tolerance",
                )
            change = max(LEAST, SAFETY * (1 / ratio) ** (1 / self._order))
            self._wanted = max(change * pair / 2, self.smallest)
            self._held = True

    def _pair(self, time: float, due: float) -> tuple[float, float]:
        """Size of a pair of steps, and its end: no step is left that is much smaller."""
        target = min(self._targets[0], due)
        left = target - time
        if 2 * self._wanted >= left * (1 - 1e-9):
            return left, target
        pair = min(2 * self._wanted, left / 2)
        return pair, time + pair

    def _try(self, state: State, pair: float, end: float) -> tuple[Block, float]:
        """Two steps and one of twice the size; what the two are wrong by."""
        whole = self._coarse.advance(state, end, pair)
        self.h = pair / 2
        first = self.stepper.advance_block(state, 1, state.time + self.h, self.h)
        block = Block.joined([first, self.stepper.advance_block(first.state, 1, end, self.h)])
        self._counts["iterations"] += whole.iterations + int(block.iterations.sum())
        halves = state.q, *block.q
        chosen = self.stepper.system, state.time, pair, whole.state.q, halves
        return block, self._estimate.error(*chosen)

    def _accept(self, pair: float, ratio: float) -> None:
        self._counts["accepted"] += 2
        self._estimate.accept()
        self._used.append(pair / 2)
        cut = pair < 2 * self._wanted * (1 - 1e-9)  # to end at a time asked for
        last = self._before
        self._before = max(ratio, 1e-4)
        change = (SAFETY / self._before) ** (PRESENT / self._order)
        change *= (last / SAFETY) ** (BEFORE / self._order)
        change = min(max(change, LEAST), 1.0 if self._held else LARGEST)
        self._held = False
        if cut and change >= 1:
            return
        if not 1 / WORTHWHILE < change < WORTHWHILE:
            self._wanted = min(max(change * pair / 2, self.smallest), self.largest)

    def summary(self) -> dict[str, Any]:
        """Sizes and numbers of the steps taken, and of those rejected."""
        used = self._used or [self._wanted]
        sizes = {"smallest": min(used), "largest": max(used)}
        counts = {"tolerance": self.control.tolerance, **self._counts, **sizes}
        counts["factorisations_check"] = self._coarse.factorisations
        logger.info(
            "step control: %d steps from %.3g to %.3g s, %d pairs rejected, %d not solved",
            *(self._counts["accepted"], *sizes.values()),
            *(self._counts["rejected"], self._counts["unsolved"]),
        )
        return {"step_control": counts}
