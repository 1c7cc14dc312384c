"""Linear systems of one pattern: which solver takes them, and what happens where it fails."""

from .base import Factors, SingularMatrixError, Solver
from .direct import SolverBanded, SolverDense
from .pardiso import SolverPardiso
from .solver import LinearSolver, checked_solver
from .superlu import SolverMetis, SolverSuperLU

__all__ = [
    "Factors",
    "LinearSolver",
    "SingularMatrixError",
    "Solver",
    "SolverBanded",
    "SolverDense",
    "SolverMetis",
    "SolverPardiso",
    "SolverSuperLU",
    "checked_solver",
]
