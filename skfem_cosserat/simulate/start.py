"""Where a run starts: from the items, from given states, from the end of a history."""

from __future__ import annotations

import numpy as np

from .. import diagnostics
from ..diagnostics import Projection
from ..errors import HistoryError, InputError
from ..history import History
from ..integrators import Integrator, State
from ..model import System
from ..types import ArrayLike, Floats, numbers
from .describe import fingerprint

__all__ = ["initial_state", "project", "restart"]


def project(system: System, q: ArrayLike, v: ArrayLike, t: float = 0.0) -> Floats:
    """Velocity (n,) nearest to v (in the kinetic energy) that fulfils the hidden constraints."""
    v = np.asarray(v, dtype=float)
    p = (system.mass @ v.reshape(-1, 3)).reshape(-1)
    return Projection(system)(q, p, t)[0]


def initial_state(
    system: System,
    q: ArrayLike | None = None,
    v: ArrayLike | None = None,
    p: ArrayLike | None = None,
    time: float = 0.0,
    tolerance: float = 1e-8,
) -> State:
    """Start from (q, v) or (q, p); default: the reference and the items' initial velocities.

    Parameters
    ----------
    q, v, p : (n,) array, optional
        Configuration, and velocity *or* momentum.
    time : float
        Start (s).
    tolerance : float
        Largest relative violation of the constraints and the hidden constraints.

    Raises
    ------
    InputError
        If q violates the constraints, or v or p the hidden ones ``G v + g_t = 0``;
        :func:`project` gives the nearest velocity that does not.

    Examples
    --------
    >>> from skfem_cosserat import Model, MassPoint
    >>> model = Model()
    >>> ball = model.add("ball", MassPoint(2.0, velocity=(1.0, 0, 0)))
    >>> initial_state(model.freeze()).p.tolist()
    [2.0, 0.0, 0.0]
    """
    if v is not None and p is not None:
        raise InputError("initial state", "give v or p, not both")
    q = system.q0 if q is None else _checked(system, "q", q)
    if not np.isfinite(time):
        raise InputError("initial state", f"time = {time!r} is not finite")
    y = system.extend(q, time)
    g = abs(system.constraints.values(y))
    if g.max(initial=0.0) > tolerance * max(1.0, system.length**2):
        raise InputError(
            "initial state",
            f"q violates the constraints at t = {time:g} s by {g.max():.3g}"
            f" ({constraint_owner(system, int(g.argmax()))})",
        )
    if p is not None:
        p = _checked(system, "p", p)
        miss = float(abs(Projection(system)(q, p, time)[1] - p).max())
        if miss > tolerance * max(float(abs(p).max()), 1e-300) and miss > 1e-13:
            raise InputError(
                "initial state",
                f"p violates the hidden constraints by {miss:.3g} kg m/s: project it with"
                " Projection(system)(q, p)",
            )
        return State(time, 0, q, p)
    v = system.v0 if v is None else _checked(system, "v", v)
    hidden = abs(system.constraints.jacobian(y) @ v + diagnostics.ground_part(system, y, time))
    worst = float(hidden.max(initial=0.0))
    if worst > tolerance * max(1.0, float(abs(v).max())):
        raise InputError(
            "initial state",
            f"the velocity violates the hidden constraint of"
            f" {constraint_owner(system, int(hidden.argmax()))} at t = {time:g} s by {worst:.6g}"
            " (initial velocity against joints or prescribed motion): use project(system, q, v)",
        )
    return State(time, 0, q, (system.mass @ v.reshape(-1, 3)).reshape(-1))


def checked_start(system: System, start: State) -> State:
    """A state whose arrays belong to the system."""
    if not isinstance(start, State):
        raise InputError("argument start", f"{start!r}, expected a State, see initial_state")
    for name, array in (("q", start.q), ("p", start.p)):
        _checked(system, name, array, "argument start")
    return start


def constraint_owner(system: System, row: int) -> str:
    """Which item a constraint row belongs to."""
    for jr in system.joint_rows:
        if jr.rows.start <= row < jr.rows.stop:
            return jr.joint.label
    frame = int(system.kinematics.frames[row // 6])
    return f"triad of {system.owner[frame].label}"


def _checked(system: System, name: str, value: ArrayLike, item: str = "initial state") -> Floats:
    array = numbers(item, name, value)
    if array.shape != (system.n,):
        raise InputError(item, f"{name} has shape {array.shape}, expected ({system.n},)")
    if not np.isfinite(array).all():
        raise InputError(item, f"{name} is not finite at {np.flatnonzero(~np.isfinite(array))[:5]}")
    return array


def restart(system: System, history: History, integrator: Integrator, step: float) -> State:
    """State to go on from the last one of a history.

    With the integrator and step of the history the run continues as if it had not stopped; with
    another step or integrator it starts from (q, p) of the discrete Legendre transform, projected
    on the hidden constraints.

    Raises
    ------
    HistoryError
        If the history belongs to another model.
    """
    if history.meta.get("fingerprint") != fingerprint(system):
        raise HistoryError(
            "history",
            f"belongs to another model: {history.meta.get('fingerprint')} instead of"
            f" {fingerprint(system)}",
        )
    if len(history) == 0:
        raise HistoryError("history", "has no state to go on from")
    row = history.last()
    t, index = float(row["t"]), int(row["step"])
    q = np.array(row["q"])
    same = history.meta["integrator"] == integrator.name and history.meta["step"] == step
    if same:
        return State(t, index, q, np.array(row["carried"]), fresh=bool(row["fresh"]))
    p = np.array(row["p"])
    if not np.isfinite(p).all():
        p = np.array(row["carried"])
    return State(t, index, q, Projection(system)(q, p, t)[1])
