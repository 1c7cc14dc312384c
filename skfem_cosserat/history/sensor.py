"""What a sensor has recorded: a number or vector at every step, with its spectrum."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..errors import InputError
from ..types import ArrayLike, Floats, numbers

__all__ = ["SensorRecord", "Spectrum", "spectrum"]


class Spectrum(NamedTuple):
    """One-sided amplitude spectrum of K instants.

    Attributes
    ----------
    frequencies : (K // 2 + 1,) array
        In Hz.
    amplitudes : (K // 2 + 1, ...) array
        Of a sine that fits the window, its amplitude (half of its range), in the record's units.
    """

    frequencies: Floats
    amplitudes: Floats

    def peaks(self, count: int = 5) -> Floats:
        """Frequencies (Hz) of the largest local maxima, largest first.

        Between the lines of the spectrum by a parabola through the logarithms of three amplitudes;
        vectors count by their length.

        Parameters
        ----------
        count : int
            At most so many.
        """
        from scipy.signal import find_peaks  # slow to import, seldom needed

        size = self.amplitudes
        if size.ndim > 1:
            size = np.linalg.norm(size.reshape(len(size), -1), axis=1)
        places, _ = find_peaks(size)
        places = places[np.argsort(-size[places])][:count]
        with np.errstate(divide="ignore"):
            left, mid, right = (np.log(size[places + k]) for k in (-1, 0, 1))
        curvature = left - 2 * mid + right
        sound = np.isfinite(curvature) & (curvature < 0)
        shift = np.zeros(len(places))
        np.divide(left - right, 2 * curvature, out=shift, where=sound)
        return np.asarray((places + shift) * self.frequencies[1])


def spectrum(times: ArrayLike, values: ArrayLike, window: str = "hann") -> Spectrum:
    """Amplitude spectrum of equidistant values, their mean and trend taken off.

    Parameters
    ----------
    times : (K,) array
        Equidistant instants (s), at least eight.
    values : (K, ...) array
    window : str
        Name of a window of ``scipy.signal.get_window``; amplitudes are those of a sine in it.

    Returns
    -------
    Spectrum

    Raises
    ------
    InputError
        If instants are not equidistant, too few, something is not finite, or there is no such
        window.

    Examples
    --------
    >>> t = np.linspace(0, 10, 1001)
    >>> found = spectrum(t, 0.3 * np.sin(2 * np.pi * 4.0 * t) + 2.0)
    >>> found.peaks(1).round(3).tolist(), float(found.amplitudes.max().round(3))
    ([4.0], 0.3)
    """
    t = numbers("argument times", "times", times)
    y = numbers("argument values", "values", values)
    if t.ndim != 1 or len(t) < 8 or y.shape[:1] != t.shape:
        raise InputError(
            "argument times", f"has shape {t.shape} for values {y.shape}, expected (K,), K >= 8"
        )
    if not (np.isfinite(t).all() and np.isfinite(y).all()):
        raise InputError("argument values", "times or values are not finite")
    steps = np.diff(t)
    step = float((t[-1] - t[0]) / (len(t) - 1))
    if not step > 0 or abs(steps - step).max() > 1e-6 * step:
        raise InputError(
            "argument times", f"steps from {steps.min():.6g} to {steps.max():.6g}, expected equal"
        )
    from scipy.signal import detrend, get_window  # slow to import, seldom needed

    try:
        weights = get_window(window, len(t))
    except ValueError as error:
        raise InputError("argument window", f"{window!r} is none that scipy knows") from error
    shaped = detrend(y, axis=0) * weights.reshape(-1, *[1] * (y.ndim - 1))
    lines: Floats = np.abs(np.fft.rfft(shaped, axis=0)).astype(float) / weights.sum()
    lines[1:] *= 2
    if len(t) % 2 == 0:
        lines[-1] /= 2  # the highest line has no partner
    return Spectrum(np.asarray(np.fft.rfftfreq(len(t), step), dtype=float), lines)


def _weights(at: Floats, order: int) -> Floats:
    """Weights of values at these distances for a derivative at zero, exact for polynomials."""
    size = float(abs(at).max())
    powers = np.vander(at / size, increasing=True).T
    wanted = np.zeros(len(at))
    wanted[order] = (1.0, 1.0, 2.0)[order] / size**order
    return np.asarray(np.linalg.solve(powers, wanted))


@dataclass(frozen=True)
class SensorRecord:
    """Values of a sensor at every step of a run.

    Attributes
    ----------
    times : (K,) array
        In s.
    values : (K, ...) array
    unit : str

    Examples
    --------
    >>> record = SensorRecord(np.arange(9) * 0.1, np.arange(9.0) ** 2, "m")
    >>> record.values.shape, record.unit
    ((9,), 'm')
    """

    times: Floats
    values: Floats
    unit: str = ""

    def spectrum(self, window: str = "hann") -> Spectrum:
        """See :func:`spectrum`."""
        return spectrum(self.times, self.values, window)

    def derivative(self, order: int) -> SensorRecord:
        """First or second derivative by differences of second order, at the ends one-sided.

        Second derivatives where steps differ: of first order in their difference.
        """
        t, x = self.times, self.values
        per = {1: "/s", 2: "/s^2"}[order]
        if len(t) < order + 2:
            return SensorRecord(t, np.full(x.shape, np.nan), self.unit + per)
        h = float((t[-1] - t[0]) / (len(t) - 1))
        out = np.empty_like(x)
        if abs(np.diff(t) - h).max() > 1e-6 * h:
            for k in range(len(t)):
                near = np.clip(k + np.arange(-1, 2), 0, len(t) - 1)
                if order == 2 or k in (0, len(t) - 1):
                    first = min(max(k - 1, 0), len(t) - 2 - order)
                    near = first + np.arange(2 + order if k in (0, len(t) - 1) else 3)
                out[k] = np.tensordot(_weights(t[near] - t[k], order), x[near], 1)
        elif order == 1:
            out[1:-1] = (x[2:] - x[:-2]) / (2 * h)
            out[0] = (-3 * x[0] + 4 * x[1] - x[2]) / (2 * h)
            out[-1] = (3 * x[-1] - 4 * x[-2] + x[-3]) / (2 * h)
        else:
            out[1:-1] = (x[2:] - 2 * x[1:-1] + x[:-2]) / h**2
            out[0] = (2 * x[0] - 5 * x[1] + 4 * x[2] - x[3]) / h**2
            out[-1] = (2 * x[-1] - 5 * x[-2] + 4 * x[-3] - x[-4]) / h**2
        return SensorRecord(t, out, self.unit + per)
