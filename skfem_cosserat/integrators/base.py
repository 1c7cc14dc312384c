"""What an integrator is: a scheme in numbers, the states between its steps, their work."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..constraints import Treatment
from ..errors import IncompatibleError, InputError
from ..frozen import Frozen
from ..model import System
from ..types import Floats, IndexArray

if TYPE_CHECKING:
    from .step_balance import StepBalance

__all__ = ["Integrator", "March", "Marched", "Scheme", "State", "StepOrigin", "StepWork"]


@dataclass(frozen=True)
class StepOrigin:
    """Scheme and step size of the step that led to a state.

    The momentum and the memory of a state mean something to that scheme only, the memory perhaps
    to that step size only; see :meth:`Stepper.own`.

    Attributes
    ----------
    integrator : str
        Name of the scheme.
    step : float
        Step size (s), negative for a step back; of a composed step as a whole.
    """

    integrator: str
    step: float

    def same_scheme(self, other: StepOrigin) -> bool:
        """Whether both are steps of one scheme."""
        return self.integrator == other.integrator

    def same_step(self, other: StepOrigin) -> bool:
        """Whether the steps are of one size, to rounding."""
        return abs(self.step - other.step) <= 1e-9 * abs(other.step)


@dataclass(eq=False, repr=False)
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
    memory : (k, n) array or None
        What the integrator carries on beside (q, p), such as accelerations; None: nothing, or a
        start from (q, p).
    made_by : StepOrigin or None
        Scheme and step that p and memory are of; others start anew from them, as
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
    memory: Floats | None = None
    made_by: StepOrigin | None = None
    load_factor: float | None = None
    plain: bool = False

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
        Lost in dampers, viscous sections and drag, not negative.
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
        """Whether forces act at the end of the step."""
        return self.at == 1

    @property
    def carries_velocity(self) -> bool:
        """Whether the momentum carried on is that of the rates."""
        return bool(self.before)

    @property
    def carries_node_momentum(self) -> bool:
        """Whether the momentum carried on is p_n of the node; else the next step completes it."""
        return self.weight != 0 or bool(self.moved)

    def rates_after(self, dq: Floats, before: Floats | None) -> Floats | None:
        """Rates (k, rows, 3) at the end of a step, from those before it: ``table . (dq, r_0)``."""
        if not self.table:
            return None
        assert before is not None
        change, own = self._table
        out = own @ before.reshape(len(own), -1)
        out += change * dq.reshape(-1)
        return np.asarray(out.reshape(before.shape))

    @cached_property
    def _table(self) -> tuple[Floats, Floats]:
        """Columns of the table: by dq, and by the rates."""
        table = np.array(self.table)
        return table[:, :1].copy(), table[:, 1:].copy()

    def taken_off(self, rates: Floats) -> Floats:
        """``before . r_0`` (rows, 3)."""
        return np.asarray(self._before @ rates.reshape(len(rates), -1)).reshape(-1, 3)

    @cached_property
    def _before(self) -> Floats:
        return np.array(self.before)


class Marched(NamedTuple):
    """A step that a :class:`March` has done; attributes as those of a report of a step."""

    state: State
    iterations: int
    residual: float
    work: StepWork


class March(ABC):
    """Advances states itself, without balance, tangent and Newton's method.

    Attributes
    ----------
    method : str
        What is done instead of solving linear systems.
    """

    method: str

    @abstractmethod
    def advance(self, state: State, time: float) -> Marched:
        """The step after `state`, to a time (s)."""


class Integrator(Frozen):
    """One-step scheme in (q, p).

    An implicit scheme gives :meth:`scheme`, its numbers; one that carries rates on gives
    :meth:`start`, too. A scheme that these numbers do not describe gives a :meth:`balance` of its
    own; one that solves nothing gives :meth:`march`.

    Attributes
    ----------
    name : str
        Its own: states know by it what they were made by.
    order : int
        Order of convergence in q and p.
    frequency_limit : float or None
        Step size times highest natural frequency above which a run is likely to fail; None: the
        scheme itself sets no such limit.
    loses : bool
        Whether it is meant to take energy out of a motion.
    advice : str
        What to try beside a smaller step when a step cannot be solved.
    keeping : str
        What to try beside a smaller step when the energy is not in balance.
    conserves, reference : str
        In words, and where it comes from.
    solves : bool
        Whether there are linear systems to solve.
    composed_to : int
        Highest order that symmetric compositions of its steps have; 0: it is not to be composed,
        since a step back does not undo a step, say.
    fixed_step : str or None
        Why its steps have to be all of one size; None: they need not.
    part, shares : Integrator and tuple of float
        The scheme whose steps one step is made of, and their sizes as shares of it; none: the step
        is one of its own.

    Examples
    --------
    The implicit midpoint rule, with either treatment of the constraints:

    >>> from skfem_cosserat import MassPoint, Model, NullSpace, simulate
    >>> class ImplicitMidpoint(Integrator):
    ...     name, order = "implicit midpoint", 2
    ...     def scheme(self, h):
    ...         return Scheme(2 / h, 2.0, h, weight=0.5, rate=1 / h, carry=(1.0, -1.0, 0.0))
    >>> model = Model()
    >>> ball = model.add("ball", MassPoint(1.0, velocity=(1.0, 0, 0)))
    >>> history = simulate(model, ImplicitMidpoint(), NullSpace(), step=0.1, until=0.5)
    >>> history["q"][-1].round(12).tolist()
    [0.5, 0.0, 0.0]
    """

    name: str
    order: int
    composed_to: int = 0
    fixed_step: str | None = None
    solves: bool = True
    part: Integrator | None = None
    shares: tuple[float, ...] = ()
    frequency_limit: float | None = None
    loses: bool = False
    advice: str = "a finer mesh"
    keeping: str = ", or EnergyMomentum(), which keeps the energy"
    conserves: str = ""
    reference: str = ""

    def __repr__(self) -> str:
        return f"{type(self).__name__}()"

    def scheme(self, h: float) -> Scheme | None:
        """The scheme in numbers, for a step size (s); None: no numbers describe it."""
        return None

    def start(self, system: System, state: State, h: float) -> Floats | None:
        """Rates (k, rows, 3) that a step from a state starts with; None: the scheme has none.

        Those that the state carries on, if it has any: ``state.memory``, one row of n for each.
        They may have been made by a step of another size, ``state.made_by.step``.
        """
        return None

    def balance(self, system: System, h: float) -> StepBalance:
        """The discrete balance of a step of size h (s); that of :meth:`scheme` by default.

        Raises
        ------
        IncompatibleError
            If there is no scheme either.
        """
        from .step_balance import StepBalance

        return StepBalance(system, self, h)

    def march(self, system: System, treatment: Treatment, h: float) -> March | None:
        """What advances states without balance and Newton; None: the stepper does, with both.

        Raises
        ------
        IncompatibleError
            If the scene or the treatment has what the scheme cannot do.
        """
        return None

    @property
    def single(self) -> Integrator:
        """What solves its single steps: its part if it is composed, else itself."""
        return self if self.part is None else self.part

    @property
    def numbers(self) -> Scheme:
        """The scheme in numbers for steps of one second: what does not depend on their size."""
        scheme = self.single.scheme(1.0)
        if scheme is None:
            raise IncompatibleError(f"{self!r}", "it has no scheme in numbers")
        return scheme

    @property
    def constraint_weight(self) -> float:
        """Constraint forces act at ``(1 - w) q_n + w q_{n+1}``."""
        return self.numbers.weight

    @property
    def carries_node_momentum(self) -> bool:
        """Whether the momentum carried on is p_n of the node; else the next step completes it."""
        return self.numbers.carries_node_momentum

    @property
    def remembered(self) -> int:
        """Rows of n numbers that a state carries on in its ``memory``."""
        return len(self.numbers.table)
