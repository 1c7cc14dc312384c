"""What an integrator is: the discrete balance of one step, without constraints and solvers."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

from ..model import System
from ..types import Array, Floats

__all__ = ["Evaluation", "Integrator", "State", "StepData"]


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
        Configuration.
    p : (n,) array
        The momentum the integrator carries on: with the variational scheme
        ``D_2 L_d + f^+`` *before* the constraint force of the node, with energy-momentum ``M v``.
    fresh : bool
        True for a start from given (q, p): p then contains the constraint force already.
    """

    time: float
    index: int
    q: Floats
    p: Floats
    fresh: bool = True


@dataclass(eq=False)
class StepData:
    """What is fixed during a step."""

    y0: Floats
    p0: Floats
    t0: float
    h: float
    amplitudes: Floats
    dead: Floats


@dataclass(eq=False)
class Evaluation:
    """A discrete balance at a trial configuration.

    Attributes
    ----------
    R : (rows, 3) array
        Balance without constraint forces, in units of momentum.
    size : float
        Largest entry of its terms: what the residual is compared with.
    """

    R: Array
    size: float


class Integrator(ABC):
    """One-step scheme in (q, p).

    Attributes
    ----------
    order : int
        Order of convergence in q and p.
    constraint_weight : float
        Constraint forces act at ``(1 - w) q_n + w q_{n+1}``.
    conserves : str
        In words.
    reference : str
        Where it comes from.
    """

    name: str
    order: int
    constraint_weight: float
    conserves: str
    reference: str

    @abstractmethod
    def evaluate(self, system: System, step: StepData, y1: Array) -> Evaluation:
        """Balance at the trial configuration y1 (all rows)."""

    @abstractmethod
    def tangent(self, system: System, step: StepData, evaluation: Evaluation) -> list[Array]:
        """``dR/dq_1`` as blocks of the system's groups."""

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
        return StepData(
            system.extend(state.q, t0),
            state.p.reshape(-1, 3),
            t0,
            h,
            amplitudes,
            loading.dead_force(amplitudes),
        )


def largest(*terms: Array) -> float:
    """Largest magnitude in any of the arrays."""
    return max(float(abs(term).max(initial=0.0)) for term in terms)


def load_force(system: System, step: StepData, y: Array) -> Array:
    """All loads (rows, 3), those that depend on the configuration at y."""
    if system.loading.dead_only:
        return step.dead
    return step.dead + system.loading.force(y[: system.rows], step.amplitudes)
