"""Going on from a path: along the branch at a bifurcation, or in time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ..diagnostics import Projection
from ..errors import HistoryError, InputError
from ..history import History
from ..integrators import State
from ..load import Amplitude
from ..model import Model, System
from ..model.balance import Spin
from ..simulate.describe import other_model
from ..types import Floats, numbers
from .control import ArcLength, Control, Stage
from .point import Point
from .record import CODES
from .schedule import Schedule
from .stability import inspect

__all__ = ["Branch", "branch", "branch_stage", "equilibrium"]


@dataclass(frozen=True, eq=False, repr=False)
class Branch:
    """Where a path leads off: for the argument ``start`` of :func:`static`, with ArcLength().

    Attributes
    ----------
    point : Point
        The critical point.
    direction : (rows, 3) array
        Change of the coordinates along the branch.
    """

    point: Point
    direction: Floats

    def __repr__(self) -> str:
        """Without the arrays."""
        return f"Branch(t={self.point.t!r}, rows={len(self.direction)})"


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
    system = _frozen(model)
    _check_path(system, history)
    rows = np.flatnonzero(history["critical"] != CODES["regular"])
    if not _is_whole(which) or not -len(rows) <= which < len(rows):
        raise InputError("argument which", f"{which!r}: the path has {len(rows)} critical point(s)")
    number = numbers("argument sign", "sign", sign)
    if number.shape != () or not np.isfinite(number) or number == 0:
        raise InputError("argument sign", f"{sign!r}, expected 1 or -1")
    if not _is_whole(mode) or mode < 0:
        raise InputError("argument mode", f"{mode!r}, expected a number from 0 on")
    point = _point(system, history, int(rows[which]))
    look = inspect(system, point, Schedule(system, factors, spin).at(point.t))
    values, modes = look.nearest(mode + 1)
    if mode >= len(values):
        raise InputError("argument mode", f"{mode!r}: the scene has {len(values)} motion(s)")
    direction = look.tangent.P @ modes[:, mode]
    largest = direction[int(abs(direction).argmax())]  # so that the sign is no accident
    return Branch(point, np.sign(number) * np.sign(largest) * direction.reshape(-1, 3))


def equilibrium(model: Model | System, history: History, index: int = -1) -> State:
    """A state at rest at a point of a path, to start a run in time or another path from.

    Its time is the load factor, so that loads and motions that depend on time go on from there.
    Loads are no part of a state, nor of what makes a model the same: the model may have others
    than that of the path.

    Parameters
    ----------
    model : Model or System
    history : History
        A path of :func:`static`.
    index : int
        Number of the point.

    Returns
    -------
    State

    Raises
    ------
    HistoryError
        If the history is no path of this model.

    Examples
    --------
    A bent rod let go: without the load it swings.

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
    >>> start = equilibrium(model, static(model))
    >>> run = simulate(model.freeze(), EnergyMomentum(), NullSpace(), 0.01, 1.2, start=start)
    >>> bool(run["kinetic"].max() > 0.1)
    True
    """
    system = _frozen(model)
    _check_path(system, history)
    if not _is_whole(index) or not -len(history) <= index < len(history):
        raise InputError("argument index", f"{index!r}: the path has {len(history)} points")
    point = _point(system, history, index)
    q = point.y[: system.rows].reshape(-1)
    p = np.zeros(system.n)
    if system.moving:  # what is driven moves
        p = Projection(system)(q, p, point.t)[1]
    return State(point.t, 0, q, p, turns=point.turns)


def _frozen(model: Model | System) -> System:
    system = model.freeze() if isinstance(model, Model) else model
    if not isinstance(system, System):
        raise InputError("argument model", f"{model!r}, expected a Model or System")
    return system


def _is_whole(value: object) -> bool:
    return isinstance(value, int | np.integer) and not isinstance(value, bool)


def _check_path(system: System, history: History) -> None:
    if not isinstance(history, History) or "load_factor" not in history:
        raise HistoryError("history", "is no path of static()")
    difference = other_model(system, history.meta.get("fingerprint", {}))
    if difference:
        raise HistoryError("history", f"belongs to another model: {difference}")


def _point(system: System, history: History, k: int) -> Point:
    t = float(history["load_factor"][k])
    turns = np.array(history["turns"][k]) if "turns" in history else None
    return Point(system.extend(np.array(history["q"][k]), t), t, turns)


def branch_stage(system: System, control: Control, point: Point, direction: Floats | None) -> Stage:
    """The control at work, on a branch if there is a direction."""
    if direction is None:
        return control.stage(system, point)
    if not isinstance(control, ArcLength):
        raise InputError(
            "argument control", f"{type(control).__name__} with a Branch, expected ArcLength"
        )
    if point.y.shape != (system.total, 3) or direction.shape != (system.rows, 3):
        raise InputError("argument start", "the Branch belongs to another model")
    return control.stage(system, point, direction)
