"""Speed against accuracy: small runs of this package, statements about made-up ones."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "examples" / "benchmarks"))
sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "examples" / "benchmarks" / "peers"))

import speed_accuracy_chart as speed


@pytest.mark.slow
def test_this_package_alone(tmp_path):
    """Order x mesh x step x treatment; both treatments make the same errors; tables, charts."""
    out, methods = tmp_path, ("energy-momentum", "explicit")
    result = speed.main(True, 1, None, out, ("spaghetti", "four-bar"), {}, methods)
    rows = {row["label"]: row for row in result["tables"]["spaghetti"].rows}
    classic = [row for row in rows.values() if row["kind"] == "energy-momentum"]
    assert len(classic) >= 6 and all(row["status"] == "ok" for row in classic)
    for row in classic:
        other = rows.get(row["label"].replace("null-space", "multipliers"), row)
        assert row["error_position"] == pytest.approx(other["error_position"], rel=1e-6)
    explicit = [row for row in result["rows"] if row["kind"] == "explicit"]
    assert explicit and all("above the limit of the explicit" in r["reason"] for r in explicit)
    text = (out / "speed_accuracy_spaghetti.csv").read_text()
    assert text.startswith("# work and precision") and "null-space" in text
    stated = (out / "speed_accuracy.csv").read_text().splitlines()
    assert sum(line.startswith(("spaghetti,", "four-bar,")) for line in stated) == 6
    assert "spaghetti, 1e-02: energy-momentum" in speed.report(result)


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
    assert [each["ahead"] for each in (coarse, middle)] == ["Code (process)", ""]
    assert fine["cheapest"] is None and fine["ahead"] == "Code (steps); Code (process)"
    assert speed.sentence(fine) == "rod, 1e-06: only Code, 1e-07 reaches it"
