"""Setups of a work-precision study, and what comes of a run."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import partial
from itertools import product
from typing import Any, NamedTuple

from ..arguments import checked
from ..errors import Diverged, InputError, JobError
from ..history import History
from ..types import positive
from .run import LATE, TimeLimit, in_words

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
    if isinstance(given, str | Mapping) or not isinstance(given, Iterable):
        raise InputError("argument setups", f"{given!r}, {expected}")
    found, labels = [], set()
    for each in given:
        if not isinstance(each, tuple | list) or not 2 <= len(each) <= len(Setup._fields):
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
    state, reason = str(result["status"]), str(result.get("reason", ""))
    return (state, reason) if state in STATUSES else ("error", f"{state}: {reason}".rstrip(": "))


def told_of(result: Any) -> Mapping[str, Any]:
    """Names and values that a history, that of an error, or a mapping tells of its run."""
    if isinstance(result, Exception):
        result = getattr(result, "history", None)
    found = result.meta if isinstance(result, History) else result
    return found if isinstance(found, Mapping) else {}


def ran(result: Any) -> str:
    """Kernels that ran, as far as a result or an error tells; empty: not told."""
    return str(told_of(result).get("kernels", ""))
