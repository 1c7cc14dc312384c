"""The chart of a stability map: cells in the colour of their status, and theory's lines."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..figures import new_figure, write_figure
from ..types import Array, Floats

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["COLOURS", "Lines", "stability_chart"]

Lines = Mapping[str, Any | Callable[..., float]]

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
STYLES = ("-", "--", ":", "-.")
#: panels in a row
ABREAST = 4


def stability_chart(
    title: str,
    axes: Mapping[str, Sequence[Any]],
    status: Array,
    lines: Mapping[str, Floats],
    path: str | os.PathLike[str] | None = None,
) -> Figure:
    """Cells over the last axis (to the right) and the last but one; see :meth:`Map.chart`.

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
    across = min(len(panels), ABREAST)
    down = -(-len(panels) // across)
    wide, high = (5.2, 4.6) if down == 1 else (4.2, 3.6)
    figure = new_figure(wide * across + 2.2, high * down)
    figure.suptitle(title)
    along, up = axes[names[-1]], axes[names[-2]]
    for k, axis in enumerate(figure.subplots(down, across, squeeze=False).flat):
        if k >= len(panels):
            axis.set_axis_off()
            continue
        _cells(axis, cells[k], colours)
        axis.set_xticks(range(len(along)), [_text(each) for each in along], rotation=45)
        axis.set_yticks(range(len(up)), [_text(each) for each in up])
        axis.set(xlabel=names[-1], ylabel=names[-2])
        if panels[k] is not None:
            axis.set_title(_text(panels[k]), fontsize="medium")
        for (_, field), style in zip(stacked.items(), STYLES * len(stacked), strict=False):
            _line(axis, field[k], style)
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


def _line(axis: Any, field: Floats, style: str) -> None:
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
