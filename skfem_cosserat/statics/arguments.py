"""Arguments of controls: checked, and shown."""

from __future__ import annotations

from collections.abc import Sequence
from inspect import signature

import numpy as np

from ..errors import InputError
from ..types import Floats, numbers, positive, real

__all__ = ["finite", "listed", "shown", "stops", "turned", "whole"]


def stops(
    item: str, until: float, steps: int | None, at: Sequence[float] | None, start: float
) -> list[float]:
    """Values of the parameter that are hit exactly, of a path from `start`."""
    if at is not None:
        values = listed(item, at)
        if values[0] == start:
            values = values[1:]  # it is recorded anyway
        if not len(values):
            raise InputError(item, f"at = {list(at)!r} is where the path starts")
        change = np.diff(np.concatenate([[start], values]))
        if not ((change > 0).all() or (change < 0).all()):
            raise InputError(
                item, f"at = {values.tolist()} does not lead one way from the start at {start:g}"
            )
        return [float(v) for v in values]
    if until == start:
        raise InputError(item, f"until = {until!r} is where the path starts")
    count = 1 if steps is None else steps
    return [start + (until - start) * (k / count) for k in range(1, count)] + [until]


def listed(item: str, at: Sequence[float]) -> Floats:
    """Values of the parameter to hit."""
    values = numbers(item, "at", at)
    plain = np.asarray(at).dtype.kind in "iufO"  # no text that reads as numbers
    if not plain or values.ndim != 1 or not len(values) or not np.isfinite(values).all():
        raise InputError(item, f"at = {at!r}, expected a list of numbers")
    return values


def finite(item: str, name: str, value: object, what: str = "a finite number") -> float:
    """A finite number; `what` says which is expected."""
    number = real(item, name, value, what)
    if not np.isfinite(number):
        raise InputError(item, f"{name} = {value!r}, expected {what}")
    return number


def turned(item: str, turn: float | None) -> float | None:
    """A rotation that limits steps, or none."""
    return None if turn is None else positive(item, "turn", turn, " of rad")


def shown(item: object, **values: object) -> str:
    """Arguments of an object as in a call, without those that have their default."""
    parameters = signature(type(item)).parameters
    return ", ".join(f"{k}={v!r}" for k, v in values.items() if v != parameters[k].default)


def whole(item: str, name: str, value: int) -> None:
    """Check a positive integer."""
    if not isinstance(value, int | np.integer) or isinstance(value, bool) or value <= 0:
        raise InputError(item, f"{name} = {value!r}, expected a positive integer")
