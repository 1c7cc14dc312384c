"""The two treatments of the constraints, interchangeable for every integrator."""

from .base import BoundTreatment, Treatment
from .multipliers import Multipliers
from .nullspace import NullSpace

__all__ = ["BoundTreatment", "Multipliers", "NullSpace", "Treatment"]
