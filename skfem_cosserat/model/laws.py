"""Laws of force elements: generalised force, stored energy, and what is dissipated in a step."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence

import numpy as np

from ..coupling import Coupling
from ..types import Array

__all__ = ["Law", "LinearLaw", "SlackLaw", "apply"]


class Law(ABC):
    """Generalised force of c couplings by their stretch e (..., c, m).

    The stretch is the coordinate less its neutral value. Numbers may be complex.

    Attributes
    ----------
    K, C : (c, m, m) array
        Stiffness and damping.
    """

    def __init__(self, members: Sequence[Coupling]) -> None:
        self.K = np.array([c.stiffness for c in members])
        self.C = np.array([c.damping for c in members])

    @abstractmethod
    def energy(self, e: Array) -> Array:
        """Stored energy (..., c)."""

    @abstractmethod
    def force(self, e: Array, rate: Array) -> Array:
        """Force (..., c, m) against a larger stretch: tension is positive."""

    def acts(self, e: Array) -> Array:
        """Whether there is a force at stretch e, (..., c, m): a cable may be slack."""
        return np.ones(e.shape, dtype=bool)

    @abstractmethod
    def discrete(
        self, e0: Array, e1: Array, h: float, decay: float = 0.0
    ) -> tuple[Array, Array, Array]:
        """Force sigma (c, m), ``dsigma/de_1`` (c, m, m), and what is dissipated (c,).

        ``sigma . (e_1 - e_0)`` is the change of energy plus what is dissipated; the scheme's own
        damping is that of the stiffness with the factor ``h decay/2``.
        """

    @abstractmethod
    def moving(self, e: Array, rate: Array) -> tuple[Array, Array, Array]:
        """:meth:`force` with its derivatives (c, m, m) by e and by `rate`."""

    @abstractmethod
    def midpoint(
        self, e: Array, rate: Array, e0: Array, e1: Array, h: float
    ) -> tuple[Array, Array, Array, Array, Array]:
        """Force sigma with its derivatives by e, by `rate`, and by e_1; what is dissipated.

        e is that of the midpoint configuration.
        """


class LinearLaw(Law):
    """``K e + C de/dt``."""

    def __init__(self, members: Sequence[Coupling]) -> None:
        super().__init__(members)
        values, vectors = np.linalg.eigh(self.C)
        # so that what is dissipated is a sum of squares
        self._root = np.sqrt(values.clip(0))[..., None] * vectors.swapaxes(-1, -2)
        self._none = np.zeros_like(self.K)

    def energy(self, e: Array) -> Array:
        """See the base class."""
        return 0.5 * (e * apply(self.K, e)).sum(-1)

    def force(self, e: Array, rate: Array) -> Array:
        """See the base class."""
        return apply(self.K, e) + apply(self.C, rate)

    def discrete(
        self, e0: Array, e1: Array, h: float, decay: float = 0.0
    ) -> tuple[Array, Array, Array]:
        """See the base class."""
        change = e1 - e0
        sigma = apply(self.K, 0.5 * (e0 + e1)) + apply(self.C, change) / h
        dissipated = (apply(self._root, change) ** 2).sum(-1) / h
        if decay:
            numerical = 0.5 * decay * apply(self.K, change)
            sigma, dissipated = sigma + numerical, dissipated + (numerical * change).sum(-1)
        return sigma, 0.5 * (1 + decay) * self.K + self.C / h, dissipated

    def moving(self, e: Array, rate: Array) -> tuple[Array, Array, Array]:
        """See the base class."""
        return self.force(e, rate), self.K, self.C

    def midpoint(
        self, e: Array, rate: Array, e0: Array, e1: Array, h: float
    ) -> tuple[Array, Array, Array, Array, Array]:
        """See the base class."""
        dissipated = h * (apply(self._root, rate) ** 2).sum(-1)
        return self.force(e, rate), self.K, self.C, self._none, dissipated


class SlackLaw(Law):
    """Tension only: ``k e + c de/dt`` while e > 0, never negative.

    The damper takes the part of a step in which the cable is taut.
    """

    def __init__(self, members: Sequence[Coupling]) -> None:
        super().__init__(members)
        self.k, self.c = self.K[:, 0], self.C[:, 0]

    def energy(self, e: Array) -> Array:
        """See the base class."""
        return 0.5 * (self.k * _positive(e) ** 2).sum(-1)

    def force(self, e: Array, rate: Array) -> Array:
        """See the base class."""
        return np.where(e.real > 0, _positive(self.k * e + self.c * rate), 0.0)

    def acts(self, e: Array) -> Array:
        """See the base class."""
        return np.asarray(e.real > 0)

    def discrete(
        self, e0: Array, e1: Array, h: float, decay: float = 0.0
    ) -> tuple[Array, Array, Array]:
        """See the base class."""
        up0, up1 = _positive(e0), _positive(e1)
        taut1 = e1.real > 0
        both = taut1 & (e0.real > 0)
        # (V_1 - V_0)/(e_1 - e_0); without cancellation where only one end is taut
        change = np.where(taut1 ^ (e0.real > 0), e1 - e0, 1.0)
        quotient = np.where(both, 0.5 * (up0 + up1), 0.5 * (up1 * up1 - up0 * up0) / change)
        slope = np.where(both, 0.5, (taut1 * up1 - quotient) / change)
        slope = np.where(taut1 | (e0.real > 0), slope, 0.0)
        c = self.c + 0.5 * h * decay * self.k
        spring, damper = self.k * quotient, c * (up1 - up0) / h
        pulls = (spring + damper).real > 0
        sigma = np.where(pulls, spring + damper, 0.0)
        by_e1 = np.where(pulls, self.k * slope + c * taut1 / h, 0.0)
        dissipated = ((sigma - spring) * (e1 - e0)).sum(-1)
        return sigma, by_e1[..., None], dissipated

    def moving(self, e: Array, rate: Array) -> tuple[Array, Array, Array]:
        """See the base class."""
        force = self.force(e, rate)
        pulls = force.real > 0
        return force, (self.k * pulls)[..., None], (self.c * pulls)[..., None]

    def midpoint(
        self, e: Array, rate: Array, e0: Array, e1: Array, h: float
    ) -> tuple[Array, Array, Array, Array, Array]:
        """See the base class."""
        spring = self.k * _positive(e)
        damper = self.c * (_positive(e1) - _positive(e0)) / h
        pulls = (spring + damper).real > 0
        sigma = np.where(pulls, spring + damper, 0.0)
        by_e = np.where(pulls, self.k * (e.real > 0), 0.0)[..., None]
        by_e1 = np.where(pulls, self.c * (e1.real > 0) / h, 0.0)[..., None]
        dissipated = h * ((sigma - spring) * rate).sum(-1)
        return sigma, by_e, np.zeros_like(by_e), by_e1, dissipated


def _positive(e: Array) -> Array:
    return np.where(e.real > 0, e, 0.0)


def apply(matrices: Array, vectors: Array) -> Array:
    """Product of stacks ``(..., m, k)`` and ``(..., k)``.

    Examples
    --------
    >>> apply(np.array([[[0.0, 2.0]], [[1.0, 1.0]]]), np.array([[3.0, 4.0], [5.0, 6.0]])).tolist()
    [[8.0], [11.0]]
    """
    return (matrices @ vectors[..., None])[..., 0]
