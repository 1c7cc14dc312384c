"""What a notebook shows of an object: its name, a table of what matters, outlines of sections."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from html import escape
from types import FunctionType, MethodType
from typing import Any

import numpy as np

from .types import Floats

#: arrays of more numbers are shown by their shape, sequences of more entries by their length
_SHOWN = 9
#: lines of a text stay lines, too long ones are broken
_PRE = '<pre style="white-space: pre-wrap">'


class Shown:
    """Base of what a notebook shows as a table.

    Examples
    --------
    >>> from skfem_cosserat import Material, SectionRectangle
    >>> SectionRectangle(0.01, 0.02, Material(210e9, 0.3, 7850)).summary()["mass in kg/m"]
    1.57
    """

    def summary(self) -> dict[str, Any]:
        """What it is: names of numbers, with their units, and values."""
        return {}

    def _brief(self) -> str:
        """Description where it is part of another object."""
        return repr(self)

    def _loops(self) -> Sequence[Floats]:
        """Outlines (k, 2) to be drawn (m), those of holes too."""
        return ()

    def _repr_html_(self) -> str:
        return html_table(type(self).__name__, self.summary(), outline_svg(self._loops()))


def brief(value: Any) -> str:
    """A value in some words: of arrays the numbers if they are few, of functions their names."""
    if isinstance(value, str | bool | int | None):
        return repr(value)
    if isinstance(value, (float, np.number)):
        return f"{value:.6g}"
    if isinstance(value, np.ndarray):
        if value.size > _SHOWN or value.dtype.kind not in "biuf":
            return f"array {value.shape}"
        return brief(value.tolist())
    if isinstance(value, (list, tuple)):
        few = len(value) <= _SHOWN
        return f"[{', '.join(map(brief, value))}]" if few else f"{len(value)} entries"
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key!r}: {brief(each)}" for key, each in value.items()) + "}"
    if isinstance(value, partial):
        return f"partial({brief(value.func)})"
    if isinstance(value, (FunctionType, MethodType, type)):
        return value.__name__
    if isinstance(value, Shown):
        return value._brief()
    return type(value).__name__


def cell_text(value: Any, line: str = "; ") -> str:
    """Text of a value of a table; `line` stands between the entries of a mapping.

    Examples
    --------
    >>> cell_text({"EA in N": 2.1e9, "parts": "root"})
    'EA in N: 2.1e+09; parts: root'
    """
    if isinstance(value, Mapping):
        return line.join(f"{name}: {text}" for name, text in table_rows(value).items())
    return value if isinstance(value, str) else brief(value)


def table_rows(rows: Mapping[str, Any], line: str = "; ") -> dict[str, str]:
    """Texts of the values of a table, see :func:`cell_text`; what is empty is left out."""
    texts = ((name, cell_text(value, line)) for name, value in rows.items() if value is not None)
    return {name: text for name, text in texts if text}


def html_table(title: str, rows: Mapping[str, Any], drawing: str = "") -> str:
    """A title, a table of two columns, a drawing (HTML) below; texts are escaped.

    Examples
    --------
    >>> "<th>part &lt;a&gt;</th>" in html_table("Beam", {"part <a>": 1})
    True
    """
    cells = "".join(
        f"<tr><th>{escape(name)}</th><td>{_PRE}{escape(text)}</pre></td></tr>"
        for name, text in table_rows(rows, "\n").items()
    )
    table = f"<table>{cells}</table>" if cells else " (empty)"
    return f"<b>{escape(title)}</b>{table}{drawing}"


def outline_svg(loops: Sequence[Floats]) -> str:
    """Closed outlines (k, 2) as a drawing, d1 to the right and d2 up; empty without any."""
    if not loops:
        return ""
    points = np.concatenate(loops)
    (x, y), (width, height) = points.min(0), np.ptp(points, axis=0)
    way = "ZM".join("L".join(f"{a:.6g},{-b:.6g}" for a, b in loop) for loop in loops)
    box = f"{x:.6g} {-y - height:.6g} {width:.6g} {height:.6g}"
    look = 'fill="#99a8bf" fill-rule="evenodd" stroke="#011b3e" vector-effect="non-scaling-stroke"'
    size = 'width="120" height="120" overflow="visible"'
    return f'<svg {size} viewBox="{box}"><path d="M{way}Z" {look}/></svg>'
