"""Advice on how simple a model a scene allows: measured, not guessed."""

from .advise import Advice, advise
from .proposals import BeamFull, BeamHeld, BeamModel, BeamRigid, Proposal

__all__ = ["Advice", "BeamFull", "BeamHeld", "BeamModel", "BeamRigid", "Proposal", "advise"]
