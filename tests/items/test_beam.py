"""Beams: scikit-fem forms, mass on and off the reference line, networks, nodes.

Forms beside a user's own are assembled and solved in examples/skfem_alone.py.
"""

from __future__ import annotations

import numpy as np
import pytest
import skfem
from helpers_kernels import assert_same, both
from helpers_scenes import FULL, full_section, pairs
from helpers_schemes import TREATMENTS, integrators, treatments
from rounding import momentum_limits

import skfem_cosserat as sc
from skfem_cosserat import diagnostics

ORDERS = [1, 2, 3, 4]


def tee(order=1, **options):
    """An arc with a straight leg: two sections, a relative rotation at their node."""
    arc = sc.MeshCurve.init_arc((0, 0, 0), (1, 0, 0), (0, 1, 0), 2.0, 1.0, 3, "arc")
    root = arc.p[:, arc.node(1)]
    leg = sc.MeshCurve.init_line(root, root + np.array([0, 0, 1.5]), 2, "leg")
    slim = sc.Section([30, 35, 60, 4, 5, 3], mass=0.8, inertia=(0.02, 0.05))
    return sc.Beam(
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


# ----------------------------------------------------------------------- mass
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


def test_initial_velocities():
    rng = np.random.default_rng(0)
    omega = rng.standard_normal(3)
    beam = tee(2, velocity=lambda x: np.cross(omega, x), angular_velocity=omega)
    model = sc.Model()
    model.add("tee", beam)
    system = model.freeze()
    v = system.v0.reshape(-1, 3)
    assert v == pytest.approx(np.cross(omega, beam.reference.reshape(-1, 3)), abs=1e-14)
    constant = tee(1, velocity=(1, 2, 3))
    assert (constant.velocity == (1, 2, 3)).all()


def test_resultants_of_line_loads():
    """Weights add up to the length; of one part only where a part is named."""
    for part, length in ((None, 3.5), ("arc", 2.0), ("leg", 1.5)):
        model = sc.Model()
        beam = model.add("tee", tee(3))
        model.add("wind", sc.LoadLine(beam, (1.0, 2.0, 3.0), part=part))
        system = model.freeze()
        f = system.loading.dead_force(np.ones(1))[system.origin_rows]
        assert f.sum(0) == pytest.approx(length * np.array([1.0, 2, 3]), rel=1e-12)


# ----------------------------------------------------------------------- mass off the line
MASS, CENTRE = 1.3, np.array([0.12, -0.2])
OWN = np.array([[0.11, 0.03], [0.03, 0.07]])
INERTIA = OWN + MASS * np.outer(CENTRE, CENTRE)
G = np.array([0.5, -0.3, -9.81])


def offset_section(stiffness=FULL):
    return sc.Section(stiffness, mass=MASS, inertia=INERTIA, centre=CENTRE)


def straight(section, order=2, length=1.5, **options):
    """A beam along d3, from the origin."""
    mesh = sc.MeshCurve.init_line((0, 0, 0), (0.6 * length, 0, 0.8 * length), 2, "rod")
    return sc.Beam(mesh, section, order=order, director=(0, 1, 0), **options)


def equivalent(beam, length=1.5, **options):
    """The rigid body that has the same distribution of mass, its reference point at the start."""
    m = MASS * length
    along = np.array([*CENTRE, length / 2])
    euler = np.zeros((3, 3))
    euler[:2, :2] = INERTIA * length
    euler[2, :2] = euler[:2, 2] = m * CENTRE * length / 2
    euler[2, 2] = m * length**2 / 3
    euler -= m * np.outer(along, along)
    return sc.RigidBody(m, euler=euler, center=along, triad=beam.triads[0], **options)


@pytest.mark.parametrize("order", ORDERS)
def test_rigid_motions_have_the_momenta_of_the_rigid_body(order):
    beam = straight(offset_section(), order)
    M = beam.mass_form().assemble(beam.basis).toarray()
    assert abs(M - M.T).max() == 0
    body = np.kron(equivalent(beam).scalar_mass(), np.eye(3))
    frame = np.concatenate([np.zeros((1, 3)), beam.triads[0]])
    q = beam.reference.reshape(-1, 4, 3)
    rng = np.random.default_rng(1)
    for _ in range(3):
        omega, shift = rng.standard_normal((2, 3))
        v, w = np.cross(omega, q), np.cross(omega, frame)
        v[:, 0] += shift
        w[0] += shift
        p, r = (M @ v.ravel()).reshape(-1, 4, 3), (body @ w.ravel()).reshape(4, 3)
        assert v.ravel() @ p.ravel() == pytest.approx(w.ravel() @ r.ravel(), rel=1e-13)
        assert p[:, 0].sum(0) == pytest.approx(r[0], rel=1e-12)
        assert np.cross(q, p).sum((0, 1)) == pytest.approx(np.cross(frame, r).sum(0), rel=1e-12)


def free_beam(scale=(1.0, 1.0, 1.0)):
    """Curved free beam of three elements in fast motion; units of `scale` m, kg, s."""
    L, m, t = scale
    units = np.sqrt(m / t**2 * np.array([L, L, L, L**3, L**3, L**3]))
    stiffness = FULL * np.outer(units, units)
    section = sc.Section(stiffness, MASS * m / L, INERTIA * m * L, centre=CENTRE * L)
    ends = (0.3 * L, 0, 0), (1, 0, 0), (0, 1, 0.3)
    mesh = sc.MeshCurve.init_arc(*ends, 1.5 * L, 1.5, 3, "arc")
    v, omega = np.random.default_rng(3).standard_normal((2, 7, 3))
    motion = {"velocity": v * L / t, "angular_velocity": omega / t}
    model = sc.Model()
    model.add("beam", sc.Beam(mesh, section, order=2, twist=0.4 / L, **motion))
    return model.freeze()


def run(system, integrator, treatment, step=0.01, until=0.4):
    return sc.simulate(system, integrator, treatment, step, until, kernels="numpy")


@pytest.mark.one_quick
@integrators
@treatments
def test_free_flight_keeps_momenta_and_energy(integrator, treatment):
    system = free_beam()
    history = run(system, integrator, treatment)
    linear, angular = momentum_limits(system, history)
    for p in ("p", "Qp"):
        L = diagnostics.angular_momentum(system, history["q"], history[p])
        P = diagnostics.linear_momentum(system, history[p])
        assert abs(L - L[0]).max() < angular < 1e-9 * np.linalg.norm(L[0])
        assert abs(P - P[0]).max() < linear < 1e-9 * np.linalg.norm(P[0])
    energy = history["energy"]
    if integrator.name == "energy-momentum":
        assert abs(energy - energy[0]).max() < 1e-12 * energy[0]
    else:
        assert 1e-6 < abs(energy - energy[0]).max() / energy[0] < 0.05


@pytest.mark.slow
def test_both_treatments_and_all_units_give_the_same_motion():
    plain = run(free_beam(), sc.EnergyMomentum(), TREATMENTS[0])["q"].reshape(41, -1, 4, 3)
    other = run(free_beam(), sc.EnergyMomentum(), TREATMENTS[1])["q"].reshape(41, -1, 4, 3)
    assert abs(plain - other).max() < 1e-11
    L, m, t = 1e3, 1e-2, 1e3  # mm, 100 kg, ms
    scaled = run(free_beam((L, m, t)), sc.EnergyMomentum(), TREATMENTS[0], 0.01 * t, 0.4 * t)["q"]
    scaled = scaled.reshape(41, -1, 4, 3).copy()
    scaled[:, :, 0] /= L
    assert abs(plain - scaled).max() < 1e-11


def cantilever(load, EI=2e4, GJ=3e3, GA=5e6, length=2.0):
    """Along x, d1 along y, d2 along z: gravity at the centre of mass bends and twists it."""
    section = sc.Section.from_constants(
        EA=1e7, GA=GA, EI=(EI, 3 * EI), GJ=GJ, mass=MASS, inertia=INERTIA, centre=CENTRE
    )
    mesh = sc.MeshCurve.init_line((0, 0, 0), (length, 0, 0), 2, "rod")
    model = sc.Model()
    beam = model.add("rod", sc.Beam(mesh, section, order=4, director=(0, 1, 0)))
    model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), beam.node("rod.start")))
    model.add("load", load(beam))
    path = sc.static(model, control=sc.LoadControl(until=1.0, steps=1))
    return model, beam, path["q"][-1]


def test_gravity_at_an_offset_centre_bends_and_twists():
    """w = m g L^4/(8 EI) + m g L^2/(2 GA), twist = m g c_1 L^2/(2 GJ); a line load bends only."""
    EI, GJ, GA, L, g = 2e4, 3e3, 5e6, 2.0, 1e-3
    _, beam, q = cantilever(lambda beam: sc.LoadGravity((0, 0, -g)))
    q = q.reshape(-1, 4, 3)
    tip = beam.node("rod.end").vertex
    w = -MASS * g * (L**4 / (8 * EI) + L**2 / (2 * GA))
    assert q[tip, 0, 2] == pytest.approx(w, rel=1e-6)
    twist = np.arctan2(q[tip, 1, 2], q[tip, 1, 1])  # about d3 = x: d1 from y towards z
    assert twist == pytest.approx(-MASS * g * CENTRE[0] * L**2 / (2 * GJ), rel=1e-6)
    q = cantilever(lambda beam: sc.LoadLine(beam, (0, 0, -MASS * g)))[2].reshape(-1, 4, 3)
    assert q[tip, 0, 2] == pytest.approx(w, rel=1e-6)
    assert abs(q[tip, 1, 2]) < 1e-6 * abs(twist)


def test_nodal_resultants_have_the_moment_of_gravity():
    """Torsion at the clamp is the weight times its arm; the free end carries nothing."""
    g, L = 1e-3, 2.0
    model, beam, q = cantilever(lambda beam: sc.LoadGravity((0, 0, -g)))
    found = diagnostics.nodal_resultants(model.freeze(), beam, q)
    assert found[0, 0, 5] == pytest.approx(-MASS * g * CENTRE[0] * L, rel=1e-6)
    assert abs(found[-1, -1]).max() < 2e-7  # rounding of strains times EA = 1e7


def coupled_frequencies(k, GA, EI, GJ, inertia, c1):
    """u_2, psi_1, theta of a sine wave: transverse motion coupled to torsion by the offset."""
    K = np.array([[GA * k**2, GA * k, 0], [GA * k, GA + EI * k**2, 0], [0, 0, GJ * k**2]])
    M = np.array(
        [
            [MASS, 0, MASS * c1],
            [0, inertia[1, 1], 0],
            [MASS * c1, 0, inertia[0, 0] + inertia[1, 1]],
        ]
    )
    return np.sqrt(np.linalg.eigvals(np.linalg.solve(M, K)).real)


def test_frequencies_of_coupled_bending_and_torsion():
    """A beam on forks at both ends: u_2, theta ~ sin, psi_1 ~ cos solve all equations exactly."""
    L, GA, EI, GJ, c1 = 2.0, 4e4, 300.0, 120.0, 0.15
    inertia = np.diag([0.02, 0.01]) + MASS * np.diag([c1**2, 0])
    section = sc.Section.from_constants(
        EA=1e7, GA=GA, EI=(EI, 1e6), GJ=GJ, mass=MASS, inertia=inertia, centre=(c1, 0)
    )
    mesh = sc.MeshCurve.init_line((0, 0, 0), (0, 0, L), 12, "rod")
    model = sc.Model()
    beam = model.add("rod", sc.Beam(mesh, section, order=4, director=(1, 0, 0)))
    for end, z in (("start", 0), ("end", L)):
        fork = sc.JointRevolute(sc.ground((0, 0, z)), beam.node(f"rod.{end}"), axis=(1, 0, 0))
        model.add(end, fork)
    found = sc.modes(model, count=6).frequencies * 2 * np.pi
    data = GA, EI, GJ, inertia, c1
    wanted = np.sort(np.concatenate([coupled_frequencies(n * np.pi / L, *data) for n in (1, 2, 3)]))
    apart = coupled_frequencies(np.pi / L, GA, EI, GJ, inertia, 0.0)
    assert abs(np.min(abs(apart - wanted[0]))) > 0.02 * wanted[0]  # the coupling matters
    assert found[:4] == pytest.approx(wanted[:4], rel=1e-8)


@pytest.mark.slow
@pairs
def test_kernels_agree(integrator, treatment):
    system = free_beam()
    assert system.beam_groups[0].scalar_mass[:, 0, 1].any()
    assert_same(*both(system, integrator, treatment, 0.01, 0.1))


@pytest.mark.parametrize(
    ("inertia", "centre", "words"),
    [
        ((0.1, 0.1), (0.3, 0), r"about the centre of mass at \[0.3, 0.0\]"),
        ([[1, 2], [2, 1]], (0, 0), "eigenvalue -1"),
        ([[1, 0.1], [0.2, 1]], (0, 0), "inertia is not symmetric by 0.1"),
        ((1, 1, 1), (0, 0), r"shape \(3,\), expected \(2,\) or \(2, 2\)"),
        ((1, 1), (0, np.nan), "centre is not finite"),
    ],
)
def test_impossible_mass_is_named(inertia, centre, words):
    with pytest.raises(sc.InputError, match=words):
        sc.Section(np.ones(6), 2.0, inertia, centre=centre)


def test_a_thin_offset_mass_is_possible():
    """All mass in one line off the reference line: zero about its own centre, to rounding."""
    c = np.array([0.1, 0.7])
    section = sc.Section(np.ones(6), 3.0, 3.0 * np.outer(c, c), centre=c)
    assert np.linalg.matrix_rank(section.density) == 1
    assert section.damped(0.1).density.tolist() == section.density.tolist()
