"""What enters a run, compared with its steps: they do not see all that happens between their ends.

Prescribed motion acts at the ends of steps, and so do loads of some schemes. Others take the exact
mean of a load over a step: a short pulse is whole, but what vibrates cancels.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from ..errors import InputError
from ..frames import Place
from ..history import History
from ..model import System
from ..time_function import Constant
from ..types import Floats, spread

#: pieces of a step, steps that are looked at most, and the fewest that tell how far a function goes
PIECES, LOOKS, FEW = 8, 1000, 6
#: part of what a function does that steps may miss, and the part of its size that is rounding
MISSED, ROUNDING = 0.1, 1e-9
#: steps of a period that resolve it
RESOLVED = 20


class Unseen(NamedTuple):
    """A load, drive or motion of the ground that steps do not see.

    Attributes
    ----------
    item : str
        Label of what it belongs to.
    share : float
        Part of its changes that steps miss, from 0 to 1.
    cancels : bool
        Whether it cancels in means over steps; else it is missed between their ends.
    step : float
        A step that resolves it (s).

    Examples
    --------
    >>> Unseen("drive 'motor'", 0.5, False, 1e-3).step
    0.001
    """

    item: str
    share: float
    cancels: bool
    step: float


def unseen(system: System, history: History, at_ends: bool) -> Unseen | None:
    """What steps of a run miss most of; None if they see what enters it.

    Up to a thousand steps are looked at, and those in which a function has a declared kink.

    Parameters
    ----------
    system : System
    history : History
        With six steps or more, recorded or not.
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
    if len(ends) <= FEW:
        return None
    try:
        found = [_looked(each, ends) for each in _entering(system, at_ends)]
    except InputError:  # a function of the user's that is not known at all times
        return None
    return max((f for f in found if f.share > MISSED), key=lambda f: f.share, default=None)


class _Entering(NamedTuple):
    """A function of time (k,) that enters a run, and whether its means over steps count."""

    item: str
    function: Callable[[float], Floats]
    kinks: Sequence[float]
    mean: bool


def _entering(system: System, at_ends: bool) -> Iterator[_Entering]:
    for loads in (system.loading, system.couplings):
        for time, owner in zip(loads.times, loads.owners, strict=True):
            if not isinstance(time, Constant):
                kinks = getattr(time, "times", getattr(time, "kinks", ()))
                yield _Entering(owner.label, lambda t, f=time.value: [f(t)], kinks, not at_ends)
    for drive in system.drives:
        turns = drive.coordinate.kind == "angle"
        part = slice(0, 2) if turns else slice(2, 3)  # of cosine, sine and number
        yield _Entering(drive.label, _rows(drive.place, 0, part), (), False)
    number = {id(drive.place) for drive in system.drives}
    moving = {id(p.motion): p for p in system.moving if id(p) not in number}
    for place in moving.values():
        for rows in (0, slice(1, 4)):  # where it is, and its axes
            yield _Entering(place.label, _rows(place, rows), (), False)


def _rows(place: Place, rows: int | slice, part: slice = slice(3)) -> Callable[[float], Floats]:
    """A part of the rows of a place in prescribed motion."""
    motion = place.motion
    assert motion is not None
    return lambda t: motion.frame(place, t)[rows, part].ravel()


def _looked(entering: _Entering, ends: Floats) -> Unseen:
    """What steps between these instants miss of a function."""
    kinks = np.asarray(entering.kinks, dtype=float)
    kinks = kinks[(ends[0] < kinks) & (kinks < ends[-1])]
    steps = spread(len(ends) - 1, LOOKS)
    steps = np.union1d(steps, np.searchsorted(ends, kinks, side="right") - 1)
    inner = ends[steps, None] + np.diff(ends)[steps, None] * np.arange(PIECES) / PIECES
    grid = np.unique(np.concatenate([inner.ravel(), ends[steps + 1], kinks]))
    # pieces within a step that is looked at: the function at both ends and in the middle
    own = np.searchsorted(ends, (grid[1:] + grid[:-1]) / 2) - 1
    piece = np.flatnonzero(np.isin(own, steps))
    own, a, b = own[piece], grid[piece], grid[piece + 1]
    t = np.stack([a, (a + b) / 2, b], axis=1)
    instants, at = np.unique(t, return_inverse=True)
    values = np.array([entering.function(s) for s in instants.tolist()])
    f = values
    if not entering.mean:  # what is constant, or moves evenly, moves nothing
        line = np.stack([np.ones_like(instants), instants - instants.mean()], axis=1)
        f = values - line @ np.linalg.lstsq(line, values, rcond=None)[0]
    weights = (b - a)[:, None] * (0.25, 0.5, 0.25)
    first, last = (f[np.searchsorted(instants, ends[own + k]), None] for k in (0, 1))
    f = f[at.reshape(t.shape)]  # (pieces, 3, k)
    whole = float((weights * np.linalg.norm(f, axis=-1)).sum())
    if whole <= ROUNDING * abs(values).max() * weights.sum():
        return Unseen(entering.item, 0.0, entering.mean, np.inf)
    if entering.mean:
        sums = np.zeros((len(ends), f.shape[-1]))
        np.add.at(sums, own, (weights[..., None] * f).sum(1))
        missed = whole - float(np.linalg.norm(sums, axis=1).sum())
    else:
        s = ((t - ends[own, None]) / (ends[own + 1] - ends[own])[:, None])[..., None]
        chord = (1 - s) * first + s * last
        missed = float((weights * np.linalg.norm(f - chord, axis=-1)).sum())
    changes = float(np.linalg.norm(np.diff(f, axis=1), axis=-1).sum())
    period = 2 * np.pi * whole / changes  # that of a sine with the same mean size and slope
    step = min(period / RESOLVED, float(np.diff(ends).max()) / 2)
    return Unseen(entering.item, missed / whole, entering.mean, step)
