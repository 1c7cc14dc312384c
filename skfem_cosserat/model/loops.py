"""Which joints close loops, and which of their constraint rows depend on the others."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.sparse import coo_matrix, csr_matrix

from ..drive import JointDrive
from ..errors import InputError
from ..frames import Item
from ..joint import Joint
from ..kernels import cross, null_space_blocks
from ..kinds import is_beam
from ..log import logger
from ..types import Floats, IndexArray
from .chart import Chart
from .checks import JointRows, Scene
from .closure import Closure, Component, Selected
from .rungs import unheld_spans
from .tree import Span

__all__ = [
    "BROKEN",
    "almost_redundant",
    "close_loops",
    "closed",
    "closure_rows",
    "drivers",
    "loop_joints",
    "names_of",
    "null_space_matrix",
    "redundancies",
    "tree_values",
    "turned_over",
    "violated",
]

#: prescribed motion (m, rad) with which the loops are closed once, for a check
SMALL_MOTION = 1e-2
#: violation of dependent rows above which prescribed motions contradict each other
BROKEN = 1e-8
#: what a closed loop may violate its rows by, relative to the sizes of their terms
CLOSED = 1e-13
#: pivot below which rows are independent by a slip of the pen rather than by design
DOUBTFUL = 1e-5
#: move (rad, relative to the extent) from the reference to the positions where the rank is decided
BESIDE = 0.03
#: violation there of rows that are redundant in the reference only; of the order of BESIDE^2
STILL_REDUNDANT = 1e-9

#: what is said of singular positions of beams
STRAIGHT = (
    " (a straight beam that is held at both ends can neither bend without extension nor stay"
    " untwisted out of its plane: RungUnshearable() leaves it both)"
)

Redundant = Sequence[tuple[Component, IndexArray, Floats]]


def joint_of(jr: JointRows) -> Joint:
    """The joint, or that of the drive."""
    return jr.joint.joint if isinstance(jr.joint, JointDrive) else jr.joint


def tree_values(system: Scene, y: Floats, fixed: Floats | None = None) -> Floats:
    """Values of the tree's T at all rows y, with the axes `fixed` of a chart if there is one."""
    kin = system.kinematics
    return kin.T_values(kin.locate(y, kin.fixed_axes(y) if fixed is None else fixed))


def null_space_matrix(system: Scene, y: Floats) -> csr_matrix:
    """``system.null_space`` at all rows y as a sparse matrix: beams have thousands of unknowns."""
    kin, closure = system.kinematics, system.closure
    values = kin.T_values(kin.locate(y, kin.fixed_axes(y)))
    rows, cols, ones = closure.null_pattern()
    Z = coo_matrix(
        (closure.null_values(closure.select(y, values), ones), (rows, cols)),
        shape=(kin.unknowns, system.unknowns),
    )
    blocks = null_space_blocks(kin.directors(y))
    coordinates = 3 * kin.frame_rows[:, None, None] + np.arange(12)[:, None]
    points = (3 * kin.row[kin.points][:, None] + np.arange(3)).ravel()
    i = np.concatenate([np.broadcast_to(coordinates, blocks.shape).ravel(), points])
    twists = np.broadcast_to(kin.frame_twist[:, None, :], blocks.shape)
    j = np.concatenate([twists.ravel(), kin.point_twist.ravel()])
    P = coo_matrix(
        (np.concatenate([blocks.ravel(), np.ones(len(points))]), (i, j)),
        shape=(system.n, kin.n_twist),
    )
    return (P.tocsr() @ (kin.T_matrix(values) @ Z.tocsr())).tocsr()


def turned_over(system: Scene, y: Floats) -> str | None:
    """See :meth:`System.turned_over`."""
    wrong = np.flatnonzero(system.guards.values(y) < -1)  # cosines, less 1
    if len(wrong):
        return f"{system.guarded[int(wrong[0])].label} by half a turn"
    D = system.kinematics.directors(y)
    wrong = np.flatnonzero((cross(D[:, 0], D[:, 1]) * D[:, 2]).sum(1) < 0)
    if len(wrong):
        return f"triad of {system.owner[int(system.kinematics.frames[wrong[0]])].label}"
    return None


def close_loops(system: Scene) -> tuple[Closure, IndexArray]:
    """Rows of the joints that close loops and of drives on them, and which are redundant."""
    rows = [
        np.arange(jr.rows.start, jr.rows.stop)
        for jr in system.joint_rows
        if any(joint_of(jr) is j for j in system.tree.loops)
    ]
    none = np.zeros(0, dtype=np.int64)
    unheld = unheld_spans(system.rung_rows, [span for span, _ in system.tree.spans])
    numbers = np.concatenate([none, *rows, unheld])
    system.closure = Closure(system.kinematics, system.constraints, numbers, system.length)
    start = system.spanned
    there = system.closure.decide(start, tree_values(system, start))
    redundant = _beside(system, start, there)
    doubt = almost_redundant(system)
    if doubt:
        logger.warning(doubt)
    _check_motion(system)
    dropped = [system.closure.rows[c.rows[which]] for c, which, _ in redundant]
    return system.closure, np.sort(np.concatenate([none, *dropped]))


def almost_redundant(system: Scene) -> str:
    """Which loop has rows that are independent by next to nothing; empty if none has."""
    for c in system.closure.components:
        if c.weakest < DOUBTFUL:
            names = names_of(system, system.closure.rows[c.rows])
            return (
                f"constraint rows of the closed loop through the {names} are independent by"
                f" {c.weakest:.1e} only: if it was meant to move, give its places and axes with"
                " more digits"
            )
    return ""


def closure_rows(system: Scene) -> Floats:
    """Independent closure rows (rank, K) in the reference configuration."""
    y = system.spanned
    out = np.zeros((system.closure.rank, system.kinematics.unknowns))
    start = 0
    for s in system.closure.select(y, tree_values(system, y)):
        c = s.component
        out[start : start + c.rank, c.columns] = s.Q1.T / c.scale
        start += c.rank
    return out


def redundancies(system: Scene) -> dict[str, list[int]]:
    """Numbers of the redundant rows within each joint or drive that has some."""
    out: dict[str, list[int]] = {}
    for jr in system.joint_rows:
        inside = system.redundant[
            (system.redundant >= jr.rows.start) & (system.redundant < jr.rows.stop)
        ]
        if len(inside):
            out[jr.joint.name or ""] = (inside - jr.rows.start).tolist()
    return out


def loop_joints(system: Scene, rows: IndexArray) -> list[Item]:
    """Joints around the loops that these constraint rows close, in the order of adding.

    Then the beams whose strains are held and that are part of it.
    """
    above = {e.child: e for e in system.tree.edges}

    def path(vertex: int) -> set[Joint | Span]:
        out: set[Joint | Span] = set()
        while vertex in above:
            out.add(above[vertex].joint)
            vertex = above[vertex].parent
        return out

    around: set[Joint | Span] = set()
    beams: set[int] = set()
    for jr in system.joint_rows:
        if ((rows >= jr.rows.start) & (rows < jr.rows.stop)).any():
            around |= (path(jr.a.vertex) ^ path(jr.b.vertex)) | {joint_of(jr)}
    for each in system.rung_rows:
        mine = (rows >= each.rows.start) & (rows < each.rows.stop)
        for e in np.unique((rows[mine] - each.rows.start) // (each.shape[1] * each.shape[2])):
            nodes = each.first + each.beam.basis.connectivity[e]
            around |= path(int(nodes[0])) ^ path(int(nodes[-1]))
            beams.add(id(each.beam))
    beams |= {id(each.item) for each in around if isinstance(each, Span)}
    joints: list[Item] = [jr.joint for jr in system.joint_rows if jr.joint in around]
    return joints + [each.beam for each in system.rung_rows if id(each.beam) in beams]


def closed(system: Scene, chart: Chart, chosen: Sequence[Selected]) -> tuple[Floats | None, int]:
    """Configuration near that of the chart in which the chosen rows hold.

    Returns
    -------
    y : (total, 3) array or None
        None if the loops do not close.
    worst : int
        The component with the largest violation, in the end.
    """
    closure = system.closure
    worst = 0
    for _ in range(30):
        y = chart.configuration()
        g = system.constraints.values(y)
        step = np.zeros(system.kinematics.unknowns)
        gaps, size = [], 0.0
        for s in closure.again(chosen, y, tree_values(system, y, chart.fixed)):
            violation = closure.violation(s, g)
            gaps.append(float(abs(violation).max(initial=0.0)))
            part = s.correction(violation)
            step[s.component.columns] = part
            size = max(size, float(abs(part / s.component.scale).max(initial=0.0)))
        worst = int(np.argmax(gaps))
        if gaps[worst] < CLOSED:
            return y, worst
        if not size < 1:
            break
        chart.add(step)
    return None, worst


def names_of(system: Scene, rows: IndexArray) -> str:
    """Labels of the joints around the loops that these rows close."""
    return ", ".join(joint.label for joint in loop_joints(system, rows))


def drivers(system: Scene, rows: IndexArray, t: float) -> str:
    """Subject and verb: the drives on a loop, or the moving ground."""
    drives = _drives(system, rows)
    if not drives:
        return "the prescribed motion of the ground works"
    names = " and ".join(f"the {drive.label} at {_reached(drive, t)}" for drive in drives)
    return f"{names} work{'s' if len(drives) == 1 else ''}"


def _drives(system: Scene, rows: IndexArray) -> list[JointDrive]:
    around = {id(joint) for joint in loop_joints(system, rows)}
    return [
        jr.joint
        for jr in system.joint_rows
        if isinstance(jr.joint, JointDrive) and id(jr.joint.joint) in around
    ]


def _reached(drive: JointDrive, t: float) -> str:
    unit = "rad" if drive.coordinate.kind == "angle" else "m"
    return f"{drive.coordinate.name} = {drive.value(t):.6g} {unit}"


# -- prescribed motion -----------------------------------------------------------------------------


def _check_motion(system: Scene) -> None:
    """The loops can follow the drives and the moving ground when they set out."""
    closure = system.closure
    if not system.moving or not len(closure.rows):
        return
    start, now = system.spanned, system.ground(system.since)
    chart = Chart(system.kinematics)
    chosen = closure.select(start, tree_values(system, start))
    for t in (system.since + 0.1 / 2**k for k in range(11)):
        later = system.ground(t)
        if abs(later - now).max() > SMALL_MOTION * min(1.0, system.length):
            continue
        chart.begin(start, later)
        y, worst = closed(system, chart, chosen)
        if y is not None:
            worst, miss = violated(system, y)
            if miss < BROKEN:
                return
        rows = closure.rows[closure.components[worst].rows]
        drives = _drives(system, rows)
        raise InputError(
            drives[-1].label if drives else loop_joints(system, rows)[-1].label,
            f"the closed loop through the {names_of(system, rows)} cannot follow the prescribed"
            f" motion, at t = {t:g} s already: {drivers(system, rows, t)} against"
            f" {'each other' if len(drives) > 1 else 'it'}",
        )


def violated(system: Scene, y: Floats) -> tuple[int, float]:
    """The component whose rows, redundant ones included, are violated most, and how much."""
    closure = system.closure
    g = abs(system.constraints.values(y)[closure.rows]) / closure.magnitude
    return max(
        ((k, float(g[c.rows].max())) for k, c in enumerate(closure.components)),
        key=lambda pair: pair[1],
    )


# -- a singular reference configuration ------------------------------------------------------------


def _beside(system: Scene, start: Floats, redundant: Redundant) -> Redundant:
    """Redundant rows beside the reference configuration, if they are fewer there.

    Then the reference is a singular position, and a warning says so. The mechanism is moved a
    little along some of the directions that seem free (always the same ones), drives move on, and
    the loops are closed again.
    """
    closure = system.closure
    if not redundant or closure.rank == system.kinematics.unknowns:
        return redundant
    T = tree_values(system, start)
    chosen = closure.select(start, T)
    before = [c.rank for c in closure.components]
    best, ranks, where = redundant, before, start
    chart, random = Chart(system.kinematics), np.random.default_rng(0)
    grounds = [system.ground(system.since), _moved_ground(system)]
    for k in range(4):
        closure.decide(start, T)
        chart.begin(start, grounds[k % 2])
        chart.add(_small_move(system, chosen, random))
        y = _regular_place(system, chart, chosen)
        if y is None:
            continue
        found = closure.decide(y, tree_values(system, y))
        now = [c.rank for c in closure.components]
        if sum(now) > sum(ranks):
            best, ranks, where = found, now, y
    closure.decide(where, tree_values(system, where))
    if where is not start:
        _warn(system, before, ranks)
    return best


def _warn(system: Scene, before: Sequence[int], ranks: Sequence[int]) -> None:
    closure = system.closure
    lost = [
        closure.rows[c.rows]
        for c, rank, more in zip(closure.components, before, ranks, strict=True)
        if more > rank
    ]
    rows = np.concatenate(lost)
    held = any(is_beam(item) for item in loop_joints(system, rows))
    logger.warning(
        "the reference configuration is a singular position of the closed loop through the %s:"
        " %d of its constraint rows are independent there, %d beside it, which is what counts%s",
        names_of(system, rows),
        *(sum(before), sum(ranks)),
        STRAIGHT if held else "",
    )


def _small_move(system: Scene, chosen: Sequence[Selected], random: np.random.Generator) -> Floats:
    """Of the tree's coordinates (K,), along what the rows leave free."""
    move = np.zeros(system.kinematics.unknowns)
    for s in chosen:
        part = s.Q2 @ random.standard_normal(s.component.free)
        size = abs(part).max(initial=1e-300)
        move[s.component.columns] = BESIDE / size * s.component.scale * part
    return move


def _moved_ground(system: Scene) -> Floats:
    """The ground a little later."""
    now = system.ground(system.since)
    for t in (system.since + 0.1 / 2**k for k in range(8)):
        later = system.ground(t)
        if abs(later - now).max() < 2 * BESIDE * max(1.0, system.length):
            return later
    return now


def _regular_place(system: Scene, chart: Chart, chosen: Sequence[Selected]) -> Floats | None:
    """Where the loops close and C has its largest rank; None if the chosen rows do it all."""
    closure, saved = system.closure, chart.save()
    y, _ = closed(system, chart, chosen)
    if y is not None:
        g = abs(system.constraints.values(y)[closure.rows]) / closure.magnitude
        if g.max() < STILL_REDUNDANT:
            return None
    chart.restore(saved)
    for _ in range(4):  # halves the distance from the singular position, if nothing is free there
        y = chart.configuration()
        g = system.constraints.values(y)[closure.rows] / closure.magnitude
        step = np.zeros(system.kinematics.unknowns)
        matrices = closure.matrices(y, tree_values(system, y, chart.fixed))
        for c, C in zip(closure.components, matrices, strict=True):
            step[c.columns] = -c.scale * np.linalg.lstsq(C, g[c.rows], rcond=1e-6)[0]
        chart.add(step)
    y = chart.configuration()
    T = tree_values(system, y, chart.fixed)
    closure.decide(y, T)
    return closed(system, chart, closure.select(y, T))[0]
