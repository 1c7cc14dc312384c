"""Refinement studies in one call, with their tables, verdicts, charts and files."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..arguments import checked
from ..errors import InputError
from ..export import write_paraview
from ..export.table import WIDE, column_names
from ..history import History
from ..types import Array, Floats, names_known, positive, switch
from ..warn import counted, sum_up, told
from .chart import Line, convergence_chart
from .levels import ARGUMENTS, Series, StudyLevel, case_name, check_call, series_of, text
from .orders import ROUNDING, Convergence, convergence
from .reading import OverTime, Quantities, Reading, aligned
from .reference import ReferenceFinest, ReferenceKnown, reference_of
from .run import Executor, Job, OnOutcome, Outcome, run_all
from .table import Report, ResultTable, provenance

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# -- what came of a refinement study: tables, verdicts, charts, files for ParaView -----------------

#: error of what is held in units of the change by half of it, for a method of order 1 or higher
HELD = 2.0


class Held(NamedTuple):
    """What a series did not vary, and what it does to a quantity.

    Attributes
    ----------
    error : float
        Bound of the error by it, in the norm of the study; NaN: not known.
    words : str
        Its name and value, and where the bound is from, or why there is none.
    """

    error: float
    words: str

    def __str__(self) -> str:
        return self.words


@checked
@dataclass(frozen=True, eq=False, repr=False)
class Refinement(Report):
    """Result of :func:`refine`.

    Quantities are found by their names; with several series (orders) by name and series:
    ``"tip, order = 2"``.

    Attributes
    ----------
    title : str
        Name of the problem.
    series : list of Series
        Levels of each series: ``arguments``, ``size`` and ``name``, coarsest first.
    quantities : list of str
        Names of the quantities.
    outcomes : dict
        By the name of the level: value or error of the problem, seconds.
    orders : dict of Convergence
        Errors, observed orders and verdict of each quantity.
    values : dict of dict
        Values of each quantity by the name of the level, as they were compared.
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
    notes: dict[str, Any]

    @property
    def verdicts(self) -> dict[str, str]:
        """What is known of the order, in words."""
        return {name: each.verdict for name, each in self.orders.items()}

    @property
    def asymptotic(self) -> bool:
        """Whether the errors of all quantities fall as a power of the size."""
        return bool(self.orders) and all(each.asymptotic for each in self.orders.values())

    @property
    def extrapolated(self) -> dict[str, Array | None]:
        """Richardson's values; None where the levels do not bear one."""
        return {name: each.extrapolated for name, each in self.orders.items()}

    @property
    def errors(self) -> dict[str, Floats]:
        """Error of each level; see :class:`Convergence` for what they are against."""
        return {name: each.errors for name, each in self.orders.items()}

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
            sure = np.isfinite(each.uncertainties)
            if each.extrapolated is not None:
                sure |= np.isfinite(each.errors)
            errors = each.errors if sure.any() else each.differences
            last = max(np.flatnonzero(np.isfinite(errors)), default=-1)
            found[name] = float(errors[last]), float(each.uncertainties[last])
        return found

    @property
    def failed(self) -> dict[str, str]:
        """Levels without a result, and why."""
        levels = [level for series in self.series for level in series.levels]
        reasons = {level.name: self._state(level) for level in levels}
        return {name: ": ".join(state) for name, state in reasons.items() if state[0] != "ok"}

    @property
    def warnings(self) -> dict[str, Sequence[dict[str, Any]]]:
        """Of each level that gave some, as in ``history.meta["warnings"]``."""
        return {name: each.warnings for name, each in self.outcomes.items() if each.warnings}

    @property
    def rows(self) -> list[dict[str, Any]]:
        """One row a level, also of those that failed.

        With ``series``, the arguments, ``size``, ``status`` (``ok``, ``diverged``, ``error``,
        ``not finite``, ``interrupted``, ``not run``), ``reason``, ``seconds``, ``warnings`` (in
        words, empty without any), and for each
        quantity its numbers (if they are few), ``error_``, ``uncertainty_``, ``difference_`` and
        ``order_`` with its name.
        """
        return [self._row(series, k) for series in self.series for k in range(len(series.levels))]

    def _state(self, level: StudyLevel) -> tuple[str, str]:
        """Status and reason."""
        outcome = self.outcomes[level.name]
        if outcome.status != "ok":
            error = outcome.error
            return outcome.status, f"{type(error).__name__}: {error}" if error else ""
        for key, values in self.values.items():
            if not np.isfinite(values.get(level.name, 0.0)).all():
                return "not finite", f"quantity {key!r}"
        return "ok", ""

    def _row(self, series: Series, k: int) -> dict[str, Any]:
        level = series.levels[k]
        outcome, (state, reason) = self.outcomes[level.name], self._state(level)
        row: dict[str, Any] = {"series": series.label} if len(self.series) > 1 else {}
        for name, value in level.arguments.items():
            row[name] = value if isinstance(value, int | float) else text(value)
        row |= {"size": level.size, "status": state, "reason": reason, "seconds": outcome.seconds}
        row["warnings"] = told(outcome.warnings)
        for name in self.quantities:
            found = self.orders[series.key(name)]
            row |= _columns(name, self.values[series.key(name)].get(level.name))
            row[f"error_{name}"] = float(found.errors[k])
            row[f"uncertainty_{name}"] = float(found.uncertainties[k])
            row[f"difference_{name}"] = float(found.differences[k])
            row[f"order_{name}"] = float(found.observed[k])
        return row

    @property
    def table(self) -> ResultTable:
        """The rows, with verdicts, versions, machine and commit."""
        notes: dict[str, Any] = {"refinement": self.title, **self.notes, "verdicts": self.verdicts}
        limits = {name: each for name, each in self.extrapolated.items() if each is not None}
        notes["extrapolated"] = {n: v.tolist() for n, v in limits.items() if not np.iscomplexobj(v)}
        notes["held"] = {name: list(map(str, each)) for name, each in self.held.items() if each}
        return ResultTable(self.rows, notes | provenance())

    def chart(
        self,
        path: str | os.PathLike[str] | None = None,
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
        panels: dict[str, list[Line]] = {}
        for series in self.series:
            solved = [self._state(level)[0] == "ok" for level in series.levels]
            for name in self.quantities:
                found = self.orders[series.key(name)]
                line = Line(series.label, series.kind, found, np.array(solved))
                panels.setdefault(name, []).append(line)
        return convergence_chart(panels, self.title if title is None else title, path, units)

    def paraview(
        self, folder: str | os.PathLike[str], every: int = 1, fps: float | None = None
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
        width = max(map(len, self.outcomes))
        for series in self.series:
            states = [self._state(level) for level in series.levels]
            for key in map(series.key, self.quantities):
                found = self.orders[key]
                lines.append(f"{key}: {found.verdict}")
                if found.extrapolated is not None and found.extrapolated.size <= WIDE:
                    numbers = ", ".join(f"{each:.9g}" for each in found.extrapolated.ravel())
                    band = f"{numbers}{_band(found.uncertainty)}"
                    lines.append(f"  extrapolated in {' and '.join(series.varied)}: {band}")
                shown = _shown(found, [k for k, state in enumerate(states) if state[0] == "ok"])
                for k, (level, state) in enumerate(zip(series.levels, states, strict=True)):
                    words = shown.get(k, ": ".join(state).rstrip(": "))
                    lines.append(f"  {level.name:{width}s}  {words}")
                lines += [f"  {each}" for each in self.held[key]]
        if not self.orders:  # no level came to its quantities
            lines += [f"  {name}: {why}" for name, why in self.failed.items()]
        lines += [f"warned: {name}: {told(each)}" for name, each in self.warnings.items()]
        return "\n".join(lines)

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


def _shown(found: Convergence, good: list[int]) -> dict[int, str]:
    """Numbers of solved levels in words: errors, or hints, and the orders that follow from them."""
    hints = found.extrapolated is None and not np.isfinite(found.uncertainties).any()
    texts = {}
    for before, k in zip([None, *good], good, strict=False):
        error = found.errors[k]
        if not hints:
            texts[k] = f"error {error:.3e}{_band(found.uncertainties[k])}"
        elif np.isnan(found.errors[good[-1]]):  # no reference either
            change = "-" if before is None else f"{found.differences[before]:.3e}"
            texts[k] = f"change {change}"
        else:
            texts[k] = "the reference" if k == good[-1] else f"differs by {error:.3e}"
        if np.isfinite(found.observed[k]):
            texts[k] += f"  order {found.observed[k]:.2f}"
    return texts


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
    rounding: float | Mapping[str, float] | None = None,
    together: bool = True,
    probe: bool = True,
    executor: Executor | None = None,
    folder: str | os.PathLike[str] | None = None,
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
    rounding : float or mapping, optional
        Error of each quantity by rounding and unfinished iterations, relative to its largest value.
        Levels whose error is not 100 times that do not count for the order. Default: 64 times the
        machine precision; what stops falling below 1e-8 is taken for rounding in any case.
    together : bool
        Mesh and step, if both are sequences: refined at once, level by level (the order is that in
        the size of the elements), or each for itself with the finest of the other, as two series.
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
    series = series_of(elements, mesh, order, step, together)
    wanted = Quantities(quantities, norm)
    given = rounding if isinstance(rounding, Mapping) else {"value": rounding}
    for name, each in given.items() if rounding is not None else ():
        positive("argument rounding", name, each)
    plan = _Plan(series, wanted, reference, rounding, switch("argument probe", probe))
    for arguments in plan.calls.values():
        check_call(problem, arguments)
    jobs = [Job(name, problem, **arguments) for name, arguments in plan.calls.items()]
    outcomes = run_all(
        jobs,
        executor,
        folder=folder,
        progress=progress,
        check=plan.check,
        retry=switch("argument retry", retry),
        tell=False,
    )
    study = plan.result(title_of(problem), {each.name: each for each in outcomes})
    about = {each.name: each.warnings for each in outcomes}
    sum_up(f"refinement of {study.title}", "levels", about, "study.rows, print(study)")
    return study


def title_of(problem: Any) -> str:
    """Name of the problem, with what is bound to it as far as it is short."""
    function = problem.func if isinstance(problem, partial) else problem
    bound = problem.keywords if isinstance(problem, partial) else {}
    name = str(getattr(function, "__name__", type(function).__name__))
    short = {key: each for key, each in bound.items() if isinstance(each, int | float | str)}
    return f"{name} ({case_name(short)})" if short else name


class _Plan:
    """The calls of a study, and what is made of their outcomes."""

    def __init__(
        self,
        series: list[Series],
        wanted: Quantities,
        reference: Any,
        rounding: float | Mapping[str, float] | None,
        probe: bool,
    ) -> None:
        self.series, self.wanted, self.rounding = series, wanted, rounding
        levels = [level for each in series for level in each.levels]
        self.reference = reference_of(reference, levels=True).beside(levels[-1].arguments)
        self.levels = {level.name: level.arguments for level in levels}
        true = isinstance(self.reference, ReferenceKnown)
        self.held = [(each, name) for each in series for name in each.held if not true]
        varied = {name for each in series for name in each.varied}
        probes = [each.probe(name) for each, name in self.held if probe and name not in varied]
        self.calls = self.levels | self.reference.runs
        self.calls |= {each.name: each.arguments for each in probes}
        self.quantities: list[str] = []
        if wanted.names:
            self.reference.check(wanted.names, every=False)

    def check(self, outcome: Outcome) -> None:
        """Look at the first result: what is wrong with the quantities ends the study early."""
        if outcome.status == "ok" and not self.quantities:
            self.quantities = list(self.wanted.sample(outcome.value, outcome.name))
            for name in self.rounding if isinstance(self.rounding, Mapping) else ():
                if name not in self.quantities:
                    known = names_known(name, self.quantities)
                    raise InputError(f"quantity {name!r}", f"unknown; {known}")
            self.reference.check(self.quantities, every=False)

    def result(self, title: str, outcomes: dict[str, Outcome]) -> Refinement:
        """Judge each quantity in each series."""
        solved = {name: each.value for name, each in outcomes.items() if each.status == "ok"}
        samples = {name: self.wanted.sample(value, name) for name, value in solved.items()}
        for run in self.reference.runs:
            if run not in samples:
                raise InputError("argument reference", f"its run failed: {outcomes[run].error}")
        compared = {
            name: samples[name] for name in (*self.levels, *self.reference.runs) if name in samples
        }
        study = Refinement(
            title,
            self.series,
            self.quantities if compared else [],
            {name: each for name, each in outcomes.items() if name in self.levels},
            orders={},
            values={},
            held={},
            notes={"reference": self.reference.about},
        )
        for name in study.quantities:
            self._judge(name, compared, study)
        for name in study.quantities:
            for series, argument in self.held:
                found = self._held(name, series, argument, samples, outcomes, study.orders)
                study.held[series.key(name)].append(found)
        for key, held in study.held.items():
            judged, error = study.orders[key], sum(each.error for each in held)
            bands = judged.uncertainties + error
            band = judged.uncertainty + error
            study.orders[key] = replace(judged, uncertainties=bands, uncertainty=band)
        return study

    def _judge(
        self, name: str, samples: Mapping[str, Mapping[str, Reading]], study: Refinement
    ) -> None:
        """Orders and values of a quantity, into the study."""
        shared, instants = aligned(name, samples, self.wanted.over)
        norm, noise = self.wanted.norm(instants), self.rounding
        if isinstance(noise, Mapping):
            noise = noise.get(name)
        shape = next(iter(shared.values())).shape
        known, off = self.reference.of(name, shape, instants, shared, norm)
        size = max(map(norm, shared.values()))
        if off > 0 and size > 0:  # differences below the reference's own error tell no order
            noise = max(off / size, ROUNDING if noise is None else noise)
        for series in self.series:
            key, names = series.key(name), [level.name for level in series.levels]
            study.values[key] = {each: shared[each] for each in names if each in shared}
            good = {k: value for k, value in study.values[key].items() if np.isfinite(value).all()}
            finest = isinstance(self.reference, ReferenceFinest)
            found = convergence(series.sizes, [*map(good.get, names)], norm, known, noise, finest)
            if len(series.varied) > 1 and found.verdict.startswith("not in the asymptotic range"):
                advice = "mesh and step, refined at once, may have orders of their own"
                verdict = f"{found.verdict}; {advice}: see together=False"
                found = replace(found, verdict=verdict)
            study.orders[key], study.held[key] = found, []

    def _held(
        self,
        name: str,
        series: Series,
        argument: str,
        samples: Mapping[str, Mapping[str, Reading]],
        outcomes: Mapping[str, Outcome],
        orders: Mapping[str, Convergence],
    ) -> Held:
        """What an argument that a series holds does to a quantity at its finest level."""
        finest, probe = series.levels[-1], series.probe(argument)
        what = f"{argument} = {text(finest.arguments[argument])}"
        other = next((each for each in self.series if argument in each.varied), None)
        error, words = np.nan, "it was not probed"
        if other is not None:  # held at the finest level of a series of its own
            found = orders[other.key(name)]
            error = float(found.errors[-1] + found.uncertainties[-1])
            words = f"see the series {other.label!r}"
        elif probe.name in samples:
            pair = {each.name: samples.get(each.name, {}) for each in (finest, probe)}
            try:
                shared, instants = aligned(name, pair, self.wanted.over)
                change = self.wanted.norm(instants)(shared[probe.name] - shared[finest.name])
                error = HELD * change
                words = f"{ARGUMENTS[argument].words} changes the finest level by {change:.1e}"
            except InputError as wrong:  # values at points of the mesh, or no instants in common
                words = str(wrong)
        elif probe.name in outcomes:
            words = f"{probe.name} failed: {outcomes[probe.name].error}"
        if np.isfinite(error):
            return Held(error, f"{error:.1e} of each band by {what}, held: {words}")
        return Held(error, f"{what} was held, its error is not known: {words}")
