"""Time integrators: each module writes only its discrete equations."""

from .base import Integrator, State, StepWork
from .composition import Composition
from .energy_decaying import EnergyDecaying
from .energy_momentum import EnergyMomentum
from .generalized_alpha import GeneralizedAlpha
from .stepper import Stepper, StepReport
from .variational import Variational

__all__ = [
    "Composition",
    "EnergyDecaying",
    "EnergyMomentum",
    "GeneralizedAlpha",
    "Integrator",
    "State",
    "StepReport",
    "StepWork",
    "Stepper",
    "Variational",
]
