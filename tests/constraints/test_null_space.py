"""Null space matrices, reparametrisation and counts on named scenes and random trees."""

from __future__ import annotations

import numpy as np
import pytest
from helpers_kernels import chain
from helpers_scenes import (
    assert_constraints,
    assert_null_space,
    everything,
    null_space,
    random_tree,
    rotation,
    swing,
    two_states,
)

import skfem_cosserat as sc
from skfem_cosserat.kernels import director_force, null_space_blocks
from skfem_cosserat.model.reparametrisation import Reparametrisation

SCENES = {
    **{f"tree {seed}": (lambda seed=seed: random_tree(seed)) for seed in range(20)},
    "everything": lambda: everything(1),
    "everything, swapped": lambda: everything(2, swapped=True),
    "swing": lambda: swing(4),
}


@pytest.mark.one_quick
@pytest.mark.parametrize("name", SCENES)
def test_null_space_at_nodes_and_midpoints(name):
    system = SCENES[name]()
    y0, y1, nodal = two_states(system, 11, 0.5)
    for y in (y0, y1):
        assert_constraints(system, y)
    for y in (y0, 0.5 * (y0 + y1)):
        assert_null_space(system, y, nodal.fixed)


@pytest.mark.one_quick
@pytest.mark.parametrize("seed", range(6))
def test_null_space_is_the_derivative_of_the_chart(seed):
    """d F_d / d(increment) = P(q_{n+1}), by the complex step."""
    system = random_tree(seed)
    _, y1, nodal = two_states(system, seed)
    P = null_space(system, y1, nodal.fixed)
    saved = nodal.save()
    for k in range(system.unknowns):
        increment = np.zeros(system.unknowns, dtype=complex)
        increment[k] = 1e-40j
        nodal.add(increment)
        column = nodal.configuration()[: system.rows].imag.ravel() / 1e-40
        assert abs(column - P[:, k]).max() < 1e-12
        nodal.restore(saved)


@pytest.mark.parametrize("seed", range(4))
def test_reduction_and_expansion_are_the_matrix(seed):
    """The kernels that never form P: P^T f and P nu."""
    system = random_tree(seed)
    rng = np.random.default_rng(seed)
    y0, _, nodal = two_states(system, seed)
    P = null_space(system, y0, nodal.fixed)
    kin = system.kinematics
    values = kin.values_at(y0, nodal.fixed)
    f, nu = rng.standard_normal((system.rows, 3)), rng.standard_normal(system.unknowns)
    reduced = kin.T.reduce(values, kin.twist_force(y0, f))
    assert reduced == pytest.approx(P.T @ f.ravel(), rel=1e-12, abs=1e-12)
    rates = kin.rates(y0, kin.T.expand(values, nu))[: system.rows]
    assert rates.ravel() == pytest.approx(P @ nu, rel=1e-12, abs=1e-12)


@pytest.mark.slow
def test_constraints_hold_over_many_compositions():
    """500 steps of random increments: no drift beyond round-off."""
    system = random_tree(3)
    rng = np.random.default_rng(0)
    nodal = Reparametrisation(system.kinematics)
    y = system.extend(system.q0, 0.0)
    for k in range(500):
        nodal.begin(y, system.ground(1e-3 * (k + 1)))
        nodal.add(0.02 * rng.standard_normal(system.unknowns))
        y = nodal.configuration()
    directors = system.kinematics.directors(y)
    products = directors @ directors.transpose(0, 2, 1)
    assert abs(products - np.eye(3)).max() < 1e-12
    assert abs(system.constraints.values(y)).max() < 1e-12 * (1 + abs(y).max() ** 2)


def test_internal_null_space():
    rng = np.random.default_rng(1)
    D = np.array([rotation(rng).T for _ in range(5)])
    P = null_space_blocks(D)
    v, omega = rng.standard_normal((2, 3))
    rate = (P @ np.concatenate([v, omega])).reshape(5, 4, 3)
    assert rate[:, 0] == pytest.approx(np.tile(v, (5, 1)))
    assert rate[:, 1:] == pytest.approx(np.cross(omega, D), abs=1e-15)
    f = rng.standard_normal((5, 3, 3))
    assert director_force(D, f) == pytest.approx(np.cross(D, f).sum(1), abs=1e-14)


def test_counts_of_the_swing():
    system = swing()
    assert system.counts() == {"n": 276, "m": 154, "rank": 154, "unknowns": 122}
    for integrator in (sc.Variational(), sc.EnergyMomentum()):
        weight = integrator.constraint_weight
        assert sc.NullSpace().bind(system, weight).unknowns == 122
        assert sc.Multipliers().bind(system, weight).unknowns == 430


def test_counts_of_points_and_lumps():
    model = sc.Model()
    body = model.add("body", sc.RigidBody.sphere(1.0, 1.0))
    model.add("lump", sc.MassPoint(1.0, on=body.at((1, 0, 0))))
    model.add("second", sc.RigidBody.sphere(1.0, 1.0, on=body.at((0, 1, 0))))
    model.add("point", sc.MassPoint(1.0))
    assert model.freeze().counts() == {"n": 15, "m": 6, "rank": 6, "unknowns": 9}


# -- deep trees, joint by joint --------------------------------------------------------------------


@pytest.mark.one_quick
@pytest.mark.parametrize("name", SCENES)
def test_the_twist_map_joint_by_joint_is_its_matrix(name):
    """T^T f and T nu from what each joint passes on, at any configuration."""
    system = SCENES[name]()
    y0, _, nodal = two_states(system, 1)
    kin, rng = system.kinematics, np.random.default_rng(1)
    at = kin.recursion.own.locate(y0, nodal.fixed)
    T = kin.T.matrix(kin.values_at(y0, nodal.fixed))
    values = kin.recursion.values(at)
    f, nu = rng.standard_normal(kin.n_twist), rng.standard_normal(kin.unknowns)
    assert kin.recursion.reduce(values, f) == pytest.approx(T.T @ f, rel=1e-12, abs=1e-12)
    assert kin.recursion.expand(values, nu) == pytest.approx(T @ nu, rel=1e-12, abs=1e-12)


def test_steps_of_a_deep_tree_ask_for_no_full_matrix(kernels):
    """What is stored grows with the items, not with their square: pairs, map and pattern."""
    sizes = []
    for count in (40, 80):
        system = chain(count)
        integrator, treatment = sc.EnergyMomentum(), sc.NullSpace()
        stepper = sc.Stepper(system, integrator, treatment, 1e-3, kernels=kernels)
        stepper.advance(stepper.own(sc.initial_state(system)))
        assert "pairs" not in vars(system.tree)
        assert "T" not in vars(system.kinematics)
        sizes.append(stepper.bound.solver.pattern.nnz)
    assert sizes[0] < sizes[1] < 2.1 * sizes[0] < 0.4 * system.unknowns**2
