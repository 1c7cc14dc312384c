"""Compiled loads that follow the motion against the plain ones, and what they do to momenta."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path

import numpy as np
import pytest
import test_compiled
import test_compiled_multipliers
from helpers_scenes import four_bar, full_section, pairs
from test_compiled import INTEGRATORS, moving, tree

import skfem_cosserat as sc
from skfem_cosserat.compiled import plan

pytest.importorskip("numba")
sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "examples"))
spaghetti = importlib.import_module("dynamic_references").spaghetti
integrators = pytest.mark.parametrize("integrator", INTEGRATORS)
COMPARED = {"null space": test_compiled, "multipliers": test_compiled_multipliers}
TREATMENTS = {"null space": sc.NullSpace(), "multipliers": sc.Multipliers()}
treatments = pytest.mark.parametrize("treatment", COMPARED)


def dead_moments(model):
    """On a beam's end with a joint, on a body and inside a beam, one of them in time."""
    end = model["rod"].node("arc.end")
    model.add("m1", sc.LoadMoment(end, (0.9, -0.5, 1.4), sc.Table([0, 0.02, 1], [1, -2, 3])))
    model.add("m2", sc.LoadMoment(model["body"].at((1.6, 1.5, 0)), (0.7, 1.1, -0.4)))
    model.add("m3", sc.LoadMoment(model["rod"].node(1), (-0.3, 0.8, 1.0)))


def body_moments(model):
    """With components in the triad."""
    end = model["rod"].node("arc.end")
    model.add("m4", sc.LoadMoment(end, (0.5, 1.2, -0.7), follower=True))
    body = model["body"].at((1.6, 1.5, 0))
    model.add("m5", sc.LoadMoment(body, lambda t: (np.sin(30 * t), 1.0, 2.0), follower=True))


def body_forces(model):
    """At an offset, and at a beam's node."""
    body = model["body"].at((1.2, 1.9, 0.3))
    model.add("f1", sc.LoadForce(body, (2.0, -1.0, 1.5), lambda t: np.cos(9 * t), follower=True))
    model.add("f2", sc.LoadForce(model["rod"].node("arc.end"), (1.0, 3.0, -2.0), follower=True))


def section_forces(model):
    """A wind that turns with the sections."""
    table = sc.Table([0, 0.03, 1], [1, 4, 0])
    model.add("f3", sc.LoadLine(model["rod"], (0.5, 2.0, -1.0), table, follower=True))


def everything(model):
    for add in (dead_moments, body_moments, body_forces, section_forces):
        add(model)


LOADS = {
    each.__name__: each
    for each in (dead_moments, body_moments, body_forces, section_forces, everything)
}
loads = pytest.mark.parametrize("name", LOADS)


def loaded(name, order=2):
    return tree(order, LOADS[name])


@pytest.mark.parametrize("order", [1, pytest.param(3, marks=pytest.mark.slow)])
@pairs
def test_residual_and_increment_at_random_states(integrator, treatment, order):
    """Far from the solution: the tangent is that of the plain path."""
    compared = COMPARED[treatment].test_residual_and_increment_at_random_states
    compared(order, integrator, lambda order: loaded("everything", order))


@loads
@pairs
def test_runs(integrator, treatment, name):
    """Fifty steps; reactions and work among what is compared."""
    compared = COMPARED[treatment]
    compared.assert_same(*compared.both(loaded(name), integrator, 1e-3, 0.05))


@pytest.mark.parametrize("reuse", [0, 4])
@integrators
def test_closed_loops(integrator, reuse):
    """Fifty steps of a four-bar linkage that is driven by a moment and forces on its coupler."""
    model = four_bar()
    coupler = model["coupler"].at((1, 1.25, 0))
    model.add("moment", sc.LoadMoment(coupler, (0, 0, 3.0), sc.Table([0, 0.2, 0.5], [0, 1, -1])))
    model.add("own", sc.LoadMoment(coupler, (0, 0.5, -1.0), follower=True))
    model.add("push", sc.LoadForce(coupler, (2.0, 1.0, 0), follower=True))
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
    for name, tolerance in (("q", 1e-11), ("p", 1e-10), ("constraint_force", 1e-7)):
        size = abs(plain[name]).max()
        assert abs(compiled[name] - plain[name]).max() < tolerance * size, name


@pytest.mark.parametrize("thin", [-1, 1])
@integrators
def test_what_is_left_to_a_sparse_solver(integrator, thin, monkeypatch):
    monkeypatch.setattr(plan, "FILLED", 0)
    monkeypatch.setattr(plan, "THIN", thin)
    test_compiled.assert_same(*test_compiled.both(loaded("everything"), integrator, 1e-3, 0.02))


@pairs
def test_kept_factors(integrator, treatment):
    """The same motion with a fraction of the factorisations."""
    system = loaded("everything", 1)
    runs = [
        sc.simulate(
            system, INTEGRATORS[integrator], TREATMENTS[treatment], 5e-4, 0.1, derive=False,
            kernels="numba", settings=sc.NewtonSettings(reuse=reuse), start=moving(system),
        )
        for reuse in (0, 4)
    ]  # fmt: skip
    whole, kept = runs
    assert abs(kept["q"][-1] - whole["q"][-1]).max() < 1e-10
    assert kept.meta["factorisations"] < 0.4 * whole.meta["factorisations"]


# -- what loads do ---------------------------------------------------------------------------------


@pairs
def test_momenta_grow_by_what_moments_and_forces_give(integrator, treatment):
    """Of a free rod: exactly by the time integrals, however coarse the steps."""
    model = sc.Model()
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 4, name="rod")
    rod = model.add("rod", sc.Beam(mesh, full_section(), order=2, director=(0, 0, 1)))
    pulse = sc.Table([0, 0.05, 0.13], [0, 1, 0])
    moments = np.array([[0.4, -0.2, 0.9], [-0.1, 0.5, 0.3]])
    model.add("m1", sc.LoadMoment(rod.node("rod.end"), moments[0], pulse))
    model.add("m2", sc.LoadMoment(rod.node(1), moments[1]))
    system = model.freeze()
    run = sc.simulate(
        system, INTEGRATORS[integrator], TREATMENTS[treatment], 5e-3, 0.25, kernels="numba"
    )
    assert run.meta["kernels"] == "numba"
    t = run["t"]
    ramp = np.where(t < 0.05, t**2 / 0.1, 0.065 - np.maximum(0.13 - t, 0) ** 2 / 0.16)
    expected = ramp[:, None] * moments[0] + t[:, None] * moments[1]
    assert run["angular_momentum"] == pytest.approx(expected, abs=1e-12)
    assert abs(run["linear_momentum"]).max() < 1e-12


@pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")  # coarse: its elements fold
@pytest.mark.parametrize("order", [1, pytest.param(3, marks=pytest.mark.slow)])
@pairs
def test_flying_spaghetti(integrator, treatment, order):
    """A force and moments on an end of a free rod: fifty steps as with the plain kernels."""
    system = spaghetti(4, order).system
    plain, compiled = (
        sc.simulate(
            system, INTEGRATORS[integrator], TREATMENTS[treatment], 0.05, 2.5, kernels=kernels,
            settings=sc.NewtonSettings(reuse=0),
        )
        for kernels in ("numpy", "numba")
    )  # fmt: skip
    assert compiled.meta["kernels"] == "numba"
    assert compiled["newton_iterations"].tolist() == plain["newton_iterations"].tolist()
    for name, tolerance in (("q", 1e-10), ("p", 1e-10), ("work_loads", 1e-10)):
        size = abs(plain[name]).max()
        assert abs(compiled[name] - plain[name]).max() < tolerance * size, name
    if integrator == "energy-momentum":
        assert abs(compiled["energy_balance"]).max() < 1e-10 * abs(compiled["energy"]).max()
