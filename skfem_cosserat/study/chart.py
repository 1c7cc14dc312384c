"""The chart of a refinement: errors over sizes with slopes."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..figures import new_figure, write_figure
from ..types import Array
from .orders import Convergence

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Line", "convergence_chart"]

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
    count = len(panels)
    columns = min(count, 3)
    rows = -(-count // columns)
    figure = new_figure(5.0 * columns, 4.0 * rows)
    figure.suptitle(title)
    axes = figure.subplots(rows, columns, squeeze=False).ravel()
    for axis in axes[count:]:
        axis.set_visible(False)
    for axis, (name, lines) in zip(axes, panels.items(), strict=False):
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
    lost = found.sizes[~line.solved]
    foot = axis.get_xaxis_transform()  # x in numbers, y from 0 to 1
    if len(lost):
        y = np.full(len(lost), 0.04)
        axis.plot(lost, y, "x", color=color, transform=foot, clip_on=False, label="failed")
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
