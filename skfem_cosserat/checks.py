"""Doubts about results: a table of checks that look at what is finished, once, at its end.

To add one, write a function that yields the doubts it finds in a result, and name it in
:data:`CHECKS` with the kinds of results that it looks at.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from .diagnostics.energy import group_stretches
from .errors import AccuracyWarning, CosseratWarning
from .frames import StructuralItem
from .history import History
from .model import System
from .model.groups import BeamGroup
from .warn import warn

# -- results, and what is doubtful about them ------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Recorded:
    """Recorded states of a scene; see the subclasses.

    Attributes
    ----------
    system : System
    history : History
    """

    system: System
    history: History


class Run(Recorded):
    """States of a run in time."""


class Path(Recorded):
    """Points of a path of equilibria."""


class Doubt(NamedTuple):
    """Arguments of :func:`skfem_cosserat.warn.warn` without the category.

    Attributes
    ----------
    item : str
        Label of what it is about.
    text : str
        What was found, and what to do.
    time : float, optional
        When (s), or at which load factor.
    """

    item: str
    text: str
    time: float | None = None


class Check(NamedTuple):
    """A row of the table.

    Attributes
    ----------
    name : str
    of : tuple of type
        Kinds of results that it looks at.
    category : type
        Of its warnings.
    test : callable
        Yields the doubts about a result.
    """

    name: str
    of: tuple[type, ...]
    category: type[CosseratWarning]
    test: Callable[[Any], Iterator[Doubt]]


def apply(result: object) -> None:
    """Warn of all that is doubtful about a finished result.

    Parameters
    ----------
    result : Run or Path
    """
    for check in CHECKS:
        if isinstance(result, check.of):
            for doubt in check.test(result):
                warn(doubt.item, doubt.text, check.category, doubt.time)


def _owner(system: System, group: BeamGroup, element: int) -> tuple[StructuralItem, int]:
    """The beam that an element of a group belongs to, and its number there."""
    beams = ((item, group.slices.get(id(item), slice(0))) for item in system.structures)
    return next((item, element - s.start) for item, s in beams if s.start <= element < s.stop)


# -- elements without length -----------------------------------------------------------------------


def inside_out(result: Recorded) -> Iterator[Doubt]:
    """Elements that are pressed to no length or less, as no real bar can be."""
    for group in result.system.beam_groups:
        stretch = group_stretches(group, result.history["q"])
        rows = np.flatnonzero((stretch <= 0).any(axis=(1, 2)))
        if not len(rows):
            continue
        least = stretch[rows[0]].min(axis=1)
        beam, e = _owner(result.system, group, int(least.argmin()))
        yield Doubt(
            beam.label,
            f"element {e} is pressed inside out: its axial strain is {least.min() - 1:.3g}, at or"
            " below -1 nothing is left of its length; no real beam can be pressed so far: are its"
            " stiffness and its loads in the same units?",
            float(result.history.instants[rows[0]]),
        )


#: looked through in this order
CHECKS: tuple[Check, ...] = (Check("inside out", (Recorded,), AccuracyWarning, inside_out),)
