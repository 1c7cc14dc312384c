"""Blocks of solved steps: states, impulses and works by arrays, and forces of constraints."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from enum import Enum
from functools import cached_property
from typing import Any

import numpy as np

from ..constraints.saddle import accelerations, nearest_momentum, nearest_velocity
from ..errors import CosseratError, Diverged
from ..model import System
from ..newton import NewtonSettings
from ..types import NO_INDICES, Floats, IndexArray
from .base import Integrator
from .scheme import State, StepOrigin, StepWork, carried_rates

# -- steps that are not solved ---------------------------------------------------------------------


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
        """Error that tells of it."""
        return Diverged(
            self.state.time,
            self.state.index + 1,
            self.residual,
            self.reason,
            self.advice,
            residuals=list(self.residuals),
            settings=settings if self.residuals else None,
            effort=self.effort,
        )


# -- steps that are solved -------------------------------------------------------------------------


@dataclass(eq=False)
class Block(Sequence["StepReport"]):
    """Steps that were solved one after the other, k >= 1 of them; as a sequence their reports.

    Attributes
    ----------
    system : System
    integrator : Integrator
        Of single steps.
    start : State
        Before the first of them.
    origin : StepOrigin
        Scheme and step size of the states between them.
    times, sizes : (k,) arrays
        Ends and sizes of the steps (s); a step that goes back has a negative one.
    q, p : (k, n) arrays
        Configurations at their ends, and momenta that the scheme carries on.
    rates : (k, r, n) array
        What else it carries on.
    turns : (k, angles) array
        Full turns of the angles of force elements.
    ground : (k, g, 3) array
        Rows of the ground.
    impulse : (k, n) array
        ``h G^T lambda``.
    iterations, attempts : (k,) arrays
        Newton iterations (of all attempts) and attempts (1: none was repeated).
    residual : (k,) array
        Scaled residuals at the solutions.
    works : (k, 5) array
        Works (J), as in :class:`.scheme.StepWork`.
    by_motion : bool
        True for steps that are composed of others, or explicit: their constraint force is that of
        the equations of motion at the start, and so is the momentum without its part along ``G^T``.
    stages : Block or None
        Single steps that a composed one is made of; None: the steps are single.
    stuck : bool
        True if the step after them was tried, and not solved.
    """

    system: System
    integrator: Integrator
    start: State
    origin: StepOrigin
    times: Floats
    sizes: Floats
    q: Floats
    p: Floats
    rates: Floats
    turns: IndexArray
    ground: Floats
    impulse: Floats
    iterations: IndexArray
    attempts: IndexArray
    residual: Floats
    works: Floats
    by_motion: bool = False
    stages: Block | None = None
    stuck: bool = False

    @classmethod
    def of_one(
        cls,
        system: System,
        integrator: Integrator,
        start: State,
        state: State,
        size: float,
        ground: Floats,
        impulse: Floats,
        work: StepWork,
        iterations: int,
        attempts: int = 1,
        residual: float = 0.0,
        by_motion: bool = False,
    ) -> Block:
        """Block of a single step from a state to another one."""
        assert state.made_by is not None
        none = NO_INDICES
        return cls(
            system,
            integrator,
            start,
            state.made_by,
            np.array([state.time]),
            np.array([size]),
            state.q[None],
            state.p[None],
            np.zeros((1, 0, len(state.q))) if state.rates is None else state.rates[None],
            (none if state.turns is None else state.turns)[None],
            ground[None],
            impulse.reshape(1, -1),
            np.array([iterations]),
            np.array([attempts]),
            np.array([residual]),
            np.array([work]),
            by_motion,
        )

    @classmethod
    def joined(cls, blocks: Sequence[Block]) -> Block:
        """One block of all steps of some blocks that follow each other."""
        arrays: dict[str, Any] = {
            name: np.concatenate([getattr(block, name) for block in blocks])
            for name in blocks[0]._arrays
        }
        stages = [block.stages for block in blocks if block.stages is not None]
        return replace(blocks[0], **arrays, stages=cls.joined(stages) if stages else None)

    @property
    def _arrays(self) -> list[str]:
        """Names of the arrays that have a row for each step."""
        values = ((each.name, getattr(self, each.name)) for each in fields(self))
        return [name for name, value in values if isinstance(value, np.ndarray)]

    def __len__(self) -> int:
        return len(self.times)

    def __getitem__(self, k: Any) -> Any:
        if isinstance(k, slice):
            raise TypeError("a block of steps has part(), and no slices")
        k = range(len(self))[k]
        return StepReport(self, k)

    def __iter__(self) -> Iterator[StepReport]:
        return (StepReport(self, k) for k in range(len(self)))

    def __repr__(self) -> str:
        index = self.start.index + len(self)
        time = self.times[-1]
        steps = "1 step" if len(self) == 1 else f"{len(self)} steps"
        return f"<Block: {steps} to step {index}, t = {time:g} s>"

    @property
    def single(self) -> Block:
        """The single steps: the stages of a composed one, else itself."""
        return self if self.stages is None else self.stages

    @cached_property
    def state(self) -> State:
        """State at the end of the last step."""
        return self.state_after(len(self) - 1)

    def state_after(self, k: int) -> State:
        """State at the end of step k; -1: the start."""
        if k < 0:
            return self.start
        return State(
            float(self.times[k]),
            self.start.index + k + 1,
            self.q[k].copy(),
            self.p[k].copy(),
            fresh=False,
            turns=self.turns[k].copy() if self.turns.size else None,
            carried=carried_rates(self.rates[k]),
            made_by=self.origin,
            plain=self.stuck and k == len(self) - 1,
        )

    def part(self, first: int, last: int) -> Block:
        """Block of the steps from number `first` up to that before number `last`."""
        if (first, last) == (0, len(self)):
            return self
        arrays = {name: getattr(self, name)[first:last] for name in self._arrays}
        stages = self.stages
        if stages is not None:
            each = len(stages) // len(self)
            stages = stages.part(each * first, each * last)
        start = self.state_after(first - 1)
        return replace(self, **arrays, start=start, stages=stages, stuck=False)


@dataclass(eq=False)
class StepReport:
    """One solved step.

    Attributes
    ----------
    block : Block
        The steps among which it was solved.
    number : int
        Its number there.
    code : Code
        ``Code.SOLVED``; see :class:`Failure` for others.
    """

    code = Code.SOLVED
    block: Block
    number: int

    def __repr__(self) -> str:
        end = self.state
        name = type(self).__name__
        return f"<{name}: to step {end.index}, t = {end.time:g} s, {self.iterations} iterations>"

    @property
    def system(self) -> System:
        """System that it is a step of."""
        return self.block.system

    @property
    def integrator(self) -> Integrator:
        """Integrator of single steps."""
        return self.block.integrator

    @property
    def time(self) -> float:
        """Time (s) at its end."""
        return float(self.block.times[self.number])

    @property
    def step(self) -> float:
        """Step size (s); of a composed step that of all its parts, which may go back in time."""
        return float(self.block.sizes[self.number])

    @cached_property
    def start(self) -> State:
        """State that it started from."""
        return self.block.state_after(self.number - 1)

    @cached_property
    def state(self) -> State:
        """State at its end."""
        return self.block.state_after(self.number)

    @property
    def iterations(self) -> int:
        """Newton iterations of all attempts."""
        return int(self.block.iterations[self.number])

    @property
    def attempts(self) -> int:
        """Attempts; 1: none was repeated."""
        return int(self.block.attempts[self.number])

    @property
    def residual(self) -> float:
        """Scaled residual at the solution."""
        return float(self.block.residual[self.number])

    @property
    def work(self) -> StepWork:
        """Work (J) of loads, actuators and dampers in the step."""
        return StepWork(*self.block.works[self.number].tolist())

    @property
    def impulse(self) -> Floats:
        """Impulse ``h G^T lambda`` (n,) of the constraint force."""
        return self.block.impulse[self.number]

    @property
    def y1(self) -> Floats:
        """All rows (total, 3) at its end."""
        q = self.block.q[self.number]
        return np.concatenate([q.reshape(-1, 3), self.block.ground[self.number]])

    @property
    def momentum(self) -> Floats:
        """Momentum ``p_n`` (n,) of the discrete Legendre transform at the *start* of the step."""
        node = self.integrator.carries_node_momentum
        state = self.start
        if self.block.by_motion and not node:  # nothing along G^T changes the velocity
            return nearest_momentum(self.system, self.constraint_point, state.p, state.time)
        if state.fresh or node:
            return state.p.copy()
        # the mean of both transforms (34), (35), whose parts of lambda cancel
        return state.p - 0.5 * self.impulse

    @property
    def constraint_force(self) -> Floats:
        """Constraint force ``G^T lambda`` (n,) of the step (N; N m on directors)."""
        if self.block.by_motion:
            return force_by_motion(self.system, self.start)
        # a given momentum has the other half of the force at a node in it already
        share = 0.5 if self.start.fresh and self.integrator.constraint_weight == 0 else 1.0
        return self.impulse / (share * self.step)

    @property
    def constraint_point(self) -> Floats:
        """Rows (total, 3) of y where the constraint force acts, at the node or midpoint."""
        y0 = self.system.extend(self.start.q, self.start.time)
        weight = 0.0 if self.block.by_motion else self.integrator.constraint_weight
        return y0 if weight == 0 else weight * self.y1 + (1 - weight) * y0


def composed(blocks: Sequence[Block], state: State) -> Block:
    """Block of one step that is made of single ones, and ends in a state."""
    stages = Block.joined(blocks)
    return replace(
        Block.of_one(
            stages.system,
            stages.integrator,
            stages.start,
            state,
            float(stages.sizes.sum()),
            stages.ground[-1],
            stages.impulse[0],
            StepWork(*stages.works.sum(0).tolist()),
            int(stages.iterations.sum()),
            int(stages.attempts.max()),
            float(stages.residual.max()),
            by_motion=True,
        ),
        stages=stages,
    )


# -- constraint forces of states, by the steps around them ----------------------------------------

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
    if step.block.by_motion:
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


def forces_between(before: StepReport | None, block: Block) -> Floats:
    """Constraint forces (k, n) at the starts of all steps of a block, `before` led to the first.

    They are of the order of the scheme. Where forces act in the middle of steps, it is that between
    those of both, see :func:`force_point`: their mean if the steps are equal, and no energy is
    taken. Beside a step that is smaller by far the force of the longer one is taken, of first
    order. Without a step before, the first one is that of the first step, of first order, too.
    """
    if block.by_motion:
        return np.array([step.constraint_force for step in block])
    integrator = block.integrator
    weight = block.integrator.constraint_weight
    last = block[0] if before is None else before
    sizes = np.append(last.step, block.sizes)[:, None]
    impulses = np.concatenate([last.impulse[None], block.impulse])
    if weight == 1:
        return impulses[:-1] / sizes[:-1]
    if weight == 0:  # its impulse is over half of the step before it, too
        return impulses[1:] * (2 / (sizes[:-1] + sizes[1:]))
    forces = 0.5 / sizes[1:] * (impulses[:-1] + impulses[1:])
    uneven = (sizes[1:, 0] != sizes[:-1, 0]) | integrator.loses
    uneven[0] &= before is not None
    for k in np.flatnonzero(uneven).tolist():
        steps = block[k - 1] if k else last, block[k]
        one, other = (force_point(integrator, None, each) for each in steps)
        shorter, longer = sorted(steps, key=lambda each: each.step)
        if one is None or other is None or one[0] == other[0] or shorter.step < TINY * longer.step:
            forces[k] = longer.constraint_force
        else:
            forces[k] = _on_line(steps[1].start.time, one, other)
    return forces


def force_points(integrator: Integrator, steps: Sequence[StepReport]) -> list[ForcePoint]:
    """Points of :func:`force_point` for steps in a row; none if equations of motion give more."""
    if not steps or steps[-1].block.by_motion:
        return []
    pairs = zip([None, *steps], steps, strict=False)
    found = [force_point(integrator, before, step) for before, step in pairs]
    return [point for point in found if point is not None]


def force_at(
    state: State, integrator: Integrator, system: System, steps: Sequence[StepReport]
) -> Floats:
    """Constraint force (n,) of the first or the last state of steps in a row, on their side of it.

    Where these are too few, it is that of the equations of motion; NaN where they give none.
    """
    found = one_sided(state.time, force_points(integrator, steps))
    if found is not None:
        return found
    try:
        return force_by_motion(system, state)
    except (CosseratError, *OF_USERS):  # a singular configuration, or an unknown load
        return np.full(len(state.q), np.nan)


def _off(system: System, state: State) -> Floats:
    """Part (n,) of a state's momentum off the hidden constraints, ``p - Q p``."""
    y = system.extend(state.q, state.time)
    return state.p - nearest_momentum(system, y, state.p, state.time)
