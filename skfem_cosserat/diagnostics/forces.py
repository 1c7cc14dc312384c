"""Resultants of sections and forces of joints."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..constraints import Treatment
from ..constraints.saddle import accelerations as by_motion
from ..constraints.saddle import balancing
from ..errors import InputError
from ..history import History
from ..integrators import Integrator, State, Stepper
from ..kernels import beam_stress, cross, section_moduli
from ..linear import SingularMatrixError
from ..model import System, takes_scene
from ..model.balance import Spin
from ..model.limits import overstretched_beam
from ..model.system import JointRows
from ..types import Array, ArrayLike, Floats, IndexArray, switch
from .energy import free_strains, group_of, held_forces, load_factors, section_strains
from .stacked import all_rows, as_array, as_stack, of_states

if TYPE_CHECKING:
    from ..beam import Beam

# -- section forces and moments at the nodes, from the balance of each element ---------------------


@takes_scene
@of_states
def nodal_resultants(
    system: System,
    beam: Beam,
    q: ArrayLike,
    t: ArrayLike = 0.0,
    *,
    amplitudes: ArrayLike | None = None,
    v: ArrayLike | None = None,
    a: ArrayLike | None = None,
    multipliers: ArrayLike | None = None,
) -> Floats:
    """``(N_1, N_2, N_3, M_1, M_2, M_3)`` at both ends of each element, from its nodal forces.

    What an element passes on at its end nodes: ``int B^T S ds``, less the consistent nodal forces
    of line loads and gravity on this element and, if given, of its damping and inertia. Forces are
    the rows of phi, moments ``sum d_i x f_{d_i}``. In equilibrium they balance exactly, node by
    node and element by element, and converge with h^(2p), where the stresses themselves do with
    h^(p+1) at Gauss points.

    Parameters
    ----------
    beam : Beam
        Of this system.
    q : (n,) or (N, n) array
        Configurations; in equilibrium, or moving with `a`.
    t : float or (N,) array
        Their times (s), for loads that depend on it.
    amplitudes : (k,) or (N, k) array, optional
        Factors of the channels of ``system.loading`` instead of those at `t`.
    v : (n,) or (N, n) array, optional
        Velocities: adds the forces of viscous sections and of Rayleigh damping (m/s, 1/s).
    a : (n,) or (N, n) array, optional
        Accelerations: adds ``M a`` of the element (m/s^2, 1/s^2). In a run with the step h,
        ``(q[k+1] - 2 q[k] + q[k-1]) / h**2``: forces then balance to second order in h. In steady
        rotation, the centripetal ones of all rows.
    multipliers : (m,) or (N, m) array, optional
        As of :func:`multipliers`, at the same configurations: the resultants of strains that the
        beam's theory holds. NaN without.

    Returns
    -------
    (ne, 2, 6) or (N, ne, 2, 6) array
        At the start and the end of each element, in the section triad there, on the face with
        outward normal +d3; tension positive (N, N m). They jump between elements where a
        force, body or joint acts on the node.

    Raises
    ------
    InputError
        If the beam is not in the system or shapes do not fit.

    Examples
    --------
    A cantilever of one element, 2 m long, drawn by 100 N:

    >>> import skfem_cosserat as sc
    >>> model, mesh = sc.Model(), sc.MeshCurve.init_line((0, 0, 0), (2, 0, 0), 1, name="rod")
    >>> rod = model.add("rod", sc.Beam(mesh, sc.Section([1e4] * 6, 1.0, (10.0, 10.0))))
    >>> clamp = model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), rod.node("rod.start")))
    >>> pull = model.add("pull", sc.LoadForce(rod.node("rod.end"), (100.0, 0, 0)))
    >>> q = sc.static(model)["q"][-1]
    >>> (nodal_resultants(model, rod, q)[0, :, :3].round(6) + 0.0).tolist()
    [[0.0, 0.0, 100.0], [0.0, 0.0, 100.0]]
    """
    (found,) = element_balances(system, [beam], q, t, amplitudes, v, a, multipliers)
    return _at_ends(beam, found)


def _at_ends(beam: Beam, found: Balances) -> Floats:
    """Forces and moments (N, ne, 2, 6) in section triads at both ends of each element."""
    nodal, _, force = found
    turned = beam.rotations @ nodal[..., 1:, :]
    ends = (components(turned[:, :, k], *_passed_on(force, nodal, k)) for k in (0, -1))
    return np.stack([*ends], 2)


@takes_scene
def end_forces(system: System, history: History) -> dict[str, tuple[Floats, Floats]]:
    """Forces and strains at both ends of each element, of all beams and states of a history.

    They are the series ``beam/NAME/nodal_resultant`` and ``beam/NAME/nodal_strain``.

    Parameters
    ----------
    history : History
        Of a run of this system, of a path of equilibria or of a mode.

    Returns
    -------
    dict of str to (resultants, strains)
        By the names of beams, (N, ne, 2, 6) each. Resultants are those of
        :func:`nodal_resultants`, in motion with :func:`accelerations` (N, N m). Strains are those
        that the sections have under them (-, 1/m), so that they converge as fast.

    Examples
    --------
    A rod of 2 m that hangs from one end and weighs 10 N/m:

    >>> import skfem_cosserat as sc
    >>> model, mesh = sc.Model(), sc.MeshCurve.init_line((0, 0, 0), (0, 0, -2), 1, name="rod")
    >>> section = sc.Section([1e6] * 6, 1.0, (0.1, 0.1))
    >>> rod = model.add("rod", sc.Beam(mesh, section, director=(1, 0, 0)))
    >>> clamp = model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), rod.node("rod.start")))
    >>> weight = model.add("weight", sc.LoadGravity((0, 0, -10.0)))
    >>> forces, strains = end_forces(model, sc.static(model))["rod"]
    >>> (forces[-1, 0, :, 2].round(6) + 0).tolist(), float(strains[-1, 0, 0, 2].round(9))
    ([20.0, 0.0], 2e-05)
    """
    out = {}
    if "increment" in history:  # a mode is linear in its motion, of which a small one is taken
        one, two = (end_forces(system, _shrunk(history, size)) for size in (-SMALL, SMALL))
        for name, both in one.items():
            pairs = zip(both, two[name], strict=True)
            force, strain = ((a + b) / 2 + (b - a) / (2 * SMALL) for a, b in pairs)
            out[name] = force, strain
        return out
    q = history["q"]
    motion = motion_of(system, history)
    factors = load_factors(system, motion[0], motion[1], len(history))
    for group in system.beam_groups:
        beams = [beam for beam in system.beams if id(beam) in group.slices]
        balances = element_balances(system, beams, q, *motion, viscous=False)
        for beam, found in zip(beams, balances, strict=True):
            forces = _at_ends(beam, found)
            free = free_strains(system, beam, factors)
            strains = _strains_under(beam, section_strains(system, beam, q), free, forces)
            out[str(beam.name)] = forces, strains
    return out


def _shrunk(history: History, size: float) -> History:
    """The motion of a mode, of another size."""
    names = "t", "step", "p", "multipliers", "amplitudes/loads", "amplitudes/spin"
    series = {name: history[name] for name in names}
    series |= {name: size * history[name] for name in ("v", "acceleration")}
    series["q"] = history.static["equilibrium"] + size * history["increment"]
    return History(history.meta, history.static, series)


def motion_of(system: System, history: History) -> tuple[Any, ...]:
    """Times, factors of loads, velocities, accelerations and multipliers of a history's states.

    As :func:`element_balances` takes them; of equilibria and of modes there are no velocities.
    """
    q = history["q"]
    if "amplitudes/loads" not in history:
        v = history["v"]
        t = history.times
        return t, None, v, *accelerations(system, q, v, t, history.series.get("turns"))
    a = np.array(history["acceleration"]) if "acceleration" in history else np.zeros_like(q)
    for row, y, v, spin in zip(a, q, history["v"], history["amplitudes/spin"], strict=True):
        if spin.any():
            turned = Spin(*spin).rates(system, y.reshape(-1, 3)) + 2 * v.reshape(-1, 3)
            row += np.cross(spin[0], turned).ravel()
    return 0.0, history["amplitudes/loads"], None, a, history["multipliers"]


def _strains_under(beam: Beam, strains: Floats, free: Floats, forces: Floats) -> Floats:
    """Strains (N, ne, 2, 6) of the sections at both ends of each element under forces there.

    Newton's method, one step for a constant stiffness, begins with what the strains (N, ne, ng, 6)
    at Gauss points, and those of loads (`free`), would be at the ends.
    """
    from ..element import lagrange  # imports scikit-fem, which rigid bodies do without

    ends = np.array([0.0, 1.0])
    sections = beam.section_points(np.arange(len(beam.section_id)), ends)
    weights = lagrange(beam.elements.points, ends).T
    elastic, unloaded, held = weights @ (strains - free), weights @ free, list(beam.theory.held)
    elastic[..., held] = 0.0
    for _ in range(4 if sections.laws else 1):
        gap = forces - beam_stress(sections, elastic)
        elastic += _strained(section_moduli(sections, elastic), gap, held)
    return elastic + unloaded


def _strained(moduli: Array, gap: Array, held: list[int]) -> Array:
    """Strains (..., 6) by forces and moments that are missing, none of those that are held."""
    moduli[..., held, held] = 1.0
    gap[..., held] = 0.0
    return np.linalg.solve(moduli, gap[..., None])[..., 0]


#: part of the motion of a mode that is small
SMALL = 1e-6


class Balances(NamedTuple):
    """Balance of a beam's elements at some states, each array (N, ne, p + 1, 4, 3).

    Attributes
    ----------
    nodal : array
        Coordinates of the nodes.
    spread : array
        Consistent nodal forces of what is spread: line loads and gravity, less inertia and drag.
    force : array
        Nodal forces less those: what the nodes pass on.
    """

    nodal: Floats
    spread: Floats
    force: Floats


def element_balances(
    system: System,
    beams: Sequence[Beam],
    q: ArrayLike,
    t: ArrayLike,
    amplitudes: ArrayLike | None,
    v: ArrayLike | None,
    a: ArrayLike | None,
    multipliers: ArrayLike | None,
    *,
    viscous: bool = True,
) -> list[Balances]:
    """Balances of beams of one group at some states; arguments of :func:`nodal_resultants`.

    With or without the viscous forces of sections.
    """
    group = group_of(system, beams[0])
    Q = np.reshape(q, (-1, system.rows, 3))
    factors = load_factors(system, t, amplitudes, len(Q))
    free = system.loading.strains(group, factors)
    rates = [None if rate is None else np.reshape(rate, Q.shape) for rate in (v, a)]
    nodal = Q[:, group.rows].reshape(len(Q), len(group.rows), -1, 4, 3)
    spread, force, held = np.zeros_like(nodal), np.empty_like(nodal), np.zeros_like(free)
    of = [(beam, group.slices[id(beam)]) for beam in beams]
    for beam, own in of:
        held[:, own] = held_forces(system, beam, multipliers, len(Q))
    for k, y in enumerate(Q):
        velocity, acceleration = (None if rate is None else rate[k] for rate in rates)
        for beam, own in of:
            spread[k, own] = spread_over(system, beam, y, factors[k], velocity, acceleration)
        eps, B = group.strain(y)
        stress = group.stress(eps - free[k]) + held[k]
        if viscous and velocity is not None and group.viscous:
            stress = stress + group.viscous_stress(group.strain_rate(B, velocity))
        force[k] = group.force(B, stress).reshape(spread[k].shape) - spread[k]
    return [Balances(nodal[:, own], spread[:, own], force[:, own]) for _, own in of]


def _passed_on(F: Array, nodal: Array, end: int) -> tuple[Array, Array]:
    """Force and moment (..., 3) in space on the face at the end 0 or -1 of elements."""
    sign = 1.0 if end else -1.0
    f = F[..., end, :, :]
    return sign * f[..., 0, :], sign * cross(nodal[..., end, 1:, :], f[..., 1:, :]).sum(-2)


def spread_over(
    system: System,
    beam: Beam,
    y: Array,
    factors: Floats,
    velocity: Floats | None,
    acceleration: Array | None,
) -> Array:
    """Consistent nodal forces of line loads and gravity, less those of inertia and drag."""
    group = group_of(system, beam)
    own = group.slices[id(beam)]
    rows = group.rows[own]
    mass = group.mass[own]
    nodal = y[rows].reshape(len(rows), -1, 4, 3)
    out = np.zeros_like(nodal)
    for term, factor in zip(system.loading.terms, factors, strict=True):
        out += term.on_elements(beam, mass, nodal, factor)
    for matrix, rate in ((group.drag, velocity), (group.mass, acceleration)):
        if matrix is not None and rate is not None:
            out -= (matrix[own] @ rate[rows].reshape(len(rows), -1, 1)).reshape(out.shape)
    return out


# -- section forces and moments at any point, from the balance of a part of an element -------------
#
# A part from an end of the element to the point is in balance with what the end passes on and what
# is spread over the part. Forces follow at once. Moments need the line between, and components the
# triad at the point, which elements interpolate to h^(p+1) only: both are integrated from the end,
# by the strains that belong to the forces and moments found so far. Each sweep gains an order.


def part_resultants(
    beam: Beam, e: IndexArray, x: Floats, found: Balances, strains: Floats, free: Floats
) -> Floats:
    """Forces and moments (N, m, 6) in section triads, at x of the elements e (m,).

    Parameters
    ----------
    found : Balances
        Of its elements.
    strains, free : (N, ne, ng, 6) array
        At their Gauss points, those without stress by loads apart.
    """
    first, last = (_from_end(beam, e, x, end, found, strains, free) for end in (0, -1))
    return (1.0 - x)[:, None] * first + x[:, None] * last


class Statics:
    """Forces and moments in space along parts of elements, in balance with one end of each.

    Parameters
    ----------
    force, nodal : (..., p + 1, 4, 3) array
        What the nodes of the elements pass on, and their coordinates.
    end : {0, -1}
        Start or end of the elements.
    density, at : (..., k, 4, 3) array
        What is spread, by length, and line and directors, at k places.
    over : (..., l, k) array
        Integrals from the end, the first k to the places.

    Attributes
    ----------
    n : (..., l, 3) array
        Forces.
    """

    def __init__(
        self, force: Array, nodal: Array, end: int, density: Array, at: Array, over: Floats
    ):
        n, self._m = (each[..., None, :] for each in _passed_on(force, nodal, end))
        self.n = n - over @ density[..., 0, :]
        self._over = over
        self._couple = cross(at[..., 1:, :], density[..., 1:, :]).sum(-2)

    def moment(self, slope: Array) -> Array:
        """(..., l, 3) in space, for a line of this slope (..., k, 3)."""
        turned = cross(slope, self.n[..., : slope.shape[-2], :])
        return self._m - self._over @ (turned + self._couple)


def integrals(places: Floats, to: Floats) -> Floats:
    """Integrals (l, k) from 0 to points (l,), of polynomials by their values at places (k,)."""
    powers = np.arange(len(places))
    return to[:, None] ** (powers + 1) / (powers + 1) @ np.linalg.inv(places[:, None] ** powers)


def _from_end(
    beam: Beam, e: IndexArray, x: Floats, end: int, found: Balances, strains: Floats, free: Floats
) -> Floats:
    """Components (N, m, 6) at points, by the parts of elements from an end, 0 or -1, to these."""
    from ..element import lagrange  # imports scikit-fem, which rigid bodies do without

    elements = beam.elements.taken(e)
    kind = beam.basis.interpolation
    start = 1.0 if end else 0.0
    places = kind.full.points
    to = np.append(places, 1.0)
    u = start + np.outer(x - start, to)
    length = elements.lengths
    over = ((x - start) * length)[:, None, None] * integrals(places, to)
    nodal, spread, force = (each[:, e] for each in found)
    density = np.linalg.solve(
        beam.basis.elemental_mass()[e], spread.reshape(*spread.shape[:3], -1)
    ).reshape(spread.shape)
    shape = beam.basis.shape(u)
    inner = u[:, :-1]
    f, at = (np.einsum("amk,nmaic->nmkic", shape[..., :-1], each) for each in (density, nodal))
    statics = Statics(force, nodal, end, f, at, over)
    section = beam.rotations[e] @ nodal[..., 1:, :]
    first = section[:, :, None, end]
    d = np.einsum("amk,nmaic->nmkic", shape, section)
    slopes = beam.basis.dshape(inner) / length[:, None]
    m = statics.moment(np.einsum("amk,nmac->nmkc", slopes, nodal[..., 0, :]))
    weights = lagrange(elements.points, inner)
    strain, unloaded = (
        np.einsum("gmk,nmgi->nmki", weights, each)
        for each in (strains[:, e] + elements.reference, free[:, e] + elements.reference)
    )
    elastic = strain - unloaded
    sections = beam.section_points(e, inner)
    stress = beam_stress(sections, elastic)
    moduli = section_moduli(sections, elastic)
    held = list(beam.theory.held)
    for _ in range(kind.order):
        own = d[:, :, :-1]
        gap = components(own, statics.n[:, :, :-1], m[:, :, :-1]) - stress
        eps = strain + _strained(moduli, gap, held)
        line = eps.reshape(*eps.shape[:-1], 2, 3) @ own  # slope of the line, and turn of triads
        turned = cross(line[..., 1:, :], own).reshape(*eps.shape[:-1], 9)
        d = first + (over @ turned).reshape(d.shape)
        m = statics.moment(line[..., 0, :])
    return components(d[:, :, -1], statics.n[:, :, -1], m[:, :, -1])


def components(d: Array, n: Array, m: Array) -> Array:
    """Force and moment (..., 3) in space by components (..., 6) along directors (..., 3, 3)."""
    return (np.stack([n, m], -2) @ d.swapaxes(-1, -2)).reshape(*n.shape[:-1], 6)


@takes_scene
@of_states
def accelerations(
    system: System,
    q: ArrayLike,
    v: ArrayLike,
    t: ArrayLike = 0.0,
    turns: ArrayLike | None = None,
) -> tuple[Floats, Floats]:
    """Accelerations and multipliers by the equations of motion, sections without viscosity.

    What :func:`nodal_resultants` wants for the elastic section forces of states of a run. Strain
    rates of a state are known less well than its strains, so that viscous forces of sections are
    left out; those of dampers and drag are not.

    Parameters
    ----------
    q, v : (n,) or (N, n) array
        Configurations, and velocities on the hidden constraints, ``history["v"]``.
    t : float or (N,) array
        Their times (s).
    turns : (k,) or (N, k) array, optional
        Full turns of the angles of force elements, ``history["turns"]``.

    Returns
    -------
    a : (n,) or (N, n) array
        (m/s^2, 1/s^2)
    multipliers : (m,) or (N, m) array

    Raises
    ------
    InputError
        If shapes do not fit.

    Examples
    --------
    A weight of 20 N that swings through the lowest point at 3 m/s, 1 m below its pin:

    >>> import skfem_cosserat as sc
    >>> model = sc.Model()
    >>> bob = model.add("bob", sc.MassPoint(2.0, position=(0, 0, -1)))
    >>> rod = model.add("rod", sc.JointDistance(sc.ground((0, 0, 0)), bob.place()))
    >>> weight = model.add("weight", sc.LoadGravity((0, 0, -10.0)))
    >>> a, lam = accelerations(model, model.freeze().q0, [3.0, 0, 0])
    >>> (a.round(9) + 0.0).tolist(), lam.round(9).tolist()
    ([0.0, 0.0, 9.0], [38.0])
    """
    Q, V, times = np.asarray(q), np.asarray(v), np.asarray(t).tolist()
    counted = [None] * len(Q) if turns is None else np.atleast_2d(np.asarray(turns))
    a = np.empty_like(Q)
    lam = np.empty((len(Q), system.m))
    for k, (s, turned) in enumerate(zip(times, counted, strict=True)):
        a[k], lam[k] = by_motion(system, Q[k], V[k], s, turned, viscous=False)
    return a, lam


# -- multipliers, reactions of joints, conditioning ------------------------------------------------


@takes_scene
def constraint_points(system: System, history: History) -> Floats:
    """Configuration in which the constraint forces of each state act, with the ground's frames.

    Parameters
    ----------
    history : History
        Of a run of this system.

    Returns
    -------
    (N, total, 3) array
        All rows of y: the coordinates, then the ground's frames (m, -).

    Examples
    --------
    A pendulum in two steps:

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
    return all_rows(system, as_stack(system, "history", history["q"])[0], history.instants)


@takes_scene
def multipliers(system: System, y: Floats, force: Floats) -> Floats:
    """Multipliers from ``G(y)^T lambda = force``, by ``M a + G^T lambda = force``, ``G a = 0``.

    A force that no multipliers give, as the mean of two steps, is so replaced by the one that
    gives the nearest accelerations: ``force - M a``. A joint of a light body is then
    off by a share of its own force, not of those of heavy bodies.

    Where constraint rows are redundant, only ``G^T lambda`` is unique: of all lambda that give
    it, this is the one of least norm, ``sum lambda^2`` over all rows. How the forces are shared
    between the joints of such a loop is then a choice, not a result.

    Parameters
    ----------
    y : (N, total, 3) array
        Where the forces act: those of states at :func:`constraint_points`, those of steps, which
        callbacks get, at ``report.constraint_point``.
    force : (N, n) array
        ``history["constraint_force"]``, or ``report.constraint_force`` of steps, in either
        treatment (N, N m). NaN rows give NaN.

    Returns
    -------
    (N, m) array
        One for each constraint row, in units of J over those of the row: N for a row in m, N m
        for one without units, N/m for the one of a distance joint. NaN where ``G G^T`` of the
        independent rows is singular.

    Examples
    --------
    A weight of 20 N on a rod of 1 m:

    >>> from skfem_cosserat import JointDistance, MassPoint, Model, ground
    >>> model = Model()
    >>> bob = model.add("bob", MassPoint(2.0, position=(0, 0, -1)))
    >>> rod = model.add("rod", JointDistance(ground((0, 0, 0)), bob.place()))
    >>> y = model.freeze().extend(model.freeze().q0, 0.0)
    >>> multipliers(model.freeze(), y[None], np.array([[0.0, 0, -20.0]])).tolist()
    [[20.0]]
    """
    y = as_array("y", y, None, system.total, 3)
    force = as_array("force", force, None, system.n)
    if len(y) != len(force):
        raise InputError("argument force", f"is of {len(force)} states, y of {len(y)}")
    out = np.full((len(y), system.m), np.nan)
    for k in np.flatnonzero(np.isfinite(force).all(1)) if system.m else ():
        with suppress(SingularMatrixError):  # stays NaN
            out[k] = balancing(system, y[k], force[k])
    return out


def overstretched_at(
    system: System, y: Floats, force: Floats, loads: Floats
) -> tuple[str, str] | None:
    """A beam drawn too much, and what to say: with the tension of constraint forces (n,) at y."""
    lam = None
    if any(2 in theory.held for theory in system.theory_rows) and np.isfinite(force).all():
        lam = multipliers(system, y[None], force[None])[0]
    return overstretched_beam(system, y, lam, loads)


@takes_scene
def reactions(system: System, y: Floats, lam: Floats) -> dict[str, tuple[Floats, Floats]]:
    """Force and moment that each joint exerts on its side B, about the joint's point on B.

    ``simulate`` adds them to its history as ``joint/NAME/force`` and ``joint/NAME/moment``.

    Parameters
    ----------
    y : (N, total, 3) array
        As for :func:`multipliers`: for forces of steps ``report.constraint_point``.
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
    y = as_array("y", y, None, system.total, 3)
    lam = as_array("lam", lam, None, system.m)
    return {jr.joint.name or "": _wrenches(system, jr, y, lam) for jr in system.joint_rows}


def _wrenches(system: System, jr: JointRows, y: Floats, lam: Floats) -> tuple[Floats, Floats]:
    """Forces and moments (N, 3) of one joint.

    The balance reads ``... + G^T lambda = 0``, so a joint acts with ``-G^T lambda``; if side B is
    the ground, the reaction of side A, about the same point of B, is turned round.
    """
    on_b = jr.b.vertex < len(system.origin_rows)
    vertex, sign = (jr.b.vertex, 1.0) if on_b else (jr.a.vertex, -1.0)
    b = int(system.vertex_rows[jr.b.vertex])
    r = int(system.vertex_rows[vertex])
    rows = 4 if system.is_frame[vertex] else 1
    constraints = system.constraints
    own = (constraints.rows >= jr.rows.start) & (constraints.rows < jr.rows.stop)
    own &= (constraints.cols >= 3 * r) & (constraints.cols < 3 * (r + rows))
    which = np.flatnonzero(own)
    parts = constraints.contributions(which, y) * lam[:, constraints.rows[which]]
    place = constraints.cols[which] - 3 * r == np.arange(3 * rows)[:, None]
    f = -sign * (parts @ place.T).reshape(len(y), rows, 3)
    x = y[:, b] + sum(X * y[:, b + i + 1] for i, X in enumerate(jr.b.offset) if X != 0)
    arms = np.concatenate([(y[:, r] - x)[:, None], y[:, r + 1 : r + rows]], 1)
    return f[:, 0], np.cross(arms, f).sum(1)


@takes_scene
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
    A short step of a pendulum, scaled and not:

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
    matrix, _ = stepper.iteration_matrix(state, switch("argument scaled", scaled))
    return float(np.linalg.cond(matrix))
