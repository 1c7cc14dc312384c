"""Discrete Legendre transforms of a run with the variational scheme."""

from __future__ import annotations

import numpy as np

from ..errors import IncompatibleError
from ..history import History
from ..integrators import State, Variational
from ..model import System
from ..types import Floats
from .stacks import as_stack, check_consecutive

__all__ = ["legendre_transforms"]


def legendre_transforms(system: System, history: History) -> tuple[Floats, Floats]:
    """Both momenta of each node, from the step after it (34) and from the step before it (35).

    ``p^-_n = -D_1 L_d(q_n, q_{n+1}) - f^-_n + (h/2) G^T lambda_n`` and
    ``p^+_n = D_2 L_d(q_{n-1}, q_n) + f^+_{n-1} - (h/2) G^T lambda_n``, computed anew from the
    recorded configurations and constraint forces. The discrete Euler-Lagrange equations (22) say
    that both are equal, so their difference is the error of the solver.

    Parameters
    ----------
    system : System
    history : History
        Of a run of this system with ``Variational()`` that records every step.

    Returns
    -------
    p_minus, p_plus : (N, n) array
        (kg m/s, kg m^2/s). The last p_minus is NaN, as the step after it is not recorded; the
        first p_plus is NaN at a start from given momentum (where a run goes on, it is what was
        carried over); the last p_plus is NaN if the run could not look one step ahead.

    Raises
    ------
    IncompatibleError
        If the run had another integrator, or not every step is recorded.
    InputError
        If the history does not fit the system.

    Examples
    --------
    >>> from skfem_cosserat import JointDistance, LoadGravity, MassPoint, Model, ground
    >>> from skfem_cosserat import NullSpace, simulate
    >>> model = Model()
    >>> bob = model.add("bob", MassPoint(2.0, position=(1, 0, 0)))
    >>> rod = model.add("rod", JointDistance(ground((0, 0, 0)), bob.place()))
    >>> gravity = model.add("gravity", LoadGravity((0, 0, -10.0)))
    >>> system = model.freeze()
    >>> history = simulate(system, Variational(), NullSpace(), 0.1, until=0.3)
    >>> minus, plus = legendre_transforms(system, history)
    >>> bool(abs(minus - plus)[1:-1].max() < 1e-12)
    True
    """
    scheme = Variational()
    item = "discrete Legendre transforms"
    name = history.meta.get("integrator")
    if name != scheme.name:
        raise IncompatibleError(
            item, f"belong to the integrator {scheme.name!r}, the history was made with {name!r}"
        )
    if "step_size" in history:
        raise IncompatibleError(item, "are for steps of one size, those of this history vary")
    check_consecutive(history, item)
    q, _ = as_stack(system, "history", history["q"])
    times, h = history.times, float(history.meta["step"])
    half = 0.5 * h * history["constraint_force"]
    minus, plus = np.full_like(q, np.nan), np.full_like(q, np.nan)
    if len(q) and not history["fresh"][0]:
        plus[0] = history["carried"][0]
    turns = np.asarray(history["turns"], dtype=np.int64) if "turns" in history else None
    for n in range(len(q) - 1):
        # with p = 0 the balance is -D_1 L_d - f^-, what is carried on D_2 L_d + f^+
        turned = None if turns is None else turns[n]
        rest = State(float(times[n]), n, q[n], np.zeros(system.n), turns=turned)
        step = scheme.begin(system, rest, h)
        evaluation = scheme.evaluate(system, step, system.extend(q[n + 1], float(times[n + 1])))
        minus[n] = evaluation.R.reshape(-1)
        plus[n + 1] = scheme.carry(system, step, evaluation).reshape(-1)
    return minus + half, plus - half
