"""Independent jobs: in this process or others, kept in a folder, limited in time."""

from __future__ import annotations

import hashlib
import io
import os
import pickle
import re
import signal
import threading
import time
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import (
    BrokenExecutor,
    CancelledError,
    Future,
    ProcessPoolExecutor,
    as_completed,
)
from concurrent.futures import Executor as FuturesExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context, parent_process
from multiprocessing.connection import wait
from pathlib import Path
from subprocess import TimeoutExpired
from types import FrameType, FunctionType
from typing import Any, Protocol, runtime_checkable

from ..arguments import checked
from ..errors import CosseratWarning, Diverged, InputError, JobError, PerformanceWarning
from ..export import prepare_folder
from ..frames import Item
from ..history import History
from ..model import Model, System
from ..run.progress import Interrupt, Progress
from ..version import VERSION
from ..warn import Notices, counted, logger, repeat, warn

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

    def __init__(
        self, name: str, function: Callable[..., Any], /, *args: Any, **kwargs: Any
    ) -> None:
        if not isinstance(name, str) or not name:
            raise InputError("job", f"name = {name!r}, expected a non-empty string")
        if not callable(function):
            raise InputError(f"job {name!r}", f"{function!r} cannot be called")
        self.name, self.function, self.args, self.kwargs = name, function, args, kwargs

    def __repr__(self) -> str:
        called = getattr(self.function, "__name__", repr(self.function))
        return f"<Job {self.name!r}: {called}>"


@dataclass(frozen=True, eq=False, repr=False)
class Outcome:
    """What came of a job: a value or an error.

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
    warnings: Sequence[dict[str, Any]] = ()

    @property
    def ok(self) -> bool:
        """Whether there is a value."""
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
    seconds, error = time.perf_counter() - start, caught.error
    text = "" if error is None else _text(error)
    if isinstance(error, SystemExit):
        error = JobError(job.name, f"it called sys.exit({error.code!r})")
    elif error is not None and not isinstance(error, Exception):
        error = JobError(job.name, f"it raised {in_words(error)}")
    return Outcome(job.name, value, error, seconds, text, notices.kept())


def in_words(error: BaseException) -> str:
    """Kind and text of an error, whatever its text does."""
    text, asking = "(it has no text)", Caught()
    with asking:
        text = str(error)
    return f"{type(error).__name__}: {text}".rstrip(": ")


def _text(error: BaseException) -> str:
    return "".join(traceback.format_exception(error))


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


# -- there and back: pickled jobs and outcomes, functions by reference -----------------------------

#: what to do about a function
ADVICE = (
    "write functions with def at the top level of an importable module (parameters by"
    " functools.partial), give loads a Table, or run with executor=None"
)


def run_sent(name: str, sent: bytes) -> bytes:
    """Do a pickled job in a worker; its pickled outcome, whatever it is or does.

    Parameters
    ----------
    name : str
        Of the job.
    sent : bytes
    """
    outcome, working = None, Caught()
    try:
        with working, _interruptible():
            outcome = done(pickle.loads(sent))
    except KeyboardInterrupt:
        outcome = Outcome(name, error=JobError(name, "it was interrupted"))
    if outcome is None:
        assert working.error is not None
        what = f"it cannot be read in the worker process ({in_words(working.error)})"
        lost = JobError(name, f"{what}: what it refers to must be importable there")
        outcome = Outcome(name, error=lost, traceback=_text(working.error))
    sending, data = Caught(), b""
    with sending:
        data = pickle.dumps(outcome, pickle.HIGHEST_PROTOCOL)
        if not (outcome.ok or isinstance(pickle.loads(data).error, Exception)):
            raise TypeError("its pickled form is no error")
    if sending.error is None:
        return data
    kind = f"value, of type {type(outcome.value).__name__}"
    kind = kind if outcome.ok else f"error, {in_words(outcome.error or sending.error)}"
    lost = JobError(name, f"its {kind}, cannot travel between processes: {in_words(sending.error)}")
    text = outcome.traceback or _text(sending.error)
    return pickle.dumps(Outcome(name, None, lost, outcome.seconds, text, outcome.warnings))


@contextmanager
def _interruptible() -> Iterator[None]:
    """Ctrl-C reaches the job, where workers without one ignore it."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _received(name: str, data: bytes) -> Outcome:
    """The outcome that came back."""
    outcome, reading = None, Caught()
    with reading:
        outcome = pickle.loads(data)
    if isinstance(outcome, Outcome):
        return outcome
    why = "" if reading.error is None else f": {in_words(reading.error)}"
    return Outcome(name, error=JobError(name, f"what it gave cannot be read back{why}"))


def _sent(job: Job) -> bytes:
    """A job as bytes.

    Raises
    ------
    InputError
        Naming what stands in the way.
    """
    sending, data = Caught(), b""
    with sending:
        data = pickle.dumps(job, pickle.HIGHEST_PROTOCOL)
    if sending.error is None:
        return data
    named = {"function": job.function}
    named |= {f"argument {k + 1}": value for k, value in enumerate(job.args)}
    named |= {f"argument {name}": value for name, value in job.kwargs.items()}
    stuck = [item for item in named.items() if not _travels(item[1])] or list(named.items())
    where, value = _culprit(stuck[0][1], stuck[0][0])
    kind = getattr(value, "__qualname__", None)
    what = f"{kind!r}" if kind else f"an object of type {type(value).__name__!r}"
    text = f"{what} cannot be sent to another process: {ADVICE}"
    raise InputError(f"job {job.name!r}, {where}", text) from sending.error


def _travels(value: Any) -> bool:
    trial = Caught()
    with trial:
        pickle.dumps(value, pickle.HIGHEST_PROTOCOL)
    return trial.error is None


def _culprit(value: Any, where: str) -> tuple[str, Any]:
    """The smallest part of something that cannot be pickled, and the item that has it."""
    if isinstance(value, Item) and not isinstance(value, type):
        where = value.label
    parts: list[Any] = []
    if isinstance(value, System):
        parts = list(value.__reduce__()[1])
    elif isinstance(value, Model):
        parts = [value[name] for name in value]
    elif isinstance(value, Mapping):
        parts = list(value.values())
    elif isinstance(value, list | tuple | set | frozenset):
        parts = list(value)
    elif isinstance(value, partial):
        parts = [value.func, *value.args, *value.keywords.values()]
    elif type(value).__module__.startswith(__name__.split(".", maxsplit=1)[0]):
        parts = list(vars(value).values())
    for part in parts:
        if not _travels(part):
            return _culprit(part, where)
    return where, value


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
    """In a worker: Ctrl-C ends jobs, and no worker; it ends with the process that started it."""
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
    killed, others are started for what comes after.

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

    def __init__(self, workers: int | None = None, threads: int | None = 1) -> None:
        for name, value in (("workers", workers), ("threads", threads)):
            if value is not None and (type(value) is not int or value < 1):
                raise InputError(f"argument {name}", f"{value!r}, expected a positive integer")
        self.workers = workers or os.cpu_count() or 1
        self.threads = threads
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
        self.shutdown(cancel_futures=kind is not None)
        return None


@contextmanager
def _environment(threads: int | None) -> Iterator[None]:
    """The environment that a process starts with: a copy of our own at that moment."""
    if threads is None:
        yield
        return
    before = {name: os.environ.get(name) for name in THREADS}
    os.environ.update(dict.fromkeys(THREADS, str(threads)))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


# -- outcomes in a folder, so that a killed study goes on ------------------------------------------


class _Naming(pickle.Pickler):
    """Takes functions by their names, whatever they are."""

    def reducer_override(self, value: Any) -> Any:
        """A name in place of a function."""
        if isinstance(value, FunctionType):
            return str, (f"{value.__module__}.{value.__qualname__}",)
        return NotImplemented


class _Store:
    """A folder of outcomes, one file each."""

    def __init__(self, folder: Path) -> None:
        prepare_folder(folder)
        self.folder = folder

    def path(self, job: Job) -> Path:
        """File of a job: its name, made readable, and a sum of all that it is called with."""
        memory, naming = io.BytesIO(), Caught()
        what = VERSION, job.name, job.function, job.args, job.kwargs
        with naming:
            _Naming(memory, pickle.HIGHEST_PROTOCOL).dump(what)
        if naming.error is not None:
            raise InputError(
                f"job {job.name!r}",
                f"has arguments that cannot be recognised in a later run ({naming.error}): use"
                " plain data and functions, or folder=None",
            ) from naming.error
        digest = hashlib.sha256(memory.getvalue()).hexdigest()[:12]
        readable = re.sub(r"[^\w.+-]+", "_", job.name)[:80]
        return self.folder / f"{readable}.{digest}.case"

    def read(self, job: Job) -> Outcome | None:
        """The outcome that is kept, if there is one that can be read."""
        path, outcome, reading = self.path(job), None, Caught()
        if not path.exists():
            return None
        with reading:
            outcome = pickle.loads(path.read_bytes())
        if isinstance(outcome, Outcome):
            return outcome
        text = f"cannot be read ({reading.error}): the job is run again"
        warn(f"file {str(path)!r}", text, PerformanceWarning)
        return None

    def write(self, job: Job, outcome: Outcome) -> None:
        """Keep an outcome that another run would have too: at once or not at all."""
        if isinstance(outcome.error, JobError) or outcome.status == "interrupted":
            return
        pickling, data = Caught(), b""
        with pickling:
            data = pickle.dumps(outcome, pickle.HIGHEST_PROTOCOL)
        if pickling.error is not None:
            raise InputError(
                f"job {job.name!r}",
                f"gave what cannot be kept in a file ({pickling.error}): give numbers, arrays or a"
                " History, or take folder=None",
            ) from pickling.error
        path = self.path(job)
        part = path.with_name(f".{path.name}.{os.getpid()}.part")
        try:
            part.write_bytes(data)
            part.replace(path)
        except OSError as error:
            item = f"folder {str(self.folder)!r}"
            raise InputError(item, f"cannot be written: {error.strerror}") from error


# -- run a list of jobs, here or through an executor -----------------------------------------------

#: loss by an executor that is worth a word (s)
WORTH = 1.0
OnOutcome = Callable[[int, int, Outcome], object]


@runtime_checkable
class Executor(Protocol):
    """What takes jobs: `submit` gives a future with ``result()`` and ``cancel()``."""

    def submit(self, function: Any, /, *args: Any) -> Any:
        """Have ``function(*args)`` called somewhere."""


@checked
def run_all(
    jobs: Iterable[Job],
    executor: Executor | None = None,
    *,
    folder: str | os.PathLike[str] | None = None,
    retry: bool = False,
    progress: bool | OnOutcome = False,
    check: Callable[[Outcome], object] | None = None,
    tell: bool = True,
) -> list[Outcome]:
    """Run independent jobs; give their outcomes in the order of the jobs.

    A job that fails does not disturb the others: look at ``outcome.error``, or call
    ``outcome.result()``, which raises it. Warnings of a job are kept in ``outcome.warnings``, and
    given here with its name when it is done.

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
        their worker or were interrupted by Ctrl-C. A job is known by its name, the name of its
        function and its arguments: take another folder when a function has changed. Files are
        pickled: read only what you wrote.
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
    after all jobs.

    A worker that is killed makes its job fail with a :class:`JobError`. With :class:`Processes` all
    jobs that were not done by then run again, one at a time, so that only the one to blame fails. A
    ``ProcessPoolExecutor`` is broken after that: all unfinished jobs fail. Dask tries the job again
    some times.

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
    jobs = list(jobs)
    names = [job.name for job in jobs]
    for name in names:
        if names.count(name) > 1:
            raise InputError("argument jobs", f"two jobs are called {name!r}")
    if isinstance(executor, type) or not isinstance(executor, Executor | None):
        raise InputError(
            "argument executor",
            f"{executor!r}, expected None or an object with submit(), such as Processes(2)",
        )
    store = None if folder is None else _Store(Path(folder))
    kept: dict[str, Outcome] = {}
    if store is not None:
        stored = {job.name: store.read(job) for job in jobs}
        kept = {name: each for name, each in stored.items() if each and (each.ok or not retry)}
    missing = {job.name: job for job in jobs if job.name not in kept}
    sent = {} if executor is None else {name: _sent(job) for name, job in missing.items()}
    results, raised = dict(kept), list[CosseratWarning]()
    begun = time.monotonic()
    with Progress(progress, _line) as show:

        def keep(outcome: Outcome) -> None:
            results[outcome.name] = outcome
            if store is not None:
                store.write(missing[outcome.name], outcome)
            if check is not None:
                check(outcome)
            try:
                if tell:
                    repeat(outcome.warnings, f"job {outcome.name!r}, ")
            except CosseratWarning as warning:  # an error, if the user wants it so: after all jobs
                raised.append(warning)
            show(len(results), len(jobs), outcome)

        if check is not None:
            for outcome in kept.values():
                check(outcome)
        try:
            if executor is None:
                _run_here(missing.values(), keep)
            else:
                _run_there(sent, executor, results, keep)
        except KeyboardInterrupt as error:
            error.outcomes = _in_order(names, results)  # type: ignore[attr-defined]
            raise
    outcomes = _in_order(names, results)
    try:
        if executor is not None:
            _judge([results[name] for name in missing if name in results], time.monotonic() - begun)
    except CosseratWarning as warning:
        raised.append(warning)
    if raised:
        raised[0].outcomes = outcomes  # type: ignore[attr-defined]
        raise raised[0]
    return outcomes


def _judge(outcomes: Sequence[Outcome], elapsed: float) -> None:
    """Say if the jobs would have been done sooner one after the other."""
    alone = sum(outcome.seconds for outcome in outcomes if outcome.seconds >= 0)
    if elapsed > alone + WORTH and all(outcome.seconds >= 0 for outcome in outcomes):
        text = (
            f"{len(outcomes)} jobs took {elapsed:.2g} s with it, but no more than {alone:.2g} s in"
            " themselves: one after the other in this process (executor=None) they would be done"
            " sooner. Starting workers takes half a second; executors that stay open do it once"
        )
        warn("argument executor", text, PerformanceWarning)


def _line(done: int, count: int, outcome: Outcome) -> str:
    return f"{done} of {count} jobs done, last {outcome.name!r}"


def _in_order(names: Iterable[str], results: Mapping[str, Outcome]) -> list[Outcome]:
    """All outcomes; jobs without one were not run."""
    return [results.get(name, Outcome(name, error=JobError(name, CANCELLED))) for name in names]


def _run_here(jobs: Iterable[Job], keep: Callable[[Outcome], None]) -> None:
    with Interrupt("no further job is started") as interrupt:
        for job in jobs:
            keep(done(job))
            if interrupt.asked:
                return


def _run_there(
    sent: Mapping[str, bytes],
    executor: Executor,
    results: Mapping[str, Outcome],
    keep: Callable[[Outcome], None],
) -> None:
    """Run pickled jobs by an executor; those that a broken pool has lost again, one at a time."""
    futures: dict[str, Any] = {}
    again = isinstance(executor, Processes)
    try:
        try:
            for name, data in sent.items():
                futures[name] = _submitted(executor, name, data)
            lost = _collect(futures, keep, again)
            for name in lost:
                futures[name] = _submitted(executor, name, sent[name])
                _collect({name: futures[name]}, keep, False)
        except KeyboardInterrupt:
            logger.info("interrupted: no further job is started, those running are waited for")
            left = {name: each for name, each in futures.items() if name not in results}
            _cancel(left)
            _collect(left, keep, False)
    finally:
        _cancel({name: each for name, each in futures.items() if name not in results})


def _submitted(executor: Executor, name: str, data: bytes) -> Any:
    """A future; one that has failed where the executor takes nothing any more."""
    try:
        return executor.submit(run_sent, name, data)
    except (RuntimeError, OSError) as error:  # broken by a job before, or closed
        future: Future[Any] = Future()
        future.set_exception(error)
        return future


def _collect(futures: Mapping[str, Any], keep: Callable[[Outcome], None], again: bool) -> list[str]:
    """Keep outcomes as they come, or in order where futures are not those of Python.

    With `again` names of jobs that a broken pool has lost are given instead of an outcome.
    """
    lost, names = [], {id(future): name for name, future in futures.items()}
    own = all(isinstance(future, Future) for future in futures.values())
    for future in as_completed(futures.values()) if own else futures.values():
        name, answer, waiting = names[id(future)], None, Caught()
        with waiting:  # jobs raise nothing: this is about the executor
            answer = future.result()
        if answer is not None:
            keep(_received(name, answer))
        elif again and isinstance(waiting.error, BrokenExecutor):
            lost.append(name)
        else:
            keep(_lost(name, waiting.error))
    return lost


def _cancel(futures: Mapping[str, Any]) -> None:
    for future in futures.values():
        future.cancel()


def _lost(name: str, error: BaseException | None) -> Outcome:
    """What the executor says instead of an answer."""
    if isinstance(error, BrokenExecutor):
        what = f"its worker process ended before it answered ({error})"
    elif isinstance(error, CancelledError):
        what = CANCELLED
    else:
        what = "the executor gave no answer" + (f": {in_words(error)}" if error else "")
    lost = JobError(name, what)
    lost.__cause__ = error
    return Outcome(name, error=lost)
