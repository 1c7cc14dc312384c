"""Finished results, and what is doubtful about them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ..diagnostics.energy import recorded_factors
from ..diagnostics.forces import overstretched_at
from ..history import History
from ..model import System
from ..model.balance import Amplitudes, Spin
from ..model.limits import first_over_rotated, over_rotated_beam
from ..types import Floats, spread


class Doubt(NamedTuple):
    """Something doubtful about a result.

    Attributes
    ----------
    item : str
        Label of what it is about.
    cause : str
        What was found.
    time : float, optional
        When (s), or at which load factor.
    remedy : str, optional
        What to do, if there is more to say than the check does of all its doubts.
    """

    item: str
    cause: str
    time: float | None = None
    remedy: str | None = None


@dataclass(frozen=True, eq=False)
class Recorded:
    """Recorded states of a scene; see the subclasses.

    Attributes
    ----------
    systems : sequence of System
        Of the segments of the history.
    history : History
    """

    systems: Sequence[System]
    history: History

    @property
    def system(self) -> System:
        """System of the last segment."""
        return self.systems[-1]

    @property
    def failed(self) -> bool:
        """True if a step or a point could not be solved."""
        return self.history.status == "diverged"

    @cached_property
    def bent(self) -> list[Doubt]:
        """A beam whose elements are bent too far, in the first state that shows it."""
        system = self.system
        history = self.history
        states = history["q"].reshape(len(history), -1, 3)
        first = first_over_rotated(system, states)
        found = None if first is None else over_rotated_beam(system, states[first])
        return [] if found is None else [Doubt(*found, float(history.instants[first]), "")]

    @cached_property
    def drawn(self) -> list[Doubt]:
        """A beam whose elements are drawn too much: of the end nothing may be seen any more."""
        system = self.system
        history = self.history
        factors = recorded_factors(system, history)
        for k in spread(len(history)) if system.beam_groups else ():
            y = system.extend(history["q"][k], float(history.instants[k]))
            if found := overstretched_at(system, y, history["constraint_force"][k], factors[k]):
                return [Doubt(*found, history.instants[k], "")]
        return []


class Path(Recorded):
    """Points of a path of equilibria."""


@dataclass(frozen=True, eq=False)
class Shapes:
    """Modes of vibration or buckling.

    Attributes
    ----------
    system : System
    told : str
        What is told of each: "frequency", "critical factor".
    power : int
        Which power of it is in proportion to energies.
    energies : (count, beams, 2) array
        By :func:`skfem_cosserat.checks.coarseness.energies`.
    energy : (count,) array
        Twice that of all beams, springs and loads (J); zero where nothing can be wrong.
    """

    system: System
    told: str
    power: int
    energies: Floats
    energy: Floats


def recorded_amplitudes(history: History, index: int = -1) -> Amplitudes:
    """Factors of loads and actuators, and the spin, at a point of a path."""
    loads, actuators, spin = (
        np.array(history[f"amplitudes/{name}"][index]) for name in ("loads", "actuators", "spin")
    )
    time = float(history.instants[index])
    return Amplitudes(loads, actuators, Spin(*spin) if spin[0].any() else None, time)
