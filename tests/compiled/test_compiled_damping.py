"""Compiled beams of viscous sections against the plain ones, and the energy that they lose."""

from __future__ import annotations

import pytest
import test_compiled
import test_compiled_multipliers
from helpers_scenes import pairs
from test_compiled import INTEGRATORS, crossing, moving, tree

import skfem_cosserat as sc

pytest.importorskip("numba")
integrators = pytest.mark.parametrize("integrator", INTEGRATORS)
COMPARED = {"null space": test_compiled, "multipliers": test_compiled_multipliers}
TREATMENTS = {"null space": sc.NullSpace(), "multipliers": sc.Multipliers()}
treatments = pytest.mark.parametrize("treatment", COMPARED)
scenes = pytest.mark.parametrize("make", [tree, crossing])


def viscous(model):
    model.add("damping", sc.RayleighDamping(stiffness=3e-3))


def dragged(model):
    """Beam and lumps, a body and a point; a force that follows beside them."""
    model.add("damping", sc.RayleighDamping(mass=0.8, stiffness=1e-3))
    rod = model["rod"]
    model.add("thrust", sc.LoadForce(rod.node("arc.end"), (1.0, 2.0, 0.5), follower=True))


@scenes
@pairs
def test_residual_and_increment_at_random_states(integrator, treatment, make):
    """Far from the solution: the tangent is that of the plain path."""
    compared = COMPARED[treatment].test_residual_and_increment_at_random_states
    compared(2, integrator, lambda order: make(order, viscous))


@pairs
def test_drag_at_random_states(integrator, treatment):
    compared = COMPARED[treatment].test_residual_and_increment_at_random_states
    compared(2, integrator, lambda order: tree(order, dragged))


@pytest.mark.parametrize("order", [1, pytest.param(2, marks=pytest.mark.slow)])
@pairs
def test_runs_with_drag(integrator, treatment, order):
    """Fifty steps; work of the loads and of the drag apart."""
    compared = COMPARED[treatment]
    plain, compiled = compared.both(tree(order, dragged), integrator, 1e-3, 0.05)
    compared.assert_same(plain, compiled)
    lost = plain["dissipated"]
    assert lost.max() > 1e-3 and abs(compiled["dissipated"] - lost).max() < 1e-9 * lost.max()


@pytest.mark.parametrize("order", [1, pytest.param(3, marks=pytest.mark.slow)])
@scenes
@pairs
def test_runs(integrator, treatment, make, order):
    """Fifty steps; what is dissipated among what is compared."""
    compared = COMPARED[treatment]
    plain, compiled = compared.both(make(order, viscous), integrator, 1e-3, 0.05)
    compared.assert_same(plain, compiled)
    lost = plain["dissipated"]
    assert lost.max() > 1e-3 and abs(compiled["dissipated"] - lost).max() < 1e-9 * lost.max()


@pytest.mark.parametrize("add", [viscous, dragged])
@pairs
def test_steps_of_other_sizes(integrator, treatment, add):
    """What resists knows the size of the step: rates are differences over it."""
    assert_resized(tree(1, add), integrator, treatment)


def assert_resized(system, integrator, treatment):
    """Steps of two sizes in turns, compiled and plain."""
    exact = sc.NewtonSettings(reuse=0)
    found = []
    for kernels in ("numpy", "numba"):
        own = system, INTEGRATORS[integrator], TREATMENTS[treatment], 1e-3, exact
        stepper = sc.Stepper(*own, kernels=kernels)
        stepper.resize(1e-3)  # others follow
        state, work = moving(system), []
        for k in range(12):
            stepper.resize((1 + k % 3) * 1e-3)
            report = stepper.advance(state)
            state = report.state
            work.append(report.work.dissipated)
        found.append((state, work))
    (a, lost), (b, other) = found
    assert abs(a.q - b.q).max() < 1e-11 * abs(a.q).max()
    assert abs(a.p - b.p).max() < 1e-10 * abs(a.p).max()
    assert max(lost) > 0 and other == pytest.approx(lost, abs=1e-9 * max(lost))


@pairs
def test_kept_factors(integrator, treatment):
    """The same motion with a fraction of the factorisations; energy-momentum closes the balance."""
    system = tree(1, viscous)
    runs = [
        sc.simulate(
            system, INTEGRATORS[integrator], TREATMENTS[treatment], 5e-4, 0.1,
            kernels="numba", settings=sc.NewtonSettings(reuse=reuse), start=moving(system),
        )
        for reuse in (0, 4)
    ]  # fmt: skip
    whole, kept = runs
    assert abs(kept["q"][-1] - whole["q"][-1]).max() < 1e-10
    assert kept.meta["factorisations"] < 0.4 * whole.meta["factorisations"]
    if integrator == "energy-momentum":
        for run in runs:
            assert abs(run["energy_balance"]).max() < 1e-10 * abs(run["energy"]).max()
