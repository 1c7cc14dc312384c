"""The scene and the arrays it freezes to."""

from .scene import Model
from .system import System

__all__ = ["Model", "System"]
