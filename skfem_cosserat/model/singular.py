"""Singular positions of closed loops: the rank beside them, branches of the motion, dead points.

In a singular position the closure rows depend on each other although they do not elsewhere: a
four-bar lies flat, a drive has pulled a linkage straight. The mobility is that of the positions
beside it. There may be several branches of motion through such a position, or none beyond it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..drive import JointDrive
from ..joint import Joint
from ..log import logger
from ..types import Floats, IndexArray
from .chart import Chart
from .checks import Scene
from .closure import SINGULAR, Selected

__all__ = ["DeadPoint", "branches", "broken_rows", "dead_point", "generic_rank", "loop_joints"]

#: move (rad, relative to the extent) from the reference to the positions where the rank is decided
BESIDE = 0.03
#: closing by all rows at once, which near a singular position converges linearly
ROUNDS = 12
#: what a closed loop may violate its rows by, relative to the sizes of their terms
CLOSED = 1e-12
#: violation of dependent rows above which prescribed motions contradict each other
BROKEN = 1e-8

Redundant = Sequence[tuple[object, IndexArray, Floats]]


def generic_rank(system: Scene, redundant: Redundant) -> Redundant:
    """Redundant rows beside the reference configuration, if they are fewer there.

    Then the reference is a singular position, and a warning says so. The mechanism is moved a
    little along some of the directions that seem free (always the same ones) and closed again by
    all rows.
    """
    closure = system.closure
    if not redundant or closure.rank == system.kinematics.unknowns:
        return redundant
    start = system.extend(system.q0, 0.0)
    chart = Chart(system.kinematics)
    chart.begin(start, system.ground(0.0))
    T = _tree_values(system, start, chart)
    Z = closure.null_matrix(closure.select(start, T))
    size = np.ones(len(Z))
    for c in closure.components:
        size[c.columns] = c.scale
    before = [c.rank for c in closure.components]
    best, ranks, where = redundant, before, start
    random = np.random.default_rng(0)
    for _ in range(4):
        move = Z @ random.standard_normal(Z.shape[1])
        chart.reset()
        chart.add(BESIDE / abs(move / size).max() * move)
        y = _closed_by_all_rows(system, chart)
        found = closure.decide(y, _tree_values(system, y, chart))
        now = [c.rank for c in closure.components]
        if sum(now) > sum(ranks):
            best, ranks, where = found, now, y
    if where is start:
        return closure.decide(start, T)
    closure.decide(where, _tree_values(system, where, chart))
    names = [
        joint.label
        for k, c in enumerate(closure.components)
        if ranks[k] > before[k]
        for joint in loop_joints(system, closure.rows[c.rows])
    ]
    logger.warning(
        "the reference configuration is a singular position of the closed loop through %s: %d"
        " constraint rows are independent there, %d beside it, which is what counts",
        *(", ".join(names), sum(before), sum(ranks)),
    )
    return best


def _tree_values(system: Scene, y: Floats, chart: Chart) -> Floats:
    return system.kinematics.T_values(system.kinematics.locate(y, chart.fixed))


def _closed_by_all_rows(system: Scene, chart: Chart) -> Floats:
    """The nearest configuration in which all rows hold, as far as they can."""
    closure = system.closure
    for _ in range(ROUNDS):
        y = chart.configuration()
        g = system.constraints.values(y)[closure.rows] / closure.magnitude
        step = np.zeros(system.kinematics.unknowns)
        for c, C in zip(
            closure.components, closure.matrices(y, _tree_values(system, y, chart)), strict=True
        ):
            step[c.columns] = -c.scale * np.linalg.lstsq(C, g[c.rows], rcond=1e-7)[0]
        chart.add(step)
    return chart.configuration()


# -- branches --------------------------------------------------------------------------------------


def branches(system: Scene, y: Floats, selected: Selected) -> list[Floats]:
    """Directions (columns, free) in which the motion may go on from a singular position.

    With one row lost the directions that C leaves free fulfil the constraints to second order if
    ``c . D^2 g (v, v) = 0``, c being the combination of rows that vanishes: a quadratic form of
    rank two, whose zeros are two planes. Empty if more rows are lost, or if there is no branch.
    """
    component, closure = selected.component, system.closure
    U, pivots, V = np.linalg.svd((selected.Q1 @ selected.R).T)
    if not component.free or (pivots > SINGULAR * pivots[0]).sum() != component.rank - 1:
        return []
    N = V[component.rank - 1 :].T
    weights = U[:, -1] / closure.magnitude[component.rows[selected.local]]
    chart = Chart(system.kinematics)
    chart.begin(y, y[system.rows :])
    step = 1e-3

    def bend(v: Floats) -> float:
        total = -2 * weights @ system.constraints.values(y)[selected.rows]
        for sign in (1.0, -1.0):
            increment = np.zeros(system.kinematics.unknowns)
            increment[component.columns] = sign * step * component.scale * v
            chart.reset()
            chart.add(increment)
            total += weights @ system.constraints.values(chart.configuration())[selected.rows]
        return float(total) / step**2

    diagonal = np.array([bend(n) for n in N.T])
    form = np.diag(diagonal)
    for i in range(len(diagonal)):
        for j in range(i):
            both = bend(N[:, i] + N[:, j]) - diagonal[i] - diagonal[j]
            form[i, j] = form[j, i] = 0.5 * both
    values, vectors = np.linalg.eigh(form)
    if not (values[0] < 0 < values[-1]):
        return []
    low, high = np.sqrt(-values[0]) * vectors[:, 0], np.sqrt(values[-1]) * vectors[:, -1]
    return [N @ np.linalg.svd((high + sign * low)[None])[2][1:].T for sign in (1.0, -1.0)]


# -- dead points -----------------------------------------------------------------------------------


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
    y, t, step, worst = y0, t0, h, 0
    while step > 1e-9 * h and t < t0 + h * (1 - 1e-12):
        end = min(t + step, t0 + h)
        chart.begin(y, system.ground(end))
        chosen = closure.select(y, _tree_values(system, y, chart))
        found, failed = _closed(system, chart, chosen)
        if found is None:
            step, worst = 0.5 * step, failed
        else:
            y, t = found, end
    if t >= t0 + h * (1 - 1e-12):
        return None
    component = closure.components[worst]
    joints = loop_joints(system, closure.rows[component.rows])
    through = ", ".join(joint.label for joint in joints)
    drives = [d for d in system.drives if any(d.joint is j for j in joints)]
    if drives:
        which = " and ".join(f"the {d.label} at {_reached(d, t)}" for d in drives)
    else:
        which = "the prescribed motion of the ground"
    verb = "work" if len(drives) > 1 else "works"
    return DeadPoint(
        t,
        f"dead point at t = {t:.6g} s: {which} {verb} against the closed loop through {through},"
        " which does not close beyond it",
    )


def _reached(drive: JointDrive, t: float) -> str:
    unit = "rad" if drive.coordinate.kind == "angle" else "m"
    return f"{drive.coordinate.name} = {drive.value(t):.6g} {unit}"


def _closed(
    system: Scene, chart: Chart, chosen: list[Selected]
) -> tuple[Floats | None, int]:
    """Configuration with closed loops near the chart's, or None and the component that fails."""
    closure = system.closure
    worst = 0
    for _ in range(30):
        y = chart.configuration()
        g = system.constraints.values(y)
        step = np.zeros(system.kinematics.unknowns)
        gaps = []
        again = closure.again(chosen, y, _tree_values(system, y, chart))
        for s in again:
            violation = closure.violation(s, g)
            gaps.append(float(abs(violation).max(initial=0.0)))
            step[s.component.columns] = s.correction(violation)
        worst = int(np.argmax(gaps))
        if gaps[worst] < CLOSED:
            return y, worst
        size = max(float(abs(step[c.columns] / c.scale).max(initial=0.0)) for c in closure.components)
        if not size < 1:
            return None, worst
        chart.add(step)
    return None, worst


def loop_joints(system: Scene, rows: IndexArray) -> list[Joint]:
    """Joints around the loops that these constraint rows close."""
    above = {e.child: e for e in system.tree.edges}
    found: list[Joint] = []
    for jr in system.joint_rows:
        item = jr.joint.joint if isinstance(jr.joint, JointDrive) else jr.joint
        if not ((rows >= jr.rows.start) & (rows < jr.rows.stop)).any():
            continue
        paths = []
        for vertex in (jr.a.vertex, jr.b.vertex):
            path = []
            while vertex in above:
                path.append(above[vertex].joint)
                vertex = above[vertex].parent
            paths.append(path)
        around = [j for j in paths[0] if not any(j is k for k in paths[1])]
        around += [j for j in paths[1] if not any(j is k for k in paths[0])]
        for joint in (*around, item):
            if not any(joint is j for j in found):
                found.append(joint)
    order = {id(jr.joint): k for k, jr in enumerate(system.joint_rows)}
    return sorted(found, key=lambda joint: order[id(joint)])


def broken_rows(system: Scene, y: Floats) -> str | None:
    """Which dependent constraint row does not hold although the independent ones do, and by how much."""
    rows = system.redundant
    if not len(rows):
        return None
    g = abs(system.constraints.values(y)[rows]) / np.maximum(
        system.constraints.magnitudes(y)[rows], 1e-300
    )
    worst = int(g.argmax())
    if not g[worst] > BROKEN:
        return None
    return str(rows[worst])
