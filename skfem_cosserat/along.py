"""Numbers along a line: the same everywhere, a function of arc length, or a table."""

from __future__ import annotations

from typing import Any

import numpy as np

from .errors import InputError
from .types import Floats, numbers, shaped

#: how far a line may go beyond a table, relative to its length
BEYOND = 1e-9


class Along:
    """Values (size,) along a line, as a user gives them.

    Parameters
    ----------
    item, name : str
        For errors.
    given : (size,) array, callable, or pair of arrays
        The same everywhere, a function of the arc length (m), or ``(s (k,), values (k, size))``,
        linear in between.
    size : int
    """

    def __init__(self, item: str, name: str, given: Any, size: int) -> None:
        self.item, self.name, self.size = item, name, size
        self.table: tuple[Floats, Floats] | None = None
        self.function = given if callable(given) else None
        self.constant: Floats | None = None
        if isinstance(given, tuple | list) and len(given) == 2:
            s, values = numbers(item, name, given[0]), numbers(item, name, given[1])
            wrong = s.ndim != 1 or len(s) < 2 or not (np.diff(s) > 0).all()
            if wrong or values.shape != (len(s), size):
                text = f"{name} = arrays of shapes {s.shape} and {values.shape}, expected arc"
                raise InputError(item, f"{text} lengths (k,) that increase and values (k, {size})")
            self.table = s, values
        elif self.function is None:
            self.constant = shaped(item, name, given, (size,))

    def sampled(self, s: Floats) -> Along:
        """Without a function, which need not reach other processes: a table of its values at s."""
        if self.function is None:
            return self
        places = np.unique(s)
        return Along(self.item, self.name, (places, self.at(places)), self.size)

    def at(self, s: Floats) -> Floats:
        """Values (..., size) at arc lengths (...)."""
        if self.constant is not None:
            return np.broadcast_to(self.constant, (*s.shape, self.size))
        if self.table is not None:
            places, values = self.table
            far = BEYOND * s.max()
            if s.min() < places[0] - far or s.max() > places[-1] + far:
                text = f"{self.name} is a table from {places[0]:.6g} to {places[-1]:.6g} m, and"
                raise InputError(self.item, f"{text} the line goes on to {s.max():.6g} m")
            return np.stack([np.interp(s, places, column) for column in values.T], axis=-1)
        assert self.function is not None
        found = [
            shaped(self.item, f"{self.name}({x:.6g})", self.function(float(x)), (self.size,))
            for x in s.flat
        ]
        return np.array(found).reshape(*s.shape, self.size)
