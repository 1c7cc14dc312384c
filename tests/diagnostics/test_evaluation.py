"""Values inside elements by evaluation, and section forces at nodes from nodal forces."""

from __future__ import annotations

import numpy as np
import pytest

from skfem_cosserat import (
    Beam,
    InputError,
    JointFixed,
    LoadControl,
    LoadForce,
    LoadGravity,
    LoadLine,
    LoadMoment,
    MeshCurve,
    MeshError,
    Model,
    RayleighDamping,
    Section,
    Spin,
    System,
    ground,
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
def test_distributed_loads(p):
    """n and m are what all loads beyond demand, at every node of a strongly deformed equilibrium.

    A line load, gravity, a following pressure, force and moment at the tip, on lines and arcs.
    """
    F, M = np.array([-2.0, 3.0, 1.0]), np.array([0.5, -1.0, 2.0])
    w, g, f = np.array([0.4, -0.7, 0.9]), np.array([0, 0, -2.0]), np.array([0.5, 0.3, 0.0])
    system, beam = cantilever(
        p,
        lambda b: LoadLine(b, w),
        lambda b: LoadGravity(g),
        lambda b: LoadLine(b, f, follower=True),
        lambda b: LoadForce(b.node("rod.end"), F),
        lambda b: LoadMoment(b.node("rod.end"), M),
        curved=p % 2 == 0,
    )
    q = static(system)["q"][-1]
    n, m, x = spatial(system, beam, q, nodal_resultants(system, beam, q))
    tip = x[-1, 1]
    assert np.linalg.norm(tip - beam.node("rod.end").position) > 0.3
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
            force = F + (beyond[:, None] * density).sum(0)
            moment = M + np.cross(tip - x[k, end], F)
            moment += (beyond[:, None] * np.cross(at.position - x[k, end], density)).sum(0)
            assert np.abs(n[k, end] - force).max() < 1e-9
            assert np.abs(m[k, end] - moment).max() < 1e-9
    # the same with factors: half of one load is an equilibrium of half of it
    none = dict.fromkeys(("load 2", "load 3", "load 4"), 0.0)
    q = static(system, factors={"load 1": 0.25} | none)["q"][-1]
    factors = [1, 0.25, 0, 0, 0]
    n, _, _ = spatial(system, beam, q, nodal_resultants(system, beam, q, amplitudes=factors))
    length = beam.basis.lengths.sum()
    assert np.abs(n[0, 0] - length * (w + 0.25 * FULL.mass * g)).max() < 1e-9
    assert np.abs(n[-1, 1]).max() < 1e-9


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
    ("call", "words"),
    [
        (lambda s, b: b.along(0.1, "mast"), "'mast'.*unknown"),
        (lambda s, b: b.along([0.1, 2.1], "rod"), r"'rod'.* 2\.1 m.*0 \.\. 2 m"),
        (lambda s, b: b.along([[0.1]], "rod"), r"'rod'.*\(1, 1\)"),
        (lambda s, b: tee(1)[1].along(0.1), "mesh.*no single line.*'bow', 'leg'"),
        (lambda s, b: evaluate(s, b, s.q0, [6], [0.5]), r"number 6 is.*0 \.\. 2"),
        (lambda s, b: evaluate(s, b, s.q0, [0], [1.1]), r"xi = 1\.1.*element 0"),
        (lambda s, b: evaluate(s, b, s.q0, [0, 1], [0.1, 0.2, 0.3]), r"xi has shape \(3,\)"),
        (lambda s, b: evaluate(s, tee(1)[1], s.q0, [0], [0.5]), "is not in this system"),
        (lambda s, b: evaluate(s, b, s.q0[:-1], [0], [0.5]), "argument q"),
        (lambda s, b: nodal_resultants(s, b, s.q0, a=np.zeros((2, s.n))), r"argument a.*\(2, 48\)"),
        (lambda s, b: nodal_resultants(s, b, s.q0, amplitudes=[1.0, 2.0]), "argument amplitudes"),
    ],
)
def test_bad_arguments(call, words):
    with pytest.raises((InputError, MeshError), match=f"(?s){words}"):
        call(*cantilever(1, lambda b: LoadLine(b, (1, 0, 0))))
