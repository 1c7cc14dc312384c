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
import logging
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import skfem_cosserat as sc
from skfem_cosserat import diagnostics

sys.path.insert(0, str(Path(__file__).resolve().parent))

import failure_mechanism as mechanism
import failure_report
import three_bar_swing as swing
from failure_mechanism import BLOW_UP, SETTINGS

Floats = NDArray[np.float64]

STEPS = (1e-1, 3e-2, 1e-2, 3e-3, 1e-3, 3e-4, 1e-4, 3e-5, 1e-5)
QUICK = 1e-3  # smallest step of the quick mode
UNTIL = 6.0  # two periods
PULSE_END = swing.PULSE["stiff"][1]
BEYOND = 2000  # Newton iterations that a run goes on after a blow-up
BLOCK = 64  # states whose energies are computed at once


class _Watch:
    """Energies and turning points of a run, computed block by block.

    Attributes
    ----------
    series : list of (6, k) arrays
        Time, energy at (q_n, p_n), energy at (q_{n-1}, q_n), angle of the right and of the left
        link, e2 coordinate of the mass; up to the blow-up.
    blown : bool
        Whether the energy has blown up.
    """

    def __init__(self, system: sc.System, mean: bool, step: float) -> None:
        self.system, self.mean, self.step = system, mean, step
        links = [system.frame_place(f"{side} link") + 10 for side in ("right", "left")]
        beam: Any = system.structures[0]
        self._tips, self._mass = links, system.offset(beam.node("mid")) + 1
        self.before: Floats = system.q0
        self.block: list[tuple[float, Floats, Floats]] = []
        self.series: list[Floats] = []
        self.reference: float | None = None
        self.blown = False

    def take(self, state: sc.State, momentum: Floats) -> None:
        """A state and p_n there."""
        self.block.append((state.time, state.q, momentum))
        if len(self.block) >= BLOCK:
            self.flush()

    def flush(self) -> None:
        """Evaluate the block."""
        if not self.block or self.blown:
            return
        t, q, p = (np.array(x) for x in zip(*self.block, strict=True))
        self.block = []
        with np.errstate(all="ignore"):
            nodal = swing._energy(self.system, q, p)
            pairs = np.vstack([self.before, q])
            middle = diagnostics.midpoint_energy(self.system, pairs, self.step, self.mean)
        self.before = q[-1]
        tips = [np.arctan2(q[:, k + 1], q[:, k]) for k in self._tips]
        rows = np.array([t, nodal, middle, *tips, q[:, self._mass]])
        after = np.flatnonzero(t >= PULSE_END * (1 - 1e-12))
        if self.reference is None and len(after):
            self.reference = float(nodal[after[0]])
        bad = after[~(nodal[after] <= BLOW_UP * (self.reference or np.inf))]
        self.series.append(rows[:, : bad[0] + 1] if len(bad) else rows)
        self.blown = len(bad) > 0


def sail(
    system: sc.System, integrator: Any, step: float, until: float, patience: float = 3600.0
) -> dict[str, Any]:
    """One run with the null space method.

    Parameters
    ----------
    patience : float
        Wall time (s) after which a run is stopped, which is not counted as a failure.

    Returns
    -------
    dict
        The columns of the table, where ``end_s`` is the time of the blow-up, of the last solved
        step, or the end; ``series`` (6, N) up to it: time, energy at (q_n, p_n), energy at
        (q_{n-1}, q_n), angles of the right and left link, e2 coordinate of the mass; and
        ``residuals``, lists of the scaled residuals of a failed step, one for each attempt.
    """
    watch = _Watch(system, integrator.name == "energy-momentum", step)
    outcome, failed, reason, residuals = "completed", None, "", []
    iterations = repeated = beyond = 0
    count = int(until / step * (1 + 1e-12) + 1e-9)
    start, state = time.perf_counter(), sc.initial_state(system)
    try:
        for report in sc.steps(system, integrator, sc.NullSpace(), step, settings=SETTINGS):
            if state.index:
                watch.take(state, report.momentum)
            state = report.state
            beyond += report.iterations * watch.blown
            if not watch.blown:
                iterations += report.iterations
                repeated += report.attempts > 1
            if state.index >= count or beyond > BEYOND:
                break
            if time.perf_counter() - start > patience:
                outcome = "stopped, still running"
                break
    except sc.Diverged as error:
        outcome, failed = "Newton failed", error.time
        reason, residuals = error.reason, error.residuals
    wall = time.perf_counter() - start
    watch.flush()
    series = np.concatenate(watch.series, axis=1) if watch.series else np.zeros((6, 0))
    if watch.blown:
        outcome = "energy blow-up"
    after = np.flatnonzero(series[0] >= PULSE_END * (1 - 1e-12))
    end = float(series[0, -1]) if watch.blown else state.time
    events = _events(series)
    return {
        "integrator": integrator.name,
        "step_s": step,
        "outcome": outcome,
        "end_s": end,
        **events,
        **_errors(series, after, events["period_s"]),
        "solver_failed_s": failed,
        "steps": round(end / step),
        "newton_iterations": iterations,
        "steps_tried_again": repeated,
        "wall_s": wall,
        "reason": reason,
        "series": series,
        "residuals": residuals,
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


def _events(series: Floats) -> dict[str, float | None]:
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
    logging.getLogger("skfem_cosserat").setLevel(logging.ERROR)
    print(failure_report.report(main(quick=arguments.quick, out=arguments.out)))
