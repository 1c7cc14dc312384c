"""Running jobs: here, in processes of our own, by executors of others."""

from __future__ import annotations

import gc
import os
import pickle
import signal
import socket
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import (
    BrokenExecutor,
    CancelledError,
    Future,
    ThreadPoolExecutor,
    as_completed,
)
from concurrent.futures import (
    Executor as FuturesExecutor,
)
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from multiprocessing import get_context
from multiprocessing.connection import wait
from multiprocessing.util import Finalize
from time import monotonic, sleep
from typing import Any, Protocol, cast, runtime_checkable

from ..arguments import checked
from ..errors import CosseratWarning, InputError, JobError, PerformanceWarning
from ..run.progress import Interrupt, Progress
from ..warn import logger, repeat, warn
from .jobs import (
    Answer,
    Caught,
    Job,
    Outcome,
    Packed,
    Packer,
    done_here,
    in_words,
    read,
    refusal,
    run_packed,
)

# -- worker processes on this machine, each for one job at a time ----------------------------------

#: variables that say how many threads a process takes, read when numpy or numba are loaded
THREADS = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "BLIS_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
    "NUMBA_NUM_THREADS",
)
#: name of what is called by somebody else than run_all
CALL = "a call of an executor"
#: seconds that a worker without work may take to end
PATIENCE = 10.0
#: bytes that a worker can send before somebody reads them, where the system grants so many
WIDTH = 1 << 20
_STARTING = threading.Lock()


class WorkerEndedError(BrokenProcessPool):
    """The process that did a job ended before it answered."""


@checked
class Processes(FuturesExecutor):
    """An executor of worker processes: the crash of one costs the job it had, and nothing else.

    Workers are started when they are needed, as new Python processes ("spawn"), and kept. One that
    is killed is replaced. Used as a context it ends them; those at work are ended too if the block
    raises.

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
        self._threads = ThreadPoolExecutor(self.workers, "worker")  # each waits for its process
        self._own = threading.local()
        self._workers: list[_Worker] = []
        self._ended = False  # whatever is at work is killed

    def submit(self, function: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Have ``function(*args, **kwargs)`` called in a worker.

        Returns
        -------
        Future
            Its result raises ``BrokenProcessPool`` if the worker ended before it answered.
        """
        if function is run_packed:  # it is packed already
            return self._threads.submit(self._ask, *args)
        return self._threads.submit(self._call, Packer().pack(Job(CALL, function, *args, **kwargs)))

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the workers: those at work when they are done."""
        self._threads.shutdown(wait, cancel_futures=cancel_futures)
        if not wait:
            threading.Thread(target=self.shutdown).start()
            return
        for waiting in False, True:  # they end side by side
            for worker in self._workers:
                worker.close(waiting)

    def __exit__(self, kind: type[BaseException] | None, *error: object) -> bool | None:
        if kind is not None:  # nobody will ask for what is under way
            self._threads.shutdown(wait=False, cancel_futures=True)
            self._ended = True
            for worker in self._workers:
                worker.process.terminate()
        self.shutdown()
        return None

    def _call(self, packed: Packed) -> Any:
        """In a thread: the value of a call."""
        outcome = read(CALL, self._ask(packed))
        repeat(outcome.warnings)
        return outcome.result()

    def _ask(self, packed: Packed) -> Answer:
        """In a thread: have the thread's own process do the job."""
        worker: _Worker | None = getattr(self._own, "worker", None)
        if worker is None or worker.ended(0.0):
            worker = self._own.worker = _Worker(self.threads)
            self._workers.append(worker)
        if self._ended:
            worker.process.terminate()
        return worker.ask(packed)


def _serve(end: socket.socket) -> None:
    """In a worker: do what comes until nothing more comes. Ctrl-C ends jobs, and no worker."""
    gc.freeze()  # to search all modules for garbage would take 0.1 s when the worker ends
    handler, pipe = signal.signal(signal.SIGINT, signal.SIG_IGN), _pipe(end)
    while (packed := _received(pipe)) is not None:
        answer: Answer | KeyboardInterrupt
        try:
            signal.signal(signal.SIGINT, handler)
            answer = run_packed(packed)
        except KeyboardInterrupt as error:
            answer = error
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        _send(pipe, answer)


def _pipe(end: socket.socket) -> Any:
    """A file: what is written to it is read at the other end, and the other way round."""
    end.settimeout(None)  # whatever the default of other sockets is
    end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, WIDTH)
    with end:
        return end.makefile("rwb")


def _send(pipe: Any, thing: Any) -> None:
    """Send plain data, large arrays without a copy; it is lost if nobody is there any more."""
    with suppress(OSError):
        pickle.dump(thing, pipe, pickle.HIGHEST_PROTOCOL)
        pipe.flush()


def _received(pipe: Any) -> Any:
    """What was sent from the other end; None if nobody is there any more."""
    try:
        return pickle.load(pipe)
    except (EOFError, OSError, pickle.UnpicklingError):
        return None


def _finish(pipe: Any) -> None:
    """Tell a worker that nothing more comes."""
    _send(pipe, None)
    with suppress(OSError):  # what could not be sent
        pipe.close()


class _Worker:
    """A process and a pipe to it: when it breaks, it costs nobody else's job."""

    def __init__(self, threads: int | None) -> None:
        end, other = socket.socketpair()
        self.process = get_context("spawn").Process(target=_serve, args=(other,))
        with other, _STARTING, _environment(threads):
            self.process.start()
        self._pipe = _pipe(end)
        # also when nobody has it any more, and before this process waits for others at its own end
        self._finish = Finalize(self, _finish, (self._pipe,), exitpriority=0)

    def ask(self, packed: Packed) -> Answer:
        """Send a job and wait for the answer."""
        _send(self._pipe, packed)
        answer = _received(self._pipe)
        if answer is None:
            self.close()
            raise WorkerEndedError(f"its worker process ended {self._ending()}")
        if isinstance(answer, KeyboardInterrupt):
            raise answer
        return cast("Answer", answer)

    def close(self, waiting: bool = True) -> None:
        """Let it end when it is done; threads that a job left running do not keep it."""
        self._finish()
        if waiting:
            if not self.ended(PATIENCE):
                self.process.kill()
            self.process.join()

    def ended(self, patience: float) -> bool:
        """Whether its process has ended after so many seconds, if not before."""
        return bool(wait([self.process.sentinel], patience))

    def _ending(self) -> str:
        until = monotonic() + PATIENCE  # a thread that starts another may be about to note the code
        while (code := self.process.exitcode) is None and monotonic() < until:
            sleep(0.01)
        if code is not None and code < 0:
            names = {each.value: each.name for each in signal.Signals}
            return f"by signal {names.get(-code, -code)}"
        if code == 1:
            return (
                'with exit code 1 (a script needs `if __name__ == "__main__":` around what it does)'
            )
        return f"with exit code {code}"


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


# -- run a list of jobs, here or through an executor -----------------------------------------------

#: loss by an executor that is worth a word (s)
WORTH = 1.0
#: why a job was not run
CANCELLED = "cancelled before it started"
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
    progress: bool | OnOutcome = False,
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
        ``dask.distributed.Client(...).get_executor()``, and the like. It stays open. None is ever
        chosen for you: short jobs are done sooner in this process, and a
        :class:`PerformanceWarning` says so where that costs more than a second.
    progress : bool or callable
        True: one line on stderr; a callable gets (number done, number of jobs, outcome) as soon as
        each job is done. If it raises, what has not started yet is cancelled.

    Returns
    -------
    list of Outcome

    Raises
    ------
    InputError
        Before any job starts: for bad arguments, and if a job cannot be sent to an executor's
        workers: the error names the load, drive or argument that stands in the way.

    Notes
    -----
    To an executor (threads too) goes a copy of the job, made by ``pickle``, with functions and
    classes by reference: no code travels, the workers must have the package, and the modules that
    your functions are in. A worker freezes a system once for all jobs that have it; where other
    arguments, as the places of sensors, belong to the same model, it does so for each job. Results
    are the same to the last bit on machines of one kind, if BLAS has the same number of threads,
    and kernels are the same: ``kernels="auto"`` may take numpy here and compiled ones there.
    Without an executor functions are called with the very objects of the job, and need not be
    importable.

    Ctrl-C: no further job is started, those running are waited for (a simulation ends after its
    step, if its process got the Ctrl-C too), and what there is is returned; jobs that did not run
    have a :class:`JobError`. A second one raises KeyboardInterrupt, with the outcomes so far as
    its attribute ``outcomes``. So has the first warning of a job where warnings are errors, raised
    after all jobs.

    A worker that is killed makes its job fail with a :class:`JobError`. A ``ProcessPoolExecutor``
    is broken after that, so that all unfinished jobs fail and it cannot be told which one was to
    blame; :class:`Processes` starts another worker and goes on, Dask tries the job again some
    times.

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
    jobs = _checked(jobs)
    if isinstance(executor, type) or not isinstance(executor, Executor | None):
        raise InputError(
            "argument executor",
            f"{executor!r}, expected None or an object with submit(), such as Processes(2)",
        )
    packed = [] if executor is None else _all_packed(jobs)
    results: dict[int, Outcome] = {}
    raised: list[CosseratWarning] = []
    begun = monotonic()
    with Progress(progress, _line) as show:

        def keep(number: int, outcome: Outcome) -> None:
            results[number] = outcome
            try:
                repeat(outcome.warnings, f"job {outcome.name!r}, ")
            except CosseratWarning as warning:  # an error, if the user wants it so: after all jobs
                raised.append(warning)
            show(len(results), len(jobs), outcome)

        try:
            if executor is None:
                _run_here(jobs, keep)
            else:
                _run_there(jobs, packed, executor, results, keep)
        except KeyboardInterrupt as error:
            error.outcomes = _in_order(jobs, results)  # type: ignore[attr-defined]
            raise
    outcomes = _in_order(jobs, results)
    if executor is not None:
        try:
            _judge(outcomes, monotonic() - begun)
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


def _checked(jobs: Iterable[Job]) -> list[Job]:
    jobs = list(jobs)
    names: set[str] = set()
    for job in jobs:
        if job.name in names:
            raise InputError("argument jobs", f"two jobs are called {job.name!r}")
        names.add(job.name)
    return jobs


def _all_packed(jobs: Sequence[Job]) -> list[Packed]:
    packed, packer = [], Packer()
    for job in jobs:
        packing = Caught()
        with packing:
            packed.append(packer.pack(job))
        if packing.error is not None:
            raise refusal(job, packing.error) from packing.error
    return packed


def _in_order(jobs: Sequence[Job], results: dict[int, Outcome]) -> list[Outcome]:
    """All outcomes; jobs without one were not run."""
    return [
        results.get(k, Outcome(job.name, error=JobError(job.name, CANCELLED)))
        for k, job in enumerate(jobs)
    ]


def _run_here(jobs: Sequence[Job], keep: Callable[[int, Outcome], None]) -> None:
    with Interrupt("no further job is started") as interrupt:
        for number, job in enumerate(jobs):
            keep(number, done_here(job))
            if interrupt.asked:
                return


def _run_there(
    jobs: Sequence[Job],
    packed: list[Packed],
    executor: Executor,
    results: dict[int, Outcome],
    keep: Callable[[int, Outcome], None],
) -> None:
    futures: dict[int, Any] = {}
    try:
        try:
            for number, data in enumerate(packed):
                try:
                    futures[number] = executor.submit(run_packed, data)
                except (RuntimeError, OSError) as error:  # broken by a job before, or closed
                    keep(number, _lost(jobs[number], error))
            _collect(jobs, futures, keep)
        except KeyboardInterrupt:
            logger.info("interrupted: no further job is started, those running are waited for")
            left = {k: future for k, future in futures.items() if k not in results}
            _cancel(left)
            _collect(jobs, left, keep)
    finally:
        _cancel({k: future for k, future in futures.items() if k not in results})


def _collect(
    jobs: Sequence[Job], futures: dict[int, Any], keep: Callable[[int, Outcome], None]
) -> None:
    for number in _as_they_come(futures):
        answer, waiting = None, Caught()
        with waiting:  # jobs raise nothing: this is about the executor
            answer = futures[number].result()
        job = jobs[number]
        keep(number, _lost(job, waiting.error) if answer is None else read(job.name, answer))


def _as_they_come(futures: dict[int, Any]) -> Iterator[int]:
    """Numbers of jobs that are done; in order if the futures are not those of Python."""
    if not all(isinstance(future, Future) for future in futures.values()):
        yield from futures
        return
    numbers = {future: number for number, future in futures.items()}
    for future in as_completed(numbers):
        yield numbers[future]


def _cancel(futures: dict[int, Any]) -> None:
    for future in futures.values():
        future.cancel()


def _lost(job: Job, error: BaseException | None) -> Outcome:
    """What the executor says instead of an answer."""
    if isinstance(error, WorkerEndedError):
        what = str(error)
    elif isinstance(error, BrokenExecutor):
        what = f"a worker process ended while this job or another one ran: {error}"
    elif isinstance(error, CancelledError):
        what = CANCELLED
    else:
        what = "the executor gave no answer" + (f": {in_words(error)}" if error else "")
    lost = JobError(job.name, what)
    lost.__cause__ = error
    return Outcome(job.name, error=lost)
