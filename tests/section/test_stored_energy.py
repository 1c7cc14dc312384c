"""Sections of any stored energy: laws, integrators, equilibria, modes, and what is refused."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from helpers_kernels import (
    INTEGRATORS,
    TREATMENTS,
    assert_same,
    assert_same_in_steps_of_other_sizes,
    assert_same_iteration,
    both,
    integrators,
    needs_numba,
    treatments,
)
from helpers_scenes import FULL, TENSOR, full_section
from scipy.integrate import solve_ivp
from test_tangents import Step, worst

import skfem_cosserat as sc
from skfem_cosserat import diagnostics
from skfem_cosserat.law import LawQuadratic, difference
from skfem_cosserat.model.limits import overstretched

MASS, INERTIA, CENTRE = 1.3, np.array([[0.13, 0.01], [0.01, 0.09]]), np.array([0.1, -0.05])


class Quartic:
    """``eps.D eps/2`` and fourth powers in bending, torsion and extension."""

    def __init__(self, D=FULL, bend=30.0, axial=2000.0, twist=5.0):
        self.D, self.bend, self.axial, self.twist = D, bend, axial, twist

    def __call__(self, eps):
        kappa = (eps[..., 3:5] ** 2).sum(-1)
        more = self.bend * kappa**2 + self.axial * eps[..., 2] ** 4 + self.twist * eps[..., 5] ** 4
        return 0.5 * (eps * (eps @ self.D)).sum(-1) + more

    def gradient(self, eps):
        out = eps @ self.D
        out[..., 2] += 4 * self.axial * eps[..., 2] ** 3
        kappa = (eps[..., 3:5] ** 2).sum(-1, keepdims=True)
        out[..., 3:5] += 4 * self.bend * kappa * eps[..., 3:5]
        out[..., 5] += 4 * self.twist * eps[..., 5] ** 3
        return out

    def hessian(self, eps):
        out = np.zeros((*eps.shape, 6)) + self.D
        bent = eps[..., 3:5]
        kappa = (bent**2).sum(-1)[..., None, None]
        bending = kappa * np.eye(2) + 2 * bent[..., :, None] * bent[..., None, :]
        out[..., 3:5, 3:5] += 4 * self.bend * bending
        out[..., 2, 2] += 12 * self.axial * eps[..., 2] ** 2
        out[..., 5, 5] += 12 * self.twist * eps[..., 5] ** 2
        return out


class Fung:
    """``(c/2) (exp(eps.A eps) - 1)``, of Fung's type; c A = D."""

    def __init__(self, D=FULL, c=30.0, one=False):
        self.A, self.c, self.one = D / c, c, one

    def __call__(self, eps):
        Q = (eps * (eps @ self.A)).sum(-1)
        return 0.5 * self.c * (np.exp(Q) - 1 if self.one else np.expm1(Q))


class Quadratic:
    def __init__(self, D=FULL):
        self.D = D

    def __call__(self, eps):
        return 0.5 * (eps * (eps @ self.D)).sum(-1)


QUARTIC, FUNG = Quartic(), Fung()
ENERGIES = {"quartic": QUARTIC, "fung": FUNG}
energies = pytest.mark.parametrize("energy", ENERGIES)


def section(energy, **options):
    return sc.SectionHyperelastic(energy, MASS, INERTIA, centre=CENTRE, **options)


def pairs(count=200, seed=0):
    """Strains, and increments of all sizes."""
    rng = np.random.default_rng(seed)
    eps = 0.4 * rng.uniform(-1, 1, (count, 6))
    size = 10.0 ** rng.uniform(-15, -0.3, count)
    return eps, eps + size[:, None] * rng.standard_normal((count, 6)), size


# -- laws ------------------------------------------------------------------------------------------


def test_derivatives_given_and_made():
    """By hand, by complex steps, by differences; the quadratic law as a function."""
    eps = 0.4 * np.random.default_rng(3).uniform(-1, 1, (5, 3, 6))
    gradient, hessian = QUARTIC.gradient, QUARTIC.hessian
    S, C = gradient(eps), hessian(eps)
    for derivatives, complex_step, tight in (
        ({"gradient": gradient, "hessian": hessian}, False, 1e-15),
        ({"gradient": gradient}, True, 1e-14),
        ({}, False, 1e-9),
        ({"gradient": lambda eps: gradient(eps.astype(float))}, False, 1e-9),
    ):
        law = section(QUARTIC, **derivatives).law
        assert law.complex_step == complex_step
        assert abs(law.stress(eps) - S).max() < 1e-14 * abs(S).max()
        assert abs(law.tangent(eps) - C).max() < tight * abs(C).max()
        assert abs(law.stiffness - FULL).max() < 1e-11 * FULL.max()
    quadratic = LawQuadratic(FULL)
    found = section(Quadratic()).law
    for name in ("energy", "stress", "tangent"):
        wanted = getattr(quadratic, name)(eps)
        assert abs(getattr(found, name)(eps) - wanted).max() < 1e-11 * abs(wanted).max()


def test_units_do_not_matter():
    """Millimetres and micronewtons: differences take steps in proportion."""
    length = np.array([1, 1, 1, 1e3, 1e3, 1e3])
    law = section(QUARTIC).law
    other = section(lambda eps: 1e6 * QUARTIC(eps * length)).law
    eps0, eps1, _ = pairs(20)
    for name in ("tangent", "discrete_tangent"):
        states = (eps1,) if name == "tangent" else (eps0, eps1)
        wanted = getattr(law, name)(*states)
        found = getattr(other, name)(*(eps / length for eps in states))
        found = found / (1e6 * np.outer(length, length))
        assert abs(found - wanted).max() < 1e-9 * abs(wanted).max()


@pytest.mark.parametrize(("b", "tolerance"), [(100.0, 5e-12), (1e4, 5e-8)])
def test_second_derivatives_by_differences(b, tolerance):
    """Of exp(b eps^2), eps in units of the axial strain: errors as the documentation has them."""
    D = np.array([120.0, 120.0, 390.0, 2.4e-3, 2.4e-3, 1.6e-3])
    fung = Fung(np.diag(D), c=390 / b)
    scale = np.sqrt(390 / D)
    rng = np.random.default_rng(0)
    law = section(fung, strains=0.01 * scale * rng.uniform(-1, 1, (5, 6))).law
    eps = 0.5 / np.sqrt(b) * scale * rng.uniform(-1, 1, (50, 6))
    stress = eps @ fung.A
    exact = (fung.c * np.exp((eps * stress).sum(-1)))[:, None, None] * (
        fung.A + 2 * stress[:, :, None] * stress[:, None, :]
    )
    unit = np.outer(scale, scale)
    assert abs((law.tangent(eps) - exact) * unit).max() < tolerance * abs(exact * unit).max()


@energies
def test_discrete_derivative_has_exactly_the_change_of_energy(energy):
    """To the rounding of both energies, at increments from 1e-15 to 1."""
    law = section(ENERGIES[energy]).law
    eps0, eps1, _ = pairs()
    S = law.discrete(eps0, eps1)
    W0, W1 = law.energy(eps0), law.energy(eps1)
    work = (S * (eps1 - eps0)).sum(-1)
    size = W0 + W1 + abs(S * (eps1 - eps0)).sum(-1)
    assert (abs(work - (W1 - W0)) / size).max() < 100 * np.finfo(float).eps
    assert abs(S - law.discrete(eps1, eps0)).max() < 1e-12 * abs(S).max()  # symmetric


@pytest.mark.parametrize("energy", [*ENERGIES.values(), Fung(one=True)], ids=[*ENERGIES, "noisy"])
def test_discrete_derivative_has_no_noise_at_small_increments(energy):
    """It is the stress of the mean strain to second order of the increment, and rounding.

    So it is where the energy is right to 1e-16 of one only.
    """
    law = section(energy).law
    eps0, eps1, size = pairs()
    error = abs(law.discrete(eps0, eps1) - law.stress(0.5 * (eps0 + eps1))).max(1)
    stress = abs(law.stress(eps0)).max(1)
    small = size < 1e-3
    assert (error[small] < (20 * size[small] ** 2 + 5e-14) * stress.max()).all()
    same = law.discrete(eps0, eps0)  # functions of several stacks at once may round otherwise
    assert abs(same - law.stress(eps0)).max() <= 64 * np.finfo(float).eps * stress.max()


def test_of_a_quadratic_energy_it_is_the_mean_stress():
    law, plain = section(Quadratic()).law, LawQuadratic(FULL)
    eps0, eps1, _ = pairs()
    wanted = plain.discrete(eps0, eps1)
    assert abs(law.discrete(eps0, eps1) - wanted).max() < 1e-14 * abs(wanted).max()
    T = law.discrete_tangent(eps0, eps1)
    assert abs(T - plain.discrete_tangent(eps0, eps1)).max() < 1e-8 * FULL.max()


@energies
def test_tangent_of_the_discrete_derivative(energy):
    """By differences of fourth order and by the complex step; it is not symmetric."""
    law = section(ENERGIES[energy]).law
    rng = np.random.default_rng(5)
    eps0, eps1 = 0.3 * rng.uniform(-1, 1, (2, 20, 6))
    T = law.discrete_tangent(eps0, eps1)
    wanted = difference(
        lambda eps: law.discrete(np.broadcast_to(eps0[:, None], eps.shape), eps),
        eps1, np.full(6, 1e-4),
    )  # fmt: skip
    assert abs(T - np.swapaxes(wanted, -1, -2)).max() < 1e-8 * abs(T).max()
    column = law.discrete(eps0, eps1 + 1e-30j * np.eye(6)[2]).imag / 1e-30
    assert abs(T[..., 2] - column).max() < 1e-11 * abs(T).max()
    assert abs(T - np.swapaxes(T, -1, -2)).max() > 0.01 * abs(T).max()


def moving_section(energy):
    """Of the quartic one with derivatives by hand, of the other one with made ones."""
    if isinstance(energy, Quartic):
        return section(energy, gradient=energy.gradient, hessian=energy.hessian)
    return section(energy)


# -- motions ---------------------------------------------------------------------------------------


def free_beam(made, order=2, elements=3, scale=4.0):
    """Curved beam in fast motion."""
    mesh = sc.MeshCurve.init_arc((0.3, 0, 0), (1, 0, 0), (0, 1, 0.3), 1.5, 1.5, elements, "arc")

    def field(seed):
        a = np.random.default_rng(seed).standard_normal((3, 3, 3))
        return lambda x: scale * (a[0, 0] + np.sin(x @ a[1]) @ a[2])

    beam = sc.Beam(mesh, made, order=order, twist=0.4, velocity=field(1), angular_velocity=field(2))
    model = sc.Model()
    model.add("beam", beam)
    return model, beam


def with_joints(made):
    """A free chain: such a beam, a body on a hinge, a beam of a plain section on a ball joint."""
    model, beam = free_beam(made)
    start, end = beam.node("arc.start"), beam.node("arc.end")
    body = model.add("body", sc.RigidBody(0.8, TENSOR, position=end.position + (0.3, 0, 0.1)))
    model.add("hinge", sc.JointRevolute(end, body.at(end.position), (0, 1, 0)))
    mesh = sc.MeshCurve.init_line(start.position, start.position - (0.9, 0.1, 0), 2, "tail")
    tail = model.add("tail", sc.Beam(mesh, full_section(), order=2))
    model.add("ball", sc.JointSpherical(start, tail.node("tail.start")))
    system = model.freeze()
    return system, sc.initial_state(system, v=sc.project(system, system.q0, system.v0))


def simulated(system, integrator, treatment, step=0.01, until=0.2, **options):
    return sc.simulate(
        system, INTEGRATORS[integrator], TREATMENTS[treatment], step, until, **options
    )


def assert_conserved(system, history, integrator):
    L = diagnostics.angular_momentum(system, history["q"], history["p"])
    P = diagnostics.linear_momentum(system, history["p"])
    assert abs(L - L[0]).max() < 1e-12 * np.linalg.norm(L[0])
    assert abs(P - P[0]).max() < 1e-12 * np.linalg.norm(P[0])
    energy = history["energy"]
    if integrator == "energy-momentum":
        assert abs(energy - energy[0]).max() < 1e-12 * energy[0]
    else:  # negative
        assert abs(energy - energy[0]).max() > 1e-6 * energy[0]


@pytest.mark.slow
@energies
@integrators
@treatments
def test_free_flight_keeps_momenta_and_energy(energy, integrator, treatment):
    """Alone, and with joints and a beam of a plain section."""
    made = moving_section(ENERGIES[energy])
    system, start = with_joints(made)
    assert_conserved(system, simulated(system, integrator, treatment, start=start), integrator)
    model, beam = free_beam(made)
    system = model.freeze()
    history = simulated(system, integrator, treatment, until=0.3)
    assert_conserved(system, history, integrator)
    eps = diagnostics.section_strains(system, beam, history["q"][-1])
    nonlinear = made.law.energy(eps) - LawQuadratic(FULL).energy(eps)
    assert nonlinear.max() > 0.05 * LawQuadratic(FULL).energy(eps).max()


def test_mean_stress_does_not_keep_the_energy():
    """Negative: of an energy that is not quadratic it is no discrete derivative."""
    law = moving_section(QUARTIC).law
    eps0, eps1, _ = pairs()
    mean = 0.5 * (law.stress(eps0) + law.stress(eps1))
    lost = (mean * (eps1 - eps0)).sum(-1) - (law.energy(eps1) - law.energy(eps0))
    assert abs(lost).max() > 1e-3


@pytest.mark.one_quick
@energies
@integrators
@pytest.mark.parametrize("treatment", [sc.NullSpace(), sc.Multipliers()], ids=lambda t: t.name)
def test_tangent_of_a_step(energy, integrator, treatment):
    """By the complex step; strains of order 0.3 at both ends."""
    made = moving_section(ENERGIES[energy]).damped(viscosity=0.1 * np.ones(6))
    system = free_beam(made)[0].freeze()
    step = Step(system, INTEGRATORS[integrator], treatment, size=0.1)
    assert worst(step.matrix(), step.derivative()) < 1e-9


@pytest.mark.slow
@treatments
def test_viscous_energy_balance(treatment):
    """Kelvin-Voigt, its own and Rayleigh's: what is lost is what is dissipated, to rounding."""
    model, beam = free_beam(moving_section(QUARTIC).damped(time=0.02))
    model.add("damping", sc.RayleighDamping(mass=0.1, stiffness=0.01, items=[beam]))
    history = simulated(model.freeze(), "energy-momentum", treatment)
    assert abs(history["energy_balance"]).max() < 1e-12 * history["energy"][0]
    assert history["energy"][-1] < 0.9 * history["energy"][0]


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")  # one element under tension
@integrators
def test_oscillator_with_a_hardening_spring(integrator):
    """A mass on a light rod: ``(m + rho L/3) x'' = -W'(x/L)``, by an ODE solver; second order."""
    m, rho, energy = 3.0, 0.1, Quartic(np.diag([400.0, 500.0, 90.0, 3.0, 4.0, 2.0]))

    def rate(t, state):
        stretch = state[0] / LENGTH
        return state[1], -(90 * stretch + 8000 * stretch**3) / (m + rho * LENGTH / 3)

    exact = solve_ivp(rate, (0, 1.5), (0.0, 2.0), rtol=1e-12, atol=1e-13).y[0, -1]
    errors = []
    for h in (0.01, 0.005):
        made = sc.SectionHyperelastic(energy, rho, (1e-3, 1e-3))
        model, beam = rod(made, 1, 1, velocity=lambda x: x * (0, 0, 1.0))
        model.add("mass", sc.MassPoint(m, on=beam.node("rod.end")))
        history = simulated(model.freeze(), integrator, "null space", h, 1.5, derive=False)
        errors.append(tip(beam, history)[2] - LENGTH - exact)
    assert 3.9 < errors[0] / errors[1] < 4.1
    assert abs(errors[1] - (errors[0] - errors[1]) / 3) < 1e-6


# -- equilibria ------------------------------------------------------------------------------------

LENGTH = 2.0
DIAGONAL = np.diag([400.0, 500.0, 900.0, 3.0, 4.0, 2.0])


def rod(made, order=2, elements=4, force=None, velocity=(0, 0, 0)):
    """A clamped straight rod, and a force at its end."""
    mesh = sc.MeshCurve.init_line((0, 0, 0), (0, 0, LENGTH), elements, "rod")
    model = sc.Model()
    own = sc.Beam(mesh, made, order=order, director=(1, 0, 0), velocity=velocity)
    beam = model.add("rod", own)
    model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), beam.node("rod.start")))
    if force is not None:
        model.add("force", sc.LoadForce(beam.node("rod.end"), force))
    return model, beam


def tip(beam, history):
    """Where the end of the rod is at last."""
    return history.position(beam.node("rod.end"))[-1]


@pytest.mark.slow
@treatments
def test_uniform_bending(treatment):
    """M = dW/dK: a clamped rod under an end moment is an arc; axial and shear strains vanish."""
    energy = Quartic(DIAGONAL, bend=1.5)
    kappa = 0.9
    moment = 3.0 * kappa + 4 * 1.5 * kappa**3
    model, beam = rod(section(energy), 4, 4)
    model.add("moment", sc.LoadMoment(beam.node("rod.end"), (moment, 0, 0)))
    path = sc.static(model, TREATMENTS[treatment], control=sc.LoadControl(until=1.0))
    system, q, angle = model.freeze(), path["q"][-1], kappa * LENGTH
    expected = [0, -(1 - np.cos(angle)) / kappa, np.sin(angle) / kappa]
    assert tip(beam, path) == pytest.approx(expected, abs=2e-8)
    assert diagnostics.section_strains(system, beam, q)[..., 3] == pytest.approx(kappa, rel=1e-6)
    assert diagnostics.section_forces(system, beam, q)[..., 3] == pytest.approx(moment, rel=1e-6)
    found = diagnostics.nodal_resultants(system, beam, q)[..., 3]
    assert found == pytest.approx(np.full_like(found, moment), rel=1e-9)
    W = 0.5 * 3.0 * kappa**2 + 1.5 * kappa**4
    assert diagnostics.strain_energy(system, q) == pytest.approx(W * LENGTH, rel=1e-7)


@pytest.mark.slow
@pytest.mark.parametrize(("order", "meshes"), [(1, (32, 64)), (2, (8, 16)), (3, (6, 12))])
def test_convergence_order_of_tips(order, meshes):
    """2 p, as for quadratic energies; the reference: order 4 with 16 elements."""
    made = moving_section(Quartic(DIAGONAL, bend=2.0))
    tips = []
    for degree, elements in ((4, 16), *((order, count) for count in meshes)):
        model, beam = rod(made, degree, elements, (0.7, 1.0, 0))
        tips.append(tip(beam, sc.static(model, control=sc.LoadControl(until=1.0, steps=2))))
    exact, coarse, fine = tips
    ratio = np.linalg.norm(coarse - exact) / np.linalg.norm(fine - exact)
    assert np.log2(ratio) == pytest.approx(2 * order, abs=0.15)


@pytest.mark.slow
def test_frequencies_of_a_stretched_bar_follow_the_present_stiffness():
    """N = W'(Gamma_3), and longitudinal vibrations: (2 k - 1) pi/(2 L) sqrt(W''(Gamma_3)/mass)."""
    stretch = 0.3
    energy = Quartic(np.diag([4e4, 5e4, 900.0, 3e3, 4e3, 2e3]))
    made = sc.SectionHyperelastic(energy, MASS, (0.13, 0.09))
    force = 900 * stretch + 4 * 2000 * stretch**3
    model, beam = rod(made, 4, 6, (0, 0, force))
    path = sc.static(model, control=sc.LoadControl(until=1.0))
    system, q = model.freeze(), path["q"][-1]
    assert diagnostics.section_strains(system, beam, q)[..., 2] == pytest.approx(stretch, rel=1e-11)
    at = diagnostics.evaluate(system, beam, q, *beam.along([0.1, 1.9]))
    assert at.resultant[:, 2] == pytest.approx(force, rel=1e-11)
    W = 450 * stretch**2 + 2000 * stretch**4
    assert diagnostics.strain_energy(system, q) == pytest.approx(W * LENGTH, rel=1e-11)
    found = sc.modes(model, path, count=12).omega
    D = 900 + 12 * 2000 * stretch**2
    for k in (1, 2):
        wanted = (2 * k - 1) * np.pi / (2 * LENGTH) * np.sqrt(D / MASS)
        assert abs(found - wanted).min() < 1e-8 * wanted


def test_highest_frequency_takes_the_stiffness_where_it_is():
    system = rod(section(Quartic(DIAGONAL)), 2, 3)[0].freeze()
    q = system.q0.copy().reshape(-1, 3)
    q[system.origin_rows] *= 1.3
    at_rest = diagnostics.highest_frequency(system, system.q0)
    assert diagnostics.highest_frequency(system, q.ravel()) > 1.1 * at_rest


@pytest.mark.slow
def test_linear_buckling_takes_the_stiffness_at_rest():
    plain, made = (
        sc.buckling(rod(each, 2, 6, (0, 0, -1.0))[0], count=2).factors
        for each in (sc.Section(DIAGONAL, MASS, INERTIA), section(Quartic(DIAGONAL)))
    )
    assert plain == pytest.approx(made, rel=1e-9)


def test_tension_is_held_by_the_present_bending_stiffness():
    """Beyond 4 EI/h^2 of zero strain nothing is said of a rod that has stiffened tenfold."""
    plain = Quadratic(np.diag([4e4, 5e4, 900.0, 3.0, 3.0, 2.0]))

    def stiffening(eps):
        return plain(eps) + 0.5 * 3e3 * eps[..., 2] ** 2 * (eps[..., 3:5] ** 2).sum(-1)

    found = []
    for energy in (plain, stiffening):
        system = rod(section(energy), 1, 4, (0, 0, 90.0))[0].freeze()
        y = system.q0.copy().reshape(-1, 3)
        y[system.origin_rows] *= 1.1
        found.append(overstretched(system, y))
    assert "tension 90 N" in found[0]
    assert f"4 EI/h^2 = {4 * 3.0 / (0.5 * 0.55):.3g} N" in found[0]
    assert found[1] is None  # 10 times as much: 3 + 3e3 * 0.1^2 = 33 N m^2


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_curved_reference_is_free_of_stress(order):
    """And the assembled tangent is the derivative of the force."""
    model, beam = free_beam(section(FUNG), order)
    system = model.freeze()
    assert float(diagnostics.strain_energy(system, system.q0)) < 1e-25
    assert abs(beam.internal_force_form().assemble(beam.basis, q=beam.reference)).max() < 1e-13
    q, dq = np.random.default_rng(0).standard_normal((2, len(beam.reference)))
    q = beam.reference + 0.02 * q
    K = beam.tangent_form().assemble(beam.basis, q=q).toarray()
    h, f = 1e-4, beam.internal_force_form().assemble
    near, far = (f(beam.basis, q=q + k * h * dq) - f(beam.basis, q=q - k * h * dq) for k in (1, 2))
    assert abs(K @ dq - (8 * near - far) / (12 * h)).max() < 1e-8 * abs(K @ dq).max()


def test_a_history_belongs_to_its_energy():
    """A run is not gone on with under another energy of the same stiffness."""
    system, other = (
        free_beam(section(energy))[0].freeze() for energy in (QUARTIC, Quartic(axial=2100.0))
    )
    history = simulated(system, "energy-momentum", "null space", until=0.02)
    assert sc.restart(system, history, sc.EnergyMomentum(), 0.01).index == 2
    with pytest.raises(sc.InputError, match="stored energy differs"):
        sc.restart(other, history, sc.EnergyMomentum(), 0.01)


def test_sections_travel():
    """Pickled with a function that can be imported, copied with damping."""
    made = pickle.loads(pickle.dumps(section(QUARTIC)))
    eps = np.full((2, 6), 0.1)
    assert (made.law.stress(eps) == section(QUARTIC).law.stress(eps)).all()
    damped = made.damped(time=0.1)
    assert (damped.law.stress(eps) == made.law.stress(eps)).all()
    assert damped.viscosity == pytest.approx(0.1 * made.stiffness)


# -- compiled kernels: strains from them, stresses from numpy --------------------------------------


@pytest.mark.slow
@integrators
@treatments
def test_kernels_agree_with_numpy(integrator, treatment):
    """One iteration far from the solution and one with predicted stresses; runs, with damping."""
    system = free_beam(moving_section(FUNG))[0].freeze()
    assert_same_iteration(system, integrator, treatment, 5)
    system, start = with_joints(moving_section(QUARTIC).damped(time=1e-3))
    assert_same(*both(system, integrator, treatment, 2e-3, 0.03, start))
    assert_same_in_steps_of_other_sizes(system, integrator, treatment)


@pytest.mark.slow
@needs_numba
def test_kernels_agree_in_a_plane():
    made = sc.SectionHyperelastic(Quartic(DIAGONAL), MASS, (0.13, 0.09))
    system = rod(made, 2, 4, (0, 3.0, 1.0))[0].freeze(planar=sc.Planar())
    run = both(system, "energy-momentum", "null space", 2e-3, 0.02, sc.initial_state(system))
    assert_same(*run, iterates=False)
    assert abs(run[1].position(system.structures[0].node("rod.end"))[:, 0]).max() == 0


@pytest.mark.slow
@needs_numba
def test_kernels_find_the_same_equilibria():
    model, _ = rod(moving_section(QUARTIC), 2, 4, (1.0, 2.0, 0.5))
    plain, compiled = (sc.static(model, kernels=kernels) for kernels in ("numpy", "numba"))
    assert (plain.meta["kernels"], compiled.meta["kernels"]) == ("numpy", "numba")
    assert plain["newton_iterations"].tolist() == compiled["newton_iterations"].tolist()
    assert abs(plain["q"] - compiled["q"]).max() < 1e-11


@pytest.mark.slow
@pytest.mark.parametrize(
    "scheme", [sc.GeneralizedAlpha(0.8), sc.EnergyDecaying(0.2, velocity=False)], ids=str
)
@treatments
def test_kernels_agree_in_other_schemes(scheme, treatment):
    system, start = with_joints(moving_section(QUARTIC))
    run = system, scheme, TREATMENTS[treatment], 2e-3, 0.02
    options = {"start": start, "settings": sc.NewtonSettings(reuse=0)}
    plain, compiled = (sc.simulate(*run, kernels=each, **options) for each in ("numpy", "numba"))
    assert compiled.meta["kernels"] == "numba"
    for name in ("q", "p", "energy"):
        size = abs(plain[name]).max()
        assert abs(compiled[name] - plain[name]).max() <= 1e-11 * size, name


@needs_numba
def test_kernels_keep_the_energy_with_kept_factors():
    system, start = with_joints(moving_section(QUARTIC))
    history = simulated(system, "energy-momentum", "null space", start=start, kernels="numba")
    assert_conserved(system, history, "energy-momentum")
    assert history.meta["factorisations"] < 0.6 * history["newton_iterations"].sum()


def quartic_of_points():
    """The quartic energy compiled by numba for one point, its gradient and second derivative."""
    from numba import njit

    D, bend, axial, twist = FULL, QUARTIC.bend, QUARTIC.axial, QUARTIC.twist

    @njit
    def energy(eps):
        squares = eps * eps  # numba's higher powers of complex numbers lose small imaginary parts
        kappa = squares[3] + squares[4]
        more = bend * kappa**2 + axial * squares[2] ** 2 + twist * squares[5] ** 2
        return 0.5 * (eps * (D * eps).sum(axis=1)).sum() + more

    @njit
    def gradient(eps):
        out = (D * eps).sum(axis=1)
        out[2] += 4 * axial * eps[2] ** 3
        out[3:5] += 4 * bend * (eps[3] ** 2 + eps[4] ** 2) * eps[3:5]
        out[5] += 4 * twist * eps[5] ** 3
        return out

    @njit
    def real_gradient(eps):
        return gradient(eps.real.copy())

    @njit
    def hessian(eps):
        out = D.copy()
        for i in range(3, 5):
            out[i, i] += 4 * bend * (eps[3] ** 2 + eps[4] ** 2)
            out[i, 3:5] += 8 * bend * eps[i] * eps[3:5]
        out[2, 2] += 12 * axial * eps[2] ** 2
        out[5, 5] += 12 * twist * eps[5] ** 2
        return out

    return {
        "energy": (energy, {}),
        "gradient": (energy, {"gradient": gradient}),
        "real gradient": (energy, {"gradient": real_gradient}),
        "hessian alone": (energy, {"hessian": hessian}),
        "both": (energy, {"gradient": gradient, "hessian": hessian}),
    }


WAYS = ("energy", "gradient", "real gradient", "hessian alone", "both")


@pytest.mark.slow
@needs_numba
@pytest.mark.parametrize("way", WAYS)
def test_functions_of_single_points(way):
    """They are those of stacks; kernels call them without Python, in other schemes, too."""
    energy, derivatives = quartic_of_points()[way]
    made = section(energy, **derivatives)
    law, eps = made.law, 0.3 * np.random.default_rng(0).random((3, 4, 6))
    S, C = QUARTIC.gradient(eps), QUARTIC.hessian(eps)
    assert abs(law.energy(eps) - QUARTIC(eps)).max() < 1e-14 * QUARTIC(eps).max()
    assert abs(law.stress(eps) - S).max() < 1e-14 * abs(S).max()
    assert abs(law.tangent(eps) - C).max() < 1e-9 * abs(C).max()
    assert law.stress(eps[0, 0]).shape == (6,) and law.energy(eps[:0]).shape == (0, 4)
    assert (pickle.loads(pickle.dumps(made)).law.stress(eps) == law.stress(eps)).all()
    system, start = with_joints(made)
    stepper = sc.Stepper(system, sc.EnergyMomentum(), sc.NullSpace(), 2e-3, kernels="numba")
    assert stepper._fast._laws == []
    for integrator in INTEGRATORS:
        assert_same(*both(system, integrator, "null space", 2e-3, 0.02, start))


@pytest.mark.slow
@needs_numba
def test_compiled_functions_beside_those_of_python_and_held_strains():
    energy, derivatives = quartic_of_points()["both"]
    model, beam = rod(section(energy, **derivatives), 1, 2)
    end = beam.node("rod.end")
    line = sc.MeshCurve.init_line(end.position, end.position + (0, 0, 1.0), 2, "more")
    own = {"order": 1, "director": (1, 0, 0), "theory": sc.TheoryKirchhoff()}
    more = model.add("more", sc.Beam(line, section(QUARTIC), **own))
    model.add("weld", sc.JointFixed(end, more.node("more.start")))
    model.add("push", sc.LoadForce(more.node("more.end"), (20.0, 30.0, 5.0), np.sin))
    assert_same(*both(model.freeze(), "energy-momentum", "null space", 2e-3, 0.02))


@pytest.mark.slow
@needs_numba
def test_compiled_functions_that_do_not_do_are_named():
    from numba import njit

    refused("numba cannot compile it for float64 strains", njit(lambda eps: eps.nothing))
    refused(r"gives \(6,\) for the strains \(6,\) of one point", njit(lambda eps: eps))
    refused("numba cannot compile it for complex128", njit(lambda eps: max(eps[2], eps[3])))
    powers = njit(lambda eps: 1e3 * (eps * eps).sum() + 1e6 * (eps**4).sum())
    refused("with numba powers above 2.*give its gradient", powers)


class Failing(Quartic):
    """Cannot be evaluated once it is told so."""

    told = False

    def __call__(self, eps):
        if self.told:
            raise ZeroDivisionError("told so")
        return super().__call__(eps)


@needs_numba
def test_what_an_energy_raises_in_kernels_is_raised_behind_them():
    energy = Failing()
    system = free_beam(section(energy))[0].freeze()
    stepper = sc.Stepper(system, sc.EnergyMomentum(), sc.NullSpace(), 1e-3, kernels="numba")
    state = stepper.advance(sc.initial_state(system)).state
    energy.told = True
    with pytest.raises(sc.InputError, match=r"energy of .* ZeroDivisionError: told so"):
        stepper.advance(state)
    energy.told = False
    assert stepper.advance(state).attempts == 1


# -- bad input -------------------------------------------------------------------------------------


def refused(words, energy=QUARTIC, **options):
    with pytest.raises(sc.InputError, match=words):
        section(energy, **options)


def changed(function, entry, factor):
    def other(eps):
        out = function(eps)
        out[(..., *entry)] *= factor
        return out

    return other


def test_derivatives_that_do_not_match_name_the_worst_entry():
    wrong = changed(QUARTIC.gradient, (4,), 1.01)
    refused(
        r"gradient is not the derivative of the energy; worst entry 4 \(M_2\) at", gradient=wrong
    )
    twice = changed(QUARTIC.gradient, (2,), 2.0)
    refused(
        r"worst entry 2 \(N_3\) at strains \[.*\]: -?\d.*, by differences of the energy -?\d",
        gradient=twice,
    )
    wrong = changed(QUARTIC.hessian, (5, 5), 1.001)
    refused(
        r"hessian is not the derivative of the gradient; worst entry \[5, 5\] \(M_3 by strain 5\)",
        gradient=QUARTIC.gradient, hessian=wrong,
    )  # fmt: skip


class Counter:
    """Depends on how often it was called."""

    def __init__(self):
        self.calls = 0

    def __call__(self, eps):
        self.calls += 1
        return QUARTIC(eps) * (1 + 1e-6 * self.calls)


def neighbours(eps):
    """Depends on all strains it is called with."""
    return QUARTIC(eps) * (1 + abs(eps).max())


def mutating(eps):
    eps *= 2
    return QUARTIC(eps)


def kinked(eps):
    return QUARTIC(eps) + 50 * abs(eps[..., 2]) ** 3


def test_functions_of_anything_else_are_named():
    refused("may depend on these strains only", Counter())
    refused("may depend on these strains only", neighbours)
    refused(r"energy of .*strains .*must not change.*read-only", mutating)
    refused(r"energy of .*strains .*failed", lambda eps, directors: 0.0)
    refused(r"energy of .*strains .*failed", lambda eps: QUARTIC(eps[..., :5]))
    refused("expected a function of strains", 3.0)


@pytest.mark.one_quick
@pytest.mark.parametrize(
    ("energy", "words"),
    [
        (lambda eps: eps @ FULL, r"is float64 of shape \(1, 6\), expected shape \(1,\)"),
        (lambda eps: QUARTIC(eps) + 0j, "is complex128 of shape"),
        (lambda eps: QUARTIC(eps) * np.nan, "energy is not finite at strains"),
        (lambda eps: QUARTIC(eps) + 3.0, "energy at zero strain is 3, expected 0"),
        (lambda eps: QUARTIC(eps) + 0.1 * eps[..., 3], r"M_1 = 0.1 at zero strain"),
        (lambda eps: QUARTIC(eps) - 60 * eps[..., 5] ** 2, "GJ = -"),
        (lambda eps: QUARTIC(eps) + 80 * eps[..., 3] * eps[..., 4], "not positive definite"),
        (lambda eps: QUARTIC(eps.real), "expected .* complex numbers; give its derivative"),
        (kinked, "not analytic.*give its gradient; worst entry 2"),
        (lambda eps: QUARTIC(eps) + 1e3 * np.log1p(-300 * eps[..., 2] ** 2), "GA|EA"),
        (
            lambda eps: QUARTIC(eps) - np.log1p(-6e3 * eps[..., 2] ** 2),
            "energy is not finite at strains .* give `strains`",
        ),
    ],
)  # fmt: skip
def test_impossible_energies_are_named(energy, words):
    refused(words, energy)


def test_strains_of_the_checks():
    """An energy that is defined on a small range only is accepted with strains within it."""

    def barrier(eps):
        return QUARTIC(eps) - np.log1p(-6e3 * eps[..., 2] ** 2)

    few = 1e-3 * np.random.default_rng(0).standard_normal((4, 6))
    law = section(barrier, strains=few).law
    assert law.stiffness[2, 2] == pytest.approx(
        FULL[2, 2] + 12e3, rel=1e-7
    )  # differences, as stated
    refused(r"strains has shape \(6,\), expected \(k, 6\)", strains=np.zeros(6))
    refused("is not finite", strains=np.full((1, 6), np.nan))


def test_an_energy_without_complex_numbers_works_with_its_gradient():
    """W = eps.D eps/2 + 50 |Gamma_3|^3."""

    def gradient(eps):
        out = QUARTIC.gradient(eps)
        out[..., 2] += 150 * abs(eps[..., 2]) * eps[..., 2]
        return out

    law = section(kinked, gradient=gradient).law
    assert not law.complex_step
    eps0, eps1, _ = pairs()
    S = law.discrete(eps0, eps1)
    change = law.energy(eps1) - law.energy(eps0)
    size = law.energy(eps1) + law.energy(eps0)
    assert abs((S * (eps1 - eps0)).sum(-1) - change).max() < 1e-14 * size.max()
