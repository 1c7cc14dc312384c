"""The chart of a work-precision study: errors over costs."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from math import isfinite
from typing import TYPE_CHECKING, Any

from ..errors import InputError
from ..figures import new_figure, write_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["precision_chart"]

MARKERS = "osD^v<>ph*"
#: where crosses of failed setups stand, as a part of the height
TOP = 0.97
#: with more colours than this only fronts are in the legend
LEGEND = 12
STYLES = ("-", "--", ":", "-.")
Kind = Callable[[Mapping[str, Any]], str]


def precision_chart(
    rows: Sequence[Mapping[str, Any]],
    fronts: Mapping[str, Mapping[str, Sequence[Mapping[str, Any]]]],
    reference_errors: Mapping[str, float],
    kind: Kind | None = None,
    path: str | os.PathLike[str] | None = None,
) -> Figure:
    """One panel a quantity; see :meth:`PrecisionTable.chart`.

    Parameters
    ----------
    rows : sequence of mapping
        Of the table.
    fronts : mapping
        By quantity and group: the rows of the front.
    reference_errors : mapping
        By quantity.
    kind : callable, optional
        From a row to the name of its colour; default: its group, or its series if there is one.
    path : path-like, optional
        Write it here.

    Raises
    ------
    InputError
        If a quantity is unknown, or none is given.
    """
    unknown = [name for name in fronts if name not in reference_errors]
    if unknown or not fronts:
        known = ", ".join(reference_errors)
        raise InputError("argument quantities", f"{list(fronts)!r}, expected some of {known}")
    several = any(len(by_group) > 1 for by_group in fronts.values())
    chosen = kind or (lambda row: row["group"] if several else row["series"] or row["label"])
    figure = new_figure(6.4 * len(fronts), 5.0)
    axes = figure.subplots(1, len(fronts), squeeze=False)[0]
    for axis, (name, by_group) in zip(axes, fronts.items(), strict=True):
        axis.set(xscale="log", yscale="log", title=name, xlabel="cost in s", ylabel="error")
        kinds = list(dict.fromkeys(chosen(row) for row in rows))
        _points(axis, rows, name, chosen, kinds)
        for (group, front), style in zip(by_group.items(), STYLES * len(by_group), strict=False):
            x = [row["cost_s"] for row in front]
            y = [row[f"error_{name}"] for row in front]
            if x:
                label = f"front, {group}" if group else "front"
                line = {"linestyle": style, "color": "black", "linewidth": 1.6, "alpha": 0.8}
                axis.step(x, y, where="post", label=label, **line)
        _failures(axis, rows, chosen, kinds)
        if isfinite(reference_errors[name]) and reference_errors[name] > 0:
            bottom = min(axis.get_ylim()[0], reference_errors[name])
            axis.axhspan(bottom, reference_errors[name], color="0.85", label="below the reference")
            axis.set_ylim(bottom=bottom)
        axis.grid(which="major", alpha=0.3)
        if axis.get_legend_handles_labels()[0]:
            axis.legend(fontsize="x-small")
    return write_figure(figure, path)


def _points(
    axis: Any, rows: Sequence[Mapping[str, Any]], name: str, kind: Kind, kinds: list[str]
) -> None:
    """Setups that were solved; those of a series with a line."""
    series: dict[tuple[str, str], list[Mapping[str, Any]]] = {}
    for row in rows:
        if row["status"] == "ok" and row["cost_s"] is not None:
            series.setdefault((kind(row), row["series"] or row["label"]), []).append(row)
    told: set[str] = set()
    for (what, _), own in series.items():
        k = kinds.index(what)
        axis.plot(
            [row["cost_s"] for row in own],
            [row[f"error_{name}"] for row in own],
            marker=MARKERS[k % len(MARKERS)],
            color=f"C{k % 10}",
            linewidth=0.7,
            markersize=4,
            alpha=0.6,
            label=None if len(kinds) > LEGEND or what in told else what,
        )
        told.add(what)


def _failures(axis: Any, rows: Sequence[Mapping[str, Any]], kind: Kind, kinds: list[str]) -> None:
    bad = [row for row in rows if row["status"] != "ok" and isfinite(row["spent_s"])]
    top = axis.get_xaxis_transform()  # x in seconds, y from 0 to 1
    label = "failed"
    for k, what in enumerate(kinds):
        x = [max(row["spent_s"], 1e-9) for row in bad if kind(row) == what]
        if x:
            style = {"color": f"C{k % 10}", "transform": top, "markersize": 5}
            axis.plot(x, [TOP] * len(x), "x", label=label, **style)
            label = "_nolegend_"
