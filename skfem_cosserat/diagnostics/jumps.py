"""Jumps of loads and prescribed motions of a run: constraint forces beside them mix both sides."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ..history import History
from ..model import System
from ..model.limits import STAYS
from ..time_function import Constant
from ..types import Floats

#: instants at which functions are looked at, and how many changes without a jump are looked into
LOOKS, MANY = 400, 20
#: part of a function's range, and of its size, that is no jump
SMALL, NOISE = 1e-2, 1e-5
#: of the size of what moves, in differences of it
ROUNDING = 1e-14
#: steps that differences of first and of second order in time take
SHORT = 1e-3, 2e-2


def jumps(system: System, history: History) -> Floats:
    """Times (s) at which a load, or velocity or acceleration of prescribed motion, jumps in a run.

    Loads are all functions of time that drive the scene: those of actuators, and the amplitudes of
    loads that are functions of the motion. The changes between up to 400 instants of the run that
    differ most from the changes beside them are halved down to a small part of a step: a jump stays
    as it is. A jump of a load that does not stick out like this is found if it is declared, see
    :class:`skfem_cosserat.FunctionOfTime`. Jumps below a hundredth of a function's range are none.
    What jumps within the function of a :class:`skfem_cosserat.TermFunction` is not seen.

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
    h, start = _step(history), history.times[0]
    end = history.times[-1]
    times = np.linspace(start, end, min(LOOKS, 1 + max(1, int((end - start) / h))))
    found = []
    narrow = SHORT[0] * h
    for loads in (system.loading, system.couplings):
        if all(isinstance(time, Constant) for time in loads.times):
            continue
        kinks = np.concatenate([getattr(time, "kinks", ()) for time in loads.times])
        kinks = kinks[(kinks > start) & (kinks < end)]
        found += _found(loads.values, times, narrow, np.unique(kinks).tolist())
    if system.moving:
        for order, short in enumerate(SHORT, 1):

            def rate(s: float, order: int = order, d: float = short * h) -> Floats:
                rows = [system.ground(s - k * d).ravel() for k in range(order + 1)]
                return np.diff(rows[::-1], order, axis=0)[0] / d**order

            rounding = ROUNDING * abs(system.ground(end)).max() / (short * h) ** order
            later = np.maximum(times, start + 3 * short * h)
            found += _found(rate, later, 10 * short * h, rounding=rounding)
    instants = np.unique(found)
    return instants[np.diff(instants, prepend=-np.inf) > 2 * narrow]  # several may find the same


def at_jumps(system: System, history: History) -> Floats:
    """One for each recorded state within a step of a jump, zero for all others (N,).

    The forces of the start and the end follow from the two steps after and before them, that of a
    given momentum from those after the next state.
    """
    reach = np.full(len(history), _step(history) * (1 + SHORT[0]))
    reach[:1] *= 3 if history["fresh"][0] else 2
    reach[-1:] *= 2
    apart = abs(history.times[:, None] - jumps(system, history))
    return (apart <= reach[:, None]).any(axis=1).astype(float)


def _step(history: History) -> float:
    """Longest step (s)."""
    if "step_size" in history and np.isfinite(history["step_size"]).any():
        return float(np.nanmax(history["step_size"]))
    return float(history.meta["step"])


def _found(
    function: Callable[[float], Floats],
    times: Floats,
    width: float,
    kinks: Sequence[float] = (),
    rounding: float = 1e-200,
) -> list[float]:
    """Times, to a width (s), at which a component of a function (k,) jumps."""
    values = np.array([function(t) for t in times.tolist()])
    least = np.maximum(SMALL * np.ptp(values, axis=0), NOISE * abs(values).max(axis=0))
    least = np.maximum(least, rounding)

    def jump(a: float, b: float, u: Floats, w: Floats, beside: Floats) -> float | None:
        """When one component jumps between values u and w, by the changes before and after."""
        usual = beside.mean(axis=0)
        c = int((abs(w - u - usual) / least).argmax())
        start, end, change, bend = u[c], w[c], usual[c], abs(np.diff(beside[:, c])[0]) / 2
        whole = left = abs(end - start - change)
        while b - a > width and left > STAYS * whole:
            middle, change, bend = (a + b) / 2, change / 2, bend / 2
            x = function(middle)[c]
            if abs(x - start - change) >= abs(end - x - change):
                b, end = middle, x
            else:
                a, start = middle, x
            left = abs(end - start - change)
        return (a + b) / 2 if whole > least[c] and left > STAYS * whole + bend else None

    none = np.zeros((2, len(least)))
    declared = [(kink - width, kink + width) for kink in kinks]
    at = [jump(a, b, function(a), function(b), none) for a, b in declared]
    changes = np.diff(values, axis=0)
    beside = np.pad(changes, ((1, 1), (0, 0)), "reflect" if len(changes) > 1 else "constant")
    share = (abs(changes - (beside[:-2] + beside[2:]) / 2) / least).max(axis=1)
    misses = 0
    for k in np.argsort(-share):
        if share[k] <= 1 or misses == MANY:
            break
        a, b = times[k : k + 2].tolist()
        at.append(jump(a, b, values[k], values[k + 1], beside[[k, k + 2]]))
        misses += at[-1] is None
    return [each for each in at if each is not None]
