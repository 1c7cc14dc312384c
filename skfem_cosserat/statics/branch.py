"""Going on from a path: along the branch at a bifurcation, or in time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ..arguments import checked
from ..checks.result import recorded_amplitudes
from ..diagnostics import Projection
from ..diagnostics.stacked import null_space_matrix
from ..errors import HistoryError, InputError
from ..history import History
from ..integrators import State
from ..model import Model, System, system_of
from ..model.balance import Amplitudes, Spin, amplitudes_at, balance
from ..model.fingerprint import other_model
from ..model.limits import broken_constraint
from ..time_function import Amplitude
from ..types import Floats, finite, largest, numbered, whole
from .control import ArcLength, Control, DisplacementControl, Point, Stage
from .critical import inspect
from .problem import Schedule

#: number of a point in the series "critical"
CODES = {"regular": 0, "limit": 1, "bifurcation": 2}
#: relative difference below which loads and supports are where a path left them
SAME = 1e-6


@dataclass(frozen=True, eq=False)
class Branch:
    """Start of a branch: the argument ``start`` of :func:`static`, with ArcLength().

    Attributes
    ----------
    point : Point
        The critical point.
    direction : (rows, 3) array
        Change of the coordinates along the branch.
    time : float or None
        The instant (s) that the path holds, see :func:`static`.
    """

    point: Point
    direction: Floats
    time: float | None = None

    def __repr__(self) -> str:
        """Without the arrays."""
        return f"Branch(t={self.point.t!r}, rows={len(self.direction)})"


@checked
def branch(
    model: Model | System,
    history: History,
    which: int = 0,
    sign: float = 1.0,
    *,
    mode: int = 0,
    factors: Mapping[str, Amplitude] | None = None,
    spin: Spin | None = None,
) -> Branch:
    """The branch at a critical point of a path.

    Parameters
    ----------
    model : Model or System
    history : History
        A path of :func:`static`.
    which : int
        Number among the path's critical points.
    sign : float
        Which way: 1 or -1.
    mode : int
        Which motion, where several lose their stiffness at once.
    factors, spin
        As for the path.

    Returns
    -------
    Branch

    Raises
    ------
    HistoryError
        If the history is no path of this model.
    InputError
        If there is no such critical point.

    Examples
    --------
    >>> from skfem_cosserat import Beam, JointFixed, LoadForce, MeshCurve, Model, Section, ground
    >>> from skfem_cosserat.statics import ArcLength, LoadControl, static
    >>> section = Section([1e6, 1e6, 1e6, 1.0, 2.0, 1.0], mass=1.0, inertia=(1.0, 1.0))
    >>> model = Model()
    >>> mesh = MeshCurve.init_line((0, 0, 0), (1, 0, 0), 4, name="rod")
    >>> rod = model.add("rod", Beam(mesh, section, order=2))
    >>> clamp = model.add("clamp", JointFixed(ground((0, 0, 0)), rod.node("rod.start")))
    >>> push = model.add("push", LoadForce(rod.node("rod.end"), (-1.0, 0, 0)))
    >>> path = static(model, control=LoadControl(until=3.0))
    >>> [(c["kind"], round(c["load_factor"], 3)) for c in path.meta["critical"]]
    [('bifurcation', 2.468)]
    >>> buckled = static(model, control=ArcLength(10), start=branch(model, path))
    >>> bool(abs(buckled["q"][-1] - path["q"][-1]).max() > 0.01)
    True
    """
    system = system_of(model, "argument model")
    _check_path(system, history)
    rows = np.flatnonzero(history["critical"] != CODES["regular"])
    numbered("argument which", which, len(rows), "critical point(s) on the path")
    if finite("argument sign", "sign", sign, "1 or -1") == 0:
        raise InputError("argument sign", f"{sign!r}, expected 1 or -1")
    whole("argument mode", mode, 0)
    point = _point(system, history, int(rows[which]))
    time = history.meta.get("time")
    stability = inspect(system, point, Schedule(system, factors, spin, time).at(point.t))
    values, modes = stability.nearest(mode + 1)
    if mode >= len(values):
        raise InputError("argument mode", f"{mode!r}: the scene has {len(values)} motion(s)")
    direction = stability.tangent.P @ modes[:, mode]
    largest = direction[abs(direction).argmax()]  # so that the sign is no accident
    return Branch(point, np.sign(sign) * np.sign(largest) * direction.reshape(-1, 3), time)


@checked
def equilibrium(
    model: Model | System, history: History, index: int = -1, time: float = 0.0
) -> State:
    """A state at rest at a point of a path, to start a run in time or another path from.

    Loads are no part of a state, nor of what makes a model the same: the model may have others
    than that of the path. In a run all act in full, whatever share the load factor gave them.
    Another path goes on from the load factor of the point.

    Parameters
    ----------
    model : Model or System
    history : History
        A path of :func:`static`.
    index : int
        Number of the point.
    time : float
        When the state is (s): a run goes on from there. What the path moved by its own function of
        time has to be at this instant where the path left it, as it is at the point's load factor,
        or at the instant that the path held.

    Returns
    -------
    State

    Raises
    ------
    HistoryError
        If the history is no path of this model.
    InputError
        If a load, actuator or support that the path moved by its own function of time is elsewhere
        at `time`, so that forces are out of balance or constraints broken.

    Examples
    --------
    A bent rod let go after a second: without the load it swings.

    >>> from skfem_cosserat import Beam, EnergyMomentum, JointFixed, LoadForce, MeshCurve, Model
    >>> from skfem_cosserat import NullSpace, Section, Table, ground, simulate
    >>> from skfem_cosserat.statics import static
    >>> section = Section([1e4, 1e4, 1e4, 5, 5, 5], mass=1.0, inertia=(1.0, 1.0))
    >>> model = Model()
    >>> mesh = MeshCurve.init_line((0, 0, 0), (1, 0, 0), 4, name="rod")
    >>> rod = model.add("rod", Beam(mesh, section, order=2))
    >>> clamp = model.add("clamp", JointFixed(ground((0, 0, 0)), rod.node("rod.start")))
    >>> pull = Table([0, 1, 1.001], [0, 1, 0])
    >>> load = model.add("load", LoadForce(rod.node("rod.end"), (0, 0, 3.0), pull))
    >>> path = static(model)
    >>> start = equilibrium(model, path, time=1.0)
    >>> run = simulate(model.freeze(), EnergyMomentum(), NullSpace(), 0.01, 1.2, start=start)
    >>> bool(run["kinetic"].max() > 0.1)
    True
    """
    system = system_of(model, "argument model")
    _check_path(system, history)
    numbered("argument index", index, len(history), "points on the path")
    time = finite("argument time", "time", time)
    point = _point(system, history, index)
    _check_instant(system, history, index, point, time)
    q = point.y[: system.rows].reshape(-1)
    p = np.zeros(system.n)
    if system.moving:  # what is driven moves
        p = Projection(system)(q, p, time)[1]
    return State(time, 0, q, p, turns=point.turns, load_factor=point.t)


def _check_instant(system: System, history: History, index: int, point: Point, time: float) -> None:
    """Check that what the path moved by functions of time is at `time` as at the point."""
    then = float(history.instants[index])
    if time == then:
        return
    which = "the load factor of this point" if then == point.t else "the instant the path holds"
    hint = f"what the path moved by its own function of time starts at time={then!r}, {which}"
    y = system.extend(point.y[: system.rows].reshape(-1), time)
    wrong = broken_constraint(system, y, SAME)
    if wrong is not None:
        raise InputError("argument time", f"at {time!r} s the state {wrong}: {hint}")

    labels, *both = _moved(system, history, index, then, time)
    if system.moving and system.couplings.count:
        labels.append("what springs hold on moving ground")
    at, before = (
        balance(system, rows, amplitudes, turns=point.turns).R
        for rows, amplitudes in zip((y, point.y), both, strict=True)
    )
    missing = largest(null_space_matrix(system, y).T @ (at - before).ravel())
    if missing > SAME * largest(at, before):
        raise InputError(
            "argument time",
            f"at {time!r} s {' and '.join(labels)} is out of balance by {missing:.4g} N (N m):"
            f" {hint}",
        )


def _moved(
    system: System, history: History, index: int, then: float, time: float
) -> tuple[list[str], Amplitudes, Amplitudes]:
    """Loads and actuators that a path moved by functions of time, and their factors now and then.

    Not those of other models, and those that the path left out.
    """
    recorded = recorded_amplitudes(history, index)
    both = amplitudes_at(system, time), amplitudes_at(system, then)
    alone = [Amplitudes(0.0 * each.loads, 0.0 * each.actuators, time=each.time) for each in both]
    labels = []
    for kind, channels in (("loads", system.loading), ("actuators", system.couplings)):
        names = history.meta.get("factors", {}).get(kind, [])
        for owner in dict.fromkeys(channels.owners):
            own = [k for k, other in enumerate(channels.owners) if other is owner]
            known = [k for k, entry in enumerate(names) if entry == [str(owner.name), True]]
            if len(known) != len(own):
                continue
            now, before = (getattr(each, kind)[own] for each in both)
            taken = getattr(recorded, kind)[known]
            if (before.any() and not taken.any()) or _same(now, taken) or _same(now, before):
                continue
            labels.append(f"the {owner.label}")
            for each, factors in zip(alone, (now, before), strict=True):
                getattr(each, kind)[own] = factors
    return labels, alone[0], alone[1]


def _same(a: Floats, b: Floats) -> bool:
    return bool(abs(a - b).max() <= SAME * max(abs(a).max(), abs(b).max()))


def _check_path(system: System, history: History) -> None:
    if not isinstance(history, History) or "load_factor" not in history:
        raise HistoryError("history", "is no path of static()")
    difference = other_model(system, history.meta.get("fingerprint", {}))
    if difference:
        raise HistoryError("history", f"belongs to another model: {difference}")


def _point(system: System, history: History, k: int) -> Point:
    t = float(history["load_factor"][k])
    time = float(history.instants[k])
    turns = np.array(history["turns"][k]) if "turns" in history else None
    return Point(system.extend(np.array(history["q"][k]), time), t, turns)


def branch_stage(
    system: System, control: Control, point: Point, direction: Floats | None, held: bool = False
) -> Stage:
    """The control at work, on a branch if there is a direction; `held`: no ground moves."""
    if direction is None:
        stage = control.stage(system, point)
        if held and isinstance(control, DisplacementControl):
            control.check(system, point)
        return stage
    if not isinstance(control, ArcLength):
        raise InputError(
            "argument control", f"{type(control).__name__} with a Branch, expected ArcLength"
        )
    if point.y.shape != (system.total, 3) or direction.shape != (system.rows, 3):
        raise InputError("argument start", "the Branch belongs to another model")
    return control.stage(system, point, direction)
