"""Empty figures, and how they are written: what all charts share (matplotlib is optional)."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

from .errors import InputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["MISSING", "check_folder", "new_figure", "write_figure"]

MISSING = "is needed here: pip install skfem-cosserat[view]"


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
    return figure


def write_figure(figure: Figure, path: str | os.PathLike[str] | None) -> Figure:
    """Write the figure here (``.png``, ``.svg``, ``.pdf``), if anywhere, and give it back."""
    if path is not None:
        check_folder(path)
        known = figure.canvas.get_supported_filetypes()
        ending = Path(path).suffix.lstrip(".").lower()
        if ending and ending not in known:
            raise InputError(
                f"file {str(path)!r}", f"ends with .{ending}, expected one of {', '.join(known)}"
            )
        figure.savefig(path, dpi=150)
    return figure


def check_folder(path: str | os.PathLike[str]) -> None:
    """Refuse a file whose folder does not exist or cannot be written."""
    folder = Path(path).parent
    if not folder.is_dir() or not os.access(folder, os.W_OK):
        raise InputError(f"folder {str(folder)!r}", "does not exist or cannot be written")
