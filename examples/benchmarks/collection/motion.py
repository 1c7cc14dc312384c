"""Motions at given instants: with one step as it is, or extrapolated from a ladder of steps.

Both integrators are symmetric, so that the error of a value at an instant is a series in even
powers of the step, one for even and one for odd numbers of steps (as with Gragg's midpoint rule):
the ladder takes even numbers up to each instant. Without a step of the caller, a family's coarsest
one is divided by 1, 2, 3, 4, 6, 8 ...; Aitken's and Neville's scheme extrapolates to step zero (as
Bulirsch & Stoer do), instant by instant, and the larger of the distances to the best of the run
before and to the last column but one estimates the error. The ladder ends when all estimates are
below ``TOLERANCE`` (relative to the larger of a value's size and 1), when they get no better, or
after ``LEVELS`` runs: what is not reached then is in ``estimated_error``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from measuring import full_newton

import skfem_cosserat as sc
from collection import common
from collection.inputs import Method

__all__ = ["Problem", "Track", "angles", "answer", "coarsest", "table"]

Floats = common.Floats

#: the coarsest step is divided by these
DIVISORS = (1, 2, 3, 4, 6, 8, 12, 16)
LEVELS = 7
TOLERANCE = 1e-12
#: from the next run on, one that betters nothing ends the ladder: rounding
ENOUGH = 4


@dataclass(frozen=True)
class Track:
    """A run: all states, and those at the instants.

    Attributes
    ----------
    q : (N, n) array
        At all steps, to count turns by.
    ids : (k,) array
        Which of them are the instants'.
    """

    system: sc.System
    history: sc.History
    ids: Any

    @property
    def q(self) -> Floats:
        """At all steps (N, n)."""
        return np.asarray(self.history["q"])

    @cached_property
    def v(self) -> Floats:
        """Velocities (k, n) at the instants, on the hidden constraints."""
        q, p, t = (x[self.ids] for x in (self.q, self.history["p"], self.history.times))
        return np.asarray(sc.Projection(self.system).stack(q, p, t)[0])

    def frames(self, name: str) -> Floats:
        """phi, d1, d2, d3 of a body at all steps (N, 4, 3)."""
        place = self.system.frame_place(name)
        return self.q[:, place : place + 12].reshape(-1, 4, 3)

    def rates(self, name: str) -> Floats:
        """Their rates at the instants (k, 4, 3)."""
        place = self.system.frame_place(name)
        return self.v[:, place : place + 12].reshape(-1, 4, 3)


@dataclass(frozen=True)
class Problem:
    """What is to be computed.

    Attributes
    ----------
    system : System
    read : callable
        Fields of a track, name to array over the k instants.
    coarsest : float
        First step of the ladder (s).
    """

    system: sc.System
    read: Callable[[Track], dict[str, Floats]]
    coarsest: float


def coarsest(length: float, g: Any, speed: float = 0.0) -> float:
    """A tenth of the time (s) in which a length is fallen through or passed at this speed."""
    strength = float(np.linalg.norm(g))
    own = [np.sqrt(length / strength)] if strength else []
    own += [length / abs(speed)] if speed else []
    return 0.1 * float(min(own, default=1.0))


def angles(x: Floats, y: Floats) -> Floats:
    """Polar angles at all steps, continued: of up to half a turn from step to step."""
    return np.unwrap(np.arctan2(y, x))


def quaternions(frames: Floats) -> Floats:
    """(w, x, y, z) body to space at all steps (N, 4) of frames (N, 4, 3), continued in sign.

    The first has w >= 0; from step to step less than a whole turn.
    """
    from scipy.spatial.transform import Rotation

    xyzw = Rotation.from_matrix(np.swapaxes(frames[:, 1:], 1, 2)).as_quat()
    q = xyzw[:, [3, 0, 1, 2]]
    flips = np.where((q[1:] * q[:-1]).sum(1) < 0, -1.0, 1.0)
    first = -1.0 if q[0, 0] < 0 else 1.0
    return q * np.cumprod(np.concatenate([[first], flips]))[:, None]


def spin(frames: Floats, rates: Floats) -> Floats:
    """Angular velocity in the body (k, 3) of frames and their rates (k, 4, 3)."""
    d = frames[:, 1:]
    return np.einsum("kij,kj->ki", d, 0.5 * np.cross(d, rates[:, 1:]).sum(1))


def run(
    problem: Problem, method: Method, step: float, times: Sequence[float], cost: common.Cost
) -> dict[str, Floats] | None:
    """Fields at the instants with this step; None if a step could not be solved."""
    system, last = problem.system, max(times)
    until = last if last > 0 else step
    # extrapolation would magnify what kept factors leave
    options: dict[str, Any] = {"derive": False, "settings": full_newton()}
    try:
        history = sc.simulate(system, method.integrator, method.treatment, step, until, **options)
    except sc.Diverged as error:
        cost.newton_iterations += int(error.history["newton_iterations"].sum())
        return None
    cost.unknowns = int(history.meta["unknowns"])
    cost.newton_iterations += int(history["newton_iterations"].sum())
    ids = np.rint(np.array(times) / step).astype(int)
    return problem.read(Track(system, history, ids))


def answer(
    problem: Problem, method: Method, times: Sequence[float], instant: float | None = None
) -> dict[str, Any]:
    """Fields at the instants, as ``main`` gives them; `instant`: of this one alone.

    A run that cannot be solved gives NaN and ``converged`` False, no error.
    """
    if instant is not None:
        if method.times is not None and instant not in method.times:
            raise sc.InputError(
                "argument times", f"{list(method.times)}, without the case's instant {instant:g}"
            )
        times = [instant]
    elif method.times is not None:
        times = method.times
    times = [float(t) for t in times]
    with common.timed() as cost:
        if method.step is None:
            fields, step, errors = _ladder(problem, method, times, cost)
        else:
            step = common.step_for(method.step, times)
            fields, errors = run(problem, method, step, times, cost), np.full(len(times), np.nan)
        cost.converged = fields is not None
        if fields is None:
            fields = _nothing(problem, times)
    fields["estimated_error"] = errors
    rows = [
        (_text(t), {name: values[k].tolist() for name, values in fields.items()})
        for k, t in enumerate(times)
    ]
    key = None if instant is None else _text(instant)
    out = {**common.instants(rows, times, key, cost), "order": None, "elements": None, "step": step}
    if instant is not None:
        out["t"] = instant
    return out


def _text(t: float) -> str:
    return repr(float(t)).removesuffix(".0")


def _nothing(problem: Problem, times: Sequence[float]) -> dict[str, Floats]:
    """NaN for all fields."""
    state = sc.initial_state(problem.system)
    track = Track(
        problem.system,
        sc.History({}, {}, {"t": [0.0], "step": [0], "q": state.q[None], "p": state.p[None]}),
        np.zeros(len(times), dtype=int),
    )
    return {name: np.full_like(x, np.nan) for name, x in problem.read(track).items()}


def _ladder(
    problem: Problem, method: Method, times: Sequence[float], cost: common.Cost
) -> tuple[dict[str, Floats] | None, float, Floats]:
    """Extrapolated fields, the finest step, estimated errors at the instants."""
    coarsest = common.step_for(2 * problem.coarsest, times) / 2
    squares: list[float] = []
    runs: list[Floats] = []
    errors, shapes, best, step = np.full(len(times), np.inf), {}, None, coarsest
    for divisor in DIVISORS[:LEVELS]:
        fields = run(problem, method, coarsest / divisor, times, cost)
        if fields is None:
            continue  # too long a step: the finer ones do without it
        step = coarsest / divisor
        shapes = {name: x.shape for name, x in fields.items()}
        flat = np.concatenate([x.reshape(len(times), -1) for x in fields.values()], axis=1)
        squares.append(step**2)
        runs.append(flat)
        if len(runs) < 2:
            continue
        (*_, old), new = common.neville(runs, squares)[-2:]
        size = np.maximum(abs(flat).max(1), 1.0)
        miss = np.maximum(abs(new[-1] - new[-2]), abs(new[-1] - old)).max(1)
        better = miss < errors
        best = new[-1] if best is None else np.where(better[:, None], new[-1], best)
        errors = np.minimum(miss, errors)
        if (errors < TOLERANCE * size).all() or (len(runs) > ENOUGH and not better.any()):
            break
    if best is None:
        return None, step, np.full(len(times), np.nan)
    ends = np.cumsum([int(np.prod(shape[1:])) for shape in shapes.values()])[:-1]
    parts = np.split(best, ends, axis=1)
    return {n: x.reshape(s) for (n, s), x in zip(shapes.items(), parts, strict=True)}, step, errors


def table(
    family: str,
    name: str,
    result: Mapping[str, Any],
    fields: Sequence[str],
    digits: Callable[[float], float] | float = 13,
) -> list[dict[str, Any]]:
    """Rows for those instants of a result that the entry has; trusted digits, also over time."""
    values = common.entry(name)["values"]
    known = {float(t): k for k, t in enumerate(values["t"])}
    rows = []
    for place, t in enumerate(result["t"]):
        if t not in known:
            continue
        reference = {f: values[f][known[t]] for f in fields}
        size = max(abs(float(x)) for f in fields for x in np.ravel(reference[f]))
        number = digits(t) if callable(digits) else digits
        mine = {f: result[f][place] for f in fields}
        case = f"{name}, t={_text(t)}"
        rows += common.compare(case, mine, reference, max(size, 1.0) * 10.0**-number)
    return common.tabled(family, result, rows)
