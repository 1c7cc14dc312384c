"""Time integrators: each module writes only its discrete equations."""

from .base import Integrator, State, StepWork
from .composition import Composition
from .energy_momentum import EnergyMomentum
from .stepper import Stepper, StepReport
from .variational import Variational

__all__ = [
    "Composition",
    "EnergyMomentum",
    "Integrator",
    "State",
    "StepReport",
    "StepWork",
    "Stepper",
    "Variational",
]
