"""Checks before a path starts, and the rotations that limit its steps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import qr
from scipy.sparse import bmat, csr_matrix, diags, vstack
from scipy.sparse.linalg import lsqr, splu

from ..constraints import Treatment
from ..diagnostics.inputs import INSIDE
from ..diagnostics.nearest import PIECES, motions_out_of_plane, rigid_motions, rigid_pieces
from ..diagnostics.stacked import blocks_matrix
from ..errors import InputError
from ..integrators import State
from ..linear import SingularMatrixError
from ..model import System
from ..model.closure import RANK_TOLERANCE
from ..model.limits import broken_constraint
from ..model.loops import moved
from ..newton import NewtonSettings
from ..run.start import checked_start
from ..types import SAME, Floats, largest
from .branch import Branch
from .control import STILL, ArcLength, Control, DisplacementControl
from .critical_points import LOOSE, MOST_NEUTRAL, Stability, inspect, tangent_at
from .schedule import Point, Schedule, load_force, weights
from .solver import BALANCED

#: iterations to an equilibrium without free motions
LOADED = 30
#: first motion along free ones, relative to the scene
NUDGE = 1e-6
#: what is left of a motion without those of rigid pieces, relative to it, up to which it is rigid
RIGID = 1e-6


def check_run(
    system: object,
    treatment: object,
    control: object,
    settings: object,
    callbacks: object,
) -> None:
    """Kinds of the arguments of :func:`static`."""
    kinds = {
        "model": (system, System),
        "treatment": (treatment, Treatment),
        "control": (control, Control),
        "settings": (settings, NewtonSettings),
    }
    for name, (value, kind) in kinds.items():
        if not isinstance(value, kind):
            meant = [k for k, (_, other) in kinds.items() if isinstance(value, other)]
            raise InputError(
                f"argument {name}",
                f"{value!r}, expected an object of type {kind.__name__}"
                + (f": pass this one as {meant[0]}=" if meant else ""),
            )
    if not isinstance(callbacks, Sequence) or not all(callable(c) for c in callbacks):
        raise InputError("argument callbacks", f"{callbacks!r}, expected a list of functions")


def first_point(
    system: System, schedule: Schedule, start: State | Branch | None
) -> tuple[Point, Floats | None]:
    """First point, and the direction in which a branch leads off.

    Raises
    ------
    InputError
        If the start is none of this system, at another instant than the path, or off constraints.
    """
    held = schedule.time
    if isinstance(start, Branch):
        if start.time != held:
            raise InputError(
                "argument time", f"{held!r}, the Branch is of a path with {start.time!r}"
            )
        return start.point, start.direction
    turns = None
    if start is None:
        q, t = system.q0, 0.0
    else:
        q, turns, t = checked_start(system, start).q, start.turns, _load_factor(start, held)
        count = len(system.couplings.angles)
        if turns is not None and np.shape(turns) != (count,):
            raise InputError("argument start", f"turns = {turns!r}, expected {count} whole numbers")
    y = system.extend(q, schedule.instant(t))
    wrong = None if start is None and held is None else broken_constraint(system, y, 1e-6)
    if wrong is not None:
        where = f"load factor {t:g}" if held is None else f"the instant time = {held:g} s"
        what = "it" if start is not None else "the reference"
        remedy = (
            ""
            if held is None
            else ": start from a state that fulfils it there, as the end of a path that moves the"
            " supports with the loads held at zero (factors) to this load factor, by"
            " equilibrium(model, path, time=...)"
        )
        raise InputError("argument start", f"at {where} {what} {wrong}{remedy}")
    return Point(y, t, turns), None


def _load_factor(start: State, held: float | None) -> float:
    """Load factor of a state: that of the path it is from, or its time."""
    for name in ("time", "load_factor"):
        value = getattr(start, name)
        if (name == "time" or value is not None) and (
            not isinstance(value, int | float) or not np.isfinite(value)
        ):
            raise InputError("argument start", f"{name} = {value!r}, expected a finite number")
    if held is None:
        return float(start.time if start.load_factor is None else start.load_factor)
    if start.time != held:
        raise InputError(
            "argument start",
            f"its time is {start.time!r} s, that of the path time = {held!r} s: expected the same"
            " instant, see initial_state(time=...) and equilibrium(time=...)",
        )
    return 0.0 if start.load_factor is None else float(start.load_factor)


def check_growth(schedule: Schedule, control: Control) -> None:
    """Raise InputError if nothing is left that a control by displacements could let grow."""
    held = schedule.time is not None and not schedule.grows
    if held and isinstance(control, ArcLength | DisplacementControl):
        raise InputError(
            "argument time",
            f"{schedule.time!r} s holds all there is, nothing grows with the load factor: give"
            f" factors that grow, or LoadControl() instead of {control!r}",
        )


def rotation(system: System, before: Floats, after: Floats) -> float:
    """Largest rotation (rad) of a frame between two configurations."""
    kin = system.kinematics
    if not len(kin.frames):
        return 0.0
    trace = (kin.directors(before) * kin.directors(after)).sum((1, 2))
    return float(np.arccos(np.clip((trace.min() - 1) / 2, -1, 1)))


def prescribed_turn(system: System, t0: float, t1: float) -> float:
    """Rotation (rad) of the ground's frames and of driven angles between two load factors."""
    count = len(system.ground(t0)) // 4
    drives = [
        system.spot(d.place).vertex - len(system.origin_rows)
        for d in system.drives
        if d.coordinate.kind == "angle"
    ]
    total = np.zeros(count)
    before = system.ground(t0).reshape(count, 4, 3)
    for t in np.linspace(t0, t1, INSIDE + 1)[1:]:
        now = system.ground(float(t)).reshape(count, 4, 3)
        trace = (before[:, 1:] * now[:, 1:]).sum((1, 2))
        total += np.arccos(np.clip((trace - 1) / 2, -1, 1))
        # a drive's frame holds (cos, sin, value)
        a, b = before[drives, 0, :2], now[drives, 0, :2]
        total[drives] += abs(np.arctan2(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0], (a * b).sum(1)))
        before = now
    return float(total.max())


# -- motions that nothing holds --------------------------------------------------------------------


@dataclass(eq=False)
class _Free:
    """Motions (6 pieces, k) that strain nothing and that no stress holds."""

    N: Floats
    E: csr_matrix
    centres: Floats
    names: list[str]


def held_start(system: System, schedule: Schedule, point: Point) -> Point:
    """The start of a path, in which no motion is free.

    Where the loads that act at the start stress what then holds a motion, as the weight on a
    spring of no tension does, it is the equilibrium that they lead to.

    Raises
    ------
    InputError
        For a motion that strains nothing and that no stress holds in place.
    """
    free = _free_motions(system, schedule, point)
    if free is None:
        return point
    where = "at the start, where no load acts"
    if _acts(schedule, point):
        loaded, left = _loaded(system, schedule, point)
        if loaded is not None and left is None and _firm(system, schedule, loaded):
            return loaded
        where = "at the start"
        if loaded is not None and left is not None:
            point, free, where = loaded, left, "in the equilibrium with the loads of the start"
    raise _refused(system, schedule, point, free, where)


def check_many(system: System, schedule: Schedule, point: Point, stability: Stability) -> None:
    """Check as of :func:`held_start` for scenes of too many pieces, by motions without stiffness.

    Only where no load acts: loads may stress what then holds a motion. None is tried.
    """
    if stability.firm or _acts(schedule, point):
        return
    label, names = rigid_pieces(system)
    if len(names) <= PIECES:
        return
    K, P = stability.tangent.K, stability.tangent.P
    values, modes = stability.nearest(min(MOST_NEUTRAL, K.shape[0]))
    soft = modes.T[abs(values) <= SAME * largest(K.data)]
    E, centres = rigid_motions(system, point.y, label, len(names))
    found = [_rigid(system, E, [(P @ mode).reshape(-1, 3)]) for mode in soft]
    rigid = [motion for motion in found if motion is not None]
    if rigid:
        free = _Free(_echelon(np.hstack(rigid)), E, centres, names)
        raise _refused(system, schedule, point, free, "or more, at the start, where no load acts")


def _firm(system: System, schedule: Schedule, point: Point) -> Stability | None:
    """Stability of an equilibrium without free motions, if bent beams do not turn freely.

    About their curved axes: that is no rigid motion.
    """
    stability = inspect(system, point, schedule.at(point.t))
    return stability if stability.smallest > LOOSE * stability.floor else None


def _holding(system: System, schedule: Schedule, point: Point) -> dict[str, float]:
    """Factors with which loads that act from the start hold all motions stably; none if none do.

    They are tried: each load that grows with the load factor alone, then all of them.
    """
    growing = schedule.growing if len(rigid_pieces(system)[1]) <= PIECES else []
    for names in [[name] for name in growing] + [growing] * (len(growing) > 1):
        factors = dict.fromkeys(names, 1.0)
        held = schedule.holding(factors)
        if not _acts(held, point):
            continue
        loaded, left = _loaded(system, held, point)
        found = _firm(system, held, loaded) if loaded is not None and left is None else None
        if found is not None and not found.unstable:
            return factors
    return {}


def _acts(schedule: Schedule, point: Point) -> bool:
    """True if loads, actuators or a spin act at the start."""
    now = schedule.at(point.t)
    turns = now.spin is not None and now.spin.velocity.any()
    return bool(turns or now.loads.any() or now.actuators.any())


def _loaded(system: System, schedule: Schedule, point: Point) -> tuple[Point | None, _Free | None]:
    """Equilibrium by Newton's method, None if it is not found, and motions that are free there.

    In each iteration those that are free at its configuration are left alone.
    """
    metric = weights(system).repeat(3)
    last, first = np.inf, 0.0
    for k in range(LOADED):
        free = _free_motions(system, schedule, point)
        rates = csr_matrix((system.n, 0)) if free is None else csr_matrix(free.E @ free.N)
        try:
            tangent = tangent_at(system, point, schedule.at(point.t))
            K, P = tangent.K, tangent.P
            B = P.T @ diags(metric) @ rates * (largest(K.data) or 1.0)
            matrix = bmat([[K, B], [B.T, None]], format="csc")
            increment = splu(matrix).solve(np.append(-tangent.residual, np.zeros(B.shape[1])))
            u, along = np.split(increment, [K.shape[0]])
            force = largest(B @ along)
            first = first if k else largest(tangent.residual)
            if k == 0 and not force <= BALANCED * first:
                # cables that just fit take the load as soon as something moves
                u = splu(tangent.metric.tocsc()).solve(P.T @ (metric * (rates @ along)))
                u *= NUDGE / np.sqrt(metric @ np.square(P @ u))
        except (SingularMatrixError, RuntimeError):
            return None, None
        y = moved(system, point.y, schedule.ground(point.t), u)
        size = float(np.sqrt(metric @ np.square(P @ u)))
        if y is None or not size < 1:
            return None, None
        point = Point(y, point.t, point.turns)
        if size <= STILL and (size > 0.3 * last or size == 0):
            return (point, free) if force <= BALANCED * first else (None, None)
        last = size
    return None, None


def _free_motions(system: System, schedule: Schedule, point: Point) -> _Free | None:
    """Rigid motions of beams and bodies that strain nothing and that no stress holds, if any.

    Each beam and body is one rigid piece: few unknowns decide. None, too, for too many pieces.
    """
    if _fixed(system):
        return None
    label, names = rigid_pieces(system)
    if len(names) > PIECES:
        return None
    E, centres = rigid_motions(system, point.y, label, len(names))
    N = _unheld(system, point.y, E)
    if not N.shape[1]:
        return None
    tangent = tangent_at(system, point, schedule.at(point.t))
    K, P = tangent.K, tangent.P
    # the same motions as unknowns
    W = weights(system).repeat(3)
    U = splu(tangent.metric.tocsc()).solve(P.T @ (W[:, None] * (E @ N)))
    stiffness = U.T @ (K @ U)
    scale = largest(K.data) * float(np.square(U).sum(0).max())
    values, vectors = np.linalg.eigh(0.5 * (stiffness + stiffness.T))
    free = abs(values) <= SAME * max(scale, 1e-300)
    return _Free(_echelon(N @ vectors[:, free]), E, centres, names) if free.any() else None


def _fixed(system: System) -> bool:
    """True if fixed joints hold every piece to the ground, directly or by way of others."""
    label, names = rigid_pieces(system, joined=True)
    ends = [(j.a.vertex, j.b.vertex) for j in system.joint_rows if j.joint.type == "fixed"]
    held = {label[min(pair)] for pair in ends if max(pair) >= len(label)}
    return len(held) == len(names)


def _refused(
    system: System, schedule: Schedule, point: Point, free: _Free, where: str
) -> InputError:
    N, E = free.N, free.E
    force = load_force(system, point.y, schedule.at(point.t + 1.0))
    works = abs((E @ N).T @ force.ravel())
    k = int(works.argmax())
    worked = works[k] > 1e-9 * np.linalg.norm(force) * np.linalg.norm(E @ N[:, k])
    text = _described(N[:, k], free.names, free.centres, system.length)
    factors = _holding(system, schedule, point)
    others = f"with loads that act from the start (factors={factors!r}), " if factors else ""
    return InputError(
        "static",
        f"{text} is free, {N.shape[1]} such motion(s) in all, {where}"
        + (", and the loads do work on it" if worked else "")
        + f": hold it with joints or springs, {others}or start from a state whose stresses do"
        " (a guess of it, start=initial_state(system, q))",
    )


def _unheld(system: System, y: Floats, E: csr_matrix) -> Floats:
    """Combinations (6 pieces, k) of the rigid motions that joints and springs leave free."""
    held = system.constraints.jacobian(y)[system.internal :] @ E
    parts = [csr_matrix(held)]
    if system.couplings.count:
        blocks = system.mass_tangent(0.0)
        springs = blocks_matrix(system, [*blocks, system.couplings.stiffness(y)])
        parts.append(csr_matrix(springs @ E))
    parts.append(motions_out_of_plane(system, E.shape[1] // 6))
    matrix = vstack(parts).toarray()
    size = np.linalg.norm(matrix, axis=1)
    matrix = matrix[size > 1e-12 * size.max(initial=1e-300)]
    matrix /= np.linalg.norm(matrix, axis=1)[:, None]
    # a mass point has no rotations
    there = np.flatnonzero(np.asarray(abs(E).sum(0)).ravel() > 1e-12 * system.length)
    out = np.zeros((E.shape[1], 0))
    if len(there):
        local = _null_space(matrix[:, there])
        out = np.zeros((E.shape[1], local.shape[1]))
        out[there] = local
    return out


def _null_space(A: Floats) -> Floats:
    """Orthonormal columns that A maps to zero: a quarter of the time of singular values."""
    Q, R, _ = qr(A.T, pivoting=True)
    pivots = abs(np.diag(R))
    return Q[:, int((pivots > RANK_TOLERANCE * pivots.max(initial=0.0)).sum()) :]


def _echelon(N: Floats) -> Floats:
    """Basis of the same motions, with as few pieces and components in each as possible."""
    _, _, order = qr(N.T, pivoting=True, mode="economic")
    chosen = order[: N.shape[1]]
    out = np.linalg.solve(N[chosen].T, N.T).T
    return np.where(abs(out) < 1e-9, 0.0, out)


def _described(motion: Floats, names: list[str], centres: Floats, length: float) -> str:
    """A motion in words; unit translations are those by `length`."""
    twists = motion.reshape(-1, 6)
    moving = np.flatnonzero(np.linalg.norm(twists, axis=1) > 1e-9)
    k = int(moving[np.linalg.norm(twists[moving], axis=1).argmax()])
    v, w = twists[k, :3], twists[k, 3:]
    who = " and ".join(names[i] for i in moving[:3]) + (" and others" if len(moving) > 3 else "")
    turn, shift = float(np.linalg.norm(w)), float(np.linalg.norm(v))
    if turn < 1e-9 * max(shift, 1.0):
        return f"translation of {who} along {_triple(v / shift)}"
    axis = w / turn
    through = centres[k] + length * np.cross(axis, v) / turn
    along = length * float(v @ axis) / turn
    text = f"rotation of {who}: {names[k]} about {_triple(axis)} through {_triple(through)}"
    return text if abs(along) < 1e-9 * length else f"{text}, with {along:.3g} m a rad along it"


def described(system: System, y: Floats, motions: Sequence[Floats]) -> str:
    """The first of some motions (rows, 3) that nothing holds in words, and how many they are."""
    label, names = rigid_pieces(system)
    E, centres = rigid_motions(system, y, label, len(names))
    rigid = _rigid(system, E, motions)
    if rigid is not None:
        first = _described(_echelon(rigid)[:, 0], names, centres, system.length)
        return f"a {first}, {len(motions)} such motion(s) in all"
    moved = _columns(system, motions)
    vertex = np.searchsorted(system.origin_rows, np.arange(system.rows), side="right") - 1
    shares = np.zeros(len(names))
    np.add.at(shares, label[vertex].repeat(3), np.square(moved).sum(1))
    who = " and ".join(names[k] for k in np.argsort(-shares)[:3] if shares[k] > 0.1 * shares.max())
    return f"a motion of {who} in itself, {len(motions)} such motion(s) in all"


def _columns(system: System, motions: Sequence[Floats]) -> Floats:
    """Motions (n, k) in the metric of :func:`weights`."""
    size = np.sqrt(weights(system)).repeat(3)
    return np.column_stack([m.ravel() for m in motions]) * size[:, None]


def _rigid(system: System, E: csr_matrix, motions: Sequence[Floats]) -> Floats | None:
    """Motions as those (6 pieces, k) of rigid pieces; None if they are no such ones."""
    moved = _columns(system, motions)
    weighted = diags(np.sqrt(weights(system)).repeat(3)) @ E
    rigid = np.column_stack([lsqr(weighted, m, atol=1e-14, btol=1e-14)[0] for m in moved.T])
    far = np.linalg.norm(moved - weighted @ rigid) > RIGID * np.linalg.norm(moved)
    return None if far else rigid


def _triple(v: Floats) -> str:
    return "(" + ", ".join(f"{x + 0.0:.3g}" for x in np.where(abs(v) < 1e-9, 0.0, v)) + ")"
