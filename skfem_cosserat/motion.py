"""Ready motions of the ground: turning about an axis, and shaking by a record of accelerations."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .errors import InputError
from .frames import Motion, Place, unit_vector, vector
from .kernels import exp_quaternion, rotation_matrix
from .types import ArrayLike, Floats, numbers

__all__ = ["MotionShake", "MotionTurn"]


class MotionTurn(Motion):
    """The ground turns about an axis: a hub, a rotating frame.

    All places with the same motion move as one rigid frame, whatever their position.

    Parameters
    ----------
    axis : (3,) array
        Unit vector.
    angle : callable
        ``t -> float`` (rad), zero at the start; a :class:`RampSmooth` for instance.
    centre : (3,) array
        A point of the axis (m).

    Raises
    ------
    InputError
        If the axis is no unit vector, or `angle` cannot be called or (when it is needed) gives no
        finite number.

    Examples
    --------
    >>> from skfem_cosserat import ground
    >>> spin = MotionTurn(axis=(0, 0, 1), angle=lambda t: np.pi * t)
    >>> spin.frame(ground((2.0, 0, 0.5), spin), 0.5)[0].round(12).tolist()
    [0.0, 2.0, 0.5]
    """

    axis: Floats
    angle: Callable[[float], float]
    centre: Floats

    def __init__(
        self,
        axis: ArrayLike,
        angle: Callable[[float], float],
        centre: ArrayLike = (0.0, 0.0, 0.0),
    ) -> None:
        super().__init__()
        item = "turning motion"
        if not callable(angle):
            raise InputError(item, f"angle = {angle!r}, expected a function of time")
        self.__dict__.update(
            axis=unit_vector(item, "axis", axis), angle=angle, centre=vector(item, "centre", centre)
        )

    def frame(self, place: Place, t: float) -> Floats:
        """See the base class."""
        value = numbers(f"turning motion of the {place.label}", f"angle({t!r})", self.angle(t))
        if value.shape != () or not np.isfinite(value):
            raise InputError(
                f"turning motion of the {place.label}",
                f"angle is {value!r} at t = {t!r}, expected a finite number",
            )
        R = rotation_matrix(exp_quaternion(float(value) * self.axis))
        out = np.empty((4, 3))
        out[0] = self.centre + R @ (place.position - self.centre)
        out[1:] = R.T
        return out


class MotionShake(Motion):
    """The ground moves by a record of accelerations, as an earthquake's, from rest.

    The accelerations are linear between the instants of the record and integrated twice exactly;
    before the record the ground is at rest, after it it goes on with its last velocity. Give every
    place that is fixed to the ground the same motion: supports that stay behind are pulled apart
    (where nothing between them can give, that is an error).

    Parameters
    ----------
    times : (k,) array
        Increasing instants (s).
    accelerations : (k, 3) array
        In space (m/s^2).
    baseline : bool
        Take off the straight line (constant and linear in time) of the accelerations that leaves
        the ground at rest where it was at the end: records of instruments drift.

    Raises
    ------
    InputError
        If shapes differ, instants do not increase, or something is not finite.

    Examples
    --------
    >>> from skfem_cosserat import ground
    >>> t = np.linspace(0, 1, 101)
    >>> shake = MotionShake(t, np.outer(np.cos(2 * np.pi * t), (1.0, 0, 0)))
    >>> x = shake.frame(ground((0, 0, 0), shake), 0.5)[0, 0]
    >>> round(float(x), 4), round(2 / (2 * np.pi) ** 2, 4)   # with the record's kinks, without
    (0.0506, 0.0507)
    """

    times: Floats
    accelerations: Floats
    _x: Floats
    _v: Floats

    def __init__(self, times: ArrayLike, accelerations: ArrayLike, baseline: bool = False) -> None:
        super().__init__()
        item = "shaking motion"
        t = numbers(item, "times", times)
        a = numbers(item, "accelerations", accelerations)
        if t.ndim != 1 or len(t) < 2 or a.shape != (len(t), 3):
            raise InputError(
                item,
                f"times {t.shape} and accelerations {a.shape}, expected (k,) and (k, 3), k >= 2",
            )
        if not (np.isfinite(t).all() and np.isfinite(a).all()):
            raise InputError(item, "times or accelerations are not finite")
        if (np.diff(t) <= 0).any():
            bad = int(np.argmax(np.diff(t) <= 0))
            raise InputError(item, f"times do not increase: {t[bad]} is followed by {t[bad + 1]}")
        x, v = _integrated(t, a)
        if baseline:
            a = a - _drift(t, x[-1], v[-1])
            x, v = _integrated(t, a)
        self.__dict__.update(times=t, accelerations=a, _x=x, _v=v)

    def frame(self, place: Place, t: float) -> Floats:
        """See the base class."""
        times, a, x, v = self.times, self.accelerations, self._x, self._v
        out = np.vstack([place.position, np.eye(3)])
        if t <= times[0]:
            return out
        k = min(int(np.searchsorted(times, t, side="right")) - 1, len(times) - 1)
        s = t - times[k]
        out[0] += x[k] + s * v[k]
        if k < len(times) - 1:
            slope = (a[k + 1] - a[k]) / (times[k + 1] - times[k])
            out[0] += s**2 * (a[k] / 2 + s * slope / 6)
        return out


def _integrated(t: Floats, a: Floats) -> tuple[Floats, Floats]:
    """Displacements and velocities (k, 3) of accelerations linear in between, from rest."""
    h = np.diff(t)[:, None]
    v = np.vstack([np.zeros((1, 3)), np.cumsum(h * (a[1:] + a[:-1]) / 2, axis=0)])
    step = h * v[:-1] + h**2 * (2 * a[:-1] + a[1:]) / 6
    return np.vstack([np.zeros((1, 3)), np.cumsum(step, axis=0)]), v


def _drift(t: Floats, x: Floats, v: Floats) -> Floats:
    """The straight line of accelerations (k, 3) that ends at x with velocity v."""
    T, s = t[-1] - t[0], (t - t[0])[:, None]
    # c + d s: velocity c T + d T^2/2, displacement c T^2/2 + d T^3/6
    c = 6 * x / T**2 - 2 * v / T
    d = 6 * v / T**2 - 12 * x / T**3
    return np.asarray(c + d * s)
