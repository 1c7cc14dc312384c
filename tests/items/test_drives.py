"""Prescribed motion of joints and of the ground: torque, work, dead points, contradictions."""

from __future__ import annotations

from functools import cache, partial

import numpy as np
import pytest
from helpers_scenes import (
    JOINTS,
    TENSOR,
    assert_constraints,
    assert_null_space,
    fitting,
    four_bar,
    rotation,
    seen,
    two_states,
)
from helpers_schemes import INTEGRATORS, TREATMENTS, integrators, treatments
from scipy.spatial.transform import Rotation
from test_closed_loops import PARALLELOGRAM, linkage
from test_tangents import TOLERANCE, Step, worst

import skfem_cosserat as sc

Z = (0, 0, 1.0)
#: What can be driven of each joint.
COORDINATES = {
    sc.JointRevolute: ("angle",),
    sc.JointCylindrical: ("displacement", "angle"),
    sc.JointPrismatic: ("displacement",),
    sc.JointPlanar: ("x", "y", "angle"),
    sc.JointUniversal: ("angle_a", "angle_b"),
    sc.JointPointOnLine: ("displacement",),
}
MOTIONS = (lambda t: 1.2 * t**2, lambda t: 0.5 * np.sin(3 * t) ** 2, lambda t: -0.8 * t**3)
kinds = pytest.mark.parametrize("kind", COORDINATES, ids=lambda kind: kind.type)


# -- every coordinate ------------------------------------------------------------------------------


def selections(kind):
    """Each coordinate alone, and all together."""
    names = COORDINATES[kind]
    return [(name,) for name in names] + ([names] if len(names) > 1 else [])


@cache
def scene(kind):
    """Every selection of coordinates driven, either way round, to a body and to the ground."""
    rng = np.random.default_rng(list(JOINTS).index(kind))
    model, driven = sc.Model(), []

    def body(name):
        x, R = rng.standard_normal(3), rotation(rng).T
        item = sc.RigidBody(1.5, TENSOR, center=(0.1, -0.2, 0.15), position=x, triad=R)
        return model.add(name, item)

    for names in selections(kind):
        for swap in (False, True):
            for on_body in (False, True):
                label = f"{'+'.join(names)} {swap} {on_body}"
                options, gap = fitting(kind, rng)
                x = rng.standard_normal(3)
                side = body(f"base {label}").at(x) if on_body else sc.ground(x)
                sides = [side, body(f"body {label}").at(x + gap)]
                joint = model.add(label, kind(*(sides[::-1] if swap else sides), **options))
                for name, motion in zip(names, MOTIONS, strict=False):
                    model.add(f"{name} of {label}", sc.JointDrive(joint, motion, name))
                    driven.append((joint, name, motion))
    model.add("gravity", sc.LoadGravity((0.3, 0.1, -9.81)))
    return model.freeze(), driven


def measured(system, joint, name, y):
    """A relative coordinate, from positions and rotations alone."""

    (xa, Ra), (xb, Rb) = (seen(system, place, y) for place in (joint.a, joint.b))
    r = Ra.T @ (xb - xa) - (joint.b.position - joint.a.position)
    turn = Ra.T @ Rb
    if name == "displacement":
        return r @ joint.axis
    if name in ("x", "y"):
        return r @ (joint.x if name == "x" else np.cross(joint.normal, joint.x))
    if name == "angle":
        axis = joint.normal if isinstance(joint, sc.JointPlanar) else joint.axis
        return Rotation.from_matrix(turn).as_rotvec() @ axis
    a, b = joint.axis_a, joint.axis_b  # turn = exp(alpha a) exp(beta b)
    c = np.cross(a, b)
    if name == "angle_a":
        return np.arctan2(c @ turn @ b, b @ turn @ b)
    return np.arctan2(a @ turn @ c, a @ turn @ a)


@kinds
def test_null_space_of_driven_trees(kind):
    """Each drive takes one unknown."""
    system, driven = scene(kind)
    joints = JOINTS[kind] * len(system.joints) + 6 * len(system.joints) // 2
    assert system.unknowns == joints - len(driven)
    y0, y1, nodal = two_states(system)
    for y in (y0, y1):
        assert_constraints(system, y)
        assert_null_space(system, y, nodal.fixed)


@pytest.mark.one_quick
@kinds
@integrators
@treatments
def test_tangent(kind, integrator, treatment):
    system, _ = scene(kind)
    step = Step(system, integrator, treatment, seed=2)
    assert worst(step.matrix(), step.derivative()) < TOLERANCE


@cache
def run(kind, integrator, treatment):
    system, _ = scene(kind)
    v = np.random.default_rng(4).standard_normal(system.n)
    start = sc.initial_state(system, v=sc.project(system, system.q0, v))
    return sc.simulate(system, integrator, treatment, 0.02, 0.3, start=start)


@pytest.mark.slow
@kinds
@integrators
def test_treatments_agree_and_follow_the_motion(kind, integrator):
    system, driven = scene(kind)
    one, two = (run(kind, integrator, treatment) for treatment in TREATMENTS)
    assert abs(one["q"] - two["q"]).max() < 1e-10
    size = abs(one["constraint_force"][:-1]).max()
    assert abs(one["constraint_force"] - two["constraint_force"])[:-1].max() < 1e-8 * size
    for history in (one, two):
        rows = [system.extend(q, t) for q, t in zip(history["q"], history.times, strict=True)]
        for joint, name, motion in driven:
            wanted = np.array([motion(t) for t in history.times])
            found = np.array([measured(system, joint, name, y) for y in rows])
            assert abs(found - wanted).max() < 2e-13, (joint.name, name)
            assert abs(history[f"joint/{joint.name}/{name}"] - wanted).max() < 2e-13


@pytest.mark.one_quick
@kinds
@treatments
def test_energy_balance(kind, treatment):
    """What the drives put in is what the scene gains, to round-off with energy-momentum."""
    history = run(kind, INTEGRATORS[1], treatment)
    scale = abs(history["energy"]).max() + abs(history["work_drives"]).max()
    assert abs(history["energy_balance"]).max() < 1e-12 * scale
    assert np.ptp(history["work_drives"]) > 0.01


# -- torque and power ------------------------------------------------------------------------------


@pytest.mark.slow
@integrators
@treatments
def test_torque_of_a_ramped_speed(integrator, treatment):
    """J alpha about the axis of a hinge off the centre; second order.

    With energy-momentum the torque alternates: the mean of neighbouring midpoints is the node's.
    """
    alpha, axis = 3.0, np.array([0, 0.6, 0.8])
    c = np.array([0.6, 0.3, 0.2])
    J = axis @ (TENSOR + 1.4 * (c @ c * np.eye(3) - np.outer(c, c))) @ axis
    errors = []
    for h in (0.02, 0.01):
        model = sc.Model()
        body = sc.RigidBody(1.4, TENSOR, position=(0.5, 0.1, 0.2), center=(0.1, 0.2, 0))
        model.add("body", body)
        hinge = sc.JointRevolute(body.at((0, 0, 0)), sc.ground((0, 0, 0)), axis)
        model.add("hinge", hinge)
        model.add("motor", sc.JointDrive(hinge, lambda t: -alpha * t**2 / 2))  # from a to b
        history = sc.simulate(model, integrator, treatment, h, 0.5)
        torque = -history["joint/motor/moment"][:-1] @ axis
        assert abs(history["joint/motor/force"])[:-1].max() < 1e-9
        assert abs(history["joint/hinge/moment"][:-1] @ axis).max() < 1e-9
        if integrator.name == "energy-momentum":
            torque = (torque[1:] + torque[:-1]) / 2
        errors.append(abs(torque[1:] / (J * alpha) - 1).max())
    assert errors[1] < 5e-3
    assert errors[1] < 1e-10 or 3.5 < errors[0] / errors[1] < 4.5


@integrators
@treatments
def test_force_along_a_slide(integrator, treatment):
    """m (a + g) along the slide, and the joint itself carries nothing along it."""
    n = np.array([0.6, 0, 0.8])
    model = sc.Model()
    body = model.add("body", sc.RigidBody(2.0, TENSOR, position=(1, 1, 0)))
    slide = model.add("slide", sc.JointPrismatic(sc.ground((0, 0, 0)), body.at(0.5 * n), n))
    model.add("ram", sc.JointDrive(slide, lambda t: 0.75 * t**2))
    model.add("gravity", sc.LoadGravity((0, 0, -9.81)))
    history = sc.simulate(model.freeze(), integrator, treatment, 0.02, 0.5)
    force = history["joint/ram/force"][1:-1]
    assert abs(force - 2.0 * (1.5 + 9.81 * 0.8) * n).max() < 1e-8
    assert abs(history["joint/slide/force"][1:-1] @ n).max() < 1e-8


# -- closed loops ----------------------------------------------------------------------------------

R, L, START = 0.4, 1.0, 0.7


def slider_crank(drive, joint="pin", start=START):
    """Crank, rod and slider in the xy plane; drives one of its joints."""
    A = np.zeros(3)
    B = R * np.array([np.cos(start), np.sin(start), 0])
    C = np.array([B[0] + np.sqrt(L**2 - B[1] ** 2), 0, 0])
    model = sc.Model()
    crank, rod, slider = (
        model.add(name, sc.RigidBody.box(mass, (0.1, 0.1, 0.1), position=x))
        for name, mass, x in (
            ("crank", 1.0, (A + B) / 2),
            ("rod", 2.0, (B + C) / 2),
            ("slider", 3.0, C),
        )
    )
    model.add("pin", sc.JointRevolute(sc.ground(A), crank.at(A), Z))
    model.add("big end", sc.JointRevolute(crank.at(B), rod.at(B), Z))
    model.add("small end", sc.JointRevolute(rod.at(C), slider.at(C), Z))
    model.add("guide", sc.JointPrismatic(sc.ground(A), slider.at(C), (1.0, 0, 0)))
    model.add("motor", sc.JointDrive(model[joint], drive))
    return model


def slider_of(angle):
    """Closed form: position of the slider over the crank's angle."""
    return R * np.cos(angle) + np.sqrt(L**2 - (R * np.sin(angle)) ** 2)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:balance of energy")  # oscillates with the variational scheme
@integrators
def test_slider_crank_with_a_driven_crank(integrator):
    """Mobility zero, no unknowns left: the closed form over three turns."""
    turn = lambda t: 10 * (1 - np.cos(4 * t))  # noqa: E731
    system = slider_crank(turn).freeze()
    assert system.counts() == {"n": 36, "m": 39, "rank": 36, "unknowns": 0}
    assert sum(map(len, system.redundancies().values())) == 3
    forces = []
    for treatment in TREATMENTS:
        history = sc.simulate(system, integrator, treatment, 0.02, 0.8)
        forces.append(history["constraint_force"][:-1])
        angle = turn(history.times)
        assert angle.max() > 6 * np.pi
        x = history["q"][:, system.frame_place("slider")]
        assert abs(x - slider_of(START + angle)).max() < 1e-12
        assert abs(history["joint/pin/angle"] - angle).max() < 1e-12
        assert history["constraint_violation"].max() < 1e-13
        if integrator.name == "energy-momentum":
            assert abs(history["energy_balance"]).max() < 1e-10 * history["energy"].max()
    assert abs(forces[0] - forces[1]).max() < 1e-8 * abs(forces[0]).max()


@pytest.mark.slow
@pytest.mark.parametrize("which", range(4))
@integrators
def test_each_joint_of_a_four_bar_driven(which, integrator):
    """Also the one that closes the loop."""
    model = four_bar()
    model.add("motor", sc.JointDrive(model[f"pin {which}"], lambda t: 0.25 * np.sin(2 * t) ** 2))
    model.add("gravity", sc.LoadGravity((0, -9.81, 0)))
    system = model.freeze()
    assert system.unknowns == 0
    one, two = (sc.simulate(system, integrator, treatment, 0.02, 0.4) for treatment in TREATMENTS)
    assert abs(one["q"] - two["q"]).max() < 1e-12
    assert abs(one["q"] - one["q"][0]).max() > 0.1
    angles = np.array([one[f"joint/pin {k}/angle"] for k in range(4)])
    assert abs(angles[which] - 0.25 * np.sin(2 * one.times) ** 2).max() < 1e-13
    assert abs(angles.sum(0)).max() < 1e-12  # around the loop


# such steps are much too large
@pytest.mark.one_quick
@pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")
@pytest.mark.parametrize("rate", [1.0, 2.0, 3.0, 7.0])
@integrators
@treatments
def test_steps_of_a_radian_and_more(rate, integrator, treatment):
    """Half a turn off the drive's constraint holds as well: multipliers must not go there.

    With steps this large they did, silently; now the step is tried again from where the drive is.
    """
    model = sc.Model()
    body = model.add("body", sc.RigidBody(1.0, TENSOR, position=(0.5, 0, 0)))
    hinge = model.add("hinge", sc.JointRevolute(sc.ground((0, 0, 0)), body.at((0, 0, 0)), Z))
    model.add("motor", sc.JointDrive(hinge, lambda t: rate * t**2))
    history = sc.simulate(model.freeze(), integrator, treatment, 1.0, 3.0)
    x, angle = history["q"][:, :3], rate * history.times**2
    wanted = 0.5 * np.c_[np.cos(angle), np.sin(angle), 0 * angle]
    assert abs(x - wanted).max() < 1e-13


# -- moving ground ---------------------------------------------------------------------------------


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
    history = sc.simulate(model.freeze(), integrator, treatment, 0.02, 0.5)
    path = 1.3 * lean + np.outer(a * history.times**2 / 2, (1, 0, 0))
    assert abs(history["q"] - path).max() < 1e-11
    tension = history["joint/string/force"][:-1]  # the last state may have none
    assert abs(tension + m * np.hypot(a, g) * lean).max() < 1e-8


@pytest.mark.slow
@integrators
@treatments
def test_steady_rotation_of_a_driven_body(integrator, treatment):
    """Circle, spin, centripetal force m w^2 r and gyroscopic moment, all in closed form."""
    w, h, arm, model = 2.0, 0.01, np.array([0.5, 0.1, 0]), sc.Model()
    speed = {"angular_velocity": (0, 0, w), "velocity": np.cross((0, 0, w), arm)}
    body = model.add("body", sc.RigidBody(1.4, TENSOR, position=arm, **speed))
    turning = sc.ground((0, 0, 0), sc.Motion(rotation=lambda t: (0, 0, w * t)))
    model.add("drive", sc.JointFixed(turning, body.at((0, 0, 0))))
    history = sc.simulate(model, integrator, treatment, h, 0.5)
    R = Rotation.from_rotvec(np.outer(w * history.times, Z)).as_matrix()
    x = R @ arm
    assert abs(history["q"][:, :3] - x).max() < 1e-13
    discrete = (2 - 2 * np.cos(w * h)) / h**2
    force, moment = (history[f"joint/drive/{k}"][1:-1] for k in ("force", "moment"))
    assert abs(force + 1.4 * discrete * x[1:-1]).max() < 1e-9
    # dL/dt = w x L about the centre, carried by the force's lever and the moment about the pin
    rate = np.cross((0, 0, w), R @ TENSOR @ (0, 0, w))
    assert abs(moment - rate[1:-1]).max() < 20 * h**2
    assert abs(rate).max() > 0.1


def driven(motion, joint=sc.JointFixed, **body):
    model = sc.Model()
    item = model.add("body", sc.RigidBody(1.0, (1, 1, 1), **body))
    model.add("drive", joint(sc.ground((0, 0, 0), motion), item.at((0, 0, 0))))
    return model


def test_velocity_at_the_start_contradicts():
    system = driven(sc.Motion(rotation=lambda t: (0, 0, np.sin(t)))).freeze()
    with pytest.raises(sc.InputError, match=r"'drive'.*prescribed motion.*project"):
        sc.simulate(system, sc.Variational(), sc.NullSpace(), 0.01, 0.1)
    start = sc.initial_state(system, v=sc.project(system, system.q0, system.v0))
    sc.simulate(system, sc.Variational(), sc.NullSpace(), 0.01, 0.1, start=start)


def test_a_spherical_joint_does_not_feel_the_rotation():
    system = driven(sc.Motion(rotation=lambda t: (0, 0, t)), sc.JointSpherical).freeze()
    history = sc.simulate(system, sc.Variational(), sc.NullSpace(), 0.01, 0.1)
    assert abs(history["q"] - history["q"][0]).max() == 0


# -- dead points -----------------------------------------------------------------------------------


def stopped(system, integrator, treatment, step, until):
    with pytest.raises(sc.Diverged) as caught:
        sc.simulate(system, integrator, treatment, step, until)
    return caught.value


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")  # ends at a dead point
@integrators
@treatments
def test_a_slider_that_is_pushed_beyond_its_reach(integrator, treatment):
    """It can go to R + L; the error says so, names the drive and the time."""
    reach = R + L - slider_of(START)
    speed = 0.5
    system = slider_crank(lambda t: speed * t**2, "guide").freeze()
    error = stopped(system, integrator, treatment, 0.01, 2.0)
    time = np.sqrt(reach / speed)
    assert error.time == pytest.approx(np.floor(time / 0.01) * 0.01, abs=1e-9)
    text = str(error)
    for word in (
        f"dead point at t = {time:.6g} s",
        "the drive 'motor'",
        f"displacement = {reach:.6g} m",
        "prismatic joint 'guide'",
    ):
        assert word in text, text
    assert len(error.history) == error.step
    assert error.history["constraint_violation"].max() < 1e-12


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")  # ends at a dead point
@treatments
def test_supports_that_are_pulled_apart(treatment):
    """No drive, but moving ground: two rods between supports that go away from each other."""
    model, left, mid, right = sc.Model(), (0, 0, 0), (1, -0.5, 0), (2, 0, 0)
    one, two = (model.add(name, sc.RigidBody.box(1.0, (1, 0.1, 0.1))) for name in ("one", "two"))
    away = sc.ground(right, sc.Motion(lambda t: (t**2, 0, 0)))
    model.add("left", sc.JointRevolute(sc.ground(left), one.at(left), Z))
    model.add("mid", sc.JointRevolute(one.at(mid), two.at(mid), Z))
    model.add("right", sc.JointRevolute(two.at(right), away, Z))
    error = stopped(model.freeze(), sc.Variational(), treatment, 0.02, 2.0)
    time = np.sqrt(2 * np.hypot(1, 0.5) - 2)
    for word in (f"dead point at t = {time:.6g} s", "prescribed motion of the ground", "'mid'"):
        assert word in str(error)


@treatments
def test_other_failures_are_not_called_dead_points(treatment):
    """Newton's method that may not iterate, on a driven loop beside a body that tumbles."""
    model = four_bar()
    model.add("motor", sc.JointDrive(model["pin 0"], lambda t: t**2))
    model.add("top", sc.RigidBody(1.0, TENSOR, position=(5, 5, 5), angular_velocity=(3, 2, 9)))
    settings = sc.NewtonSettings(iterations=1, damped_iterations=1)
    stepper = sc.Stepper(model.freeze(), sc.Variational(), treatment, 0.1, settings)
    start = sc.initial_state(stepper.system)
    with pytest.raises(sc.Diverged) as caught:
        stepper.advance(start)
    assert "dead point" not in str(caught.value)
    assert "no convergence in 1 iterations" in str(caught.value)


# -- contradictions --------------------------------------------------------------------------------


def refused(call, *words):
    with pytest.raises(sc.InputError) as caught:
        call()
    for word in words:
        assert word in str(caught.value), str(caught.value)


def two_cranks(first, second):
    """A parallelogram with both cranks driven."""
    model = linkage(PARALLELOGRAM, 0.9)
    model.add("left", sc.JointDrive(model["pin 0"], first))
    model.add("right", sc.JointDrive(model["pin 3"], second))
    return model


def test_two_drives_of_one_coordinate():
    model = slider_crank(lambda t: t**2)
    model.add("second", sc.JointDrive(model["pin"], lambda t: t**2))
    refused(model.freeze, "drive 'second'", "contradicts the drive 'motor'")


@pytest.mark.parametrize("factor", [1 + 1e-4, -1.0])
def test_two_cranks_with_different_motions(factor):
    model = two_cranks(lambda t: 2 * t**2, lambda t: -2 * factor * t**2)
    refused(model.freeze, "drive 'right'", "cannot follow the prescribed motion")


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")  # large steps
@integrators
@treatments
def test_two_cranks_with_the_same_motion(integrator, treatment):
    """Consistent drives are taken, and go through the flat positions together."""
    system = two_cranks(lambda t: -2 * t**2, lambda t: 2 * t**2).freeze()
    assert system.counts() == {"n": 36, "m": 40, "rank": 36, "unknowns": 0}
    history = sc.simulate(system, integrator, treatment, 0.02, 2.0)
    i = system.frame_place("coupler")
    assert abs(history["q"][:, i + 3 : i + 6] - (1, 0, 0)).max() < 1e-12
    assert history["joint/pin 0/angle"][-1] == pytest.approx(-8.0, abs=1e-12)


@pytest.mark.slow
@integrators
@treatments
def test_cranks_that_part_later(integrator, treatment):
    """Equal until 0.5 s: the run stops there and says why."""
    model = two_cranks(lambda t: -(t**2), lambda t: t**2 if t < 0.5 else t - 0.25)
    error = stopped(model.freeze(), integrator, treatment, 0.02, 2.0)
    assert error.time == pytest.approx(0.5)
    for word in (
        "prescribed motions contradict each other at t = 0.52 s",
        "the drive 'right' at angle = 0.27 rad",
    ):
        assert word in str(error)


# a dead point is a singular position
@pytest.mark.filterwarnings("ignore::skfem_cosserat.ModelWarning")
def test_a_drive_against_a_dead_point_from_the_start():
    """The slider in its dead point cannot be pushed on."""
    model = slider_crank(lambda t: t**2, "guide", start=0.0)
    refused(model.freeze, "drive 'motor'", "cannot follow the prescribed motion", "'guide'")


# -- bad input -------------------------------------------------------------------------------------

BALL = sc.RigidBody.sphere(1.0, 1.0)
HINGE = sc.JointRevolute(sc.ground((0, 0, 0)), BALL.at((0, 0, 0)), Z)
SLEEVE = sc.JointCylindrical(sc.ground((0, 0, 0)), BALL.at((0, 0, 0)), Z)
SOCKET = sc.JointSpherical(sc.ground((0, 0, 0)), BALL.at((0, 0, 0)))
ROD = sc.JointDistance(sc.ground((0, 0, 2)), BALL.at((0, 0, 0)))


@pytest.mark.parametrize(
    ("call", "text"),
    [
        (lambda: sc.JointDrive(BALL, np.sin), "drive.*RigidBody.*expected a joint"),
        (lambda: sc.JointDrive(HINGE, 3.0), "drive.*motion = 3.0.*function of time"),
        (lambda: sc.JointDrive(HINGE, np.sin, "x"), r"no 'x'.*\['angle'\]"),
        (lambda: sc.JointDrive(SLEEVE, np.sin), "which of its coordinates.*displacement"),
        (lambda: sc.JointDrive(SOCKET, np.sin), "cannot prescribe the rotation of a spherical"),
        (lambda: sc.JointDrive(ROD, np.sin), "distance joint"),
    ],
)
def test_bad_drives(call, text):
    with pytest.raises(sc.InputError, match=text):
        call()


def test_drives_that_do_not_fit_the_model():
    def model(motion):
        out = sc.Model()
        ball = out.add("ball", sc.RigidBody.sphere(1.0, 1.0))
        joint = sc.JointRevolute(sc.ground((0, 0, 0)), ball.at((0, 0, 0)), Z)
        out.add("motor", sc.JointDrive(out.add("hinge", joint), motion))
        return out

    def run(motion):
        sc.simulate(model(motion), sc.Variational(), sc.NullSpace(), 0.1, 1.0)

    refused(model(lambda t: 0.2 + t).freeze, "drive 'motor'", "angle = 0.2 rad", "t = 0", "'hinge'")
    refused(model(lambda t: float("nan")).freeze, "drive 'motor'", "nan")
    refused(model(lambda t: (t, t)).freeze, "drive 'motor'", "(0.0, 0.0)")
    refused(partial(run, lambda t: 0.5 * t), "drive 'motor'", "0.5", "project")
    late = partial(run, lambda t: t**2 if t < 0.45 else float("inf"))
    refused(late, "drive 'motor'", "inf", "0.45")
    strange = model(np.sin)
    strange.add("strange", sc.JointDrive(HINGE, np.sin))
    refused(strange.freeze, "drive 'strange'", "not in the model")


# -- motions that jump -----------------------------------------------------------------------------

#: until t = 0.1537 s at rest, then by 0.2: at once, or within some time
JUMPS = {
    "at the end of a step": lambda t: 0.2 * (t >= 0.1),
    "in a step": lambda t: 0.2 * (t > 0.1537),
    "from the start": lambda t: 0.2 * (t > 0),
    "in steps of a record": lambda t: 1e-3 * np.floor(t / 0.03),
}
STEEP = {
    "within 0.1 ns": lambda t: 0.2 * min(1.0, max(0.0, (t - 0.1537) / 1e-10)),
    "declared kinks": sc.FunctionOfTime(lambda t: max(0.0, 0.1 - abs(t - 0.2)), kinks=[0.1, 0.2]),
    "a radian a step": lambda t: 150 * t**2,
    "wrapped angle": lambda t: (40 * t**2) % (2 * np.pi),
    "a table": sc.Table([0, 0.1, 0.2], [0, 0, 0.3]),
}


def moved(motion, kind):
    """A body on a hinge or slide that is driven, or welded to ground that moves or turns."""
    model = sc.Model()
    body = model.add("body", sc.RigidBody.box(1.0, (0.1, 0.1, 0.1), position=(0.5, 0, 0)))
    place = body.at((0.5, 0, 0))
    if kind in ("displacement", "rotation"):
        own = sc.Motion(**{kind: lambda t: (0.0, motion(t), 0.0)})
        model.add("joint", sc.JointFixed(sc.ground((0.5, 0, 0), own), place))
        return model
    joint = model.add("joint", kind(sc.ground((0.5, 0, 0)), place, axis=Z))
    model.add("drive", sc.JointDrive(joint, motion))
    return model


@pytest.mark.one_quick
@pytest.mark.parametrize("kind", [sc.JointRevolute, sc.JointPrismatic, "displacement", "rotation"])
@treatments
@pytest.mark.parametrize("name", JUMPS)
def test_a_jump_is_refused(name, kind, treatment):
    """A jump has an infinite velocity: who jumps, when and how far; states before it are kept."""
    integrator = {
        "in a step": sc.GeneralizedAlpha(),
        "from the start": sc.Composition(sc.Variational(), 4),
    }.get(name, sc.EnergyMomentum())
    who = "drive 'drive'" if isinstance(kind, type) else "fixed joint 'joint'"
    with pytest.raises(sc.Diverged, match=rf"the {who} jumps at t = .*RampSmooth") as found:
        sc.simulate(moved(JUMPS[name], kind), integrator, treatment, 0.01, 0.3)
    history = found.value.history
    assert history["constraint_violation"].max() < 1e-15
    assert not any(JUMPS[name](t) for t in history.times)


@pytest.mark.one_quick
@pytest.mark.filterwarnings("ignore:.*do not see:skfem_cosserat.AccuracyWarning")
@treatments
@pytest.mark.parametrize("name", STEEP)
def test_a_steep_motion_is_followed(name, treatment):
    """Its second difference shrinks with the interval, though not where the step looks first."""
    motion = STEEP[name]
    model = moved(motion, sc.JointRevolute)
    run = sc.simulate(model, sc.EnergyMomentum(), treatment, 0.01, 0.3)
    value = motion.value if isinstance(motion, sc.FunctionOfTime) else motion
    angle = run["joint/joint/angle"] - [value(t) for t in run.times.tolist()]
    assert abs(np.sin(angle / 2)).max() < 1e-12


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "kernels"), [(sc.JointPrismatic, "numpy"), ("rotation", "numba")])
@treatments
def test_what_is_too_small_for_a_jump_is_followed(kind, treatment, kernels):
    """Where a step ends: at t = 0.1 by 10 h, and before it by 9 h + h."""
    for scheme in (*INTEGRATORS, sc.GeneralizedAlpha(), sc.Composition(sc.Variational())):
        model = moved(lambda t: t**2 + 9e-7 * (t >= 0.1), kind)
        run = sc.simulate(model, scheme, treatment, 0.01, 0.12, kernels=kernels)
        assert run["constraint_violation"].max() < 1e-13


def test_a_violated_constraint_is_told():
    """Newton's method ends where increments of 2e-3 are taken for nothing."""
    loose, model = sc.NewtonSettings(increment=2e-3, negligible=2e-3), sc.Model()
    model.add("top", sc.RigidBody(1.0, TENSOR, angular_velocity=(3, 2, 9)))
    with pytest.warns(sc.AccuracyWarning, match="violates the constraint of the triad of .*Newton"):
        sc.simulate(model, sc.EnergyMomentum(), sc.Multipliers(), 0.05, 0.6, settings=loose)
