"""Diagnostics of a system and its states: energies, momenta, violations, forces, reactions.

States come one by one or stacked: q and p have shape (n,) or (N, n), results then have a leading
axis N. A momentum p is that of the discrete Legendre transform, ``history["p"]``, all four blocks
of a frame included; the angular momentum is exact only with the d3 blocks.
"""

from .energy import (
    external_energy as external_energy,
    kinetic_energy as kinetic_energy,
    kinetic_energy_of_velocity as kinetic_energy_of_velocity,
    midpoint_energy as midpoint_energy,
    momentum as momentum,
    section_forces as section_forces,
    section_strain_rates as section_strain_rates,
    section_strains as section_strains,
    strain_energy as strain_energy,
)
from .error import (
    SectionValues as SectionValues,
    evaluate as evaluate,
    forces_along as forces_along,
    transfer as transfer,
)
from .forces import (
    accelerations as accelerations,
    condition_number as condition_number,
    constraint_points as constraint_points,
    end_forces as end_forces,
    multipliers as multipliers,
    nodal_resultants as nodal_resultants,
    reactions as reactions,
)
from .inputs import unseen as unseen
from .joint_motion import coupling_energy as coupling_energy
from .momenta import (
    Projection as Projection,
    angular_momentum as angular_momentum,
    constraint_violation as constraint_violation,
    ground_part as ground_part,
    hidden_violation as hidden_violation,
    legendre_transforms as legendre_transforms,
    linear_momentum as linear_momentum,
    midpoint_angular_momentum as midpoint_angular_momentum,
    momentum_violation as momentum_violation,
    prescribed_velocity as prescribed_velocity,
    reduced_momentum as reduced_momentum,
    velocity_from_reduced as velocity_from_reduced,
)
from .resolution import (
    Alternation as Alternation,
    Resolution as Resolution,
    alternation as alternation,
    doubtful_steps as doubtful_steps,
    resolution as resolution,
)
from .stacked import (
    ReducedTangent as ReducedTangent,
    constraint_frequency as constraint_frequency,
    highest_frequency as highest_frequency,
    reduced_tangent as reduced_tangent,
)
