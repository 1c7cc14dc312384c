"""Forces with a memory, sampled laws and servos: closed forms, scipy, restarts, both kernels."""

import numpy as np
import pytest
from helpers_schemes import KINDS, treatments
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp

import skfem_cosserat as sc
from skfem_cosserat.integrators import Stepper

KERNELS = "numpy", "numba"
MASS, KP, KD, KI = 2.0, 30.0, 4.0, 20.0


def slider(law, memory=None):
    """A mass point that a force moves along x."""
    model = sc.Model()
    ball = model.add("ball", sc.MassPoint(MASS))
    model.add("force", sc.Force(ball.place(), law, memory=memory))
    return model


def pid(x, v, t, z):
    error = np.array([1.0, 0, 0]) - x
    return KP * error - KD * v + KI * z, error


def run(model, step, until=1.0, scheme=None, treatment=None, kernels="auto", start=None):
    methods = scheme or sc.EnergyMomentum(), treatment or sc.NullSpace(), step
    return sc.simulate(model, *methods, until=until, kernels=kernels, start=start)


def exact(rates, start, until):
    return solve_ivp(
        rates, (0, until), start, method="DOP853", rtol=1e-12, atol=1e-13, max_step=0.01
    ).y[:, -1]


#: energy-decaying leaves laws alone: here it is energy-momentum
ALL = [each for each in (*KINDS, sc.Explicit()) if not isinstance(each, sc.EnergyDecaying)]


@pytest.mark.parametrize("scheme", ALL, ids=lambda each: each.name)
def test_an_integral_converges_with_the_scheme(scheme):
    """Position and memory, against a Runge-Kutta method."""

    def rates(t, y):
        return [y[1], (KP * (1 - y[0]) - KD * y[1] + KI * y[2]) / MASS, 1 - y[0]]

    end = exact(rates, [0.0, 0.0, 0.0], 1.0)
    treatment = sc.Multipliers() if isinstance(scheme, sc.Explicit) else sc.NullSpace()
    errors = []
    for step in (0.04, 0.02):
        history = run(slider(pid, np.zeros(3)), step, scheme=scheme, treatment=treatment)
        errors.append(np.hypot(history["q"][-1, 0] - end[0], history["turns"][-1, 0] - end[2]))
    assert np.log2(errors[0] / errors[1]) == pytest.approx(scheme.order, abs=0.15)


@pytest.mark.parametrize("kernels", KERNELS)
def test_hysteresis_follows_its_rate(kernels):
    """A Bouc-Wen element, whose memory's rate depends on the memory: order 2, and it dissipates."""

    def law(x, v, t, z):
        rate = 3.0 * v - 2.0 * np.sqrt(v * v + 1e-4) * z - 1.0 * v * np.sqrt(z * z + 1e-4)
        return np.array([3.0, 0, 0]) * np.sin(4 * t) - 5.0 * x - 10.0 * z, rate

    def rates(t, y):
        x, v, z = y
        by_z = 3.0 * v - 2.0 * np.sqrt(v * v + 1e-4) * z - 1.0 * v * np.sqrt(z * z + 1e-4)
        return [v, (3.0 * np.sin(4 * t) - 5.0 * x - 10.0 * z) / MASS, by_z]

    end = exact(rates, [0.0, 0.0, 0.0], 1.0)
    found = [run(slider(law, np.zeros(3)), h, kernels=kernels) for h in (0.01, 0.005)]
    errors = [abs(each["q"][-1, 0] - end[0]) for each in found]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.1)
    assert found[0].meta["turns"] == [f"force/memory/{k}" for k in range(3)]
    assert abs(found[1]["energy_balance"]).max() < 1e-11


@treatments
def test_a_memory_is_part_of_states(treatment):
    """A run that goes on from the middle is the run as a whole, with all kernels."""
    whole = run(slider(pid, np.zeros(3)), 0.01, treatment=treatment)
    for kernels in KERNELS:
        first = run(slider(pid, np.zeros(3)), 0.01, 0.5, treatment=treatment, kernels=kernels)
        model = slider(pid, np.zeros(3))
        start = sc.restart(model, first, sc.EnergyMomentum(), 0.01)
        second = run(model, 0.01, treatment=treatment, kernels=kernels, start=start)
        assert_allclose(second["q"][-1], whole["q"][-1], rtol=0, atol=1e-13)
        assert_allclose(second["turns"], whole["turns"][50:], rtol=0, atol=1e-13)


# -- sampled laws ----------------------------------------------------------------------------------

PERIOD = 0.05


def sampled(x, v, t):
    return KP * (np.array([1.0, 0, 0]) - x) - KD * v


def held(count):
    """Position after so many periods with the force held in each."""
    x = v = 0.0
    for _ in range(count):
        a = (KP * (1 - x) - KD * v) / MASS
        x, v = x + PERIOD * v + a * PERIOD**2 / 2, v + PERIOD * a
    return x


@pytest.mark.parametrize("kernels", KERNELS)
@pytest.mark.parametrize("step", [PERIOD, 0.02, 0.03, sc.StepControl(1e-3)])
def test_a_sampled_law_is_held_between_its_instants(step, kernels):
    """Steps end at the instants, whatever their size: the motion is that in closed form."""
    law = sc.Controller(PERIOD, sampled)
    history = run(slider(law), step, kernels=kernels)
    assert history["q"][-1, 0] == pytest.approx(held(20), abs=1e-12)
    for k in range(20):
        assert abs(history.times - k * PERIOD).min() < 1e-12
    middle = run(slider(law), step, 0.5 - 0.3 * PERIOD, kernels=kernels)
    if not isinstance(step, sc.StepControl):
        start = sc.restart(slider(law), middle, sc.EnergyMomentum(), step)
        rest = run(slider(law), step, kernels=kernels, start=start)
        assert rest["q"][-1, 0] == pytest.approx(held(20), abs=1e-12)


@pytest.mark.parametrize("kernels", KERNELS)
def test_loops_of_ones_own_sample_too(kernels):
    """However many steps are asked for in one go."""
    system = slider(sc.Controller(PERIOD, sampled)).freeze()
    methods = sc.EnergyMomentum(), sc.NullSpace(), PERIOD / 2
    stepper = Stepper(system, *methods, kernels=kernels)
    state = sc.initial_state(system)
    while state.index < 40:
        state = stepper.advance_block(state, 40 - state.index).state
    assert state.q[0] == pytest.approx(held(20), abs=1e-12)


@pytest.mark.parametrize("scheme", [sc.EnergyMomentum(), sc.GeneralizedAlpha(0.8)])
def test_schemes_start_anew_where_a_law_is_sampled(scheme):
    """Against a pendulum on a sampled torque, integrated from instant to instant."""
    model = sc.Model()
    arm = model.add("arm", sc.RigidBody.box(1.0, (1.0, 0.1, 0.1), position=(0.5, 0, 0)))
    foot = sc.ground((0, 0, 0)), arm.at((0, 0, 0))
    hinge = model.add("hinge", sc.JointRevolute(*foot, axis=(0, 0, 1)))
    model.add("weight", sc.LoadGravity((0, -9.81, 0)))
    law = sc.Controller(PERIOD, lambda x, v, t: 40.0 * (0.5 - x) - 3.0 * v)
    model.add("motor", sc.Force(hinge, law))
    inertia, state = (1.01 / 12 + 0.25), np.zeros(2)
    for _ in range(10):
        torque = 40.0 * (0.5 - state[0]) - 3.0 * state[1]

        def rates(t, y, torque=torque):
            return [y[1], (torque - 0.5 * 9.81 * np.cos(y[0])) / inertia]

        state = exact(rates, state, PERIOD)
    ends = [run(model, PERIOD / k, 0.5, scheme)["joint/hinge/angle"][-1] for k in (5, 10)]
    errors = abs(np.array(ends) - state[0])
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.15)


def test_events_take_a_servo_away_and_bring_it():
    """Its memory is kept by its name; the run goes on."""

    def scene(servo):
        model = sc.Model()
        body = model.add("arm", sc.RigidBody.box(1.0, (1, 0.1, 0.1), position=(0.5, 0, 0)))
        foot = sc.ground((0, 0, 0)), body.at((0, 0, 0))
        hinge = model.add("hinge", sc.JointRevolute(*foot, axis=(0, 0, 1)))
        if servo:
            model.add("servo", sc.JointServo(hinge, 50.0, 5.0, ki=20.0, reference=1.0))
        return model

    both = scene(True), scene(False)
    for first, second in (both, both[::-1]):
        event = sc.Event(sc.ConditionTime(0.1), lambda t, view, then=second: then)
        run = sc.EnergyMomentum(), sc.NullSpace(), 0.01
        history = sc.simulate(first, *run, until=0.2, events=[event])
        assert history.times[-1] == 0.2 and history.meta["status"] == "completed"
        rate = history["joint/hinge/angle_rate"]
        still = slice(12, None) if first is both[0] else slice(0, 11)
        assert np.ptp(rate[still]) < 1e-9 < abs(np.ptp(rate))


def test_a_sampled_law_keeps_a_state():
    """A filter of the position: what the function gives is there at the next instant."""

    def law(x, v, t, z):
        return KP * (1.0 - z) - KD * v, 0.5 * z + 0.5 * x

    model = slider(sc.Controller(PERIOD, law), memory=np.zeros(3))
    x, v, z = np.zeros((3, 3))
    for _ in range(20):
        force, z = law(x, v, 0, z)
        x, v = x + PERIOD * v + PERIOD**2 / 2 * force / MASS, v + PERIOD * force / MASS
    assert_allclose(run(model, 0.02)["q"][-1], x, rtol=0, atol=1e-12)

    counting = slider(sc.Controller(PERIOD, lambda x, v, t, z: (0 * x, z + 1)), memory=0.0)
    assert run(counting, 0.02)["turns"][-1, -1] == 20


@pytest.mark.parametrize(("share", "grows"), [(0.98, False), (1.02, True)])
def test_the_limit_of_a_sampled_controller(share, grows):
    """An arm of inertia J, torque -kp q - kd q' each millisecond: stable up to kd = 2 J/T."""
    model = sc.Model()
    arm = model.add("arm", sc.RigidBody.box(3.0, (1.0, 0.1, 0.1), position=(0.5, 0, 0)))
    foot = sc.ground((0, 0, 0)), arm.at((0, 0, 0))
    hinge = model.add("hinge", sc.JointRevolute(*foot, axis=(0, 0, 1)))
    period, inertia = 1e-3, 3.0 * (1.0 + 0.01) / 12 + 3.0 * 0.25
    kd, kp = share * 2 * inertia / period, 1e3
    law = sc.Controller(period, lambda x, v, t: kp * (0.01 - x) - kd * v)
    model.add("motor", sc.Force(hinge, law))
    jumps = abs(np.diff(run(model, period, 0.1)["joint/hinge/angle_rate"]))
    assert (jumps[-1] > 10 * jumps[1]) if grows else (jumps[-1] < 0.1 * jumps[1])


# -- servos ----------------------------------------------------------------------------------------


def arm(step=1e-3, until=0.5, gravity=0.0, flexible=True, **options):
    """An arm of 1 m on a servo: kp = 100 N m, kd = 1 N m s."""
    kernels, treatment, scheme = (
        options.pop(name, default)
        for name, default in (("kernels", "auto"), ("treatment", None), ("scheme", None))
    )
    model = sc.Model()
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 3, name="arm")
    section = sc.SectionTube(0.02, 0.018, sc.Material(E=70e9, nu=0.3, rho=2700))
    if not flexible:
        section = sc.Section([1e7, 1e7, 1e7, 1e5, 1e5, 1e5], mass=0.65, inertia=(6e-5, 6e-5))
    beam = model.add("arm", sc.Beam(mesh, section, director=(0, 0, 1)))
    foot = sc.ground((0, 0, 0)), beam.node("arm.start")
    hinge = model.add("hinge", sc.JointRevolute(*foot, axis=(0, 0, 1)))
    servo = model.add("servo", sc.JointServo(hinge, **{"kp": 100.0, "kd": 1.0, **options}))
    if gravity:
        model.add("gravity", sc.LoadGravity((0, -gravity, 0)))
    assert servo.kp == 100
    return model, run(model, step, until, scheme, treatment, kernels)


def moved(t):
    """A reference from 0 to 0.5 rad in 0.2 s."""
    return 0.5 * np.sin(np.pi * min(t, 0.2) / 0.4) ** 2


OPTIONS = ({}, {"limit": 12.0}, {"ki": 200.0}, {"ki": 200.0, "limit": 12.0})


@pytest.mark.parametrize("options", OPTIONS, ids=str)
def test_a_servo_moves_a_flexible_arm(options):
    """It settles, the energy balance is closed, and all kernels and treatments agree."""
    found = arm(until=0.2, reference=moved, kernels="numba", **options)[1]
    assert abs(found["energy_balance"]).max() < 1e-10
    for kernels, treatment in zip(KERNELS, (sc.Multipliers(), sc.NullSpace()), strict=True):
        given = {"kernels": kernels, "treatment": treatment, "reference": moved, **options}
        other = arm(until=0.03, **given)[1]
        assert_allclose(other["q"], found["q"][:31], rtol=0, atol=1e-10)
        if "ki" in options:
            assert_allclose(other["turns"], found["turns"][:31], rtol=0, atol=1e-10)
    settled = arm(step=5e-3, until=8.0, reference=0.5, kernels="numba", **options)[1]
    assert settled["joint/hinge/angle"][-1] == pytest.approx(0.5, abs=2e-3)
    largest = abs(settled["coupling/servo/force"]).max()
    assert largest < 12.5 if "limit" in options else largest > 20


@pytest.mark.parametrize("options", OPTIONS[:3:2], ids=str)
def test_a_servo_is_of_second_order(options):
    """The reference and its rate are taken by their means."""
    given = {"until": 0.3, "reference": moved, "kernels": "numba", **options}
    runs = [arm(1e-3 / 2**k, **given)[1]["q"][:: 10 * 2**k] for k in (0, 1, 2, 5)]
    errors = [np.linalg.norm(each - runs[-1]) for each in runs[:-1]]
    assert_allclose(np.log2(np.divide(errors[:-1], errors[1:])), 2.0, rtol=0, atol=0.15)


def test_an_integral_takes_the_load_of_a_servo():
    """Under gravity the angle is off by the torque over kp; with an integral it is not."""
    torque = 0.65 * 9.81 * 0.5
    model, _ = arm(until=0.01, gravity=9.81, flexible=False)
    assert sc.static(model)["joint/hinge/angle"][-1] == pytest.approx(-torque / 100, rel=2e-3)
    given = {"step": 5e-3, "until": 6.0, "gravity": 9.81, "flexible": False, "kd": 10.0}
    given["kernels"] = "numba"
    _, without = arm(**given)
    _, history = arm(ki=200.0, **given)
    assert without["joint/hinge/angle"][-1] == pytest.approx(-torque / 100, rel=2e-3)
    assert abs(history["joint/hinge/angle"][-1]) < 1e-5
    assert history["coupling/servo/force"][-1] == pytest.approx(-torque, rel=1e-3)
    assert history["turns"][-1, -1] * 200 == pytest.approx(torque, rel=1e-3)


def test_arguments_are_checked():
    body = sc.RigidBody.box(1.0, (1, 1, 1))
    sides = sc.ground((0, 0, 0)), body.at((0, 0, 0))
    hinge, ball = sc.JointRevolute(*sides, axis=(1, 0, 0)), sc.JointSpherical(*sides)
    for make, text in (
        (lambda: sc.JointServo(hinge, -1.0, 0), "kp = -1.0"),
        (lambda: sc.JointServo(hinge, 0, 0, ki=1), "both zero"),
        (lambda: sc.JointServo(hinge, 1, 0, limit=0), "limit = 0"),
        (lambda: sc.JointServo(hinge, 1, 0, reference="a"), "reference = 'a'"),
        (lambda: sc.JointServo(ball, 1, 0), "rotation vector"),
        (lambda: sc.Controller(0.0, sampled), "period = 0.0"),
        (lambda: sc.Controller(1.0, 3), "function = 3"),
        (lambda: sc.Force(body.at((0, 0, 0)), energy=sampled, memory=0.0), "memory"),
        (lambda: sc.Force(body.at((0, 0, 0)), sampled, memory=[np.nan]), "memory = "),
    ):
        with pytest.raises(sc.InputError, match=text):
            make()
    wrong = slider(lambda x, v, t, z: (x, np.zeros(2)), np.zeros(3))
    with pytest.raises(sc.InputError, match=r"law gives an array \(2,\) of float64"):
        run(wrong, 0.1)
    failing = slider(sc.Controller(0.1, lambda x, v, t: x * (np.nan if t > 0.25 else 0.0)))
    with pytest.raises(sc.InputError, match=r"controller is .*not finite, at t = 0\.3") as caught:
        run(failing, 0.1)
    assert len(caught.value.history) == 4
