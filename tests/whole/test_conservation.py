"""What both integrators keep: momentum maps, energy, constraints; and what they do not."""

from functools import cache

import numpy as np
import pytest
from helpers_scenes import FULL, TENSOR
from rounding import energy_limit, momentum_limits

import skfem_cosserat as sc
from skfem_cosserat import diagnostics

INTEGRATORS = {"variational": sc.Variational(), "energy-momentum": sc.EnergyMomentum()}
TREATMENTS = {"null space": sc.NullSpace(), "multipliers": sc.Multipliers()}
STEP = 0.01


def soft_section():
    return sc.Section(FULL, mass=1.3, inertia=(0.11, 0.07))


def free_beam(order=1):
    """Curved beam of quadratic or linear elements, random velocities of all nodes."""
    rng = np.random.default_rng(3)
    mesh = sc.MeshCurve.init_arc((0.3, 0, 0), (1, 0, 0), (0, 1, 0.3), 1.5, 1.5, 4, "arc")
    count = 4 * order + 1
    beam = sc.Beam(
        mesh,
        soft_section(),
        order=order,
        twist=0.4,
        velocity=rng.standard_normal((count, 3)),
        angular_velocity=rng.standard_normal((count, 3)),
    )
    model = sc.Model()
    model.add("beam", beam)
    return model.freeze(), None


def free_tree():
    """Beam, bodies and points in a free tree with each joint, and a body of its own."""
    model = sc.Model()
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1.2, 0.4, 0), 3, "beam")
    beam = model.add("beam", sc.Beam(mesh, soft_section()))
    end = np.array((1.2, 0.4, 0))
    arm = model.add("arm", sc.RigidBody(1.5, TENSOR, center=(0.1, 0, -0.2), position=(1.5, 0, 0)))
    hand = model.add("hand", sc.RigidBody(0.8, TENSOR, position=(2, 0.5, 0)))
    plate = model.add("plate", sc.RigidBody(0.6, TENSOR, position=(2.5, 0, 0.5)))
    bob = model.add("bob", sc.MassPoint(0.5, (3, 0.4, 1)))
    tail = model.add("tail", sc.RigidBody(0.5, TENSOR, position=(-0.4, 0, 0.1)))
    model.add("ball joint", sc.JointSpherical(beam.node("beam.end"), arm.at(end)))
    model.add("hinge", sc.JointRevolute(arm.at((2, 0, 0)), hand.at((2, 0, 0)), (0, 0.6, 0.8)))
    model.add("weld", sc.JointFixed(hand.at((2, 0, 0.5)), plate.at((2, 0, 0.5))))
    model.add("string", sc.JointDistance(plate.at((2.6, 0, 0.7)), bob.place()))
    model.add("hinge 2", sc.JointRevolute(tail.at((0, 0, 0)), beam.node("beam.start"), (1, 0, 0)))
    model.add("lump", sc.MassPoint(0.4, on=beam.node("beam.start")))
    model.add("stray", sc.RigidBody(1.0, TENSOR, position=(0, 5, 0)))
    return moved(model.freeze(), 5)


def free_body():
    model = sc.Model()
    model.add("body", sc.RigidBody(2.0, TENSOR, center=(0.3, -0.2, 0.4), position=(1, 2, 3)))
    return moved(model.freeze(), 7)


def hanging():
    """Beam and body hung at the origin under gravity, in fast motion."""
    model = sc.Model()
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 3, "beam")
    beam = model.add("beam", sc.Beam(mesh, soft_section()))
    body = model.add("body", sc.RigidBody(0.8, TENSOR, position=(1.2, 0, 0)))
    model.add("hook", sc.JointSpherical(sc.ground((0, 0, 0)), beam.node("beam.start")))
    model.add("hinge", sc.JointRevolute(beam.node("beam.end"), body.at((1, 0, 0)), (0, 1, 0)))
    model.add("gravity", sc.LoadGravity((0, 0, -9.81)))
    return moved(model.freeze(), 9)


def moved(system, seed):
    """With random velocities that fulfil the hidden constraints."""
    v = np.random.default_rng(seed).standard_normal(system.n)
    return system, sc.initial_state(system, v=sc.project(system, system.q0, v))


SCENES = {
    "beam": free_beam,
    "quadratic beam": lambda: free_beam(order=2),
    "tree": free_tree,
    "body": free_body,
    "hanging": hanging,
}
free_scenes = pytest.mark.parametrize("scene", ["quadratic beam", "tree", "body"])
integrators = pytest.mark.parametrize("integrator", INTEGRATORS)
treatments = pytest.mark.parametrize("treatment", TREATMENTS)


@cache
def run(scene, integrator, treatment, step=STEP, until=0.5, kernels="auto"):
    system, start = SCENES[scene]()
    given = system, INTEGRATORS[integrator], TREATMENTS[treatment], step, until
    return system, sc.simulate(*given, start=start, kernels=kernels)


def wandering(values):
    """Largest departure from the first state."""
    return abs(values - values[0]).max()


# -- momentum maps -------------------------------------------------------------------------------


@pytest.mark.slow
@free_scenes
@integrators
@treatments
def test_free_scenes_keep_their_momenta(scene, integrator, treatment, kernels):
    system, history = run(scene, integrator, treatment, kernels=kernels)
    L = diagnostics.angular_momentum(system, history["q"], history["p"])
    p = diagnostics.linear_momentum(system, history["p"])
    assert len(L) == 51
    assert np.isfinite(L).all()
    linear, angular = momentum_limits(system, history)
    assert linear < 1e-9 * np.linalg.norm(p[0]) and angular < 1e-9 * np.linalg.norm(L[0])
    assert wandering(L) < angular
    assert wandering(p) < linear
    assert wandering(history["angular_momentum_projected"]) < angular
    assert wandering(diagnostics.linear_momentum(system, history["Qp"])) < linear
    # and it really moves
    assert abs(history["q"][-1] - history["q"][0]).max() > 0.3


@pytest.mark.slow
@integrators
def test_a_drive_between_free_bodies_keeps_their_momenta(integrator):
    model = sc.Model()
    a = model.add("a", sc.RigidBody.box(2.0, (1, 0.3, 0.2), angular_velocity=(0.3, 0.2, 0)))
    b = model.add("b", sc.RigidBody.box(1.0, (0.2, 0.4, 0.3), position=(1.0, 0, 0)))
    track = sc.JointPrismatic(a.at((0.5, 0, 0)), b.at((1.0, 0, 0)), axis=(1.0, 0, 0))
    model.add("track", track)
    model.add("motor", sc.JointDrive(track, lambda t: 0.2 * t**2 * np.cos(3 * t)))
    system = model.freeze()
    start = sc.initial_state(system, v=sc.project(system, system.q0, system.v0))
    pair = INTEGRATORS[integrator], sc.NullSpace()
    history = sc.simulate(system, *pair, 1e-2, 1.0, start=start)
    assert wandering(history["angular_momentum"]) < 1e-12
    assert wandering(history["linear_momentum"]) < 1e-12
    assert history["joint/track/displacement"][-1] == pytest.approx(0.2 * np.cos(3.0), abs=1e-12)


@pytest.mark.slow
@integrators
@treatments
def test_gravity_leaves_the_momentum_about_its_axis(integrator, treatment, kernels):
    system, history = run("hanging", integrator, treatment, kernels=kernels)
    L = history["angular_momentum"]
    size = np.linalg.norm(L, axis=1).max()
    assert np.ptp(L[:, 2]) < momentum_limits(system, history)[1] < 1e-9 * size
    assert np.ptp(L[:, 1]) > 0.1 * size


# -- energy --------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("scene", ["tree", "hanging"])
@treatments
def test_energy_momentum_keeps_the_energy(scene, treatment, kernels):
    system, history = run(scene, "energy-momentum", treatment, STEP, 3.0, kernels)
    total = history["kinetic"] + history["strain_energy"] + history["external"]
    scale = history["kinetic"].max() + abs(history["external"]).max()
    assert len(total) == 301
    assert np.ptp(total) < energy_limit(system, history) < 1e-8 * scale
    assert np.ptp(history["kinetic"]) > 0.05 * scale  # it is exchanged


def top():
    """Heavy top in fast nutation."""
    model = sc.Model()
    body = sc.RigidBody(1.2, TENSOR, center=(0.1, 0.2, 0.5), angular_velocity=(1, 2, 6))
    model.add("body", body)
    model.add("hook", sc.JointSpherical(sc.ground((0, 0, 0)), body.at((0, 0, 0))))
    model.add("gravity", sc.LoadGravity((0, 0, -9.81)))
    return model.freeze(), None


def bouncing():
    """Straight free beam that stretches and bends about a spin: few modes, all resolved."""
    mesh = sc.MeshCurve.init_line((-0.5, 0, 0), (0.5, 0, 0), 3, "beam")
    section = sc.Section([40, 40, 30, 2, 2, 2], mass=1.0, inertia=(0.1, 0.1))

    def velocity(x):
        return np.c_[0.3 * x[:, 0], 2.0 * x[:, 0], np.cos(4 * x[:, 0]) - 0.45]

    model = sc.Model()
    beam = sc.Beam(mesh, section, velocity=velocity, angular_velocity=(0, 0, 2.0))
    model.add("beam", beam)
    return model.freeze(), None


SCENES |= {"top": top, "bouncing": bouncing}


def total_energy(scene, step, until):
    _, history = run(scene, "variational", "multipliers", step, until)
    return history["energy_projected"] + history["external"]


@pytest.mark.slow
@pytest.mark.parametrize("scene", ["top", "bouncing"])
def test_variational_energy_oscillates_without_drift(scene):
    energy = total_energy(scene, STEP, 12.0)
    first, *_, last = np.array_split(energy, 4)
    assert np.ptp(energy) > 1e-5 * abs(energy[0])  # not conserved,
    assert abs(last.mean() - first.mean()) < 0.05 * np.ptp(energy)  # no drift,
    assert np.ptp(last) < 1.3 * np.ptp(first)  # no growth,
    fine = total_energy(scene, STEP / 2, 3.0)
    assert 3.7 < np.ptp(first) / np.ptp(fine) < 4.3  # and O(h^2)


# -- constraints ---------------------------------------------------------------------------------


@pytest.mark.one_quick
@pytest.mark.parametrize("scene", ["quadratic beam", "tree", "body", "hanging"])
@integrators
@treatments
def test_constraints(scene, integrator, treatment, kernels):
    _, history = run(scene, integrator, treatment, kernels=kernels)
    violation = history["constraint_violation"].max()
    assert violation < (1e-12 if treatment == "null space" else 1e-11)
    assert history["hidden_violation"].max() < 1e-12 * (1 + abs(history["v"]).max())


# -- reversal ------------------------------------------------------------------------------------


# momenta of the variational scheme, turned round, have parts along the constraints
@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::skfem_cosserat.ModelWarning")
@pytest.mark.parametrize("scene", ["tree", "hanging"])
@integrators
@treatments
def test_time_can_be_turned_round(scene, integrator, treatment):
    """Both schemes are symmetric: with the momenta turned round they go back to the start."""
    system, history = run(scene, integrator, treatment, STEP, 0.3)
    end = history.last()
    turned = sc.State(0.0, 0, end["q"], -end["p"], fresh=True)
    back = sc.simulate(
        system, INTEGRATORS[integrator], TREATMENTS[treatment], STEP, 0.3, start=turned
    )
    assert abs(back["q"][::-1] - history["q"]).max() < 1e-10
    # of p_0 the start gives its own part of the constraint force, the way back another
    assert abs(back["p"][::-1] + history["p"])[1:].max() < 1e-10
