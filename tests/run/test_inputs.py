"""What steps do not see of loads, drives and moving ground is told."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
import random_runs

import skfem_cosserat as sc

ALPHA, MIDPOINT = sc.GeneralizedAlpha(0.8), sc.EnergyMomentum()


def told(model, scheme=MIDPOINT, step=0.02, count=50, **options):
    """Items of which a run says that its steps do not see what they do.

    No other step is named: one that sees what moves the ground need not resolve what hangs on it.
    """
    treatment, until = sc.NullSpace(), step * count
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", sc.AccuracyWarning)
        history = sc.simulate(model, scheme, treatment, step, until, kernels="numpy", **options)
    found = [n for n in history.meta["warnings"] if "do not see" in n["text"]]
    assert all(n["text"].count(" s ") == 1 for n in found)
    return [n["item"] for n in found]


def pushed(amplitude):
    model = sc.Model()
    ball = model.add("ball", sc.MassPoint(1.0, position=(1.0, 0, 0)))
    model.add("push", sc.LoadForce(ball.place(), (1.0, 0, 0), amplitude))
    return model


@pytest.mark.slow
@pytest.mark.parametrize(("scheme", "few"), [(ALPHA, 5.7), (MIDPOINT, 4.0)])
def test_vibrations_in_few_steps_are_told(scheme, few):
    """A tenth of them is missed.

    A chord is off by h^2 f''/12 in the mean, so x^2/12 of a sine is missed that advances by x in a
    step: 0.1 at 5.7 steps in a period. In a step with a zero of it h^2 f'/12 cancels in the mean,
    in the mean over where the zero is, so x^2/24: 0.1 at 4.06.
    """
    for parts, expected in ((0.85 * few, ["load 'push'"]), (1.15 * few, [])):
        assert told(pushed(sc.Harmonic(1.0, 50 / parts, 0.3)), scheme, count=200) == expected


PULSE = {"kinks": (0.101, 0.105)}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("declared", "options"), [({}, {}), (PULSE, {"every": 5}), ({}, {"count": 6})]
)
def test_a_pulse_between_ends_is_told_where_loads_act_at_ends(declared, options):
    """Its mean is exact, so that schemes that take it get the whole momentum."""
    pulse = sc.FunctionOfTime(lambda t: 100.0 * (0.101 < t < 0.105), **declared)
    assert told(pushed(pulse), ALPHA, **options) == ["load 'push'"]
    assert told(pushed(pulse), MIDPOINT, **options) == []


@pytest.mark.slow
def test_declared_pulses_of_long_runs_are_found():
    pulse = sc.FunctionOfTime(lambda t: 100.0 * (5.101 < t < 5.105), kinks=(5.101, 5.105))
    assert told(pushed(pulse), ALPHA, count=300) == ["load 'push'"]


def sprung(motion):
    """A mass on a spring, 10 rad/s, that hangs on moving ground."""
    model = sc.Model()
    ball = model.add("ball", sc.MassPoint(1.0, position=(1.01, 0, 0)))
    place = sc.ground((0, 0, 0), motion), ball.place()
    model.add("spring", sc.SpringDamper(*place, stiffness=100.0, length=1.0))
    return model


@pytest.mark.slow
@pytest.mark.parametrize("options", [{}, {"every": 5}, {"count": 6}])
def test_fast_ground_is_told_and_even_motion_is_not(options):
    shake = sc.Motion(lambda t: (0.1 * np.sin(70 * t) ** 2, 0, 0))
    assert told(sprung(shake), **options) == ["ground at [0.0, 0.0, 0.0]"]
    assert told(sprung(sc.Motion(lambda t: (3.0 * t, 0, 0))), **options) == []


@pytest.mark.slow
@pytest.mark.parametrize("every", [1, 5])
def test_vibrations_on_slow_ground_are_those_against_it(every):
    """Of 0.01 m in four steps a period, beside 1 m by the ground, which is resolved."""
    slow = sc.Motion(lambda t: (0.5 - 0.5 * np.cos(0.4 * t), 0, 0))
    options = {"every": every, "kernels": "numpy"}
    with pytest.warns(sc.AccuracyWarning, match="do not resolve the motion: they put the mass"):
        sc.simulate(sprung(slow), MIDPOINT, sc.NullSpace(), 0.15, 15.0, **options)


def driven(rate):
    """A wheel that a drive turns, from rest."""
    model, ramp = sc.Model(), sc.RampSmooth(0.0, 0.5)
    wheel = model.add("wheel", sc.RigidBody(1.0, (1.0, 1.0, 2.0)))
    place = sc.ground((0, 0, 0)), wheel.at((0, 0, 0))
    axle = model.add("axle", sc.JointRevolute(*place, axis=(0, 0, 1)))
    model.add("motor", sc.JointDrive(axle, lambda t: rate * t * ramp.value(t)))
    return model


@pytest.mark.slow
def test_drives_that_turn_far_in_a_step_are_told():
    """A chord of a turn by 1.3 rad is off by 0.13 of the radius, in the mean; by 0.6 by 0.03."""
    assert told(driven(1.3 / 0.02)) == ["drive 'motor'"]
    assert told(driven(0.6 / 0.02)) == []


@pytest.mark.slow
@pytest.mark.parametrize(("scheme", "count"), [(ALPHA, 50), (MIDPOINT, 50), (MIDPOINT, 300)])
def test_a_move_within_a_step_is_told(scheme, count):
    """Of a smooth one from s = -0.25 to 1 of a step the chord is off by up to 0.3 of it.

    In ten steps the chord is off by h^2 f''/8 at most, with f'' of 10/sqrt(3): by 0.0072.
    """
    for steps in (1.25, 10):
        ramp = sc.RampSmooth(0.315, 0.315 + 0.02 * steps, last=0.05)
        model = sprung(sc.Motion(lambda t, ramp=ramp: (ramp.value(t), 0, 0)))
        assert bool(told(model, scheme, count=count)) == (steps < 2)


@pytest.mark.slow
@pytest.mark.parametrize("number", [7, 14])
def test_random_runs(number):
    """Of tests/random_runs.py, a right one and a wrong one."""
    found = random_runs.drawn_run(number)
    assert bool(found.said) == (found.off > random_runs.WRONG)
