"""Integration in time: a generator of steps, and a simulation with a history on top of it."""

from .describe import derive_series, describe
from .loop import simulate, steps
from .start import initial_state, project, restart

__all__ = [
    "derive_series",
    "describe",
    "initial_state",
    "project",
    "restart",
    "simulate",
    "steps",
]
