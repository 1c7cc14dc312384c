"""One page of a run for any browser: the scene that turns, charts, warnings, settings."""

from __future__ import annotations

import json
from base64 import b64encode
from collections.abc import Iterator
from html import escape
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import Any

import numpy as np

from .arguments import checked
from .errors import InputError, writing
from .export.geometry import beam_shapes, body_shapes
from .figures import check_folder
from .history import History
from .notebook import html_table
from .plot import plot
from .types import Array, FilePath, IndexArray, spread

#: so many coordinates a page has at most, which are 3 MB, and so many states and points of a curve
_COORDINATES, _STATES, _POINTS = 400_000, 1000, 1000


@checked
def write_report(history: History, path: FilePath) -> Path:
    """Write a page about a run, see :meth:`History.report`."""
    check_folder(path)
    try:
        from plotly.offline import get_plotlyjs
    except ImportError as error:
        raise ImportError("plotly is needed here: pip install skfem-cosserat[report]") from error
    if not len(history):
        raise InputError("history", "has no states")
    rows = spread(len(history), min(max(_COORDINATES // history["q"].shape[1], 2), _STATES))
    data = {
        "over": "load factor" if "load_factor" in history else "time in s",
        "at": history.abscissa[rows].tolist(),
        "items": list(_items(history, rows)),
        "charts": list(_charts(history)),
    }
    template = files(__package__).joinpath("report.html").read_text(encoding="utf-8")
    page = Template(template).substitute(
        title=escape(Path(path).stem),
        shown=f"{len(rows)} of {len(history)} states are shown",
        about=html_table("Run", history.summary()) + html_table("Settings", history.meta),
        data=json.dumps(data).replace("<", "\\u003c"),  # names may hold the end of a script
        plotly=get_plotlyjs(),
    )
    with writing(path):
        Path(path).write_text(page, encoding="utf-8")
    return Path(path)


def _packed(array: Array) -> dict[str, Any]:
    """Numbers of single precision as text."""
    return {"shape": array.shape, "base64": b64encode(array.astype("<f4").tobytes()).decode()}


def _items(history: History, rows: IndexArray) -> Iterator[dict[str, Any]]:
    """Beams, bodies and mass points.

    Each has frames (states, places, 4, 3): placements and directors, of a beam at equidistant
    places of its elements.
    """
    q = history["q"][rows]
    for beam in beam_shapes(history.meta, history.static):
        centre, axes = beam.axes(q)
        sections = beam.section.tolist()
        outlines = {k: beam.outline(k) for k in set(sections)}
        yield {
            "name": beam.name,
            "section": sections,
            "places": beam.order + 1,
            "frames": _packed(np.concatenate([centre[..., None, :], axes], -2)),
            "outlines": {k: _packed(each) for k, each in outlines.items() if each is not None},
        }
    for body in body_shapes(history.meta, history.static):
        place = q[:, None, body.offset : body.offset + 3]
        yield {
            "name": body.name,
            "faces": body.faces.tolist(),
            "frames": _packed(np.concatenate([place, body.directors(q)], 1)),
            "points": None if body.material is None else body.material.tolist(),
        }


def _charts(history: History) -> Iterator[dict[str, Any]]:
    """Curves of the energies and of the sensors, by panel."""
    for axis in plot(history).axes:
        lines = {str(line.get_label()): np.array(line.get_data()) for line in axis.get_lines()}
        curves = {name: _packed(xy[:, spread(xy.shape[1], _POINTS)]) for name, xy in lines.items()}
        yield {"label": axis.get_ylabel(), "curves": curves}
