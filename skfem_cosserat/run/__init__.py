"""Integration in time: a generator of steps, and a simulation with a history on top of it."""

from ..analysis.describe import derive_series as derive_series, describe as describe
from ..analysis.start import (
    carry_state as carry_state,
    initial_state as initial_state,
    project as project,
)
from .conditions import (
    Action as Action,
    ActionFunction as ActionFunction,
    ActionLoad as ActionLoad,
    ActionLock as ActionLock,
    ActionNone as ActionNone,
    ActionOutcome as ActionOutcome,
    ActionRelease as ActionRelease,
    ActionStop as ActionStop,
    ActionUnlock as ActionUnlock,
    Condition as Condition,
    ConditionCoordinate as ConditionCoordinate,
    ConditionEnergy as ConditionEnergy,
    ConditionFunction as ConditionFunction,
    ConditionReaction as ConditionReaction,
    ConditionSensor as ConditionSensor,
    ConditionTime as ConditionTime,
)
from .events import Event as Event, after_events as after_events
from .loop import simulate as simulate, steps as steps
from .plan import StepControl as StepControl
from .record import restart as restart
from .sensors import (
    Sensor as Sensor,
    SensorAcceleration as SensorAcceleration,
    SensorForce as SensorForce,
    SensorPosition as SensorPosition,
    SensorQuantity as SensorQuantity,
    SensorReaction as SensorReaction,
    SensorStrain as SensorStrain,
    SensorVelocity as SensorVelocity,
    View as View,
    Window as Window,
)
