"""Where a method fails: the outcome of runs over two parameters."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np

from ..errors import InputError, JobError
from ..history import History
from ..integrators.protocol import unless_given
from ..parallel import Executor, Job, Outcome
from ..parallel.jobs import Caught
from ..types import positive
from .cases import OnOutcome, run_cases
from .fingerprint import identity
from .levels import case_name, check_call
from .limit import TimeLimit
from .run import title_of
from .setups import ran
from .stability_table import Map
from .verdict import FULL_PROTOCOL, JudgeEnergy, Verdict

__all__ = ["stability_map"]

Judge = Callable[[Any], Any]


def stability_map(
    problem: Callable[..., Any],
    axes: Mapping[str, Iterable[Any]],
    outcome: Judge | None = None,
    executor: Executor | None = None,
    resume: str | os.PathLike[str] | None = None,
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
        attempts, ``FULL_PROTOCOL`` of :mod:`skfem_cosserat.study`: runs in here take it unless
        they are given other settings.
    axes : mapping
        Values of each parameter by its name.
    outcome : callable, optional
        Judges the History or the exception; gives a :class:`~skfem_cosserat.study.Verdict` or just
        its status. Default: :class:`~skfem_cosserat.study.JudgeEnergy`, the energy at the start
        being the right one. It is called where the problem runs: only verdicts are kept.
    executor : executor, optional
        See :func:`~skfem_cosserat.run_all`: cells side by side.
    resume : path-like, optional
        A folder in which cells are kept as soon as they are done. The same call finds them again,
        also with more values on the axes.
    timeout_s : float, optional
        Longest time of a cell (s), see :class:`~skfem_cosserat.study.TimeLimit`.
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
    >>> judge = JudgeEnergy(lambda history: (history["q"] ** 2).sum(axis=1))
    >>> found = stability_map(spring, {"omega": (0.01, 1.0), "step": (1.0, 1e-3)}, judge)
    >>> found.status.tolist()
    [['ok', 'ok'], ['blowup', 'ok']]
    >>> print(found)
    stability map over omega (2) x step (2): 1 blowup, 3 ok
    """
    values = _axes(axes)
    judge = JudgeEnergy() if outcome is None else outcome
    if not callable(judge):
        raise InputError("argument outcome", f"{outcome!r}, expected a function of a History")
    if timeout_s is not None:
        timeout_s = positive("argument timeout_s", "timeout_s", timeout_s, " of seconds")
    choices = [dict(zip(values, choice, strict=True)) for choice in product(*values.values())]
    check_call(problem, choices[0])
    jobs = [Job(case_name(c), _cell, case_name(c), problem, judge, c, timeout_s) for c in choices]
    if len({job.name for job in jobs}) < len(jobs):
        raise InputError("argument axes", "holds the same value twice on an axis")
    shared = {} if resume is None else identity(problem=problem, outcome=judge)
    found = run_cases(
        jobs,
        executor,
        folder=resume,
        identity=shared,
        progress=progress,
        check=_check,
        retry=retry,
    )
    shape = tuple(len(each) for each in values.values())
    cells = np.empty(len(found), dtype=object)
    cells[:] = [_verdict(each) for each in found]
    seconds = np.array([each.seconds for each in found])
    return Map(title_of(problem), values, cells.reshape(shape), seconds.reshape(shape))


def _axes(given: Any) -> dict[str, list[Any]]:
    if not isinstance(given, Mapping) or not given:
        raise InputError("argument axes", f"{given!r}, expected values of parameters by name")
    found = {}
    for name, values in given.items():
        if isinstance(values, str | Mapping) or not isinstance(values, Iterable):
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
    running, history = Caught(), None
    with running, TimeLimit(timeout_s), unless_given(FULL_PROTOCOL):
        history = problem(**parameters)
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


def _check(outcome: Outcome) -> None:
    """End the study early if its judge cannot judge."""
    if isinstance(outcome.error, InputError):
        raise InputError(f"cell {outcome.name!r}", str(outcome.error)) from outcome.error


def _verdict(outcome: Outcome) -> Verdict:
    if outcome.error is None:
        return outcome.value
    state = "not run" if isinstance(outcome.error, JobError) else "error"
    return Verdict(state, reason=f"{type(outcome.error).__name__}: {outcome.error}")
