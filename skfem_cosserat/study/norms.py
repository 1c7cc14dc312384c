"""How a quantity that depends on time is compared: at instants that all levels have recorded."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence

import numpy as np

from ..errors import InputError
from ..types import Array, Floats, numbers

__all__ = ["AtInstants", "MaximumOverTime", "OverTime", "RootMeanSquare"]
__all__ += ["common_instants", "rows_at"]

#: instants that agree to this part of the time covered are the same
SAME = 1e-9


class OverTime(ABC):
    """A norm of differences over time; derive from it for one of your own.

    Examples
    --------
    >>> class MeanOverTime(OverTime):
    ...     def size(self, instants, difference):
    ...         return float(abs(difference).mean())
    >>> MeanOverTime().size(np.array([0.0, 1.0]), np.array([1.0, -3.0]))
    2.0
    """

    def select(self, instants: Floats) -> Floats:
        """Those of the common instants ``(k,)`` that count: all of them."""
        return instants

    @abstractmethod
    def size(self, instants: Floats, difference: Array) -> float:
        """Norm of a difference ``(k, ...)`` at these instants ``(k,)``."""


class MaximumOverTime(OverTime):
    """Largest Euclidean norm at any of the instants that all levels have in common.

    Examples
    --------
    >>> MaximumOverTime().size(np.array([0.0, 1.0]), np.array([[3.0, 4.0], [1.0, 0.0]]))
    5.0
    """

    def size(self, instants: Floats, difference: Array) -> float:
        """Largest norm of a row."""
        return float(_rows(difference).max())


class RootMeanSquare(OverTime):
    """L2 norm over time, divided by the root of the duration: in the unit of the quantity.

    Examples
    --------
    >>> t = np.linspace(0, 1, 1001)
    >>> round(RootMeanSquare().size(t, np.sin(2 * np.pi * t)), 6)
    0.707107
    """

    def size(self, instants: Floats, difference: Array) -> float:
        """Root of the mean of the squares, by the trapezoidal rule."""
        squares = _rows(difference) ** 2
        if len(instants) < 2:
            return float(np.sqrt(squares.mean()))
        integral = np.diff(instants) @ (squares[1:] + squares[:-1]) / 2
        return float(np.sqrt(integral / np.ptp(instants)))


class AtInstants(MaximumOverTime):
    """Largest Euclidean norm at these instants, which all levels must have recorded.

    Parameters
    ----------
    times : sequence of float
        In s.

    Raises
    ------
    InputError
        If they are no increasing finite numbers, or (in a study) were not recorded.

    Examples
    --------
    >>> AtInstants([0.5]).select(np.array([0.0, 0.25, 0.5])).tolist()
    [0.5]
    """

    def __init__(self, times: Sequence[float]) -> None:
        self.times = np.atleast_1d(numbers("AtInstants", "times", times))
        if not self.times.size or not np.isfinite(self.times).all():
            raise InputError("AtInstants", f"times = {times!r}, expected finite numbers")
        if (np.diff(self.times) <= 0).any():
            raise InputError("AtInstants", f"times = {times!r}, expected increasing ones")

    def select(self, instants: Floats) -> Floats:
        """The instants nearest to the times."""
        span = max(float(np.ptp(instants)), abs(self.times).max()) if len(instants) else 1.0
        for time in self.times:
            if not len(instants) or abs(instants - time).min() > SAME * span:
                raise InputError(
                    "AtInstants",
                    f"times holds {time:g}, which not all levels have recorded: choose steps that"
                    " divide it",
                )
        return np.array([instants[abs(instants - time).argmin()] for time in self.times])


def common_instants(times: Sequence[Floats]) -> Floats:
    """Instants that are in all of these sequences, to rounding.

    Examples
    --------
    >>> common_instants([np.array([0, 0.5, 1.0]), np.array([0, 0.25, 0.5 + 1e-14, 1.0])]).tolist()
    [0.0, 0.5, 1.0]
    """
    shared = times[0]
    for other in times[1:]:
        near = abs(shared - other[rows_at(other, shared)])
        shared = shared[near <= SAME * max(float(np.ptp(other)), float(np.ptp(shared)))]
    return shared


def rows_at(times: Floats, instants: Floats) -> Array:
    """Numbers of the states nearest to the instants.

    Examples
    --------
    >>> rows_at(np.array([0.0, 1.0, 2.0]), np.array([0.9, 2.0])).tolist()
    [1, 2]
    """
    right = np.clip(np.searchsorted(times, instants), 1, max(1, len(times) - 1))
    left = right - 1
    right = np.minimum(right, len(times) - 1)
    return np.where(instants - times[left] <= times[right] - instants, left, right)


def _rows(difference: Array) -> Floats:
    return np.asarray(np.linalg.norm(difference.reshape(len(difference), -1), axis=1))
