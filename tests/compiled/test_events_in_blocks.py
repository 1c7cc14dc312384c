"""Events among several steps in one compiled call: the same ones as those of single steps."""

from __future__ import annotations

import numpy as np
import pytest
import test_closed_loops
from helpers_kernels import integrators, treatments
from test_blocks_of_steps import (
    add_changing,
    add_nothing,
    add_springs,
    assert_the_same,
    blocks,
    run,
    scene,
)
from test_events import swinging_rod

import skfem_cosserat as sc

from helpers_kernels import INTEGRATORS, TREATMENTS  # isort: skip

pytest.importorskip("numba")

__all__ = ["blocks"]
H = 2e-3
pairs = pytest.mark.parametrize(
    ("integrator", "treatment"),
    [("variational", "null space"), ("energy-momentum", "multipliers")],
)


def alone(*given, **options):
    """The same run, of which a callback gets each step."""
    return run(*given, callbacks=[lambda report: None], **options)


def assert_the_same_events(blocks, *given, least=1, **options):
    """Of single steps, and of steps in one go; the history."""
    blocks.clear()
    one, error = alone(*given, **options)
    assert not blocks
    many, other = run(*given, **options)
    # the steps tried around an event begin with what was kept of others: they differ by rounding
    assert_the_same(one, many, rel=1e-8)
    for found, expected in zip(many.events, one.events, strict=True):
        assert found.time == pytest.approx(expected.time, abs=1e-11)
        assert found.loss == pytest.approx(expected.loss, rel=1e-9, abs=1e-12)
        assert (
            found[3:5] + found[6:] == expected[3:5] + expected[6:] and found.name == expected.name
        )
    assert str(error) == str(other) and len(many.events) >= least
    assert blocks
    return many


def levels(rod, history):
    """Conditions of every kind, with levels that are reached in a run."""
    end = rod.node("rod.end")
    x = history.position(end)[:, 0]
    angle, rate = history["joint/hinge/angle"], history["joint/hinge/angle_rate"]
    speed = np.linalg.norm(history.velocity(end), axis=1)
    strain = sc.SensorStrain(rod, 0.4)
    return {
        "energy": sc.ConditionEnergy(float(history["energy"].mean())),
        "kinetic": sc.ConditionEnergy(float(history["kinetic"].mean()), kinetic=True),
        "angle": sc.ConditionCoordinate("hinge", float(angle.mean())),
        "rate": sc.ConditionCoordinate("hinge", float(rate.mean()), rate=True),
        "speed": sc.ConditionSensor(sc.SensorVelocity(end), float(speed.mean())),
        "x": sc.ConditionSensor(sc.SensorPosition(end), float(x.mean()), component=0),
        "bending": sc.ConditionSensor(strain, 0.0, component=5),
        "of a user": lambda time, view: float(view.q[-1]),
    }


@pytest.mark.slow
@integrators
@treatments
def test_events_of_every_kind(blocks, integrator, treatment):
    """Each time, in both directions; and once, in one, of those that are looked at together."""
    system, rod = swinging_rod()
    given = system, INTEGRATORS[integrator], TREATMENTS[treatment], H, 0.4
    plain = sc.simulate(*given, kernels="numba")
    found = levels(rod, plain)
    every = [sc.Event(each, name=name, once=False) for name, each in found.items()]
    history = assert_the_same_events(blocks, *given, events=every)
    assert {event.name for event in history.events} == set(found)
    found.pop("of a user")
    down = [sc.Event(each, name=name, direction=-1) for name, each in found.items()]
    assert_the_same_events(blocks, *given, events=down, every=7, least=3)


@pytest.mark.slow
@integrators
def test_at_every_place_of_a_block(blocks, integrator):
    """In each of the first steps, and at its end: some are a block's first, some its last."""
    system, _ = swinging_rod()
    given = system, INTEGRATORS[integrator], sc.NullSpace(), H, 22 * H
    for k in range(2, 19, 4):
        times = k * H, (k + 1.4) * H
        events = [sc.Event(sc.ConditionTime(t), name=f"at {t}") for t in times]
        history = assert_the_same_events(blocks, *given, events=events, least=2)
        assert [event.time for event in history.events] == pytest.approx(times, abs=1e-12)


@pytest.mark.slow
@pairs
def test_a_run_that_stops_in_a_block(blocks, integrator, treatment):
    """Its last row is completed by a step that is the same; the stepper counts the same steps."""
    system, _ = swinging_rod()
    given = system, INTEGRATORS[integrator], TREATMENTS[treatment], H, 1.0
    for at in (0.2, 0.2 + 0.3 * H):
        stop = sc.Event(sc.ConditionTime(at), sc.ActionStop())
        history = assert_the_same_events(blocks, *given, events=[stop])
        assert history.status == "stopped" and sum(blocks) > 100


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")  # a step is not small
@treatments
def test_what_events_do_in_between(blocks, treatment):
    """A joint is locked, unlocked and taken away, a load switched: systems change on the way."""
    system, _ = swinging_rod()
    given = system, sc.EnergyMomentum(), TREATMENTS[treatment], H, 0.4
    events = [
        sc.Event(sc.ConditionTime(0.0713), sc.ActionLock("hinge"), name="lock"),
        sc.Event(sc.ConditionTime(0.15), sc.ActionUnlock("hinge"), name="unlock"),
        sc.Event(sc.ConditionTime(0.2201), sc.ActionLoad("gravity", 0.5), name="load"),
        sc.Event(sc.ConditionTime(0.3), sc.ActionRelease("hinge"), name="release"),
    ]
    history = assert_the_same_events(blocks, *given, events=events, least=4)
    assert len(history.segments) == 5 and len(blocks) > 10


@pytest.mark.slow
@pairs
def test_loads_that_change_are_those_of_steps_that_are_solved_anew(blocks, integrator, treatment):
    """What a block has solved behind an event is taken back, with its loads."""
    system = scene(add_changing)
    given = system, INTEGRATORS[integrator], TREATMENTS[treatment], 6e-4, 0.12
    plain = sc.simulate(*given, kernels="numba")
    level = float(plain["energy"].mean())
    events = [
        sc.Event(sc.ConditionEnergy(level), name="energy", once=False),
        *(sc.Event(sc.ConditionTime(t), name=f"at {t}") for t in (0.0101, 0.05, 0.0777)),
    ]
    assert_the_same_events(blocks, *given, events=events, least=4)


def test_a_number_that_only_dips_below_zero(blocks):
    """Between two states of a block, where a ball turns: two events within a step."""
    model = sc.Model()
    ball = model.add("ball", sc.MassPoint(1.0, velocity=(0, 0, 3.0)))
    model.add("gravity", sc.LoadGravity((0, 0, -10.0)))
    top, middle = 0.45, 0.3  # of a parabola, which the scheme has at all times
    h = 2 * middle / 101  # the middle is between two states
    low = sc.ConditionSensor(sc.SensorPosition(ball.place()), top - 1.25 * (h / 4) ** 2, 2)
    given = model.freeze(), sc.EnergyMomentum(), sc.NullSpace(), h, 101 * h
    history = assert_the_same_events(blocks, *given, events=[sc.Event(low, once=False)], least=2)
    first, then = history.events
    assert then.time - first.time == pytest.approx(h / 4, rel=1e-6)
    assert (first.time + then.time) / 2 == pytest.approx(middle, abs=1e-9)


def bound(model, rod, pin, end):
    """A load that moves with the end of the rod."""
    model.add("f", sc.LoadForce(end, (0, 0.1, 0), follower=True))


def roped(model, rod, pin, end):
    """A ball on a rope."""
    ball = model.add("b", sc.MassPoint(0.01, (1.2, 0, 0)))
    model.add("rope", sc.JointDistance(end, ball.place()))


PAIRS = [
    pytest.param(lambda: scene(add_nothing, sc.Planar()), sc.GeneralizedAlpha(0.8), id="plane"),
    pytest.param(lambda: test_closed_loops.frozen("three cranks"), sc.EnergyMomentum(), id="loop"),
    pytest.param(lambda: scene(bound), sc.Variational(stabilized=True), id="load that turns"),
    pytest.param(lambda: scene(roped), sc.EnergyMomentum(), id="rope"),
]


# cranks pass singular positions
@pytest.mark.one_quick
@pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")
@pytest.mark.parametrize(("make", "integrator"), PAIRS)
def test_scenes_and_schemes(blocks, make, integrator):
    """Energies, and a function."""
    given = make(), integrator, sc.NullSpace(), 1e-3
    kinetic = sc.simulate(*given, 0.15, kernels="numba")["kinetic"]
    events = [
        sc.Event(sc.ConditionEnergy(float(kinetic.mean()), kinetic=True), name="k", once=False),
        sc.Event(lambda time, view: np.sin(50 * time + 0.1), name="of a user", once=False),
    ]
    assert_the_same_events(blocks, *given, 0.15, events=events, least=2)
    assert_the_same_events(blocks, *given, 0.15, events=events[:1])
    assert max(blocks) > 8


def test_functions_of_users_see_no_later_state(blocks):
    """They are called at the states, and in the order, of single steps."""
    system, _ = swinging_rod()
    seen = []

    def look(time, view):
        seen.append((time, view.state.index, float(view.q[-1])))
        assert time < 0.1213 + H, "beyond the end of the run"
        return time - 0.1213

    event = sc.Event(look, sc.ActionStop())
    given = system, sc.EnergyMomentum(), sc.NullSpace(), H, 1.0
    orders = []
    for go in (alone, run):
        seen.clear()
        go(*given, events=[event])
        orders.append(list(seen))
    assert orders[0] == orders[1] and max(blocks) > 20

    def beyond(q, t):
        seen.extend(t)
        return q[:, -1] + 10.0

    seen.clear()
    quantity = sc.ConditionSensor(sc.SensorQuantity(lambda system, q, t: beyond(q, t)), 0.0)
    run(*given, events=[sc.Event(quantity, name="never"), event])
    assert 0.12 < max(t for t in seen if isinstance(t, float)) < 0.1213 + H


def test_a_law_of_a_user_is_not_asked_beyond_an_event(blocks):
    """Where kernels call Python, steps are taken one by one: it may fail at states that follow."""
    most = [np.inf]

    def energy(strain):
        if most[0] < abs(strain[..., 4]).max(initial=0.0) < 0.2:  # beyond, strains are tried
            raise ValueError("it is broken")
        return 0.5 * (np.array([1e3, 1e3, 2e3, 1.0, 1.0, 1.0]) * strain**2).sum(-1)

    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 2, name="rod")
    section = sc.SectionHyperelastic(energy, mass=1.0, inertia=(1e-3, 1e-3))
    model = sc.Model()
    rod = model.add("rod", sc.Beam(mesh, section, director=(0, 1, 0)))
    model.add("pin", sc.JointSpherical(sc.ground((0, 0, 0)), rod.node("rod.start")))
    model.add("force", sc.LoadForce(rod.node("rod.end"), (0, -5.0, 0)))
    given = model.freeze(), sc.EnergyMomentum(), sc.NullSpace(), 1e-3
    most[0] = 0.05
    with pytest.raises(Exception, match="it is broken"):
        run(*given, 0.03)
    bent = sc.ConditionSensor(sc.SensorStrain(rod, 0.25), 0.03)
    history, _ = run(*given, 0.03, events=[sc.Event(bent, sc.ActionStop())])
    assert history.status == "stopped" and len(history) > 15 and not blocks


def test_a_class_of_its_own_counts_by_its_own_value(blocks):
    """Whatever class it is derived from."""
    system, _ = swinging_rod()
    level = 0.02

    class ConditionHalf(sc.ConditionEnergy):
        def value(self, view):
            return view.kinetic_energy() / 2 - self.level

    given = system, sc.EnergyMomentum(), sc.NullSpace(), H, 0.2
    conditions = ConditionHalf(level), sc.ConditionEnergy(2 * level, kinetic=True)
    half, whole = (run(*given, events=[sc.Event(each)])[0].events[0] for each in conditions)
    assert half.time == pytest.approx(whole.time, abs=1e-11) and blocks


@pytest.mark.slow
def test_energy_of_what_winds_up(blocks):
    """Energies of force elements count with full turns of their angles."""
    system = scene(add_springs)
    given = system, sc.EnergyMomentum(), sc.NullSpace(), 6e-4, 0.12
    energy = sc.simulate(*given, kernels="numba")["energy"]
    levels = np.quantile(energy, [0.2, 0.4, 0.6, 0.8])
    events = [sc.Event(sc.ConditionEnergy(x), name=f"{x} J") for x in levels.tolist()]
    assert_the_same_events(blocks, *given, events=events, least=4)
    assert max(blocks) > 20


@pytest.mark.slow
def test_what_was_before_an_error_is_kept(blocks):
    """Of a function of a user, in a block: the history up to the state before it."""
    system, _ = swinging_rod()

    def fails(time, view):
        if time > 0.0711:
            raise KeyError("boom")
        return 1.0

    given = system, sc.EnergyMomentum(), sc.NullSpace(), H, 0.3
    histories = []
    for go in (alone, run):
        with pytest.raises(sc.InputError, match="boom") as caught:
            go(*given, events=[sc.Event(fails)])
        histories.append(caught.value.history)
    one, many = histories
    assert blocks and one.times[-1] > 0.0711 - H
    np.testing.assert_allclose(one.times, many.times, rtol=1e-11)
    for name in ("q", "carried", "work_loads"):
        np.testing.assert_allclose(one[name], many[name], rtol=1e-9, atol=1e-12)
