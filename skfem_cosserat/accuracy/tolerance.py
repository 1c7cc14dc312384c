"""A tolerance is enough: mesh, order and step of a run are found for the errors allowed."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from ..analysis.progress import Interrupt, Progress
from ..arguments import checked
from ..beam import Beam
from ..errors import CosseratError, Diverged, InputError, MeshError, ModelWarning
from ..history import History
from ..integrators import Integrator, State
from ..model import Model, System, model_of
from ..notebook import Shown
from ..statics import Control
from ..types import TOLERANCE, Array, Floats, positive
from ..warn import Notice, Notices, counted, repeat
from .orders import left
from .scene import Asked, Case, NotHere, Run, Scene
from .simplification import Simpler, simplified

#: a run has no more steps, no beam is divided more often, and so many runs fail in a row
MOST_STEPS, MOST_PARTS, MOST_FAILURES = 2**18, 64, 4


class Band(float):
    """Estimated error of a value, in its unit: a number, with its parts.

    Attributes
    ----------
    step, mesh : float
        What the step and the mesh bring in.
    """

    def __new__(cls, step: float, mesh: float) -> Band:
        """The sum of both parts."""
        band = super().__new__(cls, step + mesh)
        band.step = step
        band.mesh = mesh
        return band

    step: float
    mesh: float


@dataclass(frozen=True, eq=False)
class Answer(Shown):
    """Result of :func:`answer`.

    Attributes
    ----------
    reached : bool
        Whether twice the estimated error of each quantity is within its tolerance.
    reason : str
        Why not; empty if it is.
    times : (K,) array
        Instants (s) of the values over time.
    values : dict of str to array
        Of each quantity: over time, or one for the whole run; of equilibria at the end of the path.
    band : dict of str to Band
        Estimated error of each quantity in its unit (the largest over time), with its parts `step`
        and `mesh`.
    history : History or None
        The run that the values are of; None if no run came to its end.
    model : Model
        The scene on the mesh of that run.
    step : float
        Its step (s); NaN for equilibria.
    runs : int
        Runs that were made.
    cost_s, cost_of_run_s : float
        Processor time (s) of all runs, and of that one.
    warnings : list of dict
        As in ``history.meta["warnings"]``; and that an equilibrium is unstable.
    tolerance : dict of str to float
    """

    reached: bool
    reason: str
    times: Floats
    values: dict[str, Array]
    band: dict[str, Band]
    history: History | None
    model: Model
    step: float
    runs: int
    cost_s: float
    cost_of_run_s: float
    warnings: list[Notice]
    tolerance: dict[str, float]
    _of: tuple[Scene, Run, Case] | None

    def simpler(self) -> Simpler:
        """Parts of the scene that can be left out: :class:`~skfem_cosserat.accuracy.Simpler`.

        Raises
        ------
        InputError
            If there is no run, the tolerance is not reached, or the scene is at rest.
        """
        if self._of is None or self.history is None or not self._of[0].moves:
            raise InputError("answer", "has no motion that could be had more simply")
        if not self.reached:
            raise InputError("answer", "is not within its tolerance: nothing of it may be left out")
        return simplified(*self._of, self.band)

    def summary(self) -> dict[str, Any]:
        """What it says as text."""
        return {"answer": str(self)}

    def __repr__(self) -> str:
        return f"<Answer: {'reached' if self.reached else 'not reached'}, {self.runs} runs>"

    def __str__(self) -> str:
        """At most eight lines."""
        lines = ["within the tolerance" if self.reached else f"not reached: {self.reason}"]
        for name in sorted(self.band, key=lambda n: -self.band[n] / self.tolerance[n])[:4]:
            band = self.band[name]
            value = np.asarray(self.values[name])
            last = value[-1] if len(self.times) and value.ndim and len(value) > 1 else value
            shown = np.array2string(np.asarray(last), precision=6, threshold=6)
            error = "error unknown"
            if np.isfinite(band):
                parts = f"step {band.step:.1e}, mesh {band.mesh:.1e}"
                error = f"error about {band:.1e} ({parts})"
            lines.append(
                f"{name}: {shown} at the end, {error}, tolerance {self.tolerance[name]:.1e}"
            )
        if len(self.band) > 4:
            lines.append(f"and {len(self.band) - 4} quantities with smaller parts of theirs")
        made = "" if self.history is None else f"{self._run()}; "
        lines.append(f"{made}{self.runs} runs took {self.cost_s:.2g} s of processor time")
        if self.warnings:
            lines.append(f"the run gave{counted(self.warnings).lstrip(',')}: see warnings")
        return "\n".join(lines)

    def _run(self) -> str:
        beams = [item for name in self.model if isinstance(item := self.model[name], Beam)]
        mesh = [
            f"{beam.name}: {beam.mesh.nelements} element{'s' * (beam.mesh.nelements > 1)} of order"
            f" {beam.basis.order}"
            for beam in beams[:2]
        ]
        mesh += [f"{len(beams) - 2} more beams"] * (len(beams) > 2)
        steps = [] if np.isnan(self.step) else [f"steps of {self.step:.3g} s"]
        return f"run: {', '.join(steps + mesh) or 'at rest'} ({self.cost_of_run_s:.2g} s)"


@checked
def answer(
    model: Model | System,
    quantities: Mapping[str, Any],
    tolerance: float | Mapping[str, float],
    until: float | None,
    *,
    start: State | Callable[[System], State] | None = None,
    integrator: Integrator | Control | None = None,
    budget_s: float | None = None,
    progress: bool | Callable[..., object] | None = None,
) -> Answer:
    """Find mesh and step for a tolerance: values, each with an estimate of its error.

    A run on a poor mesh, one with half of its step and one with the next order of elements tell
    which part of the error comes from where; that part is refined, until twice the estimated error
    is within the tolerance. The run with the shorter step is the result.

    Parameters
    ----------
    model : Model or System
        Its own meshes do not matter: beams are divided anew, first into as few elements as their
        lines have parts. It does not change.
    quantities : dict of str to quantity
        Sensors, which count at all steps; :class:`~skfem_cosserat.accuracy.Component` and
        :class:`~skfem_cosserat.accuracy.Maximum` of sensors; conditions and events, whose time (s)
        is the value, and which act in the run (functions in them may have places of `model`); names
        of series (``"energy"``); functions of ``(history)`` or ``(model, history)``, such as
        ``lambda model, path: sc.modes(model, path, 3).frequencies``.
    tolerance : float or dict of str to float
        Largest error, in the unit of each quantity; of a vector its Euclidean length. Infinite: the
        quantity is not judged, as of an event that only has to act.
    until : float or None
        End of the run (s); None: the equilibrium under the loads.
    start : State or function, optional
        A state of `model`, or a function that gives that of a system; default: as in `simulate` and
        `static`.
    integrator : Integrator or Control, optional
        Default: ``EnergyMomentum()``; of equilibria how the path goes, ``LoadControl()``.
    budget_s : float, optional
        Processor time (s): no run is begun that would go beyond it.
    progress : bool or callable, optional
        True: one line on stderr; a callable gets (number of runs, error in tolerances), and ends
        the search by what it raises.

    Returns
    -------
    Answer
        Not `reached`, with the reason, where values do not converge, where runs part faster than
        errors shrink (chaos), or where the budget is spent or Ctrl-C was pressed: with the best so
        far.

    Raises
    ------
    InputError
        For bad arguments, before the first run.

    Notes
    -----
    Within a step of the instants where loads jump or events change the scene nothing is compared.
    Functions of time are asked at 4096 instants or more before the first run, which takes steps
    that see what they do: what is shorter needs its `kinks`, see
    :class:`~skfem_cosserat.FunctionOfTime`.

    Examples
    --------
    A rubber rod swings down from a hinge; where is its end, to a millimetre?

    >>> import skfem_cosserat as sc
    >>> mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 16, name="rod")
    >>> rubber = sc.SectionCircle(radius=1e-2, material=sc.Material(E=5e6, nu=0.5, rho=1100))
    >>> model = sc.Model()
    >>> rod = model.add("rod", sc.Beam(mesh, rubber, director=(0, 1, 0)))
    >>> pin = sc.JointRevolute(sc.ground((0, 0, 0)), rod.node("rod.start"), axis=(0, 0, 1))
    >>> pin, weight = model.add("hinge", pin), model.add("weight", sc.LoadGravity((0, -9.81, 0)))
    >>> end = sc.SensorPosition(rod.node("rod.end"))
    >>> found = sc.answer(model, {"end": end}, tolerance=1e-3, until=0.3)
    >>> found.reached, float(found.band["end"]) < 5e-4
    (True, True)
    """
    asked = Asked(quantities, tolerance)
    budget = np.inf
    if budget_s is not None:
        budget = positive("argument budget_s", "value", budget_s, " of seconds")
    scene = Scene(model_of(model), asked, until, start, integrator)
    line = "{} runs, error about {:.2g} tolerances".format
    with (
        Progress(False if progress is None else progress, line) as show,
        Interrupt("the best so far is handed back") as interrupt,
    ):
        found = _Search(scene, budget, interrupt, show).found()
    repeat(found.warnings)
    return found


# -- the search ------------------------------------------------------------------------------------


class _Ended(Exception):
    """No further run is made, and why."""


class _Search:
    def __init__(self, scene: Scene, budget: float, interrupt: Interrupt, show: Progress):
        self.scene, self.budget, self.interrupt, self.show = scene, budget, interrupt, show
        self.tolerance = scene.asked.tolerance
        #: quantities that are judged
        self.judged = [name for name, limit in self.tolerance.items() if np.isfinite(limit)]
        self.runs: dict[Case, Run | None] = {}
        #: processor time (s) of each, also of those that failed
        self.costs: dict[Case, float] = {}
        self.count = 0
        self.spent = 0.0
        #: what made the last run fail, and how many have failed without a pair that came through
        self.error: Exception | None = None
        self.failures = 0
        #: the run that is handed back, its errors and its case
        self.best: tuple[Run, dict[str, Band], Case] | None = None
        #: errors by the step, in tolerances, by the number of steps
        self.seen: dict[int, float] = {}

    def tried(self, case: Case) -> Run | None:
        """The run of a case, made once; None if it fails."""
        if case not in self.runs:
            before, cost = next(reversed(self.costs.items()), (case, 0.0))
            expected = cost * case.work / before.work
            if self.spent + expected > self.budget:
                raise _Ended(
                    f"{self.spent:.2g} s are spent, and the next run may take {expected:.2g} s,"
                    f" beyond the budget of {self.budget:g} s"
                )
            spent = self.spent
            self.runs[case] = self.made(case)
            self.costs[case] = self.spent - spent
        return self.runs[case]

    def made(self, case: Case, nudge: float = 0.0) -> Run | None:
        """A run; None if it fails."""
        if self.interrupt.asked:
            raise _Ended("it was interrupted")
        begun = time.process_time()
        run = None
        try:
            with Notices(quiet=True, alone=True):
                run = self.scene.run(case, nudge)
        except (CosseratError, ArithmeticError) as error:
            of_quantity = isinstance(error, InputError) and error.item.startswith("quantity ")
            if of_quantity and not isinstance(error, NotHere):
                raise
            self.error, self.failures = error, self.failures + 1
            if self.failures == MOST_FAILURES:  # neither mesh nor step changes it
                if isinstance(error, NotHere) and self.best is None:
                    raise InputError(error.item, error.message) from error
                raise _Ended(self.stuck()) from error
        self.spent += time.process_time() - begun
        self.count += 1
        if run is not None and run.history.status == "interrupted":
            raise _Ended("it was interrupted")
        return run

    def found(self) -> Answer:
        """The answer."""
        try:
            reason = self.motion() if self.scene.moves else self.rest()
        except _Ended as ended:
            reason = str(ended)
        except KeyboardInterrupt:
            reason = "it was interrupted"
        if self.best is not None and not reason:
            unknown = [name for name in self.judged if not self.best[0].values[name].finite]
            if unknown:
                reason = f"{unknown[0]!r} is not a number: an event that does not happen, or a NaN"
        return self.answer(reason)

    def rest(self) -> str:
        """Equilibria: order after order, until the difference of two is small enough, and fell."""
        case = Case(1, 2, 0)
        before = np.inf
        coarse = None
        while case.parts <= MOST_PARTS:
            fine = self.tried(case)
            if fine is None:
                coarse, before, case = None, np.inf, case.finer
                continue
            self.failures = 0
            gaps = dict.fromkeys(fine.values, 0.0 if not self.scene.beams else np.inf)
            if coarse is not None and self.scene.beams:
                gaps = _largest(coarse.distances(fine))
            self.best = fine, {name: Band(0.0, gap) for name, gap in gaps.items()}, case
            size = self.size(gaps)
            self.show(self.count, size)
            if 2 * size <= 1 and (size <= before < np.inf or not self.scene.beams):
                return ""
            coarse, before, case = fine, size, case.richer
        return self.stuck()

    def motion(self) -> str:
        """Motions: a shorter step or a richer mesh, or both where both matter."""
        counts = [64 * 2**k for k in range(9)]  # what needs more is hardly meant
        begun = time.process_time()
        count, unseen = self.scene.steps_that_see(counts)
        self.spent += time.process_time() - begun
        case = Case(1, 2, counts[0] if unseen else count)
        while case.steps <= MOST_STEPS and case.parts <= MOST_PARTS:
            coarse = self.tried(case)
            fine = None if coarse is None else self.tried(case.shorter)
            if coarse is None or fine is None:
                coarse_mesh = isinstance(self.error, (MeshError, NotHere))
                bent = isinstance(self.error, Diverged) and self.scene.beams and self.failures % 2
                case = case.finer if coarse_mesh or bent else case._replace(steps=4 * case.steps)
                continue
            self.failures = 0
            mesh = dict.fromkeys(self.tolerance, 0.0)
            if self.scene.beams:
                rich = self.tried(case.richer)
                if rich is None:
                    case = case.finer
                    continue
                mesh = _largest(coarse.distances(rich))
            step, order = self.step_errors(case, coarse, fine)
            if 2 * self.size(step, mesh) <= 1 and case.longer not in self.runs:
                self.tried(case.longer)  # a third step tells whether the two agree by chance
                step, order = self.step_errors(case, coarse, fine)
            band = {name: Band(step[name], mesh[name]) for name in step}
            self.best, size = (fine, band, case.shorter), self.size(step, mesh)
            self.show(self.count, size)
            if 2 * size <= 1 and unseen:  # an event may have ended the motion long before
                steps, end = fine.history["step"][-1], fine.history.times[-1]
                unseen = self.scene.steps_that_see([max(int(steps), 1)], end)[1]
            if 2 * size <= 1:
                what = f"its steps do not see what {unseen} does between their ends"
                return what if unseen else ""
            by_step = self.size(step)
            by_mesh = self.size(mesh)
            if by_step > 0.25:
                if reason := self.doubt(case, coarse, fine, by_step):
                    return reason
                halvings = np.log2(min(by_step, 1e9) / 0.2) / order
                case = case._replace(steps=case.steps * 2 ** int(np.ceil(halvings).clip(1, 3)))
            if by_mesh > 0.25:
                for _ in range(2 if by_mesh > 10 else 1):
                    case = case.richer
        return self.stuck()

    def size(self, *errors: Mapping[str, float]) -> float:
        """The largest sum of errors in units of its tolerance."""
        sizes = [sum(e[name] for e in errors) / self.tolerance[name] for name in self.judged]
        return max(sizes, default=0.0)

    def step_errors(self, case: Case, coarse: Run, fine: Run) -> tuple[dict[str, float], float]:
        """Errors of the finer run by its step, and the least order by which they fall.

        From the difference of both runs by the order of the integrator (1, where something jumps
        within a step), or by a lower one that is seen if a run with twice the step is known: then
        the larger of what the two differences tell.
        """
        between = _largest(coarse.distances(fine))
        highest = 1.0 if len(coarse.jumps) else float(self.scene.order)
        half = self.runs.get(case.longer)
        before = between if half is None else _largest(half.distances(coarse))
        errors = {}
        orders = [highest]
        for name, last in between.items():
            first = before[name]
            order = highest
            if half is None:
                first = 0.0
            elif first > 0 < last:
                order = float(np.log2(first / last).clip(0.5, highest))
            orders.append(order)
            errors[name] = left(max(last, first / 2**order), order)
        return errors, min(orders)

    def doubt(self, case: Case, coarse: Run, fine: Run, error: float) -> str:
        """Reason why shorter steps do not help (chaos, errors that do not fall), or nothing."""
        if self.seen.setdefault(case.steps, error) != error or error < 1:
            return ""  # only the mesh has changed, or little is missing
        falls = [later < 2 * before / 3 for before, later in pairwise(self.seen.values())]
        if not falls or falls[-1]:
            return ""
        moved = TOLERANCE * self.scene.system.length
        nudged = self.made(case.shorter, moved)
        if nudged is not None:
            parted = self.within(fine.distances(nudged))
            if parted < self.scene.begun + self.scene.span:
                known = self.within(coarse.distances(fine), 2.0)
                return (
                    f"the motion is chaotic: starts that are {moved:.0e} m apart part by more than"
                    f" the tolerance after t = {parted:.3g} s; with {2 * case.steps} steps values"
                    f" are within it up to t = {known:.3g} s"
                )
        if len(falls) > 2 and not any(falls[-3:]):
            return (
                f"values do not converge: the error by the step is {error:.1e} tolerances with"
                f" {2 * case.steps} steps, no less than with fewer"
            )
        return ""

    def within(self, distances: Mapping[str, tuple[Floats, Floats]], factor: float = 1.0) -> float:
        """Time (s) up to which distances, times a factor, are within all tolerances."""
        ends = []
        for name in self.judged:
            t, gap = distances[name]
            beyond = np.flatnonzero(factor * gap > self.tolerance[name])
            ends.append(t[max(beyond[0] - 1, 0)] if len(beyond) else np.inf)
        return float(min(ends))

    def stuck(self) -> str:
        """Reason why no finer case is tried."""
        if self.best is None and self.error is not None:
            return f"no run came to its end: {type(self.error).__name__}: {self.error}"
        return f"more than {MOST_STEPS} steps or {MOST_PARTS} times the poorest mesh are needed"

    def answer(self, reason: str) -> Answer:
        """The best run so far as an answer."""
        best = self.best
        for last, done in self.runs.items() if best is None else ():
            if done is not None:
                best = done, dict.fromkeys(self.tolerance, Band(np.inf, np.inf)), last
        run, band, case = best or (None, {}, None)
        values = {} if run is None else run.values
        times = [each.times for each in values.values() if each.times is not None]
        history = None if run is None else run.history
        return Answer(
            reached=not reason,
            reason=reason,
            times=times[0] if times else np.zeros(0),
            values={name: each.values for name, each in values.items()},
            band=band,
            history=history,
            model=self.scene.model if run is None else run.model,
            step=self.scene.span / case.steps if case and case.steps else np.nan,
            runs=self.count,
            cost_s=self.spent,
            cost_of_run_s=np.nan if run is None else run.cost_s,
            warnings=[] if history is None else _told(history),
            tolerance=self.tolerance,
            _of=best and (self.scene, best[0], best[2]),
        )


def _largest(distances: Mapping[str, tuple[Floats, Floats]]) -> dict[str, float]:
    """The largest distance of each quantity."""
    return {name: float(gap.max(initial=0.0)) for name, (_, gap) in distances.items()}


def _told(history: History) -> list[Notice]:
    """Warnings of a run; and of an equilibrium that motions lead away from."""
    found = list(history.meta.get("warnings", []))
    if "unstable" in history and history["unstable"][-1] > 0:
        text = "it is unstable: smallest motions lead away from it (see path.meta['critical'])"
        found.append(
            {"category": ModelWarning.__name__, "item": "equilibrium", "text": text, "when": ""}
        )
    return found
