"""What an integrator is: the discrete balance of one step, without constraints and solvers."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field

from ..model import System
from ..model.couplings import CoupledForce, CoupledStart
from ..types import Array, Floats, IndexArray

__all__ = ["Evaluation", "Integrator", "State", "StepData", "StepWork"]


@dataclass(eq=False)
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

    Examples
    --------
    :func:`skfem_cosserat.initial_state` makes and checks it:

    >>> from skfem_cosserat import MassPoint, Model, initial_state
    >>> model = Model()
    >>> ball = model.add("ball", MassPoint(2.0, position=(0, 0, 1), velocity=(3, 0, 0)))
    >>> initial_state(model.freeze())
    State(time=0.0, index=0, q=array([0., 0., 1.]), p=array([6., 0., 0.]), fresh=True)
    """

    time: float
    index: int
    q: Floats
    p: Floats
    fresh: bool = True
    turns: IndexArray | None = field(default=None, repr=False)


@dataclass(frozen=True)
class StepWork:
    """Work done in a step (J): by what enters the energy balance beside kinetic and stored energy.

    Attributes
    ----------
    loads, actuators : float
        By loads, and by actuators on joint coordinates.
    dissipated : float
        Lost in dampers, not negative.
    ground : float
        By moving ground through springs, dampers and bushings that end there.
    """

    loads: float
    actuators: float = 0.0
    dissipated: float = 0.0
    ground: float = 0.0


@dataclass(eq=False)
class StepData:
    """What is fixed during a step."""

    y0: Floats
    p0: Floats
    t0: float
    h: float
    amplitudes: Floats
    dead: Floats
    couplings: CoupledStart | None


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
        S and B of that force, one for each beam group.
    B1s : list of arrays
        B at the configuration through which S changes.
    external : (rows, 3) array
        Loads.
    coupled : CoupledForce or None
        Force elements, if there are any.
    """

    R: Array
    size: float
    momentum: Array
    mid: Array
    stresses: list[Array]
    Bs: list[Array]
    B1s: list[Array]
    external: Array
    coupled: CoupledForce | None


class Integrator(ABC):
    """One-step scheme in (q, p).

    Attributes
    ----------
    order : int
        Order of convergence in q and p.
    constraint_weight : float
        Constraint forces act at ``(1 - w) q_n + w q_{n+1}``.
    start_share : float
        Part of the first step's constraint force that a start from given momentum leaves to the
        step (the rest is in the momentum already).
    carries_node_momentum : bool
        Whether the momentum carried on is p_n of the node; else the next step completes it.
    frequency_limit : float or None
        Step size times highest natural frequency above which a run is likely to fail; None: the
        scheme itself sets no such limit.
    advice : str
        What to try beside a smaller step when a step cannot be solved.
    conserves : str
        In words.
    reference : str
        Where it comes from.
    """

    name: str
    order: int
    constraint_weight: float
    start_share: float = 1.0
    carries_node_momentum: bool = True
    frequency_limit: float | None = None
    advice: str = "a finer mesh, a softer section"
    conserves: str
    reference: str

    @abstractmethod
    def evaluate(self, system: System, step: StepData, y1: Array) -> Evaluation:
        """Balance at the trial configuration y1 (all rows)."""

    @abstractmethod
    def tangent(self, system: System, step: StepData, evaluation: Evaluation) -> list[Array]:
        """``dR/dq_1`` as blocks of the system's groups, then of its couplings if it has any."""

    @abstractmethod
    def carry(self, system: System, step: StepData, evaluation: Evaluation) -> Floats:
        """The momentum (rows, 3) carried on to the next step."""

    @abstractmethod
    def node_momentum(self, step: StepData, impulse: Floats, fresh: bool) -> Floats:
        """p_n (rows, 3) of the discrete Legendre transform at the *start* of a solved step.

        `impulse` is ``h G^T lambda`` of the step, `fresh` as in :class:`State`.
        """

    def begin(self, system: System, state: State, h: float) -> StepData:
        """Data of a step."""
        t0 = state.time
        loading = system.loading
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

    def work(self, system: System, step: StepData, evaluation: Evaluation, y1: Floats) -> StepWork:
        """Work of the forces of a solved step along the way from y0 to y1 (all rows)."""
        rows = system.rows
        loads = float((evaluation.external * (y1[:rows] - step.y0[:rows])).sum())
        if step.couplings is None or evaluation.coupled is None:
            return StepWork(loads)
        done = system.couplings.work(step.couplings, evaluation.coupled, y1)
        return StepWork(loads, done.actuators, done.dissipated, done.ground)


def largest(*terms: Array) -> float:
    """Largest magnitude in any of the arrays."""
    return max(float(abs(term).max(initial=0.0)) for term in terms)


def midpoint_tangent(
    system: System, step: StepData, evaluation: Evaluation, mass: float, force: float
) -> list[Array]:
    """``mass * M + force * d(f_int - f)/dq_1`` as blocks of the groups, then of the couplings.

    At the midpoint half of a change of q_1 reaches B and the loads, and half of it the stress.
    """
    e = evaluation
    blocks = system.mass_tangent(mass)
    half = 0.5 * force
    for k, g in enumerate(system.beam_groups):
        blocks[k] += g.tangent(e.Bs[k], e.B1s[k], e.stresses[k], half, half)
    if not system.loading.dead_only:
        system.loading.add_tangent(blocks, e.mid[: system.rows], step.amplitudes, -half)
    if e.coupled is not None:
        blocks.append(system.couplings.tangent(e.coupled, force))
    return blocks


def load_force(system: System, step: StepData, y: Array) -> Array:
    """All loads (rows, 3), those that depend on the configuration at y."""
    if system.loading.dead_only:
        return step.dead
    return step.dead + system.loading.force(y[: system.rows], step.amplitudes)
