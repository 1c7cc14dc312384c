"""Ctrl-C during long work."""

from __future__ import annotations

import signal
import threading

from ..log import logger

__all__ = ["Interrupt"]


class Interrupt:
    """Ctrl-C ends a run after the step that is being solved; a second one ends it at once.

    Around several runs, one after the other, another one learns of it too and starts no more.

    Parameters
    ----------
    message : str
        What the warning says.
    """

    def __init__(self, message: str = "the run ends after this step, its history is kept") -> None:
        self.asked, self.message = False, message
        self._main = threading.current_thread() is threading.main_thread()

    def __enter__(self) -> Interrupt:
        if self._main:
            self._before = signal.getsignal(signal.SIGINT)
            signal.signal(signal.SIGINT, self._ask)
        return self

    def _ask(self, number: int, frame: object) -> None:
        around = getattr(self._before, "__self__", None)
        if isinstance(around, Interrupt):
            around.asked = True
        if self.asked:
            raise KeyboardInterrupt
        self.asked = True
        logger.warning("interrupted: %s", self.message)

    def __exit__(self, *exception: object) -> None:
        if self._main:
            signal.signal(signal.SIGINT, self._before)
