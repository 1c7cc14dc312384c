"""What a solved step gives beside the next state."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..constraints.saddle import accelerations, nearest_velocity
from ..model import System
from ..types import Floats
from .base import Integrator, State, StepWork

__all__ = ["ComposedReport", "Solved", "StepReport", "StrideReport"]


@dataclass(eq=False)
class StepReport:
    """What a solved step gives beside the next state.

    Attributes
    ----------
    state : State
        At the end of the step.
    iterations, attempts : int
        Newton iterations (of all attempts) and attempts (1: none was repeated).
    residual : float
        Scaled residual at the solution.
    work : StepWork
        Of loads, actuators and dampers in the step.
    stages : list of StepReport
        The steps that a composed one is made of, itself otherwise.
    """

    state: State
    iterations: int
    attempts: int
    residual: float
    work: StepWork
    _solved: Solved

    @property
    def stages(self) -> list[StepReport]:
        """See the class."""
        return [self]

    @property
    def steps(self) -> int:
        """How many steps it is of: more than one for those of :meth:`Stepper.stride`."""
        return 1

    @property
    def all_iterations(self) -> int:
        """Newton iterations of all of them."""
        return self.iterations

    @property
    def step(self) -> float:
        """Its size (s)."""
        return self._solved.h

    @property
    def momentum(self) -> Floats:
        """``p_n`` (n,) of the discrete Legendre transform at the *start* of the step."""
        _, integrator, _, state, _, impulse = self._solved
        p0 = state.p.reshape(-1, 3)
        return np.array(integrator.node_momentum(p0, impulse, state.fresh)).reshape(-1)

    @property
    def constraint_force(self) -> Floats:
        """``G^T lambda`` (n,) of the step (N; N m on directors)."""
        _, integrator, h, state, _, impulse = self._solved
        share = integrator.start_share if state.fresh else 1.0
        return (impulse / (share * h)).reshape(-1)

    @property
    def constraint_point(self) -> Floats:
        """Where it acts: all rows (total, 3) of y, at the node or midpoint."""
        system, integrator, _, state, y1, _ = self._solved
        weight, y0 = integrator.constraint_weight, system.extend(state.q, state.time)
        return y0 if weight == 0 else (1 - weight) * y0 + weight * y1


@dataclass(eq=False)
class StrideReport(StepReport):
    """Report of the last of several steps that were solved in one go, with the work of all.

    Where the step after it was tried and not solved, there are no momentum and constraint force.
    """

    _steps: int
    _all_iterations: int

    @property
    def steps(self) -> int:
        """See the base class."""
        return self._steps

    @property
    def all_iterations(self) -> int:
        """See the base class."""
        return self._all_iterations


@dataclass(eq=False)
class ComposedReport(StepReport):
    """Report of a step that is composed of others, or explicit.

    Its constraint force is that of the continuous equations at the start: the steps give theirs to
    second order only. So it is with the part of the momentum along ``G^T`` that nodes of the
    variational scheme have: it is left out.
    """

    _stages: list[StepReport]

    @classmethod
    def of(cls, stages: list[StepReport], state: State) -> ComposedReport:
        """Report of a step made of these ones, that ends in a state."""
        works = np.array([stage.work for stage in stages])
        return cls(
            state,
            sum(stage.iterations for stage in stages),
            max(stage.attempts for stage in stages),
            max(stage.residual for stage in stages),
            StepWork(*works.sum(0).tolist()),
            stages[0]._solved,
            stages,
        )

    @property
    def stages(self) -> list[StepReport]:
        """See the base class; itself if there are none."""
        return self._stages or [self]

    @property
    def momentum(self) -> Floats:
        """See the base class."""
        system, integrator, _, _, _, _ = self._solved
        if integrator.carries_node_momentum:
            return super().momentum
        return np.asarray(system.mass @ self._velocity.reshape(-1, 3)).reshape(-1)

    @property
    def _velocity(self) -> Floats:
        """At the start (n,): on the hidden constraints, as nothing along ``G^T`` changes it."""
        system, _, _, state, _, _ = self._solved
        return nearest_velocity(system, self.constraint_point, state.p, state.time)

    @property
    def constraint_force(self) -> Floats:
        """See the base class."""
        system, _, _, state, _, _ = self._solved
        y, v = self.constraint_point, self._velocity
        lam = accelerations(system, state.q, v, state.time, state.turns)[1]
        return np.asarray(system.constraints.jacobian(y).T @ lam)

    @property
    def constraint_point(self) -> Floats:
        """See the base class: at the node."""
        system, _, _, state, _, _ = self._solved
        return system.extend(state.q, state.time)


class Solved(NamedTuple):
    """What momentum and constraint force of a step are made from, when somebody asks for them.

    Attributes
    ----------
    h : float
    state : State
        At the start of the step.
    y1 : (total, 3) array
    impulse : (rows, 3) array
        ``h G^T lambda``.
    """

    system: System
    integrator: Integrator
    h: float
    state: State
    y1: Floats
    impulse: Floats
