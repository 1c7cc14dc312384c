"""What to do about an error: which elements to halve, which orders to raise."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from ..types import Floats, IndexArray, numbers

__all__ = ["Change", "Halve", "HalveOrRaise", "Outlook", "Strategy", "Uniform"]

#: part of an element's share that one order more leaves at least: decays are guesses
LEAST = 1e-3


@dataclass(frozen=True, eq=False)
class Outlook:
    """What a strategy decides by; all mappings by the names of meshes.

    Attributes
    ----------
    shares : mapping of str to (ne,) array
        Magnitudes of the elements' shares in the error.
    decays : mapping of str to (ne,) array
        Part of them that elements of one order more are expected to leave.
    orders : mapping of str to int
    highest : int
        Highest order allowed.
    aim : float
        Part of the sum of all shares that may remain.
    """

    shares: Mapping[str, Floats]
    decays: Mapping[str, Floats]
    orders: Mapping[str, int]
    highest: int
    aim: float

    @property
    def total(self) -> float:
        """Sum of all shares."""
        return sum(float(s.sum()) for s in self.shares.values())


@dataclass(frozen=True, eq=False)
class Change:
    """What to do: elements to halve, and orders, by the names of meshes."""

    marked: Mapping[str, IndexArray]
    orders: Mapping[str, int]

    def __str__(self) -> str:
        count = sum(len(m) for m in self.marked.values())
        orders = sorted(set(self.orders.values()))
        return f"halved {count}" if count else f"order {', '.join(map(str, orders))}"


class Strategy(ABC):
    """A choice of what to do about an error."""

    @abstractmethod
    def choose(self, outlook: Outlook) -> Change:
        """The next mesh and orders."""

    def rescue(self, counts: Mapping[str, int], orders: Mapping[str, int], highest: int) -> Change:
        """What to do where the problem could not be solved: all elements are halved.

        Parameters
        ----------
        counts : mapping of str to int
            Elements of each mesh.
        orders : mapping of str to int
        highest : int
        """
        return Change({k: np.arange(n) for k, n in counts.items()}, orders)


class Uniform(Strategy):
    """All elements are halved: for comparison."""

    def choose(self, outlook: Outlook) -> Change:
        """See the base class."""
        everything = {k: np.arange(len(s)) for k, s in outlook.shares.items()}
        return Change(everything, outlook.orders)


@dataclass(frozen=True)
class Halve(Strategy):
    """The elements with the largest shares are halved.

    They are as many as it takes to reach the aim, if halving an element of order p leaves
    ``2^(-2 p)`` of its share; at most so many that they have `bulk` of all shares.

    Parameters
    ----------
    bulk : float
        Above 0, at most 1.
    """

    bulk: float = 0.7

    def __post_init__(self) -> None:
        bulk = numbers("strategy", "bulk", self.bulk)
        if bulk.shape != () or not 0 < bulk <= 1:
            raise InputError("strategy", f"bulk = {self.bulk!r}, expected a number in (0, 1]")

    def choose(self, outlook: Outlook) -> Change:
        """See the base class."""
        return self._halved(outlook)[0]

    def _halved(self, outlook: Outlook) -> tuple[Change, float, float]:
        """What to halve, the part of all shares that is expected to remain, and its unknowns."""
        names = list(outlook.shares)
        shares = np.concatenate([outlook.shares[k] for k in names])
        sizes = [len(outlook.shares[k]) for k in names]
        order = np.repeat([outlook.orders[k] for k in names], sizes)
        owner = np.repeat(np.arange(len(names)), sizes)
        element = np.concatenate([np.arange(n) for n in sizes])
        gain = shares * (1 - 0.25**order)
        total = shares.sum()
        if not total > 0:
            return Uniform().choose(outlook), 0.0, float((6 * order).sum())
        ranked = np.argsort(-gain, kind="stable")
        left = 1 - np.cumsum(gain[ranked]) / total
        bulk = int(np.searchsorted(np.cumsum(shares[ranked]) / total, self.bulk * (1 - 1e-12))) + 1
        enough = np.flatnonzero(left <= outlook.aim)
        count = min(bulk, enough[0] + 1 if len(enough) else len(ranked), len(ranked))
        chosen = ranked[:count]
        marked = {k: np.sort(element[chosen[owner[chosen] == i]]) for i, k in enumerate(names)}
        change = Change(marked, outlook.orders)
        return change, float(left[count - 1]), float((6 * order[chosen]).sum())


@dataclass(frozen=True)
class HalveOrRaise(Halve):
    """The elements with the largest shares are halved, or the order of a whole mesh is raised.

    One order more is expected to leave of an element's share what the strains beyond its reach
    have of the energy that those of the degree before have: little where the solution is smooth,
    all of it where it is not. Of both, that is done which lowers the logarithm of the error by
    more for each unknown it adds; what goes below the aim does not count. Where a problem cannot be
    solved all orders are raised: elements of high order can be bent farther.
    """

    def rescue(self, counts: Mapping[str, int], orders: Mapping[str, int], highest: int) -> Change:
        """See the base class."""
        if min(orders.values()) >= highest:
            return super().rescue(counts, orders, highest)
        nothing = {k: np.zeros(0, dtype=np.int64) for k in counts}
        return Change(nothing, {k: min(p + 1, highest) for k, p in orders.items()})

    def choose(self, outlook: Outlook) -> Change:
        """See the base class."""
        best, left, cost = self._halved(outlook)
        worth = _worth(left, outlook.aim, cost)
        total = outlook.total
        for name, shares in outlook.shares.items():
            if outlook.orders[name] >= outlook.highest or not total > 0:
                continue
            kept = np.clip(outlook.decays[name], LEAST, 1.0)
            left = 1 - float((shares * (1 - kept)).sum()) / total
            value = _worth(left, outlook.aim, 6.0 * len(shares))
            if value > worth:
                worth = value
                orders = {**outlook.orders, name: outlook.orders[name] + 1}
                best = Change({k: np.zeros(0, dtype=np.int64) for k in outlook.shares}, orders)
        return best


def _worth(left: float, aim: float, cost: float) -> float:
    """How much the logarithm of the error falls for each unknown."""
    return float(-np.log(min(max(left, aim, 1e-12), 1.0)) / cost)
