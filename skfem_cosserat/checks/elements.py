"""Doubts about elements: bent, drawn or pressed too far, or too coarse for what they show."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from ..diagnostics.energy import group_stretches, kinetic_energy
from ..diagnostics.forces import multipliers
from ..diagnostics.stacked import all_rows
from ..types import spread
from .coarseness import energies, held_stresses
from .result import Doubt, Path, Recorded, Shapes, recorded_amplitudes

if TYPE_CHECKING:
    from ..beam import Beam

#: energy that elements lack, against all there is, above which a result is doubtful: frequencies
#: are off by five percent then
LACKING = 0.1


def inside_out(result: Recorded) -> Iterator[Doubt]:
    """Elements that are pressed to no length or less, as no real bar can be."""
    system, history = result.system, result.history
    for group in system.beam_groups:
        stretch = group_stretches(group, history["q"]).min(axis=2)
        rows = np.flatnonzero((stretch <= 0).any(axis=1))
        for row in rows[:1]:
            worst = int(stretch[row].argmin())
            own = [(group.slices.get(id(beam), slice(0, 0)), beam) for beam in system.beams]
            first, beam = next((e.start, beam) for e, beam in own if e.start <= worst < e.stop)
            yield Doubt(
                beam.label,
                f"element {worst - first} is pressed inside out: its axial strain is"
                f" {stretch[row, worst] - 1:.3g}, at or below -1 nothing is left of its length",
                float(history.instants[row]),
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
    if not seen.any() or not np.isfinite(states).all():
        return
    if result.bent:
        return  # told of already, and nothing follows from how they are bent
    lams = np.zeros((len(rows), system.m))
    if system.theory_rows:
        lams = multipliers(system, states, history["constraint_force"][rows])
    total = np.zeros((len(beams), 2))
    for row, y, lam in zip(rows, states, lams, strict=True):
        if np.isfinite(lam).all():
            stresses = [
                group.stress(group.strain(y)[0]) + held
                for group, held in zip(system.beam_groups, held_stresses(system, lam), strict=True)
            ]
            acting = recorded_amplitudes(history, row) if at_rest else None
            total += energies(system, y, stresses, acting)
    total[~seen, 0] = 0.0
    lacking, stored = total.sum(axis=0)
    stiffest = sum(b.elements.stiffness.trace(axis1=1, axis2=2) @ b.elements.lengths for b in beams)
    energy = max(lacking + stored, stiffest * len(rows) * 1e-20)  # of strains that are rounding
    if not at_rest:
        energy = max(energy, 2 * np.nansum(kinetic_energy(system, history["p"][rows])))
    if abs(lacking) > LACKING * energy:
        beam = beams[int(abs(total[:, 0]).argmax())]
        yield Doubt(
            beam.label,
            "its elements are too coarse for this bending: by the balance of forces what the scene"
            f" gives way is off by some {100 * abs(lacking) / energy:.0f} %",
            remedy=_finer(beam),
        )


def coarse_shapes(result: Shapes) -> Iterator[Doubt]:
    """Modes that the mesh makes, or makes wrong."""
    lacking, stored = result.energies.sum(axis=1).T
    energy = np.where(result.energy > 0, np.maximum(result.energy, stored), np.inf)
    share = abs(lacking) / energy
    found, worst = np.flatnonzero(share > LACKING), int(share.argmax())
    if len(found):
        beam = result.system.beams[int(abs(result.energies[worst, :, 0]).argmax())]
        off = (1 + share[worst]) ** (1 / result.power) - 1
        yield Doubt(
            beam.label,
            f"its elements are too coarse for mode {', '.join(map(str, found))}: by the balance of"
            f" forces the {result.told} of mode {worst} is off by some {100 * off:.0f} %",
            remedy=_finer(beam),
        )


def _finer(beam: Beam) -> str:
    """Advice to raise the order of a beam or to refine its mesh."""
    order = beam.basis.order
    return f"give it order=3, which is {order}" if order < 3 else "take more elements"
