"""Beams: their scikit-fem forms, mass, sections of networks, nodes, initial fields."""

from __future__ import annotations

import numpy as np
import pytest
import skfem
from helpers_scenes import full_section, rotation
from scipy.sparse import csr_matrix

from skfem_cosserat import (
    Beam,
    LoadLine,
    MeshCurve,
    Model,
    Multipliers,
    NullSpace,
    Section,
    State,
    Variational,
)
from skfem_cosserat.constraints.base import group_pairs
from skfem_cosserat.kernels import beam_tangent, null_space_blocks
from skfem_cosserat.pattern import FrozenPattern

ORDERS = [1, 2, 3, 4]


def tee(order=1, **options):
    """An arc with a straight leg: two sections, a relative rotation at their node."""
    arc = MeshCurve.init_arc((0, 0, 0), (1, 0, 0), (0, 1, 0), 2.0, 1.0, 3, "arc")
    root = arc.p[:, arc.node(1)]
    leg = MeshCurve.init_line(root, root + np.array([0, 0, 1.5]), 2, "leg")
    slim = Section([30, 35, 60, 4, 5, 3], mass=0.8, inertia=(0.02, 0.05))
    return Beam(
        arc.joined(leg), {"arc": full_section(), "leg": slim}, order=order, twist=0.3, **options
    )


def disturbed(beam, seed=0):
    return beam.reference + 0.2 * np.random.default_rng(seed).standard_normal(len(beam.reference))


# ----------------------------------------------------------------------- scikit-fem forms
@pytest.mark.one_quick
@pytest.mark.parametrize("order", ORDERS)
def test_tangent_form_is_the_derivative_of_the_force_form(order):
    beam = tee(order)
    q = disturbed(beam)
    K = beam.tangent_form().assemble(beam.basis, q=q).toarray()
    wanted = np.empty_like(K)
    for k in range(len(q)):
        z = q.astype(complex)
        z[k] += 1e-40j
        wanted[:, k] = skfem.asm(beam.internal_force_form(), beam.basis, q=z).imag / 1e-40
    assert abs(K - wanted).max() < 1e-10 * abs(K).max()


@pytest.mark.parametrize("orders", [(1, 1), (2, 1), (3, 4)])
def test_forms_are_the_matrices_used_for_stepping(orders):
    """Two beams in one scene, through the groups and the frozen pattern, against each form."""
    model = Model()
    beams = [model.add(f"beam {k}", tee(p)) for k, p in enumerate(orders)]
    system = model.freeze()
    q = np.concatenate([disturbed(b, k) for k, b in enumerate(beams)])
    y = system.extend(q, 0.0)
    i, j = group_pairs(system, [g.dofs for g in system.groups])
    pattern = FrozenPattern(i, j, (system.n, system.n))
    blocks, stresses, Bs = [], [], []
    for group, (eps, B) in zip(system.beam_groups, system.strain(y), strict=True):
        S = group.stress(eps)
        blocks.append(beam_tangent(group.elements, B, B, S, 1.0, 1.0).ravel())
        stresses.append(S)
        Bs.append(B)
    K = pattern.matrix(np.concatenate(blocks)).toarray()
    M = pattern.matrix(np.concatenate([g.mass.ravel() for g in system.groups])).toarray()
    f = system.internal_force(Bs, stresses).ravel()
    start = 0
    for beam in beams:
        own = slice(start, start + beam.basis.N)
        start = own.stop
        tangent = skfem.asm(beam.tangent_form(), beam.basis, q=q[own]).toarray()
        mass = skfem.asm(beam.mass_form(), beam.basis).toarray()
        force = skfem.asm(beam.internal_force_form(), beam.basis, q=q[own])
        assert abs(K[own, own] - tangent).max() < 1e-13 * abs(tangent).max()
        assert abs(M[own, own] - mass).max() < 1e-13 * abs(mass).max()
        assert abs(f[own] - force).max() < 1e-13 * abs(force).max()
        K[own, own] = 0
        full = np.kron(system.mass.toarray(), np.eye(3))
        assert abs(full[own, own] - mass).max() < 1e-13 * abs(mass).max()
    assert start == system.n
    assert abs(K).max() == 0  # beams do not couple


def test_iteration_matrix_is_made_of_the_forms():
    """Variational: M/h + (h/4) K(q_mid) in the block of a step's matrix."""
    beam = tee(2)
    model = Model()
    model.add("tee", beam)
    system = model.freeze()
    h = 0.01
    rng = np.random.default_rng(0)
    bound = Multipliers().bind(system, 0.0)
    balance = Variational().balance(system, h)
    step = balance.begin(State(0.0, 0, system.q0, np.zeros(system.n)))
    bound.begin(step.y0, system.ground(h), h)
    bound.guess(False)
    q, multiplier = bound.sought
    bound.sought = q + 0.1 * rng.standard_normal(system.n), multiplier
    y1 = bound.configure()
    evaluation = balance.evaluate(step, y1)
    bound.reduce(evaluation.R, y1)
    data = bound.matrix(balance.tangent(step, evaluation), evaluation.R, y1)
    matrix = bound.solver.pattern.assembled(data).toarray()[: system.n, : system.n]
    mid = 0.5 * (system.q0 + y1[: system.rows].ravel())
    K = beam.tangent_form().assemble(beam.basis, q=mid)
    M = beam.mass_form().assemble(beam.basis)
    assert abs(matrix - (M / h + h / 4 * K).toarray()).max() < 1e-12 * abs(matrix).max()


@pytest.mark.parametrize("order", [1, 3])
def test_forms_add_to_a_users_own(order):
    """COOData of ours and of a form written with scikit-fem: an elastic foundation."""
    beam = tee(order)
    x, w = beam.basis.scalar().quadrature
    full = skfem.Basis(beam.mesh, beam.basis.elem, quadrature=(x, w))
    foundation = skfem.BilinearForm(lambda u, v, w: 7.0 * (u[0] * v[0] + u[1] * v[1] + u[2] * v[2]))
    q = disturbed(beam)
    K = beam.tangent_form()
    total = (K.elemental(beam.basis, q=q) + foundation.elemental(full)).tocsr()
    apart = K.assemble(beam.basis, q=q) + foundation.assemble(full)
    assert abs((total - apart).toarray()).max() < 1e-11
    assert abs(total - K.assemble(beam.basis, q=q)).max() > 0.1


def test_a_small_static_problem_with_scikit_fem_alone():
    """Linear cantilever: condense and solve, against P l^3/(3 EI) + P l/GA."""
    mesh = MeshCurve.init_line((0, 0, 0), (0, 0, 2), 8, nodes={"root": 0, "tip": 1})
    section = Section([1e4, 2e4, 5e4, 300, 400, 100], mass=1.0, inertia=(0, 0))
    beam = Beam(mesh, section, order=2, director=(1, 0, 0))
    N = beam.basis.n_nodes
    K = beam.tangent_form().assemble(beam.basis, q=beam.reference)
    f = np.zeros(12 * N)
    tip, root = beam.node("tip").vertex, beam.node("root").vertex
    f[12 * tip + 1] = 1e-3  # along y = d2: bends about d1
    # directors move with the rotation: delta d_i = omega x d_i
    P = np.zeros((12 * N, 6 * N))
    for k, block in enumerate(null_space_blocks(beam.triads)):
        P[12 * k : 12 * k + 12, 6 * k : 6 * k + 6] = block
    held = np.arange(6 * root, 6 * root + 6)
    u = skfem.solve(*skfem.condense(csr_matrix(P.T @ K @ P), P.T @ f, D=held))
    wanted = 1e-3 * (8 / (3 * 300) + 2 / 2e4)
    assert u[6 * tip + 1] == pytest.approx(wanted, rel=1e-10)
    assert u[6 * tip + 3] == pytest.approx(-1e-3 * 4 / (2 * 300), rel=1e-10)


# ----------------------------------------------------------------------- mass
@pytest.mark.parametrize("order", ORDERS)
def test_total_mass_and_inertia(order):
    """Rigid velocity of a straight beam: exact mass, moment of inertia and momentum."""
    length, rho, I1, I2 = 2.0, 1.3, 0.11, 0.07
    mesh = MeshCurve.init_line((0, 0, 0), (0, 0, length), 3)
    section = Section(np.ones(6), mass=rho, inertia=(I1, I2))
    beam = Beam(mesh, section, order=order, director=(1, 0, 0))
    M = beam.mass_form().assemble(beam.basis).toarray()
    assert abs(M - M.T).max() == 0
    omega, shift = np.array([0.3, -0.7, 1.1]), np.array([1.0, 2.0, -1.0])
    q = beam.reference.reshape(-1, 4, 3)
    v = np.cross(omega, q)
    v[:, 0] += shift
    energy = 0.5 * v.ravel() @ M @ v.ravel()
    centre = np.array([0, 0, length / 2])
    transverse = rho * length**3 / 12
    # section inertia along d1 = x counts for turning about y and z, and so on
    J = np.array([transverse + I2 * length, transverse + I1 * length, (I1 + I2) * length])
    vc = shift + np.cross(omega, centre)
    assert energy == pytest.approx(0.5 * rho * length * vc @ vc + 0.5 * J @ omega**2, rel=1e-13)
    p = (M @ v.ravel()).reshape(-1, 4, 3)
    assert p[:, 0].sum(0) == pytest.approx(rho * length * vc, rel=1e-13)
    spin = np.cross(q, p).sum((0, 1))
    assert spin == pytest.approx(J * omega + np.cross(centre, rho * length * vc), rel=1e-12)
    assert (p[:, 3] == 0).all()  # no kinetic energy in d3


@pytest.mark.parametrize("order", ORDERS)
def test_mass_of_a_network_turns_with_its_sections(order):
    """Inertia belongs to the section's directors, not to those of the node it shares."""
    beam = tee(order)
    M = beam.mass_form().assemble(beam.basis).toarray()
    rng = np.random.default_rng(1)
    v = rng.standard_normal((beam.basis.n_nodes, 4, 3))
    basis = beam.basis
    x, w = np.polynomial.legendre.leggauss(8)
    N = basis.shape((x + 1) / 2)
    energy = 0.0
    for e, nodes in enumerate(basis.connectivity):
        section = list(beam.sections.values())[beam.section_id[e]]
        own = beam.rotations[e] @ v[nodes][:, 1:]  # rates of the section's directors
        ds = basis.lengths[e] * w / 2
        for g in range(len(x)):
            phi = N[:, g] @ v[nodes, 0]
            d1, d2 = (N[:, g] @ own[:, k] for k in (0, 1))
            density = section.mass * phi @ phi + section.inertia @ [d1 @ d1, d2 @ d2]
            energy += 0.5 * ds[g] * density
    assert 0.5 * v.ravel() @ M @ v.ravel() == pytest.approx(energy, rel=1e-12)
    assert (beam.rotations != np.eye(3)).any()


# ----------------------------------------------------------------------- construction
def test_sections_by_part():
    beam = tee()
    assert [list(beam.sections)[k] for k in beam.section_id] == ["arc"] * 3 + ["leg"] * 2


@pytest.mark.parametrize("order", ORDERS)
def test_reference_is_orthonormal_along_the_line(order):
    beam = tee(order)
    q = beam.reference.reshape(-1, 4, 3)
    D = q[:, 1:]
    assert abs(D @ D.swapaxes(1, 2) - np.eye(3)).max() < 1e-14
    assert np.linalg.det(D) == pytest.approx(1)
    sections = beam.rotations @ beam.triads[beam.basis.connectivity]
    tangents = sections[:, :, 2]
    chord = np.diff(q[beam.basis.connectivity][:, [0, -1], 0], axis=1)[:, 0]
    along = np.einsum("ei,eai->ea", chord, tangents) / np.linalg.norm(chord, axis=1)[:, None]
    assert (along > np.cos(0.2)).all()  # an element of the arc turns by 1/3 rad


def test_places_of_nodes():
    beam = tee(2)
    by_name, by_position = beam.node("leg.end"), beam.node(beam.node("leg.end").position)
    assert by_name.vertex == by_position.vertex
    assert by_name.item is beam
    assert by_name.triad == pytest.approx(beam.triads[by_name.vertex])
    assert by_name.offset.tolist() == [0, 0, 0]


def test_initial_velocities():
    rng = np.random.default_rng(0)
    omega = rng.standard_normal(3)
    beam = tee(2, velocity=lambda x: np.cross(omega, x), angular_velocity=omega)
    model = Model()
    model.add("tee", beam)
    system = model.freeze()
    v = system.v0.reshape(-1, 3)
    assert v == pytest.approx(np.cross(omega, beam.reference.reshape(-1, 3)), abs=1e-14)
    constant = tee(1, velocity=(1, 2, 3))
    assert (constant.velocity == (1, 2, 3)).all()


@pytest.mark.parametrize("treatment", [NullSpace(), Multipliers()], ids=lambda t: t.name)
def test_resultants_of_line_loads(treatment):
    """Weights add up to the length; of one part only where a part is named."""
    for part, length in ((None, 3.5), ("arc", 2.0), ("leg", 1.5)):
        model = Model()
        beam = model.add("tee", tee(3))
        model.add("wind", LoadLine(beam, (1.0, 2.0, 3.0), part=part))
        system = model.freeze()
        f = system.loading.dead_force(np.ones(1))[system.origin_rows]
        assert f.sum(0) == pytest.approx(length * np.array([1.0, 2, 3]), rel=1e-12)
        assert treatment.bind(system, 0.0).unknowns > 0


def test_turned_scene_has_the_same_matrices():
    """A rotation of the mesh turns every block of the tangent."""
    R = rotation(np.random.default_rng(4))
    mesh = MeshCurve.init_helix((1, 0, 0), (0, 0, 0), (0, 0, 1), 0.5, 0.4, 3)
    plain = Beam(mesh, full_section(), order=2, director=(0, 0, 1))
    moved = Beam(mesh.moved(R), full_section(), order=2, director=R[:, 2])
    K = [b.tangent_form().assemble(b.basis, q=b.reference).toarray() for b in (plain, moved)]
    turn = np.kron(np.eye(len(K[0]) // 3), R)
    assert abs(turn @ K[0] @ turn.T - K[1]).max() < 1e-12 * abs(K[0]).max()
