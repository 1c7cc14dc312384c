"""Momenta: of the paper, of a motion, and projected onto the hidden constraints."""

from __future__ import annotations

from functools import partial
from typing import Literal, TypeAlias

import numpy as np
from scipy.linalg import lstsq
from scipy.sparse import bmat
from scipy.sparse.linalg import splu

from ..arguments import checked
from ..constraints.base import massless, rows_touching
from ..constraints.saddle import balancing, full_mass, hidden_rate, nearest_velocity
from ..errors import IncompatibleError, InputError
from ..history import History
from ..integrators import State, Variational
from ..integrators.choice import kept_motion
from ..linear import SingularMatrixError
from ..model import Model, System, system_of, takes_scene
from ..model.loops import null_space_matrix
from ..types import ArrayLike, Floats, real, switch
from .energy import in_rows, mass_solver, momentum
from .stacked import (
    all_rows,
    as_array,
    as_floats,
    as_stack,
    as_times,
    of_states,
    rates,
    step_size,
)

# -- discrete Legendre transforms of a run with the variational scheme -----------------------------


@takes_scene
def legendre_transforms(system: System, history: History) -> tuple[Floats, Floats]:
    """Both momenta of each node, from the step after it (34) and from the step before it (35).

    ``p^-_n = -D_1 L_d(q_n, q_{n+1}) - f^-_n + (h/2) G^T lambda_n`` and
    ``p^+_n = D_2 L_d(q_{n-1}, q_n) + f^+_{n-1} - (h/2) G^T lambda_n``, computed anew from the
    recorded configurations and constraint forces. The discrete Euler-Lagrange equations (22) say
    that both are equal, so their difference is the error of the solver.

    Parameters
    ----------
    system : Model or System
    history : History
        Of a run of this system with ``Variational()`` that records every step.

    Returns
    -------
    p_minus, p_plus : (N, n) array
        (kg m/s, kg m^2/s). The last ones are NaN, as the constraint force of their node is that of
        the step after it; the first p_plus is NaN at a start from given momentum (where a run goes
        on, it is what was carried over).

    Raises
    ------
    IncompatibleError
        If the run had another integrator, or not every step is recorded.
    InputError
        If the history does not fit the system.

    Examples
    --------
    A pendulum that is let go from the side:

    >>> from skfem_cosserat import JointDistance, LoadGravity, MassPoint, Model, ground
    >>> from skfem_cosserat import NullSpace, simulate
    >>> model = Model()
    >>> bob = model.add("bob", MassPoint(2.0, position=(1, 0, 0)))
    >>> rod = model.add("rod", JointDistance(ground((0, 0, 0)), bob.place()))
    >>> gravity = model.add("gravity", LoadGravity((0, 0, -10.0)))
    >>> system = model.freeze()
    >>> history = simulate(system, Variational(), NullSpace(), 0.05, until=0.3)
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
    jumps = np.flatnonzero(np.diff(history["step"]) != 1)
    if len(jumps):
        first, then = history["step"][jumps[0] : jumps[0] + 2]
        raise IncompatibleError(
            item,
            f"needs every step, the history goes from step {first:.0f} to {then:.0f}: record with"
            " every=1",
        )
    q, _ = as_stack(system, "history", history["q"])
    times = history.times
    h = float(history.meta["step"])
    half = 0.5 * h * history["constraint_force"]  # with a given momentum not that of the equations
    half[-1:] = np.nan
    minus = np.full_like(q, np.nan)
    plus = np.full_like(q, np.nan)
    if len(q) and not history["fresh"][0]:
        plus[0] = history["carried"][0]
    turns = np.asarray(history["turns"]) if "turns" in history else None
    balance = scheme.balance(system, h)
    for n in range(len(q) - 1):
        # with p = 0 the balance is -D_1 L_d - f^-, what is carried on D_2 L_d + f^+
        turned = None if turns is None else turns[n]
        step = balance.begin(State(float(times[n]), n, q[n], np.zeros(system.n), turns=turned))
        evaluation = balance.evaluate(step, system.extend(q[n + 1], float(times[n + 1])))
        minus[n] = evaluation.R.reshape(-1)
        plus[n + 1] = balance.finish(step, evaluation).momentum.reshape(-1)
        if history["fresh"][n]:
            lam = balancing(system, step.y0, history["p"][n] - minus[n])
            half[n] = system.constraints.jacobian(step.y0).T @ lam
    return minus + half, plus - half


# -- momentum maps, and violations of the constraints by positions, velocities and momenta ---------


@takes_scene
@of_states
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
    A ball at 1 m from the origin, across it at 3 m/s:

    >>> from skfem_cosserat import MassPoint, Model
    >>> model = Model()
    >>> ball = model.add("ball", MassPoint(2.0))
    >>> angular_momentum(model.freeze(), [1.0, 0, 0], [0, 6.0, 0]).tolist()
    [0.0, 0.0, 6.0]
    """
    massive_only = switch("argument massive_only", massive_only)
    rows = system.mass.diagonal() > 0 if massive_only else slice(None)
    Q, P = (np.reshape(each, (-1, system.rows, 3))[:, rows] for each in (q, p))
    both = Q.transpose(0, 2, 1) @ P  # sums of q_i p_j first: fewer numbers to cross
    return np.stack([both[:, i, j] - both[:, j, i] for i, j in ((1, 2), (2, 0), (0, 1))], 1)


@takes_scene
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
    A ball at 1 m from the origin that goes 0.5 m across in a step:

    >>> from skfem_cosserat import MassPoint, Model
    >>> model = Model()
    >>> ball = model.add("ball", MassPoint(2.0))
    >>> midpoint_angular_momentum(model.freeze(), [[1, 0, 0], [1, 0.5, 0]], 0.5).tolist()
    [[0.0, 0.0, 2.0]]
    """
    Q, _ = as_stack(system, "q", q)
    rate = momentum(system, np.diff(Q, axis=0) / step_size(step))
    return angular_momentum(system, (Q[1:] + Q[:-1]) / 2, rate)


@takes_scene
@of_states
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
    Two mass points:

    >>> from skfem_cosserat import MassPoint, Model
    >>> model = Model()
    >>> ball = model.add("ball", MassPoint(2.0))
    >>> dust = model.add("dust", MassPoint(1.0, position=(1, 0, 0)))
    >>> linear_momentum(model.freeze(), [1.0, 0, 0, 2.0, 0, 0]).tolist()
    [3.0, 0.0, 0.0]
    """
    return np.reshape(p, (-1, system.rows, 3))[:, system.origin_rows].sum(1)


@takes_scene
@of_states
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
    A pendulum of 1 m as it is, and with the bob at 2 m:

    >>> from skfem_cosserat import JointDistance, MassPoint, Model, ground
    >>> model = Model()
    >>> bob = model.add("bob", MassPoint(2.0, position=(0, 0, -1)))
    >>> rod = model.add("rod", JointDistance(ground((0, 0, 0)), bob.place()))
    >>> constraint_violation(model.freeze(), [[0, 0, -1.0], [0, 0, -2.0]]).tolist()
    [0.0, 1.5]
    """
    return abs(system.constraints.stacked_values(all_rows(system, q, t))).max(1, initial=0.0)


@takes_scene
@of_states
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
    A pendulum whose velocity has 3 m/s along the rod:

    >>> from skfem_cosserat import JointDistance, MassPoint, Model, ground
    >>> model = Model()
    >>> bob = model.add("bob", MassPoint(2.0, position=(0, 0, -1)))
    >>> rod = model.add("rod", JointDistance(ground((0, 0, 0)), bob.place()))
    >>> float(hidden_violation(model.freeze(), [0, 0, -1.0], [2.0, 0, 3.0]))
    3.0
    """
    found = system.constraints.stacked_values(all_rows(system, q, t), rates(system, v, t))
    return abs(found).max(1, initial=0.0)


@takes_scene
@of_states
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
    A pendulum of 2 kg whose momentum has 6 kg m/s along the rod:

    >>> from skfem_cosserat import JointDistance, MassPoint, Model, ground
    >>> model = Model()
    >>> bob = model.add("bob", MassPoint(2.0, position=(0, 0, -1)))
    >>> rod = model.add("rod", JointDistance(ground((0, 0, 0)), bob.place()))
    >>> float(momentum_violation(model.freeze(), [0, 0, -1.0], [2.0, 0, 6.0]))
    3.0
    """
    kept = np.flatnonzero(~rows_touching(system, massless(system)))
    v = mass_solver(system)(in_rows(system, np.asarray(p))).reshape(system.rows, -1, 3)
    ydot = rates(system, v.transpose(1, 0, 2), t)
    hidden = system.constraints.stacked_values(all_rows(system, q, t), ydot)[:, kept]
    return abs(hidden).max(1, initial=0.0)


@takes_scene
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
    y = as_array("y", y, system.total, 3)
    t = real("argument t", "t", t, "a time (s)")
    return -hidden_rate(system, y, t)


# -- momenta and velocities on the hidden constraints: projections, reduced momenta ----------------

ProjectionMethod: TypeAlias = Literal["saddle-point", "directors-dropped", "reduced"]


def _nearest(system: System, q: Floats, p: Floats, t: Floats) -> Floats:
    """``[[M, G^T], [G, 0]] (v, mu) = (p, -g_t)``; by kernels, if they are on disk."""
    kernels = kept_motion(system) if len(p) > 1 else None
    found = None if kernels is None else kernels(q, p)
    if found is not None:
        return found.v
    states = zip(all_rows(system, q, t), p, t.tolist(), strict=True)
    return np.array([nearest_velocity(system, *each) for each in states]).reshape(p.shape)


def _without_massless(system: System, q: Floats, p: Floats, t: Floats) -> Floats:
    """The saddle point without the rows and columns of directors that have no mass (116)."""
    out = np.zeros_like(p)
    left = massless(system)
    kept = np.flatnonzero(~left)
    rows = np.flatnonzero(~rows_touching(system, left))
    mass = full_mass(system)[kept][:, kept]
    for v, y, given, s in zip(out, all_rows(system, q, t), p, t.tolist(), strict=True):
        G = system.constraints.jacobian(y).tocsr()[rows][:, kept]
        matrix = bmat([[mass, G.T], [G, None]], format="csc")
        rhs = np.append(given[kept], hidden_rate(system, y, s)[rows])
        if len(system.closure.rows):  # rows may depend on others
            v[kept] = lstsq(matrix.toarray(), rhs)[0][: len(kept)]
        else:
            v[kept] = splu(matrix).solve(rhs)[: len(kept)]
    return out


def _reduced(system: System, q: Floats, p: Floats, t: Floats) -> Floats:
    """The velocity that has the same reduced momentum."""
    return velocity_from_reduced(system, q, reduced_momentum(system, q, p, t), t)


#: velocities (N, n) on the hidden constraints of configurations, momenta (N, n) at times (N,)
_RULES = {"saddle-point": _nearest, "directors-dropped": _without_massless, "reduced": _reduced}


@checked
class Projection:
    """Projection ``Q p = M v`` of momenta on the hidden constraints ``G v + g_t = 0`` (39), (46).

    Parameters
    ----------
    system : Model or System
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
    A pendulum of 2 kg whose momentum has 6 kg m/s along the rod:

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

    def __init__(self, system: Model | System, method: ProjectionMethod = "saddle-point"):
        if not isinstance(method, str) or method not in _RULES:
            raise InputError("argument method", f"{method!r}, expected one of {list(_RULES)}")
        self.system = system_of(system)
        self.method = method
        self._rule = partial(_RULES[method], self.system)

    def __repr__(self) -> str:
        return f"<Projection: {self.method}, n = {self.system.n}>"

    def __call__(self, q: ArrayLike, p: ArrayLike, t: float = 0.0) -> tuple[Floats, Floats]:
        """Velocity v (n,) with ``G v + g_t = 0`` and projected momentum ``Q p = M v`` (n,).

        Parameters
        ----------
        q, p : (n,) array
            Configuration and momentum (kg m/s, kg m^2/s).
        t : float
            Time (s), for prescribed motion.
        """
        q, p = (as_array(k, x, self.system.n) for k, x in (("q", q), ("p", p)))
        v = self.velocities(q, p, real("argument t", "t", t, "a time (s)"))[0]
        return v, momentum(self.system, v)

    def stack(self, q: Floats, p: Floats, t: ArrayLike) -> tuple[Floats, Floats]:
        """Velocities and projected momenta of stacks q, p (N, n) at times t (s), a number or (N,).

        Rows of p that are NaN (not known) give NaN.
        """
        v = self.velocities(q, p, t)
        return v, np.where(np.isfinite(v).all(1, keepdims=True), momentum(self.system, v), np.nan)

    def velocities(self, q: Floats, p: Floats, t: ArrayLike) -> Floats:
        """Velocities (N, n) of :meth:`stack` alone."""
        q, _ = as_stack(self.system, "q", q)
        p, _ = as_stack(self.system, "p", p, q)
        v = np.full(p.shape, np.nan)
        known = np.isfinite(p).all(1)
        some = slice(None) if known.all() else known
        v[some] = self._rule(q[some], p[some], as_times(t, len(q))[some])
        return v


@takes_scene
@of_states
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
    y = all_rows(system, q, t)
    return np.array(
        [null_space_matrix(system, a).T @ b for a, b in zip(y, np.asarray(p), strict=True)]
    )


@takes_scene
@of_states
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
    A pendulum of 2 kg:

    >>> from skfem_cosserat import JointDistance, MassPoint, Model, ground
    >>> model = Model()
    >>> bob = model.add("bob", MassPoint(2.0, position=(0, 0, -1)))
    >>> rod = model.add("rod", JointDistance(ground((0, 0, 0)), bob.place()))
    >>> system = model.freeze()
    >>> reduced = reduced_momentum(system, system.q0, [2.0, 4.0, 6.0])
    >>> velocity_from_reduced(system, system.q0, reduced).tolist()   # not along the rod
    [1.0, 2.0, 0.0]
    """
    pi = np.atleast_2d(as_floats("reduced", reduced))
    y = all_rows(system, q, t)
    mass = full_mass(system)
    out = np.full((len(y), system.n), np.nan)
    for k, s in enumerate(np.asarray(t)):
        P = null_space_matrix(system, y[k])
        if pi.shape != (len(y), P.shape[1]):
            raise InputError(
                "argument reduced",
                f"has shape {np.shape(reduced)}, expected ({P.shape[1]},) for each state",
            )
        if not np.isfinite(pi[k]).all():
            continue
        out[k] = prescribed_velocity(system, y[k, : system.rows].ravel(), s)
        if not P.shape[1]:
            continue
        try:
            out[k] += P @ splu((P.T @ mass @ P).tocsc()).solve(pi[k])
        except RuntimeError as error:  # SuperLU: exactly singular
            raise SingularMatrixError("P^T M P is singular: a motion has no inertia") from error
    return out


@takes_scene
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
    at = as_array("q", q, system.n)
    none = np.zeros(system.n)
    return nearest_velocity(system, system.extend(at, t), none, t) if system.moving else none
