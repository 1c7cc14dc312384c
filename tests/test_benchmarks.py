"""Benchmarks run, say what they measured on what, and tell where a figure is missed."""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
from pathlib import Path

import pytest

FOLDER = Path(__file__).resolve().parent.parent / "examples" / "benchmarks"


def load(name):
    spec = importlib.util.spec_from_file_location(name, FOLDER / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def step_cost():
    return load("step_cost")


def test_step_cost(step_cost, tmp_path):
    """One row for each integrator, treatment and kind of kernels."""
    result = step_cost.main(
        quick=True, scenes=("tree",), orders=(1,), elements=(20, 40), repeats=1, out=tmp_path
    )
    rows = result["rows"]
    assert {tuple(row) for row in rows} == {step_cost.COLUMNS}
    assert len(rows) == 2 * 2 * 3  # no compiled kernels for multipliers so far
    assert all(row["ms_per_step"] > 0 and row["iterations_per_step"] >= 1 for row in rows)
    assert result["dgemm_gflops"] > 0
    assert "versions" in result["provenance"]
    text = (tmp_path / "step_cost.csv").read_text(encoding="utf-8").splitlines()
    assert text[0].startswith("# versions") and len(text) > len(rows)
    assert "ms/step" in step_cost.report(result)


def test_a_missed_figure_is_told(step_cost):
    rows = [
        dict.fromkeys(step_cost.COLUMNS, 0)
        | {"scene": "chain", "kernels": "numba", "elements": n, "ms_per_step": n**1.2}
        for n in (20, 200, 2000)
    ]
    found = step_cost.missed({"exponents": step_cost.exponents(rows)})
    assert len(found) == 1 and "exponent 1.200" in found[0]
    assert not step_cost.missed({"exponents": step_cost.exponents(rows[:1])})


@pytest.mark.slow
def test_step_cost_command(tmp_path):
    target = tmp_path / "rows.json"
    command = [sys.executable, FOLDER / "step_cost.py", "--quick", "--json", target]
    subprocess.run(command, check=True, capture_output=True)
    assert len(json.loads(target.read_text())) == 48
