"""Laws and potentials of a user's own functions, for force elements that share them."""

from __future__ import annotations

import cmath
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..coupling import Coupling
from ..errors import InputError, failed
from ..law import LawStored
from ..types import Array, Floats

#: of the complex step, relative to the size of what is changed
TINY = 1e-20
#: of differences, relative to the extent of the scene
SMALL = 1e-6


class OwnLaw:
    """Law of couplings (c, m) of coordinates x; see :class:`skfem_cosserat.Force`.

    Forces are in the sense of an internal one, against a larger x. Complex numbers, as the
    complex step has them, are taken to first order in their imaginary part.

    Parameters
    ----------
    members : sequence of Coupling
        Of the same functions.
    length : float
        Extent of the scene (m).

    Attributes
    ----------
    force_of_load : bool
        Whether there is no potential.
    """

    def __init__(self, members: Sequence[Coupling], length: float) -> None:
        own: Any = members[0]
        self.own, self.length, self.m = own, length, own.size
        self.label = getattr(own, "whole", own).label
        self.force_of_load = own.energy is None
        if own.energy is not None:
            gradient = None if own.derivative is None else self._gradients
            given = self._energies, gradient, None, np.eye(self.m)
            self._stored, self._plain = (LawStored(*given, by, size=length) for by in (True, False))

    # -- the user's functions ----------------------------------------------------------------------

    def _called(
        self, name: str, rows: Sequence[Array], t: float | None, count: int = 1
    ) -> list[list[Array]]:
        """Values of a function at rows (n, m) of each given array, `count` of each call."""
        function, last = getattr(self.own, name), () if t is None else (t,)
        shaped = [each.reshape(len(each), *self.own.shape).copy() for each in rows]
        calls = [shaped] if self.own.each else list(zip(*shaped, strict=True))
        try:
            found = (function(*call, *last) for call in calls)  # may give one array again
            return [[np.array(each) for each in (one if count > 1 else (one,))] for one in found]
        except Exception as error:
            real = not any(map(np.iscomplexobj, rows))
            where = "" if real else " at complex numbers, with which its slopes are found,"
            raise failed(self.label, f"its {name}{where}", error, t) from error

    def _rows(
        self,
        name: str,
        shape: tuple[int, ...],
        rows: Sequence[Array],
        t: float | None,
        count: int = 1,
    ) -> list[Array]:
        """Values (n, *shape) of a function, checked; `count` of them."""
        n, real = len(rows[0]), not any(map(np.iscomplexobj, rows))
        wanted = (n, *shape) if self.own.each else shape
        at = "" if t is None else f", at t = {t:.9g} s"
        found = self._called(name, rows, t, count)
        for each in (value for one in found for value in one):
            if each.shape != wanted or each.dtype.kind not in ("iuf" if real else "iufc"):
                kind = f"{name} gives an array {each.shape} of {each.dtype}"
                text = f"{kind}, expected {wanted} {'real ' * real}numbers{at}"
                raise InputError(self.label, text)
            # the sum first: it takes a third of the time
            if not (cmath.isfinite(np.add.reduce(each, None)) or np.isfinite(each).all()):
                k = int(np.argmin(np.isfinite(each.reshape(n, -1)).all(1))) if self.own.each else 0
                value, own = (each[k], self.own.where(k)) if self.own.each else (each, "")
                given = (f"{v} = {x[k].tolist()}" for v, x in zip("xv", rows, strict=False))
                text = f"{name}{own} is {value.tolist()}, not finite{at}: {', '.join(given)}"
                raise InputError(self.label, text)
        if any(len(one) != count for one in found):
            raise InputError(
                self.label, f"{name} gives {len(found[0])} arrays, expected {count}{at}"
            )
        return [np.array([one[k] for one in found]).reshape(n, *shape) for k in range(count)]

    def _energies(self, e: Array) -> Array:
        (found,) = self._rows("energy", (), [e.reshape(-1, self.m)], None)
        return found.reshape(e.shape[:-1])

    def _gradients(self, e: Array) -> Array:
        (found,) = self._rows("derivative", self.own.shape, [e.reshape(-1, self.m)], None)
        return found.reshape(e.shape)

    def _law(self, e: Array, rate: Array, t: float) -> Array:
        """Forces (n, m) of the law at rows (n, m)."""
        return self._rows("law", self.own.shape, [e, rate], t)[0].reshape(e.shape)

    def slopes(self, e: Floats, rate: Floats, t: float) -> tuple[Floats, Floats]:
        """Derivatives (c, m, m) of the law by e and rate, both (c, m)."""
        c, m = e.shape
        if self.own.derivative is not None:
            by_x, by_v = self._rows("derivative", 2 * self.own.shape, [e, rate], t, 2)
            return by_x.reshape(c, m, m), by_v.reshape(c, m, m)
        moved = np.concatenate([e, rate], axis=1)[:, None] + 1j * TINY * np.eye(2 * m)
        rows = moved.reshape(-1, 2 * m)
        found = self._law(rows[:, :m], rows[:, m:], t).imag / TINY
        both = found.reshape(c, 2 * m, m).swapaxes(1, 2)
        return both[..., :m], both[..., m:]

    # -- what groups ask for -----------------------------------------------------------------------

    def energy(self, e: Array) -> Array:
        """Potential (..., c) of coordinates (..., c, m)."""
        if self.force_of_load:
            return np.zeros(e.shape[:-1])
        return np.moveaxis(self._stored.energy(np.moveaxis(e, -2, 0)), 0, -1)

    def force(self, e: Array, rate: Array, t: float = 0.0) -> Array:
        """Force (..., c, m) against a larger x, of one configuration.

        Where there are more axes, as in complex steps, only imaginary parts differ along them.
        """
        at, by_e = _one(e)
        rates, by_rate = _one(rate)
        if not self.force_of_load:
            force = self._stored.stress(at)
            return force if by_e is None else force + 1j * apply(self._stored.tangent(at), by_e)
        force = -self._law(at, rates, t)
        if by_e is None and by_rate is None:
            return force
        slopes = zip(self.slopes(at, rates, t), (by_e, by_rate), strict=True)
        return force - 1j * sum(apply(K, by) for K, by in slopes if by is not None)

    def discrete(
        self, e0: Array, e1: Array, h: float, t: float, decay: float = 0.0
    ) -> tuple[Array, Array, Array]:
        """Discrete derivative of the potential, or the law of the mean; nothing is dissipated."""
        none = np.zeros(e1.shape[:-1])
        if self.force_of_load:
            return self.force(0.5 * (e0 + e1), (e1 - e0) / h, t), none, none
        end, by_end = _one(e1)
        sigma = self._stored.discrete(e0, end)
        if by_end is not None:
            sigma = sigma + 1j * apply(self._stored.discrete_tangent(e0, end), by_end)
        return sigma, none, none

    def midpoint(
        self, e: Array, rate: Array, e0: Array, e1: Array, h: float, t: float
    ) -> tuple[Array, Array]:
        """Force at the midpoint configuration; nothing is dissipated."""
        return self.force(e, rate, t), np.zeros(e.shape[:-1])

    def stiffness(self, e: Array, taut: bool) -> Array:
        """Derivative (c, m, m) of the force by the coordinates, at rest at t = 0."""
        if not self.force_of_load:
            return self._stored.tangent(e)
        return -self.slopes(e, np.zeros_like(e), 0.0)[0]

    def damping(self, e: Array, taut: bool) -> Array:
        """Derivative (c, m, m) of the force by the rates, likewise."""
        if not self.force_of_load:
            return np.zeros((*e.shape, self.m))
        return -self.slopes(e, np.zeros_like(e), 0.0)[1]

    # -- a check before a run ----------------------------------------------------------------------

    def check(self, e: Floats) -> None:
        """Compare derivatives with differences near coordinates (c, m), in motion.

        A kink may be at one configuration, but hardly at both that are looked at.

        Raises
        ------
        InputError
            If they differ at both.
        """
        apart = None not in (self.own.energy, self.own.derivative)
        rng, off = np.random.default_rng(0), np.inf
        for _ in range(2):
            x = e + 1e-2 * self.length * rng.standard_normal(e.shape)
            off = min(off, self._error(x, rng.standard_normal(e.shape)))
            apart = apart and self._apart(x)
        if apart:
            self._stored = self._plain
        if off <= 1e-3:
            return
        remedy = "give the right one"
        if self.own.derivative is None:
            name = "energy" if self.own.law is None else "law"
            remedy = (
                f"make the {name} of what can be differentiated, np.sqrt((v * v).sum()) instead of"
                " abs or np.linalg.norm, or give the derivative"
            )
        text = f"its derivatives differ from differences by a share of {off:.3g}: {remedy}"
        raise InputError(self.label, text)

    def _apart(self, x: Floats) -> bool:
        """Whether complex steps fail with a gradient, or give other slopes than differences."""
        try:
            return not np.allclose(self._stored.tangent(x), self._plain.tangent(x), 1e-3)
        except InputError:
            return True

    def _error(self, x: Floats, v: Floats) -> float:
        """Largest difference of derivatives, relative to the largest of its kind."""
        if not self.force_of_load:

            def values(x: Floats, v: Floats) -> Floats:
                return self._stored.energy(x)[..., None]

            given = [self._stored.stress(x)[:, None, :]]
        else:

            def values(x: Floats, v: Floats) -> Floats:
                return self._law(x, v, 0.0)

            values(x, v)  # what is wrong with it is said before complex numbers come
            given = list(self.slopes(x, v, 0.0))
        worst = 0.0
        for kind, slopes in enumerate(given):
            scale = (max(self.length, 1e-3 * float(abs(x).max())), max(1.0, float(abs(v).max())))[
                kind
            ]
            step, other = SMALL * scale, np.empty_like(slopes)
            for j in range(self.m):
                ends = []
                for sign in (1, -1):
                    moved = [x.copy(), v.copy()]
                    moved[kind][:, j] += sign * step
                    ends.append(values(*moved))
                other[..., j] = (ends[0] - ends[1]) / (2 * step)
            rounding = 1e-14 * float(abs(values(x, v)).max()) / step
            gap = float((abs(slopes - other).max() - rounding).clip(0.0))
            worst = max(worst, gap / (float(abs(other).max()) + rounding + 1e-300))
        return worst


def _one(x: Array) -> tuple[Floats, Array | None]:
    """Coordinates (c, m) of the one configuration of (..., c, m), and all imaginary parts."""
    first = x[(0,) * (x.ndim - 2)]
    return np.ascontiguousarray(first.real), x.imag if np.iscomplexobj(x) else None


def apply(matrices: Array, vectors: Array) -> Array:
    """Product of stacks ``(..., m, k)`` and ``(..., k)``.

    Examples
    --------
    >>> apply(np.array([[[0.0, 2.0]], [[1.0, 1.0]]]), np.array([[3.0, 4.0], [5.0, 6.0]])).tolist()
    [[8.0], [11.0]]
    """
    return np.asarray((matrices @ vectors[..., None])[..., 0])
