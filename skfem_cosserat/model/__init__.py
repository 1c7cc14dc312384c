"""The scene and the arrays it freezes to."""

from .plane import Planar, Planarity
from .scene import Model, model_of, planarity, system_of, takes_scene
from .system import System

__all__ = [
    "Model",
    "Planar",
    "Planarity",
    "System",
    "model_of",
    "planarity",
    "system_of",
    "takes_scene",
]
