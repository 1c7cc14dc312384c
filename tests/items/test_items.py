"""Bodies, mass points, places, motions of the ground, rows of joints, models, one by one."""

from __future__ import annotations

import numpy as np
import pytest
from helpers_scenes import SHAKE, TENSOR, everything, random_state, rotation
from helpers_schemes import integrators
from scipy.spatial.transform import Rotation

from skfem_cosserat import (
    Beam,
    InputError,
    JointFixed,
    JointSpherical,
    LoadForce,
    LoadGravity,
    MassPoint,
    MeshCurve,
    Model,
    NullSpace,
    RigidBody,
    Section,
    ground,
    simulate,
    triad,
)

RNG_SEEDS = range(4)


# ----------------------------------------------------------------------- bodies
def volume_integrals(surface):
    """Volume, first and second moments of a closed triangulated surface, by tetrahedra."""
    points, faces = (np.asarray(part) for part in surface)
    V, first, second = 0.0, np.zeros(3), np.zeros((3, 3))
    for a, b, c in points[faces]:
        v = np.dot(a, np.cross(b, c)) / 6
        V += v
        first += v * (a + b + c) / 4
        s = a + b + c
        second += v / 20 * (np.outer(s, s) + sum(np.outer(x, x) for x in (a, b, c)))
    return V, first, second


SHAPES = {
    "box": (RigidBody.box(2.0, (0.3, 0.5, 0.7)), 1e-12),
    "pyramid": (RigidBody.pyramid(2.0, 0.3, 0.9), 1e-12),
    "cylinder": (RigidBody.cylinder(2.0, 0.3, 0.9), 0.03),  # 24 sides
    "sphere": (RigidBody.sphere(2.0, 0.4), 0.12),  # 8 x 16 facets
}


@pytest.mark.parametrize("name", SHAPES)
def test_shapes_have_the_inertia_of_their_surface(name):
    body, tolerance = SHAPES[name]
    V, first, second = volume_integrals(body.surface)
    assert V > 0  # facets look outwards
    assert first / V == pytest.approx(body.center, abs=1e-12)
    E = 2.0 * second / V
    assert abs(E - body.euler).max() < tolerance * body.euler.max()


def test_exact_inertia_of_round_shapes():
    J = lambda E: np.trace(E) * np.eye(3) - E  # noqa: E731 - inertia from the Euler tensor
    cylinder = J(RigidBody.cylinder(2.0, 0.3, 0.9).euler).diagonal()
    lateral = 2 * (3 * 0.3**2 + 0.9**2) / 12
    assert cylinder == pytest.approx([lateral, lateral, 0.5 * 2 * 0.3**2])
    assert J(RigidBody.sphere(2.0, 0.4).euler) == pytest.approx(0.4 * 2 * 0.16 * np.eye(3))
    rod = J(RigidBody.rod(2.0, 0.9).euler).diagonal()
    assert rod == pytest.approx([2 * 0.81 / 12, 2 * 0.81 / 12, 0])


def test_euler_tensor_of_principal_and_full_inertia():
    body = RigidBody(1.0, (2.0, 3.0, 4.0))
    assert body.euler.diagonal().tolist() == [2.5, 1.5, 0.5]  # (J_2 + J_3 - J_1)/2 and cyclic
    full = RigidBody(1.0, TENSOR)
    assert np.trace(full.euler) * np.eye(3) - full.euler == pytest.approx(TENSOR)


@pytest.mark.parametrize("seed", RNG_SEEDS)
def test_kinetic_energy_of_a_body_with_offset_centre(seed):
    """1/2 v.M v = 1/2 m v_c^2 + 1/2 omega.J_c omega, momentum and spin about the origin too."""
    rng = np.random.default_rng(seed)
    R, x, v, omega, c = rotation(rng), *rng.standard_normal((4, 3))
    body = RigidBody(
        1.7, TENSOR, position=x, triad=R.T, center=c, velocity=v, angular_velocity=omega
    )
    model = Model()
    model.add("body", body)
    system = model.freeze()
    rate = system.v0.reshape(-1, 3)
    vc, xc, J = v + np.cross(omega, R @ c), x + R @ c, R @ TENSOR @ R.T
    p = system.mass @ rate
    assert 0.5 * (rate * p).sum() == pytest.approx(0.5 * 1.7 * vc @ vc + 0.5 * omega @ J @ omega)
    assert p[0] == pytest.approx(1.7 * vc)
    spin = np.cross(system.q0.reshape(-1, 3), p).sum(0)
    assert spin == pytest.approx(1.7 * np.cross(xc, vc) + J @ omega)


def plate(on_body):
    """A body with a lump at an offset, attached or welded by a joint."""
    model = Model()
    rng = np.random.default_rng(0)
    base = model.add("base", RigidBody(1.5, TENSOR, triad=rotation(rng).T))
    x, y, center = (0.4, 0.1, -0.3), (-0.2, 0.5, 0.1), (0.1, 0, 0.2)
    if on_body:
        # the attached body is given in the triad of its host
        lump = model.add("lump", MassPoint(0.7, on=base.at(x)))
        model.add("arm", RigidBody(0.4, TENSOR, center=center, on=base.at(y)))
    else:
        lump = model.add("lump", MassPoint(0.7, position=x))
        arm = RigidBody(0.4, TENSOR, center=center, position=y, triad=base.triad)
        model.add("arm", arm)
        model.add("weld", JointFixed(base.at(y), arm.at(y)))
        model.add("pin", JointSpherical(base.at(x), lump.place()))
    model.add("gravity", LoadGravity((0, 0, -9.81)))
    model.add("pull", LoadForce(lump.place(), (30, 20, 0)))
    return model.freeze()


@pytest.mark.one_quick
@integrators
def test_attached_lumps_are_welded_bodies(integrator):
    """The same discrete motion, with fewer coordinates."""
    attached, welded = plate(True), plate(False)
    assert (attached.n, welded.n) == (12, 27)
    assert attached.unknowns == welded.unknowns == 6
    q = [
        simulate(s, integrator, NullSpace(), 0.01, 0.3, derive=False)["q"][:, :12]
        for s in (attached, welded)
    ]
    assert abs(q[0] - q[1]).max() < 1e-10
    assert abs(q[0][-1] - q[0][0]).max() > 0.3


@pytest.mark.filterwarnings("ignore::skfem_cosserat.ModelWarning")  # a strongly twisted beam
def test_lump_on_a_beam_node_with_its_own_triad():
    """Inertia of a body attached to a node is given in the node's triad."""
    mesh = MeshCurve.init_line((0, 0, 0), (1, 2, 0.5), 2)
    section = Section(np.ones(6), mass=1e-9, inertia=(1e-9, 1e-9))
    beam = Beam(mesh, section, twist=0.8, angular_velocity=(1.0, -2.0, 0.5))
    node = beam.node("beam.end")
    model = Model()
    model.add("beam", beam)
    body = model.add("body", RigidBody(0.7, TENSOR, center=(0.1, 0.2, 0.3), on=node))
    system = model.freeze()
    rate = system.v0.reshape(-1, 3)
    omega, R = np.array([1.0, -2.0, 0.5]), node.triad.T
    vc = np.cross(omega, R @ (0.1, 0.2, 0.3))
    J = R @ TENSOR @ R.T
    wanted = 0.5 * 0.7 * vc @ vc + 0.5 * omega @ J @ omega
    assert 0.5 * (rate * (system.mass @ rate)).sum() == pytest.approx(wanted, rel=1e-7)
    place = body.local((0.1, 0.2, 0.3))
    assert place.position == pytest.approx(node.position + R @ (0.1, 0.2, 0.3))
    assert place.item is beam


# ----------------------------------------------------------------------- places
@pytest.mark.parametrize("seed", RNG_SEEDS)
def test_places_of_a_body(seed):
    rng = np.random.default_rng(seed)
    R, x, X = rotation(rng), *rng.standard_normal((2, 3))
    body = RigidBody(1.0, TENSOR, position=x, triad=R.T)
    local, at = body.local(X), body.at(x + R @ X)
    assert local.offset == pytest.approx(X)
    assert at.offset == pytest.approx(X)
    assert local.position == pytest.approx(at.position)


def test_triad():
    t = triad((0, 3, 4.0), (1, 1, 0))
    assert t @ t.T == pytest.approx(np.eye(3))
    assert np.linalg.det(t) == pytest.approx(1)
    assert t[2] == pytest.approx((0, 0.6, 0.8))
    assert t[0] @ (1, 1, 0) > 0
    assert np.cross(t[2], (1, 1, 0)) @ t[0] == pytest.approx(0)


def test_motion_is_a_turn_about_its_place():
    x, t = np.array([1.0, 2.0, 3.0]), 0.6
    frame = SHAKE.frame(ground(x, SHAKE), t)
    assert frame[0] == pytest.approx(x + SHAKE.displacement(t))
    assert pytest.approx(Rotation.from_rotvec(SHAKE.rotation(t)).as_matrix()) == frame[1:].T


def test_ground_rate_is_the_derivative_of_the_ground():
    system = everything(1)
    t, e = 0.4, 1e-5
    slope = (system.ground(t + e) - system.ground(t - e)) / (2 * e)
    assert abs(system.ground_rate(t) - slope).max() < 1e-8
    assert abs(slope).max() > 0.1


# ----------------------------------------------------------------------- rows of joints
def test_jacobian_is_the_derivative_of_all_constraints():
    system = everything(1)
    rng = np.random.default_rng(0)
    y = system.extend(random_state(system, rng, 0.3), 0.3)
    y[: system.rows] += 0.1 * rng.standard_normal((system.rows, 3))
    G = system.constraints.jacobian(y).toarray()
    wanted = np.empty_like(G)
    for k in range(system.n):
        z = y.astype(complex)
        z.reshape(-1)[k] += 1e-40j
        wanted[:, k] = system.constraints.values(z).imag / 1e-40
    assert abs(G - wanted).max() < 1e-13
    # rows are quadratic: at a midpoint it is their discrete derivative, however long the way
    step = np.zeros_like(y)
    step[: system.rows] = rng.standard_normal((system.rows, 3))
    change = system.constraints.values(y + step) - system.constraints.values(y)
    G = system.constraints.jacobian(y + 0.5 * step)
    assert change == pytest.approx(G @ step[: system.rows].ravel(), abs=1e-12)
    # g_t: by the motion of the ground alone
    ahead, back = (np.vstack([y[: system.rows], system.ground(0.3 + e)]) for e in (1e-5, -1e-5))
    rate = np.zeros_like(y)
    rate[system.rows :] = system.ground_rate(0.3)
    found = system.constraints.ground_rate(y, rate)
    wanted = (system.constraints.values(ahead) - system.constraints.values(back)) / 2e-5
    assert abs(found - wanted).max() < 1e-8
    assert abs(found).max() > 0.01


# ----------------------------------------------------------------------- model
def test_model_knows_its_items():
    model = Model()
    ball = model.add("ball", MassPoint(1.0))
    assert model["ball"] is ball
    assert list(model) == ["ball"]
    assert len(model) == 1
    assert ball.label == "mass point 'ball'"


def test_numbering_follows_the_order_of_adding():
    model = Model()
    for name, item in (
        ("p", MassPoint(1.0)),
        ("b", RigidBody.sphere(1.0, 1.0)),
        ("q", MassPoint(2.0)),
    ):
        model.add(name, item)
    system = model.freeze()
    assert [system.frame_place(name) for name in ("p", "b", "q")] == [0, 3, 15]
    assert system.mass.diagonal()[[0, 1, 5]].tolist() == [1, 1, 2]


@pytest.mark.parametrize(
    ("name", "value"),
    [("position", (1, 0, 0)), ("velocity", (0, 0, 0)), ("angular_velocity", (0, 0, 1))],
)
def test_attached_bodies_have_no_placement_of_their_own(name, value):
    host = RigidBody.box(1.0, (1, 1, 1))
    with pytest.raises(InputError, match=name):
        RigidBody.sphere(1.0, 0.1, on=host.at((0, 0, 0)), **{name: value})
    if name != "angular_velocity":
        with pytest.raises(InputError, match=name):
            MassPoint(1.0, on=host.at((0, 0, 0)), **{name: value})
