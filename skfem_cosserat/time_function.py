"""Functions of time with exact averages over steps, for loads, drives and moving ground."""

from __future__ import annotations

import heapq
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from operator import mul
from typing import Any, Protocol, runtime_checkable

import numpy as np

from .errors import InputError, failed
from .frames import Item, vector
from .frozen import Frozen
from .notebook import brief
from .types import ArrayLike, Floats, finite, numbers


@runtime_checkable
class TimeFunction(Protocol):
    """A number as a function of time, with its exact average over a step."""

    def value(self, t: float) -> float:
        """Value at time `t` (s)."""

    def average(self, t0: float, t1: float) -> float:
        """Mean over [t0, t1]."""


def constant_after(time: TimeFunction) -> float:
    """Time (s) from which a function is known not to change; infinite if that is not known."""
    return float(getattr(time, "constant_after", np.inf))


def numbers_of(
    times: Sequence[TimeFunction],
    owners: Sequence[Item],
    number: Callable[[TimeFunction], float],
    t: float,
) -> list[float]:
    """A number of each function at time `t` (s); an error of one names its owner."""
    out = []
    for time, owner in zip(times, owners, strict=True):
        try:
            out.append(number(time))
        except Exception as error:
            raise failed(owner.label, "its function of time", error, t) from error
    return out


#: plain numbers, of which Python makes sums faster than numpy where there are few
_POINTS, _WEIGHTS = (each.tolist() for each in np.polynomial.legendre.leggauss(3))


def _finite(item: str, **values: float) -> None:
    for name, value in values.items():
        finite(item, name, value)


class _Ramp(Frozen, ABC):
    """From one value to another, constant before and after."""

    def __init__(
        self, begin: float, end: float, *values: float, first: float = 0.0, last: float = 1.0
    ):
        if len(values) == 2 and (first, last) == (0.0, 1.0):
            first, last = values
        elif values:
            raise InputError("ramp", self._unclear(begin, end, values))
        _finite("ramp", begin=begin, end=end, first=first, last=last)
        if not end > begin:
            raise InputError("ramp", f"end = {end!r} s, expected it after begin = {begin!r} s")
        self.begin = float(begin)
        self.end = float(end)
        self.first = float(first)
        self.last = float(last)
        self.constant_after = self.end

    def _unclear(self, begin: float, end: float, values: tuple[float, ...]) -> str:
        """Text of an error: what numbers without names may have been meant to be."""
        kind = type(self).__name__
        value = values[0]
        return (
            f"got {(begin, end, *values)!r}, whose order is begin, end (s), first, last (the values"
            f" before and after): name them, as {kind}({begin!r}, {end!r}, last={value!r}) or"
            f" {kind}({begin!r}, {end!r}, first={value!r}, last=0.0)"
        )

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
        t0, t1 = min(t0, t1), max(t0, t1)  # composed steps go back, too
        ends = [t0, *(t for t in (self.begin, self.end) if t0 < t < t1), t1]
        total = 0.0
        for a, b in pairwise(ends):
            mid = (a + b) / 2
            half = (b - a) / 2
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
        Values before and after, 0 and 1 by default: both by their names, or both in this order.

    Raises
    ------
    InputError
        If a number is not finite, the end not after the beginning, or one value has no name.

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
        Values before and after, 0 and 1 by default: both by their names, or both in this order.

    Raises
    ------
    InputError
        If a number is not finite, the end not after the beginning, or one value has no name.

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


class Harmonic(Frozen):
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

    def __init__(self, amplitude: float, frequency: float, phase: float = 0.0):
        _finite("harmonic function", amplitude=amplitude, frequency=frequency, phase=phase)
        self.amplitude, self.frequency, self.phase = map(float, (amplitude, frequency, phase))

    def __repr__(self) -> str:
        return f"Harmonic({self.amplitude:g}, frequency={self.frequency:g}, phase={self.phase:g})"

    def value(self, t: float) -> float:
        """Value at time `t` (s)."""
        return self.amplitude * math.sin(2 * math.pi * self.frequency * t + self.phase)

    __call__ = value

    def average(self, t0: float, t1: float) -> float:
        """Mean over [t0, t1]."""
        half = math.pi * self.frequency * (t1 - t0)  # in rad
        return self.value((t0 + t1) / 2) * (math.sin(half) / half if half else 1.0)


class Constant(Frozen):
    """A number that does not change."""

    constant_after = -np.inf

    def __init__(self, number: float):
        self.number = float(number)

    def _brief(self) -> str:
        return brief(self.number)

    def value(self, t: float) -> float:
        """The number."""
        return self.number

    def average(self, t0: float, t1: float) -> float:
        """The number."""
        return self.number


class Table(Frozen):
    """Piecewise linear function of time, constant outside the table; averages are exact.

    Of springs (:class:`SpringDamper`) one of their stretch.

    Parameters
    ----------
    times, values : (k,) array
        Strictly increasing times (s), or stretches (m), and the values there.

    Raises
    ------
    InputError
        If shapes differ, times do not increase, or numbers are not finite.

    Examples
    --------
    >>> pulse = Table([0, 0.125, 0.25], [0, 1e4, 0])
    >>> pulse.average(0, 0.25), pulse.value(0.0625)
    (5000.0, 5000.0)
    """

    def __init__(self, times: ArrayLike, values: ArrayLike):
        self.times = numbers("table of time", "times", times)
        self.values = numbers("table of time", "values", values)
        if self.times.ndim != 1 or self.times.shape != self.values.shape or len(self.times) == 0:
            raise InputError(
                "table of time",
                f"times {self.times.shape} and values {self.values.shape}, expected equal (k,)",
            )
        if not (np.isfinite(self.times).all() and np.isfinite(self.values).all()):
            raise InputError("table of time", f"not finite: {self.times}, {self.values}")
        if (np.diff(self.times) <= 0).any():
            raise InputError("table of time", f"times do not increase: {self.times.tolist()}")
        self.constant_after = float(self.times[-1])

    def value(self, t: float) -> float:
        """Linear interpolation."""
        return float(np.interp(t, self.times, self.values))

    __call__ = value

    def average(self, t0: float, t1: float) -> float:
        """Exact mean: the trapezoidal rule between all kinks."""
        t0, t1 = min(t0, t1), max(t0, t1)
        t = np.concatenate([[t0], self.times[(t0 < self.times) & (self.times < t1)], [t1]])
        f = np.interp(t, self.times, self.values)
        return float(((f[1:] + f[:-1]) / 2 * np.diff(t)).sum() / (t1 - t0))

    def integral(self, x: float) -> float:
        """From zero to `x`: the potential (J) of a table of forces over a stretch."""
        return x * self.average(0.0, x) if x else 0.0

    def extended(self, x: Any) -> Any:
        """The value, also of complex numbers, with which complex steps find its slope."""
        steps = np.diff(self.times)
        rises = np.clip(x - self.times[:-1], 0.0, steps) @ (np.diff(self.values) / steps)
        return self.values[0] + rises


def _clenshaw_curtis(n: int) -> tuple[Floats, Floats, Floats]:
    """Points of [-1, 1], both ends among them; weights; what gives a late Chebyshev coefficient."""
    points = -np.cos(np.pi * np.arange(n + 1) / n)
    k = np.arange(0, n + 1, 2)
    to_coefficients = np.linalg.inv(np.polynomial.chebyshev.chebvander(points, n))
    return points, (2 / (1 - k**2)) @ to_coefficients[k], to_coefficients[n - 1]


_ALL = _clenshaw_curtis(16)
_LESS = _clenshaw_curtis(8)
#: without both ends, at which a function is asked exactly: it may not be defined beyond them
_INSIDE, _BY = _ALL[0][1:-1].tolist(), _ALL[1].tolist()
#: what tells of an error: the difference to every second point, and a coefficient that sees kinks
#: where both agree by chance
_SIGNS = (_ALL[1] - np.insert(_LESS[1], range(1, 9), 0.0)).tolist(), _ALL[2].tolist()
#: Intervals at most in an average: a function that is noisy or jumps without end stays affordable.
PIECES = 1000
#: minus its error, both ends, the integral and that of the magnitude
_Piece = tuple[float, float, float, float, float]


class FunctionOfTime(Frozen):
    """Wraps a callable; averages by Clenshaw-Curtis quadrature, bisected where it has kinks.

    A step in which it is smooth takes 17 values. What is narrower than a tenth of a step may lie
    between them: give its `kinks`.

    Parameters
    ----------
    function : callable
        ``t -> float``.
    kinks : sequence of float
        Times of known kinks or jumps (s); others are found by bisection.

    Raises
    ------
    InputError
        If it cannot be called, or a value (when it is needed) is no finite number.

    Examples
    --------
    >>> ramp = FunctionOfTime(lambda t: max(0.0, t - 0.3))
    >>> abs(ramp.average(0.0, 1.0) - 0.7**2 / 2) < 1e-13
    True
    """

    def __init__(self, function: Callable[[float], float], kinks: Sequence[float] = ()):
        if not callable(function):
            raise InputError("function of time", f"{function!r} is not callable")
        self.function = function
        self.kinks = np.sort(numbers("function of time", "kinks", kinks))
        if self.kinks.ndim != 1 or not np.isfinite(self.kinks).all():
            raise InputError("function of time", f"kinks = {kinks!r}, expected finite times")
        self._listed = self.kinks.tolist()

    def _brief(self) -> str:
        return brief(self.function)

    def value(self, t: float) -> float:
        """The function's value, which must be a finite number."""
        return self._values([t])[0]

    __call__ = value

    def _values(self, times: Sequence[float]) -> list[float]:
        """The function's values, up to the first that is no finite number."""
        out = []
        function = self.function
        for t in times:
            try:
                value = function(t)
            except Exception as error:
                raise failed("function of time", "it", error, t) from error
            if not (isinstance(value, float) and math.isfinite(value)):
                value = finite("function of time", "value", value, f"a number at t = {t!r}")
            out.append(float(value))
        return out

    def average(self, t0: float, t1: float) -> float:
        """Mean over [t0, t1]."""
        t0, t1 = min(t0, t1), max(t0, t1)
        ends = [t0, *(t for t in self._listed if t0 < t < t1), t1]
        return sum(self._integral(a, b) for a, b in pairwise(ends)) / (t1 - t0)

    def _integral(self, a: float, b: float) -> float:
        """Halve the interval of the largest error until none is left above round-off."""
        pieces = [self._piece(a, b)]
        scale = pieces[0][4]
        while len(pieces) < PIECES:
            error, a, b, *_ = pieces[0]
            if -error <= 1e-14 * scale:
                break
            mid = (a + b) / 2
            heapq.heapreplace(pieces, left := self._piece(a, mid))
            heapq.heappush(pieces, right := self._piece(mid, b))
            scale = max(scale, left[4] + right[4])
        return math.fsum(each[3] for each in pieces)

    def _piece(self, a: float, b: float) -> _Piece:
        mid = (a + b) / 2
        half = (b - a) / 2
        f = self._values([a, *(mid + half * x for x in _INSIDE), b])
        error = 0.0
        if b - a > 1e-14 * max(abs(a), abs(b)):  # else a jump, pinned down to rounding
            error = half * max(abs(sum(map(mul, each, f))) for each in _SIGNS)
        return -error, a, b, half * sum(map(mul, _BY, f)), half * sum(map(mul, _BY, map(abs, f)))


Amplitude = float | TimeFunction | Callable[[float], float] | None


def of_the_user(function: object) -> bool:
    """True if a function of time is the user's: asked again later it may give other numbers.

    Classes that users derive from ours are theirs, too.

    Examples
    --------
    >>> of_the_user(RampSmooth(0, 1)), of_the_user(FunctionOfTime(lambda t: t))
    (False, True)
    """
    while isinstance(function, (FunctionOfTime, Component)):
        function = function.function
    return type(function).__module__.partition(".")[0] != __name__.partition(".")[0]


def time_function(item: str, value: Amplitude, name: str = "amplitude") -> TimeFunction:
    """A number, table or function of time as such; None: one."""
    if value is None:
        return Constant(1.0)
    if isinstance(value, (int, float, np.number)):
        return Constant(finite(item, name, value))
    if isinstance(value, TimeFunction):
        return value
    if not callable(value):
        raise InputError(
            item, f"{name} = {value!r}, expected a number, a Table or a function of time"
        )
    try:
        first = value(0.0)
    except Exception as error:
        raise failed(item, f"its {name}", error, 0.0) from error
    finite(item, name, first, "a number at t = 0.0")
    return FunctionOfTime(value)


@dataclass(frozen=True, eq=False, repr=False)
class Component(Frozen):
    """One component of a function of time that gives three; errors name item and argument."""

    function: Callable[[float], ArrayLike]
    number: int
    item: str
    name: str

    def __call__(self, t: float) -> float:
        """The component at time `t` (s)."""
        return float(vector(self.item, f"{self.name}({t!r})", self.function(t))[self.number])
