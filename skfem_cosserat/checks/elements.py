"""Doubts about elements: bent, drawn or pressed too far, or too coarse for what they show."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..diagnostics.energy import group_stretches, kinetic_energy, recorded_factors
from ..diagnostics.forces import multipliers
from ..diagnostics.stacked import all_rows
from ..model import System
from ..model.limits import beam_of
from ..types import Floats, spread
from .coarseness import energies, held_stresses
from .result import Doubt, Path, Recorded, Shapes, recorded_amplitudes

#: energy that elements lack, against all there is, above which a result is doubtful: frequencies
#: are off by five percent then
LACKING = 0.1


def inside_out(result: Recorded) -> Iterator[Doubt]:
    """Elements that are pressed to no length or less, as no real bar can be."""
    system = result.system
    history = result.history
    for group in system.beam_groups:
        stretch = group_stretches(group, history["q"]).min(2)
        for row in np.flatnonzero((stretch <= 0).any(1))[:1]:
            worst = stretch[row].argmin()
            beam, e = beam_of(system, group, worst)
            yield Doubt(
                beam.label,
                f"element {e} is pressed inside out: its axial strain is"
                f" {stretch[row, worst] - 1:.3g}, at or below -1 nothing is left of its length",
                history.instants[row],
            )


def coarse(result: Recorded) -> Iterator[Doubt]:
    """Elements too coarse for the bending that a path or a run shows.

    In motion only linear ones are looked at: their forces follow from their ends, without inertia.
    """
    system, history, beams = result.system, result.history, result.system.beams
    at_rest = isinstance(result, Path)
    seen = np.array([at_rest or beam.basis.order == 1 for beam in beams])
    rows = spread(len(history), 5)
    states = all_rows(system, history["q"][rows], history.instants[rows])
    if result.bent or not seen.any() or not np.isfinite(states).all():
        return  # of how they are bent too far nothing follows
    lams = np.zeros((len(rows), system.m))
    if system.theory_rows:
        lams = multipliers(system, states, history["constraint_force"][rows])
    total = np.zeros((len(beams), 2))
    factors = recorded_factors(system, history)
    for row, y, lam in zip(rows, states, lams, strict=True):
        if np.isfinite(lam).all():
            acting = recorded_amplitudes(history, row) if at_rest else None
            loads = factors[row]
            stresses = [
                group.stress(group.strain(y)[0] - system.loading.strains(group, loads[None])[0])
                + held
                for group, held in zip(system.beam_groups, held_stresses(system, lam), strict=True)
            ]
            total += energies(system, y, stresses, acting)
    total[~seen, 0] = 0.0
    lacking, stored = total.sum(0)
    stiffest = sum(
        float(b.elements.weighted_stiffness.trace(axis1=2, axis2=3).sum()) for b in beams
    )
    energy = max(lacking + stored, stiffest * len(rows) * 1e-20)  # of strains that are rounding
    if not at_rest:
        energy = max(energy, 2 * np.nansum(kinetic_energy(system, history["p"][rows])))
    if abs(lacking) > LACKING * energy:
        off = abs(lacking) / energy
        yield _coarse(system, "this bending", "what the scene gives way", total, off)


def coarse_shapes(result: Shapes) -> Iterator[Doubt]:
    """Modes that the mesh makes, or makes wrong."""
    lacking, stored = result.energies.sum(1).T
    share = abs(lacking) / np.where(result.energy > 0, np.maximum(result.energy, stored), np.inf)
    found = np.flatnonzero(share > LACKING)
    worst = int(share.argmax())
    if len(found):
        of = f"mode {', '.join(map(str, found))}"
        told = f"the {result.told} of mode {worst}"
        off = (1 + share[worst]) ** (1 / result.power) - 1
        yield _coarse(result.system, of, told, result.energies[worst], off)


def _coarse(system: System, of: str, told: str, energies: Floats, off: float) -> Doubt:
    """Doubt about the beam that lacks most of some energies (beams, 2)."""
    beam = system.beams[abs(energies[:, 0]).argmax()]
    order = beam.basis.order
    return Doubt(
        beam.label,
        f"its elements are too coarse for {of}: by the balance of forces {told} is off by some"
        f" {100 * off:.0f} %",
        remedy=f"give it order=3, which is {order}" if order < 3 else "take more elements",
    )
