"""Where they fail: the stiff three-bar swing, both integrators, steps from 1e-1 to 1e-5 s.

*The motion.* Nothing but inertia drives it after the pulse. The mass goes right until the left link
and the beam are in line (event X, where the right link reverses), goes back left until the right
link and the beam are in line (here called event Y, where the left link reverses), and comes back. A
*full period* lasts until the mass passes the e2 coordinate of its start again, moving right as at
the start. (The motion is not periodic: after Y the beam buckles.)

*What counts as failed.* A step counts as failed after four attempts of up to 100 Newton iterations
with the rotation cap: from the extrapolated and from a zero increment, without and with line
search. Their residuals are kept. The energy, in terms of (q_n, p_n), counts as blown up when it
exceeds ten times its value just after the pulse; the run goes on for a while from there to see
whether steps can still be solved.

Why it fails is the subject of failure_mechanism.py.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import skfem_cosserat as sc
from skfem_cosserat import diagnostics

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from paper import failure_mechanism as mechanism
from paper import failure_report
from paper import three_bar_swing as swing
from paper.failure_mechanism import BLOW_UP, SETTINGS

Floats = NDArray[np.float64]

STEPS = (1e-1, 3e-2, 1e-2, 3e-3, 1e-3, 3e-4, 1e-4, 3e-5, 1e-5)
QUICK = 1e-3  # smallest step of the quick mode
UNTIL = 6.0  # two periods
PULSE_END = swing.PULSE["stiff"][1]
BEYOND = 2000  # Newton iterations that a run goes on after a blow-up
BLOCK = 64  # states whose energies are computed at once


class Watch:
    """Energies and turning points of a run, computed block by block.

    Attributes
    ----------
    series : (6, N) array
        Time, energy at (q_n, p_n), energy at (q_{n-1}, q_n), angle of the right and of the left
        link, e2 coordinate of the mass; up to the blow-up.
    blown : bool
        Whether the energy has blown up.
    """

    def __init__(self, system: sc.System, mean: bool, step: float) -> None:
        self.system, self.mean, self.step = system, mean, step
        links: list[Any] = [
            next(item for item in system.structures if item.name == f"{side} link")
            for side in ("right", "left")
        ]
        self._tips = [system.dofs(link.local((0, 0, 0)))[10:] for link in links]  # d3 in the plane
        self._mass = mass_dofs(system)[1]
        self._series: list[Floats] = []
        self.block: list[tuple[float, Floats, Floats, Floats]] = []
        self.reference: float | None = None
        self.blown = False

    def take(self, before: Floats, state: sc.State, momentum: Floats) -> None:
        """A state, the coordinates q_{n-1} before it, and p_n there."""
        self.block.append((state.time, before, state.q, momentum))
        if len(self.block) >= BLOCK:
            self.flush()

    def flush(self) -> None:
        """Evaluate the block."""
        if not self.block or self.blown:
            return
        t, before, q, p = (np.array(x) for x in zip(*self.block, strict=True))
        self.block = []
        pairs = np.stack([before, q], axis=1).reshape(-1, q.shape[1])
        with np.errstate(all="ignore"):
            nodal = swing._energy(self.system, q, p)
            middle = diagnostics.midpoint_energy(self.system, pairs, self.step, self.mean)[::2]
        tips = [np.arctan2(q[:, z], q[:, y]) for y, z in self._tips]
        rows = np.array([t, nodal, middle, *tips, q[:, self._mass]])
        after = np.flatnonzero(t >= PULSE_END * (1 - 1e-12))
        if self.reference is None and len(after):
            self.reference = float(nodal[after[0]])
        bad = after[~(nodal[after] <= BLOW_UP * (self.reference or np.inf))]
        self._series.append(rows[:, : bad[0] + 1] if len(bad) else rows)
        self.blown = len(bad) > 0

    @property
    def series(self) -> Floats:
        """See the class."""
        return np.concatenate(self._series, axis=1) if self._series else np.zeros((6, 0))


def mass_dofs(system: sc.System) -> Any:
    """Numbers in q of the position of the mass (3,)."""
    beam: Any = system.structures[0]
    return system.dofs(beam.node("mid"))[:3]


class Passage(NamedTuple):
    """A run, and what each of its N solved steps took.

    Attributes
    ----------
    outcome : str
        ``completed``, ``energy blow-up``, ``Newton failed`` or ``stopped, still running``.
    watch : Watch
    path : (N, 3) array
        The mass after each step (m).
    iterations, attempts : (N,) int array
    seconds : (N,) array
        CPU time of each step (s).
    good : int
        Steps until a blow-up was seen, some more than there were until it.
    error : Diverged or None
        Of a step that could not be solved.
    kernels : str
    """

    outcome: str
    watch: Watch
    path: Floats
    iterations: NDArray[np.int64]
    attempts: NDArray[np.int64]
    seconds: Floats
    good: int
    error: sc.Diverged | None
    kernels: str


def march(
    system: sc.System,
    integrator: Any,
    step: float,
    count: int,
    patience: float = 3600.0,
    every: int = 1,
    beyond: int = BEYOND,
    **options: Any,
) -> Passage:
    """Solve as many steps with the null space method, until a step fails or energy blows up.

    Parameters
    ----------
    patience : float
        Wall time (s) after which a run is stopped, which is not counted as a failure.
    every : int
        Energies are looked at after as many steps.
    beyond : int
        Newton iterations that a run goes on after a blow-up.
    **options
        Of :class:`skfem_cosserat.Stepper`.
    """
    watch, mass = Watch(system, integrator.name == "energy-momentum", step), mass_dofs(system)
    options = {"steps": count, **options}  # long runs are worth compiling for
    stepper = sc.Stepper(system, integrator, sc.NullSpace(), step, SETTINGS, **options)
    path: list[Floats] = []
    took: list[tuple[int, int, float]] = []
    outcome, error, good, spent = "completed", None, 0, 0
    start, before, state = time.perf_counter(), system.q0, sc.initial_state(system)
    try:
        while len(took) < count and spent <= beyond:
            begun = time.process_time()
            report = stepper.advance(state, (state.index + 1) * step)
            took.append((report.iterations, report.attempts, time.process_time() - begun))
            if state.index and state.index % every == 0:
                watch.take(before, state, report.momentum)
            before, state = state.q, report.state
            path.append(state.q[mass])
            if watch.blown:
                spent += report.iterations
            else:
                good = len(took)
            if time.perf_counter() - start > patience:
                outcome = "stopped, still running"
                break
    except sc.Diverged as failure:
        outcome, error = "Newton failed", failure
    watch.flush()
    iterations, attempts, times = np.array(took, dtype=float).reshape(-1, 3).T
    return Passage(
        "energy blow-up" if watch.blown else outcome,
        watch,
        np.array(path).reshape(-1, 3),
        iterations.astype(int),
        attempts.astype(int),
        times,
        good,
        error,
        stepper.choice.name,
    )


def sail(
    system: sc.System, integrator: Any, step: float, until: float, patience: float = 3600.0
) -> dict[str, Any]:
    """One run, see :func:`march`.

    Returns
    -------
    dict
        The columns of the table, where ``end_s`` is the time of the blow-up, of the last solved
        step, or the end; ``series`` (6, N) up to it: see :class:`Watch`; and ``residuals``, lists
        of the scaled residuals of a failed step, one for each attempt.
    """
    count = int(until / step * (1 + 1e-12) + 1e-9)
    start = time.perf_counter()
    run = march(system, integrator, step, count, patience)
    wall = time.perf_counter() - start
    series, error = run.watch.series, run.error
    after = np.flatnonzero(series[0] >= PULSE_END * (1 - 1e-12))
    end = float(series[0, -1]) if run.watch.blown else len(run.path) * step
    events = find_events(series)
    return {
        "integrator": integrator.name,
        "step_s": step,
        "outcome": run.outcome,
        "end_s": end,
        **events,
        **_errors(series, after, events["period_s"]),
        "solver_failed_s": None if error is None else error.time,
        "steps": round(end / step),
        "newton_iterations": int(run.iterations[: run.good].sum()),
        "steps_tried_again": int((run.attempts[: run.good] > 1).sum()),
        "wall_s": wall,
        "reason": "" if error is None else str(error),
        "series": series,
        "residuals": [] if error is None else error.residuals,
    }


def _errors(
    series: Floats, after: NDArray[np.int64], period: float | None
) -> dict[str, float | None]:
    """Largest relative deviations from the value just after the pulse, and the last energy."""
    names = ("energy_error", "energy_error_period", "energy_error_midpoint", "energy_at_end")
    if len(after) < 2:
        return dict.fromkeys(names)
    nodal, middle = series[1, after], series[2, after[1:]]
    change = abs(nodal / nodal[0] - 1)
    in_period = None if period is None else float(change[series[0, after] <= period].max())
    midpoint = float(abs(middle / middle[0] - 1).max())
    values = (float(change.max()), in_period, midpoint, float(nodal[-1] / nodal[0]))
    return dict(zip(names, values, strict=True))


def find_events(series: Floats) -> dict[str, float | None]:
    """X: the right link reverses; Y: the left one; and when the mass is back."""
    t, right, left, mass = series[0], *(np.unwrap(a) for a in series[3:5]), series[5]
    x = swing._event_x(t, right) if len(t) > 2 else None
    y = back = None
    if x is not None:
        y = swing._event_x(t[t > x], left[t > x]) if (t > x).sum() > 2 else None
    if y is not None:
        start = swing.SPAN / 2
        home = np.flatnonzero((t[1:] > y) & (mass[:-1] < start) & (mass[1:] >= start))
        if len(home):
            k = home[0]
            back = float(t[k] + (t[k + 1] - t[k]) * (start - mass[k]) / (mass[k + 1] - mass[k]))
    return {"event_x_s": x, "event_y_s": y, "period_s": back}


def main(
    steps: Any = None,
    until: float | None = None,
    integrators: Any = ("variational", "energy-momentum"),
    out: str | Path | None = None,
    quick: bool = False,
) -> dict[str, Any]:
    """Run the map.

    Parameters
    ----------
    steps : sequence of float, optional
        Step sizes (s); default: all of :data:`STEPS`, in quick mode those of 1e-3 s and above.
    until : float, optional
        End (s); default 6, in quick mode 3.
    integrators : sequence of {"variational", "energy-momentum"}
    out : path, optional
        Folder for failure_map.csv, .residuals.csv, .energy.csv, .criterion.csv and .png; the first
        three are written again after each run.
    quick : bool
        Coarse steps and a shorter table of scenes: less than a minute.

    Returns
    -------
    dict
        ``rows``: see :func:`sail`; ``period`` (s): of the finest run with energy-momentum that
        completed one; ``mechanism``, ``criterion``: see failure_mechanism.py.
    """
    chosen = [swing.choose("integrators", name, swing.INTEGRATORS) for name in integrators]
    sizes = STEPS if steps is None else tuple(steps)
    if quick and steps is None:
        sizes = tuple(h for h in STEPS if h >= QUICK * (1 - 1e-9))
    end = (3.0 if quick else UNTIL) if until is None else until
    system = swing.build("stiff")
    result: dict[str, Any] = {"rows": [], "until": end}
    for step in sorted(sizes, reverse=True):
        for integrator in chosen:
            result["rows"].append(sail(system, integrator(), step, end))
            if out is not None:
                failure_report.write(result, Path(out))
    whole = [r for r in result["rows"] if r["period_s"] and r["integrator"] == "energy-momentum"]
    result["period"] = whole[-1]["period_s"] if whole else None
    result |= mechanism.main(quick)
    if out is not None:
        failure_report.main(result, out)
    return result


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="coarse steps only, up to 3 s")
    parser.add_argument("--out", default="failure_map_results")
    arguments = parser.parse_args()
    print(failure_report.report(main(quick=arguments.quick, out=arguments.out)))
