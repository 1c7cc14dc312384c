"""Strains, internal forces and tangents of single elements and networks."""

from __future__ import annotations

import numpy as np
import pytest
from helpers_scenes import FULL, full_section, rotation, unit

from skfem_cosserat import Beam, MeshCurve, Section
from skfem_cosserat.kernels import (
    beam_force,
    beam_strain,
    beam_stress,
    beam_tangent,
    exp_quaternion,
    quaternion_product,
    rotation_matrix,
)
from skfem_cosserat.strain import strain_table

# linear elements of the network are bent too far; formulas hold all the same
pytestmark = pytest.mark.filterwarnings("ignore::skfem_cosserat.ModelWarning")

ORDERS = [1, 2, 3, 4]
EPS = 1e-40


def network(order):
    """A helix, and a straight beam and an arc that leave its end under angles; twisted."""
    helix = MeshCurve.init_helix((1, 0, 0), (0, 0, 0), (0, 0, 1), 0.5, 0.4, 2, name="helix")
    end = helix.p[:, helix.node("helix.end")]
    bar = MeshCurve.init_line(end, end + np.array([0.3, 0.5, 0.1]), 2, name="bar")
    arc = MeshCurve.init_arc(end, (0, 0, 1), (1, 0, 0), 0.8, 1.2, 2, name="arc")
    sections = {"helix": full_section(), "bar": full_section(), "arc": full_section()}
    twist = {"helix": 0.7, "arc": lambda s: s**2}
    return Beam(helix.joined(bar, arc), sections, order=order, twist=twist)


def deformed(beam, seed, size=0.2):
    """Random displacements and random rotations of all nodes, orthonormal directors (N, 4, 3)."""
    rng = np.random.default_rng(seed)
    q = beam.reference.reshape(-1, 4, 3).copy()
    q[:, 0] += size * rng.standard_normal(q[:, 0].shape)
    R = np.array([rotation(rng, size) for _ in q])
    q[:, 1:] = q[:, 1:] @ R.transpose(0, 2, 1)
    return q


def strains(beam, q):
    return beam_strain(beam.elements, beam.gather(q.reshape(-1)))[0]


# ----------------------------------------------------------------------- objectivity
@pytest.mark.one_quick
@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_rigid_motion_leaves_the_strains(order, seed):
    beam = network(order)
    assert beam.elements.rotations is not None  # relative rotations take part
    rng = np.random.default_rng(seed)
    q = deformed(beam, seed)
    before = strains(beam, q)
    R, shift = rotation(rng, 2.0), 3 * rng.standard_normal(3)
    moved = q @ R.T
    moved[:, 0] += shift
    assert abs(before).max() > 0.1
    assert abs(strains(beam, moved) - before).max() < 1e-12 * max(1, abs(before).max())


@pytest.mark.parametrize("order", ORDERS)
def test_reference_is_free_of_strain_and_stress(order):
    beam = network(order)
    rng = np.random.default_rng(order)
    q = beam.reference.reshape(-1, 4, 3) @ rotation(rng).T
    q[:, 0] += rng.standard_normal(3)
    eps, B = beam_strain(beam.elements, beam.gather(q.ravel()))
    assert abs(eps).max() < 1e-12
    force = beam_force(beam.elements, B, beam_stress(beam.elements, eps))
    assert abs(force).max() < 1e-10


@pytest.mark.parametrize("order", ORDERS)
def test_internal_forces_are_in_balance(order):
    """Objectivity of the energy: no resultant, no moment, at any state."""
    beam = network(order)
    q = deformed(beam, 3)
    f = beam.internal_force_form().assemble(beam.basis, q=q.ravel()).reshape(-1, 4, 3)
    scale = abs(f).max()
    assert scale > 1
    assert abs(f[:, 0].sum(0)).max() < 1e-12 * scale * len(f)
    assert abs(np.cross(q, f).sum((0, 1))).max() < 1e-12 * scale * len(f)


# ----------------------------------------------------------------------- known states
SLIM = Section(np.ones(6), mass=1.0, inertia=(1.0, 1.0))


def straight(length=2.0, order=1, elements=1):
    """Beam along z with d1 along x."""
    mesh = MeshCurve.init_line((0, 0, 0), (0, 0, length), elements)
    return Beam(mesh, SLIM, order=order, director=(1, 0, 0))


def turned(theta):
    """Rotation matrix of a rotation vector."""
    return rotation_matrix(exp_quaternion(np.array([theta], dtype=float)))[0]


@pytest.mark.one_quick
@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("theta", [0.3, -0.8, np.pi / 4, 2.5])
def test_linear_element_bent_or_twisted_between_its_nodes(axis, theta):
    """K = sin(theta)/l about the axis of the relative rotation, positive like omega . d_i."""
    length = 2.0
    beam = straight(length)
    q = beam.reference.reshape(-1, 4, 3).copy()
    # half the turn at each end: the axis keeps its direction in both triads
    for node, sign in ((0, -0.5), (1, 0.5)):
        q[node, 1:] = q[node, 1:] @ turned(sign * theta * np.eye(3)[axis]).T
    K = strains(beam, q)[0, 0, 3:]
    assert K[axis] == pytest.approx(np.sin(theta) / length, abs=1e-15)
    assert abs(np.delete(K, axis)).max() < 1e-15


@pytest.mark.parametrize("order", [2, 3, 4])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_curvature_is_the_rate_of_rotation(order, axis):
    """d_i' = omega x d_i with constant omega.d_i: K tends to it with the order of the element."""
    rate, errors = 0.7, []
    for elements in (1, 2):
        beam = straight(1.0, order, elements)
        q = beam.reference.reshape(-1, 4, 3).copy()
        for node in range(len(q)):
            q[node, 1:] = q[node, 1:] @ turned(rate * q[node, 0, 2] * np.eye(3)[axis]).T
        K = strains(beam, q)[:, :, 3:]
        errors.append(abs(K - rate * np.eye(3)[axis]).max())
    assert errors[0] < 0.02
    assert errors[1] < 0.6 * 2.0 ** (1 - order) * errors[0]


def test_axial_stretch_and_shear():
    beam = straight(2.0)
    q = beam.reference.reshape(-1, 4, 3).copy()
    q[:, 0, 2] *= 1.01
    assert strains(beam, q)[0, 0] == pytest.approx([0, 0, 0.01, 0, 0, 0], abs=1e-15)
    q = beam.reference.reshape(-1, 4, 3).copy()
    q[1, 0, :2] = (0.1, -0.06)  # sheared along x = d1 and y = d2
    assert strains(beam, q)[0, 0] == pytest.approx([0.05, -0.03, 0, 0, 0, 0], abs=1e-15)


def test_stretch_turns_with_the_beam():
    """Components are taken along the directors, not along space axes."""
    beam = straight(2.0)
    R = turned((0.3, -1.0, 2.0))
    q = beam.reference.reshape(-1, 4, 3) @ R.T
    q[1, 0] += 0.02 * R[:, 2] + 0.04 * R[:, 0]
    assert strains(beam, q)[0, 0] == pytest.approx([0.02, 0, 0.01, 0, 0, 0], abs=1e-14)


@pytest.mark.parametrize("order", ORDERS)
def test_fibre_strain(order):
    """A fibre at (X_1, X_2) is stretched by Gamma_3 + X_2 K_1 - X_1 K_2, to first order."""
    beam = straight(1.5, order)
    q = deformed(beam, 7, 1e-7)
    eps = strains(beam, q)[0]
    slope = beam.basis.dshape(beam.elements.points) / 1.5
    X1, X2 = 0.3, -0.2
    along = q[beam.basis.connectivity[0]]
    fibre = along[:, 0] + X1 * along[:, 1] + X2 * along[:, 2]
    stretch = np.linalg.norm(slope.T @ fibre, axis=1) - 1
    found = eps[:, 2] + X2 * eps[:, 3] - X1 * eps[:, 4]
    assert abs(found).max() > 1e-8
    assert found == pytest.approx(stretch, abs=1e-12)


@pytest.mark.parametrize("order", ORDERS)
def test_strain_table_is_the_definition(order):
    """Gamma_i = d_i . phi', K_1 = (d3.d2' - d2.d3')/2 and cyclic, for any twelve fields."""
    from skfem_cosserat.basis import gauss_rule
    from skfem_cosserat.element import shape_derivatives, shape_functions

    points, _ = gauss_rule(order)
    N, dN = shape_functions(order, points), shape_derivatives(order, points)
    table = strain_table(N, dN)
    assert abs(table - table.swapaxes(-1, -2)).max() == 0
    rng = np.random.default_rng(order)
    q = rng.standard_normal((order + 1, 4, 3))
    field, rate = (np.einsum("ag,aik->gik", f, q) for f in (N, dN))
    d, dd = field[:, 1:], rate[:, 1:]
    dot = lambda a, b: (a * b).sum(-1)  # noqa: E731
    wanted = np.stack(
        [
            *(dot(d[:, i], rate[:, 0]) for i in range(3)),
            (dot(d[:, 2], dd[:, 1]) - dot(d[:, 1], dd[:, 2])) / 2,
            (dot(d[:, 0], dd[:, 2]) - dot(d[:, 2], dd[:, 0])) / 2,
            (dot(d[:, 1], dd[:, 0]) - dot(d[:, 0], dd[:, 1])) / 2,
        ],
        axis=1,
    )
    x = q.ravel()
    assert abs(0.5 * np.einsum("i,gsij,j->gs", x, table, x) - wanted).max() < 1e-13


# ----------------------------------------------------------------------- derivatives
def columns(function, x):
    """Derivative of function(x) by all entries of x (ne, k): (..., k) by the complex step."""
    out = []
    for k in range(x.shape[1]):
        z = x.astype(complex)
        z[:, k] += 1j * EPS
        out.append(function(z).imag / EPS)
    return np.stack(out, axis=-1)


@pytest.mark.slow
@pytest.mark.parametrize("order", ORDERS)
def test_b_is_the_derivative_of_the_strains(order):
    beam = network(order)
    x = beam.gather(deformed(beam, order).ravel())
    _, B = beam_strain(beam.elements, x)
    wanted = columns(lambda z: beam_strain(beam.elements, z)[0].reshape(len(z), -1), x)
    assert abs(B - wanted).max() < 1e-13 * abs(B).max()


@pytest.mark.parametrize("order", ORDERS)
def test_force_is_the_derivative_of_the_energy(order):
    beam = network(order)
    elements = beam.elements
    x = beam.gather(deformed(beam, order).ravel())

    def energy(z):
        eps = beam_strain(elements, z)[0]
        W = 0.5 * np.einsum("egi,ij,egj->eg", eps, FULL, eps)
        return (W @ elements.weights) * elements.lengths

    eps, B = beam_strain(elements, x)
    force = beam_force(elements, B, beam_stress(elements, eps))
    wanted = columns(energy, x)
    assert abs(force - wanted).max() < 1e-12 * abs(force).max()


@pytest.mark.parametrize("order", ORDERS)
def test_tangent_is_the_derivative_of_the_force(order):
    beam = network(order)
    elements = beam.elements
    x = beam.gather(deformed(beam, order).ravel())

    def force(z):
        eps, B = beam_strain(elements, z)
        return beam_force(elements, B, beam_stress(elements, eps))

    eps, B = beam_strain(elements, x)
    K = beam_tangent(elements, B, B, beam_stress(elements, eps), 1.0, 1.0)
    assert abs(K - columns(force, x)).max() < 1e-10 * abs(K).max()
    assert abs(K - K.swapaxes(1, 2)).max() < 1e-13 * abs(K).max()


@pytest.mark.parametrize("order", ORDERS)
def test_tangent_of_two_states(order):
    """f = int B(mid)^T (S_0 + S_1)/2 ds by the new state: factors 1/2 and 1/2."""
    beam = network(order)
    elements = beam.elements
    x0, x1 = (beam.gather(deformed(beam, s).ravel()) for s in (1, 2))
    S0 = beam_stress(elements, beam_strain(elements, x0)[0])

    def force(z):
        B = beam_strain(elements, 0.5 * (x0 + z))[1]
        S1 = beam_stress(elements, beam_strain(elements, z)[0])
        return beam_force(elements, B, 0.5 * (S0 + S1))

    B = beam_strain(elements, 0.5 * (x0 + x1))[1]
    eps1, B1 = beam_strain(elements, x1)
    S = 0.5 * (S0 + beam_stress(elements, eps1))
    K = beam_tangent(elements, B, B1, S, 0.5, 0.5)
    assert abs(K - columns(force, x1)).max() < 1e-10 * abs(K).max()


@pytest.mark.parametrize("order", ORDERS)
def test_discrete_derivative_is_exact(order):
    """DV . (q_1 - q_0) = V(q_1) - V(q_0) for the quadratic stored energy."""
    beam = network(order)
    elements = beam.elements
    x0, x1 = (beam.gather(deformed(beam, s).ravel()) for s in (1, 2))
    (e0, _), (e1, _) = beam_strain(elements, x0), beam_strain(elements, x1)
    S = 0.5 * (beam_stress(elements, e0) + beam_stress(elements, e1))
    B = beam_strain(elements, 0.5 * (x0 + x1))[1]
    work = (beam_force(elements, B, S) * (x1 - x0)).sum()
    energy = [
        0.5 * ((e * beam_stress(elements, e)).sum(-1) @ elements.weights) @ elements.lengths
        for e in (e0, e1)
    ]
    assert work == pytest.approx(energy[1] - energy[0], rel=1e-12)


@pytest.mark.parametrize("order", ORDERS)
def test_number_of_zero_energy_modes(order):
    """p Gauss points: no spurious mode among orthonormal states beside the six rigid ones."""
    from skfem_cosserat.kernels import null_space_blocks

    beam = straight(1.0, order, 2)
    K = beam.tangent_form().assemble(beam.basis, q=beam.reference).toarray()
    P = np.zeros((len(K), len(K) // 2))
    for k, block in enumerate(null_space_blocks(beam.triads)):
        P[12 * k : 12 * k + 12, 6 * k : 6 * k + 6] = block
    values = np.linalg.eigvalsh(P.T @ K @ P)
    assert (abs(values) < 1e-12 * values[-1]).sum() == 6
    assert values[6] > 1e-5 * values[-1]


# ----------------------------------------------------------------------- rotations
def test_quaternions_are_rotations():
    rng = np.random.default_rng(0)
    from scipy.spatial.transform import Rotation

    theta = np.concatenate([rng.standard_normal((20, 3)), 1e-5 * rng.standard_normal((5, 3))])
    theta[-1] = 0
    R = rotation_matrix(exp_quaternion(theta))
    assert abs(R - Rotation.from_rotvec(theta).as_matrix()).max() < 1e-14
    a, b = exp_quaternion(theta[:10]), exp_quaternion(theta[10:20])
    product = rotation_matrix(quaternion_product(a, b))
    assert abs(product - R[:10] @ R[10:20]).max() < 1e-14


@pytest.mark.parametrize("size", [0.0, 1e-6, 1e-4, 2.1e-4, 1.0, 3.0])
def test_derivative_of_the_exponential(size):
    """Complex input passes the series near zero and the closed form alike."""
    rng = np.random.default_rng(1)
    theta, direction = size * unit(rng)[None], rng.standard_normal((1, 3))
    found = rotation_matrix(exp_quaternion(theta + 1j * EPS * direction)).imag / EPS
    h = 1e-6
    ends = [rotation_matrix(exp_quaternion(theta + s * h * direction)) for s in (1, -1)]
    assert abs(found - (ends[0] - ends[1]) / (2 * h)).max() < 1e-9
