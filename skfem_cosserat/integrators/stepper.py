"""Steps: solved one by one, or several in one go."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from math import isfinite
from typing import Any

import numpy as np

from ..arguments import checked
from ..compiled.kept import Source
from ..constraints import BoundTreatment, Treatment
from ..constraints.saddle import nearest_momentum, nearest_velocity
from ..errors import AccuracyWarning, Diverged, IncompatibleError, InputError, PerformanceWarning
from ..linear import LinearSolver, SingularMatrixError, Solver, checked_solver
from ..model import Model, System, system_of
from ..model.limits import FAR_TURN, fastest_turn, jump, over_rotated, overstretched, undefined
from ..model.loops import BROKEN, contradiction, dead_point
from ..newton import NewtonReport, NewtonSettings, newton
from ..types import Array, Floats, check_kind, positive, real, whole
from ..warn import Notices, listening, logger, warn
from .base import Integrator
from .block import Block, Code, Failure, StepReport, composed
from .choice import FACTOR, built, choose_kernels
from .compiled_step import CompiledStep, kernel_coordinates
from .scheme import State, StepOrigin, carried_rates
from .step_balance import Evaluation, StepBalance, StepData

# -- A step as the Newton loop sees it -------------------------------------------------------------


class StepProblem:
    """A step of a discrete balance with a treatment that is at its start.

    Parameters
    ----------
    balance : StepBalance
    treatment : BoundTreatment
    step : StepData
    mixed : float
        See :class:`skfem_cosserat.NewtonSettings`.
    """

    def __init__(
        self, balance: StepBalance, treatment: BoundTreatment, step: StepData, mixed: float
    ):
        self.balance = balance
        self.system = balance.system
        self.treatment = treatment
        self.step = step
        self.evaluation: Evaluation | None = None
        self._mixed = mixed
        self._stresses: list[Array] | None = None
        self._sized: tuple[Floats | None, tuple[float, float]] = None, (0.0, 0.0)

    def residual(self) -> float:
        """Evaluate at the present configuration; size of the residual against its terms."""
        y1 = self.treatment.configure()
        self.evaluation = self.balance.evaluate(self.step, y1)
        self.y1 = y1
        self._r = self.treatment.reduce(self.evaluation.R, y1)
        return self.treatment.relative(self._r, self.evaluation.size)

    def direction(self) -> Floats:
        """Newton increment at the configuration evaluated last."""
        assert self.evaluation is not None
        e, _ = self._from = self.evaluation, self.y1
        if self._stresses is not None:
            e = self.balance.with_stresses(e, self._stresses)
            self.treatment.reduce(e.R, self.y1)
        data = self.treatment.matrix(self.balance.tangent(self.step, e), e.R, self.y1)
        direction = -self.treatment.solver.solve(data, self.treatment.scale_rows(self._r))
        border = self.balance.border(self.step, e)
        if border is None:
            return direction
        # of the matrix with ``sum_k U_k V_k^T`` added (Sherman, Morrison, Woodbury)
        U, V = border
        treatment = self.treatment
        columns = [treatment.solver.solve_again(treatment.scale_rows(treatment.pull(u))) for u in U]
        moved = [treatment.displacement(x, self.y1) for x in (*columns, direction)]
        products = np.tensordot(V, np.array(moved), axes=([1, 2], [1, 2]))
        factors = np.linalg.solve(np.eye(len(U)) + products[:, :-1], products[:, -1])
        return direction - np.array(columns).T @ factors

    def sizes(self, increment: Floats) -> tuple[float, float]:
        """Size of an increment (relative displacement or rad), and of its largest rotation."""
        if self._sized[0] is not increment:  # asked for again where it is applied
            self._sized = increment, self.treatment.sizes(increment, self._from[1])
        return self._sized[1]

    def apply(self, increment: Floats) -> None:
        """Move the configuration by an increment; predict stresses after a large one."""
        self._stresses = None
        if self.sizes(increment)[0] > self._mixed and self.system.beam_groups:
            change = self.treatment.displacement(increment, self._from[1])
            self._stresses = self.balance.predicted(self.step, self._from[0], change)
        self.treatment.move(increment)

    def save(self) -> object:
        """Configuration that :meth:`restore` takes."""
        return self.treatment.sought

    def restore(self, saved: object) -> None:
        """Back to a saved configuration."""
        self.treatment.sought = saved


# -- one time step: integrator x treatment x Newton, with retries and a clear failure --------------

#: scaled residual above which a converged step is looked at again, and the increment it may ask for
#: then: more than that is no rounding, but a balance with jumps
SOLVED = 1e-5
FURTHER = 1e-6
#: steps in a row that compiled kernels leave to plain numpy, after which that is said
LEFT = 20
#: attempts at a step: (extrapolate the last increment, damped)
ATTEMPTS = ((True, False), (False, False), (False, True), (True, True))


@dataclass(eq=False)
class _Size:
    """Objects that belong to the steps of one size.

    Attributes
    ----------
    h : float
        Step size (s).
    balance : StepBalance
    fast : CompiledStep or None
        Compiled kernels.
    last : (float, array) or None
        Of the last step that the general way has solved, or begins with: its size, and what the
        treatment was moved by.
    """

    h: float
    balance: StepBalance
    fast: CompiledStep | None
    last: tuple[float, Array] | None = None


@checked
class Stepper:
    """Solves step after step, of one size unless another one is asked for.

    Parameters
    ----------
    system : Model or System
    integrator : Integrator
    treatment : Treatment
    h : float
        Step size (s), positive, where no other is asked for.
    settings : NewtonSettings, optional
    kernels : {"auto", "numpy", "numba"}
        See :func:`skfem_cosserat.simulate`.
    steps : int, optional
        How many are intended: for many kernels are compiled.
    solver : Solver, optional
        See :func:`skfem_cosserat.simulate`.
    announce : callable, optional
        Called with a text before compiling.

    Raises
    ------
    InputError
        If an argument is of another kind, or the step not positive.
    IncompatibleError
        If scheme, scene, treatment and solver do not go together.
    ImportError
        If numba, or the package of a solver, is asked for and not there.

    Attributes
    ----------
    choice : Choice
        Kernels in use, and why.
    notices : Notices
        Warnings so far; each is given once by a stepper.

    Examples
    --------
    >>> from skfem_cosserat import Model, MassPoint, NullSpace, Variational, initial_state
    >>> model = Model()
    >>> ball = model.add("ball", MassPoint(1.0, velocity=(1.0, 0, 0)))
    >>> system = model.freeze()
    >>> stepper = Stepper(system, Variational(), NullSpace(), 0.1)
    >>> stepper.advance(initial_state(system)).state.q.round(12).tolist()
    [0.1, 0.0, 0.0]
    """

    def __reduce_ex__(self, protocol: object) -> Any:
        """Kernels work in arrays at their addresses: no copy would have them."""
        raise TypeError("a Stepper cannot be copied or pickled: make another one of its system")

    def __repr__(self) -> str:
        methods = f"{self.integrator!r}, {self.treatment!r}"
        return f"<Stepper: {methods}, h = {self.h:g} s, kernels {self.choice.name}>"

    def __init__(
        self,
        system: Model | System,
        integrator: Integrator,
        treatment: Treatment,
        h: float,
        settings: NewtonSettings | None = None,
        kernels: str = "auto",
        steps: int | None = None,
        solver: Solver | None = None,
        announce: Callable[[str], object] | None = None,
    ):
        system = system_of(system)
        if isinstance(integrator, Treatment) and isinstance(treatment, Integrator):
            raise InputError(
                "arguments integrator, treatment",
                f"are swapped: got {integrator!r}, {treatment!r}, expected the integrator first",
            )
        check_kind("argument integrator", integrator, Integrator, ", such as EnergyMomentum()")
        check_kind("argument treatment", treatment, Treatment, ": NullSpace() or Multipliers()")
        if steps is not None:
            steps = min(whole("argument steps", steps, 0), 10**15)
        self.system, self.integrator, self.treatment = system, integrator, treatment
        self.h = positive("argument step", "step", h, " of seconds")
        self.settings = NewtonSettings() if settings is None else settings
        check_kind("argument settings", self.settings, NewtonSettings)
        if checked_solver(solver) is not None and not integrator.solves:
            reason = "its steps are not solved for, there are no linear systems"
            raise IncompatibleError(f"{integrator!r} with {solver!r}", reason)
        #: what was doubtful so far, each once
        self.notices = Notices(system.warnings)
        with self.notices:
            self._bind(kernels, steps, solver, announce)

    def _bind(
        self,
        kernels: str,
        steps: int | None,
        solver: Solver | None,
        announce: Callable[[str], object] | None,
    ) -> None:
        system, integrator, treatment = self.system, self.integrator, self.treatment
        self._march = integrator.march(system, treatment, self.h)
        self.bound: BoundTreatment = treatment.bind(system, integrator.single.constraint_weight)
        if solver is not None:
            self.bound.solve_with(solver)
        self._first = True
        self._warned = False
        self._left_in_a_row = 0
        self._end: tuple[Floats, Evaluation] | None = None  # of the last step: q, what was found
        self.choice = choose_kernels(kernels, system, integrator, treatment, steps, solver)
        #: by size, the oldest first; as many as a composed step has
        self._sizes: dict[float, _Size] = {}
        if self._march is None:
            if self.choice.name == "numba" and self.choice.source == Source.COMPILER:
                text = "kernels are compiled, some 10 s at the first time, or read from the cache"
                logger.info(text)
                if announce is not None:
                    announce(text)
            for share in integrator.shares or (1.0,):
                self._make(share * self.h, solver)
        # a solver that the steps take is made, and may warn, before they begin
        logger.info("%s kernels, linear systems: %s", self.choice.name, self.method)

    def _make(self, h: float, solver: Solver | None) -> None:
        """Balance and kernels for steps of a size (s)."""
        system, one, choice = self.system, self.integrator.single, self.choice
        balance = one.balance(system, h)

        def make() -> CompiledStep:
            coordinates = kernel_coordinates(system, self.treatment)
            methods = one, h, self.settings
            return CompiledStep(coordinates, *methods, choice.plan, solver, choice.source)

        self.choice, fast = built(choice, make)
        self._sizes[h] = _Size(h, balance, fast)

    def _sized(self, h: float) -> _Size:
        """Objects for steps of a size (s); those of a new size replace the oldest."""
        of = self._sizes.get(h)
        if of is None:
            of = self._sizes[h] = self._sizes.pop(next(iter(self._sizes)))
            of.h = h
            of.balance = self.integrator.single.balance(self.system, h)
            if of.fast is not None:
                of.fast = of.fast.resized(h)
        return of

    @property
    def balance(self) -> StepBalance:
        """Balance of single steps of the size that is taken where no other is asked for."""
        return self.integrator.single.balance(self.system, self.h)

    @property
    def _fast(self) -> CompiledStep | None:
        """Compiled kernels, of any size."""
        return next(iter(self._sizes.values())).fast if self._sizes else None

    @property
    def factorisations(self) -> int:
        """So far."""
        compiled = [of.fast.factorisations for of in self._sizes.values() if of.fast is not None]
        return self.bound.factorisations + sum(compiled)

    @property
    def linear(self) -> LinearSolver | None:
        """The sparse, banded or dense solver at work; None: elimination in blocks is all."""
        return self.bound.solver if self._fast is None else self._fast.linear

    @property
    def method(self) -> str:
        """Name of the method that solves linear systems, or of what is done instead."""
        if self._march is not None:
            return self._march.method
        return self.bound.solver.method if self._fast is None else self._fast.method

    def advance(
        self, state: State, time: float | None = None, h: float | None = None
    ) -> StepReport:
        """Solve the step that follows `state`.

        Parameters
        ----------
        state : State
            Also one of another scheme or step, see :meth:`own`.
        time : float, optional
            Time of the new state; default ``state.time + h``. (``t_n = n h`` avoids that rounding
            adds up over many steps.)
        h : float, optional
            Another step size (s), also a negative one. A state of the same scheme goes on as it is
            then, whatever step it was made by.

        Raises
        ------
        InputError
            If `h` is zero or not finite.
        IncompatibleError
            If the scheme has steps of one size only.
        Diverged
            If all attempts fail: from the extrapolated and from a zero increment, then both with
            a line search. If prescribed motion has reached a dead point of a closed loop, or
            contradicts another one around it, the reason says so.
        """
        return self.advance_block(state, 1, time, h)[0]

    def _step(self, state: State, time: float, h: float) -> Block:
        origin = StepOrigin(self.integrator.name, h)
        if self.system.moving and (reason := jump(self.system, state.time, time)):
            advice = (
                "no motion can follow a jump: let it take several steps, as"
                " RampSmooth(begin, end, first=..., last=...) does"
            )
            raise Failure(Code.JUMP, state, 0.0, reason, advice).error(self.settings)
        if self._march is not None:
            if h != self.h:
                raise IncompatibleError(
                    f"{self.integrator!r} with another step", "its steps are fixed"
                )
            new, iterations, residual, work = self._march.advance(state, time)
            new = replace(new, made_by=origin)
            impulse = np.zeros(self.system.n)
            steps = self.system, self.integrator, state, new, h, self.system.ground(time), impulse
            return Block.of_one(*steps, work, iterations, 1, residual, by_motion=True)
        step = self._compose if self.integrator.shares else self.attempts
        outcome = step(state, time, h, origin)
        if isinstance(outcome, Failure):
            raise outcome.error(self.settings)
        return outcome

    def takes_blocks(self, state: State) -> bool:
        """True if :meth:`advance_block` may take more than one step from this state on.

        Page 12 of the guide says which runs go step by step.
        """
        fast = None if self.integrator.shares else self._fast
        return fast is not None and fast.takes_blocks(state.time)

    def advance_block(
        self,
        state: State,
        steps: int,
        time: float | Callable[[Any], Any] | None = None,
        h: float | None = None,
    ) -> Block:
        """Solve up to so many steps, at least one: several in one go where kernels take them.

        Parameters
        ----------
        state : State
            As for :meth:`advance`.
        steps : int
            How many at most; fewer are taken where something has to be looked at.
        time : float or callable, optional
            Time (s) of the first new state; or times of states by their indices, one or an array.
            Default: those of `state` and as many steps, whose last digit may differ from that of
            steps added one by one.
        h : float, optional
            Another step size (s), as for :meth:`advance`.

        Returns
        -------
        Block
            Of these steps; ``block.state`` is the last state.

        Raises
        ------
        InputError
            If `steps` is no positive integer, or `h` is zero or not finite.
        IncompatibleError, Diverged
            As :meth:`advance`, if the first one fails.

        Examples
        --------
        Steps to a state that is wanted, whatever kernels there are:

        >>> from skfem_cosserat import Model, MassPoint, NullSpace, Variational, initial_state
        >>> model = Model()
        >>> ball = model.add("ball", MassPoint(1.0, velocity=(1.0, 0, 0)))
        >>> system = model.freeze()
        >>> stepper = Stepper(system, Variational(), NullSpace(), 0.1)
        >>> state = initial_state(system)
        >>> while state.index < 5:
        ...     state = stepper.advance_block(state, 5 - state.index).state
        >>> state.q.round(12).tolist()
        [0.5, 0.0, 0.0]
        """
        whole("argument steps", steps, 1)
        state = self.sampled(self.own(state, h is not None))
        size = self.h
        allowed = "a time (s) other than zero"
        if h is not None:
            size = real("argument h", "h", h, allowed)
            if not (size and isfinite(size)):
                raise InputError("argument h", f"h = {h}, expected {allowed}")

        def ends(index: Any) -> Any:
            if callable(time):
                return time(index)
            return state.time + size * (index - state.index) if time is None else time

        try:
            if listening():  # to a run, which keeps what is said
                return self._several(state, steps, ends, size)
            with self.notices:
                return self._several(state, steps, ends, size)
        except Diverged as error:
            self.notices.tell(error)
            raise

    def _several(self, state: State, steps: int, ends: Callable[[Any], Any], h: float) -> Block:
        """Steps in one go as far as kernels take them, else one."""
        fast = self._sized(h).fast if steps > 1 and self.takes_blocks(state) else None
        due = fast is not None and fast.looped and fast.due(state, self.bound)
        if fast is not None and not (due or state.plain) and self.bound.regular:
            times = np.asarray(ends(state.index + np.arange(1, min(steps, fast.most) + 1)), float)
            if self.system.moving:
                pairs = enumerate(pairwise([state.time, *times.tolist()]))
                times = times[: next((k for k, pair in pairs if self._ends_block(*pair)), None)]
            if len(times):
                block = fast.advance(state, times, StepOrigin(self.integrator.name, h))
                if block is not None:
                    self._first = False
                    self._left_in_a_row = 0
                    return block
                state = replace(state, plain=True)
        return self._step(state, float(ends(state.index + 1)), h)

    def sampled(self, state: State) -> State:
        """A state after laws that are due were sampled: they stay so in the step that begins."""
        couplings = self.system.couplings
        if couplings.due(state.turns) > state.time + 1e-9 * self.h:
            return state
        y = self.system.extend(state.q, state.time)
        v = nearest_velocity(self.system, y, state.p, state.time).reshape(-1, 3)
        ydot = np.concatenate([v, self.system.ground_rate(state.time)])
        turns = couplings.sampled(y, ydot, state.turns, state.time)
        return replace(state, turns=turns, carried={})  # accelerations jump

    def _ends_block(self, t0: float, t1: float) -> bool:
        """True if a step has prescribed motion that jumps or fails, which :meth:`advance` tells."""
        try:
            return jump(self.system, t0, t1) is not None
        except InputError:
            return True

    def own(self, state: State, varying: bool = False) -> State:
        """The state, if this scheme and step made it; else a start from its q and p.

        Its momentum is then that on the hidden constraints: schemes carry on different momenta.
        With `varying` any step of the scheme may have made it.
        """
        made = state.made_by
        if made is None:
            return state
        same = varying or abs(made.step - self.h) <= 1e-9 * self.h
        if same and made.integrator == self.integrator.name:
            return state
        y = self.system.extend(state.q, state.time)
        p = nearest_momentum(self.system, y, state.p, state.time)
        return replace(state, p=p, fresh=True, carried={}, made_by=None, plain=False)

    def attempts(self, state: State, time: float, h: float, origin: StepOrigin) -> Block | Failure:
        """Try a step of size h to a time (s), in several ways: all that is tried is here.

        Compiled kernels come first. Where they do not converge, or a singular position is near, the
        general way begins in four ways, until a solution is one that the motion leads to.
        """
        of = self._sized(h)
        step = None
        fast = of.fast
        if fast is not None:
            if fast.looped and fast.due(state, self.bound):
                step = self._begin(state, of, time)
                closing = self.bound.closing
                if self.system.plane is not None:  # in space: rows of a plane may lead out
                    rows = self.system.closure.rows
                    closing = rows[self.system.independent_rows(step.y0)[rows]]
                fast.close(closing)
            if self.bound.regular and not state.plain:
                block = fast.advance(state, np.array([time]), origin)
                if block is not None:
                    # by their terms: far below what is broken by the size of the joints
                    missed = fast.missed > 1e-4 * BROKEN
                    residual = float(block.residual[0])
                    if missed and (wrong := self._contradiction(state, h, fast.y1, residual)):
                        return wrong
                    self._first = False
                    self._left_in_a_row = 0
                    return block
            # the general way tries again from there
            of.last = None if fast.last is None else (h, fast.last)
        step = self._begin(state, of, time) if step is None else step
        self._recall(of)
        total = 0
        best = None
        residuals = []
        for attempt, (extrapolate, damped) in enumerate(ATTEMPTS, 1):
            self.bound.guess(extrapolate)
            problem = StepProblem(of.balance, self.bound, step, self.settings.mixed)
            report = newton(problem, self.settings, damped)
            total += report.iterations
            wrong_branch = self.bound.wrong_branch(problem.y1) if report.converged else None
            if report.converged and self._left(problem, report.residual):
                report.reason = f"a residual of {report.residual:.3g} is left"
            elif wrong_branch is not None:
                report.reason = f"it is on another branch: {wrong_branch}"
            elif report.converged:
                if wrong := self._contradiction(state, h, problem.y1, report.residual):
                    return wrong
                return self._accept(of, problem, time, origin, total, attempt, report)
            residuals.append(report.residuals)
            if best is None or report.residual < best.residual:
                best = report
            logger.info(
                "step %d from t = %.6g s, attempt %d of %d: %s",
                state.index + 1,
                state.time,
                attempt,
                len(ATTEMPTS),
                report.reason,
            )
        assert best is not None
        effort = f"{len(ATTEMPTS)} attempts with {total} Newton iterations"
        code, reason, advice = self._explained(step, best.reason, problem.y1, origin)
        return Failure(code, state, best.residual, reason, advice, effort, residuals)

    def _left(self, problem: StepProblem, residual: float) -> bool:
        """True if the residual asks for a further increment, although increments have vanished."""
        if residual < SOLVED:
            return False
        try:
            return not problem.sizes(problem.direction())[0] < FURTHER
        except SingularMatrixError:
            return True  # no increment of its matrix can tell

    def _compose(self, state: State, time: float, h: float, origin: StepOrigin) -> Block | Failure:
        """One step after the other, and what they give together."""
        blocks = []
        now, done, shares = state, 0.0, self.integrator.shares
        for k, share in enumerate(shares, 1):
            done += share
            self._first = True  # what is known of the motion is of another place
            end = time if k == len(shares) else state.time + done * h
            outcome = self.attempts(now, end, share * h, origin)
            if isinstance(outcome, Failure):  # what is valid is the start of the whole step
                part = f"its part {k} of {len(shares)}, from t = {outcome.state.time:.9g} s: "
                return replace(outcome, state=state, reason=part + outcome.reason)
            blocks.append(outcome)
            now = replace(outcome.state, index=state.index)
        lost = [float(block.works[0, 2]) for block in blocks]
        if sum(lost) < -1e-6 * sum(map(abs, lost)) and not self._warned:
            self._warned = True
            warn(
                f"integrator {self.integrator!r}",
                f"dampers give {-sum(lost):.3g} J in a composed step, as its backward parts are too"
                " long for them: take a smaller step, or no composition",
                AccuracyWarning,
                state.time,
            )
        return composed(blocks, replace(now, index=state.index + 1))

    def start_force(self, state: State, h: float | None = None) -> Floats | None:
        """Constraint force (n,) at a state a run starts from; None: that of the step after it.

        `h`: of that step, if it is of another size.
        """
        if self._march is not None:
            return None
        balance = self.integrator.single.balance(self.system, self.h if h is None else h)
        return balance.start_force(state)

    def _begin(self, state: State, of: _Size, time: float) -> StepData:
        """Data of a step for the general way, and its treatment at its start."""
        before = None if self._end is None or (self._end[0] != state.q).any() else self._end[1]
        step = of.balance.begin(state, before, time)
        momentum = state.p if state.fresh or self._first else None
        self._first = False
        self._recall(of)
        self.bound.begin(step.y0, self.system.grounds.at(time), of.h, momentum)
        for item, text in self.bound.doubts:
            logger.info("t = %.6g s: the %s %s", state.time, item, text)  # each time
            warn(item, text, AccuracyWarning, state.time)
        return step

    def _recall(self, of: _Size) -> None:
        """Tell the treatment the increments of the last step, for one of this size."""
        if of.last is None:
            self.bound.last = None
        else:
            h, moved = of.last
            self.bound.last = moved if h == of.h else (of.h / h) * moved

    def problem(self, step: StepData) -> StepProblem:
        """The step as the Newton loop sees it."""
        return StepProblem(self.balance, self.bound, step, self.settings.mixed)

    def _explained(
        self, step: StepData, reason: str, y1: Array, origin: StepOrigin
    ) -> tuple[Code, str, str]:
        """Why a step failed and what to try: a dead point, a loop that does not close, Newton.

        `y1` is where the last iteration ended.
        """
        stop = dead_point(self.system, step.y0, step.state.time, step.h)
        if stop is not None:
            advice = "stop or turn the drive before it, or drive another joint"
            return Code.DEAD_POINT, stop.reason, advice
        if self.bound.trouble is not None:
            reason = f"{reason}: {self.bound.trouble}"
        at = [y for y in (step.y0, y1) if np.isfinite(y).all()]
        odd = next((text for y in at if (text := undefined(self.system, y))), None)
        bent = next((text for y in at if (text := over_rotated(self.system, y))), None)
        loads = self.system.loading.values(step.state.time)
        drawn = overstretched(self.system, step.y0, loads)  # forces at y1 mean nothing
        causes = [text for text in (odd, bent, drawn, self._turned(step)) if text is not None]
        first, *more = [*causes, f"Newton's method: {reason}" if causes else reason]
        tried = f"try a smaller step than {origin.step:g} s", self.integrator.advice
        mesh = "a finer mesh" if self.system.beam_groups else ""
        advice = ", then ".join(filter(None, (*tried, mesh)))
        reason = ". ".join([first, *(f"{text[0].upper()}{text[1:]}" for text in more)])
        return Code.UNSOLVED, reason, advice

    def _turned(self, step: StepData) -> str | None:
        """That a frame turns fast at the start of the step, where its velocity is known."""
        system = self.system
        state = step.state
        try:
            v = nearest_velocity(system, step.y0, state.p, state.time)
        except (SingularMatrixError, ArithmeticError, ValueError):
            return None
        label, rate = fastest_turn(system, v)
        if not rate * abs(step.h) > FAR_TURN:
            return None
        return (
            f"the {label} turns by {rate * abs(step.h):.2g} rad in a step, steps resolve rotations"
            f" of {FAR_TURN:g} rad at most"
        )

    def _contradiction(self, state: State, h: float, y1: Array, residual: float) -> Failure | None:
        """Failure of a step if prescribed motions no longer agree around a closed loop, or None."""
        reason = contradiction(self.system, y1, state.time + h) if self.system.moving else None
        if reason is None:
            return None
        advice = "leave out one of the drives, or let it follow the motion of the other"
        return Failure(Code.CONTRADICTION, state, residual, reason, advice)

    def _accept(
        self,
        of: _Size,
        problem: StepProblem,
        time: float,
        origin: StepOrigin,
        iterations: int,
        attempts: int,
        report: NewtonReport,
    ) -> Block:
        step, evaluation, y1 = problem.step, problem.evaluation, problem.y1
        assert evaluation is not None
        finished = of.balance.finish(step, evaluation)
        state = step.state
        of.last = of.h, self.bound.moved
        if of.fast is not None:
            of.fast.resume(self.bound.moved)
            self._count_left(state)
        impulse = self.bound.impulse(evaluation.R)
        if finished.impulse is not None:
            impulse = impulse + finished.impulse
        new = State(
            time,
            state.index + 1,
            np.array(y1[: self.system.rows]).reshape(-1),
            finished.momentum.reshape(-1),
            fresh=False,
            turns=None
            if step.couplings is None
            else self.system.couplings.turns(step.couplings, y1, time),
            carried=carried_rates(finished.rates),
            made_by=origin,
        )
        self._end = y1[: self.system.rows].reshape(-1), evaluation
        steps = self.system, self.integrator.single, state, new, of.h
        counts = (iterations, attempts, report.residual)
        return Block.of_one(*steps, y1[self.system.rows :], impulse, finished.work, *counts)

    def _count_left(self, state: State) -> None:
        """A step is left to plain numpy: say it where that costs much."""
        self._left_in_a_row += 1
        if self._left_in_a_row != LEFT or not self.choice.long:
            return
        why = "they find no solution in as many iterations"
        if not self.bound.regular:
            why = "the closed loops are in a singular position, or near one"
        text = f"compiled kernels left the last {LEFT} steps to plain numpy, as {why}"
        cost = f"that is some {FACTOR} times slower"
        warn("argument kernels", f"{text}; {cost}", PerformanceWarning, state.time)

    def iteration_matrix(self, state: State, scaled: bool = True) -> tuple[Floats, StepReport]:
        """Dense iteration matrix at the converged state of the step after `state`.

        Parameters
        ----------
        scaled : bool
            The matrix actually factorised; False: without the scaling of multipliers.

        Raises
        ------
        IncompatibleError
            For explicit and composed schemes.
        """
        if self._march is not None:
            raise IncompatibleError(f"{self.integrator!r}", "it has no iteration matrix")
        if self.integrator.shares:
            raise IncompatibleError(
                f"{self.integrator!r}",
                f"each of its steps has one of its own: see {self.integrator.part!r}",
            )
        of = self._sized(self.h)
        fast, of.fast = of.fast, None  # the treatment has to be at the solution
        try:
            report = self.advance(state)
        finally:
            of.fast = fast
        step = of.balance.begin(state)
        bound = self.bound
        problem = self.problem(step)
        problem.residual()
        assert problem.evaluation is not None
        blocks = of.balance.tangent(step, problem.evaluation)
        data = bound.matrix(blocks, problem.evaluation.R, problem.y1, scaled)
        matrix = bound.solver.full(data)
        active = bound.active
        return matrix if active is None else matrix[np.ix_(active, active)], report
