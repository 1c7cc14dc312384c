"""What is solved on each mesh: an equilibrium, or a motion in time."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..beam import Beam
from ..constraints import NullSpace, Treatment
from ..diagnostics import goal_shares, missing_strains
from ..diagnostics.error import beam_of
from ..diagnostics.transfer import transfer
from ..errors import Diverged, InputError
from ..history import History
from ..integrators import Integrator
from ..linear import SingularMatrixError
from ..log import logger
from ..model import System
from ..simulate import simulate
from ..statics import Control, LoadControl, Point, equilibrium, static
from ..statics.control import Stage
from ..statics.point import Functional
from ..statics.record import recorded_amplitudes
from ..types import Floats, numbers, positive
from .carry import carry_history
from .quantity import Quantity, gradient, value_of

__all__ = ["Run", "RunInTime", "RunStatic"]

#: states of a run, evenly spread, over which indicators are summed
LOOKS = 40


class Run(ABC):
    """A problem, whatever the mesh."""

    @abstractmethod
    def solve(self, system: System, before: tuple[System, History] | None) -> History:
        """The solution; `before` is that on another mesh, which may help."""

    @abstractmethod
    def states(self, history: History) -> Floats:
        """Configurations (T, n) at which the quantity is taken."""

    @abstractmethod
    def looks(self, history: History) -> Floats:
        """Configurations (N, n) over which indicators are summed."""

    def values(self, quantity: Quantity, system: System, history: History) -> Floats:
        """The quantity (T, k)."""
        return np.array([value_of(quantity, system, q) for q in self.states(history)])

    def shares(
        self,
        quantity: Quantity,
        coarse: System,
        fine: System,
        rough: History,
        good: History,
        error: Floats,
    ) -> tuple[dict[str, Floats], str]:
        """Shares (ne,) of the elements of each beam in an error (T, k), and where from.

        By default in proportion to the energy that the richer elements store in what those of the
        coarse mesh leave out.
        """
        looks = self.looks(good)
        energies = {}
        for beam in (item for item in coarse.structures if isinstance(item, Beam)):
            richer = beam_of(fine, beam.name, beam.label)
            energies[str(beam.name)] = missing_strains(beam, fine, richer, looks)[:, 0]
        total = sum(float(e.sum()) for e in energies.values())
        size = float(np.linalg.norm(error, axis=1).max())
        return {k: size * e / (total or 1.0) for k, e in energies.items()}, "strains"


class _Here(Control):
    """A path of one point: the equilibrium next to a start, at its load factor."""

    parameter = "load_factor"
    turn = None
    all_points = True

    @property
    def expected(self) -> int:
        """See the base class."""
        return 1

    def stage(self, system: System, point: Point) -> Stage:
        """See the base class."""
        return _AtStart(point.t)


class _AtStart(Stage):
    def __init__(self, t: float) -> None:
        self.parameter, self.length, self.shortest, self._stops = t, 0.0, 0.0, []

    def functional(self, point: Point, length: float) -> Functional:
        """See the base class."""
        return Functional(None, 1.0, length)


@dataclass(frozen=True)
class RunStatic(Run):
    """The equilibrium at the end of a path; after the first mesh found from the one before.

    The error is shared among the elements by the adjoint solution,
    :func:`skfem_cosserat.diagnostics.goal_shares`.

    Parameters
    ----------
    control : Control or callable, optional
        Default: loads grow to load factor 1. A callable makes it for a system, as of a displacement
        of one of its places. Only with :class:`LoadControl` an equilibrium can be
        found from that on the mesh before; other paths are followed anew.
    treatment : Treatment, optional
        Default: ``NullSpace()``.
    options : mapping, optional
        Further arguments of :func:`skfem_cosserat.static`.
    """

    control: Control | Callable[[System], Control] = field(default_factory=LoadControl)
    treatment: Treatment = field(default_factory=NullSpace)
    options: Mapping[str, Any] = field(default_factory=lambda: {"watch": False})

    def __post_init__(self) -> None:
        if not isinstance(self.control, Control) and not callable(self.control):
            raise InputError("run", f"control = {self.control!r}, expected e.g. LoadControl()")

    def solve(self, system: System, before: tuple[System, History] | None) -> History:
        """See the base class."""
        options = {"derive": False, **self.options}
        if before is not None and isinstance(self.control, LoadControl):
            start = equilibrium(system, carry_history(before[0], system, before[1]))
            try:
                return static(system, self.treatment, _Here(), start=start, **options)
            except Diverged as error:
                logger.info("no equilibrium from the mesh before, the path anew: %s", error)
        control = self.control if isinstance(self.control, Control) else self.control(system)
        return static(system, self.treatment, control, **options)

    def states(self, history: History) -> Floats:
        """The last one."""
        return np.asarray(history["q"][-1:])

    def looks(self, history: History) -> Floats:
        """The last one."""
        return self.states(history)

    def shares(
        self,
        quantity: Quantity,
        coarse: System,
        fine: System,
        rough: History,
        good: History,
        error: Floats,
    ) -> tuple[dict[str, Floats], str]:
        """See the base class; with their signs, if there is an adjoint solution."""
        size = float(np.linalg.norm(error))
        q = good["q"][-1]
        if size > 0:
            seen, _ = transfer(fine, coarse, q)
            slope = gradient(quantity, coarse, seen, error[0] / size)
            amplitudes = recorded_amplitudes(good)
            factor = float(good["load_factor"][-1])
            try:
                start = rough["q"][-1]
                found = goal_shares(coarse, fine, start, q, slope, amplitudes, factor)
                return found, "adjoint"
            except SingularMatrixError as singular:
                logger.info("shares of elements by their strains: %s", singular)
        return super().shares(quantity, coarse, fine, rough, good, error)


@dataclass(frozen=True)
class RunInTime(Run):
    """A motion from rest or from the items' velocities; each mesh has the same steps.

    The error in space alone is looked at: that of the step is in all meshes alike. It is shared
    among the elements by the energy of the strains they miss, mean over the run.

    Parameters
    ----------
    integrator : Integrator
    step, until : float
        (s)
    times : sequence of float, optional
        When the quantity is taken, at ends of steps (s); default: at the end.
    treatment : Treatment, optional
        Default: ``NullSpace()``.
    options : mapping, optional
        Further arguments of :func:`skfem_cosserat.simulate`.

    Raises
    ------
    InputError
        For a step or end that is not positive, or times that are no ends of steps of the run.
    """

    integrator: Integrator
    step: float
    until: float
    times: Sequence[float] | None = None
    treatment: Treatment = field(default_factory=NullSpace)
    options: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        positive("run", "step", self.step, " of seconds")
        positive("run", "until", self.until, " of seconds")
        wanted = self._wanted
        wrong = abs(wanted / self.step - np.rint(wanted / self.step)) > 1e-6
        wrong |= (wanted < 0) | (wanted > self.until * (1 + 1e-9))
        if wanted.ndim != 1 or not wanted.size or wrong.any():
            raise InputError(
                "run",
                f"times = {self.times!r}, expected ends of steps of {self.step!r} s from 0 to"
                f" {self.until!r} s",
            )

    @property
    def _wanted(self) -> Floats:
        end = self.step * np.floor(self.until / self.step * (1 + 1e-12) + 1e-9)
        return np.array([end]) if self.times is None else numbers("run", "times", self.times)

    def solve(self, system: System, before: tuple[System, History] | None) -> History:
        """See the base class; from the start, in any case."""
        count = int(np.rint(self._wanted.max() / self.step))
        looks = np.unique(np.linspace(0, count, min(count, LOOKS) + 1).round()) * self.step
        at = np.union1d(looks, self.step * np.rint(self._wanted / self.step))
        options = {"derive": False, "at": at.tolist(), **self.options}
        return simulate(system, self.integrator, self.treatment, self.step, self.until, **options)

    def states(self, history: History) -> Floats:
        """Those at the times."""
        rows = np.searchsorted(history.times, self._wanted - 0.5 * self.step)
        return np.asarray(history["q"][rows])

    def looks(self, history: History) -> Floats:
        """All recorded ones."""
        return np.asarray(history["q"])
