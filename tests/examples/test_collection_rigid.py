"""Rigid families of the benchmark collection: reference numbers, other inputs, bad input.

Where the ladder of steps ends by itself the limit is rounding: of Newton's method, 1e-12 in one
step, and what it has grown to. Tolerances are a few times what was measured.
"""

import importlib
import sys
from pathlib import Path

import numpy as np
import pytest
from test_modes import bad

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "examples" / "benchmarks"))

common = importlib.import_module("collection.common")
R1, R2, R3, R4, R5, R6, R8 = (
    importlib.import_module(f"collection.{name}")
    for name in (
        *("r01_pendulum", "r02_top", "r03_free_body", "r04_bricard", "r05_four_bars"),
        *("r06_squeezer", "r08_chain"),
    )
)
FAMILIES = {"R1": R1, "R2": R2, "R3": R3, "R4": R4, "R5": R5, "R6": R6, "R8": R8}
PAIRS = [(i, t) for i in ("energy-momentum", "variational") for t in ("null-space", "multipliers")]
pairs = pytest.mark.parametrize(("integrator", "treatment"), PAIRS)
#: errors of the quick rows relative to 1 or the size of a field, a few times those measured; that
#: of R5 is rounding of its steps (4e-13), which extrapolation magnifies to 4e-12 or 1.1e-11
QUICK = {"R1": 5e-12, "R2": 2e-11, "R3": 5e-12, "R4": 5e-12, "R5": 5e-11, "R6": 5e-13, "R8": 5e-11}
#: instants of a short run of each family
SHORT = {"R1": 0.5, "R2": 0.05, "R3": 1.0, "R4": 0.5, "R5": 0.5, "R6": 0.002, "R8": 0.5}
TAKEN = {"cost_s", "unknowns", "newton_iterations", "converged", "order", "elements", "step"}


def field(family, result):
    """The main field at the last instant."""
    name = {"R4": "P3", "R5": "phi_omega", "R6": "q"}.get(family, "state")
    return np.array(result[name][-1])


def size(reference):
    return max(1.0, abs(np.array(reference, dtype=float)).max())


# -- reference numbers -----------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")  # singular positions
@pytest.mark.parametrize("family", FAMILIES)
def test_quick_rows(family):
    rows = FAMILIES[family].rows()
    assert rows
    for row in rows:
        assert row["id"] == f"R0{family[1]}"
        assert row["converged"]
        assert row["error"] < QUICK[family] * size(row["reference"]), row


@pytest.mark.slow
def test_a_chaotic_chain_as_long_as_it_is_followed():
    """Two rods to 3 s: the error estimated bounds the true one by a factor."""
    known = common.entry("R8_chain_N2")["values"]
    times = [t for t in known["t"] if t <= 3.0]
    result = R8.main("R8_chain_N2", times=times)
    for k in range(len(times)):
        wanted = np.array(known["taylor_longdouble"][k], dtype=float)
        error = abs(np.array(result["state"][k]) - wanted).max()
        assert error < 30 * result["estimated_error"][k] + 1e-10
        assert error < 1e-8


@pytest.mark.slow
@pairs
def test_every_pair_of_methods_comes_to_the_reference_in_second_order(integrator, treatment):
    """A free body after 1 s: extrapolated, and with given steps."""
    wanted = np.array(common.entry("R3_free_rigid_body_general")["values"]["state"][0], float)
    options = {"times": [1.0], "integrator": integrator, "treatment": treatment}
    assert field("R3", R3.main(**options)) == pytest.approx(wanted, abs=5e-11)
    runs = [R3.main(step=0.05 / 2**k, **options) for k in range(3)]
    assert [run["step"] for run in runs] == pytest.approx([0.05, 0.025, 0.0125], rel=1e-12)
    errors = [np.linalg.norm(field("R3", run) - wanted) for run in runs]
    assert np.log2(errors[1] / errors[2]) == pytest.approx(2, abs=0.1)


# -- what comes back -------------------------------------------------------------------------------


@pytest.mark.one_quick
@pytest.mark.parametrize("family", FAMILIES)
def test_names_and_shapes(family):
    """Those of the entry's values, at the instants asked for, in that order, zero among them."""
    module = FAMILIES[family]
    values = common.entry(module.ENTRIES[0])["values"]
    times = [0.2 * SHORT[family], 0.0, 0.1 * SHORT[family]]
    result = module.main(times=times, step=0.05 * SHORT[family])
    assert set(result) >= {"t", *TAKEN}
    assert result["t"] == times
    for name in set(values) & set(result) - {"t", "q0", "jacobi", "literature_t0p03"}:
        found, wanted = np.array(result[name]), np.array(values[name], dtype=float)
        assert found.shape == (3, *wanted.shape[1:]), name
    key = str(times[0])
    one = module.main(case=key, step=0.05 * SHORT[family])
    assert one["t"] == times[0]
    assert set(result[key]) <= set(one)


@pytest.mark.slow
def test_an_instant_of_the_reference_is_a_case():
    """As text, as a number; alone it is that instant's numbers, else all are lists."""
    found = [R1.main(case, step=0.1) for case in ("1", 1, 1.0)]
    assert [each["t"] for each in found] == [1.0] * 3
    several = R1.main("state", times=[1.0], step=0.1)
    assert R1.main(times=1.0, step=0.1)["state"] == several["state"]
    assert several["state"][0] == several["1"]["state"] == found[0]["state"]


@pytest.mark.slow
def test_entries_and_counts_are_cases():
    assert len(R8.main("R8_chain_N3", times=[0.1], step=0.05)["state"][0]) == 6
    assert len(R8.main("R8_chain_N3", {"N": 4}, times=[0.1], step=0.05)["state"][0]) == 8
    assert len(R8.main(data={"N": 3}, times=[0.1], step=0.05)["tip"][0]) == 2
    assert set(R2.main("R2_steady_precession", step=0.01)) >= {"slow", "fast", *TAKEN}


# -- other inputs ----------------------------------------------------------------------------------


@pytest.mark.slow
def test_pendulum_of_another_length():
    """Lengths times l, times by sqrt(l/g): the same motion; the mass does not matter."""
    length, g = 2.5, 3.0
    scale = np.sqrt(length / g * 9.81)
    data = {"l": length, "g": g, "m": 7.0, "v0": (0, 2.0 * length / scale, 0)}
    found = R1.main(data=data, times=[scale * 1.0])["state"][0]
    wanted = np.array(common.entry("R1_spherical_pendulum")["values"]["state"][0], dtype=float)
    units = np.repeat([length, length / scale], 3)
    assert found / units == pytest.approx(wanted, abs=1e-11)


@pytest.mark.slow
def test_heavy_top_without_gravity_is_a_free_body():
    """Held at its centre of mass; with the inertia in other axes as a tensor."""
    data = {"g": 0.0, "X": (0, 0, 0), "J_com": (1, 2, 3), "Omega0": (1, 1, 1)}
    found = R2.main(data=data, times=[1.0])["state"][0]
    wanted = np.array(common.entry("R3_free_rigid_body_general")["values"]["state"][0], float)
    assert found == pytest.approx(wanted, abs=1e-11)
    turned = {"q0": (np.sqrt(0.5), 0, 0, np.sqrt(0.5)), "I": np.diag([2.0, 1, 3]).tolist()}
    turned["Omega0"] = (1, -1, 1)  # e1 is where e2 was: the same body, seen from other axes
    other = R3.main(data=turned, times=[1.0])["state"][0]
    assert other[4:] == pytest.approx([wanted[5], -wanted[4], wanted[6]], abs=1e-11)


@pytest.mark.slow
@pytest.mark.parametrize(("case", "theta"), [("slow", 0.3), ("fast", 2.0)])
def test_steady_precession_at_another_tilt(case, theta):
    """The rate solves the quadratic equation, and the tilt stays."""
    data = {"theta": theta, "Omega3": 25.0, "l": 0.4, "A": 0.3}
    found = R2.main(case, data)
    w = found[case]
    left = 0.3 * np.cos(theta) * w**2 - 0.1 * 25.0 * w + 9.81 * 0.4
    assert abs(left) < 1e-9 * 0.1 * 25.0 * abs(w)
    assert found["theta"] == pytest.approx([theta] * 2, abs=1e-11)
    assert found["psi"] == pytest.approx(w * np.array(found["t"]), abs=1e-11)


@pytest.mark.slow
@pytest.mark.plain
def test_free_body_returns_after_its_period():
    """Elliptic functions; first integrals in the body."""
    data = {"I": (1.0, 1.7, 2.5), "Omega0": (0.4, -1.1, 0.9)}
    period = R3.main("jacobi", data)["period_Omega"]
    found = R3.main(data=data, times=[period])["state"][0]
    assert found[4:] == pytest.approx(data["Omega0"], abs=1e-11)
    for name, value in common.entry("R3_free_rigid_body_general")["values"]["jacobi"].items():
        assert R3.jacobi()[name] == pytest.approx(float(value), rel=1e-15)


@pytest.mark.slow
def test_windows_of_other_numbers():
    """Energy: columns (N + 1)/6 and beams N/2 of m l^2 phi'^2, weight (N + 1)/2 + N of m g l."""
    windows = 4
    data = {"N": windows, "l": 0.5, "m": 2.0, "g": 4.0, "vx": 0.7}
    result = R5.main(data=data, times=[0.4])
    inertia = 2.0 * 0.25 * ((windows + 1) / 6 + windows / 2)
    weight = 2.0 * 4.0 * 0.5 * ((windows + 1) / 2 + windows)
    for phi, rate in [(0.0, 0.7 / 0.5), *result["phi_omega"]]:
        energy = inertia * rate**2 + weight * np.cos(phi)
        assert energy == pytest.approx(inertia * 1.96 + weight, rel=1e-11)
    ends = [(0.5 * np.sin(phi), 0.5 * np.cos(phi)) for phi, _ in result["phi_omega"]]
    assert np.array(result["B0"]) == pytest.approx(np.array(ends), abs=1e-11)


def chain_energy(state, d):
    """Kinetic and potential energy of a chain's angles and rates, from closed form."""
    n = d["N"]
    theta, rate = np.array(state[:n]), np.array(state[n:])
    energy, velocity, height = 0.0, np.zeros(2), 0.0
    for a, w in zip(theta, rate, strict=True):
        half = d["l"] / 2 * w * np.array([-np.sin(a), np.cos(a)])
        center = velocity + half
        energy += d["m"] * (center @ center / 2 + d["l"] ** 2 * w**2 / 24)
        energy += d["m"] * d["g"] * (height + d["l"] / 2 * np.sin(a))
        velocity, height = velocity + 2 * half, height + d["l"] * np.sin(a)
    return energy


@pytest.mark.slow
def test_chain_of_three():
    """Energy of closed form; the tip from the angles."""
    data = {"N": 3, "l": 0.6, "m": 2.0, "g": 5.0, "theta0": (0.3, -0.4, 1.0)}
    result = R8.main(data=data, times=[0.4])
    start = chain_energy([*data["theta0"], 0, 0, 0], data)
    for state, tip in zip(result["state"], result["tip"], strict=True):
        assert chain_energy(state, data) == pytest.approx(start, abs=1e-9)
        ends = [0.6 * f(state[:3]).sum() for f in (np.cos, np.sin)]
        assert tip == pytest.approx(ends, abs=1e-11)


# -- what cannot be done ---------------------------------------------------------------------------


@pytest.mark.parametrize("module", FAMILIES.values())
def test_bad_arguments_are_named(module):
    bad(lambda: module.main("Q7"), "case", "'Q7'", module.ENTRIES[0])
    bad(lambda: module.main(data={"lenght": 2.0}), "data", "'lenght'")


def test_bad_arguments_of_all_families_are_named():
    bad(lambda: R1.main(-1.0), "case", "-1.0")
    bad(lambda: R1.main(order=5), "order", "5")
    bad(lambda: R1.main(elements=0), "elements", "0")
    bad(lambda: R1.main(step=-0.1), "step", "-0.1")
    bad(lambda: R1.main(times=[]), "times")
    bad(lambda: R1.main(times=[-1.0]), "times", "-1.0")
    bad(lambda: R1.main("0.5", times=[0.25]), "times", "0.5")
    bad(lambda: R1.main(data=5), "data", "5")
    bad(lambda: R1.main(integrator="newmark"), "integrator", "'newmark'")
    bad(lambda: R1.main(treatment="penalty"), "treatment", "'penalty'")


def test_bad_data_is_named():
    bad(lambda: R1.main(data={"l": -1.0}), "l = -1.0")
    bad(lambda: R1.main(data={"l": 2.0, "x0": (1, 0, 0)}), "length")
    bad(lambda: R1.main(data={"x0": (1, 0)}), "x0 = (1, 0)")
    bad(lambda: R2.main(data={"q0": (1, 1, 0, 0)}), "q0", "unit quaternion")
    bad(lambda: R2.main(data={"J_com": (1, 1, 3)}), "inertia")
    bad(lambda: R2.main("slow", {"Omega3": 1.0}), "Omega3 = 1", "no steady precession")
    bad(lambda: R2.main("fast", {"theta": np.pi / 2}), "horizontal")
    bad(lambda: R3.main(data={"I": "heavy"}), "inertia = 'heavy'")
    bad(lambda: R4.main(data={"axes": "yzx"}), "axes")
    bad(lambda: R5.main(data={"N": 1.5}), "N = 1.5")
    bad(lambda: R6.main(data={"ss": 0.5}), "loops open")
    bad(lambda: R6.main(data={"q0": [0.0] * 7}), "loops open")
    bad(lambda: R8.main(data={"N": 0}), "N = 0")
    bad(lambda: R8.main(data={"N": 3, "theta0": (0, 0)}), "theta0")


@pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")
def test_a_run_that_cannot_be_solved_gives_no_number():
    """NaN and no error: three rods fall for two seconds in one step."""
    result = R8.main(data={"N": 3}, times=[2.0, 4.0], step=2.0)
    assert result["converged"] is False
    assert np.isnan(result["state"]).all()
    assert np.shape(result["state"]) == (2, 6)
