"""Errors against unknowns as a log-log chart (matplotlib, optional)."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from ..errors import InputError
from ..figures import new_figure, write_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["chart_errors", "draw_errors"]


def chart_errors(
    lines: Mapping[str, tuple[Sequence[float], Sequence[float]]],
    tolerance: float | None = None,
    path: str | os.PathLike[str] | None = None,
    title: str = "",
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
    title : str

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
    draw_errors(figure.subplots(), lines, tolerance, title)
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
