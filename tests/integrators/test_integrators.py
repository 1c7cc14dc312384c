"""Integrators beyond the two classic ones: orders, damping, what they keep, what they do not."""

from functools import partial
from itertools import pairwise

import numpy as np
import pytest
import test_stored_energy as stored
from helpers_scenes import TENSOR, everything, four_bar
from rounding import momentum_limits
from scipy.spatial.transform import Rotation
from test_conservation import free_beam, free_tree
from test_convergence import SCENES, TREATMENTS, UNTIL, massive, order
from test_energy_balance import check_that_what_is_taken_is_kept_and_told
from test_six_body_linkage import six as six_body_linkage
from test_tangents import TOLERANCE, Step, worst

import skfem_cosserat as sc
from skfem_cosserat import Stepper, diagnostics

SCHEMES = {
    "alpha": sc.GeneralizedAlpha(0.7, stabilized=False),
    "alpha, stabilized": sc.GeneralizedAlpha(0.7),
    "decaying, first order": sc.EnergyDecaying(chi=0.1),
    "decaying, second order": sc.EnergyDecaying(rate=8.0),
    "energy-momentum, stabilized": sc.EnergyMomentum(stabilized=True),
}
NULL, MULTIPLIERS = sc.NullSpace(), sc.Multipliers()


def at_nodes(scheme):
    return isinstance(scheme, sc.GeneralizedAlpha)


# -- orders ----------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "scene", "treatment"),
    [
        ("alpha", "pendulum", "null space"),
        ("alpha, stabilized", "cantilever", "multipliers"),
        ("decaying, first order", "cantilever", "null space"),
        ("decaying, second order", "pendulum", "multipliers"),
        ("energy-momentum, stabilized", "pendulum", "null space"),
    ],
)
def test_orders(name, scene, treatment):
    """In q, v, p and multipliers, all at the states."""
    make, steps = SCENES[scene]
    system, runs = make(), []
    for level in range(4):
        h = UNTIL / (steps * 2**level)
        pair = SCHEMES[name], TREATMENTS[treatment]
        runs.append(sc.simulate(system, *pair, h, UNTIL, at=[UNTIL - h, UNTIL]))
    found = {
        "q": order([run["q"][-1] for run in runs]),
        "v": order([run["v"][-1][massive(system)] for run in runs]),
        "p": order([run["p"][-1] for run in runs]),
        "multipliers": order([run["multipliers"][-1] for run in runs]),
    }
    assert found == pytest.approx(dict.fromkeys(found, SCHEMES[name].order), abs=0.1)


def double_pendulum():
    """Two rigid bodies, turning fast."""
    model = sc.Model()
    one = model.add("one", sc.RigidBody(1.0, TENSOR, position=(0.5, 0, 0)))
    two = model.add("two", sc.RigidBody(0.7, TENSOR, position=(1.2, 0.1, 0)))
    model.add("hook", sc.JointSpherical(sc.ground((0, 0, 0)), one.at((0, 0, 0))))
    model.add("hinge", sc.JointRevolute(one.at((1, 0, 0)), two.at((1, 0, 0)), (0, 0.6, 0.8)))
    model.add("gravity", sc.LoadGravity((0, 0, -9.81)))
    system = model.freeze()
    rng = np.random.default_rng(4)
    nu = rng.standard_normal(system.unknowns)
    return system, sc.initial_state(system, nu=nu)


@pytest.mark.slow
@pytest.mark.parametrize("treatment", [NULL, MULTIPLIERS], ids=lambda t: t.name)
@pytest.mark.parametrize(
    "scheme",
    [
        sc.Composition(sc.Variational()),
        sc.Composition(sc.EnergyMomentum()),
        sc.Composition(sc.Variational(), order=6),
    ],
    ids=repr,
)
def test_orders_of_compositions_with_beams(scheme, treatment):
    """In q, v and multipliers, once the steps resolve the beam's vibrations."""
    system, start = free_beam()
    runs = [
        sc.simulate(system, scheme, treatment, h, 0.1, start=start, at=[0.1])
        for h in (0.01, 0.005, 0.0025)
    ]
    for name in ("q", "v", "multipliers"):
        d = [np.linalg.norm(b[name][-1] - a[name][-1]) for a, b in pairwise(runs)]
        assert np.log2(d[0] / d[1]) == pytest.approx(scheme.order, abs=0.3), name


def test_energy_momentum_is_not_composed_to_order_six():
    """What its velocities have off the hidden constraints changes sign in each step."""
    with pytest.raises(sc.IncompatibleError, match="changes sign each step"):
        sc.Composition(sc.EnergyMomentum(), order=6)
    system, start = double_pendulum()
    stepper, state, found = Stepper(system, sc.EnergyMomentum(), NULL, 0.01), start, []
    inverse = diagnostics.energy.mass_solver(system)
    for _ in range(6):
        state = stepper.advance(state).state
        v = inverse(state.p.reshape(-1, 3)).reshape(-1)
        found.append(system.constraints.jacobian(system.extend(state.q, 0.0)) @ v)
    found = np.array(found)
    changes = np.diff(found[:, abs(found).max(0).argmax()])
    assert abs(changes).min() > 1e-4
    assert (changes[1:] * changes[:-1] < 0).all()


@pytest.mark.slow
@pytest.mark.parametrize("stabilized", [False, True])
def test_multipliers_of_generalized_alpha_in_the_first_steps(stabilized):
    """Of second order at once, with a start that is consistent."""
    (system, start), errors = double_pendulum(), []
    fine = sc.Composition(sc.Variational())
    for h in (4e-3, 2e-3):
        scheme = sc.GeneralizedAlpha(0.5, stabilized)
        found = sc.simulate(system, scheme, NULL, h, h, start=start)["multipliers"]
        right = sc.simulate(system, fine, NULL, h / 4, h, start=start)["multipliers"]
        assert found[0] == pytest.approx(right[0], rel=1e-9, abs=1e-9 * abs(right).max())
        errors.append(abs(found[1] - right[4]).max())
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2, abs=0.1)


@pytest.mark.one_quick
@pytest.mark.parametrize(
    ("make", "plain", "stabilized"),
    [
        (partial(sc.EnergyDecaying, 0.1), 0, 1),
        (partial(sc.EnergyDecaying, rate=8.0), 1, 2),
        (sc.EnergyMomentum, 1, 2),
    ],
)
def test_multipliers_of_the_first_step(make, plain, stabilized):
    """At its midpoint; velocities off the hidden constraints cost an order, stabilised do not."""
    system, start = double_pendulum()

    def order_of_first(scheme):
        errors = []
        for h in (4e-3, 2e-3):
            step = Stepper(system, scheme, NULL, h).advance(start)
            force = step.constraint_force[None]
            found = sc.diagnostics.multipliers(system, step.constraint_point[None], force)[0]
            fine = sc.Composition(sc.Variational())
            right = sc.simulate(system, fine, NULL, h / 4, h, start=start)["multipliers"][2]
            errors.append(abs(found - right).max())
        return np.log2(errors[0] / errors[1])

    assert order_of_first(make()) == pytest.approx(plain, abs=0.1)
    assert order_of_first(make(stabilized=True)) == pytest.approx(stabilized, abs=0.1)


# -- damping ---------------------------------------------------------------------------------------


def oscillator(k, rail=False):
    """A mass point on a spring; perhaps with two constraints, which leave the way along it."""
    model, ground = sc.Model(), sc.ground((0, 0, 0))
    bob = model.add("bob", sc.MassPoint(1.0, (1.0, 0, 0)))
    model.add("spring", sc.SpringDamper(ground, bob.place(), stiffness=k))
    if rail:
        model.add("rail", sc.JointPointOnLine(ground, bob.place(), axis=(1, 0, 0)))
    return model.freeze()


def amplification(scheme, h=1e-2, k=1e14, rail=False, treatment=NULL):
    """Matrix of a step on (u, h v) of a stiff spring, and h^2 alpha of generalized-alpha."""
    system = oscillator(k, rail)
    stepper = Stepper(system, scheme, treatment, h)
    size, columns = 1e-6, []
    for unit in np.eye(3 if at_nodes(scheme) else 2):
        u, v, alpha = [*(size * unit), 0.0][:3] / np.array([1, h, h**2])
        q, rates = system.q0.copy(), np.zeros((4, 3))
        q[0] += u
        rates[:, 0] = v, -k * (q[0] - 1), alpha, v
        carried = {"rates": rates[: scheme.remembered]} if scheme.remembered else {}
        new = stepper.advance(sc.State(0.0, 0, q, rates[0], False, None, carried)).state
        entries = [new.q[0] - 1, h * new.p[0]]
        if at_nodes(scheme):
            entries.append(h**2 * new.rates[2, 0])
        columns.append(np.array(entries) / size)
    return np.array(columns).T


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.95])
def test_spectral_radius_of_generalized_alpha(rho):
    """All three eigenvalues are -rho_inf, seen in the characteristic polynomial."""
    found = np.poly(amplification(sc.GeneralizedAlpha(rho)))
    assert found == pytest.approx(np.array([1, 3 * rho, 3 * rho**2, rho**3]), abs=1e-5)


@pytest.mark.one_quick
@pytest.mark.parametrize("treatment", [NULL, MULTIPLIERS], ids=lambda t: t.name)
@pytest.mark.parametrize("stabilized", [False, True])
def test_spectral_radius_with_constraints(stabilized, treatment):
    """The stabilized forms damp as the plain ones do; energy-momentum does not."""
    rail = {"rail": True, "treatment": treatment}
    for rho in (0.0, 0.5, 0.8):
        found = np.poly(amplification(sc.GeneralizedAlpha(rho, stabilized), **rail))
        assert found == pytest.approx(np.array([1, 3 * rho, 3 * rho**2, rho**3]), abs=1e-5)
    scheme = sc.EnergyMomentum(stabilized)
    found = np.poly(amplification(scheme, k=1e10, **rail))
    assert found == pytest.approx(np.array([1, 2, 1]), abs=1e-4)
    found = np.poly(amplification(sc.EnergyDecaying(0.2), **rail))
    assert found == pytest.approx(np.array([1, 4 / 3, 4 / 9]), abs=1e-5)


@pytest.mark.parametrize("chi", [0.0, 0.3, 1.0])
def test_spectral_radius_of_energy_decaying(chi):
    """Both eigenvalues -(1 - chi)/(1 + chi); with damped stresses alone one stays at -1."""
    r = (1 - chi) / (1 + chi)
    found = np.poly(amplification(sc.EnergyDecaying(chi)))
    assert found == pytest.approx(np.array([1, 2 * r, r**2]), abs=1e-5)
    found = np.poly(amplification(sc.EnergyDecaying(chi, velocity=False)))
    assert found == pytest.approx(np.array([1, 1 + r, r]), abs=1e-5)


@pytest.mark.parametrize(
    "scheme", [sc.Variational(), sc.EnergyMomentum(), sc.EnergyMomentum(stabilized=True)], ids=repr
)
def test_classic_schemes_and_their_compositions_do_not_damp(scheme):
    """Both eigenvalues on the unit circle: of a composition their product is one, the sum small."""
    assert np.poly(amplification(scheme, k=1e10)) == pytest.approx(np.array([1, 2, 1]), abs=1e-4)
    orders = [] if scheme.stabilized else [4, 6] if scheme.name == "variational" else [4]
    for stages in orders:
        one, sum_, product = np.poly(amplification(sc.Composition(scheme, stages), k=1e8))
        assert product == pytest.approx(1, abs=1e-5) and abs(sum_) < 2 * one


def test_damping_fades_with_the_step_in_the_second_order_scheme():
    for h in (1e-2, 1e-3):
        r = (1 - 10 * h) / (1 + 10 * h)
        found = np.poly(amplification(sc.EnergyDecaying(rate=10.0), h, k=1e16))
        assert found == pytest.approx(np.array([1, 2 * r, r**2]), abs=1e-5)


# -- conservation ----------------------------------------------------------------------------------


def scale(system, start):
    """Size of angular momenta: sum of |q| |p|."""
    p = start.p.reshape(-1, 3)
    return float((np.linalg.norm(start.q.reshape(-1, 3), axis=1) * np.linalg.norm(p, axis=1)).sum())


@pytest.mark.one_quick
@pytest.mark.parametrize(
    ("make", "treatment"), [(free_beam, NULL), (free_tree, MULTIPLIERS)], ids=["beam", "tree"]
)
@pytest.mark.parametrize(
    "scheme",
    [
        sc.EnergyDecaying(0.1),
        sc.EnergyDecaying(0.1, velocity=False),
        sc.EnergyDecaying(0.1, stabilized=True),
        sc.EnergyMomentum(stabilized=True),
        sc.Composition(sc.Variational()),
        sc.Composition(sc.EnergyMomentum()),
    ],
    ids=repr,
)
@pytest.mark.filterwarnings("ignore:balance of energy")  # large steps: much is damped
def test_momenta_are_kept(scheme, make, treatment):
    system, start = make()
    history = sc.simulate(system, scheme, treatment, 0.02, 0.3, start=start)
    L, P = history["angular_momentum"], history["linear_momentum"]
    linear, angular = momentum_limits(system, history)
    assert linear < 1e-9 and angular < 1e-9
    assert abs(L - L[0]).max() < angular
    assert abs(P - P[0]).max() < linear
    if not isinstance(scheme, sc.Composition):
        assert np.diff(history["energy"]).max() < 1e-11
        assert abs(history["energy_balance"]).max() < 1e-11
        assert history["dissipated"][-1] > 1e-8
    elif isinstance(scheme.part, sc.EnergyMomentum) and make is free_tree:
        assert np.ptp(history["energy"]) < 1e-10


@pytest.mark.slow
def test_generalized_alpha_keeps_linear_momentum_only():
    """Negative: angular momentum drifts with the square of the step, energy grows at times."""
    system, start = free_beam()
    drift = []
    for h in (0.02, 0.01):
        history = sc.simulate(system, sc.GeneralizedAlpha(0.5), NULL, h, 0.3, start=start)
        P, L = history["linear_momentum"], history["angular_momentum"]
        assert abs(P - P[0]).max() < 1e-11
        drift.append(abs(L - L[0]).max())
        assert np.diff(history["energy"]).max() > 1e-7
    assert drift[1] > 1e-6
    assert drift[0] / drift[1] > 3


@pytest.mark.parametrize("scheme", [sc.GeneralizedAlpha(0.8), sc.EnergyDecaying(0.1)], ids=repr)
def test_pulses_within_a_step(scheme):
    """Impulses are exact by means over the step; generalized-alpha does not see them."""
    model = sc.Model()
    ball = model.add("ball", sc.MassPoint(2.0))
    pulse = sc.Table([0, 0.01, 0.02, 0.03], [0, 0, 1, 0])
    model.add("pulse", sc.LoadForce(ball.place(), (300.0, 0, 0), pulse))
    p = sc.simulate(model.freeze(), scheme, NULL, 0.05, 0.1)["p"][-1, 0]
    assert p == pytest.approx(0.0 if at_nodes(scheme) else 3.0, abs=1e-13)


@pytest.mark.slow
def test_each_part_of_a_scene_keeps_its_own_momentum():
    """Two free bodies that nothing connects."""
    model, rng = sc.Model(), np.random.default_rng(2)
    for k, x in enumerate([(0, 0, 0), (3, 1, 0)]):
        motion = dict(
            zip(("velocity", "angular_velocity"), rng.standard_normal((2, 3)), strict=True)
        )
        model.add(f"body {k}", sc.RigidBody(1.0, TENSOR, position=x, **motion))
    history = sc.simulate(model, sc.EnergyDecaying(0.5), NULL, 0.05, 1.0)
    q, p = (history[name].reshape(-1, 2, 4, 3) for name in "qp")
    L = np.cross(q, p).sum(2)
    assert abs(L - L[0]).max() < 1e-11
    assert history["dissipated"][-1] > 1e-6


@pytest.mark.slow
def test_steady_rotation_is_not_damped():
    """A free body about its axis, flying: no energy is lost, the centre keeps its speed."""
    for chi in (0.1, 1.0):
        model = sc.Model()
        body = sc.RigidBody.box(1.0, (1, 2, 3), velocity=(5.0, 1, 0), angular_velocity=(0, 0, 3.0))
        model.add("body", body)
        system = model.freeze()
        history = sc.simulate(system, sc.EnergyDecaying(chi), NULL, 0.05, 1.0)
        assert history["dissipated"][-1] < 1e-13
        assert history["q"][-1, :3] == pytest.approx(np.array([5.0, 1.0, 0]), abs=1e-12)


def random_scene(seed):
    """A chain of beams, bodies, points and springs, free or hung up, in random motion."""
    rng = np.random.default_rng(seed)
    model = sc.Model()
    stiffness = 10.0 ** rng.uniform(0, 4, 6)
    section = sc.Section(stiffness, mass=rng.uniform(0.5, 2), inertia=rng.uniform(0.01, 0.1, 2))
    mesh = sc.MeshCurve.init_arc((0, 0, 0), (1, 0, 0), (0, 1, 0.3), 1.5, 1.5, 2, "arc")
    beam = model.add("beam", sc.Beam(mesh, section, order=int(rng.integers(1, 4))))
    start, end = beam.node("arc.start"), beam.node("arc.end")
    body = model.add("body", sc.RigidBody(rng.uniform(0.1, 3), TENSOR, position=end.position))
    model.add("joint", sc.JointSpherical(end, body.at(end.position)))
    bob = model.add("bob", sc.MassPoint(rng.uniform(0.1, 2), end.position + (0, 0, 1.0)))
    place = body.at(end.position + (0, 0, 0.2))
    model.add("spring", sc.SpringDamper(place, bob.place(), stiffness=10.0 ** rng.uniform(0, 5)))
    if rng.uniform() < 0.5:
        model.add("pin", sc.JointSpherical(sc.ground(start.position), start))
    system = model.freeze()
    v = sc.project(system, system.q0, 3 * rng.standard_normal(system.n))
    return system, sc.initial_state(system, v=v), float(10 ** rng.uniform(-3, -1.3)), rng


def energy_decays(seed):
    system, start, h, rng = random_scene(seed)
    chi = float(rng.uniform(0, 1))
    moved = seed % 5 == 0
    kind = {"chi": chi} if seed % 2 else {"rate": chi / h}
    scheme = sc.EnergyDecaying(**kind, stabilized=moved)
    run = system, scheme, [NULL, MULTIPLIERS][seed // 2 % 2], h, 5 * h
    try:
        history = sc.simulate(*run, start=start, derive=False)
    except sc.Diverged as error:
        history = error.history
    q, p, lost = history["q"], history["p"], history["dissipated"]
    energy = diagnostics.kinetic_energy(system, p) + diagnostics.strain_energy(system, q)
    energy = energy + diagnostics.coupling_energy(system, q, np.zeros(len(q)), None)
    L = diagnostics.angular_momentum(system, q, p)
    assert np.diff(lost).min(initial=0.0) >= -1e-13 * energy[0]
    assert np.diff(energy).max(initial=0.0) < 1e-10 * energy[0]
    assert energy + lost == pytest.approx(energy[0], rel=1e-9)
    if not any(joint.name == "pin" for joint in system.joints):
        assert abs(L - L[0]).max() < 1e-9 * scale(system, start)
    return len(q) - 1


@pytest.mark.slow
def test_parts_that_do_not_turn_leave_the_others_alone():
    """Two joined bodies that fall without turning, and every other item: steps are solved.

    What the turn of the two is, is rounding; it must not keep that of the others from being found.
    """
    system = everything(1)
    start = sc.initial_state(system, v=sc.project(system, system.q0, system.v0))
    runs = [
        sc.simulate(system, sc.EnergyDecaying(0.1), treatment, 0.01, 0.05, start=start)
        for treatment in (NULL, MULTIPLIERS)
    ]
    assert max(run["residual"].max() for run in runs) < 1e-11
    assert runs[0]["q"] == pytest.approx(runs[1]["q"], abs=1e-11)


# its few elements are drawn farther than such ones can be, which these figures do not mind
@pytest.mark.one_quick
@pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")
@pytest.mark.parametrize("seed", [0, 6, 19])
@pytest.mark.filterwarnings("ignore:balance of energy")  # is not resolved
def test_generalized_alpha_starts_calmly_where_steps_resolve_nothing(seed):
    """With the third derivative in full energy got 1.6 to 38 times as large in three steps."""
    system, start, h, _ = random_scene(seed)
    energy = sc.simulate(system, sc.GeneralizedAlpha(0.6), NULL, h, 3 * h, start=start)["energy"]
    assert energy.max() < 1.1 * energy[0]


@pytest.mark.slow
@pytest.mark.filterwarnings("error::skfem_cosserat.CosseratWarning")
def test_what_energy_decaying_takes_is_kept_and_told_above_a_tenth():
    check_that_what_is_taken_is_kept_and_told(sc.EnergyDecaying(0.05))


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")  # much is not resolved
@pytest.mark.parametrize("first", range(0, 40, 10))
def test_energy_never_grows_in_random_scenes(first):
    assert sum(energy_decays(seed) for seed in range(first, first + 10)) >= 45


# -- what goes on around a step --------------------------------------------------------------------


def blocks_and_border(step):
    """Iteration matrix of a step, with what the blocks leave out."""
    matrix, (_, e, y1) = step.matrix(), step.residual()
    border = step.balance.border(step.step, e)
    if border is None:
        return matrix
    bound = step.bound
    U = np.array([bound.scale_rows(bound.pull(u)) for u in border[0]]).T
    moved = [bound.displacement(unit, y1) for unit in np.eye(bound.unknowns)]
    V = np.array([[(v * dq).sum() for dq in moved] for v in border[1]])
    return matrix + U @ V


@pytest.mark.slow
@pytest.mark.parametrize("order", [1, 3])
def test_tangents(order):
    system = everything(order)
    for scheme in (sc.EnergyDecaying(0.3, velocity=False), sc.GeneralizedAlpha(0.6)):
        step = Step(system, scheme, NULL, seed=order)
        assert worst(blocks_and_border(step), step.derivative()) < TOLERANCE
    # where all velocities of a part are parallel (its one mass point) a matrix is regularised
    step = Step(system, sc.EnergyDecaying(0.3), NULL, seed=order)
    assert worst(blocks_and_border(step), step.derivative()) < 1e-6


def shaken(t):
    return (0.1 * np.sin(3 * t) ** 2, 0.05 * np.sin(5 * t) ** 2, 0.0)


def sprung():
    """A body between a damper to shaken ground, a damped cable, a bushing and a hinge with both."""
    model = sc.Model()
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 2, "beam")
    section = sc.Section([60, 60, 80, 3, 4, 2.5], mass=0.8, inertia=(0.05, 0.06))
    beam = model.add("beam", sc.Beam(mesh, section.damped(time=0.01), director=(0, 1, 0)))
    body = model.add("body", sc.RigidBody(0.8, TENSOR, position=(1.2, 0, 0)))
    shake = sc.Motion(displacement=shaken)
    hinge = sc.JointRevolute(beam.node("beam.end"), body.at((1, 0, 0)), (0, 1, 0))
    model.add("hook", sc.JointSpherical(sc.ground((0, 0, 0), shake), beam.node("beam.start")))
    model.add("hinge", hinge)
    model.add("angle", sc.JointSpringDamper(hinge, stiffness=5.0, damping=0.2))
    model.add("torque", sc.JointActuator(hinge, sc.FunctionOfTime(np.sin)))
    free = body.at((1.2, 0, 0.3))
    model.add("damper", sc.SpringDamper(sc.ground((2, 1, 1), shake), free, 20.0, damping=2.0))
    model.add("cable", sc.Cable(sc.ground((1, 1, -1), shake), free, 30.0, damping=0.5))
    model.add("gravity", sc.LoadGravity((0, 0, -9.81)))
    return model.freeze()


@pytest.mark.parametrize(
    "treatment", [NULL, pytest.param(MULTIPLIERS, marks=pytest.mark.slow)], ids=lambda t: t.name
)
@pytest.mark.parametrize("scheme", [sc.GeneralizedAlpha(0.6), sc.EnergyDecaying(0.3)], ids=repr)
def test_tangent_with_dampers_to_moving_ground(scheme, treatment):
    step = Step(sprung(), scheme, treatment, size=0.1)
    assert worst(blocks_and_border(step), step.derivative()) < 1e-8


@pytest.mark.slow
def test_energy_balance_with_loads_drives_and_dampers():
    """Exact, or with the error of second order of the trapezoidal rule."""
    system = sprung()

    def imbalance(scheme, h):
        history = sc.simulate(system, scheme, NULL, h, 0.2)
        assert np.isfinite(history["energy_balance"][:-1]).all()
        return abs(history["energy_balance"][:-1]).max()

    assert imbalance(sc.EnergyDecaying(0.1), 0.01) < 1e-11
    assert imbalance(sc.EnergyDecaying(0.1, stabilized=True), 0.01) < 1e-11
    assert imbalance(sc.EnergyMomentum(stabilized=True), 0.01) < 1e-10
    assert imbalance(sc.Composition(sc.EnergyMomentum()), 0.02) < 1e-10
    alpha = sc.GeneralizedAlpha(0.9)
    assert np.log2(imbalance(alpha, 0.01) / imbalance(alpha, 0.005)) == pytest.approx(2, abs=0.2)


RESTARTED = [
    sc.Variational(),
    sc.EnergyMomentum(),
    *SCHEMES.values(),
    sc.EnergyDecaying(0.1, stabilized=True),
    sc.Composition(sc.Variational()),
    sc.Variational(stabilized=True),
    sc.Composition(sc.Variational(stabilized=True)),
]


@pytest.mark.slow
@pytest.mark.parametrize("scheme", RESTARTED, ids=repr)
def test_restart_goes_on_as_if_nothing_had_been(scheme, tmp_path):
    system = sprung()
    whole = sc.simulate(system, scheme, NULL, 0.02, 0.2)
    path = tmp_path / "first.h5"
    sc.simulate(system, scheme, NULL, 0.02, 0.1, path=path)
    first = sc.History.load(path)
    start = sc.restart(system, first, scheme, 0.02)
    again = sc.simulate(system, scheme, NULL, 0.02, 0.2, start=start)
    for name in ("q", "p", "constraint_force"):
        size = np.nanmax(abs(whole[name]))
        # the force of the first state follows from the steps after it alone
        skip = 1 if name == "constraint_force" else 0
        wanted = whole[name][5 + skip : -1]
        assert again[name][skip:-1] == pytest.approx(wanted, abs=1e-9 * size), name
    # with another step it starts anew from (q, p)
    other = sc.restart(system, first, scheme, 0.01)
    assert other.rates is None
    assert sc.simulate(system, scheme, NULL, 0.01, 0.12, start=other).times[-1] > 0.11


@pytest.mark.slow
@pytest.mark.parametrize(
    ("one", "other"),
    [
        (sc.Variational(), sc.EnergyMomentum()),
        (sc.GeneralizedAlpha(0.7), sc.GeneralizedAlpha(0.7, stabilized=False)),
        (sc.GeneralizedAlpha(0.7), sc.GeneralizedAlpha(0.7)),
        (sc.Composition(sc.Variational()), sc.EnergyDecaying(0.1)),
    ],
    ids=repr,
)
def test_a_state_of_another_scheme_or_step_starts_anew(one, other):
    """As with `restart`: what schemes carry on beside q is not the same."""
    system = sprung()
    h = 0.01 if one.name == other.name else 0.02
    first = sc.simulate(system, one, NULL, 0.02, 0.06)
    right = sc.simulate(
        system, other, NULL, h, 0.1, start=sc.restart(system, first, other, h), derive=False
    )
    run = sc.steps(system, one, NULL, 0.02)
    states = [next(run).state for _ in range(3)]
    found = sc.simulate(system, other, NULL, h, 0.1, start=states[-1], derive=False)
    for name in ("q", "p", "constraint_force"):
        size = np.nanmax(abs(right[name]))
        assert found[name][:-1] == pytest.approx(right[name][:-1], abs=1e-9 * size), name


def hanging():
    """A weight of 20 N on a rod, its support shaken along it."""
    model = sc.Model()
    bob = model.add("bob", sc.MassPoint(2.0, position=(0, 0, -1)))
    shake = sc.Motion(displacement=lambda t: (0, 0, 0.1 * np.sin(3 * t) ** 2))
    model.add("rod", sc.JointDistance(sc.ground((0, 0, 0), shake), bob.place()))
    model.add("gravity", sc.LoadGravity((0, 0, -10.0)))
    return model.freeze()


@pytest.mark.one_quick
@pytest.mark.parametrize(
    ("scheme", "tolerance"),
    [
        (sc.GeneralizedAlpha(0.8, stabilized=False), 3e-3),
        (sc.GeneralizedAlpha(0.8), 3e-3),
        (sc.Composition(sc.Variational()), 1e-4),
        (sc.Composition(sc.EnergyMomentum()), 1e-4),
    ],
    ids=repr,
)
def test_constraint_forces_are_at_the_nodes(scheme, tolerance):
    """In the history and in reactions; against the closed form."""
    history = sc.simulate(hanging(), scheme, NULL, 0.01, 0.4, every=4)

    def force(t):
        return 2.0 * (10 + 0.1 * 18 * np.cos(6 * t))

    t = history.times
    assert history["multipliers"][:, 0] == pytest.approx(force(t), abs=tolerance * 20)
    assert history["joint/rod/force"][:, 2] == pytest.approx(force(t), abs=tolerance * 20)
    work = 2.0 * 10 * (history["q"][:, 2] - history["q"][0, 2]) + history["energy"]
    assert history["work_drives"][:-1] == pytest.approx((work - work[0])[:-1], abs=2e-2)


@pytest.mark.one_quick
@pytest.mark.parametrize("scheme", [sc.GeneralizedAlpha(0.7), sc.EnergyDecaying(0.1)], ids=repr)
def test_other_stored_energies(scheme):
    """Beams of a quartic energy: an exact tangent; energy falls, its balance is exact."""
    model, _ = stored.free_beam(stored.moving_section(stored.QUARTIC))
    system = model.freeze()
    step = Step(system, scheme, NULL, size=0.1)
    assert worst(blocks_and_border(step), step.derivative()) < 1e-8
    history = sc.simulate(system, scheme, NULL, 0.01, 0.1)
    assert abs(np.diff(history["energy"])).max() > 1e-6
    if not at_nodes(scheme):
        assert np.diff(history["energy"]).max() < 0
        assert abs(history["energy_balance"]).max() < 1e-11 * history["energy"][0]


@pytest.mark.slow
@pytest.mark.parametrize(
    "treatment",
    [NULL, MULTIPLIERS],
    ids=["null space", "multipliers"],
)
@pytest.mark.parametrize(
    "scheme",
    [
        sc.GeneralizedAlpha(0.8),
        sc.EnergyDecaying(0.05),
        sc.Composition(sc.EnergyMomentum()),
        sc.Composition(sc.Variational()),
    ],
    ids=repr,
)
def test_a_closed_loop_of_mobility_one(scheme, treatment):
    """Bricard's linkage: 72 rows, one redundant; all schemes near a fine energy-momentum run."""
    system = six_body_linkage.build()
    fine = sc.simulate(system, sc.EnergyMomentum(), NULL, 5e-3, 0.3)
    history = sc.simulate(system, scheme, treatment, 0.02, 0.3)
    assert history["constraint_violation"].max() < 1e-9
    assert abs(history["q"][-1] - fine["q"][-1]).max() < 0.01 * abs(fine["q"] - fine["q"][0]).max()


def test_composed_steps_say_where_they_fail():
    system, start = double_pendulum()
    settings = sc.NewtonSettings(iterations=1, damped_iterations=1)
    said = "step 1 from t = 0 s.*Try a smaller step than 0.5 s"  # not than one of its parts
    with pytest.raises(sc.Diverged, match=said):
        sc.simulate(
            system, sc.Composition(sc.Variational()), NULL, 0.5, 1.0, start=start, settings=settings
        )
    stepper = Stepper(system, sc.Composition(sc.EnergyMomentum()), NULL, 0.1)
    with pytest.raises(sc.IncompatibleError, match=r"Composition\(Energy.*see EnergyMomentum\(\)"):
        stepper.iteration_matrix(start)


def test_a_step_back_and_other_sizes_need_no_other_stepper():
    """Steps of any size by one stepper; the step back undoes a symmetric step, composed or not."""
    system, start = double_pendulum()
    for scheme in (sc.EnergyMomentum(), sc.Composition(sc.EnergyMomentum())):
        stepper = Stepper(system, scheme, NULL, 0.05, kernels="numpy")
        there = stepper.advance(start, h=0.02).state
        assert there.time == pytest.approx(start.time + 0.02) and there.made_by.step == 0.02
        back = stepper.advance(there, h=-0.02).state
        assert back.q == pytest.approx(start.q, abs=1e-13)
        fresh = Stepper(system, scheme, NULL, 0.02, kernels="numpy").advance(start).state
        assert there.q == pytest.approx(fresh.q, abs=1e-13)
        for bad in (0.0, np.nan, "x"):
            with pytest.raises(sc.InputError, match="argument h"):
                stepper.advance(start, h=bad)


@pytest.mark.slow
def test_smaller_steps_get_no_worse_with_compiled_kernels():
    """A free symmetric top: what iterations leave adds up over 14400 parts of steps, 7e-14 in each.

    Its axis goes around the angular momentum L at the rate ``L/J``, while it turns about the axis
    at ``(J - J_3)/J w_3``: R(t) is the product of both turns.
    """
    pytest.importorskip("numba")
    J, w, until = np.array([1.0, 1.0, 1.6]), np.array([1.0, 0.5, 1.2]), 10.0
    around = Rotation.from_rotvec(J * w / J[0] * until)
    about = Rotation.from_rotvec((0, 0, (J[0] - J[2]) / J[0] * w[2] * until))
    model = sc.Model()
    model.add("top", sc.RigidBody(1.0, J, angular_velocity=w))
    scheme, system = sc.Composition(sc.Variational(), order=6), model.freeze()
    for steps in (400, 800):
        run = sc.simulate(system, scheme, NULL, until / steps, until, every=steps, kernels="numba")
        found = run["q"][-1].reshape(4, 3)[1:]
        assert found == pytest.approx((around * about).as_matrix().T, abs=1e-9)


def dashpot(k):
    """A unit mass, critically damped with k = 1."""
    model = sc.Model()
    bob = model.add("bob", sc.MassPoint(1.0, (1.0, 0, 0), velocity=(0.1, 0, 0)))
    model.add("dash", sc.SpringDamper(sc.ground((0, 0, 0)), bob.place(), k, damping=2.0))
    return model.freeze()


@pytest.mark.slow
def test_compositions_with_dampers():
    """Order 4 where they are weak; where c h_k/m gets to 2 in the backward step, energy grows."""
    scheme = sc.Composition(sc.EnergyMomentum())

    def error(h):
        history = sc.simulate(dashpot(1.0), scheme, NULL, h, 2.0)
        return abs(history["q"][-1, 0] - 1 - 0.1 * 2 * np.exp(-2.0))

    assert np.log2(error(0.4) / error(0.2)) == pytest.approx(4, abs=0.3)
    h = 1.0005 / abs(scheme.shares[2])
    with pytest.warns(sc.AccuracyWarning, match="dampers give"):
        energy = sc.simulate(dashpot(1e-9), scheme, NULL, h, 2 * h)["energy"]
    assert energy[-1] > 10 * energy[0]


@pytest.mark.slow
@pytest.mark.parametrize("treatment", [NULL, MULTIPLIERS], ids=lambda t: t.name)
def test_stabilized_variational_scheme_is_the_plain_one_with_momenta_projected(treatment):
    """RATTLE and SHAKE: same motion, multipliers and work; momenta on the hidden constraints."""
    loop = four_bar()
    loop.add("gravity", sc.LoadGravity((0.3, -9.81, 0.1)))
    scheme = sc.Variational(stabilized=True)
    for system, start in ((sprung(), None), double_pendulum(), (loop.freeze(), None)):
        plain, moved = (
            sc.simulate(system, one, treatment, 0.01, 0.1, start=start, kernels="numpy")
            for one in (sc.Variational(), scheme)
        )
        for name, other in {"q": "q", "Qp": "p", "constraint_force": "constraint_force"}.items():
            size = np.nanmax(abs(plain[name]))
            assert moved[other][:-1] == pytest.approx(plain[name][:-1], abs=1e-11 * size), name
        assert abs(plain["p"] - plain["Qp"]).max() > 1e-7
        assert abs(moved["p"] - moved["Qp"]).max() < 1e-12 * abs(plain["p"]).max()
        assert moved["dissipated"] == pytest.approx(plain["dissipated"], abs=1e-13)
        work = plain["work_drives"][:-1]
        assert moved["work_drives"][:-1] == pytest.approx(work, abs=1e-12)


@pytest.mark.slow
def test_energy_of_a_composed_variational_scheme_is_of_its_order():
    """Its momenta leave out what nodes have along G^T, of second order (with beams, on d3, too)."""
    system, start = free_beam()
    for scheme in (sc.Composition(sc.Variational()), sc.Composition(sc.Variational(), 6)):
        error = []
        for h in (0.01, 0.005):
            history = sc.simulate(system, scheme, NULL, h, 0.1, start=start)
            assert abs(history["p"] - history["Qp"]).max() < 1e-12 * abs(history["p"]).max()
            error.append(abs(history["energy"] - history["energy"][0]).max())
        assert np.log2(error[0] / error[1]) == pytest.approx(scheme.order, abs=0.3)


@pytest.mark.slow
def test_stabilized_energy_momentum_holds_hidden_constraints_and_loses_little():
    system, start = double_pendulum()
    lost = []
    for h in (0.02, 0.01):
        scheme = sc.EnergyMomentum(stabilized=True)
        history = sc.simulate(system, scheme, NULL, h, 0.5, start=start)
        y = [system.extend(q, 0.0) for q in history["q"]]
        inverse = diagnostics.energy.mass_solver(system)
        v = [inverse(p.reshape(-1, 3)).reshape(-1) for p in history["p"]]
        hidden = [system.constraints.jacobian(a) @ b for a, b in zip(y, v, strict=True)]
        assert abs(np.array(hidden)).max() < 1e-12
        lost.append(history["dissipated"][-1])
    assert np.log2(lost[0] / lost[1]) == pytest.approx(3, abs=0.1)  # a step: of fourth order


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: sc.GeneralizedAlpha(1.0), r"rho_inf.*1\.0, expected a number in \[0, 1\)"),
        (lambda: sc.GeneralizedAlpha(np.nan), "rho_inf"),
        (lambda: sc.GeneralizedAlpha(0.8, "no"), "stabilized.*'no', expected True or False"),
        (lambda: sc.EnergyDecaying(velocity=0), "velocity"),
        (lambda: sc.EnergyDecaying(-0.1), r"chi.*-0\.1, expected a number in \[0, 1\]"),
        (lambda: sc.EnergyDecaying(rate=0.0), "rate"),
        (lambda: sc.EnergyDecaying(0.1, rate=1.0), "expected one of them"),
        (lambda: sc.Explicit(checked="no"), "checked"),
        (lambda: sc.Composition(sc.Variational(), order=5), r"order.*5, expected one of \[4, 6\]"),
        (lambda: sc.Composition(sc.Variational), "expected an integrator"),
        (lambda: sc.Composition(sc.Composition(sc.Variational())), "implicit schemes of one step"),
        (lambda: sc.Composition(sc.Explicit()), "Explicit.*only symmetric implicit schemes"),
        (lambda: sc.Composition(sc.EnergyDecaying()), "only symmetric implicit schemes"),
        (lambda: sc.Composition(sc.EnergyMomentum(stabilized=True)), "only symmetric implicit"),
    ],
)
def test_bad_arguments(make, message):
    with pytest.raises(sc.CosseratError, match=message):
        make()
