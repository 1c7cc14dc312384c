"""How long an event is, where nobody says: as long as loads change and the scene needs to react."""

from __future__ import annotations

import numpy as np

from ..errors import InputError
from ..integrators import State
from ..load import Constant, Load, LoadGravity, Table
from ..model import Model, System

__all__ = ["duration"]


def duration(model: Model, system: System, state: State) -> float:
    """A natural end (s): twice the time of tables, one swing under gravity, one passage.

    Raises
    ------
    InputError
        If nothing in the scene tells a time.

    Examples
    --------
    >>> from skfem_cosserat import JointDistance, MassPoint, ground, initial_state
    >>> model = Model()
    >>> bob = model.add("bob", MassPoint(1.0, position=(1.0, 0, 0)))
    >>> rod = model.add("rod", JointDistance(ground((0, 0, 0)), bob.place()))
    >>> weight = model.add("weight", LoadGravity((0, 0, -10.0)))
    >>> system = model.freeze()
    >>> round(duration(model, system, initial_state(system)), 3)   # 2 pi sqrt(L/g)
    1.987
    """
    found = []
    for name in model:
        item = model[name]
        if not isinstance(item, Load):
            continue
        for value, time in item.channels:
            if isinstance(time, Table) and time.times[-1] > 0:
                found.append(2 * float(time.times[-1]))
            elif isinstance(time, Constant) and isinstance(item, LoadGravity):
                size = abs(time.number) * float(np.linalg.norm(value))
                if size > 0:
                    found.append(2 * np.pi * float(np.sqrt(system.length / size)))
    energy = state.p.reshape(-1, 3)[system.origin_rows]
    mass = float(system.mass.diagonal()[system.origin_rows].sum())
    speed = float(np.linalg.norm(energy.sum(axis=0))) / mass if mass else 0.0
    if speed > 0:
        found.append(system.length / speed)
    if not found:
        raise InputError("argument until", "is missing, and nothing in the scene tells a time")
    return max(found)
