"""Flexible problems D1, D2, D3: orders in space and time, reference solutions, invariants.

The numbers are those of examples/benchmarks/collection/reference.json, own computations with
another discretisation; what is done with the scenes is that of
examples/benchmarks/dynamic_references.py.
"""

import json
from itertools import pairwise

import dynamic_references as dynamic
import dynamic_report as report
import numpy as np
import pytest

import skfem_cosserat as sc

slopes = dynamic.slopes

EM, VI = "energy-momentum", "variational"
scenes = pytest.mark.parametrize("name", dynamic.SCENES)
LARGE_STEPS = pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")
integrators = pytest.mark.parametrize("integrator", [EM, VI])


@pytest.fixture(scope="module")
def example(tmp_path_factory):
    """What the example's quick studies give."""
    return dynamic.main(quick=True, out=tmp_path_factory.mktemp("references"))


# -- orders, loads ramped smoothly ----------------------------------------------------------------


def mesh_orders(table, key):
    """Between the two finest meshes, by order of the elements."""
    return {p: slopes([1 / n for n in e["elements"]], e[key])[-1] for p, e in table.items()}


def check(found, expected, band):
    wrong = {p: x for p, x in found.items() if not abs(x - expected[p]) < band}
    assert not wrong, wrong


TWICE = {p: 2 * p for p in dynamic.ORDERS}


@pytest.mark.slow
@LARGE_STEPS
@integrators
@scenes
def test_order_in_space(example, name, integrator):
    """2 p in positions and triads of element ends; with energy-momentum in all.

    Velocities of order 4 reach the noise that the step leaves in them, those of D3 with any order.
    """
    table = example["space"][name, integrator]
    check(mesh_orders(table, "error"), TWICE, 0.3)
    if integrator == EM:
        check(mesh_orders(table, "energy"), TWICE, 0.3)
        velocity = mesh_orders(table, "velocity")
        assert velocity.pop(4) > 7
        if name != "D3":
            check(velocity, TWICE, 0.3)


@pytest.mark.slow
@LARGE_STEPS
@integrators
@scenes
def test_order_in_time_on_every_order_of_elements(example, name, integrator):
    for entry in example["time"][name, integrator].values():
        for key in ("error", "velocity"):
            found = slopes(entry["steps"], entry[key])[:-1]
            assert np.allclose(found, 2, rtol=0, atol=0.1), (key, found)


# -- loads as given: against the reference --------------------------------------------------------


@pytest.mark.slow
def test_loads_as_given_right_angle_cantilever():
    """Up to t = 2 with 8 cubic elements in a leg, and the energy that then stays."""
    found = dynamic.as_given("D2", EM, 3, 8, (1 / 40, 1 / 80, 1 / 160), 2.0)
    assert (found["position"] < [5e-7, 3e-6]).all(), found["position"]
    assert found["energy"][-1] < 1e-5, found["energy"]


@pytest.mark.slow
def test_loads_as_given_spaghetti():
    found = dynamic.as_given("D3", VI, 4, 8, (1 / 40, 1 / 80, 1 / 160), 2.5)
    assert (found["position"] < 4e-5).all(), found["position"]


@pytest.mark.slow
def test_loads_as_given_pendulum():
    found = dynamic.as_given("D1", EM, 4, 16, (1 / 1600,), 0.2)
    assert (found["position"] < 5e-6).all(), found["position"]


@pytest.mark.slow
def test_kinks_of_the_load_leave_positions_but_not_velocities_their_order():
    """Negative: the step is far above the period of the waves that start at the kinks."""
    scene = dynamic.cantilever(4, 1)
    runs = [dynamic.motion(scene, VI, 1 / n, [2.0]) for n in (40, 80, 160, 320)]
    orders = {}
    for key in ("positions", "velocities"):
        values = [getattr(run, key) for run in runs]
        steps = np.array([np.linalg.norm(b - a) for a, b in pairwise(values)])
        orders[key] = np.log2(steps[:-1] / steps[1:])
    assert (abs(orders["positions"] - 2) < 0.1).all()
    assert orders["velocities"][-1] < 1


# -- invariants -----------------------------------------------------------------------------------


@pytest.mark.slow
@integrators
def test_spaghetti_momentum_and_centre_of_mass(integrator):
    """50 along e1 and x = 3 + 5 (t - 2.5) from t = 5 on; angular momentum constant."""
    system = dynamic.spaghetti(8, 2).system
    history = sc.simulate(system, dynamic.INTEGRATORS[integrator](), sc.NullSpace(), 0.05, 10.0)
    free = history.times > 5 - 1e-9
    p = history["linear_momentum"][free]
    np.testing.assert_allclose(p, np.broadcast_to([50, 0, 0], p.shape), rtol=0, atol=1e-9)
    weights = np.asarray(system.mass[::4][:, ::4].sum(0)).ravel()
    assert weights.sum() == pytest.approx(10, rel=1e-13)
    centre = weights @ history["q"].reshape(len(history), -1, 12)[free, :, :3] / 10
    t = history.times[free]
    expected = np.column_stack([3 + 5 * (t - 2.5), np.full_like(t, 4), np.zeros_like(t)])
    np.testing.assert_allclose(centre, expected, rtol=0, atol=1e-9)
    turn = history["angular_momentum"][free]
    assert abs(turn - turn[0]).max() < 1e-9 * abs(turn[0]).max()


@pytest.mark.slow
@LARGE_STEPS
def test_variational_blows_up_at_large_steps():
    """Negative, and told with the failure: the step is too long, and the run gained energy."""
    system, step, until = dynamic.pendulum(8, 2).system, 0.02, 0.6
    with pytest.raises(sc.Diverged) as caught:
        sc.simulate(system, sc.Variational(), sc.NullSpace(), step, until, derive=False)
    told = {notice["item"] for notice in caught.value.history.meta["warnings"]}
    assert {"argument step", "balance of energy"} <= told
    sc.simulate(system, sc.EnergyMomentum(), sc.NullSpace(), step, until, derive=False)


# -- the example ----------------------------------------------------------------------------------


def test_reference_is_complete():
    for name, build in dynamic.SCENES.items():
        reference = dynamic.Reference.load(name)
        k = len(build(2, 1).places)
        assert reference.positions.shape == (len(reference.times), k, 3)
        assert (reference.uncertainty > 0).all()
    ends = {"D2": 114.88034556, "D3": 908.7346593}
    for name, energy in ends.items():
        assert dynamic.Reference.load(name).energy[-1] == pytest.approx(energy, abs=1e-7)


def test_limit_takes_even_powers_away():
    steps = [0.3, 0.2, 0.1]
    runs = [dynamic.Motion(*(np.array([c + 2 * h**2 - 5 * h**4]) for c in range(4))) for h in steps]
    for c, value in enumerate(dynamic.limit(steps, runs)):
        assert value == pytest.approx(c, abs=1e-14)


def test_steps_that_miss_a_time_are_refused():
    with pytest.raises(ValueError, match="does not divide"):
        dynamic.motion(dynamic.spaghetti(2, 1), EM, 0.3, [1.0])


@pytest.mark.slow
@LARGE_STEPS
def test_main_writes_tables_and_chart(example):
    assert {p.name for p in example["paths"]} >= {
        f"dynamic_references.{name}.csv" for name in ("space", "time", "reference")
    }
    for path in example["paths"]:
        assert path.stat().st_size > 1000
    assert len(example["given"]) == 12
    made = json.loads(json.dumps(report.plain(example)))
    assert made["given"]["D2 3"]["elements"] == [2, 4]
    assert sum("p = " in line for line in report.lines(example)) == 60
