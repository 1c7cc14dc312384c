"""Verbs: ``modes`` for small vibrations, ``buckling`` for critical loads of the linear theory."""

from .modes import Modes, modes

__all__ = ["Modes", "modes"]
