"""What a pilot run tells of a scene: where its energy is, how fast it moves, where it bends."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..beam import Beam
from ..diagnostics import highest_frequency, kinetic_energy, section_strains
from ..errors import CosseratError
from ..history import History
from ..kernels import beam_stress
from ..model import System
from ..types import Floats

__all__ = ["Pilot", "look"]

#: how the six strains are called, by energy
PARTS = {"shear": (0, 1), "axial": (2,), "bending": (3, 4), "torsion": (5,)}


@dataclass
class Pilot:
    """Numbers of a pilot run.

    Attributes
    ----------
    energy : dict of str to dict of str to float
        By beam: mean shear, axial, bending and torsion energy (J).
    kinetic : float
        Mean kinetic energy of the scene (J).
    bend : dict of str to float
        By beam: the largest angle it is bent or twisted by in all (rad).
    stretch : dict of str to float
        By beam: the largest shear or axial strain.
    jump : dict of str to float
        By beam: largest jump of curvature between elements, as a part of the largest curvature.
    frequency : float
        The highest natural frequency (rad/s).
    seen : dict of str to float
        By sensor: angular frequency of the largest peak of its spectrum (rad/s).
    constraint_force : float
        Largest force of constraints on a node or body (N).
    """

    energy: dict[str, dict[str, float]] = field(default_factory=dict)
    kinetic: float = 0.0
    bend: dict[str, float] = field(default_factory=dict)
    stretch: dict[str, float] = field(default_factory=dict)
    jump: dict[str, float] = field(default_factory=dict)
    frequency: float = 0.0
    seen: dict[str, float] = field(default_factory=dict)
    constraint_force: float = 0.0

    def share(self, beam: str, part: str) -> float:
        """Part of a beam's strain energy that is shear, axial, bending or torsion."""
        parts = self.energy.get(beam, {})
        return parts.get(part, 0.0) / (sum(parts.values()) or 1.0)

    def lines(self, step: float) -> list[str]:
        """Sentences about the scene, the frequencies against a step (s)."""
        out = [
            f"kinetic energy {self.kinetic:.3g} J on average, constraint forces up to"
            f" {self.constraint_force:.3g} N"
        ]
        for name, parts in self.energy.items():
            total = sum(parts.values()) or 1.0
            shares = ", ".join(f"{part} {100 * e / total:.2g} %" for part, e in parts.items())
            out.append(
                f"{name}: {total:.3g} J of strain energy ({shares}); bent or twisted by"
                f" {self.bend[name]:.2g} rad, strained by {self.stretch[name]:.2g}, curvature jumps"
                f" by {100 * self.jump[name]:.2g} % between elements of the pilot"
            )
        if self.frequency:
            out.append(
                f"highest frequency of the pilot {self.frequency:.3g} rad/s,"
                f" {self.frequency * step:.3g} a step of the proposal"
            )
        for name, omega in self.seen.items():
            out.append(f"{name} moves at {omega:.3g} rad/s most, {omega * step:.3g} a step")
        return out


def look(system: System, history: History) -> Pilot:
    """Numbers of a run (without derived series)."""
    pilot = Pilot()
    q = history["q"]
    pilot.kinetic = float(np.mean(kinetic_energy(system, history["p"])))
    force = history["constraint_force"][1:].reshape(-1, system.rows, 3)[:, system.origin_rows]
    pilot.constraint_force = float(np.linalg.norm(force, axis=2).max(initial=0.0))
    for beam in (item for item in system.structures if isinstance(item, Beam)):
        _look_at_beam(pilot, system, beam, q)
    try:
        pilot.frequency = highest_frequency(system)
    except (CosseratError, ArithmeticError):  # told only, never needed
        pilot.frequency = 0.0
    for name, record in history.sensors.items():
        if len(record.times) >= 8 and record.values.ndim <= 2:
            peaks = record.spectrum().peaks(1)
            if len(peaks):
                pilot.seen[name] = float(2 * np.pi * peaks[0])
    return pilot


def _look_at_beam(pilot: Pilot, system: System, beam: Beam, q: Floats) -> None:
    name, e = str(beam.name), beam.elements
    eps = section_strains(system, beam, q)
    stress = np.array([beam_stress(e, each) for each in eps])
    weights = e.lengths[:, None] * e.weights
    energy = 0.5 * np.einsum("negk,negk,eg->k", eps, stress, weights) / len(q)
    pilot.energy[name] = {part: float(energy[list(k)].sum()) for part, k in PARTS.items()}
    curvature = np.linalg.norm(eps[..., 3:], axis=-1)
    pilot.bend[name] = float(np.einsum("neg,eg->n", curvature, weights).max())
    pilot.stretch[name] = float(abs(eps[..., :3]).max())
    ne = len(e.lengths)
    t = beam.mesh.t
    meet = np.flatnonzero(t[1, : ne - 1] == t[0, 1:ne])
    jump = np.linalg.norm(eps[:, meet + 1, 0, 3:] - eps[:, meet, -1, 3:], axis=-1)
    size = float(curvature.max())
    pilot.jump[name] = float(jump.max(initial=0.0)) / size if size else 0.0
