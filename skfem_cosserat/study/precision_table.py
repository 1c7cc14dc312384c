"""What came of a work-precision study: rows, fronts in words, where one code is behind another."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from math import ceil, floor, isfinite, log10
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import InputError
from ..types import positive
from .precision_chart import Lines, precision_chart
from .provenance import provenance
from .table import write_table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Front", "Level", "PrecisionTable", "Standing", "pareto"]

Row = Mapping[str, Any]
#: an error above this part of another one is the same on a chart
NEXT = 0.98


@dataclass(frozen=True, eq=False, repr=False)
class PrecisionTable:
    """Result of :func:`work_precision`.

    Attributes
    ----------
    rows : list of dict
        One a setup, those that failed too: ``label``, ``cost_s`` (the smallest),
        ``newton_iterations``, ``factorisations``, ``unknowns`` (None: not told), ``error_`` with
        the name of each quantity (None if it failed), ``status`` (``ok``, ``diverged``,
        ``newton``, ``timeout``, ``error``), ``reason``; and ``group``, ``series``, ``spent_s``
        (time of all its runs), ``kernels`` (that ran, empty: not told).
    reference_errors : dict
        Error of the reference itself by quantity; NaN if not known.
    notes : dict
        For the head of the table.

    Examples
    --------
    >>> from skfem_cosserat import work_precision
    >>> def crude(problem):
    ...     return {"x": problem + 0.1, "cost_s": 1.0}
    >>> def fails(problem):
    ...     raise ZeroDivisionError("no step left")
    >>> table = work_precision(2.0, [("crude", crude), ("fails", fails)], {"x": 2.0}, ["x"])
    >>> print(table)
    x: for 1e+00 in x the cheapest is crude: 1.0e-01 in 1 s
    failed: fails: diverged (ZeroDivisionError: no step left)
    """

    rows: list[dict[str, Any]]
    reference_errors: dict[str, float]
    notes: dict[str, Any]

    @property
    def quantities(self) -> list[str]:
        """Their names."""
        return list(self.reference_errors)

    @property
    def failed(self) -> dict[str, str]:
        """Setups that failed: status and reason by label."""
        bad = [row for row in self.rows if row["status"] != "ok"]
        return {row["label"]: f"{row['status']} ({row['reason']})" for row in bad}

    def points(self, quantity: str, group: str | None = None) -> list[dict[str, Any]]:
        """Rows with an error of the quantity and a cost, of one group or all.

        Raises
        ------
        InputError
            If there is no such quantity.
        """
        if quantity not in self.reference_errors:
            known = ", ".join(self.quantities)
            raise InputError(f"quantity {quantity!r}", f"unknown; there are {known}")
        return [
            row
            for row in self.rows
            if row["status"] == "ok" and row["cost_s"] is not None
            if group is None or row["group"] == group
        ]

    def front(
        self,
        quantity: str,
        errors: float | Sequence[float] | None = None,
        group: str | None = None,
    ) -> Front:
        """What reaches an error at the smallest cost.

        Parameters
        ----------
        quantity : str
        errors : float or sequence of float, optional
            Default: the powers of ten between the largest and the smallest error reached, down to
            that of the reference; 0 if there are no others.
        group : str, optional
            Only of this code.

        Raises
        ------
        InputError
            If there is no such quantity or an error is not positive.
        """
        points = self.points(quantity, group)
        if errors is None:
            levels = _decades(points, quantity, self.reference_errors[quantity])
        else:
            several = [errors] if isinstance(errors, str | bytes | int | float) else errors
            levels = [positive("argument errors", "error", each) for each in several]
        found = {level: _cheapest(points, quantity, level) for level in levels}
        return Front(quantity, found, pareto(points, quantity))

    def standing(self, quantity: str, ours: str | Callable[[Row], bool]) -> Standing:
        """Whether our front lies below that of each other group at every error that it reaches.

        Parameters
        ----------
        quantity : str
        ours : str or callable
            Our group, or whether a row is ours.

        Raises
        ------
        InputError
            If there is no such quantity, or nothing is ours.
        """
        points = self.points(quantity)
        mine = [row for row in points if (ours(row) if callable(ours) else row["group"] == ours)]
        if not mine:
            raise InputError("argument ours", f"{ours!r}: no setup of it has an error and a cost")
        own = {row["label"] for row in mine}
        floor_ = self.reference_errors[quantity]
        levels = []
        for group in dict.fromkeys(row["group"] for row in points if row["label"] not in own):
            theirs = [r for r in points if r["group"] == group and r["label"] not in own]
            for row in pareto(theirs, quantity):
                error = row[f"error_{quantity}"]
                judged = not (isfinite(floor_) and error < 2 * floor_)
                best = _cheapest(mine, quantity, error)
                levels.append(Level(group, error, row, best, judged))
        return Standing(quantity, levels)

    def csv(self, path: str | os.PathLike[str]) -> Path:
        """Write the rows, with the reference's error, versions, machine and commit before them.

        Raises
        ------
        InputError
            If the file cannot be written.
        """
        own = {
            name: each if isfinite(each) else None for name, each in self.reference_errors.items()
        }
        notes = {"work and precision": f"{len(self.rows)} setups", **self.notes}
        return write_table(path, notes | {"reference error": own} | provenance(), self.rows)

    def chart(
        self,
        path: str | os.PathLike[str] | None = None,
        quantities: Iterable[str] | None = None,
        kind: Callable[[Row], str] | None = None,
        family: Callable[[Row], str] | None = None,
    ) -> Figure:
        """Errors over costs, both logarithmic: a panel a quantity, a line a front.

        The front of each kind of setup is a line with marks, all its other setups are faint dots;
        the front of each group is a step. Setups that failed are crosses at the top, above the time
        they took until then; errors below that of the reference lie in the grey.

        Parameters
        ----------
        path : path-like, optional
            Write it here (``.png``, ``.svg``, ``.pdf``).
        quantities : iterable of str, optional
            Default: all.
        kind : callable, optional
            From a row to the name of its line; default: its group, or its series if there is one
            group only.
        family : callable, optional
            From a row to what has one colour, whose kinds differ in marks and dashes; default: each
            kind has its own.

        Raises
        ------
        InputError
            If the folder does not exist, or a quantity.
        ImportError
            Without matplotlib.
        """
        names = self.quantities if quantities is None else list(quantities)
        groups = dict.fromkeys(row["group"] for row in self.rows)
        if kind is None:
            several = len(groups) > 1
            kind = partial(_kind_by, "group" if several else "series")
        families = {kind(row): (family or kind)(row) for row in self.rows}
        fronts, own = {}, {}
        for name in names:
            points = self.points(name)
            own[name] = {
                line: _apart(pareto([row for row in points if kind(row) == line], name), name)
                for line in families
            }
            fronts[name] = {group: pareto(self.points(name, group), name) for group in groups}
        drawn = Lines(kind, families, own, fronts)
        return precision_chart(self.rows, drawn, self.reference_errors, path)

    def __str__(self) -> str:
        lines = [f"{name}: {line}" for name in self.quantities for line in self.front(name).lines]
        return "\n".join(lines + [f"failed: {label}: {why}" for label, why in self.failed.items()])

    def __repr__(self) -> str:
        return f"<PrecisionTable: {len(self.rows)} setups, {len(self.failed)} failed>"


@dataclass(frozen=True, eq=False)
class Front:
    """What is cheapest for errors of a quantity.

    Attributes
    ----------
    quantity : str
    cheapest : dict
        Row by error; None where nothing reaches it.
    points : list of dict
        Rows that no other one beats in both error and cost, cheapest first.
    """

    quantity: str
    cheapest: dict[float, dict[str, Any] | None]
    points: list[dict[str, Any]]

    @property
    def lines(self) -> list[str]:
        """In words, a line an error."""
        lines = []
        for level, row in self.cheapest.items():
            start = f"for {level:.0e} in {self.quantity}"
            if row is None:
                lines.append(f"{start} nothing is good enough")
                continue
            error = row[f"error_{self.quantity}"]
            what = f"{row['group']}: {row['label']}" if row["group"] else row["label"]
            lines.append(f"{start} the cheapest is {what}: {error:.1e} in {row['cost_s']:.3g} s")
        return lines

    def __str__(self) -> str:
        return "\n".join(self.lines)


@dataclass(frozen=True, eq=False)
class Level:
    """An error that a peer reaches, and what it costs.

    Attributes
    ----------
    group : str
        The peer.
    error : float
    theirs : dict
        The peer's row.
    ours : dict or None
        Our cheapest row with an error no larger.
    judged : bool
        False if the error is below twice that of the reference.
    """

    group: str
    error: float
    theirs: dict[str, Any]
    ours: dict[str, Any] | None
    judged: bool

    @property
    def ratio(self) -> float:
        """Our cost over theirs; infinite if we do not reach the error."""
        return float("inf") if self.ours is None else self.ours["cost_s"] / self.theirs["cost_s"]


@dataclass(frozen=True, eq=False)
class Standing:
    """Our front against the others'.

    Attributes
    ----------
    quantity : str
    levels : list of Level
        The points of each peer's front.
    """

    quantity: str
    levels: list[Level]

    @property
    def behind(self) -> list[Level]:
        """Where we do not lie below: at errors that the reference lets one judge."""
        return [level for level in self.levels if level.judged and not level.ratio < 1]

    @property
    def lines(self) -> list[str]:
        """In words: for each peer by how much, and where not."""
        lines = []
        for group in dict.fromkeys(level.group for level in self.levels):
            own = [each for each in self.levels if each.group == group and each.judged]
            if not own:
                lines.append(f"{group}: no error that the reference lets one judge")
                continue
            good = [1 / each.ratio for each in own if each.ratio < 1]
            text = f"{group}: cheaper at {len(good)} of the {len(own)} errors it reaches"
            if good:
                text += f", {min(good):.3g} to {max(good):.3g} times"
            lines.append(text)
            lines += [self._behind(each) for each in own if not each.ratio < 1]
        return lines

    def _behind(self, level: Level) -> str:
        start = f"{level.group}: behind at {level.error:.1e} in {self.quantity}"
        if level.ours is None:
            return f"{start}: not reached, the peer takes {level.theirs['cost_s']:.3g} s"
        ours, theirs = level.ours["cost_s"], level.theirs["cost_s"]
        return f"{start}: {ours:.3g} s against {theirs:.3g} s, {level.ratio:.2f} times as much"

    def __str__(self) -> str:
        return "\n".join(self.lines)


def _apart(front: list[dict[str, Any]], quantity: str) -> list[dict[str, Any]]:
    """Points of a front that can be told apart on a chart."""
    kept: list[dict[str, Any]] = []
    for row in front:
        key = f"error_{quantity}"
        if not kept or row[key] < NEXT * kept[-1][key]:
            kept.append(row)
    return kept


def _kind_by(what: str, row: Row) -> str:
    return str(row[what] or row["label"])


def pareto(points: Iterable[dict[str, Any]], quantity: str) -> list[dict[str, Any]]:
    """Rows that are not beaten by another one in both cost and error, cheapest first.

    Examples
    --------
    >>> rows = [{"cost_s": c, "error_x": e} for c, e in ((1, 0.5), (2, 0.6), (3, 0.1))]
    >>> [row["cost_s"] for row in pareto(rows, "x")]
    [1, 3]
    """
    key = f"error_{quantity}"
    kept: list[dict[str, Any]] = []
    for row in sorted(points, key=lambda row: (row["cost_s"], row[key])):
        if not kept or row[key] < kept[-1][key]:
            kept.append(row)
    return kept


def _cheapest(
    points: Iterable[dict[str, Any]], quantity: str, error: float
) -> dict[str, Any] | None:
    key = f"error_{quantity}"
    reach = [row for row in points if row[key] <= error]
    return min(reach, key=lambda row: (row["cost_s"], row[key]), default=None)


def _decades(points: Sequence[Row], quantity: str, reference: float) -> list[float]:
    """Powers of ten from the largest error reached down to the smallest one."""
    sizes = [row[f"error_{quantity}"] for row in points if row[f"error_{quantity}"] > 0]
    if not sizes:
        return [0.0] if points else []
    least = max(min(sizes), reference) if isfinite(reference) else min(sizes)
    top = floor(log10(max(sizes)))
    bottom = ceil(log10(least))
    return [10.0**k for k in range(max(top, bottom), bottom - 1, -1)]
