"""What is asked of a run: readings of quantities, and how far two runs are apart."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from ..errors import InputError
from ..history import History
from ..integrators import State
from ..model import System
from ..simulate import Sensor
from ..types import Array, ArrayLike, Floats, numbers, positive

__all__ = ["Quantities", "Quantity", "Reading"]

#: A sensor, a function of the history, or one of the system and a state.
Quantity: TypeAlias = Sensor | Callable[[History], ArrayLike] | Callable[[System, State], ArrayLike]


@dataclass(frozen=True, eq=False)
class Reading:
    """A quantity of a run.

    Attributes
    ----------
    values : (...) or (K, ...) array
    times : (K,) array or None
        None: one value for the whole run.
    """

    values: Array
    times: Floats | None = None

    @property
    def finite(self) -> bool:
        """Whether all of it is numbers."""
        return bool(np.isfinite(self.values).all())

    @property
    def span(self) -> float:
        """Largest distance from its first value, or its size."""
        if self.times is None:
            return float(np.linalg.norm(self.values))
        moved = (self.values - self.values[:1]).reshape(len(self.values), -1)
        return float(np.linalg.norm(moved, axis=1).max())

    def distance(self, other: Reading) -> float:
        """Largest distance at the instants of the one with fewer of them."""
        if self.times is None or other.times is None:
            return float(np.linalg.norm(np.asarray(self.values - other.values)))
        coarse, fine = (self, other) if len(self.times) <= len(other.times) else (other, self)
        t, ends = self.times if coarse is self else other.times, fine.ends
        inside = (t >= ends[0] * (1 - 1e-9)) & (t <= ends[1] * (1 + 1e-9))
        gap = (coarse.values[inside] - fine.at(t[inside])).reshape(int(inside.sum()), -1)
        return float(np.linalg.norm(gap, axis=1).max())

    @property
    def ends(self) -> tuple[float, float]:
        """First and last instant."""
        assert self.times is not None
        return float(self.times[0]), float(self.times[-1])

    def at(self, t: Floats) -> Array:
        """Values at instants: its own, or between them by cubic splines."""
        assert self.times is not None
        k = np.searchsorted(self.times, t - 1e-9 * self.times[-1])
        k = np.minimum(k, len(self.times) - 1)
        if abs(self.times[k] - t).max() <= 1e-6 * (self.times[1] - self.times[0]):
            return np.asarray(self.values[k])
        from scipy.interpolate import CubicSpline

        return np.asarray(CubicSpline(self.times, self.values)(t))


class Quantities:
    """Named quantities with the error that is allowed in each.

    Parameters
    ----------
    quantities : mapping of str to Quantity
    tolerance : float or mapping of str to float
        In the units of the quantities.

    Raises
    ------
    InputError
        If there is none, a name is no string, something is no quantity, or a tolerance is missing
        or not positive.
    """

    def __init__(
        self, quantities: Mapping[str, Quantity], tolerance: float | Mapping[str, float]
    ) -> None:
        item = "argument quantities"
        if not isinstance(quantities, Mapping) or not quantities:
            raise InputError(item, f"{quantities!r}, expected a dict of names and quantities")
        self.sensors: dict[str, Sensor] = {}
        self.functions: dict[str, tuple[int, Callable[..., Any]]] = {}
        for name, quantity in quantities.items():
            if not isinstance(name, str) or not name or "/" in name:
                raise InputError(item, f"{name!r}, expected a name without slashes")
            if isinstance(quantity, Sensor):
                self.sensors[name] = quantity
            else:
                self.functions[name] = (_arguments(name, quantity), quantity)
        self.single = not isinstance(tolerance, Mapping)
        if isinstance(tolerance, Mapping) and set(tolerance) != set(quantities):
            raise InputError(
                "argument tolerance", f"is for {sorted(tolerance)}, expected {sorted(quantities)}"
            )
        self.tolerance = {
            name: positive(
                "argument tolerance",
                name,
                tolerance[name] if isinstance(tolerance, Mapping) else tolerance,
            )
            for name in quantities
        }

    @property
    def names(self) -> list[str]:
        """In the order given."""
        return list(self.tolerance)

    @property
    def of_history(self) -> bool:
        """Whether some want a whole history, with what is derived from it."""
        return any(count == 1 for count, _ in self.functions.values())

    def read(self, system: System, history: History) -> dict[str, Reading]:
        """All of them, from the sensors' records and the recorded states of a run."""
        out = {}
        for name in self.sensors:
            record = history.sensors[name]
            out[name] = Reading(record.values, record.times)
        for name, (count, function) in self.functions.items():
            if count == 1:
                values = numbers("quantity", name, function(history))
                series = values.ndim > 0 and len(values) == len(history)
                out[name] = Reading(values, history.times if series else None)
            else:
                states = [
                    State(float(t), int(k), q, p)
                    for t, k, q, p in zip(
                        history.times, history["step"], history["q"], history["p"], strict=True
                    )
                ]
                values = numbers("quantity", name, [function(system, state) for state in states])
                out[name] = Reading(values, history.times)
        return out

    def distances(self, a: Mapping[str, Reading], b: Mapping[str, Reading]) -> dict[str, float]:
        """How far two runs are apart, by quantity (in its unit)."""
        return {name: a[name].distance(b[name]) for name in self.names}

    def distance(self, a: Mapping[str, Reading], b: Mapping[str, Reading]) -> float:
        """The largest distance in units of its tolerance."""
        found = self.distances(a, b)
        return max(found[name] / self.tolerance[name] for name in self.names)

    def given(self, size: float) -> float | dict[str, float]:
        """An error in tolerances as the tolerance was given: a number, or one a quantity."""
        if self.single:
            return size * next(iter(self.tolerance.values()))
        return {name: size * tolerance for name, tolerance in self.tolerance.items()}


def _arguments(name: str, quantity: Any) -> int:
    """Whether it takes a history (1), or a system and a state (2)."""
    item = f"quantity {name!r}"
    if not callable(quantity):
        raise InputError(item, f"is {quantity!r}, expected a sensor or a function")
    try:
        parameters = inspect.signature(quantity).parameters.values()
    except (TypeError, ValueError):  # some written in C do not say
        return 1
    needed = [
        each
        for each in parameters
        if each.default is each.empty
        and each.kind in (each.POSITIONAL_ONLY, each.POSITIONAL_OR_KEYWORD)
    ]
    if len(needed) not in (1, 2):
        raise InputError(
            item, f"takes {len(needed)} arguments, expected (history) or (system, state)"
        )
    return len(needed)
