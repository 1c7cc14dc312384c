"""Time integrators, each in a module of its equations, and the steps that are taken with them."""

from .base import Integrator
from .block import Block, StepReport
from .composition import Composition
from .energy_momentum import EnergyDecaying, EnergyMomentum
from .explicit import Explicit
from .generalized_alpha import GeneralizedAlpha
from .scheme import Scheme, State, StepOrigin, StepWork
from .step_balance import Evaluation, StepBalance, StepData
from .stepper import Stepper
from .variational import Variational

__all__ = [
    "Block",
    "Composition",
    "EnergyDecaying",
    "EnergyMomentum",
    "Evaluation",
    "Explicit",
    "GeneralizedAlpha",
    "Integrator",
    "Scheme",
    "State",
    "StepBalance",
    "StepData",
    "StepOrigin",
    "StepReport",
    "StepWork",
    "Stepper",
    "Variational",
]
