"""The chart of theories: stiff beams come to the next one in first order; p points are right."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "examples"))

import theory_limits as chart
from test_theories import energy_norm, theory_jacobian

import skfem_cosserat as sc

STEPS = [("full", "unshearable"), ("unshearable", "inextensible"), ("inextensible", "rigid")]


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    folder = tmp_path_factory.mktemp("theory_limits")
    return {**chart.main(quick=True, out=folder), "folder": folder}


@pytest.mark.slow
@pytest.mark.parametrize("scene", ["equilibrium", "motion"])
@pytest.mark.parametrize("step", STEPS, ids="-".join)
def test_each_theory_is_the_limit_of_the_one_before(result, scene, step):
    """In first order of the stiffness, over two decades and a half."""
    (row,) = (
        r for r in result["limits"] if (r["scene"], (r["theory"], r["next"])) == (scene, step)
    )
    errors, ratios = np.log(row["errors"]), np.log(row["ratios"])
    assert errors[-1] < np.log(2e-4)
    assert -np.diff(errors) / np.diff(ratios) == pytest.approx(1, abs=0.03)
    assert row["slope"] == pytest.approx(-1, abs=0.003)


def points(rows, order, points):
    (row,) = (r for r in rows if (r["order"], r["points"]) == (order, points))
    return row


@pytest.fixture(scope="module")
def rows():
    return chart.gauss_points((4, 8))


@pytest.mark.slow
@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_p_points_are_stable_and_more_lock(rows, order):
    right, more = (points(rows, order, order + k)["inf_sup"] for k in (0, 1))
    assert right == pytest.approx([np.sqrt(0.8)] * 2, rel=1e-3)
    assert right[1] == pytest.approx(right[0], rel=1e-3 if order == 1 else 3e-5)
    assert np.log2(more[0] / more[1]) == pytest.approx(1, abs=0.01)
    assert more[1] < 0.03


@pytest.mark.slow
@pytest.mark.parametrize("order", [2, 3, 4])
def test_fewer_points_leave_motions_that_strain_nothing(rows, order):
    fewer, right, more = (points(rows, order, order + k)["loose"] for k in (-1, 0, 1))
    assert fewer == [6 * elements for elements in (4, 8)]  # one a strain and element
    assert right == more == [0, 0]


@pytest.mark.one_quick
@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_the_strains_are_those_that_theories_hold(order):
    """The chart's linear strains against the rows of a system."""
    mesh = sc.MeshCurve.init_line((0, 0, 0), (0, 0, 1), 3)
    section = sc.Section(np.ones(6), mass=1.0, inertia=(1e-3, 1e-3))
    model = sc.Model()
    beam = sc.Beam(mesh, section, order=order, director=(1, 0, 0), theory=sc.TheoryRigid())
    model.add("rod", beam)
    own = chart.Strained(order, order, 3)
    B = own.B.reshape(-1, own.B.shape[-1])[:, 6:]
    assert abs(B - theory_jacobian(model.freeze())).max() < 1e-13
    assert abs(own.norm[6:, 6:] - energy_norm(beam)).max() < 1e-12


@pytest.mark.slow
def test_files_and_report(result):
    text = (result["folder"] / "theory_limits.csv").read_text()
    assert "motion,inextensible,rigid,1000.0," in text.replace("1e+03", "1000.0")
    assert (
        "order,points,elements,inf_sup"
        in (result["folder"] / "theory_limits.points.csv").read_text()
    )
    assert (result["folder"] / "theory_limits.png").stat().st_size > 10_000
    report = chart.report(result)
    assert "inextensible to rigid" in report
    assert "order 2, 1 points" in report
