"""Every example is imported without side effects, and its numbers are checked.

The numbers of the learning examples are compared with closed forms, plane geometry, conserved
quantities, or computations that share nothing with the package.
"""

import ast
import importlib.util
import re
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp
from scipy.optimize import brentq
from scipy.special import ellipk, spherical_jn

import skfem_cosserat as sc

FOLDER = Path(__file__).resolve().parents[2] / "examples"
EXAMPLES = sorted(FOLDER.glob("*.py"))
TABLE = (FOLDER / "README.md").read_text(encoding="utf-8").split("\nThree more files")[0]
LEARNING = [FOLDER / name for name in re.findall(r"^\| \[(\w+\.py)\]\(\1\)", TABLE, re.M)]


def load(name):
    path = FOLDER / f"{name}.py"
    spec = importlib.util.spec_from_file_location(f"example_{name}", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.one_quick
@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_import_has_no_side_effects(path, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    assert callable(load(path.stem).main)
    captured = capfd.readouterr()
    assert captured.out == ""
    assert list(tmp_path.iterdir()) == []


def test_the_table_of_learning_examples():
    assert len(LEARNING) == 21 and set(LEARNING) <= set(EXAMPLES)
    for path in LEARNING:
        assert 40 <= path.read_text(encoding="utf-8").count("\n") <= 120
    pictures = re.findall(r"\]\((pictures/\w+\.(?:png|gif))\)", TABLE)
    assert len(pictures) == 23
    for name in pictures:
        limit = 150_000 if name.endswith(".png") else 1_200_000
        assert (FOLDER / name).stat().st_size < limit


def test_learning_examples_use_public_names():
    """What somebody copies from them is to stay; scikit-fem alone needs a function of kernels."""
    for path in LEARNING:
        text = path.read_text(encoding="utf-8")
        assert path.stem == "skfem_alone" or "from skfem_cosserat" not in text
        nodes = [n for n in ast.walk(ast.parse(text)) if isinstance(n, ast.Attribute)]
        used = {n.attr for n in nodes if isinstance(n.value, ast.Name) and n.value.id == "sc"}
        assert used <= set(dir(sc))


def drawn(path):
    """Whether a picture was written."""
    return path.read_bytes()[:4] == b"\x89PNG" and path.stat().st_size > 5000


# -- motion ----------------------------------------------------------------------------------------


@pytest.mark.slow
def test_rod_with_ball_keeps_its_energy(tmp_path):
    result = load("rod_with_ball").main(10, 5e-3, 0.5, paraview=tmp_path / "rod")
    assert result["drift"] < 1e-9
    assert -1.1 < result["height"][-1] < -0.9
    assert {"beams.pvd", "bodies.pvd"} <= {path.name for path in (tmp_path / "rod").iterdir()}


@pytest.mark.slow
def test_a_stiff_rod_with_its_ball_is_a_physical_pendulum():
    """From the horizontal to the vertical: a quarter of the period of a pendulum let go at 90."""
    rod = 1100 * np.pi * 0.01**2
    inertia = rod / 3 + rod * 0.01**2 / 4 + 0.05 * (1 + 0.4 * 0.02**2)
    quarter = ellipk(0.5) * np.sqrt(inertia / (9.81 * (rod / 2 + 0.05)))
    result = load("rod_with_ball").main(4, 2e-3, 0.6, modulus=2e10)
    lowest = result["times"][result["height"].argmin()]
    assert lowest == pytest.approx(quarter, abs=4e-3)
    assert result["height"].min() == pytest.approx(-1.0, abs=1e-4)


@pytest.mark.slow
def test_four_bar_linkage_closes_and_balances(tmp_path):
    result = load("four_bar_linkage").main(step=1e-2, out=tmp_path / "a.png")
    assert result["unknowns"] == 0
    assert result["closure"] < 1e-9 and result["balance"] < 1e-9
    assert result["crank"][-1] == pytest.approx(8.0, abs=1e-9)  # 6 * 4/3
    assert np.ptp(result["rocker"]) > 0.8
    assert drawn(tmp_path / "a.png")


@pytest.mark.slow
def test_shaken_mast_answers_with_its_first_frequency(tmp_path):
    """Frequency also by Rayleigh's quotient of a cantilever with a mass at its tip."""
    result = load("shaken_mast").main(step=2e-2, until=12.0, out=tmp_path / "a.png")
    assert result["peak"] == pytest.approx(result["frequency"], rel=0.015)  # the step: 0.8 %
    assert result["ratio"] == pytest.approx(0.01, rel=1e-6)
    assert result["decay"] == pytest.approx(0.01, rel=0.05)
    area, second = np.pi * (0.03**2 - 0.027**2), np.pi / 4 * (0.03**4 - 0.027**4)
    stiffness = 3 * 210e9 * second / 4.0**3
    mass = 5.0 + 33 / 140 * 7850 * area * 4.0
    assert result["frequency"] == pytest.approx(np.sqrt(stiffness / mass) / (2 * np.pi), rel=5e-3)
    assert drawn(tmp_path / "a.png")


@pytest.mark.slow
def test_events(tmp_path):
    """A chain that locks a joint and lets its ball go: energy and parabola to rounding."""
    result = load("events").main(out=tmp_path / "events.png")
    times, losses = result["times"], result["losses"]
    assert list(times) == ["motor off", "knee locks", "ball let go"]
    assert losses["knee locks"] > 0.1 > 1e6 * abs(losses["motor off"])
    assert result["balance"] < 1e-9 and result["parabola"] < 1e-11
    history = result["history"]
    row = history.events[1].row
    assert abs(history["joint/joint 2/angle"][row + 1 :]).max() < 1e-9
    assert abs(history["joint/joint 2/angle_rate"][row + 1 :]).max() < 1e-9
    assert drawn(tmp_path / "events.png")


@pytest.mark.slow
def test_own_items_slow_a_ball_on_a_slope(tmp_path):
    result = load("own_items").main(step=4e-2, out=tmp_path / "a.png")
    assert result["speed"] == pytest.approx(result["theory"], abs=0.02)
    assert result["speed"][-1] == pytest.approx(6.9521, abs=1e-3)
    assert result["balance"] < 1e-9 and result["off_plane"] < 1e-10
    assert drawn(tmp_path / "a.png")


@pytest.mark.slow
def test_simpler_models_do_the_same(tmp_path):
    result = load("no_more_than_needed").main(elements=4, until=0.3, out=tmp_path / "a.png")
    rows = {(row["theory"], row["planar"]): row for row in result["rows"]}
    full, flat = (rows["all strains", planar] for planar in (False, True))
    assert (full["unknowns"], flat["unknowns"]) == (6 * 4 + 1, 3 * 4 + 1)
    assert flat["difference"] < 1e-9
    assert rows["rigid", False]["unknowns"] == rows["rigid", True]["unknowns"] == 1
    order = ["no shear", "no shear, no stretching", "rigid"]
    differences = [rows[name, False]["difference"] for name in order]
    assert 0 < differences[0] < differences[1] < differences[2] < 1e-3
    assert drawn(tmp_path / "a.png")


# -- equilibria and vibrations ---------------------------------------------------------------------


def shot(load):
    """Tip of the elastica (length 1, EI = 1) by shooting for its angle: th'' = -P cos th."""

    def rod(moment):
        def slopes(s, y):
            return [y[1], -load * np.cos(y[0]), np.cos(y[0]), np.sin(y[0])]

        return solve_ivp(slopes, (0, 1), [0, moment, 0, 0], rtol=1e-11, atol=1e-12).y[:, -1]

    return rod(brentq(lambda moment: rod(moment)[1], 0, load))[2:]


@pytest.mark.slow
def test_clamped_bend_is_the_elastica(tmp_path):
    """P L^2/EI = 5, by elliptic integrals, elements, and shooting."""
    result = load("clamped_bend").main(elements=(8, 16), out=tmp_path / "a.png")
    assert result["exact"] == pytest.approx(shot(5.0), abs=1e-8)
    assert result["tip"] == pytest.approx(result["exact"], abs=1e-8)
    for order, slope in result["observed"].items():
        assert slope == pytest.approx(2 * order, abs=0.2)
    assert drawn(tmp_path / "a.png")


@pytest.mark.slow
def test_column_buckles_and_goes_on_as_an_elastica(tmp_path):
    """P/P_c = (2 K(sin(a/2))/pi)^2 with the slope a of the tip, but for shear and extension."""
    result = load("buckling_column").main(out=tmp_path / "a.png")
    assert result["critical"] == pytest.approx(result["theory"], rel=1e-7)
    assert result["theory"] == pytest.approx(np.pi**2 * 20 / 4, rel=1e-3)
    elastica = np.pi**2 * 20 / 4 * (2 / np.pi * ellipk(np.sin(result["slope"] / 2) ** 2)) ** 2
    assert result["bent_load"] == pytest.approx(elastica, rel=2e-3)
    assert result["side"].max() > 0.5
    straight = result["straight_load"] < result["critical"] - 1e-6
    assert (result["squares"]["straight"][straight] > 0).all()
    assert (result["squares"]["straight"][~straight] < 1e-3).all()
    assert (result["squares"]["bent"][2:] > 0).all()
    assert drawn(tmp_path / "a.png")


@pytest.mark.slow
def test_turning_blade_vibrates_as_ritz_and_southwell_have_it(tmp_path):
    example = load("turning_blade")
    speeds = np.array([0, 2, 12])
    result = example.main(speeds, out=tmp_path / "a.png", paraview=tmp_path / "mode")
    assert result["flap"] == pytest.approx(result["ritz"], rel=2e-5)
    assert result["ritz"][0] == pytest.approx([1.87510407**2, 4.69409113**2], rel=1e-7)
    squares = result["flap"] ** 2 - speeds[:, None] ** 2
    assert result["lag"] ** 2 == pytest.approx(squares, rel=1e-4)
    first = result["flap"][:, 0] ** 2 - result["flap"][0, 0] ** 2
    assert (first >= 1.0 * speeds**2).all()  # Southwell: from below, a rope without bending
    assert drawn(tmp_path / "a.png")
    assert (tmp_path / "mode" / "beams.pvd").is_file()


@pytest.mark.slow
def test_frame_from_a_file_against_linear_theory(tmp_path):
    example = load("frame_from_gmsh")
    result = example.main(force=1e-2, steps=1)
    assert result["beams"] == ["flange", "web"]
    assert result["displacement"][-1] == pytest.approx(result["linear"][-1], rel=1e-6)
    EI = 210e9 * 0.012**4 / 12  # the moment turns the junction against both halves of the flange
    assert result["turn"][-1] == pytest.approx(1e-2 / (8 * EI), rel=2e-3)
    bent = example.main(steps=4, out=tmp_path / "a.png")
    assert bent["displacement"][-1] < 0.9 * bent["linear"][-1]
    assert drawn(tmp_path / "a.png")


@pytest.mark.slow
def test_channel_twists_unless_the_force_acts_at_its_shear_centre(tmp_path):
    result = load("channel_section").main(elements=2, out=tmp_path / "a.png")
    assert result["twist"] == pytest.approx(result["theory"], abs=2e-3 * abs(result["twist"]).max())
    assert abs(result["twist"][3]) < 1e-3 * abs(result["twist"][1])
    # thin walls: e = 3 b^2 t_f/(h t_w + 6 b t_f) from the web, J = sum of b t^3/3
    b, h, t_f, t_w = 0.048, 0.095, 5e-3, 4e-3
    e = 3 * b**2 * t_f / (h * t_w + 6 * b * t_f)
    assert -result["shear_centre"][0] == pytest.approx(e, rel=0.05)
    J = (2 * b * t_f**3 + h * t_w**3) / 3
    assert result["GJ"] == pytest.approx(210e9 / 2.6 * J, rel=0.1)
    assert drawn(tmp_path / "a.png")


@pytest.mark.slow
def test_rope_hangs_in_a_catenary_and_turns_in_the_wind(tmp_path):
    example = load("hanging_cable")
    coarse, fine = example.main(10), example.main(20, out=tmp_path / "a.png")
    errors = [abs(each["sag"] - each["catenary_sag"]).max() for each in (coarse, fine)]
    assert errors[1] < 6e-4 and errors[0] / errors[1] == pytest.approx(4, rel=0.05)
    assert fine["horizontal"][0] == pytest.approx(fine["catenary_horizontal"], rel=1e-3)
    total = np.hypot(9.81, fine["wind"]) / 9.81  # gravity and wind together
    assert fine["horizontal"] / fine["horizontal"][0] == pytest.approx(total, rel=1e-3)
    assert fine["angle"] == pytest.approx(np.arctan2(fine["wind"], 9.81), abs=1e-9)
    a = fine["catenary_horizontal"] * 1.3 / (0.5 * 9.81)
    arc = quad(lambda x: np.cosh((x - 0.5) / a), 0, 1)[0]
    assert arc == pytest.approx(1.3, rel=1e-9)
    assert drawn(tmp_path / "a.png")


# -- gallery ---------------------------------------------------------------------------------------


@pytest.mark.slow
def test_driven_arm_swings_on_unless_its_turn_takes_the_right_time():
    """One vibration of a cantilever with a ball at its end, by Euler-Bernoulli's equation."""
    EI, mass, ball, L = 70e9 * 0.04 * 0.003**3 / 12, 2700 * 0.04 * 0.003, 0.2, 1.2
    x, weights = (np.polynomial.legendre.leggauss(30) + np.array([[1], [0]])) / 2 * L

    def shape(k, x):
        kL = k * L
        ratio = (np.cos(kL) + np.cosh(kL)) / (np.sin(kL) + np.sinh(kL))
        return np.cosh(k * x) - np.cos(k * x) - ratio * (np.sinh(k * x) - np.sin(k * x))

    def shear(kL):
        both = 1 + np.cos(kL) * np.cosh(kL)
        return both - ball / (mass * L) * kL * (np.sin(kL) * np.cosh(kL) - np.cos(kL) * np.sinh(kL))

    k = brentq(shear, 0.5, 1.875) / L
    omega = k**2 * np.sqrt(EI / mass)
    w, tip = shape(k, x), shape(k, L)
    moved = mass * (weights @ (x * w)) + ball * L * tip
    swing = tip * moved / (mass * (weights @ w**2) + ball * tip**2)
    result = load("driven_arm").main(angle=0.1)
    assert result["omega"] == pytest.approx(omega, rel=2e-3)
    z = omega * result["durations"]["hasty"] / 2
    left = 0.1 * swing * 15 * spherical_jn(2, z) / z**2
    assert result["hasty"] == pytest.approx(abs(left), rel=0.02)
    assert result["tuned"] < 0.02 * result["hasty"]


@pytest.mark.slow
def test_load_of_the_crane_is_a_pendulum():
    result = load("slewing_crane").main(angle=0.1, until=12.0)
    assert result["tension"] == pytest.approx(400 * 9.81, rel=1e-9)
    assert result["length"] == pytest.approx(4.0 + 400 * 9.81 / 5e5, rel=1e-9)
    period = 2 * np.pi * np.sqrt(result["length"] / 9.81)
    assert result["period"] == pytest.approx(period, rel=0.01)  # the jib gives way a little


@pytest.mark.slow
def test_rotor_pulls_its_blades_straight():
    """Droop at rest of a clamped beam, centrifugal force, and the spin of hub and blades."""
    result = load("spinning_rotor").main()
    mass, a, R, speed = 2700 * 0.25 * 0.016, 0.3, 4.0, 6.0
    sag = mass * 9.81 * (R - a) ** 4 / (8 * 70e9 * 0.25 * 0.016**3 / 12)
    assert result["droop"][0] == pytest.approx(sag, rel=0.01)
    assert result["droop"][1] < 0.5 * sag
    pull = mass * speed**2 * (R**2 - a**2) / 2
    assert result["pull"] == pytest.approx(pull, rel=5e-3)
    inertia = 60 * a**2 / 2 + mass * (R**3 - a**3 + (R - a) * 0.25**2 / 4)
    assert result["momentum"] == pytest.approx(inertia * speed, rel=2e-3)
    assert result["balance"] < 1e-9


@pytest.mark.slow
def test_supports_carry_the_bridge_and_its_truck(renderer, tmp_path):
    result = load("stayed_bridge").main(positions=9, out=tmp_path / "a.gif")
    assert (tmp_path / "a.gif").read_bytes()[:4] == b"GIF8"
    assert result["up"] == pytest.approx(result["dead"] + 4e5, rel=1e-9)
    lever = 60 * result["dead"] + 4e5 * result["place"]
    assert result["lever"] == pytest.approx(lever, rel=1e-4)  # what stands moves by millimetres
    assert result["sag"] == pytest.approx(result["sag"][::-1], abs=1e-3 * result["sag"].max())
    assert result["slackest"] > 0


@pytest.mark.slow
def test_ring_unfolds_as_its_geometry_has_it():
    result = load("deployable_ring").main(step=4e-2, until=2.0)
    assert result["radius"] == pytest.approx(result["theory"], rel=3e-3)
    assert np.ptp(result["radius"]) > 0.7 and result["off_ray"] < 1e-5
    assert result["momentum"] < 1e-10
    assert result["dissipated"] == pytest.approx(result["released"], rel=1e-9)


@pytest.mark.slow
def test_fishing_rod_droops_as_a_tapered_cantilever():
    """Its own weight and that of the lure, by the principle of virtual work."""
    result = load("fishing_rod").main(lure=1e-3, rising=0.0, until=0.2)
    L = 2.4

    def area(s):
        return np.pi * (8e-3 - 6e-3 * s / L) ** 2

    def bent(s):
        M = quad(lambda x: 700 * 9.81 * area(x) * (x - s), s, L)[0] + 1e-3 * 9.81 * (L - s)
        return M * (L - s) / (15e9 * area(s) ** 2 / (4 * np.pi))

    assert result["droop"] == pytest.approx(quad(bent, 0, L)[0], rel=5e-3)
    assert result["balance"] < 1e-9


# -- scikit-fem, studies, batches ------------------------------------------------------------------


def test_cantilever_of_scikit_fem_alone():
    """Tip force, against Timoshenko's closed form: exact at the nodes."""
    result = load("skfem_alone").main()
    assert result["tip"] == pytest.approx(result["theory"], rel=1e-9)


def test_cantilever_on_an_elastic_foundation():
    """A form of the user's own adds to ours; closed form of Hetenyi without shear."""
    k, EI, P, L = 1e4, 210e9 * np.pi * 0.01**4 / 4, 100.0, 1.0
    b = (k / (4 * EI)) ** 0.25
    x = b * L
    shape = (np.sinh(x) * np.cosh(x) - np.sin(x) * np.cos(x)) / (np.cosh(x) ** 2 + np.cos(x) ** 2)
    tip = load("skfem_alone").main(elements=16, foundation=k)["tip"]
    assert tip == pytest.approx(2 * P * b / k * shape, rel=5e-4)


@pytest.mark.slow
def test_refinement_study(tmp_path):
    """Orders 2p in statics; a load that is there at once leaves none, one that grows does."""
    found = load("refinement_study").main(steps=(4e-3, 2e-3, 1e-3, 5e-4), out=tmp_path)
    for order in (1, 2, 3, 4):
        for name in ("tip", "energy"):
            assert abs(found["bend"].orders[f"{name}, order = {order}"].order - 2 * order) < 0.1
    for name in ("ball", "strain energy"):
        assert "not in the asymptotic range" in found["swing_sudden"].verdicts[name]
        assert abs(found["swing_growing"].orders[name].order - 2) < 0.1
        error, doubt = found["swing_growing"].estimate[name]
        assert 0 < doubt < 0.1 * error
    names = {f"refinement_{name}.csv" for name in ("bend", "swing_sudden", "swing_growing")}
    assert names <= {path.name for path in tmp_path.iterdir()}


@pytest.mark.slow
def test_a_batch_of_runs_here():
    """The last one fails at its blow; the processes are in tests/test_parallel.py."""
    result = load("parallel_runs").main("serial", count=2, elements=4, until=0.02)
    assert result["identical"] and result["failed"] == ["E = 15 MPa"]
    first, last = result["rows"]
    assert first[3] is None and "could not be solved" in last[3]
    assert first[1] == pytest.approx(-9.81 * 0.02**2 / 2, rel=0.05)  # the ball falls freely
