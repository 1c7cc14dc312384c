"""Relative coordinates as functions of quadratic invariants: values, slopes, discrete derivatives.

A coordinate ``xi`` (m,) is a function of invariants ``pi`` (k,) of
:mod:`skfem_cosserat.relative`. Variational schemes need its slope at the midpoint, schemes that
conserve energy ``Psi`` with

``Psi(pi_0, pi_1) . (pi_1 - pi_0) = xi_1 - xi_0``,

exactly where both ends fulfil the constraints. Both multiply the gradients of the invariants at the
midpoint, which are objective: momentum is conserved. Everything takes stacks (..., k) and complex
numbers:
slopes of forces come from complex steps.
"""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from ..types import Array, Floats

#: most components of the coordinates of a force element in compiled steps
MOST_XI = 6
#: added to squares of distances, which are divided by: at a distance of zero there is no direction
NEAR = 1e-200


class Kind(ABC):
    """A kind of relative coordinate.

    Attributes
    ----------
    size, invariants : int
        m and k.
    period : float or (m,) array
        2 pi for an angle, which is continued over several turns, else 0.
    """

    size = 1
    invariants = 1
    period: float | Floats = 0.0

    @abstractmethod
    def value(self, pi: Array) -> Array:
        """``xi`` (..., m), the principal value of an angle."""

    def slope(self, pi: Array) -> Array:
        """``dxi/dpi`` (..., m, k), by default ``Psi(pi, pi)``."""
        xi = self.value(pi)
        return self.discrete(pi, xi, pi, xi)

    @abstractmethod
    def discrete(self, pi0: Array, xi0: Array, pi1: Array, xi1: Array) -> Array:
        """``Psi`` (..., m, k)."""

    def continued(self, pi: Array, before: Array) -> Array:
        """``xi``, an angle by less than half a turn from the value `before`."""
        xi = self.value(pi)
        if np.any(self.period):
            xi = xi - self.period * np.round((xi - before).real / (2 * np.pi))
        return xi


class Displacement(Kind):
    """``xi = pi``; the reference value is part of the neutral one."""

    def value(self, pi: Array) -> Array:
        """``xi = pi``."""
        return pi

    def discrete(self, pi0: Array, xi0: Array, pi1: Array, xi1: Array) -> Array:
        """``Psi = 1``."""
        return np.ones((*pi1.shape, 1))


class Distance(Kind):
    """``xi = sqrt(pi)``; ``Psi = 1/(xi_0 + xi_1)``."""

    def value(self, pi: Array) -> Array:
        """``xi = sqrt(pi)``."""
        return np.sqrt(pi + NEAR)

    def discrete(self, pi0: Array, xi0: Array, pi1: Array, xi1: Array) -> Array:
        """``Psi = 1/(xi_0 + xi_1)``."""
        return 1 / (xi0 + xi1)[..., None]


class Radius(Kind):
    """``xi = |pi|`` of two lengths; ``Psi = (pi_0 + pi_1)/(xi_0 + xi_1)``."""

    invariants = 2

    def value(self, pi: Array) -> Array:
        """``xi = |pi|``."""
        return np.sqrt((pi * pi).sum(-1, keepdims=True) + NEAR)

    def discrete(self, pi0: Array, xi0: Array, pi1: Array, xi1: Array) -> Array:
        """``Psi = (pi_0 + pi_1)/(xi_0 + xi_1)``."""
        return ((pi0 + pi1) / (xi0 + xi1))[..., None, :]


class Angle(Kind):
    """``xi = atan2(pi_2, pi_1)``, where ``pi`` is the cosine and the sine.

    With the mean angle ``m`` and the difference D of the ends ``Psi = (D/2)/sin(D/2) (-sin m,
    cos m)``; exact for unit vectors pi.
    """

    invariants = 2
    period = 2 * np.pi

    def value(self, pi: Array) -> Array:
        """Angle (..., 1) of the cosine and the sine, between -pi and pi."""
        return _atan2(pi[..., 1:], pi[..., :1])

    def slope(self, pi: Array) -> Array:
        """``(-s, c)/(c^2 + s^2)`` (..., 1, 2) for the cosine c and the sine s."""
        c, s = pi[..., 0], pi[..., 1]
        return (np.stack([-s, c], -1) / (c * c + s * s)[..., None])[..., None, :]

    def discrete(self, pi0: Array, xi0: Array, pi1: Array, xi1: Array) -> Array:
        """``Psi = (D/2)/sin(D/2) (-sin m, cos m)`` (..., 1, 2)."""
        mean, factor = 0.5 * (xi0 + xi1), _half_over_sine(0.5 * (xi1 - xi0))
        return factor[..., None] * np.stack([-np.sin(mean), np.cos(mean)], -1)


class Rotation(Kind):
    """``xi = phi(c) a`` with ``a = pi_1..3 = sin(theta) n``, ``c = pi_4 - 1/2 = cos(theta)``.

    ``Psi = [phi_m I, a_m (phi_1 - phi_0)/(c_1 - c_0)]`` with the means of both ends; below a turn
    of pi.
    """

    size = 3
    invariants = 4

    def value(self, pi: Array) -> Array:
        """Rotation vector ``phi(c) a`` (..., 3)."""
        return turn_factors(pi[..., 3] - 0.5)[0][..., None] * pi[..., :3]

    def slope(self, pi: Array) -> Array:
        """Derivatives ``[phi I, phi' a]`` (..., 3, 4) of the rotation vector by ``pi``."""
        phi = turn_factors(pi[..., 3] - 0.5)
        return _bordered(phi[0], phi[1][..., None] * pi[..., :3])

    def discrete(self, pi0: Array, xi0: Array, pi1: Array, xi1: Array) -> Array:
        """``Psi = [phi_m I, a_m (phi_1 - phi_0)/(c_1 - c_0)]`` (..., 3, 4)."""
        c0, c1 = pi0[..., 3] - 0.5, pi1[..., 3] - 0.5
        phi0, phi1 = turn_factors(c0)[0], turn_factors(c1)[0]
        mean = 0.5 * (pi0 + pi1)[..., :3]
        return _bordered(0.5 * (phi0 + phi1), _turn_quotient(c0, c1, phi0, phi1)[..., None] * mean)


class Joined(Kind):
    """Several coordinates side by side, for laws that couple them (bushings)."""

    def __init__(self, kinds: tuple[Kind, ...]) -> None:
        self.size = sum(kind.size for kind in kinds)
        self.invariants = sum(kind.invariants for kind in kinds)
        self.period = np.concatenate([np.full(kind.size, kind.period) for kind in kinds])
        # each with its places among the coordinates and among the invariants
        self._each = []
        m = k = 0
        for kind in kinds:
            self._each.append((kind, slice(m, m + kind.size), slice(k, k + kind.invariants)))
            m, k = m + kind.size, k + kind.invariants

    def value(self, pi: Array) -> Array:
        """Values (..., m) of all coordinates, one after the other."""
        return np.concatenate([kind.value(pi[..., p]) for kind, _, p in self._each], axis=-1)

    def slope(self, pi: Array) -> Array:
        """Block diagonal array (..., m, k) of the slopes of all coordinates."""
        return self._blocks([kind.slope(pi[..., p]) for kind, _, p in self._each])

    def discrete(self, pi0: Array, xi0: Array, pi1: Array, xi1: Array) -> Array:
        """Block diagonal array (..., m, k) of ``Psi`` of all coordinates."""
        return self._blocks(
            [
                kind.discrete(pi0[..., p], xi0[..., x], pi1[..., p], xi1[..., x])
                for kind, x, p in self._each
            ]
        )

    def _blocks(self, parts: list[Array]) -> Array:
        """Block diagonal array (..., m, k)."""
        shape = *parts[0].shape[:-2], self.size, self.invariants
        out = np.zeros(shape, dtype=np.result_type(*parts))
        for part, (_, x, p) in zip(parts, self._each, strict=True):
            out[..., x, p] = part
        return out


#: by the name of :class:`skfem_cosserat.relative.RelativeCoordinate`
KINDS: dict[str, Kind] = {
    "displacement": Displacement(),
    "position": Displacement(),
    "height": Displacement(),
    "distance": Distance(),
    "radius": Radius(),
    "angle": Angle(),
    "rotation": Rotation(),
}
_XYZ = np.arange(3)


def _bordered(diagonal: Array, column: Array) -> Array:
    """``[diagonal I, column]`` (..., 3, 4)."""
    out = np.zeros((*column.shape, 4), dtype=np.result_type(diagonal, column))
    out[..., _XYZ, _XYZ] = diagonal[..., None]
    out[..., 3] = column
    return out


def _atan2(y: Array, x: Array) -> Array:
    """``atan2(y, x)``; with complex numbers to first order in their small imaginary parts."""
    out = np.arctan2(y.real, x.real)
    if np.iscomplexobj(y) or np.iscomplexobj(x):
        return out + 1j * ((x.real * y.imag - y.real * x.imag) / (x.real**2 + y.real**2))
    return out


# -- x / sin x -------------------------------------------------------------------------------------

#: powers 0, 2, 4, ... of x/sin x, enough below _SMALL_ANGLE
_COSECANT = np.array([1, 1 / 6, 7 / 360, 31 / 15120, 127 / 604800, 73 / 3421440])
_SMALL_ANGLE = 0.1


def _half_over_sine(x: Array) -> Array:
    small = abs(x.real) < _SMALL_ANGLE
    safe = np.where(small, 1.0, x)
    return np.where(small, np.polyval(_COSECANT[::-1], x * x), safe / np.sin(safe))


# -- phi(c) = theta / sin theta, c = cos theta -----------------------------------------------------


def _turn_series(count: int = 24) -> Floats:
    """Powers of ``u = 1 - c`` of phi: ``2^n (n!)^2 / (2n+1)!``; converges for u < 2."""
    a = np.ones(count)
    for n in range(count - 1):
        a[n + 1] = a[n] * (n + 1) / (2 * n + 3)
    return a


_TURN = _turn_series()
_FIRST = np.arange(1, len(_TURN)) * _TURN[1:]
#: columns: powers of u in phi, -phi' and phi''
TURN_POWERS = np.zeros((len(_TURN), 3))
TURN_POWERS[:, 0] = _TURN
TURN_POWERS[:-1, 1] = _FIRST
TURN_POWERS[:-2, 2] = np.arange(1, len(_FIRST)) * _FIRST[1:]
TURN_POWERS[:, 1] *= -1
#: so many terms are exact to round-off up to here
NEAR_ONE = 0.25
#: places and weights in [0, 1]
QUADRATURE = 0.5 * (np.column_stack(np.polynomial.legendre.leggauss(5)) + [1.0, 0.0])


def turn_factors(c: Array) -> tuple[Array, Array]:
    """``phi = theta / sin(theta)`` of ``c = cos(theta)``, and phi'; analytic at 1.

    Beside the series at c = 1 by ``(1 - c^2) phi' = c phi - 1``.

    Examples
    --------
    >>> turn_factors(np.cos([0.0, 1e-9, 0.5]))[0].round(12).tolist()
    [1.0, 1.0, 1.042914821467]
    """
    u = 1 - c
    near = abs(u.real) < NEAR_ONE
    small = np.where(near, u, 0.0)
    powers = np.ones((*c.shape, len(_TURN)), dtype=c.dtype)
    powers[..., 1:] = small[..., None]
    series = powers.cumprod(axis=-1) @ TURN_POWERS[:, :2]
    # no rotation has a cosine below -1: NaN, so that Newton's method steps back
    safe = np.where(near, 0.0, np.where(c.real > -1, c, np.nan))
    square = 1 - safe * safe
    sine = np.sqrt(square)
    phi = _atan2(sine, safe) / sine
    first = (safe * phi - 1) / square
    return np.where(near, series[..., 0], phi), np.where(near, series[..., 1], first)


def _turn_quotient(c0: Array, c1: Array, phi0: Array, phi1: Array) -> Array:
    """``(phi_1 - phi_0)/(c_1 - c_0)``; of close ends the mean of phi' between, by quadrature."""
    step = c1 - c0
    close = abs(step.real) < 0.05 * (1 + np.minimum(c0.real, c1.real))
    share, weight = QUADRATURE.T
    inside = turn_factors(c0 + np.multiply.outer(share, np.where(close, step, 0.0)))[1]
    quotient = (phi1 - phi0) / np.where(close, 1.0, step)
    return np.where(close, np.tensordot(weight, inside, 1), quotient)
