"""Kelvin-Voigt sections and Rayleigh damping against closed forms, balances and invariances."""

from __future__ import annotations

from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from helpers_kernels import (
    INTEGRATORS,
    TREATMENTS,
    assert_same,
    assert_same_in_steps_of_other_sizes,
    assert_same_iteration,
    both,
    corner,
    integrators,
    treatments,
    tree,
    with_kept_factors,
)
from helpers_scenes import (
    FULL,
    SHAKE,
    TENSOR,
    _corner,
    full_section,
    pairs,
)
from rounding import momentum_limits
from test_tangents import TOLERANCE, Step, worst

import skfem_cosserat as sc
from skfem_cosserat.diagnostics import section_forces, section_strain_rates

#: Symmetric, of rank 4 only: a section may be damped against some of its strains.
_ROOT = np.random.default_rng(4).standard_normal((6, 4))
PARTIAL = 0.1 * (_ROOT @ _ROOT.T + (_ROOT @ _ROOT.T).T)
SLIM = sc.Section([30, 35, 60, 4, 5, 3], mass=0.8, inertia=(0.02, 0.03))


def run(system, integrator, step, until, treatment="null space", **options):
    start = sc.initial_state(system, v=sc.project(system, system.q0, system.v0))
    return sc.simulate(
        system, INTEGRATORS[integrator], TREATMENTS[treatment], step, until, start=start, **options
    )


def crossing(order=1):
    """A frame of three beams, two of them viscous, on a shaken support; a second beam, bodies."""
    base_section, arm_section = full_section().damped(viscosity=PARTIAL), SLIM.damped(time=0.03)
    sections = {"base": base_section, "leg": SLIM, "arm": arm_section}
    model = sc.Model()
    frame = model.add("frame", sc.Beam(_corner(), sections, order=order))
    end = frame.node("arm.end")
    line = sc.MeshCurve.init_line(end.position, end.position + (0.5, 0.2, 0.9), 2, "boom")
    boom = model.add("boom", sc.Beam(line, SLIM, order=order))
    model.add("clamp", sc.JointFixed(sc.ground((0, 0, -1), SHAKE), frame.node("base.start")))
    model.add("ball joint", sc.JointSpherical(end, boom.node("boom.start")))
    hub = model.add(
        "hub", sc.RigidBody(0.7, TENSOR, center=(0.05, 0, 0.1), on=frame.node("corner"))
    )
    corner = frame.node("corner").position
    tool = model.add("tool", sc.MassPoint(0.3, on=hub.at(corner + np.array([0.2, 0.1, 0.3]))))
    ball = model.add("ball", sc.MassPoint(0.5, position=(2, 0, 0), velocity=(0, 1.0, 0)))
    model.add("spring", sc.SpringDamper(ball.place(), boom.node("boom.end"), 20.0, damping=0.4))
    model.add("gravity", sc.LoadGravity((0, 0, -9.81)))
    model.add("push", sc.LoadForce(boom.node("boom.end"), (1, 2, 0), follower=True))
    model.add("all", sc.RayleighDamping(mass=0.3))
    model.add("boom alone", sc.RayleighDamping(mass=0.4, stiffness=0.02, items=boom))
    model.add("some", sc.RayleighDamping(mass=0.9, items=[hub, tool]))
    return model.freeze()


def free_beam(section, rayleigh=None, **motion):
    mesh = sc.MeshCurve.init_arc((0, 0, 0), (1, 0, 0), (0, 1, 0), 2.0, 1.0, 3, "rod")
    model = sc.Model()
    rod = model.add("rod", sc.Beam(mesh, section, order=2, **motion))
    model.add("tip", sc.MassPoint(0.5, on=rod.node("rod.end")))
    if rayleigh is not None:
        model.add("damping", rayleigh)
    return model.freeze()


def swirl(nodes):
    """Velocities that also bend and stretch a beam."""
    return np.array([1.0, 0, 0.5]) + np.cross((0.5, 1.0, 2.0), nodes) + 0.8 * nodes**2


# -- sections ------------------------------------------------------------------------------------


def test_damped_copies():
    steel = sc.Material(210e9, 0.3, 7850.0)
    section = sc.SectionRectangle(0.1, 0.2, steel)
    copy = section.damped(time=2e-3)
    assert isinstance(copy, sc.SectionRectangle)
    assert np.array_equal(copy.viscosity, 2e-3 * section.stiffness)
    assert np.array_equal(copy.stiffness, section.stiffness) and copy.mass == section.mass
    assert np.array_equal(copy.outline, section.outline)
    assert not section.viscosity.any()  # the first one stays as it was
    again = copy.damped(viscosity=[1, 2, 3, 4, 5, 6])
    assert np.array_equal(again.viscosity, np.diag([1.0, 2, 3, 4, 5, 6]))
    assert not copy.damped(time=0.0).viscosity.any()


def test_viscosity_of_constructors():
    constants = sc.Section.from_constants(
        EA=1.0, GA=1.0, EI=(1, 1), GJ=1.0, mass=1.0, inertia=(1, 1), viscosity=np.ones(6)
    )
    assert np.array_equal(constants.viscosity, np.eye(6))


def _section(**options):
    return sc.Section(np.ones(6), 1.0, (1, 1), **options)


def _model(damping):
    model = sc.Model()
    model.add("body", sc.RigidBody.sphere(1.0, 1.0))
    model.add("damping", damping)
    return model.freeze()


BODY = sc.MassPoint(1.0)


@pytest.mark.one_quick
@pytest.mark.parametrize(
    ("call", "text"),
    [
        (lambda: _section(viscosity=-np.ones(6)), "section.*viscosity.*semidefinite.*-1 s"),
        (lambda: _section(viscosity=np.eye(6, k=1)), "viscosity is not symmetric by 1"),
        (lambda: _section(viscosity=np.ones(5)), r"viscosity has shape \(5,\).*\(6, 6\)"),
        (SLIM.damped, "section.*time = None.*expected one of them"),
        (lambda: SLIM.damped(1.0, np.eye(6)), "time = 1.0, viscosity"),
        (lambda: SLIM.damped(time=-0.1), "section.*time = -0.1"),
        (sc.RayleighDamping, "damping.*both zero"),
        (lambda: sc.RayleighDamping(-1.0), "damping.*mass = -1.0"),
        (lambda: sc.RayleighDamping("a"), "damping.*mass = 'a'"),
        (lambda: sc.RayleighDamping(1.0, items=[]), "items is empty"),
        (lambda: sc.RayleighDamping(1.0, items=sc.LoadGravity((0, 0, 1))), "items: load.*body"),
        (lambda: sc.RayleighDamping(1.0, items=[BODY, BODY]), "mass point.*named twice"),
        (lambda: sc.RayleighDamping(1.0, 0.1, items=BODY), "stiffness = 0.1 s.*none: mass point"),
        (lambda: _model(sc.RayleighDamping(1.0, items=BODY)), "'damping'.*mass point"),
        (lambda: sc.RayleighDamping.from_ratios((1, 1), (0.1, 0.1)), "frequencies.*equal"),
        (lambda: sc.RayleighDamping.from_ratios((1, 2), 0.1), "ratios = 0.1.*two"),
        (lambda: sc.RayleighDamping.from_ratios((1, 2), (0.1, 0.4)), "mass = -0.266667.*negative"),
    ],
)
def test_bad_input_is_named(call, text):
    with pytest.raises(sc.InputError, match=text):
        call()


@pytest.mark.parametrize("ratios", [(0.02, 0.03), (0.04, 0.02), (0.02, 0.04)])
def test_factors_from_ratios(ratios):
    damping = sc.RayleighDamping.from_ratios((10.0, 20.0), ratios)
    for omega, zeta in zip((10.0, 20.0), ratios, strict=True):
        found = damping.mass / (2 * omega) + damping.stiffness * omega / 2
        assert found == pytest.approx(zeta, rel=1e-14)
    assert (damping.mass == 0) == (ratios == (0.02, 0.04))
    assert (damping.stiffness == 0) == (ratios == (0.04, 0.02))


# -- matrices -------------------------------------------------------------------------------------


def test_drag_matrix():
    """Factors times mass, of the whole scene and of some items, lumps on a node among them."""
    system = crossing(2)
    rest = (system.drag - 0.3 * system.mass).toarray()
    frame, boom, hub, tool, ball = system.structures
    rows = slice(system.first[id(boom)][1], system.first[id(ball)][1])
    assert abs(rest[rows, rows] - 0.4 * system.mass.toarray()[rows, rows]).max() < 1e-15
    corner = system.offset(frame.node("corner")) // 3
    block = 0.9 * (hub.scalar_mass() + np.pad(tool.scalar_mass(), (0, 4 - len(tool.scalar_mass()))))
    assert abs(rest[corner : corner + 4, corner : corner + 4] - block).max() < 1e-14
    rest[rows, rows] = rest[corner : corner + 4, corner : corner + 4] = 0
    assert abs(rest).max() < 1e-15


@pytest.mark.one_quick
@treatments
@integrators
def test_tangent_of_a_step(integrator, treatment):
    step = Step(crossing(2), INTEGRATORS[integrator], TREATMENTS[treatment])
    assert worst(step.matrix(), step.derivative()) < TOLERANCE


@pytest.mark.slow
@integrators
def test_beams_of_two_orders_of_which_one_is_viscous(integrator):
    model = sc.Model()
    first = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 2, "first")
    second = sc.MeshCurve.init_line((1, 0, 0), (1, 1, 0), 2, "second")
    one = model.add("one", sc.Beam(first, SLIM, order=1))
    viscous = SLIM.damped(time=0.05)
    two = model.add("two", sc.Beam(second, viscous, order=2, velocity=swirl))
    model.add("pin", sc.JointSpherical(one.node("first.end"), two.node("second.start")))
    model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), one.node("first.start")))
    model.add("gravity", sc.LoadGravity((0, 3.0, -9.81)))
    history = run(model.freeze(), integrator, 0.005, 0.2)
    limit = {"variational": 1e-3, "energy-momentum": 1e-12}[integrator]
    size = history["energy"].max()
    assert abs(history["energy_balance"]).max() < limit * size
    assert history["dissipated"][-1] > 0.01 * size


# -- closed forms --------------------------------------------------------------------------------

LENGTH, EA, EI, MASS = 1.0, 1e4, 0.5, 1.0


@cache
def cantilever(tau=0.0, alpha=0.0, beta=0.0):
    section = sc.Section([4e3, 4e3, EA, EI, 0.7, 0.3], MASS, (1e-6, 1e-6))
    mesh = sc.MeshCurve.init_line((0, 0, 0), (LENGTH, 0, 0), 3, "rod")
    model = sc.Model()
    rod = model.add("rod", sc.Beam(mesh, section.damped(time=tau), order=3, director=(0, 1, 0)))
    model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), rod.node("rod.start")))
    if alpha or beta:
        model.add("damping", sc.RayleighDamping(alpha, beta))
    return model.freeze()


#: first frequencies (rad/s): of a slender beam without shear and rotary inertia, and of a bar
CLOSED_FORMS = {
    "bending": 1.875104068711961**2 * (EI / MASS) ** 0.5 / LENGTH**2,
    "axial": np.pi / 2 * (EA / MASS) ** 0.5 / LENGTH,
}


@cache
def mode(kind):
    """The mode of the undamped mesh that is nearest: frequency and shape with ``x.Mx = 1``."""
    found, exact = sc.modes(cantilever(), count=14), CLOSED_FORMS[kind]
    omega = 2 * np.pi * found.frequencies
    nearest = np.argmin(abs(omega - exact))
    assert omega[nearest] == pytest.approx(exact, rel={"bending": 1e-3, "axial": 1e-6}[kind])
    return omega[nearest], found.shapes[nearest].real


DAMPINGS = {
    "Kelvin-Voigt": lambda zeta, w: {"tau": 2 * zeta / w},
    "Rayleigh": lambda zeta, w: {"alpha": zeta * w, "beta": zeta / w},
}


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:argument until")
@pytest.mark.parametrize(
    ("kind", "damping"),
    [("bending", "Kelvin-Voigt"), ("axial", "Rayleigh"), ("bending", "Rayleigh")],
)
@integrators
def test_free_decay_of_a_mode(integrator, kind, damping):
    """Free decay of one mode against ``exp(-zeta w t) sin(w sqrt(1 - zeta^2) t)``, order two."""
    omega, shape = mode(kind)
    zeta = 0.05
    system = cantilever(**DAMPINGS[damping](zeta, omega))
    size = {"bending": 1e-7, "axial": 1e-2}[kind]  # the bar is linear, bending for small angles
    start = sc.initial_state(system, v=sc.project(system, system.q0, size * shape))
    weights = (system.mass @ shape.reshape(-1, 3)).ravel()
    errors, damped = [], omega * np.sqrt(1 - zeta**2)
    for count in (60, 120):
        h = 2 * np.pi / omega / count
        run = system, INTEGRATORS[integrator], sc.NullSpace(), h, 1.01 * count * h
        history = sc.simulate(*run, start=start, derive=False)
        x = (history["q"] - system.q0) @ weights / size
        exact = np.exp(-zeta * omega * history.times) * np.sin(damped * history.times) / damped
        errors.append(abs(x - exact).max() * omega)
    assert errors[1] < 2e-3  # of the phase: (2 pi)^3/12/120^2
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2, abs=0.02)


# its few elements are drawn farther than such ones can be, which these figures do not mind
@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")
@integrators
def test_creep_of_a_bar(integrator):
    """Inertia hardly matters: ``u = (F L/EA) (1 - exp(-t/tau))`` after a load comes on."""
    tau, F = 0.2, 50.0
    section = sc.Section([4e3, 4e3, EA, 5, 5, 5], 1e-9, (1e-9, 1e-9)).damped(time=tau)
    model = sc.Model()
    rod = model.add("rod", sc.Beam(sc.MeshCurve.init_line((0, 0, 0), (2, 0, 0), 2, "rod"), section))
    model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), rod.node("rod.start")))
    model.add("pull", sc.LoadForce(rod.node("rod.end"), (F, 0, 0)))
    system, errors = model.freeze(), []
    tip = system.offset(rod.node("rod.end"))
    for h in (0.02, 0.01):
        history = run(system, integrator, h, 1.0, derive=False)
        exact = F * 2 / EA * (1 - np.exp(-history.times / tau))
        errors.append(abs(history["q"][:, tip] - 2 - exact).max() / exact.max())
    assert errors[1] < 1e-3
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2, abs=0.1)


@pytest.mark.slow
@integrators
def test_drag_on_a_free_body(integrator):
    """Momenta decay as ``exp(-alpha t)``; the linear one by a factor known exactly in each step."""
    alpha, deviations = 0.8, []
    for h in (0.02, 0.01):
        system = free_beam(full_section(), sc.RayleighDamping(alpha), velocity=swirl)
        history = run(system, integrator, h, 1.0)
        P, L, t = (history[k] for k in ("linear_momentum", "angular_momentum", "t"))
        step = (1 - alpha * h / 2) / (1 + alpha * h / 2)
        n = np.arange(len(t))[:, None]
        assert abs(P - P[0] * step**n).max() < 1e-12 * abs(P[0]).max()
        # about a fixed point, of a body that flies along a curve of its own
        deviations.append(abs(L - L[0] * np.exp(-alpha * t)[:, None]).max() / abs(L[0]).max())
    assert deviations[1] < 1e-4
    assert np.log2(deviations[0] / deviations[1]) == pytest.approx(2, abs=0.1)


# -- structure -----------------------------------------------------------------------------------


@pytest.mark.slow
@integrators
def test_momentum_of_a_free_viscous_beam_is_kept(integrator):
    section = full_section().damped(viscosity=PARTIAL + 0.02 * FULL)
    system = free_beam(section, velocity=swirl)
    history = run(system, integrator, 0.01, 1.0)
    names = "linear_momentum", "angular_momentum"
    for name, limit in zip(names, momentum_limits(system, history), strict=True):
        values = history[name]
        assert abs(values - values[0]).max() < limit < 1e-9 * abs(values[0]).max()
    assert (np.diff(history["dissipated"]) > 0).all()
    assert history["dissipated"][-1] > 0.05 * history["energy"][0]


@pytest.mark.slow
@integrators
def test_a_turning_beam_is_not_damped(integrator):
    """About its own axis nothing strains: no dissipation, whatever the retardation time."""
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 3, "rod")
    model = sc.Model()
    spin = {"angular_velocity": (7.0, 0, 0)}
    model.add("rod", sc.Beam(mesh, full_section().damped(time=50.0), order=2, **spin))
    history = run(model.freeze(), integrator, 0.05, 5.0)
    E = history["energy"]
    assert history["dissipated"][-1] < 1e-20 * E[0]
    assert abs(E - E[0]).max() < 1e-12 * E[0]


@cache
def damped_crossing(integrator, treatment="null space", step=0.01, until=0.2, kernels="auto"):
    return run(crossing(), integrator, step, until, treatment, kernels=kernels)


@pytest.mark.slow
@pytest.mark.plain
@integrators
def test_both_treatments_give_the_same_motion(integrator):
    one, two = (damped_crossing(integrator, name) for name in TREATMENTS)
    assert abs(one["q"] - two["q"]).max() < 1e-12 * abs(one["q"]).max()
    assert abs(one["dissipated"] - two["dissipated"]).max() < 1e-12 * one["dissipated"].max()
    assert one["newton_iterations"].max() <= 6


@pytest.mark.slow
def test_balance_of_energy(kernels):
    """Exact with energy-momentum; damped, driven and loaded at once."""
    history = damped_crossing("energy-momentum", kernels=kernels)
    size = abs(history["energy"]).max()
    assert history["dissipated"][-1] > 0.05 * size
    assert abs(history["energy_balance"]).max() < 1e-13 * size
    assert (np.diff(history["dissipated"]) >= 0).all()


@integrators
@pytest.mark.slow
def test_second_order_in_the_step(integrator):
    """Of motion, forces and dissipation; of the balance of energy with the variational scheme."""
    runs = [damped_crossing(integrator, step=h, until=0.12) for h in (0.004, 0.002, 0.001)]
    for name in ("q", "v", "dissipated", "beam/frame/resultant"):
        coarse, fine = (abs(a[name][-1] - b[name][-1]).max() for a, b in pairwise(runs))
        assert np.log2(coarse / fine) == pytest.approx(2, abs=0.03), name
    if integrator == "variational":
        coarse, fine = (run["energy_balance"][len(run) // 2] for run in runs[1:])
        assert np.log2(coarse / fine) == pytest.approx(2, abs=0.15)


@pytest.mark.slow
@integrators
def test_rayleigh_is_kelvin_voigt_for_the_stiffness(integrator):
    own = run(free_beam(full_section().damped(time=0.03), velocity=swirl), integrator, 0.02, 0.4)
    damping = sc.RayleighDamping(stiffness=0.03)
    other = run(free_beam(full_section(), damping, velocity=swirl), integrator, 0.02, 0.4)
    for name in own.series:
        assert np.array_equal(own[name], other[name], equal_nan=True), name


# -- results -------------------------------------------------------------------------------------


@pytest.mark.slow
@integrators
def test_section_forces_with_the_viscous_part(integrator):
    """By the recorded velocities, in both schemes."""
    system = crossing()
    frame, boom = system.structures[:2]
    history = damped_crossing(integrator, step=0.004, until=0.12)
    q, v = history["q"], history["v"]
    elastic = section_forces(system, frame, q)
    assert np.array_equal(elastic, history["beam/frame/resultant"])
    total = section_forces(system, frame, q, v)
    viscous = section_strain_rates(system, frame, q, v)
    viscous[:, :2] = viscous[:, :2] @ PARTIAL  # the base
    viscous[:, 2] = 0  # the leg
    viscous[:, 3] = viscous[:, 3] @ (0.03 * SLIM.stiffness)  # the arm
    assert abs(total - elastic - viscous).max() < 1e-12 * abs(total).max()
    assert abs(viscous[:, 0]).max() > 0.1 * abs(elastic[:, 0]).max()
    own = section_forces(system, boom, q, v) - section_forces(system, boom, q)
    rates = section_strain_rates(system, boom, q, v)
    assert abs(own - 0.02 * rates @ SLIM.stiffness).max() < 1e-12 * abs(own).max()


def test_rates_need_velocities_of_the_same_states():
    system = crossing(1)
    with pytest.raises(sc.InputError, match="argument v"):
        section_strain_rates(system, system.structures[0], system.q0, np.zeros((2, system.n)))


# -- compiled kernels ------------------------------------------------------------------------------


def viscous(model):
    model.add("damping", sc.RayleighDamping(stiffness=3e-3))


def dragged(model):
    """Beam and lumps, a body and a point; a force that follows beside them."""
    model.add("damping", sc.RayleighDamping(mass=0.8, stiffness=1e-3))
    rod = model["rod"]
    model.add("thrust", sc.LoadForce(rod.node("arc.end"), (1.0, 2.0, 0.5), follower=True))


dampings = pytest.mark.parametrize(("make", "add"), [(tree, dragged), (corner, viscous)])


@pytest.mark.slow
@dampings
@pairs
def test_kernels_agree_far_from_a_solution(integrator, treatment, make, add):
    assert_same_iteration(make(2, add), integrator, treatment, 2)


@pytest.mark.slow
@dampings
@pairs
def test_kernels_agree(integrator, treatment, make, add):
    """Thirty steps; what is dissipated among what is compared, apart from the work of loads."""
    plain, compiled = both(make(1, add), integrator, treatment, 1e-3, 0.03)
    assert_same(plain, compiled)
    lost = plain["dissipated"]
    assert lost.max() > 1e-3 and abs(compiled["dissipated"] - lost).max() < 1e-9 * lost.max()


@pytest.mark.one_quick
@pairs
def test_kernels_agree_in_steps_of_other_sizes(integrator, treatment):
    """What resists knows the size of the step: rates are differences over it."""
    assert_same_in_steps_of_other_sizes(tree(1, dragged), integrator, treatment)


@pytest.mark.slow
@pairs
def test_kept_factors(integrator, treatment):
    """The same motion with a fraction of the factorisations; energy-momentum closes the balance."""
    runs = whole, kept = with_kept_factors(tree(1, viscous), integrator, treatment, 5e-4, 0.1)
    assert abs(kept["q"][-1] - whole["q"][-1]).max() < 1e-10
    assert kept.meta["factorisations"] < 0.4 * whole.meta["factorisations"]
    if integrator == "energy-momentum":
        for run in runs:
            assert abs(run["energy_balance"]).max() < 1e-10 * abs(run["energy"]).max()
