"""The paper's tables and figures: numbers, report and provenance; relative coordinates."""

import importlib
import re
import sys
from pathlib import Path

import numpy as np
import pytest

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
sys.path.insert(0, str(EXAMPLES))

pytest.importorskip("matplotlib")

relative = importlib.import_module("paper.relative_coordinates")
tables = importlib.import_module("paper.tables")
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


def test_slopes_of_the_lagrangian_against_its_definition():
    """Complex steps through ``T - V`` summed body by body, at a random state."""
    random = np.random.default_rng(5)
    angles, rates = random.normal(size=(2, 5))

    def lagrangian(a, w):
        R, axes, points = relative.chain(a)
        total = 0.0
        for i in range(5):
            centre = (points[i] + points[i + 1]) / 2
            v = sum(np.cross(axes[k] * w[k], centre - points[k]) for k in range(i + 1))
            omega = sum(axes[k] * w[k] for k in range(i + 1))
            edge = relative.POINTS[i + 1] - relative.POINTS[i]
            across, axial = 1.01 / 12, 0.02 / 12  # rods of 1 m x 0.1 m x 0.1 m, 1 kg
            J = R[i] @ (across * np.eye(3) + (axial - across) * np.outer(edge, edge)) @ R[i].T
            total = total + v @ v / 2 + omega @ J @ omega / 2 - 9.81 * centre[1]
        return total

    e = 1e-30
    slope, momentum = relative.lagrangian_slopes(angles, rates)
    for k, row in enumerate(1j * e * np.eye(5)):
        assert slope[k] == pytest.approx(lagrangian(angles + row, rates).imag / e, rel=1e-12)
        assert momentum[k] == pytest.approx(lagrangian(angles, rates + row).imag / e, rel=1e-12)
        jacobian = relative.closure_jacobian(angles)[:, k]
        assert abs(jacobian - relative.closure(angles + row).imag / e).max() < 1e-14


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
def test_relative_coordinates_meet_the_reference_to_seven_digits():
    steps = (5e-3, 2.5e-3)
    runs = {h: relative.main(h, 10.0)["P3"] for h in steps}
    coarse, fine = (runs[h][[round(t / h) for t in relative.REFERENCE]] for h in steps)
    exact = np.array(list(relative.REFERENCE.values()))
    assert abs((4 * fine - coarse) / 3 - exact).max() < 1e-7


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


@pytest.mark.slow
def test_matrix_in_relative_coordinates_grows_unless_scaled():
    plain, scaled = (
        [relative.condition_number(h, flag, steps=(1, 10, 20)) for h in (1e-2, 1e-3, 1e-4)]
        for flag in (False, True)
    )
    assert np.allclose(np.diff(np.log10(plain)), 3, atol=0.1)
    assert max(scaled) < 20


@pytest.mark.parametrize(
    ("call", "name"),
    [
        (lambda: relative.main(step=0.0), "step = 0.0"),
        (lambda: relative.main(step=float("nan")), "step = nan"),
        (lambda: relative.main(until=-1.0), "until = -1.0"),
        (lambda: relative.condition_number(1e-2, steps=(0,)), r"steps = \(0,\)"),
    ],
)
def test_bad_arguments(call, name):
    with pytest.raises(ValueError, match=name):
        call()


# ---- tables ---------------------------------------------------------------------------------


def _check_table_2(steps):
    computed = tables.condition_numbers(swing, steps)
    for pair, printed in TABLE_2.items():
        factor = 1.6 if pair[1] == LM else 1.3
        for h, said in zip((1e-2, 1e-3, 1e-4), printed.split(), strict=True):
            if h in steps:
                assert float(said) / factor < computed[pair][h]["unscaled"] < float(said) * factor
    return computed


@pytest.mark.slow
def test_table_2_at_the_coarse_step():
    _check_table_2((1e-2,))


@pytest.mark.slow
def test_table_2():
    computed = _check_table_2((1e-2, 1e-3, 1e-4))
    for integrator in (EM, VI):  # 1e5 without scaling, at most
        for h in (1e-2, 1e-3, 1e-4):
            reduced = computed[integrator, NS][h]["unscaled"]
            assert computed[integrator, LM][h]["scaled"] < 5 * reduced


@pytest.mark.slow
def test_table_1_grows_with_the_third_power_and_the_null_space_has_one_unknown():
    computed = {
        (i, t, scaled): [
            linkage.condition_number(i, t, h, scaled, steps=(1, 10)) for h in (1e-2, 1e-3, 1e-4)
        ]
        for i, t, scaled in ((VI, LM, False), (EM, LM, False), (VI, LM, True), (VI, NS, False))
    }
    for integrator in (VI, EM):
        slopes = np.diff(np.log10(computed[integrator, LM, False]))
        assert np.allclose(slopes, 3, atol=0.1)
    assert np.ptp(computed[VI, LM, True]) < 0.02 * computed[VI, LM, True][0]
    assert computed[VI, NS, False] == [1.0, 1.0, 1.0]


@pytest.mark.slow
def test_costs_are_ratios_to_one_of_the_variants():
    """Numbers only: timings are never asserted."""
    for solver in ("dense", "own choice", "sparse"):
        cost = tables.costs(swing.build(), 1e-2, 2, 2, solver)
        assert cost[VI, NS]["ratio"] == cost[VI, NS]["low"] == cost[VI, NS]["high"] == 1
        assert all(c["low"] <= c["ratio"] <= c["high"] for c in cost.values())


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


def test_the_measure_of_the_snapshots():
    resultant = np.zeros((1, 3, 6))
    resultant[0, 0] = (3, 0, 4, 0, 0, 0)
    resultant[0, 1] = (0, 0, 0, 1, 2, 2)
    values = figures.load_measure(resultant)
    assert values.tolist() == [[5.0, 300.0, 0.0]]
    assert figures.nodal(values).tolist() == [[5.0, 152.5, 150.0, 0.0]]


# ---- everything -----------------------------------------------------------------------------


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """The whole program with coarser steps, fewer samples and shorter runs."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(swing, "CONDITION_STEPS", ((1, 10), (1, 10)))
        patch.setattr(linkage, "CONDITION_STEPS", (1, 5))
        patch.setattr(relative, "CONDITION_STEPS", (1, 5))
        patch.setattr(tables, "TIMED_STEPS", 2)
        patch.setattr(tables, "ROUNDS", {True: 2})
        patch.setattr(figures, "STEPS", (2e-2, 1e-2))
        patch.setattr(figures, "STIFF_STEPS", {True: (1e-2,)})
        patch.setattr(figures, "STIFF_UNTIL", 0.1)
        patch.setattr(report, "ORDER_STEPS", (1e-3, 5e-4))
        patch.setattr(convergence, "STEPS", (1e-3, 5e-4))
        patch.setattr(convergence, "REFERENCE_STEPS", {True: 2.5e-4})
        patch.setattr(convergence, "LONG_STEPS", {True: (1e-3, 5e-4)})
        patch.setattr(convergence, "HORIZONS", {True: (0.05,)})
        folder = tmp_path_factory.mktemp("paper")
        return folder, paper.main(folder, quick=True)  # other tests take the steps as they are


def _published(folder, section):
    """Column ``published`` of a section by quantity."""
    _, header, rows = record.read_csv(folder / f"{section}.csv")
    assert header == ["quantity", "published", "computed", "run", "remark"]
    return {row[0]: row[1] for row in rows}


def _lines(folder):
    text = (folder / "report.md").read_text(encoding="utf-8")
    return [line.split(" | ") for line in text.splitlines() if line.startswith("| ")]


@pytest.mark.slow
def test_every_published_number_is_in_the_report(small):
    folder, _ = small
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
    assert _published(folder, "table_1")["independent constraints"] == "71"
    assert _published(folder, "table_1")["n"] == "72"
    table = _published(folder, "table_2")
    assert (table["n"], table["m"]) == ("276", "154")
    scene = _published(folder, "scene")
    assert scene.pop("height of the right link").startswith("0.36 √2")
    assert {float(said) for said in scene.values()} == PRINTED
    motion = _published(folder, "motion")
    assert motion["figure 21: weighted norm of force and moment in N"] == "0 to 4000"
    assert {motion[name] for name in motion if name.startswith("event X")} == {"1.4"}


@pytest.mark.slow
def test_scene_is_computed_with_the_published_data(small):
    _, rows = record.read_csv(small[0] / "scene.csv")[1:]
    for quantity, published, computed, *_ in rows:
        value = float(published.rpartition(" ")[2])
        assert float(computed) == pytest.approx(value, rel=1e-9), quantity


@pytest.mark.slow
def test_every_computed_number_names_its_run(small):
    folder, result = small
    text = (folder / "report.md").read_text(encoding="utf-8")
    runs = result["runs"]
    assert len(runs) == 4 and all(run["seconds"] > 0 for run in runs)
    for run in runs:
        assert re.fullmatch(r"\d{4}-\d\d-\d\d \d\d:\d\d:\d\d UTC", run["date"])
        assert f"{run['title']} | {run['date']} | {run['seconds']:.1f}" in text
    for name, version in result["provenance"]["versions"].items():
        assert text.count(f"{name} {version}") == len(runs)
    lines = [line for line in _lines(folder) if len(line) == 5 and line[3].isdigit()]
    assert len(lines) > 150
    assert {line[3] for line in lines} == {"1", "2", "3", "4"}
    assert all(line[2] not in ("", "nan") for line in lines)


@pytest.mark.slow
def test_files_and_their_provenance(small):
    image = pytest.importorskip("matplotlib.image")
    folder, result = small
    names = [f"figure_{k}" for k in range(19, 26)]
    tables_made = ["table_1", "table_2", "scene", "motion", "convergence"]
    expected = {f"{n}.png" for n in names} | {f"{n}.csv" for n in names + tables_made}
    assert {path.name for path in folder.iterdir()} == expected | {"report.md"}
    assert {path.name for path in result["paths"]} == expected | {"report.md"}
    for name in names:
        picture = image.imread(folder / f"{name}.png")
        assert min(picture.shape[:2]) > 300 and picture[:, :, :3].std() > 0.02
    for path in folder.glob("*.csv"):
        notes, header, rows = record.read_csv(path)
        assert {"versions", "machine", "commit", "run"} <= set(notes)
        assert set(notes["run"]) == {"title", "date", "seconds"}
        assert notes["versions"]["numpy"] == np.__version__
        assert rows and all(len(row) == len(header) for row in rows)
    _, header, rows = record.read_csv(folder / "figure_22.csv")
    energy = np.array(rows, dtype=float)[:, header.index("energy_J")]
    run = result["figures"]["runs"][VI, 2e-2]
    assert np.array_equal(energy, run["energy"])


@pytest.mark.slow
def test_what_the_figures_show(small):
    data = small[1]["figures"]
    assert all(value < 1e-9 for value in data["momentum"].values())
    assert data["treatments apart"] < 1e-9
    for step in (2e-2, 1e-2):
        assert data["energy"][EM, step]["(q_n, p_n)"]["range"] < 1e-10
        assert 1.44 < data["runs"][VI, step]["event_x"] < 1.5
    for term in figures.TERMS:
        ratio = data["energy"][VI, 2e-2][term]["range"] / data["energy"][VI, 1e-2][term]["range"]
        assert ratio > 2  # the oscillation falls with the step


@pytest.mark.slow
def test_quick_run(tmp_path):
    result = paper.main(tmp_path, quick=True)
    for term in figures.TERMS:
        energy = result["figures"]["energy"]
        ratio = energy[VI, 1e-2][term]["range"] / energy[VI, 1e-3][term]["range"]
        assert 60 < ratio < 160
    for treatment in (LM, NS):
        study = result["convergence"][treatment]["orders"][convergence.SAME_END]
        for name, order in study[5e-4, 2.5e-4].items():
            assert abs(order - (1 if name == convergence.SHIFTED else 2)) < 0.1
    stiff = result["figures"]["stiff"]
    assert stiff[VI, 1e-2]["event_x"] is None and stiff[VI, 1e-2]["diverged_at"] < 0.66
    assert stiff[EM, 1e-2]["event_x"] == pytest.approx(0.66, abs=0.01)
