"""The collection's families in time, D1 to D10: numbers, orders, scaling laws, bad input.

References: examples/benchmarks/collection/reference.json (D1 to D8 computed with another
discretisation; D6, D9, D10 coarse runs of others). Quick rows have coarse meshes and few levels of
steps; the tolerances are a few times what such meshes leave, and the long rows go down to the
digits that can be trusted.
"""

import importlib
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import skfem_cosserat as sc

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "examples" / "benchmarks"))

collection = importlib.import_module("collection")
FAMILIES = {name: one for name, one in collection.families().items() if name.startswith("D")}
EM, VI = "energy-momentum", "variational"
integrators = pytest.mark.parametrize("integrator", [EM, VI])


def main(family, *arguments, **options):
    return FAMILIES[family].main(*arguments, **options)


def errors(rows, quantity):
    """Largest error of all quantities whose names begin so."""
    found = [row["error"] for row in rows if row["quantity"].split()[0] == quantity]
    assert found, quantity
    return max(found)


# -- quick rows against the reference --------------------------------------------------------------

#: D1, D2, D3, D8: what waves from loads that set in at once leave of a coarse mesh (energies and
#: velocities feel them most); D4: first order in the mesh only; D6, D9, D10: digits of others
TOLERANCES = {
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


@pytest.mark.slow
@pytest.mark.parametrize("family", FAMILIES)
def test_quick_rows(family):
    rows = FAMILIES[family].rows(quick=True)
    assert any(FAMILIES[family].QUICK[0] in row["case"] for row in rows)
    for quantity, tolerance in TOLERANCES[family].items():
        assert errors(rows, quantity) < tolerance, quantity
    for row in rows:
        assert row["converged"] is True
        assert row["id"] == family
        assert row["newton_iterations"] > 0 < row["unknowns"]


# -- the answers -----------------------------------------------------------------------------------


@pytest.mark.slow
def test_instants_and_cases():
    options = {"elements": 2, "step": 0.1}
    one = main("D02", "1", **options)
    many = main("D02", times=[1.0, 2.0], **options)
    assert one["pos"] == main("D02", 1.0, **options)["pos"] == many["1"]["pos"] == many["pos"][0]
    assert many["t"] == [1.0, 2.0]
    assert (one["order"], one["elements"], one["step"], one["converged"]) == (3, 4, 0.1, True)
    assert one["unknowns"] < main("D02", "1", treatment="multipliers", **options)["unknowns"]


@pytest.mark.slow
def test_places_of_the_coarse_runs():
    answer = main("D06", "node C (bar 3 end)", times=[0.0, 0.5], elements=1, step=0.05)
    assert answer["0.5000"] == answer["node C (bar 3 end)"]["0.5000"]
    start = answer["0.0000"]
    np.testing.assert_allclose(start, [0.24, 0.12, 0, 0.5**0.5, 0, 0, -(0.5**0.5)], atol=1e-12)


def test_instants_as_they_were_asked_for():
    """In any order, twice, not rounded; stretches between them have steps of their own."""
    times = [0.2, 1 / 3, 0.2]
    answer = main("D02", times=times, elements=2, step=0.1)
    assert answer["t"] == times and len(answer["energy"]) == 3
    assert 0.09 < answer["step"] <= 0.1
    assert answer["energy"][0] == answer["energy"][2] == answer["0.2"]["energy"]


@pytest.mark.slow
def test_quaternions_do_not_jump():
    """Beyond a whole turn their sign goes on, as the reference's does."""
    answer = main("D05", "7.5", elements=2, step=0.05)
    assert answer["quat"]["root"][0] == pytest.approx(-0.97932869, abs=1e-8)


# -- data overrides: scaling laws ------------------------------------------------------------------


@pytest.mark.slow
def test_pendulum_scaled():
    """Lengths by a, times by b at the same density: moduli by (a/b)^2."""
    a, b, options = 3.0, 0.5, {"elements": 4, "order": 2}
    one = main("D01", times=[0.1, 0.25], step=0.01, **options)
    data = {"L": a, "r": 5e-3 * a, "g": 9.81 * a / b**2, "E": 5e6 * (a / b) ** 2}
    other = main("D01", data=data, times=[0.1 * b, 0.25 * b], step=0.01 * b, **options)
    np.testing.assert_allclose(other["tip"], a * np.array(one["tip"]), rtol=0, atol=1e-9)
    np.testing.assert_allclose(other["vel"], a / b * np.array(one["vel"]), rtol=0, atol=1e-8)


def test_derived_inputs_follow():
    """EI by itself is not E I: the rod is stiffer, by the same as with a fourfold radius in I."""
    data = FAMILIES["D01"].PROBLEM.data({"r": 0.01})
    assert data["EI"] == pytest.approx(5e6 * np.pi * 0.01**4 / 4)
    data = FAMILIES["D01"].PROBLEM.data({"r": 0.01, "EI": 2.0})
    assert data["EI"] == 2.0
    assert data["EA"] == pytest.approx(5e6 * np.pi * 0.01**2)
    link = FAMILIES["D07"].PROBLEM.data({"link": {"EA": 1.0}})["link"]
    assert (link["EA"], link["GA"]) == (1.0, 1.081e7)


@pytest.mark.slow
def test_spinup_with_another_end():
    """Spun up slowly it turns as the closed form says, stretched but for the last vibration."""
    data = {"Omega": 3.0, "T": 12.0}
    answer = main("D05", data=data, times=[12.5, 13.0, 13.5], elements=4, step=1 / 20)
    assert answer["psi"] == pytest.approx([3 * (t - 6) for t in answer["t"]])
    kL = 10 * 3 * (1.2 / 2.8e7) ** 0.5
    stretch = 10 * (np.tan(kL) / kL - 1)
    seen = np.array(answer["u_rel"])
    assert abs(seen[:, 0] - stretch).max() < 0.02 * stretch
    assert abs(seen[:, 1]).max() < 0.02


@pytest.mark.slow
def test_buckling_needs_the_eccentricity():
    """Without it the beam stays in its plane; on the other side it moves the other way."""
    options = {"times": [0.02, 0.1], "elements": 4, "step": 1e-3}
    plane = main("D07", data={"d": 0.0}, **options)
    assert abs(plane["pos"][1]["mid"][1]) < 1e-12
    one, other = (main("D07", data={"d": d}, **options) for d in (1e-4, -1e-4))
    assert other["pos"][1]["mid"][1] == pytest.approx(-one["pos"][1]["mid"][1], rel=1e-6)
    assert abs(one["pos"][1]["mid"][1]) > 1e-5


@pytest.mark.slow
def test_shaft_that_nothing_bends():
    """Without weight and offset it only turns, at the speeds asked for."""
    data = {"g": 0.0, "T1": 0.1, "T2": 0.2, "T3": 0.3, "GJ": 2.727e8}
    data["disk"] = {"offset": 0.0}
    answer = main("D08", data=data, times=[0.1, 0.2], elements=2, step=1e-3)
    np.testing.assert_allclose(answer["pos"][1]["mid"], [3, 0, 0], rtol=0, atol=1e-9)
    for turn, quaternions in zip((48 * 0.05, 48 * 0.15), answer["quat"], strict=True):
        w, x, y, z = quaternions["mid"]
        assert w == pytest.approx(np.cos(turn / 2), abs=0.02)
        assert x == pytest.approx(np.sin(turn / 2), abs=0.02)
        assert abs(y) + abs(z) < 1e-9


# -- integrators, treatments, orders ---------------------------------------------------------------


@pytest.mark.slow
@integrators
def test_second_order_in_time(integrator):
    """At given steps, where nothing sets in at once."""
    places = []
    for n in (1, 2, 4):
        options = {"elements": 2, "step": 0.025 / n, "integrator": integrator}
        answer = main("D05", times=[2.5], **options)
        places.append(np.array([*answer["pos"][0].values()]))
    first, second = (np.linalg.norm(b - a) for a, b in pairwise(places))
    assert abs(np.log2(first / second) - 2) < 0.1


@pytest.mark.slow
def test_energy_is_kept_after_the_loads():
    """At any mesh, by energy-momentum: D2 after 2 s, D3 after 5 s."""
    for family, times in (("D02", [2.0, 3.0, 4.0]), ("D03", [5.0, 6.0, 7.0])):
        energy = main(family, times=times, elements=4, step=0.05)["energy"]
        np.testing.assert_allclose(energy, energy[0], rtol=1e-11)


# -- what goes wrong -------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")  # its energy blows up
def test_a_run_that_fails_says_so():
    answer = main("D01", times=[0.04, 0.6], elements=8, order=2, step=0.02, integrator=VI)
    assert answer["converged"] is False
    assert np.isfinite(answer["tip"][0]).all()
    assert np.isnan(answer["tip"][1]).all()


@pytest.mark.one_quick
@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"case": "0.7"}, "case.*'0.7' is unknown"),
        ({"data": {"weight": 1.0}}, "'weight' is unknown, expected among"),
        ({"data": {"L": -1.0}}, "L = -1.0, expected a positive number"),
        ({"data": {"L": "long"}}, "L = 'long', expected finite numbers"),
        ({"data": {"pulse": "square"}}, "pulse = 'square'"),
        ({"data": {"t_peak": 3.0}}, "t_peak = 3.0 is not before t_end = 2.0"),
        ({"times": [-1.0]}, "expected instants"),
    ],
)
def test_bad_input(options, message):
    with pytest.raises(sc.InputError, match=message):
        main("D02", **options)


def test_bad_places_and_speeds():
    with pytest.raises(sc.InputError, match="node C"):
        main("D06", "node E")
    with pytest.raises(sc.InputError, match="'mass 2' is unknown"):
        main("D08", data={"disk": {"mass 2": 1.0}})
    with pytest.raises(sc.InputError, match="T1"):
        main("D08", "0.05", data={"T2": 0.1})


@pytest.mark.slow
def test_spinup_to_all_digits():
    rows = FAMILIES["D05"].PROBLEM.rows("D05", times=[2.5, 7.5])
    for quantity in ("pos", "u_rel", "theta_rel", "quat"):
        assert errors(rows, quantity) < 3e-9, quantity
