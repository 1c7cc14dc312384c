"""The explicit scheme: order, momenta, joints, step limit, what they refuse."""

import re
from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from test_discrete_mechanics import chain, wheel

import skfem_cosserat as sc
from skfem_cosserat import InterpolationEquidistant, diagnostics
from skfem_cosserat.integrators.explicit import LimitWatch

RUBBER = sc.SectionCircle(0.02, sc.Material(5e6, 0.5, 1100))
FLAT = sc.SectionRectangle(0.06, 0.02, sc.Material(5e6, 0.4, 1100))
SOFT = sc.SectionRectangle(0.06, 0.02, sc.Material(5e5, 0.4, 1100))
#: of runs with other schemes beside the explicit ones, which have no others
PLAIN = {"kernels": "numpy"}


def rod_of(n=4, order=1, section=RUBBER, lumped=True, **motion):
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), n, name="rod")
    return sc.Beam(mesh, section, order=order, director=(0, 1, 0), lumped=lumped, **motion)


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


@pytest.mark.parametrize(("section", "order"), [(RUBBER, 1), (FLAT, 2), (RUBBER, 3), (FLAT, 4)])
def test_limit_bounds_the_highest_frequency(order, section):
    """From below by power iteration over the whole mesh; the bound of one element is sharp."""
    model = sc.Model()
    model.add("rod", rod_of(12, order, section))
    system = model.freeze()
    true = 2 / diagnostics.highest_frequency(system)
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
    assert len(run(system, sc.Explicit(rounds=12), 11.5 * limit.seconds, 23 * limit.seconds)) > 1


# -- what is conserved -----------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:beam 'rod'.* tension")
@pytest.mark.parametrize(
    ("order", "section"), [(1, FLAT), (3, FLAT), (1, SOFT.damped(time=1e-4))], ids=[1, 3, "viscous"]
)
def test_momentum_maps_are_exact(order, section):
    h = run(free_rod(order, section), sc.Explicit(rounds=50), 0.01, 0.1)
    for name in ("linear_momentum", "angular_momentum"):
        assert abs(h[name] - h[name][0]).max() < 1e-13 * abs(h[name][0]).max(), name
    balance = h["energy"] + h["dissipated"]
    assert abs(balance / balance[0] - 1).max() < 1e-3
    assert (h["dissipated"][-1] > 1e-5 * balance[0]) == (section is not FLAT)
    triads = h["q"].reshape(len(h), -1, 4, 3)[:, :, 1:]
    gram = triads @ triads.transpose(0, 1, 3, 2)
    assert abs(gram - np.eye(3)).max() < 1e-14


def test_symmetric_top_is_exact_in_any_step():
    """Its axis goes around the angular momentum at |L|/J: closed form after one large step."""
    spin = np.array([0.7, 0.0, 2.0])
    model = sc.Model()
    model.add("top", sc.RigidBody(1.0, (0.3, 0.3, 0.2), angular_velocity=spin))
    system = model.freeze()
    h = run(system, sc.Explicit(), 3.0, 3.0)
    L = np.array([0.3, 0.3, 0.2]) * spin
    turned = Rotation.from_rotvec(3.0 * L / 0.3).apply((0, 0, 1.0))
    np.testing.assert_allclose(h["q"][-1][9:12], turned, atol=1e-14)


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
    force = "joint/hook/force"
    np.testing.assert_allclose(fine[force][100], em[force][50], rtol=0.01, atol=0.05)


# -- loads, histories ------------------------------------------------------------------------------


def test_loads_in_time_are_averaged_exactly():
    """The impulse of a kinked load between two records is exact, up to each: 2 kg, 3 N s."""
    model = sc.Model()
    ball = model.add("ball", sc.MassPoint(2.0))
    model.add("push", sc.LoadForce(ball.place(), (3, 0, 0), sc.Table([0, 0.33, 2], [0, 2, 0])))
    h = run(model.freeze(), sc.Explicit(rounds=3), 0.5, 2.5)
    left = np.clip(2 - h.times, 0, 2) ** 2 / (2 - 0.33)  # of 2 s, after the kink
    assert h["p"][1:, 0] == pytest.approx(3 * (2 - left[1:]), rel=1e-13)
    assert h["work_loads"][-1] == pytest.approx(h["energy"][-1], rel=1e-13)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:beam 'rod'.* tension")
def test_restart_and_sensors(tmp_path):
    system = mounts(joined=True)
    tip = system.structures[0].node("rod.end")
    sensors = {"tip": sc.SensorPosition(tip)}
    whole = run(system, sc.Explicit(rounds=40), 0.01, 0.03, sensors=sensors)
    part = run(system, sc.Explicit(rounds=40), 0.01, 0.01, path=tmp_path / "part.npz")
    start = sc.restart(system, part, sc.Explicit(rounds=40), 0.01)
    rest = run(system, sc.Explicit(rounds=40), 0.01, 0.03, start=start)
    for name in ("q", "p"):
        np.testing.assert_allclose(rest[name][-1], whole[name][-1], atol=1e-11)
    place = system.offset(tip)
    np.testing.assert_array_equal(
        whole.sensors["tip"].values[-1].ravel(), whole["q"][-1][place : place + 3]
    )
    assert "explicit, limit" in whole.meta["solver"]
    assert whole.meta["integrator"] == "explicit"


# -- limits that fall ------------------------------------------------------------------------------


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
    return system, y.ravel()


# the strip is wider than its two elements are long
@pytest.mark.filterwarnings("ignore:beam.* thick:skfem_cosserat.ModelWarning")
def test_limits_fall_where_elements_are_twisted():
    """By a quarter at 0.5 rad: steps are made shorter, with a warning.

    Never above two over the highest frequency there.
    """
    system, q = twisted_rod(0.5)
    before, true = sc.Explicit.limit(system).seconds, 2 / diagnostics.highest_frequency(system, q)
    watch = LimitWatch(system)
    assert watch.lowered(q.reshape(-1, 3)) and not watch.lowered(q.reshape(-1, 3))
    assert 0.9 * true < watch.smallest.seconds <= 1.001 * true
    assert watch.smallest.seconds / before == pytest.approx(0.72, abs=0.01)
    state = sc.State(0.0, 0, q, np.zeros(system.n))
    step = 0.89 * before
    march = sc.Explicit().march(system, sc.Multipliers(), step)
    with pytest.warns(sc.AccuracyWarning, match="bent so far that their limits fall, to"):
        march.advance(state, step)
    assert march.shortened and march.rounds == 2


# -- springs and damping ---------------------------------------------------------------------------


def orders(values):
    """Of three runs or more, each with half of the step of the one before."""
    errors = [np.linalg.norm(b - a) for a, b in pairwise(values)]
    return np.log2(np.divide(errors[:-1], errors[1:]))


def on_a_spring(stiffness=50.0, damping=0.0, length=None, at=(0, 0, -1), **motion):
    """A mass point of 2 kg below its support."""
    model = sc.Model()
    bob = model.add("bob", sc.MassPoint(2.0, position=at, **motion))
    support = sc.ground((0, 0, 0))
    model.add("spring", sc.SpringDamper(support, bob.place(), stiffness, damping, length))
    return model


def mounts(joined=False, viscous=1e-4):
    """Springs, dampers, a cable, a bushing, drag, follower loads and a viscous beam, in motion."""
    model = sc.Model()
    section = SOFT.damped(time=viscous) if viscous else SOFT
    spin = {} if joined else {"angular_velocity": (1.0, 2.0, 0.0)}
    rod = model.add("rod", rod_of(2, 1, section, **spin))
    box = model.add("box", sc.RigidBody.box(0.2, (0.05, 0.1, 0.2), position=(1, 0, -0.1)))
    bob = model.add("bob", sc.MassPoint(0.3, position=(0.5, 0.5, 0), velocity=(0, 0, 1.0)))
    tip = rod.node("rod.end")
    if joined:
        hinge = sc.JointRevolute(sc.ground((0, 0, 0)), rod.node("rod.start"), axis=(0, 0, 1))
        hinge = model.add("hinge", hinge)
        model.add("ball", sc.JointSpherical(tip, box.at((1, 0, 0))))
        model.add("torsion", sc.JointSpringDamper(hinge, 1.0, 0.05, neutral=0.2))
        model.add("motor", sc.JointActuator(hinge, sc.Harmonic(0.5, 20.0)))
    else:
        stiff = np.diag([200] * 3 + [1] * 3), np.diag([0.2] * 3 + [1e-3] * 3)
        model.add("mount", sc.Bushing(tip, box.at((1, 0, 0)), *stiff))
    model.add("cord", sc.SpringDamper(tip, bob.place(), 300.0, 0.4))
    model.add("rope", sc.Cable(sc.ground((1, 0.3, -0.5)), box.at((1, 0, -0.15)), 40.0, 0.3, 0.3))
    model.add("drag", sc.RayleighDamping(mass=0.5, stiffness=viscous))
    slow = sc.RampSmooth(0.0, 0.04)
    model.add("twist", sc.LoadMoment(tip, (0.02, 0, 0.05), slow, follower=True))
    model.add("push", sc.LoadForce(tip, (0.0, 0.1, 0.1), slow, follower=True))
    model.add("weight", sc.LoadGravity((0, -9.81, 2.0)))
    return model.freeze()


@pytest.mark.slow
@pytest.mark.parametrize("ratio", [0.1, 0.7, 3.0])
def test_damped_oscillator_in_closed_form(ratio):
    """Below and above critical damping: place, velocity and what is dissipated."""
    omega = 5.0
    model = on_a_spring(50.0, 2 * ratio * omega * 2.0, velocity=(0, 0, 1.5))
    ends, until = [], 0.8
    for k in (80, 160, 320) if ratio < 1 else (320, 640, 1280):
        h = run(model.freeze(), sc.Explicit(rounds=k), until, until)
        lost = h.meta["energy_balance"]["dissipated"]
        ends.append([h["q"][-1][2] + 1, h["v"][-1][2], lost])
    a, b = -omega * (ratio + np.array([1, -1]) * np.emath.sqrt(ratio**2 - 1))
    x = (1.5 * (np.exp(a * until) - np.exp(b * until)) / (a - b)).real
    v = (1.5 * (a * np.exp(a * until) - b * np.exp(b * until)) / (a - b)).real
    exact = np.array([x, v, 0.5 * 2.0 * 1.5**2 - 0.5 * (2.0 * v**2 + 50.0 * x**2)])
    errors = abs(np.array(ends) - exact)
    np.testing.assert_allclose(np.log2(errors[1:] / errors[:-1]), -2, atol=0.1)
    assert (errors[-1] < 4e-3 * abs(exact).max()).all()


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:beam 'rod'.* tension")
@pytest.mark.parametrize("joined", [False, True])
def test_second_order_with_springs_and_damping(joined):
    """Positions, velocities; the balance of energies and works closes to second order, too."""
    system = mounts(joined)
    runs = [run(system, sc.Explicit(rounds=k), 0.05, 0.05) for k in (80, 160, 320)]
    for name in ("q", "v", "constraint_force"):
        found = orders([h[name][1] for h in runs])
        assert (found > 1.9).all() and (found < 2.1).all(), name
    balances = [h.meta["energy_balance"] for h in runs]
    assert balances[-1]["dissipated"] > 0.01
    assert abs(balances[-1]["actuators"]) > (1e-3 if joined else -1)
    lost = [abs(found["lost"]) for found in balances]
    assert (abs(np.log2(np.divide(lost[:-1], lost[1:])) - 2) < 0.1).all()
    assert lost[-1] < 1e-4 * balances[-1]["scale"]
    if joined:
        assert runs[-1]["constraint_violation"].max() < 1e-14


@pytest.mark.slow
def test_springs_and_damping_as_with_energy_momentum():
    """The difference of both falls by four."""
    system, ends = mounts(), []
    for k in (40, 80):
        a = run(system, sc.Explicit(rounds=2 * k), 0.05, 0.05)["q"][-1]
        b = run(system, sc.EnergyMomentum(), 0.05 / k, 0.05, every=k, derive=False)["q"][-1]
        ends.append(np.linalg.norm(a - b))
    assert np.log2(ends[0] / ends[1]) == pytest.approx(2, abs=0.1)


def test_drag_in_closed_form():
    """Momentum decays as exp(-alpha t)."""
    model = sc.Model()
    model.add("body", sc.RigidBody(1.0, (0.3, 0.3, 0.2), velocity=(1, 2, 3)))
    model.add("drag", sc.RayleighDamping(mass=0.5))
    h = run(model.freeze(), sc.Explicit(rounds=100), 1.0, 2.0)
    np.testing.assert_allclose(h["v"][-1][:3], np.array([1, 2, 3]) * np.exp(-1.0), rtol=1e-5)


@pytest.mark.slow
def test_torsion_spring_over_several_turns():
    """Wound up by almost four turns and back: its angle does not jump."""
    scheme = sc.Explicit(rounds=8)
    h = run(wheel(), scheme, 0.05, 4.0)
    decay = 0.05 / (2 * 0.4)
    omega = np.sqrt(1.0 / 0.4 - decay**2)
    angle = 40.0 / omega * np.exp(-decay * h["t"]) * np.sin(omega * h["t"])
    assert angle.max() > 3.7 * 2 * np.pi
    found = h["joint/hinge/angle"].ravel()
    turned = np.unwrap(found) if abs(found).max() < 7 else found
    np.testing.assert_allclose(turned, angle, atol=1e-3 * angle.max())
    states = sc.restart(wheel(), h, scheme, 0.05)
    assert states.turns is not None
    assert states.turns[0] == np.rint(angle[-1] / (2 * np.pi))


@pytest.mark.parametrize(
    ("item", "rate"),
    [
        (lambda ends: sc.SpringDamper(*ends, 50.0), 5.0),
        (lambda ends: sc.Cable(*ends, 50.0, length=1.5), 5.0),
        (lambda ends: sc.SpringDamper(*ends, 1.0, 40.0), 20.0),
        (lambda ends: sc.RayleighDamping(mass=20.0), 20.0),
    ],
    ids=["spring", "cable", "damper", "drag"],
)
def test_limits_of_single_springs_and_dampers(item, rate):
    """2/omega and 2/gamma of a mass point in closed form; cables count as taut."""
    model = sc.Model()
    bob = model.add("bob", sc.MassPoint(2.0, position=(0, 0, -1)))
    model.add("item", item((sc.ground((0, 0, 0)), bob.place())))
    limit = sc.Explicit.limit(model)
    assert limit.seconds == pytest.approx(2 / rate)
    kind = "damping" if rate == 20.0 else "springs"
    assert (limit.where, limit.kind) == ("mass point 'bob'", kind)


def test_limit_of_a_rod_with_a_spring_or_viscous():
    """``C = beta K``: the rate of decay is ``beta omega^2``; a stiff spring sets it by itself."""

    def limit_of(section, spring=False):
        model = sc.Model()
        rod = model.add("rod", rod_of(3, 1, section))
        if spring:
            support = sc.ground((2, 1, 0))
            model.add("spring", sc.SpringDamper(support, rod.node("rod.start"), 1e8))
        return sc.Explicit.limit(model)

    bare = limit_of(FLAT)
    assert limit_of(FLAT.damped(time=1e-6)) == bare
    damped = limit_of(FLAT.damped(time=1e-3))
    assert damped.seconds == pytest.approx(2 / (1e-3 * (2 / bare.seconds) ** 2))
    assert damped.kind == "damping"
    sprung = limit_of(FLAT, spring=True)
    true = 2 / np.sqrt(1e8 / (FLAT.mass / 3 / 2))  # of the end alone, whose mass is nodal
    assert sprung.kind == "springs" and 0.6 * true < sprung.seconds <= true < bare.seconds


@pytest.mark.slow
def test_springs_above_the_limit():
    """Refused with a name; without the check the run blows up, just below it does not."""
    system = on_a_spring(velocity=(0, 0, 1.0)).freeze()
    with pytest.raises(sc.InputError, match=r"0\.4 s \(mass point 'bob': springs\).*rounds=2"):
        run(system, sc.Explicit(), 0.41, 4.0)
    with pytest.warns(sc.AccuracyWarning, match="balance of energy"):  # hardly resolved
        good = run(system, sc.Explicit(), 0.39, 100 * 0.39)
    assert good["energy"].max() < 30 * good["energy"][0]
    with (
        pytest.warns(sc.AccuracyWarning, match="balance of energy.* gained"),
        pytest.raises(sc.Diverged, match="blown up"),
    ):
        run(system, sc.Explicit(checked=False), 0.41, 100 * 0.41)


def test_limits_of_springs_fall_in_a_run():
    """The spring's lever grows as the body turns: steps get shorter, with a warning."""
    model = sc.Model()
    body = model.add("body", sc.RigidBody(1.0, (1e-3, 1e-3, 1e-3)))
    model.add("spring", sc.SpringDamper(sc.ground((5, 0, 0)), body.at((0.2, 0, 0)), 1.0))
    system = model.freeze()
    assert sc.Explicit.limit(system).seconds == pytest.approx(2.0)  # no lever about the centre
    march = sc.Explicit().march(system, sc.Multipliers(), 0.7)
    assert march.rounds == 1
    q = np.concatenate([np.zeros(3), [0, 1, 0], [-1, 0, 0], [0, 0, 1]])
    state = sc.State(0.0, 0, q, np.zeros(12))
    with pytest.warns(
        sc.AccuracyWarning, match=r"springs and .* limits fall, to 0\.3.* s of rigid body 'body'"
    ):
        march.advance(state, 0.7)
    pull = np.array([5.0, -0.2]) / np.hypot(5.0, 0.2)  # all but across the lever
    omega = np.sqrt(1.0 + (0.2 * pull[0]) ** 2 / 1e-3)
    assert march.rounds == np.ceil(0.7 * omega / 2)


# -- refused ---------------------------------------------------------------------------------------


def refused_scene(kind):
    model = sc.Model()
    body = model.add("body", sc.RigidBody.box(1.0, (0.1, 0.2, 0.3)))
    if kind == "consistent":
        model.add("rod", rod_of(lumped=False))
    elif kind == "drive":
        pin = model.add(
            "pin", sc.JointRevolute(sc.ground((0, 0, 0)), body.at((0, 0, 0)), axis=(0, 0, 1))
        )
        model.add("motor", sc.JointDrive(pin, lambda t: t**2))
    elif kind == "moving":
        moving = sc.ground((0, 0, 0), motion=sc.MotionTurn((0, 0, 1), lambda t: t))
        model.add("weld", sc.JointSpherical(moving, body.at((0, 0, 0))))
    elif kind == "loop":
        for k, x in enumerate([(0, 0, 0), (0, 0, 1)]):
            model.add(f"pin {k}", sc.JointRevolute(sc.ground(x), body.at(x), axis=(0, 0, 1)))
    return model.freeze()


@pytest.mark.parametrize(
    ("kind", "said"),
    [
        ("consistent", "beam 'rod'.*lumped=True"),
        ("drive", "'motor'.*not prescribed"),
        ("moving", "moving ground"),
        ("loop", "closed loops.*'?pin 1.*tree"),
    ],
)
def test_what_is_refused(kind, said):
    """Limits of consistent masses, too: they are not those of the scheme."""
    if kind == "consistent":
        with pytest.raises(sc.IncompatibleError, match=r"step limit.*beam 'rod'.*lumped=True"):
            sc.Explicit.limit(refused_scene(kind))
    with pytest.raises(sc.errors.IncompatibleError, match=rf"Explicit.*{said}"):
        run(refused_scene(kind), sc.Explicit(), 1e-5, 1.0)


def test_a_needle_is_refused():
    """It has no inertia about its axis: neither a step nor, with a spring, a limit."""
    model = sc.Model()
    needle = model.add("needle", sc.RigidBody(1.0, (0.5, 0.5, 0.0)))
    place = sc.ground((0, 0, 1)), needle.at((0, 0, 1))
    hinge = model.add("hinge", sc.JointRevolute(*place, axis=(1, 0, 0)))
    model.add("spring", sc.JointSpringDamper(hinge, 1.0))
    for ask in (sc.Explicit.limit, lambda model: run(model, sc.Explicit(), 1e-3, 1e-2)):
        with pytest.raises(sc.IncompatibleError, match=r"'needle'.*inertia about all axes"):
            ask(model.freeze())


def test_what_would_be_ignored_is_refused():
    """A solver, as there are no linear systems; multipliers unscaled: both sides are named."""
    scheme, name = sc.Explicit(), re.escape(repr(sc.Explicit()))
    with pytest.raises(sc.IncompatibleError, match=name + r" with SolverSuperLU\(\).*no linear"):
        run(free_rod(), scheme, 1e-5, 1e-3, solver=sc.SolverSuperLU())
    unscaled = sc.Multipliers(scaled=False)
    said = name + r" with Multipliers\(scaled=False\).*take Multipliers\(\)"
    with pytest.raises(sc.IncompatibleError, match=said):
        sc.Stepper(free_rod(), scheme, unscaled, 1e-5)


def test_treatment_and_arguments():
    with pytest.raises(sc.errors.IncompatibleError, match=r"Explicit.*NullSpace.*Multipliers\(\)"):
        sc.simulate(free_rod(), sc.Explicit(), sc.NullSpace(), 1e-5, 1.0)
    with pytest.raises(sc.InputError, match=r"argument system: .* expected a Model"):
        sc.Explicit.limit("rod")
    for bad in (0, 1.5):
        with pytest.raises(sc.InputError, match="rounds"):
            sc.Explicit(rounds=bad)
    with pytest.raises(AttributeError, match=r"Asynchronous is gone: take Explicit"):
        sc.Asynchronous  # noqa: B018
    stepper = sc.Stepper(free_rod(), sc.Explicit(), sc.Multipliers(), 1e-5)
    with pytest.raises(sc.errors.IncompatibleError, match="no iteration matrix"):
        stepper.iteration_matrix(sc.initial_state(free_rod()))
