"""Kinetic, stored and external energy; strains and forces of sections."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.sparse import csc_matrix
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

from ..beam import Beam
from ..errors import InputError
from ..model import System
from ..types import ArrayLike, Floats
from .stacks import as_stack, as_times

__all__ = [
    "external_energy",
    "kinetic_energy",
    "kinetic_energy_of_velocity",
    "section_forces",
    "section_strains",
    "strain_energy",
]


def mass_solver(system: System) -> Callable[[Floats], Floats]:
    """Pseudo-inverse of the scalar mass matrix, applied to (rows, k) arrays.

    Rows without mass (d3 of beams) give zero. Small singular blocks (a point mass off the origin
    of a body) are inverted on their range.
    """
    mass = system.mass.tocsc()
    count, label = connected_components(mass, directed=False)
    massive = np.flatnonzero(mass.diagonal() > 0)
    members = np.bincount(label, minlength=count)
    small = massive[members[label[massive]] <= 8]
    large = massive[members[label[massive]] > 8]
    factor = splu(csc_matrix(mass[large][:, large])) if len(large) else None
    blocks = []
    for name in np.unique(label[small]):
        ids = np.flatnonzero(label == name)
        blocks.append((ids, np.linalg.pinv(mass[ids][:, ids].toarray(), hermitian=True)))

    def solve(rhs: Floats) -> Floats:
        out = np.zeros_like(rhs)
        if factor is not None:
            out[large] = factor.solve(np.ascontiguousarray(rhs[large]))
        for ids, inverse in blocks:
            out[ids] = inverse @ rhs[ids]
        return out

    return solve


def kinetic_energy(system: System, p: ArrayLike) -> Floats:
    """``p . M^-1 p / 2`` (J) over the blocks that have mass."""
    P, single = as_stack(system, "p", p)
    rows = P.reshape(len(P), system.rows, 3).transpose(1, 0, 2).reshape(system.rows, -1)
    v = mass_solver(system)(rows)
    out = 0.5 * (rows * v).reshape(system.rows, len(P), 3).sum((0, 2))
    return out[0] if single else out


def kinetic_energy_of_velocity(system: System, v: ArrayLike) -> Floats:
    """``v . M v / 2`` (J)."""
    V, single = as_stack(system, "v", v)
    rows = V.reshape(len(V), system.rows, 3).transpose(1, 0, 2).reshape(system.rows, -1)
    out = 0.5 * (rows * (system.mass @ rows)).reshape(system.rows, len(V), 3).sum((0, 2))
    return out[0] if single else out


def strain_energy(system: System, q: ArrayLike) -> Floats:
    """Stored energy of all beams (J)."""
    Q, single = as_stack(system, "q", q)
    out = np.zeros(len(Q))
    for beam in (s for s in system.structures if isinstance(s, Beam)):
        e = beam.elements
        eps = section_strains(system, beam, Q)
        density = 0.5 * np.einsum("negi,eij,negj->neg", eps, e.stiffness, eps, optimize=True)
        out += np.einsum("neg,g,e->n", density, e.weights, e.lengths)
    return out[0] if single else out


def external_energy(system: System, q: ArrayLike, t: ArrayLike) -> Floats:
    """Potential ``-f(t) . q`` (J) of the dead loads and gravity with their value at time t.

    Moments and follower forces have no potential and are left out.
    """
    Q, single = as_stack(system, "q", q)
    times = as_times(t, len(Q))
    loading = system.loading
    if loading.constant:
        force = loading.dead_force(loading.values(0.0)).reshape(-1)
        out = -Q @ force
    else:
        out = np.array(
            [
                -row @ loading.dead_force(loading.values(float(s))).reshape(-1)
                for row, s in zip(Q, times, strict=True)
            ]
        )
    return out[0] if single else out


def section_strains(system: System, beam: Beam, q: ArrayLike) -> Floats:
    """``(Gamma, K)`` at the Gauss points of a beam's elements, (N, ne, ng, 6)."""
    Q, single = as_stack(system, "q", q)
    group = next((g for g in system.beam_groups if id(beam) in g.slices), None)
    if group is None:
        raise InputError(beam.label, "is not in this system")
    rows = group.rows[group.slices[id(beam)]]
    e = beam.elements
    y = Q.reshape(len(Q), -1, 3)[:, rows].reshape(len(Q), len(rows), -1)
    if e.rotations is not None:
        nodal = y.reshape(len(Q), *rows.shape[:1], -1, 4, 3).copy()
        nodal[..., 1:, :] = e.rotations @ nodal[..., 1:, :]
        y = nodal.reshape(y.shape)
    B = np.einsum("nek,gijk->negij", y, e.table, optimize=True)
    eps = 0.5 * np.einsum("negij,nej->negi", B, y) / e.lengths[:, None, None] - e.reference
    return eps[0] if single else eps


def section_forces(system: System, beam: Beam, q: ArrayLike) -> Floats:
    """``(N_1, N_2, N_3, M_1, M_2, M_3)`` at the Gauss points, in the section's frame.

    Forces (N) and moments (N m) on the face with outward normal +d3; tension positive.
    """
    strains = section_strains(system, beam, q)
    return np.einsum("...egj,ejk->...egk", strains, beam.elements.stiffness)
