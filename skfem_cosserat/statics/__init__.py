"""Equilibria: load paths, limit and bifurcation points, branches."""

from .branch import Branch as Branch, branch as branch, equilibrium as equilibrium
from .control import (
    ArcLength as ArcLength,
    Control as Control,
    DisplacementControl as DisplacementControl,
    LoadControl as LoadControl,
    Point as Point,
)
from .path import static as static
