"""What came of a stability map: arrays over the axes, table, chart."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import InputError
from ..types import Array, Floats
from .levels import check_call
from .provenance import provenance
from .stability_chart import Lines, stability_chart
from .table import write_table
from .verdict import Verdict

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Map"]


@dataclass(frozen=True, eq=False, repr=False)
class Map:
    """Result of :func:`stability_map`; arrays have an axis for each parameter, in their order.

    Attributes
    ----------
    title : str
        Name of the problem.
    axes : dict
        Values of each parameter by its name.
    cells : array of Verdict
    seconds : array
        How long each cell took.

    Examples
    --------
    >>> from skfem_cosserat import stability_map
    >>> def fails(step, stiffness):
    ...     if step * stiffness**0.5 > 2:
    ...         raise ArithmeticError("it does not")
    >>> found = stability_map(fails, {"step": (0.1, 1.0), "stiffness": (1.0, 9.0)},
    ...                       lambda result: "ok" if result is None else "blowup")
    >>> found.status.tolist(), found.rows[3]["stiffness"]
    ([['ok', 'ok'], ['ok', 'blowup']], 9.0)
    """

    title: str
    axes: dict[str, list[Any]]
    cells: Array
    seconds: Floats

    @classmethod
    def joined(cls, axes: Mapping[str, Iterable[Any]], parts: Sequence[Map]) -> Map:
        """One map from several of the same problem; cells that none of them has are ``not run``.

        Parameters
        ----------
        axes : mapping
            Of the whole.
        parts : sequence of Map
            With the same parameters.

        Raises
        ------
        InputError
            If there are no parts, or one has other parameters.
        """
        whole = {name: list(values) for name, values in axes.items()}
        if not parts or any(list(each.axes) != list(whole) for each in parts):
            names = ", ".join(whole)
            raise InputError("argument parts", f"{list(parts)!r}, expected maps over {names}")
        known: dict[tuple[Any, ...], tuple[Verdict, float]] = {}
        for each in parts:
            cells = zip(each.cells.flat, each.seconds.flat, strict=True)
            known |= dict(zip(product(*each.axes.values()), cells, strict=True))
        none = Verdict("not run"), float("nan")
        found = [known.get(choice, none) for choice in product(*whole.values())]
        shape = tuple(len(values) for values in whole.values())
        verdicts = np.empty(len(found), dtype=object)
        verdicts[:] = [verdict for verdict, _ in found]
        seconds = np.array([spent for _, spent in found])
        return cls(parts[0].title, whole, verdicts.reshape(shape), seconds.reshape(shape))

    @property
    def status(self) -> Array:
        """``ok``, ``drift``, ``blowup``, ``newton``, ``timeout``, ``error`` or ``not run``.

        With a judge of your own: its words.
        """
        return self._array("status", str)

    @property
    def time(self) -> Floats:
        """Of the blow-up, of the last step that was solved, or the end (s)."""
        return self._array("time")

    @property
    def energy_error(self) -> Floats:
        """Largest relative change of the energy until then."""
        return self._array("energy_error")

    @property
    def newton_residual(self) -> Floats:
        """Smallest scaled residual of the step that could not be solved; NaN elsewhere."""
        return self._array("newton_residual")

    @property
    def reason(self) -> Array:
        """More about it, in words."""
        return self._array("reason", str)

    @property
    def numbers(self) -> dict[str, Floats]:
        """What the judge gave beside it, by name; NaN where it did not."""
        names = dict.fromkeys(name for cell in self.cells.flat for name in cell.numbers)
        nan = float("nan")
        return {
            name: np.array([cell.numbers.get(name, nan) for cell in self.cells.flat]).reshape(
                self.cells.shape
            )
            for name in names
        }

    def _array(self, name: str, kind: type = float) -> Array:
        values = [getattr(cell, name) for cell in self.cells.flat]
        return np.array(values, dtype=kind).reshape(self.cells.shape)

    @property
    def rows(self) -> list[dict[str, Any]]:
        """One row a cell: parameters, verdict, seconds."""
        choices = product(*self.axes.values())
        return [
            {
                **dict(zip(self.axes, choice, strict=True)),
                "status": cell.status,
                "time_s": cell.time,
                "energy_error": cell.energy_error,
                "newton_residual": cell.newton_residual,
                **cell.numbers,
                "seconds": float(seconds),
                "kernels": cell.kernels,
                "reason": cell.reason,
            }
            for choice, cell, seconds in zip(
                choices, self.cells.flat, self.seconds.flat, strict=True
            )
        ]

    def csv(self, path: str | os.PathLike[str]) -> Path:
        """Write the rows, with versions, machine and commit in front of them.

        Raises
        ------
        InputError
            If the file cannot be written.
        """
        plain = int | float | str | bool
        rows = [
            {name: value if isinstance(value, plain) else str(value) for name, value in row.items()}
            for row in self.rows
        ]
        return write_table(path, {"stability map": self.title, **provenance()}, rows)

    def chart(
        self,
        path: str | os.PathLike[str] | None = None,
        lines: Lines | None = None,
        x: str | None = None,
        y: str | None = None,
        title: str | None = None,
    ) -> Figure:
        """A coloured field for each cell; theory's limits as lines.

        Parameters
        ----------
        path : path-like, optional
            Write it here (``.png``, ``.svg``, ``.pdf``).
        lines : mapping, optional
            By the text of the legend: an array over the axes, or a function of the parameters, by
            keyword. The line is drawn where it is 1: ``{"h omega = 2": lambda step, stiffness:
            step * omega(stiffness) / 2}``. NaN: none there. A line that no cell's neighbour crosses
            is in the legend, with the side on which the cells are.
        x, y : str, optional
            Parameters along the axes of the chart; default: the last two. For each value of a third
            one there is a panel.
        title : str, optional
            Default: the name of the problem.

        Raises
        ------
        InputError
            If there is one parameter, or more than three, or no such parameter; if a line is of
            another shape; if the folder does not exist.
        ImportError
            Without matplotlib.
        """
        names = list(self.axes)
        if not 2 <= len(names) <= 3:
            raise InputError(
                "chart", f"of {len(names)} parameters, expected two, or three (panels)"
            )
        rest = [name for name in names if name not in (x, y)]
        x = x or rest.pop()
        y = y or rest.pop()
        if x == y or {x, y} - set(names):
            raise InputError("chart", f"x = {x!r}, y = {y!r}, expected two of {', '.join(names)}")
        fields = {text: self._line(text, line) for text, line in (lines or {}).items()}
        order = [*[name for name in names if name not in (x, y)], y, x]
        places = [names.index(name) for name in order]
        return stability_chart(
            self.title if title is None else title,
            {name: self.axes[name] for name in order},
            self.status.transpose(places),
            {text: field.transpose(places) for text, field in fields.items()},
            path,
        )

    def _line(self, text: str, line: Any) -> Floats:
        if callable(line):
            values = product(*self.axes.values())
            choices = [dict(zip(self.axes, choice, strict=True)) for choice in values]
            check_call(line, choices[0], f"line {text!r}")
            found = [float(line(**choice)) for choice in choices]
            return np.array(found).reshape(self.cells.shape)
        field = np.asarray(line, dtype=float)
        if field.shape != self.cells.shape:
            raise InputError(
                f"line {text!r}", f"shape {field.shape}, expected {self.cells.shape}, a cell each"
            )
        return field

    def counts(self) -> Mapping[str, int]:
        """How many cells there are of each status."""
        return dict(sorted(Counter(str(cell.status) for cell in self.cells.flat).items()))

    def __str__(self) -> str:
        over = " x ".join(f"{name} ({len(values)})" for name, values in self.axes.items())
        found = ", ".join(f"{count} {name}" for name, count in self.counts().items())
        return f"stability map over {over}: {found}"

    def __repr__(self) -> str:
        return f"<{self}>"
