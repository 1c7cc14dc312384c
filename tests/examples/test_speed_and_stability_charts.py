"""The benchmarks behind the README's two pictures: small runs, peers that are made up."""

from __future__ import annotations

import json
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import skfem_cosserat as sc

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "examples"))
sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "examples" / "benchmarks"))

import measuring
import speed_accuracy_chart as speed
import stability_chart as stability

ONE = {"energy-momentum": sc.EnergyMomentum}


# -- speed and accuracy ----------------------------------------------------------------------------


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    out = tmp_path_factory.mktemp("speed")
    result = speed.main(
        quick=True, repeats=1, out=out, with_peers=False, integrators=ONE, scenes=("spaghetti",)
    )
    return result, out


def test_speed_accuracy_alone(alone):
    """Our own setups: order x mesh x step x treatment; both treatments make the same errors."""
    result, out = alone
    table = result["tables"]["spaghetti"]
    assert not table.failed and len(table.rows) == 8
    rows = {row["label"]: row for row in table.rows}
    for label, row in rows.items():
        other = rows[label.replace("null space", "multipliers")]
        assert row["error_point"] == pytest.approx(other["error_point"], rel=1e-6)
        assert row["newton_iterations"] == row["factorisations"] > 2 * 10
        assert other["unknowns"] >= row["unknowns"]
        assert row["cost_s"] > 0
    assert table.reference_errors["point"] < 1e-4  # errors are 1e-3 and more
    assert result["standing"]["spaghetti"].levels == [] and not speed.missed(result)
    text = (out / "speed_accuracy_spaghetti.csv").read_text()
    assert text.startswith("# work and precision") and "null space" in text
    assert "for 1e-02 in point the cheapest is" in speed.report(result)


@pytest.mark.slow
def test_every_integrator_is_on_the_chart(tmp_path):
    """Each with both treatments (explicit: multipliers); all near the reference, none failed."""
    result = speed.main(quick=True, repeats=1, out=tmp_path, with_peers=False)
    for name, table in result["tables"].items():
        assert not table.failed, name
        kinds = {speed.kind_of(row) for row in table.rows}
        assert kinds == set(speed.METHODS)
        assert {speed.colour_of(row) for row in table.rows} == set(measuring.FAMILIES)
        for kind in kinds:
            rows = [row for row in table.rows if speed.kind_of(row) == kind]
            treatments = {row["label"].split(", ")[1] for row in rows}
            explicit = kind in speed.EXPLICIT
            assert treatments == ({"multipliers"} if explicit else {"null space", "multipliers"})
            assert max(row["error_point"] for row in rows) < (2e-3 if name == "swing" else 0.03)


def test_explicit_steps_above_the_limit_fail_by_name():
    grid = speed.GRIDS["spaghetti", True]._replace(explicit_steps=(0.1, 0.00625))
    small = {("spaghetti", True): grid}
    explicit = {"explicit": sc.Explicit}
    result = speed.main(True, 1, None, None, ("spaghetti",), False, explicit, grids=small)
    high, low = result["rows"]
    assert (high["status"], low["status"]) == ("error", "ok")
    assert "above the limit of the explicit scheme" in high["reason"]
    assert low["error_point"] < 1e-3 and low["newton_iterations"] == 0


def test_against_an_independent_run(alone):
    """Steps taken one by one end where those of `simulate` do."""
    problem = speed.PROBLEMS["spaghetti", True]
    run = speed.stepped(problem, sc.EnergyMomentum, sc.NullSpace, (3, 4), 0.05, "numpy")
    system, place = speed.scene("spaghetti", 4, 3)
    methods = sc.EnergyMomentum(), sc.NullSpace()
    plain = {"every": 2, "derive": False, "kernels": "numpy"}
    own = sc.simulate(system, *methods, 0.05, problem.until, **plain)
    np.testing.assert_allclose(run["point"], own.position(place)[1:], atol=1e-11)
    assert run["newton_iterations"] == own.meta["newton_iterations"]
    assert np.linalg.norm(own.position(place)[0] - speed.SPAGHETTI["end"]) < 1e-12


def made_up(path, **more):
    """An adapter that answers with this path, or what it says."""

    def ask(python, peer, *options, timeout):
        assert json.loads(options[1])["moment"] == [0.0, 0.5, 1.0]
        cost = {"ms_per_step": 0.01, "iterations_per_step": 2.0, "factorisations_per_step": 0.5}
        return {"status": "completed", "path": path, "step": 0.05, **cost, **more}

    return ask


def test_peers_enter_the_table(alone, monkeypatch, tmp_path):
    """A peer that is exact and cheap: our front is behind, and the report says by how much."""
    problem = speed.PROBLEMS["spaghetti", True]
    grid = speed.GRIDS["spaghetti", True]
    pair = speed.extrapolated(problem, sc.EnergyMomentum, grid.reference[0], "numpy")
    path = np.column_stack([problem.instants, pair["point"] + [1.2e-3, 0, 0]]).tolist()
    monkeypatch.setattr(speed.peer_calls, "prepare", lambda code, place: Path("python"))
    monkeypatch.setattr(speed.peer_calls, "ask", made_up([[0, 0, 0, 0], *path]))
    small = {("spaghetti", True): grid._replace(steps=(0.1,), meshes={1: (8,)})}
    result = speed.main(
        quick=True, repeats=1, integrators=ONE, scenes=("spaghetti",), grids=small, out=tmp_path
    )
    rows = [row for row in result["rows"] if row["group"] != speed.OURS]
    assert [row["group"] for row in rows] == [speed.EXUDYN] * 2 + [speed.ELASTICA]
    assert [row["status"] for row in rows] == ["ok"] * 3
    assert [row["error_point"] for row in rows] == pytest.approx([1.2e-3] * 3, rel=1e-9)
    assert rows[0]["cost_s"] == pytest.approx(20 * 0.01e-3)
    assert (rows[0]["newton_iterations"], rows[0]["factorisations"]) == (40, 10)
    wrong = speed.missed(result)
    assert len(wrong) == 2 and "behind at 1.2e-03 in point" in wrong[0]


@pytest.mark.parametrize(
    ("answer", "status"),
    [
        ("no answer within 120 s", "timeout"),
        ("stopped at 0.3 s", "newton"),
        ("unstable", "diverged"),
        ("failed with exit status 1: no module", "error"),
    ],
)
def test_what_a_peer_says_when_it_fails(answer, status, monkeypatch):
    monkeypatch.setattr(speed.peer_calls, "ask", made_up([], status=answer))
    problem = speed.PROBLEMS["spaghetti", True]
    found = speed.exudyn(problem, Path("python"), 1e-8, 0.9, 8, 0.05)
    assert found == {"status": status, "reason": answer}
    assert speed.elastica(problem, Path("python"), 8)["status"] == status


def test_a_path_without_the_instants(monkeypatch):
    monkeypatch.setattr(speed.peer_calls, "ask", made_up([[0.05, 0, 0, 0]]))
    found = speed.elastica(speed.PROBLEMS["spaghetti", True], Path("python"), 8)
    assert found["status"] == "error" and "instants" in found["reason"]


def refuse(code, place):
    """In the place of `peer_calls.prepare`, where nothing can be installed."""
    raise speed.peer_calls.Unavailable("no wheel")


def test_a_peer_that_cannot_be_installed(monkeypatch):
    monkeypatch.setattr(speed.peer_calls, "prepare", refuse)
    found = {name: speed.peers(name, speed.GRIDS[name, True], None) for name in speed.AXES}
    none = {speed.EXUDYN: "no wheel"}
    assert found == {"swing": ([], none), "spaghetti": ([], none | {speed.ELASTICA: "no wheel"})}


def test_peers_that_were_not_run_are_rows_that_failed(monkeypatch, tmp_path):
    """With the reason; they are not kept for a later run, and disturb neither table nor chart."""
    monkeypatch.setattr(speed.peer_calls, "prepare", refuse)
    grid = speed.GRIDS["swing", True]._replace(steps=(0.0125,), meshes={1: (4,)})
    short = {"grids": {("swing", True): grid}, "integrators": ONE, "scenes": ("swing",)}
    folders = {"out": tmp_path / "out", "resume": tmp_path / "kept"}
    result = speed.main(True, 1, **short, **folders)
    rows = {row["label"]: row for row in result["rows"] if row["group"] != speed.OURS}
    assert {name: (row["status"], row["cost_s"]) for name, row in rows.items()} == {
        speed.EXUDYN: ("error", None),
        speed.ELASTICA: ("error", None),
    }
    assert rows[speed.EXUDYN]["reason"] == "no wheel"
    assert "springs" in rows[speed.ELASTICA]["reason"]
    assert speed.missed(result) == [f"{speed.EXUDYN}: not measured: no wheel"]
    assert result["standing"]["swing"].levels == []
    assert set(result["tables"]["swing"].failed) == {speed.EXUDYN, speed.ELASTICA}
    kept = "".join(path.name for path in (tmp_path / "kept").rglob("*"))
    assert "energy-momentum" in kept and "xudyn" not in kept
    text = (tmp_path / "out" / "speed_accuracy_swing.csv").read_text()
    assert "PyElastica" in text and "no wheel" in text
    assert "no wheel" in speed.report(result)


def test_numbers_of_the_swing_for_a_peer():
    """In its axes: the plane of motion is that of the first two; the rod lies along the first."""
    found = speed.numbers("swing")
    assert json.loads(json.dumps(found)) == found
    assert found["end"] == [0.72, 0, 0] and found["stiffness"][2:5] == [547500, 114.0625, 10.2656]
    assert found["rotary"] == pytest.approx([1.7031, 0.1406, 1.5625])  # about axis, d1, d2
    assert found["pulse"] == [[0, 0.125, 0.25], [0, 1e4, 0]] and found["point"] == 5
    left, right = found["links"]
    assert left["high"] == pytest.approx([0, 0.36, 0]) and left["mass"] == 0.01
    assert right["high"] == pytest.approx([1.08, 0.36, 0])
    for link in (left, right):  # a solid square pyramid: 3 h^2 / 80 and a^2 / 20 of its mass
        along, across = 0.01 * (0.02**2 / 10), 0.01 * 0.02**2 / 20
        across += 0.01 * 3 * np.linalg.norm(np.subtract(link["high"], link["low"])) ** 2 / 80
        assert link["inertia"] == pytest.approx([along, across, across])
        place = np.array(link["low"]) * 3 / 4 + np.array(link["high"]) / 4
        assert link["position"] == pytest.approx(place.tolist())


@pytest.mark.slow
def test_the_peers_themselves():
    """The same scene: their errors fall as h^2 with the mesh, towards our reference."""
    grid = speed.GRIDS["spaghetti", True]._replace(steps=(0.1,), meshes={1: (8,)})
    more = {("spaghetti", True): grid._replace(peer_meshes=(8, 16, 32), peer_steps=(0.0125,))}
    result = speed.main(True, 1, scenes=("spaghetti",), integrators=ONE, grids=more)
    if result["missing"]:
        pytest.skip(str(result["missing"]))
    for group in (speed.EXUDYN, speed.ELASTICA):
        rows = [row for row in result["rows"] if row["group"] == group][:3]
        errors = [row["error_point"] for row in rows]
        assert [a / b for a, b in pairwise(errors)] == pytest.approx([4, 4], rel=0.1)


@pytest.mark.slow
def test_the_swing_of_exudyn(monkeypatch):
    """All its mass, and paths that approach ours as h^2 with the mesh, with either radius."""
    try:
        python = speed.peer_calls.prepare(speed.peer_calls.EXUDYN)
    except speed.peer_calls.Unavailable as error:
        pytest.skip(str(error))
    answers, ask = [], speed.peer_calls.ask
    kept = lambda *a, **k: answers.append(ask(*a, **k)) or answers[-1]  # noqa: E731
    monkeypatch.setattr(speed.peer_calls, "ask", kept)
    problem, fine = speed.PROBLEMS["swing", False], (4, 8, 1.5625e-3)
    ours = speed.extrapolated(problem, sc.EnergyMomentum, fine, "numpy")["point"]
    for radius in (0.9, 0.6):
        paths = [speed.exudyn(problem, python, 1e-8, radius, n, 1.5625e-3) for n in (32, 64, 128)]
        errors = [np.linalg.norm(path["point"] - ours, axis=1).max() for path in paths]
        assert errors[0] < 4e-4
        assert [a / b for a, b in pairwise(errors)] == pytest.approx([4, 4], rel=0.1)
    masses = [answer["mass"] for answer in answers]
    assert masses == pytest.approx([0.72 * 7500 + 5 + 2 * 0.01] * 6, rel=1e-12)


# -- stability -------------------------------------------------------------------------------------


@pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")  # what fails is warned of
def test_stability_of_the_stiff_swing(tmp_path):
    """Energy-momentum passes event X at 3e-2 s, the variational scheme blows up before it."""
    result = stability.main(True, (3e-2,), (1.0,), measuring.INTEGRATORS, out=tmp_path)
    found = result["map"]
    assert dict(zip(found.axes["integrator"], found.status.ravel(), strict=True)) == {
        "energy-momentum": "ok",
        "variational": "blowup",
    }
    energy, blown = found.cells.ravel()
    assert energy.time == pytest.approx(0.69) and energy.energy_error < 1e-10
    assert blown.time == pytest.approx(0.60, abs=0.031) and blown.energy_error > 9
    (row,) = result["limits"]
    assert row["omega"] == pytest.approx(1.01e7, rel=0.01)
    assert 2 / row["omega_c"] < 1e-3  # the step at which it fails later on is beyond theory's line
    text = (tmp_path / "stability_chart.csv").read_text()
    assert "# kernels" not in text and {row["kernels"] for row in found.rows} == {"numpy"}
    assert not stability.missed(result)
    assert "stability map over integrator (2) x factor (1) x step (1): 1 blowup, 1 ok" in (
        stability.report(result)
    )


@pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")  # what fails is warned of
@pytest.mark.slow
def test_stability_of_the_stiff_swing_with_all_integrators(tmp_path):
    """The most dissipative pass event X at 1e-2 and 3e-2 s; variational ones fail around it."""
    found = stability.main(True, (1e-2, 3e-2), (1.0,), resume=tmp_path / "cells")["map"]
    for name, cells in zip(found.axes["integrator"], found.cells[:, 0], strict=True):
        for cell in cells:
            if name.startswith("variational"):
                assert cell.status in ("blowup", "newton") and cell.time < 0.7, (name, cell)
            elif name == "explicit":
                assert cell.status == "blowup" and cell.time < 0.1, (name, cell)
            elif name == "energy-momentum":
                assert cell.status == "ok" and cell.energy_error < 1e-10, (name, cell)
            elif name in measuring.MOST_DISSIPATIVE:
                assert cell.status == "drift" and cell.time > 0.66, (name, cell)
        if name.startswith("generalized-alpha 0."):  # nothing bounds its energy
            # above 10 E_0 or not when a step cannot be solved: that turns with rounding
            assert cells[0].status in ("newton", "blowup"), (name, cells[0])
            assert cells[0].energy_error > 5, (name, cells[0])
            assert "a smaller rho_inf" in cells[0].reason


def test_a_failure_before_event_x_is_missed():
    row = {"integrator": "energy-momentum", "factor": 1.0, "step": 5e-3}
    failed = {**row, "status": "newton", "time_s": 0.4}
    for rows, count in (
        ([failed], 1),
        ([{**failed, "time_s": 0.7}], 0),
        ([{**failed, "step": 1e-2}], 0),
        ([{**row, "status": "ok", "time_s": 0.7}], 0),
    ):
        wrong = stability.missed({"map": type("Found", (), {"rows": rows})})
        assert len(wrong) == count
