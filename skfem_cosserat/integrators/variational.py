"""Variational (symplectic-momentum) integrator: midpoint discrete Lagrangian."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..model import System
from ..types import Floats, switch
from .base import Integrator
from .scheme import Scheme, State


class Variational(Integrator):
    """``L_d(q_n, q_{n+1}) = h L((q_n + q_{n+1})/2, (q_{n+1} - q_n)/h)``, constraints at the nodes.

    Discrete Euler-Lagrange equations (22) in position-momentum form:
    ``M dq/h + (h/2) (f_int - f)(q_mid) - p_n + h G(q_n)^T lambda_n = 0``. Symplectic, conserves
    momentum maps exactly; energy oscillates without drift while high frequencies are resolved, and
    blows up with stiff beams: constraint forces act at the nodes, as in the leapfrog scheme, so
    rotations that alternate from step to step grow where a beam is compressed by more than a strain
    of about ``0.4/(h omega)^2``, omega its highest frequency (``diagnostics.highest_frequency``).
    A step in which a free body turns by more than 1 rad has no solution: ``h Omega <= 1``.
    Rotations of half a radian in a step are off by 5 % already.

    The source paper's other remedy, the mean effect of fast vibrations as a force on the slow
    motion, is not offered. It takes frequencies omega_k(q) far above all others, whose actions
    ``E_k/omega_k`` are then adiabatic invariants: the force is
    ``-sum_k (E_k/omega_k) d(omega_k)/dq``. A beam's frequencies have no such gap (those of bending
    go from below 1/h to far above it), they come close to each other where it deforms, and then
    actions are exchanged; and the blow-up above is no matter of neglected vibrations but of node
    rotations that the midpoint stresses do not see. What is not resolved is taken out by schemes
    that are meant to lose energy (``scheme.loses``), such as :class:`GeneralizedAlpha`.

    Parameters
    ----------
    stabilized : bool
        The momenta at the nodes fulfil the hidden constraints (46), too: at the end of each step a
        second constraint force ``G(q_{n+1})^T mu`` moves the momentum to the nearest one, in the
        kinetic energy, that does (RATTLE). The motion is the same to rounding, and so are the
        multipliers, ``mu`` being part of them: what the momentum has along ``G^T`` changes the
        multipliers of the next step only (Leimkuhler & Skeel 1994). ``history["p"]`` is the
        ``history["Qp"]`` of the scheme without. Not for steps under control, nor is the scheme
        without: see :class:`StepControl`.

    Examples
    --------
    >>> Variational().order
    2
    """

    name = "variational"
    order = 2
    composed_to = 6
    fixed_step = (
        "symplectic for steps of one size only: with steps that follow the motion its energy drifts"
    )
    frequency_limit = 10.0  # explained and measured in examples/paper/failure_mechanism.py
    advice = "EnergyMomentum()"
    conserves = "symplectic form, linear and angular momentum"
    reference = "Leyendecker, Marsden & Ortiz, ZAMM 88 (2008) 677, equations (22) and (25)"

    def __init__(self, stabilized: bool = False):
        self.stabilized = switch("argument stabilized", stabilized)
        if stabilized:
            self.name = "stabilized variational"
            self.reference = (
                f"{self.reference}; Andersen, J. Comput. Phys. 52 (1983) 24; Leimkuhler & Skeel,"
                " J. Comput. Phys. 112 (1994) 117"
            )

    def __repr__(self) -> str:
        return f"Variational({'stabilized=True' if self.stabilized else ''})"

    def scheme(self, h: float) -> Scheme:
        """Numbers of the scheme for a step size (s); stabilized, it carries an impulse on."""
        own = Scheme(1 / h, 1.0, h / 2, weight=0.0, rate=1 / h, carry=(1.0, 0.0, -1.0))
        return replace(own, table=((0.0, 0.0),), moved=(1.0,)) if self.stabilized else own

    def start(self, system: System, state: State, h: float) -> Floats | None:
        """Impulse by which the momentum was moved, if the scheme is stabilized, else None."""
        if not self.stabilized:
            return None
        return (np.zeros(system.n) if state.rates is None else state.rates).reshape(1, -1, 3)
