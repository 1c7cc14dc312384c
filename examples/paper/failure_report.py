"""Tables, chart and text of the failure map."""

from __future__ import annotations

import csv
import datetime
import platform
import sys
from pathlib import Path
from typing import Any

import numpy as np
import scipy
import skfem
from numpy.typing import NDArray

import skfem_cosserat as sc
from skfem_cosserat.figures import PAGE, PALETTE, legend, panels, styles, write_figure

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from paper import three_bar_swing as swing

Floats = NDArray[np.float64]

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
    "energy_error_period",
    "energy_error_midpoint",
    "energy_at_end",
    "solver_failed_s",
    "steps",
    "newton_iterations",
    "steps_tried_again",
    "wall_s",
    "reason",
)


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


def thinned(series: Floats, count: int = 150) -> Floats:
    """About `count` of the columns, the last 50 among them."""
    number = series.shape[1]
    which = np.unique(
        np.concatenate(
            [np.linspace(0, number - 1, min(count, number)).round(), np.arange(number)[-50:]]
        ).astype(int)
    )
    return series[:, which]


def write(result: dict[str, Any], folder: Path) -> None:
    """The tables; each run's outcome, residuals of a failed step and energies, and the scenes."""
    folder.mkdir(parents=True, exist_ok=True)
    runs = result["rows"]
    _table(folder / "failure_map.csv", COLUMNS, ([r[c] for c in COLUMNS] for r in runs))
    _table(
        folder / "failure_map.residuals.csv",
        ("integrator", "step_s", "failed_step_from_s", "start", "scaled_residuals"),
        (
            (
                *(r["integrator"], r["step_s"], r["solver_failed_s"], start),
                " ".join(f"{x:.3g}" for x in values),
            )
            for r in runs
            for start, values in zip(ATTEMPTS, r["residuals"], strict=False)
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
COLOURS = {name: style.color for name, style in styles(("variational", "energy-momentum")).items()}


def chart(result: dict[str, Any], path: Path) -> bool:
    """Time reached against step, energy against time, the mechanism; False without matplotlib."""
    try:
        figure, axes = panels(PAGE, 10, 3, 1)
    except ImportError:
        return False
    _chart_map(axes[0], result)
    _chart_energy(axes[1], result)
    _chart_mechanism(axes[2], result["mechanism"])
    write_figure(figure, path)
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
            axis.axhline(fine[key], color="0.6", lw=0.8, zorder=1)
            axis.annotate(text, (1.0, fine[key]), xycoords=("axes fraction", "data"))
    axis.set(xscale="log", xlabel="step in s", ylabel="time reached in s", ylim=(0, None))
    legend(axis)
    axis.set_title("three-bar swing, stiff section")


def _chart_energy(axis: Any, result: dict[str, Any]) -> None:
    from matplotlib import colormaps

    for r in result["rows"]:
        variational = r["integrator"] == "variational"
        if r["energy_error"] is None or not (variational or r["outcome"] == "completed"):
            continue
        t, energy = thinned(r["series"], 1000)[:2]
        after = t >= swing.PULSE["stiff"][1] * (1 - 1e-12)
        change = abs(energy[after] / energy[after][0] - 1)[1:]
        colour = colormaps["viridis"]((np.log10(r["step_s"]) + 5.2) / 4.6)
        label = f"variational, step {r['step_s']:g} s" if variational else None
        style = "-" if variational else ":"
        axis.plot(t[after][1:], change, style, color=colour, label=label, lw=1)
    axis.plot([], [], ":", color="0.4", label="energy-momentum, same steps")
    axis.set(yscale="log", ylim=(1e-15, 100), xlabel="time in s")
    axis.set_ylabel("relative change of the energy\nat $(q_n, p_n)$ since the pulse")
    legend(axis)


def _chart_mechanism(axis: Any, m: dict[str, Any]) -> None:
    for name, colour, where in (
        ("energy", PALETTE["red"], "$(q_n, p_n)$"),
        ("energy_midpoint", PALETTE["green"], "midpoints"),
    ):
        label = f"energy at {where},\nrelative change"
        axis.plot(m["times"], abs(m[name] - 1), color=colour, label=label, lw=1)
    label = "alternating rotation\nof a node in rad"
    axis.plot(m["times"], m["alternation"], color=PALETTE["indigo"], label=label)
    axis.plot(m["times"], m["h_omega_c"], "0.6", lw=0.8, label="$h \\omega_c$ (limit 2)")
    axis.axhline(2, color="0.6", ls=":", lw=0.8, zorder=1)
    axis.set(yscale="log", ylim=(1e-8, 100), xlabel="time in s", ylabel="relative change, or rad")
    axis.set_title(f"variational, step {m['step']:g} s: how it fails")
    legend(axis)


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


def main(result: dict[str, Any], out: str | Path) -> str:
    """Write tables and chart of a complete result; gives the text."""
    write(result, Path(out))
    chart(result, Path(out) / "failure_map.png")
    return report(result)
