"""Levels of elements, orders and steps."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from inspect import signature
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import skfem

from ..errors import InputError
from ..types import Floats, check_kind, positive, switch, whole


def case_name(arguments: Mapping[str, Any]) -> str:
    """Arguments in words.

    Examples
    --------
    >>> case_name({"elements": 8, "step": 1e-3})
    'elements = 8, step = 0.001'
    """
    return ", ".join(f"{name} = {text(value)}" for name, value in arguments.items())


def text(value: Any) -> str:
    """A number or a mesh in a few characters."""
    if isinstance(value, skfem.Mesh):
        return f"{value.nelements} elements up to {_longest(value):.9g}"
    return repr(value)


def _longest(mesh: skfem.Mesh) -> float:
    ends = mesh.p[:, mesh.t]
    return float(np.linalg.norm(ends[:, 0] - ends[:, -1], axis=0).max())


# -- what a study varies, and the series of levels that this makes ---------------------------------


class _Varied(NamedTuple):
    """An argument: its check, how it falls or grows, sizes, and how it is refined once more."""

    fits: Callable[[str, Any], Any]
    way: str
    size: Callable[[Any], float]
    axis: str
    finer: Callable[[Any], Any]
    words: str


def _mesh(item: str, value: Any) -> Any:
    check_kind(item, value, skfem.Mesh)
    return value


_COUNTS = _Varied(
    lambda item, value: whole(item, value, 1),
    "growing numbers",
    lambda count: 1.0 / count,
    "1/elements",
    lambda count: 2 * count,
    "twice as many",
)
ARGUMENTS = {
    "elements": _COUNTS,
    "mesh": _Varied(
        _mesh,
        "finer and finer meshes",
        _longest,
        "longest element",
        lambda mesh: mesh.refined(),
        "a finer one",
    ),
    "order": _COUNTS,
    "step": _Varied(
        lambda item, value: positive(item, "value", value),
        "falling numbers",
        float,
        "step",
        lambda step: step / 2,
        "half of it",
    ),
}


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
        """Name of the sizes, for the axis of a chart."""
        return ARGUMENTS[self.varied[0]].axis + " (with the step)" * (len(self.varied) > 1)

    @property
    def sizes(self) -> Floats:
        """Size of each level."""
        first = self.varied[0]
        return np.array([ARGUMENTS[first].size(each[first]) for each in self.levels.values()])

    @property
    def finest(self) -> str:
        """Name of the finest level."""
        return [*self.levels][-1]

    @property
    def held(self) -> list[str]:
        """Names of arguments that stand for a mesh or a step and are not varied."""
        return [name for name in self.levels[self.finest] if name not in (*self.varied, "order")]

    def key(self, quantity: str) -> str:
        """Name of a quantity in this series."""
        return f"{quantity}, {self.label}" if self.label else quantity

    def probe(self, name: str) -> dict[str, Any]:
        """The finest level, with what is held once more refined: half the step, or elements."""
        arguments = self.levels[self.finest]
        return arguments | {name: ARGUMENTS[name].finer(arguments[name])}


def series_of(elements: Any, mesh: Any, order: Any, step: Any, together: bool) -> list[Series]:
    """Series of the levels that are asked for.

    Parameters
    ----------
    elements, mesh, order, step : value, sequence or None
        See :func:`refine`.
    together : bool
        Whether mesh and step are refined together, or one after the other at the finest other.

    Raises
    ------
    InputError
        For sequences that are no refinement.

    Examples
    --------
    >>> [series.label for series in series_of((2, 4), None, (1, 2), 0.1, together=True)]
    ['order = 1', 'order = 2']
    """
    if elements is not None and mesh is not None:
        raise InputError("arguments elements, mesh", "got both, expected one of them")
    space, given = ("elements", elements) if mesh is None else ("mesh", mesh)
    by_order = isinstance(given, Mapping)
    if by_order and order is not None:
        raise InputError("argument order", f"{order!r}, but {space} says the orders already")
    orders = _values("order", tuple(given) if by_order else order)
    steps, switched = _values("step", step), switch("argument together", together)
    found = []
    for p in orders or [None]:
        counted = _values(space, given[p] if by_order and orders else given)
        values = {space: counted, "order": orders and [p], "step": steps}
        varied = [name for name, each in values.items() if len(each) > 1]
        if not varied:
            raise InputError(
                "arguments elements, mesh, step",
                "got no sequence, expected at least two levels of one of them, such as"
                " elements=(4, 8, 16, 32)",
            )
        for names in [varied] if switched else [[name] for name in varied]:
            counts = [len(values[name]) for name in names]
            if counts[0] != counts[-1]:
                raise InputError(
                    f"arguments {space}, step",
                    f"got {counts[0]} and {counts[1]} levels, expected equally many (or"
                    " together=False)",
                )
            levels = [
                {n: each[k if n in names else -1] for n, each in values.items() if each}
                for k in range(counts[0])
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
    kind, label = ARGUMENTS[name], f"argument {name}"
    single = np.isscalar(given) or isinstance(given, skfem.Mesh | Mapping)
    values = [kind.fits(label, each) for each in ([given] if single else given)]
    if any(a <= b for a, b in pairwise(map(kind.size, values))):
        shown = ", ".join(map(text, values))
        raise InputError(label, f"({shown}), expected {kind.way}, coarsest level first")
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
