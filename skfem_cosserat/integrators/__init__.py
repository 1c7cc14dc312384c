"""Time integrators, each in a module of its equations, and the steps that are taken with them."""

from .base import Integrator, State, StepOrigin, StepWork
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
    "Explicit",
    "GeneralizedAlpha",
    "Integrator",
    "State",
    "StepOrigin",
    "StepReport",
    "StepWork",
    "Stepper",
    "Variational",
]
