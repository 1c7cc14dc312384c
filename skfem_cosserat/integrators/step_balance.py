"""The discrete balance of one step, for all schemes that are given by numbers.

A scheme's balance of momentum, without constraint forces, is
``R = mass M dq - momentum p_0 - M (before . r_0) + force (F - f)``; see :class:`Scheme` for the
numbers. Internal forces F and loads f act at one configuration between the ends of the step. A
treatment of the constraints makes a system of equations from it (:mod:`..constraints`), which
Newton's method solves (:mod:`..newton`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..constraints.saddle import nearest_velocity
from ..errors import IncompatibleError
from ..kernels import product
from ..model import System
from ..model.balance import amplitudes_at, balance
from ..model.force_elements import CoupledForce, CoupledStart
from ..model.groups import BeamGroup, Blocks, Parts
from ..types import Array, Floats, largest
from .called_back import coupled as forces_of
from .called_back import trapezoidal_work
from .scheme import Scheme, State, StepWork

if TYPE_CHECKING:
    from .base import Integrator


@dataclass(eq=False)
class StepData:
    """Quantities that stay fixed during a step of size h.

    Attributes
    ----------
    state : State
        At its start.
    y0 : (total, 3) array
        All rows of y there.
    p0 : (rows, 3) array
        Momentum that was carried to it.
    rates0 : (k, rows, 3) array or None
        Rates that the scheme carries on.
    ground_rate : (ground rows, 3) array
        Of the moving ground in the step.
    amplitudes : array
        Factors of the loads.
    dead : (rows, 3) array
        Loads that do not depend on the configuration.
    couplings : CoupledStart or None
        Force elements, if there are any.
    given : (rows, 3) array
        Terms of the balance that do not depend on the end of the step; `size` is the largest.
    strains0, Bs0, stresses0 : list of arrays
        Of each beam group at the start, where stresses are a discrete derivative.
    """

    scheme: Scheme
    state: State
    h: float
    y0: Floats
    p0: Floats
    rates0: Floats | None
    ground_rate: Floats
    amplitudes: Floats
    dead: Floats
    couplings: CoupledStart | None
    given: Floats
    size: float
    strains0: Sequence[Array] = ()
    Bs0: Sequence[Array] = ()
    stresses0: Sequence[Array] = ()


@dataclass(eq=False)
class Evaluation:
    """The balance at a trial configuration of the end of the step.

    Attributes
    ----------
    R : (rows, 3) array
        Balance without constraint forces, in units of momentum.
    size : float
        Largest entry of its terms: what the residual is compared with.
    inertia : (rows, 3) array
        ``mass M dq``.
    forces : (rows, 3) array
        Internal forces, force elements and drag less loads.
    y, y1 : (total, 3) array
        Configuration at which they act, and at the end.
    dq : (rows, 3) array
        ``q_1 - q_0``.
    velocity : (total, 3) array or None
        At which dampers, viscous sections and drag act; None: there are none.
    stresses, Bs : list of arrays
        S (with its viscous part) and B of the internal force, one for each beam group.
    strains, B1s : list of arrays
        Strains through which S changes, and their derivative by the configuration.
    rates : list of (array or None)
        Strain rates of each beam group; None without viscosity.
    external : (rows, 3) array
        Loads.
    coupled : CoupledForce or None
        Force elements, if there are any.
    """

    R: Array
    size: float
    inertia: Array
    forces: Array
    y: Array
    y1: Array
    dq: Array
    velocity: Array | None
    stresses: list[Array]
    Bs: list[Array]
    strains: list[Array]
    B1s: list[Array]
    rates: list[Array | None]
    external: Array
    coupled: CoupledForce | None


class Finished(NamedTuple):
    """Momentum, rates, impulse and work that a solved step hands on.

    Attributes
    ----------
    momentum : (rows, 3) array
        Carried to the next step.
    rates : (k, rows, 3) array or None
        Likewise.
    impulse : (rows, 3) array or None
        What is added to the constraint impulse of the step.
    work : StepWork
    """

    momentum: Floats
    rates: Floats | None
    impulse: Floats | None
    work: StepWork


class StepBalance:
    """Balance of the steps of one size, of a scheme in numbers.

    Parameters
    ----------
    system : System
    integrator : Integrator
        Its ``scheme(h)`` are the numbers.
    h : float
        Step size (s).
    """

    def __init__(self, system: System, integrator: Integrator, h: float):
        scheme = integrator.scheme(h)
        if scheme is None:
            raise IncompatibleError(f"{integrator!r}", "it has neither a scheme nor a balance")
        self.system, self.integrator, self.h, self.scheme = system, integrator, h, scheme
        self._moves = bool(scheme.moved) and system.m > 0

    # -- begin -----------------------------------------------------------------------------------

    def begin(
        self, state: State, before: Evaluation | None = None, end: float | None = None
    ) -> StepData:
        """Data of the step after a state; `before`: the evaluation that the state is the end of.

        `end`: when the step ends (s), to the last digit, as what is prescribed may jump there.
        """
        s, system, h = self.scheme, self.system, self.h
        y0 = system.extend(state.q, state.time)
        p0 = state.p.reshape(-1, 3)
        rates0 = self.integrator.start(system, state, h)
        end = state.time + h if end is None else end
        amplitudes, ground_rate, couplings = self._acting(state, y0, end)
        dead = system.loading.dead_force(amplitudes)
        given = s.momentum * p0
        size = largest(p0)
        if s.before:
            assert rates0 is not None
            own = system.inertia.dot(np.tensordot(s.before, rates0, 1))
            given = given + own
            size = largest(own)
        if system.loading.dead_only:
            given = given + s.force * dead
        step = StepData(
            s, state, h, y0, p0, rates0, ground_rate, amplitudes, dead, couplings, given, size
        )
        if s.ends:
            if before is None:
                both = [g.strain(y0) for g in system.beam_groups]
                step.strains0 = [eps for eps, _ in both]
                step.Bs0 = [B for _, B in both]
            else:
                step.strains0 = before.strains
                step.Bs0 = before.B1s
            beams = zip(system.beam_groups, step.strains0, strict=True)
            step.stresses0 = [g.stress(eps) for g, eps in beams]
        return step

    def _acting(
        self, state: State, y0: Floats, t1: float
    ) -> tuple[Floats, Floats, CoupledStart | None]:
        """Factors of the loads, rates of the ground, and force elements at the start."""
        system = self.system
        t0 = state.time
        elements = system.couplings if system.couplings.count else None
        if self.scheme.at_end:
            at_end = amplitudes_at(system, t1)
            own = None
            if elements is not None:
                end = t1, 0.5 * self.h, True
                own = elements.starting(y0, state.turns, at_end.actuators, 1.0, *end)
            return at_end.loads, system.ground_rate(t1), own
        own = None if elements is None else elements.begin(y0, state.turns, t0, self.h)
        rate = (system.grounds.at(t1) - y0[system.rows :]) / self.h
        return system.loading.averages(t0, t1), rate, own

    # -- balance ---------------------------------------------------------------------------------

    def evaluate(self, step: StepData, y1: Array) -> Evaluation:
        """Balance at the trial configuration y1 (all rows)."""
        s, system, rows = self.scheme, self.system, self.system.rows
        dq = y1[:rows] - step.y0[:rows]
        y = y1 if s.at == 1 else mean(step.y0, y1)
        inertia = s.mass * system.inertia.dot(dq)
        strained = y1 if s.ends else y
        strains1 = [g.strain(strained) for g in system.beam_groups]
        strains = [eps for eps, _ in strains1]
        B1s = [B for _, B in strains1]
        # B is linear in q
        Bs = [mean(B0, B1) for B0, B1 in zip(step.Bs0, B1s, strict=True)] if s.ends else B1s
        groups = enumerate(zip(system.beam_groups, strains, strict=True))
        stresses = [self._stress(step, k, g, eps) for k, (g, eps) in groups]
        velocity: Array | None = None
        rates: list[Array | None] = [None] * len(stresses)
        if system.damped or (step.couplings is not None and s.at_end):
            v = s.rate * dq
            if s.rates:
                assert step.rates0 is not None
                v = v + np.tensordot(s.rates, step.rates0, 1)
            velocity = np.concatenate([v, step.ground_rate])
            stresses, rates = self._viscous(Bs, stresses, velocity)
        forces = system.internal_force(Bs, stresses)
        if system.drag is not None:
            assert velocity is not None
            forces = forces + system.drag @ velocity[:rows]
        coupled = None
        if step.couplings is not None:
            own = system.couplings, s, step.couplings
            coupled = forces_of(*own, y, y1, y if velocity is None else velocity)
            forces = forces + coupled.force[:rows]
        external = step.dead
        internal = forces
        if not system.loading.dead_only:
            external = step.dead + system.loading.force(y[:rows], step.amplitudes)
        forces = internal - external
        R = inertia - step.given
        R += s.force * (internal if system.loading.dead_only else forces)
        # only midpoint forces are looked at as one term
        terms = (forces,) if not s.ends and s.at < 1 else (internal, external)
        size = max(largest(inertia), step.size, abs(s.force) * largest(*terms))
        found = stresses, Bs, strains, B1s, rates, external, coupled
        return Evaluation(R, size, inertia, forces, y, y1, dq, velocity, *found)

    def _stress(self, step: StepData, k: int, group: BeamGroup, strains: Array) -> Array:
        """Elastic stresses of a step in beam group k."""
        if not self.scheme.ends:
            return group.stress(strains)
        S = group.discrete_stress(step.strains0[k], step.stresses0[k], strains)
        chi = self.scheme.decay
        return S + decay_stress(group, chi, strains - step.strains0[k]) if chi else S

    def _viscous(
        self, Bs: list[Array], elastic: list[Array], velocity: Array
    ) -> tuple[list[Array], list[Array | None]]:
        """Stresses with their viscous part, and strain rates."""
        stresses = []
        rates = []
        for g, B, S in zip(self.system.beam_groups, Bs, elastic, strict=True):
            rate = g.strain_rate(B, velocity) if g.viscous else None
            rates.append(rate)
            stresses.append(S if rate is None else S + g.viscous_stress(rate))
        return stresses, rates

    # -- matrix ----------------------------------------------------------------------------------

    def tangent(self, step: StepData, evaluation: Evaluation) -> list[Blocks]:
        """``dR/dq_1`` as blocks of the system's groups, then of its couplings if it has any.

        Without what :meth:`border` gives.
        """
        s, system, e = self.scheme, self.system, evaluation
        material = s.force * self._share
        geometric = s.force * s.at
        parts = []
        for k, g in enumerate(system.beam_groups):
            D = self.moduli(step, e, k)
            beam = g.parts(e.Bs[k], e.B1s[k], e.stresses[k], material, geometric, D)
            beam.scalar += g.inertia(s.mass)
            parts.append(beam)
        parts += [Parts(g.inertia(s.mass)) for g in system.groups[len(parts) :]]
        blocks: list[Blocks] = [*parts]
        if system.damped or not system.loading.dead_only:
            full = [p.blocks() for p in parts]
            for k, g in enumerate(system.beam_groups):
                if g.viscous:
                    full[k] += s.force * g.damping(e.Bs[k], self._rate_slope(e, k))
            if system.drag is not None:
                for block, group in zip(full, system.groups, strict=True):
                    if group.drag is not None:
                        block += (s.force * s.rate) * group.drag
            system.loading.add_tangent(full, e.y[: system.rows], step.amplitudes, -geometric)
            blocks = [*full]
        if e.coupled is not None:
            blocks.append(system.couplings.tangent(e.coupled, s.force))
        return blocks

    @property
    def _share(self) -> float:
        """Share of the derivative by the strains at which S is taken that a change of q_1 has."""
        return 0.5 if self.scheme.ends else self.scheme.at

    def moduli(self, step: StepData, evaluation: Evaluation, k: int) -> Array:
        """Derivative of S by the strains of beam group k (ne, ng, 6, 6), with weights.

        Twice that where S is a discrete derivative between both ends.
        """
        g = self.system.beam_groups[k]
        eps = evaluation.strains[k]
        if not self.scheme.ends:
            return g.moduli(eps)
        D = g.discrete_moduli(step.strains0[k], eps)
        chi = self.scheme.decay
        return D + chi * g.elements.weighted_stiffness if chi else D

    def _rate_slope(self, e: Evaluation, k: int) -> Array:
        """Derivative of the strain rates ``B(y) v`` of beam group k: B is linear in y."""
        s = self.scheme
        g = self.system.beam_groups[k]
        assert e.velocity is not None
        return s.rate * e.Bs[k] + s.at * g.strain(e.velocity)[1]

    def border(self, step: StepData, evaluation: Evaluation) -> tuple[Array, Array] | None:
        """Low-rank part that :meth:`tangent` leaves out; None: there is none.

        It is ``sum_k U_k (V_k . dq_1)`` with U, V (k, rows, 3).
        """
        return None

    def predicted(self, step: StepData, evaluation: Evaluation, change: Array) -> list[Array]:
        """Stresses that a change (rows, 3) of q_1 predicts, to first order."""
        e = evaluation
        out = []
        for k, g in enumerate(self.system.beam_groups):
            D = self.moduli(step, e, k)
            S = e.stresses[k] + self._share * g.linear_stress(D, g.strain_rate(e.B1s[k], change))
            if g.viscous:
                S = S + g.viscous_stress(g.strain_rate(self._rate_slope(e, k), change))
            out.append(S)
        return out

    def with_stresses(self, evaluation: Evaluation, stresses: list[Array]) -> Evaluation:
        """The evaluation with other stresses, for the geometric part of a tangent."""
        pairs = zip(stresses, evaluation.stresses, strict=True)
        force = self.system.internal_force(evaluation.Bs, [new - old for new, old in pairs])
        return replace(evaluation, R=evaluation.R + self.scheme.force * force, stresses=stresses)

    # -- finish ----------------------------------------------------------------------------------

    def finish(self, step: StepData, evaluation: Evaluation) -> Finished:
        """Momentum and rates that a solved step hands on, and the work along the way."""
        s = self.scheme
        e = evaluation
        p = s.carry[0] * e.inertia + s.carry[1] * step.p0 + (s.carry[2] * s.force) * e.forces
        time = step.state.time + self.h
        rates = self.rates(step, e)
        return self.handed_on(e.y1, e.dq, p, step.rates0, rates, self.work(step, e), time)

    def rates(self, step: StepData, evaluation: Evaluation) -> Floats | None:
        """Rates (k, rows, 3) at the end of the step, before velocities are moved."""
        if not self.scheme.table:
            return None
        assert step.rates0 is not None
        return np.tensordot(self.scheme.table, [evaluation.dq, *step.rates0], 1)

    def handed_on(
        self,
        y1: Floats,
        dq: Floats,
        p: Floats,
        rates0: Floats | None,
        rates: Floats | None,
        work: StepWork,
        time: float,
    ) -> Finished:
        """End of a step, its velocities moved onto the hidden constraints if they are to be.

        Parameters
        ----------
        y1 : (total, 3) array
            Configuration at the end, at `time` (s).
        dq, p : (rows, 3) array
            Change of the coordinates, and the momentum carried on.
        rates0, rates : (k, rows, 3) array or None
            At both ends.
        """
        s = self.scheme
        system = self.system
        if s.before:
            assert rates is not None
            p = system.inertia.dot(rates[0])
        if not self._moves:
            return Finished(p, rates, None, work)
        v = nearest_velocity(system, y1, p.reshape(-1), time).reshape(-1, 3)
        new = system.inertia.dot(v)
        change = new - p
        if s.weight == 0:  # of the constraint force of this node, which the next step finds
            return Finished(new, -change[None], None if rates0 is None else rates0[0], work)
        assert rates is not None
        move = v - rates[0]
        if not s.at_end:
            lost = 0.5 * float((rates[0] * p).sum() - (v * new).sum())
            if system.moving:  # what it does along the way counts as work of the motion
                lost += float((change * dq).sum()) / self.h
            work = work._replace(dissipated=work.dissipated + lost, numerical=work.numerical + lost)
        rates = rates + np.array(s.moved)[:, None, None] * move
        return Finished(new, rates, -s.moved_force * change, work)

    def work(self, step: StepData, evaluation: Evaluation) -> StepWork:
        """Work of the forces of a solved step along the way."""
        if self.scheme.at_end:
            return self._trapezoidal_work(step, evaluation)
        e = evaluation
        system = self.system
        loads = float((e.external * e.dq).sum())
        pairs = zip(system.beam_groups, e.rates, strict=True)
        power = sum(g.dissipation(rate) for g, rate in pairs if rate is not None)
        if system.drag is not None:
            assert e.velocity is not None
            v = e.velocity[: system.rows]
            power += max(0.0, float((v * (system.drag @ v)).sum()))  # of either sign at rounding
        lost = self.h * power
        chi = self.scheme.decay
        own = decay_work(system, chi, step.strains0, e.strains) if chi else 0.0
        lost += own
        if step.couplings is None or e.coupled is None:
            return StepWork(loads, dissipated=lost, numerical=own)
        done = system.couplings.work(step.couplings, e.coupled, e.y1)
        lost = lost + done.dissipated
        own = own + done.numerical
        return StepWork(loads + done.loads, done.actuators, lost, done.ground, own)

    def _trapezoidal_work(self, step: StepData, e: Evaluation) -> StepWork:
        """Work where forces are those at the ends of steps: by the trapezoidal rule."""
        assert step.rates0 is not None
        system, rows, t0, turns = self.system, self.system.rows, step.state.time, step.state.turns
        at0 = amplitudes_at(system, t0)
        ydot = np.concatenate([step.rates0[0], system.ground_rate(t0)])
        start = balance(system, step.y0, at0, turns=turns, ydot=ydot)
        loads = 0.5 * float(((start.external + e.external) * (e.y1 - step.y0)[:rows]).sum())
        strained = [b - a for a, b in zip(start.strains, e.strains, strict=True)]
        began = self._damped_work(e, strained, start.Bs, ydot, start.coupled)
        lost = 0.5 * (began + self._damped_work(e, strained, e.Bs, e.velocity, e.coupled))
        if step.couplings is None or e.coupled is None or start.coupled is None:
            return StepWork(loads, dissipated=lost)
        couplings = system.couplings
        starts = (couplings.starting(step.y0, turns, at0.actuators, 1.0, t0), step.couplings)
        done = trapezoidal_work(couplings, starts, (start.coupled, e.coupled), e.y1, rows)
        return done._replace(loads=loads + done.loads, dissipated=lost)

    def _damped_work(
        self,
        e: Evaluation,
        strained: list[Array],
        Bs: list[Array],
        velocity: Array | None,
        coupled: CoupledForce | None,
    ) -> float:
        """Work (J) against viscous sections, drag and dampers in a step, by their forces at an end.

        Motions that steps do not resolve change velocities at the ends by far more than the way.
        """
        system = self.system
        work = 0.0
        if velocity is None:
            return work
        for g, B, change in zip(system.beam_groups, Bs, strained, strict=True):
            if g.viscous:
                stress = g.viscous_stress(g.strain_rate(B, velocity))
                work += float((g.elements.measure * stress * change).sum())
        if system.drag is not None:
            work += float(((system.drag @ velocity[: system.rows]) * e.dq).sum())
        if coupled is not None and e.coupled is not None:
            for own, ended in zip(coupled.responses, e.coupled.responses, strict=True):
                assert own.forces.damped is not None
                work += float((own.forces.damped * ended.forces.travel).sum())
        return work

    # -- reports ---------------------------------------------------------------------------------

    def start_force(self, state: State) -> Floats | None:
        """Constraint force (n,) at a state a run starts from; None: that of the step after it.

        Where forces act at the ends of steps: what the rates leave of the balance.
        """
        if not self.scheme.at_end:
            return None
        system = self.system
        rates = self.integrator.start(self.system, state, self.h)
        assert rates is not None
        y = system.extend(state.q, state.time)
        t = state.time
        # the velocity with which forces were found, before it was moved
        if state.rates is None:
            v = nearest_velocity(system, y, state.p, t).reshape(-1, 3)
        else:
            v = rates[self.scheme.found_with]
        ydot = np.concatenate([v, system.ground_rate(t)])
        R = balance(system, y, amplitudes_at(system, t), turns=state.turns, ydot=ydot).R
        return (-(system.mass @ rates[1] + R)).reshape(-1)


def decay_stress(group: BeamGroup, chi: float, change: Array) -> Array:
    """Stress that a scheme meant to lose energy adds for a change of the strains."""
    return (0.5 * chi) * product(change, group.elements.stiffness)


def decay_work(
    system: System, chi: float, strains0: Sequence[Array], strains1: Sequence[Array]
) -> float:
    """Energy (J) that :func:`decay_stress` takes in a step, by the strains of all beam groups."""
    lost = 0.0
    for g, eps0, eps1 in zip(system.beam_groups, strains0, strains1, strict=True):
        S = decay_stress(g, chi, eps1 - eps0)
        lost += float((g.elements.measure * S * (eps1 - eps0)).sum())
    return lost


def mean(a: Array, b: Array) -> Array:
    """``(a + b)/2``."""
    out = a + b
    out *= 0.5
    return out


def end_velocity(system: System, state: State) -> Floats:
    """Velocity (1, rows, 3) that a state carries on; at a start the nearest one to its momentum."""
    if state.rates is not None:
        return state.rates.reshape(1, -1, 3)
    y = system.extend(state.q, state.time)
    return nearest_velocity(system, y, state.p, state.time).reshape(1, -1, 3)
