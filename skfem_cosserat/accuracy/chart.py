"""Charts of all studies: errors over sizes and costs, maps (matplotlib)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..errors import InputError
from ..figures import DASHES, PAGE, Style, legend, panels, styles, write_figure
from ..types import Array, FilePath, Floats, names_known
from .orders import Convergence

if TYPE_CHECKING:
    from matplotlib.figure import Figure


Row = Mapping[str, Any]


# -- what several charts share ---------------------------------------------------------------------


def _crosses(axis: Any, x: Sequence[float] | Floats, height: float, **style: Any) -> None:
    """Crosses at a part of the height for what failed."""
    if len(x):
        place = axis.get_xaxis_transform()
        axis.plot(x, np.full(len(x), height), "x", transform=place, **{"label": "failed", **style})


def _error_label(name: str, units: str | Mapping[str, str] | None) -> str:
    """The name of an axis of errors: with its unit, or "relative"."""
    unit = units.get(name) if isinstance(units, Mapping) else units
    if unit is None:
        return f"error of {name}"
    return f"relative error of {name}" if unit in ("", "1") else f"error of {name} in {unit}"


def _with_unit(name: str) -> str:
    """The name of a parameter; steps are in seconds everywhere."""
    return "step in s" if name == "step" else name.replace("step ", "step in s ", 1)


# -- the chart of a refinement: errors over sizes with slopes --------------------------------------


@dataclass(frozen=True, eq=False)
class Line:
    """A quantity in a series: label, meaning of the sizes, numbers, which levels were solved."""

    label: str
    kind: str
    found: Convergence
    solved: Array


def convergence_chart(
    quantities: Mapping[str, Sequence[Line]],
    title: str,
    path: FilePath | None = None,
    units: str | Mapping[str, str] | None = None,
) -> Figure:
    """One panel a quantity, one line a series; crosses at the foot are levels that failed.

    Parameters
    ----------
    quantities : mapping of str to lines
        By quantity.
    title : str
        Above the chart.
    path : path-like, optional
        Write it here.
    units : str or mapping, optional
        Of the errors, by quantity; empty: they are relative.

    Examples
    --------
    >>> from skfem_cosserat.accuracy.orders import convergence
    >>> found = convergence([0.5, 0.25, 0.125, 0.0625], [np.array(h**2) for h in (8, 4, 2, 1)])
    >>> line = Line("", "step", found, np.ones(4, dtype=bool))
    >>> figure = convergence_chart({"tip": [line]}, "bend", units="m")
    >>> figure.axes[0].get_xlabel(), figure.axes[0].get_ylabel()
    ('step in s', 'error of tip in m')
    """
    down = -(-len(quantities) // 2)
    shape = (down, min(len(quantities), 2), len(quantities))
    figure, axes = panels(6.5 if len(quantities) == 1 else PAGE, 3.9 * down, *shape)
    figure.suptitle(title)
    for axis, (name, lines) in zip(axes, quantities.items(), strict=True):
        label = _error_label(name, units)
        if not all(map(_sure, lines)):
            label += "\n(open: differences between levels)"
        kinds = ", ".join(dict.fromkeys(_with_unit(line.kind) for line in lines))
        axis.set(xscale="log", yscale="log", xlabel=kinds, ylabel=label)
        shown = styles([line.label for line in lines])
        for line in lines:
            _draw(axis, line, shown[line.label])
        legend(axis, below=0 if len(quantities) == 1 else 1)
    return write_figure(figure, path)


def _sure(line: Line) -> bool:
    """True if some errors of a line have an uncertainty: they are more than hints."""
    return bool(np.isfinite(line.found.uncertainties[line.solved]).any())


def _draw(axis: Any, line: Line, style: Style) -> None:
    found = line.found
    color = style.color
    shown = line.solved & (found.errors > 0)
    what = "observed" if line.label else "order"
    what += f" {found.order:.2f} +- {max(found.spread, 0.005):.2f}"
    if not found.asymptotic:
        what = found.verdict.partition(":")[0].partition(";")[0]
    label = f"{line.label}: {what}" if line.label else what
    sure = {"linestyle": "-"} if _sure(line) else {"linestyle": "--", "markerfacecolor": "none"}
    axis.plot(found.sizes[shown], found.errors[shown], label=label, **{**style._asdict(), **sure})
    _crosses(axis, found.sizes[~line.solved], 0.04, color=color, clip_on=False)
    if found.rounding > 0 and (found.errors[shown] < 100 * found.rounding).any():
        axis.axhline(100 * found.rounding, color=color, linestyle=":", linewidth=0.8)
    if found.asymptotic:
        _slope(axis, found, shown, color)


def _slope(axis: Any, found: Convergence, shown: Array, color: str) -> None:
    """A triangle below the two finest levels that the order rests on."""
    fine = np.flatnonzero(shown & np.isfinite(found.observed))[-1]
    coarse = max(k for k in np.flatnonzero(shown) if k < fine)
    x1, x2 = found.sizes[[coarse, fine]]
    y1 = 0.4 * found.errors[coarse]
    y2 = y1 * (x2 / x1) ** found.order
    axis.plot([x1, x2, x1, x1], [y1, y2, y2, y1], color=color, linewidth=0.8)
    axis.annotate(f"{found.order:.2f}", (x1, np.sqrt(y1 * y2)), color=color, fontsize="small")


# -- the chart of a work-precision study: errors over costs ----------------------------------------

#: columns of a table by what is counted as cost, and the name of the axis
COSTS = {
    "seconds": ("cost_s", "time in s"),
    "CPU seconds": ("cost_s", "CPU time in s"),
    "iterations": ("newton_iterations", "iterations"),
    "factorisations": ("factorisations", "factorisations of the matrix"),
    "unknowns": ("unknowns", "unknowns"),
}


@dataclass(frozen=True)
class Drawn:
    """Rows of a table, and what they are drawn as.

    Attributes
    ----------
    rows : list of dict
        All of them.
    points : dict
        Rows that were solved, by quantity.
    kind, family : callable
        From a row to the name of its line, and of what has the colour of it.
    limits : dict
        Error of the reference by quantity.
    """

    rows: Sequence[Row]
    points: Mapping[str, Sequence[Row]]
    kind: Callable[[Row], str]
    family: Callable[[Row], str]
    limits: Mapping[str, float]

    @property
    def families(self) -> dict[str, str]:
        """By the name of a line, in the order of the rows."""
        return {self.kind(row): self.family(row) for row in self.rows}

    def fronts(self, by: Callable[[Row], str], name: str, column: str) -> dict[str, list[Row]]:
        """The front of a quantity of each kind, or group, of rows."""
        found = self.by(by, name, column)
        return {key: pareto(rows, name, column) for key, rows in found.items()}

    def by(self, what: Callable[[Row], str], name: str, column: str) -> dict[str, list[Row]]:
        """Rows with a place on logarithmic axes, by their kind or group."""
        found: dict[str, list[Row]] = {}
        for row in self.points[name]:
            if row[f"error_{name}"] > 0 and (row[column] or 0) > 0:
                found.setdefault(what(row), []).append(row)
        return found


def pareto(points: Iterable[Row], quantity: str, column: str = "cost_s") -> list[Any]:
    """Rows that are not beaten by another one in both cost and error, cheapest first.

    Examples
    --------
    >>> rows = [{"cost_s": c, "error_x": e} for c, e in ((1, 0.5), (2, 0.6), (3, 0.1))]
    >>> [row["cost_s"] for row in pareto(rows, "x")]
    [1, 3]
    """
    key = f"error_{quantity}"
    kept: list[Row] = []
    for row in sorted(points, key=lambda row: (row[column], row[key])):
        if not kept or row[key] < kept[-1][key]:
            kept.append(row)
    return kept


def precision_chart(
    drawn: Drawn,
    path: FilePath | None = None,
    cost: str = "seconds",
    units: str | Mapping[str, str] | None = None,
    most: int = 8,
) -> Figure:
    """One panel a quantity; see :meth:`~skfem_cosserat.accuracy.PrecisionTable.chart`.

    Raises
    ------
    InputError
        If no quantity is given, or the cost is unknown.
    """
    if cost not in COSTS:
        raise InputError("argument cost", f"{cost!r}, unknown; {names_known(cost, COSTS)}")
    if not drawn.points:
        raise InputError("argument quantities", f"[], expected some of {', '.join(drawn.limits)}")
    column, label = COSTS[cost]
    figure, axes = panels(PAGE, 4.6 * len(drawn.points), len(drawn.points))
    shown = styles({name: drawn.families[name] for name in _chosen(drawn, column, most)})
    for axis, name in zip(axes, drawn.points, strict=True):
        axis.set(xscale="log", yscale="log", xlabel=label, ylabel=_error_label(name, units))
        lines = drawn.fronts(drawn.kind, name, column)
        groups = drawn.fronts(_group, name, column)
        for group, dashes in zip(_several(lines, groups), DASHES * len(groups), strict=False):
            wide = {"linestyle": dashes, "color": "0.75", "linewidth": 4.0, "zorder": 1}
            front = f"front, {group}" if group else "front"
            _plot(axis, groups[group], name, column, drawstyle="steps-post", label=front, **wide)
        dots = {"marker": ".", "linestyle": "none"}
        for line, rows in drawn.by(drawn.kind, name, column).items():
            if line not in shown:
                rest = {"color": "0.6", "ms": 3, "label": "others", "zorder": 1.5}
                _plot(axis, rows, name, column, **dots, **rest)
                continue
            style = shown[line]
            faint = {"color": style.color, "ms": 2.5, "alpha": 0.3, "zorder": 1.8}
            _plot(axis, rows, name, column, **dots, **faint)
            marks = {**style._asdict(), "ms": 4.5, "linewidth": 1.3, "label": line}
            _plot(axis, lines[line], name, column, **marks)
        if column == "cost_s":
            for line in drawn.families:
                bad = [r for r in drawn.rows if r["status"] != "ok" and drawn.kind(r) == line]
                colour = shown[line].color if line in shown else "0.6"
                times = [row["spent_s"] for row in bad if 0 < row["spent_s"] < np.inf]
                _crosses(axis, times, 0.97, color=colour, markersize=5)
        limit = drawn.limits[name]
        if isfinite(limit) and limit > 0:
            bottom = min(axis.get_ylim()[0], limit / 2)
            axis.axhspan(bottom, limit, color="0.85", label="below the reference's error", zorder=0)
            axis.set_ylim(bottom=bottom)
    legend(figure)
    return write_figure(figure, path)


def _group(row: Row) -> str:
    return str(row["group"])


def _plot(axis: Any, rows: Sequence[Row], name: str, column: str, **style: Any) -> None:
    """Errors over costs."""
    axis.plot([row[column] for row in rows], [row[f"error_{name}"] for row in rows], **style)


def _several(lines: Mapping[str, Sequence[Row]], groups: Mapping[str, Any]) -> list[str]:
    """Groups with several lines: the front of another one is its line."""
    ends = [rows[0]["group"] for rows in lines.values()]
    return [group for group in groups if ends.count(group) > 1]


def _chosen(drawn: Drawn, column: str, most: int) -> list[str]:
    """The best line of each group, and others nearest to what is cheapest, in their order."""
    ratios: dict[str, list[float]] = {line: [] for line in drawn.families}
    owners = {}
    room = most
    for name in drawn.points:
        lines, groups = (drawn.fronts(by, name, column) for by in (drawn.kind, _group))
        room = min(room, most - len(_several(lines, groups)))
        every = [row for front in groups.values() for row in front]
        for line, front in lines.items():
            owners[line] = front[0]["group"]
            for row in front:
                reach = [r[column] for r in every if r[f"error_{name}"] <= row[f"error_{name}"]]
                ratios[line].append(row[column] / min(reach))
    distance = {line: (min(each), np.log(each).mean()) for line, each in ratios.items() if each}
    near = sorted(distance, key=distance.__getitem__)
    first = {owners[line]: line for line in reversed(near)}
    best = list(dict.fromkeys((*first.values(), *near, *ratios)))[: max(room, len(first), 1)]
    return [line for line in drawn.families if line in best]


# -- the chart of a stability map: cells in the colour of their status, and theory's lines ---------


class _Cell(NamedTuple):
    """Text in the legend, colour and hatch of the cells of one status."""

    words: str
    color: str
    hatch: str = ""

    @property
    def style(self) -> dict[str, Any]:
        """Arguments of a patch; only cells of a pattern have a grey edge, which draws it."""
        edge = "0.5" if self.hatch else "white"
        return {"facecolor": self.color, "hatch": self.hatch or None, "edgecolor": edge}


#: apart in lightness by 8 and more, or by a pattern
STATUSES = {
    "ok": _Cell("solved", "#51ae92"),
    "drift": _Cell("energy drifted", "#fad282"),
    "blowup": _Cell("energy grew", "#ce563c"),
    "newton": _Cell("step not solved", "#7e1a32"),
    "timeout": _Cell("took too long", "#b1bdca", ".."),
    "error": _Cell("error", "#1d2023"),
    "not run": _Cell("not run", "#ffffff", "////"),
}
#: for the words of a judge of the user's own
OTHERS = (("#457b9d", "xx"), ("#9b5de5", "\\\\"), ("#f15bb5", "++"), ("#00bbf9", "oo"))


def stability_chart(
    title: str,
    axes: Mapping[str, Sequence[Any]],
    status: Array,
    lines: Mapping[str, Floats],
    path: FilePath | None = None,
    labels: Mapping[str, str] | None = None,
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
    labels : mapping, optional
        Names of the axes with units, and words for a status, by the name of a parameter or status.

    Examples
    --------
    >>> axes = {"k": [1.0, 10.0], "step": [0.1, 1.0]}
    >>> figure = stability_chart("spring", axes, np.array([["ok", "ok"], ["ok", "newton"]]), {})
    >>> [text.get_text() for text in figure.legends[0].get_texts()]
    ['solved', 'step not solved']
    """
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    names = list(axes)
    words = dict(labels or {})
    values = [None] if len(names) == 2 else list(axes[names[0]])
    shape = (len(values), *status.shape[-2:])
    cells = status.reshape(shape)
    kinds = _kinds(status, words)
    dashed = [*zip(lines.items(), DASHES * len(lines), strict=False)]
    across = min(len(values), 4)
    down = -(-len(values) // across)
    size = (6.5, 4.2) if across == 1 else (PAGE, 0.9 + 0.95 * PAGE / across * down)
    figure, shown = panels(*size, down, across, len(values), sharex=True, sharey=True)
    figure.suptitle(title)
    for k, axis in enumerate(shown):
        _cells(axis, cells[k], kinds)
        if values[k] is not None:
            axis.set_title(_text(values[k]), fontsize="small")
        for (_, field), style in dashed:
            _limit(axis, field.reshape(shape)[k], style)
    # the axes are shared: only the outer ones have numbers, and one name is enough
    right, up = (words.get(name, _with_unit(name)) for name in (names[-1], names[-2]))
    _ticks(shown[0].xaxis, axes[names[-1]], 9 if across == 1 else 5)
    _ticks(shown[0].yaxis, axes[names[-2]], 9)
    for k in range(across):  # the lowest of each column, where the last row is not full
        lowest = shown[k + across * ((len(values) - 1 - k) // across)]
        lowest.tick_params(axis="x", labelbottom=True)
        lowest.set_xlabel(right)
    if down == 1:
        shown[0].set_ylabel(up)
    else:
        figure.supylabel(up, fontsize="medium")
    handles: list[Any] = [Patch(label=kind.words, **kind.style) for kind in kinds.values()]
    handles += [
        Line2D([], [], color="black", linestyle=style, label=text + _outside(field))
        for (text, field), style in dashed
    ]
    legend(figure, below=0 if across == 1 else 4, handles=handles)
    return write_figure(figure, path)


def _kinds(status: Array, words: Mapping[str, str]) -> dict[str, _Cell]:
    """Styles of the statuses in a map, in the order of the legend."""
    found = set(status.ravel().tolist())
    kinds = {name: kind for name, kind in STATUSES.items() if name in found}
    for k, name in enumerate(sorted(found - set(STATUSES))):
        kinds[name] = _Cell(name, *OTHERS[k % len(OTHERS)])
    return {n: kind._replace(words=words.get(n, kind.words)) for n, kind in kinds.items()}


def _cells(axis: Any, status: Array, kinds: Mapping[str, _Cell]) -> None:
    """A rectangle each."""
    from matplotlib.patches import Rectangle

    for (row, column), name in np.ndenumerate(status):
        style = kinds[str(name)].style | {"linewidth": 0.5, "zorder": 1}
        axis.add_patch(Rectangle((column - 0.5, row - 0.5), 1, 1, **style))
    axis.grid(False)
    axis.set(xlim=(-0.5, status.shape[1] - 0.5), ylim=(-0.5, status.shape[0] - 0.5))


def _ticks(axis: Any, values: Sequence[Any], most: int) -> None:
    """At most so many of the values."""
    places = range(0, len(values), -(-len(values) // most))
    axis.set_ticks(places, [_text(values[k]) for k in places])


def _limit(axis: Any, field: Floats, style: str) -> None:
    """Draw the line where the field is 1, found by its logarithm."""
    with np.errstate(all="ignore"):
        level = np.log(field)
    level = np.ma.masked_invalid(level)
    if min(field.shape) > 1 and level.count() and level.min() < 0 < level.max():
        axis.contour(level, levels=[0.0], colors="black", linestyles=[style], linewidths=1.6)


def _outside(field: Floats) -> str:
    """Note for the legend if all cells, or none, lie beyond the line; else empty."""
    values = field[np.isfinite(field)]
    if not values.size or values.min() <= 1 <= values.max():
        return ""
    return " (all cells beyond)" if values.min() > 1 else " (no cell beyond)"


def _text(value: Any) -> str:
    return f"{value:.3g}" if isinstance(value, float) else str(value)
