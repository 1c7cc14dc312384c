"""What the results of a study are compared with, and how far that can be trusted."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np

from ..arguments import checked
from ..errors import InputError
from ..history import History
from ..types import Array, Floats, names_known, positive
from .levels import case_name

#: names of the runs of a reference
FINE, COARSE = "reference", "reference, second run"


class Reference:
    """Values with an error of each; this one has none: levels are compared with each other.

    Parameters
    ----------
    runs : mapping, optional
        What must be run for it, by name: functions of the problem, or arguments for it. The first
        run is the truth, a second one tells how good it is.
    about : str
        What it is, in words.
    """

    #: of errors, if the second run has steps (or elements) twice as long
    order: float | None = None

    def __init__(
        self,
        runs: Mapping[str, Any] | None = None,
        about: str = "none: levels are compared with each other",
    ) -> None:
        self.runs, self.about = dict(runs or {}), about

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

    def of(
        self,
        name: str,
        shape: tuple[int, ...],
        instants: Floats | None,
        values: Mapping[str, Array],
        norm: Callable[[Array], float],
    ) -> tuple[Any, float]:
        """Value of a quantity to compare with (None: none), and its error (NaN: not known).

        Parameters
        ----------
        name : str
        shape : tuple of int
            Of the quantity.
        instants : array or None
        values : mapping
            Of the reference's own runs, at these instants.
        norm : callable

        Raises
        ------
        InputError
            If the value is not finite, or has another shape than the quantity.
        """
        if not self.runs:
            return None, np.nan
        fine, *coarse = (values[run] for run in self.runs)
        if not np.isfinite(fine).all():
            raise InputError("argument reference", f"its run gave {name!r} not finite")
        if not coarse:
            return fine, np.nan
        change = fine - coarse[0]
        if self.order is None:
            return fine, norm(change)
        change = change / (2**self.order - 1)
        return fine + change, norm(change)


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

    def __init__(self) -> None:
        super().__init__(about="the finest level")


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
        if not arguments:
            raise InputError("ReferenceRun", "got no arguments, expected some: elements=1000")
        super().__init__(about=f"<ReferenceRun: {case_name(arguments)}>")
        self.arguments = arguments

    def beside(self, finest: Mapping[str, Any]) -> Reference:
        """The run with these arguments, as far as it has none of its own."""
        arguments = {**finest, **self.arguments}
        return Reference({case_name(arguments): arguments}, self.about)

    def __repr__(self) -> str:
        return self.about


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
    >>> from skfem_cosserat import work_precision
    >>> pair = ReferencePair(lambda problem: {"x": 1.01}, lambda problem: {"x": 1.04}, order=2)
    >>> setups = [("rough", lambda problem: {"x": 1.2})]
    >>> table = work_precision(None, setups, pair, ["x"], repeats=1)
    >>> round(table.rows[0]["error_x"], 9), round(table.reference_errors["x"], 9)
    (0.2, 0.01)
    """

    def __init__(
        self, fine: Callable[..., Any], coarse: Callable[..., Any], order: float | None = None
    ) -> None:
        for name, run in (("fine", fine), ("coarse", coarse)):
            if not callable(run):
                raise InputError("ReferencePair", f"{name} = {run!r}, expected a function")
        super().__init__({FINE: fine, COARSE: coarse})
        self.order = None if order is None else positive("ReferencePair", "order", order)


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

    def __init__(self, values: Any, errors: float | Mapping[str, float]) -> None:
        super().__init__(about="given")
        given = values if isinstance(values, Mapping) else {None: values}
        self.known = {k: v if callable(v) else _finite(v, k) for k, v in given.items()}
        named: Mapping[Any, float] = errors if isinstance(errors, Mapping) else {None: errors}
        self.errors = {k: positive("ReferenceKnown", "errors", each) for k, each in named.items()}

    def check(self, names: list[str], every: bool = True) -> None:
        """Refuse values that do not fit the quantities, as :meth:`Reference.check`."""
        if None in self.known and len(names) > 1:
            raise InputError(
                "argument reference",
                f"one value for {len(names)} quantities, expected a mapping with"
                f" {', '.join(names)}",
            )
        for name in (*self.known, *self.errors):
            if name not in (None, *names):
                raise InputError(f"reference of {name!r}", f"unknown; {names_known(name, names)}")
        missing = [name for name in names if name not in self.known and None not in self.known]
        if every and missing:
            raise InputError("argument reference", f"has no value of {missing[0]!r}")

    def of(
        self,
        name: str,
        shape: tuple[int, ...],
        instants: Floats | None,
        values: Mapping[str, Array],
        norm: Callable[[Array], float],
    ) -> tuple[Any, float]:
        """The value that was given, as :meth:`Reference.of`."""
        value = self.known.get(name, self.known.get(None))
        error = float(self.errors.get(name, self.errors.get(None, np.nan)))
        if callable(value):
            value = _finite(value() if instants is None else value(instants), name)
        if value is None or value.shape == shape:
            return value, error
        if value.size != 1 or int(np.prod(shape)) != 1:
            text = f"shape {value.shape}, expected that of the values, {shape}"
            raise InputError(f"reference of quantity {name!r}", text)
        return value.reshape(shape), error


def _finite(value: Any, name: str | None) -> Array:
    """An array of finite numbers, or an error."""
    label = "argument reference" if name is None else f"reference of quantity {name!r}"
    try:
        array = np.asarray(value)
    except ValueError as error:
        raise InputError(label, f"{value!r}, expected numbers") from error
    if array.dtype.kind not in "biufc" or not np.isfinite(array).all():
        raise InputError(label, f"{value!r}, expected finite numbers")
    return array


def _given(history: History, problem: Any) -> History:
    """A run that has been done, whatever the problem."""
    return history


def reference_of(given: Any, levels: bool) -> Reference:
    """What an argument stands for: a reference, true values, or a run.

    Parameters
    ----------
    given : object
    levels : bool
        Whether levels are compared with it, or setups: these take a problem, as its runs do.

    Raises
    ------
    InputError
        If it is nothing to compare with, or a reference of the other ones.

    Examples
    --------
    >>> reference_of({"x": 1.0}, levels=True).of("x", (), None, {}, abs)
    (array(1.), nan)
    """
    if levels:
        if given is None:
            return Reference()
        kinds: tuple[type[Reference], ...] = ReferenceKnown, ReferenceRun, ReferenceFinest
        return given if isinstance(given, kinds) else ReferenceKnown(given, {})
    if isinstance(given, ReferenceKnown | ReferencePair):
        return given
    pair = isinstance(given, tuple | list) and len(given) > 1
    if pair and isinstance(given[0], str) and callable(given[1]):  # a setup
        given = given[1]
    if isinstance(given, History):
        given = partial(_given, given)
    if callable(given):
        return Reference({FINE: given}, "a run")
    if given is None or isinstance(given, str | Reference):
        raise InputError(
            "argument reference",
            f"{given!r}, expected values, ReferenceKnown, ReferencePair or a function of the"
            " problem",
        )
    return ReferenceKnown(given, {})
