"""Array types used in annotations."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["Array", "ArrayLike", "Floats", "IndexArray", "TimeFunctionLike", "VectorLike"]

#: Real or complex numbers: kernels take complex input so that tangents can be checked by the
#: complex step.
Array: TypeAlias = NDArray[Any]
Floats: TypeAlias = NDArray[np.float64]
IndexArray: TypeAlias = NDArray[np.int64]
#: Three numbers.
VectorLike: TypeAlias = Sequence[float] | NDArray[np.float64]
#: A function of time: a number or three numbers for a time in s.
TimeFunctionLike: TypeAlias = Callable[[float], Any]
