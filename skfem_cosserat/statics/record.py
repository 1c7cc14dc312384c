"""A path as a history: points with their load factor, stability and constraint forces."""

from __future__ import annotations

import os
from typing import Any

import numpy as np

from ..diagnostics import coupling_energy, strain_energy
from ..errors import InputError
from ..history import History, HistoryWriter
from ..model import System
from ..model.balance import Amplitudes, Spin
from ..simulate.describe import derive_configuration, describe
from ..simulate.recorder import take_along
from ..types import Floats
from .point import Point
from .schedule import Schedule

__all__ = ["CODES", "PathRecorder", "derive_path", "recorded_amplitudes"]

#: number of a point in the series "critical"
CODES = {"regular": 0, "limit": 1, "bifurcation": 2}


class PathRecorder:
    """Writes the points of a path."""

    def __init__(
        self,
        system: System,
        schedule: Schedule,
        meta: dict[str, Any],
        path: str | os.PathLike[str] | None,
    ) -> None:
        if path is not None and not isinstance(path, str | os.PathLike):
            raise InputError("argument path", f"{path!r}, expected the name of a file")
        self.system, self.schedule = system, schedule
        described, static = describe(system)
        described |= {"integrator": "static", "step": 0.0, **meta}
        self.writer = HistoryWriter(described, static, path)
        self.count = 0
        self._closed = False
        self._work = 0.0
        self._before: tuple[Floats, Floats] | None = None

    def __enter__(self) -> PathRecorder:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: object
    ) -> None:
        """An error of the user's own code takes the path so far along as ``error.history``."""
        if error is not None and self.count and not self._closed:
            take_along(error, self.close("failed"))

    def take(
        self,
        point: Point,
        parameter: float,
        force: Floats,
        iterations: int,
        attempts: int,
        residual: float,
        unstable: int = -1,
        kind: str = "regular",
    ) -> None:
        """Record a point."""
        system = self.system
        q = point.y[: system.rows].reshape(-1)
        self._add_work(point, q)
        zero = np.zeros(system.n)
        row: dict[str, Any] = {
            "t": float(parameter),
            "step": self.count,
            "q": q,
            "p": zero,
            "carried": zero,
            "fresh": 1.0,
            "constraint_force": np.asarray(force, dtype=float),
            "load_factor": float(point.t),
            "unstable": unstable,
            "critical": CODES[kind],
            "newton_iterations": iterations,
            "attempts": attempts,
            "residual": residual,
            "work_loads": self._work,
            **_amplitude_series(self.schedule.at(point.t)),
        }
        if system.couplings.angles:
            none = np.zeros(len(system.couplings.angles), dtype=np.int64)
            row["turns"] = none if point.turns is None else point.turns
        self.writer.append(row)
        self.count += 1

    def _add_work(self, point: Point, q: Floats) -> None:
        """Work of the loads along the path, by the trapezoidal rule between its points."""
        system, loading = self.system, self.system.loading
        amplitudes = self.schedule.at(point.t).loads
        force = loading.dead_force(amplitudes)
        if not loading.dead_only:
            force = force + loading.force(point.y[: system.rows], amplitudes)
        now = force.reshape(-1)
        if self._before is not None:
            q0, f0 = self._before
            self._work += float((f0 + now) @ (q - q0)) / 2
        self._before = q, now

    def close(self, status: str, **extra: Any) -> History:
        """Close the file and give the history."""
        self._closed = True
        self.writer.close(status, **extra)
        return self.writer.history()


def _amplitude_series(amplitudes: Amplitudes) -> dict[str, Floats]:
    spin = amplitudes.spin
    turning = np.zeros((2, 3)) if spin is None else np.array([spin.velocity, spin.point])
    return {
        "amplitudes/loads": amplitudes.loads,
        "amplitudes/actuators": amplitudes.actuators,
        "amplitudes/spin": turning,
    }


def recorded_amplitudes(history: History, index: int = -1) -> Amplitudes:
    """Factors of loads and actuators, and the spin, at a point of a path."""
    loads, actuators, spin = (
        np.array(history[f"amplitudes/{name}"][index]) for name in ("loads", "actuators", "spin")
    )
    return Amplitudes(loads, actuators, Spin(*spin) if spin[0].any() else None)


def derive_path(system: System, schedule: Schedule, history: History) -> None:
    """Add energies, strains, section forces, reactions and joint coordinates of all points."""
    q, factor = history["q"], history["load_factor"]
    turns = history.series.get("turns")
    strain = strain_energy(system, q)
    coupling = coupling_energy(system, q, factor, turns)
    series = {
        "v": np.zeros_like(q),
        "strain_energy": strain,
        "coupling_energy": coupling,
        "energy": strain + coupling,
        "external": schedule.potential(q, factor),
    }
    for name, values in series.items():
        history.add_series(name, values)
    derive_configuration(system, history, factor)
