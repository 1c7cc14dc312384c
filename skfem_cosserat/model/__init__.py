"""The scene and the arrays it freezes to."""

from .plane import Planar as Planar, Planarity as Planarity
from .scene import (
    Model as Model,
    model_of as model_of,
    planarity as planarity,
    system_of as system_of,
    takes_scene as takes_scene,
)
from .system import System as System
