"""Strains, internal forces and tangents of single elements and networks."""

from __future__ import annotations

import numpy as np
import pytest
from helpers_scenes import FULL, full_section, rotation, unit
from scipy.linalg import block_diag
from scipy.spatial.transform import Rotation

from skfem_cosserat import Beam, MeshCurve, Section
from skfem_cosserat.basis import gauss_rule
from skfem_cosserat.element import shape_derivatives, shape_functions
from skfem_cosserat.kernels import (
    beam_force,
    beam_strain,
    beam_stress,
    beam_tangent,
    exp_quaternion,
    null_space_blocks,
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
@pytest.mark.parametrize("order", ORDERS)
def test_rigid_motion_leaves_the_strains(order):
    """So the energy is objective, and internal forces are in balance."""
    beam = network(order)
    assert beam.elements.rotations is not None  # relative rotations take part
    rng = np.random.default_rng(order)
    q = deformed(beam, order)
    before = strains(beam, q)
    moved = q @ rotation(rng, 2.0).T
    moved[:, 0] += 3 * rng.standard_normal(3)
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


# ----------------------------------------------------------------------- known states


def straight(order=1, elements=1):
    """Beam of length 2 along z with d1 along x, and its reference directors (N, 4, 3)."""
    mesh = MeshCurve.init_line((0, 0, 0), (0, 0, 2.0), elements)
    section = Section(np.ones(6), mass=1.0, inertia=(1.0, 1.0))
    beam = Beam(mesh, section, order=order, director=(1, 0, 0))
    return beam, beam.reference.reshape(-1, 4, 3).copy()


def turned(theta):
    """Rotation matrix of a rotation vector."""
    return rotation_matrix(exp_quaternion(np.array([theta], dtype=float)))[0]


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("theta", [0.3, -0.8, 2.5])
def test_linear_element_bent_or_twisted_between_its_nodes(axis, theta):
    """K = sin(theta)/l about the axis of the relative rotation, positive like omega . d_i."""
    beam, q = straight()
    # half the turn at each end: the axis keeps its direction in both triads
    for node, sign in ((0, -0.5), (1, 0.5)):
        q[node, 1:] = q[node, 1:] @ turned(sign * theta * np.eye(3)[axis]).T
    wanted = np.sin(theta) / 2.0 * np.eye(3)[axis]
    assert strains(beam, q)[0, 0, 3:] == pytest.approx(wanted, abs=1e-15)


def test_axial_stretch_and_shear():
    beam, q = straight()
    q[:, 0, 2] *= 1.01
    q[1, 0, :2] = (0.1, -0.06)  # sheared along x = d1 and y = d2
    wanted = [0.05, -0.03, 0.01, 0, 0, 0]
    assert strains(beam, q)[0, 0] == pytest.approx(wanted, abs=1e-15)


def test_stretch_turns_with_the_beam():
    """Components are taken along the directors, not along space axes."""
    beam, q = straight()
    R = turned((0.3, -1.0, 2.0))
    q = q @ R.T
    q[1, 0] += 0.02 * R[:, 2] + 0.04 * R[:, 0]
    assert strains(beam, q)[0, 0] == pytest.approx([0.02, 0, 0.01, 0, 0, 0], abs=1e-14)


@pytest.mark.parametrize("order", ORDERS)
def test_strain_table_is_the_definition(order):
    """Gamma_i = d_i . phi', K_1 = (d3.d2' - d2.d3')/2 and cyclic, for any twelve fields."""
    points, _ = gauss_rule(order)
    N, dN = shape_functions(order, points), shape_derivatives(order, points)
    table = strain_table(N, dN)
    assert abs(table - table.swapaxes(-1, -2)).max() == 0
    q = np.random.default_rng(order).standard_normal((order + 1, 4, 3))
    field, rate = (np.einsum("ag,aik->gik", f, q) for f in (N, dN))
    d, dd = field[:, 1:], rate[:, 1:]
    products = np.einsum("gik,gjk->gij", d, dd)  # d_i . d_j'
    wanted = np.einsum("gik,gk->gi", d, rate[:, 0])
    cyclic = ((2, 1), (0, 2), (1, 0))
    curvatures = [(products[:, i, j] - products[:, j, i]) / 2 for i, j in cyclic]
    wanted = np.column_stack([wanted, *curvatures])
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


@pytest.mark.parametrize("order", ORDERS)
def test_b_is_the_derivative_of_the_strains(order):
    beam = network(order)
    x = beam.gather(deformed(beam, order).ravel())
    _, B = beam_strain(beam.elements, x)
    wanted = columns(lambda z: beam_strain(beam.elements, z)[0].reshape(len(z), -1), x)
    assert abs(B - wanted).max() < 1e-13 * abs(B).max()


@pytest.mark.parametrize("order", ORDERS)
def test_force_is_the_derivative_of_the_energy(order):
    """And the tangent that of the force."""
    beam = network(order)
    elements = beam.elements
    x = beam.gather(deformed(beam, order).ravel())

    def energy(z):
        eps = beam_strain(elements, z)[0]
        W = 0.5 * np.einsum("egi,ij,egj->eg", eps, FULL, eps)
        return (W @ elements.weights) * elements.lengths

    def force(z):
        eps, B = beam_strain(elements, z)
        return beam_force(elements, B, beam_stress(elements, eps))

    f = force(x)
    assert abs(f - columns(energy, x)).max() < 1e-12 * abs(f).max()
    eps, B = beam_strain(elements, x)
    K = beam_tangent(elements, B, B, beam_stress(elements, eps), 1.0, 1.0)
    assert abs(K - columns(force, x)).max() < 1e-10 * abs(K).max()
    assert abs(K - K.swapaxes(1, 2)).max() < 1e-13 * abs(K).max()


@pytest.mark.parametrize("order", ORDERS)
def test_number_of_zero_energy_modes(order):
    """p Gauss points: no spurious mode among orthonormal states beside the six rigid ones."""
    beam, _ = straight(order, 4)
    K = beam.tangent_form().assemble(beam.basis, q=beam.reference).toarray()
    P = block_diag(*null_space_blocks(beam.triads))
    values = np.linalg.eigvalsh(P.T @ K @ P)
    assert (abs(values) < 1e-12 * values[-1]).sum() == 6
    assert values[6] > 1e-5 * values[-1]


# ----------------------------------------------------------------------- rotations
def test_quaternions_are_rotations():
    rng = np.random.default_rng(0)
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
