"""Orders of convergence: observed, doubted, and what they say about the errors themselves."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import brentq
from scipy.special import exprel

from ..arguments import checked
from ..types import Array, Floats

#: rounding of a quantity relative to its size, unless declared
ROUNDING = 64 * float(np.finfo(float).eps)
#: an error counts if it is so many times above rounding
ABOVE = 100.0
#: levels that it takes to trust an order; all but one of them give it
LEVELS = 4
#: largest change of the order between the last pairs of levels, as if each level halved the size;
#: relative to order 2 for higher ones
CHANGE = 0.1
#: cosine between errors (or differences) of neighbouring levels that point the same way
ALIGNED = 0.9
#: what falls less than this from level to level, below STALLED_SIZE of the quantity, is rounding
STALLED, STALLED_SIZE = 0.7, 1e-8
COUNTS = {4: "four", 5: "five", 6: "six", 7: "seven", 8: "eight", 9: "nine", 10: "ten"}

Norm = Callable[[Array], float]


def euclidean(difference: Array) -> float:
    """Euclidean norm of all entries."""
    return float(np.linalg.norm(difference))


class Convergence(NamedTuple):
    """Convergence of a quantity over the levels of a series; failed levels have NaN.

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
    observed : (n,)
        Orders between neighbours, each at the finest level that it rests on: of the errors against
        a reference, of the differences between levels without one. NaN for levels without, such as
        those at rounding.
    order, spread : float
        Order of the last pair above rounding, and how far to trust it: twice the change of the
        order from the pair before, and what rounding may do to it. NaN if not asymptotic.
    verdict : str
        The order in words, or why there is none.
    extrapolated : array or None
        Richardson's value for size zero; None where the levels do not bear it.
    uncertainty : float
        Of `extrapolated`, in the norm of the study: what an order changes that is off by its
        spread, or that is the next whole number, and what the level before says.
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
    observed: Floats
    order: float
    spread: float
    verdict: str
    extrapolated: Array | None
    uncertainty: float
    rounding: float

    @property
    def asymptotic(self) -> bool:
        """True if errors fall as a power of the size, as far as the levels tell."""
        return bool(np.isfinite(self.order))

    def __repr__(self) -> str:
        return f"<Convergence: {self.verdict}>"


@checked
def convergence(
    sizes: Sequence[float] | Floats,
    values: Sequence[Array | None],
    norm: Norm = euclidean,
    reference: Array | None = None,
    rounding: float = ROUNDING,
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
        Take the last level that there is for the reference. Orders are of the differences then.

    Returns
    -------
    Convergence
    """
    good = [k for k, each in enumerate(values) if each is not None and np.isfinite(each).all()]
    chosen = [np.asarray(values[k]) for k in good]
    every = np.asarray(sizes, float)
    exact = None if finest else reference
    scale = max([norm(each) for each in (*chosen, exact) if each is not None], default=0.0)
    rest = (every[good], chosen, norm, scale)
    floor = rounding * scale
    trend = None if exact is None else _Trend(exact, floor, *rest)
    among = _Trend(None, trend.floor if trend else floor, *rest)
    limit, uncertainty = _extrapolated(every[good], chosen, among, norm)
    truth = limit
    doubt = uncertainty
    if trend is not None:
        truth = exact
        doubt = trend.floor
    elif finest and chosen:
        truth = chosen[-1]
        doubt = np.nan if limit is None else norm(limit - chosen[-1])
    trend = trend or among
    verdict = trend.verdict
    if np.isnan(trend.order) and limit is not None:
        verdict += f"; the levels converge (order {among.order:.2f}) to a value"
        verdict += f" {norm(limit - truth):.2g} from the reference"
    if truth is None or np.isnan(doubt):  # hints
        finer = [[norm(a - b) for b in chosen[k:]] for k, a in enumerate(chosen, 1)]
        errors = [max(each, default=np.nan) for each in finer]
    else:
        errors = [norm(each - truth) for each in chosen]

    def by_level(numbers: object, levels: list[int]) -> Floats:
        found = np.full(len(every), np.nan)
        found[levels] = numbers
        return found

    first = 1 + trend.between
    return Convergence(
        sizes=every,
        errors=by_level(errors, good),
        uncertainties=by_level(doubt, good),
        differences=by_level(among.sizes, good[:-1]),
        observed=by_level(trend.pairs, good[first : first + len(trend.pairs)]),
        order=trend.order,
        spread=trend.spread,
        verdict=verdict,
        extrapolated=limit,
        uncertainty=uncertainty,
        rounding=trend.floor,
    )


def left(change: Any, order: float, ratio: float = 2.0) -> Any:
    """Change that is left from the finer of two sizes to size zero (Richardson).

    Parameters
    ----------
    change : float or array
        Of the value, or of its norm, from the coarser size to the finer one.
    order : float
        Of the errors.
    ratio : float
        Of the coarser size to the finer one.

    Examples
    --------
    >>> print(round(left(0.3, order=2.0), 12))  # 1.4 at size 2, 1.1 at size 1: 1 at size zero
    0.1
    """
    return change / np.expm1(order * np.log(ratio))


def _extrapolated(
    h: Floats, values: list[Array], trend: _Trend, norm: Norm
) -> tuple[Array | None, float]:
    """Value for size zero with its uncertainty, if the differences between levels bear one."""
    if np.isnan(trend.order) or trend.cosine < ALIGNED:
        return None, np.nan

    def at_zero(n: int, p: float) -> Array:
        """Richardson's value from levels n - 1 and n with order p."""
        return values[n] + left(values[n] - values[n - 1], p, h[n - 1] / h[n])

    n, (before, p) = trend.used, trend.pairs[-2:]
    value = at_zero(n, p)
    # orders of methods are whole numbers: two pairs that agree on another one do so by chance
    doubt = max(trend.spread, abs(p - round(p)))
    others = [at_zero(n - 1, before), at_zero(n, max(p - doubt, p / 2))]
    if n < len(values) - 1:  # finer levels differ by rounding only
        value = values[-1]
        others = values[n:]
    return value, max(trend.floor, *(norm(value - each) for each in others))


# -- a sequence of errors or differences ----------------------------------------------------------


class _Trend:
    """Errors whose k-th is C h_k^p, or differences between levels, with the order p of both.

    Without a true value each level is compared with the next finer one.
    """

    def __init__(
        self,
        exact: Array | None,
        floor: float,
        h: Floats,
        values: list[Array],
        norm: Norm,
        scale: float,
    ):
        self.between, self.h, self.scale, g = exact is None, h, scale, np.zeros(len(h))
        if exact is None:
            self.vectors, self.h, g = [b - a for a, b in pairwise(values)], h[:-1], h[1:]
        else:
            self.vectors = [value - exact for value in values]
        self.sizes = e = np.array([*map(norm, self.vectors)])
        stalled = (e[1:] > STALLED * e[:-1]) & (e[1:] < STALLED_SIZE * scale)
        self.floor = float(max(floor, e[1:][stalled].max(initial=0.0)))
        above = e > ABOVE * self.floor
        self.used = int(np.argmin([*above, False]))
        self.again = above.sum() > self.used
        pairs = (slice(k, k + 2) for k in range(self.used - 1))
        self.pairs = np.array([_order(e[two], h[two], g[two]) for two in pairs])
        what = "differences between levels" if self.between else "errors"
        self.counted = f"{above.sum()} of {len(e)} {what} above 100 x rounding"
        last = self.vectors[max(self.used - LEVELS, 0) : self.used]
        self.cosine = float(np.min([_cosine(a, b) for a, b in pairwise(last)], initial=np.inf))
        self.order = self.spread = np.nan
        self.verdict = self._judged(len(e) + self.between)

    def _judged(self, levels: int) -> str:
        """The order, which is set with its spread, or why there is none, in words."""
        pairs = self.pairs
        if self.between and levels > 1 and not self.sizes.any():
            return "no order: all levels are identical, nothing depends on their size"
        shown = ", ".join(f"{p:.2f}" for p in pairs[-4:])
        seen = f": pairwise order{'s' * (len(pairs) > 1)} {shown}" if len(pairs) else ""
        if levels < LEVELS:
            return "fewer than four levels" + seen
        if self.used + self.between < LEVELS and not self.again:
            return f"at rounding: no order ({self.counted})"
        wandering = f"not in the asymptotic range{seen}"
        part = self.sizes[self.used - 1] / self.scale if self.used else 1.0
        if part <= STALLED_SIZE:
            wandering += f" (down to {part:.1e} of the value: if that is rounding, declare it)"
        if self.again or not np.isfinite(pairs).all() or pairs[-1] <= 0:
            return wandering
        logs = np.log2(self.h[: self.used])
        halvings = (logs[:-2] - logs[2:]) / 2
        changes = (abs(np.diff(pairs)) / np.minimum(halvings, 1.0))[2 - LEVELS :]
        order = pairs[-1]
        allowed = CHANGE * max(1.0, order / 2)
        # before the last pair the order may still have been settling
        if order < 3 * allowed or changes[-1] > allowed or changes.max() > 4 * allowed:
            return wandering
        if self.vectors[0].size == 1 and self.cosine < 0:
            return f"{wandering}; the sign of the error changes"
        if self.between and len(pairs) < LEVELS - 1 and self.cosine < ALIGNED:
            turning = "differences between levels do not point the same way"
            return f"{wandering}; {turning}, which takes five levels"
        noise = self.floor / self.sizes[self.used - 1] / np.log(self.h[-2] / self.h[-1])
        # changes that halve from pair to pair add up to one more
        self.order = float(order)
        self.spread = float(2 * changes[-1] + noise)
        some = "" if self.used == len(self.sizes) else f", {self.counted}"
        return (
            f"order {order:.2f} +- {max(self.spread, 0.005):.2f}"
            f" (three finest of {COUNTS.get(levels, levels)} levels{some})"
        )


def _order(e: Floats, h: Floats, g: Floats) -> float:
    """Order p of two differences that are as h^p - g^p, or of two errors (g is zero)."""
    ratio = np.log(e[0] / e[1])
    if not g.any():
        return ratio / np.log(h[0] / h[1])
    logs = np.log(h / g)

    def excess(p: float) -> float:
        powers = p * np.log(g) + np.log(logs * exprel(p * logs))  # log((h^p - g^p)/p)
        return powers[0] - powers[1] - ratio

    lowest = -6.0
    highest = 30.0
    if excess(lowest) * excess(highest) > 0:
        return np.copysign(np.inf, -excess(lowest))
    return brentq(excess, lowest, highest, xtol=1e-12)


def _cosine(a: Array, b: Array) -> float:
    return float(np.real(np.vdot(a, b)) / (np.linalg.norm(a) * np.linalg.norm(b)))
