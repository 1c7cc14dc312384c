"""States one by one or stacked: (n,) or (N, n)."""

from __future__ import annotations

import numpy as np

from ..errors import IncompatibleError, InputError
from ..history import History
from ..model import System
from ..types import ArrayLike, Floats


def as_stack(system: System, name: str, value: ArrayLike) -> tuple[Floats, bool]:
    """States (N, n), and whether only one was given."""
    array = np.asarray(value, dtype=float)
    if array.shape[-1:] != (system.n,) or array.ndim not in (1, 2):
        raise InputError(
            f"argument {name}", f"has shape {array.shape}, expected ({system.n},) or (N, ...)"
        )
    return np.atleast_2d(array), array.ndim == 1


def as_times(t: ArrayLike, count: int) -> Floats:
    """One time for each state."""
    return np.broadcast_to(np.asarray(t, dtype=float), (count,))


def check_consecutive(history: History, item: str) -> None:
    """Refuse a history that does not hold every step."""
    jumps = np.flatnonzero(np.diff(history["step"]) != 1)
    if len(jumps):
        first, then = history["step"][jumps[0] : jumps[0] + 2]
        raise IncompatibleError(
            item,
            f"needs every step, the history goes from step {first:.0f} to {then:.0f}: record with"
            " every=1",
        )


def all_rows(system: System, q: Floats, t: Floats) -> Floats:
    """All rows of y (N, total, 3) of states q (N, n) at times t (N,)."""
    out = np.empty((len(q), system.total, 3))
    out[:, : system.rows] = q.reshape(len(q), system.rows, 3)
    if system.moving:
        for row, s in zip(out, t, strict=True):
            row[system.rows :] = system.ground(float(s))
    else:
        out[:, system.rows :] = system.ground(0.0)
    return out
