"""Time integrators, each in a module of its equations, and the steps that are taken with them."""

from .base import (
    Evaluation,
    Integrator,
    Scheme,
    State,
    StepData,
    StepOrigin,
    StepWork,
    damped_force,
    load_force,
    midpoint_tangent,
)
from .composition import Composition
from .energy_decaying import EnergyDecaying
from .energy_momentum import EnergyMomentum
from .explicit import Asynchronous, Explicit
from .generalized_alpha import GeneralizedAlpha
from .stepper import Stepper, StepReport
from .variational import Variational

__all__ = [
    "Asynchronous",
    "Composition",
    "EnergyDecaying",
    "EnergyMomentum",
    "Evaluation",
    "Explicit",
    "GeneralizedAlpha",
    "Integrator",
    "Scheme",
    "State",
    "StepData",
    "StepOrigin",
    "StepReport",
    "StepWork",
    "Stepper",
    "Variational",
    "damped_force",
    "load_force",
    "midpoint_tangent",
]
