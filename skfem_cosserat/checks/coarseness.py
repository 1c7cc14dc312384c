"""Energy that elements lack, as they are too coarse for what they carry.

Section forces follow from the nodal forces of an element by statics, with its inertia and loads in
between. Their complementary energy, against that of the section forces at its Gauss points, tells
how much too stiff the mesh is; of a mode that is Grammel's quotient against Rayleigh's. A shape of
the mesh alone, which no forces balance, shows the other way round: it stores what statics deny.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..diagnostics.energy import group_of
from ..diagnostics.forces import at_ends, spread_over
from ..diagnostics.stacked import balancing_multipliers, curvature_matrix
from ..kernels import BeamElements, cross
from ..law import STEP
from ..model import System
from ..model.balance import Amplitudes
from ..types import Array, Floats


def energies(
    system: System,
    y: Array,
    stresses: Sequence[Array],
    amplitudes: Amplitudes | None,
    acceleration: Array | float = 0.0,
) -> Floats:
    """Twice the energy (beams, 2) that elements lack and store in equilibrium (J), by beam.

    Parameters
    ----------
    system : System
    y : (rows or more, 3) array
        Configuration. At complex steps: the energies are those of the derivatives.
    stresses : list of (ne, ng, 6) array
        At the Gauss points of each beam group.
    amplitudes : Amplitudes or None
        None: neither loads nor inertia act between the nodes, of which nothing is known.
    acceleration : (rows, 3) array, optional
        Seen from a frame that turns, if there is a spin.
    """
    acceleration = acceleration + 0 * y[: system.rows]
    loads = np.zeros(len(system.loading.terms)) if amplitudes is None else amplitudes.loads
    if amplitudes is not None and amplitudes.spin is not None:
        acceleration += cross(amplitudes.spin.velocity, amplitudes.spin.rates(system, y))
    found: dict[int, Floats] = {}
    for group, stress in zip(system.beam_groups, stresses, strict=True):
        force = group.force(group.strain(y)[1], stress).reshape(len(stress), -1, 4, 3)
        own = [(beam, group.slices[id(beam)]) for beam in system.beams if id(beam) in group.slices]
        for beam, e in own:
            force[e] -= spread_over(system, beam, y, loads, None, acceleration)
        both = _both(group.elements, y[group.rows].reshape(force.shape), stress, force)
        found |= {id(beam): both[:, e].sum(1) for beam, e in own}
    return np.array([found[id(beam)] for beam in system.beams])


def _both(e: BeamElements, nodal: Array, stress: Array, force: Array) -> Floats:
    """Energies (2, ne) of what section forces by statics are off those of Gauss points, and these.

    Of nodal configurations and what nodes pass on, (ne, nn, 4, 3) each. What they are off is
    orthogonal to polynomials that Gauss points can have: of the Legendre polynomials that are left
    the values at both ends tell the first two.
    """
    from ..element import lagrange  # imports scikit-fem, which rigid bodies do without

    ends = at_ends(force, nodal, e.rotations)
    off, found = ends - lagrange(e.points, np.array([0.0, 1.0])).T @ stress, stress
    if np.iscomplexobj(off):
        off, found = off.imag / STEP, found.imag / STEP
    held = np.eye(6) * (np.einsum("eii->ei", e.stiffness) == 0)[:, :, None]
    compliance = np.linalg.inv(e.stiffness + held) - held
    order = len(e.points)
    parts = off[:, 1:] + (-1) ** order * np.array([[1.0], [-1.0]]) * off[:, :1]
    shares = 0.25 / (2 * order + np.array([1.0, 3.0]))
    return np.array(
        [
            ((each @ compliance) * each).sum(2) @ weights * e.lengths
            for each, weights in ((parts, shares), (found, e.weights))
        ]
    )


def held_stresses(system: System, multipliers: Floats) -> list[Floats]:
    """Resultants (ne, ng, 6) of strains that are held, of each beam group; zeros beside."""
    out = {id(group): np.zeros_like(group.elements.reference) for group in system.beam_groups}
    for held in system.theory_rows:
        group = group_of(system, held.beam)
        out[id(group)][group.slices[id(held.beam)]] = held.stress(multipliers)
    return list(out.values())


def energies_of_motion(
    system: System,
    y: Floats,
    stresses: Sequence[Floats],
    multipliers: Floats,
    amplitudes: Amplitudes,
    dq: Floats,
    acceleration: Floats,
) -> Floats:
    """Energies (beams, 2), as by :func:`energies`, of a small motion about an equilibrium.

    Parameters
    ----------
    y : (total, 3) array
        Equilibrium.
    stresses : list of (ne, ng, 6) array
        There, of strains that are not held.
    multipliers : (m,) array
        Of the constraint rows.
    amplitudes : Amplitudes
    dq, acceleration : (rows, 3) array
        The motion, and its acceleration, seen from a frame that turns if there is a spin.
    """
    moved = y.astype(complex)
    moved[: system.rows] += 1j * STEP * dq
    strains, Bs = zip(*(group.strain(moved) for group in system.beam_groups), strict=True)
    total = [
        before + held + 1j * group.linear_stress(group.moduli(eps), eps.imag)
        for group, before, held, eps in zip(
            system.beam_groups, stresses, held_stresses(system, multipliers), strains, strict=True
        )
    ]
    if system.theory_rows:
        others = multipliers.copy()
        for each in system.theory_rows:
            others[each.rows] = 0.0
        R = system.internal_force(list(Bs), total).imag / STEP + system.mass @ acceleration
        R = R.ravel() + curvature_matrix(system, y, others) @ dq.ravel()
        more = held_stresses(system, balancing_multipliers(system, y, R))
        total = [s + 1j * STEP * h for s, h in zip(total, more, strict=True)]
    return energies(system, moved, total, amplitudes, 1j * STEP * acceleration)
