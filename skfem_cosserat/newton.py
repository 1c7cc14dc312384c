"""One Newton loop for all problems."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite
from typing import Protocol

import numpy as np

from .frozen import Frozen
from .linear import SingularMatrixError
from .types import Floats, positive, whole
from .warn import logger

__all__ = ["NewtonProblem", "NewtonReport", "NewtonSettings", "converged", "newton"]


class NewtonProblem(Protocol):
    """What the loop needs to know."""

    def residual(self) -> float:
        """Evaluate at the present configuration; size of the residual against its terms."""

    def direction(self) -> Floats:
        """Newton increment at the configuration evaluated last."""

    def sizes(self, increment: Floats) -> tuple[float, float]:
        """Size of an increment (relative displacement or rad), and of its largest rotation."""

    def apply(self, increment: Floats) -> None:
        """Move the configuration."""

    def save(self) -> object:
        """The present configuration, for :meth:`restore`."""

    def restore(self, saved: object) -> None:
        """Back to a saved configuration."""


@dataclass(frozen=True)
class NewtonSettings(Frozen):
    """When Newton's method stops.

    Attributes
    ----------
    iterations : int
        Largest number of plain iterations; damped retries get `damped_iterations`.
    increment : float
        Converged when the *next* increment, estimated from the quadratic contraction of the last
        two, is below this (relative displacement or rad). Increments, not residuals: a residual
        tolerance becomes unreachable as steps or elements shrink.
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
    settled : float
        Converged with kept factors when all increments still to come, estimated from the linear
        contraction of the last two, are below this.
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
    settled: float = 5e-17
    largest: float = np.inf

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if name in ("iterations", "damped_iterations", "reuse"):
                whole("Newton settings", value, 0 if name == "reuse" else 1, name)
            elif name not in ("mixed", "largest") or not np.array_equal(value, np.inf):
                positive("Newton settings", name, value)


@dataclass
class NewtonReport:
    """How it went."""

    converged: bool
    iterations: int
    residual: float
    reason: str
    increments: list[float]
    residuals: list[float]


def newton(problem: NewtonProblem, settings: NewtonSettings, damped: bool = False) -> NewtonReport:
    """Solve; never raises for a failing iteration, the report says why it stopped.

    Parameters
    ----------
    damped : bool
        With a backtracking line search on the residual and more iterations.
    """
    report = NewtonReport(False, 0, np.inf, "", [], [])
    limit = settings.damped_iterations if damped else settings.iterations
    with np.errstate(all="ignore"):
        size = problem.residual()
        report.residuals.append(size)
        while report.iterations < limit:
            if not isfinite(size):
                report.reason = "the residual is not finite"
                break
            try:
                increment = problem.direction()
            except SingularMatrixError as error:
                report.reason = str(error)
                break
            report.iterations += 1
            length, turn = problem.sizes(increment)
            if length > settings.largest:
                report.reason = f"an increment of {length:.3g} leads nowhere"
                break
            capped = turn > settings.rotation
            if capped:
                increment = increment * (settings.rotation / turn)
            size = _advance(problem, increment, size, damped)
            report.residuals.append(size)
            report.increments.append(length)
            logger.debug("Newton %d: increment %.3e residual %.3e", report.iterations, length, size)
            if not capped and isfinite(size) and converged(report.increments, size, settings):
                report.converged = True
                break
        else:
            report.reason = f"no convergence in {limit} iterations"
    report.residual = float(np.min(report.residuals)) if not report.converged else size
    return report


def _advance(problem: NewtonProblem, increment: Floats, before: float, damped: bool) -> float:
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


def converged(increments: list[float], size: float, settings: NewtonSettings) -> bool:
    """Whether increments of these sizes, and a residual of this one, are enough."""
    before = increments[-2] if len(increments) > 1 else np.inf
    s = settings
    return enough(increments[-1], before, size, s.increment, s.negligible, s.stagnation, s.mixed)


def enough(
    last: float,
    before: float,
    size: float,
    increment: float,
    negligible: float,
    stagnation: float,
    mixed: float,
) -> bool:
    """The same for the last two increments (the one before infinite if there is none).

    Plain numbers, for compiled kernels as well.
    """
    if last <= negligible:
        return True
    if before == np.inf:
        return False
    # after a mixed tangent the contraction is better than quadratic once, and not again
    plain = before <= mixed
    if plain and last < 1e-3 and last < before and last**3 / before**2 <= increment:
        return True
    if last <= 0.3 * before:
        return False
    # the rounding floor: no contraction left although increments are tiny; where the matrix is
    # singular at the solution (a closed loop exactly in a singular position) it is at its root
    return last <= stagnation or (last <= 5 * stagnation and size <= 1e-12)


def left_over(length: float, rate: float, settled: float) -> float:
    """How many more iterations with kept factors it takes after an increment of this length.

    Their increments shrink by `rate` each; none is needed once their sum is below `settled`.
    """
    if length * rate <= settled * (1 - rate):
        return 0.0
    if rate >= 1:
        return np.inf
    return float(np.log(settled * (1 - rate) / (length * rate)) / np.log(rate))
