"""Time integrators, each in a module of its equations, and the steps that are taken with them."""

from .base import Integrator as Integrator
from .block import Block as Block, StepReport as StepReport
from .composition import Composition as Composition
from .energy_momentum import EnergyDecaying as EnergyDecaying, EnergyMomentum as EnergyMomentum
from .explicit import Explicit as Explicit
from .generalized_alpha import GeneralizedAlpha as GeneralizedAlpha
from .scheme import Scheme as Scheme, State as State, StepOrigin as StepOrigin, StepWork as StepWork
from .step_balance import Evaluation as Evaluation, StepBalance as StepBalance, StepData as StepData
from .stepper import Stepper as Stepper
from .variational import Variational as Variational
