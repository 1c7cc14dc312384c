"""The paper's tables and figures: numbers, report and provenance; relative coordinates."""

import importlib
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest

import skfem_cosserat as sc

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
sys.path.insert(0, str(EXAMPLES))

pytest.importorskip("matplotlib")

relative = importlib.import_module("paper.relative_coordinates")
convergence = importlib.import_module("paper.convergence")
figures = importlib.import_module("paper.figures")
record = importlib.import_module("benchmarks.record")
report = importlib.import_module("paper.report")
paper = importlib.import_module("reproduce_paper")
swing = importlib.import_module("paper.three_bar_swing")
linkage = importlib.import_module("paper.six_body_linkage")

EM, VI, LM, NS = "energy-momentum", "variational", "multipliers", "null-space"
#: condition numbers as the paper prints them, steps 1e-2, 1e-3, 1e-4
TABLE_1 = {(EM, LM): "1e5 1e8 1e11", (EM, NS): "1 1 1", (VI, LM): "5e4 3e7 3e10", (VI, NS): "1 1 1"}
TABLE_2 = {
    (EM, LM): "2e12 2e14 2e17",
    (EM, NS): "4e4 9e4 2e5",
    (VI, LM): "6e11 5e13 5e16",
    (VI, NS): "5e4 9e4 2e5",
}
COSTS = {"table_1": (2, 2, 1, 1), "table_2": (1.5, 1.2, 1.4, 1)}
UNKNOWNS = {"table_1": (143, 1, 143, 1), "table_2": (430, 122, 430, 122)}
#: other numbers of section 6.2 as printed
PRINTED = {0.01, 0.02, 0.36, 5, 20, 175480.7692, 547500, 114.0625, 10.2656, 13.7401, 7500, 1.5625}
PRINTED |= {0.1406, 10000, 0.125, 0.25, 73e9, 0.3, 2700, 5e-3, 1e-3}


# ---- the linkage in relative coordinates ----------------------------------------------------


@pytest.mark.slow
def test_relative_coordinates_have_order_two_and_meet_the_reference():
    steps, until = (1e-2, 5e-3), 2.0
    runs = {h: relative.main(h, until) for h in steps}
    times = [t for t in relative.REFERENCE if t <= until]
    exact = np.array([relative.REFERENCE[t] for t in times])
    coarse, fine = (runs[h]["P3"][[round(t / h) for t in times]] for h in steps)
    order = np.log2(abs(coarse - exact).max() / abs(fine - exact).max())
    assert abs(order - 2) < 0.01
    assert abs((4 * fine - coarse) / 3 - exact).max() < 1e-7
    ranges = [np.ptp(runs[h]["energy_midpoint"]) for h in steps]
    assert np.log2(ranges[0] / ranges[1]) == pytest.approx(2, abs=0.02)


@pytest.mark.slow
def test_closure_holds_in_all_rows_although_four_are_enforced():
    result = relative.main(1e-2, 3.0)
    assert result["unknowns"] == 9 and result["coordinates"] == 5 and result["rank"] == 4
    assert result["closure"].max() < 1e-13
    assert result["joint_angles"].shape == (301, 6)
    # neighbours obey the closed form, the sixth angle (at the cut) included
    x = result["joint_angles"] - np.pi / 2
    assert abs(linkage.relation(np.pi / 2, x, np.roll(x, -1, axis=1))).max() < 1e-12


@pytest.mark.slow
def test_relative_coordinates_and_the_package_agree():
    """Two discretisations of one linkage: they differ by O(h^2)."""
    apart = [
        abs(relative.main(h, 1.0)["P3"] - linkage.main(VI, NS, h, 1.0)["P3"]).max()
        for h in (2e-2, 1e-2)
    ]
    assert apart[1] < 2e-3
    assert np.log2(apart[0] / apart[1]) == pytest.approx(2, abs=0.1)


def test_bad_arguments():
    with pytest.raises(ValueError, match=r"step = nan"):
        relative.main(step=float("nan"))
    with pytest.raises(ValueError, match=r"until = -1\.0"):
        relative.main(until=-1.0)
    with pytest.raises(ValueError, match=r"steps = \(0,\)"):
        relative.condition_number(1e-2, steps=(0,))


@pytest.fixture(scope="module")
def quick(tmp_path_factory):
    """What ``--quick`` finds and writes, with a shorter study of convergence."""
    folder = tmp_path_factory.mktemp("paper")
    with pytest.MonkeyPatch.context() as patch, warnings.catch_warnings():
        warnings.simplefilter("ignore", sc.AccuracyWarning)  # what fails is warned of
        patch.setattr(report, "ORDER_STEPS", (1e-3, 5e-4))
        patch.setattr(convergence, "STEPS", (1e-3, 5e-4))
        patch.setattr(convergence, "REFERENCE_STEPS", {True: 2.5e-4})
        patch.setattr(convergence, "LONG_STEPS", {True: (1e-3, 5e-4)})
        patch.setattr(convergence, "HORIZONS", {True: (0.05,)})
        return folder, paper.main(folder, quick=True)


# ---- figures --------------------------------------------------------------------------------


@pytest.mark.slow
def test_cross_convergence_at_equal_instants_is_of_second_order():
    steps = (5e-4, 2.5e-4)
    variational = convergence.trajectories(VI, NS, steps, 0.05)
    for treatment in (NS, LM):
        found = convergence.compare(
            variational, convergence.trajectories(EM, treatment, steps, 0.05)
        )
        orders = found["orders"][convergence.SAME_END][steps]
        for name in ("q", "v", "p", "Qp", "internal multipliers", "external multipliers"):
            assert abs(orders[name] - 2) < 0.1, name
        # node against the midpoint after it: first order, and a much larger difference
        assert abs(orders[convergence.SHIFTED] - 1) < 0.1
        errors = found["errors"][convergence.SAME_END][2.5e-4]
        assert errors[convergence.SHIFTED] > 1e3 * errors["external multipliers"]


def test_steps_that_miss_the_instants_are_refused():
    with pytest.raises(ValueError, match=r"step = 0\.0003"):
        convergence.trajectory(swing.build(), VI, NS, 3e-4, 0.1)


# ---- everything -----------------------------------------------------------------------------


def _published(folder, section):
    """Column ``published`` of a section by quantity."""
    _, header, rows = record.read_csv(folder / f"{section}.csv")
    assert header == ["quantity", "published", "computed", "run", "remark"]
    return {row[0]: row[1] for row in rows}


def _lines(folder):
    text = (folder / "report.md").read_text(encoding="utf-8")
    return [line.split(" | ") for line in text.splitlines() if line.startswith("| ")]


@pytest.mark.slow
def test_every_published_number_is_in_the_report(quick):
    folder, _ = quick
    lines = {line[0].removeprefix("| ") + line[1] for line in _lines(folder)}
    for section, printed in (("table_1", TABLE_1), ("table_2", TABLE_2)):
        published = _published(folder, section)
        for k, (pair, values) in enumerate(printed.items()):
            name = ", ".join(pair)
            for h, said in zip((0.01, 0.001, 0.0001), values.split(), strict=True):
                assert published[f"condition number, {name}, h = {h:g} s"] == said
            assert published[f"unknowns, {name}"] == str(UNKNOWNS[section][k])
            for solver in ("dense", "own choice", "sparse"):
                cost = published[f"CPU ratio, {solver}, {name}, h = 0.01 s"]
                assert float(cost) == COSTS[section][k]
        assert all(quantity + said in lines for quantity, said in published.items())
    scene = _published(folder, "scene")
    assert scene.pop("height of the right link").startswith("0.36 √2")
    assert {float(said) for said in scene.values()} == PRINTED
    motion = _published(folder, "motion")
    assert motion["figure 21: weighted norm of force and moment in N"] == "0 to 4000"
    assert {motion[name] for name in motion if name.startswith("event X")} == {"1.4"}


@pytest.mark.slow
def test_scene_is_computed_with_the_published_data(quick):
    _, rows = record.read_csv(quick[0] / "scene.csv")[1:]
    for quantity, published, computed, *_ in rows:
        value = float(published.rpartition(" ")[2])
        assert float(computed) == pytest.approx(value, rel=1e-9), quantity


@pytest.mark.slow
def test_files_and_their_provenance(quick):
    """Tables name the versions, the machine, the commit and the run; so does the report."""
    folder, result = quick
    figures_made = [f"figure_{k}" for k in range(19, 26)]
    tables_made = ["table_1", "table_2", "scene", "motion", "convergence"]
    expected = {f"{n}.png" for n in figures_made} | {"report.md"}
    expected |= {f"{n}.csv" for n in figures_made + tables_made}
    assert {path.name for path in folder.iterdir()} == expected
    assert {path.name for path in result["paths"]} == expected
    for path in folder.glob("*.csv"):
        notes, header, rows = record.read_csv(path)
        assert {"versions", "machine", "commit", "run"} <= set(notes)
        assert rows and all(len(row) == len(header) for row in rows)
    text = (folder / "report.md").read_text(encoding="utf-8")
    for run in result["runs"]:
        assert f"{run['title']} | {run['date']} | {run['seconds']:.1f}" in text


@pytest.mark.slow
def test_what_the_figures_show(quick):
    data = quick[1]["figures"]
    assert all(value < 1e-9 for value in data["momentum"].values())
    assert data["treatments apart"] < 1e-9
    for step in (1e-2, 1e-3):
        assert data["energy"][EM, step]["(q_n, p_n)"]["range"] < 1e-10
        assert 1.44 < data["runs"][VI, step]["event_x"] < 1.5
    for term in figures.TERMS:  # the oscillation falls with the square of the step
        ratio = data["energy"][VI, 1e-2][term]["range"] / data["energy"][VI, 1e-3][term]["range"]
        assert 60 < ratio < 160
    stiff = data["stiff"]
    assert stiff[VI, 1e-2]["event_x"] is None and stiff[VI, 1e-2]["diverged_at"] < 0.66
    assert stiff[EM, 1e-2]["event_x"] == pytest.approx(0.66, abs=0.01)
