"""``modes`` for small vibrations, ``buckling`` for critical loads of the linear theory."""

from .critical import Buckling, buckling
from .vibration import Modes, modes

__all__ = ["Buckling", "Modes", "buckling", "modes"]
