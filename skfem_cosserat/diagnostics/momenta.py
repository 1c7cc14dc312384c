"""Momenta, their projection, and violations of the constraints."""

from __future__ import annotations

import numpy as np

from ..assembly import FrozenPattern
from ..linear import LinearSolver
from ..model import System
from ..types import ArrayLike, Floats
from .energy import momentum
from .stacks import as_stack, as_times

__all__ = [
    "Projection",
    "angular_momentum",
    "constraint_violation",
    "ground_part",
    "hidden_violation",
    "linear_momentum",
    "midpoint_angular_momentum",
]


def angular_momentum(system: System, q: ArrayLike, p: ArrayLike) -> Floats:
    """``sum q_a x p_a`` about the origin over all blocks, phi and the directors.

    The momentum map that both integrators conserve where the scene has the symmetry. With p of
    the discrete Legendre transform (34), (35) the blocks of d3 belong to it, although beams have
    no mass there.

    Parameters
    ----------
    q, p : (n,) or (N, n) array
        Configurations and momenta, e.g. ``history["q"]`` and ``history["p"]``.

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
    shape = (len(Q), system.rows, 3)
    out = np.cross(Q.reshape(shape), P.reshape(shape)).sum(1)
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
        hidden = system.constraints.jacobian(y) @ rate + ground_part(system, y, float(s))
        out[k] = abs(hidden).max(initial=0.0)
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


class Projection:
    """Projection ``Q p = M v`` of momenta on the hidden constraint (39), (46), without M^-1.

    Solves the saddle point ``[[M, G^T], [G, 0]] (v, mu) = (p, -g_t)``, which is regular although
    a beam's mass matrix is singular on its d3.

    Examples
    --------
    >>> from skfem_cosserat import Model, MassPoint, JointDistance, ground
    >>> model = Model()
    >>> bob = model.add("bob", MassPoint(2.0, position=(0, 0, -1)))
    >>> rod = model.add("rod", JointDistance(ground((0, 0, 0)), bob.place()))
    >>> Projection(model.freeze())([0, 0, -1.0], [2.0, 0, 6.0])[0].tolist()   # velocity
    [1.0, 0.0, 0.0]
    """

    def __init__(self, system: System) -> None:
        self.system = system
        n, m, g = system.n, system.m, system.constraints
        mass = system.mass.tocoo()
        xyz = np.arange(3)
        i = (3 * mass.row[:, None].astype(np.int64) + xyz).ravel()
        j = (3 * mass.col[:, None].astype(np.int64) + xyz).ravel()
        gi, gj = g.rows[g.inside], g.cols[g.inside]
        self._pattern = FrozenPattern(
            np.concatenate([i, gj, n + gi]), np.concatenate([j, n + gi, gj]), (n + m, n + m)
        )
        self._solver = LinearSolver(self._pattern)
        self._mass = np.repeat(mass.data, 3)
        self._scale = float(abs(mass.data).max())

    def __call__(self, q: ArrayLike, p: ArrayLike, t: float = 0.0) -> tuple[Floats, Floats]:
        """Velocity v (n,) with ``G v + g_t = 0`` and projected momentum ``Q p = M v`` (n,).

        Parameters
        ----------
        q, p : (n,) array
            Configuration and momentum (kg m/s, kg m^2/s).
        t : float
            Time (s), for prescribed motion.
        """
        system = self.system
        n = system.n
        y = system.extend(np.asarray(q, dtype=float), t)
        G = self._scale * system.constraints.jacobian_values(y)
        rhs = np.zeros(n + system.m)
        rhs[:n] = p
        rhs[n:] = -self._scale * ground_part(system, y, t)
        data = self._pattern.data(np.concatenate([self._mass, G, G]))
        v = self._solver.solve(data, rhs)[:n]
        return v, (system.mass @ v.reshape(-1, 3)).reshape(-1)

    def stack(self, q: Floats, p: Floats, t: ArrayLike) -> tuple[Floats, Floats]:
        """The same for stacks q, p (N, n) at times t (s), a number or (N,)."""
        times = as_times(t, len(q))
        pairs = [self(a, b, float(s)) for a, b, s in zip(q, p, times, strict=True)]
        return np.array([v for v, _ in pairs]), np.array([w for _, w in pairs])
