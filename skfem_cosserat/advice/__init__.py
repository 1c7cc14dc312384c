"""Advice on how simple a model a scene allows: measured, not guessed."""

from .advice import Advice
from .advise import advise
from .proposal import Proposal
from .rungs import BeamFull, BeamModel, BeamRigid, rigid_body

__all__ = ["Advice", "BeamFull", "BeamModel", "BeamRigid", "Proposal", "advise", "rigid_body"]
