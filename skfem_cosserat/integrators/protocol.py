"""Which settings of Newton's method hold where a run gives none."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

from ..newton import NewtonSettings

__all__ = ["default_settings", "unless_given"]

_CHOSEN: ContextVar[NewtonSettings | None] = ContextVar("settings", default=None)


def default_settings() -> NewtonSettings:
    """What a run without settings of its own takes."""
    chosen = _CHOSEN.get()
    return NewtonSettings() if chosen is None else chosen


@contextmanager
def unless_given(settings: NewtonSettings) -> Iterator[None]:
    """Let runs inside take these settings unless they are given others.

    For studies that call problems of the user's own, which need not know of it. Runs that the
    problem starts in other threads or processes do not see it.

    Examples
    --------
    >>> with unless_given(NewtonSettings(iterations=100)):
    ...     default_settings().iterations
    100
    >>> default_settings().iterations
    20
    """
    token = _CHOSEN.set(settings)
    try:
        yield
    finally:
        _CHOSEN.reset(token)
