"""Charts of all studies: errors over sizes, costs and unknowns, maps, candidates (matplotlib)."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..errors import InputError
from ..figures import new_figure, write_figure
from ..types import Array, Floats
from .orders import Convergence

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


__all__ = [
    "COLOURS",
    "Line",
    "Lines",
    "chart_errors",
    "convergence_chart",
    "draw_candidates",
    "draw_errors",
    "precision_chart",
    "stability_chart",
]

Row = Mapping[str, Any]
#: of lines in black
STYLES = ("-", "--", ":", "-.")
#: where crosses of what failed stand, as a part of the height
FOOT, TOP = 0.04, 0.97


# -- what several charts share ---------------------------------------------------------------------


def _panels(
    count: int, most: int, width: float, height: float, margin: float = 0.0
) -> tuple[Figure, list[Any]]:
    """A figure with as many axes of this size, at most so many in a row; a margin for legends."""
    across = min(count, most)
    down = -(-count // across)
    figure = new_figure(width * across + margin, height * down)
    axes = list(figure.subplots(down, across, squeeze=False).flat)
    for axis in axes[count:]:
        axis.set_axis_off()
    return figure, axes[:count]


def _crosses(axis: Any, x: Sequence[float] | Floats, height: float, **style: Any) -> bool:
    """Crosses at a part of the height for what failed; whether there are any."""
    if len(x):
        style = {"label": "failed", **style}
        y = np.full(len(x), height)
        axis.plot(x, y, "x", transform=axis.get_xaxis_transform(), **style)
    return len(x) > 0


# -- the chart of a refinement: errors over sizes with slopes --------------------------------------

#: so many sizes are written below the axis, if there are more only powers of ten
TICKS = 6


@dataclass(frozen=True, eq=False)
class Line:
    """A quantity in a series: label, meaning of the sizes, numbers, which levels were solved."""

    label: str
    kind: str
    found: Convergence
    solved: Array


def convergence_chart(
    panels: Mapping[str, Sequence[Line]],
    title: str,
    path: str | os.PathLike[str] | None = None,
) -> Figure:
    """One panel a quantity, one line a series; crosses at the foot are levels that failed.

    Parameters
    ----------
    panels : mapping of str to lines
        By quantity.
    title : str
        Above the chart.
    path : path-like, optional
        Write it here.

    Examples
    --------
    >>> from skfem_cosserat.study.orders import convergence
    >>> found = convergence([0.5, 0.25, 0.125, 0.0625], [np.array(h**2) for h in (8, 4, 2, 1)])
    >>> line = Line("", "step", found, np.ones(4, dtype=bool))
    >>> figure = convergence_chart({"tip": [line]}, "bend")
    >>> figure.axes[0].get_xscale(), figure.axes[0].get_xlabel()
    ('log', 'step')
    """
    figure, axes = _panels(len(panels), 3, 5.0, 4.0)
    figure.suptitle(title)
    for axis, (name, lines) in zip(axes, panels.items(), strict=True):
        sure = all(_sure(line) for line in lines)
        ylabel = "error" if sure else "error (open: differences between levels)"
        axis.set(xscale="log", yscale="log", title=name, ylabel=ylabel)
        axis.set_xlabel(", ".join(dict.fromkeys(line.kind for line in lines)))
        sizes = np.unique(np.concatenate([line.found.sizes for line in lines]))
        if len(sizes) <= TICKS:
            axis.set_xticks(sizes, [f"{size:.3g}" for size in sizes])
        axis.set_xticks([], minor=True)
        for k, line in enumerate(lines):
            _draw(axis, line, f"C{k}")
        axis.grid(which="both", alpha=0.3)
        axis.legend(fontsize="small")
    return write_figure(figure, path)


def _sure(line: Line) -> bool:
    """Whether its errors are more than hints."""
    return bool(np.isfinite(line.found.uncertainties[line.solved]).any())


def _draw(axis: Any, line: Line, color: str) -> None:
    found = line.found
    shown = line.solved & (found.errors > 0)
    what = "observed" if line.label else "order"
    what += f" {found.order:.2f} +- {max(found.spread, 0.005):.2f}"
    if not found.asymptotic:
        what = found.verdict.partition(":")[0].partition(";")[0]
    label = f"{line.label}: {what}" if line.label else what
    style = {"linestyle": "-"} if _sure(line) else {"linestyle": "--", "markerfacecolor": "none"}
    x, y = found.sizes[shown], found.errors[shown]
    axis.plot(x, y, marker="o", color=color, label=label, **style)
    _crosses(axis, found.sizes[~line.solved], FOOT, color=color, clip_on=False)
    if found.rounding > 0 and (found.errors[shown] < 100 * found.rounding).any():
        axis.axhline(100 * found.rounding, color=color, linestyle=":", linewidth=0.8)
    if found.asymptotic:
        _slope(axis, found, shown, color)


def _slope(axis: Any, found: Convergence, shown: Array, color: str) -> None:
    """A triangle below the two finest levels that the order rests on."""
    good = np.flatnonzero(shown & np.isfinite(found.observed))
    fine = good[-1]
    coarse = max(k for k in np.flatnonzero(shown) if k < fine)
    x1, x2 = found.sizes[[coarse, fine]]
    y1 = 0.4 * found.errors[coarse]
    y2 = y1 * (x2 / x1) ** found.order
    axis.plot([x1, x2, x1, x1], [y1, y2, y2, y1], color=color, linewidth=0.8)
    axis.annotate(f"{found.order:.2f}", (x1, np.sqrt(y1 * y2)), color=color, fontsize="small")


# -- the chart of a work-precision study: errors over costs ----------------------------------------

MARKERS = "osD^v<>ph*"
DASHES = ("-", "--", "-.", ":")
#: number of colours of matplotlib's "tab10"; more families take those of "tab20"
FEW = 10


class Lines(NamedTuple):
    """What is drawn as a line.

    Attributes
    ----------
    kind : callable
        From a row to the name of its line.
    families : dict
        What has its colour, by the name of a line.
    own : dict
        Rows of its front, by quantity and name of a line.
    fronts : dict
        Rows of its front, by quantity and group.
    """

    kind: Callable[[Row], str]
    families: Mapping[str, str]
    own: Mapping[str, Mapping[str, Sequence[Row]]]
    fronts: Mapping[str, Mapping[str, Sequence[Row]]]

    def style(self, name: str) -> dict[str, Any]:
        """Colour, marker and dashes of a line."""
        families = list(dict.fromkeys(self.families.values()))
        family = self.families[name]
        number = families.index(family)
        within = [each for each, own in self.families.items() if own == family].index(name)
        return {
            "color": f"C{number}" if len(families) <= FEW else _many(number),
            "marker": MARKERS[(number + within) % len(MARKERS)],
            "linestyle": DASHES[within % len(DASHES)],
        }


def _many(number: int) -> Any:
    from matplotlib import colormaps

    return colormaps["tab20"](number % 20)


def precision_chart(
    rows: Sequence[Row],
    lines: Lines,
    reference_errors: Mapping[str, float],
    path: str | os.PathLike[str] | None = None,
) -> Figure:
    """One panel a quantity; see :meth:`~skfem_cosserat.study.PrecisionTable.chart`.

    Parameters
    ----------
    rows : sequence of mapping
        Of the table.
    lines : Lines
    reference_errors : mapping
        By quantity.
    path : path-like, optional
        Write it here.

    Raises
    ------
    InputError
        If a quantity is unknown, or none is given.
    """
    unknown = [name for name in lines.fronts if name not in reference_errors]
    if unknown or not lines.fronts:
        known = ", ".join(reference_errors)
        given = list(lines.fronts)
        raise InputError("argument quantities", f"{given!r}, expected some of {known}")
    figure, axes = _panels(len(lines.fronts), len(lines.fronts), 6.4, 5.4, 2.6)
    for axis, name in zip(axes, lines.fronts, strict=True):
        axis.set(xscale="log", yscale="log", title=name, xlabel="cost in s", ylabel="error")
        axis.minorticks_off()
        for line in lines.families:
            _points(axis, rows, name, line, lines)
        _steps(axis, name, lines.fronts[name])
        _failures(axis, rows, lines)
        own = reference_errors[name]
        if isfinite(own) and own > 0:
            bottom = min(axis.get_ylim()[0], own)
            axis.axhspan(bottom, own, color="0.85", label="below the reference")
            axis.set_ylim(bottom=bottom)
        axis.grid(which="major", alpha=0.3)
    handles, labels = axes[0].get_legend_handles_labels()
    if handles:
        figure.legend(handles, labels, loc="outside right upper", fontsize="small")
    return write_figure(figure, path)


def _shown(rows: Sequence[Row], name: str) -> tuple[list[float], list[float]]:
    """Costs and errors; those without any error have no place on the chart."""
    kept = [row for row in rows if row[f"error_{name}"] > 0]
    return [row["cost_s"] for row in kept], [row[f"error_{name}"] for row in kept]


def _points(axis: Any, rows: Sequence[Row], name: str, line: str, lines: Lines) -> None:
    """Setups of a kind that were solved, and their front."""
    style = lines.style(line)
    solved = [row for row in rows if row["status"] == "ok" and row["cost_s"] is not None]
    dots = {"color": style["color"], "marker": style["marker"], "linestyle": "none"}
    axis.plot(
        *_shown([r for r in solved if lines.kind(r) == line], name), **dots, ms=2.5, alpha=0.3
    )
    front = _shown(lines.own[name][line], name)
    if front[0]:
        axis.plot(*front, **style, ms=4.5, linewidth=1.3, label=line)


def _steps(axis: Any, name: str, fronts: Mapping[str, Sequence[Row]]) -> None:
    """What each group reaches at which cost."""
    for (group, front), dashes in zip(fronts.items(), STYLES * len(fronts), strict=False):
        points = _shown(front, name)
        if points[0]:
            label = f"front, {group}" if group else "front"
            style = {"linestyle": dashes, "color": "black", "linewidth": 1.8, "alpha": 0.5}
            axis.step(*points, where="post", label=label, **style)


def _failures(axis: Any, rows: Sequence[Row], lines: Lines) -> None:
    bad = [row for row in rows if row["status"] != "ok" and isfinite(row["spent_s"])]
    label = "failed"
    for line in lines.families:
        x = [max(row["spent_s"], 1e-9) for row in bad if lines.kind(row) == line]
        style = {"color": lines.style(line)["color"], "markersize": 5}
        if _crosses(axis, x, TOP, label=label, **style):
            label = "_nolegend_"


# -- the chart of a stability map: cells in the colour of their status, and theory's lines ---------

#: distinct in grey as well
COLOURS = {
    "ok": "#2a9d8f",
    "drift": "#e9c46a",
    "blowup": "#e76f51",
    "newton": "#8c2f39",
    "timeout": "#adb5bd",
    "error": "#343a40",
    "not run": "#ffffff",
}
#: for the words of a judge of the user's own
OTHERS = ("#457b9d", "#9b5de5", "#f15bb5", "#00bbf9", "#606c38")
#: panels in a row
ABREAST = 4


def stability_chart(
    title: str,
    axes: Mapping[str, Sequence[Any]],
    status: Array,
    lines: Mapping[str, Floats],
    path: str | os.PathLike[str] | None = None,
) -> Figure:
    """Cells of a map over its last axis (to the right) and the last but one.

    Parameters
    ----------
    title : str
        Above the chart.
    axes : mapping
        Values by name; of three, the first has a panel for each value.
    status : array of str
    lines : mapping
        Arrays of the same shape; a line is drawn where they are 1.
    path : path-like, optional
        Write it here.

    Examples
    --------
    >>> axes = {"k": [1.0, 10.0], "step": [0.1, 1.0]}
    >>> figure = stability_chart("spring", axes, np.array([["ok", "ok"], ["ok", "newton"]]), {})
    >>> [text.get_text() for text in figure.legends[0].get_texts()]
    ['ok', 'newton']
    """
    names = list(axes)
    panels = [None] if len(names) == 2 else list(axes[names[0]])
    stacked = {text: field.reshape(len(panels), *field.shape[-2:]) for text, field in lines.items()}
    cells = status.reshape(len(panels), *status.shape[-2:])
    found = set(status.ravel().tolist())
    colours = _colours(found)
    wide, high = (5.2, 4.6) if len(panels) <= ABREAST else (4.2, 3.6)
    figure, shown = _panels(len(panels), ABREAST, wide, high, 2.2)
    figure.suptitle(title)
    along, up = axes[names[-1]], axes[names[-2]]
    for k, axis in enumerate(shown):
        _cells(axis, cells[k], colours)
        axis.set_xticks(range(len(along)), [_text(each) for each in along], rotation=45)
        axis.set_yticks(range(len(up)), [_text(each) for each in up])
        axis.set(xlabel=names[-1], ylabel=names[-2])
        if panels[k] is not None:
            axis.set_title(_text(panels[k]), fontsize="medium")
        for (_, field), style in zip(stacked.items(), STYLES * len(stacked), strict=False):
            _limit(axis, field[k], style)
    handles = [_patch(name, colours[name]) for name in colours if name in found]
    handles += [
        _stroke(text + _outside(field), style)
        for (text, field), style in zip(lines.items(), STYLES * len(lines), strict=False)
    ]
    figure.legend(handles=handles, loc="outside right upper", fontsize="small")
    return write_figure(figure, path)


def _colours(found: set[str]) -> dict[str, str]:
    strange = sorted(found - set(COLOURS))
    return COLOURS | {name: OTHERS[k % len(OTHERS)] for k, name in enumerate(strange)}


def _cells(axis: Any, status: Array, colours: Mapping[str, str]) -> None:
    names = list(colours)
    numbers = np.vectorize(names.index)(status)
    from matplotlib.colors import ListedColormap

    shown = ListedColormap(list(colours.values()))
    edge = {"edgecolors": "white", "linewidth": 1.0}
    places = [np.arange(count + 1) - 0.5 for count in (status.shape[1], status.shape[0])]
    axis.pcolormesh(*places, numbers, cmap=shown, vmin=-0.5, vmax=len(names) - 0.5, **edge)


def _limit(axis: Any, field: Floats, style: str) -> None:
    """Where the field, which changes by orders of magnitude from cell to cell, is 1."""
    with np.errstate(all="ignore"):
        level = np.log(field)
    level = np.ma.masked_invalid(level)
    if min(field.shape) > 1 and level.count() and level.min() < 0 < level.max():
        axis.contour(level, levels=[0.0], colors="black", linestyles=[style], linewidths=1.6)


def _outside(field: Floats) -> str:
    """Where the cells are, in words, if the line does not run between them."""
    values = field[np.isfinite(field)]
    if not values.size or values.min() <= 1 <= values.max():
        return ""
    return " (all cells beyond)" if values.min() > 1 else " (no cell beyond)"


def _patch(name: str, colour: str) -> Any:
    from matplotlib.patches import Patch

    return Patch(facecolor=colour, edgecolor="0.5", label=name)


def _stroke(text: str, style: str) -> Any:
    from matplotlib.lines import Line2D

    return Line2D([], [], color="black", linestyle=style, label=text)


def _text(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


# -- errors against unknowns as a log-log chart (matplotlib, optional) -----------------------------


def chart_errors(
    lines: Mapping[str, tuple[Sequence[float], Sequence[float]]],
    tolerance: float | None = None,
    path: str | os.PathLike[str] | None = None,
) -> Figure:
    """Errors against unknowns, each line with markers.

    Parameters
    ----------
    lines : mapping of str to (unknowns, errors)
        By what the legend says.
    tolerance : float, optional
        A dashed line.
    path : path, optional
        Picture to write.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    InputError
        If there is nothing to draw, or the folder of `path` does not exist.
    ImportError
        Without matplotlib.

    Examples
    --------
    >>> figure = chart_errors({"uniform": ([10, 20, 40], [1e-1, 6e-3, 4e-4])}, tolerance=1e-3)
    >>> len(figure.axes[0].lines)
    2
    """
    if not lines:
        raise InputError("argument lines", "there is nothing to draw")
    figure = new_figure(5.0, 4.0)
    draw_errors(figure.subplots(), lines, tolerance)
    return write_figure(figure, path)


def draw_errors(
    axes: Axes,
    lines: Mapping[str, tuple[Sequence[float], Sequence[float]]],
    tolerance: float | None = None,
    title: str = "",
) -> None:
    """The same on axes that there are; what is zero or not finite is left out."""
    from matplotlib.ticker import LogLocator, NullFormatter

    for (label, (unknowns, errors)), marker in zip(
        lines.items(), "osd^v" * len(lines), strict=False
    ):
        known = [(n, e) for n, e in zip(unknowns, errors, strict=True) if 0 < e < float("inf")]
        axes.loglog(*zip(*known, strict=True), marker=marker, markersize=4, label=label)
    if tolerance is not None:
        axes.axhline(tolerance, color="0.5", linestyle="--", linewidth=1)
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.xaxis.set_major_formatter("{x:.0f}")
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set_xlabel("unknowns")
    axes.set_ylabel("error")
    axes.set_title(title)
    axes.grid(True, which="major", linewidth=0.3)
    axes.legend()


# -- the chart of an advice: errors over costs of all candidates -----------------------------------


def draw_candidates(axis: Any, rows: Sequence[Row]) -> None:
    """The candidates of an advice on axes of matplotlib, the proposal marked."""
    axis.set(xscale="log", yscale="log", xlabel="cost in s", ylabel="error / tolerance")
    axis.xaxis.set_minor_formatter(_few)  # costs seldom span a decade
    done = [row for row in rows if row["status"] == "ok" and row["error"] > 0]
    for k, kind in enumerate(sorted({row["theories"] for row in done})):
        own = [row for row in done if row["theories"] == kind]
        for row in own:
            fill = {} if row["robust"] else {"mfc": "none"}
            style = MARKERS[k % 8]
            axis.plot(row["cost_s"], row["error"], style, color=f"C{k}", ms=4, **fill)
        axis.plot([], [], MARKERS[k % 8], color=f"C{k}", label=kind or "bodies")
    if not all(row["robust"] for row in done):
        axis.plot([], [], "o", mfc="none", color="grey", label="fails with half the step")
    failed = [row["cost_s"] for row in rows if row["status"] != "ok"]
    _crosses(axis, [cost for cost in failed if np.isfinite(cost)], TOP, color="k")
    axis.axhline(1.0, color="black", linewidth=0.8)
    for row in rows:
        if row["chosen"]:
            ring = {"mfc": "none", "mec": "red", "ms": 13, "mew": 2, "label": "proposal"}
            axis.plot(row["cost_s"], row["error"], "o", **ring)
    axis.grid(which="major", alpha=0.3)
    axis.tick_params(axis="x", which="both", labelsize="x-small", rotation=45)
    axis.legend(fontsize="x-small")


def _few(value: float, _place: object = None) -> str:
    """Labels of ticks between powers of ten, those that have room."""
    return f"{value:g}" if round(value / 10.0 ** np.floor(np.log10(value))) in (2, 5) else ""
