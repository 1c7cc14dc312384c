"""What adaptive refinement gives: a level for each mesh, and the last solution."""

from __future__ import annotations

import csv
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..history import History
from ..model import System
from ..types import Floats
from .chart import chart_errors
from .space import Meshes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Adapted", "Level"]


@dataclass(frozen=True, eq=False)
class Level:
    """One mesh of the sequence.

    Attributes
    ----------
    mesh : MeshCurve or dict of str to MeshCurve
        As :func:`adapt` was given it.
    order : int or dict of str to int
    elements, unknowns : int
        Of all beams; of the null space method.
    value : (T, k) array
        The quantity at its T times.
    estimate : float
        Of its error: the largest distance over the times to that of a richer mesh.
    shares : dict of str to (ne,) array
        Of the elements of each mesh in this error; by the adjoint solution with signs.
    origin : str
        Of the shares: "adjoint" or "strains".
    verified : float
        Distance to the quantity on a mesh that is richer twice; NaN where it was not looked at.
    change : str
        What was done next.
    """

    mesh: Meshes
    order: int | Mapping[str, int]
    elements: int
    unknowns: int
    value: Floats
    estimate: float
    shares: Mapping[str, Floats]
    origin: str
    verified: float = float("nan")
    change: str = ""


@dataclass(frozen=True, eq=False)
class Adapted:
    """What :func:`adapt` gives.

    Attributes
    ----------
    reached : bool
        Whether the tolerance was.
    reason : str
        Why it ended.
    tolerance : float
    levels : list of Level
    system : System
        Of the last mesh.
    history : History
        Its solution.
    best : (T, k) array
        The quantity on the richest mesh there was: better than the last value.
    """

    reached: bool
    reason: str
    tolerance: float
    levels: list[Level]
    system: System
    history: History
    best: Floats

    @property
    def mesh(self) -> Meshes:
        """The last one, as it was given."""
        return self.levels[-1].mesh

    @property
    def order(self) -> int | Mapping[str, int]:
        """Of the last mesh."""
        return self.levels[-1].order

    @property
    def value(self) -> Floats:
        """The quantity (T, k) on the last mesh."""
        return self.levels[-1].value

    @property
    def unknowns(self) -> int:
        """Of the last mesh."""
        return self.levels[-1].unknowns

    @property
    def estimate(self) -> float:
        """Of the error of the last value, from the richest mesh there was."""
        last = self.levels[-1]
        return last.estimate if np.isnan(last.verified) else last.verified

    def write_csv(self, path: str | os.PathLike[str]) -> Path:
        """One line a level: elements, orders, unknowns, values, estimates and what was done."""
        target = Path(path)
        with target.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            count = self.levels[0].value.size
            values = [f"value_{k}" for k in range(count)]
            head = ["level", "elements", "order", "unknowns", *values, "estimate", "verified"]
            writer.writerow([*head, "shares", "change"])
            for k, level in enumerate(self.levels):
                numbers = [repr(float(v)) for v in level.value.ravel()]
                row = [k, level.elements, level.order, level.unknowns, *numbers, level.estimate]
                writer.writerow([*row, level.verified, level.origin, level.change])
        return target

    def chart(self, path: str | os.PathLike[str] | None = None) -> Figure:
        """Estimated errors against unknowns (needs matplotlib); written to a file if given."""
        estimates = [level.estimate for level in self.levels]
        line = ([level.unknowns for level in self.levels], estimates)
        return chart_errors({"estimate": line}, self.tolerance, path)
