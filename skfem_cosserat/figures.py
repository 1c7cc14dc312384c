"""The style of all charts: colours and marks, axes, legends, files (matplotlib, optional).

A chart is made by :func:`panels`, its curves are drawn in the :func:`styles` of their names, its
:func:`legend` stands beside the axes, and :func:`write_figure` writes it.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from contextlib import AbstractContextManager
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from .arguments import checked
from .errors import InputError, writing
from .types import FilePath

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MISSING = "is needed here: pip install skfem-cosserat[view]"
#: width (inches) of a picture that a page shows in full: its letters are as large as the page's
PAGE = 9.0
#: any two are at least 8 apart in lightness (L* of CIELAB), so that grey prints tell them apart
PALETTE = {
    "blue": "#125d95",
    "red": "#e25533",
    "green": "#21ac81",
    "brown": "#571f01",
    "sky": "#2ebbec",
    "magenta": "#ce2386",
    "gold": "#f9b837",
    "ink": "#011b3e",
    "indigo": "#452fa1",
}
MARKS = "osD^v<>phX*Pd"
DASHES = ("-", "--", "-.", ":")


# -- colours, marks and dashes by name -------------------------------------------------------------


class Style(NamedTuple):
    """Style of a curve: arguments of matplotlib's ``plot``, by ``style._asdict()``."""

    color: str
    marker: str
    linestyle: str


def _family(color: str, first: int, *names: str) -> dict[str, Style]:
    """Names in one colour, each with a mark and dashes of its own."""
    return {
        name: Style(PALETTE[color], MARKS[(first + k) % len(MARKS)], DASHES[k % len(DASHES)])
        for k, name in enumerate(names)
    }


#: the same in all charts: integrators, other codes, beam theories; a family has one colour
NAMED = {
    **_family("blue", 0, "energy-momentum", "energy-momentum stabilized"),
    **_family("sky", 2, "energy-momentum of order 4"),
    **_family("red", 3, "variational", "variational stabilized"),
    **_family("gold", 5, "variational of order 4", "variational of order 6"),
    **_family("green", 1, "energy-decaying", "energy-decaying 0.05", "energy-decaying 5/s"),
    **_family("magenta", 7, "generalized-alpha", "generalized-alpha 0", "generalized-alpha 0.8"),
    **_family("brown", 9, "explicit"),
    **_family("blue", 0, "skfem-cosserat"),
    **_family("ink", 10, "exudyn", "pyelastica", "mujoco"),
    **_family("blue", 0, "full", "reissner"),
    **_family("red", 1, "unshearable", "kirchhoff"),
    **_family("green", 2, "inextensible"),
    **_family("brown", 3, "rigid"),
}


@checked
def styles(names: Iterable[str] | Mapping[str, str]) -> dict[str, Style]:
    """Colours, marks and dashes of the curves of a chart.

    Integrators, codes and theories have theirs in all charts; a variant (``"variational 2"``) has
    the colour of what it is a variant of. Other names get what is still free in the chart, in the
    order in which they come.

    Parameters
    ----------
    names : iterable or mapping of str
        Names of the curves; a mapping gives the family of each, which has one colour.

    Returns
    -------
    dict
        :class:`Style` by name.

    Examples
    --------
    >>> styles(["variational", "order 1", "order 2"])["variational"].color == PALETTE["red"]
    True
    """
    families = dict(names) if isinstance(names, Mapping) else {name: name for name in names}
    found = {name: NAMED[name.lower()] for name in families if name.lower() in NAMED}
    colours = {families[name]: style.color for name, style in found.items()}
    for name, family in families.items():
        if name in found:
            continue
        start = f"{name.lower()} "
        roots = [n for n in NAMED if start.startswith((f"{n} ", f"{n},", f"{n}-"))]
        root = NAMED[max(roots, key=len)] if roots else None
        if root is not None and root not in found.values():
            found[name] = root
            continue
        drawn = [style.color for style in found.values()]
        free = min(PALETTE.values(), key=drawn.count)
        colour = colours.get(family, free) if root is None else root.color
        colours.setdefault(family, colour)
        mark = min(MARKS, key=[style.marker for style in found.values()].count)
        found[name] = Style(colour, mark, DASHES[drawn.count(colour) % len(DASHES)])
    return {name: found[name] for name in families}


# -- figures and axes ------------------------------------------------------------------------------


@checked
def new_figure(width: float, height: float) -> Figure:
    """A figure (inches) that belongs to nobody else: no global state of pyplot.

    Raises
    ------
    ImportError
        Without matplotlib.

    Examples
    --------
    >>> new_figure(4.0, 3.0).axes
    []
    """
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError as error:
        raise ImportError(f"matplotlib {MISSING}") from error
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    vars(figure)["_repr_png_"] = partial(_png, figure)  # pyplot alone would have notebooks show it
    return figure


def _png(figure: Figure) -> bytes:
    """The picture that a notebook shows."""
    stream = BytesIO()
    figure.savefig(stream, dpi=100)
    return stream.getvalue()


def chart_style() -> AbstractContextManager[None]:
    """Axes that are added to a figure within it have the palette, a grid, and small letters."""
    from cycler import cycler
    from matplotlib import rc_context

    return rc_context(
        {
            "axes.prop_cycle": cycler(color=list(PALETTE.values())),
            "axes.grid": True,
            "axes.axisbelow": True,
            "grid.alpha": 0.3,
            "xtick.labelsize": "small",
            "ytick.labelsize": "small",
        }
    )


@checked
def panels(
    width: float, height: float, rows: int = 1, columns: int = 1, count: int = 0, **options: Any
) -> tuple[Figure, list[Any]]:
    """A figure (inches) and its axes, row by row.

    Parameters
    ----------
    width, height : float
        Of the figure; not wider than `PAGE` where a page shows it.
    rows, columns : int
        Of the axes.
    count : int, optional
        Only so many of them; default: all. The others stay empty.
    **options
        Of matplotlib's ``Figure.subplots``, such as ``sharex``.

    Raises
    ------
    ImportError
        Without matplotlib.

    Examples
    --------
    >>> figure, axes = panels(6.0, 4.0, 1, 2, sharey=True)
    >>> len(axes)
    2
    """
    figure = new_figure(width, height)
    with chart_style():
        axes = list(figure.subplots(rows, columns, squeeze=False, **options).flat)
    count = count or len(axes)
    for axis in axes[count:]:
        axis.set_axis_off()
    return figure, axes[:count]


@checked
def legend(
    owner: Any, title: str = "", below: int = 0, handles: Sequence[Any] | None = None
) -> None:
    """A legend beside the axes, never over curves; none if nothing has a label.

    Parameters
    ----------
    owner : figure or axes of matplotlib
        A figure's legend has what is in any of its axes, each label once.
    title : str
    below : int
        Below the axes, with so many columns; default: at the right.
    handles : sequence, optional
        What it shows; default: all that has a label.
    """
    whole = not hasattr(owner, "get_legend_handles_labels")
    if handles is None:
        axes = owner.axes if whole else [owner]
        handles = [handle for axis in axes for handle in axis.get_legend_handles_labels()[0]]
    shown = {str(handle.get_label()): handle for handle in reversed(handles)}
    if not shown:
        return
    style = {"fontsize": "small", "title_fontsize": "small", "frameon": False}
    if whole:
        style["loc"] = "outside lower center" if below else "outside right upper"
    elif below:
        # below the numbers and the name of the axis
        style |= {"loc": "upper center", "bbox_to_anchor": (0.5, -0.22)}
    else:
        style |= {"loc": "upper left", "bbox_to_anchor": (1.0, 1.0)}
    order = list(reversed(shown.values()))
    owner.legend(handles=order, ncols=max(below, 1), title=title or None, **style)


# -- files -----------------------------------------------------------------------------------------


@checked
def write_figure(figure: Figure, path: FilePath | None) -> Figure:
    """Write the figure here, if anywhere; give it back.

    Parameters
    ----------
    figure : Figure
    path : path-like or None
        ``.png``, ``.svg``, ``.pdf`` or whatever else matplotlib writes.

    Raises
    ------
    InputError
        If the folder does not exist or cannot be written, or the ending is unknown.
    StorageError
        If the disk is full.
    """
    from matplotlib.ticker import FixedLocator, LogFormatterSciNotation, LogLocator, NullFormatter

    for axis in (axis for axes in figure.axes for axis in (axes.xaxis, axes.yaxis)):
        low, high = sorted(axis.get_view_interval())
        given = isinstance(axis.get_major_locator(), FixedLocator)
        if axis.get_scale() == "log" and not given and 10 * low < high < 100 * low:
            # powers of ten alone would be one number, or two
            axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
            axis.set_major_formatter(LogFormatterSciNotation(minor_thresholds=(np.inf, np.inf)))
            axis.set_minor_formatter(NullFormatter())
    if path is not None:
        check_folder(path)
        known = figure.canvas.get_supported_filetypes()
        ending = Path(path).suffix[1:].lower()
        if ending and ending not in known:
            raise InputError(
                f"file {str(path)!r}", f"ends with .{ending}, expected one of {', '.join(known)}"
            )
        with writing(path):
            figure.savefig(path, dpi=150)
    return figure


@checked
def check_folder(path: FilePath) -> None:
    """Refuse a file whose folder does not exist or cannot be written."""
    folder = Path(path).parent
    if not folder.is_dir() or not os.access(folder, os.W_OK):
        raise InputError(f"folder {str(folder)!r}", "does not exist or cannot be written")
