"""The ground's frames: one at rest, and one for each place in prescribed motion."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..errors import InputError
from ..frames import Place
from ..types import Floats
from .plane import Plane

#: instants of which something is kept; more of them take memory
KEPT = 4096
_REST = np.eye(4, 3, -1)
_REST.setflags(write=False)


class Ground:
    """Rows ``(x, d1, d2, d3)`` of the ground's frames as functions of time.

    Parameters
    ----------
    places : sequence of Place
        Among them those of the ground in prescribed motion; each counts once.

    Attributes
    ----------
    moving : list of Place
        In prescribed motion, drives included.
    rows : int
        Four for each frame.
    """

    def __init__(self, places: Sequence[Place]):
        moving = {id(place): place for place in places if place.motion is not None}
        self.moving = list(moving.values())
        self._number = {place: k for k, place in enumerate(self.moving, 1)}
        self.rows = 4 * (1 + len(self.moving))
        self._rates: dict[float, tuple[Floats, float]] = {}
        #: the last instant, with its rows: a step begins where the one before ended
        self._last = np.nan, _REST
        self._plane: Plane | None = None
        self._watched: list[Place] = []

    def number(self, place: Place) -> int:
        """Number of the frame that a ground place belongs to; 0 is the one at rest.

        Raises
        ------
        InputError
            If the place moves, and is none of the scene's.
        """
        if place.motion is None:
            return 0
        if place in self._number:
            return self._number[place]
        for k, known in enumerate(self.moving, 1):  # made anew, as with the terms of a load
            if known.motion is place.motion and np.array_equal(known.position, place.position):
                return k
        raise InputError(
            place.label,
            "is in prescribed motion, but none of the places that the scene was made with: keep the"
            " place as an attribute instead of making it anew",
        )

    def confined(self, plane: Plane, drives: Sequence[Place]) -> Ground:
        """A copy that raises an error if a frame is out of a plane when it is evaluated.

        Frames of `drives` are exempt: their rows are numbers only.
        """
        out = Ground(self.moving)
        out._plane = plane
        out._watched = [p for p in self.moving if not any(p is drive for drive in drives)]
        return out

    def at(self, t: float) -> Floats:
        """Rows (rows, 3) at time `t`.

        Raises
        ------
        InputError
            If one leaves the plane that the scene is confined to.
        """
        if not self.moving:
            return _REST
        last, rows = self._last
        if t == last:
            return rows
        for place in self._watched:
            assert self._plane is not None
            self._plane.check_ground(place, t)
        frames = [p.motion.frame(p, t) for p in self.moving if p.motion is not None]
        rows = np.concatenate([_REST, *frames])
        rows.setflags(write=False)
        self._last = t, rows
        return rows

    def rate_and_error(self, t: float) -> tuple[Floats, float]:
        """Time derivative of :meth:`at` by differences of the callables, and its error.

        One-sided, of fourth order, on shrinking intervals until two results agree best: a motion
        is never asked for before t = 0 nor after t > 0, where it may not be defined. Kept for when
        it is asked for again: energies, momenta and coordinates of a run all need it.
        """
        if t not in self._rates:
            if len(self._rates) >= KEPT:
                self._rates.clear()
            self._rates[t] = self._rate_and_error(t)
        return self._rates[t]

    def _rate_and_error(self, t: float) -> tuple[Floats, float]:
        if not self.moving:
            return np.zeros((self.rows, 3)), 0.0
        here, best, error = self.at(t), np.zeros((self.rows, 3)), np.inf
        before = None
        width = 1e-2 if t <= 0 else -min(1e-2, t / 4)
        for _ in range(12):
            g = [self.at(t + k * width) - here for k in (1, 2, 3, 4)]
            rate = (48 * g[0] - 36 * g[1] + 16 * g[2] - 3 * g[3]) / (12 * width)
            change = np.inf if before is None else float(abs(rate - before).max())
            if change < error:
                best = rate
                error = change
            if change <= 1e-12 * abs(rate).max():
                break
            before = rate
            width = width / 4
        return best, error


class Placed(NamedTuple):
    """Configuration, time and ground at which a scene that changed in a motion is set up.

    Attributes
    ----------
    q : (n,) array
    t : float
    ground : Ground
        All frames there were, so that the rows of y stay what they are.
    """

    q: Floats
    t: float
    ground: Ground
