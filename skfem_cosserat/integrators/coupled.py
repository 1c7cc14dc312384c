"""Force elements in compiled steps: what goes in and comes out, one row for each."""

from __future__ import annotations

import numpy as np

from ..compiled.numbers import AMPLITUDE, GROUND, LOST, STEP, TRAVEL, TURNED, TURNS
from ..model.couplings import Couplings
from ..types import Floats, IndexArray
from .base import State, StepWork

__all__ = ["Coupled", "scalar"]


def scalar(couplings: Couplings) -> bool:
    """Whether all act on one number each, as the compiled ones do: not on rotation vectors."""
    return all(item.size == 1 for item in couplings.items)


class Coupled:
    """Force elements of a scene in compiled steps.

    Parameters
    ----------
    couplings : Couplings
    columns : (count, COUPLED) array
        What they have in a step, in place; see :mod:`skfem_cosserat.compiled.numbers`.
    h : float
        Step size (s).
    """

    def __init__(self, couplings: Couplings, columns: Floats, h: float) -> None:
        self._couplings, self._columns = couplings, columns
        self.resize(h)
        number = {id(item): k for k, item in enumerate(couplings.items)}
        self._driven = [number[id(item)] for item in couplings.owners]
        self._angles = [number[id(item)] for item in couplings.angles]

    def resize(self, h: float) -> None:
        """Take steps of another size (s)."""
        self._h = self._columns[:, STEP] = h

    def begin(self, state: State) -> None:
        """Forces of actuators, and full turns at the start of a step."""
        if self._driven:
            averages = self._couplings.averages(state.time, state.time + self._h)
            self._columns[self._driven, AMPLITUDE] = averages[:-1]
        if self._angles:
            self._couplings.check_turns(state.turns)
            self._columns[self._angles, TURNS] = 0 if state.turns is None else state.turns

    def turns(self) -> IndexArray | None:
        """Full turns of all angles at the end of the step; None if there are none."""
        if not self._angles:
            return None
        return np.rint(self._columns[self._angles, TURNED]).astype(np.int64)

    def work(self, loads: float, lost: float) -> StepWork:
        """Work of the step, with that of the loads and what is lost elsewhere (J)."""
        if not self._couplings.count:
            return StepWork(loads, dissipated=lost)
        c = self._columns
        actuators = float((c[:, AMPLITUDE] * c[:, TRAVEL]).sum())
        return StepWork(loads, actuators, lost + float(c[:, LOST].sum()), float(c[:, GROUND].sum()))
