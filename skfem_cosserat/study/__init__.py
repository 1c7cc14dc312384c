"""Studies: many runs of a problem, and what they say together.

:func:`refine` for meshes and steps. What it is made of serves other studies too: `run_cases` (any
executor, resumed from a folder), `ResultTable` with `provenance`, `convergence`.
:func:`work_precision` for errors against costs, :func:`stability_map` for where methods fail.
"""

from ..export import write_rows
from .cases import TimedOut, TimeLimit, identity, run_cases, status
from .orders import Convergence, convergence
from .precision import Front, Level, PrecisionTable, Standing, work_precision
from .quantities import AtInstants, MaximumOverTime, OverTime, RootMeanSquare
from .references import (
    ReferenceFinest,
    ReferenceKnown,
    ReferencePair,
    ReferenceRun,
)
from .refinement import Refinement, refine
from .results import ResultTable, provenance
from .setups import Setup, setup_grid
from .stability import Map, stability_map
from .verdict import FULL_PROTOCOL, JudgeEnergy, Verdict

__all__ = [
    "FULL_PROTOCOL",
    "AtInstants",
    "Convergence",
    "Front",
    "JudgeEnergy",
    "Level",
    "Map",
    "MaximumOverTime",
    "OverTime",
    "PrecisionTable",
    "ReferenceFinest",
    "ReferenceKnown",
    "ReferencePair",
    "ReferenceRun",
    "Refinement",
    "ResultTable",
    "RootMeanSquare",
    "Setup",
    "Standing",
    "TimeLimit",
    "TimedOut",
    "Verdict",
    "convergence",
    "identity",
    "provenance",
    "refine",
    "run_cases",
    "setup_grid",
    "stability_map",
    "status",
    "work_precision",
    "write_rows",
]
