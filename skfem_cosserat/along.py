"""Numbers along a line: the same everywhere, a function of arc length, or a table."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from .errors import InputError
from .types import ArrayLike, Floats, IndexArray, numbers, shaped

if TYPE_CHECKING:
    from .beam import Beam

#: how far a line may go beyond a table, relative to its length
BEYOND = 1e-9


class Stations:
    """Values (k, m) at increasing arc lengths (k,) in m, linear or smooth in between."""

    def __init__(self, item: str, s: ArrayLike, values: Floats, smooth: bool = False) -> None:
        self.item, self.s, self.values, self.smooth = item, numbers(item, "s", s), values, smooth
        if self.s.ndim != 1 or len(self.s) < 2 or not (np.diff(self.s) > 0).all():
            text = f"s = {self.s.tolist()}, expected two or more arc lengths that increase"
            raise InputError(item, text)

    def at(self, s: Floats) -> Floats:
        """Values (..., m) at arc lengths (...), which may be beyond the ends by rounding."""
        first, last, far = self.s[0], self.s[-1], BEYOND * s.max()
        if s.min() < first - far or s.max() > last + far:
            text = f"goes from {first:.9g} to {last:.9g} m, and the line goes on to {s.max():.9g} m"
            raise InputError(self.item, text)
        if self.smooth:
            from scipy.interpolate import PchipInterpolator  # slow to import

            return np.asarray(PchipInterpolator(self.s, self.values)(s.clip(first, last)))
        return np.stack([np.interp(s, self.s, column) for column in self.values.T], axis=-1)


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
        if isinstance(given, tuple | list) and len(given) == 2 and np.ndim(given[0]):
            values = shaped(item, name, given[1], (np.size(given[0]), size))
            given = Stations(f"{item}, table of {name}", given[0], values)
        elif not callable(given):
            given = shaped(item, name, given, (size,))
        self.given: Any = given

    def sampled(self, s: Floats) -> Along:
        """Without a function, which need not reach other processes: a table of its values at s."""
        if not callable(self.given):
            return self
        places = np.unique(s)
        return Along(self.item, self.name, (places, self._at(places)), self.size)

    def on(self, beam: Beam, elements: IndexArray, part: str | None, xi: Floats) -> Floats:
        """Values (m, k, size) at places of elements, as of :meth:`Beam.arc_lengths`.

        (size,) if they are the same everywhere.
        """
        if isinstance(self.given, np.ndarray):
            return self.given
        return self._at(beam.arc_lengths(elements, part, xi))

    def _at(self, s: Floats) -> Floats:
        """Values (..., size) at arc lengths (...)."""
        if isinstance(self.given, Stations):
            return self.given.at(s)
        found = [
            shaped(self.item, f"{self.name}({x:.6g})", self.given(float(x)), (self.size,))
            for x in s.flat
        ]
        return np.array(found).reshape(*s.shape, self.size)
