"""Work and precision: what an error costs, with one setup of the methods and another."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from ..errors import InputError
from ..parallel import Executor, Job, Outcome
from ..parallel.jobs import Caught, in_words
from ..types import Array, Floats, positive
from .cases import OnOutcome, run_cases
from .fingerprint import identity
from .norms import OverTime
from .orders import euclidean
from .precision_table import PrecisionTable
from .quantities import Quantities, Sample, aligned
from .setups import Measured, Setup, as_setups, best_cost, counts, failure, measure, raised, ran
from .truth import Truth

__all__ = ["work_precision"]


def work_precision(
    problem: Any,
    setups: Iterable[Any],
    reference: Any,
    quantities: Any,
    repeats: int = 3,
    executor: Executor | None = None,
    *,
    norm: OverTime | None = None,
    folder: str | os.PathLike[str] | None = None,
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
        Pairs (label, function of the problem) or :class:`~skfem_cosserat.study.Setup`;
        :func:`~skfem_cosserat.study.setup_grid` makes them. The function gives a History, or a
        mapping, see there: what another code computed in a subprocess, with its own ``cost_s``.
    reference : object
        True values: a number or array (of the only quantity), or a mapping by quantity, functions
        of the instants too if compared over time; their own error is then not known.
        :class:`~skfem_cosserat.study.ReferenceKnown`: with errors.
        :class:`~skfem_cosserat.study.ReferencePair`: two runs, of which the second one tells how
        good the first is. A function of the problem, or a setup: one run; a History: what it gave.
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
        Longest time of one run of a setup (s), see :class:`~skfem_cosserat.study.TimeLimit`.
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

    >>> from skfem_cosserat.study import setup_grid
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
    truth, wanted = Truth(reference), _wanted(quantities, norm)
    if isinstance(repeats, bool) or not isinstance(repeats, int | np.integer) or repeats < 1:
        raise InputError("argument repeats", f"{repeats!r}, expected a positive integer")
    if timeout_s is not None:
        timeout_s = positive("argument timeout_s", "timeout_s", timeout_s, " of seconds")
    if not callable(clock):
        raise InputError("argument clock", f"{clock!r}, expected a function such as process_time")
    if wanted.names:
        truth.check(wanted.names)
    clash = [setup.label for setup in chosen if setup.label in truth.runs]
    if clash:
        raise InputError("argument setups", f"label {clash[0]!r} is that of the reference's run")
    rest = clock, timeout_s
    jobs = [
        Job(name, measure, name, problem, run, None, 0, *rest) for name, run in truth.runs.items()
    ]
    jobs += [
        Job(s.label, measure, s.label, problem, s.run, s.timed, int(repeats), *rest) for s in chosen
    ]
    shared = {} if folder is None else identity()
    study = _Study(chosen, truth, wanted)
    outcomes = run_cases(
        jobs,
        executor,
        folder=folder,
        identity=shared,
        progress=progress,
        check=study.check,
        retry=retry,
    )
    return study.table({each.name: each for each in outcomes})


def _wanted(quantities: Any, norm: Any) -> Quantities:
    if norm is not None and not isinstance(norm, OverTime):
        raise InputError(
            "argument norm",
            f"{norm!r}, expected MaximumOverTime(), RootMeanSquare() or AtInstants(times)",
        )
    return Quantities(quantities, norm)


class _Study:
    """From outcomes to rows."""

    def __init__(
        self,
        setups: list[Setup],
        truth: Truth,
        wanted: Quantities,
    ) -> None:
        self.setups, self.truth, self.wanted = setups, truth, wanted
        self.outcomes: dict[str, Outcome] = {}
        self.failed: dict[str, tuple[str, str]] = {}
        self.samples: dict[str, Sample] = {}

    def check(self, outcome: Outcome) -> None:
        """End the study early if nothing could be compared with a run of the reference."""
        if outcome.name in self.truth.runs:
            self._sample_reference(outcome)

    def table(self, outcomes: dict[str, Outcome]) -> PrecisionTable:
        """Errors of all setups that have any."""
        self.outcomes = outcomes
        for setup in self.setups:
            self._sample(setup.label)
        names = self._names()
        errors: dict[str, dict[str, float]] = {setup.label: {} for setup in self.setups}
        own: dict[str, float] = {}
        for name in names:
            own[name] = self._compare(name, errors)
        rows = [self._row(setup, names, errors[setup.label]) for setup in self.setups]
        return PrecisionTable(rows, own, self._notes())

    def _sample_reference(self, outcome: Outcome) -> None:
        name = outcome.name
        wrong = None if not outcome.ok else failure(outcome.value.result)
        if outcome.error is not None:
            wrong = "error", in_words(outcome.error)
        if wrong is not None:
            raise InputError("argument reference", f"its run failed: {wrong[1] or wrong[0]}")
        reading, sample = Caught(), Sample({})
        with reading:
            sample = self.wanted.sample(outcome.value.result, name)
        if isinstance(reading.error, InputError):
            raise reading.error
        if reading.error is not None:
            raise InputError(
                "argument quantities", f"the run of the reference: {in_words(reading.error)}"
            ) from reading.error
        bad = [key for key, value in sample.values.items() if not np.isfinite(value).all()]
        if bad:
            raise InputError("argument reference", f"its run gave {bad[0]!r} not finite")
        self.samples[name] = sample

    def _sample(self, label: str) -> None:
        """Quantities of a setup, or why there are none."""
        outcome = self.outcomes[label]
        if outcome.error is not None:
            self.failed[label] = raised(outcome.error)
            return
        wrong = failure(outcome.value.result)
        if wrong is not None:
            self.failed[label] = wrong
            return
        sample, reading = None, Caught()
        with reading:
            sample = self.wanted.sample(outcome.value.result, label)
        if sample is None:
            error = reading.error
            self.failed[label] = "error", "" if error is None else in_words(error)
            self._cause = error
            return
        bad = [name for name, value in sample.values.items() if not np.isfinite(value).all()]
        if bad:
            self.failed[label] = "diverged", f"quantity {bad[0]!r} is not finite"
            return
        self.samples[label] = sample

    def _names(self) -> list[str]:
        """Names of the quantities; an error if they could not be had from anything."""
        labels = [setup.label for setup in self.setups if setup.label in self.samples]
        ran = [s.label for s in self.setups if self.outcomes[s.label].ok]
        if not labels and ran and all(self.failed[each][0] == "error" for each in ran):
            name = ran[0]
            raise InputError(
                "argument quantities", f"no setup gave them; {name}: {self.failed[name][1]}"
            )
        known = self.wanted.names or list(next(iter(self.samples.values()), Sample({})).values)
        self.truth.check(known)
        return known

    def _compare(self, name: str, errors: dict[str, dict[str, float]]) -> float:
        """Errors of a quantity into `errors`; gives that of the reference itself."""
        self._drop_strange(name)
        if not any(setup.label in self.samples for setup in self.setups):
            return float("nan")
        values, instants = aligned(name, self.samples, self.wanted.over)

        def size(difference: Array) -> float:
            return self._size(difference, instants)

        shape = next(iter(values.values())).shape
        exact, own = self.truth.of(name, values, instants, shape, size)
        for label, value in values.items():
            if label in errors:
                errors[label][name] = size(value - exact)
        return own

    def _size(self, difference: Array, instants: Floats | None) -> float:
        over = self.wanted.over
        if over is None or instants is None:
            return float(euclidean(difference))
        return float(over.size(instants, difference))

    def _drop_strange(self, name: str) -> None:
        """Setups that cannot be compared with the reference have failed, and disturb no others."""
        labels = [setup.label for setup in self.setups if setup.label in self.samples]
        for label in labels:
            sample, comparing = self.samples[label], Caught()
            with comparing:
                if self.truth.runs:
                    pair = {each: self.samples[each] for each in (*self.truth.runs, label)}
                    aligned(name, pair, self.wanted.over)
                elif self.wanted.over is None:
                    value = sample.values.get(name, np.empty(0))
                    self.truth.of(name, {}, None, value.shape, euclidean)
            if comparing.error is not None:
                self.failed[label] = "error", in_words(comparing.error)
                del self.samples[label]

    def _row(self, setup: Setup, names: list[str], errors: dict[str, float]) -> dict[str, Any]:
        outcome = self.outcomes[setup.label]
        measured = outcome.value if outcome.ok else Measured(None, ())
        state, reason = self.failed.get(setup.label, ("ok", ""))
        row: dict[str, Any] = {"label": setup.label, "cost_s": best_cost(measured.costs)}
        row |= counts(measured.result)
        row |= {f"error_{name}": errors.get(name) if state == "ok" else None for name in names}
        row |= {"status": state, "reason": reason, "group": setup.group, "series": setup.series}
        told = outcome.error if measured.result is None else measured.result
        return row | {"spent_s": outcome.seconds, "kernels": ran(told)}

    def _notes(self) -> dict[str, Any]:
        given = self.truth.given
        kind = "values" if self.truth.known else "runs"
        return {"reference": f"{type(given).__name__} ({kind})"}
