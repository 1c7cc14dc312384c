"""Steps by compiled kernels: the same iteration as that of the stepper, in a few compiled calls."""

from __future__ import annotations

from math import isfinite
from types import SimpleNamespace

import numpy as np

from ..compiled.plan import Plan, plan_of
from ..constraints import NullSpace, Treatment
from ..model import System
from ..model.chart import Chart
from ..newton import NewtonSettings, converged
from ..types import Array, Floats
from .base import Integrator, Scheme, State, StepData, StepWork

__all__ = ["CompiledStep", "refusal"]


def refusal(system: System, integrator: Integrator, treatment: Treatment) -> str | None:
    """Why a scene cannot be stepped by compiled kernels; None: it can."""
    if integrator.scheme(1.0) is None:
        return f"the {integrator.name} integrator gives no scheme for compiled kernels"
    if not isinstance(treatment, NullSpace):
        return f"there are no compiled kernels for {treatment.name}"
    reasons = {
        "closed loops": len(system.closure.rows) > 0,
        "springs, dampers and actuators": system.couplings.count > 0,
        "loads that follow the motion": not system.loading.dead_only,
        "damping": system.damped,
        "beams of several orders": len(system.beam_groups) > 1,
    }
    found = [what for what, there in reasons.items() if there]
    if found:
        return f"there are no compiled kernels for {', '.join(found)}"
    return None


class CompiledStep:
    """Steps of one system, integrator and step size with the null space method, compiled.

    Needs numba; :func:`refusal` says for what there is none.

    Parameters
    ----------
    system : System
    integrator : Integrator
    h : float
        Step size (s).
    settings : NewtonSettings
    plan : Plan, optional
        Of the elimination, if it is there already.

    Attributes
    ----------
    factorisations : int
        So far.
    """

    def __init__(
        self,
        system: System,
        integrator: Integrator,
        h: float,
        settings: NewtonSettings,
        plan: Plan | None = None,
    ) -> None:
        from ..compiled import bind, blocks, curvature, elements, step, tree

        scheme = integrator.scheme(h)
        assert isinstance(scheme, Scheme)
        self.system, self.integrator, self.h, self.settings = system, integrator, h, settings
        self.scheme = scheme
        self._blocks, self._elements, self._curvature = blocks, elements, curvature
        self._step, self._turn = step, tree
        self.plan = plan_of(system) if plan is None else plan
        self.factorisations = 0
        groups = system.beam_groups
        # structures for the kernels, and their arrays by name
        self._m, _ = bind.bound_plan(system, self.plan)
        self._s, self._tree = bind.bound_tree(system)
        self._w, self._arrays = bind.bound_work(system, self.plan)
        self._g, beams = bind.bound_beams(system, groups[0] if groups else None, self.plan)
        self._a = SimpleNamespace(**self._arrays)
        self._S0 = beams["S0"]
        self._numbers = np.array(
            [
                *(scheme.mass, scheme.momentum, scheme.force),
                *((0.5, 0.5) if scheme.ends else (0.0, 1.0)),
                *(integrator.constraint_weight, system.length),
                *(settings.rotation, settings.mixed),
            ]
        )
        self._coordinates = [c for cs in bind.coordinates_of(system) for c in cs]
        self._drives = any(c.drive is not None for c in self._coordinates)
        self._chart = Chart(system.kinematics)
        own = system.tree.own
        self._numbering = np.full(system.kinematics.unknowns, -1)
        for v, numbers in own.items():
            self._numbering[numbers] = 6 * v + np.arange(len(numbers))
        self._jointed = len(system.tree.edges) > 0
        self._again = False
        self._dead: Floats | None = None

    @property
    def last(self) -> Floats | None:
        """Increments (K,) of the tree's coordinates in the last step, None before the first."""
        return self._a.last.ravel()[self._numbering] if self._again else None

    @last.setter
    def last(self, value: Array | None) -> None:
        self._again = value is not None
        if value is not None:
            self._a.last.ravel()[self._numbering] = np.real(value)

    def _begin(self, state: State) -> None:
        """Loads, prescribed motion and all that is fixed during a step."""
        system, t = self.system, state.time
        if self._dead is None or not system.loading.constant:
            amplitudes = system.loading.averages(t, t + self.h)
            self._dead = system.loading.dead_force(amplitudes)
            self._a.external[:] = self._dead
        y0, ground1 = system.extend(state.q, t), system.ground(t + self.h)
        kin = system.kinematics
        if kin.spheres or self._drives:
            self._chart.begin(y0, ground1)
            sphere = [k for k, c in enumerate(self._coordinates) if c.kind == "sphere"]
            numbers = [self._coordinates[k].number for k in sphere]
            self._tree["axis"][sphere] = self._chart.fixed[numbers]
            self._tree["driven"][:] = self._chart.driven(self._coordinates)
        p0 = state.p.reshape(-1, 3)
        self.start = StepData(y0, p0, t, self.h, np.zeros(0), self._dead, None)
        a, s, tree = self._a, self._s, self._turn
        a.y0[:], a.p0[:], a.ground1[:] = y0, p0, ground1
        tree.begin(s, self._w, self._again)
        if self.scheme.ends and self.system.beam_groups:
            self._elements.beam_stress(self._g, a.y0, 0.0, 1.0, self._S0, self._S0)
        if self._jointed and not self.integrator.constraint_weight:
            tree.maps(s, a.y0, a.S_left, a.X_left)

    def _direction(self, mixed: bool) -> bool:
        """Newton increment at the configuration evaluated last; False if there is none."""
        s, g, m, w = self._s, self._g, self._m, self._w
        step, weight = self._step, self.integrator.constraint_weight
        step.clear_blocks(w)
        if self.system.beam_groups:
            self._elements.beam_tangent(g, w, self._numbers, mixed)
        step.add_nodes(s, g, m, w, self._numbers, mixed)
        if self._jointed:
            self._turn.maps_right(s, w)
            if weight:
                self._curvature.edge_curvature(s, m, w, weight, mixed)
        self.factorisations += 1
        if not self._blocks.factor(m, w):
            return False
        self._blocks.back(m, w)
        return True

    def solve(self, state: State) -> tuple[int, float] | None:
        """Solve the step that follows `state`: iterations and residual; None: not converged."""
        s, g, w, a, numbers = self._s, self._g, self._w, self._a, self._numbers
        step, tree, settings = self._step, self._turn, self.settings
        self._begin(state)
        tree.configuration(s, w)
        size = step.residual(s, g, w, numbers)
        increments: list[float] = []
        mixed = False
        for count in range(1, settings.iterations + 1):
            if not (isfinite(size) and self._direction(mixed)):
                break
            length, turn, mixed = step.increment(s, g, w, numbers)
            if not length <= settings.largest:  # NaN as well
                break
            increments.append(length)
            tree.add(s, a.x)
            tree.configuration(s, w)
            size = step.residual(s, g, w, numbers)
            capped = turn > settings.rotation
            if not capped and isfinite(size) and converged(increments, size, settings):
                a.last[:] = a.total
                self._again = True
                return count, size
        return None

    @property
    def y1(self) -> Floats:
        """All rows (total, 3) at the end of the step."""
        return self._a.y1.copy()

    @property
    def balance(self) -> Floats:
        """R (rows, 3) of the step."""
        return self._a.R

    def carried(self) -> Floats:
        """Momentum (rows, 3) carried on."""
        a, (mass, momentum, force) = self._a, self.scheme.carry
        out = mass * a.momentum
        if momentum:
            out += momentum * a.p0
        if force:
            out += force * self.scheme.force * (a.internal - a.external)
        return out

    def work(self) -> StepWork:
        """Work of the loads along the step."""
        a, rows = self._a, self.system.rows
        return StepWork(float((a.external * (a.y1[:rows] - a.y0[:rows])).sum()))
