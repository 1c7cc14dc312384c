"""Checks and conversions that keep a history plain: JSON data and arrays of numbers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..errors import InputError
from ..types import Array

#: Kinds of numpy types a history may hold: bool, integers, floats, complex numbers, text.
KINDS = "biufcU"

#: Series every history has, with the shape after the first axis (None: any length).
BASIC = ("t", "step", "q", "p")


def plain(value: Any, item: str) -> Any:
    """Convert ``value`` to JSON data: numpy numbers and arrays, tuples and dicts are accepted.

    Parameters
    ----------
    value : object
        None, bool, int, float (NaN and infinity too), str, numpy scalars and arrays, and lists,
        tuples and dicts (with names as keys) of these.
    item : str
        Name of the value for the error.

    Raises
    ------
    InputError
        If something else is found inside; the error names the place.

    Examples
    --------
    >>> plain({"step": np.float64(0.5), "parts": ("a", "b")}, "meta")
    {'step': 0.5, 'parts': ['a', 'b']}
    """
    if isinstance(value, np.generic | np.ndarray):
        return plain(value.tolist(), item)
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, list | tuple):
        return [plain(entry, f"{item}[{k}]") for k, entry in enumerate(value)]
    if isinstance(value, Mapping):
        for key in value:
            if not isinstance(key, str):
                raise InputError(item, f"key {key!r} is not a string")
        return {str(key): plain(entry, f"{item}[{key!r}]") for key, entry in value.items()}
    raise InputError(item, f"got {type(value).__name__}, expected JSON data (numbers, text, lists)")


def numbers(value: Any, item: str) -> Array:
    """Return ``value`` as an array of a type that can be stored (see `KINDS`).

    Raises
    ------
    InputError
        If the array holds objects or records.
    """
    array = np.asarray(value)
    if array.dtype.kind not in KINDS:
        raise InputError(item, f"got data type {array.dtype}, expected numbers or text")
    if array.dtype.byteorder == ">":
        array = array.astype(array.dtype.newbyteorder("<"))
    return array


def check_basic(names: Mapping[str, Any], item: str) -> None:
    """Check that the basic series ``t, step, q, p`` are all there.

    Raises
    ------
    InputError
        Naming those that are missing.
    """
    missing = [name for name in BASIC if name not in names]
    if missing:
        raise InputError(item, f"misses {', '.join(missing)}; got {', '.join(names) or 'nothing'}")
