"""What is looked at in the results of a study, level by level."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import InputError
from ..history import History
from ..types import Array, Floats
from .norms import OverTime, common_instants, rows_at

__all__ = ["Quantities", "Sample", "aligned"]

#: name of the only quantity of a problem that gives a number or an array
ONLY = "value"
#: name of the times in a mapping
TIMES = "t"


@dataclass(frozen=True, eq=False)
class Sample:
    """Quantities of one result; with times, if compared over time."""

    values: dict[str, Array]
    times: Floats | None = None


class Quantities:
    """The quantities of a study by name, each a function of the result.

    Parameters
    ----------
    given : mapping, sequence of str, or None
        See :func:`refine`.
    over : OverTime, optional
        How they are compared over time.

    Examples
    --------
    >>> wanted = Quantities({"twice": lambda result: 2 * result})
    >>> float(wanted.sample(4.0, "level 1").values["twice"])
    8.0
    """

    def __init__(self, given: Any, over: OverTime | None = None) -> None:
        self.over = over
        self._given: dict[str, Callable[[Any], Any] | str] | None = None
        if given is None:
            return
        if isinstance(given, str) or not isinstance(given, Mapping | Sequence):
            raise InputError(
                "argument quantities", f"{given!r}, expected names, or functions by name"
            )
        named = dict(given) if isinstance(given, Mapping) else {name: name for name in given}
        for name, what in named.items():
            if not isinstance(name, str) or not (isinstance(what, str) or callable(what)):
                raise InputError(
                    f"quantity {name!r}",
                    f"{what!r}, expected a function of the result or the name of an entry",
                )
        if not named:
            raise InputError("argument quantities", f"{given!r}, expected at least one")
        self._given = named

    @property
    def names(self) -> list[str]:
        """Names, as far as known without a result."""
        return list(self._given or ())

    def sample(self, result: Any, level: str) -> Sample:
        """The quantities of a result.

        Raises
        ------
        InputError
            If one of them is not in the result, or is no number or array.
        """
        times = self._times(result, level) if self.over is not None else None
        if self._given is None:
            values = _all_entries(result)
        else:
            values = {name: self._value(what, result) for name, what in self._given.items()}
        arrays = {name: _array(name, value, level) for name, value in values.items()}
        for name, array in arrays.items():
            if times is not None and (array.ndim == 0 or len(array) != len(times)):
                raise InputError(
                    f"quantity {name!r}",
                    f"shape {array.shape} at {level}, expected one entry for each of the"
                    f" {len(times)} states, as it is compared over time",
                )
        return Sample(arrays, times)

    def _value(self, what: Callable[[Any], Any] | str, result: Any) -> Any:
        if not isinstance(what, str):
            return what(result)
        if isinstance(result, History):
            return result[what] if self.over is not None else result[what][-1]
        if not isinstance(result, Mapping):
            raise InputError(
                f"quantity {what!r}",
                f"is a name, but the problem gave a {type(result).__name__}, which has none:"
                " expected a mapping or a History",
            )
        if what not in result:
            raise InputError(f"quantity {what!r}", f"unknown; there are {', '.join(result)}")
        return result[what]

    def _times(self, result: Any, level: str) -> Floats:
        if isinstance(result, History):
            return result.times
        if isinstance(result, Mapping) and TIMES in result:
            return np.asarray(result[TIMES], dtype=float)
        raise InputError(
            "argument norm",
            f"is one over time, but the problem gave a {type(result).__name__} without times at"
            f" {level}: expected a History or a mapping with {TIMES!r}",
        )


def _all_entries(result: Any) -> dict[str, Any]:
    if isinstance(result, History):
        raise InputError(
            "argument quantities",
            "None, but the problem gives a History: say what is looked at, such as"
            ' quantities={"tip": lambda history: history["q"][-1, -12:-9]}',
        )
    if not isinstance(result, Mapping):
        return {ONLY: result}
    return {str(name): value for name, value in result.items() if name != TIMES}


def _array(name: str, value: Any, level: str) -> Array:
    try:
        array = np.asarray(value)
    except ValueError as error:  # rows of different lengths
        raise InputError(f"quantity {name!r}", f"no array at {level}: {error}") from error
    if array.dtype.kind not in "biufc" or not array.size:
        raise InputError(
            f"quantity {name!r}", f"{value!r} at {level}, expected a number or an array of numbers"
        )
    return array if array.dtype.kind == "c" else array.astype(float)


def aligned(
    name: str, samples: Mapping[str, Sample], over: OverTime | None
) -> tuple[dict[str, Array], Floats | None]:
    """Values of a quantity by level, at the instants that all levels share.

    Raises
    ------
    InputError
        If shapes differ from level to level, or there are no common instants.
    """
    lacking = [level for level, sample in samples.items() if name not in sample.values]
    if lacking:
        raise InputError(f"quantity {name!r}", f"missing at {lacking[0]}")
    values = {level: sample.values[name] for level, sample in samples.items()}
    instants = None
    if over is not None:
        times = {level: np.asarray(sample.times) for level, sample in samples.items()}
        instants = over.select(common_instants(list(times.values())))
        if not len(instants):
            raise InputError(
                f"quantity {name!r}",
                "no instant that all levels have recorded: choose steps that divide each other",
            )
        values = {level: each[rows_at(times[level], instants)] for level, each in values.items()}
    shapes = {level: each.shape for level, each in values.items()}
    first = next(iter(shapes), "")
    for level, shape in shapes.items():
        if shape != shapes[first]:
            raise InputError(
                f"quantity {name!r}",
                f"shape {shapes[first]} at {first}, {shape} at {level}: expected the same on all"
                " levels, such as values at some points",
            )
    return values, instants
