"""Integration in time: a generator of steps, and a simulation with a history on top of it."""

from .describe import derive_series, describe
from .loop import simulate, steps
from .sensors import (
    Sensor,
    SensorAcceleration,
    SensorForce,
    SensorPosition,
    SensorQuantity,
    SensorReaction,
    SensorStrain,
    SensorVelocity,
)
from .start import initial_state, project, restart

__all__ = [
    "Sensor",
    "SensorAcceleration",
    "SensorForce",
    "SensorPosition",
    "SensorQuantity",
    "SensorReaction",
    "SensorStrain",
    "SensorVelocity",
    "derive_series",
    "describe",
    "initial_state",
    "project",
    "restart",
    "simulate",
    "steps",
]
