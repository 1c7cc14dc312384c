"""Energy-decaying integrator: high frequencies are damped, momenta are kept."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..errors import InputError
from ..model import System
from ..model.groups import BeamGroup, Blocks, Parts
from ..types import Array, Floats, positive, real, switch
from .base import Evaluation, State, StepData, StepWork
from .common import Flow, separate_parts
from .energy_momentum import EnergyMomentum, EnergyMomentumStep, MovedEvaluation

__all__ = ["EnergyDecaying"]


@dataclass(eq=False)
class _StepData(EnergyMomentumStep):
    """The share of both terms in this step."""

    chi: float = 0.0


@dataclass(eq=False)
class _Evaluation(MovedEvaluation):
    flow: Flow | None = None
    extra: list[Array] = field(default_factory=list)
    v0: Floats | None = None


class EnergyDecaying(EnergyMomentum):
    """Energy-momentum scheme that takes energy out of high frequencies, and never puts any in.

    The stresses of a step are ``(S_n + S_{n+1})/2 + (chi/2) D (eps_{n+1} - eps_n)`` with the
    stiffness D at zero strain (for other stored energies than quadratic ones the discrete
    derivative takes the place of the mean), springs alike. Velocities are
    ``dq = h (v_mid + f)`` with ``f = (chi/2) (v_{n+1} - v_n)`` less what turns all velocities of a
    connected part alike, or shifts a free one: see
    :mod:`skfem_cosserat.integrators.common`. Both terms take ``(chi/2) |.|^2`` of what they act on
    out of the energy, so without loads and drives the energy never grows; linear and angular
    momentum are kept exactly, and steady rigid motion is not damped.

    Parameters
    ----------
    chi : float, optional
        Share of both terms, in [0, 1]: first order. What is not resolved is multiplied by
        ``(1 - chi)/(1 + chi)`` in each step. Default: 0.05, if `rate` is not given.
    rate : float, optional
        ``chi = rate * h`` instead (1/s), at most 1: second order; the damping fades as the step
        gets smaller.
    velocity : bool
        False: without the term in the velocities. What is not resolved is damped in its
        displacements only, its velocities keep alternating.
    stabilized : bool
        Velocities on the hidden constraints, as with :class:`EnergyMomentum`; the energy that this
        takes is in ``history["dissipated"]``. Without it ``G v_n`` of prescribed or constrained
        motion starts with an error of O(chi h) that alternates and dies away by the factor above,
        and with it constraint forces with one of O(chi): of order 0, with `rate` 1, in the first
        steps.

    Raises
    ------
    InputError
        If `chi` is outside of [0, 1], `rate` not positive, or both are given.

    Notes
    -----
    The extra velocity of Armero & Romero is parallel to the momentum of the same node and damps
    the change of its magnitude: it keeps the angular momentum of each node, but what alternates
    about rest (``p_{n+1} = -p_n``) is not damped by it. The one used here keeps the sum only. It
    takes the consistent mass matrix as it is. Where all velocities of a part are turned by the
    step in the same way (a single mass point on a spring that moves across its spring), that is
    taken for common motion, too, and not damped.

    Not symmetric: constraint forces are of the order of the scheme, at midpoints, once their first
    errors have died away (stabilized: at once).

    Examples
    --------
    >>> EnergyDecaying(chi=0.1).order, EnergyDecaying(rate=10.0).order
    (1, 2)
    """

    composed_to = 0
    conserves = "linear and angular momentum; energy never grows"
    advice = "a larger chi, a finer mesh, a softer section"
    reference = "Armero & Romero, Comput. Methods Appl. Mech. Engrg 190 (2001) 2603 and 6783"

    def __init__(
        self,
        chi: float | None = None,
        rate: float | None = None,
        velocity: bool = True,
        stabilized: bool = False,
    ) -> None:
        if chi is not None and rate is not None:
            raise InputError("argument chi", f"{chi!r} and rate = {rate!r}, expected one of them")
        if rate is not None:
            self.rate: float | None = positive("argument rate", "rate", rate, " of 1/s")
            self.chi, self.order, text = 0.0, 2, f"rate = {self.rate:g}/s"
        else:
            expected = "a number in [0, 1]"
            value = real("argument chi", "chi", 0.05 if chi is None else chi, expected)
            if not 0 <= value <= 1:
                raise InputError("argument chi", f"{chi!r}, expected {expected}")
            self.rate, self.chi, self.order = None, value, 1
            text = f"chi = {self.chi:g}"
        super().__init__(stabilized)
        self.velocity = switch("argument velocity", velocity)
        self.remembered = int(self.velocity or self.stabilized)
        self.conserves = type(self).conserves
        self._text = text.replace("/s", "").replace(" ", "")
        kind = "stabilized energy-decaying" if stabilized else "energy-decaying"
        self.name = f"{kind}, {text}" + ("" if velocity else ", stresses only")

    def __repr__(self) -> str:
        more = "" if self.velocity else ", velocity=False"
        more += ", stabilized=True" if self.stabilized else ""
        return f"EnergyDecaying({self._text}{more})"

    def scheme(self, h: float) -> None:
        """See the base class: there are no compiled kernels."""
        return None

    def begin(
        self, system: System, state: State, h: float, before: Evaluation | None = None
    ) -> StepData:
        """See the base class."""
        step = super().begin(system, state, h, before)
        chi = self.chi if self.rate is None else min(1.0, self.rate * h)
        return _StepData(**vars(step), chi=chi)

    def stress(self, group: BeamGroup, step: StepData, k: int, strains: Array) -> Array:
        """See the base class."""
        return super().stress(group, step, k, strains) + self._extra(group, step, k, strains)

    def _extra(self, group: BeamGroup, step: StepData, k: int, strains: Array) -> Array:
        assert isinstance(step, _StepData)
        change = strains - step.strains0[k]
        return np.asarray((0.5 * step.chi) * (change @ group.elements.stiffness))

    def decay(self, step: StepData) -> float:
        """See the base class."""
        assert isinstance(step, _StepData)
        return step.chi

    def evaluate(self, system: System, step: StepData, y1: Array) -> Evaluation:
        """See the base class."""
        assert isinstance(step, _StepData)
        e = super().evaluate(system, step, y1)
        flow = None
        if self.velocity:
            dq = y1[: system.rows] - step.y0[: system.rows]
            flow = Flow(separate_parts(system), dq, step.p0, step.h, step.chi)
            momentum = 2 * flow.momentum
            e.R, e.momentum = e.R + (momentum - e.momentum), momentum
        extra = [
            self._extra(g, step, k, eps)
            for k, (g, eps) in enumerate(zip(system.beam_groups, e.strains, strict=True))
        ]
        return _Evaluation(**vars(e), flow=flow, extra=extra, v0=step.v0)

    def moduli(self, system: System, step: StepData, evaluation: Evaluation) -> list[Array]:
        """See the base class."""
        assert isinstance(step, _StepData)
        both = zip(system.beam_groups, super().moduli(system, step, evaluation), strict=True)
        return [D + step.chi * g.elements.weighted_stiffness for g, D in both]

    def tangent(self, system: System, step: StepData, evaluation: Evaluation) -> list[Blocks]:
        """See the base class; without :meth:`update`."""
        assert isinstance(evaluation, _Evaluation)
        blocks = super().tangent(system, step, evaluation)
        flow = evaluation.flow
        if flow is None:
            return blocks
        # 2 A/h takes the place of 2/h
        more = (2 / step.h) * (flow.A - np.eye(3))
        part = flow.parts.part
        for k, group in enumerate(system.groups):
            block = blocks[k]
            full = block.blocks() if isinstance(block, Parts) else block
            own = more[part[group.rows[:, 0]]]
            product = group.scalar_mass[:, :, None, :, None] * own[:, None, :, None, :]
            blocks[k] = full + product.reshape(full.shape)
        return blocks

    def update(
        self, system: System, step: StepData, evaluation: Evaluation
    ) -> tuple[Array, Array] | None:
        """See the base class: what all velocities have in common."""
        assert isinstance(evaluation, _Evaluation)
        return None if evaluation.flow is None else evaluation.flow.update()

    def memory(self, evaluation: Evaluation) -> Floats | None:
        """See the base class: v."""
        assert isinstance(evaluation, _Evaluation)
        e = evaluation
        if e.v1 is not None or e.flow is None:
            return super().memory(e)
        assert e.v0 is not None
        return (2 * self._mean(e) - e.v0).reshape(1, -1)

    def _mean(self, e: _Evaluation) -> Floats:
        """Mean velocity (rows, 3)."""
        assert e.flow is not None
        assert e.v0 is not None
        return e.flow.velocity(e.v0)

    def _end_velocity(self, step: EnergyMomentumStep, e: MovedEvaluation, way: Floats) -> Floats:
        """See the base class."""
        assert isinstance(e, _Evaluation)
        return super()._end_velocity(step, e, way if e.flow is None else self._mean(e))

    def work(self, system: System, step: StepData, evaluation: Evaluation, y1: Floats) -> StepWork:
        """See the base class; with what both terms take."""
        assert isinstance(step, _StepData)
        assert isinstance(evaluation, _Evaluation)
        e, done = evaluation, super().work(system, step, evaluation, y1)
        lost = done.dissipated
        for k, (g, S) in enumerate(zip(system.beam_groups, e.extra, strict=True)):
            lost += float((g.elements.measure * S * (e.strains[k] - step.strains0[k])).sum())
        if e.flow is not None:
            f = e.flow.dq / step.h - self._mean(e)
            lost += 2 * float((f * (e.flow.momentum - step.p0)).sum())
        return StepWork(done.loads, done.actuators, lost, done.ground)
