"""Momenta and velocities on the hidden constraints: projections, reduced momenta."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Literal, TypeAlias

import numpy as np
from scipy.sparse import csr_matrix, identity, kron
from scipy.sparse.linalg import splu

from ..constraints.rowspace import RowSpace, massless
from ..constraints.saddle import SaddlePoint
from ..errors import InputError
from ..linear import SingularMatrixError
from ..model import System
from ..types import ArrayLike, Floats
from .momenta import ground_part
from .stacks import as_stack, as_times

__all__ = [
    "Projection",
    "ProjectionMethod",
    "prescribed_velocity",
    "reduced_momentum",
    "velocity_from_reduced",
]

ProjectionMethod: TypeAlias = Literal["saddle-point", "directors-dropped", "reduced"]


class _Rule(ABC):
    """A way to project; holds what does not change with the state."""

    def __init__(self, system: System) -> None:
        self.system = system

    @abstractmethod
    def velocity(self, q: Floats, p: Floats, t: float) -> Floats:
        """Velocity (n,) on the hidden constraints at one state."""


class _SaddlePoint(_Rule):
    """``[[M, G^T], [G, 0]] (v, mu) = (p, -g_t)``."""

    def __init__(self, system: System) -> None:
        super().__init__(system)
        self._solve = self._matrix()

    def _matrix(self) -> SaddlePoint:
        return SaddlePoint(self.system)

    def velocity(self, q: Floats, p: Floats, t: float) -> Floats:
        """See the base class."""
        y = self.system.extend(q, t)
        return self._solve(y, p, -ground_part(self.system, y, t))[0]


class _DirectorsDropped(_SaddlePoint):
    """The same without the rows and columns of directors that have no mass (116)."""

    def _matrix(self) -> SaddlePoint:
        return SaddlePoint(self.system, massless(self.system))


class _Reduced(_Rule):
    """``v = P nu + v_0``, ``P^T M P nu = P^T (p - M v_0)``, where v_0 fulfils ``G v_0 = -g_t``."""

    def __init__(self, system: System) -> None:
        super().__init__(system)
        self.mass = csr_matrix(kron(system.mass, identity(3)))

    def velocity(self, q: Floats, p: Floats, t: float) -> Floats:
        """See the base class."""
        P = csr_matrix(self.system.null_space(q, t))
        if not self.system.moving:
            return P @ self.rates(P, P.T @ p)
        y = self.system.extend(q, t)
        start = RowSpace(self.system, y).least_norm(-ground_part(self.system, y, t))
        return P @ self.rates(P, P.T @ (p - self.mass @ start)) + start

    def rates(self, P: csr_matrix, reduced: Floats) -> Floats:
        """``nu = (P^T M P)^-1`` of a reduced momentum."""
        if not P.shape[1]:
            return np.zeros(0)
        try:
            return splu((P.T @ self.mass @ P).tocsc()).solve(reduced)
        except RuntimeError as error:  # SuperLU: exactly singular
            raise SingularMatrixError("P^T M P is singular: a motion has no inertia") from error


_RULES: dict[str, type[_Rule]] = {
    "saddle-point": _SaddlePoint,
    "directors-dropped": _DirectorsDropped,
    "reduced": _Reduced,
}


class Projection:
    """Projection ``Q p = M v`` of momenta on the hidden constraints ``G v + g_t = 0`` (39), (46).

    Parameters
    ----------
    system : System
    method : {"saddle-point", "directors-dropped", "reduced"}
        ``"saddle-point"`` solves ``[[M, G^T], [G, 0]] (v, mu) = (p, -g_t)``, which is regular
        although a beam's mass matrix is singular on its d3. It keeps the momentum maps.

        ``"reduced"`` gives the same by the null space matrix,
        ``Q = M P (P^T M P)^-1 P^T`` where nothing is driven.

        ``"directors-dropped"`` is (116) of Leyendecker, Marsden & Ortiz (2008): coordinates
        without mass (d3 of beams) and all constraint rows that contain them are left out; v and
        ``Q p`` are zero in these blocks. It agrees with the others only if p is zero there and no
        joint holds on to such a director. Angular momentum then oscillates with O(h^2).

    Raises
    ------
    InputError
        For an unknown method.

    Examples
    --------
    >>> from skfem_cosserat import Model, MassPoint, JointDistance, ground
    >>> model = Model()
    >>> bob = model.add("bob", MassPoint(2.0, position=(0, 0, -1)))
    >>> rod = model.add("rod", JointDistance(ground((0, 0, 0)), bob.place()))
    >>> system = model.freeze()
    >>> Projection(system)([0, 0, -1.0], [2.0, 0, 6.0])[0].tolist()   # velocity
    [1.0, 0.0, 0.0]
    >>> Projection(system, "reduced")([0, 0, -1.0], [2.0, 0, 6.0])[1].tolist()   # momentum
    [2.0, 0.0, 0.0]
    """

    def __init__(self, system: System, method: ProjectionMethod = "saddle-point") -> None:
        if method not in _RULES:
            raise InputError("argument method", f"{method!r}, expected one of {list(_RULES)}")
        self.system, self.method = system, method
        self._rule = _RULES[method](system)

    def __call__(self, q: ArrayLike, p: ArrayLike, t: float = 0.0) -> tuple[Floats, Floats]:
        """Velocity v (n,) with ``G v + g_t = 0`` and projected momentum ``Q p = M v`` (n,).

        Parameters
        ----------
        q, p : (n,) array
            Configuration and momentum (kg m/s, kg m^2/s).
        t : float
            Time (s), for prescribed motion.
        """
        q, p = np.asarray(q, dtype=float), np.asarray(p, dtype=float)
        v = self._rule.velocity(q, p, t)
        return v, (self.system.mass @ v.reshape(-1, 3)).reshape(-1)

    def stack(self, q: Floats, p: Floats, t: ArrayLike) -> tuple[Floats, Floats]:
        """The same for stacks q, p (N, n) at times t (s), a number or (N,).

        Rows of p that are NaN (not known) give NaN.
        """
        v, projected = np.full((2, *np.shape(p)), np.nan)
        for k, s in enumerate(as_times(t, len(q))):
            if np.isfinite(p[k]).all():
                v[k], projected[k] = self(q[k], p[k], float(s))
        return v, projected


def reduced_momentum(system: System, q: ArrayLike, p: ArrayLike, t: ArrayLike = 0.0) -> Floats:
    """``P(q)^T p``: the momentum without the part that constraint forces can give.

    Parameters
    ----------
    q, p : (n,) or (N, n) array
        Configurations and momenta, e.g. ``history["q"]`` and ``history["p"]``.
    t : float or (N,) array
        Their times (s), for prescribed motion.

    Returns
    -------
    (unknowns,) or (N, unknowns) array
        In the order of the unknowns of the null space method (kg m/s of translations, kg m^2/s of
        rotations); NaN where p is.

    Raises
    ------
    InputError
        If the shape of `q` or `p` does not fit the system.

    Notes
    -----
    With closed loops the unknowns refer to a basis that each configuration has of its own
    (``system.null_space``): compare the velocities, :func:`velocity_from_reduced`.

    Examples
    --------
    A bar of 3 kg m^2 about its hinge, at 2 rad/s:

    >>> from skfem_cosserat import JointRevolute, Model, RigidBody, ground
    >>> from skfem_cosserat.diagnostics import momentum
    >>> model = Model()
    >>> bar = model.add("bar", RigidBody(1.0, (3.0, 3.0, 3.0), angular_velocity=(0, 0, 2.0)))
    >>> hinge = JointRevolute(ground((0, 0, 0)), bar.at((0, 0, 0)), axis=(0, 0, 1))
    >>> hinge = model.add("hinge", hinge)
    >>> system = model.freeze()
    >>> reduced_momentum(system, system.q0, momentum(system, system.v0)).round(9).tolist()
    [6.0]
    """
    Q, single = as_stack(system, "q", q)
    P, _ = as_stack(system, "p", p)
    times = as_times(t, len(Q))
    out = np.array(
        [
            csr_matrix(system.null_space(a, float(s))).T @ b
            for a, b, s in zip(Q, P, times, strict=True)
        ]
    )
    return out[0] if single else out


def velocity_from_reduced(
    system: System, q: ArrayLike, reduced: ArrayLike, t: ArrayLike = 0.0
) -> Floats:
    """Velocity on the hidden constraints with a given reduced momentum.

    ``v = P (P^T M P)^-1 reduced + qdot_prescribed``, see :func:`prescribed_velocity`; the way back
    from :func:`reduced_momentum`.

    Parameters
    ----------
    q : (n,) or (N, n) array
        Configurations.
    reduced : (unknowns,) or (N, unknowns) array
        Reduced momenta (kg m/s, kg m^2/s).
    t : float or (N,) array
        Their times (s), for prescribed motion.

    Returns
    -------
    (n,) or (N, n) array
        (m/s, 1/s); NaN where `reduced` is.

    Raises
    ------
    InputError
        If the shape of `q` or `reduced` does not fit the system.

    Examples
    --------
    >>> from skfem_cosserat import JointDistance, MassPoint, Model, ground
    >>> model = Model()
    >>> bob = model.add("bob", MassPoint(2.0, position=(0, 0, -1)))
    >>> rod = model.add("rod", JointDistance(ground((0, 0, 0)), bob.place()))
    >>> system = model.freeze()
    >>> reduced = reduced_momentum(system, system.q0, [2.0, 4.0, 6.0])
    >>> velocity_from_reduced(system, system.q0, reduced).tolist()   # not along the rod
    [1.0, 2.0, 0.0]
    """
    Q, single = as_stack(system, "q", q)
    pi = np.atleast_2d(np.asarray(reduced, dtype=float))
    rule, out = _Reduced(system), np.full(Q.shape, np.nan)
    saddle, rest = _SaddlePoint(system) if system.moving else None, np.zeros(system.n)
    for k, s in enumerate(as_times(t, len(Q))):
        P = csr_matrix(system.null_space(Q[k], float(s)))
        if pi.shape != (len(Q), P.shape[1]):
            raise InputError(
                "argument reduced",
                f"has shape {np.shape(reduced)}, expected ({P.shape[1]},) for each state",
            )
        if np.isfinite(pi[k]).all():
            start = 0.0 if saddle is None else saddle.velocity(Q[k], rest, float(s))
            out[k] = P @ rule.rates(P, pi[k]) + start
    return out[0] if single else out


def prescribed_velocity(system: System, q: ArrayLike, t: float = 0.0) -> Floats:
    """The velocity that prescribed motion alone asks for, ``qdot_prescribed``.

    Of all v with ``G v = -g_t`` the one of least kinetic energy, ``M v = -G^T mu``: what a blow of
    the drives gives to the scene at rest. Its reduced momentum is zero, so that every velocity on
    the hidden constraints is ``P nu + qdot_prescribed`` with ``P^T M P nu`` its reduced momentum.

    Parameters
    ----------
    q : (n,) array
        Configuration.
    t : float
        Time (s).

    Returns
    -------
    (n,) array
        (m/s, 1/s); zero without prescribed motion.

    Examples
    --------
    A rod of length l that is pulled sideways at its end: it turns about a point at 2 l/3.

    >>> from skfem_cosserat import JointSpherical, Model, Motion, RigidBody, ground
    >>> drive = ground((0, 0, 0), Motion(displacement=lambda t: (3.0 * t, 0, 0)))
    >>> model = Model()
    >>> body = RigidBody(12.0, (1.0, 1.0, 0.1), position=(0, 0, -0.5))
    >>> rod = model.add("rod", body)
    >>> hook = model.add("hook", JointSpherical(drive, rod.at((0, 0, 0))))
    >>> system = model.freeze()
    >>> v = prescribed_velocity(system, system.q0)
    >>> v[:3].round(9).tolist(), (v[9:] + 0.0).round(9).tolist()   # of its middle; of d3
    ([0.75, 0.0, 0.0], [4.5, 0.0, 0.0])
    """
    if not system.moving:
        return np.zeros(system.n)
    return _SaddlePoint(system).velocity(np.asarray(q, dtype=float), np.zeros(system.n), t)
