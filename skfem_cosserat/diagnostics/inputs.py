"""Inputs of a run: what its steps do not see of loads, drives and moving ground, and their jumps.

Prescribed motion acts at the ends of steps, and so do loads of some schemes. Others take the exact
mean of a load over a step: a short pulse is whole, but what vibrates cancels. Where inputs jump,
constraint forces of the states beside mix both sides.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from functools import cache, partial
from itertools import pairwise
from typing import NamedTuple, cast

import numpy as np

from ..errors import InputError
from ..frames import Motion
from ..history import History
from ..joint import JointDrive
from ..model import System, takes_scene
from ..model.limits import where_it_stays
from ..time_function import Constant
from ..types import ArrayLike, Floats, largest, spread
from .resolution import ENOUGH

#: instants of a step, and of the steps that are looked at together, at which functions are asked
INSIDE = 16
LOOKS = 4096
#: part of what a function does that steps may miss: that of vibrations of less than six steps
MISSED = 0.1
#: part of a function's range up to which it does not jump
SMALL = 1e-2
#: parts of a step to which a jump of a load is followed, of a velocity and of an acceleration;
#: motions are differentiated over a tenth of it
SHORT = 1e-3, 1e-2, 0.2


class _Input(NamedTuple):
    """A function of time that drives a scene.

    Attributes
    ----------
    item : str
        Label of the load, drive or ground.
    value : callable
        At a time (s).
    average : callable or None
        Mean between two times that acts in place of the values; None: those at the ends act.
    moves : bool
        Whether it is a motion.
    kinks : sequence of float
        Known ones (s).
    """

    item: str
    value: Callable[[float], ArrayLike]
    average: Callable[[float, float], float] | None
    moves: bool
    kinks: Sequence[float] = ()


@takes_scene
def unseen(system: System, history: History, at_ends: bool) -> tuple[str, str] | None:
    """Label of the load, drive or moving ground of which steps miss most, and what is said of it.

    None if the steps of the run see what enters it, or are fewer than six. Some hundred of them are
    looked at, recorded or not, and those in which a load has a declared kink.

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
    found = None if len(ends) <= ENOUGH else _most_missed(system, ends, at_ends)
    if found is None:
        return None
    share, each = found
    what = "is between their ends" if each.average is None else "cancels in their means"
    return each.item, (
        f"steps of {np.diff(ends).max():.3g} s do not see what it does:"
        f" {100 * min(share, 1.0):.0f} % of it {what}, which act"
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
        found = _most_missed(system, np.linspace(begun, end, count + 1), at_ends)
        if found is None:
            return count, ""
        item = found[1].item
    return counts[-1], item


def _most_missed(system: System, ends: Floats, at_ends: bool) -> tuple[float, _Input] | None:
    """Part that is missed of what steps miss most; None: all see enough.

    So it is where a function of the user's is not known at all times.
    """
    try:
        shares = [(_missed(each, ends), each) for each in _entering(system, at_ends)]
    except InputError:
        return None
    worst = max(shares, key=lambda each: each[0], default=None)
    return worst if worst is not None and worst[0] > MISSED else None


def _entering(system: System, at_ends: bool) -> Iterator[_Input]:
    for loads in (system.loading, system.couplings):
        for time, owner in zip(loads.times, loads.owners, strict=True):
            if not isinstance(time, Constant):
                kinks = getattr(time, "times", getattr(time, "kinks", ()))
                average = None if at_ends else time.average
                yield _Input(owner.label, time.value, average, False, kinks)
    for drive in system.drives:
        angle = drive.coordinate.kind == "angle"
        yield _Input(drive.label, partial(_turned, drive) if angle else drive.value, None, True)
    drives = {id(drive.place) for drive in system.drives}
    for place in {id(p.motion): p for p in system.moving if id(p) not in drives}.values():
        yield _Input(place.label, partial(cast(Motion, place.motion).frame, place), None, True)


def _turned(drive: JointDrive, t: float) -> tuple[float, float]:
    return math.cos(drive.value(t)), math.sin(drive.value(t))


def _missed(entering: _Input, ends: Floats) -> float:
    """Part of a function that steps between these instants miss."""

    def values(times: Floats) -> Floats:
        return np.array([np.ravel(entering.value(t)) for t in times.tolist()])

    kinks = [kink for kink in entering.kinks if ends[0] < kink < ends[-1]]
    at_ends = values(ends)
    bends = np.linalg.norm(np.diff(at_ends, 2, axis=0), axis=1)
    some = spread(len(ends) - 1, LOOKS // INSIDE)
    steps = np.unique([*some, *np.searchsorted(ends, kinks) - 1, *bends.argsort()[-ENOUGH:]])
    inside = max(INSIDE, LOOKS // len(steps))
    width = np.repeat(np.diff(ends)[steps] / inside, inside)
    t = np.repeat(ends[steps], inside) + width * np.tile(np.arange(inside) + 0.5, len(steps))
    f = values(t)
    farthest = 0.0
    if entering.average is not None:
        means = [entering.average(*ends[k : k + 2]) for k in steps]
        missed = width @ abs(f[:, 0]) - np.diff(ends)[steps] @ np.abs(means)
    else:
        off = np.linalg.norm(f - np.stack([np.interp(t, ends, x) for x in at_ends.T], 1), axis=1)
        missed = width @ off
        if entering.moves:  # one short move counts by how far it goes, a short force by how long
            farthest = off.max() / (np.linalg.norm(np.ptp(f, axis=0)) or 1.0)
        line = np.vander(t - t.mean(), 2)  # what is constant, or moves evenly, moves nothing
        f = f - line @ np.linalg.lstsq(line, f, rcond=None)[0]
    whole = width @ np.linalg.norm(f, axis=1)
    rounding = 1e-9 * width.sum() * abs(at_ends).max()
    return float(max(missed / whole, farthest)) if whole > rounding else 0.0


# -- jumps -----------------------------------------------------------------------------------------


def jumps(system: System, history: History) -> Floats:
    """Times (s) at which a load, or velocity or acceleration of prescribed motion, jumps in a run.

    Loads are all functions of time that drive the scene, those of actuators, too. Second
    differences between some instants of the run are
    followed into ever smaller parts of a step: that of a jump stays as it is. A jump of a load that
    does not stick out like this is found if it is declared, see
    :class:`skfem_cosserat.FunctionOfTime`. Jumps below a hundredth of a function's range are none.
    What jumps within the law of a :class:`skfem_cosserat.Force` is not seen.

    Parameters
    ----------
    system : System
        The scene.
    history : History
        Its run.

    Returns
    -------
    (k,) array
        Times of the jumps (s), ascending.

    Examples
    --------
    >>> import skfem_cosserat as sc
    >>> model = sc.Model()
    >>> ball = model.add("ball", sc.MassPoint(1.0))
    >>> push = lambda t: 1.0 if t < 0.25 else 0.0
    >>> load = model.add("push", sc.LoadForce(ball.place(), (1.0, 0, 0), push))
    >>> run = sc.simulate(model, sc.EnergyMomentum(), sc.NullSpace(), 0.1, until=1.0)
    >>> jumps(model.freeze(), run).round(4).tolist()
    [0.25]
    """
    if len(history) < 2:
        return np.zeros(0)
    h = _step(history)
    start, end = history.times[[0, -1]]
    times = np.linspace(start, end, 1 + min(LOOKS // INSIDE, max(1, int((end - start) / h))))
    found = list[float]()
    for each in _entering(system, True):
        kinks = [t for t in each.kinks if start < t < end]
        for order in (1, 2) if each.moves else (0,):
            d = 0.1 * SHORT[order] * h
            rate = partial(_rate, each.value, order, d)
            rounding = 1e-14 * largest(np.asarray(each.value(end))) / d**order
            later = np.maximum(times, start + 3 * d) if order else times
            found += _jumps(rate, later, 10 * d, rounding, kinks)
    instants = np.unique(found)
    return instants[np.diff(instants, prepend=-np.inf) > 2 * SHORT[0] * h]  # some find the same


def _rate(value: Callable[[float], ArrayLike], order: int, d: float, t: float) -> Floats:
    """A function of time, or its derivative by differences to instants before."""
    before = [np.ravel(value(t - k * d)) for k in range(order, -1, -1)]
    return np.diff(before, order, axis=0)[0] / d**order


def _jumps(
    function: Callable[[float], Floats],
    times: Floats,
    width: float,
    rounding: float,
    kinks: Sequence[float],
) -> list[float]:
    """Times, to a width (s), at which a component of a function jumps."""
    at = cache(function)
    values = np.array([at(t) for t in times.tolist()])
    least = np.maximum(SMALL * np.ptp(values, axis=0), 1e-12 * abs(values).max(0))
    least = np.maximum(least, rounding or 1e-200)

    def bend(a: float, b: float) -> float:
        return float((abs(at(a) - 2 * at((a + b) / 2) + at(b)) / least).max())

    between = [*pairwise(times.tolist()), *((t - width, t + width) for t in kinks)]
    within = [where_it_stays(bend, a, b, width) for a, b in between]
    return [(pair[0] + pair[1]) / 2 for pair in within if pair is not None]


def at_jumps(system: System, history: History) -> Floats:
    """One for each recorded state within a step of a jump, zero for all others (N,).

    The forces of the start and the end follow from the two steps after and before them, that of a
    given momentum from those after the next state.
    """
    reach = np.full(len(history), _step(history) * (1 + SHORT[0]))
    reach[:1] *= 3 if history["fresh"][0] else 2
    reach[-1:] *= 2
    apart = abs(history.times[:, None] - jumps(system, history))
    return (apart <= reach[:, None]).any(1).astype(float)


def _step(history: History) -> float:
    """Longest step (s)."""
    if "step_size" in history and np.isfinite(history["step_size"]).any():
        return float(np.nanmax(history["step_size"]))
    return float(history.meta["step"])
