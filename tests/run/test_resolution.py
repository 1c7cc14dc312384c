"""Steps that do not resolve the motion are told, those that do are not."""

from __future__ import annotations

import re

import numpy as np
import pytest

import skfem_cosserat as sc
from skfem_cosserat.diagnostics import resolution

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


def test_estimate_is_the_error_of_fifty_steps():
    """Of a vibration, whose phase is slow by (h omega)^3/12 in each step: until it is opposite."""
    model, omega = spring(), 10.0
    for turn in (0.05, 0.1, 0.2):
        h = turn / omega
        history = run(model, h, 50)
        x = history["q"][:, 0] - 1.0
        error = abs(x - 0.1 * np.cos(omega * history.times)).max() / 0.2
        found = resolution(model.freeze(), history)
        assert 0.5 * error < found.error < 2 * error
        assert found.period == pytest.approx(2 * np.pi / turn, rel=0.02)
        assert found.item == "mass point 'ball'"


@pytest.mark.parametrize("turn", [0.05, 0.15])
def test_resolved_vibrations_are_not_told(turn):
    assert not steps_warned(run(spring(), turn / 10.0))


@pytest.mark.parametrize("turn", [0.5, 3.0, 30.0])
def test_vibrations_that_are_not_resolved_are_told(turn):
    with pytest.warns(sc.AccuracyWarning, match=r"steps of \S+ s do not resolve the motion"):
        history = run(spring(), turn / 10.0)
    energy = history["energy"]
    np.testing.assert_allclose(energy, energy[0], rtol=1e-9)  # which says nothing of it


def test_rotations_that_are_not_resolved_are_told():
    """Energy-momentum turns 92.7 rad of 100 at 1 rad in a step."""
    with pytest.warns(sc.AccuracyWarning, match=r"'wheel' turns by 0\.93 rad in each step"):
        history = run(spinning(1.0), 1.0, 100)
    assert abs(history["energy"] - 1.0).max() < 1e-12
    assert not steps_warned(run(spinning(0.4), 1.0))


def test_prescribed_rotations_do_not_count():
    model = spinning(1.0)
    place = sc.ground((0, 0, 0)), model["wheel"].at((0, 0, 0))
    model.add("axle", sc.JointRevolute(*place, axis=(0, 0, 1)))
    model.add("drive", sc.JointDrive(model["axle"], lambda t: 1.0 * t))
    assert not steps_warned(run(model, 1.0))


def test_parts_of_a_composed_step_count():
    """Its steps may be longer, as far as its parts resolve rotations."""
    scheme = sc.Composition(sc.EnergyMomentum())
    assert max(scheme.shares) < 0.5 < max(map(abs, scheme.shares))
    assert not steps_warned(run(spinning(0.6), 1.0, integrator=scheme))
    assert not steps_warned(run(spring(), 0.06, integrator=scheme))
    with pytest.warns(sc.AccuracyWarning, match=r"turns by 0\.\d+ rad in each part of a step"):
        run(spinning(1.0), 1.0, integrator=scheme)


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


def test_one_jolt_does_not_count():
    model = spinning(0.0)
    pulse = sc.Table([0.0, 0.001, 0.002], [0.0, 1.0, 0.0])
    model.add("blow", sc.LoadForce(model["wheel"].at((0, 0, 0)), (100.0, 0, 0), pulse))
    assert not steps_warned(run(model, 0.01))


def test_states_apart_tell_nothing():
    history = run(spring(), 0.3, 60, every=3)
    assert resolution(spring().freeze(), history) is None


def test_a_body_that_turns_too_fast_is_named_where_its_step_fails():
    """The variational scheme has no solution above 1 rad; a finer mesh would not help a body."""
    with pytest.raises(sc.Diverged) as caught:
        run(spinning(1.2), 1.0, integrator=sc.Variational())
    text = str(caught.value)
    assert "the rigid body 'wheel' turns by 1.2 rad in a step" in text
    assert "mesh" not in text
    assert "try a smaller step than 1 s, then EnergyMomentum()" in text.replace("Try", "try")
