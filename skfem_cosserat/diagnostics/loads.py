"""Where the loads of a scene act at its states, with which forces and moments."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..frames import Place
from ..history import History
from ..load import Load, Term, TermForce, TermLine, TermStrain
from ..model import System
from ..types import Floats
from .energy import load_factors
from .stacked import all_rows, at_place, rates


def acts_somewhere(load: Load) -> bool:
    """Whether a load has places, unlike gravity, and forces there, unlike strains."""
    return any(
        term.places() or (isinstance(term, TermLine) and not isinstance(term, TermStrain))
        for term in load.made_of
    )


def load_wrenches(system: System, load: Load, history: History) -> list[Floats]:
    """Places of a load (N, k, 3), its forces and its moments there, in space (m, N, N m).

    What is spread along a beam is one force in the middle of each element. Forces at vectors that
    are no places are left out.
    """
    y = all_rows(system, history["q"], history.instants)
    acting = [*_of_channels(system, load, history, y), *_of_functions(system, load, history, y)]
    if not acting:  # functions of directions alone
        return [np.zeros((len(y), 0, 3))] * 3
    return [np.concatenate(each, axis=1) for each in zip(*acting, strict=True)]


def _of_channels(
    system: System, load: Load, history: History, y: Floats
) -> Iterator[tuple[Floats, Floats, Floats]]:
    """Places, forces and moments of the terms whose vectors are constant but for a factor."""
    given = history.series.get("amplitudes/loads")
    factors = load_factors(system, history.instants, given, len(y))
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
        place, value = at_place(system, y, term.place)[:, None], term.value
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


def _of_functions(
    system: System, load: Load, history: History, y: Floats
) -> Iterator[tuple[Floats, Floats, Floats]]:
    """Places, forces and moments of the terms that are functions of the motion."""
    functions = system.couplings.functions
    own = [(k, each) for k, each in enumerate(functions) if each.load is load]
    speeds = rates(system, history["v"], history.instants) if own else y
    for number, function in own:
        if "load_factor" in history:  # theirs are the last of all actuators, before a zero
            factors = history["amplitudes/actuators"][:, number - len(functions) - 1]
        else:
            factors = np.array([function.term.time.value(t) for t in history.instants.tolist()])
        at = [k for k, each in enumerate(function.term.points) if isinstance(each, Place)]
        x, v = function.matrix @ y[:, function.rows], function.matrix @ speeds[:, function.rows]
        states = zip(x, v, history.instants.tolist(), strict=True)
        force = np.array([function.force(*state) for state in states])
        force = factors[:, None, None] * force
        yield x[:, at], force[:, at], np.zeros_like(force[:, at])
