"""Equilibria: load paths, limit and bifurcation points, branches."""

from .branch import Branch, branch, equilibrium
from .control import ArcLength, Control, DisplacementControl, LoadControl, Point
from .path import static

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
