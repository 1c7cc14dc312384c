"""Shaken supports, driven rotation, spin-up of a beam, work of a drive, contradictions."""

import numpy as np
import pytest
from helpers_scenes import TENSOR

import skfem_cosserat as sc

INTEGRATORS = (sc.Variational, sc.EnergyMomentum)
TREATMENTS = (sc.NullSpace, sc.Multipliers)
integrators = pytest.mark.parametrize("integrator", INTEGRATORS)
treatments = pytest.mark.parametrize("treatment", TREATMENTS)


def inner(history, name):
    """A reaction at all steps that have one (the last state may not)."""
    values = history[name]
    return values[np.isfinite(values).all(axis=1)]


@pytest.mark.slow
@integrators
@treatments
def test_bob_at_rest_in_an_accelerated_frame(integrator, treatment):
    """Support with x = a t^2/2: the string leans by a/g and carries m |g - a|, exactly."""
    a, g, m = 3.0, 9.81, 0.7
    lean = np.array([-a, 0, -g]) / np.hypot(a, g)
    shake = sc.Motion(displacement=lambda t: (a * t**2 / 2, 0, 0))
    model = sc.Model()
    bob = model.add("bob", sc.MassPoint(m, 1.3 * lean))
    model.add("string", sc.JointDistance(sc.ground((0, 0, 0), shake), bob.place()))
    model.add("gravity", sc.LoadGravity((0, 0, -g)))
    history = sc.simulate(model.freeze(), integrator(), treatment(), 0.02, 1.0)
    path = 1.3 * lean + np.outer(a * history.times**2 / 2, (1, 0, 0))
    assert abs(history["q"] - path).max() < 1e-11
    assert abs(history["v"] - np.outer(a * history.times, (1, 0, 0))).max() < 1e-10
    tension = inner(history, "joint/string/force")
    assert abs(tension + m * np.hypot(a, g) * lean).max() < 1e-8
    assert abs(inner(history, "joint/string/moment")).max() < 1e-12


@pytest.mark.slow
@integrators
@treatments
def test_point_on_a_shaken_support(integrator, treatment):
    """It follows to rounding; the reaction is the second difference of the path."""
    shake = sc.Motion(displacement=lambda t: (0.1 * (1 - np.cos(3 * t)), t**3, -0.2 * t**2))
    m, h = 2.0, 0.02
    model = sc.Model()
    ball = model.add("ball", sc.MassPoint(m, (1, 2, 3)))
    model.add("pin", sc.JointSpherical(sc.ground((1, 2, 3), shake), ball.place()))
    system = model.freeze()
    assert system.unknowns == 0
    history = sc.simulate(system, integrator(), treatment(), h, 1.0)
    path = np.array([np.add((1, 2, 3), shake.displacement(t)) for t in history.times])
    assert abs(history["q"] - path).max() < 1e-13
    if integrator is sc.Variational:
        force = history["joint/pin/force"][1:-1]
        assert abs(force - m * np.diff(path, 2, axis=0) / h**2).max() < 1e-9
        t = history.times[1:-1]
        exact = m * np.c_[0.9 * np.cos(3 * t), 6 * t, np.full(len(t), -0.4)]
        assert abs(force - exact).max() < m * 0.1 * 81 * h**2 / 12 * 1.1


# -- rotation --------------------------------------------------------------------------------------


def carousel(rate, turn, joint, **options):
    """A body held off-centre by a support that turns about e3."""
    model = sc.Model()
    arm = np.array([0.5, 0.1, 0])
    body = sc.RigidBody(
        1.4,
        TENSOR,
        position=arm,
        angular_velocity=(0, 0, rate),
        velocity=np.cross((0, 0, rate), arm),
    )
    model.add("body", body)
    motion = sc.Motion(rotation=lambda t: (0, 0, turn(t)))
    place = sc.ground((0, 0, 0), motion)
    model.add("drive", joint(place, body.at((0, 0, 0)), **options))
    return model.freeze(), arm


@pytest.mark.slow
@integrators
@treatments
def test_steady_rotation_of_a_driven_body(integrator, treatment):
    """Circle, spin, centripetal force m w^2 r and gyroscopic moment, all in closed form."""
    w, h = 2.0, 0.01
    system, arm = carousel(w, lambda t: w * t, sc.JointFixed)
    history = sc.simulate(system, integrator(), treatment(), h, 1.0)
    angle = w * history.times
    c, s = np.cos(angle), np.sin(angle)
    x = np.c_[c * arm[0] - s * arm[1], s * arm[0] + c * arm[1], 0 * c]
    assert abs(history["q"][:, :3] - x).max() < 1e-13
    assert abs(history["v"][:, :3] - np.cross((0, 0, w), x)).max() < 1e-9  # rate by differences
    discrete = (2 - 2 * np.cos(w * h)) / h**2
    force, moment = (history[f"joint/drive/{k}"][1:-1] for k in ("force", "moment"))
    assert abs(force + 1.4 * discrete * x[1:-1]).max() < 1e-9
    assert abs(force + 1.4 * w**2 * x[1:-1]).max() < 5 * h**2
    # dL/dt = w x L about the centre, carried by the force's lever and the moment about the pin
    R = np.zeros((len(c), 3, 3))
    R[:, 0, 0] = R[:, 1, 1] = c
    R[:, 1, 0], R[:, 0, 1], R[:, 2, 2] = s, -s, 1
    L = R @ TENSOR @ (0, 0, w)
    rate = np.cross((0, 0, w), L)
    assert abs(moment - rate[1:-1]).max() < 20 * h**2
    assert abs(rate).max() > 0.1


@pytest.mark.slow
@integrators
@treatments
def test_driven_angular_acceleration(integrator, treatment):
    """theta = alpha t^2/2 from rest: the moment about the axis is J alpha, to second order."""
    alpha = 3.0
    errors = []
    for steps in (25, 50, 100):
        system, arm = carousel(0.0, lambda t: alpha * t**2 / 2, sc.JointFixed)
        history = sc.simulate(system, integrator(), treatment(), 1 / steps, 1.0)
        J = TENSOR[2, 2] + 1.4 * arm @ arm
        moment = history["joint/drive/moment"][1:-1]
        errors.append(abs(moment[:, 2] - J * alpha).max())
    assert errors[-1] < 1e-2 * J * alpha
    assert 3.5 < errors[0] / errors[1] < 4.5
    assert 3.5 < errors[1] / errors[2] < 4.5


@pytest.mark.slow
@integrators
@treatments
def test_turning_axis_of_a_hinge(integrator, treatment):
    """The hinge's axis turns with the ground; about it the body stays free (no torque)."""
    w = 1.5
    model = sc.Model()
    body = sc.RigidBody(1.0, (0.3, 0.4, 0.5), angular_velocity=(0, 0, w))
    model.add("body", body)
    place = sc.ground((0, 0, 0), sc.Motion(rotation=lambda t: (0, 0, w * t)))
    model.add("hinge", sc.JointRevolute(place, body.at((0, 0, 0)), (1, 0, 0)))
    history = sc.simulate(model.freeze(), integrator(), treatment(), 0.02, 1.0)
    angle = w * history.times
    axis = np.c_[np.cos(angle), np.sin(angle), 0 * angle]
    assert abs(history["q"][:, 3:6] - axis).max() < 1e-12
    torque = (history["joint/hinge/moment"] * axis).sum(1)
    assert abs(torque[np.isfinite(torque)]).max() < 1e-9


@pytest.mark.slow
@pytest.mark.parametrize(
    "integrator", [sc.EnergyMomentum, pytest.param(sc.Variational, marks=pytest.mark.slow)]
)
def test_spun_up_beam_reaches_its_steady_stretch(integrator):
    """Slow spin-up of a stiff-in-bending beam; stretch L (tan(kL)/(kL) - 1), k = w (m/EA)^(1/2)."""
    L, EA, mass, w, T = 1.0, 400.0, 1.0, 6.0, 4.0
    # midpoints of turning directors are shorter by 1 - cos(w h/2): strain of the variational scheme
    h = 0.01 if integrator is sc.EnergyMomentum else 0.004
    mesh = sc.MeshCurve.init_line((0, 0, 0), (L, 0, 0), 3, "beam")
    section = sc.Section([4e3, 4e3, EA, 300, 300, 300], mass=mass, inertia=(0.02, 0.02))

    def turn(t):
        if t >= T:
            return w * (t - T / 2)
        return w * (t**2 / (2 * T) + T / (4 * np.pi**2) * (np.cos(2 * np.pi * t / T) - 1))

    model = sc.Model()
    beam = model.add("beam", sc.Beam(mesh, section, order=2))
    place = sc.ground((0, 0, 0), sc.Motion(rotation=lambda t: (0, 0, turn(t))))
    model.add("drive", sc.JointFixed(place, beam.node("beam.start")))
    system = model.freeze()
    tip = system.offset(beam.node("beam.end"))
    history = sc.simulate(system, integrator(), sc.Multipliers(), h, T + 1.5, every=5)
    after = history.times > T
    x = history["q"][after, tip : tip + 3]
    k = w * np.sqrt(mass / EA)
    steady = L * (np.tan(k * L) / (k * L) - 1)
    stretch = np.linalg.norm(x, axis=1) - L
    assert stretch.mean() == pytest.approx(steady, rel=2e-2)
    assert np.ptp(stretch) < 0.1 * steady
    # and the root carries the centripetal force of the whole beam, EA (1/cos(kL) - 1)
    force = history["joint/drive/force"][after][:-1]
    assert np.linalg.norm(force, axis=1).mean() == pytest.approx(
        EA * (1 / np.cos(k * L) - 1), rel=2e-2
    )


# -- work ------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize(
    ("integrator", "treatment"),
    [
        (sc.EnergyMomentum, sc.NullSpace),
        pytest.param(sc.Variational, sc.NullSpace, marks=pytest.mark.slow),
        pytest.param(sc.EnergyMomentum, sc.Multipliers, marks=pytest.mark.slow),
        pytest.param(sc.Variational, sc.Multipliers, marks=pytest.mark.slow),
    ],
)
def test_work_of_the_drive_is_the_energy_gained(integrator, treatment):
    """Integral of reaction power F.v + M.w over the drive's motion, with gravity; O(h^2)."""
    errors = []
    for steps in (50, 100, 200):
        model = sc.Model()
        arm = np.array([0.4, 0, 0.1])
        body = model.add("body", sc.RigidBody(1.4, TENSOR, position=arm))
        bob = model.add("bob", sc.MassPoint(0.6, (0.9, 0.3, 0)))
        axis = np.array([0.0, 0.6, 0.8])
        motion = sc.Motion(
            displacement=lambda t: (0.3 * t**2, 0.2 * t**3, 0),
            rotation=lambda t: 1.5 * t**2 * axis,  # noqa: B023 - the same in each pass
        )
        place = sc.ground((0, 0, 0), motion)
        model.add("drive", sc.JointFixed(place, body.at((0, 0, 0))))
        model.add("string", sc.JointDistance(body.at((0.6, 0, 0)), bob.place()))
        model.add("gravity", sc.LoadGravity((0, 0, -9.81)))
        h = 1 / steps
        history = sc.simulate(model.freeze(), integrator(), treatment(), h, 1.0 + h)
        total = history["energy_projected"] + history["external"]
        t = history.times[: steps + 1]
        velocity = np.c_[0.6 * t, 0.6 * t**2, 0 * t]
        omega = np.outer(3 * t, axis)
        force, moment = (history[f"joint/drive/{k}"][: steps + 1] for k in ("force", "moment"))
        power = (force * velocity + moment * omega).sum(1)
        work = np.trapezoid(power, dx=h)
        gained = total[steps] - total[0]
        errors.append(abs(work - gained))
        assert abs(gained) > 1.0
    assert errors[-1] < 2e-3
    assert 3.4 < errors[0] / errors[1] < 4.6
    assert 3.7 < errors[1] / errors[2] < 4.3


# -- contradictions --------------------------------------------------------------------------------


def driven(motion, joint=sc.JointFixed, **body):
    model = sc.Model()
    item = model.add("body", sc.RigidBody(1.0, (1, 1, 1), **body))
    model.add("drive", joint(sc.ground((0, 0, 0), motion), item.at((0, 0, 0))))
    return model


@pytest.mark.parametrize(
    ("motion", "words"),
    [
        (sc.Motion(displacement=lambda t: (0.1, 0, 0)), r"'drive'.*0\.1 m apart"),
        (sc.Motion(rotation=lambda t: (0, 0.2 + t, 0)), r"'drive'.*rotation is not zero"),
    ],
)
def test_place_at_the_start_contradicts(motion, words):
    with pytest.raises(sc.InputError, match=words):
        driven(motion).freeze()


@pytest.mark.parametrize(
    "motion",
    [
        sc.Motion(displacement=lambda t: (0, 2 * t, 0)),
        sc.Motion(rotation=lambda t: (0, 0, np.sin(t))),
    ],
)
def test_velocity_at_the_start_contradicts(motion):
    system = driven(motion).freeze()
    with pytest.raises(sc.InputError, match=r"'drive'.*prescribed motion.*project"):
        sc.simulate(system, sc.Variational(), sc.NullSpace(), 0.01, 0.1)
    start = sc.initial_state(system, v=sc.project(system, system.q0, system.v0))
    sc.simulate(system, sc.Variational(), sc.NullSpace(), 0.01, 0.1, start=start)


def test_velocity_that_fits_is_taken():
    motion = sc.Motion(lambda t: (0, 2 * t, 0), lambda t: (0, 0, np.sin(t)))
    system = driven(motion, velocity=(0, 2, 0), angular_velocity=(0, 0, 1)).freeze()
    history = sc.simulate(system, sc.EnergyMomentum(), sc.Multipliers(), 0.01, 0.1)
    assert history["hidden_violation"].max() < 1e-9


def test_a_spherical_joint_does_not_feel_the_rotation():
    system = driven(sc.Motion(rotation=lambda t: (0, 0, t)), sc.JointSpherical).freeze()
    history = sc.simulate(system, sc.Variational(), sc.NullSpace(), 0.01, 0.1)
    assert abs(history["q"] - history["q"][0]).max() == 0
