"""Work and precision: known costs and errors, every kind of failure, fronts, resumed studies."""

from __future__ import annotations

import csv
import math
import threading
import time
from functools import partial
from itertools import pairwise

import helpers_precision as helpers
import numpy as np
import pytest

import skfem_cosserat as sc
from skfem_cosserat import InputError, work_precision
from skfem_cosserat.accuracy import (
    AtInstants,
    MaximumOverTime,
    ReferenceFinest,
    ReferenceKnown,
    ReferencePair,
    Setup,
    TimedOut,
    TimeLimit,
    setup_grid,
)
from skfem_cosserat.accuracy.precision import pareto

STEPS = (0.1, 0.05, 0.025, 0.0125)
EXACT = math.exp(-1.0)
FAILING = [
    ("lost", helpers.lost),
    ("wild", helpers.wild),
    ("broken", helpers.broken),
    ("unstable peer", partial(helpers.peer, status="diverged", reason="beyond its length")),
    ("odd peer", partial(helpers.peer, status="crashed", reason="signal 11")),
]


def both():
    """Euler and midpoint rule, four steps each."""
    return [
        *setup_grid(helpers.by, group="explicit", method={"Euler": helpers.euler}, step=STEPS),
        *setup_grid(
            helpers.by, group="implicit", method={"midpoint": helpers.midpoint}, step=STEPS
        ),
    ]


@pytest.fixture(scope="module")
def table():
    return work_precision(-1.0, [*both(), *FAILING], EXACT, ["x"], repeats=2)


# -- costs, errors, counts -------------------------------------------------------------------------


def test_rows_against_closed_forms(table):
    rows = {row["label"]: row for row in table.rows}
    assert len(rows) == len(table.rows) == 13
    for step in STEPS:
        count = round(1 / step)
        euler = rows[f"Euler, step = {step:g}"]
        assert euler["error_x"] == pytest.approx(abs((1 - step) ** count - EXACT), rel=1e-12)
        assert euler["cost_s"] == pytest.approx(1e-4 * count, rel=1e-15)
        assert (euler["newton_iterations"], euler["factorisations"]) == (0, 0)
        other = rows[f"midpoint, step = {step:g}"]
        ratio = (1 - step / 2) / (1 + step / 2)
        assert other["error_x"] == pytest.approx(abs(ratio**count - EXACT), rel=1e-9)
        assert other["cost_s"] == pytest.approx(2e-4 * count, rel=1e-15)
        assert (other["newton_iterations"], other["factorisations"]) == (count, None)
        assert (other["unknowns"], other["status"], other["reason"]) == (1, "ok", "")


def test_orders_are_seen(table):
    for group, order in (("explicit", 1), ("implicit", 2)):
        errors = [row["error_x"] for row in table.rows if row["group"] == group]
        seen = [math.log2(a / b) for a, b in pairwise(errors)]
        assert seen == pytest.approx([order] * 3, abs=0.05)


def test_every_kind_of_failure_is_kept(table):
    rows = {row["label"]: row for row in table.rows}
    found = {name: rows[name]["status"] for name, _ in FAILING}
    assert found == {
        "lost": "newton",
        "wild": "diverged",
        "broken": "error",
        "unstable peer": "diverged",
        "odd peer": "error",
    }
    assert "no convergence" in rows["lost"]["reason"]
    assert rows["wild"]["reason"] == "quantity 'x' is not finite"
    assert rows["broken"]["reason"] == "KeyError: 'beam'"
    assert rows["odd peer"]["reason"] == "crashed: signal 11"
    assert all(rows[name]["error_x"] is None for name in found)
    assert set(table.failed) == set(found)
    assert "failed: lost: newton (Diverged: step 3" in str(table)


def test_a_setup_that_takes_too_long(tmp_path):
    begun = time.monotonic()
    setups = [("endless", helpers.endless), ("midpoint", partial(helpers.midpoint, step=0.1))]
    found = work_precision(-1.0, setups, EXACT, ["x"], timeout_s=0.05)
    assert time.monotonic() - begun < 5
    assert [row["status"] for row in found.rows] == ["timeout", "ok"]
    assert found.rows[0]["reason"] == "TimedOut: not done within 0.05 s"
    assert found.rows[0]["spent_s"] == pytest.approx(0.05, abs=0.04)


def test_a_setup_that_fails_only_when_it_is_timed():
    calls = []

    def second(problem):
        calls.append(problem)
        return helpers.peer(problem, "diverged", "lost") if len(calls) > 1 else {"x": 1.0}

    (row,) = work_precision(0.0, [("second", second)], 1.0, ["x"]).rows
    assert (row["status"], row["reason"]) == ("diverged", "when timed: lost")
    assert len(calls) == 2


def test_warm_up_and_the_smallest_of_several_times():
    """The first call is for the error; its time does not count, nor that of the slow repeats."""
    times, calls = iter([0.0, 5.0, 10.0, 12.0, 20.0, 24.0]), []

    def run(problem):
        calls.append("run")
        return {"x": problem}

    found = work_precision(2.0, [Setup("only", run)], 1.5, ["x"], clock=lambda: next(times))
    assert len(calls) == 4
    assert found.rows[0]["cost_s"] == 2.0 and found.rows[0]["error_x"] == 0.5


def test_the_clock_of_the_wall():
    def sleeps(problem):
        time.sleep(0.02)
        return {"x": 1.0}

    (row,) = work_precision(0.0, [("sleeps", sleeps)], 1.0, ["x"]).rows
    assert row["cost_s"] >= 0.02


# -- references ------------------------------------------------------------------------------------


def test_errors_near_that_of_the_reference_are_told():
    """A setup that shares the mesh of the reference is no better than the reference is known."""
    setups = [("near", lambda problem: {"x": 1.0 + 1e-9}), ("far", lambda problem: {"x": 1.1})]
    found = work_precision(None, setups, ReferenceKnown(1.0, errors=1e-3), ["x"], repeats=1)
    (line,) = found.front("x", 1e-4).lines
    assert line.endswith("s, as far as the reference tells, known to 1.0e-03")
    assert str(found).startswith("x: errors to a reference known to 1.0e-03; what all setups share")
    alone = work_precision(None, setups[1:], ReferenceKnown(1.0, errors=1e-3), ["x"], repeats=1)
    assert "as far as" not in alone.front("x", 0.5).lines[0]


def test_reference_from_two_runs():
    """Richardson's limit of the midpoint rule, and how far the finer run is from it."""
    fine, coarse = (partial(helpers.midpoint, step=h) for h in (1 / 200, 1 / 100))
    found = work_precision(-1.0, both(), ReferencePair(fine, coarse, order=2), ["x"])
    own = abs(fine(-1.0)["x"] - EXACT)
    assert found.reference_errors["x"] == pytest.approx(own, rel=1e-4)
    exact = work_precision(-1.0, both(), EXACT, ["x"])
    for a, b in zip(found.rows, exact.rows, strict=True):
        assert a["error_x"] == pytest.approx(b["error_x"], abs=1e-9)
    plain = work_precision(-1.0, both(), ReferencePair(fine, coarse), ["x"])
    distance = abs(fine(-1.0)["x"] - coarse(-1.0)["x"])
    assert plain.reference_errors["x"] == pytest.approx(distance, rel=1e-12)


def test_over_time():
    """Largest error at instants that all have; a setup that lacks them has failed, alone."""

    def path(problem, step):
        t = step * np.arange(round(1 / step) + 1)
        return {"t": t, "x": np.exp(-t) + step * t}

    setups = setup_grid(path, step=(0.1, 0.05))
    reference = {"x": lambda t: np.exp(-t)}
    found = work_precision(None, setups, reference, ["x"], norm=MaximumOverTime())
    assert [row["error_x"] for row in found.rows] == pytest.approx([0.1, 0.05], rel=1e-12)
    odd = [*setups, ("no times", lambda problem: {"x": 1.0})]
    run = partial(path, step=0.025)
    found = work_precision(None, odd, run, ["x"], norm=AtInstants([0.5]))
    assert [row["error_x"] for row in found.rows[:2]] == pytest.approx([0.0375, 0.0125], rel=1e-12)
    assert found.rows[2]["status"] == "error" and "without times" in found.rows[2]["reason"]


def test_a_result_of_another_shape_disturbs_no_others():
    setups = [("odd", lambda problem: {"x": [1.0, 2.0]}), ("even", lambda problem: {"x": 1.5})]
    found = work_precision(None, setups, 1.0, ["x"])
    assert [row["status"] for row in found.rows] == ["error", "ok"]
    assert found.rows[1]["error_x"] == 0.5 and "shape" in found.rows[0]["reason"]


def test_kernels_of_our_own_runs_and_of_others():
    """As the history or the other program tells."""
    setups = [
        ("own", lambda rod: helpers.swing_down(rod, sc.EnergyMomentum(), 0.02)),
        ("peer", lambda rod: {"x": 1.0, "cost_s": 1.0, "kernels": "other"}),
    ]
    read = {"x": lambda result: result["x"] if isinstance(result, dict) else result.times[-1]}
    table = work_precision(2, setups, {"x": 1.0}, read, repeats=1)
    assert [row["kernels"] for row in table.rows] == ["numpy", "other"]


# -- fronts ----------------------------------------------------------------------------------------


def test_front_in_words(table):
    front = table.front("x", [1e-2, 1e-3, 1e-9])
    assert front.lines == [
        "for 1e-02 in x the cheapest is implicit: midpoint, step = 0.1: 3.1e-04 in 0.002 s",
        "for 1e-03 in x the cheapest is implicit: midpoint, step = 0.1: 3.1e-04 in 0.002 s",
        "for 1e-09 in x nothing is good enough",
    ]
    assert str(front) == "\n".join(front.lines)
    assert list(table.front("x").cheapest) == [1e-2, 1e-3, 1e-4, 1e-5]
    assert str(table).startswith("x: errors to a reference whose own error is not known; what all")
    only = table.front("x", [1e-2], group="explicit").cheapest[1e-2]
    assert only["label"] == "Euler, step = 0.05"


def test_front_against_brute_force():
    rng = np.random.default_rng(0)
    points = [
        {"cost_s": float(c), "error_x": float(e)} for c, e in rng.integers(1, 12, size=(60, 2))
    ]
    kept = [(p["cost_s"], p["error_x"]) for p in pareto(points, "x")]
    every = {(p["cost_s"], p["error_x"]) for p in points}
    good = {
        (c, e)
        for c, e in every
        if not any(a <= c and b <= e and (a, b) != (c, e) for a, b in every)
    }
    assert set(kept) == good and kept == sorted(kept)


def fixed(points, group):
    """Setups with these costs and errors."""
    return [
        Setup(f"{group} {k}", partial(_fixed, cost=cost, error=error), group=group)
        for k, (cost, error) in enumerate(points)
    ]


def _fixed(problem, cost, error):
    return {"x": error, "cost_s": cost}


def test_standing_says_where_we_are_behind_and_by_how_much():
    ours = fixed([(1.0, 1e-2), (4.0, 1e-4)], "ours")
    peer = fixed([(2.0, 1e-2), (3.0, 1e-3), (3.5, 2e-3), (40.0, 1e-6)], "peer")
    blind = fixed([(2.0, 1e-9)], "blind")
    reference = ReferenceKnown(0.0, errors=1e-7)
    standing = work_precision(None, ours + peer + blind, reference, ["x"]).standing("x", "ours")
    ratios = [each.ratio for each in standing.levels if each.group == "peer"]
    assert ratios == pytest.approx([0.5, 4 / 3, math.inf])
    assert [each.error for each in standing.behind] == pytest.approx([1e-3, 1e-6])
    assert standing.lines == [
        "peer: cheaper at 1 of the 3 errors it reaches, 2 to 2 times",
        "peer: behind at 1.0e-03 in x: 4 s against 3 s, 1.33 times as much",
        "peer: behind at 1.0e-06 in x: not reached, the peer takes 40 s",
        "blind: no error that the reference lets one judge",
    ]
    with pytest.raises(InputError, match="'nobody'"):
        work_precision(None, ours, reference, ["x"]).standing("x", "nobody")


# -- files -----------------------------------------------------------------------------------------


@pytest.mark.slow
def test_csv_and_chart(table, tmp_path):
    text = table.csv(tmp_path / "table.csv").read_text().splitlines()
    head = [line for line in text if line.startswith("# ")]
    rows = list(csv.DictReader(text[len(head) :]))
    assert any(line.startswith("# versions") for line in head)
    assert float(rows[0]["error_x"]) == table.rows[0]["error_x"]
    assert [r["status"] for r in rows[8:]] == ["newton", "diverged", "error", "diverged", "error"]
    assert rows[8]["error_x"] == ""
    pytest.importorskip("matplotlib")
    figure = table.chart(tmp_path / "table.png")
    assert (tmp_path / "table.png").stat().st_size > 10_000
    (axis,) = figure.axes
    assert (axis.get_xlabel(), axis.get_ylabel()) == ("time in s", "error of x")
    crosses = [line for line in axis.lines if line.get_marker() == "x"]
    assert sum(len(line.get_xdata()) for line in crosses) == len(FAILING)
    with pytest.raises(InputError, match="unknown; known: 'x'"):
        table.chart(quantities=["y"])
    with pytest.raises(InputError, match=r"\.xyz, expected one of"):
        table.chart(tmp_path / "chart.xyz")


@pytest.mark.slow
def test_charts_of_other_costs_and_of_a_stored_table(table, tmp_path):
    """Iterations: Euler tells none; few lines: the others are dots; read again: the same chart."""
    pytest.importorskip("matplotlib")
    figure = table.chart(cost="iterations", units={"x": "m"})
    (axis,) = figure.axes
    assert (axis.get_xlabel(), axis.get_ylabel()) == ("iterations", "error of x in m")
    lines = {line.get_label(): line.get_xdata() for line in axis.lines}
    assert lines["implicit"].tolist() == [round(1 / step) for step in STEPS]
    assert "explicit" not in lines and "failed" not in lines
    with pytest.raises(InputError, match="argument cost: 'money', unknown"):
        table.chart(cost="money")
    few = table.chart(kind=lambda row: row["label"], most=1).axes[0]
    kept = [label for label in few.get_legend_handles_labels()[1] if "step" in label]
    assert [label.split(",")[0] for label in kept] == ["Euler", "midpoint"]  # one of each group
    again = type(table).read(table.csv(tmp_path / "table.csv"))
    assert again.reference_errors == pytest.approx(table.reference_errors, nan_ok=True)
    assert str(again) == str(table)
    (tmp_path / "other.csv").write_text("a,b\n1,2\n")
    with pytest.raises(InputError, match="not of a work-precision study"):
        type(table).read(tmp_path / "other.csv")


def test_resumed_study(tmp_path):
    """What is there is not run again; another problem is another case."""
    setups = setup_grid(partial(helpers.counted, log=tmp_path), step=STEPS)
    study = {"repeats": 2, "folder": tmp_path / "study"}
    first = work_precision(-1.0, setups[:2], EXACT, ["x"], **study)
    again = work_precision(-1.0, setups, EXACT, ["x"], **study)
    assert again.rows[:2] == first.rows
    assert (tmp_path / "calls").read_text().split() == [f"{h}" for h in STEPS for _ in range(3)]
    work_precision(-2.0, setups[:1], EXACT, ["x"], **study)
    assert len((tmp_path / "calls").read_text().split()) == 15


# -- our own methods -------------------------------------------------------------------------------


@pytest.mark.slow
def test_rubber_rod_with_both_integrators():
    """Second order is seen in the table, of histories, with counts and unknowns."""
    schemes = {"energy-momentum": sc.EnergyMomentum(), "variational": sc.Variational()}
    steps = (4e-3, 2e-3, 1e-3)
    setups = setup_grid(helpers.swing_down, integrator=schemes, step=steps)
    pair = ReferencePair(
        partial(helpers.swing_down, integrator=sc.EnergyMomentum(), step=5e-4),
        partial(helpers.swing_down, integrator=sc.EnergyMomentum(), step=1e-3),
        order=2,
    )
    found = work_precision(4, setups, pair, {"tip": helpers.tip}, repeats=1)
    assert not found.failed
    for k in (0, 3):
        errors = [row["error_tip"] for row in found.rows[k : k + 3]]
        assert [math.log2(a / b) for a, b in pairwise(errors)] == pytest.approx([2, 2], abs=0.15)
    for row in found.rows:
        count = round(0.08 / float(row["label"].split(" = ")[1]))
        assert 2 * count <= row["newton_iterations"] <= row["factorisations"]
        assert row["unknowns"] == helpers.rubber_rod(4).unknowns and row["cost_s"] > 0


# -- what a user may do ----------------------------------------------------------------------------


def test_a_reference_that_fails_ends_the_study_before_the_setups():
    good, begun = {"x": 1.0}, []

    def setup(problem):
        begun.append(problem)
        return good

    def study(reference, quantities=("x",)):
        work_precision(0.0, [("a", setup)], reference, quantities)

    with pytest.raises(InputError, match="its run failed: RuntimeError"):
        study(ReferencePair(lambda problem: good, _raises))
    with pytest.raises(InputError, match=r"'y'.*unknown; known: 'x'"):
        study(lambda problem: good, ["y"])
    with pytest.raises(InputError, match="run of the reference: ZeroDivisionError"):
        study(lambda problem: good, {"x": lambda result: 1 / 0})
    assert not begun


def _raises(problem):
    raise RuntimeError("out of order")


@pytest.mark.parametrize("cost", ["cheap", -1.0, math.nan])
def test_costs_that_are_none(cost):
    setups = [("odd", lambda problem: {"x": 1.0, "cost_s": cost})]
    (row,) = work_precision(0.0, setups, 1.0, ["x"]).rows
    assert row["status"] == "error" and "cost_s" in row["reason"] and row["cost_s"] is None


def test_counts_that_are_none():
    odd = {"x": 1.0, "cost_s": 1.0, "newton_iterations": "many", "unknowns": np.int64(3)}
    (row,) = work_precision(0.0, [("odd", lambda problem: odd)], 1.0, ["x"]).rows
    assert (row["status"], row["newton_iterations"], row["unknowns"]) == ("ok", None, 3)


def test_exact_setups_and_a_single_error():
    """No error at all has a front in words, too."""
    found = work_precision(0.0, [("a", lambda p: {"x": 1.0, "cost_s": 2.0})], 1.0, ["x"], repeats=1)
    assert found.front("x").lines == ["for 0e+00 in x the cheapest is a: 0.0e+00 in 2 s"]
    assert found.front("x", 1e-3).lines == found.front("x", [1e-3]).lines
    with pytest.raises(InputError, match="error = 'much'"):
        found.front("x", "much")


# -- limits of time --------------------------------------------------------------------------------


def test_time_limit_in_a_thread_tells_afterwards():
    caught = []

    def work():
        try:
            with TimeLimit(0.01):
                time.sleep(0.03)
        except TimedOut as error:
            caught.append(str(error))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert caught == ["not done within 0.01 s"]


# -- bad input -------------------------------------------------------------------------------------


def never(problem):
    raise AssertionError("work has started")


BAD = {
    "setups": ({"setups": 3}, "argument setups: 3, expected a list of"),
    "no setups": ({"setups": []}, "is empty"),
    "same label": ({"setups": [("a", never), ("a", never)]}, "two setups are called 'a'"),
    "no function": ({"setups": [("a", 1)]}, "setup 'a': 1 cannot be called"),
    "taken": ({"setups": [("reference", never)], "reference": never}, "'reference' is that of"),
    "no reference": ({"reference": None}, "argument reference: None, expected values"),
    "of levels": ({"reference": ReferenceFinest()}, "expected values, ReferenceKnown"),
    "not finite": ({"reference": math.nan}, "expected finite numbers"),
    "unknown": ({"reference": {"y": 1.0}}, "reference of 'y': unknown; known: 'x'"),
    "one value": ({"quantities": ["x", "y"]}, "one value for 2 quantities"),
    "quantities": ({"quantities": "x"}, "argument quantities: 'x'"),
    "repeats": ({"repeats": 0}, "argument repeats: 0, expected a positive integer"),
    "timeout": ({"timeout_s": -1}, "timeout_s = -1, expected a positive"),
    "clock": ({"clock": 1}, "argument clock: 1"),
    "norm": ({"norm": "max"}, "argument norm: 'max'"),
}


@pytest.mark.one_quick
@pytest.mark.parametrize("name", BAD)
def test_bad_input_gives_one_error_before_any_work(name):
    change, message = BAD[name]
    given = {"setups": [("a", never)], "reference": 1.0, "quantities": ["x"], **change}
    with pytest.raises(InputError, match=message.replace("(", r"\(")):
        work_precision(0.0, **given)


def test_bad_quantities_references_and_axes():
    good = [("euler", partial(helpers.euler, step=0.1))]
    with pytest.raises(InputError, match=r"no setup gave them; euler: .*'y'"):
        work_precision(-1.0, good, 1.0, ["y"])
    with pytest.raises(InputError, match=r"axis 'step': 0\.1, expected values"):
        setup_grid(never, step=0.1)
    with pytest.raises(InputError, match="fine = 1, expected a function"):
        ReferencePair(1, never)
    with pytest.raises(InputError, match="expected a positive"):
        ReferenceKnown(1.0, errors=0.0)
    with pytest.raises(InputError, match="unknown; known: 'x'"):
        work_precision(-1.0, good, 1.0, ["x"]).front("y")
