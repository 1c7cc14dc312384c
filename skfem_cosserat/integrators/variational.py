"""Variational (symplectic-momentum) integrator: midpoint discrete Lagrangian."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..constraints.base import largest
from ..constraints.saddle import nearest_velocity
from ..model import System
from ..model.groups import Blocks
from ..types import Array, Floats, switch
from .base import (
    Evaluation,
    Integrator,
    Scheme,
    State,
    StepData,
    damped_force,
    load_force,
    midpoint_tangent,
)

__all__ = ["Variational"]


@dataclass(eq=False)
class _VariationalStep(StepData):
    #: constraint impulse (rows, 3) that the step before has taken off the momentum already
    moved: Floats


@dataclass(eq=False)
class _VariationalEvaluation(Evaluation):
    kick: Array
    #: as of the step, at its end
    moved: Floats | None = None


class Variational(Integrator):
    """``L_d(q_n, q_{n+1}) = h L((q_n + q_{n+1})/2, (q_{n+1} - q_n)/h)``, constraints at the nodes.

    Discrete Euler-Lagrange equations (22) in position-momentum form:
    ``M dq/h + (h/2) (f_int - f)(q_mid) - p_n + h G(q_n)^T lambda_n = 0``. Symplectic, conserves
    momentum maps exactly; energy oscillates without drift while high frequencies are resolved, and
    blows up with stiff beams: constraint forces act at the nodes, as in the leapfrog scheme, so
    rotations that alternate from step to step grow where a beam is compressed by more than a strain
    of about ``0.4/(h omega)^2``, omega its highest frequency (``diagnostics.highest_frequency``).

    The source paper's other remedy, the mean effect of fast vibrations as a force on the slow
    motion, is not offered. It takes frequencies omega_k(q) far above all others, whose actions
    ``E_k/omega_k`` are then adiabatic invariants: the force is
    ``-sum_k (E_k/omega_k) d(omega_k)/dq``. A beam's frequencies have no such gap (those of bending
    go from below 1/h to far above it), they come close to each other where it deforms, and then
    actions are exchanged; and the blow-up above is no matter of neglected vibrations but of node
    rotations that the midpoint stresses do not see. What is not resolved is taken out by schemes
    that are meant to lose energy (``scheme.loses``), such as :class:`GeneralizedAlpha`.

    Parameters
    ----------
    stabilized : bool
        The momenta at the nodes fulfil the hidden constraints (46), too: at the end of each step a
        second constraint force ``G(q_{n+1})^T mu`` moves the momentum to the nearest one, in the
        kinetic energy, that does (RATTLE). The motion is the same to rounding, and so are the
        multipliers, ``mu`` being part of them: what the momentum has along ``G^T`` changes the
        multipliers of the next step only (Leimkuhler & Skeel 1994). ``history["p"]`` is the
        ``history["Qp"]`` of the scheme without. Plain kernels only, as
        ``history.meta["kernels_why"]`` says; not for steps under control, nor is the scheme
        without: see :class:`StepControl`.

    Examples
    --------
    >>> Variational().order
    2
    """

    name = "variational"
    order = 2
    composed_to = 6
    fixed_step = (
        "symplectic for steps of one size only: with steps that follow the motion its energy drifts"
    )
    constraint_weight = 0.0
    force_share = 0.5
    start_share = 0.5
    carries_node_momentum = False
    frequency_limit = 10.0  # explained and measured in examples/paper/failure_mechanism.py
    advice = "EnergyMomentum(), then a finer mesh"
    conserves = "symplectic form, linear and angular momentum"
    reference = "Leyendecker, Marsden & Ortiz, ZAMM 88 (2008) 677, equations (22) and (25)"

    def __init__(self, stabilized: bool = False) -> None:
        self.stabilized = switch("argument stabilized", stabilized)
        if stabilized:
            self.name = "stabilized variational"
            self.carries_node_momentum, self.remembered = True, 1
            self.reference = (
                f"{self.reference}; Andersen, J. Comput. Phys. 52 (1983) 24; Leimkuhler & Skeel,"
                " J. Comput. Phys. 112 (1994) 117"
            )

    def __repr__(self) -> str:
        return f"Variational({'stabilized=True' if self.stabilized else ''})"

    def scheme(self, h: float) -> Scheme | None:
        """See the base class."""
        if self.stabilized:
            return None
        return Scheme(1 / h, 1.0, h / 2, ends=False, carry=(1.0, 0.0, -1.0))

    def begin(
        self, system: System, state: State, h: float, before: Evaluation | None = None
    ) -> StepData:
        """See the base class."""
        step = super().begin(system, state, h, before)
        if not self.stabilized:
            return step
        moved = np.zeros(system.n) if state.memory is None else state.memory[0]
        return _VariationalStep(**vars(step), moved=moved.reshape(-1, 3))

    def evaluate(self, system: System, step: StepData, y1: Array) -> _VariationalEvaluation:
        """See the base class."""
        h, rows = step.h, system.rows
        mid = 0.5 * (step.y0 + y1)
        strains = system.strain(mid)
        stresses = [g.stress(eps) for g, (eps, _) in zip(system.beam_groups, strains, strict=True)]
        Bs = [B for _, B in strains]
        momentum = (system.inertia.dot(y1[:rows] - step.y0[:rows])) / h
        internal, stresses, damping = damped_force(system, step, Bs, stresses, y1)
        coupled = None
        if step.couplings is not None:
            coupled = system.couplings.midpoint(step.couplings, mid, y1)
            internal = internal + coupled.force[:rows]
        external = load_force(system, step, mid)
        kick = (0.5 * h) * (external - internal)
        return _VariationalEvaluation(
            momentum - kick - step.p0,
            largest(momentum, step.p0, kick),
            momentum,
            mid,
            stresses,
            Bs,
            Bs,
            [eps for eps, _ in strains],
            external,
            coupled,
            damping,
            kick,
        )

    def tangent(self, system: System, step: StepData, evaluation: Evaluation) -> list[Blocks]:
        """See the base class: ``M/h + (h/4) K(q_mid)``."""
        moduli, force = self.moduli(system, step, evaluation), self.force_share * step.h
        return midpoint_tangent(system, step, evaluation, moduli, 1 / step.h, force)

    def finished(self, system: System, step: StepData, evaluation: Evaluation) -> Evaluation:
        """See the base class."""
        if not isinstance(step, _VariationalStep):
            return evaluation
        assert isinstance(evaluation, _VariationalEvaluation)
        e, p1 = evaluation, self.carry(system, step, evaluation)
        y1 = 2 * e.mid - step.y0
        v1 = nearest_velocity(system, y1, p1.reshape(-1), step.t0 + step.h)
        moved = p1 - system.mass @ v1.reshape(-1, 3)
        return replace(e, R=e.R - step.moved, kick=e.kick - moved, moved=moved)

    def memory(self, evaluation: Evaluation) -> Floats | None:
        """See the base class: the impulse by which the momentum was moved, if it was."""
        assert isinstance(evaluation, _VariationalEvaluation)
        return None if evaluation.moved is None else evaluation.moved.reshape(1, -1)

    def carry(self, system: System, step: StepData, evaluation: Evaluation) -> Floats:
        """``p_{n+1}`` before its constraint force: ``D_2 L_d + f^+`` (35)."""
        assert isinstance(evaluation, _VariationalEvaluation)
        return np.asarray(evaluation.momentum + evaluation.kick)

    def node_momentum(self, p0: Floats, impulse: Floats, fresh: bool) -> Floats:
        """Mean of both discrete Legendre transforms (34), (35), whose parts of lambda cancel."""
        return p0 if fresh or self.stabilized else p0 - 0.5 * impulse
