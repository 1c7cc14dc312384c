"""What steps of plain numpy are made of: rotations, null spaces of nodes, states kept between."""

import numpy as np
import pytest
from helpers_scenes import swing
from helpers_schemes import KINDS

import skfem_cosserat as sc
from skfem_cosserat import Stepper, kernels

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


@pytest.mark.parametrize("size", [0.0, 1e-170, 1e-6, 1.0, 3.0])
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
