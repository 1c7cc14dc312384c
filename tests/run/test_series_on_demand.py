"""Series of a history that follow from its states are derived when they are first asked for."""

import pickle
from importlib import import_module

import numpy as np
import pytest
from helpers_scenes import everything, four_bar

import skfem_cosserat as sc
from skfem_cosserat.constraints import stacked
from skfem_cosserat.constraints.saddle import nearest_velocity
from skfem_cosserat.run import derive_series

# the end of the rod is drawn farther than such elements can be
pytestmark = pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")

describe = import_module("skfem_cosserat.run.describe")  # the function has its name
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


@pytest.fixture
def calls(monkeypatch):
    """Names of the functions that are called, in their order."""
    made = []
    for name in (
        *("kinetic_energy", "strain_energy", "section_strains"),
        *("multipliers", "reactions", "relative_series"),
    ):
        own = getattr(describe, name)
        monkeypatch.setattr(
            describe, name, lambda *a, own=own, name=name: (made.append(name), own(*a))[1]
        )
    stack = sc.diagnostics.Projection.stack
    monkeypatch.setattr(
        sc.diagnostics.Projection, "stack", lambda *a: (made.append("stack"), stack(*a))[1]
    )
    return made


def test_nothing_is_derived_before_somebody_asks_and_nothing_twice(calls):
    history = run(pendulum())
    assert calls == [] and "energy" in history and "energy" not in history.recorded
    assert history["energy"].shape == (11,)
    assert sorted(calls) == ["kinetic_energy", "strain_energy"]
    _ = history["energy"], history["strain_energy"], history["beam/rod/resultant"]
    assert calls[2:] == ["section_strains"]
    _ = history["joint/pin/force"], history["joint/pin/moment"], history["multipliers"]
    assert calls[3:] == ["multipliers", "reactions"]
    for name in history:
        _ = history[name]
    assert sorted(calls) == sorted(set(calls)), "once each"


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
    assert {"Qp", "multipliers", "constraint_violation"} & set(loaded) == {"multipliers"} & set(
        loaded
    )
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
    twice = pickle.loads(pickle.dumps(pickle.loads(pickle.dumps(history))))
    assert twice["energy"].tolist() == whole["energy"].tolist()


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


def test_a_series_that_cannot_be_had_is_an_error_where_it_is_asked_for_and_a_warning_in_a_file(
    monkeypatch, tmp_path
):
    history = run(pendulum())

    def fail(*states):
        raise sc.CosseratError("no rows")

    monkeypatch.setattr(describe, "reactions", fail)
    with pytest.raises(sc.CosseratError, match="no rows"):
        history["joint/pin/force"]
    with pytest.warns(sc.IncompleteWarning, match="joint/pin/force, joint/pin/moment cannot be"):
        history.save(tmp_path / "run.history")
    loaded = sc.History.load(tmp_path / "run.history")
    assert "no rows" in loaded.meta["warnings"][-1]["text"]
    assert "energy" in loaded and "joint/pin/force" not in loaded


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


@pytest.mark.parametrize(
    "build", [lambda: everything(1), lambda: everything(2), lambda: four_bar().freeze()]
)
def test_velocities_of_many_states_are_those_of_each(build):
    system, rng = build(), np.random.default_rng(1)
    start = sc.initial_state(system, v=sc.project(system, system.q0, system.v0))
    history = sc.simulate(system, *PAIR, 1e-3, 8e-3, start=start, kernels="numpy", derive=False)
    q, t = history["q"], history.times
    p = np.array([system.mass @ rng.standard_normal((system.rows, 3)) for _ in t]).reshape(q.shape)
    y = np.array([system.extend(*each) for each in zip(q, t, strict=True)])
    found = stacked.nearest_velocities(system, y, p, t)
    alone = np.array(
        [nearest_velocity(system, *each) for each in zip(y, p, t.tolist(), strict=True)]
    )
    assert abs(found - alone).max() <= 1e-11 * abs(alone).max()
    part = stacked.nearest_velocities(system, y[3:6], p[3:6], t[3:6])
    assert np.array_equal(part, found[3:6]), "whatever else is solved with them"


def test_rows_left_out_are_chosen_for_many_states_together(monkeypatch):
    """Not at each of them: once, as long as the others stay independent."""
    system = four_bar().freeze()
    start = sc.initial_state(system, rates={"pin 0": 1.0})
    history = sc.simulate(system, *PAIR, 1e-2, 0.5, start=start, kernels="numpy", derive=False)
    chosen = []
    own = stacked.dependent_rows
    monkeypatch.setattr(stacked, "dependent_rows", lambda *a: (chosen.append(1), own(*a))[1])
    y = sc.diagnostics.constraint_points(system, history)
    lam = sc.diagnostics.multipliers(system, y, history["constraint_force"])
    assert 1 <= len(chosen) <= 5 < len(history)
    for k in (0, 20, 50):
        alone = sc.diagnostics.multipliers(
            system, y[k : k + 1], history["constraint_force"][k : k + 1]
        )[0]
        assert np.allclose(lam[k], alone, rtol=0, atol=1e-9 * abs(alone).max())
