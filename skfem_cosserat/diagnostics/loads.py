"""Where the loads of a scene act at its states, with which forces and moments."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..force import Force
from ..history import History
from ..load import Load, Term, TermForce, TermLine, TermStrain
from ..model import System
from ..types import Floats
from .energy import load_factors
from .stacked import all_rows, at_place, rates


def acting(system: System) -> list[Load | Force]:
    """Loads that have places, unlike gravity, and forces there, unlike strains."""
    out = []
    for load in system.loads:
        lines = [each for each in load.made_of if isinstance(each, TermLine)]
        if load.places() or any(not isinstance(each, TermStrain) for each in lines):
            out.append(load)
    own = {id(item.whole): item.whole for item in system.couplings.own}
    return out + [each for each in own.values() if isinstance(each, Force) and each.points]


def load_wrenches(system: System, load: Load | Force, history: History) -> list[Floats]:
    """Places of a load (N, k, 3), its forces and its moments there, in space (m, N, N m).

    What is spread along a beam is one force in the middle of each element. Forces at vectors that
    are no places are left out.
    """
    y = all_rows(system, history["q"], history.instants)
    if isinstance(load, Force):
        return _of_own_law(system, load, history, y)
    found = list(_of_channels(system, load, history, y))
    return [np.concatenate(each, 1) for each in zip(*found, strict=True)]


def _of_own_law(system: System, load: Force, history: History, y: Floats) -> list[Floats]:
    """Places, forces and moments of a force by a law of the user's own."""
    own = system.couplings_of([item for item in system.couplings.own if item.whole is load])
    speeds = rates(system, history["v"], history.instants)
    turns = history.series.get("turns")
    if turns is not None:
        turns = own.named(history.meta["turns"], np.asarray(turns))
    found = own.forces(y, speeds, turns, history.instants)
    both = np.concatenate([np.stack([x, -force]) for _, x, force in found], axis=2)
    x, force = both.reshape(2, len(y), -1, 3)[:, :, load.shown]
    return [x, force, np.zeros_like(force)]


def _of_channels(
    system: System, load: Load, history: History, y: Floats
) -> Iterator[tuple[Floats, Floats, Floats]]:
    """Places, forces and moments of the terms whose vectors are constant but for a factor."""
    factors = load_factors(system, history.instants, history.series.get("amplitudes/loads"), len(y))
    loading = system.loading
    for k, (owner, term) in enumerate(zip(loading.owners, loading.terms, strict=True)):
        if owner is load and (found := _place_and_vector(system, term, y)) is not None:
            place, vector = found
            vector = factors[:, k, None, None] * vector
            none = np.zeros_like(vector)
            yield (place, none, vector) if term.axial else (place, vector, none)


def _place_and_vector(system: System, term: Term, y: Floats) -> tuple[Floats, Floats] | None:
    """Places (N, k, 3) and vectors of a term for a factor of one; None: it acts at no places."""
    if isinstance(term, TermForce):
        place = at_place(system, y, term.place)[:, None]
        value = term.value
        if term.follower:
            at = system.row_of(term.place)
            return place, (value @ y[:, at + 1 : at + 4])[:, None]
        return place, np.broadcast_to(value, place.shape)
    if not isinstance(term, TermLine) or isinstance(term, TermStrain):
        return None
    from ..element import lagrange  # imports scikit-fem, which rigid bodies do without

    beam = term.beam
    rows = system.first[id(beam)][1] + 4 * beam.basis.connectivity[term.elements]
    middle = lagrange(beam.basis.interpolation.nodes, np.array([0.5]))[:, 0]
    place = np.einsum("a,neai->nei", middle, y[:, rows])
    if not term.follower:
        return place, np.broadcast_to(term.forces().sum(1), place.shape)
    factors = term.matrices().reshape(*rows.shape, 4, *rows.shape[1:], 4)[:, :, 0].sum(1)
    return place, np.einsum("eab,neabi->nei", factors, y[:, rows[..., None] + np.arange(4)])
