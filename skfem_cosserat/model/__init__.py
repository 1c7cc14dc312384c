"""The scene and the arrays it freezes to."""

from .planarity import Planarity
from .plane import Planar
from .scene import Model, planarity
from .system import System

__all__ = ["Model", "Planar", "Planarity", "System", "planarity"]
