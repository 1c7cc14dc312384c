"""Sections whose centre of mass is off the reference line, with products of inertia."""

from __future__ import annotations

import numpy as np
import pytest
from helpers_kernels import assert_same, both
from helpers_scenes import FULL
from rounding import momentum_limits

import skfem_cosserat as sc
from skfem_cosserat import diagnostics

INTEGRATORS = {"variational": sc.Variational(), "energy-momentum": sc.EnergyMomentum()}
TREATMENTS = {"null space": sc.NullSpace(), "multipliers": sc.Multipliers()}
integrators = pytest.mark.parametrize("integrator", INTEGRATORS)
treatments = pytest.mark.parametrize("treatment", TREATMENTS)

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


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_rigid_motions_have_the_momenta_of_the_rigid_body(order):
    beam = straight(offset_section(), order)
    M = beam.mass_form().assemble(beam.basis).toarray()
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


def stiff_and_rigid(integrator, held, step):
    """Largest difference of the first frames of a stiff beam and of its rigid body."""
    omega, v = np.array([0.4, -0.9, 0.7]), np.zeros(3) if held else np.array([0.3, 0.2, 1.0])
    stiff = offset_section(1e10 * np.eye(6))
    beam = straight(stiff, 1, velocity=lambda x: v + np.cross(omega, x), angular_velocity=omega)
    body = equivalent(beam, velocity=v, angular_velocity=omega)
    found = []
    for item in (beam, body):
        model = sc.Model()
        model.add("item", item)
        if held:
            place = beam.node("rod.start") if item is beam else body.local((0, 0, 0))
            model.add("hook", sc.JointSpherical(sc.ground((0, 0, 0)), place))
        model.add("gravity", sc.LoadGravity(G))
        history = sc.simulate(
            model.freeze(), INTEGRATORS[integrator], sc.NullSpace(), step, 0.4,
            kernels="numpy", derive=False,
        )  # fmt: skip
        found.append(history["q"][:, :12])
    assert abs(found[0][-1] - found[0][0]).max() > 0.2
    return abs(found[0] - found[1]).max()


@pytest.mark.slow
@pytest.mark.parametrize("held", [False, True])
def test_stiff_beam_moves_like_the_rigid_body(held):
    """Free flight and a pendulum at a stiffness of 1e10."""
    assert stiff_and_rigid("energy-momentum", held, 0.01) < 1e-8


# the stiffest beams are not resolved
@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")
@pytest.mark.parametrize("held", [False, True])
def test_variational_stiff_beam_tends_to_the_rigid_body(held):
    """Midpoints of a turning beam are strained by O(h^2), which stiffness makes good at nodes."""
    coarse, fine = (stiff_and_rigid("variational", held, h) for h in (0.01, 0.005))
    assert 3.8 < coarse / fine < 4.2
    assert fine < 5e-5


def free_beam(scale=(1.0, 1.0, 1.0)):
    """Curved free beam of three elements in fast motion; units of `scale` m, kg, s."""
    L, m, t = scale
    F = m * L / t**2
    units = np.sqrt(np.array([F, F, F, F * L**2, F * L**2, F * L**2]))
    section = sc.Section(
        FULL * np.outer(units, units), MASS * m / L, INERTIA * m * L, centre=CENTRE * L
    )
    x = np.array([[0.3, 0, 0], [1, 0, 0], [0, 1, 0.3]])
    mesh = sc.MeshCurve.init_arc(x[0] * L, x[1], x[2], 1.5 * L, 1.5, 3, "arc")
    rng = np.random.default_rng(3)
    v, omega = rng.standard_normal((2, 7, 3))
    model = sc.Model()
    model.add(
        "beam",
        sc.Beam(
            mesh, section, order=2, twist=0.4 / L, velocity=v * L / t, angular_velocity=omega / t
        ),
    )
    return model.freeze()


def run(system, integrator, treatment, step=0.01, until=0.4):
    return sc.simulate(
        system, INTEGRATORS[integrator], TREATMENTS[treatment], step, until, kernels="numpy"
    )


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
    if integrator == "energy-momentum":
        assert abs(energy - energy[0]).max() < 1e-12 * energy[0]
    else:
        assert 1e-6 < abs(energy - energy[0]).max() / energy[0] < 0.05


@pytest.mark.slow
def test_both_treatments_and_all_units_give_the_same_motion():
    plain = run(free_beam(), "energy-momentum", "null space")["q"].reshape(41, -1, 4, 3)
    other = run(free_beam(), "energy-momentum", "multipliers")["q"].reshape(41, -1, 4, 3)
    assert abs(plain - other).max() < 1e-11
    L, m, t = 1e3, 1e-2, 1e3  # mm, 100 kg, ms
    scaled = run(free_beam((L, m, t)), "energy-momentum", "null space", 0.01 * t, 0.4 * t)["q"]
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


def test_highest_frequency_and_history_energy_know_the_offset():
    """Energies of a rigid velocity: that of v and that of p agree."""
    system = free_beam()
    rng = np.random.default_rng(2)
    v = rng.standard_normal(system.n)
    p = diagnostics.momentum(system, v)
    energy = diagnostics.kinetic_energy_of_velocity(system, v)
    keep = np.repeat(system.mass.diagonal() > 0, 3)
    assert diagnostics.kinetic_energy(system, p) == pytest.approx(energy, rel=1e-12)
    assert p[~keep].tolist() == [0] * int((~keep).sum())


@pytest.mark.slow
@integrators
@treatments
def test_kernels_agree(integrator, treatment):
    system = free_beam()
    assert system.beam_groups[0].scalar_mass[:, 0, 1].any()
    assert_same(*both(system, integrator, treatment, 0.01, 0.2))


# -- bad input -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("inertia", "centre", "words"),
    [
        ((0.1, 0.1), (0.3, 0), r"about the centre of mass at \[0.3, 0.0\]"),
        ([[1, 2], [2, 1]], (0, 0), "eigenvalue -1"),
        ([[1, 0.1], [0.2, 1]], (0, 0), "inertia is not symmetric by 0.1"),
        ((-1, 1), (0, 0), "negative"),
        ((1, 1, 1), (0, 0), r"shape \(3,\), expected \(2,\) or \(2, 2\)"),
        ((1, 1), (0, np.nan), "centre = .*two finite numbers"),
        ((1, 1), (0, 0, 0), "centre = .*two finite numbers"),
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
    plain = sc.Section.from_constants(
        EA=1, GA=1, EI=(1, 1), GJ=1, mass=3.0, inertia=(1, 2), centre=(0.1, 0.2)
    )
    assert plain.centre.tolist() == [0.1, 0.2]
    assert plain.damped(0.1).density.tolist() == plain.density.tolist()
