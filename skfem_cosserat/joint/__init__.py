"""Joints between two places, as constraints at most quadratic in q and as relative coordinates."""

from .base import Freedom, Joint, Slide, Turn
from .closed import JointFixed, JointRevolute, JointSpherical, JointUniversal
from .locked import JointLocked
from .open import (
    JointCylindrical,
    JointDistance,
    JointPlanar,
    JointPointOnLine,
    JointPrismatic,
)

__all__ = [
    "Freedom",
    "Joint",
    "JointCylindrical",
    "JointDistance",
    "JointFixed",
    "JointLocked",
    "JointPlanar",
    "JointPointOnLine",
    "JointPrismatic",
    "JointRevolute",
    "JointSpherical",
    "JointUniversal",
    "Slide",
    "Turn",
]
