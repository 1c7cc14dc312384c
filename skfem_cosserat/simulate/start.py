"""Where a run starts: from the items, from given states, from the end of a history."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from .. import diagnostics
from ..diagnostics import Projection
from ..errors import HistoryError, InputError
from ..history import History
from ..integrators import Integrator, State
from ..log import logger
from ..model import System
from ..types import ArrayLike, Floats, numbers
from .control import StepControl
from .describe import other_model, recorded_turns
from .rates import with_joint_rates

__all__ = ["initial_state", "project", "restart"]

#: relative violation of constraints that a state may have which was put together, and one that
#: steps led to: with loose settings they leave more
GIVEN, SOLVED = 1e-6, 1e-3
ALONG = (
    "Constraints take what is along them in the first step; steps of a run lead on from their state"
    " without this warning, and so does restart()"
)


def project(
    system: System,
    q: ArrayLike,
    v: ArrayLike | None = None,
    t: float = 0.0,
    rates: Mapping[str, float] | None = None,
) -> Floats:
    """Velocity nearest to v (in the kinetic energy) that fulfils the hidden constraints.

    It is the v of the saddle point with ``p = M v``, see
    :class:`~skfem_cosserat.Projection` and equations (39), (46).

    Parameters
    ----------
    q : (n,) array
        Configuration (m, -).
    v : (n,) array, optional
        Velocity (m/s, 1/s); default: rest.
    t : float
        Time (s), at which a prescribed motion is taken.
    rates : dict of str to float, optional
        Rates (rad/s, m/s) that joint coordinates are to have: by the joint's name, or
        ``"joint/coordinate"`` if it has several.

    Returns
    -------
    (n,) array
        Velocity with ``G(q) v + g_t = 0``, for :func:`initial_state`.

    Raises
    ------
    InputError
        If the mechanism cannot move with these rates, or there is no such joint or coordinate.

    Examples
    --------
    >>> from skfem_cosserat import JointDistance, MassPoint, Model, ground
    >>> model = Model()
    >>> bob = model.add("bob", MassPoint(2.0, position=(0, 0, -1)))
    >>> rod = model.add("rod", JointDistance(ground((0, 0, 0)), bob.place()))
    >>> system = model.freeze()
    >>> project(system, system.q0, [1.0, 0, 3.0]).tolist()   # not along the rod
    [1.0, 0.0, 0.0]
    """
    velocity = np.zeros(system.n) if v is None else _checked(system, "v", v, "projection")
    configuration = _checked(system, "q", q, "projection")
    return with_joint_rates(system, configuration, velocity, rates or {}, t)


def initial_state(
    system: System,
    q: ArrayLike | None = None,
    v: ArrayLike | None = None,
    p: ArrayLike | None = None,
    time: float = 0.0,
    tolerance: float = 1e-8,
    *,
    nu: ArrayLike | None = None,
    rates: Mapping[str, float] | None = None,
) -> State:
    """Start from (q, v), (q, p) or (q, nu); default: reference and the items' initial velocities.

    Parameters
    ----------
    q, v, p : (n,) array, optional
        Configuration (m, -), and velocity (m/s, 1/s) *or* momentum (kg m/s, kg m^2/s).
    time : float
        Start (s).
    tolerance : float
        Largest relative violation of the constraints and the hidden constraints. (Runs start from
        states with no more than 1e-6.)
    nu : (unknowns,) array, optional
        Reduced velocity instead of v or p: ``v = P(q) nu + qdot_prescribed`` with the null space
        matrix ``system.null_space(q, time)`` (m/s of translations, rad/s of rotations), see
        :func:`~skfem_cosserat.diagnostics.prescribed_velocity`.
    rates : dict of str to float, optional
        Rates of joint coordinates (rad/s, m/s) instead of v, p or nu; the rest of the scene moves
        as little as the joints allow, see :func:`project`.

    Raises
    ------
    InputError
        If q violates the constraints, or v or p the hidden ones ``G v + g_t = 0``;
        :func:`project` gives the nearest velocity that does not. If more than one of v, p, nu and
        rates is given, or the mechanism cannot move with the rates.

    Examples
    --------
    >>> from skfem_cosserat import Model, MassPoint
    >>> model = Model()
    >>> ball = model.add("ball", MassPoint(2.0, velocity=(1.0, 0, 0)))
    >>> initial_state(model.freeze()).p.tolist()
    [2.0, 0.0, 0.0]
    >>> initial_state(model.freeze(), nu=[0, 3.0, 0]).p.tolist()
    [0.0, 6.0, 0.0]
    """
    if sum(value is not None for value in (v, p, nu, rates)) > 1:
        raise InputError("initial state", "give v or p or nu or rates, only one of them")
    q = system.q0 if q is None else _checked(system, "q", q)
    if isinstance(time, str) or not np.isfinite(time):
        raise InputError("initial state", f"time = {time!r}, expected a finite number")
    y = system.extend(q, time)
    wrong = broken_constraint(system, y, tolerance)
    if wrong:
        raise InputError("initial state", f"q at t = {time:g} s {wrong}")
    if system.plane is not None:
        system.plane.check("initial state", "q", q, system.q0)
    if p is not None:
        p = _checked(system, "p", p)
        wrong = broken_momentum(system, q, p, time, tolerance)
        if wrong:
            raise InputError("initial state", f"p {wrong}")
        if system.plane is not None:
            system.plane.check("initial state", "p", p)
        return State(time, 0, q, p)
    if nu is not None:
        v = _velocity(system, q, nu, time)
    if rates is not None:
        v = project(system, q, None, time, rates)
    v = system.v0 if v is None else _checked(system, "v", v)
    _check_velocity(system, y, v, time, tolerance)
    if system.plane is not None:
        system.plane.check("initial state", "the velocity", v)
    return State(time, 0, q, diagnostics.momentum(system, v))


def _velocity(system: System, q: Floats, nu: ArrayLike, time: float) -> Floats:
    """``P nu + qdot_prescribed``."""
    rates = numbers("initial state", "nu", nu)
    if rates.shape != (system.unknowns,) or not np.isfinite(rates).all():
        raise InputError(
            "initial state",
            f"nu = {nu!r} with shape {rates.shape}, expected ({system.unknowns},) finite numbers",
        )
    start = diagnostics.prescribed_velocity(system, q, time)
    return np.asarray(system.null_space(q, time) @ rates + start)


def _check_velocity(system: System, y: Floats, v: Floats, time: float, tolerance: float) -> None:
    """``G v + g_t = 0``, each row compared with the size of its terms."""
    hidden = abs(system.constraints.rate(y, v) + diagnostics.ground_part(system, y, time))
    rate, error = system.ground_rate_and_error(time)
    rates = np.concatenate([v.reshape(-1, 3), rate])
    # the rate of a prescribed motion is known to a difference quotient's error only
    floor = 4 * error + (1e-11 * system.length if system.moving else 0.0)
    # what is held at rest in a moving scene has rates of rounding size only
    largest = np.full_like(rates, abs(rates).max(initial=0.0))
    rounding = 1e-13 * system.constraints.magnitudes(y, largest)
    excess = hidden - tolerance * system.constraints.magnitudes(y, rates) - floor - rounding
    if excess.max(initial=0.0) > 0:
        row = int(excess.argmax())
        raise InputError(
            "initial state",
            f"the velocity violates the hidden constraint of {constraint_owner(system, row)} at"
            f" t = {time:g} s by {hidden[row]:.6g} (initial velocity against joints or prescribed"
            " motion): use project(system, q, v)",
        )


def broken_constraint(system: System, y: Floats, tolerance: float) -> str | None:
    """Which constraint does not hold at y, and by how much; relative to its terms."""
    g = abs(system.constraints.values(y))
    # a point held at the origin may be off by rounding, with no terms to compare that with
    excess = g - tolerance * (system.constraints.magnitudes(y) + 1e-7 * system.length)
    if not excess.max(initial=0.0) > 0:
        return None
    row = int(excess.argmax())
    return f"violates the constraint of the {constraint_owner(system, row)} by {g[row]:.6g}"


def broken_momentum(
    system: System, q: Floats, p: Floats, time: float, tolerance: float
) -> str | None:
    """How far p is off the hidden constraints, and what to do; None: not by more than relative."""
    miss = abs(Projection(system)(q, p, time)[1] - p)
    allowed = max(tolerance * float(abs(p).max(initial=0.0)), 1e-13)
    if system.moving:  # as far as rates of the ground are known
        rate = 4 * system.ground_rate_and_error(time)[1] + 1e-11 * system.length
        allowed += rate * float(abs(system.mass).sum(axis=1).max())
    if not miss.max(initial=0.0) > allowed:
        return None
    row = int(miss.argmax())
    owner = system.owner[int(np.searchsorted(system.origin_rows, row // 3, "right")) - 1]
    return (
        f"violates the hidden constraints by {miss[row]:.3g} kg m/s at {owner.label}, as velocities"
        " against joints or prescribed motion do: project it with Projection(system)(q, p, t)[1]"
    )


def checked_start(system: System, start: State, item: str = "argument start") -> State:
    """A state whose arrays belong to the system."""
    if not isinstance(start, State):
        raise InputError(item, f"{start!r}, expected a State, see initial_state")
    for name, array in (("q", start.q), ("p", start.p)):
        _checked(system, name, array, item)
    if system.plane is not None:
        system.plane.check(item, "its configuration", start.q, system.q0)
        system.plane.check(item, "its momentum", start.p)
    return start


def consistent_start(system: System, start: State, item: str = "argument start") -> State:
    """A state to step from: it belongs to the system, q and p fulfil what they have to.

    A state that steps led to has the momentum of their scheme, which may be off the hidden
    constraints, and constraints as well as it was asked to solve them. Another one whose momentum
    is off them gets a warning: what the momentum has along ``G^T`` only adds to the first
    multipliers, and momenta of the variational scheme, turned round for example, have such parts.
    """
    checked_start(system, start, item)
    made = start.maker is not None
    wrong = broken_constraint(system, system.extend(start.q, start.time), SOLVED if made else GIVEN)
    if wrong:
        raise InputError(item, f"q at t = {start.time:g} s {wrong}")
    if made or not start.fresh:
        return start
    wrong = broken_momentum(system, start.q, start.p, start.time, GIVEN)
    if wrong:
        logger.warning("%s: p at t = %g s %s. %s", item, start.time, wrong, ALONG)
    return start


def constraint_owner(system: System, row: int) -> str:
    """Which item a constraint row belongs to."""
    for jr in system.joint_rows:
        if jr.rows.start <= row < jr.rows.stop:
            return jr.joint.label
    for each in system.rung_rows:
        if each.rows.start <= row < each.rows.stop:
            return f"{each.beam.label}, {each.beam.rung!r}"
    frame = int(system.kinematics.frames[row // 6])
    return f"triad of {system.owner[frame].label}"


def _checked(system: System, name: str, value: ArrayLike, item: str = "initial state") -> Floats:
    array = numbers(item, name, value)
    if array.shape != (system.n,):
        raise InputError(item, f"{name} has shape {array.shape}, expected ({system.n},)")
    if not np.isfinite(array).all():
        raise InputError(item, f"{name} is not finite at {np.flatnonzero(~np.isfinite(array))[:5]}")
    return array


def restart(
    system: System, history: History, integrator: Integrator, step: float | StepControl
) -> State:
    """State to go on from the last one of a history.

    With the integrator and step of the history the run continues as if it had not stopped; with
    another step or integrator it starts from (q, p) of the discrete Legendre transform, projected
    on the hidden constraints. Loads may differ from those of the history: they are no part of the
    state.

    Parameters
    ----------
    system : System
        Of the same model; where events have changed it, that of the last state, which
        :func:`after_events` gives.
    history : History
        Of a run, also one that diverged or was killed; ``history.truncated(k + 1)`` goes on from
        its state k.
    integrator : Integrator
        Of the run that goes on.
    step : float or StepControl
        Its step size (s), or control.

    Returns
    -------
    State
        For the argument ``start`` of :func:`simulate` and :func:`steps`.

    Raises
    ------
    HistoryError
        If the history belongs to another model or has no state.

    Examples
    --------
    >>> from skfem_cosserat import MassPoint, Model, NullSpace, Variational, simulate
    >>> model = Model()
    >>> ball = model.add("ball", MassPoint(2.0, velocity=(1.0, 0, 0)))
    >>> system, scheme = model.freeze(), Variational()
    >>> first = simulate(system, scheme, NullSpace(), 0.1, until=0.5)
    >>> start = restart(system, first, scheme, 0.05)   # goes on with half the step
    >>> simulate(system, scheme, NullSpace(), 0.05, until=1.0, start=start).times[[0, -1]].tolist()
    [0.5, 1.0]
    """
    if len(history) == 0:
        raise HistoryError("history", "has no state to go on from")
    last = max(k for k, (first, _) in enumerate(history.segments) if first < len(history))
    difference = other_model(system, history.segment(last).meta.get("fingerprint", {}))
    if difference:
        raise HistoryError("history", f"belongs to another model: {difference}")
    row = history.last()
    y = system.extend(np.array(row["q"]), float(row.get("load_factor", row["t"])))
    wrong = broken_constraint(system, y, 1e-6)
    if wrong:
        raise HistoryError("history", f"belongs to another model: its last state {wrong}")
    # the end of a path of static(): loads and motions go on from its load factor
    t, index = float(row.get("load_factor", row["t"])), int(row["step"])
    q = np.array(row["q"])
    same = history.meta["integrator"] == integrator.name
    size = float(row["step_size"]) if "step_size" in row else float(history.meta["step"])
    if not isinstance(step, StepControl):
        same = same and np.isclose(history.meta["step"], step, rtol=1e-12, atol=0)
    turns = recorded_turns(system, history)
    if same:
        memory = np.array(row["memory"]) if "memory" in row else None
        if memory is not None and np.isnan(memory).any():
            memory = None
        fresh, maker = bool(row["fresh"]), None if np.isnan(size) else (integrator.name, size)
        return State(t, index, q, np.array(row["carried"]), fresh, turns, memory, maker)
    p = np.array(row["p"])
    if not np.isfinite(p).all():
        p = np.array(row["carried"])
    return State(t, index, q, Projection(system)(q, p, t)[1], turns=turns)
