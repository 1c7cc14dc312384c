"""Studies: many runs of a problem, and what they say together.

:func:`refine` for meshes and steps. What it is made of serves other studies too: `run_cases` (any
executor, resumed from a folder), `write_table` with `provenance`, `convergence`.
"""

from .cases import run_cases, status
from .fingerprint import identity
from .norms import AtInstants, MaximumOverTime, OverTime, RootMeanSquare
from .orders import Convergence, convergence
from .provenance import provenance
from .reference import ReferenceFinest, ReferenceRun
from .refinement import Refinement
from .run import refine
from .table import write_rows, write_table

__all__ = [
    "AtInstants",
    "Convergence",
    "MaximumOverTime",
    "OverTime",
    "ReferenceFinest",
    "ReferenceRun",
    "Refinement",
    "RootMeanSquare",
    "convergence",
    "identity",
    "provenance",
    "refine",
    "run_cases",
    "status",
    "write_rows",
    "write_table",
]
