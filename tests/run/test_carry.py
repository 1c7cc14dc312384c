"""States carried over to other meshes of the same scene, and beams on other meshes."""

import importlib
import pickle
import sys
from pathlib import Path

import numpy as np
import pytest
from test_starts import linkage

import skfem_cosserat as sc
from skfem_cosserat import carry_state, diagnostics
from skfem_cosserat.mesh.divide import places_in

BENCHMARKS = Path(__file__).resolve().parents[2] / "examples" / "benchmarks"
sys.path[:0] = [str(BENCHMARKS)]

members = importlib.import_module("collection.members")

SECTION = sc.Section([1e6, 1e6, 1e6, 1e3, 1e3, 1e3], mass=1.0, inertia=(10.0, 10.0))


def legs(corner, elements):
    """Two legs of 10 m each."""
    points = [(0, 0, 0), (10, 0, 0), corner]
    elbow = 10 / (10 + np.linalg.norm(np.subtract(corner, points[1])))
    return sc.MeshCurve.init_polyline(points, elements, name="frame", nodes={"elbow": elbow})


def frame(mesh, order):
    """A clamped right-angle frame with a triangular pulse of 2 s at its elbow."""
    model = sc.Model()
    beam = model.add("frame", sc.Beam(mesh, SECTION, order=order, director=(0, 0, 1)))
    model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), beam.node("frame.start")))
    pulse = sc.Table([0, 1, 2], [0, 50, 0])
    model.add("force", sc.LoadForce(beam.node("elbow"), (0, 0, 1), pulse))
    return model


def bent_state(order, elements, step=0.05):
    """The right-angle frame, moving."""
    mesh = legs((10, 10, 0), elements)
    system = frame(mesh, order).freeze()
    history = sc.simulate(system, sc.EnergyMomentum(), sc.NullSpace(), step, 1.0)
    return mesh, system, history


@pytest.fixture(scope="module")
def moving():
    return bent_state(2, 3)


@pytest.mark.parametrize("order", [1, 2, 3])
@pytest.mark.parametrize("marked", [[0, 4], 1])
def test_common_nodes_keep_their_values(moving, order, marked):
    mesh, coarse, history = moving
    fine = frame(mesh.refined(marked), order).freeze()
    q, v = diagnostics.transfer(coarse, fine, history["q"], history["v"])
    count = 12 * mesh.p.shape[1]
    np.testing.assert_array_equal(q[:, :count], history["q"][:, :count])
    np.testing.assert_array_equal(v[:, :count], history["v"][:, :count])
    violation = diagnostics.constraint_violation(fine, q, history.times)
    assert abs(violation).max() < 1e-13
    assert abs(diagnostics.hidden_violation(fine, q, v, history.times)).max() < 1e-11


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
    fine = frame(mesh.refined(), 2).freeze()
    start = sc.restart(coarse, history, sc.EnergyMomentum(), 0.05)
    state = carry_state(coarse, fine, start)
    assert (state.time, state.index, state.fresh) == (start.time, start.index, True)
    v = sc.Projection(coarse)(start.q, start.p, start.time)[0]
    before = diagnostics.linear_momentum(coarse, diagnostics.momentum(coarse, v))
    after = diagnostics.linear_momentum(fine, state.p)
    np.testing.assert_allclose(after, before, rtol=0, atol=1e-12 * abs(before).max())


@pytest.mark.slow
@pytest.mark.parametrize(
    ("order", "elements", "last"), [(2, (4, 8, 16), 1e-6), (3, (2, 4, 8), 1e-7)]
)
def test_energy_changes_by_the_error_of_interpolation(order, elements, last):
    """In finer meshes it falls with at least h^4, against the energy itself."""
    changes = []
    for count in elements:
        mesh, coarse, history = bent_state(order, count, step=0.1)
        fine = frame(mesh.refined(), order).freeze()
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


@pytest.mark.slow
def test_a_closed_loop_is_carried_over():
    """A four-bar linkage of beams: a run goes on from its state on finer meshes."""
    source, target = (linkage(elements=count).freeze() for count in (2, 3))
    start = sc.initial_state(source, rates={"pin 0": 2.0})
    arguments = sc.EnergyMomentum(), sc.NullSpace(), 1e-2
    first = sc.simulate(source, *arguments, 0.2, start=start)
    state = carry_state(source, target, sc.restart(source, first, *arguments[::2]))
    on = sc.simulate(target, *arguments, 0.3, start=state)
    assert abs(on["constraint_violation"]).max() < 1e-11
    assert abs(on["joint/pin 2/angle"][0] - first["joint/pin 2/angle"][-1]) < 1e-12


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
    assert beam.refined(order=4).basis.order == 4
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


def test_bad_marks():
    beam = sc.Beam(sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 4), SECTION)
    with pytest.raises(sc.MeshError, match=r"element numbers: number 7 is not in 0 \.\. 3"):
        beam.refined([7])
    with pytest.raises(sc.MeshError, match="beam 'tail': unknown"):
        beam.refined("tail")
    with pytest.raises(sc.InputError, match="argument order: got 9"):
        beam.refined(order=9)
    with pytest.raises(sc.InputError, match="came from another process"):
        pickle.loads(pickle.dumps(beam)).refined([0])


def test_other_systems(moving):
    mesh, coarse, history = moving
    model = sc.Model()
    model.add("boom", sc.Beam(mesh.refined(), SECTION))
    with pytest.raises(sc.InputError, match=r"beam 'boom': is not in the system before: .*'frame'"):
        diagnostics.transfer(coarse, model.freeze(), history["q"])
    shorter = frame(legs((10, 9, 0), 3), 2).freeze()
    with pytest.raises(sc.MeshError, match="its lines are 19 m long"):
        diagnostics.transfer(coarse, shorter, history["q"])
    turned = frame(legs((10, -10, 0), 3), 2).freeze()
    with pytest.raises(sc.MeshError, match="expected the same lines"):
        diagnostics.transfer(coarse, turned, history["q"])
