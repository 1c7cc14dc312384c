"""A scheme in numbers, the states between its steps, and the work that steps do."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from ..arguments import checked
from ..errors import InputError
from ..types import Floats, IndexArray


@dataclass(frozen=True)
class StepOrigin:
    """Scheme and step size of the step that led to a state.

    The momentum of a state and what it carries mean something to that scheme only, the rates
    perhaps to that step size only; see :meth:`Stepper.own`.

    Attributes
    ----------
    integrator : str
        Name of the scheme.
    step : float
        Step size (s), negative for a step back; of a composed step as a whole.
    """

    integrator: str
    step: float


@checked
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
    carried : dict
        What the integrator carries on beside (q, p), arrays by name: ``"rates"`` (k, n), such as
        accelerations. Empty: nothing, or a start from (q, p).
    made_by : StepOrigin or None
        Scheme and step that p and what is carried on are of; others start anew from them, as
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
    carried: dict[str, Floats] = field(default_factory=dict)
    made_by: StepOrigin | None = None
    load_factor: float | None = None
    plain: bool = False

    @property
    def rates(self) -> Floats | None:
        """Rates (k, n) that it carries; None: it has none."""
        return self.carried.get("rates")

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
        Lost in dampers, viscous sections and drag.
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


@checked
@dataclass(frozen=True)
class Scheme:
    """An implicit one-step scheme in numbers, for steps of one size h.

    Its balance is ``R = mass M dq - momentum p_0 - M (before . r_0) + force (F - f)`` with
    ``dq = q_1 - q_0`` and rates r_0 that the scheme carries on. Internal forces F and loads f act
    at the configuration ``(1 - at) y_0 + at y_1`` and at the velocity ``rate dq + rates . r_0``.

    Attributes
    ----------
    mass, momentum, force : float
    weight : float
        Constraint forces act at ``(1 - weight) y_0 + weight y_1``.
    rate : float
        Derivative of the velocity by q_1 (1/s): 1/h for the mean velocity of the step.
    carry : (float, float, float)
        The momentum carried on is ``carry[0] mass M dq + carry[1] p_0 + carry[2] force (F - f)``;
        with `before` it is M times the first of the rates.
    at : {0.5, 1}
        At 1 loads, actuators and the moving ground are taken as they are at the end of the step,
        else as their means over it.
    ends : bool
        Stresses are discrete derivatives of the stored energy between both ends; else they are
        those of the configuration above.
    decay : float
        With `ends`: chi of the additional stresses ``chi/2 D (eps_1 - eps_0)``.
    relative : bool
        With `ends` and the velocity as the first of the rates: chi also of an extra velocity, which
        no number describes; see :class:`EnergyDecaying`.
    before, rates : tuple of float
        One number for each of the rates that are carried on.
    table : tuple of tuple of float
        Rates at the end: ``table . (dq, r_0)``, one row for each.
    moved : tuple of float
        At the end of the step the velocity is moved to the nearest one u on the hidden constraints.
        Each of the rates changes by its number times ``u - r_1[0]``. Empty: velocities stay as
        they are.
    moved_force : float
        What the constraint impulse of the step changes by, as a factor of ``M (r_1[0] - u)``.
    found_with : int
        Which of the rates is the velocity that forces were found with.

    Raises
    ------
    InputError
        If `at` is neither 0.5 nor 1, or the numbers of rates do not go together.

    Examples
    --------
    The implicit midpoint rule:

    >>> h = 0.01
    >>> Scheme(2 / h, 2.0, h, weight=0.5, rate=1 / h, carry=(1.0, -1.0, 0.0)).at
    0.5
    """

    mass: float
    momentum: float
    force: float
    weight: float
    rate: float
    carry: tuple[float, float, float] = (0.0, 0.0, 0.0)
    at: float = 0.5
    ends: bool = False
    decay: float = 0.0
    relative: bool = False
    before: tuple[float, ...] = ()
    rates: tuple[float, ...] = ()
    table: tuple[tuple[float, ...], ...] = ()
    moved: tuple[float, ...] = ()
    moved_force: float = 1.0
    found_with: int = 0

    def __post_init__(self) -> None:
        if self.at not in (0.5, 1):
            raise InputError("scheme", f"at = {self.at!r}, expected 0.5 or 1")
        count = len(self.table)
        for name in ("before", "rates", "moved"):
            if len(getattr(self, name)) not in (0, count):
                raise InputError(
                    "scheme", f"{name} has {len(getattr(self, name))} numbers for {count} rates"
                )
        if any(len(row) != 1 + count for row in self.table):
            raise InputError("scheme", f"table has rows of another length than {1 + count}")

    @property
    def at_end(self) -> bool:
        """True if forces act at the end of the step."""
        return self.at == 1

    @property
    def carries_node_momentum(self) -> bool:
        """True if the momentum carried on is p_n of the node; else the next step completes it."""
        return self.weight != 0 or bool(self.moved)


def carried_rates(rates: Floats | None) -> dict[str, Floats]:
    """Rates (count, ...) as a state carries them; empty: none."""
    if rates is None or not len(rates):
        return {}
    return {"rates": rates.reshape(len(rates), -1).copy()}
