"""Steps that do not resolve the motion are told, those that do are not."""

from __future__ import annotations

import re
import warnings

import numpy as np
import pytest

import skfem_cosserat as sc
from skfem_cosserat.diagnostics import doubtful_steps, resolution

STEP = "do not resolve the motion|turns by"


def spring(stiffness=100.0):
    """A mass of 1 kg at a spring: 10 rad/s."""
    model = sc.Model()
    ball = model.add("ball", sc.MassPoint(1.0, position=(1.1, 0, 0)))
    place = sc.ground((0, 0, 0)), ball.place()
    model.add("spring", sc.SpringDamper(*place, stiffness=stiffness, length=1.0))
    return model


def spinning(rate):
    model = sc.Model()
    model.add("wheel", sc.RigidBody(1.0, (1.0, 1.0, 2.0), angular_velocity=(0, 0, rate)))
    return model


def run(model, step, count=60, integrator=None, **options):
    scheme = integrator or sc.EnergyMomentum()
    return sc.simulate(
        model, scheme, sc.NullSpace(), step, count * step, kernels="numpy", **options
    )


def steps_warned(history):
    texts = [each["text"] for each in history.meta["warnings"]]
    return [text for text in texts if re.search(STEP, text)]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scheme", "turns"),
    [(sc.EnergyMomentum(), (0.05, 0.1, 0.2)), (sc.Composition(sc.EnergyMomentum()), (1.0, 1.5))],
)
def test_estimate_is_the_error_of_fifty_steps(scheme, turns):
    """Of a vibration, whose phase is slow by (h omega)^3/12 in each step: until it is opposite.

    In parts s_k of a composed step it advances by the sum of 2 atan(s_k h omega/2).
    """
    model, omega = spring(), 10.0
    for turn in turns:
        h = turn / omega
        history = run(model, h, 50, scheme)
        x = history["q"][:, 0] - 1.0
        error = abs(x - 0.1 * np.cos(omega * history.times)).max() / 0.2
        found = resolution(model.freeze(), history)
        assert 0.5 * error < found.error < 2 * error
        assert found.period == pytest.approx(2 * np.pi / turn, rel=0.02)
        assert found.item == "mass point 'ball'"


@pytest.mark.one_quick
@pytest.mark.parametrize("turn", [0.05, 0.15])
def test_resolved_vibrations_are_not_told(turn):
    assert not steps_warned(run(spring(), turn / 10.0))


@pytest.mark.slow
@pytest.mark.parametrize("turn", [0.5, 3.0, 30.0])
def test_vibrations_that_are_not_resolved_are_told(turn):
    with pytest.warns(sc.AccuracyWarning, match=r"steps of \S+ s do not resolve the motion"):
        history = run(spring(), turn / 10.0)
    energy = history["energy"]
    np.testing.assert_allclose(energy, energy[0], rtol=1e-9)  # which says nothing of it


@pytest.mark.slow
def test_rotations_that_are_not_resolved_are_told():
    """Energy-momentum turns 92.7 rad of 100 at 1 rad in a step."""
    with pytest.warns(sc.AccuracyWarning, match=r"'wheel' turns by 0\.93 rad in each step"):
        history = run(spinning(1.0), 1.0, 100)
    assert abs(history["energy"] - 1.0).max() < 1e-12
    assert not steps_warned(run(spinning(0.4), 1.0))
    assert "turns by 1 rad" in steps_warned(run(spinning(1.0), 1.0, every=5))[0]


@pytest.mark.slow
def test_prescribed_rotations_do_not_count():
    model = spinning(1.0)
    place = sc.ground((0, 0, 0)), model["wheel"].at((0, 0, 0))
    model.add("axle", sc.JointRevolute(*place, axis=(0, 0, 1)))
    model.add("drive", sc.JointDrive(model["axle"], lambda t: 1.0 * t))
    assert not steps_warned(run(model, 1.0)) + steps_warned(run(model, 1.0, every=5))


@pytest.mark.slow
def test_parts_of_a_composed_step_count():
    """Its steps may be longer, as far as its parts resolve rotations."""
    scheme = sc.Composition(sc.EnergyMomentum())
    assert max(scheme.shares) < 0.5 < max(map(abs, scheme.shares))
    assert not steps_warned(run(spinning(0.6), 1.0, integrator=scheme))
    assert not steps_warned(run(spring(), 0.06, integrator=scheme))
    with pytest.warns(sc.AccuracyWarning, match=r"turns by 0\.\d+ rad in each part of a step"):
        run(spinning(1.0), 1.0, integrator=scheme)


@pytest.mark.slow
def test_a_small_ripple_on_a_slow_motion_is_not_told():
    """Its vibrations are not resolved, and do not matter."""
    quiet = sc.Model()
    ball = quiet.add("ball", sc.MassPoint(1.0, position=(1.0, 0, 0)))
    place = sc.ground((0, 0, 0)), ball.place()
    quiet.add("spring", sc.SpringDamper(*place, stiffness=4e4, length=1.0))
    quiet.add("push", sc.LoadForce(ball.place(), (1.0, 0, 0), lambda t: np.sin(3 * t)))
    history = run(quiet, 0.05, 100)
    exact = np.sin(3 * history.times) / (4e4 - 9)  # but for the ripple
    assert abs(history["q"][:, 0] - 1 - exact).max() < 0.1 * np.ptp(exact)
    assert not steps_warned(history) and resolution(quiet.freeze(), history).error > 1e-3


def test_what_flies_beside_it_does_not_hide_a_vibration():
    model = spring()
    model.add("bird", sc.MassPoint(1.0, position=(0, 5.0, 0), velocity=(30.0, 0, 0)))
    assert any("mass point 'ball'" in text for text in steps_warned(run(model, 0.2)))


COMPOSED = sc.Composition(sc.EnergyMomentum())


@pytest.mark.one_quick
@pytest.mark.parametrize(
    ("turn", "told", "scheme"),
    [(0.1, False, None), (3.0, True, None), (0.6, False, COMPOSED), (3.0, True, COMPOSED)],
)
def test_states_apart_tell_by_their_velocities(turn, told, scheme):
    """Third differences of states three steps apart would take 9 rad for 9 - 2 pi."""
    history = run(spring(), turn / 10.0, 60, scheme, every=3)
    found = resolution(spring().freeze(), history)
    assert found.period == pytest.approx(2 * np.pi / turn, rel=0.15)
    assert bool(steps_warned(history)) == told


@pytest.mark.slow
def test_a_body_that_turns_too_fast_is_named_where_its_step_fails():
    """The variational scheme has no solution above 1 rad; a finer mesh would not help a body."""
    with pytest.raises(sc.Diverged) as caught:
        run(spinning(1.2), 1.0, integrator=sc.Variational())
    text = str(caught.value)
    assert "the rigid body 'wheel' turns by 1.2 rad in a step" in text
    assert "mesh" not in text
    assert "try a smaller step than 1 s, then EnergyMomentum()" in text.replace("Try", "try")


# -- steps that have several solutions -------------------------------------------------------------

SEVERAL = "may have several solutions"


def soft_ring(E, radius, seed):
    """Five linear elements that fly, and a random start."""
    tube = sc.SectionTube(radius, radius / 2, sc.Material(E=E, nu=0.3, rho=1000))
    angle = 2 * np.pi * np.arange(6) / 5
    points = 0.3 * np.c_[np.cos(angle), np.sin(angle), 0 * angle]
    model = sc.Model()
    mesh = sc.MeshCurve.init_polyline(points, [1] * 5, "ring")
    model.add("ring", sc.Beam(mesh, tube, director=(0, 0, 1)))
    system, random = model.freeze(), np.random.default_rng(seed)
    spin, way, q = 3 * random.normal(size=3), random.normal(size=3), system.q0.reshape(-1, 3)
    rate = np.cross(spin, q)
    rate[system.origin_rows] += way
    rate[system.origin_rows] += 0.5 * random.normal(size=(len(system.origin_rows), 3))
    return system, sc.initial_state(system, v=sc.project(system, system.q0, rate.ravel()))


def by_both(system, h, count, **options):
    """The same run by both treatments of the constraints."""
    until, more = count * h, {"kernels": "numpy"} | options
    scheme = sc.EnergyMomentum()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", sc.CosseratWarning)
        return [
            sc.simulate(system, scheme, treatment, h, until, **more)
            for treatment in (sc.NullSpace(), sc.Multipliers())
        ]


def said(history):
    return [each for each in history.meta["warnings"] if SEVERAL in each["text"]]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("E", "radius", "seed", "h"),
    [(1e5, 0.01, 1, 0.036), (1e6, 0.01, 4, 0.02)],
)
def test_a_step_with_two_solutions_is_told(E, radius, seed, h):
    """Each treatment finds another one, each with its energy in balance: both runs tell."""
    system, start = soft_ring(E, radius, seed)
    runs = by_both(system, h, 8, start=start)
    apart = abs(runs[0]["q"] - runs[1]["q"]).max(1)
    first = int(np.argmax(apart > 1e-6))
    assert apart[first - 1] < 1e-9 and apart[first] > 0.1
    for run in runs:
        np.testing.assert_allclose(run["energy"], run["energy"][0], rtol=1e-12)
        assert run["doubtful_step"][first] == 1
        (notice,) = said(run)
        assert notice["item"] == "argument step" and notice["category"] == "AccuracyWarning"
        assert notice["time"] == run.times[run["doubtful_step"] == 1][0]


@pytest.mark.slow
def test_with_short_steps_the_same_ring_has_one_solution():
    system, start = soft_ring(1e5, 0.01, 1)
    runs = by_both(system, 0.002, 30, start=start)
    assert abs(runs[0]["q"] - runs[1]["q"]).max() < 1e-9
    for run in runs:
        assert not run["doubtful_step"].any() and not said(run)


@pytest.mark.slow
def test_states_that_are_not_neighbours_tell_no_step():
    """Nor do steps in which the ground moves fast, however many iterations they take."""
    system, start = soft_ring(1e5, 0.01, 1)
    run, _ = by_both(system, 0.036, 8, start=start, every=2)
    assert (run["newton_iterations"] > 7).any() and not run["doubtful_step"].any()


def with_iterations(history, count):
    """The history, as if its steps had taken so many."""
    series = {name: history[name] for name in history.recorded}
    series["newton_iterations"] = np.r_[0, np.full(len(history) - 1, count)]
    return sc.History(dict(history.meta), {}, series)


def test_only_hard_steps_are_doubted_and_none_that_are_prescribed():
    model = spinning(1.0)
    history = with_iterations(run(model, 1.0, 10), 9)
    assert doubtful_steps(model.freeze(), history)[1:].all()
    assert not doubtful_steps(model.freeze(), with_iterations(history, 5)).any()
    place = sc.ground((0, 0, 0)), model["wheel"].at((0, 0, 0))
    model.add("axle", sc.JointRevolute(*place, axis=(0, 0, 1)))
    model.add("drive", sc.JointDrive(model["axle"], lambda t: 1.0 * t))
    driven = with_iterations(run(model, 1.0, 10), 9)
    assert not doubtful_steps(model.freeze(), driven).any()


def test_numbers_are_those_of_each_state_alone():
    """Of frames and points: by loops over definitions."""
    model = spinning(0.3)
    model.add("ball", sc.MassPoint(1.0, position=(1.0, 0, 0), velocity=(0, 1.0, 0)))
    spin = (0.1, 1.1, 0.2)
    model.add("box", sc.RigidBody(1.0, (1.0, 2.0, 2.5), position=(5, 0, 0), angular_velocity=spin))
    history = run(model, 0.5, 30)
    found, y = resolution(model.freeze(), history), history["q"].reshape(31, -1, 3)
    starts, frames = range(20), {"wheel": 0, "box": 5}  # windows of twelve states
    turns = {
        name: max(
            np.mean(
                [np.arccos(((y[k, own] * y[k + 1, own]).sum() - 1) / 2) for k in range(a, a + 11)]
            )
            for a in starts
        )
        for name, own in ((name, slice(row + 1, row + 4)) for name, row in frames.items())
    }
    assert found.turning == "rigid body 'box'" and turns["box"] > turns["wheel"]
    assert abs(found.turn - turns["box"]) < 1e-12
