"""Which compiled steps a scene takes, and those of scenes that are confined to a plane."""

from __future__ import annotations

from ..compiled.plan import Plan
from ..constraints import Multipliers, Treatment
from ..linear import Solver
from ..model import System
from ..newton import NewtonSettings
from ..types import Floats, IndexArray
from .base import Integrator
from .fast import COMPILING, Bound, CompiledMultipliers, CompiledStep
from .viscous import is_viscous

__all__ = ["CompiledPlane", "compiled_step"]


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
