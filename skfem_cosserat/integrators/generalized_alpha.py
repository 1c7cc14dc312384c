"""Generalized-alpha schemes: damping of high frequencies by one number, without conservation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..constraints.rowspace import RowSpace
from ..constraints.saddle import SaddlePoint, accelerations
from ..errors import InputError
from ..model import System
from ..model.balance import Amplitudes, amplitudes_at, balance, balance_tangent
from ..model.couplings import CoupledStart
from ..model.groups import Blocks
from ..types import Array, Floats, numbers
from .base import Evaluation, Integrator, State, StepData, StepWork, largest

__all__ = ["GeneralizedAlpha"]


@dataclass(eq=False)
class _StepData(StepData):
    """Rates (rows, 3) at the start, and what acts at the end of the step."""

    v0: Floats
    a0: Floats
    alpha0: Floats
    at_end: Amplitudes
    hidden: Callable[[Array, Array], Array]


@dataclass(eq=False)
class _Evaluation(Evaluation):
    """Rates (rows, 3) at the end."""

    v1: Array
    a1: Array
    alpha1: Array


class GeneralizedAlpha(Integrator):
    """Second order, unconditionally stable in linear problems, dissipative at high frequencies.

    ``M a_1 + f(q_1, v_1) + G(q_1)^T lambda_1 = 0``, ``g(q_1) = 0`` with
    ``q_1 = q_0 + h v_0 + h^2 ((1/2 - beta) alpha_0 + beta alpha_1)``,
    ``v_1 = v_0 + h ((1 - gamma) alpha_0 + gamma alpha_1)``,
    ``(1 - alpha_m) alpha_1 + alpha_m alpha_0 = (1 - alpha_f) a_1 + alpha_f a_0``.
    All coefficients follow from the spectral radius at infinite frequency. The start is consistent:
    accelerations from the equations of motion, ``alpha_0 = a(t_0 + (alpha_m - alpha_f) h)``.

    Parameters
    ----------
    rho_inf : float
        Spectral radius at infinite frequency, in [0, 1): the factor of what is not resolved, each
        step. 1 would be Newmark's rule, which is not stable with constraints.
    stabilized : bool
        The velocities fulfil the hidden constraints, too (index 2): each is moved onto them along
        ``G^T``, as in the formulation of Gear, Gupta & Leimkuhler.

    Raises
    ------
    InputError
        If `rho_inf` is outside of [0, 1).

    Notes
    -----
    Neither energy nor angular momentum is conserved; multipliers are those at the ends of steps.

    Examples
    --------
    >>> GeneralizedAlpha(rho_inf=0.8).name
    'generalized-alpha, rho_inf = 0.8'
    """

    order = 2
    remembered = 3
    constraint_weight = 1.0
    force_share = 1.0
    advice = "a smaller rho_inf, a finer mesh, a softer section"
    conserves = "nothing exactly"

    def __init__(self, rho_inf: float = 0.8, stabilized: bool = False) -> None:
        rho = numbers("argument rho_inf", "rho_inf", rho_inf)
        if rho.shape != () or not 0 <= rho < 1:
            raise InputError("argument rho_inf", f"{rho_inf!r}, expected a number in [0, 1)")
        self.rho_inf, self.stabilized = float(rho), bool(stabilized)
        r = self.rho_inf
        self.alpha_m, self.alpha_f = (2 * r - 1) / (r + 1), r / (r + 1)
        self.gamma = 0.5 + self.alpha_f - self.alpha_m
        self.beta = 0.25 * (self.gamma + 0.5) ** 2
        kind = "stabilized generalized-alpha" if stabilized else "generalized-alpha"
        self.name = f"{kind}, rho_inf = {r:g}"
        self.reference = (
            "Chung & Hulbert, J. Appl. Mech. 60 (1993) 371; Arnold & Bruels, Multibody Syst. Dyn."
            " 18 (2007) 185"
        )

    def __repr__(self) -> str:
        more = ", stabilized=True" if self.stabilized else ""
        return f"GeneralizedAlpha(rho_inf={self.rho_inf:g}{more})"

    def begin(self, system: System, state: State, h: float) -> StepData:
        """See the base class; the first step starts with consistent accelerations."""
        t1 = state.time + h
        memory = self._start(system, state, h) if state.memory is None else state.memory
        v0, a0, alpha0 = (row.reshape(-1, 3) for row in memory)
        y0 = system.extend(state.q, state.time)
        at_end = amplitudes_at(system, t1)
        coupled: CoupledStart | None = None
        if system.couplings.count:
            coupled = system.couplings.starting(y0, state.turns, at_end.actuators, 1.0)
        dead = system.loading.dead_force(at_end.loads)
        fields = y0, state.p.reshape(-1, 3), state.time, h, at_end.loads, dead, coupled
        return _StepData(*fields, v0, a0, alpha0, at_end, self._hidden(system, t1))

    def _start(self, system: System, state: State, h: float) -> Floats:
        """Velocity, acceleration, and the acceleration ``(alpha_f - alpha_m) h`` earlier."""
        saddle = SaddlePoint(system)
        q, t = state.q, state.time
        y = system.extend(q, t)
        v = saddle(y, state.p, -_ground_part(system, y, t))[0]
        a = accelerations(system, q, v, t, state.turns, saddle)[0]
        s = 0.1 * h
        later = q + s * v + 0.5 * s**2 * a, v + s * a, t + s
        change = (accelerations(system, *later, state.turns, saddle)[0] - a) / s
        return np.array([v, a, a + (self.alpha_m - self.alpha_f) * h * change])

    def _hidden(self, system: System, t1: float) -> Callable[[Array, Array], Array]:
        """Moves velocities (rows, 3) at y_1 onto the hidden constraints, or leaves them."""
        if not self.stabilized or not system.m:
            return lambda y1, v: v

        def moved(y1: Array, v: Array) -> Array:
            y = np.real(y1)
            missing = system.constraints.jacobian(y) @ v.reshape(-1) + _ground_part(system, y, t1)
            return v - RowSpace(system, y).least_norm(missing).reshape(-1, 3)

        return moved

    def evaluate(self, system: System, step: StepData, y1: Array) -> Evaluation:
        """See the base class."""
        assert isinstance(step, _StepData)
        h, b, g = step.h, self.beta, self.gamma
        dq = y1[: system.rows] - step.y0[: system.rows]
        alpha1 = ((dq - h * step.v0) / h**2 - (0.5 - b) * step.alpha0) / b
        v1 = step.v0 + h * ((1 - g) * step.alpha0 + g * alpha1)
        if self.stabilized:
            v1 = step.hidden(y1, v1)
            alpha1 = ((v1 - step.v0) / h - (1 - g) * step.alpha0) / g
        a1 = (1 - self.alpha_m) * alpha1 + self.alpha_m * step.alpha0 - self.alpha_f * step.a0
        a1 = a1 / (1 - self.alpha_f)
        at = balance(system, y1, step.at_end)
        force = at.R
        stresses = at.stresses
        if step.couplings is not None:  # angles are counted on from the start of the step
            assert at.coupled is not None
            coupled = system.couplings.static(step.couplings, y1)
            force = force + (coupled.force - at.coupled.force)[: system.rows]
            at.coupled = coupled
            pairs = system.coupled_rows
            blocks = system.couplings.damping(y1)
            force = force.copy()
            np.add.at(force, pairs[:, 0], (blocks @ v1[pairs[:, 1]][:, :, None])[:, :, 0])
        if system.damped:
            stresses, viscous = self._damped(system, at.Bs, stresses, v1)
            force = force + viscous
        inertia = h * (system.mass @ a1)
        return _Evaluation(
            inertia + h * force,
            max(largest(inertia, system.mass @ v1), abs(h) * at.size),
            system.mass @ v1,
            y1,
            stresses,
            at.Bs,
            at.Bs,
            at.strains,
            at.external,
            at.coupled,
            None,
            v1,
            a1,
            alpha1,
        )

    def _damped(
        self, system: System, Bs: list[Array], elastic: list[Array], v1: Array
    ) -> tuple[list[Array], Array]:
        """Stresses with their viscous part, and forces (rows, 3) of that and of drag."""
        stresses, extra = [], []
        for group, B, S in zip(system.beam_groups, Bs, elastic, strict=True):
            viscous = np.zeros_like(S)
            if group.viscous:
                viscous = group.viscous_stress(group.strain_rate(B, v1))
            stresses.append(S + viscous)
            extra.append(viscous)
        force = system.internal_force(Bs, extra)
        return stresses, force if system.drag is None else force + system.drag @ v1

    def tangent(self, system: System, step: StepData, evaluation: Evaluation) -> list[Blocks]:
        """See the base class: inertia, stiffness at the end, damping."""
        assert isinstance(step, _StepData)
        assert isinstance(evaluation, _Evaluation)
        e, h = evaluation, step.h
        by_q = self.gamma / (self.beta * h)  # of v_1
        inertia = (1 - self.alpha_m) / ((1 - self.alpha_f) * self.beta * h**2)
        at = balance(system, e.mid, step.at_end)
        at.coupled = e.coupled
        blocks = balance_tangent(system, at, step.at_end, e.stresses)
        for k, group in enumerate(system.groups):
            blocks[k] += inertia * group.mass
            if group.drag is not None:
                blocks[k] += by_q * group.drag
        for k, group in enumerate(system.beam_groups):
            if group.viscous:
                turned = np.zeros_like(e.mid)
                turned[: system.rows] = e.v1
                rate = group.strain(turned)[1]  # B is linear in q: that of the velocities
                blocks[k] += group.damping(e.Bs[k], by_q * e.Bs[k] + rate)
        if e.coupled is not None:
            blocks[-1] = blocks[-1] + by_q * system.couplings.damping(e.mid)
        return [h * block for block in blocks]

    def mixed(
        self, system: System, step: StepData, evaluation: Evaluation, change: Array
    ) -> list[Array]:
        """See the base class; forces act at the end of the step."""
        return [
            S + g.stress(g.strain_rate(B, change))
            for g, S, B in zip(system.beam_groups, evaluation.stresses, evaluation.Bs, strict=True)
        ]

    def carry(self, system: System, step: StepData, evaluation: Evaluation) -> Floats:
        """``M v_1``."""
        return np.asarray(evaluation.momentum)

    def memory(self, evaluation: Evaluation) -> Floats | None:
        """See the base class: v, a and alpha."""
        assert isinstance(evaluation, _Evaluation)
        rates = evaluation.v1, evaluation.a1, evaluation.alpha1
        return np.array([rate.reshape(-1) for rate in rates])

    def node_momentum(self, p0: Floats, impulse: Floats, fresh: bool) -> Floats:
        """``M v_n``."""
        return p0

    def work(self, system: System, step: StepData, evaluation: Evaluation, y1: Floats) -> StepWork:
        """Of the loads by the trapezoidal rule; what dampers and the scheme take is not known."""
        change = y1[: system.rows] - step.y0[: system.rows]
        assert isinstance(step, _StepData)
        before = amplitudes_at(system, step.t0)
        start = system.loading.dead_force(before.loads)
        if not system.loading.dead_only:
            start = start + system.loading.force(step.y0[: system.rows], before.loads)
        return StepWork(0.5 * float(((evaluation.external + start) * change).sum()))


def _ground_part(system: System, y: Floats, t: float) -> Floats:
    """Rate (m,) of the constraints by prescribed motion."""
    if not system.moving:
        return np.zeros(system.m)
    rate = np.zeros_like(y)
    rate[system.rows :] = system.ground_rate(t)
    return system.constraints.ground_rate(y, rate)
