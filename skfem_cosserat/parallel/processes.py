"""Worker processes on this machine, each for one job at a time."""

from __future__ import annotations

import multiprocessing
import os
import pickle
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing.connection import Connection
from typing import Any

from ..errors import InputError
from .jobs import Answer, Job, pack, read, run_packed

__all__ = ["Processes"]

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
_STARTING = threading.Lock()


class WorkerEndedError(BrokenProcessPool):
    """The process that did a job ended before it answered."""


class Processes(Executor):
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
        self._pool = ThreadPoolExecutor(self.workers, "worker")  # each waits for one process
        self._lock = threading.Lock()
        self._idle: list[_Worker] = []
        self._busy: set[_Worker] = set()
        self._closed = self._ended = False  # takes no more, kills those at work

    def submit(self, function: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Have ``function(*args, **kwargs)`` called in a worker.

        Returns
        -------
        Future
            Its result raises ``BrokenProcessPool`` if the worker ended before it answered.
        """
        return self._pool.submit(self._call, pack(Job(CALL, function, *args, **kwargs)))

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the workers: those at work when they are done."""
        self._closed = True
        self._pool.shutdown(wait, cancel_futures=cancel_futures)
        with self._lock:
            idle, self._idle = self._idle, []
        for worker in idle:
            worker.close()

    def __exit__(self, kind: type[BaseException] | None, *error: object) -> bool | None:
        if kind is not None:  # nobody will ask for what is under way
            self._pool.shutdown(wait=False, cancel_futures=True)
            with self._lock:
                self._ended = True
                for worker in self._busy:
                    worker.process.terminate()
        self.shutdown()
        return None

    def _call(self, packed: bytes) -> Any:
        with self._lock:
            self._idle = [worker for worker in self._idle if worker.process.is_alive()]
            worker = self._idle.pop() if self._idle else None
        worker = worker or _Worker(self.threads)
        with self._lock:
            if self._ended:
                worker.process.terminate()
            self._busy.add(worker)
        try:
            answer = worker.ask(packed)
        finally:
            with self._lock:
                self._busy.remove(worker)
        with self._lock:
            keep = not self._closed
            if keep:
                self._idle.append(worker)
        if not keep:
            worker.close()
        return read(CALL, answer).result()


class _Worker:
    """One process at the other end of a pipe."""

    def __init__(self, threads: int | None) -> None:
        context = multiprocessing.get_context("spawn")
        self._connection, theirs = context.Pipe()
        self.process = context.Process(target=serve, args=(theirs,), daemon=True)
        with _environment(threads):
            self.process.start()
        theirs.close()  # so that the end of the process is the end of the pipe

    def ask(self, packed: bytes) -> Answer:
        """Send a job and wait for the answer."""
        try:
            self._connection.send_bytes(packed)
            return Answer(*pickle.loads(self._connection.recv_bytes()))
        except (EOFError, OSError) as error:
            self.close()
            raise WorkerEndedError(f"its worker process ended {self._ending()}") from error

    def close(self) -> None:
        """Let it end, and wait for that; threads that a job left running do not keep it."""
        self._connection.close()
        self.process.join(PATIENCE)
        if self.process.is_alive():
            self.process.kill()
            self.process.join()

    def _ending(self) -> str:
        code = self.process.exitcode
        if code is not None and code < 0:
            names = {each.value: each.name for each in signal.Signals}
            return f"by signal {names.get(-code, -code)}"
        if code == 1:
            return (
                'with exit code 1 (a script needs `if __name__ == "__main__":` around what it does)'
            )
        return f"with exit code {code}"


def serve(connection: Connection) -> None:
    """Do one job after the other until the pipe is closed; in the worker."""
    try:
        while True:
            connection.send_bytes(pickle.dumps(tuple(run_packed(connection.recv_bytes()))))
    except (EOFError, OSError, KeyboardInterrupt):  # closed, or Ctrl-C in the same terminal
        return


@contextmanager
def _environment(threads: int | None) -> Iterator[None]:
    """The environment that a process starts with: a copy of our own at that moment."""
    if threads is None:
        yield
        return
    with _STARTING:
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
