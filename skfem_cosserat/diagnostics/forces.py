"""Multipliers, reactions of joints, conditioning."""

from __future__ import annotations

from typing import Literal

import numpy as np

from ..constraints import Treatment
from ..constraints.rowspace import stacked_multipliers
from ..errors import InputError
from ..history import History
from ..integrators import Integrator, State, Stepper
from ..model import System
from ..model.system import JointRows
from ..model.tension import overstretched
from ..types import Floats
from .stacks import as_stack, check_consecutive

__all__ = [
    "condition_number",
    "constraint_points",
    "drawn_too_far",
    "multipliers",
    "multipliers_at",
    "reactions",
]


def constraint_points(system: System, history: History) -> Floats:
    """Where the constraint forces of each recorded step act.

    The nodes q_n with the variational scheme, generalized-alpha and compositions, the midpoints
    with energy-momentum and its energy-decaying relative.

    Parameters
    ----------
    history : History
        Of a run of this system.

    Returns
    -------
    (N, total, 3) array
        All rows of y: the coordinates, then the ground's frames (m, -). With energy-momentum the
        last is NaN if the step after it could not be solved.

    Examples
    --------
    >>> from skfem_cosserat import JointDistance, MassPoint, Model, ground
    >>> model = Model()
    >>> bob = model.add("bob", MassPoint(2.0, position=(0, 0, -1)))
    >>> rod = model.add("rod", JointDistance(ground((0, 0, 0)), bob.place()))
    >>> system = model.freeze()
    >>> from skfem_cosserat import NullSpace, Variational, simulate
    >>> history = simulate(system, Variational(), NullSpace(), 0.1, until=0.2)
    >>> constraint_points(system, history).shape   # the bob, and 4 rows of the ground
    (3, 5, 3)
    """
    if "constraint_point" in history:
        return history["constraint_point"].reshape(len(history), system.total, 3)
    # a path's prescribed motion follows its load factor
    times = history.series.get("load_factor", history.times)
    pairs = zip(history["q"], times, strict=True)
    return np.array([system.extend(q, float(t)) for q, t in pairs])


def multipliers(system: System, y: Floats, force: Floats) -> Floats:
    """Multipliers from ``G(y)^T lambda = force``, by ``(G G^T) lambda = G force``.

    Where constraint rows are redundant, only ``G^T lambda`` is unique: of all lambda that give
    it, this is the one of least norm, ``sum lambda^2`` over all rows. How the forces are shared
    between the joints of such a loop is then a choice, not a result.

    Parameters
    ----------
    y : (N, total, 3) array
        Where the forces act, :func:`constraint_points`.
    force : (N, n) array
        ``history["constraint_force"]``, in either treatment (N, N m). NaN rows give NaN.

    Returns
    -------
    (N, m) array
        One for each constraint row, in units of J over those of the row: N for a row in m, N m
        for one without units, N/m for the one of a distance joint. NaN where ``G G^T`` of the
        independent rows is singular.

    Examples
    --------
    >>> from skfem_cosserat import JointDistance, MassPoint, Model, ground
    >>> model = Model()
    >>> bob = model.add("bob", MassPoint(2.0, position=(0, 0, -1)))
    >>> rod = model.add("rod", JointDistance(ground((0, 0, 0)), bob.place()))
    >>> y = model.freeze().extend(model.freeze().q0, 0.0)
    >>> multipliers(model.freeze(), y[None], np.array([[0.0, 0, -20.0]])).tolist()
    [[20.0]]
    """
    return stacked_multipliers(system, y, force)


def drawn_too_far(system: System, y: Floats, force: Floats) -> str | None:
    """:func:`overstretched`, with the tension that constraint forces (n,) carry at y (total, 3)."""
    lam = None
    if any(2 in rung.held for rung in system.rung_rows) and np.isfinite(force).all():
        lam = multipliers(system, y[None], force[None])[0]
    return overstretched(system, y, lam)


def multipliers_at(
    system: System, history: History, where: Literal["nodes", "midpoints"]
) -> Floats:
    """Multipliers of a run at the nodes t_n, or halfway from there to the next ones.

    Those of the variational scheme, generalized-alpha and compositions live at nodes, those of
    energy-momentum and its energy-decaying relative at midpoints; at the
    other places the mean of both neighbours is given, which is of second order too. Multipliers
    taken at different instants agree to first order only.

    Parameters
    ----------
    system : System
    history : History
        Of a run of this system; each step recorded if the mean is asked for.
    where : {"nodes", "midpoints"}
        Row n is at ``t_n``, or at ``t_n + h/2``.

    Returns
    -------
    (N, m) array
        As :func:`multipliers`. NaN where a neighbour is missing: at midpoints the last row of the
        variational scheme, at nodes the first row of energy-momentum. The first one of the
        variational scheme, from a start with given momentum, is of first order only.

    Raises
    ------
    InputError
        For another `where`, or if the history does not fit the system.
    IncompatibleError
        If the mean is asked for and steps between the recorded states are missing.

    Examples
    --------
    A weight of 20 N that hangs on a rod:

    >>> from skfem_cosserat import JointDistance, LoadGravity, MassPoint, Model, ground
    >>> model = Model()
    >>> bob = model.add("bob", MassPoint(2.0, position=(0, 0, -1)))
    >>> rod = model.add("rod", JointDistance(ground((0, 0, 0)), bob.place()))
    >>> gravity = model.add("gravity", LoadGravity((0, 0, -10.0)))
    >>> system = model.freeze()
    >>> from skfem_cosserat import NullSpace, Variational, simulate
    >>> history = simulate(system, Variational(), NullSpace(), 0.1, until=0.2)
    >>> multipliers_at(system, history, "midpoints").round(9).ravel().tolist()
    [20.0, 20.0, nan]
    """
    if where not in ("nodes", "midpoints"):
        raise InputError("argument where", f"{where!r}, expected 'nodes' or 'midpoints'")
    force = as_stack(system, "history", history["constraint_force"])[0]
    lam = multipliers(system, constraint_points(system, history), force)
    found = "midpoints" if "constraint_point" in history else "nodes"
    if where == found:
        return lam
    check_consecutive(history, f"multipliers at {where}")
    out = np.full_like(lam, np.nan)
    means = (lam[1:] + lam[:-1]) / 2
    if where == "midpoints":
        out[:-1] = means
    else:
        out[1:] = means
    return out


def reactions(system: System, y: Floats, lam: Floats) -> dict[str, tuple[Floats, Floats]]:
    """Force and moment that each joint exerts on its side B, about the joint's point on B.

    ``simulate`` adds them to its history as ``joint/NAME/force`` and ``joint/NAME/moment``.

    Parameters
    ----------
    y : (N, total, 3) array
        As for :func:`multipliers`.
    lam : (N, m) array
        Its result.

    Returns
    -------
    dict of str to (force, moment)
        (N, 3) each, in space (N, N m). The same in both treatments.

    Examples
    --------
    A weight of 20 N that hangs on a rod:

    >>> from skfem_cosserat import JointDistance, MassPoint, Model, ground
    >>> model = Model()
    >>> bob = model.add("bob", MassPoint(2.0, position=(0, 0, -1)))
    >>> rod = model.add("rod", JointDistance(ground((0, 0, 0)), bob.place()))
    >>> y = model.freeze().extend(model.freeze().q0, 0.0)
    >>> force, moment = reactions(model.freeze(), y[None], np.array([[20.0]]))["rod"]
    >>> (force + 0.0).tolist()
    [[0.0, 0.0, 20.0]]
    """
    return {jr.joint.name or "": _wrenches(system, jr, y, lam) for jr in system.joint_rows}


def _wrenches(system: System, jr: JointRows, y: Floats, lam: Floats) -> tuple[Floats, Floats]:
    """Forces and moments (N, 3) of one joint.

    The balance reads ``... + G^T lambda = 0``, so a joint acts with ``-G^T lambda``; if side B is
    the ground, the reaction of side A, about the same point of B, is turned round.
    """
    on_b = jr.b.vertex < len(system.origin_rows)
    vertex, sign = (jr.b.vertex, 1.0) if on_b else (jr.a.vertex, -1.0)
    b, r = int(system.vertex_rows[jr.b.vertex]), int(system.vertex_rows[vertex])
    rows = 4 if system.is_frame[vertex] else 1
    constraints = system.constraints
    own = (constraints.rows >= jr.rows.start) & (constraints.rows < jr.rows.stop)
    own &= (constraints.cols >= 3 * r) & (constraints.cols < 3 * (r + rows))
    which = np.flatnonzero(own)
    parts = constraints.contributions(which, y) * lam[:, constraints.rows[which]]
    place = constraints.cols[which] - 3 * r == np.arange(3 * rows)[:, None]
    f = -sign * (parts @ place.T).reshape(len(y), rows, 3)
    x = y[:, b] + sum(X * y[:, b + i + 1] for i, X in enumerate(jr.b.offset) if X != 0)
    arms = np.concatenate([(y[:, r] - x)[:, None], y[:, r + 1 : r + rows]], axis=1)
    return f[:, 0], np.cross(arms, f).sum(1)


def condition_number(
    system: System,
    integrator: Integrator,
    treatment: Treatment,
    step: float,
    state: State,
    scaled: bool = True,
) -> float:
    """2-norm condition number (dense) of the iteration matrix at the solution of one step.

    Parameters
    ----------
    integrator, treatment
        As for a simulation.
    step : float
        Step size (s).
    state : State
        At the start of the step.
    scaled : bool
        Of the matrix actually factorised; False: without the scaling of multipliers, as in Table
        2 of Leyendecker, Marsden & Ortiz (2008).

    Raises
    ------
    Diverged
        If the step cannot be solved.

    Examples
    --------
    >>> from skfem_cosserat import JointDistance, MassPoint, Model, ground
    >>> model = Model()
    >>> bob = model.add("bob", MassPoint(2.0, position=(0, 0, -1)))
    >>> rod = model.add("rod", JointDistance(ground((0, 0, 0)), bob.place()))
    >>> from skfem_cosserat import Multipliers, Variational, initial_state
    >>> case = model.freeze(), Variational(), Multipliers(), 1e-3, initial_state(model.freeze())
    >>> f"{condition_number(*case):.1f}", f"{condition_number(*case, scaled=False):.1e}"
    ('2.6', '4.0e+09')
    """
    stepper = Stepper(system, integrator, treatment, step, kernels="numpy")  # for one step
    matrix, _ = stepper.iteration_matrix(state, scaled)
    return float(np.linalg.cond(matrix))
