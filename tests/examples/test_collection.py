"""The benchmark collection: numbers of its quick table, its arguments, bad input.

References: examples/benchmarks/collection/reference.json. The package's own tests against the same
numbers are in tests/whole; `test_collection_data.py` has other data than the references'.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np
import pytest

import skfem_cosserat as sc

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "examples" / "benchmarks"))

import collection

FAMILIES = collection.families()

#: Largest errors of the quick rows, a few times what was measured. S: relative to the size of a
#: quantity (or 1), for what the reference's own uncertainty is smaller than: errors of the mesh; by
#: rounding of 1e4 times a strain (S01 n), of 2e3 times a strain (S10); S09 Pcr: the strip's
#: reference is off by 2.2e-7. R and M: the same, by rounding (R05: of its steps, magnified by
#: extrapolation), M04 by the mesh.
RELATIVE = {
    **{"S01": 2e-12, "S02": 1e-12, "S10": 2e-10, "S01 n": 1e-8, "S09 Pcr": 4e-7},
    **{"R01": 5e-12, "R02": 2e-11, "R03": 5e-12, "R04": 5e-12, "R05": 5e-11, "R06": 5e-13},
    **{"R08": 5e-11, "M01": 2e-13, "M02": 2e-12, "M03": 2e-13, "M04": 6e-7},
}
#: D, absolute: what waves from loads that set in at once leave of a coarse mesh (energies and
#: velocities feel them most); D04: first order in the mesh only; D06, D09, D10: digits of others
ABSOLUTE = {
    "D01": {"tip": 1e-5, "vel": 5e-3},
    "D02": {"pos": 1e-5, "quat": 2e-5, "energy": 2e-4},
    "D03": {"pos": 3e-5, "quat": 1e-4, "energy": 2e-2},
    "D04": {"pos": 1.5e-3, "quat": 2e-2, "energy": 0.8},
    "D05": {"pos": 2e-7, "quat": 1e-7, "energy": 3e-6, "psi": 1e-14, "u_rel": 2e-7},
    "D06": {"pos": 1e-5, "quat": 2e-5},
    "D07": {"pos": 5e-7, "quat": 1e-6, "energy": 8e-5},
    "D08": {"pos": 2e-7, "quat": 2e-8, "energy": 6e-3},
    "D09": {"pos": 1e-3, "quat": 1e-4},
    "D10": {"pos": 1e-3, "quat": 1e-4},
}
singular = pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")


def right(row):
    """Whether a row of statics, rigid bodies or vibrations is within what it may be off."""
    family = row["id"]
    limit = RELATIVE.get(f"{family} {row['quantity']}", RELATIVE.get(family, 0.0))
    limit *= max(1.0, float(abs(np.asarray(row["reference"], dtype=float)).max()))
    if family.startswith("S"):
        limit = max(limit, row["trusted"])
    return row["converged"] and row["error"] <= limit


@pytest.mark.slow
@pytest.mark.parametrize(
    "family", [name for name in FAMILIES if name[0] in "SM" and FAMILIES[name].QUICK]
)
def test_quick_rows_of_statics_and_vibrations(family):
    rows = FAMILIES[family].rows()
    assert {row["case"] for row in rows} == set(FAMILIES[family].QUICK)
    assert [row for row in rows if not right(row)] == []


@pytest.mark.slow
@singular
@pytest.mark.parametrize("family", [name for name in FAMILIES if name[0] == "R"])
def test_quick_rows_of_rigid_bodies(family):
    rows = FAMILIES[family].rows()
    assert rows and {row["id"] for row in rows} == {family}
    assert [row for row in rows if not right(row)] == []


@pytest.mark.slow
@pytest.mark.parametrize("family", ABSOLUTE)
def test_quick_rows_of_beams_in_motion(family):
    rows = FAMILIES[family].rows()
    assert any(FAMILIES[family].QUICK[0] in row["case"] for row in rows)
    assert all(row["converged"] and row["newton_iterations"] > 0 for row in rows)
    for quantity, limit in ABSOLUTE[family].items():
        errors = [row["error"] for row in rows if row["quantity"].split()[0] == quantity]
        assert errors and all(error < limit for error in errors), quantity


@pytest.mark.slow
def test_table():
    rows = collection.run("S14")
    assert [row["quantity"] for row in rows] == 2 * ["tip", "quat", "root_moment"]
    assert set(rows[0]) == set(collection.COLUMNS)


@pytest.mark.parametrize("ids", ["Q1", ["S99"], [""], [3]])
def test_table_of_no_family(ids):
    """A lone name is one family, not its letters; an empty one not all of them."""
    with pytest.raises(sc.InputError, match="expected among"):
        collection.run(ids)


# -- instants --------------------------------------------------------------------------------------


def test_instants_as_they_were_asked_for():
    """In any order, twice, not rounded; stretches between them have steps of their own."""
    times = [0.2, 1 / 3, 0.2]
    answer = FAMILIES["D02"].main(times=times, elements=2, step=0.1)
    assert answer["t"] == times and len(answer["energy"]) == 3
    assert 0.09 < answer["step"] <= 0.1
    assert answer["energy"][0] == answer["energy"][2] == answer["0.2"]["energy"]


@pytest.mark.slow
def test_an_instant_of_the_reference_is_a_case():
    """As text or as a number; alone it is that instant's numbers, else all are lists."""
    main = FAMILIES["R01"].main
    found = [main(case, step=0.1) for case in ("1", 1.0)]
    assert [each["t"] for each in found] == [1.0, 1.0]
    several = main("state", times=[1.0], step=0.1)
    assert several["state"][0] == several["1"]["state"] == found[0]["state"]


# -- bad input -------------------------------------------------------------------------------------


@pytest.mark.parametrize("family", FAMILIES)
def test_unknown_cases_and_inputs(family):
    with pytest.raises(sc.InputError, match=r"case.*'no such case'"):
        FAMILIES[family].main("no such case")
    with pytest.raises(sc.InputError, match="'no such input' is unknown, expected among"):
        FAMILIES[family].main(data={"no such input": 1.0})


@pytest.mark.parametrize("family", ["S01", "R01"])
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"data": 5}, "data: 5, expected a dict"),
        ({"order": 5}, "order.* 5, expected 1, 2, 3 or 4"),
        ({"elements": 0}, "elements = 0, expected a positive integer"),
        ({"step": -0.1}, "step = -0.1, expected a finite number above 0"),
        ({"times": [-1.0]}, "times"),
        ({"integrator": "none"}, "integrator: 'none' is unknown"),
        ({"treatment": "none"}, "treatment: 'none' is unknown"),
    ],
)
def test_bad_arguments(family, arguments, message):
    with pytest.raises(sc.InputError, match=message):
        FAMILIES[family].main(**arguments)


@pytest.mark.parametrize(
    ("family", "data", "message"),
    [
        ("S01", {"EI": -1.0}, "EI = -1.0, expected a positive finite number"),
        ("S02", {"alpha": math.inf}, "alpha = inf, expected a finite number"),
        ("S06", {"at": 120.0}, "at = 120.0, expected less than L = 120.0"),
        ("S07", {"GA": None}, "GA = None, .* no beams without shear"),
        ("S07", {"EA": None}, "EA = None, .* without extension"),
        ("S13", {"axis": (0, 0, 0)}, "an axis of three components, not all zero"),
        ("D02", {"L": "long"}, "L = 'long', expected finite numbers"),
        ("D02", {"pulse": "square"}, "pulse = 'square'"),
        ("D02", {"t_peak": 3.0}, "t_peak = 3.0 is not before t_end = 2.0"),
        ("D08", {"disk": {"mass 2": 1.0}}, "'mass 2' is unknown"),
        ("R01", {"l": 2.0, "x0": (1, 0, 0)}, "length"),
        ("R01", {"x0": (1, 0)}, r"x0 = \(1, 0\)"),
        ("R02", {"q0": (1, 1, 0, 0)}, "unit quaternion"),
        ("R02", {"J_com": (1, 1, 3)}, "inertia"),
        ("R04", {"axes": "yzx"}, "axes"),
        ("R05", {"N": 1.5}, "N = 1.5"),
        ("R06", {"ss": 0.5}, "loops open"),
        ("R08", {"N": 3, "theta0": (0, 0)}, "theta0"),
        ("M01", {"kappa": "5/0"}, "kappa = '5/0'"),
        ("M01", {"modes": 2.5}, "modes.*positive integer"),
        ("M02", {"slenderness": 0.0}, "slenderness = 0.0"),
        ("M03", {"T": -1e12}, r"T = -1e\+12"),
        ("M04", {"n": -1}, "n = -1"),
    ],
)
def test_bad_data(family, data, message):
    with pytest.raises(sc.InputError, match=message):
        FAMILIES[family].main(data=data)


@pytest.mark.parametrize(
    ("family", "case", "options", "message"),
    [
        ("D06", "node E", {}, "node C"),
        ("R01", "0.5", {"times": [0.25]}, "times.*0.5"),
        ("R02", "slow", {"data": {"Omega3": 1.0}}, "Omega3 = 1.* no steady precession"),
        ("R02", "fast", {"data": {"theta": np.pi / 2}}, "horizontal"),
        ("M01", "h=-0.1,CF", {}, "h = '-0.1'"),
        ("M01", "h=0.1,CX", {}, "ends.*'CX'"),
    ],
)
def test_bad_cases(family, case, options, message):
    with pytest.raises(sc.InputError, match=message):
        FAMILIES[family].main(case, **options)


# -- what cannot be computed gives NaN and no exception --------------------------------------------


@pytest.mark.slow
def test_a_mesh_that_gives_way():
    """Four linear elements do not close a circle."""
    found = FAMILIES["S01"].main(order=1, elements=4)
    assert not found["converged"] and found["newton_iterations"] > 0
    assert all(math.isnan(found[name]) for name in FAMILIES["S01"].FIELDS)


@pytest.mark.slow
def test_what_does_not_buckle():
    """A square section has no weak side to buckle to; a flat toggle no limit points."""
    square = FAMILIES["S09"].main(data={"t": 30.0}, order=4, elements=4)
    assert math.isnan(square["Pcr"]) and not square["converged"]
    flat = FAMILIES["S07"].main("limit_points", {"rise": 0.1}, order=4, elements=4)
    assert np.isnan(flat["limit_points"]).all() and not flat["converged"]


@pytest.mark.slow
@singular
def test_a_run_that_cannot_be_solved():
    """Three rods fall for two seconds in one step."""
    result = FAMILIES["R08"].main(data={"N": 3}, times=[2.0, 4.0], step=2.0)
    assert result["converged"] is False
    assert np.isnan(result["state"]).all() and np.shape(result["state"]) == (2, 6)


@pytest.mark.slow
@singular  # its energy blows up
def test_numbers_before_a_failure_are_kept():
    options = {"elements": 8, "order": 2, "step": 0.02, "integrator": "variational"}
    answer = FAMILIES["D01"].main(times=[0.04, 0.6], **options)
    assert answer["converged"] is False
    assert np.isfinite(answer["tip"][0]).all() and np.isnan(answer["tip"][1]).all()
