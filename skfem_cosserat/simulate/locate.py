"""Zeros of a number within a step: located, and found where it passes through zero and back.

A step is tried with other sizes: the number at their ends is that of states of the scheme.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ..integrators import StepReport

__all__ = ["LOCATED", "Bracket", "Point", "Trial", "dip", "located"]

#: what a time is located to, of the step
LOCATED = 1e-10
#: steps that are tried to find the lowest point of a number within a step
TRIALS = 12
#: of the step: lowest points that are closer are the same
SAME = 1e-5
#: of the lowest value known: what is not predicted to be below this part of it is not tried
FLAT = 0.99
#: how far a parabola may be wrong, of its second difference over a step and of the step: as much
#: if the third derivative, times the step, is as large as the second one
WRONG, ASIDE = 0.15, 0.2

#: number at the end of a step of this size (s), and the step
Trial = Callable[[float], tuple[float, StepReport]]


class Point(NamedTuple):
    """A number at a time after the start of a step (s), before it if negative."""

    t: float
    f: float


class Bracket(NamedTuple):
    """A zero between two points of a step.

    Attributes
    ----------
    side : int
        Sign of the number before it.
    a, b : Point
        Before and after it.
    best : StepReport
        The step to `b`.
    """

    side: int
    a: Point
    b: Point
    best: StepReport


def located(bracket: Bracket, trial: Trial, width: float) -> StepReport:
    """The step to the first state known to be past a zero, to a width (s)."""
    side, (a, fa), (b, fb), best = bracket
    kept = 0
    while b - a > width:
        # false position, with a bisection where it gets stuck on one side
        c = 0.5 * (a + b) if kept > 2 else b - fb * (b - a) / (fb - fa)
        c = min(max(c, a + 0.5 * width), b - 0.5 * width)
        found, report = trial(c)
        if found * side > 0:
            kept = kept + 1 if kept > 0 else 1
            a, fa = c, found
            fb = fb / 2 if kept > 1 else fb  # the Illinois rule
        else:
            kept = kept - 1 if kept < 0 else -1
            b, fb, best = c, found, report
            fa = fa / 2 if kept < -1 else fa
        kept = 3 if abs(kept) > 3 else kept
    return best


def dip(
    trial: Trial, start: Point, end: Point, before: Point | None
) -> tuple[Point, StepReport] | None:
    """Where a number that is positive at both ends of a step is negative; None: nowhere.

    The parabola through its values says where it is lowest. Only if it reaches zero there, or may
    by what it is wrong, steps are tried: at the lowest points of parabolas through values nearby.

    Parameters
    ----------
    trial : Trial
    start, end : Point
        Of the step.
    before : Point or None
        An earlier one. None: the middle of the step is tried instead.
    """
    known = [start, end] if before is None else [before, start, end]
    if before is None:
        middle, report = _tried(trial, 0.5 * (start.t + end.t))
        if middle.f < 0:
            return middle, report
        known.append(middle)
    guess, low = _first(known, start, end), min(start, end, key=_height)
    for _ in range(TRIALS):
        if guess is None or not start.t < guess.t < end.t:
            return None
        if min(abs(guess.t - point.t) for point in known) < SAME * (end.t - start.t):
            return None
        point, report = _tried(trial, guess.t)
        if point.f < 0:
            return point, report
        known.append(point)
        inside = [each for each in known if start.t <= each.t <= end.t]
        low = min(inside, key=_height)
        if low in (start, end):  # it falls behind the start, or before the end, if at all
            guess = _vertex(sorted(known, key=lambda each: abs(each.t - low.t))[:3])
        else:
            guess = _vertex(sorted(inside, key=_height)[:3])
        if guess is not None and guess.f > FLAT * low.f:
            return None
    return None


def _first(known: list[Point], start: Point, end: Point) -> Point | None:
    """Where to look first; None: what is known of the step does not come near to zero."""
    guess, h = _vertex(known), end.t - start.t
    if guess is None or not guess.f < WRONG * _second(known) * h**2:
        return None
    at = (guess.t - start.t) / h
    if not -ASIDE < at < 1 + ASIDE:
        return None
    if not 0 < at < 1:
        at = min(max(at, ASIDE), 1 - ASIDE)
    return Point(start.t + at * h, guess.f)


def _height(point: Point) -> float:
    return point.f


def _tried(trial: Trial, size: float) -> tuple[Point, StepReport]:
    f, report = trial(size)
    return Point(size, f), report


def _second(points: list[Point]) -> float:
    """Half the second derivative of the parabola through three points."""
    (t0, f0), (t1, f1), (t2, f2) = sorted(points)
    return ((f2 - f1) / (t2 - t1) - (f1 - f0) / (t1 - t0)) / (t2 - t0)


def _vertex(points: list[Point]) -> Point | None:
    """Lowest point of the parabola through three points; None: it has none."""
    (t0, f0), (t1, f1), _ = sorted(points)
    slope, second = (f1 - f0) / (t1 - t0), _second(points)
    if not (second > 0 and np.isfinite(second)):
        return None
    t = 0.5 * (t0 + t1) - slope / (2 * second)
    return Point(t, f0 + slope * (t - t0) + second * (t - t0) * (t - t1))
