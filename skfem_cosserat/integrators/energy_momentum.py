"""Energy-momentum conserving integrator with discrete derivatives."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..constraints.base import largest
from ..constraints.saddle import nearest_velocity
from ..model import System
from ..model.force_elements import CoupledForce, CoupledStart
from ..model.groups import BeamGroup, Blocks
from ..types import Array, Floats, switch
from .base import (
    Evaluation,
    Integrator,
    Scheme,
    State,
    StepData,
    StepWork,
    damped_force,
    load_force,
    midpoint_tangent,
)

__all__ = ["EnergyMomentum"]


@dataclass(eq=False)
class EnergyMomentumStep(StepData):
    """Strains, stresses and B at the start of a step; and v (rows, 3) where that is carried on.

    `given` (rows, 3) is what the balance takes off: momentum, and loads that do not depend on the
    configuration if there are no others; `size` is its largest term.
    """

    strains0: list[Array]
    stresses0: list[Array]
    B0s: list[Array]
    given: Floats
    size: float
    v0: Floats | None = None


@dataclass(eq=False)
class MovedEvaluation(Evaluation):
    """Velocities (rows, 3) moved onto the hidden constraints, and the energy that took (J)."""

    v1: Floats | None = None
    lost: float = 0.0


class EnergyMomentum(Integrator):
    """Midpoint scheme with the discrete derivative of the stored energy.

    ``q_{n+1} - q_n = h v_mid``, ``M (v_{n+1} - v_n) = -h DV - h G(q_mid)^T lambda + h f``, where
    ``DV = int B(q_mid)^T (S_n + S_{n+1})/2 ds`` for the quadratic stored energy, with its discrete
    derivative by the strains for any other; springs and other force elements by discrete
    derivatives of their coordinates. Conserves energy, linear and angular momentum exactly, up to
    the Newton tolerance. Stays bounded for stiff beams, but a solution of a step is not guaranteed.

    Parameters
    ----------
    stabilized : bool
        The velocities at the nodes fulfil the hidden constraints (46), too, as in the formulation
        of Gear, Gupta & Leimkuhler: at the end of each step the momentum is moved by a second
        constraint force ``G(q_{n+1})^T mu`` to the nearest one, in the kinetic energy, that does.
        (Else ``G v_n`` alternates by O(h^2), and constraint forces, each of a midpoint, by O(h):
        means of neighbours are of second order.) It is part of the step's constraint force. Momenta
        are kept; the energy is not: without moving ground it falls by what the move takes,
        ``history["dissipated"]``, of fourth order in a step.

    Examples
    --------
    >>> EnergyMomentum().constraint_weight
    0.5
    """

    name = "energy-momentum"
    order = 2
    composed_to = 4  # see Composition
    constraint_weight = 0.5
    force_share = 1.0
    conserves = "energy, linear and angular momentum"
    reference = (
        "Gonzalez, J. Nonlinear Sci. 6 (1996) 449; Betsch & Leyendecker, IJNME 67 (2006) 499"
    )

    def __init__(self, stabilized: bool = False) -> None:
        self.stabilized = switch("argument stabilized", stabilized)
        if stabilized:
            self.name = "stabilized energy-momentum"
            self.composed_to, self.remembered = 0, 1
            self.conserves = "linear and angular momentum; energy never grows"
        else:
            self.keeping = ""

    def __repr__(self) -> str:
        return f"EnergyMomentum({'stabilized=True' if self.stabilized else ''})"

    def scheme(self, h: float) -> Scheme | None:
        """See the base class."""
        if self.stabilized:
            return None
        return Scheme(2 / h, 2.0, h, ends=True, carry=(1.0, -1.0, 0.0))

    def begin(
        self, system: System, state: State, h: float, before: Evaluation | None = None
    ) -> StepData:
        """See the base class; the stresses at the start do not change in a step."""
        step = super().begin(system, state, h, before)
        if before is None:
            strains = system.strain(step.y0)
        else:
            strains = list(zip(before.strains, before.B1s, strict=True))
        stresses = [g.stress(eps) for g, (eps, _) in zip(system.beam_groups, strains, strict=True)]
        load = h * step.dead
        return EnergyMomentumStep(
            **vars(step),
            strains0=[eps for eps, _ in strains],
            stresses0=stresses,
            B0s=[B for _, B in strains],
            given=2 * step.p0 + load if system.loading.dead_only else 2 * step.p0,
            size=largest(step.p0, load),
            v0=self._velocity(system, state, step.y0) if self.remembered else None,
        )

    def _velocity(self, system: System, state: State, y0: Floats) -> Floats:
        """Velocity (rows, 3) at the start of a step."""
        if state.memory is not None:
            return state.memory[0].reshape(-1, 3)
        return nearest_velocity(system, y0, state.p, state.time).reshape(-1, 3)

    def evaluate(self, system: System, step: StepData, y1: Array) -> Evaluation:
        """See the base class."""
        assert isinstance(step, EnergyMomentumStep)
        h, rows = step.h, system.rows
        mid = _mean(step.y0, y1)
        groups = system.beam_groups
        strains1 = system.strain(y1)
        # B is linear in q
        Bs = [_mean(B0, B1) for B0, (_, B1) in zip(step.B0s, strains1, strict=True)]
        both = enumerate(zip(groups, strains1, strict=True))
        stresses = [self.stress(g, step, k, eps) for k, (g, (eps, _)) in both]
        momentum = system.inertia.dot(y1[:rows] - step.y0[:rows])
        momentum *= 2 / h
        internal, stresses, damping = damped_force(system, step, Bs, stresses, y1)
        coupled = None
        if step.couplings is not None:
            coupled = self.coupled(system, step, step.couplings, mid, y1)
            internal = internal + coupled.force[:rows]
        external = load_force(system, step, mid)
        terms = [momentum, h * internal]
        R = momentum + terms[1] - step.given
        if not system.loading.dead_only:
            terms.append(h * external)
            R -= terms[2]
        return MovedEvaluation(
            R,
            max(largest(*terms), step.size),  # the first one if it is not a number
            momentum,
            mid,
            stresses,
            Bs,
            [B for _, B in strains1],
            [eps for eps, _ in strains1],
            external,
            coupled,
            damping,
        )

    def stress(self, group: BeamGroup, step: StepData, k: int, strains: Array) -> Array:
        """Stresses of a step in beam group k: the discrete derivative of its stored energy."""
        assert isinstance(step, EnergyMomentumStep)
        return group.discrete_stress(step.strains0[k], step.stresses0[k], strains)

    def coupled(
        self, system: System, step: StepData, start: CoupledStart, mid: Array, y1: Array
    ) -> CoupledForce:
        """Forces of springs and other force elements in a step: discrete derivatives likewise."""
        return system.couplings.discrete(start, mid, y1)

    def tangent(self, system: System, step: StepData, evaluation: Evaluation) -> list[Blocks]:
        """See the base class: ``2M/h + h d(DV)/dq_{n+1}``."""
        moduli = self.moduli(system, step, evaluation)
        return midpoint_tangent(system, step, evaluation, moduli, 2 / step.h, step.h)

    def moduli(self, system: System, step: StepData, evaluation: Evaluation) -> list[Array]:
        """See the base class; of the discrete derivative."""
        assert isinstance(step, EnergyMomentumStep)
        both = zip(system.beam_groups, step.strains0, evaluation.strains, strict=True)
        return [g.discrete_moduli(eps0, eps1) for g, eps0, eps1 in both]

    def finished(self, system: System, step: StepData, evaluation: Evaluation) -> Evaluation:
        """See the base class."""
        if not self.stabilized or not system.m:
            return evaluation
        assert isinstance(step, EnergyMomentumStep)
        assert isinstance(evaluation, MovedEvaluation)
        e, h, rows = evaluation, step.h, system.rows
        y1 = 2 * e.mid - step.y0
        p1 = e.momentum - step.p0
        v1 = nearest_velocity(system, y1, p1.reshape(-1), step.t0 + h).reshape(-1, 3)
        momentum = np.asarray(system.mass @ v1)
        change, way = momentum - p1, (y1 - step.y0)[:rows] / h
        lost = 0.5 * float(((self._end_velocity(step, e, way) - v1) * (p1 + momentum)).sum())
        if system.moving:  # what it does along the way counts as work of the motion
            lost += float((change * way).sum())
        return replace(e, R=e.R + change, momentum=momentum + step.p0, v1=v1, lost=lost)

    def _end_velocity(self, step: EnergyMomentumStep, e: MovedEvaluation, way: Floats) -> Floats:
        """Velocity (rows, 3) that a step ends with, before it is moved; `way` by the step's h."""
        assert step.v0 is not None
        return 2 * way - step.v0

    def memory(self, evaluation: Evaluation) -> Floats | None:
        """See the base class: v if stabilized."""
        assert isinstance(evaluation, MovedEvaluation)
        return None if evaluation.v1 is None else evaluation.v1.reshape(1, -1)

    def work(self, system: System, step: StepData, evaluation: Evaluation, y1: Floats) -> StepWork:
        """See the base class."""
        assert isinstance(evaluation, MovedEvaluation)
        done = super().work(system, step, evaluation, y1)
        if not evaluation.lost:
            return done
        whole, own = done.dissipated + evaluation.lost, done.numerical + evaluation.lost
        return done._replace(dissipated=whole, numerical=own)

    def carry(self, system: System, step: StepData, evaluation: Evaluation) -> Floats:
        """``M v_{n+1} = 2 M dq/h - M v_n``."""
        return np.asarray(evaluation.momentum - step.p0)

    def node_momentum(self, p0: Floats, impulse: Floats, fresh: bool) -> Floats:
        """``M v_n``."""
        return p0


def _mean(a: Array, b: Array) -> Array:
    """``(a + b)/2``."""
    out = a + b
    out *= 0.5
    return out
