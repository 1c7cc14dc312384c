"""Base class of integrators: a scheme in numbers, or a discrete balance of its own."""

from __future__ import annotations

from functools import cached_property
from typing import Protocol

from ..constraints import Treatment
from ..errors import IncompatibleError
from ..frozen import Frozen
from ..model import System
from ..types import Floats
from .scheme import Scheme, State, StepWork
from .step_balance import StepBalance


class March(Protocol):
    """Advances states itself, without balance, tangent and Newton's method.

    Attributes
    ----------
    method : str
        What is done instead of solving linear systems.
    """

    method: str

    def advance(self, state: State, time: float) -> tuple[State, int, float, StepWork]:
        """The step after a state, to a time (s): its end, iterations, residual and work."""


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
        Step size times highest natural frequency up to which no rotations are known that
        compression drives and that alternate from step to step, see
        :func:`skfem_cosserat.diagnostics.constraint_frequency`. None: the scheme has no such limit.
    loses : bool
        Whether it is meant to take energy out of a motion.
    advice : str
        What to try beside a smaller step and a finer mesh when a step cannot be solved.
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
    advice: str = ""
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

        Those that the state carries on, if it has any: ``state.rates``, one row of n for each.
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
        return StepBalance(system, self, h)

    def march(self, system: System, treatment: Treatment, h: float) -> March | None:
        """Object that advances states without balance and Newton's method; None: there is none.

        Raises
        ------
        IncompatibleError
            If the scene or the treatment has what the scheme cannot do.
        """
        return None

    @property
    def single(self) -> Integrator:
        """Integrator of the single steps: the part of a composed one, else this one."""
        return self if self.part is None else self.part

    @cached_property
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
        """True if the momentum carried on is p_n of the node; else the next step completes it."""
        return self.numbers.carries_node_momentum

    @property
    def remembered(self) -> int:
        """Rows of n numbers that a state carries on as its ``rates``."""
        return len(self.numbers.table)
