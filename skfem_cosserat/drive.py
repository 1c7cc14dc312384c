"""Drives: joint coordinates prescribed in time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from .errors import InputError
from .frames import TOLERANCE, Item, Motion, Place, StructuralItem
from .joint import Joint
from .load import FunctionOfTime
from .relative import ORIGIN, Amplitude, Expression, Form, Product, RelativeCoordinate
from .types import Floats

__all__ = ["JointDrive"]


@dataclass(frozen=True, eq=False)
class _Prescribed(Motion):
    """A number in time as the position ``(cos, sin, number)`` of a ground frame."""

    number: Callable[[float], float] = float

    def frame(self, place: Place, t: float) -> Floats:
        """See the base class."""
        value = self.number(t)
        return np.vstack([[np.cos(value), np.sin(value), value], np.eye(3)])


class JointDrive(Item):
    """Prescribes an angle or a displacement of a joint: 1 constraint more, whatever it takes.

    The constraint is ``sin(theta - theta(t)) = 0`` or ``s - s(t) = 0``; with the null space the
    coordinate is eliminated (unless the joint closes a loop). Torque or force of the drive are
    ``joint/NAME/moment`` and ``joint/NAME/force`` of the history, NAME being the drive's (they are
    no part of the joint's own), its work is ``work_drives``.

    Parameters
    ----------
    joint : Joint
        Of the same model.
    motion : callable
        ``t -> float``: angle (rad) or displacement (m) from side a to side b, relative to the
        reference configuration, hence zero at the start.
    coordinate : str, optional
        Which of the joint's coordinates, such as "angle" or "displacement"; may be left out if it
        has only one.

    Raises
    ------
    InputError
        If the joint has no such coordinate, `motion` cannot be called, gives no finite number or
        is not zero at t = 0.

    Examples
    --------
    A motor that reaches a speed of 3 rad/s within a second:

    >>> from skfem_cosserat import JointRevolute, Model, RigidBody, ground
    >>> model = Model()
    >>> crank = model.add("crank", RigidBody.box(1.0, (1, 0.1, 0.1)))
    >>> place = crank.local((-0.5, 0, 0))
    >>> pin = model.add("pin", JointRevolute(ground(place.position), place, axis=(0, 0, 1)))
    >>> motor = model.add("motor", JointDrive(pin, lambda t: 1.5 * t**2 if t < 1 else 3 * t - 1.5))
    >>> model.freeze().counts()
    {'n': 12, 'm': 12, 'rank': 12, 'unknowns': 0}
    """

    kind = "drive"
    type = "drive"
    size = 1

    def __init__(
        self, joint: Joint, motion: Callable[[float], float], coordinate: str | None = None
    ) -> None:
        if not isinstance(joint, Joint):
            raise InputError(self.label, f"joint is {joint!r}, expected a joint")
        if not callable(motion):
            raise InputError(self.label, f"motion = {motion!r}, expected a function of time")
        self.joint = joint
        self.coordinate: RelativeCoordinate = joint.coordinate(coordinate)
        if self.coordinate.kind not in ("angle", "displacement"):
            raise InputError(
                self.label,
                f"cannot prescribe the {self.coordinate.name} of a {joint.type} joint: only angles"
                " and displacements, or the Motion of a ground place",
            )
        self._number = FunctionOfTime(motion)
        #: the ground frame that carries the number
        self.place = Place(
            None, -1, np.zeros(3), np.zeros(3), np.eye(3), _Prescribed(number=self.value)
        )
        self.a, self.b = joint.a, joint.b

    def _parts(self) -> Iterator[tuple[str, Any]]:
        yield from (("joint", self.joint), ("motion", self._number))
        yield "coordinate", self.coordinate.name

    def value(self, t: float) -> float:
        """Prescribed angle (rad) or displacement (m) at time `t` (s)."""
        try:
            return self._number.value(t)
        except InputError as error:
            raise InputError(self.label, str(error)) from error

    def references(self) -> list[StructuralItem]:
        """The items of its joint."""
        return self.joint.references()

    def check(self, t: float, length: float) -> None:
        """Raise InputError if it contradicts the reference configuration at time `t`."""
        value = self.value(t)
        unit, size = ("rad", 1.0) if self.coordinate.kind == "angle" else ("m", length)
        if abs(value) > TOLERANCE * size:
            raise InputError(
                self.label,
                f"prescribes {self.coordinate.name} = {value:.6g} {unit} at t = {t:g} s, but it is"
                f" 0 in the reference configuration of the {self.joint.label}",
            )

    def rows(self) -> list[Form]:
        """``cos(theta(t)) sin(theta) - sin(theta(t)) cos(theta) = 0`` or ``s - s(t) = 0``."""
        forms = self.coordinate.forms
        if self.coordinate.kind == "displacement":
            number = Expression(((self.place, 0, 1.0),))
            third = Expression(((ORIGIN, 3, 1.0),))
            return [(*forms[0], Product(number, third, -1.0))]
        cosine, sine = forms
        return [(*self._times(sine, 0), *self._times(cosine, 1, -1.0))]

    def branch_cosines(self) -> list[Form]:
        """``cos(theta - theta(t))``, which is -1 where the row holds half a turn off."""
        if self.coordinate.kind == "displacement":
            return []
        cosine, sine = self.coordinate.forms
        return [(*self._times(cosine, 0), *self._times(sine, 1))]

    def _times(self, form: Form, component: int, sign: float = 1.0) -> Form:
        """The form times the cosine (0) or the sine (1) of the prescribed angle."""
        amplitude = Amplitude(self.place, component)
        return tuple(replace(p, factor=sign * p.factor, amplitude=amplitude) for p in form)
