"""How well the steps of a run resolve its motion, from recorded states alone.

Schemes of second order are off by ``h^3 x'''/12`` in a step. With neighbouring states that is a
twelfth of their third difference. Over some steps these errors add up in one direction, until what
vibrates is opposite to where it ought to be: then the error is twice its amplitude.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..history import History
from ..model import System
from ..model.limits import owner
from ..model.parts import separate_parts
from ..types import Floats, IndexArray

#: steps over which errors add up, and the part of a third difference that a step is off by
STEPS, SHARE = 50, 1 / 12
#: windows of neighbouring states that are looked at at most, evenly spread, one for so many
#: recorded states, and the states of each
WINDOWS, APART, STATES = 10, 100, 12
#: states of a window that tell of an error, and the part of a scene that is no motion
ENOUGH, NOISE = 8, 1e-7
#: difference of two steps, and of neighbouring states, relative, that is none
SAME, ROUNDING = 1e-6, 1e-12
#: angle in a step from which on prescribed motion is a fast one
FAST = 0.25


@dataclass(frozen=True)
class Resolution:
    """What steps do to a motion.

    Attributes
    ----------
    error : float
        Estimate of the largest error of a position that fifty steps make, relative to the range of
        the position that moves most in what it is connected with.
    turn : float
        Largest rotation of a frame in a step (rad), mean over a window: one jolt does not count.
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


def resolution(system: System, history: History) -> Resolution | None:
    """Look at windows of a history; None where it does not tell.

    It does not without two neighbouring states (for an error eight), and where prescribed motion
    turns or vibrates fast: a step has it right at its end, whatever happens in between.

    Parameters
    ----------
    system : System
    history : History
        With equal steps. Only states that are one step apart are compared.

    Returns
    -------
    Resolution or None
    """
    rows = _windows(history)
    if rows.shape[1] < 2:
        return None
    told = rows.shape[1] >= ENOUGH
    if system.moving and (not told or _fast_ground(system, history.times[rows])):
        return None
    y = history["q"].reshape(len(history), -1, 3)
    origins = np.asarray(system.origin_rows)
    places = y[rows[:, :, None], origins]  # (windows, states, vertices, 3)
    seen = y[np.unique(rows)][:, origins]
    # of each part of the scene, the way of the position that moves most
    part = separate_parts(system).part[origins]
    extent = np.zeros(part.max(initial=0) + 1)
    np.maximum.at(extent, part, np.linalg.norm(seen.max(0) - seen.min(0), axis=-1))
    third, angle = _differences(places)
    with np.errstate(all="ignore"):
        most = 2 * third / np.minimum(angle, 2.0) ** 3
        off = np.minimum(STEPS * SHARE * third, most)
    # a few steps do not tell how far a motion goes, and one of rounding goes nowhere
    moves = told & (extent > NOISE * system.length)
    off = np.where(moves[part], np.nan_to_num(off) / np.where(moves, extent, 1.0)[part], 0.0)
    w, v = np.unravel_index(int(off.argmax()), off.shape)
    turn, turning = _turns(system, y, rows)
    return Resolution(
        float(off[w, v]),
        turn,
        float(2 * np.pi / angle[w, v]) if angle[w, v] > 0 else np.inf,
        owner(system, int(origins[v])).label,
        turning,
        float(history.times[rows[w, -1]]),
    )


def _differences(places: Floats) -> tuple[Floats, Floats]:
    """Third ones over windows (w, states, v, 3), and the angle in a step of what makes them.

    A vibration that advances by an angle x in a step has differences ``(2 sin(x/2))^k`` times its
    amplitude. The fifth tell the angle of what the third come from, whatever slow motion it is on.
    """
    third, fifth = _largest(np.diff(places, 3, axis=1)), _largest(np.diff(places, 5, axis=1))
    some = third > ROUNDING * abs(places).max(initial=0.0)
    with np.errstate(all="ignore"):
        return third, np.where(some, np.sqrt(fifth / third), 0.0)


def _fast_ground(system: System, times: Floats) -> bool:
    """Whether what is prescribed in windows of times (w, states) is far from linear in a step."""
    ground = np.array([[system.ground(t) for t in each] for each in times.tolist()])
    return bool(_differences(ground)[1].max(initial=0.0) > FAST)


def _largest(differences: Floats) -> Floats:
    """The longest of a window, of each vertex."""
    return np.asarray(np.sqrt((differences**2).sum(-1).max(1, initial=0.0)))


def _neighbours(history: History) -> NDArray[np.bool_]:
    """Whether a state is one whole step behind the one before it: those to events are shorter."""
    ways, next_to = np.diff(history.times), np.diff(history["step"]) == 1
    if next_to.any():
        next_to &= abs(ways - np.median(ways[next_to])) < SAME * abs(ways)
    return np.asarray(next_to)


def _windows(history: History) -> IndexArray:
    """States (windows, states) that are one step apart in each window; none if there are none."""
    next_to = _neighbours(history)
    breaks = np.flatnonzero(~next_to)
    longest = int(np.diff(np.concatenate([[-1], breaks, [len(next_to)]])).max())
    width = min(STATES, longest)
    passed = np.concatenate([[0], np.cumsum(next_to)])
    starts = np.flatnonzero(passed[width - 1 :] - passed[: len(passed) - width + 1] == width - 1)
    windows = min(WINDOWS, 2 + len(starts) // APART, len(starts))
    chosen = np.linspace(0, len(starts) - 1, windows).round().astype(int)
    return np.asarray(starts[np.unique(chosen)][:, None] + np.arange(width))


def _turns(system: System, y: Floats, rows: IndexArray) -> tuple[float, str]:
    """Largest rotation (rad) of a frame in a step, and of what."""
    origins = np.asarray(system.origin_rows)[system.is_frame[: len(system.origin_rows)]]
    if not len(origins):
        return 0.0, ""
    triads = y[rows[:, :, None, None], origins[:, None] + np.arange(1, 4)]
    cosines = (triads[:, :-1] * triads[:, 1:]).sum((-1, -2))
    angles = np.arccos(np.clip((cosines - 1) / 2, -1, 1)).mean(1)
    k = np.unravel_index(int(angles.argmax()), angles.shape)
    return float(angles[k]), owner(system, int(origins[k[-1]])).label
