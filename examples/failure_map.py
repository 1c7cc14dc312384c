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

*The mechanism.* The variational scheme sees stresses at midpoints only. A rotation of a node that
alternates, ``(-1)^n b``, has none there: elastic forces do not hold it, they only make b slow to
change, as a mass ``h^2 K/4`` would. The inertia ``4 M/h^2`` holds it. The constraint force of the
directors, which acts at the nodes as in the leapfrog scheme, drives it: its stiffness ``K_c`` is
the compression N times the length of beam that a node carries. Once ``K_c > 4 M/h^2``, i.e.
``h omega_c > 2``, b grows, by about ``2 sqrt(N/GA)`` a step if shear resists. The energy of the
midpoints does not see it; that of the nodes does. When the nodes' triads have turned so far that
their mean is much shorter than 1, the steps cannot be solved any more. With a slender section shear
gives the highest frequency omega, and the limit is a compressive strain of ``0.4/(h omega)^2``:
where strains reach 0.4 %, h omega = 10.
"""

from __future__ import annotations

import argparse
import csv
import datetime
import logging
import platform
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import scipy
import skfem
from numpy.typing import NDArray
from scipy.linalg import eigh

import skfem_cosserat as sc
from skfem_cosserat import diagnostics

sys.path.insert(0, str(Path(__file__).resolve().parent))

import three_bar_swing as swing

Floats = NDArray[np.float64]

STEPS = (1e-1, 3e-2, 1e-2, 3e-3, 1e-3, 3e-4, 1e-4, 3e-5, 1e-5)
QUICK = 1e-3  # smallest step of the quick mode
UNTIL = 6.0  # two periods
PULSE_END = swing.PULSE["stiff"][1]
SETTINGS = sc.NewtonSettings(iterations=100, damped_iterations=100)
BLOW_UP = 10.0  # times the energy just after the pulse
BEYOND = 2000  # Newton iterations that a run goes on after a blow-up
ATTEMPTS = ("extrapolated", "zero", "zero, line search", "extrapolated, line search")
COLUMNS = (
    "integrator",
    "step_s",
    "outcome",
    "end_s",
    "event_x_s",
    "event_y_s",
    "period_s",
    "energy_error",
    "energy_error_midpoint",
    "energy_at_end",
    "solver_failed_s",
    "steps",
    "newton_iterations",
    "steps_tried_again",
    "wall_s",
    "reason",
)
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
    return {
        "integrator": integrator.name,
        "step_s": step,
        "outcome": outcome,
        "end_s": end,
        **_events(series),
        **_errors(series, after),
        "solver_failed_s": failed,
        "steps": round(end / step),
        "newton_iterations": iterations,
        "steps_tried_again": repeated,
        "wall_s": wall,
        "reason": reason,
        "series": series,
        "residuals": residuals,
    }


def _errors(series: Floats, after: NDArray[np.int64]) -> dict[str, float | None]:
    """Largest relative deviations from the value just after the pulse, and the last energy."""
    if len(after) < 2:
        return dict.fromkeys(("energy_error", "energy_error_midpoint", "energy_at_end"))
    nodal, middle = series[1, after], series[2, after[1:]]
    return {
        "energy_error": float(abs(nodal / nodal[0] - 1).max()),
        "energy_error_midpoint": float(abs(middle / middle[0] - 1).max()),
        "energy_at_end": float(nodal[-1] / nodal[0]),
    }


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


# -- the mechanism ---------------------------------------------------------------------------------


def alternating_rotations(system: sc.System, q: Floats) -> Floats:
    """Part of the rotation of each frame that changes sign from step to step.

    ``-(q_{n+1} - 2 q_n + q_{n-1})/4`` of ``q_n = s + (-1)^n a`` is ``(-1)^n a`` (and
    ``-h^2 s''/4``); the rotation in it is ``sum d_i x a_i / 2``.

    Parameters
    ----------
    q : (N, n) array
        Configurations of consecutive steps.

    Returns
    -------
    (N-2, frames, 3) array
        (rad)
    """
    d = q.reshape(len(q), -1, 3)[:, system.kinematics.director_rows]
    part = -(d[2:] - 2 * d[1:-1] + d[:-2]) / 4
    return 0.5 * np.cross(d[1:-1], part).sum(2)


def constraint_frequency(system: sc.System, q: Floats, constraint_force: Floats) -> float:
    """The omega_c (rad/s) whose product with the step must stay below 2 (variational scheme).

    Largest eigenvalue of ``K_c`` against M over the rotations of all frames, where
    ``theta.K_c theta = sum (f_i.theta)(d_i.theta) - |theta|^2 f_i.d_i`` is the second variation of
    the work that the constraint force -f does on the directors (compressed beams: positive).

    Parameters
    ----------
    q, constraint_force : (n,) array
        At a node, the force as in :class:`skfem_cosserat.StepReport` (or in the history).
    """
    rows = system.kinematics.director_rows
    d, f = q.reshape(-1, 3)[rows], -constraint_force.reshape(-1, 3)[rows]
    A = np.einsum("nia,nib->nab", f, d)
    blocks = (A + A.transpose(0, 2, 1)) / 2 - np.trace(A, 0, 1, 2)[:, None, None] * np.eye(3)
    # (omega x d).(eta x e) = (omega.eta)(d.e) - (omega.e)(eta.d)
    m = system.mass.toarray()[rows[:, :, None, None], rows]
    M = np.einsum("kilj,kic,ljc,ab->kalb", m, d, d, np.eye(3), optimize=True)
    M -= np.einsum("kilj,lja,kib->kalb", m, d, d, optimize=True)
    M = M.reshape(3 * len(rows), -1)
    top = len(M) - 1
    value = eigh(scipy.linalg.block_diag(*blocks), M, eigvals_only=True, subset_by_index=[top, top])
    return float(np.sqrt(max(value[0], 0.0)))


def mechanism(step: float = 5e-4, section: str = "stiff") -> dict[str, Any]:
    """A failing run of the variational scheme, looked at closely.

    Returns
    -------
    dict
        Arrays over the steps from the end of the pulse to the blow-up: ``times``,
        ``alternation`` (largest alternating rotation of a node, rad), ``energy`` and
        ``energy_midpoint`` (both relative to just after the pulse), ``h_omega_c``. Over the last
        100 steps before the blow-up (``window``, s): ``growth`` of the alternation,
        ``energy_growth`` and ``midpoint_change`` (largest relative change); over the last 50
        ``sign_changes``, the share of steps in which the alternating rotation of the node that
        moves most in the end changes its sign.
    """
    system = swing.build(section)
    history, _ = swing.run(
        system, sc.Variational(), sc.NullSpace(), step, 10.0, swing.PULSE[section][1]
    )
    t, q = history.times, history["q"]
    with np.errstate(all="ignore"):
        nodal = swing._energy(system, q, history["p"])
        middle = diagnostics.midpoint_energy(system, q, step, mean=False)
    first = int(np.searchsorted(t, swing.PULSE[section][1] * (1 - 1e-12)))
    theta = alternating_rotations(system, q)
    size = abs(theta).max((1, 2))
    force = history["constraint_force"]
    keep = slice(first, len(t) - 1)
    omega = [
        constraint_frequency(system, q[k], force[k]) if np.isfinite(force[k]).all() else np.nan
        for k in range(first, len(t) - 1)
    ]
    result: dict[str, Any] = {
        "step": step,
        "section": section,
        "times": t[keep],
        "alternation": size[first - 1 :],
        "energy": nodal[keep] / nodal[first],
        "energy_midpoint": middle[keep] / middle[first],
        "h_omega_c": step * np.array(omega),
    }
    blown = result["energy"] > BLOW_UP
    stop = int(np.argmax(blown)) if blown.any() else len(omega)
    window = slice(max(0, stop - 100), stop)
    a = result["alternation"][window]
    spin = theta[first - 1 :][window]
    node, axis = np.unravel_index(np.argmax(abs(spin[-1])), spin.shape[1:])
    signs = np.sign(spin[:, node, axis])
    e, m = result["energy"][window], result["energy_midpoint"][window]
    return result | {
        "window": (float(result["times"][window][0]), float(result["times"][window][-1])),
        "growth": float(np.median(a[-10:]) / np.median(a[:10])),
        "sign_changes": float((signs[1:] * signs[:-1] < 0)[-50:].mean()),
        "energy_growth": float(e.max() / e[:10].mean()),
        "midpoint_change": float(np.ptp(m) / m.mean()),
    }


# -- which runs does h omega tell from which? ------------------------------------------------------


def rubber_rod() -> sc.System:
    """The scene of the README: a rubber rod with a ball swings down from its hinge."""
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 16, name="rod")
    rubber = sc.SectionCircle(radius=5e-3, material=sc.Material(E=5e6, nu=0.5, rho=1100))
    model = sc.Model()
    rod = model.add("rod", sc.Beam(mesh, rubber, director=(0, 1, 0)))
    model.add("hinge", sc.JointRevolute(sc.ground((0, 0, 0)), rod.node("rod.start"), (0, 0, 1)))
    model.add("ball", sc.RigidBody.sphere(0.05, radius=0.02, on=rod.node("rod.end")))
    model.add("gravity", sc.LoadGravity((0, -9.81, 0)))
    return model.freeze()


def steel_bar(axial: float, lateral: float, rise: float) -> sc.System:
    """A cantilever of 1 m, 10 x 10 mm; loads (N) at its end grow within `rise` (s) and stay."""
    steel = sc.Material(210e9, 0.3, 7850.0)
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 10, name="bar")
    model = sc.Model()
    bar = model.add(
        "bar", sc.Beam(mesh, sc.SectionRectangle(0.01, 0.01, steel), director=(0, 1, 0))
    )
    model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), bar.node("bar.start")))
    load = sc.LoadForce(bar.node("bar.end"), (axial, lateral, 0), sc.Table([0, rise], [0, 1]))
    model.add("load", load)
    return model.freeze()


EULER = np.pi**2 * 210e9 * 0.01**4 / 12 / 4  # N, buckling load of the cantilever
SIDE = partial(swing.build, side_load=1e-3)
_column = partial(steel_bar, -EULER / 2, 1e-3, 0.05)
_tie = partial(steel_bar, EULER / 2, 1e-3, 0.05)
#: scene, how to build it, steps (s), end (s), steps of the full mode
SCENES: tuple[tuple[str, Callable[[], sc.System], tuple[float, ...], float, tuple[float, ...]], ...]
SCENES = (
    ("swing, published, exactly plane", swing.build, (1e-2,), 8.0, (3e-2, 5e-3)),
    ("swing, published, side load 1e-3", SIDE, (1e-2,), 8.0, (5e-3, 3e-3)),
    ("swing, physical", partial(swing.build, "physical"), (1e-2,), 4.0, (2e-2, 5e-3, 2e-3)),
    ("swing, stiff", partial(swing.build, "stiff"), (1e-2,), 1.0, (1e-3, 1e-4)),
    ("rubber rod and ball", rubber_rod, (1e-2,), 1.5, (2e-3, 1e-3, 2e-4)),
    ("steel cantilever, 1 mm", partial(steel_bar, 0.0, 1.7, 0.01), (1e-3,), 0.5, (1e-4,)),
    ("steel column, half of Euler", _column, (1e-3,), 0.5, (1e-4,)),
    ("steel tie, the same in tension", _tie, (1e-3,), 0.5, (1e-4,)),
)


def judge(build: Callable[[], sc.System], step: float, until: float) -> dict[str, Any]:
    """Whether the variational scheme fails, and whether `simulate` would have warned.

    Returns
    -------
    dict
        ``h_omega``, ``warned``, ``failed_at`` (s or None: the energy exceeds ten times the largest
        one with energy-momentum, or a step cannot be solved), ``h_omega_c`` (largest of 200
        states) and ``compression``, the largest compressive strain with energy-momentum until then.
    """
    system = build()
    beam: Any = system.structures[0]
    h_omega = step * diagnostics.highest_frequency(system)
    kept = {"every": max(1, round(until / step / 2000)), "derive": False}
    try:
        history = sc.simulate(
            system, sc.EnergyMomentum(), sc.NullSpace(), step, until, settings=SETTINGS, **kept
        )
    except sc.Diverged as error:
        history = error.history
    largest = float(np.nanmax(swing._energy(system, history["q"], history["p"])))
    omega_c, failed, last = 0.0, None, None
    count = round(until / step)
    try:
        for report in sc.steps(system, sc.Variational(), sc.NullSpace(), step, settings=SETTINGS):
            k = report.state.index
            if last is not None and k % max(1, count // 2000) == 0:
                energy = float(swing._energy(system, last.q, report.momentum))
                if not energy <= BLOW_UP * largest:
                    failed = last.time
                    break
                if k % max(1, count // 200) == 0:
                    force = report.constraint_force
                    omega_c = max(omega_c, constraint_frequency(system, last.q, force))
            last = report.state
            if k >= count:
                break
    except sc.Diverged as error:
        failed = error.time
    before = history["q"][history.times <= (until if failed is None else failed)]
    strain = -float(diagnostics.section_strains(system, beam, before)[..., 2].min())
    return {
        "h_omega": h_omega,
        "warned": h_omega > (sc.Variational.frequency_limit or np.inf),
        "failed_at": failed,
        "h_omega_c": step * omega_c,
        "compression": max(0.0, strain),
    }


def criterion(quick: bool = True) -> list[dict[str, Any]]:
    """All scenes and steps; see :func:`judge`."""
    rows = []
    for name, build, steps, until, more in SCENES:
        for step in sorted(steps + (() if quick else more), reverse=True):
            rows.append({"scene": name, "step_s": step, "until_s": until})
            rows[-1] |= judge(build, step, until)
    return rows


# -- all together ----------------------------------------------------------------------------------


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
        completed one; ``mechanism``: see there; ``criterion``: see there.
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
                _write(result, Path(out))
    whole = [r for r in result["rows"] if r["period_s"] and r["integrator"] == "energy-momentum"]
    result["period"] = whole[-1]["period_s"] if whole else None
    result["mechanism"] = mechanism()
    result["criterion"] = criterion(quick)
    if out is not None:
        _write(result, Path(out))
        chart(result, Path(out) / "failure_map.png")
    return result


def _provenance() -> str:
    now = datetime.datetime.now(datetime.UTC).date().isoformat()
    return (
        f"# skfem-cosserat {sc.__version__}, numpy {np.__version__}, scipy {scipy.__version__},"
        f" scikit-fem {skfem.__version__}, Python {platform.python_version()},"
        f" {platform.system()} {platform.machine()}, {now}\n"
    )


def _table(path: Path, header: Any, rows: Any) -> None:
    with path.open("w", newline="") as file:
        file.write(_provenance())
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(header)
        for row in rows:
            writer.writerow([f"{x:.7g}" if isinstance(x, float) else x for x in row])


def thinned(series: Floats, count: int = 400) -> Floats:
    """About `count` of the columns, the last 50 among them."""
    number = series.shape[1]
    which = np.unique(
        np.concatenate(
            [np.linspace(0, number - 1, min(count, number)).round(), np.arange(number)[-50:]]
        ).astype(int)
    )
    return series[:, which]


def _write(result: dict[str, Any], folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    runs = result["rows"]
    _table(folder / "failure_map.csv", COLUMNS, ([r[c] for c in COLUMNS] for r in runs))
    _table(
        folder / "failure_map.residuals.csv",
        ("integrator", "step_s", "failed_step_from_s", "attempt", "iteration", "scaled_residual"),
        (
            (r["integrator"], r["step_s"], r["end_s"], name, k, float(value))
            for r in runs
            for name, values in zip(ATTEMPTS, r["residuals"], strict=False)
            for k, value in enumerate(values)
        ),
    )
    _table(
        folder / "failure_map.energy.csv",
        ("integrator", "step_s", "time_s", "energy_J", "energy_midpoint_J"),
        (
            (r["integrator"], r["step_s"], *map(float, column[:3]))
            for r in runs
            for column in thinned(r["series"]).T
        ),
    )
    if "criterion" in result:
        rows = result["criterion"]
        _table(folder / "failure_map.criterion.csv", rows[0], (r.values() for r in rows))


MARKERS = {
    "completed": ("o", "completed"),
    "stopped, still running": (">", "stopped, still running"),
    "energy blow-up": ("x", "energy blows up"),
    "Newton failed": ("v", "a step cannot be solved"),
}
COLOURS = {"variational": "C3", "energy-momentum": "C0"}


def chart(result: dict[str, Any], path: Path) -> bool:
    """Time reached against step, energy against time, the mechanism; False without matplotlib."""
    try:
        from matplotlib.figure import Figure
    except ImportError:
        return False
    figure = Figure(figsize=(7.5, 11), layout="constrained")
    axes = figure.subplots(3, 1)
    _chart_map(axes[0], result)
    _chart_energy(axes[1], result)
    _chart_mechanism(axes[2], result["mechanism"])
    figure.savefig(path, dpi=120)
    return True


def _chart_map(axis: Any, result: dict[str, Any]) -> None:
    shift = {"variational": 0.94, "energy-momentum": 1.06}
    for name, colour in COLOURS.items():
        for outcome, (marker, label) in MARKERS.items():
            found = [
                (r["step_s"] * shift[name], r["end_s"])
                for r in result["rows"]
                if (r["integrator"], r["outcome"]) == (name, outcome)
            ]
            if found:
                axis.plot(*zip(*found, strict=True), marker, color=colour, label=f"{name}: {label}")
    fine = next((r for r in reversed(result["rows"]) if r["period_s"]), None)
    for key, text in (("event_x_s", "X"), ("event_y_s", "Y"), ("period_s", "period")):
        if fine is not None:
            axis.axhline(fine[key], color="0.6", lw=0.8)
            axis.annotate(text, (1.0, fine[key]), xycoords=("axes fraction", "data"))
    axis.set(xscale="log", xlabel="step in s", ylabel="time reached in s", ylim=(0, None))
    axis.invert_xaxis()
    axis.legend(fontsize="x-small")
    axis.set_title("three-bar swing, stiff section", fontsize="medium")


def _chart_energy(axis: Any, result: dict[str, Any]) -> None:
    shown = [r for r in result["rows"] if r["energy_error"] is not None and r["step_s"] < 2e-2]
    for r in shown:
        t, energy = thinned(r["series"], 1000)[:2]
        after = t >= PULSE_END * (1 - 1e-12)
        change = abs(energy[after] / energy[after][0] - 1)[1:]
        style = "-" if r["integrator"] == "variational" else ":"
        label = f"{r['integrator']}, h = {r['step_s']:g} s"
        axis.plot(t[after][1:], change, style, label=label, lw=1)
    axis.set(yscale="log", ylim=(1e-15, 100), xlabel="time in s")
    axis.set_ylabel("relative change of the energy\nat $(q_n, p_n)$ since the pulse")
    axis.legend(fontsize="xx-small", ncols=2, loc="lower right")


def _chart_mechanism(axis: Any, m: dict[str, Any]) -> None:
    for name, colour, where in (
        ("energy", "C3", "$(q_n, p_n)$"),
        ("energy_midpoint", "C2", "midpoints"),
    ):
        label = f"energy at {where}, relative change"
        axis.plot(m["times"], abs(m[name] - 1), colour, label=label, lw=1)
    axis.plot(m["times"], m["alternation"], "C4", label="alternating rotation of a node in rad")
    axis.plot(m["times"], m["h_omega_c"], "0.6", lw=0.8, label="$h \\omega_c$ (limit 2)")
    axis.axhline(2, color="0.6", ls=":", lw=0.8)
    axis.set(yscale="log", ylim=(1e-8, 100), xlabel="time in s")
    axis.set_title(f"variational, h = {m['step']:g} s: how it fails", fontsize="medium")
    axis.legend(fontsize="x-small", loc="center left")


def report(result: dict[str, Any]) -> str:
    """The tables as text."""
    lines = [f"full period: {result['period']} s" if result["period"] else "no full period"]
    lines.append(
        f"{'integrator':16s} {'step/s':>7s}  {'outcome':22s} {'at/s':>9s} {'solver/s':>8s}"
        f" {'X/s':>7s} {'period':>7s} {'energy error':>12s} {'midpoint':>9s} {'Newton':>8s}"
        f" {'wall/s':>7s}"
    )
    for r in result["rows"]:
        cells = [
            "-" if v is None else format(v, f)
            for v, f in (
                (r["event_x_s"], ".4f"),
                (r["period_s"], ".4f"),
                (r["energy_error"], ".2e"),
                (r["energy_error_midpoint"], ".2e"),
                (r["solver_failed_s"], ".5g"),
            )
        ]
        lines.append(
            f"{r['integrator']:16s} {r['step_s']:7.0e}  {r['outcome']:22s} {r['end_s']:9.5f}"
            f" {cells[4]:>8s} {cells[0]:>7s} {cells[1]:>7s} {cells[2]:>12s} {cells[3]:>9s}"
            f" {r['newton_iterations']:8d} {r['wall_s']:7.1f}"
        )
    m = result["mechanism"]
    lines.append(
        f"mechanism (h = {m['step']:g} s, {m['window'][0]:.3f} to {m['window'][1]:.3f} s):"
        f" alternating rotations grow {m['growth']:.1f} times and change sign in"
        f" {100 * m['sign_changes']:.0f} % of the steps; the energy of the nodes grows"
        f" {m['energy_growth']:.2f} times, that of the midpoints moves by"
        f" {m['midpoint_change']:.1e}"
    )
    lines.append(
        f"{'scene':34s} {'step/s':>7s} {'h omega':>9s} {'warned':>6s} {'failed at':>9s}"
        f" {'h omega_c':>9s} {'compression':>11s}"
    )
    for r in result["criterion"]:
        failed = "-" if r["failed_at"] is None else f"{r['failed_at']:.4g} s"
        lines.append(
            f"{r['scene']:34s} {r['step_s']:7.0e} {r['h_omega']:9.3g}"
            f" {'yes' if r['warned'] else 'no':>6s} {failed:>9s} {r['h_omega_c']:9.3g}"
            f" {r['compression']:11.2e}"
        )
    return "\n".join(lines)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="coarse steps only, up to 3 s")
    parser.add_argument("--out", default="failure_map_results")
    arguments = parser.parse_args()
    logging.getLogger("skfem_cosserat").setLevel(logging.ERROR)
    print(report(main(quick=arguments.quick, out=arguments.out)))
