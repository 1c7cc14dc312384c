"""Array types used in annotations, and numbers from what a user gives."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .errors import InputError

__all__ = [
    "Array",
    "ArrayLike",
    "Floats",
    "IndexArray",
    "VectorLike",
    "check_kind",
    "numbers",
    "positive",
    "real",
    "switch",
]

#: Real or complex numbers: kernels take complex input so that tangents can be checked by the
#: complex step.
Array: TypeAlias = NDArray[Any]
Floats: TypeAlias = NDArray[np.float64]
IndexArray: TypeAlias = NDArray[np.int64]
#: Three numbers.
VectorLike: TypeAlias = Sequence[float] | NDArray[np.float64]


def numbers(item: str, name: str, value: Any) -> Floats:
    """Fresh array of real numbers (NaN included), or an error naming item and argument."""
    try:
        return np.array(value, dtype=float)
    except (TypeError, ValueError) as error:
        raise InputError(item, f"{name} = {value!r}, expected real numbers") from error


def real(item: str, name: str, value: Any, expected: str) -> float:
    """One number (not NaN), or an error saying what is expected; text and truth values are none."""
    odd = isinstance(value, str | bytes | bool | np.bool_)  # numpy takes them for numbers
    try:
        out = np.array(np.nan if odd else value, dtype=float)
    except (TypeError, ValueError):
        out = np.array(np.nan)
    if out.shape != () or np.isnan(out):
        raise InputError(item, f"{name} = {value!r}, expected {expected}")
    return float(out)


def switch(item: str, value: Any) -> bool:
    """True or False, or an error: any text would count as true."""
    if not isinstance(value, bool | np.bool_):
        raise InputError(item, f"{value!r}, expected True or False")
    return bool(value)


def positive(item: str, name: str, value: Any, unit: str = "") -> float:
    """A positive finite number, or an error naming item and argument."""
    try:
        out = np.nan if isinstance(value, str) or np.ndim(value) else float(value)
    except (TypeError, ValueError):
        out = np.nan
    if not (np.isfinite(out) and out > 0):
        raise InputError(item, f"{name} = {value!r}, expected a positive finite number{unit}")
    return out


def whole(item: str, value: Any, least: int, name: str = "") -> int:
    """An integer from `least` on, or an error naming item and argument."""
    if not isinstance(value, int | np.integer) or isinstance(value, bool) or value < least:
        given = f"{name} = {value!r}" if name else repr(value)
        raise InputError(item, f"{given}, expected an integer from {least} on")
    return int(value)


def check_kind(item: str, value: object, kind: type, more: str = "") -> None:
    """Raise InputError if a value is not of a type; `more` says where one comes from."""
    if not isinstance(value, kind):
        raise InputError(item, f"{value!r}, expected an object of type {kind.__name__}{more}")
