"""Time integrators: each module writes only its discrete equations."""

from .asynchronous import Asynchronous
from .base import Integrator, State, StepWork
from .composition import Composition
from .energy_decaying import EnergyDecaying
from .energy_momentum import EnergyMomentum
from .explicit import Explicit
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
    "StepReport",
    "StepWork",
    "Stepper",
    "Variational",
]
