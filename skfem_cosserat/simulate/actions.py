"""What events do: stop the run, switch loads, lock, free or release joints, go on otherwise."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

from ..errors import InputError
from ..integrators import State
from ..joint import Joint
from ..load import Amplitude, Load, time_function
from ..model import Model, System
from ..model.change import joint_of, load_of, locked, released, unlocked, with_amplitude
from .start import consistent_start
from .view import View

__all__ = [
    "Action",
    "ActionFunction",
    "ActionLoad",
    "ActionLock",
    "ActionNone",
    "ActionRelease",
    "ActionStop",
    "ActionUnlock",
    "Outcome",
]


class Outcome(NamedTuple):
    """What an action asks for.

    Attributes
    ----------
    system : System or None
        To go on with; None: as before.
    state : State or None
        To go on from; None: this one, with the nearest velocity that the system allows.
    stop : bool
    """

    system: System | None = None
    state: State | None = None
    stop: bool = False


class Action(ABC):
    """What an event does."""

    def __repr__(self) -> str:
        own = ", ".join(str(getattr(each, "name", each)) for each in vars(self).values())
        return f"{type(self).__name__}({own})"

    def check(self, system: System) -> None:
        """Raise InputError if it refers to what is not in the system."""
        return

    @abstractmethod
    def outcome(self, view: View) -> Outcome:
        """What becomes of the run at a state."""


class ActionNone(Action):
    """Nothing: the event is recorded, with its state."""

    def outcome(self, view: View) -> Outcome:
        """See the base class."""
        return Outcome()


class ActionStop(Action):
    """The run ends there, with status "stopped"."""

    def outcome(self, view: View) -> Outcome:
        """See the base class."""
        return Outcome(stop=True)


class _JointAction(Action):
    def __init__(self, joint: Joint | str) -> None:
        if not isinstance(joint, Joint | str):
            raise InputError("action", f"joint = {joint!r}, expected a joint or its name")
        self.joint = joint

    def check(self, system: System) -> None:
        """See the base class."""
        joint_of(system, self.joint)


class ActionLock(_JointAction):
    """A joint becomes rigid as it stands: its relative coordinates are frozen, its drives end.

    Velocities become the nearest ones, in the kinetic energy, that the locked scene allows: those
    after an inelastic impact between its sides. What that takes is in ``history["dissipated"]``
    and the event's ``loss``.

    Parameters
    ----------
    joint : Joint or str
        Or its name. Both sides need directions and must not be ground in prescribed motion.

    Examples
    --------
    >>> ActionLock("knee")
    ActionLock(knee)
    """

    def outcome(self, view: View) -> Outcome:
        """See the base class."""
        return Outcome(locked(view.system, self.joint, view.q, view.time))


class ActionUnlock(_JointAction):
    """A joint that was locked moves again as before."""

    def outcome(self, view: View) -> Outcome:
        """See the base class."""
        return Outcome(unlocked(view.system, self.joint, view.q, view.time))


class ActionRelease(_JointAction):
    """A joint is taken away, with its drives: what it held flies on.

    Springs and dampers on its coordinates stay.

    Parameters
    ----------
    joint : Joint or str
        Or its name.
    """

    def outcome(self, view: View) -> Outcome:
        """See the base class."""
        return Outcome(released(view.system, self.joint, view.q, view.time))


class ActionLoad(Action):
    """A load gets another amplitude: 0 switches it off, 1 on.

    Parameters
    ----------
    load : Load or str
        Or its name.
    amplitude : float, TimeFunction or callable
        Of a load whose components are functions of time: a number, by which they are multiplied.
    """

    def __init__(self, load: Load | str, amplitude: Amplitude) -> None:
        if not isinstance(load, Load | str):
            raise InputError("action", f"load = {load!r}, expected a load or its name")
        time_function("action", amplitude)
        self.load, self.amplitude = load, amplitude

    def check(self, system: System) -> None:
        """See the base class."""
        load_of(system, self.load)

    def outcome(self, view: View) -> Outcome:
        """See the base class."""
        return Outcome(with_amplitude(view.system, self.load, self.amplitude))


class ActionFunction(Action):
    """A function of your own gives what to go on with.

    Parameters
    ----------
    function : callable
        ``function(time, view)`` gives a Model or System with the same coordinates, a State to go
        on from, both as ``(system, state)``, or None: go on as before.
    """

    def __init__(self, function: Callable[[float, View], object]) -> None:
        if not callable(function):
            raise InputError("action", f"{function!r}, expected an Action or a function")
        self.function = function

    def outcome(self, view: View) -> Outcome:
        """See the base class."""
        answer = self.function(view.time, view)
        given = answer if isinstance(answer, tuple) else (answer,)
        system, state = None, None
        for each in given:
            if isinstance(each, Model):
                system = each.freeze()
            elif isinstance(each, System):
                system = each
            elif isinstance(each, State):
                state = each
            elif each is not None:
                raise InputError("action", f"gave {each!r}, expected a model, system or state")
        if system is not None and (system.n, system.total) != (view.system.n, view.system.total):
            raise InputError(
                "action",
                f"gave a system with n = {system.n} and {system.total} rows, expected"
                f" {view.system.n} and {view.system.total}: stop here, and start a run of its own",
            )
        if state is not None:
            now = replace(state, time=view.time)
            consistent_start(view.system if system is None else system, now, "action: its state")
        return Outcome(system, state)
