"""What the results of a study are compared with, and how far that can be trusted."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from ..arguments import checked
from ..errors import InputError
from ..history import History
from ..types import Array, Floats, names_known, positive
from .levels import case_name

#: names of the runs of a reference
FINE, COARSE = "reference", "reference, second run"
#: a value, or a function of the common instants (of nothing, if not compared over time)
Known = Array | Callable[..., Any]
Size = Callable[[Array], float]


class Compared(NamedTuple):
    """A quantity, as a reference is asked for it.

    Attributes
    ----------
    name : str
    values : mapping
        Of the reference's own runs, at the common instants.
    instants : array or None
    shape : tuple of int
        Of the quantity.
    size : callable
        Norm of the study.
    """

    name: str
    values: Mapping[str, Array]
    instants: Floats | None
    shape: tuple[int, ...]
    size: Size


class Reference:
    """What results are compared with; this one is nothing: they are compared with each other.

    Attributes
    ----------
    runs : dict
        What must be run for it, by name: functions of the problem, or arguments for it.
    about : str
        What it is, in words.
    """

    about = "none: levels are compared with each other"

    def __init__(self) -> None:
        self.runs: dict[str, Any] = {}

    def __repr__(self) -> str:
        return f"{type(self).__name__}(...)"

    def beside(self, finest: Mapping[str, Any]) -> Reference:
        """The reference of levels of which the finest has these arguments."""
        return self

    def check(self, names: list[str], every: bool = True) -> None:
        """Refuse values that do not fit the quantities.

        Parameters
        ----------
        names : list of str
            Of the quantities.
        every : bool
            Whether each must have one.

        Raises
        ------
        InputError
            If one has another name, or one is missing.
        """

    def of(self, what: Compared) -> tuple[Any, float]:
        """Value of a quantity to compare with (None: none), and its error (NaN: not known)."""
        return None, float("nan")


@checked
class ReferenceFinest(Reference):
    """The finest level of each series stands for the truth; orders allow for its own error.

    Examples
    --------
    >>> from skfem_cosserat import refine
    >>> def area(elements):
    ...     return 1 + 0.2 / elements**2
    >>> found = refine(area, elements=(2, 4, 8, 16, 32), reference=ReferenceFinest())
    >>> print(found.verdicts["value"])
    order 2.00 +- 0.01 (three finest of four levels)
    """

    about = "the finest level"


@checked
class ReferenceRun(Reference):
    """Another call of the problem stands for the truth; run, kept and resumed like the levels.

    Parameters
    ----------
    **arguments
        Of the problem. Those that are not given are as on the finest level.

    Examples
    --------
    >>> from skfem_cosserat import refine
    >>> def area(elements, order):
    ...     return 1 + 0.2 / elements**order
    >>> found = refine(area, elements=(2, 4, 8, 16), order=2,
    ...                reference=ReferenceRun(elements=1000, order=6))
    >>> print(found.verdicts["value"])
    order 2.00 +- 0.01 (three finest of four levels)
    """

    def __init__(self, **arguments: Any) -> None:
        super().__init__()
        if not arguments:
            raise InputError("ReferenceRun", "got no arguments, expected some: elements=1000")
        self.arguments = arguments

    def beside(self, finest: Mapping[str, Any]) -> Reference:
        """The run with these arguments, as far as it has none of its own."""
        arguments = {**finest, **self.arguments}
        return SingleRun(case_name(arguments), arguments, repr(self))

    def __repr__(self) -> str:
        return f"<ReferenceRun: {case_name(self.arguments)}>"


class SingleRun(Reference):
    """One run, of which nobody knows how good it is."""

    def __init__(self, name: str, run: Any, about: str = "a run") -> None:
        self.runs, self.about = {name: run}, about

    def of(self, what: Compared) -> tuple[Any, float]:
        """See the base class."""
        (value,) = (what.values[run] for run in self.runs)
        if not np.isfinite(value).all():
            raise InputError("argument reference", f"its run gave {what.name!r} not finite")
        return value, float("nan")


@checked
class ReferenceKnown(Reference):
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

    about = "given"

    def __init__(self, values: Any, errors: float | Mapping[str, float]) -> None:
        super().__init__()
        given = values if isinstance(values, Mapping) else {None: values}
        self.known: dict[str | None, Known] = {
            name: value if callable(value) else _finite(value, _label(name))
            for name, value in given.items()
        }
        named: Mapping[Any, float] = errors if isinstance(errors, Mapping) else {None: errors}
        self.errors = {k: positive("ReferenceKnown", "errors", each) for k, each in named.items()}

    def check(self, names: list[str], every: bool = True) -> None:
        """See the base class."""
        if None in self.known and len(names) > 1:
            raise InputError(
                "argument reference",
                f"one value for {len(names)} quantities, expected a mapping with"
                f" {', '.join(names)}",
            )
        for name in (*self.known, *self.errors):
            if name is not None and name not in names:
                raise InputError(f"reference of {name!r}", f"unknown; {names_known(name, names)}")
        missing = [name for name in names if name not in self.known and None not in self.known]
        if every and missing:
            raise InputError("argument reference", f"has no value of {missing[0]!r}")

    def of(self, what: Compared) -> tuple[Any, float]:
        """See the base class.

        Raises
        ------
        InputError
            If the value has another shape than the quantity.
        """
        name, shape = what.name, what.shape
        value = self.known.get(name, self.known.get(None))
        error = float(self.errors.get(name, self.errors.get(None, np.nan)))
        if callable(value):
            value = _finite(
                value() if what.instants is None else value(what.instants), _label(name)
            )
        if value is None or value.shape == shape:
            return value, error
        if value.size != 1 or int(np.prod(shape)) != 1:
            text = f"shape {value.shape}, expected that of the values, {shape}"
            raise InputError(_label(name), text)
        return value.reshape(shape), error


def _label(name: str | None) -> str:
    return "argument reference" if name is None else f"reference of quantity {name!r}"


def _finite(value: Any, label: str) -> Array:
    """An array of finite numbers, or an error."""
    try:
        array = np.asarray(value)
    except ValueError as error:
        raise InputError(label, f"{value!r}, expected numbers") from error
    if array.dtype.kind not in "biufc" or not np.isfinite(array).all():
        raise InputError(label, f"{value!r}, expected finite numbers")
    return array


@checked
class ReferencePair(Reference):
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
        self.runs = {FINE: fine, COARSE: coarse}
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

    def of(self, what: Compared) -> tuple[Any, float]:
        """See the base class."""
        both = what.values[FINE], what.values[COARSE]
        return self.value(*both), self.error(*both, what.size)


# -- from the argument of a study ------------------------------------------------------------------


def reference_of_levels(given: Any) -> Reference:
    """That of a refinement: a reference, or true values.

    Raises
    ------
    InputError
        If it is none, or one of setups.
    """
    if given is None:
        return Reference()
    usable = isinstance(given, Reference) and not isinstance(given, ReferencePair)
    return given if usable else ReferenceKnown(given, {})


class _Done:
    """A run that has been done, as a function of the problem."""

    def __init__(self, history: History) -> None:
        self.history = history

    def __call__(self, problem: Any) -> History:
        return self.history


def reference_of_setups(given: Any) -> Reference:
    """That of a work-precision study: a reference, true values, or a run.

    Raises
    ------
    InputError
        If it is none, or one of levels.

    Examples
    --------
    >>> truth = reference_of_setups({"x": 1.0})
    >>> truth.runs, truth.of(Compared("x", {}, None, (), abs))
    ({}, (array(1.), nan))
    """
    if isinstance(given, ReferenceKnown | ReferencePair):
        return given
    if isinstance(given, History):
        return SingleRun(FINE, _Done(given))
    pair = isinstance(given, tuple | list) and len(given) > 1
    if pair and isinstance(given[0], str) and callable(given[1]):  # a setup
        return SingleRun(FINE, given[1])
    if callable(given):
        return SingleRun(FINE, given)
    if given is None or isinstance(given, str | Reference):
        raise InputError(
            "argument reference",
            f"{given!r}, expected values, ReferenceKnown, ReferencePair or a function of the"
            " problem",
        )
    return ReferenceKnown(given, {})
