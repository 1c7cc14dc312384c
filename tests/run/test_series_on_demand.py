"""Series of a history that follow from its states are derived when they are first asked for."""

import gc
import pickle
import weakref

import numpy as np
import pytest
from helpers_scenes import four_bar

import skfem_cosserat as sc
from skfem_cosserat.run import derive_series

# the end of the rod is drawn farther than such elements can be
pytestmark = pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")

PAIR = sc.EnergyMomentum(), sc.NullSpace()


def pendulum(push=None):
    """A rod of two elements on a hinge."""
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 2, name="rod")
    section = sc.Section((2e4, 2e4, 5e4, 40.0, 60.0, 30.0), mass=1.3, inertia=(2e-3, 3e-3))
    model = sc.Model()
    rod = model.add("rod", sc.Beam(mesh, section, director=(0, 0, 1)))
    model.add("pin", sc.JointRevolute(sc.ground((0, 0, 0)), rod.node("rod.start"), (0, 0, 1)))
    model.add("gravity", sc.LoadGravity((0.3, -9.81, 0)))
    if push is not None:
        model.add("push", sc.LoadForce(rod.node("rod.end"), (0, 1.0, 0), push))
    return model


def run(model, **options):
    return sc.simulate(model, *PAIR, 0.01, 0.1, kernels="numpy", **options)


def test_nothing_is_derived_before_somebody_asks_and_nothing_twice():
    history = run(pendulum())
    assert "energy" in history and "energy" not in history.recorded
    energy = history["energy"]
    assert energy.shape == (11,) and history["energy"] is energy
    assert "beam/rod/resultant" not in history.recorded


def test_series_of_rows_and_of_parts_are_derived_too():
    history = run(pendulum())
    energy = run(pendulum())["energy"]
    assert history.last()["energy"] == energy[-1]
    assert history.truncated(4)["energy"].tolist() == energy[:4].tolist()
    assert history.series["energy"].tolist() == energy.tolist()
    assert set(dict(history.row(2))) == set(history)
    with pytest.raises(KeyError):
        history.last()["enrgy"]


def test_what_is_derived_at_the_end():
    history = run(pendulum(), derive=["energy"])
    assert "energy" in history.recorded and "v" not in history.recorded
    assert set(run(pendulum(), derive=True).recorded) == set(history)
    none = run(pendulum(), derive=False)
    assert "energy" not in none
    with pytest.raises(sc.InputError, match=r"'energy'.*derive_series\(model, history\)"):
        none["energy"]
    for wrong in ("energy", ["enrgy"], 1):
        with pytest.raises(sc.InputError, match="argument derive"):
            run(pendulum(), derive=wrong)


def test_a_file_has_energies_and_what_pictures_need_and_others_follow_from_the_model(tmp_path):
    model = pendulum()
    history, whole = run(model), run(model, derive=True)
    _ = history["hidden_violation"]
    history.save(tmp_path / "run.history")
    loaded = sc.History.load(tmp_path / "run.history")
    kept = {"energy", "energy_balance", "v", "beam/rod/resultant", "joint/pin/force"}
    assert kept | {"hidden_violation"} <= set(loaded.recorded)
    with pytest.raises(sc.InputError, match=r"'Qp'.*derive_series\(model, history\)"):
        loaded["Qp"]
    derive_series(model, loaded)
    assert set(loaded) == set(whole)
    for name in whole:
        assert np.array_equal(loaded[name], whole[name], equal_nan=True), name
    other = pendulum()
    other.add("more", sc.LoadForce(other["rod"].node("rod.end"), (0, 1, 0)))
    other.add("ball", sc.MassPoint(1.0))
    with pytest.raises(sc.HistoryError, match="another model"):
        derive_series(other, loaded)


def test_a_history_takes_along_what_derives_its_series():
    history, whole = run(pendulum()), run(pendulum(), derive=True)
    other = pickle.loads(pickle.dumps(history))
    assert other.recorded == history.recorded
    assert list(other) == list(whole)
    for name in whole:
        assert np.array_equal(other[name], whole[name], equal_nan=True), name


def test_a_history_of_a_system_that_cannot_be_pickled_takes_along_all_series():
    history = run(pendulum(push=lambda t: t))
    other = pickle.loads(pickle.dumps(history))
    assert set(other.recorded) == set(history)
    assert np.array_equal(other["v"], history["v"])


def test_segments_have_series_of_their_own():
    model = pendulum()
    fall = sc.Event(lambda t, view: t - 0.055, sc.ActionRelease(model["pin"]))
    history = run(model, events=[fall])
    assert len(history.segments) == 2 and "multipliers" not in history.recorded
    start = history.segments[1][0]
    force = history["joint/pin/force"]
    assert np.isfinite(force[: start - 1]).all() and np.isnan(force[start:]).all()
    assert np.isfinite(history["energy"]).all()
    assert history.segment(0)["energy"].tolist() == history["energy"][:start].tolist()
    other = pickle.loads(pickle.dumps(history))
    assert np.array_equal(other["joint/pin/force"], force, equal_nan=True)
    with pytest.raises(sc.HistoryError, match="segment"):
        derive_series(model, history)


def test_paths_and_modes_derive_theirs_too():
    model = pendulum()
    rod = model["rod"]
    model.add("clamp", sc.JointFixed(sc.ground((1, 0, 0)), rod.node("rod.end")))
    path = sc.static(model, kernels="numpy")
    assert "strain_energy" not in path.recorded
    stored = path["strain_energy"]
    assert 0 < stored[-1] == path["energy"][-1] and path["external"].shape == stored.shape
    mode = sc.modes(model).animation(0)
    assert "beam/rod/strain" not in mode.recorded
    assert abs(mode["beam/rod/strain"]).max() > 0
    assert mode["joint/pin/position"].tolist() == [[0.0, 0.0, 0.0]] * len(mode)


# -- many states at once ---------------------------------------------------------------------------


@pytest.mark.slow
def test_multipliers_of_redundant_rows_have_least_norm():
    """Of a planar four-bar: of all that give the same forces."""
    system = four_bar().freeze()
    start = sc.initial_state(system, rates={"pin 0": 1.0})
    history = sc.simulate(system, *PAIR, 1e-2, 0.5, start=start, kernels="numpy", derive=False)
    y = sc.diagnostics.constraint_points(system, history)
    force = history["constraint_force"]
    lam = sc.diagnostics.multipliers(system, y, force)
    for k in (0, 20, 50):
        G = system.constraints.jacobian(y[k]).toarray()
        least = np.linalg.lstsq(G.T, G.T @ lam[k], rcond=1e-9)[0]
        np.testing.assert_allclose(lam[k], least, rtol=0, atol=1e-8 * abs(least).max())


@pytest.mark.slow
def test_scenes_whose_joints_were_read_do_not_stay():
    """But for the last few, whose factors are kept for what is asked next."""
    known = []
    for _ in range(10):
        system = pendulum().freeze()
        history = run(system)
        assert len(history["joint/pin/angle"]) == len(history)
        known.append(weakref.ref(system))
    del system, history
    gc.collect()
    assert [each() is None for each in known[:5]] == [True] * 5


# -- functions of time, and states in between -----------------------------------------------------


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
    history = sc.simulate(driven(motion), *PAIR, 0.05, until=1.0)
    rates[0] = 3.0
    assert history["joint/pin/angle_rate"][-1] == pytest.approx(2.0, rel=1e-6)


def test_functions_of_the_package_are_asked_later():
    history = sc.simulate(driven(sc.RampSmooth(0, 1.0)), *PAIR, 0.05, until=1.0)
    assert "v" not in history.recorded
    assert history["joint/pin/angle"][-1] == pytest.approx(1.0, abs=1e-9)


def test_what_is_recorded_cannot_be_written_to():
    history = sc.simulate(driven(sc.RampSmooth(0, 1.0)), *PAIR, 0.05, until=1.0)
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
    packed = pickle.dumps(sc.simulate(model, *PAIR, 0.05, until=1.0))
    monkeypatch.delitem(globals(), "push")
    history = pickle.loads(packed)
    assert np.isfinite(history["external"]).all()  # it was derived before
    with pytest.raises(sc.CosseratError, match="derive its series before pickling"):
        history["kinetic"]


def test_no_states_no_series(tmp_path):
    history = sc.simulate(driven(sc.RampSmooth(0, 1.0)), *PAIR, 0.05, until=1.0).truncated(0)
    with pytest.raises(sc.CosseratError, match="has no state"):
        history["energy"]
    with pytest.warns(sc.IncompleteWarning, match="has no state"):
        history.save(tmp_path / "run.history")
    assert len(sc.History.load(tmp_path / "run.history")) == 0
