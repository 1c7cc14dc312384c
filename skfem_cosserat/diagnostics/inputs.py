"""Inputs of a run, compared with its steps: they do not see all that happens between their ends.

Prescribed motion acts at the ends of steps, and so do loads of some schemes. Others take the exact
mean of a load over a step: a short pulse is whole, but what vibrates cancels.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Literal, cast

import numpy as np

from ..errors import InputError
from ..frames import Motion
from ..history import History
from ..joint import JointDrive
from ..model import System
from ..time_function import Constant, FunctionOfTime
from ..types import ArrayLike, Floats, spread
from .resolution import ENOUGH

#: pieces of a step that are looked at, and steps at most
INSIDE, LOOKS = 16, 1000
#: instants of a whole motion at which functions of users are looked at before it
WHOLE = 4096
#: part of what a function does that steps may miss, and the part of its size that is rounding
MISSED, ROUNDING = 0.1, 1e-9
#: how a function of time acts: by its means over steps or at their ends, or it moves what is held
_Acts = Literal["means", "ends", "moves"]


def unseen(system: System, history: History, at_ends: bool) -> tuple[str, str] | None:
    """Label of the load, drive or moving ground of which steps miss most, and what is said of it.

    None if the steps of the run see what enters it, or are fewer than six. Up to a thousand of them
    are looked at, recorded or not, and those in which a load has a declared kink.

    Parameters
    ----------
    system : System
    history : History
    at_ends : bool
        Whether loads act at the ends of steps, as in generalized-alpha schemes; else by their
        means.

    Examples
    --------
    >>> import skfem_cosserat as sc
    >>> model = sc.Model()
    >>> ball = model.add("ball", sc.MassPoint(1.0))
    >>> load = sc.LoadForce(ball.place(), (1.0, 0, 0), sc.Harmonic(1.0, frequency=50.0))
    >>> load = model.add("hum", load)
    >>> run = sc.simulate(model, sc.EnergyMomentum(), sc.NullSpace(), 0.001, until=0.1)
    >>> unseen(model.freeze(), run, at_ends=False) is None
    True
    """
    steps = history["step"]
    ends = np.interp(np.arange(steps[0], steps[-1] + 1), steps, history.times)
    if len(ends) <= ENOUGH:
        return None
    found = _most_missed(system, ends, at_ends)
    if found is None:
        return None
    share, item, acts = found
    what = "cancels in their means" if acts == "means" else "is between their ends"
    return item, (
        f"steps of {np.diff(ends).max():.3g} s do not see what it does:"
        f" {100 * min(share, 1.0):.0f} % of it {what}, which act; take smaller steps, and compare"
    )


def steps_that_see(
    system: System, begun: float, end: float, at_ends: bool, counts: Sequence[int]
) -> tuple[int, str]:
    """The first of some numbers of equal steps that see what enters a motion; "" or what none sees.

    Parameters
    ----------
    system : System
    begun, end : float
        Of the motion (s).
    at_ends : bool
        As for :func:`unseen`.
    counts : sequence of int
        Growing.

    Examples
    --------
    >>> import skfem_cosserat as sc
    >>> model = sc.Model()
    >>> ball = model.add("ball", sc.MassPoint(1.0))
    >>> hum = sc.LoadForce(ball.place(), (1.0, 0, 0), sc.Harmonic(1.0, frequency=64.0))
    >>> hum = model.add("hum", hum)
    >>> steps_that_see(model.freeze(), 0.0, 1.0, False, (64, 128, 256, 512, 1024))
    (128, '')
    """
    item = ""
    for count in counts:
        ends = np.linspace(begun, end, count + 1)
        found = _most_missed(system, ends, at_ends, WHOLE // count)
        if found is None:
            return count, ""
        item = found[1]
    return counts[-1], item


def _most_missed(
    system: System, ends: Floats, at_ends: bool, pieces: int = 0
) -> tuple[float, str, _Acts] | None:
    """Part that is missed of what steps miss most, its item, and how it acts; None: all see enough.

    With a number of pieces means of functions of users, which ask for few values in each step, are
    compared with as many.
    """
    worst: tuple[float, str, _Acts] = MISSED, "", "means"
    inside = max(INSIDE, pieces)
    for item, function, kinks, acts in _entering(system, at_ends):
        time = getattr(function, "__self__", None)  # one of users asks for few values in a step
        users = time if isinstance(time, FunctionOfTime) else None
        looks = inside if users and acts == "ends" else INSIDE
        try:
            share = _missed(function, kinks, acts, ends, looks)
            if users and acts == "means" and pieces:
                share = max(share, _overlooked(users, ends, inside))
        except InputError:  # one of the user's that is not known at all times
            return None
        worst = max(worst, (share, item, acts), key=lambda each: each[0])
    return worst if worst[1] else None


def _overlooked(time: FunctionOfTime, ends: Floats, pieces: int) -> float:
    """Part of a function in steps that find the same value wherever they look."""
    inside = ends[:-1, None] + np.diff(ends)[:, None] * np.arange(pieces + 1) / pieces
    f = np.array([time.value(t) for t in inside.ravel().tolist()]).reshape(inside.shape)
    few = f[:, :: max(pieces // INSIDE, 1)]
    flat = (few == few[:, :1]).all(axis=1)
    whole = abs(f).sum()
    return float(abs(f - few[:, :1])[flat].sum() / whole) if whole else 0.0


#: item, function of time, its declared kinks, and how it acts
_Entering = tuple[str, Callable[[float], ArrayLike], Sequence[float], _Acts]


def _entering(system: System, at_ends: bool) -> Iterator[_Entering]:
    for loads in (system.loading, system.couplings):
        for time, owner in zip(loads.times, loads.owners, strict=True):
            if not isinstance(time, Constant):
                kinks = getattr(time, "times", getattr(time, "kinks", ()))
                yield owner.label, time.value, kinks, "ends" if at_ends else "means"
    for drive in system.drives:
        angle = drive.coordinate.kind == "angle"
        yield drive.label, partial(_turned, drive) if angle else drive.value, (), "moves"
    drives = {id(drive.place) for drive in system.drives}
    for place in {id(p.motion): p for p in system.moving if id(p) not in drives}.values():
        yield place.label, partial(cast(Motion, place.motion).frame, place), (), "moves"


def _turned(drive: JointDrive, t: float) -> tuple[float, float]:
    return math.cos(drive.value(t)), math.sin(drive.value(t))


def _missed(
    function: Callable[[float], ArrayLike],
    kinks: Sequence[float],
    acts: _Acts,
    ends: Floats,
    inside: int,
) -> float:
    """Part of a function that steps between these instants miss, looked at so often in a step."""

    def values(times: Floats) -> Floats:
        return np.array([np.ravel(function(t)) for t in times.tolist()])

    within = [kink for kink in kinks if ends[0] < kink < ends[-1]]
    steps = np.union1d(
        spread(len(ends) - 1, LOOKS), np.searchsorted(ends, within, side="right") - 1
    )
    if acts == "moves":  # a short one may be in a step between those
        bends = np.linalg.norm(np.diff(values(ends), 2, axis=0), axis=1)
        steps = np.union1d(steps, bends.argsort()[-ENOUGH:])
    knots = ends[steps, None] + np.diff(ends)[steps, None] * np.linspace(0, 1, inside + 1)
    grid = np.union1d(knots, within)
    width, t = np.diff(grid), (grid[1:] + grid[:-1]) / 2
    own = np.searchsorted(ends, t) - 1
    looked = np.isin(own, steps)
    width, t, own = width[looked], t[looked], own[looked]
    knots = np.union1d(ends[steps], ends[steps + 1])
    f, at_knots = values(t), values(knots)
    size, farthest = np.linalg.norm(np.ptp(f, axis=0)), 0.0
    if acts == "means":
        missed = width @ abs(f[:, 0]) - abs(np.bincount(own, width * f[:, 0])).sum()
    else:
        chords = np.stack([np.interp(t, knots, each) for each in at_knots.T], axis=1)
        off = np.linalg.norm(f - chords, axis=1)
        missed = width @ off
        if acts == "moves":  # one short move counts by how far it goes, a short force by how long
            farthest = off.max()
        line = np.vander(t - t.mean(), 2)  # what is constant, or moves evenly, moves nothing
        f = f - line @ np.linalg.lstsq(line, f, rcond=None)[0]
    whole = width @ np.linalg.norm(f, axis=1)
    if whole <= ROUNDING * width.sum() * abs(at_knots).max():
        return 0.0
    return float(max(missed / whole, farthest and farthest / size))
