"""The benchmark collection with other data than its references': closed forms, orders, energies."""

from __future__ import annotations

import math
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy.special import jv

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "examples" / "benchmarks"))

import collection
from collection import common, statics

FAMILIES = collection.families()
pytestmark = pytest.mark.slow  # quickly, tests/whole has references of all kinds of scenes


def main(family, *arguments, **options):
    return FAMILIES[family].main(*arguments, **options)


# -- equilibria and buckling -----------------------------------------------------------------------


def test_roll_up_of_another_rod():
    data = {"L": 3.0, "EI": 7.0, "lam": 0.4, "EA": 1e3, "GA": 3e2}
    found = main("S01", data=data, order=2)
    for name, value in FAMILIES["S01"].closed_form(3.0, 0.4).items():
        assert found[name] == pytest.approx(value, abs=1e-9), name


def test_elastica_of_any_size():
    """With alpha fixed all lengths are proportional; the moment at the root is force times x."""
    unit = main("S02", "2", order=4, elements=8)
    found = main("S02", "2", {"L": 2.0, "EI": 5.0}, order=4, elements=8)
    assert [found["x"], found["y"]] == pytest.approx([2 * unit["x"], 2 * unit["y"]], rel=1e-11)
    assert found["theta"] == pytest.approx(unit["theta"], rel=1e-11)
    assert found["root_moment"] == pytest.approx(2 * 5 / 4 * found["x"], rel=1e-9)


def test_toggle_without_shear():
    """Against shooting (DOP853, rtol 1e-13) with the same GA: two limit points, w and P."""
    found = main("S07", "limit_points", {"GA": 1e12}, order=4, elements=14)
    reference = [
        [0.23205486225042085, 33.861233002664086],
        [0.3916895711912225, 31.26258310941577],
    ]
    assert np.array(found["limit_points"]) == pytest.approx(np.array(reference), rel=2e-9)


def test_deployable_ring_closes_to_a_third_of_any_radius():
    found = main("S11", data={"R": 10.0, "E": 1e6}, order=4, elements=48)
    assert found["ux_B"] == pytest.approx(-40 / 3, abs=1e-8)


def test_prandtl_of_another_strip():
    """c is a number: it does not depend on the strip."""
    j = main("S09", "c", {"L": 100.0, "t": 1.0, "GJ": 3e5}, order=4, elements=10)["c"] / 2
    assert jv(-0.25, j) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    ("case", "repeated"), [("Pcr", 3.31327752061047), ("load +e1", 1.0875178408408)]
)
def test_lateral_buckling_against_repeated_references(case, repeated):
    """The same shooting solutions as the entries', with steps of 1/60 of the length."""
    assert main("S09", case, order=4, elements=8)["Pcr"] == pytest.approx(repeated, rel=1e-9)


def test_hinged_frame_of_another_size():
    data = {"L": 100.0, "EI2": 1e4, "GJ": 2e4}
    found = main("S09", "Mcr", data, order=4, elements=10)["Mcr"]
    assert found == pytest.approx(math.pi * math.sqrt(2e8) / 100, rel=1e-9)


@pytest.mark.parametrize("supports", [0, 1])
def test_column_of_another_section(supports):
    """Thick, so that shear and extension count; with shear stiffness of its own."""
    euler, data = FAMILIES["S10"], {"h": 0.2, "L": 1.5, "GA": 1e9}
    found = euler.main(euler.CASES[supports], data, order=4)
    expected = euler.closed_form(statics.inputs(euler.DATA, data), pinned=supports == 0)
    assert found["Pcr"] == pytest.approx(expected, rel=1e-11)
    assert found["Pcr_over_PE"] < 0.98


def test_twisted_ring_of_another_size():
    data = {"R": 3.0, "EI": 5.0, "GJ": 7.0}
    found = main("S12", data=data, order=4, elements=24)
    for name, value in FAMILIES["S12"].closed_form(**data).items():
        assert found[name] == pytest.approx(value, rel=5e-8), name


# -- rigid bodies ----------------------------------------------------------------------------------


def test_a_chaotic_chain_as_long_as_it_is_followed():
    """Two rods to 2 s: the error estimated bounds the true one by a factor."""
    known = common.entry("R8_chain_N2")["values"]
    times = [t for t in known["t"] if t <= 2.0]
    result = main("R08", "R8_chain_N2", times=times)
    for k in range(len(times)):
        wanted = np.array(known["taylor_longdouble"][k], dtype=float)
        error = abs(np.array(result["state"][k]) - wanted).max()
        assert error < 30 * result["estimated_error"][k] + 1e-10
        assert error < 1e-8


@pytest.mark.parametrize(("case", "theta"), [("slow", 0.3), ("fast", 2.0)])
def test_steady_precession_at_another_tilt(case, theta):
    """The rate solves the quadratic equation, and the tilt stays."""
    found = main("R02", case, {"theta": theta, "Omega3": 25.0, "l": 0.4, "A": 0.3})
    w = found[case]
    left = 0.3 * np.cos(theta) * w**2 - 0.1 * 25.0 * w + 9.81 * 0.4
    assert abs(left) < 1e-9 * 0.1 * 25.0 * abs(w)
    assert found["theta"] == pytest.approx([theta] * 2, abs=1e-11)
    assert found["psi"] == pytest.approx(w * np.array(found["t"]), abs=1e-11)


@pytest.mark.plain
def test_free_body_returns_after_its_period():
    """Elliptic functions; first integrals in the body."""
    data = {"I": (1.0, 1.7, 2.5), "Omega0": (0.4, -1.1, 0.9)}
    period = main("R03", "jacobi", data)["period_Omega"]
    found = main("R03", data=data, times=[period])["state"][0]
    assert found[4:] == pytest.approx(data["Omega0"], abs=1e-11)
    for name, value in common.entry("R3_free_rigid_body_general")["values"]["jacobi"].items():
        assert FAMILIES["R03"].jacobi()[name] == pytest.approx(float(value), rel=1e-15)


def test_windows_of_other_numbers():
    """Energy: columns (N + 1)/6 and beams N/2 of m l^2 phi'^2, weight (N + 1)/2 + N of m g l."""
    windows = 4
    result = main("R05", data={"N": windows, "l": 0.5, "m": 2.0, "g": 4.0, "vx": 0.7}, times=[0.4])
    inertia = 2.0 * 0.25 * ((windows + 1) / 6 + windows / 2)
    weight = 2.0 * 4.0 * 0.5 * ((windows + 1) / 2 + windows)
    ((phi, rate),) = result["phi_omega"]
    energy = inertia * rate**2 + weight * np.cos(phi)
    assert energy == pytest.approx(inertia * 1.96 + weight, rel=1e-11)


# -- beams in motion -------------------------------------------------------------------------------


def test_quaternions_do_not_jump():
    """Beyond a whole turn their sign goes on, as the reference's does."""
    answer = main("D05", "7.5", elements=2, step=0.05)
    assert answer["quat"]["root"][0] == pytest.approx(-0.97932869, abs=1e-8)


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


def test_spinup_to_all_digits():
    rows = FAMILIES["D05"].PROBLEM.rows("D05", times=[2.5, 7.5])
    for row in rows:
        if row["quantity"].split()[0] in ("pos", "u_rel", "theta_rel", "quat"):
            assert row["error"] < 3e-9, row["quantity"]


def test_pendulum_scaled():
    """Lengths by a, times by b at the same density: moduli by (a/b)^2."""
    a, b, options = 3.0, 0.5, {"elements": 4, "order": 2}
    one = main("D01", times=[0.1, 0.25], step=0.01, **options)
    data = {"L": a, "r": 5e-3 * a, "g": 9.81 * a / b**2, "E": 5e6 * (a / b) ** 2}
    other = main("D01", data=data, times=[0.1 * b, 0.25 * b], step=0.01 * b, **options)
    np.testing.assert_allclose(other["tip"], a * np.array(one["tip"]), rtol=0, atol=1e-9)
    np.testing.assert_allclose(other["vel"], a / b * np.array(one["vel"]), rtol=0, atol=1e-8)


@pytest.mark.parametrize("integrator", ["energy-momentum", "variational"])
def test_second_order_in_time(integrator):
    """At given steps, where nothing sets in at once."""
    places = []
    for n in (1, 2, 4):
        answer = main("D05", times=[2.5], elements=2, step=0.025 / n, integrator=integrator)
        places.append(np.array([*answer["pos"][0].values()]))
    first, second = (np.linalg.norm(b - a) for a, b in pairwise(places))
    assert abs(np.log2(first / second) - 2) < 0.1


@pytest.mark.parametrize(("family", "times"), [("D02", [2.0, 3.0, 4.0]), ("D03", [5.0, 6.0, 7.0])])
def test_energy_is_kept_after_the_loads(family, times):
    """At any mesh, by energy-momentum."""
    energy = main(family, times=times, elements=4, step=0.05)["energy"]
    np.testing.assert_allclose(energy, energy[0], rtol=1e-11)


# -- vibrations ------------------------------------------------------------------------------------


def simply_supported(h, nu, kappa):
    """Frequencies of Timoshenko's quadratic for each wavenumber, in a row; of length 1."""
    E, rho, roots = 210e9, 7850.0, []
    shear, r2 = 2 * (1 + nu) / kappa, h**2 / 12
    for k in np.pi * np.arange(60):
        roots += np.roots(
            [rho * r2 * shear / E, -(1 + r2 * k**2 * (1 + shear)), E / rho * r2 * k**4]
        ).tolist()
    return np.sqrt(np.sort(roots)[1:])  # without k = 0 of the first branch, which is at rest


def test_simply_supported_beam_of_closed_form():
    found = main("M01", "h=0.05,SS", {"nu": 0.3, "kappa": 0.85})["omega"]
    assert found == pytest.approx(simply_supported(0.05, 0.3, 0.85)[:5], rel=1e-11)


def test_no_mode_is_missing():
    """Second spectrum, too: it starts with sections that all turn alike, the line at rest."""
    found = main("M01", "h=0.2,SS", {"modes": 30}, order=4, elements=100)["omega"]
    assert found == pytest.approx(simply_supported(0.2, 0.3, 5 / 6)[:30], rel=5e-9)


@pytest.mark.parametrize("ends", ["CS", "SC", "FS"])
def test_other_supports(ends):
    """Slender: Euler-Bernoulli's (kL)^2; a beam on one hinge has those of clamped and hinged."""
    found = main("M01", f"h=0.001,{ends}", elements=24)["omega_norm"]
    assert found[0] == pytest.approx(3.92660231**2, rel=2e-5)


@pytest.mark.parametrize(("order", "error", "estimate"), [(1, 2e-7, 1e-4), (3, 1e-10, 1e-9)])
def test_blade_extrapolated_from_three_meshes(order, error, estimate):
    """Well below what the finest gives, and what is estimated."""
    found = main("M02", "hub=1,eta=5", order=order)
    wanted = common.entry(FAMILIES["M02"].ENTRIES[0])["values"]["hub=1,eta=5"]
    for name in ("flap", "lag"):
        assert abs(found[name] - np.array(wanted[name], dtype=float)).max() < error
    assert found["estimated_error"] < estimate


def test_flap_and_lag_differ_by_the_speed():
    """flap^2 - lag^2 = eta^2, exact for all modes; another speed and hub."""
    found = main("M02", data={"hub": 0.35, "eta": 5.0}, elements=32)
    squares = np.array(found["flap"]) ** 2 - np.array(found["lag"]) ** 2
    assert squares == pytest.approx([25.0] * 4, abs=1e-8)


def test_thin_ring_vibrates_by_hoppes_formula():
    h, n = 0.005, 3
    thin = main("M04", data={"h": h, "n": n}, elements=24)["inplane_omega"][0]
    hoppe = n * (n**2 - 1) / np.sqrt(n**2 + 1) * h * np.sqrt(210e9 / 12 / 7850)
    assert thin == pytest.approx(hoppe, rel=1e-4)


def test_buckled_beam_has_no_frequency():
    """Beyond the critical load the first frequency is zero, the state unstable."""
    assert main("M03", "-1.1", elements=8)["omega_bending"][0] == 0.0
