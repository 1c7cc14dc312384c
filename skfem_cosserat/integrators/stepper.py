"""One time step: integrator x treatment x Newton, with retries and a clear failure."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ..constraints import BoundTreatment, Treatment
from ..constraints.saddle import nearest_velocity
from ..errors import Diverged, IncompatibleError
from ..linear import LinearSolver, Solver, checked_solver
from ..log import logger
from ..model import System
from ..model.bending import bent_elements
from ..model.singular import contradiction, dead_point
from ..model.tension import overstretched
from ..newton import NewtonReport, NewtonSettings, newton
from ..types import Array, Floats, check_kind, positive, whole
from .base import Evaluation, Integrator, March, State, StepData, StepWork
from .choice import Choice, choose_kernels
from .fast import CompiledStep
from .fast_steps import compiled_step
from .limit import FROZEN
from .problem import StepProblem
from .protocol import default_settings
from .report import ComposedReport, Solved, StepReport, StrideReport

__all__ = ["StepReport", "Stepper"]


#: scaled residual above which a converged step is looked at again, and the increment it may ask for
#: then: more than that is no rounding, but a balance with jumps
SOLVED, FURTHER = 1e-5, 1e-6
#: attempts at a step: (extrapolate the last increment, damped)
ATTEMPTS = ((True, False), (False, False), (False, True), (True, True))


class Stepper:
    """Solves step after step, of one size until :meth:`resize` changes it.

    Parameters
    ----------
    system : System
    integrator : Integrator
    treatment : Treatment
    h : float
        Step size (s), positive.
    settings : NewtonSettings, optional
    kernels : {"auto", "numpy", "numba"}
        See :func:`skfem_cosserat.simulate`.
    steps : int, optional
        How many are intended, to judge whether compiling pays.
    solver : Solver, optional
        See :func:`skfem_cosserat.simulate`.
    announce : callable, optional
        Called with a text before compiling.
    backwards : bool
        Of a negative step, as compositions have them.

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

    def __init__(
        self,
        system: System,
        integrator: Integrator,
        treatment: Treatment,
        h: float,
        settings: NewtonSettings | None = None,
        kernels: str = "auto",
        steps: int | None = None,
        solver: Solver | None = None,
        announce: Callable[[str], object] | None = None,
        *,
        backwards: bool = False,
    ) -> None:
        check_kind("argument system", system, System, FROZEN)
        check_kind("argument integrator", integrator, Integrator)
        check_kind("argument treatment", treatment, Treatment)
        self.system, self.integrator, self.treatment = system, integrator, treatment
        self.h = (-1 if backwards else 1) * positive(
            "argument step", "step", -h if backwards else h, " of seconds"
        )
        self.settings = default_settings() if settings is None else settings
        check_kind("argument settings", self.settings, NewtonSettings)
        #: name and step by which its states are known, and what a failed step is called by
        self.maker = integrator.name, self.h
        #: whether states of the same scheme go on as they are after steps of other sizes
        self.varying = False
        if checked_solver(solver) is not None and not integrator.solves:
            reason = "its steps are not solved for, there are no linear systems"
            raise IncompatibleError(f"{integrator!r} with {solver!r}", reason)
        self._march = integrator.march(system, treatment, self.h, kernels, steps)
        self.bound: BoundTreatment = treatment.bind(system, integrator.constraint_weight)
        self.bound.large = False
        if solver is not None:
            self.bound.solver = LinearSolver(self.bound.solver.pattern, solver)
        self._first, self._warned = True, False
        self._end: tuple[Floats, Evaluation] | None = None  # of the last step: q, what was found
        self._fast: CompiledStep | None = None
        #: steppers by share of the step
        self._stages: dict[float, Stepper] = {}
        if self._march is not None:
            self.choice = Choice(*self._march.kernels)
            return
        self.choice = choose_kernels(kernels, system, integrator, treatment, steps, solver)
        one = integrator.single
        if one is not integrator:
            common = self.settings, self.choice.name, steps, solver, announce
            self._stages = {
                share: Stepper(system, one, treatment, share * self.h, *common, backwards=share < 0)
                for share in integrator.shares
            }
            for stage in self._stages.values():
                stage.maker = self.maker
            return
        if self.choice.name == "numba":
            text = "kernels are compiled, some 10 s at the first time, or read from the cache"
            logger.info(text)
            if announce is not None:
                announce(text)
            plan = self.choice.plan
            chosen = integrator, treatment, self.h, self.settings, plan, solver
            self._fast = compiled_step(system, *chosen)

    @property
    def factorisations(self) -> int:
        """So far."""
        if self._stages:
            return sum(stage.factorisations for stage in self._stages.values())
        compiled = 0 if self._fast is None else self._fast.factorisations
        return self.bound.solver.factorisations + compiled

    @property
    def linear(self) -> LinearSolver | None:
        """The sparse, banded or dense solver at work; None: elimination in blocks is all."""
        if self._stages:
            return next(iter(self._stages.values())).linear
        return self.bound.solver if self._fast is None else self._fast.linear

    @property
    def method(self) -> str:
        """How linear systems are solved."""
        if self._march is not None:
            return self._march.method
        if self._stages:
            return next(iter(self._stages.values())).method
        return self.bound.solver.method if self._fast is None else self._fast.method

    def resize(self, h: float) -> None:
        """Take steps of another size (s), of the same sign, from now on; not if explicit."""
        self.varying = True
        if h == self.h:
            return
        if self._march is not None:
            raise IncompatibleError(f"{self.integrator!r} with another step", "its steps are fixed")
        sign = -1 if self.h < 0 else 1
        size = positive("argument step", "step", sign * h, " of seconds")
        ratio, self.h = h / self.h, sign * size
        self.maker = self.integrator.name, self.h
        for share, stage in self._stages.items():
            stage.resize(share * h)
            stage.maker = self.maker
        self.bound.rescale(ratio)
        if self._fast is not None:
            self._fast = self._fast.resized(h)

    def advance(self, state: State, time: float | None = None) -> StepReport:
        """Solve the step that follows `state`.

        Parameters
        ----------
        state : State
            Also one of another scheme or step, see :meth:`own`.
        time : float, optional
            Time of the new state; default ``state.time + h``. (``t_n = n h`` avoids that rounding
            adds up over many steps.)

        Raises
        ------
        Diverged
            If all attempts fail: from the extrapolated and from a zero increment, then both with
            a line search. If prescribed motion has reached a dead point of a closed loop, or
            contradicts another one around it, the reason says so.
        """
        new_time, state = state.time + self.h if time is None else time, self.own(state)
        if self._stages:
            report = self._compose(state, new_time)
        elif self._march is not None:
            report = self._marched(self._march, state, new_time)
        else:
            report = self._solve(state, new_time)
        report.state.maker = self.maker
        return report

    def strides(self, state: State) -> bool:
        """Whether :meth:`stride` may take more than one step from this state on.

        With compiled kernels, where loads are constant from then on, nothing moves by prescription,
        and there are no springs, dampers, drag and viscous sections.
        """
        return self._fast is not None and self._fast.strides(state.time)

    def stride(self, state: State, steps: int) -> StepReport:
        """Solve up to so many steps in one go, at least one: the same ones, for less.

        Parameters
        ----------
        state : State
            As for :meth:`advance`.
        steps : int
            How many at most; fewer are taken where something has to be looked at.

        Returns
        -------
        StepReport
            Of the last of them; ``report.steps`` is how many there were, ``report.work`` that of
            all.

        Raises
        ------
        InputError
            If `steps` is no positive integer.
        Diverged
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
        ...     state = stepper.stride(state, 5 - state.index).state
        >>> state.q.round(12).tolist()
        [0.5, 0.0, 0.0]
        """
        whole("argument steps", steps, 1)
        fast, state = self._fast, self.own(state)
        if steps < 2 or fast is None or not fast.strides(state.time) or state.q is fast.stuck:
            return self.advance(state)
        if (fast.looped and fast.due(state, self.bound)) or not self.bound.regular:
            return self.advance(state)
        stride = fast.stride(state, steps)
        if not stride.steps:
            return self.advance(state)  # by the general way
        self._first, k = False, stride.steps
        fresh, where = state.fresh and k == 1, (state.time + (k - 1) * self.h, state.index + k - 1)
        before = State(*where, *stride.before, fresh, maker=self.maker)
        new = State(state.time + k * self.h, state.index + k, *stride.after, False)
        new.maker, y1, impulse = self.maker, fast.y1, fast.impulse
        if stride.stuck:
            y1, impulse = self.system.extend(new.q, new.time), np.full_like(impulse, np.nan)
        solved = Solved(self.system, self.integrator, self.h, before, y1, impulse)
        own = new, stride.last, 1, fast.residual, StepWork(stride.work), solved
        return StrideReport(*own, k, stride.iterations)

    def own(self, state: State) -> State:
        """The state, if this scheme and step made it; else a start from its q and p.

        Its momentum is then that on the hidden constraints: schemes carry on different momenta.
        """
        if state.maker is None:
            return state
        name, step = state.maker
        if name == self.maker[0]:
            if abs(step - self.maker[1]) <= 1e-9 * abs(self.maker[1]):
                return state
            if self.varying:
                return self.integrator.resized(state, self.h)
        y = self.system.extend(state.q, state.time)
        v = nearest_velocity(self.system, y, state.p, state.time)
        p = np.asarray(self.system.mass @ v.reshape(-1, 3)).reshape(-1)
        return replace(state, p=p, fresh=True, memory=None, maker=None)

    def _solve(self, state: State, new_time: float) -> StepReport:
        step: StepData | None = None
        if self._fast is not None:
            if self._fast.looped and self._fast.due(state, self.bound):
                step = self._begin(state)
                self._fast.close(self.bound.closing)
            if self.bound.regular and state.q is not self._fast.stuck:
                solved = self._fast.solve(state)
                if solved is not None:
                    return self._accept_compiled(self._fast, state, new_time, *solved)
            self.bound.last = self._fast.last  # the general way tries again from there
        if step is None:
            step = self._begin(state)
        total = 0
        best: NewtonReport | None = None
        residuals = []
        for attempt, (extrapolate, damped) in enumerate(ATTEMPTS, 1):
            self.bound.guess(extrapolate)
            problem = self.problem(step)
            report = newton(problem, self.settings, damped)
            total += report.iterations
            astray = self.bound.astray(problem.y1) if report.converged else None
            if report.converged and self._left(problem, report.residual):
                report.reason = f"a residual of {report.residual:.3g} is left"
            elif astray is not None:
                report.reason = f"it has turned over: {astray}"
            elif report.converged:
                if self.system.moving:
                    self._check_motion(state, problem.y1, report.residual)
                return self._accept(state, problem, new_time, total, attempt, report)
            residuals.append(report.residuals)
            if best is None or report.residual < best.residual:
                best = report
            logger.warning(
                "step %d from t = %.6g s, attempt %d of %d: %s",
                *(state.index + 1, state.time, attempt, len(ATTEMPTS), report.reason),
            )
        assert best is not None
        effort = f"after {len(ATTEMPTS)} attempts with {total} Newton iterations"
        reason, advice = self._explained(step, best.reason, problem.y1)
        where = state.time, state.index + 1, best.residual
        error = Diverged(*where, f"{reason}, {effort}", advice, residuals)
        error.settings = self.settings
        raise error

    def _left(self, problem: StepProblem, residual: float) -> bool:
        """Whether a residual asks for more, although increments have vanished."""
        if residual < SOLVED:
            return False
        return not problem.sizes(problem.direction())[0] < FURTHER

    def _compose(self, state: State, time: float) -> StepReport:
        """One step after the other, and what they give together."""
        reports: list[StepReport] = []
        now, done, shares = state, 0.0, self.integrator.shares
        for k, share in enumerate(shares, 1):
            done += share
            stage = self._stages[share]
            stage._first = True  # what it knows of the motion is of another place
            end = time if k == len(shares) else state.time + done * self.h
            reports.append(stage.advance(now, end))
            now = replace(reports[-1].state, index=state.index)
        works = [report.work for report in reports]
        lost = [work.dissipated for work in works]
        if sum(lost) < -1e-6 * sum(map(abs, lost)) and not self._warned:
            self._warned = True
            logger.warning(
                "t = %.6g s: dampers give %.3g J in a composed step, as its backward parts are too"
                " long for them: take a smaller step, or no composition",
                *(state.time, -sum(lost)),
            )
        return ComposedReport.of(reports, replace(now, index=state.index + 1))

    def _marched(self, march: March, state: State, time: float) -> StepReport:
        new, iterations, residual, work = march.advance(state, time)
        y1, none = self.system.extend(new.q, new.time), np.zeros((self.system.rows, 3))
        solved = Solved(self.system, self.integrator, self.h, state, y1, none)
        return ComposedReport(new, iterations, 1, residual, work, solved, [])

    def _begin(self, state: State) -> StepData:
        """Data of a step for the general way, and its treatment at its start."""
        before = None if self._end is None or (self._end[0] != state.q).any() else self._end[1]
        step = self.integrator.begin(self.system, state, self.h, before)
        self.bound.momentum = state.p if state.fresh or self._first else None
        self._first = False
        self.bound.begin(step.y0, self.system.ground(state.time + self.h), self.h)
        if self.bound.notice:
            logger.warning("t = %.6g s: %s", state.time, self.bound.notice)
        return step

    def problem(self, step: StepData) -> StepProblem:
        """The step as the Newton loop sees it."""
        own = self.system, self.integrator, self.bound
        return StepProblem(*own, step, self.settings.mixed)

    def _explained(self, step: StepData, reason: str, y1: Array) -> tuple[str, str]:
        """Why a step failed and what to try: a dead point, a loop that does not close, Newton.

        `y1` is where the last iteration ended.
        """
        stop = dead_point(self.system, step.y0, step.t0, self.h)
        if stop is not None:
            return stop.reason, "stop or turn the drive before it, or drive another joint"
        if self.bound.trouble is not None:
            reason = f"{reason}: {self.bound.trouble}"
        bent = bent_elements(self.system, step.y0)
        if bent is None and np.isfinite(y1).all():
            bent = bent_elements(self.system, y1)
        drawn = overstretched(self.system, step.y0)  # forces at y1 mean nothing
        reason = "; ".join(text for text in (reason, bent, drawn) if text is not None)
        return reason, f"try a smaller step than {self.maker[1]:g} s, {self.integrator.advice}"

    def _check_motion(self, state: State, y1: Array, residual: float) -> None:
        """Raise Diverged if prescribed motions no longer agree around a closed loop."""
        reason = contradiction(self.system, y1, state.time + self.h)
        if reason is not None:
            advice = "leave out one of the drives, or let it follow the motion of the other"
            raise Diverged(state.time, state.index + 1, residual, reason, advice)

    def _accept(
        self,
        state: State,
        problem: StepProblem,
        time: float,
        iterations: int,
        attempts: int,
        report: NewtonReport,
    ) -> StepReport:
        step, evaluation, y1 = problem.step, problem.evaluation, problem.y1
        assert evaluation is not None
        self.bound.finish()
        if self._fast is not None:
            self._fast.last = self.bound.last
        impulse: Array = self.bound.constraint_impulse(evaluation.R)
        R, evaluation = evaluation.R, self.integrator.finished(self.system, step, evaluation)
        if evaluation.R is not R:
            impulse = impulse - (evaluation.R - R)
        new = State(
            time,
            state.index + 1,
            np.array(y1[: self.system.rows]).reshape(-1),
            self.integrator.carry(self.system, step, evaluation).reshape(-1),
            fresh=False,
            turns=None
            if step.couplings is None
            else self.system.couplings.turns(step.couplings, y1),
            memory=self.integrator.memory(evaluation),
        )
        self._end = y1[: self.system.rows].reshape(-1), evaluation
        work = self.integrator.work(self.system, step, evaluation, y1)
        solved = Solved(self.system, self.integrator, self.h, state, y1, impulse)
        return StepReport(new, iterations, attempts, report.residual, work, solved)

    def _accept_compiled(
        self, fast: CompiledStep, state: State, time: float, iterations: int, residual: float
    ) -> StepReport:
        y1, rows = fast.y1, self.system.rows
        fast.end = y1[:rows].ravel()
        new = State(time, state.index + 1, fast.end, fast.carried().ravel(), False, fast.turns())
        self._first = False
        solved = Solved(self.system, self.integrator, self.h, state, y1, fast.impulse)
        return StepReport(new, iterations, 1, residual, fast.work(), solved)

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
        if self._stages:
            raise IncompatibleError(
                f"{self.integrator!r}",
                f"each of its steps has one of its own: see {self.integrator.part!r}",
            )
        fast, self._fast = self._fast, None  # the treatment has to be at the solution
        try:
            report = self.advance(state)
        finally:
            self._fast = fast
        step, bound = self.integrator.begin(self.system, state, self.h), self.bound
        problem = self.problem(step)
        problem.residual()
        assert problem.evaluation is not None
        blocks = self.integrator.tangent(self.system, step, problem.evaluation)
        data = bound.data(blocks, problem.evaluation.R, problem.y1, scaled)
        matrix = bound.solver.pattern.assembled(data).toarray()
        active = bound.active()
        return matrix if active is None else matrix[np.ix_(active, active)], report
