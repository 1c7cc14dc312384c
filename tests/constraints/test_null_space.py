"""Null space matrices, reparametrisation and counts on named scenes and random trees."""

from __future__ import annotations

import numpy as np
import pytest
from helpers_scenes import (
    everything,
    four_bar,
    null_space,
    random_tree,
    rotation,
    swing,
    triangle,
    unit,
)

from skfem_cosserat import (
    Beam,
    EnergyMomentum,
    JointDistance,
    JointFixed,
    JointRevolute,
    JointSpherical,
    LoadGravity,
    MassPoint,
    MeshCurve,
    Model,
    Multipliers,
    NullSpace,
    RigidBody,
    Section,
    Variational,
    ground,
    initial_state,
    project,
    simulate,
)
from skfem_cosserat.integrators import Stepper
from skfem_cosserat.kernels import director_force, null_space_blocks, skew
from skfem_cosserat.model.balance import amplitudes_at, balance, balance_tangent
from skfem_cosserat.model.reparametrisation import Reparametrisation
from skfem_cosserat.model.tree import Spot

SCENES = {
    **{f"tree {seed}": (lambda seed=seed: random_tree(seed)) for seed in range(40)},
    "everything": lambda: everything(1),
    "everything, swapped": lambda: everything(2, swapped=True),
    "swing": lambda: swing(4),
}


def two_states(system, seed, size=0.5):
    """Two configurations (all rows) one step apart, and what led to the second."""
    rng = np.random.default_rng(seed)
    nodal = Reparametrisation(system.kinematics)
    nodal.begin(system.extend(system.q0, 0.0), system.ground(0.3))
    for _ in range(2):
        nodal.add(size * rng.standard_normal(system.unknowns))
    y0 = nodal.configuration()
    nodal.begin(y0, system.ground(0.5))
    nodal.add(0.3 * size * rng.standard_normal(system.unknowns))
    nodal.add(0.3 * size * rng.standard_normal(system.unknowns))
    return y0, nodal.configuration(), nodal


@pytest.mark.one_quick
@pytest.mark.parametrize("name", SCENES)
def test_null_space_at_nodes_and_midpoints(name):
    system = SCENES[name]()
    y0, y1, nodal = two_states(system, seed=11)
    assert abs(system.constraints.values(y0)).max() < 1e-13 * (1 + system.length**2)
    assert abs(system.constraints.values(y1)).max() < 1e-13 * (1 + system.length**2)
    for y in (y0, 0.5 * (y0 + y1), y1):
        G = system.constraints.jacobian(y).toarray()
        P = null_space(system, y, nodal.fixed)
        assert abs(G @ P).max() <= 1e-12 * abs(G).max() * abs(P).max()
        if y is not y1:
            # rank P = unknowns and G P = 0 bound rank G by n - unknowns from above
            assert np.linalg.matrix_rank(P) == P.shape[1] == system.unknowns
            assert np.linalg.matrix_rank(G) == system.n - P.shape[1] == system.rank == system.m


@pytest.mark.parametrize("name", ["tree 1", "tree 5", "everything", "swing"])
def test_coordinates_one_by_one_are_those_in_arrays(name):
    """Also those of vertices without a parent, which are made when they are asked for."""
    system = SCENES[name]()
    tree, kin = system.tree, system.kinematics
    assert [k for own in tree.own for k in own] == list(range(kin.unknowns))
    kind = {k: each for each, numbers in kin.numbers.items() for k in numbers.tolist()}
    each = [tree.coordinate(k) for k in range(kin.unknowns)] + tree.driven
    for k, c in enumerate(each):
        assert (c.number, c.kind, c.vertex) == (k, kind[k], kin.vertex[k])
        assert c.drive is not None or k in tree.own[c.vertex]
        assert (kin.axis[k] == (0 if c.kind in ("axis", "slide") else c.axis)).all()
        if c.vertex in tree.free:
            assert c.centre == (Spot(c.vertex) if c.kind == "rotation" else None)


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
    """1000 steps of random increments: no drift beyond round-off."""
    system = random_tree(3)
    rng = np.random.default_rng(0)
    nodal = Reparametrisation(system.kinematics)
    y = system.extend(system.q0, 0.0)
    for k in range(1000):
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
    assert skew(v) @ omega == pytest.approx(np.cross(v, omega))


def test_counts_of_the_swing():
    system = swing()
    assert system.counts() == {"n": 276, "m": 154, "rank": 154, "unknowns": 122}
    for integrator in (Variational(), EnergyMomentum()):
        weight = integrator.constraint_weight
        assert NullSpace().bind(system, weight).unknowns == 122
        assert Multipliers().bind(system, weight).unknowns == 430
    text = repr(system)
    for word in ("n = 276", "m = 154", "430 with multipliers", "122 with the null space"):
        assert word in text


def test_counts_joint_by_joint():
    """Three numbers for a point, 12 - 6 for a body; what each joint takes away."""
    taken = {JointSpherical: 3, JointRevolute: 5, JointFixed: 6, JointDistance: 1}
    for kind, size in taken.items():
        model = Model()
        body = model.add("body", RigidBody.box(1.0, (1, 2, 3)))
        options = {"axis": (0, 0, 1.0)} if kind is JointRevolute else {}
        a = ground((0, 0, 1)) if kind is JointDistance else ground((0, 0, 0))
        joint = model.add("joint", kind(a, body.at((0, 0, 0)), **options))
        assert joint.size == size
        model.add("stone", MassPoint(1.0, (5, 5, 5)))  # else a weld would leave nothing to move
        system = model.freeze()
        assert system.counts() == {"n": 15, "m": 6 + size, "rank": 6 + size, "unknowns": 9 - size}


def test_counts_of_points_and_lumps():
    model = Model()
    body = model.add("body", RigidBody.sphere(1.0, 1.0))
    model.add("lump", MassPoint(1.0, on=body.at((1, 0, 0))))
    model.add("second", RigidBody.sphere(1.0, 1.0, on=body.at((0, 1, 0))))
    model.add("point", MassPoint(1.0))
    assert model.freeze().counts() == {"n": 15, "m": 6, "rank": 6, "unknowns": 9}


# ----------------------------------------------------------------------- loops
@pytest.mark.slow
@pytest.mark.parametrize("integrator", [Variational(), EnergyMomentum()], ids=lambda i: i.name)
@pytest.mark.parametrize("treatment", [NullSpace(), Multipliers()], ids=lambda t: t.name)
def test_closed_loop(integrator, treatment):
    """A rigid triangle on a ball joint, whose bars may spin: mobility 6."""
    system = triangle().freeze()
    assert system.counts() == {"n": 36, "m": 30, "rank": 30, "unknowns": 6}
    assert len(system.redundant) == 0
    weight = integrator.constraint_weight
    assert treatment.bind(system, weight).unknowns == (6 if treatment.name == "null-space" else 66)
    G = system.constraints.jacobian(system.extend(system.q0, 0.0)).toarray()
    assert np.linalg.matrix_rank(G) == 30
    history = simulate(system, integrator, treatment, 0.01, 0.5)
    bound = 1e-12 if treatment.name == "null-space" else 1e-11
    assert history["constraint_violation"].max() < bound
    energy = history["energy"] + history["external"]
    bound = 1e-10 if isinstance(integrator, EnergyMomentum) else 0.02
    assert np.ptp(energy) < bound * np.ptp(history["kinetic"])
    assert np.ptp(history["kinetic"]) > 1


@pytest.mark.slow
def test_both_treatments_give_the_same_motion():
    """Every item at once, from rest, both integrators."""
    system = everything(1)
    start = consistent(system)
    for integrator in (Variational(), EnergyMomentum()):
        found = [
            simulate(system, integrator, treatment, 2e-3, 0.02, start=start, derive=False)["q"]
            for treatment in (NullSpace(), Multipliers())
        ]
        assert abs(found[0] - found[1]).max() < 1e-9
        assert abs(found[0][-1] - found[0][0]).max() > 1e-3


def consistent(system):
    """Initial state whose velocity follows the moving ground."""
    v = project(system, system.q0, np.zeros(system.n))
    return initial_state(system, v=v)


def test_planar_four_bar_is_redundant_and_loosened_it_is_not():
    system = four_bar().freeze()
    assert system.counts() == {"n": 36, "m": 38, "rank": 35, "unknowns": 1}
    assert len(system.redundant) == 3
    assert Multipliers().bind(system, 0.0).unknowns == 36 + 35
    loose = four_bar((JointRevolute, JointSpherical, JointSpherical, JointRevolute)).freeze()
    # mobility 2: the four-bar's own, and the coupler's spin about its two ball joints
    assert loose.unknowns == 2
    for each in (system, loose):
        G = each.constraints.jacobian(each.extend(each.q0, 0.0)).toarray()
        assert np.linalg.matrix_rank(G) == each.rank == each.m - len(each.redundant)


def test_a_hinge_keeps_its_axis():
    """It turns about its own axis wherever its guide goes."""
    rng = np.random.default_rng(2)
    for swap in (False, True):
        model = Model()
        axis = unit(rng)
        a = model.add("a", RigidBody.box(1.0, (1, 2, 3), triad=rotation(rng).T))
        b = model.add("b", RigidBody.box(1.0, (1, 2, 3), position=(1, 0, 0)))
        places = [a.at((0.5, 0, 0)), b.at((0.5, 0, 0))]
        model.add("pin", JointRevolute(*places[:: -1 if swap else 1], axis=axis))
        system = model.freeze()
        _, y1, _ = two_states(system, 4, 1.0)
        R = [(y1[k + 1 : k + 4].T @ d.triad) for k, d in ((0, a), (4, b))]
        assert R[0] @ axis == pytest.approx(R[1] @ axis, abs=1e-13)
        assert abs(R[0] - R[1]).max() > 0.1


# -- deep trees, joint by joint --------------------------------------------------------------------


def chain(count, kind=JointSpherical):
    """Bars in a row on ball joints or hinges, which swing."""
    model, end = Model(), ground((0, 0, 0))
    options = {"axis": (0.6, 0, 0.8)} if kind is JointRevolute else {}
    for k in range(count):
        a, b = np.array([0.1 * k, 0, 0]), np.array([0.1 * (k + 1), 0, 0])
        bar = RigidBody.box(0.1, (0.1, 0.02, 0.02), position=(a + b) / 2)
        bar = model.add(f"bar {k}", bar)
        model.add(f"joint {k}", kind(end, bar.at(a), **options))
        end = bar.at(b)
    model.add("weight", LoadGravity((0, -9.81, 0.5)))
    return model.freeze()


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


@pytest.mark.one_quick
@pytest.mark.parametrize("kernels", ["numpy", "numba"])
def test_steps_of_a_long_chain_ask_for_no_full_matrix(kernels):
    """What is stored grows with the bars, not with their square: pairs, map and pattern."""
    if kernels == "numba":
        pytest.importorskip("numba")
    sizes = []
    for count in (60, 120):
        system = chain(count)
        stepper = Stepper(system, EnergyMomentum(), NullSpace(), 1e-3, kernels=kernels)
        stepper.advance(stepper.own(initial_state(system)))
        assert "pairs" not in vars(system.tree)
        assert "T" not in vars(system.kinematics)
        sizes.append(stepper.bound.solver.pattern.nnz)
    assert sizes[0] < sizes[1] < 2.1 * sizes[0]


def row_of_beams(count):
    """Short beams, each clamped to the end of the last one."""
    model, end = Model(), ground((0, 0, 0))
    section = Section([1e4, 1e4, 2e4, 5, 6, 7], mass=1.0, inertia=(1e-3, 1e-3))
    for k in range(count):
        mesh = MeshCurve.init_line((0.1 * k, 0, 0), (0.1 * (k + 1), 0, 0), 1, name=f"rod {k}")
        rod = model.add(f"rod {k}", Beam(mesh, section, director=(0, 0, 1)))
        model.add(f"joint {k}", JointFixed(end, rod.node(f"rod {k}.start")))
        end = rod.node(f"rod {k}.end")
    return model.freeze()


@pytest.mark.slow
def test_a_row_of_short_beams_has_a_narrow_matrix():
    """All hang together by fixed joints."""

    def matrix(count):
        system = row_of_beams(count)
        bound, y0 = NullSpace().bind(system, 1.0), system.extend(system.q0, 0.0)
        bound.begin(y0, y0[system.rows :], 1.0)
        bound.guess(False)
        bound.move(0.1 * np.random.default_rng(1).standard_normal(system.unknowns))
        y, amplitudes = bound.configure(), amplitudes_at(system, 0.0)
        at = balance(system, y, amplitudes)
        bound.reduce(at.R, y)
        data = bound.matrix(balance_tangent(system, at, amplitudes), at.R, y, scaled=False)
        return bound.solver.pattern.assembled(data)

    found, twice = matrix(40), matrix(80)
    assert twice.nnz < 2.1 * found.nnz < 0.4 * found.shape[0] ** 2
