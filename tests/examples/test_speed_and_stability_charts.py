"""The map of stability behind a chart of the guide: small runs."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "examples"))
sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "examples" / "benchmarks"))

import measuring
import stability_chart as stability

# -- stability -------------------------------------------------------------------------------------


@pytest.mark.slow
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
    """The most dissipative reach event X at 1e-2 and 3e-2 s; variational ones fail around it."""
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
                # the step of generalized-alpha to 0.62 s has several solutions (the run warns of
                # them), one of many times the energy: which one is found turns with rounding
                passed = cell.status == "drift" and cell.time > 0.66
                lost = cell.status == "blowup" and cell.time > 0.61
                assert passed or (lost and name == "generalized-alpha 0"), (name, cell)
        if name.startswith("generalized-alpha 0."):  # nothing bounds its energy
            # above 10 E_0 or not when a step cannot be solved: that turns with rounding
            assert cells[0].status in ("newton", "blowup"), (name, cells[0])
            assert cells[0].energy_error > 5, (name, cells[0])
            assert "a smaller rho_inf" in cells[0].reason
