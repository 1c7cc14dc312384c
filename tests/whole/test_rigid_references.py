"""Rigid multibody problems R1 to R8 against reference solutions: second order and its limit.

The numbers in data/rigid_references.json are own computations with other methods (Taylor series
in extended precision, or an explicit Runge-Kutta method of order 8) and closed forms. Each is
reached by Richardson extrapolation over levels of halved steps, on which the error falls by 4.
R4, the six-body linkage, is in test_six_body_linkage.py; there is no R7.
"""

import json
import warnings
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import skfem_cosserat as sc
from collection import motion
from collection import r01_pendulum as pendulum
from collection import r02_top as top
from collection import r03_free_body as free
from collection import r05_four_bars as four_bars
from collection import r06_squeezer as andrews
from collection import r08_chain as rods
from skfem_cosserat import diagnostics
from skfem_cosserat.kernels import exp_quaternion, rotation_matrix

DATA = json.loads((Path(__file__).parents[1] / "data" / "rigid_references.json").read_text())
#: each integrator and each treatment once, in the two ways there are
STRAIGHT = [(sc.Variational, sc.NullSpace), (sc.EnergyMomentum, sc.Multipliers)]
CROSSED = [(sc.Variational, sc.Multipliers), (sc.EnergyMomentum, sc.NullSpace)]
straight, crossed = (
    pytest.mark.parametrize(("integrator", "treatment"), pairs) for pairs in (STRAIGHT, CROSSED)
)
GRAVITY = (0, 0, -9.81)
E3 = np.array([0.0, 0.0, 1.0])


def romberg(levels):
    """Limit of values at steps h, h/2, h/4 ..., whose error has even powers of h."""
    for k in range(1, len(levels)):
        levels = [b + (b - a) / (4**k - 1) for a, b in pairwise(levels)]
    return levels[0]


def converge(system, pair, h, times, seen, reference, *, levels=3, target=1e-7, **options):
    """Order 2 +- 0.1 on all levels from step h on, and their limit against the reference.

    `seen` gives (states, k) of a history, `reference` is (times, k). Gives the limit.
    """
    integrator, treatment = pair
    results = []
    for level in range(levels):
        run = integrator(), treatment(), h / 2**level, times[-1]
        history = sc.simulate(system, *run, **{"at": times, **options})
        ids = [int(np.argmin(abs(history.times - t))) for t in times]
        np.testing.assert_allclose(history.times[ids], times, rtol=1e-12)
        results.append(seen(history)[ids])
    errors = np.linalg.norm(np.array(results) - reference, axis=2)
    order = np.log2(errors[:-1] / errors[1:])
    assert (abs(order - 2) < 0.1).all(), order
    limit = romberg(results)
    miss = np.linalg.norm(limit - reference, axis=1) / np.linalg.norm(reference, axis=1)
    assert (miss < target).all(), miss
    return limit


def directors_and_rates(row):
    """Rows d1, d2, d3 as nine numbers, then the angular velocity in space, from a table's row."""
    R = rotation_matrix(np.array(row[:4])[None])[0]
    return np.concatenate([R.T.ravel(), R @ row[4:]])


def seen_directors_and_rates(history):
    """The same of a run; angular velocity from projected velocities, sum d_i x d_i' / 2."""
    d = history["q"][:, 3:12].reshape(-1, 3, 3)
    rates = history["v"][:, 3:12].reshape(-1, 3, 3)
    return np.c_[history["q"][:, 3:12], 0.5 * np.cross(d, rates).sum(1)]


# -- R1: spherical pendulum ------------------------------------------------------------------------

R1 = np.array(DATA["R1"]["state"])
START, SPEED = (np.array(pendulum.DATA[name]) for name in ("x0", "v0"))


def seen_bob(history):
    return np.c_[history["q"], history["v"]]


@pytest.mark.slow
@straight
def test_spherical_pendulum(integrator, treatment):
    system, pair = pendulum.scene(), (integrator, treatment)
    converge(system, pair, 1 / 40, [1.0, 2.0], seen_bob, R1[:2])


@pytest.mark.slow
def test_spherical_pendulum_for_ten_seconds():
    converge(pendulum.scene(), CROSSED[0], 1 / 80, DATA["R1"]["t"], seen_bob, R1)


@pytest.mark.slow
def test_spherical_pendulum_as_a_body():
    """A body of length (J + m l^2)/(m l) = 1 without spin moves as the bob does: l = 3/4."""
    model = sc.Model()
    body = sc.RigidBody(
        1.0,
        euler=(0.01, 0.01, 0.1775),
        position=0.75 * START,
        triad=sc.triad(-START, (0, 1, 0)),
        velocity=0.75 * SPEED,
        angular_velocity=np.cross(START, SPEED),
    )
    model.add("body", body)
    model.add("pin", sc.JointSpherical(sc.ground((0, 0, 0)), body.at((0, 0, 0))))
    model.add("gravity", sc.LoadGravity(GRAVITY))

    def seen(history):
        return np.c_[history["q"][:, :3], history["v"][:, :3]] / 0.75

    converge(model.freeze(), CROSSED[1], 1 / 40, [1.0, 2.0], seen, R1[:2])


# -- R2: heavy top ---------------------------------------------------------------------------------

R2 = np.array([directors_and_rates(row) for row in DATA["R2"]["state"]])
#: centre of mass at d2, and angular velocity in space
AXIS = [3, 4, 5, 9, 10, 11]


def seen_axis(history):
    return seen_directors_and_rates(history)[:, AXIS]


@pytest.mark.slow
@crossed
def test_heavy_top_at_the_first_time(integrator, treatment):
    """With the whole triad, which turns by 15 rad about the axis of the top until then."""
    pair = (integrator, treatment)
    converge(top.scene(), pair, 1e-3, [0.1], seen_directors_and_rates, R2[:1])


@pytest.mark.slow
def test_heavy_top():
    """Without the spin's phase, which needs finer steps."""
    times = DATA["R2"]["t"][:2]
    converge(top.scene(), STRAIGHT[1], 1 / 600, times, seen_axis, R2[:2, AXIS])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("pair", "name", "times"),
    [(STRAIGHT[0], "slow", [0.2, 0.4]), (STRAIGHT[1], "fast", [0.1, 0.2])],
)
def test_steady_precession(pair, name, times):
    rate = float(DATA["R2 steady precession"][name])
    system = top.steady(rate)
    axis = np.array([np.sin(0.5), 0.0, np.cos(0.5)])
    assert top.precession()[name] == pytest.approx(rate, rel=1e-14)
    turns = rotation_matrix(exp_quaternion(np.outer(times, (0, 0, rate))))
    h = times[0] / 25
    converge(system, pair, h, times, lambda history: history["q"][:, 9:12], turns @ axis)


# -- R3: free rigid body ---------------------------------------------------------------------------

R3 = np.array([directors_and_rates(row) for row in DATA["R3"]["state"]])


@pytest.mark.slow
@straight
def test_free_body(integrator, treatment):
    pair = (integrator, treatment)
    converge(free.scene(), pair, 1 / 25, [1.0, 2.0], seen_directors_and_rates, R3[:2])


@pytest.mark.slow
def test_free_body_for_twenty_seconds():
    times, count = DATA["R3"]["t"][:5], 4
    converge(
        free.scene(), CROSSED[0], 1 / 25, times, seen_directors_and_rates, R3[:5], levels=count
    )


@pytest.mark.slow
def test_first_order_start_would_be_seen():
    """Negative: a momentum that is off by O(h) at the start spoils the ratio of 4."""
    system = free.scene()
    errors = []
    for n in (50, 100):
        p = sc.initial_state(system).p
        start = sc.initial_state(system, p=p * (1 + 0.1 / n))
        history = sc.simulate(
            system, sc.Variational(), sc.NullSpace(), 1 / n, 1.0, start=start, at=[1.0]
        )
        errors.append(abs(history["q"][-1, 3:12] - R3[0, :9]).max())
    assert errors[0] / errors[1] < 3


# -- R5: four-bar windows through singular positions -----------------------------------------------

R5 = np.array(DATA["R5"]["phi_omega"])
WINDOWS = 2


def windows(angle=0.0, gravity=9.81):
    """Energy of the reference, 3/2 rate^2 + 7/2 g cos(angle), is that of these thin rods."""
    return four_bars.scene({"N": WINDOWS, "phi": angle, "g": gravity})


def column_angles(system, q):
    """From the vertical, clockwise, continued from state to state: (N, 3)."""
    axes = [q[:, system.frame_place(f"column {k}") + 9 + np.arange(3)] for k in range(WINDOWS + 1)]
    return np.column_stack([np.unwrap(np.arctan2(d[:, 0], d[:, 1])) for d in axes])


def nearest(angles, reference):
    """Angles less the whole turns by which they differ from the reference."""
    return angles - 2 * np.pi * np.rint((angles - reference) / (2 * np.pi))


def converge_windows(pair, h, times, **options):
    system = windows()
    assert system.counts() == {"n": 60, "m": 65, "rank": 59, "unknowns": 1}
    reference = R5[: len(times)]
    place = system.frame_place("column 0") + 9

    def seen(history):
        d, rates = (history[name][:, place : place + 2] for name in "qv")
        angle = np.arctan2(d[:, 0], d[:, 1])
        known = np.interp(history.times, [0, *times], [0, *reference[:, 0]])
        rate = rates[:, 0] * d[:, 1] - d[:, 0] * rates[:, 1]
        return np.c_[nearest(angle, known), rate]

    converge(system, pair, h, times, seen, reference, **options)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")  # passes singular positions
@pytest.mark.parametrize(
    ("pair", "until", "levels"), [(CROSSED[0], 2, 3), (STRAIGHT[1], 4, 4)], ids=["two", "four"]
)
def test_four_bar_windows(pair, until, levels):
    """Past two singular positions, and past four."""
    converge_windows(pair, 0.02, DATA["R5"]["t"][:until], levels=levels)


@pytest.mark.slow
def test_passing_several_rows_at_once_is_reported(caplog):
    """Both loops lie flat together: the sign of a determinant would not change."""
    passes = pytest.warns(sc.AccuracyWarning, match="has passed a singular position")
    with caplog.at_level("INFO", logger="skfem_cosserat"), passes:
        history = sc.simulate(windows(), sc.EnergyMomentum(), sc.NullSpace(), 0.02, 1.0)
    angle = column_angles(windows(), history["q"])[:, 0]
    passed = [r.getMessage() for r in caplog.records if "singular position" in r.getMessage()]
    flat = np.pi / 2 + np.pi * np.arange(10)
    assert len(passed) == (flat < angle[-1]).sum() > 0
    assert len(history.meta["warnings"]) == 1  # the first time


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")  # passes singular positions
@straight
def test_four_bar_windows_stay_parallelograms(integrator, treatment):
    """The branch is kept, and with energy-momentum the energy, at steps that hit no position."""
    system = windows()
    history = sc.simulate(system, integrator(), treatment(), 0.0213, 4.0, derive=False)
    q = history["q"]
    angles = column_angles(system, q)
    assert angles[-1, 0] > 3.5 * np.pi  # past four singular positions
    assert abs(angles - angles[:, :1]).max() < 1e-9
    energy = diagnostics.kinetic_energy(system, history["p"])
    energy += diagnostics.external_energy(system, q, history.times)
    amplitude = 7 * 9.81
    if integrator is sc.EnergyMomentum:
        assert np.ptp(energy) < 1e-10 * amplitude
    assert diagnostics.constraint_violation(system, q).max() < 1e-12


# the windows pass singular positions
@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")
@pytest.mark.parametrize(
    ("off", "integrator", "treatment"),
    [
        (off, *pair)
        for offs, pairs in (((0.0, 0.5 + 1e-6), CROSSED), ((0.5, 1e-6), STRAIGHT))
        for off in offs
        for pair in pairs
    ],
)
def test_four_bar_windows_at_singular_nodes_and_midpoints(integrator, treatment, off):
    """All rods on one line at a node (0) or the midpoint (0.5) of the tenth step, or nearly.

    Without gravity they turn uniformly. With multipliers the double root of the constraints shows:
    positions are determined to the square root of round-off only. So they are with compiled kernels
    1e-6 of a step beside such a position (1.5e-8 rad), not at it: plain kernels take that.
    """
    h, steps = 0.05, 20
    start = windows(gravity=0.0)
    first = sc.simulate(start, integrator(), sc.Multipliers(), h, h, derive=False)
    turn = column_angles(start, first["q"])[1, 0]
    system = windows(np.pi / 2 - (10 + off) * turn, gravity=0.0)
    history = sc.simulate(system, integrator(), treatment(), h, steps * h, derive=False)
    angles = column_angles(system, history["q"])
    expected = angles[0, 0] + turn * np.arange(steps + 1)
    apart = abs(angles - expected[:, None]).max()
    bound = 1e-10 if treatment is sc.NullSpace else 1e-5
    if treatment is sc.NullSpace and history.meta["kernels"] == "numba":
        bound = 1e-7  # compiled steps lose digits beside singular positions
    assert apart < bound


# the windows pass singular positions
@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")
@crossed
def test_four_bar_windows_start_in_a_singular_position(integrator, treatment):
    """A warning says so; mobility and motion are those of the parallelograms beside it."""
    ends = []
    for angle in (np.pi / 2, np.pi / 2 - 1e-6):
        with warnings.catch_warnings(record=True):
            warnings.simplefilter("always")
            system = windows(angle)
        said = [each["text"] for each in system.warnings]
        assert any("singular position" in text for text in said) == (angle == np.pi / 2)
        assert system.counts() == {"n": 60, "m": 65, "rank": 59, "unknowns": 1}
        history = sc.simulate(system, integrator(), treatment(), 0.02, 0.5, derive=False)
        angles = column_angles(system, history["q"])
        assert abs(angles - angles[:, :1]).max() < 1e-9
        ends.append(angles[-1, 0])
    assert np.diff(ends) == pytest.approx(0, abs=1e-5)


# -- R6: Andrews' squeezing mechanism --------------------------------------------------------------

R6 = np.array(DATA["R6"]["q"])


def squeezed(system, history):
    """(beta, Theta, gamma, Phi, delta, Omega, epsilon) of all states."""
    return andrews.read(motion.Track(system, history, np.arange(len(history))))["q"]


def converge_squeezer(pair, times, motor="actuator", levels=3):
    """As `converge`, with all states, for angles go on over turns."""
    system = andrews.scene(motor=motor)
    assert system.counts() == {"n": 84, "m": 92, "rank": 83, "unknowns": 1}
    run = {"levels": levels, "at": None, "derive": False}
    reference = R6[: len(times)]
    return converge(system, pair, 2e-4, times, lambda h: squeezed(system, h), reference, **run)


@pytest.mark.slow
def test_squeezer():
    converge_squeezer(STRAIGHT[1], [0.005, 0.01])


@pytest.mark.slow
def test_squeezer_with_its_torque_as_a_load():
    converge_squeezer(CROSSED[0], [0.005], "moment")


@pytest.mark.slow
def test_squeezer_to_the_end():
    """And against the value of the literature, whose own error is 1.4e-9."""
    limit = converge_squeezer(STRAIGHT[0], DATA["R6"]["t"], levels=4)
    assert abs(limit[-1] - DATA["R6"]["literature"]).max() < 3e-9


@pytest.mark.slow
def test_squeezer_energy_balance():
    """Energy-momentum: kinetic and spring energy grow by torque times angle."""
    system = andrews.scene()
    history = sc.simulate(system, sc.EnergyMomentum(), sc.NullSpace(), 1e-4, 0.01)
    turned = squeezed(system, history)[:, 0]
    work = DATA["R6"]["params"]["mom"] * (turned - turned[0])
    energy = history["kinetic"] + history["coupling_energy"]
    assert abs(energy - energy[0] - work).max() < 1e-10 * abs(energy).max()


# -- R8: chain of rods -----------------------------------------------------------------------------


def converge_chain(pair, count, until, h, **options):
    system = rods.scene({"N": count})
    data = DATA[f"R8 N={count}"]
    times = [t for t in data["t"] if t <= until]
    reference = np.array(data["state"])[: len(times)]

    def seen(history):
        d, rates = (history[name].reshape(len(history), count, 12)[:, :, 9:] for name in ("q", "v"))
        angle = np.arctan2(d[:, :, 1], d[:, :, 0])
        rate = d[:, :, 0] * rates[:, :, 1] - d[:, :, 1] * rates[:, :, 0]
        ids = [int(np.argmin(abs(history.times - t))) for t in times]
        angle[ids] = nearest(angle[ids], reference[:, :count])
        return np.c_[angle, rate]

    converge(system, pair, h, times, seen, reference, **options)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("pairs", "count", "until", "h"),
    [(CROSSED, 1, 2.0, 0.02), (STRAIGHT, 2, 1.0, 0.01), (CROSSED, 5, 0.5, 0.02)],
    ids=["1", "2", "5"],
)
def test_chain(pairs, count, until, h):
    for pair in pairs:
        converge_chain(pair, count, until, h)


@pytest.mark.slow
def test_chain_whose_motion_is_chaotic():
    """Two rods can be followed to 6 s with finer steps."""
    converge_chain(STRAIGHT[1], 2, 3.0, 2.5e-3)
