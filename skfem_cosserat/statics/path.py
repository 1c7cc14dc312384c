"""Paths of equilibria: one point after the other, and the function that users call."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from .. import checks
from ..analysis.describe import checked_asked, describe, finish, path_formulas, take_along
from ..analysis.progress import Interrupt, Progress
from ..analysis.start import checked_start
from ..constraints import NullSpace, Treatment
from ..diagnostics.energy import strain_excess
from ..diagnostics.forces import overstretched_at
from ..diagnostics.inputs import INSIDE
from ..errors import (
    AccuracyWarning,
    Diverged,
    IncompleteWarning,
    InputError,
)
from ..frames import is_beam
from ..history import History, HistoryWriter
from ..integrators import State
from ..integrators.choice import choose, static_refusal
from ..integrators.compiled_step import kernel_coordinates
from ..linear import SingularMatrixError, Solver
from ..model import System, takes_scene
from ..model.balance import Spin
from ..model.limits import broken_constraint, limp, overstretched
from ..newton import NewtonReport, NewtonSettings
from ..time_function import Amplitude, Constant
from ..types import FilePath, Floats, Meta, check_kind, file_path, finite, switch
from ..warn import CLOCK_OF_PATHS, Notices, logger, warn
from .branch import CODES, Branch, branch_stage
from .control import (
    ArcLength,
    Control,
    DisplacementControl,
    Functional,
    LoadControl,
    Point,
    Stage,
    size_of,
)
from .critical import Critical, Stability, inspect, locate_all
from .problem import UNMOVED, Neutral, PathSolver, Schedule, Solution, load_force

# -- where a path starts ---------------------------------------------------------------------------


def first_point(
    system: System, schedule: Schedule, start: State | Branch | None
) -> tuple[Point, Floats | None]:
    """First point, and the direction in which a branch leads off.

    Raises
    ------
    InputError
        If the start is none of this system, at another instant than the path, or off constraints.
    """
    held = schedule.time
    if isinstance(start, Branch):
        if start.time != held:
            raise InputError(
                "argument time", f"{held!r}, the Branch is of a path with {start.time!r}"
            )
        return start.point, start.direction
    q, turns, t, item = system.q0, None, 0.0, "argument start"
    if start is not None:
        q = checked_start(system, start).q
        turns = start.turns
        time = finite(item, "time", start.time)
        if held is not None and time != held:
            raise InputError(
                item,
                f"its time is {time!r} s, that of the path time = {held!r} s: expected the same"
                " instant, see initial_state(time=...) and equilibrium(time=...)",
            )
        t = time if held is None else 0.0
        if start.load_factor is not None:
            t = finite(item, "load_factor", start.load_factor)
        count = len(system.couplings.angles)
        if turns is not None and np.shape(turns) != (count,):
            raise InputError(item, f"turns = {turns!r}, expected {count} numbers")
    y = system.extend(q, schedule.instant(t))
    wrong = None if start is None and held is None else broken_constraint(system, y, 1e-6)
    if wrong is not None:
        raise InputError(
            item,
            f"at load factor {t:g}{'' if held is None else f', time = {held:g} s,'} it {wrong}:"
            " start from a state that fulfils it there, as the end of a path that moves the"
            " supports, by equilibrium(model, path, time=...)",
        )
    return Point(y, t, turns), None


def check_growth(schedule: Schedule, control: Control) -> None:
    """Raise InputError if nothing is left that a control by displacements could let grow."""
    held = schedule.time is not None and not schedule.grows
    if held and isinstance(control, (ArcLength, DisplacementControl)):
        raise InputError(
            "argument time",
            f"{schedule.time!r} s holds all there is, nothing grows with the load factor: give"
            f" factors that grow, or LoadControl() instead of {control!r}",
        )


def rotation(system: System, before: Floats, after: Floats) -> float:
    """Largest rotation (rad) of a frame between two configurations."""
    kin = system.kinematics
    if not len(kin.frames):
        return 0.0
    trace = (kin.directors(before) * kin.directors(after)).sum((1, 2))
    return float(np.arccos(np.clip((trace.min() - 1) / 2, -1, 1)))


def prescribed_turn(system: System, t0: float, t1: float) -> float:
    """Rotation (rad) of the ground's frames and of driven angles between two load factors."""
    times = np.linspace(t0, t1, INSIDE + 1).tolist()
    moved = np.diff([system.ground(t).reshape(-1, 4, 3) for t in times], axis=0)
    turns = np.sqrt(np.square(moved[:, :, 1:]).sum((2, 3)) / 2)
    # a drive's frame holds (cos, sin, value)
    drives = [
        system.spot(d.place).vertex - len(system.origin_rows)
        for d in system.drives
        if d.coordinate.kind == "angle"
    ]
    turns[:, drives] = np.linalg.norm(moved[:, drives, 0, :2], axis=2)
    return float(turns.sum(0).max())


# -- A path as a history: points with their load factor, stability and constraint forces -----------


class PathRecorder:
    """Writes the points of a path."""

    def __init__(self, solver: PathSolver, meta: Meta, path: FilePath | None, notices: Notices):
        self.solver = solver
        system = solver.system
        described, static = describe(system)
        described |= {"integrator": "static", "step": 0.0, "time": solver.schedule.time, **meta}
        #: of each factor whose it is, and whether it is a function of time
        described["factors"] = {
            name: [
                [str(owner.name), not isinstance(time, Constant)]
                for owner, time in zip(channels.owners, channels.times, strict=True)
            ]
            for name, channels in (("loads", system.loading), ("actuators", system.couplings))
        }
        self.writer = HistoryWriter(described, static, path)
        self.notices = notices
        self.count = 0
        self._work = 0.0
        self._spent = np.zeros(2, np.int64)
        self._before: tuple[Floats, Floats] | None = None

    def take(
        self,
        point: Point,
        parameter: float,
        force: Floats,
        residual: float,
        stability: Stability | None,
        kind: str = "regular",
        later: tuple[int, int] = (0, 0),
    ) -> None:
        """Record a point, with the iterations and solves since the last one, failed ones too.

        Not with `later` ones, which are of the next point.
        """
        solver = self.solver
        system = self.solver.system
        effort = np.array([solver.iterations, solver.attempts]) - self._spent - later
        self._spent += effort
        q = point.y[: system.rows].reshape(-1)
        amplitudes = solver.schedule.at(point.t)
        zero = np.zeros(system.n)
        loads = load_force(system, point.y, amplitudes).reshape(-1)
        if self._before is not None:  # work by the trapezoidal rule between the points
            q0, before = self._before
            self._work += float((before + loads) @ (q - q0)) / 2
        self._before = q, loads
        excess = float(strain_excess(system, q[None], amplitudes=amplitudes.loads)[0])
        row = {
            "t": float(parameter),
            "step": self.count,
            "q": q,
            "p": zero,
            "carried": zero,
            "fresh": 1.0,
            "constraint_force": np.asarray(force, float),
            "load_factor": float(point.t),
            "unstable": -1 if stability is None else stability.unstable,
            "critical": CODES[kind],
            "newton_iterations": int(effort[0]),
            "attempts": int(effort[1]),
            "residual": residual,
            "work_loads": self._work + excess,
            "amplitudes/loads": amplitudes.loads,
            "amplitudes/actuators": amplitudes.actuators,
            "amplitudes/spin": amplitudes.turning,
        }
        if system.couplings.angles:
            row["turns"] = system.couplings.untouched if point.turns is None else point.turns
        self.writer.append(row)
        self.count += 1

    def close(self, status: str, **extra: Any) -> History:
        """Close the file and give the history."""
        self.writer.close(status, **extra, warnings=self.notices.kept())
        return self.writer.history()

    def so_far(self) -> History:
        """Points so far, where an error of the user's own code has ended the path."""
        return self.writer.history() if self.writer.closed else self.close("failed")


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
#: how often a step is halved to locate the critical points in it
LOSSES = 6
#: what to do about limit points
BEYOND = "follow the path with ArcLength() or DisplacementControl(), which pass limit points"

Callback = Callable[[Point], object]


@dataclass
class _Step:
    """A step along a path to a point that was solved for.

    Attributes
    ----------
    start : Point
    solution : Solution
    functional : Functional
    length : float
        Of the control's parameter.
    turn : float
        Largest rotation of a node (rad).
    jumps : bool
        Whether the point is much farther away than the tangents lead.
    relaxed : bool
        Whether it was found in spite of a singular stiffness there.
    end : Stability or None
    critical : list of Critical
        Found on the way.
    lost, unsought : bool
        Whether a critical point is missing; whether none was looked for.
    """

    start: Point
    solution: Solution
    functional: Functional
    length: float
    turn: float
    jumps: bool
    relaxed: bool = False
    end: Stability | None = None
    critical: list[Critical] = field(default_factory=list)
    lost: bool = False
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
        self.point = first
        try:
            point = self._started(first) if direction is None else first
            held = not self.solver.schedule.moving
            self.point = point
            stage = branch_stage(self.system, self.control, point, direction, held)
            self.limit = None if stage.fixed else self.control.turn
            self._begin(point, stage, direction)
            while not stage.finished(point):
                asked, point = self._advance(point, stage)
                self.point = point
                show(stage.parameter, point.t)
                if not asked and not self.control.all_points and not interrupt.asked:
                    continue
                answers = [callback(point) for callback in callbacks]  # all are called
                if interrupt.asked:
                    return "interrupted", None
                if any(isinstance(answer, (bool, np.bool_)) and answer for answer in answers):
                    return "stopped", None
        except KeyboardInterrupt:
            return "interrupted", None
        except Diverged as error:
            return "diverged", error
        return "completed", None

    # -- start -------------------------------------------------------------------------------------

    def _started(self, first: Point) -> Point:
        """The equilibrium near a start, in which no motion is free."""
        solver, point, where = self.solver, first, "at the start"
        report = None
        loose = self._loose(first)
        if not solver.balanced(first):
            solution = None
            if loose is None:
                solution, report = solver.settled(first)
            if solution is None:
                solution, report = solver.relaxed(first, Functional())
            if solution is not None:
                report = None
                point = solution.point
                where = "in the equilibrium to which the loads of the start lead"
                loose = self._loose(point)
        if loose is not None:
            loaded = solver.schedule.at(point.t).loads.any()
            loads = "" if loaded else "with loads that act from the start (factors={name: 1.0}), "
            item, motion = loose
            raise InputError(
                item,
                f"can move freely {where} ({motion}): hold it with joints or springs, {loads}or"
                " start from a state whose stresses do (a guess of it,"
                " start=initial_state(system, q))",
            )
        if report is not None:
            raise self._failure(first, report, "the start is no equilibrium")
        return point

    def _loose(self, point: Point) -> tuple[str, str] | None:
        """An item that nothing holds at an equilibrium, and how it moves."""
        if not self.system.unknowns:
            return None
        if self._stability is None or self._stability.point is not point:
            self.solver.look(point)
            self._stability = self._inspected(point)
        return self._stability.free_motion(self.system)

    def _inspected(self, point: Point) -> Stability:
        """Stability of an equilibrium, by the pivots of its stiffness if they tell."""
        amplitudes = self.solver.schedule.at(point.t)
        found = inspect(self.system, point, amplitudes, self.solver.pivots(point))
        found.unstable = found.firmly_unstable
        return found

    def _begin(self, point: Point, stage: Stage, direction: Floats | None) -> None:
        solver = self.solver
        force = solver.look(point)
        stability = self._stability if direction is None else self._inspected(point)
        if stability is not None and (self.watch or direction is not None):
            solver.neutral = stability.neutral_motions(self.system, direction)
        # at a critical point the number of unstable motions is one or the other
        self._stability = stability if self.watch and direction is None else None
        self._first = self._stability
        self.recorder.take(point, stage.parameter, force, 0.0, self._stability)
        if direction is None and isinstance(self.control, ArcLength):
            try:
                stage.aim(solver.rate(point))
            except SingularMatrixError:  # at a critical point a step of the load factor has to do
                logger.debug("no tangent at the start")

    # -- a step ------------------------------------------------------------------------------------

    def _advance(self, point: Point, stage: Stage) -> tuple[bool, Point]:
        """Whether the next point is one that was asked for, and that point."""
        limit = self.limit
        losses = 0
        residuals: list[list[float]] = []
        while True:
            length = self._prescribed(point, stage.trial())
            step, report = self._tried(point, stage, length, residuals)
            shorter = 0.5
            if step is not None:
                if limit is None or (not step.jumps and step.turn <= limit):
                    self._look(step)
                    if not step.lost or limit is None or losses == LOSSES:
                        break
                    # it may have landed on another branch: a shorter step shows
                    losses += 1
                elif not step.jumps:
                    shorter = max(0.5, 0.8 * limit / step.turn)
                report.reason = "in the shortest step it jumps to a point far away"
            self.rejected += 1
            stage.length = shorter * length
            if abs(stage.length) < stage.shortest:
                raise self._failure(point, report, "the path cannot be continued", residuals)
        self._end_at_crossing(step)
        self._warn_of_step(step)
        asked = self._accept(step, stage)
        if limit is not None and step.turn > 0:
            # a step that would turn too far is not tried
            most = 0.95 * limit / step.turn * abs(length)
            stage.length = float(np.sign(stage.length)) * min(abs(stage.length), most)
        return asked, step.solution.point

    def _tried(
        self, point: Point, stage: Stage, length: float, residuals: list[list[float]]
    ) -> tuple[_Step | None, NewtonReport]:
        """A step of this length to a point, by what else there is where Newton's method fails."""
        functional = stage.functional(point, length)
        solution, report = self._solve(point, functional)
        residuals.append(report.residuals)
        rate = np.zeros((self.system.rows, 3)) if self._rate is None else self._rate
        if solution is None and functional.predictor is None:
            # at a critical point the tangent does not say where to go: on as before
            functional = replace(functional, predictor=length * rate)
            solution, report = self._solve(point, functional)
            residuals.append(report.residuals)
        given = functional.gradient is None and stage.stops
        relaxed = bool(solution is None and given and length == stage.stops[0] - stage.parameter)
        if relaxed:
            # a point that is asked for may be a critical one
            solution, other = self.solver.relaxed(point, Functional(value=length))
            if solution is None or self._moved(point, solution) > max(
                NEAR, JUMP * size_of(self.system, length * rate)
            ):
                return None, report
            report = other
        if solution is None:
            return None, report
        turn = rotation(self.system, point.y, solution.point.y)
        jumps = self._jumps(point, solution)
        return _Step(point, solution, functional, length, turn, jumps, relaxed), report

    def _solve(self, point: Point, functional: Functional) -> tuple[Solution | None, NewtonReport]:
        """Solve for the next point; if that fails, once more with the motions that nothing holds.

        The first solve leaves these alone. Else each step would move along them by rounding over
        rounding, and how far, or whether its iteration shows it, is luck.
        """
        solver = self.solver
        neutral = self.solver.neutral
        solution, report = solver.solve(point, functional)
        if solution is None and neutral.motions:
            solver.neutral = Neutral()
            solution, report = solver.solve(point, functional)
            solver.neutral = neutral
        return solution, report

    def _look(self, step: _Step) -> None:
        """Look at the stability of a step's end, and for critical points on the way to it."""
        point = step.solution.point
        before = self._stability
        if not self.watch or step.relaxed:
            return  # what is critical there is looked for in the next step
        step.end = stability = self._inspected(point)
        if before is None or stability.unstable == before.unstable:
            return
        force = step.solution.constraint_force
        loads = self.solver.schedule.at(point.t).loads
        step.unsought = overstretched_at(self.system, point.y, force, loads) is not None
        if step.unsought:  # motions of the mesh are unstable
            return
        found = locate_all(self.solver, before, stability)
        if isinstance(self.control, LoadControl):
            # others belong to parts of the path that were passed before, or to other branches
            low, high = sorted((before.point.t, point.t))
            found = [c for c in found if low <= c.stability.point.t <= high or c.kind == "limit"]
        step.critical = found
        step.lost = (found[-1].after if found else before).crossed(stability)

    def _end_at_crossing(self, step: _Step) -> None:
        """Cut a step of the arc length at the load factor where the path ends, if it is crossed."""
        until = self.control.until if isinstance(self.control, ArcLength) else None
        ends = [*(each.stability.point for each in step.critical), step.solution.point]
        for k, end in enumerate(ends):
            if until is None or (step.start.t - until) * (end.t - until) >= 0:
                continue
            start = step.start if k < len(step.critical) else end
            exact, report = self.solver.solve(start, Functional(value=until - start.t))
            if exact is None:
                raise self._failure(start, report, "the end of the path was not found")
            step.solution = exact
            step.critical = step.critical[:k]
            step.end = self._inspected(exact.point) if self.watch else None
            return

    def _accept(self, step: _Step, stage: Stage) -> bool:
        """Accept a point, after the critical ones that were passed; says whether it was asked."""
        start, solution, parameter = step.start, step.solution, stage.parameter
        asked = stage.accept(start, solution.point, step.length)
        gained = stage.parameter - parameter
        own = solution.report.iterations, 1
        for found in step.critical:
            point = found.stability.point
            at = parameter + gained * step.functional.share(start, point)
            entry = {"kind": found.kind, "load_factor": point.t, "state": self.recorder.count}
            self.critical.append({**entry, "multiplicity": found.multiplicity})
            logger.info("%s point at load factor %.9g", found.kind, point.t)
            force = found.constraint_force
            self.recorder.take(point, at, force, 0.0, found.stability, found.kind, own)
            loaded = isinstance(self.control, LoadControl) and self.limit is not None
            if found.kind == "limit" and loaded:
                reason = (
                    f"the load factor has a limit point, {point.t:.9g}: beyond it there is no"
                    " equilibrium near"
                )
                where = f"load factor {point.t:.9g}"
                raise Diverged(point.t, self.recorder.count, 0.0, reason, BEYOND, at=where)
        if step.end is not None:
            self._stability = step.end
            self.solver.neutral = step.end.neutral_motions(self.system)
        rows = self.system.rows
        self._rate = (solution.point.y[:rows] - start.y[:rows]) / step.length
        if asked or self.control.all_points:
            force = solution.constraint_force
            residual = solution.report.residual
            self.recorder.take(solution.point, stage.parameter, force, residual, self._stability)
        stage.adapt(solution.report.iterations, step.length)
        return asked

    def _moved(self, point: Point, solution: Solution) -> float:
        """Size of the motion to a solution."""
        return size_of(self.system, (solution.point.y - point.y)[: self.system.rows])

    def _jumps(self, point: Point, solution: Solution) -> bool:
        """True if a point is much farther away than the tangents lead: on another branch."""
        change = solution.point.t - point.t
        motion = self._moved(point, solution)
        first = self._first
        last = self._stability
        if first is not None and last is not None and last.pivot <= CRITICAL * first.pivot:
            # tangents of a limit point lead anywhere, what goes on from there moves less at once
            near, _ = self._solve(point, Functional(value=SHORT * change))
            self._solve(point, Functional(value=change))  # is the last one again
            if motion > NEAR and (near is None or self._moved(point, near) > motion / 2):
                return True
        if motion <= max(NEAR, JUMP * size_of(self.system, solution.predicted)):
            return False
        try:
            rate = self.solver.rate()
        except SingularMatrixError:
            return False
        # loads that set in slowly move nothing at first
        return motion > JUMP * abs(change) * size_of(self.system, rate)

    def _prescribed(self, point: Point, length: float) -> float:
        """A step in which prescribed motion turns no farther than its rotation can be told."""
        if not self.solver.schedule.moving or not isinstance(self.control, LoadControl):
            return length
        for _ in range(40):
            if prescribed_turn(self.system, point.t, point.t + length) <= 1.0:
                break
            length /= 2
        return length

    # -- what is told of a path --------------------------------------------------------------------

    def _warn_of_step(self, step: _Step) -> None:
        """Say what is doubtful about a step."""
        start = step.start.t
        end = step.solution.point.t
        between = f"between the load factors {start:.6g} and {end:.6g}"
        limits = [each for each in step.critical if each.kind == "limit"]
        doubts = (
            (
                step.lost,
                IncompleteWarning,
                f"a critical point {between} was not located",
            ),
            (
                step.unsought,
                IncompleteWarning,
                f"critical points are not looked for from load factor {start:.6g} on: elements are"
                " drawn so much that node rotations of this mesh are unstable as well; refine",
            ),
            (
                self.limit is None and bool(limits) and isinstance(self.control, LoadControl),
                AccuracyWarning,
                "there is a limit point: the path jumps to another branch",
            ),
            (
                self.limit is None and step.jumps and not step.critical,
                AccuracyWarning,
                f"from load factor {start:.6g} on the point is much farther away than the tangents"
                " at both ends lead: the step may have passed a limit point and jumped to another"
                " branch; take shorter steps, or ArcLength() or DisplacementControl()",
            ),
        )
        for found, category, text in doubts:
            if found:
                warn("path", text, category, end)

    def _limp(self) -> bool:
        """True if the stiffness of some motion is nearly lost."""
        first = self._first
        last = self._stability
        if first is None or last is None or not (first.symmetric and last.symmetric):
            return False
        return first.smallest > first.floor and last.smallest <= LIMP * first.smallest

    def _failure(
        self,
        point: Point,
        report: NewtonReport,
        what: str,
        residuals: list[list[float]] | None = None,
    ) -> Diverged:
        """Why the path ends, and what to do."""
        found = report.reason
        advice = "try shorter steps, then a finer mesh"
        y = self.solver.ended.y
        forces = self.system.couplings.forces(y, np.zeros_like(y)) if np.isfinite(y).all() else []
        slack = [item.label for item, _, force in forces if item.slack and not force.any()]
        if drawn := overstretched(self.system, point.y, self.solver.schedule.at(point.t).loads):
            found = f"{drawn}. Newton's method: {found}"
            advice = "refine the mesh there"
        elif not self.recorder.count:
            advice = "start nearer to an equilibrium"
        elif slack:
            found += f"; the {slack[0]} is slack where that ended"
            advice = "hold by something else what it held"
        elif isinstance(self.control, DisplacementControl) and UNMOVED in found:
            place = self.control.place.label
            way = self.control.direction.round(6).tolist()
            advice = f"the loads do not move {place} along {way}: choose what they move"
        elif isinstance(self.control, LoadControl):
            advice = f"{BEYOND}; else try a finer mesh"
            with suppress(ArithmeticError, ValueError, RuntimeError):
                if self._limp():
                    found = f"a limit point is near. Newton's method: {found}"
                    advice = BEYOND
        soft = {limp(beam): None for beam in filter(is_beam, self.system.structures)}
        return Diverged(
            point.t,
            max(1, self.recorder.count),
            report.residual,
            f"{what}: {found}",
            "".join([advice, *soft]),
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
        check_kind("argument treatment", treatment, Treatment)
        check_kind("argument control", control, Control)
        check_kind("argument settings", settings, NewtonSettings)
        if path is not None:
            file_path(path)
        if not isinstance(callbacks, Sequence) or not all(map(callable, callbacks)):
            raise InputError("argument callbacks", f"{callbacks!r}, expected a list of functions")
        derive = checked_asked(derive, system, path_formulas)
        schedule = Schedule(system, factors, spin, time)
        check_growth(schedule, control)
        first, direction = first_point(system, schedule, start)
        refused = static_refusal(system, treatment)
        choice = choose(kernels, kernel_coordinates(system, treatment), refused, solver=solver)
        points = PathSolver(system, treatment, schedule, settings, choice, solver)
        continuation = Continuation(system, points, control, watch and system.unknowns > 0)
        show = Progress(progress, "parameter {:.6g}, load factor {:.6g}".format)
        about: Meta = {"treatment": treatment.name, "parameter": control.parameter}
        about |= {"solver": points.method, "unknowns": points.bound.unknowns}
        about |= {"kernels": points.choice.name, "kernels_why": points.choice.why}
        recorder = PathRecorder(points, about, path, notices)
        try:
            with Interrupt() as interrupt:
                with show:
                    status, failure = continuation.run(
                        first, direction, recorder, callbacks, show, interrupt
                    )
                if failure is None:
                    found = recorder.writer.history()
                    found.derive_by([system], path_formulas)
                    checks.apply(checks.Path([system], found))
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
        except BaseException as error:
            if recorder.count:
                take_along(error, recorder.so_far, [system])
            raise
        if failure is not None:
            failure.history = history
            raise failure
        return history
