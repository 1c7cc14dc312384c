"""Section forces and moments at the nodes, from the balance of each element."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..errors import InputError
from ..kernels import director_force
from ..load import Load, LoadGravity, LoadLine
from ..model import System
from ..model.groups import BeamGroup
from ..types import ArrayLike, Floats
from .energy import group_of, held_forces
from .stacks import as_stack, as_times

if TYPE_CHECKING:
    from ..beam import Beam

__all__ = ["element_forces", "nodal_resultants"]


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
        beam's rung holds. NaN without.

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

    >>> from skfem_cosserat import Beam, MeshCurve, Model, Section
    >>> section = Section([1e4, 1e4, 1e4, 500, 500, 500], mass=1.0, inertia=(10.0, 10.0))
    >>> model = Model()
    >>> mesh = MeshCurve.init_line((0, 0, 0), (0, 0, 2), 1)
    >>> beam = model.add("beam", Beam(mesh, section, director=(1, 0, 0)))
    >>> system = model.freeze()
    >>> q = system.q0
    >>> q[14] = 2.02   # the end, drawn by 1 %
    >>> (nodal_resultants(system, beam, q)[0, :, :3].round(9) + 0.0).tolist()
    [[0.0, 0.0, 100.0], [0.0, 0.0, 100.0]]
    """
    Q, single = as_stack(system, "q", q)
    group = group_of(system, beam)
    rates = [_like("v", v, Q, system), _like("a", a, Q, system)]
    factors = _factors(system, t, amplitudes, len(Q))
    out = np.empty((len(Q), len(beam.basis.connectivity), 2, 6))
    held = np.asarray(held_forces(system, beam, multipliers, None if single else len(Q)))
    held = np.broadcast_to(held, (len(Q), *held.shape[-3:]))
    for k, q_k in enumerate(Q):
        velocity, acceleration = (None if r is None else r[k].reshape(-1, 3) for r in rates)
        F = element_forces(
            system, beam, q_k.reshape(-1, 3), factors[k], velocity, acceleration, held[k]
        )
        nodal = q_k.reshape(-1, 3)[group.rows[group.slices[id(beam)]]].reshape(F.shape)
        out[k] = _at_ends(F, nodal, beam)
    return out[0] if single else out


def element_forces(
    system: System,
    beam: Beam,
    y: Floats,
    factors: Floats,
    velocity: Floats | None = None,
    acceleration: Floats | None = None,
    held: Floats | float = 0.0,
) -> Floats:
    """Nodal forces (ne, p + 1, 4, 3) of a beam's elements, less those of distributed loads.

    Parameters
    ----------
    y : (rows, 3) array
        Configuration.
    factors : (k,) array
        Of the channels of ``system.loading``.
    velocity, acceleration : (rows, 3) array, optional
        Adds the forces of damping and of inertia.
    held : (ne, ng, 6) array, optional
        Resultants of strains that are held.
    """
    group = group_of(system, beam)
    own = group.slices[id(beam)]
    loads = [(load, value) for load in system.loads for value, _ in load.channels]
    F = _forces(group, own, y, velocity, acceleration, held)
    for (load, value), factor in zip(loads, factors, strict=True):
        _subtract(F, load, factor * value, beam, group, own, y)
    return F


def _at_ends(F: Floats, nodal: Floats, beam: Beam) -> Floats:
    """Forces and moments (ne, 2, 6) in section triads of nodal forces (ne, p + 1, 4, 3)."""
    out = np.empty((len(F), 2, 6))
    for end, sign in ((0, -1.0), (-1, 1.0)):
        f, d = F[:, end], nodal[:, end, 1:]
        spatial = np.stack([f[:, 0], director_force(d, f[:, 1:])], axis=1)
        triad = beam.rotations[:, end] @ d
        out[:, end] = sign * (spatial @ np.swapaxes(triad, 1, 2)).reshape(-1, 6)
    return out


def _like(name: str, value: ArrayLike | None, Q: Floats, system: System) -> Floats | None:
    if value is None:
        return None
    rates, _ = as_stack(system, name, value)
    if rates.shape != Q.shape:
        raise InputError(f"argument {name}", f"has shape {rates.shape}, q has {Q.shape}")
    return rates


def _factors(system: System, t: ArrayLike, amplitudes: ArrayLike | None, count: int) -> Floats:
    """Factor (N, k) of each channel of the loads."""
    if amplitudes is None:
        return np.array([system.loading.values(float(s)) for s in as_times(t, count)])
    given = np.asarray(amplitudes, dtype=float)
    channels = len(system.loading.times)
    if given.shape not in ((channels,), (count, channels)):
        raise InputError(
            "argument amplitudes",
            f"has shape {given.shape}, expected ({channels},) or ({count}, {channels})",
        )
    return np.broadcast_to(given, (count, channels))


def _forces(
    group: BeamGroup,
    own: slice,
    y: Floats,
    velocity: Floats | None,
    acceleration: Floats | None,
    held: Floats | float,
) -> Floats:
    """Internal, damping and inertia forces (ne, p + 1, 4, 3) of a beam's elements."""
    eps, B = group.strain(y)
    stress = group.stress(eps)
    stress[own] += held
    if velocity is not None and group.viscous:
        stress = stress + group.viscous_stress(group.strain_rate(B, velocity))
    F = group.force(B, stress)[own]
    for matrix, rate in ((group.drag, velocity), (group.mass, acceleration)):
        if matrix is not None and rate is not None:
            local = rate[group.rows[own]].reshape(len(F), -1, 1)
            F = F + (matrix[own] @ local)[:, :, 0]
    return F.reshape(len(F), -1, 4, 3)


def _subtract(
    F: Floats, load: Load, value: Floats, beam: Beam, group: BeamGroup, own: slice, y: Floats
) -> None:
    """Take the consistent nodal forces of a distributed load off F (ne, p + 1, 4, 3)."""
    if isinstance(load, LoadGravity):
        field = np.zeros_like(F)
        field[:, :, 0] = value
        F -= (group.mass[own] @ field.reshape(len(F), -1, 1)).reshape(F.shape)
    elif isinstance(load, LoadLine) and load.beam is beam:
        e = load.elements
        if load.follower:
            local = y[group.rows[own][e]].reshape(len(e), -1, 4, 3)
            spatial = np.einsum("i,ebij,ebjc->ebc", value, beam.rotations[e], local[:, :, 1:])
            F[e, :, 0] -= beam.basis.elemental_mass()[e] @ spatial
        else:
            F[e, :, 0] -= beam.line_weights(e)[:, :, None] * value
