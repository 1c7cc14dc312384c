"""D9: a helicopter blade is spun up; as D5, softer: its tip lags by metres.

The stored run of others is good for two digits: compare, no pass or fail.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from collection import d05_spinup, dynamics, runs

__all__ = ["ENTRIES", "PROBLEM", "QUICK", "main", "rows", "scene"]

ENTRIES = ("D9_haug_spinup",)
QUICK = ("2.5000",)
INPUTS = {
    **{"L": 8.0, "EA": 5.03e6, "GA": 1.94e6, "EI": 566.0, "A_rho": 0.201, "J_rho": 2.27e-5},
    **{"Omega": 4.0, "T": 15.0},
}


def scene(data: dict[str, Any], elements: int, order: int) -> runs.Scene:
    """That of D5; its tip is looked at."""
    whole = d05_spinup.scene(data, elements, order)
    return whole._replace(places={"tip": whole.places["tip"]})


PROBLEM = dynamics.Problem(
    ENTRIES[0],
    INPUTS,
    scene,
    elements=(64, 24, 12, 8),
    step=1 / 40,
    levels=3,
    tolerance=1e-4,
    derived=d05_spinup.DERIVED,
    signed=("Omega",),
)


def main(
    case: str | float | None = None,
    data: dict[str, Any] | None = None,
    order: int = 3,
    elements: int | None = None,
    step: float | None = None,
    integrator: str = "energy-momentum",
    treatment: str = "null-space",
    times: list[float] | None = None,
) -> dict[str, Any]:
    """See :mod:`.common`; position and quaternion of the tip by instants."""
    return PROBLEM.tracks(case, data, order, elements, step, integrator, treatment, times)


def rows(quick: bool = True) -> list[dict[str, Any]]:
    """All instants; quick: the first ones, on a coarser mesh with larger steps."""
    if quick:
        times = [float(t) for t in QUICK]
        return PROBLEM.rows("D09", times, elements=8, ladder=(1 / 20, 2))
    return PROBLEM.rows("D09")
