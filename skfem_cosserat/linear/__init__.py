"""Linear systems of one pattern: which solver takes them, and what happens where it fails."""

from .solvers import (
    Factors,
    LinearSolver,
    SingularMatrixError,
    Solver,
    SolverBanded,
    SolverDense,
    SolverMetis,
    SolverPardiso,
    SolverSuperLU,
    checked_solver,
)

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
