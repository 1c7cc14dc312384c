"""Energy that elements lack, as they are too coarse for what they carry.

Section forces follow from the nodal forces of an element by statics, with its inertia and loads in
between. Their complementary energy, against that of the section forces at its Gauss points, tells
how much too stiff the mesh is; of a mode that is Grammel's quotient against Rayleigh's. A shape of
the mesh alone, which no forces balance, shows the other way round: it stores what statics deny.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from ..diagnostics.energy import group_of
from ..diagnostics.forces import Statics, components, integrals, spread_over
from ..diagnostics.stacked import balancing_multipliers, curvature_matrix
from ..kernels import cross, product
from ..law import STEP
from ..model import System
from ..model.balance import Amplitudes
from ..model.groups import BeamGroup
from ..types import Array, Floats

if TYPE_CHECKING:
    from ..element import Interpolation


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
        At the Gauss points of each beam group, without strains of loads.
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
        nodal = y[group.rows].reshape(force.shape)
        spread = np.zeros_like(nodal)
        own = [(beam, group.slices[id(beam)]) for beam in system.beams if id(beam) in group.slices]
        for beam, e in own:
            spread[e] = spread_over(system, beam, y, loads, None, acceleration)
        both = _both(group, nodal, stress, force - spread, spread)
        found |= {id(beam): both[:, e].sum(1) for beam, e in own}
    return np.array([found[id(beam)] for beam in system.beams])


@lru_cache(maxsize=8)
def _tables(kind: Interpolation) -> tuple[Any, ...]:
    """Points, weights, shape functions there, what spreads nodal values, and integrals up to."""
    from ..element import gauss_rule

    z, w = gauss_rule(kind.order + 3)
    at = kind.tabulated(z, w)
    return z, w, at, at.values.T @ np.linalg.inv((at.values * w) @ at.values.T), integrals(z, z)


def _both(group: BeamGroup, nodal: Array, stress: Array, force: Array, spread: Array) -> Floats:
    """Energies (2, ne) by statics less those of Gauss points, and these.

    Of nodal configurations, what nodes pass on, and what is spread: (ne, nn, 4, 3) each.
    """
    from ..element import lagrange  # imports scikit-fem, which rigid bodies do without

    e = group.elements
    h = group.elements.lengths[:, None, None]
    z, w, at, shapes, over = _tables(group.interpolation)
    weights = lagrange(e.points, z).T
    density = np.einsum("qa,eaic->eqic", shapes, spread) / h[..., None]
    x = np.einsum("aq,eaic->eqic", at.values, nodal)
    statics = Statics(force, nodal, 0, density, x, h * over)
    m = statics.moment(np.einsum("aq,eac->eqc", at.slopes, nodal[:, :, 0]) / h)
    turned = nodal[:, :, 1:] if e.rotations is None else e.rotations @ nodal[:, :, 1:]
    balanced = components(np.einsum("aq,eaic->eqic", at.values, turned), statics.n, m)
    found = weights @ stress
    if np.iscomplexobj(found):
        balanced = balanced.imag / STEP
        found = found.imag / STEP
    stiffness = np.einsum("qg,egij->eqij", weights, e.stiffness)
    held = np.eye(6) * (np.einsum("eqii->eqi", stiffness) == 0)[..., None]
    compliance = np.linalg.inv(stiffness + held) - held
    own, stored = (
        (product(each, compliance) * each).sum(2) @ w * e.lengths for each in (balanced, found)
    )
    return np.array([own - stored, stored])


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
        There, of strains that are not held, with those of loads.
    multipliers : (m,) array
        Of the constraint rows.
    amplitudes : Amplitudes
    dq, acceleration : (rows, 3) array
        The motion, and its acceleration, seen from a frame that turns if there is a spin.
    """
    moved = y.astype(complex)
    moved[: system.rows] += 1j * STEP * dq
    strains, Bs = zip(*(group.strain(moved) for group in system.beam_groups), strict=True)
    loads = amplitudes.loads[None]
    total = [
        before
        + held
        + group.linear_stress(
            group.moduli(eps), 1j * eps.imag - system.loading.strains(group, loads)[0]
        )
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
