"""Energy-momentum schemes: one conserves, one takes energy out of fast relative motions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..compiled.numbers import (
    FLOW_CLOSED,
    FLOW_HALVINGS,
    FLOW_ITERATIONS,
    FLOW_NOISE,
    FLOW_REGULAR,
)
from ..errors import InputError
from ..kernels import cross, skew
from ..law import STEP
from ..model import System
from ..model.groups import Blocks, Parts
from ..model.parts import SeparateParts, separate_parts
from ..types import Array, Floats, positive, real, switch
from .base import Integrator
from .scheme import Scheme, State, StepWork
from .step_balance import Evaluation, StepBalance, StepData, end_velocity


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

    def __init__(self, stabilized: bool = False):
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


# -- mean velocities of a step whose relative part is damped, and the common one is not ------------
#
# In ``dq = h (v_m + f)``, ``v_m = (v_0 + v_1)/2``, the extra velocity is ``f = (chi/2) (v_1 - v_0 -
# c)`` with the field ``c = w + tau x v_m`` nearest to ``v_1 - v_0`` in the kinetic energy (w moves
# all positions alike, tau turns all velocities, directors' included). Since ``f`` is orthogonal to
# all ``e x v_m``, ``sum f x M v_m = 0``: angular momentum is kept. Since it is the rest of a
# projection, ``f . M (v_1 - v_0) = (chi/2) |v_1 - v_0 - c|^2_M`` is not negative. Steady rigid
# motion is not damped, whatever frame it is seen from. Parts of a scene that nothing connects have
# fields of their own; w is left out where something ties a part to the ground.


def _lengths(rows: Array, of: Callable[..., Floats] = np.linalg.norm) -> Floats:
    """Length of the real part of each row (k,); its largest entry if ``of=np.max``."""
    return of(abs(rows.real), axis=-1)


class Flow:
    """Velocities of a step at a trial change dq of the coordinates.

    With ``v_m = A b + (translation)``, ``b = chi v_0 + dq/h`` and the same
    ``A = ((1 + chi) 1 - (chi/2) tau^)^-1`` for all rows of a part, the three conditions on tau are
    those that ``sum dq x M v_m`` vanishes: quadratic equations, solved by Newton's method.

    Parameters
    ----------
    parts : SeparateParts
    dq, p0, y0 : (rows, 3) array
        The change, and momenta and coordinates at the start.
    h, chi : float

    Attributes
    ----------
    momentum : (rows, 3) array
        ``M v_m``.
    """

    def __init__(self, parts: SeparateParts, dq: Array, p0: Array, y0: Array, h: float, chi: float):
        self.parts, self.dq, self.y0, self.h, self.chi = parts, dq, y0, h, chi
        self.mdq = parts.system.mass @ dq
        b = chi * p0 + self.mdq / h
        self._total = parts.total
        self._lift = parts.lift[:, None]
        self._free = parts.free[:, None]
        self._drift = self._free * self._origins(self.mdq) / h
        self._mean = self._free * self._origins(b)
        #: momentum less its common part
        self._rest = b - self._lift * self._mean[parts.part]
        self._turn()
        self.momentum = self._rotated(self._rest) + self._lift * self._drift[parts.part]

    def _origins(self, rows: Array) -> Array:
        """Sums (parts, 3) over positions."""
        return self.parts.sum(self.parts.ones[:, None] * rows)

    def _turn(self) -> None:
        """Solve ``k + N s + (K s) x s = 0`` for ``s = (chi/2) tau/(1 + chi)`` of each part.

        A part whose relative motion is rounding, as at the first guess of a step, is not turned at
        all, nor is its way on from there, and nothing it does changes the others.
        """
        parts = self.parts
        rest = self._rest
        # products with what is common to all positions cancel
        shift = self._free * parts.sum(parts.mu[:, None] * self.dq) / self._total[:, None]
        dq = self.dq - parts.ones[:, None] * shift[parts.part]
        K = parts.sum(dq[:, :, None] * rest[:, None, :])
        k = parts.sum(cross(dq, rest))
        size = parts.sum(_lengths(dq) * _lengths(rest))
        common = self._lift * self._mean[parts.part]  # what was taken off the momenta
        noise = FLOW_NOISE * parts.sum(_lengths(self.y0) * _lengths(rest + common))
        moves = size > FLOW_CLOSED / FLOW_NOISE * noise
        size = np.where(size + noise > 0, size + noise, 1.0)
        straight = K.trace(axis1=1, axis2=2)[:, None, None] * np.eye(3) - K.swapaxes(1, 2)
        N = straight + (FLOW_REGULAR * size + noise)[:, None, None] * np.eye(3)

        def gap(s: Array) -> Array:
            return k + (straight @ s[:, :, None])[:, :, 0] + cross((K @ s[:, :, None])[:, :, 0], s)

        def slope(s: Array) -> Array:
            return N - skew(s) @ K + skew((K @ s[:, :, None])[:, :, 0])

        def change(s: Array, value: Array) -> Array:
            return -np.linalg.solve(slope(s), value[:, :, None])[:, :, 0]

        s = np.zeros_like(k)
        for _ in range(FLOW_ITERATIONS):
            value = gap(s)
            length = _lengths(value, np.max) / size
            active = moves & (length > FLOW_CLOSED)
            if not active.any():
                break
            way = np.where(active[:, None], change(s, value), 0.0)
            for _ in range(FLOW_HALVINGS):  # not too far
                after = _lengths(gap(s + way), np.max) / size
                worse = active & ~(after <= np.maximum(length, FLOW_CLOSED))
                if not worse.any():
                    break
                way = np.where(worse[:, None], 0.5 * way, way)
            s = s + way
            if (_lengths(way, np.max) < 1e-13 * (1 + _lengths(s, np.max))).all():
                break
        if np.iscomplexobj(s):  # for the imaginary part of a complex step
            s = s + np.where(moves[:, None], change(s, gap(s)), 0.0)
        self.sigma = s
        self._inverse = np.where(moves[:, None, None], np.linalg.inv(slope(s)), 0.0)
        self.A = _rotation(s) / (1 + self.chi)

    def _rotated(self, rows: Array) -> Array:
        """``A`` times each row."""
        return (self.A[self.parts.part] @ rows[:, :, None])[:, :, 0]

    def velocity(self, v0: Floats) -> Floats:
        """``v_m`` (rows, 3), where v_0 is that at the start."""
        parts = self.parts
        out = self._rotated(self.chi * v0 + self.dq / self.h)
        rest = self._drift - (self.A @ self._mean[:, :, None])[:, :, 0]
        rest = rest / self._total[:, None]
        return out + parts.ones[:, None] * rest[parts.part]

    def update(self) -> tuple[Array, Array]:
        """``d(2 M v_m)/d(dq)`` less ``(2/h) M A``: by common motion and by the turn, U and V."""
        parts, part, s, unit = self.parts, self.parts.part, self.sigma, np.eye(3)
        dA = _rotation(s[:, None] + 1j * STEP * unit).imag / (STEP * (1 + self.chi))
        plain = self.A * ((1 + self.chi) * (1 + (s * s).sum(1)))[:, None, None]
        turned = (plain[part] @ self._rest[:, :, None])[:, :, 0]
        shift = self._free * parts.sum(parts.mu[:, None] * self.dq)
        Q = -skew(turned) + skew((self.mdq - self._lift * shift[part]) / self.h) @ plain[part]
        Q = -self._inverse[part] @ Q
        mine = 1.0 * (part == np.arange(len(s))[:, None])  # rows of each part
        free = mine * parts.free[:, None]
        straight = np.einsum("kr,kci->kirc", free * parts.lift, unit - self.A) * (2 / self.h)
        bent = 2 * np.einsum("kr,rd,kicd->kirc", mine, self._rest, dA)
        U = np.concatenate([straight, bent], 1).reshape(-1, len(part), 3)
        lines = free[:, None, :, None] * parts.mu[:, None] * unit[:, None]
        turns = Q.swapaxes(0, 1)
        V = np.concatenate([lines, mine[:, None, :, None] * turns], 1).reshape(U.shape)
        used = (abs(U).max((1, 2), initial=0.0) > 0) & (abs(V).max((1, 2), initial=0.0) > 0)
        return U[used], V[used]


def _rotation(s: Array) -> Array:
    """``(1 + s^ + s s^T) / (1 + s.s)`` (..., 3, 3), for three numbers (..., 3)."""
    outer = s[..., :, None] * s[..., None, :]
    return (np.eye(3) + skew(s) + outer) / (1 + (s * s).sum(-1))[..., None, None]


# -- energy-decaying integrator: high frequencies are damped, momenta are kept ---------------------


@dataclass(eq=False)
class _WithFlow(Evaluation):
    """An evaluation with the velocities whose relative part is damped."""

    flow: Flow


class DecayingBalance(StepBalance):
    """The balance of energy-momentum with an extra velocity, which is no number; see above."""

    def evaluate(self, step: StepData, y1: Array) -> Evaluation:
        """Balance at y1, with the momenta ``2 M v_m`` of :class:`Flow` instead of ``2 M dq/h``."""
        e = super().evaluate(step, y1)
        parts = separate_parts(self.system)
        flow = Flow(parts, e.dq, step.p0, step.y0[: len(e.dq)], self.h, self.scheme.decay)
        inertia = 2 * flow.momentum
        own = vars(e) | {"R": e.R + (inertia - e.inertia), "inertia": inertia}
        return _WithFlow(**own, flow=flow)

    def tangent(self, step: StepData, evaluation: Evaluation) -> list[Blocks]:
        """Blocks of the tangent, with ``2 A/h`` in place of ``2/h`` for the inertia."""
        assert isinstance(evaluation, _WithFlow)
        blocks = super().tangent(step, evaluation)
        flow = evaluation.flow
        # 2 A/h takes the place of 2/h
        more = (2 / self.h) * (flow.A - np.eye(3))
        part = flow.parts.part
        for k, group in enumerate(self.system.groups):
            block = blocks[k]
            full = block.blocks() if isinstance(block, Parts) else block
            own = more[part[group.rows[:, 0]]]
            product = group.scalar_mass[:, :, None, :, None] * own[:, None, :, None, :]
            blocks[k] = full + product.reshape(full.shape)
        return blocks

    def border(self, step: StepData, evaluation: Evaluation) -> tuple[Array, Array] | None:
        """Low-rank part of the tangent, from the motion common to all velocities of a part."""
        assert isinstance(evaluation, _WithFlow)
        return evaluation.flow.update()

    def rates(self, step: StepData, evaluation: Evaluation) -> Floats | None:
        """Velocity (1, rows, 3) at the end of the step, before it is moved."""
        assert isinstance(evaluation, _WithFlow)
        assert step.rates0 is not None
        v0 = step.rates0[0]
        return (2 * evaluation.flow.velocity(v0) - v0)[None]

    def work(self, step: StepData, evaluation: Evaluation) -> StepWork:
        """Work of a solved step, with the energy that the extra velocity takes."""
        assert isinstance(evaluation, _WithFlow)
        assert step.rates0 is not None
        done = super().work(step, evaluation)
        flow = evaluation.flow
        f = flow.dq / self.h - flow.velocity(step.rates0[0])
        lost = 2 * float((f * (flow.momentum - step.p0)).sum())
        whole = done.dissipated + lost
        own = done.numerical + lost
        return done._replace(dissipated=whole, numerical=own)


class EnergyDecaying(EnergyMomentum):
    """Energy-momentum scheme that takes energy out of high frequencies, and never puts any in.

    The stresses of a step are ``(S_n + S_{n+1})/2 + (chi/2) D (eps_{n+1} - eps_n)`` with the
    stiffness D at zero strain (for other stored energies than quadratic ones the discrete
    derivative takes the place of the mean), springs alike. Velocities are
    ``dq = h (v_mid + f)`` with ``f = (chi/2) (v_{n+1} - v_n)``, less the common motion of each
    connected part of the scene: what turns all its velocities alike and, if nothing ties the part
    to the ground, what shifts them alike. Both terms take ``(chi/2) |.|^2`` of what they act on out
    of the energy, so without loads and drives the energy never grows; linear and angular momentum
    are kept exactly, and steady rigid motion is not damped.

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

    What both terms and the move onto the hidden constraints took in all is in
    ``history.meta["energy_balance"]["lost"]``; above a tenth of the largest energy or work there is
    a warning.

    Not symmetric: constraint forces, of steps at midpoints and of histories at states, are of the
    order of the scheme, once their first errors have died away (stabilized: at once).

    Examples
    --------
    >>> EnergyDecaying(chi=0.1).order, EnergyDecaying(rate=10.0).order
    (1, 2)
    """

    composed_to = 0
    loses = True
    conserves = "linear and angular momentum; energy never grows"
    advice = "a larger chi"
    reference = "Armero & Romero, Comput. Methods Appl. Mech. Engrg 190 (2001) 2603 and 6783"

    def __init__(
        self,
        chi: float | None = None,
        rate: float | None = None,
        velocity: bool = True,
        stabilized: bool = False,
    ):
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
        self.conserves, self.keeping = type(self).conserves, type(self).keeping
        self._text = text.replace("/s", "").replace(" ", "")
        kind = "stabilized energy-decaying" if stabilized else "energy-decaying"
        self.name = f"{kind}, {text}" + ("" if velocity else ", stresses only")

    def __repr__(self) -> str:
        more = "" if self.velocity else ", velocity=False"
        more += ", stabilized=True" if self.stabilized else ""
        return f"EnergyDecaying({self._text}{more})"

    def scheme(self, h: float) -> Scheme:
        """Numbers of the scheme, which do not describe the extra velocity."""
        chi = self.chi if self.rate is None else min(1.0, self.rate * h)
        own = replace(super().scheme(h), decay=chi)
        if not self.velocity:
            return own
        return replace(own, table=((2 / h, -1.0),), relative=True)

    def start(self, system: System, state: State, h: float) -> Floats | None:
        """Velocity that a step starts with; None: the scheme does not carry it on."""
        return end_velocity(system, state) if self.velocity or self.stabilized else None

    def balance(self, system: System, h: float) -> StepBalance:
        """Balance of a step of size h (s), with the extra velocity if there is one."""
        kind = DecayingBalance if self.velocity else StepBalance
        return kind(system, self, h)
