"""The stored scenes of states.py: every kind of item is in one, and a changed bit is noticed."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import states
from helpers_schemes import SCHEMES

import skfem_cosserat as sc

KINDS = (
    "Joint",
    "Load",
    "Section",
    "Interpolation",
    "Theory",
    "Sensor",
    "Motion",
    "Ramp",
    "Solver",
)
ITEMS = {"Beam", "Bushing", "Cable", "Foundation", "MassPoint", "RayleighDamping", "RigidBody"}
ITEMS |= {"Cylinder", "EnergyForm", "Force", "Obstacle", "Plane", "Sphere"}
ITEMS |= {"SpringDamper", "FunctionOfTime", "Harmonic", "Table", "Explicit"}
ITEMS |= {"ArcLength", "DisplacementControl"}
#: base classes, what every beam has, what needs more than the core, what only reads
LEFT_OUT = {
    "Joint",
    "Load",
    "SectionField",
    "Sensor",
    "Solver",
    "Theory",
    "TheoryReissner",
    "Motion",
    "SolverPardiso",
    "SensorQuantity",
}


def test_every_kind_of_item_is_in_a_scene() -> None:
    names = {name for name in sc.__all__ if name.startswith(KINDS)} | ITEMS
    used = set(re.findall(r"\bsc\.(\w+)", Path(states.__file__).read_text(encoding="utf-8")))
    assert names - LEFT_OUT - used == set()


def test_every_integrator_is_in_a_scene() -> None:
    every = {each for name in sc.__all__ if isinstance(each := getattr(sc, name), type)}
    schemes = {each for each in every if issubclass(each, sc.Integrator)} - {sc.Integrator}
    assert schemes == {sc.Explicit, *map(type, SCHEMES)}


def test_a_changed_bit_is_noticed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = str(tmp_path / "before.npz")
    words = ["rigid_only", "NullSpace", "numpy"]
    assert states.main(["store", file, *words]) == 0
    assert states.main(["compare", file, *words]) == 0
    with np.load(file) as stored:
        table = dict(stored)
    (name,) = (name for name in table if name.endswith("| q"))
    table[name][-1, -1] = np.nextafter(table[name][-1, -1], 9)
    np.savez(file, **table)
    capsys.readouterr()
    assert states.main(["compare", file, *words]) == 1
    assert name in capsys.readouterr().out


SETUP = states.MOMENTUM, states.NULL


def test_rounding_is_told_from_changes() -> None:
    run = dict(
        states.numbers(states.simulated(states.PARTS["on a hinge"], *SETUP, kernels="numpy"))
    )

    def apart(series: str, factor: float) -> float:
        ((_, found),) = states.compared({"": run}, {"": run | {series: factor * run[series]}})
        return found

    for rounding in ("residual", "hidden_violation", "constraint_violation"):
        assert apart(rounding, 3.0) < states.LIMIT
    for series in ("q", "v", "p", "energy", "joint/joint/angle", "joint/joint/force", "sensor e"):
        assert apart(series, 1 + 1e-8) > states.LIMIT
