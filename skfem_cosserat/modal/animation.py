"""A mode as a history: finite motions along its shape."""

from __future__ import annotations

import numpy as np

from ..errors import InputError
from ..history import History
from ..model import System
from ..model.chart import Chart
from ..model.loops import closed, tree_values
from ..simulate.describe import derive_configuration, describe
from ..types import Array, Floats, positive
from .state import Equilibrium

__all__ = ["animation", "checked_index"]


def animation(
    at: Equilibrium, s: complex, x: Array, amplitude: float, frames: int, periods: int, number: int
) -> History:
    """See :meth:`Modes.animation`; x (unknowns,) is the shape, s its eigenvalue."""
    size = positive("argument amplitude", "amplitude", amplitude)
    for name, value in (("frames", frames), ("periods", periods)):
        whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
        if not whole or value < 1:
            raise InputError(f"argument {name}", f"{value!r}, expected a positive integer")
    system, P = at.system, at.tangent.P
    x = size / _extent(system, at.y, P @ x) * x
    omega = abs(s.imag) if abs(s.imag) > 1e-9 * abs(s) else 2 * np.pi
    phases = 2 * np.pi / frames * np.arange(frames * periods + 1)
    waves = np.exp(1j * phases)[:, None] * x
    q = np.array([_moved(at, wave) for wave in waves.real])
    v = (P @ (1j * omega * waves).real.T).T
    p = np.array([(system.mass @ row.reshape(-1, 3)).reshape(-1) for row in v])
    meta, static = describe(system)
    meta |= {
        "status": "completed",
        "integrator": "mode",
        "mode": number,
        "eigenvalue": [s.real, s.imag],
        "amplitude": size,
    }
    count = len(phases)
    series = {
        "t": phases / omega,
        "step": np.arange(count),
        "q": q,
        "p": p,
        "v": v,
        "constraint_force": np.full((count, system.n), np.nan),
    }
    history = History(meta, static, series)
    derive_configuration(system, history, np.full(count, at.t))
    return history


def checked_index(index: int, count: int) -> int:
    """Number of one of `count` modes, from 0 on; negative numbers count from the end.

    Raises
    ------
    InputError
        If there is no such mode.
    """
    whole = isinstance(index, int | np.integer) and not isinstance(index, bool)
    if not whole or not -count <= index < count:
        raise InputError(
            "argument index", f"{index!r}, expected an integer: there are {count} modes"
        )
    return int(index) % count


def _extent(system: System, y: Floats, dq: Array) -> float:
    """Largest displacement over the extent, or rotation over a full turn, in a period."""
    change = dq.reshape(-1, 3)
    largest = 0.0
    for phase in np.exp(1j * np.linspace(0, np.pi, 13)):
        moved = (phase * change).real
        shift = np.linalg.norm(moved[system.origin_rows], axis=1).max() / system.length
        rows = system.kinematics.director_rows
        turn = 0.5 * np.cross(y[rows], moved[rows]).sum(1)
        angle = np.linalg.norm(turn, axis=1).max(initial=0.0) / (2 * np.pi)
        largest = max(largest, float(shift), float(angle))
    return largest


def _moved(at: Equilibrium, increment: Floats) -> Floats:
    """Configuration (n,) after a finite motion, loops closed."""
    system, y = at.system, at.y
    chart = Chart(system.kinematics)
    chart.begin(y, y[system.rows :])
    chosen = system.closure.select(y, tree_values(system, y))
    chart.add(system.closure.null_matrix(chosen) @ increment)
    moved: Floats | None = chart.configuration()
    if chosen:
        moved, _ = closed(system, chart, chosen)
    if moved is None:
        raise InputError(
            "argument amplitude", "a closed loop cannot follow so far: take a smaller one"
        )
    return np.array(moved[: system.rows]).reshape(-1)
