"""Velocities and accelerations on the hidden constraints: ``[[M, G^T], [G, 0]]`` solved."""

from __future__ import annotations

from functools import lru_cache
from threading import get_ident

import numpy as np
from scipy.sparse import csr_matrix, diags, identity, kron
from scipy.sparse.linalg import cg

from ..compiled.plan import plan_of
from ..linear import LinearSolver
from ..model import System
from ..model.balance import amplitudes_at, balance
from ..model.loops import null_space_matrix
from ..pattern import FrozenPattern
from ..types import Floats, IndexArray
from .base import RowSpace, dependent_rows

#: vertices left by elimination along chains and trees above which it is a large lattice
LATTICE = 100
#: residual at which conjugate gradients end, relative to the momentum: far below rounding, as what
#: heavy bodies leave is large beside light struts
CONVERGED = 1e-18


def full_mass(system: System) -> csr_matrix:
    """Mass matrix (n, n) of all coordinates."""
    return csr_matrix(kron(system.mass, identity(3)))


class SaddlePoint:
    """``[[M, G^T], [G, 0]] (v, mu) = (p, r)``; dependent rows get a 1 on the diagonal.

    Regular although the mass matrix of beams is singular on d3.
    """

    def __init__(self, system: System):
        self.system = system
        n, m, g = system.n, system.m, system.constraints
        mass = full_mass(system).tocoo()
        gi = g.rows[g.inside]
        gj = g.cols[g.inside]
        self._loops = system.closure.rows
        ends = n + self._loops
        self._pattern = FrozenPattern(
            np.concatenate([mass.row, gj, n + gi, ends]),
            np.concatenate([mass.col, n + gi, gj, ends]),
            (n + m, n + m),
        )
        self._solver = LinearSolver(self._pattern)
        self._mass = mass.data
        self._scale = float(abs(mass.data).max())
        self._rows = gi

    def __call__(self, y: Floats, p: Floats, rate: Floats) -> tuple[Floats, Floats]:
        """Solve at configuration y (total, 3) for p (n,) and r = `rate` (m,): v (n,), mu (m,)."""
        n = self.system.n
        G = self._scale * self.system.constraints.jacobian_values(y)
        rhs = np.concatenate([p, self._scale * rate])
        out = np.zeros(self.system.m, bool)
        out[dependent_rows(self.system, y)] = True
        if out.any():
            G[out[self._rows]] = 0
            rhs[n:][out] = 0
        ones = self._scale * out[self._loops]
        solved = self._solver.solve(
            self._pattern.data(np.concatenate([self._mass, G, G, ones])), rhs
        )
        return solved[:n], self._scale * solved[n:]


def saddle_point(system: System) -> SaddlePoint:
    """That of a system, made once as long as no others are asked for; each thread has its own."""
    return _made(system, get_ident())


@lru_cache(maxsize=4)
def _made(system: System, thread: int) -> SaddlePoint:
    return SaddlePoint(system)


def hidden_rate(system: System, y: Floats, t: float | None) -> Floats:
    """Rate (m,) that ``G v`` has to have at y (total, 3): minus that by prescribed motion.

    With None for the time the ground is at rest.
    """
    if t is None or not system.moving:
        return np.zeros(system.m)
    rate = np.zeros_like(y)
    rate[system.rows :] = system.ground_rate(t)
    return -system.constraints.ground_rate(y, rate)


def nearest_velocity(system: System, y: Floats, p: Floats, t: float | None) -> Floats:
    """Velocity (n,) on the hidden constraints nearest to p (n,), in the kinetic energy; at time t.

    ``M v = p - G(y)^T mu``, ``G(y) v + g_t = 0`` at y (total, 3), for None ``G(y) v = 0``.
    """
    rate = hidden_rate(system, y, t)
    found = _velocity_of_lattice(system, y, p, rate) if is_lattice(system) else None
    return saddle_point(system)(y, p, rate)[0] if found is None else found


def nearest_momentum(system: System, y: Floats, p: Floats, t: float | None) -> Floats:
    """``Q p = M v`` (n,) of the :func:`nearest_velocity`."""
    return (system.mass @ nearest_velocity(system, y, p, t).reshape(-1, 3)).reshape(-1)


def balancing(system: System, y: Floats, force: Floats) -> Floats:
    """Multipliers (m,) of ``M a + G^T lambda = force``, ``G a = 0`` at y (total, 3).

    What no multipliers give is left to accelerations, those that are nearest in the kinetic energy:
    the share of each joint depends on no units. Of redundant rows those of least norm. At rest,
    where a force is balanced and nothing needs to have mass, :class:`RowSpace` gives them alone.
    """
    if not is_lattice(system) and not len(system.closure.rows):
        return saddle_point(system)(y, force, np.zeros(system.m))[1]
    return RowSpace(system, y).multipliers(force - nearest_momentum(system, y, force, None))


@lru_cache(maxsize=4)
def is_lattice(system: System) -> bool:
    """True if elimination along chains and trees leaves many vertices of a scene.

    These fill in: conjugate gradients take a fraction of the time and the memory. False for scenes
    with closed loops or strains that have multipliers.
    """
    few = len(system.origin_rows) <= LATTICE
    if few or system.joint_coordinates.closure.rank or len(system.held_rows):
        return False
    return len(plan_of(system.joint_coordinates).rest) > LATTICE


def _velocity_of_lattice(system: System, y: Floats, p: Floats, rate: Floats) -> Floats | None:
    """``v = P nu + v_0``, ``P^T M P nu = P^T (p - M v_0)``; None: it does not converge."""
    if not np.isfinite(p).all():
        return None
    P = null_space_matrix(system, y)
    mass = full_mass(system)
    A = (P.T @ mass @ P).tocsr()
    v = RowSpace(system, y).least_norm(rate) if rate.any() else np.zeros(system.n)
    if not (A.diagonal() > 0).all():  # a motion has no inertia
        return None
    scale = diags(1 / np.sqrt(A.diagonal()))  # moments of thin sections are small beside forces
    first = scale @ (P.T @ (p - mass @ v))
    nu, left = cg(scale @ A @ scale, first, rtol=CONVERGED, atol=0.0, maxiter=500)
    return None if left else v + P @ (scale @ nu)


def accelerations(
    system: System,
    q: Floats,
    v: Floats,
    t: float,
    turns: IndexArray | None = None,
    viscous: bool = True,
) -> tuple[Floats, Floats]:
    """Accelerations and multipliers of the continuous equations of motion at a state.

    ``M a + G^T lambda = f(q, v, t)`` and the second derivative of ``g(q, t) = 0``; of redundant
    rows those that depend on others have no multiplier.

    Parameters
    ----------
    q, v : (n,) array
        On the constraints and the hidden ones.
    t : float
        Time (s).
    turns : (k,) int array, optional
        Full turns of the angles that springs act on.
    viscous : bool
        With the viscous forces of sections.

    Returns
    -------
    a : (n,) array
        (m/s^2, 1/s^2)
    multipliers : (m,) array

    Examples
    --------
    A pendulum that swings through its lowest point: the rod carries weight and centrifugal force.

    >>> from skfem_cosserat import JointDistance, LoadGravity, MassPoint, Model, ground
    >>> model = Model()
    >>> bob = model.add("bob", MassPoint(2.0, position=(0, 0, -1)))
    >>> rod = model.add("rod", JointDistance(ground((0, 0, 0)), bob.place()))
    >>> weight = model.add("weight", LoadGravity((0, 0, -10.0)))
    >>> system = model.freeze()
    >>> a, lam = accelerations(system, system.q0, np.array([3.0, 0, 0]), 0.0)
    >>> (a.round(9) + 0.0).tolist(), lam.round(9).tolist()
    ([0.0, 0.0, 9.0], [38.0])
    """
    y = system.extend(q, t)
    velocity = v.reshape(-1, 3)
    rates, curved = _ground_rates(system, t)
    ydot = np.concatenate([velocity, rates])
    force = -balance(system, y, amplitudes_at(system, t), turns=turns, ydot=ydot, viscous=viscous).R
    # constraints are cubic in y at most: this second difference is exact but for rounding
    size = float(abs(ydot).max(initial=0.0))
    bend = np.zeros(system.m)
    if size:
        s = 1 / max(size, float(abs(velocity[system.origin_rows]).max()) / system.length)
        g = [system.constraints.values(y + k * s * ydot) for k in (-1, 0, 1)]
        bend = (g[2] - 2 * g[1] + g[0]) / s**2
    if system.moving:
        carried = np.zeros_like(y)
        carried[system.rows :] = curved
        bend = bend + system.constraints.ground_rate(y, carried)
    return saddle_point(system)(y, force.reshape(-1), -bend)


def _ground_rates(system: System, t: float) -> tuple[Floats, Floats]:
    """First and second derivative of the ground's rows in time, by differences."""
    rate = system.ground_rate(t)
    if not system.moving:
        return rate, np.zeros_like(rate)
    # one-sided, since a motion may not be known before t = 0
    h = 1e-3 if t <= 0 else -min(1e-3, t / 4)
    f = [system.ground(t + k * h) for k in range(6)]
    weights = np.array([15 / 4, -77 / 6, 107 / 6, -13.0, 61 / 12, -5 / 6])
    return rate, np.einsum("k,krc->rc", weights, np.array(f)) / h**2
