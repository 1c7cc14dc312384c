"""The example of load paths: what it finds, and its files."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "examples"))

import load_paths


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    folder = tmp_path_factory.mktemp("paths")
    return load_paths.main(quick=True, out=folder) | {"folder": folder}


@pytest.mark.slow
def test_lees_frame_has_two_limit_points(result):
    """Reference: shooting method, 9 digits; here 10 cubic elements."""
    kinds, loads = zip(*result["lee"]["critical"], strict=True)
    assert kinds == ("limit", "limit")
    assert loads[0] == pytest.approx(18546.558740, rel=1e-4)
    assert loads[1] == pytest.approx(-9396.142357, rel=1e-3)


@pytest.mark.slow
def test_ring_folds_to_a_third(result):
    assert result["ring"]["radius_ratio"] == pytest.approx(1 / 3, abs=1e-6)
    assert result["ring"]["displacement"] == pytest.approx([-80 / 3, 0, 0], abs=2e-5)


@pytest.mark.slow
def test_column_goes_on_along_its_branch(result):
    ((kind, load),) = result["column"]["critical"]
    assert kind == "bifurcation"
    assert load == pytest.approx(269578.536513374, rel=1e-6)  # closed form
    assert abs(result["column"]["displacement"][1]) > 0.7


@pytest.mark.slow
def test_few_iterations_a_point(result):
    for name in load_paths.PATHS:
        assert result[name]["newton_iterations"] <= 8
        assert result[name]["rejected"] <= 0.2 * result[name]["points"]


@pytest.mark.slow
def test_files(result):
    folder = result["folder"]
    for name in load_paths.PATHS:
        lines = (folder / f"path_{name}.csv").read_text().splitlines()
        table = [line for line in lines if not line.startswith("#")]
        assert table[0].startswith("load_factor,u_x")
        assert np.isfinite([float(x) for x in table[-1].split(",")]).all()
    assert (folder / "ring" / "beams.pvd").exists()
