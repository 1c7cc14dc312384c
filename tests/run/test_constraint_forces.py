"""Constraint forces of a history: at its states, of the order of the scheme, in every state."""

import numpy as np
import pytest
from helpers_scenes import four_bar
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

import skfem_cosserat as sc
from skfem_cosserat.diagnostics.inputs import jumps

NULL, MULTIPLIERS = sc.NullSpace(), sc.Multipliers()
WEIGHT = (0, 0, -10.0)
TURN = 3.0  # of the motor, rad/s


def pendulum():
    """A body on a hinge: angle from the closed equation of motion, force and moment from it."""
    mass, inertia, arm = 2.0, 0.3, np.array((0.4, 0.1, -0.3))
    model = sc.Model()
    body = model.add("body", sc.RigidBody(mass, (0.2, inertia, 0.25), position=arm))
    model.add("hinge", sc.JointRevolute(sc.ground((0, 0, 0)), body.at((0, 0, 0)), (0, 1, 0)))
    model.add("weight", sc.LoadGravity(WEIGHT))
    about = inertia + mass * (arm[0] ** 2 + arm[2] ** 2)

    def place(angle):
        c, s = np.cos(angle), np.sin(angle)
        return np.array([c * arm[0] + s * arm[2], arm[1] + 0 * c, c * arm[2] - s * arm[0]])

    def faster(angle):
        return mass * 10.0 * place(angle)[0] / about

    def exact(t):
        motion = solve_ivp(
            lambda _, y: [y[1], faster(y[0])], (0, 1), [0, 0], t_eval=t, rtol=1e-11, atol=1e-12
        )
        angle, rate = motion.y
        x, z = place(angle)[[0, 2]]
        a = faster(angle) * np.array([z, 0 * z, -x]) - rate**2 * np.array([x, 0 * x, z])
        force = mass * (a.T - WEIGHT)
        moment = np.cross(place(angle).T, force) + np.outer(inertia * faster(angle), (0, 1, 0))
        return {"joint/hinge/force": force, "joint/hinge/moment": moment}

    return model.freeze(), exact


def motor(planar=None):
    """A crank that a motor turns to and fro: its torque in closed form."""
    mass, inertia, arm = 2.0, 0.3, 0.5
    model = sc.Model()
    crank = model.add("crank", sc.RigidBody(mass, (0.2, inertia, 0.25), position=(arm, 0, 0)))
    hinge = sc.JointRevolute(sc.ground((0, 0, 0)), crank.at((0, 0, 0)), (0, 1, 0))
    model.add("hinge", hinge)
    model.add("motor", sc.JointDrive(hinge, lambda t: 1 - np.cos(TURN * t)))
    model.add("weight", sc.LoadGravity(WEIGHT))

    def exact(t):
        angle, faster = 1 - np.cos(TURN * t), TURN**2 * np.cos(TURN * t)
        torque = (inertia + mass * arm**2) * faster - mass * 10.0 * arm * np.cos(angle)
        return {"joint/motor/moment": np.outer(torque, (0, 1, 0))}

    return model.freeze(planar=planar), exact


def motor_in_its_plane():
    """The same by three unknowns a frame."""
    return motor(sc.Planar(normal=(0, 1, 0)))


def fine(system, names):
    """Of a run of fourth order."""
    run = sc.simulate(system, sc.Composition(sc.Variational()), NULL, 1 / 480, 0.8)
    return lambda t: {name: CubicSpline(run.times, run[name])(t) for name in names}


def driven_loop():
    """A planar four-bar linkage that a motor drives."""
    model = four_bar()
    model.add("motor", sc.JointDrive(model["pin 0"], lambda t: 0.4 * (1 - np.cos(TURN * t))))
    model.add("weight", sc.LoadGravity((0, -10.0, 0)))
    system = model.freeze()
    return system, fine(system, ["joint/motor/moment", "joint/pin 3/force"])


def swing():
    """A flexible beam between two bodies that hang on the ground."""
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 2, "beam")
    section = sc.Section([40, 40, 60, 6, 6, 5], mass=1.0, inertia=(0.1, 0.08))
    model = sc.Model()
    beam = model.add("beam", sc.Beam(mesh, section, director=(0, 0, 1)))
    for name, x, turn in (("start", 0.0, (0, 1, 0)), ("end", 1.0, (0, 0.6, 0.8))):
        body = model.add(name, sc.RigidBody(0.5, (0.1, 0.1, 0.1), position=(x, 0, 0.5)))
        top, bottom = (x, 0, 1), (x, 0, 0)
        model.add(f"top {name}", sc.JointSpherical(sc.ground(top), body.at(top)))
        joint = sc.JointRevolute(body.at(bottom), beam.node(f"beam.{name}"), turn)
        model.add(f"bottom {name}", joint)
    model.add("weight", sc.LoadGravity((1.0, 0.5, -10)))
    system = model.freeze()
    return system, fine(system, ["joint/top start/force", "joint/bottom start/moment"])


def errors(scene, scheme, treatment, n, every=3, kernels="numpy"):
    """Of the first, the last and all other states, of a run and of one that goes on from it."""
    system, exact = scene
    run = system, scheme, treatment, 0.8 / n
    first = sc.simulate(*run, 0.4, every=every, kernels=kernels)
    start = sc.restart(system, first, scheme, 0.8 / n)
    second = sc.simulate(*run, 0.8, every=every, start=start, kernels=kernels)
    found = []
    for history in (first, second):
        for name, values in exact(history.times).items():
            error = abs(history[name] - values).max(1) / abs(values).max()
            found += [error[0], error[1:-1].max(), error[-1]]
    return np.array(found)


SCHEMES = sc.EnergyMomentum(), sc.Variational(), sc.EnergyMomentum(stabilized=True)


@pytest.mark.slow
@pytest.mark.parametrize("scheme", SCHEMES, ids=repr)
@pytest.mark.parametrize(
    ("scene", "treatment"),
    [(pendulum, MULTIPLIERS), (motor, NULL), (motor_in_its_plane, NULL)],
    ids=["pendulum", "motor", "motor in its plane"],
)
def test_second_order_against_closed_forms(scene, treatment, scheme):
    coarse, half = (errors(scene(), scheme, treatment, n) for n in (96, 192))
    orders = np.log2(coarse / half)
    assert abs(orders - 2).max() < 0.2, orders
    assert half.max() < 1e-2


@pytest.mark.slow
@pytest.mark.parametrize("treatment", [NULL, MULTIPLIERS], ids=lambda t: t.name)
@pytest.mark.parametrize(("scene", "steps"), [(driven_loop, 96), (swing, 384)])
def test_second_order_against_fine_runs(scene, steps, treatment):
    found = scene()
    coarse, half = (errors(found, sc.EnergyMomentum(), treatment, n) for n in (steps, 2 * steps))
    orders = np.log2(coarse / half)
    assert abs(orders - 2).max() < 0.2, orders


def at_events(n):
    """Errors at the states where steps change in size, and next to them."""
    system, exact = pendulum()
    times = (0.2371, 0.5555)
    events = [sc.Event(sc.ConditionTime(t), name=f"{t}") for t in times]
    run = sc.simulate(system, sc.EnergyMomentum(), NULL, 0.8 / n, 0.8, events=events)
    error = abs(run["joint/hinge/force"] - exact(run.times)["joint/hinge/force"]).max(1)
    rows = np.array([event.row for event in run.events])
    assert abs(np.diff(run.times)[rows] / np.diff(run.times)[rows - 1] - 1).min() > 0.2
    return np.concatenate([error[rows], error[rows + 1]])


@pytest.mark.slow
def test_second_order_where_steps_change_in_size():
    """Events in the midst of steps."""
    errors = [at_events(n).max() for n in (60, 240)]
    assert abs(np.log2(errors[0] / errors[1]) / 2 - 2) < 0.3


@pytest.mark.slow
@pytest.mark.parametrize("scheme", [sc.EnergyMomentum(), sc.EnergyDecaying(chi=0.05)], ids=repr)
@pytest.mark.parametrize("part", [0.5, 1e-2, 1e-4, 1e-6])
def test_forces_beside_short_steps(part, scheme):
    """No worse than of states between equal steps; of far shorter ones of first order."""
    system, exact = motor()
    event = sc.Event(sc.ConditionTime(0.4 + 0.01 * part), name="look")
    run = sc.simulate(system, scheme, NULL, 0.01, 0.8, events=[event])
    error = abs(run["joint/motor/moment"] - exact(run.times)["joint/motor/moment"]).max(1)
    row = run.events[0].row
    assert error[[row - 1, row, row + 1]].max() < (0.4 if part < 1e-5 else 8e-3)
    assert np.delete(error, [row - 1, row, row + 1]).max() < 8e-3


@pytest.mark.one_quick
@pytest.mark.parametrize("at", [0.0101, 0.2371, 0.3995])
@pytest.mark.parametrize(
    "scheme", [sc.Variational(), sc.EnergyMomentum(), sc.Composition(sc.Variational())], ids=repr
)
def test_forces_beside_an_event(scheme, at):
    """Far from the start, next to it, and before the end, each with a short step on one side."""
    system, exact = pendulum()
    event = sc.Event(sc.ConditionTime(at), name="look")
    run = sc.simulate(system, scheme, NULL, 0.01, 0.4, events=[event])
    error = abs(run["joint/hinge/force"] - exact(run.times)["joint/hinge/force"]).max()
    assert error < 0.15  # N of 29


@pytest.mark.parametrize("h", [0.01, 0.005])
def test_second_order_where_energy_is_taken(h):
    """By a share that does not depend on the step; motion is prescribed, so only forces are off."""
    system, exact = motor()
    run = sc.simulate(system, sc.EnergyDecaying(chi=0.05), NULL, h, 0.2)
    error = abs(run["joint/motor/moment"] - exact(run.times)["joint/motor/moment"]).max()
    assert error < 0.01 * (h / 0.01) ** 2


@pytest.mark.parametrize("steps", [1, 2, 3])
@pytest.mark.parametrize("scheme", SCHEMES, ids=repr)
def test_a_few_steps_give_forces_of_all_states(scheme, steps):
    """Of the equations of motion where steps are too few."""
    system, exact = pendulum()
    run = sc.simulate(system, scheme, NULL, 0.01, 0.01 * steps)
    assert len(run) == steps + 1
    wanted = exact(run.times)["joint/hinge/force"]
    assert abs(run["joint/hinge/force"] - wanted).max() < 2e-3 * abs(wanted).max()


@pytest.mark.slow
@pytest.mark.parametrize("scheme", SCHEMES, ids=repr)
def test_the_last_force_without_a_step_after_it(scheme):
    """A load that is not known beyond the run is not asked for: the force follows from before."""

    def known(t):
        assert t < 0.8001
        return np.sin(t)

    system, found = pushed(known), []
    for n in (80, 160, 1280):
        run = sc.simulate(system, scheme, NULL, 0.8 / n, 0.8)
        found.append(run["joint/hinge/force"][-1])
    one, two = (np.linalg.norm(force - found[-1]) for force in found[:2])
    assert abs(np.log2(one / two) - 2) < 0.2
    assert two < 1e-2 * np.linalg.norm(found[-1])


@pytest.mark.one_quick
@pytest.mark.parametrize("scheme", [*SCHEMES, sc.GeneralizedAlpha(0.8)], ids=repr)
def test_sensors_see_the_same_forces(scheme):
    """At all states, the first and the last one among them, and at both sides of a change."""
    system, _ = pendulum()
    sensors = {"hinge": sc.SensorReaction(system.joints[0])}
    lighter = sc.Event(sc.ConditionTime(0.2345), sc.ActionLoad("weight", 0.5))
    run = sc.simulate(system, scheme, NULL, 0.01, 0.4, sensors=sensors, events=[lighter])
    record = run.sensors["hinge"]
    assert record.times.tolist() == run.times.tolist()
    both = np.concatenate([run["joint/hinge/force"], run["joint/hinge/moment"]], axis=1)
    assert abs(record.values - both).max() < 1e-12 * abs(both).max()


def along(place, hinge, function):
    """A force at a place by a function of time."""
    return sc.LoadForce(place, (0, 0, 9.0), function)


def brake(place, hinge, function):
    """A force against the velocity of a place, times a function of time."""
    return sc.Force([place], lambda x, v, t: -function(t) * v)


def motor_torque(place, hinge, function):
    return sc.JointActuator(hinge, function)


def pushed(push, turn=None, kind=along):
    """A body on a hinge, with a function of time for a force or a drive."""
    model = sc.Model()
    body = model.add("body", sc.RigidBody(2.0, (0.2, 0.3, 0.25), position=(0.4, 0, 0)))
    hinge = sc.JointRevolute(sc.ground((0, 0, 0)), body.at((0, 0, 0)), (0, 1, 0))
    model.add("hinge", hinge)
    model.add("push", kind(body.at((0.4, 0, 0)), hinge, push))
    if turn is not None:
        model.add("motor", sc.JointDrive(hinge, turn))
    return model.freeze()


SMOOTH = sc.RampSmooth(0.0, 0.3)


@pytest.mark.one_quick
@pytest.mark.parametrize(
    ("push", "turn", "times"),
    [
        (lambda t: 1.0 if t < 0.2345 else 0.5, None, [0.2345]),
        (lambda t: np.sin(t) + (t > 0.1001) - (t > 0.307), None, [0.1001, 0.307]),
        (SMOOTH, sc.RampLinear(0.123, 0.25, last=0.5), [0.123, 0.25]),  # its velocity jumps
        (SMOOTH, lambda t: 4 * max(0.0, t - 0.1234) ** 2, [0.1234]),  # its acceleration jumps
        (SMOOTH, lambda t: max(0.0, t - 0.0063), [0.0063]),  # in the first step
        (lambda t: np.sin(9 * t), lambda t: 1 - np.cos(5 * t), []),
        (sc.Table([0, 0.1, 0.101, 0.4], [0, 1, -1, 0]), SMOOTH, []),  # steep, but no jump
    ],
)
def test_states_beside_jumps_are_marked(push, turn, times):
    system = pushed(push, turn)
    run = sc.simulate(system, sc.EnergyMomentum(), NULL, 0.01, 0.4)
    apart = abs(run.times[:, None] - np.array(times)).min(axis=1, initial=np.inf)
    marked = run["at_jump"] > 0
    assert marked[apart < 0.0095].all() and not marked[apart > 0.0125].any()


@pytest.mark.one_quick
@pytest.mark.parametrize(
    ("until", "marked"),
    [(0.005, [0, 1]), (0.015, [0, 1, 2]), (0.385, [38, 39, 40]), (0.395, [39, 40]), (0.404, [])],
)
def test_jumps_that_forces_at_the_ends_of_a_run_mix(until, marked):
    """The first and the last one follow from two steps each, and none is beyond the end."""
    run = sc.simulate(
        pushed(lambda t: 1.0 * (t <= until + 1e-9)), sc.EnergyMomentum(), NULL, 0.01, 0.4
    )
    assert np.flatnonzero(run["at_jump"]).tolist() == marked


@pytest.mark.slow
@pytest.mark.parametrize(
    ("size", "kinks"), [(0.5, ()), (-0.5, ()), (0.5, [0.5]), (0.05, [0.5]), (-0.6, [0.5])]
)
def test_jumps_in_fast_vibrations_are_found(size, kinks):
    """Where each step changes the load by more than the jump does; all sizes if it is declared."""
    load = sc.FunctionOfTime(lambda t: np.sin(20 * np.pi * t) + size * (t > 0.5), kinks)
    system = pushed(load)
    run = sc.simulate(system, sc.EnergyMomentum(), NULL, 0.01, 1.0)
    assert jumps(system, run) == pytest.approx([0.5], abs=1e-4)
    assert run.times[run["at_jump"] > 0] == pytest.approx([0.49, 0.5, 0.51])


@pytest.mark.parametrize(("frequency", "phase"), [(8, 1.4), (30, 2.1)])
def test_smooth_motion_of_few_steps_has_no_jumps(frequency, phase):
    """Its acceleration bends by more in a step than it sticks out of those beside it."""
    at, rate = np.sin(phase), frequency * np.cos(phase)
    system = pushed(SMOOTH, lambda t: np.sin(frequency * t + phase) - at - rate * t)
    run = sc.simulate(system, sc.EnergyMomentum(), NULL, 0.01, 0.05)
    assert not len(jumps(system, run))


@pytest.mark.one_quick
@pytest.mark.parametrize("kinks", [(), [0.1234]])
@pytest.mark.parametrize(("kind", "marked"), [(motor_torque, [0.12, 0.13]), (brake, [])])
def test_states_beside_jumps_of_actuators_are_marked_those_of_laws_are_not(kind, marked, kinks):
    drop = sc.FunctionOfTime(lambda t: 3.0 if t < 0.1234 else 0.0, kinks)
    run = sc.simulate(pushed(drop, kind=kind), sc.EnergyMomentum(), NULL, 0.01, 0.2)
    assert run.times[run["at_jump"] > 0] == pytest.approx(marked)
