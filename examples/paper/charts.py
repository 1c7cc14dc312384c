"""Pictures and tables of figures 19 to 25, drawn from what the other files here compute."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.colors import LinearSegmentedColormap

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks.record import Record
from paper import convergence, figures
from paper import three_bar_swing as swing
from skfem_cosserat.figures import (
    PALETTE,
    chart_style,
    legend,
    new_figure,
    panels,
    styles,
    write_figure,
)

COLOURS = LinearSegmentedColormap.from_list("paper", ["blue", "cyan", "lime", "yellow", "red"])
RED = PALETTE["red"]
PARTS = 6  # of an element, to show a linear interpolation


class Charts:
    """Writes each figure as PNG and CSV.

    Parameters
    ----------
    out : Path
        An existing folder.
    record : Record
        Of the session, for the provenance.
    """

    def __init__(self, out: Path, record: Record) -> None:
        self.out, self.record = out, record
        self.paths: list[Path] = []

    def save(self, name: str, figure: Any, run: int, header: list[str], columns: Any) -> None:
        """Write ``name.png`` and ``name.csv``; columns all of one length."""
        path = self.out / f"{name}.png"
        write_figure(figure, path)
        rows = zip(*columns, strict=True)
        table = self.record.write_csv(self.out / f"{name}.csv", run, header, rows)
        self.paths += [path, table]

    def scene(self, run: int) -> None:
        """Figure 19: supports S, hinges R, lengths."""
        L, H = swing.SPAN, swing.HEIGHT
        figure, (axis,) = panels(8.5, 3.8)
        nodes = np.linspace(0.0, L, 21)
        axis.plot(
            nodes, 0 * nodes, "|-", color=PALETTE["blue"], lw=3, ms=9, label="beam, 20 elements"
        )
        for x, y in (((0, 0), (0, H)), ((L, L + H), (0, H))):
            axis.plot(x, y, color="0.35", lw=5, solid_capstyle="round")
        points = {"S": ((0, H), (L + H, H)), "R": ((0, 0), (L, 0))}
        for name, places in points.items():
            for x, y in places:
                axis.plot(x, y, "o", color="white", mec="black", ms=9, zorder=3)
                axis.annotate(name, (x, y), (-16, 6), textcoords="offset points", weight="bold")
        axis.plot(L / 2, 0, "o", color=RED, ms=15, zorder=3)
        axis.annotate("M = 5 kg", (L / 2, 0), (-24, -23), textcoords="offset points")
        arrow = {"arrowstyle": "->", "color": RED, "lw": 2}
        axis.annotate("", (L / 2 + 0.14, 0.05), (L / 2, 0.05), arrowprops=arrow)
        axis.text(0.06, 0.08, "pulse along e2, 10000 N at 0.125 s", color=RED, size="small")
        lengths = (
            ((0, -0.13), (L, -0.13), (L / 2 - 0.05, -0.18), "0.72 m"),
            ((-0.09, 0), (-0.09, H), (-0.23, H / 2), "0.36 m"),
            ((L + 0.07, -0.05), (L + H + 0.07, H - 0.05), (L + 0.29, 0.1), "0.36 √2 m"),
        )
        for a, b, place, text in lengths:
            axis.annotate("", b, a, arrowprops={"arrowstyle": "<->", "lw": 0.8})
            axis.text(*place, text)
        axis.set(xlabel="e2 in m", ylabel="e3 in m", xlim=(-0.25, 1.25), ylim=(-0.22, 0.46))
        axis.set_aspect("equal")
        legend(figure)
        places = [(name, *place) for name, pair in points.items() for place in pair]
        places += [("M", L / 2, 0.0), *(("node", float(x), 0.0) for x in nodes)]
        header = ["point", "e2_m", "e3_m"]
        self.save("figure_19", figure, run, header, list(zip(*places, strict=True)))

    def forces_and_momenta(self, run: int, data: dict[str, Any]) -> None:
        """Figure 20."""
        figure = new_figure(10.0, 6.4)
        grid = figure.add_gridspec(6, 2)
        with chart_style():
            left = [figure.add_subplot(grid[3 * k : 3 * k + 3, 0]) for k in range(2)]
            right = [figure.add_subplot(grid[2 * k : 2 * k + 2, 1]) for k in range(3)]
        t = data["times"]
        for axis, name, label in (
            (left[0], "axial_force", "axial force in N"),
            (left[1], "bending_moment", "bending moment about e1 in N m"),
        ):
            axis.plot(t, data[name], lw=0.9)
            axis.axvline(data["event_x"], color="0.6", ls=":", lw=1, zorder=1)
            axis.set(xlabel="time in s", ylabel=label)
        header = ["t_s", "axial_force_N", "bending_moment_Nm"]
        columns = [t, data["axial_force"], data["bending_moment"]]
        for axis, (term, ending) in zip(right, figures.TERMS.items(), strict=True):
            L = data["angular_momentum" + ending]
            instants = t[:-1] + 0.5 * np.diff(t) if len(L) < len(t) else t
            for i in range(3):
                axis.plot(instants, L[:, i], lw=0.9, label=f"L{i + 1}")
                column = np.full(len(t), np.nan)
                column[: len(L)] = L[:, i]
                columns.append(column)
                header.append(f"L{i + 1} {term}")
            axis.set(xlabel="time in s", ylabel=f"L in kg m²/s,\n{term}")
            legend(axis)
        self.save("figure_20", figure, run, header, columns)

    def snapshots(self, run: int, data: dict[str, Any]) -> None:
        """Figure 21: norm of the section force plus 100 times that of the moment, 0 to 4000."""
        count = len(figures.SNAPSHOTS)
        figure, axes = panels(12.0, 5.6, 3, count // 3, sharex=True, sharey=True)
        values = figures.nodal(figures.load_measure(data["resultant"]))
        fine = np.linspace(0, data["nodes"].size - 1, PARTS * (data["nodes"].size - 1) + 1)
        node = np.arange(data["nodes"].size)
        rows: list[Any] = []
        bars = None
        for axis, time in zip(axes, figures.SNAPSHOTS, strict=True):
            k = int(abs(data["times"] - time).argmin())
            places = data["q"][k][data["nodes"][:, None] + np.arange(3)][:, 1:]
            line = np.array([np.interp(fine, node, places[:, i]) for i in range(2)]).T
            colour = np.interp(fine, node, values[k])
            segments = np.stack([line[:-1], line[1:]], axis=1)
            bars = LineCollection(segments, cmap=COLOURS, lw=4)
            bars.set_array(0.5 * (colour[1:] + colour[:-1]))
            bars.set_clim(0, figures.COLOUR_LIMIT)
            for end, support in ((0, (0.0, swing.HEIGHT)), (-1, None)):
                top = (swing.SPAN + swing.HEIGHT, swing.HEIGHT) if support is None else support
                axis.plot((places[end, 0], top[0]), (places[end, 1], top[1]), color="0.5", lw=1.5)
                axis.plot(*top, "ks", ms=3)
            axis.add_collection(bars)
            axis.plot(*data["mass_position"][k, 1:], "ko", ms=6)
            axis.set_title(f"t = {data['times'][k]:.2f} s", fontsize="small")
            axis.grid(False)
            axis.set_aspect("equal")
            rows += [(data["times"][k], a, *places[a], values[k, a]) for a in node]
        axes[0].set(xlim=(-0.1, 1.2), ylim=(-0.25, 0.5))
        figure.supxlabel("e2 in m")
        figure.supylabel("e3 in m")
        figure.colorbar(bars, ax=axes, label="|N| + 100/m |M| in N", extend="max", shrink=0.7)
        header = ["t_s", "node", "e2_m", "e3_m", "measure_N"]
        self.save("figure_21", figure, run, header, list(zip(*rows, strict=True)))

    def energy_and_orbit(self, run: int, data: dict[str, Any]) -> None:
        """Figure 22."""
        figure, (left, right) = panels(10.0, 3.8, 1, 2)
        left.plot(data["times"], data["energy"], lw=1)
        left.set(xlabel="time in s", ylabel="energy in J, (q_n, p_n)")
        place = data["mass_position"]
        right.plot(place[:, 1], place[:, 2], lw=1)
        right.set(xlabel="e2 in m", ylabel="e3 in m")
        right.set_aspect("equal")
        columns = [data["times"], data["energy"], *place.T]
        header = ["t_s", "energy_J", "e1_m", "e2_m", "e3_m"]
        self.save("figure_22", figure, run, header, columns)

    def energies(self, name: str, run: int, integrator: str, runs: dict[Any, Any]) -> None:
        """Figures 23 and 24: the energy, and below what it changes after the pulse."""
        figure, axes = panels(10.0, 5.6, 2, 2)
        steps: list[Any] = []
        rows: list[Any] = []
        for pair, step in zip((axes[::2], axes[1::2]), figures.STEPS, strict=True):
            data = runs[integrator, step]
            t = data["times"]
            columns = []
            for term, ending in figures.TERMS.items():
                energy = data["energy" + ending]
                instants = t[: len(energy)] + (0.5 * step if ending == "_midpoint" else 0.0)
                after = instants >= figures.PULSE_END - 1e-12
                pair[0].plot(instants, energy, lw=0.9, label=term)
                change = energy[after] / energy[after].mean() - 1
                pair[1].plot(instants[after], change, lw=0.7, label=term)
                columns.append(np.append(energy, [np.nan] * (len(t) - len(energy))))
            pair[0].set_title(f"{integrator}, step {step:g} s")
            pair[0].set(xlabel="time in s", ylabel="energy in J")
            pair[1].set(xlabel="time in s", ylabel="change after the pulse\n/ mean energy")
            rows += list(zip(t, *columns, strict=True))
            steps += [step] * len(t)
        legend(figure, below=3)
        header = ["step_s", "t_s", *(f"energy_J {term}" for term in figures.TERMS)]
        self.save(name, figure, run, header, [steps, *zip(*rows, strict=True)])

    def convergence(self, run: int, result: dict[str, Any]) -> None:
        """Figure 25: left energy-momentum with multipliers, right with the null space."""
        figure, axes = panels(12.0, 11.0, 3, 2, sharex=True, sharey="row")
        looks = styles((*convergence.QUANTITIES, convergence.SHIFTED))
        kinds = (convergence.SAME_END, convergence.TO_VARIATIONAL, convergence.TO_MOMENTUM)
        for column, treatment in zip(
            (axes[::2], axes[1::2]), ("multipliers", "null-space"), strict=True
        ):
            errors = result[treatment]["errors"]
            for axis, kind in zip(column, kinds, strict=True):
                steps = np.array(list(errors[kind]))
                for name, look in looks.items():
                    line = [errors[kind][h][name] for h in steps]
                    open_marker = {"ms": 8, "mfc": "none"} if name == "p" else {"ms": 4}
                    axis.loglog(steps, line, **look._asdict(), lw=1, label=name, **open_marker)
                low = min(errors[kind][steps[-1]].values())
                axis.loglog(steps, 0.3 * low * (steps / steps[-1]) ** 2, "k:", label="order 2")
                axis.set_title(f"energy-momentum with {treatment}\n{kind}", fontsize="small")
            column[-1].set_xlabel("step in s")
            column[-1].set_xticks(steps, [f"{h:g}" for h in steps], fontsize="small")
            column[-1].minorticks_off()
        for axis in axes[::2]:
            axis.set_ylabel("relative difference")
        legend(figure)
        header = ["treatment", "horizon_s", "kind", "step_s", "quantity", "error"]
        studies = [(name, 0.1, result[name]) for name in ("multipliers", "null-space")]
        studies += [("null-space", until, study) for until, study in result["longer"].items()]
        rows = [
            (treatment, until, kind, step, name, error)
            for treatment, until, study in studies
            for kind, by_step in study["errors"].items()
            for step, by_name in by_step.items()
            for name, error in by_name.items()
        ]
        self.save("figure_25", figure, run, header, list(zip(*rows, strict=True)))


def main(
    data: dict[str, Any], study: dict[str, Any], out: str | Path, record: Record
) -> list[Path]:
    """Write all figures as PNG and CSV; returns the paths.

    Parameters
    ----------
    data, study : dict
        Results of ``figures.main`` and ``convergence.main``, each with its ``run``.
    out : path
        An existing folder.
    record : Record
        Of the session.
    """
    charts = Charts(Path(out), record)
    run, runs = data["run"], data["runs"]
    first = runs["variational", figures.STEPS[0]]
    charts.scene(run)
    charts.forces_and_momenta(run, first)
    charts.snapshots(run, first)
    charts.energy_and_orbit(run, first)
    charts.energies("figure_23", run, "energy-momentum", runs)
    charts.energies("figure_24", run, "variational", runs)
    charts.convergence(study["run"], study)
    return charts.paths
