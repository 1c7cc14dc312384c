"""Benchmarks run, say what they measured on what, and tell where a figure is missed."""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
from pathlib import Path

import pytest

import skfem_cosserat as sc
from skfem_cosserat import Stepper

FOLDER = Path(__file__).resolve().parents[2] / "examples" / "benchmarks"


def load(name):
    spec = importlib.util.spec_from_file_location(Path(name).name, FOLDER / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def step_cost():
    return load("step_cost")


@pytest.fixture(scope="module")
def versus_peers():
    return load("versus_peers")


@pytest.fixture(scope="module")
def cold_start():
    return load("cold_start")


@pytest.fixture(scope="module")
def memory():
    return load("memory")


@pytest.fixture(scope="module")
def static_cost():
    return load("static_cost")


@pytest.mark.slow
def test_static_cost(static_cost, tmp_path):
    """One row for each load and kind of kernels; the figure goes with the yardstick."""
    pytest.importorskip("numba")
    result = static_cost.main(quick=True, out=tmp_path, elements=(8,), repeats=1)
    rows = result["rows"]
    assert [(row["scene"], row["kernels"]) for row in rows] == [
        (scene, kernels) for scene in ("moment", "force") for kernels in ("numpy", "numba")
    ]
    assert {tuple(sorted(row)) for row in rows} == {tuple(sorted(static_cost.COLUMNS))}
    for plain, compiled in (rows[:2], rows[2:]):
        assert plain["iterations"] == compiled["iterations"] > plain["points"] == 8
    assert "0.360 ms" in static_cost.report({**result, "dgemm_gflops": 50.0})
    text = (tmp_path / "static_cost.csv").read_text()
    assert text.startswith("# ") and "dgemm" in text
    slow = [{**rows[1], "elements": 100, "ms_per_iteration": 0.301}]
    at_peer = {"rows": slow, "dgemm_gflops": 60.0}
    assert len(static_cost.missed(at_peer)) == 1
    assert not static_cost.missed({**at_peer, "dgemm_gflops": 50.0})


@pytest.mark.slow
def test_step_cost(step_cost, tmp_path):
    """One row for each integrator, treatment and kind of kernels."""
    result = step_cost.main(
        quick=True, scenes=("tree",), orders=(1,), elements=(20, 40), repeats=1, out=tmp_path
    )
    rows = result["rows"]
    assert {tuple(row) for row in rows} == {step_cost.COLUMNS}
    assert len(rows) == 2 * 2 * 2 * 2
    assert all(row["ms_per_step"] > 0 and row["iterations_per_step"] >= 1 for row in rows)
    assert result["dgemm_gflops"] > 0
    assert "versions" in result["provenance"]
    text = (tmp_path / "step_cost.csv").read_text(encoding="utf-8").splitlines()
    assert text[0].startswith("# versions") and len(text) > len(rows)
    assert "numba" in text[0] and "kernels" not in result["provenance"]  # the rows say which
    assert "ms/step" in step_cost.report(result)


@pytest.mark.slow
def test_part_cost(tmp_path):
    """A row for each part, with what it is compared with; what is above its figure is told."""
    pytest.importorskip("numba")
    part_cost = load("part_cost")
    assert set(part_cost.MOST) == set(part_cost.PARTS)
    names = ("multipliers", "four-bar, motor and spring")
    result = part_cost.main(True, names, 4, tmp_path)
    assert [row["part"] for row in result["rows"]] == list(names)
    assert all(row["us"] > 0 and row["ratio"] > 0 for row in result["rows"])
    assert "four-bar, motor and spring" in part_cost.report(result)
    dear = {"rows": [{**result["rows"][0], "ratio": 9.0}]}
    assert part_cost.missed(dear) == ["multipliers: 9.00 of null space, aimed at 1.6"]
    assert (tmp_path / "part_cost.csv").read_text().startswith("# ")


def test_a_missed_figure_is_told(step_cost):
    rows = [
        dict.fromkeys(step_cost.COLUMNS, 0)
        | {"scene": "chain", "kernels": "numba", "elements": n, "ms_per_step": n**1.2}
        for n in (20, 200, 2000)
    ]
    found = step_cost.missed({"exponents": step_cost.exponents(rows)})
    assert len(found) == 1 and "exponent 1.200" in found[0]
    assert not step_cost.missed({"exponents": step_cost.exponents(rows[:1])})


def test_figures_that_nothing_was_measured_for_are_missed(step_cost):
    """Without numba all was well."""
    rows = [dict.fromkeys(step_cost.COLUMNS, 0) | {"scene": "chain", "kernels": "numpy"}]
    (found,) = step_cost.missed({"exponents": {}, "rows": rows})
    assert "not measured" in found


def test_figures_of_the_swing(step_cost):
    costs = {"null-space": 0.2, "multipliers": 0.4}
    rows = [
        {"scene": "swing", "kernels": "numba", "integrator": "variational"}
        | {"treatment": treatment, "ms_per_step": ms}
        for treatment, ms in costs.items()
    ]
    result = {"exponents": {}, "rows": rows, "dgemm_gflops": 60.0}
    found = step_cost.missed(result)
    assert len(found) == 1 and "multipliers: 0.400 ms a step, above 0.320" in found[0]
    assert len(step_cost.missed({**result, "dgemm_gflops": 80.0})) == 2


@pytest.mark.slow
def test_step_cost_command(tmp_path):
    target = tmp_path / "rows.json"
    command = [sys.executable, FOLDER / "step_cost.py", "--quick", "--json", target]
    subprocess.run(command, check=True, capture_output=True)
    rows = json.loads(target.read_text())
    assert {row["scene"] for row in rows} == {"chain", "tree", "lattice", "swing"}


# what benchmarks share


def test_command_writes_rows_and_tells_what_is_missed(versus_peers, tmp_path, capsys):
    measuring = versus_peers.measuring
    rows = [{"n": 1, "ms": 2.0}, {"n": 2, "ms": None}, {"n": 3, "ms": float("nan")}]

    def main(quick, out=None, environments=None):
        assert quick and out is None and environments == "somewhere"
        return {"rows": rows, "dgemm_gflops": 1.0}

    def run(*arguments, wrong):
        report = lambda result: measuring.table(result["rows"], ("n", "ms"))  # noqa: E731
        more = ("--quick", "--environments", "somewhere", *arguments)
        return measuring.command("Text.", main, report, lambda r: wrong, more, ("environments",))

    target = tmp_path / "rows.json"
    assert run("--check", "--json", str(target), wrong=[]) == 0
    written = [*rows[:2], {"n": 3, "ms": None}]  # there is no NaN in JSON
    assert json.loads(target.read_text()) == written
    assert "no figure is missed" in capsys.readouterr().out
    assert run("--check", wrong=["too slow"]) == 1
    assert run(wrong=["too slow"]) == 0
    assert capsys.readouterr().out.count("too slow") == 2


def test_every_iteration_of_full_newton_has_a_factorisation(versus_peers):
    measuring = versus_peers.measuring
    system = measuring.chain(4, 1)
    own = sc.EnergyMomentum(), sc.NullSpace(), 1e-3, measuring.full_newton()
    run = measuring.advance(Stepper(system, *own, kernels="numpy"), sc.initial_state(system), 3)
    assert run.iterations == run.factorisations > 3
    assert run.state.index == 3 and run.seconds > 0
    assert measuring.tip(system, run.state) == pytest.approx([1, 0, 0], abs=1e-3)


# against other codes


class FakeExudyn:
    """Falls as a stone does; its dense solver fails, modified Newton is twice as fast."""

    def __init__(self, ms):
        self.ms, self.asked = ms, []

    def __call__(self, python, peer, scene, timeout=0):
        options = scene["options"]
        self.asked.append(options)
        if options.get("solver") == "EXUdense":
            return {"status": "singular"}
        full, steps = options["newton"] == "full", round(scene["until"] / scene["step"])
        return {
            "status": "completed",
            "seconds": 1e-3 * steps * (self.ms if full else self.ms / 2),
            "iterations": steps * (2.0 if full else 5.0),
            "factorisations": steps * (2.0 if full else 0.1),
            "steps": steps,
            "positions": [[1.0, -9.81 / 2 * scene["until"] ** 2, 0.0]],
        }


@pytest.fixture
def exudyn(versus_peers, monkeypatch):
    def fake(ms):
        exudyn = FakeExudyn(ms)
        monkeypatch.setattr(versus_peers.peer_calls, "ask", exudyn)
        monkeypatch.setattr(versus_peers.peer_calls, "prepare", lambda *a: Path("python"))
        monkeypatch.setattr(versus_peers, "window", lambda elements: 3)
        monkeypatch.setattr(versus_peers, "ITERATION_RATIOS", {"numpy": 1.0})
        kernels = versus_peers.ours
        plain = lambda n, name, kind, *rest: kernels(n, name, "numpy", *rest)  # noqa: E731
        monkeypatch.setattr(versus_peers, "ours", plain)  # nothing is compiled here
        monkeypatch.setattr(versus_peers, "required", lambda *a: 8.0)
        return exudyn

    return fake


@pytest.mark.slow
def test_versus_peers_takes_the_best_settings(versus_peers, exudyn, tmp_path):
    asked = exudyn(1e4).asked
    peers = (versus_peers.EXACT,)
    result = versus_peers.main(elements=(4,), repeats=1, out=tmp_path, peers=peers)
    rows = result["rows"]
    assert [(r["measure"], r["kernels"]) for r in rows] == [
        *[("step", "numba")] * 2,
        *[("iteration", "numba"), ("iteration", "numpy")] * 2,
    ]
    assert {r["peer_ms"] for r in rows} == {5e3}  # half the step, and half of a full step
    assert all(("full" in r["setting"]) == (r["measure"] == "iteration") for r in rows)
    assert all(r["ratio"] == r["peer_ms"] / r["ours_ms"] for r in rows)
    assert all("EXUdense" not in r["setting"] and "1e-08" in r["setting"] for r in rows)
    assert len(asked) == 1 + len(list(versus_peers.candidates(4))) + 2
    assert not result["missing"] and not versus_peers.missed(result)
    lines = (tmp_path / "versus_peers.settings.csv").read_text().splitlines()
    assert sum("singular" in line for line in lines) == 6
    assert "RotVecLG" in versus_peers.report(result)


@pytest.mark.slow
def test_versus_peers_tells_what_is_missed(versus_peers, exudyn):
    exudyn(1e-6)
    result = versus_peers.main(elements=(4,), repeats=1, peers=(versus_peers.EXACT,))
    assert len(versus_peers.missed(result)) == 6
    result["rows"][0] |= {"ratio": 9.0, "tip_difference": 0.1}
    found = versus_peers.missed(result)
    assert len(found) == 6 and "lengths apart" in found[0]
    result["rows"][0] |= {"tip_difference": float("nan")}
    assert len(versus_peers.missed(result)) == 6


def test_a_peer_that_cannot_be_installed_counts_as_missed(versus_peers, monkeypatch):
    def refuse(*arguments):
        raise versus_peers.peer_calls.Unavailable("no wheel")

    monkeypatch.setattr(versus_peers.peer_calls, "prepare", refuse)
    result = versus_peers.main()
    assert not result["rows"] and len(result["missing"]) == 3
    assert sorted(versus_peers.missed(result)) == [
        f"{peer}: not measured: no wheel"
        for peer in (versus_peers.CABLE, versus_peers.EXACT, versus_peers.ELASTICA)
    ]


def test_figures_asked_of_a_step_and_an_iteration(versus_peers):
    asked = versus_peers.required
    steps = [asked(versus_peers.EXACT, "step", n, "numba") for n in (20, 200, 2000)]
    assert steps == [8, 10, 30]
    assert asked(versus_peers.EXACT, "iteration", 200, "numba") == 12
    assert asked(versus_peers.EXACT, "iteration", 200, "numpy") == 1
    assert asked(versus_peers.CABLE, "step", 20, "numba") == 1
    assert asked(versus_peers.ELASTICA, "second", 20, "numba") is None


# cold start


@pytest.mark.slow
def test_cold_start(cold_start, tmp_path):
    """The import alone: compiling on an empty cache is for the slow tests."""
    result = cold_start.main(orders=(), repeats=1, out=tmp_path)
    (row,) = result["rows"]
    assert row["measure"] == "import" and row["limit"] == 1.0
    assert 0 < row["seconds"] < 10
    assert row["compiled"] is None  # nobody looked
    assert row["new_files"] == 0 and not row["numba_imported"]
    assert (tmp_path / "cold_start.csv").exists()
    assert "import" in cold_start.report(result)


@pytest.mark.slow
def test_cold_start_compiles_once(cold_start):
    pytest.importorskip("numba")
    result = cold_start.main(integrators=("variational",), repeats=1)
    rows = {row["measure"]: row for row in result["rows"] if row.get("treatment") != "multipliers"}
    assert rows["cold"]["compiled"] > 0 and rows["cold"]["new_files"] > 0
    for measure in ("warm", "other mesh"):
        assert rows[measure]["compiled"] == rows[measure]["new_files"] == 0
    assert rows["warm"]["seconds"] < rows["cold"]["seconds"] / 5


def test_cold_start_tells_what_is_missed(cold_start):
    row = {"measure": "warm", "integrator": "variational", "treatment": "null-space", "order": 1}
    row |= {
        "seconds": 0.4,
        "cpu_s": 0.4,
        "limit": 0.5,
        "compiled": 0,
        "new_files": 0,
        "numba_imported": False,
    }
    assert not cold_start.missed({"rows": [row]})
    for change, text in (
        ({"seconds": 0.6}, "warm variational null-space 1: 0.60 s, at most 0.5"),
        ({"compiled": 2}, "2 functions compiled"),
        ({"new_files": 3}, "3 new files"),
        ({"numba_imported": True}, "imports numba"),
    ):
        (found,) = cold_start.missed({"rows": [{**row, **change}]})
        assert text in found
    assert not cold_start.missed({"rows": [{**row, "measure": "cold", "compiled": 9}]})


# memory


@pytest.mark.slow
def test_memory(memory, tmp_path):
    result = memory.main(elements=(20,), steps=20, kernels=("numpy",), out=tmp_path)
    rows = result["rows"]
    assert [row["measure"] for row in rows if row["steps"] == 2] == ["mesh"]
    assert {row["measure"] for row in rows} == {"mesh", "steps", "streamed"}
    assert {row["kernels"] for row in rows} == {"numpy"}  # what ran, not what was asked for
    assert all(row["steps"] == 20 for row in rows[1:])
    assert all(row["megabytes"] > 20 for row in rows[1:])
    assert set(result["growth"]) == {"steps", "streamed"}
    assert (tmp_path / "memory.csv").exists()
    assert not memory.missed(result)


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


def test_instants(memory):
    assert memory.instants(10_000) == [1000, 2000, 3000, 4000, 5000, 6000, 7000, 8000, 9000, 10000]
    assert memory.instants(1_000_000)[:3] == [1000, 10_000, 100_000]
    assert memory.instants(20)[-1] == 20


def test_memory_tells_what_is_missed(memory):
    rows = [
        {"measure": "mesh", "kernels": "numpy", "elements": n, "megabytes": n**power}
        for power, n in ((1.0, 200), (1.5, 2000), (1.5, 6000))
    ]
    found = memory.exponents(rows)
    assert found == {"numpy": pytest.approx(1.5, abs=1e-12)}
    wrong = memory.missed({"exponents": found, "growth": {"steps": 0.5, "streamed": 9.0}})
    assert len(wrong) == 2 and "1.500" in wrong[0] and "streamed" in wrong[1]
    assert not memory.missed({"exponents": {"numpy": 1.0}, "growth": {"steps": 0.1}})


@pytest.mark.slow
def test_lattice(tmp_path):
    """One row for the own choice and each solver that is installed."""
    lattice = load("lattice")
    result = lattice.main(lattices=[(4, 1), (3, 3)], rounds=1, out=tmp_path)
    rows = result["rows"]
    assert {tuple(row) for row in rows} == {lattice.COLUMNS}
    assert [row["asked"] for row in rows[:2]] == ["own choice", "superlu"]
    assert rows[0]["unknowns"] == 288 and rows[1]["unknowns_left"] == 288
    assert rows[-1]["unknowns_left"] == 6 * 18 < rows[-1]["unknowns"] == 6 * (18 + 2 * 54)
    assert all(row["ms_per_iteration"] > 0 and row["ratio_fastest"] > 0 for row in rows)
    assert "4 x 4 x 4 joints, 1 elements a strut" in result["figures"]
    assert not lattice.missed(result)  # figures are about larger ones
    slow = {lattice.title(16, 1): {"ratio_fastest": 1.6}}
    assert "1.60 (ratio_fastest), above 1.5" in lattice.missed({"figures": slow})[0]
    assert "ms/iter." in lattice.report(result)
    assert (tmp_path / "lattice.csv").read_text(encoding="utf-8").startswith("# versions")


@pytest.mark.slow
def test_step_profile(tmp_path):
    """Parts, the rest and the floor; the parts and the rest make the step."""
    pytest.importorskip("numba")
    profile = load("step_profile")
    result = profile.main(elements=[5], out=tmp_path)
    for integrator in ("energy-momentum", "variational"):
        rows = {r["part"]: r for r in result["rows"] if r["integrator"] == integrator}
        whole, floor = rows.pop("whole step"), rows.pop("floor of the iterations")
        assert sum(r["us_per_step"] for r in rows.values()) == pytest.approx(whole["us_per_step"])
        assert rows["sweep"]["calls_per_step"] == floor["calls_per_step"] >= 1
        assert 0 < floor["share"] < 1 and set(rows) > {"beam_force", "factor", "balance"}
    assert "sweep" in profile.report(result)
    assert (tmp_path / "step_profile.csv").read_text(encoding="utf-8").startswith("# versions")
