"""Orders of convergence: observed, doubted, and what they say about the errors themselves."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from scipy.optimize import brentq, minimize_scalar

from ..arguments import checked
from ..types import Array, Floats

#: rounding of a quantity relative to its size, unless declared
ROUNDING = 64 * float(np.finfo(float).eps)
#: an error counts if it is so many times above rounding
ABOVE = 100.0
#: levels that it takes to trust an order, and those that give it
LEVELS, FINEST = 4, 3
#: largest change of the order between the last pairs of levels, as if each level halved the size;
#: relative to order 2 for higher ones
CHANGE = 0.1
#: largest change before that, in units of CHANGE: the order may still have been settling
SETTLING = 4.0
#: the order may be off by so many times its last change: changes that halve from pair to pair add
#: up to one more, and a fit to three levels lies half of one behind
DOUBT = 2.0
#: cosine between errors (or differences) of neighbouring levels that point the same way
ALIGNED = 0.9
#: what falls less than this from level to level, below STALLED_SIZE of the quantity, is rounding
STALLED, STALLED_SIZE = 0.7, 1e-8
COUNTS = {4: "four", 5: "five", 6: "six", 7: "seven", 8: "eight", 9: "nine", 10: "ten"}
#: range of orders that are looked for
LOWEST, HIGHEST = -6.0, 30.0

Norm = Callable[[Array], float]


@dataclass(frozen=True, eq=False, repr=False)
class Convergence:
    """How a quantity converges over the levels of a series; failed levels have NaN.

    Attributes
    ----------
    sizes : (n,)
        Of the elements or steps, coarsest first.
    errors : (n,)
        Of each level: against the reference; without one against the extrapolated value; where
        there is none, the largest difference from a finer level, which is no more than a hint. The
        finest level has none then: NaN.
    uncertainties : (n,)
        Of `errors`: that of the extrapolated value, or the rounding; NaN where `errors` are hints.
    differences : (n,)
        Between each level and the next finer one; NaN for the finest.
    pairwise : (k,)
        Observed orders between neighbours, coarsest first: of the errors against a reference, of
        the differences between levels without one. Levels at rounding give none.
    observed : (n,)
        The same by level, each at the finest level that it rests on; NaN for levels without.
    order, spread : float
        Order of the three finest levels above rounding, and how far to trust it: twice the change
        of the order from the pair before, and what rounding may do to it. NaN if not asymptotic.
    asymptotic : bool
        Whether errors fall as a power of the size, as far as the levels tell.
    verdict : str
        The same in words, with the reason.
    extrapolated : array or None
        Richardson's value for size zero; None where the levels do not bear it.
    uncertainty : float
        Of `extrapolated`, in the norm of the study.
    rounding : float
        Below 100 times this an error says nothing about the order.

    Examples
    --------
    >>> h = 0.5 ** np.arange(5)
    >>> found = convergence(h, [np.array(1 + 0.3 * x**2 + 0.1 * x**4) for x in h])
    >>> print(found.verdict)
    order 2.03 +- 0.16 (three finest of five levels)
    >>> abs(float(found.extrapolated) - 1) < found.uncertainty < 1e-3
    True
    """

    sizes: Floats
    errors: Floats
    uncertainties: Floats
    differences: Floats
    pairwise: Floats
    observed: Floats
    order: float
    spread: float
    asymptotic: bool
    verdict: str
    extrapolated: Array | None
    uncertainty: float
    rounding: float

    def __repr__(self) -> str:
        return f"<Convergence: {self.verdict}>"


@checked
def convergence(
    sizes: Sequence[float] | Floats,
    values: Sequence[Array | None],
    norm: Norm | None = None,
    reference: Array | None = None,
    rounding: float | None = None,
    finest: bool = False,
) -> Convergence:
    """Judge the values of a quantity on a sequence of levels.

    Parameters
    ----------
    sizes : (n,)
        Of the elements or steps; falling.
    values : sequence of arrays or None
        Of one shape; None for levels that failed.
    norm : callable, optional
        From a difference to a number. Default: the Euclidean norm.
    reference : array, optional
        The true value.
    rounding : float, optional
        Relative to the largest value. Default: 64 times the machine precision; and whatever stops
        falling below 1e-8 is taken for rounding in any case.
    finest : bool
        Take the last level that there is for the reference instead. Orders allow for its own error.

    Returns
    -------
    Convergence
    """
    norm = euclidean if norm is None else norm
    h = np.asarray(sizes, dtype=float)
    good = [k for k, value in enumerate(values) if value is not None]
    chosen = [np.asarray(values[k]) for k in good]
    scale = max([norm(value) for value in chosen], default=0.0)
    relative = ROUNDING if rounding is None else rounding
    if finest and len(good) > 1:
        judged = good[:-1]
        exact: Array | None = chosen[-1]
        smallest = np.full(len(judged), h[good[-1]])
    else:
        judged, exact = good, reference
        smallest = np.zeros(len(good))
    if exact is None:
        alone = _differences(h[good], chosen, norm, relative * scale)
        return _result(h, good, chosen, norm, alone, alone, None)
    size = max(scale, norm(exact))
    offsets = [value - exact for value in chosen[: len(judged)]]
    trend = _Trend(h[judged], smallest, offsets, norm, relative * size, scale=size)
    among = _differences(h[good], chosen, norm, trend.floor)
    return _result(h, good, chosen, norm, among, trend, exact)


def euclidean(difference: Array) -> float:
    """Euclidean norm of all entries."""
    return float(np.linalg.norm(difference))


def _differences(h: Floats, values: list[Array], norm: Norm, floor: float) -> _Trend:
    """What the levels say of each other."""
    steps = [b - a for a, b in pairwise(values)]
    scale = max([norm(value) for value in values], default=0.0)
    return _Trend(h[:-1], h[1:], steps, norm, floor, scale=scale, between=True)


# -- a sequence of errors or differences ----------------------------------------------------------


@dataclass
class _Trend:
    """Errors whose k-th is C (h_k^p - g_k^p), with the order p that is looked for.

    Against a reference g is zero, against a finest level its size, between neighbours that of the
    finer one (`between`).
    """

    h: Floats
    g: Floats
    vectors: list[Array]
    norm: Norm
    floor: float
    scale: float
    between: bool = False
    sizes: Floats = field(init=False)
    used: int = field(init=False)

    def __post_init__(self) -> None:
        self.sizes = np.array([self.norm(vector) for vector in self.vectors])
        e = self.sizes
        stalled = (e[1:] > STALLED * e[:-1]) & (e[1:] < STALLED_SIZE * self.scale)
        if stalled.any():
            self.floor = max(self.floor, float(e[1:][stalled].max()))
        above = e > ABOVE * self.floor
        self.used = len(e) if above.all() else int(np.argmin(above))
        self.again = bool(above[self.used :].any())

    @property
    def levels(self) -> int:
        """How many levels are above rounding."""
        return self.used + (self.between and self.used > 0)

    @property
    def all_levels(self) -> int:
        """How many levels there are."""
        return len(self.sizes) + self.between

    def pairwise(self) -> Floats:
        """Orders between neighbours above rounding."""
        return np.array([_pair(self, k) for k in range(self.used - 1)])

    def order(self) -> float:
        """Of the three finest levels above rounding: least squares of the logarithms."""
        last = slice(self.used - (FINEST - self.between), self.used)
        if self.between:
            return _pair(self, self.used - 2)
        e, h, g = np.log(self.sizes[last]), self.h[last], self.g[last]

        def misfit(p: float) -> float:
            return float(np.var(e - np.log(h**p - g**p)))

        pairs = [_pair(self, k) for k in range(self.used - FINEST + 1, self.used - 1)]
        low, high = max(min(pairs), 1e-3), max(*pairs, 2e-3)
        if high - low < 1e-9:
            return high
        found = minimize_scalar(misfit, bounds=(low, high), method="bounded")
        return float(found.x)

    def cosines(self) -> Floats:
        """Between the vectors of neighbours, the last three pairs above rounding."""
        chosen = self.vectors[max(self.used - LEVELS, 0) : self.used]
        return np.array([_cosine(a, b) for a, b in pairwise(chosen)])


def _pair(trend: _Trend, k: int) -> float:
    """Order p with e_k/e_k+1 = (h_k^p - g_k^p)/(h_k+1^p - g_k+1^p)."""
    ratio = np.log(trend.sizes[k] / trend.sizes[k + 1])
    (ha, hb), (ga, gb) = trend.h[k : k + 2], trend.g[k : k + 2]
    if ga == 0.0 and gb == 0.0:
        return float(ratio / np.log(ha / hb))

    def excess(p: float) -> float:
        return p * np.log(ga / gb) + _log_power(p, ha / ga) - _log_power(p, hb / gb) - ratio

    if excess(LOWEST) * excess(HIGHEST) > 0:
        return float(np.copysign(np.inf, -excess(LOWEST)))
    return float(brentq(excess, LOWEST, HIGHEST, xtol=1e-12))


def _log_power(p: float, ratio: float) -> float:
    """Logarithm of (ratio^p - 1)/p, which is that of log(ratio) for p = 0."""
    x = np.log(ratio)
    if abs(p * x) < 1e-8:
        return float(np.log(x) + p * x / 2)
    return float(np.log(np.expm1(p * x) / p))


def _cosine(a: Array, b: Array) -> float:
    product = abs(np.linalg.norm(a) * np.linalg.norm(b))
    return float(np.real(np.vdot(a, b)) / product) if product else np.nan


# -- verdict ---------------------------------------------------------------------------------------


def _judged(trend: _Trend) -> tuple[float, float, str]:
    """Order, spread, and why there is no order (empty: there is one)."""
    if trend.g.any() and trend.all_levels > 1 and not trend.sizes.any():
        return np.nan, np.nan, "no order: all levels are identical, nothing depends on their size"
    pairs = trend.pairwise()
    if trend.all_levels < LEVELS:
        return np.nan, np.nan, _with_pairs("fewer than four levels", pairs)
    if trend.levels < LEVELS and not trend.again:
        return np.nan, np.nan, f"at rounding: no order ({_above(trend)})"
    wandering = _with_pairs("not in the asymptotic range", pairs) + _small(trend)
    if trend.again:
        return np.nan, np.nan, f"{wandering}; below rounding and above it again"
    if not np.isfinite(pairs).all() or pairs[-1] <= 0:
        return np.nan, np.nan, wandering
    order = trend.order()
    changes = _changes(trend, pairs[-FINEST:])
    allowed = CHANGE * max(1.0, order / 2)
    noise = trend.floor / trend.sizes[trend.used - 1]
    spread = float(DOUBT * changes[-1] + noise / np.log(trend.h[-2] / trend.h[-1]))
    if order < 3 * allowed or changes[-1] > allowed or changes.max() > SETTLING * allowed:
        return np.nan, np.nan, wandering
    cosines = trend.cosines()
    if trend.vectors[0].size == 1 and cosines.min() < 0:
        return np.nan, np.nan, f"{wandering}; the sign of the error changes"
    if trend.between and len(pairs) < FINEST and cosines.min() < ALIGNED:
        reason = "; differences between levels do not point the same way, which takes five levels"
        return np.nan, np.nan, wandering + reason
    return order, spread, ""


def _changes(trend: _Trend, pairs: Floats) -> Floats:
    """How the order changes from pair to pair; where sizes are not halved, as if they were."""
    logs = np.log2(trend.h[: trend.used])[-len(pairs) - 1 :]
    halvings = (logs[:-2] - logs[2:]) / 2
    return np.asarray(abs(np.diff(pairs)) / np.minimum(halvings, 1.0))


def _small(trend: _Trend) -> str:
    """A hint, where what wanders may be rounding above what it was taken for."""
    relative = trend.sizes[trend.used - 1] / trend.scale if trend.used else 1.0
    if relative > STALLED_SIZE:
        return ""
    return f" (down to {relative:.1e} of the value: if that is rounding, declare it)"


def _with_pairs(text: str, pairs: Floats) -> str:
    if not len(pairs):
        return text
    shown = ", ".join(f"{p:.2g}" if abs(p) < 1 else f"{p:.3g}" for p in pairs[-4:])
    return f"{text}: pairwise order{'s' if len(pairs) > 1 else ''} {shown}"


def _above(trend: _Trend) -> str:
    what = "differences between levels" if trend.between else "errors"
    return f"{trend.used} of {len(trend.sizes)} {what} above 100 x rounding"


def _finest(trend: _Trend) -> str:
    count = COUNTS.get(trend.all_levels, trend.all_levels)
    used = f"three finest of {count} levels"
    return used if trend.used == len(trend.sizes) else f"{used}, {_above(trend)}"


# -- value and errors ------------------------------------------------------------------------------


def _extrapolated(
    h: Floats, values: list[Array], trend: _Trend, norm: Norm
) -> tuple[Array, float] | None:
    """Value for size zero with its uncertainty, if the differences between levels bear one."""
    _, spread, reason = _judged(trend)
    if reason or trend.cosines().min() < ALIGNED:
        return None
    n = trend.levels - 1
    p, before = _pair(trend, n - 2), _pair(trend, n - 3)
    value = _at_zero(h, values, n, p)
    uncertainty = norm(value - _at_zero(h, values, n - 1, before))
    # orders of methods are whole numbers: two pairs that agree on another one do so by chance
    doubt = max(spread, abs(p - round(p)))
    lower = _at_zero(h, values, n, max(p - doubt, p / 2))
    uncertainty = max(uncertainty, norm(value - lower))
    if n < len(values) - 1:  # finer levels differ by rounding only
        value = values[-1]
        uncertainty = max(norm(value - each) for each in values[n:])
    return value, max(uncertainty, trend.floor)


def _at_zero(h: Floats, values: list[Array], n: int, p: float) -> Array:
    """Richardson's value from levels n - 1 and n with order p."""
    factor = 1 / np.expm1(p * np.log(h[n - 1] / h[n]))
    return values[n] + factor * (values[n] - values[n - 1])


def _result(
    h: Floats,
    good: list[int],
    values: list[Array],
    norm: Norm,
    differences: _Trend,
    trend: _Trend,
    exact: Array | None,
) -> Convergence:
    order, spread, reason = _judged(trend)
    limit = _extrapolated(h[good], values, differences, norm)
    value, uncertainty = limit if limit is not None else (None, np.nan)
    errors, doubts = np.full(len(h), np.nan), np.full(len(h), np.nan)
    if exact is not None:
        errors[good] = [norm(each - exact) for each in values]
        known = exact is not values[-1]  # the finest level has an error of its own
        doubts[good] = trend.floor if known else _off(value, exact, norm)
    elif value is not None:
        errors[good] = [norm(each - value) for each in values]
        doubts[good] = uncertainty
    else:
        errors[good] = _hints(values, norm)
    steps = np.full(len(h), np.nan)
    steps[good[:-1]] = differences.sizes
    if reason:
        verdict = reason + _other_limit(differences, value, exact, norm)
    else:
        verdict = f"order {order:.2f} +- {max(spread, 0.005):.2f} ({_finest(trend)})"
    pairs, observed = trend.pairwise(), np.full(len(h), np.nan)
    first = 1 + trend.between
    observed[good[first : first + len(pairs)]] = pairs
    return Convergence(
        sizes=h,
        errors=errors,
        uncertainties=doubts,
        differences=steps,
        pairwise=pairs,
        observed=observed,
        order=order,
        spread=spread,
        asymptotic=not reason,
        verdict=verdict,
        extrapolated=value,
        uncertainty=uncertainty,
        rounding=trend.floor,
    )


def _hints(values: list[Array], norm: Norm) -> list[float]:
    """Largest differences from finer levels; the finest level has no hint."""
    return [*(max(norm(a - b) for b in values[k + 1 :]) for k, a in enumerate(values[:-1])), np.nan]


def _off(value: Array | None, exact: Array, norm: Norm) -> float:
    return np.nan if value is None else norm(value - exact)


def _other_limit(differences: _Trend, value: Array | None, exact: Array | None, norm: Norm) -> str:
    """A reference that the levels do not converge to, though they do converge."""
    if exact is None or value is None:
        return ""
    order, off = _judged(differences)[0], _off(value, exact, norm)
    return f"; the levels converge (order {order:.2f}) to a value {off:.2g} from the reference"
