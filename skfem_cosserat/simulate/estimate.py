"""What a pair of steps is wrong by, in positions and in velocities."""

from __future__ import annotations

from collections import deque

import numpy as np

from ..model import System
from ..types import Floats

__all__ = ["Estimate", "distance", "size"]

#: errors below this (of the scene's extent, rad) are the solver's
ROUNDING = 1e-12
#: pairs of steps whose errors bound that of velocities
RECENT = 50


def size(system: System, change: Floats) -> float:
    """Largest change of a configuration (n,): positions by the scene's extent, directors."""
    rows = np.linalg.norm(change.reshape(-1, 3), axis=1)
    rows[system.origin_rows] /= system.length
    return float(rows.max(initial=0.0))


def distance(system: System, a: Floats, b: Floats) -> float:
    """Largest difference of two configurations (n,), see :func:`size`."""
    return size(system, a - b)


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
        """What comes is no continuation of what has been."""
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
        rate, middle = size(system, c), time + pair / 2
        if rate * scale < ROUNDING:
            c, rate = np.zeros_like(c), 0.0
        self._now, self._rate = (middle, c), rate
        v = size(system, halves[2] - halves[0]) / pair
        a = 4 * size(system, halves[2] - 2 * halves[1] + halves[0]) / pair**2
        self._motion = v**2 * pair, a**2 * pair
        if self._before is None or not self._recent:
            return rate * scale
        speeds, bends = self._speeds + self._motion[0], self._bends + self._motion[1]
        change = np.sqrt(speeds / bends) if bends > 0 else 0.0
        slope = size(system, c - self._before[1]) / (middle - self._before[0])
        return scale * max(rate, min(change * slope, max(self._recent)))

    def accept(self) -> None:
        """The pair whose error was asked for last goes on."""
        self._before = self._now
        self._recent.append(self._rate)
        self._speeds += self._motion[0]
        self._bends += self._motion[1]
