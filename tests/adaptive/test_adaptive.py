"""Adaptive meshes: states carried over, shares of elements in an error, tolerances that are met.

True errors are against order 4 on meshes of 16 times as many elements; the dynamic ones with the
same step, so that the error in space is left, and D2 once against its reference solution.
"""

import importlib
import pickle
import sys
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import skfem_cosserat as sc
from skfem_cosserat import adapt, diagnostics, write_paraview
from skfem_cosserat.adaptive import (
    Halve,
    HalveOrRaise,
    NodePosition,
    RunInTime,
    RunStatic,
    Uniform,
    carry_history,
    carry_state,
)
from skfem_cosserat.adaptive.adapt import Outlook
from skfem_cosserat.mesh.divide import places_in
from skfem_cosserat.model.balance import amplitudes_at
from skfem_cosserat.run import derive_series

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
sys.path[:0] = [str(EXAMPLES), str(EXAMPLES / "benchmarks")]

scenes = importlib.import_module("adaptive_mesh")
common = importlib.import_module("collection.common")
members = importlib.import_module("collection.members")

SECTION = sc.Section([1e6, 1e6, 1e6, 1e3, 1e3, 1e3], mass=1.0, inertia=(10.0, 10.0))


@cache
def reference(name):
    """The quantity of a case (T, k)."""
    return scenes.reference(scenes.CASES[name])


def error(name, result):
    return float(np.linalg.norm(result.value - reference(name), axis=1).max())


def solve(name, tolerance, order, strategy=None):
    case = scenes.CASES[name]
    return adapt(
        case.build,
        case.mesh,
        case.quantity,
        tolerance,
        run=case.run,
        order=order,
        strategy=strategy,
    )


# -- tolerances ------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def example(tmp_path_factory):
    """The example's two problems at rest, refined in four ways."""
    folder = tmp_path_factory.mktemp("adaptive")
    return scenes.main(quick=True, out=folder), folder


#: unknowns: adaptive, halved where it matters, uniform, uniform of order 4
UNKNOWNS = {"bend": (90, 168, 384, 96), "frame": (120, 180, 384, 192)}


@pytest.mark.parametrize("name", UNKNOWNS)
@pytest.mark.slow
def test_fewer_unknowns_than_uniform(example, name):
    """All end below the tolerance in the true error, the adaptive ones with far fewer unknowns."""
    ways = example[0][name]
    for entry in ways.values():
        assert entry["reached"]
        assert entry["error"] <= entry["tolerance"] == 1e-4
        assert entry["estimate"] == pytest.approx(entry["error"], rel=1e-2)
    assert tuple(entry["unknowns"] for entry in ways.values()) == UNKNOWNS[name]


@pytest.mark.slow
def test_tables_of_the_example(example):
    result, folder = example
    rows = [x for x in (folder / "adaptive_mesh.csv").read_text().splitlines() if x[0] != "#"]
    levels = [level for name in UNKNOWNS for e in result[name].values() for level in e["levels"]]
    assert len(rows) == 1 + len(levels)
    assert len(scenes.lines(result)) == 1 + 4 * len(UNKNOWNS)


@pytest.mark.slow
def test_lee_frame_takes_fewer_unknowns():
    adaptive, halved = (solve("lee", 1e-3, 2, s) for s in (HalveOrRaise(), Uniform()))
    for result in (adaptive, halved):
        assert result.reached
        assert error("lee", result) <= 1e-3
    assert (adaptive.unknowns, halved.unknowns) == (140, 476)


def test_halving_alone():
    """Half of the bend is free of forces: there nothing is halved."""
    result = solve("bend", 1e-3, 2, Halve())
    assert result.reached and result.order == 2
    lengths = result.mesh.lengths
    half = result.mesh.arc_starts < 0.5 * lengths.sum() - 1e-9
    assert (~half).sum() == 2  # as many as at the start
    assert half.sum() > 4


#: problem, tolerance (m), order to start with
TEN = (
    *(("bend", 1e-1, 1), ("bend", 1e-3, 2), ("bend", 1e-6, 2), ("frame", 1e-2, 1)),
    *(("frame", 1e-5, 3), ("lee", 1e-1, 1), ("lee", 1e-4, 2)),
    *(("frame in time", 5e-3, 2), ("frame in time", 5e-4, 2), ("swing", 1e-4, 1)),
)


@pytest.mark.slow
def test_ten_runs():
    """True errors: all within the tolerance (nine would do), none three times as large."""
    ratios = []
    for name, tolerance, order in TEN:
        result = solve(name, tolerance, order)
        assert result.reached, (name, tolerance)
        ratios.append(error(name, result) / tolerance)
        # the estimate of the last mesh is from a mesh that is richer twice
        assert result.estimate == pytest.approx(ratios[-1] * tolerance, rel=0.05)
    assert sum(r <= 1 for r in ratios) >= 9, ratios
    assert max(ratios) <= 3, ratios


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "tolerance", "order"), [("frame in time", 5e-4, 2), ("swing", 1e-4, 1)]
)
def test_fewer_unknowns_in_time(name, tolerance, order):
    adaptive, halved = (solve(name, tolerance, order, s) for s in (HalveOrRaise(), Uniform()))
    for result in (adaptive, halved):
        assert result.reached
        assert error(name, result) <= tolerance
    assert adaptive.unknowns < 0.65 * halved.unknowns


@pytest.mark.slow
def test_right_angle_frame_against_its_reference():
    """D2 with a step that leaves little error in time: the tolerance holds against the reference.

    Energy-momentum with h = 1/160 s: on a fine mesh the error in time is 2.5e-5 m.
    """
    values = common.entry("D2_right_angle_cantilever")["values"]
    times = [float(t) for t in values if float(t) <= 2.0]
    exact = np.array([values[t]["pos"]["tip"] for t in values if float(t) <= 2.0])
    run = RunInTime(sc.EnergyMomentum(), 1 / 160, 2.0, times=times)
    case = scenes.CASES["frame in time"]
    result = adapt(case.build, case.mesh, case.quantity, 3e-3, run=run, order=2)
    assert result.reached
    assert np.linalg.norm(result.value - exact, axis=1).max() <= 3e-3


def test_quantity_on_a_path_of_its_own_control():
    """Paths that are not followed by the load are followed anew on each mesh."""
    case = scenes.CASES["bend"]
    mesh = case.mesh

    def control(system):
        place = system.structures[0].node("hook")
        return sc.DisplacementControl(place, (0, 0, 1.0), until=20.0)

    result = adapt(
        case.build, mesh, case.quantity, 1e-2, run=RunStatic(control, options={"watch": False})
    )
    assert result.reached
    fine = case.build(mesh.refined(2), 4).freeze()
    path = sc.static(fine, control=control(fine), watch=False)
    exact = case.quantity(fine, path["q"][-1])
    assert np.linalg.norm(result.value[0] - exact) <= 1e-2


@pytest.mark.slow
def test_mesh_on_which_nothing_converges():
    """A linear element bends by 45 degrees at most: the order is raised, or all are halved."""
    case = scenes.CASES["bend"]
    start = sc.MeshCurve.init_line((0, 0, 0), (10, 0, 0), 2, name="bend", nodes={"hook": 0.5})

    def build(mesh, order):
        model = sc.Model()
        rod = model.add("bend", sc.Beam(mesh, SECTION, order=order))
        model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), rod.node("bend.start")))
        model.add("force", sc.LoadForce(rod.node("hook"), (0, 0, 150.0)))
        return model

    for strategy, change in ((Halve(), "halved 2"), (HalveOrRaise(), "order 2")):
        result = adapt(build, start, case.quantity, 1.0, order=1, strategy=strategy)
        assert result.reached
        assert result.levels[0].origin.startswith("not solved")
        assert result.levels[0].change == change
        assert np.isinf(result.levels[0].estimate)
    with pytest.raises(sc.Diverged):
        adapt(build, start, case.quantity, 1.0, order=1, levels=1)


def test_two_meshes_with_orders_of_their_own():
    """What is bent gets the higher order, what is not stays as it is."""
    meshes = {
        "arm": sc.MeshCurve.init_line((0, 0, 0), (4, 0, 0), 2, name="arm"),
        "rest": sc.MeshCurve.init_line((4, 0, 0), (10, 0, 0), 3, name="rest"),
    }

    def build(mesh, order):
        model = sc.Model()
        arm = model.add("arm", sc.Beam(mesh["arm"], SECTION, order=order["arm"]))
        rest = model.add("rest", sc.Beam(mesh["rest"], SECTION, order=order["rest"]))
        model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), arm.node("arm.start")))
        model.add("weld", sc.JointFixed(arm.node("arm.end"), rest.node("rest.start")))
        model.add("force", sc.LoadForce(arm.node("arm.end"), (0, 0, 100.0)))
        return model

    result = adapt(build, meshes, NodePosition("rest", "rest.end"), 1e-6, order=2)
    assert result.reached
    assert result.order == {"arm": 4, "rest": 2}
    assert result.mesh["rest"] is meshes["rest"]
    assert set(result.levels[-1].shares) == {"arm", "rest"}


def test_result_as_a_table(tmp_path):
    result = solve("bend", 1e-1, 2)
    lines = result.write_csv(tmp_path / "levels.csv").read_text().splitlines()
    assert len(lines) == 1 + len(result.levels)
    assert lines[0].split(",")[:5] == ["level", "elements", "order", "unknowns", "value_0"]
    assert float(lines[-1].split(",")[4]) == result.value[0, 0]


def test_chart(tmp_path):
    pytest.importorskip("matplotlib")
    solve("bend", 1e-1, 2).chart(tmp_path / "levels.png")
    assert (tmp_path / "levels.png").stat().st_size > 1000


# -- indicators ------------------------------------------------------------------------------------


@pytest.mark.parametrize(("order", "elements"), [(1, 64), (2, 16), (3, 8), (4, 4)])
@pytest.mark.parametrize("name", ["bend", "frame"])
def test_shares_add_up_to_the_error(name, order, elements):
    """With the adjoint they are those of the quantity, also where the richer mesh is finer."""
    case = scenes.CASES[name]
    mesh = case.mesh.refined(int(np.log2(elements / case.mesh.nelements)))
    coarse = case.build(mesh, order).freeze()
    fine = case.build(mesh.refined(int(order == 4)), min(order + 1, 4)).freeze()
    path, good = (case.run.solve(s, None) for s in (coarse, fine))
    change = case.run.values(case.quantity, fine, good) - case.run.values(
        case.quantity, coarse, path
    )
    shares, origin = case.run.shares(case.quantity, coarse, fine, path, good, change)
    assert origin == "adjoint"
    (found,) = shares.values()
    assert len(found) == elements
    assert found.sum() == pytest.approx(np.linalg.norm(change), rel=0.02)


def test_shares_are_zero_where_nothing_is_bent():
    case = scenes.CASES["bend"]
    mesh = case.mesh.refined(2)
    fine = case.build(mesh, 3).freeze()
    good = case.run.solve(fine, None)
    coarse = case.build(mesh, 2).freeze()
    q = case.run.solve(coarse, None)["q"][-1]
    shares = diagnostics.goal_shares(
        coarse, fine, q, good["q"][-1], np.eye(coarse.n)[12 * 4], amplitudes_at(coarse, 1.0)
    )["bend"]
    # what Newton's method leaves
    assert abs(shares[8:]).max() < 3e-3 * abs(shares).max()


def test_missing_strains_of_a_polynomial():
    """Curvature of a clamped beam under its weight: parabola (x - L)^2; Legendre by hand."""
    model = sc.Model()
    mesh = sc.MeshCurve.init_line((0, 0, 0), (2, 0, 0), 2, name="rod")
    stiff = sc.Section([1e9, 1e9, 1e9, 100, 100, 100], mass=1.0, inertia=(1.0, 1.0))
    rod = model.add("rod", sc.Beam(mesh, stiff, order=3))
    model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), rod.node("rod.start")))
    w = 1e-3
    model.add("weight", sc.LoadGravity((0, 0, -w)))
    system = model.freeze()
    q = sc.static(system)["q"][-1]
    # on an element of length 1: (x - L)^2 = a2 P2 + a1 P1 + a0, a2 = 1/6 and int P2^2 = 1/5
    beyond = 0.5 * (w / 2) ** 2 / 100 * (1 / 6) ** 2 / 5
    quadratic = diagnostics.missing_strains(rod.refined(order=2), system, rod, q)
    np.testing.assert_allclose(quadratic[:, 0], beyond, rtol=1e-4)
    slopes = np.array([1.5, 0.5])  # a1 of both elements; int P1^2 = 1/3
    np.testing.assert_allclose(quadratic[:, 1], 0.5 * (w / 2) ** 2 / 100 * slopes**2 / 3, rtol=1e-4)


def outlook(shares, decays, orders=None, aim=0.0, highest=4):
    shares, decays = ({"m": np.array(a, dtype=float)} for a in (shares, decays))
    return Outlook(shares, decays, orders or {"m": 2}, highest, aim)


def test_strategies():
    rough, smooth = [1.0] * 4, [0.01] * 4
    assert HalveOrRaise().choose(outlook([1, 1, 1, 1], smooth)).orders == {"m": 3}
    change = HalveOrRaise().choose(outlook([1, 0, 0, 0.1], rough))
    assert change.orders == {"m": 2} and change.marked["m"].tolist() == [0]
    # no more than the aim takes: 1/16 remains of what is halved
    assert Halve(1.0).choose(outlook([4, 3, 2, 1], rough, aim=0.5)).marked["m"].tolist() == [0, 1]
    assert Halve().choose(outlook([4, 3, 2, 1], rough)).marked["m"].tolist() == [0, 1]
    # at the highest order only halving is left
    top = outlook([1, 1, 1, 1], smooth, {"m": 2}, highest=2)
    assert HalveOrRaise().choose(top).orders == {"m": 2}
    assert Uniform().choose(top).marked["m"].tolist() == [0, 1, 2, 3]


# -- what is carried over --------------------------------------------------------------------------


def bent_state(order, elements, step=0.05):
    """The right-angle frame, moving, with an outer body on a spring of joints."""
    case = scenes.CASES["frame in time"]
    mesh = sc.MeshCurve.init_polyline(
        [(0, 0, 0), (10, 0, 0), (10, 10, 0)], elements, name="frame", nodes={"elbow": 0.5}
    )
    system = case.build(mesh, order).freeze()
    history = sc.simulate(system, sc.EnergyMomentum(), sc.NullSpace(), step, 1.0)
    return mesh, system, history


@pytest.fixture(scope="module")
def moving():
    return bent_state(2, 3)


@pytest.mark.parametrize("order", [1, 2, 3])
@pytest.mark.parametrize("marked", [[0, 4], 1])
def test_common_nodes_keep_their_values(moving, order, marked):
    mesh, coarse, history = moving
    fine = scenes.CASES["frame in time"].build(mesh.refined(marked), order).freeze()
    q, v = diagnostics.transfer(coarse, fine, history["q"], history["v"])
    count = 12 * mesh.p.shape[1]
    np.testing.assert_array_equal(q[:, :count], history["q"][:, :count])
    np.testing.assert_array_equal(v[:, :count], history["v"][:, :count])
    violation = diagnostics.constraint_violation(fine, q, history.times)
    assert abs(violation).max() < 1e-13
    assert abs(diagnostics.hidden_violation(fine, q, v, history.times)).max() < 1e-11


def test_there_and_back(moving):
    """Halved and taken back all nodes of the coarse mesh are as they were."""
    mesh, coarse, history = moving
    fine = scenes.CASES["frame in time"].build(mesh.refined(), 2).freeze()
    there = diagnostics.transfer(coarse, fine, history["q"][-1], history["v"][-1])
    back = diagnostics.transfer(fine, coarse, *there)
    np.testing.assert_allclose(back[0], history["q"][-1], rtol=0, atol=1e-13)
    np.testing.assert_allclose(back[1], history["v"][-1], rtol=0, atol=1e-13)


def test_rigid_motion_is_carried_over_exactly():
    """A coarse arc, turned and moving: on the fine mesh it is the same rigid motion."""
    mesh = sc.MeshCurve.init_arc((0, 0, 0), (1, 0, 0), (0, 1, 0), 3.0, 2.0, 2, name="arc")
    systems = []
    for one, order in ((mesh, 2), (mesh.refined([1]), 3)):
        model = sc.Model()
        model.add("arc", sc.Beam(one, SECTION, order=order, twist=0.3))
        systems.append(model.freeze())
    turn = np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]])
    spin, shift = np.array([0.3, -1.0, 2.0]), np.array([1.0, 2.0, 3.0])
    states = []
    for system in systems:
        y = system.q0.reshape(-1, 3) @ turn.T
        v = np.cross(spin, y)
        v[system.origin_rows] += shift
        y[system.origin_rows] += shift
        states.append((y.ravel(), v.ravel()))
    q, v = diagnostics.transfer(*systems, *states[0])
    np.testing.assert_allclose(q, states[1][0], rtol=0, atol=1e-13)
    np.testing.assert_allclose(v, states[1][1], rtol=0, atol=1e-12)


def test_momentum_and_energy_of_a_carried_state(moving):
    """Velocities of places are the same polynomials: momentum exactly; energies nearly."""
    mesh, coarse, history = moving
    fine = scenes.CASES["frame in time"].build(mesh.refined(), 2).freeze()
    start = sc.restart(coarse, history, sc.EnergyMomentum(), 0.05)
    state = carry_state(coarse, fine, start)
    assert (state.time, state.index, state.fresh) == (start.time, start.index, True)
    v = sc.Projection(coarse)(start.q, start.p, start.time)[0]
    before = diagnostics.linear_momentum(coarse, diagnostics.momentum(coarse, v))
    after = diagnostics.linear_momentum(fine, state.p)
    np.testing.assert_allclose(after, before, rtol=0, atol=1e-12 * abs(before).max())


@pytest.mark.parametrize(
    ("order", "elements", "last"), [(2, (4, 8, 16), 1e-6), (3, (2, 4, 8), 1e-7)]
)
def test_energy_changes_by_the_error_of_interpolation(order, elements, last):
    """In finer meshes it falls with at least h^4, against the energy itself."""
    changes = []
    for count in elements:
        mesh, coarse, history = bent_state(order, count, step=0.1)
        fine = scenes.CASES["frame in time"].build(mesh.refined(), order).freeze()
        state = carry_state(coarse, fine, sc.restart(coarse, history, sc.EnergyMomentum(), 0.1))
        before = diagnostics.strain_energy(coarse, history["q"][-1])
        kinetic = diagnostics.kinetic_energy_of_velocity(coarse, history["v"][-1])
        energies = (
            diagnostics.strain_energy(fine, state.q) - before,
            diagnostics.kinetic_energy(fine, state.p) - kinetic,
        )
        changes.append(np.abs(energies) / (before + kinetic))
    orders = np.log2(np.array(changes)[:-1] / np.array(changes)[1:])
    assert (changes[-1] < last).all(), changes
    assert (orders[-1] > 3.7).all(), orders


def test_a_history_goes_on_on_the_finer_mesh(moving):
    mesh, coarse, history = moving
    fine = scenes.CASES["frame in time"].build(mesh.refined([1, 4]), 3).freeze()
    carried = carry_history(coarse, fine, history)
    assert carried.meta["carried"] == coarse.counts()
    np.testing.assert_array_equal(carried["joint/clamp/force"], history["joint/clamp/force"])
    start = sc.restart(fine, carried, sc.EnergyMomentum(), 0.05)
    assert start.time == history.times[-1]
    on = sc.simulate(fine, sc.EnergyMomentum(), sc.NullSpace(), 0.05, 2.0, start=start)
    straight = sc.simulate(coarse, sc.EnergyMomentum(), sc.NullSpace(), 0.05, 2.0)
    places = [
        scenes.CASES["frame in time"].quantity(s, h["q"][-1])
        for s, h in ((fine, on), (coarse, straight))
    ]
    assert np.linalg.norm(places[0] - places[1]) < 0.05  # of 10 m: the meshes differ by 0.02
    total = on["energy"] - on["work_loads"]
    assert abs(total - total[0]).max() < 1e-8 * on["energy"].max()
    derive_series(fine, carried)  # what depends on the mesh is made anew
    assert np.isfinite(carried["energy"]).all()


def test_a_carried_history_is_one_like_any_other(moving, tmp_path):
    """Saved, loaded, seen in ParaView, and gone on from with another integrator and treatment."""
    mesh, coarse, history = moving
    fine = scenes.CASES["frame in time"].build(mesh.refined("frame"), 2).freeze()
    carry_history(coarse, fine, history).save(tmp_path / "fine.history")
    carried = sc.History.load(tmp_path / "fine.history")
    write_paraview(carried, tmp_path / "fine", every=10)
    assert (tmp_path / "fine" / "beams.pvd").exists()
    scheme = sc.Variational()
    start = sc.restart(fine, carried, scheme, 0.01)
    on = sc.simulate(fine, scheme, sc.Multipliers(), 0.01, 1.2, start=start)
    longer = sc.simulate(coarse, sc.EnergyMomentum(), sc.NullSpace(), 0.05, 1.2)
    ends = [
        scenes.CASES["frame in time"].quantity(s, h["q"][-1])
        for s, h in ((fine, on), (coarse, longer))
    ]
    assert np.linalg.norm(ends[0] - ends[1]) < 0.02


def test_an_equilibrium_goes_on_on_the_finer_mesh():
    case = scenes.CASES["bend"]
    coarse = case.build(case.mesh, 2).freeze()
    fine = case.build(case.mesh.refined(), 2).freeze()
    path = case.run.solve(coarse, None)
    on = case.run.solve(fine, (coarse, path))
    assert len(on) == 1  # from the start itself, no path
    again = case.run.solve(fine, None)
    np.testing.assert_allclose(on["q"][-1], again["q"][-1], rtol=0, atol=1e-9)


def test_bodies_and_closed_loops_are_carried_over():
    """The swing: two links, a mass at mid-span, a closed loop."""
    case = scenes.CASES["swing"]
    mesh = case.mesh
    coarse, fine = (
        s if isinstance(s, sc.System) else s.freeze()
        for s in (case.build(mesh, 1), case.build(mesh.refined([0]), 2))
    )
    with pytest.warns(sc.AccuracyWarning, match="it takes 3 elements in place of 2"):
        history = sc.simulate(coarse, sc.EnergyMomentum(), sc.NullSpace(), 1e-2, 0.2)
    carried = carry_history(coarse, fine, history)
    start = sc.restart(fine, carried, sc.EnergyMomentum(), 1e-2)
    on = sc.simulate(fine, sc.EnergyMomentum(), sc.NullSpace(), 1e-2, 0.3, start=start)
    assert abs(on["constraint_violation"]).max() < 1e-11
    at = coarse.frame_place("left link"), fine.frame_place("left link")
    np.testing.assert_array_equal(
        carried["q"][:, at[1] : at[1] + 12], history["q"][:, at[0] : at[0] + 12]
    )


# -- beams and meshes ------------------------------------------------------------------------------


def test_refined_beam():
    """Names, parts, sections, directors, twist and velocities; places on the arc."""
    arc = sc.MeshCurve.init_arc(
        (0, 0, 0), (1, 0, 0), (0, 1, 0), 2.0, 1.5, 4, name="arc", nodes={"mid": 0.5}
    )
    mesh = arc.joined(sc.MeshCurve.init_line((0, 0, 0), (0, 0, 1), 2, name="mast"))
    other = sc.Section([2e6, 2e6, 2e6, 2e3, 2e3, 2e3], mass=2.0, inertia=(1.0, 2.0))
    speed = np.array([1.0, 2.0, 3.0])
    beam = sc.Beam(
        mesh,
        {"arc": SECTION, "mast": other},
        order=3,
        director={"arc": (0, 0, 1.0), "mast": (1.0, 0, 0)},
        twist={"arc": lambda s: 0.2 * s**2},
        velocity=lambda x: np.cross(speed, x),
        angular_velocity=speed,
    )
    finer = beam.refined([1, 5])
    assert finer.name is None and finer.mesh.nelements == 8
    assert list(finer.sections) == ["arc", "mast"]
    assert finer.section_id.tolist() == [0] * 5 + [1] * 3
    for name in ("arc.start", "arc.end", "mid", "mast.end"):
        assert finer.node(name).vertex == beam.node(name).vertex
        np.testing.assert_array_equal(finer.node(name).triad, beam.node(name).triad)
    radii = np.linalg.norm(finer.basis.nodes[finer.basis.connectivity[:5]] - (0, 2, 0), axis=-1)
    np.testing.assert_allclose(radii, 2.0, rtol=1e-14)
    assert abs(finer.angular_velocity - speed).max() < 1e-14
    wanted = np.cross(speed, finer.basis.nodes)
    assert abs(finer.velocity - wanted).max() < 1e-4  # cubic elements on an arc
    raised = beam.refined(order=4)
    assert raised.basis.order == 4 and raised.mesh.nelements == mesh.nelements
    assert beam.refined("mast").mesh.nelements == 8
    assert beam.refined(1).mesh.nelements == 12


def test_refined_beam_of_a_class_of_its_own():
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 2, name="rod")
    beam = members.SolidBeam(mesh, SECTION, third=5.0)
    finer = beam.refined([0], order=2)
    assert isinstance(finer, members.SolidBeam) and finer.third == 5.0
    assert finer.scalar_mass()[:, 3::4, 3::4].sum() == pytest.approx(5.0)


def test_places_of_lines_that_cross():
    """Two lines that lie upon each other: elements are found by their order."""
    one = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 2, name="a")
    both = one.joined(sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 3, name="b"), weld=False)
    finer = both.refined([0, 3])
    elements, xi = places_in(both, finer, np.array([0.0, 0.5, 1.0]))
    assert elements[:, 1].tolist() == [0, 0, 1, 2, 3, 3, 4]
    assert xi[1].tolist() == [0.5, 0.75, 1.0]
    # and the other way: what was halved is found in its children
    elements, xi = places_in(finer, both, np.array([0.0, 0.25, 1.0]))
    assert elements[0].tolist() == [0, 0, 1]
    np.testing.assert_allclose(xi[0], [0.0, 0.5, 1.0], rtol=0, atol=1e-15)


# -- bad input -------------------------------------------------------------------------------------


def bend(**changes):
    case = scenes.CASES["bend"]
    arguments = {
        "build": case.build,
        "mesh": case.mesh,
        "quantity": case.quantity,
        "tolerance": 1e-2,
        **changes,
    }
    return adapt(**arguments)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"tolerance": 0.0}, "tolerance = 0.0, expected a positive"),
        ({"tolerance": -1e-3}, "tolerance = -0.001"),
        ({"tolerance": float("nan")}, "tolerance = nan"),
        ({"quantity": "tip"}, "argument quantity: 'tip', expected a function"),
        ({"quantity": NodePosition("beam", "bend.end")}, r"beam 'beam'; .*known: 'bend'"),
        (
            {"quantity": NodePosition("bend", "tip")},
            "node 'tip': unknown in .* 'bend'; known nodes: 'bend.start'",
        ),
        ({"quantity": lambda system, q: np.nan}, "quantity: gave"),
        ({"build": None}, "argument build: None"),
        ({"build": lambda mesh, order: None}, "argument build: what it gave: is of type NoneType"),
        ({"mesh": None}, "argument mesh: 'mesh' is NoneType, expected MeshCurve"),
        ({"mesh": {}}, "argument mesh: there is none"),
        ({"order": 5}, "argument order: 5, expected a positive integer up to 4"),
        ({"order": {"a": 2}}, r"argument order: names \['a'\], expected \['mesh'\]"),
        ({"order": 3, "highest": 2}, "argument order: 3, expected a positive integer up to 2"),
        ({"safety": 0.5}, "argument safety: 0.5, expected 1 or more"),
        ({"levels": 0}, "argument levels: 0"),
        ({"run": "static"}, "argument run: 'static', expected a Run"),
        ({"strategy": 3}, "argument strategy: 3, expected a Strategy"),
    ],
)
def test_bad_arguments(changes, message):
    with pytest.raises(sc.InputError, match=message):
        bend(**changes)


def test_bad_builds():
    case = scenes.CASES["bend"]
    with pytest.raises(sc.InputError, match="lies on a mesh of its own"):
        bend(build=lambda mesh, order: case.build(case.mesh.refined(), order))
    with pytest.raises(sc.InputError, match="has order 2, build was asked for 3"):
        bend(build=lambda mesh, order: case.build(mesh, 2), order=2)


def test_bad_marks():
    mesh = scenes.CASES["bend"].mesh
    beam = sc.Beam(mesh, SECTION)
    with pytest.raises(sc.MeshError, match=r"element 7: the mesh has elements 0 \.\. 3"):
        beam.refined([7])
    with pytest.raises(sc.MeshError, match="beam 'tail': unknown"):
        beam.refined("tail")
    with pytest.raises(sc.InputError, match="argument order: got 5"):
        beam.refined(order=5)
    with pytest.raises(sc.InputError, match="came from another process"):
        pickle.loads(pickle.dumps(beam)).refined([0])
    with pytest.raises(sc.InputError, match="bulk = 0"):
        Halve(0)


def test_bad_runs():
    with pytest.raises(sc.InputError, match="expected ends of steps"):
        RunInTime(sc.EnergyMomentum(), 0.1, 1.0, times=[0.25])
    with pytest.raises(sc.InputError, match="expected ends of steps"):
        RunInTime(sc.EnergyMomentum(), 0.1, 1.0, times=[2.0])
    with pytest.raises(sc.InputError, match="step = 0"):
        RunInTime(sc.EnergyMomentum(), 0, 1.0)
    with pytest.raises(sc.InputError, match="control = 1"):
        RunStatic(1)


def test_other_systems(moving):
    mesh, coarse, history = moving
    model = sc.Model()
    model.add("boom", sc.Beam(mesh.refined(), SECTION))
    with pytest.raises(sc.InputError, match=r"beam 'boom': is not in the system before: .*'frame'"):
        diagnostics.transfer(coarse, model.freeze(), history["q"])
    shorter = sc.MeshCurve.init_polyline(
        [(0, 0, 0), (10, 0, 0), (10, 9, 0)], 3, name="frame", nodes={"elbow": 10 / 19}
    )
    other = scenes.CASES["frame in time"].build(shorter, 2).freeze()
    with pytest.raises(sc.MeshError, match="its lines are 19 m long"):
        diagnostics.transfer(coarse, other, history["q"])
    turned = sc.MeshCurve.init_polyline(
        [(0, 0, 0), (10, 0, 0), (10, -10, 0)], 3, name="frame", nodes={"elbow": 0.5}
    )
    other = scenes.CASES["frame in time"].build(turned, 2).freeze()
    with pytest.raises(sc.MeshError, match="expected the same lines"):
        diagnostics.transfer(coarse, other, history["q"])
    with pytest.raises(sc.HistoryError, match="another model"):
        carry_history(other, coarse, history)


def test_giving_up():
    """Too few levels: the result says so, and holds what there is."""
    with pytest.warns(sc.AccuracyWarning, match="tolerance: 1e-09 was not reached: 2 levels"):
        result = bend(tolerance=1e-9, levels=2)
    assert not result.reached and len(result.levels) == 2
    assert result.reason.startswith("2 levels")
    assert result.levels[-1].estimate > 1e-9


def test_a_step_that_is_too_long_is_told():
    """The mesh comes within a tolerance that the step, the same on all of them, does not meet."""
    case = scenes.CASES["frame in time"]
    rough = RunInTime(sc.EnergyMomentum(), 0.25, 1.0)
    tolerance = 2e-3
    with pytest.warns(sc.AccuracyWarning, match="half of it changes the quantity by"):
        result = adapt(case.build, case.mesh, case.quantity, tolerance, run=rough, order=2)
    assert not result.reached
    assert result.levels[-1].verified < tolerance < result.levels[-1].verified + result.step_error
    assert "the mesh is within the tolerance, the step is not" in result.reason
    fine = RunInTime(sc.EnergyMomentum(), 1 / 64, 1.0)
    true = fine.values(case.quantity, result.system, fine.solve(result.system, None))
    assert np.linalg.norm(true - result.value) <= 1.5 * result.step_error
