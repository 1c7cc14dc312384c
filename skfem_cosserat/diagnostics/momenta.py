"""Momentum maps, and violations of the constraints by positions, velocities and momenta."""

from __future__ import annotations

import numpy as np

from ..constraints.rowspace import massless, rows_touching
from ..model import System
from ..types import ArrayLike, Floats
from .energy import mass_solver, momentum
from .stacks import as_stack, as_times

__all__ = [
    "angular_momentum",
    "constraint_violation",
    "ground_part",
    "hidden_violation",
    "linear_momentum",
    "midpoint_angular_momentum",
    "momentum_violation",
]


def angular_momentum(
    system: System, q: ArrayLike, p: ArrayLike, massive_only: bool = False
) -> Floats:
    """``sum q_a x p_a`` about the origin over all blocks, phi and the directors.

    The momentum map that both integrators conserve where the scene has the symmetry. With p of
    the discrete Legendre transform (34), (35) the blocks of d3 belong to it, although beams have
    no mass there.

    Parameters
    ----------
    q, p : (n,) or (N, n) array
        Configurations and momenta, e.g. ``history["q"]`` and ``history["p"]``.
    massive_only : bool
        Leave out the blocks without mass. With the variational scheme the sum then is not
        conserved any more: it oscillates with O(h^2).

    Returns
    -------
    (3,) or (N, 3) array
        (kg m^2/s)

    Raises
    ------
    InputError
        If the shape of `q` or `p` does not fit the system.

    Examples
    --------
    >>> from skfem_cosserat import MassPoint, Model
    >>> model = Model()
    >>> ball = model.add("ball", MassPoint(2.0))
    >>> angular_momentum(model.freeze(), [1.0, 0, 0], [0, 6.0, 0]).tolist()
    [0.0, 0.0, 6.0]
    """
    Q, single = as_stack(system, "q", q)
    P, _ = as_stack(system, "p", p)
    rows = system.mass.diagonal() > 0 if massive_only else np.ones(system.rows, dtype=bool)
    shape = (len(Q), system.rows, 3)
    out = np.cross(Q.reshape(shape)[:, rows], P.reshape(shape)[:, rows]).sum(1)
    return out[0] if single else out


def midpoint_angular_momentum(system: System, q: ArrayLike, step: float) -> Floats:
    """``q_mid x M (q_{n+1} - q_n)/step``: in terms of (q_n, q_{n+1}).

    Of a free scene it oscillates with O(h^2); the conserved one is that of (q_n, p_n),
    :func:`angular_momentum`.

    Parameters
    ----------
    q : (N, n) array
        Configurations of consecutive steps.
    step : float
        Step size (s).

    Returns
    -------
    (N-1, 3) array
        (kg m^2/s)

    Raises
    ------
    InputError
        If the shape of `q` does not fit the system.

    Examples
    --------
    >>> from skfem_cosserat import MassPoint, Model
    >>> model = Model()
    >>> ball = model.add("ball", MassPoint(2.0))
    >>> midpoint_angular_momentum(model.freeze(), [[1, 0, 0], [1, 0.5, 0]], 0.5).tolist()
    [[0.0, 0.0, 2.0]]
    """
    Q, _ = as_stack(system, "q", q)
    rate = momentum(system, np.diff(Q, axis=0) / step)
    return angular_momentum(system, (Q[1:] + Q[:-1]) / 2, rate)


def linear_momentum(system: System, p: ArrayLike) -> Floats:
    """Sum of the momenta of all positions phi.

    Parameters
    ----------
    p : (n,) or (N, n) array
        Momenta, e.g. ``history["p"]``.

    Returns
    -------
    (3,) or (N, 3) array
        (kg m/s)

    Raises
    ------
    InputError
        If the shape of `p` does not fit the system.

    Examples
    --------
    >>> from skfem_cosserat import MassPoint, Model
    >>> model = Model()
    >>> ball = model.add("ball", MassPoint(2.0))
    >>> dust = model.add("dust", MassPoint(1.0, position=(1, 0, 0)))
    >>> linear_momentum(model.freeze(), [1.0, 0, 0, 2.0, 0, 0]).tolist()
    [3.0, 0.0, 0.0]
    """
    P, single = as_stack(system, "p", p)
    out = P.reshape(len(P), system.rows, 3)[:, system.origin_rows].sum(1)
    return out[0] if single else out


def constraint_violation(system: System, q: ArrayLike, t: ArrayLike = 0.0) -> Floats:
    """Largest ``|g(q)|`` of each state, unscaled.

    Parameters
    ----------
    q : (n,) or (N, n) array
        Configurations.
    t : float or (N,) array
        Their times (s), for prescribed motion.

    Returns
    -------
    float or (N,) array
        In the units of the row: none for the triads (56) and the directions of joints, m for
        points that coincide, m^2 for distances, ``(|x_b - x_a|^2 - L^2)/2``.

    Raises
    ------
    InputError
        If the shape of `q` does not fit the system.

    Examples
    --------
    >>> from skfem_cosserat import JointDistance, MassPoint, Model, ground
    >>> model = Model()
    >>> bob = model.add("bob", MassPoint(2.0, position=(0, 0, -1)))
    >>> rod = model.add("rod", JointDistance(ground((0, 0, 0)), bob.place()))
    >>> constraint_violation(model.freeze(), [[0, 0, -1.0], [0, 0, -2.0]]).tolist()
    [0.0, 1.5]
    """
    Q, single = as_stack(system, "q", q)
    out = np.array(
        [
            abs(system.constraints.values(system.extend(row, float(s)))).max(initial=0.0)
            for row, s in zip(Q, as_times(t, len(Q)), strict=True)
        ]
    )
    return out[0] if single else out


def hidden_violation(system: System, q: ArrayLike, v: ArrayLike, t: ArrayLike = 0.0) -> Floats:
    """Largest ``|G(q) v + g_t|`` of each state: the hidden constraint (46) on velocity level.

    Parameters
    ----------
    q, v : (n,) or (N, n) array
        Configurations and velocities (m/s, 1/s), e.g. ``history["v"]``.
    t : float or (N,) array
        Their times (s), for prescribed motion.

    Returns
    -------
    float or (N,) array
        In the units of :func:`constraint_violation` per second.

    Raises
    ------
    InputError
        If the shape of `q` or `v` does not fit the system.

    Examples
    --------
    >>> from skfem_cosserat import JointDistance, MassPoint, Model, ground
    >>> model = Model()
    >>> bob = model.add("bob", MassPoint(2.0, position=(0, 0, -1)))
    >>> rod = model.add("rod", JointDistance(ground((0, 0, 0)), bob.place()))
    >>> float(hidden_violation(model.freeze(), [0, 0, -1.0], [2.0, 0, 3.0]))
    3.0
    """
    Q, single = as_stack(system, "q", q)
    V, _ = as_stack(system, "v", v)
    out = np.empty(len(Q))
    for k, (row, rate, s) in enumerate(zip(Q, V, as_times(t, len(Q)), strict=True)):
        y = system.extend(row, float(s))
        hidden = system.constraints.rate(y, rate) + ground_part(system, y, float(s))
        out[k] = abs(hidden).max(initial=0.0)
    return out[0] if single else out


def momentum_violation(system: System, q: ArrayLike, p: ArrayLike, t: ArrayLike = 0.0) -> Floats:
    """Largest ``|G M^-1 p + g_t|`` of each state: the hidden constraint (115) on momentum level.

    Over the coordinates with mass and the constraint rows without others: those of a beam's d3,
    which have no momentum, are left out.

    Parameters
    ----------
    q, p : (n,) or (N, n) array
        Configurations and momenta, e.g. ``history["p"]`` or ``history["Qp"]``.
    t : float or (N,) array
        Their times (s), for prescribed motion.

    Returns
    -------
    float or (N,) array
        In the units of :func:`constraint_violation` per second.

    Raises
    ------
    InputError
        If the shape of `q` or `p` does not fit the system.

    Examples
    --------
    >>> from skfem_cosserat import JointDistance, MassPoint, Model, ground
    >>> model = Model()
    >>> bob = model.add("bob", MassPoint(2.0, position=(0, 0, -1)))
    >>> rod = model.add("rod", JointDistance(ground((0, 0, 0)), bob.place()))
    >>> float(momentum_violation(model.freeze(), [0, 0, -1.0], [2.0, 0, 6.0]))
    3.0
    """
    Q, single = as_stack(system, "q", q)
    P, _ = as_stack(system, "p", p)
    inverse = mass_solver(system)
    kept = np.flatnonzero(~rows_touching(system, massless(system)))
    out = np.empty(len(Q))
    for k, (row, force, s) in enumerate(zip(Q, P, as_times(t, len(Q)), strict=True)):
        y = system.extend(row, float(s))
        rate = inverse(force.reshape(-1, 3)).reshape(-1)
        hidden = system.constraints.rate(y, rate) + ground_part(system, y, float(s))
        out[k] = abs(hidden[kept]).max(initial=0.0)
    return out[0] if single else out


def ground_part(system: System, y: Floats, t: float) -> Floats:
    """``g_t``, the rate of the constraints that prescribed motion causes at fixed q.

    Parameters
    ----------
    y : (total, 3) array
        All rows, ``system.extend(q, t)``.
    t : float
        Time (s).

    Returns
    -------
    (m,) array
        In the units of the constraint rows per second; zero without prescribed motion.

    Examples
    --------
    >>> from skfem_cosserat import JointSpherical, Model, Motion, RigidBody, ground
    >>> drive = ground((0, 0, 0), Motion(displacement=lambda t: (2.0 * t, 0, 0)))
    >>> model = Model()
    >>> body = model.add("body", RigidBody.box(1.0, (1, 1, 1)))
    >>> hook = model.add("hook", JointSpherical(drive, body.at((0, 0, 0))))
    >>> system = model.freeze()
    >>> ground_part(system, system.extend(system.q0, 0.0), 0.0)[6:].round(9).tolist()
    [-2.0, 0.0, 0.0]
    """
    if not system.moving:
        return np.zeros(system.m)
    rate = np.zeros_like(y)
    rate[system.rows :] = system.ground_rate(t)
    return system.constraints.ground_rate(y, rate)
