"""Adaptive meshes: refined where it matters, with what is known carried over."""

from .adapt import Adapted, Halve, HalveOrRaise, Level, Uniform, adapt
from .runs import NodePosition, RunInTime, RunStatic, carry_history, carry_state

__all__ = [
    "Adapted",
    "Halve",
    "HalveOrRaise",
    "Level",
    "NodePosition",
    "RunInTime",
    "RunStatic",
    "Uniform",
    "adapt",
    "carry_history",
    "carry_state",
]
