"""Random scenes with forms, potentials and laws: energy, both treatments, restarts."""

import numpy as np
import pytest
from helpers_scenes import unit
from numpy.testing import assert_allclose

import skfem_cosserat as sc


def random_scene(seed):
    """A beam, held at a hinge or free, with a body at its end; a drag, and two to four more."""
    rng = np.random.default_rng(seed)
    model, order = sc.Model(), int(rng.integers(1, 4))
    mesh = sc.MeshCurve.init_arc((0, 0, 0), (1, 0, 0), (0, 1, 0.3), 1.5, 1.5, 2, name="arc")
    section = sc.Section(10 ** rng.uniform(1, 3, 6), mass=1.0, inertia=rng.uniform(0.02, 0.1, 2))
    beam = model.add("beam", sc.Beam(mesh, section, order=order))
    start, end = beam.node("arc.start"), beam.node("arc.end")
    body = model.add("body", sc.RigidBody.box(1.0, rng.uniform(0.2, 0.6, 3), position=end.position))
    hinge = model.add("joint", sc.JointRevolute(end, body.at(end.position), unit(rng)))
    if rng.random() < 0.5:
        model.add("pin", sc.JointSpherical(sc.ground(start.position), start))
    drag, bed, pull, k = rng.uniform(0.1, 2, 4)
    centre, corner = rng.normal(size=3), body.at(end.position + rng.uniform(-0.2, 0.2, 3))

    def resistance(v, w):
        speed = np.sqrt((w.velocity**2).sum(0) + 1e-12)
        return -drag * speed * (1 + w.s) * (w.velocity * v[:3]).sum(0)

    def along(w):
        way = ((w.phi - w.x) ** 2).sum(0)
        return bed * (10 * way + 5 * way**2) + pull * (1 - w.d1[0])

    def well(x):
        r = ((x - centre) ** 2).sum(-1)
        return -pull * np.exp(-r) + 0.5 * k * r

    def friction(x, v, t, z):
        return -k * v - 2.0 * (x - z), 3.0 * (x - z)

    model.add("drag", sc.LoadForm(beam, resistance))
    options = (
        lambda: sc.EnergyForm(beam, along),
        lambda: sc.Force(corner, energy=well),
        lambda: sc.Force([corner, start], energy=lambda x: k * ((x[0] - x[1]) ** 2).sum() ** 2),
        lambda: sc.Force(corner, friction, memory=corner.position),
        lambda: sc.JointServo(hinge, 10 * k, drag, reference=float(rng.normal())),
        lambda: sc.JointServo(hinge, 10 * k, drag, ki=k, limit=0.5),
        lambda: sc.JointLimits(hinge, -0.1, 0.2, 100 * k, drag),
    )
    for number in rng.permutation(len(options))[: rng.integers(2, 5)]:
        model.add(f"force {number}", options[number]())
    system = model.freeze()
    state = sc.initial_state(system, nu=rng.standard_normal(system.unknowns))
    return model, state, float(10 ** rng.uniform(-3, -2))


def check(seed):
    """Twelve steps: the balance is closed, and all runs are one."""
    model, state, step = random_scene(seed)
    methods, until = (sc.EnergyMomentum(), sc.NullSpace(), step), 12 * step
    run = sc.simulate(model, *methods, until=until, start=state)
    size = max(1.0, abs(run["energy"]).max())
    assert abs(run["energy_balance"]).max() < 1e-10 * size
    scheme, _, h = methods
    given = {"until": until, "start": state, "kernels": ("numpy", "numba")[seed % 2]}
    other = sc.simulate(model, scheme, sc.Multipliers(), h, **given)
    assert_allclose(other["q"], run["q"], rtol=0, atol=1e-9)
    half = sc.simulate(model, *methods, until=6 * step, start=state)
    again = sc.restart(model, half, scheme, h)
    rest = sc.simulate(model, *methods, until=until, start=again)
    assert_allclose(rest["q"][-1], run["q"][-1], rtol=0, atol=1e-10)
    assert_allclose(rest["energy"][-1], run["energy"][-1], rtol=1e-9)


@pytest.mark.filterwarnings("ignore::skfem_cosserat.CosseratWarning")  # much is not resolved
@pytest.mark.parametrize("seed", range(2))
def test_forces_in_a_random_scene(seed):
    check(seed)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::skfem_cosserat.CosseratWarning")
@pytest.mark.parametrize("first", range(0, 300, 50))
def test_forces_in_random_scenes(first):
    for seed in range(first, first + 50):
        check(seed)
