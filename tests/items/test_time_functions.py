"""Loads in time: averages over a step are exact with kinks inside, follower loads, moments."""

import numpy as np
import pytest
from helpers_kernels import assert_same, assert_same_iteration, both, tree
from helpers_scenes import TENSOR, four_bar, full_section, pairs
from helpers_schemes import integrators, treatments
from scipy.interpolate import make_interp_spline

import skfem_cosserat as sc

TIMES = np.array([0.03, 0.071, 0.22, 0.2300001, 0.4])
VALUES = np.array([2.0, 50.0, -30.0, 7.0, 1.0])
#: antiderivative of the table, which is constant outside of its times
AREA = make_interp_spline(
    [-2.0, *TIMES, 3.0], [VALUES[0], *VALUES, VALUES[-1]], k=1
).antiderivative()
#: (function of time, its integral from 0)
FUNCTIONS = {
    "table": (sc.Table(TIMES, VALUES), lambda t: AREA(t) - AREA(0.0)),
    "kink found": (
        sc.FunctionOfTime(lambda t: abs(t - 0.1234)),
        lambda t: (abs(t - 0.1234) * (t - 0.1234) + 0.1234**2) / 2,
    ),
    "jump found": (
        sc.FunctionOfTime(lambda t: 3.0 * (t > 0.1777)),
        lambda t: 3.0 * max(0.0, t - 0.1777),
    ),
    "jump next to a step's end": (
        sc.FunctionOfTime(lambda t: 3.0 * (t > 0.0998)),
        lambda t: 3.0 * max(0.0, t - 0.0998),
    ),
    "kink next to a step's start": (
        sc.FunctionOfTime(lambda t: max(0.0, 0.2503 - t)),
        lambda t: (0.2503**2 - max(0.0, 0.2503 - t) ** 2) / 2,
    ),
    "jumps given": (
        sc.FunctionOfTime(lambda t: 3.0 * (t > 0.1777) - (t > 0.18), kinks=(0.18, 0.1777)),
        lambda t: 3.0 * max(0.0, t - 0.1777) - max(0.0, t - 0.18),
    ),
    "smooth": (
        sc.FunctionOfTime(lambda t: np.cos(40 * t) + t**3),
        lambda t: np.sin(40 * t) / 40 + t**4 / 4,
    ),
    "plain callable": (lambda t: np.exp(-t), lambda t: 1 - np.exp(-t)),
    "number": (2.5, lambda t: 2.5 * t),
}


@pytest.mark.one_quick
@pytest.mark.parametrize("name", FUNCTIONS)
@integrators
@pytest.mark.parametrize("step", [0.05, 0.013])
@pytest.mark.filterwarnings("ignore:argument until", "ignore:load 'load'.*cancels in their means")
def test_momentum_of_a_point_is_the_integral_of_its_load(name, integrator, step):
    """At every node, to rounding, wherever the kinks are."""
    time, integral = FUNCTIONS[name]
    direction = np.array([1.0, -2.0, 0.5])
    model = sc.Model()
    ball = model.add("ball", sc.MassPoint(2.0))
    model.add("load", sc.LoadForce(ball.place(), direction, time))
    history = sc.simulate(model.freeze(), integrator, sc.NullSpace(), step, 0.5)
    exact = np.array([integral(t) for t in history.times])[:, None] * direction
    size = 1.0 + abs(exact).max()
    assert abs(history["p"] - exact).max() < 1e-12 * size


@integrators
def test_callable_load_vector(integrator):
    model = sc.Model()
    ball = model.add("ball", sc.MassPoint(2.0))
    model.add("load", sc.LoadForce(ball.place(), lambda t: (t, abs(t - 0.21), np.sin(9 * t))))
    history = sc.simulate(model.freeze(), integrator, sc.Multipliers(), 0.05, 0.5)
    exact = [0.125, (0.21**2 + 0.29**2) / 2, (1 - np.cos(4.5)) / 9]
    assert abs(history["p"][-1] - exact).max() < 1e-13


def test_averages_find_a_jump_wherever_it_is():
    """Also between the last quadrature point and the end; and go through noise."""
    rng = np.random.default_rng(1)
    for gap in (*rng.uniform(0, 0.1, 4), *10 ** rng.uniform(-7, -2, 4)):
        at = 0.1 - gap
        jump = sc.FunctionOfTime(lambda t, at=at: 3.0 * (t > at))
        kink = sc.FunctionOfTime(lambda t, at=at: max(0.0, t - at))
        assert abs(0.1 * jump.average(0.0, 0.1) - 3 * gap) < 1e-13
        assert abs(0.1 * kink.average(0.0, 0.1) - gap**2 / 2) < 1e-15
    noisy = sc.FunctionOfTime(lambda t: 1 + 1e-9 * rng.standard_normal())
    assert abs(noisy.average(0.0, 0.1) - 1) < 1e-9


def test_functions_are_asked_for_within_the_step():
    """They may be defined up to its ends only."""
    calls = []
    function = sc.FunctionOfTime(lambda t: calls.append(t) or 1.0)
    for k in range(1, 300):
        calls.clear()
        function.average(0.013 * k, 0.0171 * k)
        assert (min(calls), max(calls)) == (0.013 * k, 0.0171 * k)


def test_table_and_function_of_time_average_exactly():
    table, integral = FUNCTIONS["table"]
    same = sc.FunctionOfTime(table.value)
    for a, b in ((0.0, 0.3), (0.08, 0.09), (0.2, 0.22), (-1.0, 0.05), (0.3, 2.0)):
        exact = (integral(b) - integral(a)) / (b - a)
        assert table.average(a, b) == pytest.approx(exact, rel=1e-12)
        assert same.average(a, b) == pytest.approx(exact, rel=1e-9)
    bumpy = sc.FunctionOfTime(lambda t: abs(np.sin(9 * t)))
    exact = (11 - np.cos(18 - 5 * np.pi)) / 18
    assert bumpy.average(0, 2) == pytest.approx(exact, rel=1e-7)


def test_a_sample_at_the_midpoint_would_be_seen():
    """Negative: the same load sampled in the middle of each step misses the impulse."""
    table = sc.Table(TIMES, VALUES)
    exact = FUNCTIONS["table"][1](0.5)
    sampled = sum(0.05 * table.value(0.05 * (k + 0.5)) for k in range(10))
    assert abs(sampled - exact) > 1e-2


@integrators
@treatments
def test_gravity_and_line_load_on_a_free_beam(integrator, treatment, kernels):
    """Linear momentum is the exact integral of m g(t) and of the resultant of the line load."""
    model = sc.Model()
    mesh = sc.MeshCurve.init_arc((0, 0, 0), (1, 0, 0), (0, 1, 0), 1.0, 1.0, 3, "arc")
    beam = model.add("beam", sc.Beam(mesh, full_section(), order=2))
    time, integral = FUNCTIONS["table"]
    model.add("gravity", sc.LoadGravity((0, 0, -9.81), time))
    model.add("line", sc.LoadLine(beam, (1.0, 2.0, 0), time))
    history = sc.simulate(model.freeze(), integrator, treatment, 0.05, 0.5, kernels=kernels)
    impulse = np.array([integral(t) for t in history.times])
    length = beam.basis.lengths.sum()
    exact = length * impulse[:, None] * np.array([1.0, 2.0, -9.81 * 1.3])
    # the sum of nodal momenta carries the Newton tolerance of every step
    assert abs(history["linear_momentum"] - exact).max() < 1e-11 * abs(exact).max()


# -- moments ---------------------------------------------------------------------------------------


@pytest.mark.slow
@integrators
@treatments
@pytest.mark.parametrize("follower", [False, True])
def test_constant_moment_about_a_principal_axis(integrator, treatment, follower):
    """omega = M t / J, exactly: the projected velocity has the angular momentum of p."""
    axis, J, M = np.array([0.0, 0.6, 0.8]), (0.3, 0.4, 0.5), 0.7
    model = sc.Model()
    body = model.add("body", sc.RigidBody(1.0, J, triad=sc.triad(axis)))
    value = (0, 0, M) if follower else M * axis
    model.add("motor", sc.LoadMoment(body.at((0, 0, 0)), value, follower=follower))
    history = sc.simulate(model.freeze(), integrator, treatment, 0.05, 3.0)
    exact = M * history.times[:, None] * axis
    assert abs(history["angular_momentum"] - exact).max() < 1e-12 * 3
    d = history["q"][:, 3:].reshape(-1, 3, 3)
    omega = 0.5 * np.cross(d, history["v"][:, 3:].reshape(-1, 3, 3)).sum(1)
    assert abs(omega - exact / J[2]).max() < 1e-11
    assert abs(d[:, 2] - axis).max() < 1e-12


@pytest.mark.slow
@integrators
@treatments
def test_dead_moments_change_angular_momentum_by_their_integral(integrator, treatment, kernels):
    """On a tumbling body with offset centre, on a beam's node, with kinks: at every node."""
    rng = np.random.default_rng(2)
    model = sc.Model()
    body = sc.RigidBody(2.0, TENSOR, center=(0.3, -0.2, 0.1), angular_velocity=(1, 2, -1))
    model.add("body", body)
    mesh = sc.MeshCurve.init_line((0, 2, 0), (1, 2, 0), 3, "beam")
    velocity = 0.5 * rng.standard_normal((4, 3))
    beam = model.add("beam", sc.Beam(mesh, full_section(), velocity=velocity))
    time, integral = FUNCTIONS["table"]
    model.add("one", sc.LoadMoment(body.at((0, 0, 0)), (0.1, -0.05, 0.02), time))
    model.add("two", sc.LoadMoment(beam.node("beam.end"), (-0.02, 0.03, 0.05), time))
    model.add("three", sc.LoadMoment(beam.node("beam.start"), (0.01, 0, 0.02)))
    system = model.freeze()
    history = sc.simulate(system, integrator, treatment, 0.02, 0.5, kernels=kernels)
    L = history["angular_momentum"]
    impulse = np.array([integral(t) for t in history.times])[:, None]
    exact = impulse * (0.08, -0.02, 0.07) + history.times[:, None] * (0.01, 0, 0.02)
    assert abs(L - L[0] - exact).max() < 1e-12 * np.linalg.norm(L, axis=1).max()
    assert abs(exact).max() > 0.1 * np.linalg.norm(L[0])


@pytest.mark.slow
@integrators
@treatments
def test_dead_force_changes_angular_momentum_by_its_midpoint_lever(integrator, treatment, kernels):
    """L_{n+1} - L_n = h x_mid x F for a force anywhere on a body; with the linear momentum."""
    force, X = np.array([1.0, -2.0, 3.0]), np.array([0.4, 0.2, -0.3])
    model = sc.Model()
    body = model.add("body", sc.RigidBody(2.0, TENSOR, center=(0.1, 0, 0), position=(1, 0, 0)))
    model.add("force", sc.LoadForce(body.local(X), force))
    history = sc.simulate(model.freeze(), integrator, treatment, 0.02, 1.0, kernels=kernels)
    q = history["q"].reshape(-1, 4, 3)
    x = q[:, 0] + np.einsum("i,nij->nj", X, q[:, 1:])
    lever = np.cross((x[1:] + x[:-1]) / 2, force)
    L, p = history["angular_momentum"], history["linear_momentum"]
    assert abs(np.diff(L, axis=0) - 0.02 * lever).max() < 1e-12 * abs(L).max()
    assert abs(p - history.times[:, None] * force).max() < 1e-12 * abs(p).max()


# -- follower forces -------------------------------------------------------------------------------


@pytest.mark.slow
@integrators
@treatments
def test_thrust_of_a_spinning_body(integrator, treatment, kernels):
    """v = F/(m w) (sin wt, 1 - cos wt), position its integral, to second order; spin unchanged."""
    w, thrust, mass = 2.0, 3.0, 1.5
    errors = []
    for steps in (25, 50):
        model = sc.Model()
        body = sc.RigidBody(mass, (0.3, 0.4, 0.5), angular_velocity=(0, 0, w))
        model.add("body", body)
        model.add("thrust", sc.LoadForce(body.at((0, 0, 0)), (thrust, 0, 0), follower=True))
        history = sc.simulate(
            model.freeze(), integrator, treatment, 1 / steps, 1.0, kernels=kernels
        )
        v = thrust / (mass * w) * np.array([np.sin(w), 1 - np.cos(w), 0])
        x = thrust / (mass * w) * np.array([(1 - np.cos(w)) / w, 1 - np.sin(w) / w, 0])
        errors.append([abs(history["v"][-1, :3] - v).max(), abs(history["q"][-1, :3] - x).max()])
        orbit = np.cross(history["q"][:, :3], history["p"][:, :3])
        assert abs(history["angular_momentum"] - orbit - (0, 0, 0.5 * w)).max() < 1e-12
    ratios = np.divide(*errors)
    assert ((ratios > 3.9) & (ratios < 4.1)).all()


@pytest.mark.parametrize(
    "last",
    [
        sc.Table([0, 0.2], [0, 3.0]),
        sc.RampLinear(0.0, 0.2, 0.0, 3.0),
        sc.RampSmooth(0.0, 0.2, 0.0, 3.0),
    ],
)
def test_loads_that_are_over_do_not_change_any_more(last):
    """Steps that reach beyond it have the mean; functions of a user may go on."""
    model = sc.Model()
    ball = model.add("ball", sc.MassPoint(2.0))
    model.add("load", sc.LoadForce(ball.place(), (1.0, 0, 0), last))
    model.add("weight", sc.LoadGravity((0, 0, -9.81)))
    loading = model.freeze().loading
    assert loading.constant_after == 0.2
    for t0, t1 in ((0.1, 0.2), (0.15, 0.3), (0.2, 0.4)):
        found = loading.averages(t0, t1)
        assert found.tolist() == pytest.approx([last.average(t0, t1), 1.0], rel=1e-14)
    model.add("more", sc.LoadForce(ball.place(), (0, 1.0, 0), lambda t: t))
    assert model.freeze().loading.constant_after == np.inf


# -- compiled kernels ------------------------------------------------------------------------------


def dead_moments(model):
    """On a beam's end with a joint, on a body and inside a beam, one of them in time."""
    end = model["rod"].node("arc.end")
    model.add("m1", sc.LoadMoment(end, (0.9, -0.5, 1.4), sc.Table([0, 0.02, 1], [1, -2, 3])))
    model.add("m2", sc.LoadMoment(model["body"].at((1.6, 1.5, 0)), (0.7, 1.1, -0.4)))
    model.add("m3", sc.LoadMoment(model["rod"].node(1), (-0.3, 0.8, 1.0)))


def body_moments(model):
    """With components in the triad."""
    end = model["rod"].node("arc.end")
    model.add("m4", sc.LoadMoment(end, (0.5, 1.2, -0.7), follower=True))
    body = model["body"].at((1.6, 1.5, 0))
    model.add("m5", sc.LoadMoment(body, lambda t: (np.sin(30 * t), 1.0, 2.0), follower=True))


def body_forces(model):
    """At an offset, and at a beam's node."""
    body = model["body"].at((1.2, 1.9, 0.3))
    model.add("f1", sc.LoadForce(body, (2.0, -1.0, 1.5), lambda t: np.cos(9 * t), follower=True))
    model.add("f2", sc.LoadForce(model["rod"].node("arc.end"), (1.0, 3.0, -2.0), follower=True))


def section_forces(model):
    """A wind that turns with the sections."""
    table = sc.Table([0, 0.03, 1], [1, 4, 0])
    model.add("f3", sc.LoadLine(model["rod"], (0.5, 2.0, -1.0), table, follower=True))


def everything(model):
    for add in (dead_moments, body_moments, body_forces, section_forces):
        add(model)


@pytest.mark.slow
@pairs
def test_kernels_agree_far_from_a_solution(integrator, treatment):
    assert_same_iteration(tree(3, everything), integrator, treatment, 3)


@pytest.mark.slow
@pairs
def test_kernels_agree(integrator, treatment):
    """Thirty steps; reactions and work among what is compared."""
    assert_same(*both(tree(2, everything), integrator, treatment, 1e-3, 0.03))


@pytest.mark.one_quick
@pytest.mark.parametrize("integrator", ["variational", "energy-momentum"])
def test_kernels_agree_in_a_closed_loop(integrator):
    """A four-bar linkage that is driven by moments and a force on its coupler."""
    model = four_bar()
    coupler = model["coupler"].at((1, 1.25, 0))
    model.add("moment", sc.LoadMoment(coupler, (0, 0, 3.0), sc.Table([0, 0.2, 0.5], [0, 1, -1])))
    model.add("own", sc.LoadMoment(coupler, (0, 0.5, -1.0), follower=True))
    model.add("push", sc.LoadForce(coupler, (2.0, 1.0, 0), follower=True))
    assert_same(*both(model.freeze(), integrator, "null space", 0.01, 0.3))
