"""Events: located in time, and what they do to a scene."""

from __future__ import annotations

import shutil
from itertools import cycle

import numpy as np
import pytest
from helpers_kernels import chain, corner, needs_numba
from helpers_scenes import ball_on_rod, four_bar, full_section
from helpers_schemes import SCHEMES, stabilized
from scipy.optimize import brentq
from scipy.special import ellipk

import skfem_cosserat as sc
from skfem_cosserat import diagnostics
from skfem_cosserat.integrators.compiled_step import CompiledMotion

G = 10.0
TREATMENTS = {"null space": sc.NullSpace(), "multipliers": sc.Multipliers()}
PLAIN = [s for s in SCHEMES if not stabilized(s)] + [sc.EnergyMomentum(stabilized=True)]
SINGLE = [scheme for scheme in PLAIN if scheme.part is None]
STEPS = {"equal": 5e-3, "controlled": sc.StepControl(1e-3)}


def with_treatments(cases):
    """Each case with one of the two treatments of constraints, in turn."""
    return [(*case, treatment) for case, treatment in zip(cases, cycle(TREATMENTS.values()))]


def both_steps(schemes):
    """Schemes with equal steps, and those that may be controlled with controlled ones, too."""
    return [(s, step) for s in schemes for step in STEPS if step == "equal" or not s.fixed_step]


def pendulum(rate=None):
    """A ball on a rod of 1 m, let go horizontally, or at the lowest point with a velocity."""
    start = ((-1, 0, 0), (0, 0, 0)) if rate is None else ((0, 0, -1), (rate, 0, 0))
    model, bob, rod = ball_on_rod(*start, g=G)
    return model.freeze(), bob, rod


def ball(height=0.0, up=0.0, gravity=(0, 0, -G)):
    """A ball of 1 kg in free flight from a height (m), thrown upwards (m/s)."""
    model = sc.Model()
    flying = model.add("ball", sc.MassPoint(1.0, position=(0, 0, height), velocity=(0, 0, up)))
    model.add("gravity", sc.LoadGravity(gravity))
    return model, flying


def across(bob):
    """The ball passes below the hinge."""
    return sc.ConditionSensor(sc.SensorPosition(bob.place()), level=0.0, component=0)


def bars():
    """Two bars of 2 kg and 1 m on a hinge, in flight, one turning faster than the other."""
    model = sc.Model()
    size = 2.0, (1.0, 0.05, 0.05)
    motion = [((-0.5, 0, 0), (0, 0.5, 0), (0, 0, 1.0)), ((0.5, 0, 0), (0, 2.5, 0), (0, 0, 3.0))]
    left, right = (
        model.add(name, sc.RigidBody.box(*size, position=x, velocity=v, angular_velocity=w))
        for name, (x, v, w) in zip("ab", motion, strict=True)
    )
    middle = left.at((0, 0, 0)), right.at((0, 0, 0))
    pin = model.add("pin", sc.JointRevolute(*middle, axis=(0, 0, 1)))
    return model.freeze(), left, right, pin


def _cross(a, b):
    return a[0] * b[1] - a[1] * b[0]


def loss_of(v, spins, angle):
    """Energy that two equal bars lose when their hinge locks, by the momenta of the plane."""
    m, r, J = 2.0, 0.5, 2.0 * (1 + 0.05**2) / 12
    # centres seen from the hinge, the first bar along -x, the second turned by the angle
    x = np.array([[-r, 0.0], [r * np.cos(angle), r * np.sin(angle)]])
    centre = x.mean(0)
    spin = sum(J * w + m * _cross(a - centre, b) for w, a, b in zip(spins, x, v, strict=True))
    inertia = 2 * J + sum(m * (a - centre) @ (a - centre) for a in x)
    mean = v.mean(0)
    before = sum(J * w**2 + m * b @ b for w, b in zip(spins, v, strict=True)) / 2
    return before - m * mean @ mean - spin**2 / inertia / 2


# -- located ---------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize(("scheme", "treatment"), with_treatments([(s,) for s in PLAIN]), ids=repr)
def test_located_in_the_discrete_solution(scheme, treatment):
    """To 1e-10 s of the root of the same step as a function of its size; near the closed form."""
    system, bob, _ = pendulum()
    h = 5e-3
    run = system, scheme, treatment, h, 0.6
    history = sc.simulate(*run, events=[sc.Event(across(bob), name="lowest")], derive=False)
    (event,) = history.events
    assert history.times[-1] == 0.6 and history.times[event.row] == event.time
    before = sc.simulate(*run[:4], event.time - event.time % h, events=[], derive=False)
    assert before.times[-1] == pytest.approx(history.times[event.row - 1], abs=1e-12)
    state = sc.restart(system, before, scheme, h)
    stepper = sc.Stepper(*run[:4])

    def x(size):
        return stepper.advance(state, h=size).state.q[0]

    exact = brentq(x, 1e-4 * h, h, xtol=1e-13)
    assert event.time - state.time == pytest.approx(exact, abs=1e-10)
    close = {1: 1e-3, 2: 1e-4, 4: 1e-6}[scheme.order]
    assert event.time == pytest.approx(ellipk(0.5) / np.sqrt(G), abs=close)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scheme", "step", "treatment"), with_treatments(both_steps(SINGLE)), ids=str
)
def test_released_ball_flies_on_a_parabola(scheme, step, treatment):
    """Let go at the lowest point: closed form from there on, energy without a jump."""
    system, bob, rod = pendulum()
    event = sc.Event(across(bob), sc.ActionRelease(rod), name="let go")
    history = sc.simulate(system, scheme, treatment, STEPS[step], 0.8, events=[event])
    (found,) = history.events
    row = found.row + 1
    assert history.times[row] == found.time and history.segments[1] == (row, len(history))
    t = (history.times[row:] - found.time)[:, None]
    q, v = history["q"][row], history["v"][row]
    expected = q + v * t + np.array([0, 0, -G / 2]) * t**2
    assert abs(history["q"][row:] - expected).max() < 1e-11
    assert np.array_equal(history.position(bob.place()), history["q"])
    # velocities between nodes are off the hidden constraints by O(h^2): their energy is lost
    assert abs(found.loss) < (1e-9 if step == "equal" else 1e-4)
    if scheme.conserves.startswith("energy"):
        assert abs(history["energy_balance"]).max() < 1e-11
    assert np.isnan(history["joint/rod/force"][row:]).all()
    assert np.isfinite(history["joint/rod/force"][:row]).all()


@pytest.mark.slow
def test_angle_counts_modulo_turns_and_directions():
    """A wheel that goes round: only where the level is, not half a turn off."""
    model = sc.Model()
    wheel = model.add("wheel", sc.RigidBody.sphere(1.0, 1.0, angular_velocity=(0, 0, 5.0)))
    pin = sc.JointRevolute(sc.ground((0, 0, 0)), wheel.at((0, 0, 0)), axis=(0, 0, 1))
    model.add("pin", pin)
    events = [
        sc.Event(sc.ConditionCoordinate("pin", 2.0), once=False, name="passes"),
        sc.Event(sc.ConditionCoordinate(pin, 2.0), direction=-1, name="never"),
        sc.Event(lambda t, view: t - 0.7, name="of your own"),
    ]
    run = model.freeze(), sc.EnergyMomentum(), sc.NullSpace(), 0.01, 3.0
    history = sc.simulate(*run, events=events)
    rate = history["joint/pin/angle"][-1] / 3.0
    times = [e.time for e in history.events if e.name == "passes"]
    assert times == pytest.approx([(2.0 + 2 * np.pi * k) / rate for k in range(3)], abs=1e-5)
    assert {e.name: e.time for e in history.events}["of your own"] == pytest.approx(0.7, abs=1e-12)
    assert "never" not in [e.name for e in history.events]
    assert np.ptp(np.diff(history.times[history.times > times[-1]])) < 1e-12


@pytest.mark.slow
def test_conditions_see_what_the_history_tells():
    """Energy, reaction, rate and sensors, each at the level it is to reach."""
    system, bob, rod = pendulum()
    place = bob.place()
    levels = {
        "kinetic": sc.ConditionEnergy(4.0, kinetic=True),
        "energy": sc.ConditionEnergy(5.0),
        "tension": sc.ConditionReaction(rod, 15.0),
        "speed": sc.ConditionSensor(sc.SensorVelocity(place), 3.0),
        "time": sc.ConditionTime(0.123),
    }
    events = [sc.Event(condition, name=name) for name, condition in levels.items()]
    run = system, sc.EnergyMomentum(), sc.NullSpace(), 1e-3, 0.55
    history = sc.simulate(*run, events=events)
    rows = {event.name: event.row for event in history.events}
    assert set(rows) == set(levels)
    energy, v = history["energy"], np.linalg.norm(history["v"], axis=1)
    assert energy[rows["kinetic"]] == pytest.approx(4.0, abs=1e-4)
    assert energy[rows["energy"]] == pytest.approx(5.0, abs=1e-4)
    assert v[rows["speed"]] == pytest.approx(3.0, abs=1e-9)
    # m (v^2/r + g cos) with v^2 = 2 g cos: the force is three times the weight's part
    height = -history["q"][rows["tension"], 2]
    assert 3 * G * height == pytest.approx(15.0, abs=1e-3)
    assert history.times[rows["time"]] == pytest.approx(0.123, abs=1e-12)


# -- what they do ----------------------------------------------------------------------------------


def test_stop():
    """The run ends at the event's state."""
    system, bob, _ = pendulum()
    event = sc.Event(across(bob), sc.ActionStop(), name="stop")
    history = sc.simulate(system, sc.EnergyMomentum(), sc.NullSpace(), 0.01, 2.0, events=[event])
    assert history.status == "stopped" and history.times[-1] == history.events[0].time
    assert abs(history["q"][-1, 0]) < 1e-10


LOCKED = both_steps([*SINGLE[:-1], *(scheme for scheme in SCHEMES if stabilized(scheme))])


@pytest.mark.one_quick
@pytest.mark.parametrize(("scheme", "step", "treatment"), with_treatments(LOCKED), ids=str)
def test_two_bars_lock(scheme, step, treatment):
    """Momenta are kept, the energy falls by the formula, the angle stays as it is.

    To rounding where velocities are on the constraints.
    """
    system, _, _, pin = bars()
    event = sc.Event(sc.ConditionCoordinate(pin, 0.35), sc.ActionLock(pin), name="lock")
    history = sc.simulate(system, scheme, treatment, STEPS[step], 0.3, events=[event])
    (found,) = history.events
    row = found.row
    q, v = history["q"][row], history["v"][row]
    first = [system.frame_place(name) for name in "ab"]
    # rotated into the frame of the first bar
    d = q[first[0] + 3 : first[0] + 6]
    turn = np.array([[d[0], d[1]], [-d[1], d[0]]])
    speeds = np.array([turn @ v[k : k + 2] for k in first])
    spins = [
        sum(np.cross(q[k + i : k + i + 3], v[k + i : k + i + 3])[2] for i in (3, 6, 9)) / 2
        for k in first
    ]
    angle, momenta = history["joint/pin/angle"], ("linear_momentum", "angular_momentum")
    close = 1e-10 if stabilized(scheme) else 2e-3
    assert found.loss == pytest.approx(loss_of(speeds, spins, angle[row]), rel=close)
    if scheme.conserves.startswith("linear and angular") or "energy, linear" in scheme.conserves:
        assert abs(history["energy_balance"]).max() < 1e-10
        for name in momenta:
            assert np.ptp(history[name], axis=0).max() < 1e-10
    for name in momenta:
        assert abs(history[name][row + 1] - history[name][row]).max() < 1e-10
    assert abs(angle[row + 1 :] - 0.35).max() < 1e-10
    assert abs(history["joint/pin/angle_rate"][row + 1 :]).max() < 1e-10
    balance = history.meta["energy_balance"]
    assert balance["dissipated"] == pytest.approx(found.loss, rel=1e-9)
    assert balance["end"] == pytest.approx(history["energy"][-1], rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("treatment", TREATMENTS)
def test_lock_unlock_release(treatment):
    """One after the other, restarts in between; the same as in one run."""
    system, _, _, pin = bars()
    events = [
        sc.Event(sc.ConditionCoordinate("pin", 0.4), sc.ActionLock("pin"), name="lock"),
        sc.Event(sc.ConditionTime(0.3), sc.ActionUnlock("pin"), name="unlock"),
        sc.Event(sc.ConditionTime(0.4), sc.ActionRelease(pin), name="release"),
    ]
    for scheme in (sc.EnergyMomentum(), sc.GeneralizedAlpha(0.5)):
        run = scheme, TREATMENTS[treatment], 0.01, 0.5
        whole = sc.simulate(system, *run, events=events)
        assert [e.name for e in whole.events] == ["lock", "unlock", "release"]
        assert len(whole.segments) == 4
        for rows in (whole.segments[1][1] - 1, whole.segments[2][1] - 1, whole.segments[3][1] - 2):
            cut = whole.truncated(rows)
            now, left = sc.after_events(system, cut, events)
            start = sc.restart(now, cut, scheme, 0.01)
            again = sc.simulate(now, *run, start=start, events=left)
            assert [e.name for e in again.events] == [e.name for e in left]
            assert np.allclose(again["q"][-1], whole["q"][-1], rtol=0, atol=1e-11)
    with pytest.raises(sc.HistoryError, match="belongs to another model"):
        sc.restart(system, cut, scheme, 0.01)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("treatment", "planar"),
    [("null space", None), ("multipliers", sc.Planar(normal=(0, 1, 0)))],
    ids=["space", "plane"],
)
def test_nothing_is_left_to_move(treatment, planar):
    """A pendulum that is locked to the ground hangs there: the moment of its weight."""
    model = sc.Model()
    bar = model.add("bar", sc.RigidBody.box(1.0, (1.0, 0.05, 0.05), position=(0.5, 0, 0)))
    pin = sc.JointRevolute(sc.ground((0, 0, 0)), bar.at((0, 0, 0)), axis=(0, 1, 0))
    model.add("pin", pin)
    model.add("gravity", sc.LoadGravity((0, 0, -G)))
    event = sc.Event(sc.ConditionCoordinate(pin, 0.5), sc.ActionLock(pin), name="lock")
    run = model.freeze(planar), sc.EnergyMomentum(), TREATMENTS[treatment], 0.01, 0.6
    history = sc.simulate(*run, events=[event])
    row = history.events[0].row + 1
    assert history["joint/pin/moment"][-1, 1] == pytest.approx(-0.5 * G * np.cos(0.5), abs=1e-9)
    assert abs(history["q"][row:] - history["q"][row]).max() < 1e-14
    assert history["energy"][-1] < 1e-20
    assert abs(history["energy_balance"]).max() < 1e-12


@pytest.mark.one_quick
@pytest.mark.parametrize("treatment", TREATMENTS)
def test_a_closed_loop_is_opened(treatment):
    """A four-bar linkage loses a hinge, then its crank's end is locked; energy balances."""
    system = four_bar().freeze()
    start = sc.initial_state(system, rates={"pin 0": 2.0})
    events = [
        sc.Event(sc.ConditionTime(0.05), sc.ActionRelease("pin 3"), name="open"),
        sc.Event(sc.ConditionTime(0.1), sc.ActionLock("pin 1"), name="lock"),
    ]
    run = system, sc.EnergyMomentum(), TREATMENTS[treatment], 0.01, 0.15
    history = sc.simulate(*run, start=start, events=events)
    assert history.events[1].loss > 1e-3
    assert abs(history["energy_balance"]).max() < 1e-11
    assert history["constraint_violation"].max() < 1e-12


@pytest.mark.slow
@pytest.mark.parametrize(("scheme", "treatment"), with_treatments([(s,) for s in SINGLE]), ids=repr)
def test_load_switched_off(scheme, treatment):
    """Momentum grows up to the event's time, exactly, and not after it."""
    model = sc.Model()
    ball = model.add("ball", sc.MassPoint(2.0))
    push = model.add("push", sc.LoadForce(ball.place(), (3.0, 0, 0)))
    later = model.add("later", sc.LoadForce(ball.place(), lambda t: (0, t, 0)))
    events = [
        sc.Event(sc.ConditionTime(0.4321), sc.ActionLoad(push, 0.0), name="off"),
        sc.Event(sc.ConditionTime(0.6), sc.ActionLoad("later", 2.0), name="more"),
        sc.Event(sc.ConditionTime(0.8), sc.ActionLoad(later, 0.0), name="none"),
    ]
    history = sc.simulate(model.freeze(), scheme, treatment, 0.01, 0.9, events=events)
    p = history["linear_momentum"]
    rows = [event.row for event in history.events]
    # generalized-alpha integrates forces by the trapezoidal rule of its own, shifted by a share
    close = 2e-2 if scheme.name.startswith("generalized") else 1e-10
    assert p[rows[0]][0] == pytest.approx(3.0 * 0.4321, abs=close)
    assert p[-1, 0] == pytest.approx(3.0 * 0.4321, abs=close)
    assert p[-1, 1] == pytest.approx(0.6**2 / 2 + 2 * (0.8**2 - 0.6**2) / 2, abs=close)


@pytest.mark.slow
def test_function_gives_the_model_to_go_on_with():
    """A second model with the gravity turned."""
    other, _ = ball(height=1.0, gravity=(5.0, 0, 0))
    turn = sc.Event(sc.ConditionTime(0.1), lambda t, view: other, name="turn")
    run = ball(height=1.0)[0], sc.EnergyMomentum(), sc.NullSpace(), 0.01, 0.2
    history = sc.simulate(*run, events=[turn])
    expected = 5.0 * 0.1**2 / 2, 0.0, 1 - G * 0.1**2 / 2 - G * 0.1 * 0.1
    assert history["q"][-1] == pytest.approx(expected, abs=1e-10)


# -- several, and none -----------------------------------------------------------------------------


def test_several_in_one_step():
    """The earliest first, those of one instant together."""
    system, _, _ = pendulum()
    times = {"c": 0.0534, "a": 0.0512, "b": 0.0512, "d": 0.0999}
    events = [sc.Event(sc.ConditionTime(t), name=name) for name, t in times.items()]
    run = system, sc.EnergyMomentum(), sc.NullSpace(), 0.05, 0.2
    history = sc.simulate(*run, events=events)
    assert [event.name for event in history.events] == ["a", "b", "c", "d"]
    assert [e.time for e in history.events] == pytest.approx(sorted(times.values()), abs=1e-10)


def test_at_the_start_is_not_an_event():
    """What starts at its level has not passed it: it does half a swing later."""
    system, bob, _ = pendulum(rate=0.1)
    event = sc.Event(across(bob), sc.ActionStop(), name="lowest")
    history = sc.simulate(system, sc.EnergyMomentum(), sc.NullSpace(), 0.01, 2.0, events=[event])
    assert history.events[0].time == pytest.approx(np.pi / np.sqrt(G), rel=1e-3)


def test_what_does_not_happen():
    """No sign change: the run is complete, its list of events empty."""
    system, bob, _ = pendulum()
    high = sc.ConditionSensor(sc.SensorPosition(bob.place()), level=1.0, component=2)
    run = system, sc.EnergyMomentum(), sc.NullSpace(), 0.05, 0.5
    history = sc.simulate(*run, events=[sc.Event(high, sc.ActionStop())])
    assert history.status == "completed" and history.events == []
    plain = sc.simulate(*run)
    assert np.array_equal(history["q"], plain["q"])


@pytest.mark.slow
def test_endless_repetition_is_an_error():
    """A ball that is lifted by a hair's breadth each time it falls below the floor."""

    def lifted(time, view):
        q = view.q + np.array([0, 0, 1e-9])
        return sc.initial_state(view.system, q, view.v, time=time)

    floor = sc.Event(lambda t, view: view.q[2], lifted, once=False, name="floor")
    run = ball(height=0.1)[0], sc.EnergyMomentum(), sc.NullSpace(), 0.02, 2.0
    with pytest.raises(sc.Diverged, match="event 'floor' repeats at once: 20 times") as caught:
        sc.simulate(*run, events=[floor])
    assert caught.value.history.times[-1] == pytest.approx(np.sqrt(0.02), abs=1e-6)
    assert len(caught.value.history.events) == 20


# -- twice within a step ---------------------------------------------------------------------------


def thrown(apex):
    """A ball of 1 kg thrown upwards, at rest after a time (s) at G apex^2/2."""
    model, flying = ball(up=G * apex)
    return model.freeze(), sc.SensorPosition(flying.place())


#: of the step: where the ball is at rest, for how long it is above the level, half of it
RESTS = {"first": 0.45, "second": 1.6, "later": 5.4}
HALF = 0.3


@pytest.mark.one_quick
@pytest.mark.parametrize(
    ("scheme", "rest", "direction"),
    [
        *((scheme, "later", 0) for scheme in PLAIN),
        *((sc.EnergyMomentum(), *case) for case in zip(RESTS, (1, 0, -1), strict=True)),
    ],
    ids=str,
)
def test_threshold_is_touched_for_less_than_a_step(scheme, rest, direction):
    """Both passages of a parabola that is below the level at all ends of steps: closed form."""
    h = 0.02
    apex = RESTS[rest] * h
    system, height = thrown(apex)
    level = G * (apex**2 - (HALF * h) ** 2) / 2
    condition = sc.ConditionSensor(height, level, component=2)
    event = sc.Event(condition, direction=direction, once=False, name="up there")
    history = sc.simulate(system, scheme, sc.NullSpace(), h, 0.2, events=[event])
    plain = sc.simulate(system, scheme, sc.NullSpace(), h, 0.2)
    assert plain["q"][:, 2].max() < level
    above = sc.ConditionSensor(height, G * apex**2 / 2 + 1e-9, component=2)
    just_not = [sc.Event(above, name="above it")]
    assert not sc.simulate(system, scheme, sc.NullSpace(), h, 0.2, events=just_not).events
    times = [apex - HALF * h, apex + HALF * h]
    expected = {0: times, 1: times[:1], -1: times[1:]}[direction]
    # generalized-alpha begins with the acceleration of its own instant: the same parabola
    assert [e.time for e in history.events] == pytest.approx(expected, abs=1e-11)


@pytest.mark.slow
def test_bounces_shorter_than_a_step():
    """Of a ball that keeps 30 % of its velocity: all times by the closed form."""

    def back(time, view):
        return sc.initial_state(view.system, view.q, -0.3 * view.v, time=time)

    floor = sc.Event(lambda t, view: view.q[2], back, direction=-1, once=False, name="floor")
    flights = np.sqrt(2 / G) * np.array([1.0, *(2 * 0.3 ** np.arange(1, 7))])
    expected = flights.cumsum()
    until = expected[-1] + 1e-4
    run = ball(height=1.0)[0], sc.EnergyMomentum(), sc.NullSpace(), 0.05
    history = sc.simulate(*run, until, events=[floor], derive=False)
    assert flights[3] < 0.05
    assert history.events[0].loss == pytest.approx((1 - 0.3**2) * G, abs=1e-9)
    assert [e.time for e in history.events] == pytest.approx(expected, abs=1e-8)


@pytest.mark.parametrize("what", ["kinetic", "speed"])
def test_what_is_fast_for_less_than_the_first_step(what):
    """A pendulum passes its lowest point in it; also in the step behind another event."""
    h, v = 0.05, 1.0
    c, s = np.cos(v * h / 2), -np.sin(v * h / 2)
    model, bob, _ = ball_on_rod((s, 0, -c), (v * c, 0, v * s), g=G)
    lowest = np.sqrt(v**2 + 2 * G * (1 - c))
    condition = {
        "kinetic": sc.ConditionEnergy((lowest**2 + v**2) / 4, kinetic=True),
        "speed": sc.ConditionSensor(sc.SensorVelocity(bob.place()), (lowest + v) / 2),
    }[what]
    events = [sc.Event(condition, name="fast"), sc.Event(sc.ConditionTime(1e-4), name="before")]
    run = sc.simulate(model, sc.EnergyMomentum(), sc.NullSpace(), h, h, events=events)
    assert [event.name for event in run.events] == ["before", "fast"]
    assert 0 < run.events[-1].time < h / 2


# -- what is refused -------------------------------------------------------------------------------


def refused(events, words, error=sc.InputError, scheme=None):
    system, _, _ = pendulum()
    pair = (sc.EnergyMomentum() if scheme is None else scheme), sc.Multipliers()
    with pytest.raises(error) as caught:
        sc.simulate(system, *pair, 0.01, 1.0, events=events)
    for word in words:
        assert word in str(caught.value)


def test_bad_events():
    """Clear errors before the run."""
    refused([sc.Event(lambda t, view: np.nan, name="odd")], ["'odd'", "nan", "t = 0"])
    refused([sc.Event(lambda t, view: view.q, name="odd")], ["'odd'", "shape (3,)"])
    refused([sc.Event(sc.ConditionCoordinate("knee", 1.0), name="k")], ["'k'", "'knee'", "'rod'"])
    refused([sc.Event(sc.ConditionTime(1.0), sc.ActionLock("knee"))], ["'knee'", "'rod'"])
    refused([sc.Event(sc.ConditionTime(1.0), sc.ActionLoad("wind", 0.0))], ["'wind'", "gravity"])
    refused([sc.Event(sc.ConditionTime(1.0))] * 2, ["two events", "'event'"])
    refused(["stop"], ["expected an Event"])
    refused(sc.Event(sc.ConditionTime(1.0)), ["expected a list"])
    with pytest.raises(sc.InputError, match="direction = 2"):
        sc.Event(sc.ConditionTime(1.0), direction=2)
    with pytest.raises(sc.InputError, match="expected a Condition or a function"):
        sc.Event(1.0)
    with pytest.raises(sc.InputError, match="it has none"):
        sc.Event(sc.ConditionCoordinate("rod", 1.0)).condition.check(pendulum()[0])


@pytest.mark.slow
def test_bad_events_in_a_run():
    """NaN later on, a mass point that cannot be locked: the history so far is kept."""
    system, _, rod = pendulum()
    run = system, sc.EnergyMomentum(), sc.NullSpace(), 0.01, 1.0
    odd = sc.Event(lambda t, view: 1.0 if t < 0.5 else np.nan, name="odd")
    with pytest.raises(sc.InputError, match=r"event 'odd': its condition is nan at t = 0\.5") as e:
        sc.simulate(*run, events=[odd])
    assert e.value.history.times[-1] == pytest.approx(0.49)
    with pytest.raises(sc.IncompatibleError, match="lock of the distance joint 'rod'"):
        sc.simulate(*run, events=[sc.Event(sc.ConditionTime(0.5), sc.ActionLock(rod))])
    with pytest.raises(sc.InputError, match="is not locked"):
        sc.simulate(*run, events=[sc.Event(sc.ConditionTime(0.5), sc.ActionUnlock(rod))])


def test_explicit_schemes_are_refused():
    """Their steps cannot be shortened: both are named."""
    event = sc.Event(sc.ConditionTime(0.5), name="half")
    refused([event], ["'half'", "Explicit(rounds=1)"], sc.IncompatibleError, sc.Explicit())


@pytest.mark.slow
def test_a_killed_run_has_the_events_of_its_states(tmp_path):
    """A file as it is while the run goes on: states are written in blocks, events with them."""
    model, flying = ball()
    events = [
        sc.Event(sc.ConditionTime(0.05), lambda t, view: None, name="seen"),
        sc.Event(sc.ConditionTime(0.1), sc.ActionLoad("gravity", 0.0), name="off"),
    ]
    path, killed = tmp_path / "run.history", tmp_path / "killed.history"

    def look(report):
        if report.state.index == 450:
            shutil.copy(path, killed)

    run = model, sc.EnergyMomentum(), sc.NullSpace(), 1e-2, 5.0
    seen = {"ball": sc.SensorPosition(flying.place())}
    whole = sc.simulate(*run, path=path, events=events, sensors=seen, callbacks=[look])
    history = sc.History.load(killed)
    assert history.status == "killed" and 300 < len(history) < 450
    assert [event.name for event in history.events] == ["seen", "off"]
    assert len(history.segments) == 2 and len(history.sensors["ball"].times) > 300
    system, left = sc.after_events(model, history, events)
    assert left == []
    # what is continued from it has no gravity any more
    start = sc.restart(system, history, sc.EnergyMomentum(), 1e-2)
    on = sc.simulate(system, *run[1:], start=start, derive=False)
    assert on["q"][-1] == pytest.approx(whole["q"][-1], abs=1e-12)
    # the whole file has them, too
    again = sc.History.load(path)
    assert again.events == whole.events and again.segments == whole.segments
    assert "off" in str(again.events[1]) and "ActionLoad(gravity" in str(again.events[1])


# -- compiled kernels ------------------------------------------------------------------------------


def swinging_rod(sprung=False, section=None):
    """A beam on a hinge, as compiled kernels take it, perhaps with a spring."""
    section = full_section() if section is None else section
    model, mesh = sc.Model(), sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 6, name="rod")
    rod = model.add("rod", sc.Beam(mesh, section, order=1, director=(0, 1, 0)))
    hinge = sc.JointRevolute(sc.ground((0, 0, 0)), rod.node("rod.start"), axis=(0, 0, 1))
    model.add("hinge", hinge)
    model.add("gravity", sc.LoadGravity((0, -G, 0)))
    if sprung:
        model.add("spring", sc.JointSpringDamper(hinge, stiffness=3.0, damping=0.1))
    return model.freeze(), rod


def looking(rod, level=1e9):
    """Conditions of every kind, which are not met."""
    end = rod.node("rod.end")
    return {
        "energy": sc.ConditionEnergy(level),
        "kinetic": sc.ConditionEnergy(level, kinetic=True),
        "angle": sc.ConditionCoordinate("hinge", 3.0),
        "rate": sc.ConditionCoordinate("hinge", level, rate=True),
        "velocity": sc.ConditionSensor(sc.SensorVelocity(end), level),
        "strain": sc.ConditionSensor(sc.SensorStrain(rod, 0.4), level),
        "middle": sc.ConditionSensor(sc.SensorPosition(rod, 0.4), level),
    }


def two_orders():
    """Beams of two orders on a ball joint, and a spring between them."""
    model, places = sc.Model(), []
    for order in (1, 2):
        mesh = sc.MeshCurve.init_line((order - 1, 0, 0), (order, 0, 0), 3, name=f"m{order}")
        rod = model.add(
            f"rod {order}", sc.Beam(mesh, full_section(), order=order, director=(0, 1, 0))
        )
        places += [rod.node(f"m{order}.start"), rod.node(f"m{order}.end")]
    model.add("pin", sc.JointSpherical(*places[1:3]))
    model.add("spring", sc.SpringDamper(places[0], places[3], stiffness=5.0))
    model.add("force", sc.LoadForce(places[3], (0, -1.0, 2.0)))
    return model.freeze()


def unsheared():
    """A beam whose strains are held by rows."""
    model = sc.Model()
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 2, name="rod")
    theory = sc.TheoryKirchhoff()
    rod = model.add("rod", sc.Beam(mesh, full_section(), theory=theory, director=(0, 1, 0)))
    model.add("hinge", sc.JointSpherical(sc.ground((0, 0, 0)), rod.node("rod.start")))
    model.add("gravity", sc.LoadGravity((0, -G, 0)))
    return model.freeze()


LOOKED_AT = {
    "rod": lambda: swinging_rod()[0],
    "unsheared": unsheared,
    "triads of nodes": lambda: corner(1),
    "bodies": lambda: chain(4),
    "two orders": two_orders,
}


@pytest.mark.slow
@needs_numba
@pytest.mark.parametrize("name", LOOKED_AT)
def test_kernels_agree_on_velocities_and_energies(name):
    """Of many states as of diagnostics, and of one state to the last bit as among many."""
    system = LOOKED_AT[name]()
    history = sc.simulate(system, sc.EnergyMomentum(), sc.NullSpace(), 2e-3, 0.02)
    q, p = history["q"], history["carried"]
    motions = CompiledMotion(system, sc.NewtonSettings())
    v, kinetic, stored = motions(q, p)
    expected = diagnostics.Projection(system).velocities(q, p, history.times)
    assert v == pytest.approx(expected, rel=1e-11, abs=1e-11)
    expected = diagnostics.kinetic_energy_of_velocity(system, expected)
    assert kinetic == pytest.approx(expected, rel=1e-11) and kinetic.max() > 1e-4
    assert stored == pytest.approx(diagnostics.strain_energy(system, q), rel=1e-11, abs=1e-15)
    assert bool(system.beam_groups) == (stored.max() > 1e-9)
    one = motions(q[7], p[7])
    np.testing.assert_array_equal(one.v, v[7])
    assert (float(one.kinetic), float(one.stored)) == (kinetic[7], stored[7])


def rising(eps):
    """A stored energy that is no quadratic form: kernels find the velocities only."""
    return 0.5 * (np.array([1e3, 1e3, 2e3, 1.0, 1.0, 1.0]) * eps**2).sum(-1) + eps[..., 4] ** 4


@pytest.mark.slow
@needs_numba
@pytest.mark.parametrize("law", [False, True])
@pytest.mark.parametrize("kinetic", [False, True])
def test_kernels_agree_on_the_time_of_an_energy(kinetic, law):
    times = []
    for kernels in ("numpy", "numba"):
        section = sc.SectionHyperelastic(rising, 1.0, inertia=(1e-3, 1e-3)) if law else None
        system, _ = swinging_rod(section=section)
        events = [sc.Event(sc.ConditionEnergy(0.02, kinetic=kinetic), name="reached")]
        run = system, sc.EnergyMomentum(), sc.NullSpace(), 2e-3, 0.1
        history = sc.simulate(*run, events=events, kernels=kernels, derive=False)
        times.append([event.time for event in history.events])
    assert len(times[0]) == 1
    assert times[1] == pytest.approx(times[0], abs=1e-11)


def locked_in_flight():
    """A flexible arm that falls about its hinge, and the event that locks it."""
    alu = sc.SectionRectangle(4e-3, 3e-2, sc.Material(E=70e9, nu=0.33, rho=2700))
    mesh = sc.MeshCurve.init_line((0, 0, 0), (0.8, 0, 0), 6, name="arm")
    model = sc.Model()
    arm = model.add("arm", sc.Beam(mesh, alu, order=2, director=(0, 0, 1)))
    hinge = sc.JointRevolute(sc.ground((0, 0, 0)), arm.node("arm.start"), axis=(0, -1, 0))
    model.add("hinge", hinge)
    model.add("gravity", sc.LoadGravity((0, 0, -9.81)))
    return model, sc.Event(sc.ConditionTime(0.1013), sc.ActionLock("hinge"), name="lock")


@pytest.mark.slow
@pytest.mark.parametrize(
    "scheme", [sc.EnergyMomentum(), sc.EnergyDecaying(chi=0.05), sc.GeneralizedAlpha()], ids=repr
)
def test_events_see_the_reactions_of_the_history(scheme):
    """After a lock, too, with vibrations that steps do not resolve: without their alternation."""
    model, lock = locked_in_flight()
    seen = {}

    def look(time, view):
        seen[time] = view.reaction("hinge")[1][1]
        return -1.0

    run = sc.simulate(
        *(model, scheme, sc.NullSpace(), 1e-3, 0.13), events=[lock, sc.Event(look, name="look")]
    )
    own = run["joint/hinge/moment"][:, 1]
    found = np.array([seen[t] for t in run.times])
    after = np.arange(len(run)) > run.events[0].row
    assert abs(own[after]).max() > 0.5
    assert abs(found - own)[after].max() < 0.1 * abs(own).max()
    assert abs(found - own)[: run.events[0].row].max() < 1e-6 * abs(own).max()


@pytest.mark.parametrize("sign", [1, -1])
def test_a_component_of_a_reaction_has_its_sign(sign):
    """Weight on a hinge at rest turned upside down by a load: its vertical force passes zero.

    ``F = m (g - a t)``: at t = g/a the magnitude only touches zero.
    """
    model = sc.Model()
    body = model.add("body", sc.RigidBody(2.0, (1.0, 1.0, 1.0)))
    slide = sc.JointFixed(sc.ground((0, 0, 0)), body.at((0, 0, 0)))
    model.add("hold", slide)
    model.add("stone", sc.MassPoint(1.0, (5, 0, 0)))
    model.add("lift", sc.LoadForce(body.at((0, 0, 0)), (0, 0, 20.0), lambda t: 10 * t))
    model.add("weight", sc.LoadForce(body.at((0, 0, 0)), (0, 0, -20.0)))
    condition = sc.ConditionReaction("hold", level=sign * 5.0, component=2)
    event = sc.Event(condition, name="passed")
    run = sc.simulate(model, sc.EnergyMomentum(), sc.NullSpace(), 0.01, 0.2, events=[event])
    assert [found.time for found in run.events] == pytest.approx([0.1 - sign * 0.025], abs=1e-9)
    with pytest.raises(sc.InputError, match=r"component = 3, expected 0, 1, 2 or None"):
        sc.ConditionReaction("hold", 5.0, component=3)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("treatment", "kernels"),
    [(sc.Multipliers(), "numpy"), pytest.param(sc.NullSpace(), "numba", marks=needs_numba)],
)
def test_a_step_after_a_lock_begins_with_a_change_of_rounding(treatment, kernels):
    """Two bars in one: they swing as a rigid pendulum, of which the decaying scheme takes nothing.

    Where directors moved by rounding the first guess once ended there, with the bars flung back and
    0.5 J of 3 J gone.
    """
    model, ends = sc.Model(), [sc.ground((0, 0, 0))]
    for k, name in enumerate(("pin", "knee")):
        bar = sc.RigidBody.box(1.0, (0.5, 0.02, 0.02), position=(0.25 + k / 2, 0, 0))
        model.add(f"bar {k}", bar)
        model.add(name, sc.JointRevolute(ends[-1], bar.at((k / 2, 0, 0)), axis=(0, 1, 0)))
        ends.append(bar.at((0.5, 0, 0)))
    model.add("gravity", sc.LoadGravity((0, 0, -G)))
    lock = sc.Event(sc.ConditionTime(0.2), sc.ActionLock("knee"))
    run = sc.simulate(
        *(model, sc.EnergyDecaying(), treatment, 2e-3, 0.3), events=[lock], kernels=kernels
    )
    after = run.segment(-1)
    whole = after["energy"] + after["external"]
    assert abs(whole - whole[0]).max() < 1e-3 * after["energy"][-1]
    assert (np.diff(after["joint/pin/angle"]) > 0).all()
