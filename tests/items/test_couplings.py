"""Springs, dampers, cables, bushings, actuators: closed forms, tangents, energy, momentum."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from helpers_kernels import (
    INTEGRATORS,
    TREATMENTS,
    assert_same,
    assert_same_in_steps_of_other_sizes,
    assert_same_iteration,
    both,
    integrators,
    needs_numba,
    treatments,
)
from helpers_scenes import (
    FULL,
    SHAKE,
    TENSOR,
    four_bar,
    pairs,
    random_state,
    rotation,
    seen,
    unit,
)
from helpers_schemes import KINDS as SCHEMES
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation
from test_tangents import Step, worst

import skfem_cosserat as sc
from skfem_cosserat import diagnostics, relative
from skfem_cosserat.coupling import Coupling
from skfem_cosserat.model.coordinates import KINDS
from skfem_cosserat.model.force_elements import SlackLaw
from skfem_cosserat.relative import normals

EPS = 1e-40
GRAVITY = (0.0, 0.0, -9.81)


def simulate(system, integrator, step, until, treatment="null space", **options):
    return sc.simulate(
        system, INTEGRATORS[integrator], TREATMENTS[treatment], step, until, **options
    )


# -- a scene with every element on every joint ---------------------------------------------------


def semidefinite(rng, m, rank):
    A = rng.standard_normal((m, rank))
    return A @ A.T


def springs(model, joints, rng, damping, actuated, Q):
    """A spring, damper and actuator on each coordinate of each joint."""
    for joint in joints:
        for c in joint.coordinates():
            turning = c.size == 3
            K = Q @ semidefinite(rng, 3, 3) @ Q.T if turning else rng.uniform(1, 5)
            C = Q @ semidefinite(rng, 3, 2) @ Q.T if turning else rng.uniform(0.1, 0.5)
            neutral = 0.3 * Q @ rng.standard_normal(3) if turning else 0.2
            spring = sc.JointSpringDamper(joint, K, damping * C, c.name, neutral)
            model.add(f"spring {joint.name} {c.name}", spring)
            if actuated:
                force = (
                    (lambda t: Q @ (np.sin(t), 1, 0.3))
                    if turning
                    else (lambda t: 2 * np.cos(3 * t))
                )
                actuator = sc.JointActuator(joint, force, c.name)
                model.add(f"motor {joint.name} {c.name}", actuator)


def chain(model, rng, frame, Q):
    """Bodies in a chain of all joints, with lengths of about 1; `frame` makes ground places."""
    bodies = []
    for k in range(8):
        x = Q @ (np.array([k, 0, 0]) + 0.1 * rng.standard_normal(3))
        triad = rotation(rng).T @ Q.T
        body = sc.RigidBody(1.5, TENSOR, center=(0.1, -0.2, 0.15), position=x, triad=triad)
        bodies.append(model.add(f"body {k}", body))
    a = Q @ unit(rng)
    b = np.cross(a, Q @ unit(rng))
    hinge, tube, slide, normal, wire = (unit(rng) for _ in range(5))

    def sides(k):
        x = Q @ (k + 0.5, 0.1, 0.2)
        return bodies[k].at(x), bodies[k + 1].at(x)

    joints = [
        model.add(name, joint)
        for name, joint in {
            "hinge": sc.JointRevolute(*sides(0), axis=Q @ hinge),
            "tube": sc.JointCylindrical(*sides(1), axis=Q @ tube),
            "slide": sc.JointPrismatic(*sides(2), axis=Q @ slide),
            "plane": sc.JointPlanar(*sides(3), normal=Q @ normal, x=Q @ normals(normal)[0]),
            "ball": sc.JointSpherical(*sides(4)),
            "wire": sc.JointPointOnLine(*sides(5), axis=Q @ wire),
            "cardan": sc.JointUniversal(*sides(6), axis_a=a, axis_b=b / np.linalg.norm(b)),
        }.items()
    ]
    if frame is not None:
        x = Q @ (0, 0, -1)
        post = sc.JointRevolute(frame(x), bodies[0].at(x), axis=Q @ unit(rng))
        joints.append(model.add("post", post))
    return bodies, joints


def zoo(seed=0, grounded=True, moving=False, damping=1.0, actuated=True, Q=np.eye(3)):  # noqa: B008
    """Every element between all kinds of places; all turned by Q."""
    rng = np.random.default_rng(seed)
    model = sc.Model()

    def x(*place):
        return Q @ place

    def frame(place):
        return sc.ground(place, SHAKE if moving else None)

    def stiff(rank):
        turn = np.kron(np.eye(2), Q)
        return turn @ semidefinite(rng, 6, rank) @ turn.T

    bodies, joints = chain(model, rng, frame if grounded else None, Q)
    springs(model, joints, rng, damping, actuated, Q)
    mesh = sc.MeshCurve.init_line(x(0, 2, 0), x(1, 2, 0.2), 2, "rod")
    section = sc.Section(FULL, mass=1.3, inertia=(0.11, 0.07))
    rod = model.add("rod", sc.Beam(mesh, section, director=x(0, 1, 0)))
    bob = model.add("bob", sc.MassPoint(0.5, x(0, 3, 0)))
    tip = model.add("tip", sc.MassPoint(0.7, x(1, 3, 0)))
    one, two = bodies[6], bodies[7]
    d = damping
    elements = {
        "two bodies": sc.SpringDamper(one.at(x(6, 0.5, 0.5)), two.at(x(7, -1, 0)), 20, d, 0.9),
        "body, point": sc.SpringDamper(bob.place(), two.local((0.1, 0, 0)), 3, 0.5 * d),
        "node, point": sc.SpringDamper(rod.node("rod.end"), tip.place(), 3, 0.5 * d, 0.7),
        "two points": sc.Cable(bob.place(), tip.place(), 30, d, length=0.8),
        "node, body": sc.Cable(rod.node("rod.start"), bodies[1].at(x(1, 0.3, 0.3)), 30, 0.4 * d),
        "mount": sc.Bushing(one.at(x(6.5, 0.2, 0)), two.at(x(6.7, 0, 0.1)), stiff(6), d * stiff(3)),
        "soft mount": sc.Bushing(rod.node("rod.end"), bodies[3].at(x(3, 0.1, 0.2)), 5.0, 0.2 * d),
    }
    if grounded:
        post = one.at(x(6, 0.3, 0.5))
        elements |= {
            "body, ground": sc.SpringDamper(frame(x(6, 0, 1)), post, 15, 0.5 * d),
            "point, ground": sc.SpringDamper(bob.place(), sc.ground(x(0, 4, 0)), 3, 0.5 * d),
            "cable, ground": sc.Cable(frame(x(1, 3, 1)), tip.place(), 30, d, length=1.3),
            "mount, ground": sc.Bushing(frame(x(7, 0, 1)), two.at(x(7.1, 0, 0.8)), stiff(6)),
        }
    for name, item in elements.items():
        model.add(name, item)
    return model.freeze()


def pushed(system, seed=5, size=0.5):
    """Random velocities that fulfil the hidden constraints."""
    v = size * np.random.default_rng(seed).standard_normal(system.n)
    return sc.initial_state(system, v=sc.project(system, system.q0, v))


def apart(integrator, treatment, kernels):
    """How far the turned motion is from the motion of the turned scene, over three large steps.

    One step of a composition.
    """
    found = []
    for Q in (np.eye(3), Rotation.from_rotvec([0.4, 1.1, -0.7]).as_matrix()):
        until = 0.02 if integrator.shares else 0.06
        run = sc.simulate(zoo(Q=Q), integrator, treatment, 2e-2, until, kernels=kernels)
        found.append(run["q"].reshape(len(run), -1, 3) @ Q)
    assert abs(found[0][-1] - found[0][0]).max() > 1e-3
    return abs(found[1] - found[0]).max()


@pytest.mark.slow
@pytest.mark.parametrize("scheme", SCHEMES, ids=repr)
@treatments
def test_motion_does_not_depend_on_how_a_scene_lies(scheme, treatment):
    """No scheme sees the axes of space: angles by one normal only were off by 1e-4 m."""
    assert apart(scheme, TREATMENTS[treatment], "numpy") < 1e-11


# -- tangents --------------------------------------------------------------------------------------


@pytest.mark.one_quick
@treatments
@integrators
def test_tangent_of_a_step(integrator, treatment):
    step = Step(zoo(1, moving=True), INTEGRATORS[integrator], TREATMENTS[treatment], size=0.1)
    assert worst(step.matrix(), step.derivative()) < 5e-13


def trial(system, seed, size, t=0.3, h=0.05):
    """Couplings at the start of a step and a random end, off the constraint set."""
    rng = np.random.default_rng(seed)
    q = random_state(system, rng, t, 0.3)
    turns = rng.integers(-3, 4, len(system.couplings.angles))
    start = system.couplings.begin(system.extend(q, t), turns, t, h)
    return start, system.extend(q + size * rng.standard_normal(system.n), t + h)


@pytest.mark.one_quick
@pytest.mark.parametrize("size", [0.15, 1e-6, 0.0])
@pytest.mark.parametrize("scheme", ["discrete", "midpoint"])
def test_tangent_of_couplings_alone(scheme, size):
    """Block by block: no mass hides an error; steps of every size."""
    system = zoo(2, moving=True)
    couplings = system.couplings
    force = getattr(couplings, scheme)
    start, y1 = trial(system, 3, size)
    n = system.n
    K, wanted = np.zeros((n, n)), np.zeros((n, n))
    blocks = couplings.tangent(force(start, 0.5 * (start.y0 + y1), y1), 1.0)
    for (a, b), block in zip(couplings.pairs, blocks, strict=True):
        K[3 * a : 3 * a + 3, 3 * b : 3 * b + 3] += block
    for k in range(n):
        z = y1.astype(complex)
        z.reshape(-1)[k] += 1j * EPS
        found = force(start, 0.5 * (start.y0 + z), z).force[: system.rows]
        wanted[:, k] = found.ravel().imag / EPS
    assert abs(wanted).max() > 10
    assert abs(K - wanted).max() < 1e-12 * abs(wanted).max()


# -- coordinates -----------------------------------------------------------------------------------


def invariants_of(psi):
    """``(sin(theta) n, cos(theta) + 1/2)`` from scipy's rotations."""
    quaternion = Rotation.from_rotvec(psi).as_quat()
    vector, scalar = quaternion[:, :3], quaternion[:, 3:]
    return np.hstack([2 * scalar * vector, 2 * scalar**2 - 0.5])


def pairs_of(kind, count=1000):
    """Invariants at two ends of steps of all sizes, on the constraint set."""
    rng = np.random.default_rng(4)
    size = 10.0 ** rng.uniform(-10, -0.5, (count, 1))
    if kind == "rotation":
        psi = rng.standard_normal((count, 3))
        psi *= rng.uniform(0, 2.7, (count, 1)) / np.linalg.norm(psi, axis=1)[:, None]
        return invariants_of(psi), invariants_of(psi + size * rng.standard_normal((count, 3)))
    if kind == "angle":
        a = rng.uniform(-9, 9, (count, 1))
        b = a + 5 * size * rng.uniform(-1, 1, (count, 1))
        return np.hstack([np.cos(a), np.sin(a)]), np.hstack([np.cos(b), np.sin(b)])
    a = rng.uniform(0.5, 2, (count, 1))
    return a, a + size


@pytest.mark.parametrize("name", KINDS)
def test_discrete_derivative_is_exact(name):
    kind = KINDS[name]
    pi0, pi1 = pairs_of(name)
    xi0 = kind.value(pi0)
    xi1 = kind.continued(pi1, xi0)
    Psi = kind.discrete(pi0, xi0, pi1, xi1)
    assert abs((Psi @ (pi1 - pi0)[..., None])[..., 0] - (xi1 - xi0)).max() < 2e-13
    # and near the slope for small steps
    small = abs(pi1 - pi0).max(1) < 1e-8
    assert small.any()
    assert abs(Psi - kind.slope(0.5 * (pi0 + pi1)))[small].max() < 1e-7


# -- closed forms ----------------------------------------------------------------------------------


def oscillator(stiffness, damping, load=0.0):
    """A slider of 2 kg at speed 0.5 m/s."""
    model = sc.Model()
    body = sc.RigidBody.box(2.0, (1, 1, 1), velocity=(0.5, 0, 0))
    body = model.add("body", body)
    rail = sc.JointPrismatic(sc.ground((0, 0, 0)), body.at((0, 0, 0)), axis=(1, 0, 0))
    rail = model.add("rail", rail)
    model.add("spring", sc.JointSpringDamper(rail, stiffness, damping, neutral=0.1))
    if load:
        model.add("push", sc.JointActuator(rail, load))
    return model.freeze()


@pytest.mark.one_quick
@integrators
def test_linear_oscillator_is_the_midpoint_rule(integrator):
    """Of a linear oscillator both schemes make the implicit midpoint rule, step by step."""
    k, c, m, f, h = 30.0, 0.8, 2.0, 1.5, 0.05
    history = simulate(oscillator(k, c, f), integrator, h, 2.0)
    A = np.array([[0, 1], [-k / m, -c / m]])
    rest = np.array([0.1 + f / k, 0])
    step = np.linalg.solve(np.eye(2) - h / 2 * A, np.eye(2) + h / 2 * A)
    start = np.array([0.0, 0.5]) - rest
    powers = [np.linalg.matrix_power(step, n) for n in range(41)]
    wanted = rest + np.array(powers) @ start
    assert abs(history["joint/rail/displacement"] - wanted[:, 0]).max() < 1e-13
    assert abs(history["joint/rail/displacement_rate"] - wanted[:, 1]).max() < 1e-12


def test_generalized_alpha_has_the_work_of_actuators_by_the_trapezoidal_rule():
    def push(t):
        return 1.5 + np.sin(7 * t)

    run = oscillator(30.0, 0.8, push), sc.GeneralizedAlpha(), sc.NullSpace(), 0.05, 1.0
    history = sc.simulate(*run)
    force, x = push(history.times), history["joint/rail/displacement"]
    work = np.cumsum((force[1:] + force[:-1]) / 2 * np.diff(x))
    assert history["work_actuators"][1:] == pytest.approx(work, abs=1e-12)


def test_what_an_energy_decaying_step_takes_from_a_spring(kernels):
    """By its stiffness, ``chi k dx^2/2``: no damper has it, and the energy falls by it."""
    run = oscillator(30.0, 0.0), sc.EnergyDecaying(0.3, velocity=False), sc.NullSpace(), 0.05
    history = sc.simulate(*run, 0.05, kernels=kernels)
    taken = 0.5 * 0.3 * 30.0 * np.diff(history["joint/rail/displacement"])[0] ** 2
    work = sc.Stepper(*run, kernels=kernels).advance(sc.initial_state(run[0])).work
    found = work.numerical, work.dissipated, -np.diff(history["energy"])[0]
    assert found == pytest.approx((taken,) * 3, rel=1e-12)


def pendulum(neutral=0.0, stiffness=12.0, damping=0.0, spin=0.0):
    """A body on a hinge through its centre of mass, spring and damper about its axis."""
    model = sc.Model()
    body = sc.RigidBody(1.5, (0.3, 0.4, 0.5), angular_velocity=(0, spin, 0))
    body = model.add("body", body)
    hinge = sc.JointRevolute(sc.ground((0, 0, 0)), body.at((0, 0, 0)), axis=(0, 1, 0))
    hinge = model.add("hinge", hinge)
    model.add("spring", sc.JointSpringDamper(hinge, stiffness, damping, neutral=neutral))
    return model.freeze()


@pytest.mark.slow
@treatments
@integrators
def test_torsional_spring_has_its_frequency(integrator, treatment):
    """Angle of any size: second order against ``neutral (1 - cos(w t))``, Richardson to 2e-6."""
    neutral, w = 2.0, np.sqrt(12.0 / 0.4)
    ends = []
    for h in (0.01, 0.005):
        history = simulate(pendulum(neutral), integrator, h, 1.0, treatment)
        ends.append(history["joint/hinge/angle"][-1])
    exact = neutral * (1 - np.cos(w))
    errors = abs(np.array(ends) - exact)
    assert 1.9 < np.log2(errors[0] / errors[1]) < 2.1
    assert abs((4 * ends[1] - ends[0]) / 3 - exact) < 2e-6


class Helix(Coupling):
    """A spring that pulls when it is twisted: a displacement and angles of one axis, in any order.

    It is how users write a force element of their own.
    """

    kind = "helix"

    def __init__(self, b, stiffness, names, post):
        self.a, self.b = sc.ground((0, 0, 0)), b
        sides, axis = (self.a, b), np.array([0.0, 0.0, 1.0])
        each = {name: relative.angle(name, *sides, axis) for name in ("turn", "same")}
        each["u"] = relative.displacement("u", *sides, axis)
        each["up"] = relative.displacement("up", self.a, post, axis)
        self.coordinates = tuple(each[name] for name in names)
        self._set_law(stiffness, 0.0, 0.0)


HELIX = np.array([[30.0, 0.6], [0.6, 0.06]])


def helix(names=("u", "turn"), stiffness=HELIX):
    """A body of 2 kg and 0.05 kg m^2 that slides and spins on an axis, at first with 9 rad/s."""
    model = sc.Model()
    body = model.add("body", sc.RigidBody(2.0, (0.1, 0.1, 0.05), angular_velocity=(0, 0, 9.0)))
    rail = sc.JointCylindrical(sc.ground((0, 0, 0)), body.at((0, 0, 0)), axis=(0, 0, 1))
    model.add("rail", rail)
    post = model.add("post", sc.MassPoint(1.0, (0, 0, 1))).place()
    model.add("stand", sc.JointSpherical(sc.ground((0, 0, 1)), post))
    model.add("spring", Helix(body.at((0, 0, 0)), stiffness, names, post))
    return model.freeze()


@pytest.mark.parametrize(
    "kernels",
    [pytest.param("numpy", marks=pytest.mark.slow), pytest.param("numba", marks=needs_numba)],
)
def test_full_turns_of_an_angle_beside_a_displacement(kernels):
    """``M x'' = -K x`` of both, up to 8 rad: by modes, second order in the step; energy is kept."""
    size = np.sqrt([2.0, 0.05])
    roots, modes = np.linalg.eigh(HELIX / np.outer(size, size))
    ends = []
    for h in (0.02, 0.01):
        run = sc.simulate(helix(), sc.EnergyMomentum(), sc.NullSpace(), h, 3.0, kernels=kernels)
        assert abs(run["energy"] - run["energy"][0]).max() < 1e-12
        ends.append(run["coupling/spring/coordinate"][-1])
    assert run["turns"].max() == 1 and abs(run["coupling/spring/coordinate"][:, 1]).max() > 7
    ways = modes.T @ (size * [0.0, 9.0]) * np.sin(np.sqrt(roots) * 3.0) / np.sqrt(roots)
    errors = [abs(end - modes @ ways / size).max() for end in ends]
    assert errors[1] < 0.02 and 1.8 < np.log2(errors[0] / errors[1]) < 2.2


@pytest.mark.plain
@pytest.mark.parametrize(
    "names",
    [("turn", "u"), ("u", "turn", "same"), ("u", "up", "turn"), ("u",) * 6 + ("turn",)],
    ids=["order", "angles", "places", "components"],
)
def test_own_elements_without_kernels_are_told(names):
    """In motion and at rest; by default numpy takes them."""
    system = helix(names, np.eye(len(names)))
    why = r"there are no compiled kernels for helix 'spring', whose coordinates are \["
    for run in (partial(simulate, integrator="energy-momentum", step=0.01, until=0.02), sc.static):
        with pytest.raises(sc.InputError, match=why):
            run(system, kernels="numba")
    run = simulate(system, "energy-momentum", 0.01, 0.02)
    assert run.meta["kernels"] == "numpy" and "displacements before" in run.meta["kernels_why"]


def test_bushing_under_a_wrench():
    """At rest ``K (u, psi)`` is force and moment, the moment by the tangent of the exponential."""
    rng = np.random.default_rng(6)
    K = semidefinite(rng, 6, 6) + 6 * np.eye(6)
    force, moment = np.array([1.0, -2.0, 0.5]), np.array([1.5, 3.0, -7.5])
    model = sc.Model()
    body = model.add("body", sc.RigidBody.box(1.0, (1, 1, 1), position=(0.2, 0, 0)))
    place = body.at((0.3, 0.1, -0.2))
    model.add("mount", sc.Bushing(sc.ground((0.1, 0, 0)), place, K, 3.0))
    model.add("force", sc.LoadForce(place, force))
    model.add("moment", sc.LoadMoment(place, moment))
    path = sc.static(model)
    xi = path["coupling/mount/coordinate"][-1]
    u, psi = xi[:3], xi[3:]
    assert np.linalg.norm(psi) > 0.3
    # delta psi = T^-1 delta theta of a spatial turn: the moment is T^-T (K xi)_psi
    h = 1e-6
    R = Rotation.from_rotvec(psi)
    after, before = ((Rotation.from_rotvec(s * np.eye(3)) * R).as_rotvec() for s in (h, -h))
    turned = (after - before) / (2 * h)
    assert abs((K @ xi)[:3] - force).max() < 1e-9
    assert abs(turned @ (K @ xi)[3:] - moment).max() < 1e-8
    assert abs(path.position(place)[-1] - place.position - u).max() < 1e-12
    assert abs(path["coupling/mount/force"][-1] - K @ xi).max() < 1e-9


def spring_pendulum(length=1.0):
    model = sc.Model()
    bob = model.add("bob", sc.MassPoint(0.8, (1.2, 0, 0), velocity=(0, 0.7, 0.3)))
    model.add("spring", sc.SpringDamper(sc.ground((0, 0, 0)), bob.place(), 40.0, 0.6, length))
    model.add("gravity", sc.LoadGravity(GRAVITY))
    return model.freeze()


@pytest.mark.slow
@integrators
def test_spring_pendulum(integrator):
    """Against an integration of the equation of motion by other means, to 1e-12."""

    def rate(_, z):
        x, v = z[:3], z[3:]
        r = np.linalg.norm(x)
        pull = (40.0 * (r - 1.0) + 0.6 * (x @ v) / r) / r
        return np.concatenate([v, -pull * x / 0.8 + GRAVITY])

    z0 = (1.2, 0, 0, 0, 0.7, 0.3)
    exact = solve_ivp(rate, (0, 1), z0, method="DOP853", rtol=1e-12, atol=1e-13).y[:3, -1]
    ends = [simulate(spring_pendulum(), integrator, h, 1.0)["q"][-1] for h in (0.005, 0.0025)]
    errors = [abs(q - exact).max() for q in ends]
    assert 1.95 < np.log2(errors[0] / errors[1]) < 2.05
    assert abs((4 * ends[1] - ends[0]) / 3 - exact).max() < 2e-7


# -- cables ----------------------------------------------------------------------------------------


def thrown(cable=True, damping=0.3):
    model = sc.Model()
    ball = model.add("ball", sc.MassPoint(0.4, (0.1, 0, 0), velocity=(2.0, 0, 3.0)))
    if cable:
        model.add("rope", sc.Cable(sc.ground((0, 0, 0)), ball.place(), 200.0, damping, length=1.0))
    model.add("gravity", sc.LoadGravity(GRAVITY))
    return model.freeze()


@pytest.mark.slow
@pytest.mark.plain
@integrators
def test_slack_cable_is_not_there(integrator):
    history = simulate(thrown(), integrator, 0.005, 2.0)
    free = simulate(thrown(cable=False), integrator, 0.005, 2.0)
    taut = history["coupling/rope/coordinate"] > 1
    first = int(np.argmax(taut))
    assert first > 20
    assert (history["q"][: first - 1] == free["q"][: first - 1]).all()
    assert history["coupling/rope/coordinate"].max() > 1.01
    assert np.count_nonzero(np.diff(taut)) > 3  # taut and slack in turn
    assert history["coupling/rope/force"].min() == 0
    assert (history["coupling/rope/force"][~taut] == 0).all()
    assert (history["coupling_energy"][~taut] == 0).all()
    assert np.diff(history["dissipated"]).min() >= 0
    assert history["dissipated"][-1] > 0.1


@pytest.mark.parametrize("damping", [0.7, 500.0])
def test_law_of_cables(damping):
    """Tension, energy identity and dissipation for all pairs of stretches, slack ones included."""
    rng = np.random.default_rng(7)
    count, h = 4000, 0.01
    place = sc.MassPoint(1.0, (0, 0, 1)).place()
    law = SlackLaw([sc.Cable(sc.ground((0, 0, 0)), place, 30.0, damping)] * count)
    e0, e1 = 0.1 * rng.standard_normal((2, count, 1))
    e1[:50] = e0[:50] + 1e-12 * rng.standard_normal((50, 1))
    sigma, dissipated, numerical = law.discrete(e0, e1, h, 0.0)
    assert sigma.min() == 0 and dissipated.min() >= 0 and dissipated.max() > 0
    work = (sigma * (e1 - e0))[:, 0]
    change = law.energy(e1) - law.energy(e0)
    assert abs(work - change - dissipated).max() < 1e-13 * max(1, abs(work).max())
    assert not numerical.any()
    *_, whole, numerical = law.discrete(e0, e1, h, 0.0, decay=0.1)
    assert numerical == pytest.approx(whole * 0.015 / (damping + 0.015))  # of 0.5 h 0.1 * 30
    rate = (e1 - e0) / h
    middle = law.midpoint(0.5 * (e0 + e1), rate, e0, e1, h, 0.0)
    assert middle[0].min() == 0 and middle[-1].min() >= 0
    assert (law.force(e0, rate) >= 0).all() and (law.force(-abs(e0), rate) == 0).all()


# -- energy and momentum ---------------------------------------------------------------------------


@pytest.mark.slow
@treatments
def test_energy_balance_of_energy_momentum(treatment, kernels):
    """Springs, dampers, cables, bushings, actuators, loads by nothing left out; every 3rd step."""
    system = zoo(0, moving=True)
    options = {"start": pushed(system), "every": 3, "kernels": kernels}
    history = simulate(system, "energy-momentum", 0.02, 0.9, treatment, **options)
    scale = history["energy"].max()
    assert abs(history["energy_balance"]).max() < 1e-12 * scale
    assert history["dissipated"][-1] > 0.2 * scale
    assert abs(history["work_actuators"][-1]) > 0.1 * scale
    assert np.diff(history["dissipated"]).min() > 0
    assert abs(history["work_drives"]).max() > 0.05 * scale
    assert history["coupling_energy"].min() > 0


@pytest.mark.slow
def test_energy_balance_of_the_variational_scheme():
    """Of second order in the step: energy is not conserved. Works of all steps are in it."""
    system, errors = zoo(0, moving=True), []
    for h, every in ((0.005, 5), (0.0025, 10)):
        history = simulate(system, "variational", h, 0.1, start=pushed(system), every=every)
        errors.append(abs(history["energy_balance"]).max() / history["energy"].max())
        assert np.diff(history["dissipated"]).min() > 0
    assert errors[0] > 1e-6
    assert abs(np.log2(errors[0] / errors[1]) - 2) < 0.15


def linkage():
    """A four-bar linkage (redundant rows) with springs on all pins, a motor and a cable."""
    model = four_bar()
    for k in range(4):
        spring = sc.JointSpringDamper(model[f"pin {k}"], 3.0 + k, 0.05 * k, neutral=0.3 * k)
        model.add(f"spring {k}", spring)
    model.add("motor", sc.JointActuator(model["pin 0"], lambda t: 2 * np.sin(3 * t)))
    top = model["crank"].at((0, 1, 0))
    model.add("cable", sc.Cable(top, sc.ground((2, 0, 0)), 20.0, 0.1))
    return model.freeze()


@pytest.mark.slow
@integrators
def test_elements_in_a_closed_loop(integrator, kernels):
    """By elimination, and with multipliers, for which there are plain kernels only."""
    ways = {"null space": kernels, "multipliers": "numpy"}
    found = [
        simulate(linkage(), integrator, 0.01, 0.7, treatment, kernels=ways[treatment])
        for treatment in TREATMENTS
    ]
    assert found[0].meta["kernels"] == kernels
    assert abs(found[0]["q"] - found[1]["q"]).max() < 1e-12
    limit = 1e-12 if integrator == "energy-momentum" else 1e-4
    for history in found:
        assert abs(history["energy_balance"]).max() < limit * history["energy"].max()
    assert np.ptp(found[0]["joint/pin 2/angle"]) > 0.1


@pytest.mark.slow
@treatments
@integrators
def test_free_scenes_keep_their_momenta(integrator, treatment, kernels):
    """With dampers and actuators, too: all are internal forces."""
    system = zoo(1, grounded=False)
    options = {"start": pushed(system, size=1.0), "kernels": kernels}
    history = simulate(system, integrator, 0.04, 1.0, treatment, **options)
    L = diagnostics.angular_momentum(system, history["q"], history["p"])
    p = diagnostics.linear_momentum(system, history["p"])
    # compared with the sizes of the terms: in a random motion they nearly cancel
    y, momenta = history["q"][0].reshape(-1, 3), history["p"][0].reshape(-1, 3)
    size = np.linalg.norm(np.cross(y, momenta), axis=1).sum()
    assert abs(L - L[0]).max() < 1e-11 * size  # 25 steps, and room for other processors
    assert abs(p - p[0]).max() < 1e-11 * np.linalg.norm(momenta[system.origin_rows], axis=1).sum()
    assert np.linalg.norm(L[0]) > 0.01 * size
    assert np.ptp(history["energy"]) > 0.05 * history["energy"][0]


@pytest.mark.slow
def test_undamped_free_scene_keeps_its_energy():
    system = zoo(1, grounded=False, damping=0.0, actuated=False)
    history = simulate(system, "energy-momentum", 0.02, 0.5, start=pushed(system, size=1.0))
    assert np.ptp(history["energy"]) < 1e-12 * history["energy"][0]
    assert np.ptp(history["coupling_energy"]) > 0.1 * history["energy"][0]
    assert (history["dissipated"] == 0).all()


# -- angles over several turns ---------------------------------------------------------------------


@pytest.mark.slow
@treatments
@integrators
def test_spring_wound_over_several_turns(integrator, treatment, kernels, tmp_path):
    """Its energy and angle count all turns, recorded rarely, and go on from a file."""
    system = pendulum(stiffness=0.05, spin=8.0)
    h = 0.04
    run = partial(simulate, system, integrator, h, treatment=treatment, kernels=kernels)
    whole = run(4.8)
    assert whole.meta["kernels"] == kernels
    w = np.sqrt(0.05 / 0.4)
    exact = 8.0 / w * np.sin(w * whole.times)
    assert exact.max() > 7 * np.pi
    angle = whole["joint/hinge/angle"]
    assert abs(angle - exact).max() < 0.4  # of phase
    assert whole["turns"].max() >= 3
    stored = 0.5 * 0.05 * angle**2
    assert abs(whole["coupling_energy"] - stored).max() < 1e-12 * stored.max()
    # without the turns of the state the spring is another one
    assert abs(diagnostics.coupling_energy(system, whole["q"]) - stored).max() > 5
    if integrator == "energy-momentum":
        assert np.ptp(whole["energy"]) < 1e-12 * whole["energy"][0]
    run(2.4, every=20, path=tmp_path / "half")
    first = sc.History.load(tmp_path / "half")
    assert abs(first["joint/hinge/angle"] - angle[:61:20]).max() < 1e-12
    start = sc.restart(system, first, INTEGRATORS[integrator], h)
    assert start.turns.tolist() == first["turns"][-1].tolist() != [0]
    second = run(4.8, start=start)
    assert abs(second["joint/hinge/angle"] - angle[60:]).max() < 1e-11


def test_rotation_vector_that_passes_pi_is_reported(kernels):
    model = sc.Model()
    body = model.add("body", sc.RigidBody(1.5, (0.3, 0.4, 0.5), angular_velocity=(0, 8.0, 0)))
    model.add("mount", sc.Bushing(sc.ground((0, 0, 0)), body.at((0, 0, 0)), 1e-3))
    with pytest.warns(sc.AccuracyWarning, match="'mount', t = .*the relative rotation passed pi"):
        simulate(model.freeze(), "energy-momentum", 0.02, 0.5, kernels=kernels)


# -- relative coordinates in the history -----------------------------------------------------------


@pytest.mark.slow
@integrators
def test_coordinates_and_rates_of_every_joint(integrator):
    """Rates are the slopes of the coordinates, to second order."""
    system = zoo(3)
    errors = []
    for h in (0.01, 0.005):
        history = simulate(system, integrator, h, 0.1, start=pushed(system))
        worst_of = 0.0
        for joint in system.joints:
            for c in joint.coordinates():
                x = history[f"joint/{joint.name}/{c.name}"]
                rate = history[f"joint/{joint.name}/{c.name}_rate"]
                assert abs(x[0]).max() < 1e-14
                slope = (x[2:] - x[:-2]) / (2 * h)
                worst_of = max(worst_of, abs(slope - rate[1:-1]).max())
        errors.append(worst_of)
    assert errors[0] < 0.05
    assert errors[0] / errors[1] > 3


@pytest.mark.filterwarnings("ignore::skfem_cosserat.AccuracyWarning")  # a beam bent anyhow
def test_rotation_vectors_of_joints():
    """Of a joint that leaves all rotations free, from the triads of both sides."""
    system = zoo(4)
    q = random_state(system, np.random.default_rng(1), 0.0, 0.8)
    start = sc.initial_state(system, q=q, v=0 * q)
    run = simulate(system, "energy-momentum", 1e-3, 1e-3, start=start)
    for joint in system.joints:
        if joint.name in ("ball", "wire"):
            (_, A), (_, B) = (seen(system, p, system.extend(q, 0.0)) for p in (joint.a, joint.b))
            turn = Rotation.from_matrix(A.T @ B).as_rotvec()
            assert abs(run[f"joint/{joint.name}/rotation"][0] - turn).max() < 1e-12


# -- eccentric ends of beams -----------------------------------------------------------------------


@pytest.mark.one_quick
@treatments
@integrators
def test_eccentric_node_is_a_point_of_a_lumped_body(integrator, treatment):
    """The same motion, force and reaction as with the place of a body attached to the node."""
    x = np.array([1.2, 0.1, -0.3])
    found = []
    for lumped in (False, True):
        mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 3, "rod")
        model = sc.Model()
        rod = model.add("rod", sc.Beam(mesh, sc.Section(FULL, mass=1.3, inertia=(0.11, 0.07))))
        end = rod.node("rod.end")
        hub = model.add("hub", sc.RigidBody(0.5, TENSOR, on=end))
        place = hub.at(x) if lumped else rod.node("rod.end", end.triad @ (x - end.position))
        model.add("hinge", sc.JointRevolute(sc.ground(x), place, (0, 1, 0)))
        model.add("spring", sc.SpringDamper(rod.node("rod.start"), sc.ground((0, 1, 0)), 20.0))
        model.add("push", sc.LoadForce(rod.node("rod.start", (0, 0.1, 0)), GRAVITY, follower=True))
        found.append(simulate(model.freeze(), integrator, 0.01, 0.3, treatment))
    for name in ("q", "joint/hinge/force", "joint/hinge/angle"):
        assert abs(found[0][name] - found[1][name])[:-1].max() < 1e-12
    assert abs(found[0]["joint/hinge/angle"]).max() > 0.1


# -- bad input -------------------------------------------------------------------------------------

BODY, OTHER = (sc.RigidBody.box(1.0, (1, 1, 1), position=(k, 0, 0)) for k in range(2))
POINT = sc.MassPoint(1.0, (0, 0, 2))
A, B, P, G = BODY.at((0, 0, 0)), OTHER.at((1, 0, 0)), POINT.place(), sc.ground((0, 0, 1))
HINGE = sc.JointRevolute(G, BODY.at((0, 0, 1)), axis=(0, 0, 1))
TUBE = sc.JointCylindrical(G, BODY.at((0, 0, 1)), axis=(0, 0, 1))
BALL = sc.JointSpherical(G, BODY.at((0, 0, 1)))
NAN = float("nan")
SKEW = np.eye(6) + np.eye(6, k=1) / 9


STRIP = (
    sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 2),
    sc.Section([1e4, 1e4, 1e4, 500, 500, 500], mass=1.0, inertia=(10.0, 10.0)),
)


@pytest.mark.one_quick
@pytest.mark.parametrize(
    ("call", "text"),
    [
        (lambda: sc.JointSpringDamper(HINGE), "joint spring.*both zero"),
        (lambda: sc.JointSpringDamper(HINGE, -2.0), "joint spring.*stiffness = -2.0"),
        (lambda: sc.JointSpringDamper(HINGE, "a"), "joint spring.*stiffness = 'a'"),
        (lambda: sc.JointSpringDamper(HINGE, 1.0, neutral=NAN), "neutral = nan"),
        (lambda: sc.JointSpringDamper(TUBE, 1.0), "which of its coordinates.*displacement"),
        (lambda: sc.JointSpringDamper(HINGE, 1.0, 0, "slide"), "no 'slide'.*angle"),
        (lambda: sc.JointSpringDamper(BODY, 1.0), "joint spring.*expected a joint"),
        (lambda: sc.JointSpringDamper(BALL, np.eye(2)), r"\(2, 2\).*\(3, 3\)"),
        (lambda: sc.JointSpringDamper(BALL, -np.eye(3)), "not positive semidefinite.*-1"),
        (lambda: sc.JointActuator(HINGE, None), "joint actuator.*amplitude is None"),
        (lambda: sc.JointActuator(BALL, 1.0), r"joint actuator.*amplitude.*\(3,\)"),
        (lambda: sc.JointActuator(BALL, lambda t: t), r"joint actuator.*amplitude\(0\)"),
        (lambda: sc.SpringDamper(A, B, 0.0), "spring.*both zero"),
        (lambda: sc.SpringDamper(A, B, 1.0, length=-1.0), "spring.*length = -1.0"),
        (lambda: sc.SpringDamper(A, BODY.at((1, 0, 0)), 1.0), "both sides are rigid body"),
        (lambda: sc.SpringDamper(OTHER.at((0, 0, 0)), A, 1.0), "spring.*no direction"),
        (lambda: sc.SpringDamper(BODY, B, 1.0), "spring.*side a.*expected a place"),
        (lambda: sc.Cable(A, B, 0.0), "cable.*stiffness = 0.0"),
        (lambda: sc.Bushing(A, P, np.eye(6)), "bushing.*side b is mass point.*SpringDamper"),
        (lambda: sc.Bushing(A, B, SKEW), "bushing.*stiffness is not symmetric.*0.111"),
        (lambda: sc.Beam(*STRIP).node(0, offset=(0, 1)), r"beam.*offset.*\(2,\)"),
    ],
)
def test_bad_elements(call, text):
    with pytest.raises(sc.InputError, match=text):
        call()


@pytest.mark.parametrize(
    ("element", "text"),
    [
        (sc.JointSpringDamper(HINGE, 1.0), "joint spring 'own': refers to the revolute joint"),
        (sc.Cable(G, P, 1.0), "cable 'own': .* mass point"),
    ],
)
def test_elements_on_what_is_not_in_the_model(element, text):
    model = sc.Model()
    model.add("ball", sc.MassPoint(1.0))
    model.add("own", element)
    with pytest.raises(sc.InputError, match=text):
        model.freeze()


def test_bad_functions_in_time_name_the_actuator():
    system = oscillator(30.0, 0.8, lambda t: 1.0 if t < 0.1 else NAN)
    with pytest.raises(sc.InputError, match=r"joint actuator 'push'.*nan"):
        simulate(system, "variational", 0.02, 0.5)


def test_turns_must_fit():
    system = pendulum()
    state = sc.State(0.0, 0, system.q0, np.zeros(system.n), turns=np.array([1, 2]))
    with pytest.raises(sc.InputError, match=r"turns of angles: shape \(2,\)"):
        sc.Stepper(system, sc.Variational(), sc.NullSpace(), 0.1).advance(state)


# -- compiled kernels ------------------------------------------------------------------------------


@pairs
def test_kernels_agree_far_from_a_solution(integrator, treatment):
    assert_same_iteration(zoo(), integrator, treatment, 2)


@pytest.mark.slow
@pairs
def test_kernels_agree(integrator, treatment):
    """Ten steps with all elements on all kinds of places; what they do in them is the same."""
    plain, compiled = both(zoo(3, moving=True), integrator, treatment, 2e-3, 0.02)
    assert_same(plain, compiled)
    for name in ("work_actuators", "dissipated", "work_drives"):
        size = max(1e-3, abs(plain[name]).max())
        assert abs(compiled[name] - plain[name]).max() < 1e-9 * size, name
    assert compiled["turns"].tolist() == plain["turns"].tolist()


@pytest.mark.slow
@pairs
def test_kernels_agree_in_steps_of_other_sizes(integrator, treatment):
    """Dampers know the size of the step."""
    assert_same_in_steps_of_other_sizes(zoo(), integrator, treatment)


@pytest.mark.slow
@treatments
def test_compiled_motion_does_not_depend_on_how_a_scene_lies(treatment):
    pytest.importorskip("numba")
    assert apart(sc.Variational(), TREATMENTS[treatment], "numba") < 1e-11
