"""Values inside elements by evaluation, and section forces at nodes from nodal forces."""

from __future__ import annotations

import numpy as np
import pytest

from skfem_cosserat import (
    Beam,
    InputError,
    JointFixed,
    JointSpherical,
    LoadControl,
    LoadForce,
    LoadGravity,
    LoadLine,
    LoadMoment,
    MeshCurve,
    MeshError,
    Model,
    NullSpace,
    RayleighDamping,
    Section,
    Spin,
    System,
    Variational,
    ground,
    simulate,
    static,
)
from skfem_cosserat.diagnostics import (
    evaluate,
    nodal_resultants,
    section_forces,
    section_strains,
)
from skfem_cosserat.kernels import exp_quaternion, rotation_matrix

ORDERS = (1, 2, 3, 4)
RNG = np.random.default_rng(11)
_COUPLING = RNG.standard_normal((6, 6))
FULL = Section(
    np.diag([40.0, 50.0, 90.0, 12.0, 15.0, 8.0]) + _COUPLING @ _COUPLING.T, 1.3, (0.4, 0.7)
)
SECTION = Section([1e4, 1e4, 1e4, 500, 500, 500], mass=1.0, inertia=(10.0, 10.0))


def tee(order: int) -> tuple[System, Beam]:
    """An arc with a leg welded on in its middle: sections differ from the triad of the node."""
    arc = MeshCurve.init_arc((0, 0, 0), (1, 0, 0), (0, 1, 0), 1.0, 1.6, 4, "bow", {"mid": 0.5})
    leg = MeshCurve.init_line(arc.p[:, 2], arc.p[:, 2] + [0.1, -0.2, 0.9], 2, "leg")
    model = Model()
    beam = model.add("tee", Beam(arc + leg, FULL, order=order, twist={"leg": 0.7}))
    return model.freeze(), beam


def disturbed(system: System, states: int = 3) -> np.ndarray:
    return system.q0 + 0.2 * RNG.standard_normal((states, system.n))


# ----------------------------------------------------------------------- along and evaluate
def test_places_along_parts():
    _, beam = tee(2)
    assert np.ptp(beam.rotations) > 1  # the leg's sections are turned against the node
    e, xi = beam.along([0.0, 0.4, 0.5, 1.6], "bow")
    assert e.tolist() == [0, 1, 1, 3]
    assert np.abs(xi - [0, 0, 0.25, 1]).max() < 1e-14
    length = beam.mesh.lengths[4:].sum()
    e, xi = beam.along(0.75 * length, "leg")
    assert e.tolist() == [5]
    assert np.abs(xi - 0.5).max() < 1e-14
    # head to tail, two parts are one line; the elements of a part may be in any order
    mesh = MeshCurve.init_line((0, 0, 0), (2, 0, 0), 2, "a").joined(
        MeshCurve.init_line((2, 0, 0), (3, 0, 0), 2, "b")
    )
    mesh = mesh.with_beams({"mixed": [2, 1, 0]})
    beam = Beam(mesh, SECTION)
    assert [x.tolist() for x in beam.along([2.25])] == [[2], [0.5]]
    assert [x.tolist() for x in beam.along([2.25], "mixed")] == [[2], [0.5]]
    assert [x.tolist() for x in beam.along([0.25], "b")] == [[2], [0.5]]


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda b: b.along(0.1), ["mesh", "no single line", "'bow', 'leg'"]),
        (lambda b: b.along(0.1, "mast"), ["'mast'", "unknown"]),
        (lambda b: b.along([0.1, 1.7], "bow"), ["'bow'", "1.7 m", "0 .. 1.6 m"]),
        (lambda b: b.along(np.nan, "bow"), ["'bow'", "nan m"]),
        (lambda b: b.along([[0.1]], "bow"), ["'bow'", "(1, 1)"]),
    ],
)
def test_no_place(call, words):
    with pytest.raises(MeshError) as caught:
        call(tee(1)[1])
    assert all(word in str(caught.value) for word in words), str(caught.value)


@pytest.mark.parametrize("p", ORDERS)
def test_evaluation_meets_nodes_and_gauss_points(p):
    system, beam = tee(p)
    Q = disturbed(system)
    ne, conn = beam.basis.mesh.nelements, beam.basis.connectivity
    e = np.repeat(np.arange(ne), p + 1)
    at = evaluate(system, beam, Q, e, np.tile(beam.basis.interpolation.nodes, ne))
    nodal = Q.reshape(3, -1, 4, 3)[:, conn].reshape(3, -1, 4, 3)
    assert np.abs(at.position - nodal[:, :, 0]).max() < 1e-14
    turned = beam.rotations.reshape(-1, 3, 3) @ nodal[:, :, 1:]
    assert np.abs(at.triad - turned).max() < 1e-13
    e = np.repeat(np.arange(ne), p)
    at = evaluate(system, beam, Q, e, np.tile(beam.basis.points, ne))
    strain, force = section_strains(system, beam, Q), section_forces(system, beam, Q)
    assert np.abs(at.strain - strain.reshape(at.strain.shape)).max() < 1e-12
    assert np.abs(at.resultant - force.reshape(at.strain.shape)).max() < 1e-10
    one = evaluate(system, beam, Q[1], e, np.tile(beam.basis.points, ne))
    assert all(np.array_equal(a, b[1]) for a, b in zip(one, at, strict=True))


def smooth(z: np.ndarray) -> np.ndarray:
    """A smooth field of triads (.., 3, 3)."""
    theta = np.stack([1.1 * np.sin(z) + 0.3 * z, 0.8 * z**2, 0.7 * np.cos(1.5 * z) - 0.7], -1)
    return np.swapaxes(rotation_matrix(exp_quaternion(theta)), 1, 2)


@pytest.mark.one_quick
@pytest.mark.parametrize("p", ORDERS)
def test_directors_between_nodes(p):
    """They deviate from orthonormal, and from the exact ones, with h^(p+1)."""
    errors = []
    for elements in (16, 32):
        model = Model()
        mesh = MeshCurve.init_line((0, 0, 0), (0, 0, 2), elements)
        beam = model.add("b", Beam(mesh, SECTION, order=p, director=(1, 0, 0)))
        system = model.freeze()
        y = system.q0.reshape(-1, 4, 3).copy()
        y[:, 1:] = smooth(beam.basis.nodes[:, 2])
        s = np.linspace(0, 2, 201)
        plain = evaluate(system, beam, y.ravel(), *beam.along(s)).triad
        polar = evaluate(system, beam, y.ravel(), *beam.along(s), orthonormal=True).triad
        assert np.abs(polar @ np.swapaxes(polar, 1, 2) - np.eye(3)).max() < 1e-13
        assert np.linalg.det(polar).min() > 0
        skewed = plain @ np.swapaxes(plain, 1, 2) - np.eye(3)
        errors.append([np.abs(x).max() for x in (skewed, plain - smooth(s), polar - smooth(s))])
    assert np.abs(np.log2(np.divide(*errors)) - (p + 1)).max() < 0.2


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (([6], [0.5]), ["element numbers", "number 6", "0 .. 5"]),
        (([0.5], [0.5]), ["element numbers", "float"]),
        (([0], [1.1]), ["xi = 1.1", "element 0"]),
        (([0], [np.nan]), ["xi = nan"]),
        (([0, 1], [0.1, 0.2, 0.3]), ["xi has shape (3,)", "(2,)"]),
    ],
)
def test_no_evaluation(arguments, words):
    system, beam = tee(1)
    with pytest.raises(InputError) as caught:
        evaluate(system, beam, system.q0, *arguments)
    assert all(word in str(caught.value) for word in words), str(caught.value)
    with pytest.raises(InputError, match="is not in this system"):
        evaluate(system, tee(1)[1], system.q0, [0], [0.5])
    with pytest.raises(InputError, match="argument q"):
        evaluate(system, beam, system.q0[:-1], [0], [0.5])


# ----------------------------------------------------------------------- nodal resultants
def cantilever(order: int, *loads, elements: int = 3, curved: bool = False):
    """Clamped at the start, 2 m along x (or an arc), with load makers ``beam -> load``."""
    if curved:
        mesh = MeshCurve.init_arc((0, 0, 0), (1, 0, 0), (0, 0.6, 0.8), 1.5, 1.0, elements, "rod")
    else:
        mesh = MeshCurve.init_line((0, 0, 0), (2, 0, 0), elements, "rod")
    model = Model()
    beam = model.add("rod", Beam(mesh, FULL, order=order))
    model.add("wall", JointFixed(ground((0, 0, 0)), beam.node("rod.start")))
    for k, load in enumerate(loads):
        model.add(f"load {k}", load(beam))
    return model.freeze(), beam


def spatial(system: System, beam: Beam, q: np.ndarray, local: np.ndarray) -> np.ndarray:
    """Components (ne, 2, 6) in sections -> forces and moments in space (ne, 2, 2, 3), places."""
    ends = beam.basis.connectivity[:, [0, -1]]
    y = q.reshape(-1, 4, 3)[ends]
    triads = beam.rotations[:, [0, -1]] @ y[:, :, 1:]
    return (
        np.einsum("eki,ekic->ekc", local[..., :3], triads),
        np.einsum("eki,ekic->ekc", local[..., 3:], triads),
        y[:, :, 0],
    )


@pytest.mark.slow
@pytest.mark.parametrize("p", ORDERS)
@pytest.mark.parametrize("curved", [False, True])
def test_tip_force(p, curved):
    """n is the force, m = r x F exactly, at every node of a strongly deformed equilibrium."""
    F, M = np.array([-2.0, 3.0, 1.0]), np.array([0.5, -1.0, 2.0])
    system, beam = cantilever(
        p,
        lambda b: LoadForce(b.node("rod.end"), F),
        lambda b: LoadMoment(b.node("rod.end"), M),
        curved=curved,
    )
    history = static(system)
    q = history["q"][-1]
    tip = q.reshape(-1, 4, 3)[beam.node("rod.end").vertex, 0]
    assert np.linalg.norm(tip - beam.basis.nodes[beam.node("rod.end").vertex]) > 0.3
    n, m, x = spatial(system, beam, q, nodal_resultants(system, beam, q))
    assert np.abs(n - F).max() < 1e-9
    assert np.abs(m - M - np.cross(tip - x, F)).max() < 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("p", ORDERS)
def test_distributed_loads(p):
    """A line load on all, gravity, and a following pressure: n and m as the loads beyond demand."""
    w, g, f = np.array([0.4, -0.7, 0.9]), np.array([0, 0, -2.0]), np.array([0.5, 0.3, 0.0])
    system, beam = cantilever(
        p,
        lambda b: LoadLine(b, w),
        lambda b: LoadGravity(g),
        lambda b: LoadLine(b, f, follower=True),
    )
    q = static(system)["q"][-1]
    n, m, x = spatial(system, beam, q, nodal_resultants(system, beam, q))
    # the loads between a node and the tip, integrated over the interpolated line
    s, weight = np.polynomial.legendre.leggauss(8)
    ne = len(beam.basis.lengths)
    e, xi = np.repeat(np.arange(ne), 8), np.tile((s + 1) / 2, ne)
    ds = (beam.basis.lengths[:, None] * weight / 2).ravel()
    at = evaluate(system, beam, q, e, xi)
    density = w + FULL.mass * g + np.einsum("i,mic->mc", f, at.triad)
    for k in range(ne):
        for end in (0, 1):
            beyond = (e >= k + end) * ds
            force = (beyond[:, None] * density).sum(0)
            moment = (beyond[:, None] * np.cross(at.position - x[k, end], density)).sum(0)
            assert np.abs(n[k, end] - force).max() < 1e-9
            assert np.abs(m[k, end] - moment).max() < 1e-9
    # the same with factors: half of one load is an equilibrium of half of it
    q = static(system, factors={"load 1": 0.25, "load 2": 0.0})["q"][-1]
    n, _, _ = spatial(system, beam, q, nodal_resultants(system, beam, q, amplitudes=[1, 0.25, 0]))
    assert np.abs(n[0, 0] - 2.0 * (w + 0.25 * FULL.mass * g)).max() < 1e-9
    assert np.abs(n[-1, 1]).max() < 1e-9


def clamped_arc(order: int, elements: int):
    """Clamped at both ends and loaded along its line: forces depend on the deflection."""
    mesh = MeshCurve.init_arc((0, 0, 0), (1, 0, 0), (0, 0.6, 0.8), 1.5, 1.0, elements, "rod")
    model = Model()
    beam = model.add("rod", Beam(mesh, FULL, order=order))
    for end in ("start", "end"):
        node = beam.node(f"rod.{end}")
        model.add(end, JointFixed(ground(node.position), node))
    model.add("load", LoadLine(beam, (3.0, -12.0, 8.0)))
    system = model.freeze()
    history = static(system, watch=False)
    return system, beam, history["q"][-1], history


@pytest.fixture(scope="module")
def fine_arc():
    """A reference for all orders."""
    return clamped_arc(4, 48)[:3]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("p", "elements"), [(1, (16, 32)), (2, (8, 16)), (3, (4, 8, 16)), (4, (2, 4, 8))]
)
def test_orders_of_resultants(p, elements, fine_arc):
    """At nodes 2 p (two coarsest meshes), at Gauss points p + 1 (two finest)."""
    system, beam, q = fine_arc
    root = nodal_resultants(system, beam, q)[0, 0]
    nodal, gauss = [], []
    for count in elements:
        coarse, own, q_c, history = clamped_arc(p, count)
        found = nodal_resultants(coarse, own, q_c)
        nodal.append(np.abs(found[0, 0] - root).max())
        n, _, _ = spatial(coarse, own, q_c, found)
        assert np.abs(n[0, 0] + history["joint/start/force"][-1]).max() < 1e-9
        s = own.basis.lengths[:, None] * (np.arange(count)[:, None] + own.basis.points)
        exact = evaluate(system, beam, q, *beam.along(s.ravel())).resultant
        gauss.append(np.abs(section_forces(coarse, own, q_c).reshape(-1, 6) - exact).max())
    assert abs(np.log2(nodal[0] / nodal[1]) - 2 * p) < 0.1
    assert abs(np.log2(gauss[-2] / gauss[-1]) - (p + 1)) < 0.15


def test_steady_rotation():
    """A rotor at rest in its frame: n turns all that is further out, and the tip is free."""
    W, point = np.array([0.0, 0.3, 1.5]), np.array([-0.5, 0.0, 0.0])
    system, beam = cantilever(3)
    q = static(system, None, LoadControl(turn=None), spin=Spin(W, point), watch=False)["q"][-1]
    arms = q.reshape(-1, 4, 3).copy()
    arms[:, 0] -= point
    a = np.cross(W, np.cross(W, arms))
    n, m, _ = spatial(system, beam, q, nodal_resultants(system, beam, q, a=a.ravel()))
    density = FULL.mass * np.einsum(
        "ea,eac->ec", beam.basis.elemental_load(), a[beam.basis.connectivity, 0]
    )
    assert np.abs(density).max() > 1.0
    for k in range(3):
        assert np.abs(n[k, 0] + density[k:].sum(0)).max() < 1e-9
    assert np.abs(n[-1, 1]).max() < 1e-9
    assert np.abs(m[-1, 1]).max() < 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("p", [1, 3])
def test_moving_beam(p):
    """A flexible pendulum: at the pin n is the reaction, at the tip zero, to second order."""
    section = Section([1e3, 1e3, 1e4, 50, 50, 50], mass=1.0, inertia=(0.01, 0.01))
    errors = []
    for h in (5e-4, 2.5e-4):
        model = Model()
        mesh = MeshCurve.init_line((0, 0, 0), (1, 0, 0), 2, "rod")
        start = {"velocity": lambda x: np.cross((0, 0, 2.0), x), "angular_velocity": (0, 0, 2.0)}
        beam = model.add("rod", Beam(mesh, section, order=p, **start))
        pin = JointSpherical(ground((0, 0, 0)), beam.node("rod.start"))
        model.add("pin", pin)
        model.add("gravity", LoadGravity((0, -9.81, 0)))
        system = model.freeze()
        history = simulate(system, Variational(), NullSpace(), h, until=0.05 + 2 * h)
        k, q = round(0.05 / h), history["q"]
        a = (q[k + 1] - 2 * q[k] + q[k - 1]) / h**2
        n, m, _ = spatial(system, beam, q[k], nodal_resultants(system, beam, q[k], a=a))
        reaction = history["joint/pin/force"][k]
        assert np.linalg.norm(reaction) > 1.0
        errors.append(max(np.abs(n[0, 0] + reaction).max(), np.abs(n[-1, 1]).max()))
        assert max(errors[-1], np.abs(m[[0, -1], [0, 1]]).max()) < 0.05
    assert errors[1] < 0.4 * errors[0]


def test_damping_forces():
    """A viscous bar: its rate adds to N, its drag is taken from where it moves."""
    model = Model()
    mesh = MeshCurve.init_line((0, 0, 0), (0, 0, 2), 1)
    damped = SECTION.damped(time=0.1)
    beam = model.add("b", Beam(mesh, damped, director=(1, 0, 0)))
    model.add("drag", RayleighDamping(mass=3.0))
    system = model.freeze()
    v = np.zeros((2, system.n))
    v[:, 14] = 0.02  # the end moves away
    q = np.tile(system.q0, (2, 1))
    found = nodal_resultants(system, beam, q, v=v)
    # 100 N s; drag alpha (rho l) v with 1/6 and 1/3 of it at the two ends
    expected = np.zeros((2, 1, 2, 6))
    expected[..., 2] = 1e4 * 0.1 * 0.01 + 3.0 * 2.0 * 0.02 * np.array([-1 / 6, 1 / 3])
    assert np.abs(found - expected).max() < 1e-12
    assert np.abs(nodal_resultants(system, beam, q)).max() == 0


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"v": np.zeros(3)}, ["argument v"]),
        ({"a": np.zeros((2, 3 * 4 * 4))}, ["argument a", "(2, 48)"]),
        ({"amplitudes": [1.0, 2.0]}, ["argument amplitudes", "(2,)", "(1,)"]),
    ],
)
def test_no_resultants(options, words):
    system, beam = cantilever(1, lambda b: LoadLine(b, (1, 0, 0)))
    with pytest.raises(InputError) as caught:
        nodal_resultants(system, beam, system.q0, **options)
    assert all(word in str(caught.value) for word in words), str(caught.value)
