"""One page of a run for any browser: the scene that turns, charts, warnings, settings."""

from __future__ import annotations

import json
import re
from base64 import b64encode
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from .arguments import checked
from .errors import InputError, writing
from .export.geometry import beam_shapes, body_shapes
from .export.table import abscissa
from .figures import check_folder
from .history import History
from .notebook import html_table
from .plot import plot
from .types import Array, FilePath, Floats, IndexArray, spread

#: bytes of a page, and of them those of all but plotly and the states; bytes of a number in it
_PAGE, _REST, _NUMBER = 10_000_000, 500_000, 4 * 4 / 3
#: of the meta data
_SETTINGS = (
    *("scheme", "parameter", "until", "step_control", "solver", "kernels", "kernels_why"),
    *("beams", "bodies", "points", "joints", "couplings", "loads", "factors", "drives", "events"),
    *("versions", "machine"),
)
#: points of a curve
_POINTS = 1000
#: states, beyond which a slider has no place for more
_STATES = 1000


@checked
def write_report(history: History, path: FilePath) -> Path:
    """Write a page about a run, see :meth:`History.report`."""
    check_folder(path)
    try:
        from plotly.offline import get_plotlyjs
    except ImportError as error:
        text = "plotly is needed here: pip install skfem-cosserat[report]"
        raise ImportError(text) from error
    if not len(history):
        raise InputError("history", "has no states")
    script = get_plotlyjs()
    room = (_PAGE - _REST - len(script)) / (_scene(history, spread(1))[1].size * _NUMBER + 1)
    rows = spread(len(history), min(max(int(room), 2), _STATES))
    items, numbers = _scene(history, rows)
    thinned = f"{len(rows)} of {len(history)} states are shown" * (len(rows) < len(history))
    data = {
        "over": "load factor" if "load_factor" in history else "time in s",
        "at": abscissa(history)[rows].tolist(),
        **{"items": items, "states": _packed(numbers), "charts": _charts(history)},
    }
    settings = {name: history.meta[name] for name in _SETTINGS if name in history.meta}
    parts = {
        "title": escape(Path(path).stem),
        "thinned": thinned,
        "about": html_table("", history.summary()) + html_table("Settings", settings),
        "data": json.dumps(data).replace("<", "\\u003c"),  # names may hold the end of a script
        "plotly": script,
    }
    template = files(__package__).joinpath("report.html").read_text(encoding="utf-8")
    page = re.sub(r"\{\{(\w+)\}\}", lambda found: parts[found[1]], template)
    with writing(path):
        Path(path).write_text(page, encoding="utf-8")
    return Path(path)


def _packed(array: Array) -> dict[str, Any]:
    """Numbers of single precision as text."""
    return {"shape": array.shape, "base64": b64encode(array.astype("<f4").tobytes()).decode()}


def _scene(history: History, rows: IndexArray) -> tuple[list[dict[str, Any]], Floats]:
    """What does not change of beams, bodies and mass points, and frames (states, numbers) of all.

    Of a beam placements, d1 and d2 at equidistant places of the elements, of others placements and
    directors, one item after the other.
    """
    q, items, columns = history["q"][rows], [], [np.zeros((len(rows), 0))]
    for beam in beam_shapes(history.meta, history.static):
        centre, axes = beam.axes(q)
        frames = np.concatenate([centre[..., None, :], axes[..., :2, :]], axis=-2)
        columns.append(frames.reshape(len(q), -1))
        outlines = {int(k): beam.outline(int(k)) for k in np.unique(beam.section)}
        packed = {k: None if own is None else _packed(own) for k, own in outlines.items()}
        about = {"name": beam.name, "section": beam.section.tolist(), "outlines": packed}
        items.append(about | {"places": beam.order + 1})
    for body in body_shapes(history.meta, history.static):
        place = q[:, body.offset : body.offset + 3]
        columns.append(np.hstack([place, body.directors(q).reshape(len(q), 9)]))
        points = None if body.material is None else body.material.tolist()
        items.append({"name": body.name, "points": points, "faces": body.faces.tolist()})
    return items, np.hstack(columns)


def _charts(history: History) -> list[dict[str, Any]]:
    """Curves of the energies and of the sensors, by panel."""
    energies = [name for name in ("energy", "work_loads") if name in history][:1]
    names = [*energies, *history.sensors]
    found = []
    for axis in plot(history, names).axes if names else ():
        curves = []
        for line in axis.get_lines():
            name, (x, y) = str(line.get_label()), np.asarray(line.get_data(), dtype=float)
            some = spread(len(x), _POINTS)
            y = np.where(np.isfinite(y), y, None)[some]
            own = {"name": name.removeprefix("_"), "x": x[some].tolist(), "y": y.tolist()}
            curves += [own] * (name != "_zero")
        found.append({"label": axis.get_ylabel(), "curves": curves})
    return found
