"""Generalized-alpha schemes: damping of high frequencies by one number, without conservation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..constraints.saddle import accelerations, nearest_velocity
from ..errors import InputError
from ..model import System
from ..types import Floats, real, switch
from .base import Integrator
from .scheme import Scheme, State


class GeneralizedAlpha(Integrator):
    """Second order, unconditionally stable in linear problems, dissipative at high frequencies.

    ``M a_1 + f(q_1, v_1) + G(q_1)^T lambda_1 = 0``, ``g(q_1) = 0`` with
    ``q_1 = q_0 + h v_0 + h^2 ((1/2 - beta) alpha_0 + beta alpha_1)``,
    ``v_1 = v_0 + h ((1 - gamma) alpha_0 + gamma alpha_1)``,
    ``(1 - alpha_m) alpha_1 + alpha_m alpha_0 = (1 - alpha_f) a_1 + alpha_f a_0``.
    All coefficients follow from the spectral radius at infinite frequency. The start is consistent:
    accelerations from the equations of motion, ``alpha_0 = a(t_0 + (alpha_m - alpha_f) h)``, and
    v_0 off the hidden constraints by what steps leave there anyway:
    ``h^2 (1/6 - beta - (alpha_m - alpha_f)/2)`` times the part of the third derivative of q along
    ``M^-1 G^T``. With it multipliers are of second order from the first step on; else they start
    with first order (Arnold, Bruels & Cardona 2015). The recorded momentum is the given one. Where
    a step resolves so little that ``h^2`` times the third derivative would be above the velocities,
    that is cut down to these.

    Parameters
    ----------
    rho_inf : float
        Spectral radius at infinite frequency, in [0, 1): the factor of what is not resolved, each
        step. 1 would be Newmark's rule, which is not stable with constraints.
    stabilized : bool
        At the end of each step the velocity is replaced by the nearest one, in the kinetic energy,
        that fulfils the hidden constraints (index 2): ``M v_1 + G(q_1)^T mu``, with a second set
        of multipliers as in the formulation of Gear, Gupta & Leimkuhler; accelerations and
        constraint forces follow suit. (Velocities in dampers are those before that.)

        False: velocities are left as they come (index 3), for comparison with other codes. This can
        destroy a fast rotation, up to the last per mille of its energy, with every step solved: a
        free body about its stable axis is at rest within 40 turns if these have up to 10, 20, 40,
        80 and 126 steps with a `rho_inf` of 0.5, 0.7, 0.8, 0.9 and 0.95, while 20, 30, 50, 100 and
        180 steps a turn lose what the damping of the scheme takes (30, 2, 0.1 and less per cent).

    Raises
    ------
    InputError
        If `rho_inf` is outside of [0, 1).

    Notes
    -----
    Loads are those at the ends of steps, not their means over them: a pulse that fits between two
    ends is missed. Linear momentum is conserved where nothing acts on a scene; energy and angular
    momentum are not.
    Constraint forces act at the ends of steps: each row of a history holds those of its own state,
    the first one those of the start. ``history["dissipated"]`` is what dampers take;
    ``-history["energy_balance"]`` what the scheme takes, with the error of the trapezoidal rule for
    the work of loads: it may be negative for a while. What a run has lost in all is in
    ``history.meta["energy_balance"]``; above a tenth there is a warning.

    Examples
    --------
    >>> GeneralizedAlpha(rho_inf=0.8).name
    'stabilized generalized-alpha, rho_inf = 0.8'
    """

    order = 2
    loses = True
    advice = "a smaller rho_inf"
    conserves = "nothing exactly"

    def __init__(self, rho_inf: float = 0.8, stabilized: bool = True):
        expected = "a number in [0, 1)"
        self.rho_inf = real("argument rho_inf", "rho_inf", rho_inf, expected)
        if not 0 <= self.rho_inf < 1:
            raise InputError("argument rho_inf", f"{rho_inf!r}, expected {expected}")
        self.stabilized = switch("argument stabilized", stabilized)
        r = self.rho_inf
        self.alpha_m = (2 * r - 1) / (r + 1)
        self.alpha_f = r / (r + 1)
        self.gamma = 0.5 + self.alpha_f - self.alpha_m
        self.beta = 0.25 * (self.gamma + 0.5) ** 2
        if not stabilized:
            self.keeping = f"{Integrator.keeping}, or stabilized=True"
        # histories have this name, those from before stabilized=True was the default, too
        kind = "stabilized generalized-alpha" if stabilized else "generalized-alpha"
        self.name = f"{kind}, rho_inf = {r:g}"
        self.reference = (
            "Chung & Hulbert, J. Appl. Mech. 60 (1993) 371; Arnold & Bruels, Multibody Syst. Dyn."
            " 18 (2007) 185; Arnold, Bruels & Cardona, Numer. Math. 129 (2015) 149"
        )

    def __repr__(self) -> str:
        more = "" if self.stabilized else ", stabilized=False"
        return f"GeneralizedAlpha(rho_inf={self.rho_inf:g}{more})"

    def scheme(self, h: float) -> Scheme:
        """Numbers of the scheme: rates are v, a, alpha, and if stabilized v before it was moved."""
        b, g, am, af = self.beta, self.gamma, self.alpha_m, self.alpha_f
        # each by dq and the rates v, a, alpha at the start
        alpha = np.array([1 / (b * h * h), -1 / (b * h), 0.0, -(0.5 - b) / b])
        v = g * h * alpha + np.array([0.0, 1.0, 0.0, (1 - g) * h])
        a = ((1 - am) * alpha + np.array([0.0, 0.0, -af, am])) / (1 - af)
        table = [v, a, alpha]
        if self.stabilized:
            table = [np.append(row, 0.0) for row in (v, a, alpha, v)]
        v = table[0]
        a = table[1]
        own = Scheme(
            h * a[0],
            0.0,
            h,
            1.0,
            v[0],
            at=1.0,
            before=tuple(-h * a[1:]),
            rates=tuple(v[1:]),
            table=tuple(map(tuple, table)),
        )
        if not self.stabilized:
            return own
        turn = (1 - am) / (1 - af) / (g * h)
        return replace(own, moved=(1.0, turn, 1 / (g * h), 0.0), moved_force=h * turn, found_with=3)

    def start(self, system: System, state: State, h: float) -> Floats:
        """Rates that the state carries on, for this step size; else consistent accelerations."""
        if state.rates is None:
            rates = self._rates(system, state, h)
            if self.stabilized:
                rates = np.concatenate([rates, rates[:1]])
            return rates.reshape(len(rates), -1, 3)
        rates = state.rates.reshape(len(state.rates), -1, 3)
        if state.made_by is not None and state.made_by.step != h:
            # alpha is an acceleration a share of the step earlier or later
            rates = rates.copy()
            rates[2] = rates[1] + h / state.made_by.step * (rates[2] - rates[1])
        return rates

    def _rates(self, system: System, state: State, h: float) -> Floats:
        """v, a, and the acceleration ``(alpha_f - alpha_m) h`` earlier, at a start (3, n)."""
        q = state.q
        t = state.time
        y = system.extend(q, t)
        v = nearest_velocity(system, y, state.p, t)
        a = accelerations(system, q, v, t, state.turns)[0]
        s = 0.1 * h
        later = q + s * v + 0.5 * s**2 * a, v + s * a, t + s
        change = (accelerations(system, *later, state.turns)[0] - a) / s
        # where the step does not resolve it, no more than velocities that are there
        there = self._size(system, v) + h * self._size(system, a)
        more = self._size(system, change)
        if 0 < there < h**2 * more:
            change = change * (there / (h**2 * more))
        early = self.alpha_m - self.alpha_f
        if not self.stabilized and system.m:
            p = (system.mass @ change.reshape(-1, 3)).reshape(-1)
            across = change - nearest_velocity(system, y, p, None)
            v = v + (1 / 6 - self.beta - early / 2) * h**2 * across
        return np.array([v, a, a + early * h * change])

    @staticmethod
    def _size(system: System, rates: Floats) -> float:
        """Root of twice the kinetic energy of rates (n,)."""
        rows = rates.reshape(-1, 3)
        return float(np.sqrt(max(0.0, (rows * (system.mass @ rows)).sum())))
