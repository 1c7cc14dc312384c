"""Stability maps: how runs end over the values of parameters, and the judges that say it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from inspect import Parameter, signature
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from ..arguments import checked
from ..diagnostics.resolution import ALTERNATES, MOST_OFF
from ..errors import Diverged, InputError, JobError
from ..export.table import Report, ResultTable, TableRow, provenance
from ..history import History
from ..model.limits import FAR_TURN
from ..newton import NewtonSettings
from ..types import TOLERANCE, Array, FilePath, Floats, IndexArray, positive
from ..warn import told
from .chart import stability_chart
from .run import (
    LATE,
    Caught,
    Executor,
    Job,
    OnOutcome,
    Outcome,
    TimeLimit,
    case_name,
    check_call,
    in_words,
    ran,
    run_study,
    time_limit,
    title_of,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure


#: With these settings a step that fails has had the full protocol: from an extrapolated and from a
#: zero increment, without and with line search, up to 100 iterations each, rotations capped.
FULL_PROTOCOL = NewtonSettings(iterations=100, damped_iterations=100)
#: attempts of the protocol
ATTEMPTS = 4
#: status of runs that have a mechanism
FAILED = ("blowup", "drift", "newton", "error")
#: series that the energy is made of, unless a judge is told otherwise
DERIVED = {"energy", "external"}


#: mechanisms of failures, the surest one first: the number of a run that tells each, and above
#: which value
MECHANISMS: Mapping[str, tuple[str, float]] = {
    "compression": ("h_omega_c", ALTERNATES),
    "rotation": ("turn", FAR_TURN),
    "branch": ("doubtful", 0.0),
    "unresolved": ("off", MOST_OFF),
}


def mechanism(status: str, numbers: Mapping[str, float]) -> str:
    """Why a run has failed, by what its steps do to its motion.

    Where none of :data:`MECHANISMS` shows, an energy that has grown tenfold is all that is known,
    then elements that are bent or drawn too far, then energy that the scheme has taken.

    Parameters
    ----------
    status : str
        See :class:`Verdict`.
    numbers : mapping of str to float
        ``history.meta["steps"]``; and `lost`, the part of the largest energy or work that the
        scheme has taken (negative: added), by ``history.meta["energy_balance"]``.

    Examples
    --------
    >>> mechanism("newton", {"turn": 0.8, "doubtful": 1.0}), mechanism("ok", {"turn": 0.8})
    ('rotation', '')
    >>> mechanism("drift", {"turn": 0.1, "lost": 0.2})
    'damping'
    """
    if status not in FAILED:
        return ""
    for name, (number, limit) in MECHANISMS.items():
        if numbers.get(number, 0.0) > limit:
            return name
    lost = numbers.get("lost", 0.0)
    # a share of the largest energy or work of a run: it has grown tenfold
    if status == "blowup" or lost < -0.9:
        return "energy"
    if numbers.get("elements", 0.0) > 0:
        return "elements"
    return "damping" if status == "drift" and lost > 0.01 else ""


@dataclass(frozen=True)
class Verdict:
    """Verdict on how a run ended.

    Attributes
    ----------
    status : str
        ``ok``, ``drift``, ``blowup``, ``newton``, ``timeout`` or ``error``; your own judge may have
        other words.
    time : float
        Of the blow-up, of the last step that was solved, or the end (s).
    energy_error : float
        Largest relative change of the energy until then.
    newton_residual : float
        Smallest scaled residual of a step that could not be solved; NaN if all could.
    reason : str
        More about it.
    numbers : dict
        Others that you want to see as arrays over the axes.
    kernels : str
        Those that ran, as the history tells: ``numpy`` or ``numba``; empty if none came.
    warnings : str
        Those of the run in words; empty if it gave none.
    mechanism : str
        Why it failed, as far as the run tells (:func:`mechanism`); empty if it did not, or if it
        does not tell.

    Examples
    --------
    >>> Verdict("ok", time=1.0).status
    'ok'
    """

    status: str
    time: float = float("nan")
    energy_error: float = float("nan")
    newton_residual: float = float("nan")
    reason: str = ""
    numbers: Mapping[str, float] = field(default_factory=dict)
    kernels: str = ""
    warnings: str = ""
    mechanism: str = ""


@checked
class JudgeEnergy:
    """Judge runs by their energy, which ought to stay what it was.

    A failed run is judged by the history that came with its error: what has blown up before a step
    could not be solved has blown up.

    Parameters
    ----------
    energy : callable, optional
        Energies (N,) of a History; default: its series ``energy`` plus ``external``.
    since : float
        The energy at the first state from this time on (s) is the right one, E0: the end of a
        pulse, say.
    scale : float, optional
        Of energy; default: abs(E0). Where that is nothing beside the work of the loads (a pendulum
        let go at the height of its hinge): the largest change of their potential, ``external``.
    drift : float
        Relative change of the energy above which a run that ended well has drifted.
    blowup : float
        Blown up is an energy E with E - E0 > (blowup - 1) scale: by default, E > 10 E0.

    Raises
    ------
    InputError
        If a number is not positive; when called, if E0 is zero and neither loads nor `scale` say
        what to compare with, or the history has no such energy.

    Examples
    --------
    >>> t = np.arange(5.0)
    >>> series = {"t": t, "step": t, "q": np.zeros((5, 3)), "p": np.zeros((5, 3))}
    >>> history = History({"status": "completed"}, {}, series)
    >>> found = JudgeEnergy(lambda history: 2 + 0.02 * history.times)(history)
    >>> found.status, found.time, round(found.energy_error, 9)
    ('drift', 4.0, 0.04)
    """

    def __init__(
        self,
        energy: Callable[[History], Any] | None = None,
        since: float = 0.0,
        scale: float | None = None,
        drift: float = 0.01,
        blowup: float = 10.0,
    ):
        item = "JudgeEnergy"
        if energy is not None and not callable(energy):
            raise InputError(item, f"energy = {energy!r}, expected a function of a History")
        self.energy = energy
        self.since = float(since) if since == 0 else positive(item, "since", since, " of seconds")
        self.scale = None if scale is None else positive(item, "scale", scale)
        self.drift = positive(item, "drift", drift)
        self.blowup = positive(item, "blowup", blowup)

    def __call__(self, result: Any) -> Verdict:
        """The verdict on a History, or on an exception; with the numbers of its steps."""
        failed = isinstance(result, Exception)
        history = getattr(result, "history", None) if failed else result
        if not isinstance(history, History):
            if not failed:
                raise InputError(
                    "argument problem",
                    f"gave a {type(result).__name__}, expected a History (or another outcome=)",
                )
            return self._failed(result, float("nan"), float("nan"), False)
        try:
            time, error, blown = self._change(history, failed)
        except InputError:
            if not failed:
                raise
            # it was stopped before its energies were there
            time, error, blown = float(history.times[-1]), float("nan"), False
        if failed:
            found = self._failed(result, time, error, blown)
        elif history.status == "diverged" and not blown:
            reason = f"no error came with the history: {history.meta.get('failure', '')}"
            found = Verdict("error", time, error, reason=reason)
        else:
            state = "blowup" if blown else "drift" if error > self.drift else "ok"
            found = Verdict(state, time, error)
        numbers = dict(history.meta.get("steps") or {})
        balance = history.meta.get("energy_balance") or {}
        if balance.get("scale", 0.0) > 0:
            numbers["lost"] = balance["lost"] / balance["scale"]
        return replace(found, numbers=numbers, mechanism=mechanism(found.status, numbers))

    def _failed(self, error: Exception, time: float, change: float, blown: bool) -> Verdict:
        """Verdict on a run that failed, by the time it reached and its change of energy."""
        reason = in_words(error)
        residual = float("nan")
        state = "timeout" if isinstance(error, LATE) else "error"
        if isinstance(error, Diverged):
            residual = float(error.residual)
            if not error.residuals:  # nothing was iterated: an explicit scheme, or a dead point
                state = "error" if np.isfinite(residual) else "blowup"
            elif full_protocol(error):
                state = "newton"
            else:
                reason = NOT_FULL + reason
        if blown:
            return Verdict("blowup", time, change, residual, f"then {reason}")
        end = float(error.time) if isinstance(error, Diverged) else time
        return Verdict(state, end, change, residual, reason)

    def _change(self, history: History, failed: bool = False) -> tuple[float, float, bool]:
        """Time reached, largest change of the energy up to it, and whether it has blown up.

        Before a failed step the momentum, which comes from that step, may not be known.
        """
        t = history.times
        energy = self._energies(history)
        if failed and len(t) > 1 and np.isnan(energy[-1]):
            t = t[:-1]
            energy = energy[:-1]
        after = np.flatnonzero(t >= self.since - 1e-12 * max(abs(t[-1]), abs(self.since)))
        if not len(after):
            return float(t[-1]), float("nan"), False
        start = float(energy[after[0]])
        if not np.isfinite(start):
            return float(t[after[0]]), float("inf"), True
        scale = self._scale(start, history, after)
        if not scale > 0:
            raise InputError(
                "JudgeEnergy",
                f"the energy at t = {t[after[0]]:g} s is zero, which nothing can be compared with:"
                " give scale=, or since=, a time from which it is to stay the same",
            )
        with np.errstate(all="ignore"):
            change = (energy[after] - start) / scale
        bad = ~(change <= self.blowup - 1)
        end = int(bad.argmax()) if bad.any() else len(after) - 1
        return float(t[after[end]]), float(np.nanmax(abs(change[: end + 1]))), bool(bad.any())

    def _scale(self, start: float, history: History, after: IndexArray) -> float:
        """Scale of the energy, by which its changes are divided."""
        if self.scale is not None:
            return self.scale
        if self.energy is None:
            potential = history["external"][after]
            change = abs(potential - potential[0])
            work = float(change[np.isfinite(change)].max(initial=0.0))
            # beside the work of loads it is zero by the choice of a height
            if abs(start) <= TOLERANCE * work:
                return work
        return abs(start)

    def _energies(self, history: History) -> Floats:
        if self.energy is not None:
            values = np.asarray(self.energy(history), float)
            if values.shape != history.times.shape:
                raise InputError(
                    "JudgeEnergy",
                    f"energy gave shape {values.shape}, expected ({len(history)},)",
                )
            return values
        if not DERIVED.issubset(history.series):
            raise InputError(
                "JudgeEnergy",
                "the history has no series 'energy' and 'external': run it without derive=False,"
                " or give energy=, a function of it",
            )
        return history["energy"] + history["external"]


NOT_FULL = "(not the full retry protocol: run it with settings=FULL_PROTOCOL) "


def full_protocol(error: Diverged) -> bool:
    """True if a step was tried in all the ways of :data:`FULL_PROTOCOL`.

    Examples
    --------
    >>> full_protocol(Diverged(0.0, 1, 1.0, "no convergence", "try", [[1.0]]))
    False
    """
    given = error.settings
    full = FULL_PROTOCOL
    return (
        given is not None
        and len(error.residuals) >= ATTEMPTS
        and given.iterations >= full.iterations
        and given.damped_iterations >= full.damped_iterations
    )


NAN = float("nan")

# -- what came of a stability map: arrays over the axes, table, chart ------------------------------


@checked
@dataclass(frozen=True, eq=False)
class Map(Report):
    """Result of :func:`stability_map`; arrays have an axis for each parameter, in their order.

    Attributes
    ----------
    title : str
        Name of the problem.
    axes : dict
        Values of each parameter by its name.
    cells : array of Verdict
    seconds : array
        How long each cell took.

    Examples
    --------
    >>> from skfem_cosserat import stability_map
    >>> def fails(step, stiffness):
    ...     if step * stiffness**0.5 > 2:
    ...         raise ArithmeticError("it does not")
    >>> found = stability_map(fails, {"step": (0.1, 1.0), "stiffness": (1.0, 9.0)},
    ...                       lambda result: "ok" if result is None else "blowup")
    >>> found.status.tolist(), found.rows[3]["stiffness"]
    ([['ok', 'ok'], ['ok', 'blowup']], 9.0)
    """

    title: str
    axes: dict[str, list[Any]]
    cells: Array
    seconds: Floats

    @property
    def status(self) -> Array:
        """``ok``, ``drift``, ``blowup``, ``newton``, ``timeout``, ``error`` or ``not run``.

        With a judge of your own: its words.
        """
        return self._array("status", str)

    @property
    def time(self) -> Floats:
        """Time of the blow-up, of the last step that was solved, or of the end (s)."""
        return self._array("time")

    @property
    def energy_error(self) -> Floats:
        """Largest relative change of the energy until then."""
        return self._array("energy_error")

    @property
    def newton_residual(self) -> Floats:
        """Smallest scaled residual of the step that could not be solved; NaN elsewhere."""
        return self._array("newton_residual")

    @property
    def reason(self) -> Array:
        """More about it, in words."""
        return self._array("reason", str)

    @property
    def mechanism(self) -> Array:
        """Why each failed cell has failed, see :class:`~skfem_cosserat.accuracy.Verdict`."""
        return self._array("mechanism", str)

    @property
    def numbers(self) -> dict[str, Floats]:
        """Numbers that the judge gave beside its status, by name; NaN where it gave none."""
        names = dict.fromkeys(name for cell in self.cells.flat for name in cell.numbers)
        values = {name: [cell.numbers.get(name, NAN) for cell in self.cells.flat] for name in names}
        return {name: np.array(each).reshape(self.cells.shape) for name, each in values.items()}

    def _array(self, name: str, kind: type = float) -> Array:
        values = [getattr(cell, name) for cell in self.cells.flat]
        return np.array(values, kind).reshape(self.cells.shape)

    @property
    def rows(self) -> list[TableRow]:
        """One row a cell: parameters, verdict, seconds; a number that a cell lacks is NaN."""
        names = list(self.numbers)
        cells = zip(product(*self.axes.values()), self.cells.flat, self.seconds.flat, strict=True)
        return [
            {
                **dict(zip(self.axes, choice, strict=True)),
                "status": cell.status,
                "time_s": cell.time,
                "energy_error": cell.energy_error,
                "newton_residual": cell.newton_residual,
                **{name: cell.numbers.get(name, NAN) for name in names},
                "seconds": float(seconds),
                "kernels": cell.kernels,
                "mechanism": cell.mechanism,
                "reason": cell.reason,
                "warnings": cell.warnings,
            }
            for choice, cell, seconds in cells
        ]

    @property
    def table(self) -> ResultTable:
        """The rows, with versions, machine and commit."""
        plain = int | float | str | bool
        rows = [
            {name: value if isinstance(value, plain) else str(value) for name, value in row.items()}
            for row in self.rows
        ]
        return ResultTable(rows, {"stability map": self.title, **provenance()})

    def chart(
        self,
        path: FilePath | None = None,
        lines: Mapping[str, Any | Callable[..., float]] | None = None,
        x: str | None = None,
        y: str | None = None,
        title: str | None = None,
        labels: Mapping[str, str] | None = None,
    ) -> Figure:
        """A coloured field for each cell; theory's limits as lines.

        Parameters
        ----------
        path : path-like, optional
            Write it here (``.png``, ``.svg``, ``.pdf``).
        lines : mapping, optional
            By the text of the legend: an array over the axes, or a function of the parameters, by
            keyword. The line is drawn where it is 1: ``{"h omega = 2": lambda step, stiffness:
            step * omega(stiffness) / 2}``. NaN: none there. A line that no cell's neighbour crosses
            is in the legend, with the side on which the cells are.
        x, y : str, optional
            Parameters along the axes of the chart; default: the last two. For each value of a third
            one there is a panel.
        title : str, optional
            Default: the name of the problem.
        labels : mapping, optional
            Names of the axes with their units, by the name of a parameter; other words for a
            status, by the status.

        Raises
        ------
        InputError
            If there is one parameter, or more than three, or no such parameter; if a line is of
            another shape; if the folder does not exist.
        ImportError
            Without matplotlib.
        """
        names = list(self.axes)
        if not 2 <= len(names) <= 3:
            raise InputError(
                "chart", f"of {len(names)} parameters, expected two, or three (panels)"
            )
        rest = [name for name in names if name not in (x, y)]
        x = x or rest.pop()
        y = y or rest.pop()
        if x == y or {x, y} - set(names):
            raise InputError("chart", f"x = {x!r}, y = {y!r}, expected two of {', '.join(names)}")
        fields = {text: self._line(text, line) for text, line in (lines or {}).items()}
        order = [*rest, y, x]
        places = [names.index(name) for name in order]
        return stability_chart(
            self.title if title is None else title,
            {name: self.axes[name] for name in order},
            self.status.transpose(places),
            {text: field.transpose(places) for text, field in fields.items()},
            path,
            labels,
        )

    def _line(self, text: str, line: Any) -> Floats:
        if callable(line):
            values = product(*self.axes.values())
            choices = [dict(zip(self.axes, choice, strict=True)) for choice in values]
            check_call(line, choices[0], f"line {text!r}")
            return np.array([float(line(**choice)) for choice in choices]).reshape(self.cells.shape)
        field = np.asarray(line, float)
        if field.shape != self.cells.shape:
            raise InputError(
                f"line {text!r}", f"shape {field.shape}, expected {self.cells.shape}, a cell each"
            )
        return field

    def counts(self) -> Mapping[str, int]:
        """Number of cells of each status."""
        return dict(sorted(Counter(str(cell.status) for cell in self.cells.flat).items()))

    def __str__(self) -> str:
        over = " x ".join(f"{name} ({len(values)})" for name, values in self.axes.items())
        found = ", ".join(f"{count} {name}" for name, count in self.counts().items())
        causes = Counter(cell.mechanism for cell in self.cells.flat if cell.mechanism)
        if causes:
            found += f"; failed by {', '.join(f'{k} ({n})' for k, n in causes.most_common())}"
        warned = sum(bool(cell.warnings) for cell in self.cells.flat)
        doubt = f", {warned} with warnings" if warned else ""
        return f"stability map over {over}: {found}{doubt}"

    def __repr__(self) -> str:
        return f"<{self}>"


# -- where a method fails: the outcome of runs over two parameters ---------------------------------

Judge = Callable[[Any], Any]


@checked
def stability_map(
    problem: Callable[..., Any],
    axes: Mapping[str, Iterable[Any]],
    outcome: Judge | None = None,
    executor: Executor | None = None,
    resume: FilePath | None = None,
    *,
    timeout_s: float | None = None,
    retry: bool = False,
    progress: bool | OnOutcome = False,
) -> Map:
    """Run a problem for all combinations of some parameters, and say how each run ended.

    Parameters
    ----------
    problem : callable
        Called as ``problem(step=1e-3, stiffness=1e4)`` with one value of each axis; gives a
        History, or raises. A step that fails counts as such only after the full protocol of
        attempts: give runs ``settings=FULL_PROTOCOL`` of :mod:`skfem_cosserat.accuracy`. A problem
        with an argument `settings` that has no value yet gets it from here.
    axes : mapping
        Values of each parameter by its name.
    outcome : callable, optional
        Judges the History or the exception; gives a
        :class:`~skfem_cosserat.accuracy.Verdict` or just its status. Default:
        :class:`~skfem_cosserat.accuracy.JudgeEnergy`, the energy at the start being
        the right one. It is called where the problem runs: only verdicts are kept.
    executor : executor, optional
        See :func:`~skfem_cosserat.run_all`: cells side by side.
    resume : path-like, optional
        A folder in which cells are kept as soon as they are done. The same call finds them again,
        also with more values on the axes.
    timeout_s : float, optional
        Longest time of a cell (s), see :class:`~skfem_cosserat.accuracy.TimeLimit`.
    retry : bool
        Run cells again whose judge has failed.
    progress : bool or callable
        See :func:`~skfem_cosserat.refine`.

    Returns
    -------
    Map

    Raises
    ------
    InputError
        For bad arguments, before the first cell; for a judge that cannot judge, when its first
        cell is done.

    Examples
    --------
    Free fall onto a spring, by the explicit Euler method, which gains energy:

    >>> def spring(step, omega):
    ...     x, v, states = 1.0, 0.0, []
    ...     for k in range(int(5 / step)):
    ...         states.append((x, v / omega))
    ...         x, v = x + step * v, v - step * omega**2 * x
    ...     q = np.array(states)
    ...     t = step * np.arange(len(q))
    ...     series = {"t": t, "step": np.arange(len(q)), "q": q, "p": q}
    ...     return History({"status": "completed"}, {}, series)
    >>> judge = JudgeEnergy(lambda history: (history["q"] ** 2).sum(1))
    >>> found = stability_map(spring, {"omega": (0.01, 1.0), "step": (1.0, 1e-3)}, judge)
    >>> found.status.tolist()
    [['ok', 'ok'], ['blowup', 'ok']]
    >>> print(found)
    stability map over omega (2) x step (2): 1 blowup, 3 ok; failed by energy (1)
    """
    values = _axes(axes)
    judge = JudgeEnergy() if outcome is None else outcome
    if not callable(judge):
        raise InputError("argument outcome", f"{outcome!r}, expected a function of a History")
    limit = time_limit(timeout_s)
    choices = [dict(zip(values, choice, strict=True)) for choice in product(*values.values())]
    check_call(problem, choices[0] | _settings(problem, choices[0]))
    jobs = [Job(case_name(c), _cell, case_name(c), problem, judge, c, limit) for c in choices]
    if len({job.name for job in jobs}) < len(jobs):
        raise InputError("argument axes", "holds the same value twice on an axis")
    title = title_of(problem)
    found = run_study(
        (f"stability map of {title}", "cells", "found.rows"),
        jobs,
        executor,
        folder=resume,
        progress=progress,
        check=_check,
        retry=retry,
    )
    cells = np.empty(len(found), object)
    cells[:] = [_verdict(each) for each in found]
    shape = [len(each) for each in values.values()]
    seconds = np.array([each.seconds for each in found])
    return Map(title, values, cells.reshape(shape), seconds.reshape(shape))


def _axes(given: Any) -> dict[str, list[Any]]:
    if not isinstance(given, Mapping) or not given:
        raise InputError("argument axes", f"{given!r}, expected values of parameters by name")
    found = {}
    for name, values in given.items():
        if isinstance(values, (str, Mapping)) or not isinstance(values, Iterable):
            raise InputError(f"axis {name!r}", f"{values!r}, expected a sequence of values")
        plain = [each.item() if isinstance(each, np.generic) else each for each in values]
        if not isinstance(name, str) or not plain:
            raise InputError(f"axis {name!r}", f"{values!r}, expected a name and some values")
        found[name] = plain
    return found


def _cell(
    name: str,
    problem: Callable[..., Any],
    judge: Judge,
    parameters: dict[str, Any],
    timeout_s: float | None,
) -> Verdict:
    """Run and judge a cell; what the judge raises is the cell's error."""
    running = Caught()
    history = None
    arguments = parameters | _settings(problem, parameters)
    with running, TimeLimit(timeout_s):
        history = problem(**arguments)
    error = running.error
    if error is not None and not isinstance(error, Exception):
        raise error
    if isinstance(history, History) and history.status == "interrupted":
        raise JobError(name, "it was interrupted")
    found = judge(history if error is None else error)
    if isinstance(found, str):
        found = Verdict(found)
    if not isinstance(found, Verdict):
        raise InputError("argument outcome", f"gave {found!r}, expected a Verdict or its status")
    return replace(found, kernels=ran(history if error is None else error))


def _settings(problem: Callable[..., Any], parameters: Mapping[str, Any]) -> dict[str, Any]:
    """The settings of runs, as an argument of a problem that takes them and has none."""
    try:
        taken = signature(problem).parameters.get("settings")
    except (TypeError, ValueError):
        return {}  # a builtin that does not tell, or nothing to call
    if taken is None or "settings" in parameters:
        return {}
    free = taken.default is None or taken.default is Parameter.empty
    return {"settings": FULL_PROTOCOL} if free else {}


def _check(outcome: Outcome) -> None:
    """End the study early if its judge cannot judge."""
    if isinstance(outcome.error, InputError):
        raise InputError(f"cell {outcome.name!r}", str(outcome.error)) from outcome.error


def _verdict(outcome: Outcome) -> Verdict:
    if outcome.error is None:
        return replace(outcome.value, warnings=told(outcome.warnings))
    state = "not run" if isinstance(outcome.error, JobError) else "error"
    reason = f"{type(outcome.error).__name__}: {outcome.error}"
    return Verdict(state, reason=reason, warnings=told(outcome.warnings))
