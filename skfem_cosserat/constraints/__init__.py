"""The two treatments of the constraints, interchangeable for every integrator."""

from .base import BoundTreatment as BoundTreatment, Treatment as Treatment
from .multipliers import Multipliers as Multipliers
from .null_space import BoundNullSpace as BoundNullSpace, NullSpace as NullSpace
