"""Equilibria: load paths, limit and bifurcation points, branches."""

from .branch import Branch, branch, equilibrium
from .control import ArcLength, Control, DisplacementControl, LoadControl
from .path import static
from .schedule import Point

__all__ = [
    "ArcLength",
    "Branch",
    "Control",
    "DisplacementControl",
    "LoadControl",
    "Point",
    "branch",
    "equilibrium",
    "static",
]
