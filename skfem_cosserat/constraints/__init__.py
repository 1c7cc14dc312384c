"""The two treatments of the constraints, interchangeable for every integrator."""

from .base import BoundTreatment, Treatment
from .multipliers import Multipliers
from .null_space import BoundNullSpace, NullSpace

__all__ = ["BoundNullSpace", "BoundTreatment", "Multipliers", "NullSpace", "Treatment"]
