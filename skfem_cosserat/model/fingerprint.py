"""Fingerprint of a system, by which a history is told to belong to it."""

from __future__ import annotations

from typing import Any

import numpy as np

from .plane import PROBE
from .system import System


def fingerprint(system: System) -> dict[str, Any]:
    """What makes a history belong to a system: names, and sums that any change of numbers moves."""
    y = system.extend(system.q0, 0.0)
    stiffness = [g.elements.stiffness.ravel() for g in system.beam_groups]
    numbers = {
        "reference": system.q0,
        "mass": system.mass.tocoo().data,
        "stiffness": np.concatenate([*stiffness, np.zeros(0)]),
        "gauss": np.concatenate([*(g.elements.points for g in system.beam_groups), np.zeros(0)]),
        "constraints": system.constraints.jacobian_values(y),
    }
    stored = [
        law.energy(PROBE * law.scale) for g in system.beam_groups for _, law in g.elements.stored
    ]
    if stored:
        numbers["stored energy"] = np.concatenate(stored)
    # weights without a pattern, so that nothing cancels or trades places
    sums = {k: float(v @ np.cos(1 + np.arange(len(v)) ** 1.5)) for k, v in numbers.items()}
    return {
        "items": [s.label for s in system.structures],
        "joints": [j.label for j in system.joints],
        "counts": [system.n, system.m],
        "numbers": sums,
    }


def other_model(system: System, found: dict[str, Any]) -> str | None:
    """How a fingerprint differs from that of the system, or None."""
    own = fingerprint(system)
    for name in ("items", "joints", "counts"):
        if found.get(name) != own[name]:
            return f"{name} {found.get(name)}, expected {own[name]}"
    for name, value in own["numbers"].items():
        other = found.get("numbers", {}).get(name, np.nan)
        if not np.isclose(other, value, rtol=1e-9, atol=1e-12):
            return f"{name} differs (weighted sum {other!r}, expected {value!r})"
    return None
