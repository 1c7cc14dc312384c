"""The three-bar swing of Leyendecker, Marsden & Ortiz, ZAMM 88 (2008) 677, section 6.2.

The scene, its ``main`` and the evaluation of its results are in ``paper/three_bar_swing.py``.
Run ``python examples/three_bar_swing.py --help`` for the choices.
"""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))

from paper.three_bar_swing import (
    CONDITION_STEPS,
    E1,
    HEIGHT,
    INERTIA,
    INTEGRATORS,
    MESH,
    PULSE,
    SPAN,
    STIFFNESS,
    TREATMENTS,
    build,
    choose,
    command_line,
    condition_number,
    evaluate,
    main,
    median_condition_number,
    run,
    scene,
    write,
)

__all__ = [
    "CONDITION_STEPS",
    "E1",
    "HEIGHT",
    "INERTIA",
    "INTEGRATORS",
    "MESH",
    "PULSE",
    "SPAN",
    "STIFFNESS",
    "TREATMENTS",
    "build",
    "choose",
    "command_line",
    "condition_number",
    "evaluate",
    "main",
    "median_condition_number",
    "run",
    "scene",
    "write",
]

if __name__ == "__main__":
    command_line()
