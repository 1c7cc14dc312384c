"""Forces by own laws and potentials: closed forms, other integrators, both kernels."""

import numpy as np
import pytest
from helpers_schemes import KINDS, treatments
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp

import skfem_cosserat as sc

KERNELS = "numpy", "numba"


def exact(rates, start, until):
    """State at an instant, by a Runge-Kutta method of order 8."""
    found = solve_ivp(rates, (0, until), start, method="DOP853", rtol=1e-12, atol=1e-13)
    return found.y[:, -1]


def orders(errors):
    return np.log2(np.divide(errors[:-1], errors[1:]))


def pendulum(kernels_law):
    """A charged bob on a rod of 1 m, in a field, with a law on it."""
    model = sc.Model()
    bob = model.add("bob", sc.MassPoint(1.5, position=(1.0, 0, 0)))
    model.add("rod", sc.JointDistance(sc.ground((0, 0, 0)), bob.place()))
    model.add("gravity", sc.LoadGravity((0, 0, -9.81)))
    model.add("charge", kernels_law(bob.place()))
    return model, bob.place()


CHARGE = np.array([0.3, -0.4, 0.2])  # of the other charge, where it is


def coulomb(x):
    r = x - CHARGE
    return 0.7 / np.sqrt((r * r).sum())


def coulomb_force(x, v, t):
    r = x - CHARGE
    return 0.7 * r / (r * r).sum() ** 1.5


@pytest.mark.parametrize("kernels", KERNELS)
@treatments
def test_a_potential_is_kept_exactly(treatment, kernels):
    model, place = pendulum(lambda p: sc.Force(p, energy=coulomb))
    run = sc.simulate(model, sc.EnergyMomentum(), treatment, 0.01, until=1.0, kernels=kernels)
    total = run["energy"] + run["external"]
    assert abs(total - total[0]).max() < 1e-11
    assert run["coupling_energy"][-1] == pytest.approx(coulomb(run.position(place)[-1]))
    assert abs(run["energy_balance"]).max() < 1e-11
    assert_allclose(
        run["load/charge/force"][-1, 0], coulomb_force(run.position(place)[-1], 0, 0), rtol=1e-7
    )


def test_a_pendulum_with_a_charge_converges_to_the_solution_of_scipy():
    """Law and potential, second order, and the same limit."""

    def rates(t, y):
        x, v = y[:3], y[3:]
        f = coulomb_force(x, v, t) / 1.5 + (0, 0, -9.81)
        n = x / np.linalg.norm(x)
        return [*v, *(f - (f @ n + v @ v) * n)]

    end = exact(rates, [1.0, 0, 0, 0, 0, 0], 0.5)[:3]
    for make in (
        lambda p: sc.Force(p, coulomb_force),
        lambda p: sc.Force(p, energy=coulomb, derivative=lambda x: -coulomb_force(x, 0, 0)),
    ):
        errors = []
        for step in (0.02, 0.01, 0.005):
            model, place = pendulum(make)
            run = sc.simulate(model, sc.EnergyMomentum(), sc.NullSpace(), step, until=0.5)
            errors.append(np.linalg.norm(run.position(place)[-1] - end))
        assert_allclose(orders(errors), 2.0, rtol=0, atol=0.1)


@pytest.mark.parametrize("kernels", KERNELS)
def test_a_law_on_an_angle_counts_turns(kernels):
    """A torque -k (angle - 10): the wheel turns on through pi to rest at 10 rad."""
    model = sc.Model()
    wheel = model.add("wheel", sc.RigidBody.cylinder(2.0, radius=1.0, length=0.1))
    place = wheel.at((0, 0, 0))
    hinge = model.add("hinge", sc.JointRevolute(sc.ground((0, 0, 0)), place, axis=(0, 0, 1)))
    model.add("servo", sc.Force(hinge, lambda x, v, t: -3.0 * (x - 10.0) - 0.5 * v))
    run = sc.simulate(model, sc.EnergyMomentum(), sc.NullSpace(), 0.004, until=2.0, kernels=kernels)
    inertia = 1.0  # m r^2 / 2

    def rates(t, y):
        return [y[1], (-3.0 * (y[0] - 10.0) - 0.5 * y[1]) / inertia]

    angle = exact(rates, [0.0, 0.0], 2.0)[0]
    assert angle > 4 * np.pi / 1.3
    assert run["joint/hinge/angle"][-1] == pytest.approx(angle, abs=2e-3)
    assert run["coupling/servo/coordinate"][-1] == pytest.approx(angle, abs=2e-3)
    assert_allclose(run["energy_balance"], 0.0, rtol=0, atol=1e-10)
    rest = sc.static(model)
    assert rest["joint/hinge/angle"][-1] == pytest.approx(10.0)


def test_one_law_for_many_places_is_that_of_each():
    """Thirty beads with drag and a spring, evaluated together or one by one."""

    def law(x, v, t):
        speed = np.sqrt((v * v).sum(-1, keepdims=True) + 1e-12)
        return -0.3 * speed * v - 2.0 * x

    def beads(force):
        model = sc.Model()
        for k in range(30):
            model.add(f"bead {k}", sc.MassPoint(1.0, position=(k, 1, 0), velocity=(0, 1, k)))
        places = [model[f"bead {k}"].place() for k in range(30)]
        for k, each in enumerate(force(places)):
            model.add(f"force {k}", each)
        return sc.simulate(model, sc.EnergyMomentum(), sc.NullSpace(), 0.02, until=0.2)

    together = beads(lambda places: [sc.Force(places, law, each=True)])
    apart = beads(lambda places: [sc.Force(place, law) for place in places])
    assert_allclose(together["q"], apart["q"], rtol=0, atol=1e-12)
    assert together["load/force 0/force"].shape == (11, 30, 3)
    assert_allclose(together["load/force 0/force"][:, 7], apart["load/force 7/force"][:, 0])


@pytest.mark.parametrize("scheme", KINDS, ids=lambda each: each.name)
@treatments
def test_a_stiff_potential_is_no_spring_apart(scheme, treatment):
    """A spring as a potential moves a body as the spring does, in all schemes."""

    def run(make):
        model = sc.Model()
        body = model.add("body", sc.RigidBody.box(1.0, (1, 0.5, 0.2), velocity=(0, 1, 0.5)))
        model.add("hold", make(body.at((0.5, 0.2, 0))))
        return sc.simulate(model, scheme, treatment, 0.02, until=0.3)

    def stored(x):
        return 20.0 * ((x - (0.5, 0.2, 0.0)) ** 2).sum()

    own = run(lambda place: sc.Force(place, energy=stored))
    spring = run(
        lambda place: sc.Bushing(sc.ground(place.position), place, np.diag([40.0] * 3 + [0] * 3))
    )
    # the energy-decaying scheme damps springs, not potentials of one's own
    loose = isinstance(scheme, sc.EnergyDecaying)
    assert_allclose(own["q"], spring["q"], rtol=0, atol=2e-2 if loose else 1e-8)


@treatments
@pytest.mark.parametrize("kernels", KERNELS)
def test_a_pendulum_between_two_stops(treatment, kernels):
    """The energy is kept by stops without dampers, whichever is hit, and they never pull."""
    model = sc.Model()
    arm = model.add("arm", sc.RigidBody.box(1.0, (1.0, 0.1, 0.1)))
    place = arm.at((-0.5, 0, 0))
    hinge = model.add("hinge", sc.JointRevolute(sc.ground((-0.5, 0, 0)), place, axis=(0, 0, 1)))
    model.add("gravity", sc.LoadGravity((0, -9.81, 0)))
    model.add("stops", sc.JointLimits(hinge, -2.0, 0.3, 2e3))
    run = sc.simulate(model, sc.EnergyMomentum(), treatment, 2e-3, until=4.0, kernels=kernels)
    total = run["energy"] + run["external"]
    assert np.ptp(total) < 1e-9
    angle = run["joint/hinge/angle"]
    assert angle.min() < -2.01
    lower, upper = (run[f"coupling/stops/{end}/force"] for end in ("lower", "upper"))
    assert lower.max() <= 0 <= upper.min()
    assert lower.min() < -10
    assert_allclose(lower, np.minimum(2e3 * (angle + 2.0), 0.0), rtol=0, atol=1e-8)


def test_limits_are_checked():
    model, hinge = sc.Model(), None
    body = model.add("body", sc.RigidBody.box(1.0, (1, 1, 1)))
    hinge = sc.JointRevolute(sc.ground((0, 0, 0)), body.at((0, 0, 0)), axis=(1, 0, 0))
    ball = sc.JointSpherical(sc.ground((0, 0, 0)), body.at((0, 0, 0)))
    for make, text in (
        (lambda: sc.JointLimits(hinge, None, None, 1.0), "no end"),
        (lambda: sc.JointLimits(hinge, 1.0, 0.5, 1.0), "lower"),
        (lambda: sc.JointLimits(hinge, 0.0, 0.5, 0.0), "stiffness"),
        (lambda: sc.JointLimits(hinge, 0.0, np.inf, 1.0), "upper"),
        (lambda: sc.JointLimits(ball, 0.0, 0.5, 1.0), "rotation"),
    ):
        with pytest.raises(sc.InputError, match=text):
            make()


# -- springs with a force of their own, sums of vectors --------------------------------------------

SCHEMES = sc.EnergyMomentum(), sc.Variational(), sc.GeneralizedAlpha(0.8)
MASS, LENGTH = 1.5, 1.8


def on_a_spring(kind=sc.SpringDamper, **spring):
    """A ball 0.2 m beyond the unstressed length of a spring to the origin, moving outwards."""
    model = sc.Model()
    bob = model.add("bob", sc.MassPoint(MASS, position=(2.0, 0, 0), velocity=(3.0, 0, 0)))
    model.add("spring", kind(sc.ground((0, 0, 0)), bob.place(), length=LENGTH, **spring))
    return model, bob.place()


def duffing(e, v, t):
    return 40.0 * e + 900.0 * e**3 + 0.4 * v - 5.0 * np.sin(9.0 * t)


@pytest.mark.parametrize("scheme", SCHEMES, ids=lambda each: each.name)
@pytest.mark.parametrize("beside", [0.0, 40.0])
def test_a_spring_that_hardens_is_the_oscillator_of_duffing(scheme, beside):
    """Of second order, alone and beside a linear spring, to the solution of scipy."""

    def rates(t, y):
        return [y[1], -duffing(y[0], y[1], t) / MASS]

    end = LENGTH + exact(rates, [0.2, 3.0], 1.0)[0]
    found = []
    for step in (0.01, 0.005, 0.0025):
        model, place = on_a_spring(
            stiffness=beside, force=lambda e, v, t: duffing(e, v, t) - beside * e
        )
        run = sc.simulate(model, scheme, sc.NullSpace(), step, until=1.0)
        found.append(run.position(place)[-1, 0])
    assert_allclose(orders(abs(np.subtract(found, end))), 2.0, rtol=0, atol=0.1)
    assert ("coupling/spring/force/force" in run) == (beside > 0)
    if isinstance(scheme, sc.EnergyMomentum):
        assert abs(run["energy_balance"]).max() < 1e-10


def test_laws_have_the_solutions_of_scipy_to_nine_digits():
    """A charged pendulum and Duffing's oscillator, by a composition of order 6."""

    def falling(t, y):
        x, v = y[:3], y[3:]
        f = coulomb_force(x, v, t) / 1.5 + (0, 0, -9.81)
        n = x / np.linalg.norm(x)
        return [*v, *(f - (f @ n + v @ v) * n)]

    def bounced(t, y):
        return [y[1], -duffing(y[0], y[1], t) / MASS]

    charged = exact(falling, [1.0, 0, 0, 0, 0, 0], 0.5)[:3]
    pushed = LENGTH + exact(bounced, [0.2, 3.0], 0.5)[:1]
    fine = sc.Composition(sc.Variational(), 6)
    for (model, place), end in (
        (pendulum(lambda p: sc.Force(p, coulomb_force)), charged),
        (on_a_spring(force=duffing), pushed),
    ):
        run = sc.simulate(model, fine, sc.NullSpace(), 0.005, until=0.5)
        assert_allclose(run.position(place)[-1, : len(end)], end, rtol=0, atol=1e-9)


def test_a_force_of_a_spring_is_that_of_a_potential():
    """In the limit; the potential is in exact balance."""
    model, place = on_a_spring(stiffness=40.0, force=lambda e, v, t: 900.0 * e**3)
    other, at = on_a_spring(stiffness=40.0)
    other.add("own", sc.Force(at, energy=lambda x: 225.0 * (np.sqrt((x * x).sum()) - LENGTH) ** 4))
    method = sc.EnergyMomentum(), sc.NullSpace(), 2e-3
    run, own = (sc.simulate(each, *method, until=0.5) for each in (model, other))
    assert abs(own["energy_balance"]).max() < 1e-11 * own["energy"][0]
    assert_allclose(run.position(place), own.position(at), rtol=0, atol=5e-5)


def play(slope, gap):
    end = slope * (1 - gap)
    return sc.Table([-1, -gap, gap, 1], [-end, 0, 0, end])


@pytest.mark.parametrize("kernels", KERNELS)
@treatments
def test_a_spring_with_a_gap_keeps_its_energy_and_has_its_period(treatment, kernels):
    """Half periods of the spring on both sides, and flights through the gap between them."""
    gap, speed = 0.2, 3.0  # it starts where the gap ends
    period = 4 * gap / speed + 2 * np.pi * np.sqrt(MASS / 900.0)
    model, place = on_a_spring(force=play(900.0, gap))
    method, step = sc.EnergyMomentum(), period / 200
    run = sc.simulate(model, method, treatment, step, until=3 * period, kernels=kernels)
    assert abs(run["energy_balance"]).max() < 1e-11 * run["energy"][0]
    x, stored = run.position(place)[:, 0] - LENGTH, run["coupling_energy"]
    assert_allclose(stored, 450.0 * np.maximum(abs(x) - gap, 0.0) ** 2, rtol=0, atol=1e-9)
    assert_allclose(x[::200], gap, rtol=0, atol=1e-2)


def hinged(**spring):
    """An arm of 8 kg m^2 on a hinge."""
    model = sc.Model()
    arm = model.add("arm", sc.RigidBody.box(96 / 1.01, (1, 0.1, 0.1), angular_velocity=(0, 0, 9.0)))
    hinge = sc.JointRevolute(sc.ground((0, 0, 0)), arm.at((0, 0, 0)), axis=(0, 0, 1))
    model.add("hinge", hinge)
    model.add("spring", sc.JointSpringDamper(hinge, **spring))
    return model


@pytest.mark.parametrize("scheme", KINDS, ids=lambda each: each.name)
@treatments
def test_springs_of_joints_are_the_same_in_both_kernels(scheme, treatment):
    for spring in (
        {"force": play(40.0, 0.1), "stiffness": 3.0, "damping": 0.1},
        {"force": lambda e, v, t: 6.0 * e**3 + 0.5 * v + np.sin(t), "neutral": 0.3},
    ):
        runs = [
            sc.simulate(hinged(**spring), scheme, treatment, 0.01, until=1.0, kernels=kernels)
            for kernels in KERNELS
        ]
        assert_allclose(*(run["joint/hinge/angle"] for run in runs), rtol=0, atol=1e-9)


def test_equilibria_and_modes_with_forces_of_springs():
    """2 e + e^3 = -3 under a function; a table has the slope of its piece."""
    path = sc.static(hinged(force=lambda e, v, t: 2.0 * e + e**3 + 3.0 * t))
    assert path["joint/hinge/angle"][-1] == pytest.approx(-1.0)
    model = hinged(force=sc.Table([-1, 0, 2], [-8, -2, 2]), neutral=-0.5)
    path = sc.static(model)
    assert path["joint/hinge/angle"][-1] == pytest.approx(0.5)
    assert_allclose(sc.modes(model, path, 1).frequencies, 0.25 / np.pi)


def test_forces_on_rotation_vectors_take_three_numbers():
    model = sc.Model()
    body = model.add("body", sc.RigidBody.box(3.0, (1, 1, 1)))
    ball = model.add("ball", sc.JointSpherical(sc.ground((0, 0, 0)), body.at((0, 0, 0))))
    model.add("spring", sc.JointSpringDamper(ball, force=lambda e, v, t: 2.0 * e + 0 * v))
    assert_allclose(sc.modes(model, count=3).frequencies, 1 / np.pi)


@pytest.mark.parametrize(
    ("text", "spring"),
    [
        ("both zero", {}),
        ("takes no force", {"kind": sc.Cable, "stiffness": 1.0, "force": duffing}),
        ("force = 3.0, expected a function", {"force": 3.0}),
        ("force = RampLinear.*, expected", {"force": sc.RampLinear(0, 1)}),
        ("complex128, expected", {"force": lambda e, v, t: 1j * e}),
        ("derivatives", {"force": lambda e, v, t: abs(e)}),
    ],
)
def test_wrong_forces_of_springs_are_named_before_a_run(text, spring):
    with pytest.raises(sc.InputError, match=f"^(spring|cable).*: .*{text}"):
        on_a_spring(**spring)[0].freeze()


@pytest.mark.parametrize(
    "gradient",
    [lambda x: 9.0 * np.real(x), lambda x: 9.0 * np.real(x) + 0 * x],
)
def test_gradients_need_not_take_complex_numbers(gradient):
    model = sc.Model()
    bob = model.add("bob", sc.MassPoint(1.0, velocity=(1.0, 0, 0)))
    model.add(
        "well", sc.Force(bob.place(), energy=lambda x: 4.5 * (x * x).sum(), derivative=gradient)
    )
    assert_allclose(sc.modes(model, count=3).frequencies, 3 / (2 * np.pi), rtol=1e-9)


def test_a_force_on_a_sum_of_vectors():
    """A spring from the middle of two balls to a third."""
    model = sc.Model()
    balls = [
        model.add(f"ball {k}", sc.MassPoint(1.0, position=(k, k**2, 0), velocity=(0, 0, k)))
        for k in range(3)
    ]
    a, b, c = (sc.point(ball.place()) for ball in balls)
    r = -(np.float64(2.0) * c - (a + b)) / 2
    model.add("spring", sc.Force(r, energy=lambda r: 2.0 * (r * r).sum()))
    run = sc.simulate(model, sc.EnergyMomentum(), sc.NullSpace(), 0.01, until=1.0)
    x = [run.position(ball.place()) for ball in balls]
    stored = 2.0 * (((x[0] + x[1]) / 2 - x[2]) ** 2).sum(1)
    assert_allclose(run["coupling_energy"], stored, rtol=1e-12)
    with pytest.raises(sc.InputError, match="expected Expression"):
        a - balls[0].place()
