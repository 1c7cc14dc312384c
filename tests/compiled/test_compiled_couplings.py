"""Compiled springs, dampers, cables and actuators against the plain ones; what they conserve."""

from __future__ import annotations

import numpy as np
import pytest
import test_compiled
import test_compiled_multipliers
from helpers_scenes import four_bar, pairs
from test_compiled_damping import assert_resized
from test_couplings import INTEGRATORS, TREATMENTS, apart, zoo

import skfem_cosserat as sc
from skfem_cosserat.integrators.choice import refusal

pytest.importorskip("numba")
integrators = pytest.mark.parametrize("integrator", INTEGRATORS)
COMPARED = {"null space": test_compiled, "multipliers": test_compiled_multipliers}
treatments = pytest.mark.parametrize("treatment", COMPARED)
WORK = ("work_actuators", "dissipated", "work_drives")


@pairs
def test_residual_and_increment_at_random_states(integrator, treatment):
    """Far from the solution: the tangent is that of the plain path."""
    compared = COMPARED[treatment].test_residual_and_increment_at_random_states
    compared(1, integrator, lambda order: zoo(scalar=True))


@pytest.mark.parametrize("shaken", [False, True])
@pairs
def test_runs(integrator, treatment, shaken):
    """Fifty steps with all elements on all kinds of places; what they do in them is the same."""
    compared = COMPARED[treatment]
    system = zoo(3, moving=shaken, scalar=True)
    run = compared.both(system, integrator, 2e-3, 0.1)
    # momenta to what stiff springs leave of them: with SuperLU plain ones differ by 6e-12
    compared.assert_same(*run, tolerance=2e-11)
    plain, compiled = run
    for name in WORK:
        size = max(1e-3, abs(plain[name]).max())
        assert abs(compiled[name] - plain[name]).max() < 1e-9 * size, name
    assert compiled["turns"].tolist() == plain["turns"].tolist()


@pairs
def test_steps_of_other_sizes(integrator, treatment):
    """Dampers know the size of the step."""
    assert_resized(zoo(scalar=True), integrator, treatment)


@pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")  # large steps
@pairs
def test_angles_over_several_turns(integrator, treatment):
    """A wheel on a wound spring: turns are counted, also from a state between two turns on."""
    model = sc.Model()
    wheel = model.add("wheel", sc.RigidBody.cylinder(1.0, radius=0.5, length=0.1))
    hinge = sc.JointRevolute(sc.ground((0, 0, 0)), wheel.at((0, 0, 0)), axis=(0, 0, 1))
    model.add("hinge", hinge)
    model.add("spring", sc.JointSpringDamper(hinge, 2.0, 0.01, neutral=12.0))
    system = model.freeze()
    options = {"derive": False, "settings": sc.NewtonSettings(reuse=0)}
    run = system, INTEGRATORS[integrator], TREATMENTS[treatment], 0.02
    plain, compiled = (sc.simulate(*run, 2.0, kernels=k, **options) for k in ("numpy", "numba"))
    assert compiled["turns"].max() == 4 and compiled["turns"].tolist() == plain["turns"].tolist()
    assert abs(compiled["q"] - plain["q"]).max() < 1e-10
    half = sc.simulate(*run, 1.0, kernels="numpy", **options)
    start = sc.restart(system, half, INTEGRATORS[integrator], 0.02)
    on = sc.simulate(*run, 2.0, start=start, kernels="numba", **options)
    assert start.turns[0] > 0 and abs(on["q"] - plain["q"][50:]).max() < 1e-10


@pytest.mark.parametrize("reuse", [0, 4])
@integrators
def test_closed_loops(integrator, reuse):
    """Fifty steps of a four-bar linkage with a spring across it and a motor on a hinge."""
    model = four_bar()
    hinge = next(j for j in map(model.__getitem__, model) if isinstance(j, sc.JointRevolute))
    model.add("motor", sc.JointActuator(hinge, lambda t: 2.0 * np.sin(8 * t)))
    coupler = model["coupler"].at((1, 1.25, 0))
    model.add("across", sc.SpringDamper(sc.ground((0.3, 0.2, 0)), coupler, 30.0, 0.4, 0.8))
    system = model.freeze()
    plain, compiled = (
        sc.simulate(
            system, INTEGRATORS[integrator], sc.NullSpace(), 0.01, 0.5, derive=False,
            kernels=kernels, settings=sc.NewtonSettings(reuse=reuse),
        )
        for kernels in ("numpy", "numba")
    )  # fmt: skip
    assert compiled.meta["kernels"] == "numba" and compiled["attempts"].max() == 1
    assert abs(plain["q"][-1] - plain["q"][0]).max() > 0.1
    for name, tolerance in (("q", 1e-10), ("p", 1e-9), ("constraint_force", 1e-7)):
        size = abs(plain[name]).max()
        assert abs(compiled[name] - plain[name]).max() < tolerance * size, name


@treatments
def test_energy_and_momenta(treatment):
    """Energy-momentum: with dampers and motors the balance closes, also with kept factors."""
    system = zoo(5, grounded=False, scalar=True)
    runs = [
        sc.simulate(
            system, sc.EnergyMomentum(), TREATMENTS[treatment], 1e-3, 0.3, kernels="numba",
            start=test_compiled.moving(system),
            settings=sc.NewtonSettings(reuse=reuse, increment=1e-24),  # down to rounding
        )
        for reuse in (0, 4)
    ]  # fmt: skip
    for run in runs:
        assert abs(run["energy_balance"]).max() < 1e-9 * abs(run["energy"]).max()
        for name in ("linear_momentum", "angular_momentum"):
            assert abs(run[name] - run[name][0]).max() < 1e-10 * abs(run[name]).max()
        assert run["dissipated"].min() >= 0 and run["dissipated"].max() > 1e-6
    whole, kept = runs
    assert abs(kept["q"][-1] - whole["q"][-1]).max() < 1e-9
    assert kept.meta["factorisations"] < 0.5 * whole.meta["factorisations"]


def test_what_is_refused():
    for method in INTEGRATORS.values():
        for treatment in TREATMENTS.values():
            why = refusal(zoo(), method, treatment)
            assert why == "there are no compiled kernels for springs on rotation vectors, bushings"
            assert refusal(zoo(scalar=True), method, treatment) is None


@pytest.mark.parametrize("treatment", TREATMENTS)
def test_motion_does_not_depend_on_how_a_scene_lies(treatment):
    assert apart(sc.Variational(), TREATMENTS[treatment], "numba", vectors=False) < 1e-11
