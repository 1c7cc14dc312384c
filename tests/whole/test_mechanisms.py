"""Mechanisms: closed loops, with and without a drive, in both treatments and both integrators.

Drives as such are in tests/items/test_drives.py.
"""

from __future__ import annotations

import numpy as np
import pytest
from helpers_scenes import four_bar

import skfem_cosserat as sc

INTEGRATORS = (sc.Variational, sc.EnergyMomentum)
TREATMENTS = (sc.NullSpace, sc.Multipliers)
Z = (0.0, 0.0, 1.0)


def slider_crank(motion) -> sc.Model:
    """Crank 0.3 m, rod 1 m, slider along x."""
    model = sc.Model()
    crank = model.add("crank", sc.RigidBody.box(1.0, (0.3, 0.05, 0.05), position=(0.15, 0, 0)))
    rod = model.add("rod", sc.RigidBody.box(1.0, (1.0, 0.05, 0.05), position=(0.8, 0, 0)))
    slider = model.add("slider", sc.RigidBody.box(2.0, (0.1, 0.1, 0.1), position=(1.3, 0, 0)))
    first = sc.JointRevolute(sc.ground((0, 0, 0)), crank.at((0, 0, 0)), axis=Z)
    model.add("shaft", first)
    model.add("crank pin", sc.JointRevolute(crank.at((0.3, 0, 0)), rod.at((0.3, 0, 0)), axis=Z))
    model.add("wrist", sc.JointRevolute(rod.at((1.3, 0, 0)), slider.at((1.3, 0, 0)), axis=Z))
    rail = sc.JointPrismatic(sc.ground((1.3, 0, 0)), slider.at((1.3, 0, 0)), axis=(1.0, 0, 0))
    model.add("rail", rail)
    model.add("motor", sc.JointDrive(first, motion))
    return model


@pytest.mark.slow
@pytest.mark.plain
@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_a_drive_between_free_bodies_keeps_their_momenta(integrator):
    model = sc.Model()
    a = model.add("a", sc.RigidBody.box(2.0, (1, 0.3, 0.2), angular_velocity=(0.3, 0.2, 0)))
    b = model.add("b", sc.RigidBody.box(1.0, (0.2, 0.4, 0.3), position=(1.0, 0, 0)))
    track = sc.JointPrismatic(a.at((0.5, 0, 0)), b.at((1.0, 0, 0)), axis=(1.0, 0, 0))
    model.add("track", track)
    model.add("motor", sc.JointDrive(track, lambda t: 0.2 * t**2 * np.cos(3 * t)))
    system = model.freeze()
    assert system.counts()["unknowns"] == 6
    v = sc.project(system, system.q0, system.v0)
    start = sc.initial_state(system, v=v)
    history = sc.simulate(system, integrator(), sc.NullSpace(), 1e-2, 2.0, start=start)
    moment = history["angular_momentum"]
    assert abs(moment - moment[0]).max() < 1e-12
    assert abs(np.diff(history["linear_momentum"], axis=0)).max() < 1e-12
    assert abs(history["joint/track/displacement"][-1] - 0.8 * np.cos(6.0)) < 1e-12


@pytest.mark.slow
def test_energy_balance_of_a_drive():
    """Exact with energy-momentum, second order with the variational scheme.

    A loop without a freedom left: x = r cos a + sqrt(l^2 - r^2 sin^2 a), and no unknowns.
    """
    system = slider_crank(lambda t: 5 * t**2 / (1 + t)).freeze()
    assert system.unknowns == 0
    exact = sc.simulate(system, sc.EnergyMomentum(), sc.Multipliers(), 1e-2, 1.4)
    assert abs(exact["energy_balance"]).max() < 1e-9 * exact["energy"].max()
    a = 5 * exact.times**2 / (1 + exact.times)
    x = 0.3 * np.cos(a) + np.sqrt(1 - (0.3 * np.sin(a)) ** 2)
    assert abs(exact["joint/rail/displacement"] - (x - 1.3)).max() < 1e-11
    assert exact["joint/shaft/angle"][-1] > np.pi  # past both dead centres of the slider
    misses = []
    for step in (1e-2, 5e-3):
        history = sc.simulate(system, sc.Variational(), sc.NullSpace(), step, 1.4)
        misses.append(abs(history["energy_balance"][1:-1]).max())
    assert np.log2(misses[0] / misses[1]) == pytest.approx(2, abs=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_four_bar_in_both_treatments(integrator):
    """Three of the 20 rows of its hinges are redundant; energy, closure and reactions agree."""
    model = four_bar()
    model.add("gravity", sc.LoadGravity((0, -9.81, 0)))
    system = model.freeze()
    assert system.counts() == {"n": 36, "m": 38, "rank": 35, "unknowns": 1}
    assert len(system.redundant) == 3
    runs = [sc.simulate(system, integrator(), kind(), 1e-2, 1.0) for kind in TREATMENTS]
    assert abs(runs[0]["q"] - runs[1]["q"]).max() < 1e-9
    assert runs[0]["constraint_violation"].max() < 1e-13
    assert runs[1]["constraint_violation"].max() < 1e-11
    size = abs(runs[0]["joint/pin 2/force"][1:]).max()
    for name in ("force", "moment"):  # all rows count: least norm where some are redundant
        one, two = (run[f"joint/pin 2/{name}"][1:] for run in runs)
        assert abs(one - two).max() < 1e-8 * size
    if integrator is sc.EnergyMomentum:
        total = runs[0]["energy"] + runs[0]["external"]
        assert abs(total - total[0]).max() < 1e-10 * abs(runs[0]["external"]).max()


# whether a step is seen to pass it is up to rounding
@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")
def test_a_flat_parallelogram_is_passed():
    """Three equal bars: at 90 degrees all lie on a line, where another branch begins."""
    model = sc.Model()
    points = np.array([[0.0, 0, 0], [0, 1, 0], [1, 1, 0], [1, 0, 0]])
    bars = [
        model.add(name, sc.RigidBody.box(1.0, (0.1, 0.1, 0.1), position=(a + b) / 2))
        for name, a, b in zip(("crank", "coupler", "rocker"), points, points[1:], strict=False)
    ]
    sides = [sc.ground(points[0])]
    for bar, a, b in zip(bars, points, points[1:], strict=False):
        sides += [bar.at(a), bar.at(b)]
    sides.append(sc.ground(points[3]))
    for k in range(4):
        model.add(f"pin {k}", sc.JointRevolute(sides[2 * k], sides[2 * k + 1], axis=Z))
    system = model.freeze()
    start = sc.initial_state(system, rates={"pin 0": 3.0})
    for treatment in TREATMENTS:
        history = sc.simulate(system, sc.EnergyMomentum(), treatment(), 1e-2, 1.0, start=start)
        crank, rocker = history["joint/pin 0/angle"], -history["joint/pin 3/angle"]
        assert crank[-1] == pytest.approx(3.0, abs=1e-3)  # uniform: the coupler does not turn
        assert abs(crank - rocker).max() < 1e-6
