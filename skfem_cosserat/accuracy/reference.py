"""References that the results of a study are compared with, and their errors."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from ..arguments import checked
from ..errors import InputError
from ..history import History
from ..types import Array, Floats, names_known, positive
from .levels import case_name
from .orders import left
from .reading import numeric

#: names of the runs of a reference
FINE, COARSE = "reference", "reference, second run"


class Reference:
    """Values with an error of each; this one has none: levels are compared with each other.

    Parameters
    ----------
    runs : mapping, optional
        What must be run for it, by name: functions of the problem, or arguments for it. The first
        run is the truth, a second one tells how good it is.
    """

    #: what it is, in words
    about = "none: levels are compared with each other"
    #: of errors, if the second run has steps (or elements) twice as long
    order: float | None = None

    def __init__(self, runs: Mapping[str, Any] | None = None) -> None:
        self.runs = runs or {}
        #: true values and their errors by quantity; None stands for the only one
        self.known: dict[str | None, Any] = {}
        self.errors: dict[str | None, float] = {}

    def __repr__(self) -> str:
        return f"{type(self).__name__}(...)"

    def check(self, names: list[str], every: bool = True) -> None:
        """Refuse values that do not fit the quantities.

        Parameters
        ----------
        names : list of str
            Of the quantities.
        every : bool
            Whether each must have one, if they do not come from runs.

        Raises
        ------
        InputError
            If one has another name, or one is missing.
        """
        if None in self.known:
            if len(names) > 1:
                raise InputError(
                    "argument reference",
                    f"one value for {len(names)} quantities, expected a mapping with"
                    f" {', '.join(names)}",
                )
            every = False
        for name in (*self.known, *self.errors):
            if name not in (None, *names):
                raise InputError(f"reference of {name!r}", f"unknown; {names_known(name, names)}")
        missing = [name for name in names if name not in self.known]
        if every and missing and not self.runs:
            raise InputError("argument reference", f"has no value of {missing[0]!r}")

    def of(
        self,
        name: str,
        shape: tuple[int, ...],
        instants: Floats | None,
        runs: Sequence[Array],
        norm: Callable[[Array], float],
    ) -> tuple[Any, float]:
        """Value of a quantity to compare with (None: none), and its error (NaN: not known).

        Parameters
        ----------
        name : str
        shape : tuple of int
            Of the quantity.
        instants : array or None
        runs : sequence of arrays
            Its values in the reference's own runs, at these instants.
        norm : callable

        Raises
        ------
        InputError
            If a known value is not finite, or has another shape than the quantity.
        """
        if runs:
            fine, *coarse = runs
            if not coarse:
                return fine, np.nan
            off = fine - coarse[0]
            if self.order is None:
                return fine, norm(off)
            off = left(off, self.order)
            return fine + off, norm(off)
        value = self.known.get(name, self.known.get(None))
        if callable(value):
            value = _finite(value() if instants is None else value(instants), name)
        if value is not None and value.shape != shape:
            if {value.size, int(np.prod(shape))} != {1}:
                text = f"shape {value.shape}, expected that of the values, {shape}"
                raise InputError(f"reference of quantity {name!r}", text)
            value = value.reshape(shape)
        return value, float(self.errors.get(name, self.errors.get(None, np.nan)))


@checked
class ReferenceFinest(Reference):
    """The finest level of each series stands for the truth; orders are of what levels change.

    Examples
    --------
    >>> from skfem_cosserat import refine
    >>> def area(elements):
    ...     return 1 + 0.2 / elements**2
    >>> found = refine(area, elements=(2, 4, 8, 16, 32), reference=ReferenceFinest())
    >>> print(found.verdicts["value"])
    order 2.00 +- 0.01 (three finest of five levels)
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
        if not arguments:
            raise InputError("ReferenceRun", "got no arguments, expected some: elements=1000")
        super().__init__({FINE: arguments})
        self.about = f"a run with {case_name(arguments)}"


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

    about = "given"

    def __init__(self, values: Any, errors: float | Mapping[str, float]) -> None:
        super().__init__()
        given = values if isinstance(values, Mapping) else {None: values}
        self.known = {k: v if callable(v) else _finite(v, k) for k, v in given.items()}
        named = errors if isinstance(errors, Mapping) else {None: errors}
        self.errors = {k: positive("ReferenceKnown", "errors", each) for k, each in named.items()}


def _finite(value: Any, name: str | None) -> Array:
    """An array of finite numbers, or an error."""
    label = "argument reference" if name is None else f"reference of quantity {name!r}"
    array = numeric(label, value, "finite numbers")
    if not np.isfinite(array).all():
        raise InputError(label, f"{value!r}, expected finite numbers")
    return array


def _given(history: History, problem: Any) -> History:
    """A run that has been done, whatever the problem."""
    return history


def reference_of(given: Any, levels: bool) -> Reference:
    """Reference that an argument stands for: a reference itself, true values, or a run.

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
    >>> reference_of({"x": 1.0}, levels=True).of("x", (), None, [], abs)
    (array(1.), nan)
    """
    others = ReferenceRun | ReferenceFinest if levels else ReferencePair
    if isinstance(given, ReferenceKnown | others):
        return given
    if levels:
        return Reference() if given is None else ReferenceKnown(given, {})
    if isinstance(given, History):
        given = partial(_given, given)
    if callable(given):
        return Reference({FINE: given})
    if given is None or isinstance(given, str | Reference):
        raise InputError(
            "argument reference",
            f"{given!r}, expected values, ReferenceKnown, ReferencePair or a function of the"
            " problem",
        )
    return ReferenceKnown(given, {})
