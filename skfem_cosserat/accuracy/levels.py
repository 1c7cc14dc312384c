"""Levels of meshes, orders and steps."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from inspect import signature
from itertools import pairwise
from typing import Any

import numpy as np
import skfem

from ..errors import InputError
from ..types import Floats, switch

# -- sequences of meshes, orders and steps, and the series of levels that they make ----------------

#: what a study varies, in the order of names
NAMES = ("elements", "mesh", "order", "step")
#: how what is held is refined once, to see its own error
FINER: dict[str, Callable[[Any], Any]] = {
    "elements": lambda count: 2 * count,
    "mesh": lambda mesh: mesh.refined(),
    "step": lambda step: step / 2,
}
Span = Sequence[Any] | Any


@dataclass(frozen=True, eq=False)
class StudyLevel:
    """A call of the problem: its arguments, and the size that they stand for."""

    arguments: dict[str, Any]
    size: float

    @property
    def name(self) -> str:
        """In words."""
        return case_name(self.arguments)


@dataclass(frozen=True, eq=False)
class Series:
    """Levels that belong together, coarsest first: those of one order.

    Attributes
    ----------
    label : str
        What tells it from others, empty if there are no others.
    kind : str
        What `size` is, for the axis of a chart.
    levels : list of Level
    at_once : bool
        Whether mesh and step vary together.
    """

    label: str
    kind: str
    levels: list[StudyLevel]
    at_once: bool = False

    @property
    def sizes(self) -> Floats:
        """Size of each level."""
        return np.array([level.size for level in self.levels])

    @property
    def varied(self) -> list[str]:
        """Names of the arguments that differ from level to level."""
        first, last = self.levels[0].arguments, self.levels[-1].arguments
        return [name for name in last if first[name] is not last[name]]

    @property
    def held(self) -> list[str]:
        """Names of those that stand for a mesh or a step and do not."""
        return [
            name for name in self.levels[-1].arguments if name in FINER and name not in self.varied
        ]

    def probe(self, name: str) -> StudyLevel:
        """The finest level, with what is held once more refined: half the step, or elements."""
        arguments = self.levels[-1].arguments
        return StudyLevel({**arguments, name: FINER[name](arguments[name])}, self.levels[-1].size)


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


def series_of(
    elements: Span, mesh: Span, order: Span, step: Span, together: bool = True
) -> list[Series]:
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
    >>> [series.label for series in series_of((2, 4), None, (1, 2), 0.1)]
    ['order = 1', 'order = 2']
    """
    if elements is not None and mesh is not None:
        raise InputError("arguments elements, mesh", "got both, expected one of them")
    space, given = ("elements", elements) if mesh is None else ("mesh", mesh)
    if isinstance(given, Mapping):
        if order is not None:
            raise InputError("argument order", f"{order!r}, but {space} says the orders already")
        orders, by_order = _refined("order", tuple(given), _whole, np.less), dict(given)
    else:
        orders = _refined("order", order, _whole, np.less)
        by_order = dict.fromkeys(orders or [None], given)
    steps = _refined("step", step, _positive, np.greater)
    found = []
    for p, sequence in by_order.items():
        if space == "elements":
            meshes = _refined(space, sequence, _whole, np.less)
        else:
            meshes = _refined(space, sequence, _mesh, None)
        fixed = {} if p is None else {"order": p}
        found += _of_order(space, meshes, steps, fixed, together, len(orders) > 1)
    return found


def _of_order(
    space: str,
    meshes: list[Any],
    steps: list[float],
    fixed: dict[str, Any],
    together: bool,
    named: bool,
) -> list[Series]:
    """The series of one order, or two: one for the mesh, one for the step."""
    varied = [name for name, each in ((space, meshes), ("step", steps)) if len(each) > 1]
    if not varied:
        raise InputError(
            "arguments elements, mesh, step",
            "got no sequence, expected at least two levels of one of them, such as"
            " elements=(4, 8, 16, 32)",
        )
    if switch("argument together", together) and len(varied) == 2 and len(meshes) != len(steps):
        raise InputError(
            f"arguments {space}, step",
            f"got {len(meshes)} and {len(steps)} levels, expected equally many (or together=False)",
        )
    found = []
    for names in [varied] if together else [[name] for name in varied]:
        count = len(meshes if names[0] == space else steps)
        levels = [
            _level({space: _pick(meshes, k, space in names)}, fixed, steps, k, names)
            for k in range(count)
        ]
        parts = [case_name(fixed)] if named else []
        parts += [f"{names[0]} varied"] if len(varied) > 1 and not together else []
        found.append(Series(", ".join(parts), _kind(names), levels, len(names) > 1))
    return found


def _pick(values: list[Any], k: int, varies: bool) -> Any:
    """The k-th value, or the finest."""
    return None if not values else values[k if varies else -1]


def _level(
    where: dict[str, Any], fixed: dict[str, Any], steps: list[Any], k: int, names: list[str]
) -> StudyLevel:
    arguments = {**where, **fixed, "step": _pick(steps, k, "step" in names)}
    arguments = {name: value for name, value in arguments.items() if value is not None}
    if names[0] == "step":
        return StudyLevel(arguments, float(arguments["step"]))
    mesh = arguments[names[0]]
    return StudyLevel(arguments, 1.0 / mesh if names[0] == "elements" else _longest(mesh))


def _kind(names: list[str]) -> str:
    kinds = {"elements": "1/elements", "mesh": "longest element", "step": "step"}
    return kinds[names[0]] + (" (with the step)" if len(names) > 1 else "")


def _longest(mesh: skfem.Mesh) -> float:
    ends = mesh.p[:, mesh.t]
    return float(np.linalg.norm(ends[:, 0] - ends[:, -1], axis=0).max())


# -- checks ----------------------------------------------------------------------------------------


def _refined(
    name: str, given: Span, check: Callable[[str, Any], Any], falls: Callable[..., Any] | None
) -> list[Any]:
    """Checked values of a sequence or a single value; empty if there is none."""
    if given is None:
        return []
    single = np.isscalar(given) or isinstance(given, skfem.Mesh)
    values = [check(name, each) for each in ([given] if single else list(given))]
    label = f"argument {name}"
    if not single and len(values) < 2 and name != "order":
        raise InputError(label, f"{given!r} has fewer than two levels")
    sizes = values if falls is not None else [-_longest(each) for each in values]
    for a, b in pairwise(sizes):
        if not (np.less if falls is None else falls)(a, b):
            way = "falling" if name == "step" else "growing"
            way = "finer and finer meshes" if falls is None else f"{way} numbers"
            shown = [text(each) for each in values]
            raise InputError(label, f"({', '.join(shown)}), expected {way}, coarsest level first")
    return values


def _whole(name: str, value: Any) -> int:
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < 1:
        raise InputError(f"argument {name}", f"holds {value!r}, expected positive integers")
    return int(value)


def _positive(name: str, value: Any) -> float:
    wrong = isinstance(value, bool) or not isinstance(value, int | float | np.number)
    if wrong or not (np.isfinite(value) and value > 0):
        raise InputError(f"argument {name}", f"holds {value!r}, expected positive numbers")
    return float(value)


def _mesh(name: str, value: Any) -> skfem.Mesh:
    if not isinstance(value, skfem.Mesh):
        raise InputError(f"argument {name}", f"holds {value!r}, expected meshes")
    return value


def check_call(problem: Any, arguments: Mapping[str, Any], item: str = "argument problem") -> None:
    """Refuse a problem that does not take these arguments by keyword."""
    if not callable(problem):
        raise InputError(item, f"{problem!r} cannot be called")
    try:
        expected = signature(problem)
    except (TypeError, ValueError):
        return  # a builtin that does not tell
    try:
        expected.bind(**arguments)
    except TypeError as error:
        raise InputError(
            item,
            f"takes {expected}, but the study calls it with {', '.join(arguments)} as keywords:"
            f" {error}",
        ) from error
