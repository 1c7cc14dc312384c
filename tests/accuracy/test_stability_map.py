"""Maps of where methods fail: known limits, every kind of outcome, resumed maps, a stiff scene."""

from __future__ import annotations

import csv
import math
import warnings
from functools import partial

import helpers_precision as helpers
import numpy as np
import pytest

import skfem_cosserat as sc
from skfem_cosserat import InputError, stability_map
from skfem_cosserat.accuracy import FULL_PROTOCOL, JudgeEnergy, TimedOut, Verdict
from skfem_cosserat.accuracy.stability import mechanism

KINDS = ("ok", "drift", "blowup", "newton", "half-hearted", "timeout", "error")
OMEGAS, STEPS = (0.5, 1.9, 2.1, 30.0), (0.05, 0.5, 1.0)
JUDGE = JudgeEnergy(helpers.amplitude)


@pytest.fixture(scope="module")
def kinds():
    return stability_map(helpers.every_kind, {"step": (1.0,), "kind": KINDS}, JUDGE, timeout_s=0.05)


@pytest.fixture(scope="module")
def oscillator():
    axes = {"omega": OMEGAS, "step": STEPS}
    return stability_map(helpers.leapfrog, axes, helpers.judged)


# -- outcomes --------------------------------------------------------------------------------------


def test_every_kind_of_outcome(kinds):
    found = dict(zip(KINDS, kinds.status[0], strict=True))
    assert found == {name: name for name in KINDS} | {"half-hearted": "error"}
    assert kinds.status.shape == kinds.time.shape == kinds.energy_error.shape == (1, 7)


def test_times_errors_and_residuals(kinds):
    time, error, residual = (x[0] for x in (kinds.time, kinds.energy_error, kinds.newton_residual))
    assert time[:4] == pytest.approx([6.0, 6.0, 3.0, 0.25])
    assert error[:2] == pytest.approx([0.006, 0.03], rel=1e-12)
    assert error[2] == pytest.approx(9.01, rel=1e-12)  # E > 10 E0 at 10.01, not yet at 9.99
    assert np.isnan(error[3:]).all()
    assert residual[2:5] == pytest.approx([0.5, 0.125, 0.125])
    assert np.isnan(residual[[0, 1, 5, 6]]).all()


def test_reasons(kinds):
    reason = dict(zip(KINDS, kinds.reason[0], strict=True))
    assert reason["ok"] == reason["drift"] == ""
    assert reason["blowup"].startswith("then Diverged: step 5")
    assert reason["newton"].startswith("Diverged: step 3")
    assert "settings=FULL_PROTOCOL" in reason["half-hearted"]
    assert reason["timeout"] == "TimedOut: not done within 0.05 s"
    assert reason["error"] == "LookupError: no such section"


def test_explicit_limit_at_step_times_omega_2(oscillator):
    """The leapfrog scheme blows up where theory says, and nowhere else."""
    for i, omega in enumerate(OMEGAS):
        for k, step in enumerate(STEPS):
            stable = step * omega < 2
            assert oscillator.status[i, k] == ("ok" if stable else "blowup")
    assert oscillator.numbers["last"].shape == (4, 3)
    stable = np.outer(OMEGAS, STEPS) < 2
    assert (oscillator.numbers["last"][stable] < 16).all()
    assert oscillator.time[0, 0] == pytest.approx(399 * 0.05)
    assert (oscillator.time[~stable] < 399 * np.outer(np.ones(4), STEPS)[~stable]).all()


# its two elements are drawn farther than such ones can be, which is quick
@pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")
def test_a_run_that_is_stopped_tells_how_far_it_came():
    """Its history comes with the error; energies were not derived yet, which is no fault."""
    error = TimedOut("not done within 1 s")
    error.history = helpers.swing_down(2, sc.EnergyMomentum(), 1e-2)
    for judge in (JudgeEnergy(), JudgeEnergy(lambda history: history["energy"])):
        found = judge(error)
        assert found.status == "timeout" and found.time == pytest.approx(0.08)
        assert np.isnan(found.energy_error)


@pytest.mark.slow
def test_a_limit_of_time_stops_a_simulation():
    # of short steps: in a limit of longer ones the rod folds, which is warned of
    (row,) = stability_map(helpers.slow_rod, {"step": (1e-6,)}, timeout_s=0.5).rows
    assert row["status"] == "timeout" and row["seconds"] < 5


def test_energy_before_a_time_does_not_count():
    energy = np.array([0.0, 5.0, 5.0, 5.004, 5.02])
    history = helpers.history_of(np.sqrt(energy), np.zeros(5), 1.0)
    found = JudgeEnergy(helpers.amplitude, since=2.0)(history)
    assert found.status == "ok" and found.energy_error == pytest.approx(0.004, rel=1e-9)
    assert JudgeEnergy(helpers.amplitude, since=2.0, drift=1e-3)(history).status == "drift"
    assert JudgeEnergy(helpers.amplitude, scale=1000.0)(history).status == "ok"
    with pytest.raises(InputError, match="is zero"):
        JudgeEnergy(helpers.amplitude)(history)


# its two elements are drawn farther than such ones can be, which is quick
@pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")
def test_energy_that_is_zero_by_the_choice_of_a_height():
    """Let go at the height of its hinge: changes are compared with the work of gravity."""
    t = np.arange(4.0)
    series = {"t": t, "step": t, "q": np.zeros((4, 3)), "p": np.zeros((4, 3))}
    work = np.array([0.0, -1.0, -2.0, -4.0])
    for error, status in ((0.02, "ok"), (0.2, "drift"), (40.0, "blowup")):
        energy = 1e-17 - work + np.array([0, 0, 0, error])
        history = sc.History({"status": "completed"}, {}, series)
        history.add_series("energy", energy)
        history.add_series("external", work)
        found = JudgeEnergy()(history)
        assert (found.status, found.energy_error) == (status, pytest.approx(error / 4))


@pytest.mark.slow
def test_problems_that_take_settings_get_the_full_protocol():
    """Without settings of their own they fail only after 100 iterations in each attempt."""
    found = stability_map(helpers.blow, {"iterations": (None, 5, 100)}, JudgeEnergy(since=0.35))
    assert found.status.tolist() == ["newton", "error", "newton"]
    assert found.newton_residual[0] == found.newton_residual[2] > 1e-8
    assert "4 attempts with 400 Newton iterations" in found.reason[0]
    assert "settings=FULL_PROTOCOL" in found.reason[1]
    chosen = partial(helpers.blow, settings=sc.NewtonSettings(5, damped_iterations=5))
    found = stability_map(chosen, {"iterations": (None,)}, JudgeEnergy(since=0.35))
    assert found.status.tolist() == ["error"]  # it has settings already


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")  # what fails is warned of
def test_explicit_steps_above_the_limit_have_blown_up():
    """They are not solved for: no protocol is missing."""
    found = stability_map(helpers.free_rubber, {"times_limit": (0.5, 1.5)})
    assert found.status.tolist() == ["ok", "blowup"]
    assert "the motion has blown up" in found.reason[1] or found.energy_error[1] > 9
    error = sc.Diverged(0.5, 3, np.inf, "the motion has blown up", "none")
    assert (JUDGE(error).status, JUDGE(error).time) == ("blowup", 0.5)
    assert JUDGE(error).reason.startswith("Diverged: step 3")
    assert JUDGE(sc.Diverged(0.5, 3, 0.1, "a dead point", "none")).status == "error"


def test_a_subprocess_that_takes_too_long():
    (row,) = stability_map(helpers.sleeping_process, {"step": (1.0,)}).rows
    assert row["status"] == "timeout" and row["reason"].startswith("TimeoutExpired")


def test_energy_that_is_no_number_has_blown_up():
    history = helpers.history_of(np.array([1.0, 1.0, np.inf]), np.zeros(3), 1.0)
    assert JUDGE(history).status == "blowup"
    history = helpers.history_of(np.array([np.nan, 1.0]), np.zeros(2), 1.0)
    assert JUDGE(history).status == "blowup"


def test_a_judge_of_ones_own():
    def words(result):
        return "broken" if isinstance(result, Exception) else "fine"

    found = stability_map(helpers.every_kind, {"step": (1.0,), "kind": ("ok", "error")}, words)
    assert found.status.tolist() == [["fine", "broken"]]


# -- a stiff scene ---------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")  # what fails is warned of
def test_stiff_column_with_both_integrators():
    """Steel under twice its Euler load: variational blows up, energy-momentum does not."""
    schemes = ("energy-momentum", "variational")
    axes = {"integrator": schemes, "step": (1e-3, 5e-4)}
    found = stability_map(helpers.stiff_bar, axes, JudgeEnergy(since=helpers.PUSHED))
    assert found.status.tolist() == [["ok", "ok"], ["blowup", "blowup"]]
    assert (found.energy_error[0] < 1e-9).all() and (found.energy_error[1] > 9).all()
    assert found.time[0] == pytest.approx(0.15) and (found.time[1] < 0.14).all()
    assert np.isnan(found.newton_residual[0]).all()
    assert (found.newton_residual[1] > 1e-6).all()  # then a step cannot be solved, either
    assert "then Diverged" in found.reason[1, 0]


# -- resumed, elsewhere ----------------------------------------------------------------------------


def test_resumed_map(tmp_path):
    problem = partial(helpers.leapfrog, log=tmp_path)
    folder = tmp_path / "cells"
    first = stability_map(problem, {"step": STEPS[:2], "omega": OMEGAS}, JUDGE, resume=folder)
    calls = (tmp_path / "calls").read_text().splitlines()
    assert len(calls) == 8
    more = stability_map(problem, {"step": STEPS, "omega": OMEGAS}, JUDGE, resume=folder)
    assert len((tmp_path / "calls").read_text().splitlines()) == 12
    assert (more.status[:2] == first.status).all()
    stability_map(problem, {"step": STEPS, "omega": OMEGAS}, helpers.judged, resume=folder)
    assert len((tmp_path / "calls").read_text().splitlines()) == 24  # judged anew


# -- files -----------------------------------------------------------------------------------------


def test_csv(kinds, tmp_path):
    text = kinds.csv(tmp_path / "map.csv").read_text().splitlines()
    head = [line for line in text if line.startswith("# ")]
    rows = list(csv.DictReader(text[len(head) :]))
    assert head[0] == '# stability map: "every_kind"'
    assert [row["kind"] for row in rows] == list(KINDS)
    assert [row["status"] for row in rows] == kinds.status[0].tolist()
    assert float(rows[2]["energy_error"]) == kinds.energy_error[0, 2]
    assert not any(line.startswith("# kernels") for line in head)  # the rows say which ran


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")  # a blow in a single step
def test_kernels_that_ran_are_told(tmp_path):
    """In a map's column, as the history has it: of failed runs, too."""
    found = stability_map(helpers.blow, {"iterations": (5,)}, JudgeEnergy(since=0.35))
    assert [row["kernels"] for row in found.rows] == ["numpy"]
    text = found.csv(tmp_path / "map.csv").read_text()
    assert ",seconds,kernels,mechanism,reason,warnings\n" in text and "Diverged: step " in text


@pytest.mark.slow
def test_chart_with_the_explicit_limit(oscillator, tmp_path):
    """The line runs between the cells that are stable and those that are not."""
    pytest.importorskip("matplotlib")
    lines = {"h omega = 2": lambda omega, step: omega * step / 2}
    figure = oscillator.chart(tmp_path / "map.png", lines)
    assert (tmp_path / "map.png").stat().st_size > 10_000
    (axis,) = figure.axes
    assert (axis.get_xlabel(), axis.get_ylabel()) == ("step in s", "omega")
    contour = next(each for each in axis.collections if type(each).__name__ == "QuadContourSet")
    points = np.concatenate([path.vertices for path in contour.get_paths()])
    at = np.interp(points[:, 1], range(4), np.log(OMEGAS))
    at += np.interp(points[:, 0], range(3), np.log(STEPS))
    np.testing.assert_allclose(at, math.log(2), atol=1e-9)
    legend = oscillator.chart(lines={"stiff": np.full((4, 3), 3.0)}).legends[0]
    assert legend.get_texts()[2].get_text() == "stiff (all cells beyond)"


@pytest.mark.slow
def test_chart_with_panels(tmp_path):
    pytest.importorskip("matplotlib")
    axes = {"kind": ("ok", "drift"), "step": (0.5, 1.0), "more": (1, 2)}
    found = stability_map(_third, axes, JUDGE)
    assert len(found.chart(tmp_path / "panels.png").axes) == 2
    assert str(found) == "stability map over kind (2) x step (2) x more (2): 4 drift, 4 ok"
    with pytest.raises(InputError, match="expected two of kind, step, more"):
        found.chart(x="omega")
    with pytest.raises(InputError, match=r"shape \(2,\), expected \(2, 2, 2\)"):
        found.chart(lines={"wrong": np.ones(2)})
    with pytest.raises(InputError, match=r"line 'wrong': takes \(h, k\)"):
        found.chart(lines={"wrong": lambda h, k: 1.0})


def _third(step, kind, more):
    return helpers.every_kind(step, kind)


# -- bad input -------------------------------------------------------------------------------------


def never(step, omega):
    raise AssertionError("work has started")


GOOD = {"step": (1.0,), "omega": (1.0,)}
BAD = {
    "a number": ({"axes": {"step": 1.0, "omega": (1.0,)}}, "axis 'step': 1.0, expected a sequence"),
    "twice": ({"axes": {"step": (1.0, 1.0), "omega": (1.0,)}}, "the same value twice"),
    "no problem": ({"problem": 3}, "argument problem: 3 cannot be called"),
    "parameters": ({"axes": {"mass": (1.0,)}}, "argument problem: takes (step, omega)"),
    "outcome": ({"outcome": 3}, "argument outcome: 3, expected a function"),
    "timeout": ({"timeout_s": 0}, "timeout_s = 0, expected a positive"),
    "executor": ({"executor": 3}, "argument executor: 3"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_input_gives_one_error_before_any_work(name):
    change, message = BAD[name]
    given = {"problem": never, "axes": GOOD, **change}
    with pytest.raises(InputError) as caught:
        stability_map(given.pop("problem"), given.pop("axes"), **given)
    assert message in str(caught.value)


def test_what_cannot_be_judged_ends_the_map():
    axes = {"step": (1.0,), "omega": (1.0, 2.0)}
    with pytest.raises(InputError, match="no series 'energy' and 'external'"):
        stability_map(helpers.leapfrog, axes)
    with pytest.raises(InputError, match="gave a dict, expected a History"):
        stability_map(lambda step, omega: {}, axes)
    with pytest.raises(InputError, match="gave 3, expected a Verdict"):
        stability_map(helpers.leapfrog, axes, lambda result: 3)
    with pytest.raises(InputError, match=r"energy gave shape \(2,\)"):
        stability_map(helpers.leapfrog, axes, JudgeEnergy(lambda history: np.ones(2)))
    for bad in ({"energy": 3}, {"since": -1.0}, {"scale": 0.0}, {"drift": 0.0}, {"blowup": -1.0}):
        with pytest.raises(InputError, match="JudgeEnergy"):
            JudgeEnergy(**bad)
    assert Verdict("ok").numbers == {}


# -- mechanisms ------------------------------------------------------------------------------------


@pytest.mark.slow
def test_failed_cells_have_a_mechanism():
    """A wheel that turns too fast in a step, and others that turn less."""

    def wheel(kind, rate):
        model = sc.Model()
        model.add("wheel", sc.RigidBody(1.0, (1.0, 1.0, 2.0), angular_velocity=(0, 0, rate)))
        options = {"settings": FULL_PROTOCOL, "kernels": "numpy"}
        return sc.simulate(model, sc.Variational(), sc.NullSpace(), 1.0, 20.0, **options)

    axes = {"kind": ["wheel"], "rate": [0.2, 0.9, 1.2]}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", sc.CosseratWarning)
        found = stability_map(wheel, axes)
    assert found.status.ravel().tolist() == ["ok", "ok", "newton"]
    # the variational scheme turns by arcsin(h Omega) in a step
    turns = [np.arcsin(0.2), np.arcsin(0.9), 1.2]
    assert found.numbers["turn"].ravel() == pytest.approx(turns, rel=1e-3)
    assert found.mechanism.ravel().tolist() == ["", "", "rotation"]
    assert "mechanism" in found.rows[0] and "turn" in found.rows[2]


def test_the_surest_mechanism_is_named():
    numbers = {"h_omega_c": 2.1, "turn": 0.6, "doubtful": 1.0, "off": 0.2, "elements": 1.0}
    names = []
    for number in tuple(numbers):
        names.append(mechanism("newton", numbers))
        numbers[number] = float("nan")
    assert names == ["compression", "rotation", "branch", "unresolved", "elements"]
    assert mechanism("blowup", numbers) == "energy" and mechanism("newton", numbers) == ""
    assert mechanism("ok", {"h_omega_c": 3.0}) == ""
    # what the scheme took or added comes last
    assert [mechanism("drift", {"lost": lost}) for lost in (0.02, 0.002)] == ["damping", ""]
    assert mechanism("drift", {"lost": 0.5, "elements": 1.0}) == "elements"


@pytest.mark.slow
@pytest.mark.parametrize(("bending", "expected"), [(40.0, "damping"), (0.004, "elements")])
def test_cells_tell_of_damping_and_of_bent_elements(bending, expected):
    """A scheme takes the energy of a fast vibration; a limp cantilever folds up in its fall."""
    section = sc.Section((2e4, 2e4, 5e4, bending, bending, bending), mass=1.0, inertia=(1e-4, 1e-4))
    model = sc.Model()
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 4, name="rod")
    beam = model.add("beam", sc.Beam(mesh, section, director=(0, 1, 0)))
    model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), beam.node("rod.start")))
    model.add("weight", sc.LoadGravity((0, 0, -9.81)))
    options = {"settings": FULL_PROTOCOL, "kernels": "numpy"}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", sc.CosseratWarning)
        found = sc.simulate(model, sc.GeneralizedAlpha(0.0), sc.NullSpace(), 0.01, 0.6, **options)
        verdict = JudgeEnergy(scale=0.01)(found)
    assert (verdict.status, verdict.mechanism) == ("drift", expected)
    balance = found.meta["energy_balance"]
    assert verdict.numbers["lost"] == balance["lost"] / balance["scale"]
