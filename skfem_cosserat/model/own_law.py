"""Laws and potentials of a user's own functions, for force elements that share them."""

from __future__ import annotations

import cmath
from collections.abc import Sequence
from copy import copy
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
#: most iterations for a memory
MOST = 30


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
        self._whole: Any = own.whole
        self.label = self._whole.label
        self.force_of_load = own.energy is None
        self._half = 0.0
        self._before: Floats | None = None
        #: of a law that is sampled: its period (s), and where its memory has the next instant
        self.period, self.due = own.period, self.m
        self._memory: Floats = np.array([each.memory.ravel() for each in members])
        if own.energy is not None:
            gradient = None if own.derivative is None else self._gradients
            given = self._energies, gradient, None, np.eye(self.m)
            by_complex = not getattr(self._whole, "_real", False)
            self._stored = LawStored(*given, by_complex, size=length)
            self._plain = LawStored(*given, False, size=length)

    # -- memory ------------------------------------------------------------------------------------

    def within(self, memory: Floats, half: float = 0.0, before: Floats | None = None) -> OwnLaw:
        """The law in a step that starts with a memory.

        Parameters
        ----------
        memory : (c, k) array
        half : float
            Half of the step (s); 0: at rest, the memory stays.
        before : (c, m) array, optional
            Coordinates at its start; forces are those of its end then, else of its middle.
        """
        other = copy(self)
        other._memory, other._half, other._before = memory, half, before
        return other

    def remembered(self, e0: Array, e1: Array, t: float) -> Array:
        """Memory (n, k) at the end of a step from e0 to e1 (n, m); t: when the law is taken."""
        start = self._at_start(len(e1))
        if not self._half:
            return start
        middle = t if self._before is None else t - self._half
        return 2 * self._middle(0.5 * (e0 + e1), (e1 - e0) / (2 * self._half), middle) - start

    def _at_start(self, n: int) -> Floats:
        """Memory (n, k) at the start of a step, for n rows of coordinates."""
        return np.repeat(self._memory, n // len(self._memory), axis=0)

    def _middle(self, x: Array, v: Array, t: float) -> Array:
        """Memory (n, k) in the middle of a step, by the midpoint rule, for rows (n, m) there."""
        n, k = len(x), self._memory.shape[1]
        start = self._at_start(n)
        z: Array = start
        if not self._half or self.period:
            return z
        # all rows, then complex steps of the memory of each
        steps = 1j * TINY * np.tile(np.eye(k), (n, 1))
        given = [np.concatenate([each, each.real.repeat(k, axis=0)]) for each in (x, v)]
        for _ in range(MOST):
            moved = np.concatenate([z, z.real.repeat(k, axis=0) + steps])
            rate = self._with_memory([*given, moved], t)[1].reshape(-1, k)
            by_z = self._half * rate[n:].imag.reshape(n, k, k).swapaxes(1, 2) / TINY
            change: Array = start + self._half * rate[:n] - z
            done = not by_z.any()
            if not done:
                change = np.linalg.solve(np.eye(k) - by_z, change[..., None])[..., 0]
                done = abs(change).max() <= 1e-12 * (abs(z).max() + abs(start).max())
            z = z + change
            if done:
                return z if np.iscomplexobj(x) or np.iscomplexobj(v) else z.real
        text = f"its memory has no value at the end of a step of {2 * self._half:g} s"
        raise InputError(self.label, f"{text} at t = {t:.9g} s: take a shorter one")

    def _with_memory(self, rows: Sequence[Array], t: float) -> list[Array]:
        """Forces and rates of the memory at rows of coordinates, rates and memories."""
        return self._rows("law", [self.own.shape, self.own.memory.shape], rows, t)

    def sampled(self, x: Floats, v: Floats, memory: Floats, t: float) -> Floats:
        """Memory (c, k) after the law was sampled."""
        return self._rows("controller", [self.own.memory.shape], [x, v, memory], t)[0]

    # -- the user's functions ----------------------------------------------------------------------

    def _called(
        self, name: str, rows: Sequence[Array], t: float | None, count: int
    ) -> list[list[Array]]:
        """Values of a function at rows (n, m) of each given array, `count` of each call."""
        function = getattr(self.own, "_sample" if name == "controller" else name)
        last = () if t is None else (t,)
        shapes = self.own.shape, self.own.shape, self.own.memory.shape
        pairs = zip(rows, shapes, strict=False)
        shaped = [each.reshape(len(each), *shape).copy() for each, shape in pairs]
        calls = [shaped] if self.own.each else list(zip(*shaped, strict=True))
        try:
            # may give one array again
            found = (function(*call[:2], *last, *call[2:]) for call in calls)
            return [[np.array(each) for each in (one if count > 1 else (one,))] for one in found]
        except Exception as error:
            real = not any(map(np.iscomplexobj, rows))
            where = "" if real else " at complex numbers, with which its slopes are found,"
            raise failed(self.label, f"its {name}{where}", error, t) from error

    def _rows(
        self,
        name: str,
        shapes: Sequence[tuple[int, ...]],
        rows: Sequence[Array],
        t: float | None,
    ) -> list[Array]:
        """Values (n, *shape) of a function, checked; one for each shape."""
        n, real, count = len(rows[0]), not any(map(np.iscomplexobj, rows)), len(shapes)
        at = "" if t is None else f", at t = {t:.9g} s"
        found = self._called(name, rows, t, count)
        for one in found:
            if len(one) != count:
                text = f"{name} gives {len(one)} arrays, expected {count}{at}"
                raise InputError(self.label, text)
        for each, shape in (pair for one in found for pair in zip(one, shapes, strict=True)):
            wanted = (n, *shape) if self.own.each else shape
            if each.shape != wanted or each.dtype.kind not in ("iuf" if real else "iufc"):
                kind = f"{name} gives an array {each.shape} of {each.dtype}"
                text = f"{kind}, expected {wanted} {'real ' * real}numbers{at}"
                raise InputError(self.label, text)
            # the sum first: it takes a third of the time
            if not (cmath.isfinite(np.add.reduce(each, None)) or np.isfinite(each).all()):
                k = int(np.argmin(np.isfinite(each.reshape(n, -1)).all(1))) if self.own.each else 0
                # complex steps of a place follow it
                place = self.own.where(k * len(self._memory) // n) if self.own.each else ""
                value, own = (each[k], place) if place else (each, "")
                given = (f"{v} = {x[k].tolist()}" for v, x in zip("xvz", rows, strict=False))
                text = f"{name}{own} is {value.tolist()}, not finite{at}: {', '.join(given)}"
                raise InputError(self.label, text)
        stacks = zip(zip(*found, strict=True), shapes, strict=True)
        return [np.array(values).reshape(n, *shape) for values, shape in stacks]

    def _energies(self, e: Array) -> Array:
        (found,) = self._rows("energy", [()], [e.reshape(-1, self.m)], None)
        # without complex steps it does not change: the check of derivatives tells it
        return found.reshape(e.shape[:-1]).astype(e.dtype)

    def _gradients(self, e: Array) -> Array:
        (found,) = self._rows("derivative", [self.own.shape], [e.reshape(-1, self.m)], None)
        return found.reshape(e.shape)

    def _law(self, e: Array, rate: Array, t: float) -> Array:
        """Forces (n, m) of the law at rows (n, m)."""
        if not self.own.memory.size:
            return self._rows("law", [self.own.shape], [e, rate], t)[0].reshape(e.shape)
        if self._before is None:
            z = self._middle(e, rate, t)
        else:
            before = np.repeat(self._before, len(e) // len(self._before), axis=0)
            z = self.remembered(before, e, t)
        return self._with_memory([e, rate, z], t)[0].reshape(e.shape)

    def _slopes_of_law(self, e: Floats, rate: Floats, t: float) -> tuple[Floats, Floats]:
        """Derivatives (c, m, m) of the law by e and rate, both (c, m)."""
        c, m = e.shape
        if self.own.derivative is not None:
            by_x, by_v = self._rows("derivative", [2 * self.own.shape] * 2, [e, rate], t)
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
        force = -self._law(at, rates, t) if self.force_of_load else self._stored.stress(at)
        if by_e is None and by_rate is None:
            return force
        slopes = zip(self.slopes(at, rates, t), (by_e, by_rate), strict=True)
        return force + 1j * sum(apply(K, by) for K, by in slopes if by is not None)

    def slopes(self, e: Floats, rate: Floats, t: float) -> tuple[Floats, Floats]:
        """Derivatives (c, m, m) of the force by the coordinates and by their rates."""
        if not self.force_of_load:
            by_e = self._stored.tangent(e)
            return by_e, np.zeros_like(by_e)
        by_e, by_rate = self._slopes_of_law(e, rate, t)
        return -by_e, -by_rate

    def slopes_at_rest(self, e: Floats, taut: bool) -> tuple[Floats, Floats]:
        """The same at rest at t = 0."""
        return self.slopes(e, np.zeros_like(e), 0.0)

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

    def discrete_slopes(self, e0: Floats, e1: Floats, h: float, t: float) -> Floats:
        """Derivative (c, m, m) of the discrete force by the coordinates at the end."""
        if not self.force_of_load:
            return self._stored.discrete_tangent(e0, e1)
        by_e, by_rate = self.slopes(0.5 * (e0 + e1), (e1 - e0) / h, t)
        return 0.5 * by_e + by_rate / h

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
            self._stored, self._whole._real = self._plain, True
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

        def values(x: Floats, v: Floats) -> Floats:
            return self._law(x, v, 0.0) if self.force_of_load else self._stored.energy(x)[:, None]

        if self.force_of_load:
            values(x, v)  # what is wrong with it is said before complex numbers come
            given = list(self._slopes_of_law(x, v, 0.0))
        else:
            given = [self._stored.stress(x)[:, None, :]]
        scales = max(self.length, 1e-3 * float(abs(x).max())), max(1.0, float(abs(v).max()))
        worst = 0.0
        for kind, slopes in enumerate(given):
            step, other = SMALL * scales[kind], np.empty_like(slopes)
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
