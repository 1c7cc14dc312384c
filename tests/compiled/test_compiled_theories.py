"""Compiled kernels for theories of beams against the plain ones."""

from __future__ import annotations

import numpy as np
import pytest
from helpers_scenes import full_section
from test_compiled import (
    assert_same,
    both,
    integrators,
    moving,
    test_residual_and_increment_at_random_states,
)
from test_theories import cantilever, swing

import skfem_cosserat as sc
from skfem_cosserat import diagnostics
from skfem_cosserat.constraints import null_space
from skfem_cosserat.integrators.choice import BORDER, refusal
from skfem_cosserat.integrators.compiled_step import CompiledStep

# what is imported is no test of this module
residual_and_increment = test_residual_and_increment_at_random_states
del test_residual_and_increment_at_random_states

THEORIES = (sc.TheoryInextensible(), sc.TheoryKirchhoff(), sc.TheoryRigid())
theories = pytest.mark.parametrize("theory", THEORIES, ids=repr)


def crooked(theory, order=1):
    """A beam with corners that the tree runs along against its elements, and what hangs on it.

    On a hinge a body, on that by a ball joint another beam, all in space.
    """
    points = [(0, 0, 0), (1, 0, 0), (1.3, 0.9, 0.2)]
    model = sc.Model()
    mesh = sc.MeshCurve.init_polyline(points, 2, name="c")
    first = sc.Beam(mesh, full_section(), order=order, director=(0, 0, 1), theory=theory)
    first = model.add("first", first)
    model.add("clamp", sc.JointFixed(sc.ground(points[2]), first.node("c.end")))
    inertia = np.array([[0.5, 0.06, -0.04], [0.06, 0.6, 0.09], [-0.04, 0.09, 0.45]])
    body = sc.RigidBody(1.5, inertia, center=(0.1, -0.2, 0.15), position=(-0.2, 0.1, 0))
    body = model.add("body", body)
    axis = (0.0, 0.6, 0.8)
    model.add("hinge", sc.JointRevolute(first.node("c.start"), body.at(points[0]), axis))
    end = np.array([-0.4, 0.0, 0.1])
    mesh = sc.MeshCurve.init_line(end, end + (0, 0.5, 0), 3, name="tail")
    other = sc.Beam(mesh, full_section(), order=order, director=(0, 0, 1), theory=theory)
    other = model.add("tail", other)
    model.add("ball", sc.JointSpherical(body.at(end), other.node("tail.start")))
    model.add("gravity", sc.LoadGravity((0.5, -0.3, -9.81)))
    return model.freeze()


@integrators
@theories
def test_residual_and_increment(theory, integrator):
    """At random states, far from a solution: every part of the tangent."""
    residual_and_increment(1, integrator, lambda order: crooked(theory, order))


@integrators
@theories
def test_runs_of_trees(theory, integrator):
    assert_same(*both(crooked(theory), integrator, 2e-3, 0.06))


@integrators
@pytest.mark.parametrize("theory", [*THEORIES, sc.TheoryInextensible(torsion=False)], ids=repr)
def test_runs_of_the_swing(theory, integrator):
    """A closed loop through the beam, out of its plane, too; the forces that hold strains."""
    system = swing().scene("stiff", elements=4, theory=theory, side_load=0.3).freeze()
    assert system.closure.rank > 0
    plain, compiled = (
        sc.simulate(
            system, integrator_of(integrator), sc.NullSpace(), 2e-3, 0.1,
            kernels=kernels, settings=sc.NewtonSettings(reuse=0),
        )
        for kernels in ("numpy", "numba")
    )  # fmt: skip
    assert compiled.meta["kernels"] == "numba"
    for name in ("q", "p", "carried"):  # unshearable: 6.4e-12
        size = max(1.0, abs(plain[name]).max())
        assert abs(compiled[name] - plain[name]).max() < 1e-11 * size, name
    force, other = plain["constraint_force"][:-1], compiled["constraint_force"][:-1]
    # stiff sections: forces are differences of large numbers
    assert abs(force - other).max() < 1e-7 * abs(force).max()


def integrator_of(name):
    return {"variational": sc.Variational(), "energy-momentum": sc.EnergyMomentum()}[name]


@integrators
def test_factors_are_kept(integrator):
    """Over steps, turned with the frames: fewer matrices than iterations, the same motion."""
    system = crooked(sc.TheoryInextensible())
    start = moving(system)
    ends, made = [], []
    for reuse in (0, 4):
        settings = sc.NewtonSettings(reuse=reuse)
        method = integrator_of(integrator)
        stepper = sc.Stepper(system, method, sc.NullSpace(), 1e-3, settings, kernels="numba")
        state = start
        for _ in range(100):
            state = stepper.advance(state).state
        ends.append(state.q)
        made.append(stepper.factorisations)
    assert abs(ends[1] - ends[0]).max() < 1e-11 * abs(ends[0]).max()
    assert 2 * made[1] < made[0]


@pytest.mark.filterwarnings(
    "ignore::skfem_cosserat.PerformanceWarning"
)  # full matrices, to compare with
def test_long_beams_cost_as_much_as_their_elements():
    """Blocks and products of blocks, not a full matrix; same motion as with multipliers."""
    made = {}
    for count in (100, 200):
        system = cantilever(sc.TheoryInextensible(), 1, count, load=(0, 30.0, 20.0)).freeze()
        fast = CompiledStep(system, sc.EnergyMomentum(), 1e-2, sc.NewtonSettings())
        made[count] = fast.plan.work, fast._a.A.shape[0]
    assert made[200][0] - 2 * made[100][0] == pytest.approx(0, abs=3)
    assert made[200][1] - 2 * made[100][1] == pytest.approx(0, abs=3)
    runs = [
        sc.simulate(system, sc.EnergyMomentum(), treatment, 1e-2, 0.05, kernels=kernels)
        for treatment, kernels in ((sc.NullSpace(), "numba"), (sc.Multipliers(), "numpy"))
    ]
    assert abs(runs[0]["q"] - runs[1]["q"]).max() < 1e-10


def test_closed_loops_are_looked_at_now_and_then(monkeypatch):
    """Rows that close them are looked at when the motion asks for it, not in each step.

    And only chosen anew where they have come closer to each other, which they do not here.
    """
    system = swing().scene("stiff", theory=sc.TheoryInextensible()).freeze()
    stepper = sc.Stepper(system, sc.EnergyMomentum(), sc.NullSpace(), 1e-3, kernels="numba")
    chosen, looks = [], []
    choose, clear = stepper._begin, stepper.bound.clear
    stepper._begin = lambda state: (chosen.append(state.index), choose(state))[1]
    stepper.bound.clear = lambda rows: (looks.append(rows), clear(rows))[1]
    state = sc.initial_state(system)
    for _ in range(300):
        state = stepper.advance(state).state
    assert stepper.bound.clearance == pytest.approx(0.1, rel=0.5)
    assert chosen == [0] and 2 < len(looks) < 30
    monkeypatch.setattr(null_space, "HALF", 2.0)  # never twice as independent as at the start
    for _ in range(100):
        state = stepper.advance(state).state
    assert 1 < len(chosen) < 20
    violation = diagnostics.constraint_violation(system, state.q, state.time)
    assert violation < 1e-12


@pytest.mark.parametrize("planar", [None, sc.Planar()])
def test_rows_that_kernels_tell_are_those_of_the_closed_loops(planar):
    """Against their Jacobian in the tree's coordinates, where the step begins or half-way."""
    system = swing().scene("stiff", theory=sc.TheoryInextensible()).freeze(planar)
    for integrator in (sc.Variational(), sc.EnergyMomentum()):
        stepper = sc.Stepper(system, integrator, sc.NullSpace(), 1e-5, kernels="numba")
        told = []
        stepper.bound.clear = lambda rows, told=told: bool(told.append(rows))
        state = sc.initial_state(system)
        for _ in range(5):
            state = stepper.advance(state).state
        stepper.bound.clearance = 0.0
        stepper.advance(state)
        kinematics, closure = system.kinematics, system.closure
        y = system.extend(state.q, state.time)
        T = kinematics.T_values(kinematics.locate(y, stepper.bound.nodal.fixed))
        (component,), (C,) = closure.components, closure.matrices(y, T)
        rows = [closure.rows.tolist().index(k) for k in np.sort(stepper.bound.closing)]
        size = closure.magnitude[rows][:, None] / component.scale
        expected = np.zeros_like(told[0])
        expected[:, component.columns] = C[rows] * size
        assert abs(told[0] - expected).max() < 1e-6 * abs(expected).max()
        (selected,) = stepper.bound._chosen
        assert closure.independence([selected], told[0]) == pytest.approx(
            selected.pivots.min(), rel=1e-5
        )


@pytest.mark.plain
def test_automatic_choice_knows_that_plain_kernels_are_slow():
    """With lines eliminated: fewer steps are enough for compiled kernels to pay."""
    names = {}
    for theory in (None, sc.TheoryInextensible()):
        system = swing().scene("stiff", theory=theory).freeze()
        stepper = sc.Stepper(system, sc.EnergyMomentum(), sc.NullSpace(), 1e-3, steps=8000)
        names[theory] = stepper.choice.name
    assert names == {None: "numpy", sc.TheoryInextensible(): "numba"}


def test_what_there_are_no_kernels_for():
    method = sc.EnergyMomentum()
    long = swing().scene("stiff", elements=BORDER, theory=sc.TheoryInextensible(torsion=False))
    for system, treatment, what in (
        (crooked(sc.TheoryInextensible(), 2), sc.NullSpace(), "higher order"),
        (
            crooked(sc.TheoryInextensible()),
            sc.Multipliers(),
            "beams that hold strains, with multipliers",
        ),
        (long.freeze(), sc.NullSpace(), f"more than {BORDER} rows"),
    ):
        reason = refusal(system, method, treatment)
        assert reason is not None
        assert what in reason
    assert refusal(crooked(sc.TheoryRigid(), 2), method, sc.NullSpace()) is None
