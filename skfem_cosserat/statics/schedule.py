"""Which share of each load acts where on a path."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ..coupling import Coupling
from ..errors import InputError
from ..load import Amplitude, Constant, Load, TimeFunction, time_function
from ..model import System
from ..model.balance import Amplitudes, Spin
from ..types import Floats

__all__ = ["Schedule"]

_Channel = tuple[TimeFunction, TimeFunction | None, str]


def _value(function: TimeFunction, t: float, owner: str) -> float:
    """At load factor t; an error of a function names whose it is."""
    try:
        return function.value(t)
    except InputError as error:
        raise InputError(owner, str(error)) from error


class Schedule:
    """Amplitudes of all loads, actuators and of a spin as functions of the load factor.

    What is constant in time is multiplied by the load factor; what depends on time takes the load
    factor for it, as prescribed motion does. Factors given by name take the place of the load
    factor: a number holds a load, a :class:`Table` or a function of the load factor moves it.

    Parameters
    ----------
    system : System
    factors : mapping of str to float, TimeFunction or callable
        By the names of loads and actuators; ``"spin"`` for the spin.
    spin : Spin, optional
        Angular velocity at load factor 1; it grows in proportion.

    Raises
    ------
    InputError
        For names that are not in the system, or factors that are no functions.
    """

    def __init__(
        self,
        system: System,
        factors: Mapping[str, Amplitude] | None = None,
        spin: Spin | None = None,
    ) -> None:
        if spin is not None and not isinstance(spin, Spin):
            raise InputError("argument spin", f"{spin!r}, expected a Spin")
        if factors is not None and not isinstance(factors, Mapping):
            raise InputError("argument factors", f"{factors!r}, expected a mapping of names")
        if spin is not None and system.plane is not None:
            system.plane.check_spin(spin.velocity)
        self.system, self.spin = system, spin
        given = dict(factors or {})
        loading, couplings = system.loading, system.couplings
        owners: list[Load | Coupling] = [*loading.owners, *couplings.owners]
        known = {str(owner.name) for owner in owners} | ({"spin"} if spin is not None else set())
        for name, factor in given.items():
            if name not in known:
                raise InputError(
                    "argument factors", f"unknown name {name!r}; known: {sorted(known)}"
                )
            if factor is None or isinstance(factor, bool):
                raise InputError(
                    "argument factors", f"{name!r}: {factor!r}, expected a number or function"
                )
        self._given = {k: time_function(f"argument factors, {k!r}", v) for k, v in given.items()}
        self._loads = self._factors(loading.owners, loading.times)
        self._actuators = self._factors(couplings.owners, couplings.times)

    def _factors(
        self, owners: Sequence[Load | Coupling], times: Sequence[TimeFunction]
    ) -> list[_Channel]:
        """(own time, factor, name) of each channel; None: the load factor itself."""
        out: list[_Channel] = []
        for owner, time in zip(owners, times, strict=True):
            default = None if isinstance(time, Constant) else Constant(1.0)
            out.append((time, self._given.get(str(owner.name), default), owner.label))
        return out

    def at(self, t: float) -> Amplitudes:
        """Amplitudes at load factor t."""

        def numbers(channels: list[_Channel]) -> list[float]:
            return [
                _value(time, t, owner) * (t if factor is None else _value(factor, t, owner))
                for time, factor, owner in channels
            ]

        spin = self.spin
        if spin is not None:
            factor = self._given.get("spin")
            share = t if factor is None else _value(factor, t, "spin")
            spin = Spin(share * spin.velocity, spin.point)
        loads = self.system.loading.checked(np.array(numbers(self._loads)), t)
        return Amplitudes(loads, np.array([*numbers(self._actuators), 0.0]), spin)

    def potential(self, q: Floats, times: Floats) -> Floats:
        """``-f(t) . q`` (N,) of the dead loads (J)."""
        force = [self.system.loading.dead_force(self.at(float(t)).loads) for t in times]
        return -(np.array(force).reshape(len(q), -1) * q).sum(1)
