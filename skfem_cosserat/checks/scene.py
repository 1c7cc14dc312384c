"""Doubts about a scene that a result shows: what falls, opens, leaves its plane or moves freely."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.sparse import identity
from scipy.sparse.linalg import splu

from ..diagnostics.stacked import blocks_matrix, material_stiffness, reduced_tangent
from ..model.balance import balance
from ..model.limits import broken_constraint, owner
from ..model.parts import separate_parts
from ..model.plane import functions_off_plane
from ..types import SAME, spread
from .motion import Run
from .result import Doubt, Path, recorded_amplitudes

#: stiffness of a motion, against the terms that it is made of, below which nothing holds it: of
#: free motions it was below 5e-16, of a soft beam on a stiff one above 1.6e-13 (measured)
FREE = 1e-14


def falls(run: Run) -> Iterator[Doubt]:
    """A scene that starts at rest, and that gravity pulls away as a whole, as nothing holds it.

    Where events act, it is meant to fall: onto something, or after a release.
    """
    system, history = run.system, run.history
    weights = [np.any(term.acceleration()) for term in system.loading.terms]
    free = bool(weights) and all(weights) and separate_parts(system).free.all()
    first, last = history["p"][[0, -1]]
    if free and np.any(last) and not (history.meta["eventful"] or np.any(first)):
        yield Doubt("model", "nothing ties it to the ground, so all of it falls")


def open_constraints(run: Run) -> Iterator[Doubt]:
    """Constraints that recorded states do not fulfil to rounding; the first of some states."""
    system, history = run.system, run.history
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
    system, history = path.system, path.history
    instant, load_factor = float(history.instants[-1]), float(history["load_factor"][-1])
    y, amplitudes = system.extend(history["q"][-1], instant), recorded_amplitudes(history)
    turns = history["turns"][-1] if "turns" in history else None
    tangent = reduced_tangent(system, y, amplitudes, balance(system, y, amplitudes, turns=turns))
    K, size = tangent.K, abs(tangent.K)
    if not system.unknowns:
        return
    factors = splu((K + (SAME * size.max() or 1.0) * identity(K.shape[0])).tocsc())
    motion = np.random.default_rng(0).standard_normal(K.shape[0])
    for _ in range(5):  # inverse iteration: what nothing holds is all that is left
        motion = factors.solve(motion)
        motion /= abs(motion).max()
    moved = tangent.P @ motion
    springs = [*system.mass_tangent(0.0), system.couplings.stiffness(y)]
    # what loads just take the stiffness from is critical, not free
    held = material_stiffness(system, y) + blocks_matrix(system, springs)
    if all(
        abs(x @ (A @ x)) <= FREE * (abs(x) @ (abs(A) @ abs(x)))
        for x, A in ((motion, K), (moved, held))
    ):
        moved = moved.reshape(-1, 3)
        moved[system.origin_rows] /= system.length
        row = int(np.linalg.norm(moved, axis=1).argmax())
        yield Doubt(
            owner(system, row).label,
            "can move freely in the equilibrium at the end: where it is found there is one of many"
            " places of the same energy",
            load_factor,
        )
