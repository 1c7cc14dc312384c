"""What came of a refinement study: tables, verdicts, charts, files for ParaView."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import InputError
from ..export import write_paraview
from ..history import History
from ..parallel import Outcome
from ..types import Array, Floats
from .cases import status
from .chart import Line, convergence_chart
from .levels import Level, Series, text
from .orders import Convergence
from .provenance import provenance
from .table import write_table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Refinement"]

#: quantities with more numbers are not in the table, only their errors
WIDE = 6


@dataclass(frozen=True, eq=False, repr=False)
class Refinement:
    """Result of :func:`refine`.

    Quantities are found by their names; with several series (orders) by name and series:
    ``"tip, order = 2"``.

    Attributes
    ----------
    title : str
        Name of the problem.
    series : list of Series
        Levels of each series: ``arguments``, ``size`` and ``name``, coarsest first.
    outcomes : dict
        By the name of the level: value or error of the problem, seconds.
    orders : dict of Convergence
        Errors, observed orders and verdict of each quantity.
    values : dict of dict
        Values of each quantity by the name of the level, as they were compared.
    notes : dict
        What went into the study, for the head of the table.

    Examples
    --------
    >>> from skfem_cosserat import refine
    >>> def area(elements):  # of a polygon in a circle
    ...     return elements / 2 * np.sin(2 * np.pi / elements)
    >>> study = refine(area, elements=(8, 16, 32, 64))
    >>> study.asymptotic, round(study.orders["value"].order, 2)
    (True, 1.99)
    >>> error, uncertainty = study.estimate["value"]
    >>> abs(study.errors["value"][-1] - (np.pi - area(64))) < uncertainty < 0.2 * error
    True
    >>> study.rows[1]["elements"], study.rows[1]["status"]
    (16, 'ok')
    """

    title: str
    series: list[Series]
    outcomes: dict[str, Outcome]
    orders: dict[str, Convergence]
    values: dict[str, dict[str, Array]]
    notes: dict[str, Any]

    @property
    def verdicts(self) -> dict[str, str]:
        """What is known of the order, in words."""
        return {name: each.verdict for name, each in self.orders.items()}

    @property
    def asymptotic(self) -> bool:
        """Whether the errors of all quantities fall as a power of the size."""
        return bool(self.orders) and all(each.asymptotic for each in self.orders.values())

    @property
    def extrapolated(self) -> dict[str, Array | None]:
        """Richardson's values; None where the levels do not bear one."""
        return {name: each.extrapolated for name, each in self.orders.items()}

    @property
    def errors(self) -> dict[str, Floats]:
        """Error of each level; see :class:`Convergence` for what they are against."""
        return {name: each.errors for name, each in self.orders.items()}

    @property
    def estimate(self) -> dict[str, tuple[float, float]]:
        """Error of the finest level that was solved, and how far to trust that number."""
        found = {}
        for name, each in self.orders.items():
            last = np.flatnonzero(np.isfinite(each.errors))
            pair = (each.errors[last[-1]], each.uncertainties[last[-1]]) if len(last) else (np.nan,)
            found[name] = float(pair[0]), float(pair[-1])
        return found

    @property
    def failed(self) -> dict[str, str]:
        """Levels without a result, and why."""
        levels = {level.name: level for series in self.series for level in series.levels}
        reasons = {name: self._state(level) for name, level in levels.items()}
        return {name: ": ".join(state) for name, state in reasons.items() if state[0] != "ok"}

    @property
    def rows(self) -> list[dict[str, Any]]:
        """One row a level, also of those that failed.

        With ``series``, the arguments, ``size``, ``status`` (``ok``, ``diverged``, ``error``,
        ``not finite``, ``interrupted``, ``not run``), ``reason``, ``seconds``, and for each
        quantity its numbers (if they are few), ``error_``, ``uncertainty_``, ``difference_`` and
        ``order_`` with its name.
        """
        return [
            row
            for series in self.series
            for row in (self._row(series, k) for k in range(len(series.levels)))
        ]

    def _names(self, series: Series) -> dict[str, str]:
        """Keys of the quantities of a series, by their own names."""
        end = f", {series.label}" if series.label else ""
        return {
            key.removesuffix(end): key
            for key in self.orders
            if not series.label or key.endswith(end)
        }

    def _state(self, level: Level) -> tuple[str, str]:
        """Status and reason."""
        outcome = self.outcomes[level.name]
        state = status(outcome)
        if state == "ok":
            keys = [key for key, values in self.values.items() if level.name in values]
            bad = [key for key in keys if not np.isfinite(self.values[key][level.name]).all()]
            return ("not finite", f"quantity {bad[0]!r}") if bad else ("ok", "")
        return state, f"{type(outcome.error).__name__}: {outcome.error}" if outcome.error else ""

    def _row(self, series: Series, k: int) -> dict[str, Any]:
        level = series.levels[k]
        row: dict[str, Any] = {"series": series.label} if len(self.series) > 1 else {}
        for name, value in level.arguments.items():
            row[name] = value if isinstance(value, int | float) else text(value)
        state, reason = self._state(level)
        row |= {"size": level.size, "status": state, "reason": reason}
        row["seconds"] = self.outcomes[level.name].seconds
        for name, key in self._names(series).items():
            value = self.values[key].get(level.name)
            if value is not None and value.size <= WIDE:
                row |= _columns(name, value)
            found = self.orders[key]
            row[f"error_{name}"] = float(found.errors[k])
            row[f"uncertainty_{name}"] = float(found.uncertainties[k])
            row[f"difference_{name}"] = float(found.differences[k])
            row[f"order_{name}"] = float(found.observed[k])
        return row

    def csv(self, path: str | os.PathLike[str]) -> Path:
        """Write the rows, with verdicts, versions, machine and commit in front of them.

        Raises
        ------
        InputError
            If the file cannot be written.
        """
        notes: dict[str, Any] = {"refinement": self.title, **self.notes, "verdicts": self.verdicts}
        limits = {name: each for name, each in self.extrapolated.items() if each is not None}
        notes["extrapolated"] = {n: v.tolist() for n, v in limits.items() if not np.iscomplexobj(v)}
        return write_table(path, notes | provenance(), self.rows)

    def chart(self, path: str | os.PathLike[str] | None = None) -> Figure:
        """Errors over sizes, both logarithmic, with a slope where the order is trusted.

        Levels that failed are crosses at the foot, errors that are hints only have open markers.

        Parameters
        ----------
        path : path-like, optional
            Write it here (``.png``, ``.svg``, ``.pdf``).

        Raises
        ------
        InputError
            If the folder does not exist, or no level was solved.
        ImportError
            Without matplotlib.
        """
        if not self.orders:
            name, why = next(iter(self.failed.items()))
            raise InputError(self.title, f"no level was solved; {name}: {why}")
        panels: dict[str, list[Line]] = {}
        for series in self.series:
            solved = [self._state(level)[0] == "ok" for level in series.levels]
            for name, key in self._names(series).items():
                line = Line(series.label, series.kind, self.orders[key], np.array(solved))
                panels.setdefault(name, []).append(line)
        return convergence_chart(panels, self.title, path)

    def paraview(
        self, folder: str | os.PathLike[str], every: int = 1, fps: float | None = None
    ) -> dict[str, list[Path]]:
        """Write the history of each level as a series of its own: ``folder/elements_8/beams.pvd``.

        Parameters
        ----------
        folder : path-like
            Made if needed.
        every, fps
            See :func:`write_paraview`.

        Returns
        -------
        dict
            The files to open, by level; levels that failed are written as far as they came.

        Raises
        ------
        InputError
            If the problem gave no histories.
        """
        written = {}
        for name, outcome in self.outcomes.items():
            history = outcome.value if outcome.ok else getattr(outcome.error, "history", None)
            if outcome.ok and not isinstance(history, History):
                raise InputError(
                    f"level {name!r}",
                    f"its result is a {type(history).__name__}, ParaView series need a History",
                )
            if isinstance(history, History):
                part = re.sub(r"[^\w.+-]+", "_", name)
                written[name] = write_paraview(history, Path(folder) / part, every, fps)
        return written

    def __str__(self) -> str:
        failed = f", {len(self.failed)} failed" if self.failed else ""
        lines = [f"refinement of {self.title}: {len(self.outcomes)} levels{failed}"]
        width = max(len(level.name) for series in self.series for level in series.levels)
        for series in self.series:
            for key in self._names(series).values():
                lines += _report(key, series, self.orders[key], self._state, width)
        if not self.orders:  # no level came to its quantities
            lines += [f"  {name}: {why}" for name, why in self.failed.items()]
        return "\n".join(lines)

    def __repr__(self) -> str:
        verdicts = "; ".join(f"{name}: {verdict}" for name, verdict in self.verdicts.items())
        return f"<Refinement of {self.title}: {verdicts}>"


def _columns(name: str, value: Array) -> Mapping[str, float]:
    """Numbers of a quantity under their names."""
    numbers = value.ravel()
    parts = {name: numbers}
    if np.iscomplexobj(numbers):
        parts = {f"{name}_real": numbers.real, f"{name}_imag": numbers.imag}
    if value.size == 1:
        return {part: float(each[0]) for part, each in parts.items()}
    ends = "xyz" if value.shape == (3,) else [str(k) for k in range(value.size)]
    return {
        f"{part}_{end}": float(number)
        for part, each in parts.items()
        for end, number in zip(ends, each, strict=True)
    }


def _report(key: str, series: Series, found: Convergence, state: Any, width: int) -> list[str]:
    """Lines about one quantity."""
    lines = [f"{key}: {found.verdict}"]
    if found.extrapolated is not None and found.extrapolated.size <= WIDE:
        numbers = ", ".join(f"{each:.9g}" for each in found.extrapolated.ravel())
        lines.append(f"  extrapolated: {numbers} +- {found.uncertainty:.1e}")
    hints = not np.isfinite(found.uncertainties).any()
    for k, level in enumerate(series.levels):
        status, reason = state(level)
        line = f"  {level.name:{width}s}  "
        if status != "ok":
            lines.append(f"{line}{status}: {reason}".rstrip(": "))
            continue
        line += f"{'differs by' if hints else 'error'} {found.errors[k]:.3e}"
        if np.isfinite(found.uncertainties[k]):
            line += f" +- {found.uncertainties[k]:.1e}"
        if np.isfinite(found.observed[k]):
            line += f"  order {found.observed[k]:.2f}"
        lines.append(line)
    return lines
