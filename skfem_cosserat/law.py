"""Constitutive laws: stored energy per length of strains, its derivatives and its discrete one.

Strains ``eps = (Gamma_1, Gamma_2, Gamma_3, K_1, K_2, K_3)`` come as (..., 6). Complex ones, as the
complex step has them, are taken to first order in their imaginary part.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import numpy as np

from .errors import InputError
from .frozen import Frozen
from .types import Array, Floats

__all__ = ["Law", "LawQuadratic", "LawStored", "StrainFunction"]

#: of strains (k, 6), or any other stack of them
StrainFunction: TypeAlias = Callable[[Array], Array]

#: what errors name
ITEM = "stored energy"
EPS = float(np.finfo(float).eps)
#: of the complex step, times the strain that belongs to the axial stiffness
STEP = 1e-30
#: the same of differences
DIFFERENCE = 1e-4
#: Gauss points of an interval [-1/2, 1/2] beside its middle, and the weight of each
_GAUSS = np.sqrt(0.15), 5 / 18
#: increments below this share of the strains leave only the leading term of a discrete tangent
_SMALL = 1e-7


class Law(Frozen):
    """Stored energy per length W of strains.

    Parameters
    ----------
    stiffness : (6, 6) array
        Its second derivative at zero strain, symmetric positive definite.
    """

    #: what rounding makes of an energy that vanishes (J/m)
    noise: float = 0.0
    #: numbers of strains that are held (:class:`skfem_cosserat.Theory`): it knows nothing of them
    held: tuple[int, ...] = ()

    def __init__(self, stiffness: Floats) -> None:
        self.stiffness = stiffness
        #: strains (6,) that have the energy of an axial strain of one: what steps are relative to
        self.scale: Floats = np.sqrt(stiffness[2, 2] / np.diag(stiffness))

    @abstractmethod
    def energy(self, eps: Array) -> Array:
        """W (...) in J/m."""

    @abstractmethod
    def stress(self, eps: Array) -> Array:
        """``dW/d eps`` (..., 6): forces in N, moments in N m."""

    @abstractmethod
    def tangent(self, eps: Array) -> Array:
        """Second derivative (..., 6, 6)."""

    def discrete(self, eps0: Array, eps1: Array) -> Array:
        """Discrete derivative S (..., 6): ``S . (eps1 - eps0) = W(eps1) - W(eps0)`` to rounding.

        That of Gonzalez, J. Nonlinear Sci. 6 (1996) 449: the stress of the mean strain, corrected
        in the metric of the stiffness at zero strain, so that it does not depend on units. It is
        symmetric in both strains, hence of second order.
        """
        found = self._correction(eps0, eps1)
        return found.middle + _ratio(found.gap, found.square)[..., None] * found.metric

    def discrete_tangent(self, eps0: Array, eps1: Array) -> Array:
        """Derivative (..., 6, 6) of the discrete derivative by eps1; not symmetric."""
        half = 0.5 * self.tangent(0.5 * (eps0 + eps1))
        middle, metric, square, gap, size, (last,) = self._correction(eps0, eps1, eps1)
        factor = _ratio(gap, square)
        slope = last - middle - (half @ (eps1 - eps0)[..., None])[..., 0]
        slope = _ratio(slope - 2 * factor[..., None] * metric, square[..., None])
        more = factor[..., None, None] * self.stiffness + metric[..., None] * slope[..., None, :]
        # of the order of the increment, and rounding where that is very small
        return half + np.where((square > _SMALL**2 * size)[..., None, None], more, 0.0)

    def mean_stress(self, eps0: Array, eps1: Array) -> Array:
        """Mean of the stresses on the way by three Gauss points, to the sixth order of it."""
        middle, more, _ = self._stresses_between(eps0, eps1)
        return middle + more

    def _stresses_between(
        self, eps0: Array, eps1: Array, *others: Array
    ) -> tuple[Array, Array, Array]:
        """Stress of the mean strain, what the mean stress is more than it, and that of `others`.

        In one call: calls of functions take longer than what they do.
        """
        place, weight = _GAUSS
        mean, step = 0.5 * (eps0 + eps1), place * (eps1 - eps0)
        found = self.stress(np.array([mean, mean - step, mean + step, *others]))
        middle = found[0]
        return middle, weight * (found[1] + found[2] - 2 * middle), found[3:]

    def _correction(self, eps0: Array, eps1: Array, *others: Array) -> _Correction:
        """Terms of the discrete derivative.

        The difference of energies cancels to the third order of the increment. Where that is below
        the rounding of the energies, the Gauss rule for the mean stress has the same value without
        the loss.
        """
        middle, more, stresses = self._stresses_between(eps0, eps1, *others)
        d = eps1 - eps0
        metric, work = d @ self.stiffness, middle * d
        before, after = self.energy(np.array([eps0, eps1]))
        gap, smooth = (after - before) - work.sum(-1), (more * d).sum(-1)
        size = abs(before.real) + abs(after.real)
        rounding = 4 * EPS * (size + abs(work.real).sum(-1)) + 2 * self.noise
        gap = np.where(abs((gap - smooth).real) <= rounding, smooth, gap)
        return _Correction(middle, metric, (metric * d).sum(-1), gap, size, stresses)


class _Correction(NamedTuple):
    """Of an increment d of strains in the metric D of the stiffness at zero strain.

    Attributes
    ----------
    middle : (..., 6) array
        Stress S of the mean strain.
    metric : (..., 6) array
        ``D d``.
    square, gap, size : (...) array
        ``d . D d``, ``W_1 - W_0 - S . d``, and the size of the energies.
    others : (k, ..., 6) array
        Stresses of other strains.
    """

    middle: Array
    metric: Array
    square: Array
    gap: Array
    size: Array
    others: Array


def _ratio(a: Array, b: Array) -> Array:
    """a/b, zero where b is."""
    safe = np.where(b == 0, 1.0, b)
    return np.where(b == 0, 0.0, a / safe)


class LawQuadratic(Law):
    """``W = eps . D eps/2``.

    Examples
    --------
    >>> law = LawQuadratic(np.diag([1.0, 1, 2, 1, 1, 1]))
    >>> float(law.energy(np.array([0, 0, 3.0, 0, 0, 0])))
    9.0
    """

    def energy(self, eps: Array) -> Array:
        """See the base class."""
        return 0.5 * (eps * (eps @ self.stiffness)).sum(-1)

    def stress(self, eps: Array) -> Array:
        """See the base class."""
        return eps @ self.stiffness  # symmetric

    def tangent(self, eps: Array) -> Array:
        """See the base class."""
        return np.broadcast_to(self.stiffness, (*eps.shape, 6))

    def discrete(self, eps0: Array, eps1: Array) -> Array:
        """The mean stress."""
        return 0.5 * (self.stress(eps0) + self.stress(eps1))

    def discrete_tangent(self, eps0: Array, eps1: Array) -> Array:
        """Half of the stiffness."""
        return 0.5 * self.tangent(eps1)


class LawStored(Law):
    """Any stored energy, with derivatives that are given or made from it.

    Without a gradient the complex step takes its place: exact to rounding. Without a second
    derivative the complex step through the gradient does, or, where the gradient is made itself
    or does not take complex numbers (`complex_step` False), differences of fourth order.

    Parameters
    ----------
    energy : callable
        Strains (..., 6) to (...).
    gradient, hessian : callable or None
        Strains to (..., 6) and to (..., 6, 6).
    stiffness : (6, 6) array
        See :class:`Law`.
    complex_step : bool
        Whether the gradient takes complex numbers.
    noise : float
        What rounding makes of W at strains where it vanishes (J/m).
    """

    def __init__(
        self,
        energy: StrainFunction,
        gradient: StrainFunction | None,
        hessian: StrainFunction | None,
        stiffness: Floats,
        complex_step: bool = True,
        noise: float = 0.0,
    ) -> None:
        super().__init__(stiffness)
        self._energy, self._gradient, self._hessian = energy, gradient, hessian
        self.complex_step, self.noise = complex_step, noise

    def energy(self, eps: Array) -> Array:
        """See the base class."""
        if np.iscomplexobj(eps):
            return self.energy(eps.real) + 1j * (self.stress(eps.real) * eps.imag).sum(-1)
        return self._value("energy", self._energy, eps, eps.shape[:-1])

    def stress(self, eps: Array) -> Array:
        """See the base class."""
        if np.iscomplexobj(eps):
            change = (self.tangent(eps.real) @ eps.imag[..., None])[..., 0]
            return self.stress(eps.real) + 1j * change
        if self._gradient is not None:
            return self._value("gradient", self._gradient, eps, eps.shape)
        return self._complex("energy", self._energy, eps, eps.shape)

    def tangent(self, eps: Array) -> Array:
        """See the base class; symmetric if it is made from the gradient."""
        shape = (*eps.shape, 6)
        if self._hessian is not None:
            return self._value("hessian", self._hessian, eps, shape)
        if self._gradient is not None and self.complex_step:
            out = self._complex("gradient", self._gradient, eps, shape)
        else:
            out = difference(self.stress, eps, DIFFERENCE * self.scale)
        return 0.5 * (out + np.swapaxes(out, -1, -2))

    def _complex(
        self, name: str, function: StrainFunction, eps: Array, shape: tuple[int, ...]
    ) -> Array:
        """Derivative by the complex step; its index comes last but for those of the value."""
        steps = STEP * self.scale
        moved = eps[..., None, :] + 1j * np.diag(steps)
        found = self._value(name, function, moved, (*eps.shape, *shape[eps.ndim :]))
        axis = eps.ndim - 1
        return found.imag / steps.reshape(6, *(1,) * (found.ndim - 1 - axis))

    def _value(
        self, name: str, function: StrainFunction, eps: Array, shape: tuple[int, ...]
    ) -> Array:
        """A user's function: it cannot change its argument, and returns what it should."""
        given = np.array(eps)
        given.flags.writeable = False
        with np.errstate(all="ignore"):  # what is not finite is named, or given up by the solver
            out = np.array(function(given))
        kind, hint = "f", "real numbers"
        if np.iscomplexobj(eps):
            kind, hint = "c", "complex numbers; give its derivative if it takes real ones only"
        if out.shape != shape or out.dtype.kind != kind:
            raise InputError(
                ITEM,
                f"{name} of {eps.dtype} strains {eps.shape} is {out.dtype} of shape {out.shape},"
                f" expected shape {shape} of {hint}",
            )
        return out


def difference(function: StrainFunction, eps: Array, steps: Floats) -> Array:
    """Derivative by differences of fourth order with steps (6,); its index follows the stack's."""
    by = np.diag(steps)
    near, far = (
        function(eps[..., None, :] + k * by) - function(eps[..., None, :] - k * by) for k in (1, 2)
    )
    extra = (1,) * (near.ndim - eps.ndim)
    return (8 * near - far) / (12 * steps.reshape(6, *extra))
