"""Singular positions of closed loops: passages, branches of the motion, dead points of drives.

In a singular position the closure rows depend on each other although they do not elsewhere: a
four-bar lies flat, a drive has pulled a linkage straight. Several branches of motion may cross
there, or none may go on.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..types import Floats
from .chart import Chart
from .checks import Scene
from .closure import SINGULAR, Selected, continued, directed
from .loops import BROKEN, closed, drivers, names_of, tree_values, violated

__all__ = [
    "DeadPoint",
    "Passages",
    "branches",
    "contradiction",
    "dead_point",
    "way_off",
    "way_on",
]

#: pivot below which a position may be on either branch of a crossing, whichever the motion is on
NEAR = 1e-4
#: pivot below which the free directions of C are no tangent: where round-off r is what the closed
#: loop is known to, they are off by r over the square of the pivot
BLURRED = 1e-6


class Passages:
    """Watches closed loops from step to step: singular positions met or passed, once for each."""

    def __init__(self, system: Scene) -> None:
        self.system = system
        self._before: Sequence[Selected] | None = None
        self._inside: list[bool] = []

    def look(self, y: Floats, T: Floats, chosen: Sequence[Selected]) -> str | None:
        """What is new at the configuration y with tree values T; None if nothing is.

        Let A be the rows chosen at the first of two configurations, together with the free
        directions there. Where A becomes singular on the way, an eigenvalue of ``A_0^-1 A_1``
        turns negative: one for each row that is lost there, so that pairs do not cancel.
        """
        before, was_inside = self._before, self._inside
        inside = [bool((s.pivots <= SINGULAR).any()) for s in chosen]
        self._before, self._inside = chosen, inside
        found = []
        again = self.system.closure.again(before, y, T) if before is not None else chosen
        for k, (s, now) in enumerate(zip(chosen, again, strict=True)):
            rows = self.system.closure.rows[s.component.rows]
            if inside[k] and not (was_inside and was_inside[k]):
                found.append(("is in a singular position", rows))
            elif before is None or inside[k] or was_inside[k]:
                continue
            elif _turned(before[k], now):
                found.append(("has passed a singular position", rows))
        return (
            "; ".join(
                f"the closed loop through the {names_of(self.system, rows)} {what}"
                for what, rows in found
            )
            or None
        )


def _turned(before: Selected, now: Selected) -> bool:
    """Whether rows lost their independence between two configurations, an even number included.

    The other eigenvalues, of the free directions, are one.
    """
    A1 = (now.Q1 @ now.R).T @ before.Q1
    values = np.linalg.eigvals(np.linalg.solve(before.R.T, A1))
    return bool(((values.real < 0) & (abs(values.imag) <= 1e-9 * abs(values))).any())


# -- branches --------------------------------------------------------------------------------------


def branches(system: Scene, y: Floats, selected: Selected) -> list[Selected]:
    """The ways in which the motion may go on from a singular position.

    With one row lost the directions v that C leaves free fulfil the constraints to second order if
    ``c . D^2 g (v, v) = 0``, c being the combination of rows that vanishes: a quadratic form of
    rank two, whose zeros are two planes. Empty if more rows are lost, or if there is no branch.
    """
    component, closure = selected.component, system.closure
    U, pivots, V = np.linalg.svd((selected.Q1 @ selected.R).T)
    if not component.free or (pivots > NEAR * pivots[0]).sum() != component.rank - 1:
        return []
    N = V[component.rank - 1 :].T
    weights = U[:, -1] / closure.magnitude[component.rows[selected.local]]
    chart = Chart(system.kinematics)
    chart.begin(y, y[system.rows :])
    step = 1e-3

    def value(v: Floats) -> float:
        increment = np.zeros(system.kinematics.unknowns)
        increment[component.columns] = step * component.scale * v
        chart.reset()
        chart.add(increment)
        return float(weights @ system.constraints.values(chart.configuration())[selected.rows])

    def bend(v: Floats) -> float:
        return (value(v) + value(-v) - 2 * value(0 * v)) / step**2

    count = component.free + 1
    form = np.diag([bend(n) for n in N.T])
    for i in range(count):
        for j in range(i):
            both = bend(N[:, i] + N[:, j]) - form[i, i] - form[j, j]
            form[i, j] = form[j, i] = 0.5 * both
    values, vectors = np.linalg.eigh(form)
    if not values[0] < 0 < values[-1]:
        return []
    low, high = np.sqrt(-values[0]) * vectors[:, 0], np.sqrt(values[-1]) * vectors[:, -1]
    planes = [N @ np.linalg.svd((high + sign * low)[None])[2][1:].T for sign in (1.0, -1.0)]
    return [directed(selected, plane) for plane in planes]


def way_on(
    system: Scene, y: Floats, s: Selected, before: Floats | None, momentum: Floats | None
) -> Selected:
    """In a singular position the branch it came from, or that takes most of the momentum.

    Parameters
    ----------
    before : (columns, free) array or None
        Null directions a step ago; None at the start of a run.
    momentum : (n,) array or None
        At the start of a run.
    """
    least = s.pivots.min(initial=1.0)
    if least > NEAR:
        return s
    ways = branches(system, y, s)
    if before is None:
        return max(ways, key=lambda way: _rates(system, y, way, momentum)[1], default=s)

    def likeness(way: Selected) -> float:
        return float(np.linalg.norm(way.Q2.T @ before))

    if not ways:
        return continued(s, before)
    best = max(ways, key=likeness)
    return s if least > BLURRED and likeness(s) > likeness(best) - NEAR else best


def way_off(
    system: Scene, y: Floats, ground1: Floats, s: Selected, momentum: Floats | None, h: float
) -> Floats:
    """Increment (n,) of a first step from a singular position, in which the loops close."""
    chart = Chart(system.kinematics)
    chart.begin(y, ground1)
    chart.add(h * _rates(system, y, way_on(system, y, s, None, momentum), momentum)[0])
    found, _ = closed(system, chart, system.closure.select(y, tree_values(system, y)))
    return np.zeros(system.n) if found is None else (found - y)[: system.rows].reshape(-1)


def _rates(system: Scene, y: Floats, s: Selected, momentum: Floats | None) -> tuple[Floats, float]:
    """Rates (K,) of the tree along the free directions of one component, for a momentum (n,).

    And twice the kinetic energy they have.
    """
    kin = system.kinematics
    if momentum is None or not s.component.free:
        return np.zeros(kin.unknowns), 0.0
    T = tree_values(system, y)
    directions = np.zeros((s.component.free, kin.unknowns))
    directions[:, s.component.columns] = s.null.T
    P = np.array([kin.rates(y, kin.expand(T, d))[: system.rows] for d in directions])
    p = np.tensordot(P, momentum.reshape(-1, 3), ((1, 2), (0, 1)))
    M = np.tensordot(P, np.array([system.mass @ v for v in P]), ((1, 2), (1, 2)))
    rates = np.linalg.lstsq(M, p, rcond=None)[0]
    return rates @ directions, float(p @ rates)


# -- drives ----------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class DeadPoint:
    """Where prescribed motion has taken a closed loop as far as it goes.

    Attributes
    ----------
    time : float
        Until which the loop closes (s).
    reason : str
        What drives against what.
    """

    time: float
    reason: str


def dead_point(system: Scene, y0: Floats, t0: float, h: float) -> DeadPoint | None:
    """Whether a closed loop cannot follow the prescribed motion over the step from y0.

    The loops are closed for a growing part of the step; None if they close at its end.
    """
    closure = system.closure
    if not system.moving or not len(closure.rows):
        return None
    chart = Chart(system.kinematics)
    y, t, end, step, worst = y0, t0, t0 + h, h, 0
    while step > 1e-9 * h and t < end:
        until = end if t + step > end - 1e-12 * h else t + step
        chart.begin(y, system.ground(until))
        chosen = closure.select(y, tree_values(system, y, chart.fixed))
        found, failed = closed(system, chart, chosen)
        if found is None:
            step, worst = 0.5 * step, failed
        else:
            y, t = found, until
    if t == end:
        return None
    rows = closure.rows[closure.components[worst].rows]
    return DeadPoint(
        t,
        f"dead point at t = {t:.6g} s: {drivers(system, rows, t)} against the closed loop through"
        f" the {names_of(system, rows)}, which does not close beyond it",
    )


def contradiction(system: Scene, y: Floats, t: float) -> str | None:
    """Which prescribed motions contradict each other: dependent rows that do not hold at y."""
    closure = system.closure
    if not system.moving or closure.rank == len(closure.rows):
        return None
    worst, miss = violated(system, y)
    if not miss > BROKEN:
        return None
    rows = closure.rows[closure.components[worst].rows]
    return (
        f"prescribed motions contradict each other at t = {t:.6g} s (by {miss:.3g} relative):"
        f" {drivers(system, rows, t)} against each other around the closed loop through the"
        f" {names_of(system, rows)}"
    )
