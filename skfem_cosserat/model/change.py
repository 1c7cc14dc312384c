"""Scenes that change while they move: joints locked, freed or taken away, loads switched.

A changed scene is a :class:`System` of its own with the same coordinates, ground frames and stress
free beams; where joints change, all constraints are set up at the configuration of that instant.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import replace

from ..drive import JointDrive
from ..errors import IncompatibleError, InputError
from ..frames import Place
from ..joint import Joint, JointLocked
from ..load import Amplitude, Constant, FunctionOfTime, Load, time_function
from ..types import Floats
from .ground import Placed
from .system import System

__all__ = ["joint_of", "load_of", "locked", "released", "unlocked", "with_amplitude"]


def joint_of(system: System, joint: Joint | str) -> Joint:
    """A joint of a system as it is now, by its name or by the joint it was at first.

    Raises
    ------
    InputError
        If there is none; the message lists the names.
    """
    name = joint.name if isinstance(joint, Joint) else joint
    for each in system.joints:
        if each.name == name:
            return each
    known = sorted(str(each.name) for each in system.joints)
    raise InputError("joint", f"{name!r} is not in this system; known: {known}")


def load_of(system: System, load: Load | str) -> Load:
    """A load of a system as it is now, by its name or by the load it was at first."""
    name = load.name if isinstance(load, Load) else load
    for each in system.loads:
        if each.name == name:
            return each
    known = sorted(str(each.name) for each in system.loads)
    raise InputError("load", f"{name!r} is not in this system; known: {known}")


def locked(system: System, joint: Joint | str, q: Floats, t: float) -> System:
    """The scene with the relative coordinates of a joint frozen at (q, t); its drives end.

    Raises
    ------
    IncompatibleError
        If a side has no directions, or is ground in prescribed motion.
    """
    old = joint_of(system, joint)
    if isinstance(old, JointLocked):
        raise InputError(old.label, "is locked already")
    for place in (old.a, old.b):
        if place.triad is None:
            reason = f"{place.label} is a mass point, which has no directions to hold"
            raise IncompatibleError(f"lock of the {old.label}", reason)
        if place.motion is not None:
            reason = f"{place.label} is in prescribed motion: attach a body to it, and lock that"
            raise IncompatibleError(f"lock of the {old.label}", reason)
    y = system.extend(q, t)
    x = _point(system, old.b, y)
    new = JointLocked(old, _described(system, old.a, y, x), _described(system, old.b, y, x))
    joints = [new if each is old else each for each in system.joints]
    return _changed(system, q, t, joints, _without(system, old))


def unlocked(system: System, joint: Joint | str, q: Floats, t: float) -> System:
    """The scene with a locked joint as it was before; drives that ended do not come back."""
    old = joint_of(system, joint)
    if not isinstance(old, JointLocked):
        raise InputError(old.label, "is not locked")
    joints = [old.joint if each is old else each for each in system.joints]
    return _changed(system, q, t, joints, system.drives)


def released(system: System, joint: Joint | str, q: Floats, t: float) -> System:
    """The scene without a joint and its drives."""
    old = joint_of(system, joint)
    joints = [each for each in system.joints if each is not old]
    return _changed(system, q, t, joints, _without(system, old))


def with_amplitude(system: System, load: Load | str, amplitude: Amplitude) -> System:
    """The scene with another amplitude (a number or a function of time) of a load.

    Raises
    ------
    InputError
        If the components of the load are functions of time and the amplitude is no number.
    """
    old = load_of(system, load)
    time, new = time_function(old.label, amplitude), copy(old)
    if len(old.channels) == 1:
        new.channels = [(old.channels[0][0], time)]
    elif isinstance(time, Constant):
        factor = time.number
        new.channels = [
            (value, FunctionOfTime(lambda t, each=each: factor * each.value(t)))  # type: ignore[misc]
            for value, each in old.channels
        ]
    else:
        raise InputError(old.label, "its components are functions of time: give a number")
    loads = [new if each is old else each for each in system.loads]
    return _anew(system, system.joints, loads, system.drives, system.placed)


def _changed(
    system: System, q: Floats, t: float, joints: Sequence[Joint], drives: Sequence[JointDrive]
) -> System:
    placed = Placed(q.copy(), t, system.spatial.grounds)
    return _anew(system, joints, system.loads, drives, placed)


def _anew(
    system: System,
    joints: Sequence[Joint],
    loads: Sequence[Load],
    drives: Sequence[JointDrive],
    placed: Placed | None,
) -> System:
    items = system.structures, joints, loads, drives, system.couplings.items, system.dampings
    out = System(*items, placed)
    return out if system.plane is None else out.within(system.plane)


def _without(system: System, joint: Joint) -> list[JointDrive]:
    """Drives of other joints."""
    return [drive for drive in system.drives if drive.joint is not joint]


def _point(system: System, place: Place, y: Floats) -> Floats:
    """Where a place is."""
    row = system.row_of(place)
    return y[row] if place.triad is None else y[row] + place.offset @ y[row + 1 : row + 4]


def _described(system: System, place: Place, y: Floats, x: Floats) -> Place:
    """The point of a place's frame that is at x now, as if this were the reference."""
    row = system.row_of(place)
    D = y[row + 1 : row + 4].copy()
    return replace(place, position=x.copy(), offset=D @ (x - y[row]), triad=D)
