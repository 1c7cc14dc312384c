"""Kinetic, stored and external energy; strains and forces of sections."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache, partial
from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

from ..errors import InputError
from ..frames import is_beam
from ..history import History
from ..kernels import BeamElements, beam_energy, beam_stress, product
from ..model import System, takes_scene
from ..model.groups import BeamGroup
from ..model.theories import theory_of
from ..pattern import dense_blocks
from ..strain import strain_factors, strain_measures
from ..types import ArrayLike, Floats, IndexArray, switch
from .stacked import as_stack, as_times, of_states, step_size

if TYPE_CHECKING:
    from ..beam import Beam


def _in_parts(function: Callable[..., Floats], numbers: int, *states: Floats) -> Floats:
    """Results (N, ...) of a function of some states, each of so many numbers, in the cache."""
    size = int(np.clip(2**16 // max(1, numbers), 8, 256))
    starts = range(0, max(1, len(states[0])), size)
    return np.concatenate([function(*(x[k : k + size] for x in states)) for k in starts])


@lru_cache(maxsize=4)  # factors take longer than all else that needs them
def mass_solver(system: System) -> Callable[[Floats], Floats]:
    """Pseudo-inverse of the scalar mass matrix, applied to (rows, k) arrays.

    Rows without mass (d3 of beams) give zero. Small singular blocks (a point mass off the origin
    of a body) are inverted on their range.
    """
    mass = system.mass.tocsc()
    massive = mass.diagonal() > 0
    label = connected_components(mass, directed=False)[1]
    members = np.bincount(label)[label]
    present = np.bincount(label, massive)[label] > 0
    large = np.flatnonzero(massive & (members > 8))
    factor = splu(mass[large][:, large]) if len(large) else None
    blocks = []
    for r in np.unique(members[present & (members <= 8)]).tolist():
        own = np.flatnonzero(present & (members == r))
        rows = own[np.argsort(label[own], kind="stable")].reshape(-1, r)
        blocks.append((rows, np.linalg.pinv(dense_blocks(mass, rows), hermitian=True)))

    def solve(rhs: Floats) -> Floats:
        out = np.zeros_like(rhs)
        if factor is not None:
            out[large] = factor.solve(np.ascontiguousarray(rhs[large]))
        for ids, inverse in blocks:
            out[ids] = inverse @ rhs[ids]
        return out

    return solve


@takes_scene
@of_states
def kinetic_energy(system: System, p: ArrayLike) -> Floats:
    """``p . M^-1 p / 2`` over the blocks that have mass (the d3 of beams have none).

    Parameters
    ----------
    p : (n,) or (N, n) array
        Momenta, e.g. ``history["p"]`` (kg m/s, kg m^2/s).

    Returns
    -------
    float or (N,) array
        (J)

    Raises
    ------
    InputError
        If the shape of `p` does not fit the system.

    Examples
    --------
    A ball of 2 kg at 3 m/s:

    >>> import skfem_cosserat as sc
    >>> model = sc.Model()
    >>> ball = model.add("ball", sc.MassPoint(2.0))
    >>> float(kinetic_energy(model, [6.0, 0, 0]))
    9.0
    """
    solve = mass_solver(system)

    def energies(some: Floats) -> Floats:
        rows = in_rows(system, some)
        return 0.5 * (rows * solve(rows)).sum(0).reshape(-1, 3).sum(1)

    return _in_parts(energies, system.n, np.asarray(p))


def in_rows(system: System, states: Floats) -> Floats:
    """Numbers (N, n) of states as columns (rows, 3 N)."""
    return states.reshape(-1, system.rows, 3).transpose(1, 0, 2).reshape(system.rows, -1)


@takes_scene
@of_states
def momentum(system: System, v: ArrayLike) -> Floats:
    """``M v``, zero in the blocks without mass.

    Parameters
    ----------
    v : (n,) or (N, n) array
        Velocities (m/s, 1/s).

    Returns
    -------
    (n,) or (N, n) array
        (kg m/s, kg m^2/s)

    Raises
    ------
    InputError
        If the shape of `v` does not fit the system.

    Examples
    --------
    That of a ball of 2 kg at 3 m/s:

    >>> import skfem_cosserat as sc
    >>> model = sc.Model()
    >>> ball = model.add("ball", sc.MassPoint(2.0))
    >>> momentum(model, [3.0, 0, 0]).tolist()
    [6.0, 0.0, 0.0]
    """

    def momenta(some: Floats) -> Floats:
        found = (system.mass @ in_rows(system, some)).reshape(system.rows, -1, 3)
        return found.transpose(1, 0, 2).reshape(some.shape)

    return _in_parts(momenta, system.n, np.asarray(v))


@takes_scene
@of_states
def kinetic_energy_of_velocity(system: System, v: ArrayLike) -> Floats:
    """``v . M v / 2``.

    Parameters
    ----------
    v : (n,) or (N, n) array
        Velocities (m/s, 1/s).

    Returns
    -------
    float or (N,) array
        (J)

    Raises
    ------
    InputError
        If the shape of `v` does not fit the system.

    Examples
    --------
    A ball of 2 kg, at rest and at 3 m/s:

    >>> import skfem_cosserat as sc
    >>> model = sc.Model()
    >>> ball = model.add("ball", sc.MassPoint(2.0))
    >>> kinetic_energy_of_velocity(model, [[0, 0, 0], [3.0, 0, 0]]).tolist()
    [0.0, 9.0]
    """
    return 0.5 * (np.asarray(v) * momentum(system, v)).sum(-1)


@takes_scene
@of_states
def strain_energy(
    system: System, q: ArrayLike, t: ArrayLike = 0.0, *, amplitudes: ArrayLike | None = None
) -> Floats:
    """Stored energy ``int W(Gamma, K) ds`` of all beams, W = ``eps . D eps/2`` by default.

    Parameters
    ----------
    q : (n,) or (N, n) array
        Configurations.
    t : float or (N,) array
        Their times (s), for strains without stress that change: :class:`LoadStrain`.
    amplitudes : (k,) or (N, k) array, optional
        Factors of the channels of ``system.loading`` instead of those at `t`.

    Returns
    -------
    float or (N,) array
        (J), zero in the reference.

    Raises
    ------
    InputError
        If the shape of `q` does not fit the system.

    Examples
    --------
    A rod of 2 m, drawn by 1 %:

    >>> import skfem_cosserat as sc
    >>> line = sc.MeshCurve.init_line((0, 0, 0), (0, 0, 2), 1)
    >>> model, section = sc.Model(), sc.Section([1e4] * 6, mass=1.0, inertia=(10.0, 10.0))
    >>> rod = model.add("rod", sc.Beam(line, section, director=(1, 0, 0)))
    >>> q = model.freeze().q0.copy()
    >>> q[14] = 2.02   # z of its end
    >>> round(float(strain_energy(model, q)), 9)
    1.0
    """
    Q = np.asarray(q)
    factors = load_factors(system, t, amplitudes, len(Q))
    out = np.zeros(len(Q))
    for group in system.beam_groups:
        out += group_energy(group, Q, system.loading.strains(group, factors))
    return out


def stored_energy(e: BeamElements, strains: Floats) -> Floats:
    """Energy (N,) stored in elements (J), of their strains (N, ne, ng, 6)."""
    return np.einsum("neg,g,e->n", beam_energy(e, strains), e.weights, e.lengths)


def group_energy(group: BeamGroup, Q: Floats, free: Floats) -> Floats:
    """Energy (N,) stored in all elements of a group (J), of configurations (N, n).

    `free`: strains without stress (N, ne, ng, 6).
    """
    e = group.elements
    rows = group.rows

    return _in_parts(
        lambda some, less: stored_energy(e, _strains(e, rows, some) - less), 3 * rows.size, Q, free
    )


def strain_excess(
    system: System, q: Floats, t: ArrayLike = 0.0, amplitudes: ArrayLike | None = None
) -> Floats:
    """Energy (N,) that strains of loads add to that of all strains (J), see :func:`strain_energy`.

    Steps and paths have these strains as forces, whose work is on all strains.
    """
    if not system.loading.strained:
        return np.zeros(len(q))
    factors = load_factors(system, t, amplitudes, len(q))
    less, none = (strain_energy(system, q, amplitudes=s * factors) for s in (1.0, 0.0))
    return less - none


def recorded_factors(system: System, history: History) -> Floats:
    """Factors (N, k) of loads at the states of a run, or a path, as far as strains need them."""
    times = history.instants if system.loading.strained else 0.0
    return load_factors(system, times, history.series.get("amplitudes/loads"), len(history))


def load_factors(system: System, t: ArrayLike, amplitudes: ArrayLike | None, count: int) -> Floats:
    """Factors (N, k) of all channels of loads: those given, or those at times."""
    loading = system.loading
    channels = len(loading.times)
    if amplitudes is None:
        # a pulse that is over, most of the time
        times = np.minimum(as_times(t, count), max(loading.constant_after, 0.0))
        some, which = np.unique(times, return_inverse=True)
        return np.reshape([loading.values(s) for s in some.tolist()], (len(some), channels))[which]
    given = np.asarray(amplitudes, float)
    if given.shape not in ((channels,), (count, channels)):
        raise InputError(
            "argument amplitudes",
            f"has shape {given.shape}, expected ({channels},) or ({count}, {channels})",
        )
    return np.broadcast_to(given, (count, channels))


def free_strains(system: System, beam: Beam, factors: Floats) -> Floats:
    """Strains without stress (N, ne, ng, 6) of a beam, for factors (N, k) of loads."""
    group = group_of(system, beam)
    return system.loading.strains(group, factors)[:, group.slices[id(beam)]]


def group_stretches(group: BeamGroup, Q: Floats) -> Floats:
    """Length ``d3 . phi'`` over reference length (N, ne, ng) at Gauss points of a group's elements.

    Of configurations (N, n).
    """
    e = group.elements
    rows = group.rows
    axial = _in_parts(lambda some: _strains(e, rows, some, which=[2]), 3 * rows.size, Q)
    return axial[..., 0] + e.reference[..., 2]


@takes_scene
def midpoint_energy(system: System, q: ArrayLike, step: float, mean: bool) -> Floats:
    """Kinetic energy, and stored energy of beams, in terms of ``(q_n, q_{n+1})``.

    Parameters
    ----------
    q : (N, n) array
        Configurations of consecutive steps.
    step : float
        Step size (s); the velocity is ``(q_{n+1} - q_n)/step``.
    mean : bool
        Stored energy as the mean of both ends (energy-momentum) or at the midpoint (variational),
        that of a :class:`LoadStrain` as at t = 0.

    Returns
    -------
    (N-1,) array
        (J)

    Raises
    ------
    InputError
        If the shape of `q` does not fit the system.

    Examples
    --------
    A ball of 2 kg that goes 0.5 m in a step, and 1 m in the next one:

    >>> import skfem_cosserat as sc
    >>> model = sc.Model()
    >>> ball = model.add("ball", sc.MassPoint(2.0))
    >>> q = [[0.0, 0, 0], [0.5, 0, 0], [1.5, 0, 0]]
    >>> midpoint_energy(model, q, step=0.5, mean=False).tolist()
    [1.0, 4.0]
    """
    Q, _ = as_stack(system, "q", q)
    h = step_size(step)
    mean = switch("argument mean", mean)
    kinetic = kinetic_energy_of_velocity(system, np.diff(Q, axis=0) / h)
    if mean:
        stored = strain_energy(system, Q)
        return kinetic + (stored[1:] + stored[:-1]) / 2
    return kinetic + strain_energy(system, (Q[1:] + Q[:-1]) / 2)


@takes_scene
@of_states
def external_energy(system: System, q: ArrayLike, t: ArrayLike) -> Floats:
    """Potential ``-f(t) . q`` (J) of the dead loads and gravity with their value at time t.

    Moments and follower forces have no potential and are left out.

    Parameters
    ----------
    q : (n,) or (N, n) array
        Configurations.
    t : float or (N,) array
        Their times (s).

    Returns
    -------
    float or (N,) array
        (J)

    Raises
    ------
    InputError
        If the shape of `q` does not fit the system.

    Examples
    --------
    A ball of 20 N that is lifted by 3 m:

    >>> import skfem_cosserat as sc
    >>> model = sc.Model()
    >>> ball = model.add("ball", sc.MassPoint(2.0))
    >>> gravity = model.add("gravity", sc.LoadGravity((0, 0, -10.0)))
    >>> external_energy(model, [[0, 0, 0], [0, 0, 3.0]], [0.0, 0.1]).tolist()
    [0.0, 60.0]
    """
    return potential(system, np.asarray(q), load_factors(system, t, None, len(np.asarray(q))))


def potential(system: System, q: Floats, amplitudes: Floats) -> Floats:
    """``-f . q`` (N,) of the dead loads (J), for amplitudes (N, k) of all channels."""
    each = [system.loading.dead_force(unit) for unit in np.eye(amplitudes.shape[1])]
    return ((-q @ np.reshape(each, (-1, system.n)).T) * amplitudes).sum(1)


@takes_scene
@of_states
def section_strains(system: System, beam: Beam, q: ArrayLike) -> Floats:
    """Strains ``(Gamma_1, Gamma_2, Gamma_3, K_1, K_2, K_3)`` at the Gauss points of a beam.

    Shear along d1 and d2, axial; bending about d1 and d2, torsion. Relative to the interpolated
    reference, in the section's frame.

    Parameters
    ----------
    beam : Beam
        Of this system.
    q : (n,) or (N, n) array
        Configurations.

    Returns
    -------
    (ne, ng, 6) or (N, ne, ng, 6) array
        At the ng Gauss points of the ne elements (-, 1/m).

    Raises
    ------
    InputError
        If the beam is not in the system, or the shape of `q` does not fit the system.

    Examples
    --------
    A rod of 2 m, drawn by 1 %:

    >>> import skfem_cosserat as sc
    >>> line = sc.MeshCurve.init_line((0, 0, 0), (0, 0, 2), 1)
    >>> model, section = sc.Model(), sc.Section([1e4] * 6, mass=1.0, inertia=(10.0, 10.0))
    >>> rod = model.add("rod", sc.Beam(line, section, director=(1, 0, 0)))
    >>> q = model.freeze().q0.copy()
    >>> q[14] = 2.02   # z of its end
    >>> (section_strains(model, rod, q)[0, 0].round(9) + 0.0).tolist()
    [0.0, 0.0, 0.01, 0.0, 0.0, 0.0]
    """
    return _strains_of(system, beam, np.asarray(q))


@takes_scene
@of_states
def section_strain_rates(system: System, beam: Beam, q: ArrayLike, v: ArrayLike) -> Floats:
    """Rates of the strains at the Gauss points of a beam.

    Parameters
    ----------
    beam, q
        As for :func:`section_strains`.
    v : (n,) or (N, n) array
        Velocities (m/s, 1/s): ``history["v"]``, or differences of configurations such as
        ``np.gradient(history["q"], history.times, axis=0)`` with every step recorded. Both are of
        second order where steps resolve the vibrations. Fast vibrations that they do not resolve
        alternate from step to step, v and its strain rates with them; central differences do not.

    Returns
    -------
    (ne, ng, 6) or (N, ne, ng, 6) array
        (1/s, 1/(m s))

    Raises
    ------
    InputError
        As for :func:`section_strains`.

    Examples
    --------
    A rod of 2 m whose end moves away by 2 cm/s:

    >>> import skfem_cosserat as sc
    >>> line = sc.MeshCurve.init_line((0, 0, 0), (0, 0, 2), 1)
    >>> model, section = sc.Model(), sc.Section([1e4] * 6, mass=1.0, inertia=(10.0, 10.0))
    >>> rod = model.add("rod", sc.Beam(line, section, director=(1, 0, 0)))
    >>> v = np.zeros(model.freeze().n)
    >>> v[14] = 0.02
    >>> section_strain_rates(model, rod, model.freeze().q0, v)[0, 0].round(9).tolist()
    [0.0, 0.0, 0.01, 0.0, 0.0, 0.0]
    """
    return _strains_of(system, beam, np.asarray(q), np.asarray(v))


def group_of(system: System, beam: Beam) -> BeamGroup:
    """The group of elements that holds a beam's; an error if it is not in the system."""
    if not is_beam(beam):
        raise InputError("argument beam", f"is of type {type(beam).__name__}, expected a Beam")
    group = next((g for g in system.beam_groups if id(beam) in g.slices), None)
    if group is None:
        raise InputError(beam.label, "is not in this system")
    return group


def _strains_of(system: System, beam: Beam, *states: Floats) -> Floats:
    """Strains (N, ne, ng, 6) of a beam in configurations; or rates, if there are velocities."""
    group = group_of(system, beam)
    rows = group.rows[group.slices[id(beam)]]
    return _in_parts(partial(_strains, beam.elements, rows), 3 * rows.size, *states)


def _strains(
    e: BeamElements,
    rows: IndexArray,
    Q: Floats,
    V: Floats | None = None,
    which: Sequence[int] = range(6),
) -> Floats:
    """Some strains (N, ne, ng, ...) of elements with these rows, or their rates; of few states."""
    x, xs = _fields(e, rows, Q)
    if V is None:
        return strain_measures(x, xs, which) - e.reference[..., which]
    v, vs = _fields(e, rows, V)
    return strain_measures(v, xs, which) + strain_measures(x, vs, which)


def _fields(e: BeamElements, rows: IndexArray, q: Floats) -> tuple[Floats, Floats]:
    """Fields (N, ne, ng, 4, 3) of sections at Gauss points, and their slopes."""
    states = q.reshape(len(q), q.shape[1] // 3, 3)  # there may be none
    nodal = states[:, rows].reshape(len(q), len(rows), rows.shape[1] // 4, 4, 3)
    if e.rotations is not None:
        nodal[..., 1:, :] = e.rotations @ nodal[..., 1:, :]
    x, xs = (np.einsum("ga,neaic->negic", each, nodal) for each in strain_factors(e.table))
    return x, xs / e.lengths[:, None, None, None]


def held_forces(
    system: System, beam: Beam, multipliers: ArrayLike | None, count: int
) -> Floats | float:
    """Resultants (N, ne, ng, 6) of strains that a beam's theory holds, zeros beside; 0 without.

    Parameters
    ----------
    multipliers : (m,) or (N, m) array, optional
        Of all constraint rows; None: not known, NaN.
    count : int
        Of states, N.

    Raises
    ------
    InputError
        If multipliers have another shape.
    """
    theory = theory_of(system.theory_rows, beam)
    if theory is None:
        return 0.0
    shape = count, system.m
    found = np.full(shape, np.nan) if multipliers is None else np.asarray(multipliers, float)
    if found.shape not in (shape, (system.m,)):
        raise InputError("argument multipliers", f"has shape {found.shape}, expected {shape}")
    return theory.stress(np.broadcast_to(found, shape))


@takes_scene
@of_states
def section_forces(
    system: System,
    beam: Beam,
    q: ArrayLike,
    v: ArrayLike | None = None,
    multipliers: ArrayLike | None = None,
    t: ArrayLike = 0.0,
    *,
    amplitudes: ArrayLike | None = None,
) -> Floats:
    """``(N_1, N_2, N_3, M_1, M_2, M_3)`` at the Gauss points, in the section's frame.

    On the face with outward normal +d3; tension positive.

    Parameters
    ----------
    beam, q
        As for :func:`section_strains`.
    v : (n,) or (N, n) array, optional
        Velocities as for :func:`section_strain_rates`: adds the viscous part of damped sections
        (of their own and of Rayleigh damping). Without: the elastic part alone.
    multipliers : (m,) or (N, m) array, optional
        As of :func:`multipliers`: those of strains that the beam's theory holds are resultants.
    t : float or (N,) array
        Times (s) of the configurations, for strains that change: :class:`LoadStrain`.
    amplitudes : (k,) or (N, k) array, optional
        Factors of the channels of loads instead of those at `t`: ``path["amplitudes/loads"]``.

    Returns
    -------
    (ne, ng, 6) or (N, ne, ng, 6) array
        Forces (N) and moments (N m). NaN for strains that are held, without multipliers.

    Raises
    ------
    InputError
        As for :func:`section_strains`.

    Examples
    --------
    A rod of 2 m, drawn by 1 %:

    >>> import skfem_cosserat as sc
    >>> line = sc.MeshCurve.init_line((0, 0, 0), (0, 0, 2), 1)
    >>> model, section = sc.Model(), sc.Section([1e4] * 6, mass=1.0, inertia=(10.0, 10.0))
    >>> rod = model.add("rod", sc.Beam(line, section, director=(1, 0, 0)))
    >>> q = model.freeze().q0.copy()
    >>> q[14] = 2.02   # z of its end
    >>> (section_forces(model, rod, q)[0, 0].round(9) + 0.0).tolist()
    [0.0, 0.0, 100.0, 0.0, 0.0, 0.0]
    """
    group = group_of(system, beam)
    factors = load_factors(system, t, amplitudes, len(np.asarray(q)))
    out = resultants(system, beam, section_strains(system, beam, q), factors, multipliers)
    if v is not None and group.elements.viscosity is not None:
        rates = section_strain_rates(system, beam, q, v)
        out = out + product(rates, group.elements.viscosity[group.slices[id(beam)]])
    return out


def resultants(
    system: System,
    beam: Beam,
    strains: Floats,
    factors: Floats,
    multipliers: ArrayLike | None = None,
) -> Floats:
    """Elastic forces and moments of strains and factors of loads, see :func:`section_forces`."""
    out = beam_stress(beam.elements, strains - free_strains(system, beam, factors))
    return out + held_forces(system, beam, multipliers, len(out))
