"""Prescribed angles and displacements of joints: motion, torque, work, dead points."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from helpers_scenes import JOINTS, TENSOR, fitting, four_bar, null_space, rotation
from scipy.spatial.transform import Rotation
from test_tangents import TOLERANCE, Step, worst

import skfem_cosserat as sc
from skfem_cosserat.model.reparametrisation import Reparametrisation

INTEGRATORS = {"variational": sc.Variational(), "energy-momentum": sc.EnergyMomentum()}
TREATMENTS = {"null space": sc.NullSpace(), "multipliers": sc.Multipliers()}
integrators = pytest.mark.parametrize("integrator", INTEGRATORS)
treatments = pytest.mark.parametrize("treatment", TREATMENTS)
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
                    drive = model.add(f"{name} of {label}", sc.JointDrive(joint, motion, name))
                    driven.append((joint, name, motion, drive))
    model.add("gravity", sc.LoadGravity((0.3, 0.1, -9.81)))
    return model.freeze(), driven


def measured(system, joint, name, y):
    """A relative coordinate, from positions and rotations alone."""

    def side(place):
        r = system.row_of(place)
        D = y[r + 1 : r + 4]
        return y[r] + place.offset @ D, D.T @ place.triad

    (xa, Ra), (xb, Rb) = side(joint.a), side(joint.b)
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
def test_unknowns(kind):
    """Each drive takes one."""
    system, driven = scene(kind)
    free = sum(
        JOINTS[kind] - len(names) + (6 if on_body else 0)
        for names in selections(kind)
        for _swap in (False, True)
        for on_body in (False, True)
    )
    assert system.unknowns == free
    assert system.rank == system.m == system.n - free
    assert len(driven) == len(system.drives)


@kinds
def test_null_space_of_driven_trees(kind):
    system, _ = scene(kind)
    rng = np.random.default_rng(1)
    nodal = Reparametrisation(system.kinematics)
    nodal.begin(system.extend(system.q0, 0.0), system.ground(0.3))
    nodal.add(0.7 * rng.standard_normal(system.unknowns))
    y0 = nodal.configuration()
    nodal.begin(y0, system.ground(0.5))
    nodal.add(0.5 * rng.standard_normal(system.unknowns))
    y1 = nodal.configuration()
    for y in (y0, y1):
        size = np.maximum(system.constraints.magnitudes(y), 1.0)
        assert (abs(system.constraints.values(y)) / size).max() < 1e-13
    for y in (y0, y1):
        G = system.constraints.jacobian(y).toarray()
        P = null_space(system, y, nodal.fixed)
        assert abs(G @ P).max() <= 1e-12 * abs(G).max() * abs(P).max()
        assert np.linalg.matrix_rank(P) == system.unknowns
        assert np.linalg.matrix_rank(G) == system.rank


@pytest.mark.one_quick
@kinds
@integrators
@treatments
def test_tangent(kind, integrator, treatment):
    system, _ = scene(kind)
    step = Step(system, INTEGRATORS[integrator], TREATMENTS[treatment], seed=2)
    assert worst(step.matrix(), step.derivative()) < TOLERANCE


@cache
def run(kind, integrator, treatment):
    system, _ = scene(kind)
    v = np.random.default_rng(4).standard_normal(system.n)
    start = sc.initial_state(system, v=sc.project(system, system.q0, v))
    pair = INTEGRATORS[integrator], TREATMENTS[treatment]
    return sc.simulate(system, *pair, 0.02, 0.3, start=start)


@pytest.mark.slow
@kinds
@integrators
def test_treatments_agree_and_follow_the_motion(kind, integrator):
    system, driven = scene(kind)
    one, two = (run(kind, integrator, treatment) for treatment in TREATMENTS)
    assert len(one) == 16
    assert abs(one["q"] - two["q"]).max() < 1e-10
    size = abs(one["constraint_force"][:-1]).max()
    assert abs(one["constraint_force"] - two["constraint_force"])[:-1].max() < 1e-8 * size
    for history in (one, two):
        rows = [system.extend(q, t) for q, t in zip(history["q"], history.times, strict=True)]
        for joint, name, motion, drive in driven:
            wanted = np.array([motion(t) for t in history.times])
            found = np.array([measured(system, joint, name, y) for y in rows])
            assert abs(found - wanted).max() < 2e-13, (joint.name, name)
            assert abs(history[f"joint/{joint.name}/{name}"] - wanted).max() < 2e-13
            for what in ("force", "moment"):
                f, g = (h[f"joint/{drive.name}/{what}"][:-1] for h in (one, two))
                assert abs(f - g).max() < 1e-8 * size


@pytest.mark.one_quick
@kinds
@treatments
def test_energy_balance(kind, treatment):
    """What the drives put in is what the scene gains, to round-off with energy-momentum."""
    history = run(kind, "energy-momentum", treatment)
    balance = history["energy_balance"]
    scale = abs(history["energy"]).max() + abs(history["work_drives"]).max()
    assert np.isfinite(balance).all()
    assert abs(balance).max() < 1e-12 * scale
    assert np.ptp(history["work_drives"]) > 0.01


# -- torque and power ------------------------------------------------------------------------------


def hinged(alpha, swap, driven=True):
    """A body on a hinge through another point than its centre, turning with alpha t^2/2."""
    model = sc.Model()
    axis = np.array([0, 0.6, 0.8])
    body = sc.RigidBody(1.4, TENSOR, position=(0.5, 0.1, 0.2), center=(0.1, 0.2, 0))
    model.add("body", body)
    sides = [sc.ground((0, 0, 0)), body.at((0, 0, 0))]
    hinge = model.add("hinge", sc.JointRevolute(*(sides[::-1] if swap else sides), axis))
    sign = -1.0 if swap else 1.0  # from side a to side b
    if driven:
        model.add("motor", sc.JointDrive(hinge, lambda t: sign * alpha * t**2 / 2))
    c = body.position + body.center
    J = axis @ (TENSOR + 1.4 * (c @ c * np.eye(3) - np.outer(c, c))) @ axis
    return model, axis, J


@pytest.mark.slow
@integrators
@treatments
@pytest.mark.parametrize("swap", [False, True])
def test_torque_of_a_ramped_speed(integrator, treatment, swap):
    """J alpha about the axis at all times, its power times rate is the work; second order.

    With energy-momentum the torque alternates: the mean of neighbouring midpoints is the node's.
    """
    alpha = 3.0
    errors = []
    for steps in (25, 50, 100):
        model, axis, J = hinged(alpha, swap)
        h = 1 / steps
        system = model.freeze()
        assert system.unknowns == 0
        pair = INTEGRATORS[integrator], TREATMENTS[treatment]
        history = sc.simulate(system, *pair, h, 1.0)
        sign = -1.0 if swap else 1.0
        torque = sign * history["joint/motor/moment"][:-1] @ axis
        assert abs(history["joint/motor/force"])[:-1].max() < 1e-9
        assert abs(np.cross(history["joint/motor/moment"][:-1], axis)).max() < 1e-9
        assert abs(history["joint/hinge/moment"][:-1] @ axis).max() < 1e-9
        if integrator == "energy-momentum":
            torque = np.concatenate([[J * alpha], (torque[1:] + torque[:-1]) / 2])
        rate = alpha * history.times[: len(torque)]
        work = np.concatenate([[0], np.cumsum(h * (torque * rate)[1:])])  # at nodes, trapezoidal
        work -= h * torque * rate / 2
        exact = J * (alpha * history.times) ** 2 / 2
        errors.append(
            [
                abs(torque[1:] / (J * alpha) - 1).max(),
                abs(work - exact[: len(work)]).max() / exact[-1],
                abs(history["work_drives"] - exact)[:-1].max() / exact[-1],
            ]
        )
    errors = np.array(errors)
    assert errors[-1].max() < 5e-3
    big = errors[-1] > 1e-10
    ratios = errors[:-1, big] / errors[1:, big]
    assert ((ratios > 3.5) & (ratios < 4.5)).all(), errors


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
    pair = INTEGRATORS[integrator], TREATMENTS[treatment]
    history = sc.simulate(model.freeze(), *pair, 0.02, 0.5)
    force = history["joint/ram/force"][1:-1]
    assert abs(force - 2.0 * (1.5 + 9.81 * 0.8) * n).max() < 1e-8
    assert abs(history["joint/ram/moment"][1:-1]).max() < 1e-8
    assert abs(history["joint/slide/force"][1:-1] @ n).max() < 1e-8
    exact = 0.75 * history.times**2
    assert abs(history["joint/slide/displacement"] - exact).max() < 1e-13
    work = 2.0 * (0.5 * (1.5 * history.times) ** 2 + 9.81 * 0.8 * exact)
    assert abs(history["work_drives"] - work)[:-1].max() < 1e-3 * work[-1]


# -- closed loops ----------------------------------------------------------------------------------

R, L, START = 0.4, 1.0, 0.7


def slider_crank(drive, joint="pin"):
    """Crank, rod and slider in the xy plane; drives one of its joints."""
    A = np.zeros(3)
    B = R * np.array([np.cos(START), np.sin(START), 0])
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
    """Mobility zero, no unknowns left: the closed form over three turns, forwards and back."""
    turn = lambda t: 10 * (1 - np.cos(4 * t))  # noqa: E731 - reaches 20 rad and comes back
    system = slider_crank(turn).freeze()
    assert system.counts() == {"n": 36, "m": 39, "rank": 36, "unknowns": 0}
    assert sum(map(len, system.redundancies().values())) == 3
    runs = []
    for treatment in TREATMENTS.values():
        history = sc.simulate(system, INTEGRATORS[integrator], treatment, 0.02, 1.6)
        runs.append(history)
        x = history["q"][:, system.frame_place("slider")]
        angle = np.array([turn(t) for t in history.times])
        assert abs(x - slider_of(START + angle)).max() < 1e-12
        assert abs(history["joint/pin/angle"] - angle).max() < 1e-12
        assert history["constraint_violation"].max() < 1e-13
        assert (history["attempts"] == 1).all()
    assert angle.max() > 6 * np.pi
    one, two = runs
    assert abs(one["q"] - two["q"]).max() < 1e-12
    size = abs(one["constraint_force"][:-1]).max()
    assert abs(one["constraint_force"] - two["constraint_force"])[:-1].max() < 1e-8 * size
    moment = [h["joint/motor/moment"][:-1] for h in runs]
    assert abs(moment[0] - moment[1]).max() < 1e-8 * size
    if integrator == "energy-momentum":
        for history in runs:
            assert abs(history["energy_balance"]).max() < 1e-10 * history["energy"].max()


@pytest.mark.slow
@pytest.mark.parametrize("which", range(4))
@integrators
def test_each_joint_of_a_four_bar_driven(which, integrator):
    """Also the one that closes the loop; against the same motion started from another joint."""
    motion = lambda t: 0.25 * np.sin(2 * t) ** 2  # noqa: E731
    model = four_bar()
    joint = model[f"pin {which}"]
    model.add("motor", sc.JointDrive(joint, motion))
    model.add("gravity", sc.LoadGravity((0, -9.81, 0)))
    system = model.freeze()
    assert system.unknowns == 0
    runs = [
        sc.simulate(system, INTEGRATORS[integrator], treatment, 0.02, 0.8)
        for treatment in TREATMENTS.values()
    ]
    for history in runs:
        for q, t in zip(history["q"], history.times, strict=True):
            assert abs(measured(system, joint, "angle", system.extend(q, t)) - motion(t)) < 1e-13
    one, two = runs
    assert abs(one["q"] - two["q"]).max() < 1e-12
    assert abs(one["q"] - one["q"][0]).max() > 0.1
    angles = [one[f"joint/pin {k}/angle"] for k in range(4)]
    assert abs(angles[0] + angles[1] + angles[2] + angles[3]).max() < 1e-12  # around the loop


@pytest.mark.slow
@integrators
def test_a_drive_that_leaves_some_mobility(integrator):
    """A five-bar with one crank driven: one unknown, the other crank swings."""
    points = np.array([[0.0, 0, 0], [-0.3, 1, 0], [1, 1.8, 0], [2, 1.5, 0], [2.2, 0, 0]])
    model = sc.Model()
    bars = [
        model.add(f"bar {k}", sc.RigidBody(1.0, TENSOR, position=points[k : k + 2].mean(0)))
        for k in range(4)
    ]
    places = [sc.ground(points[0]), *(b.at(x) for b, x in zip(bars, points[1:], strict=True))]
    after = [*(b.at(x) for b, x in zip(bars, points, strict=False)), sc.ground(points[4])]
    for k in range(5):
        model.add(f"pin {k}", sc.JointRevolute(places[k], after[k], Z))
    model.add("motor", sc.JointDrive(model["pin 0"], lambda t: 0.3 * t**2))
    model.add("gravity", sc.LoadGravity((0.5, -1, 0)))
    system = model.freeze()
    assert system.counts() == {"n": 48, "m": 50, "rank": 47, "unknowns": 1}
    one, two = (
        sc.simulate(system, INTEGRATORS[integrator], treatment, 0.02, 1.0)
        for treatment in TREATMENTS.values()
    )
    assert abs(one["q"] - two["q"]).max() < 1e-11
    for history in (one, two):
        assert abs(history["joint/pin 0/angle"] - 0.3 * history.times**2).max() < 1e-12
        assert abs(history["joint/pin 4/angle"]).max() > 0.05
        if integrator == "energy-momentum":
            assert abs(history["energy_balance"]).max() < 1e-11 * abs(history["energy"]).max()


@pytest.mark.one_quick
@treatments
def test_several_turns(treatment):
    """A motor on a tree that hangs on a free body: the angle goes on counting."""
    model = sc.Model()
    hub = model.add("hub", sc.RigidBody(2.0, TENSOR, angular_velocity=(0.1, 0.2, 0)))
    x, omega = (0.5, 0, 0), (0.1, 0.2, 0)
    speed = {"velocity": np.cross(omega, x), "angular_velocity": omega}
    wheel = sc.RigidBody(0.5, TENSOR, position=x, **speed)
    model.add("wheel", wheel)
    axle = model.add("axle", sc.JointRevolute(hub.at((0.5, 0, 0)), wheel.at((0.5, 0, 0)), Z))
    model.add("motor", sc.JointDrive(axle, lambda t: -15 * t**2))
    system = model.freeze()
    assert system.unknowns == 6
    history = sc.simulate(system, sc.EnergyMomentum(), TREATMENTS[treatment], 0.02, 1.0)
    assert abs(history["joint/axle/angle"] + 15 * history.times**2).max() < 1e-12
    L = history["angular_momentum"]
    assert abs(L - L[0]).max() < 1e-11 * abs(L[0]).max()  # the motor is an internal force


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
    pair = INTEGRATORS[integrator], TREATMENTS[treatment]
    history = sc.simulate(model.freeze(), *pair, 1.0, 3.0)
    x, angle = history["q"][:, :3], rate * history.times**2
    wanted = 0.5 * np.c_[np.cos(angle), np.sin(angle), 0 * angle]
    assert abs(x - wanted).max() < 1e-13


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
    pair = INTEGRATORS[integrator], TREATMENTS[treatment]
    error = stopped(system, *pair, 0.01, 2.0)
    time = np.sqrt(reach / speed)
    assert error.time == pytest.approx(np.floor(time / 0.01) * 0.01, abs=1e-9)
    text = str(error)
    for word in (
        f"dead point at t = {time:.6g} s",
        "the drive 'motor'",
        f"displacement = {reach:.6g} m",
        "closed loop through",
        "revolute joint 'big end'",
        "prismatic joint 'guide'",
        "does not close beyond",
        "drive another joint",
    ):
        assert word in text, text
    assert len(error.history) == error.step
    assert error.history["constraint_violation"].max() < 1e-12


@pytest.mark.slow
@treatments
def test_a_rocker_driven_beyond_its_reach(treatment):
    """Crank and coupler get straight: the angle by the law of cosines."""
    crank, coupler, rocker, base = 1.0, np.hypot(2, 0.5), 1.5, 2.0
    model = four_bar()
    model.add("motor", sc.JointDrive(model["pin 3"], lambda t: -0.4 * t**2))
    error = stopped(model.freeze(), sc.EnergyMomentum(), TREATMENTS[treatment], 0.05, 5.0)
    model = four_bar()
    model.add("motor", sc.JointDrive(model["pin 3"], lambda t: 0.4 * t**2))
    other = stopped(model.freeze(), sc.EnergyMomentum(), TREATMENTS[treatment], 0.05, 5.0)
    # interior angle of the rocker at its pin, 90 degrees in the reference
    limits = [
        np.arccos((rocker**2 + base**2 - d**2) / (2 * rocker * base))
        for d in (crank + coupler, coupler - crank)
    ]
    found = sorted(
        0.4 * float(str(e).split("dead point at t = ")[1].split(" s")[0]) ** 2
        for e in (error, other)
    )
    assert found == pytest.approx(sorted(abs(a - np.pi / 2) for a in limits), rel=1e-5)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")  # ends at a dead point
@treatments
def test_supports_that_are_pulled_apart(treatment):
    """No drive, but moving ground: two rods between supports that go away from each other."""
    model = sc.Model()
    ends = np.array([[0.0, 0, 0], [1, -0.5, 0], [2, 0, 0]])
    rods = [
        model.add(
            f"rod {k}", sc.RigidBody.box(1.0, (1, 0.1, 0.1), position=ends[k : k + 2].mean(0))
        )
        for k in (0, 1)
    ]
    away = sc.ground(ends[2], sc.Motion(lambda t: (t**2, 0, 0)))
    model.add("left", sc.JointRevolute(sc.ground(ends[0]), rods[0].at(ends[0]), Z))
    model.add("mid", sc.JointRevolute(rods[0].at(ends[1]), rods[1].at(ends[1]), Z))
    model.add("right", sc.JointRevolute(rods[1].at(ends[2]), away, Z))
    error = stopped(model.freeze(), sc.Variational(), TREATMENTS[treatment], 0.02, 2.0)
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
    stepper = sc.Stepper(model.freeze(), sc.Variational(), TREATMENTS[treatment], 0.1, settings)
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
    ends = np.array([[0.0, 0, 0], [0.6, 0.8, 0], [2.6, 0.8, 0], [2, 0, 0]])
    model = sc.Model()
    bars = [
        model.add(name, sc.RigidBody.box(1.0, (1, 0.1, 0.1), position=ends[k : k + 2].mean(0)))
        for k, name in enumerate(("crank", "coupler", "rocker"))
    ]
    before = [sc.ground(ends[0]), *(b.at(x) for b, x in zip(bars, ends[1:], strict=True))]
    after = [*(b.at(x) for b, x in zip(bars, ends[:3], strict=True)), sc.ground(ends[3])]
    for k in range(4):
        model.add(f"pin {k}", sc.JointRevolute(before[k], after[k], Z))
    model.add("left", sc.JointDrive(model["pin 0"], first))
    model.add("right", sc.JointDrive(model["pin 3"], second))
    return model


def test_two_drives_of_one_coordinate():
    model = slider_crank(lambda t: t**2)
    model.add("second", sc.JointDrive(model["pin"], lambda t: t**2))
    refused(
        model.freeze, "drive 'second'", "contradicts the drive 'motor'", "angle of the revolute"
    )


@pytest.mark.parametrize("factor", [1.5, 1.01, 1 + 1e-4, -1.0])
def test_two_cranks_with_different_motions(factor):
    refused(
        two_cranks(lambda t: 2 * t**2, lambda t: -2 * factor * t**2).freeze,
        "drive 'right'",
        "the drive 'left' at angle",
        "cannot follow the prescribed motion",
        "revolute joint 'pin 2'",
    )


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")  # large steps
@integrators
@treatments
def test_two_cranks_with_the_same_motion(integrator, treatment):
    """Consistent drives are taken, and go through the flat positions together."""
    system = two_cranks(lambda t: -2 * t**2, lambda t: 2 * t**2).freeze()
    assert system.counts() == {"n": 36, "m": 40, "rank": 36, "unknowns": 0}
    pair = INTEGRATORS[integrator], TREATMENTS[treatment]
    history = sc.simulate(system, *pair, 0.02, 2.0)
    i = system.frame_place("coupler")
    assert abs(history["q"][:, i + 3 : i + 6] - (1, 0, 0)).max() < 1e-12
    assert history["joint/pin 0/angle"][-1] == pytest.approx(-8.0, abs=1e-12)


@pytest.mark.slow
@integrators
@treatments
def test_cranks_that_part_later(integrator, treatment):
    """Equal until 0.5 s: the run stops there and says why."""
    model = two_cranks(lambda t: -(t**2), lambda t: t**2 if t < 0.5 else t - 0.25)
    pair = INTEGRATORS[integrator], TREATMENTS[treatment]
    error = stopped(model.freeze(), *pair, 0.02, 2.0)
    assert error.time == pytest.approx(0.5)
    for word in (
        "prescribed motions contradict each other at t = 0.52 s",
        "the drive 'left' at angle = -0.2704 rad",
        "the drive 'right' at angle = 0.27 rad",
        "Leave out one of the drives",
    ):
        assert word in str(error)


# a dead point is a singular position
@pytest.mark.filterwarnings("ignore::skfem_cosserat.ModelWarning")
def test_a_drive_against_a_dead_point_from_the_start():
    """The slider in its dead point cannot be pushed on."""
    A, B, C = np.zeros(3), np.array([0.4, 0, 0]), np.array([1.4, 0, 0])
    model = sc.Model()
    crank = model.add("crank", sc.RigidBody.box(1.0, (1, 1, 1), position=(A + B) / 2))
    rod = model.add("rod", sc.RigidBody.box(1.0, (1, 1, 1), position=(B + C) / 2))
    slider = model.add("slider", sc.RigidBody.box(1.0, (1, 1, 1), position=C))
    model.add("pin", sc.JointRevolute(sc.ground(A), crank.at(A), Z))
    model.add("big end", sc.JointRevolute(crank.at(B), rod.at(B), Z))
    model.add("small end", sc.JointRevolute(rod.at(C), slider.at(C), Z))
    model.add("guide", sc.JointPrismatic(sc.ground(A), slider.at(C), (1.0, 0, 0)))
    model.add("ram", sc.JointDrive(model["guide"], lambda t: t**2))
    refused(model.freeze, "drive 'ram'", "cannot follow the prescribed motion", "'guide'")


# -- bad input -------------------------------------------------------------------------------------

BALL = sc.RigidBody.sphere(1.0, 1.0)
HINGE = sc.JointRevolute(sc.ground((0, 0, 0)), BALL.at((0, 0, 0)), Z)
SLEEVE = sc.JointCylindrical(sc.ground((0, 0, 0)), BALL.at((0, 0, 0)), Z)
SOCKET = sc.JointSpherical(sc.ground((0, 0, 0)), BALL.at((0, 0, 0)))
ROD = sc.JointDistance(sc.ground((0, 0, 2)), BALL.at((0, 0, 0)))


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: sc.JointDrive(BALL, np.sin), ["drive", "RigidBody", "expected a joint"]),
        (lambda: sc.JointDrive(HINGE, 3.0), ["drive", "motion = 3.0", "function of time"]),
        (lambda: sc.JointDrive(HINGE, np.sin, "displacement"), ["no 'displacement'", "['angle']"]),
        (lambda: sc.JointDrive(SLEEVE, np.sin), ["which of its coordinates", "displacement"]),
        (lambda: sc.JointDrive(SLEEVE, np.sin, "x"), ["cylindrical joint", "no 'x'"]),
        (lambda: sc.JointDrive(SOCKET, np.sin), ["cannot prescribe the rotation", "spherical"]),
        (lambda: sc.JointDrive(ROD, np.sin), ["distance joint"]),
    ],
)
def test_bad_drives(call, words):
    refused(call, *words)


def test_drives_that_do_not_fit_the_model():
    def model(motion, known=True):
        out = sc.Model()
        ball = out.add("ball", sc.RigidBody.sphere(1.0, 1.0))
        joint = sc.JointRevolute(sc.ground((0, 0, 0)), ball.at((0, 0, 0)), Z)
        if known:
            out.add("hinge", joint)
        else:
            out.add("other", sc.JointSpherical(sc.ground((0, 0, 0)), ball.at((0, 0, 0))))
        out.add("motor", sc.JointDrive(joint, motion))
        return out

    refused(model(lambda t: 0.2 + t).freeze, "drive 'motor'", "angle = 0.2 rad", "t = 0", "'hinge'")
    refused(model(lambda t: t**2, False).freeze, "drive 'motor'", "not in the model")
    refused(model(lambda t: float("nan")).freeze, "drive 'motor'", "nan")
    refused(model(lambda t: (t, t)).freeze, "drive 'motor'", "(0.0, 0.0)")
    refused(
        lambda: sc.simulate(model(lambda t: 0.5 * t).freeze(), *PAIR, 0.1, 1.0),
        "drive 'motor'",
        "0.5",
        "project",
    )
    late = model(lambda t: t**2 if t < 0.45 else float("inf")).freeze()
    with pytest.raises(sc.InputError, match=r"drive 'motor'.*inf.*0\.45"):
        sc.simulate(late, *PAIR, 0.1, 1.0)


PAIR = (sc.Variational(), sc.NullSpace())


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
        sc.simulate(moved(JUMPS[name], kind), integrator, TREATMENTS[treatment], 0.01, 0.3)
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
    run = sc.simulate(model, sc.EnergyMomentum(), TREATMENTS[treatment], 0.01, 0.3)
    value = motion.value if isinstance(motion, sc.FunctionOfTime) else motion
    angle = run["joint/joint/angle"] - [value(t) for t in run.times.tolist()]
    assert abs(np.sin(angle / 2)).max() < 1e-12


@pytest.mark.slow
@pytest.mark.parametrize("kernels", ["numpy", "numba"])
@pytest.mark.parametrize("kind", [sc.JointPrismatic, "rotation"])
@treatments
def test_what_is_too_small_for_a_jump_is_followed(kind, treatment, kernels):
    """Where a step ends: at t = 0.1 by 10 h, and before it by 9 h + h."""
    for scheme in (*INTEGRATORS.values(), sc.GeneralizedAlpha(), sc.Composition(sc.Variational())):
        model = moved(lambda t: t**2 + 9e-7 * (t >= 0.1), kind)
        run = sc.simulate(model, scheme, TREATMENTS[treatment], 0.01, 0.15, kernels=kernels)
        assert run["constraint_violation"].max() < 1e-13


@pytest.mark.slow
@treatments
def test_full_turns_at_once_move_nothing(treatment):
    """Angle and angle + 2 pi are one configuration: no other torque."""
    pair = sc.EnergyMomentum(), TREATMENTS[treatment]
    one, other = (
        sc.simulate(moved(motion, sc.JointRevolute), *pair, 0.01, 0.3)
        for motion in (lambda t: t**2, lambda t: t**2 + 2 * np.pi * (t >= 0.1))
    )
    for name in ("q", "joint/drive/moment", "work_drives"):
        assert abs(one[name] - other[name])[:-1].max() < 1e-10


def test_a_violated_constraint_is_told():
    """Newton's method ends where increments of 2e-3 are taken for nothing."""
    loose, model = sc.NewtonSettings(increment=2e-3, negligible=2e-3), sc.Model()
    model.add("top", sc.RigidBody(1.0, TENSOR, angular_velocity=(3, 2, 9)))
    with pytest.warns(sc.AccuracyWarning, match="violates the constraint of the triad of .*Newton"):
        sc.simulate(model, sc.EnergyMomentum(), sc.Multipliers(), 0.05, 0.6, settings=loose)
