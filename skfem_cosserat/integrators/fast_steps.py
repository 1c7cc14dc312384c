"""Which compiled steps a scene takes: those in a plane, and those with multipliers."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from ..compiled.numbers import GUESS, KNOWN
from ..compiled.plan import Plan, plan_of
from ..constraints import Multipliers, Treatment
from ..linear import Solver
from ..model import System
from ..model.chart import Chart
from ..newton import NewtonSettings
from ..types import Floats, IndexArray
from .base import Integrator
from .fast import COMPILING, Bound, CompiledStep
from .viscous import is_viscous

__all__ = ["CompiledMultipliers", "CompiledPlane", "compiled_step"]


def compiled_step(
    system: System,
    integrator: Integrator,
    treatment: Treatment,
    h: float,
    settings: NewtonSettings,
    plan: Plan | None = None,
    solver: Solver | None = None,
) -> CompiledStep:
    """Steps with one of the treatments; see :class:`.fast.CompiledStep`."""
    if isinstance(treatment, Multipliers):
        return CompiledMultipliers(system, integrator, h, settings, plan, treatment.scaled)
    kind = CompiledStep if system.plane is None else CompiledPlane
    return kind(system, integrator, h, settings, plan, solver)


class CompiledPlane(CompiledStep):
    """Steps of a scene in a plane, with the null space method: three unknowns a frame.

    See :class:`.fast.CompiledStep`.
    """

    def _bind(self, weight: float, ends: bool, static: bool) -> Bound:
        """See the base class; arrays by rows of y in space go by their names."""
        from ..compiled import bind
        from ..compiled.plane import bind as plane

        system, groups = self.system, self.system.beam_groups
        parts = bind.parts_of(system, weight, ends or is_viscous(system))
        frames = plane.Frames(system)
        with COMPILING, bind.compiling(system, parts, "plane"):
            rows, outside = plane.bound_rows(system, frames)
            s, self._tree = plane.bound_tree(system, self.plan, frames, rows)
            m, _ = bind.bound_plan(system, self.plan)
            w, arrays = plane.bound_work(system, self.plan, frames)
            group = groups[0] if groups else None
            g, _ = plane.bound_beams(system, group, self.plan, frames, outside)
            table = bind.addresses(parts, (s, m, w, g), "plane")
        own = ("y0", "y1", "ground1", "p0", "external", "R", "carried")
        self._arrays = arrays | {name: outside[name] for name in own}
        self._number([c for cs in bind.coordinates_of(system) for c in cs])
        return table, s, m, w, g

    def _choose(self, rows: IndexArray) -> None:
        """See the base class."""
        from ..compiled.plane import bind as plane

        plane.choose_rows(self.system, self._tree, rows)

    @property
    def balance(self) -> Floats:
        """See the base class: made where a step ends, without the impulses of closed loops."""
        return self._a.R


class CompiledMultipliers(CompiledStep):
    """The same with multipliers: n + m unknowns, eliminated vertex by vertex.

    Parameters
    ----------
    system, integrator, h, settings, plan
        See :class:`CompiledStep`.
    scaled : bool
        See :class:`skfem_cosserat.Multipliers`.
    """

    def __init__(
        self,
        system: System,
        integrator: Integrator,
        h: float,
        settings: NewtonSettings,
        plan: Plan | None = None,
        scaled: bool = True,
    ) -> None:
        self._scaled, self._h = scaled, h
        if plan is None:
            plan = plan_of(system, whole=True)
        super().__init__(system, integrator, h, settings, plan)

    def _bind(self, weight: float, ends: bool, static: bool) -> Bound:
        """See the base class."""
        from ..compiled import bind, bind_kkt

        system, groups = self.system, self.system.beam_groups
        parts = bind_kkt.parts_of(system, ends or is_viscous(system))
        with COMPILING, bind.compiling(system, parts, "multipliers"):
            s, own = bind_kkt.bound_constraints(system, self.plan, self._scaled, self._h)
            m, _ = bind_kkt.bound_elimination(system, self.plan)
            w, self._arrays = bind_kkt.bound_steps(system, self.plan)
            g, _ = bind.bound_beams(system, groups[0] if groups else None, self.plan)
            table = bind.addresses(parts, (s, m, w, g), "multipliers")
        self._own = SimpleNamespace(**own)
        self._chart = Chart(system.kinematics)
        return table, s, m, w, g

    @property
    def last(self) -> Any:
        """See the base class."""
        if not self._record[KNOWN]:
            return None
        return self._own.last.ravel().copy(), self._own.last_one.copy()

    @last.setter
    def last(self, value: Any) -> None:
        self._record[KNOWN] = self._record[GUESS] = float(value is not None)
        if value is not None:
            self._own.last.ravel()[:], self._own.last_one[:] = value

    def resized(self, h: float) -> CompiledStep:
        """See the base class; unscaled matrices have the step size in them: bound anew."""
        if self._scaled:
            return super().resized(h)
        own = self.system, self.integrator, h, self.settings, self.plan
        other = CompiledMultipliers(*own, scaled=False)
        other.factorisations, other.last = self.factorisations, self._scaled_last(h / self.h)
        return other

    def _scaled_last(self, ratio: float) -> Any:
        """See the base class."""
        return None if self.last is None else tuple(ratio * part for part in self.last)

    @property
    def method(self) -> str:
        """See the base class."""
        return "blocks with multipliers"

    @property
    def worth(self) -> float:
        """See the base class: not measured, so they are kept as long as they do."""
        return np.inf

    def _prescribe(self) -> None:
        """See the base class; the first step starts where the tree follows the ground."""
        if self.system.moving and not self._record[KNOWN]:
            y0 = self._a.y0.copy()
            self._chart.begin(y0, self._a.ground1.copy())
            self._own.start[:] = (self._chart.configuration() - y0)[: self.system.rows]

    @property
    def impulse(self) -> Floats:
        """See the base class: of the multipliers found."""
        return self._own.impulse.copy()

    @property
    def increment(self) -> Floats:
        """See the base class: coordinates, and the multipliers' impulses, not scaled."""
        return np.concatenate([self._a.change.ravel(), self._own.added])
