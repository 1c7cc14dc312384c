"""Diagnostics of a system and its states: energies, momenta, violations, forces, reactions.

States come one by one or stacked: q and p have shape (n,) or (N, n), results then have a leading
axis N. A momentum p is that of the discrete Legendre transform, ``history["p"]``, all four blocks
of a frame included; the angular momentum is exact only with the d3 blocks.
"""

from .energy import (
    external_energy,
    kinetic_energy,
    kinetic_energy_of_velocity,
    midpoint_energy,
    momentum,
    section_forces,
    section_strain_rates,
    section_strains,
    strain_energy,
)
from .error import (
    SectionValues,
    evaluate,
    forces_along,
    transfer,
)
from .forces import (
    accelerations,
    condition_number,
    constraint_points,
    end_forces,
    multipliers,
    nodal_resultants,
    reactions,
)
from .inputs import unseen
from .joint_motion import coupling_energy
from .momenta import (
    Projection,
    angular_momentum,
    constraint_violation,
    ground_part,
    hidden_violation,
    legendre_transforms,
    linear_momentum,
    midpoint_angular_momentum,
    momentum_violation,
    prescribed_velocity,
    reduced_momentum,
    velocity_from_reduced,
)
from .resolution import Alternation, Resolution, alternation, doubtful_steps, resolution
from .stacked import ReducedTangent, constraint_frequency, highest_frequency, reduced_tangent

__all__ = [
    "Alternation",
    "Projection",
    "ReducedTangent",
    "Resolution",
    "SectionValues",
    "accelerations",
    "alternation",
    "angular_momentum",
    "condition_number",
    "constraint_frequency",
    "constraint_points",
    "constraint_violation",
    "coupling_energy",
    "doubtful_steps",
    "end_forces",
    "evaluate",
    "external_energy",
    "forces_along",
    "ground_part",
    "hidden_violation",
    "highest_frequency",
    "kinetic_energy",
    "kinetic_energy_of_velocity",
    "legendre_transforms",
    "linear_momentum",
    "midpoint_angular_momentum",
    "midpoint_energy",
    "momentum",
    "momentum_violation",
    "multipliers",
    "nodal_resultants",
    "prescribed_velocity",
    "reactions",
    "reduced_momentum",
    "reduced_tangent",
    "resolution",
    "section_forces",
    "section_strain_rates",
    "section_strains",
    "strain_energy",
    "transfer",
    "unseen",
    "velocity_from_reduced",
]
