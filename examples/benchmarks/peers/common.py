"""What adapters share: question and answer, frames, tables, loads, the clock of explicit codes."""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np


class Refused(Exception):
    """A scene that the code has no means for, and why."""


def answer(run: Callable[[dict[str, Any]], dict[str, Any]]) -> None:
    """Read the scene, run it, write the answer; stdout is kept for it: codes print there too."""
    out = os.dup(1)
    os.dup2(2, 1)
    try:
        found = run(json.load(sys.stdin))
    except Refused as error:
        found = {"status": f"refused: {error}"}
    except (ArithmeticError, RuntimeError, ValueError) as error:  # what solvers raise
        found = {"status": f"failed: {' '.join(str(error).split())[:200]}"}
    with os.fdopen(out, "w") as file:
        json.dump(found, file)


def key(place: list[Any] | None) -> Any:
    """Of a place, for a dictionary: ("beams", 0, 3), ("bodies", 1), None for the ground."""
    return None if place is None else tuple(place)


def axes(along: Any) -> np.ndarray:
    """Rows of a triad whose third one points along a vector."""
    third = np.array(along, dtype=float) / np.linalg.norm(along)
    first = np.cross(np.eye(3)[np.argmin(abs(third))], third)
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(third, first), third])


def frame(beam: dict[str, Any]) -> np.ndarray:
    """Rows d1, d2, d3 of a beam's sections; d3 points along it."""
    third = np.subtract(beam["nodes"][-1], beam["nodes"][0])
    d1, third = np.array(beam["director"], dtype=float), third / np.linalg.norm(third)
    return np.array([d1, np.cross(third, d1), third])


def rows(beam: dict[str, Any], name: str) -> np.ndarray:
    """Stiffness, mass or inertia of each element of a beam."""
    width = {"stiffness": 6, "mass": 1, "inertia": 3}[name]
    values = np.array(beam[name], dtype=float).reshape(-1, width)
    return np.broadcast_to(values, (len(beam["nodes"]) - 1, width))


def lengths(beam: dict[str, Any]) -> np.ndarray:
    """Of its elements (m)."""
    return np.linalg.norm(np.diff(beam["nodes"], axis=0), axis=1)


def factor(load: dict[str, Any]) -> Callable[[float], float]:
    """Of a load, as a function of time."""
    spans = list(pairwise(zip(load["times"], load["factors"], strict=True)))

    def at(t: float) -> float:
        for (t0, f0), (t1, f1) in spans:
            if t0 <= t <= t1:
                return float(f0 + (f1 - f0) * (t - t0) / (t1 - t0))
        return 0.0

    return at


def explicit(
    scene: dict[str, Any], step: Callable[[float], Any], position: Callable[[], np.ndarray]
) -> dict[str, Any]:
    """Take all steps one by one; `step` is told the time at which a step begins."""
    size, path, begun = scene["step"], [], 0.0
    every, count = round(scene["sample"] / size), round(scene["until"] / size)
    with np.errstate(all="ignore"):
        for k in range(count):
            if k == scene["warm"]:
                begun = time.process_time()
            step(k * size)
            if (k + 1) % every == 0:
                path.append([float(x) for x in position()])
                if not np.isfinite(path[-1]).all():
                    return {"status": f"unstable before {(k + 1) * size:.6g} s"}
    return solved(scene, time.process_time() - begun, path)


def solved(
    scene: dict[str, Any],
    seconds: float,
    positions: list[list[float]],
    counted: dict[str, float] | None = None,
    **more: Any,
) -> dict[str, Any]:
    """The answer of a whole run; costs and counts given are without the first `warm` steps."""
    steps = round(scene["until"] / scene["step"])
    part = {"seconds": seconds, **(counted or {})}
    whole = {name: value * steps / (steps - scene["warm"]) for name, value in part.items()}
    return {"status": "completed", "steps": steps, **whole, "positions": positions, **more}
