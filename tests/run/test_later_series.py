"""Series that are derived later are those of the run, whatever happens in between."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

import skfem_cosserat as sc

EM, NS = sc.EnergyMomentum(), sc.NullSpace()


def driven(motion):
    model = sc.Model()
    arm = model.add("arm", sc.RigidBody.box(1.0, (0.1, 0.1, 1.0), position=(0, 0, -0.5)))
    pin = sc.JointRevolute(sc.ground((0, 0, 0)), arm.at((0, 0, 0)), axis=(1, 0, 0))
    model.add("pin", pin)
    model.add("motor", sc.JointDrive(pin, motion))
    return model


def test_functions_of_the_user_are_asked_while_they_are_as_they_were():
    rates = [1.0]
    motion = sc.FunctionOfTime(lambda t: rates[0] * t**2)  # as it is, or in this way
    assert driven(motion)["motor"].value(2.0) == driven(motion.function)["motor"].value(2.0) == 4.0
    history = sc.simulate(driven(motion), EM, NS, 0.05, until=1.0)
    rates[0] = 3.0
    assert history["joint/pin/angle_rate"][-1] == pytest.approx(2.0, rel=1e-6)
    model = sc.Model()
    ball = model.add("ball", sc.MassPoint(1.0))
    model.add("push", sc.LoadForce(ball.place(), (1.0, 0, 0), lambda t: rates[0]))
    history = sc.simulate(model, EM, NS, 0.05, until=1.0)
    expected = -3.0 * history["q"][-1, 0]
    rates[0] = 1.0
    assert history["external"][-1] == pytest.approx(expected, rel=1e-12)


def test_functions_of_the_package_are_asked_later():
    history = sc.simulate(driven(sc.RampSmooth(0, 1.0)), EM, NS, 0.05, until=1.0)
    assert "v" not in history.recorded
    assert history["joint/pin/angle"][-1] == pytest.approx(1.0, abs=1e-9)


def test_runs_that_a_callback_ends_have_their_series():
    def stop(report):
        if report.state.time > 0.45:
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError) as caught:
        sc.simulate(driven(sc.RampSmooth(0, 1.0)), EM, NS, 0.05, until=1.0, callbacks=[stop])
    history = caught.value.history
    assert len(history) == 11 and np.isfinite(history["energy"][:-1]).all()


def test_what_is_recorded_cannot_be_written_to():
    history = sc.simulate(driven(sc.RampSmooth(0, 1.0)), EM, NS, 0.05, until=1.0)
    q = history["q"]
    with pytest.raises(ValueError, match="read-only"):
        q -= q[0]


def push(t):
    return 1.0 + t


def test_a_scene_that_cannot_be_read_is_told(monkeypatch):
    """A pickled history takes its scene along, by name where that has functions."""
    model = sc.Model()
    ball = model.add("ball", sc.MassPoint(1.0))
    model.add("push", sc.LoadForce(ball.place(), (1.0, 0, 0), push))
    packed = pickle.dumps(sc.simulate(model, EM, NS, 0.05, until=1.0))
    monkeypatch.delitem(globals(), "push")
    history = pickle.loads(packed)
    assert np.isfinite(history["external"]).all()  # it was derived before
    with pytest.raises(sc.CosseratError, match="derive its series before pickling"):
        history["kinetic"]


def test_no_states_no_series(tmp_path):
    history = sc.simulate(driven(sc.RampSmooth(0, 1.0)), EM, NS, 0.05, until=1.0).truncated(0)
    with pytest.raises(sc.CosseratError, match="has no state"):
        history["energy"]
    with pytest.warns(sc.IncompleteWarning, match="has no state"):
        history.save(tmp_path / "run.history")
    assert len(sc.History.load(tmp_path / "run.history")) == 0
