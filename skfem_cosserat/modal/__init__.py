"""Verbs: ``modes`` for small vibrations, ``buckling`` for critical loads of the linear theory."""

from .buckling import Buckling, buckling
from .modes import Modes, modes

__all__ = ["Buckling", "Modes", "buckling", "modes"]
