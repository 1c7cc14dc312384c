"""A limit on the time that a call may take."""

from __future__ import annotations

import signal
import threading
import time
from subprocess import TimeoutExpired
from types import FrameType
from typing import Any

__all__ = ["LATE", "TimeLimit", "TimedOut"]

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
