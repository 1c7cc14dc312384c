"""One Newton loop for all problems: plain, and compiled into the steps of kernels."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np

from .frozen import Frozen
from .linear import SingularMatrixError
from .types import Floats, positive, whole
from .warn import logger


class NewtonProblem(Protocol):
    """Problem that Newton's method solves; with line search a :class:`DampedProblem`."""

    def residual(self) -> float:
        """Evaluate at the present configuration; size of the residual against its terms."""

    def direction(self) -> Floats:
        """Newton increment at the configuration evaluated last."""

    def sizes(self, increment: Floats) -> tuple[float, float]:
        """Size of an increment (relative displacement or rad), and of its largest rotation."""

    def apply(self, increment: Floats) -> None:
        """Move the configuration."""


class DampedProblem(NewtonProblem, Protocol):
    """Problem for a line search, which goes back to a saved configuration."""

    def save(self) -> object:
        """The present configuration, for :meth:`restore`."""

    def restore(self, saved: object) -> None:
        """Back to a saved configuration."""


@dataclass(frozen=True, repr=False)
class NewtonSettings(Frozen):
    """When Newton's method stops.

    Attributes
    ----------
    iterations : int
        Largest number of plain iterations; damped retries get `damped_iterations`.
    increment : float
        Converged when what is still to come is below this (relative displacement or rad): the
        *next* increment by the quadratic contraction of the last two, with kept factors all further
        ones by the slowest linear contraction that these factors gave. Increments, not residuals:
        a residual tolerance becomes unreachable as steps or elements shrink.
    negligible : float
        Converged when an increment itself is below this. Displacements count relative to the
        extent of the scene.
    stagnation : float
        Increments below this that do not shrink any more are taken for the rounding floor; below
        five times this with a residual of round-off.
    rotation : float
        Largest rotation (rad) in one iteration; longer increments are scaled down.
    mixed : float
        After increments larger than this the geometric stiffness is taken with the stresses that
        the increment predicts, not with those it leads to: the mixed (MIP) iteration of Magisano,
        Leonetti & Garcea, Comput. Methods Appl. Mech. Engrg 313 (2017) 986. Same solution, from
        farther away. Infinity: never.
    reuse : int
        Factors of a matrix are kept, over steps too, as long as no more than this many further
        iterations with them are expected (compiled kernels); 0: factorise in each iteration.
    largest : float
        An increment longer than this ends the iteration: it would find nothing any more.

    Raises
    ------
    InputError
        If a number is not positive and finite, or a number of iterations not whole.

    Examples
    --------
    Fewer iterations before a step is tried again, for ``simulate(..., settings=settings)``:

    >>> settings = NewtonSettings(iterations=10)
    >>> settings.iterations, settings.damped_iterations
    (10, 100)
    """

    iterations: int = 20
    damped_iterations: int = 100
    increment: float = 1e-17
    negligible: float = 1e-12
    stagnation: float = 1e-8
    rotation: float = 0.6
    mixed: float = 1e-3
    reuse: int = 4
    largest: float = np.inf

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if name in ("iterations", "damped_iterations", "reuse"):
                whole("Newton settings", value, 0 if name == "reuse" else 1, name)
            elif name not in ("mixed", "largest") or not np.array_equal(value, np.inf):
                positive("Newton settings", name, value)
        super().__post_init__()


@dataclass
class NewtonReport:
    """Report of Newton's method: its outcome, and sizes of increments and residuals."""

    converged: bool
    iterations: int
    residual: float
    reason: str
    increments: list[float]
    residuals: list[float]


# -- the loop, written once: see newton_loop -------------------------------------------------------

#: how a loop ended: it found a solution; a residual is not finite; a matrix is singular; an
#: increment is too long; all iterations are spent
SETTLED, NOT_FINITE, SINGULAR, TOO_LONG, SPENT_ALL = range(5)
#: what a loop leaves behind for the next one that may keep its factors: whether there are any, the
#: contraction they gave last at first and the first increment then; of the loop itself iterations,
#: residual and factorisations; loops with these factors, all their iterations, and the slowest
#: contraction that they gave
RECORD = (
    "kept",
    "rate",
    "first",
    "iterations",
    "residual",
    "factored",
    "steps",
    "spent",
    "slowest",
)
KEPT, RATE, FIRST, ITERATIONS, RESIDUAL, FACTORED, STEPS, SPENT, SLOWEST = range(9)
#: residual, relative, with which no step is solved before one more increment has vanished
WRONG = 1e-3
#: increments below this are nothing but rounding where they do not shrink any more with kept
#: factors, or where one more leaves as large a residual
ROUNDING = 3e-15
#: contraction assumed for factors of an earlier loop before any is measured
UNKNOWN = 0.1


class Limits(NamedTuple):
    """Numbers of :class:`NewtonSettings` that the loop takes.

    Attributes
    ----------
    worth : float
        How many iterations new factors cost; infinite: they are kept while they do.
    wrong : float
        A residual above this asks for one more increment; infinite: whoever asks looks at it.
    """

    iterations: float
    rotation: float
    mixed: float
    reuse: float
    largest: float
    increment: float
    negligible: float
    stagnation: float
    worth: float
    wrong: float


def worn(worth: float, record: Floats) -> bool:
    """True if new factors pay: the last loop took more than the mean of all with these factors.

    Their making counts as `worth` iterations: this mean is smallest where loops come to cost more.
    """
    steps = record[STEPS]
    return bool(steps > 0.0 and record[ITERATIONS] * steps > worth + record[SPENT])


def newton_loop(  # noqa: PLR0915
    evaluate: Callable[..., float],
    factorise: Callable[..., bool],
    direct: Callable[..., tuple[float, float, int]],
    advance: Callable[..., float],
    build: Callable[[Any], Any] = lambda function: function,
) -> Callable[[Any, Limits, Floats], int]:
    """The loop over the stages of an iteration; all take the same first argument.

    Parameters
    ----------
    evaluate : callable
        ``size = evaluate(c, sized)`` at the start; if asked, its residual against its terms.
    factorise : callable
        ``regular = factorise(c, mixed)``: the matrix where it was evaluated last.
    direct : callable
        ``length, turn, mixed = direct(c, kept)``: the increment, its largest rotation, and whether
        the next matrix is to be taken with the stresses that it predicts.
    advance : callable
        ``size = advance(c, sized, before)``: move by the increment, and evaluate.
    build : callable, optional
        Compiles functions for kernels: numba takes the same source.

    Returns
    -------
    callable
        ``code = loop(c, limits, record)``: how it ended, such as :data:`SETTLED`; the record is
        that of :data:`RECORD`.
    """
    is_worn, is_enough, steps_left = build(worn), build(enough), build(left_over)

    def keeps(limits: Limits, record: Floats) -> bool:  # whether it begins with the factors there
        if not (limits.reuse > 0.0 and record[KEPT] != 0.0):
            return False
        # where factors of the loop before did not do they are tried again some loops later only
        if steps_left(record[FIRST], record[RATE], limits.increment) > limits.reuse:
            record[RATE] *= 0.8
            return False
        return not is_worn(limits.worth, record)

    is_kept = build(keeps)

    def loop(c: Any, limits: Limits, record: Floats) -> int:  # noqa: PLR0912
        reuse, increment, rate = limits.reuse, limits.increment, record[RATE]
        kept = is_kept(limits, record)
        record[KEPT] = record[FACTORED] = 0.0
        size = evaluate(c, not kept)
        last, mixed, swept, doubted, first = np.inf, 0, 0.0, False, 0.0
        for count in range(1, int(limits.iterations) + 1):
            fresh = not kept
            if fresh:
                if not np.isfinite(size):
                    return NOT_FINITE
                record[FACTORED] += 1.0
                if not factorise(c, mixed):
                    return SINGULAR
            record[ITERATIONS] = count
            length, turn, mixed = direct(c, kept)
            before, last = last, length
            first = first if count > 1 else length
            done = False
            if not fresh:
                if count > 1:
                    rate = length / before
                elif rate == 0.0:
                    rate = UNKNOWN
                if count == 2:
                    record[RATE], record[FIRST] = rate, before
                if not (rate < 0.5 and length <= limits.largest):  # NaN as well
                    done = length < ROUNDING
                    if not done:
                        kept, mixed, last = False, 0, before
                        continue
                # each direction contracts at a rate of its own, and the slowest one comes out last:
                # what the first increments of a loop tell is too good; small ones tell of rounding
                slowest = max(rate, record[SLOWEST])
                if count > 1 and before >= limits.negligible:
                    record[SLOWEST] = slowest
                further = steps_left(length, rate, increment)
                # a rate of steps before says nothing of factors that have grown old since, and that
                # after an iteration with factors of its own is quadratic, once: new ones count as
                # unknown then
                done = (
                    done
                    or (
                        steps_left(length, slowest, increment) <= 0.0
                        and (swept > 0.0 or length <= increment)
                    )
                    or (record[FACTORED] > 0.0 and steps_left(length, UNKNOWN, increment) <= 0.0)
                )
                swept += 1.0
                # the next iteration will tell
                kept = (further <= reuse or rate == UNKNOWN) and swept < reuse + 2.0
            elif not length <= limits.largest:
                return TOO_LONG
            size = advance(c, fresh or done or not kept, size)
            if fresh:
                done = turn <= limits.rotation and is_enough(
                    length,
                    before,
                    size,
                    increment,
                    limits.negligible,
                    limits.stagnation,
                    limits.mixed,
                )
                # the contraction by factors grows with the way from where they were made: that of
                # the old ones, which are at least the first increment away, says what these leave
                done = done or (swept > 1.0 and length * length * rate <= increment * first)
                kept = reuse > 0.0 and mixed == 0
                rate, swept, record[SLOWEST] = 0.0, 0.0, 0.0
            # of a scene at rest all terms may be rounding, and a residual as large as they are:
            # whether anything is left the next increment tells
            sound = size <= limits.wrong or (doubted and fresh and length < ROUNDING)
            doubted = done and not sound
            kept = kept and not doubted
            if done and sound and np.isfinite(size):
                record[RESIDUAL] = size
                if record[FACTORED] > 0.0:
                    record[STEPS], record[SPENT] = 0.0, 0.0
                record[STEPS] += 1.0
                record[SPENT] += count
                return SETTLED
        return SPENT_ALL

    return build(loop)


def enough(
    last: float,
    before: float,
    size: float,
    increment: float,
    negligible: float,
    stagnation: float,
    mixed: float,
) -> bool:
    """True if the last two increments (before: infinite if none) and a residual are enough."""
    if last <= negligible:
        return True
    if before == np.inf:
        return False
    # after a mixed tangent the contraction is better than quadratic once, and not again
    if before <= mixed and last < 1e-3 and last < before and last**3 / before**2 <= increment:
        return True
    if last <= 0.3 * before:
        return False
    # the rounding floor: no contraction left although increments are tiny; where the matrix is
    # singular at the solution (a closed loop exactly in a singular position) it is at its root
    return last <= stagnation or (last <= 5 * stagnation and size <= 1e-12)


def left_over(length: float, rate: float, increment: float) -> float:
    """Number of iterations with kept factors that it takes after an increment of this length.

    Their increments shrink by `rate` each; none is needed once their sum is below `increment`.
    """
    if length * rate <= increment * (1 - rate):
        return 0.0
    if rate >= 1:
        return np.inf
    return float(np.log(increment * (1 - rate) / (length * rate)) / np.log(rate))


# -- problems in Python ----------------------------------------------------------------------------


class _Stages:
    """Stages of the loop for a problem in Python, whose factors are not kept; what happened."""

    def __init__(self, problem: NewtonProblem, rotation: float, damped: bool):
        self.problem, self.rotation, self.damped = problem, rotation, damped
        self.report = NewtonReport(False, 0, np.inf, "", [], [])
        self.increment = np.zeros(0)
        self.length = self.turn = 0.0

    def evaluate(self, sized: bool) -> float:
        """Evaluate the problem and record its residual; stages are those of :func:`newton_loop`."""
        self.report.residuals.append(self.problem.residual())
        return self.report.residuals[-1]

    def factorise(self, mixed: int) -> bool:
        try:
            self.increment = self.problem.direction()
        except SingularMatrixError as error:
            self.report.reason = str(error)
            return False
        return True

    def direct(self, kept: bool) -> tuple[float, float, int]:
        self.length, self.turn = self.problem.sizes(self.increment)
        return self.length, self.turn, 0

    def advance(self, sized: bool, before: float) -> float:
        increment = self.increment
        report = self.report
        if self.turn > self.rotation:
            increment = increment * (self.rotation / self.turn)
        size = _advance(self.problem, increment, before, self.damped)
        report.residuals.append(size)
        report.increments.append(self.length)
        count = len(report.increments)
        logger.debug("Newton %d: increment %.3e residual %.3e", count, self.length, size)
        return size


_plain = newton_loop(_Stages.evaluate, _Stages.factorise, _Stages.direct, _Stages.advance)


def newton(problem: NewtonProblem, settings: NewtonSettings, damped: bool = False) -> NewtonReport:
    """Solve; never raises for a failing iteration, the report says why it stopped.

    Parameters
    ----------
    damped : bool
        With a backtracking line search on the residual and more iterations, of a
        :class:`DampedProblem`.
    """
    stages = _Stages(problem, settings.rotation, damped)
    record = np.zeros(len(RECORD))
    own = {name: getattr(settings, name) for name in Limits._fields[:-2]}
    own |= {"reuse": 0, "iterations": settings.damped_iterations} if damped else {"reuse": 0}
    limits = Limits(**own, worth=np.inf, wrong=np.inf)
    report = stages.report
    with np.errstate(all="ignore"):
        code = _plain(stages, limits, record)
    report.converged = code == SETTLED
    report.iterations = int(record[ITERATIONS])
    report.reason = report.reason or {
        SETTLED: "",
        NOT_FINITE: "the residual is not finite",
        TOO_LONG: f"an increment of {stages.length:.3g} leads nowhere",
        SPENT_ALL: f"no convergence in {int(limits.iterations)} iterations",
    }.get(code, "the matrix is singular")
    report.residual = report.residuals[-1] if report.converged else float(np.min(report.residuals))
    return report


def _advance(problem: Any, increment: Floats, before: float, damped: bool) -> float:
    if not damped:
        problem.apply(increment)
        return problem.residual()
    saved = problem.save()
    factor = 1.0
    for _ in range(8):
        problem.apply(factor * increment)
        size = problem.residual()
        if np.isfinite(size) and size <= (1 - 1e-4 * factor) * before + 1e-14:
            return size
        problem.restore(saved)
        factor /= 2
    problem.apply(increment)
    return problem.residual()
