"""Resolution of a motion by the steps of a run, estimated from recorded states alone.

A vibration that ought to advance by an angle x in a step advances by ``2 atan(x/2)``, a twelfth of
``x^3`` less (so with energy-momentum; others of second order are off by as much), in a composed
step by the sum over its parts. Over some steps this adds up, until what vibrates is opposite to
where it ought to be: then the error is twice its amplitude. Neighbouring states tell the angle.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from ..arguments import checked
from ..history import History
from ..model import System
from ..model.limits import owner
from ..model.loops import null_space_matrix
from ..model.parts import separate_parts
from ..types import SAME, Floats, IndexArray, largest, spread
from .momenta import Projection
from .stacked import driven_alternation

#: steps over which errors add up, and the error that these make, relative to the way that the scene
#: covers, above which a run is doubtful: set on one half of sixty random scenes
STEPS = 50
MOST_OFF = 0.08
#: neighbouring states of a window that is looked at, and the least that tell of an error (fifth
#: differences)
STATES = 12
ENOUGH = 6
#: part of a scene's length that is no motion
NOISE = 1e-7
#: Newton iterations of a step that is looked at for other solutions (most take two to five, some
#: with kept factors up to eight), those that each other part of a composed step takes, and how far
#: off (rad, or relative to the range of its motion) is what neighbouring steps lead to
MANY, USUAL, FAR = 6, 4, 0.25
#: step times the frequency with which compression drives rotations that alternate from step to
#: step, above which these grow
ALTERNATES = 2.0


@dataclass(frozen=True)
class Resolution:
    """Estimate of how well steps resolve a motion.

    Attributes
    ----------
    error : float
        Estimate of the largest error of a position that fifty steps make, or all of a shorter run,
        relative to the range of the position that moves most in what it is connected with.
    turn : float
        Largest rotation of a frame in a step (rad), mean over a window, or median of states that
        are apart: one jolt does not count.
    period : float
        Steps in a period of the motion where the error is largest.
    item, turning : str
        Labels of what is farthest off, and of what turns most.
    time : float
        When it is off (s).

    Examples
    --------
    >>> Resolution(0.2, 0.1, 12.0, "beam 'rod'", "beam 'rod'", 0.5).error
    0.2
    """

    error: float
    turn: float
    period: float
    item: str
    turning: str
    time: float


@checked
def resolution(system: System, history: History) -> Resolution | None:
    """Look at windows of a history; None where it does not tell.

    It does not of less than two states (for an error six). Motion is that against the
    ground that moves a part, if any does; what drives and joints prescribe wholly does not count.

    Parameters
    ----------
    system : System
    history : History
        With equal steps. States that are one step apart are compared; where there are none, what
        velocities do in a step is compared with the way that the motion covers.

    Returns
    -------
    Resolution or None
    """
    rows = _windows(history)
    apart = spread(len(history), STEPS)
    if not len(rows) and len(history) < ENOUGH:
        return None
    seen = rows.ravel() if len(rows) else apart
    y = _beside(system, history["q"][seen].reshape(len(seen), -1, 3), history.times[seen])
    extent = _extents(system, y)
    if len(rows):
        y = y.reshape(*rows.shape, -1, 3)
        times = history.times[rows[:, -1]]
        moved = np.diff(y, axis=1)
        size, angle = _vibrations(y.take(system.origin_rows, 2))
        share = size / extent
    else:  # a vibration moves by the angle times its size
        moved = _moved(system, history, apart)
        times = history.times[-1:]
        ways = np.square(moved.take(system.origin_rows, 2)).sum(-1)
        angle = np.sqrt(2 * ways.mean(1)) / (extent / 2)
        share = np.full(angle.shape, 0.5)
    # directors are orthonormal: each component of the rotation moves two of them
    chords = np.sqrt(np.square(moved.take(system.kinematics.director_rows, 2)).sum((-1, -2)) / 8)
    turns = 2 * np.arcsin(np.minimum(chords, 1.0)).mean(1).max(0, initial=0.0)
    parts = np.multiply.outer(history.meta.get("shares") or (1.0,), angle)
    lost = min(STEPS, np.ptp(history["step"])) * abs(angle - 2 * np.arctan(parts / 2).sum(0))
    off = np.minimum(share * np.minimum(lost, 2.0), lost / 2)  # of what vibrates few cover less
    w, v = np.unravel_index(off.argmax(), off.shape)
    turning = ""
    if turns.size:
        turning = system.owner[system.kinematics.frames[turns.argmax()]].label
    return Resolution(
        float(off[w, v]),
        largest(turns),
        float(2 * np.pi / angle[w, v]) if angle[w, v] > 0 else np.inf,
        system.owner[v].label,
        turning,
        float(times[w]),
    )


def _moved(system: System, history: History, rows: IndexArray) -> Floats:
    """Changes (1, k, rows, 3) in a step of some states that their velocities make."""
    q = history["q"][rows]
    t = history.times[rows]
    v = Projection(system).velocities(q, history["p"][rows], t)
    parts = np.array([[0.0], [1e-3]])
    after = parts * (np.ptp(history.times) / np.ptp(history["step"]))
    y = (q + after[:, :, None] * v).reshape(2, len(rows), -1, 3)
    return np.diff(_beside(system, y, t + after), axis=0) / parts[1]


@checked
def doubtful_steps(system: System, history: History) -> NDArray[np.bool_]:
    """True for states whose step may have found one of several solutions of its equations.

    A step that is too long for its motion may have several solutions, each with its energy in
    balance: which one is found depends on where the iterations begin. Such a step takes many
    iterations, or more than one attempt, and ends where its neighbours do not lead to: third
    differences with them are large. Which solution is the right one is not known.

    Steps between states that are not recorded one by one are not looked at.

    Parameters
    ----------
    system : System
    history : History
        With the series "newton_iterations" and "attempts" of a run.

    Returns
    -------
    (N,) array of bool

    Examples
    --------
    >>> from skfem_cosserat import EnergyMomentum, MassPoint, Model, NullSpace, simulate
    >>> model = Model()
    >>> ball = model.add("ball", MassPoint(1.0, velocity=(1.0, 0, 0)))
    >>> history = simulate(model, EnergyMomentum(), NullSpace(), 0.1, until=0.5)
    >>> doubtful_steps(model.freeze(), history).tolist()
    [False, False, False, False, False, False]
    """
    out = np.zeros(len(history), bool)
    shares = np.abs(history.meta.get("shares") or (1.0,))
    hard = history["newton_iterations"] >= MANY + USUAL * (len(shares) - 1)
    steps = np.flatnonzero(hard | (history["attempts"] > 1))
    # of four states, those in which a step is the first, second or third one
    starts = np.unique(steps[:, None] - np.arange(1, 4))
    starts = starts[(starts >= 0) & (starts < len(history) - 3)]
    starts = starts[_neighbours(history)[starts[:, None] + np.arange(3)].all(1)]
    if not len(starts):
        return out
    q = history["q"].reshape(len(history), -1, 3)
    times = history.times
    some = spread(len(q), STEPS)
    scale = np.full(system.rows, shares.max() ** 3 / FAR)
    scale[system.origin_rows] /= _extents(system, _beside(system, q[some], times[some]))
    far = np.zeros(len(out) + 3, bool)  # the step to state k is in windows k to k + 2 of it
    for some in np.array_split(starts, len(starts) // 100 + 1):
        four = some[:, None] + np.arange(4)
        third = np.diff(_beside(system, q[four], times[four]), 3, axis=1)[:, 0]
        far[some + 3] = (scale * np.linalg.norm(third, axis=-1) > 1).any(1)
    out[steps] = far[steps[:, None] + np.arange(3)].any(1)
    return out


@dataclass(frozen=True)
class Alternation:
    """Rotations of nodes that alternate from step to step and grow.

    Attributes
    ----------
    ratio : float
        Step times the frequency omega_c with which compression drives them: they grow above 2.
    item : str
        Label of what they turn most.
    time : float
        When the ratio is that large (s).

    Examples
    --------
    >>> Alternation(3.0, "beam 'strut'", 0.5).ratio
    3.0
    """

    ratio: float
    item: str
    time: float


@checked
def alternation(system: System, history: History, h: float) -> Alternation | None:
    """The first of some states of a variational run in which alternating rotations grow, or None.

    See :func:`constraint_frequency`; up to twenty states are looked at.

    Parameters
    ----------
    system : System
    history : History
        With the series "constraint_force".
    h : float
        Step (s), of composed steps the longest part of it.
    """
    known = np.flatnonzero(
        np.isfinite(history["constraint_force"]).all(1) & ~history["fresh"].astype(bool)
    )
    if not len(known) or not system.beam_groups:
        return None
    for k in known[spread(len(known))]:
        state = history["q"][k], history["constraint_force"][k]
        if not np.isfinite(state[0]).all():
            break
        omega, row = driven_alternation(system, *state)
        if h * omega > ALTERNATES:
            return Alternation(h * omega, owner(system, row).label, float(history.times[k]))
    return None


@lru_cache(maxsize=4)
def _held(system: System) -> NDArray[np.bool_]:
    """Rows (rows,) of frames and points that cannot move while drives and ground are at rest."""
    P = abs(null_space_matrix(system, system.extend(system.q0, 0.0)))
    moves = np.ravel(P.sum(1)).reshape(-1, 3).max(1) > 0
    axes = system.kinematics.director_rows
    moves[axes] = moves[axes].any(1, keepdims=True)
    return np.logical_not(moves)


def _extents(system: System, y: Floats) -> Floats:
    """The way of what moves most in the separate part that each vertex is of; no motion: inf."""
    ways = np.linalg.norm(np.ptp(y.take(system.origin_rows, 1), axis=0), axis=-1)
    part = separate_parts(system).part[system.origin_rows]
    extent = np.zeros(part.max(initial=0) + 1)
    np.maximum.at(extent, part, ways)
    return np.where(extent > NOISE * system.length, extent, np.inf)[part]


def _vibrations(places: Floats) -> tuple[Floats, Floats]:
    """Sizes over windows (w, states, v, 3) of what vibrates, and the angle that it has in a step.

    A vibration that advances by an angle x in a step has differences ``(2 sin(x/2))^k`` times its
    amplitude: the third and the fifth tell both, whatever slow motion it is on.
    """
    third, fifth = (
        np.linalg.norm(np.diff(places, order, axis=1), axis=-1).max(1, initial=0.0)
        for order in (3, 5)
    )
    some = third > SAME * largest(places)
    with np.errstate(all="ignore"):
        chord = np.where(some, np.minimum(np.sqrt(fifth / third), 2.0), 0.0)
        return np.where(chord > 0, third / chord**3, 0.0), 2 * np.arcsin(chord / 2)


def _beside(system: System, y: Floats, times: Floats) -> Floats:
    """Configurations (..., rows, 3) at times: parts tied to the ground as seen from what moves it.

    What cannot move but with drives and ground stays where it was.
    """
    if not system.moving:
        return y
    out = y.copy()
    drives = {system.row_of(drive.place) - system.rows for drive in system.drives}
    for k in [k for k in range(4, system.grounds.rows, 4) if k not in drives][:1]:
        ground = np.array([system.ground(t)[k : k + 4] for t in times.ravel().tolist()])
        frames = ground.reshape(*times.shape, 4, 3)
        parts = separate_parts(system)
        tied = parts.free[parts.part] == 0
        out[..., system.origin_rows[tied[system.origin_rows]], :] -= frames[..., :1, :]
        out[..., tied, :] = out[..., tied, :] @ frames[..., 1:, :].swapaxes(-1, -2)
    held = _held(system)
    out[..., held, :] = system.q0.reshape(-1, 3)[held]
    return out


def _neighbours(history: History) -> NDArray[np.bool_]:
    """True for pairs of successive states one whole step apart: steps to events are shorter."""
    ways = np.diff(history.times)
    next_to = np.diff(history["step"]) == 1
    usual = np.median(ways[next_to]) if next_to.any() else np.nan
    return next_to & np.isclose(ways, usual, atol=0.0)


def _windows(history: History) -> IndexArray:
    """States (windows, states) that are one step apart in each window; none if there are none."""
    next_to = _neighbours(history)
    for width in (STATES, ENOUGH, 2):
        if len(next_to) < width - 1:
            continue
        starts = np.flatnonzero(sliding_window_view(next_to, width - 1).all(1))
        if len(starts):
            return starts[spread(len(starts))][:, None] + np.arange(width)
    return np.zeros((0, 2), np.int64)
