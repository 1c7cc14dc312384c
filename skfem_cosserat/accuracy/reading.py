"""Quantities of a study, what they are compared with, and norms of their differences over time."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from scipy.integrate import trapezoid
from scipy.interpolate import CubicSpline

from ..arguments import checked
from ..errors import InputError
from ..history import History
from ..types import TOLERANCE, Array, Floats, check_kind, names_known, numbers, positive
from .orders import ROUNDING, Norm, euclidean, left
from .run import case_name

# -- how a quantity that depends on time is compared: at instants that all levels have recorded ----


class OverTime(ABC):
    """A norm of differences over time; derive from it for one of your own.

    Examples
    --------
    >>> class MeanOverTime(OverTime):
    ...     def size(self, instants, difference):
    ...         return float(abs(difference).mean())
    >>> MeanOverTime().size(np.array([0.0, 1.0]), np.array([1.0, -3.0]))
    2.0
    """

    def select(self, instants: Floats) -> Floats:
        """Select the instants that count among the common ones ``(k,)``: all of them."""
        return instants

    @abstractmethod
    def size(self, instants: Floats, difference: Array) -> float:
        """Norm of a difference ``(k, ...)`` at these instants ``(k,)``."""


@checked
class MaximumOverTime(OverTime):
    """Largest Euclidean norm at any of the instants that all levels have in common.

    Examples
    --------
    >>> MaximumOverTime().size(np.array([0.0, 1.0]), np.array([[3.0, 4.0], [1.0, 0.0]]))
    5.0
    """

    def size(self, instants: Floats, difference: Array) -> float:
        """Largest norm of a row."""
        return float(_rows(difference).max())


@checked
class RootMeanSquare(OverTime):
    """L2 norm over time, divided by the root of the duration: in the unit of the quantity.

    Examples
    --------
    >>> t = np.linspace(0, 1, 1001)
    >>> round(RootMeanSquare().size(t, np.sin(2 * np.pi * t)), 6)
    0.707107
    """

    def size(self, instants: Floats, difference: Array) -> float:
        """Root of the mean of the squares, by the trapezoidal rule."""
        squares = _rows(difference) ** 2
        if len(instants) < 2:
            return float(np.sqrt(squares.mean()))
        return float(np.sqrt(trapezoid(squares, instants) / np.ptp(instants)))


@checked
class AtInstants(MaximumOverTime):
    """Largest Euclidean norm at these instants, which all levels must have recorded.

    Parameters
    ----------
    times : sequence of float
        In s.

    Raises
    ------
    InputError
        If they are no increasing finite numbers, or (in a study) were not recorded.

    Examples
    --------
    >>> AtInstants([0.5]).select(np.array([0.0, 0.25, 0.5])).tolist()
    [0.5]
    """

    def __init__(self, times: Sequence[float]):
        self.times = np.atleast_1d(numbers("AtInstants", "times", times))
        steps = np.diff(self.times, prepend=-np.inf, append=np.inf)  # NaN beside infinite times
        if not self.times.size or not (steps > 0).all():
            text = f"times = {times!r}, expected finite numbers, each larger than the one before"
            raise InputError("AtInstants", text)

    def select(self, instants: Floats) -> Floats:
        """The instants nearest to the times."""
        found = common_instants([instants, self.times])
        if len(found) < len(self.times):
            raise InputError(
                "AtInstants",
                f"times = {self.times.tolist()}, not all of which all levels have recorded:"
                " choose steps that divide them",
            )
        return found


def common_instants(times: Sequence[Floats]) -> Floats:
    """Instants that are in all of these sequences, to rounding.

    Examples
    --------
    >>> common_instants([np.array([0, 0.5, 1.0]), np.array([0, 0.25, 0.5 + 1e-14, 1.0])]).tolist()
    [0.0, 0.5, 1.0]
    """
    shared = times[0]
    for other in times[1:]:
        near = abs(shared - other[rows_at(other, shared)])
        shared = shared[near <= TOLERANCE * max(np.ptp(other), np.ptp(shared))]
    return shared


def rows_at(times: Floats, instants: Floats) -> Array:
    """Numbers of the states nearest to the instants.

    Examples
    --------
    >>> rows_at(np.array([0.0, 1.0, 2.0]), np.array([0.9, 2.0])).tolist()
    [1, 2]
    """
    return np.searchsorted((times[1:] + times[:-1]) / 2, instants)


def _rows(difference: Array) -> Floats:
    """Euclidean norm of each row."""
    flat = difference.reshape(len(difference), int(np.prod(difference.shape[1:])))
    return np.linalg.norm(flat, axis=1)


# -- what is looked at in the results of a study, level by level -----------------------------------

#: name of the only quantity of a problem that gives a number or an array
ONLY = "value"
#: name of the times in a mapping
TIMES = "t"


class Reading(NamedTuple):
    """Numbers of a quantity in a run, over time or one for all of it.

    Attributes
    ----------
    values : (...) or (K, ...) array
    times : (K,) array or None
        Instants (s); None: one value for the whole run.
    """

    values: Array
    times: Floats | None = None

    @property
    def finite(self) -> bool:
        """True if all values are finite."""
        return bool(np.isfinite(self.values).all())

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the value at an instant, or of the only one."""
        return np.shape(self.values)[self.times is not None :]

    def distances(self, other: Reading, apart_from: Floats) -> tuple[Floats, Floats]:
        """Distances (k,) from another run at the instants (k,) of this one.

        Parameters
        ----------
        other : Reading
            With steps no longer than those of this one.
        apart_from : (j, 2) array
            Spans of time that do not count: both runs jump there at instants of their own.
        """
        a = self
        b = other
        if a.times is None or b.times is None:
            t, mine, others = np.zeros(1), a.values[None], b.values[None]
        else:
            t = a.times
            counts = (t >= b.times[0]) & (t <= b.times[-1] * (1 + 1e-12))
            for first, last in apart_from:
                counts &= (t < first) | (t > last)
            t = t[counts]
            mine = a.values[counts]
            others = b.at(t)
        least = ROUNDING * np.nan_to_num(abs(a.values)).max(initial=0.0)
        same = np.isnan(mine) & np.isnan(others)  # as of an event that comes in neither run
        gap = _rows(np.where(same, 0.0, mine - others))
        return t, np.where(np.isnan(gap), np.inf, np.maximum(gap, least))

    def at(self, t: Floats) -> Array:
        """Values at instants (k,): its own, or between them by cubic splines."""
        assert self.times is not None
        times, first = np.unique(self.times, return_index=True)
        values = np.asarray(self.values)[first]
        nearest = rows_at(times, t)
        if abs(times[nearest] - t).max(initial=0.0) <= TOLERANCE * abs(times).max():
            return values[nearest]
        return CubicSpline(times, values)(t)


#: readings of runs by the names of runs and quantities
Samples = Mapping[str, Mapping[str, Reading]]


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
    >>> float(wanted.sample(4.0, "level 1")["twice"].values)
    8.0
    """

    def __init__(self, given: Any, over: OverTime | None = None):
        if over is not None:
            check_kind("argument norm", over, OverTime, ", such as MaximumOverTime()")
        self.over = over
        self.given = {}
        if given is None:
            return
        if isinstance(given, str) or not isinstance(given, (Mapping, Sequence)) or not given:
            raise InputError(
                "argument quantities", f"{given!r}, expected names, or functions by name"
            )
        self.given = dict(given if isinstance(given, Mapping) else zip(given, given, strict=True))
        for name, what in self.given.items():
            if not isinstance(name, str) or not (isinstance(what, str) or callable(what)):
                raise InputError(
                    f"quantity {name!r}",
                    f"{what!r}, expected a function of the result or the name of an entry",
                )

    @property
    def names(self) -> list[str]:
        """Names, as far as known without a result."""
        return list(self.given)

    def norm(self, instants: Floats | None) -> Norm:
        """Size of differences at these instants (None: not compared over time)."""
        over = self.over
        if over is None or instants is None:
            return euclidean
        return partial(over.size, instants)

    def sample(self, result: Any, level: str) -> dict[str, Reading]:
        """The quantities of a result.

        Raises
        ------
        InputError
            If one of them is not in the result, or is no number or array.
        """
        times = None
        if self.over is not None:
            if not isinstance(result, (Mapping, History)) or TIMES not in result:
                raise InputError(
                    "argument norm",
                    f"is one over time, but the problem gave a {type(result).__name__} without"
                    f" times at {level}: expected a History or a mapping with {TIMES!r}",
                )
            times = np.asarray(result[TIMES], float)
        if not self.given and isinstance(result, History):
            raise InputError(
                "argument quantities",
                "None, but the problem gives a History: say what is looked at, such as"
                ' quantities={"tip": lambda history: history["q"][-1, -12:-9]}',
            )
        if not self.given and not isinstance(result, Mapping):
            result = {ONLY: result}
        found = {}
        for name, what in (self.given or {str(k): k for k in result if k != TIMES}).items():
            entry = _entry(what, result, times is not None)
            values = numeric(f"quantity {name!r}", entry, f"numbers at {level}")
            if times is not None and values.shape[:1] != times.shape:
                raise InputError(
                    f"quantity {name!r}",
                    f"shape {values.shape} at {level}, expected one entry for each of the"
                    f" {len(times)} states, as it is compared over time",
                )
            found[name] = Reading(values, times)
        return found


def _entry(what: Any, result: Any, over_time: bool) -> Any:
    """A function of the result, or what it has under a name: over time, or at its end."""
    if callable(what):
        return what(result)
    if isinstance(result, History):
        return result[what] if over_time else result[what][-1]
    known = result if isinstance(result, Mapping) else ()
    if what not in known:
        kind = type(result).__name__
        text = f"unknown; {names_known(what, known)} (the problem gave a {kind})"
        raise InputError(f"quantity {what!r}", text)
    return result[what]


def numeric(item: str, value: Any, expected: str) -> Array:
    """An array of numbers, or an error saying what is expected."""
    try:
        array = np.asarray(value)
    except ValueError:  # rows of different lengths
        array = np.empty(0)
    if array.dtype.kind not in "biufc" or not array.size:
        raise InputError(item, f"{value!r}, expected {expected}")
    return array if array.dtype.kind == "c" else array.astype(float)


def aligned(
    name: str, samples: Samples, over: OverTime | None
) -> tuple[dict[str, Array], Floats | None]:
    """Values of a quantity by level, at the instants that all levels share.

    Raises
    ------
    InputError
        If shapes differ from level to level, or there are no common instants.
    """
    item = f"quantity {name!r}"
    instants = None
    for level, sample in samples.items():
        if name not in sample:
            raise InputError(item, f"missing at {level}")
    readings = {level: sample[name] for level, sample in samples.items()}
    values = {level: each.values for level, each in readings.items()}
    if over is not None:
        instants = common_instants([np.asarray(each.times) for each in readings.values()])
        if not len(instants):
            text = "no instant that all levels have recorded: choose steps that divide each other"
            raise InputError(item, text)
        instants = over.select(instants)
        values = {level: each.at(instants) for level, each in readings.items()}
    shapes = {each.shape: f"{each.shape} at {level}" for level, each in values.items()}
    if len(shapes) > 1:
        raise InputError(
            item,
            f"shape {', '.join(shapes.values())}: expected the same on all levels, such as values"
            " at some points",
        )
    return values, instants


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

    def __init__(self, runs: Mapping[str, Any] | None = None):
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

    def __init__(self, **arguments: Any):
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
    ):
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

    def __init__(self, values: Any, errors: float | Mapping[str, float]):
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
    if isinstance(given, (ReferenceKnown, others)):
        return given
    if levels:
        return Reference() if given is None else ReferenceKnown(given, {})
    if isinstance(given, History):
        given = partial(_given, given)
    if callable(given):
        return Reference({FINE: given})
    if given is None or isinstance(given, (str, Reference)):
        raise InputError(
            "argument reference",
            f"{given!r}, expected values, ReferenceKnown, ReferencePair or a function of the"
            " problem",
        )
    return ReferenceKnown(given, {})
