"""Warnings are seen: by Python's own, once a run and item, and kept with what they are about."""

from __future__ import annotations

import json
import pickle
import warnings
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from helpers_precision import struck

import skfem_cosserat as sc
from skfem_cosserat import checks
from skfem_cosserat.accuracy.run import run_sent
from skfem_cosserat.warn import Notices, in_words, warn

SOFT = sc.Section([1e4, 1e4, 1e4, 1e-3, 1e-3, 1e-3], mass=1.0, inertia=(1e-3, 1e-3))
RUN = sc.EnergyMomentum(), sc.NullSpace(), 1e-3
QUICK = {"kernels": "numpy"}


def wire(pull: float = 100.0, elements: int = 3, names: tuple[str, ...] = ("wire",)) -> sc.Model:
    """Taut wires: far beyond what their elements can hold."""
    model = sc.Model()
    for k, name in enumerate(names):
        line = sc.MeshCurve.init_line((0, k, 0), (1, k, 0), elements, name=name)
        beam = model.add(name, sc.Beam(line, SOFT, director=(0, 1, 0)))
        start = sc.JointFixed(sc.ground((0, k, 0)), beam.node(f"{name}.start"))
        model.add(f"{name} clamp", start)
        model.add(f"{name} pull", sc.LoadForce(beam.node(f"{name}.end"), (pull, 0, 0)))
    return model


def swung(pull: float) -> sc.History:
    return sc.simulate(wire(pull).freeze(), *RUN, 2e-3, **QUICK)


def bent() -> sc.Beam:
    """Bends that its elements cannot follow well."""
    mesh = sc.MeshCurve.init_arc((0, 0, 0), (1, 0, 0), (0, 1, 0), 1.0, np.pi, 3)
    return sc.Beam(mesh, SOFT)


def test_each_item_is_said_once_a_run_at_the_users_line():
    system = wire(names=("one", "two")).freeze()
    with pytest.warns(sc.CosseratWarning) as given:
        history = sc.simulate(system, *RUN, 3e-3, **QUICK)
    assert len(given) == 1  # the worse one, at the first state that shows it
    assert given[0].category is sc.AccuracyWarning and given[0].filename == __file__
    (notice,) = history.meta["warnings"]
    assert notice["category"] == "AccuracyWarning" and notice["item"] in {
        "beam 'one'",
        "beam 'two'",
    }
    assert str(given[0].message) == in_words(notice)
    assert notice["time"] == 1e-3 and notice["when"] == "t = 0.001 s"
    assert json.loads(json.dumps(history.meta["warnings"])) == history.meta["warnings"]
    assert repr(history).endswith("completed, 1 warning>")
    _, second = str(history).splitlines()  # cut to a line; the whole text is in meta
    assert second.startswith(f"  AccuracyWarning: {notice['item']}, t = 0.001 s: ")
    assert len(second) <= 100 and second.endswith(" ...")
    silent = swung(1e-3)
    assert silent.meta["warnings"] == [] and str(silent).endswith("completed>")


@pytest.mark.parametrize("derive", [True, False])
def test_streamed_files_have_them(tmp_path, derive):
    path = tmp_path / "run.history"
    with pytest.warns(sc.AccuracyWarning):
        history = sc.simulate(wire().freeze(), *RUN, 3e-3, path=path, derive=derive, **QUICK)
    assert sc.History.load(path).meta["warnings"] == history.meta["warnings"] != []
    path = tmp_path / "path.history"
    with pytest.warns(sc.AccuracyWarning, match="load factor"):
        history = sc.static(wire(), path=path, derive=derive, watch=False)
    assert sc.History.load(path).meta["warnings"] == history.meta["warnings"] != []


@pytest.mark.filterwarnings("ignore:.*(tension|several solutions|turns by|do not resolve)")
def test_a_history_is_checked_at_any_time(tmp_path):
    """As at its end; one from a file with its scene."""
    top = sc.Model()
    top.add("top", sc.RigidBody.box(1.0, (1, 1, 1), angular_velocity=(0, 0, 1.0)))
    run = sc.simulate(top, *RUN[:2], 1.0, 20.0)
    for model, found in ((top, run), (wire(), sc.static(wire(), watch=False))):
        assert sc.check(found) == found.meta["warnings"] != []
        found.save(tmp_path / "file.history")
        loaded = sc.History.load(tmp_path / "file.history")
        assert sc.check(loaded, model) == found.meta["warnings"]
        with pytest.raises(sc.InputError, match="does not know its scene"):
            sc.check(loaded)
        with pytest.raises(sc.HistoryError, match="another model"):
            sc.check(loaded, wire(names=("other",)))


def test_the_guide_lists_all_checks():
    page = Path(__file__).parents[2] / "examples" / "guide" / "05_trust.md"
    text = page.read_text(encoding="utf-8")
    for each in checks.CHECKS:
        assert f"| {each.about} | {each.says} | {each.remedy} |" in text


def test_an_equilibrium_that_can_move_freely_at_its_end_is_told():
    """A weight that is lifted from its cable: any place within its length is one."""
    model = sc.Model()
    ball = model.add("ball", sc.MassPoint(1.0, position=(0, 0, -1.0)))
    model.add("cable", sc.Cable(sc.ground((0, 0, 0)), ball.place(), stiffness=1e3, length=1.0))
    model.add("weight", sc.LoadGravity((0, 0, -9.81)))
    for end in (0.5, 0.0):
        with Notices(quiet=True) as notices:
            sc.static(model, factors={"weight": lambda x, end=end: 1 - (1 - end) * x})
        assert ["mass point 'ball'"] * (end == 0) == [each["item"] for each in notices.found]


def test_a_warning_that_is_made_an_error_keeps_the_history(tmp_path):
    path = tmp_path / "run.history"
    with warnings.catch_warnings():
        warnings.simplefilter("error", sc.CosseratWarning)
        with pytest.raises(sc.AccuracyWarning) as caught:
            sc.simulate(wire().freeze(), *RUN, 2e-3, path=path, **QUICK)
        for history in (caught.value.history, sc.History.load(path)):
            assert len(history) == 3 and history.status == "completed"
            assert len(history.meta["warnings"]) == 1
        with pytest.raises(sc.AccuracyWarning) as caught:
            sc.static(wire(), watch=False)
    assert len(caught.value.history) >= 1


def test_a_failure_says_what_was_doubtful_before():
    with pytest.warns(sc.ModelWarning, match="it looks odd"), pytest.raises(sc.Diverged) as caught:
        struck_and_doubtful()
    error = pickle.loads(pickle.dumps(caught.value))
    assert error.warnings == error.history.meta["warnings"] != []
    assert str(error).endswith("; warned before: beam 'wire', t = 0.3 s: it looks odd")
    assert error.history.meta["failure"] == str(error)
    # the cause, then what to try, then figures
    text = str(error).partition("; warned before")[0]
    assert text.startswith(f"step 4 from t = 0.3 s could not be solved: {error.reason}. Try a sm")
    assert "Try a smaller step than 0.1 s, then EnergyMomentum() (4 att" in text
    assert text.endswith(f"Newton iterations, scaled residual {error.residual:.3g})")
    assert max(len(part.split()) for part in text.split(". ")) <= 25


def test_what_a_scene_is_warned_of_goes_with_its_runs():
    """Said when it is built, kept with each run, not said again: not in another process either."""
    with pytest.warns(sc.ModelWarning, match="turns between its ends"):
        beam = bent()
    model = sc.Model()
    model.add("ring", beam)
    system = model.freeze()
    again = pickle.loads(pickle.dumps(system))
    for each in (system, again):
        history = sc.simulate(each, *RUN, 2e-3, **QUICK)
        assert history.meta["warnings"] == system.warnings == list(beam.warnings) != []
        assert sc.check(history) == system.warnings
        stepper = sc.Stepper(each, *RUN, kernels="numpy")
        assert stepper.notices.found == system.warnings


@pytest.mark.slow
def test_steps_of_a_loop_say_it_once():
    """One list a generator or stepper, at the line that asks for the step."""
    points = [(0, 0, 0), (0, 0, 1), (1, 0, 1), (1, 0, 0)]
    model, ends = sc.Model(), [sc.ground(points[0])]
    for k in range(3):
        a, b = map(np.array, points[k : k + 2])
        bar = sc.RigidBody.box(1.0, (0.05, 0.05, 1.0), position=(a + b) / 2, triad=sc.triad(b - a))
        model.add(f"bar {k}", bar)
        model.add(f"pin {k}", sc.JointRevolute(ends[-1], bar.at(a), axis=(0, 1, 0)))
        ends.append(bar.at(b))
    model.add("pin 3", sc.JointRevolute(ends[-1], sc.ground(points[3]), axis=(0, 1, 0)))
    system = model.freeze()
    start = sc.initial_state(system, rates={"pin 0": 5.0})
    reports = sc.steps(system, sc.EnergyMomentum(), sc.NullSpace(), 0.02, start)
    with pytest.warns(sc.AccuracyWarning, match="passed a singular position") as given:
        times = [next(reports).state.time for _ in range(60)]  # past two flat positions
    assert len(given) == 1 and given[0].filename == __file__ and len(times) == 60


@pytest.mark.slow
def test_jobs_keep_theirs_and_they_are_said_with_the_name():
    jobs = [sc.Job(f"pull {pull}", swung, pull) for pull in (1e-3, 100.0)]
    with ThreadPoolExecutor(1) as threads:
        for executor in (None, threads):
            with pytest.warns(sc.AccuracyWarning, match=r"^job 'pull 100.0', beam 'wire'") as given:
                silent, taut = sc.run_all(jobs, executor)
            assert len(given) == 1
            assert silent.warnings == [] and "1 warning>" in repr(taut)
            assert taut.warnings == taut.value.meta["warnings"]
    # in a worker nothing is said, and errors keep what was said before them
    outcome = pickle.loads(run_sent("x", pickle.dumps(sc.Job("x", struck_and_doubtful))))
    assert outcome.error.warnings == outcome.warnings != []


def doubtful(report):
    if report.state.time > 0.25:
        warn("beam 'wire'", "it looks odd", sc.ModelWarning, report.state.time)


def struck_and_doubtful():
    return sc.simulate(*struck(), 0.1, 1.0, callbacks=[doubtful])


def tip(elements: int) -> float:
    path = sc.static(wire(elements=elements), watch=False)
    return float(path["q"][-1, 0])


@pytest.mark.slow
def test_studies_sum_them_up():
    with pytest.warns(sc.AccuracyWarning) as given:
        study = sc.refine(tip, elements=(2, 4))
    assert len(given) == 1
    assert "2 of 2 levels gave warnings, such as 'elements = 2'" in str(given[0].message)
    assert given[0].filename == __file__
    assert "load factor" in study.rows[0]["warnings"]
    assert "warned: elements = 4: beam 'wire', load factor" in str(study)
    assert repr(study).endswith(", 2 warnings>")
    setups = [("taut", lambda elements: {"x": tip(elements)})]
    with pytest.warns(sc.AccuracyWarning, match="1 of 1 setups"):
        table = sc.work_precision(3, setups, {"x": 1.0}, ["x"], repeats=1)
    assert "Gauss points" in table.rows[0]["warnings"] and "1 with warnings" in repr(table)
    with pytest.warns(sc.AccuracyWarning, match="1 of 2 cells"):
        cells = sc.stability_map(swung, {"pull": (1e-3, 100.0)}, lambda history: "ok")
    assert [bool(row["warnings"]) for row in cells.rows] == [False, True]
    assert str(cells).endswith("1 with warnings")


@pytest.mark.slow
def test_a_time_that_is_no_multiple_of_the_step():
    model = sc.Model()
    model.add("ball", sc.MassPoint(1.0, velocity=(1.0, 0, 0)))
    system, scheme = model.freeze(), (sc.EnergyMomentum(), sc.NullSpace())
    with pytest.warns(sc.AccuracyWarning) as given:
        history = sc.simulate(system, *scheme, 0.3, until=1.0)
    assert str(given[0].message) == (
        "argument until: the run ends at t = 0.9 s, 0.1 s before until = 1 s, which is no multiple"
        " of the step of 0.3 s: give step = 0.25, which makes 4 steps"
    )
    assert len(history.meta["warnings"]) == 1
    # not where the difference is rounding, or events or callbacks end the run
    for step, until in ((0.1, 0.3), (1 / 3, 1.0)):
        history = sc.simulate(system, *scheme, step, until, every=100)
        assert history.times[-1] == pytest.approx(until, abs=1e-7)
    sc.simulate(system, *scheme, 0.3, 1.0, events=[])
    sc.simulate(system, *scheme, 0.3, 1.0, callbacks=[lambda report: report.state.time > 0.5])


def test_warnings_that_name_different_things_are_different():
    with Notices(quiet=True) as notices:
        for name, number in (("pin 1", 3), ("pin 2", 3), ("pin 2", 4)):
            warn("argument rates", f"{number} parts lag behind {name!r}", sc.ModelWarning)
    assert [notice["text"][-7:] for notice in notices.found] == ["'pin 1'", "'pin 2'"]
