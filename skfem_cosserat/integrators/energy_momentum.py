"""Energy-momentum conserving integrator with discrete derivatives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..model import System
from ..model.groups import BeamGroup, Blocks
from ..types import Array, Floats
from .base import (
    Evaluation,
    Integrator,
    Scheme,
    State,
    StepData,
    damped_force,
    largest,
    load_force,
    midpoint_tangent,
)

__all__ = ["EnergyMomentum"]


@dataclass(eq=False)
class EnergyMomentumStep(StepData):
    """Strains, stresses and B at the start of a step, which do not change in it."""

    strains0: list[Array]
    stresses0: list[Array]
    B0s: list[Array]


class EnergyMomentum(Integrator):
    """Midpoint scheme with the discrete derivative of the stored energy.

    ``q_{n+1} - q_n = h v_mid``, ``M (v_{n+1} - v_n) = -h DV - h G(q_mid)^T lambda + h f``, where
    ``DV = int B(q_mid)^T (S_n + S_{n+1})/2 ds`` for the quadratic stored energy, with its discrete
    derivative by the strains for any other; springs and other force elements by discrete
    derivatives of their coordinates. Conserves energy, linear and angular momentum exactly, up to
    the Newton tolerance. Stays bounded for stiff beams, but a solution of a step is not guaranteed.

    Examples
    --------
    >>> EnergyMomentum().constraint_weight
    0.5
    """

    name = "energy-momentum"
    order = 2
    symmetric = True
    constraint_weight = 0.5
    force_share = 1.0
    conserves = "energy, linear and angular momentum"
    reference = (
        "Gonzalez, J. Nonlinear Sci. 6 (1996) 449; Betsch & Leyendecker, IJNME 67 (2006) 499"
    )

    def scheme(self, h: float) -> Scheme:
        """See the base class."""
        return Scheme(2 / h, 2.0, h, ends=True, carry=(1.0, -1.0, 0.0))

    def begin(self, system: System, state: State, h: float) -> StepData:
        """See the base class; the stresses at the start do not change in a step."""
        step = super().begin(system, state, h)
        strains = system.strain(step.y0)
        stresses = [g.stress(eps) for g, (eps, _) in zip(system.beam_groups, strains, strict=True)]
        return EnergyMomentumStep(
            **vars(step),
            strains0=[eps for eps, _ in strains],
            stresses0=stresses,
            B0s=[B for _, B in strains],
        )

    def evaluate(self, system: System, step: StepData, y1: Array) -> Evaluation:
        """See the base class."""
        assert isinstance(step, EnergyMomentumStep)
        h, rows = step.h, system.rows
        mid = 0.5 * (step.y0 + y1)
        groups = system.beam_groups
        strains1 = system.strain(y1)
        # B is linear in q
        Bs = [0.5 * (B0 + B1) for B0, (_, B1) in zip(step.B0s, strains1, strict=True)]
        both = enumerate(zip(groups, strains1, strict=True))
        stresses = [self.stress(g, step, k, eps) for k, (g, (eps, _)) in both]
        momentum = (2 / h) * (system.mass @ (y1[:rows] - step.y0[:rows]))
        internal, stresses, damping = damped_force(system, step, Bs, stresses, y1)
        coupled = None
        if step.couplings is not None:
            coupled = system.couplings.discrete(step.couplings, mid, y1, self.decay(step))
            internal = internal + coupled.force[:rows]
        external = load_force(system, step, mid)
        return Evaluation(
            momentum - 2 * step.p0 + h * (internal - external),
            largest(momentum, step.p0, h * internal, h * external),
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

    def decay(self, step: StepData) -> float:
        """Share of the stiffness of springs by which changes of length are damped."""
        return 0.0

    def tangent(self, system: System, step: StepData, evaluation: Evaluation) -> list[Blocks]:
        """See the base class: ``2M/h + h d(DV)/dq_{n+1}``."""
        moduli = self.moduli(system, step, evaluation)
        return midpoint_tangent(system, step, evaluation, moduli, 2 / step.h, step.h)

    def moduli(self, system: System, step: StepData, evaluation: Evaluation) -> list[Array]:
        """See the base class; of the discrete derivative."""
        assert isinstance(step, EnergyMomentumStep)
        both = zip(system.beam_groups, step.strains0, evaluation.strains, strict=True)
        return [g.discrete_moduli(eps0, eps1) for g, eps0, eps1 in both]

    def carry(self, system: System, step: StepData, evaluation: Evaluation) -> Floats:
        """``M v_{n+1} = 2 M dq/h - M v_n``."""
        return np.asarray(evaluation.momentum - step.p0)

    def node_momentum(self, p0: Floats, impulse: Floats, fresh: bool) -> Floats:
        """``M v_n``."""
        return p0
