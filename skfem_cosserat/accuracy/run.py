"""Independent jobs: in this process or others, kept in a folder, limited in time."""

from __future__ import annotations

import hashlib
import io
import math
import os
import pickle
import re
import signal
import threading
import time
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Future, ProcessPoolExecutor
from concurrent.futures import Executor as FuturesExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from inspect import signature
from itertools import count, islice
from multiprocessing import get_context, parent_process
from multiprocessing.connection import wait
from pathlib import Path
from queue import SimpleQueue
from subprocess import TimeoutExpired
from types import FrameType, FunctionType
from typing import Any, Protocol, runtime_checkable

import numpy as np
import skfem

from ..analysis.progress import Interrupt, Progress
from ..arguments import checked
from ..errors import CosseratWarning, Diverged, InputError, JobError, PerformanceWarning
from ..export import prepare_folder
from ..frames import Item
from ..history import History
from ..types import FilePath, positive, switch, whole
from ..version import VERSION
from ..warn import Notice, Notices, counted, logger, repeat, sum_up, warn

# -- jobs and their outcomes -----------------------------------------------------------------------

#: why a job was not run
CANCELLED = "cancelled before it started"


@checked
class Job:
    """A call to make, under a name.

    Parameters
    ----------
    name : str
        Of the job, in progress and errors; not empty.
    function : callable
        To reach another process it must be importable there: at the top level of a module.
        ``simulate``, ``static`` and ``modes`` are.
    *args, **kwargs
        What it is called with. To reach another process all must be data: models, systems, states
        and histories are. A beam takes some 1 kB an element; a function that builds the model where
        it is needed takes nothing.

    Raises
    ------
    InputError
        If the name is empty or the function cannot be called.

    Examples
    --------
    >>> import math
    >>> Job("two", math.hypot, 3.0, 4.0)
    <Job 'two': hypot>
    """

    def __init__(self, name: str, function: Callable[..., Any], /, *args: Any, **kwargs: Any):
        if not isinstance(name, str) or not name:
            raise InputError("job", f"name = {name!r}, expected a non-empty string")
        if not callable(function):
            raise InputError(f"job {name!r}", f"{function!r} cannot be called")
        self.name, self.function, self.args, self.kwargs = name, function, args, kwargs

    def __repr__(self) -> str:
        called = getattr(self.function, "__name__", repr(self.function))
        return f"<Job {self.name!r}: {called}>"


@dataclass(frozen=True, eq=False)
class Outcome:
    """Outcome of a job: a value or an error.

    Attributes
    ----------
    name : str
        Of the job.
    value : object
        What its function gave; None if it failed.
    error : Exception or None
        What it raised, with its attributes (``Diverged`` with ``history``, ``residuals``, ...), or
        a :class:`JobError` if its worker ended, it called ``sys.exit`` or raised what is no
        ``Exception``, it was cancelled, or something could not travel.
    seconds : float
        How long its function ran (s); NaN if that is not known.
    traceback : str
        Where it failed, as text; empty if it did not.
    warnings : sequence of dict
        Given on the way, as in ``history.meta["warnings"]``.

    Examples
    --------
    >>> import math
    >>> from skfem_cosserat import run_all
    >>> good, bad = run_all([Job("4", math.sqrt, 4.0), Job("-1", math.sqrt, -1.0)])
    >>> good.result(), bad.ok, type(bad.error).__name__
    (2.0, False, 'ValueError')
    """

    name: str
    value: Any = None
    error: Exception | None = None
    seconds: float = float("nan")
    traceback: str = ""
    warnings: Sequence[Notice] = ()

    @property
    def ok(self) -> bool:
        """True if there is a value."""
        return self.error is None

    @property
    def status(self) -> str:
        """In a word: ``ok``, ``diverged``, ``interrupted``, ``not run`` or ``error``."""
        if self.ok:
            stopped = isinstance(self.value, History) and self.value.status == "interrupted"
            return "interrupted" if stopped else "ok"
        if isinstance(self.error, Diverged):
            return "diverged"
        cancelled = isinstance(self.error, JobError) and self.error.reason == CANCELLED
        return "not run" if cancelled else "error"

    def result(self) -> Any:
        """The value; raises the error if there is none."""
        if self.error is not None:
            raise self.error
        return self.value

    def __repr__(self) -> str:
        if self.error is None:
            what = f"{type(self.value).__name__} in {self.seconds:.3g} s"
        else:
            what = in_words(self.error)
        return f"<Outcome {self.name!r}: {what}{counted(self.warnings)}>"


class Caught:
    """A context that keeps what a job raises: its error is its outcome, and not ours.

    Ctrl-C goes through; a job that calls ``sys.exit`` has failed, but ends nobody else, and so has
    one with an error that is no ``Exception``, as asyncio's for what was cancelled.
    """

    def __init__(self) -> None:
        self.error: BaseException | None = None

    def __enter__(self) -> Caught:
        return self

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> bool:
        if error is None or isinstance(error, KeyboardInterrupt):
            return False
        self.error = error
        return True


def done(job: Job) -> Outcome:
    """Do a job in this process, and keep what it raises and warns of."""
    value, caught, start = None, Caught(), time.perf_counter()
    with Notices(quiet=True, alone=True) as notices, caught:
        value = job.function(*job.args, **job.kwargs)
    seconds = time.perf_counter() - start
    error = caught.error
    text = "" if error is None else _text(error)
    if error is not None and not isinstance(error, Exception):  # as of sys.exit
        error = JobError(job.name, f"it raised {in_words(error)}")
    return Outcome(job.name, value, error, seconds, text, notices.kept())


def in_words(error: BaseException) -> str:
    """Kind and text of an error, whatever its text does."""
    text = "(it has no text)"
    asking = Caught()
    with asking:
        text = str(error)
    return f"{type(error).__name__}: {text}".rstrip(": ")


def _text(error: BaseException) -> str:
    return "".join(traceback.format_exception(error))


# -- calls in words, and what results tell of their runs -----------------------------------------


def case_name(arguments: Mapping[str, Any]) -> str:
    """Arguments in words.

    Examples
    --------
    >>> case_name({"elements": 8, "step": 1e-3})
    'elements = 8, step = 0.001'
    """
    return ", ".join(f"{name} = {text(value)}" for name, value in arguments.items())


def text(value: Any) -> str:
    """A number or a mesh in a few characters."""
    if isinstance(value, skfem.Mesh):
        return f"{value.nelements} elements up to {longest(value):.9g}"
    return repr(value)


def longest(mesh: skfem.Mesh) -> float:
    """Length of the longest element of a mesh."""
    ends = mesh.p[:, mesh.t]
    return float(np.linalg.norm(ends[:, 0] - ends[:, -1], axis=0).max())


def title_of(problem: Any) -> str:
    """Name of the problem, with what is bound to it as far as it is short."""
    bound = problem.keywords if isinstance(problem, partial) else {}
    function = problem.func if isinstance(problem, partial) else problem
    name = str(getattr(function, "__name__", type(function).__name__))
    short = {key: each for key, each in bound.items() if isinstance(each, (int, float, str))}
    return f"{name} ({case_name(short)})" if short else name


def check_call(problem: Any, arguments: Mapping[str, Any], item: str = "argument problem") -> None:
    """Refuse a problem that does not take these arguments by keyword."""
    if not callable(problem):
        raise InputError(item, f"{problem!r} cannot be called")
    try:
        signature(problem).bind(**arguments)
    except ValueError:
        return  # a builtin that does not tell
    except TypeError as error:
        raise InputError(
            item,
            f"takes {signature(problem)}, but the study calls it with {', '.join(arguments)} as"
            f" keywords: {error}",
        ) from error


def told_of(result: Any) -> Mapping[str, Any]:
    """Names and values that a history, that of an error, or a mapping tells of its run."""
    if isinstance(result, Exception):
        result = getattr(result, "history", None)
    found = result.meta if isinstance(result, History) else result
    return found if isinstance(found, Mapping) else {}


def ran(result: Any) -> str:
    """Kernels that ran, as far as a result or an error tells; empty: not told."""
    return str(told_of(result).get("kernels", ""))


# -- A limit on the time that a call may take ------------------------------------------------------

#: what says that something took too long, a subprocess (such as a peer) too
LATE = (TimeoutError, TimeoutExpired)


def time_limit(seconds: Any) -> float | None:
    """The argument `timeout_s` of a study, checked."""
    if seconds is None:
        return None
    return positive("argument timeout_s", "timeout_s", seconds, " of seconds")


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

    def __init__(self, seconds: float | None):
        self.seconds = seconds
        here = threading.current_thread() is threading.main_thread()
        self._alarm = seconds is not None and here and "SIGALRM" in signal.Signals.__members__

    def __enter__(self) -> TimeLimit:
        self._begun = time.monotonic()
        if self._alarm:
            self._before = signal.signal(signal.SIGALRM, self._stop)
            signal.setitimer(signal.ITIMER_REAL, self.seconds or 0.0)
        return self

    def _stop(self, number: int = 0, frame: FrameType | None = None) -> None:
        raise TimedOut(f"not done within {self.seconds:g} s")

    def __exit__(self, kind: type[BaseException] | None, *error: object) -> None:
        if self._alarm:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            signal.signal(signal.SIGALRM, self._before)
        elif kind is None and time.monotonic() - self._begun > (self.seconds or math.inf):
            self._stop()


# -- there and back: pickled jobs and outcomes, functions by reference -----------------------------


def run_sent(name: str, sent: bytes) -> bytes:
    """Do a pickled job in a worker; its pickled outcome, whatever it is or does.

    Parameters
    ----------
    name : str
        Of the job.
    sent : bytes
    """
    job: Any = None
    reading = Caught()
    lost = JobError(name, "it was interrupted")
    with reading:
        job = pickle.loads(sent)
    try:
        if reading.error is None:
            outcome = done(job)
        else:
            why = f"it cannot be read in the worker process ({in_words(reading.error)})"
            lost = JobError(name, f"{why}: what it refers to must be importable there")
            outcome = Outcome(name, error=lost, traceback=_text(reading.error))
    except KeyboardInterrupt:
        outcome = Outcome(name, error=lost)
    sending = Caught()
    data = b""
    with sending:
        data = pickle.dumps(outcome, pickle.HIGHEST_PROTOCOL)
        if not (outcome.ok or isinstance(pickle.loads(data).error, Exception)):
            raise TypeError("its pickled form is no error")
    if sending.error is None:
        return data
    kind = f"value, of type {type(outcome.value).__name__}"
    kind = kind if outcome.error is None else f"error, {in_words(outcome.error)}"
    lost = JobError(name, f"its {kind}, cannot travel between processes: {in_words(sending.error)}")
    where = outcome.traceback or _text(sending.error)
    return pickle.dumps(replace(outcome, value=None, error=lost, traceback=where))


class _Noting(pickle.Pickler):
    """Keeps what it takes apart, one after the other."""

    noted: list[Any]

    def reducer_override(self, value: Any) -> Any:
        """Pickle it as usual."""
        self.noted.append(value)
        return NotImplemented


def _stuck(value: Any) -> list[Any]:
    """Values that pickle visited until it failed, at the last one; empty if it did not fail."""
    pickler = _Noting(io.BytesIO(), pickle.HIGHEST_PROTOCOL)
    trial = Caught()
    pickler.noted = [value]
    with trial:
        pickler.dump(value)
    return pickler.noted if trial.error else []


def _sent(job: Job) -> bytes:
    """A job as bytes.

    Raises
    ------
    InputError
        Naming what stands in the way, and the item or argument that has it.
    """
    sending = Caught()
    data = b""
    with sending:
        data = pickle.dumps(job, pickle.HIGHEST_PROTOCOL)
    if sending.error is None:
        return data
    parts = {"function": job.function}
    parts |= {f"argument {k + 1}": value for k, value in enumerate(job.args)}
    parts |= {f"argument {name}": value for name, value in job.kwargs.items()}
    where, noted = next(
        ((where, noted) for where, part in parts.items() if (noted := _stuck(part))), ("", [job])
    )
    items = (each for each in reversed(noted) if isinstance(each, Item) and _stuck(each))
    where = next((item.label for item in items), where)
    stuck = noted[-1]
    name = getattr(stuck, "__qualname__", None)
    what = f"{name!r}" if name else f"an object of type {type(stuck).__name__!r}"
    raise InputError(
        f"job {job.name!r}, {where}",
        f"{what} cannot be sent to another process: write functions with def at the top level of an"
        " importable module (parameters by functools.partial), give loads a Table, or run with"
        " executor=None",
    ) from sending.error


# -- worker processes ------------------------------------------------------------------------------

#: variables that say how many threads a process takes, read when numpy or numba are loaded
THREADS = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "BLIS_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
    "NUMBA_NUM_THREADS",
)
_STARTING = threading.Lock()


def _prepared() -> None:
    """In a worker: Ctrl-C ends simulations, and no worker; it ends with the process it is for."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_follow, daemon=True).start()


def _follow() -> None:
    parent = parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)


@checked
class Processes(FuturesExecutor):
    """An executor of worker processes on this machine, each for one job at a time.

    Workers are started when they are needed, as new Python processes ("spawn"), and kept. If one is
    killed, others are started for what comes after. Used as a context it ends them; those at work
    are ended too if the block raises.

    Parameters
    ----------
    workers : int, optional
        How many at most; default: one a processor.
    threads : int, optional
        Threads of BLAS and numba in each: the variables ``OPENBLAS_NUM_THREADS``,
        ``NUMBA_NUM_THREADS`` and so on of the workers' environment, not of your own. None: as in
        yours.

    Raises
    ------
    InputError
        If a number is not positive.

    Notes
    -----
    As with all processes of this kind, a script that uses them needs
    ``if __name__ == "__main__":`` around what it does.

    Examples
    --------
    >>> import math
    >>> from skfem_cosserat import Job, run_all
    >>> with Processes(1) as executor:
    ...     outcomes = run_all([Job(f"{x}", math.sqrt, x) for x in (4.0, -1.0)], executor)
    >>> [outcome.ok for outcome in outcomes]
    [True, False]
    """

    def __init__(self, workers: int | None = None, threads: int | None = 1):
        workers = (os.cpu_count() or 1) if workers is None else workers
        self.workers = whole("argument workers", workers, 1)
        self.threads = None if threads is None else whole("argument threads", threads, 1)
        self._pool = self._made()

    def _made(self) -> ProcessPoolExecutor:
        return ProcessPoolExecutor(self.workers, get_context("spawn"), initializer=_prepared)

    def submit(self, function: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Have ``function(*args, **kwargs)`` called in a worker.

        Returns
        -------
        Future
            Its result raises ``BrokenProcessPool`` if a worker ended before it answered.
        """
        with _STARTING, _environment(self.threads):
            try:
                return self._pool.submit(function, *args, **kwargs)
            except BrokenProcessPool:
                self._pool = self._made()
                return self._pool.submit(function, *args, **kwargs)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the workers: those at work when they are done."""
        self._pool.shutdown(wait, cancel_futures=cancel_futures)

    def __exit__(self, kind: type[BaseException] | None, *error: object) -> bool | None:
        if kind is not None:  # nobody will ask for what is under way
            for process in list((self._pool._processes or {}).values()):
                process.terminate()
        self.shutdown()
        return None


@contextmanager
def _environment(threads: int | None) -> Iterator[None]:
    """The environment that a process starts with: a copy of our own at that moment."""
    names = () if threads is None else THREADS
    before = {name: os.environ[name] for name in names if name in os.environ}
    os.environ.update(dict.fromkeys(names, str(threads)))
    try:
        yield
    finally:
        for name in names:
            del os.environ[name]
        os.environ.update(before)


# -- outcomes in a folder, so that a killed study goes on ------------------------------------------


class _Naming(pickle.Pickler):
    """Takes functions inside others by name, line and what they have from around them."""

    def reducer_override(self, value: Any) -> Any:
        """Replace a function inside another one by its name, line, closure and defaults."""
        if not isinstance(value, FunctionType) or "<" not in value.__qualname__:
            return NotImplemented
        name = f"{value.__module__}.{value.__qualname__} {value.__code__.co_firstlineno}"
        cells = [cell.cell_contents for cell in value.__closure__ or ()]
        return str, (name,), [cells, value.__defaults__, value.__kwdefaults__]


def _path(folder: Path, job: Job) -> Path:
    """File of a job: its name, made readable, and a sum of its pickled form and our version."""
    memory = io.BytesIO()
    naming = Caught()
    with naming:
        _Naming(memory, pickle.HIGHEST_PROTOCOL).dump((VERSION, job))
    if naming.error is not None:
        raise InputError(
            f"job {job.name!r}",
            f"has arguments that cannot be recognised in a later run ({naming.error}): use plain"
            " data and functions, or folder=None",
        ) from naming.error
    digest = hashlib.sha256(memory.getvalue()).hexdigest()[:12]
    readable = re.sub(r"[^\w.+-]+", "_", job.name)[:80]
    return folder / f"{readable}.{digest}.case"


def _kept(path: Path) -> Outcome | None:
    """The outcome in a file, if there is one that can be read."""
    outcome = None
    reading = Caught()
    if not path.exists():
        return None
    with reading:
        outcome = pickle.loads(path.read_bytes())
    if isinstance(outcome, Outcome):
        return outcome
    text = f"cannot be read ({reading.error}): the job is run again"
    warn(f"file {str(path)!r}", text, PerformanceWarning)
    return None


def _write(path: Path, outcome: Outcome) -> None:
    """Keep an outcome that another run would have too: at once or not at all."""
    if isinstance(outcome.error, JobError) or outcome.status == "interrupted":
        return
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    writing = Caught()
    with writing:
        part.write_bytes(pickle.dumps(outcome, pickle.HIGHEST_PROTOCOL))
        part.replace(path)
    if writing.error is not None:
        raise InputError(
            f"folder {str(path.parent)!r}",
            f"what job {outcome.name!r} gave cannot be kept in it ({in_words(writing.error)}):"
            " give numbers, arrays or a History, or take folder=None",
        ) from writing.error


# -- run a list of jobs, here or through an executor -----------------------------------------------

#: loss by an executor that is worth a word (s)
WORTH = 1.0
OnOutcome = Callable[[int, int, Outcome], object]


@runtime_checkable
class Executor(Protocol):
    """Protocol of executors: `submit` gives a future with ``result()`` and ``cancel()``."""

    def submit(self, function: Any, /, *args: Any) -> Any:
        """Have ``function(*args)`` called somewhere."""


@checked
def run_all(
    jobs: Iterable[Job],
    executor: Executor | None = None,
    *,
    folder: FilePath | None = None,
    retry: bool = False,
    progress: bool | OnOutcome = False,
    check: Callable[[Outcome], object] | None = None,
    tell: bool = True,
) -> list[Outcome]:
    """Run independent jobs; give their outcomes in the order of the jobs.

    A job that fails does not disturb the others: look at ``outcome.error``, or call
    ``outcome.result()``, which raises it. Warnings of a job are kept in ``outcome.warnings``, and
    given here with its name when all are done.

    Parameters
    ----------
    jobs : iterable of Job
        With different names.
    executor : executor, optional
        None: one job after the other in this process. Otherwise anything whose ``submit`` gives
        futures: :class:`Processes`, a ``concurrent.futures`` executor,
        ``dask.distributed.Client(...)``, and the like. It stays open. None is ever
        chosen for you: short jobs are done sooner in this process, and a
        :class:`PerformanceWarning` says so where that costs more than a second.
    folder : path-like, optional
        Made if needed. Each outcome is written there as soon as it is there, failures too, and jobs
        whose outcomes are there already are not run; not written are jobs that did not run, lost
        their worker or were interrupted by Ctrl-C. A job is known by its name, its arguments
        and the module and name of its function (one inside another function by its line and what it
        takes from there, too): take another folder when a function, or a number that it takes from
        its module, has changed. Files are pickled: read only what you wrote.
    retry : bool
        Run jobs again that have failed in the folder.
    progress : bool or callable
        True: one line on stderr; a callable gets (number done, number of jobs, outcome) as soon as
        each job is done. If it raises, what has not started yet is cancelled.
    check : callable, optional
        Gets each outcome first, also those from the folder; what it raises ends all.
    tell : bool
        Give the warnings of jobs again here.

    Returns
    -------
    list of Outcome

    Raises
    ------
    InputError
        Before any job starts: for bad arguments, and if a job cannot be sent to an executor's
        workers: the error names the load, drive or argument that stands in the way. If the folder
        cannot be written, or a result cannot be pickled for it.

    Notes
    -----
    To an executor (threads too) goes a copy of the job, made by ``pickle``, with functions and
    classes by reference: no code travels, the workers must have the package, and the modules that
    your functions are in. A worker freezes the system of a job anew. Results are the same to the
    last bit on machines of one kind, if BLAS has the same number of threads, and kernels are the
    same: ``kernels="auto"`` may take numpy here and compiled ones there. Without an executor
    functions are called with the very objects of the job, and need not be importable.

    Ctrl-C: no further job is started, those running are waited for (a simulation ends after its
    step, if its process got the Ctrl-C too), and what there is is returned; jobs that did not run
    have a :class:`JobError`. A second one raises KeyboardInterrupt, with the outcomes so far as
    its attribute ``outcomes``. So has the first warning of a job where warnings are errors, raised
    after all jobs. A ``ProcessPoolExecutor`` has one job more than workers, which starts.

    A worker that is killed makes its job fail with a :class:`JobError`. With :class:`Processes` the
    jobs that ran at that time run again after the others, one at a time, so that only the one to
    blame fails. A ``ProcessPoolExecutor`` is broken after that: all unfinished jobs fail. Dask
    tries the job again some times.

    Start one thread a worker: with several processes, threads of BLAS and numba only disturb each
    other. :class:`Processes` sees to it; for other executors set ``OPENBLAS_NUM_THREADS=1`` (or
    what your BLAS takes) and ``NUMBA_NUM_THREADS=1`` in the environment before they start.

    Examples
    --------
    A pendulum let go at three heights; here in this process, with ``Processes(2)`` in two others:

    >>> import skfem_cosserat as sc
    >>> def pendulum(x):
    ...     model = sc.Model()
    ...     bob = model.add("bob", sc.MassPoint(1.0, position=(x, 0, -1)))
    ...     model.add("rod", sc.JointDistance(sc.ground((0, 0, 0)), bob.place()))
    ...     model.add("gravity", sc.LoadGravity((0, 0, -9.81)))
    ...     return model.freeze()
    >>> scheme = sc.EnergyMomentum(), sc.NullSpace()
    >>> jobs = [
    ...     sc.Job(f"x = {x}", sc.simulate, pendulum(x), *scheme, step=0.01, until=0.1)
    ...     for x in (0.1, 0.2, 0.4)
    ... ]
    >>> [len(outcome.result()) for outcome in sc.run_all(jobs)]
    [11, 11, 11]
    """
    switch("argument retry", retry)
    by_name = {}
    for job in jobs:
        if job.name in by_name:
            raise InputError("argument jobs", f"two jobs are called {job.name!r}")
        by_name[job.name] = job
    if isinstance(executor, type) or not isinstance(executor, Executor | None):
        raise InputError(
            "argument executor",
            f"{executor!r}, expected None or an object with submit(), such as Processes(2)",
        )
    outcomes = {name: Outcome(name, error=JobError(name, CANCELLED)) for name in by_name}
    paths = {}
    missing = by_name
    if folder is not None:
        prepare_folder(Path(folder))
        paths = {name: _path(Path(folder), job) for name, job in by_name.items()}
        found = {name: _kept(path) for name, path in paths.items()}
        outcomes |= {name: each for name, each in found.items() if each and (each.ok or not retry)}
        missing = {name: job for name, job in by_name.items() if outcomes[name] is not found[name]}
    sent = {} if executor is None else {name: _sent(job) for name, job in missing.items()}
    number = count(len(by_name) - len(missing) + 1)
    begun = time.monotonic()
    with Progress(progress, "{} of {} jobs done, last {.name!r}".format) as show:

        def keep(outcome: Outcome) -> None:
            outcomes[outcome.name] = outcome
            if paths:
                _write(paths[outcome.name], outcome)
            if check is not None:
                check(outcome)
            show(next(number), len(by_name), outcome)

        if check is not None:
            for name in by_name.keys() - missing.keys():
                check(outcomes[name])
        try:
            if executor is None:
                _run_here(missing.values(), keep)
            else:
                _run_there(sent, executor, keep)
        except KeyboardInterrupt as error:
            error.outcomes = [*outcomes.values()]  # type: ignore[attr-defined]
            raise
    elapsed = time.monotonic() - begun
    try:
        for name, outcome in outcomes.items() if tell else ():
            repeat(outcome.warnings, f"job {name!r}, ")
        if executor is not None:
            _judge([outcomes[name] for name in missing], elapsed)
    except CosseratWarning as warning:  # an error, if the user wants it so
        warning.outcomes = [*outcomes.values()]  # type: ignore[attr-defined]
        raise
    return [*outcomes.values()]


def run_study(
    about: tuple[str, str, str], jobs: Iterable[Job], executor: Executor | None, **options: Any
) -> list[Outcome]:
    """Outcomes of the jobs of a study, as of :func:`run_all`; their warnings are summed up once.

    Parameters
    ----------
    about : tuple of str
        Its name, what its jobs are ("levels"), and where their warnings can be read.
    jobs, executor, **options
        Of :func:`run_all`.
    """
    outcomes = run_all(jobs, executor, tell=False, **options)
    study, kind, where = about
    sum_up(study, kind, {each.name: each.warnings for each in outcomes}, where)
    return outcomes


def _judge(outcomes: Sequence[Outcome], elapsed: float) -> None:
    """Say if the jobs would have been done sooner one after the other."""
    alone = sum(outcome.seconds for outcome in outcomes)
    if (
        elapsed > alone + WORTH
    ):  # never where one was lost: nobody knows how long it would have taken
        text = (
            f"{len(outcomes)} jobs took {elapsed:.2g} s with it, but no more than {alone:.2g} s in"
            " themselves: one after the other in this process (executor=None) they would be done"
            " sooner. Starting workers takes half a second; executors that stay open do it once"
        )
        warn("argument executor", text, PerformanceWarning)


def _run_here(jobs: Iterable[Job], keep: Callable[[Outcome], None]) -> None:
    with Interrupt("no further job is started") as interrupt:
        for job in jobs:
            keep(done(job))
            if interrupt.asked:
                return


def _run_there(
    sent: Mapping[str, bytes], executor: Executor, keep: Callable[[Outcome], None]
) -> None:
    """Run pickled jobs by an executor.

    Workers of ours have one job each: none is started after Ctrl-C, and one that is killed takes no
    more with it than what runs at the same time. That runs again, one job at a time.
    """
    futures: dict[str, Any] = {}
    ready: SimpleQueue[str] = SimpleQueue()
    names = list(sent)
    alone = False
    try:
        while names:
            room = executor.workers if isinstance(executor, Processes) else len(names)
            room, rest, lost = 1 if alone else room, iter(names), []
            while True:
                for name in islice(rest, room - len(futures)):
                    futures[name] = _submitted(executor, name, sent[name], ready)
                if not futures:
                    break
                name = ready.get()
                outcome = _outcome(name, futures[name])
                del futures[name]
                broken = isinstance(getattr(outcome.error, "__cause__", None), BrokenExecutor)
                if broken and not alone and isinstance(executor, Processes):
                    lost.append(name)
                else:
                    keep(outcome)
            names = lost
            alone = True
    except KeyboardInterrupt:
        logger.info("interrupted: no further job is started, those running are waited for")
        for future in futures.values():
            future.cancel()
        for name, future in list(futures.items()):
            keep(_outcome(name, future))
            del futures[name]
    finally:
        for future in futures.values():
            future.cancel()


def _submitted(executor: Executor, name: str, data: bytes, ready: SimpleQueue[str]) -> Any:
    """A future; its job is ready when it is done, or at once where it cannot tell that."""
    try:
        future = executor.submit(run_sent, name, data)
    except (RuntimeError, OSError) as error:  # broken by a job before, or closed
        future = Future()
        future.set_exception(error)
    if hasattr(future, "add_done_callback"):
        future.add_done_callback(lambda _: ready.put(name))
    else:
        ready.put(name)
    return future


def _outcome(name: str, future: Any) -> Outcome:
    """Outcome that a future gives, or the executor's error instead of it."""
    outcome = None
    waiting = Caught()
    with waiting:  # jobs raise nothing: this is about the executor
        outcome = pickle.loads(future.result())
    if isinstance(outcome, Outcome):
        return outcome
    error = waiting.error
    if isinstance(error, BrokenExecutor):
        what = f"its worker process ended before it answered ({error})"
    elif isinstance(error, CancelledError):
        what = CANCELLED
    else:
        what = "no answer came back" + (f": {in_words(error)}" if error else "")
    lost = JobError(name, what)
    lost.__cause__ = error
    return Outcome(name, error=lost)
