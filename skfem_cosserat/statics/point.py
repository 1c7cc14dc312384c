"""Points of a path, what fixes them, and what comes with them."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..model import System
from ..newton import NewtonReport
from ..types import Array, Floats, IndexArray

__all__ = ["Functional", "Neutral", "Point", "Solution", "weights"]


def weights(system: System) -> Floats:
    """Weights (rows, 1) that make the square of a motion free of units, a mean over all nodes.

    ``1/length^2`` for positions and 1/2 for directors: a turn by a small angle counts as the angle.
    """
    out = np.full((system.rows, 1), 0.5)
    out[system.origin_rows] = 1 / system.length**2
    return np.asarray(out / len(system.origin_rows))


@dataclass(eq=False, repr=False)
class Point:
    """An equilibrium on a path.

    Attributes
    ----------
    y : (total, 3) array
        All rows.
    t : float
        Load factor.
    turns : (k,) int array or None
        Full turns of the angles of springs, as in a state.
    """

    y: Floats
    t: float
    turns: IndexArray | None = None

    def __repr__(self) -> str:
        """Without the arrays."""
        return f"Point(t={self.t!r}, rows={len(self.y)})"


@dataclass(frozen=True, eq=False)
class Functional:
    """What fixes the place on a path: ``gradient . (y - y_0) + by_factor (t - t_0) = value``.

    Attributes
    ----------
    gradient : (rows, 3) array or None
        None: zero.
    by_factor, value : float
    predictor : (rows, 3) array or None
        Change of the coordinates to start from, where the tangent at the start gives none.
    """

    gradient: Floats | None
    by_factor: float
    value: float
    predictor: Floats | None = None

    def __call__(self, point: Point, y: Array, t: float) -> float:
        """What is missing at (y, t) from a step that starts at `point`."""
        out = self.by_factor * (t - point.t) - self.value
        if self.gradient is not None:
            change = np.real(y[: len(self.gradient)]) - point.y[: len(self.gradient)]
            out += float((self.gradient * change).sum())
        return out

    def share(self, start: Point, end: Point) -> float:
        """What part of `value` a point between is from the start."""
        return 1.0 + self(start, end.y, end.t) / self.value


@dataclass(eq=False)
class Neutral:
    """Motions of an equilibrium that nothing holds and nothing drives, to rounding.

    As of a round column that has buckled: its plane of bending is free.

    Attributes
    ----------
    motions : list of (rows, 3) arrays
        Of unit size in the metric of :func:`weights`, and normal to each other.
    limit : float
        Eigenvalue of the stiffness in that metric up to which a motion counts as neutral.
    """

    motions: list[Array] = field(default_factory=list)
    limit: float = 0.0


@dataclass(eq=False)
class Solution:
    """What a solved point gives beside it.

    Attributes
    ----------
    point : Point
    constraint_force : (n,) array
    report : NewtonReport
    predicted : (rows, 3) array
        Change of the coordinates that the tangent at the start predicts.
    """

    point: Point
    constraint_force: Floats
    report: NewtonReport
    predicted: Floats
