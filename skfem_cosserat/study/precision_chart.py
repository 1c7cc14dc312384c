"""The chart of a work-precision study: errors over costs."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from math import isfinite
from typing import TYPE_CHECKING, Any, NamedTuple

from ..errors import InputError
from ..figures import new_figure, write_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Lines", "precision_chart"]

MARKERS = "osD^v<>ph*"
DASHES = ("-", "--", "-.", ":")
#: where crosses of failed setups stand, as a part of the height
TOP = 0.97
STYLES = ("-", "--", ":", "-.")
#: number of colours of matplotlib's "tab10"; more families take those of "tab20"
FEW = 10
Row = Mapping[str, Any]


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
    """One panel a quantity; see :meth:`PrecisionTable.chart`.

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
    figure = new_figure(6.4 * len(lines.fronts) + 2.6, 5.4)
    axes = figure.subplots(1, len(lines.fronts), squeeze=False)[0]
    for axis, name in zip(axes, lines.fronts, strict=True):
        axis.set(xscale="log", yscale="log", title=name, xlabel="cost in s", ylabel="error")
        axis.minorticks_off()
        for line in lines.families:
            _line(axis, rows, name, line, lines)
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


def _line(axis: Any, rows: Sequence[Row], name: str, line: str, lines: Lines) -> None:
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
    top = axis.get_xaxis_transform()  # x in seconds, y from 0 to 1
    label = "failed"
    for line in lines.families:
        x = [max(row["spent_s"], 1e-9) for row in bad if lines.kind(row) == line]
        if x:
            style = {"color": lines.style(line)["color"], "transform": top, "markersize": 5}
            axis.plot(x, [TOP] * len(x), "x", label=label, **style)
            label = "_nolegend_"
