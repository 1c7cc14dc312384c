"""Ready functions of time: ramps and harmonic ones, with exact averages, for loads and motions."""

from __future__ import annotations

from abc import ABC, abstractmethod
from itertools import pairwise

import numpy as np

from .errors import InputError
from .types import numbers

__all__ = ["Harmonic", "RampLinear", "RampSmooth"]

_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(3)


def _finite(item: str, **values: float) -> None:
    for name, value in values.items():
        number = numbers(item, name, value)
        if number.shape != () or not np.isfinite(number):
            raise InputError(item, f"{name} = {value!r}, expected a finite number")


class _Ramp(ABC):
    """From one value to another, constant before and after."""

    def __init__(self, begin: float, end: float, first: float = 0.0, last: float = 1.0) -> None:
        _finite("ramp", begin=begin, end=end, first=first, last=last)
        if not end > begin:
            raise InputError("ramp", f"end = {end!r} s, expected it after begin = {begin!r} s")
        self.begin, self.end = float(begin), float(end)
        self.first, self.last = float(first), float(last)
        self.settled = self.end

    def __repr__(self) -> str:
        numbers = f"{self.begin:g}, {self.end:g}, first={self.first:g}, last={self.last:g}"
        return f"{type(self).__name__}({numbers})"

    @staticmethod
    @abstractmethod
    def shape(s: float) -> float:
        """From 0 at s = 0 to 1 at s = 1, a polynomial of degree 5 at most."""

    def value(self, t: float) -> float:
        """Value at time `t` (s)."""
        s = min(1.0, max(0.0, (t - self.begin) / (self.end - self.begin)))
        return self.first + (self.last - self.first) * self.shape(s)

    __call__ = value

    def average(self, t0: float, t1: float) -> float:
        """Mean over [t0, t1]: Gauss quadrature, exact between the ends of the ramp."""
        ends = [t0, *(t for t in (self.begin, self.end) if t0 < t < t1), t1]
        total = 0.0
        for a, b in pairwise(ends):
            mid, half = (a + b) / 2, (b - a) / 2
            total += half * sum(
                w * self.value(mid + half * x) for x, w in zip(_POINTS, _WEIGHTS, strict=True)
            )
        return float(total / (t1 - t0))


class RampLinear(_Ramp):
    """Straight from `first` to `last` between two instants, constant before and after.

    Parameters
    ----------
    begin, end : float
        Instants (s).
    first, last : float
        Values.

    Raises
    ------
    InputError
        If a number is not finite, or the end not after the beginning.

    Examples
    --------
    >>> ramp = RampLinear(1.0, 3.0)
    >>> ramp.value(2.0), round(ramp.average(0.0, 2.0), 12)
    (0.5, 0.125)
    """

    @staticmethod
    def shape(s: float) -> float:
        """Straight."""
        return s


class RampSmooth(_Ramp):
    """From `first` to `last` with continuous first and second derivatives: loads excite little.

    ``s^3 (10 - 15 s + 6 s^2)``. Loads that set in at once send waves whose kinks spoil the order
    of convergence; prescribed motion that starts with a velocity is an impact.

    Parameters
    ----------
    begin, end : float
        Instants (s).
    first, last : float
        Values.

    Raises
    ------
    InputError
        If a number is not finite, or the end not after the beginning.

    Examples
    --------
    >>> ramp = RampSmooth(0.0, 2.0, last=10.0)
    >>> ramp.value(1.0), round(ramp.average(0.0, 2.0), 12), ramp.value(7.0)
    (5.0, 5.0, 10.0)
    """

    @staticmethod
    def shape(s: float) -> float:
        """A polynomial of degree 5."""
        return s**3 * (10 - s * (15 - 6 * s))


class Harmonic:
    """``amplitude sin(2 pi frequency t + phase)``, with exact averages.

    Parameters
    ----------
    amplitude : float
    frequency : float
        In Hz.
    phase : float
        In rad.

    Raises
    ------
    InputError
        If a number is not finite.

    Examples
    --------
    >>> hum = Harmonic(2.0, frequency=50.0)
    >>> round(hum.value(5e-3), 12), round(hum.average(0.0, 1e-2), 9)
    (2.0, 1.273239545)
    """

    def __init__(self, amplitude: float, frequency: float, phase: float = 0.0) -> None:
        _finite("harmonic function", amplitude=amplitude, frequency=frequency, phase=phase)
        self.amplitude, self.frequency, self.phase = map(float, (amplitude, frequency, phase))

    def __repr__(self) -> str:
        return f"Harmonic({self.amplitude:g}, frequency={self.frequency:g}, phase={self.phase:g})"

    def value(self, t: float) -> float:
        """Value at time `t` (s)."""
        return self.amplitude * float(np.sin(2 * np.pi * self.frequency * t + self.phase))

    __call__ = value

    def average(self, t0: float, t1: float) -> float:
        """Mean over [t0, t1]."""
        return self.value((t0 + t1) / 2) * float(np.sinc(self.frequency * (t1 - t0)))
