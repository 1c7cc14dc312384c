"""Proposals that were run, and which of two is to be preferred."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .event import Trial
from .proposal import Proposal
from .rungs import RUNGS

__all__ = ["ALIKE", "Candidate", "alike", "cost_of", "simpler_beams"]

#: of costs that are closer than this factor, more than clocks can tell, the simpler beams' counts
ALIKE = 1.15


@dataclass
class Candidate:
    """A proposal with what was predicted and what came out.

    Attributes
    ----------
    trial : Trial
    error : float
        Difference from the reference, in tolerances; infinite if it failed.
    predicted_error : float
        In tolerances; not a number if nothing was predicted.
    predicted_cost_s : float
    """

    trial: Trial
    error: float
    predicted_error: float = np.nan
    predicted_cost_s: float = np.nan


def cost_of(candidate: Candidate) -> float:
    """Processor time (s), to sort by."""
    return candidate.trial.cost_s


def alike(own: Candidate, other: Candidate) -> float:
    """The factor of the other one's cost that an own one must stay below to be preferred."""
    if simpler_beams(own.trial.proposal, other.trial.proposal):
        return ALIKE
    return 1 / ALIKE if simpler_beams(other.trial.proposal, own.trial.proposal) else 1.0


def simpler_beams(a: Proposal, b: Proposal) -> bool:
    """Whether a beam of the first is simpler than in the second, and none is less simple."""
    places = [(RUNGS.index(a.rung[name]), RUNGS.index(b.rung[name])) for name in a.rung]
    return a.rung != b.rung and all(i <= j for i, j in places)
