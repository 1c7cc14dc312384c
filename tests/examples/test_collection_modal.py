"""Vibrating beams of the benchmark collection: exact numbers, other inputs, bad input."""

import importlib
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import expm
from test_modes import bad

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "examples" / "benchmarks"))

common = importlib.import_module("collection.common")
M1, M2, M3, M4 = (
    importlib.import_module(f"collection.{name}")
    for name in ("m01_timoshenko", "m02_rotating", "m03_prestressed", "m04_ring")
)
FAMILIES = {"M1": M1, "M2": M2, "M3": M3, "M4": M4}
#: relative to the largest of a field, a few times what was measured: M1, M2 and M3 by rounding, M4
#: by 48 cubic elements
QUICK = {"M1": 2e-13, "M2": 2e-12, "M3": 2e-13, "M4": 6e-7}


def values(module, case):
    entry = common.entry(module.ENTRIES[0])["values"][case]
    return {name: np.array(x, dtype=float) for name, x in entry.items()}


@pytest.mark.slow
@pytest.mark.parametrize("family", FAMILIES)
def test_quick_rows(family):
    rows = FAMILIES[family].rows()
    assert {row["case"] for row in rows} == set(FAMILIES[family].QUICK)
    for row in rows:
        assert row["id"] == f"M0{family[1]}"
        assert row["converged"]
        scale = abs(np.array(row["reference"], dtype=float)).max()
        assert row["error"] <= QUICK[family] * scale, row


@pytest.mark.slow
@pytest.mark.parametrize(
    ("order", "counts"), [(1, (24, 48)), (2, (16, 32)), (3, (12, 24)), (4, (6, 12))]
)
def test_order_in_space(order, counts):
    """Frequencies converge with h^(2p); those of the ring in test_modes.py."""
    case = "h=0.1,CF"
    found = [M1.main(case, order=order, elements=n)["omega"][1] for n in counts]
    coarse, fine = abs(np.array(found) / values(M1, case)["omega"][1] - 1)
    assert np.log2(coarse / fine) == pytest.approx(2 * order, abs=0.2)


# -- other inputs ----------------------------------------------------------------------------------


@pytest.mark.slow
def test_beam_of_another_material_and_size():
    """omega goes with sqrt(E/rho)/L for equal shape; width does not matter."""
    data = {"L": 2.0, "h": 0.2, "b": 0.3, "E": 70e9, "rho": 2700.0}
    found = M1.main("h=0.1,CF", data, elements=40)
    wanted = values(M1, "h=0.1,CF")
    scale = np.sqrt(70e9 / 210e9 * 7850 / 2700) / 2
    assert found["omega"] == pytest.approx(scale * wanted["omega"], rel=2e-8)
    assert found["omega_norm"] == pytest.approx(wanted["omega_norm"], rel=2e-8)
    assert 2 * np.pi * np.array(found["f_Hz"]) == pytest.approx(found["omega"], rel=1e-14)


@pytest.mark.slow
def test_simply_supported_beam_of_closed_form():
    """Roots of Timoshenko's quadratic for each wavenumber, both branches in one list."""
    found = M1.main("h=0.05,SS", {"nu": 0.3, "kappa": 0.85})["omega"]
    assert found == pytest.approx(simply_supported(0.05, 0.3, 0.85)[:5], rel=1e-11)


def simply_supported(h, nu, kappa):
    """All frequencies of the first wavenumbers, in a row; of length 1."""
    E, rho, roots = 210e9, 7850.0, []
    shear, r2 = 2 * (1 + nu) / kappa, h**2 / 12
    for k in np.pi * np.arange(60):
        roots += np.roots(
            [rho * r2 * shear / E, -(1 + r2 * k**2 * (1 + shear)), E / rho * r2 * k**4]
        ).tolist()
    return np.sqrt(np.sort(roots)[1:])  # without k = 0 of the first branch, which is at rest


@pytest.mark.slow
def test_as_many_modes_as_wanted():
    """Second spectrum, too: it starts with sections that all turn alike, the line at rest."""
    found = M1.main("h=0.2,SS", {"modes": 30}, order=4, elements=100)
    assert found["omega"] == pytest.approx(simply_supported(0.2, 0.3, 5 / 6)[:30], rel=5e-9)
    assert {len(found[name]) for name in ("omega", "f_Hz", "omega_norm")} == {30}


@pytest.mark.slow
@pytest.mark.parametrize("ends", ["FF", "CS"])
def test_no_mode_is_missing(ends):
    """Between frequencies the determinant of Timoshenko's equations has one sign, then the other.

    It is that of the transfer matrix of deflection, rotation, moment/EI and shear force/EI.
    """
    h, E, rho = 0.1, 210e9, 7850.0
    G = 5 / 6 * E / 2.6

    def sign(omega):
        A = np.zeros((4, 4))
        A[0, 1], A[0, 3], A[1, 2], A[2, 3] = 1, E * h**2 / 12 / G, 1, -1
        A[2, 1], A[3, 0] = -rho / E * omega**2, -12 * rho / (E * h**2) * omega**2
        start = {"C": (2, 3), "S": (1, 2), "F": (0, 1)}[ends[0]]
        end = {"C": (0, 1), "S": (0, 2), "F": (2, 3)}[ends[1]]
        return np.sign(np.linalg.det(expm(A)[np.ix_(end, start)]))

    omega = M1.main(f"h={h},{ends}", {"modes": 20}, order=4, elements=40)["omega"]
    for k, each in enumerate(omega):
        assert sign(each * (1 - 1e-6)) == -sign(each * (1 + 1e-6)), k
    between = np.linspace(omega[:-1], omega[1:], 12, axis=1)[:, 1:-1]
    signs = np.array([[sign(each) for each in row] for row in between])
    assert (signs == signs[:, :1]).all()


@pytest.mark.slow
@pytest.mark.parametrize("ends", ["CS", "SC", "FS"])
def test_other_supports(ends):
    """Slender: Euler-Bernoulli's (kL)^2; a beam on one hinge has those of clamped and hinged."""
    found = M1.main(f"h=0.001,{ends}", elements=24)["omega_norm"]
    assert found[0] == pytest.approx(3.92660231**2, rel=2e-5)


@pytest.mark.slow
def test_rotating_cantilever_in_units():
    """Omega over its unit is eta; 0 and one slenderness of their own."""
    data = {"Omega": 6.0, "EI": 8.0, "rhoA": 2.0, "L": 1.0}
    found = M2.main(data=data, elements=24)
    wanted = values(M2, "hub=0,eta=3")
    assert found["flap"][:2] == pytest.approx(wanted["flap"][:2], rel=1e-8)
    thick = M2.main("hub=0,eta=3", {"slenderness": 20.0}, elements=8)
    ratio = np.array(thick["flap"]) / wanted["flap"]
    assert ((ratio > 0.7) & (ratio < 1)).all()


@pytest.mark.slow
@pytest.mark.parametrize("order", [1, 3])
def test_blade_extrapolated_from_three_meshes(order):
    """Well below what the finest gives, and what is estimated."""
    found = M2.main("hub=1,eta=5", order=order)
    wanted = values(M2, "hub=1,eta=5")
    for name in ("flap", "lag"):
        assert abs(found[name] - wanted[name]).max() < {1: 2e-7, 3: 1e-10}[order]
    assert found["estimated_error"] < {1: 1e-4, 3: 1e-9}[order]
    assert "estimated_error" not in M2.main("hub=1,eta=5", elements=2)  # nothing coarser


@pytest.mark.slow
def test_flap_and_lag_differ_by_the_speed():
    """flap^2 - lag^2 = eta^2, exact for all modes; another speed and hub."""
    found = M2.main(data={"hub": 0.35, "eta": 5.0}, elements=32)
    squares = np.array(found["flap"]) ** 2 - np.array(found["lag"]) ** 2
    assert squares == pytest.approx([25.0] * 4, abs=1e-8)


@pytest.mark.slow
def test_prestress_by_force_and_by_factor():
    """T and fac say the same; another length: omega goes with h/L^2 and fac stays."""
    T, wanted = values(M3, "1")["T"], values(M3, "1")["omega_bending"]
    by_force = M3.main(data={"T": float(T)}, elements=24)
    assert by_force["omega_bending"] == pytest.approx(wanted, rel=2e-6)
    data = {"L": 3.0, "h": 0.15, "E": 70e9, "rho": 2700.0}
    found = M3.main("1", data, elements=24)
    scale = np.sqrt(70e9 / 210e9 * 7850 / 2700) / 3
    assert found["omega_bending"] == pytest.approx(scale * wanted, rel=2e-6)
    assert found["T"] == pytest.approx(float(T) * 9 * 70 / 210, rel=1e-12)


@pytest.mark.slow
def test_thin_ring_vibrates_by_hoppes_formula():
    h, n = 0.005, 3
    thin = M4.main(data={"h": h, "n": n}, elements=24)["inplane_omega"][0]
    hoppe = n * (n**2 - 1) / np.sqrt(n**2 + 1) * h * np.sqrt(210e9 / 12 / 7850)
    assert thin == pytest.approx(hoppe, rel=1e-4)


def test_buckled_beam_has_no_frequency():
    """Beyond the critical load the first frequency is zero, the state unstable."""
    assert M3.main("-1.1", elements=8)["omega_bending"][0] == 0.0


@pytest.mark.slow
@pytest.mark.parametrize("treatment", ["null-space", "multipliers"])
def test_prestress_with_both_treatments(treatment):
    found = M3.main("100", elements=24, treatment=treatment)
    assert found["newton_iterations"] > 0
    assert found["omega_bending"][:2] == pytest.approx(
        values(M3, "100")["omega_bending"][:2], rel=1e-8
    )


# -- what cannot be done ---------------------------------------------------------------------------


@pytest.mark.parametrize("module", FAMILIES.values())
def test_bad_arguments_are_named(module):
    bad(lambda: module.main("Q7"), "case", "'Q7'", next(iter(module.QUICK)))
    bad(lambda: module.main(data={"lenght": 2.0}), "data", "'lenght'")
    bad(lambda: module.main(elements=2.5), "elements", "2.5")


@pytest.mark.slow
def test_bad_data_is_named():
    bad(lambda: M1.main("h=-0.1,CF"), "h = '-0.1'")
    bad(lambda: M1.main("h=0.1,CX"), "ends", "'CX'")
    bad(lambda: M1.main(data={"kappa": "5/0"}), "kappa = '5/0'")
    bad(lambda: M1.main(elements=1, order=1), "elements")
    bad(lambda: M1.main(data={"modes": 2.5}), "modes", "positive integer")
    bad(lambda: M1.main(data={"modes": 500}, elements=4), "elements", "too few for 500")
    bad(lambda: M2.main("hub=0,eta=fast"), "eta = 'fast'")
    bad(lambda: M2.main(data={"slenderness": 0.0}), "slenderness = 0.0")
    bad(lambda: M3.main(data={"T": -1e12}), "T = -1e+12")
    bad(lambda: M4.main(data={"n": -1}), "n = -1")
    bad(lambda: M4.main("n=9", elements=4), "elements", "9 waves")
