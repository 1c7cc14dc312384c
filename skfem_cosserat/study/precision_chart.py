"""The chart of a work-precision study: errors over costs."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
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
#: with more series than this only groups are in the legend
SERIES = 12


def precision_chart(
    rows: Sequence[Mapping[str, Any]],
    fronts: Mapping[str, Mapping[str, Sequence[Mapping[str, Any]]]],
    reference_errors: Mapping[str, float],
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
    figure = new_figure(6.4 * len(fronts), 5.0)
    axes = figure.subplots(1, len(fronts), squeeze=False)[0]
    for axis, (name, by_group) in zip(axes, fronts.items(), strict=True):
        axis.set(xscale="log", yscale="log", title=name, xlabel="cost in s", ylabel="error")
        _points(axis, rows, name, list(by_group))
        for k, (group, front) in enumerate(by_group.items()):
            x = [row["cost_s"] for row in front]
            y = [row[f"error_{name}"] for row in front]
            if x and len(by_group) > 1:
                axis.step(x, y, where="post", color=f"C{k}", linewidth=2.2, alpha=0.6, label=group)
        _failures(axis, rows, list(by_group))
        if isfinite(reference_errors[name]) and reference_errors[name] > 0:
            bottom = min(axis.get_ylim()[0], reference_errors[name])
            axis.axhspan(bottom, reference_errors[name], color="0.85", label="below the reference")
            axis.set_ylim(bottom=bottom)
        axis.grid(which="major", alpha=0.3)
        if axis.get_legend_handles_labels()[0]:
            axis.legend(fontsize="x-small")
    return write_figure(figure, path)


def _points(axis: Any, rows: Sequence[Mapping[str, Any]], name: str, groups: list[str]) -> None:
    """Setups that were solved; those of a series with a line."""
    series: dict[tuple[str, str], list[Mapping[str, Any]]] = {}
    for row in rows:
        if row["status"] == "ok" and row["cost_s"] is not None:
            series.setdefault((row["group"], row["series"] or row["label"]), []).append(row)
    several = len(groups) > 1
    for k, ((group, label), own) in enumerate(series.items()):
        number = list(dict.fromkeys(each[1] for each in series if each[0] == group)).index(label)
        axis.plot(
            [row["cost_s"] for row in own],
            [row[f"error_{name}"] for row in own],
            marker=MARKERS[number % len(MARKERS)],
            color=f"C{groups.index(group)}" if several else f"C{k % 10}",
            linewidth=0.7,
            markersize=4,
            alpha=0.5 if several else 1.0,
            label=None if several or len(series) > SERIES else label,
        )


def _failures(axis: Any, rows: Sequence[Mapping[str, Any]], groups: list[str]) -> None:
    bad = [row for row in rows if row["status"] != "ok" and isfinite(row["spent_s"])]
    top = axis.get_xaxis_transform()  # x in seconds, y from 0 to 1
    for group in groups:
        x = [max(row["spent_s"], 1e-9) for row in bad if row["group"] == group]
        color = f"C{groups.index(group)}" if len(groups) > 1 else "0.3"
        label = f"{group}: failed" if group else "failed"
        if x:
            axis.plot(x, [TOP] * len(x), "x", color=color, transform=top, label=label, markersize=5)
