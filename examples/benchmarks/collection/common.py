"""What the files of the collection share: reference numbers, arguments, answers.

A family's file (``s03_bend45.py``) has

``ENTRIES``
    Names of its entries in ``reference.json``; a case is a key of one of their ``values`` (of a
    list, its index as text).
``QUICK``
    Cases that take a second or two; the others are in the long table only, and ``slow`` tests.
``main(case=None, data=None, order=3, elements=None, step=None, integrator="energy-momentum",
treatment="null-space", times=None) -> dict``
    Compute a case. `data` overrides the entry's physical inputs one by one, under its names;
    `elements` a beam (default: enough for the trusted digits where that is affordable), `step` in
    time (s), `times` instants of output (the step is made smaller to hit them all). Statics and
    vibrations take no notice of what they have no use for, but check it.
``rows(quick=True) -> list[dict]``
    The family's part of the table, made by :func:`tabled`.

The answer of ``main`` has the names, frames and quaternions (scalar first, body to space; e1 along
the beam) of the entry's ``values``, and ``cost_s``, ``unknowns``, ``newton_iterations``,
``converged``; also ``order``, ``elements`` (of all beams together) and ``step`` as they were taken.
Where the cases are instants: with `case` the numbers of that instant, otherwise ``t`` and each
number as a list over `times` (default: the entry's), and under each instant's key a dict of its
numbers.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from measuring import INTEGRATORS, TREATMENTS

import skfem_cosserat as sc

__all__ = ["Comparison", "Cost", "choice", "compare", "entry", "instants", "overridden"]
__all__ += ["levels", "neville", "refined", "step_for", "tabled", "timed"]

Floats = NDArray[np.float64]

FILE = Path(__file__).resolve().parent / "reference.json"


@dataclass(frozen=True)
class Comparison:
    """A number and its reference.

    Attributes
    ----------
    case, quantity : str
    computed, reference : float or list
    error : float
        Largest difference of a component.
    trusted : float
        Uncertainty of the reference, absolute.
    """

    case: str
    quantity: str
    computed: Any
    reference: Any
    error: float
    trusted: float


@dataclass
class Cost:
    """What a computation took: seconds of this process, unknowns, Newton iterations."""

    unknowns: int = 0
    newton_iterations: int = 0
    converged: bool = True
    cost_s: float = field(default=0.0)

    def fields(self) -> dict[str, Any]:
        """By the names that every answer has."""
        return dict(vars(self))

    def add(self, history: sc.History) -> None:
        """Count the iterations of a run or a path in, and whether it came to its end."""
        self.newton_iterations += int(history["newton_iterations"].sum())
        self.converged = self.converged and history.status == "completed"


@contextmanager
def timed() -> Iterator[Cost]:
    """A cost whose ``cost_s`` is the CPU time spent inside."""
    cost, begun = Cost(), time.process_time()
    try:
        yield cost
    finally:
        cost.cost_s = time.process_time() - begun


@cache
def _entries() -> dict[str, Any]:
    return dict(json.loads(FILE.read_text(encoding="utf-8")))


def entry(name: str) -> dict[str, Any]:
    """Entry of the file: ``cls``, ``origin``, ``trusted_digits``, ``data``, ``values``."""
    return dict(_entries()[name])


def overridden(defaults: Mapping[str, Any], data: Mapping[str, Any] | None) -> dict[str, Any]:
    """The defaults with these inputs in their place.

    Raises
    ------
    InputError
        If `data` is no dict, or one of them is not among the defaults, which the message lists.
    """
    if not isinstance(data, Mapping | None):
        raise sc.InputError("data", f"{data!r}, expected a dict of inputs by name")
    for name in data or {}:
        if name not in defaults:
            raise sc.InputError("data", f"{name!r} is unknown, expected among {list(defaults)}")
    return {**defaults, **(data or {})}


def choice(integrator: str, treatment: str) -> tuple[Any, Any]:
    """The objects of these names.

    Raises
    ------
    InputError
        If there is none of that name.
    """
    for kind, name, known in (
        ("integrator", integrator, INTEGRATORS),
        ("treatment", treatment, TREATMENTS),
    ):
        if name not in known:
            raise sc.InputError(kind, f"{name!r} is unknown, expected one of {list(known)}")
    return INTEGRATORS[integrator](), TREATMENTS[treatment]()


def step_for(step: float, times: Sequence[float], tolerance: float = 1e-9) -> float:
    """The largest step up to `step` that divides all these instants (s).

    Raises
    ------
    InputError
        If none above a thousandth of `step` does.
    """
    instants = [float(t) for t in times if t > 0]
    if not instants:
        return step
    first = min(instants)
    for count in range(max(1, int(np.ceil(first / step - tolerance))), int(1e3 * first / step) + 2):
        candidate = first / count
        ratios = np.array(instants) / candidate
        if abs(ratios - np.round(ratios)).max() < tolerance * ratios.max():
            return candidate
    raise sc.InputError("times", f"{list(times)}: no step of up to {step} s hits them all")


def instants(
    rows: Sequence[tuple[str, Mapping[str, Any]]],
    times: Sequence[float],
    case: str | None,
    cost: Cost,
) -> dict[str, Any]:
    """Answer for names and numbers of instants: those of one, or all as lists and by name."""
    named = dict(rows)
    if case is not None:
        return {**named[case], **cost.fields()}
    lists = {name: [row[name] for _, row in rows] for name in rows[0][1]}
    return {"t": [float(t) for t in times], **lists, **named, **cost.fields()}


def compare(
    case: str, computed: Mapping[str, Any], reference: Mapping[str, Any], trusted: float
) -> list[Comparison]:
    """All numbers that both have; `trusted` absolute."""
    out = []
    for name, value in reference.items():
        if name not in computed or name in ("unc", "resid", "u_rel_unc"):
            continue
        theirs, mine = np.asarray(value, dtype=float), np.asarray(computed[name], dtype=float)
        error = float(abs(mine - theirs).max())
        out.append(Comparison(case, name, computed[name], value, error, trusted))
    return out


def tabled(
    family: str, result: Mapping[str, Any], comparisons: Sequence[Comparison]
) -> list[dict[str, Any]]:
    """Rows of the table for what was compared in one answer of ``main``."""
    taken = ("order", "elements", "step", "cost_s", "unknowns", "newton_iterations", "converged")
    shared = {name: result[name] for name in taken}
    return [{"id": family, **vars(c), **shared} for c in comparisons]


def levels(elements: int, order: int, least: int) -> list[int]:
    """Elements of up to three meshes: all, half and a quarter, with at least `least` nodes."""
    coarser = [n for n in (elements // 2, elements // 4) if n * order >= least]
    return [elements, *coarser]


def refined(values: Sequence[Any], counts: Sequence[int], order: int) -> Floats:
    """Limit of numbers on meshes of so many elements of order p.

    Their errors are a series in h^(2p), h^(2p + 2) ...; as many terms are eliminated as there are
    coarser meshes.
    """
    h = counts[0] / np.array(counts, dtype=float)
    powers = [np.ones(len(h)), *(h ** (2 * order + 2 * k) for k in range(len(h) - 1))]
    weights = np.linalg.inv(np.transpose(powers))[0]
    return np.tensordot(weights, np.array(values, dtype=float), 1)


def neville(values: Sequence[Floats], squares: Sequence[float]) -> list[list[Floats]]:
    """Rows of the scheme: polynomials through values over squares of a step, at zero.

    The last of the last row takes them all in; the one before it all but the first.
    """
    rows: list[list[Floats]] = []
    for k, value in enumerate(values):
        rows.append([value])
        for j in range(1, k + 1):
            ratio = squares[k - j] / squares[k]
            rows[k].append(rows[k][-1] + (rows[k][-1] - rows[k - 1][j - 1]) / (ratio - 1))
    return rows
