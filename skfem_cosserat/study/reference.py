"""What the levels of a study are compared with."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ..errors import InputError
from ..types import Array, Floats
from .levels import case_name

__all__ = ["Known", "ReferenceFinest", "ReferenceRun", "known_values"]

#: a value, or a function of the common instants (of nothing, if not compared over time)
Known = Array | Callable[..., Any]


class ReferenceFinest:
    """The finest level of each series stands for the truth; orders allow for its own error.

    Examples
    --------
    >>> from skfem_cosserat import refine
    >>> def area(elements):
    ...     return 1 + 0.2 / elements**2
    >>> found = refine(area, elements=(2, 4, 8, 16, 32), reference=ReferenceFinest())
    >>> print(found.verdicts["value"])
    order 2.00 +- 0.01 (three finest of four levels)
    """


class ReferenceRun:
    """Another call of the problem stands for the truth; run, kept and resumed like the levels.

    Parameters
    ----------
    **arguments
        Of the problem. Those that are not given are as on the finest level.

    Examples
    --------
    >>> from skfem_cosserat import refine
    >>> def area(elements, order):
    ...     return 1 + 0.2 / elements**order
    >>> found = refine(area, elements=(2, 4, 8, 16), order=2,
    ...                reference=ReferenceRun(elements=1000, order=6))
    >>> print(found.verdicts["value"])
    order 2.00 +- 0.01 (three finest of four levels)
    """

    def __init__(self, **arguments: Any) -> None:
        if not arguments:
            raise InputError("ReferenceRun", "got no arguments, expected some: elements=1000")
        self.arguments = arguments

    def __repr__(self) -> str:
        return f"<ReferenceRun: {case_name(self.arguments)}>"


def known_values(reference: Any) -> dict[str | None, Known]:
    """Values by quantity; the name None stands for the only one.

    Raises
    ------
    InputError
        If one of them is not finite or no number.
    """
    if reference is None or isinstance(reference, ReferenceFinest | ReferenceRun):
        return {}
    given = reference if isinstance(reference, Mapping) else {None: reference}
    found: dict[str | None, Known] = {}
    for name, value in given.items():
        label = "argument reference" if name is None else f"reference of quantity {name!r}"
        found[name] = value if callable(value) else finite(value, label)
    return found


def finite(value: Any, label: str) -> Array:
    """An array of finite numbers, or an error."""
    try:
        array = np.asarray(value)
    except ValueError as error:
        raise InputError(label, f"{value!r}, expected numbers") from error
    if array.dtype.kind not in "biufc" or not np.isfinite(array).all():
        raise InputError(label, f"{value!r}, expected finite numbers")
    return array


def value_of(known: Known, instants: Floats | None, shape: tuple[int, ...], name: str) -> Array:
    """The reference of a quantity in the shape of its values.

    Raises
    ------
    InputError
        If it has another shape.
    """
    label = f"reference of quantity {name!r}"
    if callable(known):
        known = finite(known() if instants is None else known(instants), label)
    if known.size == 1 and int(np.prod(shape)) == 1:
        return known.reshape(shape)
    if known.shape != shape:
        raise InputError(label, f"shape {known.shape}, expected that of the values, {shape}")
    return known
