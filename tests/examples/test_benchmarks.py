"""Programs that measure speed and memory: each at its smallest; what is missed; no timings."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "examples" / "benchmarks"))
sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "examples" / "benchmarks" / "peers"))

import cold_start
import force_cost
import front_door
import lattice
import measuring
import memory
import own
import part_cost
import static_cost
import step_cost
import step_profile

FOLDER = Path(cold_start.__file__).parent
#: arguments of the smallest useful run of a program
SMALLEST = {
    step_cost: {"scenes": ("tree",), "orders": (1,), "elements": (20, 40), "repeats": 1},
    static_cost: {"elements": (8,), "repeats": 1},
    force_cost: {"forces": ("servo",)},
    part_cost: {"parts": ("multipliers", "four-bar, motor and spring"), "elements": 4},
    step_profile: {"elements": [5]},
    lattice: {"lattices": [(4, 1), (3, 3)], "rounds": 1},
    memory: {"elements": (20,), "steps": 20, "kernels": ("numpy",)},
    cold_start: {"orders": (), "repeats": 1},
}


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """What the programs measured, and the folder of their tables, by program."""
    pytest.importorskip("numba")
    found = {}
    for program, arguments in SMALLEST.items():
        folder = tmp_path_factory.mktemp(program.__name__)
        found[program] = program.main(quick=True, out=folder, **arguments), folder
    return found


@pytest.mark.slow
@pytest.mark.parametrize("program", SMALLEST, ids=lambda program: program.__name__)
def test_a_program_writes_its_rows_and_where_they_were_measured(program, results):
    result, folder = results[program]
    rows = result["rows"]
    assert rows
    text = (folder / f"{program.__name__}.csv").read_text(encoding="utf-8").splitlines()
    assert text[0].startswith("# versions") and len(text) > len(rows)
    assert any(line.startswith("# dgemm") for line in text) and result["dgemm_gflops"] > 0
    assert len(program.report(result).splitlines()) > len(rows)


@pytest.mark.slow
def test_parts_and_the_rest_make_the_step(results):
    for integrator in ("energy-momentum", "variational"):
        rows = results[step_profile][0]["rows"]
        rows = {row["part"]: row for row in rows if row["integrator"] == integrator}
        whole, floor = rows.pop("whole step"), rows.pop("floor of the iterations")
        assert sum(r["us_per_step"] for r in rows.values()) == pytest.approx(whole["us_per_step"])
        assert rows["sweep"]["calls_per_step"] == floor["calls_per_step"] >= 1
        assert 0 < floor["share"] < 1 and set(rows) > {"beam_force", "factor", "balance"}


@pytest.mark.slow
def test_memory_of_a_mesh_of_steps_and_of_a_run_that_is_written(results):
    rows = results[memory][0]["rows"]
    assert {row["measure"] for row in rows} == {"mesh", "steps", "streamed"}
    assert all(row["megabytes"] > 20 for row in rows[1:])


@pytest.mark.slow
def test_resident_set_sees_what_is_allocated():
    """In a process of its own: this one may have room left from before."""
    code = f"""
import sys; sys.path.insert(0, {str(FOLDER)!r})
import memory, numpy as np
before = memory.resident(); memory.forget_peak()
block = np.ones(4_000_000)
during = memory.resident(); del block
print(during - before, memory.peak() - before)
"""
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    during, peak = map(float, run.stdout.split())
    assert during == pytest.approx(32, abs=4) and peak > 28


@pytest.mark.slow
def test_importing_compiles_nothing(results):
    (row,) = results[cold_start][0]["rows"]
    assert row["measure"] == "import" and row["limit"] == 1.0
    assert row["compiled"] is None  # nobody looked
    assert row["new_files"] == 0 and not row["numba_imported"]


# -- whole calls and processes ---------------------------------------------------------------------


@pytest.fixture
def told(monkeypatch):
    """Measurements of the front door that answer 2 and 1, each in turn; what was asked."""
    asked = []

    def measure(value, name):
        def run():
            asked.append(name)
            return value

        return run

    figures = [
        front_door.Figure(name, "s", measure(2.0, "ours"), measure(1.0, "other"))
        for name in (*front_door.RATIOS, *front_door.VALUES)
    ]
    monkeypatch.setattr(front_door, "calls", lambda quick: figures)
    return asked


def test_rows_of_the_front_door_are_medians_in_turns(told, tmp_path):
    """The keys of a row, and where the table was measured."""
    result = front_door.main(repeats=5, parts=("calls",), out=tmp_path)
    rows = result["rows"]
    assert all(tuple(each) == ("name", "ours", "other", "ratio", "unit") for each in rows)
    assert {each["name"] for each in rows} == {*front_door.RATIOS, *front_door.VALUES}
    assert all((each["ours"], each["other"], each["ratio"]) == (2, 1, 2) for each in rows)
    assert told[:11] == ["ours", *["ours", "other"] * 5]  # the first one reads kernels
    lines = (tmp_path / "front_door.csv").read_text(encoding="utf-8").splitlines()
    assert lines[0].startswith("# versions") and "name,ours,other,ratio,unit" in lines
    assert front_door.report(result).count("\n") == len(rows)


@pytest.mark.slow
def test_processes_of_ours_end_where_calls_do():
    """The script for plain numbers solves the scenes of the peers."""
    scene = {**front_door.timed(front_door.scenes.rod(4), 5, 1e-3), "options": {"kernels": "numpy"}}
    process = front_door.process("-c", front_door.SCRIPT, given=json.dumps(scene))
    wanted = own.run(scene)["positions"][-1]
    assert json.loads(process.answer) == pytest.approx(wanted, abs=1e-12)


# -- what is missed --------------------------------------------------------------------------------


COLD = {"measure": "warm", "integrator": "variational", "treatment": "null-space", "order": 1}
COLD |= {"seconds": 0.6, "limit": 0.5, "compiled": 0, "new_files": 0, "numba_imported": False}


@pytest.mark.parametrize(
    ("program", "result", "words"),
    [
        (lattice, {"figures": {lattice.title(16, 1): {"ratio_fastest": 1.6}}}, "above 1.5"),
        (memory, {"exponents": {"numpy": 1.5}, "growth": {}}, "exponent 1.500"),
        (cold_start, {"rows": [COLD]}, "0.60 s, at most 0.5"),
        (front_door, {"rows": [front_door.absent("x", "no wheel")]}, "x: not measured: no wheel"),
    ],
)
def test_a_figure_that_is_missed(program, result, words):
    (found,) = program.missed(result)
    assert words in found


def test_command_writes_rows_and_tells_what_is_missed(tmp_path, capsys):
    rows = [{"n": 1, "ms": 2.0}, {"n": 2, "ms": float("nan")}]

    def main(quick, out=None):
        return {"rows": rows, "dgemm_gflops": 1.0}

    def report(result):
        return measuring.table(result["rows"], ("n", "ms"))

    def run(*arguments, wrong):
        return measuring.command("Text.", main, report, lambda result: wrong, arguments)

    target = tmp_path / "rows.json"
    assert run("--check", "--json", str(target), wrong=[]) == 0
    # there is no NaN in JSON
    assert json.loads(target.read_text()) == [rows[0], {"n": 2, "ms": None}]
    assert "no figure is missed" in capsys.readouterr().out
    assert run("--check", wrong=["too slow"]) == 1
    assert run(wrong=["too slow"]) == 0
    assert capsys.readouterr().out.count("too slow") == 2
