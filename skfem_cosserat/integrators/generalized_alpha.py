"""Generalized-alpha schemes: damping of high frequencies by one number, without conservation."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..constraints.base import largest
from ..constraints.saddle import accelerations, nearest_velocity, saddle_point
from ..errors import InputError
from ..model import System
from ..model.balance import (
    Amplitudes,
    Balance,
    amplitudes_at,
    balance,
    balance_tangent,
    predicted,
)
from ..model.groups import Blocks
from ..types import Array, Floats, IndexArray, real, switch
from .base import Evaluation, Integrator, State, StepData, StepOrigin, StepWork

__all__ = ["GeneralizedAlpha"]


@dataclass(eq=False)
class _AlphaStep(StepData):
    """Rates (rows, 3) at the start, and what acts at the end of the step."""

    turns: IndexArray | None
    v0: Floats
    a0: Floats
    alpha0: Floats
    at_end: Amplitudes
    #: velocities of the ground at the end
    ground1: Floats


@dataclass(eq=False)
class _AlphaEvaluation(Evaluation):
    """Forces and rates (rows, 3) at the end."""

    at: Balance
    v1: Array
    a1: Array
    alpha1: Array
    #: v1 before it was moved onto the hidden constraints
    before: Array


class GeneralizedAlpha(Integrator):
    """Second order, unconditionally stable in linear problems, dissipative at high frequencies.

    ``M a_1 + f(q_1, v_1) + G(q_1)^T lambda_1 = 0``, ``g(q_1) = 0`` with
    ``q_1 = q_0 + h v_0 + h^2 ((1/2 - beta) alpha_0 + beta alpha_1)``,
    ``v_1 = v_0 + h ((1 - gamma) alpha_0 + gamma alpha_1)``,
    ``(1 - alpha_m) alpha_1 + alpha_m alpha_0 = (1 - alpha_f) a_1 + alpha_f a_0``.
    All coefficients follow from the spectral radius at infinite frequency. The start is consistent:
    accelerations from the equations of motion, ``alpha_0 = a(t_0 + (alpha_m - alpha_f) h)``, and
    v_0 off the hidden constraints by what steps leave there anyway:
    ``h^2 (1/6 - beta - (alpha_m - alpha_f)/2)`` times the part of the third derivative of q along
    ``M^-1 G^T``. With it multipliers are of second order from the first step on; else they start
    with first order (Arnold, Bruels & Cardona 2015). The recorded momentum is the given one. Where
    a step resolves so little that ``h^2`` times the third derivative would be above the velocities,
    that is cut down to these.

    Parameters
    ----------
    rho_inf : float
        Spectral radius at infinite frequency, in [0, 1): the factor of what is not resolved, each
        step. 1 would be Newmark's rule, which is not stable with constraints.
    stabilized : bool
        At the end of each step the velocity is replaced by the nearest one, in the kinetic energy,
        that fulfils the hidden constraints (index 2): ``M v_1 + G(q_1)^T mu``, with a second set
        of multipliers as in the formulation of Gear, Gupta & Leimkuhler; accelerations and
        constraint forces follow suit. (Velocities in dampers are those before that.)

        False: velocities are left as they come (index 3), for comparison with other codes. This can
        destroy a fast rotation, up to the last per mille of its energy, with every step solved: a
        free body about its stable axis is at rest within 40 turns if these have up to 10, 20, 40,
        80 and 126 steps with a `rho_inf` of 0.5, 0.7, 0.8, 0.9 and 0.95, while 20, 30, 50, 100 and
        180 steps a turn lose what the damping of the scheme takes (30, 2, 0.1 and less per cent).

    Raises
    ------
    InputError
        If `rho_inf` is outside of [0, 1).

    Notes
    -----
    Loads are those at the ends of steps, not their means over them: a pulse that fits between two
    ends is missed. Linear momentum is conserved where nothing acts on a scene; energy and angular
    momentum are not.
    Constraint forces act at the ends of steps: each row of a history holds those of its own state,
    the first one those of the start. ``history["dissipated"]`` is what dampers take;
    ``-history["energy_balance"]`` what the scheme takes, with the error of the trapezoidal rule for
    the work of loads: it may be negative for a while. What a run has lost in all is in
    ``history.meta["energy_balance"]``; above a tenth there is a warning.

    Examples
    --------
    >>> GeneralizedAlpha(rho_inf=0.8).name
    'stabilized generalized-alpha, rho_inf = 0.8'
    """

    order = 2
    constraint_weight = 1.0
    force_share = 1.0
    loses = True
    advice = "a smaller rho_inf, then a finer mesh"
    conserves = "nothing exactly"

    def __init__(self, rho_inf: float = 0.8, stabilized: bool = True) -> None:
        expected = "a number in [0, 1)"
        self.rho_inf = real("argument rho_inf", "rho_inf", rho_inf, expected)
        if not 0 <= self.rho_inf < 1:
            raise InputError("argument rho_inf", f"{rho_inf!r}, expected {expected}")
        self.stabilized = switch("argument stabilized", stabilized)
        r = self.rho_inf
        self.alpha_m, self.alpha_f = (2 * r - 1) / (r + 1), r / (r + 1)
        self.gamma = 0.5 + self.alpha_f - self.alpha_m
        self.beta = 0.25 * (self.gamma + 0.5) ** 2
        # stabilized: and the velocities that forces were found with
        self.remembered = 4 if stabilized else 3
        if not stabilized:
            self.keeping = f"{Integrator.keeping}, or stabilized=True"
        # histories have this name, those from before stabilized=True was the default, too
        kind = "stabilized generalized-alpha" if stabilized else "generalized-alpha"
        self.name = f"{kind}, rho_inf = {r:g}"
        self.reference = (
            "Chung & Hulbert, J. Appl. Mech. 60 (1993) 371; Arnold & Bruels, Multibody Syst. Dyn."
            " 18 (2007) 185; Arnold, Bruels & Cardona, Numer. Math. 129 (2015) 149"
        )

    def __repr__(self) -> str:
        more = "" if self.stabilized else ", stabilized=False"
        return f"GeneralizedAlpha(rho_inf={self.rho_inf:g}{more})"

    def begin(
        self, system: System, state: State, h: float, before: Evaluation | None = None
    ) -> StepData:
        """See the base class; the first step starts with consistent accelerations."""
        t1 = state.time + h
        v0, a0, alpha0 = (row.reshape(-1, 3) for row in self._rates(system, state, h)[:3])
        y0 = system.extend(state.q, state.time)
        at_end = amplitudes_at(system, t1)
        coupled = None
        if system.couplings.count:
            coupled = system.couplings.starting(y0, state.turns, at_end.actuators, 1.0, t1)
        dead = system.loading.dead_force(at_end.loads)
        fields = y0, state.p.reshape(-1, 3), state.time, h, at_end.loads, dead, coupled
        return _AlphaStep(*fields, state.turns, v0, a0, alpha0, at_end, system.ground_rate(t1))

    def _rates(self, system: System, state: State, h: float) -> Floats:
        """v, a, and the acceleration ``(alpha_f - alpha_m) h`` earlier: known, or consistent."""
        if state.memory is not None:
            return state.memory
        q, t = state.q, state.time
        v, a = self._at_start(system, state)
        s = 0.1 * h
        later = q + s * v + 0.5 * s**2 * a, v + s * a, t + s
        change = (accelerations(system, *later, state.turns)[0] - a) / s
        # where the step does not resolve it, no more than velocities that are there
        there, more = self._size(system, v) + h * self._size(system, a), self._size(system, change)
        if 0 < there < h**2 * more:
            change = change * (there / (h**2 * more))
        early = self.alpha_m - self.alpha_f
        if not self.stabilized and system.m:
            p = np.asarray(system.mass @ change.reshape(-1, 3)).reshape(-1)
            across = change - saddle_point(system)(system.extend(q, t), p, np.zeros(system.m))[0]
            v = v + (1 / 6 - self.beta - early / 2) * h**2 * across
        return np.array([v, a, a + early * h * change])

    @staticmethod
    def _size(system: System, rates: Floats) -> float:
        """Root of twice the kinetic energy of rates (n,)."""
        rows = rates.reshape(-1, 3)
        return float(np.sqrt(max(0.0, (rows * (system.mass @ rows)).sum())))

    @staticmethod
    def _at_start(system: System, state: State) -> tuple[Floats, Floats]:
        """Rates v and a (n,) of the equations of motion."""
        y = system.extend(state.q, state.time)
        v = nearest_velocity(system, y, state.p, state.time)
        return v, accelerations(system, state.q, v, state.time, state.turns)[0]

    def resized(self, state: State, h: float) -> State:
        """See the base class: alpha is an acceleration a share of the step earlier or later."""
        if state.memory is None or state.made_by is None:
            return state
        memory = state.memory.copy()
        memory[2] = memory[1] + h / state.made_by.step * (memory[2] - memory[1])
        return replace(state, memory=memory, made_by=StepOrigin(self.name, h))

    def start_force(self, system: System, state: State, h: float) -> Floats:
        """See the base class: what the accelerations leave of the balance."""
        if state.memory is None:
            rates = self._at_start(system, state)
        else:  # stabilized: forces are those of the velocities before they were moved
            rates = state.memory[3 if self.stabilized else 0], state.memory[1]
        v, a = (row.reshape(-1, 3) for row in rates)
        y, amplitudes = system.extend(state.q, state.time), amplitudes_at(system, state.time)
        ydot = np.concatenate([v, system.ground_rate(state.time)])
        R = balance(system, y, amplitudes, turns=state.turns, ydot=ydot).R
        return np.asarray(-(system.mass @ a + R)).reshape(-1)

    def evaluate(self, system: System, step: StepData, y1: Array) -> Evaluation:
        """See the base class."""
        assert isinstance(step, _AlphaStep)
        h, b, g = step.h, self.beta, self.gamma
        dq = y1[: system.rows] - step.y0[: system.rows]
        alpha1 = ((dq - h * step.v0) / h**2 - (0.5 - b) * step.alpha0) / b
        v1 = step.v0 + h * ((1 - g) * step.alpha0 + g * alpha1)
        a1 = (1 - self.alpha_m) * alpha1 + self.alpha_m * step.alpha0 - self.alpha_f * step.a0
        a1 = a1 / (1 - self.alpha_f)
        ydot = np.concatenate([v1, step.ground1])
        at = balance(system, y1, step.at_end, step.y0, step.turns, ydot, g / (b * h))
        inertia = h * (system.mass @ a1)
        momentum = system.mass @ v1
        return _AlphaEvaluation(
            inertia + h * at.R,
            max(largest(inertia, momentum), abs(h) * at.size),
            momentum,
            y1,
            at.stresses,
            at.Bs,
            at.Bs,
            at.strains,
            at.external,
            at.coupled,
            None,
            at,
            v1,
            a1,
            alpha1,
            v1,
        )

    def tangent(self, system: System, step: StepData, evaluation: Evaluation) -> list[Blocks]:
        """See the base class: inertia, stiffness at the end, damping."""
        assert isinstance(evaluation, _AlphaEvaluation)
        e, h = evaluation, step.h
        by_q = self.gamma / (self.beta * h)  # of v_1
        inertia = (1 - self.alpha_m) / ((1 - self.alpha_f) * self.beta * h**2)
        blocks = balance_tangent(system, e.at, Amplitudes(step.amplitudes, _NONE), e.stresses)
        for k, group in enumerate(system.groups):
            blocks[k] += inertia * group.mass
            if group.drag is not None:
                blocks[k] += by_q * group.drag
        velocity = np.zeros_like(e.mid)
        velocity[: system.rows] = e.v1
        for k, beams in enumerate(system.beam_groups):
            if beams.viscous:  # B is linear in q: that of the velocities is its rate
                rate = beams.strain(velocity)[1]
                blocks[k] += beams.damping(e.Bs[k], by_q * e.Bs[k] + rate)
        return [h * block for block in blocks]

    def mixed(
        self, system: System, step: StepData, evaluation: Evaluation, change: Array
    ) -> list[Array]:
        """See the base class; forces act at the end of the step."""
        assert isinstance(evaluation, _AlphaEvaluation)
        return predicted(system, evaluation.at, change)

    def finished(self, system: System, step: StepData, evaluation: Evaluation) -> Evaluation:
        """See the base class: velocities on the hidden constraints if stabilized."""
        assert isinstance(evaluation, _AlphaEvaluation)
        if not self.stabilized or not system.m:
            return evaluation
        e, h = evaluation, step.h
        v = nearest_velocity(system, e.mid, e.momentum.reshape(-1), step.t0 + h).reshape(-1, 3)
        # with the accelerations that belong to it; M (v - v_1) is a constraint force
        more = (v - e.v1) / (self.gamma * h)
        a1 = e.a1 + (1 - self.alpha_m) / (1 - self.alpha_f) * more
        R = e.R + h * (system.mass @ (a1 - e.a1))
        momentum = np.asarray(system.mass @ v)
        return replace(e, R=R, momentum=momentum, v1=v, a1=a1, alpha1=e.alpha1 + more)

    def carry(self, system: System, step: StepData, evaluation: Evaluation) -> Floats:
        """``M v_1``."""
        return np.asarray(evaluation.momentum)

    def memory(self, evaluation: Evaluation) -> Floats | None:
        """See the base class: v, a and alpha."""
        assert isinstance(evaluation, _AlphaEvaluation)
        rates = [evaluation.v1, evaluation.a1, evaluation.alpha1, evaluation.before]
        rates = rates[: self.remembered]
        return np.array([rate.reshape(-1) for rate in rates])

    def node_momentum(self, p0: Floats, impulse: Floats, fresh: bool) -> Floats:
        """``M v_n``."""
        return p0

    def work(self, system: System, step: StepData, evaluation: Evaluation, y1: Floats) -> StepWork:
        """See the base class; all by the trapezoidal rule, which the scheme takes no part in."""
        assert isinstance(step, _AlphaStep)
        assert isinstance(evaluation, _AlphaEvaluation)
        e, rows = evaluation, system.rows
        ydot = np.concatenate([step.v0, system.ground_rate(step.t0)])
        before = amplitudes_at(system, step.t0)
        start = balance(system, step.y0, before, turns=step.turns, ydot=ydot)
        change = y1 - step.y0
        loads = 0.5 * float(((start.external + e.external) * change[:rows]).sum())
        lost = 0.5 * step.h * (start.lost + e.at.lost)
        if step.couplings is None or e.coupled is None or start.coupled is None:
            return StepWork(loads, dissipated=lost)
        couplings = system.couplings
        at0 = couplings.starting(step.y0, step.turns, before.actuators, 1.0, step.t0)
        done = couplings.work(at0, e.coupled, y1), couplings.work(step.couplings, e.coupled, y1)
        both = start.coupled, e.coupled
        loads += 0.5 * sum(coupled.work_of_loads(change) for coupled in both)
        forces = start.coupled.force[rows:] + e.coupled.force[rows:]
        ground = 0.5 * float((forces * change[rows:]).sum())
        return StepWork(loads, 0.5 * (done[0].actuators + done[1].actuators), lost, ground)


#: no actuators: their tangent is in that of the forces found
_NONE = np.zeros(0)
