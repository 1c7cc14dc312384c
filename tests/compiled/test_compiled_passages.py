"""Singular positions of closed loops, run through fast: compiled kernels against the plain ones.

Compiled steps choose the rows that close a loop only after some motion: whatever a step jumps over
must be met, told and survived as it is by plain kernels, which choose them in every step.
"""

from __future__ import annotations

import numpy as np
import pytest

import skfem_cosserat as sc

pytest.importorskip("numba")

from test_closed_loops import CHANGE_POINT, PARALLELOGRAM, linkage, spinning

INTEGRATORS = {"variational": sc.Variational(), "energy-momentum": sc.EnergyMomentum()}
Z = (0, 0, 1.0)
SPEED = 30.0


def slider_crank(theta, rod=1.0):
    """Crank of 1 m, rod, slider on a rail through the pin of the crank."""
    model = sc.Model()
    A, B = np.zeros(3), np.array([np.cos(theta), np.sin(theta), 0])
    C = np.array([B[0] + np.sqrt(rod**2 - B[1] ** 2), 0, 0])
    bars = []
    for name, a, b, mass in (("crank", A, B, 1.0), ("rod", B, C, 2.0)):
        shape = (0.1, 0.1, float(np.linalg.norm(b - a)))
        bar = sc.RigidBody.box(mass, shape, position=(a + b) / 2, triad=sc.triad(b - a, Z))
        bars.append(model.add(name, bar))
    slider = model.add("slider", sc.RigidBody.box(0.5, (0.1, 0.1, 0.1), position=C))
    model.add("pin 0", sc.JointRevolute(sc.ground(A), bars[0].at(A), Z))
    model.add("pin 1", sc.JointRevolute(bars[0].at(B), bars[1].at(B), Z))
    model.add("pin 2", sc.JointRevolute(bars[1].at(C), slider.at(C), Z))
    model.add("rail", sc.JointPrismatic(sc.ground(C), slider.at(C), (1.0, 0, 0)))
    return model


def scene(name):
    """A system and its start, at a fast turn of the crank."""
    if name == "slider-crank":
        system = slider_crank(1.0).freeze()
        return system, sc.initial_state(system, rates={"pin 0": SPEED})
    lengths, theta = {
        "parallelogram": (PARALLELOGRAM, 1.0),
        "change point": (CHANGE_POINT, np.pi - 0.3),
    }[name]
    system = linkage(lengths, theta).freeze()
    return system, spinning(system, SPEED if name == "change point" else -SPEED)


def outcome(system, start, integrator, turn, rounds, kernels):
    """History, why it ended, and what was warned of."""
    step = turn / SPEED
    until = round(rounds / turn) * step
    arguments = integrator, sc.NullSpace(), step, until
    try:
        history, end = sc.simulate(system, *arguments, start=start, kernels=kernels), None
    except sc.Diverged as error:
        history, end = error.history, (error.time, error.step)
    assert history.meta["kernels"] == kernels
    return history, end, [(each["when"], each["text"]) for each in history.meta["warnings"]]


def slow(*values):
    return pytest.param(*values, marks=pytest.mark.slow)


@pytest.mark.filterwarnings(
    "ignore::skfem_cosserat.AccuracyWarning"
)  # large steps over singular positions
@pytest.mark.parametrize(
    ("name", "integrator", "turn", "ends"),
    [
        *(("parallelogram", "energy-momentum", turn, True) for turn in (0.2, 0.5, 0.9, 1.3)),
        ("change point", "energy-momentum", 0.2, True),
        ("slider-crank", "energy-momentum", 0.2, True),
        *(slow("parallelogram", "variational", turn, True) for turn in (0.03, 0.2, 0.5, 0.9)),
        slow("parallelogram", "variational", 1.3, False),
        *(slow("change point", "variational", turn, turn < 0.4) for turn in (0.03, 0.2, 0.5, 0.9)),
    ],
)
def test_large_steps_over_singular_positions(name, integrator, turn, ends):
    """Steps of `turn` rad of the crank: the same motion, the same warnings, the same failure."""
    system, start = scene(name)
    arguments = system, start, INTEGRATORS[integrator], turn, 6.5
    plain, compiled = (outcome(*arguments, kernels) for kernels in ("numpy", "numba"))
    assert len(compiled[0]) == len(plain[0])
    assert abs(compiled[0]["q"] - plain[0]["q"]).max() < 1e-10
    assert compiled[1] == plain[1]
    assert compiled[2] == plain[2]
    assert (plain[1] is None) is ends
    if ends:
        assert any("singular position" in text for _, text in plain[2])
        assert compiled[0]["constraint_violation"].max() < 1e-11
