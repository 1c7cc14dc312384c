"""Compiled steps with multipliers against the plain ones: states, increments, whole runs."""

from __future__ import annotations

import numpy as np
import pytest
import test_drives
import test_joints
from helpers_scenes import JOINTS, random_tree, swing
from rounding import limits, nudged
from test_compiled import (
    COMPARED,
    FIRST,
    INTEGRATORS,
    assert_same_motion,
    called,
    chain,
    crossing,
    moving,
    tree,
)

import skfem_cosserat as sc
from skfem_cosserat.compiled.numbers import ROTATION
from skfem_cosserat.integrators.choice import refusal
from skfem_cosserat.integrators.compiled_step import CompiledMultipliers
from skfem_cosserat.integrators.stepper import Stepper

pytest.importorskip("numba")
integrators = pytest.mark.parametrize("integrator", INTEGRATORS)
MULTIPLIERS = sc.Multipliers()


def both(system, integrator, h, until, treatment=MULTIPLIERS, start=None):
    """Plain and compiled, with the same iterates; compiled knows what is rounding."""
    start = moving(system) if start is None else start
    options = {"derive": False, "settings": sc.NewtonSettings(reuse=0)}
    plain, compiled, beside = (
        sc.simulate(
            system, INTEGRATORS[integrator], treatment, h, until,
            start=begin, kernels=kernels, **options,
        )
        for begin, kernels in ((start, "numpy"), (start, "numba"), (nudged(start), "numba"))
    )  # fmt: skip
    compiled.meta["limits"] = limits(compiled, beside, COMPARED)
    return plain, compiled


def assert_same(plain, compiled, tolerance=1e-10):
    assert compiled.meta["solver"] == "blocks with multipliers"
    assert compiled["newton_iterations"].tolist() == plain["newton_iterations"].tolist()
    assert compiled["attempts"].tolist() == plain["attempts"].tolist()
    assert_same_motion(plain, compiled, tolerance)


# -- one state -------------------------------------------------------------------------------------


@pytest.mark.parametrize("make", [tree, crossing])
@pytest.mark.parametrize("order", FIRST)
@integrators
def test_residual_and_increment_at_random_states(order, integrator, make):
    """Of one iteration far from the solution, forces and the curvature of constraints at work."""
    system, h = make(order), 0.02
    method, settings = INTEGRATORS[integrator], sc.NewtonSettings()
    state = moving(system)
    stepper = Stepper(system, method, MULTIPLIERS, h, kernels="numpy")
    fast = CompiledMultipliers(system, method, h, settings)
    begin, evaluate, matrix, increment = map(
        called, (fast._step.start, fast._step.evaluate, fast._step.matrix, fast._step.increment)
    )
    rng = np.random.default_rng(order)
    size = abs(method.scheme(h).mass * system.mass).max() * 0.1
    for mixed in (False, True):
        guess = 0.1 * rng.standard_normal(system.n), size * rng.standard_normal(system.m)
        bound = stepper.bound
        bound.begin(system.extend(state.q, state.time), system.ground(state.time + h), h)
        bound.resume(guess)
        fast.resume(guess)
        bound.guess(True)
        problem = stepper.problem(method.begin(system, state, h))
        problem.residual()
        fast._begin(state)
        begin(*fast._all, 1)
        assert compare(fast, problem, evaluate, matrix, increment, 0) < 1e-9
        if mixed:  # the next one with predicted stresses
            problem.apply(problem.found)
            problem.residual()
            assert problem._stresses is not None and fast._a.found[1] == 1
            assert compare(fast, problem, evaluate, matrix, increment, 1) < 1e-9


def compare(fast, problem, evaluate, matrix, increment, mixed):
    """Difference of an increment; it is kept as ``problem.found``."""
    bound, n = problem.treatment, fast.system.n
    size = evaluate(*fast._all, 1)
    assert fast._a.y1 == pytest.approx(problem.y1, abs=1e-12)
    R = problem.evaluation.R
    assert fast.balance == pytest.approx(R, abs=1e-11 * abs(R).max())
    impulse = bound.constraint_impulse(R)
    assert fast.impulse == pytest.approx(impulse, abs=1e-11 * abs(impulse).max())
    assert size == pytest.approx(bound.relative(problem._r, problem.evaluation.size), rel=1e-9)
    problem.found = problem.direction()
    expected = problem.found.copy()
    expected[n:] *= bound._size
    assert matrix(*fast._all, mixed)
    numbers = fast._all[-1].copy()
    numbers[ROTATION] = np.inf  # as found: not scaled down for its rotations
    length = increment(*fast._all[:-1], numbers, 0)
    assert length == pytest.approx(bound.sizes(problem.found)[0], rel=1e-8)
    found = fast.increment
    return max(
        abs(found[part] - expected[part]).max() / abs(expected[part]).max()
        for part in (slice(n), slice(n, None))
    )


# -- runs ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("make", [tree, crossing])
@pytest.mark.parametrize("order", FIRST)
@integrators
def test_runs(order, integrator, make):
    assert_same(*both(make(order), integrator, 2e-3, 0.03))


@pytest.mark.parametrize("kind", JOINTS, ids=lambda kind: kind.type)
@integrators
def test_every_joint(kind, integrator):
    """Between bodies, ground at rest and in motion, beam nodes and mass points."""
    assert_same(*both(test_joints.scene(kind)[0], integrator, 0.01, 0.1))


@pytest.mark.parametrize("kind", test_drives.COORDINATES, ids=lambda kind: kind.type)
@integrators
def test_every_drive(kind, integrator):
    assert_same(*both(test_drives.scene(kind)[0], integrator, 0.01, 0.1))


@pytest.mark.parametrize("seed", range(100, 106))
@integrators
def test_random_trees(seed, integrator):
    assert_same(*both(random_tree(seed), integrator, 0.005, 0.05))


@integrators
def test_deep_trees(integrator):
    assert_same(*both(chain(12), integrator, 2e-3, 0.03))


@integrators
def test_without_scaling(integrator):
    """The same solutions: rows and columns are scaled only for the choice of pivots."""
    system = tree(1)
    unscaled = sc.Multipliers(scaled=False)
    assert_same(*both(system, integrator, 2e-3, 0.03, unscaled))


@integrators
def test_swing(integrator):
    """Through kept factors and from better starts the same motion, with few factorisations."""
    system = swing(20)
    plain, compiled = both(system, integrator, 1e-2, 0.3, start=sc.initial_state(system))
    assert_same(plain, compiled)
    kept = sc.simulate(
        system, INTEGRATORS[integrator], MULTIPLIERS, 1e-2, 0.3, derive=False, kernels="numba"
    )
    assert abs(kept["q"] - plain["q"]).max() < 1e-10
    force = plain["constraint_force"][:-1]
    assert abs(kept["constraint_force"][:-1] - force).max() < 1e-6 * abs(force).max()
    assert kept.meta["factorisations"] < 0.8 * compiled.meta["factorisations"]
    assert kept.meta["unknowns"] == system.n + system.m


@pytest.mark.parametrize("make", [tree, crossing])
@pytest.mark.parametrize("order", FIRST)
@integrators
def test_kept_factors_lead_to_the_same_motion(order, integrator, make):
    system = make(order)
    start = moving(system)
    runs = [
        sc.simulate(
            system, INTEGRATORS[integrator], MULTIPLIERS, 1e-3, 0.1, start=start,
            kernels="numba", settings=sc.NewtonSettings(reuse=reuse),
        )
        for reuse in (0, 4)
    ]  # fmt: skip
    whole, kept = runs
    assert kept["q"][-1] == pytest.approx(whole["q"][-1], abs=1e-9)
    iterations = [run["newton_iterations"].sum() for run in runs]
    factorisations = [run.meta["factorisations"] for run in runs]
    assert factorisations[1] < 0.4 * factorisations[0] and iterations[1] < 3 * iterations[0]
    for run in runs:
        assert run["constraint_violation"].max() < 1e-12
        if integrator == "energy-momentum":
            assert abs(run["energy_balance"]).max() < 1e-10 * abs(run["energy"]).max()


@integrators
def test_kept_factors_know_no_rotation_of_the_whole(integrator):
    """A ball that spins freely, 4 degrees a step: few factorisations serve for all orientations."""
    model = sc.Model()
    spin = (3.0, 4.0, 5.0)
    model.add("ball", sc.RigidBody.sphere(1.0, 0.2, angular_velocity=spin))
    system = model.freeze()
    run = sc.simulate(
        system, INTEGRATORS[integrator], MULTIPLIERS, 1e-2, 2.0, derive=False, kernels="numba"
    )
    assert abs(run["q"][-1] - run["q"][0]).max() > 0.5
    assert len(run) == 201 and run.meta["factorisations"] < 201 / 8


# -- what may go wrong -----------------------------------------------------------------------------


@integrators
def test_a_step_that_fails_is_tried_again_the_general_way(integrator, monkeypatch):
    """With the same attempts, and the compiled kernels go on after it."""
    solve = CompiledMultipliers.solve
    calls = []

    def sometimes(self, state):
        calls.append(state.index)
        return None if state.index in (4, 5) else solve(self, state)

    monkeypatch.setattr(CompiledMultipliers, "solve", sometimes)
    plain, compiled = both(tree(1), integrator, 2e-3, 0.03)
    assert len(calls) == 32  # each step of both compiled runs, and the one after
    assert_same(plain, compiled)


@integrators
def test_solutions_that_have_turned_over_are_none(integrator):
    """A hinge's rows are fulfilled half a turn off as well: left to the general way."""
    model = sc.Model()
    body = model.add("body", sc.RigidBody.box(1.0, (1, 0.3, 0.2)))
    model.add("pin", sc.JointRevolute(sc.ground((0, 0, 0)), body.at((0, 0, 0)), axis=(0, 0, 1)))
    system = model.freeze()
    method = INTEGRATORS[integrator]
    fast = CompiledMultipliers(system, method, 1e-2, sc.NewtonSettings(reuse=0))
    state = sc.initial_state(system)
    assert fast.solve(state) is not None
    half = np.diag([1.0, -1.0, -1.0])  # about x: the axis points the other way
    over = (half @ system.q0.reshape(4, 3)[1:].T).T
    fast._own.start[1:] = over - system.q0.reshape(4, 3)[1:]
    fast.resume(None)  # begin there
    assert fast.solve(state) is None
    assert system.wrong_branch(fast.y1) is not None


def test_where_there_are_none():
    """Closed loops have rows that depend on others: chosen anew in each step."""
    model = sc.Model()
    body = model.add("body", sc.RigidBody.box(1.0, (1, 0.3, 0.2)))
    for name, z in (("low", 0.0), ("high", 0.1)):
        place = body.at((0, 0, z))
        model.add(name, sc.JointRevolute(sc.ground((0, 0, z)), place, axis=(0, 0, 1)))
    system = model.freeze()
    assert "closed loops" in refusal(system, sc.EnergyMomentum(), MULTIPLIERS)
    assert refusal(tree(1), sc.EnergyMomentum(), MULTIPLIERS) is None


@pytest.mark.slow
@integrators
def test_restart(integrator):
    system = tree(2)
    options = {"derive": False, "kernels": "numba"}
    pair = INTEGRATORS[integrator], MULTIPLIERS
    whole = sc.simulate(system, *pair, 2e-3, 0.04, start=moving(system), **options)
    first = sc.simulate(system, *pair, 2e-3, 0.02, start=moving(system), **options)
    again = sc.restart(system, first, pair[0], 2e-3)
    rest = sc.simulate(system, *pair, 2e-3, 0.04, start=again, **options)
    assert rest["q"][-1] == pytest.approx(whole["q"][-1], abs=1e-11)
