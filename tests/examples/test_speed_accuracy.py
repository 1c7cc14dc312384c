"""Speed against accuracy: small runs, what is skipped, statements, peers that are made up."""

from __future__ import annotations

import json
import sys
from math import inf
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "examples" / "benchmarks"))
sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "examples" / "benchmarks" / "peers"))

import speed_accuracy_chart as speed


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    out = tmp_path_factory.mktemp("speed")
    methods = ("energy-momentum", "explicit")
    return speed.main(True, 1, None, out, ("spaghetti", "four-bar"), {}, methods), out


@pytest.mark.slow
def test_this_package_alone(alone):
    """Order x mesh x step x treatment; both treatments make the same errors; tables, charts."""
    result, out = alone
    rows = {row["label"]: row for row in result["tables"]["spaghetti"].rows}
    classic = [row for row in rows.values() if row["kind"] == "energy-momentum"]
    assert len(classic) >= 6 and all(row["status"] == "ok" for row in classic)
    for row in classic:
        other = rows.get(row["label"].replace("null-space", "multipliers"), row)
        assert row["error_position"] == pytest.approx(other["error_position"], rel=1e-6)
        assert row["newton_iterations"] >= row["factorisations"] > 0
        assert other["unknowns"] >= row["unknowns"] and row["cost_s"] > 0
    explicit = [row for row in result["rows"] if row["kind"] == "explicit"]
    assert explicit and all("above the limit of the explicit" in r["reason"] for r in explicit)
    timed = [row["process_s"] for row in classic if row["process_s"]]
    assert timed and min(timed) > max(row["cost_s"] for row in classic)
    text = (out / "speed_accuracy_spaghetti.csv").read_text()
    assert text.startswith("# work and precision") and "null-space" in text
    stated = (out / "speed_accuracy.csv").read_text().splitlines()
    assert sum(line.startswith(("spaghetti,", "four-bar,")) for line in stated) == 6
    assert "spaghetti, 1e-02: energy-momentum" in speed.report(result)
    json.dumps(result["rows"], allow_nan=True)


class Grown:
    """A code whose error falls with step and mesh, and whose cost is that of its work."""

    def __init__(self, floor=0.0, status="completed"):
        self.asked, self.floor, self.status = [], floor, status

    def __call__(self, scene):
        nodes, steps = len(scene["beams"][0]["nodes"]) - 1, round(scene["until"] / scene["step"])
        self.asked.append((nodes, steps))
        error = self.floor + 1.0 / steps**2 + 10.0 / nodes**6
        return {
            "status": self.status,
            "seconds": 1e-6 * nodes * steps,
            "steps": steps,
            "positions": [[6.0 + error, 0.0, 0.0]],
        }


def runner(code):
    reference = np.array([[6.0, 0.0, 0.0]])  # it was 10 m away at the start
    return speed.Runner("spaghetti", {"code": code}, {"code": "Code"}, reference, None)


def setups(meshes, halvings):
    return [speed.Setup("code", "Code", n, k, ()) for n in meshes for k in halvings]


def test_what_cannot_be_cheaper_is_not_run():
    code = Grown()
    grid = setups((8, 16, 32, 64), range(8))
    rows = runner(code).explored(grid, inf)
    assert len(rows) == len(code.asked) < len(grid)
    costs = [speed.cheapest(rows, target)["cost_s"] for target in speed.TARGETS[:2]]
    every = runner(Grown())
    all_rows = [every.row(setup) for setup in grid]
    best = [speed.cheapest(all_rows, target)["cost_s"] for target in speed.TARGETS[:2]]
    assert costs == best
    assert len(runner(Grown()).explored(grid, 1e-3)) < len(rows)  # no patience
    assert speed.cheapest(rows, 1e-15) is None
    assert rows[0]["error_position"] == pytest.approx(0.1 * (50**-2 + 10 / 8**6), rel=1e-6)


def test_what_a_peer_says_when_it_fails():
    for words, status in (
        ("no answer within 120 s", "timeout"),
        ("stopped at 0.3 s", "newton"),
        ("unstable before 0.1 s", "diverged"),
        ("failed with exit status 1: no module", "error"),
    ):
        rows = runner(Grown(status=words)).explored(setups((8, 16, 32), (0,)), inf)
        assert [(row["status"], row["reason"]) for row in rows] == [(status, words)]  # no finer one
    refused = Grown(status="refused: no loops")
    assert len(runner(refused).explored(setups((8, 16), range(4)), inf)) == len(refused.asked) == 1


def row(kind, error, cost, process=None, group=None):
    label = f"{kind}, {error:g}"
    whole = {"group": group or speed.OURS, "status": "ok", "process_s": process, "label": label}
    return {"kind": kind, "error_position": error, "cost_s": cost, **whole}


def test_statements_name_the_cheapest_its_margin_and_who_is_ahead():
    rows = [
        row("variational", 5e-3, 1.0, 10.0),
        row("energy-momentum", 9e-3, 2.0, 11.0),
        row("energy-momentum", 1e-5, 3.0, 12.0),
        row("Code", 1e-3, 4.0, 6.0, "Code"),
        row("Code", 1e-7, 20.0, 22.0, "Code"),
    ]
    coarse, middle, fine = speed.statements("rod", rows)
    assert (coarse["cheapest"], coarse["second"]) == (
        "variational, 0.005",
        "energy-momentum, 0.009",
    )
    assert (coarse["second_ratio"], coarse["peer_ratio"], coarse["process_ratio"]) == (2, 4, 0.6)
    assert coarse["ahead"] == "Code (process)"
    assert (middle["cpu_s"], middle["second"], middle["peer_ratio"]) == (3.0, None, 20 / 3)
    assert middle["ahead"] == ""
    assert fine["cheapest"] is None and fine["ahead"] == "Code (steps); Code (process)"
    assert speed.sentence(fine) == "rod, 1e-06: only Code, 1e-07 reaches it"
    assert "AHEAD: Code (process)" in speed.sentence(coarse)
    table = speed.PrecisionTable(rows, {"position": 3e-7}, {})
    found = {"statements": [coarse, middle, fine], "tables": {"rod": table}, "missing": {"X": "-"}}
    wrong = speed.missed(found)
    assert wrong[:2] == ["X: not measured: -", "rod: the reference is off by 3.0e-07"]
    assert wrong[2:] == [
        "rod, 1e-02: ahead: Code (process)",
        "rod, 1e-04: 6.67 times less CPU, required 10",
        "rod, 1e-06: ahead: Code (steps); Code (process)",
    ]
