"""Numbers along a line: the same everywhere, a function of arc length, or a table."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from .errors import InputError, failed
from .frozen import Frozen
from .notebook import brief
from .types import ArrayLike, Floats, IndexArray, numbers, shaped

if TYPE_CHECKING:
    from .beam import Beam

#: how far a line may go beyond a table, relative to its length
BEYOND = 1e-9


class Stations:
    """Values (k, m) at increasing arc lengths (k,) in m, linear or smooth in between."""

    def __init__(self, item: str, s: ArrayLike, values: Floats, smooth: bool = False):
        self.item, self.s, self.values, self.smooth = item, numbers(item, "s", s), values, smooth
        if self.s.ndim != 1 or len(self.s) < 2 or not (np.diff(self.s) > 0).all():
            text = f"s = {self.s.tolist()}, expected two or more arc lengths that increase"
            raise InputError(item, text)

    def at(self, s: Floats, length: float) -> Floats:
        """Values (..., m) at arc lengths (...) of a line of this length (m).

        InputError if the stations do not reach from its start to its end.
        """
        if self.s[0] > BEYOND * length or self.s[-1] < (1 - BEYOND) * length:
            text = f"goes from {self.s[0]:.9g} to {self.s[-1]:.9g} m, and the line from 0 to"
            raise InputError(self.item, f"{text} {length:.9g} m")
        if self.smooth:
            from scipy.interpolate import PchipInterpolator  # slow to import

            return PchipInterpolator(self.s, self.values)(s.clip(*self.s[[0, -1]]))
        return np.stack([np.interp(s, self.s, column) for column in self.values.T], -1)


class Along(Frozen):
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

    def __init__(self, item: str, name: str, given: Any, size: int):
        self.item, self.name, self.size, self._given = item, name, size, given
        if isinstance(given, (tuple, list)) and len(given) == 2 and np.ndim(given[0]):
            values = shaped(item, name, given[1], (np.size(given[0]), size))
            given = Stations(f"{item}, table of {name}", given[0], values)
        elif not callable(given):
            given = shaped(item, name, given, (size,))
        self.given = given

    def _brief(self) -> str:
        return brief(self._given)

    def on(self, beam: Beam, elements: IndexArray, part: str | None, xi: Floats) -> Floats:
        """Values (m, k, size) at places of elements, as of :meth:`Beam.arc_lengths`.

        (size,) if they are the same everywhere.
        """
        if isinstance(self.given, np.ndarray):
            return self.given
        return self._at(*beam.arc_lengths(elements, part, xi))

    def _at(self, s: Floats, length: float) -> Floats:
        """Values (..., size) at arc lengths (...) of lines that are no longer than a length (m)."""
        if isinstance(self.given, Stations):
            return self.given.at(s, length)
        return np.array([self._of(float(x)) for x in s.flat]).reshape(*s.shape, self.size)

    def _of(self, s: float) -> Floats:
        name = f"{self.name}({s:.6g})"
        try:
            return shaped(self.item, name, self.given(s), (self.size,))
        except Exception as error:
            raise failed(self.item, name, error) from error
