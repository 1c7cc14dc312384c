"""A step as the Newton loop sees it."""

from __future__ import annotations

import numpy as np

from ..constraints import BoundTreatment
from ..model import System
from ..types import Array, Floats
from .base import Evaluation, Integrator, StepData

__all__ = ["StepProblem"]


class StepProblem:
    """A step of an integrator with a treatment that is at its start.

    Parameters
    ----------
    system : System
    integrator : Integrator
    treatment : BoundTreatment
    step : StepData
    mixed : float
        See :class:`skfem_cosserat.NewtonSettings`.
    """

    def __init__(
        self,
        system: System,
        integrator: Integrator,
        treatment: BoundTreatment,
        step: StepData,
        mixed: float,
    ) -> None:
        self.system, self.integrator = system, integrator
        self.treatment, self.step = treatment, step
        self.evaluation: Evaluation | None = None
        self._mixed = mixed
        self._stresses: list[Array] | None = None
        self._sized: tuple[Floats | None, tuple[float, float]] = None, (0.0, 0.0)

    def residual(self) -> float:
        """Evaluate, see :class:`skfem_cosserat.newton.NewtonProblem`."""
        y1 = self.treatment.configuration()
        self.evaluation = self.integrator.evaluate(self.system, self.step, y1)
        self.y1 = y1
        self._r = self.treatment.residual(self.evaluation.R, y1)
        return self.treatment.relative(self._r, self.evaluation.size)

    def direction(self) -> Floats:
        """Increment, see there."""
        assert self.evaluation is not None
        e, _ = self._from = self.evaluation, self.y1
        if self._stresses is not None:
            e = self.integrator.with_stresses(self.system, self.step, e, self._stresses)
            self.treatment.residual(e.R, self.y1)
        blocks = self.integrator.tangent(self.system, self.step, e)
        data = self.treatment.data(blocks, e.R, self.y1)
        direction = -self.treatment.solver.solve(data, self.treatment.scale_rows(self._r))
        more = self.integrator.update(self.system, self.step, e)
        return direction if more is None else self._updated(direction, *more)

    def _updated(self, direction: Floats, U: Array, V: Array) -> Floats:
        """Direction of the matrix with ``sum_k U_k V_k^T`` added (Sherman, Morrison, Woodbury)."""
        treatment, y = self.treatment, self.y1
        columns = [treatment.solver.solve_again(treatment.scale_rows(treatment.pull(u))) for u in U]
        moved = [treatment.push(x, y) for x in (*columns, direction)]
        products = np.tensordot(V, np.array(moved), axes=([1, 2], [1, 2]))
        factors = np.linalg.solve(np.eye(len(U)) + products[:, :-1], products[:, -1])
        return np.asarray(direction - np.array(columns).T @ factors)

    def sizes(self, increment: Floats) -> tuple[float, float]:
        """Of an increment, see there."""
        if self._sized[0] is not increment:  # asked for again where it is applied
            self._sized = increment, self.treatment.sizes(increment)
        return self._sized[1]

    def apply(self, increment: Floats) -> None:
        """Move, see there."""
        self._stresses = None
        if self.sizes(increment)[0] > self._mixed and self.system.beam_groups:
            change = self.treatment.push(increment, self._from[1])
            self._stresses = self.integrator.mixed(self.system, self.step, self._from[0], change)
        self.treatment.apply(increment)

    def save(self) -> object:
        """What :meth:`restore` takes."""
        return self.treatment.save()

    def restore(self, saved: object) -> None:
        """Back to a saved configuration."""
        self.treatment.restore(saved)
