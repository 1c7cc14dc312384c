"""Adaptive meshes: refined where it matters, with what is known carried over."""

from .adapt import adapt
from .carry import carry_history, carry_state
from .chart import chart_errors
from .levels import Adapted, Level
from .quantity import NodePosition
from .runs import RunInTime, RunStatic
from .strategy import Halve, HalveOrRaise, Uniform

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
    "chart_errors",
]
