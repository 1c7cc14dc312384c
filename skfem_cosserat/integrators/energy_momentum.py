"""Energy-momentum conserving integrator with discrete derivatives."""

from __future__ import annotations

from dataclasses import replace

from ..model import System
from ..types import Floats, switch
from .base import Integrator
from .scheme import Scheme, State
from .step_balance import end_velocity


class EnergyMomentum(Integrator):
    """Midpoint scheme with the discrete derivative of the stored energy.

    ``q_{n+1} - q_n = h v_mid``, ``M (v_{n+1} - v_n) = -h DV - h G(q_mid)^T lambda + h f``, where
    ``DV = int B(q_mid)^T (S_n + S_{n+1})/2 ds`` for the quadratic stored energy, with its discrete
    derivative by the strains for any other; springs and other force elements by discrete
    derivatives of their coordinates. Conserves energy, linear and angular momentum exactly, up to
    the Newton tolerance. Stays bounded for stiff beams, but a solution of a step is not guaranteed.

    Parameters
    ----------
    stabilized : bool
        The velocities at the nodes fulfil the hidden constraints (46), too, as in the formulation
        of Gear, Gupta & Leimkuhler: at the end of each step the momentum is moved by a second
        constraint force ``G(q_{n+1})^T mu`` to the nearest one, in the kinetic energy, that does.
        (Else ``G v_n`` alternates by O(h^2), and the constraint forces of steps, each of a
        midpoint, by O(h). A history has means of neighbours, which are of second order.) It is
        part of the step's constraint force. Momenta are kept; the energy is not: without moving
        ground it falls by what the move takes, ``history["dissipated"]``, of fourth order in a
        step.

    Examples
    --------
    >>> EnergyMomentum().constraint_weight
    0.5
    """

    name = "energy-momentum"
    order = 2
    composed_to = 4  # see Composition
    conserves = "energy, linear and angular momentum"
    reference = (
        "Gonzalez, J. Nonlinear Sci. 6 (1996) 449; Betsch & Leyendecker, IJNME 67 (2006) 499"
    )

    def __init__(self, stabilized: bool = False) -> None:
        self.stabilized = switch("argument stabilized", stabilized)
        if stabilized:
            self.name = "stabilized energy-momentum"
            self.composed_to = 0
            self.conserves = "linear and angular momentum; energy never grows"
        else:
            self.keeping = ""

    def __repr__(self) -> str:
        return f"EnergyMomentum({'stabilized=True' if self.stabilized else ''})"

    def scheme(self, h: float) -> Scheme:
        """Numbers of the scheme for a step size (s); stabilized, it carries the velocity on."""
        own = Scheme(2 / h, 2.0, h, weight=0.5, rate=1 / h, carry=(1.0, -1.0, 0.0), ends=True)
        return replace(own, table=((2 / h, -1.0),), moved=(1.0,)) if self.stabilized else own

    def start(self, system: System, state: State, h: float) -> Floats | None:
        """Velocity that a step starts with if the scheme is stabilized, else None."""
        return end_velocity(system, state) if self.stabilized else None
