"""Explicit and asynchronous schemes: order, momenta, joints, step limit, what they refuse."""

import re
from functools import partial
from itertools import pairwise

import numpy as np
import pytest
from test_examples import load

import skfem_cosserat as sc
from skfem_cosserat import diagnostics
from skfem_cosserat.element import InterpolationEquidistant
from skfem_cosserat.integrators.limit import LimitWatch

RUBBER = sc.SectionCircle(0.02, sc.Material(5e6, 0.5, 1100))
FLAT = sc.SectionRectangle(0.06, 0.02, sc.Material(5e6, 0.4, 1100))
SOFT = sc.SectionRectangle(0.06, 0.02, sc.Material(5e5, 0.4, 1100))
PLAIN = {"kernels": "numpy"}


def rod_of(n=4, order=1, section=RUBBER, lumped=True, **motion):
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), n, name="rod")
    return sc.Beam(mesh, section, order=order, director=(0, 1, 0), lumped=lumped, **motion)


def pendulum(n=4, order=1, section=FLAT, lumped=True):
    """A rod on a hinge; at its end a body off its axis, with unequal moments, and a ball joint."""
    model = sc.Model()
    rod = model.add("rod", rod_of(n, order, section, lumped))
    hinge = sc.JointRevolute(sc.ground((0, 0, 0)), rod.node("rod.start"), axis=(0, 0, 1))
    model.add("hinge", hinge)
    tip = rod.node("rod.end")
    model.add("lump", sc.RigidBody(0.3, (5e-4, 7e-4, 9e-4), center=(0.02, 0.03, 0), on=tip))
    bob = model.add("bob", sc.RigidBody.box(0.2, (0.05, 0.1, 0.2), position=(1, 0, -0.1)))
    model.add("ball", sc.JointSpherical(tip, bob.at((1, 0, 0))))
    slow = sc.RampSmooth(0.0, 0.2)
    model.add("weight", sc.LoadGravity((0.0, -9.81, 2.0), slow))
    return model.freeze()


def chain():
    """Bodies and a mass point, joined by what takes five, four, three, two and one freedoms."""
    model = sc.Model()
    boxes = [
        model.add(f"box {k}", sc.RigidBody.box(0.5, (0.05, 0.1, 0.3), position=(0, 0, -0.3 * k)))
        for k in range(4)
    ]
    at = [(0, 0, 0.15 - 0.3 * k) for k in range(5)]
    model.add("hinge", sc.JointRevolute(sc.ground(at[0]), boxes[0].at(at[0]), axis=(1, 0, 0)))
    places = [(boxes[k].at(at[k + 1]), boxes[k + 1].at(at[k + 1])) for k in range(3)]
    model.add("cross", sc.JointUniversal(*places[0], axis_a=(1, 0, 0), axis_b=(0, 1, 0)))
    model.add("ball", sc.JointSpherical(*places[1]))
    model.add("weld", sc.JointFixed(*places[2]))
    bob = model.add("bob", sc.MassPoint(0.2, position=(0.1, 0, -1.2)))
    model.add("string", sc.JointDistance(boxes[3].at(at[4]), bob.place()))
    model.add("weight", sc.LoadGravity((1.0, 2.0, -9.81)))
    return model.freeze()


def free_rod(order=1, section=FLAT):
    def velocity(X):
        x = X[:, 0]
        return np.column_stack([0 * x, 3 * x, 0.5 * np.sin(np.pi * x)])

    spin = (1.0, 0.5, 3.0)
    model = sc.Model()
    rod = rod_of(6, order, section, velocity=velocity, angular_velocity=spin)
    rod = model.add("rod", rod)
    model.add(
        "lump",
        sc.RigidBody(0.3, (5e-4, 7e-4, 9e-4), center=(0.02, 0.03, 0), on=rod.node("rod.end")),
    )
    return model.freeze()


def run(system, integrator, step, until, **more):
    return sc.simulate(
        system, integrator, sc.Multipliers(), step=step, until=until, **(PLAIN | more)
    )


# -- mass ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_lumped_mass_is_nodal_and_keeps_mass_and_inertia(order):
    lumped, full = (rod_of(3, order, FLAT, lumped=one).scalar_mass() for one in (True, False))
    nodes = lumped.reshape(3, order + 1, 4, order + 1, 4)
    for a in range(order + 1):
        for b in range(order + 1):
            assert (a == b) == bool(nodes[:, a, :, b].any())
    # what nodes of one motion weigh: the sum over all pairs
    both = [m.reshape(3, order + 1, 4, order + 1, 4).sum((1, 3)) for m in (lumped, full)]
    np.testing.assert_allclose(both[0], both[1], rtol=1e-13, atol=1e-16)
    # first moment about the start: Gauss-Lobatto integrates linear functions exactly
    x = rod_of(3, order).basis.nodes[rod_of(3, order).basis.connectivity, 0]
    first = [
        np.einsum("eaiaj,ea->eij", lumped.reshape(3, order + 1, 4, order + 1, 4), x),
        np.einsum("eaibj,eb->eij", full.reshape(3, order + 1, 4, order + 1, 4), x),
    ]
    np.testing.assert_allclose(first[0], first[1], rtol=1e-13, atol=1e-16)


def test_lumped_mass_needs_lobatto_nodes():
    with pytest.raises(sc.InputError, match=r"InterpolationEquidistant.*Gauss-Lobatto"):
        rod_of(3, InterpolationEquidistant(3))


def test_energy_momentum_with_lumped_mass_conserves():
    history = run(free_rod(2), sc.EnergyMomentum(), 2e-3, 0.02)
    assert abs(history["energy_balance"]).max() < 1e-10 * history["energy"][0]


# -- step limit ------------------------------------------------------------------------------------


@pytest.mark.parametrize("section", [RUBBER, FLAT])
@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_limit_bounds_the_highest_frequency(order, section):
    """From below by power iteration over the whole mesh; the bound of one element is sharp."""
    model = sc.Model()
    model.add("rod", rod_of(12, order, section))
    system = model.freeze()
    true = 2 / diagnostics.highest_frequency(system, iterations=400)
    limit = sc.Explicit.limit(system)
    assert 0.95 * true < limit.seconds <= true
    assert "of beam 'rod'" in limit.where


def test_limit_of_axial_waves():
    """The length of an element by the speed of sound, where bending and shear are slow."""
    section = sc.Section.from_constants(
        EA=1e6, GA=1e2, EI=(1, 1), GJ=1, mass=2.0, inertia=(1.0, 1.0)
    )
    model = sc.Model()
    model.add("rod", rod_of(10, 1, section))
    limit = sc.Explicit.limit(model.freeze())
    assert limit.seconds == pytest.approx(0.1 / np.sqrt(1e6 / 2.0), rel=1e-3)
    assert limit.kind == "axial"


def test_step_above_the_limit_is_refused_by_name():
    system = free_rod()
    limit = sc.Explicit.limit(system)
    said = f"above the limit of the explicit scheme, {re.escape(str(limit))}"
    with pytest.raises(sc.InputError, match=said + ".*rounds=12"):
        run(system, sc.Explicit(rounds=11), 11.5 * limit.seconds, 1.0)
    assert len(run(system, sc.Explicit(rounds=12), 11.5 * limit.seconds, 0.01)) > 1


def test_step_above_the_limit_blows_up():
    """Theory says so; below it the same run keeps its energy."""
    system = free_rod()
    step = sc.Explicit.limit(system).seconds
    good = run(system, sc.Explicit(), 0.98 * step, 400 * step)
    assert abs(good["energy"] / good["energy"][0] - 1).max() < 1e-2
    bad = run(system, sc.Explicit(checked=False), 1.1 * step, 400 * step)
    assert bad["energy"].max() > 10 * bad["energy"][0]


# -- order -----------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("order", [1, 2])
def test_second_order_in_position_and_velocity(order):
    system = pendulum(2, order, SOFT)
    ends = [run(system, sc.Explicit(rounds=k), 0.05, 0.05) for k in (80, 160, 320)]
    for name in ("q", "v", "constraint_force"):
        values = [h[name][1] for h in ends]
        errors = [np.linalg.norm(a - b) for a, b in pairwise(values)]
        orders = np.log2(np.divide(errors[:-1], errors[1:]))
        assert abs(orders - 2).max() < 0.1, name


@pytest.mark.slow
def test_same_solution_as_energy_momentum():
    """Both are of second order: their difference falls by four, to the same limit."""
    system = pendulum(2, 1, SOFT)
    differences = []
    for k in (40, 80, 160):
        a = run(system, sc.Explicit(rounds=2 * k), 0.05, 0.05)["q"][-1]
        b = run(system, sc.EnergyMomentum(), 0.05 / k, 0.05, every=k, derive=False)["q"][-1]
        differences.append(np.linalg.norm(a - b))
    orders = np.log2(np.divide(differences[:-1], differences[1:]))
    assert abs(orders - 2).max() < 0.1


def test_lumped_and_consistent_mass_meet_under_refinement():
    tips = []
    for n in (4, 8, 16):
        ends = []
        for lumped in (True, False):
            system = pendulum(n, 1, RUBBER, lumped)
            h = run(system, sc.EnergyMomentum(), 4e-3, 0.2, every=50, derive=False)
            ends.append(h["q"][-1][system.offset(system.structures[0].node("rod.end")) :][:3])
        tips.append(np.linalg.norm(ends[0] - ends[1]))
    orders = np.log2(np.divide(tips[:-1], tips[1:]))
    assert abs(orders - 2).max() < 0.3


# -- what is conserved -----------------------------------------------------------------------------


@pytest.mark.parametrize("order", [1, 3])
@pytest.mark.parametrize("integrator", [sc.Explicit(rounds=50), sc.Asynchronous()])
def test_momentum_maps_are_exact(integrator, order):
    h = run(free_rod(order), integrator, 0.01, 0.1)
    for name in ("linear_momentum", "angular_momentum"):
        assert abs(h[name] - h[name][0]).max() < 1e-13 * abs(h[name][0]).max(), name
    assert abs(h["energy"] / h["energy"][0] - 1).max() < 1e-3
    triads = h["q"].reshape(len(h), -1, 4, 3)[:, :, 1:]
    gram = triads @ triads.transpose(0, 1, 3, 2)
    assert abs(gram - np.eye(3)).max() < 1e-14


def test_energy_error_is_of_second_order():
    system = free_rod(1, SOFT)
    errors = []
    for k in (100, 200, 400):
        h = run(system, sc.Explicit(rounds=k), 0.01, 0.03)
        errors.append(abs(h["energy"] - h["energy"][0]).max())
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    assert abs(orders - 2).max() < 0.1


def test_symmetric_top_is_exact_in_any_step():
    """Its axis goes around the angular momentum at |L|/J: closed form after one large step."""
    spin = np.array([0.7, 0.0, 2.0])
    model = sc.Model()
    top = model.add("top", sc.RigidBody(1.0, (0.3, 0.3, 0.2), angular_velocity=spin))
    system = model.freeze()
    h = run(system, sc.Explicit(), 3.0, 3.0)
    J = np.array([0.3, 0.3, 0.2])
    L = J * spin
    axis, angle = L / np.linalg.norm(L), 3.0 * np.linalg.norm(L) / J[0]
    d3 = np.array([0, 0, 1.0])
    turned = (
        np.cos(angle) * d3
        + np.sin(angle) * np.cross(axis, d3)
        + (1 - np.cos(angle)) * (axis @ d3) * axis
    )
    np.testing.assert_allclose(h["q"][-1][9:12], turned, atol=1e-14)
    assert top.name == "top"


def test_unsymmetric_body_off_its_point():
    """Second order, angular momentum exact, its centre of mass on a straight line."""
    model = sc.Model()
    host = sc.RigidBody(0.5, (0.02, 0.01, 0.03), velocity=(1, 0, 0), angular_velocity=(3, 5, 1))
    body = model.add("host", host)
    model.add(
        "arm",
        sc.RigidBody(1.0, (0.001, 0.002, 0.003), center=(0.3, 0.1, 0), on=body.at((0, 0, 0))),
    )
    system = model.freeze()
    ends = []
    for k in (40, 80, 160, 320):
        h = run(system, sc.Explicit(rounds=k), 1.0, 1.0)
        ends.append(h["q"][-1])
        L = h["angular_momentum"]
        assert abs(L - L[0]).max() < 1e-14 * np.linalg.norm(L[0]) * 40
    errors = [np.linalg.norm(a - b) for a, b in pairwise(ends)]
    assert abs(np.log2(np.divide(errors[:-1], errors[1:])) - 2).max() < 0.1
    centre = h["q"][:, :3] + (
        h["q"][:, 3:12].reshape(-1, 3, 3) * np.array([[0.2], [0.2 / 3], [0]])
    ).sum(1)
    way = centre[1] - centre[0]
    np.testing.assert_allclose(way, h["linear_momentum"][0] / 1.5, atol=1e-13)


@pytest.mark.slow
def test_joints_are_closed_to_rounding():
    system = chain()
    h = run(system, sc.Explicit(), 2e-3, 0.4)
    assert h["constraint_violation"].max() < 1e-14
    assert h["hidden_violation"].max() < 1e-13
    total = h["energy"] + h["external"]
    assert abs(total - total[0]).max() < 1e-3 * np.ptp(h["external"])
    em = run(system, sc.EnergyMomentum(), 1e-3, 0.1)
    fine = run(system, sc.Explicit(), 5e-4, 0.1)
    np.testing.assert_allclose(fine["q"][-1], em["q"][-1], atol=2e-5)
    force = "joint/hinge/force"
    np.testing.assert_allclose(fine[force][100], em[force][50], rtol=0.01, atol=0.05)


# -- loads, histories ------------------------------------------------------------------------------


def test_loads_in_time_are_averaged_exactly():
    """The impulse of a kinked load between two records is exact: 2 kg, 3 N s."""
    model = sc.Model()
    ball = model.add("ball", sc.MassPoint(2.0))
    model.add("push", sc.LoadForce(ball.place(), (3, 0, 0), sc.Table([0, 0.33, 2], [0, 2, 0])))
    h = run(model.freeze(), sc.Explicit(rounds=3), 0.5, 2.5)
    assert h["p"][-1][0] == pytest.approx(3 * 2.0, rel=1e-14)
    assert h["work_loads"][-1] == pytest.approx(h["energy"][-1], rel=1e-13)


def test_moments_and_following_forces():
    """A follower moment on a free rod, against energy-momentum with the same mass."""
    model = sc.Model()
    rod = model.add("rod", rod_of(3, 1, FLAT))
    end, slow = rod.node("rod.end"), sc.RampSmooth(0.0, 0.04)
    model.add("twist", sc.LoadMoment(end, (0.02, 0, 0.05), slow, follower=True))
    model.add("push", sc.LoadForce(end, (0.0, 0.1, 0.1), slow, follower=True))
    system = model.freeze()
    differences = []
    for k in (40, 80):
        a = run(system, sc.Explicit(rounds=k), 0.01, 0.05)
        b = run(system, sc.EnergyMomentum(), 0.01 / k, 0.05, every=k, derive=False)
        differences.append(np.linalg.norm(a["q"][-1] - b["q"][-1]))
    assert differences[1] < 2e-4
    assert differences[0] / differences[1] == pytest.approx(4, abs=0.2)
    # of second order where loads have no potential
    assert abs(a["energy_balance"]).max() < 1e-3 * a["energy"][-1]


def test_restart_and_sensors(tmp_path):
    system = pendulum(3)
    tip = system.structures[0].node("rod.end")
    sensors = {"tip": sc.SensorPosition(tip)}
    whole = run(system, sc.Explicit(rounds=40), 0.01, 0.06, sensors=sensors)
    part = run(system, sc.Explicit(rounds=40), 0.01, 0.03, path=tmp_path / "part.npz")
    start = sc.restart(system, part, sc.Explicit(rounds=40), 0.01)
    rest = run(system, sc.Explicit(rounds=40), 0.01, 0.06, start=start)
    np.testing.assert_allclose(rest["q"][-1], whole["q"][-1], atol=1e-13)
    np.testing.assert_allclose(rest["p"][-1], whole["p"][-1], atol=1e-13)
    place = system.offset(tip)
    np.testing.assert_array_equal(
        whole.sensors["tip"].values[-1].ravel(), whole["q"][-1][place : place + 3]
    )
    assert "explicit, limit" in whole.meta["solver"]
    assert whole.meta["integrator"] == "explicit"


# -- asynchronous ----------------------------------------------------------------------------------


def two_parts(stiffer=100.0):
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 8, name="soft")
    mesh = mesh + sc.MeshCurve.init_line((1, 0, 0), (1.1, 0, 0), 2, name="stiff")
    sections = {
        name: sc.SectionRectangle(0.06, 0.02, sc.Material(E, 0.4, 1100))
        for name, E in (("soft", 5e6), ("stiff", stiffer * 5e6))
    }
    model = sc.Model()
    motion = {"velocity": lambda X: np.column_stack([0 * X[:, 0], 4 * X[:, 0], X[:, 0] ** 2])}
    spin = {"angular_velocity": (0, 0, 4.0)}
    beam = sc.Beam(mesh, sections, director=(0, 1, 0), lumped=True, **motion, **spin)
    rod = model.add("rod", beam)
    joint = sc.JointSpherical(sc.ground((0, 0, 0)), rod.node("soft.start"))
    model.add("ball", joint)
    return model.freeze()


def test_asynchronous_steps_of_elements():
    system = two_parts()
    limits = sc.Asynchronous.limits(system)[0]
    step = 0.9 * limits.max()
    alone = sc.Asynchronous(grading=np.inf).counts(system, step)[0]
    assert (step / alone <= 0.9 * limits * (1 + 1e-9)).all()
    assert (step / (alone - 0.999) > 0.9 * limits).all()
    counts = sc.Asynchronous().counts(system, step)[0]
    assert (counts >= alone).all()
    assert (counts[1:] <= 2 * counts[:-1]).all()
    assert counts[:4].tolist() == [1, 1, 1, 1] or counts[0] == 1


def test_asynchronous_evaluates_as_often_as_planned_and_agrees():
    system = two_parts()
    scheme = sc.Asynchronous()
    step = 0.9 * float(sc.Asynchronous.limits(system)[0].max())
    march = scheme.march(system, sc.Multipliers(), step, "numpy", 10)
    state = sc.initial_state(system)
    start = march.advance(state, step).state
    first = march.evaluations
    march.advance(start, 2 * step)
    assert march.evaluations - first == scheme.counts(system, step)[0].sum()
    fine = run(system, sc.Explicit(rounds=400), 20 * step, 20 * step)
    errors = []
    for parts in (2, 4):
        h = run(system, scheme, step / parts, 20 * step)
        assert h["constraint_violation"].max() < 1e-14
        L = h["angular_momentum"]
        assert abs(L - L[0]).max() < 1e-13 * abs(L[0]).max()
        errors.append(np.linalg.norm(h["q"][-1] - fine["q"][-1]))
    assert errors[1] < 0.5 * errors[0] < 1e-3


@pytest.mark.parametrize("stiffer", [pytest.param(100.0, marks=pytest.mark.slow), 20.0])
def test_asynchronous_is_of_second_order_with_fixed_counts(stiffer):
    """In q, v and constraint forces: the scheme is symmetric in time."""
    system, runs = two_parts(stiffer), []
    step = 0.9 * float(sc.Asynchronous.limits(system)[0].max())
    for parts in (8, 16, 32):
        scheme = sc.Asynchronous(0.9 / parts)
        counts = scheme.counts(system, step / parts)[0]
        assert counts.min() == 1 and counts.max() == (11 if stiffer == 100 else 5)
        runs.append(run(system, scheme, step / parts, step))
    for name in ("q", "v", "constraint_force"):
        d = [np.linalg.norm(b[name][-1] - a[name][-1]) for a, b in pairwise(runs)]
        assert np.log2(d[0] / d[1]) == pytest.approx(2, abs=0.02), name


def test_with_fixed_safety_the_fast_elements_keep_their_steps():
    """Negative: no order where the shortest steps stay as long as they are."""
    system = two_parts()
    step = 0.9 * float(sc.Asynchronous.limits(system)[0].max())
    fine, errors = run(system, sc.Explicit(rounds=800), step, step)["q"][-1], []
    for parts in (2, 4):
        errors.append(
            np.linalg.norm(run(system, sc.Asynchronous(), step / parts, step)["q"][-1] - fine)
        )
        shortest = step / parts / sc.Asynchronous().counts(system, step / parts)[0].max()
        assert shortest == pytest.approx(step / 12)
    assert errors[0] / errors[1] < 2  # 4 with second order


def twisted_rod(angle):
    """Two short elements of a flat strip, each twisted by an angle."""
    section = sc.SectionRectangle(0.02, 0.002, sc.Material(1e6, 0.3, 1200.0))
    mesh = sc.MeshCurve.init_line((0, 0, 0), (0.01, 0, 0), 2, name="rod")
    model = sc.Model()
    model.add("rod", sc.Beam(mesh, section, director=(0, 1, 0), lumped=True))
    system = model.freeze()
    y = system.q0.reshape(-1, 4, 3).copy()
    for k, c, s in ((k, np.cos(k * angle), np.sin(k * angle)) for k in range(3)):
        y[k, 1:] = y[k, 1:] @ np.array([[1, 0, 0], [0, c, s], [0, -s, c]])
    return system, y.reshape(-1, 3)


def highest_frequency_by_differences(system, y):
    """Of the first element: forces by differences in its twelve turns and shifts, lumped mass."""
    group, stiffness = system.beam_groups[0], np.zeros((12, 12))
    rows = group.rows[0].reshape(2, 4)
    moves = []
    for node in rows:
        for k in range(6):
            move = np.zeros_like(y)
            if k < 3:
                move[node[0], k] = 1.0
            else:
                move[node[1:]] = np.cross(np.eye(3)[k - 3], y[node[1:]])
            moves.append(move)

    def force(at):
        eps, B = group.strain(at)
        stresses = group.stress(eps) - group.stress(group.strain(y)[0])
        weighted = (group.elements.measure[0] * stresses[0]).reshape(-1, 6, 1)
        return (B[0].reshape(-1, 6, 24) * weighted).sum((0, 1))

    element = [move[group.rows[0]].ravel() for move in moves]
    for k, move in enumerate(moves):
        change = (force(y + 1e-6 * move) - force(y - 1e-6 * move)) / 2e-6
        stiffness[:, k] = [change @ each for each in element]
    mass = np.array(element) @ group.mass[0] @ np.array(element).T
    return np.sqrt(np.linalg.eigvals(np.linalg.solve(mass, stiffness)).real.max())


def test_limits_fall_where_elements_are_twisted(caplog):
    """By a quarter at 0.5 rad; the watch sees it, and steps are made shorter."""
    for angle in (0.01, 0.5):
        system, y = twisted_rod(angle)
        watch, before = LimitWatch(system), sc.Asynchronous.limits(system)[0]
        assert watch.lowered(y) is (angle > 0.1)
        limit = 2 / highest_frequency_by_differences(system, y)
        assert watch.limits[0] == pytest.approx([limit] * 2, rel=2e-3)
        assert not watch.lowered(y)
    assert watch.limits[0] / before == pytest.approx([0.72] * 2, abs=0.01)
    state = sc.State(0.0, 0, y.ravel(), np.zeros(system.n))
    step = float(0.89 * before.min())
    for scheme in (sc.Asynchronous(), sc.Explicit()):
        march = scheme.march(system, sc.Multipliers(), step, "numpy", 10)
        march.advance(state, step)
        assert march.shortened and march.counts[0].tolist() == [2, 2]
        assert "bent so far that their limits fall, to" in caplog.text
        caplog.clear()
    march = sc.Explicit(checked=False).march(system, sc.Multipliers(), step, "numpy", 10)
    march.advance(state, step)
    assert not march.shortened


@pytest.mark.slow
def test_a_blade_that_folds_up_keeps_its_energy(caplog):
    """By pi an element; without the shorter steps it blows up when a limit falls below its step."""
    pytest.importorskip("numba")
    system = load("asynchronous_blade").blade(1e6)
    step = 0.999 * 0.9 * float(sc.Asynchronous.limits(system)[0].max())
    steps = {"step": step, "until": 9091.5 * step, "every": 50, "kernels": "numba"}
    history = run(system, sc.Asynchronous(), **steps)
    assert history.status == "completed" and "limits fall" in caplog.text
    error = abs(history["energy"] - history["energy"][0]).max() / history["kinetic"][0]
    assert 1e-5 < error < 0.01
    L = history["angular_momentum"]
    assert abs(L - L[0]).max() < 1e-12 * abs(L[0]).max()
    turned = history["q"].reshape(len(history), -1, 4, 3)[:, :, 1:]
    traces = np.einsum("tnij,tnij->tn", turned[:, 1:], turned[:, :-1])
    assert np.arccos(np.clip((traces.min() - 1) / 2, -1, 1)) > 3
    with pytest.raises(sc.Diverged, match="blown up"):
        run(system, sc.Asynchronous(checked=False), **steps)


def test_all_elements_alike_is_the_explicit_scheme():
    system = free_rod()
    step = 0.9 * sc.Explicit.limit(system).seconds
    a = run(system, sc.Explicit(), step, 20 * step)
    b = run(system, sc.Asynchronous(grading=1.0), step, 20 * step)
    np.testing.assert_allclose(a["q"], b["q"], atol=1e-14)


# -- compiled --------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("order", [1, 3])
@pytest.mark.parametrize("integrator", [sc.Explicit(rounds=40), sc.Asynchronous()])
@pytest.mark.parametrize("scene", [pendulum, free_rod, two_parts, chain])
def test_compiled_loop_is_the_plain_one(scene, integrator, order):
    pytest.importorskip("numba")
    if scene is chain:
        with pytest.raises(sc.InputError, match="beams of one order only"):
            run(chain(), integrator, 1e-3, 0.01, kernels="numba")
        return
    system = {pendulum: lambda: pendulum(4, order), free_rod: lambda: free_rod(order)}.get(
        scene, two_parts
    )()
    step = 20 * sc.Explicit.limit(system).seconds
    a, b = (run(system, integrator, step, 10 * step, kernels=k) for k in ("numpy", "numba"))
    assert b.meta["kernels"] == "numba"
    for name in ("q", "p", "work_loads"):
        np.testing.assert_allclose(a[name], b[name], rtol=0, atol=3e-12 * (1 + abs(a[name]).max()))
    np.testing.assert_array_equal(a["newton_iterations"], b["newton_iterations"])


@pytest.mark.slow
def test_steps_that_are_not_graded_meet_resonances():
    """What the grading is for: without it the blade of the example blows up, with it not."""
    pytest.importorskip("numba")
    system = load("asynchronous_blade").blade(1e8)
    step = 0.999 * 0.8 * float(sc.Asynchronous.limits(system)[0].max())
    graded = run(system, sc.Asynchronous(0.8), step, 2000.5 * step, every=50, kernels="numba")
    assert abs(graded["energy"] / graded["energy"][0] - 1).max() < 1e-6
    bare = sc.Asynchronous(0.8, grading=np.inf)
    with pytest.raises(sc.Diverged, match="blown up"):
        run(system, bare, step, 2000.5 * step, every=50, kernels="numba")


def check_blade(numbers, bound):
    assert numbers["fine share"] <= 0.2
    assert numbers["step ratio"] >= 8
    assert numbers["saving"] >= 0.7 * numbers["ideal"]
    assert numbers["energy error"] < bound
    assert numbers["angular momentum"] < 1e-13
    assert numbers["linear momentum"] < 1e-14


def test_example_of_the_blade():
    """Saving of evaluations, energy error by the kinetic energy, momenta."""
    check_blade(load("asynchronous_blade").run(1e8, 500, "numpy"), 1e-6)


@pytest.mark.slow
def test_blades_over_1e5_element_steps():
    pytest.importorskip("numba")
    for name, numbers in load("asynchronous_blade").main(100_000, "numba").items():
        assert numbers["element steps"] >= 1e5, name
        check_blade(numbers, 3e-6)
        assert numbers["energy error"] < 2e-3 * numbers["strain energy"], name
        assert numbers["second half"] < 3 * numbers["first half"], name


# -- refused ---------------------------------------------------------------------------------------


def refused_scene(kind):
    model = sc.Model()
    body = model.add("body", sc.RigidBody.box(1.0, (0.1, 0.2, 0.3)))
    if kind == "consistent":
        model.add("rod", rod_of(lumped=False))
    elif kind == "spring":
        model.add("spring", sc.SpringDamper(sc.ground((0, 0, 1)), body.at((0, 0, 0)), 1.0, 0.0))
    elif kind == "drive":
        pin = model.add(
            "pin", sc.JointRevolute(sc.ground((0, 0, 0)), body.at((0, 0, 0)), axis=(0, 0, 1))
        )
        model.add("motor", sc.JointDrive(pin, lambda t: t))
    elif kind == "damped":
        model.add("rod", rod_of(section=RUBBER.damped(time=0.01)))
    elif kind == "moving":
        moving = sc.ground((0, 0, 0), motion=sc.MotionTurn((0, 0, 1), lambda t: t))
        model.add("weld", sc.JointSpherical(moving, body.at((0, 0, 0))))
    elif kind == "loop":
        for k, x in enumerate([(0, 0, 0), (0, 0, 1)]):
            model.add(f"pin {k}", sc.JointRevolute(sc.ground(x), body.at(x), axis=(0, 0, 1)))
    elif kind == "slim":
        model.add("needle", sc.RigidBody(1.0, (0, 0, 1.0)))
    return model.freeze()


@pytest.mark.parametrize(
    ("kind", "said"),
    [
        ("consistent", "beam 'rod'.*lumped=True"),
        ("spring", "'spring'.*springs, dampers"),
        ("drive", "'motor'.*not prescribed"),
        ("damped", "damping"),
        ("moving", "moving ground"),
        ("loop", "closed loops.*'?pin 1.*tree"),
    ],
)
@pytest.mark.parametrize("integrator", [sc.Explicit(), sc.Asynchronous()])
def test_what_is_refused(integrator, kind, said):
    with pytest.raises(sc.errors.IncompatibleError, match=said) as caught:
        run(refused_scene(kind), integrator, 1e-5, 1.0)
    assert type(integrator).__name__ in str(caught.value)


def test_limits_of_consistent_masses_are_refused():
    """They are not those of the scheme."""
    model = sc.Model()
    model.add("rod", rod_of(lumped=False))
    system = model.freeze()
    for ask in (sc.Explicit.limit, sc.Asynchronous.limits):
        with pytest.raises(sc.IncompatibleError, match=r"step limit.*beam 'rod'.*lumped=True"):
            ask(system)
    for bad in (-1.0, np.nan, "a"):
        with pytest.raises(sc.InputError, match="step"):
            sc.Asynchronous().counts(free_rod(), bad)


@pytest.mark.parametrize("bad", [3, None, "rod", sc.Model()], ids=["3", "None", "text", "model"])
def test_limits_of_what_is_no_system(bad):
    """Named, with what was expected."""
    said = "argument system.*expected an object of type System, as model.freeze"
    counts = partial(sc.Asynchronous().counts, step=0.1)
    for ask in (sc.Explicit.limit, sc.Asynchronous.limit, sc.Asynchronous.limits, counts):
        with pytest.raises(sc.InputError, match=said):
            ask(bad)
    with pytest.raises(sc.InputError, match=said):
        counts(bad, limits=[np.ones(3)])


@pytest.mark.parametrize(
    "limits", [3, [], [np.ones(5)], [np.zeros(6)], [[np.nan] * 6], ["a"], [np.ones(6)] * 2], ids=str
)
def test_bad_limits_of_elements(limits):
    """Of another number of elements, or no positive numbers."""
    with pytest.raises(sc.InputError, match=r"argument limits.*expected"):
        sc.Asynchronous().counts(free_rod(), 0.1, limits)


@pytest.mark.parametrize("scheme", [sc.Explicit(), sc.Asynchronous()], ids=repr)
def test_what_would_be_ignored_is_refused(scheme):
    """A solver, as there are no linear systems; multipliers unscaled: both sides are named."""
    name = re.escape(repr(scheme))
    with pytest.raises(sc.IncompatibleError, match=name + r" with SolverSuperLU\(\).*no linear"):
        run(free_rod(), scheme, 1e-5, 1e-3, solver=sc.SolverSuperLU())
    unscaled = sc.Multipliers(scaled=False)
    said = name + r" with Multipliers\(scaled=False\).*take Multipliers\(\)"
    with pytest.raises(sc.IncompatibleError, match=said):
        sc.Stepper(free_rod(), scheme, unscaled, 1e-5)
    with pytest.raises(sc.InputError, match="argument solver"):
        run(free_rod(), scheme, 1e-5, 1e-3, solver="superlu")


def test_treatment_and_arguments():
    with pytest.raises(sc.errors.IncompatibleError, match=r"Explicit.*NullSpace.*Multipliers\(\)"):
        sc.simulate(free_rod(), sc.Explicit(), sc.NullSpace(), 1e-5, 1.0)
    for bad in (0, 1.5, True):
        with pytest.raises(sc.InputError, match="rounds"):
            sc.Explicit(rounds=bad)
    for bad in (0, 1.5, np.nan):
        with pytest.raises(sc.InputError, match="safety"):
            sc.Asynchronous(safety=bad)
    with pytest.raises(sc.InputError, match="grading"):
        sc.Asynchronous(grading=0.5)
    stepper = sc.Stepper(free_rod(), sc.Explicit(), sc.Multipliers(), 1e-5)
    with pytest.raises(sc.errors.IncompatibleError, match="no iteration matrix"):
        stepper.iteration_matrix(sc.initial_state(free_rod()))
