"""What an integrator is: the discrete balance of one step, without constraints and solvers."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..constraints import Treatment
from ..frozen import Frozen
from ..model import System
from ..model.force_elements import CoupledForce, CoupledStart
from ..model.groups import Blocks, Parts
from ..types import Array, Floats, IndexArray

__all__ = [
    "Evaluation",
    "Integrator",
    "March",
    "Marched",
    "Scheme",
    "State",
    "StepData",
    "StepOrigin",
    "StepWork",
    "damped_force",
    "load_force",
    "midpoint_tangent",
]


@dataclass(frozen=True)
class StepOrigin:
    """Scheme and step size of the step that led to a state.

    The momentum and the memory of a state mean something to that scheme only, the memory perhaps
    to that step size only; see :meth:`Stepper.own`.

    Attributes
    ----------
    integrator : str
        Name of the scheme.
    step : float
        Step size (s), negative for a step back; of a composed step as a whole.
    """

    integrator: str
    step: float

    def same_scheme(self, other: StepOrigin) -> bool:
        """Whether both are steps of one scheme."""
        return self.integrator == other.integrator

    def same_step(self, other: StepOrigin) -> bool:
        """Whether the steps are of one size, to rounding."""
        return abs(self.step - other.step) <= 1e-9 * abs(other.step)


@dataclass(eq=False, repr=False)
class State:
    """A state of a system between two steps.

    Attributes
    ----------
    time : float
        (s)
    index : int
        Number of steps done.
    q : (n,) array
        Configuration: phi (m) and d1, d2, d3 (-) of each frame, phi of each mass point.
    p : (n,) array
        The momentum the integrator carries on: with the variational scheme ``D_2 L_d + f^+`` of
        (35) *before* the constraint force of the node, with energy-momentum ``M v``. In kg m/s,
        that of directors in kg m^2/s.
    fresh : bool
        True for a start from given (q, p): p then contains the constraint force already.
    turns : (k,) int array or None
        Full turns of the angles that springs, dampers and actuators act on, in the order of
        ``system.couplings.angles``; None: none.
    memory : (k, n) array or None
        What the integrator carries on beside (q, p), such as accelerations; None: nothing, or a
        start from (q, p).
    made_by : StepOrigin or None
        Scheme and step that p and memory are of; others start anew from them, as
        :func:`skfem_cosserat.restart` does. None: any may go on from here.
    load_factor : float or None
        Where on a path it is an equilibrium, for :func:`skfem_cosserat.static`; None: its time is
        taken for that.
    plain : bool
        Whether compiled kernels have failed at the next step: it is solved by plain numpy.

    Examples
    --------
    :func:`skfem_cosserat.initial_state` makes and checks it:

    >>> from skfem_cosserat import MassPoint, Model, initial_state
    >>> model = Model()
    >>> ball = model.add("ball", MassPoint(2.0, position=(0, 0, 1), velocity=(3, 0, 0)))
    >>> state = initial_state(model.freeze())
    >>> state
    State(time=0.0, index=0, n=3, fresh=True)
    >>> state.q.tolist(), state.p.tolist()
    ([0.0, 0.0, 1.0], [6.0, 0.0, 0.0])
    """

    time: float
    index: int
    q: Floats
    p: Floats
    fresh: bool = True
    turns: IndexArray | None = None
    memory: Floats | None = None
    made_by: StepOrigin | None = None
    load_factor: float | None = None
    plain: bool = False

    def __repr__(self) -> str:
        """Without the arrays."""
        n = np.size(self.q)
        return f"State(time={self.time!r}, index={self.index}, n={n}, fresh={self.fresh})"


class StepWork(NamedTuple):
    """Work done in a step (J): by what enters the energy balance beside kinetic and stored energy.

    Attributes
    ----------
    loads, actuators : float
        By loads, and by actuators on joint coordinates.
    dissipated : float
        Lost in dampers, viscous sections and drag, not negative.
    ground : float
        By moving ground through springs, dampers and bushings that end there.
    numerical : float
        The part of `dissipated` that the scheme itself takes.
    """

    loads: float
    actuators: float = 0.0
    dissipated: float = 0.0
    ground: float = 0.0
    numerical: float = 0.0


@dataclass(frozen=True)
class Scheme:
    """An implicit midpoint scheme in numbers, as the compiled kernels take it.

    ``R = mass M dq - momentum p_n + force (int B(q_mid)^T S ds - f)``, where S comes from the
    strains at the midpoint or is the mean of those at both ends. The momentum carried on is
    ``carry[0] mass M dq + carry[1] p_n + carry[2] force (int B^T S ds - f)``.

    Attributes
    ----------
    mass, momentum, force : float
        Factors of the balance.
    ends : bool
        Stresses: the mean of both ends.
    carry : (float, float, float)
        Factors of the momentum carried on.
    share : float
        The balance is taken at ``y_0 + share (y_1 - y_0)``.
    """

    mass: float
    momentum: float
    force: float
    ends: bool
    carry: tuple[float, float, float]
    share: float = 0.5


@dataclass(eq=False)
class StepData:
    """What is fixed during a step: given to the methods of an integrator.

    Attributes
    ----------
    y0 : (total, 3) array
        Configuration at the start: the rows of all coordinates, then those of the ground.
    p0 : (rows, 3) array
        Momentum carried to the step.
    t0, h : float
        Time at the start, and step size (s).
    amplitudes : array
        Means of the loads' functions of time over the step.
    dead : (rows, 3) array
        Sum of the loads that do not depend on the configuration.
    couplings : CoupledStart or None
        Springs, dampers and other force elements at the start; None: there are none.
    """

    y0: Floats
    p0: Floats
    t0: float
    h: float
    amplitudes: Floats
    dead: Floats
    couplings: CoupledStart | None


@dataclass(eq=False)
class Damping:
    """Mean velocity (rows, 3) of a step at a trial configuration, and its strain rates.

    The rates (ne, ng, 6) of each beam group are ``B(q_mid) (q_1 - q_0)/h = (eps_1 - eps_0)/h``,
    exactly; None for a group without viscosity.
    """

    velocity: Array
    rates: list[Array | None]


@dataclass(eq=False)
class Evaluation:
    """A discrete balance at a trial configuration, as the implicit midpoint schemes need it.

    Attributes
    ----------
    R : (rows, 3) array
        Balance without constraint forces, in units of momentum.
    size : float
        Largest entry of its terms: what the residual is compared with.
    momentum : (rows, 3) array
        Inertia term.
    mid : (total, 3) array
        Midpoint configuration, where the internal force ``int B^T S ds`` acts.
    stresses, Bs : list of arrays
        S (with its viscous part) and B of that force, one for each beam group.
    B1s, strains : list of arrays
        B and strains at the configuration through which the elastic S changes.
    external : (rows, 3) array
        Loads.
    coupled : CoupledForce or None
        Force elements, if there are any.
    damping : Damping or None
        Of viscous sections and drag, if there are any.
    """

    R: Array
    size: float
    momentum: Array
    mid: Array
    stresses: list[Array]
    Bs: list[Array]
    B1s: list[Array]
    strains: list[Array]
    external: Array
    coupled: CoupledForce | None
    damping: Damping | None


class Marched(NamedTuple):
    """A step that a :class:`March` has done; attributes as those of a report of a step."""

    state: State
    iterations: int
    residual: float
    work: StepWork


class March(ABC):
    """Advances states itself, without balance, tangent and Newton's method.

    Attributes
    ----------
    method : str
        What is done instead of solving linear systems.
    """

    method: str

    @abstractmethod
    def advance(self, state: State, time: float) -> Marched:
        """The step after `state`, to a time (s)."""


class Integrator(Frozen):
    """One-step scheme in (q, p); base of one's own.

    An own scheme writes the balance of a step without constraint forces: :meth:`evaluate` gives it
    as an :class:`Evaluation`, :meth:`tangent` its derivative, :meth:`carry` the momentum at the end
    of the step, :meth:`node_momentum` that at the node. It goes with any treatment of the
    constraints. :func:`damped_force`, :func:`load_force` and :func:`midpoint_tangent` do what
    schemes that take forces at the midpoint have in common. Such a scheme has compiled kernels if
    :meth:`scheme` gives it in numbers.

    Attributes
    ----------
    order : int
        Order of convergence in q and p.
    constraint_weight : float
        Constraint forces act at ``(1 - w) q_n + w q_{n+1}``.
    force_share : float
        Factor of ``h f_int`` in the balance.
    start_share : float
        Part of the first step's constraint force that a start from given momentum leaves to the
        step (the rest is in the momentum already).
    carries_node_momentum : bool
        Whether the momentum carried on is p_n of the node; else the next step completes it.
    frequency_limit : float or None
        Step size times highest natural frequency above which a run is likely to fail; None: the
        scheme itself sets no such limit.
    loses : bool
        Whether it is meant to take energy out of a motion.
    advice : str
        What to try beside a smaller step when a step cannot be solved.
    keeping : str
        What to try beside a smaller step when the energy is not in balance.
    conserves, reference : str
        In words, and where it comes from.
    solves : bool
        Whether there are linear systems to solve.
    remembered : int
        Rows of n numbers that a state carries on in its ``memory``.
    composed_to : int
        Highest order that symmetric compositions of its steps have; 0: it is not to be composed,
        since a step back does not undo a step, say.
    fixed_step : str or None
        Why its steps have to be all of one size; None: they need not.
    part, shares : Integrator and tuple of float
        The scheme whose steps one step is made of, and their sizes as shares of it; none: the step
        is one of its own.
    """

    #: its own for each scheme: states know by it what led to them
    name: str
    order: int
    remembered: int = 0
    composed_to: int = 0
    fixed_step: str | None = None
    solves: bool = True
    part: Integrator | None = None
    shares: tuple[float, ...] = ()
    constraint_weight: float
    force_share: float
    start_share: float = 1.0
    carries_node_momentum: bool = True
    frequency_limit: float | None = None
    loses: bool = False
    advice: str = "a finer mesh"
    keeping: str = ", or EnergyMomentum(), which keeps the energy"
    conserves: str
    reference: str

    def __repr__(self) -> str:
        return f"{type(self).__name__}()"

    @abstractmethod
    def evaluate(self, system: System, step: StepData, y1: Array) -> Evaluation:
        """Balance at the trial configuration y1 (all rows)."""

    @abstractmethod
    def tangent(self, system: System, step: StepData, evaluation: Evaluation) -> list[Blocks]:
        """``dR/dq_1`` as blocks of the system's groups, then of its couplings if it has any."""

    def moduli(self, system: System, step: StepData, evaluation: Evaluation) -> list[Array]:
        """Twice the derivative of S by the strains that it changes through, with weights.

        (ne, ng, 6, 6) for each beam group; here for stresses ``S(eps)`` at the midpoint.
        """
        groups = zip(system.beam_groups, evaluation.strains, strict=True)
        return [g.moduli(eps) for g, eps in groups]

    @abstractmethod
    def carry(self, system: System, step: StepData, evaluation: Evaluation) -> Floats:
        """The momentum (rows, 3) carried on to the next step."""

    def finished(self, system: System, step: StepData, evaluation: Evaluation) -> Evaluation:
        """What becomes of the solution of a step, such as velocities moved onto constraints.

        What it adds to R is taken off the constraint force.
        """
        return evaluation

    def memory(self, evaluation: Evaluation) -> Floats | None:
        """What is carried on beside positions and momentum (k, n)."""
        return None

    def resized(self, state: State, h: float) -> State:
        """The state for a step of another size than the one that led to it."""
        return state

    def start_force(self, system: System, state: State, h: float) -> Floats | None:
        """Constraint force (n,) at a state a run starts from; None: that of the step after it."""
        return None

    def update(
        self, system: System, step: StepData, evaluation: Evaluation
    ) -> tuple[Array, Array] | None:
        """What :meth:`tangent` leaves out, as ``sum_k U_k (V_k . dq_1)``: U, V (k, rows, 3).

        Of a scheme whose rows depend on those of all nodes, as those of EnergyDecaying do.
        """
        return None

    @abstractmethod
    def node_momentum(self, p0: Floats, impulse: Floats, fresh: bool) -> Floats:
        """p_n (rows, 3) of the discrete Legendre transform at the *start* of a solved step.

        `p0` is what was carried to the step, `impulse` its ``h G^T lambda``, `fresh` as in
        :class:`State`.
        """

    def march(self, system: System, treatment: Treatment, h: float) -> March | None:
        """What advances states without balance and Newton; None: the stepper does, with both.

        Raises
        ------
        IncompatibleError
            If the scene or the treatment has what the scheme cannot do.
        """
        return None

    @property
    def single(self) -> Integrator:
        """What solves its single steps: its part if it is composed, else itself."""
        return self if self.part is None else self.part

    def scheme(self, h: float) -> Scheme | None:
        """The scheme in numbers, for a step size; None: it is none of those, and not compiled."""
        return None

    def begin(
        self, system: System, state: State, h: float, before: Evaluation | None = None
    ) -> StepData:
        """Data of a step; `before`: what was found at the end of the one that led to `state`."""
        t0, loading = state.time, system.loading
        amplitudes = loading.averages(t0, t0 + h)
        y0 = system.extend(state.q, t0)
        coupled = system.couplings.count > 0
        return StepData(
            y0,
            state.p.reshape(-1, 3),
            t0,
            h,
            amplitudes,
            loading.dead_force(amplitudes),
            system.couplings.begin(y0, state.turns, t0, h) if coupled else None,
        )

    def mixed(
        self, system: System, step: StepData, evaluation: Evaluation, change: Array
    ) -> list[Array]:
        """Stresses that a change (rows, 3) of q_1 predicts, to first order."""
        out = []
        groups, y1 = system.beam_groups, 2 * evaluation.mid - step.y0
        moduli = self.moduli(system, step, evaluation)
        for g, S, B, D in zip(groups, evaluation.stresses, evaluation.B1s, moduli, strict=True):
            predicted = S + 0.5 * g.linear_stress(D, g.strain_rate(B, change))
            if g.viscous:
                rate = g.strain_rate(g.strain(y1)[1], change) / step.h
                predicted = predicted + g.viscous_stress(rate)
            out.append(predicted)
        return out

    def with_stresses(
        self, system: System, step: StepData, evaluation: Evaluation, stresses: list[Array]
    ) -> Evaluation:
        """The evaluation with other stresses, for the geometric part of a tangent."""
        pairs = zip(stresses, evaluation.stresses, strict=True)
        force = system.internal_force(evaluation.Bs, [new - old for new, old in pairs])
        R = evaluation.R + (self.force_share * step.h) * force
        return replace(evaluation, R=R, stresses=stresses)

    def work(self, system: System, step: StepData, evaluation: Evaluation, y1: Floats) -> StepWork:
        """Work of the forces of a solved step along the way from y0 to y1 (all rows)."""
        rows = system.rows
        loads = float((evaluation.external * (y1[:rows] - step.y0[:rows])).sum())
        damping = evaluation.damping
        lost = 0.0 if damping is None else step.h * dissipated_power(system, damping)
        if step.couplings is None or evaluation.coupled is None:
            return StepWork(loads, dissipated=lost)
        done = system.couplings.work(step.couplings, evaluation.coupled, y1)
        lost += done.dissipated
        loads += done.loads
        return StepWork(loads, done.actuators, lost, done.ground, done.numerical)


def damped_force(
    system: System, step: StepData, Bs: list[Array], elastic: list[Array], y1: Array
) -> tuple[Array, list[Array], Damping | None]:
    """Force of all beams, and drag, at a trial configuration: part of a scheme's ``evaluate``.

    Parameters
    ----------
    system : System
    step : StepData
    Bs, elastic : list of arrays
        B at the midpoint (of ``system.strain(mid)``), and the elastic stresses that act there, one
        for each of ``system.beam_groups``.
    y1 : (total, 3) array
        Trial configuration at the end of the step.

    Returns
    -------
    force : (rows, 3) array
        Internal force: it stands on the side of the inertia, loads on the other one.
    stresses : list of arrays
        The viscous ones included.
    damping : Damping or None
        For ``Evaluation.damping``; None: nothing is damped.
    """
    if not system.damped:
        return system.internal_force(Bs, elastic), elastic, None
    velocity = (y1[: system.rows] - step.y0[: system.rows]) / step.h
    stresses, rates = [], []
    for g, B, S in zip(system.beam_groups, Bs, elastic, strict=True):
        rate = g.strain_rate(B, velocity) if g.viscous else None
        rates.append(rate)
        stresses.append(S if rate is None else S + g.viscous_stress(rate))
    force = system.internal_force(Bs, stresses)
    if system.drag is not None:
        force = force + system.drag @ velocity
    return force, stresses, Damping(velocity, rates)


def dissipated_power(system: System, damping: Damping) -> float:
    """Mean power (W) lost in viscous sections and drag during a step, not negative."""
    pairs = zip(system.beam_groups, damping.rates, strict=True)
    power = sum(g.dissipation(rate) for g, rate in pairs if rate is not None)
    if system.drag is not None:
        v = damping.velocity
        power += max(0.0, float((v * (system.drag @ v)).sum()))  # of either sign at rounding level
    return power


def midpoint_tangent(
    system: System,
    step: StepData,
    evaluation: Evaluation,
    moduli: list[Array],
    mass: float,
    force: float,
) -> list[Blocks]:
    """``mass * M + force * d(f_int - f)/dq_1``: what a midpoint scheme's ``tangent`` gives.

    At the midpoint half of a change of q_1 reaches B and the loads, and half of it the elastic
    stress; the strain rate changes by ``B(q_1)/h``.

    Parameters
    ----------
    system : System
    step : StepData
    evaluation : Evaluation
    moduli : list of arrays
        Those of ``self.moduli(system, step, evaluation)``.
    mass, force : float
        Factors of the mass matrix and of the forces in the balance.

    Returns
    -------
    list of blocks
        Of the system's groups, then of its couplings if it has any.
    """
    e = evaluation
    half = 0.5 * force
    parts = []
    for k, g in enumerate(system.beam_groups):
        beam = g.parts(e.Bs[k], e.B1s[k], e.stresses[k], half, half, moduli[k])
        beam.scalar += g.inertia(mass)
        parts.append(beam)
    parts += [Parts(g.inertia(mass)) for g in system.groups[len(parts) :]]
    blocks: list[Blocks] = [*parts]
    if system.damped or not system.loading.dead_only:
        full = [p.blocks() for p in parts]
        _add_damping(system, step, e, full, force)
        system.loading.add_tangent(full, e.mid[: system.rows], step.amplitudes, -half)
        blocks = [*full]
    if e.coupled is not None:
        blocks.append(system.couplings.tangent(e.coupled, force))
    return blocks


def _add_damping(
    system: System, step: StepData, e: Evaluation, blocks: list[Array], force: float
) -> None:
    """Add what viscous sections and drag contribute to the groups' blocks."""
    for k, g in enumerate(system.beam_groups):
        if g.viscous:
            end = g.strain(2 * e.mid - step.y0)[1]
            blocks[k] += (force / step.h) * g.damping(e.Bs[k], end)
    if system.drag is not None:
        for block, group in zip(blocks, system.groups, strict=True):
            if group.drag is not None:
                block += (force / step.h) * group.drag


def load_force(system: System, step: StepData, y: Array) -> Array:
    """All loads (rows, 3) of a step, those that depend on the configuration at y (total, 3)."""
    if system.loading.dead_only:
        return step.dead
    return step.dead + system.loading.force(y[: system.rows], step.amplitudes)
