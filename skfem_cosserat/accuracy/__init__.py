"""Accuracy, cost and stability: many runs of a problem, and what they say together.

:func:`refine` for meshes and steps. What it is made of serves other studies too: `run_all` (any
executor, resumed from a folder), `ResultTable` with `provenance`, `convergence`.
:func:`work_precision` for errors against costs, :func:`stability_map` for where methods fail.
"""

from ..export import write_rows
from ..export.table import ResultTable, provenance
from .orders import Convergence, convergence
from .precision import Front, Level, PrecisionTable, Setup, Standing, setup_grid, work_precision
from .reading import (
    AtInstants,
    MaximumOverTime,
    OverTime,
    ReferenceFinest,
    ReferenceKnown,
    ReferencePair,
    ReferenceRun,
    RootMeanSquare,
)
from .refinement import Refinement, refine
from .run import Executor, Job, Outcome, Processes, TimedOut, TimeLimit, run_all
from .scene import Component, Maximum
from .stability import FULL_PROTOCOL, JudgeEnergy, Map, Verdict, stability_map
from .tolerance import Answer, Band, answer

__all__ = [
    "FULL_PROTOCOL",
    "Answer",
    "AtInstants",
    "Band",
    "Component",
    "Convergence",
    "Executor",
    "Front",
    "Job",
    "JudgeEnergy",
    "Level",
    "Map",
    "Maximum",
    "MaximumOverTime",
    "Outcome",
    "OverTime",
    "PrecisionTable",
    "Processes",
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
    "answer",
    "convergence",
    "provenance",
    "refine",
    "run_all",
    "setup_grid",
    "stability_map",
    "work_precision",
    "write_rows",
]
