"""Closed loops: independent rows, singular positions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import lu, solve_triangular
from scipy.sparse import coo_matrix, csr_matrix, diags, identity, vstack
from scipy.sparse.linalg import splu

from ..errors import InputError, ModelWarning
from ..frames import Item, is_beam
from ..joint import Joint, JointDrive
from ..kernels import cross, null_space_blocks
from ..theory import TheoryInextensible, TheoryRigid
from ..types import NO_INDICES, TOLERANCE, Floats, IndexArray
from ..warn import warn
from .checks import JointRows
from .closure import SINGULAR, Closure, RowsByTwists, Selected, continued, directed, pivoted
from .reparametrisation import Reparametrisation
from .theories import HeldElement, Spanning, rows_of
from .tree import RigidElement

if TYPE_CHECKING:
    from .system import System

# -- which joints close loops, and which of their constraint rows depend on the others -------------

#: violation of constraints, relative to the scene, that is more than rounding
BROKEN = 1e-8
#: what a closed loop may violate its rows by, relative to the sizes of their terms
CLOSED = 1e-13
#: move (rad, relative to the extent) from the reference to the positions where the rank is decided
BESIDE = 0.03


def joint_of(jr: JointRows) -> Joint:
    """The joint, or that of the drive."""
    return jr.joint.joint if isinstance(jr.joint, JointDrive) else jr.joint


def rows_by_tree(system: System, rows: IndexArray, y: Floats, fixed: Floats) -> csr_matrix:
    """Constraint rows (r, K) by the tree's coordinates at y; translations by the extent."""
    kin = system.kinematics
    by_twists = RowsByTwists(kin, system.constraints, rows)
    T = kin.T.matrix(kin.values_at(y, fixed))
    return csr_matrix(
        by_twists.pattern.matrix(by_twists.values(y)) @ T @ diags(kin.scale(system.length))
    )


def independent_null_space(rows: csr_matrix) -> csr_matrix:
    """Basis (K, K - r) of what independent rows (r, K) leave free: some columns, each alone.

    The other columns follow from them; they are pivots of Gaussian elimination.
    """
    count, size = rows.shape
    order, L, _ = lu(rows.toarray().T, p_indices=True)  # overwriting is wrong in scipy 1.18.1
    part = -solve_triangular(L[:count], L[count:].T, trans="T", lower=True, unit_diagonal=True)
    return csr_matrix(vstack([csr_matrix(part), identity(size - count)]).tocsr()[order])


def null_basis(system: System, y: Floats) -> csr_matrix:
    """Z (K, unknowns): the tree's coordinates by what loops, and strains that are held, leave."""
    closure = system.closure
    kin = system.kinematics
    rows, cols, ones = closure.null_pattern()
    values = closure.null_values(closure.select(y, kin.values_at(y)), ones)
    shape = kin.unknowns, kin.unknowns - closure.rank
    Z = coo_matrix((values, (rows, cols)), shape=shape).tocsr()
    if not len(system.held_rows):
        return Z
    scale = diags(kin.scale(system.length))
    held = rows_by_tree(system, system.held_rows, y, kin.fixed_axes(y))
    free = diags(1 / kin.scale(system.length)) @ Z
    return csr_matrix(scale @ free @ independent_null_space(held @ free))


def null_space_matrix(system: System, y: Floats) -> csr_matrix:
    """``system.null_space`` at all rows y as a sparse matrix: beams have thousands of unknowns."""
    kin = system.kinematics
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
    T = kin.T.matrix(system.kinematics.values_at(y))
    return (P.tocsr() @ (T @ null_basis(system, y))).tocsr()


def close_loops(system: System) -> None:
    """Find which rows the tree leaves, and which of those that close loops are redundant.

    Sets ``spanning``, ``closure``, ``held_rows`` and ``redundant`` of the scene. Warns of a
    reference configuration that is a singular position, or next to one.
    """
    spanning = system.spanning = Spanning(system.tree, system.theory_rows)
    closing = {id(joint) for joint in system.tree.loops}
    loops = [jr for jr in system.joint_rows if id(joint_of(jr)) in closing]
    around = [spanning.around((jr.a.vertex, jr.b.vertex)) for jr in loops]
    around += [spanning.around(each.vertices(e)) for each, e in spanning.closing]
    on_loops = set().union(*around)
    inside, apart = (
        [each for each in spanning.joining if (each in on_loops) == wanted]
        for wanted in (True, False)
    )
    rows = [np.arange(jr.rows.start, jr.rows.stop) for jr in loops]
    numbers = np.concatenate([*rows, rows_of(spanning.closing)])
    own = system.kinematics, system.constraints, numbers, system.length
    system.closure = Closure(*own, acting(system, inside))
    #: rows of strains that no loop goes along: they are independent of all others
    system.held_rows = acting(system, apart)
    system.redundant = numbers[:0]
    if not len(numbers):
        return
    start = system.spanned
    there = system.closure.decide(start, system.kinematics.values_at(start))
    system.redundant = _beside(system, start, there)
    doubt = almost_redundant(system)
    if doubt and system.immovable is None:
        warn("model", doubt, ModelWarning)
    _check_motion(system)


def almost_redundant(system: System) -> str:
    """Message about a loop whose rows are only just independent; empty if there is none."""
    for c in system.closure.components:
        # independent by a slip of the pen rather than by design
        if c.weakest < 1e-5:
            names = names_of(system, system.closure.rows[c.rows])
            return (
                f"constraint rows of the closed loop through the {names} are independent by"
                f" {c.weakest:.1e} only: if it was meant to move, give its places and axes with"
                " more digits"
            )
    return ""


def independent_rows(system: System, y: Floats) -> IndexArray:
    """Rows that the tree leaves, so many as are independent at y."""
    chosen = system.closure.select(y, system.kinematics.values_at(y))
    return np.concatenate([*(s.independent for s in chosen), system.held_rows])


def closure_rows(system: System) -> Floats:
    """Independent rows (r, K) that the tree leaves, in the reference configuration."""
    y = system.spanned
    length = system.length
    kin = system.kinematics
    rows = rows_by_tree(system, independent_rows(system, y), y, kin.fixed_axes(y))
    return rows.toarray() / kin.scale(length)


def loop_joints(system: System, rows: IndexArray) -> list[Item]:
    """Joints around the loops that these constraint rows close, in the order of adding.

    Then the beams whose strains are held and that are part of it.
    """
    spanning = system.spanning
    around = set()
    for jr in system.joint_rows:
        if ((rows >= jr.rows.start) & (rows < jr.rows.stop)).any():
            around |= spanning.around((jr.a.vertex, jr.b.vertex)) | {joint_of(jr)}
    for each, e in spanning.closing:
        if np.isin(each.numbers[e], rows).any():
            around |= spanning.around(each.vertices(e)) | {(each, e)}
    beams = {id(element[0].beam) for element in around if isinstance(element, tuple)}
    beams |= {id(element.item) for element in around if isinstance(element, RigidElement)}
    joints = [jr.joint for jr in system.joint_rows if jr.joint in around]
    return joints + [each.beam for each in system.theory_rows if id(each.beam) in beams]


def moved(system: System, y: Floats, ground: Floats, increment: Floats) -> Floats | None:
    """Configuration (total, 3) after a finite motion from y in the unknowns of the null space.

    Loops are closed, strains that are held are as before; None if that cannot be.

    Parameters
    ----------
    ground : (total - rows, 3) array
        Rows of the ground there.
    increment : (unknowns,) array
    """
    kin = system.kinematics
    rows = independent_rows(system, y)
    nodal = Reparametrisation(kin)
    scale = kin.scale(system.length)
    nodal.begin(y, ground)
    nodal.add(null_basis(system, y) @ increment)
    size = system.constraints.magnitudes(y)[rows]
    for _ in range(30):
        found = nodal.configuration()
        gap = system.constraints.values(found)[rows]
        if (abs(gap) <= CLOSED * np.maximum(size, 1e-300)).all():
            return found
        J = rows_by_tree(system, rows, found, nodal.fixed)
        try:
            step = -J.T @ splu((J @ J.T).tocsc()).solve(gap)
        except RuntimeError:  # SuperLU: exactly singular
            break
        if not abs(step).max() < 1:
            break
        nodal.add(scale * step)
    return None


def closed(
    system: System, nodal: Reparametrisation, chosen: Sequence[Selected]
) -> tuple[Floats | None, int]:
    """Configuration near that of the reparametrisation in which the chosen rows hold.

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
        y = nodal.configuration()
        g = system.constraints.values(y)
        step = np.zeros(system.kinematics.unknowns)
        gaps = []
        size = 0.0
        for s in closure.again(chosen, y, system.kinematics.values_at(y, nodal.fixed)):
            violation = closure.violation(s, g)
            gaps.append(float(abs(violation).max(initial=0.0)))
            part = s.correction(violation)
            step[s.component.columns] = part
            size = max(size, abs(part / s.component.scale).max(initial=0.0))
        worst = int(np.argmax(gaps))
        if gaps[worst] < CLOSED:
            return y, worst
        if not size < 1:
            break
        nodal.add(step)
    return None, worst


def names_of(system: System, rows: IndexArray) -> str:
    """Labels of the joints around the loops that these rows close."""
    return ", ".join(joint.label for joint in loop_joints(system, rows))


def drivers(system: System, rows: IndexArray, t: float) -> str:
    """Subject and verb: the drives on a loop, or the moving ground."""
    drives = _drives(system, rows)
    if not drives:
        return "the prescribed motion of the ground works"
    names = " and ".join(f"the {drive.label} at {reached(drive, t)}" for drive in drives)
    return f"{names} work{'s' if len(drives) == 1 else ''}"


def _drives(system: System, rows: IndexArray) -> list[JointDrive]:
    around = {id(joint) for joint in loop_joints(system, rows)}
    return [
        jr.joint
        for jr in system.joint_rows
        if isinstance(jr.joint, JointDrive) and id(jr.joint.joint) in around
    ]


def reached(drive: JointDrive, t: float) -> str:
    """Value that a drive prescribes at a time (s), in words."""
    unit = "rad" if drive.coordinate.kind == "angle" else "m"
    return f"{drive.coordinate.name} = {drive.value(t):.6g} {unit}"


# -- prescribed motion -----------------------------------------------------------------------------


def _check_motion(system: System) -> None:
    """The loops can follow the drives and the moving ground when they set out."""
    closure = system.closure
    if not system.moving or not len(closure.rows):
        return
    start = system.spanned
    now = system.ground(system.since)
    nodal = Reparametrisation(system.kinematics)
    chosen = closure.select(start, system.kinematics.values_at(start))
    for t in (system.since + 0.1 / 2**k for k in range(11)):
        later = system.ground(t)
        if abs(later - now).max() > 0.01 * min(1.0, system.length):
            continue
        nodal.begin(start, later)
        y, worst = closed(system, nodal, chosen)
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


def violated(system: System, y: Floats) -> tuple[int, float]:
    """The component whose rows, redundant ones included, are violated most, and how much."""
    closure = system.closure
    g = abs(system.constraints.values(y)[closure.rows]) / closure.magnitude
    return max(
        ((k, float(g[c.rows].max())) for k, c in enumerate(closure.components)),
        key=lambda pair: pair[1],
    )


# -- a singular reference configuration ------------------------------------------------------------


def _beside(system: System, start: Floats, redundant: IndexArray) -> IndexArray:
    """Redundant rows beside the reference configuration, if they are fewer there.

    Then the reference is a singular position, and a warning says so. If it is one of beams alone,
    which no treatment leaves rightly, the system is marked as immovable. The mechanism is moved a
    little along some of the directions that seem free (always the same ones), drives move on, and
    the loops are closed again.
    """
    closure = system.closure
    if not len(redundant) or closure.rank == system.kinematics.unknowns:
        return redundant
    T = system.kinematics.values_at(start)
    chosen = closure.select(start, T)
    before = [c.rank for c in closure.components]
    best, ranks, where = redundant, before, start
    nodal = Reparametrisation(system.kinematics)
    random = np.random.default_rng(0)
    grounds = [system.ground(system.since), _moved_ground(system)]
    for k in range(4):
        closure.decide(start, T)
        nodal.begin(start, grounds[k % 2])
        nodal.add(_small_move(system, chosen, random))
        y = _regular_place(system, nodal, chosen)
        if y is None:
            continue
        found = closure.decide(y, system.kinematics.values_at(y))
        now = [c.rank for c in closure.components]
        if sum(now) > sum(ranks):
            best, ranks, where = found, now, y
    closure.decide(where, system.kinematics.values_at(where))
    if where is not start:
        _warn(system, before, ranks)
    return best


def _warn(system: System, before: Sequence[int], ranks: Sequence[int]) -> None:
    closure = system.closure
    lost = [
        closure.rows[c.rows]
        for c, rank, more in zip(closure.components, before, ranks, strict=True)
        if more > rank
    ]
    rows = np.concatenate(lost)
    around = loop_joints(system, rows)
    item = f"closed loop through the {names_of(system, rows)}"
    text = (
        f"the reference configuration is a singular position: {sum(before)} of its constraint rows"
        f" are independent there, {sum(ranks)} beside it"
    )
    if _beams_alone_move(around):
        text += (
            ". Its beams hold strains that no small motion from there leaves as they are: a"
            " straight beam that is held at both ends cannot bend without extension, and neither"
            " it nor a ring stays untwisted out of its plane. "
        )
        if any(is_beam(each) and isinstance(each.theory, TheoryInextensible) for each in around):
            text += "Hold fewer strains: theory=TheoryKirchhoff(), with torsion"
        else:
            text += "Take a theory with torsion"
        system.immovable = item, text
    else:
        warn(item, f"{text}, which is what counts", ModelWarning)


def _beams_alone_move(around: Sequence[Item]) -> bool:
    """True if a loop of these joints and beams can only move by deforming its beams."""
    if not any(is_beam(item) and not isinstance(item.theory, TheoryRigid) for item in around):
        return False
    free = [_freedoms(joint) for joint in around if isinstance(joint, Joint)]
    # a triangle, or one link
    return sum(free) <= 3 or sum(map(bool, free)) <= 2


def _freedoms(joint: Joint) -> int:
    """Number of relative motions that a joint leaves free."""
    free = joint.freedom()
    return (3 if free.turns is None else len(free.turns)) + len(free.slides) + 2 * free.sphere


def _small_move(system: System, chosen: Sequence[Selected], random: np.random.Generator) -> Floats:
    """Random small increment (K,) of the tree's coordinates, along what the rows leave free."""
    move = np.zeros(system.kinematics.unknowns)
    for s in chosen:
        part = s.Q2 @ random.standard_normal(s.component.free)
        size = abs(part).max(initial=1e-300)
        move[s.component.columns] = BESIDE / size * s.component.scale * part
    return move


def _moved_ground(system: System) -> Floats:
    """The ground a little later."""
    now = system.ground(system.since)
    for t in (system.since + 0.1 / 2**k for k in range(8)):
        later = system.ground(t)
        if abs(later - now).max() < 2 * BESIDE * max(1.0, system.length):
            return later
    return now


def _regular_place(
    system: System, nodal: Reparametrisation, chosen: Sequence[Selected]
) -> Floats | None:
    """Configuration in which the loops close and C has its largest rank, or None.

    None if the chosen rows close the loops all by themselves, or if they do not close.
    """
    closure = system.closure
    saved = nodal.save()
    y, _ = closed(system, nodal, chosen)
    if y is not None and violated(system, y)[1] < TOLERANCE:
        return None
    nodal.restore(saved)
    for _ in range(4):  # halves the distance from the singular position, if nothing is free there
        y = nodal.configuration()
        g = system.constraints.values(y)[closure.rows] / closure.magnitude
        step = np.zeros(system.kinematics.unknowns)
        matrices = closure.matrices(y, system.kinematics.values_at(y, nodal.fixed))
        for c, C in zip(closure.components, matrices, strict=True):
            step[c.columns] = -c.scale * np.linalg.lstsq(C, g[c.rows], rcond=1e-6)[0]
        nodal.add(step)
    y = nodal.configuration()
    T = system.kinematics.values_at(y, nodal.fixed)
    closure.decide(y, T)
    return closed(system, nodal, closure.select(y, T))[0]


# -- singular positions of closed loops: passages, branches of the motion, dead points of drives ---
#
# In a singular position the closure rows depend on each other although they do not elsewhere: a
# four-bar lies flat, a drive has pulled a linkage straight. Several branches of motion may cross
# there, or none may go on.

#: pivot below which a position may be on either branch of a crossing, whichever the motion is on
NEAR = 1e-4


class Passages:
    """Watches closed loops from step to step: singular positions met or passed, once for each."""

    def __init__(self, system: System):
        self.system = system
        self._before: Sequence[Selected] | None = None
        self._inside: list[bool] = []

    def look(self, y: Floats, T: Floats, chosen: Sequence[Selected]) -> list[tuple[str, str]]:
        """Singular positions that are new at y with tree values T: labels of loops, and what.

        Let A be the rows chosen at the first of two configurations, together with the free
        directions there. Where A becomes singular on the way, an eigenvalue of ``A_0^-1 A_1``
        turns negative: one for each row that is lost there, so that pairs do not cancel.
        """
        before = self._before
        was_inside = self._inside
        inside = [bool((s.pivots <= SINGULAR).any()) for s in chosen]
        self._before = chosen
        self._inside = inside
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
        return [
            (f"closed loop through the {names_of(self.system, rows)}", what) for what, rows in found
        ]


def _turned(before: Selected, now: Selected) -> bool:
    """True if rows lost their independence between two configurations, an even number included.

    The other eigenvalues, of the free directions, are one.
    """
    held = now.component.held  # independent in any configuration
    A1 = (now.Q1[:, held:] @ now.R[held:, held:]).T @ before.Q1[:, held:]
    values = np.linalg.eigvals(np.linalg.solve(before.R[held:, held:].T, A1))
    return bool(((values.real < 0) & (abs(values.imag) <= 1e-9 * abs(values))).any())


# -- branches --------------------------------------------------------------------------------------


def branches(system: System, y: Floats, selected: Selected) -> list[Selected]:
    """The ways in which the motion may go on from a singular position.

    With one row lost the directions v that C leaves free fulfil the constraints to second order if
    ``c . D^2 g (v, v) = 0``, c being the combination of rows that vanishes: a quadratic form of
    rank two, whose zeros are two planes. Empty if more rows are lost, or if there is no branch.
    """
    component = selected.component
    closure = system.closure
    U, pivots, V = np.linalg.svd((selected.Q1 @ selected.R).T)
    if not component.free or (pivots > NEAR * pivots[0]).sum() != component.rank - 1:
        return []
    N = V[component.rank - 1 :].T
    weights = U[:, -1] / closure.magnitude[component.rows[selected.local]]
    nodal = Reparametrisation(system.kinematics)
    nodal.begin(y, y[system.rows :])
    step = 1e-3

    def value(v: Floats) -> float:
        increment = np.zeros(system.kinematics.unknowns)
        increment[component.columns] = step * component.scale * v
        nodal.reset()
        nodal.add(increment)
        return float(weights @ system.constraints.values(nodal.configuration())[selected.rows])

    def bend(v: Floats) -> float:
        return (value(v) + value(-v) - 2 * value(0 * v)) / step**2

    form = 0.25 * np.array([[bend(a + b) - bend(a - b) for a in N.T] for b in N.T])
    values, vectors = np.linalg.eigh(form)
    if not values[0] < 0 < values[-1]:
        return []
    low = np.sqrt(-values[0]) * vectors[:, 0]
    high = np.sqrt(values[-1]) * vectors[:, -1]
    planes = [N @ np.linalg.svd((high + sign * low)[None])[2][1:].T for sign in (1.0, -1.0)]
    return [directed(selected, plane) for plane in planes]


def way_on(
    system: System, y: Floats, s: Selected, before: Floats | None, momentum: Floats | None
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
    # below, the free directions of C are no tangent: off by round-off over the square of it
    return s if least > 1e-6 and likeness(s) > likeness(best) - NEAR else best


def way_off(
    system: System, y: Floats, ground1: Floats, s: Selected, momentum: Floats | None, h: float
) -> Floats:
    """Increment (n,) of a first step from a singular position, in which the loops close."""
    nodal = Reparametrisation(system.kinematics)
    nodal.begin(y, ground1)
    nodal.add(h * _rates(system, y, way_on(system, y, s, None, momentum), momentum)[0])
    found, _ = closed(system, nodal, system.closure.select(y, system.kinematics.values_at(y)))
    return np.zeros(system.n) if found is None else (found - y)[: system.rows].reshape(-1)


def _rates(system: System, y: Floats, s: Selected, momentum: Floats | None) -> tuple[Floats, float]:
    """Rates (K,) of the tree along the free directions of one component, for a momentum (n,).

    And twice the kinetic energy they have.
    """
    kin = system.kinematics
    if momentum is None or not s.component.free:
        return np.zeros(kin.unknowns), 0.0
    T = system.kinematics.values_at(y)
    directions = np.zeros((s.component.free, kin.unknowns))
    directions[:, s.component.columns] = s.null.T
    P = np.array([kin.rates(y, kin.T.expand(T, d))[: system.rows] for d in directions])
    p = np.tensordot(P, momentum.reshape(-1, 3), ((1, 2), (0, 1)))
    M = np.tensordot(P, np.array([system.mass @ v for v in P]), ((1, 2), (1, 2)))
    rates = np.linalg.lstsq(M, p, rcond=None)[0]
    return rates @ directions, float(p @ rates)


# -- drives ----------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class DeadPoint:
    """Instant at which prescribed motion has taken a closed loop as far as it goes.

    Attributes
    ----------
    time : float
        Until which the loop closes (s).
    reason : str
        What drives against what.
    """

    time: float
    reason: str


def dead_point(system: System, y0: Floats, t0: float, h: float) -> DeadPoint | None:
    """Dead point of a closed loop that cannot follow prescribed motion over the step from y0.

    The loops are closed for a growing part of the step; None if they close at its end.
    """
    closure = system.closure
    if not system.moving or not len(closure.rows):
        return None
    nodal = Reparametrisation(system.kinematics)
    y, t, end, step, worst = y0, t0, t0 + h, h, 0
    while step > 1e-9 * h and t < end:
        until = end if t + step > end - 1e-12 * h else t + step
        nodal.begin(y, system.ground(until))
        chosen = closure.select(y, system.kinematics.values_at(y, nodal.fixed))
        found, failed = closed(system, nodal, chosen)
        if found is None:
            step = 0.5 * step
            worst = failed
        else:
            y = found
            t = until
    if t == end:
        return None
    rows = closure.rows[closure.components[worst].rows]
    return DeadPoint(
        t,
        f"dead point at t = {t:.6g} s: {drivers(system, rows, t)} against the closed loop through"
        f" the {names_of(system, rows)}, which does not close beyond it",
    )


def contradiction(system: System, y: Floats, t: float) -> str | None:
    """Message about contradictory prescribed motions: dependent rows that do not hold at y."""
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


# -- constraint rows of a scene in a plane: which act there, and which of them are independent -----

#: numbers of a triad's rows 11, 22, 33, 12, 13, 23 in which a director does not occur
_WITHOUT = np.array([[1, 2, 5], [0, 2, 4], [0, 1, 3]])


def coordinates_in_plane(system: System) -> csr_matrix:
    """Matrix (n, count): all coordinates by those that change in the plane, two for a row of y."""
    plane = system.plane
    assert plane is not None
    rows = plane.moving(system.q0.reshape(-1, 3), system.origin_rows)
    count = 2 * len(rows)
    i = (3 * rows[:, None] + np.arange(3))[:, :, None].repeat(2, 2).ravel()
    j = np.arange(count).reshape(-1, 1, 2).repeat(3, 1).ravel()
    values = np.broadcast_to(plane.axes.T, (len(rows), 3, 2)).ravel()
    return csr_matrix((values, (i, j)), shape=(system.n, count))


def rows_in_plane(system: System) -> IndexArray:
    """Constraint rows that act in the plane, independent of each other; of closed loops all.

    Of triads and joints of the tree one by one, where the reference is. They stay independent: all
    turns about the normal of the plane.

    Raises
    ------
    InputError
        If they do not leave what the joints leave free.
    """
    along = coordinates_in_plane(system)
    count = along.shape[1]
    y = system.extend(system.q0, 0.0)
    kept = _of_triads(system, (system.constraints.jacobian(y) @ along).tocsr(), y)
    held = (system.constraints.jacobian(y) @ _rigid(system, y)).tocsr()
    loops = {id(joint) for joint in system.tree.loops}
    rows: dict[int, list[IndexArray]] = {}
    for jr in system.joint_rows:
        rows.setdefault(id(joint_of(jr)), []).append(np.arange(jr.rows.start, jr.rows.stop))
    for joint, own in rows.items():
        if joint not in loops:
            kept.append(_pick(held, np.concatenate(own)))
    for each in system.theory_rows:
        open_rows = np.setdiff1d(each.numbers, system.closure.rows)
        elements = (open_rows - each.rows.start) // (each.shape[1] * each.shape[2])
        kept += [_pick(held, open_rows[elements == e]) for e in np.unique(elements)]
    out = np.sort(np.concatenate([NO_INDICES, *kept]))
    free = system.kinematics.unknowns - len(system.held_rows)
    if count - len(out) != free:
        raise InputError(
            "planar scene",
            f"{count} coordinates less {len(out)} constraints in the plane are not the"
            f" {free} unknowns of its joints: use NullSpace()",
        )
    return np.union1d(out, system.closure.rows)


def acting(system: System, elements: Sequence[HeldElement]) -> IndexArray:
    """Constraint rows of elements that hold strains; of a scene in a plane those that act in it."""
    rows = rows_of(elements)
    if system.plane is None or not len(rows):
        return rows
    y = system.spanned
    held = (system.constraints.jacobian(y) @ _rigid(system, y)).tocsr()
    return np.concatenate([_pick(held, each.numbers[e].ravel()) for each, e in elements])


def _of_triads(system: System, G: csr_matrix, y: Floats) -> list[IndexArray]:
    """Rows of triads: those without the director along the normal, if one is."""
    kin = system.kinematics
    plane = system.plane
    assert plane is not None
    still = np.linalg.norm(kin.directors(y) @ plane.axes.T, axis=2) <= TOLERANCE
    first = 6 * np.arange(len(still))
    kept = [(first[still[:, k]][:, None] + others).ravel() for k, others in enumerate(_WITHOUT)]
    oblique = first[~still.any(1)]
    return [*kept, *(_pick(G, np.arange(k, k + 6)) for k in oblique)]


def _rigid(system: System, y: Floats) -> csr_matrix:
    """Rates (n, 3 a frame or 2 a point) of each vertex by itself, rotations by length."""
    kin = system.kinematics
    plane = system.plane
    assert plane is not None
    first = 3 * np.arange(len(system.origin_rows))
    rows, cols, values = [], [], []

    def add(row: IndexArray, column: IndexArray, rate: Floats) -> None:
        rows.append((3 * row[:, None] + np.arange(3)).ravel())
        cols.append(column.repeat(3))
        values.append(np.broadcast_to(rate, (len(row), 3)).ravel())

    for k, axis in enumerate(plane.axes):
        add(system.origin_rows, first + k, system.length * axis)
    for i in range(3):
        row = kin.director_rows[:, i]
        add(row, first[kin.frames] + 2, cross(plane.normal, y[row]))
    ij = np.concatenate(rows), np.concatenate(cols)
    shape = (system.n, 3 * len(first))
    return coo_matrix((np.concatenate(values), ij), shape=shape).tocsr()


def _pick(matrix: csr_matrix, rows: IndexArray) -> IndexArray:
    """Some of the rows that are independent and span all of them."""
    part = matrix[rows]
    columns = np.unique(part.indices)
    if not len(columns):
        return rows[:0]
    order, d = pivoted(part[:, columns].toarray(), 0)
    return np.sort(rows[order[: (d > TOLERANCE * max(1.0, d.max())).sum()]])
