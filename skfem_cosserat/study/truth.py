"""What the setups of a work-precision study are compared with, and how far that can be trusted."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ..errors import InputError
from ..history import History
from ..types import Array, Floats, positive
from .reference import Known, known_values, value_of

__all__ = ["ReferenceKnown", "ReferencePair", "Truth"]

#: names of the runs of a reference
FINE, COARSE = "reference", "reference, second run"
Size = Callable[[Array], float]


class ReferenceKnown:
    """True values, with their own errors.

    Parameters
    ----------
    values : number, array or mapping
        By quantity; functions of the instants too, where quantities are compared over time.
    errors : float or mapping
        How far off they may be, in the norm of the study.

    Raises
    ------
    InputError
        If they are not finite.

    Examples
    --------
    >>> ReferenceKnown(3.14159, errors=3e-6).errors
    {None: 3e-06}
    """

    def __init__(self, values: Any, errors: float | Mapping[str, float]) -> None:
        self.known = known_values(values)
        named = errors if isinstance(errors, Mapping) else {None: errors}
        item = "ReferenceKnown"
        self.errors = {name: positive(item, "errors", each) for name, each in named.items()}


class ReferencePair:
    """Two runs of the problem: the fine one is the truth, the other tells how good it is.

    Parameters
    ----------
    fine, coarse : callable
        Functions of the problem, like those of setups. Let them differ in all that matters: mesh,
        step and scheme.
    order : float, optional
        If the coarse one has steps (or elements) twice as long, and nothing else differs: the limit
        after Richardson is the truth, for errors of this order. The error is then the distance
        of the fine run from it.

    Raises
    ------
    InputError
        If one of them cannot be called, or the order is not positive.

    Examples
    --------
    >>> pair = ReferencePair(lambda problem: 1.01, lambda problem: 1.04, order=2)
    >>> round(pair.value(np.array(1.01), np.array(1.04)).item(), 12)
    1.0
    """

    def __init__(
        self, fine: Callable[..., Any], coarse: Callable[..., Any], order: float | None = None
    ) -> None:
        for name, run in (("fine", fine), ("coarse", coarse)):
            if not callable(run):
                raise InputError("ReferencePair", f"{name} = {run!r}, expected a function")
        self.fine, self.coarse = fine, coarse
        self.order = None if order is None else positive("ReferencePair", "order", order)

    def value(self, fine: Array, coarse: Array) -> Array:
        """The truth, from the values of both runs."""
        if self.order is None:
            return fine
        return np.asarray(fine + (fine - coarse) / (2**self.order - 1))

    def error(self, fine: Array, coarse: Array, size: Size) -> float:
        """How good it is."""
        other = coarse if self.order is None else fine
        return size(self.value(fine, coarse) - other)


class _Given:
    """A run that has been done, as a function of the problem."""

    def __init__(self, history: History) -> None:
        self.history = history

    def __call__(self, problem: Any) -> History:
        return self.history


def _is_setup(given: Any) -> bool:
    """Whether it is a pair (label, function of the problem), with what else a setup has."""
    pair = isinstance(given, tuple | list) and len(given) > 1
    return bool(pair and isinstance(given[0], str) and callable(given[1]))


class Truth:
    """A reference of any kind, made uniform.

    Parameters
    ----------
    given : object
        See :func:`work_precision`.

    Attributes
    ----------
    runs : dict
        Functions of the problem that must be run for it.

    Raises
    ------
    InputError
        If it is no reference.

    Examples
    --------
    >>> truth = Truth({"x": 1.0})
    >>> truth.runs, truth.of("x", {}, None, (), abs)
    ({}, (array(1.), nan))
    """

    def __init__(self, given: Any) -> None:
        self.given = given
        self.known: dict[str | None, Known] = {}
        self._errors: dict[str | None, float] = {}
        self.runs: dict[str, Callable[..., Any]] = {}
        if isinstance(given, ReferencePair):
            self.runs = {FINE: given.fine, COARSE: given.coarse}
        elif isinstance(given, ReferenceKnown):
            self.known, self._errors = given.known, dict(given.errors)
        elif isinstance(given, History):
            self.runs = {FINE: _Given(given)}
        elif _is_setup(given):
            self.runs = {FINE: given[1]}
        elif callable(given):
            self.runs = {FINE: given}
        elif given is None or isinstance(given, str):
            raise InputError(
                "argument reference",
                f"{given!r}, expected values, ReferenceKnown, ReferencePair or a function of the"
                " problem",
            )
        else:
            self.known = known_values(given)

    def check(self, names: list[str]) -> None:
        """Refuse values that do not fit the quantities.

        Raises
        ------
        InputError
            If one has another name, or one is missing.
        """
        if None in self.known and len(names) > 1:
            raise InputError(
                "argument reference",
                f"one value for {len(names)} quantities, expected a mapping with"
                f" {', '.join(names)}",
            )
        for name in (*self.known, *self._errors):
            if name is not None and name not in names:
                raise InputError(f"reference of {name!r}", f"there are {', '.join(names)}")
        if self.known and None not in self.known:
            missing = [name for name in names if name not in self.known]
            if missing:
                raise InputError("argument reference", f"has no value of {missing[0]!r}")

    def of(
        self,
        name: str,
        values: Mapping[str, Array],
        instants: Floats | None,
        shape: tuple[int, ...],
        size: Size,
    ) -> tuple[Array, float]:
        """True value of a quantity, and its error (NaN: not known).

        Parameters
        ----------
        values : mapping
            Of the reference's own runs at the common instants.
        """
        if self.known:
            known = self.known.get(name, self.known.get(None))
            assert known is not None
            error = self._errors.get(name, self._errors.get(None, np.nan))
            return value_of(known, instants, shape, name), float(error)
        fine = values[FINE]
        if not isinstance(self.given, ReferencePair):
            return fine, float("nan")
        coarse = values[COARSE]
        return self.given.value(fine, coarse), self.given.error(fine, coarse, size)
