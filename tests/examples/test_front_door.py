"""Whole calls and processes: one row a figure, peers that are missing are told; no timings."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
from test_benchmarks import FOLDER, load

sys.path.insert(0, str(FOLDER))
sys.path.insert(0, str(FOLDER.parent))


@pytest.fixture(scope="module")
def front_door():
    return load("front_door")


@pytest.fixture
def figures(front_door, monkeypatch):
    """Measurements that answer 2 and 1, each in turn; what was asked."""
    told = []

    def measure(value, name):
        def run():
            told.append(name)
            return value

        return run

    names = [*front_door.RATIOS, *front_door.VALUES]
    made = [
        front_door.Figure(name, "s", measure(2.0, "ours"), measure(1.0, "other")) for name in names
    ]
    monkeypatch.setattr(front_door, "calls", lambda quick: made)
    return told


def test_rows_are_medians_in_turns(front_door, figures, tmp_path):
    """The keys of a row, and where the table was measured."""
    result = front_door.main(repeats=5, parts=("calls",), out=tmp_path)
    rows = result["rows"]
    assert all(tuple(each) == ("name", "ours", "other", "ratio", "unit") for each in rows)
    assert {each["name"] for each in rows} == {*front_door.RATIOS, *front_door.VALUES}
    assert all((each["ours"], each["other"], each["ratio"]) == (2, 1, 2) for each in rows)
    assert figures[:11] == ["ours", *["ours", "other"] * 5]  # the first one reads kernels
    lines = (tmp_path / "front_door.csv").read_text(encoding="utf-8").splitlines()
    assert lines[0].startswith("# versions") and "name,ours,other,ratio,unit" in lines
    assert front_door.report(result).count("\n") == len(rows)


def test_times_alone_are_scaled(front_door, monkeypatch):
    """To a machine on which scikit-fem is imported in 0.35 s."""
    skfem = lambda: 0.7  # noqa: E731
    monkeypatch.setattr(front_door, "import_skfem", skfem)
    figure = front_door.Figure("a", "ms", lambda: 0.1, skfem)
    found = front_door.row(figure, 5)
    assert found["ours"] == pytest.approx(50.0) and found["other"] == pytest.approx(350.0)
    assert found["ratio"] == pytest.approx(1 / 7)
    found = front_door.row(front_door.Figure("b", "s", lambda: 0.1, lambda: 0.2, "told"), 5)
    assert (found["ours"], found["other"], found["unit"]) == (0.1, 0.2, "s (told)")


def test_what_is_missed(front_door):
    (ratio, most), (value, largest) = (
        next(iter(limits.items())) for limits in (front_door.RATIOS, front_door.VALUES)
    )
    good = [
        {"name": ratio, "ours": 99.0, "other": 99.0, "ratio": most, "unit": "s"},
        {"name": value, "ours": largest, "other": 0.35, "ratio": 99.0, "unit": "s"},
    ]
    assert not front_door.missed({"rows": good})
    bad = [{**good[0], "ratio": 2 * most}, {**good[1], "ours": 2 * largest}]
    bad.append(front_door.absent("x", "no wheel"))
    wrong = front_door.missed({"rows": bad})
    assert [line.partition(": ")[0] for line in wrong] == [
        ratio,
        value.partition(": ")[0],
        "x",
    ]
    assert wrong[2] == "x: not measured: no wheel"


@pytest.mark.slow
def test_a_peer_that_cannot_be_installed_is_a_row(front_door, monkeypatch):
    def refuse(*arguments):
        raise front_door.peer_calls.Unavailable("no wheel")

    monkeypatch.setattr(front_door.peer_calls, "prepare", refuse)
    rows = front_door.main(parts=("peers",), repeats=1)["rows"]
    assert [each["name"] for each in rows] == [one.name for one in front_door.contests(True)]
    assert all(each["ratio"] is None and "no wheel" in each["unit"] for each in rows)
    assert json.dumps(rows)
    assert {each["name"] for each in rows} < set(front_door.RATIOS)


def test_the_best_settings_of_a_peer(front_door, monkeypatch):
    """Varied one by one; the tightest tolerance that it reaches."""

    def answer(python, peer, scene, timeout=0):
        o = scene["options"]
        if o["tolerance"] < 1e-7:
            return {"status": "stopped at 0.1 s"}
        cheap = (o["newton"] == "modified") + 2 * (o["solver"] == "EXUdense")
        return {"status": "completed", "seconds": 9.0 - cheap, "process_s": 1.0, "steps": 60}

    monkeypatch.setattr(front_door.peer_calls, "prepare", lambda *a: Path("python"))
    monkeypatch.setattr(front_door.peer_calls, "ask", answer)
    scene = front_door.timed(front_door.scenes.rod(2), 60, 1e-3)
    found = front_door.best("exudyn_beam", None, scene, 60)
    assert (found["tolerance"], found["newton"], found["solver"]) == (1e-7, "modified", "EXUdense")
    monkeypatch.setattr(
        front_door.peer_calls, "ask", lambda *a, **k: {"status": "stopped at 0.1 s"}
    )
    with pytest.raises(front_door.Unanswered, match="stopped at"):
        front_door.best("exudyn_beam", None, scene, 60)


def test_large_scenes_are_extrapolated(front_door, monkeypatch):
    """Where the next size would take too long; by the growth of the last two."""

    def alone(*arguments, **options):
        _, n = json.loads(arguments[-1])
        answer = json.dumps({"seconds": n**2.0, "memory": float(n)})
        return front_door.Process(n**2.0, answer)

    monkeypatch.setattr(front_door, "process", alone)
    sizes = [(n, float(n)) for n in (1, 10, 100, 1000)]
    scene = front_door.Large("chain", sizes, 1e4)
    assert scene.told == "extrapolated from 10 and 100"
    assert scene.measure("seconds") == pytest.approx(1e6)
    assert scene.found["memory"] == pytest.approx(1000)
    whole = front_door.Large("chain", sizes, 1e9)
    assert whole.told == "" and whole.measure("seconds") == 1e6


def test_scenes_of_bodies_hold_together(front_door):
    """A chain has a tree, a ladder a loop for each rung."""
    chain, ladder = (
        front_door.rigid(json.dumps(front_door.timed(scene, 3, 1e-3)))
        for scene in (front_door.chain(4), front_door.ladder(3))
    )
    assert len(chain.structures) == len(chain.joints) == 4
    assert (len(ladder.structures), len(ladder.joints)) == (9, 12)
    assert front_door.bare(ladder, 1e-3, 3) > 0
    assert len(front_door.four_bars(3).freeze().joints) == 12


@pytest.mark.slow
# the inertia of the swing is as published
@pytest.mark.filterwarnings("ignore:section. inertia:skfem_cosserat.ModelWarning")
def test_processes_of_ours_end_where_calls_do(front_door):
    """The script for plain numbers solves the scenes of the peers."""
    own = load("peers/own")
    for scene in (
        front_door.timed(front_door.scenes.rod(4), 5, 1e-3),
        front_door.timed(front_door.scenes.swing(4), 5, 1e-3),
    ):
        text = json.dumps({**scene, "options": {"kernels": "numpy"}})
        found = json.loads(front_door.process("-c", front_door.SCRIPT, given=text).answer)
        wanted = own.run({**scene, "options": {"kernels": "numpy"}})["positions"][-1]
        assert found == pytest.approx(wanted, abs=1e-12)


@pytest.mark.slow
def test_imports_of_a_scene(front_door):
    """All that a first freeze imports, and nothing that cannot be imported."""
    needed = front_door._needed().split()
    assert {"skfem", "numpy", "skfem_cosserat"} <= set(needed)
    assert not {"numba", "exudyn"} & set(needed)
    assert front_door.import_scene() > 0 and 0.02 < front_door.skfem_memory() < 2


@pytest.mark.slow
def test_front_door_command(tmp_path):
    target = tmp_path / "rows.json"
    command = [sys.executable, FOLDER / "front_door.py", "--quick", "--json", target]
    subprocess.run(command, check=True, capture_output=True)
    rows = json.loads(target.read_text())
    front_door = load("front_door")
    assert [each["name"] for each in rows] and {each["name"] for each in rows} == {
        *front_door.RATIOS,
        *front_door.VALUES,
    }
