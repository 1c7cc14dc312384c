"""Many states at once, tangents, and the highest frequencies that they have."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import wraps
from inspect import signature
from typing import Any, TypeVar, cast

import numpy as np
from scipy.linalg import LinAlgError, eigh
from scipy.sparse import bsr_matrix, coo_matrix, csr_matrix, diags, spmatrix
from scipy.sparse.linalg import eigsh

from ..constraints.base import RowSpace
from ..constraints.saddle import full_mass
from ..errors import InputError
from ..frames import Place
from ..kernels import cross
from ..linear import EIGENVALUES, SingularMatrixError
from ..model import System, takes_scene
from ..model.balance import Amplitudes, Balance, balance, balance_tangent
from ..model.loops import null_space_matrix
from ..types import NO_INDICES, Array, ArrayLike, Floats, numbers, real

FunctionT = TypeVar("FunctionT", bound=Callable[..., Any])

# -- states one by one or stacked: (n,) or (N, n) --------------------------------------------------


def as_stack(
    system: System, name: str, value: ArrayLike, like: Floats | None = None
) -> tuple[Floats, bool]:
    """States (N, n), as many as of `like`, and whether only one was given."""
    array = as_floats(name, value)
    if array.shape[-1:] != (system.n,) or array.ndim not in (1, 2):
        raise InputError(
            f"argument {name}", f"has shape {array.shape}, expected ({system.n},) or (N, ...)"
        )
    out = np.atleast_2d(array)
    if like is not None and out.shape != like.shape:
        raise InputError(f"argument {name}", f"has shape {array.shape}, q has {like.shape}")
    return out, array.ndim == 1


def as_floats(name: str, value: ArrayLike) -> Floats:
    """An array of numbers; one that is given is not copied."""
    if isinstance(value, np.ndarray) and value.dtype == np.float64:
        return value
    return numbers(f"argument {name}", name, value)


def as_array(name: str, value: ArrayLike, *shape: int | None) -> Floats:
    """An array of this shape, where None stands for any number of states."""
    array = as_floats(name, value)
    if array.ndim != len(shape) or any(
        size not in (None, own) for size, own in zip(shape, array.shape, strict=True)
    ):
        expected = str(shape).replace("None", "N")
        raise InputError(f"argument {name}", f"has shape {array.shape}, expected {expected}")
    return array


def of_states(function: FunctionT) -> FunctionT:
    """Let a function of many states take a single one as well, and give what it is of that.

    Its arguments q, p, v and a become (N, n), its argument t (N,).
    """
    asked = signature(function)
    states = [name for name in asked.parameters if name in ("q", "p", "v", "a")]

    @wraps(function)
    def taking(*args: Any, **kwargs: Any) -> Any:
        call = asked.bind(*args, **kwargs)
        call.apply_defaults()
        given, like, single = call.arguments, None, False
        for name in states:
            if like is None:
                like, single = as_stack(given["system"], name, given[name])
                given[name] = like
            elif given[name] is not None:
                given[name] = as_stack(given["system"], name, given[name], like)[0]
        if like is not None and "t" in given:
            given["t"] = as_times(given["t"], len(like))
        found = function(*call.args, **call.kwargs)
        return _of_the_first(found) if single else found

    return cast("FunctionT", taking)


def _of_the_first(found: Any) -> Any:
    if not isinstance(found, tuple):
        return found[0]
    own = (each[0] for each in found)
    return type(found)(*own) if hasattr(found, "_fields") else tuple(own)


def step_size(step: float) -> float:
    """The step (s) between states, of either sign."""
    out = real("argument step", "step", step, "a step (s)")
    if not np.isfinite(out) or out == 0:
        raise InputError("argument step", f"{step!r}, expected a finite step (s), not zero")
    return out


def as_times(t: ArrayLike, count: int) -> Floats:
    """One time for each state."""
    times = as_floats("t", t)
    if not np.isfinite(times).all():
        raise InputError("argument t", f"{t!r}, expected finite times (s)")
    if times.shape not in ((), (1,), (count,)):
        raise InputError("argument t", f"has shape {times.shape}, expected one time or ({count},)")
    return np.broadcast_to(times, (count,))


def all_rows(system: System, q: ArrayLike, t: ArrayLike) -> Floats:
    """All rows of y (N, total, 3) of states q (N, n) at times t (N,)."""
    return _with_ground(system, q, t, system.ground)


def rates(system: System, v: ArrayLike, t: ArrayLike) -> Floats:
    """Rates of all rows of y (N, total, 3) for velocities v (N, n) at times t (N,)."""
    return _with_ground(system, v, t, system.ground_rate)


def at_place(system: System, y: Floats, place: Place) -> Floats:
    """Position (k, 3) of a place by all rows y (k, total, 3), or its velocity by their rates."""
    return np.asarray(sum(c * y[:, a] for a, c in system.kinematics.spot_terms(system.spot(place))))


def _with_ground(
    system: System, states: ArrayLike, t: ArrayLike, ground: Callable[[float], Floats]
) -> Floats:
    own = np.reshape(states, (-1, system.rows, 3))
    out = np.empty((len(own), system.total, 3))
    out[:, : system.rows] = own
    if not system.moving:
        out[:, system.rows :] = ground(0.0)
        return out
    for row, s in zip(out, np.asarray(t).tolist(), strict=True):
        row[system.rows :] = ground(s)
    return out


# -- stiffness of a scene along its constraints: what decides on stability and small vibrations ----


@dataclass(eq=False)
class ReducedTangent:
    """Stiffness along the constraints at one configuration.

    Attributes
    ----------
    K : (unknowns, unknowns) csr_matrix
        ``P^T (dR/dy + sum_k lambda_k H_k) P``: at an equilibrium the derivative of ``P^T R`` along
        the constraints, for conservative forces the second derivative of the potential, and then
        symmetric (to rounding).
    P : (n, unknowns) csr_matrix
        Null space matrix, ``G P = 0``.
    multipliers : (m,) array
        Lambda of least norm with ``G^T lambda = -R``.
    balance : Balance
        Forces at the configuration.
    metric : (unknowns, unknowns) csr_matrix
        ``P^T diag(w) P``, w = 1/length^2 for positions and 1/2 for directors: size of a motion
        without units, that of a turn by an angle being the angle.
    """

    K: csr_matrix
    P: csr_matrix
    multipliers: Floats
    balance: Balance
    metric: csr_matrix

    @property
    def residual(self) -> Floats:
        """``P^T R`` (unknowns,): zero at an equilibrium."""
        return self.P.T @ self.balance.R.ravel()


def weights(system: System) -> Floats:
    """Weights (rows, 1) that make the square of a motion free of units, a mean over all nodes.

    ``1/length^2`` for positions and 1/2 for directors: a turn by a small angle counts as the angle.
    """
    out = np.full((system.rows, 1), 0.5)
    out[system.origin_rows] = 1 / system.length**2
    return out / len(system.origin_rows)


@takes_scene
def reduced_tangent(
    system: System, y: Floats, amplitudes: Amplitudes, at: Balance | None = None
) -> ReducedTangent:
    """Tangent stiffness along the constraints, at an equilibrium.

    Parameters
    ----------
    system : Model or System
    y : (total, 3) array
        All rows of the configuration, from :meth:`System.extend`.
    amplitudes : Amplitudes
        Of loads and actuators, with the spin of a turning frame.
    at : Balance, optional
        Forces at y, if they are known already: with the full turns of springs on angles.

    Raises
    ------
    SingularMatrixError
        In a configuration where independent constraint rows become dependent.

    Notes
    -----
    Along the constraints ``d(P^T R) = P^T dR + dP^T R``, and with ``R = -G^T lambda`` the second
    term is ``P^T (sum_k lambda_k H_k) P du``, H_k the second derivative of constraint k. It needs
    no derivative of P, and where rows are redundant any lambda that balances R will do.

    Examples
    --------
    A pendulum of 2 kg and 1 m, hanging: both swings have the stiffness m g l = 20 N m.

    >>> from skfem_cosserat import JointDistance, LoadGravity, MassPoint, Model, ground
    >>> from skfem_cosserat.model.balance import amplitudes_at
    >>> model = Model()
    >>> bob = model.add("bob", MassPoint(2.0, position=(0, 0, -1)))
    >>> rod = model.add("rod", JointDistance(ground((0, 0, 0)), bob.place()))
    >>> weight = model.add("weight", LoadGravity((0, 0, -10.0)))
    >>> system = model.freeze()
    >>> y = system.extend(system.q0, 0.0)
    >>> reduced_tangent(system, y, amplitudes_at(system, 0.0)).K.toarray().round(9).tolist()
    [[20.0, 0.0], [0.0, 20.0]]
    """
    y = as_array("y", y, system.total, 3)
    if at is None:
        at = balance(system, y, amplitudes)
    multipliers = balancing_multipliers(system, y, at.R.ravel())
    P = null_space_matrix(system, y)
    A = blocks_matrix(system, balance_tangent(system, at, amplitudes))
    A = A + curvature_matrix(system, y, multipliers)
    metric = congruent(P, diags(len(system.origin_rows) * weights(system).repeat(3)))
    return ReducedTangent(congruent(P, A), P, multipliers, at, metric)


def balancing_multipliers(system: System, y: Floats, R: Floats) -> Floats:
    """Lambda (m,) of least norm with ``G^T lambda = -R`` for a balance R (n,) at rest.

    Nothing needs to have mass. Of a force that constraints alone do not balance the norm depends on
    the units of the rows: there :func:`~skfem_cosserat.constraints.saddle.balancing` leaves the
    rest to accelerations. Once refined, as the equations are squared ones.
    """
    if not system.m:
        return np.zeros(0)
    rows = RowSpace(system, y)
    G = system.constraints.jacobian(y)
    out = rows.multipliers(-R)
    return out + rows.multipliers(-R - G.T @ out)


def congruent(P: csr_matrix, A: spmatrix) -> csr_matrix:
    """``P^T A P``."""
    return (P.T @ A @ P).tocsr()


def blocks_matrix(system: System, blocks: list[Array]) -> csr_matrix:
    """Blocks of the system's groups, then of its couplings if any, as a matrix (n, n)."""
    xyz = np.arange(3)
    pairs = 3 * system.couplings.pairs[:, :, None, None]
    places = [(group.dofs[:, :, None], group.dofs[:, None, :]) for group in system.groups]
    places.append((pairs[:, 0] + xyz[:, None], pairs[:, 1] + xyz))
    none = [(NO_INDICES, NO_INDICES, np.zeros(0))]
    each = [np.broadcast_arrays(*at, block) for at, block in zip(places, blocks, strict=False)]
    rows, cols, values = (
        np.concatenate([part.ravel() for part in parts]) for parts in zip(*none, *each, strict=True)
    )
    return coo_matrix((values, (rows, cols)), shape=(system.n, system.n)).tocsr()


def curvature_matrix(system: System, y: Floats, multipliers: Floats) -> csr_matrix:
    """``sum_k lambda_k H_k`` (n, n), H_k the second derivative of constraint k."""
    c = system.constraints
    ij = (c.curvature_rows, c.curvature_cols)
    return coo_matrix((c.curvature_values(multipliers, y), ij), shape=(system.n, system.n)).tocsr()


def material_stiffness(system: System, y: Floats) -> csr_matrix:
    """Stiffness (n, n) of all beams at configuration y, as if there were no stresses."""
    blocks = system.empty_tangent()
    for k, (group, (eps, B)) in enumerate(zip(system.beam_groups, system.strain(y), strict=True)):
        blocks[k] = group.parts(B, B, np.zeros_like(eps), 1.0, 0.0, group.moduli(eps)).blocks()
    return blocks_matrix(system, blocks)


# --------------------------------------------------------------------------------------------------
# Frequencies that limit steps: the highest of the elastic vibrations, that of the constraints.


@takes_scene
def highest_frequency(system: System, q: ArrayLike | None = None) -> float:
    """Highest natural frequency of the elastic vibrations about a configuration.

    Largest eigenvalue of ``P^T K P`` against ``P^T M P``, with the material stiffness
    ``K = int B^T D B ds`` of the beams: stresses change the highest frequencies little.

    Parameters
    ----------
    system : Model or System
        Springs and bushings are left out.
    q : (n,) array, optional
        Configuration; default: the reference.

    Returns
    -------
    float
        Angular frequency (rad/s), zero without beams.

    Raises
    ------
    InputError
        If the shape of `q` does not fit the system.
    SingularMatrixError
        If a motion has no inertia.

    Examples
    --------
    Axial waves in steel: ``2 sqrt(3)/l sqrt(E/rho)`` for elements of length l and, here, the
    highest of all:

    >>> from skfem_cosserat import Beam, Material, MeshCurve, Model, SectionRectangle
    >>> steel = Material(210e9, 0.3, 7850.0)
    >>> mesh = MeshCurve.init_line((0, 0, 0), (1, 0, 0), 10)
    >>> model = Model()
    >>> bar = model.add("bar", Beam(mesh, SectionRectangle(0.5, 0.5, steel), director=(0, 1, 0)))
    >>> omega = highest_frequency(model.freeze())
    >>> bool(0.95 < omega / (2 * 3**0.5 / 0.1 * (210e9 / 7850) ** 0.5) < 1.001)
    True
    """
    where = as_array("q", system.q0 if q is None else q, system.n)
    if not system.beam_groups or not system.unknowns:
        return 0.0
    y = system.extend(where, 0.0)
    P = null_space_matrix(system, y)
    K = congruent(P, material_stiffness(system, y))
    return float(np.sqrt(max(_largest(K, congruent(P, full_mass(system)))[0], 0.0)))


def _largest(K: csr_matrix, M: csr_matrix) -> tuple[float, Floats]:
    """The largest eigenvalue of K against M, and its vector."""
    size = K.shape[0]
    try:
        if size <= EIGENVALUES:
            value, shape = eigh(K.toarray(), M.toarray(), subset_by_index=[size - 1, size - 1])
        else:
            start = np.random.default_rng(0).normal(size=size)
            value, shape = eigsh(K, 1, M.tocsc(), which="LA", tol=1e-6, v0=start)
    except (RuntimeError, LinAlgError) as error:
        text = f"no highest frequency is found, as where a motion has no inertia: {error}"
        raise SingularMatrixError(text) from error
    return value[0], shape


@takes_scene
def constraint_frequency(system: System, q: Floats, constraint_force: Floats) -> float:
    """The omega_c (rad/s) whose product with the step must stay below 2 (variational scheme).

    Rotations of nodes that alternate from step to step have no stress at midpoints, where that
    scheme looks. Inertia holds them, the constraint force of compressed beams drives them: above
    the limit they grow.

    Largest eigenvalue of ``K_c`` against M over the rotations of all frames, where
    ``theta.K_c theta = sum (f_i.theta)(d_i.theta) - |theta|^2 f_i.d_i`` is the second variation of
    the work that the constraint force -f does on the directors (compressed beams: positive).

    Parameters
    ----------
    system : Model or System
    q, constraint_force : (n,) array
        At a node, the force as ``history["constraint_force"]`` has it.

    Returns
    -------
    float
        Zero where nothing drives them.

    Raises
    ------
    InputError
        If the shape of an array does not fit the system, or the force is not finite.
    SingularMatrixError
        If a rotation has no inertia.

    Examples
    --------
    A bar under tension; at its start, where nothing has been solved yet, there is no force:

    >>> from skfem_cosserat import Beam, Material, MeshCurve, Model, SectionRectangle
    >>> steel = Material(210e9, 0.3, 7850.0)
    >>> mesh = MeshCurve.init_line((0, 0, 0), (1, 0, 0), 2)
    >>> model = Model()
    >>> bar = model.add("bar", Beam(mesh, SectionRectangle(0.1, 0.1, steel), director=(0, 1, 0)))
    >>> system = model.freeze()
    >>> constraint_frequency(system, system.q0, np.zeros(system.n))
    0.0
    """
    q = as_array("q", q, system.n)
    constraint_force = as_array("constraint_force", constraint_force, system.n)
    if not np.isfinite(constraint_force).all():
        raise InputError("argument constraint_force", "is not finite")
    return driven_alternation(system, q, constraint_force)[0]


def driven_alternation(system: System, q: Floats, constraint_force: Floats) -> tuple[float, int]:
    """The frequency of :func:`constraint_frequency`, and the row of the frame that turns most."""
    rows = system.kinematics.director_rows
    d = q.reshape(-1, 3)[rows]
    A = np.einsum("nia,nib->nab", -constraint_force.reshape(-1, 3)[rows], d)
    blocks = (A + A.transpose(0, 2, 1)) / 2 - np.trace(A, 0, 1, 2)[:, None, None] * np.eye(3)
    # rates of directors for unit rotations of their frames
    turned = cross(np.eye(3), d[:, :, None])
    to = 3 * rows[..., None, None] + np.arange(3)
    of = np.arange(3 * len(rows)).reshape(-1, 1, 3, 1)
    where = [each.ravel() for each in np.broadcast_arrays(to, of)]
    T = csr_matrix((turned.ravel(), where), (len(q), 3 * len(rows)))
    K = bsr_matrix((blocks, np.arange(len(rows)), np.arange(len(rows) + 1)), 2 * T.shape[1:])
    value, shape = _largest(K, congruent(T, full_mass(system)))
    most = np.linalg.norm(shape.reshape(-1, 3), axis=1).argmax()
    return float(np.sqrt(max(value, 0.0))), int(rows[most, 0]) - 1
