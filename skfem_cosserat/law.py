"""Constitutive laws: stored energy per length of strains, its derivatives and its discrete one.

Strains ``eps = (Gamma_1, Gamma_2, Gamma_3, K_1, K_2, K_3)`` come as (..., 6). Complex ones, as the
complex step has them, are taken to first order in their imaginary part.
"""

from __future__ import annotations

import sys
from abc import ABC, abstractmethod
from collections.abc import Callable
from functools import cached_property
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from .errors import InputError, failed
from .frozen import Frozen
from .types import Array, Floats

#: of strains (k, 6), or any other stack of them
StrainFunction: TypeAlias = Callable[[Array], Array]

#: what errors name
ITEM = "stored energy"
EPS = float(np.finfo(float).eps)
#: of the complex step; sections take it times the strain that belongs to the axial stiffness
STEP = 1e-30
#: the same of differences
DIFFERENCE = 1e-4
#: Gauss points of an interval [-1/2, 1/2] beside its middle, and the weight of each
GAUSS = float(np.sqrt(0.15)), 5 / 18
_PLACES = np.array([0.0, -GAUSS[0], GAUSS[0]])
#: increments below this share of the strains leave only the leading term of a discrete tangent
SMALL = 1e-7


class Law(Frozen, ABC):
    """Stored energy per length W of strains.

    Parameters
    ----------
    stiffness : (6, 6) array
        Its second derivative at zero strain, symmetric positive definite; a metric, if it is a
        potential of other coordinates (m,), as those of forces.
    size : float
        Axial strain, or coordinate, that steps of differences are relative to.
    """

    #: what rounding makes of an energy that vanishes (J/m)
    noise: float = 0.0
    #: numbers of strains that are held (:class:`skfem_cosserat.Theory`): it knows nothing of them
    held: tuple[int, ...] = ()

    def __init__(self, stiffness: Floats, size: float = 1.0):
        self.stiffness = stiffness
        #: strains (6,) that have the energy of an axial strain of one: what steps are relative to
        axial = min(2, len(stiffness) - 1)
        self.scale = size * np.sqrt(stiffness[axial, axial] / np.diag(stiffness))
        self._ones = np.ones(len(stiffness))

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
        middle, metric, square, gap, size = self._correction(eps0, eps1)
        factor = _ratio(gap, square)
        slope = self.stress(eps1) - middle - (half @ (eps1 - eps0)[..., None])[..., 0]
        slope = _ratio(slope - 2 * factor[..., None] * metric, square[..., None])
        more = factor[..., None, None] * self.stiffness + metric[..., None] * slope[..., None, :]
        # of the order of the increment, and rounding where that is very small
        return half + np.where((square > SMALL**2 * size)[..., None, None], more, 0.0)

    def mean_stress(self, eps0: Array, eps1: Array) -> Array:
        """Mean of the stresses on the way by three Gauss points, to the sixth order of it."""
        place, weight = GAUSS
        mean = 0.5 * (eps0 + eps1)
        step = place * (eps1 - eps0)
        found = self.stress(np.stack([mean, mean - step, mean + step], -2))
        middle, before, after = (found[..., k, :] for k in range(3))
        return middle + weight * (before + after - 2 * middle)

    def beside(self, mean: Array, d: Array) -> tuple[Array, Array]:
        """Stress of the mean strain, and sum (...) of the derivatives of W along d beside it.

        At the two outer ones of three Gauss points of an increment d.
        """
        # in one call: calls of functions take longer than what they do
        found = self.stress(mean[..., None, :] + _PLACES[:, None] * d[..., None, :])
        return found[..., 0, :], ((found[..., 1, :] + found[..., 2, :]) * d).dot(self._ones)

    def _correction(self, eps0: Array, eps1: Array) -> _Correction:
        """Terms of the discrete derivative.

        The difference of energies cancels to the third order of the increment. Where that is below
        the rounding of the energies, the Gauss rule for the mean stress has the same value without
        the loss.
        """
        d = eps1 - eps0
        middle, beside = self.beside(0.5 * (eps0 + eps1), d)
        both = self.energy(np.stack([eps0, eps1], -2))
        before = both[..., 0]
        after = both[..., 1]
        metric = d.dot(self.stiffness)
        terms = middle * d
        work = terms.dot(self._ones)  # faster than the sum over the last axis
        gap = (after - before) - work
        smooth = GAUSS[1] * (beside - work - work)
        size = abs(before.real) + abs(after.real)
        rounding = (4 * EPS) * (size + abs(terms.real).dot(self._ones)) + 2 * self.noise
        np.copyto(gap, smooth, where=abs((gap - smooth).real) <= rounding)
        return _Correction(middle, metric, (metric * d).dot(self._ones), gap, size)


class _Correction(NamedTuple):
    """Terms for an increment d of strains, in the metric D of the stiffness at zero strain.

    Attributes
    ----------
    middle : (..., 6) array
        Stress S of the mean strain.
    metric : (..., 6) array
        ``D d``.
    square, gap, size : (...) array
        ``d . D d``, ``W_1 - W_0 - S . d``, and the size of the energies.
    """

    middle: Array
    metric: Array
    square: Array
    gap: Array
    size: Array


def _ratio(a: Array, b: Array) -> Array:
    """a/b, zero where b is."""
    none = b == 0
    return a * ~none / (b + none)


class LawQuadratic(Law):
    """``W = eps . D eps/2``.

    Examples
    --------
    >>> law = LawQuadratic(np.diag([1.0, 1, 2, 1, 1, 1]))
    >>> float(law.energy(np.array([0, 0, 3.0, 0, 0, 0])))
    9.0
    """

    def energy(self, eps: Array) -> Array:
        """``W = eps . D eps/2`` (...) in J/m."""
        return 0.5 * (eps * (eps @ self.stiffness)).sum(-1)

    def stress(self, eps: Array) -> Array:
        """``D eps`` (..., 6): forces in N, moments in N m."""
        return eps @ self.stiffness  # symmetric

    def tangent(self, eps: Array) -> Array:
        """The stiffness D for all strains (..., 6, 6)."""
        return np.broadcast_to(self.stiffness, (*eps.shape, 6))


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
    size : float
        See :class:`Law`.
    """

    def __init__(
        self,
        energy: StrainFunction,
        gradient: StrainFunction | None,
        hessian: StrainFunction | None,
        stiffness: Floats,
        complex_step: bool = True,
        noise: float = 0.0,
        size: float = 1.0,
    ):
        super().__init__(stiffness, size)
        self.functions = energy, gradient, hessian
        self.complex_step = complex_step
        self.noise = noise
        self._steps = STEP * self.scale
        self._moves = 1j * np.diag(self._steps)

    def energy(self, eps: Array) -> Array:
        """W (...) in J/m by the given function; of complex strains to first order."""
        if np.iscomplexobj(eps):
            return self.energy(eps.real) + 1j * (self.stress(eps.real) * eps.imag).sum(-1)
        return self._value("energy", self.functions[0], eps, eps.shape[:-1])

    def stress(self, eps: Array) -> Array:
        """Stress (..., 6): the given gradient, or the complex step through the energy."""
        if np.iscomplexobj(eps):
            change = (self.tangent(eps.real) @ eps.imag[..., None])[..., 0]
            return self.stress(eps.real) + 1j * change
        energy, gradient, _ = self.functions
        if gradient is not None:
            return self._value("gradient", gradient, eps, eps.shape)
        return self._complex("energy", energy, eps, eps.shape)

    def beside(self, mean: Array, d: Array) -> tuple[Array, Array]:
        """Stress of the mean strain, slopes of W beside it; by complex steps without a gradient."""
        energy, gradient, _ = self.functions
        if gradient is not None or np.iscomplexobj(mean):
            return super().beside(mean, d)
        m = len(self._ones)
        moved = np.empty((*d.shape[:-1], m + 2, m), complex)
        moved[..., :m, :] = mean[..., None, :] + self._moves
        along = STEP * 1j * d
        step = GAUSS[0] * d
        moved[..., m, :], moved[..., m + 1, :] = mean - step + along, mean + step + along
        found = self._value("energy", energy, moved, moved.shape[:-1]).imag
        return found[..., :m] / self._steps, (found[..., m] + found[..., m + 1]) / STEP

    def tangent(self, eps: Array) -> Array:
        """Second derivative (..., 6, 6), given or made; made from the gradient it is symmetric."""
        shape = (*eps.shape, eps.shape[-1])
        energy, gradient, hessian = self.functions
        if hessian is not None:
            return self._value("hessian", hessian, eps, shape)
        if gradient is None:
            return self._from_energy(energy, eps)
        if self.complex_step:
            out = self._complex("gradient", gradient, eps, shape)
        else:
            out = difference(self.stress, eps, DIFFERENCE * self.scale)
        return 0.5 * (out + out.swapaxes(-1, -2))

    def _from_energy(self, energy: StrainFunction, eps: Array) -> Array:
        """Second derivative: complex steps of differences, each pair once."""
        steps = self._steps
        moves = DIFFERENCE * self.scale
        m = len(moves)
        a, b = np.triu_indices(m)  # each pair once
        by = moves[a, None] * np.eye(m)[a]
        moved = eps[..., None, None, :] + (np.array([by, -by, 2 * by, -2 * by]) + self._moves[b])
        found = self._value("energy", energy, moved, moved.shape[:-1]).imag / steps[b]
        near = found[..., 0, :] - found[..., 1, :]
        far = found[..., 2, :] - found[..., 3, :]
        out = np.empty((*eps.shape, m))
        out[..., a, b] = out[..., b, a] = (8 * near - far) / (12 * moves[a])
        return out

    def _complex(
        self, name: str, function: StrainFunction, eps: Array, shape: tuple[int, ...]
    ) -> Array:
        """Derivative by the complex step; its index comes last but for those of the value."""
        steps = self._steps
        moved = eps[..., None, :] + self._moves
        found = self._value(name, function, moved, (*eps.shape, *shape[eps.ndim :]))
        return found.imag / steps.reshape(-1, *(1,) * (found.ndim - eps.ndim))

    def _value(
        self, name: str, function: StrainFunction, eps: Array, shape: tuple[int, ...]
    ) -> Array:
        """A user's function: it cannot change its argument, and returns what it should."""
        given = np.array(eps)
        given.flags.writeable = False
        with np.errstate(all="ignore"):  # what is not finite is named, or given up by the solver
            try:
                out = np.array(function(given))
            except InputError:
                raise
            except Exception as error:
                what = f"{name} of {eps.dtype} strains {eps.shape} (which it must not change)"
                raise failed(ITEM, what, error) from error
        kind = "f"
        hint = "real numbers"
        if np.iscomplexobj(eps):
            kind = "c"
            hint = "complex numbers; give its derivative if it takes real ones only"
        if out.shape != shape or out.dtype.kind != kind:
            raise InputError(
                ITEM,
                f"{name} of {eps.dtype} strains {eps.shape} is {out.dtype} of shape {out.shape},"
                f" expected shape {shape} of {hint}",
            )
        return out


def difference(function: StrainFunction, eps: Array, steps: Floats) -> Array:
    """Derivative by differences of fourth order with steps (m,); its index follows the stack's."""
    by = np.diag(steps)
    near, far = (
        function(eps[..., None, :] + k * by) - function(eps[..., None, :] - k * by) for k in (1, 2)
    )
    return (8 * near - far) / (12 * steps.reshape(-1, *(1,) * (near.ndim - eps.ndim)))


# -- functions of the strains of one point that numba, not imported here, has compiled -------------


class CompiledFunction:
    """A compiled function of strains (6,) as one of strains (..., 6), and for compiled kernels.

    Parameters
    ----------
    function : numba dispatcher
        Strains (6,), real or complex, to a number or an array of this shape.
    shape : tuple of int
    """

    def __init__(self, function: Any, shape: tuple[int, ...]):
        self.function = function
        self.shape = shape

    def __call__(self, eps: Array) -> Array:
        """Values (..., *shape) at strains (..., 6).

        Raises
        ------
        TypeError
            If numba cannot compile the function for such numbers.
        ValueError
            If it gives arrays of another shape.
        """
        from numba.core.errors import NumbaError

        given = np.array(eps, complex if np.iscomplexobj(eps) else float, order="C")
        rows = given.reshape(-1, 6)
        out = np.empty((len(rows), int(np.prod(self.shape))), given.dtype)
        try:
            found = np.shape(self.function(rows[0].copy())) if len(rows) else self.shape
            if found != self.shape:
                text = f"compiled by numba, it gives {found} for the strains (6,) of one point"
                raise ValueError(f"{text}, expected {self.shape}")
            self._each(rows, out, len(rows))
        except (NumbaError, NotImplementedError) as error:
            text = f"numba cannot compile it for {given.dtype} strains (6,) of one point"
            why = [line.strip() for line in str(error).splitlines() if line.strip()]
            raise TypeError(f"{text}: {' '.join(why[:2])}") from error
        return out.reshape((*given.shape[:-1], *self.shape))

    def address(self, kind: type) -> int:
        """Address of ``f(strains (k, 6), values (k, size), k)`` for kernels, of real or complex."""
        from numba import types

        rows = types.Array(types.complex128 if kind is complex else types.float64, 2, "C")
        self._each.compile((rows, rows, types.int64))
        made = self._each.overloads[rows, rows, types.int64]
        return int(made.library.get_pointer_to_function(made.fndesc.llvm_func_name))

    @cached_property
    def _each(self) -> Any:
        """The function of a stack of points, values in rows."""
        from numba import njit

        function = self.function
        order = len(self.shape)

        def each(eps: Any, out: Any, count: int) -> float:
            for k in range(count):
                value = function(eps[k])
                if order == 0:
                    out[k, 0] = value
                elif order == 1:
                    for i in range(6):
                        out[k, i] = value[i]
                else:
                    for i in range(6):
                        for j in range(6):
                            out[k, 6 * i + j] = value[i, j]
            return 0.0

        return njit(each, error_model="numpy")

    def __reduce__(self) -> Any:
        """Without what is compiled here."""
        return CompiledFunction, (self.function, self.shape)


def of_points(function: StrainFunction, shape: tuple[int, ...]) -> StrainFunction:
    """A user's function as one of stacks: as it is, unless numba has compiled it."""
    numba = sys.modules.get("numba")
    if numba is None or not isinstance(function, numba.core.registry.CPUDispatcher):
        return function
    return CompiledFunction(function, shape)
