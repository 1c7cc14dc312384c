"""Arguments of the families' ``main``: checked, and numbers that may come as text ("5/6")."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

import skfem_cosserat as sc
from collection import common
from skfem_cosserat.kernels import rotation_matrix

__all__ = ["Method", "chosen", "count", "method", "number", "triad", "vector"]

Floats = NDArray[np.float64]


def number(name: str, value: Any, least: float = -np.inf, beyond: float = -np.inf) -> float:
    """A finite number, also as text or a fraction; not below `least`, above `beyond`.

    Raises
    ------
    InputError
        Naming it.
    """
    try:
        found = float(Fraction(value)) if isinstance(value, str) else float(value)
    except (TypeError, ValueError, ZeroDivisionError):
        raise sc.InputError("data", f"{name} = {value!r}, expected a number") from None
    if isinstance(value, bool) or not np.isfinite(found) or found < least or found <= beyond:
        limit = f" from {least:g} on" if np.isfinite(least) else ""
        limit = f" above {beyond:g}" if np.isfinite(beyond) else limit
        raise sc.InputError("data", f"{name} = {value!r}, expected a finite number{limit}")
    return found


def count(name: str, value: Any, item: str = "data") -> int:
    """A positive integer.

    Raises
    ------
    InputError
        Naming it.
    """
    try:
        whole = not isinstance(value, bool) and float(value) == int(value) > 0
    except (TypeError, ValueError, OverflowError):
        whole = False
    if not whole:
        raise sc.InputError(item, f"{name} = {value!r}, expected a positive integer")
    return int(value)


def vector(name: str, value: Any, length: int = 3) -> Floats:
    """Finite numbers (length,).

    Raises
    ------
    InputError
        Naming it.
    """
    try:
        found = np.array([number(name, v) for v in value])
    except TypeError:
        found = np.zeros(0)
    if len(found) != length:
        raise sc.InputError("data", f"{name} = {value!r}, expected {length} numbers")
    return found


def gravity(value: Any, axis: int) -> Floats:
    """Acceleration (3,) of a strength, downwards along this axis, or of all components."""
    if np.ndim(value) == 0:
        return -number("g", value) * np.eye(3)[axis]
    return vector("g", value)


def triad(name: str, value: Any) -> Floats:
    """Rows d1, d2, d3 of a unit quaternion (w, x, y, z) from body to space, or of "identity"."""
    if isinstance(value, str) and value == "identity":
        return np.eye(3)
    q = vector(name, value, 4)
    if abs(q @ q - 1) > 1e-9:
        raise sc.InputError("data", f"{name} = {value!r}, expected a unit quaternion (w, x, y, z)")
    return rotation_matrix(q[None] / np.linalg.norm(q))[0].T


@dataclass(frozen=True)
class Method:
    """How to compute: what ``main`` was given, checked."""

    order: int
    elements: int | None
    step: float | None
    integrator: Any
    treatment: Any
    times: tuple[float, ...] | None


def method(
    order: int,
    elements: int | None,
    step: float | None,
    integrator: str,
    treatment: str,
    times: Sequence[float] | float | None,
) -> Method:
    """Check these arguments, needed or not; one instant may be a number.

    Raises
    ------
    InputError
        Naming the first wrong one.
    """
    if order not in (1, 2, 3, 4) or isinstance(order, bool):
        raise sc.InputError("argument order", f"{order!r}, expected 1, 2, 3 or 4")
    if elements is not None:
        elements = count("elements", elements, "arguments")
    if step is not None:
        step = number("step", step, beyond=0.0)
    wanted = None
    if times is not None:
        several = [times] if np.ndim(times) == 0 else times
        wanted = tuple(number("times", t, least=0.0) for t in several)
        if not wanted:
            raise sc.InputError("argument times", "expected at least one instant")
    return Method(order, elements, step, *common.choice(integrator, treatment), wanted)


def chosen(
    case: Any, entries: Sequence[str], values: Mapping[str, Any]
) -> tuple[str, float | None]:
    """Entry and instant that a case stands for.

    Parameters
    ----------
    case : str, float or None
        An entry's name, in full or up to its first underscore; a key of its `values` (all of
        them are computed); an instant (s), also as text; None: the first entry.

    Raises
    ------
    InputError
        If it is none of them.
    """
    if case is None or case in values:
        return entries[0], None
    for name in entries:
        if case in (name, name.partition("_")[0]):
            return name, None
    try:
        instant = float(case)
    except (TypeError, ValueError):
        instant = -1.0
    if not (np.isfinite(instant) and instant >= 0) or isinstance(case, bool):
        raise sc.InputError(
            "argument case",
            f"{case!r} is unknown, expected one of {list(entries)}, {list(values)} or an instant",
        )
    return entries[0], instant
