"""Reports of steps: how they ended, the next state, and forces of constraints."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from ..constraints.saddle import accelerations, nearest_momentum, nearest_velocity
from ..errors import CosseratError, Diverged, InputError
from ..model import System
from ..newton import NewtonSettings
from ..types import Floats
from .base import Integrator
from .compiled_step import BlockOfSteps
from .scheme import State, StepOrigin, StepWork, carried_rates

__all__ = ["BlockReport", "Code", "Failure", "StepReport", "composed"]
__all__ += ["OF_USERS", "ForcePoint", "StateForces", "force_points", "forces_of_states"]
__all__ += ["one_sided"]

# -- what a solved step gives beside the next state ------------------------------------------------


class Code(Enum):
    """Outcome of a step."""

    SOLVED = "solved"
    UNSOLVED = "no attempt was solved"
    JUMP = "prescribed motion jumps"
    DEAD_POINT = "prescribed motion has reached a dead point of a closed loop"
    CONTRADICTION = "prescribed motions contradict each other around a closed loop"


@dataclass(eq=False, repr=False)
class Failure:
    """A step that is not solved; an error is made of it only where nothing else is tried.

    Attributes
    ----------
    code : Code
    state : State
        That the step started from.
    residual : float
        The best one of all attempts.
    reason, advice, effort : str
        Why it is not solved, what to try, and what was tried.
    residuals : sequence of lists of float
        Of each attempt.
    """

    code: Code
    state: State
    residual: float
    reason: str
    advice: str
    effort: str = ""
    residuals: Sequence[list[float]] = ()

    def error(self, settings: NewtonSettings) -> Diverged:
        """Exception that tells of the failure."""
        return Diverged(
            *(self.state.time, self.state.index + 1, self.residual, self.reason, self.advice),
            residuals=list(self.residuals),
            settings=settings if self.residuals else None,
            effort=self.effort,
        )


@dataclass(eq=False, repr=False)
class StepReport:
    """Result of a solved step: the next state, and how it was found.

    Attributes
    ----------
    state : State
        At the end of the step.
    iterations, attempts : int
        Newton iterations (of all attempts) and attempts (1: none was repeated).
    residual : float
        Scaled residual at the solution.
    work : StepWork
        Of loads, actuators and dampers in the step.
    system : System
    integrator : Integrator
        Of a single step.
    step : float
        Its size (s); of a composed one that of all its parts, which may go back in time.
    start : State
        That it started from; of several steps, that before the last one.
    y1 : (total, 3) array
        All rows of y at its end.
    impulse : (rows, 3) array
        ``h G^T lambda``.
    parts : sequence of StepReport
        The steps that a composed one is made of.
    by_motion : bool
        Of a step that is composed of others, or explicit, the constraint force is that of the
        continuous equations at the start: the steps give theirs to second order only. So it is with
        the part of the momentum along ``G^T`` that nodes of the variational scheme have: it is left
        out.
    code : Code
        ``Code.SOLVED``; see :class:`Failure` for others.
    """

    code = Code.SOLVED
    state: State
    iterations: int
    attempts: int
    residual: float
    work: StepWork
    system: System
    integrator: Integrator
    step: float
    start: State
    y1: Floats
    impulse: Floats
    parts: Sequence[StepReport] = ()
    by_motion: bool = False

    def __repr__(self) -> str:
        end, name = self.state, type(self).__name__
        return f"<{name}: to step {end.index}, t = {end.time:g} s, {self.iterations} iterations>"

    @property
    def stages(self) -> list[StepReport]:
        """The steps that a composed one is made of, itself otherwise."""
        return list(self.parts) or [self]

    @property
    def steps(self) -> int:
        """Number of steps solved: more than one for those of :meth:`Stepper.advance_block`."""
        return 1

    @property
    def all_iterations(self) -> int:
        """Newton iterations of all of them."""
        return self.iterations

    def part(self, k: int) -> StepReport:
        """The k-th of them, as if it were alone; the last three, or any, if every state is kept.

        It is there until the stepper takes the next ones.

        Raises
        ------
        InputError
            If there is no such step, or its states were not kept.
        """
        if k != 0:
            raise InputError("argument k", f"{k!r}, expected 0: the report is of one step")
        return self

    def after(self, k: int) -> State:
        """The state at the end of the k-th of them, as of :meth:`part`, for less."""
        return self.part(k).state

    @property
    def momentum(self) -> Floats:
        """``p_n`` (n,) of the discrete Legendre transform at the *start* of the step."""
        node, state = self.integrator.carries_node_momentum, self.start
        if self.by_motion and not node:  # nothing along G^T changes the velocity
            return nearest_momentum(self.system, self.constraint_point, state.p, state.time)
        if state.fresh or node:
            return state.p.copy()
        # the mean of both transforms (34), (35), whose parts of lambda cancel
        return state.p - 0.5 * self.impulse.reshape(-1)

    @property
    def constraint_force(self) -> Floats:
        """``G^T lambda`` (n,) of the step (N; N m on directors)."""
        if self.by_motion:
            return force_by_motion(self.system, self.start)
        # a given momentum has the other half of the force at a node in it already
        share = 0.5 if self.start.fresh and self.integrator.constraint_weight == 0 else 1.0
        return (self.impulse / (share * self.step)).reshape(-1)

    @property
    def constraint_point(self) -> Floats:
        """Configuration at which the constraint force acts: all rows (total, 3) of y.

        At a node or at the midpoint.
        """
        y0 = self.system.extend(self.start.q, self.start.time)
        weight = 0.0 if self.by_motion else self.integrator.constraint_weight
        return y0 if weight == 0 else weight * self.y1 + (1 - weight) * y0


def composed(stages: list[StepReport], state: State) -> StepReport:
    """Report of a step made of these ones, that ends in a state."""
    first = stages[0]
    return StepReport(
        state,
        sum(stage.iterations for stage in stages),
        max(stage.attempts for stage in stages),
        max(stage.residual for stage in stages),
        StepWork(*np.sum([stage.work for stage in stages], axis=0).tolist()),
        first.system,
        first.integrator,
        sum(stage.step for stage in stages),
        first.start,
        first.y1,
        first.impulse,
        parts=stages,
        by_motion=True,
    )


@dataclass(eq=False, repr=False, kw_only=True)
class BlockReport(StepReport):
    """Report of the last of several steps that were solved in one go, with the work of all.

    Attributes
    ----------
    block : BlockOfSteps
        All of them, until the stepper takes the next ones.
    times : (steps,) array
        Of their ends (s).
    first_start : State
    origin : StepOrigin
    """

    block: BlockOfSteps
    times: Floats
    first_start: State
    origin: StepOrigin

    @classmethod
    def of(
        cls,
        block: BlockOfSteps,
        times: Floats,
        start: State,
        origin: StepOrigin,
        methods: tuple[System, Integrator, float],
    ) -> BlockReport:
        """Report of steps from a state on; `methods`: system, integrator, size of the steps (s)."""
        out = cls(
            start,
            int(block.iterations[-1]),
            1,
            float(block.residual[-1]),
            StepWork(*block.works.sum(0).tolist()),
            *methods,
            start,
            np.concatenate([block.q[-1].reshape(-1, 3), block.ground[-1]]),
            block.impulse[-1].copy(),
            block=block,
            times=times,
            first_start=start,
            origin=origin,
        )
        out.state = replace(out._start(block.steps), plain=block.stuck)
        out.start = out._start(block.steps - 1)
        return out

    @property
    def steps(self) -> int:
        """Number of steps that were solved in one go."""
        return self.block.steps

    @property
    def all_iterations(self) -> int:
        """Newton iterations of all the steps."""
        return int(self.block.iterations.sum())

    def part(self, k: int) -> StepReport:
        """Report of the k-th step as if it were alone, if the states at its ends are kept."""
        b, back = self.block, k - self.steps
        known = self.steps - len(b.q)  # without those whose start is not kept
        if not (known + 1 if known else 0) <= k < self.steps:
            text = f"{k!r}, expected one of {self.steps} steps, taken with every=True"
            raise InputError("argument k", text)
        work = StepWork(*b.works[k].tolist())
        y1 = np.concatenate([b.q[back].reshape(-1, 3), b.ground[back]])
        solved = self.after(k), int(b.iterations[k]), 1, float(b.residual[k]), work
        own = self._start(k), y1, b.impulse[back].copy()
        return StepReport(*solved, self.system, self.integrator, self.step, *own)

    def after(self, k: int) -> State:
        """State at the end of the k-th step."""
        return self.state if k == self.steps - 1 else self._start(k + 1)

    def first(self, steps: int) -> BlockReport:
        """The first ones of them, at least one; as :meth:`part`."""
        some = slice(steps)
        block = BlockOfSteps._make((False, *(each[some] for each in self.block[1:])))
        methods = self.system, self.integrator, self.step
        return self.of(block, self.times[some], self.first_start, self.origin, methods)

    def _start(self, k: int) -> State:
        """State that the k-th step starts from."""
        if not k:
            return self.first_start
        b, index, back = self.block, self.first_start.index + k, k - 1 - self.steps
        turns = b.turns[back].copy() if b.turns.size else None
        own = b.q[back].copy(), b.p[back].copy(), False, turns, carried_rates(b.rates[back])
        return State(float(self.times[k - 1]), index, *own, self.origin)


#: a step against its neighbour, below which its constraint force is nothing but rounding
TINY = 1e-5
#: way to the second instant, against that to the first one, from which on a force is extrapolated
FURTHER = 0.4

#: what functions of a user's own may raise
OF_USERS = (ArithmeticError, LookupError, RuntimeError, TypeError, ValueError)

#: an instant (s), and the constraint force (n,) then
ForcePoint = tuple[float, Floats]


def force_by_motion(system: System, state: State) -> Floats:
    """Constraint force (n,) of a state by the equations of motion there."""
    y = system.extend(state.q, state.time)
    v = nearest_velocity(system, y, state.p, state.time)
    lam = accelerations(system, state.q, v, state.time, state.turns)[1]
    return system.constraints.jacobian(y).T @ lam


def force_point(
    integrator: Integrator, before: StepReport | None, step: StepReport
) -> ForcePoint | None:
    """An instant of a step, and the constraint force then, of the order of the scheme.

    Forces act at the end of a step, at its start or in its middle. Momenta p of schemes with forces
    in the middle are off the hidden constraints by ``j = p - Q p``, which changes sign from step to
    step and makes the forces F alternate by first order; ``F + (j_1 - j_0) / h`` do not.

    Parameters
    ----------
    before : StepReport or None
        The step that led to the start of `step`; None: there is none.

    Returns
    -------
    (float, array) or None
        None where the step does not tell it: it is far smaller than the one before, or its
        momentum was given, and its force of first order only.
    """
    weight, state, k = integrator.constraint_weight, step.start, step.step
    if weight == 1:
        return step.state.time, step.constraint_force
    if step.by_motion:
        return state.time, step.constraint_force
    made = k if state.made_by is None else state.made_by.step
    h = made if before is None else before.step
    if weight == 0:  # its impulse is over half of the step before it, too
        return None if state.fresh else (state.time, step.constraint_force * (2 * k / (h + k)))
    if k < TINY * h:
        return None
    change = _off(step.system, step.state) - _off(step.system, state)
    return state.time + 0.5 * k, step.constraint_force + change / k


def one_sided(time: float, points: Sequence[ForcePoint]) -> Floats | None:
    """Force (n,) at an instant before or after others, on a line through two; None: they are few.

    The nearest one, and the next one that is not too near to that.
    """
    if not points:
        return None
    first, *others = sorted(points, key=lambda each: abs(each[0] - time))
    if first[0] == time:
        return first[1]
    for other in others:
        if abs(other[0] - first[0]) > FURTHER * abs(first[0] - time):
            return _on_line(time, first, other)
    return None


def _on_line(time: float, a: ForcePoint, b: ForcePoint) -> Floats:
    share = (time - a[0]) / (b[0] - a[0])
    return (1 - share) * a[1] + share * b[1]


def force_of_state(
    integrator: Integrator, before: StepReport | None, step: StepReport
) -> tuple[State, Floats] | None:
    """A state at an end of a step, and its constraint force (n,) of the order of the scheme.

    The end of the step, if forces act there, else its start. There the force is the step's own, or
    that between those of the steps before and after, see :func:`force_point`: the mean of what they
    are if the steps are equal, and no energy is taken. Beside a step that is smaller by far the
    force of the longer one is taken, of first order.

    Parameters
    ----------
    before : StepReport or None
        The step that led to the start of `step`; None: there is none.

    Returns
    -------
    (State, array) or None
        None: at a start whose force neither step tells.
    """
    weight, state = integrator.constraint_weight, step.start
    if not 0 < weight < 1:
        found = force_point(integrator, before, step)
        return None if found is None else (step.state if weight == 1 else state, found[1])
    if before is None:
        return None
    h, k = before.step, step.step
    if h == k and not integrator.loses:
        both = before.impulse + step.impulse
        return state, (0.5 / h * both).reshape(-1)
    one, other = (force_point(integrator, None, each) for each in (before, step))
    if min(h, k) < TINY * max(h, k) or one is None or other is None:
        return state, (before if h > k else step).constraint_force
    return state, _on_line(state.time, one, other)


def force_points(integrator: Integrator, steps: Sequence[StepReport]) -> list[ForcePoint]:
    """Points of :func:`force_point` for steps in a row; none if equations of motion give more."""
    if not steps or steps[-1].by_motion:
        return []
    pairs = zip([None, *steps], steps, strict=False)
    found = [force_point(integrator, before, step) for before, step in pairs]
    return [point for point in found if point is not None]


class StateForces:
    """Constraint forces of the states of a run, as its steps tell them one after the other.

    Those of its start and its end follow from steps on one side. Where these are too few, they are
    of the equations of motion.

    Attributes
    ----------
    start : (n,) array or None
        Of the start; None while it waits for more steps.
    """

    def __init__(
        self, integrator: Integrator, system: System, state: State, start: Floats | None = None
    ) -> None:
        self.integrator, self.system, self.state = integrator, system, state
        self._steps: list[StepReport] = []
        self._points: list[ForcePoint] = []
        self.start = start

    def take(self, report: StepReport, wanted: bool = True) -> tuple[State, Floats] | None:
        """Add the next step; gives what :func:`force_of_state` does, None if not `wanted`."""
        before, found = self._steps[-1] if self._steps else None, None
        if wanted:
            found = force_of_state(self.integrator, before, report)
        if self.start is None and found is not None and found[0] is self.state:
            self.start = found[1]
        if self.start is None:
            point = force_point(self.integrator, before, report)
            self._points = [*self._points[:1], *([] if point is None else [point])]
            self.start = one_sided(self.state.time, self._points)
        self.skip([report])
        return found

    def skip(self, reports: Iterable[StepReport]) -> None:
        """Steps whose states nobody asks for."""
        self._steps = [*self._steps, *reports][-3:]

    def end(self) -> tuple[State, Floats]:
        """The end of the last step, and its force; NaN where nothing tells it."""
        if self.start is None:
            self.start = self._by_motion(self.state)
        if not self._steps:
            return self.state, self.start
        state = self._steps[-1].state
        found = one_sided(state.time, force_points(self.integrator, self._steps))
        return state, self._by_motion(state) if found is None else found

    def _by_motion(self, state: State) -> Floats:
        try:
            return force_by_motion(self.system, state)
        except (CosseratError, *OF_USERS):  # a singular configuration, or an unknown load
            return np.full(len(state.q), np.nan)


def forces_of_states(integrator: Integrator, h: float, before: Floats, after: Floats) -> Floats:
    """Constraint forces (N, n) of many states between equal steps, see :func:`force_of_state`.

    For schemes that take no energy at midpoints.
    """
    weight = integrator.constraint_weight
    if weight in (0, 1):
        return (before if weight else after) / h
    return 0.5 / h * (before + after)


def _off(system: System, state: State) -> Floats:
    """Part (n,) of a state's momentum off the hidden constraints, ``p - Q p``."""
    y = system.extend(state.q, state.time)
    return state.p - nearest_momentum(system, y, state.p, state.time)
