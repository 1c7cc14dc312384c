"""Levels of elements, orders and steps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from inspect import signature
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from ..errors import InputError
from ..types import Floats, positive, switch, whole


def case_name(arguments: Mapping[str, Any]) -> str:
    """Arguments in words.

    Examples
    --------
    >>> case_name({"elements": 8, "step": 1e-3})
    'elements = 8, step = 0.001'
    """
    return ", ".join(f"{name} = {value!r}" for name, value in arguments.items())


# -- what a study varies, and the series of levels that this makes ---------------------------------


def _size(name: str, value: float) -> float:
    """Size that a step, or a number of elements, stands for."""
    return value if name == "step" else 1 / value


class Series(NamedTuple):
    """Levels that belong together, coarsest first: those of one order.

    Attributes
    ----------
    label : str
        What tells it from others, empty if there are no others.
    varied : list of str
        Names of the arguments that differ from level to level.
    levels : dict
        Arguments of the problem by the name of the level.
    """

    label: str
    varied: list[str]
    levels: dict[str, dict[str, Any]]

    @property
    def kind(self) -> str:
        """What sizes are, for the axis of a chart."""
        name = "step" if self.varied == ["step"] else "1/elements"
        return name + " (with the step)" * (len(self.varied) > 1)

    @property
    def sizes(self) -> Floats:
        """Size of each level."""
        first = self.varied[0]
        return np.array([_size(first, each[first]) for each in self.levels.values()])

    @property
    def finest(self) -> str:
        """Name of the finest level."""
        return [*self.levels][-1]

    @property
    def held(self) -> list[str]:
        """Elements or the step, if they are not varied."""
        return [name for name in self.levels[self.finest] if name not in (*self.varied, "order")]

    def key(self, quantity: str) -> str:
        """Name of a quantity in this series."""
        return f"{quantity}, {self.label}" if self.label else quantity

    def probe(self, name: str) -> dict[str, Any]:
        """The finest level, with what is held once more refined: half the step, or elements."""
        arguments = self.levels[self.finest]
        value = arguments[name]
        return arguments | {name: value / 2 if name == "step" else 2 * value}


def series_of(elements: Any, order: Any, step: Any, together: bool) -> list[Series]:
    """Series of the levels that are asked for.

    Parameters
    ----------
    elements, order, step : value, sequence or None
        See :func:`refine`.
    together : bool
        Whether elements and step are refined together, or one after the other at the finest other.

    Raises
    ------
    InputError
        For sequences that are no refinement.

    Examples
    --------
    >>> [series.label for series in series_of((2, 4), (1, 2), 0.1, together=True)]
    ['order = 1', 'order = 2']
    """
    by_order = isinstance(elements, Mapping)
    if by_order and order is not None:
        raise InputError("argument order", f"{order!r}, but elements says the orders already")
    orders = _values("order", tuple(elements) if by_order else order)
    steps, switched = _values("step", step), switch("argument together", together)
    found = []
    for p in orders or [None]:
        counts = _values("elements", elements[p] if by_order and orders else elements)
        values = {"elements": counts, "order": orders and [p], "step": steps}
        varied = [name for name, each in values.items() if len(each) > 1]
        if not varied:
            raise InputError(
                "arguments elements, step",
                "got no sequence, expected at least two levels of one of them, such as"
                " elements=(4, 8, 16, 32)",
            )
        for names in [varied] if switched else [[name] for name in varied]:
            many = [len(values[name]) for name in names]
            if many[0] != many[-1]:
                raise InputError(
                    "arguments elements, step",
                    f"got {many[0]} and {many[1]} levels, expected equally many (or"
                    " together=False)",
                )
            levels = [
                {n: each[k if n in names else -1] for n, each in values.items() if each}
                for k in range(many[0])
            ]
            parts = [f"order = {p}"] * (len(orders) > 1)
            parts += [f"{names[0]} varied"] * (len(varied) > len(names))
            named = {case_name(level): level for level in levels}
            found.append(Series(", ".join(parts), names, named))
    return found


def _values(name: str, given: Sequence[Any] | Any) -> list[Any]:
    """Checked values of a sequence or a single value; empty if there is none."""
    if given is None:
        return []
    label = f"argument {name}"
    values = [
        positive(label, "value", each) if name == "step" else whole(label, each, 1)
        for each in np.array(given, dtype=object).ravel()
    ]
    if any(_size(name, a) <= _size(name, b) for a, b in pairwise(values)):
        way = "falling" if name == "step" else "growing"
        raise InputError(label, f"{given!r}, expected {way} numbers, coarsest level first")
    return values


def check_call(problem: Any, arguments: Mapping[str, Any], item: str = "argument problem") -> None:
    """Refuse a problem that does not take these arguments by keyword."""
    if not callable(problem):
        raise InputError(item, f"{problem!r} cannot be called")
    try:
        signature(problem).bind(**arguments)
    except ValueError:
        return  # a builtin that does not tell
    except TypeError as error:
        raise InputError(
            item,
            f"takes {signature(problem)}, but the study calls it with {', '.join(arguments)} as"
            f" keywords: {error}",
        ) from error
