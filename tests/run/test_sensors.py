"""Sensors record at every step what states alone would have to be recorded for."""

from __future__ import annotations

import numpy as np
import pytest

import skfem_cosserat as sc
from skfem_cosserat import diagnostics
from skfem_cosserat.history import SensorRecord

STEP, STEPS = 2e-3, 60
RUBBER = sc.SectionCircle(radius=5e-3, material=sc.Material(E=5e6, nu=0.5, rho=1100))


def pendulum(order=2):
    """A rod on a hinge, a ball at its end; its hinge."""
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 4, name="rod")
    model = sc.Model()
    rod = model.add("rod", sc.Beam(mesh, RUBBER, order=order, director=(0, 1, 0)))
    pin = sc.JointRevolute(sc.ground((0, 0, 0)), rod.node("rod.start"), axis=(0, 0, 1))
    model.add("hinge", pin)
    model.add("ball", sc.RigidBody.sphere(0.05, radius=0.02, on=rod.node("rod.end")))
    model.add("gravity", sc.LoadGravity((0, -9.81, 0)))
    return model.freeze(), rod, pin


def sensors_of(rod, pin):
    return {
        "tip": sc.SensorPosition(rod.node("rod.end")),
        "inside": sc.SensorPosition(rod, 0.3),
        "velocity": sc.SensorVelocity(rod.node("rod.end")),
        "acceleration": sc.SensorAcceleration(rod.node("rod.end")),
        "strain": sc.SensorStrain(rod, 0.3),
        "force": sc.SensorForce(rod, 0.3, part="rod"),
        "reaction": sc.SensorReaction(pin),
        "length": sc.SensorQuantity(lambda system, q, t: np.linalg.norm(q[:, -12:-9], axis=1), "m"),
    }


@pytest.mark.slow
@pytest.mark.parametrize(
    ("integrator", "treatment"),
    [(sc.EnergyMomentum(), sc.NullSpace()), (sc.Variational(), sc.Multipliers())],
)
def test_sensors_see_every_step(integrator, treatment):
    """The same numbers as from a history of every step, while only a few states are recorded."""
    system, rod, pin = pendulum()
    run = integrator, treatment, STEP, STEP * STEPS
    whole = sc.simulate(system, *run)
    thin = sc.simulate(system, *run, every=20, sensors=sensors_of(rod, pin))
    assert len(thin) == 4 and np.array_equal(thin["q"], whole["q"][::20])
    force = np.hstack([whole["joint/hinge/force"], whole["joint/hinge/moment"]])
    for name, expected in (
        ("tip", whole.position(rod.node("rod.end"))),
        ("inside", whole.position(rod, s=0.3)),
        ("strain", diagnostics.evaluate(system, rod, whole["q"], *rod.along([0.3])).strain[:, 0]),
        ("length", np.linalg.norm(whole["q"][:, -12:-9], axis=1)),
        ("force", diagnostics.forces_along(system, whole, rod, [0.3])[:, 0]),
        ("reaction", force),
    ):
        seen = thin.sensors[name]
        assert seen.times == pytest.approx(whole.times, abs=1e-14)
        assert seen.values == pytest.approx(expected, rel=1e-9, abs=1e-9 * abs(expected).max())


@pytest.mark.slow
def test_rates_are_of_second_order():
    """Velocities and accelerations of a body on a spherical joint against its exact motion."""
    errors = []
    for step in (0.02, 0.01, 0.005):
        model = sc.Model()
        place = sc.ground((0, 0, 0))
        wheel = model.add("wheel", sc.RigidBody.cylinder(2.0, 1.0, 0.1, angular_velocity=(0, 0, 3)))
        model.add("pin", sc.JointRevolute(place, wheel.at((0, 0, 0)), axis=(0, 0, 1)))
        rim = wheel.at((1.0, 0, 0))
        sensors = {"v": sc.SensorVelocity(rim), "a": sc.SensorAcceleration(rim)}
        run = sc.EnergyMomentum(), sc.NullSpace(), step, 1.0
        seen = sc.simulate(model.freeze(), *run, every=100, sensors=sensors).sensors
        t = seen["v"].times
        v = 3 * np.column_stack([-np.sin(3 * t), np.cos(3 * t), 0 * t])
        a = -9 * np.column_stack([np.cos(3 * t), np.sin(3 * t), 0 * t])
        errors.append([abs(seen["v"].values - v).max(), abs(seen["a"].values - a).max()])
        assert seen["v"].unit == "m/s" and seen["a"].unit == "m/s^2"
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert orders == pytest.approx(2.0, abs=0.1)


def test_frame_of_a_moving_place():
    """Seen from a turning ground nothing moves that is fixed to it."""
    spin = sc.Motion(rotation=lambda t: (0, 0, 0.5 * t**2))
    hub = sc.ground((1.0, 0, 0), spin)
    model = sc.Model()
    box = model.add("box", sc.RigidBody.box(1.0, (1, 1, 1), position=(2.0, 0, 0)))
    model.add("clamp", sc.JointFixed(hub, box.at((1.0, 0, 0))))
    sensors = {
        "seen": sc.SensorPosition(box.at((2.5, 0.5, 0)), frame=hub),
        "space": sc.SensorPosition(box.at((2.5, 0.5, 0))),
    }
    run = sc.EnergyMomentum(), sc.NullSpace(), 0.05, 1.0
    seen = sc.simulate(model.freeze(), *run, sensors=sensors).sensors
    assert seen["seen"].values == pytest.approx(np.tile([1.5, 0.5, 0], (21, 1)), abs=1e-12)
    assert abs(seen["space"].values[-1] - [2.5, 0.5, 0]).max() > 0.5


@pytest.mark.slow
def test_history_keeps_them(tmp_path):
    """Streamed, saved, loaded, truncated; after a failed step up to it."""
    system, rod, pin = pendulum()
    run = sc.EnergyMomentum(), sc.NullSpace(), STEP, STEP * STEPS
    sensors = sensors_of(rod, pin)
    memory = sc.simulate(system, *run, every=20, sensors=sensors)
    sc.simulate(system, *run, every=20, sensors=sensors, path=tmp_path / "run")
    memory.save(tmp_path / "saved")
    for other in (sc.History.load(tmp_path / "run"), sc.History.load(tmp_path / "saved")):
        assert other.sensors.keys() == sensors.keys()
        for name, record in memory.sensors.items():
            assert np.array_equal(record.values, other.sensors[name].values)
    cut = memory.truncated(2).sensors["tip"]
    assert len(cut.times) == 21 and cut.times[-1] == memory.times[1]

    def stop(report):
        if report.state.index == 30:
            raise RuntimeError("enough")

    with pytest.raises(RuntimeError) as error:
        sc.simulate(system, *run, every=20, sensors=sensors, callbacks=[stop])
    assert len(error.value.history.sensors["tip"].times) == 31


@pytest.mark.slow
def test_spectrum():
    """Amplitudes and frequencies of two sines, one between the lines; a vector."""
    t = np.arange(2000) * 1e-2
    x = 2.0 * np.sin(2 * np.pi * 5 * t) + 0.5 * np.cos(2 * np.pi * 12.02 * t) + 3 + 0.1 * t
    found = sc.spectrum(t, x)
    assert found.peaks(2) == pytest.approx([5, 12.02], abs=2e-3)
    assert found.amplitudes[100] == pytest.approx(2.0, rel=1e-3)
    record = SensorRecord(t, np.column_stack([x, 0 * x]), "m")
    assert record.spectrum("boxcar").amplitudes.shape == (1001, 2)
    assert record.spectrum().peaks(1) == pytest.approx([5], abs=2e-3)
    with pytest.raises(sc.InputError, match="expected equal"):
        sc.spectrum(t**2, x)
    with pytest.raises(sc.InputError, match="'nope' is none that scipy knows"):
        sc.spectrum(np.arange(9.0), np.arange(9.0), "nope")
    with pytest.raises(sc.InputError, match="not finite"):
        sc.spectrum(t, np.where(t > 1, np.nan, x))


def test_bad_sensors():
    system, rod, _ = pendulum()
    other = pendulum()[1]
    for make, message in (
        (lambda: sc.SensorPosition("tip"), "expected a Place or a Beam"),
        (lambda: sc.SensorPosition(rod), "s is missing"),
        (lambda: sc.SensorPosition(rod.node("rod.end"), 0.5), "is for beams"),
        (lambda: sc.SensorStrain(rod, 1.5), "1.5"),
        (lambda: sc.SensorReaction(rod), "expected a joint"),
        (lambda: sc.SensorQuantity(3.0), "not callable"),
        (lambda: sc.SensorPosition(rod, 0.5, frame=rod), "frame"),
    ):
        with pytest.raises(sc.CosseratError, match=message):
            make()
    run = sc.EnergyMomentum(), sc.NullSpace(), STEP, 2 * STEP
    for sensors, message in (
        ([sc.SensorStrain(rod, 0.5)], "expected a dict"),
        ({"a/b": sc.SensorStrain(rod, 0.5)}, "without slashes"),
        ({"a": 3.0}, "expected a sensor"),
        ({"a": sc.SensorStrain(other, 0.5)}, "not in this system"),
        ({"a": sc.SensorQuantity(lambda system, q, t: q[0])}, "expected finite"),
    ):
        with pytest.raises(sc.InputError, match=message):
            sc.simulate(system, *run, sensors=sensors)


class Writes(sc.Sensor):
    """A sensor that spoils the state it sees."""

    def items(self):
        return []

    def values(self, system, window):
        window.q[:] = 7.0
        return window.q[:, 0]


class Speed(sc.Sensor):
    """A sensor to be differentiated, of what is not known beside a state."""

    derivative = 1

    def __init__(self, place):
        self.place = place

    def items(self):
        return [self.place.item]

    def values(self, system, window):
        return window.velocity(self.place)[:, 0]


def test_own_sensors_neither_spoil_states_nor_guess_beside_them():
    model = sc.Model()
    ball = model.add("ball", sc.MassPoint(1.0, velocity=(3.0, 0, 0)))
    model.add("gravity", sc.LoadGravity((0, 0, -9.81)))
    system = model.freeze()
    view = sc.View(system, sc.initial_state(system))
    with pytest.raises(ValueError, match="read-only"):
        view.sensor(Writes())
    with pytest.raises(sc.InputError, match="Speed: is differentiated beside a state"):
        view.sensor(Speed(ball.place()))
    assert view.position(ball.place()).tolist() == [0.0, 0.0, 0.0]
