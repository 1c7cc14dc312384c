"""A joint that was locked during a motion: rigid where its sides are then."""

from __future__ import annotations

from ..frames import Place
from ..relative import RelativeCoordinate
from .base import Joint
from .closed import JointFixed

__all__ = ["JointLocked"]


class JointLocked(JointFixed):
    """What became of a joint whose relative coordinates are frozen; it keeps its name.

    Parameters
    ----------
    joint : Joint
        As it was before.
    a, b : Place
        Its sides, described as they were when it was locked: both at the point of side b.
    """

    type = "locked"

    def __init__(self, joint: Joint, a: Place, b: Place) -> None:
        self.name = joint.name
        super().__init__(a, b)
        self.joint = joint

    def coordinates(self) -> tuple[RelativeCoordinate, ...]:
        """Those of the joint, which do not change any more."""
        return self.joint.coordinates()
