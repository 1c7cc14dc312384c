"""Reactions of joints against closed forms: what a joint exerts on its side B, about B's point."""

import numpy as np
import pytest
from helpers_scenes import TENSOR, everything, four_bar

import skfem_cosserat as sc

INTEGRATORS = (sc.Variational, sc.EnergyMomentum)
TREATMENTS = (sc.NullSpace, sc.Multipliers)
integrators = pytest.mark.parametrize("integrator", INTEGRATORS)
treatments = pytest.mark.parametrize("treatment", TREATMENTS)
swaps = pytest.mark.parametrize("swap", [False, True])
G = 9.81


def sides(a, b, swap):
    return (b, a) if swap else (a, b)


def reaction(history, name):
    """Force and moment at all states that have them."""
    force, moment = history[f"joint/{name}/force"], history[f"joint/{name}/moment"]
    good = np.isfinite(force).all(axis=1)
    assert good[:-1].all()
    return force[good], moment[good]


@integrators
@treatments
@swaps
def test_cantilevered_body(integrator, treatment, swap):
    """Weld to the ground: the moment balances the weight's lever, with an offset centre."""
    center = np.array([0.1, -0.3, 0.2])
    turn = sc.triad((1, 2, 2), (0, 1, 0))
    model = sc.Model()
    body = sc.RigidBody(2.5, TENSOR, position=(0.8, 0.1, 0.2), triad=turn, center=center)
    model.add("body", body)
    clamp = np.array([0.1, 0, 0.3])
    model.add("clamp", sc.JointFixed(*sides(sc.ground(clamp), body.at(clamp), swap)))
    model.add("gravity", sc.LoadGravity((1.0, 0, -G)))
    model.add("stone", sc.MassPoint(1.0, (5, 0, 0)))
    history = sc.simulate(model.freeze(), integrator(), treatment(), 0.02, 0.2)
    weight = 2.5 * np.array([1.0, 0, -G])
    lever = body.position + center @ turn - clamp
    sign = -1.0 if swap else 1.0
    force, moment = reaction(history, "clamp")
    assert abs(force + sign * weight).max() < 1e-9
    assert abs(moment + sign * np.cross(lever, weight)).max() < 1e-9


@integrators
@treatments
def test_chain_at_rest(integrator, treatment):
    """Each joint carries what hangs below it; a string pulls along itself, without a moment."""
    model = sc.Model()
    upper = model.add("upper", sc.RigidBody(2.0, TENSOR, position=(0, 0, -0.5)))
    lower = model.add("lower", sc.RigidBody(3.0, TENSOR, position=(0, 0, -1.5)))
    bob = model.add("bob", sc.MassPoint(0.5, (0, 0, -3)))
    model.add("top", sc.JointSpherical(sc.ground((0, 0, 0)), upper.at((0, 0, 0))))
    x = (0, 0, -1)
    model.add("pin", sc.JointRevolute(lower.at(x), upper.at(x), (0, 1, 0)))  # side B is above
    model.add("string", sc.JointDistance(lower.at((0, 0, -2)), bob.place()))
    model.add("gravity", sc.LoadGravity((0, 0, -G)))
    history = sc.simulate(model.freeze(), integrator(), treatment(), 0.02, 0.2)
    for name, load in (("top", 5.5), ("pin", -3.5), ("string", 0.5)):
        force, moment = reaction(history, name)
        assert abs(force - (0, 0, load * G)).max() < 1e-8, name
        assert abs(moment).max() < 1e-8, name


@integrators
@treatments
def test_clamped_beam_under_its_tip_body(integrator, treatment):
    """Loads that the stiff clamp node takes directly: force and moment pass to the ground."""
    model = sc.Model()
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 2, "beam")
    section = sc.Section([60, 60, 80, 3, 4, 2.5], mass=0.8, inertia=(0.05, 0.06))
    beam = model.add("beam", sc.Beam(mesh, section))
    root = beam.node("beam.start")
    model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), root))
    model.add("force", sc.LoadForce(root, (1, 2, 3)))
    model.add("moment", sc.LoadMoment(root, (0.3, -0.2, 0.1)))
    history = sc.simulate(model.freeze(), integrator(), treatment(), 0.02, 0.2)
    assert abs(history["q"] - history["q"][0]).max() < 1e-13
    force, moment = reaction(history, "clamp")
    assert np.allclose(force, (-1, -2, -3), rtol=0, atol=1e-9)
    assert np.allclose(moment, (-0.3, 0.2, -0.1), rtol=0, atol=1e-9)


# -- in motion -------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize(("integrator", "order"), [(sc.Variational, 1), (sc.EnergyMomentum, 2)])
def test_treatments_give_the_same_reactions(integrator, order):
    """Of every joint in the scene that has everything, to 1e-9 of the largest."""
    system = everything(order)
    v = sc.project(system, system.q0, system.v0)
    start = sc.initial_state(system, v=v)
    one, two = (
        sc.simulate(system, integrator(), treatment(), 0.005, 0.03, start=start)
        for treatment in TREATMENTS
    )
    size = np.nanmax([abs(one[f"joint/{j.name}/force"]).max() for j in system.joints])
    for joint in system.joints:
        for f, g in zip(reaction(one, joint.name), reaction(two, joint.name), strict=True):
            assert abs(f - g).max() < 1e-9 * size, joint.name
    assert abs(one["constraint_force"] - two["constraint_force"])[:-1].max() < 1e-9 * size


def driven_crank():
    """A drive, whose constraint row has a number of the ground as its factor, and a free body."""
    model = sc.Model()
    crank = model.add("crank", sc.RigidBody(2.5, TENSOR, position=(0.3, 0, 0)))
    pin = model.add("pin", sc.JointRevolute(sc.ground((0, 0, 0)), crank.at((0, 0, 0)), (0, 0, 1)))
    model.add("motor", sc.JointDrive(pin, lambda t: 0.3 * t**2))
    bob = model.add("bob", sc.MassPoint(1.0, (0.6, 0, -1.0)))
    model.add("rod", sc.JointDistance(crank.at((0.6, 0, 0)), bob.place()))
    return model.freeze()


@pytest.mark.parametrize(
    "made",
    [lambda: everything(1), driven_crank, lambda: four_bar((sc.JointRevolute,) * 4).freeze()],
)
def test_many_states_at_once_give_what_each_gives_alone(made):
    """Also where the rows of one depend on each other, and where forces are not known."""
    system, rng = made(), np.random.default_rng(2)
    y = np.array([system.extend(system.q0, t) for t in np.linspace(0, 1, 7)])
    y[:, : system.rows] += 0.1 * rng.standard_normal((7, system.rows, 3))
    G = [system.constraints.jacobian(each).toarray() for each in y]
    c, ydot = system.constraints, rng.standard_normal(y.shape)
    values = [c.values(each) for each in y]
    assert np.allclose(c.stacked_values(y), values, rtol=0, atol=1e-12)
    moved = [each @ row[: system.rows].ravel() for each, row in zip(G, ydot, strict=True)]
    rates = np.array(moved) + [c.ground_rate(*both) for both in zip(y, ydot, strict=True)]
    assert np.allclose(c.stacked_values(y, ydot), rates, rtol=0, atol=1e-11)
    lam = rng.standard_normal((7, system.m))
    force = np.array([each.T @ row for each, row in zip(G, lam, strict=True)])
    force[3, 0] = np.nan
    y[5, :4] = 0.0  # no directors
    found = sc.diagnostics.multipliers(system, y, force)
    assert np.isnan(found[[3, 5]]).all()
    for k in (0, 1, 2, 4, 6):
        alone = sc.diagnostics.multipliers(system, y[k : k + 1], force[k : k + 1])[0]
        assert np.allclose(found[k], alone, rtol=0, atol=1e-9)
        if not len(system.closure.rows):  # else redundant ones, which agree on constraints only
            assert np.allclose(found[k], lam[k], rtol=0, atol=1e-8)
    # the wrench of a joint: what all of its rows do to side B, by virtual motions of it
    forces = sc.diagnostics.reactions(system, y[:2], lam[:2])
    for jr in system.joint_rows:
        f = -(G[0][jr.rows].T @ lam[0, jr.rows]).reshape(-1, 3)
        on_b = jr.b.vertex < len(system.origin_rows)
        r = int(system.vertex_rows[jr.b.vertex if on_b else jr.a.vertex])
        force, moment = (w[0] if on_b else -w[0] for w in forces[jr.joint.name])
        b = int(system.vertex_rows[jr.b.vertex])
        x = y[0, b] + np.array(jr.b.offset) @ y[0, b + 1 : b + 4] if any(jr.b.offset) else y[0, b]
        assert np.allclose(force, f[r], rtol=0, atol=1e-12)
        rows = 4 if system.is_frame[jr.b.vertex if on_b else jr.a.vertex] else 1
        arms = (y[0, r : r + 4] - np.outer([1, 0, 0, 0], x))[:rows]  # about the point on B
        about = np.cross(arms, f[r : r + rows]).sum(axis=0)
        assert moment == pytest.approx(about, abs=1e-11)


# -- joints that carry little beside others that carry much ----------------------------------------


def tipped(mass, links=1):
    """A bar of 2 kg on `links` equal hinges of the ground, a small body welded to its end."""
    model = sc.Model()
    arm = model.add("arm", sc.RigidBody.box(2.0, (1, 0.1, 0.1), position=(0.5, 0, 0)))
    for k in range(links):
        pin = sc.JointRevolute(sc.ground((0, 0, 0.1 * k)), arm.at((0, 0, 0.1 * k)), (0, 0, 1))
        model.add(f"pin {k}", pin)
    tip = model.add("tip", sc.RigidBody(mass, np.full(3, 0.01 * mass), position=(1, 0, 0)))
    model.add("weld", sc.JointFixed(arm.at((1, 0, 0)), tip.at((1, 0, 0))))
    model.add("weight", sc.LoadGravity((0, -G, 0)))
    return model.freeze()


LIGHT = (
    *(sc.EnergyMomentum(), sc.EnergyMomentum(stabilized=True), sc.EnergyDecaying(chi=0.02)),
    *(sc.Variational(), sc.GeneralizedAlpha(0.8), sc.Composition(sc.EnergyMomentum())),
)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scheme", "mass", "links"),
    [
        *((sc.EnergyMomentum(), mass, 1) for mass in (0.1, 1e-3)),
        *((scheme, 1e-6, 1 + k % 2) for k, scheme in enumerate(LIGHT)),
    ],
    ids=repr,
)
def test_what_a_weld_to_a_light_body_carries(scheme, mass, links):
    """Rigid pendulum, ``J a = -M g l cos``: force m (a_tip + g), moment J_tip a; in all states.

    By the recorded angle and rate, so that the path of the scheme does not matter. Off by the
    force's own change over a step, however much more the hinge carries, and however many rows the
    second hinge makes redundant.
    """
    h = 4e-3
    run = sc.simulate(tipped(mass, links), scheme, sc.NullSpace(), h, 0.2)
    a, w = run["joint/pin 0/angle"], run["joint/pin 0/angle_rate"]
    inertia = 2 * (1 + 0.01) / 12 + 2 * 0.25 + 1.01 * mass
    faster = -G * (1 + mass) * np.cos(a) / inertia
    along, across = (
        np.array([np.cos(a), np.sin(a), 0 * a]),
        np.array([-np.sin(a), np.cos(a), 0 * a]),
    )
    force = mass * (faster * across - w**2 * along).T + (0, mass * G, 0)
    moment = 0.01 * mass * faster
    assert abs(run["joint/weld/force"] - force).max() < 2e-3 * abs(force).max()
    allowed = 1e-4 + 1e-9 / mass  # rounding of what the hinge carries counts the more, the lighter
    assert abs(run["joint/weld/moment"][:, 2] - moment).max() < allowed * abs(moment).max()
