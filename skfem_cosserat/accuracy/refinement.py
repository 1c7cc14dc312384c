"""Refinement studies in one call: levels, tables, verdicts and charts."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import skfem

from ..arguments import checked
from ..errors import InputError
from ..export import write_paraview
from ..export.table import WIDE, Report, ResultTable, TableRow, column_names, provenance
from ..history import History
from ..types import Array, FilePath, Floats, Meta, check_kind, positive, switch, whole
from ..warn import Notice, counted, told
from .chart import Line, convergence_chart
from .orders import ROUNDING, Convergence, convergence, left
from .reading import (
    OverTime,
    Quantities,
    Reference,
    ReferenceFinest,
    ReferenceKnown,
    Samples,
    aligned,
    reference_of,
)
from .run import (
    Executor,
    Job,
    OnOutcome,
    Outcome,
    case_name,
    check_call,
    in_words,
    longest,
    run_study,
    text,
    title_of,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure


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
        longest,
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
    steps = _values("step", step)
    switched = switch("argument together", together)
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
    kind = ARGUMENTS[name]
    label = f"argument {name}"
    single = np.isscalar(given) or isinstance(given, (skfem.Mesh, Mapping))
    values = [kind.fits(label, each) for each in ([given] if single else given)]
    if any(a <= b for a, b in pairwise(map(kind.size, values))):
        shown = ", ".join(map(text, values))
        raise InputError(label, f"({shown}), expected {kind.way}, coarsest level first")
    return values


# -- what came of a refinement study: tables, verdicts, charts -------------------------------------


class Held(NamedTuple):
    """Argument that a series did not vary, and the error that it brings to a quantity.

    Attributes
    ----------
    error : float
        Bound of the error by it, in the norm of the study; NaN: not known.
    words : str
        Its name and value, and where the bound is from, or why there is none.
    """

    error: float
    words: str


@checked
@dataclass(frozen=True, eq=False)
class Refinement(Report):
    """Result of :func:`refine`.

    Quantities are found by their names; with several series (orders) by name and series:
    ``"tip, order = 2"``.

    Attributes
    ----------
    title : str
        Name of the problem.
    series : list of Series
        Levels of each series: arguments by name, coarsest first.
    quantities : list of str
        Names of the quantities.
    outcomes : dict
        By the name of the level: value or error of the problem, seconds.
    orders : dict of Convergence
        Errors, observed orders and verdict of each quantity.
    values : dict of dict
        By quantity: values by the name of the level, as they were compared.
    held : dict of list of Held
        By quantity, as `orders`: errors by what was not varied. Uncertainties include them; where
        one is not known there are none.
    notes : dict
        What went into the study, for the head of the table.

    Examples
    --------
    >>> from skfem_cosserat import refine
    >>> def area(elements):  # of a polygon in a circle
    ...     return elements / 2 * np.sin(2 * np.pi / elements)
    >>> study = refine(area, elements=(8, 16, 32, 64))
    >>> study.asymptotic, round(study.orders["value"].order, 2)
    (True, 1.99)
    >>> error, uncertainty = study.estimate["value"]
    >>> abs(study.errors["value"][-1] - (np.pi - area(64))) < uncertainty < 0.2 * error
    True
    >>> study.rows[1]["elements"], study.rows[1]["status"]
    (16, 'ok')
    """

    title: str
    series: list[Series]
    quantities: list[str]
    outcomes: dict[str, Outcome]
    orders: dict[str, Convergence]
    values: dict[str, dict[str, Array]]
    held: dict[str, list[Held]]
    notes: Meta

    @property
    def verdicts(self) -> dict[str, str]:
        """Verdict on the order of each quantity, in words."""
        return {name: each.verdict for name, each in self.orders.items()}

    @property
    def asymptotic(self) -> bool:
        """True if the errors of all quantities fall as a power of the size."""
        return bool(self.orders) and all(each.asymptotic for each in self.orders.values())

    @property
    def errors(self) -> dict[str, Floats]:
        """Error of each level; see :class:`Convergence` for what they are against."""
        return {name: each.errors for name, each in self.orders.items()}

    @property
    def extrapolated(self) -> dict[str, Array | None]:
        """Richardson's values; None where the levels do not bear one."""
        return {name: each.extrapolated for name, each in self.orders.items()}

    @property
    def estimate(self) -> dict[str, tuple[float, float]]:
        """Error of the finest level that was solved, and how far to trust that number.

        The second number is NaN where the levels bear no extrapolated value and there is no
        reference: the first one is then the difference between the two finest levels, a hint at
        the size of the error. It is NaN, too, where the error by what was held is not known (see
        `held`). With a single level both are NaN.
        """
        found = {}
        for name, each in self.orders.items():
            last = max(np.flatnonzero(np.isfinite(each.errors)), default=-1)
            found[name] = float(each.errors[last]), float(each.uncertainties[last])
        return found

    @property
    def failed(self) -> dict[str, str]:
        """Levels without a result, and why."""
        return {
            name: f"{each.status}: {_reason(each)}".rstrip(": ")
            for name, each in self.outcomes.items()
            if each.status != "ok"
        }

    @property
    def warnings(self) -> dict[str, Sequence[Notice]]:
        """Warnings of each level that gave some, as in ``history.meta["warnings"]``."""
        return {name: each.warnings for name, each in self.outcomes.items() if each.warnings}

    @property
    def rows(self) -> list[TableRow]:
        """One row a level, also of those that failed.

        With ``series``, the arguments, ``size``, ``status`` (``ok``, ``diverged``, ``error``,
        ``interrupted``, ``not run``), ``reason``, ``seconds``, ``warnings`` (in
        words, empty without any), and for each
        quantity its numbers (if they are few), ``error_``, ``uncertainty_``, ``difference_`` and
        ``order_`` with its name.
        """
        return [self._row(s, *each) for s in self.series for each in enumerate(s.levels)]

    def _row(self, series: Series, k: int, level: str) -> TableRow:
        outcome = self.outcomes[level]
        row: TableRow = {"series": series.label} if len(self.series) > 1 else {}
        for name, value in series.levels[level].items():
            row[name] = value if isinstance(value, (int, float)) else text(value)
        row |= {
            "size": float(series.sizes[k]),
            "status": outcome.status,
            "reason": _reason(outcome),
        }
        row |= {"seconds": outcome.seconds, "warnings": told(outcome.warnings)}
        for name in self.quantities:
            found = self.orders[series.key(name)]
            row |= _columns(name, self.values[name].get(level))
            numbers = {"error": found.errors, "uncertainty": found.uncertainties}
            numbers |= {"difference": found.differences, "order": found.observed}
            row |= {f"{what}_{name}": float(each[k]) for what, each in numbers.items()}
        return row

    @property
    def table(self) -> ResultTable:
        """The rows, with verdicts, versions, machine and commit."""
        notes = {"refinement": self.title, **self.notes, "verdicts": self.verdicts}
        notes["extrapolated"] = {
            name: value.tolist()
            for name, value in self.extrapolated.items()
            if value is not None and np.isrealobj(value)
        }
        notes["held"] = {n: [each.words for each in held] for n, held in self.held.items() if held}
        return ResultTable(self.rows, notes | provenance())

    def chart(
        self,
        path: FilePath | None = None,
        units: str | Mapping[str, str] | None = None,
        title: str | None = None,
    ) -> Figure:
        """Errors over sizes, both logarithmic, with a slope where the order is trusted.

        Levels that failed are crosses at the foot, errors that are hints only have open markers.

        Parameters
        ----------
        path : path-like, optional
            Write it here (``.png``, ``.svg``, ``.pdf``).
        units : str or mapping, optional
            Of the errors, by quantity, for the names of the axes; empty: they are relative.
        title : str, optional
            Default: the name of the problem.

        Raises
        ------
        InputError
            If the folder does not exist, or no level was solved.
        ImportError
            Without matplotlib.
        """
        if not self.orders:
            name, why = next(iter(self.failed.items()))
            raise InputError(self.title, f"no level was solved; {name}: {why}")
        panels = {
            name: [
                Line(
                    each.label,
                    each.kind,
                    self.orders[each.key(name)],
                    np.array([level not in self.failed for level in each.levels]),
                )
                for each in self.series
            ]
            for name in self.quantities
        }
        return convergence_chart(panels, self.title if title is None else title, path, units)

    def paraview(
        self, folder: FilePath, every: int = 1, fps: float | None = None
    ) -> dict[str, list[Path]]:
        """Write the history of each level as a series of its own: ``folder/elements_8/beams.pvd``.

        Parameters
        ----------
        folder : path-like
            Made if needed.
        every, fps
            See :func:`write_paraview`.

        Returns
        -------
        dict
            The files to open, by level; levels that failed are written as far as they came.

        Raises
        ------
        InputError
            If the problem gave no histories.
        """
        written = {}
        for name, outcome in self.outcomes.items():
            history = outcome.value if outcome.ok else getattr(outcome.error, "history", None)
            if outcome.ok and not isinstance(history, History):
                raise InputError(
                    f"level {name!r}",
                    f"its result is a {type(history).__name__}, ParaView series need a History",
                )
            if isinstance(history, History):
                part = re.sub(r"[^\w.+-]+", "_", name)
                written[name] = write_paraview(history, Path(folder) / part, every, fps)
        return written

    def __str__(self) -> str:
        failed = f", {len(self.failed)} failed" if self.failed else ""
        lines = [f"refinement of {self.title}: {len(self.outcomes)} levels{failed}"]
        for series in self.series:
            for key in map(series.key, self.quantities):
                found = self.orders[key]
                limit = self.orders[key].extrapolated
                lines.append(f"{key}: {found.verdict}")
                if limit is not None and limit.size <= WIDE:
                    numbers = ", ".join(f"{each:.9g}" for each in limit.ravel())
                    numbers += _band(found.uncertainty)
                    lines.append(f"  extrapolated in {' and '.join(series.varied)}: {numbers}")
                lines += self._lines(series, found)
                lines += [f"  {each.words}" for each in self.held[key]]
        if not self.orders:  # no level came to its quantities
            lines += [f"  {name}: {why}" for name, why in self.failed.items()]
        lines += [f"warned: {name}: {told(each)}" for name, each in self.warnings.items()]
        return "\n".join(lines)

    def _lines(self, series: Series, found: Convergence) -> list[str]:
        """A line a level: its error, or what it changes, and its order; or why there is none."""
        lines, change, width = [], "-", max(map(len, self.outcomes))
        hints = (np.isnan(found.errors) == np.isnan(found.differences)).all()
        for k, level in enumerate(series.levels):
            words = f"error {found.errors[k]:.3e}{_band(found.uncertainties[k])}"
            if hints:  # nothing to be compared with
                words = f"change {change}"
            if np.isfinite(found.observed[k]):
                words += f"  order {found.observed[k]:.2f}"
            if level not in self.failed:
                change = f"{found.differences[k]:.3e}"
            lines.append(f"  {level:{width}s}  {self.failed.get(level, words)}")
        return lines

    def __repr__(self) -> str:
        verdicts = "; ".join(f"{name}: {verdict}" for name, verdict in self.verdicts.items())
        count = sum(map(len, self.warnings.values()))
        return f"<Refinement of {self.title}: {verdicts}{counted(count)}>"


def _columns(name: str, value: Array | None) -> dict[str, Any]:
    """Numbers of a quantity under their names, if they are few."""
    if value is None or value.size > WIDE:
        return {}
    row = value.ravel() if value.size == 1 else value.reshape(1, -1)
    return dict(zip(column_names(name, row), value.ravel().tolist(), strict=True))


def _band(uncertainty: float) -> str:
    return f" +- {uncertainty:.1e}" if np.isfinite(uncertainty) else ""


def _reason(outcome: Outcome) -> str:
    return in_words(outcome.error) if outcome.error else ""


# -- refinement studies in one call ----------------------------------------------------------------


@checked
def refine(
    problem: Callable[..., Any],
    *,
    elements: int | Sequence[int] | Mapping[int, Sequence[int]] | None = None,
    mesh: Any = None,
    order: int | Sequence[int] | None = None,
    step: float | Sequence[float] | None = None,
    quantities: Mapping[str, Any] | Sequence[str] | None = None,
    norm: OverTime | None = None,
    reference: Any = None,
    rounding: float = ROUNDING,
    together: bool = True,
    probe: bool = True,
    executor: Executor | None = None,
    folder: FilePath | None = None,
    retry: bool = False,
    progress: bool | OnOutcome = False,
) -> Refinement:
    """Solve a problem on finer and finer meshes and steps, and say how far to trust the numbers.

    Parameters
    ----------
    problem : callable
        Called as ``problem(elements=8, order=3, step=1e-3)``, with those arguments by keyword that
        are given here (other ones by ``functools.partial``). Gives a number, an array, a mapping
        of named numbers and arrays, or a History. What it raises makes that level a failed one.
    elements : int, sequence of int, or mapping
        A sequence is varied, a single value is held; so for the others. Number of elements, as the
        problem understands it; growing. The size is its inverse. A mapping has a sequence for each
        order: high orders are at rounding where low ones begin.
    mesh : mesh, sequence of meshes, or mapping
        Instead: meshes, finer and finer. The size is the longest element.
    order : int or sequence of int
        Of the elements; several make several series, one an order.
    step : float or sequence of float
        In time, or whatever the problem makes of it; falling.
    quantities : mapping or sequence of str, optional
        Functions of the result by name, ``{"tip": lambda history: ...}``: they are called in this
        process. Names instead of functions: entries of a mapping, series of a History (without
        `norm` their last state). Default: all entries of a mapping (but ``"t"``), or the number or
        array itself under the name ``"value"``.
    norm : OverTime, optional
        :class:`~skfem_cosserat.accuracy.MaximumOverTime`,
        :class:`~skfem_cosserat.accuracy.RootMeanSquare` or
        :class:`~skfem_cosserat.accuracy.AtInstants`.
        Compare over time, at instants that all levels have recorded: quantities must then have one
        entry for each state of the History (or entry of ``"t"`` of a mapping). Default: values are
        compared as they are, by the Euclidean norm.
    reference : optional
        True values: a number or array (of the only quantity) or a mapping by quantity, each also a
        function (of the instants, if compared over time), or :class:`ReferenceKnown`;
        :class:`~skfem_cosserat.accuracy.ReferenceRun`, another call of the problem;
        :class:`ReferenceFinest`. None: levels
        are compared with each other, and errors are against the value that Richardson
        extrapolation gives.
    rounding : float, optional
        Error of the quantities by rounding and unfinished iterations, relative to their largest
        values. Levels whose error is not 100 times that do not count for the order. Default: 64
        times the machine precision; what stops falling below 1e-8 is taken for rounding in any
        case.
    together : bool
        Mesh and step, if both are sequences: refined at once, level by level (the order is
        that in the size of the elements), or each for itself with the finest of the other, as two
        series.
    probe : bool
        Solve the finest level once more, with half of a step that is held, or twice the elements,
        so that uncertainties have its error in them, too. False, and where it fails: what is held
        is named, and there are no uncertainties. (Not with true values as the reference. Of what
        the problem holds by itself, such as a step that is no argument, nothing is known.)
    executor : executor, optional
        See :func:`run_all`: levels side by side; the problem must then be at the top level of a
        module.
    folder : path-like, optional
        Keep the result of each level here as soon as it is there. The same call finds them again,
        after an interruption too, also with more levels or other quantities. How a level is known
        again is in :func:`run_all`: an edited problem needs another folder.
    retry : bool
        Solve levels again that are kept as failed.
    progress : bool or callable
        True: one line on stderr; a callable gets (levels done, levels, outcome).

    Returns
    -------
    Refinement
        Orders with confidence, errors, extrapolated values, table, chart.

    Raises
    ------
    InputError
        For bad arguments, before the first level; for quantities that are unknown, no numbers or
        of changing shape as soon as that is seen.

    Notes
    -----
    An order is given if there are four levels (with errors, against a reference, or differences,
    without, above 100 times rounding), by the three finest of them, and if the observed order has
    settled: changed by at most 0.1 (5 % for orders above 2) between the last pairs of levels and by
    four times as much before (as if sizes were halved), without a change of sign. It is then
    ``order 2.00 +- 0.02 (three finest of five levels)``, where the number after +- is twice that
    last change; otherwise the verdict says what was seen. Levels that failed are left out.

    Steps over which loads jump, and singular points, spoil orders: the verdict shows it.

    ``print(study)`` shows the error of each level, as far as it is known. If the levels bear no
    extrapolated value, and there is no reference, it shows by how much each level changed the
    value of the level before it.

    Examples
    --------
    The tip of a cantilever that is bent by 60 degrees, on meshes of linear elements:

    >>> import skfem_cosserat as sc
    >>> def bent(elements, order):
    ...     mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), elements, name="rod")
    ...     section = sc.Section([1e4, 1e4, 1e4, 1, 1, 1], mass=1.0, inertia=(1.0, 1.0))
    ...     model = sc.Model()
    ...     rod = model.add("rod", sc.Beam(mesh, section, order=order))
    ...     model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), rod.node("rod.start")))
    ...     model.add("push", sc.LoadForce(rod.node("rod.end"), (0, 3.0, 0)))
    ...     return sc.static(model, watch=False)["q"][-1, 12 * elements :][:3]
    >>> study = refine(bent, elements=(8, 16, 32, 64), order=1)
    >>> print(study)  # doctest: +ELLIPSIS
    refinement of bent: 4 levels
    value: order 2.02 +- 0.14 (three finest of four levels)
      extrapolated in elements: 0.745578655, 0.603555909, 0 +- 4.2e-05
      elements = 8, order = 1   error 1.164e-02 +- 4.2e-05
      ...
      elements = 64, order = 1  error 1.675e-04 +- 4.2e-05  order 2.02
    """
    plan = _Plan(
        series_of(elements, mesh, order, step, together),
        Quantities(quantities, norm),
        reference_of(reference, levels=True),
        positive("argument rounding", "value", rounding),
        switch("argument probe", probe),
    )
    for arguments in plan.calls.values():
        check_call(problem, arguments)
    jobs = [Job(name, problem, **arguments) for name, arguments in plan.calls.items()]
    title = title_of(problem)
    outcomes = run_study(
        (f"refinement of {title}", "levels", "study.rows, print(study)"),
        jobs,
        executor,
        folder=folder,
        progress=progress,
        check=plan.check,
        retry=switch("argument retry", retry),
    )
    return plan.result(title, {each.name: each for each in outcomes})


class _Plan:
    """The calls of a study, and what is made of their outcomes."""

    def __init__(
        self,
        series: list[Series],
        wanted: Quantities,
        reference: Reference,
        rounding: float,
        probe: bool,
    ):
        self.series, self.wanted, self.reference = series, wanted, reference
        self.rounding = rounding
        self.levels = {name: each.levels[name] for each in series for name in each.levels}
        finest = [*self.levels.values()][-1]
        self.runs = {case_name(finest | each): finest | each for each in reference.runs.values()}
        self.true = isinstance(reference, ReferenceKnown)
        varied = {name for each in series for name in each.varied}
        probes = [
            each.probe(name)
            for each in series
            for name in each.held
            if probe and not self.true and name not in varied
        ]
        self.calls = self.levels | self.runs | {case_name(each): each for each in probes}
        self.quantities: list[str] = []
        if wanted.names:
            reference.check(wanted.names, every=False)

    def check(self, outcome: Outcome) -> None:
        """Look at the first result: what is wrong with the quantities ends the study early."""
        if outcome.status == "ok" and not self.quantities:
            self.quantities = list(self.wanted.sample(outcome.value, outcome.name))
            self.reference.check(self.quantities, every=False)

    def result(self, title: str, outcomes: dict[str, Outcome]) -> Refinement:
        """Judge each quantity in each series."""
        samples = {}
        for name, outcome in outcomes.items():
            if outcome.status == "ok":
                samples[name] = self.wanted.sample(outcome.value, name)
                bad = [quantity for quantity, each in samples[name].items() if not each.finite]
                if bad:
                    lost = ArithmeticError(f"quantity {bad[0]!r} is not finite")
                    outcomes[name] = replace(outcome, error=lost)
        for run in self.runs:
            if not outcomes[run].ok:
                raise InputError("argument reference", f"its run failed: {outcomes[run].error}")
        quantities = self.quantities if self.levels.keys() & samples else []
        levels = {name: outcomes[name] for name in self.levels}
        notes = {"reference": self.reference.about}
        study = Refinement(title, self.series, quantities, levels, {}, {}, {}, notes)
        for name in quantities:
            self._judge(name, samples, outcomes, study)
        return study

    def _judge(
        self, name: str, samples: Samples, outcomes: Mapping[str, Outcome], study: Refinement
    ) -> None:
        """Values and orders of a quantity, and what is held, into the study."""
        compared = {each: samples[each] for each in self.levels | self.runs if each in samples}
        shared, instants = aligned(name, compared, self.wanted.over)
        norm = self.wanted.norm(instants)
        noise = self.rounding
        shape = next(iter(shared.values())).shape
        runs = [shared[run] for run in self.runs]
        known, off = self.reference.of(name, shape, instants, runs, norm)
        size = max(map(norm, shared.values()))
        if off > 0 and size > 0:  # differences below the reference's own error tell no order
            noise = max(off / size, noise)
        finest = isinstance(self.reference, ReferenceFinest)
        study.values[name] = {
            level: shared[level] for each in self.series for level in each.levels if level in shared
        }
        judged = {
            each.key(name): convergence(
                each.sizes, [*map(shared.get, each.levels)], norm, known, noise, finest
            )
            for each in self.series
        }
        for series, (key, found) in zip(self.series, judged.items(), strict=True):
            verdict = found.verdict
            if len(series.varied) > 1 and verdict.startswith("not in the asymptotic range"):
                verdict += "; mesh and step, refined at once, may have orders of their own: see"
                verdict += " together=False"
            arguments = [] if self.true else series.held
            study.held[key] = held = [
                self._held(name, series, each, samples, outcomes, judged) for each in arguments
            ]
            error = sum(each.error for each in held)
            study.orders[key] = found._replace(
                verdict=verdict,
                uncertainties=found.uncertainties + error,
                uncertainty=found.uncertainty + error,
            )

    def _held(
        self,
        name: str,
        series: Series,
        argument: str,
        samples: Samples,
        outcomes: Mapping[str, Outcome],
        judged: Mapping[str, Convergence],
    ) -> Held:
        """Error that a fixed argument of a series brings to a quantity at its finest level."""
        finest = series.finest
        probe = case_name(series.probe(argument))
        error = np.nan
        words = "it was not probed"
        other = [each for each in self.series if argument in each.varied]
        if other:  # held at the finest level of a series of its own
            found = judged[other[0].key(name)]
            error = float(found.errors[-1] + found.uncertainties[-1])
            words = f"see the series {other[0].label!r}"
        elif probe in samples:
            pair = {each: samples.get(each, {}) for each in (finest, probe)}
            try:
                shared, instants = aligned(name, pair, self.wanted.over)
            except InputError as wrong:  # values at points of the mesh, or no instants in common
                words = str(wrong)
            else:
                change = self.wanted.norm(instants)(shared[probe] - shared[finest])
                error = float(change + left(change, order=1.0))  # the lowest that methods have
                words = f"{ARGUMENTS[argument].words} changes the finest level by {change:.1e}"
        elif probe in outcomes:
            words = f"{probe} failed: {outcomes[probe].error}"
        what = f"{argument} = {text(series.levels[finest][argument])}"
        if np.isfinite(error):
            return Held(error, f"{error:.1e} of each band by {what}, held: {words}")
        return Held(error, f"{what} was held, its error is not known: {words}")
