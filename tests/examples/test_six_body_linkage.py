"""The paper's rigid example: counts, closed form, conservation, conditioning, bad input, output."""

import json
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from helpers_scenes import chequered

import skfem_cosserat as sc

ROOT = Path(__file__).resolve().parents[2]
PATH = ROOT / "examples" / "six_body_linkage.py"
sys.path.insert(0, str(PATH.parent))

import six_body_linkage as six  # noqa: E402

INTEGRATORS = ("variational", "energy-momentum")
TREATMENTS = ("null-space", "multipliers")
PAIRS = [(i, t) for i in INTEGRATORS for t in TREATMENTS]
pairs = chequered("integrator", INTEGRATORS, "treatment", TREATMENTS)
#: R4 of the reference problems: P3 at eight times, 8 digits
R4 = json.loads((ROOT / "tests" / "data" / "rigid_references.json").read_text())["R4"]
TIMES, P3 = np.array(R4["t"]), np.array(R4["P3"])


@pytest.fixture(scope="module")
def five_seconds():
    """500 steps of all four pairs: system, histories, results."""
    system = six.build()
    histories = {
        (i, t): sc.simulate(
            system, six.INTEGRATORS[i](), six.TREATMENTS[t](), 1e-2, 5.0, derive=False
        )
        for i, t in PAIRS
    }
    results = {pair: six.evaluate(system, h, np.pi / 2) for pair, h in histories.items()}
    return system, histories, results


@pytest.mark.slow
@pytest.mark.parametrize(("treatment", "unknowns"), [("null-space", 1), ("multipliers", 143)])
def test_counts(treatment, unknowns):
    assert six.build().counts() == {"n": 72, "m": 72, "rank": 71, "unknowns": 1}
    result = six.main(treatment=treatment, until=0.02)
    assert (result["n"], result["m_rows"], result["rank"]) == (72, 72, 71)
    assert result["unknowns"] == unknowns
    assert result["diverged_at"] is None and result["P3"][0].tolist() == [1, -1, 1]


# -- 500 steps -------------------------------------------------------------------------------------


@pytest.mark.slow
def test_treatments_agree(five_seconds):
    _, histories, _ = five_seconds
    for integrator in INTEGRATORS:
        a, b = (histories[integrator, treatment]["q"] for treatment in TREATMENTS)
        assert abs(a - b).max() < 1e-9


@pytest.mark.slow
def test_closed_form(five_seconds):
    """Over the whole run; that of another twist does not hold."""
    for pair, result in five_seconds[2].items():
        assert result["closure"].max() < 1e-11, pair
        assert result["constraint_violation"].max() < 1e-12
        x, y = result["joint_angles"][:, 0], result["joint_angles"][:, 1]
        assert abs(six.relation(1.5, x, y)).max() > 0.1


@pytest.mark.slow
def test_joint_angles_against_the_joints_own_coordinates(five_seconds):
    """The angles from rod to rod, less their start, are the relative coordinates of the joints."""
    system, _, results = five_seconds
    history = sc.simulate(system, sc.Variational(), sc.NullSpace(), 1e-2, 1.0)
    series = np.column_stack([history[f"joint/P{k}/angle"] for k in range(6)])
    angles = results["variational", "null-space"]["joint_angles"][:101]
    assert abs(series - (angles - angles[0])).max() < 1e-12


@pytest.mark.slow
def test_energy(five_seconds):
    """Energy-momentum to 1e-10 J; variational within O(h^2), and back where it started."""
    for (integrator, treatment), result in five_seconds[2].items():
        assert result["energy"][0] == pytest.approx(-3 * 9.81, abs=1e-12)  # six rods, rest
        if integrator == "energy-momentum":
            assert np.ptp(result["energy"]) < 1e-10, treatment
        else:
            coarse = six.main(integrator, "multipliers", 2e-2, 5.0)
            ratio = np.ptp(coarse["energy"]) / np.ptp(result["energy"])
            assert ratio == pytest.approx(4, abs=0.05)
            assert abs(result["energy"][-1] - result["energy"][0]) < 1e-7
        assert abs(result["energy_midpoint"] - result["energy"][0]).max() < 0.01


@pytest.mark.slow
def test_motion_from_rest_to_rest(five_seconds):
    """P0, P2, P4 swing between -90 and 90 degrees, the others between -90 and -120, and back."""
    for result in five_seconds[2].values():
        assert abs(result["P3"][-1] - (1, -1, 1)).max() < 1e-4
        angles = np.degrees(result["joint_angles"])
        assert abs(angles - np.tile(angles[:, :2], 3)).max() < 1e-9
        assert np.ptp(angles[:, 0]) == pytest.approx(180, abs=0.01)
        assert angles[:, 1].min() == pytest.approx(-120, abs=0.01)


# -- reference -------------------------------------------------------------------------------------


def converge(integrator, treatment, until):
    """Errors of three levels against R4, and of their limit, at the times up to `until`."""
    times = TIMES[until >= TIMES]
    levels = []
    for h in (0.05, 0.025, 0.0125):
        result = six.main(integrator, treatment, h, until)
        levels.append(result["P3"][np.rint(times / h).astype(int)])
    limits = [(4 * b - a) / 3 for a, b in pairwise(levels)]
    limit = (16 * limits[1] - limits[0]) / 15
    errors = [np.linalg.norm(level - P3[: len(times)], axis=1) for level in levels]
    return errors, abs(limit - P3[: len(times)]).max()


@pytest.mark.slow
@pairs
def test_reference(integrator, treatment):
    errors, miss = converge(integrator, treatment, 2.0)
    for a, b in pairwise(errors):
        assert (abs(a / b - 4) < 0.1).all()
    assert miss < 1e-8


@pytest.mark.slow
def test_reference_over_ten_seconds():
    """At 5 and 10 s P3 turns: its error there is the square of one in phase, and no measure."""
    errors, miss = converge("energy-momentum", "multipliers", 10.0)
    moving = ~np.isin(TIMES, (5.0, 10.0))
    for a, b in pairwise(errors):
        assert (abs(a / b - 4)[moving] < 0.1).all()
    assert miss < 2e-8


# -- other linkages of the family ------------------------------------------------------------------


@pytest.mark.slow
def test_start_angle_against_the_closed_form():
    """Found by closing the chain; it closes exactly where the closed form has a root."""
    rng = np.random.default_rng(1)
    closed = 0
    for twist, x in rng.uniform(-np.pi, np.pi, (40, 2)):
        c, s2 = np.cos(twist), np.sin(twist) ** 2
        amplitude = np.hypot(s2 + (1 + c**2) * np.cos(x), 2 * c * np.sin(x))
        if abs(c**2 + s2 * np.cos(x)) > amplitude:
            with pytest.raises(ValueError, match=r"cannot close .* m apart"):
                six.closing_angle(twist, x)
            continue
        closed += 1
        assert abs(six.relation(twist, x, six.closing_angle(twist, x))) < 1e-13
    assert 20 < closed < 40


@pytest.mark.slow
@pytest.mark.parametrize(
    ("twist", "angle"), [(0.3, -1.02), (2.0, -1.88), (-0.7, -1.14), (4.0, -2.13)]
)
def test_twisted(twist, angle):
    result = six.main("energy-momentum", "null-space", 1e-2, 0.5, twist, angle)
    assert (result["rank"], result["unknowns"]) == (71, 1)
    angles = result["joint_angles"]
    start = np.angle(np.exp(1j * (angles[0] - angle)))
    assert abs(start[::2]).max() < 1e-12
    assert np.ptp(angles, axis=0).max() > 1e-3  # it moves
    assert result["closure"].max() < 1e-11
    assert abs(six.relation(twist + 0.1, angles[:, 0], angles[:, 1])).max() > 1e-3
    assert np.ptp(result["energy"]) < 1e-10


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")  # passes a singular position
@pairs
def test_through_the_singular_position_of_sixty_degrees(integrator, treatment):
    """All rods fold onto a triangle where x = y = 180 degrees, and two motions meet there.

    The linkage passes on along its own: threefold symmetric, closed form and energy kept.
    """
    result = six.main(integrator, treatment, 1e-2, 2.5, np.pi / 3, 0.67)
    angles = result["joint_angles"]
    crossed = angles[:, 0].min() < np.pi < angles[:, 0].max()
    assert crossed and result["diverged_at"] is None
    assert abs(angles - np.tile(angles[:, :2], 3)).max() < 1e-9
    assert result["closure"].max() < 1e-11
    if integrator == "energy-momentum":
        assert np.ptp(result["energy"]) < 1e-10


@pytest.mark.slow
def test_start_in_the_singular_position():
    """Two motions of the family meet there; a warning says so, and one of them is taken."""
    words = "closed loop through the revolute joint 'P0'.*: the reference .* is a singular position"
    with pytest.warns(sc.ModelWarning, match=words), pytest.warns(sc.AccuracyWarning):
        result = six.main(until=0.5, twist=np.pi / 3, angle=np.pi)
    assert (result["rank"], result["unknowns"]) == (71, 1)
    assert result["closure"].max() < 1e-11
    assert np.ptp(result["joint_angles"][:, 0]) > 0.1


# -- condition numbers -----------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_condition_numbers(integrator):
    """Table 1: growth with h^-3 with multipliers, one by one with the null space."""
    steps = (1e-2, 1e-3, 1e-4)
    table = {
        scaled: [six.condition_number(integrator, "multipliers", h, scaled) for h in steps]
        for scaled in (False, True)
    }
    for scaled, values in table.items():
        slopes = np.diff(np.log10(values))
        assert (abs(slopes - (0 if scaled else 3)) < 0.1).all()
    assert max(table[True]) < 100
    for h in steps:
        assert six.condition_number(integrator, "null-space", h, steps=[1, 5]) == 1.0


# -- bad input, output -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"integrator": "newmark"}, r"integrator = 'newmark', expected one of"),
        ({"step": -1e-2}, r"step = -0.01"),
        ({"until": "long"}, r"until = 'long'"),
        ({"twist": 0.0}, r"argument twist: 0 rad, its axes are parallel"),
        ({"twist": np.nan}, r"argument twist: nan"),
        ({"twist": 1.0, "angle": "x"}, r"argument angle: 'x'"),
        ({"angle": np.pi}, r"cannot close with twist = 1.5708 rad and angle = 3.14159 rad"),
    ],
)
def test_bad_input(arguments, message):
    with pytest.raises(ValueError, match=message):
        six.main(**arguments)


@pytest.mark.parametrize("steps", [[], "12", [0]])
def test_bad_condition_steps(steps):
    with pytest.raises(ValueError, match="expected positive step numbers"):
        six.condition_number("variational", "multipliers", 1e-2, steps=steps)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:balance of energy")  # steps are too large
def test_a_step_that_cannot_be_solved():
    result = six.main("variational", "multipliers", 0.5)
    assert 0 < result["diverged_at"] < 10 and len(result["times"]) < 21
    assert "could not be solved" in result["divergence_reason"]


@pytest.mark.slow
def test_command_line_and_files(tmp_path):
    """Runs as a script; history, ParaView series and charts are there."""
    out = tmp_path / "results"
    command = [sys.executable, str(PATH), "--until", "0.05", "--out", str(out)]
    run = subprocess.run(command, capture_output=True, text=True, check=True, timeout=120)
    assert "72 constraint rows of rank 71" in run.stdout and "1 unknowns" in run.stdout
    names = {path.name for path in out.iterdir()}
    assert {"bodies.pvd", "joints.pvd", "six_body_linkage.history"} <= names
    history = sc.History.load(out / "six_body_linkage.history")
    assert history["joint_angles"].shape == (6, 6)
