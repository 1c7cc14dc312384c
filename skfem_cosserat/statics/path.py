"""Paths of equilibria: one point after the other, and the function that users call."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from .. import checks
from ..constraints import NullSpace, Treatment
from ..diagnostics.forces import overstretched_at
from ..errors import AccuracyWarning, CosseratError, Diverged, IncompleteWarning
from ..frames import is_beam
from ..history import History
from ..integrators import State
from ..integrators.choice import choose, static_refusal
from ..integrators.compiled_step import kernel_coordinates
from ..linear import SingularMatrixError, Solver
from ..model import System, takes_scene
from ..model.balance import Spin
from ..model.limits import first_over_rotated, limp, over_rotated_beam
from ..newton import NewtonReport, NewtonSettings
from ..run.describe import checked_asked, finish, path_formulas
from ..run.progress import Interrupt, Progress
from ..time_function import Amplitude
from ..types import FilePath, Floats, switch
from ..warn import CLOCK_OF_PATHS, Notices, logger, warn
from .branch import Branch, branch_stage
from .control import STILL, ArcLength, Control, DisplacementControl, LoadControl, Stage
from .critical_points import AROUND, Critical, Stability, inspect, interpolated, locate_all
from .problem import UNMOVED
from .schedule import (
    Functional,
    Neutral,
    PathRecorder,
    Point,
    Schedule,
    Solution,
    weights,
)
from .solver import PathSolver
from .static_checks import (
    check_growth,
    check_many,
    check_run,
    described,
    first_point,
    held_start,
    prescribed_turn,
    rotation,
)

# -- point after point of a path: steps, what limits them, critical points on the way --------------

#: motion in an automatic step, against what its tangents predict, above which it is repeated
JUMP = 2.0
#: smallest pivot of the stiffness, against that at the start, below which tangents lead anywhere
CRITICAL = 1e-5
#: motion (mean over the nodes, relative to the scene) within which no other branch is looked for
NEAR = 1e-6
#: smallest eigenvalue of the stiffness, against that at the start, below which it is nearly lost
LIMP = 0.05
#: part of a step from a point without stiffness, in which less than half of the motion is due
SHORT = 0.1
#: what to do about limit points
BEYOND = "follow the path with ArcLength() or DisplacementControl(), which pass limit points"
#: what is raised where nothing can be found out about a path that has ended
UNKNOWN = CosseratError, ArithmeticError, ValueError, RuntimeError
#: points sought by arc length before that is advised, and how many first steps they have to lead on
TRIED, ONWARD = 20, 3.0
#: how often a step is halved to locate the critical points in it
LOSSES = 6

Callback = Callable[[Point], object]


@dataclass
class _StepStability:
    """Stability along a step: at its end, critical points found, and whether one is missing."""

    end: Stability | None
    found: list[Critical]
    lost: bool = False
    #: critical points were not searched for: they may be those of the mesh
    unsought: bool = False


@dataclass
class Continuation:
    """Point after point."""

    system: System
    solver: PathSolver
    control: Control
    watch: bool
    rejected: int = 0
    critical: list[dict[str, Any]] = field(default_factory=list)
    over_rotated: bool = False
    overstretched: bool = False
    _stability: Stability | None = None
    _first: Stability | None = None
    _rate: Floats | None = None

    def run(
        self,
        first: Point,
        direction: Floats | None,
        recorder: PathRecorder,
        callbacks: Sequence[Callback],
        show: Callable[[float, float], object],
        interrupt: Interrupt,
    ) -> tuple[str, Diverged | None]:
        """Follow the path; gives the status it ended with."""
        self.recorder = recorder
        try:
            point = self._settle(first) if direction is None else first
            held = not self.solver.schedule.moving
            stage = branch_stage(self.system, self.control, point, direction, held)
            self._begin(point, stage, direction)
            while not stage.finished(point):
                found, asked, point = self._advance(point, stage)
                show(stage.parameter, found.t)
                if not asked and not self.control.all_points and not interrupt.asked:
                    continue
                answers = [callback(found) for callback in callbacks]  # all are called
                if interrupt.asked:
                    return "interrupted", None
                if any(isinstance(answer, bool | np.bool_) and answer for answer in answers):
                    return "stopped", None
        except KeyboardInterrupt:
            return "interrupted", None
        except Diverged as error:
            return "diverged", error
        return "completed", None

    # -- start -------------------------------------------------------------------------------------

    def _begin(self, point: Point, stage: Stage, direction: Floats | None) -> None:
        solver = self.solver
        self._spent = np.zeros(2, dtype=np.int64)
        force = solver.look(point)
        stability = solver.inspect(point) if self.watch or direction is not None else None
        if stability is not None:
            solver.neutral = stability.neutral_motions(self.system, direction)
            if direction is None:
                check_many(self.system, solver.schedule, point, stability)
        # at a critical point the number of unstable motions is one or the other
        self._stability = stability if direction is None else None
        self._first = self._stability
        self._warn_of_elements(point, force)
        self._record(point, stage.parameter, force, 0.0)
        if direction is None and isinstance(self.control, ArcLength):
            try:
                stage.aim(solver.rate_at(point))
            except SingularMatrixError:  # at a critical point a step of the load factor has to do
                logger.debug("no tangent at the start")

    def _settle(self, first: Point) -> Point:
        """The equilibrium near a start that is none: the missing forces fade away."""
        solver = self.solver
        missing = solver.missing(first)
        if missing is None:
            return first
        point, left, step = first, 1.0, 1.0
        while left > 0:
            step = min(step, left)
            solution, report = solver.solve(point, Functional(), (left - step) * missing)
            if solution is None:
                self.rejected += 1
                step /= 2
                if step < 1e-4:
                    what = "the start is no equilibrium"
                    raise self._failure(point, report, what, relief=left * missing)
                continue
            point, left, step = solution.point, left - step, 2 * step
            left = left if left > 1e-12 else 0.0
        return point

    # -- a step ------------------------------------------------------------------------------------

    def _advance(self, point: Point, stage: Stage) -> tuple[Point, bool, Point]:
        """The next point, whether it is one that was asked for, and where the path goes on."""
        limit = self.control.turn
        residuals = []
        losses = 0
        beyond = None
        while True:
            length = self._prescribed(point, stage.trial())
            functional = stage.functional(point, length)
            solution, report = self._solve(point, functional)
            residuals.append(report.residuals)
            if solution is None and functional.predictor is None:
                # at a critical point the tangent does not say where to go: on as before
                rate = np.zeros((self.system.rows, 3)) if self._rate is None else self._rate
                functional = replace(functional, predictor=length * rate)
                solution, report = self._solve(point, functional)
                residuals.append(report.residuals)
            if solution is None and (both := self._around(point, stage, length)):
                solution, beyond = both
                turn, jumps = rotation(self.system, point.y, solution.point.y), False
                along = self._stability_along(point, beyond)
                break
            shorter = 0.5
            if solution is not None:
                turn = rotation(self.system, point.y, solution.point.y)
                jumps = self._jumps(point, solution)
                if limit is None or (not jumps and turn <= limit):
                    if isinstance(self.control, ArcLength) and self._crosses(point, solution.point):
                        solution = self._at_end(solution.point)
                    along = self._stability_along(point, solution)
                    if not along.lost or limit is None or losses == LOSSES:
                        break
                    # it may have landed on another branch: a shorter step shows
                    losses += 1
                elif not jumps and limit is not None:
                    shorter = max(0.5, 0.8 * limit / turn)
                report.reason = "in the shortest step it jumps to a point far away"
            self.rejected += 1
            stage.length = shorter * length
            if abs(stage.length) < stage.shortest:
                raise self._failure(point, report, "the path cannot be continued", residuals)
        solution = self._before_crest(point, solution, along)
        asked = self._accept(point, solution, stage, functional, length, turn, along)
        if jumps and limit is None and not along.found:
            self._warn_of_jump(point, solution)
        if beyond is None:
            return solution.point, asked, solution.point
        stage.parameter = beyond.point.t
        return solution.point, asked, beyond.point

    def _around(
        self, point: Point, stage: Stage, length: float
    ) -> tuple[Solution, Solution] | None:
        """A point asked for at which the stiffness is singular, from others around it; the last.

        None if they are not on one path through an equilibrium there.
        """
        if not isinstance(self.control, LoadControl) or length != stage.stops[0] - stage.parameter:
            return None
        target, *later = stage.stops
        width = min(abs(t - target) for t in (point.t, *later))
        ends = target + np.sign(length) * width * np.array([-k for k in AROUND[::-1]] + [*AROUND])
        samples = []
        for t in ends.tolist():
            found, _ = self._solve(point, Functional(value=t - point.t))
            if found is None or self._jumps(point, found):
                return None
            samples.append(found)
        points = [each.point for each in samples]
        forces = [each.constraint_force for each in samples]
        at, force = interpolated(self.solver.schedule, target, ends, points, forces)
        if self.solver.missing(at) is not None:
            return None
        return replace(samples[-1], point=at, constraint_force=force), samples[-1]

    def _warn_of_jump(self, point: Point, solution: Solution) -> None:
        """Say that a step of a size that was given may have left out a limit point."""
        text = (
            f"from load factor {point.t:.6g} on the point is much farther away than the tangents at"
            " both ends lead: the step may have passed a limit point and jumped to another branch;"
            " take shorter steps, or ArcLength() or DisplacementControl()"
        )
        warn("path", text, AccuracyWarning, solution.point.t)

    def _solve(self, point: Point, functional: Functional) -> tuple[Solution | None, NewtonReport]:
        """Solve for the next point; if that fails, once more with the motions that nothing holds.

        The first solve leaves these alone. Else each step would move along them by rounding over
        rounding, and how far, or whether its iteration shows it, is luck.
        """
        solver, neutral = self.solver, self.solver.neutral
        solution, report = solver.solve(point, functional)
        if solution is not None or not neutral.motions:
            return solution, report
        solver.neutral = Neutral()
        solution, report = solver.solve(point, functional)
        solver.neutral = neutral
        return solution, report

    def _stability_along(self, point: Point, solution: Solution) -> _StepStability:
        """Stability at a point found, and the critical points on the way to it."""
        if not self.watch:
            return _StepStability(None, [])
        before = self._stability
        stability = self.solver.inspect(solution.point)
        stability.unstable = stability.firmly_unstable
        if before is None or stability.unstable == before.unstable:
            return _StepStability(stability, [])
        if self._drawn(solution):
            return _StepStability(stability, [], unsought=True)
        found = locate_all(self.solver, before, stability)
        if isinstance(self.control, LoadControl):
            # others belong to parts of the path that were passed before, or to other branches
            low, high = sorted((point.t, solution.point.t))
            found = [c for c in found if low <= c.stability.point.t <= high or c.kind == "limit"]
        last = found[-1].after if found else before
        return _StepStability(stability, found, last.crossed(stability))

    def _drawn(self, solution: Solution) -> bool:
        """True if elements are, or were, drawn so much that motions of the mesh are unstable."""
        point, force = solution.point, solution.constraint_force
        return self.overstretched or overstretched_at(self.system, point.y, force) is not None

    def _before_crest(self, point: Point, solution: Solution, along: _StepStability) -> Solution:
        """The end of an arc length path, if it is crossed on the way to a critical point."""
        if not isinstance(self.control, ArcLength) or self.control.until is None:
            return solution
        until = self.control.until
        for k, critical in enumerate(along.found):
            if until == critical.stability.point.t or not self._crosses(
                point, critical.stability.point
            ):
                continue
            exact = self._at_end(point)
            del along.found[k:]
            along.end = inspect(self.system, exact.point, self.solver.schedule.at(until))
            return exact
        return solution

    def _accept(
        self,
        point: Point,
        solution: Solution,
        stage: Stage,
        functional: Functional,
        length: float,
        turn: float,
        along: _StepStability,
    ) -> bool:
        """Accept a point, after the critical ones that were passed; says whether it was asked."""
        solver, parameter = self.solver, stage.parameter
        gained = stage.gained(point, solution.point, length)
        own = np.array([solution.report.iterations, 1])
        self._spent += own  # of the end of the step
        for critical in along.found:
            share = functional.share(point, critical.stability.point)
            self._record_critical(critical, parameter + share * gained)
            self._check_turning(critical)
        self._spent -= own
        if along.lost:
            text = (
                f"a critical point between the load factors {point.t:.6g} and"
                f" {solution.point.t:.6g} was not located"
            )
            warn("path", text, IncompleteWarning, solution.point.t)
        if along.unsought:
            text = (
                f"critical points are not looked for from load factor {point.t:.6g} on: elements"
                " are drawn so much that node rotations of this mesh are unstable as well; refine"
            )
            warn("path", text, IncompleteWarning, solution.point.t)
        self._stability = along.end
        if along.end is None:
            solver.accept()
        else:
            solver.neutral = along.end.neutral_motions(self.system)
        rows = self.system.rows
        self._rate = (solution.point.y[:rows] - point.y[:rows]) / length
        self._warn_of_elements(solution.point, solution.constraint_force)
        asked = stage.accept(point, solution.point, length)
        if asked or self.control.all_points:
            force, report = solution.constraint_force, solution.report
            self._record(solution.point, stage.parameter, force, report.residual)
        stage.adapt(solution.report.iterations, length)
        limit = self.control.turn
        if limit is not None and turn > 0:
            # a step that would turn too far is not tried
            most = 0.95 * limit / turn * abs(length)
            stage.length = float(np.sign(stage.length)) * min(abs(stage.length), most)
        return asked

    def _jumps(self, point: Point, solution: Solution) -> bool:
        """True if a point is much farther away than the tangents lead: on another branch."""
        rows, w = self.system.rows, weights(self.system)

        def size(change: Floats) -> float:
            return float(np.sqrt((w * change**2).sum()))

        after = solution.point
        motion = size(after.y[:rows] - point.y[:rows])
        first, last = self._first, self._stability
        if first is not None and last is not None and last.pivot <= CRITICAL * first.pivot:
            # tangents of a limit point lead anywhere, what goes on from there moves less at once
            near, _ = self._solve(point, Functional(value=SHORT * (after.t - point.t)))
            self._solve(point, Functional(value=after.t - point.t))  # is the last one again
            if motion > NEAR and (
                near is None or size(near.point.y[:rows] - point.y[:rows]) > motion / 2
            ):
                return True
        if motion <= max(NEAR, JUMP * size(solution.predicted)):
            return False
        try:
            rate = self.solver.rate()
        except SingularMatrixError:
            return False
        # loads that set in slowly move nothing at first
        return motion > JUMP * abs(after.t - point.t) * size(rate)

    def _crosses(self, point: Point, after: Point) -> bool:
        until = self.control.until if isinstance(self.control, ArcLength) else None
        return (
            until is not None and after.t != point.t and (point.t - until) * (after.t - until) < 0
        )

    def _at_end(self, point: Point) -> Solution:
        """The point at the load factor at which an arc length path ends, from one next to it."""
        assert isinstance(self.control, ArcLength)
        target = Functional(value=(self.control.until or 0.0) - point.t)
        exact, report = self.solver.solve(point, target)
        if exact is None:
            raise self._failure(point, report, "the end of the path was not found")
        return exact

    def _prescribed(self, point: Point, length: float) -> float:
        """A step in which prescribed motion turns no farther than its rotation can be told."""
        if not self.solver.schedule.moving or not isinstance(self.control, LoadControl):
            return length
        for _ in range(40):
            if prescribed_turn(self.system, point.t, point.t + length) <= 1.0:
                break
            length /= 2
        return length

    # -- what is kept ------------------------------------------------------------------------------

    def _record(
        self,
        point: Point,
        parameter: float,
        force: Floats,
        residual: float,
        kind: str = "regular",
    ) -> None:
        """Record a point, with the iterations and solves since the last one, failed ones too."""
        effort = np.array([self.solver.iterations, self.solver.attempts]) - self._spent
        self._spent += effort
        iterations, attempts = effort.tolist()
        unstable = -1 if self._stability is None else self._stability.unstable
        self.recorder.take(point, parameter, force, iterations, attempts, residual, unstable, kind)

    def _record_critical(self, found: Critical, parameter: float) -> None:
        point = found.stability.point
        self._stability = found.stability
        entry = {
            "kind": found.kind,
            "load_factor": point.t,
            "state": self.recorder.count,
            "multiplicity": found.multiplicity,
        }
        self.critical.append(entry)
        logger.info("%s point at load factor %.9g", found.kind, point.t)
        self._record(point, parameter, found.constraint_force, 0.0, found.kind)

    def _warn_of_elements(self, point: Point, force: Floats) -> None:
        """Say once that elements are bent or drawn farther than they can be on their own."""
        bent = not self.over_rotated and first_over_rotated(self.system, point.y[None]) is not None
        if bent and (found := over_rotated_beam(self.system, point.y)) is not None:
            self.over_rotated = True
            warn(*found, AccuracyWarning, point.t)
        drawn = None if self.overstretched else overstretched_at(self.system, point.y, force)
        if drawn is not None:
            self.overstretched = True
            warn(*drawn, AccuracyWarning, point.t)

    def _check_turning(self, found: Critical) -> None:
        """Steps of the load factor end where it does not grow any more."""
        if found.kind != "limit" or not isinstance(self.control, LoadControl):
            return
        t = found.stability.point.t
        if self.control.turn is None:
            text = "there is a limit point: the path jumps to another branch"
            warn("path", text, AccuracyWarning, t)
            return
        reason = (
            f"the load factor has a limit point, {t:.9g}: beyond it there is no equilibrium near"
        )
        advice = BEYOND
        raise Diverged(t, self.recorder.count, 0.0, reason, advice, at=f"load factor {t:.9g}")

    def _limit_near(self) -> str:
        """That the stiffness is nearly lost at the last point, as far as it was looked at."""
        first, last = self._first, self._stability
        if first is None or last is None or first is last:
            return ""
        try:
            known = first.symmetric and last.symmetric and first.smallest > first.floor
            share = last.smallest / first.smallest if known else 1.0
        except ValueError:  # its stiffness is not finite
            return ""
        if share > LIMP:
            return ""
        return (
            "a limit point is near, as the smallest eigenvalue of the stiffness has fallen to"
            f" {100 * share:.2g} % of that at the start"
        )

    def _floating(self, point: Point, relief: Floats | None) -> str:
        """Description of motions that nothing holds at the end or at the last point; else empty.

        The end is where the last iteration ended.
        """
        y, t = self.solver.ended
        for at in (Point(y, t, point.turns), point):
            if not np.isfinite(at.y).all():
                continue
            try:
                stability = inspect(self.system, at, self.solver.schedule.at(at.t), relief)
                motions = stability.neutral_motions(self.system).motions
            except UNKNOWN:
                continue  # its stiffness is not finite or singular: nothing is known of it
            if motions:
                return described(self.system, at.y, motions)
        return ""

    def _slack(self) -> str:
        """Cables without tension where an iteration ended; empty if there are none."""
        y = self.solver.ended[0]
        forces = self.system.couplings.forces(y, np.zeros_like(y)) if np.isfinite(y).all() else []
        return " and ".join(
            item.label for item, _, force in forces if item.slack and not force.any()
        )

    def _leads_on(self, point: Point) -> bool:
        """True if steps of the arc length lead past a point, to other load factors."""
        solver = self.solver
        stage = ArcLength(TRIED).stage(self.system, point)
        try:
            stage.aim(solver.rate_at(point))
            enough = ONWARD * stage.length
            for _ in range(TRIED):
                length = stage.length
                solution, report = solver.solve(point, stage.functional(point, length))
                if solution is None or self._jumps(point, solution):
                    stage.length /= 2
                    continue
                solver.accept()
                stage.accept(point, solution.point, length)
                stage.adapt(report.iterations, length)
                before, point = point.t, solution.point
                if stage.parameter >= enough:
                    # what moves without any change of the load factor is held by nothing
                    return abs(point.t - before) > STILL * max(abs(point.t), abs(before))
        except UNKNOWN:  # as where a function of the user's has no value at another load factor
            pass
        return False

    def _failure(
        self,
        point: Point,
        report: NewtonReport,
        what: str,
        residuals: list[list[float]] | None = None,
        relief: Floats | None = None,
    ) -> Diverged:
        """Why the path ends, and what to try."""
        near = self._limit_near() if isinstance(self.control, LoadControl) else ""
        slack, first = self._slack(), self._first
        # what something holds at the start, and no cable, is lost at a critical point
        held = first is not None and not (first.neutral or slack)
        floating = "" if held else self._floating(point, relief)
        reason = f"{what}: {report.reason}"
        if floating:
            advice = "hold it with joints or springs"
            reason = f"{what}: nothing holds {floating}. Newton's method: {report.reason}"
        elif self.overstretched:
            advice = "refine the beam whose elements are drawn too much"
        elif isinstance(self.control, DisplacementControl) and UNMOVED in report.reason:
            place, way = self.control.place.label, self.control.direction.round(6).tolist()
            advice = f"the loads do not move {place} along {way}: choose what they move"
        elif relief is not None:
            advice = "start nearer to an equilibrium"
        elif isinstance(self.control, ArcLength):
            advice = "try a shorter first step, then a finer mesh"
        elif self._leads_on(point):
            advice = BEYOND
        else:
            advice = "ArcLength() does not lead on from there either"
            advice += "; try a finer mesh" * bool(self.system.beam_groups and not slack)
        if near and not floating:
            reason = f"{what}: {near}. Newton's method: {report.reason}"
        if slack:
            reason += f"; without tension where that ended: {slack}"
        for beam in filter(is_beam, self.system.structures):
            advice += limp(beam) * (limp(beam) not in reason)
        return Diverged(
            point.t,
            max(1, self.recorder.count),
            report.residual,
            reason,
            advice,
            residuals,
            at=f"load factor {point.t:.9g}",
        )


# -- the verb: equilibrium paths with automatic steps ----------------------------------------------

#: Newton's method far from the solution: increments are not shortened, predicted stresses carry it
STATIC = NewtonSettings(iterations=25, rotation=1e3, mixed=1e-9, largest=100.0)


@takes_scene
def static(
    model: System,
    treatment: Treatment | None = None,
    control: Control | None = None,
    *,
    start: State | Branch | None = None,
    factors: Mapping[str, Amplitude] | None = None,
    spin: Spin | None = None,
    time: float | None = None,
    settings: NewtonSettings | None = None,
    kernels: str = "auto",
    watch: bool = True,
    callbacks: Sequence[Callback] = (),
    progress: bool | Callable[[float, float], object] = False,
    path: FilePath | None = None,
    derive: bool | Sequence[str] | None = None,
    solver: Solver | None = None,
) -> History:
    """Equilibrium path of a scene.

    Loads that are constant in time are multiplied by the load factor; loads that depend on time,
    and prescribed motion, take the load factor for it, or stay as they are at one instant, `time`.

    Parameters
    ----------
    model : Model or System
    treatment : Treatment, optional
        ``NullSpace()`` (default) or ``Multipliers()``.
    control : Control, optional
        :class:`LoadControl` (default: to load factor 1), :class:`DisplacementControl` or
        :class:`ArcLength`.
    start : State or Branch, optional
        Where the path starts: at the load factor ``start.load_factor`` of the path that it is
        from, else at ``start.time`` (with `time`, which has to be the same instant, at 0);
        default: the reference at 0. If it is no equilibrium, the nearest one is sought first:
        where only the stress of loads that act there holds a motion, the others settle before that
        one. A :class:`Branch` leads off at a bifurcation. A state knows neither loads nor
        sections: one of another model with the same coordinates is a start like any other.
    factors : mapping of str to float, Table or callable, optional
        For loads and actuators by name, in place of the load factor: a number holds a load, a
        function of the load factor moves it on its own way. A load that depends on time is
        multiplied by its factor (default: 1) at the instant that is taken.
    spin : Spin, optional
        Everything is seen from a frame that turns with this velocity times the load factor (or
        the factor ``"spin"``), the ground in it.
    time : float, optional
        Hold all functions of time, those of loads, actuators, drives and prescribed motion, as they
        are at this instant (s), while the other loads grow with the load factor: the equilibrium
        from which ``equilibrium(model, path, time=time)`` starts a run. What is held acts from
        the start, as with a number in `factors`; ``factors={"wind": lambda x: x}`` lets its value
        at the instant grow with the load factor, too. Functions in `factors` always take the load
        factor.
    settings : NewtonSettings, optional
        When Newton's method stops.
    kernels : {"auto", "numpy", "numba"}
        Plain numpy kernels, or those compiled by numba (extra ``fast``): the same points to
        rounding, an order of magnitude faster, see :func:`skfem_cosserat.simulate`; "auto" takes
        them where they are on disk. There are none for ``Multipliers(full=True)``.
        ``history.meta["kernels"]`` and ``["kernels_why"]`` say what was taken, and why.
    watch : bool
        Look for limit and bifurcation points on the way; they are recorded as points.
    callbacks : sequence of callable
        Called with each :class:`Point` after a step that is recorded: with ``steps`` or ``at``
        those asked for, else all. Not with the start, nor with critical points, which are located
        between two of them. One that returns True ends the path.
    progress : bool or callable
        True: one line on stderr; a callable gets (parameter, load factor) after each point.
    path : path, optional
        Stream the history to this file.
    derive : bool or list of str, optional
        Series (energies, section forces, reactions) that are derived at the end, see
        :func:`skfem_cosserat.simulate`.
    solver : Solver, optional
        See :func:`skfem_cosserat.simulate`.

    Returns
    -------
    History
        One state a point. Its times are the parameter of the control, ``load_factor`` goes with
        them; ``unstable`` counts the negative eigenvalues of the stiffness (-1: not looked at),
        ``critical`` is 1 at limit and 2 at bifurcation points. The work of loads is a sum by the
        trapezoidal rule. ``path.meta["warnings"]`` says what is doubtful about it, as the warnings
        that are given, with the load factor.

    Raises
    ------
    InputError
        For bad arguments and for motions that nothing holds, before the first step.
    Diverged
        With ``error.history``, the path up to where it could not be continued.

    Examples
    --------
    A cantilever rolled up to a full circle by an end moment:

    >>> import numpy as np
    >>> from skfem_cosserat import Beam, JointFixed, LoadMoment, MeshCurve, Model, Section, ground
    >>> section = Section([1e4, 1e4, 1e4, 100, 100, 100], mass=1.0, inertia=(1.0, 1.0))
    >>> model = Model()
    >>> mesh = MeshCurve.init_line((0, 0, 0), (10, 0, 0), 8, name="rod")
    >>> rod = model.add("rod", Beam(mesh, section, order=3))
    >>> clamp = model.add("clamp", JointFixed(ground((0, 0, 0)), rod.node("rod.start")))
    >>> end = rod.node("rod.end")
    >>> moment = model.add("moment", LoadMoment(end, (0, 0, 2 * np.pi * 100 / 10)))
    >>> path = static(model)
    >>> bool(abs(path.position(end)[-1]).max() < 1e-3), float(path["load_factor"][-1])
    (True, 1.0)
    """
    system = model
    with Notices(system.warnings, CLOCK_OF_PATHS) as notices:
        treatment = NullSpace() if treatment is None else treatment
        control = LoadControl() if control is None else control
        settings = STATIC if settings is None else settings
        switch("argument watch", watch)
        check_run(system, treatment, control, settings, callbacks)
        derive = checked_asked(derive, system, path_formulas)
        schedule = Schedule(system, factors, spin, time)
        check_growth(schedule, control)
        first, direction = first_point(system, schedule, start)
        if direction is None:
            first = held_start(system, schedule, first)

        refused = static_refusal(system, treatment)
        choice = choose(kernels, kernel_coordinates(system, treatment), refused, solver=solver)
        points = PathSolver(system, treatment, schedule, settings, choice, solver)
        continuation = Continuation(system, points, control, watch and system.unknowns > 0)
        show = Progress(progress, "parameter {:.6g}, load factor {:.6g}".format)
        about: dict[str, Any] = {"treatment": treatment.name, "parameter": control.parameter}
        about |= {"solver": points.method, "unknowns": points.bound.unknowns}
        about |= {"kernels": points.choice.name, "kernels_why": points.choice.why}
        recorder = PathRecorder(system, schedule, about, path, notices)
        with recorder, Interrupt() as interrupt:
            with show:
                status, failure = continuation.run(
                    first, direction, recorder, callbacks, show, interrupt
                )
            if failure is None:
                so_far = recorder.writer.history()
                checks.apply(checks.Path([system], so_far))
            else:
                notices.tell(failure)
            history = recorder.close(
                status,
                factorisations=points.factorisations,
                newton_iterations=points.iterations,
                attempts=points.attempts,
                rejected=continuation.rejected,
                critical=continuation.critical,
                **({} if failure is None else {"failure": str(failure)}),
            )
            interrupt.at_once()  # nothing is lost any more
            finish(history, [system], derive, path)
        if failure is not None:
            failure.history = history
            raise failure
        return history
