"""Progress of a run, and Ctrl-C."""

from __future__ import annotations

import signal
import sys
import threading
import time
from collections.abc import Callable
from typing import Any

from ..errors import InputError
from ..warn import logger

# -- ctrl-C during long work -----------------------------------------------------------------------


class Interrupt:
    """Ctrl-C ends a run after the step that is being solved; a second one ends it at once.

    Around several runs, one after the other, another one learns of it too and starts no more.

    Parameters
    ----------
    message : str
        What is logged.
    """

    def __init__(self, message: str = "the run ends after this step, its history is kept"):
        self.asked = False
        self.message = message
        self._main = threading.current_thread() is threading.main_thread()

    def __enter__(self) -> Interrupt:
        if self._main:
            self._before = signal.getsignal(signal.SIGINT)
            signal.signal(signal.SIGINT, self._ask)
        return self

    def at_once(self) -> None:
        """The next Ctrl-C ends all, as if it had been pressed before."""
        self.asked = True

    def _ask(self, number: int, frame: object) -> None:
        around = getattr(self._before, "__self__", None)
        if isinstance(around, Interrupt):
            around.at_once()
        if self.asked:
            raise KeyboardInterrupt
        self.asked = True
        logger.info("interrupted: %s", self.message)

    def __exit__(self, *exception: object) -> None:
        if self._main:
            signal.signal(signal.SIGINT, self._before)


# -- what a run shows of itself while it goes on ---------------------------------------------------

#: seconds between two changes of the line
INTERVAL = 0.2


class Progress:
    """A line on stderr, calls of a function, or nothing.

    Called with the numbers to show; used as a context it ends the line, however the run ends.

    Parameters
    ----------
    progress : bool or callable
        True for the line; a callable gets the numbers each time.
    text : callable
        From the numbers to the text of the line.

    Raises
    ------
    InputError
        If `progress` is something else.
    """

    def __init__(self, progress: object, text: Callable[..., str]):
        if not callable(progress) and not isinstance(progress, bool):
            raise InputError(
                "argument progress", f"{progress!r}, expected True, False or a function"
            )
        self._function = progress if callable(progress) else None
        self._text = text
        self._on = progress is True
        self._line = ""
        self._last = 0.0

    def __call__(self, *numbers: Any) -> None:
        """Show these numbers now or soon."""
        if self._function is not None:
            self._function(*numbers)
        elif self._on:
            self._line = self._text(*numbers)
            if time.monotonic() - self._last >= INTERVAL:
                self._last = time.monotonic()
                self.say(self._line)

    def say(self, text: str) -> None:
        """Show a text on the line until there are numbers."""
        if self._on:
            sys.stderr.write("\r\x1b[K" + text)  # the old line is erased
            sys.stderr.flush()

    def __enter__(self) -> Progress:
        return self

    def __exit__(self, *exception: object) -> None:
        if self._line:
            self.say(self._line + "\n")
