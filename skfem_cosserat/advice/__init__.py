"""Advice on how simple a model a scene allows: measured, not guessed."""

from .advice import Advice
from .advise import advise
from .proposal import Proposal
from .rungs import BeamFull, BeamHeld, BeamModel, BeamRigid

__all__ = ["Advice", "BeamFull", "BeamHeld", "BeamModel", "BeamRigid", "Proposal", "advise"]
