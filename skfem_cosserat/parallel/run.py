"""Run a list of jobs, here or through an executor."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Future, as_completed
from typing import Any, Protocol, runtime_checkable

from ..errors import InputError, JobError
from ..log import logger
from ..simulate.interrupt import Interrupt
from ..simulate.progress import Progress
from .checks import refusal
from .jobs import Caught, Job, Outcome, done_here, in_words, pack, read, run_packed
from .processes import WorkerEndedError

__all__ = ["Executor", "run_all"]

#: why a job was not run
CANCELLED = "cancelled before it started"
OnOutcome = Callable[[int, int, Outcome], object]


@runtime_checkable
class Executor(Protocol):
    """What takes jobs: `submit` gives a future with ``result()`` and ``cancel()``."""

    def submit(self, function: Any, /, *args: Any) -> Any:
        """Have ``function(*args)`` called somewhere."""


def run_all(
    jobs: Iterable[Job],
    executor: Executor | None = None,
    *,
    progress: bool | OnOutcome = False,
) -> list[Outcome]:
    """Run independent jobs; give their outcomes in the order of the jobs.

    A job that fails does not disturb the others: look at ``outcome.error``, or call
    ``outcome.result()``, which raises it.

    Parameters
    ----------
    jobs : iterable of Job
        With different names.
    executor : executor, optional
        None: one job after the other in this process. Otherwise anything whose ``submit`` gives
        futures: :class:`Processes`, a ``concurrent.futures`` executor,
        ``dask.distributed.Client(...).get_executor()``, and the like. It stays open.
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
    your functions are in. Systems are frozen anew there; results are the same to the last bit on
    machines of one kind, if BLAS has the same number of threads. Without an executor functions are
    called with the very objects of the job, and need not be importable.

    Ctrl-C: no further job is started, those running are waited for (a simulation ends after its
    step, if its process got the Ctrl-C too), and what there is is returned; jobs that did not run
    have a :class:`JobError`. A second one raises KeyboardInterrupt, with the outcomes so far as
    its attribute ``outcomes``.

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
    with Progress(progress, _line) as show:

        def keep(number: int, outcome: Outcome) -> None:
            results[number] = outcome
            show(len(results), len(jobs), outcome)

        try:
            if executor is None:
                _run_here(jobs, keep)
            else:
                _run_there(jobs, packed, executor, results, keep)
        except KeyboardInterrupt as error:
            error.outcomes = _in_order(jobs, results)  # type: ignore[attr-defined]
            raise
    return _in_order(jobs, results)


def _line(done: int, count: int, outcome: Outcome) -> str:
    return f"{done} of {count} jobs done, last {outcome.name!r}"


def _checked(jobs: Iterable[Job]) -> list[Job]:
    if not isinstance(jobs, Iterable):
        raise InputError("argument jobs", f"{jobs!r}, expected a list of Job")
    jobs = list(jobs)
    names: set[str] = set()
    for job in jobs:
        if not isinstance(job, Job):
            raise InputError("argument jobs", f"{job!r}, expected a Job")
        if job.name in names:
            raise InputError("argument jobs", f"two jobs are called {job.name!r}")
        names.add(job.name)
    return jobs


def _all_packed(jobs: Sequence[Job]) -> list[bytes]:
    packed = []
    for job in jobs:
        packing = Caught()
        with packing:
            packed.append(pack(job))
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
    packed: list[bytes],
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
            logger.warning("interrupted: no further job is started, those running are waited for")
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
