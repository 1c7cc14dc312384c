"""Section forces at any arc length: closed forms, order 2 p, sensors, and the same after a run."""

import numpy as np
import pytest

import skfem_cosserat as sc
from skfem_cosserat.diagnostics import forces_along, nodal_resultants

SOFT = sc.Section([1e3, 1.2e3, 5e3, 4.0, 6.0, 5.0], mass=1.0, inertia=(0.01, 0.02))
STEEL = sc.SectionCircle(5e-3, sc.Material(210e9, 0.3, 7850.0))


def cantilever(section, order, elements, *loads, theory=None):
    """A straight beam of 1 m along x, clamped at its start; functions of the beam give loads."""
    model = sc.Model()
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), elements, name="rod")
    beam = sc.Beam(mesh, section, order=order, director=(0, 0, 1), theory=theory)
    model.add("rod", beam)
    model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), beam.node("rod.start")))
    for k, load in enumerate(loads):
        model.add(f"load {k}", load(beam))
    return model, beam


def tip_load(beam):
    return sc.LoadForce(beam.node("rod.end"), (-1.0, 4.0, 2.0))


def tip_moment(beam):
    return sc.LoadMoment(beam.node("rod.end"), (0.3, -0.5, 1.0))


def line_load(beam):
    return sc.LoadLine(beam, (2.0, -6.0, 4.0))


def following(beam):
    return sc.LoadLine(beam, (4.0, 6.0, 0.0), follower=True)


PLACES = np.array([0.0, 0.123, 0.371, 0.5, 0.777, 1.0])
KINDS = {"ends": (tip_load, tip_moment), "line": (line_load,), "following": (following,)}


@pytest.fixture(scope="module")
def fine():
    """Forces of meshes that are as good as exact, by kind of load."""
    found = {}
    for kind, loads in KINDS.items():
        model, beam = cantilever(SOFT, 4, 24, *loads)
        found[kind] = forces_along(model, sc.static(model, watch=False), beam, PLACES)[-1]
    return found


@pytest.mark.slow
@pytest.mark.parametrize(("order", "coarse"), [(1, 16), (2, 8), (3, 4), (4, 2)])
@pytest.mark.parametrize("kind", KINDS)
def test_order_at_any_point(order, coarse, kind, fine):
    """Ends of the beam and inner points alike; less inside under loads that follow the line."""
    errors = []
    for elements in (coarse, 2 * coarse):
        model, beam = cantilever(SOFT, order, elements, *KINDS[kind])
        found = forces_along(model, sc.static(model, watch=False), beam, PLACES)[-1]
        errors.append(abs(found - fine[kind]).max(1))
    at_root = np.log2(errors[0][0] / errors[1][0])
    anywhere = np.log2(errors[0].max() / errors[1].max())
    band = 0.3 if order < 4 else 0.6  # its errors of 8e-10 are near to rounding, 1e-10
    assert abs(at_root - 2 * order) < band
    if kind != "following" or order < 3:
        assert abs(anywhere - 2 * order) < band
    else:
        assert anywhere > order + 0.5


@pytest.mark.one_quick
@pytest.mark.parametrize("order", [1, 2, 3, 4])
@pytest.mark.parametrize("theory", [None, sc.TheoryKirchhoff()])
def test_closed_forms_of_a_stiff_cantilever(order, theory):
    """N_1 = -F - w (L - s), M_2 = -(F + w (L - s)/2) (L - s) along d1, which points up.

    Shear and bending of the linear theory, as the rod hardly bends; the rest vanishes.
    """
    force, weight, s = 1e-3, STEEL.mass * 1e-3, np.array([0.0, 0.25, 0.4, 0.9, 1.0])
    model, beam = cantilever(
        *(STEEL, order, 3),
        lambda b: sc.LoadForce(b.node("rod.end"), (0, 0, -force)),
        lambda b: sc.LoadGravity((0, 0, -1e-3)),
        theory=theory,
    )
    found = forces_along(model, sc.static(model), beam, s)[-1]
    rest = 1.0 - s
    assert found[:, 0] == pytest.approx(-force - weight * rest, rel=1e-5)
    bending = (force + weight * rest / 2) * rest
    assert abs(found[:, 4]) == pytest.approx(bending, rel=1e-5, abs=1e-9)
    assert abs(found[:, [1, 2, 3, 5]]).max() < 1e-6


def test_sides_of_a_node_under_a_load():
    """Where a force acts on a node the sides are those of its two elements, and differ by it."""
    model, beam = cantilever(SOFT, 2, 4)
    model.add("push", sc.LoadForce(beam.node((0.5, 0, 0)), (0.7, 0.0, 0.0)))
    path = sc.static(model)
    before, after = forces_along(model, path, beam, [0.5 - 1e-9, 0.5 + 1e-9])[-1]
    assert before == pytest.approx([0, 0, 0.7, 0, 0, 0], abs=1e-6)
    assert after == pytest.approx(np.zeros(6), abs=1e-6)
    nodal = nodal_resultants(model, beam, path["q"][-1])
    assert before == pytest.approx(nodal[1, 1], abs=1e-6)
    assert after == pytest.approx(nodal[2, 0], abs=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("treatment", "kernels"), [(sc.Multipliers(), "numpy"), (sc.NullSpace(), "numba")]
)
def test_a_rotating_arm(kernels, treatment):
    """N_3(r) = rho A w^2 (R^2 - r^2)/2: in sensors, in an event, and after a run without sensors.

    The arm is stiff: it stretches by 1e-7. Its speed w = 60 t^2 grows so smoothly that this is the
    balance of each instant. Its damping makes 2e4 N of a rate of strain of 1/s, of which rounding
    of velocities leaves 1e-12.
    """
    model, s = sc.Model(), np.array([0.0, 0.31, 0.5])
    hub = sc.MotionTurn((0, 0, 1), lambda t: 20.0 * t**3)
    mesh = sc.MeshCurve.init_line((0.1, 0, 0), (0.6, 0, 0), 3, name="arm")
    arm = model.add("arm", sc.Beam(mesh, STEEL, order=2, director=(0, 0, 1)))
    hold = sc.JointFixed(sc.ground((0.1, 0, 0), hub), arm.node("arm.start"))
    model.add("hold", hold)
    model.add("damping", sc.RayleighDamping(stiffness=1e-4, items=arm))
    share = STEEL.mass * (0.6**2 - (0.1 + s) ** 2) / 2
    sensors = {f"{k}": sc.SensorForce(arm, place) for k, place in enumerate(s)}
    reached = sc.ConditionSensor(sensors["1"], level=share[1] * 8.0**2, component=2)
    run = sc.simulate(
        *(model, sc.EnergyMomentum(), treatment, 5e-3, 0.5),
        sensors=sensors,
        events=[sc.Event(reached)],
        kernels=kernels,
    )
    seen = np.array([run.sensors[name].values for name in sensors]).swapaxes(0, 1)
    assert np.array_equal(run.sensors["0"].times, run.times)
    steady = run.times > 0.1
    expected = np.outer(60.0 * run.times**2, np.ones(3)) ** 2 * share
    assert abs(seen[steady, :, 2] - expected[steady]).max() < 0.02 * expected.max()
    assert run.events[0].time == pytest.approx(np.sqrt(8 / 60), rel=0.02)
    again = forces_along(model, run, arm, s)
    assert abs(again - seen).max() < 1e-8 * abs(seen).max()


@pytest.mark.slow
def test_forces_are_those_of_the_system_of_their_time():
    """A hinge that locks passes on a moment: not seen by the scene before, which is refused."""
    model = sc.Model()
    mesh = sc.MeshCurve.init_line((0, 0, 0), (0.5, 0, 0), 2, name="arm")
    arm = model.add("arm", sc.Beam(mesh, STEEL, order=2, director=(0, 1, 0)))
    hinge = sc.JointRevolute(sc.ground((0, 0, 0)), arm.node("arm.start"), axis=(0, 1, 0))
    model.add("hinge", hinge)
    model.add("weight", sc.LoadGravity((0, 0, -9.81)))
    given = model, sc.EnergyMomentum(), sc.NullSpace(), 1e-3, 0.1
    events = [sc.Event(sc.ConditionTime(0.05), sc.ActionLock(hinge))]
    run = sc.simulate(*given, sensors={"root": sc.SensorForce(arm, 0.0)}, events=events)
    with pytest.raises(sc.HistoryError, match=r"changed on the way: take history\.segment\(k\)"):
        forces_along(model, run, arm, 0.0)
    system, _ = sc.after_events(model, run, events)
    last = forces_along(system, run.segment(-1), arm, 0.0)[-1, 0, 3]
    assert abs(last) > 1.0
    assert last == pytest.approx(run.sensors["root"].values[-1, 3], rel=1e-9)
