"""Doubts about a scene that a result shows: what falls, opens, leaves its plane or moves freely."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..diagnostics.nearest import free_motion
from ..diagnostics.stacked import reduced_tangent
from ..model.balance import balance
from ..model.limits import broken_constraint
from ..model.parts import separate_parts
from ..model.plane import functions_off_plane
from ..types import spread
from .motion import Run
from .result import Doubt, Path, recorded_amplitudes


def falls(run: Run) -> Iterator[Doubt]:
    """A scene that starts at rest, and that gravity pulls away as a whole, as nothing holds it.

    Where events or forces of own laws act, it is meant to fall: onto something, or after a release.
    """
    system = run.system
    history = run.history
    weights = [np.any(term.acceleration()) for term in system.loading.terms]
    weighed = bool(weights) and all(weights) and not system.couplings.own
    free = weighed and separate_parts(system).free.all()
    first, last = history["p"][[0, -1]]
    if free and np.any(last) and not (history.meta["eventful"] or np.any(first)):
        yield Doubt("model", "nothing ties it to the ground, so all of it falls")


def open_constraints(run: Run) -> Iterator[Doubt]:
    """Constraints that recorded states do not fulfil to rounding; the first of some states."""
    system = run.system
    history = run.history
    first, end = history.segments[-1]  # those of this system
    for k in (first + spread(end - first)).tolist():
        t = float(history.times[k])
        if wrong := broken_constraint(system, system.extend(history["q"][k], t)):
            yield Doubt("argument settings", f"a recorded state {wrong}, above rounding", t)
            return


def off_plane(run: Run) -> Iterator[Doubt]:
    """Functions of the motion that push out of the plane of the scene."""
    k = spread(len(run.history))
    found = functions_off_plane(run.system, run.history.times[k], run.history["q"][k])
    if found is not None:
        yield Doubt(*found)


def free_end(path: Path) -> Iterator[Doubt]:
    """A motion that nothing holds in the equilibrium at the end, as of what a slack cable ties."""
    system = path.system
    history = path.history
    load_factor = float(history["load_factor"][-1])
    y = system.extend(history["q"][-1], float(history.instants[-1]))
    amplitudes = recorded_amplitudes(history)
    turns = history["turns"][-1] if "turns" in history else None
    tangent = reduced_tangent(system, y, amplitudes, balance(system, y, amplitudes, turns=turns))
    free = free_motion(system, tangent) if system.unknowns else None
    if free is not None:
        item, motion = free
        yield Doubt(
            item,
            f"can move freely in the equilibrium at the end ({motion}): where it is found there is"
            " one of many places of the same energy",
            load_factor,
        )
