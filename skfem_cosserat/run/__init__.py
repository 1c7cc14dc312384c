"""Integration in time: a generator of steps, and a simulation with a history on top of it."""

from ..analysis.describe import derive_series, describe
from ..analysis.start import carry_state, initial_state, project
from .conditions import (
    Action,
    ActionFunction,
    ActionLoad,
    ActionLock,
    ActionNone,
    ActionOutcome,
    ActionRelease,
    ActionStop,
    ActionUnlock,
    Condition,
    ConditionCoordinate,
    ConditionEnergy,
    ConditionFunction,
    ConditionReaction,
    ConditionSensor,
    ConditionTime,
)
from .events import Event, after_events
from .loop import simulate, steps
from .plan import StepControl
from .record import restart
from .sensors import (
    Sensor,
    SensorAcceleration,
    SensorForce,
    SensorPosition,
    SensorQuantity,
    SensorReaction,
    SensorStrain,
    SensorVelocity,
    View,
    Window,
)

__all__ = [
    "Action",
    "ActionFunction",
    "ActionLoad",
    "ActionLock",
    "ActionNone",
    "ActionOutcome",
    "ActionRelease",
    "ActionStop",
    "ActionUnlock",
    "Condition",
    "ConditionCoordinate",
    "ConditionEnergy",
    "ConditionFunction",
    "ConditionReaction",
    "ConditionSensor",
    "ConditionTime",
    "Event",
    "Sensor",
    "SensorAcceleration",
    "SensorForce",
    "SensorPosition",
    "SensorQuantity",
    "SensorReaction",
    "SensorStrain",
    "SensorVelocity",
    "StepControl",
    "View",
    "Window",
    "after_events",
    "carry_state",
    "derive_series",
    "describe",
    "initial_state",
    "project",
    "restart",
    "simulate",
    "steps",
]
