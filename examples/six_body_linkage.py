"""The six-body linkage of Leyendecker, Marsden & Ortiz, ZAMM 88 (2008) 677, Table 1.

The scene, its ``main`` and the evaluation of its results are in ``paper/six_body_linkage.py``.
Run ``python examples/six_body_linkage.py --help`` for the choices.
"""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))

from paper.six_body_linkage import (
    CLOSED,
    CONDITION_STEPS,
    CUBE,
    GRAVITY,
    INTEGRATORS,
    LENGTH,
    MASS,
    TREATMENTS,
    WIDTH,
    build,
    chain,
    choose,
    closing_angle,
    command_line,
    condition_number,
    evaluate,
    joint_angles,
    linkage,
    main,
    median_condition_number,
    relation,
    write,
)

__all__ = [
    "CLOSED",
    "CONDITION_STEPS",
    "CUBE",
    "GRAVITY",
    "INTEGRATORS",
    "LENGTH",
    "MASS",
    "TREATMENTS",
    "WIDTH",
    "build",
    "chain",
    "choose",
    "closing_angle",
    "command_line",
    "condition_number",
    "evaluate",
    "joint_angles",
    "linkage",
    "main",
    "median_condition_number",
    "relation",
    "write",
]

if __name__ == "__main__":
    command_line()
