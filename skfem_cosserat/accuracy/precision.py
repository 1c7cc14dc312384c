"""Work and precision: what an error costs with each setup, as rows, fronts in words and a chart."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import product
from math import ceil, floor, isfinite, log10
from numbers import Real
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..arguments import checked
from ..errors import Diverged, InputError, JobError
from ..export.table import Report, ResultTable, TableRow, provenance
from ..history import History
from ..types import FilePath, Meta, names_known, positive
from ..warn import told
from .chart import Drawn, Row, pareto, precision_chart
from .orders import euclidean
from .reading import OverTime, Quantities, Reading, Reference, aligned, reference_of
from .run import (
    LATE,
    Caught,
    Executor,
    Job,
    OnOutcome,
    Outcome,
    TimeLimit,
    in_words,
    ran,
    run_study,
    time_limit,
    told_of,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure


# -- setups of a work-precision study: what is run, and what comes of one run ----------------------

#: how a run of a setup can end
STATUSES = ("ok", "diverged", "newton", "timeout", "error")
#: what a result of somebody else's may call "ok"
DONE = ("ok", "completed")
#: what a result may count
COUNTS = ("newton_iterations", "factorisations", "unknowns")
Run = Callable[[Any], Any]


class Setup(NamedTuple):
    """One way to solve a problem.

    Attributes
    ----------
    label : str
    run : callable
        ``run(problem)`` gives a History, or a mapping with the quantities and, if there are any,
        ``cost_s``, ``newton_iterations``, ``factorisations``, ``unknowns``, ``status``,
        ``reason``, ``kernels``.
    series : str
        Setups of one series are joined by a line in the chart.
    group : str
        The code it belongs to; each has a front of its own.

    Examples
    --------
    >>> Setup("midpoint rule", lambda problem: {"x": 1.0, "cost_s": 0.1}).run(None)["x"]
    1.0
    """

    label: str
    run: Run
    series: str = ""
    group: str = ""


class Measured(NamedTuple):
    """The result of the run for the error, and the cost of each timed run (s)."""

    result: Any
    costs: tuple[float, ...]


@checked
def setup_grid(
    run: Callable[..., Any],
    *,
    group: str = "",
    **axes: Any,
) -> list[Setup]:
    """Setups for all combinations: integrator x treatment x order x mesh x step.

    Parameters
    ----------
    run : callable
        Called as ``run(problem, integrator=..., step=...)`` with one value of each axis.
    group : str
        See :class:`Setup`.
    **axes
        Sequences of values, or mappings from their names to values. Along the last one the points
        of the chart are joined by lines.

    Raises
    ------
    InputError
        If an axis is empty or no sequence.

    Examples
    --------
    >>> import skfem_cosserat as sc
    >>> schemes = {"energy-momentum": sc.EnergyMomentum(), "variational": sc.Variational()}
    >>> setups = setup_grid(print, integrator=schemes, order=(1, 2), step=(0.1, 0.05))
    >>> len(setups), setups[0].label
    (8, 'energy-momentum, order = 1, step = 0.1')
    >>> setups[0].series
    'energy-momentum, order = 1'
    """
    if not callable(run):
        raise InputError("argument run", f"{run!r} cannot be called")
    named = {axis: _named(axis, values) for axis, values in axes.items()}
    found = []
    for choice in product(*(each.items() for each in named.values())):
        values = {axis: value for axis, (_, value) in zip(named, choice, strict=True)}
        words = [name for name, _ in choice]
        series = ", ".join(words[:-1])
        found.append(Setup(", ".join(words), partial(run, **values), series, group))
    return found


def _named(axis: str, values: Any) -> dict[str, Any]:
    """The values of an axis by their names in a label."""
    if isinstance(values, Mapping):
        named = {str(name): value for name, value in values.items()}
    elif isinstance(values, str) or not isinstance(values, Iterable):
        raise InputError(f"axis {axis!r}", f"{values!r}, expected values, or values by name")
    else:
        named = {_word(axis, value): value for value in values}
    if not named:
        raise InputError(f"axis {axis!r}", "is empty, expected at least one value")
    return named


def _word(axis: str, value: Any) -> str:
    if isinstance(value, str):
        return value
    return f"{axis} = {value:g}" if isinstance(value, float) else f"{axis} = {value}"


def as_setups(given: Any) -> list[Setup]:
    """Setups from pairs (label, function); with different labels.

    Raises
    ------
    InputError
        If there are none, or one is something else.
    """
    expected = "expected a list of (label, function of the problem)"
    if isinstance(given, (str, Mapping)) or not isinstance(given, Iterable):
        raise InputError("argument setups", f"{given!r}, {expected}")
    found = []
    labels = set()
    for each in given:
        if not isinstance(each, (tuple, list)) or not 2 <= len(each) <= len(Setup._fields):
            raise InputError("argument setups", f"{each!r}, {expected}")
        setup = Setup(*each)
        if not isinstance(setup.label, str) or not setup.label:
            raise InputError("argument setups", f"label {setup.label!r}, expected a name")
        if not callable(setup.run):
            raise InputError(f"setup {setup.label!r}", f"{setup.run!r} cannot be called")
        if setup.label in labels:
            raise InputError("argument setups", f"two setups are called {setup.label!r}")
        labels.add(setup.label)
        found.append(setup)
    if not found:
        raise InputError("argument setups", f"is empty, {expected}")
    return found


def measure(
    label: str,
    problem: Any,
    run: Run,
    repeats: int,
    clock: Callable[[], float],
    timeout_s: float | None,
) -> Measured:
    """One run for the result, which warms up, then `repeats` runs for the cost.

    Raises
    ------
    TimedOut
        If one of them takes longer than `timeout_s`.
    JobError
        If the run for the result was interrupted.
    """
    with TimeLimit(timeout_s):
        result = run(problem)
    if isinstance(result, History) and result.status == "interrupted":
        raise JobError(label, "it was interrupted")
    costs: list[float] = []
    while ended(result)[0] == "ok" and len(costs) < repeats:
        with TimeLimit(timeout_s):
            begun = clock()
            again = run(problem)
            seconds = clock() - begun
        state, reason = ended(again)
        if state != "ok":
            return Measured({"status": state, "reason": f"when timed: {reason}"}, ())
        if isinstance(again, Mapping) and again.get("cost_s") is not None:
            seconds = positive("result", "cost_s", again["cost_s"], " of seconds")
        costs.append(seconds)
    return Measured(result, tuple(costs))


def ended(result: Any) -> tuple[str, str]:
    """Status and reason of a history, of a mapping with a status, or of an error.

    A step that Newton's method could not solve is ``newton``; numbers that left all bounds, and a
    :class:`Diverged` that tells of no iterations, are ``diverged``.
    """
    if isinstance(result, Exception):
        state = "timeout" if isinstance(result, LATE) else "error"
        if isinstance(result, Diverged):
            state = "newton" if result.residuals else "diverged"
        return "diverged" if isinstance(result, ArithmeticError) else state, in_words(result)
    if isinstance(result, History):
        bad = result.status in ("diverged", "failed", "killed")
        return ("newton", str(result.meta.get("failure", result.status))) if bad else ("ok", "")
    if not isinstance(result, Mapping) or result.get("status", "ok") in DONE:
        return "ok", ""
    state = str(result["status"])
    reason = str(result.get("reason", ""))
    return (state, reason) if state in STATUSES else ("error", f"{state}: {reason}".rstrip(": "))


# --------------------------------------------------------------------------------------------------
# What came of a work-precision study: rows, fronts in words, where one code is behind another.


@checked
@dataclass(frozen=True, eq=False)
class PrecisionTable(Report):
    """Result of :func:`work_precision`.

    Attributes
    ----------
    rows : list of dict
        One a setup, those that failed too: ``label``, ``cost_s`` (the smallest),
        ``newton_iterations``, ``factorisations``, ``unknowns`` (None: not told), ``error_`` with
        the name of each quantity (None if it failed), ``status`` (``ok``, ``diverged``,
        ``newton``, ``timeout``, ``error``), ``reason``; and ``group``, ``series``, ``spent_s``
        (time of all its runs), ``kernels`` (that ran, empty: not told),
        ``warnings`` (in words, empty without any).
    reference_errors : dict
        Error of the reference itself by quantity; NaN if not known. What all setups and the
        reference share, such as a mesh where steps are compared, is in no error of the table.
    notes : dict
        For the head of the table.

    Examples
    --------
    >>> from skfem_cosserat import work_precision
    >>> def crude(problem):
    ...     return {"x": problem + 0.1, "cost_s": 1.0}
    >>> def fails(problem):
    ...     raise ZeroDivisionError("no step left")
    >>> table = work_precision(2.0, [("crude", crude), ("fails", fails)], {"x": 2.0}, ["x"])
    >>> print(table)
    x: errors to a reference whose own error is not known; what all setups share is not in them
    x: for 1e+00 in x the cheapest is crude: 1.0e-01 in 1 s
    failed: fails: diverged (ZeroDivisionError: no step left)
    """

    rows: list[TableRow]
    reference_errors: dict[str, float]
    notes: Meta

    @classmethod
    def read(cls, path: FilePath) -> PrecisionTable:
        """A table that :meth:`csv` has written, for another chart.

        Raises
        ------
        InputError
            If the file cannot be read, or is none of a work-precision study.
        """
        stored = ResultTable.read(path)
        errors = stored.notes.get("reference error")
        if not isinstance(errors, dict):
            raise InputError(f"file {str(path)!r}", "is not of a work-precision study")
        nan = float("nan")
        text = ("label", "status", "reason", "group", "series", "kernels", "warnings")
        rows = [
            dict(row)
            | {name: str(row.get(name) or "") for name in text}
            | {"spent_s": nan if row.get("spent_s") is None else row["spent_s"]}
            for row in stored.rows
        ]
        own = {name: nan if error is None else float(error) for name, error in errors.items()}
        return cls(rows, own, dict(stored.notes))

    @property
    def quantities(self) -> list[str]:
        """Their names."""
        return list(self.reference_errors)

    @property
    def failed(self) -> dict[str, str]:
        """Setups that failed: status and reason by label."""
        bad = [row for row in self.rows if row["status"] != "ok"]
        return {row["label"]: f"{row['status']} ({row['reason']})" for row in bad}

    def points(self, quantity: str, group: str | None = None) -> list[TableRow]:
        """Rows with an error of the quantity and a cost, of one group or all.

        Raises
        ------
        InputError
            If there is no such quantity.
        """
        if quantity not in self.reference_errors:
            known = names_known(quantity, self.quantities)
            raise InputError(f"quantity {quantity!r}", f"unknown; {known}")
        return [
            row
            for row in self.rows
            if row["status"] == "ok" and row["cost_s"] is not None
            if group is None or row["group"] == group
        ]

    def front(
        self,
        quantity: str,
        errors: float | Sequence[float] | None = None,
        group: str | None = None,
    ) -> Front:
        """Find the cheapest setup that reaches each error.

        Parameters
        ----------
        quantity : str
        errors : float or sequence of float, optional
            Default: the powers of ten between the largest and the smallest error reached, down to
            that of the reference; 0 if there are no others.
        group : str, optional
            Only of this code.

        Raises
        ------
        InputError
            If there is no such quantity or an error is not positive.
        """
        points = self.points(quantity, group)
        if errors is None:
            levels = _decades(points, quantity, self.reference_errors[quantity])
        else:
            several = np.atleast_1d(np.asarray(errors, object))
            levels = [positive("argument errors", "error", each) for each in several]
        found = {level: _cheapest(points, quantity, level) for level in levels}
        return Front(quantity, found, pareto(points, quantity), self.reference_errors[quantity])

    def standing(self, quantity: str, ours: str | Callable[[Row], bool]) -> Standing:
        """Compare our front with that of each other group at every error that the group reaches.

        Parameters
        ----------
        quantity : str
        ours : str or callable
            Our group, or whether a row is ours.

        Raises
        ------
        InputError
            If there is no such quantity, or nothing is ours.
        """
        points = self.points(quantity)
        mine = [row for row in points if (ours(row) if callable(ours) else row["group"] == ours)]
        if not mine:
            raise InputError("argument ours", f"{ours!r}: no setup of it has an error and a cost")
        floor_ = self.reference_errors[quantity]
        levels = []
        others = [row for row in points if row not in mine]
        for group in dict.fromkeys(row["group"] for row in others):
            for row in pareto([r for r in others if r["group"] == group], quantity):
                error = row[f"error_{quantity}"]
                best = _cheapest(mine, quantity, error)
                levels.append(Level(group, error, row, best, not error < 2 * floor_))
        return Standing(quantity, levels)

    @property
    def table(self) -> ResultTable:
        """The rows, with the reference's error, versions, machine and commit."""
        own = {
            name: each if isfinite(each) else None for name, each in self.reference_errors.items()
        }
        notes = {"work and precision": f"{len(self.rows)} setups", **self.notes}
        return ResultTable(self.rows, notes | {"reference error": own} | provenance())

    def chart(
        self,
        path: FilePath | None = None,
        quantities: Iterable[str] | None = None,
        kind: Callable[[Row], str] | None = None,
        family: Callable[[Row], str] | None = None,
        cost: str = "seconds",
        units: str | Mapping[str, str] | None = None,
        most: int = 8,
    ) -> Figure:
        """Errors over costs, both logarithmic: a panel a quantity, a line a front.

        The front of each kind of setup is a line with marks, all its other setups are faint dots;
        the front of each group of several kinds is a broad step behind them. Setups that failed are
        crosses at the top, above the time they took until then; errors below that of the reference
        lie in the grey.

        Parameters
        ----------
        path : path-like, optional
            Write it here (``.png``, ``.svg``, ``.pdf``).
        quantities : iterable of str, optional
            Default: all.
        kind : callable, optional
            From a row to the name of its line; default: its group, or its series if there is one
            group only.
        family : callable, optional
            From a row to what has one colour, whose kinds differ in marks and dashes; default: each
            kind has its own. Integrators have the same in all charts,
            see :func:`~skfem_cosserat.figures.styles`.
        cost : str
            ``"seconds"``, ``"CPU seconds"`` (where results tell such a ``cost_s``),
            ``"iterations"``, ``"factorisations"`` or ``"unknowns"``; what does not tell it is not
            on the chart.
        units : str or mapping, optional
            Of the errors, by quantity, for the names of the axes; empty: they are relative.
        most : int
            Draw so many lines at most, the best one of each group and those that are nearest to the
            fronts; all other setups are grey dots.

        Raises
        ------
        InputError
            If the folder does not exist, or a quantity, or a cost.
        ImportError
            Without matplotlib.
        """
        several = len({row["group"] for row in self.rows}) > 1
        kind = kind or partial(_kind_by, "group" if several else "series")
        names = self.quantities if quantities is None else list(quantities)
        points = {name: self.points(name) for name in names}
        drawn = Drawn(self.rows, points, kind, family or kind, self.reference_errors)
        return precision_chart(drawn, path, cost, units, most)

    def __str__(self) -> str:
        lines = []
        for name, own in self.reference_errors.items():
            known = f"known to {own:.1e}" if isfinite(own) else "whose own error is not known"
            about = f"errors to a reference {known}; what all setups share is not in them"
            if found := self.front(name).lines:
                lines += [f"{name}: {line}" for line in (about, *found)]
        lines += [f"failed: {label}: {why}" for label, why in self.failed.items()]
        warned = [row for row in self.rows if row.get("warnings")]
        return "\n".join(lines + [f"warned: {row['label']}: {row['warnings']}" for row in warned])

    def __repr__(self) -> str:
        warned = sum(bool(row.get("warnings")) for row in self.rows)
        doubt = f", {warned} with warnings" if warned else ""
        return f"<PrecisionTable: {len(self.rows)} setups, {len(self.failed)} failed{doubt}>"


class Front(NamedTuple):
    """Cheapest setups for errors of a quantity.

    Attributes
    ----------
    quantity : str
    cheapest : dict
        Row by error; None where nothing reaches it.
    points : list of dict
        Rows that no other one beats in both error and cost, cheapest first.
    floor : float
        Error of the reference; NaN if not known.
    """

    quantity: str
    cheapest: dict[float, TableRow | None]
    points: list[TableRow]
    floor: float

    @property
    def lines(self) -> list[str]:
        """In words, a line an error."""
        lines = []
        for level, row in self.cheapest.items():
            start = f"for {level:.0e} in {self.quantity}"
            if row is None:
                lines.append(f"{start} nothing is good enough")
                continue
            error = row[f"error_{self.quantity}"]
            what = f"{row['group']}: {row['label']}" if row["group"] else row["label"]
            line = f"{start} the cheapest is {what}: {error:.1e} in {row['cost_s']:.3g} s"
            if error < 2 * self.floor:
                line += f", as far as the reference tells, known to {self.floor:.1e}"
            lines.append(line)
        return lines

    def __str__(self) -> str:
        return "\n".join(self.lines)


class Level(NamedTuple):
    """An error that a peer reaches, and what it costs.

    Attributes
    ----------
    group : str
        The peer.
    error : float
    theirs : dict
        The peer's row.
    ours : dict or None
        Our cheapest row with an error no larger.
    judged : bool
        False if the error is below twice that of the reference.
    """

    group: str
    error: float
    theirs: TableRow
    ours: TableRow | None
    judged: bool

    @property
    def ratio(self) -> float:
        """Our cost over theirs; infinite if we do not reach the error."""
        return float("inf") if self.ours is None else self.ours["cost_s"] / self.theirs["cost_s"]


class Standing(NamedTuple):
    """Our front against the others'.

    Attributes
    ----------
    quantity : str
    levels : list of Level
        The points of each peer's front.
    """

    quantity: str
    levels: list[Level]

    @property
    def behind(self) -> list[Level]:
        """Levels that the reference lets one judge where our cost is not the lower one."""
        return [level for level in self.levels if level.judged and not level.ratio < 1]

    @property
    def lines(self) -> list[str]:
        """In words: for each peer by how much, and where not."""
        lines = []
        for group in dict.fromkeys(level.group for level in self.levels):
            own = [each for each in self.levels if each.group == group and each.judged]
            if not own:
                lines.append(f"{group}: no error that the reference lets one judge")
                continue
            good = [1 / each.ratio for each in own if each.ratio < 1]
            times = f", {min(good):.3g} to {max(good):.3g} times" if good else ""
            head = f"{group}: cheaper at {len(good)} of the {len(own)} errors it reaches{times}"
            lines.append(head)
            for each in own:
                if each.ratio < 1:
                    continue
                theirs = f"{each.theirs['cost_s']:.3g} s"
                text = f"not reached, the peer takes {theirs}"
                if each.ours is not None:
                    cost = f"{each.ours['cost_s']:.3g} s against {theirs}"
                    text = f"{cost}, {each.ratio:.2f} times as much"
                lines.append(f"{group}: behind at {each.error:.1e} in {self.quantity}: {text}")
        return lines

    def __str__(self) -> str:
        return "\n".join(self.lines)


def _kind_by(what: str, row: Row) -> str:
    return str(row[what] or row["label"])


def _cheapest(points: Iterable[TableRow], quantity: str, error: float) -> TableRow | None:
    key = f"error_{quantity}"
    reach = [row for row in points if row[key] <= error]
    return min(reach, key=lambda row: (row["cost_s"], row[key]), default=None)


def _decades(points: Sequence[Row], quantity: str, reference: float) -> list[float]:
    """Powers of ten from the largest error reached down to the smallest one."""
    sizes = [row[f"error_{quantity}"] for row in points if row[f"error_{quantity}"] > 0]
    if not sizes:
        return [0.0] if points else []
    top = floor(log10(max(sizes)))
    bottom = ceil(log10(np.fmax(min(sizes), reference)))
    return [10.0**k for k in range(max(top, bottom), bottom - 1, -1)]


# -- work and precision: what an error costs, with one setup of the methods and another ------------


@checked
def work_precision(
    problem: Any,
    setups: Iterable[Any],
    reference: Any,
    quantities: Any,
    repeats: int = 3,
    executor: Executor | None = None,
    *,
    norm: OverTime | None = None,
    folder: FilePath | None = None,
    timeout_s: float | None = None,
    clock: Callable[[], float] = time.perf_counter,
    retry: bool = False,
    progress: bool | OnOutcome = False,
) -> PrecisionTable:
    """Run a problem with many setups and set their errors against their costs.

    Each setup runs once for its errors, which warms up caches and compiled code, too; then
    `repeats` times for its cost, of which the smallest counts.

    Parameters
    ----------
    problem : object
        Handed to the setups as it is: a scene, a function that builds one, numbers for a peer.
    setups : iterable
        Pairs (label, function of the problem) or :class:`~skfem_cosserat.accuracy.Setup`;
        :func:`~skfem_cosserat.accuracy.setup_grid` makes them. The function gives a History, or a
        mapping, see there: what another code computed in a subprocess, with its own ``cost_s``.
    reference : object
        True values: a number or array (of the only quantity), or a mapping by quantity, functions
        of the instants too if compared over time; their own error is then not known.
        :class:`~skfem_cosserat.accuracy.ReferenceKnown`: with errors.
        :class:`~skfem_cosserat.accuracy.ReferencePair`: two runs, of which the second one tells how
        good the first is. A function of the problem: one run; a History: what it gave.
    quantities : mapping or sequence of str
        As in :func:`~skfem_cosserat.refine`: functions of a result by name, called in this process.
    repeats : int
        Timed runs of each setup.
    executor : executor, optional
        See :func:`~skfem_cosserat.run_all`. Setups that run side by side disturb each other's
        clock, so do it with fewer workers than processors.
    norm : OverTime, optional
        Compare over time, at the instants that all runs have recorded.
    folder : path-like, optional
        Keep each setup here as soon as it is done, to go on after an interruption.
    timeout_s : float, optional
        Longest time of one run of a setup (s), see :class:`~skfem_cosserat.accuracy.TimeLimit`.
    clock : callable
        In seconds: ``time.perf_counter`` or ``time.process_time``. What a result says of its own
        cost (``cost_s``) comes first.
    retry : bool
        Run setups again that are kept as failed.
    progress : bool or callable
        See :func:`~skfem_cosserat.refine`.

    Returns
    -------
    PrecisionTable

    Raises
    ------
    InputError
        For bad arguments, before the first run; if a run of the reference failed or does not give
        the quantities, before the setups if one runs after the other; if no setup gave them.

    Notes
    -----
    A setup fails alone. Status ``newton``: a step could not be solved; ``diverged``: numbers that
    are not finite, an ArithmeticError, or a Diverged without residuals; ``timeout``: TimeoutError,
    or the limit given here; ``error``: all else.

    Examples
    --------
    Two rules for an integral, by the number of their points:

    >>> from skfem_cosserat.accuracy import setup_grid
    >>> def rule(problem, kind, count):
    ...     y = problem(np.linspace(0, 1, count + 1))
    ...     value = y[:-1].mean() if kind == "rectangles" else (y[:-1] + y[1:]).mean() / 2
    ...     return {"integral": value, "cost_s": 1e-6 * count}
    >>> setups = setup_grid(rule, kind=("trapezoid", "rectangles"), count=(10, 100, 1000))
    >>> table = work_precision(np.exp, setups, np.e - 1, ["integral"], repeats=1)
    >>> print(table.front("integral", [1e-2, 1e-4]))
    for 1e-02 in integral the cheapest is trapezoid, count = 10: 1.4e-03 in 1e-05 s
    for 1e-04 in integral the cheapest is trapezoid, count = 100: 1.4e-05 in 0.0001 s
    """
    chosen = as_setups(setups)
    truth = reference_of(reference, levels=False)
    wanted = Quantities(quantities, norm)
    if isinstance(repeats, bool) or not isinstance(repeats, (int, np.integer)) or repeats < 1:
        raise InputError("argument repeats", f"{repeats!r}, expected a positive integer")
    if not callable(clock):
        raise InputError("argument clock", f"{clock!r}, expected a function such as process_time")
    if wanted.names:
        truth.check(wanted.names)
    clash = [setup.label for setup in chosen if setup.label in truth.runs]
    if clash:
        raise InputError("argument setups", f"label {clash[0]!r} is that of the reference's run")
    rest = clock, time_limit(timeout_s)
    jobs = [Job(name, measure, name, problem, run, 0, *rest) for name, run in truth.runs.items()]
    jobs += [Job(s.label, measure, s.label, problem, s.run, int(repeats), *rest) for s in chosen]
    study = _PrecisionStudy(chosen, truth, wanted)
    outcomes = run_study(
        ("work and precision", "setups", "table.rows, print(table)"),
        jobs,
        executor,
        folder=folder,
        progress=progress,
        check=study.check,
        retry=retry,
    )
    kind = "runs" if truth.runs else "values"
    notes = {"reference": f"{type(reference).__name__} ({kind})"}
    return study.table({each.name: each for each in outcomes}, notes)


@dataclass
class _PrecisionStudy:
    """From outcomes to rows."""

    setups: list[Setup]
    truth: Reference
    wanted: Quantities
    outcomes: dict[str, Outcome] = field(default_factory=dict)
    failed: dict[str, tuple[str, str]] = field(default_factory=dict)
    samples: dict[str, dict[str, Reading]] = field(default_factory=dict)

    def check(self, outcome: Outcome) -> None:
        """End the study early if nothing could be compared with a run of the reference."""
        if outcome.name not in self.truth.runs:
            return
        error = self._sample(outcome)
        if isinstance(error, InputError):
            raise error
        if error is not None:
            raise InputError(
                "argument quantities", f"the run of the reference: {in_words(error)}"
            ) from error
        if outcome.name in self.failed:
            state, reason = self.failed[outcome.name]
            raise InputError("argument reference", f"its run failed: {reason or state}")

    def table(self, outcomes: dict[str, Outcome], notes: Meta) -> PrecisionTable:
        """Errors of all setups that have any."""
        self.outcomes = outcomes
        for setup in self.setups:
            self._sample(outcomes[setup.label])
        names = self._names()
        errors: dict[str, dict[str, float]] = {setup.label: {} for setup in self.setups}
        own = {name: self._compare(name, errors) for name in names}
        rows = [self._row(setup, names, errors[setup.label]) for setup in self.setups]
        return PrecisionTable(rows, own, notes)

    def _sample(self, outcome: Outcome) -> BaseException | None:
        """Quantities of a run, or why there are none; gives what reading them raised."""
        label = outcome.name
        state = ended(outcome.value.result if outcome.error is None else outcome.error)
        if state[0] != "ok":
            self.failed[label] = state
            return None
        sample = {}
        reading = Caught()
        with reading:
            sample = self.wanted.sample(outcome.value.result, label)
        bad = [name for name, each in sample.items() if not each.finite]
        if reading.error is not None:
            self.failed[label] = "error", in_words(reading.error)
        elif bad:
            self.failed[label] = "diverged", f"quantity {bad[0]!r} is not finite"
        else:
            self.samples[label] = sample
        return reading.error

    def _names(self) -> list[str]:
        """Names of the quantities; an error if they could not be had from anything."""
        labels = [setup.label for setup in self.setups if setup.label in self.samples]
        ran = [s.label for s in self.setups if self.outcomes[s.label].ok]
        if not labels and ran and all(self.failed[each][0] == "error" for each in ran):
            name = ran[0]
            raise InputError(
                "argument quantities", f"no setup gave them; {name}: {self.failed[name][1]}"
            )
        known = self.wanted.names or list(next(iter(self.samples.values()), {}))
        self.truth.check(known)
        return known

    def _compare(self, name: str, errors: dict[str, dict[str, float]]) -> float:
        """Errors of a quantity into `errors`; gives that of the reference itself."""
        self._drop_strange(name)
        if not any(setup.label in self.samples for setup in self.setups):
            return float("nan")
        values, instants = aligned(name, self.samples, self.wanted.over)

        size = self.wanted.norm(instants)
        shape = next(iter(values.values())).shape
        runs = [values[run] for run in self.truth.runs]
        exact, own = self.truth.of(name, shape, instants, runs, size)
        for label, value in values.items():
            if label in errors:
                errors[label][name] = size(value - exact)
        return own

    def _drop_strange(self, name: str) -> None:
        """Setups that cannot be compared with the reference have failed, and disturb no others."""
        for label in [setup.label for setup in self.setups if setup.label in self.samples]:
            comparing = Caught()
            with comparing:
                pair = {each: self.samples[each] for each in (*self.truth.runs, label)}
                values, instants = aligned(name, pair, self.wanted.over)
                if instants is None and not self.truth.runs:
                    self.truth.of(name, values[label].shape, None, [], euclidean)
            if comparing.error is not None:
                self.failed[label] = "error", in_words(comparing.error)
                del self.samples[label]

    def _row(self, setup: Setup, names: list[str], errors: dict[str, float]) -> TableRow:
        outcome = self.outcomes[setup.label]
        measured = outcome.value if outcome.ok else Measured(None, ())
        state, reason = self.failed.get(setup.label, ("ok", ""))
        row = {"label": setup.label, "cost_s": min(measured.costs, default=None)}
        counts = {name: told_of(measured.result).get(name) for name in COUNTS}
        row |= {name: each if isinstance(each, Real) else None for name, each in counts.items()}
        row |= {f"error_{name}": errors.get(name) if state == "ok" else None for name in names}
        row |= {"status": state, "reason": reason, "group": setup.group, "series": setup.series}
        said = outcome.error if measured.result is None else measured.result
        return row | {
            "spent_s": outcome.seconds,
            "kernels": ran(said),
            "warnings": told(outcome.warnings),
        }
