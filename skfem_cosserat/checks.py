"""Doubts about results: a table of checks that look at what is finished, once, at its end.

To add one, write a function that yields the doubts it finds in a result, and name it in
:data:`CHECKS` with the kinds of results that it looks at.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from .diagnostics.coarseness import energies, held_stresses
from .diagnostics.energy import group_stretches, kinetic_energy
from .diagnostics.forces import multipliers
from .diagnostics.inputs import unseen
from .diagnostics.stacked import all_rows
from .errors import AccuracyWarning, CosseratWarning, ModelWarning
from .history import History
from .model import System
from .model.balance import Amplitudes
from .model.groups import BeamGroup
from .model.limits import broken_constraint, first_over_rotated
from .model.parts import connected_parts
from .types import Floats, spread
from .warn import warn

if TYPE_CHECKING:
    from .beam import Beam

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


@dataclass(frozen=True, eq=False)
class Run(Recorded):
    """States of a run in time.

    Attributes
    ----------
    at_ends : bool
        Whether loads act at the ends of steps; else by their means.
    eventful : bool
        Whether events were asked for.
    """

    at_ends: bool
    eventful: bool


@dataclass(frozen=True, eq=False)
class Path(Recorded):
    """Points of a path of equilibria.

    Attributes
    ----------
    amplitudes : callable
        Factors of loads and actuators at a row of the history.
    free : str
        A motion that nothing holds at the end, in words; empty: there is none.
    """

    amplitudes: Callable[[int], Amplitudes]
    free: str


@dataclass(frozen=True, eq=False)
class Shapes:
    """Modes of vibration or buckling.

    Attributes
    ----------
    system : System
    told : str
        What is told of each: "frequency", "critical factor".
    power : int
        Which power of it is in proportion to energies.
    energies : (count, beams, 2) array
        By :func:`skfem_cosserat.diagnostics.coarseness.energies`.
    energy : (count,) array
        Twice that of all beams, springs and loads (J); zero where nothing can be wrong.
    """

    system: System
    told: str
    power: int
    energies: Floats
    energy: Floats


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
    result : Run, Path or Shapes
    """
    for check in CHECKS:
        if isinstance(result, check.of):
            for doubt in check.test(result):
                warn(doubt.item, doubt.text, check.category, doubt.time)


def _owner(system: System, group: BeamGroup, element: int) -> tuple[Beam, int]:
    """The beam that an element of a group belongs to, and its number there."""
    own = [(beam, group.slices[id(beam)]) for beam in system.beams if id(beam) in group.slices]
    return next((beam, element - e.start) for beam, e in own if e.start <= element < e.stop)


# -- scenes that fall ------------------------------------------------------------------------------


def falls(result: Run) -> Iterator[Doubt]:
    """A scene that starts at rest, and that gravity pulls away as a whole, as nothing holds it.

    Where events act, it is meant to fall: onto something, or after a release.
    """
    system = result.system
    weights = [np.any(term.acceleration()) for term in system.loading.terms]
    free = bool(weights) and all(weights) and connected_parts(system).free.all()
    first, last = result.history["p"][[0, -1]]
    if free and np.any(last) and not (result.eventful or np.any(first)):
        yield Doubt(
            "model",
            "nothing ties it to the ground, so all of it falls: add a joint to the ground, as"
            " JointFixed(ground(x), beam.node(name)), or a velocity if it is to fly",
        )


# -- steps that do not see what enters a run -------------------------------------------------------


def unseen_inputs(result: Run) -> Iterator[Doubt]:
    """A load, drive or moving ground that does what steps do not see."""
    found = unseen(result.system, result.history, result.at_ends)
    if found is not None:
        yield Doubt(*found)


# -- constraints that do not hold ------------------------------------------------------------------


def open_constraints(result: Run) -> Iterator[Doubt]:
    """Constraints that recorded states do not fulfil to rounding; the worst of some states."""
    system, history = result.system, result.history
    first, end = history.segments[-1]  # those of this system
    rows = first + spread(end - first)
    states = all_rows(system, history["q"][rows], history.instants[rows])
    worst = int(abs(system.constraints.stacked_values(states)).max(axis=1, initial=0.0).argmax())
    if wrong := broken_constraint(system, states[worst]):
        yield Doubt(
            "argument settings",
            f"a recorded state {wrong}, above rounding: let Newton's method go on, or take smaller"
            " steps",
            float(history.instants[rows[worst]]),
        )


# -- ends of paths that nothing holds --------------------------------------------------------------


def free_end(result: Path) -> Iterator[Doubt]:
    """An equilibrium at the end of a path that can move freely, as where a cable is slack."""
    if result.free:
        yield Doubt(
            "path",
            f"at its end {result.free}: it may as well end elsewhere, with the other treatment or"
            " with other steps; hold it with joints or springs",
            float(result.history["load_factor"][-1]),
        )


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


# -- meshes too coarse for what they show ----------------------------------------------------------

#: energy that elements lack, against all there is, above which a result is doubtful
LACKING = 0.1
#: strain that is nothing but rounding
ROUNDING = 1e-10


def coarse_history(result: Recorded) -> Iterator[Doubt]:
    """Elements too coarse for the bending that a path or a run shows.

    In motion only linear ones are looked at: their forces follow from their ends, without inertia.
    """
    system, history, beams = result.system, result.history, result.system.beams
    path = result if isinstance(result, Path) else None
    seen = np.array([path is not None or beam.basis.order == 1 for beam in beams])
    rows = spread(len(history), 5)
    states = all_rows(system, history["q"][rows], history.instants[rows])
    if not seen.any() or not np.isfinite(states).all():
        return
    if first_over_rotated(system, states[:, : system.rows]) is not None:
        return  # told of already, and nothing follows from how they are bent
    lams = np.zeros((len(rows), system.m))
    if system.theory_rows:
        lams = multipliers(system, states, history["constraint_force"][rows])
    total = np.zeros((len(beams), 2))
    for row, y, lam in zip(rows, states, lams, strict=True):
        if not np.isfinite(lam).all():
            continue
        stresses = [
            group.stress(group.strain(y)[0]) + held
            for group, held in zip(system.beam_groups, held_stresses(system, lam), strict=True)
        ]
        total += energies(system, y, stresses, path.amplitudes(row) if path else None)
    total[~seen, 0] = 0.0
    lacking, stored = total.sum(axis=0)
    stiffest = sum(b.elements.stiffness.trace(axis1=1, axis2=2) @ b.elements.lengths for b in beams)
    energy = max(lacking + stored, stiffest * len(rows) * ROUNDING**2)
    if not path:
        energy = max(energy, 2 * np.nansum(kinetic_energy(system, history["p"][rows])))
    if abs(lacking) > LACKING * energy:
        beam = beams[int(abs(total[:, 0]).argmax())]
        yield Doubt(
            beam.label,
            f"its elements are too coarse for this bending: by the balance of forces what the scene"
            f" gives way is off by some {100 * abs(lacking) / energy:.0f} %; {_finer(beam)}",
        )


def coarse_shapes(result: Shapes) -> Iterator[Doubt]:
    """Modes that the mesh makes, or makes wrong."""
    lacking, stored = result.energies.sum(axis=1).T
    energy = np.where(result.energy > 0, np.maximum(result.energy, stored), np.inf)
    share = abs(lacking) / energy
    found = np.flatnonzero(share > LACKING)
    if not len(found):
        return
    worst = int(share.argmax())
    beam = result.system.beams[int(abs(result.energies[worst, :, 0]).argmax())]
    off = (1 + share[worst]) ** (1 / result.power) - 1
    yield Doubt(
        beam.label,
        f"its elements are too coarse for mode {', '.join(map(str, found))}: by the balance of"
        f" forces the {result.told} of mode {worst} is off by some {100 * off:.0f} %;"
        f" {_finer(beam)}",
    )


def _finer(beam: Beam) -> str:
    """Advice to raise the order of a beam or to refine its mesh."""
    order = beam.basis.order
    return f"give it order=3, which is {order}, or " * (order < 3) + "take more elements"


#: looked through in this order
CHECKS: tuple[Check, ...] = (
    Check("falls", (Run,), ModelWarning, falls),
    Check("unseen inputs", (Run,), AccuracyWarning, unseen_inputs),
    Check("open constraints", (Run,), AccuracyWarning, open_constraints),
    Check("free end", (Path,), AccuracyWarning, free_end),
    Check("inside out", (Recorded,), AccuracyWarning, inside_out),
    Check("coarse mesh", (Recorded,), AccuracyWarning, coarse_history),
    Check("coarse modes", (Shapes,), AccuracyWarning, coarse_shapes),
)
