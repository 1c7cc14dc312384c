"""Viscosity of beams in compiled steps: elements beside the elastic ones."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..compiled.numbers import END, MASS, START
from ..compiled.plan import Plan
from ..model import System
from ..types import Floats

__all__ = ["Viscous", "is_viscous"]


def is_viscous(system: System) -> bool:
    """Whether a section of a scene has Kelvin-Voigt damping."""
    return any(group.viscous for group in system.beam_groups)


class Viscous:
    """Stresses ``eta (eps_1 - eps_0)/h`` as those of elements of the stiffness ``2 eta/h``.

    These take the difference of both ends of a step, not a mean of them, and have no mass; whatever
    the scheme, they act at the midpoint.

    Parameters
    ----------
    system : System
        With viscous sections, and beams of one order.
    plan : Plan
    h : float
        Step size (s).
    """

    def __init__(self, system: System, plan: Plan, h: float) -> None:
        from ..compiled import bind

        group = system.beam_groups[0]
        eta = group.elements.viscosity
        assert eta is not None
        self._beams, fields = bind.bound_beams(system, group, plan, (2 / h) * eta)
        self._stress: Floats = fields["S"]
        #: strain rates by stresses, of semidefinite eta, too
        self._inverse = np.linalg.pinv(eta, rcond=1e-12, hermitian=True)
        self._measure, self._h = group.elements.measure, h

    def beside(self, beams: Any, numbers: Floats) -> Any:
        """What steps take as beams: the elastic ones, these, and their numbers."""
        own = numbers.copy()
        own[[MASS, START, END]] = 0.0, -0.5, 0.5
        return beams, self._beams, own

    def dissipated(self) -> float:
        """Lost in the step evaluated last (J)."""
        rate = self._stress @ self._inverse
        return self._h * max(0.0, float((self._measure * rate * self._stress).sum()))
