"""Explicit variational scheme: kicks by elements, drifts of nodes as free rigid bodies."""

from __future__ import annotations

from functools import partial

import numpy as np

from ..constraints import Treatment
from ..errors import InputError
from ..log import logger
from ..model import System
from ..model.groups import Blocks
from ..types import Array, Floats, IndexArray, switch
from .base import Evaluation, Integrator, StepData
from .limit import StepLimit, step_limit
from .march import Marching, check_scene

__all__ = ["Explicit", "ExplicitScheme"]

#: steps above a limit that has fallen by as much are not made shorter: the bound is not that sharp
NEAR = 0.01


class ExplicitScheme(Integrator):
    """What the explicit schemes have in common: no balance, no tangent, p = M v."""

    order = 2
    fixed_step = (
        "symplectic for steps of one size only (with steps that follow the motion its energy"
        " drifts), and bound to the limit of its elements"
    )
    solves = False
    constraint_weight = 0.0
    force_share = 1.0
    advice = "a step below the limit"
    conserves = "symplectic form, momentum maps; energy oscillates within a bound"

    @staticmethod
    def limit(system: System) -> StepLimit:
        """Step (s) up to which all elements are stable, and what sets it.

        Raises
        ------
        InputError
            If it is no system.
        IncompatibleError
            If the mass of a beam is not lumped.
        """
        return step_limit(system)

    def evaluate(self, system: System, step: StepData, y1: Array) -> Evaluation:
        """There is no balance to solve."""
        raise NotImplementedError(f"{self.name}: steps are not solved for")

    def tangent(self, system: System, step: StepData, evaluation: Evaluation) -> list[Blocks]:
        """There is no balance to solve."""
        raise NotImplementedError(f"{self.name}: steps are not solved for")

    def carry(self, system: System, step: StepData, evaluation: Evaluation) -> Floats:
        """There is no balance to solve."""
        raise NotImplementedError(f"{self.name}: steps are not solved for")

    def node_momentum(self, p0: Floats, impulse: Floats, fresh: bool) -> Floats:
        """``M v_n``, on the hidden constraints."""
        return p0


class Explicit(ExplicitScheme):
    """Explicit, symplectic, of second order: for soft or finely meshed beams.

    Beams have their mass at the nodes (``Beam(..., lumped=True)``). A step is half a kick by the
    elastic forces and the loads (their mean over the step), the drift of every node as a free rigid
    body, and half a kick. Nodes and bodies that joints connect drift together, with impulses along
    the constraints at the start such that these hold at the end; velocities are projected at the
    end of the step. Triads stay orthonormal, momentum maps and joints exact, to rounding.

    The step is limited by the highest frequency of the elements; ``Explicit.limit(system)`` says
    where and what vibrates there. At each step of the run it is looked at again, and rounds get
    more parts if it has fallen, with a warning.

    Parameters
    ----------
    rounds : int
        A step of the run consists of as many equal steps, at whose end nothing is recorded.
    checked : bool
        Refuse steps above the limit, and shorten them where it falls; False: to see what happens
        there.

    Raises
    ------
    InputError
        If `rounds` is not a positive integer; for a step above the limit, before the run.
    IncompatibleError
        Before the run, for what the scheme cannot do: beams with consistent mass, springs, dampers,
        drives, prescribed motion, closed loops of joints, damping, treatments other than
        ``Multipliers()``, also unscaled ones, nodes without inertia about some axis, solvers of
        linear systems, of which there are none.

    Notes
    -----
    Constraint forces are those of the continuous equations at the recorded states. Kick and drift:
    Verlet's method; joints: Leimkuhler & Reich, Simulating Hamiltonian dynamics (2004), ch. 7, 8.

    Examples
    --------
    >>> from skfem_cosserat import (
    ...     Beam, LoadGravity, Material, MeshCurve, Model, Multipliers, SectionCircle, simulate
    ... )
    >>> mesh = MeshCurve.init_line((0, 0, 0), (1, 0, 0), 8, name="rod")
    >>> rubber = SectionCircle(0.02, Material(5e6, 0.5, 1100))
    >>> model = Model()
    >>> rod = model.add("rod", Beam(mesh, rubber, lumped=True, angular_velocity=(1.0, 0, 0)))
    >>> system = model.freeze()
    >>> print(Explicit.limit(system))
    0.000535 s (element 0 of beam 'rod': shear with rotary inertia)
    >>> history = simulate(system, Explicit(rounds=50), Multipliers(), step=0.02, until=0.1)
    >>> bool(abs(history["angular_momentum"] - history["angular_momentum"][0]).max() < 1e-15)
    True
    """

    name = "explicit"
    reference = "Verlet, Phys. Rev. 159 (1967) 98; Leimkuhler & Reich (2004)"

    def __init__(self, rounds: int = 1, checked: bool = True) -> None:
        whole = isinstance(rounds, int | np.integer) and not isinstance(rounds, bool)
        if not whole or rounds < 1:
            raise InputError("argument rounds", f"{rounds!r}, expected a positive integer")
        self.rounds, self.checked = int(rounds), switch("argument checked", checked)

    def __repr__(self) -> str:
        return f"Explicit(rounds={self.rounds}{'' if self.checked else ', checked=False'})"

    def march(
        self, system: System, treatment: Treatment, h: float, kernels: str, steps: int | None
    ) -> Marching:
        """See the base class."""
        check_scene(repr(self), system, treatment)
        limit = self.limit(system)
        if self.checked and h / self.rounds > limit.seconds:
            least = int(np.ceil(h / limit.seconds))
            raise InputError(
                "argument step",
                f"{h:g} s in {self.rounds} rounds is above the limit of the explicit scheme,"
                f" {limit}: at least rounds={least}, or a smaller step",
            )
        logger.info("explicit steps of %.3g s, limit %s", h / self.rounds, limit)
        counts = [np.ones(len(g.vertices), dtype=np.int64) for g in system.beam_groups]
        method = f"explicit, limit {limit}"
        plan = partial(_equal_parts, h / self.rounds) if self.checked else None
        return Marching(self.name, system, h, self.rounds, counts, method, kernels, steps, plan)


def _equal_parts(step: float, limits: list[Floats]) -> list[IndexArray]:
    """Counts of all elements, the fewest with which none is above its limit."""
    least = min(float(each.min(initial=np.inf)) for each in limits)
    count = max(1, int(np.ceil(step / least * (1 - NEAR))))
    return [np.full(len(each), count, dtype=np.int64) for each in limits]
