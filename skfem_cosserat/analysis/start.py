"""Start states: checked, also from rates of joints, or carried over from another mesh."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.linalg import cholesky, lstsq, null_space, qr, solve_triangular
from scipy.sparse import bmat, csr_matrix
from scipy.sparse.linalg import splu

from .. import diagnostics
from ..constraints.saddle import full_mass, nearest_momentum, nearest_velocity
from ..diagnostics import section_strain_rates
from ..diagnostics.error import new_rows, spins, transfer
from ..diagnostics.joint_motion import reading_of
from ..diagnostics.nearest import (
    PIECES,
    motions_out_of_plane,
    nearest_configuration,
    rigid_motions,
    rigid_pieces,
    settled,
)
from ..diagnostics.stacked import material_stiffness, null_space_matrix
from ..errors import InputError, ModelWarning
from ..integrators import State
from ..model import Model, System, system_of, takes_scene
from ..model.balance import amplitudes_at, balance
from ..model.limits import broken_constraint, constraint_owner, owner
from ..types import TOLERANCE, ArrayLike, Floats, finite, largest, numbers, positive, shown
from ..warn import warn

# -- velocities from rates of joint coordinates: initial conditions in reduced form ----------------

#: inertia of motions of rigid pieces, relative, that keeps those regular which have none
ZERO = 1e-12
#: relative, how well rigid pieces have to fulfil what is asked for
COMPATIBLE = 1e-8
#: strain rate, relative to the motion and to the largest one, above which a beam is named
NOTABLE = 1e-6


def _with_joint_rates(
    system: System, q: Floats, v: Floats, rates: dict[str, float], t: float
) -> Floats:
    """Velocity nearest to v with given rates of joint coordinates, strains held.

    It fulfils the hidden constraints: loops and drives included. See
    :func:`~skfem_cosserat.project`.
    """
    y = system.extend(q, t)
    nearest = nearest_velocity(system, y, diagnostics.momentum(system, v), t)
    if not rates:
        return nearest
    slopes = np.array([_gradient(system, name, y) for name in rates])
    wanted = np.array(list(rates.values()))
    rows = system.rows
    impulses = slopes[:, :rows].reshape(len(rates), -1)
    given = wanted - (slopes[:, rows:] * system.ground_rate(t)).sum((1, 2)) - impulses @ nearest
    # how the scene answers to a unit impulse on each coordinate
    answers = np.array([nearest_velocity(system, y, impulse, None) for impulse in impulses])
    gram = impulses @ answers.T
    size = np.sqrt(np.maximum(np.diagonal(gram), 0.0))  # zero for what a drive holds
    scale = 1 / np.where(size > 1e-12 * size.max(initial=1e-300), size, 1.0)
    weights = np.linalg.lstsq(scale[:, None] * gram * scale, scale * given, rcond=1e-10)[0]
    miss = given - gram @ (scale * weights)
    worst = abs(miss).argmax()
    if abs(miss[worst]) > 1e-8 * max(1.0, largest(wanted)):
        raise InputError(
            "initial state",
            f"rates: {list(rates)[worst]!r} cannot have the rate {wanted[worst]:.6g} together with"
            f" the joints and the other rates (off by {miss[worst]:.6g})",
        )
    lightest = nearest + (scale * weights) @ answers
    if not system.beam_groups:
        return lightest
    # a scene at rest is to have no strain rates at all, what moves already those that it has
    base = nearest if v.any() else np.zeros(system.n)
    label, pieces = rigid_pieces(system, joined=True)
    if len(pieces) > PIECES:
        change = lightest - base
        why = f"more than {PIECES} rigid pieces are too many to find a motion without strains"
    else:
        rigid = rigid_motions(system, y, label, len(pieces))[0]
        change = _least_strained(system, y, rigid, impulses, lightest - base)
        why = (
            "with these rates joints and prescribed motion do not let all beams keep their strains"
        )
    _tell(system, q, change, list(rates), why)
    return base + change


def _least_strained(
    system: System, y: Floats, rigid: csr_matrix, slopes: Floats, start: Floats
) -> Floats:
    """The change of a velocity whose strain rates have the least energy, then the kinetic one.

    Energy is that in the stiffness of the sections.

    Parameters
    ----------
    y : (total, 3) array
        All rows of the configuration.
    rigid : (n, k) csr_matrix
        Motions of rigid pieces.
    slopes : (j, n) array
        Derivatives of the joint coordinates whose rates are given.
    start : (n,) array
        Any change that has these rates and fulfils the hidden constraints.
    """
    P = null_space_matrix(system, y)
    S = material_stiffness(system, y)
    M = full_mass(system)
    # of motions of pieces with unit kinetic energy those that joints, rates and a plane allow
    there = np.flatnonzero((rigid.T @ M @ rigid).diagonal() > 0)  # a mass point has no rotations
    E = rigid[:, there].toarray()
    mass = E.T @ M @ E
    unit = solve_triangular(cholesky(mass + np.diag(ZERO * np.diagonal(mass))), np.eye(len(mass)))
    E = E @ unit
    out_of = motions_out_of_plane(system, rigid.shape[1] // 6)[:, there] @ unit
    wanted = np.vstack([system.constraints.jacobian(y)[system.internal :].toarray(), slopes])
    asked = np.vstack([wanted @ E, out_of])
    values = np.append(wanted @ start, np.zeros(len(out_of)))
    u = lstsq(asked, values, cond=TOLERANCE, lapack_driver="gelsy")[0]
    if abs(asked @ u - values).max() <= COMPATIBLE * abs(values).max():
        return E @ u
    idle = E @ null_space(asked, rcond=TOLERANCE)
    rows = np.vstack([slopes @ P, (M @ idle).T @ P])
    values = np.concatenate([np.zeros(len(slopes)), -(idle.T @ (M @ start))])
    size = np.linalg.norm(rows, axis=1)
    rows = rows / size[:, None]
    values = values / size
    _, R, order = qr(rows.T, pivoting=True, mode="economic")
    diagonal = abs(np.diag(R))
    chosen = order[: (diagonal > TOLERANCE * diagonal.max(initial=0.0)).sum()]
    K = P.T @ S @ P
    scale = largest(K.data) or 1.0
    B = csr_matrix(scale * rows[chosen])
    solve = splu(bmat([[K, B.T], [B, None]], format="csc")).solve
    rhs = np.concatenate([-(P.T @ (S @ start)), scale * values[chosen]])
    return start + P @ solve(rhs)[: P.shape[1]]


def _tell(system: System, q: Floats, change: Floats, names: list[str], why: str) -> None:
    """Say which beams cannot keep their strains, if that is more than what q is off its joints."""
    sizes = {}
    for beam in system.beams:
        sizes[beam.label] = largest(section_strain_rates(system, beam, q, change))
    motion = abs(change.reshape(-1, 3))
    motion[system.origin_rows] /= system.length
    most = max(sizes.values())
    if most <= NOTABLE * motion.max():
        return
    lagging = [label for label, size in sizes.items() if size > NOTABLE * most]
    warn(
        "argument rates",
        f"{', '.join(map(repr, names))}: {why}, so {', '.join(lagging[:4])}"
        f"{' and others' if len(lagging) > 4 else ''} start with strain rates up to {most:.3g}"
        " (1/s, 1/(m s)), see project()",
        ModelWarning,
    )


def _gradient(system: System, key: str, y: Floats) -> Floats:
    """Derivatives (total, 3) of a coordinate, "joint" or "joint/coordinate", by all rows."""
    named = {joint.name: joint for joint in system.joints}
    name, _, coordinate = (key, "", None) if key in named else key.rpartition("/")
    if name not in named:
        known = sorted(map(str, named))
        raise InputError("initial state", f"rates: no joint {key!r}; known: {known}")
    reading = reading_of(system, named[name], coordinate)
    own = reading.coordinate
    if own.size != 1:
        raise InputError(
            "initial state",
            f"rates: the {own.name} of the {named[name].label} has {own.size} components,"
            " only angles and displacements can be given",
        )
    return reading.gradient(y)


# -- where a run starts: from the items, from given states, from the end of a history --------------

#: relative violation of constraints that a state may have which was put together, and one that
#: steps led to: with loose settings they leave more
GIVEN, SOLVED = 1e-6, 1e-3
ALONG = (
    "Constraints take what is along them in the first step; steps of a run lead on from their state"
    " without this warning, and so does restart()"
)


@takes_scene
def project(
    system: System,
    q: ArrayLike,
    v: ArrayLike | None = None,
    t: float = 0.0,
    rates: Mapping[str, float] | None = None,
) -> Floats:
    """Velocity nearest to v (in the kinetic energy) that fulfils the hidden constraints.

    It is the v of the saddle point with ``p = M v``, see
    :class:`~skfem_cosserat.Projection` and equations (39), (46).

    With rates beams and bodies move along with their joints as rigid ones, strains held: of all
    such changes of v it is the one of least kinetic energy. Where joints and prescribed motion do
    not let all strains be held, as in a loop closed by a beam clamped on both sides, it is that
    whose strain rates have the least energy in the stiffness of the sections, then the least
    kinetic energy, and a :class:`ModelWarning` names the beams that are strained; so it does where
    there are more than 400 pieces, and only the kinetic energy counts. Springs and bushings hold
    nothing here.

    Parameters
    ----------
    q : (n,) array
        Configuration (m, -).
    v : (n,) array, optional
        Velocity (m/s, 1/s); default: rest. With rates its own strain rates stay.
    t : float
        Time (s), at which a prescribed motion is taken.
    rates : dict of str to float, optional
        Rates (rad/s, m/s) that joint coordinates are to have: by the joint's name, or
        ``"joint/coordinate"`` if it has several.

    Returns
    -------
    (n,) array
        Velocity with ``G(q) v + g_t = 0``, for :func:`initial_state`.

    Raises
    ------
    InputError
        If the mechanism cannot move with these rates, or there is no such joint or coordinate.

    Examples
    --------
    A pendulum: the velocity along the rod is taken off:

    >>> from skfem_cosserat import JointDistance, MassPoint, Model, ground
    >>> model = Model()
    >>> bob = model.add("bob", MassPoint(2.0, position=(0, 0, -1)))
    >>> rod = model.add("rod", JointDistance(ground((0, 0, 0)), bob.place()))
    >>> system = model.freeze()
    >>> project(system, system.q0, [1.0, 0, 3.0]).tolist()   # not along the rod
    [1.0, 0.0, 0.0]
    """
    velocity = np.zeros(system.n) if v is None else _checked(system, "v", v, "projection")
    configuration = _checked(system, "q", q, "projection")
    wanted = _given(rates)
    t = finite("project", "t", t)
    return _with_joint_rates(system, configuration, velocity, wanted, t)


def _given(rates: object) -> dict[str, float]:
    """Rates by the names of joints."""
    if rates is None:
        return {}
    if not isinstance(rates, Mapping) or not all(isinstance(name, str) for name in rates):
        raise InputError("argument rates", f"{rates!r}, expected a dict of joints and rates")
    each = rates.items()
    return {k: finite("argument rates", f"{k!r}", rate) for k, rate in each}


@takes_scene
def initial_state(
    system: System,
    q: ArrayLike | None = None,
    v: ArrayLike | None = None,
    p: ArrayLike | None = None,
    time: float = 0.0,
    tolerance: float = 1e-8,
    *,
    nu: ArrayLike | None = None,
    rates: Mapping[str, float] | None = None,
) -> State:
    """Start from (q, v), (q, p) or (q, nu); default: reference and the items' initial velocities.

    Parameters
    ----------
    q, v, p : (n,) array, optional
        Configuration (m, -), and velocity (m/s, 1/s) *or* momentum (kg m/s, kg m^2/s).
    time : float
        Start (s).
    tolerance : float
        Largest relative violation of the constraints and the hidden constraints. (Runs start from
        states with no more than 1e-6.)
    nu : (unknowns,) array, optional
        Reduced velocity instead of v or p: ``v = P(q) nu + qdot_prescribed`` with the null space
        matrix ``system.null_space(q, time)`` (m/s of translations, rad/s of rotations), see
        :func:`~skfem_cosserat.diagnostics.prescribed_velocity`.
    rates : dict of str to float, optional
        Rates of joint coordinates (rad/s, m/s) instead of v, p or nu: what hangs on a joint moves
        along, strains held, the rest as little as that allows, see :func:`project`.

    Raises
    ------
    InputError
        If q violates the constraints, or v or p the hidden ones ``G v + g_t = 0``;
        :func:`project` gives the nearest velocity that does not. If more than one of v, p, nu and
        rates is given, or the mechanism cannot move with the rates.

    Examples
    --------
    >>> from skfem_cosserat import Model, MassPoint
    >>> model = Model()
    >>> ball = model.add("ball", MassPoint(2.0, velocity=(1.0, 0, 0)))
    >>> initial_state(model.freeze()).p.tolist()
    [2.0, 0.0, 0.0]
    >>> initial_state(model.freeze(), nu=[0, 3.0, 0]).p.tolist()
    [0.0, 6.0, 0.0]
    """
    if sum(value is not None for value in (v, p, nu, rates)) > 1:
        raise InputError("initial state", "give v or p or nu or rates, only one of them")
    q = system.q0.copy() if q is None else _checked(system, "q", q)
    time = finite("initial state", "time", time)
    tolerance = positive("initial state", "tolerance", tolerance)
    y = system.extend(q, time)
    wrong = broken_constraint(system, y, tolerance)
    if wrong:
        raise InputError("initial state", f"q at t = {time:g} s {wrong}")
    if system.plane is not None:
        system.plane.check("initial state", "q", q, system.origin_rows, system.q0)
    if p is not None:
        p = _checked(system, "p", p)
        wrong = broken_momentum(system, q, p, time, tolerance)
        if wrong:
            raise InputError("initial state", f"p {wrong}")
        if system.plane is not None:
            system.plane.check("initial state", "p", p, system.origin_rows, power=1)
        return State(time, 0, q, p)
    if nu is not None:
        start = diagnostics.prescribed_velocity(system, q, time)
        nu = _checked(system, "nu", nu, size=system.unknowns)
        v = system.null_space(q, time) @ nu + start
    if rates is not None:
        v = project(system, q, None, time, rates)
    v = system.v0.copy() if v is None else _checked(system, "v", v)
    _check_velocity(system, y, v, time, tolerance)
    if system.plane is not None:
        system.plane.check("initial state", "the velocity", v, system.origin_rows)
    return State(time, 0, q, diagnostics.momentum(system, v))


def _check_velocity(system: System, y: Floats, v: Floats, time: float, tolerance: float) -> None:
    """``G v + g_t = 0``, each row compared with the size of its terms."""
    hidden = abs(system.constraints.rate(y, v) + diagnostics.ground_part(system, y, time))
    rate, error = system.ground_rate_and_error(time)
    rates = np.concatenate([v.reshape(-1, 3), rate])
    # the rate of a prescribed motion is known to a difference quotient's error only
    floor = 4 * error + (1e-11 * system.length if system.moving else 0.0)
    # what is held at rest in a moving scene has rates of rounding size only
    rounding = 1e-13 * system.constraints.magnitudes(y, np.full_like(rates, largest(rates)))
    excess = hidden - tolerance * system.constraints.magnitudes(y, rates) - floor - rounding
    if excess.max(initial=0.0) > 0:
        row = excess.argmax()
        raise InputError(
            "initial state",
            f"the velocity violates the hidden constraint of {constraint_owner(system, row)} at"
            f" t = {time:g} s by {hidden[row]:.6g} (initial velocity against joints or prescribed"
            " motion): use project(system, q, v)",
        )


def broken_momentum(
    system: System, q: Floats, p: Floats, time: float, tolerance: float
) -> str | None:
    """Words on how far p is off the hidden constraints; None: not by more than the tolerance."""
    miss = abs(nearest_momentum(system, system.extend(q, time), p, time) - p)
    allowed = max(tolerance * largest(p), 1e-13)
    if system.moving:  # as far as rates of the ground are known
        rate = 4 * system.ground_rate_and_error(time)[1] + 1e-11 * system.length
        allowed += rate * float(abs(system.mass).sum(1).max())
    if not miss.max(initial=0.0) > allowed:
        return None
    row = int(miss.argmax())
    return (
        f"violates the hidden constraints by {miss[row]:.3g} kg m/s at"
        f" {owner(system, row // 3).label}, as velocities against joints or prescribed motion do:"
        " project it with Projection(system)(q, p, t)[1]"
    )


def checked_start(system: System, start: State, item: str = "argument start") -> State:
    """A state whose arrays belong to the system."""
    if not isinstance(start, State):
        raise InputError(item, f"{start!r}, expected a State, see initial_state")
    for name, array in (("q", start.q), ("p", start.p)):
        _checked(system, name, array, item)
    if system.plane is not None:
        origins = system.origin_rows
        system.plane.check(item, "its configuration", start.q, origins, system.q0)
        triads = origins[system.is_frame][:, None] + np.arange(1, 4)
        system.plane.check_momentum(item, start.p, system.q0, origins, triads)
    return start


def consistent_start(system: System, start: State, item: str = "argument start") -> State:
    """A state to step from: it belongs to the system, q and p fulfil what they have to.

    A state that steps led to has the momentum of their scheme, which may be off the hidden
    constraints, and constraints as well as it was asked to solve them. Another one whose momentum
    is off them gets a warning: what the momentum has along ``G^T`` only adds to the first
    multipliers, and momenta of the variational scheme, turned round for example, have such parts.
    """
    checked_start(system, start, item)
    made = start.made_by is not None
    wrong = broken_constraint(system, system.extend(start.q, start.time), SOLVED if made else GIVEN)
    if wrong:
        raise InputError(item, f"q at t = {start.time:g} s {wrong}")
    if made or not start.fresh:
        return start
    wrong = broken_momentum(system, start.q, start.p, start.time, GIVEN)
    if wrong:
        warn(item, f"p at t = {start.time:g} s {wrong}. {ALONG}", ModelWarning)
    return start


def _checked(
    system: System,
    name: str,
    value: ArrayLike,
    item: str = "initial state",
    size: int | None = None,
) -> Floats:
    array = numbers(item, name, value)
    shape = (system.n if size is None else size,)
    if array.shape != shape:
        given = f"{name} = {shown(value)} has shape {array.shape}"
        raise InputError(item, f"{given}, expected {shape}")
    if not np.isfinite(array).all():
        raise InputError(item, f"{name} is not finite at {np.flatnonzero(~np.isfinite(array))[:5]}")
    return array


# -- states carried over to a system of the same scene on other meshes, or with other theories -----


def carry_state(source: Model | System, target: Model | System, state: State) -> State:
    """A state of one system in another one with other meshes, orders or theories of its beams.

    Configuration and velocity go over by :func:`skfem_cosserat.diagnostics.transfer`: nodes that
    are in both systems keep them. New nodes are then brought into balance between those, with the
    loads and accelerations of that instant: left where they were interpolated, stiff motions
    (shear, extension) would get energy of their own.

    Where beams of `target` hold strains (:class:`skfem_cosserat.Theory`) it is the nearest
    configuration without these, the one that changes the other strains least, and the nearest
    velocity in the kinetic energy; the centre of mass and the linear momentum of a scene in free
    flight stay what they are. What `source` holds and `target` does not starts without strain:
    its forces, which were multipliers, have to build up anew, and vibrations with them. Begin such
    runs where these forces are small, or damp them.

    Parameters
    ----------
    source, target : Model or System
        Of the same scene, see :meth:`skfem_cosserat.Beam.refined`; with any theories.
    state : State
        Of `source`.

    Returns
    -------
    State
        Of `target`, for a run or a path that goes on from there. Its momentum is that of the
        velocity on the hidden constraints.

    Raises
    ------
    InputError, MeshError
        If the systems do not belong together, or a beam is bent, drawn or twisted too far for what
        it is to hold: named with both theories.

    Examples
    --------
    >>> from skfem_cosserat import Beam, MeshCurve, Model, Section, initial_state
    >>> section = Section([1e4, 1e4, 1e4, 500, 500, 500], mass=1.0, inertia=(10.0, 10.0))
    >>> beam = Beam(MeshCurve.init_line((0, 0, 0), (0, 2, 0), 4), section, velocity=(3.0, 0, 0))
    >>> systems = []
    >>> for item in (beam.refined([3]), beam):
    ...     model = Model()
    ...     rod = model.add("rod", item)
    ...     systems.append(model.freeze())
    >>> fine, coarse = systems
    >>> state = carry_state(coarse, fine, initial_state(coarse))
    >>> bool(abs(state.p - initial_state(fine).p).max() < 1e-12)
    True
    """
    source = system_of(source, "argument source")
    target = system_of(target, "argument target")
    checked_start(source, state)
    v = nearest_velocity(source, source.extend(state.q, state.time), state.p, state.time)
    q, v = transfer(source, target, state.q, v)
    q, v = _settled(source, target, state.q, q, v, state.time)
    q, v = _held(source, target, q, v, state.time)
    p = diagnostics.momentum(target, v)
    return State(state.time, state.index, q, p, True, state.turns, load_factor=state.load_factor)


def _settled(
    source: System, target: System, before: Floats, q: Floats, v: Floats, t: float
) -> tuple[Floats, Floats]:
    """With new nodes in balance between the others, and turning as they did.

    Their accelerations are interpolated from those that the forces cause in `source` at `before`.
    """
    loads = amplitudes_at(source, t)
    y = source.extend(before, t)
    a = nearest_velocity(source, y, -balance(source, y, loads).R.ravel(), None)
    inertia = diagnostics.momentum(target, transfer(source, target, before, a)[1])
    rows = new_rows(source, target)
    y = target.extend(q, t)
    rest = settled(target, y, amplitudes_at(target, t), rows, inertia)
    rates = v.reshape(-1, 3).copy()
    rates[rows[:, 1:]] = np.cross(spins(y[rows], rates[rows])[:, None], rest[rows[:, 1:]])
    return rest[: target.rows].ravel(), rates.ravel()


def _held(source: System, target: System, q: Floats, v: Floats, t: float) -> tuple[Floats, Floats]:
    """Without the strains that beams of the target hold.

    Raises
    ------
    InputError
        Naming a beam with its theories in both systems.
    """
    if not target.theory_rows:
        return q, v
    y = target.extend(q, t)
    found = nearest_configuration(target, y)
    if found is None:
        g = abs(target.constraints.values(y))
        worst = max(target.theory_rows, key=lambda rows: float(g[rows.rows].max()))
        known = {beam.name: beam.theory for beam in source.beams}
        raise InputError(
            worst.beam.label,
            f"its state with {known[worst.beam.name]!r} cannot be carried over to"
            f" {worst.beam.theory!r}: no configuration near it is without the strains that this"
            " theory holds",
        )
    return found[: target.rows].ravel(), nearest_velocity(
        target, found, diagnostics.momentum(target, v), t
    )
