"""Studies: many runs of a problem, and what they say together.

:func:`refine` for meshes and steps. What it is made of serves other studies too: `run_cases` (any
executor, resumed from a folder), `write_table` with `provenance`, `convergence`.
:func:`work_precision` for errors against costs, :func:`stability_map` for where methods fail.
"""

from .cases import run_cases, status
from .fingerprint import identity
from .limit import TimedOut, TimeLimit
from .norms import AtInstants, MaximumOverTime, OverTime, RootMeanSquare
from .orders import Convergence, convergence
from .precision import work_precision
from .precision_table import Front, Level, PrecisionTable, Standing
from .provenance import provenance
from .reference import ReferenceFinest, ReferenceRun
from .refinement import Refinement
from .run import refine
from .setups import Setup, setup_grid
from .stability import stability_map
from .stability_table import Map
from .table import write_rows, write_table
from .truth import ReferenceKnown, ReferencePair
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
    "write_table",
]
