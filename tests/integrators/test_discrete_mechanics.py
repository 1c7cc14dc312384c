"""Discrete Legendre transforms, momenta on the hidden constraints, multipliers, momentum maps."""

from functools import cache

import numpy as np
import pytest
from helpers_kernels import INTEGRATORS, TREATMENTS, treatments
from helpers_scenes import (
    FULL,
    TENSOR,
    everything,
    four_bar,
    random_state,
    random_tree,
    swing,
    triangle,
)
from scipy.sparse import csr_matrix

import skfem_cosserat as sc
from skfem_cosserat import Projection, diagnostics

SHARP = sc.NewtonSettings(increment=1e-17)


def section():
    return sc.Section([40, 40, 60, 6, 6, 5], mass=1.0, inertia=(0.1, 0.08))


def line(count=2):
    return sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), count, "beam")


# -- scenes ----------------------------------------------------------------------------------------


def chain():
    """Rigid: three bodies and a point in space, of all tree joints, under gravity."""
    model = sc.Model()
    one = model.add("one", sc.RigidBody(1.5, TENSOR, center=(0.1, 0, -0.1), position=(0.4, 0, 0)))
    two = model.add("two", sc.RigidBody(0.8, TENSOR, position=(1.1, 0.2, 0)))
    three = model.add("three", sc.RigidBody(0.6, TENSOR, position=(1.6, 0, 0.3)))
    bob = model.add("bob", sc.MassPoint(0.5, (2.2, 0.1, 0)))
    model.add("hook", sc.JointSpherical(sc.ground((0, 0, 0)), one.at((0, 0, 0))))
    x = (0.8, 0.1, 0)
    model.add("hinge", sc.JointRevolute(one.at(x), two.at(x), (0, 0.6, 0.8)))
    model.add("weld", sc.JointFixed(two.at((1.4, 0, 0)), three.at((1.4, 0, 0))))
    model.add("string", sc.JointDistance(three.at((1.8, 0, 0)), bob.place()))
    model.add("gravity", sc.LoadGravity((0, 0, -9.81)))
    return model.freeze()


def free():
    """Flexible beam with a body at each end, no ground, in fast motion."""

    def velocity(x):
        return np.c_[0 * x[:, 0], x[:, 0] ** 0, 0.5 * np.cos(3 * x[:, 0])]

    model = sc.Model()
    spin = (1.0, 0.3, 1.5)
    beam = sc.Beam(line(), section(), velocity=velocity, angular_velocity=spin)
    model.add("beam", beam)
    body = sc.RigidBody(0.8, TENSOR, center=(0.1, 0, 0.05), position=(1.3, 0.1, 0))
    tail = sc.RigidBody(0.5, TENSOR, position=(-0.3, 0, 0.1))
    model.add("body", body)
    model.add("tail", tail)
    model.add("ball joint", sc.JointSpherical(beam.node("beam.end"), body.at((1, 0, 0))))
    model.add("hinge", sc.JointRevolute(tail.at((0, 0, 0)), beam.node("beam.start"), (1, 0, 0)))
    return model.freeze()


SCENES = {"swing": swing, "chain": chain, "everything": everything, "free": free}


@cache
def system_of(scene):
    return SCENES[scene]()


@cache
def run(scene, integrator, treatment, step, until):
    system = system_of(scene)
    start = sc.initial_state(system, v=sc.project(system, system.q0, system.v0))
    scheme = INTEGRATORS[integrator]
    return sc.simulate(
        system, scheme, TREATMENTS[treatment], step, until, start=start, settings=SHARP
    )


def random_case(system, seed, t=0.2):
    """A configuration on the constraints at time t, and any momentum."""
    rng = np.random.default_rng(seed)
    return random_state(system, rng, t), rng.standard_normal(system.n), t


def dense_mass(system):
    return np.kron(system.mass.toarray(), np.eye(3))


def null_space(system, q, t):
    return csr_matrix(system.null_space(q, t)).toarray()


# -- Legendre transforms ---------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scene", "step", "until", "treatment"),
    [
        ("swing", 1e-2, 0.5, "null space"),
        ("chain", 1e-2, 0.5, "multipliers"),
        ("everything", 5e-3, 0.1, "null space"),
        ("free", 1e-2, 0.4, "multipliers"),
    ],
)
def test_both_legendre_transforms_are_equal(scene, step, until, treatment):
    """To rounding of the largest momentum; p_0 as given included."""
    system, history = system_of(scene), run(scene, "variational", treatment, step, until)
    minus, plus = diagnostics.legendre_transforms(system, history)
    size = abs(history["p"]).max()
    assert np.isnan(plus[[0, -1]]).all() and np.isnan(minus[-1]).all()
    assert abs(minus - plus)[1:-1].max() < 1e-11 * size
    assert abs(minus - history["p"])[:-1].max() < 1e-11 * size
    part = 0.5 * step * np.nanmax(abs(history["constraint_force"]))
    assert part > 1e-3 * size  # there is something to agree on


X = np.array([0.2, -0.1, 0.3])  # where the forces act, in the body


def loaded():
    """Beam hung on a moving ground, with a body under each kind of load."""
    drive = sc.ground((0, 0, 0), sc.Motion(lambda t: (0.1 * np.sin(2 * t), 0, 0.3 * t**2)))
    model = sc.Model()
    beam = model.add("beam", sc.Beam(line(), sc.Section(FULL, mass=1.3, inertia=(0.11, 0.07))))
    body = model.add("body", sc.RigidBody(0.8, TENSOR, center=(0.1, 0, 0.05), position=(1.2, 0, 0)))
    model.add("hook", sc.JointSpherical(drive, beam.node("beam.start")))
    model.add("ball joint", sc.JointSpherical(beam.node("beam.end"), body.at((1, 0, 0))))
    model.add("gravity", sc.LoadGravity((0.5, 0, -9.81)))
    wave = sc.FunctionOfTime(lambda t: 1 + np.cos(3 * t))
    model.add("follower", sc.LoadForce(body.local(X), (-2, 1, 3), wave, follower=True))
    model.add("force", sc.LoadForce(body.local(X), lambda t: (t, 1, t**2)))
    model.add("moment", sc.LoadMoment(body.local(X), (3, 1, 2)))
    model.add("turning moment", sc.LoadMoment(body.local(X), (1, -1, 2), follower=True))
    return model.freeze(), slice(36, 48)  # the body comes after three nodes


def discrete_lagrangian(system, q0, q1, h):
    """``h L((q_0 + q_1)/2, (q_1 - q_0)/h)`` without loads; takes complex numbers."""
    v = ((q1 - q0) / h).reshape(-1, 3)
    kinetic = 0.5 * (v * (system.mass @ v)).sum()
    y = np.zeros((system.total, 3), dtype=v.dtype)
    y[: system.rows] = ((q0 + q1) / 2).reshape(-1, 3)
    stored = 0.0
    for group, (eps, _) in zip(system.beam_groups, system.strain(y), strict=True):
        e = group.elements
        density = 0.5 * np.einsum("egi,egij,egj->eg", eps, e.stiffness, eps)
        stored = stored + np.einsum("eg,g,e->", density, e.weights, e.lengths)
    return h * (kinetic - stored)


def slope(function, q):
    """Gradient by the complex step."""
    out = np.empty(len(q))
    for k in range(len(q)):
        z = q.astype(complex)
        z[k] += 1e-40j
        out[k] = function(z).imag / 1e-40
    return out


def load_of_a_step(system, part, mid, t0, t1):
    """Generalised force of all loads of `loaded`, written out."""
    f = (
        system.mass @ np.where(np.arange(system.rows)[:, None] % 4 == 0, (0.5, 0, -9.81), 0)
    ).ravel()
    D = mid[part].reshape(4, 3)[1:]
    h = t1 - t0
    wave = 1 + (np.sin(3 * t1) - np.sin(3 * t0)) / (3 * h)
    force = wave * np.array([-2, 1, 3]) @ D
    force = force + [(t0 + t1) / 2, 1, (t0**2 + t0 * t1 + t1**2) / 3]
    moment = np.array([3, 1, 2]) + np.array([1, -1, 2]) @ D
    couple = 0.5 * np.cross(moment, np.linalg.inv(D).T)
    f[part] += np.concatenate([force, (np.outer(X, force) + couple).ravel()])
    return f


def test_transforms_are_derivatives_of_the_discrete_lagrangian():
    """(34) and (35) with L_d by the complex step and all loads written out."""
    system, part = loaded()
    h = 0.01
    start = sc.initial_state(system, v=sc.project(system, system.q0, system.v0))
    run, reports = (system, sc.Variational(), sc.Multipliers(), h, 0.05), []
    history = sc.simulate(*run, start=start, callbacks=[reports.append])
    minus, plus = diagnostics.legendre_transforms(system, history)
    q, t, force = history["q"], history.times, history["constraint_force"].copy()
    force[0] = reports[0].constraint_force  # that of the equations, for a given momentum
    size = abs(history["p"]).max()
    for n in range(len(q) - 2):
        a, b = q[n], q[n + 1]
        left = -slope(lambda x: discrete_lagrangian(system, x, b, h), a)  # noqa: B023
        right = slope(lambda x: discrete_lagrangian(system, a, x, h), b)  # noqa: B023
        load = 0.5 * h * load_of_a_step(system, part, (a + b) / 2, t[n], t[n + 1])
        assert abs(minus[n] - (left - load + 0.5 * h * force[n])).max() < 1e-13 * size
        assert abs(plus[n + 1] - (right + load - 0.5 * h * force[n + 1])).max() < 1e-13 * size
        assert abs(load).max() > 1e-3 * size


def test_transforms_where_a_run_goes_on():
    system = system_of("chain")
    whole = sc.simulate(system, sc.Variational(), sc.NullSpace(), 0.01, 0.2)
    first = sc.simulate(system, sc.Variational(), sc.NullSpace(), 0.01, 0.1)
    start = sc.restart(system, first, sc.Variational(), 0.01)
    second = sc.simulate(system, sc.Variational(), sc.NullSpace(), 0.01, 0.2, start=start)
    minus, plus = diagnostics.legendre_transforms(system, second)
    assert abs(minus - plus)[:-1].max() < 1e-12 * abs(second["p"]).max()
    assert abs(minus - whole["p"][10:])[:-1].max() < 1e-11 * abs(second["p"]).max()


def wheel():
    """It winds its spring, which has a damper, up by almost four turns."""
    model = sc.Model()
    spin = {"angular_velocity": (0, 0, 40.0)}
    body = model.add("wheel", sc.RigidBody(1.0, (0.2, 0.3, 0.4), **spin))
    hinge = sc.JointRevolute(sc.ground((0, 0, 0)), body.at((0, 0, 0)), axis=(0, 0, 1))
    model.add(
        "spring", sc.JointSpringDamper(model.add("hinge", hinge), stiffness=1.0, damping=0.05)
    )
    return model.freeze()


@pytest.mark.slow
def test_transforms_with_springs_and_dampers():
    system = wheel()
    history = sc.simulate(system, sc.Variational(), sc.Multipliers(), 0.005, 1.0)
    minus, plus = diagnostics.legendre_transforms(system, history)
    assert abs(history["turns"]).max() == 4
    assert abs(minus - plus)[1:-1].max() < 1e-12 * abs(history["p"]).max()


def test_transforms_refuse_other_histories():
    system = system_of("chain")
    other = sc.simulate(system, sc.EnergyMomentum(), sc.NullSpace(), 0.01, 0.1)
    with pytest.raises(sc.IncompatibleError, match=r"'variational'.*'energy-momentum'"):
        diagnostics.legendre_transforms(system, other)
    sparse = sc.simulate(system, sc.Variational(), sc.NullSpace(), 0.01, 0.1, every=2)
    with pytest.raises(sc.IncompatibleError, match=r"Legendre.*step 0 to 2.*every=1"):
        diagnostics.legendre_transforms(system, sparse)
    history = sc.simulate(system, sc.Variational(), sc.NullSpace(), 0.01, 0.1)
    with pytest.raises(sc.InputError, match=r"history: has shape \(11, 39\)"):
        diagnostics.legendre_transforms(system_of("free"), history)


# -- projections -----------------------------------------------------------------------------------


@pytest.mark.parametrize("scene", ["swing", "chain", "everything", "free"])
def test_null_space_form_is_the_saddle_point(scene):
    """Driven ground in "everything" included: v = P nu + qdot_prescribed."""
    system = system_of(scene)
    for seed in range(3):
        q, p, t = random_case(system, seed)
        v, Qp = Projection(system)(q, p, t)
        w, reduced = Projection(system, "reduced")(q, p, t)
        assert abs(v - w).max() < 1e-12 * abs(v).max()
        assert abs(Qp - reduced).max() < 1e-11 * abs(p).max()
        for velocity in (v, w):
            assert diagnostics.hidden_violation(system, q, velocity, t) < 1e-12 * abs(v).max()
        # what is taken away is a constraint force
        P = null_space(system, q, t)
        assert abs(P.T @ (p - Qp)).max() < 1e-12 * abs(p).max()
        again = Projection(system)(q, Qp, t)
        assert abs(again[1] - Qp).max() < 1e-12 * abs(Qp).max()
        assert abs(again[0] - v).max() < 1e-12 * abs(v).max()


@pytest.mark.parametrize("seed", range(4))
def test_null_space_form_on_random_trees(seed):
    system = random_tree(seed)
    q, p, t = random_case(system, seed)
    v, w = (Projection(system, method)(q, p, t)[0] for method in ("saddle-point", "reduced"))
    assert abs(v - w).max() < 1e-11 * abs(v).max()


def beam_on_ground(joint=None):
    """A beam held at one end by a ball joint, at the other by another joint or not at all."""
    model = sc.Model()
    beam = model.add("beam", sc.Beam(line(), section()))
    model.add("hook", sc.JointSpherical(sc.ground((0, 0, 0)), beam.node("beam.start")))
    if joint is not None:
        body = model.add("body", sc.RigidBody(0.8, TENSOR, position=(1.3, 0, 0)))
        options = {"axis": (0.6, 0, 0.8)} if joint is sc.JointRevolute else {}
        end = beam.node("beam.end")
        model.add("joint", joint(end, body.at((1, 0, 0)), **options))
    return model.freeze()


#: rows of 36 coordinates of three nodes without d3, and constraint rows without d3
BARE = np.flatnonzero(np.arange(36) % 12 < 9)
BARE_ROWS = [6 * k + i for k in range(3) for i in (0, 1, 3)] + [18, 19, 20]


def test_dropped_directors_are_the_papers_formula():
    """(116) with dense matrices for a beam on a ball joint; zeros in the d3 blocks."""
    system = beam_on_ground()
    q, p, t = random_case(system, 3)
    M = dense_mass(system)[np.ix_(BARE, BARE)]
    G = system.constraints.jacobian(system.extend(q, t)).toarray()[np.ix_(BARE_ROWS, BARE)]
    W = np.linalg.inv(M)
    Q = np.eye(len(BARE)) - G.T @ np.linalg.solve(G @ W @ G.T, G @ W)
    v, Qp = Projection(system, "directors-dropped")(q, p, t)
    rest = np.setdiff1d(np.arange(36), BARE)
    assert abs(Qp[BARE] - Q @ p[BARE]).max() < 1e-12 * abs(p).max()
    assert abs(v[BARE] - W @ Q @ p[BARE]).max() < 1e-12 * abs(v).max()
    assert not Qp[rest].any() and not v[rest].any()
    assert diagnostics.momentum_violation(system, q, Qp, t) < 1e-12 * abs(v).max()
    assert abs(G @ W @ p[BARE]).max() == pytest.approx(
        diagnostics.momentum_violation(system, q, p, t), rel=1e-12
    )


@pytest.mark.parametrize("joint", [None, sc.JointSpherical, sc.JointRevolute, sc.JointFixed])
@pytest.mark.parametrize("third", [False, True])
def test_dropped_directors_agree_only_without_third_momenta_and_joints(joint, third):
    """Both directions: equal iff p_3 = 0 and no joint touches a beam's d3."""
    system = beam_on_ground(joint)
    q, p, t = random_case(system, 4)
    if not third:
        p[np.repeat(system.mass.diagonal() == 0, 3)] = 0
    one, two = (Projection(system, m)(q, p, t)[1] for m in ("saddle-point", "directors-dropped"))
    gap = abs(one - two).max() / abs(p).max()
    if not third and joint in (None, sc.JointSpherical):
        assert gap < 1e-12
    else:
        assert gap > 1e-3


@pytest.mark.one_quick
@pytest.mark.parametrize("method", ["saddle-point", "directors-dropped", "reduced"])
@pytest.mark.parametrize(("scene", "h", "until"), [("free", 1e-2, 0.4), ("everything", 5e-3, 0.1)])
def test_projected_momenta_fulfil_the_hidden_constraints(scene, h, until, method):
    """Of a run: to 1e-12 where the momenta themselves miss them by much more."""
    system, history = system_of(scene), run(scene, "variational", "null space", h, until)
    q, p, t = history["q"], history["p"], history.times
    v, Qp = Projection(system, method).stack(q, p, t)
    size = abs(v).max()
    assert diagnostics.momentum_violation(system, q, p, t)[1:-1].min() > 1e-6 * size
    assert diagnostics.momentum_violation(system, q, Qp, t).max() < 1e-12 * size
    if method != "directors-dropped":
        assert diagnostics.hidden_violation(system, q, v, t).max() < 1e-12 * size


def test_projection_of_momenta_that_are_not_known():
    system = system_of("chain")
    q = np.array([system.q0, system.q0])
    p = np.array([np.ones(system.n), np.full(system.n, np.nan)])
    v, Qp = Projection(system).stack(q, p, 0.0)
    assert np.isfinite(v[0]).all() and np.isnan(v[1]).all() and np.isnan(Qp[1]).all()


def test_projection_refuses_other_methods():
    known = r"'paper'.*'saddle-point', 'directors-dropped', 'reduced'"
    with pytest.raises(sc.InputError, match=known):
        Projection(system_of("chain"), "paper")


# -- redundant constraints -------------------------------------------------------------------------


def loop_with_beam():
    """A planar linkage with three redundant rows, and a beam clamped to the ground."""
    model = four_bar()
    beam = model.add("beam", sc.Beam(line(), section()))
    model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), beam.node("beam.start")))
    return model.freeze()


@pytest.mark.parametrize("scene", [lambda: four_bar().freeze(), loop_with_beam])
def test_multipliers_of_least_norm(scene):
    """Against the pseudo-inverse of G^T; the force comes out whichever multipliers made it."""
    system = scene()
    assert system.m - system.rank == 3
    y = system.extend(system.q0, 0.0)
    G = system.constraints.jacobian(y).toarray()
    lam = np.random.default_rng(1).standard_normal(system.m)
    force = G.T @ lam
    found = diagnostics.multipliers(system, y[None], force[None])[0]
    # rank by a gap: by default pinv cuts at rounding, where the three redundant rows are
    s = np.linalg.svd(G, compute_uv=False)
    assert s[system.rank - 1] > 1e-3 * s[0] and s[system.rank] < 1e-12 * s[0]
    assert abs(found - np.linalg.pinv(G.T, 1e-8) @ force).max() < 1e-12 * abs(lam).max()
    assert abs(G.T @ found - force).max() < 1e-12 * abs(force).max()
    assert np.linalg.norm(found) < np.linalg.norm(lam) and abs(found - lam).max() > 0.1


def test_projection_with_redundant_rows():
    """Against a dense least-squares solution of the saddle point with all rows."""
    system = loop_with_beam()
    p = np.random.default_rng(2).standard_normal(system.n)
    y = system.extend(system.q0, 0.0)
    G, M = system.constraints.jacobian(y).toarray(), dense_mass(system)
    K = np.block([[M, G.T], [G, np.zeros((len(G), len(G)))]])
    rhs = np.concatenate([p, np.zeros(len(G))])
    expected = np.linalg.lstsq(K, rhs, rcond=1e-12)[0][: system.n]
    v, Qp = Projection(system)(system.q0, p)
    assert abs(v - expected).max() < 1e-12 * abs(v).max()
    assert abs(Qp - M @ expected).max() < 1e-12 * abs(p).max()


@pytest.mark.slow
@treatments
@pytest.mark.parametrize("scene", [four_bar, triangle])
def test_closed_loops(scene, treatment):
    """With and without redundant rows: the same statements as for trees."""
    system = scene().freeze()
    start = sc.initial_state(system, nu=np.linspace(1, 2, system.unknowns))
    run = system, sc.Variational(), TREATMENTS[treatment], 0.01, 0.15
    history = sc.simulate(*run, start=start, settings=SHARP)
    q, p, t = history["q"], history["p"], history.times
    minus, plus = diagnostics.legendre_transforms(system, history)
    assert abs(minus - plus)[1:-1].max() < 1e-12 * abs(p).max()
    y = diagnostics.constraint_points(system, history)
    pairs = zip(y, history["multipliers"], strict=True)
    force = np.array([system.constraints.jacobian(row).T @ lam for row, lam in pairs])
    assert abs(force - history["constraint_force"])[1:-1].max() < 1e-10 * abs(force).max()
    v = Projection(system).stack(q, p, t)[0]
    pi = diagnostics.reduced_momentum(system, q, p, t)
    for other in (
        Projection(system, "reduced").stack(q, p, t)[0],
        diagnostics.velocity_from_reduced(system, q, pi, t),
    ):
        assert abs(other - v).max() < 1e-12 * abs(v).max()


# -- reduced momenta and velocities ----------------------------------------------------------------


@pytest.mark.slow
def test_reduced_momentum_of_a_hinge():
    """Against the closed form (J + m c^2) omega, in any position."""
    model = sc.Model()
    body = sc.RigidBody(2.0, (0.3, 0.4, 0.5), position=(0.6, 0, 0), angular_velocity=(0, 0, 3.0))
    model.add("body", body)
    hinge = sc.JointRevolute(sc.ground((0, 0, 0)), body.at((0, 0, 0)), axis=(0, 0, 1.0))
    model.add("hinge", hinge)
    system = model.freeze()
    start = sc.initial_state(system, v=sc.project(system, system.q0, system.v0))
    history = sc.simulate(system, sc.Variational(), sc.NullSpace(), 0.01, 0.5, start=start)
    pi = diagnostics.reduced_momentum(system, history["q"], history["p"])
    inertia = 0.5 + 2.0 * 0.6**2
    omega = pi[0, 0] / inertia
    assert abs(pi - pi[0]).max() < 1e-12 * abs(pi[0, 0])
    v = diagnostics.velocity_from_reduced(system, history["q"], pi)
    x = history["q"][:, :3]
    assert abs(v[:, :3] - np.cross((0, 0, omega), x)).max() < 1e-12 * abs(omega)


@pytest.mark.parametrize("scene", ["swing", "everything", "free"])
def test_reduced_momentum_and_back(scene):
    """P^T takes away constraint forces, and gives the velocity of the saddle point."""
    system = system_of(scene)
    cases = [random_case(system, seed) for seed in range(3)]
    q, p = (np.array([case[k] for case in cases]) for k in (0, 1))
    v, Qp = Projection(system).stack(q, p, 0.2)
    pi = diagnostics.reduced_momentum(system, q, p, 0.2)
    assert pi.shape == (3, system.n - system.m)
    of_projected = diagnostics.reduced_momentum(system, q, Qp, 0.2)
    assert abs(of_projected - pi).max() < 1e-12 * abs(p).max()
    back = diagnostics.velocity_from_reduced(system, q, pi, 0.2)
    assert abs(back - v).max() < 1e-12 * abs(v).max()
    with pytest.raises(sc.InputError, match=r"argument reduced.*shape"):
        diagnostics.velocity_from_reduced(system, q[0], pi[0][1:], 0.2)


def test_prescribed_velocity_has_least_kinetic_energy():
    """Against a dense solution; its reduced momentum is zero."""
    system = system_of("everything")
    q, _, t = random_case(system, 5)
    v = diagnostics.prescribed_velocity(system, q, t)
    y = system.extend(q, t)
    G, M = system.constraints.jacobian(y).toarray(), dense_mass(system)
    K = np.block([[M, G.T], [G, np.zeros((system.m, system.m))]])
    rhs = np.concatenate([np.zeros(system.n), -diagnostics.ground_part(system, y, t)])
    assert abs(v - np.linalg.solve(K, rhs)[: system.n]).max() < 1e-11 * abs(v).max()
    assert abs(v).max() > 0.1
    pi = diagnostics.reduced_momentum(system, q, diagnostics.momentum(system, v), t)
    assert abs(pi).max() < 1e-12 * abs(M @ v).max()


@pytest.mark.slow
def test_driven_joint():
    """A hinge that is prescribed in time, and a free one: closed form of the driven link."""
    model = sc.Model()
    arm = model.add("arm", sc.RigidBody(1.0, TENSOR, position=(0.5, 0, 0)))
    hand = model.add("hand", sc.RigidBody(0.7, TENSOR, position=(1.4, 0.1, 0)))
    axis = np.array([0, 0.6, 0.8])
    hinge = sc.JointRevolute(sc.ground((0, 0, 0)), arm.at((0, 0, 0)), axis)
    model.add("shoulder", hinge)
    model.add("motor", sc.JointDrive(hinge, lambda t: 0.5 * np.sin(2 * t)))
    model.add("wrist", sc.JointRevolute(arm.at((1, 0, 0)), hand.at((1, 0, 0)), (0, 1.0, 0)))
    system = model.freeze()
    assert system.unknowns == 1
    start = sc.initial_state(system, nu=[0.0])
    history = sc.simulate(system, sc.Variational(), sc.NullSpace(), 0.01, 0.3, start=start)
    q, p, t = history["q"], history["p"], history.times
    one = Projection(system).stack(q, p, t)[0]
    rate = np.cos(2 * t)[:, None] * axis
    assert abs(one[:, :3] - np.cross(rate, q[:, :3])).max() < 1e-9


def test_start_from_reduced_velocities():
    """v = P nu + qdot_prescribed is taken, and gives the reduced momentum."""
    system = system_of("everything")
    nu = np.random.default_rng(6).standard_normal(system.unknowns)
    start = sc.initial_state(system, nu=nu)
    P = null_space(system, system.q0, 0.0)
    v = P @ nu + diagnostics.prescribed_velocity(system, system.q0)
    assert abs(start.p - diagnostics.momentum(system, v)).max() < 1e-13 * abs(start.p).max()
    pi = diagnostics.reduced_momentum(system, system.q0, start.p)
    expected = P.T @ dense_mass(system) @ P @ nu
    assert abs(pi - expected).max() < 1e-12 * abs(expected).max()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"nu": [1.0, 2.0]}, r"nu = .*shape \(2,\), expected \(6,\)"),
        ({"nu": np.full(6, np.nan)}, "finite"),
        ({"nu": "fast"}, "nu = 'fast', expected real numbers"),
        ({"nu": np.zeros(6), "v": np.zeros(39)}, "v or p or nu"),
    ],
)
def test_bad_reduced_velocities(arguments, words):
    system = system_of("chain")
    assert (system.n, system.unknowns) == (39, 6)
    with pytest.raises(sc.InputError, match=words):
        sc.initial_state(system, **arguments)


# -- multipliers at the states ---------------------------------------------------------------------


def orders(errors):
    return np.log2(np.array(errors[:-1]) / errors[1:])


# -- momentum maps ---------------------------------------------------------------------------------


def drift(integrator, h, kind):
    """Largest departure from the conserved angular momentum, at the same instants for each h."""
    system, history = system_of("free"), run("free", integrator, "null space", h, 0.2)
    q, p = history["q"], history["p"]
    L = diagnostics.angular_momentum(system, q, p)[0]
    if kind == "midpoint":
        return abs(diagnostics.midpoint_angular_momentum(system, q, h) - L).max()
    if kind == "dropped":
        p = Projection(system, "directors-dropped").stack(q, p, history.times)[1]
    values = diagnostics.angular_momentum(system, q, p, massive_only=kind == "massive")
    every = round(0.01 / h)
    return abs(values - L)[every:-1:every].max()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("integrator", "kind"),
    [
        ("variational", "massive"),
        ("variational", "dropped"),
        ("energy-momentum", "midpoint"),
    ],
)
def test_angular_momentum_without_third_blocks_only_oscillates(integrator, kind):
    """Negative, with O(h^2): p without d3, (116), and the form of (q_n, q_{n+1})."""
    errors = [drift(integrator, h, kind) for h in (0.0025, 0.00125)]
    assert errors[0] > 1e-6
    assert abs(orders(errors)[0] - 2) < 0.1
