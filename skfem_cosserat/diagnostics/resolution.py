"""Resolution of a motion by the steps of a run, estimated from recorded states alone.

A vibration that ought to advance by an angle x in a step advances by ``2 atan(x/2)``, a twelfth of
``x^3`` less (so with energy-momentum; others of second order are off by as much), in a composed
step by the sum over its parts. Over some steps this adds up, until what vibrates is opposite to
where it ought to be: then the error is twice its amplitude. Neighbouring states tell the angle.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache, partial

import numpy as np
from numpy.typing import NDArray

from ..arguments import checked
from ..constraints.saddle import nearest_velocity
from ..history import History
from ..model import System
from ..model.limits import fastest_turn, owner
from ..model.parts import Connected, connected_parts
from ..types import SAME, Floats, IndexArray, largest, spread
from .momenta import Projection
from .stacked import driven_alternation

#: steps over which errors add up
STEPS = 50
#: error that these make, relative to the way that the scene covers, above which a run is doubtful
MOST_OFF = 0.08
#: windows of neighbouring states that are looked at at most, evenly spread, one for so many
#: recorded states, and the states of each
WINDOWS, APART, STATES = 10, 100, 12
#: states that tell of an error (those of fifth differences), and the part of a scene that is no
#: motion
ENOUGH, NOISE = 6, 1e-7
#: difference of two steps, relative, that is none
EVEN = 1e-6
#: Newton iterations of a step that is looked at for other solutions (most take two to five, some
#: with kept factors up to eight), those that each other part of a composed step takes, and how far
#: off (rad, or relative to the range of its motion) is what neighbouring steps lead to
MANY, USUAL, FAR = 6, 4, 0.25
#: states, evenly spread, that tell the range of a motion; the part of a step that tells a velocity
SPREAD, SMALL = 50, 1e-3
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
    if rows.shape[1] < 2:
        return _by_velocities(system, history) if len(history) >= ENOUGH else None
    told = rows.shape[1] >= ENOUGH
    steps = min(STEPS, int(np.ptp(history["step"])))
    y = _beside(system, history["q"].reshape(len(history), -1, 3)[rows], history.times[rows])
    places, turns = y.take(system.origin_rows, axis=2), _turns(system, y)
    part, extent = _extents(system, places)
    size, angle = _vibrations(places)
    lost = steps * _lost(history, angle)
    off = size * np.minimum(lost, 2.0)
    # a few steps do not tell how far a motion goes, and one of rounding goes nowhere
    moves = told & (extent > NOISE * system.length)
    off = np.where(moves[part], off / np.where(moves, extent, 1.0)[part], 0.0)
    off = np.minimum(off, lost / 2)  # of what vibrates it covers less in a few
    w, v = np.unravel_index(int(off.argmax()), off.shape)
    turn, turning = float(turns.max(initial=0.0)), ""
    if turns.size:
        frame = system.kinematics.frames[int(turns.argmax()) % turns.shape[1]]
        turning = system.owner[frame].label
    return Resolution(
        float(off[w, v]),
        turn,
        float(2 * np.pi / angle[w, v]) if angle[w, v] > 0 else np.inf,
        system.owner[v].label,
        turning,
        float(history.times[rows[w, -1]]),
    )


def _lost(history: History, angle: Floats) -> Floats:
    """Angle that a step of a run lacks of the one that a vibration ought to advance by."""
    parts = np.multiply.outer(history.meta.get("shares") or (1.0,), angle)
    return abs(angle - 2 * np.arctan(parts / 2).sum(axis=0))


def _by_velocities(system: System, history: History) -> Resolution:
    """Resolution of states some steps apart, from their velocities.

    A vibration moves by ``h omega`` of its size in a step.
    """
    k, count = spread(len(history), SPREAD), int(np.ptp(history["step"]))
    h, t, q = float(np.ptp(history.times)) / count, history.times[k], history["q"][k]
    v = Projection(system).velocities(q, history["p"][k], t)
    both = np.stack([q, q + SMALL * h * v], axis=1).reshape(len(k), 2, -1, 3)
    y = _beside(system, both, np.stack([t, t + SMALL * h], axis=1))
    fastest = sorted(
        (turn, item) for item, turn in map(partial(fastest_turn, system), y[:, 1] - y[:, 0])
    )
    turn, turning = fastest[len(k) // 2]
    places = y.take(system.origin_rows, axis=2)
    part, extent = _extents(system, places[:, 0])
    size = np.where(extent > NOISE * system.length, extent, np.inf)[part] / 2
    ways = np.nan_to_num(np.linalg.norm(places[:, 1] - places[:, 0], axis=-1) / SMALL / size)
    angles = np.sqrt(2 * (ways**2).mean(0))  # a vibration's, and less of what moves once
    vertex = int(angles.argmax())
    angle = max(float(angles[vertex]), SAME)
    off = min(min(STEPS, count) * float(_lost(history, np.array(angle))) / 2, 1.0)
    item, time = system.owner[vertex].label, float(t[ways[:, vertex].argmax()])
    return Resolution(off, turn / SMALL, 2 * np.pi / angle, item, turning, time)


@checked
def doubtful_steps(system: System, history: History, most: int | None = None) -> NDArray[np.bool_]:
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
    most : int, optional
        Look only at so many steps, those with the most iterations.

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
    out = np.zeros(len(history), dtype=bool)
    shares = np.abs(history.meta.get("shares") or (1.0,))
    iterations = history["newton_iterations"]
    hard = iterations >= MANY + USUAL * (len(shares) - 1)
    steps = np.flatnonzero(hard | (history["attempts"] > 1))
    steps = steps[np.argsort(-iterations[steps], kind="stable")[:most]]
    # of four states, those in which a step is the first, second or third one
    starts = np.unique(steps[:, None] - np.arange(1, 4))
    starts = starts[(starts >= 0) & (starts < len(history) - 3)]
    next_to = _neighbours(history)
    starts = starts[next_to[starts[:, None] + np.arange(3)].all(1)]
    if not len(starts):
        return out
    q, times = history["q"].reshape(len(history), -1, 3), history.times
    some = slice(None, None, -(-len(q) // SPREAD))
    places = _beside(system, q[some], times[some]).take(system.origin_rows, axis=1)
    part, extent = _extents(system, places)
    moves = extent > NOISE * system.length
    scale = np.full(system.rows, shares.max() ** 3 / FAR)
    scale[system.origin_rows] *= np.where(moves, 1 / np.where(moves, extent, 1.0), 0.0)[part]
    far = np.zeros(len(out) + 3, dtype=bool)  # the step to state k is in windows k to k + 2 of it
    for k in starts.tolist():
        four = _beside(system, q[k : k + 4], times[k : k + 4])
        third = np.linalg.norm(np.diff(four, 3, axis=0)[0], axis=1)
        far[k + 3] = (scale * third > 1).any()
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
def _connected(system: System) -> Connected:
    return connected_parts(system)


@lru_cache(maxsize=4)
def _free(system: System) -> NDArray[np.bool_]:
    """Rows (rows,) that can move while drives and ground are at rest, or others of their frame."""
    p = system.mass @ np.random.default_rng(0).standard_normal((system.rows, 3))
    y0 = system.extend(system.q0, 0.0)
    v = nearest_velocity(system, y0, p.ravel(), None)
    out = np.linalg.norm(v.reshape(-1, 3), axis=1) > NOISE
    axes = system.kinematics.director_rows
    out[axes] = out[axes].any(1, keepdims=True)
    return out


def _extents(system: System, places: Floats) -> tuple[IndexArray, Floats]:
    """The separate part that each vertex is of, and of each part the way of what moves most."""
    part = _connected(system).part[system.origin_rows]
    extent = np.zeros(part.max(initial=0) + 1)
    flat = places.reshape(-1, 3 * len(part))
    np.maximum.at(extent, part, np.linalg.norm(np.ptp(flat, axis=0).reshape(-1, 3), axis=-1))
    return part, extent


def _vibrations(places: Floats) -> tuple[Floats, Floats]:
    """Sizes over windows (w, states, v, 3) of what vibrates, and the angle that it has in a step.

    A vibration that advances by an angle x in a step has differences ``(2 sin(x/2))^k`` times its
    amplitude: the third and the fifth tell both, whatever slow motion it is on.
    """
    differences = np.diff(places, 3, axis=1)
    third, fifth = _largest(differences), _largest(np.diff(differences, 2, axis=1))
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
    out, drives = y.copy(), {system.row_of(drive.place) - system.rows for drive in system.drives}
    own = [k for k in range(4, system.grounds.rows, 4) if k not in drives]
    if own:
        ground = np.array([system.ground(t) for t in times.ravel().tolist()])
        frames = ground.reshape(*times.shape, -1, 3)
        tied = ~_connected(system).free[_connected(system).part]
        places = system.origin_rows[tied[system.origin_rows]]
        out[..., places, :] -= frames[..., own, :].mean(-2)[..., None, :]
        axes = frames[..., own[0] + 1 : own[0] + 4, :].swapaxes(-1, -2)
        out[..., tied, :] = out[..., tied, :] @ axes
    held = ~_free(system)
    out[..., held, :] = system.q0.reshape(-1, 3)[held]
    return out


def _largest(differences: Floats) -> Floats:
    """The longest of a window, of each vertex."""
    squares = np.einsum("...c,...c->...", differences, differences)
    return np.sqrt(squares.max(1, initial=0.0))


def _neighbours(history: History) -> NDArray[np.bool_]:
    """True for pairs of successive states one whole step apart: steps to events are shorter."""
    ways, next_to = np.diff(history.times), np.diff(history["step"]) == 1
    if next_to.any() and not np.ptp(ways) < EVEN * ways.min():  # most runs have equal steps
        next_to &= abs(ways - np.median(ways[next_to])) < EVEN * abs(ways)
    return next_to


def _windows(history: History) -> IndexArray:
    """States (windows, states) that are one step apart in each window; none if there are none."""
    next_to = _neighbours(history)
    breaks = np.flatnonzero(~next_to)
    longest = int(np.diff(np.concatenate([[-1], breaks, [len(next_to)]])).max())
    width = min(STATES, longest)
    passed = np.concatenate([[0], np.cumsum(next_to)])
    starts = np.flatnonzero(passed[width - 1 :] - passed[: len(passed) - width + 1] == width - 1)
    chosen = starts[spread(len(starts), min(WINDOWS, 2 + len(starts) // APART))]
    return chosen[:, None] + np.arange(width)


def _turns(system: System, y: Floats) -> Floats:
    """Rotations (w, frames) in a step (rad), means of windows of configurations (w, s, rows, 3)."""
    triads = y.take(system.kinematics.director_rows, axis=2)
    traces = np.einsum("wsvic,wsvic->wsv", triads[:, :-1], triads[:, 1:])
    return np.arccos(np.clip((traces - 1) / 2, -1, 1)).mean(1)
