"""Servos: controlled drives on coordinates of joints."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from .coupling import Coupling, JointSpringDamper
from .errors import InputError
from .force import Force
from .frozen import Frozen
from .joint import Joint
from .time_function import Constant, TimeFunction, time_function
from .types import not_negative, positive

#: half the time (s) between two values of a reference that give its rate
SHORT = 1e-6


def _rate(reference: TimeFunction, t: float) -> float:
    return (reference.value(t + SHORT) - reference.value(t - SHORT)) / (2 * SHORT)


class _Command(Frozen):
    """``kp r + kd dr/dt`` of a reference r; its mean in a step is exact."""

    def __init__(self, reference: TimeFunction, kp: float, kd: float) -> None:
        self.reference, self.kp, self.kd = reference, kp, kd

    def value(self, t: float) -> float:
        """Value at time `t` (s)."""
        return self.kp * self.reference.value(t) + self.kd * _rate(self.reference, t)

    def average(self, t0: float, t1: float) -> float:
        """Mean over [t0, t1]."""
        r = self.reference
        change = (r.value(t1) - r.value(t0)) / (t1 - t0)
        return self.kp * r.average(t0, t1) + self.kd * change


class JointServo(JointSpringDamper):
    """A drive that makes a coordinate x of a joint follow a reference r.

    It acts with ``kp (r - x) + kd (dr/dt - dx/dt) + ki int (r - x) dt`` (N or N m), at most `limit`
    in size. While it is at its limit the integral does not grow. Without `ki` and `limit` it is a
    spring and damper in the energies, ``coupling_energy`` and what is dissipated, and the moving
    reference is an actuator; else its work is part of ``work_loads``. In histories
    ``coupling/NAME/force`` is positive where it pulls x back, as for springs.

    Parameters
    ----------
    joint : Joint
        Of the same model.
    kp, kd : float
        Gains (N/m, N m/rad; the same times s), not negative.
    ki : float
        Gain of the integral (the same as kp, per s), not negative.
    reference : float, TimeFunction or callable
        r (rad or m), also as a function of time (s).
    limit : float, optional
        Largest force or torque (N or N m), positive.
    coordinate : str, optional
        Its name, see :meth:`Joint.coordinates`; needed if the joint has several.

    Raises
    ------
    InputError
        If there is no such coordinate or it is a rotation vector, a gain is negative, kp and kd are
        zero, the limit is not positive, or the reference is no finite number or function.

    Examples
    --------
    >>> import skfem_cosserat as sc
    >>> model = sc.Model()
    >>> arm = model.add("arm", sc.RigidBody.box(1.0, (1, 0.1, 0.1), position=(0.5, 0, 0)))
    >>> foot = sc.ground((0, 0, 0)), arm.at((0, 0, 0))
    >>> hinge = model.add("hinge", sc.JointRevolute(*foot, axis=(0, 0, 1)))
    >>> servo = model.add("servo", sc.JointServo(hinge, kp=100, kd=12, reference=0.5))
    >>> history = sc.simulate(model, sc.EnergyMomentum(), sc.NullSpace(), 0.01, until=2.0)
    >>> round(float(history["joint/hinge/angle"][-1]), 6)
    0.5
    """

    kind = "joint servo"

    def __init__(
        self,
        joint: Joint,
        kp: float,
        kd: float,
        ki: float = 0.0,
        reference: float | TimeFunction | Callable[[float], float] = 0.0,
        limit: float | None = None,
        coordinate: str | None = None,
    ) -> None:
        self.kp = not_negative(self.label, "kp", kp)
        self.kd = not_negative(self.label, "kd", kd)
        self.ki = not_negative(self.label, "ki", ki)
        if not (self.kp or self.kd):
            raise InputError(self.label, "kp and kd are both zero: it holds nothing")
        self.limit = None if limit is None else positive(self.label, "limit", limit, " (N or N m)")
        self.reference = time_function(self.label, reference, "reference")
        constant = isinstance(self.reference, Constant)
        neutral = self.reference.value(0.0) if constant else 0.0
        super().__init__(joint, self.kp, self.kd, coordinate, neutral)
        if self.size > 1:
            raise InputError(self.label, "acts on a rotation vector, expected an angle or a length")
        if not constant:
            self.channels = (_Command(self.reference, self.kp, self.kd),)

    def pieces(self) -> Sequence[Coupling]:
        """Itself, or a force by a law where it has a limit or an integral."""
        if not (self.ki or self.limit):
            return [self]
        memory = 0.0 if self.ki else None
        whole = Force(self.coordinates, self._force, each=True, memory=memory)
        pieces = whole.pieces()
        for each in (whole, *pieces):
            vars(each)["name"] = self.name
        return pieces

    def _force(self, x: Any, v: Any, t: float, z: Any = 0.0) -> Any:
        error = self.reference.value(t) - x
        asked = self.kp * error + self.kd * (_rate(self.reference, t) - v) + self.ki * z
        most = np.finfo(float).max if self.limit is None else self.limit
        free = abs(asked.real) <= most
        force = np.where(free, asked, most * np.sign(asked.real))
        if not self.ki:
            return force
        return force, np.where(free | (error.real * asked.real < 0), error, 0)
