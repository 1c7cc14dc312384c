"""The plain path of a step: short cuts equal the long way."""

import numpy as np
import pytest
from helpers_scenes import everything, random_state, swing
from helpers_schemes import KINDS

import skfem_cosserat as sc
from skfem_cosserat import Stepper, kernels
from skfem_cosserat.kernels import beam_tangent
from skfem_cosserat.model import groups
from skfem_cosserat.model.kinematics import combination
from skfem_cosserat.pattern import FrozenPattern

INTEGRATORS = {"variational": sc.Variational(), "energy-momentum": sc.EnergyMomentum()}
TREATMENTS = {"null space": sc.NullSpace(), "multipliers": sc.Multipliers()}
SCENES = {"everything": lambda: everything(2), "swing": lambda: swing(4)}
EPS = 1e-30


@pytest.mark.parametrize("integrator", [s for s in KINDS if isinstance(s, sc.EnergyMomentum)])
def test_steps_go_on_from_any_state_as_a_new_stepper_does(integrator):
    """What is kept of the end of a step is used after that step only."""
    system = swing(4)

    def stepper():
        return Stepper(system, integrator, sc.NullSpace(), 1e-3, kernels="numpy")

    one = stepper()
    first = one.advance(sc.initial_state(system)).state
    second = one.advance(first).state
    for state in (first, second):  # the first one again: not where the last step ended
        moved = stepper().advance(state).state
        again = one.advance(state).state
        assert abs(again.q - moved.q).max() < 1e-14 * system.length
        # p = 2 M dq/h - p_0: rounding of q, divided by the step
        rounding = 2 / 1e-3 * abs(system.mass).sum(axis=1).max() * 1e-14 * system.length
        assert abs(again.p - moved.p).max() < rounding


@pytest.mark.slow
@pytest.mark.parametrize("scene", SCENES)
def test_parts_of_a_tangent_equal_its_blocks(scene):
    """Multiplied out, and between two sets of matrices; with and without turned sections."""
    system, rng = SCENES[scene](), np.random.default_rng(5)
    turned = [g.elements.rotations is not None for g in system.beam_groups]
    assert turned == [scene == "everything"]
    y0, y1 = (system.extend(random_state(system, rng, 0.0), 0.0) for _ in range(2))
    for g in system.beam_groups:
        (eps, B1), B = g.strain(y1), g.strain(0.5 * (y0 + y1))[1]
        parts = g.parts(B, B1, g.stress(eps), 0.3, 0.7)
        full = beam_tangent(g.elements, B, B1, g.stress(eps), 0.3, 0.7)
        assert abs(parts.blocks() - full).max() <= 1e-14 * abs(full).max()
        ne, k = full.shape[:2]
        left, right = rng.standard_normal((2, ne, k, k // 2))
        wanted = np.einsum("eka,ekl,elb->eab", left, full, right)
        assert abs(parts.between(left, right) - wanted).max() <= 1e-13 * abs(wanted).max()
    for g in system.groups:
        parts = groups.Parts(2.0 * g.scalar_mass)
        assert (parts.blocks() == 2.0 * g.mass).all()
        right = rng.standard_normal((*g.mass.shape[:2], 2))
        wanted = 2.0 * right.transpose(0, 2, 1) @ (g.mass @ right)
        assert abs(parts.between(right, right) - wanted).max() <= 1e-13 * abs(wanted).max()


def test_b_at_the_midpoint_is_the_mean_of_both_ends():
    system, rng = everything(3), np.random.default_rng(6)
    y0, y1 = (system.extend(random_state(system, rng, 0.0), 0.0) for _ in range(2))
    for g in system.beam_groups:
        B0, B1, B = (g.strain(y)[1] for y in (y0, y1, 0.5 * (y0 + y1)))
        assert abs(B - 0.5 * (B0 + B1)).max() <= 1e-14 * abs(B).max()


@pytest.mark.parametrize("size", [0.0, 1e-170, 1e-12, 1e-6, 1e-3, 1.0, 3.0])
def test_quaternions_and_their_derivatives(size):
    """Rotation matrices against Rodrigues' formula; complex steps at and near zero angles."""
    rng = np.random.default_rng(7)
    theta = size * rng.standard_normal((5, 3))
    R = kernels.rotation_matrix(kernels.exp_quaternion(theta))
    for t, found in zip(theta, R, strict=True):
        angle = np.linalg.norm(t)
        n = kernels.skew(t / angle if angle else t)
        wanted = np.eye(3) + np.sin(angle) * n + 2 * np.sin(angle / 2) ** 2 * n @ n
        assert abs(found - wanted).max() < 1e-13
    a, b = kernels.exp_quaternion(theta), kernels.exp_quaternion(rng.standard_normal((5, 3)))
    product = kernels.rotation_matrix(kernels.quaternion_product(a, b))
    assert abs(product - R @ kernels.rotation_matrix(b)).max() < 2e-14
    # d exp(theta) along itself: a turn about the same axis
    turned = kernels.rotation_matrix(kernels.exp_quaternion(theta + 1j * EPS * theta)).imag / EPS
    assert abs(turned - kernels.skew(theta) @ R).max() <= 4e-14 * size


@pytest.mark.parametrize("nodes", [1, 2, 4])
def test_null_space_matrices_of_blocks_of_nodes(nodes):
    D = np.random.default_rng(11).standard_normal((3, nodes, 3, 3))
    found = kernels.null_space_blocks(D)
    wanted = np.zeros((3, nodes, 4, 3, nodes, 2, 3))
    for a in range(nodes):
        wanted[:, a, 0, :, a, 0] = np.eye(3)
        wanted[:, a, 1:, :, a, 1] = -kernels.skew(D[:, a])
    assert (found == wanted.reshape(3, 12 * nodes, 6 * nodes)).all()
    if nodes == 1:
        assert (found == kernels.null_space_blocks(D[:, 0])).all()


def test_spin_gradient_is_a_derivative():
    rng = np.random.default_rng(8)
    D, F = rng.standard_normal((2, 4, 3, 3))
    found = kernels.spin_gradient(D, F)
    for k in range(3):
        omega = np.zeros(3, dtype=complex)
        omega[k] = 1j * EPS
        turned = D + kernels.cross(omega, D)
        wanted = kernels.director_force(turned, F.astype(complex)).imag / EPS
        assert abs(found[:, :, k] - wanted).max() < 1e-14


def test_cross_products():
    rng = np.random.default_rng(9)
    a, b = rng.standard_normal((4, 1, 3)), rng.standard_normal((4, 5, 3))
    assert abs(kernels.cross(a, b) - np.cross(a, b)).max() < 1e-15


def test_combinations_of_unequal_length():
    rows, factors = combination([[(1, 2.0)], [], [(0, 1.0), (2, -3.0)]])
    y = np.arange(9.0).reshape(3, 3)
    found = (factors @ y.take(rows, axis=0))[:, 0]
    assert (found == [2 * y[1], 0 * y[0], y[0] - 3 * y[2]]).all()


def test_sums_of_a_pattern_are_those_of_bincount():
    rng = np.random.default_rng(10)
    i, j = rng.integers(0, 6, (2, 200))
    pattern = FrozenPattern(i, j, (6, 6))
    values = rng.standard_normal(200)
    wanted = np.bincount(pattern.slot, values, pattern.nnz)
    assert (pattern.data(values) == wanted).all()
    assert (pattern.data(values + 2j * values) == wanted + 2j * wanted).all()
