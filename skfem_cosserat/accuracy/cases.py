"""Independent cases of a study: what they are known by, how long they take, how they are kept."""

from __future__ import annotations

import hashlib
import json
import os
import pickle
import re
import signal
import threading
import time
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from pathlib import Path
from subprocess import TimeoutExpired
from types import BuiltinFunctionType, CodeType, FrameType, FunctionType, MethodType
from typing import Any

import numpy as np
import skfem

from ..accuracy.executors import CANCELLED
from ..arguments import checked
from ..errors import Diverged, InputError, JobError, PerformanceWarning
from ..export import prepare_folder
from ..history import History
from ..run.progress import Progress
from ..version import VERSION
from ..warn import Notices, warn
from .executors import Executor, run_all
from .jobs import Caught, Job, Outcome

# -- A limit on the time that a call may take ------------------------------------------------------

#: what says that something took too long, a subprocess (such as a peer) too
LATE = (TimeoutError, TimeoutExpired)


class TimedOut(TimeoutError):
    """A call took longer than it may.

    Attributes
    ----------
    history : History or None
        Of the run that was stopped, if it was one of ``simulate``.

    Examples
    --------
    >>> issubclass(TimedOut, TimeoutError)
    True
    """

    history: Any = None


@checked
class TimeLimit:
    """A context that ends with :class:`TimedOut` what takes longer than this.

    In the main thread of a process on systems with SIGALRM (all but Windows) it is stopped there
    and then, between two instructions of Python; elsewhere it is only told afterwards.

    Parameters
    ----------
    seconds : float or None
        None: no limit.

    Examples
    --------
    >>> with TimeLimit(10.0):
    ...     total = sum(range(10))
    >>> try:
    ...     with TimeLimit(0.01):
    ...         while True:
    ...             pass
    ... except TimedOut as error:
    ...     print(error)
    not done within 0.01 s
    """

    def __init__(self, seconds: float | None) -> None:
        self.seconds = seconds
        here = threading.current_thread() is threading.main_thread()
        self._alarm = seconds is not None and here and "SIGALRM" in signal.Signals.__members__

    def __enter__(self) -> TimeLimit:
        self._begun = time.monotonic()
        if self._alarm and self.seconds is not None:
            self._before = signal.signal(signal.SIGALRM, self._stop)
            signal.setitimer(signal.ITIMER_REAL, self.seconds)
        return self

    def _stop(self, number: int, frame: FrameType | None) -> None:
        raise self._error()

    def _error(self) -> TimedOut:
        return TimedOut(f"not done within {self.seconds:g} s")

    def __exit__(self, kind: type[BaseException] | None, *error: object) -> None:
        if self._alarm:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            signal.signal(signal.SIGALRM, self._before)
        elif kind is None and self.seconds is not None and self._late():
            raise self._error()

    def _late(self) -> bool:
        return self.seconds is not None and time.monotonic() - self._begun > self.seconds


# -- what makes a case the same case again: texts that change with functions and arguments ---------


def digest(text: str) -> str:
    """Twelve characters that stand for a text.

    Examples
    --------
    >>> digest("step = 0.1") == digest("step = 0.1"), digest("step = 0.1") == digest("step = 0.2")
    (True, False)
    """
    return hashlib.sha256(text.encode()).hexdigest()[:12]


def token(value: Any, item: str) -> str:
    """Text that is the same for equal values, in this run of Python and in others.

    Numbers, text, arrays, containers, meshes and functions (by module, name, code, what is bound to
    them, and the numbers, texts and arrays that they take from their module) are told apart by
    themselves, all else by its pickled data.

    Raises
    ------
    InputError
        If a value cannot be pickled.

    Examples
    --------
    >>> token({"step": 0.5, "elements": (4, 8)}, "arguments")
    "{'elements': (4, 8), 'step': 0.5}"
    """
    if value is None or isinstance(value, bool | int | float | complex | str | bytes):
        return repr(value)
    if isinstance(value, np.generic):
        return token(value.item(), item)
    if isinstance(value, np.ndarray):
        return f"array {value.shape} {value.dtype} {_bytes(value)}"
    if isinstance(value, list | tuple):
        return "(" + ", ".join(token(each, item) for each in value) + ")"
    if isinstance(value, set | frozenset):
        return "{" + ", ".join(sorted(token(each, item) for each in value)) + "}"
    if isinstance(value, Mapping):
        pairs = sorted((token(key, item), token(each, item)) for key, each in value.items())
        return "{" + ", ".join(f"{key}: {each}" for key, each in pairs) + "}"
    if isinstance(value, skfem.Mesh):
        names = token([value.boundaries, value.subdomains], item)
        return f"{type(value).__name__} {_bytes(value.p)} {_bytes(value.t)} {digest(names)}"
    if isinstance(value, partial):
        return f"partial({token([value.func, value.args, value.keywords], item)})"
    if isinstance(value, FunctionType):
        bound = [value.__defaults__, value.__kwdefaults__, _cells(value), _constants(value)]
        code = digest(_code(value.__code__) + token(bound, item))
        return f"{value.__module__}.{value.__qualname__} (code {code})"
    if isinstance(value, MethodType):
        return f"{token(value.__self__, item)}.{token(value.__func__, item)}"
    if isinstance(value, BuiltinFunctionType | type):
        return f"{value.__module__}.{value.__qualname__}"
    return _pickled(value, item)


@checked
def identity(**values: Any) -> dict[str, str]:
    """Tokens by name, with the version of the package: what all cases of a study share.

    Examples
    --------
    >>> list(identity(problem=print))
    ['problem', 'version of skfem-cosserat']
    """
    tokens = {name: token(value, f"argument {name}") for name, value in values.items()}
    return tokens | {"version of skfem-cosserat": VERSION}


def _bytes(array: Any) -> str:
    return hashlib.sha256(np.ascontiguousarray(array).tobytes()).hexdigest()[:12]


def _cells(function: FunctionType) -> list[Any]:
    """What a function has taken along from around it; it may be itself that it calls."""
    contents = [cell.cell_contents for cell in function.__closure__ or ()]
    return [each for each in contents if each is not function]


def _constants(function: FunctionType) -> dict[str, Any]:
    """Plain data that a function takes from its module, by name: ``LENGTH = 2.0`` at its top."""
    around = function.__globals__
    names = sorted(name for name in _names(function.__code__) if not name.startswith("__"))
    return {name: around[name] for name in names if name in around and _plain(around[name])}


def _names(code: CodeType) -> set[str]:
    """Of what the instructions look up, also those of functions inside."""
    inner = (_names(each) for each in code.co_consts if isinstance(each, CodeType))
    return set(code.co_names).union(*inner)


def _plain(value: Any) -> bool:
    """Lists and dicts are not: functions keep their notes in them."""
    if isinstance(value, tuple):
        return all(_plain(each) for each in value)
    return isinstance(value, bool | int | float | complex | str | np.generic | np.ndarray)


def _code(code: CodeType) -> str:
    """Instructions and constants: comments, docstrings and the place in the file do not count."""
    constants = [
        _code(each) if isinstance(each, CodeType) else token(each, "constant")
        for each in code.co_consts
        if each is not Ellipsis
    ]
    document = code.co_consts[0] if code.co_consts else None
    if isinstance(document, str):
        constants = constants[1:]
    return f"{code.co_code.hex()} {code.co_names} {constants}"


def _pickled(value: Any, item: str) -> str:
    caught, data = Caught(), b""
    with caught:
        data = pickle.dumps(value, pickle.HIGHEST_PROTOCOL)
    if caught.error is not None:
        raise InputError(
            item,
            f"holds an object of type {type(value).__name__!r} that cannot be recognised in a later"
            f" run ({caught.error}): use plain data and functions, or folder=None",
        ) from caught.error
    return f"{type(value).__name__} {hashlib.sha256(data).hexdigest()[:12]}"


# -- independent cases, each kept in a folder once it is done, so that a killed study goes on ------

OnOutcome = Callable[[int, int, Outcome], object]
INDEX = "study.json"
FORMAT = 1


@checked
def run_cases(
    jobs: Iterable[Job],
    executor: Executor | None = None,
    *,
    folder: str | os.PathLike[str] | None = None,
    identity: Mapping[str, str] | None = None,
    progress: bool | OnOutcome = False,
    check: Callable[[Outcome], object] | None = None,
    retry: bool = False,
) -> list[Outcome]:
    """Run jobs as `run_all` does; with a folder only those that are not in it yet.

    Parameters
    ----------
    jobs : iterable of Job
        With different names.
    executor : executor, optional
        See :func:`run_all`.
    folder : path-like, optional
        Made if needed. Each outcome is written as soon as it is there, failures too; not written
        are jobs that did not run, lost their worker or were interrupted by Ctrl-C. A case is
        recognised by its name and arguments.
    identity : mapping of str to str, optional
        What all cases in the folder share, see :func:`~skfem_cosserat.accuracy.cases.identity`.
    progress : bool or callable
        See :func:`run_all`; cases that the folder holds are counted as done.
    check : callable, optional
        Gets each outcome first, also those from the folder; what it raises ends the study.
    retry : bool
        Run cases again that have failed.

    Returns
    -------
    list of Outcome
        In the order of the jobs.

    Raises
    ------
    InputError
        If the folder holds cases of another identity: the error names what differs; if it cannot
        be written, or a result cannot be pickled.

    Notes
    -----
    Files in the folder are pickled: read only what you wrote.

    Examples
    --------
    >>> import math, tempfile
    >>> jobs = [Job(f"x = {x}", math.sqrt, x) for x in (1.0, 4.0, -1.0)]
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     first = run_cases(jobs, folder=folder)
    ...     again = run_cases(jobs, folder=folder)  # nothing is computed
    >>> [outcome.value for outcome in again], status(again[2])
    ([1.0, 2.0, None], 'error')
    """
    jobs = list(jobs)
    store = None if folder is None else _Store(Path(folder), dict(identity or {}))
    kept: dict[str, Outcome] = {}
    if store is not None:
        found = {job.name: store.read(job) for job in jobs}
        kept = {name: each for name, each in found.items() if each and (each.ok or not retry)}
    missing = [job for job in jobs if job.name not in kept]
    by_name = {job.name: job for job in jobs}
    with Progress(progress, _line) as show:

        def keep(done: int, _count: int, outcome: Outcome) -> None:
            if store is not None:
                store.write(by_name[outcome.name], outcome)
            if check is not None:
                check(outcome)
            show(len(kept) + done, len(jobs), outcome)

        if check is not None:
            for outcome in kept.values():
                check(outcome)
        with Notices(quiet=True, alone=True):  # outcomes have them, the study sums them up
            new = {each.name: each for each in run_all(missing, executor, progress=keep)}
    return [kept.get(job.name) or new[job.name] for job in jobs]


@checked
def status(outcome: Outcome) -> str:
    """In a word: ``ok``, ``diverged``, ``interrupted``, ``not run`` or ``error``."""
    if outcome.ok:
        return "interrupted" if _interrupted(outcome.value) else "ok"
    if isinstance(outcome.error, Diverged):
        return "diverged"
    if isinstance(outcome.error, JobError) and outcome.error.reason == CANCELLED:
        return "not run"
    return "error"


def _line(done: int, count: int, outcome: Outcome) -> str:
    return f"{done} of {count} cases done, last {outcome.name!r}"


def _interrupted(value: Any) -> bool:
    return isinstance(value, History) and value.status == "interrupted"


class _Store:
    """A folder of outcomes, one file each."""

    def __init__(self, folder: Path, identity: dict[str, str]) -> None:
        prepare_folder(folder)
        self.folder = folder
        index = folder / INDEX
        if not index.exists():
            content = {"format": FORMAT, "identity": identity}
            self._replace(index, json.dumps(content, indent=1).encode())
        found = self._index(index)
        for name in found | identity:
            if found.get(name) != identity.get(name):
                raise InputError(
                    self.label,
                    f"holds cases of another study: {name} was {found.get(name)}, is now"
                    f" {identity.get(name)}; choose another folder or delete this one",
                )

    @property
    def label(self) -> str:
        return f"folder {str(self.folder)!r}"

    def _index(self, path: Path) -> dict[str, str]:
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise InputError(self.label, f"its {INDEX} cannot be read: {error}") from error
        if not isinstance(content, dict) or content.get("format") != FORMAT:
            raise InputError(self.label, f"its {INDEX} is not of a study of format {FORMAT}")
        return dict(content["identity"])

    def path(self, job: Job) -> Path:
        """File of a case: its name, made readable, and a sum of its arguments."""
        what = token([job.name, job.args, job.kwargs], f"case {job.name!r}")
        readable = re.sub(r"[^\w.+-]+", "_", job.name)[:80]
        return self.folder / f"{readable}.{digest(what)}.case"

    def read(self, job: Job) -> Outcome | None:
        """The outcome that is kept, if there is one that can be read."""
        path, outcome, reading = self.path(job), None, Caught()
        if not path.exists():
            return None
        with reading:
            outcome = pickle.loads(path.read_bytes())
        if isinstance(outcome, Outcome):
            return outcome
        text = f"cannot be read ({reading.error}): the case is run again"
        warn(f"file {str(path)!r}", text, PerformanceWarning)
        return None

    def write(self, job: Job, outcome: Outcome) -> None:
        """Keep an outcome that another run would have too."""
        if isinstance(outcome.error, JobError) or _interrupted(outcome.value):
            return
        pickling, data = Caught(), b""
        with pickling:
            data = pickle.dumps(outcome, pickle.HIGHEST_PROTOCOL)
        if pickling.error is not None:
            raise InputError(
                f"case {job.name!r}",
                f"gave what cannot be kept in a file ({pickling.error}): give numbers, arrays or"
                " a History, or take folder=None",
            ) from pickling.error
        self._replace(self.path(job), data)

    def _replace(self, path: Path, data: bytes) -> None:
        """Write at once or not at all."""
        part = path.with_name(f".{path.name}.{os.getpid()}.part")
        try:
            part.write_bytes(data)
            part.replace(path)
        except OSError as error:
            raise InputError(self.label, f"cannot be written: {error.strerror}") from error
