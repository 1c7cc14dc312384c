"""Refinement studies: known orders, verdicts that can be trusted, resumed runs, files."""

from __future__ import annotations

import csv
import math
import sys
from functools import partial

import helpers_studies as problems
import numpy as np
import pytest

import skfem_cosserat as sc
from skfem_cosserat import InputError, refine
from skfem_cosserat.accuracy import (
    AtInstants,
    MaximumOverTime,
    ReferenceFinest,
    ReferenceKnown,
    ReferencePair,
    ReferenceRun,
    ResultTable,
    RootMeanSquare,
    convergence,
)

HALVED = 0.5 ** np.arange(8)
#: what levels cannot be compared with: its runs are functions of a problem
PAIR = ReferencePair(abs, abs)
BENT = {1: (16, 32, 64, 128), 2: (8, 16, 32, 64), 3: (4, 8, 12, 16), 4: (6, 8, 12, 16)}


def oscillation(t):
    return np.stack([np.cos(t), -np.sin(t)], axis=1)


# -- known orders: ten problems --------------------------------------------------------------------


@pytest.mark.parametrize(
    ("problem", "levels", "order", "exact"),
    [
        (problems.trapezoid, {"elements": (2, 4, 8, 16)}, 2, math.e - 1),
        (problems.first_and_second, {"elements": (4, 8, 16, 32, 64)}, 1, (1.0, 2.0, -1.0)),
    ],
)
def test_closed_forms(problem, levels, order, exact):
    """With and without the true value; the extrapolated one is as good as it says."""
    alone = refine(problem, **levels)
    found = alone.orders["value"]
    truth = np.asarray(exact)
    assert abs(found.order - order) < 0.02
    assert abs(found.order - order) <= found.spread
    assert np.linalg.norm(found.extrapolated - truth) < found.uncertainty
    against = refine(problem, **levels, reference=exact)
    assert abs(against.orders["value"].order - order) < 0.02
    errors = against.orders["value"].errors
    assert (abs(found.errors - errors) <= found.uncertainties).all()
    error, doubt = alone.estimate["value"]
    assert abs(error - errors[-1]) < doubt < 0.05 * error


@pytest.mark.parametrize(
    ("norm", "reference"),
    [
        (MaximumOverTime(), None),
        (RootMeanSquare(), oscillation),
        (AtInstants([0.4, 2.0]), {"x": oscillation}),
    ],
)
def test_fourth_order_over_time(norm, reference):
    steps = (0.2, 0.1, 0.05, 0.025)
    study = refine(problems.fourth, step=steps, norm=norm, reference=reference)
    assert abs(study.orders["x"].order - 4) < 0.05
    runs = {step: problems.fourth(step) for step in steps}
    shared = runs[0.2]["t"]
    errors = [runs[h]["x"][:: round(0.2 / h)] - oscillation(shared) for h in steps]
    lengths = np.linalg.norm(errors, axis=2)
    if isinstance(norm, AtInstants):
        expected = lengths[:, [2, 10]].max(axis=1)
    elif isinstance(norm, RootMeanSquare):
        weights = np.full(11, 0.1)
        weights[[0, -1]] /= 2
        expected = np.sqrt(lengths**2 @ weights)
    else:
        expected = lengths.max(axis=1)
    if reference is None:
        expected_doubts = study.orders["x"].uncertainties
        assert (abs(study.orders["x"].errors - expected) <= expected_doubts).all()
    else:
        np.testing.assert_allclose(study.orders["x"].errors, expected, rtol=1e-9)


@pytest.mark.slow
def test_statics_of_order_two_p_at_nodes():
    study = refine(problems.bend, elements=BENT)
    true = problems.bend(48, 4)
    assert list(study.orders) == [f"value, order = {order}" for order in BENT]
    for order, found in zip(BENT, study.orders.values(), strict=True):
        assert abs(found.order - 2 * order) < 0.1
        assert "three finest of four levels" in found.verdict
        assert np.linalg.norm(found.extrapolated - true) < found.uncertainty


@pytest.mark.slow
def test_frequencies_of_order_two_p():
    """Against a finer run, which is no level."""
    reference = ReferenceRun(elements=64, order=3)
    study = refine(problems.frequencies, elements=(4, 8, 16, 32), order=2, reference=reference)
    assert abs(study.orders["value"].order - 4) < 0.1
    assert len(study.rows) == len(study.outcomes) == 4


@pytest.mark.slow
def test_steps_of_second_order():
    """Constraint forces, too, which belong to the states."""
    study = refine(problems.in_time, step=[0.02, 0.01, 0.005, 0.0025])
    assert list(study.orders) == ["q", "v", "reaction"]
    for name, found in study.orders.items():
        assert abs(found.order - 2) < 0.1, study.verdicts[name]


@pytest.mark.slow
def test_space_and_time_together():
    levels = {"elements": (4, 8, 16, 32), "step": [0.05, 0.025, 0.0125, 0.00625]}
    over = refine(
        problems.swing_up, **levels, quantities={"tip": problems.tip}, norm=MaximumOverTime()
    )
    assert abs(over.orders["tip"].order - 2) < 0.1


@pytest.mark.slow
def test_space_and_time_apart():
    levels = {"elements": (4, 8, 16, 32), "step": [0.0125, 0.00625, 0.003125, 0.0015625]}
    quantities = {"tip": problems.last_tip}
    apart = refine(problems.swing_up, **levels, quantities=quantities, together=False)
    assert list(apart.orders) == ["tip, elements varied", "tip, step varied"]
    assert len(apart.outcomes) == 7  # the finest level is shared
    for found in apart.orders.values():
        assert abs(found.order - 2) < 0.1


# -- what is held: its error is in the bands, or there are none ------------------------------------


def both_sizes(elements, step, order=2):
    """Errors by the mesh and by the step, which do not know of each other."""
    return 1.0 + 0.3 / elements**order + 0.1 / elements**4 + 5.0 * step**2


@pytest.mark.parametrize(
    ("held", "varied"),
    [("step", {"elements": (4, 8, 16, 32)}), ("elements", {"step": (0.08, 0.04, 0.02, 0.01)})],
)
def test_bands_have_the_error_of_what_is_held(held, varied):
    fixed = {"step": 0.1, "elements": 5}[held]
    study = refine(both_sizes, **varied, **{held: fixed})
    found = study.orders["value"]
    (known,) = study.held["value"]
    assert len(study.outcomes) == 4  # the probe is no level
    assert abs(found.extrapolated - 1) > 100 * (found.uncertainty - known.error)
    assert abs(found.extrapolated - 1) < found.uncertainty < 2 * abs(found.extrapolated - 1)
    error, band = study.estimate["value"]
    truth = abs(study.values["value"][study.series[0].finest] - 1)
    assert abs(truth - error) < band
    assert f"by {held} = {fixed}, held" in str(study)
    assert study.table.notes["held"] == {"value": [known.words]}


def test_what_is_held_and_not_probed_has_no_band():
    study = refine(both_sizes, elements=(4, 8, 16, 32), step=0.1, probe=False)
    assert math.isnan(study.orders["value"].uncertainty)
    error, band = study.estimate["value"]
    assert error > 0 and math.isnan(band)
    assert "step = 0.1 was held, its error is not known: it was not probed" in str(study)
    assert " error " in str(study) and "extrapolated in elements: 1.05" in str(study)
    assert len([line for line in str(study).splitlines() if "+-" in line]) == 1  # of the order


def only_long_steps(elements, step):
    if step < 0.1:
        raise ValueError("too short")
    return both_sizes(elements, step)


def test_probes_that_fail_leave_no_band():
    study = refine(only_long_steps, elements=(4, 8, 16, 32), step=0.1)
    assert not study.failed
    (held,) = study.held["value"]
    assert "elements = 32, step = 0.05 failed: too short" in held.words
    assert math.isnan(study.estimate["value"][1])


def test_true_values_need_no_probe():
    study = refine(both_sizes, elements=(4, 8, 16, 32), step=0.1, reference=1.05)
    assert len(study.outcomes) == 4 and not study.held["value"]


def test_series_tell_each_other_what_they_hold():
    levels = {"elements": (4, 8, 16, 32), "step": (0.08, 0.04, 0.02, 0.01)}
    study = refine(both_sizes, **levels, together=False)
    assert len(study.outcomes) == 7
    for name, found in study.orders.items():
        assert abs(found.extrapolated - 1) < found.uncertainty < 1e-2, name


@pytest.mark.slow
@pytest.mark.parametrize("order", [1, 2])
def test_bands_hold_where_orders_agree_by_chance(order):
    """Errors h^p + c h^(p+1) + d h^(p+2): two pairs may show the same order beside a whole one."""
    random, inside = np.random.default_rng(8), []
    for _ in range(1000):
        x, (c, d) = HALVED[:4], random.uniform(-4, 4, 2)
        found = convergence(x, [np.array(1 + h**order * (1 + c * h + d * h**2)) for h in x])
        if found.extrapolated is not None:
            inside.append(abs(float(found.extrapolated) - 1) <= 2 * found.uncertainty)
    assert len(inside) > 25 and np.mean(inside) > 0.95


@pytest.mark.slow
def test_bands_of_random_runs_hold():
    """Runs and equilibria with mesh or step held: 86 of 87 bands did in 75 studies."""
    covered, count = problems.covered(6)
    assert count >= 4
    assert covered >= count - 1


# -- no order where there is none ------------------------------------------------------------------


# its coarse levels are bent farther than their elements can be
@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")
@pytest.mark.parametrize(
    "levels",
    [
        {"elements": (4, 8, 16, 32), "order": 1, "step": 1 / 40},
        {"elements": (4, 8, 16, 32), "order": 3, "step": (1 / 10, 1 / 20, 1 / 40, 1 / 80)},
    ],
)
def test_step_loads_are_not_in_the_asymptotic_range(levels):
    """D4, the flying spaghetti in a plane, whose loads are there at once."""
    study = refine(problems.spaghetti, **levels)
    assert study.verdicts["value"].startswith("not in the asymptotic range: pairwise orders ")
    assert study.extrapolated["value"] is None
    assert math.isnan(study.orders["value"].order)
    assert math.isnan(study.estimate["value"][1])  # differences: a hint, and shown as such
    found = study.orders["value"]
    assert np.isnan(found.errors[-1]) and np.isfinite(found.errors[:-1]).all()
    assert study.estimate["value"][0] == found.differences[-2]
    assert ("see together=False" in study.verdicts["value"]) == isinstance(levels["step"], tuple)


@pytest.mark.parametrize("reference", [None, 1 - 1 / math.pi])
def test_a_jump_is_not_in_the_asymptotic_range(reference):
    study = refine(problems.kinked, elements=(5, 10, 20, 40, 80, 160), reference=reference)
    assert study.verdicts["value"].startswith("not in the asymptotic range")


def judged(errors, **options):
    values = [np.array(1.0 + error) for error in errors]
    return convergence(HALVED[: len(values)], values, **options)


@pytest.mark.slow
def test_wandering_sequences_are_seldom_believed():
    """Orders between 0 and 3 by chance, errors of either sign: less than one in a hundred."""
    random = np.random.default_rng(6)
    truth = np.array(1.0)
    for count in (4, 5):
        believed = 0
        for _ in range(300):
            falls = np.cumsum(random.uniform(0, 3, count - 1))
            errors = 0.1 * 2.0 ** -np.concatenate([[0.0], falls])
            errors *= random.choice([-1, 1], count)
            believed += judged(errors, reference=truth).asymptotic
            believed += judged(errors).asymptotic
        assert believed <= 6
    noise = [judged(random.normal(size=5) * 1e-3, reference=truth) for _ in range(300)]
    assert sum(each.asymptotic for each in noise) <= 3


@pytest.mark.slow
def test_orders_with_terms_of_higher_order():
    """Where there is a verdict it is right: the order nearly always within its spread."""
    random = np.random.default_rng(7)
    inside = trusted = near = 0
    for _ in range(300):
        p, x = random.choice([1, 2, 4]), HALVED[:5]
        errors = 0.1 * x**p * (1 + random.uniform(-0.5, 0.5) * x + random.uniform(-0.2, 0.2) * x**2)
        found = judged(errors, reference=np.array(1.0))
        assert found.asymptotic
        assert abs(found.order - p) < 0.1
        inside += abs(found.order - p) <= found.spread
        alone = judged(errors)
        trusted += alone.asymptotic
        near += alone.asymptotic and abs(alone.extrapolated - 1) <= alone.uncertainty
    assert inside >= 0.93 * 300
    assert trusted >= 0.6 * 300
    assert near >= 0.95 * trusted


@pytest.mark.parametrize(
    ("errors", "words"),
    [
        ([1e-2, 1e-8, 1e-16, 1e-16], "at rounding: no order (2 of 4 errors above 100 x rounding)"),
        ([1e-2, 2.5e-3, 6.25e-4], "fewer than four levels: pairwise orders 2.00, 2.00"),
        ([1e-2, 1e-2, 1e-2, 1e-2], "not in the asymptotic range: pairwise orders 0.00, 0.00, 0.00"),
        ([1e-2, 1.2e-2, 8e-3, 9e-3], "not in the asymptotic range: pairwise orders -0.26, 0.58"),
        ([1e-2, -2.5e-3, 6.25e-4, -1.6e-4], "the sign of the error changes"),
    ],
)
def test_verdicts_without_order(errors, words):
    found = judged(errors, reference=np.array(1.0))
    assert words in found.verdict
    assert not found.asymptotic
    assert math.isnan(found.order)


@pytest.mark.parametrize("count", [2, 5])
def test_what_no_level_changes(count):
    found = judged([0.1] * count)
    assert found.verdict == "no order: all levels are identical, nothing depends on their size"
    assert math.isnan(found.order) and not found.asymptotic


def test_rounding_is_seen_or_declared():
    """Noise of 1e-10 that stops the fall; declared noise takes levels away before it shows."""
    noise = 1e-10 * np.array([0.3, -0.8, 0.5, 0.9, -0.7, 1.0, -0.9, 0.95])
    found = judged(1e-1 * HALVED**6 + noise, reference=np.array(1.0))
    assert found.rounding > 5e-11
    assert "above 100 x rounding" in found.verdict
    assert abs(found.extrapolated - 1) <= found.uncertainty
    assert "at rounding" in judged(1e-2 * HALVED**2, rounding=1e-5).verdict
    noisy = np.array([1e-2, 1e-4, 1e-6, 1e-8, 1.2e-11])
    expected = "(down to 1.2e-11 of the value: if that is rounding, declare it)"
    assert expected in judged(noisy, reference=np.array(1.0)).verdict


def test_a_wrong_reference_is_told():
    found = judged(1e-2 * HALVED[:6] ** 2, reference=np.array(1.0 + 1e-4))
    assert not found.asymptotic
    expected = "the levels converge (order 2.00) to a value 0.0001 from the reference"
    assert found.verdict.endswith(expected)


def test_finest_level_as_reference_allows_for_its_own_error():
    study = refine(
        problems.trapezoid, elements=(4, 8, 16, 32, 64), reference=ReferenceFinest()
    ).orders["value"]
    assert abs(study.order - 2) < 0.01
    naive = np.log2(study.errors[2] / study.errors[3])
    assert abs(naive - 2) > 0.3
    truth = abs(problems.trapezoid(64) - (math.e - 1))
    assert study.uncertainties[0] == pytest.approx(truth, rel=1e-3)


def test_uneven_levels():
    sizes = np.array([1, 0.7, 0.4, 0.25, 0.2])
    for finest in (False, True):
        values = [np.array([1.0, 2.0]) + x**3 for x in sizes]
        found = convergence(sizes, values, finest=finest)
        assert abs(found.order - 3) < 1e-6
        np.testing.assert_allclose(found.extrapolated, [1, 2], atol=1e-9)


def test_differences_that_turn_take_five_levels():
    """Norms fall as h^2, but each time in another direction: no extrapolation."""
    angles = np.arange(6) * 1.5
    values = [x**2 * np.array([np.cos(a), np.sin(a)]) for x, a in zip(HALVED, angles, strict=False)]
    four = convergence(HALVED[:4], values[:4])
    assert "do not point the same way, which takes five levels" in four.verdict
    five = convergence(HALVED[:5], values[:5])
    assert abs(five.order - 2) < 1e-6
    assert five.extrapolated is None


def test_no_order_is_told_below_the_error_of_known_values():
    """True to 2e-3 only: differences of 1e-3 to it are no errors of the levels."""
    off = ReferenceKnown(math.e - 1 + 1e-3, errors=2e-3)
    found = refine(problems.trapezoid, elements=(4, 8, 16, 32, 64), reference=off)
    assert np.isnan(found.orders["value"].order) and "at rounding" in found.orders["value"].verdict


# -- failures, interruption, processes -------------------------------------------------------------


def test_a_level_that_fails_is_kept_with_its_reason(tmp_path):
    study = refine(problems.fails_at_16, elements=(4, 8, 16, 32, 64))
    assert abs(study.orders["value"].order - 2) < 0.02
    assert "three finest of four levels" in study.verdicts["value"]
    row = study.rows[2]
    assert row["status"] == "diverged"
    assert "no solution" in row["reason"]
    assert math.isnan(row["error_value"])
    assert list(study.failed) == ["elements = 16"]
    assert "5 levels, 1 failed" in str(study)
    lines = study.csv(tmp_path / "study.csv").read_text().splitlines()
    notes = {line[2:].partition(": ")[0] for line in lines if line.startswith("# ")}
    assert {"refinement", "verdicts", "versions", "machine", "commit"} <= notes
    table = list(csv.DictReader(line for line in lines if not line.startswith("# ")))
    assert [line["status"] for line in table] == ["ok", "ok", "diverged", "ok", "ok"]
    assert float(table[4]["error_value"]) == study.orders["value"].errors[4]


def test_a_table_of_results_as_text_and_for_pandas(monkeypatch):
    """Rows need not have the same names; pandas is asked for only here."""
    table = ResultTable([{"a|b": 1 / 3}, {"why": "two\nlines"}], {"problem": "bend"})
    head, _, first, second = table.to_markdown().splitlines()
    assert head == r"| a\|b | why |"
    assert first == "| 0.333333 |  |"
    assert second == "|  | two lines |"
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(ImportError, match="pandas is needed here"):
        table.to_pandas()


def test_values_that_are_not_finite_fail_their_level():
    study = refine(lambda elements: np.nan if elements == 8 else 1 / elements, elements=(4, 8))
    assert study.failed["elements = 8"].endswith("quantity 'value' is not finite")


def test_all_levels_may_fail():
    study = refine(lambda elements: 1 / 0, elements=(4, 8))
    assert study.orders == {} and {row["status"] for row in study.rows} == {"error"}
    assert "elements = 4: error: ZeroDivisionError" in str(study)
    with pytest.raises(InputError, match="no level was solved; elements = 4: error: "):
        study.chart()


def calls(folder):
    path = folder / "calls"
    return [int(line) for line in path.read_text().split()] if path.exists() else []


def test_killed_and_resumed(tmp_path):
    """Only what is missing is computed; more levels and other quantities cost what is new."""
    log = tmp_path / "log"
    log.mkdir()
    problem = partial(problems.noted, log=log, fatal=(16,))
    options = {"elements": (4, 8, 16, 32), "folder": tmp_path / "study"}
    with pytest.raises(KeyboardInterrupt):
        refine(problem, **options)
    assert calls(log) == [4, 8, 16]
    (log / "on").touch()
    study = refine(problem, **options)
    assert calls(log) == [4, 8, 16, 16, 32]
    again = refine(problem, **options, quantities={"double": lambda value: 2 * value})
    assert calls(log) == [4, 8, 16, 16, 32]
    double = again.values["double"]["elements = 8"]
    assert double == 2 * study.values["value"]["elements = 8"]
    more = refine(problem, **options | {"elements": (4, 8, 16, 32, 64)})
    assert calls(log) == [4, 8, 16, 16, 32, 64]
    assert more.verdicts["value"].endswith("(three finest of five levels)")
    direct = refine(problems.trapezoid, elements=(4, 8, 16, 32, 64))
    np.testing.assert_array_equal(more.orders["value"].errors, direct.orders["value"].errors)


def test_ctrl_c_ends_a_study_in_good_order(tmp_path):
    """The level at work is finished, the others are rows without a result, and run later."""
    problem = partial(problems.stopped, log=tmp_path)
    options = {"elements": (4, 8, 16, 32), "folder": tmp_path / "study"}
    study = refine(problem, **options)
    assert [row["status"] for row in study.rows] == ["ok", "ok", "not run", "not run"]
    assert "fewer than four levels" in study.verdicts["value"]
    (tmp_path / "on").touch()
    assert refine(problem, **options).orders["value"].asymptotic
    assert calls(tmp_path) == [4, 8, 16, 32]


@pytest.mark.slow
def test_two_processes_give_the_same(tmp_path):
    levels = {"elements": (4, 8, 16, 32)}
    alone = refine(problems.trapezoid, **levels).orders["value"]
    with sc.Processes(2) as executor:
        study = refine(problems.trapezoid, **levels, executor=executor, folder=tmp_path)
        with pytest.raises(InputError, match="cannot be sent"):
            refine(lambda elements: 1.0, **levels, executor=executor)
    there = study.orders["value"]
    assert there.errors.tolist() == alone.errors.tolist() and there.verdict == alone.verdict
    assert len(list(tmp_path.glob("*.case"))) == 4


def test_meshes_and_progress():
    seen = []
    meshes = [sc.MeshCurve.init_line((0, 0, 0), (2, 0, 0), n, name="rod") for n in (2, 4, 8, 16)]

    def problem(mesh):
        return problems.trapezoid(mesh.nelements)

    study = refine(problem, mesh=meshes, progress=lambda *what: seen.append(what[:2]))
    assert seen == [(1, 4), (2, 4), (3, 4), (4, 4)]
    assert [row["size"] for row in study.rows] == pytest.approx([1, 0.5, 0.25, 0.125])
    assert study.rows[0]["mesh"] == "2 elements up to 1"
    assert abs(study.orders["value"].order - 2) < 0.02


# -- charts and files ------------------------------------------------------------------------------


@pytest.mark.slow
def test_chart(tmp_path):
    pytest.importorskip("matplotlib")
    study = refine(problems.fails_at_16, elements=(4, 8, 16, 32, 64))
    figure = study.chart(tmp_path / "study.png", units={"value": "m"}, title="a bend")
    axis = figure.axes[0]
    assert axis.get_ylabel() == "error of value in m" and figure.get_suptitle() == "a bend"
    assert (tmp_path / "study.png").read_bytes()[:4] == b"\x89PNG"
    errors, crosses, _ = axis.get_lines()
    np.testing.assert_array_equal(errors.get_ydata(), study.orders["value"].errors[[0, 1, 3, 4]])
    assert errors.get_label() == "order 2.00 +- 0.01"
    assert crosses.get_xdata().tolist() == [1 / 16]
    wandering = refine(problems.kinked, elements=(5, 10, 20, 40, 80, 160)).chart().axes[0]
    (line,) = wandering.get_lines()
    assert line.get_label().startswith("not in the asymptotic range")
    assert len(line.get_xdata()) == 5  # the finest has no error: nothing is drawn twice


# -- bad input -------------------------------------------------------------------------------------

FOUR = (4, 8, 16, 32)


@pytest.mark.one_quick
@pytest.mark.parametrize(
    ("problem", "options", "words"),
    [
        (problems.trapezoid, {}, "got no sequence, expected at least two levels"),
        (problems.trapezoid, {"elements": (4, 8, 8)}, r"\(4, 8, 8\), expected growing numbers"),
        (problems.trapezoid, {"elements": (-4, 8)}, "elements: -4, expected an integer from 1"),
        (problems.fourth, {"step": (0.1, 0.2)}, "argument step: .*expected falling numbers"),
        (problems.bend, {"elements": FOUR, "order": (2, 1)}, "argument order: .*growing"),
        (problems.trapezoid, {"mesh": (4, 8)}, "argument mesh: 4, expected an object of type Mesh"),
        (problems.trapezoid, {"mesh": 4, "elements": 4}, "got both, expected one"),
        (problems.swing_up, {"elements": FOUR, "step": (0.1, 0.05)}, "got 4 and 2 levels"),
        (problems.trapezoid, {"step": (0.1, 0.05)}, r"takes \(elements\), but .* with step"),
        (problems.bend, {"elements": {1: FOUR}, "order": 1}, "elements says the orders already"),
        (3, {"elements": FOUR}, "argument problem: 3 cannot be called"),
        (problems.trapezoid, {"elements": FOUR, "reference": "x"}, "reference: 'x', expected"),
        (problems.trapezoid, {"elements": FOUR, "reference": PAIR}, "expected finite numbers"),
        (problems.trapezoid, {"elements": FOUR, "rounding": -1.0}, "argument rounding: value"),
        (problems.trapezoid, {"elements": FOUR, "quantities": 3}, "quantities: 3, expected names"),
        (problems.trapezoid, {"elements": FOUR, "norm": "max"}, "argument norm: 'max', expected"),
        (problems.trapezoid, {"elements": FOUR, "norm": MaximumOverTime()}, "without times at"),
        (problems.fourth, {"step": (0.1, 0.05)}, r"quantity 'x': shape \(21, 2\) at step = 0.1, "),
        (
            problems.fourth,
            {"step": (0.1, 0.05), "norm": AtInstants([0.05])},
            r"AtInstants: times = \[0.05\], not all of which all levels have recorded",
        ),
        (problems.swing_up, {"elements": 2, "step": (0.1, 0.05)}, "gives a History: say what"),
        (
            problems.trapezoid,
            {"elements": FOUR, "reference": ReferenceRun(order=4)},
            r"takes \(elements\), but the study calls it with elements, order",
        ),
        (
            problems.fails_at_16,
            {"elements": (4, 8), "reference": ReferenceRun(elements=16)},
            "argument reference: its run failed: step 7",
        ),
    ],
)
def test_bad_input(problem, options, words):
    with pytest.raises(InputError, match=words):
        refine(problem, **options)


def test_unknown_quantities_end_the_study_at_once():
    seen = []

    def problem(elements):
        seen.append(elements)
        return {"a": 1.0}

    with pytest.raises(InputError, match="quantity 'b': unknown; known: 'a'"):
        refine(problem, elements=FOUR, quantities=["b"])
    assert seen == [4]
    with pytest.raises(InputError, match="reference of 'b': unknown; known: 'a'"):
        refine(problem, elements=FOUR, quantities=["a"], reference={"b": 1.0})
    assert seen == [4]


@pytest.mark.parametrize("times", [[], [0.2, 0.1], "x"])
def test_bad_instants(times):
    with pytest.raises(InputError, match="AtInstants"):
        AtInstants(times)


def test_histories_become_paraview_series(tmp_path):
    levels = {"elements": (2, 4), "step": (0.05, 0.025)}
    quantities = {"tip": problems.last_tip}
    study = refine(problems.swing_up, **levels, quantities=quantities, folder=tmp_path / "kept")
    written = study.paraview(tmp_path / "series")
    assert list(written) == ["elements = 2, step = 0.05", "elements = 4, step = 0.025"]
    index = tmp_path / "series" / "elements_4_step_0.025" / "beams.pvd"
    assert index in written["elements = 4, step = 0.025"]
    assert index.read_text().count("<DataSet") == 7
    with pytest.raises(InputError, match=r"its result is a float, ParaView series need a History"):
        refine(problems.trapezoid, elements=(2, 4)).paraview(tmp_path)
