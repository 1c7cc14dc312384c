"""The state about which a scene vibrates: what a user may give for it, and that it is at rest."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeAlias

import numpy as np
from scipy.sparse.linalg import splu

from ..analysis.describe import recorded_turns
from ..analysis.start import checked_start
from ..checks.result import recorded_amplitudes
from ..diagnostics.stacked import ReducedTangent, reduced_tangent
from ..errors import AccuracyWarning, IncompatibleError, InputError
from ..history import History
from ..integrators import State
from ..model import Model, System, system_of
from ..model.balance import Amplitudes, Spin, amplitudes_at, balance, predicted
from ..model.closure import SINGULAR
from ..model.fingerprint import other_model
from ..model.limits import broken_constraint, overstretched_beam, owner
from ..model.loops import names_of
from ..statics.problem import Schedule
from ..types import Array, ArrayLike, Floats, check_kind, finite, largest, shaped, whole
from ..warn import warn

#: what may be given as a state
StateLike: TypeAlias = ArrayLike | State | History | tuple[History, int]

#: rounding of strains of order one, against which forces count as zero
ROUNDING = 1e-13


@dataclass(eq=False)
class Equilibrium:
    """A state of rest, seen from space or from a turning frame.

    Attributes
    ----------
    system : System
    y : (total, 3) array
    t : float
        Time, or load factor of a path: where prescribed motion stands.
    amplitudes : Amplitudes
    tangent : ReducedTangent
    error : float
        Largest entry of ``P^T R`` against the square root of the metric's diagonal: what is
        missing in the balance, as a moment (N m).
    drawn : bool
        Whether a beam is drawn more than its elements can tell, of which there was a warning.
    load_factor : float or None
        Of a state of a path.
    """

    system: System
    y: Floats
    t: float
    amplitudes: Amplitudes
    tangent: ReducedTangent
    error: float
    drawn: bool
    load_factor: float | None = None

    @cached_property
    def moduli(self) -> list[Array]:
        """Derivatives of stresses by strains with weights (ne, ng, 6, 6), of each beam group."""
        groups = zip(self.system.beam_groups, self.tangent.balance.strains, strict=True)
        return [g.moduli(eps) for g, eps in groups]


def as_system(model: Model | System) -> System:
    """The frozen scene.

    Raises
    ------
    InputError
        If it is neither a model nor a system, or nothing can move.
    """
    system = system_of(model, "argument model")
    if not system.unknowns:
        raise InputError("model", "nothing can move: 0 unknowns, there are no modes")
    return system


def resting(
    system: System,
    state: StateLike | None,
    t: float | None,
    amplitudes: Amplitudes | None,
    spin: Spin | None,
    tolerance: float,
) -> Equilibrium:
    """Read a state and check that it is one of rest.

    Raises
    ------
    InputError
        If the state does not fit the system, violates its constraints, or is no equilibrium.
    IncompatibleError
        For a spin with drag against space.
    """
    start, found = _read(system, state, t)
    q = checked_start(system, start, "argument state").q
    if amplitudes is None:
        amplitudes = found
    check_amplitudes(system, amplitudes)
    if spin is not None:
        check_kind("argument spin", spin, Spin)
        amplitudes = replace(amplitudes, spin=spin)
    if system.plane is not None and amplitudes.spin is not None:
        system.plane.check_spin(amplitudes.spin.velocity)
    if amplitudes.spin is not None and system.drag is not None:
        raise IncompatibleError(
            "argument spin",
            "damping in proportion to mass is a drag against space: nothing turns steadily in it",
        )
    y = system.extend(np.asarray(q, float), start.time)
    if wrong := broken_constraint(system, y):
        raise InputError("argument state", wrong)
    for chosen in system.closure.select(y, system.kinematics.values_at(y)):
        if (chosen.pivots <= SINGULAR).any():
            raise InputError(
                "argument state",
                "is a singular position of the closed loop through the"
                f" {names_of(system, chosen.rows)}: it may go on in several ways, its motion is"
                " not linear",
            )
    at = balance(system, y, amplitudes, turns=start.turns)
    tangent = reduced_tangent(system, y, amplitudes, at)
    tangent, error = _at_rest(system, tangent, amplitudes, tolerance)
    if drawn := overstretched_beam(system, y, tangent.multipliers, amplitudes.loads):
        warn(*drawn, AccuracyWarning, start.time)
    state_of_rest = system, y, start.time, amplitudes, tangent, error, bool(drawn)
    return Equilibrium(*state_of_rest, start.load_factor)


def _read(system: System, state: StateLike | None, t: float | None) -> tuple[State, Amplitudes]:
    """The state at its time, and its loads."""
    time = 0.0 if t is None else finite("argument t", "t", t)
    if isinstance(state, History):
        state = (state, -1)
    if isinstance(state, tuple) and len(state) == 2 and isinstance(state[0], History):
        return _from_history(system, state[0], state[1], t)
    if isinstance(state, State):
        state = state if t is None else replace(state, time=time)
        return state, amplitudes_at(system, state.time)
    alone = state is None and t is None
    q = system.q0 if state is None else state
    loads = _unloaded(system) if alone else amplitudes_at(system, time)
    return State(time, 0, np.asarray(q), np.zeros(system.n)), loads


def _from_history(
    system: System, history: History, index: int, t: float | None
) -> tuple[State, Amplitudes]:
    difference = other_model(system, history.meta.get("fingerprint", {}))
    if difference is not None:
        raise InputError("argument state", f"the history is of another model: {difference}")
    index = whole("argument state", index, None, "index of the history")
    row = history.row(index)
    turns = recorded_turns(system, history, index)
    time = float(history.instants[index]) if t is None else t
    path = "load_factor" in row
    if path and t is None:
        loads = recorded_amplitudes(history, index)
    else:
        loads = Schedule(system).at(time) if path else amplitudes_at(system, time)
    factor = (float(row["load_factor"]) if t is None else t) if path else None
    return State(time, 0, row["q"], np.zeros(system.n), turns=turns, load_factor=factor), loads


def _unloaded(system: System) -> Amplitudes:
    return Amplitudes(
        np.zeros(len(system.loading.times)), np.zeros(len(system.couplings.times) + 1)
    )


def check_amplitudes(system: System, amplitudes: Amplitudes) -> None:
    """Amplitudes fit the system and are finite.

    Raises
    ------
    InputError
        If not.
    """
    item = "argument amplitudes"
    wanted = _unloaded(system)
    check_kind(item, amplitudes, Amplitudes, " of all loads")
    shaped(item, "loads", amplitudes.loads, wanted.loads.shape)
    shaped(item, "actuators", amplitudes.actuators, wanted.actuators.shape)


def _at_rest(
    system: System, tangent: ReducedTangent, amplitudes: Amplitudes, tolerance: float
) -> tuple[ReducedTangent, float]:
    """The tangent, and the largest entry of the balance, as a moment; refused if it is not small.

    Far from the origin, where coordinates are rounded, stresses are those of the exact equilibrium.
    """
    at = tangent.balance
    metric = tangent.metric.diagonal()
    root = np.sqrt(metric)
    residual = abs(tangent.residual) / root
    terms = abs(at.external) + abs(at.R + at.external)
    size = float((abs(tangent.P).T @ terms.ravel() / root).max(initial=0.0))
    floor = ROUNDING * (size + largest(tangent.K.diagonal() / metric))
    error = float(residual.max(initial=0.0))
    if error > tolerance * size + floor:
        exact = _unrounded(system, tangent, amplitudes)
        if exact is not None:
            return exact, float((abs(exact.residual) / root).max())
        raise InputError(
            "argument state",
            f"is not in equilibrium: {_where(system, tangent)}; relative to all forces"
            f" {error / size:.1e}, expected at most {tolerance:g}. Find the equilibrium first, by"
            " static(...), and give the loads under which it is one",
        )
    return tangent, error


def _unrounded(
    system: System, tangent: ReducedTangent, amplitudes: Amplitudes
) -> ReducedTangent | None:
    """At the equilibrium nearby, if it is as near as coordinates are rounded; else None."""
    at = tangent.balance
    origins = system.origin_rows
    try:
        change = -(tangent.P @ splu(tangent.K.tocsc()).solve(tangent.residual)).reshape(-1, 3)
    except RuntimeError:  # singular
        return None
    size = abs(change) * system.length
    size[origins] /= system.length
    if not size.max() <= ROUNDING * abs(at.y[origins]).max():
        return None
    stresses = predicted(system, at, change)
    more = [new - old for new, old in zip(stresses, at.stresses, strict=True)]
    exact = replace(at, R=at.R + system.internal_force(at.Bs, more), stresses=stresses)
    return reduced_tangent(system, at.y, amplitudes, exact)


def _where(system: System, tangent: ReducedTangent) -> str:
    """The largest force that nothing balances."""
    G = system.constraints.jacobian(tangent.balance.y)
    left = tangent.balance.R + (G.T @ tangent.multipliers).reshape(-1, 3)
    size = np.linalg.norm(left, axis=1)
    size[system.origin_rows] *= system.length
    row = int(np.argmax(size))
    unit = "N" if row in system.origin_rows else "N m"
    return f"{np.linalg.norm(left[row]):.3g} {unit} are left over on the {owner(system, row).label}"
